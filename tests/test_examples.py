"""The scripts in examples and the code in the README, run as a reader would run them."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from phasemap.cli import main

ROOT = Path(__file__).parent.parent
EXAMPLES = sorted(path for path in (ROOT / "examples").glob("*.py") if path.name != "paper.py")  # parameters only
README = (ROOT / "README.md").read_text()


def blocks(language: str) -> list[str]:
    """Return the README's blocks in a language, without those that .ci/run runs."""
    return re.findall(rf"(?<!-->)\n```{language}\n(.*?)```", README, re.DOTALL)


def python(folder: Path, *arguments: str) -> str:
    """Run Python in a folder, with warnings as errors, and return what it says."""
    command = [sys.executable, "-W", "error", *arguments]
    done = subprocess.run(
        command, cwd=folder, env={**os.environ, "MPLBACKEND": "Agg"}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


SLOW = ("paper_fig6_laws",)  # compiles two more laws


@pytest.mark.parametrize(
    "path",
    [pytest.param(path, id=path.stem, marks=[pytest.mark.slow] if path.stem in SLOW else []) for path in EXAMPLES],
)
def test_an_example_answers_and_draws_its_picture(path: Path, tmp_path: Path) -> None:
    assert python(tmp_path, str(path)).strip()
    assert (tmp_path / f"{path.stem}.png").read_bytes().startswith(b"\x89PNG")
    assert path.name in README


@pytest.mark.parametrize("code", blocks("python"))
def test_python_in_the_readme_runs(code: str, tmp_path: Path) -> None:
    python(tmp_path, "-c", code)


def test_commands_in_the_readme_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "samples").symlink_to(ROOT / "samples")
    monkeypatch.chdir(tmp_path)
    lines = [line for block in blocks("sh") for line in block.splitlines()]
    assert lines
    for line in lines:
        program, *arguments = shlex.split(line)
        assert program == "phasemap"
        assert main(arguments) == 0, line


def test_the_readme_has_what_ci_runs() -> None:
    marks = re.findall(r"<!-- (ci:\w+) -->\n```sh\n\S", README)
    assert marks == ["ci:image", "ci:test"]


@pytest.mark.parametrize("name", ["README.md", "CONTRIBUTING.md", "CHANGELOG.md"])
def test_every_file_that_is_linked_is_there(name: str) -> None:
    links = re.findall(r"\]\((?!https?:)([^)#]+)\)", (ROOT / name).read_text())
    assert [link for link in links if not (ROOT / link).exists()] == []
