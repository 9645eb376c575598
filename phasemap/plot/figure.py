"""What all pictures share: how they are saved, scale bars, and what they say about values that are missing."""

from __future__ import annotations

import math
import os
from typing import TYPE_CHECKING

from phasemap._shared.errors import InputError
from phasemap._shared.units import say
from phasemap.results.status import Status

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.backends.backend_agg import FigureCanvasAgg

FAILED = "#00e646"  # green is in none of afmhot, cividis and coolwarm
LENGTH_UNITS = (("µm", 1e-6), ("nm", 1e-9), ("pm", 1e-12))
RESOLUTION = 200  # of a saved picture [dots per inch]


def save(canvas: FigureCanvasAgg, path: str | os.PathLike[str], overwrite: bool) -> None:
    """Write the picture whole or not at all.

    Raises
    ------
    InputError
        If the format is unknown.
    FileError
        If `path` cannot be written.
    """
    from phasemap.io.netcdf import replacing

    check_format(path)
    with replacing(path, overwrite) as temporary:
        canvas.print_figure(temporary, dpi=RESOLUTION)


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


def describe_failures(ds: xr.Dataset, what: str = "pixels") -> list[str]:
    """Say how many pixels have no solution, why, and what helps.

    Parameters
    ----------
    ds : xarray.Dataset
        An image or a sweep.
    what : str
        What there are many of.

    Returns
    -------
    list of str
        One line for each way a pixel failed; empty if none did.

    Examples
    --------
    >>> import xarray as xr
    >>> describe_failures(xr.Dataset({"status": ("x", [0, 0, 0, 4])}))[0][:44]
    '1 of 4 pixels (25 %): What the tip does here'
    """
    import numpy as np

    if "status" not in ds:
        return []
    codes, counts = np.unique(ds["status"].values, return_counts=True)
    total = ds["status"].size
    return [
        f"{count} of {total} {what} ({100 * count / total:.3g} %): {Status.of(int(code)).value}"
        for code, count in zip(codes, counts, strict=True)
        if code != 0
    ]


def describe_irregular(ds: xr.Dataset, what: str = "pixels") -> list[str]:
    """Say how many pixels show the mean of motion that is not periodic, and how far it is spread.

    Parameters
    ----------
    ds : xarray.Dataset
        An image or a sweep.
    what : str
        What there are many of.

    Returns
    -------
    list of str
        One line; empty if there are none, or if the dataset does not say.

    Examples
    --------
    >>> import xarray as xr
    >>> describe_irregular(xr.Dataset({"motion": ("x", [0, 0, 1]), "phase_spread": ("x", [0.0, 0.0, 0.02])}))
    ['1 of 3 pixels (33.3 %) irregular: mean amplitude and phase, spread up to 0.02 degrees']
    """
    import numpy as np

    count = int(np.count_nonzero(ds["motion"].values == 1)) if "motion" in ds else 0
    if not count:
        return []
    spreads = [
        say(float(np.nanmax(ds[name].values)), units, 2)
        for name, units in (("amplitude_spread", "m"), ("phase_spread", "degree"))
        if name in ds
    ]
    most = f", spread up to {' and '.join(spreads)}" if spreads else ""
    total = ds["motion"].size
    return [f"{count} of {total} {what} ({100 * count / total:.3g} %) irregular: mean amplitude and phase{most}"]


def describe_flags(flags: xr.DataArray) -> str:
    """Say which flags occur and how often, most frequent first.

    Parameters
    ----------
    flags : xarray.DataArray
        Integers with the CF attributes ``flag_values`` and ``flag_meanings``.

    Returns
    -------
    str

    Examples
    --------
    >>> import xarray as xr
    >>> attrs = {"flag_values": [0, 1], "flag_meanings": "averaging orbit"}
    >>> describe_flags(xr.DataArray([0, 0, 0, 1], dims="x", attrs=attrs))
    'averaging 75 %, orbit 25 %'
    """
    import numpy as np

    meanings = flags.attrs["flag_meanings"].split()
    names: dict[int, str] = dict(zip(np.atleast_1d(flags.attrs["flag_values"]).tolist(), meanings, strict=True))
    values, counts = np.unique(flags.values, return_counts=True)
    order = np.argsort(-counts)
    if len(values) == 1:
        return names.get(int(values[0]), "none")
    return ", ".join(f"{names.get(int(values[i]), 'none')} {100 * counts[i] / flags.size:.3g} %" for i in order)


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
