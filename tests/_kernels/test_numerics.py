"""Small dense systems."""

from __future__ import annotations

import numpy as np

from phasemap._kernels.numerics import eliminate_columns, parabola
from phasemap._kernels.quadrature import NODES


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
