"""Surfaces that people image, made from a few numbers and a seed.

A generator returns labels (uint8, for `Surface.from_labels`) or a field (float64, a map or a topography). Lengths are
in m, the same arguments give the same bytes, and the random patterns are periodic: they tile without a seam.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.checks import WIDEST, number, pixel_pair, shape_pair, whole
from phasemap._shared.errors import InputError
from phasemap._shared.memory import check_fits
from phasemap._shared.quantities import Scalar

__all__ = ["blend", "checkerboard", "gradient", "lamellae", "particles", "roughness", "step", "stripes"]

Labels = NDArray[np.uint8]
Field = NDArray[np.float64]
Pairs = tuple[NDArray[np.intp], NDArray[np.intp]]
PixelSize: TypeAlias = "Scalar | Sequence[Scalar]"

_TIE = 1e-9  # of a period: a pixel centre on an edge is past it in every repeat, however the division is rounded
_LONGEST = 10_000  # steps of relaxation; after some hundreds a pattern hardly changes
_DISC = 300  # byte that a disc takes while discs are put down
_DENSEST = 0.7  # equal discs at random jam near 0.84; from here on pushing them apart takes long


def stripes(
    shape: Sequence[int], pixel_size: PixelSize, *, period: Scalar, duty: Scalar = 0.5, angle: Scalar = 0.0
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
    y, x, (dy, dx) = _grid(shape, pixel_size, 24)
    towards = math.radians(number("angle", angle, "degree"))
    duty = number("duty", duty, "1", above=0, below=1)
    across = max(abs(math.sin(towards)) * dy, abs(math.cos(towards)) * dx)
    period = _at_least("period", period, 2 * across, "two pixels")
    phase = (math.cos(towards) * x + math.sin(towards) * y) / period + _TIE
    return (phase - np.floor(phase) < duty).astype(np.uint8)


def checkerboard(shape: Sequence[int], pixel_size: PixelSize, *, side: Scalar) -> Labels:
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
    y, x, steps = _grid(shape, pixel_size, 16)
    side = _at_least("side", side, max(steps), "one pixel")
    return ((np.floor(y / side + _TIE) + np.floor(x / side + _TIE)) % 2).astype(np.uint8)


def step(
    shape: Sequence[int],
    pixel_size: PixelSize,
    *,
    position: Scalar | None = None,
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
    y, x, (dy, dx) = _grid(shape, pixel_size, 2)
    across, length = (x, x.size * dx) if _is_x(axis) else (y, y.size * dy)
    edge = 0.5 * length if position is None else number("position", position, "m", above=0, below=length)
    labels = np.broadcast_to(across > edge, (y.size, x.size))
    return labels.astype(np.uint8, order="C")


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

    Raises
    ------
    InputError
        If a value is not finite, or the axis is neither x nor y.

    Examples
    --------
    >>> gradient((1, 5), start=1.0, stop=3.0)
    array([[1. , 1.5, 2. , 2.5, 3. ]])
    """
    ny, nx = _sized(shape, 8)
    ends = number("start", start, ""), number("stop", stop, "")
    line = np.linspace(*ends, nx) if _is_x(axis) else np.linspace(*ends, ny)[:, None]
    return np.broadcast_to(line, (ny, nx)).copy()


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
    shape : (int, int)
        (ny, nx).
    pixel_size : float or (float, float)
        Side of a pixel [m], or its (dy, dx).
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

    Raises
    ------
    InputError
        If a value is out of range, or the discs do not fit into the image.

    Examples
    --------
    >>> labels = particles((128, 128), 1e-9, radius=6e-9, area_fraction=0.25)
    >>> round(float(labels.mean()), 2)
    0.25
    """
    y, x, (dy, dx) = _grid(shape, pixel_size, 1)
    sides = np.array([y.size * dy, x.size * dx])
    radius = number("radius", _at_least("radius", radius, max(dy, dx), "one pixel"), "m", maximum=WIDEST)
    area_fraction = number("area_fraction", area_fraction, "1", above=0, maximum=_DENSEST)
    spread = number("spread", spread, "1", minimum=0, maximum=0.5)
    if not isinstance(periodic, bool):
        raise InputError("periodic", periodic, "True or False")
    rng = _generator(seed)
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


def lamellae(
    shape: Sequence[int],
    pixel_size: PixelSize,
    *,
    period: Scalar,
    fraction: Scalar = 0.5,
    annealing: int = 80,
    seed: int = 0,
) -> Labels:
    """Fingerprint of a block copolymer with upright lamellae.

    Noise relaxed by the Swift-Hohenberg equation [1]_, which lets waves of one length win, and cut at a level.

    Parameters
    ----------
    shape : (int, int)
        (ny, nx).
    pixel_size : float or (float, float)
        Side of a pixel [m], or its (dy, dx).
    period : float
        Lamellar period [m], four pixels or more and at most half the image.
    fraction : float
        Part of the image with label 1 [1], above 0 and below 1; kept to one pixel.
    annealing : int
        Steps of relaxation: 20 gives short broken lamellae, 200 long and well aligned ones; at most 10 000.
    seed : int
        Same seed, same pattern.

    Returns
    -------
    ndarray of uint8, shape (ny, nx)
        Labels 0 and 1.

    Raises
    ------
    InputError
        If a value is out of range.

    References
    ----------
    .. [1] J. Swift, P. C. Hohenberg, Phys. Rev. A 15, 319 (1977).

    Examples
    --------
    >>> float(lamellae((64, 64), 2e-9, period=28e-9).mean())
    0.5
    """
    ny_nx, sides = _sized(shape, 40), pixel_pair(pixel_size)
    period = _wave("period", period, ny_nx, sides)
    fraction = number("fraction", fraction, "1", above=0, below=1)
    whole("annealing", annealing, 1)
    whole("annealing", annealing, 1, _LONGEST)
    wave = _wavenumber(ny_nx, sides) * period
    time, drive = 2.0, 0.3
    growth = np.exp(time * (drive - (1 - wave**2) ** 2))
    u: Field = 0.1 * _generator(seed).standard_normal(ny_nx)
    for _ in range(annealing):
        u = np.fft.irfft2(np.fft.rfft2(u) * growth, ny_nx)
        u /= np.sqrt(1 + 2 * time * u * u)  # the exact step of du/dt = -u^3
    return _highest(u, fraction)


def blend(
    shape: Sequence[int], pixel_size: PixelSize, *, spacing: Scalar, fraction: Scalar = 0.5, seed: int = 0
) -> Labels:
    """Two polymers that came apart by spinodal decomposition.

    Waves of one length and random direction, cut at a level (Cahn's picture of the early stage [1]_), then rounded by
    the Cahn-Hilliard equation, stepped semi-implicitly in Fourier space [2]_: domains entwined at equal parts, droplets
    at unequal ones.

    Parameters
    ----------
    shape : (int, int)
        (ny, nx).
    pixel_size : float or (float, float)
        Side of a pixel [m], or its (dy, dx).
    spacing : float
        Distance between domains [m], four pixels or more and at most half the image; it coarsens by about a tenth.
    fraction : float
        Part of the image with label 1 [1], at least 0.05 and at most 0.95 (fewer droplets would dissolve); kept to one
        pixel.
    seed : int
        Same seed, same pattern.

    Returns
    -------
    ndarray of uint8, shape (ny, nx)
        Labels 0 and 1.

    Raises
    ------
    InputError
        If a value is out of range.

    References
    ----------
    .. [1] J. W. Cahn, J. Chem. Phys. 42, 93 (1965).
    .. [2] D. J. Eyre, MRS Proc. 529, 39 (1998).

    Examples
    --------
    >>> labels = blend((64, 64), 10e-9, spacing=160e-9, fraction=0.25)
    >>> float(labels.mean())
    0.25
    """
    ny_nx, sides = _sized(shape, 64), pixel_pair(pixel_size)
    spacing = _wave("spacing", spacing, ny_nx, sides)
    fraction = number("fraction", fraction, "1", minimum=0.05, maximum=0.95)
    wave = _wavenumber(ny_nx, sides) * spacing
    early = _filtered_noise(_generator(seed), ny_nx, np.exp(-0.5 * ((wave - 1) / 0.25) ** 2))
    u: Field = np.where(_highest(early, fraction), 1.0, -1.0)
    width, time = 0.05, 0.02  # lengths in units of the spacing
    q2 = (2 * math.pi * wave) ** 2
    kept = 1 / (1 + time * q2 * (2 + width**2 * q2))
    gained = time * q2 * kept
    spectrum = np.fft.rfft2(u)
    for _ in range(40):
        spectrum *= kept
        spectrum += gained * np.fft.rfft2(u * (3 - u * u))
        u = np.fft.irfft2(spectrum, ny_nx)
    return _highest(u, fraction)


def roughness(
    shape: Sequence[int],
    pixel_size: PixelSize,
    *,
    rms: Scalar,
    correlation_length: Scalar,
    hurst: Scalar = 0.8,
    seed: int = 0,
) -> Field:
    """Self-affine topography, flat beyond the correlation length.

    Gaussian heights with the spectrum C(q) ~ (1 + q^2 xi^2)^-(1 + H) [1]_.

    Parameters
    ----------
    shape : (int, int)
        (ny, nx).
    pixel_size : float or (float, float)
        Side of a pixel [m], or its (dy, dx).
    rms : float
        Standard deviation of the heights [m], at least 0; met exactly.
    correlation_length : float
        xi [m], one pixel or more and at most the shorter side of the image.
    hurst : float
        H [1], above 0 and at most 1; small is jagged, 1 is smooth.
    seed : int
        Same seed, same topography.

    Returns
    -------
    ndarray, shape (ny, nx)
        Heights [m] with mean 0.

    Raises
    ------
    InputError
        If a value is out of range.

    References
    ----------
    .. [1] G. Palasantzas, Phys. Rev. B 48, 14472 (1993).

    Examples
    --------
    >>> z = roughness((64, 64), 4e-9, rms=0.5e-9, correlation_length=30e-9)
    >>> round(float(z.std()) * 1e9, 12)
    0.5
    """
    ny_nx, sides = _sized(shape, 32), pixel_pair(pixel_size)
    rms = number("rms", rms, "m", minimum=0, maximum=WIDEST)
    hurst = number("hurst", hurst, "1", above=0, maximum=1)
    extent = min(n * side for n, side in zip(ny_nx, sides, strict=True))
    correlation_length = _at_least("correlation_length", correlation_length, max(sides), "one pixel")
    number("correlation_length", correlation_length, "m", maximum=extent)
    q = 2 * math.pi * correlation_length * _wavenumber(ny_nx, sides)
    z = _filtered_noise(_generator(seed), ny_nx, (1 + q * q) ** (-0.5 * (1 + hurst)))
    z -= z.mean()
    deviation = z.std()
    return z * (rms / deviation) if deviation else z


def _sized(shape: Sequence[int], per_pixel: int) -> tuple[int, int]:
    """Return (ny, nx) of an image that takes so many bytes a pixel while it is made (measured), if there are."""
    ny, nx = shape_pair(shape)
    check_fits(f"to generate {ny} x {nx} pixels", float(ny) * nx * per_pixel)
    return ny, nx


def _grid(shape: Sequence[int], pixel_size: PixelSize, per_pixel: int) -> tuple[Field, Field, tuple[float, float]]:
    """Return the pixel centres as a column y and a row x [m], and the pixel's (dy, dx); `per_pixel` is `_sized`'s."""
    (ny, nx), (dy, dx) = _sized(shape, per_pixel), pixel_pair(pixel_size)
    y, x = (np.arange(n, dtype=np.float64) + 0.5 for n in (ny, nx))
    return (y * dy)[:, None], x * dx, (dy, dx)


def _at_least(name: str, value: Scalar, minimum: float, pixels: str) -> float:
    """Return a length [m], or raise `InputError` for one that the pixels cannot show."""
    length = number(name, value, "m", above=0)
    if length < minimum * (1 - 1e-9):
        raise InputError(name, value, f"{minimum:g} m or more, {pixels} of this image")
    return length


def _wave(name: str, value: Scalar, shape: tuple[int, int], sides: tuple[float, float]) -> float:
    """Return a length [m], or raise `InputError` unless four pixels show the wave and the image holds two of it."""
    length = _at_least(name, value, 4 * max(sides), "four pixels")
    longest = 0.5 * min(n * side for n, side in zip(shape, sides, strict=True))
    if length > longest:
        raise InputError(name, value, f"{longest:g} m or less, half of this image")
    return length


def _is_x(axis: str) -> bool:
    if not isinstance(axis, str) or axis not in {"x", "y"}:
        raise InputError("axis", axis, "'x' or 'y'")
    return axis == "x"


def _generator(seed: int) -> np.random.Generator:
    return np.random.default_rng(whole("seed", seed, 0))


def _wavenumber(shape: tuple[int, int], sides: tuple[float, float]) -> Field:
    """Return 1 / wavelength [1/m] of each entry of `numpy.fft.rfft2`."""
    wavenumber: Field = np.hypot(np.fft.fftfreq(shape[0], sides[0])[:, None], np.fft.rfftfreq(shape[1], sides[1]))
    return wavenumber


def _filtered_noise(rng: np.random.Generator, shape: tuple[int, int], amplitude: Field) -> Field:
    """Return Gaussian noise, each wave multiplied by `amplitude`."""
    return np.fft.irfft2(np.fft.rfft2(rng.standard_normal(shape)) * amplitude, shape)


def _highest(field: Field, fraction: float) -> Labels:
    """Label the highest pixels 1, as many as make up `fraction`."""
    count = round(fraction * field.size)
    labels = np.zeros(field.size, np.uint8)
    split = min(field.size - count, field.size - 1)
    labels[np.argpartition(field.reshape(-1), split)[field.size - count :]] = 1
    return labels.reshape(field.shape)


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
