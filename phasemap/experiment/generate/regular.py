"""Patterns without chance: stripes, a checkerboard, a step, a gradient."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np

from phasemap._shared.asked import asked_as
from phasemap._shared.checks import number
from phasemap._shared.errors import InputError
from phasemap._shared.quantities import Scalar, is_in, unit_of
from phasemap.experiment.generate.arguments import Field, Labels, PixelSize, at_least, is_x, pixel_centres, sized

_TIE = 1e-9  # of a period: a pixel centre on an edge is past it in every repeat, however the division is rounded


@asked_as(width="period", fraction="duty", spacing="period")
def stripes(
    shape: Sequence[int], pixel_size: PixelSize, *, period: Scalar, duty: Scalar = 0.5, angle: Scalar = 0.0
) -> Labels:
    """Straight stripes, as of a grating or a layered composite.

    Parameters
    ----------
    shape, pixel_size
        (ny, nx); side of a pixel [m], or its (dy, dx).
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

    Examples
    --------
    >>> stripes((2, 8), 1e-9, period=4e-9)
    array([[1, 1, 0, 0, 1, 1, 0, 0],
           [1, 1, 0, 0, 1, 1, 0, 0]], dtype=uint8)
    """
    y, x, (dy, dx) = pixel_centres(shape, pixel_size, 24)
    towards = math.radians(number("angle", angle, "degree"))
    duty = number("duty", duty, "1", above=0, below=1)
    across = max(abs(math.sin(towards)) * dy, abs(math.cos(towards)) * dx)
    period = at_least("period", period, 2 * across, "two pixels")
    phase = (math.cos(towards) * x + math.sin(towards) * y) / period + _TIE
    return (phase - np.floor(phase) < duty).astype(np.uint8)


@asked_as(size="side", period="side")
def checkerboard(shape: Sequence[int], pixel_size: PixelSize, *, side: Scalar) -> Labels:
    """Squares in turn, as of a patterned monolayer or a calibration standard.

    Parameters
    ----------
    shape, pixel_size
        (ny, nx); side of a pixel [m], or its (dy, dx).
    side : float
        Side of a square [m], one pixel or more.

    Returns
    -------
    ndarray of uint8, shape (ny, nx)
        Labels 0 and 1, 0 in the top left corner.

    Examples
    --------
    >>> checkerboard((2, 4), 1e-9, side=1e-9)
    array([[0, 1, 0, 1],
           [1, 0, 1, 0]], dtype=uint8)
    """
    y, x, steps = pixel_centres(shape, pixel_size, 16)
    side = at_least("side", side, max(steps), "one pixel")
    return ((np.floor(y / side + _TIE) + np.floor(x / side + _TIE)) % 2).astype(np.uint8)


@asked_as()
def step(
    shape: Sequence[int], pixel_size: PixelSize, *, position: Scalar | None = None, axis: Literal["x", "y"] = "x"
) -> Labels:
    """Two halves with a sharp edge between them.

    Parameters
    ----------
    shape, pixel_size
        (ny, nx); side of a pixel [m], or its (dy, dx).
    position : float, optional
        Distance of the edge from the left or the top of the image [m]; None is the middle.
    axis : {"x", "y"}
        Direction in which one crosses the edge.

    Returns
    -------
    ndarray of uint8, shape (ny, nx)
        0 before the edge, 1 behind it.

    Examples
    --------
    >>> step((1, 4), 1e-9, position=1e-9)
    array([[0, 1, 1, 1]], dtype=uint8)
    """
    y, x, (dy, dx) = pixel_centres(shape, pixel_size, 2)
    across, length = (x, x.size * dx) if is_x(axis) else (y, y.size * dy)
    edge = 0.5 * length if position is None else number("position", position, "m", above=0, below=length)
    labels = np.broadcast_to(across > edge, (y.size, x.size))
    return labels.astype(np.uint8, order="C")


@asked_as(low="start", high="stop")
def gradient(shape: Sequence[int], *, start: Scalar, stop: Scalar, axis: Literal["x", "y"] = "x") -> Field:
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
        The field [the same unit].

    Examples
    --------
    >>> gradient((1, 5), start=1.0, stop=3.0)
    array([[1. , 1.5, 2. , 2.5, 3. ]])
    """
    ny, nx = sized(shape, 8)
    ends = number("start", start, ""), number("stop", stop, "")
    units = [unit_of(end) for end in (start, stop)]
    if all(units) and not is_in(stop, units[0]):
        raise InputError("stop", stop, f"a value in {units[0]} as start is, or in another unit of the same kind")
    line = np.linspace(*ends, nx) if is_x(axis) else np.linspace(*ends, ny)[:, None]
    return np.broadcast_to(line, (ny, nx)).copy()
