"""Holding an amplitude in time: by a periodic orbit if there is one, else in the mean (`holding_mean`)."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.by_averaging import BY_AVERAGING, engage_by_averaging
from phasemap._kernels.engagement.goal import Goal, fine_tolerance
from phasemap._kernels.engagement.holding_mean import EAGER_GAIN, hold_mean
from phasemap._kernels.law import Law, Oscillator, has_longrange
from phasemap._kernels.numerics import copy
from phasemap._kernels.orbits.averaged.sides import Maximum
from phasemap._kernels.orbits.harmonic_orbit import HarmonicOrbit, fill_row_from_harmonic
from phasemap._kernels.orbits.time.arms import dent_survival
from phasemap._kernels.orbits.time.contact import OFF_SURFACE
from phasemap._kernels.orbits.time.many_periods import form_dents
from phasemap._kernels.orbits.time.period_map import hold_periodic
from phasemap._kernels.orbits.time.surface_memory import CONTACT_MODE
from phasemap._kernels.orbits.time.tip import MovingTip, PeriodMap, PeriodResult, Periods, new_state, ring_down_periods

SECOND_TRY = 0.7  # steps of a second try: a derivative by differences is off where one of two periods has a step more
NEAR_TIMES = 5.0  # ring-down times in which a tip comes to rest that starts next to its orbit
NEAR_PERIODS = 40  # and at least so many periods


@kernel
def hold_in_time(oscillator: Oscillator, goal: Goal, tip: MovingTip, row: np.ndarray) -> int:
    """Hold an amplitude, by a periodic orbit if there is one here, else by what a lock-in shows; fill a result row.

    A tip that engages counts periods from the phase at which it was highest as it swung freely. Where such a period
    begins inside a contact with memory, which is known only nearly, the orbit is sought again from its highest point.
    """
    law, p = oscillator.law, oscillator.p
    tolerance = fine_tolerance(p, goal)
    status = hold_periodic(oscillator, tolerance, goal.amplitude, goal.most_periods, tip, row)
    if status == col.GOOD and law.memory != 0 and tip.u[CONTACT_MODE] != OFF_SURFACE and dent_survival(oscillator) == 0:
        again = row.copy()
        if hold_orbit_near_row(oscillator, goal, False, again):
            copy(again, row)
    if status != col.NOT_SETTLED:
        return status
    return hold_mean(oscillator, goal, EAGER_GAIN, tip, row)


@kernel
def hold_from_row(oscillator: Oscillator, goal: Goal, row: np.ndarray) -> int:
    """Hold an amplitude [m] in time, starting from the orbit in the result row, which is filled anew.

    The motion found is one that time leads to: stable, and held by a feedback that raises the lever when A falls short.
    """
    law, lever = oscillator.law, oscillator.lever
    tip = MovingTip(state_on(law, lever, row[col.AMPLITUDE], row), PeriodResult(), PeriodMap(), Periods())
    row[:] = math.nan
    return hold_in_time(oscillator, goal, tip, row)


@kernel
def hold_orbit_near_row(oscillator: Oscillator, goal: Goal, forms: bool, row: np.ndarray) -> bool:
    """Hold an amplitude [m] by the periodic orbit to which time leads from that in `row`, which is filled anew.

    With `forms` dents that last form under the tip first. False where time leads to no such orbit within the periods
    allowed, or to one on the other branch.
    """
    law, p, lever = oscillator
    tip = MovingTip(state_on(law, lever, goal.amplitude, row), PeriodResult(), PeriodMap(), Periods())
    repelled, tolerance = row[col.STIFFENING] > 0.0, fine_tolerance(p, goal)
    if forms and not form_dents(oscillator, tolerance, goal.amplitude, goal.most_periods, tip):
        return False
    status = hold_periodic(oscillator, tolerance, goal.amplitude, goal.most_periods, tip, row)
    return status == col.GOOD and (row[col.STIFFENING] > 0.0) == repelled


@kernel
def hold_over_remembering_surface(
    oscillator: Oscillator, goal: Goal, top: Maximum, harmonic: HarmonicOrbit, row: np.ndarray
) -> int:
    """Motion over a surface that remembers, started from the averaged orbit; PENDING where averaging is not sure of it.

    Dents that last do not matter to averaging: the side of the resonance is decided before the tip has tapped. Where
    nothing attracts and the drive is not above the resonance, repulsion moves that away from the drive: only one orbit
    holds the amplitude, so that any motion in time is the answer. Elsewhere it has to be an orbit on the averaged
    one's side, which three tries look for.
    """
    p, lever = oscillator.p, oscillator.lever
    if engage_by_averaging(oscillator, goal.amplitude, harmonic, top) != BY_AVERAGING:
        return col.PENDING
    attracted = p[col.PULL] != 0.0 or has_longrange(p) or p[col.BIAS] != 0.0
    if not attracted and lever[col.OMEGA] <= 1.0:
        fill_row_from_harmonic(lever, harmonic, row)
        return hold_from_row(oscillator, goal, row)
    near = min(goal.most_periods, int(NEAR_TIMES * ring_down_periods(lever)) + NEAR_PERIODS)
    # By steps as asked, from the undented surface, for as long as it takes from next to an orbit; by finer steps; and
    # with the dents of earlier taps formed first, which takes as many periods as are allowed.
    for step, forms, most in ((1.0, False, near), (SECOND_TRY, False, near), (1.0, True, goal.most_periods)):
        fill_row_from_harmonic(lever, harmonic, row)
        if hold_orbit_near_row(oscillator, Goal(goal.amplitude, step * goal.step_size, most), forms, row):
            return col.GOOD
    return col.PENDING


@kernel
def state_on(law: Law, lever: np.ndarray, amplitude: float, row: np.ndarray) -> np.ndarray:
    """Return the state of a tip on a harmonic orbit of this amplitude [m], with phase, mean and offset of a row."""
    lag = 0.5 * math.pi - row[col.PHASE]
    z = row[col.MEAN] + amplitude * math.cos(lag)
    v = lever[col.OMEGA] * amplitude * math.sin(lag)
    return new_state(law, lever, row[col.MEAN], z, v, row[col.TIP_OFFSET])
