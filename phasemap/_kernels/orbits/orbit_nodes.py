"""Nodes along a solved orbit, for integrals over it: by passes, by collocation, or kept with its row.

A row that is longer than COLUMNS has room for the nodes of its orbit, which need not be solved again. Those of passes
of the lever's response are kept where the drive is faint: elsewhere contacts are long, and these nodes are too few for
high harmonics of what acts in them.
"""

from __future__ import annotations

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.law import Oscillator, has_longrange
from phasemap._kernels.orbits.collocation.system import MOST_ELEMENTS, OUT_OF_CONTACT, Orbit, element_of, head_of
from phasemap._kernels.orbits.response.nodes import (
    ENTRY,
    EXIT,
    N,
    Nodes,
    depth_at_node,
    first_of_element,
    force_acts_on,
    parts_of,
    rate_at_node,
    weight_of_node,
)
from phasemap._kernels.quadrature import NODES, T_END1
from phasemap._kernels.records import column, record

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


@kernel(fastmath=ANY_ORDER)
def nodes_from_response(nodes: Nodes, amplitude: float, centre: float, out: OrbitNodes) -> None:
    """Fill nodes from those of passes of the lever's response."""
    count = 0
    for element in range(2 + parts_of(nodes)):
        if not force_acts_on(nodes, element):
            continue
        first, in_contact = first_of_element(element), element != 0 and element != 2
        for j in range(N):
            i, k = first + j, count + j
            out.cos[k], out.sin[k] = nodes.cos[i], nodes.sin[i]
            out.depth[k], out.rate[k] = depth_at_node(nodes, amplitude, centre, i), rate_at_node(nodes, amplitude, i)
            out.weight[k], out.touches[k] = weight_of_node(nodes, i), 1.0 if in_contact else 0.0
        count += N
    out.count, out.begins, out.ends = count, 0.0, 0.0
    if nodes.touches == 1:
        out.begins = 1.0 / abs(rate_at_node(nodes, amplitude, ENTRY))
        out.ends = 1.0 / abs(rate_at_node(nodes, amplitude, EXIT))


@kernel
def nodes_from_collocation(oscillator: Oscillator, orbit: Orbit, nodes: OrbitNodes) -> None:
    """Fill nodes from those of collocation; elements without a force are left out."""
    head = head_of(orbit)
    nodes.count, nodes.begins, nodes.ends = 0, 0.0, 0.0
    for e in range(head.count):
        element, before = element_of(orbit, e), element_of(orbit, e - 1 if e > 0 else head.count - 1).side
        if (element.side == OUT_OF_CONTACT) != (before == OUT_OF_CONTACT):
            rate = 1.0 / abs(element.edge_u - head.amplitude * np.sin(element.edge))
            nodes.begins += rate if before == OUT_OF_CONTACT else 0.0
            nodes.ends += rate if element.side == OUT_OF_CONTACT else 0.0
        if element.side == OUT_OF_CONTACT and not has_longrange(oscillator.p):
            continue
        for j in range(NODES):
            k = nodes.count + j
            nodes.cos[k], nodes.sin[k] = element.cos[j], element.sin[j]
            nodes.depth[k] = head.amplitude * element.cos[j] + element.w[j] - head.tip_offset
            nodes.rate[k] = element.u[j] - head.amplitude * element.sin[j]
            nodes.weight[k] = element.scale * orbit.tables[element.table, T_END1, j]
            nodes.touches[k] = 0.0 if element.side == OUT_OF_CONTACT else 1.0
        nodes.count += NODES


@kernel
def read_nodes(row: np.ndarray, nodes: OrbitNodes) -> None:
    """Fill nodes with those kept behind a row."""
    nodes.count, nodes.begins, nodes.ends = int(row[KEPT_COUNT]), row[KEPT_BEGINS], row[KEPT_ENDS]
    for j in range(nodes.count):
        first = KEPT_NODES + 6 * j
        nodes.cos[j], nodes.sin[j], nodes.depth[j] = row[first], row[first + 1], row[first + 2]
        nodes.rate[j], nodes.weight[j], nodes.touches[j] = row[first + 3], row[first + 4], row[first + 5]


@kernel
def keep_nodes(nodes: OrbitNodes, row: np.ndarray) -> None:
    """Write nodes behind a row, if there is room for all."""
    row[KEPT_COUNT] = 0.0
    if nodes.count > MOST_KEPT_NODES:
        return
    row[KEPT_COUNT], row[KEPT_BEGINS], row[KEPT_ENDS] = nodes.count, nodes.begins, nodes.ends
    for j in range(nodes.count):
        first = KEPT_NODES + 6 * j
        row[first], row[first + 1], row[first + 2] = nodes.cos[j], nodes.sin[j], nodes.depth[j]
        row[first + 3], row[first + 4], row[first + 5] = nodes.rate[j], nodes.weight[j], nodes.touches[j]
