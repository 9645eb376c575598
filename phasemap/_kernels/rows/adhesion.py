"""Rows that are solved: virial and loss of the attraction along their orbits, and energy that the contact stores."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, Oscillator, contact_force, contact_slope, longrange_force, parameters
from phasemap._kernels.orbits.around import (
    HARMONIC_WEIGHTS,
    HARMONIC_X,
    OrbitNodes,
    moves,
)
from phasemap._kernels.orbits.response.orbit import Room
from phasemap._kernels.rows.along_orbit import nodes_of, room_again
from phasemap._kernels.wide import ADHESION_LOSS, ADHESION_VIRIAL, STORAGE, SolvedRows


@kernel
def _neck_energy(law: Law, p: np.ndarray) -> float:
    """Energy [J] that it takes to draw out a neck to its release; 0 without a neck."""
    taken = 0.0
    for i in range(len(HARMONIC_X)):
        d = p[col.RELEASE] * (1.0 - HARMONIC_X[i] * HARMONIC_X[i])
        pull = longrange_force(law, d, p) - contact_force(law, d, p)
        taken -= HARMONIC_WEIGHTS[i] * 2.0 * p[col.RELEASE] * HARMONIC_X[i] * pull
    return taken


@kernel
def adhesion_rows(
    law: Law, rows: np.ndarray, bare: np.ndarray, lever: np.ndarray, tables: np.ndarray, solved: SolvedRows
) -> None:
    """Fill in ADHESION_VIRIAL, ADHESION_LOSS and STORAGE of rows that have a periodic orbit.

    `bare` are the rows of the same contacts without adhesion and bias.
    """
    out, averaged, kept = solved
    at = OrbitNodes()
    again = room_again(lever, at, Room())
    for i in range(len(rows)):
        oscillator, row = Oscillator(law, parameters(rows[i]), lever), out[i]
        if not moves(row) or not nodes_of(
            oscillator, tables, row, averaged[i], kept[i if kept.shape[1] > 0 else 0], again
        ):
            continue
        p, without = oscillator.p, parameters(bare[i])
        virial, storage = 0.0, 0.0
        for j in range(at.count):
            d, weight = at.depth[j], at.weight[j]
            if d > 0.0:
                storage += weight * contact_slope(law, d, without) * at.rate[j] ** 2
            if at.touches[j] == 0.0:
                f = longrange_force(law, min(d, 0.0), p)
            else:
                f = contact_force(law, d, p)
                if d > 0.0:
                    f -= contact_force(law, d, without)
            virial -= weight * f * at.cos[j]
        row[ADHESION_VIRIAL] = row[col.AMPLITUDE] * virial / (2.0 * math.pi)
        row[ADHESION_LOSS] = _neck_energy(law, p) if at.ends > 0.0 else 0.0
        row[STORAGE] = storage / (2.0 * math.pi)
