"""Records of named numbers that kernels pass to each other: a state, the nodes of an orbit, scratch memory.

A class whose fields are annotated becomes a record by the decorator `record`:

    @record
    class State:
        amplitude: float  # [m]
        theta: np.ndarray = column(16)  # [rad], at each node

``State()`` in a kernel makes one filled with zeros, on the stack of that kernel: it must not be returned, but is passed
down by its address, so that what is called can change it. numba checks the names of its fields, mypy their types.
In Python ``State()`` is a `numpy.record` with the same fields, which kernels take and change as well.

What is returned, or too large for a stack, lies in an array of words that a named tuple holds; `rows_of` names its
numbers.
"""

from __future__ import annotations

import ctypes
import typing
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from phasemap._kernels.compilation import COMPILES

if COMPILES:
    from phasemap._kernels.compilation import numba_types

T = TypeVar("T")

MOST_BYTES = 1 << 17  # of a record: the stack of a thread has half a megabyte and more
WORD = 8  # bytes of each number


# What Python holds of a record of any kind. Its numba type is registered here once: a module that is imported while
# another thread compiles may add no class to those that numba tells apart, for it is going through them.
InPython: Any = type("InPython", (np.record,), {})
if COMPILES:
    numba_types.declare_in_python(InPython)


def column(count: int) -> Any:
    """Declare a field that has this many numbers."""
    return count


def record(cls: type[T]) -> type[T]:
    """Make a class of annotated fields a record: of float, int, columns of numbers, or other records."""
    fields: dict[str, tuple[Any, int, int]] = {}  # of each its type, first word, and how many there are
    layout: list[tuple[str, Any]] = []
    words = 0
    for name, annotated in typing.get_type_hints(cls).items():
        if hasattr(np.record, name):
            raise TypeError(f"{cls.__name__}.{name}: in Python that is a method of every record")
        count = cls.__dict__.get(name)
        inner = getattr(annotated, "layout", None)
        size = annotated.record_words if inner else count or 1
        fields[name] = annotated if count is None else np.ndarray, words, size
        layout.append((name, inner or ((np.float64, (count,)) if count else annotated)))
        words += size
        if count is not None:
            delattr(cls, name)
    if words * WORD > MOST_BYTES:
        raise TypeError(f"{cls.__name__} takes {words * WORD} bytes, more than a stack may be asked for")
    made: Any = cls
    made.record_fields, made.record_words = fields, words
    own = {"__doc__": cls.__doc__, "__reduce__": lambda one: (_from_bytes, (cls, one.tobytes())), "record_class": cls}
    in_python = type(cls.__name__, (InPython,), own)
    made.layout = np.dtype((in_python, np.dtype(layout)))
    made.__new__ = lambda *_: np.zeros(1, made.layout)[0]
    if COMPILES:
        numba_types.declare_record(cls)
    return cls


def words_of(cls: type) -> int:
    """Number of words [8 bytes] of a record of this class."""
    return int(cls.record_words)  # type: ignore[attr-defined]


def rows_of(cls: type[T], holder: type, field: str) -> Callable[..., T]:
    """Make a function (one, i = 0) that has row i of the array `field` of a named tuple as a record of this class.

    The record is the memory of the array, of words, and valid as long as that is.
    """
    made: Any = cls

    def row(one: Any, i: int = 0) -> T:
        return getattr(one, field).view(made.layout)[i, 0]

    if COMPILES:
        numba_types.declare_rows(row, cls, list(holder.__annotations__).index(field))
    return row


def _from_bytes(cls: Any, content: bytes) -> Any:
    """A record of this class, for pickle: numpy would make a plain one, which kernels do not know."""
    return np.frombuffer(bytearray(content), cls.layout)[0]


def _assign(to: Any, source: Any) -> None:
    """Copy all fields of one record into another of the same class."""
    for name in to.dtype.names:
        to[name] = source[name]


def _clear(one: Any) -> None:
    """Set all fields of a record to zero."""
    for name in one.dtype.names:
        one[name] = np.zeros_like(one[name])


def _numbers_of(one: Any) -> np.ndarray:
    """Numbers of a record of floats in their order, as an array that is its memory."""
    place, _ = one.__array_interface__["data"]
    return np.ctypeslib.as_array((ctypes.c_double * (one.nbytes // WORD)).from_address(place))


assign: Any = numba_types.assign if COMPILES else _assign
clear: Any = numba_types.clear if COMPILES else _clear
numbers_of: Any = numba_types.numbers_of if COMPILES else _numbers_of
