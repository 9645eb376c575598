"""Images in netCDF files: written whole or not at all, read back identical."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import TYPE_CHECKING

import xarray as xr

from phasemap._shared.checks import whole
from phasemap._shared.errors import FileError, InputError, PhasemapError
from phasemap._shared.interrupts import EndlessError, interruptible
from phasemap._shared.memory import check_fits
from phasemap.io.classic import check_classic, is_classic
from phasemap.io.whole_files import check_target, replacing
from phasemap.io.zarr_store import opened_store

if TYPE_CHECKING:
    import netCDF4

LIMIT = 10.0  # seconds to open a file, which takes some thousandths
HEADER = 1 << 24  # byte: longer headers of classic files are not read
OTHERS = {
    ".toml": "A scene would be lost.",
    ".zarr": "An ensemble may be a zarr store; an image is made one by image.to_zarr in Python.",
    **dict.fromkeys((".png", ".pdf", ".svg", ".jpg", ".jpeg", ".tif", ".tiff"), "Use phasemap plot."),
}
"""What no netCDF file is called, and why."""
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


def load(path: str | os.PathLike[str]) -> xr.Dataset:
    """Read a netCDF file, or a zarr store (a folder whose name ends in .zarr), into memory; the file is closed."""
    return _read(path, None)


def load_sample(path: str | os.PathLike[str], sample: int) -> xr.Dataset:
    """Read one sample of an ensemble's file or store into memory, counted from 0, without the dimension "sample"."""
    return _read(path, sample)


def _read(path: str | os.PathLike[str], sample: int | None) -> xr.Dataset:
    """A file, or one sample of it."""
    path = Path(path)
    if not os.path.exists(path):
        raise FileError(f"cannot read {path}: there is no such file.")
    if not os.access(path, os.R_OK):
        raise FileError(f"cannot read {path}: no permission.")
    if path.is_dir() and path.suffix == ".zarr":
        with opened_store(path) as ds:
            chosen = ds if sample is None else _pick(ds, sample)
            check_fits(f"to read {path}", chosen.nbytes, "Take fewer pixels or variables, or one sample.")
            return chosen.load()
    if not path.is_file():
        raise FileError(f"cannot read {path}: it is not a file.")
    try:
        check_fits(f"to read {path}", _declared(path, sample), "Take fewer pixels or variables, or one sample.")
        with xr.open_dataset(path, engine="netcdf4") as ds:
            return ds.load() if sample is None else _pick(ds, sample).load()
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


def _declared(path: Path, sample: int | None) -> float:
    """Bytes that the variables of a file have, or those of one sample, whether they were ever written or not."""
    with path.open("rb") as head:
        if is_classic(begin := head.read(HEADER)):
            check_classic(begin)
    with opened(path) as file:
        total = 0.0
        for variable in file.variables.values():
            item = getattr(variable.dtype, "itemsize", 8)
            sides = zip(variable.dimensions, variable.shape, strict=True)
            total += item * math.prod(float(n) for name, n in sides if sample is None or name != "sample")
        return total


def _pick(ds: xr.Dataset, sample: int) -> xr.Dataset:
    """One sample of an ensemble."""
    if "sample" not in ds.dims:
        raise InputError("sample", sample, "nothing, for this file holds no ensemble")
    return ds.isel(sample=whole("sample", sample, 0, ds.sizes["sample"] - 1))
