"""Dents that last, formed under a tip that taps at its amplitude.

They may become deeper than the taps that form them, and take ten times as long as they last until they change no more.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator
from phasemap._kernels.orbits.time.by_memory import lingering
from phasemap._kernels.orbits.time.period_map import Tolerance, linearise_period, pass_from, way_to_rest
from phasemap._kernels.orbits.time.tip import Z0, Tip, V, Z, amplitude_of, copy_memory

if TYPE_CHECKING:
    pass

FORMING_TIME = 18.0  # times as long as they last, in which dents of an amplitude come to rest, to 1e-8 of it
FORMING_WAY = 0.05  # of the amplitude, a way for which derivatives serve
FORMING_STEP = 0.3  # of the amplitude: a longer step leads elsewhere


@kernel
def form_dents(oscillator: Oscillator, tolerance: Tolerance, target: float, most: int, tip: Tip) -> bool:
    """Let time pass at the amplitude `target` until dents are at rest; False if that may take more than `most` periods.

    The tip goes on ahead as the map of one period says, whose derivatives are taken anew now and then.
    """
    lever = oscillator.lever
    eta, y_limit, z0_limit = tolerance
    u, linear, y, share = tip.u, tip.linear, np.empty(len(tip.u)), lingering(oscillator)
    if share == 0 or FORMING_TIME > -math.log(share) * most:
        return False
    tip.periods.formed = 1
    way = math.inf
    z = v = move = 0.0
    while tip.periods.marched < most:
        if way > FORMING_WAY * target:
            if not linearise_period(oscillator, eta, tip):
                return False
            z, v, move = way_to_rest(linear, linear.now.z, linear.now.v, linear.now.amplitude - target, True)
            way = 0.0
        step = math.hypot(z, v) + abs(move)
        if not step < FORMING_STEP * target:
            return False
        way += step
        u[Z], u[V], u[Z0] = u[Z] + z, u[V] + v, u[Z0] + move
        if not pass_from(oscillator, eta, tip, u[Z], u[V], u[Z0], y):
            return False
        copy_memory(y, u)
        z, v, move = way_to_rest(linear, y[Z] - u[Z], y[V] - u[V], amplitude_of(lever, tip.acc) - target, True)
        if max(math.hypot(z, v) / y_limit, abs(move) / z0_limit) <= 1 - share * share:
            return True
    return False
