"""Picture of a fit by regions: where they are, what was measured and fitted, and the materials with their errors."""

from __future__ import annotations

import os
import textwrap
from typing import TYPE_CHECKING

import numpy as np

from phasemap.plot.figure import draw_scale_bar, save

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["regions"]

SHOWN = {"modulus": ("modulus (GPa)", 1e-9), "adhesion": ("adhesion (J/m²)", 1.0), "damping": ("damping α₁", 1.0)}
COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")  # of Okabe and Ito
SURE = 1.96  # standard errors, to either side
STYLES = ("-", "--", ":", "-.")  # of free amplitudes
MARKERS = ("o", "s", "^", "D")
LETTERS = 118  # in a line below

# Sizes on the page [inch].
SIDE, GAP, LEFT, MARGIN, TITLE, HEADER, AXIS, SMALL, LINE = 2.6, 0.75, 0.6, 0.35, 0.3, 0.35, 0.6, 1.9, 0.17


def regions(ds: xr.Dataset, path: str | os.PathLike[str] | None = None, overwrite: bool = False) -> Figure:
    """Draw a fit by regions: map, data beside the fit, and materials with intervals of 95 %.

    Open symbols are properties that the data do not determine, squares those that were given.

    Parameters
    ----------
    ds : xarray.Dataset
        What `phasemap.fit_regions` returned.
    path, overwrite
        As of `phasemap.plot.inversion`.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If the format is unknown.
    FileError
        If `path` cannot be written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    lines = [
        piece
        for word in ("verdict", "advice")
        for line in str(ds.attrs.get(word, "")).splitlines()
        for piece in textwrap.wrap(line, LETTERS, subsequent_indent="   ")
    ]
    curves = [name for name in ("phase", "height") if f"measured_{name}" in ds]
    width = LEFT + 3 * SIDE + 2 * GAP + MARGIN
    height = HEADER + TITLE + SIDE + AXIS + TITLE + SMALL + AXIS + LINE * (len(lines) + 1)
    figure = Figure(figsize=(width, height))
    canvas = FigureCanvasAgg(figure)

    def axes_at(column: int, top: float, tall: float) -> Axes:
        left = LEFT + column * (SIDE + GAP)
        return figure.add_axes((left / width, 1 - (top + tall) / height, SIDE / width, tall / height))

    top = HEADER + TITLE
    _draw_map(axes_at(0, top, SIDE), ds)
    for column, name in enumerate(curves, 1):
        _draw_curves(axes_at(column, top, SIDE), ds, name)
    top += SIDE + AXIS + TITLE
    for column, (name, (label, factor)) in enumerate(SHOWN.items()):
        _draw_property(axes_at(column, top, SMALL), ds, name, label, factor)
    title = f"{ds.sizes['region']} regions in {ds.sizes['image']} images   ·   intervals of 95 %, zeros left open"
    figure.text(LEFT / width, 1 - 0.12 / height, title, fontsize=9, color="0.3", va="top")
    figure.text(LEFT / width, 0.5 * LINE / height, "\n".join(lines), fontsize=8, va="bottom", linespacing=1.4)
    if path is not None:
        save(canvas, path, overwrite)
    return figure


def _draw_map(axes: Axes, ds: xr.Dataset) -> None:
    """Where the regions are, in their colours."""
    from matplotlib.colors import ListedColormap

    labels = ds["label"].values
    shown = np.full(labels.shape, np.nan)
    for i, name in enumerate(ds["region"].values):
        shown[labels == name] = i % len(COLORS)
    rows, columns = labels.shape
    pitch = [float(ds[dim][1] - ds[dim][0]) if dim in ds.coords and ds.sizes[dim] > 1 else 0.0 for dim in ("y", "x")]
    tall, wide = (count * (size or 1.0) for count, size in zip((rows, columns), pitch, strict=True))
    axes.imshow(
        shown, cmap=ListedColormap(COLORS), vmin=-0.5, vmax=len(COLORS) - 0.5, extent=(0, wide, tall, 0),
        interpolation="nearest",
    )  # fmt: skip
    axes.set(xticks=[], yticks=[])
    axes.set_facecolor("0.85")
    axes.set_title("regions", fontsize=10, loc="left")
    if all(pitch):
        draw_scale_bar(axes, wide)


def _draw_curves(axes: Axes, ds: xr.Dataset, name: str) -> None:
    """Medians of the regions with their errors, over the setpoint, and the fit."""
    factor, unit = (1.0, "degrees") if name == "phase" else (1e9, "nm")
    amplitudes = np.unique(ds["free_amplitude"].values)
    for i in range(ds.sizes["region"]):
        color = COLORS[i % len(COLORS)]
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
    said = "phase, less its zero" if name == "phase" else "height, less its zeros"
    axes.set_title(f"{said} ({unit})", fontsize=10, loc="left")
    axes.set_xlabel("setpoint", fontsize=9)
    _tidy(axes)


def _draw_property(axes: Axes, ds: xr.Dataset, name: str, label: str, factor: float) -> None:
    """One property of all regions, on a logarithmic scale."""
    from matplotlib.ticker import LogLocator, NullFormatter

    words = ds["determination"].attrs["flag_meanings"].split()
    for i in range(ds.sizes["region"]):
        value, error = factor * float(ds[name][i]), SURE * float(ds[f"{name}_error"][i])
        word = words[int(ds["determination"].sel(property=name)[i])]
        color = COLORS[i % len(COLORS)]
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
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0,) if high > 100 * low else (1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_title(label, fontsize=10, loc="left")
    axes.set(xlim=(-0.6, ds.sizes["region"] - 0.4), xticks=range(ds.sizes["region"]))
    axes.set_xticklabels([str(one) for one in ds["region"].values])
    axes.set_xlabel("region", fontsize=9)
    _tidy(axes)


def _tidy(axes: Axes) -> None:
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)
