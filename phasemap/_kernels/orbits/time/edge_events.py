"""What happens to a contact with memory at the end of a step: it begins, ends, turns or passes an old turn.

Each shortens the step to it; `record` then lays down what the surface is to remember.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law
from phasemap._kernels.orbits.time import elements as on
from phasemap._kernels.orbits.time.edge import (
    KAPPA,
    RATE,
    RECOVERY,
    SEEN,
    SLOPES,
    T0,
    TAU,
    V,
    X,
    at_edge,
    dent_at,
    speed_of,
    step,
)
from phasemap._kernels.orbits.time.march import root_of

if TYPE_CHECKING:
    from phasemap._kernels.orbits.time.runge_kutta import Numbers

TURNED, BROKEN = 1e-5, 1e-12  # of a step: how far from the turn of the contact; where the speed of its edge has a step


@kernel
def to_turn(
    law: Law, p: Any, c: Numbers, m: np.ndarray, mode: float, start: Numbers, u: np.ndarray, h: float, end: np.ndarray
) -> float:
    """Shorten a step to the turn of the contact, q' = 0, and return its size.

    At first q' is the quadratic with its values at both ends and its mean; then by secants between two sides.
    """
    first, last, mean = u[SLOPES], end[SLOPES], (end[X] - u[X]) / h
    b, a = 6 * mean - 4 * first - 2 * last, 3 * (first + last) - 6 * mean
    root = math.sqrt(max(b * b - 4 * a * first, 0.0))
    share = -2 * first / (b - root) if first > 0 else -2 * first / (b + root)
    low, high, bend = 0.0, h, (b + 2 * a * share) / h
    old, old_speed = 0.0, 0.0
    near = BROKEN if c[T0] > 0 else TURNED
    h = h * share if 0 < share < 1 else 0.5 * h
    for i in range(50):
        step(law, p, c, m, mode, start, u, h, end)
        speed = speed_of(law, p, c, m, mode, start, end)
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
def to_edge(
    law: Law, p: Any, c: Numbers, m: np.ndarray, mode: float, start: Numbers, u: np.ndarray, h: float, end: np.ndarray
) -> float:
    """Shorten a step to the first touch, d at the dent's, the last, q = 0, or a turn of before, and return its size.

    Newton's method in brackets begins where the cubic through both ends has its root.
    """
    free = mode == on.FREE
    low, high, whole = 0.0, h, h
    edge, fades = on.passing(m) if mode == on.GROWING else 0.0, 0.0
    for i in range(50):
        if free:
            edge = dent_at(c, start[0] + end[TAU])
            fades = edge * c[RECOVERY]
        off = end[X] - edge
        if abs(off) <= (1e-14 if free else 1e-8) * (abs(u[X] - edge) + abs(u[V]) * whole):
            break
        if (off > 0) == (mode != on.SHRINKING):
            high = h
        else:
            low = h
        speed = end[V] if free else speed_of(law, p, c, m, mode, start, end)
        if i == 0:
            before = dent_at(c, start[0]) if free else edge
            first, last = (u[V] + before * c[RECOVERY], speed + fades) if free else (u[SLOPES], speed)
            h = root_of(u[X] - before, first, off, last, h)
        else:
            h -= off / (speed + fades)
        if not low <= h <= high:
            h = 0.5 * (low + high)
        step(law, p, c, m, mode, start, u, h, end)
    return h


@kernel
def to_instant(
    law: Law, p: Any, c: Numbers, m: np.ndarray, mode: float, start: Numbers, u: np.ndarray, h: float, end: np.ndarray,
    time: float,
) -> float:  # fmt: skip
    """Shorten a step in contact to last `time`, and return its size."""
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
    return h


@kernel
def record(m: np.ndarray, c: Numbers, mode: float, u: np.ndarray, t: float, speed: float) -> None:
    """Lay the element at the edge on the stack that it now belongs to; d xi/dt = `speed`, 0 where the contact turns."""
    q = u[X]
    xi = q * q
    rate, recovery = c[RATE], c[RECOVERY]
    if mode == on.GROWING:
        if c[T0] == 0:
            y, slope = on.outside(m, xi, t, recovery)
            curve = on.outside_curve(m, xi, t, recovery, slope)
            bent = ((1 + slope) * rate - slope * recovery) / speed if speed != 0 else 0.0
            on.lay(m, False, xi, t, (u[SEEN] - xi - y, -1 - slope, -curve - bent), on.OPEN, rate)
        on.take_outer(m, xi)
    elif c[T0] > 0:
        on.lay(m, True, xi, t, (-c[T0] * u[V], -1.0, -recovery / speed), m[on.PEAK], recovery)
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
def record_between(m: np.ndarray, c: Numbers, u: np.ndarray, end: np.ndarray, h: float, t: float) -> None:
    """Lay the element half-way along a step over a surface without dents.

    It lies on polynomials of degree 7 through both ends, of the time, whose slope is 2 q, and of D. Without it those of
    degree 5 between nodes are the largest error.
    """
    q0, v0, d0, a0, b0 = u[X], u[V], u[SEEN], u[SLOPES + V], u[SLOPES + SEEN]
    q1, v1, d1, a1, b1 = end[X], end[V], end[SEEN], end[SLOPES + V], end[SLOPES + SEEN]
    rate, w0, w1 = c[RATE], 2 * q0 * v0 - b0, 2 * q1 * v1 - b1  # of d - D, whose slopes are these
    c0, c1 = 2 * rate * (v0 * (q0 * q0 - d0) + q0 * w0), 2 * rate * (v1 * (q1 * q1 - d1) + q1 * w1)
    e0 = 2 * rate * (a0 * (q0 * q0 - d0) + 2 * v0 * w0 + q0 * (2 * v0 * v0 + 2 * q0 * a0 - c0))
    e1 = 2 * rate * (a1 * (q1 * q1 - d1) + 2 * v1 * w1 + q1 * (2 * v1 * v1 + 2 * q1 * a1 - c1))
    time = end[TAU] / 2 + h * (11 * (q0 - q1) / 32 + h * (3 * (v0 + v1) / 64 + h * (a0 - a1) / 384))
    q = 35 * end[TAU] / (32 * h) - 19 * (q0 + q1) / 32 + h * ((v1 - v0) / 16 - h * (a0 + a1) / 384)
    v = 15 * (q1 - q0) / (8 * h) - 7 * (v0 + v1) / 16 + h * (a1 - a0) / 32
    seen = (d0 + d1) / 2 + h * (11 * (b0 - b1) / 64 + h * (3 * (c0 + c1) / 128 + h * (e0 - e1) / 768))
    on.lay(m, False, q * q, t + time, (seen - q * q, -1.0, -rate / v), on.OPEN, rate)


@kernel
def find_edge(m: np.ndarray, c: Numbers, mode: float, d: float, u: np.ndarray) -> float:
    """Edge q of a contact whose tip is at depth d at time 0: Newton from the one that it had, 0 if there is none."""
    if mode == on.SHRINKING and c[T0] > 0:
        return math.sqrt(max(d + c[T0] * u[V], 0.0))
    q = u[X] if u[X] > 0 else math.sqrt(max(d, 0.0))
    for _ in range(50):
        y, slope = at_edge(m, c[RATE], c[RECOVERY], mode, q, u[SEEN], 0.0)
        off = q * q + c[KAPPA] * y - d
        if abs(off) <= 1e-15 * (abs(d) + q * q) or not q > 0:
            break
        q = max(q - off / (2 * q * (1 + c[KAPPA] * slope)), 0.1 * q)
    return q
