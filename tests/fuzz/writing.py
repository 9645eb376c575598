"""TOML of anything that a fuzzer puts into a table, valid or not."""

from __future__ import annotations

import json
from datetime import date, datetime, time
from typing import Any


class Raw(str):
    """Text that goes into the file as it is."""

    __slots__ = ()


def written(tables: dict[str, Any]) -> str:
    """Tables as TOML: a header for each table at the top, all below it inline."""
    loose = {key: value for key, value in tables.items() if not isinstance(value, dict)}
    lines = [f"{_key(key)} = {_value(value)}" for key, value in loose.items()]
    for name, table in tables.items():
        if isinstance(table, dict):
            lines += [f"[{_key(name)}]", *(f"{_key(key)} = {_value(value)}" for key, value in table.items())]
    return "\n".join(lines) + "\n"


def _key(key: object) -> str:
    return _text(str(key))


def _text(text: str) -> str:
    return json.dumps(text).replace("\x7f", "\\u007f")  # surrogates stay escaped, and are not valid TOML then


def _value(value: object) -> str:
    if isinstance(value, Raw):
        return str(value)
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, datetime | date | time):
        return value.isoformat()
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_key(key)} = {_value(one)}" for key, one in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_value, value)) + "]"
    return repr(value)  # a number, inf and nan among them
