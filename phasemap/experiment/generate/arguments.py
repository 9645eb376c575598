"""Arguments of generators, checked: an image that fits into memory, lengths that pixels can show."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.checks import number, pixel_pair, shape_pair
from phasemap._shared.errors import InputError
from phasemap._shared.memory import check_fits
from phasemap._shared.quantities import Scalar

Labels = NDArray[np.uint8]
Field = NDArray[np.float64]
PixelSize: TypeAlias = "Scalar | Sequence[Scalar]"


def sized(shape: Sequence[int], per_pixel: int) -> tuple[int, int]:
    """Return (ny, nx) of an image that takes so many bytes a pixel while it is made (measured), if there are."""
    ny, nx = shape_pair(shape)
    check_fits(f"to generate {ny} x {nx} pixels", float(ny) * nx * per_pixel)
    return ny, nx


def pixel_centres(
    shape: Sequence[int], pixel_size: PixelSize, per_pixel: int
) -> tuple[Field, Field, tuple[float, float]]:
    """Return the pixel centres as a column y and a row x [m], and the pixel's (dy, dx); `per_pixel` is `sized`'s."""
    (ny, nx), (dy, dx) = sized(shape, per_pixel), pixel_pair(pixel_size)
    y, x = (np.arange(n, dtype=np.float64) + 0.5 for n in (ny, nx))
    return (y * dy)[:, None], x * dx, (dy, dx)


def at_least(name: str, value: Scalar, minimum: float, pixels: str) -> float:
    """Return a length [m], or raise `InputError` for one that the pixels cannot show."""
    length = number(name, value, "m", above=0)
    if length < minimum * (1 - 1e-9):
        raise InputError(name, value, f"{minimum:g} m or more, {pixels} of this image")
    return length


def wave_length(name: str, value: Scalar, shape: tuple[int, int], sides: tuple[float, float]) -> float:
    """Return a length [m], or raise `InputError` unless four pixels show the wave and the image holds two of it."""
    length = at_least(name, value, 4 * max(sides), "four pixels")
    longest = 0.5 * min(n * side for n, side in zip(shape, sides, strict=True))
    if length > longest:
        raise InputError(name, value, f"{longest:g} m or less, half of this image")
    return length


def is_x(axis: str) -> bool:
    """True if the axis is x, False if it is y; raise `InputError` for any other."""
    if not isinstance(axis, str) or axis not in {"x", "y"}:
        raise InputError("axis", axis, "'x' or 'y'")
    return axis == "x"
