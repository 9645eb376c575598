"""From where a tip landed to the setpoint, without the way between.

Time tells on which side of its resonance a lever comes to rest that was carried over it. If it is the repulsive one the
setpoint is held there too, as it is where averaging tells the side (`averaged.engage`): an orbit is taken up in time
next to the averaged one. An attractive branch may end on the way, and is followed.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.arrays import copy
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.leap import attraction_defies_averaging
from phasemap._kernels.engagement.rebound import rebounds
from phasemap._kernels.engagement.resonance import (
    REPULSIVE,
    Maximum,
    fill_averaged_orbit_on_side,
    find_mismatch_maximum,
    near_resonance,
)
from phasemap._kernels.engagement.stuck import presses
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever import drive_needed, free_amplitude, reach_of
from phasemap._kernels.orbits.time.period_map import Tolerance, march_tip, rest
from phasemap._kernels.orbits.time.tip import Z0, Tip, amplitude_of, ring_down_periods, swing_state

if TYPE_CHECKING:
    pass

LANDED_SETTLES = 4.0  # ring-down times in which it comes to rest there


@kernel
def repulsive_at(oscillator: Oscillator, amplitude: float, guess: np.ndarray) -> bool:
    """Fill `guess` with the averaged orbit of this amplitude on the repulsive branch, if averaging knows it well."""
    law, p, lever = oscillator
    reach, top = reach_of(law, p), Maximum()
    if not near_resonance(lever) or attraction_defies_averaging(oscillator, free_amplitude(lever)):
        return False
    find_mismatch_maximum(oscillator, reach, amplitude, math.inf, top)
    if not fill_averaged_orbit_on_side(oscillator, reach, amplitude, REPULSIVE, top, guess):
        return False
    return not rebounds(oscillator, guess[col.G_P])


@kernel
def move_to_setpoint(oscillator: Oscillator, amplitude: float, tolerance: Tolerance, tip: Tip) -> bool:
    """Move a tip that landed on a periodic repulsive orbit on to the setpoint; where it cannot, it stays."""
    p, lever = oscillator.p, oscillator.lever
    guess, u, above = np.zeros(col.GUESS), tip.u, amplitude_of(lever, tip.acc) > amplitude
    if not (tip.acc.cos > 0.0 and above) or presses(p, tip) or not repulsive_at(oscillator, amplitude, guess):
        return False
    before = u.copy()
    x, y = drive_needed(lever, amplitude, guess[col.G_P], guess[col.G_S])
    whole = math.hypot(x, y)
    u[Z0], mean = guess[col.G_Z0], guess[col.G_MEAN]
    swing_state(lever, mean, mean + amplitude * x / whole, lever[col.OMEGA] * amplitude * y / whole, u)
    patience = int(LANDED_SETTLES * ring_down_periods(lever))
    if rest(oscillator, tolerance, patience, tip) and tip.acc.cos > 0.0:
        return True
    copy(before, u)
    march_tip(oscillator, tolerance.eta, tip)
    return False
