"""Tables of a scene as the text of a TOML file."""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Iterable, Mapping

from phasemap._shared.errors import InputError
from phasemap.scenes.tables import Table

BARE = re.compile(r"[A-Za-z0-9_-]+", re.ASCII)
UNITS = {
    "stiffness": "N/m",
    "adhesion": "J/m2",
    "modulus": "Pa",
    "radius": "m",
    "free_amplitude": "m, at resonance",
}


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
                said = ", ".join(filter(None, [UNITS.get(key, ""), notes.get(f"{title}.{key}", "")]))
                lines.append(f"{_key(key)} = {written(value)}" + (f"  # {said}" if said else ""))
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
    """A string: as in JSON, but TOML has no raw DEL, and no halves of characters, which stand for bytes in file names.

    Raises InputError for those.
    """
    try:
        text.encode()
    except UnicodeEncodeError:
        raise InputError("text of a TOML file", text, "characters of Unicode") from None
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
