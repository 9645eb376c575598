"""Derived channels: what amplitude and phase, and the orbit where it is known, tell of the surface.

A channel is a name, a unit, a function of the motion of the tip, and the paper that the function is from. To add one,
add an entry to `CHANNELS`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from phasemap.experiment.excitation import of_tip
from phasemap.experiment.lever import lever_of, lost_in_air, supplied, virial_of
from phasemap.experiment.microscope import Microscope

__all__ = ["CHANNELS", "Channel", "Motion", "motion_of"]

Array = NDArray[np.float64]

ELECTRONVOLT = 1.602176634e-19  # [J]
FAINT = 1e-3  # of the virial of repulsion and attraction: what is less is no contact to divide by


@dataclass(frozen=True, eq=False)
class Motion:
    """What is known of the tip's motion in some pixels.

    Parameters
    ----------
    lever : ndarray, shape (5,)
        As of `phasemap.experiment.lever.lever_of`.
    frequency : float
        Of the drive [Hz].
    amplitude, phase : ndarray
        Of the first harmonic of the tip's position [m, rad].
    orbit : mapping of str to ndarray
        Variables of an image, of the same pixels, that were integrated over the orbit; may be empty.
    """

    lever: Array
    frequency: float
    amplitude: Array
    phase: Array
    orbit: Mapping[str, Array] = field(default_factory=dict)

    @property
    def dissipation(self) -> Array:
        """Energy that the surface takes per cycle, as amplitude and phase tell it [J]."""
        left: Array = supplied(self.lever, self.amplitude, self.phase) - lost_in_air(self.lever, self.amplitude)
        return left

    @property
    def virial(self) -> Array:
        """Virial of the surface's force, as amplitude and phase tell it, positive for attraction [J]."""
        return virial_of(self.lever, self.amplitude, self.phase)


@dataclass(frozen=True)
class Channel:
    """A derived channel.

    Parameters
    ----------
    name, long_name, units : str
    value : callable
        ``value(motion)``, of a `Motion`.
    source : str
        Where the formula is from.
    needs : tuple of str
        Variables that the orbit must have; without them there is no such channel.
    of_orbit : str
        The variable that the orbit may have, of which this is a multiple; else it comes from amplitude and phase.
    """

    name: str
    long_name: str
    units: str
    value: Callable[[Motion], Array]
    source: str
    needs: tuple[str, ...] = ()
    of_orbit: str = ""


def motion_of(scope: Microscope, amplitude: Array, phase: Array, orbit: Mapping[str, Array] | None = None) -> Motion:
    """The motion of the tip, from the amplitude [m] and phase [degree] that the detector shows."""
    lever = lever_of(scope)
    size, angle = of_tip(lever, amplitude, np.radians(phase))
    frequency = scope.frequency_ratio * scope.cantilever.resonance_frequency
    return Motion(lever, frequency, size, angle, orbit or {})


def _dissipation(motion: Motion) -> Array:
    return motion.orbit.get("dissipation", motion.dissipation)


def _virial(motion: Motion) -> Array:
    return motion.orbit.get("virial", motion.virial)


def _over(loss: Array, virial: Array, whole: Array) -> Array:
    """Loss over 2 pi times the virial of repulsion, NaN where that is next to nothing."""
    with np.errstate(all="ignore"):
        return np.where(np.abs(virial) > FAINT * np.abs(whole), -loss / (2 * np.pi * virial), np.nan)


def _loss_tangent(motion: Motion) -> Array:
    with np.errstate(all="ignore"):
        tangent: Array = -motion.dissipation / (2 * np.pi * motion.virial)
    return tangent


def _corrected(motion: Motion) -> Array:
    attraction = motion.orbit["adhesion_virial"]
    loss = motion.dissipation - motion.orbit["adhesion_loss"]
    return _over(loss, motion.virial - attraction, np.abs(motion.virial) + np.abs(attraction))


CLEVELAND = "Cleveland et al., Appl. Phys. Lett. 72, 2613 (1998)"
PROKSCH = "Proksch and Yablon, Appl. Phys. Lett. 100, 073106 (2012)"
CHANNELS: dict[str, Channel] = {
    channel.name: channel
    for channel in (
        Channel(
            "dissipation", "energy dissipated in the surface per cycle", "J", _dissipation, CLEVELAND,
            of_orbit="dissipation",
        ),
        Channel(
            "dissipation_ev", "energy dissipated in the surface per cycle", "eV",
            lambda motion: _dissipation(motion) / ELECTRONVOLT, CLEVELAND, of_orbit="dissipation",
        ),
        Channel(
            "dissipated_power", "power dissipated in the surface", "W",
            lambda motion: _dissipation(motion) * motion.frequency, CLEVELAND, of_orbit="dissipation",
        ),
        Channel(
            "virial", "virial of the tip-surface force, positive attractive", "J", _virial,
            "San Paulo and Garcia, Phys. Rev. B 64, 193411 (2001)", of_orbit="virial",
        ),
        Channel(
            "loss_tangent", "loss tangent by the instrument's formula", "1", _loss_tangent,
            f"{PROKSCH}: energy dissipated over 2 pi times the virial, negative where the force attracts",
        ),
        Channel(
            "loss_tangent_corrected", "loss tangent corrected for adhesion", "1", _corrected,
            f"{PROKSCH}, less the virial of the attraction and the energy of necks",
            needs=("adhesion_virial", "adhesion_loss"),
        ),
    )
}  # fmt: skip
"""Every channel by name."""
