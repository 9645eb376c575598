"""Random patterns made in Fourier space: lamellae and blends of one wavelength, roughness of a spectrum."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from phasemap._shared.asked import asked_as
from phasemap._shared.checks import WIDEST, number, pixel_pair, whole
from phasemap._shared.quantities import Scalar
from phasemap._shared.random_numbers import generator
from phasemap.experiment.generate.arguments import Field, Labels, PixelSize, at_least, sized, wave_length

_LONGEST = 10_000  # steps of relaxation; after some hundreds a pattern hardly changes


@asked_as(area_fraction="fraction", spacing="period")
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
    shape, pixel_size
        (ny, nx); side of a pixel [m], or its (dy, dx).
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

    References
    ----------
    .. [1] J. Swift, P. C. Hohenberg, Phys. Rev. A 15, 319 (1977).

    Examples
    --------
    >>> float(lamellae((64, 64), 2e-9, period=28e-9).mean())
    0.5
    """
    ny_nx, sides = sized(shape, 40), pixel_pair(pixel_size)
    period = wave_length("period", period, ny_nx, sides)
    fraction = number("fraction", fraction, "1", above=0, below=1)
    whole("annealing", annealing, 1)  # the limit is said only to those who pass it
    whole("annealing", annealing, 1, _LONGEST)
    wave = _wavenumber(ny_nx, sides) * period
    time, drive = 2.0, 0.3
    growth = np.exp(time * (drive - (1 - wave**2) ** 2))
    u: Field = 0.1 * generator(seed, "lamellae").standard_normal(ny_nx)
    for _ in range(annealing):
        u = np.fft.irfft2(np.fft.rfft2(u) * growth, ny_nx)
        u /= np.sqrt(1 + 2 * time * u * u)  # the exact step of du/dt = -u^3
    return _highest(u, fraction)


@asked_as(area_fraction="fraction", period="spacing")
def blend(
    shape: Sequence[int], pixel_size: PixelSize, *, spacing: Scalar, fraction: Scalar = 0.5, seed: int = 0
) -> Labels:
    """Two polymers that came apart by spinodal decomposition.

    Waves of one length and random direction, cut at a level (Cahn's picture of the early stage [1]_), then rounded by
    the Cahn-Hilliard equation, stepped semi-implicitly in Fourier space [2]_: domains entwined at equal parts, droplets
    at unequal ones.

    Parameters
    ----------
    shape, pixel_size
        (ny, nx); side of a pixel [m], or its (dy, dx).
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
    ny_nx, sides = sized(shape, 64), pixel_pair(pixel_size)
    spacing = wave_length("spacing", spacing, ny_nx, sides)
    fraction = number("fraction", fraction, "1", minimum=0.05, maximum=0.95)
    wave = _wavenumber(ny_nx, sides) * spacing
    early = _filtered_noise(generator(seed, "blend"), ny_nx, np.exp(-0.5 * ((wave - 1) / 0.25) ** 2))
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


@asked_as(sigma="rms", length="correlation_length", H="hurst")
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
    shape, pixel_size
        (ny, nx); side of a pixel [m], or its (dy, dx).
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

    References
    ----------
    .. [1] G. Palasantzas, Phys. Rev. B 48, 14472 (1993).

    Examples
    --------
    >>> z = roughness((64, 64), 4e-9, rms=0.5e-9, correlation_length=30e-9)
    >>> round(float(z.std()) * 1e9, 12)
    0.5
    """
    ny_nx, sides = sized(shape, 32), pixel_pair(pixel_size)
    rms = number("rms", rms, "m", minimum=0, maximum=WIDEST)
    hurst = number("hurst", hurst, "1", above=0, maximum=1)
    extent = min(n * side for n, side in zip(ny_nx, sides, strict=True))
    correlation_length = at_least("correlation_length", correlation_length, max(sides), "one pixel")
    number("correlation_length", correlation_length, "m", maximum=extent)
    q = 2 * math.pi * correlation_length * _wavenumber(ny_nx, sides)
    z = _filtered_noise(generator(seed, "roughness"), ny_nx, (1 + q * q) ** (-0.5 * (1 + hurst)))
    z -= z.mean()
    deviation = z.std()
    return z * (rms / deviation) if deviation else z


def _wavenumber(shape: tuple[int, int], sides: tuple[float, float]) -> Field:
    """Return 1 / wavelength [1/m] of each entry of `numpy.fft.rfft2`."""
    return np.hypot(np.fft.fftfreq(shape[0], sides[0])[:, None], np.fft.rfftfreq(shape[1], sides[1]))


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
