"""Dents that last, formed under a tip that taps at its amplitude.

They may become deeper than the taps that form them, and take ten times as long as they last until they change no more.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator
from phasemap._kernels.orbits.time.by_memory import lingering
from phasemap._kernels.orbits.time.linear_map import fill_way_to_rest, length_of
from phasemap._kernels.orbits.time.period_map import Tolerance, fill_change, linearise_period, pass_from
from phasemap._kernels.orbits.time.tip import Z0, Change, Tip, Way, copy_memory, move_state

FORMING_TIME = 18.0  # times as long as they last, in which dents of an amplitude come to rest, to 1e-8 of it
FORMING_WAY = 0.05  # of the amplitude, a way for which derivatives serve
FORMING_STEP = 0.1  # of the amplitude: a longer step leads elsewhere


@kernel
def form_dents(oscillator: Oscillator, tolerance: Tolerance, target: float, most_periods: int, tip: Tip) -> bool:
    """Let time pass at the amplitude `target` until dents are at rest; False if it may take more than so many periods.

    The tip goes on ahead as the map of one period says, whose derivatives are taken anew now and then.
    """
    lever = oscillator.lever
    step_size, y_limit, z0_limit = tolerance
    u, linear, y, share = tip.u, tip.linear, np.empty(len(tip.u)), lingering(oscillator)
    now, ahead = Change(), Way()
    if share == 0 or FORMING_TIME > -math.log(share) * most_periods:
        return False
    tip.periods.formed = 1
    way = math.inf
    while tip.periods.marched < most_periods:
        if way > FORMING_WAY * target:
            if not linearise_period(oscillator, step_size, tip):
                return False
            fill_way_to_rest(linear, linear.now, target, ahead)
            way = 0.0
        step = length_of(ahead) + abs(ahead.z0)
        if not step < math.inf:
            return False
        part = min(FORMING_STEP * target / step, 1.0)
        way += part * step
        move_state(lever, ahead, part, u)
        if not pass_from(oscillator, step_size, tip, u, u[Z0], y):
            return False
        copy_memory(y, u)
        fill_change(lever, u, y, tip.acc, now)
        fill_way_to_rest(linear, now, target, ahead)
        if max(length_of(ahead) / y_limit, abs(ahead.z0) / z0_limit) <= 1 - share * share:
            return True
    return False
