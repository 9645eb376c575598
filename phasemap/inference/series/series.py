"""Several measured files of one sample, explained together: what can be said of them, and what cannot."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.arrays import as_list
from phasemap._shared.asked import asked_as
from phasemap._shared.checks import number, whole
from phasemap._shared.errors import InputError, SolveError
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Microscope
from phasemap.inference.images.model import Model, make_model
from phasemap.inference.sampling import REACH, sample
from phasemap.inference.series.answer import dataset_of
from phasemap.inference.series.contrasts import Medians, drift_of, each_of, medians, regions_of
from phasemap.inference.series.orbits import make_table
from phasemap.inference.series.problem import Problem
from phasemap.inference.series.recorded import read_files
from phasemap.inference.series.settings import FREE, Settings, scope_of, settings_of
from phasemap.inference.verdict import PRIOR, check_known, check_prior
from phasemap.io.measured import one_scan

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

FACTORS = (10.0, 2.5, 5.0)  # within which modulus, adhesion and damping are known beforehand
MOST = 64  # files


@asked_as()
def series(
    files: Sequence[xr.Dataset | str | os.PathLike[str]],
    scope: Microscope | None = None,
    *,
    regions: int = 2,
    by: str | None = None,
    labels: Any = None,
    known: Mapping[int, Material] | None = None,
    setpoints: Any = None,
    free_amplitudes: Any = None,
    phase_zero: Any = None,
    phase_zero_error: float = 0.0,
    sign: int | None = None,
    phase_error: float = 1.0,
    prior: Material = PRIOR,
    prior_factor: Any = FACTORS,
    direction: str | None = None,
    seed: int = 0,
) -> xr.Dataset:
    """Explain the phase contrast in several measured files of one sample, whatever they leave unsaid.

    A material is sought for each region that makes the contrasts at all settings. What files do not say of amplitudes,
    setpoints, zero and sign of the phase is unknown beside; what is reported is what all unknowns leave possible.

    Parameters
    ----------
    files : sequence of path-like or xarray.Dataset
        Two at least, as of `phasemap.read_image`, in any order.
    scope : Microscope, optional
        Its drive's amplitude is not used. By default lever and frequency of the files; what they do not say is
        assumed, and said in the attribute ``notes``.
    regions : int
        How many to find, 2 to 4.
    by : {"phase", "height"}, optional
        What tells regions apart; by default the phase, or the height where that shows the same much more sharply.
    labels : array_like of int, or a sequence of them, one a file; optional
        Regions (2 to 5) that are known, -1 where pixels are left out.
    known : mapping of int to Material, optional
        Materials that need not be sought, by the label of their region.
    setpoints, free_amplitudes : float or sequence of float, optional
        Of the files [1, m at the drive frequency], in their order. By default as recorded. Free amplitudes that are not
        known in metres are "shared" (one unknown scale; what is recorded in volts, or of the drive, says how they
        differ), or "free" (an unknown in each).
    phase_zero : "shared", "free", float or sequence of float, optional
        Recorded phase of the free lever [degree]. By default as recorded, else an unknown in each file: then only
        contrasts count.
    phase_zero_error : float
        Standard error of each file's zero [degree].
    sign : {1, -1}, optional
        -1 if the instrument counts lag positive; by default both are tried.
    phase_error : float
        Error of a region's median beside its standard error [degree]: crosstalk, and what the model leaves out.
    prior : Material
    prior_factor : float or three of them
        Within which modulus, adhesion and damping are that of the prior, with a chance of 68 %.
    direction : str, optional
        "trace" or "retrace"; None takes the first there is.
    seed : int

    Returns
    -------
    xarray.Dataset
        Files in order from the gentlest tapping; ``_low`` and ``_high`` are ends of 95 %. Over ("region", "file"):
        `phase` (median as recorded), `measured_contrast` against region 0, `fitted_contrast`, errors [degree], and
        `repulsive`, the chance of the repulsive branch. Over "file": `setpoint`, `free_amplitude` [m], `phase_zero`
        [degree]. Over "region": modulus [Pa], adhesion [J/m2], damping [1], and how well each is known,
        `determination` as of `fit_regions`. `sign_chance`, of sign 1; `discrepancy`, the factor by which errors are
        larger than stated, 1 at least. Curves against the setpoint, `draws` of every unknown, and pictures of every
        file, `image_0`, `labels_0` ... Sentences in the attributes ``verdict``, ``notes``, ``advice``.

    Raises
    ------
    InputError, FileError, SolveError
        If files do not belong together or cannot be read, or nothing that the prior allows holds the setpoints.

    Notes
    -----
    Orbits are averaged, exact enough where Q is above some 30. The branch that the tip meets first has a chance of 3
    in 4 where there is another. A wrong lever, tip radius or law is not in the errors. Order and sign of the
    contrast are what a series tells; its magnitude can mostly be fitted.

    Examples
    --------
    >>> import phasemap as pm
    >>> scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(40e-9))
    >>> labels = [[0, 0, 1]] * 20
    >>> pair = {0: pm.Material(2e9, 0.05, 0.01), 1: pm.Material(0.2e9, 0.05, 0.03)}
    >>> sample = pm.Surface.from_labels(labels, pair, pixel_size=4e-9)
    >>> files = [pm.simulate(sample, scope, setpoint, "averaging") for setpoint in (0.5, 0.8)]
    >>> found = pm.series(files, scope, labels=labels)
    >>> found.setpoint.values.tolist(), bool((found.measured_contrast * found.fitted_contrast)[1].min() > 0)
    ([0.8, 0.5], True)
    """
    images, file_names = _read(files, direction)
    error = number("phase_error", phase_error, "degree", above=0)
    whole("regions", regions, 2, 4)
    whole("seed", seed, 0)
    widths = _widths(prior, prior_factor)
    used, told = scope_of(images, scope)
    given = {
        "setpoints": setpoints, "free_amplitudes": free_amplitudes, "phase_zero": phase_zero,
        "phase_zero_error": number("phase_zero_error", phase_zero_error, "degree", minimum=0), "sign": sign,
    }  # fmt: skip
    settings, order = settings_of(images, file_names, given).ordered()
    images = [images[i] for i in order]
    each = None if labels is None else each_of(labels, len(images))
    found = regions_of(images, settings.names, each and [each[i] for i in order], by, regions)
    seen = medians(images, found.labels)
    drift, repeated = drift_of(seen.values, settings.repeats, settings.zero != FREE)
    if drift > error:
        those = ", ".join(settings.names[i] for i in repeated)
        told.append(f"Repeats at one setting differ by {drift:.2g} degrees ({those}): all errors have that in them.")
    model = make_model((used,), (0.5,), prior, math.e)
    problem = _problem(model, settings, seen, max(drift, error), widths, (known, prior))
    draws = sample(problem.likelihood, len(problem.names), seed)
    if draws is None:
        raise SolveError("No oscillation that the prior allows holds the setpoints: see to lever and amplitude.")
    ds = dataset_of(problem, draws, problem.explained(draws.x, seed), seen, images, found.labels)
    return ds.assign_attrs(notes="\n".join([*told, *settings.told, *found.told]))


def _problem(
    model: Model, settings: Settings, seen: Medians, error: float, widths: Array,
    materials: tuple[Mapping[int, Material] | None, Material],
) -> Problem:  # fmt: skip
    """What is to be explained, with this error [degree] of each median; `materials`: those known, and the prior."""
    known, prior = materials
    fixed = _known(known, model, prior, len(seen.values))
    limits, levels = settings.ranges(REACH)
    table, there = make_table(model, REACH * widths, limits, levels), np.isfinite(seen.values)
    errors = np.where(there, np.hypot(np.nan_to_num(seen.errors), error), np.inf)
    return Problem(model, table, settings, np.where(there, seen.values, 0.0), errors, fixed, widths)


def _read(files: Any, direction: str | None) -> tuple[list[xr.Dataset], list[str]]:
    """One scan of each file, and what they are called."""
    if isinstance(files, str | os.PathLike) or not isinstance(files, Sequence) or not 2 <= len(files) <= MOST:
        size = len(files) if isinstance(files, Sequence) and not isinstance(files, str) else files
        hint = "A single image is for compare, or for invert." if size == 1 else ""
        raise InputError("number of files", size, f"2 to {MOST} files or images of one sample", hint)
    images = read_files(files)
    return [one_scan(one, ["phase"], direction) for one in images], [str(one.attrs["title"]) for one in images]


def _widths(prior: Material, factors: Any) -> Array:
    """Standard deviations of the logarithms."""
    allowed = "a number above 1, or three"
    given = as_list("prior_factor", factors, allowed)
    if len(given) not in (1, 3):
        raise InputError("prior_factor", factors, allowed)
    return np.log([check_prior(prior, one) for one in given * (3 // len(given))])


def _known(known: Mapping[int, Material] | None, model: Model, prior: Material, count: int) -> Array:
    """Logarithms of the materials that are given over those of the prior, NaN for others, shape (count, 3)."""
    logs = np.full((count, 3), np.nan)
    for region, one in check_known(known, range(count), prior).items():
        values = model.around(one).reference
        values[0] *= (1 - prior.poisson_ratio**2) / (1 - one.poisson_ratio**2)  # what images know
        logs[region] = np.log(np.maximum(values, 1e-9 * model.reference) / model.reference)
    return logs
