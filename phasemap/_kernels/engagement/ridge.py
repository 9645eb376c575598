"""Where the attractive branch ends over a surface that remembers, by periodic motions of whatever drive they need.

Let f be the drive that a motion of amplitude A needs at the distance b = z0 - A, over that given, and h = f^2 - 1. At a
fixed A it has a maximum over b where the lever is attracted most, and this ridge is lowest at some A: at a saddle. If
h > 0 there, or at the setpoint if that is above, the attractive branch leads down to the setpoint. As in `end`, but by
the march: the map of one period has the slopes of f in its derivatives. Curvatures are at first those of averaging and
then follow from the slopes (symmetric rank one): theory, Eq. (memory-11).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.averaged import settle_side, worst_amplitude
from phasemap._kernels.engagement.holding import COARSER_STEPS, hold_near, state_on
from phasemap._kernels.engagement.rebound import rebounds
from phasemap._kernels.engagement.resonance import (
    ATTRACTIVE,
    REPULSIVE,
    UNCLEAR,
    Maximum,
    attraction_is_too_weak,
    attractive_mismatch_at_gap,
    leaps,
    narrowest_amplitude_ratio,
)
from phasemap._kernels.law import Law, Oscillator
from phasemap._kernels.lever import drive_needed, free_amplitude, low_q, reach_of
from phasemap._kernels.orbits.averaged.harmonics import harmonics, put_harmonic_orbit
from phasemap._kernels.orbits.averaged.row import averaged_row
from phasemap._kernels.orbits.time.by_memory import lingering
from phasemap._kernels.orbits.time.linear_map import (
    amplitude_slope,
    differentiate,
    fill_way_to_rest,
    length_of,
    slopes_of_orbit,
)
from phasemap._kernels.orbits.time.period_map import fill_change, linearise_period, neighbour_distance, pass_from
from phasemap._kernels.orbits.time.tip import (
    Z0,
    Change,
    PeriodMap,
    PeriodResult,
    Periods,
    Tip,
    Way,
    copy_memory,
    move_state,
)
from phasemap._kernels.records import assign, record

TIGHT, CLOSEST = 0.015, 1e-4  # h at the saddle that decides: as first predicted, and once it is known
TRUSTED = 0.5  # of how far a prediction of it is off, and of what it adds, that the next may be
MOST_RIDGE_POINTS = 8  # that are evaluated
MOST_LIFTS = 3  # of these, until the tip is as deep as averaging says
LIFTED = 0.3  # of that depth, that may be missed
MOST_NEWTON, FIRST_RIDGE_STEP = 6, 0.1  # and first step, below which derivatives are those at its end
RIDGE_DRIVE_LEFT = 1e-5  # of the drive and of the length on which forces change: errors left
STEP_ASTRAY = 1e3  # of that length, a step that leads nowhere
NEAR_ORBIT = 0.02  # of that length, from where the last step leads to an orbit
SAME_DERIVATIVES = 0.5  # of a step, that the next one may be by the same derivatives
SPREAD = 0.04  # steps of averaged curvatures, over A
DEPTH_STEP = 0.4  # the same over the depth
REACH_STEP = 0.3  # the same over reach and depth
LONGEST_RIDGE_STEP = 1.0  # over the length on which forces change
LARGEST_AMPLITUDE_STEP = 0.15  # over the amplitude


@record
class RidgePoint:
    """A place on the ridge: gap b and amplitude A [m], the mismatch h there and its derivatives."""

    gap: float
    amplitude: float
    mismatch: float
    by_gap: float  # [1/m]
    by_amplitude: float  # at fixed gap [1/m]
    by_gap_twice: float  # [1/m2]
    by_both: float
    by_amplitude_twice: float


class Ridge(NamedTuple):
    """A place on the ridge and the motion there.

    Attributes
    ----------
    place : RidgePoint
    driven : ndarray
        The lever, with the drive that the motion needs.
    tip : Tip
    by : PeriodMap
        As tip.linear, with derivatives by the drive in place of those by the tip offset.
    """

    place: RidgePoint
    driven: np.ndarray
    tip: Tip
    by: PeriodMap


@kernel
def start_ridge(
    oscillator: Oscillator, amplitude: float, gap: float, place: RidgePoint, driven: np.ndarray, row: np.ndarray
) -> None:
    """Return a ridge at the harmonic orbit of this gap, with curvatures from averaging; fills the result row."""
    law, p, lever = oscillator
    reach, guess = reach_of(law, p), np.zeros(col.GUESS)
    push, drag, mean = harmonics(oscillator, reach, amplitude, 1.0 + gap / amplitude)
    put_harmonic_orbit(guess, amplitude, 1.0 + gap / amplitude, push, drag, mean)
    x, y = drive_needed(lever, amplitude, push, drag)
    driven[col.DRIVE] = math.hypot(x, y)
    averaged_row(lever, guess, row)
    place.gap, place.amplitude = guess[col.G_Z0] - amplitude, amplitude
    step, more = min(REACH_STEP * (reach + abs(gap)), DEPTH_STEP * abs(gap)), SPREAD * amplitude
    h = attractive_mismatch_at_gap(oscillator, reach, amplitude, gap)[0]
    near = attractive_mismatch_at_gap(oscillator, reach, amplitude, gap - step)[0]
    far = attractive_mismatch_at_gap(oscillator, reach, amplitude, gap + step)[0]
    place.by_gap_twice = (near - 2.0 * h + far) / step**2
    less = attractive_mismatch_at_gap(oscillator, reach, amplitude - more, gap)[0]
    larger = attractive_mismatch_at_gap(oscillator, reach, amplitude + more, gap)[0]
    place.by_amplitude_twice = (less - 2.0 * h + larger) / more**2


@kernel
def linearise_at_ridge_point(law: Law, p: np.ndarray, eta: float, ridge: Ridge) -> bool:
    """Fill the derivatives of the motion over one period by its start and drive; False where marching fails."""
    _, driven, tip, by = ridge
    if not linearise_period(Oscillator(law, p, driven), eta, tip):
        return False
    u, y = tip.u, np.empty(len(tip.u))
    base, size = driven[col.DRIVE], neighbour_distance(driven, tip)
    driven[col.DRIVE] = base + size
    good = pass_from(Oscillator(law, p, driven), eta, tip, u, u[Z0], y)
    driven[col.DRIVE] = base
    assign(by, tip.linear)
    fill_change(driven, u, y, tip.acc, by.by_z0)
    differentiate(by.by_z0, by.now, size)
    return good


@kernel
def solve_drive_at_ridge_point(law: Law, p: np.ndarray, eta: float, scale: float, ridge: Ridge) -> bool:
    """Find the drive and the periodic motion with a point's gap and amplitude; False if Newton's method fails.

    `scale` [m] is the length on which forces change.
    """
    place, driven, tip, by = ridge
    u, y, now, ahead = tip.u, np.empty(len(tip.u)), Change(), Way()
    for _ in range(MOST_NEWTON):
        if not linearise_at_ridge_point(law, p, eta, ridge):
            return False
        fill_way_to_rest(by, by.now, place.amplitude, ahead)
        before = FIRST_RIDGE_STEP
        while True:
            more, ahead.z0 = ahead.z0, 0.0  # of the drive, which stands in the place of z0
            way = length_of(ahead) / scale + abs(more) / driven[col.DRIVE]
            move_state(driven, ahead, 1.0, u)
            driven[col.DRIVE] += more
            if not (way < STEP_ASTRAY and driven[col.DRIVE] > 0.0):
                return False
            if way * way < RIDGE_DRIVE_LEFT * before:
                return True
            if way > SAME_DERIVATIVES * before:
                break
            if not pass_from(Oscillator(law, p, driven), eta, tip, u, u[Z0], y):
                return False
            copy_memory(y, u)
            fill_change(driven, u, y, tip.acc, now)
            fill_way_to_rest(by, now, place.amplitude, ahead)
            before = way
    return False


@kernel
def evaluate_ridge(oscillator: Oscillator, eta: float, scale: float, ridge: Ridge) -> bool:
    """Find h and its slopes at a place; False where no motion is found, or none that the lever is attracted in."""
    law, p, lever = oscillator
    place, driven, tip, by = ridge
    if not solve_drive_at_ridge_point(law, p, eta, scale, ridge) or not tip.acc.cos < 0.0:
        return False
    f, by_drive = driven[col.DRIVE] / lever[col.DRIVE], amplitude_slope(by)
    place.mismatch = f * f - 1.0
    place.by_gap = -2.0 * f * amplitude_slope(tip.linear) / by_drive / lever[col.DRIVE]
    place.by_amplitude = place.by_gap + 2.0 * f / by_drive / lever[col.DRIVE]
    return True


@kernel
def move_on_ridge(ridge: Ridge, of_b: float, of_a: float) -> None:
    """Move gap and amplitude by these steps [m], and the periodic motion and its drive along, to first order."""
    place, driven, tip, by = ridge
    of_z0, slopes, by_drive = of_b + of_a, Way(), Way()
    slope = slopes_of_orbit(tip.linear, slopes)
    more = (of_a - slope * of_z0) / slopes_of_orbit(by, by_drive)
    by_drive.z0 = 0.0
    move_state(driven, slopes, of_z0, tip.u)
    move_state(driven, by_drive, more, tip.u)
    driven[col.DRIVE] += more
    place.gap += of_b
    place.amplitude += of_a


@kernel
def step_to_saddle(place: RidgePoint, least: float) -> tuple[float, float, float]:
    """Steps in gap and amplitude to the saddle of the quadratic model, and the rise of the mismatch h; or NaN."""
    g_b, g_a, bb, ba, aa = place.by_gap, place.by_amplitude, place.by_gap_twice, place.by_both, place.by_amplitude_twice
    if not bb < 0.0:
        return math.nan, math.nan, math.nan
    along = aa - ba * ba / bb  # along the ridge
    of_a = least - place.amplitude
    if along > 0.0:
        of_a = max(of_a, -(g_a - ba * g_b / bb) / along)
    elif place.amplitude > least or g_a - ba * g_b / bb < 0.0:
        return math.nan, math.nan, math.nan
    of_b = -(g_b + ba * of_a) / bb
    rise = g_b * of_b + g_a * of_a + 0.5 * (bb * of_b**2 + 2 * ba * of_b * of_a + aa * of_a**2)
    return of_b, of_a, rise


@kernel
def update_second_derivatives(place: RidgePoint, before: RidgePoint, scale: float) -> None:
    """Correct the second derivatives of the mismatch by its slopes at two points: symmetric rank-one update."""
    s_b, s_a = (place.gap - before.gap) / scale, (place.amplitude - before.amplitude) / place.amplitude
    amplitude = place.amplitude
    bb, aa = before.by_gap_twice * scale**2, before.by_amplitude_twice * amplitude**2
    ba = before.by_both * scale * amplitude
    off_b = (place.by_gap - before.by_gap) * scale - bb * s_b - ba * s_a
    off_a = (place.by_amplitude - before.by_amplitude) * place.amplitude - ba * s_b - aa * s_a
    along = off_b * s_b + off_a * s_a
    if abs(along) > 1e-6 * math.hypot(off_b, off_a) * math.hypot(s_b, s_a):
        bb, ba, aa = bb + off_b**2 / along, ba + off_b * off_a / along, aa + off_a**2 / along
    place.by_gap_twice, place.by_amplitude_twice = bb / scale**2, aa / amplitude**2
    place.by_both = ba / (scale * amplitude)


@kernel
def side_by_ridge(oscillator: Oscillator, amplitude: float, eta: float, top: Maximum, ridge: Ridge) -> int:
    """Side on which the tip comes to `amplitude`; `top` is averaging's maximum, on which the ridge begins.

    A first look decides with a margin as wide as it misses what averaging predicts; later ones as they predict each
    other. Dents that last grow from look to look, and keep the margin wide.
    """
    law, p = oscillator.law, oscillator.p
    place, scale, predicted = ridge.place, reach_of(law, p) + abs(top.gap), math.nan
    before = RidgePoint()
    assign(before, place)
    for i in range(MOST_RIDGE_POINTS):
        if not evaluate_ridge(oscillator, eta, scale, ridge):
            return UNCLEAR
        lifted = -top.gap - ridge.tip.acc.deepest
        if i < MOST_LIFTS and abs(lifted) > LIFTED * abs(top.gap):
            move_on_ridge(ridge, -lifted, 0.0)
            continue
        first = math.isnan(predicted)
        if not first:
            update_second_derivatives(place, before, scale)
        of_b, of_a, rise = step_to_saddle(place, amplitude)
        highest = place.mismatch + rise
        missed = TRUSTED * max(abs(highest - (top.mismatch if first else predicted)), abs(rise))
        if abs(highest) > missed + (TIGHT if first or lingering(oscillator) > 0.0 else CLOSEST):
            return ATTRACTIVE if highest > 0.0 else REPULSIVE
        predicted = highest
        farthest = LONGEST_RIDGE_STEP * scale, LARGEST_AMPLITUDE_STEP * place.amplitude
        share = 1.0 / max(1.0, abs(of_b) / farthest[0], abs(of_a) / farthest[1])
        if not share > 0.0:
            return UNCLEAR
        assign(before, place)
        move_on_ridge(ridge, share * of_b, share * of_a)
    return UNCLEAR


@kernel
def go_outside(oscillator: Oscillator, amplitude: float, eta: float, scale: float, ridge: Ridge) -> bool:
    """Go on from the saddle to the orbit outside of it that holds `amplitude`, nearly; False if it is not found."""
    place = ridge.place
    of_a = amplitude - place.amplitude
    of_b = -(place.by_gap + place.by_both * of_a) / place.by_gap_twice
    curved = 0.5 * (place.by_both * of_b + place.by_amplitude_twice * of_a)
    h = place.mismatch + 0.5 * place.by_gap * of_b + (place.by_amplitude + curved) * of_a
    if not h > 0.0:
        return False
    move_on_ridge(ridge, of_b + math.sqrt(-2.0 * h / place.by_gap_twice), of_a)
    for _ in range(MOST_NEWTON):
        if not evaluate_ridge(oscillator, eta, scale, ridge) or not place.by_gap < 0.0:
            return False
        way = -place.mismatch / place.by_gap
        move_on_ridge(ridge, way, 0.0)
        if abs(way) < NEAR_ORBIT * scale:
            return True
    return False


@kernel
def settle_open(
    oscillator: Oscillator, amplitude: float, eta: float, most: int, top: Maximum, guess: np.ndarray, row: np.ndarray
) -> bool:
    """Fill the row with the motion that holds `amplitude` where averaging leaves its side open; False if it stays so.

    Levers that are carried over their resonance, or driven so far below it that the branch is narrowest above the free
    amplitude, are left to time.
    """
    law, p, lever = oscillator
    reach, worst = reach_of(law, p), worst_amplitude(lever, amplitude)
    if p[col.LONGRANGE] == 0.0 or narrowest_amplitude_ratio(lever) > 1.0 or leaps(lever, reach, free_amplitude(lever)):
        return False
    place, driven, rough = RidgePoint(), lever.copy(), COARSER_STEPS * eta
    start_ridge(oscillator, worst, top.gap, place, driven, row)
    tip = Tip(state_on(law, lever, worst, row), PeriodResult(), PeriodMap(), Periods())
    ridge = Ridge(place, driven, tip, PeriodMap())
    side = REPULSIVE
    if not (low_q(lever) and attraction_is_too_weak(lever, worst, top.mismatch)):
        side = side_by_ridge(oscillator, amplitude, rough, top, ridge)
    if side == UNCLEAR:
        return False
    if settle_side(oscillator, reach, amplitude, side, top, guess):
        if side == REPULSIVE and rebounds(oscillator, guess[col.G_P]):
            return False
        averaged_row(lever, guess, row)
        tip = Tip(state_on(law, lever, amplitude, row), PeriodResult(), PeriodMap(), Periods())
    elif side == REPULSIVE or not go_outside(oscillator, amplitude, rough, reach + abs(top.gap), ridge):
        return False
    return hold_near(oscillator, amplitude, eta, most, side == REPULSIVE, tip, row)
