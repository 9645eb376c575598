"""Results in words: how many pixels failed, and why; how many move irregularly; which flags occur."""

from __future__ import annotations

from collections import Counter

import numpy as np
import xarray as xr

from phasemap._shared.asked import asked_as
from phasemap._shared.units import counted, say
from phasemap.results.status import Status

SOLVED_BY = {
    "averaging": "averaging (first order)",
    "orbit": "orbit (exact)",
    "corrected": "orbit (exact)",
    "march": "integration in time",
    "interpolated": "interpolation between materials",
}
"""What summaries and titles call the solvers of `phasemap.results.variables.SOLVER_NAMES`."""
NOTABLE = 0.5  # contrast [degree] that barely stands out of the noise of a phase image


@asked_as()
def describe_failures(ds: xr.Dataset, what: str = "pixels") -> list[str]:
    """Say how many pixels have no solution, why, and what helps: a line for each way a pixel failed."""
    if "status" not in ds:
        return []
    status = ds["status"].values
    codes, counts = np.unique(status[status != 0], return_counts=True)  # to sort them all takes as long as an image
    return [
        f"{counted(int(count), status.size, what)}: {Status.of(int(code)).value}"
        for code, count in zip(codes, counts, strict=True)
    ]


def describe_irregular(ds: xr.Dataset, what: str = "pixels") -> list[str]:
    """Say how many pixels show the mean of motion that is not periodic, and how far it is spread.

    Returns one line; empty if there are none, or if the dataset does not say.
    """
    count = int(np.count_nonzero(ds["motion"].values == 1)) if "motion" in ds else 0
    if not count:
        return []
    spreads = [
        say(float(np.nanmax(ds[name].values)), units, 2)
        for name, units in (("amplitude_spread", "m"), ("phase_spread", "degree"))
        if name in ds
    ]
    most = f", spread up to {' and '.join(spreads)}" if spreads else ""
    return [f"{counted(count, ds['motion'].size, what)} irregular: mean amplitude and phase{most}"]


def describe_alike(ds: xr.Dataset, materials: int) -> list[str]:
    """Say so if several materials can hardly be told apart by their phase.

    Returns one line, or none, as where a pixel has no solution and so no phase to be told by.
    """
    if materials < 2 or "phase" not in ds or not np.isfinite(ds["phase"].values).all():
        return []
    apart = float(np.ptp(ds["phase"].values))
    if apart > NOTABLE:
        return []
    return [
        f"the phases of the {materials} materials are within {apart:.2g} degrees: they take nearly the same energy "
        "from the tip at this amplitude. `phasemap contrast` finds a setpoint and free amplitude that distinguish them."
    ]


def describe_solvers(solver: xr.DataArray) -> str:
    """Say which methods solved the pixels and how many each, most frequent first."""
    meanings = [SOLVED_BY.get(name, name) for name in solver.attrs["flag_meanings"].split()]
    return _shares(solver, meanings)


@asked_as()
def describe_flags(flags: xr.DataArray) -> str:
    """Say which flags of a CF variable occur and how often, most frequent first."""
    return _shares(flags, flags.attrs["flag_meanings"].split())


def _shares(flags: xr.DataArray, meanings: list[str]) -> str:
    """The meanings that occur, with the share of each where there are several."""
    names: dict[int, str] = dict(zip(np.atleast_1d(flags.attrs["flag_values"]).tolist(), meanings, strict=True))
    shares: Counter[str] = Counter()
    for value, count in zip(*np.unique(flags.values, return_counts=True), strict=True):
        shares[names.get(int(value), "none")] += int(count)
    if len(shares) == 1:
        return next(iter(shares))
    return ", ".join(f"{name} {100 * count / flags.size:.3g} %" for name, count in shares.most_common())
