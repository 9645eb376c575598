"""What a feedback visits that holds an amplitude by moving the tip offset, slowly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap.solvers.continuation.off_orbit import OffOrbit
from phasemap.solvers.continuation.pieces import Curves
from phasemap.solvers.continuation.visit import BESIDE, Jump, Segment, is_periodic, land, like, segments

MOST_TURNS = 12  # landings before the feedback is taken to hunt for ever


@dataclass(frozen=True, eq=False)
class Place:
    """Where the tip is: at a tip offset on a segment, or on none."""

    on: Segment | OffOrbit
    z0: float


class Held(NamedTuple):
    """Where a feedback holds an amplitude."""

    place: Place | None  # none if the tip hunts, or nothing can be held
    row: np.ndarray | None  # shape (FULL,), or None
    trace: np.ndarray | None  # shape (2, samples), or None; none too where the motion is not periodic
    # If the feedback lost its orbit on the way: from where it was last held, to where it is held again
    jump: Jump | None


class SlowFeedback:
    """Seeks amplitudes on the curve of a fixed path whose wanted values are amplitudes.

    Parameters
    ----------
    curves : Curves
        Followed from far.
    """

    def __init__(self, curves: Curves) -> None:
        self.curves = curves
        self.parts = segments(curves.pieces, col.TIP_OFFSET)
        reach = max((part.x[-1] for part in self.parts), default=0.0)
        self.span = float(np.ptp(curves.wanted)) or float(curves.wanted[-1])
        self.farthest = next((part for part in self.parts if part.x[-1] == reach), None)

    def far(self) -> Place | None:
        """Where the tip is before it is lowered."""
        return None if self.farthest is None else Place(self.farthest, float(self.farthest.x[-1]))

    def nearest(self, row: np.ndarray) -> Place | None:
        """The place at the tip offset of a result row whose orbit is most like it."""
        best, place = np.inf, None
        for part in self.parts:
            here = part.row_at(float(row[col.TIP_OFFSET]))
            if here is None:
                continue
            apart = abs(here[col.AMPLITUDE] - row[col.AMPLITUDE]) / row[col.AMPLITUDE] + abs(
                here[col.PHASE] - row[col.PHASE]
            )
            if apart < best:
                best, place = apart, Place(part, float(row[col.TIP_OFFSET]))
        return place

    def _next(self, z0: float, down: bool) -> Place | None:
        """The first place that a tip reaches that is lowered, or raised, from where nothing is stable."""
        if down:
            part = max((part for part in self.parts if part.x[-1] < z0), key=lambda part: part.x[-1], default=None)
            return None if part is None else Place(part, float(part.x[-1]))
        part = min((part for part in self.parts if part.x[0] > z0), key=lambda part: part.x[0], default=None)
        return None if part is None else Place(part, float(part.x[0]))

    def seek(self, place: Place, index: int, direction: int) -> Held:
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
                return Held(Place(place.on, float(x[best])), rows[best], place.on.traces[best], jump)
            edge = rows[0 if down else -1]
            lost = edge if lost is None else lost
            beyond = float(edge[col.TIP_OFFSET]) + (-BESIDE if down else BESIDE) * self.span
            landed = land(self.curves, col.TIP_OFFSET, self.parts, edge, beyond)
            # Where it settles on nothing it is moved on until a stable orbit appears.
            following = self._next(beyond, down) if landed is None else Place(landed, beyond)
            if following is None:
                break
            place = following
        return Held(None, None, None, None if lost is None else Jump(direction, lost, None))

    def _in_time(self, tip: OffOrbit, index: int, direction: int, lost: np.ndarray | None) -> Held:
        """What the feedback of an instrument finds that moves a tip on no periodic orbit."""
        status, row = tip.go(self.curves, col.AMPLITUDE, float(self.curves.wanted[index]))
        if status != col.GOOD:
            return Held(None, None, None, None if lost is None else Jump(direction, lost, None))
        jump, z0 = None if lost is None else Jump(direction, lost, row), float(row[col.TIP_OFFSET])
        segment = like(self.parts, z0, row) if is_periodic(row) else None
        if segment is None:
            return Held(Place(tip, z0), row, None, jump)
        known = (segment.rows[:, col.KIND] == col.WANTED) & (segment.rows[:, col.INDEX] == index)
        near = int(np.argmin(np.where(known, np.abs(segment.x - z0), np.inf)))
        if not known.any():
            return Held(Place(segment, z0), row, None, jump)
        return Held(Place(segment, float(segment.x[near])), segment.rows[near], segment.traces[near], jump)
