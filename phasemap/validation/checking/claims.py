"""What an image says it is: the configuration in its attributes, as objects again."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import xarray as xr

from phasemap._shared.checks import pixel_pair, shape_pair
from phasemap._shared.errors import FileError, InputError, PhasemapError
from phasemap._shared.notices import unquestioned
from phasemap.experiment.accuracy import Accuracy
from phasemap.experiment.beam import Eigenmode
from phasemap.experiment.control import Control
from phasemap.experiment.interaction import Interaction
from phasemap.experiment.interaction.longrange import FORCES
from phasemap.experiment.microscope import Cantilever, Drive, Microscope, Mode, Tip
from phasemap.experiment.realism import Realism, TipChange, check_realism
from phasemap.results.variables import describe
from phasemap.scenes.objects import CONTROLS, LAWS
from phasemap.scenes.scene import Scene, scene_from_json
from phasemap.solvers.problem import check_setpoint
from phasemap.solvers.solver import by_name

T = TypeVar("T")

KINDS: dict[str, type[Any]] = {
    cls.__name__.lower(): cls
    for cls in (
        *FORCES.values(), *LAWS.values(), *CONTROLS.values(), Accuracy, Cantilever, Drive, Eigenmode, Interaction,
        Microscope, Mode, Realism, Tip, TipChange,
    )
}  # fmt: skip
"""What `phasemap.results.variables.describe` describes."""
PARTS = {"cantilever": Cantilever, "tip": Tip, "drive": Drive, "interaction": Interaction}
NEEDED = ("microscope", "setpoint", "solver", "control", "accuracy", "realism", "shape", "pixel_size")


@dataclass(frozen=True)
class Claims:
    """What was asked for when an image was made; the arguments of `phasemap.simulate`."""

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
        """At the setpoint [m]."""
        return self.setpoint * self.microscope.driven_amplitude


def claims_of(image: xr.Dataset, scope: Microscope | None = None) -> Claims:
    """Read what an image of `phasemap.simulate` says it is; `scope` is needed where its contact law is a user's own."""
    if "sample" in image.dims:
        raise InputError(
            "image", "an ensemble", "one image", "Simulate a sample of it as a scene of its own, and check that."
        )
    stored = _table(image.attrs.get("configuration"))
    if missing := [name for name in NEEDED if name not in stored]:
        hint = "Is it an image that phasemap simulated?"
        raise InputError("configuration of the image", "without " + ", ".join(missing), "that of a simulation", hint)
    if scope is None:
        scope = microscope_from(stored["microscope"])
    elif describe(scope) != stored["microscope"]:
        raise InputError("scope", scope, "the microscope of the image's configuration")
    control = _made(stored["control"], *CONTROLS.values())
    shape = shape_pair(stored["shape"])
    realism = check_realism(_made(stored["realism"], Realism), control, shape[0])
    return Claims(
        scope, check_setpoint(stored["setpoint"]), by_name(stored["solver"]).name, control,
        _made(stored["accuracy"], Accuracy), realism, shape, pixel_pair(stored["pixel_size"]),
    )  # fmt: skip


def _table(text: object) -> dict[str, Any]:
    """The table that an attribute has as JSON, empty where it has none."""
    try:
        stored = json.loads(text) if isinstance(text, str) else None
    except (ValueError, RecursionError):
        stored = None
    return stored if isinstance(stored, dict) else {}


def microscope_from(stored: Mapping[str, Any]) -> Microscope:
    """Make a microscope again from what `phasemap.results.variables.describe` gave."""
    try:
        scope = _made(stored, Microscope)
    except InputError as error:
        if error.name not in ("contact", "kind"):
            raise
        hint = "A law of your own is not in the file: give the microscope too, pm.check(image, surface, scope)."
        raise InputError("contact law of the image", error.value, "one of phasemap's", hint) from None
    return scope


def _made(stored: Any, *kinds: type[T]) -> T:
    """The object, of one of these kinds, that `phasemap.results.variables.describe` described."""
    try:
        with unquestioned():  # who made the image was told already
            thing = _object(stored)
    except RecursionError:
        raise InputError("configuration of the image", stored, "tables that are not nested so deeply") from None
    if not isinstance(thing, kinds):
        raise InputError("configuration of the image", stored, " or ".join(kind.__name__ for kind in kinds))
    return thing


def _object(stored: Any) -> Any:
    """Whatever was described."""
    if isinstance(stored, list):
        return tuple(map(_object, stored))
    if not isinstance(stored, Mapping):
        return stored
    fields = {name: _object(value) for name, value in stored.items() if name != "kind"}
    kind = stored.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        raise InputError("kind", kind, "one of " + ", ".join(KINDS))
    if kind == "cantilever":
        fields.setdefault("participation", 1.0)  # of images from before beams, whose lever was a point mass
    known = [field.name for field in dataclasses.fields(KINDS[kind])]
    if set(fields) - set(known):
        raise InputError(f"configuration of {kind}", ", ".join(fields), ", ".join(known))
    for name, part in PARTS.items() if kind == "microscope" else ():
        if not isinstance(fields.get(name), part):
            raise InputError(f"{name} of the image", fields.get(name), f"a {part.__name__}")
    try:
        return KINDS[kind](**fields)
    except TypeError as error:  # one is missing, or not a number
        raise InputError(f"configuration of {kind}", str(stored), "its arguments", f"{error}.") from None


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
