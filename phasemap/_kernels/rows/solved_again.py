"""Orbits of a lever of several modes solved once more: a row does not tell how each mode moves."""

from __future__ import annotations

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.resonance import (
    ATTRACTIVE,
    REPULSIVE,
    decide,
    fill_averaged_orbit_on_side,
    find_mismatch_maximum,
)
from phasemap._kernels.law import Law, Oscillator, parameters
from phasemap._kernels.lever import reach_of
from phasemap._kernels.orbits.around import OrbitNodes, moves
from phasemap._kernels.orbits.kept import KEPT_COUNT, keep_nodes
from phasemap._kernels.orbits.response.newton import new_bench
from phasemap._kernels.orbits.response.nodes import MOST_PARTS, Nodes, parts_of
from phasemap._kernels.orbits.response.orbit import Room, nodes_of_solution, refine, refine_stiff
from phasemap._kernels.orbits.response.passes import PassState
from phasemap._kernels.orbits.response.softened import Before

ALIKE = 1e-3  # of the amplitude, by which the tip offset of the same orbit may differ


@kernel
def keep_rows_again(law: Law, rows: np.ndarray, lever: np.ndarray, out: np.ndarray, kept: np.ndarray) -> None:
    """Fill `kept` with the nodes of rows of the tip that have a periodic orbit; a count of 0 where none is as near.

    `kept` (shape (n, KEEPING_PARTS)): see `phasemap._kernels.orbits.kept`.
    """
    nodes, finer, at, guess, limits = Nodes(), Nodes(), OrbitNodes(), np.zeros(col.GUESS), np.array([1e-5, 1e-12])
    nodes.parts = finer.parts = MOST_PARTS
    room, before = Room(), Before()
    short, long = new_bench(nodes, PassState()), new_bench(finer, PassState())
    for i in range(len(rows)):
        row, p = out[i], parameters(rows[i])
        kept[i, KEPT_COUNT] = 0.0
        if not moves(row) or p[col.RELEASE] != 0.0:
            continue
        oscillator, reach, amplitude = Oscillator(law, p, lever), reach_of(law, p), row[col.AMPLITUDE]
        side, longrange = REPULSIVE if row[col.STIFFENING] > 0.0 else ATTRACTIVE, p[col.LONGRANGE] != 0.0
        if longrange:
            find_mismatch_maximum(oscillator, reach, amplitude, 0.0 if side == ATTRACTIVE else np.inf, room.top)
        else:
            decide(oscillator, reach, amplitude, 1.0, room.top)
        if not fill_averaged_orbit_on_side(oscillator, reach, amplitude, side, room.top, guess):
            continue
        near = ALIKE * amplitude
        if refine(oscillator, reach, guess, limits, room) and abs(room.state.tip_offset - row[col.TIP_OFFSET]) < near:
            keep_nodes(nodes_of_solution(room), amplitude, room.state.centre, longrange, at, kept[i])
            continue
        parts = refine_stiff(oscillator, guess, limits, short, long, before)
        bench = short if parts == parts_of(short.nodes) else long
        if parts > 0 and abs(bench.state.tip_offset - row[col.TIP_OFFSET]) < near:
            keep_nodes(bench.nodes, amplitude, bench.state.centre, longrange, at, kept[i])
