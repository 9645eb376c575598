"""Functions that are another kernel for each kind of their first argument, a named tuple: what a plug-in supplies."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
from numba.core import types
from numba.extending import models, register_model, typeof_impl


class Chosen:
    """A function whose kernels are chosen by the class of the first argument; numba does it as it types a call."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.kernels: dict[type, Any] = {}
        self.__name__, self.__doc__ = function.__name__, function.__doc__

    def of(self, kind: type) -> Callable[[Any], Any]:
        """Make a kernel the one for this class of named tuples."""

        def take(one: Any) -> Any:
            self.kernels[kind] = one
            return one

        return take

    def __call__(self, first: Any, *more: Any) -> Any:
        """As kernels call it."""
        return self.kernels[type(first)](first, *more)


class _ChosenType(types.Callable, types.Dummy):
    """The numba type of such a function."""

    def __init__(self, function: Chosen) -> None:
        self.function = function
        super().__init__(f"chosen({function.__name__}, {id(function)})")

    def _kernel(self, args: Any) -> Any:
        return numba.typeof(self.function.kernels[args[0].instance_class])

    def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
        return self._kernel(args).get_call_type(context, args, kws)

    def get_call_signatures(self) -> tuple[tuple[()], bool]:
        return (), True

    def get_impl_key(self, sig: Any) -> Any:
        return self._kernel(sig.args).get_impl_key(sig)


register_model(_ChosenType)(models.OpaqueModel)
typeof_impl.register(Chosen)(lambda one, _context: _ChosenType(one))
