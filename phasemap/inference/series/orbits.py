"""Averaged orbits over materials, free amplitudes and setpoints: one table for all files of a series.

Where the free amplitude and the setpoint are unknowns beside the materials, thousands of combinations have to be tried.
The table is interpolated to find the likely ones; these are then solved for, from where the table says the orbits are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.threads import bounds_of, chunk_of, spread, workers_of
from phasemap.experiment.lever import lever_of
from phasemap.experiment.microscope import Microscope
from phasemap.inference.images.model import Model

Array = NDArray[np.float64]

COUNTS = (11, 6, 8)  # materials: modulus, adhesion, damping
OF_AMPLITUDE = 0.25  # step of the logarithm of the free amplitude
SIDES = (-1, 1)
EVERY = 6  # settings of which all orbits are looked for; from there, orbits are followed to the others
ROUNDS = 1
HALF = 0.5  # share of a cell's corners where there is an orbit, above which there is one


@dataclass(frozen=True, eq=False)
class Lever:
    """A model of materials under one lever, whose free amplitude may be any."""

    model: Model  # of any settings
    scope: Microscope

    def at(self, amplitudes: Array, ratios: Array) -> Model:
        """The model of images with these free amplitudes at the drive frequency [m] and setpoints."""
        rows = np.tile(lever_of(self.scope), (len(amplitudes), 1))
        rows[:, -2:] *= (amplitudes / self.scope.driven_amplitude)[:, None]  # the drive's amplitude, and the base's
        return replace(self.model, levers=rows, amplitudes=amplitudes * ratios)

    def phases(
        self, logs: Array, amplitudes: Array, ratios: Array, places: Array,
        asked: NDArray[np.bool_] | None = None, search: bool = False,
    ) -> Array:  # fmt: skip
        """Phases [rad] on both branches, shape (2, k), NaN without an orbit; `places` are moved.

        `logs` (shape (k, 3)): of the material, for each setting.
        `amplitudes`, `ratios` (shape (k,)).
        `places` (shape (2, k)).
        `asked` (shape (2, k)): where there may be an orbit at all.
        `search`: whether to look for orbits everywhere where `places` lead nowhere.
        """
        from phasemap._kernels.rows.derivatives import Setpoints, averaged_phases

        asked = np.ones(places.shape, bool) if asked is None else asked
        model, phases = self.at(amplitudes, ratios), np.empty_like(places)
        rows, sides = model.rows(logs), np.array(SIDES, np.int8)[:, np.newaxis] * asked

        def solve(first: int, last: int) -> None:
            some = slice(first, last)
            levers, held = model.levers[some], model.amplitudes[some]
            for side, place, phase in zip(sides, places, phases, strict=True):
                setpoints = Setpoints(levers, held, side[some], place[some])
                averaged_phases(model.law, rows[some], setpoints, search, phase[some])

        cores = workers_of(None)
        spread(solve, bounds_of(len(rows), chunk_of(len(rows), cores, len(rows))), cores, None)
        return phases


@dataclass(frozen=True, eq=False)
class Table:
    """Phases over logarithms of the material, logarithm of the free amplitude [m], and setpoint."""

    axes: list[Array]  # five
    values: Array  # shape (..., 6); phase [rad], place and whether there is an orbit, of both branches

    def look(self, points: Array) -> tuple[Array, Array, Array]:
        """Phases [rad], NaN without an orbit, places, and shares of the corners that have one, shape (2, ...).

        `points` (shape (..., 5)).
        """
        from scipy.interpolate import RegularGridInterpolator

        low, high = np.array([[axis[0], axis[-1]] for axis in self.axes]).T
        inside = np.clip(points, low, high)
        found = RegularGridInterpolator(self.axes, self.values)(inside)
        found = np.moveaxis(found.reshape(*points.shape[:-1], 3, 2), (-2, -1), (0, 1))
        beyond = (points < low - 1e-9).any(axis=-1) | (points > high + 1e-9).any(axis=-1)
        share = np.where(beyond, 0.0, found[2])
        return np.where(share < HALF, np.nan, found[0]), np.where(share > 0, found[1], np.nan), share


def make_table(lever: Lever, reach: Array, amplitudes: tuple[float, float], levels: Array) -> Table:
    """Solve for all nodes, each from where the orbit of its neighbour is.

    `reach` (shape (3,)): largest logarithms of the materials.
    `amplitudes`: least and largest free amplitude [m].
    `levels` (shape (k,)): setpoints, rising, two at least.
    """
    materials = [np.linspace(-most, most, count) for most, count in zip(reach, COUNTS, strict=True)]
    grid = lever.model.centre + np.stack(np.meshgrid(*materials, indexing="ij"), axis=-1).reshape(-1, 3)
    first, last = np.log(amplitudes)
    logs = np.linspace(first, last, max(2, 1 + int(np.ceil((last - first) / OF_AMPLITUDE))))
    shape = len(logs), len(levels)
    places = np.full((*shape, 2, len(grid)), np.nan)
    phases = np.full_like(places, np.nan)
    for (i, size), (j, level) in product(enumerate(np.exp(logs)), enumerate(levels)):
        search = i % EVERY == 0 and j % EVERY == 0
        if search:
            _solve(lever, grid, size, level, phases[i, j], places[i, j], np.full((2, len(grid)), np.nan), search)
    for _ in range(ROUNDS):
        for axis, turn in product((0, 1), (1, -1)):
            _spread(lever, grid, (np.exp(logs), levels), phases, places, axis, turn)
    return Table([*materials, logs, levels], _filled(phases, places, [len(one) for one in materials]))


def _solve(
    lever: Lever, grid: Array, amplitude: float, ratio: float, phases: Array, places: Array, near: Array,
    search: bool = False,
) -> None:  # fmt: skip
    """Fill phases and places of one setting, shape (2, n), where they are not known."""
    some = np.flatnonzero(np.isnan(phases).any(axis=0) & (search | ~np.isnan(near).all(axis=0)))
    if not len(some):
        return
    at = np.where(np.isnan(phases[:, some]), near[:, some], places[:, some])
    found = lever.phases(grid[some], np.full(len(some), amplitude), np.full(len(some), ratio), at, search=search)
    phases[:, some], places[:, some] = found, np.where(np.isnan(found), np.nan, at)


def _spread(
    lever: Lever, grid: Array, settings: tuple[Array, Array], phases: Array, places: Array, axis: int, turn: int
) -> None:
    """Go on from every setting to the next one along an axis."""
    count = len(settings[axis])
    for here in range(1, count) if turn > 0 else range(count - 2, -1, -1):
        for other in range(len(settings[1 - axis])):
            node = (here, other) if axis == 0 else (other, here)
            last = (here - turn, other) if axis == 0 else (other, here - turn)
            size, level = settings[0][node[0]], settings[1][node[1]]
            _solve(lever, grid, float(size), float(level), phases[node], places[node], places[last])


def _filled(phases: Array, places: Array, counts: list[int]) -> Array:
    """Values for interpolation: beyond the end of a branch, those of the nearest node that has an orbit."""
    from scipy.ndimage import distance_transform_edt

    amplitudes, ratios = phases.shape[:2]
    parts = np.zeros((*counts, amplitudes, ratios, 3, 2))
    for branch in range(2):
        there = ~np.isnan(phases[:, :, branch]).reshape(amplitudes, ratios, *counts)
        there = np.moveaxis(there, (0, 1), (3, 4))
        parts[..., 2, branch] = there
        if not there.any():
            continue
        nearest = tuple(distance_transform_edt(~there, return_distances=False, return_indices=True))
        for k, values in enumerate((phases, places)):
            whole = np.moveaxis(values[:, :, branch].reshape(amplitudes, ratios, *counts), (0, 1), (3, 4))
            parts[..., k, branch] = whole[nearest]
    return parts.reshape(*counts, amplitudes, ratios, 6)
