"""The force of a sphere and a plane whose atoms attract and repel as Lennard and Jones have it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from phasemap._kernels.columns import INVERSE_REACH, LONGRANGE
from phasemap.experiment.interaction.longrange.vanderwaals import InverseSquare

if TYPE_CHECKING:
    import numpy as np


@dataclass(frozen=True)
class LennardJones(InverseSquare):
    """F = -(4/3) f0 (s^-2 - s^-8/4), s = 1 - d/d0: the pressure H (z0^6/z^6 - 1)/(6 pi z^3) of two planes on a sphere.

    Attard and Parker, Phys. Rev. A 46, 7959 (1992), integrated by Derjaguin: theory, Eq. (longrange-4). Contact is at
    the largest attraction, the gap z0 = d0, where the slope is 0 as that of DMT contact: with it the force and its
    slope are continuous. f0 = H R/(8 z0^2) = 2 pi w R, for w = H/(16 pi z0^2) is the work of adhesion of the planes.
    """

    name: ClassVar[str] = "lennard-jones"

    @staticmethod
    def force(d: float, p: np.ndarray) -> float:
        x = 1.0 - d * p[INVERSE_REACH]
        x = 1.0 / (x * x)
        return -p[LONGRANGE] * x * (4.0 - x * x * x) / 3.0

    @staticmethod
    def slope(d: float, p: np.ndarray) -> float:
        s = 1.0 / (1.0 - d * p[INVERSE_REACH])
        x = s * s
        return -8.0 / 3.0 * p[LONGRANGE] * p[INVERSE_REACH] * x * s * (1.0 - x * x * x)
