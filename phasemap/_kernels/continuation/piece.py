"""A whole piece of a curve of orbits: a row for each orbit wanted, each fold, and the orbits on the way."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.arrays import copy, smaller
from phasemap._kernels.compilation import kernel
from phasemap._kernels.continuation.path import (
    AP,
    LENGTH,
    MP,
    POINT,
    RATE,
    TU,
    TV,
    ZP,
    Path,
    control,
    reach_on,
    scales,
    solve_on,
    standing_at,
    unit,
)
from phasemap._kernels.continuation.path import row_of as tangent_row
from phasemap._kernels.continuation.step import (
    FIRST_STEP,
    LARGEST_STEP,
    SHORTER,
    SMALLEST_STEP,
    Place,
    advance,
    copy_orbit,
    cross,
    mark,
    same_piece,
)
from phasemap._kernels.excitation import seen_amplitude, seen_rate
from phasemap._kernels.law import Oscillator
from phasemap._kernels.orbits.collocation.closing import along
from phasemap._kernels.orbits.collocation.estimate import state_errors
from phasemap._kernels.orbits.collocation.newton import MOST_STEPS, begin, newton, observe, settled
from phasemap._kernels.orbits.collocation.observables import complete, time_trace
from phasemap._kernels.orbits.collocation.system import (
    COUNT,
    KEPT,
    LEVEL,
    LINEAR,
    RIGHT,
    RP,
    RZ,
    SYSTEM,
    VALUE,
    Z0,
    A,
    M,
    Orbit,
    P,
    new_orbit,
)

MOST_POINTS = 4000
FINEST = 2  # level of refinement at a fold, whose place is wanted more exactly than an orbit's
FLAT, ROUGH = 1e-9, 1e-6  # of its value at the points beside it: where dx/ds is as small, the curve turns
MOST_HALVINGS = 40
LEFT, CLOSED, STUCK, FULL = 0, 1, 2, 3  # how a piece ends
LOW, HIGH, LEAST = 0, 1, 2  # entries of a box: of the control, and of the amplitude


class Asked(NamedTuple):
    """What is asked of a curve."""

    entry: int  # of a point, whose values are wanted: the control, or the amplitude, of z or as seen
    wanted: np.ndarray  # sorted; values at which rows are made
    box: np.ndarray  # shape (3,); smallest and largest control, smallest amplitude: where the curve is left
    tolerance: float  # last change [m] of an orbit


class Made(NamedTuple):
    """Full rows of orbits, shape (n, FULL), and their time traces, shape (n, 2, samples)."""

    rows: np.ndarray
    traces: np.ndarray


@kernel
def record(path: Path, orbit: Orbit, kind: int, index: int, made: Made, count: int) -> int:
    """Write the full row of a marked orbit, and its time trace; returns how many rows there are."""
    if count == len(made.rows):
        return count
    law, tables, row = path.law, path.tables, made.rows[count]
    p, lever = standing_at(path, orbit.head[VALUE, M])
    row[:] = math.nan
    observe(Oscillator(law, p, lever), tables, orbit, row[: col.COLUMNS])
    amplitude, push = orbit.head[VALUE, A], orbit.head[VALUE, P]
    row[col.SEEN] = seen_amplitude(lever, amplitude, push)
    if along(lever, orbit, 0.0, 1.0):
        rate = seen_rate(lever, amplitude, push, 1.0, orbit.head[SYSTEM + RP, RIGHT])
        row[col.SLOPE] = rate / orbit.head[SYSTEM + RZ, RIGHT]
    complete(Oscillator(law, p, lever), tables, orbit, row)
    row[col.PARAMETER], row[col.KIND], row[col.INDEX] = orbit.head[VALUE, M], kind, index
    if made.traces.shape[2] > 0:
        time_trace(Oscillator(law, p, lever), tables, orbit, row[col.PHASE], made.traces[count])
    return count + 1


@kernel
def sharpen(path: Path, orbit: Orbit, spare: Orbit, point: np.ndarray, tolerance: float) -> tuple[bool, Orbit, Orbit]:
    """Make the orbit of a point on the way exact, in the plane across the curve."""
    lever = standing_at(path, orbit.head[VALUE, M])[1]
    if orbit.head[COUNT, LINEAR] == KEPT and settled(lever, orbit, tolerance):
        return True, orbit, spare
    row = tangent_row(path, reach_on(path, orbit), point)
    level = int(orbit.head[COUNT, LEVEL])
    status, _, orbit, spare = solve_on(path, orbit, spare, row, level, tolerance, 20, False)
    return status == col.GOOD and mark(path, orbit, point), orbit, spare


@kernel
def advance_exactly(
    path: Path, point: np.ndarray, step: float, tolerance: float, orbit: Orbit, spare: Orbit, saved: Orbit
) -> tuple[bool, float, Orbit, Orbit]:
    """`advance` to an exact orbit: where what was nearly one round a sharp turn is none, by a shorter step."""
    before = point.copy()
    while step > SMALLEST_STEP:
        status, following, orbit, spare = advance(path, point, step, LARGEST_STEP, orbit, spare, saved)
        if status != col.GOOD:
            break
        step = point[LENGTH]
        good, orbit, spare = sharpen(path, orbit, spare, point, tolerance)
        point[LENGTH] = step
        if good and same_piece(path, reach_on(path, orbit), before, point):
            return True, following, orbit, spare
        copy(before, point)
        copy_orbit(saved, orbit)
        step *= SHORTER
    return False, step, orbit, spare


@kernel
def turn_between(
    path: Path, start: Place, after: np.ndarray, slope: int, level: int, tolerance: float, orbit: Orbit, spare: Orbit,
    point: np.ndarray,
) -> tuple[bool, Orbit, Orbit]:  # fmt: skip
    """Find where an entry x turns between two points, dx/ds = 0, by false position in the arclength.

    See theory, Eq. (continuation-5).

    There x is stationary and exact to rounding; the other coordinate is as exact as s. Where a step from the start
    fails, for a long one round a sharp turn may, the shorter one that did not is the next to start from.
    """
    begun, base, room, at = start.point.copy(), new_orbit(), new_orbit(), 0.0
    copy_orbit(start.orbit, base)
    base.head[COUNT, LEVEL] = level
    low, high, f_low, f_high = 0.0, after[LENGTH], begun[slope], after[slope]
    most, last = max(abs(f_low), abs(f_high)), 0
    for _ in range(MOST_HALVINGS):
        share = f_low / (f_low - f_high)
        step = low + (high - low) * min(max(share, 0.02), 0.98)
        copy_orbit(base, orbit)
        copy(begun, point)
        status, _, orbit, spare = advance(path, point, step, LARGEST_STEP, orbit, spare, room)
        if status != col.GOOD:
            return False, orbit, spare
        reached = point[LENGTH]
        good, orbit, spare = sharpen(path, orbit, spare, point, tolerance)
        if not good:
            return False, orbit, spare
        point[LENGTH] = at + reached
        f = point[slope]
        if abs(f) <= FLAT * most or high - low < 1e-12:
            return abs(f) <= ROUGH * most, orbit, spare
        if (f > 0.0) == (f_low > 0.0):
            low, f_low = reached, f
            if reached < step:
                copy(point, begun)
                copy_orbit(orbit, base)
                at, low, high = at + reached, 0.0, high - reached
            f_high *= 0.5 if last == 1 else 1.0
            last = 1
        else:
            high, f_high = reached, f
            f_low *= 0.5 if last == 2 else 1.0
            last = 2
    return abs(point[slope]) <= ROUGH * most, orbit, spare


@kernel
def visit(
    path: Path, asked: Asked, start: Place, end: Place, one: Orbit, spare: Orbit, made: Made, count: int
) -> tuple[int, Orbit, Orbit]:
    """Record the orbits at the values wanted between two places, in the order in which they come."""
    index, wanted, tolerance = asked.entry, asked.wanted, asked.tolerance
    before, after, beside = start.point, end.point, start.point.copy()
    x, y = before[index], after[index]
    rising = y > x  # the value at which a step starts belongs to the step before
    first, last = smaller(wanted, min(x, y), rising), smaller(wanted, max(x, y), rising)
    for i in range(last - first):
        k = first + i if rising else last - 1 - i
        if i == 0:
            copy_orbit(start.orbit, one)
        good, one, spare = cross(path, index, wanted[k], start, beside, after, one, spare, tolerance)
        if not good:
            copy_orbit(end.orbit, one)
        else:
            now = record(path, one, col.WANTED, k, made, count)
            if now > count and index == AP:
                p, lever = standing_at(path, one.head[VALUE, M])
                state_errors(Oscillator(path.law, p, lever), path.tables, one, spare, made.rows[count])
            count = now
    return count, one, spare


@kernel
def follow(path: Path, asked: Asked, orbit: Orbit, spare: Orbit, point: np.ndarray, made: Made) -> tuple[int, int]:
    """Follow the curve from a marked point until it leaves the box, ends, or closes.

    Parameters
    ----------
    point : ndarray, shape (POINT,)
        The start, marked; its tangent says in which sense the curve is followed.

    Returns
    -------
    ended : int
        LEFT, CLOSED, STUCK or FULL.
    count : int
        Rows made, in the order of the curve.
    """
    saved, one, top, tops = new_orbit(), new_orbit(), new_orbit(), (new_orbit(), new_orbit())
    turned, kinds = np.zeros((2, POINT)), np.zeros(2, np.int64)
    origin, step = point.copy(), FIRST_STEP
    count = record(path, orbit, col.ON_THE_WAY, -1, made, 0)
    for points in range(MOST_POINTS):
        before = point.copy()
        good, step, orbit, spare = advance_exactly(path, point, step, asked.tolerance, orbit, spare, saved)
        if not good:
            made.rows[count - 1, col.KIND] = col.END
            return STUCK, count
        # Where the control or the entry wanted turns, the step is divided.
        found, start = 0, Place(before, saved)
        for entry in (control(path), asked.entry):
            slope = entry + RATE
            if before[slope] * point[slope] < 0.0 and not (found == 1 and kinds[0] == slope):
                good = False
                for level in (FINEST, int(orbit.head[COUNT, LEVEL])):
                    if not good:
                        good, top, spare = turn_between(
                            path, start, point, slope, level, asked.tolerance, top, spare, turned[found]
                        )
                if good:
                    copy_orbit(top, tops[found])
                    kinds[found] = slope
                    found += 1
        swapped, done = found == 2 and turned[1, LENGTH] < turned[0, LENGTH], 0.0
        for i in range(found):
            which = 1 - i if swapped else i
            turn = Place(turned[which].copy(), tops[which])
            turn.point[LENGTH] -= done
            count, one, spare = visit(path, asked, start, turn, one, spare, made, count)
            kind = col.FOLD if kinds[which] == control(path) + RATE else col.TURN
            count = record(path, tops[which], kind, -1, made, count)
            start, done = turn, turned[which, LENGTH]
        rest = Place(point.copy(), orbit)
        rest.point[LENGTH] -= done
        count, one, spare = visit(path, asked, start, rest, one, spare, made, count)
        if count == len(made.rows):
            return FULL, count
        if not asked.box[LOW] <= point[control(path)] <= asked.box[HIGH] or point[AP] < asked.box[LEAST]:
            return LEFT, count
        count = record(path, orbit, col.ON_THE_WAY, -1, made, count)
        if points > 8 and returned(path, orbit, origin, point):
            return CLOSED, count
    return FULL, count


@kernel
def returned(path: Path, orbit: Orbit, origin: np.ndarray, point: np.ndarray) -> bool:
    """Whether the curve has come back to where it was begun."""
    away = unit(
        path, reach_on(path, orbit), point, origin[ZP] - point[ZP], origin[AP] - point[AP], origin[MP] - point[MP]
    )
    same = origin[TU] * point[TU] + origin[TV] * point[TV] > 0.5
    return same and math.hypot(away[0], away[1]) < point[LENGTH]


@kernel
def start_at(
    path: Path, guess: np.ndarray, m: float, hold: int, level: int, tolerance: float, orbit: Orbit, spare: Orbit
) -> tuple[bool, Orbit, Orbit]:
    """Go from a harmonic orbit, guess = (z0, mean deflection, A, P, S), to the exact one with its z0 or its A at m."""
    orbit.head[VALUE, M] = m
    law, tables = path.law, path.tables
    p, lever = standing_at(path, m)
    if not guess[col.G_A] > 0.0 or not begin(Oscillator(law, p, lever), tables, orbit, guess, level):
        return False, orbit, spare
    target = np.array([guess[col.G_Z0], 0.0, 0.0, 0.0])
    status, _, orbit, spare = newton(
        Oscillator(law, p, lever), tables, orbit, spare, hold, target, level, tolerance, MOST_STEPS
    )
    return status == col.GOOD and orbit.head[VALUE, A] > 0.0, orbit, spare


@kernel
def aim(path: Path, orbit: Orbit, sense: float, point: np.ndarray) -> bool:
    """Mark an exact orbit with the tangent along which the control rises (sense 1) or falls (-1)."""
    point[:] = 0.0
    # A row that is the control's own, whatever the scales.
    reach = reach_on(path, orbit)
    z0, a, m = orbit.head[VALUE, Z0], orbit.head[VALUE, A], orbit.head[VALUE, M]
    point[ZP], point[AP], point[MP] = z0, a, m
    at_z, at_m = (sense, 0.0) if control(path) == ZP else (0.0, sense)
    point[TU], point[TV] = unit(path, reach, point, at_z, 0.0, at_m)
    if control(path) == ZP:
        of_gap, of_amplitude = scales(path, reach, z0, a)
        point[TV] = point[TU] * of_amplitude / of_gap
    return mark(path, orbit, point)
