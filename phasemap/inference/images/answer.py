"""Datasets and sentences: materials of pixels or regions, and what the data do not determine."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.arrays import within_half_a_turn
from phasemap.experiment.material import Material
from phasemap.inference.images.joint import Fitted, moments_of_zeros
from phasemap.inference.images.problem import Problem
from phasemap.inference.images.stack import HEIGHT, PHASE, Stack
from phasemap.inference.images.zeros import FREE, SHARED, Plan
from phasemap.inference.verdict import (
    CODES,
    COMBINED,
    GIVEN,
    OPEN,
    PARAMETERS,
    UNITS,
    UNLIKELY,
    chance,
    codes_of,
    put,
    say_regions,
    say_what_helps,
)
from phasemap.results.variables import coded, describe, provenance

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

FLAGS = (
    "modulus_not_determined", "adhesion_not_determined", "damping_not_determined", "poor_fit", "no_orbit", "no_data",
    "averaged_only", "ambiguous",
)  # fmt: skip
POOR, NO_ORBIT, NO_DATA, AVERAGED, AMBIGUOUS = (1 << FLAGS.index(name) for name in FLAGS[3:])
DOUBT = (
    "Believe no number here before the sign of the phase (positive where the tip is repulsive), lever, free amplitude "
    "and setpoints are right, the regions are of one material each and on the branch fitted, and the errors of the "
    "medians are not too small."
)


class Found(NamedTuple):
    """Materials of pixels or regions."""

    materials: Array  # shape (..., 3)
    errors: Array  # shape (..., 3); of their logarithms
    misfit: Array  # shape (...) or (); chi2 over degrees of freedom
    flags: NDArray[Any]  # shape (...); by `FLAGS`


def dataset_of(
    found: Found, stack: Stack, image: xr.Dataset, dims: tuple[str, ...], configuration: dict[str, Any], how: str
) -> xr.Dataset:
    """Materials over these dims, settings over "image", and where all this comes from; places are those of an image."""
    import xarray as xr

    ds, known = xr.Dataset(), FLAGS if dims == ("region",) else FLAGS[:-1]
    for i, name in enumerate(PARAMETERS):
        more = {"ancillary_variables": f"{name}_error flag"}
        put(ds, name, dims, found.materials[..., i], name, UNITS[name], **more)
        said = f"standard error of the natural logarithm of the {name}"
        put(ds, f"{name}_error", dims, found.errors[..., i], said)
    said = "chi2 over degrees of freedom, about 1 where the model describes the data"
    put(ds, "misfit", dims if found.misfit.ndim else (), found.misfit, said)
    meant = {"flag_masks": np.array([1 << i for i in range(len(known))], np.uint8), "flag_meanings": " ".join(known)}
    ds["flag"] = (dims, found.flags, {"long_name": "what the data do not determine, or what went wrong", **meant})
    put(ds, "setpoint", "image", list(stack.setpoints), "setpoint")
    amplitudes = [one.drive.free_amplitude for one in stack.scopes]
    put(ds, "free_amplitude", "image", amplitudes, "free amplitude at resonance", "m")
    scopes = [describe(one) for one in dict.fromkeys(stack.scopes)]
    ds.attrs.update(provenance({"microscopes": scopes, "setpoints": list(stack.setpoints), **configuration}, how))
    places = image["phase"].coords
    return ds.assign_coords({dim: places[dim] for dim in ("y", "x") if dim in places})


def of_regions(
    problem: Problem, fitted: Fitted, stack: Stack, image: xr.Dataset, fixed: dict[int, Material], names: list[int],
    configuration: dict[str, Any],
) -> xr.Dataset:  # fmt: skip
    """Materials of regions, of which some are known, and how well each property is determined.

    `fixed`: known materials by the number of their region; `names`: labels of the regions.
    """
    regions, unknown, chi2, degrees = len(stack), problem.unknown, fitted.chi2, fitted.degrees
    logs, errors = np.zeros((regions, 3)), np.zeros((regions, 3))
    codes = np.full((regions, 3), GIVEN, np.int8)
    logs[unknown] = fitted.q.reshape(-1, 3)
    errors[unknown] = np.sqrt(np.diag(fitted.covariance)).reshape(-1, 3)
    poor = degrees > 0.5 and chance(chi2, degrees) < UNLIKELY
    codes[unknown] = OPEN if poor else codes_of(fitted.covariance, fitted.information).reshape(-1, 3)
    materials = problem.model.materials(logs)
    for region, one in fixed.items():
        materials[region] = problem.model.around(one).reference
    flags = (np.isin(codes, (COMBINED, OPEN)) << np.arange(3)).sum(axis=1)
    flags |= POOR * poor | AVERAGED * (not fitted.best.exact[0]) | AMBIGUOUS * bool(fitted.others)
    misfit = np.array(chi2 / degrees if degrees > 0.5 else np.nan)
    found = Found(materials, errors, misfit, flags.astype(np.uint8))
    ds = dataset_of(found, stack, image, ("region",), configuration, "fitted by regions")
    logarithms = [f"{name} {names[r]}" for r in unknown for name in PARAMETERS]
    ds = ds.assign_coords(
        region=("region", names, {"long_name": "label of the region"}), property=list(PARAMETERS),
        parameter=logarithms, other=logarithms,
    )  # fmt: skip
    ds["determination"] = (("region", "property"), codes, coded("how far the data determine a property", *CODES))
    said = "covariance of the natural logarithms, whatever the zeros"
    put(ds, "covariance", ("parameter", "other"), fitted.covariance, said)
    return ds


def add_data(ds: xr.Dataset, problem: Problem, found: Fitted, stack: Stack, plan: Plan) -> None:
    """Put zeros, and what was measured beside what was fitted, to the materials."""
    columns = plan.zeros(len(stack)).columns
    moved, orbits = columns @ found.zeros, (found.best.values + found.best.defect)[0]
    zero, error = moments_of_zeros(found, np.degrees(plan.phase_given + found.drawn @ columns[0, :, PHASE].T))
    said = "what the instrument says where the phase is 0"
    put(ds, "phase_zero", "image", within_half_a_turn(zero), said, "degree")
    put(ds, "phase_zero_error", "image", error, "its standard error", "degree")
    if problem.weights[..., HEIGHT].any():
        drawn = plan.height_given + found.drawn @ columns[0, :, HEIGHT].T
        zero, error = moments_of_zeros(found, drawn - drawn.mean(axis=1, keepdims=True))
        put(ds, "height_zero", "image", zero, "zero of the height, relative to its mean over the images", "m")
        put(ds, "height_zero_error", "image", error, "its standard error", "m")
    seen, free = np.isfinite(stack.errors), np.array(stack.setpoints) * [one.driven_amplitude for one in stack.scopes]
    dims = ("region", "image")
    for channel, name, unit, scale, below in (
        (PHASE, "phase", "degree", 180 / np.pi, 0.0), (HEIGHT, "height", "m", 1.0, free)
    ):  # fmt: skip
        there = seen[:, :, channel]
        if not there.any():
            continue
        measured = stack.values[:, :, channel] - moved[:, :, channel] - below
        for word, values, said in (
            (f"measured_{name}", measured, f"median {name} relative to its zero"),
            (f"fitted_{name}", orbits[:, :, channel] - below, f"{name} of the fit"),
            (f"{name}_error", stack.errors[:, :, channel], f"standard error of the median {name}"),
        ):
            put(ds, word, dims, np.where(there, scale * values, np.nan), said, unit)
    ds["branch"] = (
        dims, found.sides, coded("branch that was fitted", "attractive", "none", "repulsive", first=-1)
    )  # fmt: skip


def tell(ds: xr.Dataset, problem: Problem, found: Fitted, plan: Plan) -> None:
    """Write the verdict, and what would help."""
    flags, names = int(np.bitwise_or.reduce(ds["flag"].values)), ds["region"].values.tolist()
    if flags & POOR:
        misfit = float(ds["misfit"])
        ds.attrs["verdict"] = f"The model does not describe the data: chi2 is {misfit:.3g} a degree of freedom."
        ds.attrs["advice"] = DOUBT
        return
    said = say_regions(names, ds["determination"].values, np.linalg.inv(found.information), problem.unknown)
    words = {SHARED: "one unknown of all images", FREE: "one unknown in each image", None: "given"}
    said.append(f"Zero of the phase: {words[plan.phase]}.")
    if found.data < len(found.q):
        said.append(
            f"The {found.data} data that zeros leave are fewer than the {len(found.q)} properties sought: what they do "
            "not say is the prior's."
        )
    if np.isnan(found.drawn).any():
        said.append("The fit ended where a branch ends: no errors are known, and the zeros are not.")
    if flags & AVERAGED:
        said.append("Exact orbits were not found; the fit is that of averaged ones.")
    if found.others:
        listed = [
            f"{name} {100 * np.expm1(apart):+.0f} % in region {names[region]}"
            for region, row in zip(problem.unknown, (found.others[0] - found.q).reshape(-1, 3), strict=True)
            for name, apart in zip(PARAMETERS, row, strict=True)
        ]
        said.append(f"Other materials fit as well, such as {', '.join(listed)}.")
    ds.attrs["verdict"] = "\n".join(said)
    open_still = np.isin(ds["determination"].values, (COMBINED, OPEN)).any()
    ds.attrs["advice"] = "\n".join(say_what_helps(plan.phase is not None, plan.phase == FREE) if open_still else [])
