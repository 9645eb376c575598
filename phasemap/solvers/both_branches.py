"""Orbits that hold the setpoint on each branch, for many materials, for a tip that is already tapping."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels import columns as col
from phasemap._kernels.columns import ATTRACTING, ENGAGED, NOWHERE, REPELLING, SLOTS, ErrorLimits, StableOrbits
from phasemap._kernels.rows.answers import Answers
from phasemap._shared.arrays import Array
from phasemap._shared.threads import Progress, bounds_of, chunk_of, spread
from phasemap.experiment.accuracy import Accuracy
from phasemap.solvers.in_time import ETA
from phasemap.solvers.problem import Work
from phasemap.solvers.seen_by_detector import SolvedRows, at_tip, shown
from phasemap.solvers.solver import LENGTH, PHASE, March, Solver

Codes = NDArray[np.int8]

SIDES = {ATTRACTING: -1, REPELLING: 1}  # of the resonance, on which the orbits of a branch are


class Branches(NamedTuple):
    """Orbits of n materials at the setpoint: attractive, repulsive, and the one that engagement from far finds."""

    # shape (3, n, COLUMNS); result rows of the attractive orbit, of the repulsive one, and of the one that
    # engagement from far finds (which is one of the other two); NaN where there is none
    rows: Array
    # status, solver: int8, shape (3, n); codes that go with them
    status: Codes
    solver: Codes
    # shape (2, n); highest tip offset [m] from which a tip comes to each branch; infinite where it does from any
    reach: Array

    @classmethod
    def unknown(cls, work: Work) -> Branches:
        """Branches without any orbit yet; status codes say what is refused."""
        count = len(work)
        rows, reach = np.full((SLOTS, count, col.COLUMNS), np.nan), np.full((ENGAGED, count), np.inf)
        return cls(rows, np.tile(work.refused(), (SLOTS, 1)), np.full((SLOTS, count), -1, np.int8), reach)

    @property
    def answers(self) -> Answers:
        """Rows and codes as solvers fill them."""
        return Answers(self.rows, self.status, self.solver)

    @property
    def orbits(self) -> StableOrbits:
        """Orbits as kernels want them."""
        offsets = np.ascontiguousarray(self.rows[:, :, col.TIP_OFFSET])
        return StableOrbits(self.stable.astype(np.int8), self.engaged, offsets, self.reach)

    @property
    def stable(self) -> NDArray[np.bool_]:
        """True where there is an orbit, on each branch, shape (2, n)."""
        return self.status[:ENGAGED] == col.GOOD

    @property
    def engaged(self) -> Codes:
        """Branch that engagement finds: ATTRACTING, REPELLING, or NOWHERE; shape (n,)."""
        side = col.is_repulsive(self.rows[ENGAGED])
        return np.where(self.status[ENGAGED] == col.GOOD, side, NOWHERE).astype(np.int8)

    def put(self, at: NDArray[np.intp] | slice, others: Branches) -> None:
        """Take over the orbits that were found of some materials."""
        self.rows[:, at], self.status[:, at], self.solver[:, at], self.reach[:, at] = others


def stable_branches(
    work: Work, solver: Solver, accuracy: Accuracy, workers: int = 1, progress: Progress | None = None,
    engaged: SolvedRows | None = None,
) -> Branches:  # fmt: skip
    """Find the stable orbits that hold the setpoint on the attractive and on the repulsive branch.

    An orbit counts if its Floquet multipliers are inside the unit circle and the amplitude rises with the tip offset.
    Of several on one branch it is the one that engagement finds, or else the farthest.

    `solver`: what it finds by engagement is kept bit for bit. The other branch has an averaged orbit with
        "averaging", or where its estimated error is within `accuracy` with "auto"; an exact orbit; or, with
        "march", what time makes of that.
    `workers`: threads; the numbers do not depend on it.
    `engaged`: what engagement finds, rows, status and solver, where that is known and good everywhere.
    """
    branches, tip = Branches.unknown(work), at_tip(work)
    valid = np.flatnonzero(branches.status[ENGAGED] == col.GOOD)

    def solve(first: int, last: int) -> None:
        chosen = valid[first:last]
        part = tip.part(chosen)
        of_part = Branches.unknown(part)
        if engaged is None:
            solver.solve(part, accuracy, of_part.answers.of(ENGAGED))
        else:
            of_part.rows[ENGAGED], of_part.status[ENGAGED], of_part.solver[ENGAGED] = (one[chosen] for one in engaged)
        _fill_both_branches(part, solver, accuracy, of_part.answers)
        _limit_repulsive_branch(part, accuracy.periods, of_part)
        for rows in of_part.rows:
            rows[:] = shown(rows, work)
        if engaged is not None:  # as the detector sees it already; all are good, so that no branch is NOWHERE
            of_part.rows[ENGAGED] = of_part.rows[of_part.engaged, np.arange(len(part))] = engaged[0][chosen]
        branches.put(chosen, of_part)

    spread(solve, bounds_of(len(valid), chunk_of(len(valid), workers, solver.rows_per_chunk)), workers, progress)
    return branches


def _fill_both_branches(work: Work, solver: Solver, accuracy: Accuracy, answers: Answers) -> None:
    """Fill in the orbits of both branches beside those that engagement found."""
    from phasemap._kernels.rows.by_response import side_rows

    phase, height = accuracy.phase, accuracy.height
    if solver.name != "auto":
        phase, height = min(phase, PHASE), min(height, LENGTH)
    limits = ErrorLimits(math.radians(phase), height)
    allowed = {"auto": limits, "averaging": ErrorLimits(math.inf, math.inf)}.get(solver.name, ErrorLimits(0.0, 0.0))
    known, engaged = answers.of(ENGAGED), answers.status[ENGAGED] == col.GOOD
    for slot, side in SIDES.items():
        here = np.flatnonzero(engaged & (col.is_repulsive(known.rows) == (slot == REPELLING)))
        on_side = answers.of(slot)
        on_side.status[:] = col.PENDING
        on_side.put(here, known.of(here))
        if side_rows(work.pixels, side, limits, allowed, on_side):
            from phasemap._kernels.quadrature import TABLES
            from phasemap._kernels.rows.by_collocation import collocation_side_rows

            if collocation_side_rows(work.pixels, TABLES, side, on_side):
                _search(work, side, on_side)
    if solver.name == "averaging":
        _average(work, answers)
    elif isinstance(solver, March):
        _march(work, solver, accuracy.periods, answers)


def _limit_repulsive_branch(work: Work, most: int, branches: Branches) -> None:
    """Find up to which tip offset the repulsive branch exists, where a tip from far taps irregularly.

    A tip that comes on that branch, but higher, from a stiffer material, falls off it.
    """
    rows = branches.rows
    attractive = ~col.is_repulsive(rows[ENGAGED])
    chosen = np.flatnonzero(col.is_mean(rows[ENGAGED]) & attractive & (branches.status[REPELLING] == col.GOOD))
    if len(chosen):
        from phasemap._kernels.scanning.quasi_static import reach_rows

        limits = rows[ENGAGED, chosen, col.TIP_OFFSET]
        part = work.part(chosen)
        reach_rows(part.law, part.rows, part.lever, ETA, most, rows[REPELLING, chosen], limits)
        branches.reach[REPELLING, chosen] = limits


def _search(work: Work, side: int, answers: Answers) -> None:
    """Decide materials still PENDING on a side of the resonance by all the exact orbits that there are."""
    from phasemap._kernels.orbits.collocation.path import fixed_path
    from phasemap.solvers.continuation.whole_curves import curves_to_amplitude

    rows, status, used = answers
    for i in np.flatnonzero(status == col.PENDING):
        curves = curves_to_amplitude(fixed_path(work.oscillator(int(i))), work.amplitudes[i])
        orbits = curves.wanted_rows[:, : col.COLUMNS]
        stable = (orbits[:, col.FLOQUET] < 1) & (orbits[:, col.SLOPE] > 0)
        on = orbits[stable & (col.is_repulsive(orbits) == (side > 0))]
        status[i] = col.GOOD if len(on) else col.NO_STABLE_ORBIT if curves.all_followed else col.NOT_CONVERGED
        if len(on):
            rows[i], used[i] = on[np.argmax(on[:, col.TIP_OFFSET])], col.ORBIT


def _average(work: Work, answers: Answers) -> None:
    """Averaged orbits in the place of exact ones, without their errors."""
    from phasemap._kernels.rows.by_response import averaged_near_rows

    for slot in SIDES:
        averaged_near_rows(work.pixels, answers.of(slot))
    answers.rows[:ENGAGED, :, [col.ERROR_PHASE, col.ERROR_HEIGHT]] = np.nan


def _march(work: Work, solver: March, periods: int, answers: Answers) -> None:
    """March exact orbits in time, in place; an orbit that time leads to the other branch is none."""
    rows, status, _ = answers
    for slot in SIDES:
        known = (status[ENGAGED] == col.GOOD) & (col.is_repulsive(rows[ENGAGED]) == (slot == REPELLING))
        other = np.flatnonzero((status[slot] == col.GOOD) & ~known)
        settled = answers.of(slot).of(other)
        settled_rows, done, _ = settled
        solver.settle(work.part(other), np.arange(len(other)), settled, periods)
        gone = (done == col.GOOD) & (col.is_repulsive(settled_rows) != (slot == REPELLING))
        settled_rows[gone], done[gone] = np.nan, col.NO_STABLE_ORBIT
        answers.of(slot).put(other, settled)
