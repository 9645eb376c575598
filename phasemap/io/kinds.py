"""The quantities that microscopes record: how their channels are called, and their units."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr

from phasemap._shared.errors import FileError, InputError
from phasemap._shared.pixels import coordinate_step
from phasemap._shared.units import say

LARGEST = 1e-3  # m, of a pixel and of a height: some ten times what scanners reach


class Kind(NamedTuple):
    """A quantity that microscopes record: how its channels are called, its units and its long name."""

    pattern: re.Pattern[str]
    units: dict[str, tuple[float, str]]  # unit in the file: factor to the unit of the Dataset, that unit
    what: str
    long_name: str


def _called(words: str) -> re.Pattern[str]:
    """Not of a higher eigenmode; the first may have a number."""
    return re.compile(rf"(?:{words})(?![\s_]*(?:error|sens|offset|[2-9]))", re.IGNORECASE)


METRES = {"m": (1.0, "m"), "um": (1e-6, "m"), "µm": (1e-6, "m"), "μm": (1e-6, "m"), "nm": (1e-9, "m")}
"""Lengths; the letter micro is one of two characters."""
_DEGREE, _RADIAN = (1.0, "degree"), (57.29577951308232, "degree")
_ANGLES = {"deg": _DEGREE, "degree": _DEGREE, "degrees": _DEGREE, "°": _DEGREE, "rad": _RADIAN, "radian": _RADIAN}
_AMPLITUDE = METRES | {"V": (1.0, "V"), "mV": (1e-3, "V")}
KINDS = {
    "height": Kind(
        re.compile("height|z[- ]?(?:axis|sensor|height|detector|drive)|topography", re.IGNORECASE),
        METRES, "a length", "recorded height",
    ),
    "phase": Kind(
        _called("phase|lock-?in phase|ncm phase|tapping phase"),
        _ANGLES, "an angle", "recorded phase, zero and sign as the instrument has them",
    ),
    "amplitude": Kind(
        _called("amplitude|lock-?in amplitude|ncm amplitude"), _AMPLITUDE, "a length or a voltage", "recorded amplitude"
    ),
    "amplitude_error": Kind(
        re.compile(r"amplitude[\s_]*error", re.IGNORECASE),
        _AMPLITUDE, "a length or a voltage", "recorded amplitude minus setpoint",
    ),
}  # fmt: skip
"""By the variable of the Dataset."""


def check_places(path: Path, ds: xr.Dataset) -> None:
    """Refuse an image whose coordinates y and x are not numbers in equal steps."""
    for dim in ("y", "x"):
        try:
            step = coordinate_step(ds, dim)
        except InputError as error:
            raise FileError(f"cannot use {path}: {error}") from None
        if not math.isfinite(step):
            raise FileError(f"cannot use {path}: the places of pixels along {dim} are not numbers.")


def implausible(ds: xr.Dataset) -> list[str]:
    """Sentences on pixels and heights that no microscope reaches: the file is damaged, or in another unit."""
    lengths = {f"a pixel along {dim}": coordinate_step(ds, dim) for dim in ("y", "x") if ds.sizes[dim] > 1}
    if "height" in ds and np.isfinite(ds["height"].values).any():
        with np.errstate(over="ignore"):
            lengths["the relief"] = float(np.ptp(ds["height"].values[np.isfinite(ds["height"].values)]))
    most = say(LARGEST, "m")
    return [f"{what} is {size:.3g} m; plausible: at most {most}" for what, size in lengths.items() if size > LARGEST]
