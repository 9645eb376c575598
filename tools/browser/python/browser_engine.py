"""Answers of the page's own engine: the routes of `phasemap explore`, for samples that were made beforehand."""

from __future__ import annotations

import json
import math
import os
from array import array
from pathlib import Path
from types import SimpleNamespace

import compiled
import numpy as np

import phasemap
from phasemap._shared.errors import InputError, PhasemapError
from phasemap.experiment import interaction
from phasemap.explorer import routes
from phasemap.explorer.setting import Setting
from phasemap.explorer.subject import ShownSample, Subject

SAMPLES = Path(__file__).parent / "samples"
_subjects = {}


class NotHere(PhasemapError):
    """What only the package itself can do."""

    def __init__(self):
        super().__init__("This page cannot solve this; phasemap explore can.")


def begin(call, keep, entries, formulas):
    os.chdir(SAMPLES.parent)
    compiled.connect(call, keep, entries, formulas, NotHere)


def answer(route, message):
    """Whether there is an answer, and its bytes, or what is wrong."""
    try:
        asked = json.loads(message)
        setting = Setting.of(subject(asked.pop("sample")), asked)
        return True, routes.answers()[route](setting)[1]
    except (PhasemapError, ModuleNotFoundError) as error:
        return False, str(error)


def subject(name):
    """A sample by its name."""
    if name not in _subjects:
        path = SAMPLES / f"{name}.json"
        if not path.exists():
            raise InputError("sample", name, "one that the page offers")
        _subjects[name] = made(name, json.loads(path.read_text()))
    return _subjects[name]


class _Names(dict):
    """What a value object writes of itself: names of the package."""

    def __missing__(self, name):
        return next(getattr(module, name) for module in (phasemap, interaction, math) if hasattr(module, name))


def made(name, said):
    """A subject of what `pages.described` wrote."""
    python = {name: eval(text, {}, _Names()) for name, text in said["python"].items()}
    shape = tuple(said["shape"])
    labels = np.array(list((SAMPLES / f"{name}.labels").read_bytes()), np.int32).reshape(shape)
    relief = None
    if said["relief"]:
        relief = np.ndarray(array("f", (SAMPLES / f"{name}.relief").read_bytes()), np.float64, shape)
    scene = SimpleNamespace(
        surface=SimpleNamespace(shape=shape),
        config={**said["config"], "files": {}},
        source=Path(f"samples/{name}.toml"),
    )
    return Subject(
        name,
        python["scope"],
        python["materials"],
        tuple(said["pixel_size"]),
        python["options"],
        ShownSample(labels, relief),
        scene,
    )
