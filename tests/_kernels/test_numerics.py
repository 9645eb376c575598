"""Small dense systems, and series."""

from __future__ import annotations

import numpy as np

from phasemap._kernels.numerics import eliminate_columns, parabola
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
