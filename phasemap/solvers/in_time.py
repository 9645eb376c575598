"""Motion in time until it is steady, for every solver, where no curve of orbits tells the motion."""

from __future__ import annotations

from typing import Any

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.rows.answers import Answers
from phasemap._shared.interrupts import check_stopped
from phasemap.experiment.accuracy import ERROR_HEIGHT, ERROR_PHASE, MOST_PERIODS
from phasemap.solvers.problem import Work

ENOUGH = 500.0  # quality factor up to which the steps need not be shorter
ETA = 0.25  # size of the steps, of which the following are the errors
MARGIN = 2.0  # of the errors that missing energy stands for, over the least: 1.3 in draws of lasting dents


class InTime:
    """Time integration with Runge-Kutta steps of order 8 and the contact located, until the motion is known.

    Only motion that time leads to is found, so that an orbit that settles is stable. Motion that does not repeat itself
    is held on the amplitude that a slow lock-in shows.

    `eta`: size of the steps up to Q = 500, shorter above; the error goes with its 8th power and is below 5e-5 degree
        and 0.01 pm at the default. That is what a row states; smaller steps state no less, for the orbit is followed
        until it repeats itself to about as much.
    """

    def __init__(self, eta: float = ETA) -> None:
        self.eta = eta

    def engage(self, work: Work, chosen: np.ndarray, answers: Answers, periods: int) -> None:
        """March the chosen rows, an array of numbers, from far."""
        answers.status[chosen] = col.PENDING  # for `settle`: there is no orbit to begin with
        self.settle(work, chosen, answers, periods)

    def settle(self, work: Work, chosen: np.ndarray, answers: Answers, periods: int = MOST_PERIODS) -> None:
        """March the chosen rows, an array of numbers: from the orbits there, or from far where none is GOOD."""
        from phasemap._kernels.rows.marched import march_rows

        if len(chosen):
            self._march(march_rows, work, chosen, answers, periods)

    def engage_with_second_drive(self, work: Work, chosen: np.ndarray, answers: Answers, periods: int) -> None:
        """March the chosen rows from far while the second mode is driven too; amplitudes are the detector's."""
        from phasemap._kernels.rows.marched import second_drive_rows

        self._march(second_drive_rows, work, chosen, answers, periods)

    def _march(self, rows_of: Any, work: Work, chosen: np.ndarray, answers: Answers, periods: int) -> None:
        """Let a kernel of `rows.marched` fill the chosen rows."""
        from phasemap._kernels.lever_modes import slowest_decay

        # An error per period counts Q / pi times in the steady orbit, and goes with eta^8.
        eta = self.eta * min(1.0, 2 * ENOUGH * slowest_decay(work.lever)) ** 0.125
        rows, codes, _ = answers.of(chosen)
        for i in range(len(chosen)):  # one by one, because one may take seconds
            check_stopped()
            row = slice(i, i + 1)
            rows_of(work.part(chosen[row]).pixels, eta, periods, rows[row], codes[row])
        periodic = (codes == col.GOOD) & ~col.is_mean(rows)
        coarser = max(self.eta / ETA, 1.0) ** 8
        errors = np.array([ERROR_PHASE, ERROR_HEIGHT])
        rows[np.ix_(periodic, [col.ERROR_PHASE, col.ERROR_HEIGHT])] = coarser * errors
        if work.law.memory:
            self._state_closure(rows, periodic)
        answers.put(chosen, Answers(rows, codes, np.full(len(chosen), col.MARCH, np.int8)))

    @staticmethod
    def _state_closure(rows: np.ndarray, periodic: np.ndarray) -> None:
        """State larger errors where energy is missing that surfaces remember: dents that last have kinks.

        With no other error sin(lag) is off by that share of itself, and a depth by that over cos(lag)^2: theory,
        Eq. (memory-11).
        """
        orbits = rows[periodic]
        missing = MARGIN * np.abs(orbits[:, col.CLOSURE])
        sine, cosine = np.abs(np.sin(orbits[:, col.PHASE])), np.abs(np.cos(orbits[:, col.PHASE]))  # of pi/2 - lag
        sine = np.maximum(sine, np.sqrt(missing))
        phase = missing * np.maximum(cosine / sine, 1.0)
        height = missing * np.maximum(orbits[:, col.AMPLITUDE], orbits[:, col.INDENTATION] / sine**2)
        for column, error in ((col.ERROR_PHASE, phase), (col.ERROR_HEIGHT, height)):
            rows[periodic, column] = np.maximum(orbits[:, column], error)
