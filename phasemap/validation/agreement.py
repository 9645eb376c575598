"""Comparison of an image's pixels with pixels solved again: by the image's own solver, and by another one.

Solved again as they were made, pixels must be the same. That catches what no independent solver can, for it is less
exact than the image: errors that are stated too small, values that are changed by less than their errors, and whatever
is wrong in a single pixel.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from phasemap._kernels import columns as col
from phasemap._kernels.engagement.lowering import deepest_offset
from phasemap.experiment.lever_numbers import lever_of
from phasemap.imaging.engaged import DEEPEST
from phasemap.imaging.imperfections import changes
from phasemap.results.channels import channels
from phasemap.results.quantities import CHANNELS
from phasemap.results.variables import FLAGS, FLOATS, SCAN_VARIABLES, all_variables_of, flag_attributes, provenance
from phasemap.validation.again import Again
from phasemap.validation.picture import MEAN, OPEN, Claim, Picture, pixels_in_words

Array = NDArray[Any]
Mask = NDArray[np.bool_]

QUANTITIES = ("phase", "height", "mean_deflection", "indentation", "dissipation", "virial")
SAMPLED = 1e-3  # of the amplitude: the deepest of the points at which a solver evaluates the force; 5e-4 was measured
OF = {"phase": "phase", "height": "amplitude"}  # whose spread goes with the mean of each
IRREGULAR = 0.1, 20e-12  # [degree, m] to which the mean of irregular motion is known, beside what its spread leaves
UNDECIDED = (col.NOT_CONVERGED, col.NOT_SETTLED, col.TOO_MANY_CONTACTS, col.NO_AVERAGED_ORBIT, col.UNSTABLE)
"""Status codes by which a solver gives up, or says that the tip comes to no rest: it may then end on any orbit."""
UNITS = {"degree": (" degree", 1.0), "m": (" pm", 1e12), "J": (" aJ", 1e18)}
SHARE = 0.1  # of the stated error, within which a solver finds the same on another machine
BOTH = 2.0  # of it, within which two versions do
SAME = {"degree": 1e-3, "m": 1e-12}  # of a scan in time on another machine
ITERATIONS = 1e-6, 1e-15  # [degree, m], where that is less: what iterations leave
RELATIVE = 1e-8  # of an amplitude, as the balance of the setpoint has it
SAME_FORMULA = 1e-9  # of a channel that follows from the others of the image
OTHERWISE = 1e-4  # of any other quantity, the indentation most: 1e-5 was measured without vector instructions
CLOSES = 1e-6  # of an energy closure
FACTOR = 10.0  # between errors that are estimated twice
NAMED = 3  # variables that differ


class StatedErrors(NamedTuple):
    """Errors of phase [degree] and height [m] of some pixels; NaN where they are not known."""

    phase: Array
    height: Array


def _stated(again: Again) -> StatedErrors:
    """Errors that the image states, or else those that were asked for; averaging states none."""
    claims, errors = again.picture.claims, []
    for name in StatedErrors._fields:
        if f"error_{name}" in again.picture:
            errors.append(again.claimed(f"error_{name}"))
        else:
            usual = np.nan if claims.solver == "averaging" else getattr(claims.accuracy, name)
            errors.append(np.full(len(again.pixels), usual))
    return StatedErrors(*errors)


def _allowed(again: Again, errors: StatedErrors, approximate: Mask) -> dict[str, Array]:
    """Largest differences of `QUANTITIES`, for such errors of phase and height in all; NaN where one says nothing.

    An error e of the phase is one of the force's first harmonic, k u0 e, of the drive's work, pi k u0 A e, and of the
    virial, k u0 A e / 2; of a force that acts for a part of the period the mean is at most half the first harmonic.
    Twice as much is allowed, and more for the virial. Approximate pixels, averaged or interpolated ones, are as exact
    as the image was asked to be (`imaging.engaged.tolerances_of`). Of irregular motion the means of phase and height
    are compared.
    """
    picture, claims = again.picture, again.picture.claims
    lever, length = lever_of(claims.microscope), np.where(approximate, claims.accuracy.height, 0.0)
    phase = np.radians(np.where(approximate, np.maximum(errors.phase, claims.accuracy.phase), errors.phase))
    work = np.pi * lever[col.STIFFNESS] * lever[col.DRIVE] * claims.amplitude * phase
    largest = {
        "phase": errors.phase,
        "height": errors.height,
        "mean_deflection": 2 * lever[col.DRIVE] * phase + length,
        "indentation": errors.height + SAMPLED * claims.amplitude + DEEPEST * length,
        "dissipation": work,
        "virial": work,
    }
    averaged = again.at(picture.averaged) | (again.values["amplitude_spread"] > 0)
    means = dict(zip(("phase", "height"), IRREGULAR, strict=True))
    for name, values in largest.items():
        mean = means[name] + MEAN * again.spread(OF[name]) if name in means else np.nan
        largest[name] = np.where(averaged, mean, values) + picture.coarse(name)
    return largest


class _Quantity(NamedTuple):
    """Values of one of `QUANTITIES` in the sampled pixels: in the image, found again, and the allowed difference."""

    claimed: Array
    again: Array
    allowed: Array  # NaN where nothing says


def compare(again: Again, by: str) -> tuple[list[Claim], xr.Dataset]:
    """Claims on the pixels that were solved again by another solver, in words `by`."""
    decided = _decided(again)
    claims = [_status(again, decided, by)]
    if not decided.all():
        left = "time comes to no rest on the way from far: any orbit may be right there"
        claims.append(Claim("solved again: what no other solver decides", OPEN, int((~decided).sum()), left))
    both = (again.status == col.GOOD) & again.at(again.picture.good)
    claims.append(_motion(again, both))
    if "branch" in again.picture:
        same = again.raw("branch") == again.values["branch"]
        claims.append(_branch(again, both, same))
        both &= same
    quantities = _quantities(again)
    claims += [_agreement(again, name, quantity, both) for name, quantity in quantities.items()]
    return claims, _dataset(again, quantities)


def _decided(again: Again) -> Mask:
    """True where both solvers say if there is an orbit: time did not stop lowering there."""
    decided = ~(np.isin(again.status, UNDECIDED) | np.isin(again.raw("status"), UNDECIDED))
    if "tip_offset" in again.picture:
        lever = lever_of(again.picture.claims.microscope)
        deep = again.claimed("tip_offset") < deepest_offset(lever)
        decided &= ~(deep & (again.status == col.NO_STABLE_ORBIT))
    return decided


def _status(again: Again, decided: Mask, by: str) -> Claim:
    """Claim that there is a solution where the image has one, and none where it says that there is none."""
    wrong = (again.at(again.picture.good) != (again.status == col.GOOD)) & decided
    found = f"{again.materials} materials, {by}"
    return again.judged("solved again: solutions where the status says", wrong, wrong, decided, found)


def _motion(again: Again, both: Mask) -> Claim:
    """Claim that the motion is periodic where the image says so; one that hardly spreads may be called either."""
    claimed, irregular = again.at(again.picture.irregular), again.values["motion"] == 1
    phase, amplitude = again.spread("phase"), again.spread("amplitude")
    bad = (claimed != irregular) & ((phase > IRREGULAR[0]) | (amplitude > IRREGULAR[1]))
    text = f"irregular in {pixels_in_words(int(np.count_nonzero(both & irregular)))}"
    return again.judged("solved again: the same motion", bad, phase, both, text)


def _branch(again: Again, both: Mask, same: Mask) -> Claim:
    """Claim that the tip is on the branch to which the control brings it."""
    branch = again.raw("branch")[both]
    found = f"{np.count_nonzero(branch == 0)} attractive, {np.count_nonzero(branch == 1)} repulsive"
    return again.judged("solved again: the same branch", ~same, ~same, both, found)


def _agreement(again: Again, name: str, quantity: _Quantity, both: Mask) -> Claim:
    """Claim that the image is as near to the other solution as it says."""
    unit, scale = UNITS[FLOATS[name].units]
    whose = "estimated" if name in StatedErrors._fields else "its"  # which follows from those that are estimated
    about = f"solved again: {name.replace('_', ' ')} within {whose} error"
    apart, largest = np.abs(quantity.claimed - quantity.again), quantity.allowed
    known = both & ~np.isnan(largest)
    if not known.any():
        why = "first-order averaging states no error" if both.any() else "there is no pixel to compare"
        text = f"apart by up to {scale * apart[both].max():.2g}{unit}; " if both.any() else ""
        return Claim(about, OPEN, int(both.sum()), text + why)
    share = np.where(known, np.nan_to_num(apart / largest, nan=np.inf), -1.0)
    worst = int(np.argmax(share))
    text = f"apart by up to {scale * apart[known].max():.2g}{unit}"
    text += f"; worst {scale * apart[worst]:.2g} of {scale * largest[worst]:.2g} allowed"
    return again.judged(about, ~(apart <= largest), share, known, text)


def _quantities(again: Again) -> dict[str, _Quantity]:
    """Values of `QUANTITIES` in the image and found again; errors of both and the quantisation are allowed."""
    picture, values, in_image = again.picture, again.values, _stated(again)
    stated = StatedErrors(values["error_phase"], values["error_height"] + 1e-15 * np.abs(values["height"]))
    made = again.raw("solver") if "solver" in picture else np.full(len(again.pixels), col.AVERAGING)
    approximate = np.isin(made, (col.AVERAGING, col.INTERPOLATED))
    largest = _allowed(again, StatedErrors(in_image.phase + stated.phase, in_image.height + stated.height), approximate)
    names = filter(picture.__contains__, QUANTITIES)
    return {name: _Quantity(again.claimed(name), values[name], largest[name]) for name in names}


def _dataset(again: Again, quantities: dict[str, _Quantity]) -> xr.Dataset:
    """Dataset of the sampled pixels, in the image and as found again."""
    places = zip(("direction", "row", "column"), np.unravel_index(again.pixels, again.picture.shape), strict=True)
    data: dict[str, Any] = {name: ("pixel", values, {"long_name": f"{name} of the pixel"}) for name, values in places}
    flags = flag_attributes("status")
    data["status"] = "pixel", again.raw("status"), flags
    data["status_again"] = "pixel", again.status, {**flags, "long_name": "status of the other solution"}
    for name, (claimed, again_value, largest) in quantities.items():
        units = {"units": FLOATS[name].units}
        data[name] = "pixel", claimed, {"long_name": f"{name} of the image", **units}
        data[f"{name}_again"] = "pixel", again_value, {"long_name": f"{name} by another solver", **units}
        data[f"{name}_allowed"] = "pixel", largest, {"long_name": "largest difference that was allowed", **units}
    return xr.Dataset(data)


def repeat(again: Again) -> tuple[Claim, NDArray[np.intp]]:
    """Judge whether the solver that made the image finds the same; and flat places of what differs, most first.

    What another version of phasemap made may differ by the errors that both state, and is not judged beyond.
    """
    picture, values = again.picture, again.values
    made, here = str(picture.image.attrs.get("phasemap_version")), provenance({}, "")["phasemap_version"]
    known = all_variables_of(picture.claims.control)
    if changes(picture.claims.realism):  # channels are derived of what was recorded, not of what the tip did
        values = {name: value for name, value in values.items() if name in known}
    values = values | (recorded := _recorded(picture, known))
    names = [str(name) for name in picture.image.data_vars if name in values]
    largest = _largest(again, SHARE if made == here else BOTH)
    largest |= {name: SAME_FORMULA * np.abs(derived) for name, derived in recorded.items()}
    share, differ = np.zeros(len(again.pixels)), []
    for name in names:
        off = _over_allowed(name, again.claimed(name), values[name], largest)
        share = np.maximum(share, off)
        if (off > 1).any():
            differ.append(name)
    text = f"{len(names)} variables of {again.materials} materials, by {picture.claims.solver!r}"
    about = "solved again by the same solver: the same"
    claim = again.judged(about, share > 1, share, np.ones(len(share), bool), text)
    if differ:
        more = f" and {len(differ) - NAMED} more" if len(differ) > NAMED else ""
        claim = replace(claim, found=f"{', '.join(differ[:NAMED])}{more} {claim.found}")
    if differ and made != here:
        text = f"made by phasemap {made[:20]}, and this is {here}: {claim.found}"
        claim = replace(claim, result=OPEN, found=text, worst=())
    order = np.argsort(-share, kind="stable")
    return claim, again.pixels[order[share[order] > 1]]


def _recorded(picture: Picture, own: Collection[str]) -> dict[str, Array]:
    """Derived variables of the image by formulas from its `own` variables, where it has all that these need."""
    image = picture.image[[name for name in own if name in picture]]
    others = {name: CHANNELS[name] for name in map(str, picture.image.data_vars) if name not in own}
    always = {"amplitude", "phase"} if picture.claims.control.in_time else {"phase"}  # at rest the setpoint will do
    needs = {name: {*always, *one.needs, one.of_orbit} for name, one in others.items()}
    made = [name for name in others if needs[name] & {*own} <= set(image.data_vars)]
    derived = channels(image, made, scope=picture.claims.microscope) if made else {}
    return {name: derived[name].values.reshape(-1) for name in made}


def _over_allowed(name: str, claimed: Array, again: Array, largest: dict[str, Array]) -> Array:
    """Difference of values over the allowed one: infinite where only one of them is a number."""
    if name in FLAGS:
        return np.where(claimed == again, 0.0, np.inf)
    if name.startswith("error_"):
        same = (claimed >= again / FACTOR) & (claimed <= again * FACTOR)
        off = np.where(same, 0.0, np.inf)
    else:
        usual = np.nanmedian(np.abs(again)) if np.isfinite(again).any() else 0.0
        limit = largest[name] if name in largest else OTHERWISE * (np.abs(again) + usual)
        # Nothing is allowed for where an error is not known.
        off = np.where(np.isnan(limit) | (claimed == again), 0.0, np.abs(claimed - again) / limit)
    both = np.isnan(claimed) & np.isnan(again)
    return np.asarray(np.where(both, 0.0, np.nan_to_num(off, nan=np.inf)))


def _largest(again: Again, share: float) -> dict[str, Array]:
    """Allowed differences of variables, for this share of the stated errors; scans in time state none."""
    picture, values = again.picture, again.values
    if picture.claims.control.in_time:
        scanned = [name for name in SCAN_VARIABLES if name in FLOATS and name not in FLAGS]
        by_name = {name: SAME[FLOATS[name].units] + 2 * picture.coarse(name) for name in scanned}
        return {name: np.full(len(again.pixels), limit) for name, limit in by_name.items()}
    errors = (share * np.nan_to_num(values[f"error_{name}"]) for name in StatedErrors._fields)
    exact = StatedErrors(*(error + rounding for error, rounding in zip(errors, ITERATIONS, strict=True)))
    largest = _allowed(again, exact, np.zeros(len(again.pixels), bool))
    largest["height"] = largest["tip_offset"] = largest["height"] + 1e-15 * np.abs(values["height"])
    regular = np.where(np.isnan(largest["indentation"]), np.nan, OTHERWISE * np.abs(values["indentation"]))
    largest["indentation"] = largest["height"] + regular
    for name in ("amplitude", "phase"):
        largest[f"{name}_spread"] = MEAN * again.spread(name)
    amplitude = RELATIVE * picture.claims.amplitude + picture.coarse("amplitude")
    largest["amplitude"] = amplitude + largest["amplitude_spread"]
    largest["energy_closure"] = np.full(len(again.pixels), CLOSES)
    return largest
