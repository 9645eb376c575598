"""Sweeps of materials that remember or are wet: in time from value to value, for no curve of orbits can be followed."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import xarray as xr

from phasemap._kernels import columns as col
from phasemap._kernels.engagement.in_time import free_state, move_to_amplitude, move_to_tip_offset
from phasemap._kernels.law import Oscillator, parameters
from phasemap._kernels.lever import free_amplitude, reach_of
from phasemap._kernels.orbits.averaged.orbits import far_start
from phasemap._kernels.orbits.collocation.path import fixed_path
from phasemap._shared.errors import InputError
from phasemap.experiment.accuracy import MOST_PERIODS
from phasemap.results.status import Status
from phasemap.solvers.continuation.path import Question
from phasemap.solvers.continuation.pieces import Curves
from phasemap.solvers.continuation.visit import Visit
from phasemap.solvers.in_time import ETA
from phasemap.solvers.problem import Work
from phasemap.sweeps.dataset import Axis, dataset


class Passage:
    """A tip that is moved slowly over a surface that remembers or is wet, begun far above it, `farthest` [m] at least.

    `work`: of the first value.
    """

    def __init__(self, work: Work, farthest: float) -> None:
        law = work.law._replace(arms=col.MOST_ARMS) if work.law.arms > 1 else work.law  # others may follow
        p, free = parameters(work.rows[0]), free_amplitude(work.lever)
        far = free * far_start(Oscillator(work.law, p, work.lever), reach_of(work.law, p), free, 0.5 * free)
        self._state = free_state(law, work.lever, max(far, farthest))

    def go(self, work: Work, target: float, by_amplitude: bool) -> tuple[int, np.ndarray]:
        """Move to a tip offset or an amplitude [m]; status code and full row of what a lock-in shows there."""
        row = np.full(col.FULL, np.nan)
        move = move_to_amplitude if by_amplitude else move_to_tip_offset
        oscillator = work.oscillator(0)
        status = move(oscillator, target, ETA, MOST_PERIODS, self._state, row[: col.COLUMNS])
        if status != col.GOOD:
            row[: col.COLUMNS] = np.nan
        row[col.SEEN] = row[col.AMPLITUDE]
        return int(status), row


def there_and_back(work: Work, rising: np.ndarray) -> tuple[Visit, Visit]:
    """Approach and retract over these rising tip offsets [m], as rows of the tip."""
    passage = Passage(work, rising[-1])
    n = len(rising)
    approach = _visit(passage, range(n - 1, -1, -1), lambda k: (work, rising[k]), False, n)
    return approach, _visit(passage, range(n), lambda k: (work, rising[k]), False, n)


def distance(question: Question, axis: np.ndarray, samples: int) -> xr.Dataset:
    """`phasemap.sweep_distance`."""
    work = question.work(marched=True)
    approach, retract = there_and_back(work, np.sort(axis))
    about = Axis("tip_offset", axis, "m", "tip offset", ("approach", "retract"))
    return _dataset(question, work, about, [approach, retract], samples, {})


def setpoint(question: Question, axis: np.ndarray, samples: int) -> xr.Dataset:
    """`phasemap.sweep_setpoint`."""
    work, rising = question.work(marched=True), np.sort(axis) * question.scope.driven_amplitude
    passage = Passage(work, 0.0)
    n = len(axis)
    down = _visit(passage, range(n - 1, -1, -1), lambda k: (work, rising[k]), True, n)
    up = _visit(passage, range(n), lambda k: (work, rising[k]), True, n)
    about = Axis("setpoint", axis, "1", "setpoint", ("down", "up"), col.AMPLITUDE, True, col.TURN)
    return _dataset(question, work, about, [down, up], samples, {})


def parameter(
    question: Question, name: str, units: str, axis: np.ndarray, ratio: float | None, height: float | None,
    samples: int,
) -> xr.Dataset:  # fmt: skip
    """`phasemap.sweep_parameter` and `phasemap.sweep_frequency`; each direction is begun far above the surface."""
    every = [question.with_parameter(name, float(value)) for value in np.sort(axis)]
    works = [one.work(marched=True) for one in every]
    n = len(axis)

    def at(k: int) -> tuple[Work, float]:
        return works[k], (height or 0.0) if ratio is None else ratio * every[k].scope.driven_amplitude

    visits = [
        _visit(Passage(works[order[0]], height or 0.0), order, at, ratio is not None, n)
        for order in (range(n), range(n - 1, -1, -1))
    ]
    held: dict[str, float | None] = {"setpoint": ratio} if ratio is not None else {"tip_offset": height}
    about = Axis(name, axis, units, name.replace("_", " "), ("up", "down"), col.PARAMETER, ratio is not None)
    return _dataset(question, works[0], about, visits, samples, held)


def _visit(
    passage: Passage, order: Iterable[int], at: Callable[[int], tuple[Work, float]], by_amplitude: bool, n: int
) -> Visit:
    """Go from value to value."""
    rows, status = np.full((n, col.FULL), np.nan), np.full(n, Status.not_settled.code, np.int8)
    for k in order:
        work, target = at(k)
        status[k], rows[k] = passage.go(work, target, by_amplitude)
    return Visit(rows, np.full((n, 2, 0), np.nan), status, [])


def _dataset(
    question: Question, work: Work, about: Axis, visits: list[Visit], samples: int, held: dict[str, float | None]
) -> xr.Dataset:
    """The Dataset of a sweep without a curve."""
    if samples:
        raise InputError("samples", samples, "0 where contacts remember or are wet: what is marched keeps no traces")
    path = fixed_path(work.oscillator(0))
    curves = Curves(path, col.TIP_OFFSET, about.values, (0.0, 0.0, 0.0), 0)
    return dataset(curves, about, lambda x: x, visits, question.material, question.scope, held)
