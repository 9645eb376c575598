"""The page of a comparison: both phases and the residual, histograms, a line through both, and the numbers in words."""

from __future__ import annotations

import os
import textwrap
from typing import Any

import matplotlib
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from phasemap._shared.asked import asked_as
from phasemap._shared.checks import whole
from phasemap._shared.errors import InputError
from phasemap._shared.quantities import Scalar
from phasemap._shared.units import readable
from phasemap.comparison.findings import apart, differences_of, lines_of, names_of, verdict_of
from phasemap.plot.colours import CHOSEN, FAILED, MAPS, PALETTE, Colours, given_colours, limits_of
from phasemap.plot.page import LINE, Page, draw_scale_bar, shortened, side_lengths

COLOURS = ("0.15", PALETTE[1])  # of the two images
LEGEND = {"left out": "left out (green)"}
LEAST_SPAN = 0.1  # degrees
DWARFS, MOST_SPIKES = 4.0, 6  # times as high as the other histogram; labelled at most
FLAT, TALL = 0.25, 1.6  # height over width of the maps on the page, at least and at most
SHORT, LONG = 12, 50  # letters of a name that have room over a map, and of a file in the head

# Sizes on the page [inch].
ROOM = 1.2  # of the name of a colour bar
MAP, GAP, BAR, MARGIN = 2.75, 0.14, 0.81, 0.25
TITLE, PANEL, LABELS, AXIS, KEY = 0.3, 1.9, 0.45, 0.55, 1.2
WIDTH = 2 * MARGIN + 3 * MAP + GAP + 2 * BAR


@asked_as()
def comparison(
    ds: xr.Dataset,
    path: str | os.PathLike[str] | None = None,
    overwrite: bool = False,
    *,
    row: int | None = None,
    vmin: Scalar | None = None,
    vmax: Scalar | None = None,
    cmap: str | None = None,
) -> Figure:
    """Draw the page of a comparison.

    Both phases share one colour scale; the residual has its own, on which a degree takes as much of the colour bar, or
    less where that would not hold it. Its middle is 0, or the mean where the images are apart as a whole. Pixels that
    were left out are green. Below are both histograms, phase and height along one row (marked beside the maps), and
    what the numbers say.

    Parameters
    ----------
    ds : xarray.Dataset
        What `phasemap.compare` returned.
    path, overwrite
        As in `phasemap.plot.plot`.
    row : int, optional
        Along which row lines are drawn, from 0 at the top; default: the middle, or the nearest with compared pixels.
    vmin, vmax : float, optional
        Limits of both phases [degree].
    cmap : str, optional
        Colour map of both phases.
    """
    if not is_comparison(ds):
        raise InputError("the dataset", sorted(map(str, ds.data_vars)), "what phasemap.compare returned")
    if row is None:  # nearest to the middle in which anything is compared
        rows = np.flatnonzero((ds["label"].values >= 0).any(axis=1))
        row = int(rows[np.abs(rows - ds.sizes["y"] // 2).argmin()])
    row = whole("row", row, 0, ds.sizes["y"] - 1)
    asked = given_colours(vmin, vmax, cmap, {"phase": "degree"})["phase"]
    wrapped = ((word, enumerate(textwrap.wrap(text, 128))) for word, text in lines_of(ds)[1:])
    lines = [("" if i else LEGEND.get(word, word), line) for word, texts in wrapped for i, line in texts]
    verdict = textwrap.wrap(f"The images differ in {differences_of(ds)}. {verdict_of(ds)}", 105)
    width, height = side_lengths(ds)
    tall = MAP * min(max(height / width, FLAT), TALL)
    below = TITLE + tall + 0.38
    words = below + PANEL + AXIS
    page = Page(WIDTH, words + LINE * (len(lines) + 1), [*verdict, _source(ds)], titles=len(verdict))
    first, second = (shortened(name, SHORT) for name in names_of(ds))
    lefts = [MARGIN, MARGIN + MAP + GAP, MARGIN + 2 * MAP + GAP + BAR]
    titles = (f"{first} phase", f"{second} phase", f"residual: {first} minus {second}")
    pictures = [page.picture(left, TITLE, MAP, tall, title) for left, title in zip(lefts, titles, strict=True)]
    _draw_maps(page, pictures, ds, row, asked)
    _draw_histograms(page.panel(MARGIN + LABELS, below, MAP - LABELS, PANEL), ds, (first, second))
    left = MARGIN + MAP + GAP + 0.5
    wide, share = WIDTH - left - MARGIN - 0.1, 0.6 * PANEL
    profile = page.panel(left, below, wide, share)
    _draw_profiles(profile, page.panel(left, below + share + 0.08, wide, PANEL - share - 0.08, sharex=profile), ds, row)
    for i, (word, text) in enumerate(lines):
        page.write(MARGIN, words + LINE * i, word, color="0.4")
        page.write(MARGIN + KEY, words + LINE * i, text, color="0.1")
    return page.finished(path, overwrite)


def is_comparison(ds: xr.Dataset) -> bool:
    """True if a Dataset is of a comparison."""
    return "residual" in ds and "crosstalk" in ds and "measured" in ds


def _limits(ds: xr.Dataset, asked: Colours = CHOSEN) -> tuple[float, float]:
    """The range of both phases that is shown."""
    low, high = limits_of(np.stack([ds["measured"].values, ds["simulated"].values]))
    spare = max(LEAST_SPAN - (high - low), 0.04 * (high - low)) / 2
    return low - spare if asked.vmin is None else asked.vmin, high + spare if asked.vmax is None else asked.vmax


def _draw_maps(page: Page, pictures: list[Axes], ds: xr.Dataset, row: int, asked: Colours) -> None:
    """Draw both phases and the residual, with a colour bar for the former and one for the latter."""
    width, tall = side_lengths(ds)
    low, high = _limits(ds, asked)
    middle = apart(ds)
    reach = max((high - low) / 2, *np.abs(np.subtract(limits_of(ds["residual"].values), middle)))
    phase, rest = Normalize(low, high), Normalize(middle - reach, middle + reach)
    colours = asked.cmap or MAPS["phase"]
    styles = (("measured", colours, phase), ("simulated", colours, phase), ("residual", MAPS["residual"], rest))
    at = (row + 0.5) / ds.sizes["y"] * tall
    roomy = pictures[0].get_window_extent().height > ROOM * page.dpi
    for axes, (name, cmap, norm) in zip(pictures, styles, strict=True):
        image = axes.imshow(
            np.ma.masked_invalid(ds[name].values), cmap=matplotlib.colormaps[cmap].with_extremes(bad=FAILED),
            norm=norm, extent=(0, width, tall, 0), aspect="auto",
            interpolation="nearest" if ds["label"].values.min() < 0 else None,
        )  # fmt: skip
        for side, mark in ((0.0, ">"), (width, "<")):
            axes.plot(side, at, mark, color="0.15", markersize=4.5, clip_on=False, scalex=False, scaley=False)
        draw_scale_bar(axes)
        if name != "measured":
            about = f", about {middle:.3g}" if middle else ""
            what = "phase (degrees)" if name == "simulated" else f"residual (degrees{about})"
            page.bar(image, [axes], what if roomy else "degrees")


def _draw_histograms(axes: Axes, ds: xr.Dataset, names: tuple[str, str]) -> None:
    """Draw how often each phase occurs in either image; a spike that dwarfs the other runs out, and is labelled."""
    edges = np.linspace(*_limits(ds), 90)
    shares = []
    for name, called, colour in zip(("measured", "simulated"), names, COLOURS, strict=True):
        values = ds[name].values[np.isfinite(ds[name].values)]
        shares.append(100 * np.histogram(values, edges)[0] / len(values))
        axes.stairs(shares[-1], edges, color=colour, linewidth=1.2, label=called)
        axes.stairs(shares[-1], edges, color=colour, fill=True, alpha=0.15)
    low, high = sorted(float(share.max()) for share in shares)
    top = 2 * low if high > DWARFS * low > 0 else high or 1.0
    pairs = list(zip(shares, COLOURS, strict=True))
    spikes = [(share[k], edges[k + 1], colour) for share, colour in pairs for k in np.where(share > top)[0]]
    for n, (share, x, colour) in enumerate(spikes[:MOST_SPIKES]):
        axes.annotate(
            f"{share:.0f} %", (x, top), xytext=(2, -10 * n), textcoords="offset points", color=colour, fontsize=7.5,
            va="top",
        )  # fmt: skip
    axes.set_xlim(edges[0], edges[-1])
    axes.set_ylim(0, 1.05 * top)
    zero = float(ds["offset"])
    shifted = f"; zero at {zero:.4g} in the file" if zero else ""
    axes.set_xlabel(f"phase (degrees){shifted}", fontsize=8.5)
    axes.set_ylabel("share of pixels (%)", fontsize=8.5)
    place: dict[str, Any] = {"loc": "lower left", "bbox_to_anchor": (0, 1), "borderaxespad": 0.1}
    axes.legend(fontsize=8, frameon=False, ncols=2, handlelength=1.4, **place)


def _draw_profiles(phase: Axes, height: Axes, ds: xr.Dataset, row: int) -> None:
    """Phase and height along one row of either image."""
    unit = readable(side_lengths(ds)[0], "m")
    line = ds.isel(y=row)
    heights = np.array([line[f"{name}_height"].values for name in ("measured", "simulated")])
    known = heights[np.isfinite(heights)]
    height_unit = readable((float(np.ptp(known)) if known.size else 0.0) or 1e-9, "m")
    x = line["x"].values / unit.size
    for i, (name, colour) in enumerate(zip(("measured", "simulated"), COLOURS, strict=True)):
        phase.plot(x, line[name].values, color=colour, linewidth=0.9)
        height.plot(x, heights[i] / height_unit.size, color=colour, linewidth=0.9)
    phase.set_ylabel("phase (degrees)", fontsize=8.5)
    height.set_ylabel(height_unit.label("height"), fontsize=8.5)
    height.set_xlabel(f"{unit.label('x')}, along the row that ▸ and ◂ mark", fontsize=8.5)
    phase.tick_params(labelbottom=False)
    phase.set_xlim(x[0], x[-1])
    for axes in (phase, height):
        axes.margins(y=0.08)


def _source(ds: xr.Dataset) -> str:
    """Sources of the images, and their size."""
    width, tall = side_lengths(ds)
    unit = readable(max(width, tall), "m")
    parts = [
        shortened(f"{ds.attrs[f'{name}_name']}: {ds.attrs[f'{name}_source']}", LONG)
        for name in ("measured", "simulated")
        if f"{name}_source" in ds.attrs
    ]
    scale = "" if FLAT <= tall / width <= TALL else ", not drawn to scale"
    parts.append(f"{ds.sizes['x']} × {ds.sizes['y']} pixels, {width / unit.size:.3g} × {unit.say(tall, 3)}{scale}")
    return "   ·   ".join(parts)
