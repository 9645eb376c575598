"""Distinct materials of an image, found a block of pixels at a time and in bounded memory."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels.materials.distinct import gather, look_up, row_digests
from phasemap._shared.arrays import Array
from phasemap._shared.errors import InputError, Word

BLOCK = 1 << 15  # pixels that are worked on together


class Distinct:
    """A set of materials of at most `most` members."""

    def __init__(self, most: int) -> None:
        self._table = np.full(1 << (2 * most - 1).bit_length(), -1, np.int32)
        self._known = np.empty((most, 0), np.uint64)
        self._count = 0

    def __len__(self) -> int:
        return self._count

    @property
    def materials(self) -> Array:
        """The members, in the order in which they came; shape (n, 4) or (n, 10)."""
        return self._known[: self._count].view(np.float64)

    def add(self, materials: Array) -> int:
        """Take in materials, and return how many there was room for."""
        if not self._count:
            self._known = np.empty((len(self._known), materials.shape[1]), np.uint64)
        self._count, taken = gather(_bits(materials), self._table, self._known, self._count)
        return int(taken)

    def numbers(self, materials: Array) -> NDArray[np.int32]:
        """Which member each material is."""
        out = np.empty(len(materials), np.int32)
        look_up(_bits(materials), self._table, self._known, out)
        if (out < 0).any():
            hint = "What is random needs a seed; surface.compute() or persist() keep what was computed."
            raise InputError("surface", Word("not the same"), "maps that are the same whenever they are computed", hint)
        return out


def _bits(materials: Array) -> NDArray[np.uint64]:
    return np.ascontiguousarray(materials).view(np.uint64)


def digests_of(materials: Array) -> NDArray[np.uint64]:
    """64 bits of each material that almost surely differ where the materials differ."""
    out = np.empty(len(materials), np.uint64)
    row_digests(_bits(materials), out)
    return out
