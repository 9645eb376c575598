"""The formulas that kernels know by themselves: Hertzian contact, its factor on a film, attraction, damping.

Depths d in m; p is a row of parameters, `phasemap._kernels.columns`.
"""

from __future__ import annotations

import math
from typing import Any

from phasemap._kernels.columns import CONTACT, DAMPING, EXPONENT, INVERSE_REACH, LONGRANGE, PULL

FILM_CENTRE = 0.9  # of the first coefficients
FILM_WIDEST = 2.0  # x up to which the series is fitted


def hertzian(d: float, p: Any) -> float:
    """K sqrt(R) d^(3/2) less a constant attraction [N] (Wang 1999, Eq. 2), d >= 0."""
    return float(p[CONTACT] * d * math.sqrt(d) - p[PULL])


def hertzian_slope(d: float, p: Any) -> float:
    """Derivative of `hertzian` by the depth [N/m]."""
    return float(1.5 * p[CONTACT] * math.sqrt(d))


def film_series(x: float, first: float) -> tuple[float, float, float]:
    """Force on a film over that on a half-space at x = sqrt(R d)/h, and two derivatives by x: theory, Eq. (model-17).

    `first` is its first coefficient, of which the others are functions. It goes on as a line beyond FILM_WIDEST.
    """
    t = first - FILM_CENTRE
    a = 1.32920246 + t * (2.37147636 + t * (-2.30935455 + t * (-4.03649926 + t * (-0.927510326 + t * 115.657925))))
    b = -0.183261927 + t * (2.82193415 + t * (20.0884532 + t * (20.2524733 + t * (-1.15993138 + t * -592.346688))))
    c = -0.0395170592 + t * (-1.09589989 + t * (-6.15504566 + t * (-10.472953 + t * (51.6806828 + t * 661.043985))))
    y = min(x, FILM_WIDEST)
    share = 1.0 + y * (first + y * (a + y * (b + y * c)))
    rise = first + y * (2.0 * a + y * (3.0 * b + y * 4.0 * c))
    bend = 2.0 * a + x * (6.0 * b + x * 12.0 * c) if x <= FILM_WIDEST else 0.0
    return share + (x - y) * rise, rise, bend


def inverse_square(d: float, p: Any) -> float:
    """-f0 / (1 - d/d0)^2 [N] (Wang 1999, Eq. 3), d <= 0."""
    s = 1.0 - d * p[INVERSE_REACH]
    return float(-p[LONGRANGE] / (s * s))


def inverse_square_slope(d: float, p: Any) -> float:
    """Derivative of `inverse_square` by the depth [N/m]."""
    s = 1.0 - d * p[INVERSE_REACH]
    return float(-2.0 * p[LONGRANGE] * p[INVERSE_REACH] / (s * s * s))


def power_law(d: float, p: Any) -> float:
    """alpha1 (d/R)^n [1] (Wang 1999, Eq. 4), d >= 0."""
    if p[EXPONENT] == 0.5:
        return float(p[DAMPING] * math.sqrt(d))
    return float(p[DAMPING] * d ** p[EXPONENT])


def power_law_slope(d: float, p: Any) -> float:
    """Derivative of `power_law` by the depth [1/m]; 0 at d = 0, where it may have none."""
    if d <= 0.0 or p[EXPONENT] == 0.0:
        return 0.0
    if p[EXPONENT] == 0.5:
        return float(0.5 * p[DAMPING] / math.sqrt(d))
    return float(p[EXPONENT] * p[DAMPING] * d ** (p[EXPONENT] - 1.0))
