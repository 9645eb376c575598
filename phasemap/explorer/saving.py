"""Files that the buttons give: the scene, the image, a picture of it, and the Python that makes them."""

from __future__ import annotations

import io
import re
import tempfile
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, NamedTuple

import xarray as xr

from phasemap._shared.errors import InputError, Word
from phasemap._shared.pixels import coordinates
from phasemap.experiment.control import Engage
from phasemap.experiment.microscope import PARTS
from phasemap.experiment.realism import Realism
from phasemap.explorer.answers import image
from phasemap.explorer.setting import Setting
from phasemap.io.netcdf import save
from phasemap.scenes.scene import scene_from_tables
from phasemap.scenes.tables import read_tables, toml_of, without_none, written

HEADING = ["Saved from phasemap explore.", "Every length is in m, every other quantity in SI units."]


class File(NamedTuple):
    """File that the browser downloads."""

    # name, kind: of the file, and its media type
    name: str
    kind: str
    content: bytes


def scene_file(setting: Setting) -> File:
    """The scene as TOML; of a surface that came from no scene with names, together with its maps in an archive.

    Files that the scene names are where they were, by their whole paths.
    """
    tables, name = setting.tables(), _name(setting)
    if setting.subject.scene is not None:
        tables["surface"] = _from_anywhere(tables["surface"], setting)
        tables.pop("output", None)
        return File(f"{name}.toml", "application/toml", toml_of(tables, heading=HEADING).encode())
    maps = f"{name}_maps.nc"
    relief = setting.subject.sample.topography
    tables["surface"] = {
        "kind": "labels",
        "labels": {"file": maps, "variable": "labels"},
        **({} if relief is None else {"topography": {"file": maps, "variable": "topography"}}),
        "pixel_size": list(setting.subject.pixel_size),
        "materials": list(setting.materials),
    }
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as parts:
        parts.writestr(f"{name}.toml", toml_of(tables, heading=HEADING))
        parts.writestr(maps, _written_by(lambda path: save(_maps(setting), path), ".nc"))
    return File(f"{name}.zip", "application/zip", archive.getvalue())


def image_file(setting: Setting) -> File:
    """The whole image as netCDF."""
    ds = image(setting)
    return File(f"{_name(setting)}.nc", "application/x-netcdf", _written_by(lambda path: save(ds, path), ".nc"))


def picture_file(setting: Setting) -> File:
    """A picture of the whole image, as ``phasemap plot`` draws it."""
    from phasemap.plot.images import plot

    ds = image(setting)
    return File(f"{_name(setting)}.png", "image/png", _written_by(lambda path: plot(ds, path, lag=setting.lag), ".png"))


SAVED: dict[str, Callable[[Setting], File]] = {
    "scene": scene_file,
    "image": image_file,
    "picture": picture_file,
    "python": lambda setting: File(f"{_name(setting)}.py", "text/x-python", python_of(setting).encode()),
}
"""Makers of files, by the name of the button."""


def python_of(setting: Setting) -> str:
    """Write the Python that makes the image of this setting."""
    drawn = f"pm.plot.image(image, {_name(setting) + '.png'!r}{', lag=True' if setting.lag else ''})\n"
    subject = setting.subject
    if subject.in_python:
        return _python_of_surface(setting) + drawn
    source = None if subject.scene is None else subject.scene.source
    if subject.scene is None or source is None:
        raise InputError("the scene", Word("of no file"), "one that was read from a file", "Save the scene instead.")
    before = without_none(scene_from_tables(read_tables(source), source.parent, subject.scene.surface).config)
    changed = _differences(before, {**setting.tables(), "files": before["files"]})
    lines = [f"scene = pm.load_scene({str(source)!r}"]
    if changed:
        lines = [lines[0] + ", ["]
        lines += [f"    {f'{key}={written(value)}'!r}," for key, value in changed.items()]
        lines += ["])"]
    else:
        lines[0] += ")"
    return "\n".join(["import phasemap as pm", "", *lines, "image = scene.simulate()", drawn])


def _python_of_surface(setting: Setting) -> str:
    """Python that makes the image of a surface and a microscope, which only the user's own Python knows."""
    scope = setting.scope
    materials = [f"    {i}: {_python(one)},  # {name!r}" for i, (name, one) in enumerate(setting.materials.items())]
    parts = []
    for part in PARTS:
        before, after = getattr(setting.subject.scope, part), getattr(scope, part)
        if differ := [one.name for one in fields(after) if getattr(before, one.name) != getattr(after, one.name)]:
            changes = {key: getattr(after, key) for key in differ}
            values = ", ".join(f"{key}={_python(one)}" for key, one in changes.items())
            parts.append(f"    {part}=replace(scope.{part}, {values}),")
    if scope.detector != setting.subject.scope.detector:
        parts.append(f"    detector={scope.detector!r},")
    changed = ["scope = replace(", "    scope,", *parts, ")"] if parts else []
    control = "" if setting.control == Engage() else f", control={_python(setting.control)}"
    control += "" if setting.realism == Realism() else f", realism={_python(setting.realism)}"
    return "\n".join(
        [
            *(["from dataclasses import replace", ""] if parts else []),
            "import phasemap as pm",
            "",
            "# surface and scope are those that were given to pm.explore",
            *changed,
            "materials = {",
            *materials,
            "}",
            "surface = pm.Surface.from_labels(",
            "    surface.unique()[1], materials, pixel_size=surface.pixel_size, topography=surface.topography",
            ")",
            f"image = pm.simulate(surface, scope, setpoint={setting.setpoint!r}, solver={setting.options['solver']!r}"
            f"{control})",
            "",
        ]
    )


def _python(value: object) -> str:
    """Python that makes a value, with the names of phasemap in it."""
    return re.sub(r"\b(?=[A-Z]\w*\()", "pm.", repr(value))


def _differences(before: Mapping[str, Any], after: Mapping[str, Any]) -> dict[str, Any]:
    """The keys whose values differ, by their names as overrides have them."""
    changed: dict[str, Any] = {}
    for key, value in after.items():
        old = before.get(key)
        if isinstance(value, Mapping) and isinstance(old, Mapping):
            differs = {f"{key}.{name}": one for name, one in _differences(old, value).items()}
        else:
            differs = {} if value == old else {key: value}
        if differs and ("." in key or "=" in key or not key or key != key.strip()):  # no override could name it
            allowed = "a name without dots, equals signs and blanks around it, to be set from Python"
            raise InputError("key", key, allowed, "Save the scene instead.")
        changed |= differs
    return changed


def _from_anywhere(table: Any, setting: Setting) -> Any:
    """The table of a surface with whole paths for the files that it names, for the scene is saved elsewhere."""
    scene = setting.subject.scene
    files = set() if scene is None else set(scene.config["files"])
    if isinstance(table, Mapping):
        return {key: _from_anywhere(value, setting) for key, value in table.items()}
    if isinstance(table, str) and table in files and not table.startswith("package:"):
        return str((setting.subject.folder / table).resolve())
    return table


def _maps(setting: Setting) -> xr.Dataset:
    """Labels and topography of the whole surface."""
    sample, whole = setting.subject.sample, setting.surface
    data: dict[str, Any] = {"labels": (("y", "x"), sample.labels, {"long_name": "number of the material"})}
    if sample.topography is not None:
        data["topography"] = (("y", "x"), sample.topography, {"long_name": "topography", "units": "m"})
    return xr.Dataset(data, coordinates(*whole.coords()))


def _name(setting: Setting) -> str:
    """Name of the files, without a suffix."""
    return f"{setting.subject.name}_explored"


def _written_by(write: Callable[[Path], object], suffix: str) -> bytes:
    """The bytes of a file that a function writes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, f"whole{suffix}")
        write(path)
        return path.read_bytes()
