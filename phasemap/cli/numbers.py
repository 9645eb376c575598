"""Numbers of the command line: in SI units, or with a unit."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from phasemap._shared.errors import InputError
from phasemap._shared.quantities import KINDS, NotThatUnit, range_in_si

__all__ = ["number_in", "numbers_in"]


def numbers_in(name: str, text: str, unit: str, allowed: str = "a number in SI units") -> tuple[float, ...]:
    """Read a word of the command line.

    Parameters
    ----------
    name : str
        Of the argument.
    text : str
        A number, or START:STOP:N.
    unit : str
        As in `phasemap._shared.quantities.KINDS`.
    allowed : str
        What may be given, but for units.

    Returns
    -------
    tuple of float
        One number, or START, STOP and N.

    Raises
    ------
    InputError
        If it is something else.

    Examples
    --------
    >>> numbers_in("--tip-offset", "35nm", "m"), numbers_in("--setpoints", "0.3:0.9:7", "1")
    ((3.5e-08,), (0.3, 0.9, 7))
    """
    try:
        return range_in_si(text, unit)
    except NotThatUnit:
        with_one = "" if unit == "1" else f", or with a unit such as {KINDS[unit][1].replace(' ', '')}"
        raise InputError(name, text, allowed + with_one) from None


def number_in(name: str, unit: str) -> Callable[[str], float]:
    """Read one number as an option of argparse.

    Examples
    --------
    >>> number_in("--limit", "m")("100 nm")
    1e-07
    """

    def read(text: str) -> float:
        try:
            (number,) = numbers_in(name, text, unit)
        except ValueError:  # START:STOP:N too
            raise argparse.ArgumentTypeError(f"{text!r} is no number in {unit}") from None
        return number

    return read
