"""The Bessel function that a lever in liquid needs."""

from __future__ import annotations

import cmath
import math

STEP = 0.05  # of the trapezoidal rule: to the last digits up to |z| = 100


def kve(order, z):
    """exp(z) K_order(z): the integral of exp(z - z cosh t) cosh(order t) over t from 0 on."""
    whole, part, i = 0.0, 0.5, 0
    while abs(part) > 1e-18 * abs(whole):
        whole += part
        i += 1
        part = cmath.exp(-z * (math.cosh(STEP * i) - 1)) * math.cosh(order * STEP * i)
    return STEP * whole
