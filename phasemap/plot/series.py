"""A series on one page: contrast against setpoint, both branches of every region, and the images side by side."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from phasemap._shared.arrays import within_half_a_turn
from phasemap._shared.asked import asked_as
from phasemap._shared.errors import InputError
from phasemap.plot.colours import BARS, IN_NO_REGION, MARKERS, NO_REGION, PALETTE, STYLES, SURE
from phasemap.plot.page import Page, draw_scale_bar
from phasemap.results.descriptions import of_file

MOST = 6  # files that are shown
COLOURED = (2, 98)  # percentiles of an image between which colours differ
SPARE = 0.08  # of the range of contrasts, above and below it
WIDTH, TALL = 11.0, 2.6  # of the page, of curves [inch]
TITLE, TITLES, AXIS, GAP, LEFT, MARGIN = 0.35, 0.5, 0.55, 0.75, 0.65, 0.25  # titles of images have three lines
BAR = 0.55  # of an image's width, beside its column of images


def is_series(ds: xr.Dataset) -> bool:
    """True if a Dataset is what `phasemap.series` returned."""
    return "branch_phase" in ds


@asked_as()
def series(ds: xr.Dataset, path: str | os.PathLike[str] | None = None, overwrite: bool = False) -> Figure:
    """Draw a series: contrasts, branches, images as recorded and as fitted, and the verdict.

    Parameters
    ----------
    ds : xarray.Dataset
        What `phasemap.series` returned.
    path, overwrite
        As in `phasemap.plot.plot`.
    """
    if not is_series(ds):
        raise InputError("the series", sorted(map(str, ds.data_vars))[:3], "what phasemap.series returned")
    count = ds.sizes["file"]
    shown = sorted(set(np.linspace(0, count - 1, min(count, MOST)).round().astype(int).tolist()))
    columns = len(shown)
    wide = min((WIDTH - LEFT - MARGIN - BAR - 0.1 * columns) / columns, 2.2)
    tall = wide * max(_shape(ds, i) for i in shown)
    body = TITLE + TALL + AXIS + TITLES + 2 * tall + 0.1 + 0.1
    left_out = [IN_NO_REGION] * any((ds[f"labels_{i}"].values < 0).any() for i in shown)
    page = Page(WIDTH, body, notes=[*str(ds.attrs["verdict"]).splitlines(), *left_out], left=LEFT)
    half = (WIDTH - LEFT - MARGIN - GAP) / 2
    _draw_contrasts(page.place(LEFT, TITLE, half, TALL), ds)
    _draw_branches(page.place(LEFT + half + GAP, TITLE, half, TALL), ds)
    top, norm = TITLE + TALL + AXIS + TITLES, Normalize(*_colours(ds, shown))
    for column, i in enumerate(shown):
        left = LEFT + column * (wide + 0.1)
        panels = [page.place(left, top + row * (tall + 0.1), wide, tall) for row in (0, 1)]
        drawn = _draw_pair(panels, ds, i, norm)
        panels[0].set_title(_title(ds, i, wide), fontsize=8, loc="left")
        if column == 0:
            for panel, word in zip(panels, ("measured", "simulated"), strict=True):
                panel.set_ylabel(word, fontsize=9)
    page.bar(drawn, panels, "phase relative to region 0 (degrees)")
    return page.finished(path, overwrite)


def _shape(ds: xr.Dataset, i: int) -> float:
    """Height over width of a file."""
    sides = [float(np.ptp(ds[f"{dim}_{i}"].values)) if f"{dim}_{i}" in ds.coords or f"{dim}_{i}" in ds else 0.0
             for dim in ("y", "x")]  # fmt: skip
    rows, columns = ds[f"image_{i}"].shape
    return min(max(sides[0] / sides[1] if all(sides) else rows / columns, 0.25), 1.5)


def _title(ds: xr.Dataset, i: int, wide: float) -> str:
    """File, cut in the middle to fit, with its setpoint and free amplitude."""
    name = str(ds["file"].values[i])
    most = int(14 * wide)
    short = name if len(name) <= most else f"{name[: most // 2 - 1]}…{name[-(most // 2) :]}"
    level, size = of_file(ds, "setpoint", i), of_file(ds, "free_amplitude", i, 1e9)
    return f"{short}\nsetpoint {level}\nA₀ {size} nm"


def _draw_contrasts(axes: Axes, ds: xr.Dataset) -> None:
    """Contrast against setpoint: measured with its error, fitted, and what the fit says between."""
    level, curve_of = ds["level"].values, ds["curve_of"].values
    for region in range(1, ds.sizes["region"]):
        color = PALETTE[region % len(PALETTE)]
        for curve in range(ds.sizes["curve"]):
            low, high = (ds[name].values[curve, region] for name in ("curve_low", "curve_high"))
            axes.fill_between(level, low, high, color=color, alpha=0.12, linewidth=0)
            likeliest = ds["curve_contrast"].values[curve, region]
            axes.plot(level, likeliest, color=color, linewidth=1.2, linestyle=STYLES[curve % len(STYLES)])
            files = np.flatnonzero(curve_of == curve)
            at = ds["setpoint"].values[files]
            measured, error = (ds[name].values[region, files] for name in ("measured_contrast", "contrast_error"))
            ends = np.abs(np.stack([ds["setpoint_low"].values[files], ds["setpoint_high"].values[files]]) - at)
            size = of_file(ds, "free_amplitude", int(files[0]), 1e9)
            label = f"region {region}" + (f", {size} nm" if ds.sizes["curve"] > 1 else "")
            marker, label = MARKERS[curve % len(MARKERS)], f"{label}, measured (95 %)"
            axes.errorbar(at, measured, SURE * error, ends, fmt=marker, color=color, markersize=5, label=label, **BARS)
            axes.plot(at, ds["fitted_contrast"].values[region, files], "_", color="0.2", markersize=13)
    axes.axhline(0, color="0.6", linewidth=0.8)
    axes.plot([], [], "_", color="0.2", markersize=11, label="simulated, median of the draws")
    axes.plot([], [], color="0.5", linewidth=1.2, label="most likely; shade: 95 % of the draws")
    axes.set_title("contrast relative to region 0, as recorded (degrees)", fontsize=10, loc="left")
    axes.set_ylim(*_range_of_contrasts(ds))
    _finish(axes, ds)


def _range_of_contrasts(ds: xr.Dataset) -> tuple[float, float]:
    """Range from the least to the largest contrast, measured or likeliest; the shade may go beyond."""
    measured, error = ds["measured_contrast"].values[1:], SURE * ds["contrast_error"].values[1:]
    fitted, curve = ds["fitted_contrast"].values[1:], ds["curve_contrast"].values[:, 1:]
    every = [0.0, *(np.asarray(one)[np.isfinite(one)] for one in (measured - error, measured + error, fitted, curve))]
    low, high = (float(end(np.hstack(every))) for end in (np.min, np.max))
    return low - SPARE * (high - low), high + SPARE * (high - low)


def _draw_branches(axes: Axes, ds: xr.Dataset) -> None:
    """Draw both branches of every region, and the setpoint of each file."""
    level, sign = ds["level"].values, int(ds["likeliest_sign"])
    for region in range(ds.sizes["region"]):
        color = PALETTE[region % len(PALETTE)]
        for curve in range(ds.sizes["curve"]):
            style = STYLES[curve % len(STYLES)]
            for branch in range(2):
                phase = ds["branch_phase"].values[curve, branch, region]
                label = f"region {region}" if branch == 1 and curve == 0 else None
                axes.plot(level, phase, style, color=color, linewidth=1.6 if branch else 0.9, label=label)
        zeroed = sign * within_half_a_turn(ds["phase"].values[region] - ds["likeliest_zero"].values)
        axes.plot(ds["likeliest_setpoint"], zeroed, "o", color=color, markersize=4, markerfacecolor="white")
    axes.axhline(0, color="0.6", linewidth=0.8)
    axes.plot([], [], "o", color="0.3", markersize=4, markerfacecolor="white", label="files, with the fitted zero")
    axes.set_title("most likely phases (degrees): bold repulsive, thin attractive", fontsize=10, loc="left")
    axes.set_ylabel("positive where repulsive", fontsize=8)
    _finish(axes, ds)


def _finish(axes: Axes, ds: xr.Dataset) -> None:
    """Label the setpoint axis, and add the legend."""
    axes.set_xlabel("setpoint", fontsize=9)
    axes.set_xlim(max(0.15, float(ds["setpoint_low"].min()) - 0.1), 1.0)
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(fontsize=7, frameon=False)


def _recorded(ds: xr.Dataset, i: int) -> Any:
    """Phases of a file less that of region 0, rows aligned by their regions."""
    image, labels = ds[f"image_{i}"].values, ds[f"labels_{i}"].values
    levels = ds["phase"].values[:, i]
    inside = (labels >= 0) & np.isfinite(image)
    apart = np.where(inside, image - np.nan_to_num(levels)[np.maximum(labels, 0)], np.nan)
    rows = np.array([np.median(row[np.isfinite(row)]) if np.isfinite(row).any() else 0.0 for row in apart])
    return within_half_a_turn(image - rows[:, None] - levels[0])


def _colours(ds: xr.Dataset, shown: list[int]) -> tuple[float, float]:
    """Ends of the colours of all images: nearly all that was recorded, and every contrast."""
    contrasts = ds["measured_contrast"].values[:, shown].ravel()
    every = np.hstack([contrasts, *(np.nanpercentile(_recorded(ds, i), COLOURED) for i in shown)])
    return float(np.nanmin(every)), float(np.nanmax(every))


def _draw_pair(panels: list[Axes], ds: xr.Dataset, i: int, norm: Normalize) -> Any:
    """A file as recorded, rows aligned by their regions, and its regions with the fitted contrast."""
    image, labels = _recorded(ds, i), ds[f"labels_{i}"].values
    fitted = np.where(labels >= 0, ds["fitted_contrast"].values[np.maximum(labels, 0), i], np.nan)
    tall = _shape(ds, i)
    drawn: Any = None
    known = f"x_{i}" in ds.variables
    width = float(np.ptp(ds[f"x_{i}"].values)) * image.shape[1] / (image.shape[1] - 1) if known else 1.0
    for panel, values in zip(panels, (image, fitted), strict=True):
        drawn = panel.imshow(
            values, cmap="cividis", norm=norm, extent=(0, width, tall * width, 0),
            interpolation="nearest", aspect="auto",
        )  # fmt: skip
        panel.set(xticks=[], yticks=[])
        panel.set_facecolor(NO_REGION)
    if known:
        draw_scale_bar(panels[0])
    return drawn
