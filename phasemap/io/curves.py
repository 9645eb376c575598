"""Measured amplitude and phase against distance: text, and the files of instruments, in the one form of a curve."""

from __future__ import annotations

import os
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from phasemap._shared.arrays import within_half_a_turn
from phasemap._shared.asked import asked_as
from phasemap._shared.checks import whole
from phasemap._shared.errors import FileError, InputError
from phasemap._shared.notices import tell
from phasemap.io.curve_columns import DIRECTIONS, FEWEST, NAMES, OF_IMAGES, TEXT, Parts, of_text, of_wave
from phasemap.io.curve_files import ARCHIVES, is_nanoscope, of_archive, of_nanoscope
from phasemap.io.measured import on_one_turn
from phasemap.io.metadata import CANONICAL, ScanData, is_simulated, settings_of_image
from phasemap.io.netcdf import load
from phasemap.io.read import NETCDF

FAR = 0.1  # of the points, farthest from the surface, that show the free lever
FREE = 0.005  # of the amplitude, that it changes over these points at most
WINDOW = 0.2  # of the range of distances, over which the amplitude's slope is taken


@asked_as()
def read_curve(
    path: str | os.PathLike[str], *, columns: Sequence[str | None] | None = None, number: int = 0
) -> xr.Dataset:
    """Read a measured curve of amplitude and phase against distance.

    Parameters
    ----------
    path : path-like
        Text with columns (.gz or not), an Igor wave as Asylum Research writes curves (.ibw), a curve of JPK
        (.jpk-force, or one of a map) or of NanoScope (.spm, .001), or a distance sweep of phasemap in netCDF.
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
    told, kind = dict[str, str](), path.suffix.lower()
    holds_one = kind in NETCDF or kind == ".ibw"
    if holds_one and number:
        raise InputError("number", number, f"0, for {path.name} holds one curve")
    if columns is not None and (holds_one or kind in ARCHIVES or is_nanoscope(path)):
        raise InputError("columns", columns, f"None, for {path.name} is no text")
    if kind in NETCDF:
        parts, scan, told = _curve_of_sweep(path)
    elif kind == ".ibw":
        parts, scan = of_wave(path)
    elif kind in ARCHIVES:
        parts, scan = of_archive(path, number)
    elif is_nanoscope(path):
        parts, scan = of_nanoscope(path, number)
    else:
        parts, scan = of_text(path, columns, number), ScanData()
    ds = _assembled(path, parts)
    _say_more(ds, scan)
    ds.attrs = {"source": path.name, **told, **scan.values, "warnings": "\n".join(scan.warnings)}
    tell(scan.warnings)
    return ds


def is_curve(path: Path) -> bool:
    """True if a file holds a curve: text, of JPK or NanoScope, or an Igor wave without a second side of pixels."""
    if path.suffix.lower() in ARCHIVES or is_nanoscope(path):
        return True
    if path.suffix.lower() != ".ibw" or not path.is_file():
        return path.with_suffix("").suffix.lower() in TEXT if path.suffix == ".gz" else path.suffix.lower() in TEXT
    with path.open("rb") as file:
        head = file.read(160)
    return int.from_bytes(head[140:144], "little") == 0  # no third dimension


def _curve_of_sweep(path: Path) -> tuple[Parts, ScanData, dict[str, str]]:
    """Curve of a simulated distance sweep, its microscope, and the configuration, which says the law too."""
    ds = load(path)
    if "tip_offset" not in ds.dims or "direction" not in ds.dims:
        raise FileError(
            f"cannot use {path}: it is no distance sweep; it holds {', '.join(map(str, ds.data_vars))}. {OF_IMAGES}"
        )
    parts: Parts = {}
    for i, way in enumerate(DIRECTIONS):
        parts["distance", way] = ds["tip_offset"].values, "m"
        for name in ("amplitude", "phase"):
            parts[name, way] = np.asarray(ds[name].isel(direction=i).values), "m" if name == "amplitude" else "degree"
    if not is_simulated(ds):
        return parts, ScanData(), {}
    settings = {name: value for name, value in settings_of_image(ds).items() if name in CANONICAL}
    return parts, ScanData(settings), {"configuration": ds.attrs["configuration"]}


def _assembled(path: Path, parts: Parts) -> xr.Dataset:
    """Dataset of a curve, whose distance is larger where the tip is farther away."""
    held = ", ".join(sorted({quantity for quantity, _ in parts})) or "nothing"
    if not {"distance", "amplitude"} <= {quantity for quantity, _ in parts}:
        raise FileError(f"cannot use {path}: a curve has distance and amplitude; it holds {held}.")
    for way in {way for one, way in parts if one == "distance" and ("amplitude", way) in parts}:
        known = np.isfinite(parts["distance", way][0] + parts["amplitude", way][0])
        kinds = [one for one, of in parts if of == way]
        parts |= {(one, way): (parts[one, way][0][known], parts[one, way][1]) for one in kinds}
    if all(way is None for _, way in parts):
        parts = _split(parts)
    ways = [way for way in DIRECTIONS if {("distance", way), ("amplitude", way)} <= set(parts)]
    if not ways:
        raise FileError(f"cannot use {path}: no direction has distance and amplitude both.")
    quantities = [one for one in NAMES if all((one, way) in parts for way in ways)]
    real = {way: (parts["distance", way][0] != 0) | (parts["amplitude", way][0] != 0) for way in ways}  # not padded
    most = max(int(mask.sum()) for mask in real.values())
    variables: dict[str, Any] = {}
    for quantity in quantities:
        values = np.full((len(ways), most), np.nan)
        for row, way in zip(values, ways, strict=True):
            row[: real[way].sum()] = parts[quantity, way][0][real[way]]
        about = {"long_name": f"recorded {quantity}", "units": parts[quantity, ways[0]][1]}
        variables[quantity] = (("direction", "point"), values, about)
    ds = xr.Dataset(variables, {"direction": ways})
    if "phase" in ds and ds["phase"].attrs["units"] == "lag":
        ds["phase"].attrs |= {"units": "degree", "counts": "lag"}
    z, amplitude = (ds[name].values[np.isfinite(ds["distance"].values)] for name in ("distance", "amplitude"))
    if np.cov(z, amplitude)[0, 1] < 0:
        ds["distance"] = -ds["distance"]
    ds["distance"] = (ds["distance"] - ds["distance"].min()).assign_attrs(variables["distance"][2])
    return ds


def _split(parts: Parts) -> Parts:
    """Approach and withdrawal of columns that hold one below the other: the turn is where the tip is closest."""
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
        scan.set_known(**{"free_amplitude_voltage" if volts else "free_amplitude": free})
    if "phase" not in ds:
        scan.warnings.append("There is no phase: only the amplitude is used.")
    elif is_free:
        phase = on_one_turn(ds["phase"].values)
        zero = float(np.nanmedian(phase[far]))
        near = float(np.nanmedian(phase[z <= np.nanquantile(z, 0.02, axis=1, keepdims=True)]))
        scan.set_known(phase_zero=zero)
        if ds["phase"].attrs.get("counts") == "lag":
            scan.set_known(phase_sign=-1.0)
        if "phase_sign" not in scan.values:
            scan.set_known(phase_sign=1.0 if within_half_a_turn(near - zero) > 0 else -1.0)
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
        scan.set_known(amplitude_sensitivity=1 / steepest)
        scan.warnings.append(
            f"The amplitude's sensitivity is not recorded: {1e9 / steepest:.3g} nm/V at most, for the amplitude falls "
            "no faster than the distance."
        )
    elif recorded * steepest > 1.1:
        scan.warnings.append(
            f"The recorded sensitivity {recorded * 1e9:.3g} nm/V would make the amplitude fall "
            f"{recorded * steepest:.2g} times as fast as the distance."
        )
