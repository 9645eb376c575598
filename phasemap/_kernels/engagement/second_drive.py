"""A second mode that is driven at its own frequency, marched together with the first.

    y2'' + 2 alpha2 y2' + w2^2 y2 = share2 (U2 cos(psi) - F/k),    psi' = omega2

What the surface adds to the second mode is the force's part at omega2 over its motion: with Y2 the complex amplitude
that a lock-in shows at omega2,

    kappa2 = share2 U2 / Y2 - (w2^2 - omega2^2 + 2 i alpha2 omega2)    [1]

A phase-locked loop makes omega2^2 = w2^2 + Re(kappa2), where the mode lags by 90 degrees, and a gain holds |Y2|.
See theory, Eq. (time-8).
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.lever_modes import dynamic_stiffness_at, mode_of
from phasemap._kernels.orbits.time.tip import PLAIN_STATE

LOOP_GAIN = 0.7  # of both loops: share of what an average asks for, by which they go
LEAST_SQUARE = 0.25  # of w2^2, to which the square of the frequency may fall


@kernel
def begin_second_drive(lever: np.ndarray, u: np.ndarray) -> None:
    """Begin the second drive, with the second mode swinging as when it is free, in a state at the begin of a period."""
    mode, size = mode_of(lever, 1), lever[col.SECOND_FREE]
    omega = math.sqrt(mode.square)
    lever[col.SECOND_FORCE] = 2.0 * mode.rate * omega * size / mode.share
    lever[col.SECOND_OMEGA], lever[col.SECOND_PHASE] = omega, 0.0
    u[PLAIN_STATE + 1] += omega * size  # of the lag of 90 degrees: y2 = A2 sin(psi)


@kernel
def pass_period(lever: np.ndarray) -> None:
    """Advance the phase of the second drive to the begin of the first drive's next period."""
    turn = 2.0 * math.pi
    phase = lever[col.SECOND_PHASE] + lever[col.SECOND_OMEGA] * turn / lever[col.OMEGA]
    lever[col.SECOND_PHASE] = phase - turn * math.floor(phase / turn)


@kernel
def averaging_weight(i: int, count: int) -> float:
    """Weight of period i of `count`, of mean 1: Hann's window, in which harmonics of the first drive leave nothing."""
    return 1.0 - math.cos(2.0 * math.pi * (i + 0.5) / count)


@kernel
def felt_by_second_mode(lever: np.ndarray, phasor: complex) -> complex:
    """Dynamic stiffness [1] that the surface adds to the second mode, by the mode's complex amplitude [m]."""
    mode = mode_of(lever, 1)
    free_stiffness = dynamic_stiffness_at(mode, lever[col.SECOND_OMEGA])
    return mode.share * lever[col.SECOND_FORCE] / phasor - free_stiffness


@kernel
def hold_second_mode(lever: np.ndarray, felt: complex) -> None:
    """Move frequency and force of the second drive towards resonance and amplitude, where loops hold these."""
    if lever[col.SECOND_HELD] == 0.0:
        return
    mode = mode_of(lever, 1)
    omega = math.sqrt(mode.square * max(1.0 + felt.real / mode.square, LEAST_SQUARE))
    force = abs(2.0 * mode.rate * omega + felt.imag) * lever[col.SECOND_FREE] / mode.share
    lever[col.SECOND_OMEGA] += LOOP_GAIN * (omega - lever[col.SECOND_OMEGA])
    lever[col.SECOND_FORCE] += LOOP_GAIN * (force - lever[col.SECOND_FORCE])
