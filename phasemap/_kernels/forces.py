"""The formulas that kernels know by themselves: Hertzian contact, the inverse-square attraction, power-law damping.

Depths d in m; p is a row of parameters, `phasemap._kernels.columns`.
"""

from __future__ import annotations

import math
from typing import Any

from phasemap._kernels.columns import CONTACT, DAMPING, EXPONENT, INVERSE_REACH, LONGRANGE, PULL


def hertzian(d: float, p: Any) -> float:
    """K sqrt(R) d^(3/2) less a constant attraction [N] (Wang 1999, Eq. 2), d >= 0."""
    return float(p[CONTACT] * d * math.sqrt(d) - p[PULL])


def hertzian_slope(d: float, p: Any) -> float:
    """Derivative of `hertzian` by the depth [N/m]."""
    return float(1.5 * p[CONTACT] * math.sqrt(d))


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
