"""Derived channels, from amplitude and phase, and from the orbit where it is known.

A channel is a name, a unit, a function of the motion of the tip, and the paper that the function is from. To add one,
add an entry to `CHANNELS`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from operator import attrgetter

import numpy as np

from phasemap._kernels import columns as col
from phasemap._shared.arrays import Array
from phasemap._shared.units import ELECTRONVOLT
from phasemap.experiment.lever import drive_energy, energy_supplied, lost_in_air, of_tip, virial_of
from phasemap.experiment.lever_numbers import lever_of, modal_motion
from phasemap.experiment.microscope import Microscope, SecondMode
from phasemap.results.variables import FLOATS

SIDEBANDS_BEYOND = 0.3  # share of the modulus over the largest force over k A, by sidebands beyond second order
FAINT = 1e-3  # of the largest virial that the drive holds: a contact that stores less is none to divide by


@dataclass(frozen=True, eq=False)
class TipMotion:
    """Known motion of the tip in some pixels."""

    lever: Array  # shape (n,); as of `phasemap.experiment.lever.lever_of`
    scope: Microscope
    # amplitude, phase: of the first harmonic of the tip's position [m, rad]
    amplitude: Array
    phase: Array
    # Variables of an image, of the same pixels, that were integrated over the orbit; may be empty
    orbit: Mapping[str, Array] = field(default_factory=dict)

    @property
    def frequency(self) -> float:
        """Drive frequency [Hz]."""
        return self.scope.frequency_ratio * self.scope.cantilever.resonance_frequency

    @cached_property
    def dissipation(self) -> Array:
        """Energy that the surface takes per cycle, as amplitude and phase tell it [J]."""
        return energy_supplied(self.lever, self.amplitude, self.phase) - lost_in_air(self.lever, self.amplitude)

    @cached_property
    def virial(self) -> Array:
        """Virial of the surface's force, as amplitude and phase tell it, positive for attraction [J]."""
        return virial_of(self.lever, self.amplitude, self.phase)

    @property
    def orbit_dissipation(self) -> Array:
        """Energy that the surface takes per cycle [J], by the orbit where that is known."""
        known = self.orbit.get("dissipation")
        return self.dissipation if known is None else known

    @property
    def orbit_virial(self) -> Array:
        """Virial of the surface's force [J], by the orbit where that is known."""
        known = self.orbit.get("virial")
        return self.virial if known is None else known

    @property
    def loss_tangent(self) -> Array:
        """Loss tangent by the instrument's formula, from amplitude and phase [1]."""
        with np.errstate(all="ignore"):
            tangent: Array = -self.dissipation / (2 * np.pi * self.virial)
        return tangent

    @property
    def corrected_loss_tangent(self) -> Array:
        """Loss tangent by the energy that the contact stores, and without the loss of necks [1]."""
        loss, storage = self.orbit_dissipation - self.orbit["adhesion_loss"], self.orbit["contact_storage"]
        most = 0.5 * self.lever[col.STIFFNESS] * self.lever[col.DRIVE] * self.amplitude
        with np.errstate(all="ignore"):
            return np.where(storage > FAINT * most, loss / (2 * np.pi * storage), np.nan)

    def deflection(self, i: int) -> Array:
        """Deflection of mode i, counted from 0, in the first harmonic: complex, of the detector's phase [m]."""
        scope = self.scope
        moved, _ = modal_motion(self.lever, self.amplitude, self.phase)
        mode, resonant = scope.cantilever.eigenmodes[i], scope.free_signal(1.0) / 1j
        base = scope.base_amplitude * float(mode.participation or 0.0) if scope.drive.excitation == "base" else 0.0
        return (moved[i] - base) * abs(resonant) / resonant

    @cached_property
    def second(self) -> SecondMode:
        """The second mode that is driven."""
        assert self.scope.second_mode is not None
        return self.scope.second_mode

    @cached_property
    def felt(self) -> Array:
        """Stiffness that the surface adds to the second mode, over k2, and loss that it adds to 1/Q2 (complex)."""
        first = 2 * np.pi * self.scope.cantilever.resonance_frequency
        drag = self.orbit["mean_damping"] * self.lever[col.STIFFNESS] / first  # [kg/s]
        gradient = self.orbit["mean_gradient"] - self.orbit["sideband_stiffness"]
        loss = drag * 2 * np.pi * self.second.frequency - self.orbit["sideband_loss"]
        return np.asarray((gradient + 1j * loss) / self.second.stiffness)

    @cached_property
    def second_shift(self) -> Array:
        """Shift of the second mode's resonance [Hz]."""
        return np.asarray(self.second.frequency * (np.sqrt(1 + self.felt.real) - 1))

    @cached_property
    def second_answer(self) -> Array:
        """Drive over answer of the second mode at its free resonance, 1/Q2 without a surface (complex)."""
        return np.asarray(self.felt + 1j / self.second.quality_factor)

    @cached_property
    def second_amplitude(self) -> Array:
        """Amplitude of the second mode [m]; with frequency modulation a loop holds it."""
        if self.second.detection == "fm":
            return np.where(np.isfinite(self.felt.imag), self.second.free_amplitude, np.nan)
        return np.asarray(self.second.free_amplitude / self.second.quality_factor / np.abs(self.second_answer))

    @property
    def second_phase(self) -> Array:
        """Phase of the second mode [degree]."""
        if self.second.detection == "fm":
            return np.where(np.isfinite(self.felt.imag), 0.0, np.nan)
        return np.degrees(np.pi / 2 - np.angle(self.second_answer))

    @cached_property
    def stiffness_1(self) -> Array:
        """Stiffness <k>1 [N/m] by the instrument's formula, from the first mode."""
        return -2 * self.virial / self.amplitude**2

    @cached_property
    def stiffness_2(self) -> Array:
        """Stiffness <k>2 [N/m] by the instrument's formula, from the second mode."""
        if self.second.detection == "fm":
            return 2 * self.second.stiffness * self.second_shift / self.second.frequency
        return self.second.stiffness * self.felt.real  # (k2/Q2)(A02/A2) sin(phase), the real part of the answer

    @property
    def bimodal_modulus(self) -> Array:
        """Effective modulus by the two modes, for a paraboloid on Hertz contact [Pa]."""
        with np.errstate(all="ignore"):
            root = np.sqrt(self.scope.tip.radius * self.amplitude)
            return self._where_stiffer(np.sqrt(2) * self.stiffness_2**2 / (self.stiffness_1 * root))

    @property
    def bimodal_indentation(self) -> Array:
        """Indentation by the two modes, for a paraboloid on Hertz contact [m]."""
        with np.errstate(all="ignore"):
            return self._where_stiffer(self.amplitude * self.stiffness_1 / self.stiffness_2)

    def _where_stiffer(self, values: Array) -> Array:
        """Values where the surface makes both modes stiffer."""
        return np.where((self.stiffness_1 > 0) & (self.stiffness_2 > 0), values, np.nan)

    @cached_property
    def second_over_depth(self) -> Array:
        """Amplitude of the second mode over the indentation [1]."""
        with np.errstate(all="ignore"):
            share: Array = self.second_amplitude / np.maximum(self.orbit["indentation"], 0.0)
        return share

    @property
    def modulus_bound(self) -> Array:
        """Share of the bimodal modulus that the quadrature leaves out, or infinite: theory, Eq. (errors-6)."""
        stiffer = self.felt.real
        with np.errstate(all="ignore"):
            share = np.sqrt(np.maximum(self.orbit["indentation"], 0.0) / self.amplitude)
            scale = 4 * np.sqrt(2) / 3 / self.lever[col.STIFFNESS]
            by_slope, by_virial = scale * np.abs(self.stiffness_2) * share, scale * self.stiffness_1 / share  # F / k A
            lacking = np.where(share > 0.0, np.maximum(by_slope - by_virial, 0.0), 0.0)
            rest: Array = 0.5 * self.second_over_depth**2 + SIDEBANDS_BEYOND * (by_slope + lacking / 3)
            turns = 2 * self.second.frequency / self.frequency
            stiff, width = turns * np.sqrt(1 + stiffer), 0.5 * turns / self.second.quality_factor
            crossed = np.floor(np.maximum(turns, stiff) + width) != np.floor(np.minimum(turns, stiff) - width)
        return np.where((share > 0.0) & crossed & np.isfinite(stiffer), np.inf, rest)


@dataclass(frozen=True)
class Channel:
    """A derived channel."""

    name: str
    long_name: str
    units: str
    value: Callable[[TipMotion], Array]  # ``value(motion)``, of a `TipMotion`
    source: str  # where the formula is from
    needs: tuple[str, ...] = ()  # variables that the orbit must have; without them there is no such channel
    # The variable that the orbit may have, of which this is a multiple; else it comes from amplitude and phase
    of_orbit: str = ""
    bimodal: bool = False  # whether it is of a second mode that is driven, which the drive must have
    mode: int = 0  # of the lever, that it is of; 0 of none


def motion_seen(
    scope: Microscope, amplitude: Array, phase: Array, orbit: Mapping[str, Array] | None = None
) -> TipMotion:
    """The motion of the tip, from the amplitude [m] and phase [degree] that the detector shows."""
    lever = lever_of(scope)
    size, angle = of_tip(lever, amplitude, np.radians(phase))
    return TipMotion(lever, scope, size, angle, orbit or {})


def is_derived(name: str) -> bool:
    """True if this is a channel that is no variable of an image by itself."""
    return name in CHANNELS and name not in FLOATS


def needs_of(names: Iterable[str]) -> tuple[str, ...]:
    """Variables that these need, themselves where they are no channels."""
    needs: dict[str, None] = {}
    for name in names:
        if not is_derived(name):
            needs[name] = None
            continue
        channel = CHANNELS[name]
        needed = ("phase", "amplitude", *channel.needs, channel.of_orbit)
        needs.update(dict.fromkeys(one for one in needed if one))
    return tuple(needs)


def channel_attributes(channel: Channel, from_orbit: bool) -> dict[str, str]:
    """Long name, units and origin of a channel."""
    return {
        "long_name": channel.long_name, "units": channel.units, "references": channel.source,
        "derived_from": "the orbit" if from_orbit else "amplitude and phase",
    }  # fmt: skip


MELCHER = "Melcher et al., PNAS 106, 13655 (2009)"
LABUDA = "Labuda et al., Beilstein J. Nanotechnol. 7, 970 (2016)"
OF_SECOND = ("mean_gradient", "mean_damping", "sideband_stiffness", "sideband_loss")
CLEVELAND = "Cleveland et al., Appl. Phys. Lett. 72, 2613 (1998)"
PROKSCH = "Proksch and Yablon, Appl. Phys. Lett. 100, 073106 (2012)"


def _of_mode(i: int) -> tuple[Channel, Channel]:
    """Amplitude and phase of mode i, counted from 0."""
    about = f"of mode {i + 1} at the drive frequency"
    return (
        Channel(
            f"modal_amplitude_{i + 1}", f"amplitude at the tip {about}", "m",
            lambda motion: np.abs(motion.deflection(i)), MELCHER, mode=i + 1,
        ),
        Channel(
            f"modal_phase_{i + 1}", f"phase {about}, counted as the detector's", "degree",
            lambda motion: np.angle(motion.deflection(i), deg=True), MELCHER, mode=i + 1,
        ),
    )  # fmt: skip


def _bimodal(
    name: str, long_name: str, units: str, value: str, source: str = LABUDA, needs: tuple[str, ...] = OF_SECOND
) -> Channel:
    """A channel of a second mode that is driven; `value` is a property of `TipMotion`."""
    return Channel(name, long_name, units, attrgetter(value), source, needs, bimodal=True)


CHANNELS: dict[str, Channel] = {
    channel.name: channel
    for channel in (
        Channel("dissipation", "energy dissipated in the surface per cycle", "J", attrgetter("orbit_dissipation"),
                CLEVELAND, of_orbit="dissipation"),
        Channel("dissipation_ev", "energy dissipated in the surface per cycle", "eV",
                lambda motion: motion.orbit_dissipation / ELECTRONVOLT, CLEVELAND, of_orbit="dissipation"),
        Channel("dissipated_power", "power dissipated in the surface", "W",
                lambda motion: motion.orbit_dissipation * motion.frequency, CLEVELAND, of_orbit="dissipation"),
        Channel("virial", "virial of the tip-surface force, positive attractive", "J", attrgetter("orbit_virial"),
                "San Paulo and Garcia, Phys. Rev. B 64, 193411 (2001)", of_orbit="virial"),
        Channel("loss_tangent", "loss tangent by the instrument's formula", "1", attrgetter("loss_tangent"),
                f"{PROKSCH}: energy dissipated over 2 pi times the virial, negative where the force attracts"),
        Channel(
            "loss_tangent_corrected", "loss tangent corrected for adhesion", "1", attrgetter("corrected_loss_tangent"),
            f"{PROKSCH}, with the energy that the contact stores for the virial, and less the energy of necks",
            needs=("contact_storage", "adhesion_loss"), of_orbit="dissipation",
        ),
        Channel("drive_energy", "energy supplied by the drive per cycle", "J",
                lambda motion: drive_energy(motion.lever, motion.amplitude, motion.phase), MELCHER),
        *(channel for i in range(col.MOST_MODES) for channel in _of_mode(i)),
        _bimodal("mode2_frequency_shift", "shift of the second mode's resonance", "Hz", "second_shift"),
        _bimodal("mode2_amplitude", "amplitude of the second mode", "m", "second_amplitude"),
        _bimodal("mode2_phase", "phase of the second mode, 0 where free", "degree", "second_phase"),
        _bimodal(
            "effective_stiffness_1", "effective stiffness of the surface, of the first mode", "N m-1", "stiffness_1",
            needs=(),
        ),
        _bimodal(
            "effective_stiffness_2", "effective stiffness of the surface, of the second mode", "N m-1", "stiffness_2"
        ),
        _bimodal(
            "bimodal_modulus", "plane-strain modulus by the bimodal formula for a paraboloid on Hertz contact", "Pa",
            "bimodal_modulus",
        ),
        _bimodal("bimodal_indentation", "indentation by the bimodal formula", "m", "bimodal_indentation"),
        _bimodal("mode2_over_depth", "amplitude of the second mode over the indentation", "1", "second_over_depth",
                 "the others of the second mode hold where this is small", (*OF_SECOND, "indentation")),
        _bimodal(
            "bimodal_modulus_bound", "largest share by which the bimodal modulus differs from two modes in time", "1",
            "modulus_bound", "half the square of mode2_over_depth, and 0.3 times the largest force of contact over k A",
            (*OF_SECOND, "indentation"),
        ),
    )
}  # fmt: skip
"""Channels by their names."""
OF_SECOND_MODE = {"fm": ("mode2_frequency_shift",), "am": ("mode2_amplitude", "mode2_phase")}
"""Channels that an instrument shows of a second mode, by its detection."""
