"""Contacts that remember: Ting's theory in time, against elements in equal steps (`tests/reference/make_memory.py`)."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import phasemap as pm
from phasemap._kernels import columns as col
from phasemap._kernels.orbits.averaged.harmonics import harmonics
from phasemap._kernels.orbits.time.march import march_oscillator
from phasemap._kernels.orbits.time.surface_memory import memory_size
from phasemap._kernels.orbits.time.tip import PeriodResult
from phasemap.solvers.problem import work_of_material
from phasemap.solvers.run import run
from phasemap.solvers.solver import FromFar, March, OnlyInTime

KNOWN = json.loads((Path(__file__).parent.parent / "data" / "memory.json").read_text())
PROPERTIES = ("modulus", "adhesion", "viscosity", "relaxed_modulus", "relaxation_time")
SOLID = {"modulus": 2e9, "relaxed_modulus": 1e9, "relaxation_time": 100e-9}


def scope_of(case: dict[str, Any] | None = None, **interaction: Any) -> pm.Microscope:
    known = {"quality_factor": 400.0, "free_amplitude": 40e-9, "decay_length": None, **(case or {})}
    laws = {"contact": "dmt", "decay_length": known["decay_length"], "withdrawal": "ting", **interaction}
    lever = pm.Cantilever(40.0, 300e3, known["quality_factor"])
    return pm.Microscope(lever, pm.Tip(10e-9), pm.Drive(known["free_amplitude"]), pm.Interaction(**laws))


def pixel_of(setpoint: float = 0.6, solver: str = "auto", **material: Any) -> pm.Pixel:
    pixel = pm.solve_pixel(pm.Material(**material), scope_of(), setpoint, solver)
    assert pixel.status is pm.Status.good
    return pixel


def what(case: dict[str, Any]) -> str:
    """Name of a case."""
    loss = "viscosity" if "viscosity" in case else "relaxation_time"
    return f"{loss} {case[loss]:g}, w {case['adhesion']:g}, Q {case['quality_factor']:g}"


@pytest.mark.parametrize("solver", ["auto", "march"])
@pytest.mark.parametrize("case", KNOWN["orbits"], ids=what)
def test_it_is_the_orbit_of_independent_elements(case: dict[str, Any], solver: str) -> None:
    material = pm.Material(**{name: case[name] for name in PROPERTIES if name in case})
    pixel = pm.solve_pixel(material, scope_of(case), case["setpoint"], solver)
    assert pixel.status is pm.Status.good
    assert pixel.solver == "march"
    assert case["error"] < 1e-5  # degree, of the reference
    assert pixel.phase == pytest.approx(case["phase"], abs=1e-4)
    # A phase off by 1e-4 degree is a force off by some 1e-5, and so are the energies; a depth of 5 nm by 0.05 pm.
    assert pixel.tip_offset == pytest.approx(case["tip_offset"], abs=5e-14)
    assert pixel.indentation == pytest.approx(case["indentation"], abs=5e-14)
    assert pixel.dissipation == pytest.approx(case["dissipation"], rel=1e-5)
    assert pixel.virial == pytest.approx(case["virial"], rel=1e-5)
    # What the surface takes is the integral of F z', by the same steps or nodes.
    assert abs(pixel.energy_closure) < 1e-5


@pytest.mark.parametrize("case", KNOWN["histories"], ids=("never off", "sticking", "several taps"))
def test_the_contact_goes_on_from_whatever_was_before(case: dict[str, Any]) -> None:
    material = pm.Material(**{name: case[name] for name in PROPERTIES if name in case})
    work = work_of_material(material, scope_of(case), 1e-9, marched=True)
    y, acc, amplitude = np.zeros(memory_size(1)), PeriodResult(), case["free_amplitude"]
    y[:2] = case["start"]
    assert case["error"] < 1e-6
    for z, v, lost in case["states"]:
        assert march_oscillator(work.oscillator(0), case["tip_offset"], 0.12, y, acc) > 0
        # The root of a turn before, which a contact passes as it grows again, is no end of a step: 1.4e-5 of A here.
        np.testing.assert_allclose(y[:2], (z, v), rtol=0, atol=3e-5 * amplitude)
        assert acc.loss == pytest.approx(lost, rel=1e-4)


@pytest.mark.parametrize(("ratio", "time"), [(15.0, 1.5e-6), (5.0, 1.9e-6)])
def test_dents_that_nearly_fit_the_tip_do_not_stall_a_march(ratio: float, time: float) -> None:
    relaxes = {"modulus": 2e9, "relaxed_modulus": 2e9 / ratio, "relaxation_time": time, "adhesion": 0.02}
    scope = scope_of({"quality_factor": 60.0, "decay_length": 0.3e-9})
    work = work_of_material(pm.Material(**relaxes), scope, 20e-9, marched=True)
    y, acc = np.zeros(memory_size(1)), PeriodResult()
    y[:2] = 20e-9, 22e-9
    for z0 in np.linspace(26e-9, 16e-9, 160):  # lowered far faster than dents recover
        assert 0 < march_oscillator(work.oscillator(0), z0, 0.5, y, acc) < 500
        assert abs(y[0]) < 60e-9


def test_a_solid_that_has_no_time_to_relax_is_elastic() -> None:
    # What is lost goes with the time of contact over the relaxation time: 0.65 degree at 1 us is 7e-5 at 10 ms.
    slow = pixel_of(**{**SOLID, "relaxation_time": 1e-2})
    assert slow.phase == pytest.approx(pixel_of(modulus=2e9, solver="orbit").phase, abs=1e-4)


def test_a_solid_that_relaxes_at_once_has_its_relaxed_modulus() -> None:
    fast = [pixel_of(**{**SOLID, "relaxation_time": time}) for time in (2e-9, 4e-9)]
    # The loss begins as the first power of the time; the second left is some (4 ns over 100 ns of contact)^2 of it.
    soft = pixel_of(modulus=1e9, solver="orbit")
    assert 2 * fast[0].phase - fast[1].phase == pytest.approx(soft.phase, abs=0.01)
    assert fast[0].phase < soft.phase - 0.05
    assert 2 * fast[0].tip_offset - fast[1].tip_offset == pytest.approx(soft.tip_offset, abs=2e-12)


def test_a_solid_that_does_not_relax_is_the_elastic_one_to_the_last_bit() -> None:
    same, elastic = pixel_of(**{**SOLID, "relaxed_modulus": 2e9}), pixel_of(modulus=2e9)
    assert (same.phase, same.height, same.solver) == (elastic.phase, elastic.height, elastic.solver)


def test_without_adhesion_the_law_without_adhesion_is_the_same() -> None:
    hertz = pm.solve_pixel(pm.Material(**SOLID), scope_of(contact="hertz"), 0.6)
    assert hertz.phase == pixel_of(**SOLID).phase


def test_an_elastic_tip_leaves_the_time_of_recovery_alone() -> None:
    tip = pm.Tip(10e-9, modulus=4e9, poisson_ratio=0.35)
    scope = replace(scope_of(), tip=tip)
    compliant = pm.solve_pixel(pm.Material(**SOLID), scope, 0.6)
    # In series with a spring of 4 GPa, 2 and 1 GPa are 4/3 and 4/5 GPa; 100 ns times (2/1) (4/5)/(4/3) are 120 ns.
    alike = pixel_of(modulus=4e9 / 3, relaxed_modulus=0.8e9, relaxation_time=120e-9)
    assert compliant.phase == pytest.approx(alike.phase, abs=1e-6)


def test_an_attraction_gives_back_what_it_takes() -> None:
    # The dent is gone before the next tap, not on the way out. Without its work 0.5 % of the energy would be missing.
    material = pm.Material(modulus=2e9, adhesion=0.05, relaxed_modulus=1e9, relaxation_time=10e-9)
    pixel = pm.solve_pixel(material, scope_of({"decay_length": 0.3e-9}), 0.6)
    assert abs(pixel.energy_closure) < 1e-5


@pytest.mark.parametrize("viscous", [{}, {"viscosity": 20.0}])
def test_where_averaging_tells_the_orbit_it_is_that_from_far(viscous: dict[str, float]) -> None:
    kind = viscous or {"relaxed_modulus": 0.5e9, "relaxation_time": 50e-9}
    scope = scope_of({"quality_factor": 60.0, "decay_length": 0.3e-9})
    work = work_of_material(pm.Material(modulus=1e9, adhesion=0.05, **kind), scope, 0.6 * 40e-9, marched=True)
    near, far = (run(solver, work, pm.Accuracy())[0][0] for solver in (March(), FromFar()))
    # Both are known to 5e-5 degree and 0.01 pm, as they state.
    assert near[col.PHASE] == pytest.approx(far[col.PHASE], abs=math.radians(1e-4))
    assert near[col.TIP_OFFSET] == pytest.approx(far[col.TIP_OFFSET], abs=2e-14)


@pytest.mark.parametrize(
    ("modulus", "adhesion", "setpoint", "attracted"),
    [(6.1e9, 0.159, 0.7, True), (14e9, 0.173, 0.7, False), (4e9, 0.145, 0.5, False), (4e9, 0.15, 0.5, True)],
)
def test_where_averaging_leaves_the_side_open_time_decides_on_either_side_of_the_end_of_the_branch(
    modulus: float, adhesion: float, setpoint: float, attracted: bool
) -> None:
    # At 0.7 the setpoint decides, at 0.5 the amplitude above it at which the branch is narrowest, 1/sqrt(3).
    scope = scope_of({"free_amplitude": 20e-9, "decay_length": 0.3e-9})
    solid = pm.Material(modulus, adhesion, relaxed_modulus=0.5 * modulus, relaxation_time=30e-9)
    work = work_of_material(solid, scope, setpoint * 20e-9, marched=True)
    rows, status, _ = run(OnlyInTime(March()), work, pm.Accuracy())
    assert status[0] == col.GOOD
    assert (rows[0, col.PHASE] < 0) == attracted
    few = pm.Accuracy(periods=300)  # engaging from far takes a thousand and more, an orbit that is known a hundred
    assert run(OnlyInTime(March()), work, few)[1][0] == col.NOT_SETTLED


def test_a_tip_lifted_by_harmonics_is_looked_at_where_it_is_attracted_most() -> None:
    # Above the resonance, averaged motion at the largest attraction is 0.05 nm deep; with harmonics the tip is 0.11 nm
    # off there and needs 40 % less drive. As deep as averaging says it needs 6 % more: the branch goes on.
    scope = pm.Microscope(
        pm.Cantilever(0.63, 300e3, 179.0), pm.Tip(11.2e-9), pm.Drive(100.9e-9, 301950.0),
        pm.Interaction("dmt", 0.3e-9, withdrawal="ting"),
    )  # fmt: skip
    solid = pm.Material(7e9, 0.0267, relaxed_modulus=1.33e9, relaxation_time=660e-9)
    work = work_of_material(solid, scope, 0.4776 * scope.driven_amplitude, marched=True)
    (near, _, _), (far, _, _) = (run(solver, work, pm.Accuracy()) for solver in (OnlyInTime(March()), FromFar()))
    assert near[0, col.PHASE] == pytest.approx(far[0, col.PHASE], abs=math.radians(1e-4))


def test_below_the_resonance_dents_that_last_but_attract_nothing_lead_to_the_orbit_from_far() -> None:
    # At 0.95 of the resonance; dents last for relaxation_time modulus/relaxed_modulus, nearly four periods.
    scope = pm.Microscope(
        pm.Cantilever(20.0, 300e3, 60.0), pm.Tip(20e-9), pm.Drive(240e-9, 285e3), pm.Interaction(contact="hertz")
    )
    solid = pm.Material(modulus=0.5e9, relaxed_modulus=0.1e9, relaxation_time=2.5e-6)
    work = work_of_material(solid, scope, 0.7 * scope.driven_amplitude, marched=True)
    near, far = (run(solver, work, pm.Accuracy())[0][0] for solver in (OnlyInTime(March()), FromFar()))
    # Lasting dents have kinks: both are known as they state.
    assert abs(near[col.PHASE] - far[col.PHASE]) < near[col.ERROR_PHASE] + far[col.ERROR_PHASE]
    assert abs(near[col.TIP_OFFSET] - far[col.TIP_OFFSET]) < near[col.ERROR_HEIGHT] + far[col.ERROR_HEIGHT]


def test_a_tap_through_drive_phase_0_is_as_exact_as_others() -> None:
    # Its lag is 67 degrees, and it is in contact for half of the period. Steps that meet a kink of the dent, as those
    # of an eighth do here, miss some energy, and state the larger error that this makes.
    scope = pm.Microscope(
        pm.Cantilever(38.0, 300e3, 32.0), pm.Tip(7e-9), pm.Drive(7e-9), pm.Interaction("dmt", decay_length=None)
    )
    solid = pm.Material(modulus=3.3e9, relaxed_modulus=0.17e9, relaxation_time=39e-9, adhesion=0.03)
    work = work_of_material(solid, scope, 0.67 * 7e-9, marched=True)
    phase, stated = [], []
    for share in (1, 2, 4, 8):
        solver = OnlyInTime(March())
        solver.eta /= share
        rows, _, _ = run(solver, work, pm.Accuracy())
        phase.append(rows[0, col.PHASE])
        stated.append(rows[0, col.ERROR_PHASE])
    best = int(np.argmin(stated[1:])) + 1
    assert stated[0] < math.radians(1e-4)
    assert abs(phase[0] - phase[best]) < stated[0]
    for one, error in zip(phase, stated, strict=True):
        assert abs(one - phase[0]) < stated[0] + error


@pytest.mark.slow
def test_an_orbit_on_which_taps_take_less_the_farther_the_tip_swings_is_left_to_time() -> None:
    # Both of its multipliers are 1.0035 in size: what disturbs it grows, until the tip moves in beats.
    scope = pm.Microscope(
        pm.Cantilever(6.386, 300e3, 533.0),
        pm.Tip(18.93e-9),
        pm.Drive(71.31e-9),
        pm.Interaction("dmt", 0.3e-9, withdrawal="ting"),
    )
    solid = pm.Material(2.3e9, 0.07528, relaxed_modulus=0.1763e9, relaxation_time=12.77e-9)
    pixel = pm.solve_pixel(solid, scope, 0.7444)
    assert (pixel.solver, pixel.motion) == ("march", "irregular")


def test_dents_deeper_than_taps_are_formed_before_the_orbit_is_sought() -> None:
    # They last for 134 periods, and let the tip down by another 2 nm. Engaging from far does not settle.
    scope = pm.Microscope(
        pm.Cantilever(5.1, 300e3, 208.0), pm.Tip(5e-9), pm.Drive(34.3e-9),
        pm.Interaction("dmt", 0.3e-9, withdrawal="ting"),
    )  # fmt: skip
    solid = pm.Material(0.097e9, 0.0612, relaxed_modulus=0.0235e9, relaxation_time=108e-6)
    work = work_of_material(solid, scope, 0.43 * 34.3e-9, marched=True)
    solvers = OnlyInTime(March()), OnlyInTime(March())
    solvers[1].eta *= 0.7
    (known, status, _), (finer, _, _) = (run(solver, work, pm.Accuracy()) for solver in solvers)
    assert status[0] == col.GOOD
    assert abs(known[0, col.PHASE] - finer[0, col.PHASE]) < known[0, col.ERROR_PHASE]
    assert known[0, col.FLOQUET] < 1.0


def test_a_tip_engaged_from_far_is_held_as_exactly_as_one_that_begins_near() -> None:
    # Its lag is 40 degrees, that of the free lever 151: engaged from far, its periods begin in contact, where what is
    # remembered is known to 1e-4 degree only.
    scope = pm.Microscope(
        pm.Cantilever(20.0, 300e3, 46.0), pm.Tip(10e-9), pm.Drive(20e-9, 305.9e3),
        pm.Interaction("dmt", 0.3e-9, withdrawal="ting"),
    )  # fmt: skip
    solid = pm.Material(modulus=2e9, relaxed_modulus=0.2e9, relaxation_time=18e-9, adhesion=0.05)
    work = work_of_material(solid, scope, 0.53 * scope.driven_amplitude, marched=True)
    near, far = (run(solver, work, pm.Accuracy())[0][0] for solver in (OnlyInTime(March()), FromFar()))
    assert abs(near[col.PHASE] - far[col.PHASE]) < near[col.ERROR_PHASE] + far[col.ERROR_PHASE]


def test_a_tip_that_attraction_holds_off_is_as_exact_as_others() -> None:
    # 0.3 nm of attraction in a swing of 14 nm; half the steps make errors 250 times smaller.
    scope = scope_of({"free_amplitude": 14e-9, "decay_length": 0.3e-9})
    solid = pm.Material(modulus=5.5e9, relaxed_modulus=2.74e9, relaxation_time=30e-9, adhesion=0.12)
    work = work_of_material(solid, scope, 0.9 * 14e-9, marched=True)
    solvers = OnlyInTime(March()), OnlyInTime(March())
    solvers[1].eta /= 2
    (known, _, _), (finer, _, _) = (run(solver, work, pm.Accuracy()) for solver in solvers)
    assert abs(known[0, col.PHASE] - finer[0, col.PHASE]) < known[0, col.ERROR_PHASE]


def test_the_steps_do_not_decide_on_which_side_of_resonance_a_tip_is_held() -> None:
    # It reaches 0.14 nm deep. Lifted by 0.2 nm without its orbit it grows free, and lands on the other side.
    scope = pm.Microscope(
        pm.Cantilever(2.25, 300e3, 424.0), pm.Tip(6.4e-9), pm.Drive(31.1e-9, 300441.0),
        pm.Interaction("dmt", None, withdrawal="ting"),
    )  # fmt: skip
    solid = pm.Material(modulus=0.662e9, relaxed_modulus=0.319e9, relaxation_time=690e-9, adhesion=0.01184)
    work = work_of_material(solid, scope, 0.523 * 31.1e-9, marched=True)
    solvers = OnlyInTime(FromFar()), OnlyInTime(FromFar())
    solvers[1].eta *= 0.6
    (known, _, _), (finer, _, _) = (run(solver, work, pm.Accuracy()) for solver in solvers)
    assert abs(known[0, col.PHASE] - finer[0, col.PHASE]) < known[0, col.ERROR_PHASE]


@pytest.mark.parametrize("time", [1e-10, 30e-9, 1e-4])
def test_averages_of_a_tap_are_those_of_the_elements_in_equal_steps(time: float) -> None:
    solid = pm.Material(modulus=2e9, relaxed_modulus=0.5e9, relaxation_time=time)
    work = work_of_material(solid, scope_of(), 20e-9, marched=True)
    amplitude, c, steps = 20e-9, 0.9, 4000
    push, drag, _ = harmonics(work.oscillator(0), amplitude, c)
    theta, width = np.linspace(-math.acos(c), math.acos(c), steps, retstep=True)
    d, kappa, tau = amplitude * (np.cos(theta) - c), work.rows[0, col.RELAXING], work.rows[0, col.RELAXATION]
    x = np.sqrt(d.max()) * (np.arange(400) + 0.5) / 400
    y, force = np.zeros_like(x), np.zeros(steps)
    for i in range(steps):  # theory, Eq. (memory-2): implicit, so that a short tau needs no shorter steps
        share = width / tau
        y = np.maximum((y + share * (d[i] - x**2)) / (1 + share), y / (1 + share * (1 - kappa)))
        force[i] = 1.5 * work.rows[0, col.CONTACT] * np.maximum(d[i] - x**2 - kappa * y, 0.0).sum() * (x[1] - x[0])
    scale = 1 / (math.pi * work.lever[col.STIFFNESS])
    # First order in 4000 steps and 400 elements, and 16 nodes of a low-pass: half a percent.
    assert push == pytest.approx(scale * (force * np.cos(theta)).sum() * width, rel=0.005)
    assert drag == pytest.approx(scale * (force * np.sin(theta)).sum() * width, rel=0.01, abs=0.005 * push)


def test_a_viscous_contact_that_cannot_pull_loses_less() -> None:
    material = pm.Material(modulus=1e9, viscosity=20.0)
    ting = pm.solve_pixel(material, scope_of(), 0.6)
    linear = pm.solve_pixel(material, scope_of(withdrawal="linear"), 0.6)
    assert linear.solver != "march"
    assert ting.dissipation < linear.dissipation


def test_where_nothing_is_viscous_withdrawal_changes_no_bit() -> None:
    linear = pm.solve_pixel(pm.Material(modulus=1e9), scope_of(withdrawal="linear"), 0.6)
    assert (linear.phase, linear.solver) == (pixel_of(modulus=1e9).phase, pixel_of(modulus=1e9).solver)


def test_only_the_material_that_relaxes_is_marched() -> None:
    slow = {**SOLID, "relaxation_time": 1e-6}
    solid, glass = pm.Material(**slow), pm.Material(modulus=2e9)
    surface = pm.Surface.from_labels([[0, 1]], [solid, glass], pixel_size=4e-9)
    image = pm.simulate(surface, scope_of(), 0.6)
    assert image.phase.values[0].tolist() == [pixel_of(**slow).phase, pixel_of(modulus=2e9).phase]
    flags = dict(zip(image.solver.attrs["flag_meanings"].split(), image.solver.attrs["flag_values"], strict=True))
    assert image.solver.values[0, 0] == flags["march"] != image.solver.values[0, 1]


def test_a_check_solves_it_again_from_far() -> None:
    solid, glass = pm.Material(**SOLID), pm.Material(modulus=2e9)
    surface = pm.Surface.from_labels([[0, 1]], [solid, glass], pixel_size=4e-9)
    for solver in ("auto", "march"):
        result = pm.check(pm.simulate(surface, scope_of(), 0.6, solver), surface=surface)
        assert result.holds, result.verdict


def test_a_feedback_in_time_settles_where_the_pixel_is() -> None:
    surface = pm.Surface(**SOLID, pixel_size=4e-9, shape=(1, 4))
    scope = scope_of({"quality_factor": 60.0})
    image = pm.simulate(surface, scope, 0.6, control=pm.Feedback(line_rate=8.0, engage="line"))
    pixel = pm.solve_pixel(pm.Material(**SOLID), scope, 0.6)
    assert "march" in str(image.attrs["configuration"]) or (image.solver == 2).all()
    np.testing.assert_allclose(image.phase.values, pixel.phase, atol=0.02)  # of steps of 0.7, and of a settling loop


def test_a_sweep_in_time_comes_by_the_orbits_of_pixels() -> None:
    solid, scope = pm.Material(**SOLID), scope_of({"quality_factor": 30.0})
    pixel = pm.solve_pixel(solid, scope, 0.6)
    held = pm.sweep_setpoint(solid, scope, [0.7, 0.6])
    assert held.direction.values.tolist() == ["down", "up"] and (held.status == 0).all()
    # Each orbit is known to PRECISE, 1e-5 degree and 0.01 pm.
    np.testing.assert_allclose(held.phase.sel(setpoint=0.6), pixel.phase, atol=1e-4)
    near = pm.sweep_distance(solid, scope, [1.001 * pixel.tip_offset, pixel.tip_offset])
    np.testing.assert_allclose(near.amplitude.values[:, 1], pixel.amplitude, rtol=1e-6)
    assert near.sizes["point"] == near.sizes["jump"] == 0  # there is no curve behind it
    faster = pm.sweep_parameter(solid, scope, "relaxation_time", [50e-9, 100e-9], setpoint=0.6)
    np.testing.assert_allclose(faster.phase.sel(relaxation_time=100e-9), pixel.phase, atol=1e-4)


def test_a_contrast_map_has_the_phases_of_its_pixels() -> None:
    solid, glass = pm.Material(**SOLID), pm.Material(modulus=2e9)
    found = pm.contrast(glass, solid, scope_of(), [0.6, 0.8])
    assert found.phase.values[:, 0].tolist() == [pixel_of(modulus=2e9).phase, pixel_of(**SOLID).phase]
    assert (found.contrast < 0).all()
    assert (found.regime == 2).all()  # repulsive; whether there is another is not looked for where contacts remember


def test_on_a_shaker_the_tip_moves_as_one_that_is_driven_itself() -> None:
    """z'' + z'/Q + z = Y cos(omega t) holds for both (participation 1, added masses apart); the detector sees z - y."""
    lever, solid = pm.Cantilever(40.0, 300e3, 30.0, participation=1.0), pm.Material(**SOLID, adhesion=0.03)
    shaken = pm.Microscope(lever, pm.Tip(10e-9), pm.Drive(16e-9, excitation="base"))
    pixel = pm.solve_pixel(solid, shaken, 0.8)
    y = shaken.base_amplitude
    free = -1j * lever.quality_factor * y - y  # whose phase is recorded as 0
    tip = free / abs(free) * pixel.amplitude * np.exp(1j * math.radians(pixel.phase)) + y
    direct = replace(shaken, drive=pm.Drive(lever.quality_factor * y))
    same = pm.solve_pixel(solid, direct, abs(tip) / direct.drive.free_amplitude)
    # The steps of both leave 2e-6 degree (`march_oscillator`), 3.5e-8: of an amplitude of 16 nm 6e-16 m.
    assert math.degrees(np.angle(1j * tip)) == pytest.approx(same.phase, abs=2e-6)
    assert pixel.tip_offset == pytest.approx(same.tip_offset, abs=6e-16)
    assert pixel.dissipation == pytest.approx(same.dissipation, rel=1e-7)


@pytest.mark.parametrize(
    ("asked", "sentence"),
    [
        (
            lambda m, s: pm.solve_pixel(m, s, 0.6, "orbit"),
            "solver is .orbit.; allowed: .march. or .auto. where contacts",
        ),
        (lambda m, s: pm.solve_pixel(m, s, 0.6, "averaging"), "solver is 'averaging'"),
        (lambda m, s: pm.orbits(m, s, setpoint=0.6), "surface is one that remembers"),
        (lambda m, s: pm.contrast(m, m, s, [0.6, 0.7], solver="orbit"), "solver is 'orbit'"),
        (lambda m, s: pm.sweep_setpoint(m, s, [0.6, 0.7], samples=16), "samples is 16; allowed: 0 where contacts rem"),
        (lambda m, s: pm.force_curve(m, s, [0.0, 1e-9]), "surface is one that remembers"),
        (lambda m, s: image_of(m, s, control=pm.Raster()), "control is 'Raster'.*Engage or Feedback"),
        (lambda m, s: image_of(m, s, solver="orbit"), "solver is 'orbit'"),
        (lambda m, s: image_of(m, s, variables=["adhesion_virial"]), "variables is 'adhesion_virial'"),
        (lambda m, s: image_of(m, s, variables=["loss_tangent_corrected"]), "variables is 'loss_tangent_corrected'"),
        (
            lambda m, s: image_of(
                m, replace(s, cantilever=replace(s.cantilever, modes=2), drive=replace(s.drive, second=pm.Mode()))
            ),
            "second is given; allowed: None where a surface remembers",
        ),
        (lambda m, s: pm.solve_pixel(m, replace(s, interaction=pm.Interaction("jkr")), 0.6), "contact is 'jkr'"),
    ],
)
def test_what_cannot_follow_a_memory_says_so_at_once(asked: Any, sentence: str) -> None:
    with pytest.raises(pm.InputError, match=sentence):
        asked(pm.Material(**SOLID), scope_of())


def image_of(material: pm.Material, scope: pm.Microscope, **options: Any) -> Any:
    return pm.simulate(pm.Surface.from_labels([[0]], [material], pixel_size=4e-9), scope, 0.6, **options)


def test_a_scene_says_it_with_units(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text("""
    [cantilever]
    stiffness = 40.0
    resonance_frequency = "300 kHz"
    quality_factor = 400.0
    [tip]
    radius = "10 nm"
    [drive]
    free_amplitude = "40 nm"
    [interaction]
    contact = "dmt"
    withdrawal = "ting"
    [scan]
    setpoint = 0.6
    [materials.rubber]
    modulus = "2 GPa"
    relaxed_modulus = "1 GPa"
    relaxation_time = "100 ns"
    [materials.glass]
    modulus = "2 GPa"
    [surface]
    kind = "labels"
    labels = [[0, 1]]
    materials = ["rubber", "glass"]
    pixel_size = "4 nm"
    """)
    scene = pm.load_scene(tmp_path / "scene.toml")
    surface = scene.surface
    assert surface.relaxation_time.tolist() == [[100e-9, np.inf]]
    assert surface.relaxed_modulus.tolist() == [[1e9, 2e9]]
    assert pm.Surface.from_dataset(surface.to_dataset()) == surface
    image = scene.simulate()
    assert image.phase.values[0, 0] == pixel_of(**SOLID).phase
    assert "relaxation after Ting" in image.attrs["modelled"]


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"relaxed_modulus": None}, "relaxed_modulus is None; allowed: .*given together with relaxation_time"),
        ({"relaxation_time": None}, "relaxation_time is None; allowed: .*given together with relaxed_modulus"),
        ({"relaxed_modulus": 3e9}, "at most modulus"),
        ({"viscosity": 20.0}, "relaxation_time"),
        ({"relaxation_time": -1.0}, "relaxation_time is -1"),
    ],
)
def test_numbers_that_are_no_solid_are_refused_of_a_material_and_a_surface(
    change: dict[str, Any], sentence: str
) -> None:
    numbers = {name: value for name, value in {**SOLID, **change}.items() if value is not None}
    with pytest.raises(pm.InputError, match=sentence):
        pm.Material(**numbers)
    with pytest.raises(pm.InputError, match=sentence):
        pm.Surface(**numbers, pixel_size=1e-9, shape=(1, 1))
