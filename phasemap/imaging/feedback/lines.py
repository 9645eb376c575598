"""The lines of a scan: what passes under the tip, moved by one of the two engines, and what is recorded."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.scanning.line import Recorded, Start, scan_line
from phasemap._kernels.scanning.loop import A_IMAG, A_REAL, Loop, Setup
from phasemap._kernels.scanning.periods import begin_periods, new_periods
from phasemap._kernels.scanning.slow_flow import new_flow
from phasemap.experiment.accuracy import Accuracy
from phasemap.experiment.control import Feedback
from phasemap.imaging.canvas import Canvas, values_of
from phasemap.imaging.engaged import stiffening
from phasemap.imaging.feedback.harmonics import Lifts
from phasemap.imaging.feedback.loop import loop_of, tau_per_second
from phasemap.imaging.feedback.program import mean_ground, program_of
from phasemap.imaging.imperfections import generator
from phasemap.imaging.job import Job
from phasemap.solvers.problem import Work
from phasemap.solvers.run import run
from phasemap.solvers.solver import by_name

Array = np.ndarray

# Of the amplitude, P beyond the drive's: with more the averaged lever may be off by nanometres, or by anything.
HARDEST, HARDEST_AT_ALL = 0.12, 1.0
NOT_AVERAGED = (col.NOT_CONVERGED, col.DIVERGED)  # what ends a line that the averaged lever does not follow
ETA = 0.7  # size of the march's steps: 2e-4 degree
ENGAGED = Accuracy(phase=0.1, height=1e-11)  # of the orbit on which a line begins; the feedback then settles


class TipState:
    """The state that goes from pixel to pixel: the lever's, and the loop's with the range that engaging gave it."""

    def __init__(self, engine: int) -> None:
        self.engine = engine
        self.state = new_flow() if engine == col.AVERAGING else new_periods(ETA)
        self.loop: Loop | None = None  # as long as it is not engaged

    def freeze(self) -> dict[str, Any]:
        """Arrays and records that say all about it."""
        numbers = {"engine": np.array(self.engine), **self.state._asdict()}
        return numbers if self.loop is None else {**numbers, "loop": self.loop}

    @classmethod
    def thaw(cls, arrays: Mapping[str, Array]) -> TipState:
        """From what `freeze` gave.

        Raises KeyError, ValueError if it is not that.
        """
        tip = cls(int(arrays["engine"]))
        tip.loop = Loop() if "loop" in arrays else None
        kept: dict[str, Any] = {}
        for name, own in tip.freeze().items():
            if (arrays[name].shape, arrays[name].dtype) != (own.shape, own.dtype):  # a kernel would not look
                raise ValueError(name)
            kept[name] = arrays[name].astype(own.dtype)[()]
        tip.state = tip.state._replace(**{name: kept[name] for name in tip.state._fields})
        tip.loop = kept.get("loop")
        return tip

    def march(self, lever: Array) -> None:
        """Go on by the equation of motion from where the averaged lever is."""
        periods, y = new_periods(ETA), self.state.y
        periods.y[:] = y
        begin_periods(lever, 0.0, complex(y[A_REAL], y[A_IMAG]), periods)
        self.engine, self.state = col.MARCH, periods

    def copy(self) -> TipState:
        """One that moves on by itself."""
        return copy.deepcopy(self)


class Lines:
    """Some lines of an image under one control, whose gains are known, and one tip.

    `numbers` (shape (ny, nx)): which of the distinct materials of `work` each pixel has.
    `engine`: code of the solver that moves the tip; `lifts` are for the averaged lever.
    """

    def __init__(
        self,
        job: Job,
        control: Feedback,
        work: Work,
        numbers: Array,
        engine: int,
        lifts: Lifts | None,
        canvas: Canvas,
    ) -> None:
        self.job, self.control, self.work, self.canvas, self.engine = job, control, work, canvas, engine
        self.numbers = np.where(work.refused() == col.GOOD, np.arange(len(work)), -1)[numbers]
        realism = job.realism
        noise = realism.temperature or 0.0, realism.detector_noise or 0.0
        self.loop = loop_of(control, job.scope, job.amplitude, *noise, job.accuracy.periods)
        self.loop.most_push = HARDEST if job.solver.name == "auto" else HARDEST_AT_ALL
        tau = tau_per_second(job.scope)
        self.calm = np.ones(len(numbers), np.bool_)  # of each line, whether the feedback was at rest when it began
        self.dwell = control.dwell(job.surface.shape[1]) * tau
        self.rows = work.rows if lifts is None else lifts.beside(work.rows)
        # A tip that engages comes from far: the first material of each line says on which orbit it then is.
        has_one = (self.numbers >= 0).argmax(axis=1)
        starts, self.first = np.unique(self.numbers[np.arange(len(self.numbers)), has_one], return_inverse=True)
        first = work.part(starts)
        self.orbits = run(by_name("auto"), first, ENGAGED, threads=job.workers)[0]

    def scan(self, row: int, tip: TipState) -> None:
        """Scan one line there and back, after engaging if the tip is not.

        Where the averaged lever cannot follow, `auto` has the equation of motion scan the line and all that come after.
        """
        before = tip.copy() if tip.engine == col.AVERAGING and self.job.solver.name == "auto" else None
        made, done = self._scan(row, tip)
        if before is not None and done in NOT_AVERAGED:
            before.march(self.work.lever)
            made, _ = self._scan(row, before)
            tip.engine, tip.state, tip.loop = before.engine, before.state, before.loop
        self._put(row, made, tip.engine)

    def _scan(self, row: int, tip: TipState) -> tuple[Recorded, int]:
        """What is recorded along a line, and GOOD or what ended it."""
        nx = self.job.surface.shape[1]
        program = program_of(self.numbers[row], self._ground(row), self.dwell, self.control.overscan)
        made = Recorded(np.full((2 * nx, col.COLUMNS), np.nan), np.full(2 * nx, col.INVALID, np.int8))
        noise = generator(self.job.realism.seed, f"lever, line {self.job.place.row + row}")
        loop = copy.deepcopy(self.loop) if tip.loop is None else tip.loop
        setup = Setup(self.work.law, self.work.lever, loop, noise)
        start = Start(tip.loop is not None, self.orbits[self.first[row]])
        done = scan_line(setup, self.rows, program, start, tip.state, made)
        self.calm[row] = start.engaged or done != col.GOOD or loop.settled > 0
        tip.loop = loop if done == col.GOOD else None
        return made, done

    def _ground(self, row: int) -> Array:
        """Heights of a line's pixels [m]."""
        topography = self.job.surface.topography
        return np.zeros(self.job.surface.shape[1]) if topography is None else topography[row]

    def _put(self, row: int, made: Recorded, engine: int) -> None:
        """Turn what was recorded along a line into variables of its pixels."""
        (out, status), ground, job = made, self._ground(row), self.job
        nx = len(ground)
        out[:, col.STIFFENING] = stiffening(job.scope, out[:, col.AMPLITUDE], out[:, col.PHASE])
        place = out[:, col.TIP_OFFSET].copy()
        out[:, col.TIP_OFFSET] -= np.tile(mean_ground(ground), 2)
        values = values_of(job.names, out, status, np.full(2 * nx, engine, np.int8))
        if "height" in values:  # what the scanner does, whatever the amplitude; `put` adds the topography
            values["height"] = place - np.tile(ground, 2) - job.amplitude
        for direction in range(2):
            part = slice(direction * nx, (direction + 1) * nx)
            some = {name: value[part] for name, value in values.items()}
            self.canvas.put(slice(row * nx, (row + 1) * nx), some, direction)
