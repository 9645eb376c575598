"""The kernels of the page, as the modules of kernels have them; `connect` gives them what calls into WebAssembly."""

from __future__ import annotations

from array import array
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

KINDS = {"float64": "d", "int64": "q", "int8": "b", "bool": "b"}
TYPES = {"float64": np.float64, "int64": np.int64, "int8": np.int8, "bool": np.bool_}
_call: Any = None
_keep: Any = None
_formulas: dict[str, int] = {}
_entries: dict[str, Any] = {}


def connect(call, keep, entries, formulas, missing):
    """Take in JavaScript's functions, what entries take and return, places of formulas, an error.

    `call(name, parts, buffers)` calls an entry, `keep(buffer)` copies numbers to where kernels find them.
    """
    global _call, _keep, _missing
    _call, _keep, _missing = call, keep, missing
    _entries.update(entries)
    _formulas.update(formulas)


def entry(name):
    """A kernel by its name, as Python calls it."""

    def called(*arguments):
        if name not in _entries:
            raise _missing()
        about, parts, arrays = _entries[name], [], []
        for kind, value in zip(about["arguments"], arguments):
            _take_apart(kind, value, parts, arrays)
        given = [packed for _, packed in arrays]
        answer = _call(name, parts, given)
        for one, packed in arrays:
            if one is not None:
                _put_back(one, packed)
        return _made(about["answer"], answer, [one for one, _ in arrays])

    return called


def place_of(formula):
    """Where the compiled formula of a law is."""
    return _formulas[f"{formula.__module__}.{formula.__qualname__}"]


def kept(numbers):
    """The address of a copy of an array, which stays."""
    return _keep(array(KINDS[numbers.dtype.name], numbers._list()))


def table(shape):
    """The table of numbers that kernels take."""
    packed = array("d")
    packed.frombytes((Path(__file__).parent / "tables.bin").read_bytes())
    return np.ndarray(packed, np.float64, shape)


class Row:
    """A row of words of an array, by the names of a record's fields."""

    def __init__(self, words, fields):
        self._words, self._fields = words, fields

    def __getattr__(self, name):
        return self._words[self._fields[name]]


def rows_of(field, fields):
    """What gives the first row of an array of a named tuple."""
    return lambda one: Row(getattr(one, field)._list(), fields)


class Record:
    """Memory of a record of so many words."""

    def __init__(self, words):
        self.memory = array("q", bytes(8 * words))


def _take_apart(kind, value, parts, arrays):
    """Numbers, and arrays by their shapes and bytes, in the order in which they are passed."""
    if isinstance(kind, str):
        parts.append([kind, value if kind == "float64" else int(value)])
    elif "array" in kind:
        one = np.asarray(value)
        packed = (
            one.data
            if isinstance(one.data, array) and one.size == len(one.data) and one._contiguous()
            else array(KINDS[kind["array"]], one._list())
        )
        parts.append([kind["array"], list(one.shape), len(arrays)])
        arrays.append((one, packed))
    elif "record" in kind:
        parts.append(["record", [], len(arrays)])
        arrays.append((None, value.memory))
    else:
        for part, one in zip(kind.get("fields") or kind["items"], value):
            _take_apart(part, one, parts, arrays)


def _put_back(one, packed):
    """Put what the kernel changed into an array."""
    if one.data is packed:
        return
    if one._contiguous():
        one.data[one.offset : one.offset + one.size] = packed if isinstance(one.data, array) else packed.tolist()
    else:
        one[...] = np.ndarray(packed.tolist(), one.dtype, one.shape)


def _made(kind, value, given):
    """An answer as Python has it; an array that was given is the same one."""
    if kind == "none":
        return None
    if isinstance(kind, str):
        return value
    if "array" in kind:
        if value["given"] >= 0:
            return given[value["given"]]
        packed = array(KINDS[kind["array"]])
        packed.frombytes(bytes(value["bytes"]))
        return np.ndarray(packed, TYPES[kind["array"]], value["shape"])
    parts = [_made(part, one, given) for part, one in zip(kind.get("fields") or kind["items"], value)]
    if "class" not in kind:
        return tuple(parts)
    module, _, name = kind["class"].rpartition(".")
    return getattr(import_module(module), name)(*parts)
