"""Values of the samples of an ensemble, drawn or read from a table, and the units of their keys."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from phasemap._shared.checks import check_choice, number, whole
from phasemap._shared.errors import FileError, InputError
from phasemap._shared.fields import Number
from phasemap._shared.files import size_of
from phasemap._shared.memory import check_fits
from phasemap._shared.quantities import NotThatUnit, in_si, is_number, with_unit
from phasemap.experiment.accuracy import Accuracy
from phasemap.experiment.control import Feedback
from phasemap.experiment.interaction import Interaction
from phasemap.experiment.labels import Variation
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Cantilever, Drive, Mode, Tip
from phasemap.experiment.realism import Realism, TipChange
from phasemap.scenes.tables import check_keys, construct, stated_in, value_of

OWNERS: dict[str, type] = {
    "cantilever": Cantilever, "tip": Tip, "drive": Drive, "drive.second": Mode, "interaction": Interaction,
    "control": Feedback, "accuracy": Accuracy, "realism": Realism, "realism.tip_change": TipChange,
    "surface.variation": Variation,
}  # fmt: skip


def unit_of(key: str) -> str:
    """The unit of a key, as in `phasemap._shared.quantities.KINDS`; empty where it may have any."""
    table, _, name = key.rpartition(".")
    owner = Material if table.startswith("materials.") else OWNERS.get(table)
    number = vars(owner).get(name) if owner is not None else None
    return number.unit if isinstance(number, Number) else "1" if key == "scan.setpoint" else ""


def plain(shown: str, key: str, value: Any) -> Any:
    """Return text with a unit as a number in SI units, and any other value of a key as it is."""
    if not isinstance(value, str) or not is_number(value):
        return value
    unit = unit_of(key)
    try:
        return in_si(value, unit)
    except NotThatUnit:
        raise InputError(shown, value, with_unit(unit)) from None


Table = dict[str, Any]

CELLS = 64  # byte of memory at most for a byte of the table
MOST = 1_000_000  # samples
DEEPEST = 8  # tables in tables of ``vary``; the longest key of a scene has four parts


def make_samples(table: Table, folder: Path) -> tuple[Table, ...]:
    """Draw or read the value of each varied key for each sample, as the table ``[ensemble]`` of a scene asks for."""
    check_keys("[ensemble]", table, ("count", "seed", "vary", "table", "licence"))
    licence = table.get("licence", "")
    if not isinstance(licence, str):
        raise InputError("[ensemble] licence", licence, "text, such as 'CC-BY-4.0'")
    table = {key: value for key, value in table.items() if key != "licence"}
    return _read(folder, table) if "table" in table else _drawn(table)


def check_overrides(overrides: Iterable[str], samples: Iterable[Mapping[str, Any]]) -> None:
    """Refuse overrides of keys that are varied, by a preset too, in either of them."""
    varied = {name for sample in samples for key, value in sample.items() for name in (key, *stated_in(key, value))}
    for override in overrides:
        name, _, text = override.partition("=")
        if both := sorted(({name.strip()} | stated_in(name.strip(), value_of(text))) & varied):
            raise InputError("override", override, f"a key that the ensemble does not vary, not {', '.join(both)}")


Draw = Callable[[np.random.Generator], Any]
"""Function that draws a value of a key."""


@dataclass(frozen=True)
class Range:
    """Numbers drawn uniformly from `low` to `high`, or uniformly on a logarithmic scale, which does not reach 0."""

    # low, high: in the SI unit of the key
    low: float
    high: float
    scale: str = "linear"  # "linear" or "log"; "log" draws the logarithm uniformly
    whole: bool = False  # draw whole numbers, both ends included

    def __post_init__(self) -> None:
        check_choice("scale", self.scale, ("linear", "log"))
        if not isinstance(self.whole, bool):
            raise InputError("whole", self.whole, "true or false")
        if self.whole and self.scale == "log":
            raise InputError("scale", self.scale, "'linear' for whole numbers")
        for name in ("low", "high"):
            value = getattr(self, name)
            if self.whole:
                whole(name, value, -(2**62), 2**62)
            else:
                number(name, value, "1", above=0 if self.scale == "log" else -math.inf)
        if self.low > self.high:
            raise InputError("high", self.high, f"a finite number of at least {self.low:g}, which is low")

    def draw(self, rng: np.random.Generator) -> float | int:
        """Draw one number."""
        if self.whole:
            return int(rng.integers(int(self.low), int(self.high), endpoint=True))
        share = float(rng.random())
        if self.scale == "log":
            return min(self.low * float((self.high / self.low) ** share), self.high)
        return self.low + (self.high - self.low) * share


def _one_of(options: Sequence[Any]) -> Draw:
    """Draw one of several values, each with the same chance."""
    return lambda rng: options[int(rng.integers(len(options)))]


def _drawn(table: Table) -> tuple[Table, ...]:
    """The samples of ``count``, ``seed`` and ``vary``."""
    check_keys("[ensemble]", table, ("count", "seed", "vary"), ("count", "vary"))
    count, seed = whole("[ensemble] count", table["count"], 1), whole("[ensemble] seed", table.get("seed", 0), 0)
    whole("[ensemble] count", count, 1, MOST)
    laws = dict(_laws_of(table["vary"])) if isinstance(table["vary"], dict) else {}
    if not laws:
        raise InputError("[ensemble] vary", table["vary"], "a table of keys, such as scan.setpoint = [0.5, 0.7]")
    return tuple(
        {key: draw(np.random.default_rng([seed, sample, *key.encode()])) for key, draw in laws.items()}
        for sample in range(count)
    )


def _laws_of(table: Table, prefix: str = "") -> Iterator[tuple[str, Draw]]:
    """The keys of ``vary``, quoted or not, and how each is drawn."""
    for name, value in table.items():
        key = f"{prefix}{name}"
        shown = f"[ensemble.vary] {key}"
        if isinstance(value, list):
            if not value:
                raise InputError(shown, value, "a list of at least one value")
            yield key, _one_of([plain(shown, key, one) for one in value])
        elif not isinstance(value, dict):
            raise InputError(shown, value, "a list of values, or { low = ..., high = ... }")
        elif any(not isinstance(value.get(end, []), (dict, list)) for end in ("low", "high")):
            check_keys(shown, value, ("low", "high", "scale", "whole"), ("low", "high"))
            ends = {end: plain(f"{shown} {end}", key, value[end]) for end in ("low", "high")}
            yield key, construct(shown, {**value, **ends}, Range).draw
        elif key.count(".") > DEEPEST:
            raise InputError("key of [ensemble.vary]", key, "table.key, such as scan.setpoint")
        else:
            yield from _laws_of(value, f"{key}.")


def _read(folder: Path, table: Table) -> tuple[Table, ...]:
    """The samples of ``table``, a CSV file."""
    name = table["table"]
    if len(table) > 1:
        raise InputError("[ensemble]", ", ".join(table), "either table, or count, seed and vary")
    if not isinstance(name, str) or not name:
        raise InputError("[ensemble] table", name, "the name of a CSV file")
    path = folder / name
    what = f"{path}, named in [ensemble] table"
    check_fits(what, CELLS * size_of(path, what), "Take fewer samples.")
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            header, *rows = [[cell.strip() for cell in row] for row in csv.reader(file) if row] or [[]]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise FileError(f"cannot read {what}: {getattr(error, 'strerror', error)}.") from error
    if not rows or len(set(header)) < len(header):
        raise FileError(f"cannot use {path}: it needs a header with a key for each column, and a row for each sample.")
    for sample, row in enumerate(rows):
        if len(row) != len(header) or not all(row):
            raise FileError(f"cannot use {path}: sample {sample} has not one value for each key of the header.")
    return tuple({key: plain(key, key, value_of(cell)) for key, cell in zip(header, row, strict=True)} for row in rows)
