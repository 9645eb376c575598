"""The explorer: what a setting shows is what Python gives, and the reasons that it states are those of the physics."""

from __future__ import annotations

import io
import json
import math
import tomllib
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import phasemap as pm
from phasemap._shared.errors import InputError
from phasemap._shared.interrupts import stoppable
from phasemap.explorer import answers, routes
from phasemap.explorer.limits import accuracy_of
from phasemap.explorer.offered import SAMPLES as SAMPLE_NAMES
from phasemap.explorer.offered import Offered, Opened, first_of
from phasemap.explorer.saving import SAVED, python_of
from phasemap.explorer.setting import Setting, knobs, starred, values_of
from phasemap.explorer.subject import Subject, subject_of
from phasemap.results.descriptions import describe_alike
from phasemap.results.explanation import PointMotion, lines_of, shown_number
from phasemap.scenes.scene import load_scene, scene_from_tables

SAMPLES = Path(__file__).parents[2] / "samples"
STEP = str(SAMPLES / "step.toml")
SMALL = "surface.shape=[6, 8]"
LEVER = pm.Cantilever(40.0, 300e3, 400.0)
SCOPE = pm.Microscope(LEVER, pm.Tip(10e-9), pm.Drive(20e-9))
SOFT, HARD = pm.Material(0.5e9, 0.1, 0.1, poisson_ratio=0.48), pm.Material(3e9, 0.05, 0.005)


def surface_of(*materials: pm.Material) -> pm.Surface:
    labels = np.arange(4 * len(materials)).reshape(2, -1) % len(materials)
    return pm.Surface.from_labels(labels, dict(enumerate(materials)), pixel_size=4e-9)


def step(changes: dict[str, Any] | None = None, **message: Any) -> Setting:
    return Setting.of(subject_of(STEP, overrides=[SMALL]), {"changes": changes or {}, **message})


def shown(setting: Setting) -> list[PointMotion]:
    """What the page is told of each material."""
    told = answers.picture(setting).about["materials"]
    return [PointMotion(**{key: math.nan if value is None else value for key, value in one.items()}) for one in told]


def test_the_image_of_a_setting_is_the_one_that_the_scene_has_with_these_values() -> None:
    moved = step({"scan.setpoint": 0.6, "tip.radius": 12e-9, "materials.0.modulus": 0.4e9})
    overrides = [SMALL, "scan.setpoint=0.6", "tip.radius=12e-9", "materials.compliant.modulus=0.4e9"]
    expected = load_scene(STEP, overrides).simulate()
    xr.testing.assert_equal(answers.image(moved), expected)
    picture = answers.picture(moved)
    np.testing.assert_array_equal(picture.phase, expected.phase.values.astype(np.float32))
    heights = (expected.height.values - expected.height.values.min()) * 1e9
    np.testing.assert_allclose(picture.height, heights, rtol=1e-6, atol=1e-6)


def test_edges_as_wide_as_the_tip_are_in_the_image_and_the_page_says_that_it_shows_them_sharp() -> None:
    overrides = [SMALL, "surface.seen_by_tip=true"]
    moved = Setting.of(subject_of(STEP, overrides=overrides), {"changes": {"scan.setpoint": 0.6}})
    xr.testing.assert_equal(answers.image(moved), load_scene(STEP, [*overrides, "scan.setpoint=0.6"]).simulate())
    assert moved.subject.blurred and not moved.subject.plain
    assert len(np.unique(answers.picture(moved).phase)) == 2 < len(np.unique(answers.image(moved).phase))


def test_the_image_of_a_law_with_parameters_is_that_of_its_scene_too() -> None:
    overrides = [SMALL, 'interaction.contact={law="capillary", humidity=0.3}', "surface.seen_by_tip=true"]
    shown = answers.image(Setting.of(subject_of(STEP, overrides=overrides), {"changes": {}}))
    xr.testing.assert_equal(shown, load_scene(STEP, overrides).simulate())
    assert "scene" in shown.attrs


def test_exact_orbits_are_solved_where_they_are_asked_for() -> None:
    assert {found.solver for found in shown(step(exact=True))} <= {"orbit", "corrected"}
    assert answers.image(step(exact=True)).attrs["configuration"].count('"solver": "orbit"') == 1


# cos(phase) = (E_contact + E_air) / (pi k u0 A), of the first harmonic; the higher ones take a little too.
@pytest.mark.parametrize("frequency", [None, 299.8e3])
@pytest.mark.parametrize("setpoint", [0.6, 0.8])
def test_the_losses_that_are_stated_give_the_phase_that_is_stated(setpoint: float, frequency: float | None) -> None:
    subject = subject_of(surface_of(SOFT, HARD), replace(SCOPE, drive=pm.Drive(20e-9, frequency)), setpoint)
    for found in shown(Setting.of(subject, {})):
        assert (found.lost + found.air) / found.most == pytest.approx(math.cos(math.radians(found.tip_phase)), abs=2e-3)


@pytest.mark.parametrize("contact", ["dmt", "capillary"])
def test_a_viscous_material_beside_one_that_relaxes_is_shown_as_it_is_alone(contact: str) -> None:
    scope = pm.Microscope(pm.Cantilever(20.0, 300e3, 30.0), pm.Tip(10e-9), pm.Drive(20e-9), pm.Interaction(contact))
    viscous = pm.Material(2e9, 0.02, viscosity=100.0)
    changes = {"relaxed_modulus": 0.5e9, "relaxation_time": 1e-7, "viscosity": 0.0}
    subject = subject_of(surface_of(replace(viscous, modulus=1e9), viscous), scope, 0.6)
    setting = Setting.of(subject, {"changes": {f"materials.0.{name}": value for name, value in changes.items()}})
    assert [one.phase for one in shown(setting)] == [
        pm.solve_pixel(one, scope, 0.6).phase for one in setting.materials.values()
    ]


def test_a_lossier_material_is_darker_where_both_are_repulsive_and_the_reason_is_said() -> None:
    lossy = replace(HARD, damping=0.1)
    subject = subject_of(surface_of(HARD, lossy), replace(SCOPE, drive=pm.Drive(40e-9)), 0.7)
    hard, soft = shown(Setting.of(subject, {}))
    assert hard.regime == soft.regime == "repulsive" and soft.lost > hard.lost and soft.phase < hard.phase
    first, second = lines_of(hard, soft)
    assert first.startswith(
        f"material B is {hard.phase - soft.phase:.3g}° darker than material A, because it loses more"
    )
    assert "loss pulls the phase towards 0, which is darker here" in second


@pytest.fixture
def small_map(monkeypatch: pytest.MonkeyPatch) -> None:
    """A map of few points: what it says of each is asked, not how many it has."""
    monkeypatch.setattr(answers, "SETPOINTS", answers.SETPOINTS[2::5])
    monkeypatch.setattr(answers, "AMPLITUDES", answers.AMPLITUDES[::4])


@pytest.mark.usefixtures("small_map")
def test_the_lag_is_ninety_degrees_less_the_phase_and_what_is_darker_in_one_is_brighter_in_the_other() -> None:
    plain, lag = step(), step(lag=True)
    before, after = answers.picture(plain), answers.picture(lag)
    np.testing.assert_allclose(after.phase, 90 - before.phase, atol=1e-4)
    for one, other in zip(before.about["materials"], after.about["materials"], strict=True):
        assert other["phase"] == 90 - one["phase"]
    (said, law, *_), (turned, turned_law, *_) = before.about["why"], after.about["why"]
    words = ("darker", "brighter") if "darker" in said else ("brighter", "darker")
    assert turned == said.replace(*words)
    assert "the phase towards 0" in law and "the lag towards 90°" in turned_law
    curve, other = (next(iter(answers.curves(one).values())) for one in (plain, lag))
    assert other["point"] == [*curve["point"][:2], 90 - curve["point"][2]]
    np.testing.assert_allclose(
        answers.contrast_map(lag)["contrast"], -np.array(answers.contrast_map(plain)["contrast"])
    )
    assert "lag=True" in python_of(lag)


def test_the_first_image_is_averaged_which_is_close_to_the_exact_one_and_compiles_sooner() -> None:
    quick, exact = (answers.picture(step(quick=quick)) for quick in (True, False))
    assert {one["solver"] for one in quick.about["materials"]} == {"averaging"}
    np.testing.assert_allclose(quick.phase, exact.phase, atol=0.2)  # degrees; first order in 1/Q of 400


def test_where_the_regimes_differ_they_and_not_the_losses_are_the_reason() -> None:
    subject = subject_of(SAMPLES / "particles.toml", setpoint=0.7)
    hard, soft = shown(Setting.of(subject, {}))
    assert (hard.regime, soft.regime) == ("repulsive", "attractive")
    first, second = lines_of(hard, soft)
    assert "darker than matrix, because matrix is repulsive and rubber attractive" in first
    # Lossless materials would show +- arccos(setpoint) at resonance.
    assert f"the contrast would be −{2 * math.degrees(math.acos(0.7)):.3g}°" in second


def test_losses_are_no_reason_where_they_do_not_give_the_phases() -> None:
    hard, soft = shown(step())
    assert hard.explained == pytest.approx(hard.phase, abs=0.2)
    assert lines_of(hard, soft)[0].split(",")[1].startswith(" because it loses")
    odd = soft._replace(phase=hard.phase + 1.0, tip_phase=hard.phase + 1.0)
    first, second = lines_of(hard, odd)
    assert first == "stiff is 1° brighter than compliant." and "higher harmonics" in second


def test_equal_materials_look_alike() -> None:
    subject = subject_of(STEP, overrides=[SMALL])
    both = replace(HARD, modulus=1e9, adhesion=0.05, damping=0.01)
    alike = Setting(
        subject, SCOPE, 0.7, pm.Engage(), pm.Realism(), dict.fromkeys(subject.materials, both), ("compliant", "stiff")
    )
    assert lines_of(*shown(alike))[0].startswith("stiff and compliant look alike (0°)")
    same = {f"materials.{i}.{name}": getattr(both, name) for i in (0, 1) for name in ("modulus", "adhesion", "damping")}
    assert Setting.of(subject, {"changes": same}).surface.unique()[0].shape[0] <= 2


def test_a_material_without_an_orbit_says_what_helps() -> None:
    stuck = pm.Microscope(pm.Cantilever(0.1, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(2e-9))
    found = shown(Setting.of(subject_of(surface_of(pm.Material(0.0)), stuck, 0.7), {}))
    assert math.isnan(found[0].phase) and found[0].advice
    assert lines_of(found[0], found[0]) == [f"material A has no orbit here. {found[0].advice}"]


def test_a_material_that_fails_is_not_compared_with_one_that_does_not() -> None:
    failed, good = shown(Setting.of(subject_of(surface_of(pm.Material(0.0), HARD), SCOPE), {}))
    assert math.isnan(failed.phase) and not math.isnan(good.phase)
    assert lines_of(failed, good) == [
        f"material A has no orbit here, so that the two cannot be compared. {failed.advice}"
    ]
    image = answers.image(Setting.of(subject_of(surface_of(pm.Material(0.0), HARD), SCOPE), {}))
    assert describe_alike(image, 2) == []


@pytest.mark.parametrize(
    ("answer", "control"),
    [
        *((answer, "engage") for answer in (answers.picture, answers.curves, answers.contrast_map, answers.image)),
        *((answers.scan, control) for control in ("raster", "feedback")),
    ],
)
def test_every_answer_can_be_stopped(answer: Callable[[Setting], object], control: str) -> None:
    def stop() -> None:
        raise InterruptedError

    subject = subject_of(STEP, overrides=[SMALL, f'control.kind="{control}"'])
    with stoppable(stop), pytest.raises(InterruptedError):
        answer(Setting.of(subject, {}))


@pytest.mark.slow
def test_a_drive_far_from_the_resonance_is_integrated_in_few_periods_and_the_page_says_that_it_is_far() -> None:
    far, slow = step({"drive.frequency": 30e3}), step({"drive.frequency": 3e3})
    assert accuracy_of(far.scope).periods == 100_000 and accuracy_of(slow.scope).periods == 10_000
    warned = answers.picture(far).about["warnings"]
    assert any(line.startswith("The drive at 30 kHz is far from the resonance at 300 kHz") for line in warned)
    assert answers.picture(step()).about["warnings"] == []


def test_the_page_warns_of_what_the_command_line_warns_of() -> None:
    wide = step({"drive.free_amplitude": 5e-6})
    usual, deep = answers.picture(wide).about["warnings"]
    assert usual == "free_amplitude = 5e-06 m; usual 50 pm … 1 µm."
    assert "the tip sinks in deeper than its radius" in deep


def test_a_bistable_material_has_both_branches_on_its_curve_and_is_said_to_be_bistable() -> None:
    subject = subject_of(surface_of(pm.Material(2e9, 0.1)), replace(SCOPE, drive=pm.Drive(16e-9)), 0.8)
    (found,) = shown(Setting.of(subject, {}))
    assert found.bistable
    assert "the controller can hold this setpoint in the repulsive regime too" in lines_of(found, found)[1]
    curve = answers.curves(Setting.of(subject, {}))["material A"]
    assert 0 in curve["stable"] and len(curve["jump_distance"]) == 2
    assert min(curve["phase"]) < -10 and max(curve["phase"]) > 10


def test_the_working_point_lies_on_the_curve_and_its_period_goes_as_deep_as_the_tip_indents() -> None:
    setting = step()
    for found in shown(setting):
        curve = answers.curves(setting)[found.name]
        distance, amplitude, phase = curve["point"]
        assert distance == pytest.approx(found.tip_offset * 1e9) and phase == pytest.approx(found.phase)
        near = int(np.argmin(np.abs(np.array(curve["distance"]) - distance)))
        assert curve["amplitude"][near] == pytest.approx(amplitude, abs=2e-3)
        deepest = max(curve["period"]["deflection"]) - curve["period"]["surface"]
        # 192 samples of a period miss the turning point by at most half a sample: A (pi / 192)^2 / 2.
        assert deepest == pytest.approx(found.indentation * 1e9, abs=1e-2 + amplitude * (math.pi / 192) ** 2 / 2)


def test_the_map_has_the_contrast_of_the_image() -> None:
    setting = step({"scan.setpoint": float(answers.SETPOINTS[9])})
    first, second = shown(setting)
    mapped = answers.contrast_map(setting)
    middle = len(answers.AMPLITUDES) // 2
    assert mapped["amplitudes"][middle] == pytest.approx(setting.scope.drive.free_amplitude * 1e9)
    assert mapped["contrast"][middle][9] == pytest.approx(second.phase - first.phase, abs=0.02)
    assert 0 < mapped["best"][0] < 1 and mapped["recommendation"].startswith("setpoint ")


def test_a_material_that_the_law_cannot_have_has_no_curve() -> None:
    necks = replace(SCOPE, interaction=pm.Interaction("jkr", decay_length=None))
    subject = subject_of(surface_of(pm.Material(0.0, adhesion=0.1), HARD), necks)
    assert answers.curves(Setting.of(subject, {"pair": [0, 0]})) == {"material A": None}


@pytest.mark.usefixtures("small_map")
def test_a_map_on_which_nothing_holds_recommends_no_point() -> None:
    subject = subject_of(surface_of(pm.Material(0.0), pm.Material(0.0, damping=0.1)), SCOPE)
    mapped = answers.contrast_map(Setting.of(subject, {}))
    assert mapped["best"] == [None, None] and mapped["contrast"][0][0] is None
    json.dumps(mapped, allow_nan=False)


@pytest.mark.parametrize(
    ("message", "said"),
    [
        ({"changes": {"scan.setpoint": 1.2}}, "setpoint is 1.2"),
        ({"changes": {"scan.setpoint": float("nan")}}, "setpoint is nan"),
        ({"changes": {"scan.solver": "orbit"}}, "scan solver is unknown"),
        ({"changes": {"tip.radius": -1e-9}}, "tip radius is -1e-09"),
        ({"changes": {"tip.radius": "a"}}, "tip radius is 'a'"),
        ({"changes": {"tip.radius": 1e-2}}, "tip radius is 1e+07 nm; allowed: 0.001 to 2e+05 nm in the page"),
        ({"changes": {"tip.radus": 1e-9}}, "Did you mean 'radius'?"),
        ({"changes": {"tips.radius": 1e-9}}, "changes tips is unknown"),
        ({"changes": {"radius": 1e-9}}, "changes  is unknown"),
        (
            {"changes": {"materials.0.adhesion": 1e300}},
            "adhesion is 1e+303 mJ/m²; allowed: 0 to 3e+05 mJ/m² in the page",
        ),
        ({"changes": {"drive.frequency": 1e3}}, "drive frequency is 1 kHz; allowed: 3 kHz to 30 MHz in the page"),
        ({"changes": {"drive.free_amplitude": None}}, "free_amplitude is None"),
        ({"changes": {"drive.frequency": 0}}, "drive frequency is 0"),
        ({"changes": {"materials.2.modulus": 1e9}}, "materials.2 is unknown"),
        ({"changes": {"materials.0.modulus": None}}, "compliant modulus is None"),
        ({"changes": {"materials.0.damping": -1}}, "damping is -1"),
        ({"changes": {"materials.0.viscosity": 1.0}}, "either damping or viscosity, not both"),
        ({"changes": {"interaction.contact": "glue"}}, "contact is 'glue'"),
        ({"changes": {"control.kind": "none"}}, "kind is 'none'"),
        ({"changes": {"control.line_rate": 2.0}}, "It belongs to kind = 'feedback'"),
        ({"changes": []}, "changes is []"),
        ({"names": ["one"]}, "2 names that differ"),
        ({"names": ["one", "one"]}, "2 names that differ"),
        ({"names": ["one", " "]}, "2 names that differ"),
        ({"pair": [0, 2]}, "number of a material is 2"),
        ({"pair": 1}, "two numbers of materials"),
        ({"exact": 1}, "true or false"),
        ({"change": {}}, "Did you mean 'changes'?"),
        ([], "the message is []"),
    ],
)
def test_a_value_that_is_not_allowed_is_refused_by_name(message: object, said: str) -> None:
    with pytest.raises(InputError) as refused:
        Setting.of(subject_of(STEP, overrides=[SMALL]), message)
    assert said in str(refused.value)


def test_a_value_may_be_text_with_a_unit() -> None:
    assert step({"materials.0.modulus": "1 GPa"}).materials["compliant"].modulus == 1e9
    assert step({"tip.radius": "20 nm"}).scope == step({"tip.radius": 20e-9}).scope


def test_a_value_outside_all_practice_is_refused_where_the_scene_is_strict_only() -> None:
    wide = {"changes": {"tip.radius": 1e-4}}
    assert step(**wide).scope.tip.radius == 1e-4
    subject = subject_of(STEP, overrides=["scan.strict_units=true"])
    with pytest.raises(pm.InputError, match=r"tip radius is 0\.0001 m; allowed: the usual"):
        Setting.of(subject, wide)
    assert Setting.of(subject, {}).tables()["scan"]["strict_units"] is True


def test_every_slider_and_choice_of_the_page_sets_a_key_of_a_scene() -> None:
    values = values_of(subject_of(SAMPLES / "scan.toml"))
    assert {starred(key) for key in values} >= set(knobs()) and values["control.line_rate"] == 2.0
    assert (
        Setting.of(subject_of(SAMPLES / "scan.toml"), {"changes": values}).tables()
        == Setting.of(subject_of(SAMPLES / "scan.toml"), {}).tables()
    )


def test_a_lever_can_be_put_in_water_and_the_page_says_what_becomes_of_it(tmp_path: Path) -> None:
    size = {"cantilever.length": 125e-6, "cantilever.width": 30e-6, "cantilever.modes": 2}
    moved = step({"cantilever.environment": "water", "drive.free_amplitude": 5e-9, **size})
    dry = step(size).scope.cantilever
    assert moved.scope.cantilever == dry.in_liquid() and len(dry.in_liquid().eigenmodes) == 2
    assert answers.picture(moved).about["lever"].startswith("In water the lever resonates at 163 kHz (Q 8.7) and ")
    (tmp_path / "saved.toml").write_bytes(SAVED["scene"](moved).content)
    assert load_scene(tmp_path / "saved.toml").microscope.cantilever == moved.scope.cantilever
    with pytest.raises(pm.InputError, match="environment is 'oil'; allowed: given or water"):
        step({"cantilever.environment": "oil"})


def test_a_law_and_a_control_can_be_chosen_and_are_in_the_scene_that_is_saved(tmp_path: Path) -> None:
    moved = step(
        {
            "interaction.contact": "hertz",
            "interaction.decay_length": None,
            "control.kind": "feedback",
            "control.line_rate": 4,
            "drive.excitation": "base",
            "cantilever.stiffness": 3.0,
        }
    )
    (tmp_path / "saved.toml").write_bytes(SAVED["scene"](moved).content)
    scene = load_scene(tmp_path / "saved.toml")
    assert scene.microscope == moved.scope and scene.options["control"] == pm.Feedback(line_rate=4.0)
    assert scene.microscope.interaction.decay_length is None


@pytest.mark.parametrize("sees", ["tip", "slope"])
def test_a_lever_may_have_a_second_mode_and_a_detector_that_sees_slope_or_tip(sees: str) -> None:
    changes = {"cantilever.modes": 2, "cantilever.quality_factor": 3, "drive.excitation": "base", "detector.sees": sees}
    moved = step(changes)
    assert moved.scope == replace(
        SCOPE,
        cantilever=pm.Cantilever(40.0, 300e3, 3.0, modes=2),
        drive=replace(moved.subject.scope.drive, excitation="base"),
        detector=sees,
    )
    with pytest.warns(UserWarning, match="modes of a beam in a gas"):
        assert scene_from_tables(moved.tables(), SAMPLES).microscope == moved.scope
    assert values_of(moved.subject)["cantilever.modes"] == 1
    assert all(math.isfinite(found.phase) for found in shown(moved))
    assert answers.curves(moved)["stiff"]["distance"]


def test_the_second_mode_can_be_driven_and_what_it_shows_is_said() -> None:
    driven = {"cantilever.modes": 2, "drive.second.free_amplitude": 2e-10}
    moved = step(driven)
    assert moved.scope.drive.second == pm.Mode(free_amplitude=2e-10)
    why = answers.picture(moved).about["why"]
    image = pm.simulate(moved.surface, moved.scope, moved.setpoint, variables="mode2_frequency_shift")
    labels = moved.subject.sample.labels
    for number, name in enumerate(moved.materials):
        shift = float(image.mode2_frequency_shift.values[labels == number][0])
        assert f"On {name} the second mode's resonance is {shown_number(shift)} Hz higher." in why
    assert "drive.second" in python_of(moved)
    assert scene_from_tables(moved.tables(), SAMPLES).microscope == moved.scope
    by_phase = step({**driven, "drive.second.detection": "am"})
    assert by_phase.scope.drive.second == pm.Mode(free_amplitude=2e-10, detection="am")
    assert any("pm at a phase of" in line for line in answers.picture(by_phase).about["why"])


def test_a_second_mode_that_a_scene_drives_can_be_left_alone() -> None:
    subject = subject_of(STEP, overrides=["cantilever.modes=2", "drive.second={free_amplitude='0.1 nm'}"])
    assert values_of(subject)["drive.second.free_amplitude"] == 1e-10
    alone = Setting.of(subject, {"changes": {"cantilever.modes": 1, "drive.second.free_amplitude": None}})
    assert alone.scope.drive.second is None
    assert scene_from_tables(alone.tables(), SAMPLES).microscope == alone.scope
    assert 'drive.second="none"' in python_of(alone)


def test_materials_can_be_renamed_and_may_have_a_viscosity_beside_a_damping() -> None:
    moved = step({"materials.0.damping": 0, "materials.0.viscosity": 40.0}, names=["PDMS", "glass"])
    assert list(moved.materials) == ["PDMS", "glass"]
    assert moved.materials["PDMS"].damping == pytest.approx(40.0 * 10e-9 * 2 * math.pi * 300e3 / (2 * 40.0))
    assert moved.tables()["surface"]["materials"] == ["PDMS", "glass"]
    xr.testing.assert_equal(answers.image(moved), scene_from_tables(moved.tables(), SAMPLES).simulate())


def test_a_material_that_relaxes_can_be_explored() -> None:
    relaxing = {"damping": 0, "relaxed_modulus": 0.1e9, "relaxation_time": 1e-6}
    moved = step({f"materials.{i}.{name}": value for i in (0, 1) for name, value in relaxing.items()})
    assert all(math.isfinite(found.phase) for found in shown(moved))


@pytest.mark.slow
def test_polymers_of_several_relaxation_times_can_be_explored_and_saved() -> None:
    solid = {"damping": 0, "relaxed_modulus": 0.1e9, "relaxation_time": 1e-6}
    changes = {f"materials.0.{name}": value for name, value in solid.items()}
    moved = step({**changes, "materials.1.damping": 0, "materials.1.relaxation": "PIB"})
    assert list(moved.materials.values())[1].relaxation == pm.Prony.preset("PIB")
    image = answers.image(moved)
    xr.testing.assert_equal(image, scene_from_tables(moved.tables(), SAMPLES).simulate())
    assert values_of(replace(moved.subject, materials=moved.materials))["materials.1.relaxation"] == "PIB"
    assert np.isfinite(image.phase).all()


@pytest.mark.parametrize("switch", [pytest.param("exact", marks=pytest.mark.slow), "quick"])
def test_wet_samples_can_be_explored_and_the_march_is_exact(switch: str) -> None:
    wet = {"interaction.contact": "capillary", "materials.0.contact_angle": 110.0, "materials.0.liquid_film": 0.5e-9}
    moved = step({**wet, "drive.free_amplitude": 15e-9}, **{switch: True})
    for found in shown(moved):
        assert found.solver == "march" and found.regime == "attractive"
    assert answers.image(moved).phase.values[0, [0, -1]].tolist() == [one.phase for one in shown(moved)]
    for curve in answers.curves(moved).values():
        assert curve["point"][1] == pytest.approx(0.7 * 15, rel=1e-3) and curve["period"] is None
        there, back = (np.array(curve["piece"]) == piece for piece in (0, 1))
        distance, amplitude = np.array(curve["distance"]), np.array(curve["amplitude"])
        assert distance[there].tolist() == distance[back].tolist()
        assert np.interp(curve["point"][0], distance[there][::-1], amplitude[there][::-1]) == pytest.approx(
            10.5, abs=0.01
        )


def test_a_scene_that_is_saved_makes_the_same_image_from_any_folder(tmp_path: Path) -> None:
    folder = tmp_path / "here"
    folder.mkdir()
    np.save(folder / "map.npy", np.arange(12).reshape(3, 4) % 2)
    text = Path(STEP).read_text()
    head, _, rest = text.partition("[surface]")
    rest = rest[rest.index("[materials") :]
    surface = '[surface]\nkind = "labels"\nlabels = "map.npy"\npixel_size = 4e-9\nmaterials = ["stiff", "compliant"]\n'
    (folder / "scene.toml").write_text(head + surface + rest)
    moved = Setting.of(
        subject_of(folder / "scene.toml"), {"changes": {"scan.setpoint": 0.55, "materials.0.modulus": 2000000000}}
    )
    file = SAVED["scene"](moved)
    assert file.name == "scene_explored.toml" and b"modulus = 2.0e9" in file.content
    (tmp_path / file.name).write_bytes(file.content)
    xr.testing.assert_equal(load_scene(tmp_path / file.name).simulate(), answers.image(moved))


def test_the_python_that_is_copied_makes_the_same_image(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    subject = subject_of(STEP, overrides=[SMALL])
    changes = {"drive.free_amplitude": 35e-9, "drive.frequency": 299.9e3, "materials.1.modulus": 2e9}
    moved = Setting.of(subject, {"changes": changes, "exact": True, "names": ["soft", "stiff"]})
    monkeypatch.chdir(tmp_path)
    known: dict[str, Any] = {}
    exec(python_of(moved), known)
    xr.testing.assert_equal(known["image"], answers.image(moved))
    assert (tmp_path / "step_explored.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("materials", [(SOFT, HARD), (pm.Material(1e9, 0.05, viscosity=20.0), pm.Material(3e9, 0.05))])
def test_a_surface_can_be_explored_and_saved_without_a_scene(
    materials: tuple[pm.Material, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    surface = surface_of(*materials)
    subject = subject_of(surface, SCOPE)
    changes = {"scan.setpoint": 0.65, "tip.radius": 12e-9, "materials.1.modulus": 2e9}
    lever = {"cantilever.modes": 2, "drive.second.free_amplitude": 1e-10, "detector.sees": "tip"}
    moved = Setting.of(subject, {"changes": changes | lever})
    image = answers.image(moved)
    monkeypatch.chdir(tmp_path)
    file = SAVED["scene"](moved)
    with zipfile.ZipFile(io.BytesIO(file.content)) as archive:
        archive.extractall(tmp_path)
    xr.testing.assert_equal(load_scene(tmp_path / "surface_explored.toml").simulate(), image)
    known: dict[str, Any] = {"surface": surface, "scope": SCOPE}
    exec(python_of(moved), known)
    xr.testing.assert_equal(known["image"], image)


def test_what_a_scene_cannot_say_is_refused_where_it_is_saved() -> None:
    class Own(pm.ContactLaw):
        @staticmethod
        def force(d: float, p: np.ndarray) -> float:
            return float(p[0] * d * d)

    own = Setting.of(subject_of(surface_of(SOFT), replace(SCOPE, interaction=pm.Interaction(Own()))), {})
    assert values_of(own.subject)["interaction.contact"] == "Own"
    with pytest.raises(InputError, match=r"contact is Own.*Copy the Python instead"):
        SAVED["scene"](own)


def test_a_large_image_is_shown_with_fewer_pixels_and_saved_whole() -> None:
    labels = np.zeros((300, 700), int)
    labels[:, 350:] = 1
    relief = np.linspace(0, 1e-9, labels.size).reshape(labels.shape)
    surface = pm.Surface.from_labels(labels, {0: SOFT, 1: HARD}, pixel_size=1e-9, topography=relief)
    subject = subject_of(surface, SCOPE)
    setting = Setting.of(subject, {})
    about, height, _ = answers.picture(setting)
    assert subject.step == 3 and about["shape"] == [100, 234] and about["pixel"] == pytest.approx([3e-9, 3e-9])
    np.testing.assert_allclose(height[:, 0] - height[0, 0], 1e9 * relief[::3, 0], atol=1e-5)  # [nm], on one material
    assert setting.surface == surface


def test_a_sample_that_is_dilated_is_dilated_by_the_tip_of_the_slider() -> None:
    subject = subject_of(STEP, overrides=["surface.shape=[4, 64]", "surface.dilate=true"])
    wide = Setting.of(subject, {"changes": {"tip.radius": 40e-9}}).surface
    assert wide == load_scene(STEP, ["surface.shape=[4, 64]", "surface.dilate=true", "tip.radius=40e-9"]).surface
    assert Setting.of(subject, {}).surface == load_scene(STEP, ["surface.shape=[4, 64]", "surface.dilate=true"]).surface


def test_sliders_reach_around_what_the_samples_have() -> None:
    for name in SAMPLE_NAMES:
        for key, value in values_of(subject_of(SAMPLES / f"{name}.toml")).items():
            knob = knobs().get(starred(key))
            if knob is not None and value:
                assert knob.low <= value <= knob.high, (name, key)


def test_every_sample_that_is_offered_says_what_it_is_and_can_be_explored() -> None:
    offered = Offered()
    assert offered.names().keys() == set(SAMPLE_NAMES) and all(offered.names().values())
    for name in SAMPLE_NAMES:
        assert offered.describe(name)["materials"] == list(offered[name].materials)
    assert offered[None] is offered["blend"]
    with pytest.raises(InputError, match=r"sample is 'blends'; allowed: blend, .*Open its file in the page"):
        offered["blends"]


def test_every_sample_that_is_offered_is_in_the_wheel() -> None:
    wheel = tomllib.loads((SAMPLES.parent / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["wheel"]
    assert set(wheel["force-include"]) == {f"samples/{name}.toml" for name in SAMPLE_NAMES}


@pytest.mark.parametrize(
    ("what", "name", "setpoint"),
    [(["blend"], "blend", 0.7), ([STEP], "step", 0.7), (["step", ["scan.setpoint=0.5"]], "step as given", 0.5)],
)
def test_the_explorer_begins_with_the_name_of_a_sample_or_a_file(what: list[Any], name: str, setpoint: float) -> None:
    subject = first_of(*what).subject
    assert (subject.name, subject.options["setpoint"]) == (name, setpoint)


def test_a_name_that_no_sample_has_is_refused_with_those_that_there_are() -> None:
    with pytest.raises(InputError, match=r"what is explored is 'blent'; allowed: one of blend, .*Did you mean 'blend'"):
        first_of("blent")
    with pytest.raises(pm.FileError, match=r"blent\.toml"):
        first_of("blent.toml")


def test_a_scene_file_and_a_measured_file_can_be_opened(tmp_path: Path) -> None:
    offered = Offered()
    assert offered.open("C:\\fakepath\\mine.toml", Path(STEP).read_bytes()) == "mine"
    assert list(offered["mine"].materials) == ["compliant", "stiff"] and "mine" in offered.names()
    assert SAVED["scene"](Setting.of(offered["mine"], {})).name == "mine_explored.toml"
    image = load_scene(STEP, ["surface.shape=[24, 32]"]).simulate()
    del image.attrs["configuration"]  # no instrument writes it
    image[["height", "phase"]].to_netcdf(tmp_path / "measured.nc")
    name = offered.open("measured.nc", (tmp_path / "measured.nc").read_bytes())
    assert len(offered[name].materials) == 2 and "tip radius" in offered.describe(name)["note"]
    assert SAVED["scene"](Setting.of(offered[name], {})).name == "measured_explored.zip"
    with pytest.raises(pm.FileError, match=r"cannot read notes\.txt"):
        offered.open("../notes.txt", b"hello")


@pytest.mark.parametrize("lag", [False, True])
def test_a_measured_image_stands_beside_the_simulated_one_with_its_zero_where_the_regions_agree(
    tmp_path: Path, lag: bool
) -> None:
    scene = load_scene(STEP, ["surface.shape=[24, 32]"])
    image = scene.simulate()[["height", "phase"]]
    image["phase"] = -(image.phase + 30.0)
    image["phase"].attrs["units"] = "degree"
    image.attrs["phase_sign"] = -1  # as Asylum Research counts, from any zero
    file, drive = tmp_path / "flake.toml", scene.microscope.drive.free_amplitude
    more = [f"scan.setpoint={scene.options['setpoint']}", "tip.radius=10e-9", f"drive.free_amplitude={drive}"]
    pm.scene_from(image, file, overrides=[*more, "cantilever.preset=PPP-NCHR"])
    subject = replace(subject_of(file), scope=scene.microscope)
    same = {
        f"materials.{i}.{name}": getattr(one, name)
        for i, one in enumerate(subject_of(STEP).materials.values())  # labels count from the largest lag
        for name in ("modulus", "adhesion", "damping", "poisson_ratio")
    }
    setting = Setting.of(subject, {"changes": same, "lag": lag})
    shown, measured = answers.picture(setting), subject.measured
    assert measured is not None and subject_of(STEP).measured is None
    said = shown.about["measured"]
    assert said["phase"] == pytest.approx(30.0 if lag else -30.0, abs=0.01)
    np.testing.assert_allclose(setting.counted(measured.phase) + said["phase"], shown.phase, atol=0.01)
    contrast = float(np.ptp(shown.phase)) * (-1 if lag else 1)
    assert f"measured {contrast:+.1f}°, simulated {contrast:+.1f}°" in said["says"]
    sent, pixels = routes.sample(Offered(Opened(subject)), subject.name)[1], measured.phase.size
    height, phase = np.frombuffer(sent[-9 * pixels : -pixels], np.float32).reshape(2, 24, 32)  # before the labels
    assert float(np.mean(height + said["height"] - shown.height)) == pytest.approx(0.0, abs=1e-3)  # of halves
    np.testing.assert_array_equal(phase, measured.phase.astype(np.float32))


def refused(*arguments: Any) -> str:
    with pytest.raises(InputError) as error:
        subject_of(*arguments)
    return str(error.value)


def test_what_cannot_be_explored_is_refused(tmp_path: Path) -> None:
    many = pm.Surface(modulus=np.linspace(1e9, 2e9, 12).reshape(3, 4), pixel_size=4e-9)
    assert "number of materials is 12; allowed: at most 8" in refused(many, SCOPE)
    assert "a Microscope" in refused(surface_of(SOFT))
    assert "has its own microscope" in refused(STEP, SCOPE)
    assert "a Surface, a Scene or the file of a scene" in refused(3, SCOPE)
    holes = pm.Surface(modulus=[[1e9, np.nan]], pixel_size=4e-9, allow_nan=True)
    assert "a material in every pixel" in refused(holes, SCOPE)
    maps = tmp_path / "maps.toml"
    text = Path(STEP).read_text()
    head, rest = text.partition("[surface]")[0], text[text.index("[cantilever]") :]
    maps.write_text(f'{head}[surface]\nkind = "maps"\nmodulus = [[1e9, 2e9]]\npixel_size = 4e-9\n\n{rest}')
    assert "a kind whose materials have names" in refused(maps)


def test_a_material_that_is_in_no_pixel_has_no_sliders() -> None:
    scene = load_scene(STEP, [SMALL, 'surface.materials=["stiff", "stiff"]'])
    subject: Subject = subject_of(scene)
    assert list(subject.materials) == ["stiff"]
    assert Setting.of(subject, {}).surface == scene.surface
    xr.testing.assert_equal(answers.image(Setting.of(subject, {})), scene.simulate())


@pytest.mark.parametrize("setpoint", [float("nan"), 1.2, "half"])
def test_a_setpoint_that_is_none_is_refused_before_a_page_opens(setpoint: object) -> None:
    for explored in ((STEP,), (pm.Surface.from_labels([[0, 1]], [SOFT, HARD], pixel_size=1e-9), SCOPE)):
        with pytest.raises(pm.InputError, match=r"setpoint is .*allowed: a number above 0 and below 1"):
            pm.explore(*explored, setpoint=setpoint, browser=False)  # type: ignore[arg-type]
