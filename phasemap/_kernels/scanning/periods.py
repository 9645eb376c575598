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
from phasemap._kernels.law import Oscillator, parameters
from phasemap._kernels.orbits.time.march import march_oscillator
from phasemap._kernels.orbits.time.surface_memory import memory_size
from phasemap._kernels.orbits.time.tip import TOUCHES, PeriodResult, V, Z, fill_higher_modes
from phasemap._kernels.records import record
from phasemap._kernels.scanning.feedback_loop import (
    A_IMAG,
    A_REAL,
    INTEGRAL,
    LOOP_STATE,
    SCANNER,
    CubicPath,
    Loop,
    Setup,
    Stretch,
    Tally,
    filter_cubic,
    lock_in_output,
    move_scanner,
    scanner_command,
)


@record
class PeriodMemory:
    """Numbers that one stretch of ground leaves for the next."""

    step_size: float  # size of the march's steps
    ahead: float  # how much later than the end of the stretch the next period begins [tau]
    scanner: float  # of the last period: height of the scanner [m]
    amplitude: float  # that the lock-in showed [m]
    phase: float  # that the lock-in showed [rad]


class PeriodsUnderLoop(NamedTuple):
    """The lever under its loop by the equation of motion."""

    y: np.ndarray  # state of the loop, shape (LOOP_STATE,)
    tip: np.ndarray  # state of the tip where a period begins, as `tip` names it
    sums: PeriodResult
    memory: PeriodMemory


def new_periods(step_size: float) -> PeriodsUnderLoop:
    """Return a lever at rest, to be marched in steps of this size."""
    memory = PeriodMemory()
    memory.step_size = step_size
    return PeriodsUnderLoop(np.zeros(LOOP_STATE), np.zeros(memory_size(col.MOST_ARMS)), PeriodResult(), memory)


@kernel
def begin_periods(lever: np.ndarray, mean: float, real: float, imag: float, state: PeriodsUnderLoop) -> None:
    """Set the lever swinging about a mean deflection with a complex amplitude [m], at drive phase 0."""
    state.tip[Z], state.tip[V], state.tip[TOUCHES] = mean + real, -lever[col.OMEGA] * imag, 0.0
    fill_higher_modes(lever, mean, state.tip)
    state.memory.ahead = 0.0


@kernel
def _add_time(memory: PeriodMemory, time: float, tally: Tally) -> None:
    """Add so much of the last period to the integrals."""
    tally.time += time
    tally.scanner += time * memory.scanner
    tally.amplitude += time * memory.amplitude
    tally.phase += time * memory.phase


@kernel
def _add_period_noise(
    lever: np.ndarray, loop: Loop, period: float, noise: np.random.Generator, state: PeriodsUnderLoop
) -> None:
    """Add the thermal noise of a period to z and z', and the noise of the detector to a."""
    kick = math.sqrt(-loop.thermal_noise * math.expm1(-2.0 * lever[col.ALPHA0] * period))
    spread = math.sqrt(loop.detector_noise / period)
    for part in range(2):
        state.tip[part] += kick * noise.standard_normal()
        state.y[A_REAL + part] += spread * noise.standard_normal()


@kernel
def march_on(state: PeriodsUnderLoop, setup: Setup, row: np.ndarray, stretch: Stretch, tally: Tally) -> int:
    """March the periods whose middle is over a stretch of ground; returns a status."""
    law, lever, loop, noise = setup
    ground, slope, span = stretch
    oscillator, y, memory = Oscillator(law, parameters(row), lever), state.y, state.memory
    period = 2.0 * math.pi / lever[col.OMEGA]
    noisy = loop.thermal_noise > 0.0 or loop.detector_noise > 0.0
    passed, still = memory.ahead, complex(0.0, 0.0)
    if passed > 0.0:
        _add_time(memory, min(passed, span), tally)
    while passed + 0.5 * period < span:
        z0 = y[SCANNER] - ground - slope * (passed + 0.5 * period)
        if march_oscillator(oscillator, z0, memory.step_size, state.tip, state.sums) < 0:
            return col.DIVERGED
        y[A_REAL], y[A_IMAG] = state.sums.cos, -state.sums.sin
        if noisy:
            _add_period_noise(lever, loop, period, noise, state)
        amplitude, phase = lock_in_output(loop, y)
        filter_cubic(loop, y, CubicPath(complex(y[A_REAL], y[A_IMAG]), still, still, still), period, y)
        amplitude_after, phase_after = lock_in_output(loop, y)
        memory.scanner = y[SCANNER]
        memory.amplitude = 0.5 * (amplitude + amplitude_after)
        memory.phase = 0.5 * (phase + phase_after)
        command, rate, stopped = scanner_command(loop, y)
        y[INTEGRAL] += rate * period
        command, _, _ = scanner_command(loop, y)
        move_scanner(loop, y, command, period)
        if stopped:
            tally.stopped = 1
        _add_time(memory, min(passed + period, span) - max(passed, 0.0), tally)
        passed += period
    memory.ahead = passed - span
    return col.GOOD
