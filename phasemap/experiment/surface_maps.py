"""Maps of a surface: their names, their units and how these become SI, and which go together."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasemap._shared.arrays import Array, as_array, is_frozen, is_lazy, is_uniform, lazy_map, read_only
from phasemap._shared.checks import number, pixel_pair, range_in_words, shape_pair
from phasemap._shared.errors import InputError, Word
from phasemap._shared.memory import check_fits
from phasemap._shared.notices import question
from phasemap._shared.pixels import coordinate_step, coordinates, in_si_of
from phasemap._shared.quantities import NotThatUnit, array_in_si, with_unit
from phasemap._shared.units import say
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
        for spectrum in json.loads(dataset["relaxation"].attrs.get("spectra", "[]")):
            Prony(**spectrum).key  # noqa: B018  it is known by its key from here on
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
    converted = in_si_of(values, variable, name, QUANTITIES[name].unit)
    return converted if converted is values or is_lazy(converted) else read_only(np.asarray(converted))


PIXEL = (0.01e-9, 10e-6)  # m, of pixels in practice
SAME_STEP = 1e-3  # relative; coordinates may be in single precision
_NO_BOUNDS = (("minimum", -math.inf), ("above", -math.inf), ("maximum", math.inf))


def property_map(name: str, value: Any, allow_nan: bool) -> Any:
    """Map that a surface keeps, from what the user gave; None stays None."""
    converted = _in_si(name, value)
    if converted is None:
        return None
    return lazy_map(name, converted) if is_lazy(converted) else _as_map(name, converted, allow_nan)


def _in_si(name: str, value: Any) -> Any:
    """Numbers and maps with units, or a DataArray that says its units and dims, as plain numbers in SI."""
    if hasattr(value, "data_vars"):
        raise InputError(name, Word("a Dataset"), "one number or a 2-D map, such as one of its variables")
    if hasattr(value, "dims") and hasattr(value, "coords"):
        for dim in value.coords.keys() & {"y", "x"} & set(value.dims):
            coordinate_step(value, dim)  # refuses what is not even
        return variable_in_si(value, name)
    unit = QUANTITIES[name].unit
    try:
        return array_in_si(value, unit)
    except NotThatUnit:
        shown = value if isinstance(value, str) else "with another unit"
        raise InputError(name, shown, f"one number or a 2-D map, in {unit} or each {with_unit(unit)}") from None


def _as_map(name: str, value: ArrayLike, allow_nan: bool) -> Array:
    """Return `value`, checked, as a read-only float64 array: 0-d, or a map whose strides are 0 if it is uniform."""
    quantity = QUANTITIES[name]
    if isinstance(value, np.ma.MaskedArray):
        value = _unmasked(name, value)
    given = as_array(name, value, "one number or a 2-D map")
    if given.ndim == 0 and quantity.endless and given == math.inf:
        return read_only(np.array(math.inf))
    if given.ndim == 0:
        checked = number(name, given.item(), quantity.unit, **quantity.bounds)
        question(name, checked, quantity.unit, quantity.usual)
        return read_only(np.array(checked))
    if given.ndim != 2 or not given.size:
        raise InputError(f"shape of {name}", given.shape, "(rows, columns) of a 2-D map", "One number will do too.")
    if given.dtype.kind not in "fiu":
        raise InputError(f"type of {name}", given.dtype.name, "real numbers")
    if not is_uniform(given):
        check_room(name, given, 8)
    full = (given[:1, :1] if is_uniform(given) else given).astype(np.float64, order="C", copy=False)
    if full is given and not is_frozen(full):
        full = full.copy()
    low, high = full.min(), full.max()  # NaN if there is one
    if not (_inside(low, quantity) and _inside(high, quantity)):
        bad = ~_inside(full, quantity)
        if allow_nan:
            bad &= ~np.isnan(full)
        if bad.any():
            _raise_for_pixel(name, full, bad)
    ends = (low, high) if low <= high else (np.fmin.reduce(full, None), np.fmax.reduce(full, None))
    if math.isfinite(most := float(max(ends, key=abs))):
        question(name, most, quantity.unit, quantity.usual)
    bits = full.view(np.int64)
    if not low < high and (bits == bits[0, 0]).all():
        return np.broadcast_to(read_only(np.array(full[0, 0])), given.shape)
    return read_only(full)


def _unmasked(name: str, value: np.ma.MaskedArray[Any, Any]) -> NDArray[Any]:
    """Return a masked array with NaN where it is masked."""
    if value.dtype.kind not in "fiu":
        raise InputError(f"type of {name}", value.dtype.name, "real numbers")
    check_room(name, value, 8)
    return np.asarray(np.ma.filled(value.astype(np.float64), np.nan))


def check_room(name: str, given: NDArray[Any], per_pixel: int) -> None:
    """Refuse a map that would not fit into memory; one that numpy repeats (`broadcast_to`) may be of any size."""
    ny, nx = given.shape[-2:] if given.ndim > 1 else (1, given.size)
    check_fits(f"{name} with {ny} x {nx} pixels", float(given.size) * per_pixel, "Take fewer pixels, or one number.")


def _inside(value: Any, quantity: Quantity) -> Any:
    """True where `value` is finite and within the bounds, or the infinity that may stand for none."""
    least, above, most = (quantity.bounds.get(name, limit) for name, limit in _NO_BOUNDS)
    inside = np.isfinite(value) & (value >= least) & (value > above) & (value <= most)
    return inside | (value == math.inf) if quantity.endless else inside


def _raise_for_pixel(name: str, full: Array, bad: NDArray[np.bool_]) -> None:
    """Raise `InputError` for the first bad pixel and say how many are like it, NaN or out of bounds."""
    quantity = QUANTITIES[name]
    value = full.reshape(-1)[bad.argmax()]
    hint = where(bad & (np.isnan(full) == math.isnan(value)))
    if math.isnan(value):
        left = ", or give allow_nan=True (in a scene allow_nan = true) to leave it without a material."
        hint += f" Fill it from its neighbours{'.' if name == 'topography' else left}"
    raise InputError(name, value, range_in_words(quantity.unit, **quantity.bounds), hint)


def where(bad: NDArray[np.bool_]) -> str:
    """Say where the first bad pixel is and how many there are."""
    row, col = divmod(int(bad.argmax()), bad.shape[1])
    count = int(bad.sum())
    return f"It is at row {row}, column {col}" + (f"; {count} such pixels." if count > 1 else ".")


def common_shape(maps: dict[str, Array], shape: Sequence[int] | None) -> tuple[int, int]:
    """Return the one shape that `shape` and all maps have."""
    first, agreed = "", (0, 0)
    if shape is not None:
        first, agreed = "the one asked for", shape_pair(shape)
    for name, array in maps.items():
        if array.ndim and not first:
            first, agreed = f"that of {name}", (array.shape[0], array.shape[1])
        elif array.ndim and array.shape != agreed:
            raise InputError(f"shape of {name}", array.shape, f"{agreed}, {first}")
    if not first:
        raise InputError("shape", None, "(rows, columns), where no map is given")
    return agreed


def check_spacing(maps: dict[str, Any], sides: tuple[float, float]) -> None:
    """Refuse a DataArray whose coordinates say another size of its pixels."""
    for name, value in maps.items():
        for dim, side in zip(("y", "x"), sides, strict=True):
            if dim not in getattr(value, "coords", ()) or value.sizes.get(dim, 1) < 2:
                continue
            step = coordinate_step(value, dim)
            if not math.isclose(step, side, rel_tol=SAME_STEP):
                allowed = f"{say(step, 'm')}, the spacing of {dim} in {name}"
                hint = f"Without that coordinate any size is taken: drop_vars({dim!r})."
                raise InputError("pixel_size", f"{side:g}", allowed, hint)


def pixel_sides(value: object) -> tuple[float, float]:
    """The (dy, dx) of a pixel [m]."""
    dy, dx = pixel_pair(value)
    for side in {dy, dx}:
        question("pixel_size", side, "m", PIXEL)
    return dy, dx


def check_relaxing(maps: dict[str, Any]) -> None:
    """Refuse maps that are not of standard linear solids; of Dask arrays `phasemap.simulate` does that."""
    if "relaxation" in maps:
        _check_spectra(maps)
    given = [name for name in ("relaxed_modulus", "relaxation_time") if name in maps]
    if not given:
        return
    if len(given) < 2:
        missing = "relaxation_time" if given[0] == "relaxed_modulus" else "relaxed_modulus"
        raise InputError(missing, None, f"a number or a map, given together with {given[0]}")
    if any(is_lazy(one) for one in maps.values()):
        return
    above = np.atleast_2d(maps["relaxed_modulus"] > maps["modulus"])
    if above.any():
        most = float(np.max(maps["relaxed_modulus"]))
        raise InputError("relaxed_modulus", most, "at most modulus, that of a sudden touch", where(above))
    if any(bool(np.any(maps[name] > 0)) for name in ("damping", "viscosity") if name in maps):
        allowed = "relaxation, or damping or viscosity, not both on one surface"
        hint = "Give the others viscosity = 0, or a relaxation time too: a preset takes viscosity = 0 beside it."
        raise InputError("relaxation_time", Word("given beside a damping or viscosity"), allowed, hint)


def _check_spectra(maps: dict[str, Any]) -> None:
    """Refuse maps beside spectra of relaxation that do not go together with them."""
    if any(is_lazy(one) for one in maps.values()):
        raise InputError("relaxation", Word("in Dask arrays"), "maps in memory where materials have spectra")
    keys, modulus = np.broadcast_arrays(maps["relaxation"], maps["modulus"])
    for key in np.unique(keys[np.isfinite(keys)]):
        first, moduli = spectrum_of(key).instantaneous, modulus[keys == key]
        other = moduli[~np.isclose(moduli, first, rtol=1e-9, atol=0) & ~np.isnan(moduli)]
        if len(other):
            raise InputError("modulus", float(other[0]), f"that of the spectrum, {first:g} Pa, where there is one")
    if any(bool(np.any(maps[name] > 0)) for name in ("damping", "viscosity") if name in maps):
        raise InputError("relaxation", Word("given beside a damping or viscosity"), "one kind of loss on a surface")
