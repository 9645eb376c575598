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
from phasemap._kernels.continuation.piece import turn_between
from phasemap._kernels.continuation.point import ENTRY_A, ENTRY_SEEN, ENTRY_Z0, Point, solve_far_from_surface
from phasemap._kernels.continuation.step import (
    FIRST_ARC_STEP,
    Place,
    Wanted,
    copy_orbit,
    find_crossing,
    mark_point,
    next_point,
)
from phasemap._kernels.engagement.beside_resonance import rebounds
from phasemap._kernels.engagement.by_averaging import (
    BY_AVERAGING,
    IN_TIME,
    fill_setpoint_orbit_on_side,
    leaps_to_resonance,
    side_reached_from_far,
    worst_amplitude,
)
from phasemap._kernels.excitation import likely_amplitude, sees_tip
from phasemap._kernels.law import Oscillator, has_longrange
from phasemap._kernels.lever import FARTHEST_AT_ALL, free_amplitude, low_q, lowest_tip_offset, near_resonance
from phasemap._kernels.orbits.averaged.sides import ATTRACTIVE, Maximum
from phasemap._kernels.orbits.collocation.contacts_and_necks import PERMANENT
from phasemap._kernels.orbits.collocation.near import (
    MOST_STEPS_NEARBY,
    collocation_orbit_from_harmonic,
    refine_orbit,
    tolerance_of,
)
from phasemap._kernels.orbits.collocation.newton import begin_harmonic, solve_at_amplitude
from phasemap._kernels.orbits.collocation.path import Path, fixed_path, oscillator_at
from phasemap._kernels.orbits.collocation.system import Orbit, head_of, new_orbit, new_orbit_like
from phasemap._kernels.orbits.harmonic_orbit import HarmonicOrbit
from phasemap._kernels.orbits.response.orbit_at_setpoint import largest_branch_distance
from phasemap._kernels.orbits.result_row import feedback_status
from phasemap._kernels.records import assign, clear, record

MOST_APPROACH_POINTS = 1500
MAY_REACH = 0.5  # of a slope's change over a step, times its length: farther beyond both ends no parabola turns
HIGHER = 0.5  # of the way from the narrowest amplitude to the free one: where the attractive branch may be sure
RISES_TO = 10.0  # times tip offset, amplitude and reach at the start: a curve that is followed higher leads away
BELOW_SETPOINT = 0.3  # of the setpoint: a tip in contact all the time that moves less comes back to no orbit
LINGERING = 1e4  # a multiplier as large belongs to an orbit that lingers at an unstable equilibrium, or grazes


class CurveWorkspace(NamedTuple):
    """Orbits by collocation with which a curve is followed; `found` is the one at the setpoint."""

    orbit: Orbit
    saved: Orbit
    found: Orbit


@kernel
def tip_amplitude_wanted(oscillator: Oscillator, amplitude: float) -> Wanted:
    """Target on a curve: the orbit on which the tip has an amplitude A [m]."""
    return Wanted(ENTRY_A, amplitude, tolerance_of(oscillator))


@kernel
def detected_amplitude_wanted(oscillator: Oscillator, seen: float) -> Wanted:
    """Target on a curve: the orbit that the detector sees with an amplitude [m]."""
    return Wanted(ENTRY_A if sees_tip(oscillator.lever) else ENTRY_SEEN, seen, tolerance_of(oscillator))


@kernel
def rough_tip_amplitude(lever: np.ndarray, wanted: Wanted) -> float:
    """Amplitude A [m] of the attractive orbit wanted; roughly, where an amplitude of the detector is wanted."""
    return wanted.value if wanted.entry == ENTRY_A else likely_amplitude(lever, wanted.value, ATTRACTIVE)


@kernel
def pressed_in(oscillator: Oscillator, orbit: Orbit) -> bool:
    """True if the tip stays in contact with the lever pressed in farther than any instrument would."""
    return head_of(orbit).contacts == PERMANENT and head_of(orbit).tip_offset < lowest_tip_offset(oscillator)


@record
class CurveDescent:
    """A tip that is lowered along the curve."""

    lowest: float  # tip offset so far [m]
    crossed: int  # 1 where it came down through the setpoint to an orbit that it may stop on


@kernel
def descend_to_next_point(
    path: Path, wanted: Wanted, start: Place, after: Point, near: Orbit, way: CurveDescent, found: Orbit
) -> int:
    """Go from a point of the curve to the next, whose orbit is `near`, without a turn of the amplitude between.

    GOOD where the tip stops, on the orbit `found`, PENDING where it goes on; NOT_CONVERGED where it comes to an orbit
    that is not stable.
    """
    amplitude, before, z0 = wanted.value, start.point, after.value[ENTRY_Z0]
    from_a, to_a = before.value[wanted.entry], after.value[wanted.entry]
    if from_a > amplitude >= to_a and z0 < before.value[ENTRY_Z0] and way.crossed == 0:
        last = Point()
        assign(last, before)
        copy_orbit(near, found)
        good = find_crossing(path, wanted, start, last, after, found)
        if not good:
            return col.NOT_CONVERGED
        way.crossed = 1
    elif to_a > amplitude >= from_a and z0 >= way.lowest:
        way.crossed = 0  # the tip lands before that crossing
    if way.crossed == 1 and z0 < way.lowest:
        return col.GOOD
    if z0 < way.lowest and after.determinant > 0.0 and not after.floquet < 1.0:
        return col.NOT_CONVERGED  # the tip leaves the curve, and not by a fold that lies between
    way.lowest = min(way.lowest, z0)
    return col.PENDING


@kernel
def descend_by_turn(
    path: Path, wanted: Wanted, start: Place, after: Point, near: Orbit, way: CurveDescent, found: Orbit
) -> int:
    """Go down from one point of the curve to the next, by the point between at which the amplitude turns, if any.

    Returns what `descend_to_next_point` does; the amplitude may just reach the setpoint where it turns.
    """
    entry, value, tolerance = wanted
    rate_before, rate_after = start.point.rate[entry], after.rate[entry]
    sense = 1.0 if rate_before > 0.0 else -1.0
    beyond = min(sense * (value - start.point.value[entry]), sense * (value - after.value[entry]))
    if rate_before * rate_after >= 0.0 or not 0.0 < beyond < MAY_REACH * abs(rate_before - rate_after) * after.length:
        return descend_to_next_point(path, wanted, start, after, near, way, found)
    turn, top, end = Point(), new_orbit_like(found), Point()
    level = head_of(near).level
    good = turn_between(path, start, after, entry, level, tolerance, top, turn)
    if not good:
        return col.NOT_CONVERGED
    status = descend_to_next_point(path, wanted, start, turn, top, way, found)
    if status != col.PENDING:
        return status
    assign(end, after)
    end.length -= turn.length
    return descend_to_next_point(path, wanted, Place(turn, top), end, near, way, found)


@kernel
def lower_along_curve(path: Path, wanted: Wanted, point: Point, curve: CurveWorkspace) -> int:
    """Follow the curve from `point` to the orbit at which a tip that is lowered stops, left in `curve.found`."""
    orbit, saved, found = curve
    amplitude, step, way = wanted.value, FIRST_ARC_STEP, CurveDescent()
    way.lowest = math.inf
    highest = RISES_TO * (abs(point.value[ENTRY_Z0]) + point.value[ENTRY_A] + path.reach)
    for _ in range(MOST_APPROACH_POINTS):
        before = Point()
        assign(before, point)
        status, step = next_point(path, point, step, orbit, saved)
        if status == col.GOOD:
            status = descend_by_turn(path, wanted, Place(before, saved), point, orbit, way, found)
        if status != col.PENDING:
            lost = status != col.GOOD and pressed_in(oscillator_at(path, 0.0), orbit)
            return col.NO_STABLE_ORBIT if lost else status
        z0, a, contacts = point.value[ENTRY_Z0], point.value[ENTRY_A], head_of(orbit).contacts
        away = z0 > highest and contacts == 0 and a < 2.0 * free_amplitude(path.lever)
        if point.floquet > LINGERING or away:
            return col.NOT_CONVERGED
        if contacts == PERMANENT and (a < BELOW_SETPOINT * amplitude or z0 < -FARTHEST_AT_ALL):
            return col.NO_STABLE_ORBIT
    return col.NOT_CONVERGED


@kernel
def start_on_branch(path: Path, wanted: Wanted, point: Point, orbit: Orbit) -> bool:
    """Begin the curve at an amplitude at which the tip is surely on the attractive branch; False if none is known."""
    oscillator, harmonic, top = oscillator_at(path, 0.0), HarmonicOrbit(), Maximum()
    law, p, lever = oscillator
    if (
        not has_longrange(p)
        or law.attracts == 0
        or low_q(lever)
        or not near_resonance(lever)
        or leaps_to_resonance(oscillator)
    ):
        return False
    worst = worst_amplitude(lever, rough_tip_amplitude(lever, wanted))
    higher = worst + HIGHER * (free_amplitude(lever) - worst)
    side = side_reached_from_far(oscillator, higher, top)
    if side != ATTRACTIVE or not fill_setpoint_orbit_on_side(oscillator, higher, side, top, harmonic):
        return False
    if not begin_harmonic(oscillator, orbit, harmonic, 0):
        return False
    status = solve_at_amplitude(oscillator, orbit, 0, wanted.tolerance, MOST_STEPS_NEARBY)
    point.tangent_v = -1.0
    good = status == col.GOOD and mark_point(path, orbit, point) and point.value[wanted.entry] > wanted.value
    return good and point.floquet < 1.0 and point.rate[ENTRY_Z0] < 0.0 and head_of(orbit).push < 0.0


@kernel
def start_far_from_surface(path: Path, wanted: Wanted, point: Point, orbit: Orbit) -> bool:
    """Begin the curve where the surface hardly acts; False where no orbit is found."""
    clear(point)
    point.tangent_u = -1.0
    status = solve_far_from_surface(path, orbit, rough_tip_amplitude(path.lever, wanted))
    return status == col.GOOD and mark_point(path, orbit, point)


@kernel
def _found_on_averaged_branch(
    oscillator: Oscillator, harmonic: HarmonicOrbit, curve: CurveWorkspace, row: np.ndarray
) -> bool:
    """True if the exact orbit near the averaged one, left in `curve.found`, is on its branch and can be held."""
    done, away = collocation_orbit_from_harmonic(oscillator, harmonic, curve.found, row)
    same = (row[col.STIFFENING] > 0.0) == (harmonic.push > 0.0)
    near = away < largest_branch_distance(oscillator.lever, harmonic.amplitude)
    return done == col.GOOD and same and near


@kernel(shared=True)
def orbit_along_curve(oscillator: Oscillator, wanted: Wanted, curve: CurveWorkspace, row: np.ndarray) -> int:
    """Exact orbit at which a tip stops that is lowered from far, in `curve.found` and its row; returns a status.

    NOT_CONVERGED where only time tells.
    """
    path, orbit, point = fixed_path(oscillator), curve.orbit, Point()
    if not (start_on_branch(path, wanted, point, orbit) or start_far_from_surface(path, wanted, point, orbit)):
        return col.NOT_CONVERGED
    done = lower_along_curve(path, wanted, point, curve)
    if done == col.GOOD:
        done = refine_orbit(oscillator, curve.found, row)
    return feedback_status(row) if done == col.GOOD else done


@kernel(shared=True)
def engaged_collocation_orbit(
    oscillator: Oscillator,
    wanted: Wanted,
    decider: int,
    harmonic: HarmonicOrbit,
    curve: CurveWorkspace,
    row: np.ndarray,
) -> int:
    """Exact orbit by collocation, in `found`: from the averaged one where that is sure, else along the exact curve.

    Where a tip leaps and lands, or rebounds, no curve tells: NOT_CONVERGED.
    """
    if decider == IN_TIME:
        row[:] = math.nan
        return col.NOT_CONVERGED
    if decider == BY_AVERAGING and _found_on_averaged_branch(oscillator, harmonic, curve, row):
        return col.GOOD
    done = orbit_along_curve(oscillator, wanted, curve, row)
    push = row[col.STIFFENING] * row[col.AMPLITUDE]  # P [m]
    if done == col.GOOD and rebounds(oscillator, push):
        done = col.NOT_CONVERGED
    return done


@kernel
def new_curve_workspace(lever: np.ndarray, tables: np.ndarray) -> CurveWorkspace:
    """A workspace for the orbits of this lever."""
    return CurveWorkspace(new_orbit(lever, tables), new_orbit(lever, tables), new_orbit(lever, tables))
