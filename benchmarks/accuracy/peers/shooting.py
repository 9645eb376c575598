"""Shooting with Newton's method around any integrator; plain enough for numba to compile it for those who can call it.

The unknowns are z, z' and the tip offset z0 where the tip is farthest away; all lengths over the setpoint amplitude.
Arrays are filled element by element, and three equations are solved by Cramer's rule: numba compiles that in a second,
and what whole arrays and LAPACK need in five.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.accuracy.equation import Equation

Array = np.ndarray
Period = Callable[[Array, Array, float], Array]
"""Takes (z, z', z0), the constants and a tolerance; gives z, z' and the first harmonic's cosine and sine part."""
Shoot = Callable[[Array, Array], Array]
"""Takes constants and a start (z, z', z0); gives (tip offset, phase [rad], 1 if it converged)."""

# Places among the constants.
OMEGA, ALPHA0, BASE, STIFF, PULL, REACH, INVERSE, LOSS, BEGIN = range(9)

MOST_ITERATIONS = 25


def constants(equation: Equation, phase: float) -> Array:
    """Constants of an equation whose orbit has about this phase [rad].

    Raises ValueError if the damping exponent is not 1/2, the only one the peers' right-hand sides know.
    """
    if equation.exponent != 0.5:
        raise ValueError("peers know the damping exponent 1/2 only")
    far = equation.decay > 0
    begin = (0.5 * math.pi - phase - math.pi) / equation.omega
    return np.array(
        [
            equation.omega, equation.alpha0, equation.base, equation.stiff, equation.pull,
            equation.pull if far else 0.0, 1 / equation.decay if far else 0.0, equation.loss, begin,
        ]
    )  # fmt: skip


def acceleration(time: float, z: float, v: float, z0: float, p: Any) -> float:
    """z'' of Wang (1999), Eqs. 1-4, one formula for contact and flight, as integrators without events need it."""
    d = z - z0
    drive = p[BASE] * math.cos(p[OMEGA] * time) - z
    if d >= 0:
        root = math.sqrt(d)
        return float(drive - 2 * (p[ALPHA0] + p[LOSS] * root) * v - p[STIFF] * d * root + p[PULL])
    nearness = 1 - d * p[INVERSE]
    return float(drive - 2 * p[ALPHA0] * v + p[REACH] / (nearness * nearness))


def shoot(period: Period, p: Array, start: Array, tolerance: float) -> Array:
    """Find the orbit of setpoint amplitude 1 near a start.

    Newton's method, damped until the orbit nearly closes; the Jacobian, by forward differences, is kept while the
    residual shrinks fivefold. The last step is not checked by another integration.

    `period`: see `Period`.
    `p` (shape (9,)): see `constants`.
    `start` (shape (3,)): (z, z', z0) at time p[BEGIN].
    Returns an array of shape (3,): tip offset, phase [rad], and 1 where it converged, 0 where not.
    """

    def volume(a: Array, b: Array, c: Array) -> float:
        first, second = b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2]
        return float(a[0] * first + a[1] * second + a[2] * (b[0] * c[1] - b[1] * c[0]))

    x = start.copy()
    if p[ALPHA0] > 0.02:  # where the lever forgets quickly, a few periods bring the higher harmonics
        for _ in range(4):
            end = period(x, p, max(tolerance, 1e-6))
            x[0], x[1] = end[0], end[1]
    width = max(1e-3 * abs(x[2] + x[0]) + (1e-3 / p[INVERSE] if p[INVERSE] > 0 else 0.0), 100 * tolerance, 1e-6)
    end = period(x, p, tolerance)
    columns, system = np.empty((3, 4)), np.empty((3, 3))  # a row for each unknown
    residual, step = np.empty(3), np.empty(3)
    fresh, known = False, False
    for _ in range(MOST_ITERATIONS):
        amplitude = math.hypot(end[2], end[3])
        residual[0], residual[1], residual[2] = end[0] - x[0], end[1] - x[1], amplitude - 1
        size = math.sqrt(residual[0] ** 2 + residual[1] ** 2 + residual[2] ** 2)
        if not size < 1e3:
            break
        if not known:
            for i in range(3):
                beside = x.copy()
                beside[i] += width
                after = period(beside, p, tolerance)
                for j in range(4):
                    columns[i, j] = (after[j] - end[j]) / width
            fresh, known = True, True
        for i in range(3):
            system[i, 0], system[i, 1] = columns[i, 0], columns[i, 1]
            system[i, 2] = (end[2] * columns[i, 2] + end[3] * columns[i, 3]) / amplitude
        system[0, 0] -= 1
        system[1, 1] -= 1
        whole = -volume(system[0], system[1], system[2])
        step[0] = volume(residual, system[1], system[2]) / whole
        step[1] = volume(system[0], residual, system[2]) / whole
        step[2] = volume(system[0], system[1], residual) / whole
        if size < 30 * tolerance:
            for i in range(3):
                end[2] += columns[i, 2] * step[i]
                end[3] += columns[i, 3] * step[i]
            return np.array([x[2] + step[2], 0.5 * math.pi - math.atan2(end[3], end[2]), 1.0])
        taken = min(1.0, 0.2 / max(abs(step[0]), abs(step[1]), abs(step[2])))
        while True:
            new = x.copy()
            for i in range(3):
                new[i] += taken * step[i]
            after = period(new, p, tolerance)
            left = math.sqrt((after[0] - new[0]) ** 2 + (after[1] - new[1]) ** 2
                             + (math.hypot(after[2], after[3]) - 1) ** 2)  # fmt: skip
            if left < size or not fresh or taken < 1e-2:
                break
            taken *= 0.5
        if left < size:
            x, end, known = new, after, left < 0.2 * size
            fresh = False
        elif not fresh:
            known = False
        elif size < 1000 * tolerance:  # as near as the integrator's noise lets it come
            return np.array([x[2], 0.5 * math.pi - math.atan2(end[3], end[2]), 1.0])
        else:
            break
    return np.array([math.nan, math.nan, 0.0])
