"""Inversion of measured images: maps of modulus, adhesion and damping.

What is weakly determined of a pixel is mostly one combination of the properties: chi2 has a long valley, curved and
skewed, where a parabola is too simple. It is followed to both sides of the best material, and the posterior integrated
along it; across it, it is taken as normal.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from phasemap._shared.arrays import Array
from phasemap._shared.asked import asked_as
from phasemap._shared.threads import Progress, bounds_of, chunk_of, spread, workers_of
from phasemap.experiment.described import describe
from phasemap.experiment.material import Material
from phasemap.experiment.material_rows import damping_of
from phasemap.experiment.microscope import Microscope
from phasemap.inference.determined import PARAMETERS, PRIOR, UNITS, UNKNOWN, UNLIKELY, add_variable, chance, check_prior
from phasemap.inference.images.least_squares import (
    RegionProblems,
    Solution,
    information,
    normal_equations,
    problem_of_pixels,
    refine,
)
from phasemap.inference.images.model import Model, make_model
from phasemap.inference.images.stack import Stack, list_of_images, make_stack
from phasemap.inference.images.starts import Grid, descend_from_grid, make_grid
from phasemap.results.variables import provenance

SHARP = 0.05  # standard error of every logarithm below which the parabola will do
FIRST, GROWTH, STEPS = 0.5, 1.3, 7  # steps along the valley: in its standard deviations, each longer, to either side
DEEP = 20.0  # chi2 above the least, at which a side is done
SHALLOW = 6.0  # the same, above which a side that ends is cut off
APART = 3.0  # standard errors between two solutions that are not the same
LONGEST = 1.0  # of a correction across the valley, in a logarithm

ALONE = (
    "One image has fewer data than a material has properties: add images of the same place at other setpoints and, "
    "better, at another free amplitude."
)
# Least and most pixels that are solved together: small parts cost time, but threads want some, and exact orbits room.
BLOCKS, EXACT_BLOCKS = (512, 8192), (16, 64)
FLAGS = (
    "modulus_not_determined", "adhesion_not_determined", "damping_not_determined", "poor_fit", "no_orbit", "no_data",
    "averaged_only", "ambiguous",
)  # fmt: skip
POOR, NO_ORBIT, NO_DATA, AVERAGED, AMBIGUOUS = (1 << FLAGS.index(name) for name in FLAGS[3:])


class Estimates(NamedTuple):
    """Materials of pixels or regions."""

    materials: Array  # shape (..., 3)
    errors: Array  # shape (..., 3); of their logarithms
    misfit: Array  # shape (...) or (); chi2 over degrees of freedom
    flags: NDArray[Any]  # shape (...); by `FLAGS`


def dataset_of(
    estimates: Estimates, stack: Stack, image: xr.Dataset, dims: tuple[str, ...], configuration: dict[str, Any],
    how: str,
) -> xr.Dataset:  # fmt: skip
    """Materials over these dims, settings over "image", and where all this comes from; places are those of an image."""
    ds = xr.Dataset()
    for i, name in enumerate(PARAMETERS):
        more = {"ancillary_variables": f"{name}_error flag"}
        add_variable(ds, name, dims, estimates.materials[..., i], name, UNITS[name], **more)
        long_name = f"standard error of the natural logarithm of the {name}"
        add_variable(ds, f"{name}_error", dims, estimates.errors[..., i], long_name)
    scope = stack.scopes[0]
    if scope.interaction.damping_exponent == scope.interaction.law.spread:
        long_name = "viscosity that is this damping, whose relative error it has"
        add_variable(
            ds, "viscosity", dims, estimates.materials[..., 2] / damping_of(np.ones(()), scope), long_name, "Pa s"
        )
    long_name = "chi2 over degrees of freedom, about 1 where the model describes the data"
    add_variable(ds, "misfit", dims if estimates.misfit.ndim else (), estimates.misfit, long_name)
    meant = {"flag_masks": np.array([1 << i for i in range(len(FLAGS))], np.uint8), "flag_meanings": " ".join(FLAGS)}
    ds["flag"] = (dims, estimates.flags, {"long_name": "what the data do not determine, or what went wrong", **meant})
    add_variable(ds, "setpoint", "image", list(stack.setpoints), "setpoint")
    amplitudes = [one.drive.free_amplitude for one in stack.scopes]
    add_variable(ds, "free_amplitude", "image", amplitudes, "free amplitude at resonance", "m")
    scopes = [describe(one) for one in dict.fromkeys(stack.scopes)]
    ds.attrs.update(provenance({"microscopes": scopes, "setpoints": list(stack.setpoints), **configuration}, how))
    places = image["phase"].coords
    return ds.assign_coords({dim: places[dim].reset_coords(drop=True) for dim in ("y", "x") if dim in places})


class _Valleys(NamedTuple):
    """Valleys of chi2 of n pixels: directions along, (n, 3), and across, (n, 3, 2), and places along each, (n, k).

    There, logarithms of the density, (n, k), conditional means, (n, k, 3), and covariances, (n, k, 3, 3).
    """

    along: Array
    across: Array
    places: Array
    logs: Array
    points: Array
    spreads: Array


def moments(problem: RegionProblems, solution: Solution, covariance: Array) -> tuple[Array, Array]:
    """Means, shape (n, 3), and covariances, shape (n, 3, 3), of the logarithms. `covariance`: those of the parabola."""
    mean, parabola, covariance = solution.q.copy(), covariance, covariance.copy()
    wide = (np.einsum("nii->ni", covariance) > SHARP**2).any(axis=1)
    wide = np.flatnonzero(wide & solution.good & (problem.sides != 0).any(axis=(1, 2)))
    if len(wide):
        part, here = problem.part(wide), solution.part(wide)
        sizes, axes = np.linalg.eigh(covariance[wide])
        mean[wide], covariance[wide] = _integrate(part, here, covariance[wide], sizes[:, 2], axes[:, :, ::-1])
        if not problem.model.averages:  # far from harmonic, the second widest direction is a valley too
            _widen(mean, covariance, wide, _integrate(part, here, parabola[wide], sizes[:, 1], axes[:, :, [1, 0, 2]]))
    return mean, covariance


def _widen(mean: Array, covariance: Array, chosen: NDArray[np.intp], other: tuple[Array, Array]) -> None:
    """Take the mean and the error of each logarithm from where its error is larger."""
    variances = [np.einsum("nii->ni", one) for one in (covariance[chosen], other[1])]
    grow = np.sqrt(np.maximum(variances[1] / variances[0], 1.0))
    mean[chosen] = np.where(grow > 1, other[0], mean[chosen])
    covariance[chosen] *= grow[:, :, None] * grow[:, None, :]


def moments_of_all(problem: RegionProblems, solutions: list[Solution]) -> tuple[Array, Array]:
    """Means and covariances over several solutions, the best first; each counts by its share of the posterior."""
    best, means, spreads, logs = solutions[0], list[Array](), list[Array](), list[Array]()
    matrix = information(problem, problem.weigh(best.slopes))
    for solution in solutions:
        apart = solution.q - best.q
        other = np.einsum("ni,nij,nj->n", apart, matrix, apart) > APART**2
        chosen = np.flatnonzero((solution is best) | (other & (solution.chi2 < best.chi2 + DEEP)))
        part, here = problem.part(chosen), solution.part(chosen)
        mean, spread, log = best.q.copy(), np.tile(np.eye(3), (len(apart), 1, 1)), np.full(len(apart), -np.inf)
        parabola = np.asarray(np.linalg.inv(information(part, part.weigh(here.slopes))), np.float64)
        mean[chosen], spread[chosen] = moments(part, here, parabola)
        log[chosen] = 0.5 * (np.linalg.slogdet(spread[chosen])[1] - np.nan_to_num(here.chi2 - best.chi2[chosen]))
        means, spreads, logs = [*means, mean], [*spreads, spread], [*logs, log]
    share = np.exp(logs - np.max(logs, axis=0))
    share /= share.sum(axis=0)
    middle = np.einsum("kn,kni->ni", share, means)
    apart = np.array(means) - middle
    return middle, np.einsum("kn,knij->nij", share, spreads + apart[..., None] * apart[..., None, :])


def _integrate(
    problem: RegionProblems, solution: Solution, covariance: Array, size: Array, axes: Array
) -> tuple[Array, Array]:
    """Moments along the valleys of some pixels: along the first of the axes, (n, 3, 3), of this variance, (n,)."""
    n, k = len(size), 2 * STEPS + 1
    lengths = np.sqrt(size[:, None]) * np.cumsum(FIRST * GROWTH ** np.arange(STEPS))
    places = np.concatenate([-lengths[:, ::-1], np.zeros((n, 1)), lengths], axis=1)
    logs, points, spreads = np.full((n, k), -np.inf), np.zeros((n, k, 3)), np.zeros((n, k, 3, 3))
    for sign in (-1, 1):
        _walk(problem, solution, _Valleys(axes[:, :, 0], axes[:, :, 1:], places, logs, points, spreads), sign)
    lost = np.isneginf(logs).all(axis=1)
    logs[lost, STEPS], points[lost, STEPS], spreads[lost, STEPS] = 0.0, solution.q[lost], covariance[lost]
    steps = np.pad(np.diff(places, axis=1), ((0, 0), (1, 1)))
    weights = (steps[:, 1:] + steps[:, :-1]) * np.exp(logs - logs.max(axis=1, keepdims=True))
    weights /= weights.sum(axis=1, keepdims=True)
    mean = np.einsum("nk,nki->ni", weights, points)
    apart = points - mean[:, None]
    spread = np.einsum("nk,nkij->nij", weights, spreads + apart[..., None] * apart[..., None, :])
    # Where the valley could not be followed to its sides, it may go on: the parabola's width is the least.
    cut = ~(_fallen(logs) & _fallen(logs[:, ::-1]))
    apart = solution.q - mean
    wider = spread + covariance + apart[:, :, None] * apart[:, None, :]
    return mean, np.where(cut[:, None, None], wider, spread)


def _walk(problem: RegionProblems, solution: Solution, valleys: _Valleys, sign: int) -> None:
    """Follow the valleys to one side, and fill in densities, means and covariances along them."""
    along, across, places, logs, points, spreads = valleys
    pixels, q, roots = np.arange(len(along)), solution.q.copy(), solution.places.copy()
    for k in range(STEPS + 1):
        at, near = STEPS + sign * k, roots[pixels]
        orbits = problem.part(pixels).orbits(q[pixels], near) if k > 0 else solution
        inside = orbits.good & (np.abs(q[pixels]) < problem.model.reach).all(axis=1)
        pixels = pixels[inside]
        if not len(pixels):
            return
        roots[pixels], part = near[inside], problem.part(pixels)
        rest = part.rest(orbits.values[inside], solution.defect[pixels])
        matrix, pull = normal_equations(part, part.weigh(orbits.slopes[inside]), rest, q[pixels])
        plane, line = across[pixels], along[pixels, :, None]
        to_plane = plane.transpose(0, 2, 1)
        inner = np.linalg.inv(to_plane @ matrix @ plane)
        cross = to_plane @ pull[..., None]
        step = inner @ cross
        chi2 = part.chi2(rest, q[pixels]) - (cross * step).sum(axis=(1, 2))
        move = (plane @ step)[..., 0]
        move *= np.minimum(1.0, LONGEST / np.maximum(np.abs(move).max(axis=1), 1e-300))[:, None]
        logs[pixels, at] = -0.5 * chi2 + 0.5 * np.log(np.linalg.det(inner))
        points[pixels, at] = q[pixels] + move
        spread = plane @ inner
        spreads[pixels, at] = spread @ to_plane
        if k == STEPS:
            return
        tangent = (line - spread @ (to_plane @ (matrix @ line)))[..., 0]
        q[pixels] = points[pixels, at] + (places[pixels, at + sign] - places[pixels, at])[:, None] * tangent
        pixels = pixels[logs[pixels, at] > logs[pixels].max(axis=1) - 0.5 * DEEP]


def _fallen(logs: Array) -> NDArray[np.bool_]:
    """True where the density falls far enough before its last known value."""
    last = logs.shape[1] - 1 - np.argmax(np.isfinite(logs[:, ::-1]), axis=1)
    return logs[np.arange(len(logs)), last] < logs.max(axis=1) - 0.5 * SHALLOW


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
        One for each image if their drives differ. Its contact law has no neck.
    setpoints : sequence of float, optional
        Amplitude over free amplitude of each image; by default as the images say (``setpoint``, or
        ``setpoint_amplitude`` in m).
    phase_error, height_error : float or sequence of float
        Standard errors of a pixel [degree, m], of all images or of each.
    phase_zero, height_zero : float or sequence of float, optional
        What the instrument says where the phase, or the height of the undeformed surface, is 0 [degree, m], of all
        images or of each. The phase's is by default known by what the images say of the free lever (``phase_zero``).
        Only differences between the height zeros count. Which way the phase counts is the attribute ``phase_sign``, -1
        where lag is positive.
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
        `averaged_only` where exact orbits were not found, `ambiguous` where the tip is attracted in all images, so
        that an adhesion several times as large may explain a tip that never touches. Over "image": setpoint and
        free_amplitude.

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
    estimates = _solve(model, stack, threads, progress)
    maps = Estimates(*(values.reshape(*shape, *values.shape[1:]) for values in estimates))
    configuration = {"prior": describe(prior), "prior_factor": factor}
    ds = dataset_of(maps, stack, given[0], ("y", "x"), configuration, "inverted")
    parts = [f"{name.replace('_', ' ')} {100 * np.mean(estimates.flags >> i & 1):.3g} %"
             for i, name in enumerate(FLAGS) if (estimates.flags >> i & 1).any()]  # fmt: skip
    ds.attrs["verdict"] = f"Of {len(stack)}: {', '.join(parts) or 'everything is determined'}."
    if len(given) == 1:
        ds.attrs["advice"] = ALONE
    ds.attrs["seconds"] = round(time.perf_counter() - started, 6)
    return ds


def _solve(model: Model, stack: Stack, threads: int | None, progress: Progress | None) -> Estimates:
    """Materials of all pixels; those with the same errors at a time."""
    grid, count, workers = make_grid(model), len(stack), workers_of(threads)
    answer = Estimates(
        np.full((count, 3), np.nan), np.full((count, 3), np.nan), np.full(count, np.nan), np.zeros(count, np.uint8)
    )

    def solve(first: int, last: int) -> None:
        kinds = np.unique(stack.errors[first:last].reshape(last - first, -1), axis=0, return_inverse=True)[1]
        for kind in np.unique(kinds):
            alike = first + np.flatnonzero(kinds.reshape(-1) == kind)
            for whole, values in zip(answer, _solve_alike(model, grid, stack.part(alike)), strict=True):
                whole[alike] = values

    least, most = BLOCKS if model.averages else EXACT_BLOCKS
    spread(solve, bounds_of(count, max(least, chunk_of(count, workers, most))), workers, progress)
    return answer


def _solve_alike(model: Model, grid: Grid, stack: Stack) -> Estimates:
    """Materials of pixels that have the same errors."""
    problem = problem_of_pixels(model, stack)
    best, *others = (refine(problem, one) for one in descend_from_grid(problem, grid))
    for other in others:  # the best first
        better = np.flatnonzero(other.chi2 < best.chi2)
        worse = best.part(better)
        best.put(better, other.part(better))
        other.put(better, worse)
    slopes, rest = problem.weigh(best.slopes), problem.rest(best.values, best.defect)
    parabola = np.linalg.inv(information(problem, slopes))
    learnt = np.einsum("nij,naj,nai->n", parabola, slopes, slopes)  # parameters that the data determine
    mean, covariance = moments_of_all(problem, [best, *others])
    errors = np.sqrt(np.einsum("nii->ni", covariance))
    data, chi2 = int((problem.weights > 0).sum()), (rest**2).sum(axis=1)
    degrees = data - problem.projection.basis.shape[1] - learnt
    flags = ((errors > UNKNOWN) << np.arange(3)).sum(axis=1)
    flags |= POOR * (chance(chi2, np.maximum(degrees, 0.5)) < UNLIKELY) | AVERAGED * ~best.exact
    # A tip that is attracted in all images and touches a little, and one that never touches, are minima of their own.
    untouched = (problem.sides <= 0).all(axis=(1, 2)) & (errors[:, 0] > UNKNOWN) & (errors[:, 1] <= UNKNOWN)
    flags |= AMBIGUOUS * untouched
    flags = np.full_like(flags, NO_DATA | 7) if not data else np.where(best.good, flags, NO_ORBIT | 7)
    lost = np.where(best.good & (data > 0), 1.0, np.nan)
    misfit = np.where(degrees > 0.5, chi2 / np.maximum(degrees, 0.5), np.nan) * lost
    return Estimates(model.materials(mean) * lost[:, None], errors * lost[:, None], misfit, flags)
