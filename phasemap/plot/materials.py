"""Picture of an inversion: maps of modulus, adhesion and damping, and how far to believe them."""

from __future__ import annotations

import os
import textwrap
from typing import TYPE_CHECKING

import numpy as np

from phasemap._shared.errors import InputError
from phasemap.plot.figure import save
from phasemap.plot.region_fit import regions

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

__all__ = ["inversion", "is_inversion"]

SHOWN = {"modulus": ("modulus (GPa)", 1e-9), "adhesion": ("adhesion (J/m²)", 1.0), "damping": ("damping α₁", 1.0)}
LIMITS = (1, 99)  # percentiles shown
UNSURE = "0.85"
LOST = "#00e646"  # green is in none of the maps
WORST = 0.5  # standard error of a logarithm at the end of the scale
LETTERS = 140  # in a line below

# Sizes on the page [inch].
PANEL, BAR, BAR_GAP, BAR_LABELS, MARGIN, TITLE, HEADER, LINE = 2.5, 0.1, 0.06, 0.68, 0.25, 0.3, 0.3, 0.17


def inversion(ds: xr.Dataset, path: str | os.PathLike[str] | None = None, overwrite: bool = False) -> Figure:
    """Draw the maps of an inversion above, on logarithmic scales, and their standard errors below.

    The errors are those of the natural logarithm: 0.1 is 10 %. Where the data do not determine a property, or the model
    does not describe them, the map is grey and hatched; pixels without a solution are green. Lines below say how many.
    A fit by regions is drawn as `phasemap.plot.region_fit.regions` says.

    Parameters
    ----------
    ds : xarray.Dataset
        What `phasemap.invert` or `phasemap.fit_regions` returned.
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
        If `ds` is no inversion, or the format is unknown.
    FileError
        If `path` cannot be written.

    Examples
    --------
    >>> import numpy as np, xarray as xr
    >>> one = ("y", "x"), np.full((4, 6), 0.1)
    >>> names = [name + end for name in SHOWN for end in ("", "_error")]
    >>> ds = xr.Dataset({**dict.fromkeys(names, one), "flag": (("y", "x"), np.zeros((4, 6), np.uint8))})
    >>> [axes.get_title(loc="left") for axes in inversion(ds).axes if axes.get_title(loc="left")][:2]
    ['modulus (GPa)', 'standard error of its logarithm']
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.colors import LogNorm, Normalize
    from matplotlib.figure import Figure

    if not is_inversion(ds):
        raise InputError("the dataset", sorted(map(str, ds.data_vars)), "what phasemap.invert returned")
    if "region" in ds["flag"].dims:
        return regions(ds, path, overwrite)
    said = textwrap.wrap(str(ds.attrs.get("verdict", "")), LETTERS)
    said += ["grey, hatched: not determined, or poor fit    green: no solution"]
    rows, columns = ds["flag"].shape
    tall = PANEL * min(max(rows / columns, 0.2), 2.0)
    step = PANEL + BAR_GAP + BAR + BAR_LABELS
    width, height = MARGIN + 3 * step, HEADER + 2 * (TITLE + tall) + LINE * (len(said) + 1.5)
    figure = Figure(figsize=(width, height))
    canvas = FigureCanvasAgg(figure)
    masks = dict(zip(_meanings(ds), 1 << np.arange(8), strict=False))
    flags = ds["flag"].values.astype(int)
    lost = flags & (masks.get("no_orbit", 0) | masks.get("no_data", 0)) != 0
    for i, (name, (label, factor)) in enumerate(SHOWN.items()):
        hatched = flags & (masks.get(f"{name}_not_determined", 0) | masks.get("poor_fit", 0)) != 0
        values = factor * ds[name].values
        sure = values[np.isfinite(values) & ~hatched]
        sure = sure if sure.size else values[np.isfinite(values)]
        low, high = np.percentile(sure, LIMITS) if sure.size else (1.0, 10.0)
        scales = LogNorm(low / 1.05, high * 1.05), Normalize(0, WORST)
        maps = values, ds[f"{name}_error"].values
        titles = label, "standard error of its logarithm"
        for row, (shown, norm, cmap) in enumerate(zip(maps, scales, ("plasma", "magma_r"), strict=True)):
            left, top = MARGIN + i * step, HEADER + TITLE + row * (TITLE + tall)
            place = (left / width, 1 - (top + tall) / height, PANEL / width, tall / height)
            axes = figure.add_axes(place)
            image = axes.imshow(shown, cmap=cmap, norm=norm, aspect="auto", interpolation="nearest")
            axes.set_title(titles[row], fontsize=10 - row, loc="left")
            _mark(axes, hatched & ~lost & (row == 0), lost)
            bar = figure.add_axes(((left + PANEL + BAR_GAP) / width, place[1], BAR / width, place[3]))
            _draw_bar(bar, image, row == 0)
    count = ds.sizes.get("image", 0)
    title = f"inversion of {count} images   ·   {columns} × {rows} pixels"
    figure.text(MARGIN / width, 1 - 0.1 / height, title, fontsize=9, color="0.3", va="top")
    figure.text(MARGIN / width, 0.5 * LINE / height, "\n".join(said), fontsize=8, va="bottom", linespacing=1.4)
    if path is not None:
        save(canvas, path, overwrite)
    return figure


def is_inversion(ds: xr.Dataset) -> bool:
    """Whether a Dataset is of an inversion, by pixels or by regions.

    Parameters
    ----------
    ds : xarray.Dataset

    Returns
    -------
    bool
    """
    return (
        all(f"{name}_error" in ds for name in SHOWN) and "flag" in ds and ds["flag"].dims in (("y", "x"), ("region",))
    )


def _meanings(ds: xr.Dataset) -> list[str]:
    return str(ds["flag"].attrs.get("flag_meanings", "")).split()


def _draw_bar(axes: Axes, image: AxesImage, logarithmic: bool) -> None:
    """A colour bar; on a logarithmic one few numbers, without powers."""
    from matplotlib.colorbar import Colorbar
    from matplotlib.ticker import LogLocator, NullFormatter, NullLocator

    bar = Colorbar(axes, image, extend="neither" if logarithmic else "max")
    if logarithmic:
        low, high = image.get_clim()
        wide = high > 20 * low
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0,) if wide else (1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.yaxis.set_minor_locator(NullLocator())
        axes.yaxis.set_minor_formatter(NullFormatter())
    bar.ax.tick_params(labelsize=8)


def _mark(axes: Axes, hatched: np.ndarray, lost: np.ndarray) -> None:
    """Paint one set of pixels grey and hatch it, and paint another green."""
    from matplotlib.colors import ListedColormap

    for pixels, color in ((hatched, UNSURE), (lost, LOST)):
        if pixels.any():
            overlay = np.ma.masked_where(~pixels, np.ones(pixels.shape))
            axes.imshow(overlay, cmap=ListedColormap([color]), aspect="auto", interpolation="nearest")
    if hatched.any():
        padded = np.pad(hatched.astype(float), 1, mode="edge")
        y, x = (np.arange(-1, count + 1) for count in hatched.shape)
        areas = axes.contourf(x, y, padded, levels=[0.5, 1.5], colors="none", hatches=["////////"])
        areas.set_edgecolor("0.6")
        areas.set_linewidth(0)
    axes.set(xticks=[], yticks=[], xlim=(-0.5, lost.shape[1] - 0.5), ylim=(lost.shape[0] - 0.5, -0.5))
