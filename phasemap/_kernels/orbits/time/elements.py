"""What a surface remembers: how far its elements were pushed in, inside the contact and outside it.

A linear viscoelastic half-space under a sphere is a row of independent elements under a parabola: that at x has to go
d - x^2 deep (lengths along x over sqrt(R), theory, Eq. (memory-2)). A dashpot of each element remembers y(x). With
xi = x^2, and the edge of the contact at x = q:

* inside, every dashpot creeps after the same tip: b = D - xi - y, D the tip's depth as a dashpot sees it, decays with
  the relaxation time, so that b at the moment of its first touch says all about an element;
* outside, y decays with the time of recovery, so that y at the moment of its release does.

Both are kept as stacks of nodes, in order of x, that have their tops at the edge: a contact that grows takes nodes from
the outer stack and lays nodes on the inner one, and the other way round. Between two nodes y is a cubic in
sqrt(peak - xi), in which it is smooth: peak is the xi at which the contact turned that made them.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels.compilation import kernel

# Entries of a tip's state in time beside z, z', whether it is in contact, and z0: what the contact does; q; D; the
# integral Y of y inside; how many nodes lie inside and outside; and where the contact last turned [xi].
MODE, EDGE, SEEN, INSIDE, INNER, OUTER, PEAK, NODES = 4, 5, 6, 7, 8, 9, 10, 11
FREE, GROWING, SHRINKING = 0.0, 1.0, 2.0
XI, TIME, VALUE, SLOPE, TURN, WIDTH = 0, 1, 2, 3, 4, 5  # of a node: xi, when, b or y then, and its slope by xi, peak
MOST = 256  # nodes of a stack
STATE = NODES + 2 * MOST * WIDTH
OPEN = -1.0  # the peak of nodes that were laid by a growth that has not ended yet


@kernel(inline=True)
def node(m: np.ndarray, outside: bool, j: int) -> int:
    """Where a node begins."""
    return NODES + ((MOST if outside else 0) + j) * WIDTH


@kernel
def between(m: np.ndarray, low: int, high: int, peak: float, xi: float, t: float, rate: float) -> tuple[float, float]:
    """What is remembered at xi between two nodes at time t, and its slope by xi; everything decays at this rate."""
    least = 1e-9 * math.sqrt(max(peak - m[low + XI], 0.0))
    far, near = math.sqrt(max(peak - m[low + XI], 0.0)), math.sqrt(max(peak - m[high + XI], 0.0))
    far_kept, near_kept = math.exp((m[low + TIME] - t) * rate), math.exp((m[high + TIME] - t) * rate)
    if not far > near:
        return near_kept * m[high + VALUE], near_kept * m[high + SLOPE]
    w = max(math.sqrt(max(peak - xi, 0.0)), least)
    h = far - near
    x = (w - near) / h
    far_value, near_value = far_kept * m[low + VALUE], near_kept * m[high + VALUE]
    far_slope, near_slope = -2 * h * far * far_kept * m[low + SLOPE], -2 * h * near * near_kept * m[high + SLOPE]
    rise = far_value - near_value
    c2, c3 = 3 * rise - 2 * near_slope - far_slope, near_slope + far_slope - 2 * rise
    value = near_value + x * (near_slope + x * (c2 + x * c3))
    return value, -(near_slope + x * (2 * c2 + 3 * x * c3)) / (2 * w * h)


@kernel
def outside(m: np.ndarray, xi: float, t: float, rate: float) -> tuple[float, float]:
    """Depth y that an element outside the contact remembers, and its slope by xi; 0 where nothing was."""
    count = int(m[OUTER])
    if count == 0 or xi >= m[node(m, True, 0) + XI]:
        return 0.0, 0.0
    j = count - 1
    if j == 0:
        here = node(m, True, 0)
        kept = math.exp((m[here + TIME] - t) * rate)
        return kept * m[here + VALUE], kept * m[here + SLOPE]
    while j > 1 and m[node(m, True, j - 1) + XI] < xi:
        j -= 1
    low = node(m, True, j)
    return between(m, low, low - WIDTH, m[low + TURN], xi, t, rate)


@kernel
def inside(m: np.ndarray, xi: float, t: float, rate: float) -> tuple[float, float]:
    """What is left of b of an element in the contact, and its slope by xi."""
    j = int(m[INNER]) - 1
    while j > 1 and m[node(m, False, j - 1) + XI] > xi:
        j -= 1
    high = node(m, False, j)
    peak = m[high + TURN]
    return between(m, high - WIDTH, high, peak, min(xi, m[high + XI]), t, rate)


@kernel
def lay(m: np.ndarray, out: bool, xi: float, t: float, value: float, slope: float, peak: float) -> None:
    """Lay a node on a stack; where it is full, every second node of its older half is left out."""
    which = OUTER if out else INNER
    count = int(m[which])
    if count == MOST:
        kept = 1
        for j in range(2, MOST):
            if j % 2 == 0 or j >= MOST // 2:
                for i in range(WIDTH):
                    m[node(m, out, kept) + i] = m[node(m, out, j) + i]
                kept += 1
        count = kept
    here = node(m, out, count)
    m[here + XI], m[here + TIME], m[here + VALUE], m[here + SLOPE], m[here + TURN] = xi, t, value, slope, peak
    m[which] = count + 1


@kernel
def take_outer(m: np.ndarray, xi: float) -> None:
    """Take from the outer stack what the contact has grown over, but for the node just below its edge."""
    count = int(m[OUTER])
    if count > 0 and m[node(m, True, 0) + XI] <= xi:
        count = 0
    while count > 1 and m[node(m, True, count - 2) + XI] <= xi:
        count -= 1
    m[OUTER] = count


@kernel
def take_inner(m: np.ndarray, xi: float) -> None:
    """Take from the inner stack what the contact has let go, but for the node just above its edge."""
    count = int(m[INNER])
    while count > 2 and m[node(m, False, count - 2) + XI] >= xi:
        count -= 1
    m[INNER] = count


@kernel
def turn_back(m: np.ndarray, xi: float, t: float, rate: float) -> None:
    """End a growth of the contact at its edge xi."""
    value, slope = outside(m, xi, t, rate)
    count = int(m[OUTER])
    peak = xi
    if count > 0:
        top = node(m, True, count - 1)
        peak = m[top + TURN]
        if m[top + XI] < xi:
            m[OUTER] = count - 1
    lay(m, True, xi, t, value, slope, peak)
    for j in range(int(m[INNER]) - 1, -1, -1):
        here = node(m, False, j)
        if m[here + TURN] != OPEN:
            break
        m[here + TURN] = xi
    m[PEAK] = xi


@kernel
def turn_forth(m: np.ndarray, xi: float, t: float, rate: float) -> None:
    """End a shrinkage of the contact at its edge xi."""
    value, slope = inside(m, xi, t, rate)
    top = int(m[INNER]) - 1
    peak = m[node(m, False, top) + TURN]
    m[INNER] = top
    lay(m, False, xi, t, value, slope, peak)


@kernel
def shift(m: np.ndarray, time: float) -> None:
    """Let times count from later on."""
    for j in range(int(m[INNER])):
        m[node(m, False, j) + TIME] -= time
    for j in range(int(m[OUTER])):
        m[node(m, True, j) + TIME] -= time
