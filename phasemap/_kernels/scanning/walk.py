"""Which branch the tip is on at each pixel of a line, there and back."""

from __future__ import annotations

import numpy as np
from numba import njit

from phasemap._kernels.law import OPTIONS
from phasemap._kernels.scanning.slots import ENGAGED, NOWHERE


@njit(**OPTIONS)
def step(stable: np.ndarray, engaged: np.ndarray, material: int, branch: int) -> tuple[int, int]:
    """Branch of the tip after a pixel, and which of the material's orbits it is on there: ENGAGED if on none."""
    if branch == NOWHERE:
        branch = engaged[material]
        return branch, ENGAGED if branch == NOWHERE else branch
    if stable[branch, material]:
        return branch, branch
    if stable[1 - branch, material]:
        return 1 - branch, 1 - branch
    return branch, ENGAGED


@njit(**OPTIONS)
def walk(
    materials: np.ndarray, stable: np.ndarray, engaged: np.ndarray, anew: bool, branch: int, slots: np.ndarray
) -> int:
    """Fill `slots` line by line, trace and then retrace; returns the branch that is left at the end.

    Parameters
    ----------
    materials : ndarray of int, shape (lines, pixels)
        Number of the material of each pixel.
    stable : ndarray of bool, shape (2, n)
        Whether a material has an orbit that holds the setpoint, on each branch.
    engaged : ndarray of int, shape (n,)
        Branch to which engagement from far leads, or NOWHERE.
    anew : bool
        Engage at the start of each line.
    branch : int
        On which the tip comes, or NOWHERE: then it is engaged as soon as a material lets it.
    slots : ndarray of int, shape (2, lines, pixels)
        Receives the number of the orbit, by direction.
    """
    lines, pixels = materials.shape
    for y in range(lines):
        if anew:
            branch = NOWHERE
        for x in range(pixels):
            branch, slots[0, y, x] = step(stable, engaged, materials[y, x], branch)
        for x in range(pixels - 1, -1, -1):
            branch, slots[1, y, x] = step(stable, engaged, materials[y, x], branch)
    return branch
