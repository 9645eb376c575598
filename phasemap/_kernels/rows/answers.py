"""Arguments of the loops over rows, and the rows that they fill."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, Oscillator, parameters


class Pixels(NamedTuple):
    """n materials under a lever, and the amplitude that is held on each."""

    law: Law
    rows: np.ndarray  # shape (n, ROW)
    lever: np.ndarray
    amplitudes: np.ndarray  # shape (n,); of the tip, or as the detector sees it [m]


@kernel(light=True)
def oscillator_of(pixels: Pixels, i: int) -> Oscillator:
    """The lever over material i."""
    return Oscillator(pixels.law, parameters(pixels.rows[i]), pixels.lever)


class Answers(NamedTuple):
    """Rows of n materials, or of each of their orbits: every array may have a first axis more, of length SLOTS."""

    rows: np.ndarray  # shape (n, COLUMNS), or (n, KEEPING) with room for nodes (`phasemap._kernels.orbits.orbit_nodes`)
    # status, solver: int8, shape (n,); codes of `phasemap._kernels.columns`
    status: np.ndarray
    solver: np.ndarray

    def of(self, chosen: np.ndarray | int) -> Answers:
        """Answers for some materials, an array of numbers; or of one slot."""
        return Answers(self.rows[chosen], self.status[chosen], self.solver[chosen])

    def put(self, chosen: np.ndarray, others: Answers) -> None:
        """Take in the answers for some materials."""
        self.rows[chosen], self.status[chosen], self.solver[chosen] = others
