"""Forces before contact, called with d <= 0 only (d = minus the gap)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from phasemap._kernels.columns import BIAS, INVERSE_REACH, LONGRANGE
from phasemap._kernels.forces import inverse_square, inverse_square_slope

if TYPE_CHECKING:
    import numpy as np

VACUUM_PERMITTIVITY = 8.8541878188e-12  # [F/m], CODATA 2022
CLOSEST = 0.3e-9  # gap at contact [m] of the electrostatic force where there is no decay length
BIASED, CURVATURE = 6, 7  # columns of the electrostatic force


class InverseSquare:
    """F = -f0 / (1 - d/d0)^2 (Wang 1999, Eq. 3): van der Waals attraction of a sphere and a plane.

    With f0 = H R / (6 a0^2) and a0 = d0 it is the Hamaker form with the gap measured from a0: theory, Eq. (model-12).
    """

    name = "inverse square"

    @staticmethod
    def columns(pull: np.ndarray, decay_length: float) -> tuple[np.ndarray | float, ...]:
        """p[LONGRANGE] = f0 [N], p[INVERSE_REACH] = 1/d0 [1/m]."""
        return pull, 1 / decay_length

    force = staticmethod(inverse_square)
    slope = staticmethod(inverse_square_slope)


class Inverse:
    """F = -f0 / (1 - d/d0): the van der Waals attraction of a cone and a plane, whose gap is measured from d0.

    See theory, Eq. (model-20).
    """

    name = "inverse"

    @staticmethod
    def force(d: float, p: np.ndarray) -> float:
        return -p[LONGRANGE] / (1.0 - d * p[INVERSE_REACH])

    @staticmethod
    def slope(d: float, p: np.ndarray) -> float:
        s = 1.0 - d * p[INVERSE_REACH]
        return -p[LONGRANGE] * p[INVERSE_REACH] / (s * s)


class Biased:
    """`InverseSquare` and F = -pi eps0 V^2 R^2 / (g (g + R)), the force of a voltage between sphere and plane.

    The second is Hudlet et al. 1998, Eur. Phys. J. B 2, 5, Eq. 15 without the cone. See theory, Eq. (model-14). The gap
    g = d0 - d is cut off in contact, where the force stays what it is at d = 0 (p[BIAS], which `phasemap._kernels.law`
    takes off the contact's).
    """

    name = "inverse square and electrostatic"

    @staticmethod
    def columns(
        pull: np.ndarray, decay_length: float | None, bias: float, radius: float
    ) -> tuple[np.ndarray | float, ...]:
        """p[LONGRANGE] = whole attraction at d = 0 [N], p[INVERSE_REACH] = 1/d0 [1/m].

        And p[BIASED] = pi eps0 V^2 [N], p[CURVATURE] = 1/R [1/m].
        """
        at_contact = Biased.at_contact(decay_length, bias, radius)
        own = pull if decay_length is not None else 0.0 * pull
        return own + at_contact, 1 / (decay_length or CLOSEST), math.pi * VACUUM_PERMITTIVITY * bias**2, 1 / radius

    @staticmethod
    def at_contact(decay_length: float | None, bias: float, radius: float) -> float:
        """Electrostatic attraction in contact [N]."""
        x = (decay_length or CLOSEST) / radius
        return math.pi * VACUUM_PERMITTIVITY * bias**2 / (x * (1 + x))

    @staticmethod
    def force(d: float, p: np.ndarray) -> float:
        s = 1.0 - d * p[INVERSE_REACH]
        x = (1.0 / p[INVERSE_REACH] - d) * p[CURVATURE]
        return -(p[LONGRANGE] - p[BIAS]) / (s * s) - p[BIASED] / (x * (1.0 + x))

    @staticmethod
    def slope(d: float, p: np.ndarray) -> float:
        s = 1.0 - d * p[INVERSE_REACH]
        x = (1.0 / p[INVERSE_REACH] - d) * p[CURVATURE]
        y = x * (1.0 + x)
        electric = p[BIASED] * p[CURVATURE] * (1.0 + 2.0 * x) / (y * y)
        return -2.0 * (p[LONGRANGE] - p[BIAS]) * p[INVERSE_REACH] / (s * s * s) - electric
