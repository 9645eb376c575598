"""The images of an ensemble as a zarr store, for what reads such stores from many processes or over a network."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import xarray as xr

from phasemap._shared.errors import FileError, PhasemapError
from phasemap.io.gwyddion import extra
from phasemap.io.whole_files import check_target, replacing

SUFFIX = ".zarr"
AT_ONCE = 1 << 26  # byte of samples in memory
FORMAT = 2  # which every reader knows; text in version 3 has no agreed form yet


def check_store(path: Path, overwrite: bool = False) -> Path:
    """As `check_target`, for a store, which needs zarr; a folder that is no store is never replaced."""
    extra("zarr", "writing zarr stores", "dask")
    return check_target(path, overwrite)


def write_store(source: Path, path: Path, overwrite: bool = False) -> None:
    """Copy a netCDF file with a dimension "sample" into a zarr store, a chunk a sample, some in memory at a time."""
    with xr.open_dataset(source, engine="netcdf4") as ds, replacing(path, overwrite) as temporary:
        count = ds.sizes["sample"]
        step = max(1, AT_ONCE * count // max(ds.nbytes, 1))
        for start in range(0, count, step):
            some = ds.isel(sample=slice(start, start + step)).load().drop_encoding()
            if start:
                some.to_zarr(temporary, append_dim="sample", consolidated=True)
            else:
                layout = {  # a chunk is one image of one sample
                    str(name): {"chunks": (1,) * (one.ndim - 2) + one.shape[-2:]}
                    for name, one in some.variables.items()
                    if one.ndim > 1
                }
                some.to_zarr(temporary, mode="w", zarr_format=FORMAT, consolidated=True, encoding=layout)


@contextmanager
def opened_store(path: Path) -> Iterator[xr.Dataset]:
    """Open a zarr store; values are read where they are needed."""
    extra("zarr", "reading zarr stores", "dask")
    try:
        with xr.open_dataset(path, engine="zarr") as ds:
            yield ds
    except PhasemapError:
        raise
    except Exception as error:  # whatever the libraries meet in a damaged store
        raise FileError(f"cannot read {path}: it is not a zarr store, or it is damaged or cut short.") from error
