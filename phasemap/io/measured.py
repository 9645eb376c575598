"""Measured images, prepared: one scan, level heights, phases on one turn, and materials told apart.

Thresholding is left to scikit-image, which comes with ``pip install "afm-phasemap[read]"``.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable

import numpy as np
import xarray as xr

from phasemap._shared.arrays import is_varied
from phasemap._shared.errors import FileError, InputError
from phasemap.io.gwyddion import extra

MOST_DEGREES = 1e9  # that can be an angle: beyond, turns are lost in rounding


def level_height(height: np.ndarray, reference: np.ndarray | None = None) -> np.ndarray:
    """Take tilt and offsets of rows out of a height image [m]; the median of `reference`, or of all, becomes 0."""
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
    return _without_rounding(flat, height)


def level_plane(height: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Take out a plane fitted to what counts, of a map that may hold NaN elsewhere; the median of it becomes 0."""
    plane = np.stack([np.ones(height.shape), *np.indices(height.shape, float)], axis=-1)
    flat: np.ndarray = height - plane @ np.linalg.lstsq(plane[counts], height[counts], rcond=None)[0]
    flat -= np.median(flat[counts])
    return _without_rounding(flat, height)


def _without_rounding(flat: np.ndarray, height: np.ndarray) -> np.ndarray:
    """A levelled map, 0 everywhere if all that levelling left of the height is rounding."""
    known = np.isfinite(flat)
    return flat if is_varied(flat[known], np.abs(height[known]).max()) else np.where(known, 0.0, np.nan)


def row_medians(values: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Median of what counts in each row, as a column; rows without any take it from their neighbours."""
    rows = np.flatnonzero(counts.any(axis=1))
    medians = [np.median(values[row, counts[row]]) for row in rows]
    return np.interp(np.arange(len(values)), rows, medians)[:, None]


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


APART = 3.0  # ratio of `separation_of` from which populations are of several materials
NORMAL = 1.4826  # standard deviation of a normal distribution over its median absolute deviation


def one_scan(
    image: xr.Dataset, needed: Iterable[str] = ("height", "phase"), direction: str | None = None
) -> xr.Dataset:
    """Take one direction of an image, by default the first, and see that it has what is needed.

    The attribute ``direction`` says which, where it is known.
    """
    for name in needed:
        if name not in image:
            listed = ", ".join(map(repr, _channels(image)))
            source = image.attrs.get("source", "the image")
            raise FileError(f"cannot use {source}: there is no {name} channel; it holds {listed}.")
    known = image["direction"].values.tolist() if "direction" in image.dims else [image.attrs.get("direction")]
    if direction is not None and not (isinstance(direction, str) and direction in known):
        listed = (
            "None, for the image has no directions"
            if known == [None]
            else "one that was read: " + ", ".join(map(str, known))
        )
        raise InputError("direction", direction, listed)
    if "direction" not in image.dims:
        return image
    chosen = direction or known[0]
    return image.sel(direction=chosen, drop=True).assign_attrs(direction=chosen)


def segment_phase(phase: np.ndarray, n: int) -> np.ndarray:
    """Label each pixel with one of 2 to 4 materials by its phase [degree]: 0 where it is lowest, up to n - 1.

    Rows are aligned first, so that drift and a tip change between two rows do not count as material; then a 3 x 3
    median filter and multi-level Otsu thresholds.
    """
    return align_and_segment(phase, n)[1]


def largest_first(labels: list[np.ndarray], of: int) -> list[np.ndarray]:
    """Labels of files with numbers from 0 on by the area in one file: setpoint, sign and zero of a phase leave it.

    `of`: which file; what is below 0 stays as it is.
    """
    order = np.argsort(-np.bincount(labels[of][labels[of] >= 0]), kind="stable")
    rank = np.argsort(order)
    return [np.where(one >= 0, rank[one], one) for one in labels]


def segment_height(height: np.ndarray, n: int) -> np.ndarray:
    """Label each pixel with one of 2 to 4 materials by its height [m]: 0 where it is lowest, up to n - 1.

    The tilt along rows is the median step from pixel to pixel, which edges have no part in; then as `segment_phase`.
    """
    height = finite_map("height", height)
    x = np.arange(height.shape[1])
    steps = np.median(np.diff(height, axis=1)) if len(x) > 1 else 0.0
    first = align_and_segment(1e9 * (height - steps * x), n)[1]
    parts = [first == label for label in range(n) if (first == label).any()]
    counts = np.array([part.sum(axis=1) for part in parts])  # the tilt that is left, within rows of one population
    along = sum(
        np.where(part, x - (x * part).sum(axis=1, keepdims=True) / np.maximum(own, 1)[:, None], 0.0)
        for part, own in zip(parts, counts, strict=True)
    )
    slope = float((along * height).sum() / max(float(np.square(along).sum()), 1e-300))
    return align_and_segment(1e9 * (height - slope * x), n)[1]


def separation_of(values: np.ndarray, labels: np.ndarray) -> tuple[float, float]:
    """Distance between the populations of an image: in its unit, and over the spread within them.

    Rows are aligned by their populations and noise is smoothed away, as for the labels, which count from the lowest.
    Returns the least distance between medians of neighbours, and its ratio to the spread, which is 2.5 for the halves
    of a normal distribution and 2.7 for those of an even one.
    """
    parts = [labels == label for label in np.unique(labels)]
    levels = np.zeros(labels.shape)
    for part in parts:
        levels[part] = np.median(values[part])
    smooth = smoothed(values - np.median(values - levels, axis=1, keepdims=True))
    medians = np.array([np.median(smooth[part]) for part in parts])
    off = np.concatenate([np.abs(smooth[part] - at) for part, at in zip(parts, medians, strict=True)])
    distance = float(np.diff(medians).min(initial=np.inf))
    return distance, distance / max(NORMAL * float(np.median(off)), 1e-300)


def smoothed(values: np.ndarray) -> np.ndarray:
    """Median of each pixel and its eight neighbours, mirrored at the edges: a quarter of the time of a rank filter.

    The median of nine is the middle one of: the largest least, the middle middle and the least largest of columns.
    """
    around = np.pad(values, 1, mode="symmetric")
    low, middle, high = _in_order(around[:-2], around[1:-1], around[2:])
    least, between, largest = (
        _in_order(one[:, :-2], one[:, 1:-1], one[:, 2:])[place] for one, place in ((low, 2), (middle, 1), (high, 0))
    )
    return _in_order(least, between, largest)[1]


def _in_order(first: np.ndarray, second: np.ndarray, third: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The smallest, the middle and the largest of three."""
    low, high = np.minimum(first, second), np.maximum(first, second)
    return np.minimum(low, third), np.maximum(low, np.minimum(high, third)), np.maximum(high, third)


def _channels(image: xr.Dataset) -> list[str]:
    """Names of all channels of the file, or of the variables where there was none."""
    try:
        chosen = json.loads(image.attrs.get("channels", "{}"))
        others = json.loads(image.attrs.get("other_channels", "[]"))
        return [name for names in chosen.values() for name in names] + others or [str(name) for name in image.data_vars]
    except (AttributeError, RecursionError, TypeError, ValueError):  # no list that phasemap wrote
        return [str(name) for name in image.data_vars]


def align_and_segment(phase: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Remove what changes from row to row and is not material, and label the materials as `segment_phase` does.

    A row's own median is not its offset where the share of the materials changes from row to row. So a row's offset is
    the median distance of its pixels from the level of their own population, and populations and offsets are found in
    turn, from the start that leaves the least spread within the populations. The median of the whole image is kept.
    """
    phase = finite_map("phase", phase)
    if isinstance(n, bool) or not isinstance(n, int) or not 2 <= n <= 4:
        raise InputError("number of materials", n, "2 to 4")
    otsu = extra("skimage.filters", "telling materials apart by their phase", "read").threshold_multiotsu
    # No start serves every image: the first fails where the scan drifts, the second where the share of the materials
    # changes from row to row, the third on slanted asymmetric stripes, whose differences have a median of their own.
    steps = np.median(np.diff(phase, axis=0), axis=1)
    starts = (np.zeros(len(phase)), np.median(phase, axis=1), np.concatenate([[0.0], np.cumsum(steps)]))
    tried = [_settle(phase - offsets[:, None], n, otsu) for offsets in starts]
    aligned, labels, _ = min(tried, key=lambda settled: settled[2])
    return aligned + (np.median(phase) - np.median(aligned)), labels


def _settle(aligned: np.ndarray, n: int, otsu: Callable[..., np.ndarray]) -> tuple[np.ndarray, np.ndarray, float]:
    """Label populations and align rows to their levels, each from the other, until the labels stay."""
    labels = np.full(aligned.shape, -1)
    for _ in range(20):  # measured images settle in 3 to 6 passes
        smooth = smoothed(aligned)
        new_labels = np.digitize(smooth, _thresholds(otsu, smooth, n))
        if np.array_equal(new_labels, labels):
            break
        labels = new_labels
        levels = np.array([np.median(aligned[labels == k]) if np.any(labels == k) else 0.0 for k in range(n)])
        aligned = aligned - np.median(aligned - levels[labels], axis=1, keepdims=True)
    return aligned, labels, float(np.mean(np.abs(aligned - levels[labels])))


def _thresholds(otsu: Callable[..., np.ndarray], phase: np.ndarray, n: int) -> np.ndarray:
    """Otsu's thresholds between `n` populations, from all but the most extreme pixels."""
    low, high = np.percentile(phase, [0.2, 99.8])  # else a few spikes take most of the histogram's bins
    clipped = np.clip(phase, low, high)
    try:
        return _between(clipped, otsu(clipped, classes=n))
    except ValueError as error:
        values = len(np.unique(phase))
        raise InputError(
            "number of different phases", values, f"enough to tell {n} materials apart", "Ask for fewer."
        ) from error


def _between(values: np.ndarray, thresholds: np.ndarray) -> np.ndarray:
    """Thresholds in the middle of the gap that follows; Otsu's are in the last bin of the population below."""
    counts, edges = np.histogram(values, 256)  # as scikit-image bins them
    moved = []
    for threshold in thresholds:
        last = int(np.clip(np.searchsorted(edges, threshold) - 1, 0, 255))
        above = next((i for i in range(last + 1, 256) if counts[i]), last + 1)
        moved.append((edges[last + 1] + edges[above]) / 2)
    return np.array(moved)
