"""Loop over pixels for the march."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.averaged import SURE, engage_by_averaging
from phasemap._kernels.engagement.holding import settle, settle_dents, settle_near
from phasemap._kernels.engagement.in_time import approach_by_march
from phasemap._kernels.engagement.rebound import rebounds
from phasemap._kernels.law import Law, Oscillator, parameters
from phasemap._kernels.lever import free_amplitude, near_resonance, reach_of, scale_of
from phasemap._kernels.orbits.averaged.orbits import far_start
from phasemap._kernels.orbits.averaged.row import averaged_row
from phasemap._kernels.orbits.averaged.sides import REPULSIVE, Maximum, fill_averaged_orbit_on_side
from phasemap._kernels.orbits.time.tip import ring_down_periods
from phasemap._kernels.records import clear

SECOND_TRY = 0.7  # steps of a second try: a derivative by differences is off where one of two periods has a step more
NEAR_TIMES = 5.0  # ring-down times in which a tip comes to rest that starts next to its orbit
NEAR_PERIODS = 40  # and at least so many periods


@kernel
def march_rows(
    law: Law,
    rows: np.ndarray,
    lever: np.ndarray,
    amplitudes: np.ndarray,
    eta: float,
    most: int,
    out: np.ndarray,
    status: np.ndarray,
) -> None:
    """Motion that holds each amplitude in time, started near the orbit in `out`, for at most so many periods.

    Where the status is not GOOD, no orbit is known to start from, and the tip is engaged from far.
    """
    free = free_amplitude(lever)
    for i in range(len(rows)):
        p, amplitude = parameters(rows[i]), amplitudes[i]
        if status[i] == col.GOOD:
            status[i] = settle(Oscillator(law, p, lever), amplitude, eta, most, out[i])
        else:
            far = free * far_start(Oscillator(law, p, lever), reach_of(law, p), free, amplitude)
            step = 0.1 * scale_of(Oscillator(law, p, lever), free) + 1e-3 * free
            status[i] = approach_by_march(Oscillator(law, p, lever), amplitude, far, step, eta, most, out[i])
        if status[i] != col.GOOD:
            out[i] = math.nan


@kernel
def has_one_orbit(p: np.ndarray, lever: np.ndarray) -> bool:
    """Where nothing attracts a tip driven at the resonance or below, its amplitude falls all the way, from any orbit.

    Repulsion moves the resonance up and away from such a drive; one above the resonance it would bring nearer.
    """
    attracted = p[col.PULL] != 0.0 or p[col.LONGRANGE] != 0.0 or p[col.BIAS] != 0.0
    return not attracted and near_resonance(lever) and lever[col.OMEGA] <= 1.0


@kernel
def only_orbit(oscillator: Oscillator, amplitude: float, top: Maximum, guess: np.ndarray) -> bool:
    """Fill `guess` with the averaged one of that orbit; False where there is none that stands."""
    clear(top)
    top.behind = -1e-3 * amplitude
    known = fill_averaged_orbit_on_side(oscillator, 0.0, amplitude, REPULSIVE, top, guess)
    return known and not rebounds(oscillator, guess[col.G_P])


@kernel
def remembering_rows(
    law: Law,
    rows: np.ndarray,
    lever: np.ndarray,
    amplitudes: np.ndarray,
    eta: float,
    most: int,
    out: np.ndarray,
    status: np.ndarray,
) -> None:
    """Motion over surfaces that remember, started from the averaged orbit; PENDING where averaging is not sure of it.

    Dents that last do not matter to that: the side of the resonance is decided before the tip has tapped.
    """
    guess, top = np.zeros(col.GUESS), Maximum()
    near = min(most, int(NEAR_TIMES * ring_down_periods(lever)) + NEAR_PERIODS)
    for i in range(len(rows)):
        p, amplitude = parameters(rows[i]), amplitudes[i]
        status[i] = col.PENDING
        if has_one_orbit(p, lever):
            if only_orbit(Oscillator(law, p, lever), amplitude, top, guess):
                averaged_row(lever, guess, out[i])
                status[i] = settle(Oscillator(law, p, lever), amplitude, eta, most, out[i])
            continue
        if engage_by_averaging(Oscillator(law, p, lever), amplitude, guess, top) == SURE:
            for finer in (1.0, SECOND_TRY):
                averaged_row(lever, guess, out[i])
                if settle_near(Oscillator(law, p, lever), amplitude, finer * eta, near, out[i]):
                    status[i] = col.GOOD
                    break
            else:
                averaged_row(lever, guess, out[i])
                if settle_dents(Oscillator(law, p, lever), amplitude, eta, most, out[i]):
                    status[i] = col.GOOD
