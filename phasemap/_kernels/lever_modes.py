"""Modes of the cantilever, the second and higher ones too: their numbers in the lever, and the answer of all together.

The lever is that of `phasemap.experiment.lever_numbers.lever_of`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel

FORGOTTEN = 2.0  # ring-down rate over a period from which on a motion counts as forgotten in the next


class LeverMode(NamedTuple):
    """A mode of the lever: omega^2 w'' + 2 rate omega w' + square w = share (force over k), over the drive's angle."""

    decay: float  # real part of its lambda [1]: a free motion is the real part of a multiple of exp(lambda theta)
    turn: float  # imaginary part of it
    square: float  # of its frequency [1]
    rate: float  # at which it rings down [1]
    share: float  # its acceleration by a force over k [1]


@kernel(light=True)
def modes_of(lever: np.ndarray) -> int:
    """Number of modes."""
    return int(lever[col.MODES])


@kernel(light=True, inline=True)
def mode_of(lever: np.ndarray, i: int) -> LeverMode:
    """The mode i of a lever, counted from 0."""
    first = col.MODE + i * col.MODE_NUMBERS
    omega, rate = lever[col.OMEGA], lever[first + col.RATE]
    square = lever[first + col.FREQUENCY] * lever[first + col.FREQUENCY]
    return LeverMode(-rate / omega, math.sqrt(square - rate * rate) / omega, square, rate, lever[first + col.SHARE])


@kernel(light=True)
def dynamic_stiffness_at(mode: LeverMode, omega: float) -> complex:
    """w_i^2 - omega^2 + 2i alpha_i omega [1] of a mode at any frequency."""
    return complex(mode.square - omega * omega, 2.0 * mode.rate * omega)


@kernel
def dynamic_stiffness_of_mode(lever: np.ndarray, i: int) -> complex:
    """The dynamic stiffness [1] of a mode at the drive frequency."""
    return dynamic_stiffness_at(mode_of(lever, i), lever[col.OMEGA])


@kernel
def inverse_inertia(lever: np.ndarray) -> complex:
    """1/(2 (alpha0 + i omega)); of several modes i over the slope of the dynamic stiffness by the frequency.

    So modes above the first follow it at once: theory, Eq. (slow-flow-3).
    """
    if lever[col.MODES] < 2:
        return 0.5 / complex(lever[col.ALPHA0], lever[col.OMEGA])
    omega, slope = lever[col.OMEGA], complex(0.0, 0.0)
    for i in range(modes_of(lever)):
        kappa, mode = dynamic_stiffness_of_mode(lever, i), mode_of(lever, i)
        slope += 2.0 * mode.share * complex(mode.rate, omega) / (kappa * kappa)
    stiffness = complex(lever[col.DYNAMIC_STIFFNESS], lever[col.DYNAMIC_LOSS])
    return 1.0 / (stiffness * stiffness * slope)


@kernel(light=True)
def slowest_decay(lever: np.ndarray) -> float:
    """Rate alpha_i [1] of the mode that rings longest."""
    slowest = float(lever[col.ALPHA0])
    for i in range(1, modes_of(lever)):
        slowest = min(slowest, mode_of(lever, i).rate)
    return slowest


@kernel(light=True)
def static_compliance(lever: np.ndarray) -> float:
    """Deflection by a force that stays, over that of the first mode alone: theory, Eq. (lever-4)."""
    total = 0.0
    for i in range(modes_of(lever)):
        total += mode_of(lever, i).share / mode_of(lever, i).square
    return total


@kernel
def static_share(lever: np.ndarray, i: int) -> float:
    """Share of mode i in the deflection of the tip by a static force."""
    return mode_of(lever, i).share / mode_of(lever, i).square / static_compliance(lever)


@kernel
def all_shares(lever: np.ndarray) -> float:
    """Acceleration of the tip by a force over k [1]: that of all modes together."""
    total = 0.0
    for i in range(modes_of(lever)):
        total += mode_of(lever, i).share
    return total


@kernel
def fastest_turn(lever: np.ndarray, slope: float) -> float:
    """Upper bound [1] of the rates at which a lever on a stiffness [N/m] oscillates."""
    return math.sqrt(mode_of(lever, modes_of(lever) - 1).square + all_shares(lever) * abs(slope) / lever[col.STIFFNESS])


@kernel(light=True)
def detected_compliance(lever: np.ndarray, omega: float) -> complex:
    """Deflection that the detector sees under a force at the tip of this frequency, over the force and times k [1]."""
    seen = complex(0.0, 0.0)
    for i in range(modes_of(lever)):
        mode, weight = mode_of(lever, i), lever[col.MODE + i * col.MODE_NUMBERS + col.SLOPE_SEEN]
        seen += weight * mode.share / dynamic_stiffness_at(mode, omega)
    return seen


@kernel(light=True)
def higher_modes_forget(lever: np.ndarray) -> bool:
    """True if the modes above the first have mostly rung down when the tip taps again."""
    for i in range(1, modes_of(lever)):
        if 2.0 * math.pi * mode_of(lever, i).rate < FORGOTTEN * lever[col.OMEGA]:
            return False
    return True
