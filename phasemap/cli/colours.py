"""What commands that draw maps are told of their colours: ``--vmin``, ``--vmax`` and ``--cmap``."""

from __future__ import annotations

import argparse
from typing import Any

NAMES = ("vmin", "vmax", "cmap")


def add_colours(parser: argparse.ArgumentParser, of: str, example: str) -> None:
    """Declare the arguments.

    `of`: what limits and colour map belong to.
    """
    parser.add_argument("--vmin", metavar="VALUE", help=f"lowest value of the colours of {of}, such as {example}")
    parser.add_argument("--vmax", metavar="VALUE", help=f"highest value of the colours of {of}")
    parser.add_argument("--cmap", metavar="NAME", help=f"matplotlib colour map of {of}, such as gray")


def colours_of(arguments: argparse.Namespace) -> dict[str, Any]:
    """What was given, by the arguments of `phasemap.plot.plot`; of several variables by name."""
    return {name: _by_name(getattr(arguments, name)) for name in NAMES}


def _by_name(text: str | None) -> float | str | dict[str, float | str] | None:
    """A number, text, or what is said of each name."""
    if text is None or "=" not in text:
        return text if text is None else _value(text)
    parts = [part.partition("=") for part in text.split(",")]
    return {name.strip(): _value(value.strip()) for name, _, value in parts}


def _value(text: str) -> float | str:
    """A plain number as one."""
    try:
        return float(text)
    except ValueError:
        return text
