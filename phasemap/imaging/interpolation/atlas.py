"""An atlas, all interpolants over the materials of an image and where each holds, as plain arrays; its evaluation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels.materials.interpolate import Series, Tree, locate, sum_series
from phasemap._shared.arrays import Array
from phasemap.imaging.interpolation.borders import Border
from phasemap.imaging.interpolation.cells import Piece

Ints = NDArray[np.int64]

REST = 1e-8  # coefficients of a border that are left out, over the largest


@dataclass(frozen=True, eq=False)
class Atlas:
    """Interpolants over materials, as `phasemap._kernels.materials.interpolate` reads them."""

    tree: Tree
    series: Series
    errors: Array  # shape (pieces, 2); estimated in each piece, of height [m] and phase [rad]

    @classmethod
    def of(
        cls,
        nodes: Sequence[Sequence[int]],
        values: Sequence[float],
        borders: Sequence[Border],
        pieces: Sequence[Piece],
    ) -> Atlas:
        """Pack the parts of an atlas."""
        number = {id(border): i for i, border in enumerate(borders)}
        ends = np.zeros((len(pieces), 2))
        end_borders = np.full((len(pieces), 2), -1, np.int64)
        for i, piece in enumerate(pieces):
            for j, end in enumerate((piece.cell.lower, piece.cell.upper)):
                if isinstance(end, Border):
                    end_borders[i, j] = number[id(end)]
                else:
                    ends[i, j] = end
        tables = [_without_rest(border.coefficients) for border in borders]
        kinds, numbers, below, above = np.array(nodes, np.int64).reshape(-1, 4).T.copy()
        tree = Tree(
            kinds,
            numbers,
            below,
            above,
            np.array(values, np.float64),
            np.array([border.box for border in borders], np.float64).reshape(-1, 2, 2),
            np.array([table.shape for table in tables], np.int64).reshape(-1, 2),
            np.cumsum([0, *(table.size for table in tables)]).astype(np.int64),
            _joined([table.reshape(-1) for table in tables], np.float64),
            np.array([piece.cell.box for piece in pieces], np.float64).reshape(-1, 3, 2),
            ends,
            end_borders,
            np.array([piece.cell.form for piece in pieces], np.int64),
        )
        errors = np.array([piece.errors for piece in pieces], np.float64).reshape(-1, 2)
        return cls(tree, _packed(pieces), errors)

    @property
    def pieces(self) -> int:
        """How many interpolants there are."""
        return len(self.errors)

    def __call__(self, points: Array, wanted: Ints) -> tuple[NDArray[np.int32], Array]:
        """Piece of every point, shape (3, n), -1 where there is none, and functions `wanted`, shape (wanted, n)."""
        count = points.shape[1]
        piece, inside = np.empty(count, np.int32), np.empty((3, count))
        out = np.full((len(wanted), count), np.nan)
        locate(points, self.tree, piece, inside)
        sum_series(piece, inside, wanted, self.series, out)
        return piece, out


def _without_rest(table: Array) -> Array:
    """Coefficients of a border without what is negligible at the end of either coordinate."""
    rows, columns = (np.flatnonzero((abs(table) > REST * abs(table).max()).any(axis=1 - axis)) for axis in (0, 1))
    return table[: rows[-1] + 1, : columns[-1] + 1] if len(rows) else table[:1, :1]


def _packed(pieces: Sequence[Piece]) -> Series:
    """Series of each piece, without the negligible coefficients at the end along u."""
    count = pieces[0].coefficients.shape[-1] if pieces else 0
    sizes = np.array([piece.coefficients.shape[:3] for piece in pieces], np.int64).reshape(-1, 3)
    length_starts, starts = np.zeros((len(pieces), count), np.int64), np.zeros((len(pieces), count), np.int64)
    lengths: list[Array] = []
    kept: list[Array] = []
    at_length = at = 0
    for i, piece in enumerate(pieces):
        for f in range(count):
            table = piece.coefficients[..., f].reshape(-1, sizes[i, 2])
            length = np.where(table != 0, np.arange(1, sizes[i, 2] + 1), 0).max(axis=1)
            part = table[np.arange(sizes[i, 2]) < length[:, None]]
            length_starts[i, f], starts[i, f] = at_length, at
            lengths.append(length)
            kept.append(part)
            at_length, at = at_length + len(length), at + len(part)
    return Series(sizes, length_starts, _joined(lengths, np.int64), starts, _joined(kept, np.float64))


def _joined(parts: Sequence[Array], dtype: type) -> Array:
    return np.concatenate([np.zeros(0), *parts]).astype(dtype)
