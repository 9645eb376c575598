"""Places of a material's orbits that hold the setpoint."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Orbits(NamedTuple):
    """What holds the setpoint on n materials.

    Attributes
    ----------
    stable : ndarray of bool, shape (2, n)
        Whether a material has an orbit that holds the setpoint, on each branch.
    engaged : ndarray of int, shape (n,)
        Branch to which engagement from far leads, or NOWHERE.
    offsets : ndarray, shape (3, n)
        Tip offsets of the orbits [m].
    reach : ndarray, shape (2, n)
        Highest tip offset [m] from which a tip comes to each of the two; infinite where it does from any.
    """

    stable: np.ndarray
    engaged: np.ndarray
    offsets: np.ndarray
    reach: np.ndarray
