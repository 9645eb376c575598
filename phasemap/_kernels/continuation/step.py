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
from phasemap._kernels.compilation import kernel
from phasemap._kernels.continuation.cubic import AT_FOLD, cubic_slopes, hermite, place_on_cubic, turns_twice_between
from phasemap._kernels.continuation.point import (
    ENTRY_A,
    ENTRY_M,
    ENTRY_P,
    ENTRY_S,
    ENTRY_SEEN,
    ENTRY_Z0,
    Point,
    answer_entry,
    axis_scales,
    control_entry,
    gap_scale,
    natural_length,
    scaled_direction,
    solve_in_plane,
    solve_tangent,
    tangent_row,
)
from phasemap._kernels.excitation import detected_amplitude_of_orbit, detected_amplitude_rate
from phasemap._kernels.law import has_hysteresis
from phasemap._kernels.numerics import copy_rows
from phasemap._kernels.orbits.collocation.closing import apply_step, solve_step
from phasemap._kernels.orbits.collocation.contacts_and_necks import times_left
from phasemap._kernels.orbits.collocation.elements import lay_again
from phasemap._kernels.orbits.collocation.held_equation import Equation, hold_amplitude
from phasemap._kernels.orbits.collocation.newton import NewtonLimits, solve_orbit
from phasemap._kernels.orbits.collocation.path import Path, drift_at, held_equation, oscillator_at
from phasemap._kernels.orbits.collocation.stability import determinant_of_return, floquet
from phasemap._kernels.orbits.collocation.system import (
    EQUATIONS_OTHER,
    RA,
    RIGHT,
    RM,
    RP,
    RS,
    RZ,
    Head,
    Orbit,
    element_of,
    head_of,
    mode_count,
    motion_of_mode,
    new_orbit_like,
)
from phasemap._kernels.records import assign

# Steps, in the scaled coordinates.
FIRST_ARC_STEP = 0.3
LARGEST_ARC_STEP = 0.8
SMALLEST_ARC_STEP = 1e-7
STEP_AFTER_FAILURE = 0.4  # times as long is a step after one that failed
CORNER = 2e-3  # a step this short may turn by any angle: grazing a force that jumps is a corner; with a neck, an end
COARSELY = 1e-3  # of the natural length of the gap, last change of an orbit on the way along the curve
MOST_COARSE_STEPS = 8  # of Newton's method to an orbit on the way
MOST_EXACT_STEPS = 20  # and to one that is wanted
LEAST_ALIGNMENT = 0.7  # cosine of the angle that a step may turn the tangent by: more may be another piece
EASY_STEPS, EASY_ALIGNMENT, EASY_GROWTH = 3, 0.97, 1.5  # a step so easy is followed by one that is longer
HARD_STEPS, HARD_GROWTH = 4, 0.6  # a step that takes more is followed by a shorter one
SLACK_BETWEEN = 0.05  # of the way between two points, by which a crossing may lie outside of it in the other coordinate
SLACK_ACROSS = 1e-3  # the same, of what moves across it
AMPLIFIED = 1e-2  # of the tip offset per amplitude, by which the last change allowed grows where rounding does
MOST_PARTS_OF_STEP = 12  # of a step that is followed again to a crossing
LEAST_PART, MOST_PART = 0.1, 0.9  # of what is left of it, by which it is cut


class Wanted(NamedTuple):
    """Entry of a point of the curve, and the value of it at which an orbit is wanted."""

    entry: int
    value: float
    tolerance: float  # last change of the orbit [m]


class Place(NamedTuple):
    """A point of the curve and its orbit."""

    point: Point
    orbit: Orbit


@kernel
def copy_orbit(source: Orbit, to: Orbit) -> None:
    """Copy an orbit with its elements, motion and equations."""
    for e in range(head_of(source).count + 1):
        assign(element_of(to, e), element_of(source, e))
    assign(head_of(to), head_of(source))
    copy_rows(source.chained, to.chained)
    copy_rows(source.system, to.system)
    for e in range(head_of(source).count + 1):
        for i in range(mode_count(source)):
            assign(motion_of_mode(to, e, i), motion_of_mode(source, e, i))
        copy_rows(source.chain[e], to.chain[e])
        if e < head_of(source).count:
            copy_rows(source.forces[e], to.forces[e])


@kernel
def move_along(head: Head, by: float, point: Point) -> None:
    """Move the values of an orbit along the curve at a point."""
    head.tip_offset += by * point.rate[ENTRY_Z0]
    head.amplitude += by * point.rate[ENTRY_A]
    head.parameter += by * point.rate[ENTRY_M]
    head.push += by * point.rate[ENTRY_P]
    head.drag += by * point.rate[ENTRY_S]


@kernel(shared=True)
def relay_orbit(path: Path, orbit: Orbit) -> bool:
    """Lay the elements of an orbit anew where a change of its values has moved its contacts."""
    return lay_again(oscillator_at(path, head_of(orbit).parameter), orbit, head_of(orbit).level)


@kernel(shared=True)
def predict(path: Path, orbit: Orbit, row: tuple[float, float, float], target: tuple[float, float, float]) -> bool:
    """Move an orbit whose equations are known along the curve's tangent, to row (z0, A, m) = row target."""
    m = head_of(orbit).parameter
    lever, drift = oscillator_at(path, m).lever, drift_at(path, m)
    right = row[0] * target[0] + row[1] * target[1] + row[2] * target[2]
    held = held_equation(path, lever, orbit, drift), Equation(row[0], row[1], row[2], right, 0.0, 0.0)
    if not solve_step(lever, orbit, drift, held):
        return False
    apply_step(lever, orbit, 1.0)
    return True


@kernel(shared=True)
def mark_point(path: Path, orbit: Orbit, point: Point) -> bool:
    """Fill a point of the curve at a converged orbit; the tangent in it, that of the point before, gives the sense."""
    head, right, value = head_of(orbit), orbit.system[:, RIGHT], point.value
    reach = natural_length(path, orbit)
    value[ENTRY_Z0], value[ENTRY_A], value[ENTRY_M] = head.tip_offset, head.amplitude, head.parameter
    value[ENTRY_P], value[ENTRY_S] = head.push, head.drag
    if not solve_tangent(path, orbit, tangent_row(path, reach, point)):
        return False
    dz, da, dm = right[RZ], right[RA], right[RM]
    t_u, t_v = scaled_direction(path, reach, point, dz, da, dm)
    length = math.hypot(t_u, t_v)
    states = 2 * mode_count(orbit)
    point.floquet = floquet(head.transfer, states)
    point.determinant = determinant_of_return(head.transfer, states)
    point.tangent_u, point.tangent_v = t_u / length, t_v / length
    point.rate[ENTRY_Z0], point.rate[ENTRY_A], point.rate[ENTRY_M] = dz / length, da / length, dm / length
    point.rate[ENTRY_P], point.rate[ENTRY_S] = right[RP] / length, right[RS] / length
    lever = oscillator_at(path, head.parameter).lever
    harmonic = head.amplitude, head.push, head.drag
    rates = point.rate[ENTRY_A], point.rate[ENTRY_P], point.rate[ENTRY_S]
    value[ENTRY_SEEN], point.rate[ENTRY_SEEN] = (
        detected_amplitude_of_orbit(lever, *harmonic),
        detected_amplitude_rate(lever, harmonic, rates),
    )
    return math.isfinite(length)


@kernel
def same_piece(path: Path, reach: float, before: Point, point: Point) -> bool:
    """True if the curve keeps its orientation between two points.

    Where the amplitude is free, dz0 (or dm) and det(1 - monodromy) change sign together along one curve, at folds.
    Where only one does, the step has landed on a neighbouring piece that runs the other way. At a fold itself both are
    nothing but rounding. See theory, Eq. (continuation-3).
    """
    entry = control_entry(path)
    if (
        answer_entry(path) != ENTRY_A
        or abs(point.rate[entry]) < AT_FOLD * axis_scales(path, reach, point.value[ENTRY_Z0], point.value[ENTRY_A])[0]
    ):
        return True
    return before.rate[entry] * before.determinant * point.rate[entry] * point.determinant >= 0.0


@kernel(shared=True)
def next_point(path: Path, point: Point, step: float, orbit: Orbit, saved: Orbit) -> tuple[int, float]:
    """Go to the next point of the curve; returns a status, and the step to try next.

    `saved` and `point` receive the orbit and the point that were left.
    """
    copy_orbit(orbit, saved)
    before = Point()
    assign(before, point)
    reach = natural_length(path, orbit)
    coarse = COARSELY * gap_scale(reach, point.value[ENTRY_Z0], point.value[ENTRY_A])
    left, hysteretic = times_left(head_of(orbit)), has_hysteresis(oscillator_at(path, head_of(orbit).parameter).p)
    row = tangent_row(path, reach, before)
    while step > SMALLEST_ARC_STEP:
        move_along(head_of(orbit), step, before)
        if head_of(orbit).amplitude > 0.0 and relay_orbit(path, orbit):
            status, steps = solve_in_plane(path, orbit, row, coarse, MOST_COARSE_STEPS, True)
            # With a neck the curve ends where a contact is made, or no longer lost.
            if status == col.GOOD and not (hysteretic and times_left(head_of(orbit)) != left):
                assign(point, before)
                good = mark_point(path, orbit, point)
                turn = point.tangent_u * before.tangent_u + point.tangent_v * before.tangent_v
                point.length = step
                if hysteretic or step >= CORNER:
                    good = good and turn > LEAST_ALIGNMENT and same_piece(path, reach, before, point)
                    good = good and not turns_twice_between(path, reach, before, point)
                if good:
                    easy = steps <= EASY_STEPS and turn > EASY_ALIGNMENT
                    growth = EASY_GROWTH if easy else 1.0 if steps <= HARD_STEPS else HARD_GROWTH
                    return col.GOOD, min(step * growth, LARGEST_ARC_STEP)
        copy_orbit(saved, orbit)
        step *= STEP_AFTER_FAILURE
    assign(point, before)
    return col.NOT_CONVERGED, step


@kernel
def _move_to_crossing(path: Path, wanted: Wanted, last: Point, after: Point, orbit: Orbit) -> bool:
    """Move an orbit near by to where the cubic between two points has the value wanted; False if it cannot be moved."""
    index, value, _ = wanted
    head, guess = head_of(orbit), np.empty(5)
    by_one, by_two = cubic_slopes(path, natural_length(path, orbit), last, after)
    x_last, x_after = last.value[index], after.value[index]
    t = place_on_cubic(x_last, by_one * last.rate[index], x_after, by_two * after.rate[index], value)
    for i in range(5):
        guess[i] = hermite(last.value[i], by_one * last.rate[i], after.value[i], by_two * after.rate[i], t)
    if index != ENTRY_SEEN:  # that follows from the others, which the cubic gives
        guess[index] = value
    way, to = tangent_row(path, natural_length(path, orbit), after), (guess[ENTRY_Z0], guess[ENTRY_A], guess[ENTRY_M])
    # With other equations in its system there is no derivative along the curve for `predict`: the guess has to do.
    if head.equations != EQUATIONS_OTHER and not predict(path, orbit, way, to):
        return False
    head.tip_offset, head.amplitude, head.parameter = to
    head.push, head.drag = guess[ENTRY_P], guess[ENTRY_S]
    return relay_orbit(path, orbit)


@kernel
def _lies_between(path: Path, index: int, last: Point, here: Point, after: Point, orbit: Orbit) -> bool:
    """True if a point crosses a value of an entry in the sense of two points and is between them in the other entry."""
    other = answer_entry(path) if index == control_entry(path) else control_entry(path)
    low, high = min(last.value[other], after.value[other]), max(last.value[other], after.value[other])
    slack = SLACK_BETWEEN * (high - low)
    if index != ENTRY_M:
        slack += SLACK_ACROSS * abs(last.value[index] - after.value[index])
    else:
        slack += SLACK_ACROSS * gap_scale(natural_length(path, orbit), here.value[ENTRY_Z0], here.value[ENTRY_A])
    if not low - slack <= here.value[other] <= high + slack:
        return False
    return here.rate[index] * (after.value[index] - last.value[index]) > 0.0


@kernel(shared=True)
def solve_at_crossing(path: Path, wanted: Wanted, last: Point, after: Point, orbit: Orbit) -> bool:
    """Solve for the orbit near by at which an entry has the value wanted, between two points; False if there is none.

    Its own tangent must cross the value in the sense of the two points: a pair of crossings may lie close together.
    The first point, `last`, becomes the one that is found.
    """
    index, value, tolerance = wanted
    if not _move_to_crossing(path, wanted, last, after, orbit):
        return False
    if index == ENTRY_SEEN:
        limits = NewtonLimits(head_of(orbit).level, tolerance, MOST_EXACT_STEPS, coarse=False, along=True, seen=value)
        status, _ = solve_orbit(path, orbit, hold_amplitude(orbit), limits)
    else:
        row = (1.0 if index == ENTRY_Z0 else 0.0, 1.0 if index == ENTRY_A else 0.0, 1.0 if index == ENTRY_M else 0.0)
        status, _ = solve_in_plane(path, orbit, row, tolerance, MOST_EXACT_STEPS, False)
    here = Point()
    assign(here, after)
    if status != col.GOOD or not mark_point(path, orbit, here):
        return False
    if not _lies_between(path, index, last, here, after, orbit):
        return False
    assign(last, here)
    return True


@kernel
def find_crossing(path: Path, wanted: Wanted, start: Place, last: Point, after: Point, orbit: Orbit) -> bool:
    """Find the orbit where an entry has the value wanted between two places; False where none is found.

    `orbit`, one near by, becomes the orbit found, and `last`, a point between the first and the value, its point. Where
    Newton's method lands on another piece of the curve, the curve is followed again from the start in shorter steps.
    """
    before = start.point
    index, value, tolerance = wanted
    if index == ENTRY_A or index == ENTRY_SEEN:
        # Pressed into a soft surface, the lever moves far for little amplitude: rounding is amplified so much.
        far = (after.value[ENTRY_Z0] - before.value[ENTRY_Z0]) / (after.value[index] - before.value[index])
        tolerance *= max(1.0, AMPLIFIED * abs(far))
    wanted = Wanted(index, value, tolerance)
    if solve_at_crossing(path, wanted, last, after, orbit):
        return True
    low, high, spare, begin_orbit = Point(), Point(), new_orbit_like(orbit), new_orbit_like(orbit)
    assign(low, before)
    assign(high, after)
    copy_orbit(start.orbit, begin_orbit)
    for _ in range(MOST_PARTS_OF_STEP):
        copy_orbit(begin_orbit, orbit)
        between = Point()
        assign(between, low)
        share = (value - low.value[index]) / (high.value[index] - low.value[index])
        step = high.length * min(max(share, LEAST_PART), MOST_PART)
        status, _ = next_point(path, between, step, orbit, spare)
        if status != col.GOOD:
            return False
        if (between.value[index] > value) == (high.value[index] > value):
            assign(high, between)
        else:
            high.length -= between.length
            assign(low, between)
            copy_orbit(orbit, begin_orbit)
        assign(last, low)
        if solve_at_crossing(path, wanted, last, high, orbit):
            return True
    assign(last, before)
    return False
