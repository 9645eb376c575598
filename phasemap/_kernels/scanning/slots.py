"""Places of a material's orbits that hold the setpoint."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

UNKNOWN = -1  # whether there is an orbit: neither 0 nor 1


class Orbits(NamedTuple):
    """What holds the setpoint on n materials."""

    # int, shape (2, n); 1 or 0: whether a material has an orbit that holds the setpoint, on each branch; or UNKNOWN
    stable: np.ndarray
    engaged: np.ndarray  # int, shape (n,); branch to which engagement from far leads, or NOWHERE
    offsets: np.ndarray  # shape (3, n); tip offsets of the orbits [m]
    # shape (2, n); highest tip offset [m] from which a tip comes to each of the two; infinite where it does from
    # any
    reach: np.ndarray
