"""Paths of continuation: how the law and the lever change along a curve of periodic orbits, and what is held.

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
from phasemap._kernels.law import Law, Oscillator, parameters
from phasemap._kernels.lever import free_amplitude, reach_of, scale_of
from phasemap._kernels.orbits.collocation.closing import (
    curve_derivative,
    solve_step,
)
from phasemap._kernels.orbits.collocation.elements import lay_again, move_elements
from phasemap._kernels.orbits.collocation.linearised import linearise_orbit
from phasemap._kernels.orbits.collocation.newton import allowed_displacement, contact_size, take_step
from phasemap._kernels.orbits.collocation.system import (
    DRIFT_STEP,
    EQUATIONS_CURRENT,
    EQUATIONS_KEPT,
    EQUATIONS_OTHER,
    Equation,
    Orbit,
    head_of,
    no_drift,
)
from phasemap._kernels.records import column, record

# Kinds of paths.
FIXED_PATH = -1  # nothing but z0 and A moves
HELD_OFFSET = 0  # a sweep of m holds the tip offset
HELD_AMPLITUDE = 1
# Rows of a sweep's table: the law's parameters, the lever, and what is held.
LEVER_ROW = col.ROW
HELD_ROW = -1
# Entries of the values and rates of a point: what is swept, wanted or held is told by its entry.
ENTRY_Z0 = 0
ENTRY_A = 1
ENTRY_M = 2
ENTRY_P = 3
ENTRY_S = 4
ENTRY_SEEN = 5  # the amplitude that the detector sees
STILL_ON_THE_WAY = 1e-2  # of the last change allowed on the way: the tangent is off by as little of it
TANGENT_ERROR = 1e-6  # of the contact; so much tangent and multipliers of an exact orbit may be off


@record
class Point:
    """A point of the curve: what its orbit is, and how the curve goes on there."""

    value: np.ndarray = column(6)  # z0, A [m], m, P, S, the amplitude that the detector sees [m]
    rate: np.ndarray = column(6)  # their derivatives along the curve; of the last one with the lever as it is
    tangent_u: float  # unit tangent in the scaled coordinates: of the control
    tangent_v: float  # and of the answer
    floquet: float  # largest modulus of a Floquet multiplier
    determinant: float  # det(1 - monodromy)
    length: float  # of the step that led there


class Path(NamedTuple):
    """A curve's law and lever, and what its orbits are solved with."""

    law: Law
    kind: int  # FIXED, HELD_OFFSET or HELD_AMPLITUDE
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
    reach = scale_of(oscillator, free_amplitude(lever))
    return Path(law, FIXED_PATH, p, lever, reach, np.empty((0, 0)), 0.0)


@kernel(light=True)
def swept_path(law: Law, table: np.ndarray, kind: int, width: float) -> Path:
    """Return the path on which m moves what the table says."""
    p, lever = material_at(table, 0.0)
    return Path(law, kind, p, lever, math.nan, table, width)


@kernel(light=True)
def chebyshev(coefficients: np.ndarray, m: float) -> float:
    """Value of a Chebyshev series (Clenshaw)."""
    one, two = 0.0, 0.0
    for k in range(len(coefficients) - 1, 0, -1):
        one, two = coefficients[k] + 2.0 * m * one - two, one
    return coefficients[0] + m * one - two


@kernel(light=True)
def material_at(table: np.ndarray, m: float) -> tuple[tuple[float, ...], np.ndarray]:
    """The law's parameters and the lever at m."""
    values = np.empty(len(table) - 1)
    for i in range(len(values)):
        values[i] = chebyshev(table[i], m)
    return parameters(values), values[LEVER_ROW:]


@kernel(light=True)
def standing_at(path: Path, m: float) -> Oscillator:
    """The lever over the material at m."""
    if path.kind == FIXED_PATH:
        return Oscillator(path.law, path.p, path.lever)
    p, lever = material_at(path.table, m)
    return Oscillator(path.law, p, lever)


@kernel
def drift_at(path: Path, m: float) -> np.ndarray:
    """The law's parameters and the lever beside m, shape (2, ROW + len(lever)): their differences are the drift."""
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
def held_equation(path: Path, m: float) -> Equation:
    """Equation of what is held, linearised at m: of a fixed path, m itself."""
    if path.kind == FIXED_PATH:
        return Equation(0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    value = held_value(path, m)
    rate = (held_value(path, m + DRIFT_STEP) - held_value(path, m - DRIFT_STEP)) / (2.0 * DRIFT_STEP)
    if path.kind == HELD_AMPLITUDE:
        return Equation(0.0, 1.0, -rate, value - rate * m, 0.0, 0.0)
    return Equation(1.0, 0.0, -rate, value - rate * m, 0.0, 0.0)


@kernel
def gap_scale(reach: float, z0: float, amplitude: float) -> float:
    """Natural length of the gap z0 - A at a point of the curve."""
    return 0.5 * reach + 0.25 * abs(z0 - amplitude)


@kernel
def control_entry(path: Path) -> int:
    """Entry of a point that is swept: the tip offset or m."""
    return ENTRY_Z0 if path.kind == FIXED_PATH else ENTRY_M


@kernel
def answer_entry(path: Path) -> int:
    """The other entry that moves: the amplitude, or the tip offset where the amplitude is held."""
    return ENTRY_Z0 if path.kind == HELD_AMPLITUDE else ENTRY_A


@kernel
def scales(path: Path, reach: float, z0: float, amplitude: float) -> tuple[float, float]:
    """Natural lengths of the two coordinates: theory, Eqs. (continuation-1) and (continuation-6)."""
    gap = gap_scale(reach, z0, amplitude)
    if path.kind == FIXED_PATH:
        return gap, 0.2 * amplitude
    return path.width, gap if path.kind == HELD_AMPLITUDE else min(gap, 0.2 * amplitude)


@kernel
def tangent_row(path: Path, reach: float, point: Point) -> tuple[float, float, float]:
    """The tangent as a row for (dz0, dA, dm), made from the scaled coordinates."""
    u, v = scales(path, reach, point.value[ENTRY_Z0], point.value[ENTRY_A])
    other = point.tangent_v * u / v
    if path.kind == FIXED_PATH:
        return point.tangent_u, other - point.tangent_u, 0.0
    return (other, 0.0, point.tangent_u) if path.kind == HELD_AMPLITUDE else (0.0, other, point.tangent_u)


@kernel
def scaled_direction(path: Path, reach: float, point: Point, dz: float, da: float, dm: float) -> tuple[float, float]:
    """Components of a direction in the scaled coordinates."""
    u, v = scales(path, reach, point.value[ENTRY_Z0], point.value[ENTRY_A])
    if path.kind == FIXED_PATH:
        return (dz - da) / u, da / v
    return dm / u, (dz if path.kind == HELD_AMPLITUDE else da) / v


@kernel
def reach_on(path: Path, orbit: Orbit) -> float:
    """Length [m] on which orbits change, where this one is."""
    if path.kind == FIXED_PATH:
        return path.reach
    oscillator = standing_at(path, head_of(orbit).parameter)
    return scale_of(oscillator, free_amplitude(oscillator.lever))


@kernel(shared=True)
def solve_on(
    path: Path, orbit: Orbit, row: tuple[float, float, float], tolerance: float, most: int, coarse: bool,
) -> tuple[int, int]:  # fmt: skip
    """Newton's method on the plane row (z0, A, m) = const through where the orbit now is; `coarse` on the way only.

    The equations of the last step stand for those of the orbit where it changed nothing any more: by less than
    TANGENT_ERROR of the contact and the tolerance of an exact orbit, or, on the way, than STILL_ON_THE_WAY of that.
    """
    head = head_of(orbit)
    r_z, r_a, r_m = row
    at = r_z * head.tip_offset + r_a * head.amplitude + r_m * head.parameter
    across = Equation(r_z, r_a, r_m, at, 0.0, 0.0)
    oscillator, level = standing_at(path, head.parameter), head.level
    still, smooth = allowed_displacement(oscillator, level), allowed_displacement(oscillator, 0) > 0.0
    for steps in range(most):
        m = head.parameter
        oscillator, drift = standing_at(path, m), drift_at(path, m)
        if head.equations != EQUATIONS_CURRENT and not linearise_orbit(oscillator, orbit, drift):
            return col.NOT_CONVERGED, steps
        if not solve_step(oscillator.lever, orbit, drift, (held_equation(path, m), across)):
            return col.NOT_CONVERGED, steps + 1
        status, change = take_step(oscillator.lever, orbit, tolerance, coarse)
        size = contact_size(head, reach_of(path.law, oscillator.p))
        if status != col.PENDING:
            if status == col.GOOD and change <= (
                STILL_ON_THE_WAY * tolerance if coarse else min(tolerance, TANGENT_ERROR * size)
            ):
                head.equations = EQUATIONS_KEPT
            return status, steps + 1
        if change < still * size:
            continue  # the elements fit as they lie
        if smooth and move_elements(oscillator.p, orbit):
            continue
        if not lay_again(oscillator, orbit, level):
            return col.TOO_MANY_CONTACTS, steps + 1
    return col.NOT_CONVERGED, most


@kernel
def tangent_on(path: Path, orbit: Orbit, row: tuple[float, float, float]) -> bool:
    """Linearise; leave the derivative along the curve in the system's last column, row (dz0, dA, dm) = 1."""
    m = head_of(orbit).parameter
    oscillator, drift = standing_at(path, m), drift_at(path, m)
    if head_of(orbit).equations == EQUATIONS_OTHER and not linearise_orbit(oscillator, orbit, drift):
        return False
    across = Equation(row[0], row[1], row[2], 0.0, 0.0, 0.0)
    return curve_derivative(oscillator.lever, orbit, drift, (held_equation(path, m), across))
