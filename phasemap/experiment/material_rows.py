"""Materials as rows of numbers: modulus, adhesion, loss, Poisson's ratio, and where some material has it more."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from phasemap.experiment.material import Material
from phasemap.experiment.prony import Prony

Array = np.ndarray

PLAIN = 4
"""Columns of materials that have nothing more: modulus [Pa], adhesion [J/m2], damping [1] or viscosity [Pa s],
Poisson's ratio [1]."""

MORE_NUMBERS = ("thickness", "relaxed_modulus", "relaxation_time", "liquid_film", "contact_angle")
MORE = (*MORE_NUMBERS, "relaxation")
"""What the other columns are, which are all there or none: [m], [Pa], [s], [m], [degree], key of a spectrum;
infinite where a material has none, but the relaxed modulus is then the modulus."""


def column_of(materials: Array, name: str) -> Array | None:
    """One of `MORE` of rows of materials; None where no material has it.

    Examples
    --------
    >>> rows, _ = rows_of([Material(1e9), Material(1e9, thickness=5e-9)])
    >>> column_of(rows, "thickness").tolist(), column_of(rows, "liquid_film")
    ([inf, 5e-09], None)
    """
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
            if isinstance(one.relaxation, Prony):
                none["relaxation"] = one.relaxation.key
            row += [
                none.get(name, math.inf) if name == "relaxation" or (own := getattr(one, name)) is None else own
                for name in MORE
            ]
    return np.array(rows, dtype=np.float64), viscous


def materials_of(rows: Array, viscous: bool) -> list[Material]:
    """The materials that have these rows: the inverse of `rows_of`.

    Examples
    --------
    >>> film, solid = Material(1e9, thickness=5e-9), Material(2e9, relaxed_modulus=1e9, relaxation_time=1e-7)
    >>> materials_of(*rows_of([film, solid])) == [film, solid]
    True
    """
    found = []
    for modulus, adhesion, loss, poisson_ratio, *rest in rows.tolist():
        more = {name: one for name, one in zip(MORE, rest, strict=False) if math.isfinite(one)}
        if "relaxation_time" not in more:
            more.pop("relaxed_modulus", None)
        more["viscosity" if viscous else "damping"] = loss
        found.append(Material(modulus, adhesion, poisson_ratio=poisson_ratio, **more))
    return found
