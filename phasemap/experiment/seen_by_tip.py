"""Surface as a tip of finite size sees it: a relief dilated by its shape, edges as wide as the area that it touches.

The tip is a blunted cone (theory, Eq. (model-28)), and the law of mixing that of parts that act side by side under the
pressure of Hertz's disc, and the attraction around it (theory, Eq. (model-29)).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels import columns as col
from phasemap._shared.arrays import Array, as_array, is_uniform, read_only
from phasemap._shared.checks import number, numbers
from phasemap._shared.errors import InputError, Word
from phasemap._shared.memory import check_fits
from phasemap._shared.notices import unquestioned
from phasemap.experiment.lever_numbers import lever_of
from phasemap.experiment.material_rows import properties
from phasemap.experiment.microscope import Microscope, Tip
from phasemap.experiment.surface_maps import QUANTITIES, where

if TYPE_CHECKING:
    from phasemap.experiment.surface import Surface

IndexArray = NDArray[np.int32]

HALF_ANGLE = 20.0  # degree; what makers of etched silicon tips state is 10 to 25
OFFSET = 80  # byte that an offset takes while offsets are put in order (measured)
TILE = 64  # pixels; a square of them stays in the cache, and few are near the highest relief


def dilated(surface: Surface, tip: Tip, half_angle: float = HALF_ANGLE) -> Surface:
    """Return the surface as a tip of finite size meets it; one that is flat as it is.

    The topography becomes the height of the apex when the tip touches, and each pixel has the material of the point
    that the tip touches, the nearest of them where there are several. Beyond the edges the outermost pixels go on for
    ever. On a slope m the apex is R (sqrt(1 + m^2) - 1) higher than the pixel below it, for the tip touches at its
    side. The relief is known at the centres of pixels only, which must be small against R. `half_angle`: of the cone
    into which the tip widens [degree], above 0 and below 90.
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
    return sphere + (distance - inside) / math.tan(half_angle)


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


LEVELS = 12  # discs of different size that a map is seen with; between two of them it is interpolated
HALVINGS = 60
FINE = 12  # points a side at which a weight is taken within a pixel
DIGITS = 6  # of the way from the lowest to the highest value of a map
FAINTEST = 2e-3  # of the attraction's pressure, where its reach ends


def typical_depth(materials: Array, viscous: bool, scope: Microscope, setpoint: float) -> Array:
    """Largest indentation of the repulsive orbit, to first order in depth over amplitude [m]; NaN without a material.

    For d = D - A theta^2/2 in contact the first harmonics of the DMT force (Wang 1999, Eqs. 2-4) are P =
    (3 pi/8) sqrt(2/A) K sqrt(R) D^2/(pi k) - f0 (2 sqrt(2 D/A) + tail)/(pi k), where tail is that of the attraction
    outside, and S = (omega alpha1/(4 A^2 sqrt(R))) (2 A)^(3/2) D^2 of the damping.

    `materials` (shape (n, 4) or (n, 10)): as for `phasemap.experiment.material_rows.properties`.
    """
    stiffness, adhesion, damping = properties(materials, viscous, scope)
    lever = lever_of(scope)
    omega, k, drive = lever[col.OMEGA], lever[col.STIFFNESS], lever[col.DRIVE]
    amplitude, radius = setpoint * scope.driven_amplitude, scope.tip.radius
    pull = scope.interaction.law.pull(stiffness, adhesion, radius)
    reach = scope.interaction.decay_length

    def miss(depth: Array) -> Array:
        # Outside, the gap is sqrt(2 A D) x + A x^2/2 at an angle x from contact: exact for large D and for D = 0.
        steep = np.sqrt(2 * amplitude * depth)
        tail = 0.0 if reach is None else 2 * reach / (steep + np.sqrt(8 * amplitude * reach) / np.pi)
        push = 0.375 * np.sqrt(2 / amplitude) * stiffness * np.sqrt(radius) * depth**2 / k
        push = push - pull * (2 * np.sqrt(2 * depth / amplitude) + tail) / (np.pi * k)
        drag = omega * damping / np.sqrt(radius) * (2 / amplitude) ** 1.5 * amplitude * depth**2 / 4
        across: Array = push + amplitude * lever[col.DYNAMIC_STIFFNESS]
        along: Array = drag + amplitude * lever[col.DYNAMIC_LOSS]
        return np.sign(across) * across**2 + along**2 - drive**2

    low, high = np.zeros(len(materials)), np.full(len(materials), amplitude)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        deep = miss(middle) > 0
        low, high = np.where(deep, low, middle), np.where(deep, middle, high)
    return np.where(np.isfinite(stiffness + adhesion + damping), 0.5 * (low + high), np.nan)


def seen_by(surface: Surface, scope: Microscope, setpoint: float, depth: Any) -> Surface:
    """See `phasemap.Surface.seen_by`."""
    law = scope.interaction.law
    if depth is None:
        if law.spread != 0.5 or law.takes_film:
            allowed = f"a map of depths in m where the contact is {law.name!r}"
            raise InputError("depth", None, allowed, "That may be the indentation of an image.")
        materials, inverse = surface.unique()
        depth = typical_depth(materials, surface.viscosity is not None, scope, setpoint)[inverse]
    else:
        depth = _depths(surface, depth)
    radius = law.radius_at(np.maximum(np.broadcast_to(depth, surface.shape), 0.0), scope.tip.radius)
    seen = _Seen(np.nan_to_num(radius), surface.pixel_size)
    reach = scope.interaction.decay_length
    far = 0.0 if reach is None else 2 * scope.tip.radius * reach

    def disc(r2: Array, a: float) -> Array:
        return np.where(r2 <= a * a, 1.0, 0.0)

    def pressure(r2: Array, a: float) -> Array:
        return np.asarray(np.sqrt(np.maximum(1 - r2 / (a * a), 0.0))) if a > 0 else disc(r2, a)

    def attraction(r2: Array, a: float) -> Array:
        return np.asarray((1 + np.maximum(r2 - a * a, 0.0) / far) ** -3) if far > 0 else disc(r2, a)

    beyond = np.sqrt(far * (FAINTEST ** (-1 / 3) - 1))
    if surface.relaxes:
        allowed = "None where edges are seen by the tip: how relaxing materials mix under it is not known"
        raise InputError("relaxation_time", Word("given"), allowed)
    for name in ("liquid_film", "contact_angle"):
        water = getattr(surface, name)
        if water is not None and np.unique(water[np.isfinite(water)]).size > 1:
            allowed = "the same everywhere where edges are seen by the tip: how films mix under it is not known"
            raise InputError(name, Word("varied"), allowed)
    loss = "viscosity" if surface.damping is None else "damping"
    poisson_ratio = seen(surface.poisson_ratio, pressure)
    plane = surface.modulus / (1 - surface.poisson_ratio**2)
    stiff = seen(plane, pressure)
    same = (stiff == plane) & (poisson_ratio == surface.poisson_ratio)
    changed: dict[str, Any] = {
        "modulus": np.where(same, surface.modulus, stiff * (1 - poisson_ratio**2)), "poisson_ratio": poisson_ratio,
        "thickness": _seen_film(surface.thickness, partial(seen, weight=pressure)),
        "adhesion": seen(surface.adhesion, attraction, float(beyond)), loss: seen(getattr(surface, loss), disc),
    }  # fmt: skip
    return replace(surface, **changed)


def _depths(surface: Surface, given: Any) -> Array:
    """The depths that the user gives [m], one or for each pixel."""
    allowed = "one finite number or a map of them, in m"
    depths = as_array("depth", numbers("depth", given, "m"), allowed)
    if depths.dtype.kind not in "fiu":
        raise InputError("depth", given, allowed)
    if depths.shape not in ((), surface.shape):
        raise InputError("shape of depth", depths.shape, f"{surface.shape}, or one number")
    bad = ~np.isfinite(depths) & np.isfinite(surface.modulus)
    if bad.any():
        value = np.broadcast_to(depths, bad.shape)[bad][0]
        raise InputError("depth", value, allowed, "" if depths.ndim == 0 else where(bad))
    return depths


def _seen_film(thickness: Array | None, seen: Callable[[Array], Array]) -> Array | None:
    """Thicknesses under the weight: means of the inverse, which is what stiffens the contact, and 0 for no film."""
    if thickness is None:
        return None
    with np.errstate(divide="ignore"):
        inverse = 1 / thickness
        mean = seen(inverse)
        return np.where(mean == inverse, thickness, 1 / mean)


class _Seen:
    """Maps under a weight whose radius changes from pixel to pixel."""

    def __init__(self, radius: Array, pixel_size: tuple[float, float]) -> None:
        self.radius, self.pixel_size = radius, pixel_size
        levels = np.unique(radius)
        self.levels = levels if len(levels) <= LEVELS else np.linspace(levels[0], levels[-1], LEVELS)

    def __call__(self, values: Array, weight: Callable[[Array, float], Array], beyond: float = 0.0) -> Array:
        """The mean of a map under ``weight(r2, a)`` [1 of m2, m], which ends at hypot(a, beyond)."""
        if np.nanmin(values) == np.nanmax(values):
            return values
        mean = np.zeros(values.shape)
        at = np.interp(self.radius, self.levels, np.arange(len(self.levels)))
        for level, a in enumerate(self.levels):
            part = np.maximum(1 - np.abs(at - level), 0.0)
            if part.any():
                mean += np.where(part > 0, part * self._mean(values, weight, float(a), beyond), 0.0)
        return mean

    def _mean(self, values: Array, weight: Callable[[Array, float], Array], a: float, beyond: float) -> Array:
        """The mean under the weight of one disc; NaN where there is no material, which counts nowhere else.

        The share of a pixel is the sum of the weight at FINE x FINE points within it.
        """
        from scipy.ndimage import maximum_filter, minimum_filter
        from scipy.signal import fftconvolve

        end = float(np.hypot(a, beyond))
        points = math.prod((2 * end / step + 3) * FINE for step in self.pixel_size)
        check_fits(f"to see edges with a disc of radius {end:.3g} m", 32 * points, "Give smaller depths.")
        reach = [int(np.ceil(end / step)) for step in self.pixel_size]  # in pixels
        if not any(reach):
            return values
        sides = []
        for pixels, step in zip(reach, self.pixel_size, strict=True):
            fine = (np.arange((2 * pixels + 1) * FINE) + 0.5) / FINE - pixels - 0.5
            sides.append(fine * step)
        r2 = sides[0][:, None] ** 2 + sides[1] ** 2
        shares = weight(r2, a) * (r2 <= end * end)
        kernel = shares.reshape(2 * reach[0] + 1, FINE, 2 * reach[1] + 1, FINE).sum(axis=(1, 3))
        if not kernel.any():
            return values
        pad = [(pixels, pixels) for pixels in reach]
        known = np.pad(np.isfinite(values) * 1.0, pad, mode="edge")
        padded = np.pad(np.nan_to_num(values), pad, mode="edge")
        low, high = np.nanmin(values), np.nanmax(values)
        total, weights = (fftconvolve(one, kernel, mode="valid") for one in (padded, known))
        with np.errstate(all="ignore"):
            share = np.clip((total / weights - low) / (high - low), 0.0, 1.0)
        mean = low + (high - low) * share.round(DIGITS)
        # What is the same all around stays so to the last bit, and no material is made that differs by rounding alone.
        size = kernel.shape
        least, most = minimum_filter(values, size, mode="nearest"), maximum_filter(values, size, mode="nearest")
        return np.where(np.isfinite(values), np.where(least == most, values, mean), np.nan)
