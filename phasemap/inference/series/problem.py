"""What is unknown of a series, and how likely data are: materials, free amplitude, setpoint, zeros and sign."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap.inference.series.orbits import Lever, Table
from phasemap.inference.series.settings import FREE, SHARED, Settings

Array = NDArray[np.float64]

REACH = 2.25  # standard deviations of the prior within which everything is sought
OTHER = 0.25  # chance that of two branches the tip is on the one that it does not meet first
ALL = np.newaxis


class State(NamedTuple):
    """Physical values of n combinations."""

    logs: Array  # shape (n, r, 3); of the materials over those of the reference
    # amplitudes, ratios: shape (n, m); free amplitudes at the drive frequency [m], and setpoints
    amplitudes: Array
    ratios: Array
    zeros: Array  # shape (n, m); expected zeros of the phase [degree]


@dataclass(frozen=True, eq=False)
class Problem:
    """Unknowns, each normal with standard deviation 1 and cut off at `REACH`, and the data."""

    lever: Lever
    table: Table
    settings: Settings
    # values, errors: shape (r, m); median phases as recorded and their standard errors [degree]; infinite errors
    # where there is no datum
    values: Array
    errors: Array
    known: Array  # shape (r, 3); logarithms of the materials that are given, NaN where they are sought
    widths: Array  # shape (3,); standard deviations of the logarithms by the prior

    @property
    def unknown(self) -> NDArray[np.intp]:
        """Regions whose material is sought."""
        return np.flatnonzero(np.isnan(self.known).any(axis=1))

    @property
    def names(self) -> list[str]:
        """Of the unknowns."""
        named = [f"{name} {r}" for r in self.unknown for name in ("modulus", "adhesion", "damping")]
        named.append("scale of the free amplitude")
        if self.settings.amplitude == FREE:
            named += [f"free amplitude of file {i}" for i in range(len(self.settings))]
        if self.settings.setpoint == SHARED:
            named.append("setpoint")
        if self.settings.zero == SHARED:
            named.append("phase zero")
        return named

    def state(self, x: Array) -> State:
        """Physical values at standard ones, shape (n, p)."""
        count, files, done = len(x), len(self.settings), 3 * len(self.unknown)
        logs = np.repeat(self.known[ALL], count, axis=0)
        logs[:, self.unknown] = (x[:, :done] * np.tile(self.widths, len(self.unknown))).reshape(count, -1, 3)
        scale, done = x[:, done : done + 1], done + 1
        own = np.zeros((count, files))
        if self.settings.amplitude == FREE:
            own, done = x[:, done : done + files], done + files
        level = np.zeros((count, 1))
        if self.settings.setpoint == SHARED:
            level, done = x[:, done : done + 1], done + 1
        amplitudes, ratios = self.settings.at(scale, own, _share(level))
        zeros = np.repeat(self.settings.zeros[ALL], count, axis=0)
        if self.settings.zero == SHARED:
            zeros = zeros + 360.0 * (_share(x[:, done : done + 1]) - 0.5)
        return State(logs, amplitudes, ratios, zeros)

    def tabulated(self, state: State) -> tuple[Array, Array, Array]:
        """Phases [degree], places and shares, shape (2, n, r, m), by the table."""
        count, regions, files = len(state.logs), len(self.values), len(self.settings)
        shape = count, regions, files
        points = np.empty((*shape, 5))
        points[..., :3] = state.logs[:, :, ALL]
        points[..., 3] = np.log(state.amplitudes)[:, ALL]
        points[..., 4] = state.ratios[:, ALL]
        phases, places, share = self.table.look(points)
        return np.degrees(phases), places, share

    def solved(self, state: State) -> Array:
        """Phases [degree], shape (2, n, r, m), of averaged orbits."""
        _, places, share = self.tabulated(state)
        regions, files = self.values.shape
        sizes, levels = (np.repeat(values, regions, axis=0).ravel() for values in (state.amplitudes, state.ratios))
        logs = np.repeat(state.logs, files, axis=1).reshape(-1, 3)
        found = self.lever.phases(logs, sizes, levels, places.reshape(2, -1), (share > 0).reshape(2, -1))
        return np.degrees(found.reshape(places.shape))

    def likelihood(self, phases: Array, zeros: Array, sign: Array) -> tuple[Array, Array]:
        """Logarithm of the likelihood, shape (n,), and chances of the repulsive branch, shape (n, r, m).

        Where the tip may be on either branch, both count, the one it meets first for more: the attractive one, if it
        goes on without a gap to larger setpoints.

        `phases` (shape (2, n, r, m)).
        `zeros` (shape (n, m)).
        `sign` (shape (n,)): of the recorded phase.
        """
        there = ~np.isnan(phases)
        left = (~there[0]).astype(float) @ self.settings.above > 0  # a gentler file has no attractive orbit
        before = np.where(left, OTHER, 1 - OTHER)
        first = np.where(there[0], np.where(there[1], before, 1.0), 0.0)
        second = np.where(there[1], np.where(there[0], 1 - before, 1.0), 0.0)
        with np.errstate(divide="ignore"):
            chances = np.log(np.stack([first, second]))
        precision = 1.0 / self.errors**2
        seen = precision > 0
        loose = self.settings.loose
        apart = np.where(there, self.values - sign[:, ALL, ALL] * np.nan_to_num(phases) - zeros[:, ALL], 0.0)
        logs, taken = [], []
        for branches in product((0, 1), repeat=len(self.values)):
            which, each = list(branches), range(len(branches))
            d = np.stack([apart[b, :, r] for r, b in zip(each, which, strict=True)], axis=1)
            d = (d + 180.0) % 360.0 - 180.0
            own = np.stack([chances[b, :, r] for r, b in zip(each, which, strict=True)], axis=1)
            misfit = (precision * d**2).sum(axis=1)
            shared = (precision * d).sum(axis=1) ** 2 * loose / (1 + precision.sum(axis=0) * loose)
            logs.append(np.where(seen, own, 0.0).sum(axis=1) - 0.5 * (misfit - shared))
            taken.append(np.array(branches, float))
        total = np.stack(logs)  # (combinations, n, m)
        most = total.max(axis=0)
        weights = np.exp(total - np.where(np.isfinite(most), most, 0.0))
        mass = weights.sum(axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            whole = (most + np.log(mass)).sum(axis=1)
            repulsive = np.einsum("cnm,cr->nrm", weights, np.array(taken)) / mass[:, ALL]
        return np.where(np.isnan(whole), -np.inf, whole), repulsive


def _share(x: Array) -> Array:
    """Uniform over 0 ... 1 where x is normal within the reach."""
    from scipy.special import ndtr

    low = ndtr(-REACH)
    share: Array = (ndtr(x) - low) / (1 - 2 * low)
    return share
