"""Errors that phasemap raises, each with the value it met and what is allowed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

LONGEST = 300  # characters of a name or a value that an error repeats
SENTENCE = 2000  # characters of what an error says at all


class PhasemapError(Exception):
    """Base of every error that phasemap raises on purpose."""

    __module__ = "phasemap"

    def __init__(self, said: str = "") -> None:
        super().__init__(said if len(said) <= SENTENCE else f"{said[: SENTENCE // 2]} ... {said[-SENTENCE // 2 :]}")


class Word(str):
    """A value that an error shows without quotes, for it is ours and not the user's: unknown, missing."""

    __slots__ = ()

    def __repr__(self) -> str:
        return str(self)


class InputError(PhasemapError, ValueError):
    """A value outside what is allowed.

    Parameters
    ----------
    name : str
        What was given, in the words of the person who gave it (``"modulus"``, ``"[drive] free_amplitude"``).
    value : object
        The value met.
    allowed : str
        What would have been accepted, with its unit.
    hint : str, optional
        One more sentence: where in the map, the nearest valid name, what to do.
    """

    __module__ = "phasemap"

    def __init__(self, name: str, value: object, allowed: str, hint: str = "") -> None:
        super().__init__(f"{on_one_line(name)} is {_shown(value)}; allowed: {allowed}." + (f" {hint}" if hint else ""))
        self.name, self.value, self.allowed, self.hint = name, value, allowed, hint

    def __reduce__(self) -> tuple[type[InputError], tuple[str, object, str, str]]:
        """Made from its parts again where it comes out of another process."""
        return type(self), (self.name, self.value, self.allowed, self.hint)


class InputErrors(InputError):
    """Several things that are wrong: a sentence in each line, and each in `errors`; the rest is of the first."""

    __module__ = "phasemap._shared.errors"

    def __init__(self, errors: Sequence[PhasemapError]) -> None:
        first = next(error for error in errors if isinstance(error, InputError))
        super().__init__(first.name, first.value, first.allowed, first.hint)
        self.args = ("\n".join(map(str, errors)),)
        self.errors = tuple(errors)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.errors,)


class FileError(PhasemapError, OSError):
    """A file that cannot be read, or a place that cannot be written."""

    __module__ = "phasemap"


class ExistsError(FileError):
    """A file that is there already, and was not to be replaced."""


class TooLargeError(PhasemapError, MemoryError):
    """Something that would not fit into the memory that is free; nothing of it was allocated."""


class SolveError(PhasemapError, RuntimeError):
    """Raised instead of a flagged pixel where the caller asked for ``strict=True``."""

    __module__ = "phasemap"


def _shown(value: object) -> str:
    """A value as an error repeats it: strings in quotes, and nothing without end."""
    try:
        return on_one_line(repr(value) if isinstance(value, str) else str(value))
    except Exception:  # tables in tables in tables, whole numbers of thousands of digits, what others' objects raise
        return f"a {type(value).__name__} too large to be shown"


def on_one_line(text: str, most: int = LONGEST) -> str:
    r"""Return text on one line, its middle left out where it has more letters than that."""
    text = "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in text)
    return text if len(text) <= most else f"{text[: most // 2]} ... {text[-(most // 2) :]}"
