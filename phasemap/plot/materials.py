"""Pictures of an inversion, of materials and how far to believe them: maps by pixel, and a fit by regions."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure

from phasemap._shared.asked import asked_as
from phasemap._shared.errors import InputError
from phasemap.plot.colours import BARS, FAILED, IN_NO_REGION, MAPS, MARKERS, NO_REGION, PALETTE, STYLES, SURE
from phasemap.plot.page import Page, draw_scale_bar, round_numbers, side_lengths

SHOWN = {"modulus": ("modulus (GPa)", 1e-9), "adhesion": ("adhesion (J/m²)", 1.0), "damping": ("damping α₁", 1.0)}

# Sizes on the page [inch].
SIDE, GAP, LEFT, MARGIN, TITLE, AXIS, SMALL = 2.6, 0.75, 0.6, 0.35, 0.3, 0.6, 1.9


@asked_as()
def regions(ds: xr.Dataset, path: str | os.PathLike[str] | None = None, overwrite: bool = False) -> Figure:
    """Draw `phasemap.fit_regions`: map, data beside the fit, and materials with intervals of 95 %.

    Open symbols are properties that the data do not determine, squares those that were given.
    """
    lines = [line for word in ("verdict", "advice") for line in str(ds.attrs.get(word, "")).splitlines()]
    lines += [IN_NO_REGION] * bool((~np.isin(ds["label"].values, ds["region"].values)).any())
    curves = [name for name in ("phase", "height") if f"measured_{name}" in ds]
    title = f"{ds.sizes['region']} regions in {ds.sizes['image']} images   ·   95 % intervals (zeros uncertain)"
    page = Page(LEFT + 3 * SIDE + 2 * GAP + MARGIN, 2 * (TITLE + AXIS) + SIDE + SMALL, [title], notes=lines, left=LEFT)
    _draw_map(page.picture(LEFT, TITLE, SIDE, SIDE, "regions"), ds)
    for column, name in enumerate(curves, 1):
        factor, unit = (1.0, "degrees") if name == "phase" else (1e9, "nm")
        heading = f"{'phase relative to its zero' if name == 'phase' else 'height relative to its zeros'} ({unit})"
        _draw_curves(page.panel(LEFT + column * (SIDE + GAP), TITLE, SIDE, SIDE, heading), ds, name, factor)
    for column, (name, (label, factor)) in enumerate(SHOWN.items()):
        top = TITLE + SIDE + AXIS + TITLE
        _draw_property(page.panel(LEFT + column * (SIDE + GAP), top, SIDE, SMALL, label), ds, name, factor)
    return page.finished(path, overwrite)


def _draw_map(axes: Axes, ds: xr.Dataset) -> None:
    """Draw the regions in their colours."""
    labels = ds["label"].values
    shown = np.full(labels.shape, np.nan)
    for i, name in enumerate(ds["region"].values):
        shown[labels == name] = i % len(PALETTE)
    rows, columns = labels.shape
    placed = {"y", "x"} <= set(ds.coords)
    wide, tall = side_lengths(ds) if placed else (float(columns), float(rows))
    axes.imshow(
        shown, cmap=ListedColormap(PALETTE), vmin=-0.5, vmax=len(PALETTE) - 0.5, extent=(0, wide, tall, 0),
        interpolation="nearest",
    )  # fmt: skip
    axes.set_facecolor(NO_REGION)
    if placed:
        draw_scale_bar(axes)


def _draw_curves(axes: Axes, ds: xr.Dataset, name: str, factor: float) -> None:
    """Draw the medians of the regions with their errors, over the setpoint, and the fit."""
    amplitudes = np.unique(ds["free_amplitude"].values)
    for i in range(ds.sizes["region"]):
        color = PALETTE[i % len(PALETTE)]
        for k, amplitude in enumerate(amplitudes):
            images = np.flatnonzero(ds["free_amplitude"].values == amplitude)
            images = images[np.argsort(ds["setpoint"].values[images])]
            at = ds["setpoint"].values[images]
            fitted, measured, error = (
                factor * ds[word][i].values[images] for word in (f"fitted_{name}", f"measured_{name}", f"{name}_error")
            )
            axes.plot(at, fitted, "_" + STYLES[k % len(STYLES)], color=color, linewidth=1.2, markersize=14)
            marker = MARKERS[k % len(MARKERS)]
            axes.errorbar(at, measured, SURE * error, fmt=marker, color=color, markersize=4.5, **BARS)
    if name == "phase":
        for k, amplitude in enumerate(amplitudes):
            style = MARKERS[k % len(MARKERS)] + STYLES[k % len(STYLES)]
            axes.plot([], [], style, color="0.3", markersize=4.5, linewidth=1.2, label=f"{amplitude * 1e9:.4g} nm")
        axes.legend(title="free amplitude", fontsize=8, title_fontsize=8, frameon=False)
    axes.set_xlabel("setpoint", fontsize=9)


def _draw_property(axes: Axes, ds: xr.Dataset, name: str, factor: float) -> None:
    """Draw one property of all regions, on a logarithmic scale."""
    words = ds["determination"].attrs["flag_meanings"].split()
    for i in range(ds.sizes["region"]):
        value, error = factor * float(ds[name][i]), SURE * float(ds[f"{name}_error"][i])
        word = words[int(ds["determination"].sel(property=name)[i])]
        color = PALETTE[i % len(PALETTE)]
        face = color if word in ("determined", "given") else "white"
        ends = [[value * -np.expm1(-error)], [value * np.expm1(error)]]
        fmt = "s" if word == "given" else "o"
        look: dict[str, Any] = {"color": color, "markerfacecolor": face, "markersize": 6, "capsize": 3}
        axes.errorbar([i], [value], ends, fmt=fmt, linewidth=1.2, **look)
    axes.set_yscale("log")
    low, high = axes.get_ylim()
    if high < 20 * low:
        middle = np.sqrt(low * high)
        axes.set_ylim(min(low, middle / 3.3), max(high, middle * 3.3))
    low, high = axes.get_ylim()
    round_numbers(axes.yaxis, (1.0,) if high > 100 * low else (1.0, 2.0, 5.0))
    axes.set(xlim=(-0.6, ds.sizes["region"] - 0.4), xticks=range(ds.sizes["region"]))
    axes.set_xticklabels([str(one) for one in ds["region"].values])
    axes.set_xlabel("region", fontsize=9)


LIMITS = (1, 99)  # percentiles shown
UNSURE = "0.85"
WORST = 0.5  # standard error of a logarithm at the end of the scale

# Sizes on the page [inch].
WIDE, STEP, EDGE, BELOW = 2.5, 3.37, 0.25, 0.12


@asked_as()
def inversion(ds: xr.Dataset, path: str | os.PathLike[str] | None = None, overwrite: bool = False) -> Figure:
    """Draw the maps of an inversion above, on logarithmic scales, and their standard errors below.

    The errors are those of the natural logarithm: 0.1 is 10 %. Where the data do not determine a property, or the model
    does not describe them, the map is grey and hatched; pixels without a solution are green. Lines below say how many.
    A fit by regions is drawn as `regions` says.

    Parameters
    ----------
    ds : xarray.Dataset
        What `phasemap.invert` or `phasemap.fit_regions` returned.
    path, overwrite
        As in `phasemap.plot.plot`.
    """
    if not is_inversion(ds):
        raise InputError("the dataset", sorted(map(str, ds.data_vars)), "what phasemap.invert returned")
    if "region" in ds["flag"].dims:
        return regions(ds, path, overwrite)
    rows, columns = ds["flag"].shape
    measured = "x" in ds.coords and "y" in ds.coords
    wide, high_up = side_lengths(ds) if measured else (float(columns), float(rows))
    extent = 0.0, wide, high_up, 0.0
    tall = WIDE * min(max(high_up / wide, 0.2), 2.0)
    title = f"inversion of {ds.sizes.get('image', 0)} images   ·   {columns} × {rows} pixels"
    meanings = str(ds["flag"].attrs.get("flag_meanings", "")).split()
    masks = dict(zip(meanings, 1 << np.arange(8), strict=False))
    flags = ds["flag"].values.astype(int)
    lost = flags & (masks.get("no_orbit", 0) | masks.get("no_data", 0)) != 0
    unsure = {name: flags & (masks.get(f"{name}_not_determined", 0) | masks.get("poor_fit", 0)) != 0 for name in SHOWN}
    marks = ["grey, hatched: not determined, or poor fit"] * any((one & ~lost).any() for one in unsure.values())
    marks += ["green: no solution"] * bool(lost.any())
    notes = [str(ds.attrs.get("verdict", "")), *(["    ".join(marks)] if marks else [])]
    page = Page(EDGE + 3 * STEP, 2 * (TITLE + tall) + BELOW, [title], notes=notes)
    for i, (name, (label, factor)) in enumerate(SHOWN.items()):
        hatched = unsure[name]
        values = factor * ds[name].values
        sure = values[np.isfinite(values) & ~hatched]
        sure = sure if sure.size else values[np.isfinite(values)]
        low, high = np.percentile(sure, LIMITS) if sure.size else (1.0, 10.0)
        for row, (shown, norm, cmap, head) in enumerate((
            (np.where(hatched | lost, np.nan, values), LogNorm(low / 1.05, high * 1.05), MAPS[name], label),
            (ds[f"{name}_error"].values, Normalize(0, WORST), MAPS["error"], "standard error of its logarithm"),
        )):  # fmt: skip
            axes = page.picture(EDGE + i * STEP, TITLE + row * (TITLE + tall), WIDE, tall, head)
            axes.title.set_fontsize(10 - row)
            image = axes.imshow(shown, cmap=cmap, norm=norm, extent=extent, aspect="auto", interpolation="nearest")
            _mark(axes, hatched & ~lost & (row == 0), lost, extent)
            if measured and i == row == 0:
                draw_scale_bar(axes)
            bar = page.bar(image, [axes])
            if row == 0:
                round_numbers(bar.ax.yaxis, (1.0,) if high > 18 * low else (1.0, 2.0, 5.0))
                bar.ax.minorticks_off()
    return page.finished(path, overwrite)


def is_inversion(ds: xr.Dataset) -> bool:
    """True if a Dataset is of an inversion, by pixels or by regions."""
    return (
        all(f"{name}_error" in ds for name in SHOWN) and "flag" in ds and ds["flag"].dims in (("y", "x"), ("region",))
    )


def _mark(axes: Axes, hatched: np.ndarray, lost: np.ndarray, extent: tuple[float, float, float, float]) -> None:
    """Mark one set of pixels grey and hatched, and another green."""
    for pixels, color in ((hatched, UNSURE), (lost, FAILED)):
        if pixels.any():
            overlay = np.ma.masked_where(~pixels, np.ones(pixels.shape))
            axes.imshow(overlay, cmap=ListedColormap([color]), extent=extent, aspect="auto", interpolation="nearest")
    if hatched.any():
        padded = np.pad(hatched.astype(float), 1, mode="edge")
        y, x = (
            (np.arange(-1, count + 1) + 0.5) * side / count
            for count, side in zip(hatched.shape, (extent[2], extent[1]), strict=True)
        )
        areas = axes.contourf(x, y, padded, levels=[0.5, 1.5], colors="none", hatches=["////////"])
        areas.set_edgecolor("0.6")
        areas.set_linewidth(0)
    axes.set(xticks=[], yticks=[], xlim=extent[:2], ylim=extent[2:])
