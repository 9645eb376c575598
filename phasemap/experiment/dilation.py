"""What a tip of finite size sees of a relief: the surface dilated by the shape of the tip.

The tip is a sphere that goes over, along its tangent, into a cone: the blunted cone (B. J. Briscoe, K. S. Sebastian and
M. J. Adams, J. Phys. D 27 (1994) 1156). With the half angle a of the cone its surface is above its apex, at distance r
from the axis, by

    s(r) = R - sqrt(R^2 - r^2)                        up to r = R cos(a)
    s(r) = R (1 - sin(a)) + (r - R cos(a)) / tan(a)   beyond

Over each pixel the apex comes down until the tip touches the relief t somewhere, to max over d of t(x + d) - s(|d|)
(J. S. Villarrubia, J. Res. Natl. Inst. Stand. Technol. 102 (1997) 425, section 4, "dilation").
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.arrays import Array, is_uniform, read_only
from phasemap._shared.checks import number
from phasemap._shared.memory import check_fits
from phasemap._shared.plausible import unquestioned
from phasemap.experiment.surface_variables import QUANTITIES

if TYPE_CHECKING:
    from phasemap.experiment.microscope import Tip
    from phasemap.experiment.surface import Surface

IndexArray = NDArray[np.int32]

HALF_ANGLE = 20.0  # degree; what makers of etched silicon tips state is 10 to 25
OFFSET = 80  # byte that an offset takes while offsets are put in order (measured)
TILE = 64  # pixels; a square of them stays in the cache, and few are near the highest relief


def dilated(surface: Surface, tip: Tip, half_angle: float = HALF_ANGLE) -> Surface:
    """Return the surface as a tip of finite size meets it; one that is flat as it is.

    The topography becomes the height of the apex when the tip touches, and each pixel has the material of the point
    that the tip touches, the nearest of them where there are several. Nothing lies beyond the edges, which is the same
    as if the outermost pixels went on for ever.

    On a slope m the apex is R (sqrt(1 + m^2) - 1) higher than the pixel below it, for the tip touches at its side. The
    relief is known at the centres of pixels only, which must be small against R.

    `half_angle`: between the axis and the flank of the cone into which the tip widens [degree], above 0 and below 90.
    """
    half_angle = math.radians(number("half_angle", half_angle, "degree", above=0, below=90))
    relief = surface.topography
    if relief is None or not np.ptp(relief):
        return surface
    apex, touched = _lower(relief, surface.pixel_size, tip.radius, half_angle)
    return seen_at(surface, touched, apex)


def tip_profile(distance: Array, radius: float, half_angle: float) -> Array:
    """Height of the tip's surface above its apex [m], at distances from its axis [m]; the angle of its cone in rad."""
    tangent = radius * math.cos(half_angle)
    inside = np.minimum(distance, tangent)
    sphere = inside**2 / (radius + np.sqrt(radius**2 - inside**2))  # R - sqrt(R^2 - r^2), without cancellation
    height: Array = sphere + (distance - inside) / math.tan(half_angle)
    return height


def seen_at(surface: Surface, pixels: NDArray[np.integer], topography: Array | None) -> Surface:
    """The surface with another topography [m], and the materials of other pixels, each as ``row * nx + column``."""
    maps: dict[str, Any] = {"topography": None if topography is None else read_only(topography)}
    for name in QUANTITIES:
        values = getattr(surface, name) if name != "topography" else None
        if values is not None and not is_uniform(values):
            maps[name] = read_only(values.reshape(-1)[pixels])
    with unquestioned():
        return replace(surface, **maps)


def _lower(
    relief: Array, pixel_size: tuple[float, float], radius: float, half_angle: float
) -> tuple[Array, IndexArray]:
    """Height of the apex over each pixel [m], and the pixel it touches, as ``row * nx + column``."""
    offsets, rises = _reachable(relief, pixel_size, radius, half_angle)
    margin = [int(most) for most in offsets.max(axis=0)]
    around = np.pad(relief, [(most, most) for most in margin], constant_values=-np.inf)
    apex = relief.copy()
    which = np.zeros(relief.shape, np.int32)  # offset at which each pixel is touched
    for rows, columns in _tiles(relief.shape):
        wide = around[rows.start : rows.stop + 2 * margin[0], columns.start : columns.stop + 2 * margin[1]]
        _lower_tile(apex[rows, columns], which[rows, columns], wide, offsets + margin, rises)
    shift = (offsets[:, 0] * relief.shape[1] + offsets[:, 1]).astype(np.int32)
    touched: IndexArray = np.arange(relief.size, dtype=np.int32).reshape(relief.shape) + shift[which]
    return apex, touched


def _lower_tile(apex: Array, which: IndexArray, around: Array, corners: NDArray[np.intp], rises: Array) -> None:
    """Raise the apex over the pixels of a tile, in place, to where the tip touches.

    `around` is the relief of the tile with a margin, and `corners` say where in it the tile lies, moved by each offset.
    """
    height, width = apex.shape
    highest = around.max()
    for number_of, ((row, column), rise) in enumerate(zip(corners.tolist(), rises, strict=True)):
        if highest - rise <= apex.min():
            return  # no later offset, where the tip rises more, can touch
        touching = around[row : row + height, column : column + width] - rise
        higher = touching > apex  # strictly: of several the nearest is kept
        np.copyto(apex, touching, where=higher)
        np.copyto(which, number_of, where=higher)


def _reachable(
    relief: Array, pixel_size: tuple[float, float], radius: float, half_angle: float
) -> tuple[NDArray[np.intp], Array]:
    """Offsets, shape (n, 2), in rows and columns, where the tip rises less than the relief does, and by how much.

    The nearest come first, the pixel itself before all.
    """
    depth = float(np.ptp(relief))
    round_part = radius * (1 - math.sin(half_angle))
    if depth <= round_part:
        reach = math.sqrt(depth * (2 * radius - depth))
    else:
        reach = radius * math.cos(half_angle) + (depth - round_part) * math.tan(half_angle)
    most = [math.ceil(min(reach / side, size - 1)) for size, side in zip(relief.shape, pixel_size, strict=True)]
    check_fits("a tip that reaches so far", OFFSET * math.prod(2 * m + 1 for m in most), "Take fewer pixels.")
    steps = [np.arange(-m, m + 1) for m in most]
    distance = np.hypot(steps[0][:, np.newaxis] * pixel_size[0], steps[1] * pixel_size[1])
    rise = tip_profile(distance, radius, half_angle)
    rows, columns = np.nonzero((rise < depth) | (distance == 0))
    order = np.argsort(distance[rows, columns], kind="stable")
    rows, columns = rows[order], columns[order]
    return np.stack([steps[0][rows], steps[1][columns]], axis=1), rise[rows, columns]


def _tiles(shape: tuple[int, ...]) -> Iterator[tuple[slice, slice]]:
    """Squares that cover the image."""
    for row in range(0, shape[0], TILE):
        for column in range(0, shape[1], TILE):
            yield slice(row, min(row + TILE, shape[0])), slice(column, min(column + TILE, shape[1]))
