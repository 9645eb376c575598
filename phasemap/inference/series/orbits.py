"""Averaged orbits over materials, free amplitudes and setpoints: one table for all files of a series.

Where the free amplitude and the setpoint are unknowns beside the materials, thousands of combinations have to be tried.
The table is interpolated to find the likely ones; these are then solved for, from where the table says the orbits are.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from phasemap.inference.images.model import Model

Array = NDArray[np.float64]

COUNTS = (11, 6, 8)  # materials: modulus, adhesion, damping
OF_AMPLITUDE = 0.25  # step of the logarithm of the free amplitude
EVERY = 6  # settings of which all orbits are looked for; from there, orbits are followed to the others


@dataclass(frozen=True, eq=False)
class Table:
    """Places of orbits over logarithms of the material, logarithm of the free amplitude [m], and setpoint."""

    axes: list[Array]  # five
    values: Array  # shape (..., 4); of both branches, the place of the orbit, and 1 where there is one

    def look(self, points: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Places, and whether there may be an orbit, shape (2, k), at points, shape (k, 5)."""
        from scipy.interpolate import RegularGridInterpolator

        ends = np.array([[axis[0], axis[-1]] for axis in self.axes]).T
        inside = np.clip(points, *ends)
        found = RegularGridInterpolator(self.axes, self.values)(inside).T
        there = (found[2:] > 0) & (np.abs(points - inside) < 1e-9).all(axis=1)
        return np.where(there, found[:2], np.nan), there


def make_table(model: Model, reach: Array, amplitudes: tuple[float, float], levels: Array) -> Table:
    """Solve for all nodes, each from where the orbit of its neighbour is.

    `reach` (shape (3,)): largest logarithms of the materials.
    `amplitudes`: least and largest free amplitude [m].
    `levels` (shape (k,)): setpoints, rising, two at least.
    """
    materials = [np.linspace(-most, most, count) for most, count in zip(reach, COUNTS, strict=True)]
    grid = np.stack(np.meshgrid(*materials, indexing="ij"), axis=-1).reshape(-1, 3)
    first, last = np.log(amplitudes)
    logs = np.linspace(first, last, max(2, 1 + int(np.ceil((last - first) / OF_AMPLITUDE))))
    places = np.full((len(logs), len(levels), 2, len(grid)), np.nan)

    def solve(node: tuple[int, int], near: Array, search: bool) -> None:
        """Find orbits of one setting that are not known, from those of another or anywhere."""
        here = places[node]
        some = np.flatnonzero(np.isnan(here).any(axis=0) & (search | ~np.isnan(near).all(axis=0)))
        if len(some):
            at = np.where(np.isnan(here[:, some]), near[:, some], here[:, some])
            sizes, ratios = np.full(len(some), np.exp(logs[node[0]])), np.full(len(some), levels[node[1]])
            found = model.at_settings(sizes, ratios).phases(grid[some], at, search=search)
            here[:, some] = np.where(np.isnan(found), np.nan, at)

    every = list(product(range(len(logs)), range(len(levels))))
    for i, j in every:
        if i % EVERY == 0 and j % EVERY == 0:
            solve((i, j), places[i, j], True)
    for step in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        for i, j in every if sum(step) > 0 else reversed(every):
            before = i - step[0], j - step[1]
            if min(before) >= 0 and before[0] < len(logs) and before[1] < len(levels):
                solve((i, j), places[before], False)
    counts = *places.shape[:2], *COUNTS
    whole = np.moveaxis(places.transpose(2, 0, 1, 3).reshape(2, *counts), (0, 1, 2), (-1, 3, 4))
    return Table([*materials, logs, levels], np.concatenate([_filled(whole), ~np.isnan(whole)], axis=-1))


def _filled(places: Array) -> Array:
    """Places for interpolation: beyond the end of a branch, those of the nearest node that has an orbit."""
    from scipy.ndimage import distance_transform_edt

    filled = np.zeros_like(places)
    for branch in range(2):
        lost = np.isnan(places[..., branch])
        if not lost.all():
            nearest = distance_transform_edt(lost, return_distances=False, return_indices=True)
            filled[..., branch] = places[..., branch][tuple(nearest)]
    return filled
