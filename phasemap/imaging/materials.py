"""Materials of an image: which there are, and which are the same, found part by part and in bounded memory.

A survey goes once over the surface and says how large and how varied it is. Surveys of parts are joined in any order,
and those of the parts of an image say the same as that of the whole.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels.materials.distinct import add_distinct_rows, look_up
from phasemap._shared.arrays import Array, is_lazy, is_uniform
from phasemap._shared.errors import InputError, Word
from phasemap._shared.threads import bounds_of, found_in
from phasemap.experiment.material_rows import PLAIN
from phasemap.experiment.surface import Surface

BLOCK = 1 << 15  # pixels that are worked on together


def films_alike(surface: Surface) -> bool:
    """True if no pixel is a film, or all are of one thickness and Poisson's ratio; of Dask arrays that is not known."""
    films = () if surface.thickness is None else (surface.thickness, surface.poisson_ratio)
    return all(not is_lazy(one) and is_uniform(one) for one in films)


class Distinct:
    """A set of materials of at most `most` members."""

    def __init__(self, most: int) -> None:
        # A hash table that stays half empty; members have as many numbers as the first ones.
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
        self._count, taken = add_distinct_rows(_bits(materials), self._table, self._known, self._count)
        return int(taken)

    def numbers(self, materials: Array) -> NDArray[np.int32]:
        """Number of the member that each material is."""
        out = np.empty(len(materials), np.int32)
        look_up(_bits(materials), self._table, self._known, out)
        if (out < 0).any():
            hint = "What is random needs a seed; surface.compute() or persist() keep what was computed."
            raise InputError("surface", Word("not the same"), "maps that are the same whenever they are computed", hint)
        return out


def _bits(materials: Array) -> NDArray[np.uint64]:
    """The same numbers as bits: to be told apart exactly, NaN as well."""
    return np.ascontiguousarray(materials).view(np.uint64)


SAMPLE = 1 << 16  # pixels that are drawn from an image


class Window(NamedTuple):
    """Place of a part in an image."""

    # row, column: of its first pixel
    row: int
    column: int
    image: tuple[int, int]  # rows and columns of the whole

    def drawn(self, shape: tuple[int, int]) -> NDArray[np.intp]:
        """Pixels of a part of this shape that are among those drawn from the whole image, each once."""
        (ny, nx), (height, width) = self.image, shape
        pixels = _drawn(ny * nx)
        first, last = np.searchsorted(pixels, [self.row * nx, (self.row + height) * nx])
        rows, columns = np.divmod(pixels[first:last], nx)
        rows, columns = rows - self.row, columns - self.column
        inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
        return np.asarray(rows[inside] * width + columns[inside], np.intp)


@lru_cache(maxsize=4)
def _drawn(pixels: int) -> NDArray[np.int64]:
    """Numbers of the pixels that are drawn from so many, in order; the same for all parts of an image."""
    return np.unique(np.random.default_rng(0).integers(0, pixels, SAMPLE))


@dataclass(frozen=True, eq=False)
class Survey:
    """Materials of a surface, or of a part of it."""

    # shape (n, 4) or (n, 10), or None; the distinct ones, as `Surface.unique` gives them; None if there are more
    # than were asked for
    materials: Array | None
    # shape (m, 4) or (m, 10); those of the drawn pixels that have one, each once and in order; of no interest
    # where the whole has few
    sample: Array
    pixels: int  # of the surface or part, with or without a material

    @property
    def count(self) -> int:
        """Number of distinct materials; where that is not known, of pixels."""
        return self.pixels if self.materials is None else len(self.materials)

    def joined(self, other: Survey, most: int) -> Survey:
        """The survey of both parts together, with at most so many distinct materials."""
        sample, pixels = _each_once(np.concatenate([self.sample, other.sample])), self.pixels + other.pixels
        if self.materials is not None and other.materials is not None:
            known = Distinct(most)
            both = np.concatenate([self.materials, other.materials])
            if known.add(both) == len(both):
                return Survey(known.materials.copy(), sample, pixels)
        return Survey(None, sample, pixels)


def survey(surface: Surface, most: int, place: Window | None = None, workers: int = 1) -> Survey:
    """Look at the materials of a surface, or of the part of one that lies in `place`, at all of them up to `most`."""
    materials, pixels = _all_of_few(surface, most, workers), surface.shape[0] * surface.shape[1]
    if place is None and materials is not None:
        return Survey(materials, np.empty((0, materials.shape[1])), pixels)
    where = place or Window(0, 0, surface.shape)
    return Survey(materials, _each_once(surface.materials(where.drawn(surface.shape))), pixels)


def _all_of_few(surface: Surface, most: int, workers: int) -> Array | None:
    """Distinct materials in the order in which they come, or None if there are more than so many."""
    pixels = surface.shape[0] * surface.shape[1]
    if surface.found is not None and len(surface.found[0]) <= most:
        materials, numbers = surface.found
        seen = np.zeros(len(materials), np.bool_)
        for part in _parts(0, pixels):
            seen[numbers.reshape(-1)[part]] = True
        return materials if seen.all() else materials[seen]  # some rows of a surface may not have all

    def few_in(first: int, last: int) -> Array | None:
        known = Distinct(min(most, last - first))
        taken = all(known.add(some) == len(some) for some in map(surface.materials, _parts(first, last)))
        return known.materials.copy() if taken else None

    a_thread = max(BLOCK, -(-pixels // workers))
    parts = found_in(few_in, bounds_of(pixels, a_thread), workers)
    if len(parts) == 1:
        return parts[0]
    known = Distinct(min(most, pixels))
    taken = all(some is not None and known.add(some) == len(some) for some in parts)
    return known.materials.copy() if taken else None


def _parts(first: int, last: int) -> list[slice]:
    """Slices of BLOCK pixels at most, from `first` to `last`."""
    return [slice(start, min(start + BLOCK, last)) for start in range(first, last, BLOCK)]


def _each_once(materials: Array) -> Array:
    """Rows of materials in order, each once, without those of pixels without one."""
    has_material = np.isfinite(materials[:, :PLAIN]).all(axis=1) & ~np.isnan(materials).any(axis=1)
    finite = materials[has_material] + 0.0  # -0 is 0
    ordered = finite[np.lexsort(finite.T[::-1])]
    differs = np.ones(len(ordered), np.bool_)
    differs[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    return ordered[differs]
