"""Nodes of an orbit that stand behind its result row, for integrals over it: what has them need not be solved again.

A row that is longer than COLUMNS has room for them. Those of passes of the lever's response are kept where the drive is
faint: elsewhere contacts are long, and these nodes are too few for high harmonics of what acts in them.
"""

from __future__ import annotations

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.law import Oscillator
from phasemap._kernels.orbits.around import OrbitNodes
from phasemap._kernels.orbits.collocation.system import OUT_OF_CONTACT, Orbit, element_of, head_of
from phasemap._kernels.orbits.response import nodes as response
from phasemap._kernels.orbits.response.nodes import ENTRY, EXIT, GAUSS_WEIGHTS, N, Nodes, first_of, parts_of
from phasemap._kernels.quadrature import NODES, T_END1

MOST_KEPT_NODES = 40 * NODES  # of most orbits: few have more
FAINT_DRIVE = 0.01  # of the amplitude: the largest drive
# Columns of the row: how many nodes there are, sums of 1/|dd/dtheta| [1/m] where contacts begin and end, the nodes
KEPT_COUNT, KEPT_BEGINS, KEPT_ENDS, KEPT_NODES = range(col.COLUMNS, col.COLUMNS + 4)
# In place of the count, where two drives were marched: what the second mode felt [N/m] stands in the next two columns.
SECOND_IN_TIME, FELT_RE, FELT_IM = -1.0, KEPT_BEGINS, KEPT_ENDS
KEEPING = KEPT_NODES + 6 * MOST_KEPT_NODES


@kernel(fastmath=ANY_ORDER)
def nodes_from_response(nodes: Nodes, amplitude: float, centre: float, longrange: bool, at: OrbitNodes) -> None:
    """Fill nodes from those of passes of the lever's response, those in contact first."""
    touching, parts = nodes.theta[EXIT] > nodes.theta[ENTRY], parts_of(nodes)
    count = 0
    for part in range(parts + 2):
        in_contact = part < parts
        first = first_of(part) if in_contact else response.IN if part == parts else response.OUT
        if not (touching if in_contact else longrange):
            continue
        for j in range(N):
            i, k = first + j, count + j
            at.cos[k], at.sin[k] = nodes.cos[i], nodes.sin[i]
            at.depth[k] = amplitude * nodes.cos[i] + nodes.w[i] - centre
            at.rate[k] = nodes.u[i] - amplitude * nodes.sin[i]
            at.weight[k], at.touches[k] = GAUSS_WEIGHTS[j] * nodes.weight[i], 1.0 if in_contact else 0.0
        count += N
    at.count, at.begins, at.ends = count, 0.0, 0.0
    if touching:
        at.begins = 1.0 / abs(nodes.u[ENTRY] - amplitude * nodes.sin[ENTRY])
        at.ends = 1.0 / abs(nodes.u[EXIT] - amplitude * nodes.sin[EXIT])


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
        if one.side == OUT_OF_CONTACT and oscillator.p[col.LONGRANGE] == 0.0:
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
