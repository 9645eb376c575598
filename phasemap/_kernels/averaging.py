"""First-order averaging (Krylov, Bogolyubov, Mitropolsky; Wang 1999, Eqs. 5-8) in the setpoint formulation.

The orbit is taken as z = A0 + A cos(theta). With c = (z0 - A0)/A the depth is d = A (cos(theta) - c), so that for given
(A, c) the first harmonic (P, S) of g = F/k + 2 alpha_s zdot, and then A0 and z0, follow explicitly, and the drive

    (P + A (1 - omega^2))^2 + (2 alpha0 omega A - S)^2 = u0^2

is one scalar equation for c. (The paper replaces omega_e^2 - omega^2 by (1 + omega)(omega_e - omega), equal at first
order; here the free lever is kept exact.) The integrals use Gauss nodes that know the exponents of the integrand:

* contact: sin(theta/2) = sin(theta0/2) sin(psi), so that d = A (1 - c) cos(psi)^2 and half-integer powers are smooth;
* outside: u = tan(theta/2) = u0 + delta x / (1 - x), delta the distance to the pole of the long-range force.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from phasemap._kernels.columns import ALPHA0, BASE, OMEGA, STIFFNESS
from phasemap._kernels.law import OPTIONS, Law, contact_force, damping, longrange_force
from phasemap._kernels.tables import gauss

_X, _W = gauss(16)
_FAR_X, _FAR_W = _X / (1 - _X), 2 * _W / (1 - _X) ** 2  # u = u0 + delta _FAR_X; the weight has dtheta = 2 du/(1 + u^2)
_X, _W = gauss(10)
_COS2, _SIN2, _TOUCH_W = np.cos(_X * np.pi / 2) ** 2, np.sin(_X * np.pi / 2) ** 2, _W * np.pi * np.cos(_X * np.pi / 2)
_X, _W = gauss(40)
_DEEP_COS2, _DEEP_SIN2 = np.cos(_X * np.pi / 2) ** 2, np.sin(_X * np.pi / 2) ** 2
_DEEP_W = _W * np.pi * np.cos(_X * np.pi / 2)
_ROUND = np.cos((np.arange(48) + 0.5) * np.pi / 48)

_SUMS = {**OPTIONS, "fastmath": {"contract", "reassoc", "nsz"}}  # sums may be taken in any order, so in vectors
DEEP = -0.6  # below this c the contact integrals need the finer nodes


@njit(**_SUMS)
def harmonics(
    law: Law, p: np.ndarray, lever: np.ndarray, reach: float, amplitude: float, c: float
) -> tuple[float, float, float]:
    """P, S and A0 [m] of the harmonic orbit of this amplitude that touches where cos(theta) > c."""
    inverse_k = 1.0 / lever[STIFFNESS]
    mean, push, loss = 0.0, 0.0, 0.0  # integrals of F, F cos and alpha_s sin^2 over 0 ... pi
    damped = p[8] != 0.0
    if c < 1.0:
        if c <= -1.0:
            share = math.pi / len(_ROUND)
            for x in _ROUND:
                d = amplitude * (x - c)
                f = contact_force(law, d, p)
                mean += share * f
                push += share * f * x
                if damped:
                    loss += share * damping(law, d, p) * (1.0 - x * x)
        else:
            m2 = 0.5 * (1.0 - c)
            m = math.sqrt(m2)
            deep = c < DEEP
            cos2, sin2, weights = (_DEEP_COS2, _DEEP_SIN2, _DEEP_W) if deep else (_COS2, _SIN2, _TOUCH_W)
            for i in range(len(cos2)):
                y = (1.0 - c) * cos2[i]
                x = c + y
                d = amplitude * y
                share = m * weights[i] / math.sqrt(1.0 - m2 * sin2[i])
                f = contact_force(law, d, p)
                mean += share * f
                push += share * f * x
                if damped:
                    loss += share * damping(law, d, p) * (1.0 - x * x)
    if p[4] != 0.0 and c > -1.0:
        least = max(c - 1.0, 0.0)  # smallest gap over A
        start2 = (1.0 - c) / (1.0 + c) if c < 1.0 else 0.0
        start = math.sqrt(start2)
        ratio = 0.5 * (least + reach / amplitude) * (1.0 + start2) ** 2
        delta = math.sqrt(start2 + ratio) - start
        if delta < 1e-4 * start:
            delta = 0.5 * ratio / start
        for i in range(len(_FAR_X)):
            u = start + delta * _FAR_X[i]
            below = 1.0 / (1.0 + u * u)
            # c - cos(theta) without cancellation: both terms are >= 0
            gap = (u - start) * (u + start) * below * (1.0 + c) if c < 1.0 else least + 2.0 * u * u * below
            f = delta * _FAR_W[i] * below * longrange_force(law, -amplitude * gap, p)
            mean += f
            push += f * (2.0 * below - 1.0)
    mean *= -inverse_k / math.pi
    push *= 2.0 * inverse_k / math.pi
    return push, -4.0 / math.pi * amplitude * lever[OMEGA] * loss, mean


@njit(**OPTIONS)
def mismatch(lever: np.ndarray, amplitude: float, push: float, drag: float) -> float:
    """Drive needed over drive given, squared, less one: zero on an orbit."""
    omega = lever[OMEGA]
    x = push + amplitude * (1.0 - omega * omega)
    y = 2.0 * lever[ALPHA0] * omega * amplitude - drag
    return (x * x + y * y) / (lever[BASE] * lever[BASE]) - 1.0
