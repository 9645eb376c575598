"""Pictures: of an image, a comparison of two, a sweep, one of its periods, and the contrast between materials.

Uses matplotlib's Figure without pyplot: nothing is shown, no global state is touched, and start-up stays short.
"""

from __future__ import annotations

import json
import os
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from phasemap._shared.errors import InputError
from phasemap._shared.units import readable
from phasemap.plot.contrasts import contrast, is_contrast
from phasemap.plot.figure import (
    FAILED,
    describe_failures,
    describe_flags,
    describe_irregular,
    draw_scale_bar,
    length_unit,
    save,
)
from phasemap.plot.materials import inversion, is_inversion
from phasemap.plot.period import trace
from phasemap.plot.side_by_side import comparison, is_comparison
from phasemap.plot.sweep import curve, is_sweep
from phasemap.results.validity import describe_validity

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap, Normalize
    from matplotlib.figure import Figure

__all__ = [
    "comparison", "contrast", "curve", "describe_failures", "describe_flags", "describe_irregular", "inversion", "plot",
    "trace",
]  # fmt: skip

LIMITS = (0.5, 99.5)  # percentiles shown; a few outliers must not cost the contrast
MARGIN_OF_LIMITS = 0.04  # of the range, so that two sharp populations stand clear of the histogram's ends
LETTERS = 13.5  # of a note [1/inch]
DOT_PITCH = 6.0  # of the dots that mark pixels [points]
DOT: dict[str, Any] = {
    "marker": "o", "markersize": 2.2, "markerfacecolor": "white", "markeredgecolor": "black", "markeredgewidth": 0.5,
    "linestyle": "",
}  # fmt: skip

# Sizes on the page [inch].
PANEL, BAR_GAP, BAR, BAR_LABELS, MARGIN = 3.5, 0.07, 0.12, 0.62, 0.3
HEADER, TITLE, HISTOGRAM_GAP, HISTOGRAM, AXIS, LINE = 0.36, 0.3, 0.06, 0.5, 0.52, 0.17


@dataclass(frozen=True)
class _Scale:
    """How the values of one quantity turn into colours, the same in every row of the figure."""

    label: str
    factor: float
    offset: float
    cmap: Colormap
    norm: Normalize


def plot(
    ds: xr.Dataset,
    path: str | os.PathLike[str] | None = None,
    overwrite: bool = False,
    *,
    variables: Sequence[str] | None = None,
    mark_irregular: bool = False,
) -> Figure:
    """Draw height and phase of an image side by side, or what the function for another Dataset draws.

    Each has its colour bar, a scale bar and a histogram; colours span the 0.5 to 99.5 percentiles. The phase is shown
    in cividis, or in a diverging map centred on 0 where attractive and repulsive phases occur together. Pixels without
    a solution are green, and a line below says how many there are, why, and what helps; another counts the pixels in
    which the motion is irregular.

    Parameters
    ----------
    ds : xarray.Dataset
        What `phasemap.simulate` or `phasemap.io.netcdf.load` returned, with ``height`` and ``phase`` over ("y", "x");
        a leading dimension "direction" gives one row each, and ``amplitude_error`` a third column. Or what a sweep,
        `phasemap.contrast`, `phasemap.compare` or `phasemap.invert` returned.
    path : path-like, optional
        Where to save the picture; the suffix chooses the format (.png, .pdf, .svg and others).
    overwrite : bool
        Whether an existing file may be replaced.
    variables : sequence of str, optional
        Of an image: which variables to draw, side by side, in place of height and phase; those of `phasemap.channels`,
        for instance.
    mark_irregular : bool
        Whether dots mark the pixels of an image in which the motion is irregular. A sweep shows them always.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If `ds` holds no image, sweep, contrast, comparison or inversion, or not the variables to be drawn, the format
        is unknown, or irregular pixels are to be marked in an image that does not have the variable ``motion``.
    FileError
        If `path` cannot be written.

    Examples
    --------
    >>> import numpy as np, xarray as xr
    >>> x = ("x", 4e-9 * np.arange(8), {"units": "m"})
    >>> y = ("y", 4e-9 * np.arange(6), {"units": "m"})
    >>> hills = np.sin(np.arange(48.0)).reshape(6, 8)
    >>> ds = xr.Dataset({"height": (("y", "x"), 1e-9 * hills), "phase": (("y", "x"), 20 * hills)}, {"y": y, "x": x})
    >>> len(plot(ds).axes)
    6
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    if is_sweep(ds):
        return curve(ds, path, overwrite=overwrite)
    if is_contrast(ds):
        return contrast(ds, path, overwrite)
    if is_inversion(ds):
        return inversion(ds, path, overwrite)
    if is_comparison(ds):
        return comparison(ds, path, overwrite)
    names = ("height", "phase") if variables is None else tuple(variables)
    _check(ds, names, mark_irregular)
    rows = [ds.isel(direction=i) for i in range(ds.sizes["direction"])] if "direction" in ds.dims else [ds]
    length = _side_lengths(ds)
    tall = PANEL * min(max(length[1] / length[0], 0.2), 2.0)
    step = TITLE + tall + HISTOGRAM_GAP + HISTOGRAM + AXIS
    if variables is None and "amplitude_error" in ds:
        names = (*names, "amplitude_error")
    scales = {name: _scale_of(ds[name]) for name in names}
    notes = [(f"○ {line}" if mark_irregular else line, "0.25") for line in describe_irregular(ds)]
    notes += [(f"△ {line}", "0.25") for line in describe_validity(ds)]
    notes += [(f"■ {line}", "#00803a") for line in describe_failures(ds)]
    width = MARGIN + len(scales) * (PANEL + BAR_GAP + BAR + BAR_LABELS)
    notes = [(part, colour) for line, colour in notes for part in textwrap.wrap(line, int(LETTERS * width))]
    height = HEADER + len(rows) * step + LINE * (len(notes) + 0.5 * bool(notes))
    figure = Figure(figsize=(width, height))
    canvas = FigureCanvasAgg(figure)

    def axes_at(left: float, top: float, wide: float, high: float) -> Axes:
        return figure.add_axes((left / width, 1 - (top + high) / height, wide / width, high / height))

    for row, one in enumerate(rows):
        top = HEADER + row * step + TITLE
        for column, (name, scale) in enumerate(scales.items()):
            left = MARGIN + column * (PANEL + BAR_GAP + BAR + BAR_LABELS)
            title = [
                name.replace("_", " ").capitalize(),
                *([str(one["direction"].item())] if "direction" in one.coords else []),
            ]
            picture = axes_at(left, top, PANEL, tall)
            picture.set_title(", ".join(title), fontsize=11, loc="left")
            _draw_image(picture, axes_at(left + PANEL + BAR_GAP, top, BAR, tall), one, name, scale)
            if mark_irregular:
                _mark(picture, one["motion"].values == 1, (PANEL, tall))
            _draw_histogram(axes_at(left, top + tall + HISTOGRAM_GAP, PANEL, HISTOGRAM), one[name].values, scale)
    figure.text(MARGIN / width, 1 - 0.14 / height, _title(ds), fontsize=9, color="0.3", va="top")
    for above, (line, colour) in enumerate(reversed(notes)):
        figure.text(MARGIN / width, (0.5 + above) * LINE / height, line, fontsize=8, color=colour, va="bottom")
    if path is not None:
        save(canvas, path, overwrite)
    return figure


def _check(ds: xr.Dataset, names: tuple[str, ...], mark_irregular: bool) -> None:
    """Refuse what is not an image, or does not have what is to be drawn or marked."""
    for name in names:
        if name not in ds or ds[name].dtype.kind != "f":
            held = sorted(str(key) for key, one in ds.data_vars.items() if one.dtype.kind == "f")
            raise InputError("the dataset", held, f"an image with {' and '.join(names)}")
        dims = ds[name].dims
        if "sample" in dims:
            raise InputError("the dataset", f"an ensemble of {ds.sizes['sample']} images", "one of them (--sample N)")
        if dims not in (("y", "x"), ("direction", "y", "x")):
            raise InputError(f"dims of {name}", dims, "('y', 'x') or ('direction', 'y', 'x')")
    for dim in ("y", "x"):
        if dim not in ds.coords:
            raise InputError("the dataset", "without coordinates", f"an image with a coordinate {dim} [m]")
    if mark_irregular and "motion" not in ds:
        raise InputError("the dataset", "without motion", "an image that has this variable, to mark irregular pixels")


def _side_lengths(ds: xr.Dataset) -> tuple[float, float]:
    """Width and height of the image [m], to the outer edges of the pixels."""
    pitch = {dim: float(ds[dim][1] - ds[dim][0]) if ds.sizes[dim] > 1 else 0.0 for dim in ("x", "y")}
    width, height = (ds.sizes[dim] * (pitch[dim] or max(pitch.values()) or 1.0) for dim in ("x", "y"))
    return width, height


def _scale_of(variable: xr.DataArray) -> _Scale:
    """The scale of a variable: its own where it has one, else viridis in the unit that suits the range."""
    import matplotlib
    from matplotlib.colors import Normalize

    own = {"height": _height_scale, "phase": _phase_scale, "amplitude_error": _error_scale}
    name, values = str(variable.name), variable.values
    if name in own:
        return own[name](values)
    low, high = _limits(values)
    unit = readable(max(-low, high), variable.attrs.get("units", ""))
    low, high = low / unit.size, high / unit.size
    margin = MARGIN_OF_LIMITS * (high - low) or 0.5 * abs(high) or 0.5
    label = unit.label(name.replace("_", " "))
    return _Scale(label, 1 / unit.size, 0.0, matplotlib.colormaps["viridis"], Normalize(low - margin, high + margin))


def _height_scale(values: np.ndarray) -> _Scale:
    """afmhot from the lowest height shown, in the length unit that suits the range."""
    import matplotlib
    from matplotlib.colors import Normalize

    low, high = _limits(values)
    unit, size = length_unit(high - low)
    span = (high - low) / size or 1.0
    return _Scale(
        f"height ({unit})",
        1 / size,
        low,
        matplotlib.colormaps["afmhot"],
        Normalize(-MARGIN_OF_LIMITS * span, (1 + MARGIN_OF_LIMITS) * span),
    )


def _phase_scale(values: np.ndarray) -> _Scale:
    """cividis, or a diverging map centred on 0 where both regimes take a fair part of the range."""
    import matplotlib
    from matplotlib.colors import Normalize

    low, high = _limits(values)
    reach = max(-low, high)
    if min(-low, high) > 0.1 * reach:
        cmap, low, high = "coolwarm", -reach, reach
    else:
        cmap = "cividis"
    margin = MARGIN_OF_LIMITS * (high - low) if high - low > 1e-6 else 0.5  # do not blow up the last digits
    return _Scale("phase (degrees)", 1.0, 0.0, matplotlib.colormaps[cmap], Normalize(low - margin, high + margin))


def _error_scale(values: np.ndarray) -> _Scale:
    """Grey about 0, in the length unit that suits the range."""
    import matplotlib
    from matplotlib.colors import Normalize

    low, high = _limits(values)
    reach = max(-low, high, 1e-13)  # do not blow up the last digits
    unit, size = length_unit(reach)
    reach *= (1 + MARGIN_OF_LIMITS) / size
    return _Scale(f"amplitude error ({unit})", 1 / size, 0.0, matplotlib.colormaps["gray"], Normalize(-reach, reach))


def _limits(values: np.ndarray) -> tuple[float, float]:
    """The percentiles shown; (0, 0) if there is no finite value."""
    import numpy as np

    finite = values[np.isfinite(values)]
    if finite.size == 0:
        return 0.0, 0.0
    low, high = np.percentile(finite, LIMITS)
    if high == low:  # a few particles on a flat ground
        low, high = finite.min(), finite.max()
    return float(low), float(high)


def _draw_image(axes: Axes, bar_axes: Axes, ds: xr.Dataset, name: str, scale: _Scale) -> None:
    """One channel with colour bar, scale bar and the pixels that failed."""
    import numpy as np
    from matplotlib.colorbar import Colorbar
    from matplotlib.colors import ListedColormap
    from scipy.ndimage import maximum_filter

    width, height = _side_lengths(ds)
    extent = (0.0, width, height, 0.0)  # row 0 at the top
    shown = (ds[name].values - scale.offset) * scale.factor
    image = axes.imshow(shown, cmap=scale.cmap, norm=scale.norm, extent=extent, aspect="auto")
    failed = ds["status"].values != 0 if "status" in ds else ~np.isfinite(shown)
    if failed.any():
        grown = maximum_filter(failed, max(failed.shape) // 128 or 1)  # one pixel in a thousand must still be seen
        overlay = np.ma.masked_where(~grown, np.ones(failed.shape))
        axes.imshow(overlay, cmap=ListedColormap([FAILED]), extent=extent, aspect="auto", interpolation="nearest")
    axes.set(xticks=[], yticks=[])
    draw_scale_bar(axes, width)
    bar = Colorbar(bar_axes, image)
    bar.set_label(scale.label, fontsize=9)
    bar_axes.tick_params(labelsize=8)


def _mark(axes: Axes, marked: np.ndarray, size: tuple[float, float]) -> None:
    """Dots on the pixels that are marked, as many as can be told apart on a picture of this width and height [inch]."""
    import numpy as np
    from scipy.ndimage import maximum_filter

    ny, nx = marked.shape
    across, down = (max(round(72 * side / DOT_PITCH), 1) for side in size)
    middle = [((np.arange(count) + 0.5) * n / count).astype(int) for count, n in ((down, ny), (across, nx))]
    dotted = marked[np.ix_(*middle)]  # a dot in the middle of each cell of the page
    rows, columns = np.nonzero(marked)
    cells = rows * down // ny, columns * across // nx
    lone = np.flatnonzero(~maximum_filter(dotted, 3)[cells])  # and where that leaves pixels far from any dot
    first = lone[np.unique((cells[0] * across + cells[1])[lone], return_index=True)[1]]
    rows, columns = (
        np.append(mid[at], more)
        for mid, at, more in zip(middle, np.nonzero(dotted), (rows[first], columns[first]), strict=True)
    )
    x, y = (columns + 0.5) / nx, 1 - (rows + 0.5) / ny
    axes.plot(x, y, transform=axes.transAxes, scalex=False, scaley=False, gid="irregular", **DOT)


def _draw_histogram(axes: Axes, values: np.ndarray, scale: _Scale) -> None:
    """How often each value occurs, in the colours of the image."""
    import numpy as np

    low, high = float(scale.norm.vmin or 0.0), float(scale.norm.vmax or 0.0)
    shown = (values[np.isfinite(values)] - scale.offset) * scale.factor
    counts, edges = np.histogram(shown, bins=100, range=(low, high))
    centres = 0.5 * (edges[1:] + edges[:-1])
    axes.bar(
        centres, counts, width=np.diff(edges), color=scale.cmap(scale.norm(centres)), edgecolor="0.25", linewidth=0.25
    )
    axes.set_xlim(low, high)
    axes.set_yticks([])
    axes.set_xlabel(scale.label, fontsize=9)
    axes.tick_params(labelsize=8)
    axes.spines[["top", "left", "right"]].set_visible(False)


def _title(ds: xr.Dataset) -> str:
    """Setpoint, solvers and size, as far as the dataset says them."""
    said = []
    configuration = json.loads(ds.attrs.get("configuration", "{}"))
    if "setpoint" in configuration:
        said.append(f"setpoint {configuration['setpoint']:g}")
    if "solver" in ds:
        said.append("solver " + describe_flags(ds["solver"]))
    if "line_rate" in (control := configuration.get("control", {})):
        said.append(f"{control['line_rate']:g} lines a second")
    said.append(f"{ds.sizes['x']} × {ds.sizes['y']} pixels")
    return "   ·   ".join(said)
