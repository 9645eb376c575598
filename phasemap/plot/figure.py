"""What pictures share beside their page: scale bars, lengths of sides, names cut short, formats of files."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backend_bases import FigureCanvasBase
from matplotlib.patheffects import withStroke
from matplotlib.ticker import LogLocator, NullFormatter

from phasemap._shared.errors import InputError
from phasemap._shared.units import readable

RESOLUTION = 200  # of a saved picture [dots per inch]


def check_format(path: str | os.PathLike[str]) -> None:
    """Refuse a suffix that is no format of pictures."""
    suffix, formats = os.path.splitext(path)[1], sorted(FigureCanvasBase.get_supported_filetypes())
    if suffix.lstrip(".").lower() not in formats:
        raise InputError("the picture's suffix", suffix, "one of " + ", ".join(f".{name}" for name in formats))


def side_lengths(ds: xr.Dataset) -> tuple[float, float]:
    """Width and height of an image [m], to the outer edges of the pixels; a lone row or column is as wide as others."""
    pitch = {dim: abs(float(ds[dim][1] - ds[dim][0])) if ds.sizes[dim] > 1 else 0.0 for dim in ("x", "y")}
    width, height = (ds.sizes[dim] * (pitch[dim] or max(pitch.values()) or 1.0) for dim in ("x", "y"))
    return width, height


def shortened(text: str, most: int) -> str:
    """Return text, or its beginning where there is no room for all of it."""
    return text if len(text) <= most else text[: most - 1] + "…"


def draw_scale_bar(axes: Axes) -> None:
    """Draw a bar of 1, 2 or 5 times a power of ten, at most a third of the width, white on any ground.

    `axes`: of an image, x in metres from 0.
    """
    width, place = axes.get_xlim()[1], axes.get_xaxis_transform()  # x in the image, y as a fraction of the axes
    decade = 10.0 ** math.floor(math.log10(width / 3))
    length = max(step * decade for step in (1, 2, 5) if step * decade <= width / 3 * (1 + 1e-9))
    unit, left = readable(length, "m"), 0.05 * width
    axes.plot(
        [left, left + length], [0.06, 0.06], transform=place, color="white", linewidth=3.5, solid_capstyle="butt",
        path_effects=[withStroke(linewidth=4.5, foreground="black")], scalex=False, scaley=False,
    )  # fmt: skip
    axes.annotate(
        f"{length / unit.size:.0f} {unit.text}", (left + length / 2, 0.06), xycoords=place, xytext=(0, 4),
        textcoords="offset points", ha="center", va="bottom", color="white", fontsize=9, fontweight="bold",
        path_effects=[withStroke(linewidth=1.5, foreground="black")],
    )  # fmt: skip


def round_numbers(axis: Axis, digits: Sequence[float] = (1.0, 2.0, 5.0)) -> None:
    """Let a logarithmic axis have numbers at these digits of every power of ten, without exponents."""
    axis.set_major_locator(LogLocator(subs=digits))
    axis.set_major_formatter(lambda value, _: f"{value:g}")
    axis.set_minor_formatter(NullFormatter())


def own_axes(ax: Any, names: Sequence[str], path: object) -> list[Axes]:
    """Axes of the user's own figure, one for each name; their figure is not saved here."""
    own = [ax] if hasattr(ax, "plot") else list(np.ravel(np.asarray(ax, object)))
    if len(own) != len(names) or not all(hasattr(axes, "plot") for axes in own):
        raise InputError("ax", len(own), f"{len(names)} Axes, one for each of {', '.join(names)}")
    if path is not None:
        raise InputError("path", str(path), "None where ax is given", "Save the figure: fig.savefig(path).")
    return own
