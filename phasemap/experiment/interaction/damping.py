"""Dissipation in contact, as the damping coefficient that adds to the lever's own; called with d >= 0 only."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np


class PowerLawDamping:
    """alpha_s = alpha1 (d/R)^n (Wang 1999, Eq. 4).

    n = 1/2 is Kelvin-Voigt Hertz contact, F = -eta sqrt(R d) d', with eta = 2 alpha1 k / (R omega_c): theory,
    Eqs. (model-15) and (model-16).
    """

    name = "power law"

    @staticmethod
    def columns(damping: np.ndarray, radius: float, exponent: float) -> tuple[np.ndarray | float, ...]:
        """p[8] = alpha1 / R^n [m^-n], p[9] = n [1]."""
        return damping / radius**exponent, exponent

    @staticmethod
    def damping(d: float, p: np.ndarray) -> float:
        if p[9] == 0.5:
            return p[8] * math.sqrt(d)
        return p[8] * d ** p[9]

    @staticmethod
    def slope(d: float, p: np.ndarray) -> float:
        if d <= 0.0 or p[9] == 0.0:
            return 0.0
        if p[9] == 0.5:
            return 0.5 * p[8] / math.sqrt(d)
        return p[9] * p[8] * d ** (p[9] - 1.0)
