"""Presets of materials and levers: what they are made of, and that a scene takes them."""

from __future__ import annotations

import dataclasses
import itertools
import math
import re
import tomllib
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest

import phasemap as pm
from phasemap._shared.fields import number_of
from phasemap.cli import main
from phasemap.experiment.presets import levers, materials, preset_of
from phasemap.scenes.ensemble import load_ensemble
from phasemap.scenes.scene import load_setup

FILE: dict[str, Any] = tomllib.loads((files("phasemap.experiment") / "presets.toml").read_text(encoding="utf-8"))
GROUPED = {
    which: {name: one for kind in FILE[which].values() for name, one in kind.items()}
    for which in ("materials", "levers")
}
SCENE = Path(__file__).parents[2] / "samples/step.toml"
REFERENCE_FREQUENCY, TIP_TENSION = 300e3, 0.040


def test_there_are_many_and_each_makes_an_object_of_usual_numbers() -> None:
    with pm.strict_units():
        assert len({pm.Material.preset(name) for name in materials()}) == len(materials()) >= 25
        assert len([pm.Cantilever.preset(name) for name in levers()]) >= 15
    for wanted in ("PS", "PMMA", "LDPE", "PDMS", "PP", "PET", "epoxy", "mica", "Si", "graphite", "gold", "DNA"):
        assert wanted in materials()


@pytest.mark.parametrize(("every", "cls"), [(materials, pm.Material), (levers, pm.Cantilever)])
def test_every_number_lies_in_its_range_and_has_a_source(every: Any, cls: Any) -> None:
    for preset in every().values():
        for name, quoted in preset.numbers.items():
            assert quoted.low <= quoted.value <= quoted.high, (preset.name, name)
            assert quoted.source and (name == "thickness" or number_of(cls, name))


def test_adhesion_and_loss_and_quality_factors_are_marked_as_estimates() -> None:
    for one in materials().values():
        assert one.numbers["adhesion"].is_estimate
        # What loses energy by relaxing has no viscosity beside it.
        assert "relaxation_time" in one.numbers or one.numbers["viscosity"].is_estimate
    assert all(one.numbers["quality_factor"].is_estimate for one in levers().values())
    assert not any(one.numbers["modulus"].is_estimate for one in materials().values())


# Two digits are given.
def test_estimates_follow_the_rules_that_their_sources_state() -> None:
    for name, table in GROUPED["materials"].items():
        adhesion, viscosity = table["adhesion"], table.get("viscosity", {"source": "none"})
        if adhesion["source"] == "wetting":
            rule = 2 * math.sqrt(TIP_TENSION * adhesion["surface_tension"])
            assert adhesion["value"] == pytest.approx(rule, rel=0.05), name
        if viscosity["source"] == "loss":
            stiff = table["modulus"]["value"] / (1 - table["poisson_ratio"]["value"] ** 2)
            rule = 2 * stiff * viscosity["loss_tangent"] / (2 * math.pi * REFERENCE_FREQUENCY)
            assert viscosity["value"] == pytest.approx(rule, rel=0.05), name
    used = {one["source"] for kind in ("materials", "levers") for table in GROUPED[kind].values()
            for one in table.values() if isinstance(one, dict)}  # fmt: skip
    assert used == set(FILE["sources"])


# The arms of the series that `catsiff` names [s, shear modulus in Pa, E = 3 G], those between 150 kHz and 1.2 MHz.
PIB_SERIES = (
    (4.85e-9, 8.227e8), (2.25e-8, 6.315e8), (9.65e-8, 3.607e8), (3.83e-7, 1.533e8), (1.67e-6, 4.522e7),
    (7.2e-6, 2.23e7), (2.89e-5, 6.1e6), (1.48e-4, 2.61e6), (5.87e-4, 1.11e6),
)  # fmt: skip


@pytest.mark.parametrize("frequency", [150e3, 300e3, 600e3, 1.2e6])
def test_polyisobutylene_relaxes_as_its_source_says_from_150_kilohertz_to_1_2_megahertz(frequency: float) -> None:
    rubber, turn = pm.Material.preset("PIB"), 2j * math.pi * frequency
    assert rubber.relaxation_time is not None and rubber.relaxed_modulus is not None
    wanted = 3 * sum(modulus * turn * time / (1 + turn * time) for time, modulus in PIB_SERIES)
    arm = turn * rubber.relaxation_time / (1 + turn * rubber.relaxation_time)
    assert abs(rubber.relaxed_modulus + (rubber.modulus - rubber.relaxed_modulus) * arm - wanted) < 0.22 * abs(wanted)


def test_names_are_found_in_any_case_and_in_words_and_changes_are_taken() -> None:
    plain = pm.Material.preset("PS")
    assert plain == pm.Material.preset("ps") == pm.Material.preset("polystyrene")
    assert pm.Material.preset("PS", modulus="2 GPa").modulus == 2e9
    damped = pm.Material.preset("PS", damping=0.01)
    assert (plain.viscosity, plain.damping) == (33.0, 0.0) and (damped.viscosity, damped.damping) == (None, 0.01)
    with pytest.raises(
        pm.InputError, match=r"preset is 'PSS'; allowed: .* `phasemap presets` lists\. Did you mean 'PS'"
    ):
        pm.Material.preset("PSS")
    with pytest.raises(pm.InputError, match="stiffness is '3 nm'"):
        pm.Cantilever.preset("PPP-FMR", stiffness="3 nm")


@pytest.mark.parametrize(("stiffness", "radius"), [(40.0, 10e-9), (2.0, 20e-9)])
def test_a_preset_loses_what_its_loss_tangent_says_under_every_lever(stiffness: float, radius: float) -> None:
    lever, free = pm.Cantilever(stiffness, REFERENCE_FREQUENCY, 400.0), pm.Drive(40e-9)
    scope = pm.Microscope(lever, pm.Tip(radius), free, pm.Interaction("hertz", decay_length=None))
    surface = pm.Surface.from_labels([[0]], [pm.Material.preset("PMMA", adhesion=0.0)], pixel_size=1e-9)
    image = pm.simulate(surface, scope, 0.7, solver="averaging")
    told = GROUPED["materials"]["PMMA"]["viscosity"]["loss_tangent"]
    assert float(pm.channels(image).loss_tangent[0, 0]) == pytest.approx(told, rel=0.01)  # two digits are given


def test_a_viscosity_beside_a_damping_is_the_damping_that_it_is_under_the_lever_of_the_scene() -> None:
    scene = pm.load_scene(SCENE, ["materials.stiff.viscosity=20 Pa s", "materials.stiff.damping=0"])
    lever, tip = scene.microscope.cantilever, scene.microscope.tip
    wanted = 20.0 * tip.radius * 2 * math.pi * lever.resonance_frequency / (2 * lever.stiffness)
    assert scene.surface.damping is not None and scene.surface.viscosity is None
    assert float(scene.surface.damping.min()) == pytest.approx(wanted, rel=1e-12)
    both = [pm.Material.preset("PS"), pm.Material(1e9, damping=0.01)]
    with pytest.raises(pm.InputError, match="a viscosity in its place, as material 0 has, or a damping there too"):
        pm.Surface.from_labels([[0, 1]], both, pixel_size=1e-9)


def test_a_scene_takes_presets_and_numbers_beside_them(tmp_path: Path) -> None:
    numbers = ("modulus", "adhesion", "damping", "poisson_ratio", "stiffness", "resonance", "quality")
    lines = SCENE.read_text().splitlines(keepends=True)
    path = tmp_path / "scene.toml"
    path.write_text("".join(line for line in lines if not line.startswith(numbers)))
    presets = ["materials.stiff.preset=PMMA", "materials.compliant.preset=ldpe", "cantilever.preset=PPP-NCHR"]
    changes = ["materials.stiff.adhesion=50 mJ/m2", "cantilever.quality_factor=500"]
    scene = pm.load_scene(path, presets + changes)
    assert scene.microscope.cantilever == pm.Cantilever.preset("PPP-NCHR", quality_factor=500.0)
    made = {tuple(row) for row in scene.surface.unique()[0].tolist()}
    wanted = pm.Material.preset("LDPE"), pm.Material.preset("PMMA", adhesion=0.05)
    assert made == {(one.modulus, one.adhesion, one.viscosity, one.poisson_ratio) for one in wanted}
    with pytest.raises(pm.InputError, match=r"\[materials.stiff\] preset is 'LDP'; .*Did you mean 'LDPE'"):
        pm.load_scene(path, [*presets, "materials.stiff.preset=LDP"])
    with pytest.raises(pm.InputError, match=r"\[tip\] preset is unknown"):
        pm.load_scene(path, [*presets, "tip.preset=sharp"])


@pytest.mark.parametrize("sample", sorted(SCENE.parent.glob("*.toml")), ids=lambda path: path.stem)
def test_a_preset_that_is_set_last_takes_the_place_of_the_numbers_of_every_sample(sample: Path) -> None:
    for lever in levers():
        set_last = ["cantilever.stiffness=3", f"cantilever.preset={lever}", "cantilever.quality_factor=77"]
        assert load_setup(sample, set_last).microscope.cantilever == pm.Cantilever.preset(lever, quality_factor=77)
    for name, known in itertools.product(load_setup(sample).materials, materials()):
        key = f"materials.{name}"
        assert load_setup(sample, [f"{key}.preset={known}"]).materials[name] == pm.Material.preset(known)
        set_last = [f"{key}.damping=0.5", f"{key}.preset={known}", f"{key}.adhesion=0.02"]
        assert load_setup(sample, set_last).materials[name] == pm.Material.preset(known, adhesion=0.02)


def test_a_preset_of_a_material_that_the_scene_does_not_have_is_refused() -> None:
    with pytest.raises(
        pm.InputError, match=r"material is 'stif'; allowed: one of compliant, stiff\. Did you mean 'stiff'"
    ):
        load_setup(SCENE, ["materials.stif.preset=PDMS"])
    added = ["materials.third.preset=PDMS", 'surface.materials=["compliant", "third"]']
    assert load_setup(SCENE, added).materials["third"] == pm.Material.preset("PDMS")


def test_a_preset_keeps_what_it_does_not_state() -> None:
    setup = load_setup(SCENE, ["materials.stiff.thickness=1e-6", "materials.stiff.preset=PMMA"])
    assert setup.materials["stiff"] == pm.Material.preset("PMMA", thickness=1e-6)


def test_an_ensemble_takes_presets_and_refuses_those_of_numbers_that_it_varies(tmp_path: Path) -> None:
    sample, few = SCENE.with_name("ensemble.toml"), ["ensemble.count=2"]
    made = load_ensemble(sample, [*few, "materials.ps.preset=PMMA", "cantilever.preset=AC240TS"]).scene(1)
    assert made.microscope.cantilever == pm.Cantilever.preset("AC240TS")
    assert made.config["materials"]["ps"] == dataclasses.asdict(pm.Material.preset("PMMA"))
    with pytest.raises(
        pm.InputError, match=r"that the ensemble does not vary, not materials.ldpe.damping, materials.ldpe.m"
    ):
        load_ensemble(sample, [*few, "materials.ldpe.preset=PDMS"])
    text = sample.read_text().replace("materials.ldpe.damping = { low = 0.005, high = 0.05 }", "")
    (tmp_path / "vary.toml").write_text(text.replace("[0.6, 0.7, 0.8]", "[0.7]\nmaterials.ldpe.preset = ['PDMS']"))
    made = load_ensemble(tmp_path / "vary.toml", few).scene(1)
    assert made.config["materials"]["ldpe"]["viscosity"] == pm.Material.preset("PDMS").viscosity
    assert 0.1e9 <= made.config["materials"]["ldpe"]["modulus"] <= 1e9  # which is varied beside the preset


def test_the_summary_says_what_a_preset_made_of_the_scene(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["validate", str(SCENE), "materials.stiff.preset=PMMA", "cantilever.preset=AC240TS"]) == 0
    said = capsys.readouterr().out
    assert "lever       stiffness 2 N/m" in said and "stiff       modulus 2.7 GPa" in said


def test_the_command_lists_them_and_shows_the_sources_of_one(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["presets"]) == 0
    said = capsys.readouterr().out
    assert all(f"\n  {name} " in said for name in (*materials(), *levers()))
    assert said.index("polymers\n") < said.index("\nmetals\n") < said.index("\nstiff levers, for tapping in air\n")
    assert "~0.074 J/m²" in said and "~ marks an estimate." in said
    assert "stiffness  resonance  length  width  thickness  Q" in said and max(map(len, said.splitlines())) <= 110
    assert main(["presets", "ps"]) == 0
    said = capsys.readouterr().out
    assert "2.8 GPa, in the range 2.28 GPa to 3.28 GPa" in said and "Callister" in said and "estimate" in said
    assert main(["presets", "pib"]) == 0
    assert "relaxation time" in capsys.readouterr().out
    assert main(["presets", "AC160"]) == 0
    said = capsys.readouterr().out
    assert "thickness           3.7 µm" in said and said.count("as the maker states them") == 1
    assert main(["presets", "PPP-NCH"]) == 2
    assert "Did you mean 'PPP-NCHR'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("written", "name"),
    [("OMCL-AC160TS", "OMCL-AC160TS"), ("AC160TS", "OMCL-AC160TS"), ("hq nsc15", "HQ:NSC15"), ("HOPG", "graphite"),
     ("AC160", "OMCL-AC160TS"), ("ac240ts-r3", "OMCL-AC240TS"), ("HQ:NSC15/AL BS", "HQ:NSC15"),
     ("tap300-g", "Tap300Al-G"), ("scanasyst air", "SCANASYST-AIR"),
     ("Scanasyst-Fluid+", "SCANASYST-FLUID+"), ("Olympus OMCL-AC240TS", "OMCL-AC240TS"), ("natural rubber", "NR")],
)  # fmt: skip
def test_what_stands_on_the_box_and_what_everybody_says_are_names(written: str, name: str) -> None:
    assert preset_of("", written).name == name


@pytest.mark.parametrize(
    ("written", "near"),
    [
        ("polyethylene", "'LDPE' or 'HDPE' or 'UHMWPE'"),
        ("rubber", "'PIB' or 'SBR' or 'NR'"),
        ("fluid+", "'SCANASYST-FLUID+'"),
    ],
)
def test_names_that_contain_what_was_written_are_suggested_first(written: str, near: str) -> None:
    with pytest.raises(pm.InputError, match=re.escape(f"Did you mean {near}?")):
        preset_of("", written)


def test_no_name_stands_for_two_presets() -> None:
    for one in (*materials().values(), *levers().values()):
        assert all(preset_of("", name) is one for name in (one.name, one.title, *one.also)), one.name


# What a maker states of a silicon lever is one beam. From the stiffness follows a thickness, and from it a frequency
# without a tip, which is lower with one; the free ends of the Olympus levers are pointed, and light.
def test_dimensions_stiffness_and_frequency_of_a_lever_belong_to_one_silicon_beam() -> None:
    modulus, density = 169e9, 2330.0
    beams = [one for one in levers().values() if "thickness" in one.numbers]
    assert len(beams) >= 20
    for one in beams:
        length, width = one.values["length"], one.values["width"]
        told, thickness = (
            one.numbers["thickness"],
            (4 * one.values["stiffness"] * length**3 / modulus / width) ** (1 / 3),
        )
        assert told.low < thickness < told.high, one.name
        assert thickness == pytest.approx(told.value, rel=0.12), one.name
        bare = 0.1615 * told.value / length**2 * math.sqrt(modulus / density)
        assert "Olympus" in one.title or 0.98 < bare / one.values["resonance_frequency"] < 1.3, one.name


def test_the_stiffest_and_softest_lever_of_a_kind_have_the_extreme_dimensions_that_its_maker_allows() -> None:
    told = [
        one.numbers
        for one in levers().values()
        if "thickness" in one.numbers and not one.numbers["thickness"].is_estimate
    ]
    assert len(told) >= 15
    for one in told:
        stiffness, length, width, thickness = (one[name] for name in ("stiffness", "length", "width", "thickness"))
        softest = 169e9 * width.low * thickness.low**3 / (4 * length.high**3)
        stiffest = 169e9 * width.high * thickness.high**3 / (4 * length.low**3)
        assert softest == pytest.approx(stiffness.low, rel=0.4) and stiffest == pytest.approx(stiffness.high, rel=0.4)


def test_in_water_levers_are_as_their_sources_say() -> None:
    assert "2 (soft levers) to 9 (stiff ones), and the resonance a fifth to a half" in FILE["sources"]["air"]
    for lever in map(pm.Cantilever.preset, levers()):
        if lever.length is not None:
            wet = lever.in_liquid()
            assert 1.95 < wet.quality_factor < 9
            assert 0.2 < wet.resonance_frequency / lever.resonance_frequency < 0.56
