"""How value objects show themselves: as short Python, and in a notebook as a table with units."""

from __future__ import annotations

import html
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, Field, fields
from typing import Any, ClassVar

from phasemap._shared.fields import Number
from phasemap._shared.units import UDUNITS, say


class Shown:
    """A dataclass that says only what is not the default; it has to be declared with ``repr=False``.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True, repr=False)
    ... class Ball(Shown):
    ...     modulus: Number[float] = Number("Pa", 3e9)
    ...     radius: Number[float | None] = Number("m", None)
    >>> Ball(), Ball(70e9)
    (Ball(), Ball(modulus=7e+10))
    >>> Ball(70e9)._repr_html_()
    '<table><caption>Ball</caption><tr><th>modulus</th><td>70 GPa</td></tr></table>'
    """

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    def __repr__(self) -> str:
        """As Python would have it, without what is the default."""
        said = ", ".join(f"{field.name}={_python(getattr(self, field.name))}" for field in _given(self))
        return f"{type(self).__name__}({said})"

    def _repr_html_(self) -> str:
        """A table of everything that is set, with units."""
        return table(type(self).__name__, dict(_rows(self, _in_html)))


def in_words(thing: Shown) -> str:
    """What is set, with units, in one line.

    Examples
    --------
    >>> import phasemap as pm
    >>> in_words(pm.Material(3e9, damping=0.01))
    'modulus 3 GPa, damping 0.01'
    >>> in_words(pm.Cantilever(0.1, 20e3, 2.5, modes=(pm.Eigenmode(7.5, 6.0),)))
    'stiffness 0.1 N/m, resonance frequency 20 kHz, quality factor 2.5, modes (frequency ratio 7.5, quality factor 6)'
    """
    given = {field.name.replace("_", " ") for field in _given(thing)}
    return ", ".join(f"{name} {said}" for name, said in _rows(thing, _in_line) if name in given)


def table(caption: str, rows: Mapping[str, str]) -> str:
    """A table of two columns in HTML.

    `rows`: what is said of each name, in HTML.

    Examples
    --------
    >>> table("Pixel", {"phase": "45 degrees"})
    '<table><caption>Pixel</caption><tr><th>phase</th><td>45 degrees</td></tr></table>'
    """
    lines = (f"<tr><th>{html.escape(name)}</th><td>{text}</td></tr>" for name, text in rows.items())
    return f"<table><caption>{html.escape(caption)}</caption>{''.join(lines)}</table>"


def preformatted(text: str) -> str:
    """Text with its line breaks, in HTML.

    Examples
    --------
    >>> preformatted("a < b")
    '<pre>a &lt; b</pre>'
    """
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
    """What is set, in words.

    `written`: how values that are not numbers are written.
    """
    for field in fields(thing):
        value = getattr(thing, field.name)
        if not field.init or (value in (None, ()) and value == field.default):
            continue
        number = vars(type(thing)).get(field.name)
        said = "none" if value is None else written(value)
        if isinstance(number, Number) and value is not None:
            said = say(value, UDUNITS.get(number.unit, number.unit), 6)
        yield field.name.replace("_", " "), said
