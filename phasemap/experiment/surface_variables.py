"""The properties of a surface as variables of a Dataset: what they are called, their units, and how these become SI."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.arrays import read_only
from phasemap._shared.dask_arrays import is_lazy
from phasemap._shared.errors import InputError
from phasemap._shared.quantities import NotThatUnit, scaled
from phasemap.experiment.material import ADHESION, MODULUS, THICKNESS, VISCOSITY

if TYPE_CHECKING:
    import xarray as xr

FloatArray = NDArray[np.float64]


class Quantity(NamedTuple):
    """A property of a surface, as a Dataset has it."""

    long_name: str
    unit: str  # as UDUNITS writes it
    bounds: dict[str, float]
    usual: tuple[float, float] = (0.0, math.inf)
    endless: bool = False  # whether infinity is a value


QUANTITIES = {
    "modulus": Quantity("Young's modulus", "Pa", {"minimum": 0}, MODULUS),
    "adhesion": Quantity("work of adhesion", "J m-2", {"minimum": 0}, ADHESION),
    "damping": Quantity("damping coefficient alpha1", "1", {"minimum": 0}),
    "viscosity": Quantity("Kelvin-Voigt viscosity", "Pa s", {"minimum": 0}, VISCOSITY),
    "poisson_ratio": Quantity("Poisson's ratio", "1", {"above": -1, "maximum": 0.5}),
    "thickness": Quantity("thickness of the film on a rigid base", "m", {"above": 0}, THICKNESS, endless=True),
    "topography": Quantity("topography", "m", {}, (0.0, 1e-4)),
}


def maps_of(dataset: xr.Dataset) -> dict[str, Any]:
    """Read the arguments of `phasemap.Surface` from a Dataset that has its properties as variables."""
    names = [str(name) for name in dataset.data_vars]
    for needed in ("modulus", "adhesion"):
        if needed not in dataset.data_vars:
            raise InputError("list of variables in the dataset", names, f"a list that has {needed!r} in it")
    given = {name: variable_in_si(dataset[name], name) for name in QUANTITIES if name in dataset.data_vars}
    sides = coordinate_step(dataset, "y"), coordinate_step(dataset, "x")
    return {**given, "pixel_size": sides, "shape": (dataset.sizes["y"], dataset.sizes["x"])}


def as_variables(maps: Mapping[str, Any], y: FloatArray, x: FloatArray) -> xr.Dataset:
    """Return the maps that are there as variables over the pixel centres `y` and `x` [m]."""
    import xarray as xr

    coords = {
        "y": ("y", y, {"long_name": "position from the top of the image", "units": "m", "axis": "Y"}),
        "x": ("x", x, {"long_name": "position from the left of the image", "units": "m", "axis": "X"}),
    }
    variables = {
        name: (("y", "x"), maps[name], {"long_name": quantity.long_name, "units": quantity.unit})
        for name, quantity in QUANTITIES.items()
        if maps[name] is not None
    }
    dataset = xr.Dataset(variables, coords, {"Conventions": "CF-1.11"})
    for name in ("y", "x"):
        dataset[name].encoding["_FillValue"] = None  # CF allows no missing coordinates
    return dataset


def variable_in_si(variable: xr.DataArray, name: str) -> Any:
    """Return a variable of a Dataset as an array in SI with y before x, or of no dimension; a lazy one stays that."""
    if set(variable.dims) not in ({"y", "x"}, set()):
        raise InputError(f"dims of {name}", variable.dims, "('y', 'x') or none")
    if variable.dims == ("x", "y"):
        variable = variable.transpose("y", "x")
    values = variable.data if is_lazy(variable) else variable.to_numpy()
    if values.dtype.kind not in "fiu":  # which `Surface` refuses
        return values
    found = _scaled(values, variable, name, QUANTITIES[name].unit)
    return found if found is values or is_lazy(found) else read_only(np.asarray(found))


def coordinate_step(dataset: xr.Dataset | xr.DataArray, dim: str) -> float:
    """Return the spacing of a coordinate [m], exact where it is that of `Surface.coords`."""
    if dim not in dataset.coords or dataset[dim].dims != (dim,):
        raise InputError(
            "list of coordinates in the dataset",
            [str(name) for name in dataset.coords],
            f"a list that has {dim!r} in it, the position of the pixel centres in m",
        )
    positions = dataset[dim].to_numpy()
    if positions.dtype.kind not in "fiu" or not positions.size:
        found = f"{positions.size} values of type {positions.dtype.name}"
        raise InputError(f"coordinate {dim}", found, "positions of the pixel centres, numbers in m")
    values = positions.astype(np.float64)
    steps = np.diff(values)
    if steps.size and not (steps > 0).all():
        raise InputError(f"coordinate {dim}", "not increasing", "positions that increase from the image's top left")
    step = 2 * values[0]
    if steps.size and not np.allclose(values, centres(values.size, step), rtol=1e-9, atol=0):
        step = (values[-1] - values[0]) / steps.size
        if not np.allclose(steps, step, rtol=1e-3, atol=0):
            raise InputError(f"spacing of {dim}", f"{steps.min():g} to {steps.max():g}", "the same between all pixels")
    return float(_scaled(step, dataset[dim], f"coordinate {dim}", "m"))


def _scaled(values: Any, variable: xr.DataArray, name: str, unit: str) -> Any:
    """Turn values from the units that a variable says into SI; without any they are in SI."""
    written = str(variable.attrs.get("units") or unit)
    try:
        with np.errstate(over="ignore"):  # what becomes infinite is refused as such
            return scaled(values, "1" if written == "dimensionless" else written, unit)
    except NotThatUnit:
        raise InputError(f"units of {name}", written, f"{unit}, or another unit of the same kind") from None


def centres(count: int, step: float) -> FloatArray:
    """Return the centres of `count` pixels."""
    return (np.arange(count, dtype=np.float64) + 0.5) * step
