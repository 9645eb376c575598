"""Quantities of a curve by the names of its columns: quantity, way and unit, of text and of Igor waves."""

from __future__ import annotations

import codecs
import gzip
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from phasemap._shared.errors import FileError, InputError
from phasemap.io.gwyddion import extra
from phasemap.io.metadata import KINDS, METRES, ScanData
from phasemap.io.vendors import scan_data

DIRECTIONS = ("approach", "retract")
WAYS = {
    "approach": re.compile(r"\b(?:approach|extend|ext|trace|forward)\b", re.IGNORECASE),
    "retract": re.compile(r"\b(?:retract|withdraw(?:al)?|ret|retrace|backward)\b", re.IGNORECASE),
}
NAMES = {
    "distance": (re.compile(r"z\b|z[ -]?(?:piezo|sensor)|zsnsr|raw|distance|height|piezo|tip.?offset", re.I), METRES),
    "amplitude": (re.compile("(?:lock-?in[ _-]?)?amp(?!.*error)", re.I), KINDS["amplitude"].units),
    "phase": (re.compile("(?:lock-?in[ _-]?)?(?:phase|lag)", re.I), KINDS["phase"].units),
    "deflection": (re.compile("v?defl", re.I), KINDS["amplitude"].units),
}
"""Names of the columns of a quantity, and its units."""
COLUMN = re.compile(r"\s*(?P<name>.*?)\s*(?:[\[(](?P<unit>[^\])]*)[\])])?\s*")
UNITS = {"", "-", *(unit for _, units in NAMES.values() for unit in units)}
MARKS = ("\t", ";", ",", r"\s{2,}", r"\s+(?![\[(])")  # between names; a single space, where no unit in brackets follows
EXAMPLE = (
    "columns=('distance [m]', None, 'amplitude [V]', 'phase [degree]'), or in a command "
    "--columns 'distance [m],-,amplitude [V],phase [degree]'"
)
OF_IMAGES = "An image goes to `phasemap scene` (simulated alike), `explore` (beside one) or `series` (of several)."
TEXT = (".txt", ".csv", ".tsv", ".dat", ".asc")
FEWEST = 20  # points of a curve


class Column(NamedTuple):
    """Quantity, direction and unit of a column."""

    quantity: str
    direction: str | None  # "approach" or "retract"; None where both stand one below the other
    factor: float  # to `unit`
    unit: str
    lag: bool  # whether the name says that it is a lag


Parts = dict[tuple[str, str | None], tuple[np.ndarray, str]]  # values and unit by quantity and direction


def quantity_of(name: str) -> str | None:
    """The quantity that a column or channel of this name holds; None where it is none of a curve."""
    return next((one for one, (called, _) in NAMES.items() if called.match(name)), None)


def of_text(path: Path, columns: Sequence[str | None] | None, number: int) -> Parts:
    """The columns of a text."""
    lines = [line.strip() for line in _text(path).splitlines() if line.strip()]
    first = next((i for i, line in enumerate(lines) if _numbers(line)), len(lines))
    wide = len(_numbers(lines[first])) if first < len(lines) else 0
    rows = [row for row in map(_numbers, lines[first:]) if len(row) == wide]
    if len(rows) < FEWEST:
        raise FileError(f"cannot use {path}: it has {len(rows)} rows of numbers; a curve has {FEWEST} at least.")
    names = list(columns) if columns is not None else _heading(lines[:first], wide)
    if not names or wide % len(names):
        raise FileError(
            f"cannot use {path}: it has {wide} columns and names of {len(names)}; say what they are, such as {EXAMPLE}."
        )
    if number >= wide // len(names):
        raise InputError("number", number, f"0 to {wide // len(names) - 1}, the curves of {path.name}")
    table = np.array(rows)[:, number * len(names) : (number + 1) * len(names)]
    table = table[: 1 + int(np.flatnonzero(table.any(axis=1)).max(initial=0))]
    given = columns is not None
    return _parts([_column(name, given) for name in names], table)


def _numbers(line: str) -> list[float]:
    """The numbers of a line; none if one of its words is not a number."""
    line = line.strip(" ,;")
    if re.search(r"[\s;]", line) and not re.search(r",(?!\d)|(?<!\d),", line):
        line = line.replace(",", ".")  # between digits only, and something else between words
    try:
        return [float(word) for word in re.split(r"[\s;,]+", line)]
    except ValueError:
        return []


def _text(path: Path) -> str:
    """The text of a file in any of the encodings that instruments write."""
    try:
        with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as file:
            content = file.read()
        if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            return content.decode("utf-16")
        if b"\0" in content:
            raise UnicodeError("bytes of no text")
        try:
            return content.decode("utf-8-sig")
        except UnicodeError:
            return content.decode("latin-1")
    except (OSError, UnicodeError, EOFError) as error:
        raise FileError(
            f"cannot read {path}: it is no text. Curves are read from .ibw, .jpk-force, NanoScope, netCDF, or columns "
            f"of text: export the curve from the instrument's program as text (ASCII). {OF_IMAGES}"
        ) from error


def _heading(lines: Sequence[str], wide: int) -> list[str]:
    """The names that the lines above the numbers give to so many columns, with their units."""
    plain = [line.lstrip("#% ") for line in lines]
    exported = {key: line.partition(":")[2].split() for line in plain for key in ("columns", "units")
            if line.lower().startswith(f"{key}:")}  # fmt: skip
    if len(exported) == 2:  # as JPK's program exports curves
        return [f"{name} [{unit}]" for name, unit in zip(exported["columns"], exported["units"], strict=False)]
    above = [_words(line, wide) for line in plain[-2:]]
    units = [one.strip("[]()") for one in above[-1]] if len(above) == 2 else []
    if any(units) and len(units) == len(above[0]) and UNITS.issuperset(units):
        return [f"{name} [{unit}]" for name, unit in zip(above[0], units, strict=True)]
    return above[-1] if above else []


def _words(line: str, wide: int) -> list[str]:
    """The names in a line, by the mark that makes names of so many columns, or of an equal part of them."""
    ways = [[word.strip() for word in re.split(mark, line)] for mark in MARKS]
    return next((words for words in ways if wide % len(words) == 0 and len(words) > 1), ways[0])


def _column(name: str | None, given: bool) -> Column | None:
    """Column of this name, None if it is not used; `given`: the name comes from the user, not from the file."""
    match = COLUMN.fullmatch(name or "")
    if not name or match is None:
        return None
    quantity = quantity_of(match["name"])
    if quantity is None:
        if given:
            raise InputError("columns", name, f"{', '.join(NAMES)} with a unit, such as {EXAMPLE}, or None")
        return None
    units = NAMES[quantity][1]
    unit = (match["unit"] or "").strip()
    if unit not in units:
        raise InputError(f"unit of the column {name!r}", unit or None, "one of " + ", ".join(units))
    way = next((one for one, pattern in WAYS.items() if pattern.search(match["name"])), None)
    return Column(quantity, way, *units[unit], "lag" in match["name"].lower())


def _parts(columns: Sequence[Column | None], table: np.ndarray) -> Parts:
    """Values of each quantity and direction, the first column of several; a lag counts the other way."""
    parts: Parts = {}
    for column, values in zip(columns, table.T, strict=True):
        if column is not None:
            unit = "lag" if column.lag else column.unit
            parts.setdefault((column.quantity, column.direction), (values * column.factor, unit))
    return parts


def of_wave(path: Path) -> tuple[Parts, ScanData]:
    """Columns of an Igor wave, named by its labels, and settings of its note; all is in SI units and degrees."""
    igor = extra("igor2.binarywave", "reading curves of Igor", "read")
    try:
        wave = igor.load(str(path))["wave"]
        table = np.asarray(wave["wData"], float)
        labels = [one.decode("latin-1") for one in wave["labels"][1][1:]]
        note = dict(line.split(":", 1) for line in wave["note"].decode("latin-1").splitlines() if ":" in line)
    except Exception as error:  # of whatever is met in a damaged file
        raise FileError(f"cannot read {path}: it is damaged, or no wave of Igor.") from error
    if table.ndim != 2 or len(labels) != table.shape[1]:
        raise FileError(
            f"cannot use {path}: it is of shape {table.shape}, not a curve with names of its columns. {OF_IMAGES}"
        )
    order = sorted(range(len(labels)), key=lambda i: labels[i] != "ZSnsr")  # what was measured before what was asked
    units = ["deg" if NAMES["phase"][0].match(label) else "m" for label in labels]
    parts = _parts([_column(f"{labels[i]} [{units[i]}]", False) for i in order], table[:, order])
    return parts, scan_data(path, {key: value.strip() for key, value in note.items()})
