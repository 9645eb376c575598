"""How the edge of a contact with memory moves, and one step of it.

As in `runge_kutta`, with the same method of order 8, but the variable in contact is the edge q = a/sqrt(R), which is
sqrt(d) only on a surface that nothing has touched. With dtau = 2 q ds, and y of `elements` at the edge,

    d = q^2 + kappa y,    q' = (v + kappa y/tau_c) / (1 + kappa dy/dxi),    v' = 2 q z'',    D' = 2 q (d - D)/tau,
    Y' = 2 q (q d - q^3/3 - Y)/tau + y q',    F = (3/2) K0 sqrt(R) (q d - q^3/3 - kappa Y)

(theory, Eqs. (memory-4) and (memory-5)). Where a Kelvin-Voigt surface lets go, its edge is at q^2 = d + t0 d'.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, longrange_force
from phasemap._kernels.lever import reach_of
from phasemap._kernels.orbits.time import elements as on
from phasemap._kernels.orbits.time.runge_kutta import (
    COMPLIANCE,
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
from phasemap._kernels.quadrature import gauss

if TYPE_CHECKING:
    from phasemap._kernels.orbits.time.runge_kutta import Numbers

_X, _W = gauss(10)
_FAR_X, _FAR_W = _X / (1 - _X), _W / (1 - _X) ** 2  # of lengths, to infinity: exact for what falls with their square

# A point of the motion: what a step moves, d or q, z', D, Y and the time; six integrals; and the slopes of all these.
X, V, SEEN, INSIDE, TAU, SLOPES = 0, 1, 2, 3, 4, 11
OF_COS, OF_SIN, OF_MEAN, OF_LOSS, OF_VIRIAL, OF_AIR = 5, 6, 7, 8, 9, 10
PLACES, SUMS, POINT = 5, 11, 22
THIRD = 1 / 3
# Of what is fixed over a period, after what `runge_kutta` has: (3/2) K0 sqrt(R)/k, kappa, 1/tau, the rate at which
# dents recover, t0 of a Kelvin-Voigt surface, the pull in contact, and the dent [m] and when it was left.
STIFF, KAPPA, RATE, RECOVERY, T0, PULL, DENT, SINCE = 7, 8, 9, 10, 11, 12, 13, 14


@kernel(inline=True)
def over_dent(fixed: Numbers, dent: float, since: float) -> Numbers:
    """What is fixed while the tip is off the surface, whose dent [m] it left at the time `since`."""
    return (*fixed, dent, since)


@kernel
def dent_at(c: Numbers, t: float) -> float:
    """Depth [m] of the surface under a tip that does not touch it."""
    return c[DENT] * math.exp((c[SINCE] - t) * c[RECOVERY]) if c[DENT] > 0 else 0.0


@kernel
def work_from_far(law: Law, p: Any, d: float) -> float:
    """Work [J] of the long-range force on a tip that comes to depth d <= 0 over a surface that does not move.

    Steps out of contact leave it out: they add up what the force works on a surface that recovers.
    """
    if p[col.LONGRANGE] == 0.0:
        return 0.0
    size, total_ = reach_of(law, p) - d, 0.0
    for i in range(len(_FAR_X)):
        total_ += _FAR_W[i] * longrange_force(law, d - size * _FAR_X[i], p)
    return size * total_


@kernel
def potential(law: Law, p: Any, c: Numbers, mode: float, q: float, d: float, t: float) -> float:
    """Energy [J] over stiffness that the tip has to give back: of the attraction, and of springs in viscous contacts.

    0 in contact with a solid that relaxes, whose steps add up all the work.
    """
    if mode == on.FREE:
        return work_from_far(law, p, d - dent_at(c, t)) * c[COMPLIANCE]
    if c[T0] > 0:
        return c[STIFF] * q * (0.5 * d * d - q * q * (d * THIRD - 0.1 * q * q)) + c[PULL] * d
    return 0.0


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
    if mode == on.SHRINKING and c[T0] > 0:
        return u[X] * u[X] - c[T0] * u[V]
    return u[X] * u[X] + c[KAPPA] * at_edge(m, c[RATE], c[RECOVERY], mode, u[X], u[SEEN], t)[0]


@kernel(inline=True)
def slopes(
    law: Law, p: Any, c: Numbers, m: np.ndarray, mode: float, start: Numbers, x: float, v: float, seen: float,
    inside: float, time: float,
) -> Numbers:  # fmt: skip
    """Slopes of what a step moves, and the integrands z cos, z sin, z, energy into the surface, -F z and z'^2.

    Where that energy is not F z' but what dashpots and a recovering dent take, the rest of the work is `potential`.
    Energy then does not close by itself where steps are too long for the surface.
    """
    omega, alpha0, compliance, base, z0, edge_force, edge_slope, stiff, kappa, rate, recovery, t0, pull = c[:DENT]
    since, cosine, sine = start
    turned, turning_sine = turn(omega * time)
    turned, turning_sine = cosine * turned - sine * turning_sine, sine * turned + cosine * turning_sine
    t = since + time
    xi, w, speed = x * x, 2 * x, v
    y = seen_rate = inside_rate = taken = 0.0
    if mode == on.FREE:
        w, d = 1.0, x
        dent = dent_at(c, t)
        gap = d - dent
        force = 0.0
        if p[col.LONGRANGE] != 0.0:
            force = longrange_force(law, gap, p) * compliance if gap <= 0 else edge_force + edge_slope * gap
        taken = -force * recovery * dent
    elif mode == on.SHRINKING and t0 > 0:
        d = xi - t0 * v
        force = stiff * x * xi * (2 / 3) + pull
    else:
        y, slope = at_edge(m, rate, recovery, mode, x, seen, t)
        d = xi + kappa * y
        speed = (v + kappa * y * recovery) / (1 + kappa * slope)
        whole = x * (d - xi * THIRD)
        if t0 > 0:
            force = stiff * (whole + t0 * x * v) + pull
        else:
            force = stiff * (whole - kappa * inside) + pull
            taken = w * force * v
            seen_rate = w * (d - seen) * rate
            inside_rate = w * (whole - inside) * rate + y * speed
    z = z0 + d
    a = base * turned - z - force - 2 * alpha0 * v
    if mode == on.SHRINKING and t0 > 0:
        speed, y = v + t0 * a, -t0 * v
    if mode != on.FREE and t0 > 0:
        taken = stiff * (t0 * w * x * v * v - 0.5 * y * y * speed)
    return (
        speed, w * a, seen_rate, inside_rate, w, w * z * turned, w * z * turning_sine, w * z, taken,
        -w * force * z, w * v * v,
    )  # fmt: skip


@kernel
def speed_of(law: Law, p: Any, c: Numbers, m: np.ndarray, mode: float, start: Numbers, u: np.ndarray) -> float:
    """q' or d', with all other slopes put beside what they are of."""
    found = slopes(law, p, c, m, mode, start, u[X], u[V], u[SEEN], u[INSIDE], u[TAU])
    for i in range(SUMS):
        u[SLOPES + i] = found[i]
    return found[0]


@kernel
def step(
    law: Law, p: Any, c: Numbers, m: np.ndarray, mode: float, start: Numbers, u: np.ndarray, h: float, end: np.ndarray
) -> None:
    """Fill `end` with what u and the six integrals are after h; u[TAU] is 0, and in contact u has its slopes."""
    if mode == on.FREE and (p[col.LONGRANGE] == 0.0 or c[DENT] == 0.0):
        end[X], end[V], end[TAU], end[OF_COS], end[OF_SIN], end[OF_MEAN], end[OF_LOSS], end[OF_VIRIAL], end[OF_AIR] = (
            fly(law, p, c[:KAPPA], (u[X], u[V], start[1], start[2]), h)
        )
        return
    if mode == on.FREE:
        speed_of(law, p, c, m, mode, start, u)
    x1, v1, d1, y1, t1, c1 = u[11], u[12], u[13], u[14], u[15], u[16]
    s1, m1, e1, f1, o1 = u[17], u[18], u[19], u[20], u[21]
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
    end[OF_COS] = total(0.0, h, c1, c6, c7, c8, c9, c10, c11, c12)
    end[OF_SIN] = total(0.0, h, s1, s6, s7, s8, s9, s10, s11, s12)
    end[OF_MEAN] = total(0.0, h, m1, m6, m7, m8, m9, m10, m11, m12)
    end[OF_LOSS] = total(0.0, h, e1, e6, e7, e8, e9, e10, e11, e12)
    end[OF_VIRIAL] = total(0.0, h, f1, f6, f7, f8, f9, f10, f11, f12)
    end[OF_AIR] = total(0.0, h, o1, o6, o7, o8, o9, o10, o11, o12)
