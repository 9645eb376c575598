"""Numbers that say how much two maps are alike, and how much of a map is crosstalk."""

from __future__ import annotations

import math

import numpy as np

from phasemap.comparison.library import skimage

Array = np.ndarray

WINDOW = 7  # pixels, of the structural similarity
ROUNDING = 1e-12  # relative difference of values that are the same
RANGE = (0.5, 99.5)  # percentiles that its dynamic range spans


def is_varied(values: Array) -> bool:
    """Whether values differ by more than rounding.

    `values` (shape (n,)): finite.

    Examples
    --------
    >>> is_varied(np.full(1001, 0.3)), bool(np.full(1001, 0.3).var() > 0)
    (False, True)
    """
    return bool(np.ptp(values) > ROUNDING * np.abs(values).max())


def correlation_of(first: Array, second: Array) -> float:
    """Pearson's, over pixels that both have.

    `first`, `second`: of the same shape; may hold NaN.
    Returns NaN if one is constant.

    Examples
    --------
    >>> correlation_of(np.array([1.0, 2.0, np.nan]), np.array([4.0, 2.0, 9.0]))
    -1.0
    """
    known = np.isfinite(first) & np.isfinite(second)
    if not known.any():
        return math.nan
    if not (is_varied(first[known]) and is_varied(second[known])):
        return math.nan
    a, b = (values[known] - values[known].mean() for values in (first, second))
    return float(np.clip((a @ b) / math.sqrt((a @ a) * (b @ b)), -1, 1))


def similarity_of(first: Array, second: Array, known: Array) -> float:
    """Structural similarity, over pixels whose whole window is known.

    Values count from the low end of their range, as those of pictures do: the similarity depends on where 0 is, and
    that of a phase is arbitrary.

    `first`, `second` (shape (rows, columns)).
    Returns NaN if no window is whole, or nothing varies.
    """
    from scipy.ndimage import binary_erosion

    whole = binary_erosion(known, np.ones((WINDOW, WINDOW)))
    both = np.concatenate([first[known], second[known]])
    low, high = np.percentile(both, RANGE)
    if not whole.any() or high == low or not is_varied(both):
        return math.nan
    structural_similarity = skimage("metrics", "structural similarity").structural_similarity
    maps = (np.where(known, values - low, 0.0) for values in (first, second))
    each = structural_similarity(*maps, win_size=WINDOW, data_range=high - low, full=True)[1]
    return float(each[whole].mean())


def distance_of(first: Array, second: Array) -> float:
    """Wasserstein distance of two histograms: how far values must be moved, on average.

    `first`, `second` (shape (n,)): finite.
    Returns: in the unit of the values.

    Examples
    --------
    >>> distance_of(np.array([0.0, 1.0]), np.array([3.0, 0.0]))
    1.0
    """
    from scipy.stats import wasserstein_distance

    return float(wasserstein_distance(first, second))


def share_explained(values: Array, causes: list[Array]) -> float:
    """R² of a linear regression.

    `values` (shape (n,)): may hold NaN, as may the causes.
    `causes` (shape (n,)).
    Returns: from 0 to 1; NaN if the values are constant or no pixel is known.

    Examples
    --------
    >>> share_explained(np.array([1.0, 3.0, 5.0]), [np.array([0.0, 1.0, 2.0])])
    1.0
    """
    known = np.isfinite(values) & np.all(np.isfinite(causes), axis=0)
    if known.sum() <= len(causes) + 1:
        return math.nan
    y = values[known] - values[known].mean()
    spread = np.array([cause[known].std() or 1.0 for cause in causes])
    x = np.stack([cause[known] - cause[known].mean() for cause in causes], axis=-1) / spread
    if not is_varied(values[known]):
        return math.nan
    left = y - x @ np.linalg.lstsq(x, y, rcond=None)[0]
    return float(np.clip(1 - (left @ left) / (y @ y), 0, 1))
