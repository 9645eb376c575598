"""A tip that rests at each pixel of a line, there and back: on which branch, and up to which tip offset it keeps it."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.columns import ENGAGED, NOWHERE, UNKNOWN_ORBIT, StableOrbits
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.averages import LockIn, average_periods, begin_lock_in, block_of
from phasemap._kernels.engagement.goal import COARSER_STEPS
from phasemap._kernels.engagement.holding_in_time import state_on
from phasemap._kernels.engagement.in_time import slow_pace
from phasemap._kernels.law import Law, Oscillator, parameters
from phasemap._kernels.orbits.time.tip import Z0, MovingTip, PeriodMap, PeriodResult, Periods


@kernel
def next_branch(orbits: StableOrbits, material: int, branch: int, z0: float) -> tuple[int, int]:
    """Branch of the tip after a pixel to which it comes at tip offset z0, and the number of its orbit there.

    The number is ENGAGED if the tip is on no branch of the material.
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
def walk_line(
    materials: np.ndarray, orbits: StableOrbits, anew: bool, branch: int, z0: float, slots: np.ndarray
) -> tuple[int, float]:
    """Fill in the orbit of each pixel line by line, trace and then retrace; returns the last branch and tip offset.

    `materials` (shape (lines, pixels)): number of the material of each pixel. The tip comes on a `branch` at a tip
    offset z0 [m]; NOWHERE, or at the start of each line `anew`, it is engaged as soon as a material lets it. `slots`
    (shape (2, lines, pixels)) gets the number of the orbit, by direction; its complement ~ where it is unknown whether
    the material has the branch on which the tip came, and the tip went on as if it had not.
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


@kernel
def reach_rows(
    law: Law, rows: np.ndarray, lever: np.ndarray, step_size: float, most_periods: int, orbits: np.ndarray,
    reach: np.ndarray,
) -> None:  # fmt: skip
    """Replace each tip offset in `reach` by the one at which the mean phase changes sign on the way there.

    The tip is raised from `orbits` (shape (n, COLUMNS)) up to `reach` (shape (n,)) [m], which becomes infinite where
    the branch is not left.
    """
    block, up = block_of(lever), (-slow_pace(lever), 0.0, 0.0)
    for i in range(len(rows)):
        u = state_on(law, lever, orbits[i, col.AMPLITUDE], orbits[i])
        tip, lock_in, top = MovingTip(u, PeriodResult(), PeriodMap(), Periods()), LockIn(), reach[i]
        begin_lock_in(lever, tip.acc, lock_in)
        reach[i] = math.inf
        while tip.periods.marched < most_periods and tip.u[Z0] < top:
            if (
                not average_periods(
                    Oscillator(law, parameters(rows[i]), lever), COARSER_STEPS * step_size, block, up, tip, lock_in
                )
                or lock_in.total.period.cos < 0.0
            ):
                reach[i] = tip.u[Z0]
                break
