"""The exact orbit at which a tip stops that is lowered slowly at fixed drive: the curve of orbits, with its folds.

The tip visits those points of the curve where z0 is lower than ever before: where z0 would rise, at a fold, it jumps to
the first later piece that z0 reaches again while it falls (theory, Eq. (engagement-1)). It stops at the first visited
crossing of the setpoint; a crossing inside the jump counts if the tip lands beyond it, since the feedback then retracts
to it. Where the tip is lost to orbits that linger at an unstable equilibrium no curve tells where it lands.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.continuation.cubic import extreme_between
from phasemap._kernels.continuation.path import ENTRY_A, ENTRY_Z0, Path, Point
from phasemap._kernels.continuation.piece import turn_between
from phasemap._kernels.continuation.start import start_far
from phasemap._kernels.continuation.step import (
    FIRST_ARC_STEP,
    LARGEST_ARC_STEP,
    Place,
    Wanted,
    copy_orbit,
    find_crossing,
    mark_point,
    next_point,
)
from phasemap._kernels.engagement.averaged import settle_side, worst_amplitude
from phasemap._kernels.engagement.resonance import leaps, low_q_margin_factor, side_reached_from_far
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever import free_amplitude, low_q, lowest_tip_offset, near_resonance, reach_of
from phasemap._kernels.orbits.averaged.sides import ATTRACTIVE, FARTHEST_AT_ALL, Maximum
from phasemap._kernels.orbits.collocation.contacts import PERMANENT
from phasemap._kernels.orbits.collocation.newton import begin_harmonic, solve_at_amplitude
from phasemap._kernels.orbits.collocation.system import Orbit, head_of, new_orbit
from phasemap._kernels.records import assign, clear, record

MOST_APPROACH_POINTS = 1500
LINGERING = 1e4  # a multiplier as large belongs to an orbit that lingers at an unstable equilibrium, or grazes
HIGHER = (0.3, 0.7)  # of the way from the narrowest amplitude to the free one: where the attractive branch may be sure


class Rooms(NamedTuple):
    """Orbits to work with; `found` is the one at the setpoint."""

    orbit: Orbit
    spare: Orbit
    saved: Orbit
    found: Orbit


@kernel
def pressed_in(oscillator: Oscillator, orbit: Orbit) -> bool:
    """Whether the tip stays in contact with the lever pressed in farther than any instrument would."""
    return head_of(orbit).contacts == PERMANENT and head_of(orbit).tip_offset < lowest_tip_offset(oscillator)


@record
class Descent:
    """A tip that is lowered along the curve."""

    lowest: float  # tip offset so far [m]
    crossed: int  # 1 where it came down through the setpoint to an orbit that it may stop on


@kernel
def descend(
    path: Path, wanted: Wanted, start: Place, after: Point, near: Orbit, way: Descent, found: Orbit, spare: Orbit
) -> tuple[int, Orbit, Orbit]:  # fmt: skip
    """Go on from one point of the curve to another, whose orbit is `near`, with no turn of the amplitude between.

    GOOD where the tip stops, on the orbit `found`, PENDING where it goes on; NOT_CONVERGED where it comes to an orbit
    that is not stable.
    """
    amplitude, before, z0 = wanted.value, start.point, after.value[ENTRY_Z0]
    from_a, to_a = before.value[ENTRY_A], after.value[ENTRY_A]
    if from_a > amplitude >= to_a and z0 < before.value[ENTRY_Z0] and way.crossed == 0:
        last = Point()
        assign(last, before)
        copy_orbit(near, found)
        good, found, spare = find_crossing(path, wanted, start, last, after, found, spare)
        if not good:
            return col.NOT_CONVERGED, found, spare
        way.crossed = 1
    elif to_a > amplitude >= from_a and z0 >= way.lowest:
        way.crossed = 0  # the tip lands before that crossing
    if way.crossed == 1 and z0 < way.lowest:
        return col.GOOD, found, spare
    if z0 < way.lowest and after.determinant > 0.0 and not after.floquet < 1.0:
        return col.NOT_CONVERGED, found, spare  # the tip leaves the curve, and not by a fold that lies between
    way.lowest = min(way.lowest, z0)
    return col.PENDING, found, spare


@kernel
def descend_by_turn(
    path: Path, wanted: Wanted, start: Place, after: Point, near: Orbit, way: Descent, found: Orbit, spare: Orbit
) -> tuple[int, Orbit, Orbit]:  # fmt: skip
    """As `descend`, by the point between where the amplitude turns if it may just reach the setpoint there."""
    if not extreme_between(start.point, after, ENTRY_A, wanted.value) > 0.0:
        return descend(path, wanted, start, after, near, way, found, spare)
    turn, top, end = Point(), new_orbit(path.lever), Point()
    level = head_of(near).level
    good, top, spare = turn_between(path, start, after, ENTRY_A, level, wanted.tolerance, top, spare, turn)
    if not good:
        return col.NOT_CONVERGED, found, spare
    status, found, spare = descend(path, wanted, start, turn, top, way, found, spare)
    if status != col.PENDING:
        return status, found, spare
    assign(end, after)
    end.length -= turn.length
    return descend(path, wanted, Place(turn, top), end, near, way, found, spare)


@kernel
def lower_along_curve(path: Path, wanted: Wanted, point: Point, rooms: Rooms) -> tuple[int, Rooms]:
    """Follow the curve from `point` on to the orbit at which a tip that is lowered stops, in `found` of the rooms."""
    orbit, spare, saved, found = rooms
    amplitude, step, way = wanted.value, FIRST_ARC_STEP, Descent()
    way.lowest = math.inf
    highest = 10.0 * (abs(point.value[ENTRY_Z0]) + point.value[ENTRY_A] + path.reach)
    for _ in range(MOST_APPROACH_POINTS):
        before = Point()
        assign(before, point)
        status, step, orbit, spare = next_point(path, point, step, LARGEST_ARC_STEP, orbit, spare, saved)
        if status == col.GOOD:
            status, found, spare = descend_by_turn(path, wanted, Place(before, saved), point, orbit, way, found, spare)
        if status != col.PENDING:
            lost = status != col.GOOD and pressed_in(Oscillator(path.law, path.p, path.lever), orbit)
            return col.NO_STABLE_ORBIT if lost else status, Rooms(orbit, spare, saved, found)
        z0, a, contacts = point.value[ENTRY_Z0], point.value[ENTRY_A], head_of(orbit).contacts
        away = z0 > highest and contacts == 0 and a < 2.0 * free_amplitude(path.lever)
        if point.floquet > LINGERING or away:
            return col.NOT_CONVERGED, Rooms(orbit, spare, saved, found)
        if contacts == PERMANENT and (a < 0.3 * amplitude or z0 < -FARTHEST_AT_ALL):
            break
    return col.NO_STABLE_ORBIT, Rooms(orbit, spare, saved, found)


@kernel
def start_on_branch(path: Path, wanted: Wanted, point: Point, orbit: Orbit, spare: Orbit) -> tuple[bool, Orbit, Orbit]:
    """Begin the curve at an amplitude at which the tip is surely on the attractive branch; False if none is known."""
    law, p, lever, tables = path.law, path.p, path.lever, path.tables
    oscillator, reach, free = Oscillator(law, p, lever), reach_of(law, p), free_amplitude(lever)
    if p[col.LONGRANGE] == 0.0 or law.attracts == 0 or low_q(lever):
        return False, orbit, spare
    if not near_resonance(lever) or leaps(lever, reach, free):
        return False, orbit, spare
    guess, top, worst, sure = np.zeros(col.GUESS), Maximum(), worst_amplitude(lever, wanted.value), False
    for share in HIGHER:
        higher = worst + share * (free - worst)
        side = side_reached_from_far(oscillator, reach, higher, free, low_q_margin_factor(lever), top)
        sure = side == ATTRACTIVE and settle_side(oscillator, reach, higher, side, top, guess)
        if sure:
            break
    if not sure or not begin_harmonic(oscillator, tables, orbit, guess, 0):
        return False, orbit, spare
    status, _, orbit, spare = solve_at_amplitude(oscillator, tables, orbit, spare, 0, wanted.tolerance, 12)
    clear(point)
    point.tangent_v = -1.0
    good = status == col.GOOD and mark_point(path, orbit, point)
    good = good and point.floquet < 1.0 and point.rate[ENTRY_Z0] < 0.0 and head_of(orbit).push < 0.0
    return good, orbit, spare


@kernel
def engage_along_exact_curve(path: Path, wanted: Wanted, rooms: Rooms) -> tuple[int, Rooms]:
    """Exact orbit that holds the amplitude wanted after the approach from far, in `found` of the rooms.

    NOT_CONVERGED where only time tells.
    """
    orbit, spare, saved, found = rooms
    point = Point()
    good, orbit, spare = start_on_branch(path, wanted, point, orbit, spare)
    if not good:
        status, orbit, spare = start_far(path, orbit, spare, wanted.value, 0)
        clear(point)
        point.tangent_u = -1.0
        if status != col.GOOD or not mark_point(path, orbit, point):
            return col.NOT_CONVERGED, Rooms(orbit, spare, saved, found)
    return lower_along_curve(path, wanted, point, Rooms(orbit, spare, saved, found))
