"""Subjects of the explorer: the one that the page was started with, samples of phasemap, and opened files."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterable
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

from phasemap._shared.checks import check_choice
from phasemap._shared.errors import FileError, InputError
from phasemap._shared.notices import untold
from phasemap.experiment.presets import Preset, levers, materials
from phasemap.explorer.setting import knobs, values_of
from phasemap.explorer.subject import Subject, subject_of
from phasemap.scenes.measured import NEEDED, NotRecorded, scene_from
from phasemap.scenes.scene import load_scene

SAMPLES = ("blend", "copolymer", "particles", "step", "scan", "bistable")
MATCH = (
    "The measured maps stand beside the simulated ones (blue in histograms and profiles), their zeros put where the "
    "regions agree best: move the sliders until both look alike."
)
KEPT = 8  # samples and files at most that are open at once


class Opened(NamedTuple):
    """Something to explore."""

    subject: Subject
    note: str = ""  # what the page says of it


class Offered:
    """The subjects of one server, by the names that links have for them; `given` is what the page was started with."""

    def __init__(self, given: Opened | None = None) -> None:
        self._open: dict[str, Opened] = {}
        self.first = SAMPLES[0] if given is None else given.subject.name
        if given is not None:
            self._open[self.first] = given

    def __getitem__(self, name: object) -> Subject:
        """The subject of a name; the one that the page begins with for None."""
        return self._found(self.first if name is None else name)[0]

    def describe(self, name: object) -> dict[str, Any]:
        """Describe a subject to the page: materials, what each slider begins with, and how it is scanned."""
        subject, note = self._found(name)
        simplified = ["with sharp edges"] * subject.blurred
        simplified += ["with uniform materials"] * (subject.variation is not None)
        return {
            "name": subject.name,
            "materials": list(subject.materials),
            "values": values_of(subject),
            "control": None if subject.plain else str(subject.options.get("control") or "") or "as the scene says",
            "simplified": " and ".join(simplified),
            "note": " ".join(filter(None, [note, MATCH if subject.measured is not None else ""])),
        }

    def names(self) -> dict[str, str]:
        """The names of all that can be explored, each with a sentence."""
        opened = {name: "opened" for name in self._open if name not in SAMPLES}
        return opened | {name: _first_line(folder_of_samples() / f"{name}.toml") for name in SAMPLES}

    def open(self, name: str, content: bytes) -> str:
        """Open a file that the page sends, a scene or an image of a microscope, and return the name of the subject."""
        with tempfile.TemporaryDirectory(prefix="phasemap-") as folder:
            path = Path(folder, Path(name.replace("\\", "/")).name or "file")
            path.write_bytes(content)
            try:
                offer = opened(path)
            except FileError as error:
                raise FileError(str(error).replace(str(path), path.name)) from None
        while len(self._open) >= KEPT:
            del self._open[next(one for one in self._open if one != self.first)]
        self._open[offer.subject.name] = offer
        return offer.subject.name

    def _found(self, name: object) -> Opened:
        """The open subject of this name, or a sample, which is opened when it is first asked for."""
        if not isinstance(name, str) or name not in self.names():
            hint = "Open its file in the page, or start the explorer with it."
            raise InputError("sample", name, ", ".join(self.names()), hint)
        if name not in self._open:
            self._open[name] = Opened(subject_of(folder_of_samples() / f"{name}.toml"))
        return self._open[name]


def first_of(explored: str | os.PathLike[str], overrides: Iterable[str] = ()) -> Opened:
    """Subject that the explorer is started with: a sample by its name, or the file of a scene or of a microscope."""
    path, overrides = Path(explored), list(overrides)
    if not path.suffix and not path.exists():
        check_choice("what is explored", str(explored), SAMPLES)
        path = folder_of_samples() / f"{explored}.toml"
    if path.suffix.lower() != ".toml":
        return opened(path, overrides)
    subject = subject_of(path, overrides=overrides)
    if overrides and subject.name in SAMPLES:  # whose name in a link stands for the sample as it is
        subject = replace(subject, name=f"{subject.name} as given")
    return Opened(subject)


def opened(path: Path, overrides: Iterable[str] = ()) -> Opened:
    """Read a scene, or make one of a microscope's file, which it needs no more, and say what was assumed."""
    if path.suffix.lower() == ".toml":
        scene = replace(load_scene(path, overrides), source=None)
        return Opened(replace(subject_of(scene), name=path.stem))
    note = ""
    with tempfile.TemporaryDirectory(prefix="phasemap-") as folder, untold():
        target = Path(folder, f"{path.stem}.toml")
        try:
            scene = scene_from(path, target, overrides=overrides)
        except NotRecorded as error:
            assumed = [f"{key}={NEEDED[key]}" for key in error.keys]
            scene = scene_from(path, target, overrides=[*overrides, *assumed])
            missing = ", ".join(knobs()[key].label for key in error.keys)
            note = f"{path.name} does not say {missing}: what is shown there is assumed. "
        subject = replace(subject_of(scene), name=path.stem, scene=None)
    return Opened(subject, note + "The materials are placeholders: an image does not say what it is of.")


def presets() -> dict[str, list[dict[str, Any]]]:
    """The presets of levers and materials, for the page."""

    def plain(preset: Preset) -> dict[str, Any]:
        return {"name": preset.name, "title": preset.title, "kind": preset.kind, "values": preset.values}

    return {"levers": list(map(plain, levers().values())), "materials": list(map(plain, materials().values()))}


def folder_of_samples() -> Path:
    """Folder of the samples' scenes: in an installed package beside its code, else in the repository."""
    package = Path(str(files("phasemap")))
    installed = package / "samples"
    return installed if installed.is_dir() else package.parent / "samples"


def _first_line(path: Path) -> str:
    """The sentence with which a scene begins."""
    with contextlib.suppress(OSError), path.open(encoding="utf-8") as file:
        return file.readline().removeprefix("#").strip()
    return ""
