"""Pictures of the contrast between two materials: a map, or lines where only the setpoint is changed."""

from __future__ import annotations

import itertools
import json
import os
import textwrap
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from phasemap._shared.errors import InputError
from phasemap._shared.units import readable
from phasemap.plot.contrast_map import (
    FAILED,
    LINES,
    REGIMES,
    SMALL_STAR,
    STAR,
    colours_of,
    draw_map,
    edges_of,
    keys_of,
    ticks_of,
)
from phasemap.plot.figure import describe_failures, describe_irregular, save
from phasemap.plot.titles import titles

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["contrast", "is_contrast"]

COLOURS = ("#0072B2", "#D55E00")  # of the two materials: Okabe and Ito's blue and vermilion
MOST_PANELS = 4
LONG = 20  # letters of both names that fill the legend
FEW = 60  # setpoints up to which they are marked
ZERO: dict[str, Any] = {
    "marker": "o", "markersize": 5, "markerfacecolor": "white", "markeredgecolor": "0.1", "markeredgewidth": 1.0,
    "linestyle": "",
}  # fmt: skip

# Sizes on the page [inch].
WIDTH, PANEL, STRIP, LEFT, RIGHT, GAP, LINE, LEGEND, AXIS, BAR = 6.6, 2.3, 0.3, 0.75, 0.2, 0.14, 0.17, 0.3, 0.5, 0.85
MAP = 4.2


def contrast(ds: xr.Dataset, path: str | os.PathLike[str] | None = None, overwrite: bool = False) -> Figure:
    """Draw the contrast between two materials.

    A map shows it in colours that are grey at 0, over setpoint and free amplitude (or drive frequency; a panel each for
    at most four frequencies where both were given). The solid line is the inversion, where the contrast passes 0;
    dashed lines are jumps of one material's phase, hatched areas those in which a material is bistable, and words say
    the regimes elsewhere. Green points have no orbit. Where only the setpoint was given, lines show the phases of both
    materials, their regimes, and the contrast. The star is the point recommended; the sentence below says why.

    Parameters
    ----------
    ds : xarray.Dataset
        What `phasemap.contrast` returned.
    path : path-like, optional
        Where to save the picture; the suffix chooses the format (.png, .pdf, .svg and others).
    overwrite : bool
        Whether an existing file may be replaced.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If `ds` is no map of a contrast, or the format is unknown.
    FileError
        If `path` cannot be written.

    Examples
    --------
    >>> import numpy as np, phasemap as pm
    >>> scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(30e-9))
    >>> soft, hard = pm.Material(0.2e9, adhesion=0.06, damping=0.03), pm.Material(3e9, adhesion=0.07, damping=0.004)
    >>> ds = pm.contrast(soft, hard, scope, np.linspace(0.4, 0.9, 4))
    >>> [axes.get_ylabel() for axes in contrast(ds).axes]
    ['phase (degrees)', '', 'contrast (degrees)']
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    if not is_contrast(ds):
        raise InputError("the dataset", sorted(map(str, ds.data_vars)), "what phasemap.contrast returned")
    page = _Page.of(ds)
    figure = Figure(figsize=(WIDTH, page.height))
    canvas = FigureCanvasAgg(figure)
    (_draw_lines if page.rows == 0 else _draw_maps)(figure, ds, page)
    for i, line in enumerate(page.head):
        figure.text(
            LEFT / WIDTH, 1 - (0.1 + i * LINE) / page.height, line, fontsize=9 - bool(i),
            color="0.1" if i == 0 else "0.35", va="top",
        )  # fmt: skip
    for lines, colour, below in ((page.foot, "0.1", len(page.notes)), (page.notes, "#00803a", 0)):
        figure.text(
            0.15 / WIDTH, (0.5 + below) * LINE / page.height, "\n".join(lines), fontsize=8, color=colour, va="bottom",
            linespacing=1.4,
        )  # fmt: skip
    if path is not None:
        save(canvas, path, overwrite)
    return figure


def is_contrast(ds: xr.Dataset) -> bool:
    """Whether a Dataset is of a contrast.

    Parameters
    ----------
    ds : xarray.Dataset

    Returns
    -------
    bool
    """
    return "contrast" in ds and "regime" in ds and "inversion_setpoint" in ds


class _Page(NamedTuple):
    """What stands above and below the panels, and in how many rows: the legend, and the maps, none for lines."""

    head: list[str]
    foot: list[str]
    notes: list[str]
    keys: int
    frequencies: list[int]
    rows: int
    columns: int

    @classmethod
    def of(cls, ds: xr.Dataset) -> _Page:
        stars = [f"★ {ds.attrs['recommendation']}", *describe_irregular(ds, "points")]
        said = stars, [f"■ {line}" for line in describe_failures(ds, "points")]
        foot, notes = (
            [part for line in lines for part in textwrap.wrap(line, 106, subsequent_indent="    ")] for lines in said
        )
        frequencies, rows, columns = [0], int(ds["contrast"].ndim > 1), 1
        if ds["contrast"].ndim == 3:
            count = min(ds.sizes["frequency"], MOST_PANELS)
            frequencies = np.unique(np.linspace(0, ds.sizes["frequency"] - 1, count).round().astype(int)).tolist()
            columns = min(len(frequencies), 2)
            rows = -(-len(frequencies) // columns)
        long = sum(len(str(name)) for name in ds["material"].values) > LONG
        return cls(_head(ds), foot, notes, 2 if long or not rows else 1, frequencies, rows, columns)

    @property
    def top(self) -> float:
        """Where the first panel begins [inch]."""
        return 0.14 + LINE * len(self.head) + LEGEND * (self.keys + (len(self.frequencies) > 1))

    @property
    def panel(self) -> float:
        """Height of a map [inch]."""
        return MAP if self.columns == 1 else 0.62 * MAP

    @property
    def height(self) -> float:
        """Of the page [inch]."""
        inside = self.rows * (self.panel + LEGEND) - LEGEND if self.rows else 2 * PANEL + STRIP + 2 * GAP
        return self.top + inside + AXIS + LINE * (len(self.foot) + len(self.notes) + 0.8)


def _head(ds: xr.Dataset) -> list[str]:
    """Title, both materials and the microscope, a line each."""
    from xarray import Dataset

    about = json.loads(ds.attrs.get("configuration", "{}"))
    scope = dict(about.get("microscope", {}))
    drive = scope.get("drive", {})
    scope["drive"] = {name: value for name, value in drive.items() if name not in ds.dims}

    def said(**configuration: Any) -> list[str]:
        return titles(Dataset(attrs={"configuration": json.dumps(configuration)}))

    names = [str(name) for name in ds["material"].values]
    lines = [str(ds.attrs.get("title", f"phase contrast, {names[1]} less {names[0]}"))]
    for name, which in zip(names, ("first", "second"), strict=True):
        lines += [f"{name}: {line}" for line in said(material=about.get(which, {}))]
    return lines + said(microscope=scope)


def _draw_lines(figure: Figure, ds: xr.Dataset, page: _Page) -> None:
    """Phases, regimes and contrast against the setpoint."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    first: Axes | None = None
    names = [str(name) for name in ds["material"].values]
    ds = ds.sortby("setpoint")
    bottom = page.height - page.top
    for row, high in enumerate((PANEL, STRIP, PANEL)):
        bottom -= high + GAP * bool(row)
        place = (LEFT / WIDTH, bottom / page.height, (WIDTH - LEFT - RIGHT) / WIDTH, high / page.height)
        axes = figure.add_axes(place, sharex=first)
        first = first or axes
        axes.tick_params(labelsize=8, labelbottom=row == 2)
        axes.spines[["top", "right"]].set_visible(False)
        if row == 1:
            _draw_strip(axes, ds, names)
        else:
            _draw_quantity(axes, ds, "phase" if row == 0 else "contrast")
    best = [ds.attrs["best_setpoint"]], [ds.attrs["best_contrast"]]
    axes.plot(*best, gid="best", zorder=7, clip_on=False, **STAR)
    axes.set_xlabel("setpoint", fontsize=9)
    figure.align_ylabels()
    handles = [Line2D([], [], color=colour, linewidth=1.6, label=n) for n, colour in zip(names, COLOURS, strict=True)]
    handles += [
        Line2D([], [], label="inversion", **ZERO),
        Line2D([], [], label="jump", **LINES["jump"]),
        Line2D([], [], label="recommended", **SMALL_STAR),
    ]
    _legend(figure, page, handles, 0)
    present = set(np.unique(ds["regime"].values).tolist())
    patches = [Patch(color=colour, label=word) for code, (word, colour) in REGIMES.items() if code in present]
    _legend(figure, page, patches, 1)


def _draw_quantity(axes: Axes, ds: xr.Dataset, name: str) -> None:
    """Both phases or the contrast, with inversions, jumps and what is missing."""
    x, zeros = ds["setpoint"].values, ds["inversion_setpoint"].values
    for i, colour in enumerate(COLOURS if name == "phase" else ("0.1",)):
        y = ds[name].values[i] if name == "phase" else ds[name].values
        jumps = ds.isel(jump=ds["jump_material"].values == i) if name == "phase" else ds
        axes.plot(*_broken(x, y, jumps, name), color=colour, linewidth=1.6, gid=name)
        if len(x) <= FEW:
            axes.plot(x, y, "o", markersize=3.0, color=colour, gid="points")
        ends = [jumps[f"jump_{word}_{name}"].values for word in ("from", "to")]
        axes.vlines(jumps["jump_setpoint"].values, ends[0], ends[1], gid="jump", **LINES["jump"])
    for zero in zeros:
        axes.axvline(zero, color="0.5", linewidth=0.8, linestyle=":", zorder=1)
    level = ds["inversion_phase"].values if name == "phase" else np.zeros(len(zeros))
    axes.plot(zeros, level, zorder=6, gid="inversion", **ZERO)
    lost = x[(ds["status"].values != 0).any(axis=0)]
    below = axes.get_xaxis_transform()  # x in the panel, y as a fraction of the axes
    axes.plot(lost, np.full(len(lost), 0.03), "s", transform=below, color=FAILED, scaley=False, gid="failed")
    axes.axhline(0, color="0.8", linewidth=0.6, zorder=1)
    axes.margins(x=0.02, y=0.08)
    axes.set_ylabel(f"{name} (degrees)", fontsize=9)


def _draw_strip(axes: Axes, ds: xr.Dataset, names: list[str]) -> None:
    """A bar for each material, coloured and labelled by its regime."""
    edges = edges_of(ds["setpoint"].values)
    for i, name in enumerate(names):
        codes = ds["regime"].values[i]
        cuts = [0, *(np.flatnonzero(np.diff(codes)) + 1).tolist(), len(codes)]
        for begin, end in itertools.pairwise(cuts):
            word, colour = REGIMES[int(codes[begin])]
            low, high = edges[begin], edges[end]
            axes.barh(1 - i, high - low, left=low, height=0.86, color=colour, linewidth=0, gid=f"{name} {word}")
            if (high - low) / (edges[-1] - edges[0]) > 0.014 * len(word):
                axes.text((low + high) / 2, 0.97 - i, word, fontsize=6.5, ha="center", va="center", color="0.15")
    axes.set(
        yticks=[1, 0], yticklabels=[name if len(name) < 13 else f"{name[:11]}…" for name in names], ylim=(-0.5, 1.5)
    )
    axes.tick_params(axis="x", length=0)
    axes.spines[["left", "bottom"]].set_visible(False)


def _broken(x: np.ndarray, y: np.ndarray, ds: xr.Dataset, name: str) -> tuple[np.ndarray, np.ndarray]:
    """A line with a gap at each jump, drawn up to it on both sides."""
    at = np.searchsorted(x, ds["jump_setpoint"].values).repeat(3)
    jumps = ds["jump_setpoint"].values.repeat(3)
    ends = np.stack([ds[f"jump_{word}_{name}"].values for word in ("from", "to")])
    levels = np.stack([ends[0], np.full(ends.shape[1], np.nan), ends[1]], axis=1).ravel()
    return np.insert(x, at, jumps), np.insert(y, at, levels)


def _draw_maps(figure: Figure, ds: xr.Dataset, page: _Page) -> None:
    """A panel for each frequency shown, with one colour bar for all."""
    from matplotlib.colorbar import Colorbar

    y_name = "free_amplitude" if "free_amplitude" in ds.dims else "frequency"
    unit = readable(float(ds[y_name].values.max()), ds[y_name].attrs["units"])
    norm = colours_of(ds["contrast"].values)
    wide = (WIDTH - LEFT - RIGHT - BAR - (page.columns - 1) * GAP) / page.columns
    first: Axes | None = None
    for k, index in enumerate(page.frequencies):
        one = ds.isel(frequency=index) if "frequency" in ds.dims and y_name != "frequency" else ds
        row, column = divmod(k, page.columns)
        left = LEFT + column * (wide + GAP)
        bottom = page.height - page.top - row * (page.panel + LEGEND) - page.panel
        place = (left / WIDTH, bottom / page.height, wide / WIDTH, page.panel / page.height)
        axes = figure.add_axes(place, sharex=first, sharey=first)
        first = first or axes
        mesh = draw_map(axes, one, y_name, unit, (wide, page.panel), norm)
        lowest = k + page.columns >= len(page.frequencies)
        axes.tick_params(labelsize=8, labelbottom=lowest, labelleft=column == 0)
        if one is not ds:
            frequency = readable(float(one["frequency"]), "Hz").say(float(one["frequency"]), 6)
            axes.set_title(f"driven at {frequency}", fontsize=8, loc="left", pad=3)
        if lowest:
            axes.set_xlabel("setpoint", fontsize=9)
        if column == 0:
            axes.set_ylabel(unit.label(str(ds[y_name].attrs["long_name"])), fontsize=9)
    low = page.height - page.top - page.rows * (page.panel + LEGEND) + LEGEND
    left = WIDTH - RIGHT - BAR + GAP
    bar = figure.add_axes((left / WIDTH, low / page.height, 0.14 / WIDTH, (page.height - page.top - low) / page.height))
    names = [str(name) for name in ds["material"].values]
    what = f"phase contrast, {names[1]} less {names[0]}" if page.keys == 1 else "phase contrast"
    Colorbar(bar, mesh, ticks=ticks_of(norm), format="{x:g}").set_label(f"{what} (degrees)", fontsize=9)
    bar.minorticks_off()
    bar.tick_params(labelsize=8)
    handles = keys_of(names)
    for row, part in enumerate((handles[:3], handles[3:]) if page.keys == 2 else (handles,)):
        _legend(figure, page, part, row)


def _legend(figure: Figure, page: _Page, handles: list[Any], row: int) -> None:
    """One row between the titles and the first panel."""
    top = 0.14 + LINE * len(page.head) + row * LEGEND * 0.75 + 0.06
    figure.legend(
        handles=handles, loc="upper left", bbox_to_anchor=((LEFT + 0.05) / WIDTH, 1 - top / page.height),
        ncols=len(handles), fontsize=8, frameon=False, borderpad=0, borderaxespad=0, handlelength=2.2,
        columnspacing=1.4,
    )  # fmt: skip
