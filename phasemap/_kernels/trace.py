"""The curve of exact periodic orbits at fixed drive, followed from far through every fold.

Pseudo-arclength continuation in the plane of tip offset and amplitude: each step predicts along the tangent and
corrects in the plane across it, so that folds are passed like any other point. Three readers of the curve stand here:
`engage` visits what a quasi-static approach visits (see `phasemap._kernels.approach`), `engage_near` does so from an
amplitude at which there is no doubt, `collect` notes every crossing.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from phasemap._kernels import columns as col
from phasemap._kernels.approach import averaged_orbits, caution, far_start, free_amplitude, scale_of
from phasemap._kernels.collocation import (
    CONTACTS,
    COUNT,
    ELEMENTS,
    HOLD_AMPLITUDE,
    HOLD_ARC,
    LEVEL,
    RA,
    RIGHT,
    RP,
    RS,
    RZ,
    SYSTEM,
    TRANSFER,
    VALUE,
    Z0,
    A,
    Orbit,
    P,
    S,
    along,
    linearise,
    new_orbit,
)
from phasemap._kernels.law import OPTIONS, Law
from phasemap._kernels.mesh import PERMANENT, carry_over, find_contacts, lay, reach_of
from phasemap._kernels.orbit import begin, finish, floquet, newton
from phasemap._kernels.resonance import ATTRACTIVE, MAXIMUM, decide, on_side
from phasemap._kernels.snap import HANGING, land, lets_go, loosened, pressed_in, pulled

MOST_POINTS = 1500
CAUGHT = 0.03  # the curve is left where the tip hardly moves any more, relative to the setpoint
FARTHEST = 300.0  # the curve is left where the lever is pressed down by so many free amplitudes
NEAR_END = 2e-3  # of the setpoint: nearer than this to the end of a branch, the whole curve is followed
FIRST_STEP, LARGEST_STEP, SMALLEST_STEP = 0.3, 0.8, 1e-7
FARTHEST_AT_ALL = 1e-2  # [m], the same whatever the amplitude
NEAR = 0.05  # of the free amplitude, from where the tip lands to the branch on which it taps on
CORNER = 2e-3  # a step this short may turn by any angle: grazing a force that jumps is a corner of the curve
# Entries of a point of the curve: tip offset, amplitude, largest Floquet multiplier, the unit tangent in scaled gap and
# amplitude, the derivatives of z0, A, P and S along it, the length of the step that led there, and det(1 - monodromy).
ZP, AP, FP, TG, TA, DZ, DA, DP, DS, LENGTH, DET, POINT = 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11


@njit(**OPTIONS)
def copy_orbit(source: Orbit, to: Orbit) -> None:
    """Copy an orbit."""
    count = int(source.head[COUNT, ELEMENTS]) + 1
    to.elements[:count] = source.elements[:count]
    to.head[:] = source.head


@njit(**OPTIONS)
def relay(law: Law, p: np.ndarray, lever: np.ndarray, tables: np.ndarray, orbit: Orbit, spare: Orbit) -> bool:
    """Lay `spare` for the contacts of `orbit` as its values stand now, and carry the orbit over."""
    if not find_contacts(tables, orbit) or not lay(law, p, lever, tables, spare, orbit, int(orbit.head[COUNT, LEVEL])):
        return False
    carry_over(tables, orbit, spare)
    return True


@njit(**OPTIONS)
def start_far(
    law: Law,
    p: np.ndarray,
    lever: np.ndarray,
    tables: np.ndarray,
    orbit: Orbit,
    spare: Orbit,
    amplitude: float,
    level: int,
) -> tuple[int, Orbit, Orbit]:
    """Find the orbit far from the surface, where the lever swings almost freely."""
    free = free_amplitude(lever)
    guess = np.array([free * far_start(law, p, lever, reach_of(law, p), free, amplitude), 0.0, free, 0.0, 0.0])
    target = np.array([1.0, -1.0, guess[0], free])
    if not begin(law, p, lever, tables, orbit, guess, level):
        return col.NOT_CONVERGED, orbit, spare
    tolerance = 1e-3 * scale_of(law, p, lever, free)
    status, _, orbit, spare = newton(law, p, lever, tables, orbit, spare, HOLD_ARC, target, level, tolerance, 30)
    return status, orbit, spare


@njit(**OPTIONS)
def row_of(reach: float, point: np.ndarray) -> tuple[float, float]:
    """The tangent as a row for (dz0, dA), made from the scaled coordinates (gap z0 - A, amplitude)."""
    gap_scale, a_scale = scales(reach, point[ZP], point[AP])
    return point[TG], point[TA] * gap_scale / a_scale - point[TG]


@njit(**OPTIONS)
def scales(reach: float, z0: float, amplitude: float) -> tuple[float, float]:
    """Natural lengths at a point of the curve: of the gap z0 - A, and of A."""
    return 0.5 * reach + 0.25 * abs(z0 - amplitude), 0.2 * amplitude


@njit(**OPTIONS)
def mark(
    law: Law, p: np.ndarray, lever: np.ndarray, tables: np.ndarray, orbit: Orbit, reach: float, point: np.ndarray
) -> bool:
    """Fill a point of the curve at a converged orbit; the tangent it holds, of the point before, gives the sense."""
    z0, amplitude = orbit.head[VALUE, Z0], orbit.head[VALUE, A]
    point[ZP], point[AP] = z0, amplitude
    r_z, r_a = row_of(reach, point)
    if not linearise(law, p, lever, tables, orbit) or not along(lever, orbit, r_z, r_a):
        return False
    gap_scale, a_scale = scales(reach, z0, amplitude)
    t_gap = (orbit.head[SYSTEM + RZ, RIGHT] - orbit.head[SYSTEM + RA, RIGHT]) / gap_scale
    t_a = orbit.head[SYSTEM + RA, RIGHT] / a_scale
    length = math.hypot(t_gap, t_a)
    m = orbit.head[TRANSFER]
    point[FP] = floquet(m)
    point[DET] = 1.0 - m[0] - m[3] + m[0] * m[3] - m[1] * m[2]
    point[TG], point[TA] = t_gap / length, t_a / length
    point[DZ], point[DA] = orbit.head[SYSTEM + RZ, RIGHT] / length, orbit.head[SYSTEM + RA, RIGHT] / length
    point[DP], point[DS] = orbit.head[SYSTEM + RP, RIGHT] / length, orbit.head[SYSTEM + RS, RIGHT] / length
    return math.isfinite(length)


@njit(**OPTIONS)
def same_piece(before: np.ndarray, point: np.ndarray) -> bool:
    """Whether the curve keeps its orientation between two points.

    Along one curve dz0 and det(1 - monodromy) change sign together, at folds. Where only one does, the step has landed
    on a neighbouring piece that runs the other way.
    """
    return before[DZ] * before[DET] * point[DZ] * point[DET] >= 0.0


@njit(**OPTIONS)
def advance(
    law: Law,
    p: np.ndarray,
    lever: np.ndarray,
    tables: np.ndarray,
    reach: float,
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
    coarse = 1e-3 * scales(reach, point[ZP], point[AP])[0]
    while step > SMALLEST_STEP:
        z0, amplitude = before[ZP] + step * before[DZ], before[AP] + step * before[DA]
        orbit.head[VALUE, Z0], orbit.head[VALUE, A] = z0, amplitude
        orbit.head[VALUE, P] += step * before[DP]
        orbit.head[VALUE, S] += step * before[DS]
        if amplitude > 0.0 and relay(law, p, lever, tables, orbit, spare):
            orbit, spare = spare, orbit
            r_z, r_a = row_of(reach, before)
            target = np.array([r_z, r_a, z0, amplitude])
            status, steps, orbit, spare = newton(
                law, p, lever, tables, orbit, spare, HOLD_ARC, target, level, coarse, 8
            )
            if status == col.GOOD:
                point[:] = before
                good = mark(law, p, lever, tables, orbit, reach, point)
                turn = point[TG] * before[TG] + point[TA] * before[TA]
                if good and (step < CORNER or (turn > 0.7 and same_piece(before, point))):
                    point[LENGTH] = step
                    growth = 1.5 if steps <= 3 and turn > 0.97 else 1.0 if steps <= 4 else 0.6
                    return col.GOOD, min(step * growth, LARGEST_STEP), orbit, spare
        copy_orbit(saved, orbit)
        step *= 0.4
    point[:] = before
    return col.NOT_CONVERGED, step, orbit, spare


@njit(**OPTIONS)
def extreme_between(before: np.ndarray, point: np.ndarray, index: int, value: float) -> float:
    """Where to step instead if z0 or A (`index`) may just reach `value` and turn between two points; 0 if not.

    The extreme is that of the cubic through both points and slopes. It asks for a point there when `value` lies beyond
    both ends, on the side of the extreme and not far outside it, so that a pair of crossings is not stepped over.
    """
    slope = DA if index == AP else DZ
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
    if beyond * reached <= 0.0 or abs(beyond) > 1.5 * abs(reached) + 1e-3 * abs(point[index]) * length:
        return 0.0
    return t * length


@njit(**OPTIONS)
def advance_watching(
    law: Law,
    p: np.ndarray,
    lever: np.ndarray,
    tables: np.ndarray,
    reach: float,
    point: np.ndarray,
    step: float,
    index: int,
    value: float,
    orbit: Orbit,
    spare: Orbit,
    saved: Orbit,
) -> tuple[int, float, Orbit, Orbit]:
    """`advance`, with a point set on an extreme of z0 or A that may just reach `value`."""
    before = point.copy()
    status, following, orbit, spare = advance(law, p, lever, tables, reach, point, step, orbit, spare, saved)
    for _ in range(6):
        if status != col.GOOD:
            break
        instead = extreme_between(before, point, index, value)
        if instead == 0.0:
            break
        copy_orbit(saved, orbit)
        point[:] = before
        status, following, orbit, spare = advance(law, p, lever, tables, reach, point, instead, orbit, spare, saved)
    return status, following, orbit, spare


@njit(**OPTIONS)
def settle_on(
    law: Law,
    p: np.ndarray,
    lever: np.ndarray,
    tables: np.ndarray,
    reach: float,
    hold: int,
    value: float,
    before: np.ndarray,
    after: np.ndarray,
    near: np.ndarray,
    orbit: Orbit,
    spare: Orbit,
    tolerance: float,
) -> tuple[bool, Orbit, Orbit]:
    """From the orbit at the point `near`, go to amplitude or tip offset `value`; True if it lies between two points.

    Its own tangent must cross the value in the sense of the two points: a pair of crossings may lie close together.
    """
    index, other = (AP, ZP) if hold == HOLD_AMPLITUDE else (ZP, AP)
    share = (value - near[index]) / (before[index] - after[index])
    orbit.head[VALUE, Z0] += share * (before[ZP] - after[ZP])
    orbit.head[VALUE, A] += share * (before[AP] - after[AP])
    if hold == HOLD_AMPLITUDE:
        orbit.head[VALUE, A] = value
    target = np.array([value, 0.0, 0.0, 0.0])
    if not relay(law, p, lever, tables, orbit, spare):
        return False, orbit, spare
    orbit, spare = spare, orbit
    status, _, orbit, spare = newton(
        law, p, lever, tables, orbit, spare, hold, target, int(orbit.head[COUNT, LEVEL]), tolerance, 20
    )
    found = orbit.head[VALUE, Z0] if hold == HOLD_AMPLITUDE else orbit.head[VALUE, A]
    low, high = min(before[other], after[other]), max(before[other], after[other])
    slack = 0.05 * (high - low) + 1e-3 * abs(before[index] - after[index])
    if status != col.GOOD or not low - slack <= found <= high + slack:
        return False, orbit, spare
    here, slope = near.copy(), DA if hold == HOLD_AMPLITUDE else DZ
    good = mark(law, p, lever, tables, orbit, reach, here)
    return good and here[slope] * (after[index] - before[index]) > 0.0, orbit, spare


@njit(**OPTIONS)
def cross(
    law: Law,
    p: np.ndarray,
    lever: np.ndarray,
    tables: np.ndarray,
    reach: float,
    hold: int,
    value: float,
    before: np.ndarray,
    after: np.ndarray,
    orbit: Orbit,
    start: Orbit,
    spare: Orbit,
    tolerance: float,
) -> tuple[bool, Orbit, Orbit]:
    """Find the orbit of this amplitude or tip offset between two points, from the orbit (at `after`; lost).

    `start` holds the orbit at `before`. Where Newton's method lands on another piece of the curve, the curve is
    followed again in shorter steps.
    """
    if hold == HOLD_AMPLITUDE:
        # Pressed into a soft surface, the lever moves far for little amplitude: rounding is amplified so much.
        tolerance *= max(1.0, 1e-2 * abs((after[ZP] - before[ZP]) / (after[AP] - before[AP])))
    good, orbit, spare = settle_on(
        law, p, lever, tables, reach, hold, value, before, after, after, orbit, spare, tolerance
    )
    if good:
        return True, orbit, spare
    index = AP if hold == HOLD_AMPLITUDE else ZP
    low, high, room = before.copy(), after.copy(), new_orbit()
    begin_orbit = new_orbit()
    copy_orbit(start, begin_orbit)
    for _ in range(12):
        copy_orbit(begin_orbit, orbit)
        between = low.copy()
        share = (value - low[index]) / (high[index] - low[index])
        step = high[LENGTH] * min(max(share, 0.1), 0.9)
        status, _, orbit, spare = advance(law, p, lever, tables, reach, between, step, orbit, spare, room)
        if status != col.GOOD:
            return False, orbit, spare
        if (between[index] > value) == (high[index] > value):
            high[:] = between
        else:
            high[LENGTH] -= between[LENGTH]
            low[:] = between
            copy_orbit(orbit, begin_orbit)
        good, orbit, spare = settle_on(
            law, p, lever, tables, reach, hold, value, low, high, between, orbit, spare, tolerance
        )
        if good:
            return True, orbit, spare
    return False, orbit, spare


@njit(**OPTIONS)
def lower(
    law: Law,
    p: np.ndarray,
    lever: np.ndarray,
    tables: np.ndarray,
    amplitude: float,
    tolerance: float,
    reach: float,
    hanging: float,
    point: np.ndarray,
    orbit: Orbit,
    spare: Orbit,
    saved: Orbit,
    found: Orbit,
) -> tuple[int, float, Orbit, Orbit, Orbit]:
    """Follow the curve from `point` on to the orbit at which a tip that is lowered stops, returned last.

    The second value is the tip offset at which the tip leaves the curve: where its orbit is no longer stable, or the
    lowest that the curve reached. The status is NOT_SETTLED where the curve leads nowhere: a multiplier above `hanging`
    belongs to orbits that hang on an unstable equilibrium.
    """
    step, lowest, have, highest = FIRST_STEP, 1e300, False, 10.0 * (abs(point[ZP]) + point[AP] + reach)
    left = math.nan
    for _ in range(MOST_POINTS):
        before = point.copy()
        status, step, orbit, spare = advance_watching(
            law, p, lever, tables, reach, point, step, AP, amplitude, orbit, spare, saved
        )
        if status != col.GOOD:
            if pressed_in(law, p, lever, orbit):
                status = col.NO_STABLE_ORBIT
            return status, min(lowest, before[ZP]) if math.isnan(left) else left, orbit, spare, found
        z0, a = point[ZP], point[AP]
        if before[AP] > amplitude >= a and z0 < before[ZP] and not have:
            copy_orbit(orbit, found)
            have, found, spare = cross(
                law, p, lever, tables, reach, HOLD_AMPLITUDE, amplitude, before, point, found, saved, spare, tolerance
            )
            if not have:
                status = col.NO_STABLE_ORBIT if pressed_in(law, p, lever, orbit) else col.NOT_CONVERGED
                return status, lowest if math.isnan(left) else left, orbit, spare, found
        elif a > amplitude >= before[AP] and z0 >= lowest:
            have = False  # the tip lands before that crossing
        if have and z0 < lowest:
            return col.GOOD, left, orbit, spare, found
        if math.isnan(left) and not point[FP] < 1.0 and z0 < lowest:
            left = z0
        lowest = min(lowest, z0)
        away = z0 > highest and orbit.head[COUNT, CONTACTS] == 0 and a < 2.0 * free_amplitude(lever)
        if point[FP] > hanging or away:
            return col.NOT_SETTLED, lowest if math.isnan(left) else left, orbit, spare, found
        if orbit.head[COUNT, CONTACTS] == PERMANENT and (a < 0.3 * amplitude or z0 < -FARTHEST_AT_ALL):
            break
    return col.NO_STABLE_ORBIT, lowest, orbit, spare, found


@njit(**OPTIONS)
def retract(
    law: Law,
    p: np.ndarray,
    lever: np.ndarray,
    tables: np.ndarray,
    amplitude: float,
    tolerance: float,
    reach: float,
    point: np.ndarray,
    orbit: Orbit,
    spare: Orbit,
    saved: Orbit,
    found: Orbit,
) -> tuple[int, Orbit, Orbit, Orbit]:
    """Follow a branch of smaller amplitude as the tip offset is raised, to the orbit that holds `amplitude`.

    Where the branch ends first the tip is pulled off and jumps across the setpoint.
    """
    step, sudden = 0.1, lets_go(law, p, lever)
    for _ in range(MOST_POINTS):
        before = point.copy()
        status, step, orbit, spare = advance_watching(
            law, p, lever, tables, reach, point, step, AP, amplitude, orbit, spare, saved
        )
        if status != col.GOOD:
            return col.NO_STABLE_ORBIT if sudden else col.NOT_CONVERGED, orbit, spare, found
        if before[AP] < amplitude <= point[AP]:
            copy_orbit(orbit, found)
            good, found, spare = cross(
                law, p, lever, tables, reach, HOLD_AMPLITUDE, amplitude, before, point, found, saved, spare, tolerance
            )
            return col.GOOD if good else col.NOT_CONVERGED, orbit, spare, found
        if point[ZP] < before[ZP] or point[DZ] < 0.0:
            return col.NO_STABLE_ORBIT, orbit, spare, found
        if not point[FP] < 1.0:
            # A multiplier past one is a fold, past minus one it doubles the period.
            gone = point[DET] < 0.0 or point[FP] > HANGING or p[4] == 0.0
            return col.NO_STABLE_ORBIT if gone else col.UNSTABLE, orbit, spare, found
    return col.NOT_CONVERGED, orbit, spare, found


@njit(**OPTIONS)
def only_offset(reach: float, orbit: Orbit, sense: float, point: np.ndarray) -> None:
    """Set the tangent of a point so that `mark` turns it to where the tip offset rises (sense 1) or falls (-1)."""
    gap_scale, a_scale = scales(reach, orbit.head[VALUE, Z0], orbit.head[VALUE, A])
    point[:] = 0.0
    point[TG], point[TA] = sense, sense * a_scale / gap_scale


@njit(**OPTIONS)
def joined(
    law: Law,
    p: np.ndarray,
    lever: np.ndarray,
    tables: np.ndarray,
    z0: float,
    orbit: Orbit,
    spare: Orbit,
    saved: Orbit,
) -> tuple[bool, Orbit, Orbit]:
    """Whether stable orbits join this one (lost) to near the tip offset z0, the amplitude rising with the tip offset.

    Near is enough: a tip that hits a force that jumps goes through doubled periods before it comes to this branch.
    """
    near = NEAR * free_amplitude(lever)
    reach, point = scale_of(law, p, lever, free_amplitude(lever)), np.zeros(POINT)
    sense = 1.0 if z0 > orbit.head[VALUE, Z0] else -1.0
    only_offset(reach, orbit, sense, point)
    good, step = mark(law, p, lever, tables, orbit, reach, point), 0.1
    for _ in range(MOST_POINTS):
        if not good or not point[FP] < 1.0 or not point[DZ] * sense > 0.0 or not point[DA] * sense > 0.0:
            return False, orbit, spare
        if (point[ZP] - z0) * sense >= -near:
            return True, orbit, spare
        status, step, orbit, spare = advance(law, p, lever, tables, reach, point, step, orbit, spare, saved)
        good = status == col.GOOD
    return False, orbit, spare


@njit(**OPTIONS)
def tapping(
    law: Law,
    p: np.ndarray,
    lever: np.ndarray,
    tables: np.ndarray,
    amplitude: float,
    z0: float,
    level: int,
    tolerance: float,
    orbit: Orbit,
    spare: Orbit,
    saved: Orbit,
    found: Orbit,
) -> tuple[bool, Orbit, Orbit, Orbit]:
    """Find the repulsive orbit of this amplitude on the branch on which a tip lands that taps on at z0, if any."""
    target = np.zeros(4)
    for guess in averaged_orbits(law, p, lever, amplitude):
        if guess[3] <= 0.0 or not begin(law, p, lever, tables, orbit, guess, level):
            continue
        status, _, orbit, spare = newton(
            law, p, lever, tables, orbit, spare, HOLD_AMPLITUDE, target, level, tolerance, 20
        )
        if status != col.GOOD or not orbit.head[VALUE, P] > 0.0:
            continue
        copy_orbit(orbit, found)
        good, orbit, spare = joined(law, p, lever, tables, z0, orbit, spare, saved)
        if good:
            return True, orbit, spare, found
    return False, orbit, spare, found


@njit(**OPTIONS)
def engage_landed(
    law: Law,
    p: np.ndarray,
    lever: np.ndarray,
    tables: np.ndarray,
    amplitude: float,
    z0: float,
    level: int,
    tolerance: float,
    orbit: Orbit,
    spare: Orbit,
    saved: Orbit,
    found: Orbit,
) -> tuple[int, Orbit, Orbit, Orbit]:
    """`engage` from the orbit on which the tip lands at `z0`, lowered further or retracted to the setpoint."""
    reach = scale_of(law, p, lever, free_amplitude(lever))
    good, orbit, spare = land(law, p, lever, tables, z0, level, orbit, spare)
    if not good:
        good, orbit, spare, found = tapping(
            law, p, lever, tables, amplitude, z0, level, tolerance, orbit, spare, saved, found
        )
        return col.GOOD if good else col.NOT_CONVERGED, orbit, spare, found
    down, point = orbit.head[VALUE, A] > amplitude, np.zeros(POINT)
    if not down:
        z0 = loosened(law, p, lever, z0, amplitude)
        good, orbit, spare = land(law, p, lever, tables, z0, level, orbit, spare)
        if not good:
            return col.NOT_CONVERGED, orbit, spare, found
    only_offset(reach, orbit, -1.0 if down else 1.0, point)
    if not mark(law, p, lever, tables, orbit, reach, point):
        return col.NOT_CONVERGED, orbit, spare, found
    if not down:
        status, orbit, spare, found = retract(
            law, p, lever, tables, amplitude, tolerance, reach, point, orbit, spare, saved, found
        )
        # Above resonance contact brings the lever nearer to it: the tip may as well have landed on a large oscillation.
        if status == col.NO_STABLE_ORBIT and lever[col.OMEGA] > 1.0:
            status = col.NOT_CONVERGED
        return status, orbit, spare, found
    status, _, orbit, spare, found = lower(
        law, p, lever, tables, amplitude, tolerance, reach, HANGING, point, orbit, spare, saved, found
    )
    return col.NOT_CONVERGED if status == col.NOT_SETTLED else status, orbit, spare, found


@njit(**OPTIONS)
def engage(
    law: Law,
    p: np.ndarray,
    lever: np.ndarray,
    tables: np.ndarray,
    amplitude: float,
    level: int,
    tolerance: float,
    hanging: float,
    orbit: Orbit,
    spare: Orbit,
    saved: Orbit,
    found: Orbit,
) -> tuple[int, Orbit, Orbit, Orbit]:
    """Approach from far along exact orbits to the one that holds `amplitude`; it is returned last.

    Where the curve's multiplier passes `hanging` the tip is taken to land elsewhere; NOT_SETTLED if it is not
    known where.
    """
    reach = scale_of(law, p, lever, free_amplitude(lever))
    status, orbit, spare = start_far(law, p, lever, tables, orbit, spare, amplitude, level)
    if status != col.GOOD:
        return status, orbit, spare, found
    point = np.zeros(POINT)
    point[TG] = -1.0
    if not mark(law, p, lever, tables, orbit, reach, point):
        return col.NOT_CONVERGED, orbit, spare, found
    status, left, orbit, spare, found = lower(
        law, p, lever, tables, amplitude, tolerance, reach, hanging, point, orbit, spare, saved, found
    )
    # A curve that ends where the tip touches a force that jumps: no orbit touches it only a little.
    grazing = p[4] == 0.0 and pulled(law, p, lever) > 0.0
    if status == col.NOT_SETTLED or (status == col.NOT_CONVERGED and (grazing or level > 0)):
        done, orbit, spare, found = engage_landed(
            law, p, lever, tables, amplitude, left, level, tolerance, orbit, spare, saved, found
        )
        return status if done == col.NOT_CONVERGED else done, orbit, spare, found
    return status, orbit, spare, found


@njit(**OPTIONS)
def engage_near(
    law: Law,
    p: np.ndarray,
    lever: np.ndarray,
    tables: np.ndarray,
    amplitude: float,
    tolerance: float,
    orbit: Orbit,
    spare: Orbit,
    saved: Orbit,
    found: Orbit,
) -> tuple[int, Orbit, Orbit, Orbit]:
    """`engage` near the end of the attractive branch, at resonance, without the way from far.

    At an amplitude nearer to the free one the attractive branch is reached for certain. From there exact orbits are
    followed down to the setpoint; if the branch ends before, the tip jumps to the farthest repulsive orbit that can be
    held. NOT_CONVERGED leaves the question to `engage`.
    """
    if lever[col.OMEGA] != 1.0 or p[4] == 0.0:
        return col.NOT_CONVERGED, orbit, spare, found
    free, guess, top, target = free_amplitude(lever), np.zeros(6), np.zeros(MAXIMUM), np.zeros(4)
    force_reach, certain = reach_of(law, p), False
    for share in (0.3, 0.7):
        higher = amplitude + share * (free - amplitude)
        side = decide(law, p, lever, force_reach, higher, free, caution(lever), top)
        certain = side == ATTRACTIVE and on_side(law, p, lever, force_reach, higher, side, top, guess)
        if certain:
            break
    if not certain or not begin(law, p, lever, tables, orbit, guess, 0):
        return col.NOT_CONVERGED, orbit, spare, found
    status, _, orbit, spare = newton(law, p, lever, tables, orbit, spare, HOLD_AMPLITUDE, target, 0, tolerance, 12)
    reach = scale_of(law, p, lever, free)
    point = np.zeros(POINT)
    point[TA] = -1.0
    if status != col.GOOD or not mark(law, p, lever, tables, orbit, reach, point):
        return col.NOT_CONVERGED, orbit, spare, found
    if not (point[FP] < 1.0 and point[DZ] < 0.0 and orbit.head[VALUE, P] < 0.0):
        return col.NOT_CONVERGED, orbit, spare, found
    step, ended = FIRST_STEP, False
    while not ended:
        before = point.copy()
        status, step, orbit, spare = advance_watching(
            law, p, lever, tables, reach, point, step, AP, amplitude, orbit, spare, saved
        )
        if status != col.GOOD:
            return col.NOT_CONVERGED, orbit, spare, found
        ended = point[AP] > before[AP] or point[ZP] > before[ZP]
        crossed = before[AP] > amplitude >= point[AP]
        if ended and (crossed or min(before[AP], point[AP]) < (1.0 + NEAR_END) * amplitude):
            return col.NOT_CONVERGED, orbit, spare, found  # which comes first takes smaller steps to tell
        if crossed:
            copy_orbit(orbit, found)
            good, found, spare = cross(
                law, p, lever, tables, reach, HOLD_AMPLITUDE, amplitude, before, point, found, saved, spare, tolerance
            )
            return col.GOOD if good else col.NOT_CONVERGED, orbit, spare, found
    row = np.zeros(col.COLUMNS)
    for guess in averaged_orbits(law, p, lever, amplitude):
        if guess[3] <= 0.0 or not begin(law, p, lever, tables, found, guess, 0):
            continue
        status, _, found, spare = newton(law, p, lever, tables, found, spare, HOLD_AMPLITUDE, target, 0, tolerance, 12)
        if status == col.GOOD and finish(law, p, lever, tables, found, row) == col.GOOD:
            if row[col.FLOQUET] < 1.0 and row[col.SLOPE] > 0.0 and row[col.STIFFENING] > 0.0:
                return col.GOOD, orbit, spare, found
    return col.NOT_CONVERGED, orbit, spare, found


@njit(**OPTIONS)
def collect(
    law: Law,
    p: np.ndarray,
    lever: np.ndarray,
    tables: np.ndarray,
    hold: int,
    value: float,
    level: int,
    tolerance: float,
    rows: np.ndarray,
) -> tuple[int, int]:
    """Fill rows with the orbits of this amplitude or tip offset on the curve from far; returns a status and how many.

    The curve is left where the tip stays in contact, or hardly moves any more.
    """
    orbit, spare, saved = new_orbit(), new_orbit(), new_orbit()
    index = AP if hold == HOLD_AMPLITUDE else ZP
    free = free_amplitude(lever)
    reach = scale_of(law, p, lever, free_amplitude(lever))
    engaged = value if hold == HOLD_AMPLITUDE else 0.999 * free
    status, orbit, spare = start_far(law, p, lever, tables, orbit, spare, engaged, level)
    point = np.zeros(POINT)
    point[TG] = -1.0
    if status != col.GOOD or not mark(law, p, lever, tables, orbit, reach, point):
        return col.NOT_CONVERGED, 0
    step, count, one = FIRST_STEP, 0, new_orbit()
    for _ in range(MOST_POINTS):
        before = point.copy()
        status, step, orbit, spare = advance_watching(
            law, p, lever, tables, reach, point, step, index, value, orbit, spare, saved
        )
        if status != col.GOOD:
            return status, count
        if (before[index] > value) != (point[index] > value):
            copy_orbit(orbit, one)
            good, one, spare = cross(
                law, p, lever, tables, reach, hold, value, before, point, one, saved, spare, tolerance
            )
            if not good or count == len(rows):
                return col.NOT_CONVERGED, count
            finish(law, p, lever, tables, one, rows[count])
            count = insert(rows, count)
        if point[AP] < CAUGHT * (value if hold == HOLD_AMPLITUDE else free):
            return col.GOOD, count
        if orbit.head[COUNT, CONTACTS] == PERMANENT:
            deep = point[AP] < 0.3 * value if hold == HOLD_AMPLITUDE else point[ZP] < value - free
            if deep or point[ZP] < -FARTHEST * free:
                return col.GOOD, count
    return col.NOT_CONVERGED, count


@njit(**OPTIONS)
def insert(rows: np.ndarray, count: int) -> int:
    """Keep row `count` if it is none of the rows before it; returns how many rows there are."""
    new = rows[count]
    for row in rows[:count]:
        apart = abs(row[col.TIP_OFFSET] - new[col.TIP_OFFSET]) + abs(row[col.AMPLITUDE] - new[col.AMPLITUDE])
        if apart < 1e-7 * new[col.AMPLITUDE] and abs(row[col.PHASE] - new[col.PHASE]) < 1e-6:
            return count
    return count + 1


@njit(**OPTIONS)
def seed(
    law: Law,
    p: np.ndarray,
    lever: np.ndarray,
    tables: np.ndarray,
    amplitude: float,
    guesses: np.ndarray,
    level: int,
    tolerance: float,
    rows: np.ndarray,
    count: int,
) -> int:
    """Add the orbits of this amplitude to which averaged ones lead; returns how many rows there are.

    An averaged orbit of another amplitude is followed to this one, along its own piece of the curve.
    """
    orbit, spare, saved, one = new_orbit(), new_orbit(), new_orbit(), new_orbit()
    target, point = np.zeros(4), np.zeros(POINT)
    reach = scale_of(law, p, lever, free_amplitude(lever))
    for guess in guesses:
        if count == len(rows) or not begin(law, p, lever, tables, orbit, guess, level):
            continue
        status, _, orbit, spare = newton(
            law, p, lever, tables, orbit, spare, HOLD_AMPLITUDE, target, level, tolerance, 30
        )
        if status != col.GOOD or not orbit.head[VALUE, A] > 0.0:
            continue
        if guess[2] == amplitude:
            finish(law, p, lever, tables, orbit, rows[count])
            count = insert(rows, count)
            continue
        point[:] = 0.0
        point[TA] = 1.0 if amplitude > guess[2] else -1.0
        if not mark(law, p, lever, tables, orbit, reach, point):
            continue
        step = 0.1
        for _ in range(80):
            before = point.copy()
            status, step, orbit, spare = advance_watching(
                law, p, lever, tables, reach, point, step, AP, amplitude, orbit, spare, saved
            )
            if status != col.GOOD or abs(point[AP] - amplitude) > 1.5 * abs(guess[2] - amplitude):
                break
            if (before[AP] > amplitude) != (point[AP] > amplitude) and count < len(rows):
                copy_orbit(orbit, one)
                good, one, spare = cross(
                    law, p, lever, tables, reach, HOLD_AMPLITUDE, amplitude, before, point, one, saved, spare,
                    tolerance,
                )  # fmt: skip
                if good:
                    finish(law, p, lever, tables, one, rows[count])
                    count = insert(rows, count)
    return count
