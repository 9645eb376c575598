"""Averaged orbits on a branch that is known, with their derivatives by the material, and the exact ones beside them.

At a given amplitude the averaged orbit is a root c of one equation, the mismatch of the drive (`orbits.averaged`), so
that by the implicit function theorem phase and tip offset change with a parameter at fixed c, and by what c changes:
theory, Eq. (inversion-1).
Where the detector sees the deflection, that holds at a given A; what A is follows from the amplitude that is seen.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels.columns import ErrorLimits
from phasemap._kernels.compilation import kernel
from phasemap._kernels.excitation import detected_signal, sees_tip
from phasemap._kernels.law import Law, Oscillator, parameters
from phasemap._kernels.orbits.averaged.branch import (
    MEASURED_OFFSET,
    MEASURED_PHASE,
    detector_signal_of_harmonic_orbit,
    fill_held_averaged_orbit,
    fill_signal_and_slopes,
    held_root,
)
from phasemap._kernels.orbits.harmonic_orbit import HarmonicOrbit
from phasemap._kernels.orbits.response.orbit_at_setpoint import ResponseWorkspace, exact_orbit_at_amplitude


class Setpoints(NamedTuple):
    """Levers and setpoints of m images of n materials, and where their orbits are."""

    levers: np.ndarray  # as `phasemap._kernels.columns` has them, each in a row
    amplitudes: np.ndarray  # shape (m,); as the detector sees them [m]
    sides: np.ndarray  # int8, shape (n, m); -1 attractive, 1 repulsive, 0 where there is nothing to compare with
    # shape (n, m): c of averaged orbits, a guess, and what was found; (n, m, PLACE) of exact ones, as
    # `store_collocation_orbit` leaves them
    places: np.ndarray


class Derivatives(NamedTuple):
    """Orbits of n materials in m images, and their derivatives with respect to k logarithms."""

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
        oscillator = Oscillator(law, p, levers[i])
        amplitude, c, slope = held_root(oscillator, amplitudes[i], sides[i], search, (math.nan, places[i]))
        if slope < 0.0:
            places[i] = c
            phases[i] = detector_signal_of_harmonic_orbit(oscillator, amplitude, c).phase


@kernel
def averaged_block(
    law: Law, rows: np.ndarray, step: float, setpoints: Setpoints, search: bool, found: Derivatives
) -> None:
    """Fill in averaged phase and tip offset of n materials in m images, and their derivatives.

    `rows` (shape (1 + k, n, ROW)): parameters of the materials, and those with each of k logarithms larger by `step`.
    The places of the setpoints are moved to the orbits; with `search` all averaged orbits are tried where they lead
    nowhere.
    """
    levers, amplitudes, sides, places = setpoints
    values, slopes, good = found
    for i in range(rows.shape[1]):
        good[i] = True
        p = parameters(rows[0, i])
        for j in range(len(amplitudes)):
            values[i, j] = 0.0
            slopes[i, j] = 0.0
            if sides[i, j] == 0:
                continue
            oscillator = Oscillator(law, p, levers[j])
            amplitude, c, slope = held_root(oscillator, amplitudes[j], sides[i, j], search, (math.nan, places[i, j]))
            if not slope < 0.0:
                good[i] = False
                break
            places[i, j] = c
            fill_signal_and_slopes(oscillator, (amplitude, c), rows, i, step, values[i, j], slopes[i, j])


@kernel
def response_block(
    law: Law, rows: np.ndarray, setpoints: Setpoints, limits: ErrorLimits, values: np.ndarray, good: np.ndarray
) -> None:
    """Fill in exact phase and tip offset of n materials in m images, by passes from averaged orbits.

    Places of the setpoints that are NaN are searched for. `values` (shape (n, m, 2)) is NaN, and `good` (shape (n, m))
    False, where passes do not converge, or the orbit is not sound.
    """
    levers, amplitudes, sides, places = setpoints
    workspace, harmonic = ResponseWorkspace(), HarmonicOrbit()
    state = workspace.state
    for i in range(len(rows)):
        p = parameters(rows[i])
        for j in range(len(amplitudes)):
            values[i, j] = np.nan
            good[i, j] = False
            if sides[i, j] == 0:
                continue
            oscillator, near = Oscillator(law, p, levers[j]), (math.nan, places[i, j])
            if not fill_held_averaged_orbit(oscillator, amplitudes[j], sides[i, j], near, harmonic):
                continue
            workspace.seen = 0.0 if sees_tip(levers[j]) else amplitudes[j]
            good[i, j] = exact_orbit_at_amplitude(oscillator, harmonic, limits, workspace)
            if good[i, j]:
                values[i, j, MEASURED_PHASE] = detected_signal(levers[j], state.amplitude, state.phase)[1]
                values[i, j, MEASURED_OFFSET] = state.tip_offset
