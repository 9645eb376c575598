"""Presets: usual materials and levers, every number with its range and its source, from ``presets.toml``."""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from types import MappingProxyType
from typing import Any

from phasemap._shared.errors import InputError

ESTIMATE = "estimate"
LOSSES = {"damping", "viscosity", "relaxed_modulus", "relaxation_time"}  # ways to give the loss of a material


@dataclass(frozen=True)
class Quoted:
    """A number as it is quoted."""

    value: float  # in the SI unit of its field
    # low, high: the range in which it is found
    low: float
    high: float
    source: str  # where it comes from

    @property
    def is_estimate(self) -> bool:
        """True if the number is an estimate and nobody measured it."""
        return self.source.startswith(ESTIMATE)


@dataclass(frozen=True)
class Preset:
    """A material or a lever."""

    name: str  # as on the box
    title: str  # in words
    kind: str  # in the plural, such as "polymers"
    also: tuple[str, ...]  # other names
    numbers: Mapping[
        str, Quoted
    ]  # by the arguments of `phasemap.Material` or `phasemap.Cantilever`; a lever's thickness

    @property
    def values(self) -> dict[str, float]:
        """The arguments alone; the thickness of a lever is in its stiffness and its frequency."""
        return {name: quoted.value for name, quoted in self.numbers.items() if name != "thickness"}


def materials() -> Mapping[str, Preset]:
    """Presets of materials by their names."""
    return _read()["materials"]


def levers() -> Mapping[str, Preset]:
    """Presets of levers by their names."""
    return _read()["levers"]


def preset_of(kind: str, name: object, what: str = "preset") -> Preset:
    """The preset with a name, a title or another name that is usual, whatever its case and its hyphens.

    `kind` ("materials" or "levers"; "" for either), `what`: what an error calls the name.
    """
    every = [one for which, found in _read().items() if kind in (which, "") for one in found.values()]
    known = {_letters(key): one for one in every for key in (*one.also, one.title, one.name)}
    sought = _letters(name) if isinstance(name, str) else ""
    if sought in known:
        return known[sought]
    parts = [key for key in known if sought and sought in key]
    near = dict.fromkeys(known[key].name for key in (*parts, *difflib.get_close_matches(sought, known, 5)))
    hint = f"Did you mean {' or '.join(map(repr, list(near)[:3]))}?" if near else ""
    raise InputError(what, name, f"one of the {len(every)} names that `phasemap presets` lists", hint)


def _letters(name: str) -> str:
    """Letters and digits of a name, in lower case."""
    return re.sub(r"[\W_]", "", name).lower()


def combined(numbers: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Numbers of a preset, with some of them changed; a damping takes the place of its viscosity."""
    damped = changes.get("damping") is not None and "viscosity" not in changes
    return {**{name: value for name, value in numbers.items() if not (damped and name == "viscosity")}, **changes}


def stated_by(kind: str, name: object) -> set[str]:
    """The arguments that a preset states; a material's loss is one statement, in whichever way it is given.

    `kind` ("materials" or "levers"). Returns an empty set if there is no such preset.
    """
    try:
        stated = set(preset_of(kind, name).values)
    except InputError:
        return set()
    return stated | LOSSES if stated & LOSSES else stated


@cache
def _read() -> dict[str, Mapping[str, Preset]]:
    """Presets of the file, which is read once."""
    tables = tomllib.loads(files("phasemap.experiment").joinpath("presets.toml").read_text(encoding="utf-8"))
    return {
        which: MappingProxyType({
            name: _preset(name, tables["kinds"][kind], table, tables["sources"])
            for kind, every in tables[which].items() for name, table in every.items()
        })
        for which in ("materials", "levers")
    }  # fmt: skip


def _preset(name: str, kind: str, table: dict[str, Any], sources: dict[str, str]) -> Preset:
    """Preset of a table in the file, whose numbers name their source."""
    numbers = {
        key: Quoted(one["value"], one["range"][0], one["range"][1], sources[one["source"]])
        for key, one in table.items() if key not in ("title", "also")
    }  # fmt: skip
    return Preset(name, table["title"], kind, tuple(table.get("also", ())), MappingProxyType(numbers))
