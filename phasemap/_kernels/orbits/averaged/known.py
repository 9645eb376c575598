"""Integrals of the forces that kernels know over a harmonic orbit, without nodes.

See theory, Eqs. (averaging-12) and (averaging-13). In contact they are functions of m = (1 - c)/2 alone, analytic up to
m = 1 (elliptic integrals), which polynomials on short intervals give. Those of the inverse-square attraction are
elementary.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels.columns import BIAS, CONTACT, DAMPING, EXPONENT, INVERSE_REACH, LONGRANGE, PULL
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, has_hysteresis, has_longrange
from phasemap._kernels.quadrature import gauss

LEAST_CONTACT_COSINE = -0.6  # least c: the nearer to m = 1, the shorter intervals would have to be
INTERVALS, INTERVAL, INTERVAL_TERMS = 8, 0.1, 14  # intervals of m and their length; 3e-12 is wrong in the last one
SMALL_ARGUMENT, SERIES_TERMS = 0.1, 14  # |x| below which the attraction's integrals are series in x, and their terms


def _shapes(m: np.ndarray) -> np.ndarray:
    """The functions of m in theory, Eq. (averaging-12), shape (4, ...)."""
    x, w = gauss(64)
    sine2, w = np.sin(0.5 * np.pi * x) ** 2, 0.5 * np.pi * w
    root, cos2 = np.sqrt(1 - m[..., None] * sine2), 1 - sine2
    elastic = cos2**2 / root
    parts = elastic, elastic * (1 - 2 * m[..., None] * sine2), cos2 * sine2 * root
    return np.stack([*(np.sum(part * w, axis=-1) for part in parts), np.arcsin(np.sqrt(m)) / np.sqrt(m)])


def _polynomials() -> np.ndarray:
    """Coefficients on each interval, highest first, shape (INTERVALS, TERMS, 4)."""
    nodes = np.cos((np.arange(INTERVAL_TERMS) + 0.5) * np.pi / INTERVAL_TERMS)
    m = (np.arange(INTERVALS)[:, None] + 0.5 + 0.5 * nodes) * INTERVAL
    return np.ascontiguousarray(np.einsum("tn,fin->itf", np.linalg.inv(np.vander(nodes)), _shapes(m)))


_POLYNOMIALS = _polynomials()


class Known(NamedTuple):
    """Constants of the forces whose integrals are known in closed form."""

    contact: float
    pull: float
    damping: float
    longrange: float
    inverse_reach: float


@kernel(inline=True)
def constants_of(p: np.ndarray) -> Known:
    """Constants of the integrals in closed form, Eqs. (averaging-12) and (averaging-13), of a row of parameters."""
    return Known(p[CONTACT], p[PULL] + p[BIAS], p[DAMPING], p[LONGRANGE], p[INVERSE_REACH])


@kernel(inline=True)
def knows_all(law: Law, p: np.ndarray, c: float) -> bool:
    """True if the integrals of all forces on a tip that first touches at cos(theta) = c are known in closed form."""
    outside = law.longrange_force == 0 or not has_longrange(p)
    return outside and law.memory == 0 and not has_hysteresis(p) and c > -1.0 and (c >= 1.0 or knows_contact(law, p, c))


@kernel
def knows_contact(law: Law, p: np.ndarray, c: float) -> bool:
    """True if `contact_integrals` holds for this law and a tip that first touches at cos(theta) = c."""
    damped = p[DAMPING] == 0.0 or (law.damping == 0 and p[EXPONENT] == 0.5)
    return bool(law.contact_force == 0 and damped and c > LEAST_CONTACT_COSINE)


@kernel
def contact_integrals(known: Known, amplitude: float, c: float) -> tuple[float, float, float]:
    """Integrals of F, F cos and alpha_s sin^2 [N, N, 1] over the contact from theta = 0, c < 1."""
    m = 0.5 * (1.0 - c)
    interval = int(m / INTERVAL)
    u, a = 2.0 * (m / INTERVAL - interval) - 1.0, _POLYNOMIALS[interval]
    even, cosine, loss, arc = 0.0, 0.0, 0.0, 0.0
    for n in range(INTERVAL_TERMS):
        even, cosine, loss, arc = u * even + a[n, 0], u * cosine + a[n, 1], u * loss + a[n, 2], u * arc + a[n, 3]
    root, pull = math.sqrt(amplitude), known.pull
    elastic = 2.0**2.5 * m * m * known.contact * amplitude * root
    mean = elastic * even - 2.0 * pull * math.sqrt(m) * arc
    push = elastic * cosine - 2.0 * pull * math.sqrt(m * (1.0 - m))
    return mean, push, 2.0**3.5 * m * m * known.damping * root * loss


@kernel
def attraction_integrals(known: Known, amplitude: float, c: float) -> tuple[float, float]:
    """Integrals of F and F cos [N] outside contact up to theta = pi, c > -1."""
    ratio = 1.0 / (known.inverse_reach * amplitude)
    less = (c - 1.0) + ratio  # a - 1
    more = less + 2.0
    strength = -known.longrange * ratio * ratio
    if c >= 1.0:
        share = math.pi * strength / (less * more * math.sqrt(less * more))
        return (less + 1.0) * share, share
    beta, start2 = less / more, (1.0 - c) / (1.0 + c)
    start, above = math.sqrt(start2), 2.0 * ratio / ((1.0 + c) * more)  # above = start^2 + beta
    # Integrals of 1/(u^2 + beta) and of its square over u = tan(theta/2), from contact on.
    if abs(beta) < SMALL_ARGUMENT * start2:
        x, first_power, second_power = beta / start2, 0.0, 0.0
        for k in range(SERIES_TERMS):
            n = SERIES_TERMS - 1 - k
            first_power, second_power = 1.0 / (2 * n + 1) - x * first_power, (n + 1) / (2 * n + 3) - x * second_power
        first_power, second_power = first_power / start, second_power / (start * start2)
    else:
        root = math.sqrt(abs(beta))
        if beta > 0.0:
            first_power = math.atan2(root, start) / root
        else:
            first_power = 0.5 * math.log((start + root) * (start + root) / above) / root
        second_power = 0.5 * (first_power - start / above) / beta
    share = 2.0 * strength / (more * more)
    return share * (first_power + (1.0 - beta) * second_power), share * ((1.0 + beta) * second_power - first_power)
