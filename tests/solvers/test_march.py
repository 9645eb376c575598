"""The march in time against formulas, against other integrators, and against orbits found by other means."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import Case, hold_in_time, label, load

from phasemap._kernels import columns as col
from phasemap._kernels.law import Oscillator
from phasemap._kernels.orbits.time import equation_of_motion, march, runge_kutta
from phasemap._kernels.orbits.time import tip as of_tip
from phasemap._kernels.orbits.time.tip import PeriodMap, PeriodResult
from phasemap.experiment.interaction import Interaction
from phasemap.experiment.lever_numbers import one_mode

Problem = Oscillator

ORBITS = [(case, orbit) for case in load("orbits") + load("orbits_unseen") for orbit in case["orbits"]]
STABLE = [
    (case, orbit)
    for case, orbit in ORBITS
    if orbit["floquet"] < 1 and orbit.get("slope", 1.0) > 0 and case["quality_factor"] < 1e5
]
SLOW_ENOUGH = [(case, orbit) for case, orbit in STABLE if case["quality_factor"] <= 1000]
UNSTABLE = [(case, orbit) for case, orbit in ORBITS if orbit["floquet"] > 1 and 100 < case["quality_factor"] <= 1000]
ENGAGED = load("engaged")
PERMANENT = [load("orbits")[19], load("orbits")[24]]


def problem_of(case: Case) -> Problem:
    """Token, parameter row and lever of a case."""
    interaction = Interaction(case.get("contact", "dmt"), case["decay_length"], case.get("damping_exponent", 0.5))
    sample = (1 - case["poisson_ratio"] ** 2) / case["modulus"] if case["modulus"] else math.inf
    tip = (1 - case["tip_poisson_ratio"] ** 2) / case["tip_modulus"] if case.get("tip_modulus") else 0.0
    adhesion, damping = np.array([case["adhesion"]]), np.array([case["damping"]])
    rows = interaction.columns(np.array([4 / 3 / (sample + tip)]), adhesion, damping, case["tip_radius"])
    quality = case["quality_factor"]
    drive = case["free_amplitude"] / quality
    lever = one_mode(case.get("frequency_ratio", 1.0), 0.5 / quality, case["stiffness"], drive)
    return Oscillator(interaction.token(), tuple(rows[0].tolist()), lever)


def row_of(orbit: dict[str, float]) -> np.ndarray:
    row = np.full(col.COLUMNS, np.nan)
    row[col.TIP_OFFSET], row[col.MEAN] = orbit["tip_offset"], orbit["mean_deflection"]
    row[col.AMPLITUDE], row[col.PHASE] = orbit["amplitude"], math.radians(orbit["phase"])
    return row


def state_of(orbit: dict[str, float], omega: float = 1.0) -> np.ndarray:
    """(z, z') at drive phase 0, without the higher harmonics."""
    mean, amplitude, lag = orbit["mean_deflection"], orbit["amplitude"], math.radians(90 - orbit["phase"])
    return np.array([mean + amplitude * math.cos(lag), omega * amplitude * math.sin(lag)])


def settled(problem: Problem, orbit: dict[str, float], eta: float, most: int = 1_000_000) -> tuple[int, np.ndarray]:
    row = row_of(orbit)
    return hold_in_time(problem, orbit["amplitude"], eta, most, row), row


def marched(problem: Problem, z0: float, y: np.ndarray, eta: float, periods: int = 1) -> tuple[np.ndarray, np.ndarray]:
    y, acc = y.copy(), PeriodResult()
    for _ in range(periods):
        assert march.march_oscillator(problem, z0, eta, y, acc) > 0
    return y, acc


TAPPING, TAPPING_ORBIT = ORBITS[0]


# The tableau and the small helpers, as Python sees them.


def test_the_tableau_takes_an_exponential_one_step_to_order_eight() -> None:
    # For y' = y the step is a polynomial in h that must agree with exp(h) up to h^8 / 8!.
    errors = []
    for h in (0.5, 0.25):
        slopes: tuple[float, ...] = (1.0,)
        for _ in range(11):
            slopes = (*slopes, runge_kutta._along(1.0, h, slopes))
        errors.append(runge_kutta._along(1.0, h, slopes) - math.exp(h))
    assert abs(errors[0]) < 1e-9
    assert math.log2(errors[0] / errors[1]) == pytest.approx(9, abs=0.3)


@pytest.mark.parametrize("angle", [-0.6, -0.1, 0.0, 1e-9, 0.3, 0.6])
def test_turn_is_cosine_and_sine(angle: float) -> None:
    assert runge_kutta.cosine_and_sine.py_func(angle) == pytest.approx(
        (math.cos(angle), math.sin(angle)), rel=3e-16, abs=1e-300
    )
    assert runge_kutta.cosine_and_sine(angle) == pytest.approx(
        runge_kutta.cosine_and_sine.py_func(angle), rel=3e-16, abs=1e-300
    )


def test_the_cubic_through_a_step_turns_and_crosses_where_it_should() -> None:
    h = 0.7

    def x(t: float) -> float:
        return -0.3 + 1.2 * t - 0.9 * t * t - 0.2 * t**3

    def v(t: float) -> float:
        return 1.2 - 1.8 * t - 0.6 * t * t

    assert v(equation_of_motion.time_of_turn.py_func(x(0), v(0), x(h), v(h), h)) == pytest.approx(0, abs=1e-14)
    assert x(equation_of_motion.time_of_crossing.py_func(x(0), v(0), x(h), v(h), h)) == pytest.approx(0, abs=1e-14)


@pytest.mark.parametrize("count", [2, 4, 8])
@pytest.mark.parametrize("size", [0.3, 1.0])
def test_a_measured_decay_is_summed_and_its_multipliers_found(count: int, size: float) -> None:
    random = np.random.default_rng(count)
    change, now = size * random.normal(size=(count, count)) - 0.2 * np.eye(count), random.normal(size=count)  # P' - 1
    linear, way = PeriodMap(), np.zeros(count)
    linear.count = count
    linear.motion[: count * count] = change.T.reshape(-1)
    of_tip.fill_way_of_decay.py_func(linear, now, way)
    assert way == pytest.approx(np.linalg.solve(-change, now))
    largest = np.abs(np.linalg.eigvals(np.eye(count) + change)).max()
    assert of_tip.floquet_multiplier.py_func(linear) == pytest.approx(largest, rel=1e-12)


# One period.


@pytest.mark.parametrize("omega", [0.8, 1.0, 1.3])
def test_the_free_lever_swings_as_the_formula_says(omega: float) -> None:
    alpha0, base, stiffness = 0.05, 1e-9, 2.0
    problem = problem_of({**TAPPING, "decay_length": None})
    problem = problem._replace(lever=one_mode(omega, alpha0, stiffness, base))
    response = base / (1 - omega**2 + 2j * alpha0 * omega)
    root = complex(-alpha0, math.sqrt(1 - alpha0**2))
    y = np.array([3e-9, -2e-9])
    # Own motion Re(c exp(root tau)) on top of the driven one.
    own, own_speed = y[0] - response.real, y[1] + omega * response.imag
    c = complex(own, (root.real * own - own_speed) / root.imag)
    tau = 5 * 2 * math.pi / omega
    end, acc = marched(problem, 1e-7, y, 0.1, 5)
    own_end = c * np.exp(root * tau)
    expected = [response.real + own_end.real, -omega * response.imag + (root * own_end).real]
    np.testing.assert_allclose(end, expected, rtol=0, atol=1e-13 * 5e-9)

    driven = np.array([response.real, -omega * response.imag])
    _, acc = marched(problem, 1e-7, driven, 0.1)
    np.testing.assert_allclose([acc.cos, acc.sin], [response.real, -response.imag], rtol=0, atol=1e-13 * abs(response))
    assert abs(acc.mean_z) < 1e-13 * abs(response)
    assert acc.loss == acc.virial == 0
    assert acc.deepest == pytest.approx(abs(response) - 1e-7, rel=1e-9)
    assert acc.air == pytest.approx(2 * math.pi * alpha0 * omega * stiffness * abs(response) ** 2, rel=1e-11)


def test_a_period_with_contact_agrees_with_another_integrator() -> None:
    from scipy.integrate import solve_ivp

    problem = problem_of(TAPPING)
    p, (omega, alpha0, stiffness, base) = problem.p, problem.lever[:4]
    z0 = TAPPING_ORBIT["tip_offset"]

    def rate(tau: float, y: np.ndarray) -> list[float]:
        d = y[0] - z0
        force = p[0] * max(d, 0.0) ** 1.5 - p[4] / (1 - min(d, 0.0) * p[5]) ** 2
        alpha = alpha0 + p[8] * math.sqrt(max(d, 0.0))
        return [y[1], base * math.cos(omega * tau) - y[0] - 2 * alpha * y[1] - force / stiffness]

    y = state_of(TAPPING_ORBIT)
    other = solve_ivp(rate, (0, 2 * math.pi), y, method="DOP853", rtol=1e-11, atol=1e-21, max_step=0.01)
    end, _ = marched(problem, z0, y, 0.15)
    np.testing.assert_allclose(end, other.y[:, -1], rtol=0, atol=1e-10 * TAPPING_ORBIT["amplitude"])


def periods() -> list[list[float]]:
    """State and sums after a period over a solid, and in few steps through a neck in a field."""
    marches = [
        (problem_of(TAPPING), TAPPING_ORBIT["tip_offset"], state_of(TAPPING_ORBIT), 0.5),
        (in_a_field(), 14e-9, np.array([0.5e-9, 14.7e-9, 0.0]), 1.5),
    ]
    return [[*y, *acc.tolist()] for y, acc in (marched(*one) for one in marches)]


def in_a_field() -> Problem:
    interaction = Interaction("jkr", 0.3e-9, bias=0.5)
    row = interaction.columns(np.array([4 / 3 * 1e9]), np.array([0.05]), np.array([0.01]), 20e-9)[0]
    return Oscillator(interaction.token(), tuple(row.tolist()), one_mode(1.0, 0.5 / 100, 5.0, 20e-9 / 100))


def test_compiled_periods_are_those_of_python() -> None:
    code = "import json, test_march; print(json.dumps(test_march.periods()))"
    path = os.pathsep.join([str(Path(__file__).parent), *sys.path])
    without = {**os.environ, "PYTHONPATH": path, "NUMBA_DISABLE_JIT": "1"}
    here = periods()  # first, for the formulas of laws have to be on disk
    said = subprocess.run([sys.executable, "-c", code], env=without, capture_output=True, text=True)
    assert said.returncode == 0, said.stderr
    for compiled, plain, rounding in zip(here, json.loads(said.stdout), (1e-11, 1e-10), strict=True):
        assert compiled == pytest.approx(plain, rel=rounding, abs=0)


@pytest.mark.parametrize(
    ("number", "change"),
    [
        (0, {}),  # DMT, long-range force and damping with n = 1/2
        (1, {}),  # stiff
        (0, {"decay_length": None}),  # the force jumps at contact
        (0, {"damping_exponent": 0.0}),  # the damping jumps at contact
        (0, {"damping_exponent": 1.0}),
        (20, {}),  # no adhesion, no damping
        (19, {}),  # permanent contact
    ],
)
def test_the_error_is_of_order_eight_down_to_1e_11(number: int, change: dict[str, Any]) -> None:
    case = {**load("orbits")[number], **change}
    orbit = case["orbits"][0]
    problem, y = problem_of(case), state_of(orbit)
    etas = 0.4 * 2.0 ** (-np.arange(8) / 4)
    exact_y, exact_acc = marched(problem, orbit["tip_offset"], y, 0.04, 3)
    errors = []
    for eta in etas:
        end, acc = marched(problem, orbit["tip_offset"], y, eta, 3)
        errors.append([np.abs(end - exact_y).max(), np.abs(np.subtract(acc.tolist(), exact_acc.tolist())[:3]).max()])
    slopes = np.polyfit(np.log(etas), np.log(errors), 1)[0]
    assert slopes == pytest.approx([8, 8], abs=0.31)
    assert np.all(np.array(errors[-1]) < 1e-11 * orbit["amplitude"])


@pytest.mark.parametrize("apart", [1e-9, 1e-12, 1e-15, 1e-18, 0.0, -1e-18, -1e-15, -1e-12, -1e-9])
@pytest.mark.parametrize("decay_length", [None, 2e-10])
def test_a_touch_at_the_top_of_the_swing_is_neither_missed_nor_invented(
    apart: float, decay_length: float | None
) -> None:
    problem = problem_of({**TAPPING, "adhesion": 0.0 if decay_length is None else 0.02})
    if decay_length is None:
        problem = problem._replace(p=(*problem.p[:4], 0.0, 0.0, 0.0, 0.0, *problem.p[8:]))
    amplitude, lever = 1e-8, problem.lever
    lever[3] = 2 * lever[1] * amplitude
    z0 = amplitude + apart
    for eta in (0.7, 0.45, 0.2):  # steps that end elsewhere beside the top
        _, acc = marched(problem, z0, np.array([0.0, amplitude]), eta)
        if decay_length is None and apart > -1e-12:  # too shallow to shorten the swing
            assert acc.deepest == pytest.approx(-apart, abs=1e-16 if eta < 0.5 else 1e-13)
        if apart < 0:
            assert acc.deepest > 0 or apart > -1e-14
            assert acc.deepest < 1.01 * abs(apart) + 1e-10
        if apart > 1e-10:
            assert acc.deepest < 0


@pytest.mark.parametrize("speed", [-1e-9, -1e-20, 0.0, 1e-20, 1e-9])
@pytest.mark.parametrize("phase", [0.5, 3.0])
def test_a_start_on_the_surface_goes_either_way(speed: float, phase: float) -> None:
    problem, z0 = problem_of(TAPPING), 1e-9 * math.cos(phase)
    near, _ = marched(problem, z0, np.array([z0, speed]), 0.2)
    beside, _ = marched(problem, z0, np.array([z0 - 1e-17, speed]), 0.2)
    np.testing.assert_allclose(near, beside, rtol=0, atol=1e-14)


def test_a_fast_tip_does_not_step_over_the_force_before_contact() -> None:
    # Thrown off a stiff surface at 40 times the speed of tapping, it crosses the whole force in a fraction of eta.
    problem, z0, y = problem_of(TAPPING), -1e-8, np.array([0.0, -4e-7])
    fine, _ = marched(problem, z0, y, 0.08)
    coarse, _ = marched(problem, z0, y, 0.25)
    np.testing.assert_allclose(coarse, fine, rtol=0, atol=1e-6 * 4e-7)


def test_a_hopeless_period_ends_with_a_status() -> None:
    problem, acc = problem_of(TAPPING), PeriodResult()
    y = state_of(TAPPING_ORBIT)
    assert march.march_oscillator(problem, TAPPING_ORBIT["tip_offset"], 1e-6, y, acc) == -col.NOT_SETTLED
    assert march.march_oscillator(problem, TAPPING_ORBIT["tip_offset"], 0.3, np.array([math.nan, 0.0]), acc) < 0
    assert march.march_oscillator(problem, math.nan, 0.3, state_of(TAPPING_ORBIT), acc) < 0


# Settled orbits.


@pytest.mark.parametrize(("case", "orbit"), STABLE, ids=[label(case) for case, _ in STABLE])
def test_settling_ends_on_the_reference_orbit(case: Case, orbit: dict[str, float]) -> None:
    status, row = settled(problem_of(case), orbit, 0.15)
    assert status == col.GOOD
    # The references are good to 1e-6 degree and 1e-4 pm.
    assert abs(row[col.TIP_OFFSET] - orbit["tip_offset"]) < 1e-15
    assert abs(math.degrees(row[col.PHASE]) - orbit["phase"]) < 2e-6
    assert abs(row[col.MEAN] - orbit["mean_deflection"]) < 1e-16
    assert row[col.AMPLITUDE] == pytest.approx(orbit["amplitude"], abs=1e-17)
    assert row[col.FLOQUET] == pytest.approx(orbit["floquet"], abs=2e-4)
    assert row[col.SLOPE] > 0
    assert np.isnan(row[[col.ERROR_PHASE, col.ERROR_HEIGHT]]).all()
    if "slope" in orbit and case["quality_factor"] <= 1000:
        assert row[col.SLOPE] == pytest.approx(orbit["slope"], abs=0.02)
        assert row[col.INDENTATION] == pytest.approx(orbit["peak_indentation"], abs=1e-15)
        assert row[col.DISSIPATION] == pytest.approx(orbit["dissipation"], rel=1e-5, abs=1e-27)


@pytest.mark.parametrize(("case", "orbit"), SLOW_ENOUGH, ids=[label(case) for case, _ in SLOW_ENOUGH])
def test_energy_that_goes_in_comes_out(case: Case, orbit: dict[str, float]) -> None:
    status, row = settled(problem_of(case), orbit, 0.1)
    assert status == col.GOOD
    assert abs(row[col.CLOSURE]) < 1e-9


def test_stiffening_and_virial_are_the_same_force_seen_twice() -> None:
    # mean(F z) = mean(F) mean(z) + mean(F cos) A / 2 + ..., with mean(F) = -k mean(z) and weak higher harmonics.
    for case, orbit in STABLE[:4]:
        problem = problem_of(case)
        _, row = settled(problem, orbit, 0.2)
        k, amplitude = case["stiffness"], row[col.AMPLITUDE]
        fundamental = -0.5 * k * amplitude**2 * row[col.STIFFENING] + k * row[col.MEAN] ** 2
        assert row[col.VIRIAL] == pytest.approx(fundamental, rel=0.02)


@pytest.mark.parametrize("case", PERMANENT, ids=label)
def test_a_tip_that_stays_in_contact_settles(case: Case) -> None:
    orbit = case["orbits"][0]
    problem = problem_of(case)
    status, row = settled(problem, orbit, 0.2)
    assert status == col.GOOD
    assert row[col.TIP_OFFSET] < 0 < row[col.INDENTATION] - 2 * row[col.AMPLITUDE]


@pytest.mark.parametrize("number", [0, 7, 12])
def test_the_transient_that_is_skipped_is_the_one_that_time_takes(number: int) -> None:
    case = load("orbits")[number]
    orbit = case["orbits"][0]
    problem = problem_of(case)
    _, row = settled(problem, orbit, 0.3)
    y = state_of(orbit) * [1.01, 0.98]
    decay_times = 16
    _, acc = marched(problem, row[col.TIP_OFFSET], y, 0.3, math.ceil(decay_times * case["quality_factor"] / math.pi))
    assert math.degrees(math.pi / 2 - math.atan2(acc.sin, acc.cos) - row[col.PHASE]) == pytest.approx(0, abs=1e-5)
    assert math.hypot(acc.cos, acc.sin) == pytest.approx(row[col.AMPLITUDE], rel=1e-7)


@pytest.mark.parametrize("number", [0, 4, 19, 20, 38])
def test_a_poor_start_settles_on_the_only_orbit_there_is(number: int) -> None:
    case = load("orbits")[number]
    orbit = case["orbits"][0]
    row = row_of(orbit | {"tip_offset": orbit["amplitude"] + 1e-9, "mean_deflection": 0.0, "phase": 0.0})
    assert hold_in_time(problem_of(case), orbit["amplitude"], 0.3, 1_000_000, row) == col.GOOD
    assert abs(row[col.TIP_OFFSET] - orbit["tip_offset"]) < 1e-14


@pytest.mark.parametrize(("case", "orbit"), UNSTABLE, ids=[label(case) for case, _ in UNSTABLE])
def test_an_unstable_orbit_is_left(case: Case, orbit: dict[str, float]) -> None:
    status, row = settled(problem_of(case), orbit, 0.3)
    assert status == col.NO_STABLE_ORBIT or (status == col.GOOD and row[col.FLOQUET] < 1)
    assert not abs(row[col.TIP_OFFSET] - orbit["tip_offset"]) < 1e-12


def test_a_setpoint_above_the_free_amplitude_has_no_orbit() -> None:
    high = {**TAPPING_ORBIT, "amplitude": 1.02 * TAPPING["free_amplitude"]}
    status, row = settled(problem_of(TAPPING), high, 0.3)
    assert status == col.NO_STABLE_ORBIT
    assert np.isnan(row).all()


def test_too_few_periods_to_settle_are_reported() -> None:
    start = {**TAPPING_ORBIT, "tip_offset": 2 * TAPPING_ORBIT["tip_offset"]}
    status, row = settled(problem_of(TAPPING), start, 0.3, most=10)
    assert status == col.NOT_SETTLED
    assert np.isnan(row).all()


# Engaging from far.


@pytest.mark.parametrize("case", ENGAGED, ids=label)
def test_engaging_ends_where_brute_force_engagement_ended(case: Case) -> None:
    # The reference settled in time alone, over some 1e5 periods, to about 0.1 pm and 1e-3 degree.
    problem, engaged = problem_of(case), case["engaged"]
    lever = problem.lever
    free = lever[3] / abs(complex(1 - lever[0] ** 2, 2 * lever[1] * lever[0]))
    row = np.full(col.COLUMNS, math.nan)
    amplitude = case["setpoint"] * free
    status = hold_in_time(problem, amplitude, 0.3, 1_000_000, row)
    assert status == col.GOOD
    if engaged["branch"] == "none":  # the reference found no orbit that repeats itself
        assert row[col.SPREAD_AMPLITUDE] > 0
        return
    assert (row[col.PHASE] > 0) == (engaged["branch"] == "repulsive")
    assert abs(row[col.TIP_OFFSET] - engaged["tip_offset"]) < 1e-13
    assert abs(math.degrees(row[col.PHASE]) - engaged["phase"]) < 2e-3


def test_engaging_above_the_free_amplitude_finds_no_orbit() -> None:
    amplitude, row = 1.02 * TAPPING["free_amplitude"], np.full(col.COLUMNS, math.nan)
    assert hold_in_time(problem_of(TAPPING), amplitude, 0.3, 1_000_000, row) == col.NO_STABLE_ORBIT


def test_engaging_that_takes_too_long_is_reported() -> None:
    amplitude, row = 0.5 * TAPPING["free_amplitude"], np.full(col.COLUMNS, math.nan)
    assert hold_in_time(problem_of(TAPPING), amplitude, 0.3, 50, row) == col.NOT_SETTLED
    assert np.isnan(row).all()
