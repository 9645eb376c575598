"""Orbits at which the detector shows the setpoint, where what it sees is not the position of the tip.

Which amplitude A of z the detector shows as the setpoint depends on the phase. Engagement from far holds what is seen
itself. On a branch that engagement does not find, A is come to by secants, all materials at a time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels import columns as col
from phasemap._kernels.rows.answers import Answers
from phasemap.experiment.lever import (
    amplitude_at,
    in_proportion,
    lost_in_air,
    offset_and_factor,
    seen,
    show,
    supplied,
    tip_amplitudes,
    tip_seen,
)
from phasemap.solvers.problem import Work

Array = NDArray[np.float64]
Codes = NDArray[np.int8]
Found = tuple[Array, Codes, Codes]
"""Result rows, status and solver codes."""

ATTRACTIVE, REPULSIVE = -1, 1
MOST_ROUNDS, MOST_MISSING = 40, 6
EXACT, CLOSE = 1e-12, 1e-7  # of the setpoint: found; enough in the end
PATIENT = 8  # rounds after which that is enough
LEAST_SLOPE = 0.05  # of the amplitude seen with A, that of a branch that can be held
APART = 1e-7  # of A: secants over less say nothing of the slope
JUMP, STEEP = 1e-3, 30.0  # of A, and slope of the amplitude seen: what changes the branch so fast is a jump
A, MISS, PHASE, OFFSET, SIDE, LAST = 0, 1, 2, 3, 4, 5  # what is known of the last orbit


def engage(work: Work, limits: Array, answers: Answers) -> None:
    """Orbits of the tip that curves of orbits give after engagement.

    `limits` (shape (2,)): largest errors of passes [rad, m].
    """
    from phasemap._kernels.quadrature import TABLES
    from phasemap._kernels.rows.exact import seen_rows

    rows, slopes = answers.rows, np.full((len(work), 3), np.nan)
    seen_rows(work.pixels, TABLES, limits, answers, slopes)
    good = answers.status == col.GOOD
    orbits = rows[good, : col.COLUMNS]
    rows[good, : col.COLUMNS] = _at_seen(orbits, slopes[good], work.lever, work.amplitudes[good])


def at_tip(work: Work) -> Work:
    """The work that solvers know: where the amplitude that is seen is that of z times a number, work of the tip."""
    if not in_proportion(work.lever):
        return work
    return replace(work, lever=tip_seen(work.lever), amplitudes=work.amplitudes / abs(offset_and_factor(work.lever)[1]))


def close(rows: Array, lever: Array) -> None:
    """Fill in the energy closure of orbits whose solver knows the first harmonic only: averaged and interpolated ones.

    `rows` (shape (..., COLUMNS)): result rows; those that have a closure keep it.
    `lever` (shape (n,)): as in `phasemap.solvers.problem.Work`.

    Examples
    --------
    >>> from phasemap.experiment.lever import one_mode
    >>> lever, rows = one_mode(1.0, 1e-3, 40.0, 4e-11), np.full((2, col.COLUMNS), np.nan)
    >>> rows[0, [col.AMPLITUDE, col.PHASE, col.DISSIPATION]] = 2e-8, 0.0, 0.0  # the free lever: u0 / (2 alpha0)
    >>> close(rows, lever)
    >>> np.abs(rows[:, col.CLOSURE]).round(12).tolist()
    [0.0, nan]
    """
    lacking = np.isnan(rows[..., col.CLOSURE])
    if not lacking.any():
        return
    amplitude, phase = rows[..., col.AMPLITUDE], rows[..., col.PHASE]
    given = supplied(lever, amplitude, phase)
    left = (given - rows[..., col.DISSIPATION] - lost_in_air(lever, amplitude)) / given
    rows[..., col.CLOSURE] = np.where(lacking, left, rows[..., col.CLOSURE])


def shown(rows: Array, work: Work) -> Array:
    """Result rows as the detector sees them, from those of `at_tip(work)`; with the energies that they lack."""
    close(rows, work.lever)
    if in_proportion(work.lever):
        rows[:, [col.SLOPE, col.SPREAD_AMPLITUDE]] *= abs(offset_and_factor(work.lever)[1])
    return seen(rows, work.lever)


def _at_seen(rows: Array, slopes: Array, lever: Array, size: Array) -> Array:
    """Rows of the tip with errors and the slope of the feedback at a given amplitude seen, from those at a given A.

    `slopes` (shape (n, 3)): of amplitude seen, phase and tip offset with A.
    `size` (shape (n,)): the amplitude that is to be seen [m].
    """
    rows, (offset, factor) = rows.copy(), offset_and_factor(lever)
    a, phase, error = rows[:, col.AMPLITUDE], rows[:, col.PHASE], rows[:, col.ERROR_PHASE].copy()
    # A phase that is off by one is seen off by `turn`, in an amplitude that is off by `grow`.
    part = factor * a * np.exp(1j * phase)
    share = part / (offset + part)
    turn, grow = share.real, -size * share.imag
    by_size, by_phase, by_offset = np.nan_to_num(slopes, nan=0.0).T
    by_size = np.where(by_size > LEAST_SLOPE, by_size, 1.0)
    # As the amplitude seen changes by one: phase seen, and tip offset.
    phase_rate, offset_rate = (share.imag / a + turn * by_phase) / by_size, by_offset / by_size
    missed = np.abs(show(lever, a, phase)[0] - size)
    rows[:, col.ERROR_HEIGHT] += np.abs(offset_rate) * (np.abs(grow) * error + missed)
    rows[:, col.ERROR_PHASE] = np.abs(turn - grow * phase_rate) * error + np.abs(phase_rate) * missed
    rows[:, col.SLOPE] *= by_size
    return rows


def hold(work: Work, solve: Callable[[Work], Found], side: int) -> Found:
    """Find the orbits of a branch at which the detector shows the amplitudes of a work.

    `solve`: gives the orbits of that branch for a work of amplitudes of z, rows as of `shown`.
    Returns `rows` (shape (n, COLUMNS)): as the detector sees them.
    Returns `status, solver` (shape (n,)).
    """
    if in_proportion(work.lever):
        rows, status, used = solve(at_tip(work))
        return shown(rows, work), status, used
    search = _Search(work, solve, side)
    for _ in range(MOST_ROUNDS):
        if not search.go_on():
            break
    return search.found()


class _Search:
    """Secants in A for all materials at a time, between an A that is seen too small and one that is seen too large."""

    def __init__(self, work: Work, solve: Callable[[Work], Found], side: int) -> None:
        count, lever = len(work), tip_seen(work.lever)
        self.work, self.solve, self.tip = work, solve, replace(work, lever=lever)
        self.rows = np.full((count, col.COLUMNS), np.nan)
        self.status, self.used = np.full(count, col.NO_STABLE_ORBIT, np.int8), np.full(count, -1, np.int8)
        start = _start(work, side)
        self.starts = np.stack([start, 0.5 * (start + work.amplitudes)])
        self.a, self.tried = start.copy(), np.ones(count, int)
        self.last = np.full((count, LAST), np.nan)
        self.ends = np.full((count, 2, LAST), np.nan)  # of the bracket
        self.slopes = np.full((count, 3), np.nan)  # of amplitude seen, phase and tip offset with A
        self.rounds, self.missing = np.zeros(count, int), np.zeros(count, int)
        self.open = np.ones(count, np.bool_)

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
        self.rows[at], self.open[at] = np.nan, False

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
        good = np.isfinite(self.rows[:, 0])
        rows = _at_seen(self.rows[good], self.slopes[good], self.work.lever, self.work.amplitudes[good])
        self.rows[good] = seen(rows, self.work.lever)
        self.rows[good, col.AMPLITUDE] = self.work.amplitudes[good]
        self.status[~good] = col.NO_STABLE_ORBIT
        return self.rows, self.status, self.used


def _start(work: Work, side: int) -> Array:
    """A [m] from which to start on a branch: that of orbits without losses."""
    from phasemap._kernels.excitation import likely_amplitude

    amplitudes, inverse = np.unique(work.amplitudes, return_inverse=True)
    return np.array([likely_amplitude(work.lever, float(one), side) for one in amplitudes])[inverse.reshape(-1)]
