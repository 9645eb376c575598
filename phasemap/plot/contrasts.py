"""Pictures of the contrast between two materials: a map, or lines where only the setpoint is changed."""

from __future__ import annotations

import itertools
import json
import os
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from xarray import Dataset

from phasemap._shared.asked import asked_as
from phasemap._shared.errors import InputError
from phasemap._shared.quantities import Scalar
from phasemap._shared.units import readable
from phasemap.plot.colours import FAILED, FAILED_TEXT, PALETTE, Colours, given_colours
from phasemap.plot.contrast_map import (
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
from phasemap.plot.page import Page, shortened
from phasemap.results.descriptions import describe_failures, describe_irregular, titles

COLOURS = PALETTE[:2]  # of the two materials
MOST_PANELS = 4
LONG = 20  # letters of both names that have room beside the colour bar
FEW = 60  # setpoints up to which they are marked
ZERO: dict[str, Any] = {
    "marker": "o", "markersize": 5, "markerfacecolor": "white", "markeredgecolor": "0.1", "markeredgewidth": 1.0,
    "linestyle": "",
}  # fmt: skip

# Sizes on the page [inch].
WIDTH, PANEL, STRIP, LEFT, RIGHT, GAP, AXIS, BAR = 6.6, 2.3, 0.3, 0.75, 0.2, 0.14, 0.55, 0.85
MAP = 4.2


@asked_as()
def contrast(
    ds: xr.Dataset,
    path: str | os.PathLike[str] | None = None,
    overwrite: bool = False,
    *,
    vmin: Scalar | None = None,
    vmax: Scalar | None = None,
    cmap: str | None = None,
) -> Figure:
    """Draw the contrast between two materials.

    A map shows it in colours that are grey at 0, over setpoint and free amplitude (or drive frequency; a panel each for
    at most four frequencies where both were given). The solid line is the inversion, where the contrast passes 0;
    dashed lines are jumps of one material's phase, dotted ones where it passes 0 between the regimes, hatched areas
    those in which a material is bistable, and words say in which regimes the tip engages. Green points have no orbit.
    Where only the setpoint was given, lines show the phases of both materials, their regimes, and the contrast. The
    star is the point recommended; the sentences below say why, and by which rule.

    Parameters
    ----------
    ds : xarray.Dataset
        What `phasemap.contrast` returned.
    path, overwrite
        As in `phasemap.plot.plot`.
    vmin, vmax : float, optional
        Limits of the colours of a map [degree]; one alone is that of a scale that is symmetric about 0.
    cmap : str, optional
        Colour map of matplotlib; "coolwarm" by default.
    """
    if not is_contrast(ds):
        raise InputError("the dataset", sorted(map(str, ds.data_vars)), "what phasemap.contrast returned")
    colours = given_colours(vmin, vmax, cmap, {"contrast": "degree"})["contrast"]
    page = _draw_lines(ds) if ds["contrast"].ndim == 1 else _draw_maps(ds, colours)
    return page.finished(path, overwrite)


def is_contrast(ds: xr.Dataset) -> bool:
    """True if a Dataset is of a contrast."""
    return "contrast" in ds and "regime" in ds and "inversion_setpoint" in ds


def _notes(ds: xr.Dataset) -> list[str | tuple[str, str]]:
    """The point recommended and by which rule, and what is missing."""
    lines = [
        f"★ {ds.attrs['recommendation']} {ds.attrs.get('recommendation_rule', '')}",
        *describe_irregular(ds, "points"),
    ]
    return [
        *((line, "0.1") for line in lines),
        *((f"■ {line}", FAILED_TEXT) for line in describe_failures(ds, "points")),
    ]


def _shown(ds: xr.Dataset) -> list[int]:
    """Indices of the frequencies that have a map of their own: spread over all, with the recommended one."""
    if ds["contrast"].ndim < 3:
        return [0]
    count = min(ds.sizes["frequency"], MOST_PANELS)
    shown = np.linspace(0, ds.sizes["frequency"] - 1, count).round().astype(int)
    best = np.flatnonzero(ds["frequency"].values == ds.attrs["best_frequency"])
    if best.size:
        shown[np.abs(shown - best[0]).argmin()] = best[0]
    return np.unique(shown).tolist()


def _head(ds: xr.Dataset) -> list[str]:
    """Title, both materials and the microscope, a line each."""
    about = json.loads(ds.attrs.get("configuration", "{}"))
    scope = dict(about.get("microscope", {}))
    drive = scope.get("drive", {})
    scope["drive"] = {name: value for name, value in drive.items() if name not in ds.dims}

    def said(**configuration: Any) -> list[str]:
        return titles(Dataset(attrs={"configuration": json.dumps(configuration)}))

    names = [str(name) for name in ds["material"].values]
    lines = [str(ds.attrs.get("title", f"phase contrast, {names[1]} minus {names[0]}"))]
    for name, which in zip(names, ("first", "second"), strict=True):
        lines += [f"{name}: {line}" for line in said(material=about.get(which, {}))]
    return lines + said(microscope=scope)


def _draw_lines(ds: xr.Dataset) -> Page:
    """Phases, regimes and contrast against the setpoint."""
    names = [str(name) for name in ds["material"].values]
    ds = ds.sortby("setpoint")
    keys = [Line2D([], [], color=colour, linewidth=1.6, label=n) for n, colour in zip(names, COLOURS, strict=True)]
    keys += [Line2D([], [], label="inversion", **ZERO)] * bool(ds.sizes["inversion"])
    keys += [Line2D([], [], label="jump", **LINES["jump"])] * bool(ds.sizes["jump"])
    keys += [Line2D([], [], label="recommended", **SMALL_STAR)]
    present = set(np.unique(ds["regime"].values).tolist())
    patches = [Patch(color=colour, label=word) for code, (word, colour) in REGIMES.items() if code in present]
    body = 2 * PANEL + STRIP + 2 * GAP + AXIS
    page = Page(WIDTH, body, _head(ds), [keys, patches], _notes(ds), left=LEFT)
    first: Axes | None = None
    for row, (top, high) in enumerate(((0.0, PANEL), (PANEL + GAP, STRIP), (PANEL + STRIP + 2 * GAP, PANEL))):
        axes = page.panel(LEFT, top, WIDTH - LEFT - RIGHT, high, sharex=first)
        first = first or axes
        axes.tick_params(labelbottom=row == 2)
        if row == 1:
            _draw_strip(axes, ds, names)
        else:
            _draw_quantity(axes, ds, "phase" if row == 0 else "contrast")
    best = [ds.attrs["best_setpoint"]], [ds.attrs["best_contrast"]]
    axes.plot(*best, gid="best", zorder=7, clip_on=False, **STAR)
    axes.set_xlabel("setpoint", fontsize=9)
    return page


def _draw_quantity(axes: Axes, ds: xr.Dataset, name: str) -> None:
    """Draw both phases or the contrast, with inversions, jumps and gaps."""
    x, zeros = ds["setpoint"].values, ds["inversion_setpoint"].values
    for i, colour in enumerate(COLOURS if name == "phase" else ("0.1",)):
        y = ds[name].values[i] if name == "phase" else ds[name].values
        jumps = ds.isel(jump=ds["jump_material"].values == i) if name == "phase" else ds
        axes.plot(*_with_gaps(x, y, jumps, name), color=colour, linewidth=1.6, gid=name)
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
    axes.set(yticks=[1, 0], yticklabels=[shortened(name, 12) for name in names], ylim=(-0.5, 1.5))
    axes.tick_params(axis="x", length=0)
    axes.spines[["left", "bottom"]].set_visible(False)


def _with_gaps(x: np.ndarray, y: np.ndarray, ds: xr.Dataset, name: str) -> tuple[np.ndarray, np.ndarray]:
    """A line with a gap at each jump, drawn up to it on both sides."""
    at = np.searchsorted(x, ds["jump_setpoint"].values).repeat(3)
    jumps = ds["jump_setpoint"].values.repeat(3)
    ends = np.stack([ds[f"jump_{word}_{name}"].values for word in ("from", "to")])
    levels = np.stack([ends[0], np.full(ends.shape[1], np.nan), ends[1]], axis=1).ravel()
    return np.insert(x, at, jumps), np.insert(y, at, levels)


def _draw_maps(ds: xr.Dataset, colours: Colours) -> Page:
    """A panel for each frequency shown, with one colour bar for all."""
    shown = _shown(ds)
    columns = min(len(shown), 2)
    rows = -(-len(shown) // columns)
    titled = 0.25 * (ds["contrast"].ndim == 3)
    wide, high = (WIDTH - LEFT - RIGHT - BAR - (columns - 1) * GAP) / columns, MAP if columns == 1 else 0.62 * MAP
    y_name = "free_amplitude" if "free_amplitude" in ds.dims else "frequency"
    unit = readable(float(ds[y_name].values.max()), ds[y_name].attrs["units"])
    names = [str(name) for name in ds["material"].values]
    norm = colours_of(ds["contrast"].values, colours)
    keys = keys_of(ds, names)
    page = Page(WIDTH, rows * (high + titled) + AXIS, _head(ds), [keys], _notes(ds), left=LEFT)
    first: Axes | None = None
    for k, index in enumerate(shown):
        cut = ds.isel(frequency=index) if titled else ds
        row, column = divmod(k, columns)
        title = f"driven at {readable(float(cut['frequency']), 'Hz').say(float(cut['frequency']), 6)}" if titled else ""
        left, top = LEFT + column * (wide + GAP), row * (high + titled) + titled
        axes = page.place(left, top, wide, high, title, sharex=first, sharey=first)
        first = first or axes
        mesh = draw_map(axes, cut, y_name, unit, (wide, high), norm, colours.cmap)
        lowest = k + columns >= len(shown)
        axes.tick_params(labelbottom=lowest, labelleft=column == 0)
        if lowest:
            axes.set_xlabel("setpoint", fontsize=9)
        if column == 0:
            axes.set_ylabel(unit.label(str(ds[y_name].attrs["long_name"])), fontsize=9)
    what = "phase contrast" + (f", {names[1]} minus {names[0]}" if sum(map(len, names)) <= LONG else "")
    page.bar(mesh, page.axes, f"{what} (degrees)", ticks=ticks_of(norm), format="{x:g}").minorticks_off()
    return page
