"""A sphere on a film that lies on a rigid base."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar

import numpy as np

from phasemap._kernels.columns import CONTACT, FILM_SERIES, PULL, THINNESS
from phasemap._kernels.forces import film_series, power_law, power_law_slope
from phasemap._shared.arrays import Array
from phasemap._shared.checks import check_choice
from phasemap._shared.errors import InputError
from phasemap.experiment.interaction.base import SphereLaw

BASES = ("bonded", "slipping")
DEGREE = 24  # of the series of c1


def first_coefficient(poisson_ratio: Array, base: str) -> Array:
    """c1 [1], the integral of 1 - M(q) over q times 2/pi: theory, Eq. (model-18)."""
    return np.asarray(_series(base)(np.clip(poisson_ratio, 0.0, 0.5)))  # below 0 a film that slips has the same


@cache
def _series(base: str) -> Any:
    """c1 as a Chebyshev series of Poisson's ratio, good to 1e-12 from 0 to 0.5."""
    nodes, weights = np.polynomial.legendre.leggauss(64)
    q, weights = 10.0 * (nodes + 1.0), 10.0 * weights
    decay = np.exp(-2.0 * q)

    def value(poisson_ratio: Array) -> Array:
        kappa = 3.0 - 4.0 * poisson_ratio[:, None]
        compliance = (1 - decay) ** 2 / (1 - decay**2 + 4 * q * decay) + 0.0 * kappa
        if base == "bonded":
            above = kappa * (1 - decay**2) - 4 * q * decay
            compliance = above / (kappa * (1 + decay**2) + (kappa**2 + 1 + 4 * q**2) * decay)
        return np.asarray(2 / math.pi * (1 - compliance) @ weights)

    return np.polynomial.Chebyshev.interpolate(value, DEGREE, domain=[0.0, 0.5])


@dataclass(frozen=True)
class Film(SphereLaw):
    """F = K sqrt(R) d^(3/2) (1 + c1 x + c2 x^2 + c3 x^3 + c4 x^4) - 2 pi w R, x = sqrt(R d)/h: theory, Eq. (model-17).

    A rigid sphere on a film of thickness h on a rigid base, linear elastic. c1 is exact; the others are fitted to the
    solution of the integral equation of the layer (Lebedev and Ufliand 1958), to 1 % of the force for x <= 2. They
    depend on Poisson's ratio, from 0 to 0.5, where the film is bonded to its base, and not where it slips on it. Beyond
    x = 2 the factor goes on as a line. The series of Dimitriadis et al. (2002) is another: at nu = 1/2 it is 15 % less
    at x = 0.75 where the film is bonded, and its c1 is 19 % more where it slips.

    Damping is that of the interaction times what the film adds to the slope of the force, as of a Kelvin-Voigt film.

    Parameters
    ----------
    base : {"bonded", "slipping"}
        Whether the film sticks to its base, or slips on it without friction.
    """

    base: str = "bonded"
    name: ClassVar[str] = "film"
    takes_film: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check_choice("base of the film", self.base, BASES)

    @staticmethod
    def force(d: float, p: Array) -> float:
        """Hertz times the film's series, less adhesion."""
        share, _, _ = film_series(p[THINNESS] * math.sqrt(d), p[FILM_SERIES])
        return p[CONTACT] * d * math.sqrt(d) * share - p[PULL]

    @staticmethod
    def slope(d: float, p: Array) -> float:
        """By the series and its derivative."""
        root = math.sqrt(d)
        x = p[THINNESS] * root
        share, rise, _ = film_series(x, p[FILM_SERIES])
        return p[CONTACT] * root * (1.5 * share + 0.5 * x * rise)

    @staticmethod
    def damping(d: float, p: Array) -> float:
        """The power law times what the film adds to the slope of the force."""
        x = p[THINNESS] * math.sqrt(d)
        share, rise, _ = film_series(x, p[FILM_SERIES])
        return power_law(d, p) * (share + x * rise / 3.0)

    @staticmethod
    def damping_slope(d: float, p: Array) -> float:
        """Product rule of the same; the film adds nothing at d <= 0."""
        if d <= 0.0:
            return power_law_slope(d, p)
        x = p[THINNESS] * math.sqrt(d)
        share, rise, bend = film_series(x, p[FILM_SERIES])
        more = (4.0 * rise + x * bend) * x / (6.0 * d)
        return power_law_slope(d, p) * (share + x * rise / 3.0) + power_law(d, p) * more

    def films(self, radius: float, film: Array) -> Array:
        """p[THINNESS] = sqrt(R)/h [m^-0.5], p[FILM_SERIES] = c1 [1]."""
        poisson_ratio, thickness = film.T
        if self.base == "bonded" and (poisson_ratio < 0).any():
            worst = float(poisson_ratio[poisson_ratio < 0][0])
            raise InputError("poisson_ratio", worst, "a number between 0 and 0.5 where the contact is 'film'")
        return np.column_stack([math.sqrt(radius) / thickness, first_coefficient(poisson_ratio, self.base)])
