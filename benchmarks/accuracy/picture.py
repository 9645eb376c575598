"""Work-precision diagrams: time per pixel against error, one panel for each regime."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from benchmarks.accuracy.ranking import failures, families

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS = 4  # at most
PANEL, GAP, BLOCK = (2.75, 2.2), (0.28, 0.7), 0.8  # sizes on the page [inch]
LEFT, RIGHT, BOTTOM = 0.85, 0.3, 0.65
LINE = 0.26  # height of a line of the legend [inch]

# Okabe and Ito's colours, which the colour-blind tell apart; markers and dashes say the same once more.
STYLES = {
    "averaging": ("#E69F00", "D"),
    "auto": ("#009E73", "s"),
    "orbit": ("#D55E00", "*"),
    "march": ("#0072B2", "o"),
    "numbalsoda": ("#000000", "v"),
    "heyoka": ("#CC79A7", "^"),
    "scipy": ("#7F7F7F", "X"),
}
OTHER_STYLE = ("#56B4E9", "P")
HOLLOW: dict[str, Any] = {
    "color": "0.3", "marker": "o", "markerfacecolor": "white", "linestyle": "", "label": "hollow: some cases failed",
}  # fmt: skip
OWN = ("averaging", "auto", "orbit", "march")


class _Quantity(NamedTuple):
    """An error that is drawn."""

    name: str
    title: str
    label: str
    factor: float
    uncertainty: str
    wanted: float  # the accuracy asked for by default


QUANTITIES = (
    _Quantity("phase_error", "Phase", "phase error (degree)", 1.0, "reference_phase_uncertainty", 0.01),
    _Quantity("height_error", "Height", "height error (pm)", 1e12, "reference_height_uncertainty", 1.0),
)


def draw(ds: xr.Dataset, path: str | os.PathLike[str] | None = None, overwrite: bool = False) -> Figure:
    """Draw work-precision diagrams of what was measured.

    A point is the median error of a method at one tolerance, the thin line goes on to the 99th percentile; points of
    one method are joined. Nearer to the lower left is better.

    `ds`: of `benchmarks.accuracy.bench`.
    `path`: where to save the picture; the suffix chooses the format (.png, .pdf, .svg and others).
    `overwrite`: whether an existing file may be replaced.
    Raises FileError if `path` cannot be written.
    """
    from phasemap.plot.page import Page

    rows = -(-ds.sizes["regime"] // COLUMNS)
    columns = max(2, -(-ds.sizes["regime"] // rows))
    block = BLOCK + rows * (PANEL[1] + GAP[1])
    width = LEFT + columns * PANEL[0] + (columns - 1) * GAP[0] + RIGHT
    handles = _handles(ds)
    end, key = len(QUANTITIES) * block + BOTTOM - GAP[1], LINE * (1 + len(handles) // columns)
    page = Page(width, end + key, _head(ds), left=LEFT)

    def axes_at(number: int, part: int, title: str = "") -> Axes:
        row, column = divmod(number, columns)
        left, top = LEFT + column * (PANEL[0] + GAP[0]), part * block + BLOCK + row * (PANEL[1] + GAP[1])
        return page.panel(left, top, *PANEL, title)

    times = 1e6 * ds["time"].values
    limits = (0.5 * np.nanmin(times), 2 * np.nanmax(times))
    for part, quantity in enumerate(QUANTITIES):
        heading = f"{quantity.title}: time against error"
        page.write(LEFT, part * block + 0.2, heading, fontsize=12, fontweight="bold")
        span = _span(ds, quantity)
        for r, regime in enumerate(map(str, ds["regime"].values)):
            axes = axes_at(r, part, regime)
            _panel(axes, ds.isel(regime=r), quantity, span, limits)
            if r % columns == 0:
                axes.set_ylabel("time per pixel (µs)", fontsize=9)
            else:
                axes.tick_params(labelleft=False)
            if r + columns >= ds.sizes["regime"]:
                axes.set_xlabel(quantity.label, fontsize=9)
    below = page.panel(LEFT, end, width - LEFT - RIGHT, key)
    below.set_axis_off()
    below.legend(handles=handles, loc="upper left", fontsize=10, frameon=False, ncols=columns)
    return page.finished(path, overwrite)


def _span(ds: xr.Dataset, quantity: _Quantity) -> tuple[float, float, float]:
    """Errors shown, the same in every panel: least, that of the reference itself, and largest."""
    errors = abs(ds[quantity.name].values) * quantity.factor
    own = float(np.nanmedian(ds[quantity.uncertainty].values)) * quantity.factor
    return 0.1 * own, own, 3 * float(np.nanmax(errors))


def _panel(axes: Axes, ds: xr.Dataset, quantity: _Quantity, span: tuple[float, float, float], limits: Any) -> None:
    """All methods in one regime."""
    axes.set_xscale("log")
    axes.set_yscale("log")
    least, own, largest = span
    axes.set_xlim(least, largest)
    axes.set_ylim(*limits)
    axes.axvspan(least, own, color="0.9", linewidth=0)
    axes.axvline(quantity.wanted, color="0.6", linewidth=0.8, linestyle=":")
    failed = failures(ds).values
    for family in families(ds):
        columns = np.flatnonzero(ds["family"].values == family)
        colour, marker = STYLES.get(family, OTHER_STYLE)
        errors = abs(ds[quantity.name].values[columns]) * quantity.factor
        known = np.isfinite(errors).any(axis=1) & np.isfinite(ds["time"].values[columns])
        if not known.any():
            continue
        columns, errors = columns[known], np.maximum(errors[known], 0.3 * own)  # in the grey, whatever the chance
        x, most = np.nanmedian(errors, axis=1), np.nanpercentile(errors, 99, axis=1)
        y = 1e6 * ds["time"].values[columns]
        axes.plot(x, y, color=colour, linewidth=1.2, linestyle="-" if family in OWN else (0, (4, 2)), zorder=2)
        axes.hlines(y, x, most, color=colour, linewidth=0.7, alpha=0.7, zorder=1)
        whole = failed[columns] == 0
        size = 70 if marker == "*" else 26
        faces = [colour if each else "white" for each in whole]
        axes.scatter(x, y, size, marker=marker, facecolors=faces, edgecolors=colour, linewidths=1, zorder=3)
    axes.grid(color="0.93", linewidth=0.6)
    axes.set_axisbelow(True)


def _handles(ds: xr.Dataset) -> list[Any]:
    """Of the legend: which line is which, and what else is drawn."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = []
    for family in families(ds):
        colour, marker = STYLES.get(family, OTHER_STYLE)
        style: Any = "-" if family in OWN else (0, (4, 2))
        size = 10 if marker == "*" else 6
        handles.append(Line2D([], [], color=colour, marker=marker, markersize=size, linestyle=style, label=family))
    return [
        *handles,
        Line2D([], [], **HOLLOW),
        Line2D([], [], color="0.3", linewidth=0.7, label="from median to 99th percentile"),
        Line2D([], [], color="0.6", linewidth=0.8, linestyle=":", label="accuracy asked for by default"),
        Patch(color="0.9", label="below the reference's own error"),
    ]


def _head(ds: xr.Dataset) -> list[str]:
    """What was measured, how to read it, and on what machine."""
    solvers = "Solvers of phasemap (solid) and general integrators with shooting (dashed)"
    return [
        f"{solvers}; {ds.sizes['case']} random cases a regime, one core. Lower left is better.",
        f"{ds.attrs['machine']}; {ds.attrs['versions']}; seed {ds.attrs['seed']}",
    ]
