"""A whole piece of a curve of orbits: a row for each orbit wanted, each fold, and the orbits on the way."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.continuation.point import (
    ENTRY_A,
    ENTRY_M,
    ENTRY_SEEN,
    ENTRY_Z0,
    OF_AMPLITUDE,
    Point,
    axis_scales,
    control_entry,
    natural_length,
    scaled_direction,
    solve_in_plane,
    tangent_row,
)
from phasemap._kernels.continuation.step import (
    FIRST_ARC_STEP,
    MOST_EXACT_STEPS,
    SMALLEST_ARC_STEP,
    STEP_AFTER_FAILURE,
    Place,
    Wanted,
    copy_orbit,
    find_crossing,
    mark_point,
    next_point,
    relay_orbit,
    same_piece,
)
from phasemap._kernels.excitation import detected_amplitude_of_orbit, detected_amplitude_rate
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever import phase_of
from phasemap._kernels.numerics import copy, copy_rows, count_smaller, narrow_bracket
from phasemap._kernels.orbits.collocation.closing import curve_derivative
from phasemap._kernels.orbits.collocation.contacts_and_necks import is_grazing
from phasemap._kernels.orbits.collocation.errors import estimate_errors, fill_errors_as_seen, slopes_along_curve
from phasemap._kernels.orbits.collocation.held_equation import hold_amplitude, hold_parameter
from phasemap._kernels.orbits.collocation.near import solve_near, tolerance_of
from phasemap._kernels.orbits.collocation.newton import MOST_NEWTON_STEPS, force_jumps, last_step_within_tolerance
from phasemap._kernels.orbits.collocation.observables import complete_row, fill_observables, time_trace
from phasemap._kernels.orbits.collocation.path import Path, oscillator_at
from phasemap._kernels.orbits.collocation.system import (
    EQUATIONS_KEPT,
    RIGHT,
    RP,
    RS,
    RZ,
    Head,
    Orbit,
    head_of,
    new_orbit_like,
    no_drift,
)
from phasemap._kernels.orbits.harmonic_orbit import HarmonicOrbit, load_harmonic_orbit
from phasemap._kernels.records import assign, clear, rows_of

MOST_PIECE_POINTS = 4000
FOLD_LEVEL = 2  # level of refinement at a fold, whose place is wanted more exactly than an orbit's
FOLD_FLAT, FOLD_ROUGH = 1e-9, 1e-6  # of its value at the points beside it: where dx/ds is as small, the curve turns
MOST_FOLD_STEPS = 40
LEAST_FOLD_PART = 0.02  # of a bracket of the fold, by which each of these cuts it
CLOSED_BRACKET = 1e-12  # [1], length of a bracket that holds nothing more: no fold was found
FEWEST_POINTS_ROUND = 8  # of a curve that closes
FOLD_PLACE = 1e-9  # of its natural length, by which x still changes up to where it turns: the fold is known
NEAR_FOLD = 0.05  # of the control's natural length, along the curve: slower, it may be turning
CURVE_TOLERANCE = 0.1  # last change of an orbit of a curve, over that of a pixel's
SAME_SENSE = 0.5  # cosine of the angle between tangents that go round a closed curve the same way
AT_JUMP = 1e-3  # of the amplitude: as near to contact made or lost, with which the force jumps, a curve ends
# How a piece ends: where it leaves the box, where it began, at such a jump; or no step succeeds, or there is no room.
PIECE_LEFT = 0
PIECE_CLOSED = 1
PIECE_AT_JUMP = 2
PIECE_STUCK = 3
PIECE_FULL = 4


class Asked(NamedTuple):
    """Values at which orbits of a curve are asked for, the box that it is followed in, and how exactly."""

    entry: int  # of a point, whose values are wanted: the control, or the amplitude, of z or as seen
    wanted: np.ndarray  # sorted; values at which rows are made
    box: tuple[float, float, float]  # smallest and largest control, smallest amplitude: where the curve is left
    tolerance: float  # last change [m] of an orbit
    level: int  # of refinement, at least, of the orbits wanted


class KeptOrbits(NamedTuple):
    """The first orbits at values wanted: arrays of an `Orbit`, one after another; a row for each head."""

    elements: np.ndarray
    heads: np.ndarray
    modes: np.ndarray


head_kept = rows_of(Head, KeptOrbits, "heads")


class Made(NamedTuple):
    """Full rows of orbits, shape (n, FULL), their time traces, shape (n, 2, samples), and orbits themselves."""

    rows: np.ndarray
    traces: np.ndarray
    kept: KeptOrbits


@kernel
def _keep_orbit(orbit: Orbit, kept: KeptOrbits) -> None:
    """Copy an orbit to the first free place among those kept, if there is one."""
    for i in range(len(kept.heads)):
        if head_kept(kept, i).count == 0:
            copy_rows(orbit.elements, kept.elements[i])
            copy_rows(orbit.modes, kept.modes[i])
            copy(orbit.head[0], kept.heads[i])
            return


@kernel
def add_row(path: Path, orbit: Orbit, kind: int, index: int, made: Made, count: int) -> int:
    """Write the full row of a marked orbit, and its time trace; returns how many rows there are."""
    if count == len(made.rows):
        return count
    row, oscillator = made.rows[count], oscillator_at(path, head_of(orbit).parameter)
    lever = oscillator.lever
    row[:] = math.nan
    fill_observables(oscillator, orbit, row[: col.COLUMNS])
    harmonic = head_of(orbit).amplitude, head_of(orbit).push, head_of(orbit).drag
    row[col.SEEN] = detected_amplitude_of_orbit(lever, *harmonic)
    if curve_derivative(lever, orbit, no_drift(), (hold_parameter(orbit), hold_amplitude(orbit))):
        rate = detected_amplitude_rate(lever, harmonic, (1.0, orbit.system[RP, RIGHT], orbit.system[RS, RIGHT]))
        row[col.SLOPE] = rate / orbit.system[RZ, RIGHT]
    complete_row(oscillator, orbit, row)
    row[col.PARAMETER], row[col.KIND], row[col.INDEX] = head_of(orbit).parameter, kind, index
    if made.traces.shape[2] > 0:
        time_trace(oscillator, orbit, row[col.PHASE], made.traces[count])
    return count + 1


@kernel
def fill_errors(oscillator: Oscillator, orbit: Orbit, asked: Asked, row: np.ndarray) -> None:
    """Fill the errors of an orbit wanted at its amplitude, or at what the detector sees, into its full row."""
    lever, slope = oscillator.lever, row[col.SLOPE]
    along = slopes_along_curve(lever, orbit)
    row[col.SLOPE] = slope / along.seen  # that of A, for which they are estimated first
    estimate_errors(oscillator, orbit, row)
    if asked.entry == ENTRY_SEEN:
        fill_errors_as_seen(lever, row[col.SEEN], along, row)
    row[col.SLOPE] = slope


@kernel
def make_exact(path: Path, orbit: Orbit, point: Point, tolerance: float) -> bool:
    """Solve exactly, in the plane across the curve, for the orbit of a point that was solved coarsely on the way."""
    lever, reach = oscillator_at(path, head_of(orbit).parameter).lever, natural_length(path, orbit)
    along = axis_scales(path, reach, point.value[ENTRY_Z0], point.value[ENTRY_A])[0]
    turning = abs(point.rate[control_entry(path)]) < NEAR_FOLD * along
    if (
        head_of(orbit).equations == EQUATIONS_KEPT
        and last_step_within_tolerance(lever, orbit, tolerance)
        and not turning
    ):
        return True
    if turning:  # elements beside the contact do not say on which side of a fold it is
        relay_orbit(path, orbit)
    row = tangent_row(path, reach, point)
    status, _ = solve_in_plane(path, orbit, row, tolerance, MOST_EXACT_STEPS, False)
    return status == col.GOOD and mark_point(path, orbit, point)


@kernel
def next_exact_point(
    path: Path, point: Point, step: float, tolerance: float, orbit: Orbit, saved: Orbit
) -> tuple[bool, float]:
    """Go to the next point of the curve and make its orbit exact; by a shorter step if that fails at a sharp turn."""
    before = Point()
    assign(before, point)
    while step > SMALLEST_ARC_STEP:
        status, following = next_point(path, point, step, orbit, saved)
        if status != col.GOOD:
            break
        step = point.length
        good = make_exact(path, orbit, point, tolerance)
        point.length = step
        if good and same_piece(path, natural_length(path, orbit), before, point):
            return True, following
        assign(point, before)
        copy_orbit(saved, orbit)
        step *= STEP_AFTER_FAILURE
    return False, step


@kernel
def turn_between(
    path: Path, start: Place, after: Point, entry: int, level: int, tolerance: float, orbit: Orbit, point: Point
) -> bool:
    """Find the point of a curve between `start` and `after` at which an entry of it is extreme: dx/ds = 0.

    By false position in the arclength s: theory, Eq. (continuation-5). `entry` names the value x, as ENTRY_Z0 and
    ENTRY_A do; `point` and `orbit`, of this level of refinement, are filled. False if no such point is found.

    There x is exact to rounding, and the other values as exact as s is. A long step round a sharp turn may fail; the
    next one then starts where a shorter one ended.
    """
    begun, base, spare, passed = Point(), new_orbit_like(orbit), new_orbit_like(orbit), 0.0
    assign(begun, start.point)
    copy_orbit(start.orbit, base)
    head_of(base).level = level
    near, f_near, far, f_far = 0.0, begun.rate[entry], after.length, after.rate[entry]
    rises, most = f_near > 0.0, max(abs(f_near), abs(f_far))
    steep, natural = (abs(f_near) + abs(f_far)) / after.length, OF_AMPLITUDE * begun.value[ENTRY_A]
    if entry == control_entry(path):
        natural = axis_scales(path, natural_length(path, base), begun.value[ENTRY_Z0], begun.value[ENTRY_A])[0]
    for _ in range(MOST_FOLD_STEPS):
        share = f_near / (f_near - f_far)
        step = near + (far - near) * min(max(share, LEAST_FOLD_PART), 1.0 - LEAST_FOLD_PART)
        copy_orbit(base, orbit)
        assign(point, begun)
        status, _ = next_point(path, point, step, orbit, spare)
        if status != col.GOOD:
            return False
        reached = point.length
        good = make_exact(path, orbit, point, tolerance)
        if not good:
            return False
        point.length = passed + reached
        f = point.rate[entry]
        # Flat, or so near that x has less than FOLD_PLACE to go: f^2 / (2 x''), with `steep` for its second derivative.
        if abs(f) <= FOLD_FLAT * most or 0.5 * f * f <= FOLD_PLACE * natural * steep:
            return True
        if abs(far - near) < CLOSED_BRACKET:
            return False
        near, f_near, far, f_far = narrow_bracket(near, f_near, far, f_far, reached, f)
        if reached < step and (f > 0.0) == rises:  # a step that was cut short: the next begins where it ended
            assign(begun, point)
            copy_orbit(orbit, base)
            passed, near, far = passed + reached, near - reached, far - reached
    return abs(point.rate[entry]) <= FOLD_ROUGH * most


@kernel
def add_wanted_rows(path: Path, asked: Asked, start: Place, end: Place, crossing: Orbit, made: Made, count: int) -> int:
    """Record the orbits at the values wanted between two places, in the order in which they come."""
    index, wanted, tolerance = asked.entry, asked.wanted, asked.tolerance
    before, after, beside = start.point, end.point, Point()
    assign(beside, before)
    x, y = before.value[index], after.value[index]
    rising = y > x  # the value at which a step starts belongs to the step before
    first, last = count_smaller(wanted, min(x, y), rising), count_smaller(wanted, max(x, y), rising)
    for i in range(last - first):
        k = first + i if rising else last - 1 - i
        if i == 0:
            copy_orbit(start.orbit, crossing)
        head_of(crossing).level = max(head_of(crossing).level, asked.level)
        good = find_crossing(path, Wanted(index, wanted[k], tolerance), start, beside, after, crossing)
        if not good:
            copy_orbit(end.orbit, crossing)
        else:
            now = add_row(path, crossing, col.WANTED, k, made, count)
            if now > count and (index == ENTRY_A or index == ENTRY_SEEN):
                fill_errors(oscillator_at(path, head_of(crossing).parameter), crossing, asked, made.rows[count])
            if now > count:
                _keep_orbit(crossing, made.kept)
            count = now
    return count


@kernel
def follow_piece(path: Path, asked: Asked, orbit: Orbit, point: Point, made: Made) -> tuple[int, int]:
    """Follow the curve from a marked point, in the sense of its tangent, until it leaves the box, ends, or closes.

    Returns how it ended, PIECE_LEFT to PIECE_FULL, and the number of rows made, in the order of the curve.
    """
    saved, crossing, top, tops = (
        new_orbit_like(orbit),
        new_orbit_like(orbit),
        new_orbit_like(orbit),
        (new_orbit_like(orbit), new_orbit_like(orbit)),
    )
    turned, entries = (Point(), Point()), np.zeros(2, np.int64)
    origin, before, after, step = Point(), Point(), Point(), FIRST_ARC_STEP
    assign(origin, point)
    count = add_row(path, orbit, col.ON_THE_WAY, -1, made, 0)
    lowest, highest, least = asked.box
    for points in range(MOST_PIECE_POINTS):
        assign(before, point)
        good, step = next_exact_point(path, point, step, asked.tolerance, orbit, saved)
        if not good:
            made.rows[count - 1, col.KIND] = col.END
            oscillator = oscillator_at(path, head_of(orbit).parameter)
            grazes = force_jumps(oscillator) and is_grazing(oscillator.p, orbit, AT_JUMP * head_of(orbit).amplitude)
            return PIECE_AT_JUMP if grazes else PIECE_STUCK, count
        # Where the control or the entry wanted turns, the step is divided.
        turns, start = 0, Place(before, saved)
        for entry in (control_entry(path), asked.entry):
            if before.rate[entry] * point.rate[entry] < 0.0 and not (turns == 1 and entries[0] == entry):
                good = False
                for level in (FOLD_LEVEL, head_of(orbit).level):
                    if not good:
                        good = turn_between(path, start, point, entry, level, asked.tolerance, top, turned[turns])
                if good:
                    copy_orbit(top, tops[turns])
                    entries[turns] = entry
                    turns += 1
        swapped, done = turns == 2 and turned[1].length < turned[0].length, 0.0
        for i in range(turns):
            which = 1 - i if swapped else i
            turn, length = Place(turned[which], tops[which]), turned[which].length
            turn.point.length -= done
            count = add_wanted_rows(path, asked, start, turn, crossing, made, count)
            kind = col.FOLD if entries[which] == control_entry(path) else col.TURN
            count = add_row(path, tops[which], kind, -1, made, count)
            start, done = turn, length
        assign(after, point)
        after.length -= done
        count = add_wanted_rows(path, asked, start, Place(after, orbit), crossing, made, count)
        if count == len(made.rows):
            return PIECE_FULL, count
        if not lowest <= point.value[control_entry(path)] <= highest or point.value[ENTRY_A] < least:
            return PIECE_LEFT, count
        count = add_row(path, orbit, col.ON_THE_WAY, -1, made, count)
        if points > FEWEST_POINTS_ROUND and has_closed(path, orbit, origin, point):
            return PIECE_CLOSED, count
    return PIECE_FULL, count


@kernel
def has_closed(path: Path, orbit: Orbit, origin: Point, point: Point) -> bool:
    """True if the curve has come back to the point where it was begun."""
    back = origin.value - point.value
    away = scaled_direction(path, natural_length(path, orbit), point, back[ENTRY_Z0], back[ENTRY_A], back[ENTRY_M])
    same = origin.tangent_u * point.tangent_u + origin.tangent_v * point.tangent_v > SAME_SENSE
    return same and math.hypot(away[0], away[1]) < point.length


@kernel
def mark_start(path: Path, orbit: Orbit, sense: float, point: Point) -> bool:
    """Mark an exact orbit with the tangent along which the control rises (sense 1) or falls (-1)."""
    clear(point)
    # A row that is the control's own, whatever the scales.
    reach = natural_length(path, orbit)
    z0, a, m = head_of(orbit).tip_offset, head_of(orbit).amplitude, head_of(orbit).parameter
    point.value[ENTRY_Z0], point.value[ENTRY_A], point.value[ENTRY_M] = z0, a, m
    at_z, at_m = (sense, 0.0) if control_entry(path) == ENTRY_Z0 else (0.0, sense)
    point.tangent_u, point.tangent_v = scaled_direction(path, reach, point, at_z, 0.0, at_m)
    if control_entry(path) == ENTRY_Z0:
        of_gap, of_amplitude = axis_scales(path, reach, z0, a)
        point.tangent_v = point.tangent_u * of_amplitude / of_gap
    return mark_point(path, orbit, point)


@kernel
def collocation_orbits_at(
    path: Path, harmonics: np.ndarray, m: np.ndarray, hold: int, orbit: Orbit, found: np.ndarray
) -> int:
    """Go from harmonic orbits, shape (n, HARMONIC_WORDS), to the exact ones at these m of the path.

    `hold`: HOLD_OFFSET or HOLD_AMPLITUDE.
    `found`, shape (n, COLUMNS): TIP_OFFSET, AMPLITUDE, PHASE, STIFFENING and, where it is known, FLOQUET are filled in.
    Returns how many were found before Newton's method did not converge; `orbit` is left the last one.
    """
    point, harmonic = Point(), HarmonicOrbit()
    for i in range(len(harmonics)):
        oscillator, head, row = oscillator_at(path, m[i]), head_of(orbit), found[i]
        load_harmonic_orbit(harmonics[i], harmonic)
        if not harmonic.amplitude > 0.0:
            return i
        tolerance = CURVE_TOLERANCE * tolerance_of(oscillator)
        done, _, _ = solve_near(path, harmonic, m[i], hold, False, tolerance, MOST_NEWTON_STEPS, orbit)
        if done != col.GOOD or not head.amplitude > 0.0:
            return i
        row[col.TIP_OFFSET], row[col.AMPLITUDE] = head.tip_offset, head.amplitude
        row[col.PHASE] = phase_of(oscillator.lever, head.amplitude, head.push, head.drag)
        row[col.STIFFENING] = head.push / head.amplitude
        if mark_start(path, orbit, 1.0, point):
            row[col.FLOQUET] = point.floquet
    return len(harmonics)
