"""By how much the lever's higher harmonics carry the tip, for every material, from those of some."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.scanning.higher_harmonics import share_rows
from phasemap._shared.threads import bounds_of, spread
from phasemap.imaging.job import Job
from phasemap.solvers.problem import Work

Array = np.ndarray

MOST, CHUNK = 2048, 64  # materials whose harmonics are looked at, and how many of them at a time


class Lifts(NamedTuple):
    """Shares of `_kernels.scanning.higher_harmonics` of some materials, in order of contact stiffness."""

    stiffness: Array
    shares: Array

    def beside(self, rows: Array) -> Array:
        """Rows of materials with their two shares behind them, interpolated in contact stiffness."""
        behind = [np.interp(rows[:, col.CONTACT], self.stiffness, share) for share in self.shares.T]
        return np.column_stack([rows, *behind])


def lifts_of(job: Job, work: Work) -> Lifts:
    """Look at the harmonics of so many of these materials, evenly in the order of their contact stiffness."""
    limits = np.array([math.radians(job.accuracy.phase), job.accuracy.height])
    stiffness = work.rows[:, col.CONTACT]
    order = np.argsort(stiffness, kind="stable")
    some = order[:: max(1, -(-len(order) // MOST))]
    shares, rows, amplitudes = np.empty((len(some), 2)), work.rows[some], work.amplitudes[some]

    def solve(first: int, last: int) -> None:
        part = slice(first, last)
        share_rows(work.law, rows[part], work.lever, amplitudes[part], limits, shares[part])

    spread(solve, bounds_of(len(some), CHUNK), job.workers, None)
    return Lifts(stiffness[some], shares)
