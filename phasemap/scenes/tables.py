"""Tables of a scene file: read, overridden, checked, turned into objects, and written."""

from __future__ import annotations

import difflib
import json
import os
import re
import textwrap
import tomllib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from phasemap._shared.checks import check_choice
from phasemap._shared.errors import FileError, InputError, InputErrors, PhasemapError, Word
from phasemap._shared.files import size_of
from phasemap.experiment.presets import stated_by

T = TypeVar("T")
Table = dict[str, Any]
LARGEST = 1 << 22  # byte of a scene file: maps that are larger are better kept in files of their own
LONG_KEY = re.compile(r"""(?<![\w."'-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){64}""", re.ASCII)


class Complaints:
    """Collects the errors in the parts of a scene, so that all are reported at once."""

    def __init__(self) -> None:
        self._errors: list[PhasemapError] = []

    def add(self, error: PhasemapError) -> None:
        """Collect an error."""
        self._errors.extend(error.errors if isinstance(error, InputErrors) else [error])

    def of(self, make: Callable[..., T], *arguments: Any, **more: Any) -> T | None:
        """Result of a function, or None if it raises an error, which is collected."""
        try:
            return make(*arguments, **more)
        except (InputError, FileError) as error:
            self.add(error)
            return None

    def make(self) -> None:
        """Raise the collected errors, if there are any."""
        if len(self._errors) == 1 or not any(isinstance(error, InputError) for error in self._errors):
            for error in self._errors:
                raise error
        elif self._errors:
            raise InputErrors(self._errors)

    def __bool__(self) -> bool:
        return bool(self._errors)


def check_keys(name: str, table: object, allowed: Iterable[str], required: Iterable[str] = ()) -> None:
    """Refuse a table, named as the user writes it ("[drive]"), that has unknown keys or lacks required ones."""
    allowed = list(dict.fromkeys(allowed))
    if not isinstance(table, dict):
        named = "preset" in allowed and isinstance(table, str)
        hint = f"A preset is {name.strip('[]')}.preset={table}." if named else ""
        raise InputError(name, table, "a table of keys " + ", ".join(allowed), hint)
    complaints, meant = Complaints(), list[str]()
    for key in table:
        if key not in allowed:
            meant += (near := difflib.get_close_matches(key, allowed, 1, 0.5))
            hint = f"Did you mean {near[0]!r}?" if near else ""
            complaints.add(InputError(f"{name} {key}", Word("unknown"), ", ".join(allowed), hint))
    for key in required:
        if key not in table and key not in meant:
            complaints.add(missing(name, key))
    complaints.make()


def switch(name: str, table: Mapping[str, Any], key: str) -> bool:
    """A key that is true or false, which is false where it is not given."""
    if not isinstance(on := table.get(key, False), bool):
        raise InputError(f"{name} {key}", on, "true or false")
    return on


def missing(name: str, key: str) -> InputError:
    """The error for a required key that a table does not have."""
    return InputError(f"{name} {key}", Word("missing"), "a value, for it has no default")


def construct(name: str, table: Table, make: Callable[..., T], **more: Any) -> T:
    """Call `make` with the keys of a table, and name the table and key in what it raises."""
    try:
        return make(**table, **more)
    except InputError as error:
        key = error.name.removeprefix(f"{name} ").removeprefix(name.strip("[]") + " ")
        raise InputError(f"{name} {key}", error.value, error.allowed, error.hint) from error


def read_tables(path: str | os.PathLike[str], overrides: Iterable[str] = ()) -> Table:
    """Read the tables of a scene file, with keys set from outside as in `load_scene`; nothing is checked yet."""
    written = tables = _read_toml(Path(path))
    if isinstance(tables.get("realism"), str):
        tables = {**tables, "realism": {"preset": tables["realism"]}}
    for override in overrides:
        tables = with_override(tables, override)
    _check_materials(tables, written)
    return tables


def _check_materials(tables: Table, written: Table) -> None:
    """Refuse a material that only an override names: it would change nothing."""
    known, surface = written.get("materials"), tables.get("surface")
    if not isinstance(known, dict) or not known or not isinstance(surface, dict):
        return
    named = surface.get("materials")
    used = list(named.values()) if isinstance(named, dict) else named if isinstance(named, list) else []
    for name in tables["materials"]:
        check_choice("material", name, list(dict.fromkeys([*known, *map(str, used)])))


def _read_toml(path: Path) -> Table:
    """The tables of a TOML file."""
    size = size_of(path, f"the scene {path}")
    if size > LARGEST:
        raise FileError(
            f"cannot read the scene {path}: it has {size} bytes, {LARGEST} are allowed; keep maps in .npy or .nc files."
        )
    try:
        with path.open("rb") as file:
            content = file.read(LARGEST)
    except OSError as error:
        raise FileError(f"cannot read the scene {path}: {error.strerror}.") from error
    if b"\0" in content:
        use = "`phasemap plot` draws an image, and `phasemap scene` makes a scene of it."
        raise FileError(f"cannot read {path}: it is no scene, which is text. {use}")
    try:
        return _parsed(content.decode())
    except UnicodeDecodeError as error:
        reason = f"it is not in UTF-8, from byte {error.start} on: save it as that"
        raise FileError(f"cannot read the scene {path}: {reason}.") from error
    except ValueError as error:
        raise FileError(f"cannot read the scene {path}: it is not valid TOML: {error}.") from error


def _parsed(text: str) -> Table:
    """The tables of TOML text; a `ValueError` for all that tomllib does not like, or cannot stand."""
    if LONG_KEY.search(text):
        raise ValueError("a key has more than 64 parts")  # which tomllib takes a time for that grows with their square
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("arrays or tables are nested too deeply") from None


def with_override(tables: Table, override: str) -> Table:
    """Return the tables with one key set from ``"table.key=value"``. `override`: as in `load_scene`."""
    name, equals, text = override.partition("=")
    name = name.strip()
    if name == "setpoint":
        name = "scan.setpoint"
    if not equals or "." not in name or not all(name.split(".")) or not _is_text(override):
        raise InputError("override", override, "table.key=value, such as drive.free_amplitude=20nm")
    try:
        return with_value(tables, name, value_of(text))
    except InputError as error:
        raise InputError("override", override, error.allowed) from error


def with_value(tables: Table, name: str, value: Any) -> Table:
    """Return the tables with one key set, "table.key"; those that are given stay as they are.

    Tables on the way are made where there are none. A preset takes the place of the numbers that it states, for what is
    said last holds.
    """
    *path, key = name.split(".")
    changed = table = dict(tables)
    for part in path:
        inside = table.get(part, {})
        if not isinstance(inside, dict):
            raise InputError("key", name, f"a key of a table; {part} is none")
        table[part] = table = dict(inside)
    for stated in stated_in(name, value):
        table.pop(stated.rpartition(".")[2], None)
    table[key] = value
    return changed


def stated_in(name: str, value: Any) -> set[str]:
    """The other keys that a key states, which is none unless it is a preset's."""
    match name.split("."):
        case ["cantilever", "preset"]:
            kind = "levers"
        case ["materials", _, "preset"]:
            kind = "materials"
        case _:
            return set()
    return {f"{name.removesuffix('preset')}{stated}" for stated in stated_by(kind, value)}


def _is_text(text: str) -> bool:
    """True if Unicode has all of it: bytes of the command line that are not UTF-8 could not be kept in a file."""
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def value_of(text: str) -> Any:
    """Read text as one TOML value, and as itself where it is none."""
    try:
        parsed = _parsed(f"value = {text}")
    except ValueError:
        return text
    return parsed["value"] if len(parsed) == 1 else text


BARE = re.compile(r"[A-Za-z0-9_-]+", re.ASCII)
UNITS = {"stiffness": "N/m", "adhesion": "J/m2", "modulus": "Pa", "radius": "m", "free_amplitude": "m, at resonance"}


def without_none(value: Any) -> Any:
    """Tables without the keys that TOML could not have."""
    if isinstance(value, Mapping):
        return {key: without_none(one) for key, one in value.items() if one is not None}
    return type(value)(without_none(one) for one in value) if isinstance(value, list | tuple) else value


def toml_of(tables: Table, notes: Mapping[str, str] | None = None, heading: Iterable[str] = ()) -> str:
    """Write the tables of a scene as TOML below a heading, with notes on tables and keys ("tip.radius") as comments."""
    notes = {} if notes is None else notes
    lines = [f"# {part}".rstrip() for line in heading for part in textwrap.wrap(line, 116) or [""]]
    for name, table in tables.items():
        parts = {(name, key): sub for key, sub in table.items()} if name == "materials" else {(name,): table}
        for path, part in parts.items():
            if not part:
                continue
            title = ".".join(path)
            lines += ["", f"[{'.'.join(map(_key, path))}]" + (f"  # {notes[title]}" if title in notes else "")]
            for key, value in part.items():
                comment = ", ".join(filter(None, [UNITS.get(key, ""), notes.get(f"{title}.{key}", "")]))
                lines.append(f"{_key(key)} = {written(value)}" + (f"  # {comment}" if comment else ""))
    return "\n".join(lines) + "\n"


def written(value: object) -> str:
    """Write one value as TOML."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(key)} = {written(one)}" for key, one in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(written, value)) + "]"
    if isinstance(value, float) and abs(value) >= 1e6:
        from numpy import format_float_scientific

        return format_float_scientific(value, trim="0", exp_digits=1).replace("e+", "e")
    return _quoted(value) if isinstance(value, str) else repr(value)


def _key(name: str) -> str:
    """A key, in quotes where TOML wants them."""
    return name if BARE.fullmatch(name) else _quoted(name)


def _quoted(text: str) -> str:
    """A string as in JSON, but TOML has no raw DEL, and no halves of characters, as bytes in file names are."""
    try:
        text.encode()
    except UnicodeEncodeError:
        raise InputError("text of a TOML file", text, "characters of Unicode") from None
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
