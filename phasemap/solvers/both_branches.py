"""The orbits that hold the setpoint on each branch, for many materials: what a tip finds that is already tapping."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels import columns as col
from phasemap._kernels.columns import ATTRACTING, ENGAGED, NOWHERE, REPELLING, SLOTS, StableOrbits
from phasemap._kernels.rows.answers import Answers
from phasemap._shared.threads import Progress, bounds_of, chunk_of, spread
from phasemap.experiment.accuracy import Accuracy
from phasemap.experiment.lever import of_tip, sees_tip
from phasemap.solvers.detected_setpoint import ATTRACTIVE, REPULSIVE, Found, close, hold
from phasemap.solvers.in_time import ETA
from phasemap.solvers.problem import Work
from phasemap.solvers.run import run
from phasemap.solvers.solver import LENGTH, PHASE, March, Solver

Array = NDArray[np.float64]
Codes = NDArray[np.int8]


class Branches(NamedTuple):
    """What holds the setpoint, for n materials."""

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
        """Nothing yet; status codes say what is refused."""
        count = len(work)
        rows, reach = np.full((SLOTS, count, col.COLUMNS), np.nan), np.full((ENGAGED, count), np.inf)
        return cls(rows, np.tile(work.refused(), (SLOTS, 1)), np.full((SLOTS, count), -1, np.int8), reach)

    @property
    def answers(self) -> Answers:
        """Rows and codes as solvers fill them."""
        return Answers(self.rows, self.status, self.solver)

    @property
    def orbits(self) -> StableOrbits:
        """The same as kernels want it."""
        offsets = np.ascontiguousarray(self.rows[:, :, col.TIP_OFFSET])
        return StableOrbits(self.stable.astype(np.int8), self.engaged, offsets, self.reach)

    @property
    def stable(self) -> NDArray[np.bool_]:
        """Whether there is an orbit on each branch, shape (2, n)."""
        found: NDArray[np.bool_] = self.status[:ENGAGED] == col.GOOD
        return found

    @property
    def engaged(self) -> Codes:
        """Branch that engagement finds: ATTRACTING, REPELLING, or NOWHERE; shape (n,)."""
        side = self.rows[ENGAGED, :, col.STIFFENING] > 0
        return np.where(self.status[ENGAGED] == col.GOOD, side, NOWHERE).astype(np.int8)

    def put(self, at: NDArray[np.intp] | slice, found: Branches) -> None:
        """Take over what was found of some materials."""
        self.rows[:, at], self.status[:, at], self.solver[:, at], self.reach[:, at] = found


def stable_branches(
    work: Work,
    solver: Solver,
    accuracy: Accuracy,
    workers: int = 1,
    progress: Progress | None = None,
    engaged: Found | None = None,
) -> Branches:
    """Find the stable orbits that hold the setpoint on the attractive and on the repulsive branch.

    An orbit counts if its Floquet multipliers are inside the unit circle and the amplitude rises with the tip offset.
    Of several on one branch it is the one that engagement finds, or else the farthest.

    `solver`: what it finds by engagement is kept bit for bit. The other branch has an averaged orbit with
        "averaging", or where its estimated error is within `accuracy` with "auto"; an exact orbit; or, with
        "march", what time makes of that.
    `workers`: threads; the numbers do not depend on it.
    `engaged`: what engagement finds, rows, status and solver, where that is known and good everywhere.

    Examples
    --------
    >>> import phasemap as pm
    >>> from phasemap.solvers.solver import by_name
    >>> from phasemap.solvers.problem import work_of_material
    >>> scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(16e-9))
    >>> work = work_of_material(pm.Material(modulus=2e9, adhesion=0.1), scope, 0.8 * scope.driven_amplitude)
    >>> found = stable_branches(work, by_name("orbit"), pm.Accuracy())
    >>> found.stable.tolist(), found.engaged.tolist()
    ([[True], [True]], [0])
    """
    if not sees_tip(work.lever):
        return _seen_branches(work, solver, accuracy, workers, progress, engaged)
    found, count = Branches.unknown(work), len(work)
    valid = np.flatnonzero(found.status[ENGAGED] == col.GOOD)
    if len(valid) < count:
        found.put(valid, stable_branches(work.part(valid), solver, accuracy, workers, progress))
        return found

    def solve(first: int, last: int) -> None:
        some = slice(first, last)
        part = work.part(some)
        own = Branches.unknown(part)
        if engaged is None:
            solver.solve(part, accuracy, own.answers.of(ENGAGED))
        else:
            own.rows[ENGAGED], own.status[ENGAGED], own.solver[ENGAGED] = (one[some] for one in engaged)
        _others(part, solver, accuracy, own.answers)
        _limit(part, accuracy.periods, own)
        found.put(some, own)

    spread(solve, bounds_of(count, chunk_of(count, workers, solver.rows_per_chunk)), workers, progress)
    close(found.rows, work.lever)
    return found


def _seen_branches(
    work: Work, solver: Solver, accuracy: Accuracy, workers: int, progress: Progress | None, engaged: Found | None
) -> Branches:
    """The same where the detector does not see the tip: by secants on the branch that engagement does not find."""
    found = Branches.unknown(work)
    valid = np.flatnonzero(found.status[ENGAGED] == col.GOOD)

    if engaged is None:
        engaged = run(solver, work.part(valid), accuracy, threads=workers, progress=progress)
    found.rows[ENGAGED, valid], found.status[ENGAGED, valid], found.solver[ENGAGED, valid] = engaged
    answers = found.answers
    for slot, side in ((ATTRACTING, ATTRACTIVE), (REPELLING, REPULSIVE)):
        here, others = np.flatnonzero(found.engaged == slot), valid[found.engaged[valid] != slot]

        def solve(part: Work, slot: int = slot) -> Found:
            both = stable_branches(part, solver, accuracy, workers, progress)
            return both.rows[slot], both.status[slot], both.solver[slot]

        held = Answers(*hold(work.part(others), solve, side))
        answers.of(slot).put(others, held)
        answers.of(slot).put(here, answers.of(ENGAGED).of(here))
    _limit(work, accuracy.periods, found)
    return found


def _others(work: Work, solver: Solver, accuracy: Accuracy, answers: Answers) -> None:
    """Fill both branches, what engagement finds being there."""
    from phasemap._kernels.rows.fast import other_rows

    phase, height = accuracy.phase, accuracy.height
    if solver.name != "auto":
        phase, height = min(phase, PHASE), min(height, LENGTH)
    limits = np.array([math.radians(phase), height])
    allowed = {"auto": limits, "averaging": np.full(2, np.inf)}.get(solver.name, np.zeros(2))
    if other_rows(work.pixels, limits, allowed, 0, len(work), answers):
        from phasemap._kernels.quadrature import TABLES
        from phasemap._kernels.rows.exact import exact_near_rows

        if exact_near_rows(work.pixels, TABLES, 0, len(work), answers):
            _search(work, answers)
    if solver.name == "averaging":
        _average(work, answers)
    elif isinstance(solver, March):
        _march(work, solver, accuracy.periods, answers)


def _limit(work: Work, most: int, found: Branches) -> None:
    """Where a tip that comes from far taps irregularly, find up to which tip offset the repulsive branch is there.

    A tip that comes on that branch, but higher, from a stiffer material, falls off it.
    """
    rows = found.rows
    attractive = ~(rows[ENGAGED, :, col.STIFFENING] > 0)
    chosen = np.flatnonzero(col.irregular(rows[ENGAGED]) & attractive & (found.status[REPELLING] == col.GOOD))
    if len(chosen):
        from phasemap._kernels.scanning.quasi_static import reach_rows

        limits = rows[ENGAGED, chosen, col.TIP_OFFSET]
        orbits, part = rows[REPELLING, chosen], work.part(chosen)
        orbits[:, col.AMPLITUDE], orbits[:, col.PHASE] = of_tip(
            work.lever, orbits[:, col.AMPLITUDE], orbits[:, col.PHASE]
        )
        reach_rows(part.law, part.rows, part.lever, ETA, most, orbits, limits)
        found.reach[REPELLING, chosen] = limits


def _search(work: Work, answers: Answers) -> None:
    """Decide what is still PENDING by all the exact orbits that there are."""
    from phasemap._kernels.orbits.collocation.path import fixed_path
    from phasemap.solvers.continuation.curves import orbits_of_amplitude

    rows, status, used = answers
    waiting = status[:ENGAGED] == col.PENDING
    for i in np.flatnonzero(waiting.any(axis=0)):
        path = fixed_path(work.oscillator(int(i)))
        found = orbits_of_amplitude(path, work.amplitudes[i])[0][:, : col.COLUMNS]
        found = found[(found[:, col.FLOQUET] < 1) & (found[:, col.SLOPE] > 0)]
        for slot in np.flatnonzero(waiting[:, i]):
            on = found[(found[:, col.STIFFENING] > 0) == (slot == REPELLING)]
            status[slot, i] = col.GOOD if len(on) else col.NO_STABLE_ORBIT
            if len(on):
                rows[slot, i], used[slot, i] = on[np.argmax(on[:, col.TIP_OFFSET])], col.ORBIT


def _average(work: Work, answers: Answers) -> None:
    """Averaged orbits in the place of exact ones, without what is known of their errors."""
    from phasemap._kernels.rows.fast import averaged_near_rows

    for slot in (ATTRACTING, REPELLING):
        averaged_near_rows(work.pixels, 0, len(work), answers.of(slot))
    answers.rows[:ENGAGED, :, [col.ERROR_PHASE, col.ERROR_HEIGHT]] = np.nan


def _march(work: Work, solver: March, periods: int, answers: Answers) -> None:
    """What time makes of the exact orbits; an orbit that it leads to the other branch is none."""
    rows, status, _ = answers
    for slot in (ATTRACTING, REPELLING):
        known = (status[ENGAGED] == col.GOOD) & ((rows[ENGAGED, :, col.STIFFENING] > 0) == (slot == REPELLING))
        other = np.flatnonzero((status[slot] == col.GOOD) & ~known)
        found = answers.of(slot).of(other)
        some, done, _ = found
        solver.settle(work.part(other), np.arange(len(other)), found, periods)
        gone = (done == col.GOOD) & ((some[:, col.STIFFENING] > 0) != (slot == REPELLING))
        some[gone], done[gone] = np.nan, col.NO_STABLE_ORBIT
        answers.of(slot).put(other, found)
