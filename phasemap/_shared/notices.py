"""Words to the person who called: warnings that point at their line of code."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

T = TypeVar("T")

_TOLD_OTHERWISE: ContextVar[bool] = ContextVar("phasemap_told_otherwise", default=False)


class ResultWarning(UserWarning):
    """Numbers that must not be taken as they look: pixels without a solution, or beyond the model; files' defaults.

    Examples
    --------
    >>> import warnings
    >>> import phasemap as pm
    >>> scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip("10 nm"), pm.Drive("20 nm"))
    >>> surface = pm.Surface([[1e9, float("nan")]], pixel_size="4 nm", allow_nan=True)
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     image = pm.simulate(surface, scope, setpoint=0.7)
    >>> str(caught[0].message)[:61]
    '1 of 2 pixels (50 %): The material has a property that is not'
    """

    __module__ = "phasemap"


def tell(lines: Iterable[str]) -> None:
    """Warn of results, a line each."""
    if not _TOLD_OTHERWISE.get():
        for line in lines:
            warnings.warn(line, ResultWarning, stacklevel=outside())


@contextmanager
def temporarily(variable: ContextVar[T], value: T) -> Iterator[None]:
    """Let a variable of the context have a value within a ``with`` block."""
    token = variable.set(value)
    try:
        yield
    finally:
        variable.reset(token)


@contextmanager
def untold() -> Iterator[None]:
    """Give no such warnings: who asked is told in another way."""
    with temporarily(_TOLD_OTHERWISE, True):
        yield


def outside() -> int:
    """How far up the line of code is that is not ours, as `warnings.warn` counts for who calls this."""
    level, frame = 1, sys._getframe(1)
    while frame.f_back is not None and (frame.f_globals.get("__name__") or "").partition(".")[0] == "phasemap":
        level, frame = level + 1, frame.f_back
    return level
