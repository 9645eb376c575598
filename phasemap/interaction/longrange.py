"""Forces before contact, called with d <= 0 only (d = minus the gap)."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np


class InverseSquare:
    """F = -f0 / (1 - d/d0)^2 (Wang 1999, Eq. 3): van der Waals attraction of a sphere and a plane.

    With f0 = H R / (6 a0^2) and a0 = d0 it is the Hamaker form with the gap measured from a0.
    """

    name = "inverse square"

    @staticmethod
    def columns(pull: np.ndarray, decay_length: float) -> tuple[np.ndarray | float, ...]:
        """p[4] = f0 [N], p[5] = 1/d0 [1/m]."""
        return pull, 1 / decay_length

    @staticmethod
    def force(d: float, p: np.ndarray) -> float:
        s = 1.0 - d * p[5]
        return -p[4] / (s * s)

    @staticmethod
    def slope(d: float, p: np.ndarray) -> float:
        s = 1.0 - d * p[5]
        return -2.0 * p[4] * p[5] / (s * s * s)
