"""Loops in place of what numba compiles at length: `a[:] = b` with the text of an error, which takes 2 to 4 s."""

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


@kernel
def smaller(row: np.ndarray, x: float, or_equal: bool) -> int:
    """How many entries of a sorted row are smaller than x, or equal to it; `searchsorted` takes 0.7 s to compile."""
    low, high = 0, len(row)
    while low < high:
        middle = (low + high) // 2
        if row[middle] < x or (or_equal and row[middle] == x):
            low = middle + 1
        else:
            high = middle
    return low
