"""Shift between two images of the same place, found on their heights, and believed only if it helps."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import xarray as xr

from phasemap._shared.asked import asked_as
from phasemap._shared.checks import number
from phasemap._shared.errors import InputError
from phasemap._shared.units import say
from phasemap.comparison.pair import Directions, common_grid, pair_of, pitch_of
from phasemap.comparison.scores import correlation_of
from phasemap.io.gwyddion import extra
from phasemap.io.measured import level_rows

GAIN = 0.25  # share by which 1 - correlation of the heights must fall; what interpolation does to noise gains some 15 %
LOSS = 0.05  # by which the correlation of the phases may fall
REPEATS = 0.5  # autocorrelation of the height above which another period would fit as well
TOP = 0.99  # of its highest value, where a ridge of the autocorrelation counts
SIDE = 0.1  # of the shorter side: how far images are looked for
PASSES = 4
UPSAMPLING = 10  # shifts are found to a tenth of a pixel


@dataclass(frozen=True, repr=False)
class Registration:
    """A shift between two images, and whether to believe it.

    Parameters
    ----------
    shift : tuple of float
        Of the moving image, (down, right) [m].
    before, after : float
        Correlation of the heights without and with it.
    phase_before, phase_after : float
        That of the phases; NaN where an image has none.
    accepted : bool
        Whether it helps.
    reason : str
        Why, in words.
    """

    shift: tuple[float, float]
    before: float
    after: float
    phase_before: float
    phase_after: float
    accepted: bool
    reason: str

    def __repr__(self) -> str:
        """Shift of the registration, and whether it was accepted."""
        down, right = (say(one, "m", 3) for one in self.shift)
        return f"Registration({'' if self.accepted else 'not '}accepted: {down} down, {right} right; {self.reason})"

    @asked_as()
    def apply(self, moving: xr.Dataset) -> xr.Dataset:
        """Return the moving image in its place: with shifted coordinates if the shift is accepted, else as it is."""
        if not self.accepted:
            return moving
        down, right = self.shift
        falls = float(moving["y"][0]) > float(moving["y"][-1])
        return _shifted(moving, (-down if falls else down, right))


@asked_as()
def register(
    fixed: xr.Dataset, moving: xr.Dataset, *, limit: float | None = None, direction: Directions = None
) -> Registration:
    """Find how far an image is shifted from another one of the same place.

    The shift is found on the levelled heights, by phase_cross_correlation of scikit-image. It is accepted if it is
    within the limit, the height does not repeat itself within twice the limit (another period would fit as well), the
    mismatch of the heights, 1 - correlation, falls by a quarter or more, and the correlation of the phases, sign aside,
    does not fall by more than 0.05.

    Parameters
    ----------
    fixed, moving : xarray.Dataset
        Images of the same size with ``height`` [m], over ("y", "x") or ("direction", "y", "x"); pixels may differ.
    limit : float, optional
        The longest shift looked for [m], >= 0; default: a tenth of the shorter side.
    direction : str or pair of str, optional
        Of both images, or of each; default: the trace, if there are directions.

    Examples
    --------
    >>> import xarray as xr
    >>> hills = np.random.default_rng(1).normal(size=(40, 43))
    >>> places = {"y": 4e-9 * np.arange(40), "x": 4e-9 * np.arange(43)}
    >>> image = xr.Dataset({"height": (("y", "x"), 1e-9 * hills)}, places)
    >>> found = register(image.isel(x=slice(None, -3)), image.isel(x=slice(3, None)))
    >>> found.accepted, [round(float(metres) * 1e9, 1) for metres in found.shift]
    (True, [0.0, 12.0])
    """
    both = pair_of(fixed, moving, direction, ("fixed", "moving"), ("height",))
    return registration_of(levelled(both[0]), levelled(both[1]), limit)


def levelled(image: xr.Dataset) -> xr.Dataset:
    """The image with its height levelled."""
    height = image["height"]
    return image.assign(height=height.copy(data=level_rows(height.values, np.isfinite(height.values))))


def registration_of(fixed: xr.Dataset, moving: xr.Dataset, limit: float | None) -> Registration:
    """Registration of a pair of levelled images, as `register` returns it."""
    shortest = min(fixed.sizes[dim] * pitch_of(fixed, dim) for dim in ("y", "x"))
    limit = SIDE * shortest if limit is None else number("limit", limit, "m", minimum=0, maximum=shortest / 2)
    first, second = common_grid(fixed, moving)
    before, phase_before = _correlations(first, second)
    shift = 0.0, 0.0

    def refused(why: str) -> Registration:
        return Registration(shift, before, before, phase_before, phase_before, False, why)

    if limit == 0:
        return refused("not looked for")
    if not math.isfinite(before):
        return refused("one height is flat, and tells no shift")
    shift = _shift(fixed, moving, limit)
    length = math.hypot(*shift)
    if length == 0:
        return refused("in place already")
    if length > limit:
        return refused(f"the best shift, {say(length, 'm', 3)}, is longer than the limit of {say(limit, 'm', 3)}")
    both = _overlap(fixed, moving, shift)
    if both is None:
        return refused(f"the best shift, {say(length, 'm', 3)}, leaves hardly any overlap of the images")
    after, phase_after = _correlations(*both)
    period = _period(first, limit)
    reason = ""
    if period is not None:
        reason = f"the height repeats itself after {say(period, 'm', 3)}, so that another shift would fit as well"
    elif not 1 - after <= (1 - GAIN) * (1 - before):
        reason = f"a shift would not help enough: correlation of the heights {after:.3f} with it, {before:.3f} without"
    elif abs(phase_after) < abs(phase_before) - LOSS:
        reason = f"the phase contradicts: its correlation falls from {phase_before:.2f} to {phase_after:.2f}"
    accepted = not reason
    reason = reason or f"correlation of the heights {after:.3f} with it, {before:.3f} without"
    return Registration(shift, before, after, phase_before, phase_after, accepted, reason)


def _shift(fixed: xr.Dataset, moving: xr.Dataset, limit: float) -> tuple[float, float]:
    """Best shift (y, x) [m], found twice: first as if images were periodic, then on what both show."""
    find = extra("skimage.registration", "registering images", "compare").phase_cross_correlation
    shift = 0.0, 0.0
    for _ in range(PASSES):
        both = _overlap(fixed, moving, shift)
        if both is None:
            break
        heights = [np.nan_to_num(one["height"].values) for one in both]
        pixels = find(*heights, normalization=None, upsample_factor=UPSAMPLING)[0]
        step = [float(n) * pitch_of(fixed, dim) for n, dim in zip(pixels, ("y", "x"), strict=True)]
        shift = shift[0] + step[0], shift[1] + step[1]
        if np.abs(pixels).max() <= 1 / UPSAMPLING or math.hypot(*shift) > limit:
            break
    return shift


def _overlap(fixed: xr.Dataset, moving: xr.Dataset, shift: tuple[float, float]) -> tuple[xr.Dataset, xr.Dataset] | None:
    """Two images on the pixels that both show after a shift; None where these are too few."""
    try:
        return common_grid(fixed, _shifted(moving, shift))
    except InputError:
        return None


def _shifted(moving: xr.Dataset, shift: tuple[float, float]) -> xr.Dataset:
    """Image at another place."""
    return moving.assign_coords(y=moving["y"] + shift[0], x=moving["x"] + shift[1])


def _correlations(first: xr.Dataset, second: xr.Dataset) -> tuple[float, float]:
    """Correlations of the heights and of the phases; NaN where a channel is missing or flat."""
    return tuple(
        correlation_of(first[name].values, second[name].values) if name in first and name in second else math.nan
        for name in ("height", "phase")
    )  # type: ignore[return-value]


def _period(image: xr.Dataset, limit: float) -> float | None:
    """The shortest shift within twice the limit after which the height is much like itself again [m]."""
    from scipy.ndimage import label, maximum
    from scipy.signal import fftconvolve

    height = np.nan_to_num(image["height"].values)
    rows, columns = height.shape
    most = np.s_[rows - 1 - rows // 2 : rows + rows // 2, columns - 1 - columns // 2 : columns + columns // 2]
    ones = np.ones(height.shape)
    both, pairs = (fftconvolve(one, one[::-1, ::-1])[most] for one in (height, ones))
    like = both / pairs / np.mean(height**2)
    islands, count = label(like > REPEATS)
    others = [n for n in range(1, count + 1) if n != islands[rows // 2, columns // 2]]
    if not others:
        return None
    tops = np.concatenate([[np.inf], maximum(like, islands, range(1, count + 1))])
    y, x = np.nonzero((like >= TOP * tops[islands]) & np.isin(islands, others))
    distance = np.hypot((y - rows // 2) * pitch_of(image, "y"), (x - columns // 2) * pitch_of(image, "x")).min()
    return float(distance) if distance <= 2 * limit else None
