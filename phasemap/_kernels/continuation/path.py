"""What stays fixed along a curve of periodic orbits, and what moves.

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
    EQUALS,
    NORMAL_A,
    NORMAL_M,
    NORMAL_Z,
    along,
    along_swept,
    close,
    close_swept,
)
from phasemap._kernels.orbits.collocation.contacts import find_contacts
from phasemap._kernels.orbits.collocation.elements import carry_over, lay, nudge
from phasemap._kernels.orbits.collocation.newton import contact_size, stillness, take
from phasemap._kernels.orbits.collocation.system import (
    COUNT,
    HOLD_PLANE,
    KEPT,
    LINEAR,
    SMALL,
    STANDING,
    VALUE,
    Z0,
    A,
    M,
    Orbit,
    linearise,
    no_drift,
)

FIXED, HELD_OFFSET, HELD_AMPLITUDE = -1, 0, 1  # kinds of paths: nothing but z0 and A moves, or what a sweep of m holds
LEVER, HELD = col.ROW, STANDING  # rows of a sweep's table: the law's parameters, the lever, what is held
# Entries of a point of the curve: z0, A, m, P and S, the amplitude that the detector sees, their derivatives along the
# curve (of the last one with the lever as it is), its unit tangent in the scaled coordinates, the largest Floquet
# multiplier, det(1 - monodromy), the length of the step that led there.
ZP, AP, MP, PP, SP, VP, DZ, DA, DM, DP, DS, DV = 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11
TU, TV, FP, DET, LENGTH, POINT = 12, 13, 14, 15, 16, 17
RATE = 6  # from a value to its derivative
STILL = 1e-2  # of the last change allowed on the way: the tangent is off by as little of it
SAME = 1e-6  # of the contact; so much tangent and multipliers of an exact orbit may be off


class Path(NamedTuple):
    """A curve's law and lever, and what its orbits are solved with."""

    law: Law
    tables: np.ndarray  # of `phasemap._kernels.quadrature`
    kind: int  # FIXED, HELD_OFFSET or HELD_AMPLITUDE
    # p, lever, reach: on a fixed path: parameters of the law, lever, length [m] on which orbits change
    p: tuple[float, ...]
    lever: np.ndarray
    reach: float
    # shape (HELD + 1, n); Elsewhere: Chebyshev coefficients over m of the law's parameters, the lever, and the
    # tip offset or amplitude [m] that is held
    table: np.ndarray
    width: float  # a small change of m


@kernel
def fixed(oscillator: Oscillator, tables: np.ndarray) -> Path:
    """Return the path on which only tip offset and amplitude move."""
    law, p, lever = oscillator
    reach = scale_of(oscillator, free_amplitude(lever))
    return Path(law, tables, FIXED, p, lever, reach, np.empty((0, 0)), 0.0)


@kernel(light=True)
def swept(law: Law, tables: np.ndarray, table: np.ndarray, kind: int, width: float) -> Path:
    """Return the path on which m moves what the table says."""
    p, lever = at(table, 0.0)
    return Path(law, tables, kind, p, lever, math.nan, table, width)


@kernel(light=True)
def chebyshev(coefficients: np.ndarray, m: float) -> float:
    """Value of a Chebyshev series (Clenshaw)."""
    one, two = 0.0, 0.0
    for k in range(len(coefficients) - 1, 0, -1):
        one, two = coefficients[k] + 2.0 * m * one - two, one
    return coefficients[0] + m * one - two


@kernel(light=True)
def at(table: np.ndarray, m: float) -> tuple[tuple[float, ...], np.ndarray]:
    """The law's parameters and the lever at m."""
    values = np.empty(STANDING)
    for i in range(STANDING):
        values[i] = chebyshev(table[i], m)
    return parameters(values), values[LEVER:HELD]


@kernel(light=True)
def standing_at(path: Path, m: float) -> tuple[tuple[float, ...], np.ndarray]:
    """The law's parameters and the lever, which on a swept path depend on m."""
    return (path.p, path.lever) if path.kind == FIXED else at(path.table, m)


@kernel
def drift_at(path: Path, m: float) -> np.ndarray:
    """How they drift with m, as `system` takes it."""
    if path.kind == FIXED:
        return no_drift()
    drift = np.empty((2, STANDING))
    for i in range(STANDING):
        drift[0, i], drift[1, i] = chebyshev(path.table[i], m + SMALL), chebyshev(path.table[i], m - SMALL)
    return drift


@kernel(light=True)
def held_at(path: Path, m: float) -> float:
    """The tip offset or amplitude [m] that is held at m."""
    return chebyshev(path.table[HELD], m)


@kernel
def put_row(row: np.ndarray, normal: tuple[float, float, float], right: float) -> None:
    """Write the equation normal (z0, A, m) = right as `close_swept` reads it."""
    row[NORMAL_Z], row[NORMAL_A], row[NORMAL_M] = normal
    row[EQUALS] = right


@kernel
def held_row(path: Path, m: float, row: np.ndarray) -> None:
    """Equation of what is held, linearised at m: r (z0, A, m) = h."""
    value = held_at(path, m)
    rate = (held_at(path, m + SMALL) - held_at(path, m - SMALL)) / (2.0 * SMALL)
    held_amplitude = path.kind == HELD_AMPLITUDE
    put_row(row, (0.0, 1.0, -rate) if held_amplitude else (1.0, 0.0, -rate), value - rate * m)


@kernel
def gap_scale(reach: float, z0: float, amplitude: float) -> float:
    """Natural length of the gap z0 - A at a point of the curve."""
    return 0.5 * reach + 0.25 * abs(z0 - amplitude)


@kernel
def control(path: Path) -> int:
    """Which entry of a point is swept: the tip offset or m."""
    return ZP if path.kind == FIXED else MP


@kernel
def answer(path: Path) -> int:
    """The other entry that moves: the amplitude, or the tip offset where the amplitude is held."""
    return ZP if path.kind == HELD_AMPLITUDE else AP


@kernel
def scales(path: Path, reach: float, z0: float, amplitude: float) -> tuple[float, float]:
    """Natural lengths of the two coordinates: theory, Eqs. (continuation-1) and (continuation-6)."""
    gap = gap_scale(reach, z0, amplitude)
    if path.kind == FIXED:
        return gap, 0.2 * amplitude
    return path.width, gap if path.kind == HELD_AMPLITUDE else min(gap, 0.2 * amplitude)


@kernel
def row_of(path: Path, reach: float, point: np.ndarray) -> tuple[float, float, float]:
    """The tangent as a row for (dz0, dA, dm), made from the scaled coordinates."""
    u, v = scales(path, reach, point[ZP], point[AP])
    other = point[TV] * u / v
    if path.kind == FIXED:
        return point[TU], other - point[TU], 0.0
    return (other, 0.0, point[TU]) if path.kind == HELD_AMPLITUDE else (0.0, other, point[TU])


@kernel
def unit(path: Path, reach: float, point: np.ndarray, dz: float, da: float, dm: float) -> tuple[float, float]:
    """The scaled coordinates of a direction."""
    u, v = scales(path, reach, point[ZP], point[AP])
    if path.kind == FIXED:
        return (dz - da) / u, da / v
    return dm / u, (dz if path.kind == HELD_AMPLITUDE else da) / v


@kernel
def reach_on(path: Path, orbit: Orbit) -> float:
    """Length [m] on which orbits change, where this one is."""
    if path.kind == FIXED:
        return path.reach
    p, lever = at(path.table, orbit.head[VALUE, M])
    return scale_of(Oscillator(path.law, p, lever), free_amplitude(lever))


@kernel(shared=True)
def solve_on(
    path: Path, orbit: Orbit, spare: Orbit, row: tuple[float, float, float], level: int,
    tolerance: float, most: int, coarse: bool,
) -> tuple[int, int, Orbit, Orbit]:  # fmt: skip
    """Newton's method on the plane row (z0, A, m) = const through where the orbit now is; `coarse` on the way only.

    The equations of the last step stand for those of the orbit where it changed nothing any more: by less than SAME of
    the contact and the tolerance of an exact orbit, or, on the way, than STILL of the tolerance there.
    """
    law, tables, value = path.law, path.tables, orbit.head[VALUE]
    r_z, r_a, r_m = row
    through, holds = np.array([r_z, r_a, value[Z0], value[A]]), np.zeros((2, 4))
    put_row(holds[1], row, r_z * value[Z0] + r_a * value[A] + r_m * value[M])
    p, lever = standing_at(path, value[M])
    still = stillness(Oscillator(law, p, lever), level)
    smooth = stillness(Oscillator(law, p, lever), 0) > 0.0
    for steps in range(most):
        m = orbit.head[VALUE, M]
        p, lever = standing_at(path, m)
        drift = drift_at(path, m)
        if orbit.head[COUNT, LINEAR] != 1.0 and not linearise(Oscillator(law, p, lever), tables, orbit, drift):
            return col.NOT_CONVERGED, steps, orbit, spare
        if path.kind == FIXED:
            solved = close(lever, orbit, HOLD_PLANE, through)
        else:
            held_row(path, m, holds[0])
            solved = close_swept(lever, orbit, drift, holds)
        if not solved:
            return col.NOT_CONVERGED, steps + 1, orbit, spare
        status, change = take(tables, lever, orbit, tolerance, coarse)
        size = contact_size(orbit.head, reach_of(law, p))
        if status != col.PENDING:
            if status == col.GOOD and change <= (STILL * tolerance if coarse else min(tolerance, SAME * size)):
                orbit.head[COUNT, LINEAR] = KEPT
            return status, steps + 1, orbit, spare
        if change < still * size:
            continue  # the elements fit as they lie
        if smooth and nudge(p, tables, orbit):
            continue
        if not find_contacts(p, tables, orbit) or not lay(Oscillator(law, p, lever), tables, spare, orbit, level):
            return col.TOO_MANY_CONTACTS, steps + 1, orbit, spare
        carry_over(tables, orbit, spare)
        orbit, spare = spare, orbit
    return col.NOT_CONVERGED, most, orbit, spare


@kernel
def tangent_on(path: Path, orbit: Orbit, row: tuple[float, float, float]) -> bool:
    """Linearise; leave the derivative along the curve in the system's last column, row (dz0, dA, dm) = 1."""
    m = orbit.head[VALUE, M]
    p, lever = standing_at(path, m)
    drift = drift_at(path, m)
    if orbit.head[COUNT, LINEAR] == 0.0 and not linearise(Oscillator(path.law, p, lever), path.tables, orbit, drift):
        return False
    if path.kind == FIXED:
        r_z, r_a, _ = row
        return along(lever, orbit, r_z, r_a)
    holds = np.zeros((2, 4))
    held_row(path, m, holds[0])
    put_row(holds[1], row, 0.0)
    return along_swept(lever, orbit, drift, holds)
