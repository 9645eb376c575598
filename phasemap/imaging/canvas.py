"""The variables of an image while they are filled, some pixels at a time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from phasemap._shared.memory import check_fits
from phasemap._shared.pixels import coordinates
from phasemap.experiment.lever_numbers import lever_of
from phasemap.experiment.microscope import Microscope
from phasemap.experiment.surface import Surface
from phasemap.results.quantities import CHANNELS, channel_attributes, is_derived, motion_seen, needs_of
from phasemap.results.variables import FLAGS, FLOATS, branch_of, flag_attributes, float_attributes, motion_of

Array = np.ndarray
PixelRange = slice | NDArray[np.intp]
Values = dict[str, Any]
"""An array for each variable."""

COUNTS = ("ringing_lines",)  # notes that add up
PENDING = -1  # status of a pixel that is not filled yet


def values_of(
    names: tuple[str, ...], rows: Array, status: Array, used: Array, scope: Microscope | None = None
) -> Values:
    """Variables of result rows, shape (..., COLUMNS or WIDE), with their codes, on a flat surface.

    `scope`: microscope of the rows, for channels that are derived from them and a second drive.
    """
    flags = {
        "status": lambda: status, "solver": lambda: used, "branch": lambda: branch_of(rows),
        "motion": lambda: motion_of(rows, None if scope is None else lever_of(scope)),
    }  # fmt: skip
    known = {name: FLOATS[name].value(rows) for name in needs_of(names) if name in FLOATS}
    derived = [name for name in names if is_derived(name)]
    if derived and scope is not None:
        motion = motion_seen(scope, known["amplitude"], known["phase"], known)
        known |= {name: CHANNELS[name].value(motion) for name in derived}
    return {name: flags[name]() if name in FLAGS else known[name] for name in names}


def joined_notes(*notes: Mapping[str, float]) -> dict[str, float]:
    """Findings of a control in parts of an image, joined: counts add up, the others are the same in all parts."""
    joined: dict[str, float] = {}
    for part in notes:
        joined |= {name: value + joined.get(name, 0) if name in COUNTS else value for name, value in part.items()}
    return joined


def check_image(shape: tuple[int, int], names: tuple[str, ...], directions: tuple[str, ...], more: int = 0) -> None:
    """Refuse an image that would not fit into memory; `more` are bytes a pixel that are needed besides."""
    passes = max(len(directions), 1)
    per_pixel = passes * sum(1 if name in FLAGS else 8 for name in names)
    what = f"an image of {shape[0]} x {shape[1]} pixels with {len(names)} variables"
    advice = "Take fewer pixels, or name the variables that you need ([output] variables, variables=)."
    check_fits(what + (f" in {passes} directions" if directions else ""), (per_pixel + more) * math.prod(shape), advice)


class Canvas:
    """Arrays of the image variables asked for, `status` among them, of each direction, or of one image without any."""

    def __init__(self, surface: Surface, names: tuple[str, ...], directions: tuple[str, ...] = ()) -> None:
        size = (max(len(directions), 1), surface.shape[0] * surface.shape[1])
        self._surface, self.names, self._directions = surface, names, directions
        self.notes: dict[str, float] = {}  # what a control found out, for the image's attributes
        self._arrays = {name: np.full(size, PENDING, np.int8) if name in FLAGS else np.empty(size) for name in names}

    @property
    def status(self) -> Array:
        """Status codes of all pixels, PENDING where nothing was put; shape (pixels,), of all directions in turn."""
        return self._arrays["status"].reshape(-1)

    def put(self, pixels: PixelRange, values: dict[str, Array], direction: int = 0) -> None:
        """Fill in the variables of `values`, one entry a pixel."""
        for name, value in values.items():
            if name == "height" and self._surface.topography is not None:
                value = value + self._surface.topography.reshape(-1)[pixels]
            self._arrays[name][direction, pixels] = value

    def put_solved(self, pixels: slice, values: dict[str, Array], at: NDArray[np.integer], direction: int = 0) -> None:
        """Fill in variables solved for materials, one entry each; `at` is the number of the material of each pixel."""
        numbers = at.astype(np.intp, copy=False)
        for name, value in values.items():
            room = self._arrays[name][direction, pixels]
            np.take(value, numbers, out=room, mode="clip")  # other modes would fill a copy first
            if name == "height" and self._surface.topography is not None:
                room += self._surface.topography.reshape(-1)[pixels]

    def note(self, notes: Mapping[str, float]) -> None:
        """Add the findings of the control in a part of the image."""
        self.notes = joined_notes(self.notes, notes)

    def part(self, surface: Surface, rows: slice) -> Canvas:
        """Rows of this canvas, to be filled as an image with notes of its own; `surface` has just these rows."""
        part = Canvas(surface, (), self._directions)
        first, last, _ = rows.indices(self._surface.shape[0])
        pixels = slice(first * surface.shape[1], last * surface.shape[1])
        part.names = self.names
        part._arrays = {name: array[:, pixels] for name, array in self._arrays.items()}
        return part

    def restore(self, arrays: Mapping[str, Array]) -> None:
        """Fill in what `arrays` gave earlier, for the same pixels; nothing, with ValueError, if it is not that."""
        forms = [
            {name: (values.shape, values.dtype) for name, values in some.items()} for some in (arrays, self.arrays())
        ]
        if forms[0] != forms[1]:
            raise ValueError(f"{forms[0]} instead of {forms[1]}")
        for name, values in self.arrays().items():
            values[...] = arrays[name]

    def arrays(self) -> dict[str, Array]:
        """The variables, shape (ny, nx), or (directions, ny, nx)."""
        front = (len(self._directions),) if self._directions else ()
        return {name: flat.reshape(*front, *self._surface.shape) for name, flat in self._arrays.items()}

    def image(self) -> xr.Dataset:
        """The image as a Dataset that shares the arrays."""
        return image_of(self._surface, self.arrays(), self._directions).assign_attrs(self.notes)


def image_of(surface: Surface, arrays: Mapping[str, Any], directions: tuple[str, ...]) -> xr.Dataset:
    """The variables of an image as a Dataset that shares the arrays, which may be lazy."""
    coords = coordinates(*surface.coords())
    dims: tuple[str, ...] = ("y", "x")
    if directions:
        coords["direction"] = ("direction", list(directions), {"long_name": "pass over the line"})
        dims = ("direction", *dims)
    data: dict[str, Any] = {}
    for name, values in arrays.items():
        if name in FLAGS:
            about: dict[str, Any] = flag_attributes(name)
        else:
            channel = CHANNELS[name] if is_derived(name) else None
            about = float_attributes(name) if channel is None else channel_attributes(channel, bool(channel.of_orbit))
            about = {**about, "ancillary_variables": "status"}
        data[name] = (dims, values, about)
    return xr.Dataset(data, coords)
