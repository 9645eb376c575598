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

from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, Oscillator, parameters
from phasemap._kernels.lever import reach_of
from phasemap._kernels.orbits.averaged.branch import (
    detector_signal,
    fill_signal_and_slopes,
    held_root,
)
from phasemap._kernels.orbits.response.branch import orbit_at_seen
from phasemap._kernels.orbits.response.orbit import Room


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
            oscillator = Oscillator(law, p, levers[j])
            amplitude, c, slope = held_root(oscillator, reach, amplitudes[j], sides[i, j], search, places[i, j])
            if not slope < 0.0:
                good[i] = False
                break
            places[i, j] = c
            fill_signal_and_slopes(oscillator, (amplitude, c), rows, i, step, values[i, j], slopes[i, j])


@kernel
def exact_block(
    law: Law, rows: np.ndarray, setpoints: Setpoints, limits: np.ndarray, values: np.ndarray, good: np.ndarray
) -> None:
    """Exact phase and tip offset of n materials in m images, by the lever's response to averaged orbits.

    Parameters
    ----------
    rows : ndarray, shape (n, ROW)
    setpoints : Setpoints
        Places that are NaN are searched for.
    limits : ndarray, shape (2,)
        Largest estimated errors: phase [rad], tip offset [m].
    values : ndarray, shape (n, m, 2)
        NaN where the response does not converge, or the orbit is not sound.
    good : ndarray of bool, shape (n, m)
    """
    (levers, amplitudes, sides, places), room = setpoints, Room()
    for i in range(len(rows)):
        p = parameters(rows[i])
        for j in range(len(amplitudes)):
            values[i, j] = np.nan
            good[i, j] = False
            if sides[i, j] == 0:
                continue
            good[i, j] = orbit_at_seen(
                Oscillator(law, p, levers[j]), amplitudes[j], sides[i, j], places[i, j], limits, room, values[i, j]
            )
