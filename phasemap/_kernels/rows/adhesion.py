"""Loop over rows that are solved: what the attraction between tip and surface does along their orbits."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, contact_force, contact_slope, longrange_force, parameters
from phasemap._kernels.orbits.around import COS, DEPTH, RATE, ROWS, TOUCHES, WEIGHT, moves
from phasemap._kernels.orbits.tap import MOST, nodes_of
from phasemap._kernels.wide import ADHESION_LOSS, ADHESION_VIRIAL, STORAGE


@kernel
def adhesion_rows(
    law: Law, rows: np.ndarray, bare: np.ndarray, lever: np.ndarray, averaged: np.ndarray, out: np.ndarray
) -> None:
    """Fill in ADHESION_VIRIAL, ADHESION_LOSS and STORAGE of wide rows of the tip, shape (n, WIDE), of periodic orbits.

    `bare` are the rows of the same contacts without adhesion and bias. Rows that are `averaged` have the harmonic orbit
    only.
    """
    at = np.zeros((ROWS, MOST))
    for i in range(len(rows)):
        row = out[i]
        if not moves(row):
            continue
        p, without = parameters(rows[i]), parameters(bare[i])
        virial, loss, storage = 0.0, 0.0, 0.0
        count, _, _ = nodes_of(law, p, lever, row, averaged[i], at)
        if count == 0:
            continue
        for j in range(count):
            d, weight = at[DEPTH, j], at[WEIGHT, j]
            if at[TOUCHES, j] == 0.0:
                f = longrange_force(law, min(d, 0.0), p)
            else:
                f = contact_force(law, d, p)
                if d > 0.0:
                    f -= contact_force(law, d, without)
                    storage += weight * contact_slope(law, d, without) * at[RATE, j] ** 2
            virial -= weight * f * at[COS, j]
            loss += weight * f * at[RATE, j]
        loss = loss if p[col.RELEASE] < 0.0 else 0.0
        row[ADHESION_VIRIAL] = row[col.AMPLITUDE] * virial / (2.0 * math.pi)
        row[ADHESION_LOSS] = loss
        row[STORAGE] = storage / (2.0 * math.pi)
