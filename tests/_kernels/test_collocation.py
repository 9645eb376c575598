"""Orbits by collocation, in plain Python, where their answers are closed forms or a line of numpy."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from cases import plain

from phasemap._kernels import columns as col
from phasemap._kernels.continuation.point import solve_far_from_surface
from phasemap._kernels.law import Law, Oscillator
from phasemap._kernels.orbits.collocation.path import fixed_path
from phasemap._kernels.orbits.collocation.stability import determinant_of_return, floquet
from phasemap._kernels.orbits.collocation.system import head_of, new_orbit
from phasemap._kernels.quadrature import TABLES
from phasemap.experiment.lever_numbers import one_mode

STIFFNESS, FREE, Q = 40.0, 16e-9, 20.0  # [N/m], [m] at resonance, quality factor


@pytest.mark.parametrize("states", [2, 4, 8])
def test_multipliers_and_their_determinant_are_those_of_numpy(states: int) -> None:
    rng = np.random.default_rng(states)
    for _ in range(20):
        matrix = rng.normal(size=(states, states)) * rng.uniform(0.1, 3.0)
        transfer = matrix.ravel().copy()
        # Squared until only the largest multiplier is left: to rounding where it is alone, to 1e-4 where two are close.
        assert plain(floquet)(transfer, states) == pytest.approx(abs(np.linalg.eigvals(matrix)).max(), rel=1e-4)
        assert plain(determinant_of_return)(transfer, states) == pytest.approx(np.linalg.det(np.eye(states) - matrix))


def test_a_matrix_that_returns_a_motion_to_itself_has_no_determinant() -> None:
    assert plain(determinant_of_return)(np.array([1.0, 0.0, 0.3, 0.5]), 2) == 0.0


def free_orbit(omega: float) -> Any:
    """Orbit of a lever beyond the reach of the surface."""
    lever = one_mode(omega, 0.5 / Q, STIFFNESS, FREE / Q)
    p = np.zeros(col.ROW)
    p[[col.CONTACT, col.INVERSE_REACH]] = 3e5, 1 / 0.3e-9
    path = plain(fixed_path)(Oscillator(Law(0, 0, 0, 0, 0, 0), tuple(map(float, p)), lever))
    orbit = plain(new_orbit)(lever, TABLES)
    assert plain(solve_far_from_surface)(path, orbit, 0.5 * FREE) == col.GOOD
    return orbit


@pytest.mark.parametrize("omega", [0.97, 1.0, 1.04])
def test_a_free_lever_swings_and_forgets_as_formulas_say(omega: float) -> None:
    head = head_of(free_orbit(omega))
    free = FREE / Q / abs(1 - omega**2 + 1j * omega / Q)
    assert head.amplitude == pytest.approx(free, rel=1e-9)
    assert [head.push, head.drag] == pytest.approx([0.0, 0.0], abs=1e-12 * free)
    # z'' + z'/Q + z = 0 over a period 2 pi/omega: multipliers of size exp(-pi/(omega Q)).
    size = math.exp(-math.pi / (omega * Q))
    assert plain(floquet)(head.transfer, 2) == pytest.approx(size, rel=1e-9)
    turn = 2 * math.pi / omega * math.sqrt(1 - 0.25 / Q**2)
    returned = 1 - 2 * size * math.cos(turn) + size**2
    assert plain(determinant_of_return)(head.transfer, 2) == pytest.approx(returned, rel=1e-9)
