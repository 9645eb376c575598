"""What phasemap raises, each with the value it met and what is allowed."""

from __future__ import annotations


class PhasemapError(Exception):
    """Base of every error that phasemap raises on purpose."""


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

    Examples
    --------
    >>> raise InputError("setpoint", 1.2, "a number between 0 and 1, both excluded")
    Traceback (most recent call last):
    ...
    phasemap.errors.InputError: setpoint is 1.2; allowed: a number between 0 and 1, both excluded.
    """

    def __init__(self, name: str, value: object, allowed: str, hint: str = "") -> None:
        shown = repr(value) if isinstance(value, str) else str(value)
        super().__init__(f"{name} is {shown}; allowed: {allowed}." + (f" {hint}" if hint else ""))
        self.name, self.value, self.allowed, self.hint = name, value, allowed, hint

    def __reduce__(self) -> tuple[type[InputError], tuple[str, object, str, str]]:
        """Made from its parts again where it comes out of another process."""
        return type(self), (self.name, self.value, self.allowed, self.hint)


class FileError(PhasemapError, OSError):
    """A file that cannot be read, or a place that cannot be written."""


class SolveError(PhasemapError, RuntimeError):
    """Raised instead of a flagged pixel where the caller asked for ``strict=True``."""
