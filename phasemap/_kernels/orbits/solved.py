"""Nodes along an orbit that is solved, for integrals over it: of whichever kind is cheapest where it holds."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.law import Law
from phasemap._kernels.orbits.around import COS, DEPTH, RATE, ROWS, SIN, TOUCHES, WEIGHT, harmonic
from phasemap._kernels.orbits.response import nodes as response
from phasemap._kernels.orbits.response.nodes import ALL, ENTRY, EXIT, FIELDS, THETA, TOUCH, WEIGHTS, N
from phasemap._kernels.orbits.response.passes import STATE
from phasemap._kernels.orbits.response.retraced import retrace
from phasemap._kernels.orbits.tap import MOST, tap


class Path(NamedTuple):
    """Room for the nodes of an orbit, and for those of the lever's response."""

    at: np.ndarray  # shape (ROWS, MOST)
    nodes: np.ndarray
    state: np.ndarray


@kernel
def new_path() -> Path:
    """Return empty arrays."""
    return Path(np.zeros((ROWS, MOST)), np.zeros((FIELDS, ALL)), np.zeros(STATE))


@kernel(fastmath=ANY_ORDER)
def _carried(f: np.ndarray, amplitude: float, e: float, longrange: bool, at: np.ndarray) -> tuple[int, float, float]:
    """Fill nodes from those of the response, those in contact first; returns what `nodes_of` does."""
    touching = f[THETA, EXIT] > f[THETA, ENTRY]
    count = 0
    for part in range(3):
        first = TOUCH if part == 0 else response.IN if part == 1 else response.OUT
        if not (touching if part == 0 else longrange):
            continue
        for j in range(N):
            i, k = first + j, count + j
            at[COS, k], at[SIN, k] = f[response.COS, i], f[response.SIN, i]
            at[DEPTH, k] = amplitude * f[response.COS, i] + f[response.W, i] - e
            at[RATE, k] = f[response.U, i] - amplitude * f[response.SIN, i]
            at[WEIGHT, k], at[TOUCHES, k] = WEIGHTS[j] * f[response.WEIGHT, i], 1.0 if part == 0 else 0.0
        count += N
    if not touching:
        return count, 0.0, 0.0
    entry = abs(f[response.U, ENTRY] - amplitude * f[response.SIN, ENTRY])
    return count, entry, abs(f[response.U, EXIT] - amplitude * f[response.SIN, EXIT])


@kernel
def nodes_of(
    law: Law, p: np.ndarray, lever: np.ndarray, row: np.ndarray, averaged: bool, whole: bool, at: np.ndarray
) -> tuple[int, float, float]:
    """Fill the nodes of a result row of the tip, shape (ROWS, MOST), of an orbit that may be `averaged` only.

    If not `whole`, depths and rates in contact are what is wanted.

    Returns how many there are, none where it taps twice in a period, and |dd/dtheta| [m] where contact begins and ends,
    0 where it does not. An orbit that is averaged is harmonic.
    """
    count, entry, release = 0, 0.0, 0.0
    if not averaged:
        count = tap(law, p, lever, row, whole, at)
        for j in range(count - 1):
            if at[TOUCHES, j] > at[TOUCHES, j + 1]:
                entry, release = release, abs(at[RATE, j])  # the way in is first
        return count, entry, release
    amplitude, depth = row[col.AMPLITUDE], row[col.INDENTATION]
    c, last = 1.0 - depth / amplitude, 1.0 - (depth - p[col.RELEASE]) / amplitude
    if c < 1.0 and last > -1.0:
        entry, release = amplitude * math.sqrt(1.0 - c * c), amplitude * math.sqrt(1.0 - last * last)
    return harmonic(law, p, amplitude, depth, whole, at), entry, release


@kernel
def all_nodes_of(
    law: Law, p: np.ndarray, lever: np.ndarray, row: np.ndarray, averaged: bool, path: Path
) -> tuple[int, float, float]:
    """The same of a whole period, by the lever's response where that will do, which takes half as long."""
    if averaged or p[col.RELEASE] < 0.0 or not retrace(law, p, lever, row, path.nodes, path.state):
        return nodes_of(law, p, lever, row, averaged, True, path.at)
    e = row[col.TIP_OFFSET] - row[col.MEAN]
    return _carried(path.nodes, row[col.AMPLITUDE], e, p[col.LONGRANGE] != 0.0, path.at)
