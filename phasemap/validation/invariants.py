"""Invariants of every image, whatever the sample: its layout, and what its variables are by definition."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from phasemap._shared.arrays import Array
from phasemap._shared.pixels import centres
from phasemap.experiment.realism import DIGITISED
from phasemap.experiment.surface import Surface
from phasemap.imaging.feedback.lines import mean_ground
from phasemap.imaging.imperfections import changes
from phasemap.results.quantities import CHANNELS, is_derived
from phasemap.results.variables import FLAGS, FLOATS, all_variables_of
from phasemap.validation.claims import Claims
from phasemap.validation.picture import FAILS, HOLDS, Claim, Picture, judged

RISING = "position from the top of the image"  # what y is called in earlier images, and only there

ROUNDING = 1e-8  # of the amplitude
OF_ORBITS = ("error_phase", "error_height", "energy_closure")  # what only a periodic orbit has


def layout(image: xr.Dataset, claims: Claims) -> Claim:
    """Claim on the layout; nothing else can be looked at where it fails."""
    wrong = list(_faults_of_layout(image, claims))
    found = "; ".join(wrong[:3]) if wrong else f"{len(image.data_vars)} variables"
    pixels = int(np.prod([image.sizes[dim] for dim in _dims(claims) if dim in image.sizes]))
    return Claim("dims, coordinates, units, flags are as agreed", FAILS if wrong else HOLDS, pixels, found)


def _dims(claims: Claims) -> tuple[str, ...]:
    """Dims of every variable of an image under its control."""
    return ("direction", "y", "x") if claims.control.directions else ("y", "x")


def _faults_of_layout(image: xr.Dataset, claims: Claims) -> Iterator[str]:
    """Sentences on a layout that is not as agreed."""
    dims, known = _dims(claims), all_variables_of(claims.control)
    sizes = dict(zip(("y", "x"), claims.shape, strict=True), direction=len(claims.control.directions))
    for dim in dims:
        if image.sizes.get(dim) != sizes[dim]:
            yield f"there are {image.sizes.get(dim, 0)} along {dim}, not {sizes[dim]}"
    yield from _wrong_coordinates(image, claims)
    if "status" not in image:
        yield "there is no status"
    for name in map(str, image.data_vars):
        variable = image[name]
        about = FLOATS.get(name) or CHANNELS.get(name)
        if name not in known and name not in CHANNELS:
            yield f"{name} is not a variable of such an image"
        elif variable.dims != dims:
            yield f"{name} has dims {variable.dims}, not {dims}"
        elif name in FLAGS:
            yield from _wrong_flags(name, variable)
        elif variable.dtype.kind != "f" or about is None or not _has_attribute(variable, "units", about.units):
            unit = None if about is None else about.units
            yield f"{name} is {variable.dtype} in {variable.attrs.get('units')!r}, not numbers in {unit!r}"


def _wrong_coordinates(image: xr.Dataset, claims: Claims) -> Iterator[str]:
    """Sentences on coordinates that are missing or elsewhere."""
    for dim, count, step in zip(("y", "x"), claims.shape, claims.pixel_size, strict=True):
        if dim not in image.coords:
            yield f"there is no coordinate {dim}"
        elif image.sizes.get(dim) == count:
            places = _from_the_corner(image[dim])
            if places.dtype.kind not in "fiu" or not np.allclose(places, centres(count, step), rtol=1e-9, atol=0):
                yield f"{dim} is not at the centres of pixels of {step:g} m"
    names = list(claims.control.directions)
    if names and ("direction" not in image.coords or list(image["direction"].values) != names):
        yield f"direction is not {', '.join(names)}"


def _wrong_flags(name: str, variable: xr.DataArray) -> Iterator[str]:
    """Sentences on a variable whose flags are not as agreed."""
    _, values, meanings = FLAGS[name]
    stated = np.atleast_1d(variable.attrs.get("flag_values", ()))
    if stated.tolist() != list(values) or not _has_attribute(variable, "flag_meanings", " ".join(meanings)):
        yield f"the flags of {name} have other values or meanings"
    elif variable.dtype.kind not in "iu" or not np.isin(variable.values, values).all():
        yield f"{name} has values that are none of its flags"


def _has_attribute(variable: xr.DataArray, name: str, text: str) -> bool:
    """True if an attribute is this text: it may be an array, too."""
    stated = variable.attrs.get(name)
    return isinstance(stated, str) and stated == text


def _from_the_corner(places: xr.DataArray) -> NDArray[Any]:
    """Places along x or y as they rise from the top left corner."""
    falls = places.dims == ("y",) and not _has_attribute(places, "long_name", RISING)
    values: NDArray[Any] = places.values
    return values[::-1] if falls else values


def invariants(picture: Picture, surface: Surface) -> Iterator[Claim]:
    """Claims on all pixels. `surface`: as it passed under the tip, drift and all."""
    yield _numbers(picture)
    if picture.claims.realism.bits is not None:
        yield _digits(picture)
    if picture.has("height", "tip_offset"):
        yield _height(picture, surface)
    if picture.has("amplitude", "amplitude_error"):
        yield _amplitude_error(picture)
    if not picture.claims.control.directions:
        yield _one_material(picture, surface)


def _numbers(picture: Picture) -> Claim:
    """Claim that there are numbers where there is a solution, and NaN and no branch elsewhere."""
    solved, wrong = picture.solved, np.zeros(picture.shape, bool)
    for name in picture.floats():
        without = name.startswith("error_") and picture.claims.solver == "averaging"
        if not without:
            missing = np.isfinite(picture.raw(name).astype(np.float64)) != solved
            wrong |= missing & ~(picture.averaged & (name in OF_ORBITS))
    for name in FLAGS.keys() - {"status", "solver"}:
        if name in picture:
            wrong |= (picture.raw(name) >= 0) != solved
    failed = int(np.count_nonzero(~picture.good))
    found = "every pixel is solved" if not failed else f"{failed} without a solution"
    return judged("numbers where solved, none elsewhere", picture, wrong, wrong, np.ones(picture.shape, bool), found)


def _digits(picture: Picture) -> Claim:
    """Claim that recorded channels take no values between those of the converter."""
    apart, allowed = np.zeros(picture.shape), np.zeros(picture.shape)
    for name in filter(picture.__contains__, DIGITISED):
        values, step = picture.raw(name), 2 * picture.coarse(name)
        if step > 0:
            digits = (values - np.nanmin(values)) / step
            apart = np.fmax(apart, np.abs(digits - np.rint(digits)))
            allowed = np.fmax(allowed, 1e-3 + 1e-15 * np.abs(values) / step)
    found = f"{picture.claims.realism.bits} bits"
    return judged("values are quantised", picture, apart > allowed, apart, picture.solved, found)


def _height(picture: Picture, surface: Surface) -> Claim:
    """Claim that height is topography + tip offset - amplitude; of a scan, over the mean ground of each pixel."""
    relief = np.zeros(surface.shape) if surface.topography is None else surface.topography
    amplitude: Array | float = picture.claims.amplitude
    if picture.claims.control.in_time:
        relief = np.array([mean_ground(line) for line in relief])
    elif "amplitude" in picture:
        amplitude = picture["amplitude"]
    apart = np.abs(picture["height"] - (relief + picture["tip_offset"] - amplitude))
    size = np.abs(relief) + np.abs(picture["tip_offset"]) + np.abs(amplitude)
    bad = ~(apart <= 1e-12 * size + picture.coarse("height") + picture.coarse("amplitude"))
    return judged("height is topography + tip offset - amplitude", picture, bad, apart, picture.solved, _metres(apart))


def _amplitude_error(picture: Picture) -> Claim:
    """Claim that the amplitude error is the amplitude less the setpoint's."""
    wanted = picture.claims.amplitude
    apart = np.abs(picture["amplitude"] - wanted - picture["amplitude_error"])
    coarse = picture.coarse("amplitude") + picture.coarse("amplitude_error")
    bad = ~(apart <= ROUNDING * wanted + coarse)
    about = "amplitude error is amplitude minus setpoint"
    return judged(about, picture, bad, apart, picture.solved, _metres(apart))


def _one_material(picture: Picture, surface: Surface) -> Claim:
    """Claim that pixels of one material, under one tip, show the same as their median."""
    from scipy.ndimage import median

    _, numbers = surface.unique()
    change = picture.claims.realism.tip_change
    changed = np.arange(surface.shape[0])[:, np.newaxis] >= (surface.shape[0] if change is None else change.line)
    kinds = (2 * numbers.astype(np.int64) + changed).reshape(-1)
    count = np.bincount(kinds)
    shared = np.flatnonzero(count[kinds] > 1)  # by several pixels
    bad = np.zeros(kinds.size, np.int64)
    # The height has the relief in it, and channels the noise of what was recorded.
    others = {"height"} | {name for name in CHANNELS if is_derived(name) and changes(picture.claims.realism)}
    for name in map(str, picture.image.data_vars) if len(shared) else ():
        if name not in others:
            values = picture[name].astype(np.float64).reshape(-1)[shared]
            usual = median(values, kinds[shared], kinds[shared])
            apart = np.abs(values - usual)
            same = (apart <= 1e-9 * np.abs(usual) + 2 * picture.coarse(name)) | (np.isnan(values) & np.isnan(usual))
            bad[shared] += ~same
    looked_at = np.zeros(kinds.size, bool)
    looked_at[shared] = True
    wrong, of = bad.reshape(picture.shape), looked_at.reshape(picture.shape)
    found = f"{np.count_nonzero(count)} materials"
    return judged("pixels of one material show the same", picture, wrong > 0, wrong, of, found)


def _metres(values: Array) -> str:
    """Largest of some lengths in words, in pm."""
    known = values[np.isfinite(values)]
    return f"to within {1e12 * (float(known.max()) if known.size else 0.0):.2g} pm"
