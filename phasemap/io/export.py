"""Images for other programs: .gwy and .gsf files of Gwyddion, and Datasets of sidpy.

sidpy comes with ``pip install "afm-phasemap[sidpy]"``.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from phasemap._shared.asked import asked_as
from phasemap._shared.checks import number
from phasemap._shared.errors import InputError, Word
from phasemap._shared.files import replacing
from phasemap._shared.pixels import coordinate_step, downwards
from phasemap.io.gwyddion import MASKED, extra
from phasemap.io.measured import one_scan
from phasemap.io.metadata import CANONICAL, METRES, settings_of_image

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
        ds = ds[[_chosen_variable(ds, variable), *_status(ds)]]
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
    name = _chosen_variable(ds, variable)
    _, title, values, _ = next(_fields(one_scan(ds[[name, *_status(ds)]], [name], direction)))
    yreal, xreal = _size(ds)
    texts = {key: text.replace("=", ":").replace("\n", " ") for key, text in _notes(ds).items()}
    header = {
        "XReal": repr(xreal), "YReal": repr(yreal), "Title": title, "XYUnits": "m",
        "ZUnits": UNITS.get(units := _units(ds, name), units), **texts,
    }  # fmt: skip
    with replacing(path, overwrite) as temporary:
        gsffile.write_gsf(temporary, values.astype(np.float32), header)
    return Path(path)


def _fields(ds: xr.Dataset) -> Iterator[tuple[str, str, np.ndarray, np.ndarray]]:
    """Name, title, values and bad pixels of each real variable and direction."""
    variables = _real(ds)
    if not variables:
        raise InputError(
            "the image", Word("one of " + ", ".join(map(str, ds.data_vars))), "one with a real map over ('y', 'x')"
        )
    for name in variables:
        directions = ds["direction"].values.tolist() if "direction" in ds[name].dims else [None]
        for direction in directions:
            image = ds if direction is None else ds.sel(direction=direction)
            told = direction or ds.attrs.get("direction", "")
            title = f"{name.replace('_', ' ').capitalize()} {told}".strip()
            values = image[name].values.astype(float) * METRES.get(str(ds[name].attrs.get("units")), (1.0,))[0]
            bad = image["status"].values != 0 if "status" in image else np.zeros(values.shape, bool)
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
    """The name "status" in a list, if there is one."""
    return ["status"] if "status" in ds else []


def _chosen_variable(ds: xr.Dataset, variable: str | None) -> str:
    """Name of the variable asked for, or of the only one."""
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
    """Settings and remarks of an image, as texts that `phasemap.read_image` reads back."""
    settings = settings_of_image(ds)
    known = {name: number(f"attribute {name}", settings[name], "") for name in CANONICAL if name in settings}
    numbers = {name: f"{value!r} {CANONICAL[name]}" for name, value in known.items()}
    return {name: str(ds.attrs[name]) for name in NOTES if name in ds.attrs} | numbers


QUANTITIES = {
    "height": "Height", "phase": "Phase", "amplitude": "Amplitude", "amplitude_error": "AmplitudeError",
    "mean_deflection": "Deflection", "dissipation": "Dissipation", "indentation": "Indentation",
}  # fmt: skip
"""Names of variables as channels of microscopes; others keep their names."""
WRITTEN = {"degree": "deg", "1": "a.u."}


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
            channel = values if direction is None else values.sel(direction=direction)
            told = image.attrs.get("direction", "trace") if direction is None else direction
            quantity = QUANTITIES.get(name, name) + ("" if told == "trace" else str(told).title())
            data = sidpy.Dataset.from_array(np.asarray(channel.transpose("x", "y").values, float), title=quantity)
            data.data_type, data.quantity = "image", quantity
            units = str(channel.attrs.get("units", "1"))
            data.units, data.modality, data.source = WRITTEN.get(units, units), "AFM", "phasemap"
            for axis, dim in enumerate(("x", "y")):
                about = {"name": dim, "units": "m", "quantity": "Length", "dimension_type": "spatial"}
                places = downwards(image[dim].values, dim)  # as sidpy counts them, from the top
                data.set_dimension(axis, sidpy.Dimension(places, **about))
            data.original_metadata = {str(key): value for key, value in image.attrs.items()}
            made[f"Channel_{len(made):03d}"] = data
    return made
