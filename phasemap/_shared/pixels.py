"""Places of the pixels of an image: row 0 is the top, and y falls from row to row, as in every raster file.

Images of earlier versions, and of others, may have a y that rises; row 0 is the top of these too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from phasemap._shared.arrays import Array
from phasemap._shared.errors import InputError, Word
from phasemap._shared.quantities import NotThatUnit, scaled

if TYPE_CHECKING:
    import xarray as xr


LONG_NAMES = {"y": "y from the bottom edge", "x": "x from the left edge"}  # short: xarray labels axes by them


def centres(count: int, step: float) -> Array:
    """Return the centres of `count` pixels from the corner where they begin to count."""
    return (np.arange(count, dtype=np.float64) + 0.5) * step


def coordinates(y: Array, x: Array) -> dict[str, Any]:
    """Return places of pixels [m] as the coordinates of a Dataset."""
    return {
        dim: (dim, places, {"long_name": LONG_NAMES[dim], "units": "m", "axis": dim.upper()})
        for dim, places in {"y": y, "x": x}.items()
    }


def downwards(places: Array, dim: str) -> Array:
    """Return places along y or x so that they rise from the top left corner, as y of an image may not."""
    return places[::-1] if dim == "y" and len(places) > 1 and places[0] > places[-1] else places


def coordinate_step(dataset: xr.Dataset | xr.DataArray, dim: str) -> float:
    """Return the spacing of a coordinate [m], exact where it is that of `Surface.coords`."""
    if dim not in dataset.coords or dataset[dim].dims != (dim,):
        allowed = f"a list that has {dim!r} in it, the position of the pixel centres in m"
        raise InputError("list of coordinates in the dataset", [str(name) for name in dataset.coords], allowed)
    positions = dataset[dim].to_numpy()
    if positions.dtype.kind not in "fiu" or not positions.size:
        given = f"{positions.size} values of type {positions.dtype.name}"
        raise InputError(f"coordinate {dim}", given, "positions of the pixel centres, numbers in m")
    values = downwards(positions.astype(np.float64), dim)
    steps = np.diff(values)
    if steps.size and not (steps > 0).all():
        way = "falls or rises from the top of the image" if dim == "y" else "rises from the left of the image"
        given = Word("not monotonic" if dim == "y" else "not increasing")
        raise InputError(f"coordinate {dim}", given, f"one that {way}")
    step = 2 * values[0]
    if steps.size and not np.allclose(values, centres(values.size, step), rtol=1e-9, atol=0):
        step = (values[-1] - values[0]) / steps.size
        if not np.allclose(steps, step, rtol=1e-3, atol=0):
            raise InputError(f"spacing of {dim}", f"{steps.min():g} to {steps.max():g}", "the same between all pixels")
    return float(in_si_of(step, dataset[dim], f"coordinate {dim}", "m"))


def in_si_of(values: Any, variable: xr.DataArray, name: str, unit: str) -> Any:
    """Turn values from the units that a variable says into SI; without any they are in SI."""
    written = str(variable.attrs.get("units") or unit)
    try:
        with np.errstate(over="ignore"):  # what becomes infinite is refused as such
            return scaled(values, "1" if written == "dimensionless" else written, unit)
    except NotThatUnit:
        raise InputError(f"units of {name}", written, f"{unit}, or another unit of the same kind") from None
