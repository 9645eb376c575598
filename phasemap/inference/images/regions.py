"""Materials of several regions and the zeros of phase and height, from all images together.

Materials make up for zeros along valleys of chi2, so that the least squares alone would say too little: its errors come
from solving it again for data and priors that are drawn within their errors (randomised maximum likelihood, theory,
Eq. (inversion-6); Oliver, He and Reynolds 1996), which follows valleys however they bend.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from phasemap._shared.arrays import Array, within_half_a_turn
from phasemap._shared.asked import asked_as
from phasemap._shared.errors import InputError, Word
from phasemap.experiment.described import describe
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Microscope
from phasemap.inference.determined import (
    CODES,
    COMBINED,
    END,
    GIVEN,
    OPEN,
    PARAMETERS,
    PRIOR,
    UNLIKELY,
    add_variable,
    chance,
    check_known,
    check_prior,
    codes_of,
    say_regions,
    say_what_helps,
)
from phasemap.inference.images.invert import AMBIGUOUS, AVERAGED, POOR, Estimates, dataset_of
from phasemap.inference.images.least_squares import (
    RegionProblems,
    Solution,
    go_downhill,
    information,
    problem_of,
    refine,
)
from phasemap.inference.images.model import Model, make_model
from phasemap.inference.images.stack import (
    FREE,
    HEIGHT,
    PHASE,
    SHARED,
    Stack,
    ZeroPlan,
    list_of_images,
    make_plan,
    make_stack,
    regions_of,
)
from phasemap.inference.images.starts import grid_of_one, make_grid, make_starts
from phasemap.results.variables import coded

DRAWS = 50  # of data, each with its mirror image, so that the mean of the draws is the data
SEED = 20
MODES = 4  # solutions that are kept
AS_GOOD = 9.0  # chi2 above the least within which another solution cannot be ruled out
APART = 3.0  # standard errors between two solutions that are not the same
DOUBT = (
    "Believe no number here before the sign of the phase (positive where the tip is repulsive), lever, free amplitude "
    "and setpoints are right, the regions are of one material each and on the branch fitted, and the errors of the "
    "medians are not too small."
)


class Fitted(NamedTuple):
    """Materials and zeros found, with covariance, draws and chi2."""

    best: Solution  # of one problem
    q: Array  # shape (3 u,); means of the logarithms
    covariance: Array  # shape (3 u, 3 u)
    information: Array  # shape (3 u, 3 u); inverse of the covariance to first order, at the best materials
    sides: NDArray[np.int8]  # shape (r, m)
    zeros: Array  # shape (p,); those of the best materials
    # shape (draws, p); those of the draws, the first of which are around the best solution; NaN at the very end
    # of a branch
    drawn: Array
    weights: Array  # shape (draws,)
    data: int  # number of data, less those that zeros take up
    chi2: float
    degrees: float
    others: list[Array]  # logarithms of other solutions that fit as well


def fit_regions_from(problem: RegionProblems, q: Array, places: Array) -> Fitted:
    """Solve from all these materials, with orbits at these places, and draw around the best and what is as good."""
    solution = refine(problem, go_downhill(problem, q, places, np.zeros_like(problem.data)))
    if not np.isfinite(solution.chi2).any():
        allowed = "branches on which some material of the range searched has orbits in every image"
        raise InputError("choice of branches", Word("what was given or what the phases tell"), allowed)
    best = int(np.argmin(solution.chi2))
    matrix = information(problem, problem.weigh(solution.slopes))
    modes = _modes(solution, matrix[best])
    sizes = np.linalg.slogdet(matrix[modes])[1]
    mass = np.exp(0.5 * (solution.chi2[best] - solution.chi2[modes] + sizes[0] - sizes))
    each = np.repeat(modes, 2 * DRAWS)
    drawn, from_here = _draw(problem.part(each), len(modes)), solution.part(each)
    near = refine(drawn, go_downhill(drawn, from_here.q, from_here.places, from_here.defect), 1)
    weights = np.repeat(mass / mass.sum(), 2 * DRAWS) * np.isfinite(near.chi2)
    mean, zeros = near.q[: 2 * DRAWS].mean(axis=0), drawn.zeros(near.values, near.defect)
    if weights.any():
        apart = near.q - mean
        covariance = np.einsum("n,ni,nj->ij", weights, apart, apart) / weights.sum()
    else:  # at the very end of a branch, where no draw has an orbit: nothing is known but the prior
        covariance, zeros, weights = np.diag(1 / np.diag(problem.prior)), np.full_like(zeros, np.nan), weights + 1.0
    pinned = np.abs(solution.q[best]) > END * problem.model.reach
    covariance[pinned, pinned] += 1 / np.diag(problem.prior)[pinned]
    learnt = np.trace(np.linalg.solve(matrix[best], matrix[best] - problem.prior))
    projection = problem.projection
    sides = problem.sides[best]
    if not problem.model.averages:
        sides = np.where(sides == 0, 0, problem.model.branches(solution.values[best, :, :, PHASE]))
    data = int((problem.weights > 0).sum() + projection.is_known.sum()) - projection.basis.shape[1]
    likeliest = solution.part(np.array([best]))
    return Fitted(
        likeliest, mean, covariance, matrix[best], sides,
        problem.zeros(solution.values, solution.defect)[best], zeros, weights, data,
        float((problem.rest(solution.values, solution.defect)[best] ** 2).sum()), float(data - learnt),
        list(solution.q[modes[1:]]),
    )  # fmt: skip


def moments_of_zeros(fitted: Fitted, drawn: Array) -> tuple[Array, Array]:
    """Mean of zeros that were drawn around the best solution, and standard errors with all others."""
    mean = drawn[: 2 * DRAWS].mean(axis=0)
    return mean, np.sqrt(fitted.weights @ (drawn - mean) ** 2 / fitted.weights.sum())


def _draw(problem: RegionProblems, modes: int) -> RegionProblems:
    """Data, zeros and materials drawn as they might have been, the same for each solution."""
    rng = np.random.default_rng(SEED)

    def mirrored(*shape: int) -> Array:
        half = rng.standard_normal((DRAWS, *shape))
        return np.concatenate([half, -half] * modes)

    sigmas = np.divide(1.0, problem.weights, out=np.zeros_like(problem.weights), where=problem.weights > 0)
    held = mirrored(problem.held.shape[1]) * problem.projection.is_known
    widths = 1 / np.sqrt(np.diag(problem.prior))
    return replace(
        problem, data=problem.data + sigmas * mirrored(*sigmas.shape), held=held,
        centre=problem.centre + widths * mirrored(len(widths)),
    )  # fmt: skip


def _modes(solution: Solution, information: Array) -> NDArray[np.intp]:
    """The best solution, and those that fit as well and are not the same."""
    chosen: list[int] = []
    for i in np.argsort(solution.chi2, kind="stable"):
        apart = [solution.q[i] - solution.q[j] for j in chosen]
        as_good = not chosen or solution.chi2[i] < solution.chi2[chosen[0]] + AS_GOOD
        if as_good and len(chosen) < MODES and all(one @ information @ one > APART**2 for one in apart):
            chosen.append(int(i))
    return np.array(chosen)


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
        numbers. By default by what the images say of the free lever (``phase_zero``), and "shared" if they do not.
        Which way the phase counts is the attribute ``phase_sign``, -1 where lag is positive.
    height_zero : "free", float or sequence of float
        What it says where the undeformed surface is [m]: one unknown in each image, or numbers of which only the
        differences count.
    phase_zero_error, height_zero_error : float or sequence of float
        Standard errors of zeros [degree, m] that are given, and of what is "shared", in each image by itself.
    topography_error : float
        Standard deviation of what the undeformed regions differ by in level [m]: 0 for a flat surface, infinite (the
        default) if nothing is known of it.
    prior, prior_factor
        As for `invert`.

    Returns
    -------
    xarray.Dataset
        Over "region" materials, their errors and flags as of `invert`, with `ambiguous` where other materials fit as
        well; over ("region", "property") `determination`, ``determined``, ``combination_only`` (together with others,
        not by itself), ``not_identifiable`` or ``given``. Over "image" `phase_zero` [degree] and, up to a constant,
        `height_zero` [m] with their errors, which `invert` may be given to go on with pixels. Over ("region", "image")
        medians and what was fitted to them, without zeros and topography. The page on the file format lists every
        variable. Sentences in the attributes ``verdict`` and ``advice``.

    Notes
    -----
    Where the zero of the phase is given, its sign tells the branch; elsewhere all are tried in which images that take
    more amplitude away are the repulsive ones.

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
    given = list_of_images(images)
    whole = make_stack(given, scope, setpoints, (phase_error, 0.0, 0.0), (height_error, 0.0, 0.0))
    zeros = (phase_zero, phase_zero_error), (height_zero, height_zero_error)
    plan = make_plan(given, whole.scopes, *zeros, topography_error)
    names, numbers = regions_of(labels, given[0]["phase"].shape)
    stack = plan.taken_off(whole, numbers >= 0).medians(numbers, len(names))
    fixed = {names.index(name): one for name, one in check_known(known, names, prior).items()}
    problem, *start = _prepare(make_model(stack.scopes, stack.setpoints, prior, factor), stack, fixed, plan)
    fitted = fit_regions_from(problem, *start)
    configuration = {
        "known": {str(names[r]): describe(one) for r, one in fixed.items()}, "prior": describe(prior),
        "prior_factor": factor, "phase_zero": plan.phase or "given", "height_zero": plan.height or "given",
    }  # fmt: skip
    ds = of_regions(problem, fitted, stack, given[0], fixed, names, configuration)
    add_data(ds, problem, fitted, stack, plan)
    add_variable(ds, "pixels", "region", np.bincount(numbers[numbers >= 0]), "pixels of the region")
    ds["label"] = (("y", "x"), np.asarray(labels).astype(np.int32), {"long_name": "region of the pixel"})
    write_verdict(ds, problem, fitted, plan)
    return ds


def _prepare(
    model: Model, stack: Stack, materials: dict[int, Material], plan: ZeroPlan
) -> tuple[RegionProblems, Array, Array]:
    """The problem, and the materials and places of their orbits that it starts from; some are known."""
    grid = make_grid(model)
    grids = [grid_of_one(model.with_reference(materials[r])) if r in materials else grid for r in range(len(stack))]
    sides = model.sides_of(stack) if plan.phase is None or not model.averages else None
    q, both, places = make_starts(model, stack, grids, sorted(materials), plan, sides)
    fixed = {}
    for r in materials:
        known = grids[r].values[(both[:, r] > 0).astype(int), 0, np.arange(both.shape[2])]
        fixed[r] = np.where((both[:, r] == 0)[..., None], 0.0, known)
    return problem_of(model, stack, both, plan.zeros(len(stack)), fixed), q, places


def of_regions(
    problem: RegionProblems, fitted: Fitted, stack: Stack, image: xr.Dataset, fixed: dict[int, Material],
    names: list[int], configuration: dict[str, Any],
) -> xr.Dataset:  # fmt: skip
    """Materials of regions with these labels, some `fixed`, and how well each property is determined."""
    regions, unknown, chi2, degrees = len(stack), problem.unknown, fitted.chi2, fitted.degrees
    logs, errors = np.zeros((regions, 3)), np.zeros((regions, 3))
    codes = np.full((regions, 3), GIVEN, np.int8)
    logs[unknown] = fitted.q.reshape(-1, 3)
    errors[unknown] = np.sqrt(np.diag(fitted.covariance)).reshape(-1, 3)
    poor = degrees > 0.5 and chance(chi2, degrees) < UNLIKELY
    codes[unknown] = OPEN if poor else codes_of(fitted.covariance, fitted.information).reshape(-1, 3)
    materials = problem.model.materials(logs)
    for region, material in fixed.items():
        materials[region] = problem.model.with_reference(material).reference
    flags = (np.isin(codes, (COMBINED, OPEN)) << np.arange(3)).sum(axis=1)
    flags |= POOR * poor | AVERAGED * (not fitted.best.exact[0]) | AMBIGUOUS * bool(fitted.others)
    misfit = np.array(chi2 / degrees if degrees > 0.5 else np.nan)
    estimates = Estimates(materials, errors, misfit, flags.astype(np.uint8))
    ds = dataset_of(estimates, stack, image, ("region",), configuration, "fitted by regions")
    logarithms = [f"{name} {names[r]}" for r in unknown for name in PARAMETERS]
    ds = ds.assign_coords(
        region=("region", names, {"long_name": "label of the region"}), property=list(PARAMETERS),
        parameter=logarithms, other=logarithms,
    )  # fmt: skip
    ds["determination"] = (("region", "property"), codes, coded("how far the data determine a property", *CODES))
    long_name = "covariance of the natural logarithms, whatever the zeros"
    add_variable(ds, "covariance", ("parameter", "other"), fitted.covariance, long_name)
    return ds


def add_data(ds: xr.Dataset, problem: RegionProblems, fitted: Fitted, stack: Stack, plan: ZeroPlan) -> None:
    """Put zeros, and measured values beside fitted ones, into the Dataset of materials."""
    columns = plan.zeros(len(stack)).columns
    moved, orbits = columns @ fitted.zeros, (fitted.best.values + fitted.best.defect)[0]
    zero, error = moments_of_zeros(
        fitted, plan.signs * np.degrees(plan.phase_given + fitted.drawn @ columns[0, :, PHASE].T)
    )
    long_name = "what the instrument says where the phase is 0"
    add_variable(ds, "phase_zero", "image", within_half_a_turn(zero), long_name, "degree")
    add_variable(ds, "phase_zero_error", "image", error, "its standard error", "degree")
    if problem.weights[..., HEIGHT].any():
        drawn = plan.height_given + fitted.drawn @ columns[0, :, HEIGHT].T
        zero, error = moments_of_zeros(fitted, drawn - drawn.mean(axis=1, keepdims=True))
        add_variable(ds, "height_zero", "image", zero, "zero of the height, relative to its mean over the images", "m")
        add_variable(ds, "height_zero_error", "image", error, "its standard error", "m")
    seen, free = np.isfinite(stack.errors), np.array(stack.setpoints) * [one.driven_amplitude for one in stack.scopes]
    dims = ("region", "image")
    for channel, name, unit, scale, below in (
        (PHASE, "phase", "degree", 180 / np.pi, 0.0), (HEIGHT, "height", "m", 1.0, free)
    ):  # fmt: skip
        has_data = seen[:, :, channel]
        if not has_data.any():
            continue
        measured = stack.values[:, :, channel] - moved[:, :, channel] - below
        for word, values, long_name in (
            (f"measured_{name}", measured, f"median {name} relative to its zero"),
            (f"fitted_{name}", orbits[:, :, channel] - below, f"{name} of the fit"),
            (f"{name}_error", stack.errors[:, :, channel], f"standard error of the median {name}"),
        ):
            add_variable(ds, word, dims, np.where(has_data, scale * values, np.nan), long_name, unit)
    ds["branch"] = (dims, fitted.sides, coded("branch that was fitted", "attractive", "none", "repulsive", first=-1))


def write_verdict(ds: xr.Dataset, problem: RegionProblems, fitted: Fitted, plan: ZeroPlan) -> None:
    """Write the verdict, and advice on further measurements."""
    flags, names = int(np.bitwise_or.reduce(ds["flag"].values)), ds["region"].values.tolist()
    if flags & POOR:
        misfit = float(ds["misfit"])
        ds.attrs["verdict"] = f"The model does not describe the data: chi2 is {misfit:.3g} a degree of freedom."
        ds.attrs["advice"] = DOUBT
        return
    sentences = say_regions(names, ds["determination"].values, np.linalg.inv(fitted.information), problem.unknown)
    words = {SHARED: "one unknown of all images", FREE: "one unknown in each image", None: "given"}
    sentences.append(f"Zero of the phase: {words[plan.phase]}.")
    if fitted.data < len(fitted.q):
        sentences.append(
            f"The {fitted.data} data that zeros leave are fewer than the {len(fitted.q)} properties sought: what they "
            "do not say is the prior's."
        )
    if np.isnan(fitted.drawn).any():
        sentences.append("The fit ended where a branch ends: no errors are known, and the zeros are not.")
    if flags & AVERAGED:
        sentences.append("Exact orbits were not found; the fit is that of averaged ones.")
    if fitted.others:
        listed = [
            f"{name} {100 * np.expm1(apart):+.0f} % in region {names[region]}"
            for region, row in zip(problem.unknown, (fitted.others[0] - fitted.q).reshape(-1, 3), strict=True)
            for name, apart in zip(PARAMETERS, row, strict=True)
        ]
        sentences.append(f"Other materials fit as well, such as {', '.join(listed)}.")
    ds.attrs["verdict"] = "\n".join(sentences)
    open_still = np.isin(ds["determination"].values, (COMBINED, OPEN)).any()
    ds.attrs["advice"] = "\n".join(say_what_helps(plan.phase is not None, plan.phase == FREE) if open_still else [])
