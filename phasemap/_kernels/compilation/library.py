"""Kernels that a wheel brings, compiled ahead in shared libraries whose functions are called by address.

`FOLDER` has a library for each level of processors, and `INDEX` with what `tools/wheel/ahead.py` knows of it: of each
function that Python calls its symbol, what it takes and what it returns, and the symbols of formulas of contact laws.
So nothing is compiled, and numba is not imported, but for a law of one's own.
"""

from __future__ import annotations

import ctypes
import json
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

FOLDER = Path(__file__).parents[1] / "ahead"
INDEX = "index.json"
MODULES = f"{__name__.partition('.')[0]}._kernels."
C_TYPES = {"float64": ctypes.c_double, "int64": ctypes.c_int64, "bool": ctypes.c_bool}


def best_library() -> Library | None:
    """The best library that this processor can run; None where there is none."""
    try:
        index = json.loads((FOLDER / INDEX).read_text())
    except OSError:
        return None
    has = _features()
    level = next((one for one in index["levels"] if all(has.get(need) for need in one["needs"])), None)
    return Library(FOLDER / level["file"], index) if level else None


def _features() -> dict[str, bool]:
    """Instruction sets of this processor, by numpy's names."""
    return dict(import_module("numpy._core._multiarray_umath").__cpu_features__)


class Library:
    """The functions of a shared library.

    Parameters
    ----------
    path : Path
    index : dict
        "entries": of each function that Python calls, by its module and name, "symbol", "arguments" and "answer" for
        each kind of arguments; "formulas": symbols by the names of formulas.
    """

    def __init__(self, path: Path, index: dict[str, Any]) -> None:
        self._code, self._index = ctypes.CDLL(str(path)), index

    def kernel(self, function: Any) -> Any:
        """A function as Python calls it: that of the library, or as it is where Python never calls it."""
        about = self._index["entries"].get(f"{function.__module__.removeprefix(MODULES)}.{function.__qualname__}")
        return function if about is None else Called(function, self._code, about)

    def symbol_of(self, formula: Callable[..., Any]) -> str | None:
        """Symbol of a formula; None if the library does not have it."""
        found: str | None = self._index["formulas"].get(f"{formula.__module__}.{formula.__qualname__}")
        return found

    def address_of(self, formula: Callable[..., Any]) -> int:
        """Address of a formula that the library has."""
        return ctypes.cast(getattr(self._code, str(self.symbol_of(formula))), ctypes.c_void_p).value or 0


class Called:
    """A kernel that is called in the library.

    Parameters
    ----------
    function : callable
        As Python has it.
    code : ctypes.CDLL
    about : list of dict
        What `Library` is told of the function, for each kind of arguments.
    """

    def __init__(self, function: Any, code: ctypes.CDLL, about: list[dict[str, Any]]) -> None:
        self.py_func = function
        self.__name__, self.__module__, self.__doc__ = function.__name__, function.__module__, function.__doc__
        self._code, self._about = code, about
        self._versions: list[_Version] = []

    def __call__(self, *arguments: Any) -> Any:
        """Call it."""
        if not self._versions:  # once all of phasemap can be imported
            self._versions = [_Version(self._code, **one) for one in self._about]
        first, *others = self._versions
        version = next((one for one in others if one.fits(arguments)), first) if others else first
        return version.call(arguments)


class _Version:
    """A function for one kind of arguments: numbers by value, arrays and records by address, as numba passes them."""

    def __init__(self, code: ctypes.CDLL, symbol: str, arguments: list[Any], answer: Any) -> None:
        """Numba's signature: the place of the answer, that of an error, then the arguments."""
        self._kinds, self._symbol = arguments, symbol
        self._pack = [_packer(kind) for kind in arguments]
        self._answer = type("Answer", (ctypes.Structure,), {"_fields_": [("value", _layout(answer))]})
        # An array that is returned holds a reference to its memory, which is given back once it is copied.
        self._unpack = _unpacker(answer, code.NRT_MemInfo_call_dtor)
        self._function = code[symbol]
        passed = (one for kind in arguments for one in _passed(kind))
        self._function.argtypes = [ctypes.c_void_p, ctypes.c_void_p, *passed]

    def fits(self, arguments: Sequence[Any]) -> bool:
        """True if this version is for such arguments."""
        return all(map(_is_of, self._kinds, arguments))

    def call(self, arguments: Sequence[Any]) -> Any:
        """Call it; arrays that are not contiguous are copied, and what was changed is copied back."""
        numbers: list[Any] = []
        arrays: list[tuple[np.ndarray, np.ndarray]] = []  # each as it was given, and as it is passed
        for pack, argument in zip(self._pack, arguments, strict=True):
            pack(argument, numbers, arrays)
        answer, error = self._answer(), ctypes.c_void_p()
        code = self._function(ctypes.addressof(answer), ctypes.addressof(error), *numbers)
        if code:
            raise RuntimeError(f"{self._symbol} fails with code {code}")
        for given, passed in arrays:
            if given is not passed:
                given[...] = passed
        return self._unpack(answer.value, arrays)


def _is_of(kind: Any, value: Any) -> bool:
    """True if an argument is of a kind, as far as named tuples tell."""
    if isinstance(kind, str) or "class" not in kind:
        return True
    return kind["class"] == f"{type(value).__module__}.{type(value).__qualname__}" and all(
        map(_is_of, kind["fields"], value)
    )


def _parts(kind: Any) -> Sequence[Any] | None:
    """Kinds of the members of a tuple; None of anything else."""
    return None if isinstance(kind, str) else kind.get("fields", kind.get("items"))


class _Complex(ctypes.Structure):
    """A complex number, which is passed as two."""

    _fields_: ClassVar = [("real", ctypes.c_double), ("imag", ctypes.c_double)]


def _passed(kind: Any) -> list[Any]:
    """Types of the numbers that are passed for an argument."""
    if (parts := _parts(kind)) is not None:
        return [one for part in parts for one in _passed(part)]
    if kind == "complex128":
        return [ctypes.c_double] * 2
    if kind == "generator":
        return [ctypes.c_void_p] * 9
    if isinstance(kind, str):
        return [C_TYPES[kind]]
    words = 5 + 2 * kind["dimensions"] if "array" in kind else 1
    return [ctypes.c_int64] * words


def _packer(kind: Any) -> Callable[[Any, list[Any], list[Any]], None]:
    """Function that adds the numbers that are passed for an argument."""
    if (parts := _parts(kind)) is not None:
        packers = [_packer(part) for part in parts]

        def pack_tuple(value: Any, numbers: list[Any], arrays: list[Any]) -> None:
            for pack, member in zip(packers, value, strict=True):
                pack(member, numbers, arrays)

        return pack_tuple
    if kind == "complex128":
        return lambda value, numbers, _: numbers.extend((value.real, value.imag))
    if kind == "generator":
        return lambda value, numbers, _: numbers.extend(_random_numbers(value))
    if isinstance(kind, str):
        return lambda value, numbers, _: numbers.append(value)
    if "record" in kind:
        return lambda value, numbers, _: numbers.append(_address(value))
    of, dimensions = np.dtype(kind["array"]), kind["dimensions"]

    def pack_array(value: Any, numbers: list[Any], arrays: list[Any]) -> None:
        if value.dtype != of or value.ndim != dimensions:
            raise TypeError(f"an array of {of} with {dimensions} dimensions is needed, not {value.dtype} {value.shape}")
        passed = value if value.flags.c_contiguous else np.ascontiguousarray(value)
        arrays.append((value, passed))
        # Of numba's structure: who counts references and who owns it, neither; size, bytes of an element, the data.
        numbers += (0, 0, value.size, of.itemsize, _address(passed), *passed.shape, *passed.strides)

    return pack_array


def _random_numbers(generator: np.random.Generator) -> tuple[Any, ...]:
    """Fields of numba's record of a random generator: functions that draw, their state, and no owner."""
    state = generator.bit_generator.ctypes
    draws = (ctypes.cast(one, ctypes.c_void_p) for one in (state.next_uint64, state.next_uint32, state.next_double))
    return (None, state.state_address, state.state, *draws, state.bit_generator, None, None)


def _address(value: Any) -> int:
    """Address of the first element of an array or record."""
    return int(value.__array_interface__["data"][0])


def _layout(kind: Any) -> Any:
    """An answer as C lays it out."""
    if kind in ("none", "complex128"):
        return ctypes.c_void_p if kind == "none" else _Complex
    if isinstance(kind, str):
        return C_TYPES[kind]
    if (parts := _parts(kind)) is not None:
        fields = [(f"f{i}", _layout(part)) for i, part in enumerate(parts)]
    else:
        shape = ctypes.c_int64 * kind["dimensions"]
        names = ("counted", "owner", "size", "bytes", "data")
        fields = [*((name, ctypes.c_int64) for name in names), ("shape", shape), ("strides", shape)]
    return type("Parts", (ctypes.Structure,), {"_fields_": fields})


def _unpacker(kind: Any, release: Any) -> Callable[[Any, list[Any]], Any]:
    """Function that makes an answer as Python has it: an array that was given stays that one, a new one is copied."""
    if kind == "none":
        return lambda _value, _arrays: None
    if kind == "complex128":
        return lambda value, _: complex(value.real, value.imag)
    if isinstance(kind, str):
        return lambda value, _: value
    if (parts := _parts(kind)) is not None:
        unpackers = [_unpacker(part, release) for part in parts]
        module, _, name = kind.get("class", "").rpartition(".")
        make = getattr(import_module(module), name) if module else lambda *members: members

        def unpack_tuple(value: Any, arrays: list[Any]) -> Any:
            return make(*(unpack(getattr(value, f"f{i}"), arrays) for i, unpack in enumerate(unpackers)))

        return unpack_tuple
    of = np.dtype(kind["array"])
    release.argtypes, release.restype = [ctypes.c_int64], None

    def unpack_array(value: Any, arrays: list[Any]) -> np.ndarray:
        shape = tuple(value.shape)
        for given, passed in arrays:
            if value.data == _address(passed) and shape == passed.shape:
                return given
        content = ctypes.string_at(value.data, value.size * of.itemsize) if value.size else b""
        if value.counted:
            release(value.counted)
        return np.frombuffer(bytearray(content), of).reshape(shape)

    return unpack_array
