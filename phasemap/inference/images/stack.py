"""What was measured: phase and height at several settings."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.arrays import as_array, as_list
from phasemap._shared.checks import number
from phasemap._shared.errors import InputError
from phasemap.experiment.microscope import Microscope
from phasemap.solvers.problem import check_setpoint

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

PHASE, HEIGHT = 0, 1


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
        """The same for some of the pixels."""
        return Stack(self.values[chosen], self.errors[chosen], self.scopes, self.setpoints)


def list_of_images(images: object) -> list[xr.Dataset]:
    """The images of a stack, each a Dataset over ("y", "x").

    `images`: a Dataset has a leading dim "setpoint", with its coordinate, or "image".
    """
    import xarray as xr

    if isinstance(images, xr.Dataset):
        dim = next((name for name in ("setpoint", "image") if name in images.dims), None)
        if dim is None:
            found = [images]
        else:
            found = [images.isel({dim: i}) for i in range(images.sizes[dim])]
            if dim == "setpoint" and dim in images.coords:
                found = [one.assign_attrs(setpoint=float(one["setpoint"])) for one in found]
    elif isinstance(images, Sequence) and images and all(isinstance(one, xr.Dataset) for one in images):
        found = list(images)
    else:
        raise InputError("images", type(images).__name__, "a Dataset, or a sequence of Datasets, one an image")
    for i, one in enumerate(found):
        if "phase" not in one or one["phase"].dims != ("y", "x"):
            got = one["phase"].dims if "phase" in one else sorted(map(str, one.data_vars))
            raise InputError(f"image {i}", got, "a Dataset with phase over ('y', 'x'); choose one direction")
        if one["phase"].shape != found[0]["phase"].shape:
            raise InputError(f"shape of image {i}", one["phase"].shape, f"{found[0]['phase'].shape}, as of the first")
    return found


def coordinates_of(image: xr.Dataset) -> dict[str, Any]:
    """The coordinates "y" and "x" as far as an image has them."""
    return {dim: image["phase"].coords[dim] for dim in ("y", "x") if dim in image["phase"].coords}


def setpoints_of(images: list[xr.Dataset], setpoints: object) -> tuple[float, ...]:
    """Setpoint of each image: as given, or from its attributes."""
    if setpoints is not None:
        allowed = f"{len(images)} numbers, one an image"
        given = as_list("setpoints", setpoints, allowed)
        if len(given) != len(images):
            raise InputError("setpoints", setpoints, allowed)
        return tuple(check_setpoint(one) for one in given)
    found = []
    for i, one in enumerate(images):
        value = one.attrs.get("setpoint")
        if value is None and "configuration" in one.attrs:
            value = json.loads(one.attrs["configuration"]).get("setpoint")
        if value is None:
            raise InputError("setpoints", None, f"{len(images)} numbers, because image {i} has no attribute 'setpoint'")
        found.append(check_setpoint(value))
    return tuple(found)


def scopes_of(scope: object, count: int) -> tuple[Microscope, ...]:
    """One microscope an image; they may differ in the drive only."""
    scopes = (scope,) * count if isinstance(scope, Microscope) else tuple(scope) if isinstance(scope, Sequence) else ()
    if len(scopes) != count or not all(isinstance(one, Microscope) for one in scopes):
        raise InputError("scope", scope, f"a Microscope, or {count} of them, one an image")
    first = scopes[0]
    if any(
        (one.cantilever, one.tip, one.interaction) != (first.cantilever, first.tip, first.interaction) for one in scopes
    ):
        raise InputError("scope", "several", "microscopes that differ in their drive only")
    if first.interaction.law.hysteretic:
        raise InputError(
            "contact", first.interaction.law.name,
            "a law without a neck: 'dmt', 'hertz', 'punch', 'cone', 'film' or a law of your own",
            "Fit single curves with phasemap.fit_distance instead.",
        )  # fmt: skip
    return scopes


def zeros_of(images: list[xr.Dataset], name: str, given: object, unit: str) -> Array:
    """Zero of a quantity in each image, as given or from the attribute of this name, shape (m,)."""
    if given is None:
        recorded = [one.attrs.get(name) for one in images]
        if None in recorded:
            allowed = f"a number or {len(images)} [{unit}], because an image has no attribute {name!r}"
            raise InputError(name, None, allowed)
        given = recorded
    return numbers_of(name, given, unit, len(images))


def numbers_of(name: str, value: object, unit: str, count: int, **bounds: float) -> Array:
    """A number of each image within these bounds, shape (m,)."""
    allowed = f"a number or {count} [{unit}]"
    given = as_array(name, value, allowed, object)
    if given.shape not in ((), (count,)):
        raise InputError(name, value, allowed)
    return np.array([number(name, one, unit, **bounds) for one in np.broadcast_to(given, (count,)).tolist()])


def make_stack(
    images: Any, scope: Any, setpoints: Any, phase: tuple[Any, Any, Any], height: tuple[Any, Any, Any]
) -> Stack:
    """Check everything that is given for pixels, row by row; phase and height: error, zero and error of the zero."""
    found = list_of_images(images)
    count = len(found)
    scopes, ratios = scopes_of(scope, count), setpoints_of(found, setpoints)
    heights = count > 1 and all("height" in one for one in found)
    values = np.zeros((found[0]["phase"].size, count, 2))
    errors = np.full(values.shape, np.inf)
    channels = (PHASE, "phase", "degree", *phase), (HEIGHT, "height", "m", *height)
    for channel, name, unit, error, zero, beside in channels:
        noise = numbers_of(f"{name}_error", error, unit, count, above=0)
        wrong = numbers_of(f"{name}_zero_error", beside, unit, count, minimum=0)
        below = zeros_of(found, f"{name}_zero", zero, unit)
        if channel == HEIGHT and not heights:
            continue
        scale = np.radians(1.0) if channel == PHASE else 1.0
        errors[:, :, channel] = scale * np.hypot(noise, wrong)
        for i, (one, microscope, ratio) in enumerate(zip(found, scopes, ratios, strict=True)):
            values[:, i, channel] = scale * (one[name].values.reshape(-1) - below[i])
            if channel == HEIGHT:  # the tip offset, up to topography
                values[:, i, channel] += ratio * microscope.driven_amplitude
    missing = ~np.isfinite(values)
    values[missing], errors[missing] = 0.0, np.inf
    return Stack(values, errors, scopes, ratios)
