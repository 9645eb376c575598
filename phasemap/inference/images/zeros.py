"""Zeros of phase and height as unknowns of the least squares, beside the materials.

Data depend on them linearly. So a projection takes out of the weighted residuals what zeros can explain, which is the
least squares over both (theory, Eq. (inversion-5)); what zeros are then follows from the materials.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.arrays import within_half_a_turn
from phasemap._shared.checks import number
from phasemap._shared.errors import InputError
from phasemap.inference.images.stack import HEIGHT, PHASE, Stack, numbers_of, zeros_of

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

SHARED, FREE = "shared", "free"
FLAT = 1e-9  # of the largest singular value: a combination of zeros that changes nothing


@dataclass(frozen=True, eq=False)
class Zeros:
    """Columns of the design, in units of the data, and how well each zero is known beforehand."""

    columns: Array  # shape (regions, m, 2, p); what a unit of each zero adds to phases [rad] and heights [m]
    widths: Array  # shape (p,); standard deviations of the prior about 0 [rad, m], infinite where nothing is known

    def weighted(self, weights: Array) -> Projection:
        """The zeros beside data with these weights, shape (regions, m, 2)."""
        design = (self.columns * weights[..., None]).reshape(-1, len(self.widths))
        design = np.concatenate([design, np.diag(1.0 / self.widths)])
        size = np.linalg.norm(design, axis=0)
        left, singular, right = np.linalg.svd(design / np.where(size > 0, size, 1.0), full_matrices=False)
        kept = singular > FLAT * max(float(singular.max(initial=0.0)), FLAT)
        inverse = (right[kept].T / singular[kept]) @ left[:, kept].T / np.where(size > 0, size, 1.0)[:, None]
        return Projection(left[:, kept], inverse, np.isfinite(self.widths))


@dataclass(frozen=True, eq=False)
class Projection:
    """What weighted residuals say about the zeros, and what is left of them."""

    # shape (n + p, rank); Orthonormal, of what zeros explain: of n data, and of p rows that hold the zeros to
    # what is known beforehand
    basis: Array
    inverse: Array  # shape (p, n + p); from residuals to zeros
    is_known: NDArray[np.bool_]  # shape (p,); which zeros are known beforehand

    def without(self, residuals: Array) -> Array:
        """Residuals or their derivatives, shape (..., n + p, k), without what zeros explain."""
        left: Array = residuals - self.basis @ (self.basis.T @ residuals)
        return left


@dataclass(frozen=True, eq=False)
class Plan:
    """What is known of the zeros of m images."""

    # phase, height: "shared" for one unknown of all images, "free" for one in each, None where it is known
    phase: str | None
    height: str | None
    # phase_given, height_given: shape (m,) [rad, m]; 0 where it is not known
    phase_given: Array
    height_given: Array
    # phase_error, height_error: shape (m,); standard errors in each image by itself [rad, m]
    phase_error: Array
    height_error: Array
    topography_error: float  # standard deviation of what regions stand out [m], infinite where nothing is known of it

    def zeros(self, regions: int) -> Zeros:
        """All zeros of this many regions; the first of them are those of the phase."""
        count = len(self.phase_error)
        columns, widths = [], []

        def add(region: Any, image: Any, channel: int, width: float) -> None:
            column = np.zeros((regions, count, 2))
            column[region, image, channel] = 1.0
            columns.append(column)
            widths.append(width)

        every = slice(None)
        both = (PHASE, self.phase, self.phase_error), (HEIGHT, self.height, self.height_error)
        for channel, kind, errors in both:
            if kind == SHARED:
                add(every, every, channel, np.inf)
            for image in range(count):
                if kind == FREE or errors[image] > 0:
                    add(every, image, channel, np.inf if kind == FREE else float(errors[image]))
        add(every, every, HEIGHT, np.inf)  # where the surface is, which no image says
        for region in range(regions):
            if self.topography_error > 0:
                add(region, every, HEIGHT, self.topography_error)
        return Zeros(np.stack(columns, axis=-1), np.array(widths))

    def taken_off(self, stack: Stack, used: NDArray[np.bool_]) -> Stack:
        """A stack without the zeros that are given, and with phases that do not jump by a turn within an image.

        Where a zero is not known, neither is the turn: phases are brought to within half a turn of the mean of the
        pixels used, and means to within half a turn of the first image's.
        """
        values = stack.values.copy()
        values[:, :, PHASE] -= self.phase_given
        values[:, :, HEIGHT] -= self.height_given
        there = used[:, None] & np.isfinite(stack.errors[:, :, PHASE])
        centre = np.zeros(len(self.phase_given))
        if self.phase is not None:
            centre = np.angle((np.exp(1j * values[:, :, PHASE]) * there).sum(axis=0))
            centre = centre[0] + within_half_a_turn(centre - centre[0], 2 * np.pi)
        values[:, :, PHASE] = centre + within_half_a_turn(values[:, :, PHASE] - centre, 2 * np.pi)
        return replace(stack, values=values)


def make_plan(
    images: list[xr.Dataset], phase: tuple[Any, Any], height: tuple[Any, Any], topography_error: object
) -> Plan:
    """Check what is said of the zeros: what is given, and its standard error."""
    count = len(images)
    if phase[0] is None:
        phase = (None if all("phase_zero" in one.attrs for one in images) else SHARED), phase[1]
    kinds = _kind("phase_zero", phase[0], (SHARED, FREE)), _kind("height_zero", height[0], (FREE,))
    none, unknown = np.zeros(count), isinstance(topography_error, float) and topography_error == np.inf
    return Plan(
        *kinds,
        none if kinds[0] else np.radians(zeros_of(images, "phase_zero", phase[0], "degree")),
        none if kinds[1] else zeros_of(images, "height_zero", height[0], "m"),
        np.radians(numbers_of("phase_zero_error", phase[1], "degree", count, minimum=0)),
        numbers_of("height_zero_error", height[1], "m", count, minimum=0),
        np.inf if unknown else number("topography_error", topography_error, "m", minimum=0),
    )


def _kind(name: str, given: object, words: tuple[str, ...]) -> str | None:
    """The word for zeros that are not known, None for numbers."""
    if not isinstance(given, str):
        return None
    if given not in words:
        allowed = {SHARED: f"{SHARED!r} (one unknown of all images)", FREE: f"{FREE!r} (one in each image)"}
        raise InputError(name, given, ", ".join(allowed[word] for word in words) + " or numbers")
    return given
