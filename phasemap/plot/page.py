"""The page of every picture: titles, notes, a legend, panels, colour bars and scale bars; and formats of files."""

from __future__ import annotations

import io
import math
import os
import textwrap
from collections.abc import Iterable, Sequence
from typing import Any, Literal

import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backend_bases import FigureCanvasBase
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colorbar import Colorbar
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.patheffects import withStroke
from matplotlib.textpath import text_to_path
from matplotlib.ticker import LogLocator, NullFormatter
from matplotlib.transforms import Bbox

from phasemap._shared.errors import InputError
from phasemap._shared.files import replacing
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
    """Draw a bar of 1, 2 or 5 times a power of ten [m], at most a third of the width, white on any ground."""
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
    given = [ax] if hasattr(ax, "plot") else list(np.ravel(np.asarray(ax, object)))
    if len(given) != len(names) or not all(hasattr(axes, "plot") for axes in given):
        raise InputError("ax", len(given), f"{len(names)} Axes, one for each of {', '.join(names)}")
    if path is not None:
        raise InputError("path", str(path), "None where ax is given", "Save the figure: fig.savefig(path).")
    return given


LINE, KEYS, EDGE = 0.17, 0.23, 0.12  # heights of a line and of a row of the legend, and the page's edge [inch]
LETTER, KEY, PAD, SPACE = 8.0, 2.2, 0.8, 1.4  # of the legend: size [points], and in letters: keys and what is between
BAR_GAP, BAR = 0.07, 0.12  # beside a map, and width of its colour bar [inch]
LETTERS = 15.5  # of a line of small print [1/inch]
ON_SCREEN = 100  # of a picture in a notebook [dots per inch]
TITLE: dict[str, Any] = {"fontsize": 9.5, "color": "0.1"}
SMALL: dict[str, Any] = {"fontsize": 8, "color": "0.35"}

Lines = Iterable[str | tuple[str, str]]


class Page(Figure):
    """A figure that is laid out in inches, from the top left corner below its titles and its legend.

    It is a matplotlib Figure with a canvas of its own, so nothing global is touched, and a notebook shows it.

    `body`: height of what is between legend and notes [inch].
    `head`: lines above, of which the first `titles` are the title.
    `keys`: rows of the legend; what is too wide for the page goes on in the next.
    `notes`: lines below, with their colour if it is not grey; they are wrapped.
    `left`: where titles and legend begin [inch].
    """

    def __init__(
        self, width: float, body: float, head: Sequence[str] = (), keys: Sequence[Sequence[Artist]] = (),
        notes: Lines = (), *, left: float = 0.25, titles: int = 1,
    ) -> None:  # fmt: skip
        self._top = EDGE + LINE * len(head) + 0.06
        below = list(_wrapped(notes, int(LETTERS * (width - 2 * EDGE))))
        keys = [part for row in keys for part in _that_fit(row, 72 * (width - left - EDGE))]
        tall = self._top + KEYS * len(keys) + body + LINE * (len(below) + 0.5 * bool(below))
        super().__init__(figsize=(width, tall))
        FigureCanvasAgg(self)
        for i, line in enumerate(head):
            self.text(left / width, 1 - (EDGE + i * LINE) / tall, line, va="top", **(TITLE if i < titles else SMALL))
        for i, (line, colour) in enumerate(below):
            bottom = (len(below) - 0.5 - i) * LINE / tall
            self.text(EDGE / width, bottom, line, fontsize=8, color=colour, va="bottom")
        for row in keys:
            self.legend(
                handles=list(row), loc="upper left", bbox_to_anchor=((left + 0.05) / width, 1 - self._top / tall),
                ncols=len(row), fontsize=LETTER, frameon=False, borderpad=0, borderaxespad=0, handlelength=KEY,
                handletextpad=PAD, columnspacing=SPACE,
            )  # fmt: skip
            self._top += KEYS

    def write(self, left: float, top: float, text: str, **style: Any) -> None:
        """Write a line at a place [inch]."""
        width, tall = self.get_size_inches()
        self.text(left / width, 1 - (self._top + top) / tall, text, va="top", **{"fontsize": 8, **style})

    def place(self, left: float, top: float, wide: float, high: float, title: str = "", **options: Any) -> Axes:
        """Add axes at a place [inch], with a title on the left and small numbers."""
        width, tall = self.get_size_inches()
        place = left / width, 1 - (self._top + top + high) / tall, wide / width, high / tall
        axes = self.add_axes(place, **options)
        axes.set_title(title, fontsize=10, loc="left", pad=4)
        axes.tick_params(labelsize=8)
        return axes

    def picture(self, left: float, top: float, wide: float, high: float, title: str = "") -> Axes:
        """Add axes for a map: without ticks."""
        axes = self.place(left, top, wide, high, title)
        axes.set(xticks=[], yticks=[])
        return axes

    def panel(self, left: float, top: float, wide: float, high: float, title: str = "", **options: Any) -> Axes:
        """Add axes for curves: without a frame."""
        axes = self.place(left, top, wide, high, title, **options)
        axes.spines[["top", "right"]].set_visible(False)
        return axes

    def bar(self, shown: Any, beside: Sequence[Axes], label: str = "", **options: Any) -> Colorbar:
        """Add the colour bar of what is shown, on the right of all its axes; pointed where values lie beyond."""
        width, place = self.get_size_inches()[0], Bbox.union([axes.get_position() for axes in beside])
        alike = [one for axes in self.axes for one in (*axes.images, *axes.collections) if one.norm is shown.norm]
        axes = self.add_axes((place.x1 + BAR_GAP / width, place.y0, BAR / width, place.height))
        bar = Colorbar(axes, shown, extend=beyond(alike), **options)
        bar.set_label(label, fontsize=9)
        axes.tick_params(labelsize=8)
        return bar

    def finished(self, path: str | os.PathLike[str] | None, overwrite: bool) -> Page:
        """Align what is written beside the axes, and save the page, whole or not at all, where it has a path."""
        self.align_ylabels()
        if path is not None:
            check_format(path)
            with replacing(path, overwrite) as temporary:
                self.canvas.print_figure(temporary, dpi=RESOLUTION)
        return self

    def _repr_png_(self) -> bytes:
        """PNG that a notebook shows."""
        drawn = io.BytesIO()
        self.canvas.print_figure(drawn, format="png", dpi=ON_SCREEN)
        return drawn.getvalue()


def beyond(shown: Iterable[Any]) -> Literal["neither", "min", "max", "both"]:
    """At which ends of a colour bar values lie beyond its colours: "neither", "min", "max" or "both"."""
    below = above = False
    for mesh in shown:
        values = np.ma.masked_invalid(mesh.get_array()).compressed()
        spare = 1e-9 * abs(mesh.norm.vmax - mesh.norm.vmin)
        below |= bool((values < mesh.norm.vmin - spare).any())
        above |= bool((values > mesh.norm.vmax + spare).any())
    return "both" if below and above else "min" if below else "max" if above else "neither"


def _that_fit(row: Sequence[Artist], room: float) -> list[list[Artist]]:
    """Keys of the legend in rows of such a width [points]."""
    rows: list[list[Artist]] = []
    spent = math.inf
    for key in row:
        text = text_to_path.get_text_width_height_descent(str(key.get_label()), FontProperties(size=LETTER), False)[0]
        wide = text + LETTER * (KEY + PAD)
        if spent + LETTER * SPACE + wide > room:
            rows.append([])
            spent = -LETTER * SPACE
        rows[-1].append(key)
        spent += LETTER * SPACE + wide
    return rows


def _wrapped(notes: Lines, most: int) -> Iterable[tuple[str, str]]:
    """Notes in lines that fit the page, with their colours."""
    for note in notes:
        line, colour = (note, "0.25") if isinstance(note, str) else note
        for part in textwrap.wrap(line, most, subsequent_indent="    "):
            yield part, colour
