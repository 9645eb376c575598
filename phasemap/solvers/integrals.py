"""Integrals over solved orbits: work of the attraction, storage of the contact, slope of the force, harmonics."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels import columns as col
from phasemap._kernels.columns import AT_REST, IN_LOOP, LOSS_HARMONICS, NOT_DRIVEN, WIDE, SolvedRows
from phasemap._kernels.orbits.orbit_nodes import KEEPING, KEPT_COUNT
from phasemap._kernels.quadrature import TABLES
from phasemap._shared.arrays import Array
from phasemap.experiment.lever import of_tip
from phasemap.experiment.microscope import Microscope
from phasemap.results.variables import HARMONICS, MODAL, OF_ADHESION, OF_FORCES
from phasemap.solvers.problem import Work

NONE = np.zeros((1, 0))  # rows with nodes


def bare_rows(stiffness: Array, scope: Microscope, film: Array | None = None) -> Array:
    """Parameter rows of the same contacts without adhesion, damping and bias, shape (n, 16)."""
    none = np.zeros_like(stiffness)
    return replace(scope.interaction, bias=0.0).columns(stiffness, none, none, scope.tip.radius, film)


def with_adhesion(rows: Array, work: Work, used: NDArray[np.int8], bare: Array, *, kept: Array = NONE) -> Array:
    """Result rows with virial and loss of the attraction, and with the storage of the contact without it [J].

    The attraction is the force less that of the same contact without adhesion and bias (`bare_rows`). All are good to
    0.1 %. Where the orbit was averaged it is taken as harmonic. `rows` (shape (..., n, COLUMNS or WIDE)) are as the
    detector sees them, made by the solvers `used`; `kept` (shape (n, KEEPING)) are rows with nodes of the same orbits.
    NaN where there is no periodic orbit.
    """
    from phasemap._kernels.rows.by_collocation import adhesion_rows

    def fill(solved: SolvedRows) -> None:
        adhesion_rows(work.pixels, TABLES, bare, solved)

    return _along(rows, work, used, kept, fill)


def with_forces(
    rows: Array, work: Work, used: NDArray[np.int8], *, second: int = NOT_DRIVEN, harmonics: int = col.HARMONICS,
    kept: Array = NONE,
) -> Array:  # fmt: skip
    """Result rows with the mean slope of the force [N/m], the mean damping [1], harmonics [m] and losses of modes [J].

    All are good to 0.1 % of the largest harmonic, however hard the tap. Where the orbit was averaged it is taken as
    harmonic about its deepest point, which in air is good to 1 %. Arguments as for `with_adhesion`; `second` says
    whether the second mode is driven, and how: then there is too what its sidebands do to it.
    """
    from phasemap._kernels.rows.by_collocation import force_rows

    def fill(solved: SolvedRows) -> None:
        force_rows(work.pixels, TABLES, second, solved, harmonics)

    return _along(rows, work, used, kept, fill)


def widened(
    rows: Array, work: Work, used: NDArray[np.int8], scope: Microscope, bare: Callable[[], Array],
    names: Collection[str],
) -> Array:  # fmt: skip
    """Result rows, maybe with nodes, with what variables of these names need besides; the same rows if nothing."""
    kept = NONE
    if rows.shape[-1] == KEEPING:
        rows[used == col.AVERAGING, KEPT_COUNT] = 0  # an averaged orbit in place of that which told the branch
        kept, rows = rows, rows[:, : col.COLUMNS]
    if not set(OF_ADHESION).isdisjoint(names):
        rows = with_adhesion(rows, work, used, bare(), kept=kept)
    if not set(OF_FORCES).isdisjoint(names):
        losses, waves = ({*some}.isdisjoint(names) for some in (MODAL, HARMONICS))
        harmonics = LOSS_HARMONICS if not losses else 0 if waves else col.HARMONICS
        driven = scope.drive.second
        second = NOT_DRIVEN if driven is None else IN_LOOP if driven.detection == "fm" else AT_REST
        rows = with_forces(rows, work, used, second=second, harmonics=harmonics, kept=kept)
    return rows


def _along(rows: Array, work: Work, used: NDArray[np.int8], kept: Array, fill: Callable[[SolvedRows], None]) -> Array:
    """Wide rows that a kernel fills where amplitude and phase are the tip's, and then are as the detector has them."""
    wide = np.full((*rows.shape[:-1], WIDE), np.nan)
    wide[..., : rows.shape[-1]] = rows
    wide[..., col.AMPLITUDE], wide[..., col.PHASE] = of_tip(work.lever, rows[..., col.AMPLITUDE], rows[..., col.PHASE])
    for part, codes in zip(wide.reshape(-1, *wide.shape[-2:]), used.reshape(-1, used.shape[-1]), strict=True):
        fill(SolvedRows(part, codes == col.AVERAGING, kept))
    for column in (col.AMPLITUDE, col.PHASE):
        wide[..., column] = rows[..., column]
    return wide
