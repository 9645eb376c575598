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
from phasemap._kernels.orbits.time.edge import SEEN, TAU, V, X, at_edge, dent_at, speed_of, step

if TYPE_CHECKING:
    from phasemap._kernels.orbits.time.runge_kutta import Numbers


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
