"""SI units as people read them, with the prefix that suits the size, and parts of sentences that many messages have."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

PREFIXES = {
    1e12: "T", 1e9: "G", 1e6: "M", 1e3: "k", 1.0: "", 1e-3: "m", 1e-6: "µ", 1e-9: "n", 1e-12: "p", 1e-15: "f",
    1e-18: "a", 1e-21: "z",
}  # fmt: skip
WRITTEN = {"N m-1": "N/m", "J m-2": "J/m²", "C m-2": "C/m²", "N s m-1": "N s/m", "degree": "degrees", "1": ""}
UDUNITS = {"N/m": "N m-1", "J/m2": "J m-2", "C/m2": "C m-2", "N s/m": "N s m-1"}  # of what they write otherwise
ELECTRONVOLT = 1.602176634e-19  # [J], in which people count what a cycle takes
BARE = ("degree", "1", "eV", "N m-1", "J m-2")  # never with a prefix


class Unit(NamedTuple):
    """A unit to show values in: its size in the SI unit, and how it is written."""

    size: float
    text: str

    def label(self, name: str) -> str:
        """The label of an axis."""
        return f"{name} ({self.text})" if self.text else name

    def say(self, value: float, digits: int = 4) -> str:
        """A value with its unit."""
        scaled = value / self.size
        if 100.0 <= abs(scaled) < 999.5:
            digits = max(digits, 3)  # no power of ten
        return f"{scaled:.{digits}g} {self.text}".rstrip()


def readable(largest: float, units: str) -> Unit:
    """Choose the prefix with which the largest value, in the SI unit of either sign, is from 1 to 1000."""
    if units == "J":
        return Unit(ELECTRONVOLT, "eV")
    text = WRITTEN.get(units, units)
    if units in BARE or not math.isfinite(largest) or largest == 0:
        return Unit(1.0, text)
    size = next((size for size in PREFIXES if abs(largest) >= size * (1 - 1e-9)), min(PREFIXES))
    return Unit(size, PREFIXES[size] + text)


def say(value: float, units: str, digits: int = 4) -> str:
    """A single value with the unit that suits it."""
    return readable(value, units).say(value, digits)


def counted(count: int, total: int, what: str) -> str:
    """Say how many of how many."""
    return f"{count} of {total} {what} ({100 * count / total:.3g} %)"


def image_size(shape: tuple[int, int], pixel_size: tuple[float, float]) -> str:
    """Say how large an image is, width first."""
    (ny, nx), (dy, dx) = shape, pixel_size
    unit = readable(max(nx * dx, ny * dy), "m")
    return f"{nx} x {ny} pixels, {nx * dx / unit.size:.4g} x {unit.say(ny * dy)}"


def listed(names: Sequence[str]) -> str:
    """List names as one speaks."""
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))
