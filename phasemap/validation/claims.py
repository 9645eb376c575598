"""Claims of an image: the configuration in its attributes, as objects again."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import xarray as xr

from phasemap._shared.checks import pixel_pair, shape_pair
from phasemap._shared.errors import FileError, InputError, PhasemapError, Word
from phasemap.experiment.accuracy import Accuracy
from phasemap.experiment.control import Control
from phasemap.experiment.described import describe, made
from phasemap.experiment.microscope import Microscope
from phasemap.experiment.realism import Realism, check_realism
from phasemap.scenes.objects import CONTROLS
from phasemap.scenes.scene import Scene, scene_from_json
from phasemap.solvers.problem import check_setpoint
from phasemap.solvers.solver import by_name

NEEDED = ("microscope", "setpoint", "solver", "control", "accuracy", "realism", "shape", "pixel_size")


@dataclass(frozen=True)
class Claims:
    """Arguments of `phasemap.simulate` with which an image says it was made."""

    microscope: Microscope
    setpoint: float
    solver: str
    control: Control
    accuracy: Accuracy
    realism: Realism
    shape: tuple[int, int]  # rows and columns
    pixel_size: tuple[float, float]  # (dy, dx) [m]

    @property
    def amplitude(self) -> float:
        """Amplitude at the setpoint [m]."""
        return self.setpoint * self.microscope.driven_amplitude


def claims_of(image: xr.Dataset, scope: Microscope | None = None) -> Claims:
    """Read what an image of `phasemap.simulate` says it is; `scope` is needed where its contact law is a user's own."""
    if "sample" in image.dims:
        raise InputError(
            "image", Word("an ensemble"), "one image", "Simulate a sample of it as a scene of its own, and check that."
        )
    stored = _table(image.attrs.get("configuration"))
    if missing := [name for name in NEEDED if name not in stored]:
        hint = "Is it an image that phasemap simulated?"
        found = Word("without " + ", ".join(missing))
        raise InputError("configuration of the image", found, "that of a simulation", hint)
    if scope is None:
        scope = microscope_from(stored["microscope"])
    elif describe(scope) != stored["microscope"]:
        raise InputError("scope", scope, "the microscope of the image's configuration")
    control = made(stored["control"], *CONTROLS.values())
    shape = shape_pair(stored["shape"])
    realism = check_realism(made(stored["realism"], Realism), control, shape[0])
    return Claims(
        scope, check_setpoint(stored["setpoint"]), by_name(stored["solver"]).name, control,
        made(stored["accuracy"], Accuracy), realism, shape, pixel_pair(stored["pixel_size"]),
    )  # fmt: skip


def _table(text: object) -> dict[str, Any]:
    """The table that an attribute has as JSON, empty where it has none."""
    try:
        stored = json.loads(text) if isinstance(text, str) else None
    except (ValueError, RecursionError):
        stored = None
    return stored if isinstance(stored, dict) else {}


def microscope_from(stored: Mapping[str, Any]) -> Microscope:
    """Microscope made again from the JSON values of `describe`."""
    try:
        scope = made(stored, Microscope)
    except InputError as error:
        if error.name not in ("contact", "kind"):
            raise
        hint = "A law of your own is not in the file: give the microscope too, pm.check(image, surface, scope)."
        raise InputError("contact law of the image", error.value, "one of phasemap's", hint) from None
    return scope


def scene_of(image: xr.Dataset, folders: Iterable[str | os.PathLike[str]], shape: tuple[int, int]) -> Scene:
    """Make the scene again that an image carries, from files that may be in any of the folders.

    A scene that says another shape is not made. Raises FileError if a file is in none of the folders, or has changed.
    """
    if "scene" not in image.attrs:
        raise PhasemapError(
            "the image does not carry the scene that it was made of: which material each pixel shows is not known, so "
            "no height, phase, branch or indentation can be judged. "
            "Give its surface: --scene SCENE.toml or --surface SURFACE.nc; in Python pm.check(image, surface)."
        )
    text, failed = image.attrs["scene"], None
    surface = _table(text).get("surface")
    if isinstance(surface, dict) and surface.get("shape", list(shape)) != list(shape):
        raise InputError("shape of the image's scene", surface["shape"], f"{list(shape)}, that of the image")
    for folder in folders:
        try:
            return scene_from_json(text, Path(folder))
        except FileError as error:
            failed = failed or error
    raise FileError(f"{failed} Put it beside the image, or give --scene SCENE.toml or --surface SURFACE.nc.")
