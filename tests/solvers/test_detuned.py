"""Drives beside resonance: no frequency is special, and the tip ends where engaging in time ends."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from cases import Case, label, load, material_of, scope_of
from numpy.typing import NDArray

import phasemap as pm
from benchmarks.accuracy.regimes import REGIMES, Batch, draw
from phasemap._kernels import columns as col
from phasemap._kernels.engagement.by_averaging import narrowest_amplitude_ratio
from phasemap.experiment.lever_numbers import one_mode
from phasemap.solvers.problem import Work
from phasemap.solvers.run import run
from phasemap.solvers.solver import by_name

CASES = load("detuned")
HELD = [case for case in CASES if case["outcome"] == "held"]
CLOSE = (1e-12, 1e-9, 1e-6)  # of the resonance frequency
NAMES = ("air, hard sample", "soft lever", "bistable")


@cache  # which orbits a material has is asked of many that are not taken
def drawn(name: str, pixels: int = 15) -> tuple[Batch, ...]:
    (found,) = [draw(one, 4, pixels, np.random.default_rng(77)) for one in REGIMES if one.name == name]
    return found


def work_at(batch: Batch, ratio: float) -> Work:
    """The same lever, free amplitude and materials at another drive frequency."""
    lever = batch.scope.cantilever
    larger = lever.quality_factor * math.hypot(1 - ratio**2, ratio / lever.quality_factor)
    drive = pm.Drive(batch.scope.drive.free_amplitude * larger, ratio * lever.resonance_frequency)
    scope = pm.Microscope(lever, batch.scope.tip, drive, batch.scope.interaction)
    return Batch(scope, batch.materials, batch.setpoint).work()


@cache
def solved(name: str, solver: str, ratio: float) -> list[tuple[NDArray[np.float64], ...]]:
    """Rows, statuses and solvers used of each batch; two tests ask for the same."""
    return [run(by_name(solver), work_at(batch, ratio), pm.Accuracy()) for batch in drawn(name)]


@pytest.mark.parametrize("case", HELD, ids=label)
def test_beside_resonance_the_tip_ends_where_engaging_in_time_ends(case: Case) -> None:
    pixel = pm.solve_pixel(material_of(case), scope_of(case), case["setpoint"], solver="orbit")
    # The reference is good to a thousandth of these; `orbit` promises 1e-3 degree and 1 pm.
    assert abs(pixel.phase - case["orbit"]["phase"]) < 1e-3
    assert abs(pixel.tip_offset - case["orbit"]["tip_offset"]) < 1e-12


@pytest.mark.parametrize("solver", ["orbit", "averaging"])
@pytest.mark.parametrize("name", NAMES)
def test_branch_and_phase_are_continuous_through_resonance(name: str, solver: str) -> None:
    for number, batch in enumerate(drawn(name)):
        rows, status, _ = solved(name, solver, 1.0)[number]
        held = status == col.GOOD
        for apart in (-1e-6, -1e-9, -1e-12, 1e-12, 1e-9, 1e-6):
            beside, beside_status, _ = solved(name, solver, 1.0 + apart)[number]
            assert np.array_equal(beside_status, status)
            assert np.array_equal(beside[held, col.STIFFENING] > 0, rows[held, col.STIFFENING] > 0)
            # At fixed amplitude X and Y of the first harmonic move by A |1 - omega^2| = u0 (A/A_free) 2 Q |apart|, and
            # the phase by that over Y/u0 >= A/A_free; twice that for what the surface adds. The rest is what both
            # answers may be wrong by (`orbit` states 1e-3 degree at most, and is a hundred times better).
            bound = 2 * 2 * batch.scope.cantilever.quality_factor * abs(apart) + math.radians(2e-5)
            assert np.max(abs(beside[held, col.PHASE] - rows[held, col.PHASE]), initial=0.0) < bound


@pytest.mark.parametrize("name", NAMES)
def test_next_to_resonance_no_more_orbits_are_left_to_collocation(name: str) -> None:
    def left(ratio: float) -> int:
        return sum(int(np.sum(used == col.ORBIT)) for _, _, used in solved(name, "orbit", ratio))

    at_resonance = left(1.0)
    assert at_resonance < 6  # of 60, a tenth
    assert all(left(1.0 + sign * apart) <= at_resonance for apart in CLOSE for sign in (-1, 1))


def test_above_resonance_a_tip_that_never_leaves_a_soft_sample_is_held_where_time_holds_it() -> None:
    drive = pm.Drive(60e-9 * 63.0, 330e3)  # 60 nm at 1.1 of the resonance
    scope = pm.Microscope(pm.Cantilever(20.0, 300e3, 300.0), pm.Tip(20e-9), drive, pm.Interaction(decay_length=0.3e-9))
    soft = np.column_stack([np.geomspace(4e7, 2e8, 4), np.full(4, 0.03), np.tile([0.0, 0.05], 2), np.full(4, 0.35)])
    work = Batch(scope, soft, 0.6).work()
    rows, status, _ = run(by_name("orbit"), work, pm.Accuracy())
    marched, _, _ = run(by_name("march"), work, pm.Accuracy())
    assert (status == col.GOOD).all()
    assert np.sum(rows[:, col.TIP_OFFSET] - rows[:, col.MEAN] < -1.1 * rows[:, col.AMPLITUDE]) >= 2  # never leave it
    assert rows[:, col.PHASE] == pytest.approx(marched[:, col.PHASE], abs=1e-6)
    assert rows[:, col.TIP_OFFSET] == pytest.approx(marched[:, col.TIP_OFFSET], abs=1e-13)


def test_beside_the_end_of_the_attractive_branch_the_outer_of_two_orbits_is_taken() -> None:
    # The inner one, at 0.87 of the amplitude, has the same phase, and no feedback can hold it: its amplitude falls as
    # the tip is raised.
    lever, tip, drive = pm.Cantilever(3.0, 300e3, 185.268), pm.Tip(12.31625e-9), pm.Drive(1.067908e-6, 315e3)
    scope = pm.Microscope(lever, tip, drive, pm.Interaction(decay_length=0.23118876e-9))
    soft, setpoint = pm.Material(75.622e6, adhesion=0.09693, damping=0.0, poisson_ratio=0.35), 0.94299
    pixel = pm.solve_pixel(soft, scope, setpoint, "orbit")
    image = pm.simulate(pm.Surface.from_labels([[0]], {0: soft}, pixel_size=1e-9), scope, setpoint, solver="orbit")
    assert pixel.branch == "attractive" and pixel.feedback_slope > 0
    assert abs(image.tip_offset.values[0, 0] - pixel.tip_offset) < 1e-12


def test_a_fall_that_takes_more_time_than_allowed_is_no_answer() -> None:
    # Adhesion bends this lever by more than it swings: averaging says nothing of where it lands.
    scope = pm.Microscope(pm.Cantilever(0.5, 300e3, 20e3), pm.Tip(20e-9), pm.Drive(400e-9, 0.9995 * 300e3))
    pixel = pm.solve_pixel(pm.Material(1e9, 0.05, 0.01), scope, 0.7, solver="orbit")
    assert pixel.status is pm.Status.not_settled
    assert "Accuracy(periods=...)" in pixel.status.value


LEAPS = load("leaps")
# A change of the drive by 1e-13 decides whether an answer is found; one that is found must be right.
DECIDED_BY_ROUNDING = ("leap 116", "leap 146", "leap 148")


@pytest.mark.parametrize("case", LEAPS, ids=label)
def test_a_tip_that_is_carried_over_its_resonance_lands_where_time_leads(case: Case) -> None:
    pixel = pm.solve_pixel(material_of(case), scope_of(case), case["setpoint"], solver="orbit")
    if case["name"] in DECIDED_BY_ROUNDING and pixel.status is not pm.Status.good:
        assert pixel.status in (pm.Status.not_settled, pm.Status.no_stable_orbit)
        return
    assert pixel.status is pm.Status.good
    # The reference tells branches apart: its steps leave up to 0.2 degree and 0.02 nm.
    assert abs(pixel.phase - case["orbit"]["phase"]) < 0.3
    assert abs(pixel.tip_offset - case["orbit"]["tip_offset"]) < 5e-11


# A branch that ends at 13 nm for a tip that moves, at any speed, and goes on for one that is moved by picometres; a
# fall in which the tip swings less, for a while, than where it lands; adhesion that bends the lever a lot.
HARD_FALLS = [
    case | {"contact": "dmt", "poisson_ratio": 0.35}
    for case in (
        {"name": "small basin", "stiffness": 1.099, "quality_factor": 105.0, "frequency_ratio": 0.99836,
         "tip_radius": 25.1e-9, "decay_length": 0.2434e-9, "free_amplitude": 17.84e-9, "modulus": 6.687e9,
         "adhesion": 0.01025, "damping": 0.04757, "setpoint": 0.357, "phase": 70.19},
        {"name": "dip", "stiffness": 0.5338, "quality_factor": 140.1, "frequency_ratio": 0.99,
         "tip_radius": 9.016e-9, "decay_length": 0.3797e-9, "free_amplitude": 29.39e-9, "modulus": 31.34e6,
         "adhesion": 0.1139, "damping": 0.01074, "setpoint": 0.881, "phase": -72.84},
        {"name": "bent lever", "stiffness": 0.8985, "quality_factor": 52.49, "frequency_ratio": 0.995,
         "tip_radius": 21.98e-9, "decay_length": 0.2118e-9, "free_amplitude": 23.18e-9, "modulus": 9.459e9,
         "adhesion": 0.05904, "damping": 0.0007049, "setpoint": 0.436, "phase": -67.27},
    )
]  # fmt: skip


@pytest.mark.parametrize("case", HARD_FALLS, ids=label)
def test_falls_that_mislead_end_where_time_leads(case: Case) -> None:
    pixel = pm.solve_pixel(material_of(case), scope_of(case), case["setpoint"], solver="orbit")
    assert pixel.phase == pytest.approx(case["phase"], abs=0.1)  # `engage` of tests/reference/make_leaps.py


# Many linewidths off the resonance: a tip that rebounds from a stiff sample doubles its period, and stays so where a
# periodic orbit is stable, too; and a surface that pulls a tip by more than it swings lets it tap on.
REBOUNDS = [
    case | {"contact": "dmt", "poisson_ratio": 0.35}
    for case in (
        {"name": "doubled period", "stiffness": 51.6, "quality_factor": 116.0, "frequency_ratio": 0.887,
         "tip_radius": 60.2e-9, "decay_length": 0.183e-9, "free_amplitude": 4.45e-9, "modulus": 946e9,
         "adhesion": 0.0294, "damping": 0.000618, "setpoint": 0.148, "phase": 86.72, "tip_offset": 1.231e-9},
        {"name": "strong pull", "stiffness": 1.8, "quality_factor": 327.0, "frequency_ratio": 0.88,
         "tip_radius": 81.7e-9, "decay_length": None, "free_amplitude": 12.5e-9, "modulus": 50.7e6,
         "adhesion": 0.0727, "damping": 0.000554, "setpoint": 0.902, "phase": 88.863, "tip_offset": -1.145e-9},
    )
]  # fmt: skip


@pytest.mark.parametrize("case", REBOUNDS, ids=label)
def test_hard_taps_off_the_resonance_end_where_time_leads(case: Case) -> None:
    free = case["free_amplitude"]  # at the drive frequency
    scale = case["quality_factor"] * math.hypot(
        1 - case["frequency_ratio"] ** 2, case["frequency_ratio"] / case["quality_factor"]
    )
    scope = scope_of(case | {"free_amplitude": free * scale})
    pixel = pm.solve_pixel(material_of(case), scope, case["setpoint"], solver="orbit")
    # Lowered slowly and held by a feedback, with tests/reference/hard_map.py; the mean of two periods in the first.
    assert pixel.phase == pytest.approx(case["phase"], abs=0.01)
    assert pixel.tip_offset == pytest.approx(case["tip_offset"], abs=2e-12)
    assert (pixel.motion == "irregular") == (case["name"] == "doubled period")


# Held where a soft sample is pressed in by a hundred amplitudes and more, `engage` of tests/reference/hard_engage.py:
# with no fold on the way, with one, and with one from which only time leads on.
PRESSED_IN = [
    case | {"poisson_ratio": 0.35}
    for case in (
        {"name": "no fold", "contact": "hertz", "stiffness": 48.2, "quality_factor": 758.6, "frequency_ratio": 1.06059,
         "tip_radius": 1.084e-9, "decay_length": None, "free_amplitude": 0.597e-9, "modulus": 1.993e6,
         "adhesion": 0.0, "damping": 0.025, "setpoint": 0.216, "phase": -12.36328038, "tip_offset": -122.37899625e-9},
        {"name": "no fold, attraction", "contact": "dmt", "stiffness": 3.839, "quality_factor": 26.33,
         "frequency_ratio": 1.04782, "tip_radius": 3.902e-9, "decay_length": 0.6417e-9, "free_amplitude": 2.702e-9,
         "modulus": 2.173e6, "adhesion": 0.00208, "damping": 0.03469, "setpoint": 0.147, "phase": -4.06830499,
         "tip_offset": -349.44589141e-9},
        {"name": "fold", "contact": "dmt", "stiffness": 1.404, "quality_factor": 19.52, "frequency_ratio": 0.94592,
         "tip_radius": 1.492e-9, "decay_length": 0.2287e-9, "free_amplitude": 8.246e-9, "modulus": 3.62e6,
         "adhesion": 0.08902, "damping": 0.0001325, "setpoint": 0.374, "phase": 79.92898316,
         "tip_offset": -877.0842595841e-9},
        {"name": "only time", "contact": "dmt", "stiffness": 1.404, "quality_factor": 19.52, "frequency_ratio": 0.94592,
         "tip_radius": 1.492e-9, "decay_length": 0.2287e-9, "free_amplitude": 8.246e-9, "modulus": 2.481e6,
         "adhesion": 0.2245, "damping": 0.0, "setpoint": 0.374, "phase": 81.00014816,
         "tip_offset": -1886.0814186587e-9},
    )
]  # fmt: skip


@pytest.mark.parametrize("case", PRESSED_IN, ids=label)
def test_a_tip_is_pressed_in_as_far_as_the_setpoint_asks(case: Case) -> None:
    pixel = pm.solve_pixel(material_of(case), scope_of(case), case["setpoint"])
    assert pixel.status is pm.Status.good
    assert pixel.phase == pytest.approx(case["phase"], abs=1e-5)
    # What the reference is off by where the amplitude hardly falls with the tip offset.
    assert pixel.tip_offset == pytest.approx(case["tip_offset"], rel=1e-7)


TAPS = load("taps")
HELD_TAPS = [case | {"contact": "dmt", "poisson_ratio": 0.35} for case in TAPS]
FAR = HELD_TAPS[-1]  # on the curve of periodic orbits 89.69 degree and 8.61 nm are stable, too


ONE_MOTION = [case for case in HELD_TAPS if len({round(motion["phase"], 4) for motion in case["held"]}) == 1]
"""Where an approach of any speed leads to the same; elsewhere rounding decides which of several motions is found."""


@pytest.mark.parametrize("case", ONE_MOTION, ids=range(len(ONE_MOTION)))
def test_hard_taps_end_where_every_approach_of_an_independent_program_does(case: Case) -> None:
    pixel, motion = (
        pm.solve_pixel(material_of(case), scope_of(case), case["setpoint"], solver="orbit"),
        case["held"][-1],
    )
    assert (pixel.motion == "periodic") == (motion["period"] == 1)
    # What `march` states, 5e-5 degree and 0.01 pm, or 2e-4 degree and 0.02 pm of a mean.
    assert pixel.phase == pytest.approx(motion["phase"], abs=2e-4)
    assert pixel.tip_offset == pytest.approx(motion["tip_offset"], abs=2e-14)


@pytest.mark.parametrize("solver", ["orbit", "auto", "march", "averaging"])
def test_far_from_resonance_no_curve_answers_for_time_that_is_not_allowed(solver: str) -> None:
    short, enough = (
        pm.solve_pixel(material_of(FAR), scope_of(FAR), FAR["setpoint"], solver, accuracy=pm.Accuracy(periods=periods))
        for periods in (5000, 100_000)
    )
    assert short.status is pm.Status.not_settled
    assert enough.motion == "irregular"  # every second period is alike
    assert enough.phase == pytest.approx(FAR["held"][0]["phase"], abs=2e-4)  # the error stated
    assert enough.tip_offset == pytest.approx(FAR["held"][0]["tip_offset"], abs=2e-14)


def test_far_from_resonance_a_tip_that_is_pressed_in_stays_on_its_orbits() -> None:
    # Deeper than time lowers a tip, -30 free amplitudes; it is held there in time all the same.
    lever, drive = pm.Cantilever(0.5, 300e3, 13.0), pm.Drive(0.9e-9 * 13.0 * abs(1 - 0.565**2), 0.565 * 300e3)
    scope = pm.Microscope(lever, pm.Tip(2.6e-9), drive, pm.Interaction(decay_length=0.15e-9))
    orbit, march = (pm.solve_pixel(pm.Material(30.6e6, 0.0, 9e-4), scope, 0.31, name) for name in ("orbit", "march"))
    assert orbit.status is march.status is pm.Status.good
    assert orbit.tip_offset < -60 * scope.driven_amplitude
    assert orbit.phase == pytest.approx(march.phase, abs=1e-4)
    assert orbit.tip_offset == pytest.approx(march.tip_offset, rel=1e-6)


@pytest.mark.parametrize("ratio", [0.5, 0.9, 0.999, 1.0, 1.001, 1.1, 2.0])
@pytest.mark.parametrize("quality", [3.0, 400.0])
def test_the_attractive_branch_is_nearest_to_its_end_where_a_search_finds_it(ratio: float, quality: float) -> None:
    # What is needed, (1 - r^2 y^2)^(1/2) + r x, over what there is, r^(-1/2), has its maximum there.
    lever = one_mode(ratio, 0.5 / quality, 1.0, 1.0)
    whole = math.hypot(1 - ratio**2, ratio / quality)
    x, y = (1 - ratio**2) / whole, ratio / quality / whole
    r = np.geomspace(1e-2, 1 / y, 400_001)
    share = np.sqrt(r) * (np.sqrt(np.maximum(1 - (r * y) ** 2, 0)) + r * x)
    assert narrowest_amplitude_ratio(lever) == pytest.approx(
        r[np.argmax(share)], rel=1e-3
    )  # as near as a flat maximum is found
