"""What a feedback visits that holds an amplitude by moving the tip offset, slowly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phasemap._kernels import columns as col
from phasemap.curves.pieces import Curves
from phasemap.curves.walk import BESIDE, Jump, Segment, land, segments

MOST_TURNS = 12  # landings before the feedback is taken to hunt for ever


@dataclass(frozen=True, eq=False)
class Place:
    """Where the tip is: on a segment, at a tip offset."""

    segment: Segment
    z0: float

    @property
    def amplitude(self) -> float:
        """Amplitude there, as the detector sees it [m]."""
        row = self.segment.row_at(self.z0)
        assert row is not None
        return float(row[col.SEEN])


class Feedback:
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

    def seek(self, place: Place, index: int, direction: int) -> tuple[Place | None, int, Jump | None]:
        """Move the tip until the amplitude is the wanted value `index`.

        Returns
        -------
        place : Place or None
            Where it is held; None if the tip hunts, or no orbit is left.
        row : int
            Row of the segment, -1 if none.
        jump : Jump or None
            If the feedback lost its orbit on the way: from where it was last held, to where it is held again.
        """
        target = float(self.curves.wanted[index])
        lost: np.ndarray | None = None
        for _ in range(MOST_TURNS):
            down = place.amplitude > target
            rows, x = place.segment.rows, place.segment.x
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
                return Place(place.segment, float(x[best])), best, jump
            edge = rows[0 if down else -1]
            lost = edge if lost is None else lost
            beyond = float(edge[col.TIP_OFFSET]) + (-BESIDE if down else BESIDE) * self.span
            landed = land(self.curves, col.TIP_OFFSET, self.parts, edge, beyond)
            if landed is not None:
                place = Place(landed, beyond)
                continue
            # The tip taps irregularly, about as high as it is above the surface, until a stable orbit appears.
            following = self._next(beyond, down)
            if following is None:
                break
            place = following
        return None, -1, Jump(direction, lost, None) if lost is not None else None
