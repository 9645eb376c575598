"""The equation of motion over a surface that remembers: Ting's contact for all histories, marched in time.

As `march`, with the same method of order 8, but in contact the variable is the edge q = a/sqrt(R) of the contact, which
is sqrt(d) only on a surface that nothing has touched. With dtau = 2 q ds, and y of `elements` at the edge,

    d = q^2 + kappa y,    q' = (v + kappa y/tau_c) / (1 + kappa dy/dxi),    v' = 2 q z'',    D' = 2 q (d - D)/tau,
    Y' = 2 q (q d - q^3/3 - Y)/tau + y q',    F = (3/2) K0 sqrt(R) (q d - q^3/3 - kappa Y)

(theory, Eqs. (memory-4) and (memory-5)). The contact turns where q' changes its sign and ends where q falls through 0,
both at the end of a step; out of it the tip is attracted by a surface that comes back with the time tau_c. Where a
Kelvin-Voigt surface lets go, its edge is at q^2 = d + t0 d'.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, contact_force, longrange_force, longrange_slope
from phasemap._kernels.orbits.time import elements as on
from phasemap._kernels.orbits.time.by_memory import recovery_of
from phasemap._kernels.orbits.time.march import HARD, MAX_STEPS, contact_rate, flight_rate, reach, turning
from phasemap._kernels.orbits.time.runge_kutta import (
    fly,
    row2,
    row3,
    row4,
    row5,
    row6,
    row7,
    row8,
    row9,
    row10,
    row11,
    row12,
    total,
    turn,
)

if TYPE_CHECKING:
    from phasemap._kernels.orbits.time.runge_kutta import Numbers

PLACES, SUMS = 5, 11
X, V, SEEN, INSIDE, TAU = 0, 1, 2, 3, 4  # what a step moves: d or q, z', D, Y, the time; and after these six integrals
FINER = 0.7  # steps of a Kelvin-Voigt contact, over others: its dents have kinks
RELAXES, AT_ONCE = (
    5.0,
    0.06,
)  # weights of relaxation in the density of steps: where little stays stiff, where it is fast
AFTER_TURN = 0.25
BEYOND, KINK, NUDGE = 3e-3, 1e-6, 1e-9  # of q: how far past an old turn an edge has to come to stop there; just past
FORGOTTEN = 3e-8  # of the free amplitude: a dent that is gone


@kernel
def dent_at(c: Numbers, t: float) -> float:
    """Depth [m] of the surface under a tip that does not touch it."""
    return c[13] * math.exp((c[14] - t) * c[10]) if c[13] > 0 else 0.0


@kernel(inline=True)
def at_edge(
    m: np.ndarray, rate: float, recovery: float, mode: float, q: float, seen: float, t: float
) -> tuple[float, float]:
    """Y of the element at the edge and its slope by xi; not where a Kelvin-Voigt surface lets go."""
    xi = q * q
    if mode == on.SHRINKING:
        left, slope = on.inside(m, xi, t, rate)
        return seen - xi - left, -1 - slope
    return on.outside(m, xi, t, recovery)


@kernel
def depth_of(m: np.ndarray, c: Numbers, mode: float, u: np.ndarray, t: float) -> float:
    """Depth d [m] of the tip."""
    if mode == on.FREE:
        return u[X]
    if mode == on.SHRINKING and c[11] > 0:
        return u[X] * u[X] - c[11] * u[V]
    return u[X] * u[X] + c[8] * at_edge(m, c[9], c[10], mode, u[X], u[SEEN], t)[0]


@kernel(inline=True)
def slopes(
    law: Law, p: Any, c: Numbers, m: np.ndarray, mode: float, start: Numbers, x: float, v: float, seen: float,
    inside: float, time: float,
) -> Numbers:  # fmt: skip
    """Slopes of what a step moves, and the integrands z cos, z sin, z, F z', -F z and z'^2, at a stage."""
    omega, alpha0, compliance, base, z0, edge_force, edge_slope, stiff, kappa, rate, recovery, t0, pull = c[:13]
    since, cosine, sine = start
    turned, turning_sine = turn(omega * time)
    turned, turning_sine = cosine * turned - sine * turning_sine, sine * turned + cosine * turning_sine
    t = since + time
    xi, w, speed = x * x, 2 * x, v
    y = seen_rate = inside_rate = 0.0
    if mode == on.FREE:
        w, d = 1.0, x
        gap = d - (c[13] * math.exp((c[14] - t) * recovery) if c[13] > 0 else 0.0)
        force = 0.0
        if p[col.LONGRANGE] != 0.0:
            force = longrange_force(law, gap, p) * compliance if gap <= 0 else edge_force + edge_slope * gap
    elif mode == on.SHRINKING and t0 > 0:
        d = xi - t0 * v
        force = stiff * x * xi * (2 / 3) + pull
    else:
        y, slope = at_edge(m, rate, recovery, mode, x, seen, t)
        d = xi + kappa * y
        speed = (v + kappa * y * recovery) / (1 + kappa * slope)
        whole = x * (d - xi / 3)
        if t0 > 0:
            force = stiff * (whole + t0 * x * v) + pull
        else:
            force = stiff * (whole - kappa * inside) + pull
            seen_rate = w * (d - seen) * rate
            inside_rate = w * (whole - inside) * rate + y * speed
    z = z0 + d
    a = base * turned - z - force - 2 * alpha0 * v
    if mode == on.SHRINKING and t0 > 0:
        speed = v + t0 * a
    return (
        speed, w * a, seen_rate, inside_rate, w, w * z * turned, w * z * turning_sine, w * z, w * force * v,
        -w * force * z, w * v * v,
    )  # fmt: skip


@kernel
def speed_of(law: Law, p: Any, c: Numbers, m: np.ndarray, mode: float, start: Numbers, u: np.ndarray) -> Numbers:
    """q' or d', and the slope of z'."""
    return slopes(law, p, c, m, mode, start, u[X], u[V], u[SEEN], u[INSIDE], u[TAU])[:2]


@kernel
def step(
    law: Law, p: Any, c: Numbers, m: np.ndarray, mode: float, start: Numbers, u: np.ndarray, h: float, end: np.ndarray
) -> None:
    """Fill `end` with what u and the six integrals are after h; u[TAU] is 0."""
    if mode == on.FREE and (p[col.LONGRANGE] == 0.0 or c[13] == 0.0):
        end[X], end[V], end[TAU], end[5], end[6], end[7], end[8], end[9], end[10] = fly(
            law, p, c[:8], (u[X], u[V], start[1], start[2]), h
        )
        return
    x, v, d, y = u[X], u[V], u[SEEN], u[INSIDE]
    x1, v1, d1, y1, t1, c1, s1, m1, e1, f1, o1 = slopes(law, p, c, m, mode, start, x, v, d, y, 0.0)
    x = row2(u[X], h, x1)
    v = row2(u[V], h, v1)
    d = row2(u[SEEN], h, d1)
    y = row2(u[INSIDE], h, y1)
    t = row2(0.0, h, t1)
    x2, v2, d2, y2, t2 = slopes(law, p, c, m, mode, start, x, v, d, y, t)[:5]
    x = row3(u[X], h, x1, x2)
    v = row3(u[V], h, v1, v2)
    d = row3(u[SEEN], h, d1, d2)
    y = row3(u[INSIDE], h, y1, y2)
    t = row3(0.0, h, t1, t2)
    x3, v3, d3, y3, t3 = slopes(law, p, c, m, mode, start, x, v, d, y, t)[:5]
    x = row4(u[X], h, x1, x3)
    v = row4(u[V], h, v1, v3)
    d = row4(u[SEEN], h, d1, d3)
    y = row4(u[INSIDE], h, y1, y3)
    t = row4(0.0, h, t1, t3)
    x4, v4, d4, y4, t4 = slopes(law, p, c, m, mode, start, x, v, d, y, t)[:5]
    x = row5(u[X], h, x1, x3, x4)
    v = row5(u[V], h, v1, v3, v4)
    d = row5(u[SEEN], h, d1, d3, d4)
    y = row5(u[INSIDE], h, y1, y3, y4)
    t = row5(0.0, h, t1, t3, t4)
    x5, v5, d5, y5, t5 = slopes(law, p, c, m, mode, start, x, v, d, y, t)[:5]
    x = row6(u[X], h, x1, x4, x5)
    v = row6(u[V], h, v1, v4, v5)
    d = row6(u[SEEN], h, d1, d4, d5)
    y = row6(u[INSIDE], h, y1, y4, y5)
    t = row6(0.0, h, t1, t4, t5)
    x6, v6, d6, y6, t6, c6, s6, m6, e6, f6, o6 = slopes(law, p, c, m, mode, start, x, v, d, y, t)
    x = row7(u[X], h, x1, x4, x5, x6)
    v = row7(u[V], h, v1, v4, v5, v6)
    d = row7(u[SEEN], h, d1, d4, d5, d6)
    y = row7(u[INSIDE], h, y1, y4, y5, y6)
    t = row7(0.0, h, t1, t4, t5, t6)
    x7, v7, d7, y7, t7, c7, s7, m7, e7, f7, o7 = slopes(law, p, c, m, mode, start, x, v, d, y, t)
    x = row8(u[X], h, x1, x4, x5, x6, x7)
    v = row8(u[V], h, v1, v4, v5, v6, v7)
    d = row8(u[SEEN], h, d1, d4, d5, d6, d7)
    y = row8(u[INSIDE], h, y1, y4, y5, y6, y7)
    t = row8(0.0, h, t1, t4, t5, t6, t7)
    x8, v8, d8, y8, t8, c8, s8, m8, e8, f8, o8 = slopes(law, p, c, m, mode, start, x, v, d, y, t)
    x = row9(u[X], h, x1, x4, x5, x6, x7, x8)
    v = row9(u[V], h, v1, v4, v5, v6, v7, v8)
    d = row9(u[SEEN], h, d1, d4, d5, d6, d7, d8)
    y = row9(u[INSIDE], h, y1, y4, y5, y6, y7, y8)
    t = row9(0.0, h, t1, t4, t5, t6, t7, t8)
    x9, v9, d9, y9, t9, c9, s9, m9, e9, f9, o9 = slopes(law, p, c, m, mode, start, x, v, d, y, t)
    x = row10(u[X], h, x1, x4, x5, x6, x7, x8, x9)
    v = row10(u[V], h, v1, v4, v5, v6, v7, v8, v9)
    d = row10(u[SEEN], h, d1, d4, d5, d6, d7, d8, d9)
    y = row10(u[INSIDE], h, y1, y4, y5, y6, y7, y8, y9)
    t = row10(0.0, h, t1, t4, t5, t6, t7, t8, t9)
    x10, v10, d10, y10, t10, c10, s10, m10, e10, f10, o10 = slopes(law, p, c, m, mode, start, x, v, d, y, t)
    x = row11(u[X], h, x1, x4, x5, x6, x7, x8, x9, x10)
    v = row11(u[V], h, v1, v4, v5, v6, v7, v8, v9, v10)
    d = row11(u[SEEN], h, d1, d4, d5, d6, d7, d8, d9, d10)
    y = row11(u[INSIDE], h, y1, y4, y5, y6, y7, y8, y9, y10)
    t = row11(0.0, h, t1, t4, t5, t6, t7, t8, t9, t10)
    x11, v11, d11, y11, t11, c11, s11, m11, e11, f11, o11 = slopes(law, p, c, m, mode, start, x, v, d, y, t)
    x = row12(u[X], h, x1, x4, x5, x6, x7, x8, x9, x10, x11)
    v = row12(u[V], h, v1, v4, v5, v6, v7, v8, v9, v10, v11)
    d = row12(u[SEEN], h, d1, d4, d5, d6, d7, d8, d9, d10, d11)
    y = row12(u[INSIDE], h, y1, y4, y5, y6, y7, y8, y9, y10, y11)
    t = row12(0.0, h, t1, t4, t5, t6, t7, t8, t9, t10, t11)
    x12, v12, d12, y12, t12, c12, s12, m12, e12, f12, o12 = slopes(law, p, c, m, mode, start, x, v, d, y, t)
    end[X] = total(u[X], h, x1, x6, x7, x8, x9, x10, x11, x12)
    end[V] = total(u[V], h, v1, v6, v7, v8, v9, v10, v11, v12)
    end[SEEN] = total(u[SEEN], h, d1, d6, d7, d8, d9, d10, d11, d12)
    end[INSIDE] = total(u[INSIDE], h, y1, y6, y7, y8, y9, y10, y11, y12)
    end[TAU] = total(0.0, h, t1, t6, t7, t8, t9, t10, t11, t12)
    end[5] = total(0.0, h, c1, c6, c7, c8, c9, c10, c11, c12)
    end[6] = total(0.0, h, s1, s6, s7, s8, s9, s10, s11, s12)
    end[7] = total(0.0, h, m1, m6, m7, m8, m9, m10, m11, m12)
    end[8] = total(0.0, h, e1, e6, e7, e8, e9, e10, e11, e12)
    end[9] = total(0.0, h, f1, f6, f7, f8, f9, f10, f11, f12)
    end[10] = total(0.0, h, o1, o6, o7, o8, o9, o10, o11, o12)


@kernel
def to_turn(
    law: Law, p: Any, c: Numbers, m: np.ndarray, mode: float, start: Numbers, u: np.ndarray, h: float, end: np.ndarray,
) -> float:  # fmt: skip
    """Shorten a step to the turn of the contact, q' = 0, between two sides by the Illinois method; return its size."""
    low, low_speed, high = 0.0, speed_of(law, p, c, m, mode, start, u)[0], h
    high_speed, before = speed_of(law, p, c, m, mode, start, end)[0], 0
    for _ in range(60):
        h = (low * high_speed - high * low_speed) / (high_speed - low_speed)
        step(law, p, c, m, mode, start, u, h, end)
        speed = speed_of(law, p, c, m, mode, start, end)[0]
        if (speed > 0) == (high_speed > 0):
            high, high_speed = h, speed
            low_speed *= 0.5 if before == 1 else 1.0
            before = 1
        else:
            low, low_speed = h, speed
            high_speed *= 0.5 if before == -1 else 1.0
            before = -1
        if speed == 0 or high - low < 1e-9 * high or abs(speed) < 1e-11 * abs(u[V]):
            break
    return h


@kernel
def to_edge(
    law: Law, p: Any, c: Numbers, m: np.ndarray, mode: float, start: Numbers, u: np.ndarray, h: float, end: np.ndarray,
) -> None:  # fmt: skip
    """Shorten a step to the first touch, d at the dent's, the last, q = 0, or a turn of before: Newton in brackets."""
    low, high = 0.0, h
    edge, fades = on.passing(m) if mode == on.GROWING else 0.0, 0.0
    for _ in range(50):
        if mode == on.FREE:
            edge = dent_at(c, start[0] + end[TAU])
            fades = edge * c[10]
        off = end[X] - edge
        if abs(off) <= (1e-14 if mode == on.FREE else 1e-8) * (abs(u[X] - edge) + abs(u[V]) * h):
            break
        if (off > 0) == (mode != on.SHRINKING):
            high = h
        else:
            low = h
        h -= off / (speed_of(law, p, c, m, mode, start, end)[0] + fades)
        if not low <= h <= high:
            h = 0.5 * (low + high)
        step(law, p, c, m, mode, start, u, h, end)


@kernel
def to_instant(
    law: Law, p: Any, c: Numbers, m: np.ndarray, mode: float, start: Numbers, u: np.ndarray, h: float, end: np.ndarray,
    time: float,
) -> None:  # fmt: skip
    """Shorten a step in contact to last `time`."""
    low, high = 0.0, h
    for _ in range(50):
        h -= (end[TAU] - time) / (2 * end[X])
        if not low <= h <= high:
            h = 0.5 * (low + high)
        step(law, p, c, m, mode, start, u, h, end)
        if abs(end[TAU] - time) <= 4e-16:
            break
        if end[TAU] < time:
            low = h
        else:
            high = h


@kernel
def record(m: np.ndarray, c: Numbers, mode: float, u: np.ndarray, t: float, speed: float) -> None:
    """Lay the element at the edge on the stack that it now belongs to; d xi/dt = `speed`, 0 where the contact turns."""
    q = u[X]
    xi = q * q
    rate, recovery = c[9], c[10]
    if mode == on.GROWING:
        if c[11] == 0:
            y, slope = on.outside(m, xi, t, recovery)
            curve = on.outside_curve(m, xi, t, recovery, slope)
            bent = ((1 + slope) * rate - slope * recovery) / speed if speed != 0 else 0.0
            on.lay(m, False, xi, t, (u[SEEN] - xi - y, -1 - slope, -curve - bent), on.OPEN, rate)
        on.take_outer(m, xi)
    elif c[11] > 0:
        on.lay(m, True, xi, t, (-c[11] * u[V], -1.0, -recovery / speed), m[on.PEAK], recovery)
    else:
        left, slope = on.inside(m, xi, t, rate)
        curve = -on.inside_curve(m, xi, t, rate, slope)
        y, slope = u[SEEN] - xi - left, -1 - slope
        if speed != 0:
            curve -= ((1 + slope) * rate - slope * recovery) / speed
        else:  # it has a root there: what it is in the mean, from the node before
            top = on.node(m, True, int(m[on.OUTER]) - 1)
            curve = (slope - m[top + on.SLOPE]) / (xi - m[top + on.XI])
        on.lay(m, True, xi, t, (y, slope, curve), m[on.PEAK], recovery)
        on.take_inner(m, xi)


@kernel
def find_edge(m: np.ndarray, c: Numbers, mode: float, d: float, u: np.ndarray) -> float:
    """Edge q of a contact whose tip is at depth d at time 0: Newton from the one that it had, 0 if there is none."""
    if mode == on.SHRINKING and c[11] > 0:
        return math.sqrt(max(d + c[11] * u[V], 0.0))
    q = u[X] if u[X] > 0 else math.sqrt(max(d, 0.0))
    for _ in range(50):
        y, slope = at_edge(m, c[9], c[10], mode, q, u[SEEN], 0.0)
        off = q * q + c[8] * y - d
        if abs(off) <= 1e-15 * (abs(d) + q * q) or not q > 0:
            break
        q = max(q - off / (2 * q * (1 + c[8] * slope)), 0.1 * q)
    return q


@kernel
def remember_period(law: Law, p: Any, lever: np.ndarray, z0: float, eta: float, y: np.ndarray, acc: np.ndarray) -> int:
    """As `march.march_period`, over a surface that remembers; y has what `elements` names from entry 4 on."""
    omega, compliance, alpha0, base = lever[col.OMEGA], 1 / lever[col.STIFFNESS], lever[col.ALPHA0], lever[col.BASE]
    edge_force = edge_slope = 0.0
    if p[col.LONGRANGE] != 0.0:
        edge_force = longrange_force(law, 0.0, p) * compliance
        edge_slope = longrange_slope(law, 0.0, p) * compliance
    pull = contact_force(law, 0.0, p) * compliance
    time, kappa = p[col.RELAXATION], p[col.RELAXING]
    kelvin = not time > 0
    recovery = recovery_of(p, lever)
    t0 = 1 / recovery if kelvin else 0.0
    kappa = 1.0 if kelvin else kappa
    rate = 0.0 if kelvin else 1 / time
    stiff = 1.5 * p[0] * compliance
    relaxes = 0.0 if kelvin else rate * (AT_ONCE * rate + RELAXES / (1 - kappa))
    finer, beyond = (FINER, KINK) if kelvin else (1.0, BEYOND)
    plain = (omega, alpha0, compliance, base, z0, edge_force, edge_slope, 0.0)
    snap, free = 2 * HARD * HARD * abs(pull), base / (2 * alpha0)

    m, u, end, trial = y, np.zeros(PLACES), np.zeros(SUMS), np.zeros(SUMS)
    mode, d, v = m[on.MODE], y[0] - z0, y[1]
    dent = 0.0
    if mode == on.FREE and m[on.OUTER] > 0:
        dent = kappa * on.outside(m, 0.0, 0.0, recovery)[0]
        if dent < FORGOTTEN * free:
            m[on.OUTER], dent = 0.0, 0.0
    c = (
        omega, alpha0, compliance, base, z0, edge_force, edge_slope, stiff, kappa, rate, recovery, t0, pull, dent,
        0.0,
    )  # fmt: skip
    u[V], u[X] = v, d
    if mode != on.FREE:
        u[X], u[SEEN], u[INSIDE] = m[on.EDGE], m[on.SEEN], m[on.INSIDE]
        q = find_edge(m, c, mode, d, u)
        u[INSIDE] += at_edge(m, c[9], c[10], mode, q, u[SEEN], 0.0)[0] * (q - u[X]) if t0 == 0 else 0.0
        u[X] = q
    elif d > dent:  # pushed in at once, and so all elements touched at the same time
        mode, u[X], u[SEEN] = on.GROWING, 0.0, d
        u[X] = find_edge(m, c, mode, d, u)
        m[on.INNER] = 0.0
        if t0 == 0:
            on.lay(m, False, 0.0, 0.0, (d - on.outside(m, 0.0, 0.0, recovery)[0], -1.0, 0.0), on.OPEN, rate)
        u[TAU] = 0.0
        record(m, c, mode, u, 0.0, speed_of(law, p, c, m, mode, (0.0, 1.0, 0.0), u)[0])
    deep = reach(law, p, plain, max(u[X], 0.0), v, snap + 2 * HARD * HARD * math.hypot(y[0], v)) if mode > 0 else 0.0
    highest, grade, gone = d, 1.0, 0.0
    cosine, sine, left = 1.0, 0.0, 2 * math.pi / omega
    sums = np.zeros(SUMS)
    steps, what, speed = (
        0,
        1,
        0.0,
    )  # what happened at the end of a step, 1: first touch, 2: last touch, 3: turn, 4: past one of before
    while left > 0:
        steps += 1
        if steps > MAX_STEPS:
            return -col.NOT_SETTLED
        x, v = u[X], u[V]
        touching = mode != on.FREE
        start = (gone, cosine, sine)
        u[TAU] = 0.0
        if touching:
            if what != 0:
                speed = speed_of(law, p, c, m, mode, start, u)[0]
            density = contact_rate(law, p, plain, x) + snap + 2 * HARD * HARD * math.hypot(z0 + x * x, v)
            density += (HARD * max(abs(v), abs(speed)) / deep) ** 2 + x * x * relaxes
            h = grade * finer * eta / math.sqrt(density)
            grade = min(2 * grade, 1.0)
        else:
            h = min(left, eta / flight_rate(law, p, plain, x - dent_at(c, gone), v))
        step(law, p, c, m, mode, start, u, h, end)
        if not touching and v > 0 and end[V] < 0:
            # The highest point lies inside; the tip may touch there and be off again at the end.
            part = turning(x, v, end[X], end[V], h)
            step(law, p, c, m, mode, start, u, part, trial)
            highest = max(highest, trial[X] + 0.5 * h * trial[V] ** 2 / (v - end[V]))
            if trial[X] > dent_at(c, gone + trial[TAU]):
                h = part
                for i in range(SUMS):
                    end[i] = trial[i]
        what, whole = 0, True
        if not touching:
            if end[X] > dent_at(c, gone + end[TAU]):
                what = 1
                to_edge(law, p, c, m, mode, start, u, h, end)
        else:
            if mode == on.SHRINKING and end[X] <= 0:
                what = 2
                to_edge(law, p, c, m, mode, start, u, h, end)
            speed = speed_of(law, p, c, m, mode, start, end)[0]
            if what == 0 and (speed < 0) == (mode == on.GROWING):
                what = 3
                h = to_turn(law, p, c, m, mode, start, u, h, end)
            if mode == on.GROWING and u[X] < on.passing(m) < (1 - beyond) * end[X]:
                what = 4
                to_edge(law, p, c, m, mode, start, u, h, end)
                end[X] = (1 + NUDGE) * on.passing(m)
            if end[TAU] >= left:
                to_instant(law, p, c, m, mode, start, u, h, end, left)
                what, end[TAU], whole = 0, left, False
        left -= end[TAU]
        gone += end[TAU]
        for i in range(PLACES):
            u[i] = end[i]
        for i in range(PLACES, SUMS):
            sums[i] += end[i]
        b, s = turn(omega * end[TAU])
        cosine, sine = cosine * b - sine * s, sine * b + cosine * s
        start, u[TAU] = (gone, cosine, sine), 0.0
        if what == 1:
            mode, u[SEEN], u[INSIDE] = on.GROWING, u[X], 0.0
            u[X] = m[on.INNER] = 0.0
            deep = reach(law, p, plain, 0.0, u[V], snap + 2 * HARD * HARD * math.hypot(z0, u[V]))
        elif what == 2:
            u[X] = 0.0
        if mode != on.FREE:
            if what == 3:
                speed = 0.0
            elif what != 0 or not whole:
                speed = speed_of(law, p, c, m, mode, start, u)[0]
            record(m, c, mode, u, gone, speed)
        if what == 2:
            d = depth_of(m, c, mode, u, gone)
            mode, u[X], m[on.INNER] = on.FREE, d, 0.0
            c = (
                omega, alpha0, compliance, base, z0, edge_force, edge_slope, stiff, kappa, rate, recovery, t0, pull,
                d, gone,
            )  # fmt: skip
        elif what == 3 and mode == on.GROWING:
            bend = speed_of(law, p, c, m, mode, start, u)[1]
            highest = max(highest, depth_of(m, c, mode, u, gone) - u[V] ** 2 * u[X] / bend)
            on.turn_back(m, u[X] * u[X], gone, recovery, rate)
            mode, grade = on.SHRINKING, AFTER_TURN
        elif what == 3:
            if kelvin:
                return -col.NOT_SETTLED
            on.turn_forth(m, u[X] * u[X], gone, rate)
            mode, grade = on.GROWING, AFTER_TURN
    d = depth_of(m, c, mode, u, gone)
    m[on.MODE], m[on.EDGE], m[on.SEEN], m[on.INSIDE] = mode, u[X], u[SEEN], u[INSIDE]
    on.shift(m, gone)
    y[0], y[1], y[2] = z0 + d, u[V], 1.0 if mode != on.FREE else 0.0
    acc[0], acc[1] = sums[5] * omega / math.pi, sums[6] * omega / math.pi
    acc[2] = sums[7] * omega / (2 * math.pi)
    acc[3] = sums[8] * lever[col.STIFFNESS]
    acc[4] = sums[9] * lever[col.STIFFNESS] * omega / (2 * math.pi)
    acc[5] = max(highest, d)
    if len(acc) > 6:
        acc[6] = sums[10] * 2 * alpha0 * lever[col.STIFFNESS]
    return steps
