"""Two images that can be laid on each other: their channels, their direction, and one grid for both."""

from __future__ import annotations

import numpy as np
import xarray as xr
from scipy.ndimage import convolve1d

from phasemap._shared.errors import InputError, Word
from phasemap._shared.pixels import downwards
from phasemap._shared.units import readable
from phasemap.io.measured import on_one_turn

Directions = str | tuple[str | None, str | None] | None

CHANNELS = ("height", "phase", "amplitude", "amplitude_error")
UNITS = {"height": "m", "phase": "degree"}
UNEVEN = 1e-3  # relative difference of steps from pixel to pixel; coordinates may be in single precision
FEWEST = 8  # rows and columns: a window of the structural similarity takes 7
SAME_SIZE = 0.05  # by which sides may differ: files of N pixels often say the length of N - 1 of them


def pair_of(
    first: xr.Dataset, second: xr.Dataset, direction: Directions, names: tuple[str, str], needed: tuple[str, ...]
) -> tuple[xr.Dataset, xr.Dataset]:
    """Two images in one direction each, over ("y", "x"), with channels and coordinates from their top left corner.

    `direction`: of both, or of each; None takes the trace. One name for both passes over an image without directions.
    `names`: what the images are called in messages.
    """
    images = first, second
    each = _directions_of(direction, images)
    both = [_from_corner(channels_of(name, ds, one, needed)) for name, ds, one in zip(names, images, each, strict=True)]
    sizes = [[ds.sizes[dim] * pitch_of(ds, dim) for dim in ("x", "y")] for ds in both]
    if not np.allclose(sizes[1], sizes[0], rtol=SAME_SIZE):
        raise InputError(
            f"size of {names[1]}", Word(_in_words(sizes[1])), f"that of {names[0]}, {_in_words(sizes[0])}, within 5 %",
            "Cut the larger one with .sel(y=slice(top, bottom), x=slice(left, right)).",
        )  # fmt: skip
    return both[0], both[1]


def _directions_of(direction: Directions, images: tuple[xr.Dataset, xr.Dataset]) -> tuple[str | None, str | None]:
    """Direction that is asked for of each image."""
    if direction is None:
        return None, None
    if not isinstance(direction, str):
        if not isinstance(direction, tuple | list) or len(direction) != 2:
            raise InputError("direction", direction, "one name, or one for each of the two images")
        return direction[0], direction[1]
    has = ["direction" in getattr(ds, "dims", ()) or _direction(ds) for ds in images]
    if not any(has):
        raise InputError("direction", direction, "None, for neither image has directions")
    return direction if has[0] else None, direction if has[1] else None


def _direction(ds: xr.Dataset) -> str | None:
    """Direction of an image without such a dim, if it says so."""
    known = ds.coords["direction"].item() if "direction" in ds.coords else ds.attrs.get("direction")
    return None if known is None else str(known)


def channels_of(name: str, ds: xr.Dataset, direction: str | None, needed: tuple[str, ...]) -> xr.Dataset:
    """The recorded channels of one direction, over ("y", "x"), of an image that messages call `name`."""
    for channel in needed:
        if channel not in getattr(ds, "data_vars", ()):
            held = ", ".join(map(str, getattr(ds, "data_vars", ()))) or type(ds).__name__
            raise InputError(f"what {name} holds", held, f"an image with {' and '.join(needed)}")
    for channel in needed:
        units = ds[channel].attrs.get("units", UNITS[channel])
        if units != UNITS[channel]:
            raise InputError(f"units of {channel} of {name}", units, UNITS[channel])
    for dim in ("y", "x"):
        _check_places(name, ds, dim)
    if "direction" in ds.dims:
        directions = [str(one) for one in ds["direction"].values]
        wanted = direction or ("trace" if "trace" in directions else directions[0])
        if wanted not in directions:
            raise InputError(f"direction of {name}", wanted, " or ".join(directions))
        ds = ds.isel(direction=directions.index(wanted))
    elif direction is not None and direction != _direction(ds):
        known = _direction(ds) or "None, for the image has no directions"
        raise InputError(f"direction of {name}", direction, known)
    image = ds[[channel for channel in CHANNELS if channel in ds]]
    image = image.where(np.isfinite(image))
    for channel in needed:
        if set(image[channel].dims) != {"y", "x"}:
            raise InputError(f"dims of {channel} of {name}", ds[channel].dims, "('y', 'x') or ('direction', 'y', 'x')")
        if not np.isfinite(image[channel].values).any():
            raise InputError(f"{channel} of {name}", Word("NaN everywhere"), "a map with finite values")
    if "phase" in image:
        image["phase"] = image["phase"].copy(data=on_one_turn(image["phase"].values))
    return image.transpose("y", "x").reset_coords(drop=True)


def _check_places(name: str, ds: xr.Dataset, dim: str) -> None:
    """Refuse an image without evenly spaced places of pixels."""
    if dim not in ds.coords:
        raise InputError(f"coordinate {dim} of {name}", None, "places of the pixels in m")
    if ds[dim].size < FEWEST:
        raise InputError(f"number of pixels along {dim} of {name}", ds[dim].size, f"{FEWEST} or more")
    steps = np.diff(downwards(ds[dim].values, dim))
    if steps.min() <= 0 or np.ptp(steps) > UNEVEN * steps.mean():
        raise InputError(f"coordinate {dim} of {name}", Word("uneven or falling"), "one that rises in equal steps")


def pitch_of(ds: xr.Dataset, dim: str) -> float:
    """Distance between pixels [m]."""
    at = ds[dim].values
    return abs(float(at[-1] - at[0])) / (len(at) - 1)


def common_grid(fixed: xr.Dataset, moving: xr.Dataset) -> tuple[xr.Dataset, xr.Dataset]:
    """Two images on the pixels of `fixed` that lie within `moving`.

    Returns `fixed` cropped; `moving` averaged over the pixels of `fixed` where its own are much finer, and interpolated
    linearly.
    """
    same = all(
        fixed.sizes[dim] == moving.sizes[dim]
        and np.allclose(fixed[dim], moving[dim], rtol=0, atol=1e-6 * pitch_of(fixed, dim))
        for dim in ("y", "x")
    )
    if same:
        return fixed, moving.assign_coords(y=fixed["y"], x=fixed["x"])
    inside = {}
    for dim in ("y", "x"):
        at, ends, slack = fixed[dim].values, moving[dim].values[[0, -1]], 1e-6 * pitch_of(moving, dim)
        inside[dim] = np.flatnonzero((at >= ends[0] - slack) & (at <= ends[1] + slack))
        if len(inside[dim]) < FEWEST:
            raise InputError(
                f"number of pixels along {dim} that both images show", len(inside[dim]), f"at least {FEWEST}"
            )
    fixed = fixed.isel(inside)
    places = {dim: np.clip(fixed[dim].values, *moving[dim].values[[0, -1]]) for dim in ("y", "x")}
    moving = _averaged(moving, fixed).interp(places, assume_sorted=True)
    return fixed, moving.assign_coords(y=fixed["y"], x=fixed["x"])


def _averaged(moving: xr.Dataset, fixed: xr.Dataset) -> xr.Dataset:
    """Means over an odd number of pixels; interpolation averages two, so that up to three there is nothing to do."""
    moving = moving.copy()
    for axis, dim in enumerate(("y", "x")):
        count = 2 * int((pitch_of(fixed, dim) / pitch_of(moving, dim) - 1) / 2 + 1e-6) + 1
        if count > 1:
            for channel in moving.data_vars:
                mean = convolve1d(moving[channel].values, np.full(count, 1 / count), axis=axis, mode="nearest")
                moving[channel] = moving[channel].copy(data=mean)
    return moving


def _from_corner(ds: xr.Dataset) -> xr.Dataset:
    """Count y and x from the image's own top left corner: both rise."""
    return ds.assign_coords({dim: abs(ds[dim] - float(ds[dim][0])) + pitch_of(ds, dim) / 2 for dim in ("y", "x")})


def _in_words(sides: list[float]) -> str:
    """Width and height."""
    unit = readable(max(sides), "m")
    return f"{sides[0] / unit.size:.4g} x {unit.say(sides[1])}"
