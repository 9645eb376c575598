"""The ``[surface]`` table of a scene; docs/reference/scenes.md explains its keys."""

from __future__ import annotations

import dataclasses
import inspect
import warnings
from collections.abc import Callable, Mapping
from contextlib import suppress
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from phasemap._shared.arrays import as_array
from phasemap._shared.checks import check_choice, number
from phasemap._shared.errors import FileError, InputError, PhasemapError, Word
from phasemap._shared.files import digest_of, size_of
from phasemap._shared.memory import check_fits
from phasemap._shared.notices import question, untold
from phasemap._shared.pixels import coordinate_step
from phasemap._shared.quantities import NotThatUnit, array_in_si, is_number
from phasemap.experiment import generate
from phasemap.experiment.labels import Variation
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Microscope, Tip
from phasemap.experiment.surface import Surface
from phasemap.experiment.surface_maps import QUANTITIES
from phasemap.io.measured import level_height, one_scan, segment_phase
from phasemap.io.metadata import recorded_sign
from phasemap.io.netcdf import load
from phasemap.io.read import read_image
from phasemap.scenes.tables import check_keys, construct, missing, switch

TEXT = 8  # byte of memory at most for a byte of text: "0," becomes a float64, and lists grow by doubling
SUFFIXES = (".npy", ".csv", ".txt", ".nc")  # of files with a map
HEIGHTS = (0.0, 1e-4)  # m, of anything that an AFM can scan
GENERATED = (0, 1)  # labels that a generator makes
TIP = ("dilate", "half_angle", "seen_by_tip")  # keys of `dilate` and `seen`; the makers of surfaces pass them over


class MaterialMap(NamedTuple):
    """Material of each pixel of a surface."""

    values: np.ndarray  # int, shape (ny, nx)
    names: Mapping[int, str]  # the material of each label

    @property
    def used(self) -> set[str]:
        """Names of the materials that there is a pixel of."""
        return {self.names[label] for label in np.unique(self.values).tolist()}


class Built(NamedTuple):
    """Surface that a ``[surface]`` table describes, its labels, and the files that were read."""

    surface: Surface
    files: dict[str, str]  # the SHA-256 of each file that was read, by the name that the scene gives it
    labels: MaterialMap | None  # none where the surface is made of maps


def build_surface(table: dict[str, Any], materials: Mapping[str, Material], folder: Path) -> Built:
    """Make the surface that the ``[surface]`` table of a scene describes. Raises FileError if a file cannot be read."""
    generators = _generators("Labels")
    if "kind" not in table:
        raise missing("[surface]", "kind")
    kind = table["kind"]
    check_choice("[surface] kind", kind, ["labels", "maps", "measured", *generators])
    files = Files(folder)
    arguments = {key: value for key, value in table.items() if key not in ("kind", *TIP)}
    if kind == "maps":
        return Built(_from_maps(arguments, files), files.digests, None)
    if kind == "measured":
        surface, labels = _from_measured(arguments, materials, files)
    else:
        surface, labels = _from_labels(arguments, materials, files, generators.get(kind))
    return Built(surface, files.digests, labels)


def dilate(table: Mapping[str, Any], surface: Surface, tip: Tip) -> Surface:
    """Surface as a tip of finite size sees it, if its ``[surface]`` table has dilate = true."""
    if switch("[surface]", table, "dilate"):
        return construct("[surface]", {"half_angle": table.get("half_angle")}, surface.dilated, tip=tip)
    if "half_angle" in table:
        raise InputError("[surface] half_angle", table["half_angle"], "none without dilate = true")
    return surface


def seen_by_tip(table: Mapping[str, Any], surface: Surface, scope: Microscope, setpoint: float) -> Surface:
    """Surface with edges blurred as its tip blurs them, if its ``[surface]`` table has seen_by_tip = true."""
    return surface.seen_by(scope, setpoint) if switch("[surface]", table, "seen_by_tip") else surface


def under_tip(table: Mapping[str, Any], surface: Surface, scope: Microscope, setpoint: float) -> Surface:
    """The surface as its tip sees it."""
    return seen_by_tip(table, dilate(table, surface, scope.tip), scope, setpoint)


def variation_of(table: Mapping[str, Any]) -> Variation | None:
    """Variation of the materials within their domains, if the ``[surface]`` table has one."""
    if "variation" not in table:
        return None
    name, given = "[surface.variation]", table["variation"]
    check_keys(name, given, [field.name for field in dataclasses.fields(Variation)])
    return construct(name, given, Variation)


def _from_labels(
    table: dict[str, Any], materials: Mapping[str, Material], files: Files, generator: Callable[..., np.ndarray] | None
) -> tuple[Surface, MaterialMap]:
    """A map of labels, given or generated, and the material of each."""
    common = ("materials", "pixel_size", "topography", "heights", "variation")
    if generator is None:
        check_keys("[surface]", table, ("labels", *common), ("labels", "materials", "pixel_size"))
        given = _map("labels", table["labels"], files, table)
        labels = as_array("[surface] labels", given, "a 2-D map of whole numbers")
    else:
        required, optional = _arguments(generator)
        check_keys("[surface]", table, (*required, *optional, *common), (*required, "materials", "pixel_size"))
        labels = construct("[surface]", {key: table[key] for key in (*required, *optional) if key in table}, generator)
    names = table["materials"]
    if isinstance(names, dict):
        chosen = {_whole(label): _material(name, materials) for label, name in names.items()}
        called = {_whole(label): str(name) for label, name in names.items()}
        if len(chosen) < len(names):
            raise InputError("[surface] materials", Word(", ".join(names)), "each label once")
    else:
        chosen, called = dict(enumerate(_materials(names, materials))), dict(enumerate(names))
    if generator is not None and not set(chosen) <= set(GENERATED):
        allowed = f"a material for label 0 and one for 1, for {generator.__name__} makes no other"
        raise InputError("[surface] materials", names, allowed)
    relief = {}
    if "topography" in table:
        relief["topography"] = _map("topography", table["topography"], files, {**table, "shape": labels.shape})
    if "heights" in table:
        heights = _heights(table["heights"], list(chosen), labels)
        relief["topography"] = heights + _relief(relief.get("topography", 0.0), labels.shape)
    arguments = {"pixel_size": table["pixel_size"], **relief, "variation": variation_of(table)}
    surface = construct("[surface]", arguments, Surface.from_labels, labels=labels, materials=chosen)
    return surface, MaterialMap(labels, called)


def _from_maps(table: dict[str, Any], files: Files) -> Surface:
    """Maps of properties, one by one or together in a netCDF file."""
    switch("[surface]", table, "allow_nan")
    if "file" in table:
        check_keys("[surface]", table, ("file", "allow_nan"))
        dataset = load(files.find("file", table.pop("file")))
        return construct("[surface]", table, Surface.from_dataset, dataset=dataset)
    check_keys("[surface]", table, (*QUANTITIES, "pixel_size", "shape", "allow_nan"), ("modulus", "pixel_size"))
    maps = {key: _map(key, value, files, table) if key in QUANTITIES else value for key, value in table.items()}
    return construct("[surface]", maps, Surface)


def _from_measured(
    table: dict[str, Any], materials: Mapping[str, Material], files: Files
) -> tuple[Surface, MaterialMap]:
    """The height of a measured image as topography, and its phase populations as materials."""
    check_keys("[surface]", table, ("file", "materials", "height", "phase", "variation"), ("file", "materials"))
    chosen = _materials(table["materials"], materials)
    with untold():  # who made the scene was told
        image = read_image(files.find("file", table["file"]), height=table.get("height"), phase=table.get("phase"))
    image = one_scan(image)
    labels = segment_phase(recorded_sign(image.attrs) * image["phase"].values, len(chosen))
    topography = level_height(image["height"].values, labels == np.bincount(labels.ravel()).argmax())
    grid, variation = (coordinate_step(image, "y"), coordinate_step(image, "x")), variation_of(table)
    surface = Surface.from_labels(labels, chosen, topography=topography, pixel_size=grid, variation=variation)
    return surface, MaterialMap(labels, dict(enumerate(table["materials"])))


def _generators(result: str) -> dict[str, Callable[..., np.ndarray]]:
    """The generators of labels or of fields, by name."""
    every = {name: getattr(generate, name) for name in generate.__all__}
    return {name: function for name, function in every.items() if function.__annotations__["return"] == result}


def _arguments(function: Callable[..., object]) -> tuple[list[str], list[str]]:
    """Names of the required and the optional arguments."""
    every = inspect.signature(function).parameters.values()
    required = [argument.name for argument in every if argument.default is argument.empty]
    return required, [argument.name for argument in every if argument.name not in required]


def _map(key: str, value: object, files: Files, surface: Mapping[str, Any]) -> Any:
    """A number, rows of numbers, the array in a file, or a generated field with the shape and pixels of the surface."""
    if isinstance(value, str):
        if Path(value).suffix.lower() not in SUFFIXES and is_number(value):
            return value
        return read_array(key, files.find(key, value), key)
    if not isinstance(value, dict):
        return value
    name = f"[surface.{key}]"
    if "generator" not in value:
        check_keys(name, value, ("file", "variable", "generator"), ("file",))
        return read_array(key, files.find(key, value["file"]), value.get("variable", key))
    fields = _generators("Field")
    check_choice(f"{name} generator", value["generator"], fields)
    generator = fields[value["generator"]]
    required, optional = _arguments(generator)
    given = {
        argument: surface[argument]
        for argument in ("shape", "pixel_size")
        if argument in surface and argument in (*required, *optional)
    }
    if "shape" not in given:
        raise InputError("[surface] shape", None, "(rows, columns), for a generated field has none of its own")
    check_keys(name, {**given, **value}, ("generator", *required, *optional), required)
    arguments = {argument: own for argument, own in value.items() if argument != "generator"}
    for argument in given.keys() & arguments:
        raise InputError(f"{name} {argument}", arguments[argument], "nothing, for it is that of the surface")
    return construct(name, arguments, generator, **given)


def _heights(given: object, labels: list[int], of_pixels: np.ndarray) -> np.ndarray:
    """The height of each pixel from that of its label; labels without a material are left to `Surface`."""
    if not isinstance(given, list) or len(given) != len(labels):
        raise InputError("[surface] heights", given, f"a list of {len(labels)} heights in m, one for each material")
    heights = np.zeros(of_pixels.shape)
    for label, height in zip(labels, given, strict=True):
        checked = number("[surface] heights", height, "m")
        question("[surface] heights", checked, "m", HEIGHTS)
        heights[of_pixels == label] = checked
    return heights


def _relief(given: object, shape: tuple[int, ...]) -> np.ndarray:
    """A topography to which the heights of labels can be added."""
    with suppress(NotThatUnit):  # which leaves text, and that is refused below
        given = array_in_si(given, "m")
    relief = as_array("[surface] topography", given, "one number or a 2-D map")
    if relief.dtype.kind not in "fiu" or relief.shape not in ((), shape):
        found = f"{relief.dtype.name} of shape {relief.shape}"
        raise InputError(
            "[surface] topography", found, f"one number or a map of shape {shape}, that of the labels, in m"
        )
    return np.asarray(relief, np.float64)


def _materials(names: object, materials: Mapping[str, Material]) -> list[Material]:
    """The materials of a list of names."""
    if not isinstance(names, list) or not names:
        raise InputError("[surface] materials", names, "a list of names of [materials.NAME] tables")
    return [_material(name, materials) for name in names]


def _material(name: object, materials: Mapping[str, Material]) -> Material:
    """The material of one name."""
    if not materials:
        raise InputError("[surface] materials", name, "names of [materials.NAME] tables, of which the scene has none")
    check_choice("[surface] materials", name, materials)
    return materials[str(name)]


def _whole(label: str) -> int:
    """The whole number that a TOML key spells."""
    try:
        return int(label)
    except ValueError as error:
        raise InputError("[surface] materials", label, "labels that are whole numbers") from error


class Files:
    """Finds the files that a scene names, and remembers what was in them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.digests: dict[str, str] = {}

    def find(self, key: str, name: object) -> Path:
        """The path of a file that the scene names under `key`."""
        if not isinstance(name, str) or not name:
            raise InputError(f"[surface] {key}", name, "a file name")
        path = place_of(name, self.folder)
        what = f"{path}, named in [surface] {key}"
        check_fits(what, size_of(path, what), "Take a smaller map.")
        self.digests[name] = digest_of(path, what)
        return path


def place_of(name: str, folder: Path) -> Path:
    """The path of a file that a scene in this folder names, or that it names in an installed package."""
    if not name.startswith("package:"):
        return folder / name
    package, _, inside = name.removeprefix("package:").partition("/")
    spec = _installed(package)
    if spec is None or not spec.submodule_search_locations:
        raise FileError(f"cannot read {name}: the package {package!r} is not installed.")
    return Path(spec.submodule_search_locations[0], inside)


def _installed(package: str) -> ModuleSpec | None:
    """Place of an installed package, which is not imported; None if there is none."""
    try:
        return find_spec(package) if package.isidentifier() else None
    except ValueError:  # __main__, say, was not found as others are
        return None


def read_array(key: str, path: Path, variable: object) -> np.ndarray:
    """The array in a .npy, .csv, .txt or netCDF file."""
    readers: dict[str, Callable[[], np.ndarray]] = {
        ".npy": lambda: _read_npy(path),
        ".csv": lambda: np.loadtxt(path, delimiter=",", ndmin=2),
        ".txt": lambda: np.loadtxt(path, ndmin=2),
        ".nc": lambda: _read_variable(path, variable),
    }
    suffix = path.suffix.lower()
    if suffix in (".csv", ".txt"):
        check_fits(f"{path}, named in [surface] {key},", TEXT * path.stat().st_size, "Take a smaller map.")
    if suffix not in readers:
        raise InputError(f"[surface] {key}", path.name, "a file that ends in " + ", ".join(readers))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", UserWarning)  # loadtxt only warns of a file without numbers
            return readers[suffix]()
    except PhasemapError:
        raise
    except Exception as error:  # numpy passes on what its parsers raise where a file is damaged
        reason = (str(error) or type(error).__name__).splitlines()[0].rstrip(".")
        raise FileError(f"cannot read {path}, named in [surface] {key}: {reason}.") from error


def _read_npy(path: Path) -> np.ndarray:
    """The array in a .npy file, not an archive, which `numpy.load` reads too and which may unpack to gigabytes."""
    values = np.load(path, allow_pickle=False)  # takes no memory for what is declared and not there
    if not isinstance(values, np.ndarray):
        values.close()
        raise ValueError("it is an archive, not an array")
    return values


def _read_variable(path: Path, variable: object) -> np.ndarray:
    """Values of a variable of a netCDF file."""
    dataset = load(path)
    if variable not in list(dataset.data_vars):
        held = ", ".join(map(repr, dataset.data_vars))
        raise FileError(f"cannot use {path}: there is no variable {variable!r}; it holds {held}.")
    return dataset[str(variable)].values
