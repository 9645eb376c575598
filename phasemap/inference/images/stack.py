"""Measured phase and height at several settings, of pixels, or of regions as if each were one pixel.

The zeros of phase and height are unknowns of the least squares, beside the materials. Data depend on them linearly: a
projection takes out of the weighted residuals what zeros can explain, which is the least squares over both (theory,
Eq. (inversion-5)); what zeros are then follows from the materials.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from phasemap._shared.arrays import Array, as_array, as_list, within_half_a_turn
from phasemap._shared.checks import number
from phasemap._shared.errors import InputError, Word
from phasemap.experiment.microscope import Microscope
from phasemap.io.metadata import recorded_sign, settings_of_image
from phasemap.solvers.problem import check_setpoint

PHASE, HEIGHT = 0, 1
SPREAD = 1.4826  # standard deviation over the median absolute deviation of normal numbers
MEDIAN = 1.2533  # standard error of a median over that of a mean

SHARED, FREE = "shared", "free"
FLAT = 1e-9  # of the largest singular value: a combination of zeros that changes nothing


@dataclass(frozen=True, eq=False)
class Stack:
    """Data of n pixels or regions in m images."""

    # values, errors: shape (n, m, 2); phase [rad] and height [m], and their standard errors, infinite where there
    # is no datum
    values: Array
    errors: Array
    scopes: tuple[Microscope, ...]
    setpoints: tuple[float, ...]

    def __len__(self) -> int:
        return len(self.values)

    def part(self, chosen: slice | NDArray[np.intp]) -> Stack:
        """Stack of some of the pixels."""
        return replace(self, values=self.values[chosen], errors=self.errors[chosen])

    def medians(self, numbers: NDArray[np.intp], count: int) -> Stack:
        """Medians of regions, by the number of each pixel's, -1 where it has none, with their standard errors."""
        values = np.zeros((count, *self.values.shape[1:]))
        errors = np.full(values.shape, np.inf)
        for i, j, k in np.ndindex(values.shape):
            pixel_errors = self.errors[numbers == i, j, k]
            pixel_values = self.values[numbers == i, j, k][np.isfinite(pixel_errors)]
            if len(pixel_values):
                values[i, j, k] = np.median(pixel_values)
                spread = SPREAD * np.median(np.abs(pixel_values - values[i, j, k]))
                errors[i, j, k] = np.hypot(MEDIAN * spread / np.sqrt(len(pixel_values)), pixel_errors.min())
        return replace(self, values=values, errors=errors)


def labels_of(labels: object, shape: tuple[int, ...]) -> NDArray[Any]:
    """Check a map of labels."""
    given = as_array("labels", labels, f"whole numbers of shape {shape}")
    if given.shape != shape or given.dtype.kind not in "iub":
        raise InputError("labels", Word(f"{given.dtype} of shape {given.shape}"), f"whole numbers of shape {shape}")
    return given


def regions_of(labels: object, shape: tuple[int, ...]) -> tuple[list[int], NDArray[np.intp]]:
    """Names of the regions, and of each pixel its number among them, -1 where it has none."""
    names, numbers = np.unique(labels_of(labels, shape), return_inverse=True)
    skipped = int((names < 0).sum())
    if skipped == len(names):
        raise InputError("every label", Word("below 0"), "one region at least, from 0 on")
    return names[skipped:].tolist(), np.maximum(numbers.reshape(-1) - skipped, -1)


def list_of_images(images: object) -> list[xr.Dataset]:
    """The images, over ("y", "x"), of a list or of a Dataset with a leading dim "setpoint" or "image"."""
    if isinstance(images, xr.Dataset):
        dim = next((name for name in ("setpoint", "image") if name in images.dims), None)
        listed = [images] if dim is None else [images.isel({dim: i}) for i in range(images.sizes[dim])]
    elif isinstance(images, Sequence) and images and all(isinstance(image, xr.Dataset) for image in images):
        listed = list(images)
    else:
        raise InputError("images", type(images).__name__, "a Dataset, or a sequence of Datasets, one an image")
    for i, image in enumerate(listed):
        if "phase" not in image or image["phase"].dims != ("y", "x"):
            got = image["phase"].dims if "phase" in image else sorted(map(str, image.data_vars))
            raise InputError(f"image {i}", got, "a Dataset with phase over ('y', 'x'); choose one direction")
        if image["phase"].shape != listed[0]["phase"].shape:
            raise InputError(
                f"shape of image {i}", image["phase"].shape, f"{listed[0]['phase'].shape}, as of the first"
            )
    return listed


def setpoints_of(images: list[xr.Dataset], setpoints: object, scopes: tuple[Microscope, ...]) -> tuple[float, ...]:
    """Setpoint of each image: as given, or from its attributes, as an amplitude maybe."""
    allowed = f"{len(images)} numbers, one an image"
    if setpoints is not None:
        ratios = as_list("setpoints", setpoints, allowed)
        if len(ratios) != len(images):
            raise InputError("setpoints", setpoints, allowed)
    else:
        ratios = []
        for image, scope in zip(images, scopes, strict=True):
            settings = settings_of_image(image)
            held = settings.get("setpoint_amplitude")
            ratios.append(settings.get("setpoint", None if held is None else float(held) / scope.driven_amplitude))
        if None in ratios:
            why = f"because image {ratios.index(None)} has no attribute 'setpoint'"
            raise InputError("setpoints", None, f"{allowed}, {why}")
    return tuple(check_setpoint(one) for one in ratios)


def scopes_of(scope: object, count: int) -> tuple[Microscope, ...]:
    """Microscope of each image; the microscopes may differ in their drive only."""
    scopes = (scope,) * count if isinstance(scope, Microscope) else tuple(scope) if isinstance(scope, Sequence) else ()
    if len(scopes) != count or not all(isinstance(one, Microscope) for one in scopes):
        raise InputError("scope", scope, f"a Microscope, or {count} of them, one an image")
    first = scopes[0]
    if any(
        (one.cantilever, one.tip, one.interaction) != (first.cantilever, first.tip, first.interaction) for one in scopes
    ):
        raise InputError("scope", Word("several microscopes"), "those that differ in their drive only")
    if first.interaction.law.hysteretic or first.interaction.law.in_time:
        raise InputError(
            "contact", first.interaction.law.name,
            "a law without a neck or losses of its own: 'dmt', 'hertz', 'punch', 'cone', 'film' or a law of your own",
            "Fit single curves with phasemap.fit_distance instead.",
        )  # fmt: skip
    return scopes


def recorded_zeros(images: list[xr.Dataset], scopes: tuple[Microscope, ...]) -> list[float] | None:
    """Recorded phase [degree] where the simulated is 0, by that of the free lever; None if an image does not say it."""
    settings = [settings_of_image(one) for one in images]
    if not all("phase_zero" in one for one in settings):
        return None
    return [
        float(one["phase_zero"]) - recorded_sign(one) * scope.free_phase
        for one, scope in zip(settings, scopes, strict=True)
    ]


def of_each_image(name: str, value: object, unit: str, count: int, **bounds: float) -> Array:
    """A number of each image within these bounds, shape (m,)."""
    allowed = f"a number or {count} [{unit}]"
    given = as_array(name, value, allowed, object)
    if given.shape not in ((), (count,)):
        raise InputError(name, value, allowed)
    return np.array([number(name, one, unit, **bounds) for one in np.broadcast_to(given, (count,)).tolist()])


def make_stack(
    images: list[xr.Dataset], scope: Any, setpoints: Any, phase: tuple[Any, Any, Any], height: tuple[Any, Any, Any]
) -> Stack:
    """Check everything that is given for pixels, row by row; phase and height: error, zero and error of the zero."""
    count = len(images)
    scopes = scopes_of(scope, count)
    ratios = setpoints_of(images, setpoints, scopes)
    heights = count > 1 and all("height" in one for one in images)
    values = np.zeros((images[0]["phase"].size, count, 2))
    errors = np.full(values.shape, np.inf)
    channels = (PHASE, "phase", "degree", *phase), (HEIGHT, "height", "m", *height)
    for channel, name, unit, error, zero, beside in channels:
        noise = of_each_image(f"{name}_error", error, unit, count, above=0)
        wrong = of_each_image(f"{name}_zero_error", beside, unit, count, minimum=0)
        zero = recorded_zeros(images, scopes) if zero is None and channel == PHASE else zero
        if zero is None:
            allowed = f"a number or {count} [{unit}], because an image has no attribute {f'{name}_zero'!r}"
            raise InputError(f"{name}_zero", None, allowed)
        below = of_each_image(f"{name}_zero", zero, unit, count)
        if channel == HEIGHT and not heights:
            continue
        scale = np.radians(1.0) if channel == PHASE else 1.0
        errors[:, :, channel] = scale * np.hypot(noise, wrong)
        for i, (image, microscope, ratio) in enumerate(zip(images, scopes, ratios, strict=True)):
            recorded = image[name].values.reshape(-1) - below[i]
            if channel == PHASE:
                values[:, i, channel] = within_half_a_turn(recorded_sign(image.attrs) * scale * recorded, 2 * np.pi)
            else:  # the tip offset, up to topography
                values[:, i, channel] = recorded + ratio * microscope.driven_amplitude
    missing = ~np.isfinite(values)
    values[missing], errors[missing] = 0.0, np.inf
    return Stack(values, errors, scopes, ratios)


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
    """Projection of weighted residuals on what the zeros explain, and on what is left of them."""

    # shape (n + p, rank); Orthonormal, of what zeros explain: of n data, and of p rows that hold the zeros to
    # what is known beforehand
    basis: Array
    inverse: Array  # shape (p, n + p); from residuals to zeros
    is_known: NDArray[np.bool_]  # shape (p,); which zeros are known beforehand

    def without(self, residuals: Array) -> Array:
        """Residuals or their derivatives, shape (..., n + p, k), without what zeros explain."""
        return residuals - self.basis @ (self.basis.T @ residuals)


@dataclass(frozen=True, eq=False)
class ZeroPlan:
    """Prior knowledge of the zeros of phase and height of m images."""

    # phase, height: "shared" for one unknown of all images, "free" for one in each, None where it is known
    phase: str | None
    height: str | None
    signs: Array  # shape (m,); 1, or -1 where the recorded phase counts lag positive
    # phase_given, height_given: shape (m,) [rad, m], the phase as a simulation counts it; 0 where it is not known
    phase_given: Array
    height_given: Array
    # phase_error, height_error: shape (m,); standard errors in each image by itself [rad, m]
    phase_error: Array
    height_error: Array
    topography_error: float  # standard deviation of what regions stand out [m], infinite where nothing is known of it

    def zeros(self, regions: int) -> Zeros:
        """Columns of the design of all zeros for this many regions; zeros of the phase come first."""
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
        """Stack less the given zeros, with phases that do not jump by a turn within an image.

        Where a zero is not known, neither is the turn: phases are brought to within half a turn of the mean of the
        pixels used, and means to within half a turn of the first image's.
        """
        values = stack.values.copy()
        values[:, :, PHASE] -= self.phase_given
        values[:, :, HEIGHT] -= self.height_given
        known = used[:, None] & np.isfinite(stack.errors[:, :, PHASE])
        centre = np.zeros(len(self.phase_given))
        if self.phase is not None:
            centre = np.angle((np.exp(1j * values[:, :, PHASE]) * known).sum(axis=0))
            centre = centre[0] + within_half_a_turn(centre - centre[0], 2 * np.pi)
        values[:, :, PHASE] = centre + within_half_a_turn(values[:, :, PHASE] - centre, 2 * np.pi)
        return replace(stack, values=values)


def make_plan(
    images: list[xr.Dataset], scopes: tuple[Microscope, ...], phase: tuple[Any, Any], height: tuple[Any, Any],
    topography_error: object,
) -> ZeroPlan:  # fmt: skip
    """Check the zeros that are given, and their standard errors."""
    count = len(images)
    if phase[0] is None:
        phase = recorded_zeros(images, scopes) or SHARED, phase[1]
    kinds = _kind("phase_zero", phase[0], (SHARED, FREE)), _kind("height_zero", height[0], (FREE,))
    signs = np.array([recorded_sign(one.attrs) for one in images])
    none, unknown = np.zeros(count), isinstance(topography_error, float) and topography_error == np.inf
    return ZeroPlan(
        *kinds,
        signs,
        none if kinds[0] else signs * np.radians(of_each_image("phase_zero", phase[0], "degree", count)),
        none if kinds[1] else of_each_image("height_zero", height[0], "m", count),
        np.radians(of_each_image("phase_zero_error", phase[1], "degree", count, minimum=0)),
        of_each_image("height_zero_error", height[1], "m", count, minimum=0),
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
