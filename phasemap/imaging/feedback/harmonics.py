"""By how much the lever's higher harmonics carry the tip, for every material, from those of some."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.scanning.higher_harmonics import lifts
from phasemap._shared.threads import bounds_of, spread
from phasemap.imaging.job import Job
from phasemap.solvers.problem import Work

Array = np.ndarray

MOST, CHUNK = 2048, 64  # materials whose harmonics are looked at, and how many of them at a time


class Lifts(NamedTuple):
    """The two kappa of `_kernels.scanning.higher_harmonics` of some materials, in order of contact stiffness."""

    # attractive, repulsive: contact stiffness, and kappa there; empty if nothing is known
    attractive: tuple[Array, Array]
    repulsive: tuple[Array, Array]

    def beside(self, rows: Array) -> Array:
        """Rows of materials with their two kappa behind them, interpolated in contact stiffness; 0 if not known."""
        kappa = [
            np.interp(rows[:, col.CONTACT], *side) if len(side[0]) else np.zeros(len(rows))
            for side in (self.attractive, self.repulsive)
        ]
        return np.column_stack([rows, *kappa])


def lifts_of(job: Job, work: Work) -> Lifts:
    """Look at the harmonics of so many of these materials, evenly in the order of their contact stiffness."""
    limits = np.array([math.radians(job.accuracy.phase), job.accuracy.height])
    stiffness = work.rows[:, col.CONTACT]
    order = np.argsort(stiffness, kind="stable")
    some = order[:: max(1, -(-len(order) // MOST))]
    found, rows, amplitudes = np.full((len(some), 2), np.nan), work.rows[some], work.amplitudes[some]

    def solve(first: int, last: int) -> None:
        lifts(work.law, rows, work.lever, amplitudes, limits, first, last, found)

    spread(solve, bounds_of(len(some), CHUNK), job.workers, None)
    sides = []
    for side in (0, 1):
        values = np.where(np.isnan(found[:, side]), found[:, 1 - side], found[:, side])
        known = np.isfinite(values)
        sides.append((stiffness[some[known]], values[known]))
    return Lifts(*sides)
