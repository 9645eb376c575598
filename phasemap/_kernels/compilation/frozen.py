"""Copies of functions and of all that they use, and digests of them.

A formula is compiled from such a copy. It sees nothing but what its digest is of, as that is now: constants, helpers
with their defaults, functions within, what closures hold, and attributes of modules. So two formulas of the same digest
are compiled to the same code, and what changes afterwards changes no formula that was compiled before.
"""

from __future__ import annotations

import builtins
import ctypes
import functools
import hashlib
import sys
import uuid
from types import CellType, CodeType, FunctionType, ModuleType
from typing import Any, NamedTuple

import numpy as np
from numba.core.ccallback import CFunc
from numba.core.compiler import Compiler
from numba.core.dispatcher import Dispatcher
from numba.core.registry import CPUDispatcher, cpu_target
from numba.np.ufunc.dufunc import DUFunc

OPTIONS = {"nopython": True, "error_model": "numpy"}
"""Options of compilation for helpers that are plain functions."""

LIBRARIES = {"builtins", "math", "cmath", "_operator", "operator", "numpy", "numba"}
"""Their functions are known by name: numba has code of its own for them, which its version and numpy's say."""

FIXED = (Dispatcher, DUFunc, np.ufunc, CFunc, ctypes._CFuncPtr, type)  # type: ignore[attr-defined]
"""Types that numba takes as they are and does not compile again: the same in a process while the object is the same."""

PLAIN = {type(None), type(...), bool, int, str, bytes}
NUMBERS = "biufc"  # kinds of numpy's types that are nothing but their bytes


class Frozen(NamedTuple):
    """A copy of a function."""

    function: FunctionType  # with copies of all that it uses
    digest: str  # of the function and all that it uses; empty where that cannot be known
    lasts: bool  # whether the digest means the same in another process


def frozen(function: Any) -> Frozen:
    """Copy a function, be it plain or compiled by numba, as it is now."""
    cpu_target.target_context.refresh()  # so that numba knows all its own
    plain, copy = getattr(function, "py_func", function), _Copy()
    if not isinstance(plain, FunctionType):
        raise TypeError(f"a plain function is needed, not {type(plain).__name__}")
    of, description = copy.function(plain, OPTIONS)
    digest = hashlib.sha256(repr(description).encode("utf-8", "surrogatepass")).hexdigest() if copy.known else ""
    for one in copy.functions():  # code that another process kept must not be linked by the name of another law's
        one.__qualname__ += f".{digest or uuid.uuid4().hex}"
    return Frozen(of.py_func, digest, copy.known and copy.lasts)


class _Copy:
    """A copy in the making; descriptions are tuples of strings, bytes and numbers that read the same everywhere."""

    def __init__(self) -> None:
        # copies of functions and modules, which may use each other; with the originals, for their ids to stay theirs
        self._seen: dict[Any, tuple[Any, int, Any]] = {}
        self.known = self.lasts = True

    def function(self, given: FunctionType, options: dict[str, Any]) -> tuple[Any, Any]:
        """Return a compiler of a copy that is compiled with these options, and its description."""
        key = id(given), id(options)
        if key in self._seen:
            return self._again(key)
        code, names = given.__code__, tuple(dict.fromkeys(_names(given.__code__)))
        defaults, of_defaults = self._value(given.__defaults__, names)
        scope: dict[str, Any] = {"__name__": given.__module__, "__builtins__": builtins}
        cells = tuple(CellType() for _ in code.co_freevars)
        copy = FunctionType(code, scope, given.__name__, defaults, cells)
        copy.__qualname__ = given.__qualname__
        compiler = self._note(key, given, CPUDispatcher(copy, targetoptions=options))
        used: list[Any] = []
        for name in names:
            if name in given.__globals__ or hasattr(builtins, name):
                scope[name], described = self._value(given.__globals__.get(name, getattr(builtins, name, None)), names)
                used.append((name, described))
        for name, cell, held in zip(code.co_freevars, cells, given.__closure__ or (), strict=True):
            cell.cell_contents, described = self._value(held.cell_contents, names)
            used.append((name, described))
        return compiler, ("function", _describe_code(code), of_defaults, used)

    def functions(self) -> list[FunctionType]:
        """Copies of functions."""
        return [copy.py_func for copy, _, _ in self._seen.values() if isinstance(copy, CPUDispatcher)]

    def _value(self, value: Any, names: tuple[str, ...]) -> tuple[Any, Any]:
        """Copy of a value that a function with these names uses, and its description."""
        kind = type(value)
        if kind in PLAIN:
            return value, (kind.__name__, value)
        if kind in (float, complex) or (isinstance(value, np.generic) and value.dtype.kind in NUMBERS):
            return value, (kind.__name__, np.array(value).dtype.str, np.array(value).tobytes())
        if kind is np.ndarray and value.dtype.kind in NUMBERS:
            copy = value.copy(order="K")
            return copy, ("array", copy.dtype.str, copy.shape, copy.strides, hashlib.sha256(copy.tobytes("A")).digest())
        if kind is tuple or (kind.__bases__ == (tuple,) and hasattr(kind, "_fields")):
            parts = [self._value(one, names) for one in value]
            copies = [copy for copy, _ in parts]
            described = kind.__qualname__, getattr(value, "_fields", ()), [one for _, one in parts]
            return (tuple(copies) if kind is tuple else kind._make(copies)), described
        if isinstance(value, ModuleType):
            return self._module(value, names)
        if name := _name_in_library(value):
            return value, ("library", name)
        if kind is FunctionType and not _is_extended(value):
            return self.function(value, OPTIONS)
        if kind is CPUDispatcher and value._can_compile and not value.locals and _is_plain(value.targetoptions):
            if value._compiler.pipeline_class is Compiler:
                compiler, described = self.function(value.py_func, value.targetoptions)
                return compiler, ("compiled", _describe_options(value.targetoptions), described)
        self.lasts = False
        self.known = self.known and isinstance(value, FIXED)
        return value, ("object", id(value))

    def _module(self, module: ModuleType, names: tuple[str, ...]) -> tuple[Any, Any]:
        """A module with no attribute but those that are named; those of libraries stay what they are."""
        key = id(module), names
        if key in self._seen:
            return self._again(key)
        stays = module.__name__.partition(".")[0] in LIBRARIES
        copy = self._note(key, module, module if stays else ModuleType(module.__name__))
        used: list[Any] = []
        for name in names:
            if hasattr(module, name):
                of, described = self._value(given := getattr(module, name), names)
                used.append((name, described))
                if not stays:
                    setattr(copy, name, of)
                elif of is not given:  # what somebody has put there
                    self.known = False
        return copy, ("module", module.__name__, used)

    def _note(self, key: Any, given: Any, copy: Any) -> Any:
        """Remember the copy of a function or module, with the number by which descriptions refer to it."""
        self._seen[key] = copy, len(self._seen), given
        return copy

    def _again(self, key: Any) -> tuple[Any, Any]:
        """Return the copy made before, described by its number: functions may call each other."""
        copy, number, _ = self._seen[key]
        return copy, ("again", number)


def _names(code: CodeType) -> list[str]:
    """Names of variables and attributes in a function and those within."""
    within = [name for one in code.co_consts if isinstance(one, CodeType) for name in _names(one)]
    return [*code.co_names, *within]


def _describe_code(code: CodeType) -> Any:
    """Code of a function, all but where it was written."""
    return (
        code.co_code, code.co_exceptiontable, code.co_flags, code.co_argcount, code.co_posonlyargcount,
        code.co_kwonlyargcount, code.co_varnames, code.co_names, code.co_freevars, code.co_cellvars,
        [_describe_constant(one) for one in code.co_consts],
    )  # fmt: skip


def _describe_constant(value: Any) -> Any:
    """A constant in code, with its type: 1, 1.0 and True are three."""
    if isinstance(value, CodeType):
        return _describe_code(value)
    if isinstance(value, frozenset):
        return "set", sorted(repr(_describe_constant(one)) for one in value)
    if isinstance(value, tuple):
        return "tuple", [_describe_constant(one) for one in value]
    return type(value).__name__, repr(value)


def _is_plain(options: dict[str, Any]) -> bool:
    """True if options of a compilation are words and numbers only."""
    values = [one for value in options.values() for one in (value if isinstance(value, set) else [value])]
    return all(type(one) in PLAIN for one in values)


def _describe_options(options: dict[str, Any]) -> Any:
    """Options of a compilation as text that reads the same in every process, though sets have no order."""
    return [(name, sorted(map(repr, one)) if isinstance(one, set) else repr(one)) for name, one in options.items()]


def _name_in_library(value: Any) -> str:
    """Name of a function or type of a library, as long as numba compiles it by its own code; else empty."""
    module, name = getattr(value, "__module__", None), getattr(value, "__qualname__", None)
    if not (isinstance(module, str) and isinstance(name, str) and module.partition(".")[0] in LIBRARIES):
        return ""
    found = functools.reduce(lambda of, part: getattr(of, part, None), name.split("."), sys.modules.get(module))
    return f"{module}.{name}" if found is value and not _is_extended(value) else ""


def _is_extended(value: Any) -> bool:
    """True if somebody else has told numba how to compile a function, by `numba.extending`."""
    try:
        templates = getattr(cpu_target.typing_context.resolve_value_type(value), "templates", ())
    except ValueError:
        return False
    makers = [getattr(one, "_overload_func", None) or one for one in templates]
    return any((one.__module__ or "abc").partition(".")[0] not in {*LIBRARIES, "abc"} for one in makers)
