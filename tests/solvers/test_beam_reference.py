"""Orbits of levers with several eigenmodes (tests/reference/beam.py): made again, and judged by other means."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest
from cases import Case, load
from scipy.integrate import solve_ivp

sys.path.insert(0, str(Path(__file__).parents[1] / "reference"))

from beam import Problem
from make_beam import lower, record, whole

CASES = load("beam")
WET = [case for case in CASES if case["quality_factor"][0] < 10]
GIVEN = set(whole({}))


def parameters(case: Case) -> Case:
    return {key: value for key, value in case.items() if key in GIVEN}


@pytest.mark.slow
@pytest.mark.parametrize("case", WET[::12], ids=lambda case: f"{case['phase']:.2f}")
def test_a_tip_lowered_from_far_finds_the_recorded_orbit(case: Case) -> None:
    again = record(parameters(case), *lower(parameters(case))[0], from_far=True)
    # Two solutions, each within the recorded error of the orbit.
    assert again["phase"] == pytest.approx(case["phase"], abs=2 * case["phase_error"])
    assert again["tip_offset"] == pytest.approx(case["tip_offset"], abs=2 * case["tip_offset_error"])
    assert again["touches"] == case["touches"]


@pytest.mark.parametrize("case", CASES[5::12], ids=lambda case: f"{case['phase']:.2f}")
def test_recorded_orbits_are_periodic_in_another_integrator_and_another_variable(case: Case) -> None:
    problem = Problem(case)
    p, n, z0 = problem.p, problem.n, case["tip_offset"] * 1e9
    start = np.array(case["state"]) * 1e9

    def depth(t: float, y: np.ndarray) -> float:
        return float(p.base * math.cos(p.w * t) + y[:n].sum() - z0)

    def speed(t: float, y: np.ndarray) -> float:
        return float(y[n : 2 * n].sum() - p.base * p.w * math.sin(p.w * t))

    def rhs(t: float, y: np.ndarray) -> np.ndarray:
        d = depth(t, y)
        force = -p.f0 / (1 - min(d, 0.0) / p.d0) ** 2 + p.hertz * max(d, 0.0) ** 1.5
        force += p.alpha * max(d, 0.0) ** p.exponent * speed(t, y)
        push = p.force_cos * math.cos(p.w * t) + p.force_sin * math.sin(p.w * t)
        bent = push - p.damping * y[n : 2 * n] - p.r**2 * y[:n] - p.inverse_mass * force
        return np.concatenate([y[n : 2 * n], bent, y[:n] * math.cos(p.w * t), y[:n] * math.sin(p.w * t)])

    end = 2 * math.pi / p.w * case["periods"]
    y, t, done = np.concatenate([start, np.zeros(2 * n)]), 0.0, False
    depth.terminal = True  # type: ignore[attr-defined] # integration is begun anew where the force has its corner
    while not done:
        outside = depth(t, y) + 1e-6 * speed(t, y) < 0
        depth.direction = 1 if outside else -1  # type: ignore[attr-defined] # not the crossing that was just found
        steps = solve_ivp(rhs, (t, end), y, "DOP853", rtol=1e-11, atol=1e-12, events=depth)
        t, y, done = steps.t[-1], steps.y[:, -1], steps.status == 0
    modes = (y[2 * n : 3 * n] - 1j * y[3 * n :]) * 2 / end
    seen = problem.weights @ modes
    # 100 steps in a period, each within 1e-11 of 10 to 50 nm.
    assert y[: 2 * n] == pytest.approx(start, abs=1e-7)
    assert abs(seen) == pytest.approx(problem.target, rel=1e-9)
    assert math.degrees(np.angle(seen) - problem.zero) == pytest.approx(case["phase"], abs=1e-7)


def test_every_mode_feels_the_same_force_and_energy_is_conserved() -> None:
    for case in CASES:
        problem = Problem(case)
        p, r = problem.p, problem.ratio
        modes = np.array(case["mode_amplitude"]) * 1e9 * np.exp(1j * np.radians(case["mode_phase"])) / 1j
        push = p.force_cos - 1j * p.force_sin
        force = (push - (r**2 - p.w**2 + 1j * p.w * p.damping) * modes) / p.inverse_mass
        # Terms that cancel, each as exact as the integration.
        terms = problem.stiffness * abs(modes)
        assert force == pytest.approx(np.full(len(force), force[0]), abs=1e-10 * float(terms.max()))
        # What modes and base give through the tip stays in the sample.
        given = -np.array(case["from_taps"]) / (case["stiffness"] * 1e-18)
        by_base = math.pi * p.base * force[0].imag
        kept = case["dissipated"] / (case["stiffness"] * 1e-18)
        assert kept == pytest.approx(given.sum() + by_base, abs=1e-9 * p.scale**2)
