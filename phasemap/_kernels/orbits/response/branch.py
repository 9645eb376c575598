"""The exact orbit beside an averaged one on a branch that is known, at what the detector sees."""

from __future__ import annotations

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.excitation import likely_amplitude, next_amplitude, show
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever import reach_of
from phasemap._kernels.orbits.averaged.branch import (
    ENOUGH_HOLD,
    EXACT_HOLD,
    MEASURED_OFFSET,
    MEASURED_PHASE,
    MOST_ROOT_STEPS,
    stable_root,
)
from phasemap._kernels.orbits.averaged.harmonics import harmonics, put_harmonic_orbit
from phasemap._kernels.orbits.response.orbit import Room, refine


@kernel
def orbit_at_seen(
    oscillator: Oscillator, held: float, side: int, c: float, limits: np.ndarray, room: Room, values: np.ndarray
) -> bool:
    """Orbit that is seen with the amplitude held [m]: its phase and tip offset; False where the response finds none.

    `c`: of the averaged orbit near by, NaN where that is to be searched for.
    """
    lever, guess, before = oscillator.lever, np.zeros(col.GUESS), (np.nan, np.nan)
    amplitude, reach = likely_amplitude(lever, held, side), reach_of(oscillator.law, oscillator.p)
    for step in range(MOST_ROOT_STEPS):
        c, slope = stable_root(oscillator, reach, amplitude, side, True, c)
        if not slope < 0.0:
            return False
        push, drag, mean = harmonics(oscillator, reach, amplitude, c)
        put_harmonic_orbit(guess, amplitude, c, push, drag, mean)
        guess[col.G_SLOPE] = slope / amplitude
        if not refine(oscillator, reach, guess, limits, room):
            return False
        seen, phase = show(lever, amplitude, room.state.phase)
        miss = seen - held
        if abs(miss) <= (EXACT_HOLD if step < MOST_ROOT_STEPS - 1 else ENOUGH_HOLD) * held:
            values[MEASURED_PHASE], values[MEASURED_OFFSET] = phase, room.state.tip_offset
            return True
        following = next_amplitude(lever, held, amplitude, room.state.phase, miss, before)
        before, amplitude = (amplitude, miss), following
        if not amplitude > 0.0:
            return False
    return False
