"""A tip on no periodic orbit, which a sweep takes along in time."""

from __future__ import annotations

import numpy as np

from phasemap._kernels import columns as col
from phasemap.experiment.accuracy import MOST_PERIODS
from phasemap.experiment.lever import show
from phasemap.solvers.continuation.pieces import Curves
from phasemap.solvers.in_time import ETA


class OffOrbit:
    """A tip that left its orbit and follows no other yet.

    Parameters
    ----------
    edge : ndarray, shape (FULL,)
        Row of the last orbit it was on.
    """

    def __init__(self, edge: np.ndarray) -> None:
        self._edge = edge
        self._state: np.ndarray | None = None  # until it has moved

    def go(self, curves: Curves, column: int, x: float) -> tuple[int, np.ndarray]:
        """Move slowly to a value of the control, and return a status code and a full row of what a lock-in shows there.

        `column`: of the control: TIP_OFFSET, AMPLITUDE, or PARAMETER.
        """
        from phasemap._kernels.engagement.in_time import move_to_amplitude, move_to_tip_offset
        from phasemap._kernels.orbits.collocation.path import HELD_AMPLITUDE, held_value
        from phasemap._kernels.orbits.time.landing import state_in_row

        row, target, by_amplitude = np.full(col.FULL, np.nan), x, column == col.AMPLITUDE
        oscillator = curves.standing(x if column == col.PARAMETER else 0.0)
        if column == col.PARAMETER:
            target, by_amplitude = held_value(curves.path, x), curves.path.kind == HELD_AMPLITUDE
            row[col.PARAMETER] = x
        if self._state is None:
            self._state = state_in_row(oscillator.lever, self._edge)
        move = move_to_amplitude if by_amplitude else move_to_tip_offset
        status = move(oscillator, target, ETA, MOST_PERIODS, self._state, row[: col.COLUMNS])
        if status != col.GOOD:
            row[: col.COLUMNS] = np.nan
        row[col.SEEN] = show(oscillator.lever, row[col.AMPLITUDE], row[col.PHASE])[0]
        return int(status), row
