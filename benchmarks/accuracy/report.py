"""What was measured, as Markdown."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.accuracy import cases
from benchmarks.accuracy.equation import Case
from benchmarks.accuracy.ranking import cheapest, compared, failures, period_time_at
from benchmarks.accuracy.record import NO_ORBIT, OTHER_ORBIT, PARAMETERS
from benchmarks.tables import markdown

if TYPE_CHECKING:
    import xarray as xr

LEVELS = ((0.01, 1e-12), (1e-4, 1e-14))
"""Errors at which methods are ranked [degree, m]: the default accuracy, and a hundredth of it."""
PERIOD_LEVEL = 1e-4  # [degree]
LISTED = 3  # failures spelled out for each method and regime

CAPTION = (
    "Time per distinct pixel on one core [µs], with the cheapest tolerance whose error against the reference is at "
    "most {phase:g}° and {height:g} pm on at least 95 % of the cases; — where no tolerance reaches that."
)
IMAGES = (
    "Whole images with three independent rough maps, every pixel another material, by `auto` on all cores ({threads}), "
    "on one, and the share of the cores that is used; errors are the largest on {checked} random pixels of each, "
    "against collocation."
)


CURVES = (
    "Curves of {points} values there and back, on one core, from the material to the Dataset, with both branches, "
    "folds and all exact orbits behind."
)
EXTRAS = (
    "What more than height, phase and energies costs: processor time of an image without and with it, on one core, of "
    "materials among which the tip is attracted and repelled."
)


def _images(ds: xr.Dataset) -> str:
    """The table of whole images."""
    heads = (
        "image", "pixels", "time [s]", "on one core [s]", "cores used", "interpolated", "phase error [degree]",
        "height error [pm]", "bounded by its estimate",
    )  # fmt: skip
    keys = ("image", "size", "time", "time_alone", "interpolated", "phase_error", "height_error", "bounded")
    lines = [
        [
            str(name), f"{size:.0f} x {size:.0f}", f"{time:.2g}", f"{alone:.2g}",
            f"{100 * alone / (time * ds.attrs['image_threads']):.0f} %", f"{100 * share:.4g} %", f"{phase:.1g}",
            f"{1e12 * height:.1g}", f"{100 * bounded:.4g} %",
        ]
        for name, size, time, alone, share, phase, height, bounded in _rows(ds, "image", keys)
    ]  # fmt: skip
    return markdown(heads, lines)


def _curves(ds: xr.Dataset) -> str:
    """The table of curves."""
    lines = [
        [str(name), f"{1e3 * time:.3g}", f"{orbits:.0f}", f"{folds:.0f}"]
        for name, time, orbits, folds in _rows(ds, "curve", ("curve", "time", "orbits", "folds"))
    ]
    return markdown(("curve", "time [ms]", "exact orbits", "folds"), lines)


def _extras(ds: xr.Dataset) -> str:
    """The table of images with more."""
    lines = [
        [str(name), f"{1e3 * plain:.3g}", f"{1e3 * extended:.3g}", f"{extended / plain:.3g}"]
        for name, plain, extended in _rows(ds, "extra", ("extra", "plain", "time"))
    ]
    return markdown(("image with", "time without it [ms]", "with it [ms]", "times as long"), lines)


def _rows(ds: xr.Dataset, what: str, names: tuple[str, ...]) -> Iterable[tuple[Any, ...]]:
    """Values of variables of images, curves or extras, one after the other."""
    return zip(*(ds[name if name == what else f"{what}_{name}"].values for name in names), strict=True)


def table(ds: xr.Dataset) -> str:
    """Rank the methods at equal error, then give each tolerance's time, errors and failures.

    `ds`: of `benchmarks.accuracy.bench`.
    Returns Markdown.
    """
    parts = []
    for phase, height in LEVELS:
        parts += [CAPTION.format(phase=phase, height=height * 1e12), _ranking(ds, phase, height)]
    if "image" in ds.dims:
        parts += [IMAGES.format(threads=ds.attrs["image_threads"], checked=ds.attrs["image_checked"]), _images(ds)]
    if "curve" in ds.dims:
        parts += [CURVES.format(points=ds.attrs["curve_points"]), _curves(ds)]
    if "extra" in ds.dims:
        parts += [EXTRAS, _extras(ds)]
    parts += ["<details><summary>Every tolerance: time, errors and failures</summary>"]
    parts += [
        "Time per distinct pixel on one core [µs], time of compilation [s], and failures of all cases.",
        _times(ds),
    ]
    parts += [
        "Error of the phase against the reference [degree]: median / 99th percentile / largest.",
        _errors(ds, "phase_error", 1.0),
        "Error of the height against the reference [pm]: median / 99th percentile / largest.",
        _errors(ds, "height_error", 1e12),
    ]
    periods = period_time_at(ds, PERIOD_LEVEL)
    if periods:
        parts += [
            f"Time per period of the oscillation on one core [µs] where the median error is {PERIOD_LEVEL:g}°.",
            _grid(ds, {name: [_short(1e6 * t) for t in row] for name, row in periods.items()}),
        ]
    parts += ["</details>", _conditions(ds)]
    return "\n\n".join(parts)


def listing(ds: xr.Dataset) -> str:
    """Say which references were not found, and which cases each method failed on, with their parameters.

    `ds`: of `benchmarks.accuracy.bench`.
    Returns one line each, three at most for a method and regime; empty if nothing failed.
    """
    lines = []
    for r, regime in enumerate(ds["regime"].values):
        for outcome in range(1, len(cases.OUTCOMES)):
            missing = np.flatnonzero(ds["reference"].values[r] == outcome)
            for c in missing[:LISTED]:
                lines.append(f"{regime}, case {c}: {cases.OUTCOMES_IN_WORDS[outcome]}; {_case(ds, r, c).in_words()}")
            if len(missing) > LISTED:
                lines.append(f"{regime}: {len(missing) - LISTED} more of these")
        for m, method in enumerate(ds["solver"].values):
            result, error = ds["result"].values[r, m], ds["phase_error"].values[r, m]
            failed = np.flatnonzero((result == NO_ORBIT) | (result == OTHER_ORBIT))
            for c in failed[:LISTED]:
                said = "no orbit" if result[c] == NO_ORBIT else f"phase off by {error[c]:.3g}°"
                lines.append(f"{method}, {regime}, case {c}: {said}; {_case(ds, r, c).in_words()}")
            if len(failed) > LISTED:
                lines.append(f"{method}, {regime}: {len(failed) - LISTED} more")
    return "\n".join(lines)


def _case(ds: xr.Dataset, r: int, c: int) -> Case:
    numbers: dict[str, Any] = {name: float(ds[name].values[r, c]) for name in PARAMETERS}
    if not np.isfinite(numbers["decay_length"]):
        numbers["decay_length"] = None
    return Case(**numbers)


def _ranking(ds: xr.Dataset, phase: float, height: float) -> str:
    rows, times = {}, {}
    for family, found in cheapest(ds, phase, height).items():
        times[family] = [time for time, _ in found]
        rows[family] = [f"{_short(1e6 * time)} {_setting(label, family)}".strip() for time, label in found]
    for r, regime in enumerate(zip(*times.values(), strict=True)):  # the fastest in bold
        if np.isfinite(regime).any():
            best = list(rows)[int(np.nanargmin(regime))]
            rows[best][r] = f"**{rows[best][r]}**"
    return _grid(ds, rows)


def _setting(label: str, family: str) -> str:
    setting = label.removeprefix(family).strip()
    return f"({setting})" if setting else ""


def _times(ds: xr.Dataset) -> str:
    failed, ran = failures(ds).sum("regime").values, compared(ds).sum(("regime", "case")).values
    rows = {}
    for m, method in enumerate(ds["solver"].values):
        compiled = float(ds["compile_time"].values[m])
        times = [_short(1e6 * t) for t in ds["time"].values[:, m]]
        rows[str(method)] = [*times, _short(compiled), f"{failed[m]} of {ran[m]}"]
    return _grid(ds, rows, "compile [s]", "failed")


def _errors(ds: xr.Dataset, name: str, factor: float) -> str:
    rows = {}
    for m, method in enumerate(ds["solver"].values):
        cells = []
        for values in abs(ds[name].values[:, m]) * factor:
            known = values[np.isfinite(values)]
            numbers = [np.median(known), np.percentile(known, 99), known.max()] if known.size else []
            cells.append(" / ".join(_short(x, 2) for x in numbers) or "—")
        rows[str(method)] = cells
    return _grid(ds, rows)


def _grid(ds: xr.Dataset, rows: dict[str, list[str]], *more: str) -> str:
    """One line for each entry, one column for each regime and for what else there is."""
    heads = ["solver", *map(str, ds["regime"].values), *more]
    return markdown(heads, ([name, *cells] for name, cells in rows.items()))


def _short(x: float, digits: int = 3) -> str:
    """Few digits, and powers of ten only where they help.

    Examples
    --------
    >>> _short(34567.0), _short(0.0123456, 2), _short(1.23e-7, 2), _short(float("nan"))
    ('34600', '0.012', '1.2e-7', '—')
    """
    if not np.isfinite(x):
        return "—"
    if 1e-3 <= abs(x) < 1e9:
        return f"{float(f'{x:.{digits}g}'):.12g}"
    mantissa, _, exponent = f"{x:.{digits - 1}e}".partition("e")
    return mantissa if int(exponent) == 0 else f"{mantissa}e{int(exponent)}"


def _conditions(ds: xr.Dataset) -> str:
    """What is needed to understand, judge and repeat it."""
    found = int((ds["reference"] == cases.FOUND).sum())
    uncertain = float(ds["reference_phase_uncertainty"].max()), 1e12 * float(ds["reference_height_uncertainty"].max())
    held, stated = _bounds_held(ds)
    said = [
        f"Seed {ds.attrs['seed']}; {ds.attrs['machine']}; {ds.attrs['versions']}; took {ds.attrs['seconds']:.0f} s.",
        f"Errors are against {found} of {ds['reference'].size} reference orbits (shooting with scipy's DOP853, contact "
        f"located; own error at most {uncertain[0]:.0e}° and {uncertain[1]:.0e} pm).",
        f"Times of phasemap's solvers are means over {ds.attrs['timed_pixels']} distinct pixels a regime and include "
        "finding the branch.",
        "Peers are given branch and averaged start, and use the same Newton shooting around their integrator"
        + (f"; not installed: {ds.attrs['not_installed']}." if ds.attrs["not_installed"] else "."),
        f"Compilation: {ds.attrs['compilation']}.",
    ]
    if stated:
        said.append(f"Where a solver states an error, it bounds the true one on {held} of {stated} pixels.")
    return " ".join(said)


def _bounds_held(ds: xr.Dataset) -> tuple[int, int]:
    """On how many pixels the stated errors bound the true ones, and how many have them stated."""
    stated = np.isfinite(ds["phase_bound"]) & np.isfinite(ds["phase_error"])
    # The reference is not exact either.
    slack = ds["reference_phase_uncertainty"], ds["reference_height_uncertainty"]
    held = stated & (abs(ds["phase_error"]) <= ds["phase_bound"] + slack[0])
    held &= abs(ds["height_error"]) <= ds["height_bound"] + slack[1]
    return int(held.sum()), int(stated.sum())
