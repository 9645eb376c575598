"""Measured amplitude and phase against distance: columns of a text file or Igor wave in the one form of a curve."""

from __future__ import annotations

import gzip
import os
import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from phasemap._shared.asked import asked_as
from phasemap._shared.checks import whole
from phasemap._shared.errors import FileError, InputError
from phasemap._shared.notices import tell
from phasemap.io.gwyddion import extra
from phasemap.io.kinds import KINDS, METRES
from phasemap.io.metadata import ScanData
from phasemap.io.netcdf_image import NETCDF
from phasemap.io.vendors import scan_data

DIRECTIONS = ("approach", "retract")
WAYS = {
    "approach": re.compile(r"\b(?:approach|extend|ext|trace|forward)\b", re.IGNORECASE),
    "retract": re.compile(r"\b(?:retract|withdraw(?:al)?|ret|retrace|backward)\b", re.IGNORECASE),
}
NAMES = {
    "distance": (re.compile(r"z\b|z[ -]?(?:piezo|sensor)|zsnsr|raw|distance|height|piezo|tip.?offset", re.I), METRES),
    "amplitude": (re.compile("amp", re.I), KINDS["amplitude"].units),
    "phase": (re.compile("phase|lag", re.I), KINDS["phase"].units),
    "deflection": (re.compile("defl", re.I), KINDS["amplitude"].units),
}
"""How the columns of a quantity are called, and its units."""
COLUMN = re.compile(r"\s*(?P<name>.*?)\s*(?:[\[(](?P<unit>[^\])]*)[\])])?\s*")
EXAMPLE = "columns=('distance approach [m]', None, 'amplitude approach [V]', 'phase approach [degree]')"
TEXT = (".txt", ".csv", ".tsv", ".dat", ".asc")
FAR = 0.1  # of the points, farthest from the surface, that show the free lever
FREE = 0.005  # of the amplitude, that it changes over these points at most
WINDOW = 0.2  # of the range of distances, over which the amplitude's slope is taken
FEWEST = 20  # points of a curve


class Column(NamedTuple):
    """What a column holds."""

    quantity: str
    direction: str | None  # "approach" or "retract"; None where both stand one below the other
    factor: float  # to `unit`
    unit: str
    lag: bool  # whether the name says that it is a lag


@asked_as()
def read_curve(
    path: str | os.PathLike[str], *, columns: Sequence[str | None] | None = None, number: int = 0
) -> xr.Dataset:
    """Read a measured curve of amplitude and phase against distance.

    Parameters
    ----------
    path : path-like
        Text with columns (.gz or not), an Igor wave as Asylum Research writes curves (.ibw), or a distance sweep of
        phasemap in netCDF.
    columns : sequence of str or None, optional
        What the columns of text are, in order: a quantity (distance, amplitude, phase, lag, deflection), approach or
        retract where each has a column of its own, and the unit in brackets; None for a column that is left out. By
        default the line above the numbers says it. Where a file has several times as many, each set is a curve.
    number : int
        Which curve of the file, counted from 0.

    Returns
    -------
    xarray.Dataset
        Over ("direction", "point"), NaN beyond the last point: `distance` [m], 0 where the tip was nearest,
        `amplitude` [m or V], `phase` [degree, as recorded], `deflection` where there. In the attributes, as of
        `phasemap.read_image`, what the file says, and what the curve itself does: free_amplitude or
        free_amplitude_voltage and phase_zero, of its far end; amplitude_sensitivity [m/V], of its steepest slope, which
        is 1 of a hard surface and less of a soft one: the largest that there may be; phase_sign. ``warnings`` are
        sentences on all that is not recorded, a line each.

    Examples
    --------
    >>> read_curve("curve.txt")
    Traceback (most recent call last):
    ...
    phasemap.FileError: cannot read curve.txt: there is no such file.
    """
    path, number = Path(path), whole("number", number, 0)
    if not os.path.isfile(path):  # nor is a name that is no name
        raise FileError(f"cannot read {path}: {'it is a folder' if os.path.isdir(path) else 'there is no such file'}.")
    if path.suffix.lower() in NETCDF:
        parts, scan = _of_sweep(path), ScanData()
    elif path.suffix.lower() == ".ibw":
        parts, scan = _of_wave(path)
    else:
        parts, scan = _of_text(path, columns, number), ScanData()
    ds = _assembled(path, parts)
    _say_more(ds, scan)
    ds.attrs = {"source": path.name, **scan.values, "warnings": "\n".join(scan.warnings)}
    tell(scan.warnings)
    return ds


def is_curve(path: Path) -> bool:
    """Whether a file holds a curve: text, or an Igor wave without a second side of pixels."""
    if path.suffix.lower() != ".ibw" or not path.is_file():
        return path.with_suffix("").suffix.lower() in TEXT if path.suffix == ".gz" else path.suffix.lower() in TEXT
    with path.open("rb") as file:
        head = file.read(160)
    return int.from_bytes(head[140:144], "little") == 0  # no third dimension


Parts = dict[tuple[str, str | None], tuple["np.ndarray", str]]  # values and unit by quantity and direction


def _of_text(path: Path, columns: Sequence[str | None] | None, number: int) -> Parts:
    """The columns of a text."""
    try:
        with gzip.open(path, "rt") if path.suffix == ".gz" else path.open() as file:
            lines = [line.strip() for line in file if line.strip()]
    except (OSError, UnicodeError, EOFError) as error:
        raise FileError(
            f"cannot read {path}: it is no text. Curves are read from .ibw, netCDF, or columns of text: export the "
            "curve from the instrument's program as text (ASCII)."
        ) from error
    first = next((i for i, line in enumerate(lines) if _numbers(line)), len(lines))
    wide = len(_numbers(lines[first])) if first < len(lines) else 0
    rows = [row for row in map(_numbers, lines[first:]) if len(row) == wide]
    if len(rows) < FEWEST:
        raise FileError(f"cannot use {path}: it has {len(rows)} rows of numbers; a curve has {FEWEST} at least.")
    names = list(columns) if columns is not None else _heading(lines[first - 1]) if first else []
    if not names or wide % len(names):
        raise FileError(
            f"cannot use {path}: it has {wide} columns and names of {len(names)}; say what they are, such as {EXAMPLE}."
        )
    if number >= wide // len(names):
        raise InputError("number", number, f"0 to {wide // len(names) - 1}, the curves of {path.name}")
    table = np.array(rows)[:, number * len(names) : (number + 1) * len(names)]
    table = table[: 1 + int(np.flatnonzero(table.any(axis=1)).max(initial=0))]
    given = columns is not None
    return _parts([_column(name, given) for name in names], table)


def _numbers(line: str) -> list[float]:
    """The numbers of a line; none if one of its words is not a number."""
    try:
        return [float(word) for word in re.split(r"[\s;,]+", line.strip(" ,;"))]
    except ValueError:
        return []


def _heading(line: str) -> list[str]:
    """The names that a line gives to columns."""
    line = line.lstrip("#% ")
    mark = next((one for one in ("\t", ";", ",") if one in line), None)
    return [word.strip() for word in (line.split(mark) if mark else re.split(r"\s{2,}", line))]


def _column(name: str | None, given: bool) -> Column | None:
    """What a column of this name holds; None of one that is left out, or that no quantity is called.

    `given`: whether the user says so, and not the file.
    """
    found = COLUMN.fullmatch(name or "")
    if not name or found is None:
        return None
    quantity = next((one for one, (called, _) in NAMES.items() if called.match(found["name"])), None)
    if quantity is None:
        if given:
            raise InputError("columns", name, f"{', '.join(NAMES)} with a unit, such as {EXAMPLE}, or None")
        return None
    units = NAMES[quantity][1]
    unit = (found["unit"] or "").strip()
    if unit not in units:
        raise InputError(f"unit of the column {name!r}", unit or None, "one of " + ", ".join(units))
    way = next((one for one, said in WAYS.items() if said.search(found["name"])), None)
    return Column(quantity, way, *units[unit], "lag" in found["name"].lower())


def _parts(columns: Sequence[Column | None], table: np.ndarray) -> Parts:
    """Values of each quantity and direction, the first column of several; a lag counts the other way."""
    parts: Parts = {}
    for column, values in zip(columns, table.T, strict=True):
        if column is not None:
            unit = "lag" if column.lag else column.unit
            parts.setdefault((column.quantity, column.direction), (values * column.factor, unit))
    return parts


def _of_wave(path: Path) -> tuple[Parts, ScanData]:
    """The columns of an Igor wave, which its labels name, and what its note says; all is in SI units and degrees."""
    igor = extra("igor2.binarywave", "reading curves of Igor", "read")
    try:
        wave = igor.load(str(path))["wave"]
        table = np.asarray(wave["wData"], float)
        labels = [one.decode("latin-1") for one in wave["labels"][1][1:]]
        note = dict(line.split(":", 1) for line in wave["note"].decode("latin-1").splitlines() if ":" in line)
    except Exception as error:  # of whatever is met in a damaged file
        raise FileError(f"cannot read {path}: it is damaged, or no wave of Igor.") from error
    if table.ndim != 2 or len(labels) != table.shape[1]:
        raise FileError(f"cannot use {path}: it is of shape {table.shape}, not a curve with names of its columns.")
    order = sorted(range(len(labels)), key=lambda i: labels[i] != "ZSnsr")  # what was measured before what was asked
    units = ["deg" if NAMES["phase"][0].match(label) else "m" for label in labels]
    parts = _parts([_column(f"{labels[i]} [{units[i]}]", False) for i in order], table[:, order])
    return parts, scan_data(path, {key: value.strip() for key, value in note.items()})


def _of_sweep(path: Path) -> Parts:
    """A distance sweep as a curve."""
    from phasemap.io.netcdf import load

    ds = load(path)
    if "tip_offset" not in ds.dims or "direction" not in ds.dims:
        raise FileError(f"cannot use {path}: it is no distance sweep; it holds {', '.join(map(str, ds.data_vars))}.")
    parts: Parts = {}
    for i, way in enumerate(DIRECTIONS):
        parts["distance", way] = ds["tip_offset"].values, "m"
        for name in ("amplitude", "phase"):
            parts[name, way] = np.asarray(ds[name].isel(direction=i).values), "m" if name == "amplitude" else "degree"
    return parts


def _assembled(path: Path, parts: Parts) -> xr.Dataset:
    """One Dataset, the distance larger where the tip is farther away."""
    held = ", ".join(sorted({quantity for quantity, _ in parts})) or "nothing"
    if not {"distance", "amplitude"} <= {quantity for quantity, _ in parts}:
        raise FileError(f"cannot use {path}: a curve has distance and amplitude; it holds {held}.")
    if all(way is None for _, way in parts):
        parts = _split(parts)
    ways = [way for way in DIRECTIONS if {("distance", way), ("amplitude", way)} <= set(parts)]
    if not ways:
        raise FileError(f"cannot use {path}: no direction has distance and amplitude both.")
    quantities = [one for one in NAMES if all((one, way) in parts for way in ways)]
    real = {way: (parts["distance", way][0] != 0) | (parts["amplitude", way][0] != 0) for way in ways}  # not padded
    most = max(int(mask.sum()) for mask in real.values())
    found: dict[str, Any] = {}
    for one in quantities:
        values = np.full((len(ways), most), np.nan)
        for row, way in zip(values, ways, strict=True):
            row[: real[way].sum()] = parts[one, way][0][real[way]]
        found[one] = (("direction", "point"), values, {"long_name": f"recorded {one}", "units": parts[one, ways[0]][1]})
    ds = xr.Dataset(found, {"direction": ways})
    if "phase" in ds and ds["phase"].attrs["units"] == "lag":
        ds["phase"].attrs |= {"units": "degree", "counts": "lag"}
    z, amplitude = (ds[name].values[np.isfinite(ds["distance"].values)] for name in ("distance", "amplitude"))
    if np.cov(z, amplitude)[0, 1] < 0:
        ds["distance"] = -ds["distance"]
    ds["distance"] = (ds["distance"] - ds["distance"].min()).assign_attrs(found["distance"][2])
    return ds


def _split(parts: Parts) -> Parts:
    """Approach and withdrawal of columns that hold one below the other: the turn is where the amplitude is least."""
    z, amplitude = (parts[name, None][0] for name in ("distance", "amplitude"))
    way = np.sign(np.cov(z, amplitude)[0, 1]) or 1.0
    turn = int(np.argmin(way * z))
    ends = [(0, turn + 1), (turn + 1, len(z))]
    kept = [(one, *end) for one, end in zip(DIRECTIONS, ends, strict=True) if end[1] - end[0] >= FEWEST]
    return {(name, one): (values[a:b], unit) for (name, _), (values, unit) in parts.items() for one, a, b in kept}


def _say_more(ds: xr.Dataset, scan: ScanData) -> None:
    """Free amplitude, zero, sign and sensitivity that the curve itself shows, and sentences on what it does not."""
    z, amplitude = ds["distance"].values, ds["amplitude"].values
    volts = ds["amplitude"].attrs["units"] == "V"
    far = z >= np.nanquantile(z, 1 - FAR, axis=1, keepdims=True)
    free = float(np.nanmedian(amplitude[far]))
    is_free = abs(float(np.nanmedian(amplitude[far & (z < np.nanmedian(z[far]))])) - free) < FREE * free
    if not is_free:
        scan.warnings.append(
            "The amplitude still changes at the far end: free amplitude and zero are not of this curve."
        )
    else:
        scan.take(**{"free_amplitude_voltage" if volts else "free_amplitude": free})
    if "phase" not in ds:
        scan.warnings.append("There is no phase: only the amplitude is used.")
    elif is_free:
        zero = float(np.nanmedian(ds["phase"].values[far]))
        near = float(np.nanmedian(ds["phase"].values[z <= np.nanquantile(z, 0.02, axis=1, keepdims=True)]))
        scan.take(phase_zero=zero)
        if ds["phase"].attrs.get("counts") == "lag":
            scan.take(phase_sign=-1.0)
        if "phase_sign" not in scan.values:
            scan.take(phase_sign=1.0 if near > zero else -1.0)
            scan.warnings.append(
                "The sign of the phase is not recorded: it is taken to be positive where the tip was nearest, as if "
                "that were repulsive."
            )
    if volts:
        _say_sensitivity(scan, z, amplitude, free)
    if len(ds["direction"]) < len(DIRECTIONS):
        scan.warnings.append(f"Only the {ds['direction'].values[0]} is recorded.")
    missing = [name for name in ("stiffness", "resonance_frequency", "quality_factor") if name not in scan.values]
    if missing:
        scan.warnings.append(f"Not recorded: {', '.join(missing)}, tip radius.".replace("_", " "))


def _say_sensitivity(scan: ScanData, z: np.ndarray, amplitude: np.ndarray, free: float) -> None:
    """The sensitivity that the steepest part of the curve allows."""
    near = float(z[amplitude < (1 - FREE) * free].max(initial=0.0))  # below it, something acts on the tip
    edges = np.linspace(0.0, near, round(1 / WINDOW) + 1)
    parts = [(own >= low) & (own <= high) for own in z for low, high in pairwise(edges)]
    rows = np.repeat(np.arange(len(z)), len(edges) - 1)
    slopes = [np.polyfit(z[i, part], amplitude[i, part], 1)[0] for i, part in zip(rows, parts, strict=True)
              if part.sum() > 3]  # fmt: skip
    steepest = float(max(slopes, default=0.0))
    recorded = scan.values.get("amplitude_sensitivity")
    if not steepest > 0:
        scan.warnings.append("The amplitude never falls: no sensitivity follows from it.")
    elif recorded is None:
        scan.take(amplitude_sensitivity=1 / steepest)
        scan.warnings.append(
            f"The amplitude's sensitivity is not recorded: {1e9 / steepest:.3g} nm/V at most, for the amplitude falls "
            "no faster than the distance."
        )
    elif recorded * steepest > 1.1:
        scan.warnings.append(
            f"The recorded sensitivity {recorded * 1e9:.3g} nm/V would make the amplitude fall "
            f"{recorded * steepest:.2g} times as fast as the distance."
        )
