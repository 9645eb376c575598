"""What a surface remembers: how far its elements were pushed in, inside the contact and outside it.

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
DASHPOT_DEPTH = 16  # D [m] of each arm: depth of the tip as its dashpots see it
INNER_SUM = 16 + MOST_ARMS  # Y [m^(3/2)] of each: integral of y over the contact
ARMS_KNOWN = 16 + 2 * MOST_ARMS  # number of arms of the material that was marched over last
FIRST_NODE = 17 + 2 * MOST_ARMS  # where the nodes begin: all of the inner stack, then all of the outer one
# Contact modes, beside OFF_SURFACE.
GROWING = 1
SHRINKING = 2
# Entries of a node, and of the polynomials between it and the node below it on its stack; then those of each arm inside
# the contact, of each dent outside it (`arms`).
NODE_XI = 0  # [m]
NODE_TIME = 1  # when it was laid [1/omega_c]
NODE_PEAK = 2  # [m]
SERIES_TIME = 3  # that the coefficients are of
SERIES_NEAR = 4  # where the variable is 0, and what it is multiplied by: see `fit_polynomials`
SERIES_SCALE = 5
NODE_ARMS = 6  # where the first arm begins
ARM_VALUE = 0  # b or c then [m]
ARM_SLOPE = 1  # its derivative by xi
ARM_CURVE = 2  # and the second one [1/m]
ARM_SERIES = 3  # the first of six coefficients
ARM_WIDTH = 9  # entries of an arm
STACK_NODES = 128  # most nodes of a stack
MOST_CURVATURE = 4.0  # bound of second derivatives, see `fit_polynomials`
OPEN_PEAK = -1.0  # the peak of nodes that were laid by a growth that has not ended yet

THIRD = 1 / 3
_film_series = kernel(film_series, inline=True)


class Layer(NamedTuple):
    """A film on a rigid base: thinness sqrt(R)/h [m^-0.5], 0 of a half-space, and first coefficient of its law."""

    thinness: float
    first: float


@kernel(inline=True)
def layer_of(p: Any) -> Layer:
    """The film that a material is, which has no neck of liquid."""
    return Layer(p[col.THINNESS] if p[col.RELEASE] == 0.0 else 0.0, p[col.FILM_SERIES])


@kernel(inline=True)
def pressed_to(layer: Layer, q: float, d: float) -> tuple[float, float]:
    """Force of all elements within the edge q that are pushed to depth d, over (3/2) K sqrt(R), and weight of the last.

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
def fit_polynomials(
    m: np.ndarray, of: int, low: int, high: int, rates: np.ndarray, most: np.ndarray, count: int
) -> None:
    """Fit the polynomials of each arm between two nodes, and keep them in node `of`, whose peak is that of both.

    Their variable is (sqrt(peak - xi) - near) scale, 0 at `high` and 1 at `low`; each arm decays at its rate.
    Its slopes lie between -`most` and 0.
    """
    peak, when = m[of + NODE_PEAK], max(m[low + NODE_TIME], m[high + NODE_TIME])
    far, near = math.sqrt(max(peak - m[low + NODE_XI], 0.0)), math.sqrt(max(peak - m[high + NODE_XI], 0.0))
    h = far - near if far > near else 1.0
    m[of + SERIES_TIME], m[of + SERIES_NEAR], m[of + SERIES_SCALE] = when, near, 1 / h
    # The second derivative grows without bound at a turn, where nothing is left of its digits. As slopes are
    # bounded, it cannot be far more than their bound over h sqrt(peak - xi).
    for a in range(count):
        at_near, at_far = MOST_CURVATURE * most[a] * near / h, MOST_CURVATURE * most[a] * far / h
        arm = NODE_ARMS + ARM_WIDTH * a
        i, j, c = low + arm, high + arm, of + arm + ARM_SERIES
        far_kept, near_kept = (
            math.exp((m[low + NODE_TIME] - when) * rates[a]),
            math.exp((m[high + NODE_TIME] - when) * rates[a]),
        )
        f0, f1 = near_kept * m[j + ARM_VALUE], far_kept * m[i + ARM_VALUE]
        d0, d1 = -2 * h * near * near_kept * m[j + ARM_SLOPE], -2 * h * far * far_kept * m[i + ARM_SLOPE]
        bend = min(max(2 * near * near * m[j + ARM_CURVE], -at_near), at_near)
        s0 = 2 * h * h * near_kept * (bend - m[j + ARM_SLOPE])
        bend = min(max(2 * far * far * m[i + ARM_CURVE], -at_far), at_far)
        s1 = 2 * h * h * far_kept * (bend - m[i + ARM_SLOPE])
        if not far > near:
            f1, d1, s0, s1 = f0 + d0, d0, 0.0, 0.0
        rise = f1 - f0
        m[c], m[c + 1], m[c + 2] = f0, d0, 0.5 * s0
        m[c + 3] = 10 * rise - 6 * d0 - 4 * d1 - 1.5 * s0 + 0.5 * s1
        m[c + 4] = -15 * rise + 8 * d0 + 7 * d1 + 1.5 * s0 - s1
        m[c + 5] = 6 * rise - 3 * (d0 + d1) - 0.5 * s0 + 0.5 * s1


@kernel(inline=True)
def place_between(m: np.ndarray, of: int, xi: float) -> tuple[float, float]:
    """Variable of the polynomials of node `of` at xi, and sqrt(peak - xi)."""
    w = math.sqrt(max(m[of + NODE_PEAK] - xi, 1e-18 * m[of + NODE_PEAK]))
    return (w - m[of + SERIES_NEAR]) * m[of + SERIES_SCALE], w


@kernel(inline=True)
def series_at(m: np.ndarray, c: int, x: float) -> tuple[float, float]:
    """A polynomial whose coefficients begin at c, and its derivative, at x."""
    c0, c1, c2, c3, c4, c5 = m[c], m[c + 1], m[c + 2], m[c + 3], m[c + 4], m[c + 5]
    x2 = x * x  # in pairs: each step waits for this
    value = c0 + x * c1 + x2 * (c2 + x * c3 + x2 * (c4 + x * c5))
    return value, c1 + x * (2 * c2) + x2 * (3 * c3 + x * (4 * c4) + x2 * (5 * c5))


@kernel
def fill_between_nodes(
    m: np.ndarray, of: int, xi: float, t: float, rates: np.ndarray, most: np.ndarray, arms: Arms
) -> None:
    """Fill in what is remembered at xi at time t by the polynomials kept in node `of`, and its slopes by xi."""
    x, w = place_between(m, of, xi)
    by_xi = -0.5 * m[of + SERIES_SCALE] / w
    for a in range(arms.count):
        value, slope = series_at(m, of + NODE_ARMS + ARM_WIDTH * a + ARM_SERIES, x)
        kept = math.exp((m[of + SERIES_TIME] - t) * rates[a])
        arms.value[a], arms.slope[a] = kept * value, min(max(kept * by_xi * slope, -most[a]), 0.0)


@kernel
def fill_curves(m: np.ndarray, of: int, xi: float, t: float, rates: np.ndarray, arms: Arms) -> None:
    """Fill in the second derivatives by xi of what each arm remembers; 0 where `of` is no node."""
    if of < 0:
        for a in range(arms.count):
            arms.curve[a] = 0.0
        return
    x, w = place_between(m, of, xi)
    scale = m[of + SERIES_SCALE]
    for a in range(arms.count):
        c = of + NODE_ARMS + ARM_WIDTH * a + ARM_SERIES
        bend = 2 * m[c + 2] + x * (6 * m[c + 3] + x * (12 * m[c + 4] + x * 20 * m[c + 5]))
        kept = math.exp((m[of + SERIES_TIME] - t) * rates[a])
        arms.curve[a] = (kept * bend * scale * scale + 2 * arms.slope[a]) / (4 * w * w)


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
    """Place in m of the node whose polynomial holds at the element xi of the surface, inside the contact."""
    j = int(m[INNER_COUNT]) - 1
    while j > 1 and m[node_at(m, False, j - 1) + NODE_XI] > xi:
        j -= 1
    return node_at(m, False, j)


@kernel
def fill_dents_outside(m: np.ndarray, xi: float, t: float, arms: Arms) -> int:
    """Fill in each arm's dent of an element outside the contact and its slope by xi; returns the node they are from.

    A step that overshoots a turn looks for elements that the contact has grown over: there dents go on as a line.
    """
    of = outer_node(m, xi)
    if of >= 0:
        near = max(xi, m[of + NODE_XI])
        fill_between_nodes(m, of, near, t, arms.recovery, arms.whole, arms)
        if xi != near:
            for a in range(arms.count):
                arms.value[a] += arms.slope[a] * (xi - near)
        return of
    top = node_at(m, True, 0)
    for a in range(arms.count):
        arms.value[a] = arms.slope[a] = 0.0
        if of == -2:
            kept, i = math.exp((m[top + NODE_TIME] - t) * arms.recovery[a]), top + NODE_ARMS + ARM_WIDTH * a
            arms.value[a], arms.slope[a] = kept * m[i + ARM_VALUE], kept * m[i + ARM_SLOPE]
    return of


@kernel
def fill_creep_inside(m: np.ndarray, xi: float, t: float, arms: Arms) -> int:
    """Fill in what is left of b in each arm for an element in the contact, and its slope by xi; returns its node."""
    of = inner_node(m, xi)
    fill_between_nodes(m, of, min(xi, m[of + NODE_XI]), t, arms.rate, arms.one, arms)
    return of


@kernel
def join_top(m: np.ndarray, out: bool, j: int, arms: Arms) -> None:
    """Put into node j of a stack what lies between it and the one below it on the stack."""
    here, below = node_at(m, out, j), node_at(m, out, j - 1)
    if j > 0 and m[here + NODE_PEAK] != OPEN_PEAK:
        if out:
            fit_polynomials(m, here, here, below, arms.recovery, arms.whole, arms.count)
        else:
            fit_polynomials(m, here, below, here, arms.rate, arms.one, arms.count)


@kernel
def lay_node(m: np.ndarray, out: bool, xi: float, t: float, peak: float, arms: Arms) -> None:
    """Lay a node on a stack, with what is to be laid of each arm; where it is full, thin out the older half."""
    which = OUTER_COUNT if out else INNER_COUNT
    count = int(m[which])
    width = node_at(m, out, 1) - node_at(m, out, 0)
    if count == STACK_NODES:
        kept = 1
        for j in range(2, STACK_NODES):
            if j % 2 == 0 or j >= STACK_NODES // 2:
                for i in range(width):
                    m[node_at(m, out, kept) + i] = m[node_at(m, out, j) + i]
                join_top(m, out, kept, arms)
                kept += 1
        count = kept
    here = node_at(m, out, count)
    m[here + NODE_XI], m[here + NODE_TIME], m[here + NODE_PEAK] = xi, t, peak
    for a in range(arms.count):
        i = here + NODE_ARMS + ARM_WIDTH * a
        m[i + ARM_VALUE], m[i + ARM_SLOPE], m[i + ARM_CURVE] = (
            arms.laid_value[a],
            arms.laid_slope[a],
            arms.laid_curve[a],
        )
    for i in range(here + NODE_ARMS + ARM_WIDTH * arms.count, here + width):
        m[i] = 0.0  # for a material of more arms
    join_top(m, out, count, arms)
    m[which] = count + 1


@kernel
def lay_as_found(m: np.ndarray, out: bool, xi: float, t: float, peak: float, arms: Arms) -> None:
    """Lay a node with what was found of an element on the same stack."""
    for a in range(arms.count):
        arms.laid_value[a], arms.laid_slope[a], arms.laid_curve[a] = arms.value[a], arms.slope[a], arms.curve[a]
    lay_node(m, out, xi, t, peak, arms)


@kernel
def edge_of_old_turn(m: np.ndarray) -> float:
    """Edge q at which an earlier contact turned and that a growing contact passes next; 0 if there is none."""
    count = int(m[OUTER_COUNT])
    return math.sqrt(m[node_at(m, True, count - 1) + NODE_PEAK]) if count > 0 else 0.0


@kernel
def drop_covered_nodes(m: np.ndarray, xi: float) -> None:
    """Take from the outer stack what the contact has grown over, but for the node just below its edge."""
    count = int(m[OUTER_COUNT])
    if count > 0 and m[node_at(m, True, 0) + NODE_XI] <= xi:
        count = 0
    while count > 1 and m[node_at(m, True, count - 2) + NODE_XI] <= xi:
        count -= 1
    m[OUTER_COUNT] = count


@kernel
def drop_released_nodes(m: np.ndarray, xi: float) -> None:
    """Take from the inner stack what the contact has let go, but for the node just above its edge."""
    count = int(m[INNER_COUNT])
    while count > 2 and m[node_at(m, False, count - 2) + NODE_XI] >= xi:
        count -= 1
    m[INNER_COUNT] = count


@kernel
def end_growth(m: np.ndarray, xi: float, t: float, kelvin: bool, arms: Arms) -> None:
    """End the growth of a contact at its edge xi: it shrinks from here on."""
    fill_curves(m, fill_dents_outside(m, xi, t, arms), xi, t, arms.recovery, arms)
    count = int(m[OUTER_COUNT])
    peak = xi
    if count > 0:
        top = node_at(m, True, count - 1)
        peak = m[top + NODE_PEAK]
        if m[top + NODE_XI] < xi:
            m[OUTER_COUNT] = count - 1
    lay_as_found(m, True, xi, t, peak, arms)
    if kelvin:  # of y = d - xi in the contact, which is next
        m[node_at(m, True, int(m[OUTER_COUNT]) - 1) + NODE_ARMS + ARM_SLOPE] = -1.0
    count = int(m[INNER_COUNT])
    first = count
    while first > 0 and m[node_at(m, False, first - 1) + NODE_PEAK] == OPEN_PEAK:
        first -= 1
        m[node_at(m, False, first) + NODE_PEAK] = xi
    for j in range(first, count):
        join_top(m, False, j, arms)
    m[LAST_PEAK] = xi


@kernel
def resume_growth(m: np.ndarray, xi: float, t: float, arms: Arms) -> None:
    """Let a contact that shrank grow again from its edge xi, at time t: what lay outside is kept in new nodes."""
    fill_curves(m, fill_creep_inside(m, xi, t, arms), xi, t, arms.rate, arms)
    top = int(m[INNER_COUNT]) - 1
    peak = m[node_at(m, False, top) + NODE_PEAK]
    m[INNER_COUNT] = top
    lay_as_found(m, False, xi, t, peak, arms)


@kernel
def shift_times(m: np.ndarray, time: float) -> None:
    """Count the times of all nodes from an instant that is later by `time`."""
    for j in range(int(m[INNER_COUNT])):
        here = node_at(m, False, j)
        m[here + NODE_TIME] -= time
        m[here + SERIES_TIME] -= time
    for j in range(int(m[OUTER_COUNT])):
        here = node_at(m, True, j)
        m[here + NODE_TIME] -= time
        m[here + SERIES_TIME] -= time
