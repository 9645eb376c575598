"""Arrays that a user gives: taken whatever their type, and kept so that nobody can change them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.errors import InputError


def as_array(name: str, value: object, allowed: str) -> NDArray[Any]:
    """Return what the user gave as an array of whatever type."""
    try:
        return np.asarray(value)
    except (MemoryError, RecursionError):
        raise
    except Exception:  # ValueError mostly; what other libraries' arrays raise is theirs
        raise InputError(name, "a list of rows of unequal length", allowed) from None


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
