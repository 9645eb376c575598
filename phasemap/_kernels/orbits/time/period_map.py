"""Periodic orbits in time: Newton's method on the map of one period of the drive, by differences of marched periods.

See theory, Eqs. (time-3) and (time-4).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.arrays import copy
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator, contact_force
from phasemap._kernels.orbits.time.by_memory import lingering
from phasemap._kernels.orbits.time.elements import OUTER_COUNT
from phasemap._kernels.orbits.time.march import march_period
from phasemap._kernels.orbits.time.tip import (
    PLAIN_STATE,
    TOUCHES,
    Z0,
    Change,
    PeriodMap,
    PeriodResult,
    Tip,
    V,
    Z,
    add_period,
    amplitude_of,
    copy_memory,
    divide_result,
    ring_down_periods,
    ringing_periods,
)
from phasemap._kernels.records import assign

if TYPE_CHECKING:
    from phasemap._kernels.orbits.time.runge_kutta import Numbers

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


class Tolerance(NamedTuple):
    """When a motion counts as one that repeats itself: size of the steps, errors allowed in (z, z') and in z0 [m]."""

    eta: float
    state: float
    offset: float


@kernel
def march_tip(oscillator: Oscillator, eta: float, tip: Tip) -> bool:
    """March a tip for a period of the drive."""
    tip.periods.marched += 1
    return march_period(oscillator, tip.u[Z0], eta, tip.u, tip.acc) >= 0


@kernel
def pass_pattern(oscillator: Oscillator, z0: float, eta: float, tip: Tip, y: np.ndarray) -> bool:
    """March y, over the periods after which the motion is taken to repeat itself; tip.acc is their mean."""
    acc, count = tip.acc, max(tip.periods.pattern, 1)
    tip.periods.marched += count
    done = march_period(oscillator, z0, eta, y, acc) >= 0
    if count == 1 or not done:
        return done
    total = PeriodResult()
    assign(total, acc)
    for _ in range(count - 1):
        if march_period(oscillator, z0, eta, y, acc) < 0:
            return False
        add_period(total, acc)
    assign(acc, total)
    divide_result(acc, float(count))
    return True


@kernel
def pass_from(oscillator: Oscillator, eta: float, tip: Tip, z: float, v: float, z0: float, y: np.ndarray) -> bool:
    """March a period from (z, v) at z0 in y, and say whether it ends, as it began, in contact or out of it.

    The surface is as tip.u has it; where a dent outlasts a period, as the same period leaves it, so that what the next
    period owes to this one counts in its derivatives.
    """
    u = tip.u
    copy_memory(u, y)
    lasts = lingering(oscillator) > 0
    for again in range(2):
        if again and not (lasts and y[OUTER_COUNT] > 0):
            break
        y[Z], y[V], y[TOUCHES] = z, v, u[TOUCHES]
        if not pass_pattern(oscillator, z0, eta, tip, y) or y[TOUCHES] != u[TOUCHES]:
            return False
    return True


@kernel
def neighbour_distance(lever: np.ndarray, tip: Tip) -> float:
    """How far beside a motion [m] others are marched for its derivatives."""
    share = DERIVATIVE_STEP if tip.periods.formed == 0 else DENTED_STEP
    return share * (math.hypot(tip.u[Z], tip.u[V]) + lever[col.DRIVE])


@kernel
def differentiate(beside: Change, now: Change, size: float) -> None:
    """Turn what a period changes `size` beside a motion into the derivative of that."""
    beside.z = (beside.z - now.z) / size
    beside.v = (beside.v - now.v) / size
    beside.amplitude = (beside.amplitude - now.amplitude) / size


@kernel
def linearise_period(oscillator: Oscillator, eta: float, tip: Tip) -> bool:
    """Fill tip.linear from a period and three beside it; says whether all stay in contact or out of it."""
    lever = oscillator.lever
    u, acc, linear = tip.u, tip.acc, tip.linear
    size = neighbour_distance(lever, tip)
    y = np.empty(len(u))
    for k in range(4):
        z = u[Z] + (size if k == 1 else 0.0)
        v = u[V] + (size if k == 2 else 0.0)
        if not pass_from(oscillator, eta, tip, z, v, u[Z0] + (size if k == 3 else 0.0), y):
            return False
        found = linear.now if k == 0 else linear.by_z if k == 1 else linear.by_v if k == 2 else linear.by_z0
        found.z, found.v, found.amplitude = y[Z] - z, y[V] - v, amplitude_of(lever, acc)
        if k != 0:
            differentiate(found, linear.now, size)
    return True


@kernel
def relaxed(linear: PeriodMap, r0: float, r1: float) -> tuple[float, float]:
    """How far (z, z') goes to rest if it now changes by r a period: r + P' r + P' P' r + ... = (1 - P')^-1 r."""
    scale = 1 / (linear.by_z.z * linear.by_v.v - linear.by_v.z * linear.by_z.v)
    return (linear.by_v.z * r1 - linear.by_v.v * r0) * scale, (linear.by_z.v * r0 - linear.by_z.z * r1) * scale


@kernel
def amplitude_slope(linear: PeriodMap) -> float:
    """dA/dz0 after the transient."""
    z, v = relaxed(linear, linear.by_z0.z, linear.by_z0.v)
    return linear.by_z0.amplitude + linear.by_z.amplitude * z + linear.by_v.amplitude * v


@kernel
def multiplier_of(linear: PeriodMap) -> float:
    """Largest modulus of the Floquet multipliers: the eigenvalues of P'."""
    half = 1 + 0.5 * (linear.by_z.z + linear.by_v.v)
    product = (1 + linear.by_z.z) * (1 + linear.by_v.v) - linear.by_v.z * linear.by_z.v
    apart = 0.25 * (linear.by_z.z - linear.by_v.v) ** 2 + linear.by_v.z * linear.by_z.v
    return abs(half) + math.sqrt(apart) if apart > 0 else math.sqrt(product)


@kernel
def way_to_rest(linear: PeriodMap, r0: float, r1: float, error: float, hold: bool) -> Numbers:
    """Way of (z, z', z0) to rest; with `hold`, z0 moves by the amplitude's error after the transient, over slope."""
    z, v = relaxed(linear, r0, r1)
    if not hold:
        return z, v, 0.0
    move = -(error + linear.by_z.amplitude * z + linear.by_v.amplitude * v) / amplitude_slope(linear)
    z_move, v_move = relaxed(linear, linear.by_z0.z, linear.by_z0.v)
    return z + z_move * move, v + v_move * move, move


@kernel
def _creep(
    oscillator: Oscillator, tolerance: Tolerance, target: float, tip: Tip, ahead: Numbers, y: np.ndarray
) -> float:
    """Go on `ahead` by the same derivatives: twice, or until dents that last are at rest (theory, Eq. (memory-10)).

    Returns the next step, over the tolerance; infinite where there is none. While dents change, what is left of the way
    is that over the share of them that a pass of two periods takes.
    """
    lever = oscillator.lever
    eta, y_limit, z0_limit = tolerance
    u, share, (z, v, move) = tip.u, lingering(oscillator), ahead
    most = 2 + int(min(-0.5 * math.log(DENT_GONE) / -math.log(share), MOST_CREEP)) if share > 0 else 2
    farthest = max(
        CREEP_STEP * (math.hypot(u[Z], u[V]) + lever[col.DRIVE]), CREEP_GROWTH * max(math.hypot(z, v), abs(move))
    )
    left = math.inf
    for i in range(most):
        u[Z], u[V], u[Z0] = u[Z] + z, u[V] + v, u[Z0] + move
        if not pass_from(oscillator, eta, tip, u[Z], u[V], u[Z0], y):
            return math.inf
        copy_memory(y, u)
        error = amplitude_of(lever, tip.acc) - target
        z, v, move = way_to_rest(tip.linear, y[Z] - u[Z], y[V] - u[V], error, target > 0.0)
        left = max(math.hypot(z, v) / y_limit, abs(move) / z0_limit)
        if share > 0 and not max(math.hypot(z, v), abs(move)) <= farthest:
            return math.inf
        if i > 0 and (share == 0 or y[OUTER_COUNT] == 0 or left <= 1 - share * share):
            break
    return left


@kernel(shared=True)
def skip(oscillator: Oscillator, tolerance: Tolerance, target: float, tip: Tip) -> bool:
    """Skip the transient where it is a linear decay: put tip.u at its end, and tip.acc to the period there.

    The decay is measured, not assumed: neighbours must approach (Floquet multipliers inside the unit circle and, where
    an amplitude `target` is held, a feedback that pulls back), and the way left after a skip must be at most a quarter
    of the skip (Deuflhard's natural monotonicity test). Where that fails, u is left alone and time has to pass.

    Returns whether the tip is at rest.
    """
    lever = oscillator.lever
    eta, y_limit, z0_limit = tolerance
    hold = target > 0.0
    u, acc, linear = tip.u, tip.acc, tip.linear
    trial, y = np.empty(PLAIN_STATE), np.empty(len(u))
    for _ in range(20):
        if not linearise_period(oscillator, eta, tip):
            return False
        if not multiplier_of(linear) < 1 or (hold and not amplitude_slope(linear) > 0):
            return False
        z, v, move = way_to_rest(linear, linear.now.z, linear.now.v, linear.now.amplitude - target, hold)
        way = max(math.hypot(z, v) / y_limit, abs(move) / z0_limit)
        near = way * y_limit <= 1e-4 * (math.hypot(u[Z], u[V]) + lever[col.DRIVE])
        moved, left = False, way
        while way > 1 or not moved:
            trial[Z], trial[V], trial[TOUCHES], trial[Z0] = u[Z] + z, u[V] + v, u[TOUCHES], u[Z0] + move
            if not pass_from(oscillator, eta, tip, trial[Z], trial[V], trial[Z0], y):
                return False
            error = amplitude_of(lever, acc) - target
            z, v, move = way_to_rest(linear, y[Z] - trial[Z], y[V] - trial[V], error, hold)
            left = max(math.hypot(z, v) / y_limit, abs(move) / z0_limit)
            if not (left <= 1 or left <= 0.25 * way):
                break
            for i in range(PLAIN_STATE):
                u[i] = trial[i]
            copy_memory(y, u)
            way, moved = left, True
        if moved and way <= 1 and near:  # so near that the derivatives are those at the end
            left = _creep(oscillator, tolerance, target, tip, (z, v, move), y)
            return left <= 1 or (lingering(oscillator) == 0 and left < math.inf)
        if moved:
            continue
        # Where dents last, what is left of the way may be theirs.
        if not (left <= way and lingering(oscillator) > 0):
            return False
        before = u.copy()
        ahead = way_to_rest(linear, linear.now.z, linear.now.v, linear.now.amplitude - target, hold)
        left = _creep(oscillator, tolerance, target, tip, ahead, y)
        if not (left <= 1 or left <= 0.25 * way):
            copy(before, u)
            return False
    return False


@kernel
def rest(oscillator: Oscillator, tolerance: Tolerance, most: int, tip: Tip) -> bool:
    """Let time pass at fixed z0 until the orbit repeats itself, for `most` periods; returns as `skip`."""
    lever = oscillator.lever
    end = tip.periods.marched + most
    wait = max(3, int(0.5 * ringing_periods(lever)))  # half the lever's decay time
    while tip.periods.marched < end:
        if skip(oscillator, tolerance, 0.0, tip):
            return True
        if not multiplier_of(tip.linear) < 1:
            # An orbit that its neighbours leave is left at the slightest disturbance: here it is.
            tip.u[Z] *= 1 + 1e-6
            tip.u[V] *= 1 + 1e-6
        for _ in range(min(wait, end - tip.periods.marched)):
            if not march_tip(oscillator, tolerance.eta, tip):
                return False
    return False


@kernel
def hold_periodic(
    oscillator: Oscillator, tolerance: Tolerance, amplitude: float, most: int, tip: Tip, row: np.ndarray
) -> int:
    """Bring a periodic orbit to the amplitude, as a slow feedback does, and fill the row.

    Steps of the tip offset get longer as long as the amplitude goes with it as predicted: a tip that sticks is freed.

    Returns GOOD; NOT_SETTLED where the motion does not repeat itself on the way, or after `most` periods in all; or
    NO_STABLE_ORBIT where the amplitude jumps across the setpoint.
    """
    law, p, lever = oscillator
    snap = abs(contact_force(law, 0.0, p)) / lever[col.STIFFNESS]
    farthest = 50 * lever[col.DRIVE] / lever[col.ALPHA0] + 2 * snap  # 100 free amplitudes, and twice to pull-off
    stride, longest = FEEDBACK_STRIDE * amplitude, max(FEEDBACK_STRIDE * amplitude, TO_RELEASE * snap)
    last = move = 0.0
    jumps, before = 0, np.empty(PLAIN_STATE)
    patience = int(SETTLING_TIME * ring_down_periods(lever))
    while not skip(oscillator, tolerance, amplitude, tip):
        if not rest(oscillator, tolerance, min(patience, most - tip.periods.marched), tip):
            return col.NOT_SETTLED
        error = amplitude_of(lever, tip.acc) - amplitude
        if error * last < 0:
            stride = 0.5 * min(stride, FEEDBACK_STRIDE * amplitude)
            jumps += abs(error - last) > max(2.0 * abs(move), 0.02 * amplitude)
        last = error
        # A setpoint inside a jump is passed again and again, and one above the free amplitude is never reached.
        if stride < 1e-4 * amplitude or jumps > MOST_JUMPS or not abs(tip.u[Z0]) < farthest:
            return col.NO_STABLE_ORBIT
        slope = amplitude_slope(tip.linear)
        wanted = error / max(slope, 0.2)
        move = max(-stride, min(wanted, stride))
        for j in range(PLAIN_STATE):
            before[j] = tip.u[j]
        if law.memory != 0:
            # A slow feedback takes the orbit along. A tip moved without it may lose a surface that it only just
            # reaches, grow towards its free amplitude, and land on the other side of the resonance.
            z, v = relaxed(tip.linear, tip.linear.by_z0.z, tip.linear.by_z0.v)
            tip.u[Z], tip.u[V] = tip.u[Z] - z * move, tip.u[V] - v * move
        tip.u[Z0] -= move
        if abs(move) > FEEDBACK_STRIDE * amplitude:
            if not rest(oscillator, tolerance, min(patience, most - tip.periods.marched), tip):
                return col.NOT_SETTLED
            if abs(amplitude_of(lever, tip.acc) - amplitude - error + slope * move) > LINEAR_MISS * amplitude:
                for j in range(PLAIN_STATE):
                    tip.u[j] = before[j]
                stride = FEEDBACK_STRIDE * amplitude
                move = math.copysign(stride, move)
                tip.u[Z0] -= move
                continue
        if abs(wanted) > stride:
            stride = min(2.0 * stride, longest)
    fill_orbit(lever, tip, row)
    return col.GOOD


@kernel
def fill_row(lever: np.ndarray, z0: float, acc: PeriodResult, row: np.ndarray) -> None:
    """Fill a result row of z from what a period gave, or many in the mean: their balances are linear, so the same.

    What that does not say is NaN. In phase, A (1 - omega^2 + 2 i alpha0 omega) + G_1 = u0 exp(i lag); in energy, what
    the drive gives is dissipated.
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
    supplied = math.pi * lever[col.STIFFNESS] * lever[col.DRIVE] * acc.sin
    row[col.CLOSURE] = (supplied - acc.loss - acc.air) / supplied


@kernel
def fill_orbit(lever: np.ndarray, tip: Tip, row: np.ndarray) -> None:
    """Fill a result row from a tip that `skip` has put to rest."""
    fill_row(lever, tip.u[Z0], tip.acc, row)
    row[col.FLOQUET], row[col.SLOPE] = multiplier_of(tip.linear), amplitude_slope(tip.linear)
