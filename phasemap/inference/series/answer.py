"""What was found of a series, as a Dataset."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.arrays import within_half_a_turn
from phasemap.inference.sampling import Draws
from phasemap.inference.series.contrasts import Labels, Medians
from phasemap.inference.series.problem import Explained, Problem, State
from phasemap.inference.series.settings import HELD
from phasemap.inference.series.words import tell
from phasemap.inference.verdict import CODES, GIVEN, PARAMETERS, UNITS, codes_of, put
from phasemap.results.variables import coded, describe, provenance

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

ENDS = (2.5, 97.5)  # percentiles
CURVE = np.linspace(0.2, 0.98, 53)  # setpoints of curves
BAND = 60  # draws that have curves
SMALL = 256  # pixels to a side of the pictures that are kept
SIDES = ("attractive", "repulsive")


def dataset_of(
    problem: Problem, draws: Draws, fit: Explained, seen: Medians, images: Sequence[xr.Dataset],
    labels: Sequence[Labels],
) -> xr.Dataset:  # fmt: skip
    """All variables and sentences."""
    import xarray as xr

    state, settings, likeliest = problem.state(draws.x), problem.settings, int(np.argmax(draws.fit))
    names = {"file": list(settings.names), "region": np.arange(len(problem.values)), "property": list(PARAMETERS)}
    ds = xr.Dataset(coords=names)
    _add_contrasts(ds, problem, seen, fit)
    _add(ds, "setpoint", "file", state.ratios, "1", "setpoint")
    _add(ds, "free_amplitude", "file", state.amplitudes, "m", "free amplitude at the drive frequency")
    _add(ds, "discrepancy", (), state.growth, "1", "factor by which errors are larger than stated, 1 at least")
    _add(ds, "phase_zero", "file", fit.zeros, "degree", "recorded phase of the free lever")
    for name, kind, values in (
        ("setpoint", settings.setpoint, settings.ratios),
        ("free_amplitude", settings.amplitude, settings.relative * settings.scale),
    ):
        recorded = values if kind == HELD else np.full(len(values), np.nan)
        put(ds, f"recorded_{name}", "file", recorded, f"{name.replace('_', ' ')}, recorded or given", ds[name].units)
    put(ds, "repulsive", ("region", "file"), fit.repulsive.mean(axis=0), "chance of the repulsive branch")
    _add_materials(ds, problem, state)
    apart = within_half_a_turn(problem.values - fit.phases[likeliest] - fit.zeros[likeliest])
    put(ds, "sign_chance", (), float((fit.sign > 0).mean()), "chance of sign 1")
    put(ds, "misfit", (), float(((apart / problem.errors) ** 2).sum()), "chi2 of the likeliest draw")
    put(ds, "file_misfit", "file", ((apart / problem.errors) ** 2).sum(axis=0), "what each file has of the misfit")
    said = "recorded phase of the free lever by the likeliest draw"
    put(ds, "likeliest_zero", "file", fit.zeros[likeliest], said, "degree")
    put(ds, "likeliest_setpoint", "file", state.ratios[likeliest], "setpoint by that draw")
    _add_curves(ds, problem, fit.sign, state, likeliest)
    ds["draws"] = (("draw", "unknown"), draws.x, {"long_name": "unknowns in standard deviations of the prior"})
    ds = ds.assign_coords(unknown=problem.names)
    _add_pictures(ds, images, labels)
    configuration = {"microscope": describe(problem.model.scope), "files": list(problem.settings.names)}
    ds.attrs.update(provenance(configuration, "explained as a series"))
    ds.attrs |= {"amplitude": settings.amplitude, "setpoints": settings.setpoint, "zero": settings.zero}
    ds.attrs["sign"] = settings.sign or 0
    tell(ds, problem, np.cov(state.logs[:, problem.unknown].reshape(len(draws.x), -1).T))
    return ds


def _add(ds: xr.Dataset, name: str, dims: str | tuple[()], values: Array, units: str, said: str) -> None:
    """Median and ends of the 95 % of draws."""
    low, middle, high = np.percentile(values, (ENDS[0], 50.0, ENDS[1]), axis=0)
    put(ds, name, dims, middle, said, units)
    put(ds, f"{name}_low", dims, low, f"{said}, lower end of 95 %", units)
    put(ds, f"{name}_high", dims, high, f"{said}, upper end of 95 %", units)


def _add_contrasts(ds: xr.Dataset, problem: Problem, seen: Medians, fit: Explained) -> None:
    dims = ("region", "file")
    measured = within_half_a_turn(seen.values - seen.values[0])
    error = np.hypot(problem.errors, problem.errors[0])
    error[0] = 0.0
    for name, values, said, unit in (
        ("phase", seen.values, "median recorded phase", "degree"),
        ("phase_error", np.where(np.isfinite(problem.errors), problem.errors, np.nan), "its standard error", "degree"),
        ("share", seen.shares, "share of the pixels", "1"),
        ("measured_contrast", measured, "recorded phase relative to that of region 0", "degree"),
        ("contrast_error", np.where(np.isfinite(error), error, np.nan), "its standard error", "degree"),
    ):
        put(ds, name, dims, values, said, unit)
    fitted = fit.phases - fit.phases[:, :1]
    low, middle, high = np.percentile(fitted, (ENDS[0], 50.0, ENDS[1]), axis=0)
    for name, values in (("fitted_contrast", middle), ("contrast_low", low), ("contrast_high", high)):
        put(ds, name, dims, values, f"{name.replace('_', ' ')}, as recorded", "degree")


def _add_materials(ds: xr.Dataset, problem: Problem, state: State) -> None:
    """Properties, and which of them the series determines."""
    regions, unknown = len(problem.values), problem.unknown
    reference = problem.model.reference
    for i, name in enumerate(PARAMETERS):
        _add(ds, name, "region", reference[i] * np.exp(state.logs[:, :, i]), UNITS[name], name)
    codes = np.full((regions, 3), GIVEN, np.int8)
    logs = state.logs[:, unknown].reshape(len(state.logs), -1)
    covariance = np.cov(logs.T)
    codes[unknown] = codes_of(covariance).reshape(-1, 3)
    about = coded("how far the series determines a property", *CODES)
    ds["determination"] = (("region", "property"), codes, about)


def _add_curves(ds: xr.Dataset, problem: Problem, sign: Array, state: State, likeliest: int) -> None:
    """Phases against the setpoint for each free amplitude: both branches of one draw, and contrasts of some."""
    firsts, curve = np.unique(np.argmax(problem.settings.alike, axis=1), return_inverse=True)
    some = np.linspace(0, len(sign) - 1, BAND).astype(int)
    regions, points = len(problem.values), len(CURVE)
    band = np.full((BAND, len(firsts), regions, points), np.nan)
    lines = np.full((len(firsts), 2, regions, points), np.nan)
    for g, first in enumerate(firsts):
        lines[g] = _branches(problem, state, likeliest, state.amplitudes[likeliest, first])
        for k, draw in enumerate(some):
            both = _branches(problem, state, int(draw), state.amplitudes[draw, first])
            band[k, g] = sign[draw] * _engaged(both)
    contrasts = band - band[:, :, :1]
    known = np.isfinite(contrasts)
    with np.errstate(all="ignore"):
        enough = known.mean(axis=0) > 0.5
        low, high = np.nanpercentile(np.where(enough, contrasts, 0.0), ENDS, axis=0)
    own = sign[likeliest] * _engaged(lines)
    dims = ("curve", "region", "level")
    put(ds, "level", "level", CURVE, "setpoint")
    ds["curve_of"] = ("file", curve, {"long_name": "number of the file's curve"})
    said = "phase of the likeliest draw, 0 of the free lever, positive where repulsive"
    put(ds, "branch_phase", ("curve", "branch_side", "region", "level"), lines, said, "degree")
    ds["branch_side"] = ("branch_side", list(SIDES))
    for name, values in (("curve_contrast", own - own[:, :1]), ("curve_low", np.where(enough, low, np.nan)),
                         ("curve_high", np.where(enough, high, np.nan))):  # fmt: skip
        put(ds, name, dims, values, f"{name.replace('_', ' ')}, as recorded", "degree")
    ds["likeliest_sign"] = ((), int(sign[likeliest]), {"long_name": "sign of the likeliest draw"})


def _branches(problem: Problem, state: State, draw: int, amplitude: float) -> Array:
    """Phases of both branches [degree], shape (2, r, k), against the setpoint."""
    regions, points = len(problem.values), len(CURVE)
    at = np.full((2, regions * points), np.nan)
    logs = np.repeat(state.logs[draw], points, axis=0)
    model = problem.model.at_settings(np.full(regions * points, amplitude), np.tile(CURVE, regions))
    found = model.phases(logs, at, search=True)
    return np.degrees(found).reshape(2, regions, points)


def _engaged(both: Array) -> Array:
    """The branch that the tip meets first, from far: the attractive one, as far as it goes without a gap."""
    lower, upper = np.moveaxis(both, -3, 0)
    whole = np.logical_and.accumulate(~np.isnan(lower)[..., ::-1], axis=-1)[..., ::-1]
    engaged: Array = np.where(whole | np.isnan(upper), lower, upper)
    return engaged


def _add_pictures(ds: xr.Dataset, images: Sequence[xr.Dataset], labels: Sequence[Labels]) -> None:
    """Recorded phases and regions, every so many pixels."""
    for i, (image, mine) in enumerate(zip(images, labels, strict=True)):
        step = -(-max(mine.shape) // SMALL)
        dims = (f"y_{i}", f"x_{i}")
        put(ds, f"image_{i}", dims, image["phase"].values[::step, ::step], "recorded phase", "degree")
        ds[f"labels_{i}"] = (dims, mine[::step, ::step].astype(np.int8), {"long_name": "region, -1 where left out"})
        for dim, name in zip(dims, ("y", "x"), strict=True):
            if name in image.coords:
                ds[dim] = (dim, image[name].values[::step], {"units": "m"})
