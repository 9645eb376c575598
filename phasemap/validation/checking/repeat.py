"""Sampled pixels of an image at rest, solved by the solver that made it: all that the image says must come again.

That catches what no independent solver can, for it is less exact than the image: errors that are stated too small, and
values that are changed by less than their errors.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasemap.experiment.control import Engage
from phasemap.experiment.surface import Surface
from phasemap.imaging.engaged import FEW
from phasemap.imaging.simulation import simulate
from phasemap.results.variables import FLAGS, provenance
from phasemap.solvers.solver import by_name
from phasemap.validation.checking.again import solve_again
from phasemap.validation.checking.picture import MEAN, Picture
from phasemap.validation.checking.result import FAILS, OPEN, Claim, judged
from phasemap.validation.checking.tolerance import Errors, allowed, spread, values_again

Array = NDArray[Any]
Pixels = NDArray[np.intp]

SHARE = 0.1  # of the stated error, within which a solver finds the same on another machine
ROUNDING = 1e-6, 1e-15  # [degree, m], where that is less: what iterations leave
RELATIVE = 1e-8  # of an amplitude, as the balance of the setpoint has it
CLOSES = 1e-6  # of an energy closure
FACTOR = 10.0  # between errors that are estimated twice


def repeat(picture: Picture, surface: Surface, pixels: Pixels, threads: int | None) -> Claim:
    """Judge whether the solver that made the image finds the same.

    `surface`: as it passed under the tip.
    `pixels` (shape (n,)): flat.
    """
    again = _made_again(picture, surface, pixels, threads)
    names = [str(name) for name in picture.image.data_vars if name in again]  # not integrals over orbits, where asked
    largest = _largest(picture, pixels, again)
    wrong, at = np.zeros(picture.shape, bool), np.zeros(picture.shape, bool)
    at.reshape(-1)[pixels], differ = True, []
    for name in names:
        same = _same(name, picture[name].reshape(-1)[pixels], again[name], largest)
        if not same.all():
            differ.append(name)
            wrong.reshape(-1)[pixels] |= ~same
    about = "solved again by the same solver: the same"
    claim = judged(about, picture, wrong, wrong, at, f"{len(names)} variables, by {picture.claims.solver!r}")
    if claim.result != FAILS:
        return claim
    claim = replace(claim, found=f"{', '.join(differ)} {claim.found}")
    made, here = str(picture.image.attrs.get("phasemap_version")), provenance({}, "")["phasemap_version"]
    if made == here:
        return claim
    return replace(
        claim, result=OPEN, found=f"made by phasemap {made[:20]}, and this is {here}: {claim.found}", worst=()
    )


def _made_again(picture: Picture, surface: Surface, pixels: Pixels, threads: int | None) -> dict[str, Any]:
    """All variables of these pixels; where an image is interpolated, what lies between depends on all of it."""
    claims = picture.claims
    between = claims.solver == "auto" and isinstance(claims.control, Engage)
    between &= not claims.microscope.interaction.law.hysteretic
    if not (between and len(surface.unique()[0]) > FEW):
        return values_again(solve_again(picture, surface, pixels, by_name(claims.solver), threads, None), surface)
    image = simulate(
        surface, claims.microscope, claims.setpoint, claims.solver, claims.control, claims.accuracy, threads=threads,
        realism=replace(claims.realism, drift=(0.0, 0.0, 0.0), line_offset=0.0, phase_offset=0.0, bits=None),
    )  # fmt: skip
    return {str(name): values.values.reshape(-1)[pixels] for name, values in image.data_vars.items()}


def _same(name: str, claimed: Array, found: Array, largest: dict[str, Array]) -> NDArray[np.bool_]:
    """Where a variable is what it was."""
    if name in FLAGS:
        return np.asarray(claimed == found)
    if name.startswith("error_"):
        same = (claimed >= found / FACTOR) & (claimed <= found * FACTOR)
    else:
        same = (np.abs(claimed - found) <= largest[name]) | np.isnan(largest[name])
    return np.asarray(same | (np.isnan(claimed) & np.isnan(found)))


def _largest(picture: Picture, pixels: Pixels, again: dict[str, Any]) -> dict[str, Array]:
    """By how much each variable may differ."""
    errors = (SHARE * np.nan_to_num(again[f"error_{name}"]) for name in Errors._fields)
    exact = Errors(*(error + rounding for error, rounding in zip(errors, ROUNDING, strict=True)))
    largest = allowed(picture, pixels, again, exact, np.zeros(len(pixels), bool))
    largest["height"] = largest["tip_offset"] = largest["height"] + 1e-15 * np.abs(again["height"])
    for name in ("amplitude", "phase"):
        largest[f"{name}_spread"] = MEAN * spread(picture, pixels, again, name)
    amplitude = RELATIVE * picture.claims.amplitude + picture.coarse("amplitude")
    largest["amplitude"] = amplitude + largest["amplitude_spread"]
    largest["adhesion_virial"], largest["adhesion_loss"] = largest["virial"], largest["dissipation"]
    largest["contact_storage"] = largest["virial"]
    largest["energy_closure"] = np.full(len(pixels), CLOSES)
    return largest
