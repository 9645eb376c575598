"""One line of a scan in time, whichever engine moves the tip: engage, then the segments of the surface in turn."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba.core import types
from numba.extending import overload

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, Oscillator, parameters
from phasemap._kernels.lever import free_amplitude, free_phasor, reach_of
from phasemap._kernels.orbits.averaged.orbits import far_start
from phasemap._kernels.scanning.averaged_lever import MEMORY, SHIFT
from phasemap._kernels.scanning.loop import (
    AMP,
    CALM,
    FILTERS,
    HIGH,
    INTEGRAL,
    KD,
    KI,
    KP,
    LOW,
    PATIENCE,
    PLACE,
    RAMP,
    RATE,
    SETPOINT,
    SHAKER,
    STATE,
    STOPPED,
    SUM_AMPLITUDE,
    SUM_PHASE,
    SUM_PLACE,
    TALLY,
    TIME,
    TURN,
    Stretch,
    amplitude_shown,
)
from phasemap._kernels.scanning.periods import Periods, begin_periods, march_on
from phasemap._kernels.scanning.slow_flow import Flow, flow_on

# Columns of a program, one row a segment: how long it lasts [tau], which material, height at its start [m] and its rise
# [m per tau], and the pixel to which it belongs (-1: none is recorded).
SPAN, MATERIAL, GROUND, SLOPE, PIXEL, PROGRAM = 0, 1, 2, 3, 4, 5

APPROACH = 0.02  # of the free amplitude, by which the tip comes nearer while the lever's amplitude decays by 1/e
LOOK = 0.1  # times in which that amplitude decays, after which it is looked at the tip that comes nearer
STILL = 2e-4  # of the setpoint amplitude: the error of a feedback that has settled
LOOKS = 40  # at whether it has
LOST = 30.0  # free amplitudes: farther from the surface, or deeper, is no longer a feedback


class Start(NamedTuple):
    """Whether the tip is engaged as a line begins; else the result row on which it engages, NaN if none is known."""

    engaged: bool
    orbit: np.ndarray


class Recorded(NamedTuple):
    """What a scan writes down: a row of n pixels, shape (n, COLUMNS), and their status, shape (n,)."""

    rows: np.ndarray
    status: np.ndarray


def advance(law: Any, row: Any, lever: Any, loop: Any, stretch: Any, tip: Any, tally: Any, noise: Any) -> int:
    """Let a stretch of ground pass: `flow_on` or `march_on`, whichever the tip is."""
    raise NotImplementedError


def start_at(lever: Any, place: Any, mean: Any, a: Any, tip: Any) -> None:
    """Set the lever swinging about a mean deflection [m] with a complex amplitude [m], at drive phase 0."""
    raise NotImplementedError


@kernel
def _swinging(place: float, a: complex, y: np.ndarray) -> None:
    """Loop at rest with this complex amplitude and the scanner at a place."""
    y[:] = 0.0
    y[AMP], y[AMP + 1] = a.real, a.imag
    for j in range(FILTERS, STATE, 2):
        y[j], y[j + 1] = a.real, a.imag
    y[PLACE], y[INTEGRAL] = place, -place


@kernel
def _start_flow(lever: np.ndarray, place: float, mean: float, a: complex, tip: Flow) -> None:
    _swinging(place, a, tip.y)
    for j in range(MEMORY):
        tip.memory[j] = 0.0
    tip.memory[SHIFT] = mean


@kernel
def _start_march(lever: np.ndarray, place: float, mean: float, a: complex, tip: Periods) -> None:
    _swinging(place, a, tip.y)
    begin_periods(lever, mean, a, tip)


def _is_flow(tip: Any) -> bool:
    return isinstance(tip, types.NamedTuple) and tip.instance_class is Flow


def _choose_advance(tip: Any) -> Any:
    if _is_flow(tip):
        return lambda law, row, lever, loop, stretch, tip, tally, noise: flow_on(
            law, row, lever, loop, stretch, tip, tally, noise
        )
    return lambda law, row, lever, loop, stretch, tip, tally, noise: march_on(
        law, row, lever, loop, stretch, tip, tally, noise
    )


def _choose_start(tip: Any) -> Any:
    if _is_flow(tip):
        return lambda lever, place, mean, a, tip: _start_flow(lever, place, mean, a, tip)
    return lambda lever, place, mean, a, tip: _start_march(lever, place, mean, a, tip)


overload(advance)(lambda law, row, lever, loop, stretch, tip, tally, noise: _choose_advance(tip))
overload(start_at)(lambda lever, place, mean, a, tip: _choose_start(tip))


@kernel
def approach_in_time(
    law: Law, row: np.ndarray, lever: np.ndarray, loop: np.ndarray, ground: float, tip: Any, noise: np.random.Generator
) -> int:
    """Lower the freely swinging tip at constant speed until the amplitude is at the setpoint; returns a status.

    That is NOT_SETTLED after a time loop[PATIENCE].
    """
    p = parameters(row)
    reach, free = reach_of(law, p), free_amplitude(lever)
    decay, y = 1.0 / lever[col.ALPHA0], tip.y
    far = free * far_start(Oscillator(law, p, lever), reach, free, loop[SETPOINT])
    start_at(lever, ground + far, 0.0, free_phasor(lever), tip)
    lowering = loop.copy()
    lowering[KP] = lowering[KI] = lowering[KD] = 0.0
    lowering[LOW], lowering[HIGH] = -math.inf, math.inf
    tally, passed = np.zeros(TALLY), 0.0
    while amplitude_shown(loop, y) > loop[SETPOINT]:
        if passed > loop[PATIENCE]:
            return col.NOT_SETTLED
        passed += LOOK * decay
        lowering[RAMP] = APPROACH * max(free, y[PLACE] - ground) / decay
        status = advance(law, row, lever, lowering, Stretch(ground, 0.0, LOOK * decay), tip, tally, noise)
        if status != col.GOOD:
            return status
        if y[PLACE] - ground < -LOST * free:
            return col.NOT_ENGAGED
    return col.GOOD


@kernel
def engage_in_time(
    law: Law, row: np.ndarray, lever: np.ndarray, loop: np.ndarray, ground: float, orbit: np.ndarray, tip: Any,
    noise: np.random.Generator,
) -> int:  # fmt: skip
    """Put the tip on a result row's orbit, or approach where it is NaN, and let the feedback settle; returns a status.

    Sets the middle of the scanner's range to where it then is: loop[LOW] and loop[HIGH] are taken as half of it; and
    loop[CALM] to whether it settled. A loop that rings does not, and goes on all the same.
    """
    goal, free, y = loop[SETPOINT], free_amplitude(lever), tip.y
    if math.isfinite(orbit[col.TIP_OFFSET]):
        lag = 0.5 * math.pi - (orbit[col.PHASE] - loop[TURN])
        a = goal * complex(math.cos(lag), -math.sin(lag)) + loop[SHAKER]
        start_at(lever, ground + orbit[col.TIP_OFFSET], orbit[col.MEAN], a, tip)
    else:
        status = approach_in_time(law, row, lever, loop, ground, tip, noise)
        if status != col.GOOD:
            return status
    half = loop[HIGH]
    loop[LOW], loop[HIGH] = -math.inf, math.inf
    y[INTEGRAL] = -y[PLACE] - loop[KP] * (amplitude_shown(loop, y) - goal)
    look = 2.0 / lever[col.ALPHA0] + 3.0 / loop[RATE]
    tally = np.zeros(TALLY)
    calm = 0
    for _ in range(LOOKS):
        tally[:] = 0.0
        status = advance(law, row, lever, loop, Stretch(ground, 0.0, look), tip, tally, noise)
        if status != col.GOOD:
            return status
        if abs(y[PLACE] - ground) > LOST * free:
            return col.DIVERGED
        # An error that passes through zero is no rest: its mean and its last value must both be small.
        small = max(abs(amplitude_shown(loop, y) - goal), abs(tally[SUM_AMPLITUDE] / tally[TIME] - goal)) < STILL * goal
        calm = calm + 1 if small else 0
        if calm == 2:
            break
    loop[CALM] = 1.0 if calm == 2 else 0.0
    loop[LOW], loop[HIGH] = y[PLACE] - half, y[PLACE] + half
    return col.GOOD


@kernel
def scan_segments(
    law: Law, rows: np.ndarray, lever: np.ndarray, loop: np.ndarray, program: np.ndarray, tip: Any, made: Recorded,
    noise: np.random.Generator,
) -> int:  # fmt: skip
    """Run the segments of a program; fills a row and a status for each pixel that it passes.

    Over a pixel without a material no time passes. Returns GOOD, or what ended the scan.
    """
    out, status = made
    y, tally = tip.y, np.zeros(TALLY)
    farthest = LOST * free_amplitude(lever)
    done = col.GOOD
    for i in range(len(program)):
        pixel, material = int(program[i, PIXEL]), int(program[i, MATERIAL])
        if pixel >= 0 and (i == 0 or int(program[i - 1, PIXEL]) != pixel):
            tally[:] = 0.0
        if material < 0:
            if pixel >= 0:
                status[pixel] = col.INVALID
            continue
        if done == col.GOOD:
            stretch = Stretch(program[i, GROUND], program[i, SLOPE], program[i, SPAN])
            done = advance(law, rows[material], lever, loop, stretch, tip, tally, noise)
            away = y[PLACE] - stretch.ground - stretch.slope * stretch.span
            if not abs(away) < farthest:
                done = col.DIVERGED
        if pixel < 0 or (i + 1 < len(program) and int(program[i + 1, PIXEL]) == pixel):
            continue
        status[pixel] = done
        if done == col.GOOD:
            _record(loop, tally, out[pixel])
            if tally[STOPPED] > 0.0:
                status[pixel] = col.OUT_OF_RANGE
    return done


@kernel
def _record(loop: np.ndarray, tally: np.ndarray, row: np.ndarray) -> None:
    """A pixel's means: place of the scanner, phase, amplitude, and error."""
    time = tally[TIME]
    row[col.TIP_OFFSET] = tally[SUM_PLACE] / time
    row[col.PHASE] = tally[SUM_PHASE] / time
    row[col.AMPLITUDE] = tally[SUM_AMPLITUDE] / time
    row[col.AMPLITUDE_ERROR] = row[col.AMPLITUDE] - loop[SETPOINT]


@kernel
def scan_line(
    law: Law, rows: np.ndarray, lever: np.ndarray, loop: np.ndarray, program: np.ndarray, start: Start,
    tip: Any, made: Recorded, noise: np.random.Generator,
) -> int:  # fmt: skip
    """Engage if the tip is not, over the first segment that has a material, and scan a line; returns a status."""
    done, first = col.GOOD, 0
    while first < len(program) and program[first, MATERIAL] < 0:
        first += 1
    if first < len(program) and not start.engaged:
        material = int(program[first, MATERIAL])
        done = engage_in_time(law, rows[material], lever, loop, program[first, GROUND], start.orbit, tip, noise)
    if done == col.GOOD:
        return scan_segments(law, rows, lever, loop, program, tip, made, noise)
    for i in range(len(program)):
        if program[i, PIXEL] >= 0:
            made.status[int(program[i, PIXEL])] = done if program[i, MATERIAL] >= 0 else col.INVALID
    return done
