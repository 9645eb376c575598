"""From materials and microscope to the arrays that kernels read. Units, None and names stop here."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from phasemap._kernels import columns as col
from phasemap._shared.checks import number
from phasemap._shared.errors import InputError
from phasemap._shared.plausible import question
from phasemap.experiment.lever import lever_of
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Microscope
from phasemap.experiment.properties import film_of, properties

if TYPE_CHECKING:
    from phasemap._kernels.law import Law

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Work:
    """Distinct pixels, ready for a solver.

    Parameters
    ----------
    law : Law
        The formulas of the interaction.
    rows : ndarray, shape (n, 12)
        Their parameters, one row a pixel.
    lever : ndarray, shape (5,)
        See `phasemap.experiment.lever.lever_of`.
    amplitudes : ndarray, shape (n,)
        Setpoint amplitude of each pixel [m], as the detector sees it.
    """

    law: Law
    rows: Array
    lever: Array
    amplitudes: Array

    def __len__(self) -> int:
        return len(self.rows)

    def part(self, chosen: Array, amplitudes: Array | None = None) -> Work:
        """Work of some of the pixels, at their setpoint amplitudes or at other ones."""
        wanted = self.amplitudes[chosen] if amplitudes is None else amplitudes
        return Work(self.law, np.ascontiguousarray(self.rows[chosen]), self.lever, wanted)

    def refused(self) -> Array:
        """Status codes (int8): GOOD where there is something to solve, or what a mark of `Interaction.columns` says."""
        creates = np.isneginf(self.rows[:, col.RELEASE])
        solvable = np.isfinite(self.rows).all(axis=1)
        return np.where(solvable, col.GOOD, np.where(creates, col.CREATES_ENERGY, col.INVALID)).astype(np.int8)


LEAST_USUAL = 1e-3  # setpoint used in practice; an amplitude in metres is far below


def check_setpoint(setpoint: object) -> float:
    """Return the setpoint as a float.

    Raises
    ------
    InputError
        If it is not a number between 0 and 1.
    """
    try:
        found = number("setpoint", setpoint, "1", above=0, below=1)
    except InputError:
        allowed = "a number above 0 and below 1 (the amplitude over the free amplitude at the drive frequency)"
        raise InputError("setpoint", setpoint, allowed) from None
    question("setpoint, a share of the free amplitude,", found, "1", (LEAST_USUAL, 1.0))
    return found


def work_of(
    stiffness: Array,
    adhesion: Array,
    damping: Array,
    scope: Microscope,
    amplitude: float | Array,
    film: Array | None = None,
) -> Work:
    """Work of what `properties` and `film_of` give, at setpoint amplitudes [m]."""
    rows = scope.interaction.columns(stiffness, adhesion, damping, scope.tip.radius, film)
    amplitudes = np.array(np.broadcast_to(amplitude, (len(rows),)), dtype=np.float64)
    return Work(scope.interaction.token(), rows, lever_of(scope), amplitudes)


def make_work(materials: Array, viscous: bool, scope: Microscope, amplitudes: float | Array) -> Work:
    """Turn materials into work.

    Parameters
    ----------
    materials : ndarray, shape (n, 4) or (n, 5)
        As for `properties`.
    viscous : bool
    scope : Microscope
    amplitudes : float or ndarray, shape (n,)
        Setpoint amplitudes [m].
    """
    return work_of(*properties(materials, viscous, scope), scope, amplitudes, film_of(materials))


def work_of_material(material: Material, scope: Microscope, amplitude: float) -> Work:
    """Work of one material, at a setpoint amplitude [m].

    Raises
    ------
    InputError
        If the laws of interaction cannot have this material.
    """
    row, viscous = material_row(material)
    stiffness, adhesion, _ = properties(row, viscous, scope)
    scope.interaction.check(float(stiffness[0]), float(adhesion[0]), scope.tip.radius, film_of(row))
    return make_work(row, viscous, scope, amplitude)


def material_row(material: Material) -> tuple[Array, bool]:
    """The row of one material for `make_work`, and whether it is viscous."""
    return material_rows([material])


def material_rows(materials: Iterable[Material]) -> tuple[Array, bool]:
    """The rows of materials that are all viscous or none, for `make_work`, and whether they are."""
    every = list(materials)
    viscous = any(one.viscosity is not None for one in every)
    rows = [[one.modulus, one.adhesion, one.viscosity if viscous else one.damping, one.poisson_ratio] for one in every]
    if any(one.thickness is not None for one in every):
        for row, one in zip(rows, every, strict=True):
            row.append(math.inf if one.thickness is None else one.thickness)
    return np.array(rows, dtype=np.float64), viscous
