"""What stays fixed along a curve of periodic orbits, and what moves.

A curve of orbits is followed in a plane of two of three numbers: tip offset z0, amplitude A, and m in [-1, 1], on which
the law's parameters and the lever may depend. Either everything but z0 and A is `Fixed`, or m is `Swept` and z0 (a
response at a fixed tip offset) or A (what a feedback holds) is given as a function of m.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numba.extending import overload

from phasemap._kernels import columns as col
from phasemap._kernels.law import OPTIONS, Law
from phasemap._kernels.lever import free_amplitude, scale_of
from phasemap._kernels.orbits.collocation.newton import newton, newton_swept
from phasemap._kernels.orbits.collocation.system import (
    HOLD_ARC,
    HOLD_PLANE,
    VALUE,
    Z0,
    A,
    Drift,
    M,
    Orbit,
    along,
    along_swept,
    linearise,
)

HELD_OFFSET, HELD_AMPLITUDE = 0, 1  # what a sweep of m holds
LEVER = col.ROW  # rows of a sweep's table: the law's parameters, the lever, what is held
HELD = LEVER + 5
TABLE_ROWS = HELD + 1
SMALL = 1e-5  # change of m for derivatives
# Entries of a point of the curve: z0, A, m, P and S, the amplitude that the detector sees, their derivatives along the
# curve (of the last one with the lever as it is), its unit tangent in the scaled coordinates, the largest Floquet
# multiplier, det(1 - monodromy), the length of the step that led there.
ZP, AP, MP, PP, SP, VP, DZ, DA, DM, DP, DS, DV = 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11
TU, TV, FP, DET, LENGTH, POINT = 12, 13, 14, 15, 16, 17
RATE = 6  # from a value to its derivative


class Fixed(NamedTuple):
    """Everything but tip offset and amplitude stays; `reach` is the length [m] on which orbits change."""

    p: tuple[float, ...]
    lever: np.ndarray
    reach: float


class Swept(NamedTuple):
    """m moves what `table` says, shape (TABLE_ROWS, n), Chebyshev coefficients; `width` is a small change of m."""

    table: np.ndarray
    kind: int
    width: float


@njit(**OPTIONS)
def fixed(law: Law, p: tuple[float, ...], lever: np.ndarray) -> Fixed:
    """Return the path on which only tip offset and amplitude move."""
    return Fixed(p, lever, scale_of(law, p, lever, free_amplitude(lever)))


@njit(**OPTIONS)
def chebyshev(coefficients: np.ndarray, m: float) -> float:
    """Value of a Chebyshev series (Clenshaw)."""
    one, two = 0.0, 0.0
    for k in range(len(coefficients) - 1, 0, -1):
        one, two = coefficients[k] + 2.0 * m * one - two, one
    return coefficients[0] + m * one - two


@njit(**OPTIONS)
def swept_at(table: np.ndarray, m: float) -> tuple[tuple[float, ...], np.ndarray, float]:
    """The law's parameters, the lever, and what is held, at m."""
    values = np.empty(TABLE_ROWS)
    for i in range(TABLE_ROWS):
        values[i] = chebyshev(table[i], m)
    p = (
        values[0], values[1], values[2], values[3], values[4], values[5], values[6], values[7], values[8], values[9],
        values[10], values[11],
    )  # fmt: skip
    return p, values[LEVER:HELD].copy(), values[HELD]


@njit(**OPTIONS)
def held_at(path: Swept, m: float) -> float:
    """The tip offset or amplitude [m] that is held at m."""
    return chebyshev(path.table[HELD], m)


@njit(**OPTIONS)
def stand_swept(path: Swept, m: float) -> tuple[tuple[float, ...], np.ndarray, Drift]:
    """The law's parameters, the lever, and how they drift."""
    p, lever, _ = swept_at(path.table, m)
    p_up, lever_up, _ = swept_at(path.table, m + SMALL)
    p_down, lever_down, _ = swept_at(path.table, m - SMALL)
    return p, lever, Drift(p_up, p_down, lever_up, lever_down, SMALL)


@njit(**OPTIONS)
def held_row(path: Swept, m: float, row: np.ndarray) -> None:
    """Equation of what is held, linearised at m: r (z0, A, m) = h."""
    value = held_at(path, m)
    rate = (held_at(path, m + SMALL) - held_at(path, m - SMALL)) / (2.0 * SMALL)
    row[:] = 0.0
    row[1 if path.kind == HELD_AMPLITUDE else 0] = 1.0
    row[2] = -rate
    row[3] = value - rate * m


@njit(**OPTIONS)
def gap_scale(reach: float, z0: float, amplitude: float) -> float:
    """Natural length of the gap z0 - A at a point of the curve."""
    return 0.5 * reach + 0.25 * abs(z0 - amplitude)


# What follows differs between the two kinds of path: a formula for each, and a stub that is resolved by type while
# compiling.


def stand(path: Any, m: float) -> Any:
    """The law's parameters, the lever, and how they drift (None on a fixed path)."""


def _stand_fixed(path: Fixed, m: float) -> tuple[tuple[float, ...], np.ndarray, None]:
    return path.p, path.lever, None


def _stand_swept(path: Swept, m: float) -> tuple[tuple[float, ...], np.ndarray, Drift]:
    return stand_swept(path, m)


def control(path: Any) -> Any:
    """Which entry of a point is swept: the tip offset or m."""


def _control_fixed(path: Fixed) -> int:
    return ZP


def _control_swept(path: Swept) -> int:
    return MP


def answer(path: Any) -> Any:
    """The other entry that moves: the amplitude, or the tip offset where the amplitude is held."""


def _answer_fixed(path: Fixed) -> int:
    return AP


def _answer_swept(path: Swept) -> int:
    return ZP if path.kind == HELD_AMPLITUDE else AP


def scales(path: Any, reach: float, z0: float, amplitude: float) -> Any:
    """Natural lengths of the two coordinates: theory, Eqs. (continuation-1) and (continuation-5)."""


def _scales_fixed(path: Fixed, reach: float, z0: float, amplitude: float) -> tuple[float, float]:
    return gap_scale(reach, z0, amplitude), 0.2 * amplitude


def _scales_swept(path: Swept, reach: float, z0: float, amplitude: float) -> tuple[float, float]:
    gap = gap_scale(reach, z0, amplitude)
    return path.width, gap if path.kind == HELD_AMPLITUDE else min(gap, 0.2 * amplitude)


def row_of(path: Any, reach: float, point: np.ndarray) -> Any:
    """The tangent as a row for (dz0, dA, dm), made from the scaled coordinates."""


def _row_of_fixed(path: Fixed, reach: float, point: np.ndarray) -> tuple[float, float, float]:
    u, v = scales(path, reach, point[ZP], point[AP])
    return point[TU], point[TV] * u / v - point[TU], 0.0


def _row_of_swept(path: Swept, reach: float, point: np.ndarray) -> tuple[float, float, float]:
    u, v = scales(path, reach, point[ZP], point[AP])
    other = point[TV] * u / v
    return (other, 0.0, point[TU]) if path.kind == HELD_AMPLITUDE else (0.0, other, point[TU])


def unit(path: Any, reach: float, point: np.ndarray, dz: float, da: float, dm: float) -> Any:
    """The scaled coordinates of a direction."""


def _unit_fixed(path: Fixed, reach: float, point: np.ndarray, dz: float, da: float, dm: float) -> tuple[float, float]:
    u, v = scales(path, reach, point[ZP], point[AP])
    return (dz - da) / u, da / v


def _unit_swept(path: Swept, reach: float, point: np.ndarray, dz: float, da: float, dm: float) -> tuple[float, float]:
    u, v = scales(path, reach, point[ZP], point[AP])
    return dm / u, (dz if path.kind == HELD_AMPLITUDE else da) / v


def reach_on(law: Law, path: Any, orbit: Orbit) -> Any:
    """Length [m] on which orbits change, where this one is."""


def _reach_on_fixed(law: Law, path: Fixed, orbit: Orbit) -> float:
    return path.reach


def _reach_on_swept(law: Law, path: Swept, orbit: Orbit) -> float:
    p, lever, _ = swept_at(path.table, orbit.head[VALUE, M])
    return scale_of(law, p, lever, free_amplitude(lever))


def solve_on(
    law: Law, path: Any, tables: np.ndarray, orbit: Orbit, spare: Orbit, row: Any, level: int, tolerance: float,
    most: int, coarse: bool,
) -> Any:  # fmt: skip
    """Newton's method on the plane row (z0, A, m) = const through where the orbit now is; `coarse` on the way only."""


def _solve_on_fixed(
    law: Law, path: Fixed, tables: np.ndarray, orbit: Orbit, spare: Orbit, row: tuple[float, float, float], level: int,
    tolerance: float, most: int, coarse: bool,
) -> tuple[int, int, Orbit, Orbit]:  # fmt: skip
    hold = HOLD_ARC if coarse else HOLD_PLANE
    target = np.array([row[0], row[1], orbit.head[VALUE, Z0], orbit.head[VALUE, A]])
    return newton(law, path.p, path.lever, tables, orbit, spare, hold, target, level, tolerance, most)


def _solve_on_swept(
    law: Law, path: Swept, tables: np.ndarray, orbit: Orbit, spare: Orbit, row: tuple[float, float, float], level: int,
    tolerance: float, most: int, coarse: bool,
) -> tuple[int, int, Orbit, Orbit]:  # fmt: skip
    value = orbit.head[VALUE]
    holds = np.zeros((2, 4))
    holds[1, 0], holds[1, 1], holds[1, 2] = row[0], row[1], row[2]
    holds[1, 3] = row[0] * value[Z0] + row[1] * value[A] + row[2] * value[M]
    status, steps = col.PENDING, 0
    while status == col.PENDING and steps < most:
        p, lever, drift = stand_swept(path, orbit.head[VALUE, M])
        held_row(path, orbit.head[VALUE, M], holds[0])
        status, orbit, spare = newton_swept(law, p, lever, tables, orbit, spare, drift, holds, level, tolerance, coarse)
        steps += 1
    return (col.NOT_CONVERGED if status == col.PENDING else status), steps, orbit, spare


def tangent_on(law: Law, path: Any, tables: np.ndarray, orbit: Orbit, row: Any) -> Any:
    """Linearise; leave the derivative along the curve in the system's last column, row (dz0, dA, dm) = 1."""


def _tangent_on_fixed(law: Law, path: Fixed, tables: np.ndarray, orbit: Orbit, row: tuple[float, float, float]) -> bool:
    return linearise(law, path.p, path.lever, tables, orbit, None) and along(path.lever, orbit, row[0], row[1])


def _tangent_on_swept(law: Law, path: Swept, tables: np.ndarray, orbit: Orbit, row: tuple[float, float, float]) -> bool:
    p, lever, drift = stand_swept(path, orbit.head[VALUE, M])
    holds = np.zeros((2, 4))
    held_row(path, orbit.head[VALUE, M], holds[0])
    holds[1, 0], holds[1, 1], holds[1, 2] = row[0], row[1], row[2]
    return linearise(law, p, lever, tables, orbit, drift) and along_swept(lever, orbit, drift, holds)


def _pick(path: Any, of_fixed: Any, of_swept: Any) -> Any:
    return of_fixed if path.instance_class is Fixed else of_swept


_HOW: dict[str, Any] = {"jit_options": {k: v for k, v in OPTIONS.items() if k != "cache"}, "strict": False}
overload(stand, **_HOW)(lambda path, m: _pick(path, _stand_fixed, _stand_swept))
overload(control, **_HOW)(lambda path: _pick(path, _control_fixed, _control_swept))
overload(answer, **_HOW)(lambda path: _pick(path, _answer_fixed, _answer_swept))
overload(scales, **_HOW)(lambda path, reach, z0, amplitude: _pick(path, _scales_fixed, _scales_swept))
overload(row_of, **_HOW)(lambda path, reach, point: _pick(path, _row_of_fixed, _row_of_swept))
overload(unit, **_HOW)(lambda path, reach, point, dz, da, dm: _pick(path, _unit_fixed, _unit_swept))
overload(reach_on, **_HOW)(lambda law, path, orbit: _pick(path, _reach_on_fixed, _reach_on_swept))
overload(solve_on, **_HOW)(
    lambda law, path, tables, orbit, spare, row, level, tolerance, most, coarse: _pick(
        path, _solve_on_fixed, _solve_on_swept
    )
)
overload(tangent_on, **_HOW)(lambda law, path, tables, orbit, row: _pick(path, _tangent_on_fixed, _tangent_on_swept))
