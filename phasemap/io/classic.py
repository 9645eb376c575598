"""Check of the header of a classic netCDF file (netCDF-3), since the library believes every count in it.

The format is that of the NetCDF Classic Format Specification: lists of dimensions, attributes and variables, each a
tag, a count and its entries. One wrong bit of a count makes the library take gigabytes and seconds, or minutes.
"""

from __future__ import annotations

MAGIC = (b"CDF\x01", b"CDF\x02", b"CDF\x05")
SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 4, 6: 8, 7: 1, 8: 2, 9: 4, 10: 8, 11: 8}  # byte of an external type
DIMENSIONS, VARIABLES, ATTRIBUTES = 10, 11, 12  # tags


def is_classic(data: bytes) -> bool:
    """Whether a file that begins so is a classic one."""
    return data[:4] in MAGIC


def check_classic(data: bytes) -> None:
    """Raise ValueError if a count of the header does not fit; `data` is the file, or as much as has the header."""
    walk = _Walk(data)
    walk.take(walk.wide)  # how many records
    for _ in range(walk.entries(DIMENSIONS)):
        walk.over_text()
        walk.take(walk.wide)
    walk.over_attributes()
    for _ in range(walk.entries(VARIABLES)):
        walk.over_text()
        walk.skip(walk.take(walk.wide) * walk.wide)  # its dimensions
        walk.over_attributes()
        walk.skip(4 + walk.wide)  # type and size
        walk.skip(4 if data[3] == 1 else 8)  # where it begins


class _Walk:
    """Goes from entry to entry of a header."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 4
        self.wide = 8 if data[3] == 5 else 4  # byte of a count

    def take(self, size: int) -> int:
        """The number of so many bytes that is next."""
        start = self._at
        self.skip(size)
        return int.from_bytes(self._data[start : self._at], "big")

    def skip(self, size: int) -> None:
        """Go on, if there is as much."""
        self._at += size
        if self._at > len(self._data):
            raise ValueError("the header is damaged")

    def entries(self, tag: int) -> int:
        """How many entries the list has that begins here."""
        found, count = self.take(4), self.take(self.wide)
        if found != tag and (found or count):
            raise ValueError("the header is damaged")
        if count > len(self._data) - self._at:  # no entry is shorter than a byte
            raise ValueError("the header is damaged")
        return count

    def over_text(self) -> None:
        """Pass a name, which is filled up to a whole number of four bytes."""
        self.skip(-(-self.take(self.wide) // 4) * 4)

    def over_attributes(self) -> None:
        """Pass a list of attributes."""
        for _ in range(self.entries(ATTRIBUTES)):
            self.over_text()
            size = SIZES.get(self.take(4), 8)
            self.skip(-(-self.take(self.wide) * size // 4) * 4)
