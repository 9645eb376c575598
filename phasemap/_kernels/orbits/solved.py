"""Nodes along an orbit that is solved, for integrals over it: of whichever kind is cheapest where it holds."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever import modes_of
from phasemap._kernels.orbits.around import OrbitNodes, harmonic
from phasemap._kernels.orbits.kept import nodes_from_response
from phasemap._kernels.orbits.response.nodes import Nodes
from phasemap._kernels.orbits.response.passes import PassState
from phasemap._kernels.orbits.response.retraced import retrace
from phasemap._kernels.orbits.tap import tap


class Path(NamedTuple):
    """Room for the nodes of an orbit, and for those of the lever's response."""

    at: OrbitNodes
    nodes: Nodes
    state: PassState


@kernel
def new_path(at: OrbitNodes, nodes: Nodes, state: PassState) -> Path:
    """Room for an orbit, with these nodes and this state for passes of the response."""
    return Path(at, nodes, state)


@kernel
def nodes_of(
    oscillator: Oscillator, row: np.ndarray, averaged: bool, whole: bool, at: OrbitNodes
) -> tuple[int, float, float]:
    """Fill the nodes of a result row of the tip, of an orbit that may be `averaged` only.

    If not `whole`, depths and rates in contact are what is wanted.

    Returns how many there are, none where it taps twice in a period, and |dd/dtheta| [m] where contact begins and ends,
    0 where it does not. An orbit that is averaged is harmonic; of a lever of several modes no other one can be followed
    from its row (`rows.solved_again`).
    """
    law, p = oscillator.law, oscillator.p
    count, entry, release = 0, 0.0, 0.0
    if modes_of(oscillator.lever) > 1 and not averaged:
        return 0, 0.0, 0.0
    if not averaged:
        count = tap(oscillator, row, whole, at)
        for j in range(count - 1):
            if at.touches[j] > at.touches[j + 1]:
                entry, release = release, abs(at.rate[j])  # the way in is first
        return count, entry, release
    amplitude, depth = row[col.AMPLITUDE], row[col.INDENTATION]
    c, last = 1.0 - depth / amplitude, 1.0 - (depth - p[col.RELEASE]) / amplitude
    if c < 1.0 and last > -1.0:
        entry, release = amplitude * math.sqrt(1.0 - c * c), amplitude * math.sqrt(1.0 - last * last)
    return harmonic(law, p, amplitude, depth, whole, at), entry, release


@kernel
def all_nodes_of(oscillator: Oscillator, row: np.ndarray, averaged: bool, path: Path) -> tuple[int, float, float]:
    """The same of a whole period, by the lever's response where that will do, which takes half as long."""
    p = oscillator.p
    several = modes_of(oscillator.lever) > 1
    if averaged or several or p[col.RELEASE] < 0.0 or not retrace(oscillator, row, path.nodes, path.state):
        return nodes_of(oscillator, row, averaged, True, path.at)
    e = row[col.TIP_OFFSET] - row[col.MEAN]
    return nodes_from_response(path.nodes, row[col.AMPLITUDE], e, p[col.LONGRANGE] != 0.0, path.at)
