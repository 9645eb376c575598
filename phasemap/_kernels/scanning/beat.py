"""The full equation of motion under the loop, period by period.

While a period passes, the scanner stays and so does the ground under the tip. The lock-in takes in the first harmonic
of that period, and the controller sends the scanner on at its end.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from phasemap._kernels import columns as col
from phasemap._kernels.law import OPTIONS, Law
from phasemap._kernels.march import march_period
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
    command,
    filter_for,
    move_scanner,
    shown,
)

# Entries of a beat's memory: size of the march's steps; time [tau] by which the last period went beyond what was asked.
ETA, AHEAD = 0, 1


class Beat(NamedTuple):
    """The lever in time under its loop: state, (z, z', in contact), sums over a period, memory."""

    y: np.ndarray
    tip: np.ndarray
    sums: np.ndarray
    memory: np.ndarray


@njit(**OPTIONS)
def new_beat(eta: float) -> Beat:
    """Return one at rest, to be marched in steps of this size."""
    return Beat(np.zeros(STATE), np.zeros(3), np.zeros(7), np.array([eta, 0.0]))


@njit(**OPTIONS)
def _shake(lever: np.ndarray, loop: np.ndarray, period: float, noise: np.random.Generator, beat: Beat) -> None:
    """Add to z and z' what a period of white noise does to the free lever, and the detector's noise to a."""
    kick = math.sqrt(-loop[THERMAL] * math.expm1(-2.0 * lever[col.ALPHA0] * period))
    spread = math.sqrt(loop[DETECTOR] / period)
    for part in range(2):
        beat.tip[part] += kick * noise.standard_normal()
        beat.y[AMP + part] += spread * noise.standard_normal()


@njit(**OPTIONS)
def beat_on(
    law: Law, row: np.ndarray, lever: np.ndarray, loop: np.ndarray, ground: float, slope: float, span: float,
    beat: Beat, tally: np.ndarray, noise: np.random.Generator,
) -> int:  # fmt: skip
    """Let the periods pass that begin within a time `span`, over ground as in `flow_on`; returns a status."""
    y, memory = beat.y, beat.memory
    period = 2.0 * math.pi / lever[col.OMEGA]
    noisy = loop[THERMAL] > 0.0 or loop[DETECTOR] > 0.0
    at = memory[AHEAD]
    while at < span:
        z0 = y[PLACE] - ground - slope * at
        if march_period(law, row, lever, z0, memory[ETA], beat.tip, beat.sums) < 0:
            return col.DIVERGED
        y[AMP], y[AMP + 1] = beat.sums[0], -beat.sums[1]
        if noisy:
            _shake(lever, loop, period, noise, beat)
        filter_for(loop, y, period)
        place = y[PLACE]
        to, rate, stopped = command(loop, y)
        y[INTEGRAL] += rate * period
        to, _, _ = command(loop, y)
        move_scanner(loop, y, to, period)
        amplitude, phase = shown(loop, y)
        tally[TIME] += period
        tally[SUM_PLACE] += period * place
        tally[SUM_AMPLITUDE] += period * amplitude
        tally[SUM_PHASE] += period * phase
        if stopped:
            tally[STOPPED] = 1.0
        at += period
    memory[AHEAD] = at - span
    return col.GOOD
