"""From the motion of the tip to what the detector sees of it, and back.

z = Re(-i A exp(i phase) exp(i omega tau)) is the first harmonic of the tip. The lever is linear: what a detector sees
of it is offset + factor A exp(i phase), with two complex numbers of the lever, turned so that its phase is 0 at free
resonance: theory, Eq. (lever-5). Where the drive's force acts on the tip the offset is 0. Solvers know z;
`phasemap.solvers.detected_setpoint` finds the orbits at which the detector shows the setpoint.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from phasemap._kernels import columns as col
from phasemap._shared.arrays import Array

DETECTED = {
    "direct": "position of the tip: the drive's force acts on it",
    "base": "deflection of the lever: position of the tip minus that of the base, which the drive moves",
}
"""What amplitude, phase and setpoint are of, by excitation."""


def sees_tip(lever: Array) -> bool:
    """Whether the detector sees the motion of the tip itself."""
    offset, factor = offset_and_factor(lever)
    return not np.any(offset) and bool(np.all(factor == 1))


def in_proportion(lever: Array) -> bool:
    """Whether the detector sees the motion of the tip times a number that is not one."""
    return not np.any(offset_and_factor(lever)[0]) and not sees_tip(lever)


def offset_and_factor(lever: Array) -> tuple[Any, Any]:
    """The complex offset [m] and factor [1] of what the detector sees, shape (...)."""
    return (
        lever[..., col.OFFSET_RE] + 1j * lever[..., col.OFFSET_IM],
        lever[..., col.FACTOR_RE] + 1j * lever[..., col.FACTOR_IM],
    )


def show(lever: Array, amplitude: Any, phase: Any) -> tuple[Array, Array]:
    """What the detector sees of a first harmonic of z: amplitude [m] and phase [rad], 0 at free resonance.

    `lever` (shape (..., n)): as of `phasemap.experiment.lever.lever_of`.
    """
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


def amplitude_at(lever: Array, amplitude: Array, phase: Array) -> Array:
    """The larger A [m] that the detector sees with an amplitude if the phase of z is this; NaN without one."""
    offset, factor = offset_and_factor(lever)
    beside, size = offset / factor * np.exp(-1j * phase), amplitude / np.abs(factor)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt(size**2 - beside.imag**2) - beside.real)


def of_tip(lever: Array, amplitude: Any, phase: Any) -> tuple[Array, Array]:
    """The first harmonic of z, from what the detector sees: the inverse of `show`."""
    if sees_tip(lever):
        return np.asarray(amplitude), np.asarray(phase)
    offset, factor = offset_and_factor(lever)
    tip = (np.asarray(amplitude) * np.exp(1j * np.asarray(phase)) - offset) / factor
    return np.abs(tip), np.angle(tip)


def seen(rows: Array, lever: Array) -> Array:
    """Result rows, shape (..., COLUMNS), as the detector sees them: amplitude and phase.

    They are exact for the means of motion that is not periodic too, for the base's motion is constant. Its spreads
    depend on how amplitude and phase vary together: they are left as they are, of what was averaged in time.
    """
    if sees_tip(lever):
        return rows
    found, amplitude, phase = rows.copy(), rows[..., col.AMPLITUDE], rows[..., col.PHASE]
    found[..., col.AMPLITUDE], found[..., col.PHASE] = show(lever, amplitude, phase)
    return found
