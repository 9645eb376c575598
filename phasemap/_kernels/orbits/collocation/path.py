"""Dependence of law and lever on the parameter of a curve of periodic orbits, and what is held.

A curve of orbits is followed in a plane of two of three numbers: tip offset z0, amplitude A, and m in [-1, 1], on which
the law's parameters and the lever may depend. Either everything but z0 and A is fixed, or m is swept and z0 (a
response at a fixed tip offset) or A (what a feedback holds) is given as a function of m.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.excitation import detected_amplitude_of_orbit
from phasemap._kernels.law import Law, Oscillator, parameters
from phasemap._kernels.lever import scale_of
from phasemap._kernels.orbits.collocation.held_equation import Equation, hold_detected_setpoint
from phasemap._kernels.orbits.collocation.system import DRIFT_STEP, Orbit, head_of, no_drift

# Kinds of paths.
FIXED_PATH = -1  # nothing but z0 and A moves
HELD_OFFSET = 0  # a sweep of m holds the tip offset
HELD_AMPLITUDE = 1
# Rows of a sweep's table: the law's parameters, the lever, and what is held.
LEVER_ROW = col.ROW
HELD_ROW = -1


class Path(NamedTuple):
    """Law and lever along a curve of orbits, and the value held."""

    law: Law
    kind: int  # FIXED_PATH, HELD_OFFSET or HELD_AMPLITUDE
    # p, lever, reach: on a fixed path: parameters of the law, lever, length [m] on which orbits change
    p: tuple[float, ...]
    lever: np.ndarray
    reach: float
    # shape (ROW + len(lever) + 1, n); elsewhere: Chebyshev coefficients over m of the law's parameters, the lever, the
    # tip offset or amplitude [m] that is held
    table: np.ndarray
    width: float  # a small change of m


@kernel
def fixed_path(oscillator: Oscillator) -> Path:
    """Return the path on which only tip offset and amplitude move."""
    law, p, lever = oscillator
    reach = scale_of(oscillator)
    return Path(law, FIXED_PATH, p, lever, reach, np.empty((0, 0)), 0.0)


@kernel(light=True)
def swept_path(law: Law, table: np.ndarray, kind: int, width: float) -> Path:
    """Return the path on which material and lever are Chebyshev series of the parameter m, given in the table."""
    p, lever = material_at(table, 0.0)
    return Path(law, kind, p, lever, math.nan, table, width)


@kernel(light=True)
def chebyshev(coefficients: np.ndarray, m: float) -> float:
    """Value of a Chebyshev series (Clenshaw)."""
    b1, b2 = 0.0, 0.0
    for k in range(len(coefficients) - 1, 0, -1):
        b1, b2 = coefficients[k] + 2.0 * m * b1 - b2, b1
    return coefficients[0] + m * b1 - b2


@kernel(light=True)
def material_at(table: np.ndarray, m: float) -> tuple[tuple[float, ...], np.ndarray]:
    """The law's parameters and the lever at m."""
    values = np.empty(len(table) - 1)
    for i in range(len(values)):
        values[i] = chebyshev(table[i], m)
    return parameters(values), values[LEVER_ROW:]


@kernel(light=True)
def oscillator_at(path: Path, m: float) -> Oscillator:
    """The lever over the material at m."""
    if path.kind == FIXED_PATH:
        return Oscillator(path.law, path.p, path.lever)
    p, lever = material_at(path.table, m)
    return Oscillator(path.law, p, lever)


@kernel
def drift_at(path: Path, m: float) -> np.ndarray:
    """Parameters of law and lever just above and below m, shape (2, ROW + len(lever)): drift is their difference."""
    if path.kind == FIXED_PATH:
        return no_drift()
    drift = np.empty((2, len(path.table) - 1))
    for i in range(drift.shape[1]):
        drift[0, i], drift[1, i] = chebyshev(path.table[i], m + DRIFT_STEP), chebyshev(path.table[i], m - DRIFT_STEP)
    return drift


@kernel(light=True)
def held_value(path: Path, m: float) -> float:
    """The tip offset or amplitude [m] that is held at m."""
    return chebyshev(path.table[HELD_ROW], m)


@kernel
def held_equation(path: Path, lever: np.ndarray, orbit: Orbit, drift: np.ndarray) -> Equation:
    """Linearised equation, at an orbit, of the tip offset or detected amplitude held; of a fixed path, of m itself."""
    if path.kind == FIXED_PATH:
        return Equation(0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    head = head_of(orbit)
    m = head.parameter
    value = held_value(path, m)
    rate = (held_value(path, m + DRIFT_STEP) - held_value(path, m - DRIFT_STEP)) / (2.0 * DRIFT_STEP)
    if path.kind == HELD_OFFSET:
        return Equation(1.0, 0.0, -rate, value - rate * m, 0.0, 0.0)
    harmonic = head.amplitude, head.push, head.drag
    ahead = detected_amplitude_of_orbit(drift[0][LEVER_ROW:], *harmonic)
    behind = detected_amplitude_of_orbit(drift[1][LEVER_ROW:], *harmonic)
    by_m = (ahead - behind) / (2.0 * DRIFT_STEP) - rate
    held = hold_detected_setpoint(lever, orbit, value)
    return Equation(0.0, held.normal_a, by_m, held.equals + by_m * m, held.normal_p, held.normal_s)
