"""Nodes along a solved orbit, for integrals over it: harmonic, by passes, by collocation, or kept with its row.

A harmonic orbit is harmonic about its deepest point, d = depth - A (1 - cos(theta)): what the higher harmonics do to
the depth within a contact is left out; that they lift or lower all of it is not, for the depth is the orbit's own. Its
nodes lie by

* contact: sin(theta/2) = sin(theta0/2) sin(psi), as in `averaged.harmonics`;
* outside: tan(theta/2) = tan(start/2) + delta x/(1 - x), delta the distance to the pole of the long-range force;
* neck: theta = theta_r - (theta_r - theta0) x^2, so that a root of the force at release is smooth.

A row that is longer than COLUMNS has room for the nodes of its orbit, which need not be solved again. Those of passes
of the lever's response are kept where the drive is faint: elsewhere contacts are long, and these nodes are too few for
high harmonics of what acts in them.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.law import Oscillator, has_longrange
from phasemap._kernels.lever import distance_to_pole, reach_of
from phasemap._kernels.orbits.collocation.system import MOST_ELEMENTS, OUT_OF_CONTACT, Orbit, element_of, head_of
from phasemap._kernels.orbits.response.nodes import (
    ENTRY,
    EXIT,
    N,
    Nodes,
    counts,
    depth_at_node,
    first_of_element,
    parts_of,
    rate_at_node,
    weight_of_node,
)
from phasemap._kernels.quadrature import NODES, T_END1, gauss
from phasemap._kernels.records import column, record

HARMONIC_NODES = 20  # of each part of a harmonic orbit
NODES_ALL_ROUND = 48  # of one that is always in contact
HARMONIC_X, HARMONIC_WEIGHTS = gauss(HARMONIC_NODES)
_COS2, _SIN2 = np.cos(0.5 * np.pi * HARMONIC_X) ** 2, np.sin(0.5 * np.pi * HARMONIC_X) ** 2
_HARMONIC_TOUCH_W = HARMONIC_WEIGHTS * np.pi * np.cos(0.5 * np.pi * HARMONIC_X)
MOST_NODES = MOST_ELEMENTS * NODES
MOST_KEPT_NODES = 40 * NODES  # of most orbits: few have more
FAINT_DRIVE = 0.01  # of the amplitude: the largest drive
# Columns of the row: how many nodes there are, sums of 1/|dd/dtheta| [1/m] where contacts begin and end, the nodes
KEPT_COUNT, KEPT_BEGINS, KEPT_ENDS, KEPT_NODES = range(col.COLUMNS, col.COLUMNS + 4)
# In place of the count, where two drives were marched: what the second mode felt [N/m] stands in the next two columns.
SECOND_IN_TIME, FELT_RE, FELT_IM = -1.0, KEPT_BEGINS, KEPT_ENDS
KEEPING = KEPT_NODES + 6 * MOST_KEPT_NODES


@record
class OrbitNodes:
    """Nodes along an orbit."""

    count: int  # how many there are
    begins: float  # sum of 1/|dd/dtheta| where contacts begin, and where they, or necks, end [1/m]
    ends: float
    cos: np.ndarray = column(MOST_NODES)  # of the angle theta of the first harmonic
    sin: np.ndarray = column(MOST_NODES)
    depth: np.ndarray = column(MOST_NODES)  # d [m]
    rate: np.ndarray = column(MOST_NODES)  # dd/d(theta) [m]
    weight: np.ndarray = column(MOST_NODES)  # [rad]
    touches: np.ndarray = column(MOST_NODES)  # 1 in contact or neck, else 0


@kernel
def _put(at: OrbitNodes, j: int, amplitude: float, c: float, s: float, depth: float, weight: float, on: float) -> None:
    """Put node j at the angle with cosine c and sine s of a harmonic orbit; `on` is 1 in contact or neck."""
    at.cos[j], at.sin[j], at.depth[j], at.rate[j] = c, s, depth, -amplitude * s
    at.weight[j], at.touches[j] = weight, on


@kernel
def _put_nodes_outside_contact(
    reach: float, amplitude: float, c: float, begin: float, side: float, first: int, at: OrbitNodes
) -> int:
    """Put nodes from tan(theta/2) = `begin` to theta = pi, way in (side -1) or out (1); returns how many there are."""
    delta = distance_to_pole(begin, max(c - 1.0, 0.0) + reach / amplitude)
    there = (1.0 - begin * begin) / (1.0 + begin * begin)
    for i in range(HARMONIC_NODES):
        u = begin + delta * HARMONIC_X[i] / (1.0 - HARMONIC_X[i])
        below = 1.0 / (1.0 + u * u)
        weight = 2.0 * delta * HARMONIC_WEIGHTS[i] / (1.0 - HARMONIC_X[i]) ** 2 * below
        # cos(begin) - cos(theta) without cancellation
        more = 2.0 * (u - begin) * (u + begin) * below / (1.0 + begin * begin)
        depth = -amplitude * (c - there + more)
        _put(at, first + i, amplitude, 2.0 * below - 1.0, side * 2.0 * u * below, depth, weight, 0.0)
    return first + HARMONIC_NODES


@kernel
def _fill_contact_nodes(amplitude: float, c: float, at: OrbitNodes) -> int:
    """Nodes in contact, |theta| < theta0, |c| < 1."""
    m2 = 0.5 * (1.0 - c)
    for i in range(HARMONIC_NODES):
        y = (1.0 - c) * _COS2[i]
        weight = math.sqrt(m2) * _HARMONIC_TOUCH_W[i] / math.sqrt(1.0 - m2 * _SIN2[i])
        sine = math.sqrt(max(1.0 - (c + y) ** 2, 0.0))
        _put(at, i, amplitude, c + y, sine, amplitude * y, weight, 1.0)
        _put(at, HARMONIC_NODES + i, amplitude, c + y, -sine, amplitude * y, weight, 1.0)
    return 2 * HARMONIC_NODES


@kernel
def _fill_neck_nodes(amplitude: float, c: float, release: float, first: int, at: OrbitNodes) -> int:
    """Nodes in the neck, on the way out from d = 0 to d = `release` < 0."""
    begin, end = math.acos(c), math.acos(c + release / amplitude)
    for i in range(HARMONIC_NODES):
        back = (end - begin) * HARMONIC_X[i] * HARMONIC_X[i]
        theta, weight = end - back, 2.0 * (end - begin) * HARMONIC_X[i] * HARMONIC_WEIGHTS[i]
        depth = release + 2.0 * amplitude * math.sin(0.5 * back) * math.sin(end - 0.5 * back)
        _put(at, first + i, amplitude, math.cos(theta), math.sin(theta), depth, weight, 1.0)
    return first + HARMONIC_NODES


@kernel
def fill_harmonic_nodes(p: np.ndarray, amplitude: float, depth: float, at: OrbitNodes) -> None:
    """Fill the nodes of a harmonic orbit with this largest depth [m]."""
    c, release = 1.0 - depth / amplitude, p[col.RELEASE]
    at.begins, at.ends = 0.0, 0.0
    if c <= -1.0 or (release < 0.0 and c < 1.0 and amplitude * (c + 1.0) <= -release):
        at.count = NODES_ALL_ROUND
        for i in range(NODES_ALL_ROUND):  # always in contact
            theta = 2.0 * math.pi * (i + 0.5) / NODES_ALL_ROUND
            x = math.cos(theta)
            _put(at, i, amplitude, x, math.sin(theta), amplitude * (x - c), 2.0 * math.pi / NODES_ALL_ROUND, 1.0)
        return
    count, begin, last = 0, 0.0, c
    if c < 1.0:
        count, begin = _fill_contact_nodes(amplitude, c, at), math.sqrt((1.0 - c) / (1.0 + c))
        if release < 0.0:
            count, last = _fill_neck_nodes(amplitude, c, release, count, at), c + release / amplitude
        at.begins = 1.0 / (amplitude * math.sqrt(1.0 - c * c))
        at.ends = 1.0 / (amplitude * math.sqrt(1.0 - last * last))
    if has_longrange(p):
        reach, end = reach_of(p), math.sqrt((1.0 - last) / (1.0 + last)) if last < 1.0 else 0.0
        count = _put_nodes_outside_contact(reach, amplitude, c, begin, -1.0, count, at)
        count = _put_nodes_outside_contact(reach, amplitude, c, end, 1.0, count, at)
    at.count = count


@kernel(fastmath=ANY_ORDER)
def nodes_from_response(nodes: Nodes, amplitude: float, centre: float, at: OrbitNodes) -> None:
    """Fill nodes from those of passes of the lever's response."""
    count = 0
    for element in range(2 + parts_of(nodes)):
        if not counts(nodes, element):
            continue
        first, in_contact = first_of_element(element), element != 0 and element != 2
        for j in range(N):
            i, k = first + j, count + j
            at.cos[k], at.sin[k] = nodes.cos[i], nodes.sin[i]
            at.depth[k], at.rate[k] = depth_at_node(nodes, amplitude, centre, i), rate_at_node(nodes, amplitude, i)
            at.weight[k], at.touches[k] = weight_of_node(nodes, i), 1.0 if in_contact else 0.0
        count += N
    at.count, at.begins, at.ends = count, 0.0, 0.0
    if nodes.touches == 1:
        at.begins = 1.0 / abs(rate_at_node(nodes, amplitude, ENTRY))
        at.ends = 1.0 / abs(rate_at_node(nodes, amplitude, EXIT))


@kernel
def nodes_from_collocation(oscillator: Oscillator, orbit: Orbit, at: OrbitNodes) -> None:
    """Fill nodes from those of collocation; elements on which nothing acts are left out."""
    head = head_of(orbit)
    at.count, at.begins, at.ends = 0, 0.0, 0.0
    for e in range(head.count):
        one, before = element_of(orbit, e), element_of(orbit, e - 1 if e > 0 else head.count - 1).side
        if (one.side == OUT_OF_CONTACT) != (before == OUT_OF_CONTACT):
            rate = 1.0 / abs(one.edge_u - head.amplitude * np.sin(one.edge))
            at.begins += rate if before == OUT_OF_CONTACT else 0.0
            at.ends += rate if one.side == OUT_OF_CONTACT else 0.0
        if one.side == OUT_OF_CONTACT and not has_longrange(oscillator.p):
            continue
        for j in range(NODES):
            k = at.count + j
            at.cos[k], at.sin[k] = one.cos[j], one.sin[j]
            at.depth[k] = head.amplitude * one.cos[j] + one.w[j] - head.tip_offset
            at.rate[k] = one.u[j] - head.amplitude * one.sin[j]
            at.weight[k] = one.scale * orbit.tables[one.table, T_END1, j]
            at.touches[k] = 0.0 if one.side == OUT_OF_CONTACT else 1.0
        at.count += NODES


@kernel
def read_nodes(row: np.ndarray, at: OrbitNodes) -> None:
    """Fill nodes with those behind a row."""
    at.count, at.begins, at.ends = int(row[KEPT_COUNT]), row[KEPT_BEGINS], row[KEPT_ENDS]
    for j in range(at.count):
        first = KEPT_NODES + 6 * j
        at.cos[j], at.sin[j], at.depth[j] = row[first], row[first + 1], row[first + 2]
        at.rate[j], at.weight[j], at.touches[j] = row[first + 3], row[first + 4], row[first + 5]


@kernel
def keep_nodes(at: OrbitNodes, row: np.ndarray) -> None:
    """Put nodes behind a row, where there is room for all."""
    row[KEPT_COUNT] = 0.0
    if at.count > MOST_KEPT_NODES:
        return
    row[KEPT_COUNT], row[KEPT_BEGINS], row[KEPT_ENDS] = at.count, at.begins, at.ends
    for j in range(at.count):
        first = KEPT_NODES + 6 * j
        row[first], row[first + 1], row[first + 2] = at.cos[j], at.sin[j], at.depth[j]
        row[first + 3], row[first + 4], row[first + 5] = at.rate[j], at.weight[j], at.touches[j]
