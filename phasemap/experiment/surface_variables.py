"""The properties of a surface as variables of a Dataset: what they are called, their units, and how these become SI."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.dask_arrays import is_lazy
from phasemap._shared.errors import InputError

if TYPE_CHECKING:
    import xarray as xr

FloatArray = NDArray[np.float64]


class Quantity(NamedTuple):
    """A property of a surface, as a Dataset has it."""

    long_name: str
    unit: str  # as UDUNITS writes it
    spellings: tuple[str, ...]  # of the unit without a prefix, spaces and signs of multiplication dropped
    bounds: dict[str, float]


QUANTITIES = {
    "modulus": Quantity("Young's modulus", "Pa", ("Pa", "N/m2", "Nm-2"), {"minimum": 0}),
    "adhesion": Quantity("work of adhesion", "J m-2", ("J/m2", "Jm-2", "N/m", "Nm-1"), {"minimum": 0}),
    "damping": Quantity("damping coefficient alpha1", "1", (), {"minimum": 0}),
    "viscosity": Quantity("Kelvin-Voigt viscosity", "Pa s", ("Pas", "Ns/m2", "Nsm-2"), {"minimum": 0}),
    "poisson_ratio": Quantity("Poisson's ratio", "1", (), {"above": -1, "maximum": 0.5}),
    "topography": Quantity("topography", "m", ("m", "meter", "metre"), {}),
}
_SPELLING = str.maketrans({" ": "", ".": "", "*": "", "^": "", "·": "", "²": "2", "⁻": "-", "µ": "u", "μ": "u"})
_POSITION = Quantity("position", "m", QUANTITIES["topography"].spellings, {})
_PREFIXES = {"": 0, "T": 12, "G": 9, "M": 6, "k": 3, "m": -3, "u": -6, "n": -9, "p": -12}


def variable_in_si(variable: xr.DataArray, name: str) -> Any:
    """Return a variable of a Dataset as an array in SI with y before x, or of no dimension; a lazy one stays that."""
    if set(variable.dims) not in ({"y", "x"}, set()):
        raise InputError(f"dims of {name}", variable.dims, "('y', 'x') or none")
    if variable.dims == ("x", "y"):
        variable = variable.transpose("y", "x")
    exponent = _exponent(variable, name, QUANTITIES[name])
    if is_lazy(variable):
        return variable.data if exponent == 0 else _scaled(variable.data.astype(np.float64), exponent)
    values: FloatArray = variable.to_numpy()
    if exponent == 0 or values.dtype.kind not in "fiu":  # which `Surface` refuses
        return values
    return _frozen(np.asarray(_scaled(values.astype(np.float64), exponent)))


def coordinate_step(dataset: xr.Dataset, dim: str) -> float:
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
    return float(_scaled(step, _exponent(dataset[dim], f"coordinate {dim}", _POSITION)))


def _exponent(variable: xr.DataArray, name: str, quantity: Quantity) -> int:
    """Return the power of ten that turns the units attribute of `variable` into SI; 0 where there is none."""
    unit = str(variable.attrs.get("units", quantity.unit))
    if unit in {quantity.unit, ""} or (quantity.unit == "1" and unit == "dimensionless"):
        return 0
    written = unit.translate(_SPELLING)
    for prefix, exponent in _PREFIXES.items():
        if written.startswith(prefix) and written[len(prefix) :] in quantity.spellings:
            return exponent
    allowed = "1" if quantity.unit == "1" else f"{quantity.unit}, or that with a prefix such as G, M, k, m, u or n"
    raise InputError(f"units of {name}", unit, allowed)


def _scaled(value: Any, exponent: int) -> Any:
    """Multiply by a power of ten, rounded once."""
    with np.errstate(over="ignore"):  # what becomes infinite is refused as such
        return value * 10.0**exponent if exponent >= 0 else value / 10.0**-exponent


def centres(count: int, step: float) -> FloatArray:
    """Return the centres of `count` pixels."""
    return (np.arange(count, dtype=np.float64) + 0.5) * step


def _frozen(array: NDArray[Any]) -> NDArray[Any]:
    array.flags.writeable = False
    return array
