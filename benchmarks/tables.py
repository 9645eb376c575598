"""Tables in Markdown, and what they were measured on."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import xarray as xr


def markdown(heads: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """A table.

    Examples
    --------
    >>> print(markdown(["solver", "time"], [["orbit", "7"], ["march", "90"]]))
    | solver | time |
    | --- | --- |
    | orbit | 7 |
    | march | 90 |
    """
    return "\n".join(f"| {' | '.join(line)} |" for line in (heads, ["---"] * len(heads), *lines))


def dataset(
    what: str, rows: Mapping[str, Sequence[float]], about: Mapping[str, tuple[str, str]], **attrs: Any
) -> xr.Dataset:
    """A row of numbers for each thing, as variables over its dimension.

    `what`: the dimension, with which the variables' names begin: "image" for image_time.
    `about`: name without that, long name and unit of each number.

    Examples
    --------
    >>> dataset("curve", {"distance": [0.2], "frequency": [0.1]}, {"time": ("time of a curve", "s")}).curve_time.values
    array([0.2, 0.1])
    """
    import xarray as xr

    columns = np.array(list(rows.values())).T
    variables = {
        f"{what}_{name}": (what, column, {"long_name": long_name, "units": unit})
        for (name, (long_name, unit)), column in zip(about.items(), columns, strict=True)
    }
    return xr.Dataset(variables, {what: list(rows)}, attrs)


def machine() -> str:
    """Processor, number of cores and system, as far as the system tells."""
    name = platform.processor() or platform.machine()
    if os.path.exists("/proc/cpuinfo"):
        with open("/proc/cpuinfo") as lines:
            name = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), name)
    return f"{name}, {os.cpu_count()} cores, {platform.system()} {platform.machine()}"


def versions(*packages: str) -> str:
    """Python, numpy, numba and further packages."""
    names = dict.fromkeys(["numpy", "numba", *packages])
    return ", ".join([f"Python {sys.version.split()[0]}", *(f"{name} {version(name)}" for name in names)])
