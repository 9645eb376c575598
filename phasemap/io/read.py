"""Measured images, and images in netCDF, in the one form that all of phasemap works on."""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from phasemap._shared.asked import asked_as
from phasemap._shared.errors import FileError, InputError
from phasemap._shared.notices import tell
from phasemap._shared.pixels import LONG_NAMES, centres, coordinates
from phasemap.io.gwyddion import Channel, load_channels, merged
from phasemap.io.measured import on_one_turn
from phasemap.io.metadata import KINDS, METRES, Kind, check_places, implausible, settings_of_image
from phasemap.io.netcdf import load
from phasemap.io.vendors import operating_mode, scan_data

DIRECTIONS = ("trace", "retrace")
SENSOR = re.compile("sensor|measured|detector", re.IGNORECASE)
SAME_SIZE = 1e-3  # by which channels of one scan may differ
SAME_STEP = 5e-5  # as many digits has the size of a scan in the files


@asked_as()
def read_image(
    path: str | os.PathLike[str], *, height: str | None = None, phase: str | None = None, amplitude: str | None = None
) -> xr.Dataset:
    """Read a measured image.

    Parameters
    ----------
    path : path-like
        A file of any format that Gwyddion reads (NanoScope, Asylum Research .ibw, JPK, Nanosurf .nid, Park .tiff, WSxM,
        .gwy, .gsf and some 160 more), or an image in netCDF.
    height, phase, amplitude : str, optional
        Names of channels, with their direction (``"Z-Axis Sensor forward"``) or without (``"Z-Axis Sensor"``, which
        takes both); None takes the first of its kind, and the height that was recorded in the directions of the phase,
        a sensor's before what the scanner was told.

    Returns
    -------
    xarray.Dataset
        ``height`` [m], ``phase`` [degree, zero and sign as recorded, on one turn where it ran over the end of its
        range], ``amplitude`` and ``amplitude_error`` [m, or V where the file has no sensitivity] where there, over
        ("y", "x"), or over ("direction", "y", "x") where trace and retrace have them all; row 0 at the top, cell-centre
        coordinates [m], pixels need not be square. An image in netCDF without units is taken as in m and degrees.

        What is known about the scan is in the attributes, each absent where the file does not have it:
        drive_frequency, resonance_frequency, line_rate [Hz], free_amplitude (at the drive frequency),
        setpoint_amplitude [m], setpoint, quality_factor [1], stiffness [N/m], tip_radius [m] (of a simulated image),
        phase_zero (phase of the free lever), lock_in_phase (what the instrument adds to it) [degree], day (days since
        1970-01-01), drive_voltage [V], amplitude_sensitivity [m/V], free_amplitude_voltage, setpoint_voltage [V],
        proportional_gain and integral_gain in units of the vendor. ``nominal`` names those that are of the lever's type
        and not of this lever; ``warnings`` are sentences on what must not be taken for more than it is, a line each;
        ``vendor_metadata`` is all that the vendor says, as JSON; ``channels`` are the names of the channels of each
        variable, ``other_channels`` those that were not read.

    Raises
    ------
    FileError
        If the file cannot be read, holds no such channel, or was not recorded in tapping mode.

    Notes
    -----
    The pixels divide the size of the scan: N of them, not N - 1, also where the vendor's header says otherwise.

    Examples
    --------
    >>> read_image("scan.nid")
    Traceback (most recent call last):
    ...
    phasemap.FileError: cannot read scan.nid: there is no such file.
    """
    path, wanted = Path(path), {"height": height, "phase": phase, "amplitude": amplitude}
    for kind, name in wanted.items():
        if name is not None and not isinstance(name, str):
            raise InputError(kind, name, "the name of a channel, or None")
    if path.suffix.lower() in NETCDF:
        for kind, name in wanted.items():
            if name not in (None, kind):
                raise InputError(kind, name, f"None for an image in netCDF, whose variable is called {kind}")
        return read_netcdf(path)
    channels = load_channels(path)
    mode = operating_mode(path, merged(channels))
    groups = {kind: _groups(path, channels, kind, wanted.get(kind)) for kind in KINDS}
    chosen, directions = _choose(path, groups, channels)
    used = [one for group in chosen.values() for one in group.values()]
    metadata = merged([*used, *channels])  # a file of Gwyddion's may hold several measurements
    scan = scan_data(path, metadata)
    ds = _assemble(path, chosen, directions, scan.size)
    scan.warnings += _remarks(ds, chosen)
    every = {one.name for one in used}
    ds.attrs = {
        "source": path.name,
        "source_sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
        "operating_mode": mode,
        **scan.values,
        "channels": json.dumps({kind: [one.name for one in group.values()] for kind, group in chosen.items()}),
        "other_channels": json.dumps([one.name for one in channels if one.name not in every]),
        "vendor_metadata": json.dumps(metadata, sort_keys=True, ensure_ascii=False),
    }
    if len(directions) == 1 and directions[0]:
        ds.attrs["direction"] = directions[0]
    if scan.nominal:
        ds.attrs["nominal"] = " ".join(scan.nominal)
    if scan.warnings:
        ds.attrs["warnings"] = "\n".join(dict.fromkeys(scan.warnings))
        tell(dict.fromkeys(scan.warnings))
    return ds


Group = dict[str, Channel]  # channels of one name, by direction


def _groups(path: Path, channels: list[Channel], kind: str, wanted: str | None) -> list[Group]:
    """Channels of a kind, or of the name asked for: those of one name together."""
    groups: dict[str, Group] = {}
    for channel in channels:
        if wanted in (channel.name, channel.base) or (wanted is None and KINDS[kind].pattern.match(channel.base)):
            groups.setdefault(channel.base, {}).setdefault(channel.direction, channel)
    for group in groups.values():
        if set(group) == {"", "retrace"}:  # JPK marks the retrace only
            group["trace"] = group.pop("")
    if wanted is not None and not groups:
        raise FileError(f"cannot use {path}: there is no channel {wanted!r}; it holds {_listed(channels)}.")
    return list(groups.values())


def _choose(
    path: Path, groups: dict[str, list[Group]], channels: list[Channel]
) -> tuple[dict[str, Group], tuple[str, ...]]:
    """Channel of each kind and direction, and the directions that height and phase have in common."""
    phases, heights = groups["phase"], groups["height"]
    if not phases and not heights:
        raise FileError(f"cannot use {path}: there is neither height nor phase; it holds {_listed(channels)}.")
    leading = phases[0] if phases else max(heights, key=_is_sensors)  # the first of equals
    chosen = {"phase": leading} if phases else {"height": leading}
    common = set(leading)
    if phases and heights:
        chosen["height"] = max(heights, key=lambda group: (len(common & set(group)), _is_sensors(group)))
        common &= set(chosen["height"])
    directions = tuple(one for one in DIRECTIONS if one in common)
    if len(directions) < 2:
        directions = directions or tuple(leading)[:1]
        only = directions[0]  # or what there is in its place
        chosen = {kind: {only: group.get(only, next(iter(group.values())))} for kind, group in chosen.items()}
    for kind in ("amplitude", "amplitude_error"):
        complete = next((group for group in groups[kind] if set(directions) <= set(group)), None)
        if complete:
            chosen[kind] = complete
    return {kind: {one: chosen[kind][one] for one in directions} for kind in KINDS if kind in chosen}, directions


def _is_sensors(group: Group) -> bool:
    """True if a height was measured by a sensor, and is not what the scanner was told."""
    return any(SENSOR.search(channel.base) for channel in group.values())


def _assemble(
    path: Path, chosen: dict[str, Group], directions: tuple[str, ...], size: tuple[float, float] | None
) -> xr.Dataset:
    """Dataset with the channels as variables."""
    first, *others = [one for group in chosen.values() for one in group.values()]
    if not all(0 < side < math.inf for side in first.size):
        raise FileError(f"cannot use {path}: {first.name!r} is {_sides(first.size)} m in size.")
    for channel in others:
        for of_channel, of_first, what in (
            (channel.data.shape, first.data.shape, "pixels"), (channel.size, first.size, "m"),
        ):  # fmt: skip
            if not np.allclose(of_channel, of_first, rtol=SAME_SIZE, atol=0):
                raise FileError(
                    f"cannot use {path}: {first.name!r} has {_sides(of_first)} {what} "
                    f"but {channel.name!r} has {_sides(of_channel)}; name two that belong together."
                )
    dims = ("y", "x") if len(directions) == 1 else ("direction", "y", "x")
    variables = {}
    for kind, group in chosen.items():
        for channel in group.values():
            _check_unit(path, channel, KINDS[kind])
        units = KINDS[kind].units
        unit, *differ = dict.fromkeys(units[channel.unit][1] for channel in group.values())
        if differ:
            raise FileError(f"cannot use {path}: {kind} is in {unit} one way and in {differ[0]} the other.")
        with np.errstate(all="ignore"):  # of bytes that are not numbers
            data = np.stack([channel.data * units[channel.unit][0] for channel in group.values()])
        if kind == "phase":
            data = on_one_turn(data)
        attrs = {"long_name": KINDS[kind].long_name, "units": unit}
        variables[kind] = (dims, data if len(directions) > 1 else data[0], attrs)
    coords: dict[str, Any] = {} if len(directions) == 1 else {"direction": list(directions)}
    sides = []
    for dim, pixels, length, exact in zip(("y", "x"), first.data.shape, first.size, size or first.size, strict=True):
        if math.isclose(length * (pixels - 1), exact * pixels, rel_tol=SAME_STEP):  # else cut in Gwyddion
            length = exact
        if not 0 < length < math.inf:
            raise FileError(f"cannot use {path}: the size of the image along {dim} is {length:g} m.")
        sides.append(centres(pixels, length / pixels))
    coords |= coordinates(sides[0][::-1], sides[1])
    ds = xr.Dataset(variables, coords)
    for found in implausible(ds):
        raise FileError(f"cannot use {path}: {found}. It is damaged, or in another unit.")
    return ds


def _check_unit(path: Path, channel: Channel, kind: Kind) -> None:
    """Refuse a channel whose unit is not of its kind."""
    if channel.unit in kind.units and channel.lateral_unit == "m":
        return
    found = f"{channel.unit!r} over {channel.lateral_unit!r}"
    raise FileError(f"cannot use {path}: channel {channel.name!r} is in {found}, not {kind.what} over metres.")


def _remarks(ds: xr.Dataset, chosen: dict[str, Group]) -> list[str]:
    """Sentences on channels that are missing or not what they seem."""
    remarks = []
    for kind in ("height", "phase"):
        if kind not in ds:
            remarks.append(f"There is no {kind} channel.")
    if {"height", "phase"} <= set(chosen):
        (of_height, *_), (of_phase, *_) = chosen["height"].values(), chosen["phase"].values()
        if of_height.direction != of_phase.direction:
            directions = [one.direction or "only" for one in (of_height, of_phase)]
            remarks.append(f"Height is of the {directions[0]} scan, phase of the {directions[1]} one.")
    for kind in ("amplitude", "amplitude_error"):
        if kind in ds and ds[kind].attrs["units"] == "V":
            remarks.append(f"The {kind.replace('_', ' ')} is in volts: the file has no sensitivity.")
    return remarks


def _sides(sides: tuple[float, ...]) -> str:
    """Height and width in words."""
    return " x ".join(f"{side:g}" for side in sides)


def _listed(channels: Iterable[Channel]) -> str:
    """Names of channels in words."""
    return ", ".join(repr(channel.name) for channel in channels)


NETCDF = (".nc", ".nc4", ".cdf")
"""Suffixes of such files."""


def read_netcdf(path: Path) -> xr.Dataset:
    """Read an image; what is known about the scan is taken from the configuration of a simulation.

    Recorded channels and coordinates come in the units of `phasemap.read_image`, y falling and x rising.
    """
    ds = load(path)
    images = [name for name in KINDS if name in ds and set(ds[name].dims) - {"direction"} == {"y", "x"}]
    if not {"height", "phase"} & set(images):
        held = ", ".join(f"{name} over {ds[name].dims}" for name in ds.data_vars)
        raise FileError(
            f"cannot use {path}: there is no height or phase over ('y', 'x'); it holds {held or 'nothing'}."
        )
    unknown = [name for name in images if "units" not in ds[name].attrs]
    for name in images:
        ds = _converted(path, ds, name, KINDS[name].units, KINDS[name].what)
    for dim in ("y", "x"):
        if dim not in ds.coords:
            raise FileError(f"cannot use {path}: there is no coordinate {dim}, the places of pixels in m.")
        ds = _converted(path, ds, dim, METRES, "a length")
    y, x = ds["y"].values, ds["x"].values
    if y[0] < y[-1]:  # counted from the top, as earlier versions did
        ds = ds.assign_coords(y=ds["y"].copy(data=y[::-1]).assign_attrs(long_name=LONG_NAMES["y"]))
    if x[0] > x[-1]:
        ds = ds.sortby("x")
    for name in images:
        ds[name] = ds[name].transpose(..., "y", "x")
    check_places(path, ds)
    if "phase" in images:
        ds["phase"] = ds["phase"].copy(data=on_one_turn(ds["phase"].values))
    remarks = [f"There are no units of {' and '.join(unknown)}: taken as m and degrees."] if unknown else []
    doubts = [f"In {path.name} {found}." for found in implausible(ds)]
    tell(doubts)
    if remarks or doubts:
        ds.attrs["warnings"] = "\n".join(filter(None, [str(ds.attrs.get("warnings", "")), *remarks, *doubts]))
    return ds.assign_attrs(settings_of_image(ds))


def _converted(path: Path, ds: xr.Dataset, name: str, units: dict[str, tuple[float, str]], what: str) -> xr.Dataset:
    """The dataset with a variable in the unit it should have."""
    values, stated = ds[name], ds[name].attrs.get("units")
    if values.dtype.kind not in "fiu" or not values.size or (name in ds.coords and values.dims != (name,)):
        raise FileError(f"cannot use {path}: {name} is {values.dtype.name} over {values.dims}, not {what}.")
    if stated is None:
        return ds
    if not isinstance(stated, str) or stated not in units:
        raise FileError(f"cannot use {path}: {name} is in {stated!r}, not {what}.")
    factor, unit = units[stated]
    if factor == 1.0 and unit == stated:
        return ds
    return ds.assign({name: (ds[name].astype(float) * factor).assign_attrs(ds[name].attrs | {"units": unit})})
