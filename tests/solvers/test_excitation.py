"""A shaker under the lever: what a detector of the deflection sees, against an independent integration and limits."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cases import Case, label, load

import phasemap as pm
from phasemap._kernels import columns as col
from phasemap._kernels import excitation as kernel
from phasemap._kernels.excitation import detected_phasor
from phasemap._kernels.orbits.collocation.path import fixed_path
from phasemap._kernels.orbits.time.march import march_oscillator
from phasemap._kernels.orbits.time.tip import PeriodResult
from phasemap._kernels.rows.answers import Answers
from phasemap.experiment.lever import detected_signal, of_tip, offset_and_factor, sees_tip
from phasemap.experiment.lever_numbers import lever_of
from phasemap.scenes.scene import load_scene
from phasemap.solvers.both_branches import stable_branches
from phasemap.solvers.continuation.whole_curves import held_curves
from phasemap.solvers.problem import work_of_material
from phasemap.solvers.solver import by_name

CASES = load("excitation")
IN_LIQUID = [case for case in CASES if case["quality_factor"] < 20]
IN_AIR = [case for case in CASES if case["quality_factor"] >= 100]
WET = pm.Microscope(pm.Cantilever(0.5, 30e3, 3.0, participation=1), pm.Tip(10e-9), pm.Drive(10e-9, excitation="base"))
DRY = pm.Microscope(
    pm.Cantilever(40.0, 300e3, 400.0, participation=1), pm.Tip(10e-9), pm.Drive(40e-9, excitation="base")
)
BEAM = replace(  # of two modes, driven itself, whose slope the detector sees
    WET, cantilever=pm.Cantilever(0.5, 30e3, 3.0, modes=2), drive=pm.Drive(10e-9)
)
SOFT = pm.Material(1e9, adhesion=0.05, damping=0.01)
SETPOINT = 0.7


def scope_of(case: Case) -> pm.Microscope:
    frequency = 100e3
    return pm.Microscope(
        pm.Cantilever(case["stiffness"], frequency, case["quality_factor"], participation=1),
        pm.Tip(case["radius"]),
        pm.Drive(case["free_amplitude"], case["frequency_ratio"] * frequency, "base"),
        pm.Interaction("dmt", case["decay_length"]),
    )


def material_of(case: Case) -> pm.Material:
    return pm.Material(
        case["modulus"], adhesion=case["adhesion"], damping=case["damping"], poisson_ratio=case["poisson_ratio"]
    )


def direct(scope: pm.Microscope) -> pm.Microscope:
    return replace(scope, drive=replace(scope.drive, excitation="direct"))


def one_pixel(material: pm.Material, shape: tuple[int, int] = (1, 1)) -> pm.Surface:
    return pm.Surface(
        material.modulus, adhesion=material.adhesion, damping=material.damping, pixel_size=4e-9, shape=shape
    )


def test_the_free_lever_as_the_detector_sees_it() -> None:
    # z is Q u0 behind the base by a quarter of a period, so that z less the base is hypot(Q, 1) u0.
    assert WET.driven_amplitude == pytest.approx(math.hypot(3, 1) * 10e-9 / 3, rel=1e-15)
    amplitude, phase = detected_signal(lever_of(WET), 10e-9, 0.0)
    assert float(amplitude) == pytest.approx(WET.driven_amplitude, rel=1e-15)
    assert float(phase) == pytest.approx(0.0, abs=1e-15)
    off = replace(WET, drive=pm.Drive(10e-9, 0.8 * 30e3, "base"))
    response = 1 / (1 - 0.8**2 + 0.8j / 3)
    assert off.driven_amplitude == pytest.approx(abs(response - 1) * 10e-9 / 3, rel=1e-14)
    assert direct(off).driven_amplitude == pytest.approx(abs(response) * 10e-9 / 3, rel=1e-14)


def test_what_is_seen_and_what_the_tip_does_are_inverse_to_each_other() -> None:
    lever, rng = lever_of(WET), np.random.default_rng(1)
    amplitude, phase = rng.uniform(1e-9, 1e-8, 100), rng.uniform(-1.5, 1.5, 100)
    again = of_tip(lever, *detected_signal(lever, amplitude, phase))
    np.testing.assert_allclose(again, [amplitude, phase], rtol=1e-13, atol=1e-14)
    assert [float(x) for x in detected_signal(lever_of(direct(WET)), 3e-9, 0.4)] == [3e-9, 0.4]


@pytest.mark.parametrize("scope", [WET, direct(WET)], ids=["base", "direct"])
def test_kernels_see_what_arrays_see(scope: pm.Microscope) -> None:
    lever = lever_of(scope)
    amplitude, phase = 7e-9, 0.6
    expected = detected_signal(lever, amplitude, phase)
    push = lever[col.DRIVE] * math.sin(phase) - amplitude * lever[col.DYNAMIC_STIFFNESS]
    drag = amplitude * lever[col.DYNAMIC_LOSS] - lever[col.DRIVE] * math.cos(phase)
    for at in (kernel.detected_signal, kernel.detected_signal.py_func):
        assert at(lever, amplitude, phase) == pytest.approx([float(x) for x in expected], rel=1e-14)
    for at in (kernel.detected_amplitude_of_orbit, kernel.detected_amplitude_of_orbit.py_func):
        assert at(lever, amplitude, push, drag) == pytest.approx(float(expected[0]), rel=1e-14)
    # Central differences are off by the square of their step.
    step = 1e-5
    ends = [
        kernel.detected_amplitude_of_orbit(lever, amplitude * (1 + s), push * (1 - 2 * s), drag * (1 + s))
        for s in (step, -step)
    ]
    rate = kernel.detected_amplitude_rate(lever, (amplitude, push, drag), (amplitude, -2 * push, drag))
    assert rate == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-8)


@pytest.mark.slow
def test_the_spread_is_that_of_the_deflection_behind_a_lock_in() -> None:
    # Taps that come in some periods only. Taken for those of z and turned to the deflection, spreads are 2 % off.
    scope = pm.Microscope(
        pm.Cantilever(3.6, 300e3, 20.0, participation=1), pm.Tip(10e-9), pm.Drive(20e-9, excitation="base"),
        pm.Interaction("jkr", decay_length=0.3e-9),
    )  # fmt: skip
    sticky = pm.Material(59e6, adhesion=0.1, damping=0.01)
    pixel = pm.solve_pixel(sticky, scope, 0.9)
    assert pixel.motion == "irregular"
    work = work_of_material(sticky, scope, pixel.amplitude)
    amplitude, phase = of_tip(work.lever, pixel.amplitude, math.radians(pixel.phase))
    tip, acc = np.array([amplitude * math.sin(phase), amplitude * math.cos(phase), 0.0]), PeriodResult()
    shown, low = np.empty(6000, complex), 0j
    for i in range(-3000, len(shown)):
        march_oscillator(work.oscillator(0), pixel.tip_offset, 0.5, tip, acc)
        now = complex(*detected_phasor(work.lever, acc.cos, acc.sin))
        low = now + math.exp(-2 * math.pi / 100) * (low - now)
        if i >= 0:
            shown[i] = low
    # The means of two runs of some thousand periods.
    assert abs(shown.mean()) == pytest.approx(pixel.amplitude, rel=1e-5)
    assert np.abs(shown).std() == pytest.approx(pixel.amplitude_spread, rel=0.01)
    assert np.degrees(np.angle(shown / shown.mean()).std()) == pytest.approx(pixel.phase_spread, rel=0.01)


@pytest.mark.parametrize("solver", ["orbit", "auto"])
@pytest.mark.parametrize("case", CASES, ids=label)
def test_the_pixel_is_that_of_an_independent_integration(case: Case, solver: str) -> None:
    strict = pm.Accuracy(phase=1e-5, height=1e-14)
    pixel = pm.solve_pixel(material_of(case), scope_of(case), case["setpoint"], solver, strict)
    assert pixel.status is pm.Status.good
    assert pixel.amplitude == pytest.approx(case["amplitude"], rel=1e-10)
    assert pixel.phase == pytest.approx(case["phase"], abs=1e-5)
    # Collocation leaves 1e-15 m in air, and some ten times that in liquid.
    assert pixel.tip_offset == pytest.approx(case["tip_offset"], abs=1e-13)
    assert pixel.mean_deflection == pytest.approx(case["mean_deflection"], abs=1e-13)
    assert abs(pixel.energy_closure) < 1e-6


# Cases in which secants in the amplitude of the tip are slow, in liquid: stiffness, Q, free amplitude, over resonance,
# radius, modulus, adhesion, damping, setpoint.
SECANTS = [
    (22.98, 2.24345, 18.27e-9, 1.0, 15.93e-9, 1.686e9, 0.01, 0.0, 0.9294),
    (0.35948, 2.0432, 31.967e-9, 1.00076, 12.43e-9, 252.79e6, 0.0, 0.01, 0.85563),
    (0.104965, 1.76677, 39.068e-9, 0.96917, 6.7027e-9, 13.431e9, 0.0, 0.01, 0.67751),
]


@pytest.mark.parametrize("numbers", SECANTS)
def test_what_the_detector_sees_is_the_setpoint_to_rounding(numbers: tuple[float, ...]) -> None:
    stiffness, quality, free, ratio, radius, modulus, adhesion, damping, setpoint = numbers
    scope = pm.Microscope(
        pm.Cantilever(stiffness, 100e3, quality, participation=1), pm.Tip(radius),
        pm.Drive(free, ratio * 100e3, "base"), pm.Interaction("dmt", 0.3e-9),
    )  # fmt: skip
    pixel = pm.solve_pixel(pm.Material(modulus, adhesion=adhesion, damping=damping), scope, setpoint, "orbit")
    assert pixel.amplitude == pytest.approx(setpoint * scope.driven_amplitude, rel=3e-12)


@pytest.mark.parametrize("case", IN_LIQUID[:2] + IN_AIR[:1], ids=label)
def test_time_leads_to_the_same(case: Case) -> None:
    pixel = pm.solve_pixel(material_of(case), scope_of(case), case["setpoint"], "march")
    assert pixel.phase == pytest.approx(case["phase"], abs=pixel.error_phase)
    assert pixel.tip_offset == pytest.approx(case["tip_offset"], abs=pixel.error_height)


@pytest.mark.parametrize("case", IN_AIR, ids=label)
def test_averaging_is_as_good_as_for_a_force_on_the_tip(case: Case) -> None:
    material, scope, setpoint = material_of(case), scope_of(case), case["setpoint"]
    averaged, exact = (pm.solve_pixel(material, direct(scope), setpoint, solver) for solver in ("averaging", "orbit"))
    found = pm.solve_pixel(material, scope, setpoint, "averaging")
    # What averaging leaves out is the same but for 1/Q.
    assert found.phase - case["phase"] == pytest.approx(averaged.phase - exact.phase, rel=0.05)


def test_without_losses_the_phase_follows_from_the_amplitude() -> None:
    # All that the drive gives goes into the air: A = Q u0 cos(phase) of z, so that the deflection's phase is known.
    # What the higher harmonics take at Q 400 is less than 1e-4 of it.
    pixel = pm.solve_pixel(pm.Material(3e9), DRY, SETPOINT, "orbit")
    turn = np.linspace(0, math.pi / 2, 1_000_001)
    amplitude, phase = detected_signal(lever_of(DRY), 40e-9 * np.cos(turn), turn)
    expected = phase[np.argmax(amplitude < SETPOINT * DRY.driven_amplitude)]
    assert pixel.phase == pytest.approx(math.degrees(expected), abs=0.01)


def test_both_excitations_agree_to_order_one_over_q() -> None:
    qualities, apart = np.array([100.0, 200.0, 400.0, 800.0]), []
    for quality in qualities:
        base = pm.Microscope(
            pm.Cantilever(40.0, 300e3, quality, participation=1), pm.Tip(10e-9), pm.Drive(40e-9, excitation="base")
        )
        pixels = [pm.solve_pixel(pm.Material(3e9), scope, SETPOINT, "orbit") for scope in (base, direct(base))]
        apart.append(abs(pixels[0].phase - pixels[1].phase))
    slope = np.polyfit(np.log(qualities), np.log(apart), 1)[0]
    # Without losses the expansion in 1/Q has the next term 1/Q^2, 1 % at Q 100.
    assert slope == pytest.approx(-1.0, abs=0.02)


@pytest.mark.parametrize("scope", [WET, DRY, BEAM], ids=["liquid", "air", "two modes"])
def test_the_whole_curve_of_orbits_has_the_pixel_on_it(scope: pm.Microscope) -> None:
    pixel = pm.solve_pixel(SOFT, scope, SETPOINT, "orbit")
    found = pm.orbits(SOFT, scope, setpoint=SETPOINT)
    nearest = found.isel(orbit=int(np.abs(found.phase.values - pixel.phase).argmin()))
    # Two searches on orbits that are exact to 1e-6 degree, with rounding where the curve is flat.
    assert float(nearest.phase) == pytest.approx(pixel.phase, abs=2e-6)
    assert float(nearest.tip_offset) == pytest.approx(pixel.tip_offset, abs=1e-14)
    # The pixel's slope is that of a last secant.
    assert float(nearest.feedback_slope) == pytest.approx(pixel.feedback_slope, rel=1e-3)
    assert bool(nearest.stable)
    there = pm.orbits(SOFT, scope, tip_offset=pixel.tip_offset)
    assert np.abs(there.phase.values - pixel.phase).min() < 2e-6


def test_the_slope_of_the_feedback_is_that_of_the_amplitude_seen() -> None:
    pixel, step = pm.solve_pixel(SOFT, WET, SETPOINT, "orbit"), 1e-12
    ends = pixel.tip_offset + step * np.array([-1.0, 1.0])
    amplitude = pm.sweep_distance(SOFT, WET, ends).amplitude.sel(direction="approach").values
    assert (amplitude[1] - amplitude[0]) / (2 * step) == pytest.approx(pixel.feedback_slope, rel=1e-3)


@pytest.mark.parametrize("scope", [WET, DRY, BEAM], ids=["liquid", "air", "two modes"])
def test_sweeps_pass_the_pixel(scope: pm.Microscope) -> None:
    pixel = pm.solve_pixel(SOFT, scope, SETPOINT, "orbit")
    held = pm.sweep_setpoint(SOFT, scope, [0.9, SETPOINT, 0.6]).sel(direction="down", setpoint=SETPOINT)
    assert float(held.phase) == pytest.approx(pixel.phase, abs=2e-6)
    assert float(held.amplitude) == pytest.approx(SETPOINT * scope.driven_amplitude, rel=1e-10)
    z0 = pixel.tip_offset
    lowered = pm.sweep_distance(SOFT, scope, [z0 + 1e-10, z0]).sel(direction="approach").isel(tip_offset=-1)
    assert float(lowered.phase) == pytest.approx(pixel.phase, abs=2e-6)
    assert float(lowered.amplitude) == pytest.approx(pixel.amplitude, rel=1e-7)


def test_a_frequency_sweep_far_from_the_surface_is_the_free_lever() -> None:
    ratios = np.array([0.8, 1.0, 1.1])
    curve = pm.sweep_frequency(pm.Material(1e9), WET, ratios * 30e3, tip_offset=30e-9).sel(direction="up")
    deflection = 1 / (1 - ratios**2 + 1j * ratios / 3) - 1
    np.testing.assert_allclose(curve.amplitude, np.abs(deflection) * 10e-9 / 3, rtol=1e-9)
    expected = np.degrees(np.angle(1j * deflection) + math.atan(1 / 3))
    np.testing.assert_allclose(curve.phase, expected, atol=1e-6)


@pytest.mark.parametrize("scope", [WET, BEAM], ids=["one mode", "two modes"])
def test_raster_shows_what_engage_shows(scope: pm.Microscope) -> None:
    surface = pm.Surface(modulus=[[1e9, 3e9]], adhesion=0.05, damping=0.01, pixel_size=4e-9)
    engaged = pm.simulate(surface, scope, SETPOINT, "orbit")
    raster = pm.simulate(surface, scope, SETPOINT, "orbit", pm.Raster())
    for name in ("phase", "height", "amplitude", "branch"):
        for direction in ("trace", "retrace"):
            np.testing.assert_array_equal(raster[name].sel(direction=direction), engaged[name])


@pytest.mark.parametrize(
    ("scope", "solver"),
    [pytest.param(DRY, "averaging", id="slow flow", marks=pytest.mark.slow), pytest.param(WET, "march", id="in time")],
)
def test_a_feedback_comes_to_rest_where_engage_does(scope: pm.Microscope, solver: str) -> None:
    still = pm.simulate(one_pixel(SOFT), scope, SETPOINT, "orbit")
    image = pm.simulate(one_pixel(SOFT, (1, 4)), scope, SETPOINT, solver, pm.Feedback(line_rate=2.0))
    # The slow flow is of first order: 0.1 degree, and some hundredths of a nanometre (as without a shaker).
    np.testing.assert_allclose(image.phase.values, float(still.phase[0, 0]), atol=0.1)
    np.testing.assert_allclose(image.amplitude.values, SETPOINT * scope.driven_amplitude, rtol=1e-3)
    np.testing.assert_allclose(image.tip_offset.values, float(still.tip_offset[0, 0]), atol=5e-11)


@pytest.mark.parametrize("scope", [WET, BEAM], ids=["one mode", "two modes"])
def test_contrast_is_the_difference_of_two_pixels(scope: pm.Microscope) -> None:
    hard = pm.Material(3e9, adhesion=0.02)
    found = pm.contrast(SOFT, hard, scope, [0.6, SETPOINT], solver="orbit")
    surface = pm.Surface.from_labels([[0, 1]], {0: SOFT, 1: hard}, pixel_size=1e-9)
    soft, stiff = pm.simulate(surface, scope, SETPOINT, solver="orbit").phase.values[0]
    assert float(found.contrast.sel(setpoint=SETPOINT)) == pytest.approx(stiff - soft, abs=1e-9)


@pytest.mark.parametrize("scope", [WET, BEAM], ids=["one mode", "two modes"])
def test_sensitivities_are_differences_of_pixels(scope: pm.Microscope) -> None:
    found, step = pm.sensitivity(one_pixel(SOFT), scope, SETPOINT), 3e-3
    for name, unit in (("modulus", SOFT.modulus), ("damping", SOFT.damping)):
        ends = [
            pm.solve_pixel(replace(SOFT, **{name: unit * math.exp(sign * step)}), scope, SETPOINT, "orbit")
            for sign in (1, -1)
        ]
        # Orbits of 1e-6 degree and 1e-15 m, over twice the step.
        by_phase, by_height = float(found[f"phase_by_{name}"][0, 0]), float(found[f"height_by_{name}"][0, 0])
        assert by_phase == pytest.approx((ends[0].phase - ends[1].phase) / (2 * step), abs=1e-3)
        assert by_height == pytest.approx((ends[0].height - ends[1].height) / (2 * step), abs=1e-12)


def test_images_lead_back_to_their_materials() -> None:
    setpoints = (0.5, 0.6, 0.7, 0.8)
    surface = pm.Surface(modulus=[[1e9, 2e9]], adhesion=[[0.08, 0.05]], damping=[[0.02, 0.01]], pixel_size=4e-9)
    images = [pm.simulate(surface, DRY, setpoint, "orbit") for setpoint in setpoints]
    given = {"setpoints": setpoints, "phase_zero": 0.0, "phase_error": 1e-3, "height_error": 1e-12}
    found = pm.invert(images, DRY, **given)
    for name in ("modulus", "adhesion", "damping"):
        expected = np.broadcast_to(getattr(surface, name), (1, 2))
        np.testing.assert_allclose(found[name], expected, rtol=0.01)
    # The same images taken for those of a force on the tip are off by 1/Q of a radian, a hundred standard errors.
    other = pm.invert(images, direct(DRY), **given)
    assert float(other.misfit.min()) > 100 * float(found.misfit.max())


def test_a_measured_curve_leads_back_to_its_material() -> None:
    axis = np.linspace(8.5e-9, 5e-9, 15)
    curve = pm.sweep_distance(SOFT, WET, axis).sel(direction="approach")
    found = pm.fit_distance(
        axis, scope=WET, start=pm.Material(2e9, adhesion=0.05, damping=0.02), parameters=("modulus", "damping"),
        amplitude=curve.amplitude.values, amplitude_error=1e-12, phase=curve.phase.values, phase_error=1e-3,
    )  # fmt: skip
    assert found.values["modulus"] == pytest.approx(1e9, rel=1e-3)
    assert found.values["damping"] == pytest.approx(0.01, rel=1e-2)


@pytest.mark.parametrize("scope", [WET, DRY], ids=["liquid", "air"])
def test_check_certifies_an_image_and_finds_a_wrong_word(scope: pm.Microscope) -> None:
    surface = pm.Surface(modulus=[[1e9, 3e9]], adhesion=0.05, damping=0.01, pixel_size=4e-9)
    image = pm.simulate(surface, scope, SETPOINT)
    assert "deflection" in image.attrs["detected"]
    assert pm.check(image, surface).holds
    told = image.attrs["configuration"]
    assert '"excitation": "base"' in told
    wrong = image.assign_attrs(configuration=told.replace('"excitation": "base"', '"excitation": "direct"'))
    assert not pm.check(wrong, surface).holds


def test_an_orbit_that_the_attractive_branch_leaves_just_before_is_found_along_the_whole_curve() -> None:
    # Where the attractive branch ends between the two A that show the setpoint, neither is what engagement finds at
    # its own A; the sweep, which follows the curve as the deflection shows it, does.
    scope = pm.Microscope(
        pm.Cantilever(40.0, 300e3, 150.0, participation=1), pm.Tip(10e-9), pm.Drive(8e-9, excitation="base")
    )
    sticky = pm.Material(2e9, adhesion=0.1, damping=0.01)
    setpoints = np.linspace(0.76, 0.66, 51)
    swept = pm.sweep_setpoint(sticky, scope, setpoints).sel(direction="down")
    jump = int(np.flatnonzero(np.diff(swept.branch.values) > 0)[0])
    for i in range(jump - 1, jump + 4):
        pixel = pm.solve_pixel(sticky, scope, float(setpoints[i]), "orbit")
        assert pixel.phase == pytest.approx(float(swept.phase[i]), abs=1e-5)


@pytest.mark.parametrize("excitation", ["direct", "base"])
@pytest.mark.parametrize("modes", [1, 2])
def test_a_parameter_swept_with_the_setpoint_held_passes_the_orbits_of_pixels_in_liquid(
    excitation: str, modes: int
) -> None:
    lever = pm.Cantilever(0.1, 30e3, 2.5, modes=modes)
    scope = pm.Microscope(lever, pm.Tip(10e-9), pm.Drive(10e-9, excitation=excitation), pm.Interaction("hertz"))
    moduli = [0.3e9, 1e9, 3e9]
    swept = pm.sweep_parameter(pm.Material(1e9), scope, "modulus", moduli, setpoint=0.8)
    pixels = [pm.solve_pixel(pm.Material(modulus), scope, 0.8, "orbit") for modulus in moduli]
    for direction in ("up", "down"):
        # Both hold the same amplitude; what differs is the last step of Newton's method, about 1e-6 degree.
        there = swept.sel(direction=direction)
        np.testing.assert_allclose(there.phase, [pixel.phase for pixel in pixels], rtol=0, atol=1e-5)
        np.testing.assert_allclose(there.tip_offset, [pixel.tip_offset for pixel in pixels], rtol=0, atol=1e-14)
    assert swept.sizes["jump"] == 0


def test_on_a_shaker_a_drive_that_rises_and_falls_jumps_once_between_the_branches() -> None:
    scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(16e-9, excitation="base"))
    drives = np.linspace(8e-9, 24e-9, 5)
    swept = pm.sweep_parameter(pm.Material(2e9, 0.05), scope, "free_amplitude", drives, setpoint=0.8)
    branches = swept.branch.sel(direction="up").values
    assert np.count_nonzero(np.diff(branches)) == 1
    assert swept.jump_direction.values.tolist().count(0) == 1
    assert (np.diff(swept.branch.sel(direction="down").values) <= 0).all()
    # Where the curve turns: an orbit of both.
    assert float(abs(swept.fold_free_amplitude - swept.jump_free_amplitude.values[0]).min()) == 0


@pytest.mark.parametrize("scope", [WET, DRY, BEAM], ids=["liquid", "air", "two modes"])
def test_every_orbit_of_a_curve_with_the_setpoint_held_is_seen_with_it(scope: pm.Microscope) -> None:
    free = scope.drive.free_amplitude
    swept = pm.sweep_parameter(SOFT, scope, "free_amplitude", [0.8 * free, free], setpoint=SETPOINT)
    seen = SETPOINT * scope.driven_amplitude / free * swept.curve_free_amplitude
    # Newton's method ends with a step that changes the drive's components by 1e-5, and leaves the square of that.
    np.testing.assert_allclose(swept.curve_amplitude, seen, rtol=1e-9)
    assert np.abs(swept.curve_energy_closure).max() < 1e-6
    pixel = pm.solve_pixel(SOFT, scope, SETPOINT, "orbit")
    assert float(swept.phase.sel(direction="down")[-1]) == pytest.approx(pixel.phase, abs=1e-5)


def test_a_frequency_sweep_on_a_shaker_stays_on_its_branch_however_far_apart_its_values_are() -> None:
    # Between two of them the tip offset changes by half a nanometre, and the other branch is 2 nm away.
    scope = pm.Microscope(
        pm.Cantilever(5.175, 300e3, 115.5, participation=1), pm.Tip(6.35e-9), pm.Drive(5.867e-9, excitation="base")
    )
    soft, frequencies = pm.Material(336e6, 0.06176, 0.00488), 300e3 * (1 + np.array([-0.5, 0.0, 0.5]) / 115.5)
    swept = pm.sweep_parameter(soft, scope, "frequency", frequencies, setpoint=0.75)
    assert swept.sizes["jump"] == 0
    for k, frequency in enumerate(frequencies):
        there = replace(scope, drive=replace(scope.drive, frequency=float(frequency)))
        pixel = pm.solve_pixel(soft, there, 0.75, "orbit")
        np.testing.assert_allclose(swept.phase[:, k], pixel.phase, rtol=0, atol=1e-5)


def test_what_is_not_allowed_is_one_sentence() -> None:
    with pytest.raises(pm.InputError, match=r"excitation is 'shaker'; allowed: one of direct, base"):
        pm.Drive(10e-9, excitation="shaker")


def test_a_scene_in_a_liquid_questions_the_adhesion_of_a_preset() -> None:
    path = Path(__file__).parents[2] / "samples" / "step.toml"
    wet = ["cantilever.quality_factor=3", "cantilever.modes=[{frequency_ratio=7.3, quality_factor=6}]"]
    wet += ["drive.excitation=base", "materials.stiff.preset=PS"]
    with pytest.warns(UserWarning, match=r"the adhesion of stiff is that of a preset for dry air"):
        load_scene(path, wet)


def test_a_scene_says_what_shakes_the_lever() -> None:
    path = Path(__file__).parents[2] / "samples" / "step.toml"
    wet = ["cantilever.quality_factor=3", "cantilever.modes=[{frequency_ratio=7.3, quality_factor=6}]"]
    with pytest.warns(UserWarning, match="Q is 3 and .drive. does not say excitation"):
        assert load_scene(path, wet).microscope.drive.excitation == "direct"
    for word in ("base", "direct"):
        scene = load_scene(path, [*wet, f"drive.excitation={word}"])
        assert scene.microscope.drive.excitation == word
    assert load_scene(path).microscope.drive.excitation == "direct"


def test_the_lever_of_a_force_on_the_tip_hides_nothing() -> None:
    assert sees_tip(work_of_material(SOFT, direct(WET), 1e-9).lever)
    offset, factor = offset_and_factor(work_of_material(SOFT, WET, 1e-9).lever)
    assert abs(offset) == pytest.approx(10e-9 / 3)
    assert abs(factor) == pytest.approx(1)


def test_with_a_neck_the_other_branch_on_a_shaker_is_one_of_the_orbits_of_the_whole_curve() -> None:
    # Passes know nothing of the energy that a neck takes: they were 5 degrees off.
    lever = pm.Cantilever(2.0, 300e3, 100.0, participation=1)
    scope = replace(
        DRY,
        cantilever=lever,
        drive=pm.Drive(20e-9, excitation="base"),
        interaction=pm.Interaction("jkr", decay_length=None),
    )
    material = pm.Material(321e6, 0.0346, 0.0169)
    work = work_of_material(material, scope, 0.8 * scope.driven_amplitude)
    found = stable_branches(work, by_name("auto"), pm.Accuracy())
    assert found.engaged.tolist() == [col.ATTRACTING] and found.status[col.REPELLING, 0] == col.GOOD
    row, orbits = found.rows[col.REPELLING, 0], pm.orbits(material, scope, 0.8)
    assert float(abs(orbits.phase - math.degrees(row[col.PHASE])).min()) < 1e-3


@pytest.mark.parametrize("scope", [WET, DRY, BEAM], ids=["liquid", "air", "beam"])
def test_orbits_of_a_curve_state_errors_as_those_of_the_same_material_in_an_image_do(scope: pm.Microscope) -> None:
    work = work_of_material(SOFT, scope, SETPOINT * scope.driven_amplitude)
    alone = Answers(np.full((1, col.COLUMNS), np.nan), np.zeros(1, np.int8), np.zeros(1, np.int8))
    by_name("orbit").solve(work, pm.Accuracy(), alone)
    seen = np.array([SETPOINT * scope.driven_amplitude])
    found = held_curves(fixed_path(work.oscillator(0)), seen, 0).wanted_rows
    row = found[np.argmin(abs(found[:, col.PHASE] - alone.rows[0, col.PHASE]))]
    errors = [col.ERROR_PHASE, col.ERROR_HEIGHT]
    # Neither is larger than an image is promised, and each bounds by how much the two differ.
    assert (row[errors] > 0).all() and row[col.ERROR_PHASE] < math.radians(1e-3) and row[col.ERROR_HEIGHT] < 1e-12
    for at, error in zip((col.PHASE, col.TIP_OFFSET), errors, strict=True):
        assert abs(row[at] - alone.rows[0, at]) <= row[error] + alone.rows[0, error]
    slope, step = row[col.SLOPE], 1e-3
    near = held_curves(fixed_path(work.oscillator(0)), seen * (1 + step), 0).wanted_rows
    beside = near[np.argmin(abs(near[:, col.TIP_OFFSET] - row[col.TIP_OFFSET]))]
    assert slope == pytest.approx(step * seen[0] / (beside[col.TIP_OFFSET] - row[col.TIP_OFFSET]), rel=0.02)
