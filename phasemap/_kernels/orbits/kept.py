"""Nodes of an orbit that stand behind its result row, for integrals over it: what has them need not be followed again.

A row that is longer than COLUMNS has room for them. Those of the lever's response are kept, of an orbit that passes
found; other solvers leave none. Where the drive is not faint contacts are long, and these nodes are too few for high
harmonics of what acts in them.
"""

from __future__ import annotations

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.orbits.around import OrbitNodes
from phasemap._kernels.orbits.response import nodes as response
from phasemap._kernels.orbits.response.nodes import ENTRY, EXIT, GAUSS_WEIGHTS, MOST_PARTS, N, Nodes, first_of, parts_of

MOST_KEPT_NODES = 3 * N  # nodes
FAINT_DRIVE = 0.01  # of the amplitude: the largest drive
# Columns of the row: how many nodes there are, |dd/dtheta| [m] where contact begins and ends, and the nodes
KEPT_COUNT, KEPT_BEGINS, KEPT_ENDS, KEPT_NODES = range(col.COLUMNS, col.COLUMNS + 4)
KEEPING = KEPT_NODES + 6 * MOST_KEPT_NODES
KEEPING_PARTS = KEPT_NODES + 6 * (2 + MOST_PARTS) * N  # of a row with room for a contact that is cut in parts


@kernel(fastmath=ANY_ORDER)
def nodes_from_response(
    f: Nodes, amplitude: float, e: float, longrange: bool, at: OrbitNodes
) -> tuple[int, float, float]:
    """Fill nodes from those of the response, those in contact first; returns what `solved.nodes_of` does."""
    touching, parts = f.theta[EXIT] > f.theta[ENTRY], parts_of(f)
    count = 0
    for part in range(parts + 2):
        in_contact = part < parts
        first = first_of(part) if in_contact else response.IN if part == parts else response.OUT
        if not (touching if in_contact else longrange):
            continue
        for j in range(N):
            i, k = first + j, count + j
            at.cos[k], at.sin[k] = f.cos[i], f.sin[i]
            at.depth[k] = amplitude * f.cos[i] + f.w[i] - e
            at.rate[k] = f.u[i] - amplitude * f.sin[i]
            at.weight[k], at.touches[k] = GAUSS_WEIGHTS[j] * f.weight[i], 1.0 if in_contact else 0.0
        count += N
    if not touching:
        return count, 0.0, 0.0
    entry = abs(f.u[ENTRY] - amplitude * f.sin[ENTRY])
    return count, entry, abs(f.u[EXIT] - amplitude * f.sin[EXIT])


@kernel
def read_nodes(row: np.ndarray, at: OrbitNodes) -> tuple[int, float, float]:
    """Fill nodes with those behind a row; returns what `solved.nodes_of` does."""
    for j in range(int(row[KEPT_COUNT])):
        first = KEPT_NODES + 6 * j
        at.cos[j], at.sin[j], at.depth[j] = row[first], row[first + 1], row[first + 2]
        at.rate[j], at.weight[j], at.touches[j] = row[first + 3], row[first + 4], row[first + 5]
    return int(row[KEPT_COUNT]), row[KEPT_BEGINS], row[KEPT_ENDS]


@kernel
def keep_nodes(f: Nodes, amplitude: float, e: float, longrange: bool, at: OrbitNodes, row: np.ndarray) -> None:
    """Put the nodes of the response behind a row."""
    row[KEPT_COUNT], row[KEPT_BEGINS], row[KEPT_ENDS] = nodes_from_response(f, amplitude, e, longrange, at)
    for j in range(int(row[KEPT_COUNT])):
        first = KEPT_NODES + 6 * j
        row[first], row[first + 1], row[first + 2] = at.cos[j], at.sin[j], at.depth[j]
        row[first + 3], row[first + 4], row[first + 5] = at.rate[j], at.weight[j], at.touches[j]
