"""Numbers that say how much two maps are alike, and how much of a map is crosstalk."""

from __future__ import annotations

import math

import numpy as np

from phasemap.comparison.library import skimage

Array = np.ndarray

WINDOW = 7  # pixels, of the structural similarity
RANGE = (0.5, 99.5)  # percentiles that its dynamic range spans


def correlation_of(first: Array, second: Array) -> float:
    """Pearson's, over pixels that both have.

    Parameters
    ----------
    first, second : ndarray
        Of the same shape; may hold NaN.

    Returns
    -------
    float
        NaN if one is constant.

    Examples
    --------
    >>> correlation_of(np.array([1.0, 2.0, np.nan]), np.array([4.0, 2.0, 9.0]))
    -1.0
    """
    known = np.isfinite(first) & np.isfinite(second)
    if not known.any():
        return math.nan
    a, b = (values[known] - values[known].mean() for values in (first, second))
    spread = math.sqrt((a @ a) * (b @ b))
    return float(np.clip((a @ b) / spread, -1, 1)) if spread > 0 else math.nan


def similarity_of(first: Array, second: Array, known: Array) -> float:
    """Structural similarity, over pixels whose whole window is known.

    Parameters
    ----------
    first, second : ndarray, shape (rows, columns)
    known : ndarray of bool
        Pixels that both have.

    Returns
    -------
    float
        NaN if no window is whole, or nothing varies.
    """
    from scipy.ndimage import binary_erosion

    whole = binary_erosion(known, np.ones((WINDOW, WINDOW)))
    low, high = np.percentile(np.concatenate([first[known], second[known]]), RANGE)
    if not whole.any() or high == low:
        return math.nan
    structural_similarity = skimage("metrics", "structural similarity").structural_similarity
    maps = (np.where(known, values, low) for values in (first, second))
    each = structural_similarity(*maps, win_size=WINDOW, data_range=high - low, full=True)[1]
    return float(each[whole].mean())


def distance_of(first: Array, second: Array) -> float:
    """Wasserstein distance of two histograms: how far values must be moved, on average.

    Parameters
    ----------
    first, second : ndarray, shape (n,)
        Finite.

    Returns
    -------
    float
        In the unit of the values.

    Examples
    --------
    >>> distance_of(np.array([0.0, 1.0]), np.array([3.0, 0.0]))
    1.0
    """
    from scipy.stats import wasserstein_distance

    return float(wasserstein_distance(first, second))


def share_explained(values: Array, causes: list[Array]) -> float:
    """R² of a linear regression.

    Parameters
    ----------
    values : ndarray, shape (n,)
        May hold NaN, as may the causes.
    causes : list of ndarray, shape (n,)

    Returns
    -------
    float
        From 0 to 1; NaN if the values are constant or no pixel is known.

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
    total = y @ y
    if total <= 1e-24 * (values[known] @ values[known]):
        return math.nan
    left = y - x @ np.linalg.lstsq(x, y, rcond=None)[0]
    return float(np.clip(1 - (left @ left) / total, 0, 1))
