"""Materials as rows of numbers: modulus, adhesion, loss, Poisson's ratio, and where some material has it more."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.arrays import Array, IntArray, is_uniform, read_only
from phasemap.experiment.material import Material
from phasemap.experiment.prony import Prony, spectrum_of

PLAIN = 4
"""Columns of materials that have nothing more: modulus [Pa], adhesion [J/m2], damping [1] or viscosity [Pa s],
Poisson's ratio [1]."""

MORE_NUMBERS = ("thickness", "relaxed_modulus", "relaxation_time", "liquid_film", "contact_angle")
MORE = (*MORE_NUMBERS, "relaxation")
"""What the other columns are, which are all there or none: [m], [Pa], [s], [m], [degree], key of a spectrum;
infinite where a material has none, but the relaxed modulus is then the modulus."""


def column_of(materials: Array, name: str) -> Array | None:
    """One of `MORE` of rows of materials; None where no material has it."""
    if materials.shape[1] == PLAIN:
        return None
    column: Array = materials[:, PLAIN + MORE.index(name)]
    return column if np.isfinite(column).any() else None


def rows_of(materials: Iterable[Material]) -> tuple[Array, bool]:
    """The rows of materials that are all viscous or none, shape (n, 4) or (n, 10), and whether they are."""
    every = list(materials)
    viscous = any(one.viscosity for one in every)
    rows = [
        [one.modulus, one.adhesion, (one.viscosity or 0.0) if viscous else one.damping, one.poisson_ratio]
        for one in every
    ]
    if any(getattr(one, name) is not None for one in every for name in MORE):
        for row, one in zip(rows, every, strict=True):
            none = {"relaxed_modulus": one.modulus}
            row += [none.get(name, math.inf) if (own := getattr(one, name)) is None else own for name in MORE_NUMBERS]
            row.append(one.relaxation.key if isinstance(one.relaxation, Prony) else math.inf)
    return np.array(rows, dtype=np.float64), viscous


def more_of(columns: Sequence[Any]) -> dict[str, Any]:
    """Those of `MORE` that some material has, of columns that are numbers or maps; spectra by their keys."""
    found = {name: one for name, one in zip(MORE, columns, strict=False) if np.ndim(one) or math.isfinite(one)}
    if "relaxation_time" not in found:
        found.pop("relaxed_modulus", None)
    return found


def materials_of(rows: Array, viscous: bool) -> list[Material]:
    """The materials that have these rows: the inverse of `rows_of`."""
    found = []
    for modulus, adhesion, loss, poisson_ratio, *rest in rows.tolist():
        more = more_of(rest)
        if "relaxation" in more:
            more["relaxation"] = spectrum_of(more["relaxation"])
        more["viscosity" if viscous else "damping"] = loss
        found.append(Material(modulus, adhesion, poisson_ratio=poisson_ratio, **more))
    return found


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
