"""A curve of periodic orbits, followed through its folds.

Pseudo-arclength continuation in the plane of the two numbers that move on a `path`: each step predicts along the
tangent and corrects in the plane across it, so that folds are passed like any other point: theory,
Eq. (continuation-2).
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.arrays import copy, copy_rows
from phasemap._kernels.compilation import kernel
from phasemap._kernels.continuation.path import (
    AP,
    DA,
    DET,
    DM,
    DP,
    DS,
    DV,
    DZ,
    FP,
    LENGTH,
    MP,
    PP,
    RATE,
    SP,
    TU,
    TV,
    VP,
    ZP,
    Path,
    answer,
    control,
    gap_scale,
    reach_on,
    row_of,
    scales,
    solve_on,
    standing_at,
    tangent_on,
    unit,
)
from phasemap._kernels.excitation import seen_amplitude, seen_rate
from phasemap._kernels.orbits.collocation.contacts import find_contacts
from phasemap._kernels.orbits.collocation.elements import carry_over, lay
from phasemap._kernels.orbits.collocation.newton import floquet
from phasemap._kernels.orbits.collocation.system import (
    CONTACTS,
    COUNT,
    ELEMENTS,
    LEVEL,
    RA,
    RIGHT,
    RM,
    RP,
    RS,
    RZ,
    SYSTEM,
    TRANSFER,
    VALUE,
    Z0,
    A,
    M,
    Orbit,
    P,
    S,
    new_orbit,
)

FIRST_STEP, LARGEST_STEP, SMALLEST_STEP = 0.3, 0.8, 1e-7
CORNER = 2e-3  # a step this short may turn by any angle: grazing a force that jumps is a corner; with a neck, an end
AT_FOLD = 3e-3  # change of the control over its scale, per step of one
EXACTLY, ENOUGH, MOST_TRIES = 1e-13, 1e-10, 8  # of the amplitude that the detector sees
ENTRY = (Z0, A, M, P, S)  # of an orbit's values, in the order of a point's


@kernel
def copy_orbit(source: Orbit, to: Orbit) -> None:
    """Copy an orbit."""
    count = int(source.head[COUNT, ELEMENTS]) + 1
    old, new = source.elements, to.elements
    for e in range(count):
        for i in range(old.shape[1]):
            for j in range(old.shape[2]):
                new[e, i, j] = old[e, i, j]
    copy_rows(source.head, to.head)


@kernel(shared=True)
def relay(path: Path, orbit: Orbit, spare: Orbit) -> bool:
    """Lay `spare` for the contacts of `orbit` as its values stand now, and carry the orbit over."""
    p, lever = standing_at(path, orbit.head[VALUE, M])
    level = int(orbit.head[COUNT, LEVEL])
    if not find_contacts(p, path.tables, orbit) or not lay(path.law, p, lever, path.tables, spare, orbit, level):
        return False
    carry_over(path.tables, orbit, spare)
    return True


@kernel(shared=True)
def mark(path: Path, orbit: Orbit, point: np.ndarray) -> bool:
    """Fill a point of the curve at a converged orbit; the tangent it holds, of the point before, gives the sense."""
    value, right = orbit.head[VALUE], orbit.head[SYSTEM : SYSTEM + RIGHT, RIGHT]
    reach = reach_on(path, orbit)
    point[ZP], point[AP], point[MP], point[PP], point[SP] = value[Z0], value[A], value[M], value[P], value[S]
    if not tangent_on(path, orbit, row_of(path, reach, point)):
        return False
    dz, da, dm = right[RZ], right[RA], right[RM]
    t_u, t_v = unit(path, reach, point, dz, da, dm)
    length = math.hypot(t_u, t_v)
    m = orbit.head[TRANSFER]
    point[FP] = floquet(m)
    point[DET] = 1.0 - m[0] - m[3] + m[0] * m[3] - m[1] * m[2]
    point[TU], point[TV] = t_u / length, t_v / length
    point[DZ], point[DA], point[DM] = dz / length, da / length, dm / length
    point[DP], point[DS] = right[RP] / length, right[RS] / length
    lever = standing_at(path, value[M])[1]
    point[VP] = seen_amplitude(lever, value[A], value[P])
    point[DV] = seen_rate(lever, value[A], value[P], point[DA], point[DP])
    return math.isfinite(length)


@kernel
def same_piece(path: Path, reach: float, before: np.ndarray, point: np.ndarray) -> bool:
    """Whether the curve keeps its orientation between two points.

    Where the amplitude is free, dz0 (or dm) and det(1 - monodromy) change sign together along one curve, at folds.
    Where only one does, the step has landed on a neighbouring piece that runs the other way. At a fold itself both are
    nothing but rounding. See theory, Eq. (continuation-3).
    """
    slope = control(path) + RATE
    if answer(path) != AP or abs(point[slope]) < AT_FOLD * scales(path, reach, point[ZP], point[AP])[0]:
        return True
    return before[slope] * before[DET] * point[slope] * point[DET] >= 0.0


@kernel(shared=True)
def advance(
    path: Path,
    point: np.ndarray,
    step: float,
    orbit: Orbit,
    spare: Orbit,
    saved: Orbit,
) -> tuple[int, float, Orbit, Orbit]:
    """Go to the next point of the curve; returns a status, the step to try next, the orbit and the spare room.

    `saved` and `point` receive the orbit and the point that were left.
    """
    level = int(orbit.head[COUNT, LEVEL])
    copy_orbit(orbit, saved)
    before = point.copy()
    reach = reach_on(path, orbit)
    coarse = 1e-3 * gap_scale(reach, point[ZP], point[AP])
    contacts, hysteretic = orbit.head[COUNT, CONTACTS], standing_at(path, orbit.head[VALUE, M])[0][col.RELEASE] != 0.0
    row = row_of(path, reach, before)
    while step > SMALLEST_STEP:
        value = orbit.head[VALUE]
        value[Z0] += step * before[DZ]
        value[A] += step * before[DA]
        value[M] += step * before[DM]
        value[P] += step * before[DP]
        value[S] += step * before[DS]
        if value[A] > 0.0 and relay(path, orbit, spare):
            orbit, spare = spare, orbit
            status, steps, orbit, spare = solve_on(path, orbit, spare, row, level, coarse, 8, True)
            # With a neck the curve ends where a contact is made or kept.
            if status == col.GOOD and not (hysteretic and orbit.head[COUNT, CONTACTS] != contacts):
                copy(before, point)
                good = mark(path, orbit, point)
                turn = point[TU] * before[TU] + point[TV] * before[TV]
                corner = step < CORNER and not hysteretic
                if good and (corner or (turn > 0.7 and same_piece(path, reach, before, point))):
                    point[LENGTH] = step
                    growth = 1.5 if steps <= 3 and turn > 0.97 else 1.0 if steps <= 4 else 0.6
                    return col.GOOD, min(step * growth, LARGEST_STEP), orbit, spare
        copy_orbit(saved, orbit)
        step *= 0.4
    copy(before, point)
    return col.NOT_CONVERGED, step, orbit, spare


@kernel
def extreme_between(before: np.ndarray, point: np.ndarray, index: int, value: float) -> float:
    """Where to step instead if an entry (`index`) may just reach `value` and turn between two points; 0 if not.

    The extreme is that of the cubic through both points and slopes. It asks for a point there when `value` lies beyond
    both ends, on the side of the extreme and not far outside it, so that a pair of crossings is not stepped over.
    """
    slope = index + RATE
    one, two, length = before[slope], point[slope], point[LENGTH]
    if one * two >= 0.0 or length < 1e-5:
        return 0.0
    rise = (point[index] - before[index]) / length
    cubic, square = one + two - 2.0 * rise, 3.0 * rise - 2.0 * one - two
    # one + 2 square t + 3 cubic t^2 = 0 with t in (0, 1): the root without cancellation.
    root = math.sqrt(max(square * square - 3.0 * cubic * one, 0.0))
    t = -one / (square + root) if square > 0.0 else -one / (square - root)
    if not 0.02 < t < 0.98:
        return 0.0
    extreme = before[index] + length * t * (one + t * (square + t * cubic))
    end = min(before[index], point[index]) if one < 0.0 else max(before[index], point[index])
    beyond, reached = value - end, extreme - end
    if beyond * reached <= 0.0 or abs(beyond) > 3.0 * abs(reached) + 1e-3 * abs(point[index]) * length:
        return 0.0
    return t * length


@kernel
def advance_watching(
    path: Path,
    point: np.ndarray,
    step: float,
    index: int,
    value: float,
    orbit: Orbit,
    spare: Orbit,
    saved: Orbit,
) -> tuple[int, float, Orbit, Orbit]:
    """`advance`, with a point set on an extreme of an entry that may just reach `value`."""
    before = point.copy()
    status, following, orbit, spare = advance(path, point, step, orbit, spare, saved)
    for _ in range(6):
        if status != col.GOOD:
            break
        instead = extreme_between(before, point, index, value)
        if instead == 0.0:
            break
        copy_orbit(saved, orbit)
        copy(before, point)
        status, following, orbit, spare = advance(path, point, instead, orbit, spare, saved)
    return status, following, orbit, spare


@kernel
def hermite(one: float, rise: float, two: float, end: float, t: float) -> float:
    """The cubic from `one` with slope `rise` at t = 0 to `two` with slope `end` at t = 1."""
    cubic, square = rise + end - 2.0 * (two - one), 3.0 * (two - one) - 2.0 * rise - end
    return one + t * (rise + t * (square + t * cubic))


@kernel
def length_at(before: np.ndarray, after: np.ndarray, index: int, value: float) -> float:
    """Where between two points (0 ... 1) the cubic of an entry passes a value."""
    low, high, length = 0.0, 1.0, after[LENGTH]
    one, two = before[index], after[index]
    rise, end = length * before[RATE + index], length * after[RATE + index]
    at = (value - one) / (two - one)
    for _ in range(30):
        x = hermite(one, rise, two, end, at) - value
        if (x > 0.0) == (two > one):
            high = at
        else:
            low = at
        slope = rise + at * (2.0 * (3.0 * (two - one) - 2.0 * rise - end) + 3.0 * at * (rise + end - 2.0 * (two - one)))
        step = x / slope if slope != 0.0 else math.inf
        if abs(step) < 1e-12:
            break
        at = at - step if low < at - step < high else 0.5 * (low + high)
    return at


@kernel(shared=True)
def settle_on(
    path: Path,
    index: int,
    value: float,
    before: np.ndarray,
    after: np.ndarray,
    orbit: Orbit,
    spare: Orbit,
    tolerance: float,
) -> tuple[bool, Orbit, Orbit]:
    """From an orbit near by, go to where entry `index` is `value` between two points; True if it is found there.

    Its own tangent must cross the value in the sense of the two points: a pair of crossings may lie close together.
    """
    held, at, length = orbit.head[VALUE], length_at(before, after, index, value), after[LENGTH]
    for i in range(5):
        held[ENTRY[i]] = hermite(before[i], length * before[RATE + i], after[i], length * after[RATE + i], at)
    if index != VP:
        held[ENTRY[index]] = value
    row = (1.0 if index == ZP else 0.0, 1.0 if index == AP else 0.0, 1.0 if index == MP else 0.0)
    if index == VP:
        row = row_of(path, reach_on(path, orbit), after)
    if not relay(path, orbit, spare):
        return False, orbit, spare
    orbit, spare = spare, orbit
    level = int(orbit.head[COUNT, LEVEL])
    status, _, orbit, spare = solve_on(path, orbit, spare, row, level, tolerance, 20, False)
    if status != col.GOOD:
        return False, orbit, spare
    here = after.copy()
    good = mark(path, orbit, here)
    for _ in range(MOST_TRIES):
        # What the detector sees is no coordinate: it is come to along the curve.
        if index != VP or not good or abs(here[VP] - value) <= EXACTLY * value:
            break
        more, value_of = (value - here[VP]) / here[DV], orbit.head[VALUE]
        for i in range(5):
            value_of[ENTRY[i]] += more * here[RATE + i]
        row = row_of(path, reach_on(path, orbit), here)
        if not value_of[A] > 0.0 or not relay(path, orbit, spare):
            return False, orbit, spare
        orbit, spare = spare, orbit
        status, _, orbit, spare = solve_on(path, orbit, spare, row, level, tolerance, 20, False)
        good = status == col.GOOD and mark(path, orbit, here)
    good = good and (index != VP or abs(here[VP] - value) <= ENOUGH * value)
    other = answer(path) if index == control(path) else control(path)
    low, high = min(before[other], after[other]), max(before[other], after[other])
    slack = 0.05 * (high - low)
    if index != MP:
        slack += 1e-3 * abs(before[index] - after[index])
    else:
        slack += 1e-3 * gap_scale(reach_on(path, orbit), here[ZP], here[AP])
    if not low - slack <= here[other] <= high + slack:
        return False, orbit, spare
    return good and here[index + RATE] * (after[index] - before[index]) > 0.0, orbit, spare


@kernel
def cross(
    path: Path,
    index: int,
    value: float,
    before: np.ndarray,
    after: np.ndarray,
    orbit: Orbit,
    start: Orbit,
    spare: Orbit,
    tolerance: float,
) -> tuple[bool, Orbit, Orbit]:
    """Find the orbit where entry `index` is `value` between two points, from the orbit (at `after`; lost).

    `start` holds the orbit at `before`. Where Newton's method lands on another piece of the curve, the curve is
    followed again in shorter steps.
    """
    if index == AP or index == VP:
        # Pressed into a soft surface, the lever moves far for little amplitude: rounding is amplified so much.
        tolerance *= max(1.0, 1e-2 * abs((after[ZP] - before[ZP]) / (after[index] - before[index])))
    good, orbit, spare = settle_on(path, index, value, before, after, orbit, spare, tolerance)
    if good:
        return True, orbit, spare
    low, high, room = before.copy(), after.copy(), new_orbit()
    begin_orbit = new_orbit()
    copy_orbit(start, begin_orbit)
    for _ in range(12):
        copy_orbit(begin_orbit, orbit)
        between = low.copy()
        share = (value - low[index]) / (high[index] - low[index])
        step = high[LENGTH] * min(max(share, 0.1), 0.9)
        status, _, orbit, spare = advance(path, between, step, orbit, spare, room)
        if status != col.GOOD:
            return False, orbit, spare
        if (between[index] > value) == (high[index] > value):
            copy(between, high)
        else:
            high[LENGTH] -= between[LENGTH]
            copy(between, low)
            copy_orbit(orbit, begin_orbit)
        good, orbit, spare = settle_on(path, index, value, low, high, orbit, spare, tolerance)
        if good:
            return True, orbit, spare
    return False, orbit, spare
