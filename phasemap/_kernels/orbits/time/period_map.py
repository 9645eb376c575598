"""Periodic orbits in time: Newton's method on the map of one period of the drive, by differences of marched periods.

See theory, Eqs. (time-3) and (time-4).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator, contact_force
from phasemap._kernels.numerics import copy
from phasemap._kernels.orbits.energy_balance import energy_closure
from phasemap._kernels.orbits.time.arms import dent_survival
from phasemap._kernels.orbits.time.march import march_oscillator
from phasemap._kernels.orbits.time.modes import air_beside_first_harmonic
from phasemap._kernels.orbits.time.surface_memory import OUTER_COUNT
from phasemap._kernels.orbits.time.tip import (
    TOUCHES,
    Z0,
    Change,
    MovingTip,
    PeriodResult,
    V,
    Way,
    Z,
    amplitude_of,
    amplitude_slope,
    coordinate_count,
    copy_memory,
    copy_state,
    differentiate,
    entry_of,
    fill_way_to_rest,
    floquet_multiplier,
    length_of,
    motion_scale,
    motion_size,
    move_state,
    ring_down_periods,
    slopes_of_orbit,
)
from phasemap._kernels.records import assign

SETTLING_TIME = 40.0  # ring-down times in which a motion has to settle, if it does
FEEDBACK_STRIDE = 0.1  # steps of a feedback, of the amplitude
TO_RELEASE = 0.05  # the same, of the way that a tip must go to come free
LINEAR_MISS = 0.1  # of the amplitude, by which the longer of these may miss a linear prediction
DERIVATIVE_STEP = 3e-8  # of the motion, how far away derivatives are taken
DENTED_STEP = 3e-6  # the same where dents that last have kinks
DENT_GONE = 1e-4  # of a dent, when it counts as gone
MOST_CREEP = 1000.0  # passes of two periods in which it has to
CREEP_STEP = 0.01  # of the motion: longer steps lead astray meanwhile
CREEP_GROWTH = 30.0  # the same, times the first step
MOST_JUMPS = 3  # of the amplitude across the setpoint: then it goes on so for ever
FEEDBACK_JUMP = 0.02  # of the amplitude, by which it changes more than the tip offset does where it jumps
LEAST_FEEDBACK_STRIDE = 1e-4  # of the amplitude: a setpoint that is passed again in steps so short lies inside a jump
LEAST_FEEDBACK_SLOPE = 0.2  # of the amplitude with the tip offset, by which a step of the feedback is divided
FARTHEST = 50.0  # drives over alpha0, 100 free amplitudes: a setpoint farther up is none
MOST_SKIPS = 20  # of a transient, each with derivatives of its own
NEAR_ORBIT = 1e-4  # of the motion: as near to an orbit derivatives of the last step will do
DISTURBANCE = 1e-6  # of the motion, by which it is moved off an orbit that its neighbours leave


class Tolerance(NamedTuple):
    """Tolerance within which a motion repeats itself: size of the steps, errors in (z, z') and in z0 [m]."""

    step_size: float
    state: float
    offset: float


@kernel
def march_tip(oscillator: Oscillator, step_size: float, tip: MovingTip) -> bool:
    """March a tip for a period of the drive."""
    tip.periods.marched += 1
    return march_oscillator(oscillator, tip.u[Z0], step_size, tip.u, tip.acc) >= 0


@kernel
def march_beside(oscillator: Oscillator, step_size: float, tip: MovingTip, way: Way, y: np.ndarray, to: Change) -> bool:
    """March a period, in y, that begins at tip.u moved by a way, and fill in its changes.

    The surface is that of tip.u; where a dent outlasts a period, it is the one that this period leaves, so that the
    derivatives have the effect of a period on the next. False if contact at the end is not as it was at the begin.
    """
    u, lever = tip.u, oscillator.lever
    copy_memory(u, y)
    lasts = dent_survival(oscillator) > 0
    for again in range(2):  # the second time over the dents that the first time has left
        if again and not (lasts and y[OUTER_COUNT] > 0):
            break
        for i in range(motion_size(lever)):
            y[i] = u[i]
        move_state(lever, way, 1.0, y)
        tip.periods.marched += 1
        if march_oscillator(oscillator, y[Z0], step_size, y, tip.acc) < 0 or y[TOUCHES] != u[TOUCHES]:
            return False
    for i in range(coordinate_count(lever)):
        to.motion[i] = y[entry_of(i)] - (u[entry_of(i)] + way.motion[i])
    to.amplitude = amplitude_of(lever, tip.acc)
    return True


@kernel
def linearise_period(oscillator: Oscillator, step_size: float, tip: MovingTip) -> bool:
    """Fill tip.linear from a period and periods beside it; True if all stay in contact or all out of it."""
    linear, count, y = tip.linear, coordinate_count(oscillator.lever), np.empty(len(tip.u))
    size = (DERIVATIVE_STEP if tip.periods.formed == 0 else DENTED_STEP) * motion_scale(oscillator.lever, tip.u)
    way, beside, linear.count = Way(), Change(), count
    if not march_beside(oscillator, step_size, tip, way, y, linear.now):
        return False
    for i in range(count):
        way.motion[i] = size
        if not march_beside(oscillator, step_size, tip, way, y, beside):
            return False
        way.motion[i] = 0.0
        differentiate(beside, linear.now, size)
        linear.amplitude[i] = beside.amplitude
        for j in range(count):
            linear.motion[count * i + j] = beside.motion[j]
    way.z0 = size
    if not march_beside(oscillator, step_size, tip, way, y, linear.by_z0):
        return False
    differentiate(linear.by_z0, linear.now, size)
    return True


@kernel
def way_left(way: Way, tolerance: Tolerance) -> float:
    """Length of a way, over the tolerance."""
    return max(length_of(way) / tolerance.state, abs(way.z0) / tolerance.offset)


@kernel
def pass_along(
    oscillator: Oscillator, tolerance: Tolerance, target: float, part: float, tip: MovingTip, way: Way, y: np.ndarray
) -> float:
    """Move the state by a share of a way, march a period there, and fill in the way from its begin, linearly.

    Returns the length of that way over the tolerance; infinite where there is none.
    """
    now = Change()
    move_state(oscillator.lever, way, part, tip.u)
    if not march_beside(oscillator, tolerance.step_size, tip, Way(), y, now):
        return math.inf
    copy_memory(y, tip.u)
    fill_way_to_rest(tip.linear, now, target, way)
    return way_left(way, tolerance)


@kernel
def _creep(
    oscillator: Oscillator, tolerance: Tolerance, target: float, tip: MovingTip, way: Way, y: np.ndarray
) -> float:
    """Go on along a way by the same derivatives: twice, or until dents that last are at rest (theory, Eq. (memory-10)).

    Returns the next step, over the tolerance; infinite where there is none. While dents change, what is left of the way
    is that over the share of them that a pass of two periods takes.
    """
    share, remaining = dent_survival(oscillator), math.inf
    most = 2 + int(min(-0.5 * math.log(DENT_GONE) / -math.log(share), MOST_CREEP)) if share > 0 else 2
    farthest = max(CREEP_STEP * motion_scale(oscillator.lever, tip.u), CREEP_GROWTH * max(length_of(way), abs(way.z0)))
    for i in range(most):
        remaining = pass_along(oscillator, tolerance, target, 1.0, tip, way, y)
        if not remaining < math.inf or (share > 0 and not max(length_of(way), abs(way.z0)) <= farthest):
            return math.inf
        if i > 0 and (share == 0 or y[OUTER_COUNT] == 0 or remaining <= 1 - share * share):
            break
    return remaining


@kernel(shared=True)
def skip_transient(oscillator: Oscillator, tolerance: Tolerance, target: float, tip: MovingTip) -> bool:
    """Skip the transient where it is a linear decay: put tip.u at its end, and tip.acc to the period there.

    The decay is measured, not assumed: neighbours must approach (Floquet multipliers inside the unit circle and, where
    an amplitude `target` is held, a feedback that pulls back), and the way left after a skip must be at most a quarter
    of the skip (Deuflhard's natural monotonicity test). Where that fails, u is left alone and time has to pass.

    Returns whether the tip is at rest.
    """
    lever, u, linear, y = oscillator.lever, tip.u, tip.linear, np.empty(len(tip.u))
    now, way, ahead = Change(), Way(), Way()
    for _ in range(MOST_SKIPS):
        if not linearise_period(oscillator, tolerance.step_size, tip):
            return False
        if not floquet_multiplier(linear) < 1 or (target > 0.0 and not amplitude_slope(linear) > 0):
            return False
        fill_way_to_rest(linear, linear.now, target, way)
        before = way_left(way, tolerance)
        near = before * tolerance.state <= NEAR_ORBIT * motion_scale(lever, u)
        moved, remaining = False, before
        while before > 1 or not moved:
            if not march_beside(oscillator, tolerance.step_size, tip, way, y, now):
                return False
            fill_way_to_rest(linear, now, target, ahead)
            remaining = way_left(ahead, tolerance)
            if not (remaining <= 1 or remaining <= 0.25 * before):
                break
            move_state(lever, way, 1.0, u)
            copy_memory(y, u)
            assign(way, ahead)
            before, moved = remaining, True
        if moved and before <= 1 and near:  # so near that the derivatives are those at the end
            remaining = _creep(oscillator, tolerance, target, tip, way, y)
            return remaining <= 1 or (dent_survival(oscillator) == 0 and remaining < math.inf)
        if moved:
            continue
        # Where dents last, what is left of the way may be theirs.
        if not (remaining <= before and dent_survival(oscillator) > 0):
            return False
        where = u.copy()
        remaining = _creep(oscillator, tolerance, target, tip, way, y)
        if not (remaining <= 1 or remaining <= 0.25 * before):
            copy(where, u)
            return False
    return False


@kernel
def come_to_rest(oscillator: Oscillator, tolerance: Tolerance, most_periods: int, tip: MovingTip) -> bool:
    """Let time pass at fixed z0 until the orbit repeats itself, for `most_periods` periods; False if it does not."""
    lever = oscillator.lever
    end = tip.periods.marched + most_periods
    wait = max(3, (ring_down_periods(lever) - 1) // 2)  # half the lever's decay time
    while tip.periods.marched < end:
        if skip_transient(oscillator, tolerance, 0.0, tip):
            return True
        if not floquet_multiplier(tip.linear) < 1:
            # An orbit that its neighbours leave is left at the slightest disturbance: here it is.
            tip.u[Z] *= 1 + DISTURBANCE
            tip.u[V] *= 1 + DISTURBANCE
        for _ in range(min(wait, end - tip.periods.marched)):
            if not march_tip(oscillator, tolerance.step_size, tip):
                return False
    return False


@kernel
def hold_periodic(
    oscillator: Oscillator, tolerance: Tolerance, amplitude: float, most_periods: int, tip: MovingTip, row: np.ndarray
) -> int:
    """Bring a periodic orbit to the amplitude, as a slow feedback does, and fill the row.

    Steps of the tip offset get longer as long as the amplitude goes with it as predicted: a tip that sticks is freed.

    Returns GOOD; NOT_SETTLED where the motion does not repeat itself on the way, or after `most_periods` in all; or
    NO_STABLE_ORBIT where the amplitude jumps across the setpoint.
    """
    law, p, lever = oscillator
    snap = abs(contact_force(law, 0.0, p)) / lever[col.STIFFNESS]
    farthest = FARTHEST * lever[col.DRIVE] / lever[col.ALPHA0] + 2 * snap  # and twice to pull-off
    stride, longest = FEEDBACK_STRIDE * amplitude, max(FEEDBACK_STRIDE * amplitude, TO_RELEASE * snap)
    last = move = 0.0
    jumps, before, slopes = 0, np.empty(motion_size(lever)), Way()
    patience = int(SETTLING_TIME * ring_down_periods(lever))
    while not skip_transient(oscillator, tolerance, amplitude, tip):
        if not come_to_rest(oscillator, tolerance, min(patience, most_periods - tip.periods.marched), tip):
            return col.NOT_SETTLED
        error = amplitude_of(lever, tip.acc) - amplitude
        if error * last < 0:
            stride = 0.5 * min(stride, FEEDBACK_STRIDE * amplitude)
            jumps += abs(error - last) > max(2.0 * abs(move), FEEDBACK_JUMP * amplitude)
        far = last != 0.0 and not abs(tip.u[Z0]) < farthest  # a tip pressed in as far may be held at once
        last = error
        # A setpoint inside a jump is passed again and again, and one above the free amplitude is never reached.
        if stride < LEAST_FEEDBACK_STRIDE * amplitude or jumps > MOST_JUMPS or far:
            return col.NO_STABLE_ORBIT
        slope = slopes_of_orbit(tip.linear, slopes)
        wanted = error / max(slope, LEAST_FEEDBACK_SLOPE)
        move = max(-stride, min(wanted, stride))
        copy_state(tip.u, before)
        if law.memory != 0:
            # A slow feedback takes the orbit along. A tip moved without it may lose a surface that it only just
            # reaches, grow towards its free amplitude, and land on the other side of the resonance.
            move_state(lever, slopes, -move, tip.u)
        else:
            tip.u[Z0] -= move
        if abs(move) > FEEDBACK_STRIDE * amplitude:
            if not come_to_rest(oscillator, tolerance, min(patience, most_periods - tip.periods.marched), tip):
                return col.NOT_SETTLED
            if abs(amplitude_of(lever, tip.acc) - amplitude - error + slope * move) > LINEAR_MISS * amplitude:
                copy(before, tip.u)
                stride = FEEDBACK_STRIDE * amplitude
                move = math.copysign(stride, move)
                tip.u[Z0] -= move
                continue
        if abs(wanted) > stride:
            stride = min(2.0 * stride, longest)
    fill_row_at_rest(lever, tip, row)
    return col.GOOD


@kernel
def fill_row_of_period(lever: np.ndarray, z0: float, acc: PeriodResult, row: np.ndarray) -> None:
    """Fill a result row of z from the observables of a period, or their means over many: balances are linear in them.

    Entries that these do not determine are NaN. In phase, A (1 - omega^2 + 2 i alpha0 omega) + G_1 = u0 exp(i lag); in
    energy, what the drive gives is dissipated.
    """
    lag = math.atan2(acc.sin, acc.cos)
    row[:] = math.nan
    row[col.TIP_OFFSET] = z0
    row[col.MEAN] = acc.mean_z
    row[col.PHASE] = math.pi / 2 - lag
    row[col.AMPLITUDE] = math.hypot(acc.cos, acc.sin)
    row[col.INDENTATION] = acc.deepest
    row[col.DISSIPATION] = acc.loss
    row[col.VIRIAL] = acc.virial
    row[col.STIFFENING] = lever[col.DRIVE] * math.cos(lag) / row[col.AMPLITUDE] - lever[col.DYNAMIC_STIFFNESS]
    air = acc.air
    if lever[col.MODES] > 1:
        air = air_beside_first_harmonic(lever, complex(acc.cos, -acc.sin), air)
    supplied = math.pi * lever[col.STIFFNESS] * lever[col.DRIVE] * acc.sin
    row[col.CLOSURE] = energy_closure(supplied, acc.loss, air)


@kernel
def fill_row_at_rest(lever: np.ndarray, tip: MovingTip, row: np.ndarray) -> None:
    """Fill a result row from a tip that `skip_transient` has put to rest."""
    fill_row_of_period(lever, tip.u[Z0], tip.acc, row)
    row[col.FLOQUET], row[col.SLOPE] = floquet_multiplier(tip.linear), amplitude_slope(tip.linear)
