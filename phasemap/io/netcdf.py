"""Images in netCDF files: written whole or not at all, read back identical."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import xarray as xr

from phasemap._shared.checks import whole
from phasemap._shared.errors import FileError, InputError, PhasemapError
from phasemap._shared.files import check_target, replacing
from phasemap._shared.interrupts import EndlessError, interruptible
from phasemap._shared.memory import check_fits

if TYPE_CHECKING:
    import netCDF4

LIMIT = 10.0  # seconds to open a file, which takes some thousandths
CLASSIC = (b"CDF\x01", b"CDF\x02")  # netCDF-3, of which the C library believes every count, however wrong
OTHERS = {
    ".toml": "A scene would be lost.",
    ".zarr": "In Python, to_zarr makes a zarr store of what a file holds.",
    **dict.fromkeys((".png", ".pdf", ".svg", ".jpg", ".jpeg", ".tif", ".tiff"), "Use phasemap plot."),
}
"""Suffixes that no netCDF file may have, and why."""
COMPRESSION_LEVEL = 4  # of zlib; 9 made a noisy 200 000-pixel image 0.4 % smaller and took a quarter longer


def check_dataset(path: str | os.PathLike[str], overwrite: bool = False) -> Path:
    """Refuse, before any work is done, a place where no netCDF file can or should be written."""
    suffix = Path(path).suffix.lower()
    if suffix in OTHERS:
        raise InputError("the output's suffix", suffix, ".nc, for it becomes a netCDF file", OTHERS[suffix])
    return check_target(path, overwrite)


def save(ds: xr.Dataset, path: str | os.PathLike[str], overwrite: bool = False) -> Path:
    """Write `ds` as compressed netCDF-4.

    The file is written under a temporary name in the same folder, flushed to disk and renamed, so that a crash, a full
    disk or an interrupt never leaves half a file under `path`, and an existing file is as it was.
    """
    compressed = {
        name: {"zlib": True, "complevel": COMPRESSION_LEVEL}
        for name, variable in ds.variables.items()
        if variable.ndim >= 2 and variable.dtype.kind in "fiu"
    }
    with replacing(path, overwrite) as temporary:
        ds.to_netcdf(temporary, engine="netcdf4", format="NETCDF4", encoding=compressed)
    return Path(path)


def load(path: str | os.PathLike[str], sample: int | None = None) -> xr.Dataset:
    """Read a netCDF file into memory, or one sample of an ensemble's, counted from 0; the file is closed."""
    path = Path(path)
    if not os.path.exists(path):
        raise FileError(f"cannot read {path}: there is no such file.")
    if not os.access(path, os.R_OK):
        raise FileError(f"cannot read {path}: no permission.")
    if not path.is_file():
        raise FileError(f"cannot read {path}: it is not a file.")
    with path.open("rb") as head:
        classic = head.read(4) in CLASSIC
    try:
        if not classic:
            opened(path).close()
        with xr.open_dataset(path, engine="scipy" if classic else "netcdf4") as ds:
            if sample is not None and "sample" not in ds.dims:
                raise InputError("sample", sample, "nothing, for this file holds no ensemble")
            if sample is not None:
                ds = ds.isel(sample=whole("sample", sample, 0, ds.sizes["sample"] - 1))
            check_fits(f"to read {path}", ds.nbytes, "Take fewer pixels or variables, or one sample.")
            return ds.load()
    except PhasemapError:
        raise
    except Exception as error:  # whatever the libraries meet in a damaged file
        raise FileError(f"cannot read {path}: it is not a netCDF file, or it is damaged or cut short.") from error


def opened(path: Path) -> netCDF4.Dataset:
    """Open a netCDF file that may be damaged: of some thousands of such, HDF5 searches one for ever."""
    import netCDF4

    try:
        return interruptible(lambda: netCDF4.Dataset(path), LIMIT)
    except EndlessError:
        raise FileError(f"cannot read {path}: it is damaged, so that the library for it comes to no end.") from None
