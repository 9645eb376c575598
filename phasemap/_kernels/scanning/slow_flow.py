"""Slow flow: the complex amplitude of the lever averaged over its period, together with the loop.

What the lever does is in `averaged_lever`. Its modes decay within many periods, and its lock-in within a few: the
filters are solved exactly along a, which is a cubic within a step (theory, Eq. (slow-flow-6)), and what is left takes
long steps of the classical method of Runge and Kutta. The rate at the end of a step, which is the first of the next
one, in place of some of the fourth gives the method of order 3 with which it is compared. Steps end where the surface
has a corner.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.arrays import copy
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, parameters
from phasemap._kernels.lever import reach_of
from phasemap._kernels.scanning.averaged_lever import KNOWN, LEAD, MEMORY, PUSH, SHIFT, STEP, Sample, rates, size_of
from phasemap._kernels.scanning.higher_harmonics import ATTRACTED, REPELLED
from phasemap._kernels.scanning.loop import (
    AMP,
    DETECTOR,
    FILTERS,
    HARDEST,
    INTEGRAL,
    KP,
    PLACE,
    RATE,
    SETPOINT,
    SPEED,
    SPRING,
    STATE,
    STOPPED,
    SUM_AMPLITUDE,
    SUM_PHASE,
    SUM_PLACE,
    THERMAL,
    TIME,
    Path,
    Stretch,
    command,
    drift_of,
    filter_along,
    shown,
)

TOLERANCE = 1.5e-4  # of the setpoint amplitude, local error of a step
FAINT = 0.01  # of the setpoint amplitude: less allows no smaller error of a
MOST_STEPS, A_PERIOD = 500, 8.0  # between two corners of the surface, and in a period: more follow no averaged lever
NOISY = 0.25  # in decay times of lever and lock-in: the longest step with noise

STAGES = 5
_WHEN = np.array([0, 1 / 2, 1 / 2, 1, 1])
COMPARED = 0.1  # how much of the fourth rate the method of order 3 replaces

# What is noted at an end of a step: Z, R, phase, their rates, whether the scanner is at its end.
OF_PLACE, OF_AMPLITUDE, OF_PHASE, BY_PLACE, BY_AMPLITUDE, BY_PHASE, AT_END, END = 0, 1, 2, 3, 4, 5, 6, 7

LIFT = col.ROW  # first of the two columns that rows have beyond those of a law: those of `lifts`


class Flow(NamedTuple):
    """The averaged lever under its loop: state, rates at the stages of a step, a state tried, memory, a step's ends."""

    y: np.ndarray
    stages: np.ndarray
    trial: np.ndarray
    memory: np.ndarray
    ends: np.ndarray


@kernel(light=True)
def new_flow() -> Flow:
    """Return an empty one."""
    return Flow(np.zeros(STATE), np.zeros((STAGES, STATE)), np.zeros(STATE), np.zeros(MEMORY), np.zeros((2, END)))


@kernel
def place_of(loop: np.ndarray, y: np.ndarray) -> float:
    """Where the scanner is [m]."""
    return y[PLACE] if loop[SPRING] != 0.0 else command(loop, y)[0]


@kernel
def _speed_of(loop: np.ndarray, y: np.ndarray, out: np.ndarray) -> float:
    """Rate of `place_of`, without the derivative's own."""
    if loop[SPRING] != 0.0:
        return y[SPEED]
    return -(loop[KP] * drift_of(loop, y)[0] + out[INTEGRAL])


@kernel
def _look(loop: np.ndarray, y: np.ndarray, out: np.ndarray, end: np.ndarray) -> None:
    """Note what is recorded, and its rates."""
    end[OF_PLACE], end[BY_PLACE] = place_of(loop, y), _speed_of(loop, y, out)
    end[OF_AMPLITUDE], end[OF_PHASE] = shown(loop, y)
    end[BY_AMPLITUDE], end[BY_PHASE] = drift_of(loop, y)
    end[AT_END] = 1.0 if command(loop, y)[2] else 0.0


@kernel
def _collect(before: np.ndarray, after: np.ndarray, h: float, tally: np.ndarray) -> None:
    """Add a step to the integrals: h/2 (f0 + f1) + h^2/12 (f0' - f1')."""
    half, twelfth = 0.5 * h, h * h / 12.0
    tally[TIME] += h
    tally[SUM_PLACE] += half * (before[OF_PLACE] + after[OF_PLACE]) + twelfth * (before[BY_PLACE] - after[BY_PLACE])
    tally[SUM_AMPLITUDE] += half * (before[OF_AMPLITUDE] + after[OF_AMPLITUDE])
    tally[SUM_AMPLITUDE] += twelfth * (before[BY_AMPLITUDE] - after[BY_AMPLITUDE])
    tally[SUM_PHASE] += half * (before[OF_PHASE] + after[OF_PHASE]) + twelfth * (before[BY_PHASE] - after[BY_PHASE])
    tally[STOPPED] = max(tally[STOPPED], before[AT_END], after[AT_END])


@kernel(light=True)
def _moving(loop: np.ndarray) -> int:
    """How many entries of the state take steps: the filters do not, nor does a scanner that follows at once."""
    return FILTERS if loop[SPRING] != 0.0 else PLACE


@kernel
def _error(loop: np.ndarray, k: np.ndarray, h: float, size: float) -> float:
    """Local error of a step to an amplitude of this size [m], over what is allowed.

    The method of order 3 knows nothing of what changes with time alone, as where the tip lands within a step. So the
    bend of the rates counts as well. A faint amplitude has as good a phase as any, for it keeps that as it grows again.
    """
    worst = 0.0
    for j in range(_moving(loop)):
        bend = k[0, j] - k[1, j] - k[2, j] + k[4, j]
        local = COMPARED * (abs(k[3, j] - k[4, j]) + abs(bend) / 3.0)
        if math.isnan(local):
            return math.inf
        scale = loop[SETPOINT]
        if j < INTEGRAL:
            scale *= min(1.0, max(size / scale, FAINT))
        elif j == SPEED:
            scale *= math.sqrt(loop[SPRING])
        worst = max(worst, local * h / (TOLERANCE * scale))
    return worst


@kernel
def _path(loop: np.ndarray, k: np.ndarray, stage: int, b: complex, h: float, inverse: complex) -> Path:
    """The way of a from b at the start of a step, through what rates are known: a = b - b' inverse."""
    start = complex(k[0, AMP], k[0, AMP + 1])
    bend = twist = complex(0.0, 0.0)  # b' = start + bend x + twist x^2, x = t/h
    if stage == 2 or stage == 3:
        bend = 2.0 * (complex(k[stage - 1, AMP], k[stage - 1, AMP + 1]) - start)
    elif stage == 4:
        half = 0.5 * complex(k[1, AMP] + k[2, AMP], k[1, AMP + 1] + k[2, AMP + 1])
        end = complex(k[3, AMP], k[3, AMP + 1])
        bend, twist = 4.0 * half - end - 3.0 * start, 2.0 * (end - 2.0 * half + start)
    a_filter = 1.0 / loop[RATE]
    a_step = a_filter / h
    bend *= a_step
    twist *= 2.0 * a_step * a_step
    return Path(
        b - inverse * start, a_filter * start - inverse * bend, a_filter * bend - inverse * twist, a_filter * twist
    )


@kernel
def _add_noise(lever: np.ndarray, loop: np.ndarray, h: float, noise: np.random.Generator, y: np.ndarray) -> None:
    """What a time h of noise adds to a and to the first filter: theory, Eq. (slow-flow-7)."""
    alpha0, rate = lever[col.ALPHA0], loop[RATE]
    thermal = math.sqrt(-loop[THERMAL] * math.expm1(-2.0 * alpha0 * h))
    detector = math.sqrt(-0.5 * loop[DETECTOR] * rate * math.expm1(-2.0 * rate * h))
    for part in range(2):
        y[AMP + part] += thermal * noise.standard_normal()
        y[FILTERS + part] += detector * noise.standard_normal()


@kernel
def flow_on(
    law: Law, row: np.ndarray, lever: np.ndarray, loop: np.ndarray, stretch: Stretch, flow: Flow, tally: np.ndarray,
    noise: np.random.Generator,
) -> int:  # fmt: skip
    """Let a stretch of ground pass; returns a status."""
    p = parameters(row)
    sample = Sample(p, reach_of(law, p), (row[LIFT + ATTRACTED], row[LIFT + REPELLED]))
    flow.memory[KNOWN] = 0.0
    return _pass(law, sample, lever, loop, stretch, flow, tally, noise)


@kernel
def _pass(
    law: Law, sample: Sample, lever: np.ndarray, loop: np.ndarray, stretch: Stretch, flow: Flow, tally: np.ndarray,
    noise: np.random.Generator,
) -> int:  # fmt: skip
    """`flow_on` over one material, which comes by value: read from the row in every step, it takes 3 % longer."""
    y, k, trial, memory, ends = flow
    ground, slope, span = stretch
    noisy = loop[THERMAL] > 0.0 or loop[DETECTOR] > 0.0
    longest = NOISY / max(loop[RATE], lever[col.ALPHA0]) if noisy else math.inf
    if not memory[STEP] > 0.0:
        memory[STEP] = 0.1 / loop[RATE]
    inverse, moving = 0.5 / complex(lever[col.ALPHA0], lever[col.OMEGA]), _moving(loop)
    rates(law, sample, lever, loop, ground, y, memory, k[0])
    _look(loop, y, k[0], ends[0])
    done = 0.0
    for _ in range(MOST_STEPS + int(A_PERIOD * span * lever[col.OMEGA] / (2.0 * math.pi))):
        left = span - done
        steps = max(1.0, math.ceil(left / min(memory[STEP], longest) - 1e-9))
        h = left / steps
        shift, lead = memory[SHIFT], complex(memory[LEAD], memory[LEAD + 1])
        b = complex(y[AMP], y[AMP + 1]) + lead
        for stage in range(1, STAGES):
            for j in range(moving):
                way = _WHEN[stage] * k[stage - 1, j]
                if stage == STAGES - 1:
                    way = (k[0, j] + 2.0 * (k[1, j] + k[2, j]) + k[3, j]) / 6.0
                trial[j] = y[j] + h * way
            trial[AMP] += lead.real - memory[LEAD]
            trial[AMP + 1] += lead.imag - memory[LEAD + 1]
            filter_along(loop, y, _path(loop, k, stage, b, h, inverse), _WHEN[stage] * h, trial)
            if noisy and stage == STAGES - 1:
                _add_noise(lever, loop, h, noise, trial)
            rates(law, sample, lever, loop, ground + slope * (done + _WHEN[stage] * h), trial, memory, k[stage])
        error = _error(loop, k, h, size_of(complex(trial[AMP], trial[AMP + 1])))
        memory[STEP] = h * min(5.0, max(0.2, 0.9 * error**-0.25)) if error > 0.0 else 5.0 * h
        if error <= 1.0:
            if abs(memory[PUSH]) > lever[col.BASE] + loop[HARDEST] * size_of(complex(trial[AMP], trial[AMP + 1])):
                return col.NOT_CONVERGED
            _look(loop, trial, k[STAGES - 1], ends[1])
            _collect(ends[0], ends[1], h, tally)
            copy(ends[1], ends[0])
            copy(trial, y)
            copy(k[STAGES - 1], k[0])
            done += h
            if steps == 1.0:
                y[PLACE] = place_of(loop, y)
                return col.GOOD
        else:
            memory[SHIFT], memory[LEAD], memory[LEAD + 1] = shift, lead.real, lead.imag
            if not memory[STEP] > 1e-9 * span:
                return col.DIVERGED
    return col.NOT_CONVERGED
