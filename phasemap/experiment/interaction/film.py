"""A sphere on a film that lies on a rigid base."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar

import numpy as np

from phasemap._kernels.columns import CONTACT, PULL
from phasemap._kernels.forces import power_law, power_law_slope
from phasemap._shared.arrays import Array
from phasemap._shared.checks import check_choice
from phasemap._shared.errors import InputError
from phasemap.experiment.interaction.base import SphereLaw

BASES = ("bonded", "slipping")
WIDEST = 2.0  # contact radius over thickness up to which the series is fitted
DEGREE = 24  # of the series of c1
CENTRE = 0.9  # of the first coefficients
THINNESS, FIRST = 2, 3  # columns of the law beside its contact and its pull


def _powers(t: float) -> tuple[float, float, float]:
    """Coefficients of x^2, x^3 and x^4 of the fitted series, t = first coefficient - CENTRE."""
    return (
        1.32920246 + t * (2.37147636 + t * (-2.30935455 + t * (-4.03649926 + t * (-0.927510326 + t * 115.657925)))),
        -0.183261927 + t * (2.82193415 + t * (20.0884532 + t * (20.2524733 + t * (-1.15993138 + t * -592.346688)))),
        -0.0395170592 + t * (-1.09589989 + t * (-6.15504566 + t * (-10.472953 + t * (51.6806828 + t * 661.043985)))),
    )


def _share(x: float, first: float) -> float:
    """Force over that on a half-space, at x = sqrt(R d)/h; a line beyond WIDEST."""
    a, b, c = _powers(first - CENTRE)
    y = min(x, WIDEST)
    share = 1.0 + y * (first + y * (a + y * (b + y * c)))
    return share + (x - y) * (first + y * (2.0 * a + y * (3.0 * b + y * 4.0 * c)))


def _rise(x: float, first: float) -> float:
    """Derivative of `_share` with respect to x."""
    a, b, c = _powers(first - CENTRE)
    y = min(x, WIDEST)
    return first + y * (2.0 * a + y * (3.0 * b + y * 4.0 * c))


def _bend(x: float, first: float) -> float:
    """Derivative of `_rise`."""
    if x > WIDEST:
        return 0.0
    a, b, c = _powers(first - CENTRE)
    return 2.0 * a + x * (6.0 * b + x * 12.0 * c)


def first_coefficient(poisson_ratio: Array, base: str) -> Array:
    """c1 [1], the integral of 1 - M(q) over q times 2/pi: theory, Eq. (model-18).

    Examples
    --------
    >>> import numpy as np
    >>> [first_coefficient(np.array([0.3, 0.5]), base).round(4).tolist() for base in BASES]
    [[0.8765, 1.127], [0.7433, 0.7433]]
    """
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

    Examples
    --------
    >>> import numpy as np
    >>> rows = [Film().columns_on(np.array([1e9]), np.array([0.0]), 1e-8, np.array([[0.5, h]])) for h in (1.0, 5e-9)]
    >>> [round(float(Film.force(1e-9, [column[0] for column in row])) * 1e9, 2) for row in rows]
    [3.16, 8.65]
    """

    base: str = "bonded"
    name: ClassVar[str] = "film"
    takes_film: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check_choice("base of the film", self.base, BASES)

    @staticmethod
    def force(d: float, p: Array) -> float:
        return p[CONTACT] * d * math.sqrt(d) * _share(p[THINNESS] * math.sqrt(d), p[FIRST]) - p[PULL]

    @staticmethod
    def slope(d: float, p: Array) -> float:
        root = math.sqrt(d)
        x = p[THINNESS] * root
        return p[CONTACT] * root * (1.5 * _share(x, p[FIRST]) + 0.5 * x * _rise(x, p[FIRST]))

    @staticmethod
    def damping(d: float, p: Array) -> float:
        x = p[THINNESS] * math.sqrt(d)
        return power_law(d, p) * (_share(x, p[FIRST]) + x * _rise(x, p[FIRST]) / 3.0)

    @staticmethod
    def damping_slope(d: float, p: Array) -> float:
        if d <= 0.0:
            return power_law_slope(d, p)
        x = p[THINNESS] * math.sqrt(d)
        rise = _rise(x, p[FIRST])
        more = (4.0 * rise + x * _bend(x, p[FIRST])) * x / (6.0 * d)
        return power_law_slope(d, p) * (_share(x, p[FIRST]) + x * rise / 3.0) + power_law(d, p) * more

    def columns_on(
        self, contact_stiffness: Array, adhesion: Array, radius: float, film: Array | None
    ) -> tuple[Array | float, ...]:
        """p[CONTACT] = K sqrt(R) [N m^-1.5], p[PULL] = the attraction [N].

        And p[THINNESS] = sqrt(R)/h [m^-0.5], p[FIRST] = c1 [1].
        """
        hertzian = contact_stiffness * math.sqrt(radius), self.pull(contact_stiffness, adhesion, radius)
        if film is None:
            return *hertzian, 0.0, CENTRE
        poisson_ratio, thickness = film.T
        if self.base == "bonded" and (poisson_ratio < 0).any():
            worst = float(poisson_ratio[poisson_ratio < 0][0])
            raise InputError("poisson_ratio", worst, "a number between 0 and 0.5 where the contact is 'film'")
        return *hertzian, math.sqrt(radius) / thickness, first_coefficient(poisson_ratio, self.base)

    def columns(self, contact_stiffness: Array, adhesion: Array, radius: float) -> tuple[Array | float, ...]:
        """Those of a film without end, on which the force is that of DMT."""
        return self.columns_on(contact_stiffness, adhesion, radius, None)
