"""Materials of regions from measured images whose zeros of phase and height are unknown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.asked import asked_as
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Microscope
from phasemap.inference.images.answer import add_data, of_regions, tell
from phasemap.inference.images.joint import fit
from phasemap.inference.images.model import Model, make_model, sides_of
from phasemap.inference.images.problem import Problem, problem_of
from phasemap.inference.images.stack import Stack, list_of_images, make_stack, regions_of
from phasemap.inference.images.starts import grid_of_one, make_grid, make_starts
from phasemap.inference.images.zeros import FREE, Plan, make_plan
from phasemap.inference.verdict import PRIOR, check_known, check_prior, put
from phasemap.results.variables import describe

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]


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
        numbers. By default the attribute ``phase_zero`` of the images, and "shared" if they have none.
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
    plan = make_plan(given, (phase_zero, phase_zero_error), (height_zero, height_zero_error), topography_error)
    names, numbers = regions_of(labels, given[0]["phase"].shape)
    stack = plan.taken_off(whole, numbers >= 0).medians(numbers, len(names))
    fixed = {names.index(name): one for name, one in check_known(known, names, prior).items()}
    problem, q = _prepare(make_model(stack.scopes, stack.setpoints, prior, factor), stack, fixed, plan)
    found = fit(problem, q)
    configuration = {
        "known": {str(names[r]): describe(one) for r, one in fixed.items()}, "prior": describe(prior),
        "prior_factor": factor, "phase_zero": plan.phase or "given", "height_zero": plan.height or "given",
    }  # fmt: skip
    ds = of_regions(problem, found, stack, given[0], fixed, names, configuration)
    add_data(ds, problem, found, stack, plan)
    put(ds, "pixels", "region", np.bincount(numbers[numbers >= 0]), "pixels of the region")
    ds["label"] = (("y", "x"), np.asarray(labels).astype(np.int32), {"long_name": "region of the pixel"})
    tell(ds, problem, found, plan)
    return ds


def _prepare(model: Model, stack: Stack, materials: dict[int, Material], plan: Plan) -> tuple[Problem, Array]:
    """The problem, and the materials that it starts from; some are known."""
    grid = make_grid(model)
    grids = [grid_of_one(model.around(materials[r])) if r in materials else grid for r in range(len(stack))]
    sides = sides_of(stack) if plan.phase is None else None
    q, both = make_starts(model, stack, grids, sorted(materials), plan, sides)
    fixed = {}
    for r in materials:
        there = grids[r].values[(both[:, r] > 0).astype(int), 0, np.arange(both.shape[2])]
        fixed[r] = np.where((both[:, r] == 0)[..., None], 0.0, there)
    return problem_of(model, stack, both, plan.zeros(len(stack)), fixed), q
