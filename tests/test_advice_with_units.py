"""Every ``key=value`` with a unit that documents, messages and ``--help`` show works wherever such words are taken."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

import phasemap as pm
from phasemap._shared.quantities import in_si
from phasemap.cli.explain import SETS, microscope_of_files
from phasemap.scenes.ensemble import load_ensemble
from phasemap.scenes.samples import unit_of
from phasemap.scenes.scene import load_setup

ROOT = Path(__file__).parent.parent
SHOWN = [ROOT / "README.md", *ROOT.glob("docs/**/*.md"), *ROOT.glob("phasemap/**/*.py"), *ROOT.glob("samples/*.toml")]
UNIT = r"(?!e-?\d)[A-Za-zµ°%][A-Za-z0-9µ/²]*"
WORD = re.compile(rf"(?<![\w.])((?:[a-z]+|{{key}})(?:\.\w+)*)=(?:([\d.]+(?:e-?\d+)?{UNIT})|'?\"([\d.]+ {UNIT})\"'?)")
FIRST = "materials.material_0"
WORDS = sorted(
    {
        (key.replace("{key}", f"{FIRST}.thickness"), bare or quoted)
        for path in SHOWN
        for key, bare, quoted in WORD.findall(path.read_text(encoding="utf-8"))
        if "." in key or key == "{key}"
    }
)


def test_words_with_units_are_shown_in_messages_and_in_documents() -> None:
    assert {("drive.free_amplitude", "20nm"), ("tip.radius", "20 nm"), (f"{FIRST}.thickness", "20nm")} <= set(WORDS)


@pytest.mark.parametrize(("key", "text"), WORDS)
def test_a_word_with_a_unit_is_taken_by_scenes_sweeps_images_series_and_ensembles(
    key: str, text: str, tmp_path: Path
) -> None:
    word, wanted, (table, *_, name) = f"{key}={text}", in_si(text, unit_of(key)), key.split(".")
    scope = pm.Microscope(pm.Cantilever(26.0, 300e3, 300.0), pm.Tip(8e-9), pm.Drive(20e-9))
    image = pm.simulate(pm.Surface(1e9, pixel_size=4e-9, shape=(3, 4)), scope, 0.6)
    path, law = tmp_path / "image.toml", ["interaction.contact=film"] if name == "thickness" else []
    made = pm.scene_from(image, path, 1, [word, *law])  # a scene with this word
    vary = f'ensemble.vary={{ "{key}" = ["{text}"] }}'
    varied = load_ensemble(path, ["ensemble.count=1", vary])
    assert varied.samples[0][key] == wanted
    if table == "materials":
        assert json.loads(made.to_json())["materials"]["material_0"][name] == wanted
        assert getattr(load_setup(path, [word]).materials["material_0"], name) == wanted
        return
    for scene in (made, pm.load_scene(path, [word]), load_setup(path, [word]), varied.scene(0)):
        assert getattr(getattr(scene.microscope, table), name) == wanted
    if name in SETS.get(table, ()):
        assert getattr(getattr(microscope_of_files([image], [word])[0], table), name) == wanted
