"""The scripts in examples and the code in the README and in docs, run as a reader would run them."""

from __future__ import annotations

import doctest
import importlib.util
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import pytest

from phasemap._shared import threads
from phasemap.cli import main
from phasemap.inference import sampling
from phasemap.inference.series import likelihood as of_series

ROOT = Path(__file__).parents[2]
EXAMPLES = sorted(path for path in (ROOT / "examples").glob("*.py") if path.name != "paper.py")  # parameters only
ELSEWHERE = ("benchmark",)  # tests/examples/test_benchmark.py
PAGES = {
    str(path.relative_to(ROOT)): path.read_text()
    for path in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    if not {"_build", "generated"} & set(path.parts)
}


def blocks(page: str, language: str) -> list[str]:
    """Return a page's blocks in a language, without those that .ci/run runs."""
    return re.findall(rf"(?<!-->)\n```{language}\n(.*?)```", PAGES[page], re.DOTALL)


def pages_with(language: str) -> list[str]:
    return [page for page in PAGES if blocks(page, language)]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to work in, where pictures are drawn without a screen."""
    monkeypatch.chdir(tmp_path)
    mpl.use("Agg")
    return tmp_path


@pytest.fixture
def few_draws(monkeypatch: pytest.MonkeyPatch, thorough: bool) -> None:
    """Enough, with a coarse table, to read a series of files; how well is asked in tests/inference/test_series.py."""
    if not thorough:
        monkeypatch.setattr(sampling, "STEPS", 20)
        monkeypatch.setattr(sampling, "FIRST", 2000)
        monkeypatch.setattr(of_series, "COUNTS", (5, 3, 4))


def in_a_process(path: Path, folder: Path, less: bool) -> str:
    """Run a script in a process of its own, with warnings as errors, and return what it says."""
    command = [sys.executable, "-W", "error", str(path), *(FEWER.get(path.stem, []) if less else [])]
    done = subprocess.run(
        command, cwd=folder, env={**os.environ, "MPLBACKEND": "Agg"}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def in_this_process(path: Path, less: bool) -> None:
    """Run the same without the seconds that it takes to import all."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    if less and path.stem in LESS:
        vars(example).update(LESS[path.stem](example))
    example.main()
    plt.close("all")


SLOW = (
    "paper_fig6_laws", "fit_response", "measured_series", "large_map", "learn_segment", "many_images",
    "relaxation_spectrum", "gel_beside_glass", "loss_tangent", "forces_outside_contact", "what_a_tap_sees", "thin_film",
    "soft_lever_in_liquid", "paper_fig5_jumps", "rubber_beside_glass", "invert_stack", "scan_series", "wet_rubber",
)  # fmt: skip
"""More laws to compile, fits of some hundred curves, processes of their own: other tests ask for what these do."""
SLOW_PAGES = ("docs/howto/series.md", "docs/howto/channels.md")
SLOW_COMMANDS = ("docs/howto/curves.md", "docs/howto/materials.md", "docs/howto/scans.md")
STARTS_PROCESSES = ("large_map", "many_images")
FEWER = {"large_map": ["256"]}  # pixels along a side: the script's own argument
LESS: dict[str, Callable[[Any], dict[str, Any]]] = {
    "all_orbits": lambda e: {"SETPOINTS": e.SETPOINTS[::8]},
    "forces_outside_contact": lambda e: {"SETPOINTS": e.SETPOINTS[::16]},
    "gel_beside_glass": lambda e: {"MODULUS": e.MODULUS[::8]},
    "fit_response": lambda e: {"FREQUENCIES": e.FREQUENCIES[::4]},
    "invert_stack": lambda e: {"CHANGES": ("surface.shape=[24,24]", "surface.spacing=40e-9", *e.CHANGES[2:])},
    "learn_segment": lambda e: {"TRAINED": 2, "TESTED": 2, "SCENE": e.SCENE.replace("count = 24", "count = 4")},
    "line_rate": lambda e: {"ENGINES": {way: (*how, rates[2::3]) for way, (*how, rates) in e.ENGINES.items()}},
    "loss_tangent": lambda e: {"ADHESION": e.ADHESION[::8], "SETPOINTS": e.SETPOINTS[::5]},
    "measured_series": lambda e: {"SHAPE": (64, 64)},
    "measured_twin": lambda e: {"LINES": slice(96, 104)},
    "relaxation_spectrum": lambda e: {"SETPOINTS": e.SETPOINTS[16::6]},
    "rubber_beside_glass": lambda e: {"GRADES": e.GRADES[::16], "OFFSETS": e.OFFSETS[::10]},
    "scan_faster": lambda e: {"LABELS": e.LABELS[:8], "RELIEF": e.RELIEF[:8]},
    "scan_series": lambda e: {"LABELS": e.LABELS[48:56], "RELIEF": e.RELIEF[48:56]},
    "soft_lever_in_liquid": lambda e: {"SETPOINTS": e.SETPOINTS[::9]},
    "thin_film": lambda e: {"PIXELS": 30},
    "three_losses": lambda e: {"SETPOINTS": e.SETPOINTS[::12]},
    "water_films": lambda e: {"HUMIDITIES": e.HUMIDITIES[::8]},
    "what_a_tap_sees": lambda e: {"TIMES": e.TIMES[:13:12]},
    "which_setpoint": lambda e: {"SETPOINTS": e.SETPOINTS[::6], "FREE_AMPLITUDES": e.FREE_AMPLITUDES[::8]},
}  # fmt: skip
"""Fewer points or lines of what takes a second or more; `--thorough`, and the site, runs it as it is."""


@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, id=path.stem, marks=[pytest.mark.slow] if path.stem in SLOW else [])
        for path in EXAMPLES
        if path.stem not in ELSEWHERE
    ],
)
@pytest.mark.usefixtures("few_draws")
def test_an_example_answers_and_draws_its_picture(
    path: Path, folder: Path, capsys: pytest.CaptureFixture[str], thorough: bool
) -> None:
    if path.stem in STARTS_PROCESSES:
        said = in_a_process(path, folder, less=not thorough)
    else:
        in_this_process(path, less=not thorough)
        said = capsys.readouterr().out
    assert said.strip()
    assert (folder / f"{path.stem}.png").read_bytes().startswith(b"\x89PNG")


def test_every_example_is_in_the_gallery() -> None:
    shown = re.findall(r"^   \.\./examples/(\S+)$", (ROOT / "docs" / "examples.rst").read_text(), re.MULTILINE)
    assert sorted(shown) == [path.name for path in EXAMPLES]


@pytest.mark.parametrize(
    "code",
    [
        pytest.param(code, id=f"{page}-{number}", marks=[pytest.mark.slow] if page in SLOW_PAGES else [])
        for page in pages_with("python")
        for number, code in enumerate(blocks(page, "python"))
    ],
)
@pytest.mark.usefixtures("folder", "few_draws")
def test_python_on_a_page_runs(code: str) -> None:
    exec(compile(code, "<page>", "exec"), {"__name__": "__main__"})
    plt.close("all")


@pytest.mark.parametrize("page", pages_with("pycon"))
@pytest.mark.usefixtures("folder")
def test_a_session_on_a_page_prints_what_it_shows(page: str) -> None:
    session = doctest.DocTestParser().get_doctest("\n".join(blocks(page, "pycon")), {}, page, page, 0)
    said: list[str] = []
    assert doctest.DocTestRunner(verbose=False).run(session, out=said.append).failed == 0, "".join(said)


SMALLER = {"docs/howto/scans.md": ["surface.shape=[64,64]"], "docs/howto/ensembles.md": ["ensemble.count=4"]}
"""Put behind a page's `phasemap run`, where images take seconds; `--thorough` runs it as it is."""


@pytest.mark.parametrize(
    "page",
    [pytest.param(page, marks=[pytest.mark.slow] if page in SLOW_COMMANDS else []) for page in pages_with("sh")],
)
def test_commands_on_a_page_run(page: str, folder: Path, monkeypatch: pytest.MonkeyPatch, thorough: bool) -> None:
    monkeypatch.setattr(threads, "workers_of", lambda asked: asked or 1)  # each process takes seconds to import all
    (folder / "samples").symlink_to(ROOT / "samples")
    for line in [line for block in blocks(page, "sh") for line in block.splitlines()]:
        if line.startswith("phasemap bench"):
            continue  # a minute and more; tests/benchmarks/test_bench.py measures less and runs the command
        program, *arguments = shlex.split(line)
        assert program == "phasemap"
        if arguments[0] == "run" and not thorough:
            arguments += SMALLER.get(page, [])
        assert main(arguments) == 0, line


def test_the_readme_has_what_ci_runs_and_is_short() -> None:
    marks = re.findall(r"<!-- (ci:\w+) -->\n```sh\n\S", PAGES["README.md"])
    assert marks == ["ci:image", "ci:test"]
    assert len(PAGES["README.md"].splitlines()) <= 250


def test_the_speeds_in_the_readme_are_those_of_the_full_table() -> None:
    full = PAGES["docs/accuracy.md"].partition("<!-- accuracy:begin -->")[2]
    for name in ("auto", "orbit", "march", "averaging", "numbalsoda", "heyoka", "scipy"):
        short = re.search(rf"^\| `?{name}`?[^|]*\|(.*)\|$", PAGES["README.md"], re.MULTILINE)
        long = re.search(rf"^\| {name} \|(.*)\|$", full, re.MULTILINE)
        assert short and long
        cells = [re.sub(r" µs|\*|\(.*?\)", "", cell).strip() for cell in short[1].split("|")]
        assert cells == [re.sub(r"\*|\(.*?\)", "", cell).strip() for cell in long[1].split("|")][: len(cells)]


@pytest.mark.parametrize("name", ["README.md", "CONTRIBUTING.md", "CHANGELOG.md"])
def test_every_file_that_is_linked_is_there(name: str) -> None:
    links = re.findall(r"\]\((?!https?:)([^)#]+)\)", (ROOT / name).read_text())
    assert [link for link in links if not (ROOT / link).exists()] == []


def test_contributing_says_where_things_are() -> None:
    named = re.findall(
        r"`((?:phasemap|_kernels|tests|benchmarks|docs)/[\w/]+(?:\.py)?)`", (ROOT / "CONTRIBUTING.md").read_text()
    )
    assert len(named) > 15
    assert [one for one in named if not any((ROOT / under / one).exists() for under in ("", "phasemap"))] == []
