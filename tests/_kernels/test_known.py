"""Integrals without nodes, against adaptive quadrature."""

import itertools
import math

import numpy as np
import pytest
from scipy.integrate import quad

from phasemap._kernels.columns import CONTACT, DAMPING, EXPONENT, INVERSE_REACH, LONGRANGE, PULL, ROW
from phasemap._kernels.forces import hertzian, inverse_square, power_law
from phasemap._kernels.numerics import narrow_bracket
from phasemap._kernels.orbits.averaged.known import attraction_integrals, constants_of, contact_integrals

A = 30e-9


def row(reach: float = 0.3e-9) -> np.ndarray:
    p = np.zeros(ROW)
    p[CONTACT], p[PULL], p[DAMPING], p[EXPONENT] = 2e5, 3e-9, 1e3, 0.5
    p[LONGRANGE], p[INVERSE_REACH] = 3e-9, 1 / reach
    return p


@pytest.mark.parametrize("depth", [1e-13, 1e-11, 3e-10, 4e-9, 15e-9, 29e-9, 41e-9, 47.9e-9])
def test_integrals_over_the_contact(depth: float) -> None:
    p, c = row(), 1 - depth / A
    m = 0.5 * (1 - c)

    def integral(f: object) -> float:  # over psi, sin(theta/2) = m^(1/2) sin(psi): smooth where contact begins
        def g(psi: float) -> float:
            share = 2 * math.sqrt(m) * math.cos(psi) / math.sqrt(1 - m * math.sin(psi) ** 2)
            return share * f(depth * math.cos(psi) ** 2, 2 * math.asin(math.sqrt(m) * math.sin(psi)))  # type: ignore[operator]

        return quad(g, 0, 0.5 * math.pi, epsabs=0, epsrel=1e-13, limit=200)[0]

    found = contact_integrals.py_func(constants_of.py_func(p), A, c)
    size = integral(lambda d, _: abs(hertzian(d, p)) + p[PULL])
    # The polynomials leave 3e-12; c holds a depth to 1e-16 of A.
    off = 1e-11 + 1e-15 * A / depth
    assert abs(found[0] - integral(lambda d, _: hertzian(d, p))) < off * size
    assert abs(found[1] - integral(lambda d, theta: hertzian(d, p) * math.cos(theta))) < off * size
    assert found[2] == pytest.approx(integral(lambda d, theta: power_law(d, p) * math.sin(theta) ** 2), rel=off)


@pytest.mark.parametrize("reach", [0.05e-9, 0.3e-9, 2e-9])
@pytest.mark.parametrize("gap", [-45e-9, -5e-9, -2e-9, -0.31e-9, -0.3e-9, -0.05e-9, 0.0, 0.2e-9, 20e-9])
def test_integrals_of_the_attraction(gap: float, reach: float) -> None:
    # Over u = ln(t + small), theta = 2 arctan(t): the force falls over some (reach / A)^(1/2) from where contact ends.
    p, c = row(reach), 1 + gap / A
    start = math.sqrt((1 - c) / (1 + c)) if c < 1 else 0.0
    small = 0.1 * reach / A

    def f(u: float, even: bool) -> float:
        more = small * math.expm1(u)
        t = start + more
        below = 1 / (1 + t * t)
        away = more * (t + start) * below * (1 + c) if c < 1 else c - 1 + 2 * t * t * below
        share = 2 * below * (more + small)
        return share * inverse_square(-A * away, p) * (1.0 if even else 2 * below - 1)

    pieces = np.linspace(0, 40, 21)
    exact = [
        sum(quad(f, a, b, (even,), epsrel=1e-13)[0] for a, b in itertools.pairwise(pieces)) for even in (True, False)
    ]
    found = attraction_integrals.py_func(constants_of.py_func(p), A, c)
    assert np.abs(np.subtract(found, exact)).max() < 1e-11 * abs(exact[0])  # quadrature and rounding: 1e-13 each


def test_a_root_takes_few_steps() -> None:
    # A convex function, of which plain chords keep one end for ever; with its value halved each time it takes 38.
    a, f_a, b, f_b, steps = -1.0, math.exp(-1) - 0.5, 2.0, math.exp(2) - 0.5, 0
    f = f_b
    while abs(f) > 1e-12:
        x = (a * f_b - b * f_a) / (f_b - f_a)
        f = math.exp(x) - 0.5
        a, f_a, b, f_b = narrow_bracket.py_func(a, f_a, b, f_b, x, f)
        assert min(a, b) <= math.log(0.5) <= max(a, b)
        steps += 1
    assert steps < 12
