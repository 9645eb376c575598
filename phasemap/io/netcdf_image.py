"""Images in netCDF, written by phasemap or by others, in the one form that all of phasemap works on."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from phasemap._shared.errors import FileError
from phasemap._shared.notices import tell
from phasemap._shared.pixels import LONG_NAMES
from phasemap.io.flattening import on_one_turn
from phasemap.io.kinds import KINDS, METRES, check_places, implausible
from phasemap.io.metadata import of_simulation
from phasemap.io.netcdf import load

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
    ds.attrs = {**of_simulation(ds.attrs), **ds.attrs}
    return ds


def _converted(path: Path, ds: xr.Dataset, name: str, units: dict[str, tuple[float, str]], what: str) -> xr.Dataset:
    """The dataset with a variable in the unit it should have."""
    values, found = ds[name], ds[name].attrs.get("units")
    if values.dtype.kind not in "fiu" or not values.size or (name in ds.coords and values.dims != (name,)):
        raise FileError(f"cannot use {path}: {name} is {values.dtype.name} over {values.dims}, not {what}.")
    if found is None:
        return ds
    if not isinstance(found, str) or found not in units:
        raise FileError(f"cannot use {path}: {name} is in {found!r}, not {what}.")
    factor, unit = units[found]
    if factor == 1.0 and unit == found:
        return ds
    return ds.assign({name: (ds[name].astype(float) * factor).assign_attrs(ds[name].attrs | {"units": unit})})
