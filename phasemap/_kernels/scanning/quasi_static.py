"""Branch of the tip at each pixel of a line, there and back, where it rests at each."""

from __future__ import annotations

import numpy as np

from phasemap._kernels.columns import ENGAGED, NOWHERE
from phasemap._kernels.compilation import kernel
from phasemap._kernels.scanning.slots import UNKNOWN_ORBIT, Orbits


@kernel
def next_branch(orbits: Orbits, material: int, branch: int, z0: float) -> tuple[int, int]:
    """Branch of the tip after a pixel to which it comes at tip offset z0, and the number of its orbit there.

    That is ENGAGED if it is on none of the material's.
    """
    if branch == NOWHERE:
        branch = orbits.engaged[material]
        return branch, ENGAGED if branch == NOWHERE else branch
    if orbits.stable[branch, material] > 0 and not z0 > orbits.reach[branch, material]:
        return branch, branch
    if orbits.stable[1 - branch, material] > 0:
        return 1 - branch, 1 - branch
    return branch, ENGAGED


@kernel
def walk(
    materials: np.ndarray, orbits: Orbits, anew: bool, branch: int, z0: float, slots: np.ndarray
) -> tuple[int, float]:
    """Fill in the orbit of each pixel line by line, trace and then retrace; returns the last branch and tip offset.

    Parameters
    ----------
    materials : ndarray of int, shape (lines, pixels)
        Number of the material of each pixel.
    orbits : Orbits
    anew : bool
        Engage at the start of each line.
    branch : int
        On which the tip comes, or NOWHERE: then it is engaged as soon as a material lets it.
    z0 : float
        Tip offset at which it comes [m].
    slots : ndarray of int, shape (2, lines, pixels)
        Receives the number of the orbit, by direction; its complement ~ if the tip came on a branch of which it is
        unknown whether the material has it, and went on as if it had not.
    """
    lines, pixels = materials.shape
    for y in range(lines):
        if anew:
            branch = NOWHERE
        for i in range(2 * pixels):
            way = i // pixels
            x = i if way == 0 else 2 * pixels - 1 - i
            material = materials[y, x]
            guessed = branch != NOWHERE and orbits.stable[branch, material] == UNKNOWN_ORBIT
            branch, slot = next_branch(orbits, material, branch, z0)
            if not np.isnan(orbits.offsets[slot, material]):
                z0 = orbits.offsets[slot, material]
            slots[way, y, x] = ~slot if guessed else slot
    return branch, z0
