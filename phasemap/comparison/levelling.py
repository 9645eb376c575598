"""Removal of what is not a property of the sample: tilt, offsets of rows, and lines that failed."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from phasemap._shared.arrays import as_array
from phasemap._shared.asked import asked_as
from phasemap._shared.checks import check_choice
from phasemap._shared.errors import InputError
from phasemap.comparison.pair import CHANNELS, channels_of
from phasemap.comparison.scores import outlier_lines
from phasemap.io.measured import level_plane, level_rows, on_one_turn, row_medians
from phasemap.results.variables import coded, provenance

Array = np.ndarray


@asked_as()
def level(
    image: xr.Dataset,
    *,
    mask: ArrayLike | None = None,
    height: str = "rows",
    phase: str = "constant",
    lines: str = "flag",
) -> xr.Dataset:
    """Take out of an image what is not a property of the sample.

    Parameters
    ----------
    image : xarray.Dataset
        With ``height`` [m] and ``phase`` [degree], or one of them, over ("y", "x") or ("direction", "y", "x").
    mask : array_like of bool, shape (rows, columns), optional
        Pixels that do not count, such as particles on a flat ground; they are levelled with the others.
    height : str
        "rows": the tilt and the median of every row; "plane": a plane only. Where rows hold about half of each of two
        materials, medians jump between their levels: mask one of them.
    phase : str
        "constant": the median of the image; "rows": that of every row, which is wrong where the share of the materials
        changes from row to row. Never a plane, for a phase has no tilt.
    lines : str
        Single lines that differ from both neighbours much more than lines do are flagged in ``outlier_line`` by "flag",
        and replaced by the mean of their neighbours, too, by "replace".

    Returns
    -------
    xarray.Dataset
        As `image`, and ``outlier_line`` over "y" (0 or 1). Medians of what counts are 0. The attribute ``levelled``
        says how, and ``phase_zero`` is gone.

    Examples
    --------
    >>> import xarray as xr
    >>> y, x = np.mgrid[:8, :9] * 1e-9
    >>> image = xr.Dataset({"height": (("y", "x"), 0.1 * x - 0.2 * y)}, {"y": y[:, 0], "x": x[0]})
    >>> bool(np.allclose(level(image)["height"], 0, atol=1e-24))
    True
    """
    for name, choice, known in (
        ("height", height, ("rows", "plane")),
        ("phase", phase, ("constant", "rows")),
        ("lines", lines, ("flag", "replace")),
    ):
        check_choice(name, choice, known)
    channels = tuple(channel for channel in ("height", "phase") if channel in getattr(image, "data_vars", ()))
    for direction in image["direction"].values if "direction" in image.dims else [None]:
        channels_of("the image", image, direction, channels or ("height", "phase"))
    shape = image.sizes["y"], image.sizes["x"]
    allowed = "True or False for each pixel"
    masked = np.zeros(shape, bool) if mask is None else as_array("mask", mask, allowed)
    if masked.shape != shape:
        raise InputError("shape of mask", masked.shape, f"that of the image, {shape}")
    if masked.dtype.kind not in "biu":
        raise InputError("type of mask", masked.dtype.name, allowed)
    masked = masked.astype(bool)
    done = image.transpose(..., "y", "x").copy()
    flagged: Any = False
    for name in channels:
        maps = done[name].values.reshape(-1, *shape)
        if name == "height":
            maps = np.stack([level_map(one, masked, rows=height == "rows") for one in maps])
        else:
            maps = np.stack([_level_phase(one, masked, rows=phase == "rows") for one in maps])
        flagged = flagged | np.stack([outlier_lines(one) for one in maps])
        done[name] = done[name].copy(data=maps.reshape(done[name].shape))
        done[name].attrs["long_name"] = f"{done[name].attrs.get('long_name', name)}, levelled"
    if lines == "replace":
        for name in CHANNELS:
            if name in done:
                maps = done[name].values.reshape(-1, *shape)
                maps = np.stack([_replaced(one, rows) for one, rows in zip(maps, flagged, strict=True)])
                done[name] = done[name].copy(data=maps.reshape(done[name].shape))
    leading = done[channels[0]].dims[:-2]
    about = coded("line unlike both its neighbours", "no", "yes")
    done["outlier_line"] = (
        (*leading, "y"), flagged.astype(np.int8).reshape(*(done.sizes[dim] for dim in leading), shape[0]), about,
    )  # fmt: skip
    done.attrs.pop("phase_zero", None)  # of the phase as it was recorded
    done.attrs["levelled"] = f"height by {height}, phase by {phase}"
    done.attrs["history"] = "\n".join(filter(None, [image.attrs.get("history"), provenance({}, "levelled")["history"]]))
    return done


def level_map(height: Array, mask: Array, *, rows: bool = True) -> Array:
    """Take the tilt, and offsets of `rows` where they have some, out of a height map [m], which may hold NaN."""
    counts = np.isfinite(height) & ~mask
    if counts.sum() < 3:
        raise InputError("number of pixels to level by", int(counts.sum()), "at least 3")
    return level_rows(height, counts) if rows else level_plane(height, counts)


def _level_phase(phase: Array, mask: Array, *, rows: bool) -> Array:
    """Take a constant, or one for each row, out of a phase map."""
    phase = on_one_turn(phase)
    counts = np.isfinite(phase) & ~mask
    if not counts.any():
        raise InputError("number of pixels to level by", 0, "at least 1")
    offsets: Array = row_medians(phase, counts) if rows else np.median(phase[counts])
    return phase - offsets


def _replaced(values: Array, lines: Array) -> Array:
    """Lines replaced by the mean of the nearest lines that are not replaced themselves."""
    if not lines.any():
        return values
    good = np.flatnonzero(~lines)
    at = np.flatnonzero(lines)
    before, after = good[np.searchsorted(good, at) - 1], good[np.searchsorted(good, at)]
    values = values.copy()
    values[at] = (values[before] + values[after]) / 2
    return values
