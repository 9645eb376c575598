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

# Entries of a tip's state over a surface that remembers, after those that `tip` names.
CONTACT_MODE = 10  # what the contact does: OFF_SURFACE, GROWING or SHRINKING
CONTACT_EDGE = 11  # q [m^(1/2)]
DASHPOT_DEPTH = 12  # D [m]: depth of the tip as the dashpots see it
INNER_SUM = 13  # Y [m^(3/2)]: integral of y over the contact
INNER_COUNT = 14  # nodes of the stack inside the contact
OUTER_COUNT = 15  # nodes of the stack outside
LAST_PEAK = 16  # xi at which the contact last turned [m]
PERIOD_BEGIN = 17  # drive phase at which periods begin [rad]
FIRST_NODE = 18  # where the nodes begin: all of the inner stack, then all of the outer one
# Contact modes, beside OFF_SURFACE.
GROWING = 1
SHRINKING = 2
# Entries of a node, and of the polynomial between it and the node below it on its stack.
NODE_XI = 0  # [m]
NODE_TIME = 1  # when it was laid [1/omega_c]
NODE_VALUE = 2  # b or y then [m]
NODE_SLOPE = 3  # its derivative by xi
NODE_CURVE = 4  # and the second one [1/m]
NODE_PEAK = 5  # [m]
SERIES_TIME = 6  # that the coefficients are of
SERIES_NEAR = 7  # where the variable is 0, and what it is multiplied by: see `join`
SERIES_SCALE = 8
SERIES_FIRST = 9  # of six coefficients
NODE_WIDTH = 15  # entries of a node
STACK_NODES = 128  # most nodes of a stack
MEMORY_STATE = FIRST_NODE + 2 * STACK_NODES * NODE_WIDTH  # entries of a whole state
MOST_CURVATURE = 4.0  # bound of second derivatives, see `join`
OPEN_PEAK = -1.0  # the peak of nodes that were laid by a growth that has not ended yet


@kernel(inline=True)
def node_at(m: np.ndarray, outside: bool, j: int) -> int:
    """Where a node begins."""
    return FIRST_NODE + ((STACK_NODES if outside else 0) + j) * NODE_WIDTH


@kernel
def join(m: np.ndarray, of: int, low: int, high: int, rate: float) -> None:
    """Put the polynomial between two nodes into node `of`, of the two the one whose peak is that of both.

    Its variable is (sqrt(peak - xi) - near) scale, 0 at `high` and 1 at `low`; everything decays at this rate.
    """
    peak, when = m[of + NODE_PEAK], max(m[low + NODE_TIME], m[high + NODE_TIME])
    far, near = math.sqrt(max(peak - m[low + NODE_XI], 0.0)), math.sqrt(max(peak - m[high + NODE_XI], 0.0))
    far_kept, near_kept = math.exp((m[low + NODE_TIME] - when) * rate), math.exp((m[high + NODE_TIME] - when) * rate)
    h = far - near if far > near else 1.0
    f0, f1 = near_kept * m[high + NODE_VALUE], far_kept * m[low + NODE_VALUE]
    d0, d1 = -2 * h * near * near_kept * m[high + NODE_SLOPE], -2 * h * far * far_kept * m[low + NODE_SLOPE]
    # The second derivative grows without bound at a turn, where nothing is left of its digits. As slopes lie between -1
    # and 0, it cannot be far more than 1 / (h sqrt(peak - xi)).
    at_near, at_far = MOST_CURVATURE * near / h, MOST_CURVATURE * far / h
    s0 = (
        2
        * h
        * h
        * near_kept
        * (min(max(2 * near * near * m[high + NODE_CURVE], -at_near), at_near) - m[high + NODE_SLOPE])
    )
    s1 = 2 * h * h * far_kept * (min(max(2 * far * far * m[low + NODE_CURVE], -at_far), at_far) - m[low + NODE_SLOPE])
    if not far > near:
        f1, d1, s0, s1 = f0 + d0, d0, 0.0, 0.0
    rise = f1 - f0
    m[of + SERIES_TIME], m[of + SERIES_NEAR], m[of + SERIES_SCALE] = when, near, 1 / h
    c = of + SERIES_FIRST
    m[c], m[c + 1], m[c + 2] = f0, d0, 0.5 * s0
    m[c + 3] = 10 * rise - 6 * d0 - 4 * d1 - 1.5 * s0 + 0.5 * s1
    m[c + 4] = -15 * rise + 8 * d0 + 7 * d1 + 1.5 * s0 - s1
    m[c + 5] = 6 * rise - 3 * (d0 + d1) - 0.5 * s0 + 0.5 * s1


@kernel
def between(m: np.ndarray, of: int, xi: float, t: float, rate: float) -> tuple[float, float]:
    """What is remembered at xi at time t by the polynomial kept in node `of`, and its slope by xi."""
    scale, c = m[of + SERIES_SCALE], of + SERIES_FIRST
    w = math.sqrt(max(m[of + NODE_PEAK] - xi, 1e-18 * m[of + NODE_PEAK]))
    x = (w - m[of + SERIES_NEAR]) * scale
    c0, c1, c2, c3, c4, c5 = m[c], m[c + 1], m[c + 2], m[c + 3], m[c + 4], m[c + 5]
    kept = math.exp((m[of + SERIES_TIME] - t) * rate)
    x2 = x * x  # in pairs: each step waits for this
    value = c0 + x * c1 + x2 * (c2 + x * c3 + x2 * (c4 + x * c5))
    slope = c1 + x * (2 * c2) + x2 * (3 * c3 + x * (4 * c4) + x2 * (5 * c5))
    return kept * value, -0.5 * kept * slope * scale / w


@kernel
def curve_between(m: np.ndarray, of: int, xi: float, t: float, rate: float, slope: float) -> float:
    """The second derivative by xi of what is remembered, where the first is `slope`."""
    scale, c = m[of + SERIES_SCALE], of + SERIES_FIRST
    w = math.sqrt(max(m[of + NODE_PEAK] - xi, 1e-18 * m[of + NODE_PEAK]))
    x = (w - m[of + SERIES_NEAR]) * scale
    bend = 2 * m[c + 2] + x * (6 * m[c + 3] + x * (12 * m[c + 4] + x * 20 * m[c + 5]))
    return (math.exp((m[of + SERIES_TIME] - t) * rate) * bend * scale * scale + 2 * slope) / (4 * w * w)


@kernel
def outer_node(m: np.ndarray, xi: float) -> int:
    """Node with the polynomial of an element outside the contact: -1 where nothing was, -2 where there is one node."""
    count = int(m[OUTER_COUNT])
    if count == 0 or xi >= m[node_at(m, True, 0) + NODE_XI]:
        return -1
    j = count - 1
    if j == 0:
        return -2
    while j > 1 and m[node_at(m, True, j - 1) + NODE_XI] < xi:
        j -= 1
    return node_at(m, True, j)


@kernel
def inner_node(m: np.ndarray, xi: float) -> int:
    """Node with the polynomial of an element in the contact."""
    j = int(m[INNER_COUNT]) - 1
    while j > 1 and m[node_at(m, False, j - 1) + NODE_XI] > xi:
        j -= 1
    return node_at(m, False, j)


@kernel
def outside(m: np.ndarray, xi: float, t: float, rate: float) -> tuple[float, float]:
    """Depth y that an element outside the contact remembers, and its slope by xi; 0 where nothing was.

    A step that overshoots a turn looks for elements that the contact has grown over: there y goes on as a line.
    """
    of = outer_node(m, xi)
    if of >= 0:
        near = max(xi, m[of + NODE_XI])
        value, slope = between(m, of, near, t, rate)
        slope = min(max(slope, -1.0), 0.0)
        return value + slope * (xi - near), slope
    if of == -1:
        return 0.0, 0.0
    of = node_at(m, True, 0)
    kept = math.exp((m[of + NODE_TIME] - t) * rate)
    return kept * m[of + NODE_VALUE], kept * m[of + NODE_SLOPE]


@kernel
def outside_curve(m: np.ndarray, xi: float, t: float, rate: float, slope: float) -> float:
    """The second derivative of the same."""
    of = outer_node(m, xi)
    return curve_between(m, of, xi, t, rate, slope) if of >= 0 else 0.0


@kernel
def inside(m: np.ndarray, xi: float, t: float, rate: float) -> tuple[float, float]:
    """What is left of b of an element in the contact, and its slope by xi."""
    of = inner_node(m, xi)
    value, slope = between(m, of, min(xi, m[of + NODE_XI]), t, rate)
    return value, min(max(slope, -1.0), 0.0)


@kernel
def inside_curve(m: np.ndarray, xi: float, t: float, rate: float, slope: float) -> float:
    """The second derivative of the same."""
    of = inner_node(m, xi)
    return curve_between(m, of, min(xi, m[of + NODE_XI]), t, rate, slope)


@kernel
def join_top(m: np.ndarray, out: bool, j: int, rate: float) -> None:
    """Put into node j of a stack what lies between it and the one below it on the stack."""
    here = node_at(m, out, j)
    if j > 0 and m[here + NODE_PEAK] != OPEN_PEAK:
        join(m, here, here if out else here - NODE_WIDTH, here - NODE_WIDTH if out else here, rate)


@kernel
def lay_node(m: np.ndarray, out: bool, xi: float, t: float, of: Numbers, peak: float, rate: float) -> None:
    """Lay a node on a stack, `of` its value and derivatives; where it is full, thin out the older half."""
    which = OUTER_COUNT if out else INNER_COUNT
    count = int(m[which])
    if count == STACK_NODES:
        kept = 1
        for j in range(2, STACK_NODES):
            if j % 2 == 0 or j >= STACK_NODES // 2:
                for i in range(NODE_WIDTH):
                    m[node_at(m, out, kept) + i] = m[node_at(m, out, j) + i]
                join_top(m, out, kept, rate)
                kept += 1
        count = kept
    here = node_at(m, out, count)
    m[here + NODE_XI], m[here + NODE_TIME], m[here + NODE_PEAK] = xi, t, peak
    m[here + NODE_VALUE], m[here + NODE_SLOPE], m[here + NODE_CURVE] = of
    join_top(m, out, count, rate)
    m[which] = count + 1


@kernel
def passing(m: np.ndarray) -> float:
    """The edge at which an earlier contact turned, which one that grows passes next; 0 if there is none."""
    count = int(m[OUTER_COUNT])
    return math.sqrt(m[node_at(m, True, count - 1) + NODE_PEAK]) if count > 0 else 0.0


@kernel
def take_outer(m: np.ndarray, xi: float) -> None:
    """Take from the outer stack what the contact has grown over, but for the node just below its edge."""
    count = int(m[OUTER_COUNT])
    if count > 0 and m[node_at(m, True, 0) + NODE_XI] <= xi:
        count = 0
    while count > 1 and m[node_at(m, True, count - 2) + NODE_XI] <= xi:
        count -= 1
    m[OUTER_COUNT] = count


@kernel
def take_inner(m: np.ndarray, xi: float) -> None:
    """Take from the inner stack what the contact has let go, but for the node just above its edge."""
    count = int(m[INNER_COUNT])
    while count > 2 and m[node_at(m, False, count - 2) + NODE_XI] >= xi:
        count -= 1
    m[INNER_COUNT] = count


@kernel
def turn_back(m: np.ndarray, xi: float, t: float, recovery: float, rate: float) -> None:
    """End a growth of the contact at its edge xi; a `rate` of 0 is that of a Kelvin-Voigt surface."""
    value, slope = outside(m, xi, t, recovery)
    curve = outside_curve(m, xi, t, recovery, slope)
    count = int(m[OUTER_COUNT])
    peak = xi
    if count > 0:
        top = node_at(m, True, count - 1)
        peak = m[top + NODE_PEAK]
        if m[top + NODE_XI] < xi:
            m[OUTER_COUNT] = count - 1
    lay_node(m, True, xi, t, (value, slope, curve), peak, recovery)
    if rate == 0:
        m[node_at(m, True, int(m[OUTER_COUNT]) - 1) + NODE_SLOPE] = -1.0  # of y = d - xi in the contact, which is next
    count = int(m[INNER_COUNT])
    first = count
    while first > 0 and m[node_at(m, False, first - 1) + NODE_PEAK] == OPEN_PEAK:
        first -= 1
        m[node_at(m, False, first) + NODE_PEAK] = xi
    for j in range(first, count):
        join_top(m, False, j, rate)
    m[LAST_PEAK] = xi


@kernel
def turn_forth(m: np.ndarray, xi: float, t: float, rate: float) -> None:
    """End a shrinkage of the contact at its edge xi."""
    value, slope = inside(m, xi, t, rate)
    curve = inside_curve(m, xi, t, rate, slope)
    top = int(m[INNER_COUNT]) - 1
    peak = m[node_at(m, False, top) + NODE_PEAK]
    m[INNER_COUNT] = top
    lay_node(m, False, xi, t, (value, slope, curve), peak, rate)


@kernel
def shift(m: np.ndarray, time: float) -> None:
    """Let times count from later on."""
    for j in range(int(m[INNER_COUNT])):
        here = node_at(m, False, j)
        m[here + NODE_TIME] -= time
        m[here + SERIES_TIME] -= time
    for j in range(int(m[OUTER_COUNT])):
        here = node_at(m, True, j)
        m[here + NODE_TIME] -= time
        m[here + SERIES_TIME] -= time
