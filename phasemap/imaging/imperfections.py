"""Imperfections that a real microscope adds to an image: drift, a worn tip, noise, offsets and digits."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from phasemap._shared.arrays import Array
from phasemap._shared.random_numbers import generator
from phasemap.experiment.microscope import Microscope
from phasemap.experiment.realism import DIGITISED, Realism
from phasemap.experiment.seen_by_tip import seen_at
from phasemap.experiment.surface import Surface

FAR = 2.0**40  # pixels: drift beyond every image


def scopes_by_row(realism: Realism, scope: Microscope, lines: int) -> list[tuple[slice, Microscope]]:
    """Rows of the image and the microscope that scans them, in order. `scope`: as it is at the first line."""
    change = realism.tip_change
    if change is None:
        return [(slice(0, lines), scope)]
    changed = replace(scope, tip=replace(scope.tip, radius=change.radius))
    return [(slice(0, change.line), scope), (slice(change.line, lines), changed)]


def drifted(surface: Surface, drift: tuple[float, float, float]) -> Surface:
    """Return the surface as it passes under the tip while it drifts along x, y and z, by so much an image [m]."""
    if not any(drift):
        return surface
    right, down = _shifts(surface, drift)
    relief = None if surface.topography is None else _carried(surface.topography, right, down)
    if drift[2]:
        part = np.arange(surface.shape[0])[:, np.newaxis] / surface.shape[0]
        relief = (0.0 if relief is None else relief) + np.broadcast_to(drift[2] * part, surface.shape)
    return seen_at(surface, pixels_under_tip(surface, drift), relief)


def pixels_under_tip(surface: Surface, drift: tuple[float, float, float]) -> NDArray[np.intp]:
    """Which pixel of a surface that drifts so is under the tip at each pixel of an image, counted line by line."""
    (ny, nx), (right, down) = surface.shape, _shifts(surface, drift)
    rows = np.clip(np.arange(ny) + _nearest(down), 0, ny - 1)
    columns = np.clip(np.arange(nx) + _nearest(right)[:, np.newaxis], 0, nx - 1)
    return rows[:, np.newaxis] * nx + columns


def _shifts(surface: Surface, drift: tuple[float, float, float]) -> tuple[Array, Array]:
    """By how much the tip is off at each line, along x and along y [pixels]."""
    (ny, _), (dy, dx) = surface.shape, surface.pixel_size
    part = np.arange(ny) / ny
    return min(max(drift[0] / dx, -FAR), FAR) * part, min(max(drift[1] / dy, -FAR), FAR) * part


def _nearest(pixels: Array) -> NDArray[np.int64]:
    """Whole pixels, halves upwards, so that all pixels of a line move by the same."""
    return np.floor(pixels + 0.5).astype(np.int64)


def _carried(relief: Array, right: Array, down: Array) -> Array:
    """Relief at each pixel moved by its line's shift [pixels], linear between pixels, the outermost repeated."""
    ny, nx = relief.shape
    columns = np.arange(nx)
    carried = np.empty(relief.shape)
    for row in range(ny):
        place = min(max(row + down[row], 0.0), ny - 1.0)
        upper = math.floor(place)
        lower = min(upper + 1, ny - 1)
        line = relief[upper] + (place - upper) * (relief[lower] - relief[upper])
        carried[row] = np.interp(columns + right[row], columns, line)
    return carried


def changes(realism: Realism) -> bool:
    """True if the recorded image differs from the motion of a tip that is known."""
    return bool(realism.phase_offset or realism.bits is not None or realism.tip_change is not None)


def finish(image: xr.Dataset, realism: Realism) -> xr.Dataset:
    """Add the imperfections that come after the scan: offsets of lines, then quantisation.

    Each variable that changed says so in its attribute ``comment``, and has the step of its quantisation in
    ``quantisation_step``, in its own unit.
    """
    changed = {}
    for name in DIGITISED:
        if name not in image:
            continue
        variable, comments = image[name], []
        deviation = {"height": realism.line_offset, "phase": realism.phase_offset}.get(name, 0.0)
        if deviation:
            lines = variable.isel(x=0, drop=True)  # one random number for each line and direction
            variable = variable + lines.copy(data=generator(realism.seed, name).normal(0.0, deviation, lines.shape))
            comments.append(f"random offsets of lines, standard deviation {deviation:g}, seed {realism.seed}")
        step = None
        if realism.bits is not None:
            variable, step = _quantised(variable, realism.bits)
            comments.append(f"quantised to {realism.bits} bits")
        if comments:
            more = {} if step is None else {"quantisation_step": step}
            changed[name] = variable.assign_attrs(image[name].attrs, comment="; ".join(comments), **more)
    return image.assign(changed) if changed else image


def _quantised(values: xr.DataArray, bits: int) -> tuple[xr.DataArray, float]:
    """Values rounded to 2**bits equal steps from the lowest to the highest of them, and the step; NaN stays."""
    low, high = float(values.min()), float(values.max())
    step = (high - low) / (2**bits - 1)
    if not step > 0:  # one value only, or none
        return values, 0.0
    return low + ((values - low) / step).round() * step, step
