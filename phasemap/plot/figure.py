"""What all pictures share: scale bars, and what they say about values that are missing."""

from __future__ import annotations

import math
import os
from typing import TYPE_CHECKING

from phasemap._shared.errors import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LENGTH_UNITS = (("µm", 1e-6), ("nm", 1e-9), ("pm", 1e-12))
RESOLUTION = 200  # of a saved picture [dots per inch]


def check_format(path: str | os.PathLike[str]) -> None:
    """Refuse a suffix that is no format of pictures.

    Raises
    ------
    InputError
    """
    from matplotlib.backend_bases import FigureCanvasBase

    suffix, formats = os.path.splitext(path)[1], sorted(FigureCanvasBase.get_supported_filetypes())
    if suffix.lstrip(".").lower() not in formats:
        raise InputError("the picture's suffix", suffix, "one of " + ", ".join(f".{name}" for name in formats))


def length_unit(length: float) -> tuple[str, float]:
    """Choose the largest unit in which `length` is at least 1.

    Examples
    --------
    >>> length_unit(4e-7)
    ('nm', 1e-09)
    """
    return next(((unit, size) for unit, size in LENGTH_UNITS if length >= size), LENGTH_UNITS[1])


def draw_scale_bar(axes: Axes, width: float) -> None:
    """Draw a bar of 1, 2 or 5 times a power of ten, at most a third of the width, white on any ground.

    Parameters
    ----------
    axes : Axes
        Of an image, x in metres from 0.
    width : float
        Of the image [m].
    """
    from matplotlib.patheffects import withStroke

    length = _round_length(width / 3)
    unit, size = length_unit(length * (1 + 1e-9))
    outline = [withStroke(linewidth=4.5, foreground="black")]
    left, place = 0.05 * width, axes.get_xaxis_transform()  # x in the image, y as a fraction of the axes
    axes.plot(
        [left, left + length],
        [0.06, 0.06],
        transform=place,
        color="white",
        linewidth=3.5,
        solid_capstyle="butt",
        path_effects=outline,
        scalex=False,
        scaley=False,
    )
    axes.annotate(
        f"{length / size:.0f} {unit}",
        (left + length / 2, 0.06),
        xycoords=place,
        xytext=(0, 4),
        textcoords="offset points",
        ha="center",
        va="bottom",
        color="white",
        fontsize=9,
        fontweight="bold",
        path_effects=[withStroke(linewidth=1.5, foreground="black")],
    )


def _round_length(longest: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above `longest`."""
    decade = 10.0 ** math.floor(math.log10(longest))
    return max(step * decade for step in (1, 2, 5) if step * decade <= longest * (1 + 1e-9))
