"""The full equation of motion marched in time: the slow, independent truth.

    z'' + 2 (alpha0 + alpha_s(d)) z' + z + F(d)/k = u0 cos(omega tau),    d = z - z0          (Wang 1999, Eq. 1)

by an explicit Runge-Kutta method of order 8 (`tableau`) on steps laid out by a smooth density; no error control repeats
them, so the error is C eta^8. Order 8 needs an analytic right-hand side, and F ~ d^(3/2), alpha_s ~ d^(1/2) are not:

* out of contact the state is (d, v) and the independent variable s is the time tau;
* in contact it is (q, v), q = sqrt(d), with dtau = 2 q ds:    q' = v,    v' = 2 q z'',    tau' = 2 q,
  in which every multiple of 1/2 is an analytic power of d, through q = 0 and beyond;
* in the neck, which a law with a depth of release d_r < 0 draws out on the way back, it is (q, v), q = sqrt(d - d_r),
  in which the force of JKR, a power series in q, is analytic up to release;
* each change from one to the other is the end of a step, found by Newton's method on the step's length.

All are x' = v, v' = w z'', tau' = w with (x, w) = (d, 1) or (q, 2 q); `touching` says which, and `bottom`, 0 or d_r, is
the depth where q = 0.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from phasemap._kernels import columns as col
from phasemap._kernels.law import contact_force, contact_slope, damping, longrange_force, longrange_slope
from phasemap._kernels.neck import loop_energy
from phasemap._kernels.tableau import STEADY, fly, press, turn

if TYPE_CHECKING:
    from phasemap._kernels.law import Law
    from phasemap._kernels.tableau import Numbers, Row

MAX_STEPS = 100_000
"""Steps in one period after which it is given up."""

REACH, HARD = 0.4, 0.75
"""Weights of approach and of contact in the density of steps; chosen for the least work at 1e-6 to 1e-2 degree."""


@njit(**STEADY)
def _flight_rate(law: Law, p: Row, fixed: Numbers, d: float, v: float) -> float:
    """Density of steps out of contact: rates of the lever, of the force's gradient, of the force as the tip moves."""
    rate = 1.0
    if p[4] != 0.0:
        force = longrange_force(law, d, p) * fixed[2]
        slope = longrange_slope(law, d, p) * fixed[2]
        # Where a force changes sign, a hundredth of the distance keeps the rate finite, and u0 does so at contact.
        rate += abs(slope) + (REACH * v * slope) ** 2 / (force**2 + (0.01 * slope * (abs(d) + fixed[3])) ** 2)
    return math.sqrt(rate)


@njit(**STEADY)
def _contact_rate(law: Law, p: Row, fixed: Numbers, q: float) -> float:
    """Square of the density of steps in s, less the pull's: q'' = 2 q z'' gives 4 d F'/k; and damping."""
    d = fixed[7] + q * q
    rate = 4 * q * q * (1 + HARD * HARD * abs(contact_slope(law, d, p)) * fixed[2])
    if p[8] != 0.0 and fixed[7] == 0.0:
        rate += (4 * q * damping(law, d, p)) ** 2
    return rate


@njit(**STEADY)
def _reach(law: Law, p: Row, fixed: Numbers, q: float, v: float, pull: float) -> float:
    """q of the depth that a tip at (q, v) comes to, roughly.

    There stiffness works as fast as speed and pull do: q^2 rate = v^2 + q^2 pull, with what q^2 rate is already.
    """
    goal = q * q * _contact_rate(law, p, fixed, q) + v * v
    deep = 0.1 * math.sqrt(pull)
    for _ in range(5):
        deep *= ((goal / (deep * deep) + pull) / _contact_rate(law, p, fixed, deep)) ** 0.2
    return deep


@njit(**STEADY)
def _cubic(x0: float, v0: float, x1: float, v1: float, h: float) -> tuple[float, float, float]:
    """Coefficients of t, t^2, t^3 of the cubic through both ends of a step, t = 0 ... 1 along it."""
    rise = x1 - x0
    return h * v0, 3 * rise - h * (2 * v0 + v1), h * (v0 + v1) - 2 * rise


@njit(**STEADY)
def _turning(x0: float, v0: float, x1: float, v1: float, h: float) -> float:
    """Where in a step with v0 > 0 > v1 the cubic is highest."""
    a, b, c = _cubic(x0, v0, x1, v1, h)
    return h * a / (math.sqrt(b * b - 3 * a * c) - b)


@njit(**STEADY)
def _root(x0: float, v0: float, x1: float, v1: float, h: float) -> float:
    """Where in a step the cubic last changes sign before its end."""
    a, b, c = _cubic(x0, v0, x1, v1, h)
    low, high, t = 0.0, 1.0, 1.0
    for _ in range(8):
        x = x0 + t * (a + t * (b + t * c))
        if (x > 0) == (x1 > 0):
            high = t
        else:
            low = t
        t -= x / (a + t * (2 * b + t * 3 * c))
        if not low <= t <= high:
            t = 0.5 * (low + high)
    return t * h


@njit(forceinline=True, **STEADY)
def _advance(law: Law, p: Row, fixed: Numbers, touching: bool, start: Numbers, h: float) -> Numbers:
    if touching:
        return press(law, p, fixed, start, h)
    return fly(law, p, fixed, start, h)


@njit(**STEADY)
def _to_edge(
    law: Law, p: Row, fixed: Numbers, touching: bool, start: Numbers, h: float, end: Numbers, edge: float
) -> tuple[float, Numbers]:
    """Shorten a step across an edge to end on it: Newton on x(h) = edge, x' = v, kept between a side and the other."""
    x, v = start[0] - edge, start[1]
    # Of q, whose square is a length where it is 0, and of d.
    tolerance = (abs(x) + abs(v) * h) * (1e-8 if touching and edge == 0.0 else 1e-14)
    low, high = 0.0, h
    h = _root(x, v, end[0] - edge, end[1], h)
    above = end[0] <= edge
    for _ in range(50):
        end = _advance(law, p, fixed, touching, start, h)
        if abs(end[0] - edge) <= tolerance:
            break
        if (end[0] > edge) == above:
            low = h
        else:
            high = h
        h -= (end[0] - edge) / end[1]
        if not low <= h <= high:
            h = 0.5 * (low + high)
    return h, end


@njit(**STEADY)
def _to_instant(
    law: Law, p: Row, fixed: Numbers, start: Numbers, h: float, end: Numbers, time: float
) -> tuple[float, Numbers]:
    """Shorten a step in contact or neck to last `time`: Newton on tau(h) = time, tau' = 2 q."""
    low, high = 0.0, h
    for _ in range(50):
        h -= (end[2] - time) / (2 * end[0])
        if not low <= h <= high:
            h = 0.5 * (low + high)
        end = press(law, p, fixed, start, h)
        if abs(end[2] - time) <= 4e-16:
            break
        if end[2] < time:
            low = h
        else:
            high = h
    return h, end


@njit(**STEADY)
def march_period(
    law: Law, p: np.ndarray, lever: np.ndarray, z0: float, eta: float, y: np.ndarray, acc: np.ndarray
) -> int:
    """March from drive phase 0 to 2 pi.

    Parameters
    ----------
    eta : float
        Size of the steps. The settled phase is off by less than 1e-4, 2e-6, 2e-9 degree at 0.5, 0.3, 0.15 in nine of
        ten orbits with Q <= 1000. The error is of order 8 in eta and proportional to Q.
    y : ndarray, shape (3,)
        z, z' [m], and whether the tip is in contact or in the neck (1 or 0), advanced in place. The last is left out
        and not asked for where the law has no neck: depth says it.
    acc : ndarray, shape (6,) or longer
        Filled with cosine and sine part of the first harmonic and mean of z [m], energy into the surface [J]: by
        damping, and that of the loop at each release,
        virial -<F z> of the whole surface force [J], largest d [m], and energy into the lever's own damping [J].

    Returns
    -------
    int
        Steps taken, or minus a status.
    """
    row: Row = (p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8], p[9], p[10], p[11])
    omega, compliance = lever[col.OMEGA], 1 / lever[col.STIFFNESS]
    edge_force = edge_slope = 0.0
    if p[4] != 0.0:
        edge_force = longrange_force(law, 0.0, row) * compliance
        edge_slope = longrange_slope(law, 0.0, row) * compliance
    alpha0, base = lever[col.ALPHA0], lever[col.BASE]
    aloft = (omega, alpha0, compliance, base, z0, edge_force, edge_slope, 0.0)
    drawn = (omega, alpha0, compliance, base, z0, edge_force, edge_slope, row[10])
    fixed = aloft
    snap = 2 * HARD * HARD * abs(contact_force(law, 0.0, row)) * compliance
    neck = math.sqrt(-row[10])  # q of the surface in the neck

    x, v = y[0] - z0, y[1]
    highest = x
    touching = x > 0 or (x == 0 and v > 0)
    deep = 0.0
    if touching:
        x = math.sqrt(x)
        deep = _reach(law, row, fixed, x, v, snap + 2 * HARD * HARD * math.hypot(y[0], v))
    elif neck > 0 and y[2] != 0.0 and x > row[10]:
        touching, x, deep = True, math.sqrt(x - row[10]), neck
        fixed = drawn
    cosine, sine = 1.0, 0.0
    cos_part = sin_part = mean = dissipated = virial = air = 0.0
    left = 2 * math.pi / omega
    steps = releases = 0
    while left > 0:
        steps += 1
        if steps > MAX_STEPS:
            return -col.NOT_SETTLED
        bottom = fixed[7]
        hanging = bottom != 0.0
        edge = neck if hanging else 0.0  # the x of d = 0
        if touching:
            # v / deep is the rate at which stiffness builds up; from q = 0 the local rate does not see it coming.
            rate = _contact_rate(law, row, fixed, x) + snap + 2 * HARD * HARD * math.hypot(z0 + bottom + x * x, v)
            rate += (HARD * v / deep) ** 2
            if neck > 0 and not hanging:
                rate += (HARD * v) ** 2 / (x * x - row[10])  # the root at release, seen from contact
            h = eta / math.sqrt(rate)
        else:
            h = min(left, eta / _flight_rate(law, row, fixed, x, v))
        start = (x, v, cosine, sine)
        end = _advance(law, row, fixed, touching, start, h)
        if v > 0 and end[1] < 0:
            # The highest point lies inside: a step to where it should be, and half v^2 over the deceleration.
            part = _turning(x, v, end[0], end[1], h)
            top = _advance(law, row, fixed, touching, start, part)
            height = top[0] + 0.5 * h * top[1] ** 2 / (v - end[1])
            highest = max(highest, bottom + height * height if touching else height)
            if (hanging or not touching) and top[0] > edge:  # grazing: both ends may be below
                h, end = part, top
        elif hanging and v < 0 and end[1] > 0:
            part = _turning(-x, -v, -end[0], -end[1], h)
            low = _advance(law, row, fixed, touching, start, part)
            if low[0] <= 0:  # both ends may be in the neck, with a release between
                h, end = part, low
        crosses = end[0] <= edge if touching and not hanging else end[0] > edge
        if hanging and end[0] <= 0:
            crosses, edge = True, 0.0
        if crosses:
            h, end = _to_edge(law, row, fixed, touching, start, h, end, edge)
        if not touching:
            left -= h
        elif end[2] < left:
            left -= end[2]
        else:
            h, end = _to_instant(law, row, fixed, start, h, end, left)
            left = 0.0
            crosses = False
        x, v = end[0], end[1]
        cos_part += end[3]
        sin_part += end[4]
        mean += end[5]
        dissipated += end[6]
        virial += end[7]
        air += end[8]
        c, s = turn(omega * end[2])
        cosine, sine = cosine * c - sine * s, sine * c + cosine * s
        if crosses and hanging and edge == 0.0:
            releases += 1
            touching, fixed, x = False, aloft, bottom
        elif crosses and v <= 0 and touching and neck > 0:
            fixed = drawn
            x = deep = neck
        elif crosses:
            x, fixed = 0.0, aloft
            touching = v > 0
            if touching:
                deep = _reach(law, row, fixed, x, v, snap + 2 * HARD * HARD * math.hypot(z0, v))
    if not math.isfinite(x + v):
        return -col.NOT_SETTLED

    d = fixed[7] + x * x if touching else x
    y[0], y[1] = z0 + d, v
    if neck > 0:
        y[2] = 1.0 if touching else 0.0
    acc[0] = cos_part * omega / math.pi
    acc[1] = sin_part * omega / math.pi
    acc[2] = mean * omega / (2 * math.pi)
    acc[3] = dissipated * lever[col.STIFFNESS]
    if releases > 0:
        acc[3] += releases * loop_energy(law, row)
    acc[4] = virial * lever[col.STIFFNESS] * omega / (2 * math.pi)
    acc[5] = max(highest, d)
    if len(acc) > 6:
        acc[6] = air * 2 * lever[col.ALPHA0] * lever[col.STIFFNESS]
    return steps


# Each kernel above `march_period` compiles it anew, a second a time: hence few of them, and two that are inlined.


@njit(inline="always", **STEADY)
def _linearise(
    law: Law, p: np.ndarray, lever: np.ndarray, eta: float, u: np.ndarray, acc: np.ndarray, linear: np.ndarray
) -> bool:
    """March u = (z, z', touching, z0) and three neighbours for a period; says whether all stay in contact or out of it.

    linear[0:3] is the change of z, that of z' and the amplitude A; linear[4 j : 4 j + 3], j = 1, 2, 3, are their
    derivatives by z, z' and z0.
    """
    size = 3e-8 * (math.hypot(u[0], u[1]) + lever[col.BASE])
    y = np.empty(3)
    for j in range(4):
        z = u[0] + (size if j == 1 else 0.0)
        v = u[1] + (size if j == 2 else 0.0)
        y[0], y[1], y[2] = z, v, u[2]
        if march_period(law, p, lever, u[3] + (size if j == 3 else 0.0), eta, y, acc) < 0 or y[2] != u[2]:
            return False
        linear[4 * j], linear[4 * j + 1], linear[4 * j + 2] = y[0] - z, y[1] - v, math.hypot(acc[0], acc[1])
        if j > 0:
            for i in range(3):
                linear[4 * j + i] = (linear[4 * j + i] - linear[i]) / size
    return True


@njit(**STEADY)
def _relaxed(linear: np.ndarray, r0: float, r1: float) -> tuple[float, float]:
    """How far (z, z') goes to rest if it now changes by r a period: r + P' r + P' P' r + ... = (1 - P')^-1 r."""
    scale = 1 / (linear[4] * linear[9] - linear[8] * linear[5])
    return (linear[8] * r1 - linear[9] * r0) * scale, (linear[5] * r0 - linear[4] * r1) * scale


@njit(**STEADY)
def _slope(linear: np.ndarray) -> float:
    """dA/dz0 after the transient."""
    z, v = _relaxed(linear, linear[12], linear[13])
    return linear[14] + linear[6] * z + linear[10] * v


@njit(**STEADY)
def _floquet(linear: np.ndarray) -> float:
    """Largest modulus of the multipliers: the eigenvalues of P'."""
    half = 1 + 0.5 * (linear[4] + linear[9])
    product = (1 + linear[4]) * (1 + linear[9]) - linear[8] * linear[5]
    apart = 0.25 * (linear[4] - linear[9]) ** 2 + linear[8] * linear[5]
    return abs(half) + math.sqrt(apart) if apart > 0 else math.sqrt(product)


@njit(**STEADY)
def _ahead(linear: np.ndarray, r0: float, r1: float, error: float, hold: bool) -> Numbers:
    """Way of (z, z', z0) to rest; with `hold`, z0 moves by the amplitude's error after the transient, over slope."""
    z, v = _relaxed(linear, r0, r1)
    if not hold:
        return z, v, 0.0
    move = -(error + linear[6] * z + linear[10] * v) / _slope(linear)
    z_move, v_move = _relaxed(linear, linear[12], linear[13])
    return z + z_move * move, v + v_move * move, move


@njit(**STEADY)
def _skip(
    law: Law, p: np.ndarray, lever: np.ndarray, how: Numbers, target: float, u: np.ndarray, acc: np.ndarray,
    linear: np.ndarray,
) -> tuple[bool, int]:  # fmt: skip
    """Skip the transient where it is a linear decay: put u at its end, and acc to the period there.

    The decay is measured, not assumed: neighbours must approach (Floquet multipliers inside the unit circle and, where
    an amplitude `target` is held, a feedback that pulls back), and the way left after a skip must be at most a quarter
    of the skip (Deuflhard's natural monotonicity test). Where that fails, u is left alone and time has to pass.

    `how` is eta and the errors allowed in (z, z') and z0. Returns whether u is at rest, and the periods marched.
    """
    eta, y_limit, z0_limit = how
    hold = target > 0.0
    trial, y = np.empty(4), np.empty(3)
    periods = 0
    for _ in range(20):
        periods += 4
        if not _linearise(law, p, lever, eta, u, acc, linear):
            return False, periods
        if not _floquet(linear) < 1 or (hold and not _slope(linear) > 0):
            return False, periods
        z, v, move = _ahead(linear, linear[0], linear[1], linear[2] - target, hold)
        way = max(math.hypot(z, v) / y_limit, abs(move) / z0_limit)
        near = way * y_limit <= 1e-4 * (math.hypot(u[0], u[1]) + lever[col.BASE])
        moved = False
        while way > 1 or not moved:
            trial[0], trial[1], trial[2], trial[3] = u[0] + z, u[1] + v, u[2], u[3] + move
            y[:] = trial[:3]
            periods += 1
            if march_period(law, p, lever, trial[3], eta, y, acc) < 0 or y[2] != u[2]:
                return False, periods
            error = math.hypot(acc[0], acc[1]) - target
            z, v, move = _ahead(linear, y[0] - trial[0], y[1] - trial[1], error, hold)
            rest = max(math.hypot(z, v) / y_limit, abs(move) / z0_limit)
            if not (rest <= 1 or rest <= 0.25 * way):
                break
            u[:] = trial
            way, moved = rest, True
        if not moved:
            return False, periods
        if way <= 1 and near:  # so near that the derivatives are those at the end
            for _ in range(2):
                u[0], u[1], u[3] = u[0] + z, u[1] + v, u[3] + move
                y[:] = u[:3]
                if march_period(law, p, lever, u[3], eta, y, acc) < 0 or y[2] != u[2]:
                    return False, periods
                error = math.hypot(acc[0], acc[1]) - target
                z, v, move = _ahead(linear, y[0] - u[0], y[1] - u[1], error, hold)
            return True, periods + 2
    return False, periods


@njit(**STEADY)
def _rest(
    law: Law, p: np.ndarray, lever: np.ndarray, how: Numbers, max_periods: int, u: np.ndarray, acc: np.ndarray,
    linear: np.ndarray,
) -> tuple[bool, int]:  # fmt: skip
    """Let time pass at fixed z0 until the orbit repeats itself; returns as `_skip`."""
    periods = 0
    wait = max(3, int(lever[col.OMEGA] / (4 * math.pi * lever[col.ALPHA0])))  # half the lever's decay time
    while periods < max_periods:
        done, used = _skip(law, p, lever, how, 0.0, u, acc, linear)
        periods += used
        if done:
            return True, periods
        if not _floquet(linear) < 1:
            u[:2] *= 1 + 1e-6  # an orbit that its neighbours leave is left at the slightest disturbance: here it is
        for _ in range(wait):
            if march_period(law, p, lever, u[3], how[0], u[:3], acc) < 0:
                return False, periods
        periods += wait
    return False, periods


@njit(inline="always", **STEADY)
def _hold(
    law: Law, p: np.ndarray, lever: np.ndarray, how: Numbers, amplitude: float, max_periods: int, u: np.ndarray,
    row: np.ndarray,
) -> int:  # fmt: skip
    """Bring the orbit from state u to the amplitude, as a slow feedback does, and fill the row."""
    acc, linear = np.empty(7), np.empty(16)
    snap = abs(contact_force(law, 0.0, p)) / lever[col.STIFFNESS]
    farthest = 50 * lever[col.BASE] / lever[col.ALPHA0] + 2 * snap  # 100 free amplitudes, and twice to pull-off
    stride = 0.1 * amplitude
    last = 0.0
    row[:] = np.nan
    periods = 0
    while True:
        done, used = _skip(law, p, lever, how, amplitude, u, acc, linear)
        periods += used
        if done:
            break
        done, used = _rest(law, p, lever, how, max_periods - periods, u, acc, linear)
        periods += used
        if not done:
            return col.NOT_SETTLED
        error = math.hypot(acc[0], acc[1]) - amplitude
        if error * last < 0:
            stride *= 0.5
        last = error
        # A setpoint inside a jump is passed again and again, and one above the free amplitude is never reached.
        if stride < 1e-4 * amplitude or not abs(u[3]) < farthest:
            return col.NO_STABLE_ORBIT
        u[3] -= max(-stride, min(error / max(_slope(linear), 0.2), stride))

    lag = math.atan2(acc[1], acc[0])
    row[col.TIP_OFFSET] = u[3]
    row[col.MEAN] = acc[2]
    row[col.PHASE] = math.pi / 2 - lag
    row[col.AMPLITUDE] = math.hypot(acc[0], acc[1])
    row[col.INDENTATION] = acc[5]
    row[col.DISSIPATION] = acc[3]
    row[col.VIRIAL] = acc[4]
    row[col.FLOQUET] = _floquet(linear)
    row[col.SLOPE] = _slope(linear)
    # The in-phase half of the harmonic balance A (1 - omega^2 + 2 i alpha0 omega) + G_1 = u0 exp(i lag).
    row[col.STIFFENING] = lever[col.BASE] * math.cos(lag) / row[col.AMPLITUDE] - 1 + lever[col.OMEGA] ** 2
    supplied = math.pi * lever[col.STIFFNESS] * lever[col.BASE] * acc[1]
    row[col.CLOSURE] = (supplied - acc[3] - acc[6]) / supplied
    return col.GOOD


@njit(**STEADY)
def settle(
    law: Law, p: np.ndarray, lever: np.ndarray, amplitude: float, start: np.ndarray, eta: float, tolerance: float,
    max_periods: int, row: np.ndarray,
) -> int:  # fmt: skip
    """Hold an amplitude [m] in time, starting from (z0, mean, amplitude, lag), and fill a result row.

    The orbit found is one that time leads to: stable, and held by a feedback that raises the lever when A falls short.
    `tolerance` 1 stops at 1e-5 degree and 1e-14 m. Returns GOOD, NOT_SETTLED after `max_periods`, or NO_STABLE_ORBIT.
    """
    how = (eta, tolerance * math.radians(1e-5) * amplitude, tolerance * 1e-14)
    z = start[1] + start[2] * math.cos(start[3])
    u = np.array([z, lever[col.OMEGA] * start[2] * math.sin(start[3]), 0.0, start[0]])
    return _hold(law, p, lever, how, amplitude, max_periods, u, row)


@njit(**STEADY)
def approach(
    law: Law, p: np.ndarray, lever: np.ndarray, amplitude: float, z0_start: float, step: float, eta: float,
    settle_tol: float, max_periods: int, row: np.ndarray,
) -> int:  # fmt: skip
    """Engage from z0_start [m]: lower a freely swinging lever until its settled amplitude first reaches the setpoint.

    z0 falls by `step` [m] at a time, by less where the branch ends and near the setpoint. Returns as `settle`, or
    UNSTABLE where the setpoint is reached by an orbit that does not repeat each period.
    """
    omega, alpha0, base = lever[col.OMEGA], lever[col.ALPHA0], lever[col.BASE]
    how = (eta, settle_tol * math.radians(1e-5) * amplitude, settle_tol * 1e-14)
    patience = int(omega / alpha0)  # 2 pi decay times of the lever's amplitude
    free = base / complex(1 - omega * omega, 2 * alpha0 * omega)
    u, trial = np.array([free.real, -omega * free.imag, 0.0, z0_start]), np.empty(4)
    acc, linear = np.empty(7), np.empty(16)
    stride = slope = z_slope = v_slope = 0.0
    at_rest, reached, periods = True, False, 0
    while not reached and periods < max_periods and u[3] > -15 * base / alpha0:
        coarse = stride > step / 50
        trial[:] = u
        trial[0], trial[1], trial[3] = u[0] - z_slope * stride, u[1] - v_slope * stride, u[3] - stride
        rests, used = _skip(law, p, lever, how, 0.0, trial, acc, linear)
        periods += used
        turned = rests and _slope(linear) < -1e-3 and slope > 1e-3  # the amplitude has a minimum on the way
        if not rests:
            # The branch ends, and what comes next is for time to say. Where it comes to no rest (orbits double their
            # period, or just touch a surface that snaps), engaging goes on, slowly, as an instrument's would.
            if coarse and at_rest:
                stride *= 0.25
                continue
            trial[:] = u
            trial[3] = u[3] - stride
            rests, used = _rest(law, p, lever, how, patience, trial, acc, linear)
            periods += used
        reached = math.hypot(acc[0], acc[1]) <= amplitude
        if coarse and (reached or turned):
            reached = False
            stride *= 0.25
            continue
        u[:] = trial
        at_rest = rests
        slope = z_slope = v_slope = 0.0
        if at_rest:
            stride = step if stride == 0 else min(step, 2 * stride)
            slope = _slope(linear)
            z_slope, v_slope = _relaxed(linear, linear[12], linear[13])
    row[:] = np.nan
    if not reached:
        return col.NOT_SETTLED if periods >= max_periods else col.NO_STABLE_ORBIT
    if not at_rest:
        return col.UNSTABLE
    return _hold(law, p, lever, how, amplitude, max_periods - periods, u, row)
