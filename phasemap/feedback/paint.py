"""A scan in time, line by line, into a canvas."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.scanning import line as lines
from phasemap._kernels.scanning.beat import new_beat
from phasemap._kernels.scanning.flow import new_flow
from phasemap._kernels.scanning.lift import lifts
from phasemap.canvas import Canvas
from phasemap.control import Feedback
from phasemap.errors import InputError
from phasemap.feedback.loop import check, drive_frequency, loop_of
from phasemap.feedback.program import program_of
from phasemap.feedback.tuning import margin, tune
from phasemap.microscope import Microscope
from phasemap.paint import Job
from phasemap.work import Work
from phasemap.workers import spread

Array = np.ndarray

ETA = 0.7  # of the march's steps: 2e-4 degree
LIFTS = 1 << 10  # materials that are lifted together
LOWEST_Q = 20.0  # below this the lever changes too much within a period to be averaged


def engine_of(job: Job) -> int:
    """Code of the solver that moves the tip: the averaged lever, or the equation of motion.

    Raises
    ------
    InputError
        If the solver does not act in time.
    """
    name = job.solver.name
    if name == "auto":
        return col.AVERAGING if job.scope.cantilever.quality_factor >= LOWEST_Q else col.MARCH
    if name in ("averaging", "march"):
        return col.AVERAGING if name == "averaging" else col.MARCH
    raise InputError("solver", name, "'averaging', 'march' or 'auto' with control=Feedback(), which acts in time")


def paint(job: Job, canvas: Canvas) -> int:
    """Fill the canvas, and return how many distinct materials the surface has."""
    control = job.control
    assert isinstance(control, Feedback)
    engine = engine_of(job)
    ny, nx = job.surface.shape
    check(control, job.scope, nx)
    materials, numbers = job.surface.unique()
    work = job.work(materials)
    control = tune(control, job.scope, work)
    canvas.notes.update(_notes(control, job.scope, work, nx))
    scan = _Scan(job, control, work, numbers, engine, canvas)
    if control.engage == "line":
        spread(scan.lines, range(ny + 1), job.workers, job.progress)
    else:
        scan.lines(0, ny)
    return len(materials)


def _notes(control: Feedback, scope: Microscope, work: Work, pixels: int) -> dict[str, float]:
    """Gains, how far they are from ringing, and the time over a pixel."""
    dwell = control.dwell(pixels)
    notes = {
        "proportional_gain": control.proportional_gain or 0.0, "integral_gain_per_second": control.integral_gain or 0.0,
        "gain_margin": margin(control, scope, work), "dwell_seconds": dwell,
        "periods_per_pixel": dwell * drive_frequency(scope),
    }  # fmt: skip
    return {name: float(f"{value:.6g}") for name, value in notes.items()}


def _lifts(job: Job, work: Work) -> Array:
    """What raises the ground for the averaged lever [m], shape (len(work),); 0 where it is not known."""
    lift, limits = np.zeros(len(work)), np.array([math.radians(job.accuracy.phase), job.accuracy.height])

    def solve(first: int, last: int) -> None:
        lifts(work.law, work.rows, work.lever, work.amplitudes, limits, first, last, lift)

    spread(solve, [*range(0, len(work), LIFTS), len(work)], job.workers, None)
    return np.nan_to_num(lift)


class _Scan:
    """What the lines of one image have in common."""

    def __init__(self, job: Job, control: Feedback, work: Work, numbers: Array, engine: int, canvas: Canvas) -> None:
        self.job, self.control, self.work, self.canvas, self.engine = job, control, work, canvas, engine
        self.numbers = np.where(work.refused() == col.GOOD, np.arange(len(work)), -1)[numbers]
        self.loop = loop_of(control, job.scope, job.amplitude)
        tau = 2 * math.pi * job.scope.cantilever.resonance_frequency
        self.dwell = control.dwell(job.surface.shape[1]) * tau
        self.lift = _lifts(job, work) if engine == col.AVERAGING else np.zeros(len(work))

    def lines(self, first: int, last: int) -> None:
        """Scan some lines, one after the other; the tip engages before the first and where it was lost."""
        tip = new_flow() if self.engine == col.AVERAGING else new_beat(ETA)
        loop, engaged = self.loop.copy(), False
        for row in range(first, last):
            engaged = self.line(row, tip, loop, engaged and self.control.engage == "image")

    def line(self, row: int, tip: object, loop: Array, engaged: bool) -> bool:
        """Scan one line; says whether the tip is at the surface in the end."""
        nx = self.job.surface.shape[1]
        topography, here = self.job.surface.topography, self.numbers[row]
        ground = np.zeros(nx) if topography is None else topography[row]
        program = program_of(here, ground, self.dwell, self.control.overscan)
        program[:, lines.GROUND] += self.lift[program[:, lines.MATERIAL].astype(np.intp)]
        out, status = np.full((2 * nx, col.COLUMNS), np.nan), np.full(2 * nx, col.INVALID, np.int8)
        noise = np.random.default_rng([0, row])
        if not engaged:
            loop[:] = self.loop
        done = lines.scan_line(
            self.work.law, self.work.rows, self.work.lever, loop, program, engaged, tip, out, status, noise
        )
        self._put(row, out, status, ground)
        return bool(done == col.GOOD)

    def _put(self, row: int, out: Array, status: Array, ground: Array) -> None:
        nx, job = len(ground), self.job
        stiffening = job.scope.base_amplitude * np.sin(out[:, col.PHASE]) / out[:, col.AMPLITUDE]
        out[:, col.STIFFENING] = stiffening - 1 + job.scope.frequency_ratio**2
        out[:, col.TIP_OFFSET] -= np.tile(ground, 2)
        used = np.full(2 * nx, self.engine, np.int8)
        values = self.canvas.values(out, status, used)
        if "height" in values:  # what the scanner does, whatever the amplitude
            values["height"] = out[:, col.TIP_OFFSET] - job.amplitude
        for direction in range(2):
            part = slice(direction * nx, (direction + 1) * nx)
            some = {name: value[part] for name, value in values.items()}
            self.canvas.put(slice(row * nx, (row + 1) * nx), some, direction)
