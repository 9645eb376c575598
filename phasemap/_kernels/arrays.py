"""Copies from array to array by loops: numba compiles `a[:] = b` with the text of an error, 2 to 4 s of it."""

from __future__ import annotations

import numpy as np

from phasemap._kernels.compilation import kernel


@kernel
def copy(source: np.ndarray, to: np.ndarray) -> None:
    """Copy the entries of one row into the first of another."""
    for j in range(len(source)):
        to[j] = source[j]


@kernel
def copy_rows(source: np.ndarray, to: np.ndarray) -> None:
    """Copy the rows of one array, shape (n, m), into the first of another."""
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            to[i, j] = source[i, j]
