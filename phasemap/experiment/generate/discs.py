"""Discs that do not overlap, in a matrix: put down at random, then pushed apart."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.asked import asked_as
from phasemap._shared.checks import WIDEST, number
from phasemap._shared.errors import InputError
from phasemap._shared.memory import check_fits
from phasemap._shared.quantities import Scalar
from phasemap._shared.random_numbers import generator
from phasemap.experiment.generate.arguments import Field, Labels, PixelSize, at_least, pixel_centres

Pairs = tuple[NDArray[np.intp], NDArray[np.intp]]

_DISC = 300  # byte that a disc takes while discs are put down
_DENSEST = 0.7  # equal discs at random jam near 0.84; from here on pushing them apart takes long


@asked_as(fraction="area_fraction", coverage="area_fraction", size="radius")
def particles(
    shape: Sequence[int],
    pixel_size: PixelSize,
    *,
    radius: Scalar,
    area_fraction: Scalar,
    spread: Scalar = 0.0,
    periodic: bool = True,
    seed: int = 0,
) -> Labels:
    """Discs that do not overlap, in a matrix: a filled or rubber-toughened polymer.

    Discs are put at random where there is room, the largest first; those that find none push the others aside.

    Parameters
    ----------
    shape, pixel_size
        (ny, nx); side of a pixel [m], or its (dy, dx).
    radius : float
        Mean radius of a disc [m], one pixel or more.
    area_fraction : float
        Part of the image that discs cover [1], above 0 and at most 0.7; kept to within half a disc.
    spread : float
        Standard deviation of the (log-normal) radii over their mean [1], at least 0 and at most 0.5.
    periodic : bool
        Discs cut by one side of the image go on at the opposite one; False keeps all of them whole and inside.
    seed : int
        Same seed, same discs.

    Returns
    -------
    ndarray of uint8, shape (ny, nx)
        0 in the matrix, 1 in the particles.

    Examples
    --------
    >>> labels = particles((128, 128), 1e-9, radius=6e-9, area_fraction=0.25)
    >>> round(float(labels.mean()), 2)
    0.25
    """
    y, x, (dy, dx) = pixel_centres(shape, pixel_size, 1)
    sides = np.array([y.size * dy, x.size * dx])
    radius = number("radius", at_least("radius", radius, max(dy, dx), "one pixel"), "m", maximum=WIDEST)
    area_fraction = number("area_fraction", area_fraction, "1", above=0, maximum=_DENSEST)
    spread = number("spread", spread, "1", minimum=0, maximum=0.5)
    rng = generator(seed, "particles")
    discs = area_fraction * float(sides.prod()) / (math.pi * radius**2)
    check_fits(f"an image of {discs:.3g} discs", _DISC * discs, "Take fewer or larger discs.")
    radii = _radii(rng, radius, spread, area_fraction * float(sides.prod()))
    widest = 0.5 * (float(sides.min()) - max(dy, dx))
    if not radii.size:
        raise InputError("radius", radius, "a smaller one", "One disc is more than area_fraction of the image.")
    if radii[0] > widest:
        raise InputError("largest radius", radii[0], f"{widest:g} m or less, to fit into the image")
    centres = _without_overlap(rng, radii, sides, periodic)
    labels = np.zeros((y.size, x.size), np.uint8)
    for (cy, cx), r in zip(centres, radii, strict=True):
        rows = np.arange(math.floor((cy - r) / dy), math.ceil((cy + r) / dy))
        cols = np.arange(math.floor((cx - r) / dx), math.ceil((cx + r) / dx))
        inside = (((rows + 0.5) * dy - cy) ** 2)[:, None] + ((cols + 0.5) * dx - cx) ** 2 <= r * r
        labels[np.ix_(rows % y.size, cols % x.size)] |= inside
    return labels


def _radii(rng: np.random.Generator, radius: float, spread: float, area: float) -> Field:
    """Draw log-normal radii, the largest first, as many as come closest to `area`."""
    sigma = math.sqrt(math.log1p(spread**2))
    enough = 50 + math.ceil(2 * area / (math.pi * radius**2))
    radii = radius * np.exp(sigma * rng.standard_normal(enough) - 0.5 * sigma**2)
    covered = np.concatenate(([0.0], np.cumsum(math.pi * radii**2)))
    return np.sort(radii[: np.abs(covered - area).argmin()])[::-1]


def _without_overlap(rng: np.random.Generator, radii: Field, sides: Field, periodic: bool) -> Field:
    """Place discs: at random while there is room, then by pushing neighbours apart."""
    box = sides if periodic else None
    margin = np.zeros((radii.size, 1)) if periodic else radii[:, None]
    centres: Field = margin + rng.random((radii.size, 2)) * (sides - 2 * margin)
    settled = np.zeros(radii.size, np.bool_)
    for _ in range(50):
        a, b = _neighbours(centres, radii, box)
        late = np.unique(np.where(settled[b], a, b))
        settled[:] = True
        settled[late] = False
        if not late.size:
            return centres
        centres[late] = margin[late] + rng.random((late.size, 2)) * (sides - 2 * margin[late])
    for _ in range(400):
        pairs = _neighbours(centres, 1.25 * radii, box)
        if not _overlaps(centres, radii, box, pairs)[0].size:
            return centres
        for _ in range(10):
            a, b, apart, overlap = _overlaps(centres, radii * 1.002, box, pairs)
            push = 0.5 * overlap[:, None] * apart
            np.add.at(centres, b, push)
            np.add.at(centres, a, -push)
            if periodic:
                centres %= sides
                centres[centres >= sides] = 0.0  # where a tiny negative number was rounded
            else:
                np.clip(centres, margin, sides - margin, out=centres)
    raise InputError("number of discs", radii.size, "fewer", "They jam in this image; lower area_fraction.")


def _neighbours(centres: Field, radii: Field, box: Field | None) -> Pairs:
    """Return the pairs of discs that overlap, the larger disc first."""
    from scipy.spatial import cKDTree

    a, b = cKDTree(centres, boxsize=box).query_pairs(2 * radii[0], output_type="ndarray").T
    return _overlaps(centres, radii, box, (a, b))[:2]


def _overlaps(
    centres: Field, radii: Field, box: Field | None, pairs: Pairs
) -> tuple[NDArray[np.intp], NDArray[np.intp], Field, Field]:
    """Return those pairs that overlap, the unit vectors from first to second, and the depth of the overlap [m]."""
    a, b = pairs
    between = centres[b] - centres[a]
    if box is not None:
        between -= box * np.round(between / box)
    distance = np.hypot(between[:, 0], between[:, 1])
    overlap = radii[a] + radii[b] - distance
    close = (overlap > 0) & (distance > 0)
    return a[close], b[close], between[close] / distance[close, None], overlap[close]
