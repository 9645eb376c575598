"""From measured images back to materials: maps of modulus, adhesion and damping."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.asked import asked_as
from phasemap._shared.threads import Progress, bounds_of, chunk_of, spread, workers_of
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Microscope
from phasemap.inference.images.answer import AVERAGED, FLAGS, NO_DATA, NO_ORBIT, POOR, Found, dataset_of
from phasemap.inference.images.model import Model, make_model
from phasemap.inference.images.posterior import moments
from phasemap.inference.images.problem import normal_equations, problem_of_pixels, refine
from phasemap.inference.images.stack import Stack, list_of_images, make_stack
from phasemap.inference.images.starts import Grid, descend_from_grid, make_grid
from phasemap.inference.verdict import PRIOR, UNKNOWN, UNLIKELY, chance, check_prior
from phasemap.results.variables import describe

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

ALONE = (
    "One image has fewer data than a material has properties: add images of the same place at other setpoints and, "
    "better, at another free amplitude."
)
BLOCKS = (512, 8192)  # least and most pixels that are solved together: small parts cost time, but threads want some


@asked_as()
def invert(
    images: xr.Dataset | Sequence[xr.Dataset],
    scope: Microscope | Sequence[Microscope],
    *,
    setpoints: Any = None,
    phase_error: Any = 0.4,
    height_error: Any = 0.1e-9,
    phase_zero: Any = None,
    phase_zero_error: Any = 0.0,
    height_zero: Any = 0.0,
    height_zero_error: Any = 0.0,
    prior: Material = PRIOR,
    prior_factor: float = 10.0,
    threads: int | None = None,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Find modulus, adhesion and damping of every pixel from images at several setpoints or free amplitudes.

    Each pixel is solved by itself, by damped Gauss-Newton with the sensitivities of the model, on the branch that the
    sign of its phase tells. Its own topography, the same in all images, is an unknown too: heights count by how they
    change from image to image. Look at `flag` before the values: it says per pixel what the data do not determine.

    Parameters
    ----------
    images : xarray.Dataset or sequence of xarray.Dataset
        Registered images of the same place, with ``phase`` [degree] and ``height`` [m] over ("y", "x"); or one Dataset
        with a leading dim "setpoint" or "image". Heights are used if all images have them, and there are two at least.
    scope : Microscope or sequence of Microscope
        One for each image if their drives differ.
    setpoints : sequence of float, optional
        Amplitude over free amplitude of each image; taken from the attribute ``setpoint`` if missing.
    phase_error, height_error : float or sequence of float
        Standard errors of a pixel [degree, m], of all images or of each.
    phase_zero, height_zero : float or sequence of float, optional
        What the instrument says where the phase, or the height of the undeformed surface, is 0 [degree, m], of all
        images or of each. The phase's is taken from the attribute ``phase_zero`` if missing. Only differences between
        the height zeros count.
    phase_zero_error, height_zero_error : float or sequence of float
        Their standard errors [degree, m], in each image by itself. They are the same for all pixels of an image, and so
        is what they do to the maps.
    prior : Material
        A guess at the sample, weak: its properties are known within `prior_factor`. Its Poisson's ratio is taken for
        granted; what phases know is E / (1 - nu^2).
    prior_factor : float
        One standard deviation of the prior, as a factor above 1. Properties are sought within its third power.
    threads : int, optional
        All cores by default. The numbers do not depend on it.
    progress : callable, optional
        Called as ``progress(done, total)`` in pixels.

    Returns
    -------
    xarray.Dataset
        Over ("y", "x"): modulus [Pa], adhesion [J/m2], damping [1]; `modulus_error`, `adhesion_error`, `damping_error`,
        standard errors of their natural logarithms [1], prior included; misfit [1], chi2 over degrees
        of freedom; flag (CF bit mask): `modulus_not_determined` and so on where that error is above 0.5, so that the
        value is mostly the prior's, `poor_fit` where the model does not describe the data, `no_orbit`, `no_data`,
        `averaged_only` where exact orbits were not found. Over "image": setpoint and free_amplitude.

    Raises
    ------
    InputError
        If images, microscopes and settings do not fit together, or the contact law has a neck.

    Notes
    -----
    Errors come from the noise and the zeros stated. A wrong spring constant, tip radius or contact law is not in them.
    A pixel cannot tell the zeros: its material makes up for them. `fit_regions` finds them from contrast.

    Examples
    --------
    >>> import phasemap as pm
    >>> scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(40e-9))
    >>> sample = pm.Surface(modulus=[[0.5e9, 2e9]], adhesion=0.06, damping=0.02, pixel_size=4e-9)
    >>> stack = [pm.simulate(sample, scope, setpoint) for setpoint in (0.5, 0.65, 0.8)]
    >>> found = pm.invert(stack, scope, phase_zero=0.0, height_error=0.02e-9)
    >>> (found.modulus.values / 1e9).round(1).tolist()
    [[0.5, 2.0]]
    """
    started = time.perf_counter()
    factor = check_prior(prior, prior_factor)
    given = list_of_images(images)
    stack = make_stack(
        given, scope, setpoints, (phase_error, phase_zero, phase_zero_error),
        (height_error, height_zero, height_zero_error),
    )  # fmt: skip
    model, shape = make_model(stack.scopes, stack.setpoints, prior, factor), given[0]["phase"].shape
    found = _solve(model, stack, threads, progress)
    maps = Found(*(values.reshape(*shape, *values.shape[1:]) for values in found))
    configuration = {"prior": describe(prior), "prior_factor": factor}
    ds = dataset_of(maps, stack, given[0], ("y", "x"), configuration, "inverted")
    parts = [f"{name.replace('_', ' ')} {100 * np.mean(found.flags >> i & 1):.3g} %"
             for i, name in enumerate(FLAGS) if (found.flags >> i & 1).any()]  # fmt: skip
    ds.attrs["verdict"] = f"Of {len(stack)}: {', '.join(parts) or 'everything is determined'}."
    if len(given) == 1:
        ds.attrs["advice"] = ALONE
    ds.attrs["seconds"] = round(time.perf_counter() - started, 6)
    return ds


def _solve(model: Model, stack: Stack, threads: int | None, progress: Progress | None) -> Found:
    """Materials of all pixels; those with the same errors at a time."""
    grid, count, workers = make_grid(model), len(stack), workers_of(threads)
    answer = Found(
        np.full((count, 3), np.nan), np.full((count, 3), np.nan), np.full(count, np.nan), np.zeros(count, np.uint8)
    )

    def solve(first: int, last: int) -> None:
        kinds = np.unique(stack.errors[first:last].reshape(last - first, -1), axis=0, return_inverse=True)[1]
        for kind in np.unique(kinds):
            some = first + np.flatnonzero(kinds.reshape(-1) == kind)
            for whole, values in zip(answer, _solve_alike(model, grid, stack.part(some)), strict=True):
                whole[some] = values

    spread(solve, bounds_of(count, max(BLOCKS[0], chunk_of(count, workers, BLOCKS[1]))), workers, progress)
    return answer


def _solve_alike(model: Model, grid: Grid, stack: Stack) -> Found:
    """The same of pixels with the same errors."""
    problem = problem_of_pixels(model, stack)
    found = refine(problem, descend_from_grid(problem, grid))
    slopes, rest = problem.weigh(found.slopes), problem.rest(found.values, found.defect)
    covariance = np.asarray(np.linalg.inv(normal_equations(problem, slopes, rest, found.q)[0]), np.float64)
    learnt = np.einsum("nij,naj,nai->n", covariance, slopes, slopes)  # parameters that the data determine
    mean, covariance = moments(problem, found, covariance)
    errors = np.sqrt(np.einsum("nii->ni", covariance))
    data, chi2 = int((problem.weights > 0).sum()), (rest**2).sum(axis=1)
    degrees = data - problem.projection.basis.shape[1] - learnt
    flags = ((errors > UNKNOWN) << np.arange(3)).sum(axis=1)
    flags |= POOR * ((degrees > 0.5) & (chance(chi2, np.maximum(degrees, 0.5)) < UNLIKELY)) | AVERAGED * ~found.exact
    flags = np.full_like(flags, NO_DATA | 7) if not data else np.where(found.good, flags, NO_ORBIT | 7)
    lost = np.where(found.good & (data > 0), 1.0, np.nan)
    return Found(model.materials(mean) * lost[:, None], errors * lost[:, None], chi2 / (degrees * lost), flags)
