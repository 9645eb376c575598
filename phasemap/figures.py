"""What all pictures share: how they are saved, and what they say about values that are missing."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from phasemap.errors import InputError
from phasemap.status import Status

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.backends.backend_agg import FigureCanvasAgg

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
    >>> describe_failures(xr.Dataset({"status": ("x", [0, 0, 0, 4])}))[0][:47]
    '1 of 4 pixels (25 %): The march did not settle '
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
