"""Integrals of the force over c for every image of a stack: theory, Eq. (inversion-2)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels.columns import DRIVE
from phasemap._kernels.law import Law
from phasemap._kernels.rows.tabulated import (
    AXES,
    FIRST_OCTAVE,
    LAST_OCTAVE,
    OCTAVE_SHARES,
    PARTS,
    TABLE_INTERVALS,
    TABLE_MEAN,
    TABLE_SUMS,
    TABLE_TERMS,
    Table,
    harmonics_rows,
)

Array = NDArray[np.float64]

WRONG = 1e-9  # of an integral, above which an interval is left out
MOST = 0.9  # of the intervals hold for a law that is affine; for another, those where it has no force
SMALL = 1e-3  # of the amplitude, below which a mean deflection need not be better than this share of it
NODES = np.cos((np.arange(TABLE_TERMS) + 0.5) * np.pi / TABLE_TERMS)  # in an interval
CHECKED = np.array([-0.93, 0.11, 0.97])  # where the table is compared with the integrals


class Axes(NamedTuple):
    """Along which materials differ: stiffness, adhesion and damping, in units of their change at the reference."""

    columns: NDArray[np.intp]  # shape (AXES,); column of the kernels' rows that tells the place along an axis
    origin: Array  # shape (AXES,); its value for the reference
    units: Array  # shape (AXES,); what it changes by a unit; 0 where the law does not ask for a property

    def along(self, rows: Array) -> Array:
        """Places of the materials of these rows, shape (n, AXES)."""
        moved = np.ascontiguousarray(rows[:, self.columns]) - self.origin
        return np.divide(moved, self.units, out=np.zeros_like(moved), where=self.units != 0)


class Tables(NamedTuple):
    """Table of the integrals, and the axes that it is for."""

    table: Table
    axes: Axes


def make_tables(law: Law, rows: Array, levers: Array, amplitudes: Array) -> Tables | None:
    """Tables for a law that is affine in what materials change; None for another law.

    Whether it is, and where polynomials do, is told by the integrals of other materials at other places.

    Parameters
    ----------
    law : Law
    rows : ndarray, shape (1 + AXES + checks, ROW)
        Parameters of a reference, of it with each property changed, and of materials to compare with.
    levers, amplitudes : ndarray, shape (m, numbers of a lever), (m,)
        Of images whose detector sees the tip.
    """
    columns = np.argmax(rows[1 : 1 + AXES] != rows[0], axis=1)
    axes = Axes(columns, rows[0, columns], rows[np.arange(1, 1 + AXES), columns] - rows[0, columns])
    ends = np.concatenate(
        [
            [0.0],
            np.ldexp(
                1 + np.arange(OCTAVE_SHARES) / OCTAVE_SHARES, np.arange(FIRST_OCTAVE, LAST_OCTAVE)[:, None]
            ).ravel(),
        ]
    )
    widths = np.diff(ends, append=2.0**LAST_OCTAVE)
    table = Table(
        np.empty((len(levers), 2, TABLE_INTERVALS, TABLE_TERMS, PARTS)),
        np.empty((len(levers), 2, TABLE_INTERVALS), np.bool_),
        np.stack([ends + 0.5 * widths, 2.0 / widths], axis=1), np.empty(len(levers)),
    )  # fmt: skip
    for image, (lever, amplitude) in enumerate(zip(levers, amplitudes, strict=True)):
        _fill(table, image, law, rows, axes, lever, float(amplitude))
    return Tables(table, axes) if table.sound.mean() > MOST else None


def _fill(table: Table, image: int, law: Law, rows: Array, axes: Axes, lever: Array, amplitude: float) -> None:
    """Integrate at one amplitude, fit the polynomials, and see where they hold."""
    x = table.spans[:, :1] + np.concatenate([NODES, CHECKED]) / table.spans[:, 1:]
    sums = np.empty((len(rows), 2 * x.size, TABLE_SUMS))
    table.reaches[image] = harmonics_rows(
        law, rows, lever, amplitude, np.concatenate([1.0 - x.ravel(), 1.0 + x.ravel()]), sums
    )
    sums = sums.reshape(len(rows), 2, *x.shape, TABLE_SUMS)
    parts = np.concatenate(
        [sums[:1], sums[1 : 1 + AXES] - sums[0]]
    )  # (1 + AXES, 2, TABLE_INTERVALS, nodes, TABLE_SUMS)
    to_powers = np.linalg.inv(np.vander(NODES, increasing=True))
    powers = np.einsum("tn,asknv->sktav", to_powers, parts[..., :TABLE_TERMS, :])
    table.coefficients[image] = powers.reshape(2, TABLE_INTERVALS, TABLE_TERMS, PARTS)
    weights = np.concatenate([np.ones((len(rows), 1)), axes.along(rows)], axis=1)
    told = np.einsum(
        "ra,nt,sktav->rsknv", weights, np.vander(CHECKED, TABLE_TERMS, increasing=True), powers, optimize=True
    )
    size = np.einsum("ra,asknv->rsknv", np.abs(weights), np.abs(parts[..., TABLE_TERMS:, :]))
    size += lever[DRIVE]
    size[..., TABLE_MEAN] += SMALL * amplitude - lever[DRIVE]
    table.sound[image] = (np.abs(told - sums[..., TABLE_TERMS:, :]) < WRONG * size).all(axis=(0, 3, 4))
