"""Memory of a surface: how far its elements were pushed in, inside the contact and outside it.

A linear viscoelastic half-space under a sphere, or a film on a rigid base, is a row of independent elements under a
parabola: that at x has to go d - x^2 deep (lengths along x over sqrt(R), theory, Eqs. (memory-2) and (memory-16)). A
dashpot of each element remembers y(x). With xi = x^2, and the edge of the contact at x = q:

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
from typing import Any, NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.columns import MOST_ARMS
from phasemap._kernels.compilation import kernel
from phasemap._kernels.forces import film_series
from phasemap._kernels.orbits.time.arms import Arms

# Entries of a tip's state over a surface that remembers, after those that `tip` names.
CONTACT_MODE = 10  # what the contact does: OFF_SURFACE, GROWING or SHRINKING
CONTACT_EDGE = 11  # q [m^(1/2)]
INNER_COUNT = 12  # nodes of the stack inside the contact
OUTER_COUNT = 13  # nodes of the stack outside
LAST_PEAK = 14  # xi at which the contact last turned [m]
PERIOD_BEGIN = 15  # drive phase at which periods begin [rad]
ARM_NUMBERS = 16  # what a step moves of each arm: `contact.Moved.arms`
ARMS_KNOWN = 16 + 2 * MOST_ARMS  # number of arms of the material that was marched over last
FIRST_NODE = 17 + 2 * MOST_ARMS  # where the nodes begin: all of the inner stack, then all of the outer one
# Contact modes, beside OFF_SURFACE.
GROWING = 1
SHRINKING = 2
# Entries of a node; then those of each arm inside the contact, of each dent outside it (`arms`).
NODE_XI = 0  # [m]
NODE_TIME = 1  # when it was laid [1/omega_c]
NODE_PEAK = 2  # of the edge, between this node and the one below it on the stack: xi [m]
NODE_ARMS = 3  # where the first arm begins
ARM_VALUE = 0  # b or c then [m]
ARM_SLOPE = 1  # its derivative by xi
ARM_CURVE = 2  # and the second one [1/m]
ARM_WIDTH = 3  # entries of an arm
STACK_NODES = 128  # most nodes of a stack
MOST_CURVATURE = 4.0  # bound of second derivatives, see `fill_between_nodes`
OPEN_PEAK = -1.0  # the peak of nodes that were laid by a growth that has not ended yet

THIRD = 1 / 3
_film_series = kernel(film_series, inline=True)


class Layer(NamedTuple):
    """A film on a rigid base: thinness sqrt(R)/h [m^-0.5], 0 of a half-space, and first coefficient of its law."""

    thinness: float
    first: float


@kernel(inline=True)
def layer_of(p: Any) -> Layer:
    """Film on a rigid base that a material is; of thinness 0, a half-space, under a neck of liquid."""
    return Layer(p[col.THINNESS] if p[col.RELEASE] == 0.0 else 0.0, p[col.FILM_SERIES])


@kernel(inline=True)
def pressed_to(layer: Layer, q: float, d: float) -> tuple[float, float]:
    """Force of all elements within the edge q, pushed to depth d, over (3/2) K sqrt(R), and weight of the last element.

    On a half-space the integral of d - x^2; on a film weights m are such that to q = sqrt(d) it is the force of the
    film's law, and their integral its slope: theory, Eq. (memory-17).
    """
    if layer.thinness == 0.0:
        return q * (d - q * q * THIRD), 1.0
    x = layer.thinness * q
    share, rise, bend = _film_series(x, layer.first)
    stiff = q * (share + x * rise * THIRD)
    return (d - q * q) * stiff + 2 * THIRD * q * q * q * share, share + x * (5 * rise + x * bend) * THIRD


@kernel(light=True)
def memory_size(arms: int) -> int:
    """Number of entries of a whole state over materials with so many relaxation times at most."""
    return FIRST_NODE + 2 * STACK_NODES * (NODE_ARMS + ARM_WIDTH * arms)


@kernel(inline=True)
def node_at(m: np.ndarray, outside: bool, j: int) -> int:
    """Index at which a node begins."""
    width = (len(m) - FIRST_NODE) // (2 * STACK_NODES)
    return FIRST_NODE + ((STACK_NODES if outside else 0) + j) * width


@kernel
def fill_between_nodes(
    m: np.ndarray, nodes: tuple[int, int], peak: float, xi: float, t: float, rates: np.ndarray, most: np.ndarray,
    arms: Arms,
) -> None:  # fmt: skip
    """Fill in what each arm remembers of the element xi at time t, between a node and one of larger xi; and its slopes.

    Polynomials of degree 5 in (sqrt(peak - xi) - near)/h have the values and slopes at both nodes; each arm decays at
    its rate. Its slopes by xi lie between -`most` and 0.
    """
    low, high = nodes
    far, near = math.sqrt(max(peak - m[low + NODE_XI], 0.0)), math.sqrt(max(peak - m[high + NODE_XI], 0.0))
    w, h = math.sqrt(max(peak - xi, 1e-18 * peak)), far - near if far > near else 1.0
    x, by_xi = (w - near) / h, -0.5 / (h * w)
    # The second derivative grows without bound at a turn, where nothing is left of its digits. As slopes are
    # bounded, it cannot be far more than their bound over h sqrt(peak - xi).
    for a in range(arms.count):
        i, j, bound = low + NODE_ARMS + ARM_WIDTH * a, high + NODE_ARMS + ARM_WIDTH * a, MOST_CURVATURE * most[a] / h
        far_kept = math.exp((m[low + NODE_TIME] - t) * rates[a])
        near_kept = math.exp((m[high + NODE_TIME] - t) * rates[a])
        f0, f1 = near_kept * m[j + ARM_VALUE], far_kept * m[i + ARM_VALUE]
        d0, d1 = -2 * h * near * near_kept * m[j + ARM_SLOPE], -2 * h * far * far_kept * m[i + ARM_SLOPE]
        bend = min(max(2 * near * near * m[j + ARM_CURVE], -bound * near), bound * near)
        s0 = 2 * h * h * near_kept * (bend - m[j + ARM_SLOPE])
        bend = min(max(2 * far * far * m[i + ARM_CURVE], -bound * far), bound * far)
        s1 = 2 * h * h * far_kept * (bend - m[i + ARM_SLOPE])
        if not far > near:
            f1, d1, s0, s1 = f0 + d0, d0, 0.0, 0.0
        rise = f1 - f0
        c3 = 10 * rise - 6 * d0 - 4 * d1 - 1.5 * s0 + 0.5 * s1
        c4 = -15 * rise + 8 * d0 + 7 * d1 + 1.5 * s0 - s1
        c5 = 6 * rise - 3 * (d0 + d1) - 0.5 * s0 + 0.5 * s1
        arms.value[a] = f0 + x * (d0 + x * (0.5 * s0 + x * (c3 + x * (c4 + x * c5))))
        slope = by_xi * (d0 + x * (s0 + x * (3 * c3 + x * (4 * c4 + x * 5 * c5))))
        arms.slope[a] = min(max(slope, -most[a]), 0.0)
        bend = s0 + x * (6 * c3 + x * (12 * c4 + x * 20 * c5))
        arms.curve[a] = (bend / (h * h) + 2 * arms.slope[a]) / (4 * w * w)


@kernel
def fill_dents_outside(m: np.ndarray, xi: float, t: float, arms: Arms) -> None:
    """Fill in each arm's dent of an element outside the contact, and its slopes by xi.

    A step that overshoots a turn looks for elements that the contact has grown over: there dents go on as a line.
    """
    j, top = int(m[OUTER_COUNT]) - 1, node_at(m, True, 0)
    if j > 0 and xi < m[top + NODE_XI]:
        while j > 1 and m[node_at(m, True, j - 1) + NODE_XI] < xi:
            j -= 1
        low = node_at(m, True, j)
        near = max(xi, m[low + NODE_XI])
        nodes = low, node_at(m, True, j - 1)
        fill_between_nodes(m, nodes, m[low + NODE_PEAK], near, t, arms.recovery, arms.whole, arms)
        for a in range(arms.count):
            arms.value[a] += arms.slope[a] * (xi - near)
        return
    for a in range(arms.count):
        arms.value[a] = arms.slope[a] = arms.curve[a] = 0.0
        if j == 0 and xi < m[top + NODE_XI]:
            kept, i = math.exp((m[top + NODE_TIME] - t) * arms.recovery[a]), top + NODE_ARMS + ARM_WIDTH * a
            arms.value[a], arms.slope[a] = kept * m[i + ARM_VALUE], kept * m[i + ARM_SLOPE]


@kernel
def fill_creep_inside(m: np.ndarray, xi: float, t: float, arms: Arms) -> None:
    """Fill in the decayed b = D - xi - y of each arm for an element in the contact, and its slopes by xi."""
    j = int(m[INNER_COUNT]) - 1
    while j > 1 and m[node_at(m, False, j - 1) + NODE_XI] > xi:
        j -= 1
    high = node_at(m, False, j)
    nodes, near = (node_at(m, False, j - 1), high), min(xi, m[high + NODE_XI])
    fill_between_nodes(m, nodes, m[high + NODE_PEAK], near, t, arms.rate, arms.one, arms)


@kernel
def lay_node(m: np.ndarray, out: bool, xi: float, t: float, peak: float, arms: Arms) -> None:
    """Lay a node on a stack, with what was found of each arm; where it is full, thin out the older half."""
    which = OUTER_COUNT if out else INNER_COUNT
    count = int(m[which])
    width = node_at(m, out, 1) - node_at(m, out, 0)
    if count == STACK_NODES:
        kept = 1
        for j in range(2, STACK_NODES):
            if j % 2 == 0 or j >= STACK_NODES // 2:
                for i in range(width):
                    m[node_at(m, out, kept) + i] = m[node_at(m, out, j) + i]
                kept += 1
        count = kept
    here = node_at(m, out, count)
    m[here + NODE_XI], m[here + NODE_TIME], m[here + NODE_PEAK] = xi, t, peak
    for a in range(arms.count):
        i = here + NODE_ARMS + ARM_WIDTH * a
        m[i + ARM_VALUE], m[i + ARM_SLOPE], m[i + ARM_CURVE] = arms.value[a], arms.slope[a], arms.curve[a]
    for i in range(here + NODE_ARMS + ARM_WIDTH * arms.count, here + width):
        m[i] = 0.0  # for a material of more arms
    m[which] = count + 1


@kernel
def edge_of_old_turn(m: np.ndarray) -> float:
    """Edge q at which an earlier contact turned and that a growing contact passes next; 0 if there is none."""
    count = int(m[OUTER_COUNT])
    return math.sqrt(m[node_at(m, True, count - 1) + NODE_PEAK]) if count > 0 else 0.0


@kernel
def drop_covered_nodes(m: np.ndarray, xi: float) -> None:
    """Take from the outer stack the nodes that the contact has grown over, but for the one just below its edge."""
    count = int(m[OUTER_COUNT])
    if count > 0 and m[node_at(m, True, 0) + NODE_XI] <= xi:
        count = 0
    while count > 1 and m[node_at(m, True, count - 2) + NODE_XI] <= xi:
        count -= 1
    m[OUTER_COUNT] = count


@kernel
def drop_released_nodes(m: np.ndarray, xi: float) -> None:
    """Take from the inner stack the nodes that the contact has released, but for the one just above its edge."""
    count = int(m[INNER_COUNT])
    while count > 2 and m[node_at(m, False, count - 2) + NODE_XI] >= xi:
        count -= 1
    m[INNER_COUNT] = count


@kernel
def end_growth(m: np.ndarray, xi: float, t: float, kelvin: bool, arms: Arms) -> None:
    """Turn a contact from growing to shrinking at its edge xi [m], at time t: lay the edge on the outer stack."""
    fill_dents_outside(m, xi, t, arms)
    count = int(m[OUTER_COUNT])
    peak = xi
    if count > 0:
        top = node_at(m, True, count - 1)
        peak = m[top + NODE_PEAK]
        if m[top + NODE_XI] < xi:
            m[OUTER_COUNT] = count - 1
    lay_node(m, True, xi, t, peak, arms)
    if kelvin:  # a second node at the edge, with the slope that y = d - xi has inside the contact
        arms.slope[0] = -1.0
        lay_node(m, True, xi, t, peak, arms)
    # The inner nodes that were laid during this growth get the xi at which it ended.
    j = int(m[INNER_COUNT]) - 1
    while j >= 0 and m[node_at(m, False, j) + NODE_PEAK] == OPEN_PEAK:
        m[node_at(m, False, j) + NODE_PEAK] = xi
        j -= 1
    m[LAST_PEAK] = xi


@kernel
def resume_growth(m: np.ndarray, xi: float, t: float, arms: Arms) -> None:
    """Let a contact that shrank grow again from its edge xi, at time t: what lay outside is kept in new nodes."""
    fill_creep_inside(m, xi, t, arms)
    # The topmost node becomes the edge, with the peak that it had.
    top = int(m[INNER_COUNT]) - 1
    peak = m[node_at(m, False, top) + NODE_PEAK]
    m[INNER_COUNT] = top
    lay_node(m, False, xi, t, peak, arms)


@kernel
def shift_times(m: np.ndarray, time: float) -> None:
    """Count the times of all nodes from an instant that is later by `time`."""
    for out in (False, True):
        for j in range(int(m[OUTER_COUNT if out else INNER_COUNT])):
            m[node_at(m, out, j) + NODE_TIME] -= time
