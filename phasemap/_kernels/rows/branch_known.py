"""Exact orbits next to averaged ones on a branch that is known."""

from __future__ import annotations

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.excitation import likely_amplitude, next_amplitude, show
from phasemap._kernels.law import Law, Oscillator, parameters
from phasemap._kernels.lever import reach_of
from phasemap._kernels.orbits.averaged.harmonics import harmonics, put_harmonic_orbit
from phasemap._kernels.orbits.response.orbit import Room, refine
from phasemap._kernels.rows.derivatives import (
    ENOUGH_HOLD,
    EXACT_HOLD,
    MEASURED_OFFSET,
    MEASURED_PHASE,
    MOST_ROOT_STEPS,
    stable_root,
)


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
