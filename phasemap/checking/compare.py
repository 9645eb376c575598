"""What an image says of sampled pixels, against what another solver found there."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels import columns as col
from phasemap.checking.again import UNDECIDED, Again
from phasemap.checking.picture import Picture
from phasemap.checking.result import OPEN, Claim, in_words, judged
from phasemap.dataset import FLOATS, branch_of, flag_attributes
from phasemap.surface import Surface

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["compare"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

WORDS = {"phase": ("degree", 1.0), "height": ("pm", 1e12)}


class _Quantity(NamedTuple):
    """Phase or height of the sampled pixels: as in the image, as found again, and how far apart they may be."""

    claimed: Array
    again: Array
    allowed: Array  # NaN where the image states no error

    @property
    def apart(self) -> Array:
        return np.asarray(np.abs(self.claimed - self.again))


def compare(picture: Picture, surface: Surface, again: Again, by: str) -> tuple[list[Claim], xr.Dataset]:
    """Judge what the image says of the pixels that were solved again.

    Parameters
    ----------
    picture : Picture
    surface : Surface
        As it passed under the tip.
    again : Again
    by : str
        What solved them, in words.
    """
    claimed, found = picture.raw("status").reshape(-1)[again.pixels], again.status == col.GOOD
    decided = ~np.isin(again.status, UNDECIDED) & ~np.isin(claimed, UNDECIDED)
    claims = [_status(picture, again, decided, by)]
    both = found & (claimed == col.GOOD)
    if "branch" in picture:
        same = picture.raw("branch").reshape(-1)[again.pixels] == branch_of(again.rows)
        claims.append(_branch(picture, again, both, same))
        both &= same
    quantities = {name: _quantity(picture, surface, again, name) for name in ("phase", "height") if name in picture}
    claims += [_agreement(picture, again, name, quantity, both) for name, quantity in quantities.items()]
    return claims, _dataset(picture, again, quantities)


def _status(picture: Picture, again: Again, decided: Mask, by: str) -> Claim:
    """There is a solution where the image has one, and none where it says that there is none."""
    wrong = (picture.good.reshape(-1)[again.pixels] != (again.status == col.GOOD)) & decided
    found = f"{again.materials} materials, {by}"
    if again.started:
        found += f"; {in_words(again.started)} at no rest on the way from far, so begun at the image's orbit"
    if not decided.all():
        found += f"; {in_words(int(np.count_nonzero(~decided)))} undecided"
    return _judged("solved again: solutions where the status says", picture, again, wrong, wrong, decided, found)


def _branch(picture: Picture, again: Again, both: Mask, same: Mask) -> Claim:
    """The tip is on the branch to which the control brings it."""
    branch = picture.raw("branch").reshape(-1)[again.pixels][both]
    found = f"{np.count_nonzero(branch == 0)} attractive, {np.count_nonzero(branch == 1)} repulsive"
    return _judged("solved again: the same branch", picture, again, ~same, ~same, both, found)


def _agreement(picture: Picture, again: Again, name: str, quantity: _Quantity, both: Mask) -> Claim:
    """The image is as near to the other solution as it says."""
    unit, scale = WORDS[name]
    about = f"solved again: {name} within estimated error"
    if not both.any():
        return Claim(about, OPEN, 0, "there is no pixel to compare")
    apart, allowed = quantity.apart, quantity.allowed
    worst = int(np.argmax(np.where(both, np.nan_to_num(apart / np.nan_to_num(allowed, nan=1.0), nan=np.inf), -1)))
    found = f"apart by up to {scale * apart[both].max():.2g} {unit}"
    if np.isnan(allowed[both]).all():
        return Claim(about, OPEN, int(both.sum()), f"{found}; first-order averaging states no error")
    found += f"; worst {scale * apart[worst]:.2g} of {scale * allowed[worst]:.2g} allowed"
    return _judged(about, picture, again, ~(apart <= allowed), apart / allowed, both, found)


def _judged(about: str, picture: Picture, again: Again, bad: Mask, by: Array | Mask, at: Mask, found: str) -> Claim:
    """`judged`, of sampled pixels."""
    size = int(np.prod(picture.shape))
    values = np.zeros((3, size))
    values[0, again.pixels], values[1, again.pixels], values[2, again.pixels] = bad, by, at
    wrong, worst, looked_at = values.reshape(3, *picture.shape)
    return judged(about, picture, wrong > 0, worst, looked_at > 0, found)


def _quantity(picture: Picture, surface: Surface, again: Again, name: str) -> _Quantity:
    """Phase [degree], or height [m]; errors of both solvers and the quantisation are allowed."""
    rows = again.rows
    if name == "phase":
        found, own = np.degrees(rows[:, col.PHASE]), np.degrees(rows[:, col.ERROR_PHASE])
    else:
        found, own = rows[:, col.TIP_OFFSET] - rows[:, col.AMPLITUDE], rows[:, col.ERROR_HEIGHT]
        if surface.topography is not None:
            relief = surface.topography.reshape(-1)[again.pixels % surface.topography.size]
            found, own = found + relief, own + 1e-15 * np.abs(relief)
    stated = np.full(len(rows), np.nan)
    if f"error_{name}" in picture:
        stated = picture[f"error_{name}"].reshape(-1)[again.pixels]
    elif picture.claims.solver != "averaging":
        stated[:] = getattr(picture.claims.accuracy, name)
    return _Quantity(picture[name].reshape(-1)[again.pixels], found, stated + own + picture.coarse(name))


def _dataset(picture: Picture, again: Again, quantities: dict[str, _Quantity]) -> xr.Dataset:
    """The sampled pixels, both ways."""
    import xarray as xr

    direction, row, column = np.unravel_index(again.pixels, picture.shape)
    data: dict[str, Any] = {
        name: ("pixel", values, {"long_name": f"{name} of the pixel"})
        for name, values in (("direction", direction), ("row", row), ("column", column))
    }
    flags = flag_attributes("status")
    data["status"] = "pixel", picture.raw("status").reshape(-1)[again.pixels], flags
    data["status_again"] = "pixel", again.status, {**flags, "long_name": "status of the other solution"}
    for name, (claimed, found, allowed) in quantities.items():
        units = {"units": FLOATS[name].units}
        data[name] = "pixel", claimed, {"long_name": f"{name} of the image", **units}
        data[f"{name}_again"] = "pixel", found, {"long_name": f"{name} by another solver", **units}
        data[f"{name}_allowed"] = "pixel", allowed, {"long_name": "largest difference that was allowed", **units}
    return xr.Dataset(data)
