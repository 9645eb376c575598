"""Unknowns of a series, and the likelihood of the data.

Where the free amplitude and the setpoint are unknowns beside the materials, thousands of combinations have to be tried.
A table of averaged orbits is interpolated to find the likely ones; these are then solved for, from where the table says
the orbits are. The sign of the phase, the branch of every region and the zeros of the phase are summed and integrated
over at each sample, and drawn afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator
from scipy.ndimage import distance_transform_edt
from scipy.special import ndtr

from phasemap._shared.arrays import Array, within_half_a_turn
from phasemap.inference.images.model import Model
from phasemap.inference.images.stack import FREE, SHARED
from phasemap.inference.sampling import REACH
from phasemap.inference.series.settings import HELD, Settings

Indices = NDArray[np.intp]

COUNTS = (11, 6, 8)  # materials: modulus, adhesion, damping
OF_AMPLITUDE = 0.25  # step of the logarithm of the free amplitude
EVERY = 6  # settings of which all orbits are looked for; from there, orbits are followed to the others

OTHER = 0.25  # chance that of two branches the tip is on the one that it does not meet first
WORSE = 3.0  # factor of the errors that is one standard deviation beyond the middle, where they are as stated
MOST = 16  # ways to be on the branches in the files of one zero that are followed
ALL = np.newaxis


@dataclass(frozen=True, eq=False)
class PlaceTable:
    """Places of orbits over logarithms of the material, logarithm of the free amplitude [m], and setpoint.

    Of a single material, over the last two alone.
    """

    axes: list[Array]  # five, or two
    values: Array  # shape (..., 4); of both branches, the place of the orbit, and 1 where there is one

    def look(self, points: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Interpolated places of orbits, and whether there may be an orbit, shape (2, k), at points, shape (k, 5)."""
        points = points[:, -len(self.axes) :]
        ends = np.array([[axis[0], axis[-1]] for axis in self.axes]).T
        inside = np.clip(points, *ends)
        interpolated = RegularGridInterpolator(self.axes, self.values)(inside).T
        exists = (interpolated[2:] > 0) & (np.abs(points - inside) < 1e-9).all(axis=1)
        return np.where(exists, interpolated[:2], np.nan), exists


def make_table(model: Model, reach: Array | None, amplitudes: tuple[float, float], levels: Array) -> PlaceTable:
    """Solve for all nodes, each from where the orbit of its neighbour is.

    `reach`: largest logarithms of the materials; None for the model's reference alone. `amplitudes`: least and largest
    free amplitude [m]. `levels`: setpoints, rising, two at least.
    """
    sought = () if reach is None else zip(reach, COUNTS, strict=True)
    materials = [np.linspace(-most, most, count) for most, count in sought]
    grid = np.stack(np.meshgrid(*materials, indexing="ij"), axis=-1).reshape(-1, 3) if materials else np.zeros((1, 3))
    first, last = np.log(amplitudes)
    logs = np.linspace(first, last, max(2, 1 + int(np.ceil((last - first) / OF_AMPLITUDE))))
    places = np.full((len(logs), len(levels), 2, len(grid)), np.nan)

    def solve(node: tuple[int, int], near: Array, search: bool) -> None:
        """Find orbits of one setting that are not known, from those of another or anywhere."""
        here = places[node]
        wanted = np.flatnonzero(np.isnan(here).any(axis=0) & (search | ~np.isnan(near).all(axis=0)))
        if len(wanted):
            at = np.where(np.isnan(here[:, wanted]), near[:, wanted], here[:, wanted])
            sizes, ratios = np.full(len(wanted), np.exp(logs[node[0]])), np.full(len(wanted), levels[node[1]])
            phases = model.at_settings(sizes, ratios).phases(grid[wanted], at, search=search)
            here[:, wanted] = np.where(np.isnan(phases), np.nan, at)

    every = list(product(range(len(logs)), range(len(levels))))
    for i, j in every:
        if i % EVERY == 0 and j % EVERY == 0:
            solve((i, j), places[i, j], True)
    for step in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        for i, j in every if sum(step) > 0 else reversed(every):
            before = i - step[0], j - step[1]
            if min(before) >= 0 and before[0] < len(logs) and before[1] < len(levels):
                solve((i, j), places[before], False)
    counts = [len(axis) for axis in (*materials, logs, levels)]
    whole = places.transpose(3, 0, 1, 2).reshape(*counts, 2)
    return PlaceTable([*materials, logs, levels], np.concatenate([_filled(whole), ~np.isnan(whole)], axis=-1))


def _filled(places: Array) -> Array:
    """Places for interpolation: beyond the end of a branch, those of the nearest node that has an orbit."""
    filled = np.zeros_like(places)
    for branch in range(2):
        lost = np.isnan(places[..., branch])
        if not lost.all():
            nearest = distance_transform_edt(lost, return_distances=False, return_indices=True)
            filled[..., branch] = places[..., branch][tuple(nearest)]
    return filled


class State(NamedTuple):
    """Physical values of n combinations."""

    logs: Array  # shape (n, r, 3); of the materials over those of the reference
    # amplitudes, ratios: shape (n, m); free amplitudes at the drive frequency [m], and setpoints
    amplitudes: Array
    ratios: Array
    growth: Array  # shape (n,); discrepancy: factor by which errors are larger than stated, 1 at least


class Explained(NamedTuple):
    """Likelihood of the data by n combinations, with sign, branches and zeros drawn."""

    phases: Array  # shape (n, r, m); as recorded, without zeros [degree]
    sign: Array  # shape (n,); 1 or -1
    repulsive: NDArray[np.bool_]  # shape (n, r, m)
    zeros: Array  # shape (n, m) [degree]


class _Ways(NamedTuple):
    """K ways to be on the branches in the files of one zero, for n combinations."""

    logs: Array  # shape (n, K); logarithms of their likelihoods
    zeros: Array  # shape (n, K) [degree]
    chosen: Indices  # shape (n, K, files); which combination of branches


class Part(NamedTuple):
    """Regions that have one model: all that are sought, or one whose material is known, which is its reference."""

    regions: Indices
    model: Model  # of any settings
    table: PlaceTable
    known: bool

    def solved(self, logs: Array, amplitudes: Array, ratios: Array) -> Array:
        """Phases [degree] of averaged orbits on both branches, shape (2, n, regions, m), NaN without an orbit.

        They count from that of the free lever, as recorded ones do.

        `logs` (shape (n, r, 3)): of all regions; `amplitudes` [m] and `ratios`, shape (n, m).
        """
        count, regions, files = len(logs), len(self.regions), amplitudes.shape[1]
        points = np.zeros((count, regions, files, 5))
        if not self.known:
            points[..., :3] = logs[:, self.regions, ALL]
        points[..., 3], points[..., 4] = np.log(amplitudes)[:, ALL], ratios[:, ALL]
        flat = points.reshape(-1, 5)
        places, exists = self.table.look(flat)
        phases = self.model.at_settings(np.exp(flat[:, 3]), flat[:, 4]).phases(flat[:, :3], places, exists)
        return np.degrees(phases.reshape(2, count, regions, files)) - self.model.scope.free_phase

    def everywhere(self, logs: Array, amplitude: float, ratios: Array) -> Array:
        """Phases as of `solved` of a combination, shape (r, 3), at setpoints, shape (2, regions, k), without table."""
        count, points = len(self.regions), len(ratios)
        at = np.full((2, count * points), np.nan)
        model = self.model.at_settings(np.full(count * points, amplitude), np.tile(ratios, count))
        logs = np.zeros((count, 3)) if self.known else logs[self.regions]
        phases = model.phases(np.repeat(logs, points, axis=0), at, search=True)
        return np.degrees(phases).reshape(2, count, points) - self.model.scope.free_phase


@dataclass(frozen=True, eq=False)
class SeriesProblem:
    """Unknowns, each normal with standard deviation 1 and cut off at `REACH`, and the data."""

    parts: tuple[Part, ...]  # first what is sought, then each region that is known
    settings: Settings
    # values, errors: shape (r, m); median phases as recorded and their standard errors [degree]; infinite errors
    # where there is no datum
    values: Array
    errors: Array
    known: Array  # shape (r, 3); logarithms of the materials that are given, NaN where they are sought
    widths: Array  # shape (3,); standard deviations of the logarithms by the prior

    @property
    def model(self) -> Model:
        """The model of the regions whose material is sought."""
        return self.parts[0].model

    @property
    def unknown(self) -> Indices:
        """Regions whose material is sought."""
        return np.flatnonzero(np.isnan(self.known).any(axis=1))

    @property
    def names(self) -> list[str]:
        """Names of the unknowns."""
        named = [f"{name} {r}" for r in self.unknown for name in ("modulus", "adhesion", "damping")]
        count = self.settings.tune_count
        tunes = [f", tune {k}" for k in range(count)] if count > 1 else [""]
        named += [f"scale of the free amplitude{one}" for one in tunes]
        if self.settings.amplitude == FREE:
            named += [f"free amplitude of file {i}" for i in range(len(self.settings))]
        if self.settings.setpoint == SHARED:
            named += [f"setpoint{one}" for one in tunes]
        return [*named, "discrepancy"]

    def state(self, x: Array) -> State:
        """Physical values at standard ones, shape (n, p)."""
        count, files, tunes = len(x), len(self.settings), self.settings.tune_count
        sizes = 3 * len(self.unknown), tunes, files * (self.settings.amplitude == FREE)
        materials, scale, by_file, level = np.split(x[:, :-1], np.cumsum(sizes), axis=1)
        logs = np.repeat(self.known[ALL], count, axis=0)
        logs[:, self.unknown] = (materials * np.tile(self.widths, len(self.unknown))).reshape(count, -1, 3)
        by_file = by_file if by_file.shape[1] else np.zeros((count, files))
        return State(logs, *self.settings.at(scale, by_file, _share(level)), WORSE ** np.maximum(x[:, -1], 0.0))

    def solved(self, state: State) -> Array:
        """Phases [degree] of averaged orbits on both branches, shape (2, n, r, m), NaN without an orbit."""
        phases = np.empty((2, len(state.logs), *self.values.shape))
        for part in self.parts:
            phases[:, :, part.regions] = part.solved(state.logs, state.amplitudes, state.ratios)
        return phases

    def branches(self, logs: Array, amplitude: float, ratios: Array) -> Array:
        """Phases [degree] of a combination (shape (r, 3)) at setpoints, shape (2, r, k); NaN without an orbit."""
        phases = np.empty((2, len(self.values), len(ratios)))
        for part in self.parts:
            phases[:, part.regions] = part.everywhere(logs, amplitude, ratios)
        return phases

    def likelihood(self, x: Array) -> Array:
        """Logarithm of the likelihood, shape (n,)."""
        state = self.state(x)
        solved = self.solved(state)
        signed = [sum(_total(ways.logs) for ways in self._ways(solved, state.growth, sign)[0]) for sign in self._signs]
        return _total(np.stack(signed, axis=1)) - np.log(len(signed))

    def explained(self, x: Array, seed: int) -> Explained:
        """Sign, branches and zeros drawn for each combination; zeros are those expected of materials and branches."""
        rng = np.random.default_rng(seed)
        state = self.state(x)
        solved, narrow = self.solved(state), self._narrow(state.growth)
        parts = [self._ways(solved, state.growth, sign) for sign in self._signs]
        every = np.arange(len(x))
        turned = _drawn(np.stack([sum(_total(ways.logs) for ways in part[0]) for part in parts], axis=1), rng)
        chosen, zeros = np.empty((len(x), self.values.shape[1]), np.intp), np.empty((len(x), self.values.shape[1]))
        for which, (groups, means) in enumerate(parts):
            mine = turned == which
            for ways, files in zip(groups, self._groups, strict=True):
                best = _drawn(ways.logs, rng)
                taken = ways.chosen[every, best]
                common = ways.zeros[every, best, ALL]
                # Of a file's difference, the share that is its own zero's beside noise.
                gain = self._loose[files] / (self._loose[files] + narrow[:, files])
                apart = within_half_a_turn(means[taken, every[:, ALL], files] - common)
                chosen[np.ix_(mine, files)] = taken[mine]
                zeros[np.ix_(mine, files)] = (common + gain * apart)[mine]
        repulsive = self._patterns[chosen].transpose(0, 2, 1) > 0
        sign = np.array(self._signs, float)[turned]
        lower, upper = np.nan_to_num(solved)
        return Explained(sign[:, ALL, ALL] * np.where(repulsive, upper, lower), sign, repulsive, zeros)

    @property
    def _signs(self) -> tuple[int, ...]:
        """Signs of the recorded phase that are possible: the one that is known, or both."""
        return (1, -1) if self.settings.sign is None else (self.settings.sign,)

    @property
    def _groups(self) -> list[Indices]:
        """Files that have one unknown zero, or each file by itself."""
        if self.settings.zero != SHARED:
            return [np.array([i]) for i in range(len(self.settings))]
        return [np.flatnonzero(self.settings.tunes == k) for k in range(self.settings.tune_count)]

    @property
    def _patterns(self) -> Indices:
        """Branches of the regions in one file, shape (2^r, r)."""
        return np.array(list(product((0, 1), repeat=len(self.values))))

    @property
    def _loose(self) -> Array:
        """Variance of the zero of each file about what it has in common with others [degree^2]."""
        return self.settings.zero_errors**2

    def _narrow(self, growth: Array) -> Array:
        """Variance of the zero of each file by its own data, shape (n, m) [degree^2]."""
        precision: Array = (1 / self.errors**2).sum(axis=0)
        return np.where(precision > 0, growth[:, ALL] ** 2 / np.maximum(precision, 1e-30), 1e30)

    def _ways(self, solved: Array, growth: Array, sign: int) -> tuple[list[_Ways], Array]:
        """Ways to explain the files of each zero, and zeros of the files by themselves, shape (2^r, n, m).

        Where the tip may be on either branch, both count, the one it meets first for more: the attractive one, if it
        goes on without a gap to larger setpoints.
        """
        exists = ~np.isnan(solved)
        left = (~exists[0]).astype(float) @ self.settings.above > 0  # a gentler file has no attractive orbit
        before = np.where(left, OTHER, 1 - OTHER)
        first = np.where(exists[0], np.where(exists[1], before, 1.0), 0.0)
        second = np.where(exists[1], np.where(exists[0], 1 - before, 1.0), 0.0)
        precision = (1 / self.errors**2)[:, ALL] / growth[:, ALL] ** 2  # (r, n, m)
        narrow = self._narrow(growth)
        with np.errstate(divide="ignore"):
            chances = np.where(precision > 0, np.log(np.stack([first, second]).transpose(0, 2, 1, 3)), 0.0)
        apart = self.values[:, ALL] - sign * np.nan_to_num(solved).transpose(0, 2, 1, 3)  # (2, r, n, m)
        regions = np.arange(len(self.values))
        log_chances, apart = chances[self._patterns, regions], apart[self._patterns, regions]  # (2^r, r, n, m)
        middle = np.degrees(np.angle((precision * np.exp(1j * np.radians(apart))).sum(axis=1, keepdims=True)))
        rest = within_half_a_turn(apart - middle)
        mean = (precision * rest).sum(axis=1) * narrow
        contrasts = np.maximum(np.isfinite(self.errors).sum(axis=0) - 1, 0)
        logs = log_chances.sum(axis=1) - 0.5 * ((precision * rest**2).sum(axis=1) - mean**2 / narrow)
        logs = logs - contrasts * np.log(growth)[:, ALL]
        means = middle[:, 0] + mean
        if self.settings.zero == HELD:
            logs = logs + _normal(within_half_a_turn(means - self.settings.zeros), self._loose + narrow)
            alone = self.settings.zeros + np.zeros_like(means)
        else:
            alone = means
        own_zeros = self._loose + narrow
        return [_joined(logs[..., some], alone[..., some], own_zeros[:, some]) for some in self._groups], means


def _joined(logs: Array, means: Array, variance: Array) -> _Ways:
    """The likeliest combinations of the ways to explain single files that have one zero, shape (2^r, n, files).

    `variance` (shape (n, files)): of the zero of each file [degree^2].
    """
    ways = _Ways(logs[..., 0].T, means[..., 0].T, np.arange(len(logs))[ALL, :, ALL].repeat(logs.shape[1], axis=0))
    known = variance[:, 0, ALL, ALL]
    for k in range(1, variance.shape[1]):
        more = variance[:, k, ALL, ALL]
        apart = within_half_a_turn(means[..., k].T[:, ALL] - ways.zeros[..., ALL])  # (n, K, 2^r)
        total = ways.logs[..., ALL] + logs[..., k].T[:, ALL] + _normal(apart, known + more)
        zeros = ways.zeros[..., ALL] + apart * known / (known + more)
        known = 1 / (1 / known + 1 / more)
        count = total.shape[1] * total.shape[2]
        best = np.argpartition(-total.reshape(-1, count), min(MOST, count) - 1, axis=1)[:, :MOST]
        parent, branches = np.divmod(best, total.shape[2])
        before = np.take_along_axis(ways.chosen, parent[..., ALL], axis=1)
        total, zeros = (np.take_along_axis(one.reshape(-1, count), best, axis=1) for one in (total, zeros))
        ways = _Ways(total, zeros, np.concatenate([before, branches[..., ALL]], axis=2))
    return ways


def _normal(apart: Array, variance: Array) -> Array:
    """Logarithm of a normal density, up to a constant."""
    return -0.5 * (apart**2 / variance + np.log(variance))


def _total(logs: Array) -> Array:
    """Logarithm of the sum of exponentials, shape (n, k) to (n,)."""
    return np.logaddexp.reduce(logs, axis=1)


def _drawn(logs: Array, rng: np.random.Generator) -> Indices:
    """Index of one of k choices, drawn with these logarithms of chances, shape (n, k) to (n,)."""
    return np.argmax(logs + rng.gumbel(size=logs.shape), axis=1)


def _share(x: Array) -> Array:
    """Uniform number between 0 and 1 for x that is normal and cut off at the reach."""
    low = ndtr(-REACH)
    return (ndtr(x) - low) / (1 - 2 * low)
