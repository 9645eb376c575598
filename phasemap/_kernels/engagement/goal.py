"""Goal of a motion in time: the amplitude to hold, and the steps and errors of the march."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import has_hysteresis
from phasemap._kernels.orbits.time.period_map import Tolerance

COARSER_STEPS = 2.0  # on the way to the setpoint, over those of a periodic orbit
WIDER_ERRORS = 100.0  # the same of the errors allowed
STATE_ERROR = math.radians(1e-5)  # of a periodic orbit in (z, z'), of its amplitude
OFFSET_ERROR = 1e-14  # of a periodic orbit [m]
# Steps of a periodic orbit through a neck, over others; of order 8, this makes the error 60 times smaller
NECK_STEPS = 0.6


class Goal(NamedTuple):
    """Amplitude that a tip is to hold in time, and the effort allowed."""

    amplitude: float  # [m]; 0 where the tip offset is left alone
    step_size: float  # of a periodic orbit, as for `march_oscillator`
    most_periods: int  # marched in all


@kernel
def fine_tolerance(p: np.ndarray, goal: Goal) -> Tolerance:
    """Steps and errors of a periodic orbit that holds the amplitude: smaller steps in a neck, of the same error."""
    size = goal.step_size if not has_hysteresis(p) else NECK_STEPS * goal.step_size
    return Tolerance(size, STATE_ERROR * goal.amplitude, OFFSET_ERROR)


@kernel
def coarse_tolerance(goal: Goal) -> Tolerance:
    """Steps and errors on the way to the amplitude."""
    size, state_error = COARSER_STEPS * goal.step_size, WIDER_ERRORS * STATE_ERROR * goal.amplitude
    return Tolerance(size, state_error, WIDER_ERRORS * OFFSET_ERROR)
