"""Modes of a lever that has several, as the march takes them, and their share in the motion of the tip.

The rigid motion of a driven base is counted with the first mode, so that z is the sum of the displacements y_i of
all modes, y_i'' + 2 alpha_i y_i' + w_i^2 y_i = Re(D_i exp(i omega tau)) - share_i g, g the surface's force over k.
See theory, Eq. (time-6).
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.lever_modes import dynamic_stiffness_of_mode, mode_of, modes_of
from phasemap._kernels.records import column, record


@record
class Modes:
    """Modes of a lever; the first comes first. Of a lever with one mode only the first three numbers count."""

    count: int
    fastest: float  # square of the largest resonance [1]; 1 of one mode
    share: float  # acceleration of the tip by a force over k: sum of all shares [1]; 1 of one mode
    square: np.ndarray = column(col.MOST_MODES)  # w_i^2 [1]
    damping: np.ndarray = column(col.MOST_MODES)  # 2 alpha_i [1]
    shares: np.ndarray = column(col.MOST_MODES)  # acceleration of each by a force over k [1]
    drive_re: np.ndarray = column(col.MOST_MODES)  # D_i [m]
    drive_im: np.ndarray = column(col.MOST_MODES)
    loss: np.ndarray = column(col.MOST_MODES)  # what its damping takes, over what that of the first does [1]
    second: float  # amplitude of the force of a second drive over k [m], 0 without one
    second_omega: float  # its frequency [1]
    second_phase: float  # its phase where the period begins


@kernel
def drive_of_mode(lever: np.ndarray, i: int) -> complex:
    """D_i [m] of a mode: acceleration by the drive, whose force at the tip has the phase 0."""
    pulled = complex(lever[col.MODE + col.MODE_NUMBERS * i + col.PULLED], 0.0)
    if i == 0:
        pulled += lever[col.RIGID] * dynamic_stiffness_of_mode(lever, 0)
    return pulled * complex(lever[col.TURN_COS], -lever[col.TURN_SIN])


@kernel
def fill_modes(lever: np.ndarray, modes: Modes) -> None:
    """Fill in the modes of a lever."""
    modes.count, modes.fastest, modes.share = modes_of(lever), 1.0, 1.0
    if modes.count < 2:
        return
    modes.share = 0.0
    modes.second, modes.second_omega = lever[col.SECOND_FORCE], lever[col.SECOND_OMEGA]
    modes.second_phase = lever[col.SECOND_PHASE]
    for i in range(modes.count):
        mode, drive = mode_of(lever, i), drive_of_mode(lever, i)
        modes.square[i], modes.damping[i], modes.shares[i] = mode.square, 2.0 * mode.rate, mode.share
        modes.drive_re[i], modes.drive_im[i] = drive.real, drive.imag
        modes.loss[i] = mode.rate / (mode.share * lever[col.ALPHA0]) if mode.share > 0.0 else 0.0
        modes.fastest = max(modes.fastest, mode.square)
        modes.share += mode.share


@kernel
def harmonic_of_mode(lever: np.ndarray, i: int, tip: complex) -> complex:
    """Complex amplitude [m] of mode i in a motion whose first harmonic at the tip has the complex amplitude `tip`."""
    force = lever[col.DRIVE] - complex(lever[col.DYNAMIC_STIFFNESS], lever[col.DYNAMIC_LOSS]) * tip
    return (drive_of_mode(lever, i) - mode_of(lever, i).share * force) / dynamic_stiffness_of_mode(lever, i)


@kernel
def air_beside_first_harmonic(lever: np.ndarray, tip: complex, air: float) -> float:
    """Energy [J] into air in the balance of the tip, from `air` [J], what the damping of all modes takes in a period.

    That is `air` less what the first harmonics of all modes take, plus what the first harmonic of the tip takes
    according to the dynamic stiffness, its complex amplitude being `tip` [m]: theory, Eq. (time-7).
    """
    omega, stiffness = lever[col.OMEGA], lever[col.STIFFNESS]
    air += math.pi * stiffness * lever[col.DYNAMIC_LOSS] * abs(tip) ** 2
    for i in range(modes_of(lever)):
        mode = mode_of(lever, i)
        if mode.share > 0.0:
            amplitude2 = abs(harmonic_of_mode(lever, i, tip)) ** 2
            air -= 2.0 * math.pi * stiffness * mode.rate * omega * amplitude2 / mode.share
    return air
