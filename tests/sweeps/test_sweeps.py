"""Sweeps: folds, jumps and orbits against references made by other codes (tests/reference), and what physics says.

folds.json and laws.json come from shooting with an integrator of their own, jumps.json from integration in time.
"""

from __future__ import annotations

import json
import math
import pathlib
from dataclasses import replace

import numpy as np
import pytest
from cases import load

import phasemap as pm
from phasemap._kernels import columns as col
from phasemap.solvers.continuation.visit import OffOrbit, SlowFeedback, TipPlace

DATA = pathlib.Path(__file__).parents[1] / "data"
FOLDS = json.loads((DATA / "folds.json").read_text())
JUMPS = json.loads((DATA / "jumps.json").read_text())
LAWS = json.loads((DATA / "laws.json").read_text())
HERTZ = 300e3  # any: lengths and phases do not depend on it

SCOPE = pm.Microscope(pm.Cantilever(40.0, HERTZ, 400.0), pm.Tip(10e-9), pm.Drive(16e-9))
FILM = pm.Material(modulus=2e9, adhesion=0.1, damping=0.01)
ELASTIC = pm.Material(modulus=2e9, adhesion=0.1)


def scope_of(case: dict, ratio: float | None = None) -> pm.Microscope:
    ratio = case["frequency_ratio"] if ratio is None else ratio
    return pm.Microscope(
        pm.Cantilever(case["stiffness"], HERTZ, case["quality_factor"]),
        pm.Tip(case["tip_radius"]),
        pm.Drive(case["free_amplitude"], None if ratio == 1 else ratio * HERTZ),
        pm.Interaction(case["law"], case["decay_length"]),
    )


def material_of(case: dict) -> pm.Material:
    return pm.Material(case["modulus"], case["adhesion"], case["damping"], poisson_ratio=case["poisson_ratio"])


def named(cases: list[dict]) -> dict:
    return {"argvalues": cases, "ids": [f"{case['name']}, {case.get('sweep', '')}" for case in cases]}


@pytest.mark.parametrize(
    ("lever", "radius", "reach", "free", "material"),
    [
        (
            (20.087300371156367, HERTZ, 685.3024636031978), 1.9182455728269202e-8, 4.5109771287021747e-10,
            4.380436394996476e-8, (134399817833.47101, 0.06065411147938513, 0.008555351682633026),
        ),
        (
            (27.116382211472015, HERTZ, 690.7596167365973), 9.734318817602819e-9, 3.0728219992903036e-10,
            4.7389214801815884e-8, (153425676228.3138, 0.11973407874500823, 0.05465727205602936),
        ),
    ],
)  # fmt: skip
def test_a_distance_curve_reaches_the_last_value_asked_for(lever, radius, reach, free, material):
    # Which its orbit has to rounding only, so that a curve that ends there may end a bit beside it.
    scope = pm.Microscope(pm.Cantilever(*lever), pm.Tip(radius), pm.Drive(free), pm.Interaction("dmt", reach))
    curve = pm.sweep_distance(pm.Material(*material, poisson_ratio=0.35), scope, free * np.linspace(1.3, 0.3, 41))
    assert (curve.status == 0).all()


DMT_FOLDS = [case for case in FOLDS if case["law"] == "dmt" and not case["bias"] and case["folds"]]


@pytest.mark.parametrize("case", **named([case for case in DMT_FOLDS if case["sweep"] == "distance"]))
def test_folds_of_a_distance_curve_are_where_shooting_finds_them(case):
    wanted = np.array([fold["tip_offset"] for fold in case["folds"] if fold["joined"]])
    if not len(wanted):
        pytest.skip("all folds lie on pieces apart: another test")
    axis = np.linspace(wanted.max() + 2e-9, wanted.min() - 2e-9, 12)
    curve = pm.sweep_distance(material_of(case), scope_of(case), axis)
    for place in wanted:
        # The reference is uncertain by up to 2e-10; at a fold the tip offset is stationary and exact to rounding.
        assert np.abs(curve.fold_tip_offset / place - 1).min() < 1e-9


TURNS = [(case, turn["amplitude"]) for case in DMT_FOLDS for curve in case["curves"] for turn in curve["turns"]]


@pytest.mark.parametrize(
    ("case", "amplitude"), TURNS, ids=[f"{case['name']}, {size * 1e9:.1f} nm" for case, size in TURNS]
)
def test_the_setpoint_turns_where_shooting_finds_the_largest_amplitude(case, amplitude):
    ratio, quality = case["frequency_ratio"], case["quality_factor"]
    free = case["free_amplitude"] / abs(quality * (1 - ratio**2) + 1j * ratio)
    top = min(1.0 - 1e-6, 1.01 * amplitude / free)
    swept = pm.sweep_setpoint(material_of(case), scope_of(case), np.linspace(top, top - 0.1, 12))
    # A polynomial of the phase through orbits by shooting; it misses them by 1e-8 of what they vary by, which
    # is a thousandth of the amplitude.
    assert np.abs(swept.fold_setpoint * free / amplitude - 1).min() < 1e-9


@pytest.mark.parametrize("case", **named([case for case in DMT_FOLDS if case["sweep"] == "frequency"]))
def test_folds_of_a_response_are_where_shooting_finds_them(case):
    ratios = np.array([fold["frequency_ratio"] for fold in case["folds"]])
    axis = HERTZ * np.linspace(0.995 * ratios.min(), 1.005 * ratios.max(), 12)
    curve = pm.sweep_frequency(material_of(case), scope_of(case, 1.0), axis, tip_offset=case["tip_offset"])
    for ratio in ratios:
        assert np.abs(curve.fold_frequency / HERTZ / ratio - 1).min() < 1e-9


def test_a_branch_apart_from_the_curve_from_far_is_found_with_its_fold():
    (case,) = [case for case in DMT_FOLDS if case["name"] == "bistable at resonance"]
    (fold,) = case["folds"]
    assert not fold["joined"]
    curve = pm.sweep_distance(
        material_of(case), scope_of(case), np.linspace(fold["tip_offset"] + 2e-9, fold["tip_offset"] - 2e-9, 12)
    )
    assert np.abs(curve.fold_tip_offset / fold["tip_offset"] - 1).min() < 1e-9
    assert len(np.unique(curve.curve_piece)) == 2


DMT_JUMPS = [case for case in JUMPS if case["law"] == "dmt" and case["jumps"]]


@pytest.mark.parametrize("case", **named([case for case in DMT_JUMPS if case["sweep"] == "distance"]))
def test_a_distance_sweep_jumps_where_the_tip_jumps_in_time(case):
    places = [np.mean(jump["bracket"]) for jump in case["jumps"]]
    both = [jump["bracket"][0] for other in DMT_JUMPS if other["name"] == case["name"] for jump in other["jumps"]]
    axis = np.linspace(max(both) + 2e-9, min(both) - 2e-9, 15)
    curve = pm.sweep_distance(material_of(case), scope_of(case), axis)
    ours = curve.isel(jump=curve.jump_direction.values == (0 if case["direction"] == "approach" else 1))
    assert ours.sizes["jump"] == len(places)
    for k, jump in enumerate(case["jumps"]):
        low, high = sorted(jump["bracket"])
        # In time the tip stays for 1e4 periods beside a fold: a picometre of the bracket's side.
        assert low - 1e-12 < ours.jump_tip_offset[k] < high + 1e-12
        assert abs(ours.jump_to_amplitude[k] / jump["amplitude_after"] - 1) < 1e-3


@pytest.mark.parametrize("case", **named([case for case in DMT_JUMPS if case["sweep"] == "frequency"][:4]))
def test_a_frequency_sweep_jumps_where_the_tip_jumps_in_time(case):
    places = [np.mean(jump["bracket"]) for jump in case["jumps"]]
    places = [place / HERTZ if place > 10 else place for place in places]
    axis = HERTZ * np.linspace(0.994, 1.006, 25)
    curve = pm.sweep_frequency(material_of(case), scope_of(case, 1.0), axis, tip_offset=case["tip_offset"])
    ours = curve.isel(jump=curve.jump_direction.values == (0 if case["direction"] == "up" else 1))
    assert ours.sizes["jump"] == len(places)
    for ratio, place in zip(ours.jump_frequency.values / HERTZ, places, strict=True):
        assert abs(ratio - place) < 2e-6  # brackets of 5e-7, passed in finite time


ORBITS = [case for case in LAWS if case["law"] in ("hertz", "dmt") and not case["bias"]]


@pytest.mark.parametrize("case", **named(ORBITS))
def test_orbits_of_the_reference_are_on_the_curve_with_all_their_observables(case):
    for orbit in case["orbits"]:
        near = orbit["tip_offset"]
        axis = np.array([near - 0.05e-9, near, near + 0.05e-9])
        curve = pm.sweep_distance(material_of(case), scope_of(case), axis)
        there = curve.isel(point=np.abs(curve.curve_tip_offset.values - near) < 1e-15)
        assert there.sizes["point"]
        best = there.isel(point=int(np.abs(there.curve_amplitude.values - orbit["amplitude"]).argmin()))
        # Tolerances: the reference is good to 1e-7 degree and 1e-18 m; ours are those the issue asks for.
        assert abs(best.curve_amplitude - orbit["amplitude"]) < 1e-13
        assert abs(best.curve_phase - orbit["phase"]) < 1e-4
        assert abs(best.curve_floquet - orbit["floquet"]) < 1e-5
        assert abs(best.curve_contact_time - orbit["contact_fraction"]) < 1e-6
        assert best.curve_indentation == pytest.approx(orbit["indentation"], rel=1e-4)
        assert best.curve_mean_force == pytest.approx(orbit["mean_force"], rel=1e-6)
        assert best.curve_virial == pytest.approx(orbit["virial"], rel=1e-5)
        assert best.curve_dissipation == pytest.approx(orbit["dissipation"], rel=1e-5, abs=1e-27)
        ours, theirs = best.curve_harmonics.values, np.array(orbit["harmonics"])
        assert np.abs(ours - theirs).max() < 1e-4 * theirs.max()
        found = complex(best.curve_multiplier_real, best.curve_multiplier_imag)
        assert min(abs(abs(found) - abs(complex(*m))) for m in orbit["multipliers"]) < 1e-5


def test_every_orbit_of_a_curve_closes_its_energy():
    curve = pm.sweep_distance(FILM, SCOPE, np.linspace(18e-9, 4e-9, 30))
    assert np.abs(curve.curve_energy_closure).max() < 1e-6


def test_folds_are_where_a_multiplier_passes_one():
    curve = pm.sweep_distance(FILM, SCOPE, np.linspace(18e-9, 4e-9, 30))
    assert curve.sizes["fold"] == 2
    assert np.abs(curve.fold_floquet - 1).max() < 1e-6


def test_approach_and_retract_differ_only_between_the_folds():
    curve = pm.sweep_distance(FILM, SCOPE, np.linspace(18e-9, 4e-9, 57))
    differ = curve.tip_offset[np.abs(curve.phase[0] - curve.phase[1]) > 1e-6]
    low, high = np.sort(curve.fold_tip_offset)
    assert len(differ)
    assert (differ > low).all() and (differ < high).all()


@pytest.mark.parametrize("ends", [(18e-9, 4e-9), (4e-9, 18e-9)])
def test_the_order_of_the_axis_changes_nothing_but_the_order(ends):
    axis = np.linspace(*ends, 15)
    curve = pm.sweep_distance(FILM, SCOPE, axis)
    other = pm.sweep_distance(FILM, SCOPE, axis[::-1])
    assert (curve.tip_offset.values == axis).all()
    np.testing.assert_allclose(curve.phase.values, other.phase.values[:, ::-1], rtol=0, atol=1e-9)


def test_undamped_phase_is_arccos_of_setpoint_on_every_branch():
    ratios = np.linspace(0.95, 0.2, 16)
    curve = pm.sweep_setpoint(ELASTIC, SCOPE, ratios)
    assert (curve.status == 0).all()
    # The drive's power is the lever's own loss: cos(phase) = setpoint (1 + sum n^2 A_n^2 / A^2) at resonance.
    losses = (curve.harmonic**2 * curve.harmonics**2).sum("harmonic") / curve.amplitude**2
    np.testing.assert_allclose(np.cos(np.radians(curve.phase)), ratios * (1 + losses), atol=1e-5)
    np.testing.assert_allclose(np.abs(curve.phase), np.degrees(np.arccos(np.stack([ratios, ratios]))), atol=0.02)


def test_a_setpoint_sweep_down_stops_where_engagement_does():
    ratios = np.array([0.9, 0.8, 0.7, 0.5])
    curve = pm.sweep_setpoint(FILM, SCOPE, ratios)
    for ratio in ratios:
        pixel = pm.solve_pixel(FILM, SCOPE, float(ratio), solver="orbit")
        assert abs(float(curve.phase.sel(direction="down", setpoint=ratio)) - pixel.phase) < 1e-4
        assert abs(float(curve.tip_offset.sel(direction="down", setpoint=ratio)) - pixel.tip_offset) < 1e-13


def test_a_parameter_sweep_holds_the_setpoint_and_agrees_with_engagement_at_its_ends():
    values = np.geomspace(0.5e9, 10e9, 7)
    curve = pm.sweep_parameter(FILM, SCOPE, "modulus", values, setpoint=0.7)
    assert np.abs(curve.amplitude / (0.7 * 16e-9) - 1).max() < 1e-9
    for direction, value in (("up", values[0]), ("down", values[-1])):
        pixel = pm.solve_pixel(pm.Material(value, 0.1, 0.01), SCOPE, 0.7, solver="orbit")
        assert abs(float(curve.phase.sel(direction=direction, modulus=value)) - pixel.phase) < 1e-4


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("adhesion", (0.02, 0.2)),
        ("damping", (0.0, 0.05)),
        ("radius", (5e-9, 30e-9)),
        ("free_amplitude", (14e-9, 40e-9)),
    ],
)
def test_any_parameter_can_be_swept(name, values):
    axis = np.linspace(*values, 5)
    curve = pm.sweep_parameter(FILM, SCOPE, name, axis, setpoint=0.6)
    assert curve.phase.dims == ("direction", name)
    good = curve.status == 0
    assert good.any()
    free = axis if name == "free_amplitude" else 16e-9
    expected = np.broadcast_to(0.6 * free * np.ones(5), curve.amplitude.shape)
    assert np.abs(curve.amplitude / expected - 1).where(good).max() < 1e-9


def test_a_time_trace_has_the_amplitude_the_phase_and_the_forces_of_its_orbit():
    curve = pm.sweep_distance(FILM, SCOPE, np.linspace(16e-9, 8e-9, 5), samples=4096)
    one = curve.sel(direction="retract").isel(tip_offset=2)
    angle = np.radians(curve.drive_phase.values)
    z, force = one.trace_deflection.values, one.trace_force.values
    harmonic = 2 * np.mean(z * np.exp(1j * angle))
    # 4096 samples of a motion with a kink in its third derivative: the rectangle rule is off by 4096^-3 or so.
    assert abs(harmonic) == pytest.approx(float(one.amplitude), rel=1e-8)
    assert 90 - math.degrees(np.angle(harmonic)) == pytest.approx(float(one.phase), abs=1e-5)
    assert z.mean() == pytest.approx(float(one.mean_deflection), rel=1e-6)
    assert z.max() - float(one.tip_offset) == pytest.approx(float(one.indentation), rel=1e-4)
    assert force.max() == pytest.approx(float(one.peak_force), rel=1e-3)


@pytest.mark.slow
def test_a_jkr_tip_loses_its_orbit_at_first_touch_and_finds_it_again_where_shooting_says():
    (case,) = [case for case in FOLDS if case["name"] == "jkr, adhesion 0.1"]
    curve = pm.sweep_distance(material_of(case), scope_of(case), np.linspace(39.8e-9, 36e-9, 39))
    (touch,) = [end["swept"] for end in case["curves"][0]["ends"] if end["how"] == "grazing"]
    first = curve.isel(jump=0)
    # The curve without contact ends where the tip touches; continuation comes within 1e-7 of its steps of that.
    assert abs(float(first.jump_tip_offset) - touch) < 2e-13
    for fold in case["folds"]:
        assert np.abs(curve.fold_tip_offset / fold["tip_offset"] - 1).min() < 1e-6
    assert np.abs(curve.curve_energy_closure).max() < 1e-6


BAD_AXES = [
    ([], "at least two values"),
    ([1e-8], "at least two values"),
    ([[1e-8, 2e-8]], "one dimension"),
    ([1e-8, 1e-8], "only rise or only fall"),
    ([1e-8, 2e-8, 1.5e-8], "only rise or only fall"),
    ([1e-8, math.nan], "finite"),
    ("far", "numbers"),
]


@pytest.mark.parametrize(("axis", "words"), BAD_AXES)
def test_a_bad_axis_is_one_sentence(axis, words):
    with pytest.raises(pm.InputError, match=words):
        pm.sweep_distance(FILM, SCOPE, axis)


def test_a_sweep_that_leaves_the_valid_range_is_refused_before_work():
    with pytest.raises(pm.InputError, match="setpoint"):
        pm.sweep_setpoint(FILM, SCOPE, [0.9, 1.1])
    with pytest.raises(pm.InputError, match="frequencies"):
        pm.sweep_frequency(FILM, SCOPE, [-1.0, 3e5], tip_offset=1e-8)
    with pytest.raises(pm.InputError, match="modulus"):
        pm.sweep_parameter(FILM, SCOPE, "modulus", [-1e9, 1e9], setpoint=0.7)
    with pytest.raises(pm.InputError, match="one of"):
        pm.sweep_parameter(FILM, SCOPE, "colour", [1.0, 2.0], setpoint=0.7)
    with pytest.raises(pm.InputError, match="exactly one"):
        pm.sweep_parameter(FILM, SCOPE, "modulus", [1e9, 2e9])
    with pytest.raises(pm.InputError, match="samples"):
        pm.sweep_distance(FILM, SCOPE, [1e-8, 2e-8], samples=-1)


def test_a_frequency_far_below_a_second_mode_in_liquid_finds_the_lever_swinging():
    # Which rings more than fifty times a period there: too often for the elements of an exact orbit.
    lever = pm.Cantilever(0.09, 24.3e3, 2.03, modes=(pm.Eigenmode(7.34, 4.22, 39.2),))
    scope = pm.Microscope(lever, pm.Tip(10e-9), pm.Drive(10e-9, excitation="base"))
    material, frequencies = pm.Material(1e9, 1e-3, damping=0.01), np.linspace(2.43e3, 4.5e3, 6)
    found = pm.sweep_frequency(material, scope, frequencies, tip_offset=200e-9)
    assert (found.status == 0).all() and found.sizes["jump"] == 0
    free = [replace(scope, drive=replace(scope.drive, frequency=f)).driven_amplitude for f in frequencies]
    np.testing.assert_allclose(found.amplitude, [free, free], rtol=2e-6)  # as march states of itself
    below = pm.sweep_frequency(material, scope, frequencies[:2], tip_offset=200e-9)  # where there is no curve at all
    np.testing.assert_allclose(below.amplitude, [free[:2], free[:2]], rtol=2e-6)


@pytest.mark.parametrize("viscosity", [None, 5.0])
def test_a_sweep_that_begins_without_memory_goes_on_with_it(viscosity):
    lever = pm.Cantilever(40.0, 300e3, 400.0)
    scope = pm.Microscope(lever, pm.Tip(10e-9), pm.Drive(20e-9), pm.Interaction(withdrawal="ting"))
    material = pm.Material(1e9, 0.05, viscosity=viscosity)
    found = pm.sweep_parameter(material, scope, "viscosity", [0.0, 5.0, 10.0], setpoint=0.7)
    assert (found.status == 0).all()
    for value in found.viscosity.values:
        pixel = pm.solve_pixel(replace(material, viscosity=float(value)), scope, 0.7)
        # Both are good to 5e-5 degree.
        np.testing.assert_allclose(found.phase.sel(viscosity=value), pixel.phase, atol=1e-4)


def test_a_sweep_of_the_setpoint_says_that_time_was_spent_where_it_was(monkeypatch):
    row = np.full(col.FULL, np.nan)
    monkeypatch.setattr(OffOrbit, "go", lambda *_: (col.NOT_SETTLED, row))
    monkeypatch.setattr(SlowFeedback, "far", lambda _: TipPlace(OffOrbit(row), 0.0))
    scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(20e-9))
    found = pm.sweep_setpoint(pm.Material(1e9, 0.05), scope, [0.5, 0.7])
    assert (found.status == pm.Status.not_settled.code).all()


@pytest.mark.parametrize("case", load("lowered"), ids=lambda case: case["name"])
def test_a_sweep_goes_on_in_time_where_it_meets_no_stable_orbit(case):
    # tests/reference/make_lowered.py, in fixed steps of order 4, is good to 0.5 pm.
    frequency, ratio = 60e3, case["ratio"]
    off = case["quality_factor"] * math.hypot(1 - ratio**2, ratio / case["quality_factor"])
    lever = pm.Cantilever(case["stiffness"], frequency, case["quality_factor"])
    scope = pm.Microscope(lever, pm.Tip(case["radius"]), pm.Drive(case["free_amplitude"] * off, frequency * ratio))
    material = pm.Material(case["modulus"], case["adhesion"], poisson_ratio=case["poisson_ratio"])
    found = pm.sweep_distance(material, scope, case["tip_offsets"])
    assert (found.status == 0).all()
    lowered = found.amplitude.sel(direction="approach")
    np.testing.assert_allclose(lowered, case["amplitudes"], rtol=0, atol=1e-12)
    assert (pm.sweep_setpoint(material, scope, [0.5, 0.7]).status == 0).all()


def test_far_below_resonance_a_second_mode_rings_too_often_for_orbits_and_sweeps_go_on_in_time():
    lever = pm.Cantilever(40.0, 60e3, 100.0, modes=2)
    scope = pm.Microscope(lever, pm.Tip(10e-9), pm.Drive(20e-9 * 99, 6e3))
    material = pm.Material(1e9, 0.05)
    found = pm.sweep_distance(material, scope, [8e-9, 30e-9])
    share = float(found.amplitude[0, 0]) / scope.driven_amplitude
    held = pm.sweep_setpoint(material, scope, [share, 0.995])
    assert (found.status == 0).all() and (held.status == 0).all()
    # Both are means of motion that repeats itself after several periods, if ever.
    np.testing.assert_allclose(held.tip_offset.values[:, 0], 8e-9, atol=2e-11)


def test_each_row_of_a_sweep_in_time_is_seen_by_its_own_lever():
    # A wet base in liquid, whose motion the detector takes off: by another free amplitude phases would be degrees off.
    lever = pm.Cantilever(0.5, 30e3, 3.0, participation=1)
    scope = pm.Microscope(lever, pm.Tip(10e-9), pm.Drive(10e-9, excitation="base"))
    material = pm.Material(1e9, relaxed_modulus=0.5e9, relaxation_time=1e-6)
    found = pm.sweep_parameter(material, scope, "free_amplitude", [10e-9, 20e-9], setpoint=0.7)
    for value in found.free_amplitude.values:
        pixel = pm.solve_pixel(material, replace(scope, drive=replace(scope.drive, free_amplitude=float(value))), 0.7)
        here = found.sel(free_amplitude=value)
        np.testing.assert_allclose(here.phase, pixel.phase, atol=2e-3)  # as `march` states of itself at low Q
        np.testing.assert_allclose(here.amplitude, pixel.amplitude, rtol=1e-5)


def test_the_step_that_closes_a_curve_is_searched_too() -> None:
    scope = pm.Microscope(pm.Cantilever(20.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(5e-9, frequency=299633.0))
    for offset in (0.4e-9, 1.4e-9, 1.6e-9, 1.9e-9):  # where an attractive curve, which is closed, was begun or not
        found = pm.orbits(pm.Material(5e9, 0.02, 0.01), scope, tip_offset=offset)
        assert found.stable.values.tolist() == [1, 0, 1] and found.attrs["complete"] == 1


def test_orbits_whose_neck_never_breaks_are_found() -> None:
    scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 60.0), pm.Tip(10e-9), pm.Drive(5e-9), pm.Interaction("maugis"))
    found = pm.orbits(pm.Material(1e9, 0.06), scope, tip_offset=-1e-9)
    assert found.stable.values.tolist() == [1] and float(found.indentation[0]) > 1e-9
