"""The page of a comparison: both phases and the residual, histograms, a line through both, and the numbers in words."""

from __future__ import annotations

import os
import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np

from phasemap._shared.errors import InputError
from phasemap.comparison.words import lines_of, names_of, verdict_of
from phasemap.plot.figure import FAILED, draw_scale_bar, length_unit, save

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["comparison", "is_comparison"]

COLOURS = ("0.15", "#D55E00")  # of the two images: black and Okabe and Ito's vermilion
LIMITS = (0.5, 99.5)  # percentiles shown; a few outliers must not cost the contrast
LEAST_SPAN = 0.1  # degrees
FLAT, TALL = 0.25, 1.6  # height over width of the maps on the page, at least and at most
SHORT, LONG = 12, 50  # letters of a name that have room over a map, and of a file in the head

# Sizes on the page [inch].
ROOM = 1.2  # of the name of a colour bar
MAP, GAP, BAR_GAP, BAR, BAR_LABELS, MARGIN = 2.75, 0.14, 0.07, 0.11, 0.62, 0.25
HEAD, TITLE, PANEL, LABELS, AXIS, LINE, KEY = 0.52, 0.24, 1.9, 0.45, 0.55, 0.185, 1.1
WIDTH = 2 * MARGIN + 3 * MAP + GAP + 2 * (BAR_GAP + BAR + BAR_LABELS)


def comparison(
    ds: xr.Dataset, path: str | os.PathLike[str] | None = None, overwrite: bool = False, *, row: int | None = None
) -> Figure:
    """Draw the page of a comparison.

    Both phases share one colour scale; the residual has its own, centred on 0, on which a degree takes as much of the
    colour bar. Pixels that were left out are green. Below are both histograms, phase and height along one row (marked
    beside the maps), and what the numbers say.

    Parameters
    ----------
    ds : xarray.Dataset
        What `phasemap.compare` returned.
    path : path-like, optional
        Where to save the page; the suffix chooses the format (.png, .pdf, .svg and others).
    overwrite : bool
        Whether an existing file may be replaced.
    row : int, optional
        Along which row lines are drawn, from 0 at the top; default: the middle, or the nearest with compared pixels.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If `ds` is no comparison, there is no such row, or the format is unknown.
    FileError
        If `path` cannot be written.

    Examples
    --------
    >>> import phasemap as pm, xarray as xr
    >>> hills = np.random.default_rng(1).normal(size=(40, 43)).cumsum(axis=0).cumsum(axis=1)
    >>> channels = {"height": (("y", "x"), 1e-9 * hills), "phase": (("y", "x"), hills)}
    >>> image = xr.Dataset(channels, {"y": 4e-9 * np.arange(40), "x": 4e-9 * np.arange(43)})
    >>> [axes.get_title(loc="left") for axes in comparison(pm.compare(image, image)).axes[:3]]
    ['measured phase', 'simulated phase', 'residual: measured less simulated']
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    if not is_comparison(ds):
        raise InputError("the dataset", sorted(map(str, ds.data_vars)), "what phasemap.compare returned")
    if row is None:
        row = _middle(ds)
    elif not 0 <= row < ds.sizes["y"]:
        raise InputError("row", row, f"from 0 to {ds.sizes['y'] - 1}")
    lines = [(word, wrapped) for word, said in lines_of(ds) for wrapped, word in _wrapped(word, said, 128)]
    verdict = textwrap.wrap(verdict_of(ds), 105)
    tall = MAP * min(max(_sides(ds)[1] / _sides(ds)[0], FLAT), TALL)
    top = HEAD + TITLE + LINE * (len(verdict) - 1)
    below = top + tall + 0.38
    height = below + PANEL + AXIS + LINE * (len(lines) + 1)
    figure = Figure(figsize=(WIDTH, height))
    canvas = FigureCanvasAgg(figure)

    def axes_at(left: float, down: float, wide: float, high: float, **options: Any) -> Axes:
        return figure.add_axes((left / WIDTH, 1 - (down + high) / height, wide / WIDTH, high / height), **options)

    first, second = (_short(name, SHORT) for name in names_of(ds))
    lefts = [MARGIN, MARGIN + MAP + GAP, MARGIN + 2 * MAP + GAP + BAR_GAP + BAR + BAR_LABELS]
    pictures = [axes_at(left, top, MAP, tall) for left in lefts]
    bars = [axes_at(left + MAP + BAR_GAP, top, BAR, tall) for left in lefts[1:]]
    titles = (f"{first} phase", f"{second} phase", f"residual: {first} less {second}")
    _draw_maps(pictures, bars, ds, titles, row)
    _draw_histograms(axes_at(MARGIN + LABELS, below, MAP - LABELS, PANEL), ds, (first, second))
    left = MARGIN + MAP + GAP + 0.5
    wide, share = WIDTH - left - MARGIN - 0.1, 0.6 * PANEL
    profile = axes_at(left, below, wide, share)
    _draw_profiles(profile, axes_at(left, below + share + 0.08, wide, PANEL - share - 0.08, sharex=profile), ds, row)
    figure.align_ylabels()

    def write(left: float, down: float, text: str, **style: Any) -> None:
        figure.text(left / WIDTH, 1 - down / height, text, va="top", **style)

    write(MARGIN, 0.1, "\n".join(verdict), fontsize=10.5, fontweight="bold", color="0.1", linespacing=1.25)
    write(MARGIN, 0.1 + LINE * len(verdict) + 0.06, _source(ds), fontsize=8, color="0.4")
    for i, (word, said) in enumerate(lines):
        down = below + PANEL + AXIS + LINE * i
        write(MARGIN, down, word, fontsize=8.5, color="0.4")
        write(MARGIN + KEY, down, said, fontsize=8.5, color="0.1")
    if path is not None:
        save(canvas, path, overwrite)
    return figure


def is_comparison(ds: xr.Dataset) -> bool:
    """Whether a Dataset is of a comparison.

    Parameters
    ----------
    ds : xarray.Dataset

    Returns
    -------
    bool
    """
    return "residual" in ds and "crosstalk" in ds and "measured" in ds


def _wrapped(word: str, said: str, most: int) -> list[tuple[str, str]]:
    """Lines of a text, of which the first has the word."""
    return [(line, word if i == 0 else "") for i, line in enumerate(textwrap.wrap(said, most))]


def _short(text: str, most: int) -> str:
    """A text, or its begin where there is no room for all of it."""
    return text if len(text) <= most else text[: most - 1] + "…"


def _middle(ds: xr.Dataset) -> int:
    """The row nearest to the middle in which anything is compared."""
    rows = np.flatnonzero((ds["label"].values >= 0).any(axis=1))
    return int(rows[np.abs(rows - ds.sizes["y"] // 2).argmin()])


def _sides(ds: xr.Dataset) -> tuple[float, float]:
    """Width and height of the maps [m], to the outer edges of the pixels."""
    width, height = (float(ds[dim][-1] - ds[dim][0]) * ds.sizes[dim] / (ds.sizes[dim] - 1) for dim in ("x", "y"))
    return width, height


def _limits(*maps: xr.DataArray) -> tuple[float, float]:
    """The percentiles shown of all maps."""
    low, high = np.nanpercentile(np.concatenate([one.values.ravel() for one in maps]), LIMITS)
    spare = max(LEAST_SPAN - (high - low), 0.04 * (high - low)) / 2
    return float(low - spare), float(high + spare)


def _draw_maps(pictures: list[Axes], bars: list[Axes], ds: xr.Dataset, titles: tuple[str, ...], row: int) -> None:
    """Both phases and the residual, with a colour bar for the former and one for the latter."""
    import matplotlib
    from matplotlib.colorbar import Colorbar
    from matplotlib.colors import Normalize

    width, tall = _sides(ds)
    low, high = _limits(ds["measured"], ds["simulated"])
    phase, rest = Normalize(low, high), Normalize(-(high - low) / 2, (high - low) / 2)
    styles = (("measured", "cividis", phase), ("simulated", "cividis", phase), ("residual", "coolwarm", rest))
    at = (row + 0.5) / ds.sizes["y"] * tall
    roomy = bars[0].get_window_extent().height > ROOM * bars[0].figure.dpi
    for axes, (name, colours, norm), title in zip(pictures, styles, titles, strict=True):
        cmap = matplotlib.colormaps[colours].with_extremes(bad=FAILED)
        image = axes.imshow(
            np.ma.masked_invalid(ds[name].values), cmap=cmap, norm=norm, extent=(0, width, tall, 0), aspect="auto",
            interpolation="nearest" if ds["label"].values.min() < 0 else None,
        )  # fmt: skip
        axes.set_title(title, fontsize=10, loc="left", pad=4)
        axes.set(xticks=[], yticks=[])
        for side, mark in ((0.0, ">"), (width, "<")):
            axes.plot(side, at, mark, color="0.15", markersize=4.5, clip_on=False, scalex=False, scaley=False)
        draw_scale_bar(axes, width)
        if name != "measured":
            bar = Colorbar(bars[name == "residual"], image)
            what = "phase (degrees)" if name == "simulated" else "residual (degrees)"
            bar.set_label(what if roomy else "degrees", fontsize=8.5)
            bar.ax.tick_params(labelsize=8)


def _draw_histograms(axes: Axes, ds: xr.Dataset, names: tuple[str, str]) -> None:
    """How often each phase occurs in either image."""
    edges = np.linspace(*_limits(ds["measured"], ds["simulated"]), 90)
    for name, called, colour in zip(("measured", "simulated"), names, COLOURS, strict=True):
        values = ds[name].values[np.isfinite(ds[name].values)]
        counts = 100 * np.histogram(values, edges)[0] / len(values)
        axes.stairs(counts, edges, color=colour, linewidth=1.2, label=called)
        axes.stairs(counts, edges, color=colour, fill=True, alpha=0.15)
    axes.set_xlim(edges[0], edges[-1])
    axes.set_ylim(0, 1.18 * axes.get_ylim()[1])  # room for the legend
    axes.set_xlabel("phase (degrees)", fontsize=8.5)
    axes.set_ylabel("share of pixels (%)", fontsize=8.5)
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(fontsize=8, frameon=False, ncols=2, loc="upper left", borderaxespad=0, handlelength=1.4)


def _draw_profiles(phase: Axes, height: Axes, ds: xr.Dataset, row: int) -> None:
    """Phase and height along one row of either image."""
    unit, size = length_unit(_sides(ds)[0])
    line = ds.isel(y=row)
    heights = np.array([line[f"{name}_height"].values for name in ("measured", "simulated")])
    known = heights[np.isfinite(heights)]
    height_unit, height_size = length_unit(float(np.ptp(known)) if known.size else 0.0)
    x = line["x"].values / size
    for i, (name, colour) in enumerate(zip(("measured", "simulated"), COLOURS, strict=True)):
        phase.plot(x, line[name].values, color=colour, linewidth=0.9)
        height.plot(x, heights[i] / height_size, color=colour, linewidth=0.9)
    phase.set_ylabel("phase (degrees)", fontsize=8.5)
    height.set_ylabel(f"height ({height_unit})", fontsize=8.5)
    height.set_xlabel(f"x ({unit}), along the row that ▸ and ◂ mark", fontsize=8.5)
    phase.tick_params(labelbottom=False)
    phase.set_xlim(x[0], x[-1])
    for axes in (phase, height):
        axes.tick_params(labelsize=8)
        axes.spines[["top", "right"]].set_visible(False)
        axes.margins(y=0.08)


def _source(ds: xr.Dataset) -> str:
    """Where the images come from, and their size."""
    width, tall = _sides(ds)
    unit, size = length_unit(max(width, tall))
    said = [
        _short(f"{ds.attrs[f'{name}_name']}: {ds.attrs[f'{name}_source']}", LONG)
        for name in ("measured", "simulated")
        if f"{name}_source" in ds.attrs
    ]
    scale = "" if FLAT <= tall / width <= TALL else ", not drawn to scale"
    said.append(f"{ds.sizes['x']} × {ds.sizes['y']} pixels, {width / size:.3g} × {tall / size:.3g} {unit}{scale}")
    return "   ·   ".join(said)
