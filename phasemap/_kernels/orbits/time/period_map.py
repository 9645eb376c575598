"""Periodic orbits in time: Newton's method on the map of one period of the drive, by differences of marched periods.

See theory, Eqs. (time-3) and (time-4).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import contact_force
from phasemap._kernels.orbits.time.by_memory import lingering
from phasemap._kernels.orbits.time.elements import STATE
from phasemap._kernels.orbits.time.march import march_period

if TYPE_CHECKING:
    from phasemap._kernels.law import Law
    from phasemap._kernels.orbits.time.runge_kutta import Numbers

PATIENCE = 40.0  # ring-down times in which a motion has to settle, if it does
STRIDE, TO_RELEASE = 0.1, 0.05  # steps of a feedback, of the amplitude, and of the way that a tip must go to come free
EXPECTED = 0.1  # of the amplitude, by which the longer of these may miss a linear prediction
MOST_JUMPS = 3  # of the amplitude across the setpoint: then it goes on so for ever


class Tip(NamedTuple):
    """A tip in time.

    Attributes
    ----------
    u : ndarray, shape (4,) or longer
        z, z' [m] at drive phase 0, whether it is in contact or in the neck, and the tip offset z0 [m]; and what a
        surface remembers that does, `elements`.
    acc : ndarray, shape (7,)
        What the last period gave, as `march_period` has it.
    linear : ndarray, shape (16,)
        [0:3] is the change of z, that of z' and the amplitude A of a period from u; [4 j : 4 j + 3], j = 1, 2, 3, are
        their derivatives by z, z' and z0.
    periods : ndarray of int, shape (1,)
        How many were marched.
    """

    u: np.ndarray
    acc: np.ndarray
    linear: np.ndarray
    periods: np.ndarray


@kernel
def new_tip(law: Law, z: float, v: float, z0: float) -> Tip:
    """Return a tip out of contact, or as its depth says, over a surface that nothing has touched."""
    u = np.zeros(STATE if law.memory != 0 else 4)
    u[0], u[1], u[3] = z, v, z0
    return Tip(u, np.zeros(7), np.zeros(16), np.zeros(1, np.int64))


@kernel
def ring_down(lever: np.ndarray) -> int:
    """Periods in which the amplitude of the free lever falls to 1/e, Q / pi at resonance; at least 1."""
    return int(lever[col.OMEGA] / (2 * math.pi * lever[col.ALPHA0])) + 1


@kernel
def amplitude_of(lever: np.ndarray, acc: np.ndarray) -> float:
    """Amplitude [m] that the detector sees in a period: of the first harmonic of z, less that of the lever's base."""
    return math.hypot(acc[0] - lever[col.SHAKER], acc[1])


@kernel
def pass_period(law: Law, p: np.ndarray, lever: np.ndarray, eta: float, tip: Tip) -> bool:
    """March a tip for a period of the drive."""
    tip.periods[0] += 1
    return march_period(law, p, lever, tip.u[3], eta, tip.u, tip.acc) >= 0


@kernel
def carry(u: np.ndarray, to: np.ndarray) -> None:
    """Carry over what the surface remembers, if it does."""
    for i in range(4, len(u)):
        to[i] = u[i]


@kernel
def pass_from(
    law: Law, p: np.ndarray, lever: np.ndarray, eta: float, tip: Tip, z: float, v: float, z0: float, y: np.ndarray
) -> bool:
    """March a period from (z, v) at z0 in y, and say whether it ends, as it began, in contact or out of it.

    The surface is as tip.u has it; where a dent outlasts a period, as the same period leaves it, so that what the next
    period owes to this one counts in its derivatives.
    """
    u, acc = tip.u, tip.acc
    carry(u, y)
    if lingering(law, p, lever) > 0:
        y[0], y[1], y[2] = z, v, u[2]
        tip.periods[0] += 1
        if march_period(law, p, lever, z0, eta, y, acc) < 0 or y[2] != u[2]:
            return False
    y[0], y[1], y[2] = z, v, u[2]
    tip.periods[0] += 1
    return march_period(law, p, lever, z0, eta, y, acc) >= 0 and y[2] == u[2]


@kernel
def linearise(law: Law, p: np.ndarray, lever: np.ndarray, eta: float, tip: Tip) -> bool:
    """Fill tip.linear from a period and three beside it; says whether all stay in contact or out of it."""
    u, acc, linear = tip.u, tip.acc, tip.linear
    size = 3e-8 * (math.hypot(u[0], u[1]) + lever[col.BASE])
    y = np.empty(len(u))
    for j in range(4):
        z = u[0] + (size if j == 1 else 0.0)
        v = u[1] + (size if j == 2 else 0.0)
        if not pass_from(law, p, lever, eta, tip, z, v, u[3] + (size if j == 3 else 0.0), y):
            return False
        linear[4 * j], linear[4 * j + 1], linear[4 * j + 2] = y[0] - z, y[1] - v, amplitude_of(lever, acc)
        if j > 0:
            for i in range(3):
                linear[4 * j + i] = (linear[4 * j + i] - linear[i]) / size
    return True


@kernel
def relaxed(linear: np.ndarray, r0: float, r1: float) -> tuple[float, float]:
    """How far (z, z') goes to rest if it now changes by r a period: r + P' r + P' P' r + ... = (1 - P')^-1 r."""
    scale = 1 / (linear[4] * linear[9] - linear[8] * linear[5])
    return (linear[8] * r1 - linear[9] * r0) * scale, (linear[5] * r0 - linear[4] * r1) * scale


@kernel
def slope_of(linear: np.ndarray) -> float:
    """dA/dz0 after the transient."""
    z, v = relaxed(linear, linear[12], linear[13])
    return linear[14] + linear[6] * z + linear[10] * v


@kernel
def multiplier_of(linear: np.ndarray) -> float:
    """Largest modulus of the Floquet multipliers: the eigenvalues of P'."""
    half = 1 + 0.5 * (linear[4] + linear[9])
    product = (1 + linear[4]) * (1 + linear[9]) - linear[8] * linear[5]
    apart = 0.25 * (linear[4] - linear[9]) ** 2 + linear[8] * linear[5]
    return abs(half) + math.sqrt(apart) if apart > 0 else math.sqrt(product)


@kernel
def _ahead(linear: np.ndarray, r0: float, r1: float, error: float, hold: bool) -> Numbers:
    """Way of (z, z', z0) to rest; with `hold`, z0 moves by the amplitude's error after the transient, over slope."""
    z, v = relaxed(linear, r0, r1)
    if not hold:
        return z, v, 0.0
    move = -(error + linear[6] * z + linear[10] * v) / slope_of(linear)
    z_move, v_move = relaxed(linear, linear[12], linear[13])
    return z + z_move * move, v + v_move * move, move


@kernel(shared=True)
def skip(law: Law, p: np.ndarray, lever: np.ndarray, how: Numbers, target: float, tip: Tip) -> bool:
    """Skip the transient where it is a linear decay: put tip.u at its end, and tip.acc to the period there.

    The decay is measured, not assumed: neighbours must approach (Floquet multipliers inside the unit circle and, where
    an amplitude `target` is held, a feedback that pulls back), and the way left after a skip must be at most a quarter
    of the skip (Deuflhard's natural monotonicity test). Where that fails, u is left alone and time has to pass.

    `how` is eta and the errors allowed in (z, z') and z0. Returns whether the tip is at rest.
    """
    eta, y_limit, z0_limit = how
    hold = target > 0.0
    u, acc, linear = tip.u, tip.acc, tip.linear
    trial, y = np.empty(4), np.empty(len(u))
    for _ in range(20):
        if not linearise(law, p, lever, eta, tip):
            return False
        if not multiplier_of(linear) < 1 or (hold and not slope_of(linear) > 0):
            return False
        z, v, move = _ahead(linear, linear[0], linear[1], linear[2] - target, hold)
        way = max(math.hypot(z, v) / y_limit, abs(move) / z0_limit)
        near = way * y_limit <= 1e-4 * (math.hypot(u[0], u[1]) + lever[col.BASE])
        moved = False
        while way > 1 or not moved:
            trial[0], trial[1], trial[2], trial[3] = u[0] + z, u[1] + v, u[2], u[3] + move
            if not pass_from(law, p, lever, eta, tip, trial[0], trial[1], trial[3], y):
                return False
            error = amplitude_of(lever, acc) - target
            z, v, move = _ahead(linear, y[0] - trial[0], y[1] - trial[1], error, hold)
            left = max(math.hypot(z, v) / y_limit, abs(move) / z0_limit)
            if not (left <= 1 or left <= 0.25 * way):
                break
            for i in range(4):
                u[i] = trial[i]
            carry(y, u)
            way, moved = left, True
        if not moved:
            return False
        if way <= 1 and near:  # so near that the derivatives are those at the end
            for _ in range(2 + lingering(law, p, lever)):
                u[0], u[1], u[3] = u[0] + z, u[1] + v, u[3] + move
                if not pass_from(law, p, lever, eta, tip, u[0], u[1], u[3], y):
                    return False
                carry(y, u)
                error = amplitude_of(lever, acc) - target
                z, v, move = _ahead(linear, y[0] - u[0], y[1] - u[1], error, hold)
            return True
    return False


@kernel
def rest(law: Law, p: np.ndarray, lever: np.ndarray, how: Numbers, most: int, tip: Tip) -> bool:
    """Let time pass at fixed z0 until the orbit repeats itself, for `most` periods; returns as `skip`."""
    end = tip.periods[0] + most
    wait = max(3, int(lever[col.OMEGA] / (4 * math.pi * lever[col.ALPHA0])))  # half the lever's decay time
    while tip.periods[0] < end:
        if skip(law, p, lever, how, 0.0, tip):
            return True
        if not multiplier_of(tip.linear) < 1:
            # An orbit that its neighbours leave is left at the slightest disturbance: here it is.
            tip.u[0] *= 1 + 1e-6
            tip.u[1] *= 1 + 1e-6
        for _ in range(min(wait, end - tip.periods[0])):
            if not pass_period(law, p, lever, how[0], tip):
                return False
    return False


@kernel
def hold_periodic(
    law: Law, p: np.ndarray, lever: np.ndarray, how: Numbers, amplitude: float, most: int, tip: Tip,
    row: np.ndarray,
) -> int:  # fmt: skip
    """Bring a periodic orbit to the amplitude, as a slow feedback does, and fill the row.

    Steps of the tip offset get longer as long as the amplitude goes with it as predicted: a tip that sticks is freed.

    Returns GOOD; NOT_SETTLED where the motion does not repeat itself on the way, or after `most` periods in all; or
    NO_STABLE_ORBIT where the amplitude jumps across the setpoint.
    """
    snap = abs(contact_force(law, 0.0, p)) / lever[col.STIFFNESS]
    farthest = 50 * lever[col.BASE] / lever[col.ALPHA0] + 2 * snap  # 100 free amplitudes, and twice to pull-off
    stride, longest = STRIDE * amplitude, max(STRIDE * amplitude, TO_RELEASE * snap)
    last = move = 0.0
    jumps, before = 0, np.empty(4)
    patience = int(PATIENCE * ring_down(lever))
    while not skip(law, p, lever, how, amplitude, tip):
        if not rest(law, p, lever, how, min(patience, most - tip.periods[0]), tip):
            return col.NOT_SETTLED
        error = amplitude_of(lever, tip.acc) - amplitude
        if error * last < 0:
            stride = 0.5 * min(stride, STRIDE * amplitude)
            jumps += abs(error - last) > max(2.0 * abs(move), 0.02 * amplitude)
        last = error
        # A setpoint inside a jump is passed again and again, and one above the free amplitude is never reached.
        if stride < 1e-4 * amplitude or jumps > MOST_JUMPS or not abs(tip.u[3]) < farthest:
            return col.NO_STABLE_ORBIT
        slope = slope_of(tip.linear)
        wanted = error / max(slope, 0.2)
        move = max(-stride, min(wanted, stride))
        for j in range(4):
            before[j] = tip.u[j]
        tip.u[3] -= move
        if abs(move) > STRIDE * amplitude:
            if not rest(law, p, lever, how, min(patience, most - tip.periods[0]), tip):
                return col.NOT_SETTLED
            if abs(amplitude_of(lever, tip.acc) - amplitude - error + slope * move) > EXPECTED * amplitude:
                for j in range(4):
                    tip.u[j] = before[j]
                stride = STRIDE * amplitude
                move = math.copysign(stride, move)
                tip.u[3] -= move
                continue
        if abs(wanted) > stride:
            stride = min(2.0 * stride, longest)
    fill_orbit(lever, tip, row)
    return col.GOOD


@kernel
def fill(lever: np.ndarray, z0: float, acc: np.ndarray, row: np.ndarray) -> None:
    """Fill a result row of z from what a period gave, or many in the mean: their balances are linear, so the same.

    What that does not say is NaN. In phase, A (1 - omega^2 + 2 i alpha0 omega) + G_1 = u0 exp(i lag); in energy, what
    the drive gives is dissipated.
    """
    lag = math.atan2(acc[1], acc[0])
    row[:] = math.nan
    row[col.TIP_OFFSET] = z0
    row[col.MEAN] = acc[2]
    row[col.PHASE] = math.pi / 2 - lag
    row[col.AMPLITUDE] = math.hypot(acc[0], acc[1])
    row[col.INDENTATION] = acc[5]
    row[col.DISSIPATION] = acc[3]
    row[col.VIRIAL] = acc[4]
    row[col.STIFFENING] = lever[col.BASE] * math.cos(lag) / row[col.AMPLITUDE] - 1 + lever[col.OMEGA] ** 2
    supplied = math.pi * lever[col.STIFFNESS] * lever[col.BASE] * acc[1]
    row[col.CLOSURE] = (supplied - acc[3] - acc[6]) / supplied


@kernel
def fill_orbit(lever: np.ndarray, tip: Tip, row: np.ndarray) -> None:
    """Fill a result row from a tip that `skip` has put to rest."""
    fill(lever, tip.u[3], tip.acc, row)
    row[col.FLOQUET], row[col.SLOPE] = multiplier_of(tip.linear), slope_of(tip.linear)
