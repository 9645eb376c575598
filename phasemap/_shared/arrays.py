"""Arrays that a user gives: taken whatever their type, and kept so that nobody can change them; Dask's stay lazy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.checks import numbers
from phasemap._shared.errors import InputError
from phasemap._shared.memory import check_fits

Array: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int32]

ROUNDING = 1e-12  # relative difference of values that are the same


def as_array(name: str, value: object, allowed: str, dtype: Any = None) -> NDArray[Any]:
    """Array from what the user gave; InputError says what is `allowed`, TooLargeError that memory is short."""
    if isinstance(value, Sequence):
        try:
            check_fits(name, 8.0 * len(value), "Give fewer numbers.")
        except OverflowError:  # a range of more than 2**63
            raise InputError(name, value, allowed) from None
    try:
        return np.asarray(value, dtype)
    except (MemoryError, RecursionError):
        raise
    except Exception:  # ValueError mostly; what other libraries' arrays raise is theirs
        shown = "a list of rows of unequal length" if isinstance(value, (list, tuple)) else f"a {type(value).__name__}"
        raise InputError(name, shown, allowed) from None


def as_list(name: str, value: object, allowed: str) -> list[Any]:
    """Return a value, or several, as a list."""
    return list(np.atleast_1d(as_array(name, value, allowed, object)).tolist())


def real_numbers(name: str, values: object, unit: str) -> Array:
    """Return numbers, with units or in `unit`, as a float64 array of any shape; NaN where they are masked."""
    allowed = f"numbers{f' in {unit}' if unit not in ('', '1') else ''}"
    given = as_array(name, numbers(name, values, unit), allowed)
    if given.dtype.kind not in "fiu":
        raise InputError(name, values, allowed)
    array = given.astype(np.float64)
    if isinstance(values, np.ma.MaskedArray):
        array[np.ma.getmaskarray(values)] = np.nan
    return array


def is_uniform(array: NDArray[Any]) -> bool:
    """True if the array is one number seen everywhere, as `numpy.broadcast_to` makes it."""
    return not any(array.strides)


def is_varied(values: Array, size: float | None = None) -> bool:
    """True if values differ by more than rounding, of what they are differences of: as large as `size`, or themselves.

    `values` (shape (n,)): finite.
    """
    return bool(np.ptp(values) > ROUNDING * (np.abs(values).max() if size is None else size))


def is_frozen(array: object) -> bool:
    """True if nobody can write to the array any more."""
    while isinstance(array, np.ndarray):
        if array.flags.writeable:
            return False
        array = array.base
    return array is None


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Make an array read-only, and return it."""
    array.flags.writeable = False
    return array


def within_half_a_turn(angle: Any, turn: float = 360.0) -> Any:
    """Angle between -1/2 and 1/2 of a turn, which is 360 degrees or as many radians."""
    return (angle + turn / 2) % turn - turn / 2


def is_lazy(value: object) -> bool:
    """True if a value is a Dask array, or a DataArray that holds one."""
    graph = getattr(value, "__dask_graph__", None)
    return graph is not None and graph() is not None


def lazy_map(name: str, value: Any, dtype: type = np.float64) -> Any:
    """Return a Dask array as a map, of numbers that are looked at only when blocks of it are computed."""
    array = value.data if hasattr(value, "dims") else value
    if array.ndim != 2 or not all(side > 0 for side in array.shape):  # NaN where it is not known
        hint = "One number will do too. Call compute_chunk_sizes() where the shape is not known."
        raise InputError(f"shape of {name}", array.shape, "(rows, columns) of a 2-D map", hint)
    if array.dtype.kind not in ("fiu" if dtype is np.float64 else "iub"):
        raise InputError(
            f"type of {name}", array.dtype.name, "real numbers" if dtype is np.float64 else "whole numbers"
        )
    return array.astype(dtype) if dtype is np.float64 else array


def chunks_of(value: Any) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Heights and widths of the blocks of a lazy map."""
    rows, columns = value.chunks
    return rows, columns
