"""Scenes: one TOML file that says everything a simulation needs.

The tables are ``[scan]`` (setpoint, solver, strict_units), ``[surface]`` (see `phasemap.scenes.surface`),
``[materials.NAME]``, ``[cantilever]``, ``[tip]``, ``[drive]``, ``[interaction]``, ``[control]`` (kind, and more),
``[accuracy]``, ``[realism]`` and ``[output]`` (file, variables); a table ``[ensemble]`` makes many scenes of one
(`phasemap.scenes.ensemble`). Keys are the arguments of the Python objects of the same name, in SI units or as text
with a unit ("40 nm"); nothing unknown is passed over. ``preset = "PS"`` in a material or the lever stands for its
numbers, beside which others may be given.
"""

from __future__ import annotations

import dataclasses
import json
import os
import warnings
from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from phasemap._shared.errors import FileError, InputError, Word
from phasemap._shared.plausible import strict_units, unquestioned
from phasemap.experiment.accuracy import Accuracy
from phasemap.experiment.control import Control, Engage, Feedback, Raster
from phasemap.experiment.interaction import Interaction
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Cantilever, Drive, Microscope, Mode, Tip
from phasemap.experiment.realism import Realism, TipChange, check_realism
from phasemap.scenes.tables import Table, check_choice, check_keys, construct, read_tables

if TYPE_CHECKING:
    import xarray as xr

    from phasemap.experiment.surface import Surface

__all__ = ["Scene", "Setup", "load_scene", "load_setup", "scene_from_json", "scene_from_tables"]

T = TypeVar("T")

CONTROLS: dict[str, type[Control]] = {"engage": Engage, "raster": Raster, "feedback": Feedback}
TABLES = (
    "scan", "surface", "materials", "cantilever", "tip", "drive", "interaction", "control", "accuracy", "realism",
    "output",
)  # fmt: skip
LOW_Q = 50.0  # below this it matters what the detector sees
REQUIRED_TABLES = ("scan", "surface", "cantilever", "tip", "drive")


@dataclass(frozen=True)
class Scene:
    """A checked scene: what `phasemap.simulate` takes, and where it came from.

    Parameters
    ----------
    surface : Surface
    microscope : Microscope
    options : mapping
        The further arguments of `phasemap.simulate`: setpoint, solver, control, accuracy, realism, variables.
    output : Path or None
        The file that ``[output]`` names, relative to the scene's folder.
    config : mapping
        Every table with its defaults filled in, and the SHA-256 of every file that was read.
    source : Path or None
        The file that the scene was read from.

    Examples
    --------
    >>> scene = load_scene("samples/step.toml", ["scan.setpoint=0.6"])
    >>> scene.options["setpoint"], scene.microscope.tip.radius
    (0.6, 1e-08)
    """

    surface: Surface
    microscope: Microscope
    options: Mapping[str, Any]
    output: Path | None
    config: Mapping[str, Any]
    source: Path | None = None

    def to_json(self) -> str:
        """The resolved configuration as one line of JSON.

        Returns
        -------
        str
        """
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


@dataclass(frozen=True)
class Setup:
    """What a scene says besides its surface: all that a sweep needs.

    Parameters
    ----------
    microscope : Microscope
    materials : mapping of str to Material
        By their names, in the order of the file.
    setpoint : float or None
    """

    microscope: Microscope
    materials: Mapping[str, Material]
    setpoint: float | None


def load_setup(path: str | os.PathLike[str], overrides: Iterable[str] = ()) -> Setup:
    """Read microscope, materials and setpoint of a scene file; its surface is neither made nor read.

    Parameters
    ----------
    path, overrides
        As in `load_scene`.

    Returns
    -------
    Setup

    Raises
    ------
    InputError, FileError
        As in `load_scene`.

    Examples
    --------
    >>> list(load_setup("samples/step.toml").materials)
    ['compliant', 'stiff']
    """
    tables = read_tables(path, overrides)
    check_keys("the scene's table", tables, (*TABLES, "ensemble"), ("cantilever", "tip", "drive"))
    scan = _table(tables, "scan")
    setpoint = _scan(scan)[0] if "setpoint" in scan else None
    with _asking(scan):
        return Setup(_microscope(tables), _materials(tables), setpoint)


def load_scene(path: str | os.PathLike[str], overrides: Iterable[str] = ()) -> Scene:
    """Read and check a scene file.

    Parameters
    ----------
    path : path-like
        A TOML file; files that it names are relative to its folder.
    overrides : iterable of str
        ``"table.key=value"``, such as ``"drive.free_amplitude=20e-9"`` or ``"materials.soft.modulus=2e9"``. The value
        is read as TOML, and as text where it is not TOML.

    Returns
    -------
    Scene

    Raises
    ------
    InputError
        If a table or key is unknown, missing, or has a value that is not allowed.
    FileError
        If the scene or a file that it names cannot be read.

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
    """Check the tables of a scene, and make what they describe.

    Parameters
    ----------
    tables : dict
        As `read_tables` gives them.
    folder : Path
        Where relative file names start.
    surface : Surface, optional
        Taken instead of the one that ``[surface]`` describes, which is neither made nor checked then: all else is
        checked in no time.

    Returns
    -------
    Scene

    Raises
    ------
    InputError, FileError
        As in `load_scene`.

    Examples
    --------
    >>> scene_from_tables(read_tables("samples/step.toml"), Path("samples")).surface.shape
    (128, 256)
    """
    check_keys("the scene's table", tables, TABLES, REQUIRED_TABLES)
    with _asking(_table(tables, "scan")):
        return _scene(tables, folder, surface)


def _scene(tables: Table, folder: Path, surface: Surface | None) -> Scene:
    """What the tables describe."""
    from phasemap.results.channels import split
    from phasemap.results.variables import describe
    from phasemap.scenes.surface import build_surface, dilate, seen

    setpoint, scan = _scan(_table(tables, "scan"))
    microscope = _microscope(tables)
    accuracy = _object(tables, "accuracy", Accuracy)
    control_table = {"kind": "engage", **_table(tables, "control")}
    check_choice("[control] kind", control_table["kind"], CONTROLS)
    control = _control(control_table.pop("kind"), control_table)
    output = _table(tables, "output")
    check_keys("[output]", output, ("file", "variables"))
    file, variables = output.get("file"), output.get("variables")
    if file is not None and not isinstance(file, str):
        raise InputError("[output] file", file, "a file name")
    if variables is not None and not isinstance(variables, list):
        raise InputError("[output] variables", variables, "a list of names, such as ['height', 'phase']")
    construct("[output]", {"variables": variables}, split, control=control, second=microscope.drive.second is not None)
    materials = _materials(tables)
    files: dict[str, str] = {}
    if surface is None:
        surface, files = build_surface(_table(tables, "surface"), materials, folder)
        surface = dilate(tables["surface"], surface, microscope.tip)
        surface = seen(tables["surface"], surface, microscope, setpoint)
    realism = _realism(_table(tables, "realism"), control, surface.shape[0])
    config = {
        "scan": scan,
        "surface": tables["surface"],
        "materials": {name: dataclasses.asdict(material) for name, material in materials.items()},
        **dataclasses.asdict(microscope),
        "control": describe(control),
        "accuracy": dataclasses.asdict(accuracy),
        "realism": dataclasses.asdict(realism),
        "files": files,
    }
    options = {
        "setpoint": setpoint,
        "solver": scan["solver"],
        "control": control,
        "accuracy": accuracy,
        "realism": realism,
        "variables": variables,
    }
    return Scene(surface, microscope, options, folder / file if file else None, config)


def scene_from_json(text: str, folder: Path) -> Scene:
    """Make a scene again from its `Scene.to_json`, such as an image has in its attribute ``scene``.

    Parameters
    ----------
    text : str
    folder : Path
        Where relative names of files start.

    Returns
    -------
    Scene

    Raises
    ------
    InputError
        If the text is no such scene.
    FileError
        If a file cannot be read, or is not the one that was read then.

    Examples
    --------
    >>> scene = load_scene("samples/step.toml")
    >>> scene_from_json(scene.to_json(), Path("samples")).config == scene.config
    True
    """
    try:
        tables = dict(json.loads(text))
        files = dict(tables.pop("files"))
    except (ValueError, TypeError, KeyError, RecursionError):
        raise InputError("scene", text, "what Scene.to_json gives: the tables of a scene, and its files") from None
    realism = _table(tables, "realism")
    if realism.get("tip_change", 0) is None:  # no table that a scene could have
        tables["realism"] = {key: value for key, value in realism.items() if key != "tip_change"}
    with unquestioned():  # who made it was told then
        scene = scene_from_tables(tables, folder)
    for name, digest in scene.config["files"].items():
        if digest != files.get(name):
            raise FileError(f"cannot use {name}: it is not the file that was read then, whose SHA-256 was other.")
    return scene


def _asking(scan: Table) -> AbstractContextManager[None]:
    """Whether numbers outside all practice are errors."""
    strict = scan.get("strict_units", False)
    if not isinstance(strict, bool):
        raise InputError("[scan] strict_units", strict, "true or false")
    return strict_units() if strict else nullcontext()


def _scan(table: Table) -> tuple[float, Table]:
    """The setpoint, and the table with its defaults."""
    from phasemap.solvers.problem import check_setpoint
    from phasemap.solvers.solver import SOLVERS

    scan = {"solver": "auto", **table}
    check_keys("[scan]", scan, ("setpoint", "solver", "strict_units"), ("setpoint",))
    check_choice("[scan] solver", scan["solver"], [solver.name for solver in SOLVERS])
    return construct("[scan]", {"setpoint": scan["setpoint"]}, check_setpoint), scan


def _microscope(tables: Table) -> Microscope:
    """The microscope of the tables for its parts."""
    lever, tip = _object(tables, "cantilever", Cantilever), _object(tables, "tip", Tip)
    if lever.quality_factor < LOW_Q and "excitation" not in _table(tables, "drive"):
        warnings.warn(
            f"Q is {lever.quality_factor:g} and [drive] does not say excitation: set it to 'base' for a shaker under "
            "the lever, by which phases change by degrees, or to 'direct' for a force on the tip.",
            stacklevel=2,
        )
    drive = _table(tables, "drive")
    if drive.get("second") is not None:
        drive = {**drive, "second": _from_table("[drive.second]", drive["second"], Mode)}
    return Microscope(lever, tip, _from_table("[drive]", drive, Drive), _object(tables, "interaction", Interaction))


def _realism(table: Table, control: Control, lines: int) -> Realism:
    """The realism of its table, which has one of its own for a change of the tip."""
    if "tip_change" in table:
        table = {**table, "tip_change": _from_table("[realism.tip_change]", table["tip_change"], TipChange)}
    realism = _from_table("[realism]", table, Realism)
    return construct("[realism]", {"realism": realism}, check_realism, control=control, lines=lines)


def _materials(tables: Table) -> dict[str, Material]:
    """The materials by name."""
    return {
        name: _from_table(f"[materials.{name}]", table, Material) for name, table in _table(tables, "materials").items()
    }


def _table(tables: Table, name: str) -> Table:
    """A table of the scene, empty where it is not given."""
    table = tables.get(name, {})
    if not isinstance(table, dict):
        raise InputError(f"[{name}]", table, "a table")
    return table


def _object(tables: Table, name: str, cls: Callable[..., T]) -> T:
    """The object of the table that has its name."""
    found: T = _from_table(f"[{name}]", _table(tables, name), cls)
    return found


def _control(kind: str, table: Table) -> Control:
    """The control of this kind; a key of another kind is told from a misspelt one."""
    keys = {name: {field.name for field in dataclasses.fields(cls)} for name, cls in CONTROLS.items()}  # type: ignore[arg-type]
    for key, value in table.items():
        others = [name for name in CONTROLS if key in keys[name]]
        if others and kind not in others:
            belongs = f"It belongs to kind = {' or '.join(map(repr, others))}."
            raise InputError(f"[control] {key}", value, f"nothing where kind is {kind!r}", belongs)
    control: Control = _from_table("[control]", table, CONTROLS[kind])
    return control


def _from_table(name: str, table: object, cls: Any) -> Any:
    """A frozen dataclass from the table of its fields, or from a preset and what is other."""
    fields = dataclasses.fields(cls)
    required = [field.name for field in fields if field.default is dataclasses.MISSING]
    allowed = [field.name for field in fields]
    if hasattr(cls, "preset"):
        allowed.append("preset")
        if isinstance(table, dict) and "preset" in table:
            check_keys(name, table, allowed)
            others = {key: value for key, value in table.items() if key != "preset"}
            return construct(name, others, partial(cls.preset, table["preset"]))
    check_keys(name, table, allowed, required)
    assert isinstance(table, dict)
    return construct(name, table, cls)
