"""A measured and a simulated image side by side, and how much they are alike."""

from __future__ import annotations

import math
import os
from numbers import Real
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from phasemap._shared.arrays import as_array, is_varied
from phasemap._shared.asked import asked_as
from phasemap._shared.checks import is_sign, number
from phasemap._shared.errors import InputError, Word
from phasemap._shared.pixels import coordinates
from phasemap.comparison.pair import Directions, common_grid, pair_of, pitch_of
from phasemap.comparison.registration import Registration, levelled, registration_of
from phasemap.comparison.scores import correlation_of, outlier_lines, share_explained, similarity_of
from phasemap.io.measured import largest_first, segment_phase
from phasemap.io.metadata import settings_of_image
from phasemap.results.variables import provenance

Array = np.ndarray

NAMES = ("measured", "simulated")
MAPS = (*NAMES, "residual")
CAUSES = ("slope", "amplitude error", "both")
DEGREE = {"units": "degree"}
CLEARLY = 0.9  # of the mean square residual: what makes a sign the better one
HELD = 1e-6  # relative change below which an amplitude is the setpoint's everywhere
LEFT_OUT = -1  # label of pixels that are not compared


class _Frame(NamedTuple):
    """Zero of the measured phase [degree], and the direction in which it counts."""

    offset: float
    sign: int

    def of(self, measured: Array) -> Array:
        """The measured phase as a simulation counts it."""
        return self.sign * (measured - self.offset)


@asked_as()
def compare(
    measured: xr.Dataset,
    simulated: xr.Dataset,
    *,
    offset: str | float = "recorded",
    sign: str | int = "recorded",
    regions: int | ArrayLike | None = 2,
    limit: float | None = None,
    direction: Directions = None,
    names: tuple[str, str] = NAMES,
) -> xr.Dataset:
    """Lay a simulated image, or another measured one, on a measured one, and say how much they are alike.

    Heights are levelled, the images registered on them (see `phasemap.register`), and `simulated` is brought to the
    pixels of `measured`. Instruments differ in where their phase is 0 and which way it counts; so the measured phase is
    turned into that of the simulation, ``sign * (measured - offset)``. Its scale is never fitted: too little contrast
    is a finding.

    Parameters
    ----------
    measured, simulated : xarray.Dataset
        Images of the same size, with ``height`` [m] and ``phase`` [degree] over ("y", "x") or ("direction", "y", "x");
        ``amplitude_error`` or ``amplitude`` [m] is used where it is there.
    offset : "recorded", "free", "fixed" or float
        Recorded phase at which the simulation's is 0 [degree]: "fixed" is the attribute ``phase_zero`` of `measured`
        less that of `simulated` (0 if it says none), "free" the one that makes the RMSE least, and "recorded" is
        "fixed" where both are known, as that of phasemap's own images is, else "free"; or a number.
    sign : "recorded", "free", 1 or -1
        -1 if the two count the phase in opposite directions. "recorded" are the attributes ``phase_sign`` of both
        (images of phasemap need none), else as "free", which takes what fits better: 1 unless -1 leaves a mean square
        residual lower by a tenth. The attribute ``sign_from`` says how it was found, and the verdict says first that it
        was turned.
    regions : int, array_like of int or None
        How many materials to tell apart in the measured phase (2 to 4; multi-Otsu), 0 the largest, or their labels,
        shape of `measured`, negative where there is none; None has one region, all pixels. Regions are always found: in
        a homogeneous sample they hold little of the variance (``region_share_of_variance``). They are found in the
        measured image, so its noise makes its contrast look a little larger.
    limit : float, optional
        The longest shift looked for [m]; 0 does not register. Default: a tenth of the shorter side.
    direction : str or pair of str, optional
        Of both images, or of each; default: the trace, if there are directions.
    names : pair of str
        What the images are called on the page and in the summary.

    Returns
    -------
    xarray.Dataset
        Maps on the pixels of `measured` that both images show, of phases and levelled heights, ``residual`` (measured
        less simulated) and ``label`` of the region, -1 where pixels are left out: those without a phase, and lines that
        failed in either image. Numbers, which the page on the file format lists: ``explained`` is the share of the
        measured variance that the simulation takes away, 1 - var(residual) / var(measured), negative if it adds some;
        ``region_contrast`` is of medians, for pixels on misplaced edges pull means; ``crosstalk`` the share R² of the
        variance that is linear in the measured (for the simulated map: its own) slope dh/dx, the amplitude error, or
        both, NaN where there is none.

    Examples
    --------
    >>> import xarray as xr
    >>> hills = np.random.default_rng(1).normal(size=(40, 43)).cumsum(axis=0).cumsum(axis=1)
    >>> channels = {"height": (("y", "x"), 1e-9 * hills), "phase": (("y", "x"), hills)}
    >>> image = xr.Dataset(channels, {"y": 4e-9 * np.arange(40), "x": 4e-9 * np.arange(43)})
    >>> found = compare(image.assign(phase=-10 - image.phase), image)
    >>> [round(float(found[name]), 6) for name in ("offset", "sign", "correlation")]
    [-10.0, -1.0, 1.0]
    """
    if not is_sign(sign) and (not isinstance(sign, str) or sign not in ("recorded", "free")):
        raise InputError("sign", sign, "'recorded', 'free', 1 or -1")
    if not isinstance(names, tuple | list) or len(names) != 2 or not all(isinstance(name, str) for name in names):
        raise InputError("names", names, "two names, of the measured and of the simulated image")
    first, second = pair_of(measured, simulated, direction, NAMES, ("height", "phase"))
    zero = _zero(offset, measured, simulated)
    if not (regions is None or isinstance(regions, int)):
        first = first.assign(label=(("y", "x"), _labels(regions, first["phase"].shape)))
    first, second, tall = levelled(first), levelled(second), first.sizes["y"] * pitch_of(first, "y")
    registration = registration_of(first, second, limit)
    first, second = common_grid(first, registration.apply(second))
    failed = np.zeros(first["phase"].shape, bool)
    for image in (first, second):
        failed |= outlier_lines(image["phase"].values)[:, None]
    known = np.isfinite(first["phase"].values) & np.isfinite(second["phase"].values) & ~failed
    if not known.any():
        raise InputError("number of pixels with a phase in both images", 0, "at least 1")
    wanted, sign_from = _sign(sign, measured, simulated)
    frame = _frame(first["phase"].values[known], second["phase"].values[known], zero, wanted)
    maps = dict(zip(NAMES, (frame.of(first["phase"].values), second["phase"].values), strict=True))
    label = _regions(first, maps["measured"], known, regions)
    result = _record(first, second, maps, known, label, registration)
    down, falls = first["y"].values, float(measured["y"][0]) > float(measured["y"][-1])
    result = result.assign_coords(coordinates(tall - down if falls else down, first["x"].values))
    result["offset"] = ((), frame.offset, {"long_name": "measured phase where the simulated is 0", **DEGREE})
    result["sign"] = ((), frame.sign, {"long_name": "sign of the measured phase against the simulated", "units": "1"})
    result["failed_lines"] = ((), int(failed[:, 0].sum()), {"long_name": "lines left out as outliers", "units": "1"})
    result.attrs.update(provenance(_configuration(offset, sign, regions, limit, direction), "compared"))
    result.attrs["registration"] = registration.reason
    result.attrs["sign_from"] = sign_from
    result.attrs["offset_from"] = "fitted" if zero is None else "recorded" if isinstance(offset, str) else "given"
    for name, ds, called in zip(NAMES, (measured, simulated), names, strict=True):
        result.attrs[f"{name}_name"] = called
        file = os.path.basename(ds.encoding.get("source", ""))
        if source := ds.attrs.get("title") or file or ds.attrs.get("source"):
            result.attrs[f"{name}_source"] = str(source)
    return result


def _zero(offset: str | float, measured: xr.Dataset, simulated: xr.Dataset) -> tuple[float, float] | None:
    """Phases recorded in free air, of both images [degree]; None if the offset is free."""
    if isinstance(offset, Real) and not isinstance(offset, bool):
        return number("offset", offset, "degree"), 0.0
    if isinstance(offset, str) and offset == "free":
        return None
    if not isinstance(offset, str) or offset not in ("fixed", "recorded"):
        raise InputError("offset", offset, "'recorded', 'free', 'fixed' or a number of degrees")
    zeros = {name: settings_of_image(ds) for name, ds in zip(NAMES, (measured, simulated), strict=True)}
    if offset == "recorded" and not all("phase_zero" in known for known in zeros.values()):
        return None
    for name, known in zeros.items():
        if "phase_zero" not in known and (name == "measured" or "levelled" in known):
            hint = "Give the phase recorded in free air as a number, or leave the offset free."
            allowed = "an attribute in degrees for offset='fixed'"
            raise InputError(f"phase_zero of {name}", Word("not recorded"), allowed, hint)
    first, second = (
        number(f"phase_zero of {name}", known.get("phase_zero", 0.0), "degree") for name, known in zeros.items()
    )
    return first, second


def _sign(sign: str | int, measured: xr.Dataset, simulated: xr.Dataset) -> tuple[str | int, str]:
    """The sign to be taken, or "free", and where it comes from."""
    if not isinstance(sign, str):
        return sign, "given"
    known = [settings_of_image(ds).get("phase_sign", 0) for ds in (measured, simulated)]
    if sign == "free" or not all(one in (1, -1) for one in known):
        return "free", "fitted"
    return int(known[0] * known[1]), "recorded"


def _frame(measured: Array, simulated: Array, zero: tuple[float, float] | None, sign: str | int) -> _Frame:
    """Frame with the offset and the sign asked for, or with those that leave the least RMSE."""

    def best(s: int) -> _Frame:
        if zero is None:
            return _Frame(float(measured.mean() - s * simulated.mean()), s)
        recorded = zero[0] - s * zero[1]
        turns = round((measured.mean() - s * simulated.mean() - recorded) / 360)  # 350 degrees may be said as -10
        return _Frame(recorded + 360 * turns, s)

    if sign != "free":
        return best(int(sign))
    same, other = (np.square(best(s).of(measured) - simulated).mean() for s in (1, -1))
    return best(-1 if other < CLEARLY * same else 1)


def _labels(regions: ArrayLike, shape: tuple[int, ...]) -> Array:
    """Given labels, checked."""
    labels = as_array("regions", regions, f"2 to 4, or whole numbers, {shape}")
    if labels.dtype.kind not in "iu" or labels.shape != shape:
        raise InputError(
            "regions", Word(f"{labels.dtype} of shape {labels.shape}"), f"2 to 4, or whole numbers, {shape}"
        )
    return labels


def _regions(first: xr.Dataset, phase: Array, known: Array, regions: Any) -> Array:
    """Labels counted from 0 without gaps, -1 where pixels are left out."""
    if regions is None:
        labels = np.zeros(phase.shape, int)
    elif "label" in first:
        labels = first["label"].values
    else:
        found = segment_phase(np.where(known, phase, np.median(phase[known])), regions)
        labels = largest_first([np.where(known, found, LEFT_OUT)], 0)[0]
    known = known & (labels >= 0)
    if not known.any():
        raise InputError("number of pixels in regions that both images show", 0, "at least 1")
    dense = np.full(phase.shape, LEFT_OUT, np.int16)
    dense[known] = np.unique(labels[known], return_inverse=True)[1]
    return dense


def _record(
    first: xr.Dataset, second: xr.Dataset, maps: dict[str, Array], known: Array, label: Array, moved: Registration
) -> xr.Dataset:
    """Dataset of a comparison, with all maps and numbers but the frame."""
    from scipy.stats import wasserstein_distance

    maps = {name: np.where(known, values, np.nan) for name, values in maps.items()}
    maps["residual"] = maps["measured"] - maps["simulated"]
    measured, simulated, residual = (maps[name][known] for name in MAPS)
    inside = label >= 0
    shares = np.bincount(label[inside]) / inside.sum()
    parts = [label == region for region in range(len(shares))]
    means, medians = (
        np.array([[of(maps[name][part]) for part in parts] for name in MAPS]) for of in (np.mean, np.median)
    )
    spread = measured.var() if is_varied(measured) else math.nan
    between = float(shares @ (means[0] - shares @ means[0]) ** 2)
    stage = {"before": (moved.before, moved.phase_before), "after": (moved.after, moved.phase_after)}
    if not moved.accepted:
        stage["after"] = stage["before"]
    words = {"measured": "measured phase, as the simulation counts it", "simulated": "simulated phase",
             "residual": "measured minus simulated phase"}  # fmt: skip

    def one(value: Any, long_name: str, units: str = "1", dims: Any = ()) -> tuple[Any, Any, dict[str, str]]:
        return dims, value, {"long_name": long_name, "units": units}

    yx, regions = ("y", "x"), ("map", "region")
    heights = zip(NAMES, (first, second), strict=True)
    correlations = enumerate({"height": "of heights", "phase": "of recorded phases"}.items())
    data: dict[str, Any] = {
        **{name: one(maps[name], words[name], "degree", yx) for name in MAPS},
        **{f"{name}_height": one(ds["height"].values, f"{name} height, levelled", "m", yx) for name, ds in heights},
        "label": (yx, label, {"long_name": "region, -1 where pixels are left out"}),
        "correlation": one(correlation_of(measured, simulated), "correlation of the phases"),
        "rmse": one(math.sqrt(np.square(residual).mean()), "root mean square of the residual", "degree"),
        "explained": one(1 - residual.var() / spread, "share of the measured variance explained"),
        "ssim": one(similarity_of(maps["measured"], maps["simulated"], known), "structural similarity"),
        "wasserstein": one(
            wasserstein_distance(measured, simulated), "Wasserstein distance of the histograms", "degree"
        ),
        "region_share": one(shares, "share of the pixels", "1", "region"),
        "region_mean": one(means, "mean phase", "degree", regions),
        "region_median": one(medians, "median phase", "degree", regions),
        "region_contrast": one(
            medians - medians[:, :1], "median phase relative to that of region 0", "degree", regions
        ),
        "region_share_of_variance": one(between / spread, "share of the measured variance between regions"),
        "crosstalk": one(_crosstalk(first, second, maps), "crosstalk R2", "1", ("map", "cause")),
        "shift_y": one(moved.shift[0] if moved.accepted else 0.0, "shift applied to the simulated image, down", "m"),
        "shift_x": one(moved.shift[1] if moved.accepted else 0.0, "shift applied to the simulated image, right", "m"),
        "registered": one(int(moved.accepted), "whether the shift found was accepted"),
        **{
            f"{name}_correlation": one([both[i] for both in stage.values()], long_name, "1", "stage")
            for i, (name, long_name) in correlations
        },
    }
    coords = {"map": list(MAPS), "cause": list(CAUSES), "stage": list(stage), "region": np.arange(len(shares))}
    return xr.Dataset(data, coords)


def _crosstalk(first: xr.Dataset, second: xr.Dataset, maps: dict[str, Array]) -> Array:
    """R² of each map on its causes, shape (maps, causes); the residual's are the measured ones."""
    table = np.full((len(MAPS), len(CAUSES)), math.nan)
    for i, (name, image) in enumerate(zip(MAPS, (first, second, first), strict=True)):
        slope = np.gradient(image["height"].values, image["x"].values, axis=1).ravel()
        values = maps[name].ravel()
        table[i, 0] = share_explained(values, [slope])
        error = next((image[key].values.ravel() for key in ("amplitude_error", "amplitude") if key in image), None)
        if error is not None and _varies(error):
            table[i, 1:] = share_explained(values, [error]), share_explained(values, [slope, error])
    return table


def _varies(amplitude: Array) -> bool:
    """True if the amplitude is not held everywhere."""
    known = amplitude[np.isfinite(amplitude)]
    return known.size > 0 and bool(np.ptp(known) > HELD * np.abs(known).max())


def _configuration(offset: Any, sign: Any, regions: Any, limit: float | None, direction: Any) -> dict[str, Any]:
    """Arguments of the comparison, as plain JSON values."""
    return {
        "compare": {
            "offset": offset if isinstance(offset, str) else float(offset),
            "sign": sign if isinstance(sign, str) else int(sign),
            "regions": regions if regions is None or isinstance(regions, int) else "given labels",
            "limit": limit,
            "direction": list(direction) if isinstance(direction, tuple) else direction,
        }
    }
