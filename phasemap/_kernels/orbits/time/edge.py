"""How the edge of a contact with memory moves, and one step of it.

As in `runge_kutta`, with the same method of order 8, but the variable in contact is the edge q = a/sqrt(R), which is
sqrt(d) only on a surface that nothing has touched. With dtau = 2 q ds, and y of `elements` at the edge,

    d = q^2 + kappa y,    q' = (v + kappa y/tau_c) / (1 + kappa dy/dxi),    v' = 2 q z'',    D' = 2 q (d - D)/tau,
    Y' = 2 q (q d - q^3/3 - Y)/tau + y q',    F = (3/2) K0 sqrt(R) (q d - q^3/3 - kappa Y)

(theory, Eqs. (memory-4) and (memory-5)). Where a Kelvin-Voigt surface lets go, its edge is at q^2 = d + t0 d'.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, longrange_force
from phasemap._kernels.lever import reach_of
from phasemap._kernels.orbits.time import elements as on
from phasemap._kernels.orbits.time.runge_kutta import (
    Medium,
    Start,
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
    step_off_surface,
    total,
    turn,
)
from phasemap._kernels.quadrature import gauss
from phasemap._kernels.records import record

_X, _W = gauss(10)
FAR_LENGTHS = _X / (1 - _X)  # to infinity, with weights: exact for what falls with their square
FAR_WEIGHTS = _W / (1 - _X) ** 2
THIRD = 1 / 3


@record
class Slopes:
    """What a step moves, and integrals over it: their derivatives by s, or what they are."""

    x: float  # d [m] or q [m^(1/2)]
    v: float  # z' [m]
    seen: float  # D: depth of the tip as the dashpots see it [m]
    inside: float  # Y: integral of y over the contact [m^(3/2)]
    passed: float  # time tau
    cos: float  # integral of z cos(omega tau) [m]
    sin: float  # of z sin(omega tau) [m]
    mean_z: float  # of z [m]
    loss: float  # of the energy into the surface, over stiffness [m2]
    virial: float  # of -F z/k [m2]
    air: float  # of z'^2 [m2]


@record
class Point(Slopes):
    """A point of the motion, with integrals over the step that ends there and the slopes of all that."""

    slope: Slopes


class Surface(NamedTuple):
    """A surface that remembers, as it is for a tip that does the same for some steps."""

    law: Law
    p: Any
    medium: Medium
    m: np.ndarray  # what it remembers: `elements`
    mode: float  # what the contact does
    stiff: float  # (3/2) K0 sqrt(R)/k [m^(-1/2)]
    kappa: float
    rate: float  # 1/tau
    recovery: float  # rate at which dents recover
    t0: float  # of a Kelvin-Voigt surface, 0 of others
    pull: float  # in contact, over stiffness [m]
    dent: float  # under a tip that is off the surface [m]
    since: float  # time at which the tip left it


class Instant(NamedTuple):
    """When a step starts: time, and cosine and sine of the drive's phase."""

    time: float
    cos: float
    sin: float


@kernel(inline=True)
def dent_at(here: Surface, t: float) -> float:
    """Depth [m] of the surface under a tip that does not touch it."""
    return here.dent * math.exp((here.since - t) * here.recovery) if here.dent > 0 else 0.0


@kernel
def work_from_far(law: Law, p: Any, d: float) -> float:
    """Work [J] of the long-range force on a tip that comes to depth d <= 0 over a surface that does not move.

    Steps out of contact leave it out: they add up what the force works on a surface that recovers.
    """
    if p[col.LONGRANGE] == 0.0:
        return 0.0
    size, total_ = reach_of(law, p) - d, 0.0
    for i in range(len(FAR_LENGTHS)):
        total_ += FAR_WEIGHTS[i] * longrange_force(law, d - size * FAR_LENGTHS[i], p)
    return size * total_


@kernel
def potential(here: Surface, q: float, d: float, t: float) -> float:
    """Energy [J] over stiffness that the tip has to give back: of the attraction, and of springs in viscous contacts.

    0 in contact with a solid that relaxes, whose steps add up all the work.
    """
    if here.mode == on.OFF_SURFACE:
        return work_from_far(here.law, here.p, d - dent_at(here, t)) * here.medium.compliance
    if here.t0 > 0:
        return here.stiff * q * (0.5 * d * d - q * q * (d * THIRD - 0.1 * q * q)) + here.pull * d
    return 0.0


@kernel(inline=True)
def at_edge(here: Surface, q: float, seen: float, t: float) -> tuple[float, float]:
    """Y of the element at the edge and its slope by xi; not where a Kelvin-Voigt surface lets go."""
    xi = q * q
    if here.mode == on.SHRINKING:
        left, slope = on.inside(here.m, xi, t, here.rate)
        return seen - xi - left, -1 - slope
    return on.outside(here.m, xi, t, here.recovery)


@kernel
def tip_depth(here: Surface, u: Point, t: float) -> float:
    """Depth d [m] of the tip."""
    if here.mode == on.OFF_SURFACE:
        return u.x
    if here.mode == on.SHRINKING and here.t0 > 0:
        return u.x * u.x - here.t0 * u.v
    return u.x * u.x + here.kappa * at_edge(here, u.x, u.seen, t)[0]


@kernel(inline=True)
def slopes(
    here: Surface, start: Instant, x: float, v: float, seen: float, inside: float, time: float
) -> tuple[float, ...]:
    """Slopes of what a step moves, and the integrands z cos, z sin, z, energy into the surface, -F z and z'^2.

    Where that energy is not F z' but what dashpots and a recovering dent take, the rest of the work is `potential`.
    Energy then does not close by itself where steps are too long for the surface.
    """
    law, p, medium, _, mode, stiff, kappa, rate, recovery, t0, pull, _, _ = here
    omega, alpha0, compliance, base, z0, edge_force, edge_slope = medium[:7]
    since, cosine, sine = start
    turned, turning_sine = turn(omega * time)
    turned, turning_sine = cosine * turned - sine * turning_sine, sine * turned + cosine * turning_sine
    t = since + time
    xi, w, speed = x * x, 2 * x, v
    y = seen_rate = inside_rate = taken = 0.0
    if mode == on.OFF_SURFACE:
        w, d = 1.0, x
        dent = dent_at(here, t)
        gap = d - dent
        force = 0.0
        if p[col.LONGRANGE] != 0.0:
            force = longrange_force(law, gap, p) * compliance if gap <= 0 else edge_force + edge_slope * gap
        taken = -force * recovery * dent
    elif mode == on.SHRINKING and t0 > 0:
        d = xi - t0 * v
        force = stiff * x * xi * (2 / 3) + pull
    else:
        y, slope = at_edge(here, x, seen, t)
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
    if mode != on.OFF_SURFACE and t0 > 0:
        taken = stiff * (t0 * w * x * v * v - 0.5 * y * y * speed)
    return (
        speed, w * a, seen_rate, inside_rate, w, w * z * turned, w * z * turning_sine, w * z, taken,
        -w * force * z, w * v * v,
    )  # fmt: skip


@kernel
def speed_of(here: Surface, start: Instant, u: Point) -> float:
    """q' or d', with all other slopes put beside what they are of."""
    to = u.slope
    to.x, to.v, to.seen, to.inside, to.passed, to.cos, to.sin, to.mean_z, to.loss, to.virial, to.air = slopes(
        here, start, u.x, u.v, u.seen, u.inside, u.passed
    )
    return to.x


@kernel
def step_over_memory(here: Surface, start: Instant, u: Point, h: float, end: Point) -> None:
    """Fill `end` with what u and the six integrals are after h; u.passed is 0, and in contact u has its slopes."""
    if here.mode == on.OFF_SURFACE and (here.p[col.LONGRANGE] == 0.0 or here.dent == 0.0):
        end.x, end.v, end.passed, end.cos, end.sin, end.mean_z, end.loss, end.virial, end.air = step_off_surface(
            here.law, here.p, here.medium, Start(u.x, u.v, start.cos, start.sin), h
        )
        return
    if here.mode == on.OFF_SURFACE:
        speed_of(here, start, u)
    x0, v0, d0, y0, of = u.x, u.v, u.seen, u.inside, u.slope
    x1, v1, d1, y1, t1, c1 = of.x, of.v, of.seen, of.inside, of.passed, of.cos
    s1, m1, e1, f1, o1 = of.sin, of.mean_z, of.loss, of.virial, of.air
    x = row2(x0, h, x1)
    v = row2(v0, h, v1)
    d = row2(d0, h, d1)
    y = row2(y0, h, y1)
    t = row2(0.0, h, t1)
    x2, v2, d2, y2, t2 = slopes(here, start, x, v, d, y, t)[:5]
    x = row3(x0, h, x1, x2)
    v = row3(v0, h, v1, v2)
    d = row3(d0, h, d1, d2)
    y = row3(y0, h, y1, y2)
    t = row3(0.0, h, t1, t2)
    x3, v3, d3, y3, t3 = slopes(here, start, x, v, d, y, t)[:5]
    x = row4(x0, h, x1, x3)
    v = row4(v0, h, v1, v3)
    d = row4(d0, h, d1, d3)
    y = row4(y0, h, y1, y3)
    t = row4(0.0, h, t1, t3)
    x4, v4, d4, y4, t4 = slopes(here, start, x, v, d, y, t)[:5]
    x = row5(x0, h, x1, x3, x4)
    v = row5(v0, h, v1, v3, v4)
    d = row5(d0, h, d1, d3, d4)
    y = row5(y0, h, y1, y3, y4)
    t = row5(0.0, h, t1, t3, t4)
    x5, v5, d5, y5, t5 = slopes(here, start, x, v, d, y, t)[:5]
    x = row6(x0, h, x1, x4, x5)
    v = row6(v0, h, v1, v4, v5)
    d = row6(d0, h, d1, d4, d5)
    y = row6(y0, h, y1, y4, y5)
    t = row6(0.0, h, t1, t4, t5)
    x6, v6, d6, y6, t6, c6, s6, m6, e6, f6, o6 = slopes(here, start, x, v, d, y, t)
    x = row7(x0, h, x1, x4, x5, x6)
    v = row7(v0, h, v1, v4, v5, v6)
    d = row7(d0, h, d1, d4, d5, d6)
    y = row7(y0, h, y1, y4, y5, y6)
    t = row7(0.0, h, t1, t4, t5, t6)
    x7, v7, d7, y7, t7, c7, s7, m7, e7, f7, o7 = slopes(here, start, x, v, d, y, t)
    x = row8(x0, h, x1, x4, x5, x6, x7)
    v = row8(v0, h, v1, v4, v5, v6, v7)
    d = row8(d0, h, d1, d4, d5, d6, d7)
    y = row8(y0, h, y1, y4, y5, y6, y7)
    t = row8(0.0, h, t1, t4, t5, t6, t7)
    x8, v8, d8, y8, t8, c8, s8, m8, e8, f8, o8 = slopes(here, start, x, v, d, y, t)
    x = row9(x0, h, x1, x4, x5, x6, x7, x8)
    v = row9(v0, h, v1, v4, v5, v6, v7, v8)
    d = row9(d0, h, d1, d4, d5, d6, d7, d8)
    y = row9(y0, h, y1, y4, y5, y6, y7, y8)
    t = row9(0.0, h, t1, t4, t5, t6, t7, t8)
    x9, v9, d9, y9, t9, c9, s9, m9, e9, f9, o9 = slopes(here, start, x, v, d, y, t)
    x = row10(x0, h, x1, x4, x5, x6, x7, x8, x9)
    v = row10(v0, h, v1, v4, v5, v6, v7, v8, v9)
    d = row10(d0, h, d1, d4, d5, d6, d7, d8, d9)
    y = row10(y0, h, y1, y4, y5, y6, y7, y8, y9)
    t = row10(0.0, h, t1, t4, t5, t6, t7, t8, t9)
    x10, v10, d10, y10, t10, c10, s10, m10, e10, f10, o10 = slopes(here, start, x, v, d, y, t)
    x = row11(x0, h, x1, x4, x5, x6, x7, x8, x9, x10)
    v = row11(v0, h, v1, v4, v5, v6, v7, v8, v9, v10)
    d = row11(d0, h, d1, d4, d5, d6, d7, d8, d9, d10)
    y = row11(y0, h, y1, y4, y5, y6, y7, y8, y9, y10)
    t = row11(0.0, h, t1, t4, t5, t6, t7, t8, t9, t10)
    x11, v11, d11, y11, t11, c11, s11, m11, e11, f11, o11 = slopes(here, start, x, v, d, y, t)
    x = row12(x0, h, x1, x4, x5, x6, x7, x8, x9, x10, x11)
    v = row12(v0, h, v1, v4, v5, v6, v7, v8, v9, v10, v11)
    d = row12(d0, h, d1, d4, d5, d6, d7, d8, d9, d10, d11)
    y = row12(y0, h, y1, y4, y5, y6, y7, y8, y9, y10, y11)
    t = row12(0.0, h, t1, t4, t5, t6, t7, t8, t9, t10, t11)
    x12, v12, d12, y12, t12, c12, s12, m12, e12, f12, o12 = slopes(here, start, x, v, d, y, t)
    end.x = total(x0, h, x1, x6, x7, x8, x9, x10, x11, x12)
    end.v = total(v0, h, v1, v6, v7, v8, v9, v10, v11, v12)
    end.seen = total(d0, h, d1, d6, d7, d8, d9, d10, d11, d12)
    end.inside = total(y0, h, y1, y6, y7, y8, y9, y10, y11, y12)
    end.passed = total(0.0, h, t1, t6, t7, t8, t9, t10, t11, t12)
    end.cos = total(0.0, h, c1, c6, c7, c8, c9, c10, c11, c12)
    end.sin = total(0.0, h, s1, s6, s7, s8, s9, s10, s11, s12)
    end.mean_z = total(0.0, h, m1, m6, m7, m8, m9, m10, m11, m12)
    end.loss = total(0.0, h, e1, e6, e7, e8, e9, e10, e11, e12)
    end.virial = total(0.0, h, f1, f6, f7, f8, f9, f10, f11, f12)
    end.air = total(0.0, h, o1, o6, o7, o8, o9, o10, o11, o12)
