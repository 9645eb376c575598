"""Questions asked of what was measured: which method meets an error, in which time, and which fails."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from benchmarks.accuracy.record import NO_ORBIT, NOT_RUN, OTHER_ORBIT

if TYPE_CHECKING:
    import xarray as xr

Array = np.ndarray

MOST_OF = 0.95
"""Part of the cases on which a method must meet an error to be said to meet it."""
SAME = 1.05
"""Times within this ratio are one."""


def compared(ds: xr.Dataset) -> xr.DataArray:
    """Whether a method was run on a case that has a reference."""
    return ds["result"] < NOT_RUN


def failures(ds: xr.Dataset) -> xr.DataArray:
    """How many cases of a regime a method failed on: no orbit, or one more than 1 degree off."""
    failed = (ds["result"] == NO_ORBIT) | (ds["result"] == OTHER_ORBIT)
    return failed.sum("case")


def meets(ds: xr.Dataset, phase: float, height: float) -> xr.DataArray:
    """Whether a method is within both errors on at least 95 % of a regime's cases, failures counted as not within.

    `phase`, `height`: [degree, m].
    """
    ran = compared(ds)
    within = (abs(ds["phase_error"]) <= phase) & (abs(ds["height_error"]) <= height) & ran
    return (ran.sum("case") > 0) & (within.sum("case") >= MOST_OF * ran.sum("case"))


def cheapest(ds: xr.Dataset, phase: float, height: float) -> dict[str, list[tuple[float, str]]]:
    """The least time in which each family meets both errors, and the method that does.

    `phase`, `height`: [degree, m].
    Returns: by family, for each regime: time per pixel [s] and label, or (NaN, "") where no tolerance reaches the
        errors.
    """
    time = ds["time"].where(meets(ds, phase, height)).values
    found: dict[str, list[tuple[float, str]]] = {}
    for family in families(ds):
        columns = np.flatnonzero(ds["family"].values == family)
        found[family] = []
        for row in time[:, columns]:
            if not np.isfinite(row).any():
                found[family].append((float("nan"), ""))
                continue
            # Of tolerances that cost the same but for the noise of timing, the loosest.
            best = int(np.argmax(row <= SAME * np.nanmin(row)))
            found[family].append((float(row[best]), str(ds["solver"].values[columns[best]])))
    return found


def period_time_at(ds: xr.Dataset, phase: float) -> dict[str, list[float]]:
    """Time of a period at a tolerance whose median error is `phase`, between tolerances on a log-log scale.

    `phase`: [degree].
    Returns: by family, for each regime [s]; NaN where the error lies outside what was measured.
    """
    error = abs(ds["phase_error"]).median("case").values
    found = {}
    for family in families(ds):
        columns = np.flatnonzero(ds["family"].values == family)
        if not np.isfinite(ds["period_time"].values[:, columns]).any():
            continue
        found[family] = [
            _between(error[r, columns], ds["period_time"].values[r, columns], phase) for r in range(len(error))
        ]
    return found


def _between(x: Array, y: Array, at: float) -> float:
    finite = np.isfinite(x) & np.isfinite(y) & (x > 0)
    if not finite.any() or not x[finite].min() <= at <= x[finite].max():
        return float("nan")
    order = np.argsort(x[finite])
    return float(np.exp(np.interp(np.log(at), np.log(x[finite][order]), np.log(y[finite][order]))))


def families(ds: xr.Dataset) -> list[str]:
    """Methods without their tolerances, in the order of the table."""
    return list(dict.fromkeys(map(str, ds["family"].values)))
