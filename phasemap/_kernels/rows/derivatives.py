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
from phasemap._kernels.compilation import kernel
from phasemap._kernels.excitation import likely_amplitude, next_amplitude, sees_tip, show
from phasemap._kernels.law import Law, Oscillator, parameters
from phasemap._kernels.lever import reach_of
from phasemap._kernels.orbits.averaged.branch import (
    C_DIFFERENCE,
    ENOUGH_HOLD,
    EXACT_HOLD,
    MOST_ROOT_STEPS,
    detector_signal,
    held_root,
    mismatch_scale,
    stable_root,
)
from phasemap._kernels.orbits.averaged.harmonics import harmonics, put_harmonic_orbit
from phasemap._kernels.orbits.response.orbit import Room, refine

# Columns of what is measured in an image.
MEASURED_PHASE = 0  # [rad]
MEASURED_OFFSET = 1  # tip offset [m]

AMPLITUDE_DIFFERENCE = 1e-5  # of A, for derivatives with respect to it


class Setpoints(NamedTuple):
    """Levers and setpoints of m images of n materials, and where their orbits are."""

    levers: np.ndarray  # as `phasemap._kernels.columns` has them, each in a row
    amplitudes: np.ndarray  # shape (m,); as the detector sees them [m]
    sides: np.ndarray  # int8, shape (n, m); -1 attractive, 1 repulsive, 0 where there is nothing to compare with
    places: np.ndarray  # shape (n, m); c of the orbits: a guess, and what was found


class Found(NamedTuple):
    """Averaged orbits of n materials in m images, and their derivatives with respect to k logarithms."""

    values: np.ndarray  # shape (n, m, 2); phase [rad] and tip offset [m]
    slopes: np.ndarray  # shape (n, m, 2, k)
    good: np.ndarray  # bool, shape (n,); whether there is a stable orbit in every image


@kernel
def averaged_phases(law: Law, rows: np.ndarray, setpoints: Setpoints, search: bool, phases: np.ndarray) -> None:
    """Fill in the averaged phase [rad] of n materials, each under a lever and a setpoint of its own; NaN without orbit.

    `search` is as for `averaged_block`; all arrays of `setpoints` have the length n.
    """
    levers, amplitudes, sides, places = setpoints
    for i in range(len(rows)):
        phases[i] = math.nan
        if sides[i] == 0:
            continue
        p = parameters(rows[i])
        oscillator, reach = Oscillator(law, p, levers[i]), reach_of(law, p)
        amplitude, c, slope = held_root(oscillator, reach, amplitudes[i], sides[i], search, places[i])
        if slope < 0.0:
            places[i] = c
            phases[i] = detector_signal(oscillator, reach, amplitude, c).phase


@kernel
def averaged_block(law: Law, rows: np.ndarray, step: float, setpoints: Setpoints, search: bool, found: Found) -> None:
    """Fill in averaged phase and tip offset of n materials in m images, and their derivatives.

    Parameters
    ----------
    rows : ndarray, shape (1 + k, n, ROW)
        Parameters of the materials, and those with each of k logarithms larger by `step`.
    setpoints : Setpoints
        Its places are moved to the orbits.
    search : bool
        Whether to look at all averaged orbits where the places lead nowhere.
    found : Found
        To be filled.
    """
    levers, amplitudes, sides, places = setpoints
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
            oscillator = Oscillator(law, p, lever)
            amplitude, c, slope = held_root(oscillator, reach, amplitudes[j], sides[i, j], search, places[i, j])
            if not slope < 0.0:
                good[i] = False
                break
            places[i, j] = c
            here = detector_signal(oscillator, reach, amplitude, c)
            values[i, j, MEASURED_PHASE], values[i, j, MEASURED_OFFSET] = here.phase, here.offset
            small, wide = C_DIFFERENCE * mismatch_scale(reach, amplitude, c), AMPLITUDE_DIFFERENCE * amplitude
            there = detector_signal(oscillator, reach, amplitude, c + small)
            h_c, v_c, phase_c, offset_c = (
                (there.mismatch - here.mismatch) / small, (there.amplitude - here.amplitude) / small,
                (there.phase - here.phase) / small, (there.offset - here.offset) / small,
            )  # fmt: skip
            h_a, v_a, phase_a, offset_a = 0.0, 1.0, 0.0, 0.0
            if not sees_tip(lever):
                there = detector_signal(oscillator, reach, amplitude + wide, c)
                h_a, v_a = (there.mismatch - here.mismatch) / wide, (there.amplitude - here.amplitude) / wide
                phase_a, offset_a = (there.phase - here.phase) / wide, (there.offset - here.offset) / wide
            for k in range(rows.shape[0] - 1):
                other = parameters(rows[1 + k, i])
                there = detector_signal(Oscillator(law, other, lever), reach_of(law, other), amplitude, c)
                # By how much c and A change for this step of the logarithm: drive and amplitude seen stay.
                h, v = here.mismatch - there.mismatch, here.amplitude - there.amplitude
                both = h_c * v_a - h_a * v_c
                along, wider = (h * v_a - v * h_a) / both, (v * h_c - h * v_c) / both
                phase, offset = there.phase - here.phase, there.offset - here.offset
                slopes[i, j, MEASURED_PHASE, k] = (phase + phase_c * along + phase_a * wider) / step
                slopes[i, j, MEASURED_OFFSET, k] = (offset + offset_c * along + offset_a * wider) / step


@kernel
def exact_block(
    law: Law, rows: np.ndarray, levers: np.ndarray, amplitudes: np.ndarray, sides: np.ndarray, limits: np.ndarray,
    places: np.ndarray, values: np.ndarray, good: np.ndarray,
) -> None:  # fmt: skip
    """Exact phase and tip offset of n materials in m images, by the lever's response to averaged orbits.

    Parameters
    ----------
    rows : ndarray, shape (n, ROW)
    levers, amplitudes, sides, places
        As for `averaged_block`; places that are NaN are searched for.
    limits : ndarray, shape (2,)
        Largest estimated errors: phase [rad], tip offset [m].
    values : ndarray, shape (n, m, 2)
        NaN where the response does not converge, or the orbit is not sound.
    good : ndarray of bool, shape (n, m)
    """
    room, guess = Room(), np.zeros(col.GUESS)
    for i in range(len(rows)):
        p = parameters(rows[i])
        reach = reach_of(law, p)
        for j in range(len(amplitudes)):
            values[i, j] = np.nan
            good[i, j] = False
            if sides[i, j] == 0:
                continue
            lever, held, before = levers[j], amplitudes[j], (np.nan, np.nan)
            amplitude = likely_amplitude(lever, held, sides[i, j])
            for step in range(MOST_ROOT_STEPS):
                c, slope = stable_root(Oscillator(law, p, lever), reach, amplitude, sides[i, j], True, places[i, j])
                if not slope < 0.0:
                    break
                places[i, j] = c
                push, drag, mean = harmonics(Oscillator(law, p, lever), reach, amplitude, c)
                put_harmonic_orbit(guess, amplitude, c, push, drag, mean)
                guess[col.G_SLOPE] = slope / amplitude
                if not refine(Oscillator(law, p, lever), reach, guess, limits, room):
                    break
                seen, phase = show(lever, amplitude, room.state.phase)
                miss = seen - held
                if abs(miss) <= (EXACT_HOLD if step < MOST_ROOT_STEPS - 1 else ENOUGH_HOLD) * held:
                    values[i, j, MEASURED_PHASE], values[i, j, MEASURED_OFFSET] = phase, room.state.tip_offset
                    good[i, j] = True
                    break
                following = next_amplitude(lever, held, amplitude, room.state.phase, miss, before)
                before, amplitude = (amplitude, miss), following
                if not amplitude > 0.0:
                    break
