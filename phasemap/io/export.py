"""Images for other programs: .gwy and .gsf files of Gwyddion, and Datasets of sidpy.

sidpy comes with ``pip install "afm-phasemap[sidpy]"``.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from phasemap._shared.asked import asked_as
from phasemap._shared.checks import number
from phasemap._shared.errors import InputError, Word
from phasemap._shared.pixels import coordinate_step, coordinates, downwards
from phasemap.io.gwyddion import MASKED, extra
from phasemap.io.measured import one_scan
from phasemap.io.metadata import CANONICAL, KINDS, METRES
from phasemap.io.whole_files import replacing

PALETTES = {"height": "Gwyddion.net", "phase": "Gray", "topography": "Gwyddion.net"}
OTHER_PALETTE = "Warm"
UNITS = {"degree": "deg", "1": "", "N m-1": "N/m", "J m-2": "J/m^2"}  # as Gwyddion writes them
DEFAULT_UNITS = {"height": "m", "phase": "degree"}
NOTES = ("source", "source_sha256", "operating_mode", "modelled", "phasemap_version", "nominal", "warnings")
"""Texts that go along."""


@asked_as()
def export(
    ds: xr.Dataset,
    path: str | os.PathLike[str],
    variable: str | None = None,
    direction: str | None = None,
    *,
    overwrite: bool = False,
) -> Path:
    """Write an image for Gwyddion, in the format that the suffix names.

    Parameters
    ----------
    ds : xarray.Dataset
        An image of `phasemap.simulate` or `phasemap.read_image`, over ("y", "x") or ("direction", "y", "x").
    path : path-like
        The file to write: .gwy with every real variable as a channel, or .gsf with one in single precision.
    variable : str, optional
        The only one to write; needed for .gsf unless the image has a single one.
    direction : str, optional
        "trace" or "retrace", the only one to write; None writes both in .gwy, and the first in .gsf.
    overwrite : bool
        Whether an existing file may be replaced.

    Notes
    -----
    A .gwy file keeps values to the last bit. Gwyddion's fields have no NaN: pixels without a value, or whose ``status``
    is not good, are under a mask, and those without a value hold the mean of the others. What is known about the scan
    is in the metadata of each channel. A .gsf file has NaN where there is no value.

    Examples
    --------
    >>> import xarray as xr
    >>> export(xr.Dataset(), "image.tiff")
    Traceback (most recent call last):
    ...
    phasemap.InputError: the suffix is '.tiff'; allowed: .gwy or .gsf.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in (".gwy", ".gsf"):
        raise InputError("the suffix", suffix, ".gwy or .gsf")
    ds = ds.transpose(..., "y", "x", missing_dims="ignore")
    if suffix == ".gsf":
        return _write_gsf(ds, path, variable, direction, overwrite)
    if direction is not None:
        ds = one_scan(ds, (), direction)
    if variable is not None:
        ds = ds[[_known(ds, variable), *_status(ds)]]
    return _write_gwy(ds, path, overwrite)


def _write_gwy(ds: xr.Dataset, path: str | os.PathLike[str], overwrite: bool) -> Path:
    """Write every real variable of an image as a channel of a .gwy file."""
    objects = extra("gwyfile", "writing .gwy files", "gwy").objects
    size = _size(ds)
    notes = _notes(ds)
    container = objects.GwyContainer()
    for place, (name, title, values, bad) in enumerate(_fields(ds)):
        mask = bad | ~np.isfinite(values)
        filled = np.where(np.isfinite(values), values, np.mean(values[~mask]) if not mask.all() else 0.0)

        def field(data: np.ndarray, unit: str) -> Any:  # gwyfile would take a unit of one letter for a character
            units = [objects.GwySIUnit(unitstr=UNITS.get(one, one)) for one in ("m", unit)]
            return objects.GwyDataField(data, xreal=size[1], yreal=size[0], si_unit_xy=units[0], si_unit_z=units[1])

        container[f"/{place}/data"] = field(filled, _units(ds, name))
        container[f"/{place}/data/title"] = title
        container[f"/{place}/base/palette"] = PALETTES.get(name, OTHER_PALETTE)
        container[f"/{place}/data/visible"] = name in ("height", "phase")
        texts = dict(notes)
        if mask.any():
            container[f"/{place}/mask"] = field(mask.astype(float), "1")
            texts["mask"] = MASKED
        container[f"/{place}/meta"] = objects.GwyContainer(texts, dict.fromkeys(texts, "s"))
    with replacing(path, overwrite) as temporary:
        container.tofile(str(temporary))
    return Path(path)


def _write_gsf(
    ds: xr.Dataset, path: str | os.PathLike[str], variable: str | None, direction: str | None, overwrite: bool
) -> Path:
    """Write one variable of an image as a .gsf file, in single precision, NaN where it has no value."""
    if Path(path).suffix != ".gsf":  # gsffile knows no other
        raise InputError("the suffix", Path(path).suffix, ".gsf")
    gsffile = extra("gsffile", "writing .gsf files", "gwy")
    name = _known(ds, variable)
    _, title, values, bad = next(_fields(one_scan(ds[[name, *_status(ds)]], [name], direction)))
    yreal, xreal = _size(ds)
    texts = {key: text.replace("=", ":").replace("\n", " ") for key, text in _notes(ds).items()}
    header = {
        "XReal": repr(xreal), "YReal": repr(yreal), "Title": title, "XYUnits": "m",
        "ZUnits": UNITS.get(units := _units(ds, name), units), **texts,
    }  # fmt: skip
    with replacing(path, overwrite) as temporary:
        gsffile.write_gsf(temporary, np.where(bad, np.nan, values).astype(np.float32), header)
    return Path(path)


def _fields(ds: xr.Dataset) -> Iterator[tuple[str, str, np.ndarray, np.ndarray]]:
    """Name, title, values and bad pixels of each real variable and direction."""
    found = _real(ds)
    if not found:
        raise InputError("variables of the image", ", ".join(map(str, ds.data_vars)), "a real one over ('y', 'x')")
    for name in found:
        directions = ds["direction"].values.tolist() if "direction" in ds[name].dims else [None]
        for direction in directions:
            one = ds if direction is None else ds.sel(direction=direction)
            told = direction or ds.attrs.get("direction", "")
            title = f"{name.replace('_', ' ').capitalize()} {told}".strip()
            values = one[name].values.astype(float) * METRES.get(str(ds[name].attrs.get("units")), (1.0,))[0]
            bad = one["status"].values != 0 if "status" in one else np.zeros(values.shape, bool)
            yield name, title, values, bad


def _real(ds: xr.Dataset) -> list[str]:
    """Names of the variables that Gwyddion can show: real maps, flags aside."""
    maps = (("y", "x"), ("direction", "y", "x"))
    return [str(name) for name, values in ds.data_vars.items() if values.dims in maps and values.dtype.kind == "f"]


def _units(ds: xr.Dataset, name: str) -> str:
    """Units of what is written; Gwyddion knows no prefixes within its files."""
    units = str(ds[name].attrs.get("units", DEFAULT_UNITS.get(name, "1")))
    return METRES[units][1] if units in METRES else units


def _status(ds: xr.Dataset) -> list[str]:
    return ["status"] if "status" in ds else []


def _known(ds: xr.Dataset, variable: str | None) -> str:
    """The variable asked for, or the only one."""
    known = _real(ds)
    if variable is None and len(known) == 1:
        return known[0]
    if not isinstance(variable, str) or variable not in known:
        raise InputError("variable", variable, "one of " + ", ".join(known) if known else "a real one over ('y', 'x')")
    return variable


def _size(ds: xr.Dataset) -> tuple[float, float]:
    """Height and width of the image [m]."""
    return coordinate_step(ds, "y") * ds.sizes["y"], coordinate_step(ds, "x") * ds.sizes["x"]


def _notes(ds: xr.Dataset) -> dict[str, str]:
    """What is known about the image, as texts that `phasemap.read_image` reads back."""
    known = {name: number(f"attribute {name}", ds.attrs[name], "") for name in CANONICAL if name in ds.attrs}
    numbers = {name: f"{value!r} {CANONICAL[name]}" for name, value in known.items()}
    return {name: str(ds.attrs[name]) for name in NOTES if name in ds.attrs} | numbers


QUANTITIES = {
    "height": "Height", "phase": "Phase", "amplitude": "Amplitude", "amplitude_error": "AmplitudeError",
    "mean_deflection": "Deflection", "dissipation": "Dissipation", "indentation": "Indentation",
}  # fmt: skip
"""What variables are called as microscopes' channels are; others keep their names."""
WRITTEN = {"degree": "deg", "1": "a.u."}
SAME_STEP = 1e-3  # by which pixels of one image may differ


@asked_as()
def to_sidpy(image: xr.Dataset) -> dict[str, Any]:
    """Make Datasets of sidpy of an image, one a channel and direction.

    Parameters
    ----------
    image : xarray.Dataset
        Simulated or measured: float variables over ("y", "x") or ("direction", "y", "x").

    Returns
    -------
    dict of str to sidpy.Dataset
        By ``"Channel_000"`` and so on, height and phase first, as SciFiReaders gives the channels of a file. Each is of
        the data type IMAGE with dimensions x and y in m, in this order; y runs down from the top of the image. Units
        are m, deg, V ...; ``quantity`` is such as "Height", "Phase", or "PhaseRetrace"; ``original_metadata`` are the
        attributes of the image.

    Examples
    --------
    >>> import phasemap as pm
    >>> to_sidpy("image.nc")
    Traceback (most recent call last):
    ...
    phasemap.InputError: image is 'image.nc'; allowed: an xarray.Dataset. The order is to_sidpy(image).
    """
    for dim in ("y", "x"):
        if dim not in image.coords:
            raise InputError(f"coordinate {dim} of the image", None, "places of the pixels in m")
    names = [
        str(name) for name, one in image.data_vars.items() if {"y", "x"} <= set(one.dims) and one.dtype.kind == "f"
    ]
    names = [name for name in names if set(image[name].dims) <= {"direction", "y", "x"}]
    if not names:
        raise InputError("image", sorted(map(str, image.data_vars)), "one with maps over y and x")
    sidpy = extra("sidpy", "giving images to sidpy", "sidpy")
    first = [name for name in ("height", "phase") if name in names]
    made: dict[str, Any] = {}
    for name in [*first, *(one for one in names if one not in first)]:
        values = image[name]
        for direction in values["direction"].values if "direction" in values.dims else [None]:
            one = values if direction is None else values.sel(direction=direction)
            quantity = QUANTITIES.get(name, name) + ("" if direction in (None, "trace") else str(direction).title())
            data = sidpy.Dataset.from_array(np.asarray(one.transpose("x", "y").values, float), title=quantity)
            data.data_type, data.quantity = "image", quantity
            units = str(one.attrs.get("units", "1"))
            data.units, data.modality, data.source = WRITTEN.get(units, units), "AFM", "phasemap"
            for axis, dim in enumerate(("x", "y")):
                about = {"name": dim, "units": "m", "quantity": "Length", "dimension_type": "spatial"}
                places = downwards(image[dim].values, dim)  # as sidpy counts them, from the top
                data.set_dimension(axis, sidpy.Dimension(places, **about))
            data.original_metadata = {str(key): value for key, value in image.attrs.items()}
            made[f"Channel_{len(made):03d}"] = data
    return made


@asked_as()
def from_sidpy(dataset: Any) -> xr.Dataset:
    """Take an image from sidpy.

    Parameters
    ----------
    dataset : sidpy.Dataset, or mapping of str to sidpy.Dataset
        Channels of one image, as `to_sidpy` or a reader of SciFiReaders gives them; what is no image is passed over.

    Returns
    -------
    xarray.Dataset
        As `phasemap.read_image`: ``height`` [m], ``phase`` [degree], ``amplitude`` over ("y", "x"), or over
        ("direction", "y", "x") where there are retraces. Attributes are those of the metadata that are text or numbers.

    Examples
    --------
    >>> from_sidpy({})
    Traceback (most recent call last):
    ...
    phasemap.InputError: dataset is 'nothing'; allowed: channels that are called height, phase or amplitude.
    """
    found = _found_in(dataset)
    kinds = [kind for kind in KINDS if any(kind == own for own, _ in found)]
    directions = [way for way in ("trace", "retrace") if all((kind, way) in found for kind in kinds)]
    if not directions:
        directions = ["trace" if any(way == "trace" for _, way in found) else "retrace"]
        kinds = [kind for kind in kinds if (kind, directions[0]) in found]
    first, (y, x) = found[kinds[0], directions[0]]
    several = len(directions) > 1
    variables = {}
    for kind in kinds:
        maps = [_map_of(kind, *found[kind, way], (y, x)) for way in directions]
        about = {
            "long_name": KINDS[kind].long_name,
            "units": _unit_of(kind, str(found[kind, directions[0]][0].units))[1],
        }
        dims = ("direction", "y", "x") if several else ("y", "x")
        variables[kind] = (dims, maps if several else maps[0], about)
    coords = coordinates(y[::-1], x)
    if several:
        coords["direction"] = ("direction", directions, {})
    attrs = getattr(first, "original_metadata", None) or {}
    kept = {
        str(key): value
        for key, value in attrs.items()
        if isinstance(value, str | int | float) and not isinstance(value, bool) and key != "direction"
    }
    return xr.Dataset(variables, coords, kept)


def _found_in(dataset: Any) -> dict[tuple[str, str], tuple[Any, Any]]:
    """Channels of an image that have a kind, with the places of their pixels, by kind and direction."""
    channels = list(dataset.values()) if isinstance(dataset, Mapping) else [dataset]
    for one in channels:
        if not hasattr(one, "quantity"):
            raise InputError("dataset", Word(f"a {type(one).__name__}"), "a sidpy.Dataset, or a dict of them")
    found: dict[tuple[str, str], tuple[Any, Any]] = {}
    for one in channels:
        called = next((str(word) for word in (one.quantity, one.title) if _kind(str(word))), "")
        if called and getattr(one.data_type, "name", "") == "IMAGE":
            direction = "retrace" if "retrace" in called.lower() else "trace"
            found.setdefault((_kind(called), direction), (one, _places(one)))
    if not found:
        listed = ", ".join(str(one.quantity) for one in channels) or "nothing"
        raise InputError("dataset", listed, "channels that are called height, phase or amplitude")
    return found


def _map_of(kind: str, channel: Any, places: tuple[Any, Any], wanted: tuple[Any, Any]) -> Any:
    """Values of a channel over (y, x), in the unit of their kind; refused where pixels are not at the wanted places."""
    factor, _ = _unit_of(kind, str(channel.units))
    values = np.asarray(channel.compute(), float) * factor
    shape = (len(wanted[1]), len(wanted[0]))
    if values.shape != shape or not all(np.allclose(a, b, rtol=SAME_STEP) for a, b in zip(places, wanted, strict=True)):
        raise InputError(f"pixels of {channel.quantity}", values.shape, f"those of the other channels, {shape}")
    return values.T


def _kind(called: str) -> str:
    """The variable that a channel of this name is, "" if it is none."""
    return next((kind for kind, about in KINDS.items() if about.pattern.match(called.strip())), "")


def _unit_of(kind: str, written: str) -> tuple[float, str]:
    """Factor to, and name of, the unit of a variable."""
    units = KINDS[kind].units
    if written not in units:
        raise InputError(f"units of {kind}", written, ", ".join(units))
    return units[written]


def _places(one: Any) -> tuple[Any, Any]:
    """Centres of the pixels along y and x [m]; x is the first dimension."""
    found = []
    for axis in (1, 0):
        dimension = getattr(one, f"dim_{axis}")
        factor, _ = METRES.get(str(dimension.units), (math.nan, ""))
        values = np.asarray(dimension.values, float) * factor
        if not np.isfinite(values).all():
            raise InputError(f"units of dimension {dimension.name}", str(dimension.units), ", ".join(METRES))
        step = (values[-1] - values[0]) / max(len(values) - 1, 1) or 1.0
        centres = (np.arange(len(values)) + 0.5) * abs(step)
        found.append(values if np.allclose(values, centres, rtol=1e-9, atol=0.0) else centres)
    return found[0], found[1]
