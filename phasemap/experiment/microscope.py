"""The microscope: lever, tip, drive, and the interaction between tip and surface."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from typing import NamedTuple

from phasemap._shared.checks import check_choice, number
from phasemap._shared.errors import InputError
from phasemap._shared.fields import Number, Shown, known_as
from phasemap._shared.notices import question
from phasemap.experiment.beam import all_modes, free_motion
from phasemap.experiment.cantilever import FREQUENCY
from phasemap.experiment.cantilever import Cantilever as Cantilever
from phasemap.experiment.interaction import Interaction

EXCITATIONS, DETECTORS = ("direct", "base"), ("slope", "tip")
RADIUS, AMPLITUDE = (0.5e-9, 10e-6), (0.05e-9, 1e-6)  # what is found in practice [m, m]
DETECTIONS = ("fm", "am")
LOW_Q = 20.0  # below this the second mode changes phases by degrees


@known_as(R="radius", E="modulus", nu="poisson_ratio")
@dataclass(frozen=True, repr=False)
class Tip(Shown):
    """A spherical tip.

    Parameters
    ----------
    radius : float
        R [m], > 0.
    modulus : float, optional
        Young's modulus of the tip [Pa], > 0; None is a rigid tip.
    poisson_ratio : float
        Poisson's ratio of the tip [1]; used with `modulus` only.
    """

    radius: Number[float] = Number("m", said="tip radius", above=0, maximum=1.0, usual=RADIUS)  # its powers are finite
    modulus: Number[float | None] = Number("Pa", None, said="tip modulus", above=0, usual=(1e6, 2e12))
    poisson_ratio: Number[float] = Number("1", 0.3, said="tip poisson_ratio", above=-1, maximum=0.5)


@known_as(A="free_amplitude")
@dataclass(frozen=True, repr=False)
class Mode(Shown):
    """The second mode of the lever, driven together with the first; mostly so little that it only feels its way.

    Parameters
    ----------
    free_amplitude : float
        Of the second mode, free, at the tip [m], > 0; the mode itself is one of `Cantilever.modes`.
    detection : {"fm", "am"}
        "fm": a phase-locked loop holds the phase at resonance and shows the shift of the frequency, another loop holds
        the amplitude (AM-FM). "am": driven at f2, it shows amplitude and phase (AM-AM).
    """

    free_amplitude: Number[float] = Number(
        "m", 0.1e-9, said="second mode's free_amplitude", above=0, maximum=1.0, usual=(1e-12, 100e-9)
    )
    detection: str = "fm"

    def __post_init__(self) -> None:
        check_choice("detection", self.detection, DETECTIONS)


@known_as(A="free_amplitude", A0="free_amplitude", amplitude="free_amplitude", f="frequency")
@dataclass(frozen=True, repr=False)
class Drive(Shown):
    """Drive of the lever.

    Parameters
    ----------
    free_amplitude : float
        Amplitude of the free lever's first mode AT RESONANCE [m], > 0. The drive is u0 = free_amplitude / Q, and under
        base excitation u0 = free_amplitude / (Q participation).
    frequency : float, optional
        Drive frequency [Hz], > 0; None drives at the free resonance.
    excitation : {"direct", "base"}
        "direct" is a force on the tip (magnetic, photothermal), which drives every mode: the detector sees the tip's
        position. "base" is a shaker under the lever, which moves its base by u0 while air or liquid around it are at
        rest: the detector sees the deflection, position less base.
        Setpoint, amplitude, phase, and the free amplitude at the drive frequency are those of what it sees; the phase
        is 0 for the free lever at resonance. The difference is of the order 1/Q.
    second : Mode, optional
        Drives the lever's second mode at its own frequency too, by a force on the tip. It is taken to move by much less
        than the indentation, so that the orbit is as without: `phasemap.channels` says what it shows. The solver
        "march" with the control `Engage` integrates both drives at once, whatever the amplitudes.
    """

    free_amplitude: Number[float] = Number("m", above=0, maximum=1.0, usual=AMPLITUDE, asks=False)
    frequency: Number[float | None] = Number("Hz", None, said="drive frequency", above=0, usual=FREQUENCY)
    excitation: str = "direct"
    second: Mode | None = None

    def __post_init__(self) -> None:
        check_choice("excitation", self.excitation, EXCITATIONS)
        if self.frequency is None:  # else a Microscope knows how far from resonance the lever is driven
            question("free_amplitude", self.free_amplitude, "m", AMPLITUDE)


class SecondMode(NamedTuple):
    """A second mode that is driven."""

    stiffness: float  # k2 [N/m]
    frequency: float  # f2 [Hz]
    quality_factor: float
    free_amplitude: float  # at the tip [m]
    detection: str


SECOND_HINT = "Cantilever(..., modes=2) has one, or modes=(pm.Eigenmode(...),), in a scene [[cantilever.modes]]."
PARTS = {"cantilever": Cantilever, "tip": Tip, "drive": Drive, "interaction": Interaction}


@dataclass(frozen=True, repr=False)
class Microscope(Shown):
    """Everything about the instrument that a simulation needs.

    Numbers of its parts are in SI units, or text with a unit ("40 N/m", "300 kHz"), or quantities of pint.

    Parameters
    ----------
    cantilever : Cantilever
    tip : Tip
    drive : Drive
    interaction : Interaction
    detector : str or tuple of float
        What the detector sees of the modes: "slope", that at the end of the lever, as an optical lever does; "tip", the
        deflection of the tip, as an interferometer does; or a weight for each mode, the first of them 1. With one mode
        all are the same.

    Examples
    --------
    >>> scope = Microscope(Cantilever(40.0, 148.5e3, 833.0), Tip(30e-9), Drive(127e-9))
    >>> scope.frequency_ratio
    1.0
    >>> round(scope.driven_amplitude * 1e9, 6)
    127.0
    >>> scope == Microscope(Cantilever("40 N/m", "148.5 kHz", 833), Tip("30 nm"), Drive("127 nm"))
    True
    """

    cantilever: Cantilever
    tip: Tip
    drive: Drive
    interaction: Interaction = Interaction()
    detector: str | tuple[float, ...] = "slope"

    def __post_init__(self) -> None:
        for name, cls in PARTS.items():
            part = getattr(self, name)
            if not isinstance(part, cls):
                hint = "The order is Microscope(Cantilever(...), Tip(...), Drive(...), Interaction(...))."
                raise InputError(name, part, f"{'an' if cls is Interaction else 'a'} {cls.__name__}", hint)
        if self.drive.second is not None and not self.cantilever.modes:
            raise InputError("modes", (), "at least a second mode where the drive has one", SECOND_HINT)
        object.__setattr__(self, "detector", self._checked_detector())
        number("drive frequency over resonance frequency", self.frequency_ratio, "1", above=0, maximum=1e100)
        if self.drive.frequency is not None:
            question("free amplitude at the drive frequency", self.driven_amplitude, "m", (0.0, AMPLITUDE[1]))

    @property
    def frequency_ratio(self) -> float:
        """omega, the drive frequency over the free resonance frequency [1]."""
        if self.drive.frequency is None:
            return 1.0
        return self.drive.frequency / self.cantilever.resonance_frequency

    @property
    def base_amplitude(self) -> float:
        """u0 [m]: free_amplitude / Q, and with base excitation that over the participation, how far the base moves."""
        drive = self.drive.free_amplitude / self.cantilever.quality_factor
        return drive if self.drive.excitation == "direct" else drive / self.cantilever.participation

    @property
    def detector_weights(self) -> tuple[float, ...]:
        """Share of each mode's deflection at the tip that the detector sees, over that of the first [1]."""
        modes = self.cantilever.eigenmodes
        if isinstance(self.detector, tuple):
            return self.detector
        return tuple(1.0 if self.detector == "tip" else float(mode.slope_ratio or 0.0) for mode in modes)

    @property
    def driven_amplitude(self) -> float:
        """Amplitude of the free lever at the drive frequency, as the detector sees it [m]: what the setpoint is of."""
        if len(self.detector_weights) > 1:
            return abs(self.free_signal(self.frequency_ratio))
        omega, loss = self.frequency_ratio, 2 * self.cantilever.damping_ratio * self.frequency_ratio
        tip = self.drive.free_amplitude / self.cantilever.quality_factor / math.hypot(1 - omega**2, loss)
        return tip if self.drive.excitation == "direct" else tip * math.hypot(omega**2, loss)

    @property
    def free_phase(self) -> float:
        """Phase of the free lever at the drive frequency, as the detector sees it [degree]; 0 at resonance."""
        at_resonance = self.free_signal(1.0)
        return math.degrees(cmath.phase(self.free_signal(self.frequency_ratio) * at_resonance.conjugate()))

    @property
    def advice(self) -> str:
        """Sentence on modes that the lever lacks, and what to do; empty where it has all that count."""
        lever, gas = self.cantilever, "give the lever as it is in air and [cantilever.liquid] (in Python in_liquid())"
        low = f"Q is {lever.quality_factor:.3g} and the lever has "
        if lever.quality_factor < LOW_Q and not lever.modes:
            return (
                f"{low}one mode: at such a Q most of the phase contrast comes from energy that taps give to the "
                f"second. Set modes, or {gas}, which finds its modes in the liquid."
            )
        if lever.quality_factor < LOW_Q and isinstance(lever.modes, int):
            return f"{low}the modes of a beam in a gas, whose f2/f1 and Q2 are not those in a liquid: {gas}."
        _, second = all_modes(lever.quality_factor, lever.participation, 2)
        harmonic = second.frequency_ratio / self.frequency_ratio
        if not lever.modes and abs(harmonic - round(harmonic)) < harmonic / second.quality_factor:
            return (
                f"The lever has one mode, and the second of a uniform beam, at {second.frequency_ratio:.2f} times the "
                f"first, is within its width of harmonic {round(harmonic)} of the drive: it swings too. Set modes."
            )
        return ""

    @property
    def second_mode(self) -> SecondMode | None:
        """The lever's second mode, where the drive has one."""
        if self.drive.second is None:
            return None
        (lever, driven), second = (self.cantilever, self.drive.second), self.cantilever.eigenmodes[1]
        stiffness = float(second.stiffness_ratio or 0.0) * lever.stiffness
        frequency = second.frequency_ratio * lever.resonance_frequency
        return SecondMode(stiffness, frequency, second.quality_factor, driven.free_amplitude, driven.detection)

    def free_signal(self, omega: float) -> complex:
        """Signal of the free lever [m], complex; the drive leads the first mode at resonance by 90 degrees."""
        modes = free_motion(self.cantilever.eigenmodes, omega, self.base_amplitude, self.drive.excitation)
        return sum((weight * mode for weight, mode in zip(self.detector_weights, modes, strict=True)), 0j)

    def _checked_detector(self) -> str | tuple[float, ...]:
        """The detector, its weights as floats."""
        count, given = len(self.cantilever.eigenmodes), self.detector
        if isinstance(given, str) and given in DETECTORS:
            return given
        if isinstance(given, (tuple, list)) and len(given) == count and given[0] == 1:
            return tuple(number("detector", weight, "1") for weight in given)
        allowed = f"'slope', 'tip', or as many weights as modes, {count}, the first of them 1"
        raise InputError("detector", given, allowed)
