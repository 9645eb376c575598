"""Whether a file is laid out as agreed: dims, coordinates, units and flags."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from phasemap._shared.pixels import centres
from phasemap.results.quantities import CHANNELS
from phasemap.results.variables import FLAGS, FLOATS, all_variables_of
from phasemap.validation.checking.claims import Claims
from phasemap.validation.checking.result import FAILS, HOLDS, Claim

RISING = "position from the top of the image"  # what y is called in earlier images, and only there


def layout(image: xr.Dataset, claims: Claims) -> Claim:
    """Judge the layout; nothing else can be looked at where it fails."""
    wrong = list(_wrong(image, claims))
    found = "; ".join(wrong[:3]) if wrong else f"{len(image.data_vars)} variables"
    pixels = int(np.prod([image.sizes[dim] for dim in _dims(claims) if dim in image.sizes]))
    return Claim("dims, coordinates, units, flags are as agreed", FAILS if wrong else HOLDS, pixels, found)


def _dims(claims: Claims) -> tuple[str, ...]:
    return ("direction", "y", "x") if claims.control.directions else ("y", "x")


def _wrong(image: xr.Dataset, claims: Claims) -> Iterator[str]:
    """Say what is not as agreed."""
    dims, known = _dims(claims), all_variables_of(claims.control)
    sizes = dict(zip(("y", "x"), claims.shape, strict=True), direction=len(claims.control.directions))
    for dim in dims:
        if image.sizes.get(dim) != sizes[dim]:
            yield f"there are {image.sizes.get(dim, 0)} along {dim}, not {sizes[dim]}"
    yield from _wrong_coordinates(image, claims)
    if "status" not in image:
        yield "there is no status"
    for name in map(str, image.data_vars):
        variable = image[name]
        about = FLOATS.get(name) or CHANNELS.get(name)
        if name not in known and name not in CHANNELS:
            yield f"{name} is not a variable of such an image"
        elif variable.dims != dims:
            yield f"{name} has dims {variable.dims}, not {dims}"
        elif name in FLAGS:
            yield from _wrong_flags(name, variable)
        elif variable.dtype.kind != "f" or about is None or not _says(variable, "units", about.units):
            unit = None if about is None else about.units
            yield f"{name} is {variable.dtype} in {variable.attrs.get('units')!r}, not numbers in {unit!r}"


def _wrong_coordinates(image: xr.Dataset, claims: Claims) -> Iterator[str]:
    for dim, count, step in zip(("y", "x"), claims.shape, claims.pixel_size, strict=True):
        if dim not in image.coords:
            yield f"there is no coordinate {dim}"
        elif image.sizes.get(dim) == count and not _near(_from_the_corner(image[dim]), centres(count, step)):
            yield f"{dim} is not at the centres of pixels of {step:g} m"
    names = list(claims.control.directions)
    if names and ("direction" not in image.coords or list(image["direction"].values) != names):
        yield f"direction is not {', '.join(names)}"


def _wrong_flags(name: str, variable: xr.DataArray) -> Iterator[str]:
    _, values, meanings = FLAGS[name]
    said = np.atleast_1d(variable.attrs.get("flag_values", ()))
    if said.tolist() != list(values) or not _says(variable, "flag_meanings", " ".join(meanings)):
        yield f"the flags of {name} have other values or meanings"
    elif variable.dtype.kind not in "iu" or not np.isin(variable.values, values).all():
        yield f"{name} has values that are none of its flags"


def _says(variable: xr.DataArray, name: str, text: str) -> bool:
    """Whether an attribute is this text: it may be an array, too."""
    said = variable.attrs.get(name)
    return isinstance(said, str) and said == text


def _from_the_corner(places: xr.DataArray) -> NDArray[Any]:
    """Places along x or y as they rise from the top left corner."""
    falls = places.dims == ("y",) and not _says(places, "long_name", RISING)
    values: NDArray[Any] = places.values
    return values[::-1] if falls else values


def _near(values: NDArray[Any], wanted: NDArray[np.float64]) -> bool:
    return values.dtype.kind in "fiu" and np.allclose(values, wanted, rtol=1e-9, atol=0)
