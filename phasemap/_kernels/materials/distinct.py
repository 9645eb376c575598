"""Distinct rows, found through a hash table of bounded size."""

from __future__ import annotations

import numpy as np

from phasemap._kernels.compilation import kernel
from phasemap._kernels.numerics import copy

_MIX, _SHIFT = np.uint64(0x9E3779B97F4A7C15), np.uint64(29)


@kernel
def row_digest(row: np.ndarray) -> np.uint64:
    """Digest of a row of uint64: 64 bits that differ where the row differs, as good as surely."""
    mixed = np.uint64(0)
    for word in row:
        mixed = (mixed ^ word) * _MIX
        mixed ^= mixed >> _SHIFT
    mixed *= _MIX
    return mixed ^ (mixed >> _SHIFT)


@kernel
def slot_of(row: np.ndarray, table: np.ndarray, known: np.ndarray) -> np.int64:
    """Place in the table where this row is, or would be; the table's length is a power of 2."""
    at = np.int64(row_digest(row) & np.uint64(len(table) - 1))
    while table[at] >= 0:
        same = True
        for j in range(len(row)):
            same &= known[table[at], j] == row[j]
        if same:
            break
        at = (at + 1) & (len(table) - 1)
    return at


@kernel
def add_distinct_rows(rows: np.ndarray, table: np.ndarray, known: np.ndarray, count: int) -> tuple[int, int]:
    """Add new rows to the `known`, of which there are `count`, until that is full.

    Returns the number of known rows then, and that of rows that were looked at.
    """
    for i in range(len(rows)):
        at = slot_of(rows[i], table, known)
        if table[at] < 0:
            if count == len(known):
                return count, i
            table[at] = count
            copy(rows[i], known[count])
            count += 1
    return count, len(rows)


@kernel
def look_up(rows: np.ndarray, table: np.ndarray, known: np.ndarray, out: np.ndarray) -> None:
    """Fill in the number of every row among the known."""
    for i in range(len(rows)):
        out[i] = table[slot_of(rows[i], table, known)]
