"""Maps of labels: the material of each looked up for every pixel, and how much materials vary within their domains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.arrays import Array, IntArray, as_array, lazy_map, read_only
from phasemap._shared.checks import whole
from phasemap._shared.errors import InputError, Word
from phasemap._shared.fields import Number, Shown, known_as
from phasemap.experiment.generate.waves import roughness
from phasemap.experiment.material import Material
from phasemap.experiment.material_rows import factorise, more_of, rows_of
from phasemap.experiment.surface_maps import check_room, where

LARGEST = 2.0**53  # up to which floats tell all whole numbers apart


def looked_up(labels: Any, materials: Any) -> tuple[dict[str, Any], tuple[Array, IntArray]]:
    """Look up the material of every pixel; both arguments as `phasemap.Surface.from_labels` takes them.

    Returns the arguments of `phasemap.Surface` that make up a material, arrays, or one number where all are the same;
    and the distinct materials as `phasemap.Surface.unique` gives them.
    """
    label_map = _whole_numbers(labels)
    names, table, viscous = _material_table(materials)
    index = _positions(label_map, names)
    used = np.bincount(index.reshape(-1), minlength=len(names)) > 0
    first, merged = factorise(list(table[used].T))
    renumber = np.full(len(names), -1, np.int32)
    renumber[used] = merged
    rows, inverse = read_only(table[used][first]), read_only(renumber[index])
    columns = [column[0] if (column == column[0]).all() else read_only(column[inverse]) for column in rows.T]
    return _named(columns, viscous), (rows, inverse)


def lazily_looked_up(labels: Any, materials: Any) -> dict[str, Any]:
    """Look up the materials of a Dask array of labels, as `looked_up` does, when a block of it is computed."""
    labels = lazy_map("labels", labels, int)
    names, table, viscous = _material_table(materials)
    columns = [
        column[0] if (column == column[0]).all() else labels.map_blocks(_of_labels, names, column, dtype=np.float64)
        for column in table.T
    ]
    return _named(columns, viscous)


def _named(columns: Sequence[Any], viscous: bool) -> dict[str, Any]:
    """Columns of a material as arguments of a surface."""
    modulus, adhesion, loss, poisson_ratio, *rest = columns
    maps = {"modulus": modulus, "adhesion": adhesion, "poisson_ratio": poisson_ratio}
    return {**maps, "viscosity" if viscous else "damping": loss, **more_of(rest)}


def _whole_numbers(labels: Any) -> NDArray[Any]:
    """The labels as a 2-D array of whole numbers, or of bool."""
    if np.ma.is_masked(labels):
        count = int(np.ma.getmaskarray(labels).sum())
        hint = "labels.filled(N) gives them one."
        raise InputError("map of labels", Word(f"masked in {count} pixels"), "a label in every pixel", hint)
    label_map = as_array("labels", labels, "a 2-D map of whole numbers")
    if label_map.ndim != 2 or not label_map.size:
        raise InputError("shape of labels", label_map.shape, "(rows, columns) of a 2-D map")
    check_room("labels", label_map, 36)  # measured, with three maps that are not uniform
    if label_map.dtype.kind == "f" and (np.abs(label_map) < LARGEST).all() and not (label_map % 1).any():
        label_map = label_map.astype(np.int64)
    if label_map.dtype.kind not in "iub":
        hint = "Try labels.astype(int)."
        if label_map.dtype.kind in "SUO":
            hint = "Number the names: names, numbers = numpy.unique(labels, return_inverse=True)."
        raise InputError("type of labels", label_map.dtype.name, "whole numbers", hint)
    return label_map


def _material_table(materials: Mapping[int, Material] | Sequence[Material]) -> tuple[list[int], Array, bool]:
    """Return the labels in order, one row a material as `Surface.unique` has them, and whether some are viscous."""
    labelled = _labelled(materials)
    table, viscous = rows_of(labelled.values())
    return list(labelled), table, viscous


def _labelled(materials: Mapping[int, Material] | Sequence[Material]) -> dict[int, Material]:
    """Check the materials, and return them by their labels, in order."""
    if isinstance(materials, Sequence) and not isinstance(materials, (str, range)):
        materials = dict(enumerate(materials))
    if not isinstance(materials, Mapping) or not materials:
        raise InputError("materials", materials, "a dict with at least one Material, such as {0: soft, 1: hard}")
    for label, material in materials.items():
        if not isinstance(label, (int, np.integer)):
            raise InputError("label of a material", label, "a whole number")
        if not isinstance(material, Material):
            raise InputError(f"material {label}", material, "a Material")
    labelled = {int(label): materials[label] for label in sorted(materials)}
    viscous = next((label for label, m in labelled.items() if m.viscosity), None)
    damped = next((label for label, m in labelled.items() if m.damping), None)
    if viscous is not None and damped is not None:
        raise InputError(
            f"damping of material {damped}",
            labelled[damped].damping,
            f"a viscosity in its place, as material {viscous} has, or a damping there too",
            "A preset takes one: Material.preset('PS', damping=0.01). Which damping a viscosity is depends on lever "
            "and tip, which a scene knows and a surface does not.",
        )
    return labelled


def _positions(labels: NDArray[Any], names: list[int]) -> NDArray[np.intp]:
    """Return where in the sorted `names` each label is."""
    if labels.dtype.kind == "b":
        labels = labels.view(np.uint8)
    limits = np.iinfo(labels.dtype)
    fitting = [name for name in names if limits.min <= name <= limits.max]
    known = np.array(fitting, labels.dtype)
    index = np.minimum(np.searchsorted(known, labels), max(len(known) - 1, 0))
    unknown = known[index] != labels if fitting else np.ones(labels.shape, np.bool_)
    if unknown.any():
        strange = np.unique(labels[unknown]).tolist()
        shown = ", ".join(str(label) for label in strange[:5]) + (" and more" if len(strange) > 5 else "")
        raise InputError("label without a material", shown, "labels " + ", ".join(map(str, names)), where(unknown))
    return index + names.index(fitting[0])


def _of_labels(labels: NDArray[Any], names: list[int], column: Array) -> Array:
    """Values of one property for the material of each label."""
    return column[_positions(labels, names)] if labels.size else np.empty(labels.shape)


VARIED = {
    "modulus": "modulus", "relaxed_modulus": "modulus", "adhesion": "adhesion", "damping": "loss", "viscosity": "loss",
}  # fmt: skip
"""The property of a map, and the spread that it has."""


@known_as()
@dataclass(frozen=True, repr=False)
class Variation(Shown):
    """Variation of the properties of each material from place to place.

    Parameters
    ----------
    modulus : float
        Relative standard deviation of the modulus [1], >= 0 and at most 2: that of its logarithm, which is normally
        distributed around the material's own.
    adhesion : float
        The same for the adhesion.
    loss : float
        The same for damping or viscosity.
    correlation_length : float
        Over which they vary [m], one pixel or more and at most the shorter side of the surface.
    seed : int
        Of what is random, >= 0.
    """

    modulus: Number[float] = Number("1", 0.15, said="variation of the modulus", minimum=0, maximum=2)
    adhesion: Number[float] = Number("1", 0.1, said="variation of the adhesion", minimum=0, maximum=2)
    loss: Number[float] = Number("1", 0.15, said="variation of the loss", minimum=0, maximum=2)
    correlation_length: Number[float] = Number("m", 25e-9, above=0, maximum=1.0, usual=(1e-10, 1e-4))
    seed: int = 0

    def __post_init__(self) -> None:
        whole("seed", self.seed, 0)

    def of(self, maps: Mapping[str, Any], shape: tuple[int, int], sides: tuple[float, float]) -> dict[str, Any]:
        """The maps of a surface that varies so, of arguments of `Surface`; `sides`: of a pixel, (dy, dx) [m]."""
        if self.modulus and "relaxation" in maps:
            hint = "A spectrum has its own modulus; adhesion may vary."
            raise InputError("variation of the modulus", self.modulus, "0 where materials have spectra", hint)
        factors: dict[str, NDArray[np.float64] | float] = {}
        for name in ("modulus", "adhesion", "loss"):
            size, length = getattr(self, name), self.correlation_length
            # Of no other noise: labels and topography of the same seed would go with it.
            seed = int(np.random.SeedSequence([self.seed, *f"variation of {name}".encode()]).generate_state(1)[0])
            field = roughness(shape, sides, rms=1.0, correlation_length=length, seed=seed) if size else 0.0
            factors[name] = np.exp(size * field)
        return {key: value * factors[VARIED[key]] if key in VARIED else value for key, value in maps.items()}
