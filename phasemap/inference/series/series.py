"""Several measured files of one sample, explained together by one Dataset of materials, settings and their errors."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from phasemap._shared.arrays import Array, as_list, within_half_a_turn
from phasemap._shared.asked import asked_as
from phasemap._shared.checks import number, whole
from phasemap._shared.errors import InputError, SolveError
from phasemap.experiment.described import describe
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Microscope
from phasemap.inference.determined import (
    CODES,
    GIVEN,
    PARAMETERS,
    PRIOR,
    UNITS,
    add_variable,
    check_known,
    check_prior,
    codes_of,
)
from phasemap.inference.images.model import Model, make_model
from phasemap.inference.images.stack import FREE
from phasemap.inference.sampling import REACH, Draws, sample
from phasemap.inference.series.contrasts import Labels, Medians, drift_of, each_of, medians, regions_of
from phasemap.inference.series.likelihood import Explained, Part, SeriesProblem, State, make_table
from phasemap.inference.series.recorded import read_files
from phasemap.inference.series.report import write_report
from phasemap.inference.series.settings import HELD, Settings, scope_of, settings_of
from phasemap.io.measured import one_scan
from phasemap.results.variables import coded, provenance

ENDS = (2.5, 97.5)  # percentiles
CURVE = np.linspace(0.2, 0.98, 53)  # setpoints of curves
BAND = 60  # draws that have curves
SMALL = 256  # pixels to a side of the pictures that are kept
SIDES = ("attractive", "repulsive")

FACTORS = (10.0, 2.5, 5.0)  # within which modulus, adhesion and damping are known beforehand
MOST = 64  # files


def dataset_of(
    problem: SeriesProblem, draws: Draws, fit: Explained, seen: Medians, images: Sequence[xr.Dataset],
    labels: Sequence[Labels],
) -> xr.Dataset:  # fmt: skip
    """Dataset of a series: contrasts, settings, materials and curves, with sentences on them."""
    state, settings, likeliest = problem.state(draws.x), problem.settings, int(np.argmax(draws.fit))
    names = {"file": list(settings.names), "region": np.arange(len(problem.values)), "property": list(PARAMETERS)}
    ds = xr.Dataset(coords=names)
    _add_contrasts(ds, problem, seen, fit)
    _add_interval(ds, "setpoint", "file", state.ratios, "1", "setpoint")
    _add_interval(ds, "free_amplitude", "file", state.amplitudes, "m", "free amplitude at the drive frequency")
    _add_interval(ds, "discrepancy", (), state.growth, "1", "factor by which errors are larger than stated, 1 at least")
    _add_interval(ds, "phase_zero", "file", fit.zeros, "degree", "recorded phase of the free lever")
    for name, kind, values in (
        ("setpoint", settings.setpoint, settings.ratios),
        ("free_amplitude", settings.amplitude, settings.relative * settings.scale),
    ):
        recorded = values if kind == HELD else np.full(len(values), np.nan)
        add_variable(
            ds, f"recorded_{name}", "file", recorded, f"{name.replace('_', ' ')}, recorded or given", ds[name].units
        )
    add_variable(ds, "repulsive", ("region", "file"), fit.repulsive.mean(axis=0), "chance of the repulsive branch")
    _add_materials(ds, problem, state)
    apart = within_half_a_turn(problem.values - fit.phases[likeliest] - fit.zeros[likeliest])
    add_variable(ds, "sign_chance", (), float((fit.sign > 0).mean()), "chance of sign 1")
    add_variable(ds, "misfit", (), float(((apart / problem.errors) ** 2).sum()), "chi2 of the likeliest draw")
    add_variable(
        ds, "file_misfit", "file", ((apart / problem.errors) ** 2).sum(axis=0), "what each file has of the misfit"
    )
    long_name = "recorded phase of the free lever by the likeliest draw"
    add_variable(ds, "likeliest_zero", "file", fit.zeros[likeliest], long_name, "degree")
    add_variable(ds, "likeliest_setpoint", "file", state.ratios[likeliest], "setpoint by that draw")
    _add_curves(ds, problem, fit.sign, state, likeliest)
    ds["draws"] = (("draw", "unknown"), draws.x, {"long_name": "unknowns in standard deviations of the prior"})
    ds = ds.assign_coords(unknown=problem.names)
    _add_pictures(ds, images, labels)
    configuration = {"microscope": describe(problem.model.scope), "files": list(problem.settings.names)}
    ds.attrs.update(provenance(configuration, "explained as a series"))
    ds.attrs |= {"amplitude": settings.amplitude, "setpoints": settings.setpoint, "zero": settings.zero}
    ds.attrs["sign"] = settings.sign or 0
    write_report(ds, problem, np.cov(state.logs[:, problem.unknown].reshape(len(draws.x), -1).T))
    return ds


def _add_interval(ds: xr.Dataset, name: str, dims: str | tuple[()], values: Array, units: str, long_name: str) -> None:
    """Add the median of draws and the ends of their 95 % interval to a Dataset."""
    low, middle, high = np.percentile(values, (ENDS[0], 50.0, ENDS[1]), axis=0)
    add_variable(ds, name, dims, middle, long_name, units)
    add_variable(ds, f"{name}_low", dims, low, f"{long_name}, lower end of 95 %", units)
    add_variable(ds, f"{name}_high", dims, high, f"{long_name}, upper end of 95 %", units)


def _add_contrasts(ds: xr.Dataset, problem: SeriesProblem, seen: Medians, fit: Explained) -> None:
    """Add phases and contrasts of regions to a Dataset: measured, and fitted with their 95 % interval."""
    dims = ("region", "file")
    measured = within_half_a_turn(seen.values - seen.values[0])
    error = np.hypot(problem.errors, problem.errors[0])
    error[0] = 0.0
    for name, values, long_name, unit in (
        ("phase", seen.values, "median recorded phase", "degree"),
        ("phase_error", np.where(np.isfinite(problem.errors), problem.errors, np.nan), "its standard error", "degree"),
        ("share", seen.shares, "share of the pixels", "1"),
        ("measured_contrast", measured, "recorded phase relative to that of region 0", "degree"),
        ("contrast_error", np.where(np.isfinite(error), error, np.nan), "its standard error", "degree"),
    ):
        add_variable(ds, name, dims, values, long_name, unit)
    fitted = fit.phases - fit.phases[:, :1]
    low, middle, high = np.percentile(fitted, (ENDS[0], 50.0, ENDS[1]), axis=0)
    for name, values in (("fitted_contrast", middle), ("contrast_low", low), ("contrast_high", high)):
        add_variable(ds, name, dims, values, f"{name.replace('_', ' ')}, as recorded", "degree")


def _add_materials(ds: xr.Dataset, problem: SeriesProblem, state: State) -> None:
    """Properties, and which of them the series determines."""
    regions, unknown = len(problem.values), problem.unknown
    reference = problem.model.reference
    for i, name in enumerate(PARAMETERS):
        _add_interval(ds, name, "region", reference[i] * np.exp(state.logs[:, :, i]), UNITS[name], name)
    codes = np.full((regions, 3), GIVEN, np.int8)
    logs = state.logs[:, unknown].reshape(len(state.logs), -1)
    covariance = np.cov(logs.T)
    codes[unknown] = codes_of(covariance).reshape(-1, 3)
    about = coded("how far the series determines a property", *CODES)
    ds["determination"] = (("region", "property"), codes, about)


def _add_curves(ds: xr.Dataset, problem: SeriesProblem, sign: Array, state: State, likeliest: int) -> None:
    """Phases against the setpoint for each free amplitude: both branches of one draw, and contrasts of some."""
    firsts, curve = np.unique(np.argmax(problem.settings.alike, axis=1), return_inverse=True)
    drawn = np.linspace(0, len(sign) - 1, BAND).astype(int)
    regions, points = len(problem.values), len(CURVE)
    band = np.full((BAND, len(firsts), regions, points), np.nan)
    lines = np.full((len(firsts), 2, regions, points), np.nan)
    for g, first in enumerate(firsts):
        lines[g] = problem.branches(state.logs[likeliest], state.amplitudes[likeliest, first], CURVE)
        for k, draw in enumerate(drawn):
            both = problem.branches(state.logs[draw], state.amplitudes[draw, first], CURVE)
            band[k, g] = sign[draw] * _engaged(both)
    contrasts = band - band[:, :, :1]
    known = np.isfinite(contrasts)
    with np.errstate(all="ignore"):
        enough = known.mean(axis=0) > 0.5
        low, high = np.nanpercentile(np.where(enough, contrasts, 0.0), ENDS, axis=0)
    phases = sign[likeliest] * _engaged(lines)
    dims = ("curve", "region", "level")
    add_variable(ds, "level", "level", CURVE, "setpoint")
    ds["curve_of"] = ("file", curve, {"long_name": "number of the file's curve"})
    long_name = "phase of the likeliest draw, 0 of the free lever, positive where repulsive"
    add_variable(ds, "branch_phase", ("curve", "branch_side", "region", "level"), lines, long_name, "degree")
    ds["branch_side"] = ("branch_side", list(SIDES))
    for name, values in (("curve_contrast", phases - phases[:, :1]), ("curve_low", np.where(enough, low, np.nan)),
                         ("curve_high", np.where(enough, high, np.nan))):  # fmt: skip
        add_variable(ds, name, dims, values, f"{name.replace('_', ' ')}, as recorded", "degree")
    ds["likeliest_sign"] = ((), int(sign[likeliest]), {"long_name": "sign of the likeliest draw"})


def _engaged(both: Array) -> Array:
    """The branch that the tip meets first, from far: the attractive one, as far as it goes without a gap."""
    lower, upper = np.moveaxis(both, -3, 0)
    whole = np.logical_and.accumulate(~np.isnan(lower)[..., ::-1], axis=-1)[..., ::-1]
    return np.where(whole | np.isnan(upper), lower, upper)


def _add_pictures(ds: xr.Dataset, images: Sequence[xr.Dataset], labels: Sequence[Labels]) -> None:
    """Recorded phases and regions, every so many pixels."""
    for i, (image, mine) in enumerate(zip(images, labels, strict=True)):
        step = -(-max(mine.shape) // SMALL)
        dims = (f"y_{i}", f"x_{i}")
        add_variable(ds, f"image_{i}", dims, image["phase"].values[::step, ::step], "recorded phase", "degree")
        ds[f"labels_{i}"] = (dims, mine[::step, ::step].astype(np.int8), {"long_name": "region, -1 where left out"})
        for dim, name in zip(dims, ("y", "x"), strict=True):
            if name in image.coords:
                ds[dim] = (dim, image[name].values[::step], {"units": "m"})


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
        Its drive's amplitude is not used. By default lever and frequency of the files, and DMT contact but where a
        simulated image says another law; what they do not say of the lever is assumed, and said in ``notes``.
    regions : int
        How many to find, 2 to 4.
    by : {"phase", "height"}, optional
        What tells regions apart; by default the phase, or the height where that shows the same much more sharply.
    labels : array_like of int, or a sequence of them, one a file; optional
        Regions (2 to 5) that are known, -1 where pixels are left out.
    known : mapping of int to Material, optional
        Materials that need not be sought, by the label of their region; beyond the prior, if they like.
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
        -1 if the instrument counts lag positive; by default as recorded, else both are tried.
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
        Files in order from the gentlest tapping; ``_low`` and ``_high`` are ends of 95 %. Contrasts against region 0,
        measured and fitted [degree], settings and zeros of the files, and over "region" materials, with
        `determination` as of `fit_regions`; curves against the setpoint, `draws` of every unknown, and pictures of
        every file, `image_0`, `labels_0` ... The page on the file format lists every variable. Sentences in the
        attributes ``verdict``, ``notes``, ``advice``.

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
    if (law := used.interaction.law).in_time:
        hint = "Fit single curves with phasemap.fit_distance instead."
        raise InputError("contact", law.name, "a law that averaging knows: no films, no losses of its own", hint)
    given = {
        "setpoints": setpoints, "free_amplitudes": free_amplitudes, "phase_zero": phase_zero,
        "phase_zero_error": number("phase_zero_error", phase_zero_error, "degree", minimum=0), "sign": sign,
    }  # fmt: skip
    settings, order = settings_of(images, file_names, given).ordered()
    images = [images[i] for i in order]
    each = None if labels is None else each_of(labels, len(images))
    segmented = regions_of(images, settings.names, each and [each[i] for i in order], by, regions)
    seen = medians(images, segmented.labels)
    drift, repeated = drift_of(seen.values, settings.repeats, settings.zero != FREE)
    if drift > error:
        those = ", ".join(settings.names[i] for i in repeated)
        told.append(f"Repeats at one setting differ by {drift:.2g} degrees ({those}): all errors have that in them.")
    model = make_model((used,), (0.5,), prior, math.e)
    problem = _problem(model, settings, seen, max(drift, error), widths, (known, prior))
    draws = sample(problem.likelihood, len(problem.names), seed)
    if draws is None:
        raise SolveError("No oscillation that the prior allows holds the setpoints: see to lever and amplitude.")
    ds = dataset_of(problem, draws, problem.explained(draws.x, seed), seen, images, segmented.labels)
    return ds.assign_attrs(notes="\n".join([*told, *settings.told, *segmented.told]))


def _problem(
    model: Model, settings: Settings, seen: Medians, error: float, widths: Array,
    materials: tuple[Mapping[int, Material] | None, Material],
) -> SeriesProblem:  # fmt: skip
    """Data to be explained, with this error [degree] of each median; `materials`: those known, and the prior."""
    known, prior = materials
    limits, levels = settings.ranges(REACH)
    given, logs = check_known(known, range(len(seen.values)), prior), np.full((len(seen.values), 3), np.nan)
    sought = np.setdiff1d(np.arange(len(seen.values)), list(given))
    parts = [Part(sought, model, make_table(model, REACH * widths, limits, levels), False)]
    for region, material in sorted(given.items()):
        own_model = model.with_reference(material)
        parts.append(Part(np.array([region]), own_model, make_table(own_model, None, limits, levels), True))
        logs[region] = np.log(np.maximum(own_model.reference, 1e-9 * model.reference) / model.reference)
    measured = np.isfinite(seen.values)
    errors = np.where(measured, np.hypot(np.nan_to_num(seen.errors), error), np.inf)
    return SeriesProblem(tuple(parts), settings, np.where(measured, seen.values, 0.0), errors, logs, widths)


def _read(files: Any, direction: str | None) -> tuple[list[xr.Dataset], list[str]]:
    """Images of the series, one scan of each file, and their names."""
    if isinstance(files, str | os.PathLike) or not isinstance(files, Sequence) or not 2 <= len(files) <= MOST:
        size = len(files) if isinstance(files, Sequence) and not isinstance(files, str) else files
        hint = "A single image is for compare, or for invert." if size == 1 else ""
        raise InputError("number of files", size, f"2 to {MOST} files or images of one sample", hint)
    images = read_files(files)
    return [one_scan(one, ["phase"], direction) for one in images], [str(one.attrs["title"]) for one in images]


def _widths(prior: Material, factors: Any) -> Array:
    """Standard deviations of the logarithms of a material's properties."""
    allowed = "a number above 1, or three"
    given = as_list("prior_factor", factors, allowed)
    if len(given) not in (1, 3):
        raise InputError("prior_factor", factors, allowed)
    return np.log([check_prior(prior, one) for one in given * (3 // len(given))])
