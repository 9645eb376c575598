"""Regions of every file of a series, and how their phases differ."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.ndimage import shift as moved_by
from scipy.ndimage import uniform_filter

from phasemap._shared.arrays import Array, as_array, within_half_a_turn
from phasemap._shared.checks import check_choice
from phasemap._shared.errors import InputError, Word
from phasemap._shared.pixels import coordinate_step
from phasemap.comparison.registration import register
from phasemap.inference.images.stack import MEDIAN, SPREAD, labels_of
from phasemap.io.measured import largest_first, level_height, on_one_turn, segment_height, segment_phase, separation_of

Labels = NDArray[np.int64]

WAYS = ("phase", "height")
BANDS = 16  # of rows, whose differences say how well a median is known
PREFERRED = 2.0  # times as sharp has the height to be to tell regions apart instead of the phase
MUCH = 0.5  # of what regions by phase explain of the phase, that regions by height have to explain
SMOOTHED = 5  # pixels over which noise is smoothed away for that
SMALLEST = 0.03  # of the area, that regions of height have; smaller ones are mostly dirt
FEWEST = 12  # pixels of a region in a band that count
PASSES = 6
ALIKE = 0.7  # correlation of heights above which two files are of one place
CLOSE_SHARES = 0.1  # of the area, between regions that could be mistaken for each other
LEFT_OUT = -1


class Regions(NamedTuple):
    """Labels of every file, from 0 and the largest region first, -1 where pixels are left out, and how they came."""

    labels: list[Labels]
    told: list[str]


def regions_of(images: Sequence[xr.Dataset], names: Sequence[str], labels: Any, by: str | None, count: int) -> Regions:
    """Take the labels given, one map for each image, or find them by the phase, or by a height that is much sharper."""
    if by is not None:
        check_choice("by", by, WAYS)
    if labels is not None:
        if by is not None:
            raise InputError("by", by, "None beside labels, which are the regions")
        return Regions(_given(labels, images), ["Regions as given."])
    if by == "height" and not all("height" in one for one in images):
        raise InputError("by", by, "'phase', because a file has no height")
    tried = [by] if by is not None else ["phase", "height"] if all("height" in one for one in images) else ["phase"]
    segmented = {way: [_segment(one, way, count) for one in images] for way in tried}
    sharp = {
        way: [_sharpness(one, mine, way) for one, mine in zip(images, segmented[way], strict=True)] for way in tried
    }
    way = tried[-1] if len(tried) == 1 or _height_serves(images, segmented, sharp) else "phase"
    best = int(np.argmax(sharp[way]))
    told = [f"Regions by {way}; region 0 is the largest."]
    laid = _laid(images, best, segmented[way][best])
    if laid is not None:
        told.append(f"All files are of one place: the regions of {names[best]} serve all.")
        return Regions(largest_first(laid, best), told)
    if min(sharp[way]) == 0.0:
        plain = names[int(np.argmin(sharp[way]))]
        hint = "Give labels, or another way (by)."
        raise InputError(f"number of regions in {plain}", 1, f"{count} in every file", hint)
    if way == "height":
        matched = largest_first(segmented[way], best)
    else:
        ordered = largest_first([segmented[way][best]], 0)[0]
        matched = [ordered if i == best else _matched(one, ordered) for i, one in enumerate(segmented[way])]
    how = "their order in height" if way == "height" else "their share of the area"
    told.append(f"Heights do not match, so files are taken to be of different places: regions are matched by {how}.")
    shares = np.bincount(matched[best].ravel(), minlength=count) / matched[best].size
    if way != "height" and np.diff(np.sort(shares)).min() < CLOSE_SHARES:
        told.append("Regions have much the same share of the area: they may be mistaken for each other; give labels.")
    return Regions(matched, told)


class Medians(NamedTuple):
    """Phases of regions in files, and standard errors from how they vary over the rows, shape (r, m) [degree]."""

    values: Array
    errors: Array
    shares: Array


def medians(images: Sequence[xr.Dataset], labels: Sequence[Labels]) -> Medians:
    """Median phases of the regions, rows aligned; NaN where a file does not have the region."""
    count = 1 + max(int(one.max()) for one in labels)
    columns = [
        _medians_of(on_one_turn(one["phase"].values), mine, count) for one, mine in zip(images, labels, strict=True)
    ]
    return Medians(*(np.stack(part, axis=1) for part in zip(*columns, strict=True)))


def drift_of(values: Array, same: NDArray[np.bool_], zeros_count: bool) -> tuple[float, list[int]]:
    """Standard deviation of phases [degree] between repeats, and the files that repeat another; 0 without any.

    `values` (shape (r, m)): medians; `same` (shape (m, m)): which files have the same settings.
    `zeros_count`: whether phases are compared, or only contrasts, where a zero may be another in each file.
    """
    known = np.isfinite(values)
    if not zeros_count:
        values = values - np.nansum(values, axis=0) / np.maximum(known.sum(axis=0), 1)
    groups = [np.flatnonzero(row) for row in np.unique(same, axis=0) if row.sum() > 1]
    squares, count = 0.0, 0
    for repeats in groups:  # a level of each region, and a zero of each file, by least squares over what is known
        region, file = np.nonzero(known[:, repeats])
        first = values[np.arange(len(values)), repeats[known[:, repeats].argmax(axis=1)]]
        apart = within_half_a_turn(values[region, repeats[file]] - first[region])
        design = np.hstack([np.eye(len(values))[region], np.eye(len(repeats))[file] * (not zeros_count)])
        levels, _, rank, _ = np.linalg.lstsq(design, apart)
        squares, count = squares + float(((apart - design @ levels) ** 2).sum()), count + len(apart) - rank
    size = float(np.sqrt(squares / max(count, 1)))
    return size, [int(i) for repeats in groups for i in repeats]


def each_of(labels: Any, count: int) -> list[Any]:
    """The map of labels of each file: one for all, or one a file, whose sizes may differ."""
    allowed = f"one 2-D map of whole numbers, or {count}, one a file"
    listed = isinstance(labels, list | tuple) and len(labels) > 0
    first = as_array("labels", labels[0] if listed else labels, allowed)
    if first.ndim != (2 if listed else 3):
        return [labels] * count
    each = list(labels if listed else first)
    if len(each) != count:
        raise InputError("labels", Word(f"{len(each)} maps"), allowed)
    return each


def _given(each: Sequence[Any], images: Sequence[xr.Dataset]) -> list[Labels]:
    """Labels as given, numbered from 0 alike in all files, LEFT_OUT elsewhere."""
    shapes = [one["phase"].shape for one in images]
    maps = [labels_of(one, shape).astype(np.int64) for one, shape in zip(each, shapes, strict=True)]
    every = np.unique(np.concatenate([np.unique(one[one >= 0]) for one in maps]))
    if not 2 <= len(every) <= 5:
        raise InputError("number of regions in labels", len(every), "2 to 5")
    return [np.where(one >= 0, np.searchsorted(every, one), LEFT_OUT) for one in maps]


def _feature(image: xr.Dataset, way: str) -> Array:
    """Contrasts by which regions are told apart."""
    if way == "phase":
        return np.asarray(on_one_turn(image["phase"].values), np.float64)
    return np.asarray(1e9 * level_height(image["height"].values), np.float64)


def _segment(image: xr.Dataset, way: str, count: int) -> Labels:
    """Regions of one file; one only where nothing tells them apart."""
    try:
        if way == "height":
            return segment_height(image["height"].values, count).astype(np.int64)
        return segment_phase(_feature(image, "phase"), count).astype(np.int64)
    except InputError:
        return np.zeros(image["phase"].shape, np.int64)


def _sharpness(image: xr.Dataset, labels: Labels, way: str) -> float:
    """Distance of the populations over their spread; 0 of a single one."""
    return separation_of(_feature(image, way), labels)[1] if labels.any() else 0.0


def _height_serves(
    images: Sequence[xr.Dataset], segmented: dict[str, list[Labels]], sharp: dict[str, list[float]]
) -> bool:
    """True if heights tell regions apart far more sharply than phases, into large regions that the phase shows too."""
    least = [np.bincount(one[one >= 0]).min() / one.size for one in segmented["height"]]
    of_phase, of_height = (float(np.median(sharp[way])) for way in ("phase", "height"))
    if of_height <= PREFERRED * of_phase or float(np.median(least)) < SMALLEST:
        return False
    shares = {
        way: float(
            np.median([_explained_variance(one, mine) for one, mine in zip(images, segmented[way], strict=True)])
        )
        for way in ("phase", "height")
    }
    return shares["height"] >= MUCH * shares["phase"]


def _explained_variance(image: xr.Dataset, labels: Labels) -> float:
    """Share of the phase's variance, rows aligned and noise smoothed, that the regions explain."""
    _, flat, _ = _aligned(on_one_turn(image["phase"].values), labels, 1 + int(labels.max()))
    smooth = uniform_filter(np.nan_to_num(flat, nan=_median(flat)), SMOOTHED)
    smooth = np.clip(smooth, *np.percentile(smooth, [1, 99]))
    parts = [smooth[labels == k] for k in np.unique(labels)]
    inside = sum(float(one.var()) * one.size for one in parts) / smooth.size
    return float(1.0 - inside / max(float(smooth.var()), 1e-30))


def _laid(images: Sequence[xr.Dataset], best: int, labels: Labels) -> list[Labels] | None:
    """The regions of one file laid on all others, None if they are of other places."""
    fixed = images[best]
    if not all("height" in one and one["phase"].shape == labels.shape for one in images):
        return None
    laid = []
    for i, moving in enumerate(images):
        if i == best:
            laid.append(labels)
            continue
        try:
            moved = register(fixed, moving)
        except InputError:
            return None  # of different sizes
        shift = moved.shift if moved.accepted else (0.0, 0.0)
        if (moved.after if moved.accepted else moved.before) < ALIKE:
            return None
        pitch = [coordinate_step(fixed, dim) for dim in ("y", "x")]
        pixels = [-round(s / p) for s, p in zip(shift, pitch, strict=True)]
        laid.append(moved_by(labels, pixels, order=0, cval=LEFT_OUT))
    return laid


def _matched(labels: Labels, reference: Labels) -> Labels:
    """Names of regions as of the reference, by their share."""
    count = 1 + int(max(labels.max(), reference.max()))
    shares = [np.bincount(one[one >= 0], minlength=count) / max((one >= 0).sum(), 1) for one in (labels, reference)]
    best = min(permutations(range(count)), key=lambda order: float(np.abs(shares[0] - shares[1][list(order)]).sum()))
    return np.array(best)[labels]


def _medians_of(phase: Array, labels: Labels, count: int) -> tuple[Array, Array, Array]:
    """Phases of the regions of one file, standard errors and shares."""
    levels, flat, offset = _aligned(phase, labels, count)
    errors = np.full(count, np.nan)
    for k in np.flatnonzero(np.isfinite(levels)):
        pixels = np.where(labels == k, flat, np.nan)
        bands = [one[np.isfinite(one)] for one in np.array_split(pixels, min(BANDS, len(pixels)))]
        parts = [np.median(one) for one in bands if len(one) >= FEWEST]
        values = pixels[np.isfinite(pixels)]
        white = SPREAD * np.median(np.abs(values - np.median(values))) / np.sqrt(len(values))
        slow = np.std(parts, ddof=1) / np.sqrt(len(parts)) if len(parts) > 2 else 0.0
        errors[k] = MEDIAN * max(white, slow)
    return levels + offset, errors, np.bincount(labels[labels >= 0], minlength=count) / labels.size


def _aligned(phase: Array, labels: Labels, count: int) -> tuple[Array, Array, float]:
    """Phases of the regions and of the pixels, rows aligned by their regions, and what rows have in common."""
    flat = np.where((labels >= 0) & np.isfinite(phase), phase, np.nan)
    for _ in range(PASSES):
        levels = np.array([_median(flat[labels == k]) for k in range(count)])
        step = np.array([[_median(row)] for row in flat - np.nan_to_num(levels)[labels]])
        flat = flat - np.nan_to_num(step)
    rows = np.array([_median(row) for row in phase - flat])
    return levels, flat, float(np.median(np.nan_to_num(rows)))


def _median(values: Array) -> float:
    """Median of the finite values; NaN without any."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else np.nan
