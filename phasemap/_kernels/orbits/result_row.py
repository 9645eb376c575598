"""Properties of an orbit by its result row."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel

SAME_ORBIT = 1e-4  # of the amplitude, and radians: nearer than this it is the same orbit


@kernel
def feedback_status(row: np.ndarray) -> int:
    """Status of an orbit under feedback: GOOD if it is stable and its tip offset rises with the amplitude."""
    if not row[col.FLOQUET] < 1.0:
        return col.UNSTABLE
    return col.GOOD if row[col.SLOPE] > 0.0 else col.NO_STABLE_ORBIT


@kernel
def same_orbit(first: np.ndarray, second: np.ndarray) -> bool:
    """True if two result rows are of the same orbit."""
    apart = abs(first[col.TIP_OFFSET] - second[col.TIP_OFFSET]) / first[col.AMPLITUDE]
    return max(apart, abs(first[col.PHASE] - second[col.PHASE])) < SAME_ORBIT


@kernel
def has_periodic_orbit(row: np.ndarray) -> bool:
    """True if a result row has a periodic orbit."""
    return math.isfinite(row[col.INDENTATION]) and row[col.AMPLITUDE] > 0.0 and not row[col.SPREAD_AMPLITUDE] > 0.0
