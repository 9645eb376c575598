"""What happens to a contact with memory at the end of a step: it begins, ends, turns or passes an old turn.

Each shortens the step to it; `lay_edge` then lays down what the surface is to remember.
"""

from __future__ import annotations

import math

from phasemap._kernels.compilation import kernel
from phasemap._kernels.orbits.time import elements as on
from phasemap._kernels.orbits.time.edge import Instant, Point, Surface, at_edge, dent_at, speed_of, step_over_memory
from phasemap._kernels.orbits.time.march import time_of_crossing

NEAR_TURN = 1e-5  # of a step: how far from the turn of the contact
NEAR_KINK = 1e-12  # the same where the speed of the edge has a step


@kernel
def to_turn(here: Surface, start: Instant, u: Point, h: float, end: Point) -> float:
    """Shorten a step to the turn of the contact, q' = 0, and return its size.

    At first q' is the quadratic with its values at both ends and its mean; then by secants between two sides.
    """
    first, last, mean = u.slope.x, end.slope.x, (end.x - u.x) / h
    b, a = 6 * mean - 4 * first - 2 * last, 3 * (first + last) - 6 * mean
    root = math.sqrt(max(b * b - 4 * a * first, 0.0))
    share = -2 * first / (b - root) if first > 0 else -2 * first / (b + root)
    low, high, bend = 0.0, h, (b + 2 * a * share) / h
    old, old_speed = 0.0, 0.0
    near = NEAR_KINK if here.t0 > 0 else NEAR_TURN
    h = h * share if 0 < share < 1 else 0.5 * h
    for i in range(50):
        step_over_memory(here, start, u, h, end)
        speed = speed_of(here, start, end)
        if (speed > 0) == (first > 0):
            low = h
        else:
            high = h
        if i > 0 and old_speed != speed:
            bend = (speed - old_speed) / (h - old)
        way = -speed / bend
        if abs(way) < near * high or high - low < near * high:
            break
        old, old_speed = h, speed
        h += way
        if not low < h < high:
            h = 0.5 * (low + high)
    return h


@kernel
def to_edge(here: Surface, start: Instant, u: Point, h: float, end: Point) -> float:
    """Shorten a step to the first touch, d at the dent's, the last, q = 0, or a turn of before, and return its size.

    Newton's method in brackets begins where the cubic through both ends has its root.
    """
    free = here.mode == on.OFF_SURFACE
    low, high, whole = 0.0, h, h
    edge, fades = on.passing(here.m) if here.mode == on.GROWING else 0.0, 0.0
    for i in range(50):
        if free:
            edge = dent_at(here, start.time + end.passed)
            fades = edge * here.recovery
        off = end.x - edge
        if abs(off) <= (1e-14 if free else 1e-8) * (abs(u.x - edge) + abs(u.v) * whole):
            break
        if (off > 0) == (here.mode != on.SHRINKING):
            high = h
        else:
            low = h
        speed = end.v if free else speed_of(here, start, end)
        if i == 0:
            before = dent_at(here, start.time) if free else edge
            first, last = (u.v + before * here.recovery, speed + fades) if free else (u.slope.x, speed)
            h = time_of_crossing(u.x - before, first, off, last, h)
        else:
            h -= off / (speed + fades)
        if not low <= h <= high:
            h = 0.5 * (low + high)
        step_over_memory(here, start, u, h, end)
    return h


@kernel
def to_instant(here: Surface, start: Instant, u: Point, h: float, end: Point, time: float) -> float:
    """Shorten a step in contact to last `time`, and return its size."""
    low, high = 0.0, h
    for _ in range(50):
        h -= (end.passed - time) / (2 * end.x)
        if not low <= h <= high:
            h = 0.5 * (low + high)
        step_over_memory(here, start, u, h, end)
        if abs(end.passed - time) <= 4e-16:
            break
        if end.passed < time:
            low = h
        else:
            high = h
    return h


@kernel
def lay_edge(here: Surface, u: Point, t: float, speed: float) -> None:
    """Lay the element at the edge on the stack that it now belongs to; d xi/dt = `speed`, 0 where the contact turns."""
    q = u.x
    xi = q * q
    rate, recovery = here.rate, here.recovery
    if here.mode == on.GROWING:
        if here.t0 == 0:
            y, slope = on.outside(here.m, xi, t, recovery)
            curve = on.outside_curve(here.m, xi, t, recovery, slope)
            bent = ((1 + slope) * rate - slope * recovery) / speed if speed != 0 else 0.0
            on.lay_node(here.m, False, xi, t, (u.seen - xi - y, -1 - slope, -curve - bent), on.OPEN_PEAK, rate)
        on.take_outer(here.m, xi)
    elif here.t0 > 0:
        on.lay_node(here.m, True, xi, t, (-here.t0 * u.v, -1.0, -recovery / speed), here.m[on.LAST_PEAK], recovery)
    else:
        left, slope = on.inside(here.m, xi, t, rate)
        curve = -on.inside_curve(here.m, xi, t, rate, slope)
        y, slope = u.seen - xi - left, -1 - slope
        if speed != 0:
            curve -= ((1 + slope) * rate - slope * recovery) / speed
        else:  # it has a root there: what it is in the mean, from the node before
            top = on.node_at(here.m, True, int(here.m[on.OUTER_COUNT]) - 1)
            curve = (slope - here.m[top + on.NODE_SLOPE]) / (xi - here.m[top + on.NODE_XI])
        on.lay_node(here.m, True, xi, t, (y, slope, curve), here.m[on.LAST_PEAK], recovery)
        on.take_inner(here.m, xi)


@kernel
def lay_between(here: Surface, u: Point, end: Point, h: float, t: float) -> None:
    """Lay the element half-way along a step over a surface without dents.

    It lies on polynomials of degree 7 through both ends, of the time, whose slope is 2 q, and of D. Without it those of
    degree 5 between nodes are the largest error.
    """
    q0, v0, d0, a0, b0 = u.x, u.v, u.seen, u.slope.v, u.slope.seen
    q1, v1, d1, a1, b1 = end.x, end.v, end.seen, end.slope.v, end.slope.seen
    rate, w0, w1 = here.rate, 2 * q0 * v0 - b0, 2 * q1 * v1 - b1  # of d - D, whose slopes are these
    c0, c1 = 2 * rate * (v0 * (q0 * q0 - d0) + q0 * w0), 2 * rate * (v1 * (q1 * q1 - d1) + q1 * w1)
    e0 = 2 * rate * (a0 * (q0 * q0 - d0) + 2 * v0 * w0 + q0 * (2 * v0 * v0 + 2 * q0 * a0 - c0))
    e1 = 2 * rate * (a1 * (q1 * q1 - d1) + 2 * v1 * w1 + q1 * (2 * v1 * v1 + 2 * q1 * a1 - c1))
    time = end.passed / 2 + h * (11 * (q0 - q1) / 32 + h * (3 * (v0 + v1) / 64 + h * (a0 - a1) / 384))
    q = 35 * end.passed / (32 * h) - 19 * (q0 + q1) / 32 + h * ((v1 - v0) / 16 - h * (a0 + a1) / 384)
    v = 15 * (q1 - q0) / (8 * h) - 7 * (v0 + v1) / 16 + h * (a1 - a0) / 32
    seen = (d0 + d1) / 2 + h * (11 * (b0 - b1) / 64 + h * (3 * (c0 + c1) / 128 + h * (e0 - e1) / 768))
    on.lay_node(here.m, False, q * q, t + time, (seen - q * q, -1.0, -rate / v), on.OPEN_PEAK, rate)


@kernel
def find_edge(here: Surface, d: float, u: Point) -> float:
    """Edge q of a contact whose tip is at depth d at time 0: Newton from the one that it had, 0 if there is none."""
    if here.mode == on.SHRINKING and here.t0 > 0:
        return math.sqrt(max(d + here.t0 * u.v, 0.0))
    q = u.x if u.x > 0 else math.sqrt(max(d, 0.0))
    for _ in range(50):
        y, slope = at_edge(here, q, u.seen, 0.0)
        off = q * q + here.kappa * y - d
        if abs(off) <= 1e-15 * (abs(d) + q * q) or not q > 0:
            break
        q = max(q - off / (2 * q * (1 + here.kappa * slope)), 0.1 * q)
    return q
