"""What words of the command line stand for: numbers in SI units or with a unit, lists of them, files of labels."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from phasemap._shared.errors import InputError
from phasemap._shared.quantities import KINDS, NotThatUnit, range_in_si

if TYPE_CHECKING:
    import numpy as np

LABELS = ("labels", "label")  # maps of regions, as files call them


def numbers_in(name: str, text: str, unit: str, allowed: str = "a number in SI units") -> tuple[float, ...]:
    """Read one number, or START, STOP and N, of the command line; `allowed` is what may be given, but for units."""
    try:
        return range_in_si(text, unit)
    except NotThatUnit:
        with_one = "" if unit == "1" else f", or with a unit such as {KINDS[unit][1].replace(' ', '')}"
        raise InputError(name, text, allowed + with_one) from None


def one_each(name: str, text: str | None, unit: str, count: int, each: str, words: Sequence[str] = ()) -> Any:
    """Read as many numbers as there are images or files, or one for all of them; `name` is the argument's in Python."""
    if text is None or text in words:
        return text
    option = f"--{name.replace('_', '-')}"
    allowed = f"a number, or {count} with commas between them, one {each}"
    found = [number for part in text.split(",") for number in numbers_in(option, part, unit, allowed)]
    if len(found) not in (1, count):
        raise InputError(option, text, allowed)
    return found * (count // len(found))


def labels_in(path: str) -> np.ndarray:
    """Read the map of regions of a netCDF file, shape (rows, columns)."""
    import numpy as np

    from phasemap.io.netcdf import load

    maps = load(path)
    name = next((name for name in LABELS if name in maps), None)
    if name is None:
        held = ", ".join(map(str, maps.data_vars))
        raise InputError(f"what {path} holds", held, f"a map {' or '.join(LABELS)}, as phasemap scene writes it")
    return np.asarray(maps[name].values)


def number_in(name: str, unit: str) -> Callable[[str], float]:
    """Read one number as an option of argparse."""

    def read(text: str) -> float:
        try:
            (number,) = numbers_in(name, text, unit)
        except ValueError:  # START:STOP:N too
            raise argparse.ArgumentTypeError(f"{text!r} is no number in {unit}") from None
        return number

    return read
