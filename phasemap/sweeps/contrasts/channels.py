"""Derived channels of two materials over a map of working points."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from phasemap._kernels import columns as col
from phasemap.results.quantities import CHANNELS, motion_of
from phasemap.results.variables import FLOATS
from phasemap.sweeps.contrasts.dataset import DIMS
from phasemap.sweeps.contrasts.pair import Axes, Engaged, Pair


def derived(
    names: tuple[str, ...], pair: Pair, labels: tuple[str, str], axes: Axes, engaged: Engaged
) -> dict[str, xr.Variable]:
    """Channels of each material, and of the second less the first under the name with ``_contrast``."""
    values = {name: np.full(engaged.rows.shape[:-1], np.nan) for name in names}
    for i, frequency in enumerate(axes[0]):
        for k, free in enumerate(axes[1]):
            rows = engaged.rows[:, i, k]
            orbit = {name: FLOATS[name].value(rows) for name in pair.needs}
            scope = pair.microscope_at(frequency, free)
            motion = motion_of(scope, rows[..., col.AMPLITUDE], np.degrees(rows[..., col.PHASE]), orbit)
            for name in names:
                values[name][:, i, k] = CHANNELS[name].value(motion)
    found: dict[str, Any] = {}
    for name in names:
        channel = CHANNELS[name]
        about = {"units": channel.units, "references": channel.source, "ancillary_variables": "status"}
        found[name] = xr.Variable(("material", *DIMS), values[name], {"long_name": channel.long_name, **about})
        long_name = f"contrast of the {channel.long_name}, {labels[1]} minus {labels[0]}"
        contrast = values[name][1] - values[name][0]
        found[f"{name}_contrast"] = xr.Variable(DIMS, contrast, {"long_name": long_name, **about})
    return found


def used_by(names: tuple[str, ...]) -> tuple[str, ...]:
    """Variables of an orbit that these channels are made of."""
    return tuple(sorted({one for name in names for one in (*CHANNELS[name].needs, CHANNELS[name].of_orbit) if one}))
