"""What is copied and saved is data, whatever files and materials are called: no name becomes code."""

from __future__ import annotations

import ast
import tempfile
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import phasemap as pm
from phasemap._shared.errors import InputError
from phasemap.explorer.saving import python_of
from phasemap.explorer.setting import Setting
from phasemap.explorer.subject import Subject, subject_of
from phasemap.scenes.scene import load_scene
from phasemap.scenes.tables import toml_of, written

STEP = Path(__file__).parents[2] / "samples" / "step.toml"
SMALL = "surface.shape=[6, 8]"
ATTACK = 'step"); __import__("os").system("id"); ("'
CALLS = {"pm.load_scene", "scene.simulate", "pm.plot.image"}

TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=40)
# As Linux has them: bytes that are not UTF-8 are halves of characters.
FILE_NAMES = st.text(
    st.characters(exclude_characters="/\0", exclude_categories=["Cs"]) | st.just("\udcff"), max_size=40
)


def named(folder: str, name: str, material: str = "compliant") -> Subject:
    """The small step, from a file and with a material of these names."""
    path = Path(folder, f"{name}.toml")
    text = STEP.read_text().replace('"compliant"', written(material))
    path.write_text(text.replace("[materials.compliant]", f"[materials.{written(material)}]"), encoding="utf-8")
    return subject_of(path, overrides=[SMALL])


@given(FILE_NAMES, TEXT.filter(lambda name: name != "stiff"))
@example(ATTACK, "compliant")
@example("step", ATTACK)
@example("'\\\n\udcff", "a\x7fb\\")
@settings(max_examples=30, deadline=None)
def test_python_that_is_copied_calls_nothing_but_phasemap(name: str, material: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        moved = Setting.of(
            named(folder, name, material), {"changes": {"scan.setpoint": 0.6, "materials.0.modulus": 0.3e9}}
        )
        if not material or "." in material or "=" in material or material != material.strip():
            with pytest.raises(InputError, match="a name without dots, equals signs and blanks around it"):
                python_of(moved)
            return
        script = ast.parse(python_of(moved))
        calls = [node for node in ast.walk(script) if isinstance(node, ast.Call)]
        assert {ast.unparse(call.func) for call in calls} == CALLS
        first = next(call for call in calls if ast.unparse(call.func) == "pm.load_scene")
        path, overrides = map(ast.literal_eval, first.args)
        scene = load_scene(path, overrides)
        assert scene.options["setpoint"] == 0.6 and scene.config["materials"][material]["modulus"] == 0.3e9


@given(st.dictionaries(TEXT, TEXT | st.floats(allow_nan=False) | st.integers(-(2**63), 2**63 - 1) | st.booleans()))
@example({"a\x7f": '\x7f\x00\u2028\\"\'\'\'"""\n# ['})
@settings(max_examples=200, deadline=None)
def test_every_text_and_number_comes_back_from_the_toml_that_is_written(table: dict[str, object]) -> None:
    assert tomllib.loads(toml_of({"scan": {**table, "nested": table}})) == {"scan": {**table, "nested": table}}


def test_a_file_name_that_is_no_text_cannot_be_named_in_a_scene_and_that_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"text of a TOML file is '.*\\udcff'; allowed: characters of Unicode"):
        written(str(tmp_path / "\udcff"))


def test_python_of_a_surface_of_ones_own_makes_its_microscope_and_materials() -> None:
    lever = pm.Cantilever(2.0, 75e3, 200.0, modes=(pm.Eigenmode(80.0, 470e3, 600.0),))
    scope = pm.Microscope(lever, pm.Tip(10e-9), pm.Drive(30e-9))
    slow = pm.Material(adhesion=0.02, relaxation=pm.Prony([0.5e9, 0.2e9], [1e-6, 1e-4], 0.3e9))
    surface = pm.Surface.from_labels(np.arange(6).reshape(2, 3) % 2, {0: slow, 1: pm.Material(3e9)}, pixel_size=2e-9)
    moved = Setting.of(subject_of(surface, scope, 0.7), {"changes": {"cantilever.quality_factor": 250.0}})
    moved = replace(
        moved, scope=replace(moved.scope, cantilever=replace(lever, modes=(pm.Eigenmode(90.0, 4e5, 60.0),)))
    )
    script = python_of(moved)
    assert "pm.Prony(" in script and "pm.Eigenmode(" in script
    made = {"surface": surface, "scope": scope}
    exec(script.partition("image = ")[0], made)
    assert (
        made["scope"] == moved.scope and sorted(made["materials"].values(), key=repr)[0].relaxation == slow.relaxation
    )


def test_a_lever_with_modes_is_saved_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "wet.toml"
    text = STEP.read_text().replace(
        "[tip]", 'liquid = {}\nlength = "120 um"\nwidth = "30 um"\n[detector]\nsees = "tip"\n[tip]'
    )
    path.write_text(text.replace("[drive]", '[drive]\nexcitation = "base"'), encoding="utf-8")
    subject = subject_of(path, overrides=["surface.shape=[6, 8]"])
    moved = Setting.of(subject, {"changes": {"scan.setpoint": 0.6}})
    (tmp_path / "again.toml").write_text(toml_of(moved.tables()), encoding="utf-8")
    assert load_scene(tmp_path / "again.toml").microscope == subject.scope
    script = python_of(moved)
    assert "scan.setpoint=0.6" in script and "cantilever" not in script and "detector" not in script
