"""Orbits at which the detector shows the setpoint, where what it sees is not the position of the tip.

Solvers hold the amplitude A of z. Which A the detector shows as the setpoint depends on the phase, which the solver
says: one equation in A for each material, solved by secants, all materials at a time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels import columns as col
from phasemap._kernels.rows.answers import Answers
from phasemap._shared.threads import bounds_of, spread
from phasemap.experiment.excitation import (
    amplitude_at,
    offset_and_factor,
    seen,
    show,
    tip_amplitudes,
    tip_seen,
)
from phasemap.solvers.in_time import InTime
from phasemap.solvers.problem import Work

Array = NDArray[np.float64]
Codes = NDArray[np.int8]
Found = tuple[Array, Codes, Codes]
"""Result rows, status and solver codes."""

ATTRACTIVE, REPULSIVE = -1, 1
CHUNK = 500  # materials that a thread takes at once
MOST_ROUNDS, MOST_MISSING = 40, 6
EXACT, CLOSE = 1e-12, 1e-7  # of the setpoint: found; enough in the end
PATIENT = 8  # rounds after which that is enough
LEAST_SLOPE = 0.05  # of the amplitude seen with A, that of a branch that can be held
APART = 1e-7  # of A: secants over less say nothing of the slope
JUMP, STEEP = 1e-3, 30.0  # of A, and slope of the amplitude seen: what changes the branch so fast is a jump
MOST_STARTS = 3  # on both branches, and between them
UNDECIDED = (col.UNSTABLE, col.NOT_CONVERGED, col.NOT_SETTLED)  # at the A tried; at others there may be an orbit
A, MISS, PHASE, OFFSET, SIDE, LAST = 0, 1, 2, 3, 4, 5  # what is known of the last orbit


def hold(
    work: Work, solve: Callable[[Work], Found], periods: int, sides: tuple[int, ...] = (ATTRACTIVE, REPULSIVE),
    limits: tuple[float, float] | None = None, workers: int = 1,
) -> Found:  # fmt: skip
    """Find the orbits at which the detector shows the amplitudes of a work.

    Where engagement from far passes the end of a branch between the two A that show the setpoint, or the amplitude that
    is seen turns on the way, the tip is engaged in time, on what is seen; a contact with hysteresis always is, and so
    is what moves irregularly at the A tried, for what a lock-in shows of it is averaged over what is seen.

    `solve`: gives the orbits of a work at amplitudes of z.
    `periods`: that a material may take in time.
    `sides`: branches from which to start; if it is one, `solve` gives orbits of that only, and there is no
        engagement.
    `limits`: of exact orbits after engagement, the largest errors of passes [degree, m]: these are held by what is seen
        wherever their branch is sure, and `solve` is asked for the others only.
    `workers`: threads for that.
    Returns `rows` (shape (n, COLUMNS)): as the detector sees them.
    Returns `status, solver` (shape (n,)).
    """
    from phasemap._kernels.lever import near_resonance

    if not np.any(offset_and_factor(work.lever)[0]):
        return _hold_in_proportion(work, solve)
    search = _Search(work, solve, sides, periods)
    if limits is not None and near_resonance(work.lever) and not work.in_time:
        search.take_sure(np.array([math.radians(limits[0]), limits[1]]), workers)
    for _ in range(MOST_ROUNDS):
        if not search.go_on():
            break
    return search.found()


def _hold_in_proportion(work: Work, solve: Callable[[Work], Found]) -> Found:
    """The same where the amplitude that is seen is that of z times a number, and phases differ by one."""
    factor = abs(offset_and_factor(work.lever)[1])
    rows, status, used = solve(replace(work, lever=tip_seen(work.lever), amplitudes=work.amplitudes / factor))
    rows[:, [col.SLOPE, col.SPREAD_AMPLITUDE]] *= factor
    return seen(rows, work.lever), status, used


class _Search:
    """Secants in A for all materials at a time, between an A that is seen too small and one that is seen too large."""

    def __init__(self, work: Work, solve: Callable[[Work], Found], sides: tuple[int, ...], periods: int) -> None:
        count, lever = len(work), tip_seen(work.lever)
        self.work, self.solve, self.tip, self.periods = work, solve, replace(work, lever=lever), periods
        self.rows = np.full((count, col.COLUMNS), np.nan)
        self.status, self.used = np.full(count, col.NO_STABLE_ORBIT, np.int8), np.full(count, -1, np.int8)
        starts = [_starts(work, side) for side in sides]
        self.starts = np.stack([*starts, np.mean([*starts, work.amplitudes], axis=0)])
        self.a, self.tried = self.starts[0].copy(), np.ones(count, int)
        self.last = np.full((count, LAST), np.nan)
        self.ends = np.full((count, 2, LAST), np.nan)  # of the bracket
        self.slopes = np.full((count, 3), np.nan)  # of amplitude seen, phase and tip offset with A
        self.rounds, self.missing = np.zeros(count, int), np.zeros(count, int)
        self.lost = (work.rows[:, col.RELEASE] != 0) & (len(sides) > 1)
        self.open = ~self.lost

    def take_sure(self, limits: Array, workers: int) -> None:
        """Take in the orbits whose branch averaging is sure of."""
        from phasemap._kernels.quadrature import TABLES
        from phasemap._kernels.rows.seen import seen_rows

        at = np.flatnonzero(self.open)
        part = self.work.part(at)
        rows, slopes = np.empty((len(at), col.COLUMNS)), np.empty((len(at), 3))
        status, used = np.empty(len(at), np.int8), np.empty(len(at), np.int8)

        def some(first: int, last: int) -> None:
            seen_rows(part.pixels, TABLES, limits, first, last, Answers(rows, status, used), slopes)

        spread(some, bounds_of(len(at), CHUNK), workers, None)
        good = (status == col.GOOD) & (slopes[:, 0] > LEAST_SLOPE)
        self.rows[at[good]], self.slopes[at[good]] = rows[good], slopes[good]
        self.status[at[good]], self.used[at[good]], self.open[at[good]] = col.GOOD, used[good], False

    def go_on(self) -> bool:
        """Solve once more what is open; False if there is nothing."""
        at = np.flatnonzero(self.open)
        if not len(at):
            return False
        rows, status, used = self.solve(self.tip.part(at, self.a[at]))
        self.status[at], self.used[at] = status, used
        good = status == col.GOOD
        self._go_back(at[~good])
        self._take(at[good], rows[good])
        return True

    def _go_back(self, at: NDArray[np.intp]) -> None:
        """Where there was no orbit: half the way back to where one was, or to another start."""
        known = np.isfinite(self.last[at, A])
        back, anew = at[known], at[~known]
        self.missing[back] += 1
        self.a[back] = 0.5 * (self.a[back] + self.last[back, A])
        self._give_up(back[self.missing[back] > MOST_MISSING])
        over = self.tried[anew] == len(self.starts)
        self.open[anew[over]] = False
        anew = anew[~over]
        self.a[anew] = self.starts[self.tried[anew], anew]
        self.tried[anew] += 1

    def _give_up(self, at: NDArray[np.intp]) -> None:
        self.lost[at], self.open[at] = True, False

    def _take(self, at: NDArray[np.intp], rows: Array) -> None:
        """Take in orbits, and go to the next A or stop."""
        irregular = col.irregular(rows)
        self._give_up(at[irregular])
        at, rows = at[~irregular], rows[~irregular]
        wanted, a, phase = self.work.amplitudes[at], rows[:, col.AMPLITUDE], rows[:, col.PHASE]
        miss = show(self.work.lever, a, phase)[0] - wanted
        here = np.stack([a, miss, phase, rows[:, col.TIP_OFFSET], rows[:, col.STIFFENING] > 0], axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            change = (here - self.last[at])[:, [MISS, PHASE, OFFSET]] / (a - self.last[at, A])[:, None]
        apart = np.abs(a - self.last[at, A]) > APART * a
        self.slopes[at[apart]] = change[apart]
        self.last[at], self.ends[at, (miss > 0).astype(int)] = here, here
        self.rounds[at] += 1
        enough = np.where(self.rounds[at] < PATIENT, EXACT, CLOSE)
        done = np.abs(miss) <= wanted * enough
        self.rows[at[done]], self.open[at[done]] = rows[done], False
        self._give_up(at[done & (self.slopes[at, 0] < LEAST_SLOPE)])  # the amplitude seen turns here
        self._choose(at[~done])

    def _choose(self, at: NDArray[np.intp]) -> None:
        """The next A: by the secant, as if the phase stayed, or in the middle of the bracket."""
        lever, wanted, (a, miss, phase, _, _) = self.work.lever, self.work.amplitudes[at], self.last[at].T
        low, high = self.ends[at, 0], self.ends[at, 1]
        both = np.isfinite(low[:, A] + high[:, A])
        with np.errstate(invalid="ignore", divide="ignore"):
            following = np.where(
                self.slopes[at, 0] > LEAST_SLOPE, a - miss / self.slopes[at, 0], amplitude_at(lever, wanted, phase)
            )
        middle = 0.5 * (low[:, A] + high[:, A])
        width = high[:, A] - low[:, A]
        outside = both & ~((following - low[:, A]) * (high[:, A] - following) > 0)
        slow = both & (self.rounds[at] > PATIENT) & (self.rounds[at] % 2 == 0)
        following = np.where(outside | slow, middle, following)
        self.a[at] = np.clip(following, *tip_amplitudes(lever, wanted))
        # The branch changes between the two ends: neither has an orbit there that is seen with this amplitude.
        jump = both & (low[:, SIDE] != high[:, SIDE]) & (np.abs(width) < JUMP * a)
        jump &= high[:, MISS] - low[:, MISS] > STEEP * np.abs(width)
        self._give_up(at[jump | ~(following > 0) | (width < 0)])

    def found(self) -> Found:
        """What came of it."""
        self.lost |= self.open | np.isin(self.status, UNDECIDED)
        good = np.flatnonzero(np.isfinite(self.rows[:, 0]) & ~self.lost)
        self._carry_errors(good)
        self.rows[good] = seen(self.rows[good], self.work.lever)
        self.rows[good, col.AMPLITUDE] = self.work.amplitudes[good]
        self._follow(np.flatnonzero(self.lost))
        return self.rows, self.status, self.used

    def _carry_errors(self, at: NDArray[np.intp]) -> None:
        """From errors at a given A to those at a given amplitude seen; the slope of the feedback likewise."""
        rows, (offset, factor) = self.rows[at], offset_and_factor(self.work.lever)
        a, phase, size = rows[:, col.AMPLITUDE], rows[:, col.PHASE], self.work.amplitudes[at]
        # A phase that is off by one is seen off by `turn`, in an amplitude that is off by `grow`.
        part = factor * a * np.exp(1j * phase)
        share = part / (offset + part)
        turn, grow = share.real, -size * share.imag
        by_size, by_phase, by_offset = np.nan_to_num(self.slopes[at], nan=0.0).T
        by_size = np.where(by_size > LEAST_SLOPE, by_size, 1.0)
        # As the amplitude seen changes by one: phase seen, and tip offset.
        phase_rate, offset_rate = (share.imag / a + turn * by_phase) / by_size, by_offset / by_size
        missed = np.abs(show(self.work.lever, a, phase)[0] - size)
        error = rows[:, col.ERROR_PHASE]
        rows[:, col.ERROR_HEIGHT] += np.abs(offset_rate) * (np.abs(grow) * error + missed)
        rows[:, col.ERROR_PHASE] = np.abs(turn - grow * phase_rate) * error + np.abs(phase_rate) * missed
        rows[:, col.SLOPE] *= by_size
        self.rows[at] = rows

    def _follow(self, at: NDArray[np.intp]) -> None:
        """Engage in time; of one branch alone, there is nothing then."""
        self.rows[at] = np.nan
        if len(self.starts) < MOST_STARTS:
            self.status[at] = col.NO_STABLE_ORBIT
            return
        self.status[at] = col.PENDING
        InTime().settle(self.work, at, Answers(self.rows, self.status, self.used), self.periods)
        self.rows[at] = seen(self.rows[at], self.work.lever)


def _starts(work: Work, side: int) -> Array:
    """A [m] from which to start on a branch: that of orbits without losses."""
    from phasemap._kernels.excitation import likely_amplitude

    amplitudes, inverse = np.unique(work.amplitudes, return_inverse=True)
    return np.array([likely_amplitude(work.lever, float(one), side) for one in amplitudes])[inverse.reshape(-1)]
