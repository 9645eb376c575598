"""A curve of periodic orbits, followed through its folds.

Pseudo-arclength continuation in the plane of the two numbers that move on a `path`: each step predicts along the
tangent and corrects in the plane across it, so that folds are passed like any other point: theory,
Eq. (continuation-2).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.arrays import copy, copy_rows
from phasemap._kernels.compilation import kernel
from phasemap._kernels.continuation.cubic import AT_FOLD, cubic_slopes, extreme_between, hermite, length_at, wavy
from phasemap._kernels.continuation.path import (
    AP,
    DA,
    DET,
    DM,
    DP,
    DS,
    DV,
    DZ,
    FIXED,
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
    drift_at,
    gap_scale,
    held_row,
    put_row,
    reach_on,
    row_of,
    scales,
    solve_on,
    standing_at,
    tangent_on,
    unit,
)
from phasemap._kernels.excitation import seen_amplitude, seen_rate
from phasemap._kernels.law import Oscillator
from phasemap._kernels.orbits.collocation.closing import accept, close, close_swept
from phasemap._kernels.orbits.collocation.contacts import find_contacts
from phasemap._kernels.orbits.collocation.elements import carry_over, lay
from phasemap._kernels.orbits.collocation.newton import floquet
from phasemap._kernels.orbits.collocation.system import (
    CONTACTS,
    COUNT,
    ELEMENTS,
    HOLD_PLANE,
    LEVEL,
    LINEAR,
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

FIRST_STEP, LARGEST_STEP, LONGEST_STEP, SMALLEST_STEP = 0.3, 0.8, 2.0, 1e-7
SHORTER = 0.4  # times as long is a step after one that failed
CORNER = 2e-3  # a step this short may turn by any angle: grazing a force that jumps is a corner; with a neck, an end
EXACTLY, ENOUGH, MOST_TRIES = 1e-13, 1e-10, 8  # of the amplitude that the detector sees
ENTRY = (Z0, A, M, P, S)  # of an orbit's values, in the order of a point's


class Place(NamedTuple):
    """A point of the curve and its orbit."""

    point: np.ndarray
    orbit: Orbit


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
    if not find_contacts(p, path.tables, orbit) or not lay(
        Oscillator(path.law, p, lever), path.tables, spare, orbit, level
    ):
        return False
    carry_over(path.tables, orbit, spare)
    return True


@kernel(shared=True)
def predict(path: Path, orbit: Orbit, row: tuple[float, float, float], target: tuple[float, float, float]) -> bool:
    """Move an orbit whose equations are known along the curve's tangent, to row (z0, A, m) = row target."""
    m = orbit.head[VALUE, M]
    lever = standing_at(path, m)[1]
    if path.kind == FIXED:
        plane = np.array([row[0], row[1], target[0], target[1]])
        if not close(lever, orbit, HOLD_PLANE, plane):
            return False
    else:
        holds = np.zeros((2, 4))
        held_row(path, m, holds[0])
        put_row(holds[1], row, row[0] * target[0] + row[1] * target[1] + row[2] * target[2])
        if not close_swept(lever, orbit, drift_at(path, m), holds):
            return False
    accept(path.tables, lever, orbit, 1.0)
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
    path: Path, point: np.ndarray, step: float, longest: float, orbit: Orbit, spare: Orbit, saved: Orbit
) -> tuple[int, float, Orbit, Orbit]:
    """Go to the next point of the curve; returns a status, the step to try next, the orbit and the spare room.

    `saved` and `point` receive the orbit and the point that were left. The step to try next is `longest` at most.
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
        for i in range(5):
            value[ENTRY[i]] += step * before[RATE + i]
        if value[A] > 0.0 and relay(path, orbit, spare):
            orbit, spare = spare, orbit
            status, steps, orbit, spare = solve_on(path, orbit, spare, row, level, coarse, 8, True)
            # With a neck the curve ends where a contact is made or kept.
            if status == col.GOOD and not (hysteretic and orbit.head[COUNT, CONTACTS] != contacts):
                copy(before, point)
                good = mark(path, orbit, point)
                turn = point[TU] * before[TU] + point[TV] * before[TV]
                point[LENGTH] = step
                if hysteretic or step >= CORNER:
                    good = good and turn > 0.7 and same_piece(path, reach, before, point)
                    good = good and not wavy(path, reach, before, point)
                if good:
                    growth = 1.5 if steps <= 3 and turn > 0.97 else 1.0 if steps <= 4 else 0.6
                    return col.GOOD, min(step * growth, longest), orbit, spare
        copy_orbit(saved, orbit)
        step *= SHORTER
    copy(before, point)
    return col.NOT_CONVERGED, step, orbit, spare


@kernel
def advance_watching(
    path: Path,
    point: np.ndarray,
    step: float,
    longest: float,
    index: int,
    value: float,
    orbit: Orbit,
    spare: Orbit,
    saved: Orbit,
) -> tuple[int, float, Orbit, Orbit]:
    """`advance`, with a point set on an extreme of an entry that may just reach `value`."""
    before = point.copy()
    status, following, orbit, spare = advance(path, point, step, longest, orbit, spare, saved)
    for _ in range(6):
        if status != col.GOOD:
            break
        instead = extreme_between(before, point, index, value)
        if instead == 0.0:
            break
        copy_orbit(saved, orbit)
        copy(before, point)
        status, following, orbit, spare = advance(path, point, instead, longest, orbit, spare, saved)
    return status, following, orbit, spare


@kernel(shared=True)
def settle_on(
    path: Path, index: int, value: float, last: np.ndarray, after: np.ndarray, orbit: Orbit, spare: Orbit,
    tolerance: float,
) -> tuple[bool, Orbit, Orbit]:  # fmt: skip
    """From an orbit near by, go to where entry `index` is `value` between two points; True if it is found there.

    Its own tangent must cross the value in the sense of the two points: a pair of crossings may lie close together.
    The first point, `last`, becomes the one that is found.
    """
    held, reach, guess = orbit.head[VALUE], reach_on(path, orbit), np.empty(5)
    by_one, by_two = cubic_slopes(path, reach, last, after)
    at = length_at(last[index], by_one * last[RATE + index], after[index], by_two * after[RATE + index], value)
    for i in range(5):
        guess[i] = hermite(last[i], by_one * last[RATE + i], after[i], by_two * after[RATE + i], at)
    if index != VP:
        guess[index] = value
    way = row_of(path, reach, after)
    if orbit.head[COUNT, LINEAR] != 0.0 and not predict(path, orbit, way, (guess[ZP], guess[AP], guess[MP])):
        return False, orbit, spare
    for i in range(5):
        held[ENTRY[i]] = guess[i]
    row = (1.0 if index == ZP else 0.0, 1.0 if index == AP else 0.0, 1.0 if index == MP else 0.0)
    if index == VP:
        row = way
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
    low, high = min(last[other], after[other]), max(last[other], after[other])
    slack = 0.05 * (high - low)
    if index != MP:
        slack += 1e-3 * abs(last[index] - after[index])
    else:
        slack += 1e-3 * gap_scale(reach_on(path, orbit), here[ZP], here[AP])
    if not low - slack <= here[other] <= high + slack:
        return False, orbit, spare
    good = good and here[index + RATE] * (after[index] - last[index]) > 0.0
    if good:
        copy(here, last)
    return good, orbit, spare


@kernel
def cross(
    path: Path, index: int, value: float, start: Place, last: np.ndarray, after: np.ndarray, orbit: Orbit,
    spare: Orbit, tolerance: float,
) -> tuple[bool, Orbit, Orbit]:  # fmt: skip
    """Find the orbit where entry `index` is `value` between two places, from the orbit (near by; lost).

    `last` is a point between the first and the value; it becomes the one that is found. Where Newton's method lands on
    another piece of the curve, the curve is followed again from the start in shorter steps.
    """
    before = start.point
    if index == AP or index == VP:
        # Pressed into a soft surface, the lever moves far for little amplitude: rounding is amplified so much.
        tolerance *= max(1.0, 1e-2 * abs((after[ZP] - before[ZP]) / (after[index] - before[index])))
    good, orbit, spare = settle_on(path, index, value, last, after, orbit, spare, tolerance)
    if good:
        return True, orbit, spare
    low, high, room = before.copy(), after.copy(), new_orbit()
    begin_orbit = new_orbit()
    copy_orbit(start.orbit, begin_orbit)
    for _ in range(12):
        copy_orbit(begin_orbit, orbit)
        between = low.copy()
        share = (value - low[index]) / (high[index] - low[index])
        step = high[LENGTH] * min(max(share, 0.1), 0.9)
        status, _, orbit, spare = advance(path, between, step, LARGEST_STEP, orbit, spare, room)
        if status != col.GOOD:
            return False, orbit, spare
        if (between[index] > value) == (high[index] > value):
            copy(between, high)
        else:
            high[LENGTH] -= between[LENGTH]
            copy(between, low)
            copy_orbit(orbit, begin_orbit)
        copy(low, last)
        good, orbit, spare = settle_on(path, index, value, last, high, orbit, spare, tolerance)
        if good:
            return True, orbit, spare
    copy(before, last)
    return False, orbit, spare
