"""Pixels solved again as they were made, by the solver of the image: all that the image says must come again.

That catches what no independent solver can, for it is less exact than the image: errors that are stated too small,
values that are changed by less than their errors, and whatever is wrong in a single pixel.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasemap.imaging.imperfections import changes
from phasemap.results.quantities import is_derived
from phasemap.results.variables import FLAGS, provenance
from phasemap.validation.checking.again import Again
from phasemap.validation.checking.picture import MEAN, Picture
from phasemap.validation.checking.result import FAILS, OPEN, Claim, judged
from phasemap.validation.checking.tolerance import Errors, allowed, spread

Array = NDArray[Any]

SHARE = 0.1  # of the stated error, within which a solver finds the same on another machine
ROUNDING = 1e-6, 1e-15  # [degree, m], where that is less: what iterations leave
RELATIVE = 1e-8  # of an amplitude, as the balance of the setpoint has it
OTHERWISE = 1e-4  # of any other quantity, the indentation most: 1e-5 was measured without vector instructions
CLOSES = 1e-6  # of an energy closure
FACTOR = 10.0  # between errors that are estimated twice
NAMED = 3  # variables that differ


def repeat(picture: Picture, again: Again) -> tuple[Claim, NDArray[np.intp]]:
    """Judge whether the solver that made the image finds the same, and return the flat places of pixels that differ."""
    names = [str(name) for name in picture.image.data_vars if name in again.values]
    if changes(picture.claims.realism):  # channels are derived of what was recorded, not of the orbits
        names = [name for name in names if not is_derived(name)]
    largest, pixels = _largest(picture, again), again.pixels
    share, differ = np.zeros(len(pixels)), []
    for name in names:
        off = _over_allowed(name, picture[name].reshape(-1)[pixels], again.values[name], largest)
        share = np.maximum(share, off)
        if (off > 1).any():
            differ.append(name)
    worst, at = np.zeros(picture.shape), np.zeros(picture.shape, bool)
    worst.reshape(-1)[pixels], at.reshape(-1)[pixels] = share, True
    found = f"{len(names)} variables of {again.materials} materials, by {picture.claims.solver!r}"
    claim = judged("solved again by the same solver: the same", picture, worst > 1, worst, at, found)
    if claim.result == FAILS:
        claim = _with_difference(picture, claim, differ)
    return claim, pixels[share > 1]


def _with_difference(picture: Picture, claim: Claim, differ: list[str]) -> Claim:
    """The claim with the names of the variables that differ; open if another version of phasemap made the image."""
    names = ", ".join(differ[:NAMED]) + (f" and {len(differ) - NAMED} more" if len(differ) > NAMED else "")
    claim = replace(claim, found=f"{names} {claim.found}")
    made, here = str(picture.image.attrs.get("phasemap_version")), provenance({}, "")["phasemap_version"]
    if made == here:
        return claim
    return replace(
        claim, result=OPEN, found=f"made by phasemap {made[:20]}, and this is {here}: {claim.found}", worst=()
    )


def _over_allowed(name: str, claimed: Array, found: Array, largest: dict[str, Array]) -> Array:
    """How far apart values are, over what is allowed: infinite where only one of them is a number."""
    if name in FLAGS:
        return np.where(claimed == found, 0.0, np.inf)
    if name.startswith("error_"):
        same = (claimed >= found / FACTOR) & (claimed <= found * FACTOR)
        off = np.where(same, 0.0, np.inf)
    else:
        usual = np.nanmedian(np.abs(found)) if np.isfinite(found).any() else 0.0
        limit = largest[name] if name in largest else OTHERWISE * (np.abs(found) + usual)
        # Nothing is allowed for where an error is not known.
        off = np.where(np.isnan(limit) | (claimed == found), 0.0, np.abs(claimed - found) / limit)
    both = np.isnan(claimed) & np.isnan(found)
    return np.asarray(np.where(both, 0.0, np.nan_to_num(off, nan=np.inf)))


def _largest(picture: Picture, again: Again) -> dict[str, Array]:
    """By how much variables may differ."""
    pixels, values = again.pixels, again.values
    errors = (SHARE * np.nan_to_num(values[f"error_{name}"]) for name in Errors._fields)
    exact = Errors(*(error + rounding for error, rounding in zip(errors, ROUNDING, strict=True)))
    largest = allowed(picture, pixels, values, exact, np.zeros(len(pixels), bool))
    largest["height"] = largest["tip_offset"] = largest["height"] + 1e-15 * np.abs(values["height"])
    regular = np.where(np.isnan(largest["indentation"]), np.nan, OTHERWISE * np.abs(values["indentation"]))
    largest["indentation"] = largest["height"] + regular
    for name in ("amplitude", "phase"):
        largest[f"{name}_spread"] = MEAN * spread(picture, pixels, values, name)
    amplitude = RELATIVE * picture.claims.amplitude + picture.coarse("amplitude")
    largest["amplitude"] = amplitude + largest["amplitude_spread"]
    largest["energy_closure"] = np.full(len(pixels), CLOSES)
    return largest
