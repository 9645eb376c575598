"""Kernels where nothing is compiled: functions of the library of a wheel, or of Python."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from phasemap._kernels import compilation

ANY_ORDER: set[str] = set()


def kernel(function: Any = None, *, light: bool = False, **_how_it_is_compiled: Any) -> Any:
    """The function as Python calls it; what is light it runs as it is."""
    if function is None:
        return lambda one: kernel(one, light=light)
    return function if light or compilation.LIBRARY is None else compilation.LIBRARY.kernel(function)


def watch(started: Callable[[], None], ended: Callable[[], None]) -> None:
    """Call nothing, for no compiling starts or ends."""


def compiled() -> int:
    """How many functions were typed in this process."""
    return 0


def compiled_more_than_once() -> dict[str, int]:
    """Kernels of this process compiled for more sets of argument types than needed."""
    return {}
