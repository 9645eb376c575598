"""Surfaces that people image, made from a few numbers and a seed.

A generator returns labels (uint8, for `Surface.from_labels`) or a field (float64, a map or a topography). Lengths are
in m, the same arguments give the same bytes, and the random patterns are periodic: they tile without a seam.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from phasemap._check import number, pixel_pair, shape_pair, whole
from phasemap.errors import InputError

__all__ = ["blend", "checkerboard", "gradient", "lamellae", "particles", "roughness", "step", "stripes"]

Labels = NDArray[np.uint8]
Field = NDArray[np.float64]
PixelSize = float | Sequence[float]


def stripes(
    shape: Sequence[int], pixel_size: PixelSize, *, period: float, duty: float = 0.5, angle: float = 0.0
) -> Labels:
    """Straight stripes, as of a grating or a layered composite.

    Parameters
    ----------
    shape : (int, int)
        (ny, nx).
    pixel_size : float or (float, float)
        Side of a pixel [m], or its (dy, dx).
    period : float
        Distance from stripe to stripe [m]; two pixels or more, seen along the image's rows and columns.
    duty : float
        Part of the period that has label 1 [1], above 0 and below 1.
    angle : float
        From the x axis to the stripes' normal [degree], clockwise in the image; 0 gives upright stripes.

    Returns
    -------
    ndarray of uint8, shape (ny, nx)
        Labels 0 and 1; the top left corner starts a stripe of label 1.

    Raises
    ------
    InputError
        If a value is out of range.

    Examples
    --------
    >>> stripes((2, 8), 1e-9, period=4e-9)
    array([[1, 1, 0, 0, 1, 1, 0, 0],
           [1, 1, 0, 0, 1, 1, 0, 0]], dtype=uint8)
    """
    y, x, (dy, dx) = _grid(shape, pixel_size)
    towards = math.radians(number("angle", angle, "degree"))
    number("duty", duty, "1", above=0, below=1)
    _at_least("period", period, 2 * max(abs(math.sin(towards)) * dy, abs(math.cos(towards)) * dx), "two pixels")
    phase = (math.cos(towards) * x + math.sin(towards) * y) / period
    return (phase - np.floor(phase) < duty).astype(np.uint8)


def checkerboard(shape: Sequence[int], pixel_size: PixelSize, *, side: float) -> Labels:
    """Squares in turn, as of a patterned monolayer or a calibration standard.

    Parameters
    ----------
    shape : (int, int)
        (ny, nx).
    pixel_size : float or (float, float)
        Side of a pixel [m], or its (dy, dx).
    side : float
        Side of a square [m], one pixel or more.

    Returns
    -------
    ndarray of uint8, shape (ny, nx)
        Labels 0 and 1, 0 in the top left corner.

    Raises
    ------
    InputError
        If a value is out of range.

    Examples
    --------
    >>> checkerboard((2, 4), 1e-9, side=1e-9)
    array([[0, 1, 0, 1],
           [1, 0, 1, 0]], dtype=uint8)
    """
    y, x, steps = _grid(shape, pixel_size)
    _at_least("side", side, max(steps), "one pixel")
    return ((np.floor(y / side) + np.floor(x / side)) % 2).astype(np.uint8)


def step(
    shape: Sequence[int],
    pixel_size: PixelSize,
    *,
    position: float | None = None,
    axis: Literal["x", "y"] = "x",
) -> Labels:
    """Two halves with a sharp edge between them.

    Parameters
    ----------
    shape : (int, int)
        (ny, nx).
    pixel_size : float or (float, float)
        Side of a pixel [m], or its (dy, dx).
    position : float, optional
        Distance of the edge from the left or the top of the image [m]; None is the middle.
    axis : {"x", "y"}
        Direction in which one crosses the edge.

    Returns
    -------
    ndarray of uint8, shape (ny, nx)
        0 before the edge, 1 behind it.

    Raises
    ------
    InputError
        If the edge is not inside the image.

    Examples
    --------
    >>> step((1, 4), 1e-9, position=1e-9)
    array([[0, 1, 1, 1]], dtype=uint8)
    """
    y, x, (dy, dx) = _grid(shape, pixel_size)
    across, length = (x, x.size * dx) if _is_x(axis) else (y, y.size * dy)
    edge = 0.5 * length if position is None else number("position", position, "m", above=0, below=length)
    labels = np.broadcast_to(across > edge, (y.size, x.size))
    return labels.astype(np.uint8)


def gradient(shape: Sequence[int], *, start: float, stop: float, axis: Literal["x", "y"] = "x") -> Field:
    """Even change from one value to another, of any quantity.

    Parameters
    ----------
    shape : (int, int)
        (ny, nx).
    start, stop : float
        Values of the first and the last pixel [any unit].
    axis : {"x", "y"}
        Direction of the change.

    Returns
    -------
    ndarray, shape (ny, nx)
        The field [the same unit], read-only.

    Raises
    ------
    InputError
        If a value is not finite, or the axis is neither x nor y.

    Examples
    --------
    >>> gradient((1, 5), start=1.0, stop=3.0)
    array([[1. , 1.5, 2. , 2.5, 3. ]])
    """
    ny, nx = shape_pair(shape)
    ends = number("start", start, "1"), number("stop", stop, "1")
    line = np.linspace(*ends, nx) if _is_x(axis) else np.linspace(*ends, ny)[:, None]
    return np.broadcast_to(line, (ny, nx))
