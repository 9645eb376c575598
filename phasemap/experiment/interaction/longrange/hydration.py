"""The force of ordered water between two surfaces."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from phasemap._kernels.columns import BIAS
from phasemap._shared.fields import Number
from phasemap.experiment.interaction.longrange.base import LongRange, vanderwaals, vanderwaals_slope, whole

if TYPE_CHECKING:
    import numpy as np

INVERSE_DECAY = 6  # column: 1/lambda0 [1/m]


@dataclass(frozen=True)
class Hydration(LongRange):
    """F = 2 pi R W0 exp(d/lambda0), beside the van der Waals attraction: hydration, or another exponential force.

    Israelachvili, Intermolecular and Surface Forces, 3rd ed. (2011), chapter 15: W = W0 exp(-D/lambda0) of two planes,
    with W0 3 to 30 mJ/m2 and lambda0 0.6 to 1.1 nm, in Derjaguin's approximation; theory, Eq. (longrange-2). In contact
    the force stays what it is at d = 0.

    Parameters
    ----------
    strength : float
        W0 [J/m2], negative where the force attracts (hydrophobic surfaces).
    decay : float
        lambda0 [m], > 0.
    """

    strength: Number[float] = Number("J/m2", 10e-3, minimum=-1e3, maximum=1e3, usual=(1e-6, 1.0))
    decay: Number[float] = Number("m", 1e-9, above=0, usual=(0.05e-9, 100e-9))
    name: ClassVar[str] = "hydration"

    def columns(self, pull: np.ndarray, decay_length: float | None, radius: float) -> tuple[np.ndarray | float, ...]:
        """p[INVERSE_DECAY] = 1/lambda0 [1/m]."""
        other = self.in_contact(decay_length, radius)
        return whole(pull, decay_length, other, abs(other)), 1 / (decay_length or self.decay), 1 / self.decay

    def in_contact(self, decay_length: float | None, radius: float) -> float:
        return -2 * math.pi * radius * self.strength

    @staticmethod
    def force(d: float, p: np.ndarray) -> float:
        return vanderwaals(d, p) - p[BIAS] * math.exp(d * p[INVERSE_DECAY])

    @staticmethod
    def slope(d: float, p: np.ndarray) -> float:
        return vanderwaals_slope(d, p) - p[BIAS] * p[INVERSE_DECAY] * math.exp(d * p[INVERSE_DECAY])
