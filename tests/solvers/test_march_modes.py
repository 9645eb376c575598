"""The march in time of levers with several eigenmodes: against the independent code, and against what must hold."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from beams import CASES, material_of, scope_of
from cases import Case, hold_in_time

import phasemap as pm
from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement import holding_in_time
from phasemap._kernels.excitation import detected_signal
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever_modes import mode_of
from phasemap._kernels.orbits.time import march, period_map
from phasemap._kernels.orbits.time import tip as of_tip
from phasemap._kernels.orbits.time.modes import drive_of_mode, harmonic_of_mode
from phasemap._kernels.orbits.time.surface_memory import memory_size
from phasemap._kernels.orbits.time.tip import (
    Z0,
    MovingTip,
    PeriodMap,
    PeriodResult,
    Periods,
    V,
    Z,
    coordinate_count,
    new_state,
)
from phasemap._kernels.rows.answers import Answers
from phasemap.solvers.problem import Work, work_of_material
from phasemap.solvers.solver import March

PERIODIC = [case for case in CASES if case["periods"] == 1]
ETA = 0.25


def name_of(case: Case) -> str:
    return f"{case['group']}, {case['phase']:.2f}"


def problem_of(case: Case, **lever: Any) -> tuple[Oscillator, float]:
    """The oscillator of a case, and the amplitude that its detector is to see [m]."""
    scope = scope_of(case)
    scope = replace(scope, cantilever=replace(scope.cantilever, **lever))
    work = work_of_material(material_of(case), scope, case["setpoint"] * scope.driven_amplitude)
    return work.oscillator(0), float(work.amplitudes[0])


def settled(case: Case, eta: float = ETA, **lever: Any) -> tuple[np.ndarray, Oscillator]:
    """Result row of the orbit that holds the setpoint, marched from a harmonic motion at the tip offset of a case."""
    oscillator, amplitude = problem_of(case, **lever)
    row = np.zeros(col.COLUMNS)
    row[[col.TIP_OFFSET, col.AMPLITUDE, col.PHASE]] = case["tip_offset"], amplitude, math.radians(case["phase"])
    assert hold_in_time(oscillator, amplitude, eta, 100_000, row) == col.GOOD
    return row, oscillator


def tip_on(oscillator: Oscillator, row: np.ndarray) -> MovingTip:
    """A tip on the orbit of a result row, but for its harmonics."""
    state = holding_in_time.state_on(oscillator.law, oscillator.lever, row[col.AMPLITUDE], row)
    return MovingTip(state, PeriodResult(), PeriodMap(), Periods())


@kernel
def settle_on_orbit(oscillator: Oscillator, tip: MovingTip) -> bool:
    """A shared kernel as others call it: Python would compile it anew."""
    return period_map.skip_transient(oscillator, period_map.Tolerance(ETA, 1e-16, 1e-16), 0.0, tip)


@pytest.mark.parametrize("case", PERIODIC, ids=name_of)
def test_a_settled_march_is_on_the_orbit_of_the_independent_code(case: Case) -> None:
    row, oscillator = settled(case)
    amplitude, phase = detected_signal(oscillator.lever, row[col.AMPLITUDE], row[col.PHASE])
    assert amplitude == pytest.approx(case["setpoint"] * scope_of(case).driven_amplitude, rel=1e-9)
    # Steps of this size are stated to be off by 5e-5 degree and 0.01 pm at most; here they are by less.
    assert math.degrees(phase) == pytest.approx(case["phase"], abs=1e-6)
    assert row[col.TIP_OFFSET] == pytest.approx(case["tip_offset"], abs=1e-16)
    assert row[col.INDENTATION] == pytest.approx(case["indentation"], abs=1e-14)
    assert row[col.DISSIPATION] == pytest.approx(case["dissipated"], rel=1e-6, abs=1e-27)
    # Derivatives by differences, of which multipliers near 1 make more.
    assert row[col.FLOQUET] == pytest.approx(case["spectral_radius"], abs=2e-5)
    assert abs(row[col.CLOSURE]) < 1e-8


@pytest.mark.parametrize("case", [case for case in PERIODIC if case["from_far"]][::6], ids=name_of)
def test_a_pixel_is_marched_to_the_orbit_that_a_tip_from_far_finds(case: Case) -> None:
    pixel = pm.solve_pixel(material_of(case), scope_of(case), case["setpoint"], solver="march")
    assert pixel.status.name == "good"
    assert pixel.phase == pytest.approx(case["phase"], abs=1e-6)
    assert pixel.tip_offset == pytest.approx(case["tip_offset"], abs=1e-16)


@pytest.mark.parametrize("case", [case for case in PERIODIC if case["from_far"]][::4], ids=name_of)
def test_a_tip_that_is_lowered_in_time_finds_the_branch_of_the_independent_code(case: Case) -> None:
    oscillator, amplitude = problem_of(case)
    law, p, lever = oscillator
    answers = Answers(np.full((1, col.COLUMNS), np.nan), np.zeros(1, np.int8), np.zeros(1, np.int8))
    March().engage(Work(law, np.array([p]), lever, np.array([amplitude])), np.arange(1), answers, 100_000)
    assert answers.status[0] == col.GOOD
    _, phase = detected_signal(lever, *answers.rows[0, [col.AMPLITUDE, col.PHASE]])
    assert math.degrees(phase) == pytest.approx(case["phase"], abs=1e-6)


@pytest.mark.parametrize("case", [case for case in CASES if case["periods"] == 2], ids=name_of)
def test_a_motion_that_repeats_itself_after_two_periods_is_held_in_the_mean(case: Case) -> None:
    pixel = pm.solve_pixel(material_of(case), scope_of(case), case["setpoint"], solver="march")
    assert pixel.phase_spread > 0
    assert abs(pixel.phase - case["phase"]) < pixel.error_phase
    assert abs(pixel.tip_offset - case["tip_offset"]) < pixel.error_height


@pytest.mark.parametrize("case", [PERIODIC[0], PERIODIC[-1]], ids=name_of)
def test_modes_move_at_the_drive_frequency_as_the_independent_code_says(case: Case) -> None:
    row, oscillator = settled(case, 0.15)
    lag = math.pi / 2 - row[col.PHASE]
    tip = row[col.AMPLITUDE] * complex(math.cos(lag), -math.sin(lag))
    lever, scope = oscillator.lever, scope_of(case)
    # Modes count from where the base has them, the first with the rest of the base's motion.
    shifts = np.array([mode.participation for mode in scope.cantilever.eigenmodes], float)
    shifts[0] = 1 - shifts[1:].sum()
    shifts *= scope.base_amplitude if case["excitation"] == "base" else 0.0
    for i, (amplitude, phase) in enumerate(zip(case["mode_amplitude"], case["mode_phase"], strict=True)):
        of_drive = harmonic_of_mode(lever, i, tip) * complex(lever[col.TURN_COS], lever[col.TURN_SIN]) - shifts[i]
        assert 1j * of_drive == pytest.approx(amplitude * np.exp(1j * math.radians(phase)), rel=1e-8)


@pytest.mark.parametrize("case", [PERIODIC[0], PERIODIC[-3]], ids=name_of)
@pytest.mark.filterwarnings("ignore::phasemap.PlausibilityWarning")
@pytest.mark.parametrize(("ratio", "stiffness"), [(7.5, math.inf), (900.0, 900.0**2)])
def test_a_second_mode_that_is_stiff_changes_nothing(case: Case, ratio: float, stiffness: float) -> None:
    one, oscillator = settled({**case, "excitation": "direct"}, modes=())
    stiff = pm.Eigenmode(ratio, 100.0, stiffness if stiffness < math.inf else 1e18, 1.0, 1.0)
    other, of_two = settled({**case, "excitation": "direct"}, modes=(stiff,))
    # What it gives way by is its compliance.
    give = 1 / stiffness
    assert other[col.PHASE] == pytest.approx(one[col.PHASE], abs=1e-9 + 20 * give)
    assert other[col.TIP_OFFSET] == pytest.approx(one[col.TIP_OFFSET], abs=1e-16 + 20 * give * one[col.AMPLITUDE])
    assert of_two.lever[col.MODES] == 2 > oscillator.lever[col.MODES]


@pytest.mark.parametrize("group", ["table", "liquid, three modes", "air"])
def test_the_error_is_of_order_eight(group: str) -> None:
    case = next(case for case in PERIODIC if case["group"] == group and case["modulus"] > 0.5e9)
    row, oscillator = settled(case)
    etas, ends = 0.5 * 2.0 ** (-np.arange(7) / 4), []
    for eta in [0.06, *etas]:
        tip = tip_on(oscillator, row)
        for _ in range(3):
            assert march.march_oscillator(oscillator, tip.u[Z0], eta, tip.u, tip.acc) > 0
        ends.append(np.array([*np.delete(tip.u, Z0), tip.acc.cos, tip.acc.sin]))
    errors = np.abs(np.array(ends[1:]) - ends[0]).max(axis=1)
    assert np.polyfit(np.log(etas), np.log(errors), 1)[0] == pytest.approx(8, abs=0.8)
    assert errors[-1] < 1e-10 * row[col.AMPLITUDE]


@pytest.mark.parametrize("modes", [2, 3, 4])
def test_a_free_lever_moves_and_decays_as_formulas_say(modes: int) -> None:
    lever = pm.Cantilever(0.1, 20e3, 2.5, modes=modes)
    scope = pm.Microscope(lever, pm.Tip(10e-9), pm.Drive(10e-9, excitation="base"), pm.Interaction("dmt"))
    work = work_of_material(pm.Material(1e9), scope, 8e-9)
    oscillator = work.oscillator(0)
    omega, drive = work.lever[col.OMEGA], work.lever[col.DRIVE]
    free = drive / complex(work.lever[col.DYNAMIC_STIFFNESS], work.lever[col.DYNAMIC_LOSS])
    state = new_state(work.law, work.lever, 0.0, free.real, -omega * free.imag, 3e-8)
    tip = MovingTip(state.copy(), PeriodResult(), PeriodMap(), Periods())
    assert march.march_oscillator(oscillator, 3e-8, 0.1, tip.u, tip.acc) > 0
    assert tip.u == pytest.approx(state, abs=1e-13 * abs(free))
    assert [tip.acc.cos, -tip.acc.sin] == pytest.approx([free.real, free.imag], abs=1e-12 * abs(free))
    # By Liouville's theorem the volume of neighbours falls by what all modes lose; differences leave 1e-7 or so.
    assert period_map.linearise_period(oscillator, 0.1, tip)
    n = coordinate_count(work.lever)
    monodromy = np.eye(n) + np.array(tip.linear.motion)[: n * n].reshape(n, n).T
    rates = np.array([0.5 * mode.frequency_ratio / mode.quality_factor for mode in lever.eigenmodes])
    assert np.linalg.det(monodromy) == pytest.approx(math.exp(-4 * math.pi / omega * rates.sum()), rel=1e-5, abs=1e-9)
    assert of_tip.floquet_multiplier(tip.linear) == pytest.approx(
        math.exp(-2 * math.pi / omega * rates.min()), abs=1e-6
    )


def test_neighbours_of_a_tapping_lever_come_nearer_as_the_modes_lose_energy() -> None:
    case = next(case for case in PERIODIC if case["group"] == "table")
    row, oscillator = settled(case)
    tip = tip_on(oscillator, row)
    assert settle_on_orbit(oscillator, tip)
    monodromy = np.eye(4) + np.array(tip.linear.motion)[:16].reshape(4, 4).T
    rates = 0.5 / 2.5 + 0.5 * 7.5 / 6.0
    assert np.linalg.det(monodromy) == pytest.approx(math.exp(-4 * math.pi * rates), rel=1e-3)
    assert row[col.FLOQUET] == pytest.approx(np.abs(np.linalg.eigvals(monodromy)).max(), rel=1e-5)


def test_a_contact_that_a_mode_makes_again_within_a_flight_is_found() -> None:
    case = next(case for case in PERIODIC if case["touches"] == 2)
    row, oscillator = settled(case)
    tip = tip_on(oscillator, row)
    for _ in range(60):
        assert march.march_oscillator(oscillator, row[col.TIP_OFFSET], ETA, tip.u, tip.acc) > 0
    found = tip.acc.cos, tip.acc.sin
    for _ in range(60):  # in steps so short that none has two contacts
        assert march.march_oscillator(oscillator, row[col.TIP_OFFSET], 0.2 * ETA, tip.u, tip.acc) > 0
    assert (tip.acc.cos, tip.acc.sin) == pytest.approx(found, abs=1e-9 * row[col.AMPLITUDE])
    assert tip.u[Z] < row[col.TIP_OFFSET] or tip.u[V] != 0.0


def test_the_branch_of_a_soft_lever_is_that_of_a_tip_lowered_in_time() -> None:
    # The second mode swings at the sixth harmonic: a start on the averaged orbit, without it, ends on the other branch.
    lever = pm.Cantilever(0.383, 70e3, 151.9, modes=(pm.Eigenmode(6.12, 322.7),))
    scope = pm.Microscope(lever, pm.Tip(17.6e-9), pm.Drive(54.2e-9, excitation="base"), pm.Interaction("dmt", 2e-10))
    pixel = pm.solve_pixel(pm.Material(24.4e9, 0.0474, damping=0.0255), scope, 0.7916, solver="march")
    assert pixel.branch == "attractive"
    assert pixel.phase == pytest.approx(-37.9, abs=0.1)


SOLID = pm.Material(0.2e9, 0.01, relaxed_modulus=0.1e9, relaxation_time=1e-7)


def relaxing_scope(modes: int) -> pm.Microscope:
    interaction = pm.Interaction("dmt", None, withdrawal="ting")
    return pm.Microscope(pm.Cantilever(2.0, 70e3, 150.0, modes=modes), pm.Tip(10e-9), pm.Drive(20e-9), interaction)


@pytest.mark.parametrize("modes", [1, 3])
def test_over_a_solid_that_relaxes_a_lever_moves_as_over_independent_elements(modes: int) -> None:
    # Theory, Eq. (memory-2): elements in equal steps of second order, and the modes as so many springs and masses.
    work = work_of_material(SOLID, relaxing_scope(modes), 14e-9, marched=True)
    lever, p, omega, z0 = work.lever, work.rows[0], float(work.lever[col.OMEGA]), 12e-9
    steps, x = 6000, math.sqrt(12e-9) * (np.arange(400) + 0.5) / 400
    own = [mode_of(lever, i) for i in range(modes)]
    drive = [drive_of_mode(lever, i) for i in range(modes)]
    y, pushed = np.zeros((modes, 2)), np.zeros_like(x)
    y[0] = -18e-9, 0.0
    state, acc = np.zeros(memory_size(1)), PeriodResult()
    state[Z] = -18e-9

    def rates(y: np.ndarray, w: np.ndarray, tau: float) -> tuple[np.ndarray, np.ndarray]:
        d = y[:, 0].sum() - z0
        kept = np.maximum(d - x**2, p[col.RELAXING] * w)
        force = 1.5 * p[col.CONTACT] * np.maximum(d - x**2 - p[col.RELAXING] * w, 0.0).sum() * (x[1] - x[0])
        force = (force - (p[col.PULL] if d > p[col.RELAXING] * w[0] else 0.0)) / lever[col.STIFFNESS]
        turned = complex(math.cos(omega * tau), math.sin(omega * tau))
        a = [
            (drive[i] * turned).real - own[i].share * force - own[i].square * y[i, 0] - 2 * own[i].rate * y[i, 1]
            for i in range(modes)
        ]
        return np.stack([y[:, 1], np.array(a)], axis=1), (kept - w) / p[col.RELAXATION]

    h = 2 * math.pi / omega / steps
    for period in range(2):
        for j in range(steps):
            tau = (period * steps + j) * h
            dy, dw = rates(y, pushed, tau)
            dy, dw = rates(y + 0.5 * h * dy, pushed + 0.5 * h * dw, tau + 0.5 * h)
            y, pushed = y + h * dy, pushed + h * dw
        assert march.march_oscillator(work.oscillator(0), z0, 0.2, state, acc) > 0
        assert acc.deepest > 2e-9
        # 6000 steps and 400 elements: 1e-4 of the amplitude with one mode as with several.
        assert (state[Z], state[V]) == pytest.approx((y[:, 0].sum(), y[:, 1].sum()), abs=2e-4 * 18e-9)


@pytest.mark.parametrize("solver", ["auto", "march"])
def test_energy_closes_over_a_solid_that_relaxes_under_a_lever_with_several_modes(solver: str) -> None:
    pixel = pm.solve_pixel(SOLID, relaxing_scope(2), 0.7, solver)
    assert pixel.status is pm.Status.good and pixel.solver == "march"
    assert abs(pixel.energy_closure) < 1e-7
    # 0.06 degree of the second mode, beside 3.1 of relaxation.
    assert pixel.phase - pm.solve_pixel(SOLID, relaxing_scope(1), 0.7).phase == pytest.approx(0.06, abs=0.005)


def test_a_solid_that_does_not_relax_is_the_elastic_one_under_a_lever_with_several_modes() -> None:
    nearly = replace(SOLID, relaxed_modulus=0.2e9 * (1 - 1e-7))
    elastic = pm.solve_pixel(pm.Material(0.2e9, 0.01), relaxing_scope(3), 0.7)
    assert pm.solve_pixel(nearly, relaxing_scope(3), 0.7).phase == pytest.approx(elastic.phase, abs=1e-5)
