"""A slow sweep: stable orbits as long as there are any, and where the tip goes when they end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.engagement.in_time import free_state, move_to_amplitude, move_to_tip_offset
from phasemap._kernels.law import Law, Oscillator
from phasemap._kernels.lever import free_amplitude
from phasemap._kernels.orbits.averaged.orbits import ratio_far_from_surface
from phasemap._kernels.orbits.collocation.path import HELD_AMPLITUDE, held_value
from phasemap._kernels.orbits.time.many_periods import state_in_row
from phasemap.experiment.accuracy import MOST_PERIODS
from phasemap.experiment.lever import detected_signal
from phasemap.results.status import Status
from phasemap.solvers.continuation.curves import Curves, Piece
from phasemap.solvers.in_time import ETA

BESIDE = 1e-4  # of the control's range, past the end of a branch: where the tip is let go
MOST_LANDINGS = 8  # between two values wanted
LIKE = 0.05  # radians and amplitudes: orbits as near are of one branch
GOES_ON = 1e-3  # the same: what moves by less where its curve ends has not jumped

MOST_TURNS = 12  # landings before the feedback is taken to hunt for ever


def move_in_time(
    oscillator: Oscillator, state: np.ndarray, target: float, by_amplitude: bool
) -> tuple[int, np.ndarray]:
    """Move a tip in this state, which changes, slowly to a tip offset or an amplitude [m]: a status, and a full row."""
    row = np.full(col.FULL, np.nan)
    move = move_to_amplitude if by_amplitude else move_to_tip_offset
    status = move(oscillator, target, ETA, MOST_PERIODS, state, row[: col.COLUMNS])
    if status != col.GOOD:
        row[: col.COLUMNS] = np.nan
    row[col.SEEN] = detected_signal(oscillator.lever, row[col.AMPLITUDE], row[col.PHASE])[0]
    return int(status), row


def far_state(oscillator: Oscillator, farthest: float = 0.0, remembers: Law | None = None) -> np.ndarray:
    """State in time of a tip that swings freely far above the surface, at a tip offset of `farthest` [m] at least.

    A state has room for what the surface remembers. Where a sweep goes on to surfaces that remember more than this one,
    `remembers` is the law of the longest memory, for which room is made.
    """
    law, lever, free = remembers or oscillator.law, oscillator.lever, free_amplitude(oscillator.lever)
    law = law._replace(arms=col.MOST_ARMS) if law.arms > 1 else law  # others may follow
    return free_state(law, lever, max(free * ratio_far_from_surface(oscillator, 0.5 * free), farthest))


class OffOrbit:
    """A tip on no orbit, that left one with the full row `edge` or has a state, which a sweep takes along in time."""

    def __init__(self, edge: np.ndarray | None = None, state: np.ndarray | None = None) -> None:
        self._edge = edge
        self._state = state  # None until it has moved

    def go(self, curves: Curves, column: int, x: float) -> tuple[int, np.ndarray]:
        """Move to a value of the control, whose column is TIP_OFFSET, AMPLITUDE, or PARAMETER: as `move_in_time`."""
        swept = column == col.PARAMETER
        oscillator, target, by_amplitude = curves.oscillator_at(x if swept else 0.0), x, column == col.AMPLITUDE
        if swept:
            target, by_amplitude = held_value(curves.path, x), curves.path.kind == HELD_AMPLITUDE
        if self._state is None and self._edge is not None:
            self._state = state_in_row(oscillator.lever, self._edge)
        assert self._state is not None
        status, row = move_in_time(oscillator, self._state, target, by_amplitude)
        if swept:
            row[col.PARAMETER] = x
        return status, row


@dataclass(frozen=True, eq=False)
class Segment:
    """Stable orbits between two folds or losses of stability, in the order of the control."""

    rows: np.ndarray  # shape (n, FULL)
    traces: np.ndarray  # shape (n, 2, samples)
    x: np.ndarray  # shape (n,); the control, rising

    @cached_property
    def at_wanted(self) -> tuple[np.ndarray, np.ndarray]:
        """Numbers of the values wanted that it has rows at, rising, and these rows; of several the first."""
        places = np.flatnonzero(self.rows[:, col.KIND] == col.WANTED)
        numbers, first = np.unique(self.rows[places, col.INDEX].astype(int), return_index=True)
        return numbers, places[first]

    def row_at(self, x: float) -> np.ndarray | None:
        """The row at this control, linear between rows; None where the segment does not reach."""
        if not self.x[0] <= x <= self.x[-1]:
            return None
        i = min(max(int(np.searchsorted(self.x, x)), 1), len(self.x) - 1)
        width = self.x[i] - self.x[i - 1]
        share = (x - self.x[i - 1]) / width if width > 0 else 1.0
        return self.rows[i - 1] + share * (self.rows[i] - self.rows[i - 1])


@dataclass(frozen=True)
class Jump:
    """A jump of a sweep: the rows before and after; None where no stable orbit was reached."""

    direction: int
    before: np.ndarray
    after: np.ndarray | None


@dataclass(frozen=True, eq=False)
class Visit:
    """Orbits of a sweep in one direction: a row, a trace and a status for each value wanted, and where it ended."""

    rows: np.ndarray
    traces: np.ndarray
    status: np.ndarray
    jumps: list[Jump]
    ended: Segment | OffOrbit | None = None


Landing = Callable[[np.ndarray, float], Segment | OffOrbit]


def stable_rows(rows: np.ndarray, held: bool = False) -> np.ndarray:
    """True for stable orbits: at fixed tip offset, and with `held` under a feedback too."""
    good: np.ndarray = rows[:, col.FLOQUET] < 1
    return good & (rows[:, col.SLOPE] > 0) if held else good


def stable_segments(curves: Curves, held: bool = False) -> list[Segment]:
    """Stable segments of all pieces; folds, where stability ends, belong to them."""
    segments, column = [], curves.column
    for piece in curves.pieces:
        rows, folds = piece.rows, piece.rows[:, col.KIND] == col.FOLD
        good = stable_rows(rows, held) | folds
        steps = np.sign(np.diff(rows[:, column], prepend=rows[:1, column]))
        begin = 0
        for i in range(1, len(rows) + 1):
            ends = i == len(rows) or not good[i] or (folds[i - 1] and i - 1 > begin)
            ends |= i - 1 > begin and i < len(rows) and steps[i] * steps[i - 1] < 0  # a fold that was not located
            if not good[begin]:
                begin = i
                continue
            if not ends:
                continue
            part = slice(begin, i)
            if i - begin >= 2 and not (i - begin == 2 and folds[part].all()):
                segments.append(_segment(piece, part, column, held))
            begin = i - 1 if i < len(rows) and good[i] else i
    return [segment for segment in segments if segment is not None and len(segment.x) >= 2]


def _segment(piece: Piece, part: slice, column: int, held: bool) -> Segment | None:
    """The stable orbits of a part of a piece, the control rising; None if one of them is not stable."""
    rows, traces = piece.rows[part], piece.traces[part]
    x = rows[:, column]
    inside = rows[(rows[:, col.KIND] != col.FOLD)]
    if not len(inside) or not stable_rows(inside, held).all():
        return None
    if x[-1] < x[0]:
        rows, traces, x = rows[::-1], traces[::-1], x[::-1]
    rising = np.concatenate([[True], np.diff(x) > 0])
    return Segment(rows[rising], traces[rising], x[rising])


def visit_values(
    curves: Curves, first: Segment | OffOrbit | None, parts: list[Segment], down: bool, direction: int,
    landing: Landing | None = None,
) -> Visit:  # fmt: skip
    """Go through the values wanted, from the highest down or from the lowest up, beginning on `first`.

    `landing` says where a tip goes whose segment has ended; by default `settle_at` does. As long as it follows no
    periodic orbit it goes on in time, and its rows are means, with their spread.
    """
    wanted = curves.wanted
    n = len(wanted)
    rows, traces = np.full((n, col.FULL), np.nan), np.full((n, 2, curves.samples), np.nan)
    status, jumps = np.full(n, Status.no_stable_orbit.code, np.int8), list[Jump]()
    beside = BESIDE * (float(np.ptp(wanted)) or abs(float(wanted[0])))
    here, values = first, wanted.tolist()
    k, last, on = (n - 1, -1, -1) if down else (0, n, 1)
    while k != last:
        x = values[k]
        for _ in range(MOST_LANDINGS):
            if not isinstance(here, Segment) or here.x[0] <= x <= here.x[-1]:
                break
            edge = here.rows[0 if down else -1]
            at = float(edge[curves.column])
            beyond = max(at - beside, x) if down else min(at + beside, x)
            here = landing(edge, beyond) if landing else settle_at(curves, parts, edge, beyond)
            after = _row_after_jump(curves, here, beyond)
            if after is None or orbit_distance(edge, after) > GOES_ON:
                jumps.append(Jump(direction, edge, after))
        if isinstance(here, OffOrbit):
            status[k], row = here.go(curves, curves.column, x)
            again = segment_through(parts, x, row) if is_periodic(row) else None
            if again is None:
                rows[k] = row
                here = here if status[k] == col.GOOD else None
                k += on
                continue
            here = again
        if here is None:
            # Nothing was reached on which the tip stays: it is found again where there is only one such orbit.
            reaching = [part for part in parts if part.row_at(x) is not None]
            here = _only_one(curves, reaching, x)
            if reaching and here is None:
                status[k] = Status.not_settled.code
        if here is None:
            k += on
            continue
        end = _next_beyond(here, wanted, k, down)
        part = slice(end - on, k + 1) if down else slice(k, end)
        numbers, of = here.at_wanted
        known = (numbers >= part.start) & (numbers < part.stop)
        status[part] = col.NOT_CONVERGED
        status[numbers[known]] = col.GOOD
        rows[numbers[known]], traces[numbers[known]] = here.rows[of[known]], here.traces[of[known]]
        k = end
    return Visit(rows, traces, status, jumps, here)


def _next_beyond(here: Segment, wanted: np.ndarray, k: int, down: bool) -> int:
    """The next value wanted on the way that the segment does not reach, after number k, which it does."""
    if down:
        return min(int(np.searchsorted(wanted, here.x[0])), k) - 1
    return max(int(np.searchsorted(wanted, here.x[-1], side="right")), k + 1)


def _row_after_jump(curves: Curves, here: Segment | OffOrbit, x: float) -> np.ndarray | None:
    """The row of a tip just after a jump; None if it comes to no steady motion."""
    if isinstance(here, Segment):
        return here.row_at(x)
    status, row = here.go(curves, curves.column, x)
    return row if status == col.GOOD else None


def is_periodic(row: np.ndarray) -> bool:
    """True if a row is that of a periodic orbit."""
    return bool(np.isfinite(row[col.AMPLITUDE]) and not col.is_mean(row))


def segment_through(parts: list[Segment], x: float, row: np.ndarray) -> Segment | None:
    """The segment that passes this orbit at x."""
    best, nearest = LIKE, None
    for part in parts:
        here = part.row_at(x)
        if here is not None and orbit_distance(here, row) < best:
            best, nearest = orbit_distance(here, row), part
    return nearest


def orbit_distance(first: np.ndarray, second: np.ndarray) -> float:
    """How far two orbits are apart in phase [rad], tip offset and amplitude, both over the amplitude."""
    places = abs(first[col.TIP_OFFSET] - second[col.TIP_OFFSET]) + abs(first[col.AMPLITUDE] - second[col.AMPLITUDE])
    return float(abs(first[col.PHASE] - second[col.PHASE]) + places / second[col.AMPLITUDE])


def _only_one(curves: Curves, segments: list[Segment], x: float) -> Segment | None:
    """The only segment there at x, which then is the one on which a tip settles.

    None where there are several or none, or a contact with hysteresis, which may tap irregularly beside it.
    """
    hysteretic = bool(curves.oscillator_at(x if curves.column == col.PARAMETER else 0.0).p[col.RELEASE] != 0)
    return segments[0] if len(segments) == 1 and not hysteretic else None


def settle_at(curves: Curves, parts: list[Segment], start: np.ndarray, x: float) -> Segment | OffOrbit:
    """The segment on which a tip settles that comes from the orbit `start` and finds itself at x; or off all."""
    reaching = [part for part in parts if part.x[0] <= x <= part.x[-1]]
    segment = _only_one(curves, reaching, x)
    if reaching and segment is None:
        row = curves.let_go(start, x)
        segment = None if row is None else segment_through(reaching, x, row)
    return segment or OffOrbit(start)


@dataclass(frozen=True, eq=False)
class TipPlace:
    """Place of the tip: at a tip offset on a segment, or off all of them."""

    on: Segment | OffOrbit
    z0: float


class Held(NamedTuple):
    """Orbit on which a feedback holds an amplitude."""

    place: TipPlace | None  # none if the tip hunts, or nothing can be held
    row: np.ndarray | None  # shape (FULL,), or None
    trace: np.ndarray | None  # shape (2, samples), or None; none too where the motion is not periodic
    # If the feedback lost its orbit on the way: from where it was last held, to where it is held again
    jump: Jump | None
    status: int  # code of `phasemap._kernels.columns`


class SlowFeedback:
    """A feedback that seeks amplitudes, slowly, on curves followed from far whose wanted values are amplitudes."""

    def __init__(self, curves: Curves) -> None:
        self.curves = curves
        self.parts = stable_segments(curves)
        self.span = float(np.ptp(curves.wanted)) or float(curves.wanted[-1])

    def far(self) -> TipPlace:
        """Place of the tip before it is lowered."""
        highest = max(self.parts, key=lambda part: part.x[-1], default=None)
        if highest is None:
            return TipPlace(OffOrbit(state=far_state(self.curves.oscillator_at(0.0))), np.inf)
        return TipPlace(highest, float(highest.x[-1]))

    def nearest(self, row: np.ndarray) -> TipPlace:
        """The place at the tip offset of a result row, or else at the nearest end, whose orbit is most like it."""
        z0, places = float(row[col.TIP_OFFSET]), list[tuple[float, float, TipPlace]]()
        for part in self.parts:
            here = TipPlace(part, float(np.clip(z0, part.x[0], part.x[-1])))
            orbit = part.row_at(here.z0)
            assert orbit is not None
            apart = abs(orbit[col.AMPLITUDE] / row[col.AMPLITUDE] - 1.0) + abs(orbit[col.PHASE] - row[col.PHASE])
            places.append((abs(here.z0 - z0), float(apart), here))
        return min(places, key=lambda place: place[:2], default=(0.0, 0.0, TipPlace(OffOrbit(row), z0)))[2]

    def move_to_wanted(self, place: TipPlace, index: int, direction: int) -> Held:
        """Move the tip until the amplitude is the wanted value `index`."""
        target = float(self.curves.wanted[index])
        lost: np.ndarray | None = None
        for _ in range(MOST_TURNS):
            if isinstance(place.on, OffOrbit):
                return self._in_time(place.on, index, direction, lost)
            here = place.on.row_at(place.z0)
            assert here is not None
            down = float(here[col.SEEN]) > target
            rows, x = place.on.rows, place.on.x
            ahead = np.flatnonzero((x <= place.z0) if down else (x >= place.z0))
            ahead = ahead[::-1] if down else ahead
            wanted = (rows[ahead, col.KIND] == col.WANTED) & (rows[ahead, col.INDEX] == index)
            first = int(np.argmax(wanted)) if wanted.any() else len(ahead)
            turns = np.flatnonzero(rows[ahead[:first], col.KIND] == col.TURN)
            if lost is None and len(turns):
                lost = rows[ahead[turns[0]]]
            if wanted.any():
                best = int(ahead[first])
                jump = None if lost is None else Jump(direction, lost, rows[best])
                return Held(TipPlace(place.on, float(x[best])), rows[best], place.on.traces[best], jump, col.GOOD)
            edge = rows[0 if down else -1]
            lost = edge if lost is None else lost
            beyond = float(edge[col.TIP_OFFSET]) + (-BESIDE if down else BESIDE) * self.span
            place = TipPlace(settle_at(self.curves, self.parts, edge, beyond), beyond)
        return Held(None, None, None, None if lost is None else Jump(direction, lost, None), col.NO_STABLE_ORBIT)

    def _in_time(self, tip: OffOrbit, index: int, direction: int, lost: np.ndarray | None) -> Held:
        """Orbit on which the feedback of an instrument holds a tip that it moves on no periodic orbit."""
        status, row = tip.go(self.curves, col.AMPLITUDE, float(self.curves.wanted[index]))
        if status != col.GOOD:
            return Held(None, None, None, None if lost is None else Jump(direction, lost, None), status)
        jump, z0 = None if lost is None else Jump(direction, lost, row), float(row[col.TIP_OFFSET])
        segment = segment_through(self.parts, z0, row) if is_periodic(row) else None
        if segment is None:
            return Held(TipPlace(tip, z0), row, None, jump, col.GOOD)
        known = (segment.rows[:, col.KIND] == col.WANTED) & (segment.rows[:, col.INDEX] == index)
        near = int(np.argmin(np.where(known, np.abs(segment.x - z0), np.inf)))
        if not known.any():
            return Held(TipPlace(segment, z0), row, None, jump, col.GOOD)
        wanted_row, trace = segment.rows[near], segment.traces[near]
        return Held(TipPlace(segment, float(segment.x[near])), wanted_row, trace, jump, col.GOOD)
