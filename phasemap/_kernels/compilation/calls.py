"""How kernels call each other: arguments as they are, and errors handed on as they come.

numba takes every array and tuple apart for a call and puts it together again behind it: an orbit and a law are a
hundred values, and half of the code of a kernel was nothing else. LLVM passes a structure as well as its parts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from numba.core import cgutils, types
from numba.core.callconv import RETCODE_OK, CPUCallConv
from numba.core.imputils import impl_ret_new_ref


class _Whole:
    """The arguments of a function, each as one value."""

    def __init__(self, models: Any, kinds: Sequence[types.Type]) -> None:
        self._models = [models.lookup(kind) for kind in kinds]
        self._parts = [model.get_argument_type() for model in self._models]

    @property
    def argument_types(self) -> tuple[Any, ...]:
        """LLVM types of the arguments."""
        return tuple(
            model.get_value_type() if isinstance(part, tuple) else part
            for model, part in zip(self._models, self._parts, strict=True)
            if part != ()
        )

    def as_arguments(self, builder: Any, values: Sequence[Any]) -> list[Any]:
        """Values in the form in which a call passes them."""
        return [
            value if isinstance(part, tuple) else model.as_argument(builder, value)
            for model, part, value in zip(self._models, self._parts, values, strict=True)
            if part != ()
        ]

    def from_arguments(self, builder: Any, arguments: Sequence[Any]) -> list[Any]:
        """Values from what was passed."""
        passed = iter(arguments)
        return [
            model.from_argument(builder, ()) if part == () else
            next(passed) if isinstance(part, tuple) else
            model.from_argument(builder, next(passed))
            for model, part in zip(self._models, self._parts, strict=True)
        ]  # fmt: skip

    def assign_names(self, *_: Any) -> None:
        """Names of arguments are for people."""


class WholeCalls(CPUCallConv):
    """A convention of calls from kernel to kernel."""

    def _get_arg_packer(self, kinds: Sequence[types.Type]) -> _Whole:
        return _Whole(self.context.data_model_manager, kinds)

    def declare(self, module: Any, function: Any) -> Any:
        """The function in a module."""
        kind = self.get_function_type(function.restype, function.argtypes)
        found = cgutils.get_or_insert_function(module, kind, function.mangled_name)
        self.decorate_function(found, function.args, function.argtypes)
        if function.inline:
            found.attributes.add("alwaysinline")
        return found


def called(function: Any, libraries: Sequence[Any]) -> Callable[..., Any]:
    """How numba makes a call of a kernel, given its description."""

    def make(context: Any, builder: Any, _signature: Any, values: Sequence[Any]) -> Any:
        calls = WholeCalls(context)
        result = cgutils.alloca_once(builder, calls.get_return_type(function.restype).pointee)
        arguments = calls._get_arg_packer(function.argtypes).as_arguments(builder, values)
        error = calls._get_excinfo_argument(builder.function)
        code = builder.call(calls.declare(builder.module, function), [result, error, *arguments])
        with cgutils.if_unlikely(builder, builder.icmp_unsigned("!=", code, RETCODE_OK)):
            builder.ret(code)
        value = context.get_returned_value(builder, function.restype, builder.load(result))
        return impl_ret_new_ref(context, builder, function.restype, value)

    make.signature = function.argtypes  # type: ignore[attr-defined]
    make.libs = tuple(libraries)  # type: ignore[attr-defined]
    return make
