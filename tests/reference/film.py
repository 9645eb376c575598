"""A rigid sphere on an elastic layer that lies on a rigid base, solved anew: nothing of phasemap is used.

Units: thickness 1, E* of the layer 1. The layer's surface moves by M(q) times what a half-space's would under a pressure
p(q) J0(q r) (Hankel's transform). M comes from the equations of elasticity, integrated through the layer by a matrix
exponential; with it the pressure under the sphere is a Fredholm equation of the second kind (Lebedev and Ufliand 1958),
solved by Gauss and Legendre's points.

    python tests/reference/film.py

prints the exact force over that of Hertz beside the series of Dimitriadis et al. (2002).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.polynomial.legendre import leggauss
from scipy.linalg import expm

Array = np.ndarray

HIGHEST = 12.0  # q at which the layer is a half-space to 1e-8


def compliance(q: float, nu: float, bonded: bool) -> float:
    """M(q): u_z = Z J0(q r), u_r = X J1(q r), stress s J0 and t J1, carried through the layer, in units of mu."""
    lame = 2 * nu / (1 - 2 * nu)
    of_z = np.array([0.0, -lame * q, 1.0, 0.0]) / (lame + 2)  # s = (lame + 2) Z' + lame q X
    of_x = np.array([q, 0.0, 0.0, 1.0])  # t = X' - q Z
    of_s = np.array([0.0, 0.0, 0.0, -q])
    # X'' = q^2 X + (lame + 1) q (Z' + q X), and t' = X'' - q Z'
    of_t = np.array([0.0, q * q * (lame + 2), 0.0, 0.0]) + lame * q * of_z
    through = expm(np.array([of_z, of_x, of_s, of_t]))
    held = [0, 1] if bonded else [0, 3]  # Z and X, or Z and t, vanish at the base
    surface = np.linalg.solve(through[held][:, [0, 1]], through[held][:, 2])  # under s = -1
    return float(surface[0] * q / (1 - nu))


def deficit(nu: float, bonded: bool, count: int = 96) -> tuple[Array, Array, Array]:
    """Points q, weights, and 1 - M there."""
    x, w = leggauss(count)
    q, w = HIGHEST * (x + 1) / 2, HIGHEST * w / 2
    nearly = min(nu, 0.5 - 1e-7)  # for the equations have lame's first constant
    return q, w, 1 - np.array([compliance(one, nearly, bonded) for one in q])


def force_ratio(a: float, radius: float, spectrum: tuple[Array, Array, Array], count: int = 48) -> tuple[float, float]:
    """x = sqrt(R d)/h and the force over that of Hertz, where the contact has the radius a.

    phi(t) - integral of K(t, s) phi(s) ds = (1/pi) (d - t^2/R), K = (2/pi) integral of (1 - M) cos(q t) cos(q s) dq, on
    0 < t < a; phi(a) = 0 says how deep d is, and the force is 2 pi times the integral of phi.
    """
    q, w, missing = spectrum
    x, weights = leggauss(count)
    t, weights = a * (x + 1) / 2, a * weights / 2
    waves = np.cos(np.outer(np.append(t, a), q))
    kernel = 2 / math.pi * (waves * (w * missing)) @ waves[:-1].T * weights
    inside = np.eye(count) - kernel[:-1]
    flat, curved = np.linalg.solve(inside, np.ones(count)), np.linalg.solve(inside, t * t)
    depth = (a * a + kernel[-1] @ curved) / (1 + kernel[-1] @ flat) / radius
    force = 2 * weights @ (depth * flat - curved / radius)
    return math.sqrt(radius * depth), float(force / (4 / 3 * math.sqrt(radius) * depth**1.5))


def dimitriadis(x: float, nu: float, bonded: bool) -> float:
    """The series of Dimitriadis et al., Biophys. J. 82, 2798 (2002), Eqs. 10 to 12."""
    if bonded:
        alpha = -(1.2876 - 1.4678 * nu + 1.3442 * nu**2) / (1 - nu)
        beta = (0.6387 - 1.0277 * nu + 1.5164 * nu**2) / (1 - nu)
    else:
        alpha, beta = -0.347 * (3 - 2 * nu) / (1 - nu), 0.056 * (5 - 2 * nu) / (1 - nu)
    pi = math.pi
    return (
        1 - 2 * alpha / pi * x + 4 * alpha**2 / pi**2 * x**2 - 8 / pi**3 * (alpha**3 + 4 * pi**2 / 15 * beta) * x**3
        + 16 * alpha / pi**4 * (alpha**3 + 3 * pi**2 / 5 * beta) * x**4
    )  # fmt: skip


if __name__ == "__main__":
    for nu, bonded in ((0.5, True), (0.35, True), (0.5, False), (0.35, False)):
        print(f"Poisson's ratio {nu}, {'bonded' if bonded else 'slipping'}")
        spectrum = deficit(nu, bonded)
        for a in (0.05, 0.1, 0.2, 0.5, 1.0, 2.0):
            x, ratio = force_ratio(a, 1.0, spectrum)
            print(f"  x {x:.4f}  exact {ratio:.5f}  Dimitriadis et al. {dimitriadis(x, nu, bonded):.5f}")
