"""Numbers that say how much two maps are alike, how much of a map is crosstalk, and which of its lines failed."""

from __future__ import annotations

import math

import numpy as np

from phasemap._shared.arrays import Array, is_varied
from phasemap.io.gwyddion import extra

WINDOW = 7  # pixels, of the structural similarity
RANGE = (0.5, 99.5)  # percentiles that its dynamic range spans
STRIKING = 8.0  # times the usual spread of lines, above which a line is an outlier ...
VISIBLE = 0.25  # ... if it also stands out by this share of the image's own spread


def correlation_of(first: Array, second: Array) -> float:
    """Pearson's correlation of two maps, over pixels that both have.

    `first`, `second`: of the same shape; may hold NaN.
    Returns NaN if one is constant.
    """
    known = np.isfinite(first) & np.isfinite(second)
    if not known.any():
        return math.nan
    if not (is_varied(first[known]) and is_varied(second[known])):
        return math.nan
    return float(np.corrcoef(first[known], second[known])[0, 1])


def similarity_of(first: Array, second: Array, known: Array) -> float:
    """Structural similarity, over pixels whose whole window is known; NaN if none is, or nothing varies.

    Values count from the low end of their range, as those of pictures do: the similarity depends on where 0 is, and
    that of a phase is arbitrary.
    """
    from scipy.ndimage import binary_erosion

    whole = binary_erosion(known, np.ones((WINDOW, WINDOW)))
    both = np.concatenate([first[known], second[known]])
    low, high = np.percentile(both, RANGE)
    if not whole.any() or high == low or not is_varied(both):
        return math.nan
    structural_similarity = extra("skimage.metrics", "structural similarity", "compare").structural_similarity
    maps = (np.where(known, values - low, 0.0) for values in (first, second))
    each = structural_similarity(*maps, win_size=WINDOW, data_range=high - low, full=True)[1]
    return float(each[whole].mean())


def share_explained(values: Array, causes: list[Array]) -> float:
    """Share R² of the variance that a linear regression explains.

    `values` (shape (n,)): may hold NaN, as may the causes.
    `causes` (shape (n,)).
    Returns: from 0 to 1; NaN if the values are constant or no pixel is known.
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


def outlier_lines(values: Array) -> Array:
    """Single lines that lie far above, or far below, both their neighbours; steps between lines do not count."""
    above, below = values[1:-1] - values[:-2], values[1:-1] - values[2:]
    stands_out = np.where(above * below > 0, np.minimum(np.abs(above), np.abs(below)), 0.0)
    score = stands_out.mean(axis=1)
    usual = np.median(score)
    spread = 1.4826 * np.median(np.abs(score - usual))  # of a normal distribution
    low, high = np.nanpercentile(values, [16, 84])
    outliers = np.zeros(len(values), bool)
    outliers[1:-1] = (score > usual + STRIKING * spread) & (score > VISIBLE * (high - low) / 2)
    return outliers
