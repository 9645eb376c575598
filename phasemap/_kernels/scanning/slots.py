"""Stable orbits at the setpoint, for scans that keep a branch from pixel to pixel."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

UNKNOWN_ORBIT = -1  # whether a material has an orbit: neither 0 nor 1


class Orbits(NamedTuple):
    """Stable orbits that hold the setpoint, on each branch, for n materials."""

    # int, shape (2, n); whether a material has an orbit that holds the setpoint on each branch: 1, 0 or UNKNOWN_ORBIT
    stable: np.ndarray
    engaged: np.ndarray  # int, shape (n,); branch to which engagement from far leads, or NOWHERE
    offsets: np.ndarray  # shape (3, n); tip offsets of the orbits [m]
    # shape (2, n); highest tip offset [m] from which a tip comes to each of the two; infinite where it does from
    # any
    reach: np.ndarray
