"""The form of the explorer's page, as a browser runs it: its choices say what counts, and forget nothing."""

from __future__ import annotations

import functools
import http.server
import json
import re
import shutil
import threading
from importlib.resources import as_file, files
from pathlib import Path

import browser
import pytest

from phasemap.explorer.offered import presets
from phasemap.explorer.setting import values_of
from phasemap.explorer.subject import subject_of

STEP = Path(__file__).parents[2] / "samples" / "step.toml"
DRIVER = """<!doctype html><form id="form"></form><p id="said"></p>
<script type="module">
import { build } from "./controls.js";
import { begin, changes, state } from "./state.js";
const { about, presets, steps, link } = await (await fetch("driver.json")).json();
const knobs = await (await fetch("knobs.json")).json();
begin("step", about, link);
build(document.getElementById("form"), knobs, presets, () => {});
const selects = () => [...document.querySelectorAll("#form select")];
const shown = () => Object.fromEntries(selects().map(({ id, value }) => [id, value]));
const said = [];
for (const [id, value] of steps) {
  const element = document.getElementById(id);
  element.value = value;
  element.dispatchEvent(new Event("change"));
  said.push({ ...shown(), ...changes() });
}
document.getElementById("said").textContent = JSON.stringify(said);
</script>
"""


class Quiet(http.server.SimpleHTTPRequestHandler):
    """A server of files that says nothing."""

    def log_message(self, *_: object) -> None:
        """Say nothing."""


Said = dict[str, object]


def after(steps: list[tuple[str, object]], folder: Path, link: Said | None = None) -> list[Said]:
    """Choices that the form shows, and changes that it asks the engine with, after each step: a key and its value."""
    subject = subject_of(STEP)
    about = {"values": values_of(subject), "materials": list(subject.materials)}
    with as_file(files("phasemap.explorer").joinpath("page")) as page:
        shutil.copytree(page, folder / "page")
    said = {"about": about, "presets": presets(), "steps": steps, "link": {"changes": link or {}}}
    (folder / "page" / "driver.html").write_text(DRIVER)
    (folder / "page" / "driver.json").write_text(json.dumps(said))
    handler = functools.partial(Quiet, directory=str(folder / "page"))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        document = browser.seen(f"http://127.0.0.1:{server.server_port}/driver.html", folder / "profile")
        server.shutdown()
    found = re.search(r'id="said">(\[.*?\])<', document)
    assert found, document
    return json.loads(found[1])


TWO_PRESETS: list[tuple[str, object]] = [("materials.0.preset", "PS"), ("materials.1.preset", "PMMA")]


@browser.needed
@pytest.mark.parametrize("back", [0, 1])
def test_a_material_that_relaxes_for_a_while_leaves_the_others_as_they_were(back: int, tmp_path: Path) -> None:
    steps = [*TWO_PRESETS, ("materials.0.loss", "relaxation"), (f"materials.{back}.loss", "viscosity")]
    _, before, relaxing, again = after(steps, tmp_path)
    assert before["materials.1.preset"] == "PMMA" and before["materials.1.viscosity"] == 260.0
    assert relaxing["materials.1.loss"] == "relaxation"
    assert relaxing["materials.1.relaxed_modulus"] == 2.7e9  # without a loss, to begin with
    assert again == before


@browser.needed
def test_a_material_that_others_make_relax_no_more_relaxes_again_as_it_did(tmp_path: Path) -> None:
    steps = [
        *TWO_PRESETS, ("materials.0.loss", "relaxation"), ("materials.1.relaxation_time", 3),
        ("materials.1.relaxed_modulus", 1), ("materials.0.loss", "damping"), ("materials.0.loss", "spectrum"),
    ]  # fmt: skip
    *_, relaxing, still, again = after(steps, tmp_path)
    assert relaxing["materials.1.relaxation_time"] == 3e-6 and still["materials.1.loss"] == "viscosity"
    assert again["materials.1.relaxation_time"] == 3e-6 and again["materials.1.relaxed_modulus"] == 1e9


@browser.needed
def test_the_form_names_a_preset_only_where_its_loss_counts(tmp_path: Path) -> None:
    steps = [*TWO_PRESETS, ("materials.0.loss", "spectrum"), ("materials.0.loss", "viscosity")]
    _, _, relaxing, again = after(steps, tmp_path)
    assert relaxing["materials.0.relaxation"] == "PIB" and relaxing["materials.0.preset"] == ""
    assert again["materials.0.preset"] == "PS"


@browser.needed
def test_a_material_without_a_loss_is_still_the_preset_that_a_link_gave_it(tmp_path: Path) -> None:
    *_, first = after([("materials.0.preset", "mica")], tmp_path / "first")
    materials = {
        key: value for key, value in first.items() if key.startswith("materials.0.") and not isinstance(value, str)
    }
    (again,) = after([("materials.1.loss", "damping")], tmp_path / "second", materials)
    assert first["materials.0.viscosity"] == 0.0 and again["materials.0.preset"] == "mica"
