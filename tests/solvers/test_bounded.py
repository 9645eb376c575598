"""Work in time is bounded by a number of periods, counted, so that results are the same on every machine."""

from __future__ import annotations

import math

import numpy as np
import pytest

import phasemap as pm
from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement import holding_in_time, holding_mean, in_time, lowering
from phasemap._kernels.engagement.goal import Goal, coarse_tolerance
from phasemap._kernels.law import Law, Oscillator
from phasemap._kernels.orbits.time import period_map
from phasemap._kernels.orbits.time.tip import MovingTip, PeriodMap, PeriodResult, Periods, new_state
from phasemap._kernels.scanning.feedback_loop import Setup
from phasemap._kernels.scanning.line import approach_in_time
from phasemap._kernels.scanning.periods import new_periods
from phasemap.experiment.lever_numbers import lever_of, one_mode
from phasemap.imaging.feedback.lines import loop_of
from phasemap.solvers.continuation.curves import settling_periods
from phasemap.solvers.problem import work_of_material

SCOPE = pm.Microscope(
    pm.Cantilever(3.0, 300e3, 200.0), pm.Tip(10e-9), pm.Drive(40e-9), pm.Interaction("jkr", decay_length=0.3e-9)
)
RUBBER = pm.Material(30e6, 0.05, 0.01)  # on which this tip taps irregularly at 0.6
SLOW = pm.Microscope(  # rings down in 3e5 periods
    pm.Cantilever(3.0, 300e3, 1e6), pm.Tip(10e-9), pm.Drive(40e-9), pm.Interaction("jkr", decay_length=0.3e-9)
)
MORE = 100
"""Periods by which a bound may be passed: a step of Newton's method is ended, 20 iterations of 5 at most."""


def tip_at(law: Law, scope: pm.Microscope, z0: float) -> MovingTip:
    u = new_state.py_func(law, lever_of(scope), 0.0, 0.0, 0.5 * scope.driven_amplitude, z0)
    return MovingTip(u, PeriodResult(), PeriodMap(), Periods())


WHATS = ("hold", "hold_mean", "move_to_mean_amplitude", "follow_down", "fall", "rest")


@kernel
def do(what: int, problem: Oscillator, amplitude: float, most: int, tip: MovingTip, row: np.ndarray) -> None:
    """One of these: they are compiled together."""
    goal = Goal(amplitude, 0.25, most)
    if what == 0:
        holding_in_time.hold_in_time(problem, goal, tip, row)
    elif what == 1:
        holding_mean.hold_mean(problem, goal, holding_mean.EAGER_GAIN, tip, row)
    elif what == 2:
        in_time.move_to_mean_amplitude(problem, goal, 0.0, tip)
    elif what == 3:
        lowering.follow_down(problem, goal, 1e-10, 0.0, tip)
    elif what == 4:
        lowering.fall_to_setpoint(problem, goal, 1e-12, 0.0, tip)
    else:
        period_map.come_to_rest(problem, coarse_tolerance(goal), most, tip)


@pytest.mark.slow
@pytest.mark.parametrize("scope", [SCOPE, SLOW], ids=["Q 200", "Q 1e6"])
@pytest.mark.parametrize("most", [1, 300, 5000])
@pytest.mark.parametrize("what", WHATS)
def test_nothing_takes_more_periods_than_allowed(scope: pm.Microscope, most: int, what: str) -> None:
    amplitude = 0.6 * scope.driven_amplitude
    work = work_of_material(RUBBER, scope, amplitude)
    problem = work.oscillator(0)
    tip, row = tip_at(work.law, scope, 24e-9), np.empty(col.COLUMNS)
    do(WHATS.index(what), problem, amplitude, most, tip, row)
    assert tip.periods.marched <= most + MORE


def test_a_move_that_takes_too_many_periods_is_not_begun() -> None:
    work = work_of_material(RUBBER, SLOW, 0.6 * SLOW.driven_amplitude)
    state, row = np.array([0.0, 0.0, 0.0, 80e-9]), np.full(col.COLUMNS, math.nan)
    status = in_time.move_to_tip_offset(work.oscillator(0), 24e-9, 0.25, 10_000, state, row)
    assert status == col.NOT_SETTLED
    assert state[3] == 80e-9
    assert np.isnan(row).all()


def test_a_landing_is_given_up_after_as_many() -> None:
    assert settling_periods(one_mode(1.0, 0.5 / 1e6, 3.0, 1e-13)) == pm.Accuracy().periods


@pytest.mark.parametrize(("periods", "expected"), [(50, col.NOT_SETTLED), (10**6, col.GOOD)])
def test_a_scan_gives_up_an_approach_after_as_many(periods: int, expected: int) -> None:
    scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(16e-9))
    amplitude = 0.8 * scope.driven_amplitude
    work = work_of_material(pm.Material(2e9, 0.02, 0.01), scope, amplitude)
    loop, tip = loop_of(pm.Feedback(), scope, amplitude, periods=periods), new_periods(0.7)
    setup = Setup(work.law, work.lever, loop, np.random.default_rng(0))
    assert approach_in_time(setup, work.rows[0], 0.0, tip) == expected


@pytest.mark.parametrize("solver", ["auto", "orbit", "march"])
def test_what_is_not_decided_in_time_says_what_to_do_and_that_helps(solver: str) -> None:
    short = pm.solve_pixel(RUBBER, SCOPE, 0.6, solver, accuracy=pm.Accuracy(periods=2000))
    assert short.status is pm.Status.not_settled
    assert "Accuracy(periods=...)" in short.status.value
    assert math.isnan(short.phase)
    enough = pm.solve_pixel(RUBBER, SCOPE, 0.6, solver)
    assert enough.status is pm.Status.good
    assert enough.motion == "irregular"


def test_more_periods_than_needed_change_no_bit() -> None:
    usual, more = (pm.solve_pixel(RUBBER, SCOPE, 0.6, accuracy=pm.Accuracy(periods=n)) for n in (100_000, 10**9))
    assert (usual.phase, usual.tip_offset, usual.phase_spread) == (more.phase, more.tip_offset, more.phase_spread)


def test_a_tip_that_can_only_be_torn_off_is_not_lifted() -> None:
    # Adhesion holds this lever up to 265 nm from the surface, where it swings by 35 nm at most: it falls again.
    scope = pm.Microscope(pm.Cantilever(0.2, 300e3, 150.0), pm.Tip(45e-9), pm.Drive(35e-9), pm.Interaction("jkr", None))
    pixel = pm.solve_pixel(pm.Material(1e10, 0.25, 0.0034), scope, 0.18, accuracy=pm.Accuracy(periods=200))
    assert pixel.status is pm.Status.no_stable_orbit
