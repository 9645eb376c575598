"""Compilation of kernels: each function once, and only what Python calls is optimised and kept on disk.

numba optimises every compiled function by itself, and again inside each function that calls it, through chains of calls
that are up to 14 deep. Here a function that other kernels call is typed and lowered once and kept as LLVM code; what
Python calls, an entry, is linked with the code of all that it reaches, optimised as a whole and emitted. Nothing in an
entry can be called from another one, so its bits do not depend on what else was compiled or loaded before.

What is large and reached by several entries is shared: emitted once, as an entry is, and called by its name, which is
the same in every process and defined before what calls it is loaded.

Entries and what they share are kept on disk under a digest of all kernel sources: no number can outlive the source of a
kernel, however deep in the chain of calls.
"""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from llvmlite.binding import add_symbol
from numba.core import event, sigutils, types
from numba.core.base import OverloadSelector
from numba.core.bytecode import FunctionIdentity
from numba.core.compiler import CompileResult
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher, cpu_target

from phasemap._kernels.compilation.disk_cache import DiskCache
from phasemap._kernels.compilation.first_use import FirstUse
from phasemap._kernels.compilation.lean import LeanCompiler
from phasemap._kernels.compilation.linked_code import EntryCode, LinkedCode, VectorCode, called

OPTIONS: dict[str, Any] = {"nopython": True, "nogil": True, "error_model": "numpy", "fastmath": {"contract"}}
"""Products and sums may be fused; nothing else is relaxed, for NaN must survive."""


class Names(set[str]):
    """A set that reads the same in every process, for numba makes it a part of the names that code is linked by."""

    def __repr__(self) -> str:
        return "{" + ", ".join(map(repr, sorted(self))) + "}"

    def copy(self) -> Names:
        """Copy with the same members."""
        return Names(self)


ANY_ORDER: set[str] = Names({"contract", "reassoc", "nsz"})
"""`fastmath` of a kernel whose sums may be taken in any order, so in vectors."""


def kernel(
    function: Any = None,
    *,
    fastmath: set[str] | None = None,
    inline: bool = False,
    shared: bool = False,
    vectors: bool = False,
    light: bool = False,
) -> Any:
    """Compile a function of numbers and arrays when it is first called, from Python or from another kernel.

    Parameters
    ----------
    function : callable
    fastmath : set of str, optional
        In place of {"contract"}.
    inline : bool
        Whether LLVM must inline every call.
    shared : bool
        Whether it is emitted once and called where it is: for what is large and reached by several entries.
    vectors : bool
        Whether what is shared has short sums written out, or short loops, that fit vector instructions.
    light : bool
        Whether Python runs it as it is: for what is done faster than it is compiled.
    """
    if function is None:
        return lambda one: kernel(one, fastmath=fastmath, inline=inline, shared=shared, vectors=vectors, light=light)
    options = {**OPTIONS, "forceinline": inline, **({} if fastmath is None else {"fastmath": fastmath})}
    return (_Light if light else _Entry)(function, _compiler_of(shared, vectors), options)


def _plain_type(argument: types.Type) -> types.Type:
    """Type of an argument without its literal value: numba has a type of its own for each literal number."""
    argument = types.unliteral(argument)
    return types.int64 if isinstance(argument, types.Integer) and argument.signed else argument


class _Plain(CPUDispatcher):
    """numba's dispatcher but for types of literals and the cache."""

    def __init__(self, py_func: Any, locals: Any = None, targetoptions: Any = None, **more: Any) -> None:
        super().__init__(py_func, locals or {}, targetoptions, **more)  # numba 0.61 takes no None
        self._cache = DiskCache(py_func)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Template of a call from another kernel."""
        _, args = self._compiler.fold_argument_types(args, kws)
        return super().get_call_template(tuple(_plain_type(one) for one in args), {})


class _Entry(_Plain):
    """A function as Python calls it, and as other kernels do."""

    def __init__(self, py_func: Any, compiler: type[_OurCompiler], options: dict[str, Any]) -> None:
        super().__init__(py_func, targetoptions=options, pipeline_class=_EntryCompiler)
        shared = issubclass(compiler, _SharedCompiler)
        self.linked = (_Shared if shared else _Linked)(py_func, compiler, options)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Template of a call from another kernel."""
        return self.linked.get_call_template(args, kws)

    def get_overload(self, sig: Any) -> Any:
        """The code that another kernel calls."""
        return self.linked.get_overload(sig)


class _Light(_Entry):
    """A function that Python runs as it is, and other kernels link."""

    def __call__(self, *arguments: Any) -> Any:
        return self.py_func(*arguments)


class _Shared(_Plain):
    """A function that is emitted once for all kernels that call it, and kept on disk."""

    def __init__(self, py_func: Any, compiler: type[_OurCompiler], options: dict[str, Any]) -> None:
        super().__init__(py_func, targetoptions=options, pipeline_class=compiler)
        self._cache = DiskCache(py_func, ".shared")

    def add_overload(self, cres: CompileResult) -> None:
        """Make the address of its code known to what is emitted or loaded from now on."""
        super().add_overload(cres)
        _make_known(self.targetctx, cres)
        name = cres.fndesc.llvm_func_name
        add_symbol(name, cres.library.get_pointer_to_function(name))
        cres.library.needed = _Needed(self.py_func.__module__, self.py_func.__name__, cres.signature.args)
        if self._cache_hits[cres.signature.args]:  # found on disk, with all that it calls
            _count(1 + len(_waiting(self.py_func)))


@dataclass(frozen=True)
class _Needed:
    """Shared function that code on disk calls: it is loaded, or compiled, before that code is loaded.

    Its module is imported by then, for the function that Python calls names it.
    """

    module: str
    name: str
    arguments: tuple[types.Type, ...]

    def __call__(self) -> None:
        """Have its address known."""
        getattr(sys.modules[self.module], self.name).linked.compile(self.arguments)


class _Linked(_Plain):
    """A function as other kernels link it."""

    def __init__(self, py_func: Any, compiler: type[_OurCompiler], options: dict[str, Any]) -> None:
        super().__init__(py_func, targetoptions=options, pipeline_class=compiler)

    def compile(self, sig: Any) -> Any:
        """Type and lower it for arguments; returns what numba knows the code by."""
        with global_compiler_lock:
            args, return_type = sigutils.normalize_signature(sig)
            if args not in self.overloads:
                with self._compiling_counter:
                    result = self._compiler.compile(args, return_type)
                result = result._replace(entry_point=_Name(f"{self.py_func.__module__}.{self.py_func.__qualname__}"))
                _make_known(self.targetctx, result)
                self.overloads[args] = result
            return self.overloads[args].entry_point


def _make_known(context: Any, result: CompileResult) -> None:
    """Register compiled code, so that kernels can call it."""
    make = called(result.fndesc, [result.library])
    context._defns[result.entry_point] = known = OverloadSelector()
    known.append(make, result.fndesc.argtypes)


class _Name(str):
    """The name of a function's code: another one for each set of arguments."""

    __slots__ = ()
    __hash__ = object.__hash__

    def __eq__(self, other: object) -> bool:
        return self is other


class _OurCompiler(LeanCompiler):
    """numba's compiler, with a library of our own."""

    library: Any

    def compile_extra(self, func: Any) -> CompileResult:
        """Compile a function."""
        name = FunctionIdentity.from_function(func).func_qualname
        cpu_target.target_context.refresh()  # numba's own functions: they are registered when it is first asked
        self.state.library = self.library(self.state.targetctx.codegen(), name)
        self.state.library.enable_object_caching()
        self.state.flags.no_cfunc_wrapper = True
        result = super().compile_extra(func)
        return result._replace(reload_init=[*self.state.library.needs])


class _EntryCompiler(_OurCompiler):
    """Compiles the kernels that Python calls."""

    library = EntryCode
    first_use: FirstUse | None = None  # what is going on; numba compiles one function at a time

    def compile_extra(self, func: Any) -> CompileResult:
        """Compile a function, and say so."""
        with FirstUse(len(_waiting(func))) as _EntryCompiler.first_use:
            # The many small objects of a compiler are collected in vain: a tenth of the time.
            collects = gc.isenabled()
            gc.disable()
            try:
                return super().compile_extra(func)
            finally:
                _EntryCompiler.first_use = None
                if collects:
                    gc.enable()


class _SharedCompiler(_OurCompiler):
    """Compiles the kernels that several entries call, under a name that is the same in every process."""

    library = EntryCode

    def compile_extra(self, func: Any) -> CompileResult:
        """Compile a shared kernel: its name has no counter, so that every process finds it; a tuple is one argument."""
        self.state.targetctx.numbered, self.state.targetctx.whole = False, True
        self.state.flags.no_cpython_wrapper = True
        result = super().compile_extra(func)
        _count(1)
        return result


class _VectorCompiler(_SharedCompiler):
    """Compiles shared kernels with more vector instructions."""

    library = VectorCode


class _LinkedCompiler(_OurCompiler):
    """Compiles the kernels that other kernels call, up to LLVM code."""

    library = LinkedCode

    def compile_extra(self, func: Any) -> CompileResult:
        """Type and lower a function."""
        self.state.flags.no_cpython_wrapper = self.state.flags.no_compile = True
        self.state.targetctx.whole = True
        result = super().compile_extra(func)
        _count(1)
        return result


def _compiler_of(shared: bool, vectors: bool) -> type[_OurCompiler]:
    """Compiler class of the code that other kernels call, by its options."""
    return (_VectorCompiler if vectors else _SharedCompiler) if shared else _LinkedCompiler


def _count(functions: int) -> None:
    """Count functions as compiled, for the progress of an entry."""
    if _EntryCompiler.first_use is not None:
        _EntryCompiler.first_use.done += functions


def _waiting(function: Any) -> list[_Entry]:
    """The kernels that a function needs and that are not there yet."""
    return [one for one in _kernels_of(function) if not one.linked.overloads]


def _kernels_of(function: Any) -> list[_Entry]:
    """Kernels that a function calls, and those that they call."""
    kernels: dict[_Entry, None] = {}
    open_ = [function]
    while open_:
        caller = open_.pop()
        for name in caller.__code__.co_names:
            other = caller.__globals__.get(name)
            if isinstance(other, _Entry) and other not in kernels:
                kernels[other] = None
                open_.append(other.py_func)
    return list(kernels)


def _all_kernels() -> list[_Entry]:
    """The kernels that this process has imported."""
    return [one for one in gc.get_objects() if isinstance(one, _Entry)]


def watch(started: Callable[[], None], ended: Callable[[], None]) -> None:
    """Call these functions whenever a compilation starts or ends, in its thread; those within it too."""

    class Watching(event.Listener):
        def on_start(self, _event: object) -> None:
            started()

        def on_end(self, _event: object) -> None:
            ended()

    event.register("numba:compile", Watching())


def compiled() -> int:
    """Number of functions typed in this process, as entries or to be linked."""
    return sum(
        len(one.linked.overloads) - sum(one.linked._cache_hits.values()) + sum(one._cache_misses.values())
        for one in _all_kernels()
    )
