"""Dissipation in contact, as the damping coefficient that adds to the lever's own; called with d >= 0 only."""

from __future__ import annotations

from typing import TYPE_CHECKING

from phasemap._kernels.forces import power_law, power_law_slope

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
        """p[DAMPING] = alpha1 / R^n [m^-n], p[EXPONENT] = n [1]."""
        return damping / radius**exponent, exponent

    damping = staticmethod(power_law)
    slope = staticmethod(power_law_slope)
