"""Distinct materials of an image, found a block of pixels at a time and in bounded memory."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Materials = Callable[[slice], Array]
"""Materials of a range of pixels, shape (n, 4)."""

BLOCK = 1 << 15  # pixels that are worked on together
HELD = 1 << 22  # digests that are sorted together


class Distinct:
    """A set of materials of at most `most` members.

    Parameters
    ----------
    most : int

    Examples
    --------
    >>> known = Distinct(10)
    >>> known.add(np.array([[1.0, 0, 0, 0], [2.0, 0, 0, 0], [1.0, 0, 0, 0]]))
    3
    >>> len(known), known.numbers(np.array([[2.0, 0, 0, 0]])).tolist()
    (2, [1])
    """

    def __init__(self, most: int) -> None:
        self._table = np.full(1 << (2 * most - 1).bit_length(), -1, np.int32)
        self._known = np.empty((most, 4), np.uint64)
        self._count = 0

    def __len__(self) -> int:
        return self._count

    @property
    def materials(self) -> Array:
        """The members, in the order in which they came; shape (n, 4)."""
        return self._known[: self._count].view(np.float64)

    def add(self, materials: Array) -> int:
        """Take in materials, and return how many there was room for."""
        from phasemap._kernels.distinct import gather

        self._count, taken = gather(_bits(materials), self._table, self._known, self._count)
        return int(taken)

    def numbers(self, materials: Array) -> NDArray[np.int32]:
        """Which member each material is."""
        from phasemap._kernels.distinct import look_up

        out = np.empty(len(materials), np.int32)
        look_up(_bits(materials), self._table, self._known, out)
        return out


def _bits(materials: Array) -> NDArray[np.uint64]:
    return np.ascontiguousarray(materials).view(np.uint64)


def count_distinct(materials: Materials, pixels: int) -> int:
    """How many distinct materials there are, by 64-bit digests of them.

    Examples
    --------
    >>> count_distinct(lambda part: np.array([[1.0, 0, 0, 0], [2.0, 0, 0, 0], [1.0, 0, 0, 0]])[part], 3)
    2
    """
    from phasemap._kernels.distinct import digests

    bits = max(0, (pixels - 1) // HELD).bit_length()
    count = 0
    block = np.empty(BLOCK, np.uint64)
    for part in range(1 << bits):
        held = []
        for first in range(0, pixels, BLOCK):
            rows = _bits(materials(slice(first, min(first + BLOCK, pixels))))
            some = block[: len(rows)]
            digests(rows, some)
            held.append(some[some >> np.uint64(64 - bits) == part] if bits else some.copy())
        ordered = np.concatenate(held)
        del held
        ordered.sort()
        count += 1 + int(np.count_nonzero(ordered[1:] != ordered[:-1])) if len(ordered) else 0
    return count
