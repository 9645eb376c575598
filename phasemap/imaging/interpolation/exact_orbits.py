"""The exact orbits that an atlas is made of."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels import columns as col
from phasemap._kernels.quadrature import TABLES
from phasemap._kernels.rows.exact import NearbyGuesses, nearby_rows
from phasemap._kernels.wide import ADHESION_LOSS
from phasemap._shared.arrays import Array
from phasemap._shared.threads import bounds_of, chunk_of, spread
from phasemap.experiment.accuracy import Accuracy
from phasemap.experiment.excitation import of_tip, seen
from phasemap.experiment.microscope import Microscope
from phasemap.imaging.interpolation.axes import Axes
from phasemap.results.variables import OF_ORBITS
from phasemap.solvers.integrals import bare_rows, widened
from phasemap.solvers.orbit import Orbit
from phasemap.solvers.problem import Work, work_of
from phasemap.solvers.run import run

FUNCTIONS = (col.TIP_OFFSET, col.PHASE, col.MEAN, col.INDENTATION, col.DISSIPATION, col.VIRIAL)
"""Result columns that are interpolated, besides those of integrals that are asked for; the others follow from these."""
HEIGHT, PHASE, MEAN, DEPTH = 0, 1, 2, 3  # places in FUNCTIONS

CHUNK = 400  # orbits that a thread takes at a time


class ExactOrbits:
    """Exact orbits at points of the coordinates, and how many were asked for.

    `amplitude`: at the setpoint [m].
    `names`: image variables; of those in `phasemap.results.variables.OF_ORBITS` the columns are functions, too.
    `film` (shape (1, 2)): Poisson's ratio [1] and thickness [m] of the film on a rigid base that all materials are.
    """

    def __init__(
        self, scope: Microscope, amplitude: float, axes: Axes, workers: int, accuracy: Accuracy | None = None,
        names: tuple[str, ...] = (), film: Array | None = None,
    ) -> None:  # fmt: skip
        self.film = film
        self.scope, self.amplitude, self.axes = scope, amplitude, axes
        self.asked = 0
        self.functions = functions_of(names)
        self._names = names
        # The same orbits without the integrals, which borders do not ask for
        self.bare = (
            self if self.functions == FUNCTIONS else ExactOrbits(scope, amplitude, axes, workers, accuracy, film=film)
        )
        self._workers, self._accuracy = workers, accuracy or Accuracy()

    def _work(self, points: Array, amplitude: float | None) -> Work:
        self.asked += len(points)
        return work_of(
            *self.axes.materials(points.T), self.scope, amplitude or self.amplitude, self._films(len(points))
        )

    def _films(self, count: int) -> Array | None:
        return None if self.film is None else np.broadcast_to(self.film, (count, 2))

    def __call__(self, points: Array, amplitude: float | None = None, *, in_time: bool = True) -> Array:
        """Functions after engagement at n points, shape (n, functions): NaN where no orbit is held.

        `amplitude`: in place of that at the setpoint [m].
        `in_time`: whether time is asked where no curve of orbits tells, which is a thousand times slower.
        """
        work = self._work(points, amplitude)
        rows, status, used = run(Orbit(in_time=in_time), work, self._accuracy, threads=self._workers)
        return self._functions(work, points, rows, status, used)

    def near(self, points: Array, guesses: Array, away: Array, amplitude: float | None = None, group: int = 1) -> Array:
        """Functions of the orbits next to guesses, NaN without one: without engagement, which is cheaper near a jump.

        `guesses` (shape (n, functions)): as from exact orbits; tip offset, phase and mean deflection are used.
        `away` (shape (n,)): how far off the tip offset may be [m].
        `amplitude`: in place of that at the setpoint [m].
        `group`: so many points, one after another, are close to each other.
        """
        if self.scope.drive.excitation == "base":  # the amplitude of the tip that is held is not known before its phase
            return self(points, amplitude)
        work, count = self._work(points, amplitude), len(points)
        rows, status = np.full((count, col.COLUMNS), np.nan), np.full(count, col.NOT_CONVERGED, np.int8)
        offsets, means, phases = guesses[:, [HEIGHT, MEAN, PHASE]].T.copy()
        amplitudes, phases = of_tip(work.lever, work.amplitudes, phases)
        starts = NearbyGuesses(amplitudes, offsets, means, phases, away)

        def solve(first: int, last: int) -> None:
            some = slice(first, last)
            guesses = NearbyGuesses(*(one[some] for one in starts))
            nearby_rows(work.part(some).pixels, TABLES, guesses, group, rows[some], status[some])

        # Threads take whole groups, so that what an orbit starts from does not depend on their number.
        size = group * max(1, chunk_of(count, self._workers, CHUNK) // group)
        spread(solve, bounds_of(count, size), self._workers, None)
        return self._functions(work, points, seen(rows, work.lever), status, np.full(count, col.ORBIT, np.int8))

    def _functions(
        self, work: Work, points: Array, rows: Array, status: NDArray[np.int8], used: NDArray[np.int8]
    ) -> Array:
        def bare() -> Array:
            return bare_rows(self.axes.materials(points.T)[0], self.scope, self._films(len(points)))

        # From the row, though the solver may know its nodes: orbits of `near` have none, and what differs between the
        # two, 1e-4, would be a step in the interpolant.
        values: Array = widened(rows, work, used, self.scope, bare, self._names)[:, self.functions]
        values[(status != col.GOOD) | col.irregular(rows)] = np.nan
        return values


def functions_of(names: tuple[str, ...]) -> tuple[int, ...]:
    """Columns to interpolate for an image with these variables."""
    more = {column for name in names for column in OF_ORBITS.get(name, ())}
    return *FUNCTIONS, *sorted(more - {ADHESION_LOSS})  # no neck is interpolated
