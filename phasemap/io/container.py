"""Check of a .gwy file: its reader believes every length in it, and never ends where some are wrong.

A Gwyddion file is an object: a name, a size, and components, each a name, a letter for its type, and its value.
"""

from __future__ import annotations

import struct

SIZES = {b"b": 1, b"c": 1, b"i": 4, b"q": 8, b"d": 8}  # byte, of single values
ITEMS = {b"C": 1, b"I": 4, b"Q": 8, b"D": 8}  # byte, of what arrays consist of
DEEPEST = 32  # objects in objects; channels, their units and metadata are on the third level
MOST = 2e11  # byte that the reader would copy, for it copies what is left at every component


def check_container(data: bytes) -> None:
    """Refuse what is not a Gwyddion container, or has a length that does not fit.

    Raises ValueError if it is damaged.
    """
    if not data.startswith(b"GWYP"):
        raise ValueError("it is no Gwyddion file")
    walk = _Walk(data)
    try:
        walk.over_object(4, len(data), 0)
    except struct.error:
        raise ValueError("it is damaged or cut short") from None


class _Walk:
    """Goes from component to component of a file."""

    def __init__(self, data: bytes) -> None:
        self._data, self._copied = data, 0

    def over_object(self, at: int, end: int, depth: int) -> int:
        """The position behind the object that begins here."""
        at = self._over_text(at, end)
        stop = at + 4 + self._count(at)
        if stop > end or depth > DEEPEST:
            raise ValueError("it is damaged or cut short")
        at += 4
        while at < stop:
            self._copied += stop - at
            if self._copied > MOST:
                raise ValueError("it has too many components")
            at = self._over_component(at, stop, depth)
        if at != stop:
            raise ValueError("it is damaged or cut short")
        return stop

    def _over_component(self, at: int, end: int, depth: int) -> int:
        at = self._over_text(at, end)
        kind, at = self._data[at : at + 1], at + 1
        if kind in SIZES:
            return at + SIZES[kind]
        if kind in ITEMS:
            return at + 4 + ITEMS[kind] * self._count(at)
        if kind in (b"o", b"s"):
            return self._over_one(kind, at, end, depth)
        if kind not in (b"O", b"S"):
            raise ValueError("it is damaged or cut short")
        for _ in range(self._count(at)):
            at = self._over_one(kind.lower(), at + 4, end, depth) - 4
        return at + 4

    def _over_one(self, kind: bytes, at: int, end: int, depth: int) -> int:
        return self.over_object(at, end, depth + 1) if kind == b"o" else self._over_text(at, end)

    def _over_text(self, at: int, end: int) -> int:
        """The position behind the text that ends with a zero."""
        found = self._data.find(b"\0", at, end)
        if found < 0:
            raise ValueError("it is damaged or cut short")
        return found + 1

    def _count(self, at: int) -> int:
        return int(struct.unpack_from("<I", self._data, at)[0])
