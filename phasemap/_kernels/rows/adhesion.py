"""Loop over rows that are solved: what the attraction between tip and surface does along their orbits."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, contact_force, longrange_force, parameters
from phasemap._kernels.orbits.around import COS, DEPTH, MOST, RATE, ROWS, TOUCHES, WEIGHT, harmonic, moves
from phasemap._kernels.wide import ADHESION_LOSS, ADHESION_VIRIAL


@kernel
def adhesion_rows(law: Law, rows: np.ndarray, bare: np.ndarray, out: np.ndarray) -> None:
    """Fill in ADHESION_VIRIAL and ADHESION_LOSS of wide rows of the tip, shape (n, WIDE), that have a periodic orbit.

    `bare` are the rows of the same contacts without adhesion and bias.
    """
    at = np.zeros((ROWS, MOST))
    for i in range(len(rows)):
        row = out[i]
        if not moves(row):
            continue
        p, without = parameters(rows[i]), parameters(bare[i])
        virial, loss = 0.0, 0.0
        for j in range(harmonic(law, p, row[col.AMPLITUDE], row[col.INDENTATION], at)):
            d = at[DEPTH, j]
            if at[TOUCHES, j] == 0.0:
                f = longrange_force(law, min(d, 0.0), p)
            else:
                f = contact_force(law, d, p) - (contact_force(law, d, without) if d > 0.0 else 0.0)
            virial -= at[WEIGHT, j] * f * at[COS, j]
            loss += at[WEIGHT, j] * f * at[RATE, j]
        row[ADHESION_VIRIAL] = row[col.AMPLITUDE] * virial / (2.0 * math.pi)
        row[ADHESION_LOSS] = loss if p[col.RELEASE] < 0.0 else 0.0
