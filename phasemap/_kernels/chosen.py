"""Functions that are another kernel for each kind of their first argument, a named tuple: what a plug-in supplies."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from phasemap._kernels.compilation import COMPILES


class Chosen:
    """A function whose kernels are chosen by the class of the first argument; numba does it as it types a call."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.kernels: dict[type, Any] = {}
        self.__name__, self.__doc__ = function.__name__, function.__doc__

    def of(self, kind: type) -> Callable[[Any], Any]:
        """Make a function the kernel for this class of named tuples."""

        def register(one: Any) -> Any:
            self.kernels[kind] = one
            return one

        return register

    def __call__(self, first: Any, *more: Any) -> Any:
        """Kernel of the first argument's class, called as kernels call it."""
        return self.kernels[type(first)](first, *more)


if COMPILES:
    from phasemap._kernels.compilation.numba_types import declare_chosen

    declare_chosen(Chosen)
