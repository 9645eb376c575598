"""The full equation of motion under the loop, period by period.

While a period passes, the scanner stays, and the ground under the tip is that at its middle. The lock-in takes in the
first harmonic of that period, and the controller sends the scanner on at its end.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, Oscillator, parameters
from phasemap._kernels.orbits.time import elements
from phasemap._kernels.orbits.time.tip import COS, GIVEN, SIN, TOUCHES, V, Z
from phasemap._kernels.scanning.loop import (
    AMP,
    DETECTOR,
    INTEGRAL,
    PLACE,
    STATE,
    STOPPED,
    SUM_AMPLITUDE,
    SUM_PHASE,
    SUM_PLACE,
    THERMAL,
    TIME,
    Stretch,
    command,
    filter_for,
    move_scanner,
    shown,
)
from phasemap._kernels.scanning.one_tap import ROOM, pass_period

# Entries of the memory: size of the march's steps; how much later [tau] than the end of what was asked the next
# period begins; Z, R and phase of the last one.
ETA, AHEAD, OF_PLACE, OF_AMPLITUDE, OF_PHASE, MEMORY = 0, 1, 2, 3, 4, 5


class Periods(NamedTuple):
    """The lever in time under its loop: state, that of the tip, what a period gives, memory, and that of its taps."""

    y: np.ndarray
    tip: np.ndarray
    sums: np.ndarray
    memory: np.ndarray
    taps: np.ndarray


@kernel(light=True)
def new_periods(eta: float) -> Periods:
    """Return one at rest, to be marched in steps of this size."""
    memory = np.zeros(MEMORY)
    memory[ETA] = eta
    return Periods(np.zeros(STATE), np.zeros(elements.STATE), np.zeros(GIVEN), memory, np.zeros(ROOM))


@kernel
def begin_periods(lever: np.ndarray, mean: float, a: complex, state: Periods) -> None:
    """Set the lever swinging about a mean deflection with a complex amplitude [m], at drive phase 0."""
    state.tip[Z], state.tip[V], state.tip[TOUCHES] = mean + a.real, -lever[col.OMEGA] * a.imag, 0.0
    state.memory[AHEAD] = 0.0
    for j in range(ROOM):
        state.taps[j] = 0.0


@kernel
def _collect(memory: np.ndarray, time: float, tally: np.ndarray) -> None:
    """Count so much of the last period."""
    tally[TIME] += time
    tally[SUM_PLACE] += time * memory[OF_PLACE]
    tally[SUM_AMPLITUDE] += time * memory[OF_AMPLITUDE]
    tally[SUM_PHASE] += time * memory[OF_PHASE]


@kernel
def _add_noise(lever: np.ndarray, loop: np.ndarray, period: float, noise: np.random.Generator, state: Periods) -> None:
    """Add to z and z' what a period of white noise does to the free lever, and the detector's noise to a."""
    kick = math.sqrt(-loop[THERMAL] * math.expm1(-2.0 * lever[col.ALPHA0] * period))
    spread = math.sqrt(loop[DETECTOR] / period)
    for part in range(2):
        state.tip[part] += kick * noise.standard_normal()
        state.y[AMP + part] += spread * noise.standard_normal()


@kernel
def march_on(
    law: Law, row: np.ndarray, lever: np.ndarray, loop: np.ndarray, stretch: Stretch, state: Periods, tally: np.ndarray,
    noise: np.random.Generator,
) -> int:  # fmt: skip
    """Let the periods pass whose middle is within a stretch of ground; returns a status."""
    ground, slope, span = stretch
    p, y, memory = parameters(row), state.y, state.memory
    period = 2.0 * math.pi / lever[col.OMEGA]
    noisy = loop[THERMAL] > 0.0 or loop[DETECTOR] > 0.0
    at = memory[AHEAD]
    if at > 0.0:
        _collect(memory, min(at, span), tally)
    while at + 0.5 * period < span:
        z0 = y[PLACE] - ground - slope * (at + 0.5 * period)
        if pass_period(Oscillator(law, p, lever), z0, memory[ETA], state.tip, state.sums, state.taps) < 0:
            return col.DIVERGED
        y[AMP], y[AMP + 1] = state.sums[COS], -state.sums[SIN]
        if noisy:
            _add_noise(lever, loop, period, noise, state)
        amplitude, phase = shown(loop, y)
        filter_for(loop, y, period)
        amplitude_after, phase_after = shown(loop, y)
        memory[OF_PLACE] = y[PLACE]
        memory[OF_AMPLITUDE] = 0.5 * (amplitude + amplitude_after)
        memory[OF_PHASE] = 0.5 * (phase + phase_after)
        to, rate, stopped = command(loop, y)
        y[INTEGRAL] += rate * period
        to, _, _ = command(loop, y)
        move_scanner(loop, y, to, period)
        if stopped:
            tally[STOPPED] = 1.0
        _collect(memory, min(at + period, span) - max(at, 0.0), tally)
        at += period
    memory[AHEAD] = at - span
    return col.GOOD
