"""The properties of a surface as variables of a Dataset: what they are called, their units, and how these become SI."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from phasemap._shared.arrays import Array, read_only
from phasemap._shared.dask_arrays import is_lazy
from phasemap._shared.errors import InputError
from phasemap._shared.pixels import coordinate_step, coordinates, in_si_of
from phasemap.experiment.material import ADHESION, LIQUID, MODULUS, RELAXATION, THICKNESS, VISCOSITY
from phasemap.experiment.prony import Prony, spectrum_of

if TYPE_CHECKING:
    import xarray as xr


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
    "relaxed_modulus": Quantity("Young's modulus after relaxation", "Pa", {"above": 0}, MODULUS),
    "relaxation_time": Quantity("relaxation time", "s", {"above": 0}, RELAXATION, endless=True),
    "liquid_film": Quantity("thickness of the liquid film", "m", {"minimum": 0}, LIQUID, endless=True),
    "contact_angle": Quantity("contact angle of the liquid", "degree", {"minimum": 0, "maximum": 180}, endless=True),
    "relaxation": Quantity("relaxation spectrum, by its key", "1", {"minimum": 0}, endless=True),
    "topography": Quantity("topography", "m", {}, (0.0, 1e-4)),
}


def maps_of(dataset: xr.Dataset) -> dict[str, Any]:
    """Read the arguments of `phasemap.Surface` from a Dataset that has its properties as variables."""
    names = [str(name) for name in dataset.data_vars]
    for needed in ("modulus", "adhesion"):
        if needed not in dataset.data_vars:
            raise InputError("list of variables in the dataset", names, f"a list that has {needed!r} in it")
    given = {name: variable_in_si(dataset[name], name) for name in QUANTITIES if name in dataset.data_vars}
    if "relaxation" in given:
        for one in json.loads(dataset["relaxation"].attrs.get("spectra", "[]")):
            Prony(**one).key  # noqa: B018  it is known by its key from here on
    sides = coordinate_step(dataset, "y"), coordinate_step(dataset, "x")
    return {**given, "pixel_size": sides, "shape": (dataset.sizes["y"], dataset.sizes["x"])}


def as_variables(maps: Mapping[str, Any], y: Array, x: Array) -> xr.Dataset:
    """Return the maps that are there as variables over the pixel centres `y` and `x` [m]."""
    import xarray as xr

    variables = {
        name: (("y", "x"), maps[name], {"long_name": quantity.long_name, "units": quantity.unit})
        for name, quantity in QUANTITIES.items()
        if maps[name] is not None
    }
    if "relaxation" in variables:
        keys = [key for key in np.unique(maps["relaxation"]) if np.isfinite(key)]
        variables["relaxation"][2]["spectra"] = json.dumps([spectrum_of(key).arguments for key in keys])
    dataset = xr.Dataset(variables, coordinates(y, x), {"Conventions": "CF-1.11"})
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
    found = in_si_of(values, variable, name, QUANTITIES[name].unit)
    return found if found is values or is_lazy(found) else read_only(np.asarray(found))
