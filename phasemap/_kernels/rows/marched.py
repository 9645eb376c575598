"""Loop over pixels for the march."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.goal import Goal
from phasemap._kernels.engagement.holding_in_time import hold_from_row, hold_over_remembering_surface
from phasemap._kernels.engagement.in_time import engage_by_march, engage_with_second_drive
from phasemap._kernels.orbits.averaged.sides import Maximum
from phasemap._kernels.orbits.harmonic_orbit import HarmonicOrbit
from phasemap._kernels.rows.answers import Pixels, oscillator_of


@kernel
def march_rows(pixels: Pixels, step_size: float, most_periods: int, out: np.ndarray, status: np.ndarray) -> None:
    """Motion that holds each amplitude in time, started near the orbit in `out`, for at most so many periods.

    Where the status is not GOOD, no orbit is known to start from, and the tip is engaged from far.
    """
    for i in range(len(out)):
        oscillator, goal = oscillator_of(pixels, i), Goal(pixels.amplitudes[i], step_size, most_periods)
        if status[i] == col.GOOD:
            status[i] = hold_from_row(oscillator, goal, out[i])
        else:
            status[i] = engage_by_march(oscillator, goal, out[i])
        if status[i] != col.GOOD:
            out[i] = math.nan


@kernel
def second_drive_rows(pixels: Pixels, step_size: float, most_periods: int, out: np.ndarray, status: np.ndarray) -> None:
    """Motion that holds each amplitude in time while a second mode is driven too, engaged from far."""
    for i in range(len(out)):
        goal = Goal(pixels.amplitudes[i], step_size, most_periods)
        status[i] = engage_with_second_drive(oscillator_of(pixels, i), goal, out[i])
        if status[i] != col.GOOD:
            out[i] = math.nan


@kernel
def remembering_rows(pixels: Pixels, step_size: float, most_periods: int, out: np.ndarray, status: np.ndarray) -> None:
    """Motion over surfaces that remember, as `hold_over_remembering_surface` finds it."""
    harmonic, top = HarmonicOrbit(), Maximum()
    for i in range(len(out)):
        goal = Goal(pixels.amplitudes[i], step_size, most_periods)
        status[i] = hold_over_remembering_surface(oscillator_of(pixels, i), goal, top, harmonic, out[i])
