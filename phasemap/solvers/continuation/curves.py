"""Curves of orbits in pieces: the piece from far, pieces apart from it, and those on which a tip lands.

Each is followed from every start that leads to a new one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.continuation.piece import (
    AT_JUMP,
    CURVE_TOLERANCE,
    PIECE_AT_JUMP,
    PIECE_CLOSED,
    Asked,
    KeptOrbits,
    Made,
    collocation_orbits_at,
    follow_piece,
    mark_start,
)
from phasemap._kernels.continuation.point import ENTRY_A, ENTRY_M, ENTRY_SEEN, ENTRY_Z0, Point, solve_far_from_surface
from phasemap._kernels.continuation.step import copy_orbit
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever import free_amplitude, phase_of
from phasemap._kernels.orbits.averaged.orbits import averaged_orbits
from phasemap._kernels.orbits.collocation.held_equation import HOLD_AMPLITUDE, HOLD_OFFSET
from phasemap._kernels.orbits.collocation.near import tolerance_of
from phasemap._kernels.orbits.collocation.path import Path, oscillator_at
from phasemap._kernels.orbits.collocation.system import EQUATIONS_OTHER, Orbit, head_of, new_orbit, new_orbit_like
from phasemap._kernels.orbits.time.many_periods import land_free, state_in_row
from phasemap._kernels.orbits.time.tip import Z0
from phasemap._kernels.quadrature import TABLES
from phasemap._shared.interrupts import check_stopped
from phasemap.experiment.accuracy import MOST_PERIODS
from phasemap.experiment.lever import rows_as_seen, sees_tip

PERIODS = 40.0  # of ring-down times Q / pi that a landing may take
ROOM = 6000  # rows of one piece
CLOSING = 24  # rows in which the step that closes a piece, twice the one before at most, is gone through
MOST_KEPT = 8  # orbits of one value on one piece
SAME = 1e-5  # of the amplitude: orbits as near are the same
NEAR, NEAR_PUSH = 0.03, 0.1  # of the amplitude and the base amplitude: averaging may be off by so much
MOST_PIECES = 12
BESIDE, SETTLED = 1e-5, 1e-6  # of the free amplitude: how far past an end a tip is let go, and how it settles
FARTHER = (1.0, 1e3, 1e4)  # times BESIDE: beside an orbit whose neck hardly breaks, those that keep it may begin later
MARKS = (col.WANTED, col.FOLD, col.TURN)
COLUMN_OF = {ENTRY_Z0: col.TIP_OFFSET, ENTRY_A: col.AMPLITUDE, ENTRY_M: col.PARAMETER, ENTRY_SEEN: col.SEEN}


@dataclass(frozen=True, eq=False)
class Piece:
    """Connected piece of a curve, in the order in which it was followed."""

    rows: np.ndarray  # shape (n, FULL); full rows of `phasemap._kernels.columns`
    traces: np.ndarray  # shape (n, 2, samples); deflection [m] and force [N] over one period
    orbits: list[Any]  # where one value was wanted: the orbits at it
    ended: int  # how it ended, a code of `phasemap._kernels.continuation.piece`


class Curves:
    """Pieces found so far of the curve of one path.

    `index`: entry of a point whose values are `wanted`.
    `box`: smallest and largest control, smallest amplitude [m].
    `samples`: length of the time traces. `level`: of refinement, of the orbits wanted.
    """

    def __init__(
        self, path: Path, index: int, wanted: np.ndarray, box: tuple[float, float, float], samples: int, level: int = 0
    ) -> None:
        self.path, self.index, self.wanted = path, index, wanted
        self.box, self.samples = (float(box[0]), float(box[1]), float(box[2])), samples
        self.level = level
        self.column = col.PARAMETER if index == ENTRY_M else col.TIP_OFFSET  # of the control, in a full row
        self.pieces: list[Piece] = []
        self._oscillators: dict[float, Oscillator] = {}  # a start is asked for several times

    def oscillator_at(self, m: float) -> Oscillator:
        """The lever over the material at m."""
        if m not in self._oscillators:
            self._oscillators[m] = oscillator_at(self.path, float(m))
        return self._oscillators[m]

    def seen(self, rows: np.ndarray) -> np.ndarray:
        """Rows as the detector sees them, shape (..., FULL)."""
        if sees_tip(self.oscillator_at(0.0).lever) or not rows.size:
            return rows
        at = np.nan_to_num(rows[..., col.PARAMETER]).reshape(-1)
        levers = np.array([self.oscillator_at(m).lever for m in at]).reshape(*rows.shape[:-1], -1)
        return rows_as_seen(rows, levers)

    @property
    def wanted_rows(self) -> np.ndarray:
        """Full rows at the values wanted, piece by piece."""
        rows = np.concatenate([piece.rows for piece in self.pieces] or [np.zeros((0, col.FULL))])
        return rows[rows[:, col.KIND] == col.WANTED]

    @property
    def all_followed(self) -> bool:
        """True if there is a piece, and each was followed to where it closes, leaves the box, or the force jumps.

        And if an orbit was found wherever it passes a value wanted.
        """
        whole = all(piece.ended <= PIECE_AT_JUMP and self._passed(piece) for piece in self.pieces)
        return bool(self.pieces) and whole

    def _passed(self, piece: Piece) -> bool:
        """True if a piece has as many orbits at each value wanted as its other rows pass it."""
        wanted = piece.rows[:, col.KIND] == col.WANTED
        number, x = piece.rows[wanted, col.INDEX], piece.rows[~wanted, COLUMN_OF[self.index]]
        x = np.append(x, x[:1]) if piece.ended == PIECE_CLOSED else x
        crossings = [np.count_nonzero((x[1:] > value) != (x[:-1] > value)) for value in self.wanted]
        return all(np.count_nonzero(number == k) >= count for k, count in enumerate(crossings))

    def from_far(self, farthest: float) -> None:
        """Follow the curve of a fixed path from where the surface hardly acts, at least from `farthest` [m]."""
        free = free_amplitude(self.oscillator_at(0.0).lever)
        orbit = new_orbit(self.path.lever, TABLES)
        status = solve_far_from_surface(self.path, orbit, 0.9999 * free)
        if status == col.GOOD and head_of(orbit).tip_offset < farthest:
            orbit, rows = self._exact_from_harmonic(
                np.array([[farthest, 0.0, free, 0.0, 0.0, 0.0]]), np.zeros(1), False
            )
            status = col.GOOD if len(rows) else col.NOT_CONVERGED
        if status == col.GOOD:
            self.box = (self.box[0], float(head_of(orbit).tip_offset), self.box[2])  # farther out nothing happens
            self._follow(orbit, (-1.0,))

    def from_row(self, row: np.ndarray, m: float) -> None:
        """Follow the curve both ways from the orbit of a result row at m, if it is found, and new."""
        at = np.array([m])
        orbit, rows = self._exact_from_harmonic(
            self._harmonic_orbits(row[None], at, row[None, col.TIP_OFFSET]), at, False
        )
        if len(rows):
            self.from_orbit(orbit, m)

    def from_orbit(self, orbit: Any, m: float) -> None:
        """Follow the curve both ways from an orbit of the lever over the material at m, if it is new."""
        head, row = head_of(orbit), np.zeros(col.COLUMNS)
        head.parameter, head.equations = m, EQUATIONS_OTHER  # to be linearised anew, on this path
        row[col.TIP_OFFSET], row[col.AMPLITUDE] = head.tip_offset, head.amplitude
        row[col.PHASE] = phase_of(self.oscillator_at(m).lever, head.amplitude, head.push, head.drag)
        if not self.knows(row, m):
            self._follow(orbit, (1.0, -1.0))

    def stable_rows_at(self, rows: np.ndarray, m: np.ndarray, tip_offsets: np.ndarray) -> np.ndarray | None:
        """Rows of stable orbits at these tip offsets [m], from rows of orbits near by; None if one is missing."""
        solved = self._exact_from_harmonic(self._harmonic_orbits(rows, m, tip_offsets), m, False)[1]
        if len(solved) < len(rows) or not (solved[:, col.FLOQUET] < 1).all():
            return None
        exact, known = rows.copy(), [col.TIP_OFFSET, col.AMPLITUDE, col.PHASE]
        exact[:, known] = solved[:, known]
        return exact

    def _harmonic_orbits(self, rows: np.ndarray, m: np.ndarray, tip_offsets: np.ndarray) -> np.ndarray:
        """Harmonic orbits of result rows at these tip offsets [m], with entries as `HarmonicOrbit` has its fields."""
        amplitude, stiffness = rows[:, col.AMPLITUDE], self.oscillator_at(float(m[0])).lever[col.STIFFNESS]
        drag = -rows[:, col.DISSIPATION] / (np.pi * stiffness * amplitude)
        push = rows[:, col.STIFFENING] * amplitude
        return np.stack([tip_offsets, rows[:, col.MEAN], amplitude, push, drag, np.zeros(len(rows))], axis=1)

    def follow_from_averaged(self, amplitude: float, lift: float = 0.0) -> None:
        """Follow further pieces of a fixed path from averaged orbits of this amplitude [m] that lie on none so far.

        `lift`: by which these orbits are first lifted [m].
        """
        for tip_offset, mean, _, push, drag, _ in averaged_orbits(self.oscillator_at(0.0), amplitude):
            if not self.box[0] <= tip_offset <= self.box[1] or self._near(tip_offset, amplitude, push / amplitude):
                continue
            lifted = np.array([[tip_offset + lift, mean, amplitude, push, drag, 0.0]])
            orbit, rows = self._exact_from_harmonic(lifted, np.zeros(1), True)
            if len(rows) and not self._near(*(rows[0, c] for c in (col.TIP_OFFSET, col.AMPLITUDE, col.STIFFENING))):
                self._follow(orbit, (1.0, -1.0))

    def follow_past_ends(self) -> None:
        """Follow the pieces on which a tip lands that is let go just beyond an end, in contact made or lost.

        A law with a neck, or a force that jumps, divides its curve.
        """
        swept, waiting = self.column == col.PARAMETER, list(self.pieces)
        beside = BESIDE * (1.0 if swept else float(free_amplitude(self.path.lever)))
        while waiting and len(self.pieces) < MOST_PIECES:
            rows = waiting.pop(0).rows
            for last, before in ((-1, -2), (0, 1)):
                if len(rows) < 2 or rows[last, col.KIND] != col.END:
                    continue
                grazes = abs(rows[last, col.INDENTATION]) < AT_JUMP * rows[last, col.AMPLITUDE]
                if grazes and not rows[last, col.FLOQUET] < 1:  # where a neck hardly breaks, no orbit is stable
                    continue
                known, onward = len(self.pieces), beside * np.sign(rows[last, self.column] - rows[before, self.column])
                # A neck that breaks may keep its orbits only farther on, and those in which it does not lie behind.
                farther, sides = (FARTHER[:1], (1.0,)) if grazes else (FARTHER, (1.0, -1.0))
                for side in sides:
                    self._follow_from_landing(rows[last], [side * onward * times for times in farther])
                waiting += self.pieces[known:]

    def _follow_from_landing(self, start: np.ndarray, steps: list[float]) -> None:
        """Follow the piece on which a tip lands that is let go at the first of these steps that leads to an orbit."""
        swept = self.column == col.PARAMETER
        for step in steps:
            x = float(start[self.column] + step)
            row = self.let_go(start, x)
            if row is not None:
                if swept or not self._near(x, row[col.AMPLITUDE], row[col.STIFFENING]):
                    self.from_row(row, x if swept else 0.0)
                return

    def let_go(self, start: np.ndarray, x: float) -> np.ndarray | None:
        """Result row of the orbit on which a tip comes to rest at x of the control, from the orbit of a full row.

        None if it comes to rest on none.
        """
        swept = self.column == col.PARAMETER
        oscillator = self.oscillator_at(x if swept else 0.0)
        lever = oscillator.lever
        check_stopped()
        row, state = np.zeros(col.COLUMNS), state_in_row(lever, start)
        state[Z0] = start[col.TIP_OFFSET] if swept else x
        settled = SETTLED * float(free_amplitude(lever))
        return row if land_free(oscillator, state, settled, settling_periods(lever), row) else None

    def _near(self, z0: float, amplitude: float, stiffening: float) -> bool:
        """True if a piece passes an averaged orbit at its amplitude, within the error of averaging."""
        for piece in self.pieces:
            rows = piece.rows
            a = rows[:, col.AMPLITUDE]
            i = np.flatnonzero((a[1:] > amplitude) != (a[:-1] > amplitude))
            share = (amplitude - a[i]) / (a[i + 1] - a[i])
            at = [rows[i, c] + share * (rows[i + 1, c] - rows[i, c]) for c in (col.TIP_OFFSET, col.STIFFENING)]
            off = np.abs(at[1] - stiffening) * amplitude / self.path.lever[col.DRIVE]
            if ((np.abs(at[0] - z0) < NEAR * amplitude) & (off < NEAR_PUSH)).any():
                return True
        return False

    def knows(self, row: np.ndarray, m: float) -> bool:
        """True if a piece that was followed has this orbit among its rows at m."""
        return any(_contains(piece.rows[np.abs(piece.rows[:, col.PARAMETER] - m) < 1e-9], row) for piece in self.pieces)

    def keep_wanted(self, wanted: np.ndarray) -> None:
        """Keep only these of the values wanted; rows at the others become rows on the way."""
        number = np.full(len(self.wanted), -1)
        number[np.searchsorted(self.wanted, wanted)] = np.arange(len(wanted))
        for piece in self.pieces:
            marked = piece.rows[:, col.KIND] == col.WANTED
            new = number[piece.rows[marked, col.INDEX].astype(int)]
            piece.rows[marked, col.INDEX] = new
            piece.rows[marked, col.KIND] = np.where(new < 0, col.ON_THE_WAY, col.WANTED)
        self.wanted = wanted

    def _exact_from_harmonic(
        self, harmonics: np.ndarray, m: np.ndarray, of_amplitude: bool
    ) -> tuple[Orbit, np.ndarray]:
        """Exact orbits next to harmonic ones, at their amplitudes or tip offsets, until one is not found.

        Returns the last of them, and a row of each.
        """
        hold = HOLD_AMPLITUDE if of_amplitude else HOLD_OFFSET
        orbit, rows = new_orbit(self.path.lever, TABLES), np.full((len(harmonics), col.COLUMNS), np.nan)
        count = collocation_orbits_at(self.path, harmonics, m, hold, orbit, rows)
        return orbit, rows[:count]

    def _follow(self, orbit: Orbit, senses: tuple[float, ...]) -> None:
        """Follow the piece through an orbit in each sense (1 or -1), and add it unless it is known."""
        start = new_orbit_like(orbit)
        copy_orbit(orbit, start)
        halves: list[Piece] = []
        for sense in senses:
            half = self._half(start, sense, ROOM)
            if half is None:
                continue
            halves.append(half)
            if half.ended == PIECE_CLOSED:
                halves[-1] = self._with_closing_step(half, start, -sense)
                break
        if len(halves) == 2:  # the first was followed the other way
            first, second = halves
            rows = np.concatenate([first.rows[:0:-1], second.rows])
            traces = np.concatenate([first.traces[:0:-1], second.traces])
            halves = [Piece(rows, traces, first.orbits + second.orbits, max(first.ended, second.ended))]
        for piece in halves:
            if not any(self._repeats(piece, other) for other in self.pieces):
                self.pieces.append(piece)

    def _half(self, start: Orbit, sense: float, room: int) -> Piece | None:
        """The piece from an orbit in one sense, with room for so many rows; None if it cannot be begun."""
        tolerance = CURVE_TOLERANCE * float(tolerance_of(self.oscillator_at(float(head_of(start).parameter))))
        asked = Asked(self.index, self.wanted, self.box, tolerance, self.level)
        most = MOST_KEPT if len(self.wanted) == 1 else 0
        check_stopped()
        rows, traces = np.zeros((room, col.FULL)), np.zeros((room, 2, self.samples))
        shapes = start.elements.shape, start.head.shape[1:], start.modes.shape
        kept = KeptOrbits(*(np.zeros((most, *shape)) for shape in shapes))
        orbit, point = new_orbit_like(start), Point()
        copy_orbit(start, orbit)
        if not mark_start(self.path, orbit, sense, point):
            return None
        ended, count = follow_piece(self.path, asked, orbit, point, Made(rows, traces, kept))
        orbits = [
            orbit._replace(elements=kept.elements[i], head=kept.heads[i : i + 1], modes=kept.modes[i])
            for i in range(len(kept.heads)) if kept.heads[i].any()
        ]  # fmt: skip
        rows = rows[:count].copy()
        marked = rows[:, col.KIND] == col.WANTED  # at these values to the last bit, for a sweep may end at one
        rows[marked, COLUMN_OF[self.index]] = self.wanted[rows[marked, col.INDEX].astype(int)]
        return Piece(rows, traces[:count].copy(), orbits, ended)

    def _with_closing_step(self, piece: Piece, start: Orbit, sense: float) -> Piece:
        """A closed piece with what lies on the step that closes it, with which the other sense begins."""
        other = self._half(start, sense, CLOSING + len(self.wanted))
        if other is None:
            return piece
        kind = other.rows[:, col.KIND]
        new = [i for i in np.flatnonzero(np.isin(kind, MARKS)) if not _contains(piece.rows, other.rows[i])][::-1]
        wanted = np.flatnonzero(kind == col.WANTED).tolist()
        orbits = [one for i, one in zip(wanted, other.orbits, strict=False) if i in new]
        rows, traces = (np.concatenate([first, second[new]])
                        for first, second in ((piece.rows, other.rows), (piece.traces, other.traces)))  # fmt: skip
        return Piece(rows, traces, piece.orbits + orbits, piece.ended)

    @staticmethod
    def _repeats(piece: Piece, other: Piece) -> bool:
        """True if a piece was followed before: all its orbits at values wanted, or its folds, are the other's."""
        kind = piece.rows[:, col.KIND]
        marks = piece.rows[kind == (col.WANTED if (kind == col.WANTED).any() else col.FOLD)]
        return len(marks) > 0 and all(_contains(other.rows, row) for row in marks)


def _contains(rows: np.ndarray, row: np.ndarray) -> bool:
    """True if one of the rows is this orbit."""
    apart = np.abs(rows[:, col.TIP_OFFSET] - row[col.TIP_OFFSET]) + np.abs(rows[:, col.AMPLITUDE] - row[col.AMPLITUDE])
    turned = np.abs(rows[:, col.PHASE] - row[col.PHASE])
    return bool(((apart < SAME * row[col.AMPLITUDE]) & (turned < 10 * SAME)).any())


def settling_periods(lever: np.ndarray) -> int:
    """Periods after which a tip that was let go is no longer expected to settle, or that are too many."""
    return min(int(PERIODS / (2 * np.pi * lever[col.ALPHA0])) + 200, MOST_PERIODS)
