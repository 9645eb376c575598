"""Many periods in a step: the motion is that of one period after the other."""

from __future__ import annotations

import math

import phasemap as pm
from phasemap._kernels import columns as col
from phasemap._kernels.law import Oscillator
from phasemap._kernels.orbits.time.many_periods import PeriodFlow, begin_flow, pass_many
from phasemap._kernels.orbits.time.period_map import march_tip
from phasemap._kernels.orbits.time.tip import Z0, MovingTip, PeriodMap, PeriodResult, Periods, V, Z, new_state
from phasemap.solvers.problem import work_of_material

ETA, PERIODS = 0.5, 400


def test_a_tip_that_falls_below_resonance_moves_as_it_does_period_by_period() -> None:
    scope = pm.Microscope(pm.Cantilever(20.0, 300e3, 400.0), pm.Tip(15e-9), pm.Drive(50e-9, 0.999 * 300e3))
    work = work_of_material(pm.Material(1e8, 0.05, 0.02), scope, 0.7 * scope.driven_amplitude, marched=True)
    law, p, lever = work.law, tuple(map(float, work.rows[0])), work.lever
    omega, amplitude = lever[col.OMEGA], scope.driven_amplitude
    swing = lever[col.DRIVE] / complex(1 - omega**2, 2 * lever[col.ALPHA0] * omega)
    # From an amplitude from contact 4 pm a period for three ring-down times: the amplitude rises, and the tip touches.
    pace, allowed, start = 4e-12, 1e-12, amplitude + 1.5e-9
    one, many = (
        MovingTip(
            new_state(law, lever, 0.0, swing.real, -omega * swing.imag, start), PeriodResult(), PeriodMap(), Periods()
        )
        for _ in range(2)
    )
    flow, passed, steps, deepest = PeriodFlow(), 0, 0, -math.inf
    assert begin_flow(Oscillator(law, p, lever), ETA, pace, many, flow)
    while passed < PERIODS:
        steps += 1
        passed += pass_many(Oscillator(law, p, lever), ETA, pace, allowed, many, flow)
    for _ in range(passed):
        one.u[Z0] -= pace
        assert march_tip(Oscillator(law, p, lever), ETA, one)
        deepest = max(deepest, one.acc.deepest)
    assert deepest > 0.0
    assert many.periods.marched < 0.4 * passed
    # Errors of single steps grow no more than the motion's: neighbours keep apart to within a factor of some, here 3.
    assert math.hypot(many.u[Z] - one.u[Z], (many.u[V] - one.u[V]) / omega) < 3 * steps * allowed
    assert abs(many.u[Z0] - one.u[Z0]) < 1e-6 * allowed * passed
