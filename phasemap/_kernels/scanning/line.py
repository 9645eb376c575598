"""One line of a scan in time, whichever engine moves the tip: engage, then the segments of the surface in turn."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numba.core import types
from numba.extending import overload

from phasemap._kernels import columns as col
from phasemap._kernels.approach import far_start, free_amplitude
from phasemap._kernels.law import OPTIONS, Law
from phasemap._kernels.mesh import reach_of
from phasemap._kernels.quick import parameters
from phasemap._kernels.scanning.beat import Beat, beat_on
from phasemap._kernels.scanning.bulge import ATTRACTED, REPELLED
from phasemap._kernels.scanning.flow import SHIFT, STEP, Flow, flow_on
from phasemap._kernels.scanning.loop import (
    AMP,
    FILTERS,
    HIGH,
    INTEGRAL,
    KD,
    KI,
    KP,
    LOW,
    PLACE,
    RAMP,
    RATE,
    SETPOINT,
    STATE,
    STOPPED,
    SUM_AMPLITUDE,
    SUM_PHASE,
    SUM_PLACE,
    TALLY,
    TIME,
    shown,
)

# Columns of a program, one row a segment: how long it lasts [tau], which material, height at its start [m] and its rise
# [m per tau], and the pixel to which it belongs (-1: none is recorded).
SPAN, MATERIAL, GROUND, SLOPE, PIXEL, PROGRAM = 0, 1, 2, 3, 4, 5

BULGE = col.ROW  # first of the two columns that rows have beyond those of a law: kappa of `bulge`

APPROACH = 0.05  # of the free amplitude, by which the tip comes nearer while the lever's amplitude decays by 1/e
CALM = 2e-4  # of the setpoint amplitude: the error of a feedback that has settled
LOOKS = 40  # at whether it has
LOST = 30.0  # free amplitudes: farther from the surface, or deeper, is no feedback any more


def advance(law: Any, row: Any, lever: Any, loop: Any, ground: Any, slope: Any, span: Any, tip: Any, tally: Any,
            noise: Any) -> int:  # fmt: skip
    """Let a time pass: `flow_on` or `beat_on`, whichever the tip is."""
    raise NotImplementedError


def at_rest(lever: Any, place: Any, tip: Any) -> None:
    """Set the free lever swinging at its steady amplitude, at drive phase 0."""
    raise NotImplementedError


@njit(**OPTIONS)
def _advance_flow(
    law: Law, row: np.ndarray, lever: np.ndarray, loop: np.ndarray, ground: float, slope: float, span: float,
    tip: Flow, tally: np.ndarray, noise: np.random.Generator,
) -> int:  # fmt: skip
    p, bulge = parameters(row), (row[BULGE + ATTRACTED], row[BULGE + REPELLED])
    return flow_on(law, p, bulge, lever, reach_of(law, p), loop, ground, slope, span, tip, tally, noise)


@njit(**OPTIONS)
def _free(lever: np.ndarray) -> complex:
    omega = lever[col.OMEGA]
    return lever[col.BASE] / complex(1.0 - omega * omega, 2.0 * lever[col.ALPHA0] * omega)


@njit(**OPTIONS)
def _place(lever: np.ndarray, place: float, y: np.ndarray) -> None:
    a = _free(lever)
    y[:] = 0.0
    y[AMP], y[AMP + 1] = a.real, a.imag
    for j in range(FILTERS, STATE, 2):
        y[j], y[j + 1] = a.real, a.imag
    y[PLACE], y[INTEGRAL] = place, -place


@njit(**OPTIONS)
def _rest_flow(lever: np.ndarray, place: float, tip: Flow) -> None:
    _place(lever, place, tip.y)
    tip.memory[STEP] = tip.memory[SHIFT] = 0.0


@njit(**OPTIONS)
def _rest_beat(lever: np.ndarray, place: float, tip: Beat) -> None:
    _place(lever, place, tip.y)
    a = _free(lever)
    tip.tip[0], tip.tip[1], tip.tip[2] = a.real, -lever[col.OMEGA] * a.imag, 0.0


def _is_flow(tip: Any) -> bool:
    return isinstance(tip, types.NamedTuple) and tip.instance_class is Flow


def _choose_advance(tip: Any) -> Any:
    if _is_flow(tip):
        return lambda law, row, lever, loop, ground, slope, span, tip, tally, noise: _advance_flow(
            law, row, lever, loop, ground, slope, span, tip, tally, noise
        )
    return lambda law, row, lever, loop, ground, slope, span, tip, tally, noise: beat_on(
        law, row, lever, loop, ground, slope, span, tip, tally, noise
    )


def _choose_rest(tip: Any) -> Any:
    if _is_flow(tip):
        return lambda lever, place, tip: _rest_flow(lever, place, tip)
    return lambda lever, place, tip: _rest_beat(lever, place, tip)


overload(advance)(lambda law, row, lever, loop, ground, slope, span, tip, tally, noise: _choose_advance(tip))
overload(at_rest)(lambda lever, place, tip: _choose_rest(tip))


@njit(**OPTIONS)
def engage_in_time(
    law: Law, row: np.ndarray, lever: np.ndarray, loop: np.ndarray, ground: float, tip: Any,
    noise: np.random.Generator,
) -> int:  # fmt: skip
    """Lower the freely swinging tip to the setpoint at constant speed, then let the feedback settle; returns a status.

    Sets the middle of the scanner's range to where it then is: loop[LOW] and loop[HIGH] are taken as half of it.
    """
    p = parameters(row)
    reach, free, goal = reach_of(law, p), free_amplitude(lever), loop[SETPOINT]
    decay = 1.0 / lever[col.ALPHA0]
    y, tally = tip.y, np.zeros(TALLY)
    far = free * far_start(law, p, lever, reach, free, goal)
    at_rest(lever, ground + far, tip)
    lowering = loop.copy()
    lowering[KP] = lowering[KI] = lowering[KD] = 0.0
    lowering[LOW], lowering[HIGH] = -math.inf, math.inf
    lowering[RAMP] = APPROACH * free / decay
    while shown(loop, y)[0] > goal:
        status = advance(law, row, lever, lowering, ground, 0.0, 0.1 * decay, tip, tally, noise)
        if status != col.GOOD:
            return status
        if y[PLACE] - ground < -LOST * free:
            return col.NOT_ENGAGED
    half = loop[HIGH]
    loop[LOW], loop[HIGH] = -math.inf, math.inf
    y[INTEGRAL] = -y[PLACE] - loop[KP] * (shown(loop, y)[0] - goal)
    look = 2.0 * decay + 3.0 / loop[RATE]
    calm = 0
    for _ in range(LOOKS):
        tally[:] = 0.0
        status = advance(law, row, lever, loop, ground, 0.0, look, tip, tally, noise)
        if status != col.GOOD:
            return status
        if abs(y[PLACE] - ground) > LOST * free:
            return col.DIVERGED
        # An error that passes through zero is no rest: its mean and its last value must both be small.
        small = max(abs(shown(loop, y)[0] - goal), abs(tally[SUM_AMPLITUDE] / tally[TIME] - goal)) < CALM * goal
        calm = calm + 1 if small else 0
        if calm == 2:
            break
    loop[LOW], loop[HIGH] = y[PLACE] - half, y[PLACE] + half
    return col.GOOD


@njit(**OPTIONS)
def scan_segments(
    law: Law, rows: np.ndarray, lever: np.ndarray, loop: np.ndarray, program: np.ndarray, tip: Any, out: np.ndarray,
    status: np.ndarray, noise: np.random.Generator,
) -> int:  # fmt: skip
    """Run the segments of a program; fills a row of `out` and a status for each pixel that it passes.

    Over a pixel without a material no time passes. Returns GOOD, or what ended the scan.
    """
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
            ground, slope, span = program[i, GROUND], program[i, SLOPE], program[i, SPAN]
            done = advance(law, rows[material], lever, loop, ground, slope, span, tip, tally, noise)
            away = y[PLACE] - ground - slope * span
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


@njit(**OPTIONS)
def _record(loop: np.ndarray, tally: np.ndarray, row: np.ndarray) -> None:
    """A pixel's means: place of the scanner, phase, amplitude, and error."""
    time = tally[TIME]
    row[col.TIP_OFFSET] = tally[SUM_PLACE] / time
    row[col.PHASE] = tally[SUM_PHASE] / time
    row[col.AMPLITUDE] = tally[SUM_AMPLITUDE] / time
    row[col.AMPLITUDE_ERROR] = row[col.AMPLITUDE] - loop[SETPOINT]


@njit(**OPTIONS)
def scan_line(
    law: Law, rows: np.ndarray, lever: np.ndarray, loop: np.ndarray, program: np.ndarray, engaged: bool, tip: Any,
    out: np.ndarray, status: np.ndarray, noise: np.random.Generator,
) -> int:  # fmt: skip
    """Engage if the tip is not, over the first segment that has a material, and scan a line; returns a status."""
    done, start = col.GOOD, 0
    while start < len(program) and program[start, MATERIAL] < 0:
        start += 1
    if start < len(program) and not engaged:
        material = int(program[start, MATERIAL])
        done = engage_in_time(law, rows[material], lever, loop, program[start, GROUND], tip, noise)
    if done == col.GOOD:
        return scan_segments(law, rows, lever, loop, program, tip, out, status, noise)
    for i in range(len(program)):
        if program[i, PIXEL] >= 0:
            status[int(program[i, PIXEL])] = done if program[i, MATERIAL] >= 0 else col.INVALID
    return done
