"""Kernels where nothing is compiled: functions of the library of a wheel, or of Python."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from phasemap._kernels.compilation.mode import LIBRARY

ANY_ORDER: set[str] = set()


def kernel(function: Any = None, *, light: bool = False, **_how_it_is_compiled: Any) -> Any:
    """Function that Python calls for a kernel; a light one as it is."""
    if function is None:
        return lambda one: kernel(one, light=light)
    return function if light or LIBRARY is None else LIBRARY.kernel(function)


def watch(started: Callable[[], None], ended: Callable[[], None]) -> None:
    """Call nothing, for no compiling starts or ends."""
