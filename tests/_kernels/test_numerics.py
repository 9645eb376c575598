"""Small dense systems, and series."""

from __future__ import annotations

import numpy as np
from cases import plain

from phasemap._kernels.numerics import eliminate_columns, fill_growth, fill_turn, parabola, solve_equations
from phasemap._kernels.quadrature import NODES, gauss
from phasemap._kernels.scanning.higher_harmonics import kappa_of_push


def test_columns_are_solved_for_as_numpy_does_also_where_rows_have_to_be_exchanged() -> None:
    generator = np.random.default_rng(3)
    matrix, right = generator.normal(size=(NODES, NODES)), generator.normal(size=(NODES, 7))
    matrix[0, 0] = matrix[3, 3] = 0.0
    columns = np.concatenate([matrix.T, right.T])
    assert eliminate_columns.py_func(columns, len(columns))
    # Both round 8 steps; what that does to a solution is bounded by the condition of the matrix.
    bound = 8 * NODES * np.finfo(float).eps * np.linalg.cond(matrix)
    np.testing.assert_allclose(columns[NODES:].T, np.linalg.solve(matrix, right), atol=bound, rtol=bound)


def test_equations_with_one_right_side_are_solved_for_as_numpy_does_or_said_to_be_singular() -> None:
    generator = np.random.default_rng(4)
    system = generator.normal(size=(7, 8))
    system[0, 0] = 0.0
    expected = np.linalg.solve(system[:, :7], system[:, 7])
    bound = 8 * 7 * np.finfo(float).eps * np.linalg.cond(system[:, :7])  # as above
    assert plain(solve_equations)(system)
    np.testing.assert_allclose(system[:, 7], expected, atol=bound, rtol=bound)
    assert not plain(solve_equations)(np.ones((2, 3)))


def test_turn_and_growth_are_right_to_rounding_within_an_element_and_to_1e_11_within_a_period() -> None:
    sine, cosine, growth = np.empty((3, 25))
    # Doubling three times makes eight times the rounding of one; squaring six times 64 times that.
    for reach, factor, error in ((3.0, 1.0, 1e-14), (2 * np.pi, 1.0, 1e-11), (2 * np.pi, 6.3, 1e-13)):
        angle = np.linspace(-reach, reach, 25)
        fill_turn.py_func(angle, factor, sine, cosine)
        np.testing.assert_allclose(sine, np.sin(factor * angle), atol=error)
        np.testing.assert_allclose(cosine, np.cos(factor * angle), atol=error)
    for rate in (0.002, -0.099, -0.5):
        fill_growth.py_func(angle, rate, growth)
        np.testing.assert_allclose(growth, np.exp(rate * angle), rtol=1e-12)


def test_a_singular_system_has_no_solution() -> None:
    columns = np.ones((NODES + 1, NODES))
    columns[2] = 0.0
    assert not eliminate_columns.py_func(columns, len(columns))


def test_the_vertex_of_a_parabola_through_three_points_is_its_own() -> None:
    points = [(x, 3.0 - 2.0 * (x - 0.4) ** 2) for x in (-1.0, 0.3, 2.0)]
    np.testing.assert_allclose(parabola.py_func(*points), (0.4, 3.0, -4.0), rtol=1e-14)


def test_the_shift_by_a_push_is_the_double_integral_of_the_theory() -> None:
    x, w = gauss(64)
    for c in (0.99, 0.9, 0.5, 0.0, -0.7):  # theta/2 = asin(sqrt(m) sin(pi x/2)): roots at the ends of contact are none
        m, sine = 0.5 * (1 - c), np.sin(0.5 * np.pi * x)
        half, y = np.arcsin(np.sqrt(m) * sine), 1 - sine**2  # cos(theta) - c = 2 m y
        share = w * np.sqrt(y / (1 - m * sine**2))
        apart = np.stack(
            [abs(half[:, None] - half), half[:, None] + half]
        )  # halves of theta - theta' and theta + theta'
        g = (0.5 + 0.25 * np.cos(2 * apart) - (0.5 * np.pi - apart) * np.sin(2 * apart)).sum(0)
        stiffness, force = share * y**0.5 * np.cos(2 * half), share * y**1.5
        exact = 0.5 * (stiffness @ g @ force) / (stiffness.sum() * (force * np.cos(2 * half)).sum())
        assert abs(kappa_of_push.py_func(c) - exact) < 3e-4  # what the polynomial states
