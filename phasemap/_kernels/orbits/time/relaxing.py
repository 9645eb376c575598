"""A contact that relaxes, Ting's for all histories: how its edge moves, and what it does to the tip.

The variable in contact is the edge q = a/sqrt(R), which is sqrt(d) only on a surface that nothing has touched. With
dtau = 2 q ds, w the dent at the edge, and y, D and Y for each arm (`arms`),

    d = q^2 + w,    q' = (v - dw/dtau) / (1 + dw/dxi),    v' = 2 q z'',    D' = 2 q (d - D)/tau,
    Y' = 2 q (q d - q^3/3 - Y)/tau + y q',    F = (3/2) K0 sqrt(R) (q d - q^3/3 - sum kappa Y)

(theory, Eqs. (memory-4) and (memory-5)). Where a Kelvin-Voigt surface lets go, its edge is at q^2 = d + t0 d'. Out of
contact the tip is attracted by a surface that comes back with the time tau_c, over which a neck of liquid may hold it.
On a film the elements have the weights of `surface_memory.pressed_to`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, contact_force, has_longrange, longrange_force
from phasemap._kernels.lever import reach_of
from phasemap._kernels.orbits.time import surface_memory as memory
from phasemap._kernels.orbits.time.arms import Arms, multiply_by, transform_arms
from phasemap._kernels.orbits.time.contact import (
    OFF_SURFACE,
    PLACE_OF_X,
    Moved,
    attraction_at,
    fill_own_slopes,
    first_moved,
    push_of,
)
from phasemap._kernels.quadrature import gauss
from phasemap._kernels.records import column, record

_X, _W = gauss(10)
FAR_LENGTHS = _X / (1 - _X)  # to infinity, with weights: exact for what falls with their square
FAR_WEIGHTS = _W / (1 - _X) ** 2


class Pace(NamedTuple):
    """Numbers that set the lengths of steps in a period."""

    free: float  # free amplitude [m]
    finer: float  # steps in contact, over others
    growth: float  # the same of a contact that grows
    layers: float  # weight in the density of steps of the layers about a turn


@record
class Memory:
    """State of the contact now, beside its elements."""

    mode: int
    held: int  # 1 in a neck of liquid, off the surface
    dented: int  # 1 over a dent that is not forgotten
    dents: np.ndarray = column(col.MOST_ARMS)  # under a tip that is off the surface, when it left it [m]
    since: float  # when the tip left it [1/omega_c]
    turned: float  # when the contact last turned
    share: float  # of the length that a step should have
    deep: float  # q that the contact may come to [m^(1/2)]


class Relaxing(NamedTuple):
    """A surface that remembers."""

    law: Law
    p: Any  # parameters of the material
    compliance: float  # 1/k [m/N]
    pull: float  # force at d = 0 in contact, over k [m]
    edge_force: float  # the long-range force at contact, over k [m]
    edge_slope: float  # its derivative there, over k
    m: np.ndarray  # what it remembers: `surface_memory`
    stiff: float  # (3/2) K0 sqrt(R)/k [m^(-1/2)]
    layer: memory.Layer
    arms: Arms
    t0: float  # of a Kelvin-Voigt surface, 0 of others
    pace: Pace
    now: Memory


class Pressed(NamedTuple):
    """Force of the contact on the tip, as in `contact.Push`, and slopes of its own."""

    w: float
    depth: float
    force: float
    drag: float
    speed: float  # slope of x, but where a Kelvin-Voigt surface lets go
    taken: float  # of the energy into the surface, over stiffness, but in a Kelvin-Voigt contact
    y: float  # dent at the edge [m]
    whole: float  # what the elements in contact push with before they creep, over stiffness [m^(3/2)]
    weight: float  # of the element at the edge [1]


@first_moved.of(Relaxing)
@kernel(inline=True)
def _first_moved(contact: Relaxing) -> int:
    """Place of the first number of the arms, two each, which stand before x."""
    return PLACE_OF_X - 2 * contact.arms.count


@kernel(inline=True)
def place_of_arm(a: int) -> int:
    """Place in `Moved.arms` of the depth D [m] that an arm sees, low-passed by its relaxation time; Y follows it."""
    return PLACE_OF_X - 2 - 2 * a


@kernel(inline=True)
def dent_at(contact: Relaxing, t: float) -> tuple[float, float]:
    """Depth [m] of the surface under a tip that does not touch it, and the rate at which it comes back."""
    now, arms, dent, rise = contact.now, contact.arms, 0.0, 0.0
    if now.dented == 0:
        return 0.0, 0.0
    for j in range(arms.count):
        part = now.dents[j] * math.exp((now.since - t) * arms.recovery[j])
        dent += part
        rise += arms.recovery[j] * part
    return dent, rise


@kernel
def neck_force(contact: Relaxing, d: float) -> float:
    """Force in a neck of liquid over k [m] at depth d <= 0; beyond it a tangent, as in `contact.attraction_at`."""
    force = contact_force(contact.law, -abs(d), contact.p) * contact.compliance
    return force if d <= 0.0 else 2 * contact.pull - force


@kernel
def work_from_far(law: Law, p: Any, d: float) -> float:
    """Work [J] of the long-range force on a tip that comes to depth d <= 0 over a surface that does not move.

    Steps out of contact do not count it: they add up the work of the force on a surface that recovers.
    """
    if not has_longrange(p):
        return 0.0
    size, integral = reach_of(p) - d, 0.0
    for i in range(len(FAR_LENGTHS)):
        integral += FAR_WEIGHTS[i] * longrange_force(law, d - size * FAR_LENGTHS[i], p)
    return size * integral


@kernel
def stored_energy(contact: Relaxing, q: float, d: float, t: float) -> float:
    """Recoverable energy over stiffness [m^2]: of the attraction, or of the springs of a Kelvin-Voigt contact.

    0 in a neck and in contact with a solid that relaxes, whose steps add up all the work. Where the energy into the
    surface is not F z' but what dashpots and a recovering dent take, it does not close by itself if steps are too long.
    """
    if contact.now.held == 1:
        return 0.0
    if contact.now.mode == OFF_SURFACE:
        return work_from_far(contact.law, contact.p, d - dent_at(contact, t)[0]) * contact.compliance
    if contact.t0 > 0:
        return contact.stiff * q * (0.5 * d * d - q * q * (d * memory.THIRD - 0.1 * q * q)) + contact.pull * d
    return 0.0


@kernel(inline=True)
def dent_at_edge(contact: Relaxing, u: Moved, q: float, t: float) -> tuple[float, float, float]:
    """Dent w [m] at the edge q, its slope by xi, and the rate at which it comes back; y of each arm is filled in.

    Not valid where a Kelvin-Voigt surface lets go.
    """
    xi, arms, w, slope, rise = q * q, contact.arms, 0.0, 0.0, 0.0
    if contact.now.mode == memory.SHRINKING:
        memory.fill_creep_inside(contact.m, xi, t, arms)
        for a in range(arms.count):
            arms.y[a] = u.arms[place_of_arm(a)] - xi - arms.value[a]
            w += arms.share[a] * arms.y[a]
            slope -= arms.share[a] * (1 + arms.slope[a])
        for a in range(arms.count):
            rise += arms.share[a] * arms.rate[a] * (arms.y[a] - w)
        return w, slope, rise
    memory.fill_dents_outside(contact.m, xi, t, arms)
    for j in range(arms.count):
        w += arms.value[j]
        slope += arms.slope[j]
        rise += arms.recovery[j] * arms.value[j]
    multiply_by(arms.to_arms, arms.count, arms.value, arms.y)
    return w, slope, rise


@kernel
def tip_depth(contact: Relaxing, u: Moved, t: float) -> float:
    """Depth d [m] of the tip."""
    if contact.now.mode == OFF_SURFACE:
        return u.x
    if contact.now.mode == memory.SHRINKING and contact.t0 > 0:
        return u.x * u.x - contact.t0 * u.v
    return u.x * u.x + dent_at_edge(contact, u, u.x, t)[0]


@push_of.of(Relaxing)
@kernel(inline=True)
def _push(contact: Relaxing, off: bool, time: float, y: Moved) -> Pressed:
    """Force of a relaxing surface: x is d off the surface, else where the edge of the contact is [m^(1/2)]."""
    x, v, t, mode, t0 = y.x, y.v, time + y.passed, contact.now.mode, contact.t0
    if off and contact.now.held == 1:
        force = neck_force(contact, x - dent_at(contact, t)[0])
        return Pressed(1.0, x, force, 0.0, v, force * v, 0.0, 0.0, 0.0)
    if off:
        dent, rise = dent_at(contact, t) if has_longrange(contact.p) else (0.0, 0.0)
        force = attraction_at(contact, x - dent)
        return Pressed(1.0, x, force, 0.0, v, -force * rise, 0.0, 0.0, 0.0)
    stiff, arms, xi, w = contact.stiff, contact.arms, x * x, 2 * x
    if mode == memory.SHRINKING and t0 > 0:
        force = stiff * x * xi * (2 / 3) + contact.pull
        return Pressed(w, xi - t0 * v, force, 0.0, v, 0.0, -t0 * v, 0.0, 1.0)
    dent, slope, rise = dent_at_edge(contact, y, x, t)
    d = xi + dent
    speed = (v + rise) / (1 + slope)
    whole, weight = memory.pressed_to(contact.layer, x, d)
    if t0 > 0:
        return Pressed(w, d, stiff * (whole + t0 * x * v) + contact.pull, 0.0, speed, 0.0, dent, whole, weight)
    crept = 0.0
    for a in range(arms.count):
        crept += arms.share[a] * y.arms[place_of_arm(a) + 1]
    force = stiff * (whole - crept) + contact.pull
    return Pressed(w, d, force, 0.0, speed, w * force * v, dent, whole, weight)


@fill_own_slopes.of(Relaxing)
@kernel(inline=True)
def _fill_own_slopes(contact: Relaxing, off: bool, push: Pressed, y: Moved, a: float, k: Moved) -> float:
    """Slopes of x and of two numbers of each arm; returns the rate of the energy into the surface, over stiffness."""
    k.x = push.speed
    if off:
        return push.taken
    if contact.t0 == 0:
        arms, whole, w, edge = contact.arms, push.whole, push.w, push.weight * push.speed
        for i in range(arms.count):
            j = place_of_arm(i)
            k.arms[j] = w * (push.depth - y.arms[j]) * arms.rate[i]
            k.arms[j + 1] = w * (whole - y.arms[j + 1]) * arms.rate[i] + arms.y[i] * edge
        return push.taken
    if contact.now.mode == memory.SHRINKING:
        k.x += contact.t0 * a
    return contact.stiff * (contact.t0 * push.w * y.x * y.v * y.v - 0.5 * push.y * push.y * k.x)


@kernel
def turn_over(arms: Arms, u: Moved, xi: float, bend: float) -> None:
    """Turn y of the element at the edge into b = D - xi - y, or b into y, with both derivatives by xi, in each arm.

    There D has the first derivative 0 by xi, and the second one -`bend` times the rate of the arm.
    """
    for a in range(arms.count):
        arms.value[a] = u.arms[place_of_arm(a)] - xi - arms.value[a]
        arms.slope[a], arms.curve[a] = -1 - arms.slope[a], -arms.curve[a] - bend * arms.rate[a]


@kernel
def lay_edge(contact: Relaxing, u: Moved, t: float, speed: float) -> None:
    """Lay the element at the edge on the stack that it now belongs to; d xi/dt = `speed`, 0 where the contact turns."""
    xi, arms, m = u.x * u.x, contact.arms, contact.m
    if contact.t0 > 0:
        if contact.now.mode == memory.GROWING:
            memory.drop_covered_nodes(m, xi)
            return
        arms.value[0], arms.slope[0], arms.curve[0] = -contact.t0 * u.v, -1.0, -arms.recovery[0] / speed
        memory.lay_node(m, True, xi, t, m[memory.LAST_PEAK], arms)
        return
    _, slope, _ = dent_at_edge(contact, u, u.x, t)
    bend = (1 + slope) / speed if speed != 0 else 0.0
    if contact.now.mode == memory.GROWING:
        transform_arms(arms.to_arms, arms)
        turn_over(arms, u, xi, bend)
        memory.lay_node(m, False, xi, t, memory.OPEN_PEAK, arms)
        memory.drop_covered_nodes(m, xi)
        return
    turn_over(arms, u, xi, bend)
    transform_arms(arms.to_dents, arms)
    if speed == 0:  # it has a root there: what it is in the mean, from the node before
        top = memory.node_at(m, True, int(m[memory.OUTER_COUNT]) - 1)
        for j in range(arms.count):
            before = m[top + memory.NODE_ARMS + memory.ARM_WIDTH * j + memory.ARM_SLOPE]
            arms.curve[j] = (arms.slope[j] - before) / (xi - m[top + memory.NODE_XI])
    memory.lay_node(m, True, xi, t, m[memory.LAST_PEAK], arms)
    memory.drop_released_nodes(m, xi)
