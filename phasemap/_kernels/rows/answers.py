"""What the loops over rows fill."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Answers(NamedTuple):
    """Rows of n materials, or of each of their orbits: every array may have a first axis more, of length SLOTS.

    Attributes
    ----------
    rows : ndarray, shape (n, COLUMNS)
    status, solver : ndarray of int8, shape (n,)
        Codes of `phasemap._kernels.columns`.
    """

    rows: np.ndarray
    status: np.ndarray
    solver: np.ndarray
