"""What a contact that relaxes leaves behind it at the end of each step: a node for the element at its edge."""

from __future__ import annotations

import numpy as np

from phasemap._kernels.compilation import kernel
from phasemap._kernels.orbits.time import elements as on
from phasemap._kernels.orbits.time.arms import Arms, turn_to
from phasemap._kernels.orbits.time.contact import Motion, Moved
from phasemap._kernels.orbits.time.relaxing import Relaxing, filtered_depth


@kernel(inline=True)
def total(arms: Arms, of: np.ndarray) -> float:
    """Sum over the arms."""
    found = 0.0
    for a in range(arms.count):
        found += of[a]
    return found


@kernel
def lay_edge(contact: Relaxing, u: Moved, t: float, speed: float) -> None:
    """Lay the element at the edge on the stack that it now belongs to; d xi/dt = `speed`, 0 where the contact turns."""
    xi, arms, m = u.x * u.x, contact.arms, contact.m
    if contact.now.mode == on.GROWING:
        if contact.t0 == 0:
            on.fill_curves(m, on.outside(m, xi, t, arms), xi, t, arms.recovery, arms)
            slope = total(arms, arms.slope)
            turn_to(arms.to_arms, arms.count, arms.value, arms.laid_value)
            turn_to(arms.to_arms, arms.count, arms.slope, arms.laid_slope)
            turn_to(arms.to_arms, arms.count, arms.curve, arms.laid_curve)
            for a in range(arms.count):
                bent = (1 + slope) * arms.rate[a] / speed if speed != 0 else 0.0
                arms.laid_value[a] = filtered_depth(u, a) - xi - arms.laid_value[a]
                arms.laid_slope[a], arms.laid_curve[a] = -1 - arms.laid_slope[a], -arms.laid_curve[a] - bent
            on.lay_node(m, False, xi, t, on.OPEN_PEAK, arms)
        on.take_outer(m, xi)
    elif contact.t0 > 0:
        arms.laid_value[0], arms.laid_slope[0], arms.laid_curve[0] = -contact.t0 * u.v, -1.0, -arms.recovery[0] / speed
        on.lay_node(m, True, xi, t, m[on.LAST_PEAK], arms)
    else:
        on.fill_curves(m, on.inside(m, xi, t, arms), xi, t, arms.rate, arms)
        slope = 0.0
        for a in range(arms.count):
            arms.value[a], arms.slope[a] = filtered_depth(u, a) - xi - arms.value[a], -1 - arms.slope[a]
            slope += arms.share[a] * arms.slope[a]
        for a in range(arms.count):
            bent = (1 + slope) * arms.rate[a] / speed if speed != 0 else 0.0
            arms.curve[a] = -arms.curve[a] - bent
        turn_to(arms.to_dents, arms.count, arms.value, arms.laid_value)
        turn_to(arms.to_dents, arms.count, arms.slope, arms.laid_slope)
        turn_to(arms.to_dents, arms.count, arms.curve, arms.laid_curve)
        if speed == 0:  # it has a root there: what it is in the mean, from the node before
            top = on.node_at(m, True, int(m[on.OUTER_COUNT]) - 1)
            for j in range(arms.count):
                before = m[top + on.NODE_ARMS + on.ARM_WIDTH * j + on.ARM_SLOPE]
                arms.laid_curve[j] = (arms.laid_slope[j] - before) / (xi - m[top + on.NODE_XI])
        on.lay_node(m, True, xi, t, m[on.LAST_PEAK], arms)
        on.take_inner(m, xi)


@kernel
def lay_between(contact: Relaxing, motion: Motion) -> None:
    """Lay the element half-way along a step over a surface without dents.

    It lies on polynomials of degree 7 through both ends, of the time, whose slope is 2 q, and of D. Without it those of
    degree 5 between nodes are the largest error.
    """
    u, of, end, to, h = motion.here.at, motion.here.slope, motion.end.at, motion.end.slope, motion.h
    arms, q0, v0, a0, q1, v1, a1 = contact.arms, u.x, u.v, of.v, end.x, end.v, to.v
    time = end.passed / 2 + h * (11 * (q0 - q1) / 32 + h * (3 * (v0 + v1) / 64 + h * (a0 - a1) / 384))
    q = 35 * end.passed / (32 * h) - 19 * (q0 + q1) / 32 + h * ((v1 - v0) / 16 - h * (a0 + a1) / 384)
    v = 15 * (q1 - q0) / (8 * h) - 7 * (v0 + v1) / 16 + h * (a1 - a0) / 32
    for a in range(arms.count):
        rate, d0, b0 = arms.rate[a], filtered_depth(u, a), filtered_depth(of, a)
        d1, b1 = filtered_depth(end, a), filtered_depth(to, a)
        w0, w1 = 2 * q0 * v0 - b0, 2 * q1 * v1 - b1  # slopes of d - D
        c0, c1 = 2 * rate * (v0 * (q0 * q0 - d0) + q0 * w0), 2 * rate * (v1 * (q1 * q1 - d1) + q1 * w1)
        e0 = 2 * rate * (a0 * (q0 * q0 - d0) + 2 * v0 * w0 + q0 * (2 * v0 * v0 + 2 * q0 * a0 - c0))
        e1 = 2 * rate * (a1 * (q1 * q1 - d1) + 2 * v1 * w1 + q1 * (2 * v1 * v1 + 2 * q1 * a1 - c1))
        seen = (d0 + d1) / 2 + h * (11 * (b0 - b1) / 64 + h * (3 * (c0 + c1) / 128 + h * (e0 - e1) / 768))
        arms.laid_value[a], arms.laid_slope[a], arms.laid_curve[a] = seen - q * q, -1.0, -rate / v
    on.lay_node(contact.m, False, q * q, motion.time + time, on.OPEN_PEAK, arms)
