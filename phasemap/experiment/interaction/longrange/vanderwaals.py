"""The van der Waals forces of a sphere and of a cone."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from phasemap._kernels.columns import INVERSE_REACH, LONGRANGE
from phasemap._kernels.forces import inverse_square, inverse_square_slope
from phasemap.experiment.interaction.longrange.base import LongRange

if TYPE_CHECKING:
    import numpy as np


class InverseSquare(LongRange):
    """F = -f0 / (1 - d/d0)^2 (Wang 1999, Eq. 3): van der Waals attraction of a sphere and a plane.

    With f0 = H R / (6 a0^2) and a0 = d0 it is the Hamaker form with the gap measured from a0: theory, Eq. (model-12).
    """

    name: ClassVar[str] = "inverse square"
    attracts: ClassVar[bool] = True

    def columns(self, pull: np.ndarray, decay_length: float | None, radius: float) -> tuple[np.ndarray | float, ...]:
        """p[LONGRANGE] = f0 [N], p[INVERSE_REACH] = 1/d0 [1/m]."""
        return () if decay_length is None else (pull, 1 / decay_length)

    force = staticmethod(inverse_square)
    slope = staticmethod(inverse_square_slope)


class Inverse(InverseSquare):
    """F = -f0 / (1 - d/d0): the van der Waals attraction of a cone and a plane, whose gap is measured from d0.

    See theory, Eq. (model-20).
    """

    name: ClassVar[str] = "inverse"

    @staticmethod
    def force(d: float, p: np.ndarray) -> float:
        return -p[LONGRANGE] / (1.0 - d * p[INVERSE_REACH])

    @staticmethod
    def slope(d: float, p: np.ndarray) -> float:
        s = 1.0 - d * p[INVERSE_REACH]
        return -p[LONGRANGE] * p[INVERSE_REACH] / (s * s)
