"""Test whether code compiled here has the numbers of numba's own compiler: a small kernel, both ways.

A version of numba may keep the names of the parts that are replaced here, and change what they mean. So once for each
version a kernel that has what kernels consist of is compiled both ways; a file beside the compiled code says that its
numbers were the same.
"""

from __future__ import annotations

import contextlib
import hashlib
import pathlib
from collections.abc import Callable
from types import FunctionType
from typing import Any

import numpy as np
from numba.core.caching import NullCache

from phasemap._kernels.compilation import disk_cache, private_files

ROUNDING = 1e-12  # products and sums may be fused otherwise


def in_part(row: np.ndarray, pair: tuple[float, float]) -> tuple[float, float]:
    """A part of a row, and numbers in a tuple."""
    low, high = pair
    for value in row:
        if value > high:
            high = value
    return low - row[len(row) - 1], high


def emitted_once(table: np.ndarray, i: int) -> float:
    """A shared function: a product of elements of a row."""
    row = table[i]
    return float(row[0] * row[1] - table[i, 2])


def filled(count: int, value: float) -> np.ndarray:
    """Probe: a new array that a function returns."""
    made = np.empty(count)
    for i in range(count):
        made[i] = value * i
    return made


def whole(table: np.ndarray, first: int, pair: tuple[float, float]) -> tuple[float, np.ndarray]:
    """An entry: rows are changed, and what was made by a call is returned."""
    total = 0.0
    for i in range(first, table.shape[0]):
        row = table[i]
        row[0] += pair[0] * row[1]
        low, high = in_part(row[1:], pair)
        total += low * high + emitted_once(table, i)
    made = filled(3, total)
    return total - made[1] / 3, made


def agrees_with_numba(entry: Callable[[Any], Any], shared: Callable[[Any], Any], plain: Callable[[Any], Any]) -> bool:
    """True if the small kernel has the same numbers compiled as entries and shared functions, and by numba alone."""
    name = f"agrees-{disk_cache.versions()}.{_digest()}"
    place = disk_cache.folder()
    if place is not None and (place / name).exists():
        return True
    try:
        ours, numbas = _probe_numbers(entry, shared), _probe_numbers(plain, plain)
    except Exception:  # of whatever kind numba's are
        return False
    if not np.allclose(ours, numbas, rtol=ROUNDING, atol=0.0):
        return False
    if place is not None:
        with contextlib.suppress(OSError):  # another process was faster, or there is no space
            private_files.write(place / name, b"")
    return True


def _probe_numbers(entry: Callable[[Any], Any], shared: Callable[[Any], Any]) -> np.ndarray:
    """Compile the small kernel anew and run it; returns its results and the table that it changed."""
    scope = dict(globals())
    for function, wrapped in ((in_part, entry), (emitted_once, shared), (filled, entry), (whole, entry)):
        made = wrapped(FunctionType(function.__code__, scope, function.__name__))
        for one in (made, getattr(made, "linked", made)):
            one._cache = NullCache()
        scope[function.__name__] = made
    table = np.sin(np.arange(12.0)).reshape(4, 3)
    total, made = scope["whole"](table, 1, (0.3, 0.7))
    return np.concatenate([[total], made, table.ravel()])


def _digest() -> str:
    """Digest of the sources of this folder."""
    sources = sorted(pathlib.Path(__file__).parent.glob("*.py"))
    return hashlib.sha256(b"\0".join(one.read_bytes() for one in sources)).hexdigest()[:16]
