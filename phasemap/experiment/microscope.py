"""The microscope: lever, tip, drive, and the interaction between tip and surface."""

from __future__ import annotations

import math
from dataclasses import dataclass

from phasemap._shared.checks import number
from phasemap._shared.errors import InputError
from phasemap.experiment.interaction import Interaction

EXCITATIONS = ("direct", "base")
DETECTIONS = ("fm", "am")


@dataclass(frozen=True)
class Cantilever:
    """The lever's first eigenmode as a damped spring.

    Parameters
    ----------
    stiffness : float
        Spring constant k [N/m], > 0.
    resonance_frequency : float
        Free resonance frequency f_c = omega_c / (2 pi) [Hz], > 0.
    quality_factor : float
        Q = 1 / (2 alpha0) [1], > 0.5 (the lever must oscillate).

    Examples
    --------
    >>> Cantilever(stiffness=40.0, resonance_frequency=148.5e3, quality_factor=833.0).damping
    0.0006002400960384153
    """

    stiffness: float
    resonance_frequency: float
    quality_factor: float

    def __post_init__(self) -> None:
        number("stiffness", self.stiffness, "N/m", above=0)
        number("resonance_frequency", self.resonance_frequency, "Hz", above=0)
        number("quality_factor", self.quality_factor, "1", above=0.5)

    @property
    def damping(self) -> float:
        """alpha0 = 1 / (2 Q), the lever's own damping [1]."""
        return 0.5 / self.quality_factor


@dataclass(frozen=True)
class Tip:
    """A spherical tip.

    Parameters
    ----------
    radius : float
        R [m], > 0.
    modulus : float, optional
        Young's modulus of the tip [Pa], > 0; None is a rigid tip.
    poisson_ratio : float
        Poisson's ratio of the tip [1]; used with `modulus` only.

    Examples
    --------
    >>> Tip(radius=30e-9).modulus is None
    True
    """

    radius: float
    modulus: float | None = None
    poisson_ratio: float = 0.3

    def __post_init__(self) -> None:
        number("tip radius", self.radius, "m", above=0)
        number("tip radius", self.radius, "m", maximum=1.0)  # so that powers of it are finite
        if self.modulus is not None:
            number("tip modulus", self.modulus, "Pa", above=0)
        number("tip poisson_ratio", self.poisson_ratio, "1", above=-1, maximum=0.5)


@dataclass(frozen=True)
class Mode:
    """A second eigenmode of the lever, driven together with the first, and so little that it only feels its way.

    Parameters
    ----------
    stiffness : float
        k2 [N/m], > 0.
    frequency : float
        Free resonance frequency f2 [Hz], > 0.
    quality_factor : float
        Q2 [1], > 0.5.
    free_amplitude : float
        Of the second mode, free [m], > 0.
    detection : {"fm", "am"}
        "fm": a phase-locked loop holds the phase at resonance and shows the shift of the frequency, another loop holds
        the amplitude (AM-FM). "am": driven at f2, it shows amplitude and phase (AM-AM).

    Examples
    --------
    >>> Mode(stiffness=1600.0, frequency=1.88e6, quality_factor=600.0, free_amplitude=0.1e-9).detection
    'fm'
    """

    stiffness: float
    frequency: float
    quality_factor: float
    free_amplitude: float
    detection: str = "fm"

    def __post_init__(self) -> None:
        number("stiffness of the second mode", self.stiffness, "N/m", above=0)
        number("frequency of the second mode", self.frequency, "Hz", above=0)
        number("quality_factor of the second mode", self.quality_factor, "1", above=0.5)
        number("free_amplitude of the second mode", self.free_amplitude, "m", above=0)
        if self.detection not in DETECTIONS:
            raise InputError("detection", self.detection, " or ".join(map(repr, DETECTIONS)))


@dataclass(frozen=True)
class Drive:
    """What makes the lever swing.

    Parameters
    ----------
    free_amplitude : float
        Amplitude of the free lever's tip AT RESONANCE [m], > 0; the drive is u0 = free_amplitude / Q.
    frequency : float, optional
        Drive frequency [Hz], > 0; None drives at the free resonance.
    excitation : {"direct", "base"}
        "direct" is a force on the tip (magnetic, photothermal): the detector sees the tip's position. "base" is a
        shaker under the lever, which moves its base by u0: the detector sees the deflection, position less base.
        Setpoint, amplitude, phase, and the free amplitude at the drive frequency are those of what it sees; the phase
        is 0 for the free lever at resonance. The difference is of the order 1/Q.
    second : Mode, optional
        A second mode driven at its own frequency, by a force on the tip. It is taken to move by much less than the
        indentation, so that the orbit is that of the first mode alone: `phasemap.channels` says what it shows.

    Examples
    --------
    >>> Drive(free_amplitude=127e-9).frequency is None
    True
    """

    free_amplitude: float
    frequency: float | None = None
    excitation: str = "direct"
    second: Mode | None = None

    def __post_init__(self) -> None:
        number("free_amplitude", self.free_amplitude, "m", above=0)
        if self.excitation not in EXCITATIONS:
            raise InputError("excitation", self.excitation, " or ".join(map(repr, EXCITATIONS)))
        if self.second is not None and not isinstance(self.second, Mode):
            raise InputError("second", self.second, "a Mode, or None")
        if self.frequency is not None:
            number("drive frequency", self.frequency, "Hz", above=0)


@dataclass(frozen=True)
class Microscope:
    """Everything about the instrument that a simulation needs.

    Parameters
    ----------
    cantilever : Cantilever
    tip : Tip
    drive : Drive
    interaction : Interaction

    Examples
    --------
    >>> scope = Microscope(Cantilever(40.0, 148.5e3, 833.0), Tip(30e-9), Drive(127e-9))
    >>> scope.frequency_ratio
    1.0
    >>> round(scope.free_amplitude * 1e9, 6)
    127.0
    """

    cantilever: Cantilever
    tip: Tip
    drive: Drive
    interaction: Interaction = Interaction()

    def __post_init__(self) -> None:
        number("drive frequency over resonance frequency", self.frequency_ratio, "1", above=0, maximum=1e100)

    @property
    def frequency_ratio(self) -> float:
        """omega, the drive frequency over the free resonance frequency [1]."""
        if self.drive.frequency is None:
            return 1.0
        return self.drive.frequency / self.cantilever.resonance_frequency

    @property
    def base_amplitude(self) -> float:
        """u0 = free_amplitude / Q, the amplitude of the drive: with base excitation, that of the base [m]."""
        return self.drive.free_amplitude / self.cantilever.quality_factor

    @property
    def free_amplitude(self) -> float:
        """Amplitude of the free lever at the drive frequency, as the detector sees it [m]: what the setpoint is of."""
        omega, loss = self.frequency_ratio, 2 * self.cantilever.damping * self.frequency_ratio
        tip = self.base_amplitude / math.hypot(1 - omega**2, loss)
        return tip if self.drive.excitation == "direct" else tip * math.hypot(omega**2, loss)
