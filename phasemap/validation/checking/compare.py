"""What an image says of sampled pixels, against what another solver found there."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from phasemap._kernels import columns as col
from phasemap._shared.arrays import Array
from phasemap.experiment.lever import lever_of
from phasemap.results.quantities import CHANNELS, Channel
from phasemap.results.variables import FLOATS, Variable, flag_attributes
from phasemap.validation.checking.again import Again
from phasemap.validation.checking.channels import solved_again
from phasemap.validation.checking.picture import Picture
from phasemap.validation.checking.result import OPEN, Claim, judged, pixels_in_words
from phasemap.validation.checking.tolerance import (
    IRREGULAR,
    QUANTITIES,
    Errors,
    Values,
    allowed,
    spread,
    stated,
)

Mask = NDArray[np.bool_]

UNDECIDED = (col.NOT_CONVERGED, col.NOT_SETTLED, col.TOO_MANY_CONTACTS, col.NO_AVERAGED_ORBIT, col.UNSTABLE)
"""Status codes by which a solver gives up, or says that the tip comes to no rest: it may then end on any orbit."""
DEEPEST = -15.0  # tip offset, over u0 / alpha0, below which engaging in time does not lower the tip (`march.approach`)
UNITS = {"degree": (" degree", 1.0), "m": (" pm", 1e12), "J": (" aJ", 1e18), "W": (" pW", 1e12), "eV": (" eV", 1.0)}


class _Quantity(NamedTuple):
    """One of `QUANTITIES` of the sampled pixels: as in the image, as found again, and how far apart they may be."""

    claimed: Array
    again: Array
    allowed: Array  # NaN where nothing says

    @property
    def apart(self) -> Array:
        return np.asarray(np.abs(self.claimed - self.again))


def compare(picture: Picture, again: Again, by: str) -> tuple[list[Claim], xr.Dataset]:
    """Judge what the image says of the pixels that were solved again by another solver.

    `by`: that solver, in words.
    """
    claimed, found = picture.raw("status").reshape(-1)[again.pixels], again.status == col.GOOD
    decided = _decided(picture, again)
    claims = [_status(picture, again, decided, by)]
    if not decided.all():
        left = "time comes to no rest on the way from far: any orbit may be right there"
        claims.append(Claim("solved again: what no other solver decides", OPEN, int((~decided).sum()), left))
    both, values = found & (claimed == col.GOOD), again.values
    claims.append(_motion(picture, again, both, values))
    if "branch" in picture:
        same = picture.raw("branch").reshape(-1)[again.pixels] == values["branch"]
        claims.append(_branch(picture, again, both, same))
        both &= same
    quantities = _quantities(picture, again, values)
    claims += [_agreement(picture, again, name, quantity, both) for name, quantity in quantities.items()]
    return claims, _dataset(picture, again, quantities)


def _decided(picture: Picture, again: Again) -> Mask:
    """Where both solvers say that there is an orbit, or that there is none."""
    decided = ~np.isin(again.status, UNDECIDED)
    decided &= ~np.isin(picture.raw("status").reshape(-1)[again.pixels], UNDECIDED)
    if "tip_offset" in picture:
        lever = lever_of(picture.claims.microscope)
        deep = picture["tip_offset"].reshape(-1)[again.pixels] < DEEPEST * lever[col.DRIVE] / lever[col.ALPHA0]
        decided &= ~(deep & (again.status == col.NO_STABLE_ORBIT))
    return decided


def _status(picture: Picture, again: Again, decided: Mask, by: str) -> Claim:
    """There is a solution where the image has one, and none where it says that there is none."""
    wrong = (picture.good.reshape(-1)[again.pixels] != (again.status == col.GOOD)) & decided
    found = f"{again.materials} materials, {by}"
    return _judged("solved again: solutions where the status says", picture, again, wrong, wrong, decided, found)


def _motion(picture: Picture, again: Again, both: Mask, values: Values) -> Claim:
    """The motion is periodic where the image says so; one that hardly spreads may be called either."""
    claimed, found = picture.irregular.reshape(-1)[again.pixels], values["motion"] == 1
    phase, amplitude = (spread(picture, again.pixels, values, name) for name in ("phase", "amplitude"))
    bad = (claimed != found) & ((phase > IRREGULAR[0]) | (amplitude > IRREGULAR[1]))
    said = f"irregular in {pixels_in_words(int(np.count_nonzero(both & found)))}"
    return _judged("solved again: the same motion", picture, again, bad, phase, both, said)


def _branch(picture: Picture, again: Again, both: Mask, same: Mask) -> Claim:
    """The tip is on the branch to which the control brings it."""
    branch = picture.raw("branch").reshape(-1)[again.pixels][both]
    found = f"{np.count_nonzero(branch == 0)} attractive, {np.count_nonzero(branch == 1)} repulsive"
    return _judged("solved again: the same branch", picture, again, ~same, ~same, both, found)


def _agreement(picture: Picture, again: Again, name: str, quantity: _Quantity, both: Mask) -> Claim:
    """The image is as near to the other solution as it says."""
    unit, scale = UNITS.get(_about(name).units, ("", 1.0))
    whose = "estimated" if name in Errors._fields else "its"  # which follows from those that are estimated
    about = f"solved again: {name.replace('_', ' ')} within {whose} error"
    apart, largest = quantity.apart, quantity.allowed
    known = both & ~np.isnan(largest)
    if not known.any():
        why = "first-order averaging states no error" if both.any() else "there is no pixel to compare"
        found = f"apart by up to {scale * apart[both].max():.2g}{unit}; " if both.any() else ""
        return Claim(about, OPEN, int(both.sum()), found + why)
    share = np.where(known, np.nan_to_num(apart / largest, nan=np.inf), -1.0)
    worst = int(np.argmax(share))
    found = f"apart by up to {scale * apart[known].max():.2g}{unit}"
    found += f"; worst {scale * apart[worst]:.2g} of {scale * largest[worst]:.2g} allowed"
    return _judged(about, picture, again, ~(apart <= largest), share, known, found)


def _about(name: str) -> Variable | Channel:
    """What a variable of an image is."""
    return FLOATS.get(name) or CHANNELS[name]


def _judged(about: str, picture: Picture, again: Again, bad: Mask, by: Array | Mask, at: Mask, found: str) -> Claim:
    """`judged`, of sampled pixels."""
    size = int(np.prod(picture.shape))
    values = np.zeros((3, size))
    values[0, again.pixels], values[1, again.pixels], values[2, again.pixels] = bad, by, at
    wrong, worst, looked_at = values.reshape(3, *picture.shape)
    return judged(about, picture, wrong > 0, worst, looked_at > 0, found)


def _quantities(picture: Picture, again: Again, values: Values) -> dict[str, _Quantity]:
    """What the image has of `QUANTITIES`; errors of both solvers and the quantisation are allowed."""
    said = stated(picture, again.pixels)
    own = Errors(values["error_phase"], values["error_height"] + 1e-15 * np.abs(values["height"]))
    made = picture.raw("solver").reshape(-1)[again.pixels] if "solver" in picture else col.AVERAGING
    approximate = np.isin(made, (col.AVERAGING, col.INTERPOLATED)) & np.ones(len(again.pixels), bool)
    errors = Errors(said.phase + own.phase, said.height + own.height)
    largest = allowed(picture, again.pixels, values, errors, approximate)
    found = {
        name: _Quantity(picture[name].reshape(-1)[again.pixels], values[name], largest[name])
        for name in QUANTITIES
        if name in picture
    }
    derived = solved_again(picture, again, largest)
    return found | {name: _Quantity(*three) for name, three in derived.items()}


def _dataset(picture: Picture, again: Again, quantities: dict[str, _Quantity]) -> xr.Dataset:
    """The sampled pixels, both ways."""
    direction, row, column = np.unravel_index(again.pixels, picture.shape)
    data: dict[str, Any] = {
        name: ("pixel", values, {"long_name": f"{name} of the pixel"})
        for name, values in (("direction", direction), ("row", row), ("column", column))
    }
    flags = flag_attributes("status")
    data["status"] = "pixel", picture.raw("status").reshape(-1)[again.pixels], flags
    data["status_again"] = "pixel", again.status, {**flags, "long_name": "status of the other solution"}
    for name, (claimed, found, largest) in quantities.items():
        units = {"units": _about(name).units}
        data[name] = "pixel", claimed, {"long_name": f"{name} of the image", **units}
        data[f"{name}_again"] = "pixel", found, {"long_name": f"{name} by another solver", **units}
        data[f"{name}_allowed"] = "pixel", largest, {"long_name": "largest difference that was allowed", **units}
    return xr.Dataset(data)
