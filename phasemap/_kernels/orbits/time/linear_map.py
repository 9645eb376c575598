"""Linear map of a period about a motion: ways to rest, slopes of the periodic orbit, and the largest multiplier.

See theory, Eqs. (time-3) and (time-4).
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels.compilation import kernel
from phasemap._kernels.numerics import MOST_SQUARINGS, eliminate, spectral_radius
from phasemap._kernels.orbits.time.tip import Change, PeriodMap, Way


@kernel
def differentiate(beside: Change, now: Change, size: float) -> None:
    """Turn what a period changes `size` beside a motion into the derivative of that."""
    for i in range(len(beside.motion)):
        beside.motion[i] = (beside.motion[i] - now.motion[i]) / size
    beside.amplitude = (beside.amplitude - now.amplitude) / size


@kernel
def fill_way_of_decay(linear: PeriodMap, change: np.ndarray, way: np.ndarray) -> None:
    """Fill in the way to rest of a motion that changes by r in a period: r + P' r + P' P' r + ... = (1 - P')^-1 r."""
    n = linear.count
    m = np.empty((n, n + 1))
    for i in range(n):
        for j in range(n):
            m[i, j] = -linear.motion[n * j + i]
        m[i, n] = change[i]
    solved = eliminate(m, n)
    for i in range(n):
        way[i] = m[i, n] if solved else math.nan


@kernel
def amplitude_along(linear: PeriodMap, way: np.ndarray) -> float:
    """Change of the amplitude [m] along a way of the coordinates."""
    total = 0.0
    for i in range(linear.count):
        total += linear.amplitude[i] * way[i]
    return total


@kernel
def slopes_of_orbit(linear: PeriodMap, slopes: Way) -> float:
    """Fill in how the periodic orbit moves with z0; returns dA/dz0 after the transient."""
    slopes.z0 = 1.0
    fill_way_of_decay(linear, linear.by_z0.motion, slopes.motion)
    return linear.by_z0.amplitude + amplitude_along(linear, slopes.motion)


@kernel
def amplitude_slope(linear: PeriodMap) -> float:
    """dA/dz0 after the transient."""
    return slopes_of_orbit(linear, Way())


@kernel
def multiplier_of(linear: PeriodMap) -> float:
    """Largest modulus of the Floquet multipliers, the eigenvalues of P'."""
    n = linear.count
    m = np.empty((n, n))
    for i in range(n):
        for j in range(n):
            m[i, j] = linear.motion[n * j + i] + (1.0 if i == j else 0.0)
    return spectral_radius(m, MOST_SQUARINGS)


@kernel
def fill_way_to_rest(linear: PeriodMap, now: Change, target: float, way: Way) -> None:
    """Fill in the way to rest, at this z0 or with a `target` amplitude > 0 at the z0 where that is expected."""
    fill_way_of_decay(linear, now.motion, way.motion)
    way.z0 = 0.0
    if target > 0.0:
        slopes = Way()
        slope = slopes_of_orbit(linear, slopes)
        way.z0 = -(now.amplitude - target + amplitude_along(linear, way.motion)) / slope
        for i in range(linear.count):
            way.motion[i] += slopes.motion[i] * way.z0


@kernel
def length_of(way: Way) -> float:
    """Length [m] of a displacement of the tip's state at the begin of a period, but for the tip offset."""
    total = 0.0
    for i in range(len(way.motion)):
        total += way.motion[i] * way.motion[i]
    return math.sqrt(total)
