"""Energies of the lever's first harmonic, and the detector's signal; `lever_numbers.lever_of` makes its numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from phasemap._kernels import columns as col
from phasemap._shared.arrays import Array
from phasemap.experiment.lever_numbers import modal_motion


def energy_supplied(lever: Array, amplitude: Array, phase: Array) -> Array:
    """Work of the drive, pi k u0 A cos(phase) [J per cycle], for levers of `lever_of`, shape (..., n)."""
    return np.pi * lever[..., col.STIFFNESS] * lever[..., col.DRIVE] * amplitude * np.cos(phase)


def drive_energy(lever: Array, amplitude: Array, phase: Array) -> Array:
    """Work of the drive, by a force on the tip or by the base [J per cycle]: theory, Eq. (lever-9)."""
    motion, force = modal_motion(lever, amplitude, phase)
    _, _, share, pulled, _ = lever[col.MODE :].reshape(-1, col.MODE_NUMBERS).T
    work = lever[col.RIGID] * force.imag - np.tensordot(pulled / share, motion.imag, 1)
    return np.pi * lever[col.STIFFNESS] * work


def lost_in_air(lever: Array, amplitude: Array) -> Array:
    """Loss of the first harmonic by the lever's own damping, pi k kappa'' A^2 [J per cycle].

    kappa is the dynamic stiffness at the tip over k, whose imaginary part is 2 alpha0 omega of one mode. Higher
    harmonics lose a little more, n^2 (A_n / A)^2 of it each.
    """
    return np.pi * lever[..., col.DYNAMIC_LOSS] * lever[..., col.STIFFNESS] * amplitude**2


def virial_of(lever: Array, amplitude: Any, phase: Any) -> Array:
    """Virial of the surface's force in the first harmonic, A^2 k kappa' / 2 - k u0 A sin(phase) / 2 [J].

    Positive for attraction. San Paulo and Garcia, Phys. Rev. B 64, 193411 (2001), at resonance.
    """
    stiff = amplitude * lever[..., col.DYNAMIC_STIFFNESS]
    return 0.5 * lever[..., col.STIFFNESS] * amplitude * (stiff - lever[..., col.DRIVE] * np.sin(phase))


DETECTED = {
    "direct": "position of the tip: the drive's force acts on it",
    "base": "deflection of the lever: position of the tip minus that of the base, which the drive moves",
}
"""Motion whose amplitude and phase are detected, by excitation."""


def sees_tip(lever: Array) -> bool:
    """True if the detector sees the motion of the tip itself."""
    offset, factor = offset_and_factor(lever)
    return not np.any(offset) and bool(np.all(factor == 1))


def in_proportion(lever: Array) -> bool:
    """True if the detector sees the motion of the tip times a number other than 1."""
    return not np.any(offset_and_factor(lever)[0]) and not sees_tip(lever)


def offset_and_factor(lever: Array) -> tuple[Any, Any]:
    """Complex offset [m] and factor [1] of the detector's signal, shape (...)."""
    return (
        lever[..., col.OFFSET_RE] + 1j * lever[..., col.OFFSET_IM],
        lever[..., col.FACTOR_RE] + 1j * lever[..., col.FACTOR_IM],
    )


def detected_signal(lever: Array, amplitude: Any, phase: Any) -> tuple[Array, Array]:
    """Amplitude [m] and phase [rad], 0 at free resonance, that the detector shows of a first harmonic of z."""
    if sees_tip(lever):
        return np.asarray(amplitude), np.asarray(phase)
    offset, factor = offset_and_factor(lever)
    seen = offset + factor * np.asarray(amplitude) * np.exp(1j * np.asarray(phase))
    return np.abs(seen), np.angle(seen)


def tip_seen(lever: Array) -> Array:
    """The lever beside a detector that sees the motion of the tip."""
    other = lever.copy()
    other[..., [col.OFFSET_RE, col.OFFSET_IM, col.FACTOR_IM]] = 0.0
    other[..., col.FACTOR_RE] = 1.0
    return other


def tip_amplitudes(lever: Array, amplitude: Any) -> tuple[Array, Array]:
    """Smallest and largest amplitude A [m] of z that the detector can see with an amplitude [m], at any phase."""
    if sees_tip(lever):
        return np.asarray(amplitude), np.asarray(amplitude)
    offset, factor = offset_and_factor(lever)
    size = np.asarray(amplitude) / np.abs(factor)
    beside = np.abs(offset / factor)
    return np.abs(size - beside), size + beside


def of_tip(lever: Array, amplitude: Any, phase: Any) -> tuple[Array, Array]:
    """First harmonic of z from the detector's signal: the inverse of `detected_signal`."""
    if sees_tip(lever):
        return np.asarray(amplitude), np.asarray(phase)
    offset, factor = offset_and_factor(lever)
    tip = (np.asarray(amplitude) * np.exp(1j * np.asarray(phase)) - offset) / factor
    return np.abs(tip), np.angle(tip)


def rows_as_seen(rows: Array, lever: Array) -> Array:
    """Result rows, shape (..., COLUMNS), as the detector sees them: amplitude and phase.

    They are exact for the means of motion that is not periodic too, for the base's motion is constant. Its spreads
    depend on how amplitude and phase vary together: they are left as they are, of what was averaged in time.
    """
    if sees_tip(lever):
        return rows
    seen, amplitude, phase = rows.copy(), rows[..., col.AMPLITUDE], rows[..., col.PHASE]
    seen[..., col.AMPLITUDE], seen[..., col.PHASE] = detected_signal(lever, amplitude, phase)
    return seen
