"""Averaged orbits on a branch that is known, with their derivatives with respect to the material.

At a given amplitude the averaged orbit is a root c of one equation, the mismatch of the drive (`orbits.averaged`), so
that by the implicit function theorem phase and tip offset change with a parameter at fixed c, and by what c changes:
theory, Eq. (inversion-1).
Where the detector sees the deflection, that holds at a given A; what A is follows from the amplitude that is seen.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.columns import SHAKER
from phasemap._kernels.compilation import kernel
from phasemap._kernels.excitation import likely_amplitude, next_amplitude, show
from phasemap._kernels.law import Law, Oscillator, parameters
from phasemap._kernels.lever import mismatch, phase_of, reach_of
from phasemap._kernels.orbits.averaged.harmonics import harmonics
from phasemap._kernels.orbits.averaged.orbits import averaged_orbits

PHASE, OFFSET, VALUES = 0, 1, 2  # what is measured: phase [rad], tip offset [m]
MOST_STEPS = 14
HELD, WELL = 1e-12, 1e-8  # of the amplitude that is held: as near is exact, and as near is enough in the end
APART = 1e-5  # of A, for derivatives with respect to it
FINE = 1e-4  # of the depth, for derivatives with respect to c
CLOSE = 1e-5  # of the depth: Newton's last step, whose square is what is left
LONGEST = 0.6  # of the depth, of a step


class Look(NamedTuple):
    """Mismatch of a harmonic orbit, amplitude [m] and phase [rad] that the detector sees, and tip offset [m]."""

    mismatch: float
    amplitude: float
    phase: float
    offset: float


class Found(NamedTuple):
    """Averaged orbits of n materials in m images, and their derivatives with respect to k logarithms."""

    values: np.ndarray  # shape (n, m, VALUES); phase [rad] and tip offset [m]
    slopes: np.ndarray  # shape (n, m, VALUES, k)
    good: np.ndarray  # bool, shape (n,); whether there is a stable orbit in every image


@kernel
def depth_of(reach: float, amplitude: float, c: float) -> float:
    """Scale on which the mismatch changes with c."""
    return reach / amplitude + abs(c - 1.0) + 1e-9


@kernel
def observed(
    lever: np.ndarray, amplitude: float, c: float, push: float, drag: float, mean: float
) -> tuple[float, float]:
    """Phase [rad] and tip offset [m]."""
    return phase_of(lever, amplitude, push, drag), amplitude * c + mean


@kernel
def root_near(oscillator: Oscillator, reach: float, amplitude: float, side: int, c: float) -> tuple[float, float]:
    """The root c near a guess, and dh/dc there; NaN if Newton's method leaves this branch or its stable part."""
    lever = oscillator.lever
    slope = math.nan
    for _ in range(MOST_STEPS):
        depth = depth_of(reach, amplitude, c)
        push, drag, _mean = harmonics(oscillator, reach, amplitude, c)
        h = mismatch(lever, amplitude, push, drag)
        near, far, _mean = harmonics(oscillator, reach, amplitude, c + FINE * depth)
        slope = (mismatch(lever, amplitude, near, far) - h) / (FINE * depth)
        if not slope < 0.0:
            return math.nan, math.nan
        step = min(max(-h / slope, -LONGEST * depth), LONGEST * depth)
        c += step
        if abs(step) < CLOSE * depth:
            return (c, slope) if (push > 0.0) == (side > 0) else (math.nan, math.nan)
    return math.nan, math.nan


@kernel
def root_anywhere(oscillator: Oscillator, reach: float, amplitude: float, side: int) -> tuple[float, float]:
    """The farthest stable root on this branch, and dh/dc there; NaN if there is none."""
    candidates = averaged_orbits(oscillator, amplitude)
    for i in range(len(candidates)):
        if (candidates[i, col.G_P] > 0.0) == (side > 0):
            c, slope = root_near(
                oscillator, reach, amplitude, side, (candidates[i, col.G_Z0] - candidates[i, col.G_MEAN]) / amplitude
            )
            if slope < 0.0:
                return c, slope
    return math.nan, math.nan


@kernel
def root_of(
    oscillator: Oscillator, reach: float, amplitude: float, side: int, search: bool, c: float
) -> tuple[float, float]:
    """The root c near a guess, or with `search` anywhere, and dh/dc there; NaN if there is none."""
    root, slope = root_near(oscillator, reach, amplitude, side, c)
    if search and not slope < 0.0:
        root, slope = root_anywhere(oscillator, reach, amplitude, side)
    return root, slope


@kernel
def look(oscillator: Oscillator, reach: float, amplitude: float, c: float) -> Look:
    """A harmonic orbit as it is seen."""
    lever = oscillator.lever
    push, drag, mean = harmonics(oscillator, reach, amplitude, c)
    phase, offset = observed(lever, amplitude, c, push, drag, mean)
    seen, turned = show(lever, amplitude, phase)
    return Look(mismatch(lever, amplitude, push, drag), seen, turned, offset)


@kernel
def held_root(
    oscillator: Oscillator, reach: float, held: float, side: int, search: bool, c: float
) -> tuple[float, float, float]:
    """A [m] of the averaged orbit near c that is seen with the amplitude held, its c, and dh/dc; NaN without one."""
    lever = oscillator.lever
    amplitude, before = likely_amplitude(lever, held, side), (math.nan, math.nan)
    for step in range(MOST_STEPS):
        c, slope = root_of(oscillator, reach, amplitude, side, search, c)
        if not slope < 0.0 or lever[SHAKER] == 0.0:
            return amplitude, c, slope
        push, drag, mean = harmonics(oscillator, reach, amplitude, c)
        phase, _ = observed(lever, amplitude, c, push, drag, mean)
        miss = show(lever, amplitude, phase)[0] - held
        if abs(miss) < (HELD if step < MOST_STEPS - 1 else WELL) * held:
            return amplitude, c, slope
        following = next_amplitude(lever, held, amplitude, phase, miss, before)
        before, amplitude = (amplitude, miss), following
        if not amplitude > 0.0:
            break
    return amplitude, math.nan, math.nan


@kernel
def averaged_phases(
    law: Law, rows: np.ndarray, levers: np.ndarray, amplitudes: np.ndarray, sides: np.ndarray, search: bool,
    places: np.ndarray, phases: np.ndarray,
) -> None:  # fmt: skip
    """Averaged phase [rad] of n materials, each under a lever and a setpoint of its own; NaN without an orbit.

    The other arguments are as for `averaged_block`; all have the length n.
    """
    for i in range(len(rows)):
        phases[i] = math.nan
        if sides[i] == 0:
            continue
        p = parameters(rows[i])
        reach, lever = reach_of(law, p), levers[i]
        amplitude, c, slope = held_root(Oscillator(law, p, lever), reach, amplitudes[i], sides[i], search, places[i])
        if slope < 0.0:
            places[i] = c
            phases[i] = look(Oscillator(law, p, lever), reach, amplitude, c).phase


@kernel
def averaged_block(
    law: Law, rows: np.ndarray, step: float, levers: np.ndarray, amplitudes: np.ndarray, sides: np.ndarray,
    search: bool, places: np.ndarray, found: Found,
) -> None:  # fmt: skip
    """Averaged phase and tip offset of n materials in m images, and their derivatives.

    Parameters
    ----------
    rows : ndarray, shape (1 + k, n, ROW)
        Parameters of the materials, and those with each of k logarithms larger by `step`.
    levers : ndarray, shape (m, 4)
    amplitudes : ndarray, shape (m,)
        Setpoints, as the detector sees them [m].
    sides : ndarray of int8, shape (n, m)
        -1 attractive, 1 repulsive, 0 where there is nothing to compare with.
    search : bool
        Whether to look at all averaged orbits where `places` lead nowhere.
    places : ndarray, shape (n, m)
        c of the orbits: a guess, and what was found.
    found : Found
        To be filled.
    """
    values, slopes, good = found
    for i in range(rows.shape[1]):
        good[i] = True
        p = parameters(rows[0, i])
        reach = reach_of(law, p)
        for j in range(len(amplitudes)):
            values[i, j] = 0.0
            slopes[i, j] = 0.0
            if sides[i, j] == 0:
                continue
            lever = levers[j]
            amplitude, c, slope = held_root(
                Oscillator(law, p, lever), reach, amplitudes[j], sides[i, j], search, places[i, j]
            )
            if not slope < 0.0:
                good[i] = False
                break
            places[i, j] = c
            here = look(Oscillator(law, p, lever), reach, amplitude, c)
            values[i, j, PHASE], values[i, j, OFFSET] = here.phase, here.offset
            small, wide = FINE * depth_of(reach, amplitude, c), APART * amplitude
            there = look(Oscillator(law, p, lever), reach, amplitude, c + small)
            h_c, v_c, phase_c, offset_c = (
                (there.mismatch - here.mismatch) / small, (there.amplitude - here.amplitude) / small,
                (there.phase - here.phase) / small, (there.offset - here.offset) / small,
            )  # fmt: skip
            h_a, v_a, phase_a, offset_a = 0.0, 1.0, 0.0, 0.0
            if lever[SHAKER] != 0.0:
                there = look(Oscillator(law, p, lever), reach, amplitude + wide, c)
                h_a, v_a = (there.mismatch - here.mismatch) / wide, (there.amplitude - here.amplitude) / wide
                phase_a, offset_a = (there.phase - here.phase) / wide, (there.offset - here.offset) / wide
            for k in range(rows.shape[0] - 1):
                other = parameters(rows[1 + k, i])
                there = look(Oscillator(law, other, lever), reach_of(law, other), amplitude, c)
                # By how much c and A change for this step of the logarithm: drive and amplitude seen stay.
                h, v = here.mismatch - there.mismatch, here.amplitude - there.amplitude
                both = h_c * v_a - h_a * v_c
                along, wider = (h * v_a - v * h_a) / both, (v * h_c - h * v_c) / both
                phase, offset = there.phase - here.phase, there.offset - here.offset
                slopes[i, j, PHASE, k] = (phase + phase_c * along + phase_a * wider) / step
                slopes[i, j, OFFSET, k] = (offset + offset_c * along + offset_a * wider) / step
