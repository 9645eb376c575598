"""Flattening of single maps: tilt and row offsets taken out of heights, phases brought onto one turn."""

from __future__ import annotations

import numpy as np

from phasemap._shared.errors import InputError

MOST_DEGREES = 1e9  # that can be an angle: beyond, turns are lost in rounding


def level_height(height: np.ndarray, reference: np.ndarray | None = None) -> np.ndarray:
    """Take the tilt and the row offsets out of a height image [m]; the median of the reference pixels becomes 0.

    `reference`: pixels that are meant to be level (one material, no particles); None takes all. Rows that have none
        take their offset from their neighbours.
    """
    height = finite_map("height", height)
    if reference is None:
        reference = np.ones(height.shape, bool)
    elif reference.shape != height.shape or reference.sum() < 3:
        found = reference.shape, int(reference.sum())
        raise InputError("shape and number of pixels in reference", found, f"{height.shape}, at least 3")
    return level_rows(height, reference)


def level_rows(height: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Take out the tilt along rows and the median of every row, of a map that may hold NaN where pixels do not count.

    The slope along rows is fitted within rows, so that their offsets have no part in it; along columns the medians of
    the rows hold the tilt. Rows in which no pixel counts take their offset from their neighbours.
    """
    x = np.indices(height.shape, float)[1]
    share = np.maximum(counts.sum(axis=1, keepdims=True), 1)
    along = np.where(counts, x - (x * counts).sum(axis=1, keepdims=True) / share, 0.0)
    slope = (along * np.where(counts, height, 0.0)).sum() / ((along * along).sum() or 1.0)
    flat: np.ndarray = height - slope * x
    flat -= row_medians(flat, counts)
    return flat


def row_medians(values: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Median of what counts in each row, as a column; rows without any take it from their neighbours."""
    rows = np.flatnonzero(counts.any(axis=1))
    medians = [np.median(values[row, counts[row]]) for row in rows]
    column: np.ndarray = np.interp(np.arange(len(values)), rows, medians)[:, None]
    return column


def on_one_turn(phase: np.ndarray) -> np.ndarray:
    """Bring together a phase [degree] that ran over the end of its range, such as from 179 to -179 degrees.

    It stays as it was where it spans half a turn or less, which is all that a tapping lever does. Else whole turns are
    added so that all lies within half a turn of the mean direction, on the turn where most of it was.
    """
    finite = np.isfinite(phase)
    known = phase[finite]
    if not known.size or abs(known).max() > MOST_DEGREES or np.ptp(known) <= 180:
        return phase
    mean = np.degrees(np.angle(np.exp(1j * np.radians(known)).mean()))
    turns = np.round((known - mean) / 360)
    different, pixels = np.unique(turns, return_counts=True)
    together = phase.copy()
    together[finite] -= 360 * (turns - different[pixels.argmax()])
    return together


def finite_map(name: str, values: np.ndarray) -> np.ndarray:
    """Return `values` as a finite 2-D float array."""
    array = np.asarray(values, float)
    if array.ndim != 2 or array.size == 0:
        raise InputError(f"shape of {name}", array.shape, "(rows, columns) of a 2-D map")
    if not np.isfinite(array).all():
        row, column = np.argwhere(~np.isfinite(array))[0]
        raise InputError(name, array[row, column], "finite values", f"It is at row {row}, column {column}.")
    return array
