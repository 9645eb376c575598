"""From the motion of the tip to what the detector sees of it, and back.

Z is the complex amplitude of z = Re(Z exp(i omega tau)). A detector of the deflection sees Z less what the lever's base
moves, b; its phase is turned so that it is 0 at free resonance. Where the drive's force acts on the tip b is 0. Solvers
know z; `phasemap.solvers.detected_setpoint` finds the orbits at which the detector shows the setpoint.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels import columns as col

Array = NDArray[np.float64]

DETECTED = {
    "direct": "position of the tip: the drive's force acts on it",
    "base": "deflection of the lever: position of the tip minus that of the base, which the drive moves",
}
"""What amplitude, phase and setpoint are of, by excitation."""


def show(lever: Array, amplitude: Any, phase: Any) -> tuple[Array, Array]:
    """What the detector sees of a first harmonic of z.

    `lever` (shape (..., 5)): as of `phasemap.experiment.lever.lever_of`.
    `amplitude`, `phase`: of z [m, rad].
    Returns `amplitude, phase`: [m, rad], 0 at free resonance.

    Examples
    --------
    >>> lever = np.array([1.0, 0.5 / 3, 1.0, 1e-9, 1e-9])  # Q is 3, the base moves by 1 nm
    >>> amplitude, phase = show(lever, 3e-9, 0.0)  # of the free lever
    >>> bool(np.isclose(amplitude, 10**0.5 * 1e-9)), bool(abs(phase) < 1e-15)
    (True, True)
    """
    base = lever[..., col.SHAKER]
    if not np.any(base):
        return np.asarray(amplitude), np.asarray(phase)
    seen = np.asarray(amplitude) * np.exp(1j * np.asarray(phase)) - 1j * base
    return np.abs(seen), np.angle(seen) + np.arctan(2 * lever[..., col.ALPHA0])


def of_tip(lever: Array, amplitude: Any, phase: Any) -> tuple[Array, Array]:
    """The first harmonic of z, from what the detector sees: the inverse of `show`."""
    base = lever[..., col.SHAKER]
    if not np.any(base):
        return np.asarray(amplitude), np.asarray(phase)
    turned = np.asarray(phase) - np.arctan(2 * lever[..., col.ALPHA0])
    tip = np.asarray(amplitude) * np.exp(1j * turned) + 1j * base
    return np.abs(tip), np.angle(tip)


def seen(rows: Array, lever: Array) -> Array:
    """Result rows as the detector sees them: amplitude and phase.

    They are exact for the means of motion that is not periodic too, for the base's motion is constant. Its spreads
    depend on how amplitude and phase vary together: they are left as they are, of what was averaged in time.

    `rows` (shape (..., COLUMNS)): of the tip.
    `lever` (shape (5,) or (..., 5)).
    """
    if not np.any(lever[..., col.SHAKER]):
        return rows
    found, amplitude, phase = rows.copy(), rows[..., col.AMPLITUDE], rows[..., col.PHASE]
    found[..., col.AMPLITUDE], found[..., col.PHASE] = show(lever, amplitude, phase)
    return found
