"""Distinct materials of maps, and distinct rows of a table, found by sorting their bits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.arrays import Array, IntArray, is_uniform, read_only


def distinct_materials(maps: Sequence[Array]) -> tuple[Array, IntArray]:
    """Distinct materials of maps of one shape: a row for each, and which one each pixel has; both read-only."""
    shape = maps[0].shape
    varying = [one.reshape(-1) for one in maps if not is_uniform(one)]
    if not varying:
        return read_only(np.array([[one[0, 0] for one in maps]])), np.broadcast_to(np.int32(0), shape)
    first, flat = factorise(varying)
    pixels = np.divmod(first, shape[1])
    return read_only(np.column_stack([one[pixels] for one in maps])), read_only(flat.reshape(shape))


def factorise(columns: Sequence[Array]) -> tuple[NDArray[np.intp], IntArray]:
    """Find the distinct rows of equally long columns, by their bits: where each occurs, and which one each entry is."""
    size = columns[0].size
    count, codes = _codes(np.ascontiguousarray(columns[0]).view(np.int64))
    for column in columns[1:]:
        if count == size:
            break
        more, code = _codes(np.ascontiguousarray(column).view(np.int64))
        codes *= more
        codes += code
        count, codes = _codes(codes)
    first = np.empty(count, np.intp)
    first[codes[::-1]] = np.arange(size - 1, -1, -1)  # the last assignment holds
    return first, codes.astype(np.int32)


def _codes(values: NDArray[np.int64]) -> tuple[int, NDArray[np.intp]]:
    """Return how many distinct values there are and the rank of each."""
    ordered = np.sort(values)
    distinct = ordered[np.concatenate(([True], ordered[1:] != ordered[:-1]))]
    if len(distinct) <= 1024:  # searching a small table is faster than sorting indices, a large one slower
        return len(distinct), np.searchsorted(distinct, values)
    del ordered
    return len(distinct), np.unique(values, return_inverse=True)[1]
