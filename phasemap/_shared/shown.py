"""How value objects show themselves: as short Python, and in a notebook as a table with units."""

from __future__ import annotations

import html
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, Field, fields
from typing import Any, ClassVar

from phasemap._shared.fields import Number
from phasemap._shared.units import UDUNITS, say


class Shown:
    """A dataclass that says only what is not the default; it has to be declared with ``repr=False``."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    def __repr__(self) -> str:
        """As Python would have it, without what is the default."""
        said = ", ".join(f"{field.name}={_python(getattr(self, field.name))}" for field in _given(self))
        return f"{type(self).__name__}({said})"

    def _repr_html_(self) -> str:
        """A table of everything that is set, with units."""
        return table(type(self).__name__, dict(_rows(self, _in_html)))


def in_words(thing: Shown) -> str:
    """What is set, with units, in one line."""
    given = {field.name.replace("_", " ") for field in _given(thing)}
    return ", ".join(f"{name} {said}" for name, said in _rows(thing, _in_line) if name in given)


def table(caption: str, rows: Mapping[str, str]) -> str:
    """A table of two columns in HTML, with what is said of each name, in HTML too."""
    lines = (f"<tr><th>{html.escape(name)}</th><td>{text}</td></tr>" for name, text in rows.items())
    return f"<table><caption>{html.escape(caption)}</caption>{''.join(lines)}</table>"


def preformatted(text: str) -> str:
    """Text with its line breaks, in HTML."""
    return f"<pre>{html.escape(text)}</pre>"


def _given(thing: Shown) -> list[Field[Any]]:
    """The fields that are not as they are without a word."""
    every = [field for field in fields(thing) if field.init]
    return [field for field in every if field.default is MISSING or getattr(thing, field.name) != field.default]


def _python(value: object) -> str:
    """A value as Python writes it, numbers without many zeros."""
    short = f"{value:g}" if isinstance(value, float) else ""
    return short if "e" in short and float(short) == value else repr(value)


def _are_shown(value: Any) -> bool:
    return isinstance(value, tuple) and all(isinstance(one, Shown) for one in value)


def _in_line(value: Any) -> str:
    """A value in words where it says itself, else as text."""
    return " and ".join(f"({in_words(one)})" for one in value) if _are_shown(value) else str(value)


def _in_html(value: Any) -> str:
    """A value as a table where it has one, else as text."""
    if _are_shown(value):
        return "".join(map(_in_html, value))
    return value._repr_html_() if hasattr(value, "_repr_html_") else html.escape(str(value))


def _rows(thing: Shown, written: Callable[[Any], str]) -> Iterator[tuple[str, str]]:
    """What is set, in words; `written` is how values that are not numbers are written."""
    for field in fields(thing):
        value = getattr(thing, field.name)
        if not field.init or (value in (None, ()) and value == field.default):
            continue
        number = vars(type(thing)).get(field.name)
        said = "none" if value is None else written(value)
        if isinstance(number, Number) and value is not None:
            said = say(value, UDUNITS.get(number.unit, number.unit), 6)
        yield field.name.replace("_", " "), said
