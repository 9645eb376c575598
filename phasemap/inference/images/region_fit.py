"""Materials of regions from measured images whose zeros of phase and height are unknown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.asked import asked_as
from phasemap._shared.checks import check_choice
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Microscope
from phasemap.inference.images.joint import DRAWS, Fitted, advise, fit
from phasemap.inference.images.model import Model, make_model, sides_of
from phasemap.inference.images.problem import Problem, problem_of
from phasemap.inference.images.regions import medians, regions_of
from phasemap.inference.images.stack import HEIGHT, PHASE, Stack, coordinates_of, list_of_images, make_stack
from phasemap.inference.images.starts import Grid, make_grid, make_starts
from phasemap.inference.images.verdict import AMBIGUOUS, AVERAGED, FLAGS, POOR, dataset_of
from phasemap.inference.images.zeros import FREE, SHARED, Plan, make_plan
from phasemap.inference.verdict import (
    CODES,
    COMBINED,
    GIVEN,
    OPEN,
    PARAMETERS,
    PRIOR,
    UNLIKELY,
    chance,
    check_known,
    check_prior,
    codes_of,
    say_regions,
)
from phasemap.results.variables import coded, describe

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

BRANCHES = ("attractive", "repulsive")
DOUBT = (
    "Believe no number here before the sign of the phase (positive where the tip is repulsive), lever, free amplitude "
    "and setpoints are right, the regions are of one material each and on the branch fitted, and the errors of the "
    "medians are not too small."
)


@asked_as()
def fit_regions(
    images: xr.Dataset | Sequence[xr.Dataset],
    labels: Any,
    scope: Microscope | Sequence[Microscope],
    *,
    setpoints: Any = None,
    known: Mapping[int, Material] | None = None,
    phase_error: Any = 0.1,
    height_error: Any = 0.05e-9,
    phase_zero: Any = None,
    phase_zero_error: Any = 0.0,
    height_zero: Any = FREE,
    height_zero_error: Any = 0.0,
    topography_error: float = np.inf,
    branch: str | None = None,
    prior: Material = PRIOR,
    prior_factor: float = 10.0,
) -> xr.Dataset:
    """Fit one material a region to the contrast of phase and height between the regions, in all images together.

    The zeros of phase and height are unknowns beside the materials, unless they are given: the errors have in them what
    zeros leave open. Look at `determination` before the values, and at the attribute ``advice``.

    Parameters
    ----------
    images, scope, setpoints
        As for `invert`. Heights are used if all images have them, and there are two at least.
    labels : array_like of int, shape (ny, nx)
        Region of each pixel; those below 0 are left out.
    known : mapping of int to Material, optional
        Materials of regions that need not be sought, such as a substrate, by their labels.
    phase_error, height_error : float or sequence of float
        What a median may be wrong by beside its own standard error [degree, m]: line offsets, drift, crosstalk, and
        what the model leaves out.
    phase_zero : "shared", "free", float or sequence of float, optional
        What the instrument says where the phase is 0 [degree]: one unknown of all images, one unknown in each, or
        numbers. By default the attribute ``phase_zero`` of the images, and "shared" if they have none.
    height_zero : "free", float or sequence of float
        What it says where the undeformed surface is [m]: one unknown in each image, or numbers of which only the
        differences count.
    phase_zero_error, height_zero_error : float or sequence of float
        Standard errors of zeros [degree, m] that are given, and of what is "shared", in each image by itself.
    topography_error : float
        Standard deviation of what the undeformed regions differ by in level [m]: 0 for a flat surface, infinite (the
        default) if nothing is known of it.
    branch : {"attractive", "repulsive"}, optional
        What all regions are tapped in. By default the sign of the phase tells where its zero is given; elsewhere all
        are tried in which images that take more amplitude away are the repulsive ones.
    prior, prior_factor
        As for `invert`.

    Returns
    -------
    xarray.Dataset
        Over "region": modulus [Pa], adhesion [J/m2], damping [1], their errors and flags as of `invert`, with
        `ambiguous` where other materials fit as well; `pixels`; over ("region", "property"): `determination`,
        ``determined``, ``combination_only`` (together with others, not by itself), ``not_identifiable`` or ``given``.
        Over "image": setpoint, free_amplitude, `phase_zero` [degree] and, up to a constant, `height_zero` [m] with
        their errors, which `invert` may be given to go on with pixels. Over ("region", "image"):
        `measured_phase`, `fitted_phase` [degree], `measured_height`, `fitted_height` [m], without zeros and
        topography, `phase_error`, `height_error`, of the medians, `branch`. `covariance` of the logarithms over
        ("parameter", "other"); `misfit`, chi2 over degrees of freedom; `label` over ("y", "x"). Sentences in the
        attributes ``verdict`` and ``advice``.

    Raises
    ------
    InputError
        As for `invert`; or if `labels` have another shape or no region, or a known region is not there.

    Notes
    -----
    Contrast alone determines two materials where they answer to the setpoint and the free amplitude in different ways:
    two amplitudes at two setpoints mostly do, and so does a region of known material. Images of one free amplitude
    at several setpoints do for soft materials only. A material that is too stiff for the tip to indent stays open
    whatever is measured.

    Examples
    --------
    >>> import phasemap as pm
    >>> lever, tip = pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9)
    >>> scopes = [pm.Microscope(lever, tip, pm.Drive(amplitude)) for amplitude in (40e-9, 80e-9) for _ in range(2)]
    >>> labels = [[0, 1]]
    >>> soft, softer = pm.Material(0.6e9, 0.07, 0.01), pm.Material(0.2e9, 0.05, 0.02)
    >>> sample = pm.Surface.from_labels(labels, {0: soft, 1: softer}, pixel_size=4e-9)
    >>> stack = [pm.simulate(sample, *at) for at in zip(scopes, (0.5, 0.8, 0.5, 0.8))]
    >>> found = pm.fit_regions(stack, labels, scopes, phase_zero="shared")
    >>> (found.modulus.values / 1e9).round(1).tolist(), bool(abs(found.phase_zero).max() < 1.0)
    ([0.6, 0.2], True)
    """
    factor = check_prior(prior, prior_factor)
    if branch is not None:
        check_choice("branch", branch, BRANCHES)
    given = list_of_images(images)
    whole = make_stack(given, scope, setpoints, (phase_error, 0.0, 0.0), (height_error, 0.0, 0.0))
    plan = make_plan(given, (phase_zero, phase_zero_error), (height_zero, height_zero_error), topography_error)
    shape = given[0]["phase"].shape
    names, numbers = regions_of(labels, shape)
    stack, pixels = medians(plan.taken_off(whole, numbers >= 0), numbers, len(names))
    materials = {names.index(name): one for name, one in check_known(known, names, prior).items()}
    model = make_model(stack, prior, factor)
    problem, q = _prepare(model, stack, materials, plan, branch)
    found = fit(problem, q)
    configuration = {
        "known": {str(name): describe(one) for name, one in (known or {}).items()}, "prior": describe(prior),
        "prior_factor": factor, "phase_zero": plan.phase or "given", "height_zero": plan.height or "given",
    }  # fmt: skip
    ds = _dataset(problem, found, stack, materials, names, configuration)
    _add_data(ds, problem, found, stack, plan)
    ds = ds.assign_coords(coordinates_of(given[0]))
    ds["pixels"] = ("region", pixels, {"long_name": "pixels of the region", "units": "1"})
    ds["label"] = (("y", "x"), np.asarray(labels).astype(np.int32), {"long_name": "region of the pixel"})
    _tell(ds, problem, found, plan, names)
    return ds


def _prepare(
    model: Model, stack: Stack, materials: dict[int, Material], plan: Plan, branch: str | None
) -> tuple[Problem, Array]:
    """The problem, and the materials that it starts from."""
    grid = make_grid(model)
    grids = [_known(make_model(stack, materials[r], 10.0)) if r in materials else grid for r in range(len(stack))]
    sides = sides_of(stack) if branch is not None or plan.phase is None else None
    if branch is not None and sides is not None:
        sides = np.abs(sides) * np.int8(1 if branch == "repulsive" else -1)
    q, both = make_starts(model, stack, grids, sorted(materials), plan, sides)
    fixed = {}
    for r in materials:
        upper = (both[:, r] > 0).astype(int)
        there = grids[r].values[upper, 0, np.arange(both.shape[2])]
        fixed[r] = np.where((both[:, r] == 0)[..., None], 0.0, there)
    return problem_of(model, stack, both, plan.zeros(len(stack)), fixed), q


def _known(model: Model) -> Grid:
    """The reference alone, with its exact orbits on both branches."""
    count = len(model.amplitudes)
    sides = np.array([[-1], [1]], np.int8) * np.ones((1, count), np.int8)
    values, good = model.exact(np.zeros((2, 3)), sides, np.full((2, count), np.nan))
    values = np.where(good[..., None], values, np.nan)[:, None]
    return Grid(np.zeros((1, 3)), values, np.full(values.shape[:3], np.nan), np.zeros_like(values))


def _dataset(
    problem: Problem, found: Fitted, stack: Stack, materials: dict[int, Material], names: list[int],
    configuration: dict[str, Any],
) -> xr.Dataset:  # fmt: skip
    """Variables over regions and parameters."""
    regions, unknown = len(stack), problem.unknown
    logs, errors = np.zeros((regions, 3)), np.zeros((regions, 3))
    codes = np.full((regions, 3), GIVEN, np.int8)
    logs[unknown] = found.q.reshape(-1, 3)
    errors[unknown] = np.sqrt(np.diag(found.covariance)).reshape(-1, 3)
    poor = found.degrees > 0.5 and chance(found.chi2, found.degrees) < UNLIKELY
    codes[unknown] = (
        OPEN if poor else codes_of(errors[unknown].ravel(), 1 / np.sqrt(np.diag(found.information))).reshape(-1, 3)
    )
    properties = problem.model.materials(logs)
    for r, one in materials.items():
        properties[r] = make_model(stack, one, 10.0).reference
    flags = (np.isin(codes, (COMBINED, OPEN)) << np.arange(3)).sum(axis=1)
    flags |= POOR * poor | AVERAGED * (not found.best.exact[0]) | AMBIGUOUS * bool(found.others)
    misfit = np.array(found.chi2 / found.degrees if found.degrees > 0.5 else np.nan)
    ds = dataset_of(
        properties, errors, misfit, flags.astype(np.uint8), stack, ("region",), FLAGS, configuration,
        "fitted by regions",
    )  # fmt: skip
    logarithms = [f"{name} {names[r]}" for r in unknown for name in PARAMETERS]
    ds = ds.assign_coords(
        region=("region", names, {"long_name": "label of the region"}), property=list(PARAMETERS),
        parameter=logarithms, other=logarithms,
    )  # fmt: skip
    ds["determination"] = (("region", "property"), codes, coded("how far the data determine a property", *CODES))
    about = {"long_name": "covariance of the natural logarithms, whatever the zeros", "units": "1"}
    ds["covariance"] = (("parameter", "other"), found.covariance, about)
    return ds


def _add_data(ds: xr.Dataset, problem: Problem, found: Fitted, stack: Stack, plan: Plan) -> None:
    """Zeros, and what was measured beside what was fitted."""
    columns = plan.zeros(len(problem.weights)).columns
    moved, orbits = columns @ found.zeros, (found.best.values + found.best.defect)[0]
    zero, error = _moments(found, np.degrees(plan.phase_given + found.drawn @ columns[0, :, PHASE].T))
    about = {"long_name": "what the instrument says where the phase is 0", "units": "degree"}
    ds["phase_zero"] = ("image", (zero + 180) % 360 - 180, about)
    ds["phase_zero_error"] = ("image", error, {"long_name": "its standard error", "units": "degree"})
    if problem.weights[..., HEIGHT].any():
        drawn = plan.height_given + found.drawn @ columns[0, :, HEIGHT].T
        zero, error = _moments(found, drawn - drawn.mean(axis=1, keepdims=True))
        about = {"long_name": "zero of the height, relative to its mean over the images", "units": "m"}
        ds["height_zero"] = ("image", zero, about)
        ds["height_zero_error"] = ("image", error, {"long_name": "its standard error", "units": "m"})
    seen, free = np.isfinite(stack.errors), np.array(stack.setpoints) * [one.driven_amplitude for one in stack.scopes]
    dims = ("region", "image")
    for channel, name, unit, scale, below in (
        (PHASE, "phase", "degree", 180 / np.pi, 0.0), (HEIGHT, "height", "m", 1.0, free)
    ):  # fmt: skip
        there = seen[:, :, channel]
        if not there.any():
            continue
        measured = scale * (stack.values[:, :, channel] - moved[:, :, channel] - below)
        fitted = scale * (orbits[:, :, channel] - below)
        error = scale * stack.errors[:, :, channel]
        for word, values, said in (
            (f"measured_{name}", measured, f"median {name} relative to its zero"),
            (f"fitted_{name}", fitted, f"{name} of the fit"),
            (f"{name}_error", error, f"standard error of the median {name}"),
        ):
            ds[word] = (dims, np.where(there, values, np.nan), {"long_name": said, "units": unit})
    about = coded("branch that was fitted", "attractive", "none", "repulsive", first=-1)
    ds["branch"] = (dims, found.sides, about)


def _moments(found: Fitted, zeros: Array) -> tuple[Array, Array]:
    """Mean of the draws around the best solution, and standard errors with all others."""
    mean = zeros[: 2 * DRAWS].mean(axis=0)
    return mean, np.sqrt(found.weights @ (zeros - mean) ** 2 / found.weights.sum())


def _tell(ds: xr.Dataset, problem: Problem, found: Fitted, plan: Plan, names: list[int]) -> None:
    """The verdict, and what would help."""
    flags = int(np.bitwise_or.reduce(ds["flag"].values))
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
    ds.attrs["advice"] = "\n".join(advise(problem, found, plan, names))
