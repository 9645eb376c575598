"""Where the joint fit of regions starts: branches and materials that roughly agree with the data.

What one region's material leaves of its data are the zeros; with these, every other region stands alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap.inference.images.stack import HEIGHT, PHASE, Stack
from phasemap.inference.images.zeros import FREE, SHARED

Array = NDArray[np.float64]
Codes = NDArray[np.int8]

MOST = 24  # starts
OF_A_KIND = 4  # of them with the same branches
TOGETHER = 64  # sets of zeros that are ranked at a time
SEPARATE = 1.5  # in a logarithm, between starts with the same branches
COARSE = np.array([np.radians(2.0), 0.5e-9])  # by which a grid of materials misses the data


class Starts(NamedTuple):
    """Logarithms of the unknown regions, shape (n, 3 u), and branches, shape (n, r, m)."""

    q: Array
    sides: Codes


@dataclass(frozen=True, eq=False)
class Candidates:
    """Materials a region may be of."""

    q: Array  # shape (g, 3)
    # shape (2, g, m, 2); phase [rad] and tip offset [m] on the attractive and the repulsive branch; NaN without
    # an orbit
    values: Array
    cost: Array  # shape (g,); of the prior


def patterns(stack: Stack) -> Codes:
    """Branches that a region may be on, shape (patterns, images).

    The amplitude that is taken away, free less setpoint, makes a tip repulsive: from some value on, it is.
    """
    drop = [(1 - ratio) * one.driven_amplitude for ratio, one in zip(stack.setpoints, stack.scopes, strict=True)]
    order = np.argsort(np.argsort(drop, kind="stable"), kind="stable")
    return np.array([np.where(order < first, -1, 1) for first in range(len(drop) + 1)], np.int8)


def make_starts(
    stack: Stack, candidates: list[Candidates], known: list[int], kinds: tuple[str | None, str | None],
    sides: Codes | None,
) -> Starts:  # fmt: skip
    """Rank pairs of materials and branches.

    `stack`: regions; zeros that are known are taken off.
    `known`: regions that are of a known material.
    `kinds`: of the zeros of phase and height, as of `Plan`.
    `sides` (shape (regions, images)): branches, if they are known.
    """
    regions = len(stack)
    first = known[0] if known else 0
    some = patterns(stack) if sides is None else sides[first : first + 1]
    seen = np.isfinite(stack.errors)
    pool = _pool(candidates[first], some)
    apart = np.where(seen[first], stack.values[first] - pool.values, np.nan)
    zeros = np.stack([_zero(apart[..., channel], kinds[channel]) for channel in (PHASE, HEIGHT)], axis=-1)
    cost = pool.cost + _misfit(apart - zeros)
    chosen = {first: (pool.which, np.where(seen[first].any(axis=-1), pool.sides, 0))}
    for region in range(regions):
        if region == first:
            continue
        own = None if sides is None else sides[region]
        there = candidates[region]
        best, branches, more = _others(stack.values[region], seen[region], zeros, there, own)
        cost = cost + more
        chosen[region] = best, branches
    q = np.concatenate(
        [candidates[region].q[chosen[region][0]] for region in range(regions) if region not in known], axis=1
    )
    both = np.stack([chosen[region][1] for region in range(regions)], axis=1).astype(np.int8)
    return _spread(q, both, cost)


class _Pool(NamedTuple):
    which: NDArray[np.intp]
    values: Array
    cost: Array
    sides: Codes


def _pool(candidates: Candidates, allowed: Codes) -> _Pool:
    """All materials on all patterns of branches that they have orbits on."""
    images = np.arange(allowed.shape[1])
    which, values, sides = [], [], []
    for pattern in allowed:
        there = candidates.values[(pattern > 0).astype(int), :, images].transpose(1, 0, 2)
        there = np.where((pattern == 0)[None, :, None], 0.0, there)
        usable = np.flatnonzero(np.isfinite(there).all(axis=(1, 2)))
        which.append(usable)
        values.append(there[usable])
        sides.append(np.repeat(pattern[None], len(usable), axis=0))
    index = np.concatenate(which)
    return _Pool(index, np.concatenate(values), candidates.cost[index], np.concatenate(sides))


def _zero(apart: Array, kind: str | None) -> Array:
    """What data of the first region leave for the zeros of each image, shape (candidates, images)."""
    if kind == FREE:
        return np.nan_to_num(apart)
    if kind == SHARED:
        return np.repeat(np.nan_to_num(_mean(apart)), apart.shape[1], axis=1)
    return np.zeros_like(apart)


def _mean(values: Array) -> Array:
    """Mean over the images that have data, kept as an axis."""
    there = np.isfinite(values)
    mean: Array = np.where(there, values, 0.0).sum(axis=-1, keepdims=True) / np.maximum(there.sum(-1, keepdims=True), 1)
    return mean


def _misfit(apart: Array) -> Array:
    """chi2 on the scale of the grid, shape (...), of phases and of how heights change."""
    apart = apart.copy()
    apart[..., HEIGHT] -= _mean(apart[..., HEIGHT])
    misfit: Array = (np.nan_to_num(apart / COARSE) ** 2).sum(axis=(-1, -2))
    return misfit


def _others(
    data: Array, seen: NDArray[np.bool_], zeros: Array, there: Candidates, sides: Codes | None
) -> tuple[NDArray[np.intp], Codes, Array]:
    """Best material and branches of a region for each set of zeros, and its cost."""
    best, cost = np.zeros(len(zeros), np.intp), np.zeros(len(zeros))
    branches = np.zeros((len(zeros), len(data)), np.int8)
    there_is = np.isfinite(there.values[..., PHASE])  # (2, g, m)
    for some in np.array_split(np.arange(len(zeros)), len(zeros) // TOGETHER + 1):
        apart = np.where(seen, data - zeros[some, None, None] - there.values, np.nan)  # (n, 2, g, m, 2)
        far = np.where(there_is, np.abs(np.nan_to_num(apart[..., PHASE])), np.inf)
        upper = far[:, 1] < far[:, 0] if sides is None else np.broadcast_to(sides > 0, far[:, 0].shape)
        taken = np.where(upper[..., None], apart[:, 1], apart[:, 0])
        possible = np.where(upper, there_is[1], there_is[0]) | ~seen.any(axis=-1)
        total = np.where(possible.all(axis=-1), _misfit(taken) + there.cost, np.inf)
        rows = np.arange(len(some))
        best[some] = np.argmin(total, axis=1)
        cost[some] = total[rows, best[some]]
        branches[some] = np.where(seen.any(axis=-1), np.where(upper[rows, best[some]], 1, -1), 0)
    return best, branches, cost


def _spread(q: Array, sides: Codes, cost: Array) -> Starts:
    """The best few, not all alike."""
    taken: list[int] = []
    alike: dict[bytes, list[int]] = {}
    for i in np.argsort(cost, kind="stable"):
        if len(taken) == MOST or not np.isfinite(cost[i]):
            break
        near = alike.setdefault(sides[i].tobytes(), [])
        if len(near) < OF_A_KIND and all(np.abs(q[i] - q[j]).max() > SEPARATE for j in near):
            near.append(int(i))
            taken.append(int(i))
    return Starts(q[taken], sides[taken])
