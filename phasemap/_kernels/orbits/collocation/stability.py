"""Stability of an exact orbit, from its monodromy matrix: theory, Eq. (stability-3)."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels.compilation import kernel
from phasemap._kernels.numerics import MOST_SQUARINGS, factor, spectral_radius


@kernel
def monodromy_matrix(transfer: np.ndarray, states: int) -> np.ndarray:
    """Return the monodromy matrix that stands row by row in the head of an orbit."""
    m = np.empty((states, states))
    for i in range(states):
        for j in range(states):
            m[i, j] = transfer[states * i + j]
    return m


@kernel
def floquet(transfer: np.ndarray, states: int) -> float:
    """Return the largest modulus of the multipliers of a monodromy matrix: theory, Eq. (stability-3)."""
    if states > 2:
        return spectral_radius(monodromy_matrix(transfer, states), MOST_SQUARINGS)
    half = 0.5 * (transfer[0] + transfer[3])
    product = transfer[0] * transfer[3] - transfer[1] * transfer[2]
    root = half * half - product
    if root <= 0.0:
        return math.sqrt(max(product, 0.0))
    return abs(half) + math.sqrt(root)


@kernel
def determinant_of_return(transfer: np.ndarray, states: int) -> float:
    """Determinant of one less the monodromy matrix: it changes sign where a multiplier passes one."""
    m, order, determinant = -monodromy_matrix(transfer, states), np.empty(states, np.int64), 1.0
    for i in range(states):
        m[i, i] += 1.0
    if not factor(m, states, order):
        return 0.0
    for i in range(states):
        determinant *= m[i, i] if order[i] == i else -m[i, i]
    return determinant
