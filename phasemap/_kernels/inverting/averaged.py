"""Averaged orbits on a branch that is known, with their derivatives with respect to the material.

At a given amplitude the averaged orbit is a root c of one scalar equation, the mismatch of the drive (`averaging`), so
that by the implicit function theorem phase and tip offset change with a parameter at fixed c, and by what c changes.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from phasemap._kernels.approach import averaged_orbits
from phasemap._kernels.averaging import harmonics, mismatch
from phasemap._kernels.columns import ALPHA0, OMEGA
from phasemap._kernels.law import OPTIONS, Law
from phasemap._kernels.mesh import reach_of
from phasemap._kernels.quick import parameters

PHASE, OFFSET, VALUES = 0, 1, 2  # what is measured: phase [rad], tip offset [m]
MOST_STEPS = 14
FINE = 1e-4  # of the depth, for derivatives with respect to c
CLOSE = 1e-5  # of the depth: Newton's last step, whose square is what is left
LONGEST = 0.6  # of the depth, of a step


@njit(**OPTIONS)
def depth_of(reach: float, amplitude: float, c: float) -> float:
    """Scale on which the mismatch changes with c."""
    return reach / amplitude + abs(c - 1.0) + 1e-9


@njit(**OPTIONS)
def observed(
    lever: np.ndarray, amplitude: float, c: float, push: float, drag: float, mean: float
) -> tuple[float, float]:
    """Phase [rad] and tip offset [m]."""
    omega = lever[OMEGA]
    x = push + amplitude * (1.0 - omega * omega)
    y = 2.0 * lever[ALPHA0] * omega * amplitude - drag
    return math.atan2(x, y), amplitude * c + mean


@njit(**OPTIONS)
def root_near(
    law: Law, p: np.ndarray, lever: np.ndarray, reach: float, amplitude: float, side: int, c: float
) -> tuple[float, float]:
    """The root c near a guess, and dh/dc there; NaN if Newton's method leaves this branch or its stable part."""
    slope = math.nan
    for _ in range(MOST_STEPS):
        depth = depth_of(reach, amplitude, c)
        push, drag, _mean = harmonics(law, p, lever, reach, amplitude, c)
        h = mismatch(lever, amplitude, push, drag)
        near, far, _mean = harmonics(law, p, lever, reach, amplitude, c + FINE * depth)
        slope = (mismatch(lever, amplitude, near, far) - h) / (FINE * depth)
        if not slope < 0.0:
            return math.nan, math.nan
        step = min(max(-h / slope, -LONGEST * depth), LONGEST * depth)
        c += step
        if abs(step) < CLOSE * depth:
            return (c, slope) if (push > 0.0) == (side > 0) else (math.nan, math.nan)
    return math.nan, math.nan


@njit(**OPTIONS)
def root_anywhere(
    law: Law, p: np.ndarray, lever: np.ndarray, reach: float, amplitude: float, side: int
) -> tuple[float, float]:
    """The farthest stable root on this branch, and dh/dc there; NaN if there is none."""
    candidates = averaged_orbits(law, p, lever, amplitude)
    for i in range(len(candidates)):
        if (candidates[i, 3] > 0.0) == (side > 0):
            c, slope = root_near(
                law, p, lever, reach, amplitude, side, (candidates[i, 0] - candidates[i, 1]) / amplitude
            )
            if slope < 0.0:
                return c, slope
    return math.nan, math.nan


@njit(**OPTIONS)
def averaged_block(
    law: Law, rows: np.ndarray, step: float, levers: np.ndarray, amplitudes: np.ndarray, sides: np.ndarray,
    search: bool, places: np.ndarray, values: np.ndarray, slopes: np.ndarray, good: np.ndarray,
) -> None:  # fmt: skip
    """Averaged phase and tip offset of n materials in m images, and their derivatives.

    Parameters
    ----------
    rows : ndarray, shape (1 + k, n, ROW)
        Parameters of the materials, and those with each of k logarithms larger by `step`.
    levers : ndarray, shape (m, 4)
    amplitudes : ndarray, shape (m,)
    sides : ndarray of int8, shape (n, m)
        -1 attractive, 1 repulsive, 0 where there is nothing to compare with.
    search : bool
        Whether to look at all averaged orbits where `places` lead nowhere.
    places : ndarray, shape (n, m)
        c of the orbits: a guess, and what was found.
    values : ndarray, shape (n, m, VALUES)
    slopes : ndarray, shape (n, m, VALUES, k)
    good : ndarray of bool, shape (n,)
        Whether there is a stable orbit in every image.
    """
    for i in range(rows.shape[1]):
        good[i] = True
        p = parameters(rows[0, i])
        reach = reach_of(law, p)
        for j in range(len(amplitudes)):
            values[i, j] = 0.0
            slopes[i, j] = 0.0
            if sides[i, j] == 0:
                continue
            lever, amplitude = levers[j], amplitudes[j]
            c, slope = root_near(law, p, lever, reach, amplitude, sides[i, j], places[i, j])
            if search and not slope < 0.0:
                c, slope = root_anywhere(law, p, lever, reach, amplitude, sides[i, j])
            if not slope < 0.0:
                good[i] = False
                break
            places[i, j] = c
            push, drag, mean = harmonics(law, p, lever, reach, amplitude, c)
            h = mismatch(lever, amplitude, push, drag)
            phase, offset = observed(lever, amplitude, c, push, drag, mean)
            values[i, j, PHASE], values[i, j, OFFSET] = phase, offset
            small = FINE * depth_of(reach, amplitude, c)
            push, drag, mean = harmonics(law, p, lever, reach, amplitude, c + small)
            phase_c, offset_c = observed(lever, amplitude, c + small, push, drag, mean)
            slope = (mismatch(lever, amplitude, push, drag) - h) / small
            for k in range(rows.shape[0] - 1):
                other = parameters(rows[1 + k, i])
                push, drag, mean = harmonics(law, other, lever, reach_of(law, other), amplitude, c)
                along = -(mismatch(lever, amplitude, push, drag) - h) / slope  # of c, for this step of the logarithm
                phase_k, offset_k = observed(lever, amplitude, c, push, drag, mean)
                slopes[i, j, PHASE, k] = (phase_k - phase + (phase_c - phase) * along / small) / step
                slopes[i, j, OFFSET, k] = (offset_k - offset + (offset_c - offset) * along / small) / step
