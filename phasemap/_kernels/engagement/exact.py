"""The exact orbit at which a tip stops that is lowered slowly at fixed drive.

`engage_along_exact_curve` follows the curve from far (see `phasemap._kernels.engagement.averaged`), `engage_near` does
so from an amplitude at which there is no doubt. What becomes of a tip that loses its orbit is in
`phasemap._kernels.engagement.rest`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.continuation.cubic import hermite
from phasemap._kernels.continuation.path import ENTRY_A, ENTRY_Z0, Path, Point, scales
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
    next_point_watching,
)
from phasemap._kernels.engagement.averaged import low_q_margin_factor, settle_side, worst_amplitude
from phasemap._kernels.engagement.resonance import (
    ATTRACTIVE,
    FARTHEST_AT_ALL,
    Maximum,
    leaps,
    near_resonance,
    side_reached_from_far,
)
from phasemap._kernels.engagement.rest import LINGERING, land, lets_go, loosened, pressed_in
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever import bend_by_adhesion, free_amplitude, reach_of
from phasemap._kernels.orbits.averaged.orbits import averaged_orbits
from phasemap._kernels.orbits.collocation.contacts import PERMANENT
from phasemap._kernels.orbits.collocation.newton import (
    begin_harmonic,
    linearise_and_fill_row,
    solve_at_amplitude,
)
from phasemap._kernels.orbits.collocation.system import Orbit, head_of
from phasemap._kernels.records import assign, clear

MOST_APPROACH_POINTS = 1500
CUBIC_PLACES = 16  # between two points where the amplitude is looked at
NEAR_BRANCH_END = 2e-3  # of the setpoint: nearer than this to the end of a branch, the whole curve is followed
NEAR_LANDING = 0.05  # of the free amplitude, from where the tip lands to the branch on which it taps on


class Rooms(NamedTuple):
    """Orbits to work with; `found` is the one at the setpoint."""

    orbit: Orbit
    spare: Orbit
    saved: Orbit
    found: Orbit


@kernel
def _known(value: float, otherwise: float) -> float:
    """The value, or the other where it is NaN."""
    return otherwise if math.isnan(value) else value


@kernel
def lower_along_curve(
    path: Path, wanted: Wanted, lingering: float, point: Point, rooms: Rooms
) -> tuple[int, float, Rooms]:
    """Follow the curve from `point` on to the orbit at which a tip that is lowered stops, returned last.

    The second value is the tip offset at which the tip leaves the curve: where its orbit is no longer stable, or the
    lowest that the curve reached. The status is NOT_SETTLED where the curve leads nowhere: a multiplier above
    `lingering` belongs to orbits that linger at an unstable equilibrium.
    """
    orbit, spare, saved, found = rooms
    amplitude = wanted.value
    law, p, lever = path.law, path.p, path.lever
    step, lowest, left, have = FIRST_ARC_STEP, 1e300, math.nan, False
    highest = 10.0 * (abs(point.value[ENTRY_Z0]) + point.value[ENTRY_A] + path.reach)
    for _ in range(MOST_APPROACH_POINTS):
        before = Point()
        assign(before, point)
        status, step, orbit, spare = next_point_watching(
            path, point, step, LARGEST_ARC_STEP, wanted, orbit, spare, saved
        )
        if status != col.GOOD:
            if pressed_in(Oscillator(law, p, lever), orbit):
                status = col.NO_STABLE_ORBIT
            lowest = min(lowest, before.value[ENTRY_Z0])
            return status, _known(left, lowest), Rooms(orbit, spare, saved, found)
        z0, a = point.value[ENTRY_Z0], point.value[ENTRY_A]
        if before.value[ENTRY_A] > amplitude >= a and z0 < before.value[ENTRY_Z0] and not have:
            copy_orbit(orbit, found)
            have, found, spare = find_crossing(path, wanted, Place(before, saved), before, point, found, spare)
            if not have:
                status = col.NO_STABLE_ORBIT if pressed_in(Oscillator(law, p, lever), orbit) else col.NOT_CONVERGED
                return status, _known(left, lowest), Rooms(orbit, spare, saved, found)
        elif a > amplitude >= before.value[ENTRY_A] and z0 >= lowest:
            have = False  # the tip lands before that crossing
        if have and z0 < lowest:
            return col.GOOD, left, Rooms(orbit, spare, saved, found)
        if math.isnan(left) and not point.floquet < 1.0 and z0 < lowest:
            left = z0
        lowest = min(lowest, z0)
        away = z0 > highest and head_of(orbit).contacts == 0 and a < 2.0 * free_amplitude(lever)
        if point.floquet > lingering or away:
            return col.NOT_SETTLED, _known(left, lowest), Rooms(orbit, spare, saved, found)
        if head_of(orbit).contacts == PERMANENT and (a < 0.3 * amplitude or z0 < -FARTHEST_AT_ALL):
            break
    return col.NO_STABLE_ORBIT, lowest, Rooms(orbit, spare, saved, found)


@kernel
def retract_along_curve(path: Path, wanted: Wanted, point: Point, rooms: Rooms) -> tuple[int, Rooms]:
    """Follow a branch of smaller amplitude as the tip offset is raised, to the orbit that holds `amplitude`.

    Where the branch ends first the tip is pulled off and jumps across the setpoint.
    """
    orbit, spare, saved, found = rooms
    amplitude = wanted.value
    law, p, lever = path.law, path.p, path.lever
    step, sudden = 0.1, lets_go(Oscillator(law, p, lever))
    for _ in range(MOST_APPROACH_POINTS):
        before = Point()
        assign(before, point)
        status, step, orbit, spare = next_point_watching(
            path, point, step, LARGEST_ARC_STEP, wanted, orbit, spare, saved
        )
        if status != col.GOOD:
            return col.NO_STABLE_ORBIT if sudden else col.NOT_CONVERGED, Rooms(orbit, spare, saved, found)
        if before.value[ENTRY_A] < amplitude <= point.value[ENTRY_A]:
            copy_orbit(orbit, found)
            good, found, spare = find_crossing(path, wanted, Place(before, saved), before, point, found, spare)
            return col.GOOD if good else col.NOT_CONVERGED, Rooms(orbit, spare, saved, found)
        if point.value[ENTRY_Z0] < before.value[ENTRY_Z0] or point.rate[ENTRY_Z0] < 0.0:
            return col.NO_STABLE_ORBIT, Rooms(orbit, spare, saved, found)
        if not point.floquet < 1.0:
            # A multiplier past one is a fold, past minus one it doubles the period.
            gone = point.determinant < 0.0 or point.floquet > LINGERING or p[col.LONGRANGE] == 0.0
            return col.NO_STABLE_ORBIT if gone else col.UNSTABLE, Rooms(orbit, spare, saved, found)
    return col.NOT_CONVERGED, Rooms(orbit, spare, saved, found)


@kernel
def tangent_of_offset(path: Path, orbit: Orbit, sense: float, point: Point) -> None:
    """Set the tangent of a point so that `mark_point` turns it to where the offset rises (sense 1) or falls (-1)."""
    of_gap, of_amplitude = scales(path, path.reach, head_of(orbit).tip_offset, head_of(orbit).amplitude)
    clear(point)
    point.tangent_u, point.tangent_v = sense, sense * of_amplitude / of_gap


@kernel
def joins_offset(path: Path, z0: float, orbit: Orbit, spare: Orbit, saved: Orbit) -> tuple[bool, Orbit, Orbit]:
    """Whether stable orbits join this one (lost) to near the tip offset z0, the amplitude rising with the tip offset.

    Near is enough: a tip that hits a force that jumps goes through doubled periods before it comes to this branch.
    """
    lever = path.lever
    near = NEAR_LANDING * free_amplitude(lever)
    point = Point()
    sense = 1.0 if z0 > head_of(orbit).tip_offset else -1.0
    tangent_of_offset(path, orbit, sense, point)
    good, step = mark_point(path, orbit, point), 0.1
    for _ in range(MOST_APPROACH_POINTS):
        if (
            not good
            or not point.floquet < 1.0
            or not point.rate[ENTRY_Z0] * sense > 0.0
            or not point.rate[ENTRY_A] * sense > 0.0
        ):
            return False, orbit, spare
        if (point.value[ENTRY_Z0] - z0) * sense >= -near:
            return True, orbit, spare
        status, step, orbit, spare = next_point(path, point, step, LARGEST_ARC_STEP, orbit, spare, saved)
        good = status == col.GOOD
    return False, orbit, spare


@kernel
def find_tapping_orbit(path: Path, wanted: Wanted, z0: float, level: int, rooms: Rooms) -> tuple[bool, Rooms]:
    """Find the repulsive orbit of this amplitude on the branch on which a tip lands that taps on at z0, if any."""
    orbit, spare, saved, found = rooms
    law, p, lever, tables = path.law, path.p, path.lever, path.tables
    guesses = averaged_orbits(Oscillator(law, p, lever), wanted.value)
    for i in range(len(guesses)):  # a row of its own type, were it iterated over
        guess = guesses[i]
        if guess[col.G_P] <= 0.0 or not begin_harmonic(Oscillator(law, p, lever), tables, orbit, guess, level):
            continue
        status, _, orbit, spare = solve_at_amplitude(
            Oscillator(law, p, lever), tables, orbit, spare, level, wanted.tolerance, 20
        )
        if status != col.GOOD or not head_of(orbit).push > 0.0:
            continue
        copy_orbit(orbit, found)
        good, orbit, spare = joins_offset(path, z0, orbit, spare, saved)
        if good:
            return True, Rooms(orbit, spare, saved, found)
    return False, Rooms(orbit, spare, saved, found)


@kernel
def engage_landed(path: Path, wanted: Wanted, z0: float, level: int, rooms: Rooms) -> tuple[int, Rooms]:
    """Orbit at the setpoint of a tip that lands in contact at `z0` and is lowered further or retracted."""
    orbit, spare, saved, found = rooms
    amplitude = wanted.value
    law, p, lever, tables = path.law, path.p, path.lever, path.tables
    good, orbit, spare = land(Oscillator(law, p, lever), tables, z0, level, orbit, spare)
    if not good:
        good, rooms = find_tapping_orbit(path, wanted, z0, level, Rooms(orbit, spare, saved, found))
        return col.GOOD if good else col.NOT_CONVERGED, rooms
    down, point = head_of(orbit).amplitude > amplitude, Point()
    if not down:
        z0 = loosened(Oscillator(law, p, lever), z0, amplitude)
        good, orbit, spare = land(Oscillator(law, p, lever), tables, z0, level, orbit, spare)
        if not good:
            return col.NOT_CONVERGED, Rooms(orbit, spare, saved, found)
    tangent_of_offset(path, orbit, -1.0 if down else 1.0, point)
    if not mark_point(path, orbit, point):
        return col.NOT_CONVERGED, Rooms(orbit, spare, saved, found)
    if not down:
        status, rooms = retract_along_curve(path, wanted, point, Rooms(orbit, spare, saved, found))
        # Above resonance contact brings the lever nearer to it: the tip may as well have landed on a large oscillation.
        if status == col.NO_STABLE_ORBIT and lever[col.OMEGA] > 1.0:
            status = col.NOT_CONVERGED
        return status, rooms
    status, _, rooms = lower_along_curve(path, wanted, LINGERING, point, Rooms(orbit, spare, saved, found))
    return col.NOT_CONVERGED if status == col.NOT_SETTLED else status, rooms


@kernel
def engage_along_exact_curve(
    path: Path, wanted: Wanted, level: int, lingering: float, rooms: Rooms
) -> tuple[int, Rooms]:
    """Approach from far along exact orbits to the one that holds `amplitude`; it is returned last.

    Where the curve's multiplier passes `lingering` the tip is taken to land elsewhere; NOT_SETTLED if it is not
    known where.
    """
    orbit, spare, saved, found = rooms
    amplitude = wanted.value
    law, p, lever = path.law, path.p, path.lever
    status, orbit, spare = start_far(path, orbit, spare, amplitude, level)
    if status != col.GOOD:
        return status, Rooms(orbit, spare, saved, found)
    point = Point()
    point.tangent_u = -1.0
    if not mark_point(path, orbit, point):
        return col.NOT_CONVERGED, Rooms(orbit, spare, saved, found)
    status, left, rooms = lower_along_curve(path, wanted, lingering, point, Rooms(orbit, spare, saved, found))
    # A curve that ends where the tip touches a force that jumps: no orbit touches it only a little.
    grazing = p[col.RELEASE] != 0.0 or (p[col.LONGRANGE] == 0.0 and bend_by_adhesion(Oscillator(law, p, lever)) > 0.0)
    if status == col.NOT_SETTLED or (status == col.NOT_CONVERGED and (grazing or level > 0)):
        done, rooms = engage_landed(path, wanted, left, level, rooms)
        return status if done == col.NOT_CONVERGED else done, rooms
    return status, rooms


@kernel
def lowest_between(before: Point, point: Point) -> float:
    """Least amplitude between two points of the curve, by the cubic through both and their slopes."""
    length, lowest = point.length, min(before.value[ENTRY_A], point.value[ENTRY_A])
    for i in range(1, CUBIC_PLACES):
        lowest = min(
            lowest,
            hermite(
                before.value[ENTRY_A],
                length * before.rate[ENTRY_A],
                point.value[ENTRY_A],
                length * point.rate[ENTRY_A],
                i / CUBIC_PLACES,
            ),
        )
    return lowest


@kernel
def _farthest_repulsive(path: Path, wanted: Wanted, rooms: Rooms) -> tuple[int, Rooms]:
    """Find the farthest repulsive orbit at the setpoint that can be held."""
    orbit, spare, saved, found = rooms
    law, p, lever, tables = path.law, path.p, path.lever, path.tables
    row = np.zeros(col.COLUMNS)
    guesses = averaged_orbits(Oscillator(law, p, lever), wanted.value)
    for i in range(len(guesses)):  # a row of its own type, were it iterated over
        guess = guesses[i]
        if guess[col.G_P] <= 0.0 or not begin_harmonic(Oscillator(law, p, lever), tables, found, guess, 0):
            continue
        status, _, found, spare = solve_at_amplitude(
            Oscillator(law, p, lever), tables, found, spare, 0, wanted.tolerance, 12
        )
        if status == col.GOOD and linearise_and_fill_row(Oscillator(law, p, lever), tables, found, row) == col.GOOD:
            if row[col.FLOQUET] < 1.0 and row[col.SLOPE] > 0.0 and row[col.STIFFENING] > 0.0:
                return col.GOOD, Rooms(orbit, spare, saved, found)
    return col.NOT_CONVERGED, Rooms(orbit, spare, saved, found)


@kernel
def engage_near(path: Path, wanted: Wanted, rooms: Rooms) -> tuple[int, Rooms]:
    """Orbit at the setpoint near the end of the attractive branch, without the way from far.

    At an amplitude nearer to the free one the attractive branch is reached for certain. From there exact orbits are
    followed down to the setpoint; if the branch ends before, the tip jumps to the farthest repulsive orbit that can be
    held. NOT_CONVERGED leaves the question to `engage_along_exact_curve`.
    """
    orbit, spare, saved, found = rooms
    amplitude, tolerance = wanted.value, wanted.tolerance
    law, p, lever, tables = path.law, path.p, path.lever, path.tables
    if p[col.LONGRANGE] == 0.0 or p[col.RELEASE] != 0.0:
        return col.NOT_CONVERGED, Rooms(orbit, spare, saved, found)
    free, guess, top = free_amplitude(lever), np.zeros(col.GUESS), Maximum()
    worst, force_reach, certain = worst_amplitude(lever, amplitude), reach_of(law, p), False
    if not near_resonance(lever) or leaps(lever, force_reach, free):
        return col.NOT_CONVERGED, Rooms(orbit, spare, saved, found)
    for share in (0.3, 0.7):
        higher = worst + share * (free - worst)
        side = side_reached_from_far(
            Oscillator(law, p, lever), force_reach, higher, free, low_q_margin_factor(lever), top
        )
        certain = side == ATTRACTIVE and settle_side(Oscillator(law, p, lever), force_reach, higher, side, top, guess)
        if certain:
            break
    if not certain or not begin_harmonic(Oscillator(law, p, lever), tables, orbit, guess, 0):
        return col.NOT_CONVERGED, Rooms(orbit, spare, saved, found)
    status, _, orbit, spare = solve_at_amplitude(Oscillator(law, p, lever), tables, orbit, spare, 0, tolerance, 12)
    point = Point()
    point.tangent_v = -1.0
    if status != col.GOOD or not mark_point(path, orbit, point):
        return col.NOT_CONVERGED, Rooms(orbit, spare, saved, found)
    if not (point.floquet < 1.0 and point.rate[ENTRY_Z0] < 0.0 and head_of(orbit).push < 0.0):
        return col.NOT_CONVERGED, Rooms(orbit, spare, saved, found)
    step, ended = FIRST_ARC_STEP, False
    while not ended:
        before = Point()
        assign(before, point)
        status, step, orbit, spare = next_point_watching(
            path, point, step, LARGEST_ARC_STEP, wanted, orbit, spare, saved
        )
        if status != col.GOOD:
            return col.NOT_CONVERGED, Rooms(orbit, spare, saved, found)
        ended = point.value[ENTRY_A] > before.value[ENTRY_A] or point.value[ENTRY_Z0] > before.value[ENTRY_Z0]
        crossed = before.value[ENTRY_A] > amplitude >= point.value[ENTRY_A]
        # The cubic is off by less than it dips.
        lowest = 2.0 * lowest_between(before, point) - min(before.value[ENTRY_A], point.value[ENTRY_A])
        if ended and (crossed or lowest < (1.0 + NEAR_BRANCH_END) * amplitude):
            # Which comes first takes smaller steps to tell.
            return col.NOT_CONVERGED, Rooms(orbit, spare, saved, found)
        if crossed:
            copy_orbit(orbit, found)
            good, found, spare = find_crossing(path, wanted, Place(before, saved), before, point, found, spare)
            return col.GOOD if good else col.NOT_CONVERGED, Rooms(orbit, spare, saved, found)
    return _farthest_repulsive(path, wanted, Rooms(orbit, spare, saved, found))
