"""Arrays that a user gives: taken whatever their type, and kept so that nobody can change them."""

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


def as_array(name: str, value: object, allowed: str, dtype: Any = None) -> NDArray[Any]:
    """Return what the user gave as an array, of whatever type if none is asked for.

    Raises InputError with what is `allowed`, and TooLargeError for a sequence that would not fit into memory.
    """
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
    found = given.astype(np.float64)
    if isinstance(values, np.ma.MaskedArray):
        found[np.ma.getmaskarray(values)] = np.nan
    return found


def is_uniform(array: NDArray[Any]) -> bool:
    """Whether the array is one number seen everywhere, as `numpy.broadcast_to` makes it."""
    return not any(array.strides)


def is_frozen(array: object) -> bool:
    """Whether nobody can write to the array any more."""
    while isinstance(array, np.ndarray):
        if array.flags.writeable:
            return False
        array = array.base
    return array is None


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """The same array, which cannot be written to any more."""
    array.flags.writeable = False
    return array


def within_half_a_turn(angle: Any, turn: float = 360.0) -> Any:
    """The same angle between -1/2 and 1/2 of a turn, which is 360 degrees or as many radians."""
    return (angle + turn / 2) % turn - turn / 2
