"""Words to the person who called: warnings of results, and of numbers outside all practice.

A lever of 300,000 N/m is not an error of the model, so a number that nobody has measured warns by name, with what is
usual and the unit that was probably meant. With `strict_units` it is an error.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

from phasemap._shared.errors import InputError, Word
from phasemap._shared.units import PREFIXES, UDUNITS, WRITTEN, say

T = TypeVar("T")

_TOLD_OTHERWISE: ContextVar[bool] = ContextVar("phasemap_told_otherwise", default=False)


class ResultWarning(UserWarning):
    """Numbers that must not be taken as they look: pixels without a solution, or beyond the model; files' defaults."""

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
    """Number of calls up to the first line that is not phasemap's own, as `warnings.warn` counts them."""
    level, frame = 1, sys._getframe(1)
    while frame.f_back is not None and (frame.f_globals.get("__name__") or "").partition(".")[0] == "phasemap":
        level, frame = level + 1, frame.f_back
    return level


Usual = tuple[float, float]

LIKELY = {
    "m": (1e-9, 1e-6, 1e-12), "Pa": (1e9, 1e6, 1e3), "Hz": (1e3, 1e6), "J m-2": (1e-3,), "Pa s": (1e-3,),
    "V": (1e-3,), "s": (1e-6, 1e-3), "m/sqrt(Hz)": (1e-15, 1e-12),
}  # fmt: skip
"""The prefixes that a unit usually has, the most usual first."""
TYPED = (1e-2, 1e6)  # the numbers that people type where they think of a unit with a prefix
ROUNDING = 1e-9

_MANNER: ContextVar[str] = ContextVar("phasemap_plausibility", default="warn")

_GATHERED: ContextVar[list[str] | None] = ContextVar("phasemap_plausibility_gathered", default=None)
_TOLD: ContextVar[set[str] | None] = ContextVar("phasemap_plausibility_told", default=None)


class PlausibilityWarning(UserWarning):
    """A number that is outside all practice of the field, which is mostly a unit that was forgotten."""

    __module__ = "phasemap"


@contextmanager
def strict_units() -> Iterator[None]:
    """Make numbers outside all practice an error instead of a warning.

    Examples
    --------
    >>> import phasemap as pm
    >>> with pm.strict_units():
    ...     pm.Material(3)
    Traceback (most recent call last):
    ...
    phasemap.InputError: modulus is 3 Pa; allowed: the usual 100 Pa … 2 TPa. Did you mean 3 GPa?
    """
    with temporarily(_MANNER, "raise"):
        yield


@contextmanager
def once() -> Iterator[None]:
    """Say a name only once, whatever numbers it has: in a command, or in an ensemble with many of them."""
    with temporarily(_TOLD, set()):
        yield


@contextmanager
def unquestioned() -> Iterator[None]:
    """Take any number without a word: it is ours, or it was looked at already."""
    with temporarily(_MANNER, "pass"):
        yield


@contextmanager
def gathered() -> Iterator[list[str]]:
    """Collect warnings of numbers outside all practice in a list, for callers that give them in another way."""
    kept: list[str] = []
    with temporarily(_GATHERED, kept), temporarily(_MANNER, "gather"):
        yield kept


def question(name: str, value: float, unit: str, usual: Usual) -> None:
    """Warn of a number, or of the size of a negative one, outside all practice [unit]; zero switches something off."""
    low, high = usual
    size, manner = abs(value), _MANNER.get()
    if manner == "pass" or size == 0 or size != size or low * (1 - ROUNDING) <= size <= high * (1 + ROUNDING):
        return
    told = _TOLD.get()
    if manner == "warn" and told is not None:
        if name in told:
            return
        told.add(name)
    units = UDUNITS.get(unit, unit)
    text = WRITTEN.get(units, units)
    given = f"{value:g} {text}".rstrip()
    range_ = f"usual {f'{say(low, units)} … ' if low else 'up to '}{say(high, units)}"
    meant = likely(value, unit, usual)
    if manner == "raise":
        raise InputError(name, Word(given), f"the {range_}", f"Did you mean {meant}?" if meant else "")
    message = f"{name} = {given}; {range_}" + (f"; did you mean {meant}?" if meant else ".")
    if (kept := _GATHERED.get()) is not None:
        kept.append(message)
        return
    warnings.warn(message, PlausibilityWarning, stacklevel=outside())


def advise(sentence: str) -> None:
    """Warn, once where `once` holds, of what is allowed and seldom meant; never an error."""
    told = _TOLD.get()
    if _MANNER.get() == "pass" or (told is not None and sentence in told):
        return
    if told is not None:
        told.add(sentence)
    warnings.warn(sentence, UserWarning, stacklevel=outside())


def likely(value: float, unit: str, usual: Usual) -> str:
    """Number with a unit that was likely meant by a number outside all practice; empty where none is likely."""
    units, (low, high) = UDUNITS.get(unit, unit), usual
    prefixes = LIKELY.get(units, ()) if TYPED[0] <= abs(value) < TYPED[1] else ()
    meant = next((one for one in prefixes if low <= abs(value) * one <= high), None)
    return f"{value:g} {PREFIXES[meant]}{WRITTEN.get(units, units)}" if meant else ""
