"""Slow flow: the complex amplitude of the lever averaged over its period (first order), together with the loop.

With z = Re(a exp(i omega tau)) and the first harmonic P, S of the surface's part at the present amplitude and distance,

    2 (alpha0 + i omega) a' = u0 - (1 - omega^2 + 2 i alpha0 omega) a - (P - i S) a/|a|

(theory, Eq. (slow-flow-1); Wang 1999, Eqs. 5-8, before they are set to rest; the free lever's own terms are exact). The
mean deflection follows at once. What limits the steps is the lock-in, which decays fast, so that the pair of orders 3
and 2 of Bogacki and Shampine (Appl. Math. Lett. 2 (1989) 321) takes the least work. Steps end where the surface has a
corner.
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
from phasemap._kernels.orbits.averaged.harmonics import harmonics
from phasemap._kernels.scanning.higher_harmonics import ATTRACTED, REPELLED
from phasemap._kernels.scanning.loop import (
    AMP,
    DETECTOR,
    FILTERS,
    INTEGRAL,
    KP,
    LOSS,
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
    Stretch,
    command,
    drift_of,
    shown,
    used,
)

TOLERANCE = 5e-5  # of the setpoint amplitude, local error of a step
MOST_STEPS, A_PERIOD = 500, 8.0  # between two corners of the surface, and in a period: more follow no averaged lever
FAINTEST = 1e-6  # of the setpoint amplitude; a has no phase at 0
NOISY = 0.25  # in decay times of lever and lock-in: the longest step with noise

_A = np.array([[0, 0, 0], [1 / 2, 0, 0], [0, 3 / 4, 0], [2 / 9, 1 / 3, 4 / 9]])
_LOCAL = np.array([-5 / 72, 1 / 12, 1 / 9, -1 / 8])
_WHEN = _A.sum(axis=1)
STAGES = 4

# Entries of a flow's memory.
STEP, SHIFT = 0, 1

LIFT = col.ROW  # first of the two columns that rows have beyond those of a law: kappa of `lifts`


class Sample(NamedTuple):
    """A material: its parameters, the reach [m] of its force, and kappa of an attractive and a repulsive P."""

    p: tuple[float, ...]
    reach: float
    lift: tuple[float, float]


class Flow(NamedTuple):
    """The averaged lever under its loop: state, rates at the stages of a step, a state tried, step and deflection."""

    y: np.ndarray
    stages: np.ndarray
    trial: np.ndarray
    memory: np.ndarray


@kernel(light=True)
def new_flow() -> Flow:
    """Return an empty one."""
    return Flow(np.zeros(STATE), np.zeros((STAGES, STATE)), np.zeros(STATE), np.zeros(2))


@kernel
def rates(
    law: Law, sample: Sample, lever: np.ndarray, loop: np.ndarray, ground: float, y: np.ndarray, shift: float,
    out: np.ndarray,
) -> float:  # fmt: skip
    """Fill `out` with dy/dtau over a ground of this height [m].

    Takes and returns by how much [m] mean deflection and harmonics carry the tip towards the ground.
    """
    p, reach, lift = sample
    omega, alpha0 = lever[col.OMEGA], lever[col.ALPHA0]
    a = complex(y[AMP], y[AMP + 1])
    size = max(abs(a), FAINTEST * loop[SETPOINT])
    to, out[INTEGRAL], _ = command(loop, y)
    if loop[SPRING] == 0.0:
        place, out[PLACE], out[SPEED] = to, 0.0, 0.0
    else:
        place = y[PLACE]
        out[PLACE] = y[SPEED]
        out[SPEED] = loop[SPRING] * (to - place) - loop[LOSS] * y[SPEED]
    # The controller acts once a period: the scanner is where it was sent half a period ago, on average.
    place -= math.pi / omega * _speed_of(loop, y, out)
    push, drag, mean = harmonics(law, p, lever, reach, size, (place - ground - shift) / size)
    drive = lever[col.BASE] - complex(1.0 - omega * omega, 2.0 * alpha0 * omega) * a
    da = (drive - complex(push, -drag) * a / size) / (2.0 * complex(alpha0, omega))
    out[AMP], out[AMP + 1] = da.real, da.imag
    for part in range(2):
        before = y[AMP + part]
        for j in range(FILTERS + part, used(loop), 2):
            out[j] = loop[RATE] * (before - y[j])
            before = y[j]
    # At rest P is at most u0; in what exceeds that, contact is long and its harmonics are few.
    push = min(max(push, -lever[col.BASE]), lever[col.BASE])
    return mean + push * (lift[REPELLED] if push > 0.0 else lift[ATTRACTED])


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
def _collect(loop: np.ndarray, flow: Flow, h: float, sign: float, tally: np.ndarray) -> None:
    """Add one end of a step to the integrals: h/2 (f0 + f1) + h^2/12 (f0' - f1')."""
    y, out = (flow.y, flow.stages[0]) if sign > 0.0 else (flow.trial, flow.stages[STAGES - 1])
    amplitude, phase = shown(loop, y)
    by_amplitude, by_phase = drift_of(loop, y)
    half, twelfth = 0.5 * h, sign * h * h / 12.0
    tally[TIME] += half
    tally[SUM_PLACE] += half * place_of(loop, y) + twelfth * _speed_of(loop, y, out)
    tally[SUM_AMPLITUDE] += half * amplitude + twelfth * by_amplitude
    tally[SUM_PHASE] += half * phase + twelfth * by_phase
    if command(loop, y)[2]:
        tally[STOPPED] = 1.0


@kernel
def _error(loop: np.ndarray, flow: Flow, h: float) -> float:
    """Local error of a step over what is allowed."""
    worst = 0.0
    for j in range(used(loop)):
        local = 0.0
        for i in range(STAGES):
            local += _LOCAL[i] * flow.stages[i, j]
        scale = loop[SETPOINT] * (math.sqrt(loop[SPRING]) if j == SPEED and loop[SPRING] > 0.0 else 1.0)
        worst = max(worst, abs(local) * h / (TOLERANCE * scale))
        if math.isnan(local):
            return math.inf
    return worst


@kernel
def _add_noise(lever: np.ndarray, loop: np.ndarray, h: float, noise: np.random.Generator, y: np.ndarray) -> None:
    """What a time h of noise adds to a and to the first filter: theory, Eq. (slow-flow-4)."""
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
    return _pass(law, sample, lever, loop, stretch, flow, tally, noise)


@kernel
def _pass(
    law: Law, sample: Sample, lever: np.ndarray, loop: np.ndarray, stretch: Stretch, flow: Flow, tally: np.ndarray,
    noise: np.random.Generator,
) -> int:  # fmt: skip
    """`flow_on` over one material, which comes by value: read from the row in every step, it takes 3 % longer."""
    y, k, trial, memory = flow
    ground, slope, span = stretch
    noisy = loop[THERMAL] > 0.0 or loop[DETECTOR] > 0.0
    longest = NOISY / max(loop[RATE], lever[col.ALPHA0]) if noisy else math.inf
    if not memory[STEP] > 0.0:
        memory[STEP] = 0.1 / loop[RATE]
    done, fresh = 0.0, True
    for _ in range(MOST_STEPS + int(A_PERIOD * span * lever[col.OMEGA] / (2.0 * math.pi))):
        left = span - done
        h = min(memory[STEP], longest)
        last = h >= left * (1.0 - 1e-9)
        if last:
            h = left
        if fresh:
            memory[SHIFT] = rates(law, sample, lever, loop, ground + slope * done, y, memory[SHIFT], k[0])
            fresh = False
        shift = memory[SHIFT]
        for stage in range(1, STAGES):
            for j in range(used(loop)):
                step = 0.0
                for i in range(stage):
                    step += _A[stage, i] * k[i, j]
                trial[j] = y[j] + h * step
            below = ground + slope * (done + _WHEN[stage] * h)
            shift = rates(law, sample, lever, loop, below, trial, shift, k[stage])
        error = _error(loop, flow, h)
        if error <= 1.0:
            _collect(loop, flow, h, 1.0, tally)
            _collect(loop, flow, h, -1.0, tally)
            copy(trial, y)
            copy(k[STAGES - 1], k[0])
            memory[SHIFT], done = shift, done + h
            if noisy:
                _add_noise(lever, loop, h, noise, y)
                fresh = True
            if last:
                y[PLACE] = place_of(loop, y)
                return col.GOOD
        grown = h * min(5.0, max(0.2, 0.9 * error ** (-1.0 / 3.0))) if error > 0.0 else 5.0 * h
        if not last or grown < memory[STEP]:
            memory[STEP] = grown
        if not memory[STEP] > 1e-9 * span:
            return col.DIVERGED
    return col.NOT_CONVERGED
