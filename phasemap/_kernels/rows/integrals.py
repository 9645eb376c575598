"""Loops over rows that are solved, for integrals over their orbits."""

from __future__ import annotations

import numpy as np

from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.orbit_of_row import Again, nodes_of, room_again
from phasemap._kernels.law import Oscillator, parameters
from phasemap._kernels.orbits.around import OrbitNodes, moves
from phasemap._kernels.orbits.integrals import fill_adhesion_integrals, fill_force_integrals, room_for_loads
from phasemap._kernels.orbits.kept import FELT_IM, FELT_RE, KEPT_COUNT, SECOND_IN_TIME
from phasemap._kernels.orbits.response.orbit import Room
from phasemap._kernels.rows.answers import Pixels, oscillator_of
from phasemap._kernels.wide import DRAG, GRADIENT, SIDEBANDS, SolvedRows


@kernel
def _finds_nodes(oscillator: Oscillator, solved: SolvedRows, i: int, again: Again) -> bool:
    """Fill the nodes of row i; False where it has no periodic orbit, or that is not found again."""
    row, kept = solved.rows[i], solved.kept
    return moves(row) and nodes_of(oscillator, row, solved.averaged[i], kept[i if kept.shape[1] > 0 else 0], again)


@kernel
def force_rows(pixels: Pixels, tables: np.ndarray, second: int, solved: SolvedRows, harmonics: int) -> None:
    """Fill in what `fill_force_integrals` does for so many harmonics of the force, in rows that have an orbit."""
    at, room = OrbitNodes(), room_for_loads(harmonics)
    again = room_again(pixels.lever, tables, at, Room())
    for i in range(len(solved.rows)):
        oscillator = oscillator_of(pixels, i)
        if solved.kept.shape[1] > 0 and solved.kept[i, KEPT_COUNT] == SECOND_IN_TIME:
            row, kept = solved.rows[i], solved.kept[i]
            row[GRADIENT], row[DRAG], row[SIDEBANDS], row[SIDEBANDS + 1] = kept[FELT_RE], 0.0, 0.0, -kept[FELT_IM]
        elif _finds_nodes(oscillator, solved, i, again):
            fill_force_integrals(oscillator, at, second, room, solved.rows[i])


@kernel
def adhesion_rows(pixels: Pixels, tables: np.ndarray, bare: np.ndarray, solved: SolvedRows) -> None:
    """Fill in what `fill_adhesion_integrals` does, in rows that have an orbit.

    `bare` are the rows of the same contacts without adhesion and bias.
    """
    at = OrbitNodes()
    again = room_again(pixels.lever, tables, at, Room())
    for i in range(len(solved.rows)):
        oscillator = oscillator_of(pixels, i)
        if _finds_nodes(oscillator, solved, i, again):
            fill_adhesion_integrals(oscillator, parameters(bare[i]), at, solved.rows[i])
