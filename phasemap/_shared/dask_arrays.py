"""Maps that are Dask arrays, told from others without importing Dask."""

from __future__ import annotations

from typing import Any

import numpy as np

from phasemap._shared.errors import InputError


def is_lazy(value: object) -> bool:
    """Whether a value is a Dask array, or a DataArray that holds one."""
    graph = getattr(value, "__dask_graph__", None)
    return graph is not None and graph() is not None


def lazy_map(name: str, value: Any, dtype: type = np.float64) -> Any:
    """Return a Dask array as a map, of numbers that are looked at only when blocks of it are computed."""
    array = value.data if hasattr(value, "dims") else value
    if array.ndim != 2 or not all(side > 0 for side in array.shape):  # NaN where it is not known
        hint = "One number will do too. Call compute_chunk_sizes() where the shape is not known."
        raise InputError(f"shape of {name}", array.shape, "(rows, columns) of a 2-D map", hint)
    if array.dtype.kind not in ("fiu" if dtype is np.float64 else "iub"):
        raise InputError(
            f"type of {name}", array.dtype.name, "real numbers" if dtype is np.float64 else "whole numbers"
        )
    return array.astype(dtype) if dtype is np.float64 else array


def chunks_of(value: Any) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Heights and widths of the blocks of a lazy map."""
    rows, columns = value.chunks
    return rows, columns
