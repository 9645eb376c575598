"""Line of a scan in time, whichever engine moves the tip: engage, then the segments of the surface in turn."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.chosen import Chosen
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator, parameters
from phasemap._kernels.lever import free_amplitude, free_phasor
from phasemap._kernels.lever_modes import slowest_decay
from phasemap._kernels.orbits.averaged.orbits import ratio_far_from_surface
from phasemap._kernels.records import assign, clear
from phasemap._kernels.scanning.feedback_loop import (
    A_IMAG,
    A_REAL,
    FILTERS,
    INTEGRAL,
    LOOP_STATE,
    SCANNER,
    Loop,
    Setup,
    Stretch,
    Tally,
    amplitude_shown,
)
from phasemap._kernels.scanning.periods import PeriodsUnderLoop, begin_periods, march_on
from phasemap._kernels.scanning.slow_flow import Flow, flow_on

APPROACH = 0.02  # of the free amplitude, by which the tip comes nearer while the lever's amplitude decays by 1/e
APPROACH_SPAN = 0.1  # times in which that amplitude decays: ground over which the tip comes nearer at one speed
SETTLED_ERROR = 2e-4  # of the setpoint amplitude: the error of a feedback that has settled
MOST_SETTLING_SPANS = 40  # after which a feedback that has not settled goes on
LOST_DISTANCE = 30.0  # free amplitudes: farther from the surface, or deeper, is no longer a feedback


class Program(NamedTuple):
    """Segments of ground that pass under the tip along a line, shape (n,) each."""

    span: np.ndarray  # how long it lasts [tau]
    material: np.ndarray  # int; its number, or -1 where there is none
    ground: np.ndarray  # height at its start [m]
    slope: np.ndarray  # of the height [m per tau]
    pixel: np.ndarray  # int; the pixel to which it belongs, or -1 where none is recorded


class Start(NamedTuple):
    """State of the tip as a line begins: whether it is engaged; the result row on which it engages if not, or NaN."""

    engaged: bool
    orbit: np.ndarray


class Recorded(NamedTuple):
    """Results of a line of n pixels: a row of each, shape (n, COLUMNS), and its status, shape (n,)."""

    rows: np.ndarray
    status: np.ndarray


@Chosen
def move_over(tip: Any, setup: Setup, row: np.ndarray, stretch: Stretch, tally: Tally) -> int:
    """Move the tip over a stretch of ground of one material, and count in `tally`; returns a status.

    `row`: the material's parameters. The kind of `tip` says how: by the averaged lever or by the equation of motion.
    """
    raise NotImplementedError


@Chosen
def start_swinging(tip: Any, lever: np.ndarray, place: float, mean: float, a: complex) -> None:
    """Set the lever swinging about a mean deflection [m] with a complex amplitude [m], at drive phase 0."""
    raise NotImplementedError


move_over.of(Flow)(flow_on)
move_over.of(PeriodsUnderLoop)(march_on)


@kernel
def _set_loop(place: float, a: complex, y: np.ndarray) -> None:
    """Set the loop at rest with this complex amplitude [m] and height of the scanner [m]."""
    y[:] = 0.0
    y[A_REAL], y[A_IMAG] = a.real, a.imag
    for j in range(FILTERS, LOOP_STATE, 2):
        y[j], y[j + 1] = a.real, a.imag
    y[SCANNER], y[INTEGRAL] = place, -place


@start_swinging.of(Flow)
@kernel
def _start_averaged(tip: Flow, lever: np.ndarray, place: float, mean: float, a: complex) -> None:
    """Begin the slow flow with the complex amplitude a, the mean deflection and the scanner at `place` [m]."""
    _set_loop(place, a, tip.y)
    clear(tip.memory)
    tip.memory.shift = mean


@start_swinging.of(PeriodsUnderLoop)
@kernel
def _start_marched(tip: PeriodsUnderLoop, lever: np.ndarray, place: float, mean: float, a: complex) -> None:
    """Begin the motion in time with the complex amplitude a, the mean deflection and the scanner at `place` [m]."""
    _set_loop(place, a, tip.y)
    begin_periods(lever, mean, a.real, a.imag, tip)


@kernel
def approach_in_time(setup: Setup, row: np.ndarray, ground: float, tip: Any) -> int:
    """Lower the freely swinging tip at constant speed until the amplitude is at the setpoint; returns a status.

    That is NOT_SETTLED after the patience of the loop.
    """
    law, lever, loop, noise = setup
    p = parameters(row)
    free = free_amplitude(lever)
    decay, y = 1.0 / slowest_decay(lever), tip.y
    far = free * ratio_far_from_surface(Oscillator(law, p, lever), loop.setpoint)
    start_swinging(tip, lever, ground + far, 0.0, free_phasor(lever))
    lowering, tally, passed = Loop(), Tally(), 0.0
    assign(lowering, loop)
    lowering.proportional = lowering.integral = lowering.derivative = 0.0
    lowering.lowest, lowering.highest = -math.inf, math.inf
    while amplitude_shown(loop, y) > loop.setpoint:
        if passed > loop.patience:
            return col.NOT_SETTLED
        passed += APPROACH_SPAN * decay
        lowering.ramp = APPROACH * max(free, y[SCANNER] - ground) / decay
        stretch = Stretch(ground, 0.0, APPROACH_SPAN * decay)
        status = move_over(tip, Setup(law, lever, lowering, noise), row, stretch, tally)
        if status != col.GOOD:
            return status
        if y[SCANNER] - ground < -LOST_DISTANCE * free:
            return col.NOT_ENGAGED
    return col.GOOD


@kernel
def engage_in_time(setup: Setup, row: np.ndarray, ground: float, orbit: np.ndarray, tip: Any) -> int:
    """Put the tip on a result row's orbit, or approach where it is NaN, and let the feedback settle; returns a status.

    Sets the middle of the scanner's range to where it then is, since its ends are taken as half of it; and says in the
    loop whether it settled. A loop that rings does not, and goes on all the same.
    """
    _, lever, loop, _ = setup
    goal, free, y = loop.setpoint, free_amplitude(lever), tip.y
    if math.isfinite(orbit[col.TIP_OFFSET]):
        lag = 0.5 * math.pi - orbit[col.PHASE]
        seen = goal * complex(math.cos(lag), -math.sin(lag))
        a = (seen - complex(loop.offset_re, loop.offset_im)) / complex(loop.factor_re, loop.factor_im)
        start_swinging(tip, lever, ground + orbit[col.TIP_OFFSET], orbit[col.MEAN], a)
    else:
        status = approach_in_time(setup, row, ground, tip)
        if status != col.GOOD:
            return status
    half = loop.highest
    loop.lowest, loop.highest = -math.inf, math.inf
    y[INTEGRAL] = -y[SCANNER] - loop.proportional * (amplitude_shown(loop, y) - goal)
    span = 2.0 / slowest_decay(lever) + 3.0 / loop.rate + (2.0 / loop.loss if loop.spring > 0.0 else 0.0)
    tally = Tally()
    calm = 0
    for _ in range(MOST_SETTLING_SPANS):
        clear(tally)
        status = move_over(tip, setup, row, Stretch(ground, 0.0, span), tally)
        if status != col.GOOD:
            return status
        if abs(y[SCANNER] - ground) > LOST_DISTANCE * free:
            return col.DIVERGED
        # An error that passes through zero is no rest: its mean and its last value must both be small.
        last, mean = amplitude_shown(loop, y) - goal, tally.amplitude / tally.time - goal
        calm = calm + 1 if max(abs(last), abs(mean)) < SETTLED_ERROR * goal else 0
        if calm == 2:
            break
    loop.settled = 1 if calm == 2 else 0
    loop.lowest, loop.highest = y[SCANNER] - half, y[SCANNER] + half
    return col.GOOD


@kernel
def scan_segments(setup: Setup, rows: np.ndarray, program: Program, tip: Any, made: Recorded) -> int:
    """Run the segments of a program; fills a row and a status for each pixel that it passes.

    Over a pixel without a material no time passes. Returns GOOD, or what ended the scan.
    """
    out, status = made
    y, tally, last = tip.y, Tally(), len(program.pixel) - 1
    farthest = LOST_DISTANCE * free_amplitude(setup.lever)
    done = col.GOOD
    for i in range(len(program.pixel)):
        pixel, material = program.pixel[i], program.material[i]
        if pixel >= 0 and (i == 0 or program.pixel[i - 1] != pixel):
            clear(tally)
        if material < 0:
            if pixel >= 0:
                status[pixel] = col.INVALID
            continue
        if done == col.GOOD:
            stretch = Stretch(program.ground[i], program.slope[i], program.span[i])
            done = move_over(tip, setup, rows[material], stretch, tally)
            away = y[SCANNER] - stretch.ground - stretch.slope * stretch.span
            if not abs(away) < farthest:
                done = col.DIVERGED
        if pixel < 0 or (i < last and program.pixel[i + 1] == pixel):
            continue
        status[pixel] = done
        if done == col.GOOD:
            _record_pixel(setup.loop, tally, out[pixel])
            if tally.stopped:
                status[pixel] = col.OUT_OF_RANGE
    return done


@kernel
def _record_pixel(loop: Loop, tally: Tally, row: np.ndarray) -> None:
    """Fill in means over a pixel: height of the scanner, phase, amplitude, and its error."""
    row[col.TIP_OFFSET] = tally.scanner / tally.time
    row[col.PHASE] = tally.phase / tally.time
    row[col.AMPLITUDE] = tally.amplitude / tally.time
    row[col.AMPLITUDE_ERROR] = row[col.AMPLITUDE] - loop.setpoint


@kernel
def scan_line(setup: Setup, rows: np.ndarray, program: Program, start: Start, tip: Any, made: Recorded) -> int:
    """Engage if the tip is not, over the first segment that has a material, and scan a line; returns a status."""
    done, first, count = col.GOOD, 0, len(program.pixel)
    while first < count and program.material[first] < 0:
        first += 1
    if first < count and not start.engaged:
        done = engage_in_time(setup, rows[program.material[first]], program.ground[first], start.orbit, tip)
    if done == col.GOOD:
        return scan_segments(setup, rows, program, tip, made)
    for i in range(count):
        if program.pixel[i] >= 0:
            made.status[program.pixel[i]] = done if program.material[i] >= 0 else col.INVALID
    return done
