"""Picture of a fit by regions: where they are, what was measured and fitted, and the materials with their errors."""

from __future__ import annotations

import os

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from phasemap._shared.asked import asked_as
from phasemap.plot.colours import MARKERS, PALETTE, STYLES, SURE
from phasemap.plot.figure import draw_scale_bar, round_numbers, side_lengths
from phasemap.plot.page import Page

SHOWN = {"modulus": ("modulus (GPa)", 1e-9), "adhesion": ("adhesion (J/m²)", 1.0), "damping": ("damping α₁", 1.0)}

# Sizes on the page [inch].
SIDE, GAP, LEFT, MARGIN, TITLE, AXIS, SMALL = 2.6, 0.75, 0.6, 0.35, 0.3, 0.6, 1.9


@asked_as()
def regions(ds: xr.Dataset, path: str | os.PathLike[str] | None = None, overwrite: bool = False) -> Figure:
    """Draw `phasemap.fit_regions`: map, data beside the fit, and materials with intervals of 95 %.

    Open symbols are properties that the data do not determine, squares those that were given.
    """
    lines = [line for word in ("verdict", "advice") for line in str(ds.attrs.get(word, "")).splitlines()]
    curves = [name for name in ("phase", "height") if f"measured_{name}" in ds]
    title = f"{ds.sizes['region']} regions in {ds.sizes['image']} images   ·   95 % intervals (zeros uncertain)"
    page = Page(LEFT + 3 * SIDE + 2 * GAP + MARGIN, 2 * (TITLE + AXIS) + SIDE + SMALL, [title], notes=lines, left=LEFT)
    _draw_map(page.picture(LEFT, TITLE, SIDE, SIDE, "regions"), ds)
    for column, name in enumerate(curves, 1):
        factor, unit = (1.0, "degrees") if name == "phase" else (1e9, "nm")
        said = f"{'phase relative to its zero' if name == 'phase' else 'height relative to its zeros'} ({unit})"
        _draw_curves(page.panel(LEFT + column * (SIDE + GAP), TITLE, SIDE, SIDE, said), ds, name, factor)
    for column, (name, (label, factor)) in enumerate(SHOWN.items()):
        top = TITLE + SIDE + AXIS + TITLE
        _draw_property(page.panel(LEFT + column * (SIDE + GAP), top, SIDE, SMALL, label), ds, name, factor)
    return page.finished(path, overwrite)


def _draw_map(axes: Axes, ds: xr.Dataset) -> None:
    """Where the regions are, in their colours."""
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
    axes.set_facecolor("0.85")
    if placed:
        draw_scale_bar(axes)


def _draw_curves(axes: Axes, ds: xr.Dataset, name: str, factor: float) -> None:
    """Medians of the regions with their errors, over the setpoint, and the fit."""
    amplitudes = np.unique(ds["free_amplitude"].values)
    for i in range(ds.sizes["region"]):
        color = PALETTE[i % len(PALETTE)]
        for k, amplitude in enumerate(amplitudes):
            some = np.flatnonzero(ds["free_amplitude"].values == amplitude)
            some = some[np.argsort(ds["setpoint"].values[some])]
            at = ds["setpoint"].values[some]
            fitted, measured, error = (
                factor * ds[word][i].values[some] for word in (f"fitted_{name}", f"measured_{name}", f"{name}_error")
            )
            axes.plot(at, fitted, "_" + STYLES[k % len(STYLES)], color=color, linewidth=1.2, markersize=14)
            axes.errorbar(
                at, measured, SURE * error, fmt=MARKERS[k % len(MARKERS)], color=color, markersize=4.5, capsize=2,
                linewidth=1,
            )  # fmt: skip
    if name == "phase":
        for k, amplitude in enumerate(amplitudes):
            style = MARKERS[k % len(MARKERS)] + STYLES[k % len(STYLES)]
            axes.plot([], [], style, color="0.3", markersize=4.5, linewidth=1.2, label=f"{amplitude * 1e9:.4g} nm")
        axes.legend(title="free amplitude", fontsize=8, title_fontsize=8, frameon=False)
    axes.set_xlabel("setpoint", fontsize=9)


def _draw_property(axes: Axes, ds: xr.Dataset, name: str, factor: float) -> None:
    """One property of all regions, on a logarithmic scale."""
    words = ds["determination"].attrs["flag_meanings"].split()
    for i in range(ds.sizes["region"]):
        value, error = factor * float(ds[name][i]), SURE * float(ds[f"{name}_error"][i])
        word = words[int(ds["determination"].sel(property=name)[i])]
        color = PALETTE[i % len(PALETTE)]
        face = color if word in ("determined", "given") else "white"
        ends = [[value * -np.expm1(-error)], [value * np.expm1(error)]]
        axes.errorbar(
            [i], [value], ends, fmt="s" if word == "given" else "o", color=color, markerfacecolor=face, markersize=6,
            capsize=3, linewidth=1.2,
        )  # fmt: skip
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
