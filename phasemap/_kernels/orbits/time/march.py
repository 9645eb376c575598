"""The full equation of motion marched in time: the slow, independent truth.

    z'' + 2 (alpha0 + alpha_s(d)) z' + z + F(d)/k = u0 cos(omega tau),    d = z - z0          (Wang 1999, Eq. 1)

by an explicit Runge-Kutta method of order 8 (`runge_kutta`) on steps laid out by a smooth density; no control repeats
them, so the error is C eta^8 (theory, Eqs. (time-1) and (time-2)). Order 8 needs an analytic right-hand side, and F ~
d^(3/2), alpha_s ~ d^(1/2) are not:

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

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator, contact_force, contact_slope, damping, longrange_force, longrange_slope
from phasemap._kernels.neck import loop_energy
from phasemap._kernels.orbits.time.by_memory import by_memory, remembers
from phasemap._kernels.orbits.time.elements import CONTACT_MODE, INNER_COUNT, OUTER_COUNT, PERIOD_BEGIN
from phasemap._kernels.orbits.time.runge_kutta import (
    End,
    Medium,
    Row,
    Start,
    stage,
    step_in_contact,
    step_off_surface,
    turn,
)
from phasemap._kernels.orbits.time.tip import TOUCHES, PeriodResult, V, Z

if TYPE_CHECKING:
    from phasemap._kernels.law import Law

MOST_MARCH_STEPS = 100_000
"""Steps in one period after which it is given up."""

LAST_NEWTON_STEP = 1e-7
"""Of a step's length: how near Newton's method comes to an edge before the tangent does the rest, and leaves 1e-14."""

APPROACH_WEIGHT = 0.4
CONTACT_WEIGHT = 0.75
"""Weights of approach and of contact in the density of steps; chosen for the least work at 1e-6 to 1e-2 degree."""


@kernel
def flight_rate(law: Law, p: Row, fixed: Medium, d: float, v: float) -> float:
    """Density of steps out of contact: rates of the lever, of the force's gradient, of the force as the tip moves."""
    rate = 1.0
    if p[col.LONGRANGE] != 0.0:
        force = longrange_force(law, d, p) * fixed.compliance
        slope = longrange_slope(law, d, p) * fixed.compliance
        # Where a force changes sign, a hundredth of the distance keeps the rate finite, and u0 does so at contact.
        rate += abs(slope) + (APPROACH_WEIGHT * v * slope) ** 2 / (
            force**2 + (0.01 * slope * (abs(d) + fixed.drive)) ** 2
        )
    return math.sqrt(rate)


@kernel
def contact_rate(law: Law, p: Row, fixed: Medium, q: float) -> float:
    """Square of the density of steps in s, less the pull's: q'' = 2 q z'' gives 4 d F'/k; and damping."""
    d = fixed.bottom + q * q
    rate = 4 * q * q * (1 + CONTACT_WEIGHT * CONTACT_WEIGHT * abs(contact_slope(law, d, p)) * fixed.compliance)
    if p[col.DAMPING] != 0.0 and fixed.bottom == 0.0:
        rate += (4 * q * damping(law, d, p)) ** 2
    return rate


@kernel
def depth_reached(law: Law, p: Row, fixed: Medium, q: float, v: float, pull: float) -> float:
    """q of the depth that a tip at (q, v) comes to, roughly.

    There stiffness works as fast as speed and pull do: q^2 rate = v^2 + q^2 pull, with what q^2 rate is already.
    """
    goal = q * q * contact_rate(law, p, fixed, q) + v * v
    deep = 0.1 * math.sqrt(pull)
    for _ in range(5):
        deep *= ((goal / (deep * deep) + pull) / contact_rate(law, p, fixed, deep)) ** 0.2
    return deep


@kernel
def _cubic(x0: float, v0: float, x1: float, v1: float, h: float) -> tuple[float, float, float]:
    """Coefficients of t, t^2, t^3 of the cubic through both ends of a step, t = 0 ... 1 along it."""
    rise = x1 - x0
    return h * v0, 3 * rise - h * (2 * v0 + v1), h * (v0 + v1) - 2 * rise


@kernel
def time_of_turn(x0: float, v0: float, x1: float, v1: float, h: float) -> float:
    """Where in a step with v0 > 0 > v1 the cubic is highest."""
    a, b, c = _cubic(x0, v0, x1, v1, h)
    return h * a / (math.sqrt(b * b - 3 * a * c) - b)


@kernel
def time_of_crossing(x0: float, v0: float, x1: float, v1: float, h: float) -> float:
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


@kernel(inline=True)
def _advance(law: Law, p: Row, fixed: Medium, touching: bool, start: Start, h: float) -> End:
    if touching:
        return step_in_contact(law, p, fixed, start, h)
    return step_off_surface(law, p, fixed, start, h)


@kernel
def _to_edge(
    law: Law, p: Row, fixed: Medium, touching: bool, start: Start, h: float, end: End, edge: float
) -> tuple[float, End]:
    """Shorten a step across an edge to end on it: Newton on x(h) = edge, x' = v, kept between a side and the other.

    The last of Newton's steps is so small that the tangent of all that a step gives takes the place of another one.
    """
    low, high, whole = 0.0, h, h
    h = time_of_crossing(start.x - edge, start.v, end.x - edge, end.v, h)
    above = end.x <= edge
    for _ in range(50):
        end = _advance(law, p, fixed, touching, start, h)
        more = (edge - end.x) / end.v
        if abs(more) <= LAST_NEWTON_STEP * whole:
            w, a, c, s, m, e, f, o = stage(law, p, fixed, touching, start, end.x, end.v, end.passed)
            return h + more, End(
                edge, end.v + more * a, end.passed + more * w, end.cos + more * c, end.sin + more * s,
                end.mean_z + more * m, end.loss + more * e, end.virial + more * f, end.air + more * o,
            )  # fmt: skip
        if (end.x > edge) == above:
            low = h
        else:
            high = h
        h += more
        if not low <= h <= high:
            h = 0.5 * (low + high)
    return h, end


@kernel
def _to_instant(law: Law, p: Row, fixed: Medium, start: Start, h: float, end: End, time: float) -> tuple[float, End]:
    """Shorten a step in contact or neck to last `time`: Newton on tau(h) = time, tau' = 2 q."""
    low, high = 0.0, h
    for _ in range(50):
        h -= (end.passed - time) / (2 * end.x)
        if not low <= h <= high:
            h = 0.5 * (low + high)
        end = step_in_contact(law, p, fixed, start, h)
        if abs(end.passed - time) <= 4e-16:
            break
        if end.passed < time:
            low = h
        else:
            high = h
    return h, end


@kernel
def march_period(oscillator: Oscillator, z0: float, eta: float, y: np.ndarray, acc: PeriodResult) -> int:
    """March for a period of the drive, as the surface is: see `march_elastic`.

    Where the law may remember, `y` goes on with what `elements` names, the drive phase at which the period begins too.
    """
    law, p, lever = oscillator
    if law.memory != 0:
        if remembers(p):
            return by_memory(law, p, lever, z0, eta, y, acc)
        y[CONTACT_MODE] = y[INNER_COUNT] = y[OUTER_COUNT] = 0.0  # over another material
    return march_elastic(oscillator, z0, eta, y, acc)


@kernel(shared=True)
def march_elastic(oscillator: Oscillator, z0: float, eta: float, y: np.ndarray, acc: PeriodResult) -> int:
    """March for a period of the drive over a surface without memory, from drive phase 0 on or as y says.

    Parameters
    ----------
    eta : float
        Size of the steps. The settled phase is off by less than 1e-4, 2e-6, 2e-9 degree at 0.5, 0.3, 0.15 in nine of
        ten orbits with Q <= 1000. The error is of order 8 in eta and proportional to Q.
    y : ndarray, shape (3,)
        State as `tip` names it, advanced in place. Whether the tip is in contact or neck is left out
        and not asked for where the law has no neck: depth says it.
    acc : PeriodResult
        Filled. The energy into the surface is by damping, and that of the loop at each release;
        the virial is of the whole surface force.

    Returns
    -------
    int
        Steps taken, or minus a status.
    """
    # Not `parameters`: p is a row of numbers or numbers already, and this takes both.
    law, p, lever = oscillator
    row: Row = (p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8], p[9], p[10], p[11])
    omega, compliance = lever[col.OMEGA], 1 / lever[col.STIFFNESS]
    edge_force = edge_slope = 0.0
    if p[col.LONGRANGE] != 0.0:
        edge_force = longrange_force(law, 0.0, row) * compliance
        edge_slope = longrange_slope(law, 0.0, row) * compliance
    alpha0, base = lever[col.ALPHA0], lever[col.DRIVE]
    aloft = Medium(omega, alpha0, compliance, base, z0, edge_force, edge_slope, 0.0)
    drawn = Medium(omega, alpha0, compliance, base, z0, edge_force, edge_slope, row[col.RELEASE])
    fixed = aloft
    snap = 2 * CONTACT_WEIGHT * CONTACT_WEIGHT * abs(contact_force(law, 0.0, row)) * compliance
    neck = math.sqrt(-row[col.RELEASE])  # q of the surface in the neck

    x, v = y[Z] - z0, y[V]
    highest = x
    touching = x > 0 or (x == 0 and v > 0)
    deep = 0.0
    if touching:
        x = math.sqrt(x)
        deep = depth_reached(law, row, fixed, x, v, snap + 2 * CONTACT_WEIGHT * CONTACT_WEIGHT * math.hypot(y[Z], v))
    elif neck > 0 and y[TOUCHES] != 0.0 and x > row[col.RELEASE]:
        touching, x, deep = True, math.sqrt(x - row[col.RELEASE]), neck
        fixed = drawn
    cosine, sine = 1.0, 0.0
    if law.memory != 0:
        cosine, sine = math.cos(y[PERIOD_BEGIN]), math.sin(y[PERIOD_BEGIN])
    cos_part = sin_part = mean = dissipated = virial = air = 0.0
    left = 2 * math.pi / omega
    steps = releases = 0
    while left > 0:
        steps += 1
        if steps > MOST_MARCH_STEPS:
            return -col.NOT_SETTLED
        bottom = fixed.bottom
        in_neck = bottom != 0.0
        edge = neck if in_neck else 0.0  # the x of d = 0
        if touching:
            # v / deep is the rate at which stiffness builds up; from q = 0 the local rate does not see it coming.
            rate = (
                contact_rate(law, row, fixed, x)
                + snap
                + 2 * CONTACT_WEIGHT * CONTACT_WEIGHT * math.hypot(z0 + bottom + x * x, v)
            )
            rate += (CONTACT_WEIGHT * v / deep) ** 2
            if neck > 0 and not in_neck:
                rate += (CONTACT_WEIGHT * v) ** 2 / (x * x - row[col.RELEASE])  # the root at release, seen from contact
            h = eta / math.sqrt(rate)
        else:
            h = min(left, eta / flight_rate(law, row, fixed, x, v))
        start = Start(x, v, cosine, sine)
        end = _advance(law, row, fixed, touching, start, h)
        if v > 0 and end.v < 0:
            # The highest point lies inside: a step to where it should be, and half v^2 over the deceleration.
            part = time_of_turn(x, v, end.x, end.v, h)
            top = _advance(law, row, fixed, touching, start, part)
            height = top.x + 0.5 * h * top.v**2 / (v - end.v)
            if (in_neck or not touching) and top.x > edge:  # grazing: both ends may be below
                h, end = part, top
            else:
                highest = max(highest, bottom + height * height if touching else height)
        elif in_neck and v < 0 and end.v > 0:
            part = time_of_turn(-x, -v, -end.x, -end.v, h)
            low = _advance(law, row, fixed, touching, start, part)
            if low.x <= 0:  # both ends may be in the neck, with a release between
                h, end = part, low
        crosses = end.x <= edge if touching and not in_neck else end.x > edge
        if in_neck and end.x <= 0:
            crosses, edge = True, 0.0
        if crosses:
            h, end = _to_edge(law, row, fixed, touching, start, h, end, edge)
        if not touching:
            left -= h
        elif end.passed < left:
            left -= end.passed
        else:
            h, end = _to_instant(law, row, fixed, start, h, end, left)
            left = 0.0
            crosses = False
        x, v, passed, of_cos, of_sin, of_mean, of_loss, of_virial, of_air = end
        cos_part += of_cos
        sin_part += of_sin
        mean += of_mean
        dissipated += of_loss
        virial += of_virial
        air += of_air
        c, s = turn(omega * passed)
        cosine, sine = cosine * c - sine * s, sine * c + cosine * s
        if crosses and in_neck and edge == 0.0:
            releases += 1
            touching, fixed, x = False, aloft, bottom
        elif crosses and v <= 0 and touching and neck > 0:
            fixed = drawn
            x = deep = neck
        elif crosses:
            x, fixed = 0.0, aloft
            touching = v > 0
            if touching:
                deep = depth_reached(
                    law, row, fixed, x, v, snap + 2 * CONTACT_WEIGHT * CONTACT_WEIGHT * math.hypot(z0, v)
                )
    if not math.isfinite(x + v):
        return -col.NOT_SETTLED

    d = fixed.bottom + x * x if touching else x
    y[Z], y[V] = z0 + d, v
    if neck > 0:
        y[TOUCHES] = 1.0 if touching else 0.0
    acc.cos = cos_part * omega / math.pi
    acc.sin = sin_part * omega / math.pi
    acc.mean_z = mean * omega / (2 * math.pi)
    acc.loss = dissipated * lever[col.STIFFNESS]
    if releases > 0:
        acc.loss += releases * loop_energy(law, row)
    acc.virial = virial * lever[col.STIFFNESS] * omega / (2 * math.pi)
    acc.deepest = max(highest, d)
    acc.air = air * 2 * lever[col.ALPHA0] * lever[col.STIFFNESS]
    return steps
