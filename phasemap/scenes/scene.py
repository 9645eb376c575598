"""Scenes: one TOML file that says everything a simulation needs, as docs/reference/scenes.md lists it.

Keys are the arguments of the Python objects that the tables describe; nothing unknown is passed over.
"""

from __future__ import annotations

import dataclasses
import json
import os
import re
from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from phasemap._shared.asked import asked_as
from phasemap._shared.errors import FileError, InputError, Word
from phasemap._shared.fields import values_in_words
from phasemap._shared.notices import strict_units, unquestioned
from phasemap.experiment.accuracy import Accuracy
from phasemap.experiment.control import Control
from phasemap.experiment.described import describe
from phasemap.experiment.material import Material
from phasemap.experiment.material_rows import of_one_loss
from phasemap.experiment.microscope import Microscope
from phasemap.experiment.surface import Surface
from phasemap.results.channels import split
from phasemap.scenes.objects import (
    control_of,
    materials_of,
    microscope_of,
    microscope_tables,
    object_of,
    realism_of,
    scan_of,
    table_of,
    with_typical,
)
from phasemap.scenes.surface import Built, build_surface, under_tip
from phasemap.scenes.tables import Complaints, Table, check_keys, construct, read_tables, switch

TABLES = (
    "scan", "surface", "materials", "cantilever", "tip", "drive", "interaction", "detector", "control", "accuracy",
    "realism", "output",
)  # fmt: skip
NOT_OF_SETUP = ("surface", "control", "accuracy", "realism", "output", "ensemble")
REQUIRED_TABLES = ("scan", "surface", "cantilever", "tip", "drive")


@dataclass(frozen=True, repr=False)
class Scene:
    """A checked scene: what `phasemap.simulate` takes, and where it came from.

    Parameters
    ----------
    options : mapping
        The further arguments of `phasemap.simulate`: setpoint, solver, control, accuracy, realism, variables.
    output : Path or None
        The file that ``[output]`` names, relative to the scene's folder.
    config : mapping
        Every table with its defaults filled in, and the SHA-256 of every file that was read.
    source : Path or None
        The file that the scene was read from.
    built : Built or None
        The surface before a tip of finite size saw it, and its labels.
    """

    surface: Surface
    microscope: Microscope
    options: Mapping[str, Any]
    output: Path | None
    config: Mapping[str, Any]
    source: Path | None = None
    built: Built | None = None

    def __repr__(self) -> str:
        """Say surface, lever, tip, drive and setpoint."""
        scope = self.microscope
        parts = {
            "source": str(self.source or ""),
            "surface": repr(self.surface).removeprefix("Surface(").removesuffix(")"),
            **{part: values_in_words(getattr(scope, part)) for part in ("cantilever", "tip", "drive")},
            "setpoint": f"{self.options['setpoint']:g}",
            **{name: str(self.options[name]) for name in ("control", "realism")},
        }
        return f"Scene({', '.join(f'{name} {text}' for name, text in parts.items() if text)})"

    def to_json(self) -> str:
        """The resolved configuration as one line of JSON."""
        return json.dumps(self.config, ensure_ascii=False)

    def simulate(
        self,
        *,
        strict: bool = False,
        progress: Callable[[int, int], None] | None = None,
        threads: int | None = None,
        checkpoint: str | os.PathLike[str] | None = None,
    ) -> xr.Dataset:
        """Simulate the scene's image.

        Parameters
        ----------
        strict, progress, threads, checkpoint
            As in `phasemap.simulate`; they do not change the numbers.

        Returns
        -------
        xarray.Dataset
            The image, with the resolved scene as JSON in its attribute ``scene``.
        """
        from phasemap.imaging.simulation import simulate

        image = simulate(
            self.surface, self.microscope, **self.options, strict=strict, progress=progress, threads=threads,
            checkpoint=checkpoint,
        )  # fmt: skip
        return image.assign_attrs(scene=self.to_json())

    def truth(self) -> xr.Dataset:
        """Material under the tip at each pixel, its properties, and the relief before a tip of finite size saw it.

        Where the sample drifts, that is what has drifted under the tip by then; its rise in z is not of the relief.

        Returns
        -------
        xarray.Dataset
            As of `phasemap.Surface.to_dataset`, and where the surface is made of materials `label`, whole numbers with
            CF flags that name them.

        Examples
        --------
        >>> truth = load_scene("samples/step.toml").truth()
        >>> truth.label.attrs["flag_meanings"], truth.label.values[0, [0, -1]].tolist()
        ('compliant stiff', [0, 1])
        """
        from phasemap.imaging.imperfections import drifted, pixels_under_tip

        drift = (*self.options["realism"].drift[:2], 0.0)
        surface = self.surface if self.built is None else self.built.surface
        truth = drifted(surface, drift).to_dataset()
        if self.built is None or self.built.labels is None:
            return truth
        labels, names = self.built.labels
        labels = np.asarray(labels, np.int64).reshape(-1)[pixels_under_tip(surface, drift)]
        flags = {
            "long_name": "label of the material",
            "flag_values": np.array(list(names), np.int64),
            "flag_meanings": " ".join(re.sub(r"\s", "_", name) for name in names.values()),
        }
        return truth.assign(label=(("y", "x"), labels, flags))


@dataclass(frozen=True)
class SceneSetup:
    """Microscope, materials and setpoint of a scene, without its surface: all that a sweep needs."""

    microscope: Microscope
    materials: Mapping[str, Material]  # by their names, in the order of the file
    setpoint: float | None


def load_setup(path: str | os.PathLike[str], overrides: Iterable[str] = (), setpoint_by: str = "") -> SceneSetup:
    """Read microscope, materials and setpoint of a scene file; its surface is neither made nor read.

    An override of what is not read is refused; `setpoint_by`: option that gives the setpoint instead of the scene.
    """
    overrides = list(overrides)
    tables = read_tables(path, overrides)
    for override in overrides:
        key = override.partition("=")[0].strip()
        if setpoint_by and key in ("setpoint", "scan.setpoint"):
            raise InputError("override", override, f"a key that is used here; the setpoint is that of {setpoint_by}")
        if key != "surface.materials" and (key.partition(".")[0] in NOT_OF_SETUP or key == "scan.solver"):
            raise InputError("override", override, "a key of microscope or materials: this one is of an image")
    check_keys("the scene's table", tables, (*TABLES, "ensemble"), ("cantilever", "tip", "drive"))
    scan, complaints = table_of(tables, "scan"), Complaints()
    setpoint = complaints.of(scan_of, scan) if "setpoint" in scan else None
    with _strictness_of(scan):
        microscope = complaints.of(microscope_of, tables, Path(path).parent)
        materials = complaints.of(materials_of, tables)
        complaints.make()
        assert microscope is not None and materials is not None
        return SceneSetup(microscope, materials, None if setpoint is None else setpoint[0])


@asked_as()
def load_scene(path: str | os.PathLike[str], overrides: Iterable[str] = ()) -> Scene:
    """Read and check a scene file.

    Parameters
    ----------
    path : path-like
        A TOML file; files that it names are relative to its folder.
    overrides : iterable of str
        ``"table.key=value"``, such as ``"drive.free_amplitude=20e-9"`` or ``"materials.soft.modulus=2e9"``. The value
        is read as TOML, and as text where it is not TOML.

    Examples
    --------
    >>> load_scene("samples/step.toml", ["tip.radus=20e-9"])
    Traceback (most recent call last):
    ...
    phasemap.InputError: [tip] radus is unknown; allowed: radius, modulus, poisson_ratio. Did you mean 'radius'?
    """
    tables = read_tables(path, overrides)
    if "ensemble" in tables:
        raise InputError("[ensemble]", Word("there"), "no such table in a single scene", "Use load_ensemble.")
    return dataclasses.replace(scene_from_tables(tables, Path(path).parent), source=Path(path))


def scene_from_tables(tables: Table, folder: Path, surface: Surface | None = None) -> Scene:
    """Check tables of a scene and make what they describe, but for the surface where that is given."""
    check_keys("the scene's table", tables, TABLES, REQUIRED_TABLES)
    with _strictness_of(table_of(tables, "scan")):
        return _scene(tables, folder, surface)


def _scene(tables: Table, folder: Path, surface: Surface | None) -> Scene:
    """Scene of checked tables, with this surface or else the one that they describe."""
    complaints = Complaints()
    tables = complaints.of(with_typical, tables) or tables
    scan = complaints.of(scan_of, table_of(tables, "scan"))
    microscope = complaints.of(microscope_of, tables, folder)
    accuracy = complaints.of(object_of, tables, "accuracy", Accuracy)
    control = complaints.of(control_of, {"kind": "engage", **table_of(tables, "control")})
    output = table_of(tables, "output")
    complaints.of(_check_output, output, control, microscope)
    materials = complaints.of(materials_of, tables)
    files: dict[str, str] = {}
    built = None
    if surface is None:
        named = materials if materials is not None else dict.fromkeys(table_of(tables, "materials"), Material(1e9))
        if microscope is not None:
            named = complaints.of(of_one_loss, named, microscope) or named
        built = complaints.of(build_surface, table_of(tables, "surface"), named, folder)
        if built is not None and microscope is not None and scan is not None:
            files = built.files
            surface = complaints.of(under_tip, tables["surface"], built.surface, microscope, scan[0])
    realism = complaints.of(realism_of, table_of(tables, "realism"), control, surface and surface.shape[0])
    complaints.make()
    assert scan is not None and microscope is not None and accuracy is not None and control is not None
    assert materials is not None and surface is not None and realism is not None
    file, variables = output.get("file"), output.get("variables")
    config = {
        "scan": scan[1],
        "surface": tables["surface"],
        "materials": {name: dataclasses.asdict(material) for name, material in materials.items()},
        **microscope_tables(microscope),
        "control": describe(control),
        "accuracy": dataclasses.asdict(accuracy),
        "realism": dataclasses.asdict(realism),
        "files": files,
    }
    options = {
        "setpoint": scan[0],
        "solver": scan[1]["solver"],
        "control": control,
        "accuracy": accuracy,
        "realism": realism,
        "variables": variables,
    }
    return Scene(surface, microscope, options, folder / file if file else None, config, built=built)


def scene_from_json(text: str, folder: Path) -> Scene:
    """Make a scene again from its `Scene.to_json`, such as an image has in its attribute ``scene``.

    Raises FileError if a file, relative to `folder`, cannot be read, or is not the one that was read then.
    """
    try:
        tables = dict(json.loads(text))
        files = dict(tables.pop("files"))
    except (ValueError, TypeError, KeyError, RecursionError):
        raise InputError("scene", text, "what Scene.to_json gives: the tables of a scene, and its files") from None
    realism = table_of(tables, "realism")
    if realism.get("tip_change", 0) is None:  # no table that a scene could have
        tables["realism"] = {key: value for key, value in realism.items() if key != "tip_change"}
    with unquestioned():  # who made it was told then
        scene = scene_from_tables(tables, folder)
    for name, digest in scene.config["files"].items():
        if digest != files.get(name):
            raise FileError(f"cannot use {name}: it is not the file that was read then, whose SHA-256 was different.")
    return scene


def _strictness_of(scan: Table) -> AbstractContextManager[None]:
    """Context in which numbers outside all practice are errors, if the scene asks for that."""
    return strict_units() if switch("[scan]", scan, "strict_units") else nullcontext()


def _check_output(table: Table, control: Control | None, microscope: Microscope | None) -> None:
    """Refuse an output that cannot be, as far as is known without those that are None."""
    check_keys("[output]", table, ("file", "variables"))
    file, variables = table.get("file"), table.get("variables")
    if file is not None and not isinstance(file, str):
        raise InputError("[output] file", file, "a file name")
    if variables is not None and not isinstance(variables, list):
        raise InputError("[output] variables", variables, "a list of names, such as ['height', 'phase']")
    if control is not None and microscope is not None:
        construct("[output]", {"variables": variables}, split, control=control, scope=microscope)
