"""What solvers and the loops over rows fill."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Answers(NamedTuple):
    """Rows of n materials, or of each of their orbits: every array may have a first axis more, of length SLOTS."""

    rows: np.ndarray  # shape (n, COLUMNS), or (n, KEEPING) with room for nodes (`phasemap._kernels.orbits.kept`)
    # status, solver: int8, shape (n,); codes of `phasemap._kernels.columns`
    status: np.ndarray
    solver: np.ndarray

    def of(self, chosen: np.ndarray | int) -> Answers:
        """Those of some materials, an array of numbers; or of one slot."""
        return Answers(self.rows[chosen], self.status[chosen], self.solver[chosen])

    def put(self, chosen: np.ndarray, some: Answers) -> None:
        """Take in the answers for some materials."""
        self.rows[chosen], self.status[chosen], self.solver[chosen] = some
