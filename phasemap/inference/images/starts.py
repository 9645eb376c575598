"""Where the joint fit of regions starts: branches and materials that roughly agree with the data.

What one region's material leaves of its data are the zeros; with these, every other region stands alone like a pixel.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from phasemap.inference.images.grid import Grid, nearest
from phasemap.inference.images.model import Model
from phasemap.inference.images.problem import problem_of_pixels
from phasemap.inference.images.stack import HEIGHT, PHASE, Stack
from phasemap.inference.images.zeros import FREE, SHARED, Plan

Array = NDArray[np.float64]
Codes = NDArray[np.int8]

MOST = 24  # starts
OF_A_KIND = 4  # of them with the same branches
SEPARATE = 1.5  # in a logarithm, between starts with the same branches
COARSE = np.array([np.radians(2.0), 0.5e-9])  # by which a grid of materials misses the data


def make_starts(
    model: Model, stack: Stack, grids: list[Grid], known: list[int], plan: Plan, sides: Codes | None
) -> tuple[Array, Codes]:
    """Logarithms of the unknown regions, shape (n, 3 u), and branches, shape (n, r, m).

    `stack`: regions; zeros that are known are taken off.
    `grids`: materials that each region may be of; one where it is known.
    `sides` (shape (regions, images)): branches, if they are known.
    """
    regions, first = len(stack), known[0] if known else 0
    seen = np.isfinite(stack.errors)
    coarse = Stack(stack.values, np.where(seen, COARSE, np.inf), stack.scopes, stack.setpoints)
    some = _patterns(stack) if sides is None else sides[first : first + 1]
    parts = [grids[first].on(pattern) for pattern in some]
    which = {first: np.concatenate([usable for usable, _ in parts])}
    branches = {first: np.repeat(some, [len(usable) for usable, _ in parts], axis=0)}
    apart = np.where(seen[first], stack.values[first] - np.concatenate([values for _, values in parts]), np.nan)
    zeros = np.stack([_zero(apart[..., c], kind) for c, kind in ((PHASE, plan.phase), (HEIGHT, plan.height))], axis=-1)
    rest = np.nan_to_num(apart - zeros)
    rest[..., HEIGHT] = np.where(seen[first][:, HEIGHT], rest[..., HEIGHT] - _mean((apart - zeros)[..., HEIGHT]), 0.0)
    cost = ((rest / COARSE) ** 2).sum(axis=(1, 2)) + _prior(model, grids[first])[which[first]]
    for region in range(regions):
        if region == first:
            continue
        values = np.where(seen[region], coarse.values[region] - zeros, 0.0)
        errors = np.repeat(coarse.errors[region : region + 1], len(zeros), axis=0)
        pixels = problem_of_pixels(model, replace(coarse, values=values, errors=errors))
        if sides is not None:
            pixels = replace(pixels, sides=np.repeat(sides[None, region : region + 1], len(zeros), axis=0))
        best, more = nearest(pixels, grids[region], 1)
        which[region], branches[region] = best[:, 0], pixels.sides[:, 0]
        cost = cost + more[:, 0]
    q = np.concatenate([grids[r].q[which[r]] for r in range(regions) if r not in known], axis=1)
    both = np.stack([np.where(seen[r].any(axis=-1), branches[r], 0) for r in range(regions)], axis=1)
    return _spread(q, both.astype(np.int8), cost)


def _patterns(stack: Stack) -> Codes:
    """Branches that a region may be on, shape (patterns, images).

    The amplitude that is taken away, free less setpoint, makes a tip repulsive: from some value on, it is.
    """
    drop = [(1 - ratio) * one.driven_amplitude for ratio, one in zip(stack.setpoints, stack.scopes, strict=True)]
    order = np.argsort(np.argsort(drop, kind="stable"), kind="stable")
    return np.array([np.where(order < first, -1, 1) for first in range(len(drop) + 1)], np.int8)


def _prior(model: Model, grid: Grid) -> Array:
    """chi2 of the prior, shape (g,)."""
    cost: Array = (((grid.q - model.centre) / model.widths) ** 2).sum(axis=1)
    return cost


def _zero(apart: Array, kind: str | None) -> Array:
    """What data of the first region leave for the zeros of each image, shape (candidates, images)."""
    if kind == FREE:
        return np.nan_to_num(apart)
    return np.repeat(np.nan_to_num(_mean(apart)), apart.shape[1], axis=1) if kind == SHARED else np.zeros_like(apart)


def _mean(values: Array) -> Array:
    """Mean over the images that have data, kept as an axis."""
    there = np.isfinite(values)
    mean: Array = np.where(there, values, 0.0).sum(axis=-1, keepdims=True) / np.maximum(there.sum(-1, keepdims=True), 1)
    return mean


def _spread(q: Array, sides: Codes, cost: Array) -> tuple[Array, Codes]:
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
    return q[taken], sides[taken]
