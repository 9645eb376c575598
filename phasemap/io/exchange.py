"""Images as Datasets of sidpy, the form in which pycroscopy and the digital twins of DTMicroscope have them.

sidpy comes with ``pip install "afm-phasemap[sidpy]"``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from phasemap._shared.asked import asked_as
from phasemap._shared.errors import InputError, Word
from phasemap._shared.pixels import coordinates, downwards
from phasemap.io.gwyddion import extra
from phasemap.io.kinds import KINDS, METRES

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
        about = {"long_name": KINDS[kind].long_name, "units": _unit(kind, str(found[kind, directions[0]][0].units))[1]}
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
    factor, _ = _unit(kind, str(channel.units))
    values = np.asarray(channel.compute(), float) * factor
    shape = (len(wanted[1]), len(wanted[0]))
    if values.shape != shape or not all(np.allclose(a, b, rtol=SAME_STEP) for a, b in zip(places, wanted, strict=True)):
        raise InputError(f"pixels of {channel.quantity}", values.shape, f"those of the other channels, {shape}")
    return values.T


def _kind(called: str) -> str:
    """The variable that a channel of this name is, "" if it is none."""
    return next((kind for kind, about in KINDS.items() if about.pattern.match(called.strip())), "")


def _unit(kind: str, written: str) -> tuple[float, str]:
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
