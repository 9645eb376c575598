"""The double-layer force in an electrolyte, with van der Waals attraction."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from phasemap._kernels.columns import BIAS
from phasemap._shared.fields import Number
from phasemap.experiment.interaction.longrange.base import LongRange, vanderwaals, vanderwaals_slope, whole
from phasemap.experiment.interaction.longrange.electrostatic import VACUUM_PERMITTIVITY

if TYPE_CHECKING:
    import numpy as np

KAPPA, CHARGES = 6, 7  # columns: 1/lambda [1/m], force of the product of the charges at d = 0 [N]


@dataclass(frozen=True)
class DLVO(LongRange):
    """F = (2 pi R lambda/(eps eps0)) [2 s_t s_s exp(d/lambda) + (s_t^2 + s_s^2) exp(2 d/lambda)], beside van der Waals.

    Butt, Biophys. J. 60, 1438 (1991): the linear Poisson-Boltzmann equation between surfaces of constant charges s_t
    and s_s, far enough for terms of exp(3 d/lambda) to be left out, in Derjaguin's approximation; theory, Eq.
    (longrange-1). In contact the force stays what it is at d = 0. The attraction is that of `decay_length` and the
    material's adhesion, across the liquid.

    Parameters
    ----------
    surface_charge_tip, surface_charge_sample : float
        s_t and s_s [C/m2], of either sign; equal signs repel.
    debye_length : float
        lambda [m], > 0: 0.304 nm over the root of the concentration in mol/l of a 1:1 salt in water at 25 degrees.
    permittivity : float
        eps [1], >= 1, relative to vacuum; 78.5 of water.
    """

    surface_charge_tip: Number[float] = Number("C/m2", -0.01, minimum=-1e3, maximum=1e3, usual=(1e-6, 1.0))
    surface_charge_sample: Number[float] = Number("C/m2", -0.01, minimum=-1e3, maximum=1e3, usual=(1e-6, 1.0))
    debye_length: Number[float] = Number("m", 1e-9, above=0, usual=(0.1e-9, 1e-6))
    permittivity: Number[float] = Number("1", 78.5, minimum=1.0, usual=(1.0, 200.0))
    name: ClassVar[str] = "dlvo"

    def _strengths(self, radius: float) -> tuple[float, float]:
        """Forces at d = 0 [N]: of the product of the charges, and of their squares."""
        unit = 2 * math.pi * radius * self.debye_length / (self.permittivity * VACUUM_PERMITTIVITY)
        tip, sample = self.surface_charge_tip, self.surface_charge_sample
        return 2 * unit * tip * sample, unit * (tip**2 + sample**2)

    def columns(self, pull: np.ndarray, decay_length: float | None, radius: float) -> tuple[np.ndarray | float, ...]:
        """p[KAPPA] = 1/lambda [1/m], p[CHARGES] = 4 pi R lambda s_t s_s/(eps eps0) [N]."""
        product, squares = self._strengths(radius)
        attraction = whole(pull, decay_length, -(product + squares), squares)
        return attraction, 1 / (decay_length or self.debye_length), 1 / self.debye_length, product

    def in_contact(self, decay_length: float | None, radius: float) -> float:
        return -sum(self._strengths(radius))

    @staticmethod
    def force(d: float, p: np.ndarray) -> float:
        screened = math.exp(d * p[KAPPA])
        return vanderwaals(d, p) + screened * (p[CHARGES] - (p[BIAS] + p[CHARGES]) * screened)

    @staticmethod
    def slope(d: float, p: np.ndarray) -> float:
        screened = math.exp(d * p[KAPPA])
        double_layer = p[KAPPA] * screened * (p[CHARGES] - 2.0 * (p[BIAS] + p[CHARGES]) * screened)
        return vanderwaals_slope(d, p) + double_layer
