"""The force of a voltage between tip and surface."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from phasemap._kernels.columns import INVERSE_REACH
from phasemap.experiment.interaction.longrange.base import CLOSEST, LongRange, vanderwaals, vanderwaals_slope, whole

if TYPE_CHECKING:
    import numpy as np

VACUUM_PERMITTIVITY = 8.8541878188e-12  # [F/m], CODATA 2022
BIASED, CURVATURE = 6, 7  # columns: pi eps0 V^2 [N], 1/R [1/m]


@dataclass(frozen=True)
class Biased(LongRange):
    """`InverseSquare` and F = -pi eps0 V^2 R^2 / (g (g + R)), the force of a voltage between sphere and plane.

    The second is Hudlet et al. 1998, Eur. Phys. J. B 2, 5, Eq. 15 without the cone. See theory, Eq. (model-14). The gap
    g = d0 - d is cut off in contact, where the force stays what it is at d = 0.
    """

    bias: float  # V [V]
    name: ClassVar[str] = "inverse square and electrostatic"
    attracts: ClassVar[bool] = True

    def columns(self, pull: np.ndarray, decay_length: float | None, radius: float) -> tuple[np.ndarray | float, ...]:
        """p[BIASED] = pi eps0 V^2 [N], p[CURVATURE] = 1/R [1/m]."""
        at_contact = self.in_contact(decay_length, radius)
        strength = math.pi * VACUUM_PERMITTIVITY * self.bias**2
        return whole(pull, decay_length, at_contact, at_contact), 1 / (decay_length or CLOSEST), strength, 1 / radius

    def in_contact(self, decay_length: float | None, radius: float) -> float:
        x = (decay_length or CLOSEST) / radius
        return math.pi * VACUUM_PERMITTIVITY * self.bias**2 / (x * (1 + x))

    @staticmethod
    def force(d: float, p: np.ndarray) -> float:
        x = (1.0 / p[INVERSE_REACH] - d) * p[CURVATURE]
        return vanderwaals(d, p) - p[BIASED] / (x * (1.0 + x))

    @staticmethod
    def slope(d: float, p: np.ndarray) -> float:
        x = (1.0 / p[INVERSE_REACH] - d) * p[CURVATURE]
        y = x * (1.0 + x)
        return vanderwaals_slope(d, p) - p[BIASED] * p[CURVATURE] * (1.0 + 2.0 * x) / (y * y)
