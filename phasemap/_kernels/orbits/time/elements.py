"""What a surface remembers: how far its elements were pushed in, inside the contact and outside it.

A linear viscoelastic half-space under a sphere is a row of independent elements under a parabola: that at x has to go
d - x^2 deep (lengths along x over sqrt(R), theory, Eq. (memory-2)). A dashpot of each element remembers y(x). With
xi = x^2, and the edge of the contact at x = q:

* inside, every dashpot creeps after the same tip: b = D - xi - y, D the tip's depth as a dashpot sees it, decays with
  the relaxation time, so that b at the moment of its first touch says all about an element;
* outside, y decays with the time of recovery, so that y at the moment of its release does.

Both are kept as stacks of nodes, in order of x, that have their tops at the edge: a contact that grows takes nodes from
the outer stack and lays nodes on the inner one, and the other way round. Between two nodes y is a polynomial of degree
5 in sqrt(peak - xi), in which it is smooth: peak is the xi at which the contact turned that made them. Its coefficients
are kept with one of the two nodes, for one moment: all of it decays alike. The slopes of y lie between that of the tip
and 0, those of b likewise, whatever happened before: polynomials are held to that, or an edge would turn without cause.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from phasemap._kernels.compilation import kernel

if TYPE_CHECKING:
    from phasemap._kernels.orbits.time.runge_kutta import Numbers

# Entries of a tip's state in time beside z, z', whether it is in contact, and z0: what the contact does; q; D; the
# integral Y of y inside; how many nodes lie inside and outside; where the contact last turned [xi]; and the drive phase
# at which periods begin.
MODE, EDGE, SEEN, INSIDE, INNER, OUTER, PEAK, BEGIN, NODES = 4, 5, 6, 7, 8, 9, 10, 11, 12
FREE, GROWING, SHRINKING = 0.0, 1.0, 2.0
# Of a node: xi, when it was laid, b or y then, its first and second derivatives by xi, and peak; and of what lies
# between it and the node below it on its stack, the time that the polynomial is of, its variable, and its coefficients.
XI, TIME, VALUE, SLOPE, CURVE, TURN, WHEN, NEAR, SCALE, SERIES, WIDTH = 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 15
MOST = 128  # nodes of a stack
STATE = NODES + 2 * MOST * WIDTH
MOST_BENT = 4.0  # bound of second derivatives, see `join`
OPEN = -1.0  # the peak of nodes that were laid by a growth that has not ended yet


@kernel(inline=True)
def node(m: np.ndarray, outside: bool, j: int) -> int:
    """Where a node begins."""
    return NODES + ((MOST if outside else 0) + j) * WIDTH


@kernel
def join(m: np.ndarray, of: int, low: int, high: int, rate: float) -> None:
    """Put the polynomial between two nodes into node `of`, of the two the one whose peak is that of both.

    Its variable is (sqrt(peak - xi) - near) scale, 0 at `high` and 1 at `low`; everything decays at this rate.
    """
    peak, when = m[of + TURN], max(m[low + TIME], m[high + TIME])
    far, near = math.sqrt(max(peak - m[low + XI], 0.0)), math.sqrt(max(peak - m[high + XI], 0.0))
    far_kept, near_kept = math.exp((m[low + TIME] - when) * rate), math.exp((m[high + TIME] - when) * rate)
    h = far - near if far > near else 1.0
    f0, f1 = near_kept * m[high + VALUE], far_kept * m[low + VALUE]
    d0, d1 = -2 * h * near * near_kept * m[high + SLOPE], -2 * h * far * far_kept * m[low + SLOPE]
    # The second derivative grows without bound at a turn, where nothing is left of its digits. As slopes lie between -1
    # and 0, it cannot be far more than 1 / (h sqrt(peak - xi)).
    at_near, at_far = MOST_BENT * near / h, MOST_BENT * far / h
    s0 = 2 * h * h * near_kept * (min(max(2 * near * near * m[high + CURVE], -at_near), at_near) - m[high + SLOPE])
    s1 = 2 * h * h * far_kept * (min(max(2 * far * far * m[low + CURVE], -at_far), at_far) - m[low + SLOPE])
    if not far > near:
        f1, d1, s0, s1 = f0 + d0, d0, 0.0, 0.0
    rise = f1 - f0
    m[of + WHEN], m[of + NEAR], m[of + SCALE] = when, near, 1 / h
    c = of + SERIES
    m[c], m[c + 1], m[c + 2] = f0, d0, 0.5 * s0
    m[c + 3] = 10 * rise - 6 * d0 - 4 * d1 - 1.5 * s0 + 0.5 * s1
    m[c + 4] = -15 * rise + 8 * d0 + 7 * d1 + 1.5 * s0 - s1
    m[c + 5] = 6 * rise - 3 * (d0 + d1) - 0.5 * s0 + 0.5 * s1


@kernel
def between(m: np.ndarray, of: int, xi: float, t: float, rate: float) -> tuple[float, float]:
    """What is remembered at xi at time t by the polynomial kept in node `of`, and its slope by xi."""
    scale, c = m[of + SCALE], of + SERIES
    w = math.sqrt(max(m[of + TURN] - xi, 1e-18 * m[of + TURN]))
    x = (w - m[of + NEAR]) * scale
    c0, c1, c2, c3, c4, c5 = m[c], m[c + 1], m[c + 2], m[c + 3], m[c + 4], m[c + 5]
    kept = math.exp((m[of + WHEN] - t) * rate)
    x2 = x * x  # in pairs: each step waits for this
    value = c0 + x * c1 + x2 * (c2 + x * c3 + x2 * (c4 + x * c5))
    slope = c1 + x * (2 * c2) + x2 * (3 * c3 + x * (4 * c4) + x2 * (5 * c5))
    return kept * value, -0.5 * kept * slope * scale / w


@kernel
def curve_between(m: np.ndarray, of: int, xi: float, t: float, rate: float, slope: float) -> float:
    """The second derivative by xi of what is remembered, where the first is `slope`."""
    scale, c = m[of + SCALE], of + SERIES
    w = math.sqrt(max(m[of + TURN] - xi, 1e-18 * m[of + TURN]))
    x = (w - m[of + NEAR]) * scale
    bend = 2 * m[c + 2] + x * (6 * m[c + 3] + x * (12 * m[c + 4] + x * 20 * m[c + 5]))
    return (math.exp((m[of + WHEN] - t) * rate) * bend * scale * scale + 2 * slope) / (4 * w * w)


@kernel
def outer(m: np.ndarray, xi: float) -> int:
    """Node with the polynomial of an element outside the contact: -1 where nothing was, -2 where there is one node."""
    count = int(m[OUTER])
    if count == 0 or xi >= m[node(m, True, 0) + XI]:
        return -1
    j = count - 1
    if j == 0:
        return -2
    while j > 1 and m[node(m, True, j - 1) + XI] < xi:
        j -= 1
    return node(m, True, j)


@kernel
def inner(m: np.ndarray, xi: float) -> int:
    """Node with the polynomial of an element in the contact."""
    j = int(m[INNER]) - 1
    while j > 1 and m[node(m, False, j - 1) + XI] > xi:
        j -= 1
    return node(m, False, j)


@kernel
def outside(m: np.ndarray, xi: float, t: float, rate: float) -> tuple[float, float]:
    """Depth y that an element outside the contact remembers, and its slope by xi; 0 where nothing was.

    A step that overshoots a turn looks for elements that the contact has grown over: there y goes on as a line.
    """
    of = outer(m, xi)
    if of >= 0:
        near = max(xi, m[of + XI])
        value, slope = between(m, of, near, t, rate)
        slope = min(max(slope, -1.0), 0.0)
        return value + slope * (xi - near), slope
    if of == -1:
        return 0.0, 0.0
    of = node(m, True, 0)
    kept = math.exp((m[of + TIME] - t) * rate)
    return kept * m[of + VALUE], kept * m[of + SLOPE]


@kernel
def outside_curve(m: np.ndarray, xi: float, t: float, rate: float, slope: float) -> float:
    """The second derivative of the same."""
    of = outer(m, xi)
    return curve_between(m, of, xi, t, rate, slope) if of >= 0 else 0.0


@kernel
def inside(m: np.ndarray, xi: float, t: float, rate: float) -> tuple[float, float]:
    """What is left of b of an element in the contact, and its slope by xi."""
    of = inner(m, xi)
    value, slope = between(m, of, min(xi, m[of + XI]), t, rate)
    return value, min(max(slope, -1.0), 0.0)


@kernel
def inside_curve(m: np.ndarray, xi: float, t: float, rate: float, slope: float) -> float:
    """The second derivative of the same."""
    of = inner(m, xi)
    return curve_between(m, of, min(xi, m[of + XI]), t, rate, slope)


@kernel
def join_top(m: np.ndarray, out: bool, j: int, rate: float) -> None:
    """Put into node j of a stack what lies between it and the one below it on the stack."""
    here = node(m, out, j)
    if j > 0 and m[here + TURN] != OPEN:
        join(m, here, here if out else here - WIDTH, here - WIDTH if out else here, rate)


@kernel
def lay(m: np.ndarray, out: bool, xi: float, t: float, of: Numbers, peak: float, rate: float) -> None:
    """Lay a node on a stack, `of` its value and derivatives; where it is full, thin out the older half."""
    which = OUTER if out else INNER
    count = int(m[which])
    if count == MOST:
        kept = 1
        for j in range(2, MOST):
            if j % 2 == 0 or j >= MOST // 2:
                for i in range(WIDTH):
                    m[node(m, out, kept) + i] = m[node(m, out, j) + i]
                join_top(m, out, kept, rate)
                kept += 1
        count = kept
    here = node(m, out, count)
    m[here + XI], m[here + TIME], m[here + TURN] = xi, t, peak
    m[here + VALUE], m[here + SLOPE], m[here + CURVE] = of
    join_top(m, out, count, rate)
    m[which] = count + 1


@kernel
def passing(m: np.ndarray) -> float:
    """The edge at which an earlier contact turned, which one that grows passes next; 0 if there is none."""
    count = int(m[OUTER])
    return math.sqrt(m[node(m, True, count - 1) + TURN]) if count > 0 else 0.0


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
def turn_back(m: np.ndarray, xi: float, t: float, recovery: float, rate: float) -> None:
    """End a growth of the contact at its edge xi; a `rate` of 0 is that of a Kelvin-Voigt surface."""
    value, slope = outside(m, xi, t, recovery)
    curve = outside_curve(m, xi, t, recovery, slope)
    count = int(m[OUTER])
    peak = xi
    if count > 0:
        top = node(m, True, count - 1)
        peak = m[top + TURN]
        if m[top + XI] < xi:
            m[OUTER] = count - 1
    lay(m, True, xi, t, (value, slope, curve), peak, recovery)
    if rate == 0:
        m[node(m, True, int(m[OUTER]) - 1) + SLOPE] = -1.0  # of y = d - xi in the contact, which is next
    count = int(m[INNER])
    first = count
    while first > 0 and m[node(m, False, first - 1) + TURN] == OPEN:
        first -= 1
        m[node(m, False, first) + TURN] = xi
    for j in range(first, count):
        join_top(m, False, j, rate)
    m[PEAK] = xi


@kernel
def turn_forth(m: np.ndarray, xi: float, t: float, rate: float) -> None:
    """End a shrinkage of the contact at its edge xi."""
    value, slope = inside(m, xi, t, rate)
    curve = inside_curve(m, xi, t, rate, slope)
    top = int(m[INNER]) - 1
    peak = m[node(m, False, top) + TURN]
    m[INNER] = top
    lay(m, False, xi, t, (value, slope, curve), peak, rate)


@kernel
def shift(m: np.ndarray, time: float) -> None:
    """Let times count from later on."""
    for j in range(int(m[INNER])):
        here = node(m, False, j)
        m[here + TIME] -= time
        m[here + WHEN] -= time
    for j in range(int(m[OUTER])):
        here = node(m, True, j)
        m[here + TIME] -= time
        m[here + WHEN] -= time
