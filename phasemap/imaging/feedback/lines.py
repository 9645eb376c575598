"""Lines of a scan: the ground under the tip, the tip moved by one of two engines, and the recorded rows."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.columns import ErrorLimits
from phasemap._kernels.scanning.feedback_loop import A_IMAG, A_REAL, Loop, Setup
from phasemap._kernels.scanning.higher_harmonics import share_rows
from phasemap._kernels.scanning.line import Program, Recorded, Start, scan_line
from phasemap._kernels.scanning.periods import begin_periods, new_periods
from phasemap._kernels.scanning.slow_flow import new_flow
from phasemap._shared.errors import InputError
from phasemap._shared.random_numbers import generator
from phasemap._shared.threads import bounds_of, spread
from phasemap.experiment.accuracy import MOST_PERIODS, Accuracy
from phasemap.experiment.control import Feedback
from phasemap.experiment.lever import offset_and_factor
from phasemap.experiment.lever_numbers import lever_of
from phasemap.experiment.microscope import Microscope
from phasemap.imaging.canvas import Canvas, values_of
from phasemap.imaging.engaged import stiffening
from phasemap.imaging.job import Job
from phasemap.solvers.problem import Work
from phasemap.solvers.run import run
from phasemap.solvers.solver import by_name

BOLTZMANN = 1.380649e-23  # J/K, exact
FEWEST_PERIODS = 5.0  # over a pixel: fewer say nothing about it
SLOWEST = 10.0  # bandwidth over line rate: a slower lock-in sees lines, not pixels
USUAL = 5e3  # Hz
WIDEST = 0.2  # of the drive frequency: a lock-in as wide passes the oscillation itself


def drive_frequency(scope: Microscope) -> float:
    """Frequency of the drive [Hz]."""
    return scope.frequency_ratio * scope.cantilever.resonance_frequency


def tau_per_second(scope: Microscope) -> float:
    """Kernels' time, omega_c t, that passes in a second."""
    return 2 * math.pi * scope.cantilever.resonance_frequency


def bandwidth_of(control: Feedback, scope: Microscope) -> float:
    """Bandwidth of the lock-in [Hz]."""
    return min(USUAL, WIDEST * drive_frequency(scope)) if control.bandwidth is None else control.bandwidth


def check_loop(control: Feedback, scope: Microscope, pixels: int) -> None:
    """Refuse a loop that cannot work with this lever and so many pixels a line."""
    frequency = drive_frequency(scope)
    if control.dwell(pixels) * frequency < FEWEST_PERIODS:
        most = control.dwell(pixels) * control.line_rate * frequency / FEWEST_PERIODS
        raise InputError(
            "line_rate", control.line_rate, f"at most {most:.3g} Hz for {pixels} pixels a line at {frequency:.4g} Hz",
            f"Each pixel needs {FEWEST_PERIODS:g} periods of the drive.",
        )  # fmt: skip
    bandwidth = bandwidth_of(control, scope)
    if bandwidth < SLOWEST * control.line_rate:
        least = f"at least {SLOWEST * control.line_rate:g} Hz, ten times the line rate"
        raise InputError("bandwidth", bandwidth, least)
    for name in ("bandwidth", "scanner_resonance"):
        value = getattr(control, name)
        if value is not None and value > WIDEST * frequency:
            raise InputError(name, value, f"at most {WIDEST * frequency:.4g} Hz, a fifth of the drive frequency")
    if control.integral_gain is not None and control.integral_gain > frequency:
        hint = "The controller acts once a period and would then move by more than the error."
        raise InputError("integral_gain", control.integral_gain, f"at most {frequency:.4g} 1/s", hint)


def loop_of(
    control: Feedback, scope: Microscope, amplitude: float, temperature: float = 0.0, detector_noise: float = 0.0,
    periods: int = MOST_PERIODS,
) -> Loop:  # fmt: skip
    """The loop's numbers, with an amplitude at the setpoint [m]; gains that are to be tuned are 0.

    `temperature`: of the lever's own noise [K]; `detector_noise`: its one-sided density [m/sqrt(Hz)]. `periods`: of the
    drive, after which an approach is given up.
    """
    tau = tau_per_second(scope)
    loop = Loop()
    loop.setpoint = amplitude
    offset, factor = offset_and_factor(lever_of(scope))  # of A exp(i phase), which is i times a
    loop.factor_re, loop.factor_im, loop.offset_re, loop.offset_im = factor.real, factor.imag, offset.imag, -offset.real
    loop.proportional, loop.integral = control.proportional_gain or 0.0, (control.integral_gain or 0.0) / tau
    loop.derivative = control.derivative_gain * tau
    # Of n equal filters in a row each is wider than all together.
    loop.rate = 2 * math.pi * bandwidth_of(control, scope) / math.sqrt(2 ** (1 / control.order) - 1) / tau
    loop.order = control.order
    if control.scanner_resonance is not None:
        w = 2 * math.pi * control.scanner_resonance / tau
        loop.spring, loop.loss = w * w, w / control.scanner_quality
    loop.highest = math.inf if control.scanner_range is None else control.scanner_range / 2
    loop.lowest = -loop.highest
    loop.thermal_noise = BOLTZMANN * temperature / scope.cantilever.stiffness
    loop.detector_noise = (detector_noise / abs(factor)) ** 2 * tau  # as it is added to a
    loop.most_push = math.inf
    loop.patience = periods * 2 * math.pi / scope.frequency_ratio
    return loop


Array = np.ndarray


def program_of(materials: Array, ground: Array, dwell: float, overscan: float) -> Program:
    """Segments of trace and retrace, with the half turns before and after and the turn between.

    The ground is linear between the centres of pixels, and goes on level beyond the outermost; the material is that of
    the pixel, -1 for none. A turn at constant acceleration that runs on by a part o of the line takes as long as 4 o of
    the line.

    `dwell`: time over a pixel [tau].
    `overscan`: o [1].
    Returns segments: pixel i of the trace has the number i, of the retrace nx + i.
    """
    nx, edges, half = len(ground), _edges(ground), 0.5 * dwell
    starts = np.stack([edges[:-1], ground], axis=1).ravel()
    rises = np.stack([ground - edges[:-1], edges[1:] - ground], axis=1).ravel()
    pixels = np.repeat(np.arange(nx), 2)
    trace = Program(np.full(2 * nx, half), np.repeat(materials, 2), starts, rises / half, pixels)
    ends = starts + trace.slope * half
    retrace = Program(trace.span, trace.material[::-1], ends[::-1], -trace.slope[::-1], pixels[::-1] + nx)
    parts = [trace, retrace]
    if overscan > 0:  # level ground beyond the outermost pixels
        span = 2 * overscan * nx * dwell
        ends_of_line = ((span, materials[i], ground[i], 0.0, -1) for i in (0, -1))
        left, right = (Program(*(np.array([value]) for value in values)) for values in ends_of_line)
        parts = [left, trace, right, right, retrace, left]
    return Program(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def mean_ground(ground: Array) -> Array:
    """Height [m] over which the tip passes in each pixel, on average."""
    edges = _edges(ground)
    return np.asarray(0.25 * edges[:-1] + 0.5 * ground + 0.25 * edges[1:])


def _edges(ground: Array) -> Array:
    """Height at the pixels' edges."""
    return np.concatenate([ground[:1], 0.5 * (ground[1:] + ground[:-1]), ground[-1:]])


MOST, CHUNK = 2048, 64  # materials whose harmonics are looked at, and how many of them at a time


class Lifts(NamedTuple):
    """Shares of `_kernels.scanning.higher_harmonics` of some materials, in order of contact stiffness."""

    stiffness: Array
    shares: Array

    def beside(self, rows: Array) -> Array:
        """Rows of materials with their two shares behind them, interpolated in contact stiffness."""
        behind = [np.interp(rows[:, col.CONTACT], self.stiffness, share) for share in self.shares.T]
        return np.column_stack([rows, *behind])


def lifts_by_stiffness(job: Job, work: Work) -> Lifts:
    """Shares (mu_a, mu) of theory, Eq. (slow-flow-5), with which slow flow has the tip offsets of exact orbits.

    They are solved for on at most MOST of these materials, evenly in the order of contact stiffness.
    """
    limits = ErrorLimits(math.radians(job.accuracy.phase), job.accuracy.height)
    stiffness = work.rows[:, col.CONTACT]
    order = np.argsort(stiffness, kind="stable")
    chosen = order[:: max(1, -(-len(order) // MOST))]
    shares, rows, amplitudes = np.empty((len(chosen), 2)), work.rows[chosen], work.amplitudes[chosen]

    def solve(first: int, last: int) -> None:
        part = slice(first, last)
        share_rows(work.law, rows[part], work.lever, amplitudes[part], limits, shares[part])

    spread(solve, bounds_of(len(chosen), CHUNK), job.workers, None)
    return Lifts(stiffness[chosen], shares)


# Of the amplitude, P beyond the drive's: with more the averaged lever may be off by nanometres, or by anything.
HARDEST, HARDEST_AT_ALL = 0.12, 1.0
NOT_AVERAGED = (col.NOT_CONVERGED, col.DIVERGED)  # what ends a line that the averaged lever does not follow
ETA = 0.7  # size of the march's steps: 5e-4 degree


def first_orbits(job: Job, work: Work) -> tuple[Array, Array, Array]:
    """Rows, status and solver codes of materials on which lines begin: not exact, for the feedback then settles."""
    return run(by_name("auto"), work, Accuracy(0.1, 1e-11, job.accuracy.periods), threads=job.workers)


class LoopState:
    """The state that goes from pixel to pixel: the lever's, and the loop's with the range that engaging gave it."""

    def __init__(self, engine: int) -> None:
        self.engine = engine
        self.state = new_flow() if engine == col.AVERAGING else new_periods(ETA)
        self.loop: Loop | None = None  # as long as it is not engaged

    def freeze(self) -> dict[str, Any]:
        """Arrays and records that say all about the state."""
        numbers = {"engine": np.array(self.engine), **self.state._asdict()}
        return numbers if self.loop is None else {**numbers, "loop": self.loop}

    @classmethod
    def thaw(cls, arrays: Mapping[str, Array]) -> LoopState:
        """State from the arrays of `freeze`. Raises KeyError, ValueError if they are not that."""
        tip = cls(int(arrays["engine"]))
        tip.loop = Loop() if "loop" in arrays else None
        kept: dict[str, Any] = {}
        for name, fresh in tip.freeze().items():
            if (arrays[name].shape, arrays[name].dtype) != (fresh.shape, fresh.dtype):  # a kernel would not look
                raise ValueError(name)
            kept[name] = arrays[name].astype(fresh.dtype)[()]
        tip.state = tip.state._replace(**{name: kept[name] for name in tip.state._fields})
        tip.loop = kept.get("loop")
        return tip

    def march(self, lever: Array) -> None:
        """Go on by the equation of motion from where the averaged lever is."""
        periods, y = new_periods(ETA), self.state.y
        periods.y[:] = y
        begin_periods(lever, 0.0, y[A_REAL], y[A_IMAG], periods)
        self.engine, self.state = col.MARCH, periods

    def copy(self) -> LoopState:
        """Copy of the state, which moves on by itself."""
        return copy.deepcopy(self)


class ScanLines:
    """Some lines of an image under one control, whose gains are known, and one tip.

    `numbers` (shape (ny, nx)): which of the distinct materials of `work` each pixel has.
    `engine`: code of the solver that moves the tip; `lifts` are for the averaged lever.
    """

    def __init__(
        self, job: Job, control: Feedback, work: Work, numbers: Array, engine: int, lifts: Lifts | None, canvas: Canvas
    ) -> None:
        self.job, self.control, self.work, self.canvas, self.engine = job, control, work, canvas, engine
        self.refused = work.refused()[numbers]
        self.numbers = np.where(self.refused == col.GOOD, numbers, -1)
        realism = job.realism
        noise = realism.temperature or 0.0, realism.detector_noise or 0.0
        self.loop = loop_of(control, job.scope, job.amplitude, *noise, job.accuracy.periods)
        self.loop.most_push = HARDEST if job.solver.name == "auto" else HARDEST_AT_ALL
        tau = tau_per_second(job.scope)
        self.calm = np.ones(len(numbers), np.bool_)  # of each line, whether the feedback was at rest when it began
        self.dwell = control.dwell(job.surface.shape[1]) * tau
        self.rows = work.rows if lifts is None else lifts.beside(work.rows)
        # A tip that engages comes from far: the first material of each line says on which orbit it then is.
        places = (self.numbers >= 0).argmax(axis=1)
        firsts = self.numbers[np.arange(len(self.numbers)), places]
        starts = np.unique(firsts[firsts >= 0])  # not of a line without any, to which the tip does not come
        self.first = np.searchsorted(starts, firsts)
        self.orbits = first_orbits(job, work.part(starts))[0]

    def scan(self, row: int, tip: LoopState) -> None:
        """Scan one line there and back, after engaging if the tip is not.

        Where the averaged lever cannot follow, `auto` has the equation of motion scan the line and all that come after.
        """
        before = tip.copy() if tip.engine == col.AVERAGING and self.job.solver.name == "auto" else None
        made, done = self._scan(row, tip)
        if before is not None and done in NOT_AVERAGED:
            before.march(self.work.lever)
            made, _ = self._scan(row, before)
            tip.engine, tip.state, tip.loop = before.engine, before.state, before.loop
        self._put_line(row, made, tip.engine)

    def _scan(self, row: int, tip: LoopState) -> tuple[Recorded, int]:
        """Rows recorded along a line, and GOOD or the status that ended it."""
        nx = self.job.surface.shape[1]
        made = Recorded(np.full((2 * nx, col.COLUMNS), np.nan), np.full(2 * nx, col.INVALID, np.int8))
        if (self.numbers[row] < 0).all():  # the tip comes to the next line as it came to this one
            return made, col.GOOD
        program = program_of(self.numbers[row], self._ground(row), self.dwell, self.control.overscan)
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

    def _put_line(self, row: int, made: Recorded, engine: int) -> None:
        """Put the rows recorded along a line into the canvas, as variables of its pixels."""
        (out, status), ground, job = made, self._ground(row), self.job
        nx, refused = len(ground), np.tile(self.refused[row], 2)
        status = np.where(refused == col.GOOD, status, refused)
        out[:, col.STIFFENING] = stiffening(job.scope, out[:, col.AMPLITUDE], out[:, col.PHASE])
        place = out[:, col.TIP_OFFSET].copy()
        out[:, col.TIP_OFFSET] -= np.tile(mean_ground(ground), 2)
        values = values_of(job.names, out, status, np.full(2 * nx, engine, np.int8))
        if "height" in values:  # what the scanner does, whatever the amplitude; `put` adds the topography
            values["height"] = place - np.tile(ground, 2) - job.amplitude
        for direction in range(2):
            part = slice(direction * nx, (direction + 1) * nx)
            part_values = {name: value[part] for name, value in values.items()}
            self.canvas.put(slice(row * nx, (row + 1) * nx), part_values, direction)
