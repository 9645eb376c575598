"""Derived channels of two materials over a map of working points."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels import columns as col
from phasemap.experiment.material import Material
from phasemap.experiment.properties import film_of, properties
from phasemap.results.quantities import CHANNELS, motion_of
from phasemap.results.variables import FLOATS
from phasemap.solvers.integrals import bare_rows, widened
from phasemap.solvers.problem import material_row
from phasemap.sweeps.contrasts.dataset import DIMS
from phasemap.sweeps.contrasts.pair import Axes, Engaged, Pair

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]


def derived(
    names: tuple[str, ...], pair: Pair, materials: tuple[Material, Material], labels: tuple[str, str], axes: Axes,
    engaged: Engaged,
) -> dict[str, xr.Variable]:  # fmt: skip
    """Channels of each material, and of the second less the first under the name with ``_contrast``.

    `names`: of `phasemap.results.quantities.CHANNELS`.
    `engaged`: arrays of shape (2, frequencies, free amplitudes, setpoints, ...).
    """
    import xarray as xr

    given = [material_row(one) for one in materials]
    bare = np.concatenate([bare_rows(properties(*one, pair.scope)[0], pair.scope, film_of(one[0])) for one in given])
    values = {name: np.full(engaged.rows.shape[:-1], np.nan) for name in names}
    for i, frequency in enumerate(axes[0]):
        for k, free in enumerate(axes[1]):
            scope, work = pair.at(frequency, free), pair.work(frequency, free, axes[2])
            rows = engaged.rows[:, i, k].reshape(-1, col.COLUMNS)
            used = engaged.solver[:, i, k].reshape(-1)
            wide = widened(rows, work, used, scope, partial(np.repeat, bare, len(axes[2]), axis=0), _used(names))
            orbit = {name: FLOATS[name].value(wide) for name in _used(names)}
            motion = motion_of(scope, wide[:, col.AMPLITUDE], np.degrees(wide[:, col.PHASE]), orbit)
            for name in names:
                values[name][:, i, k] = CHANNELS[name].value(motion).reshape(2, -1)
    found: dict[str, Any] = {}
    for name in names:
        channel = CHANNELS[name]
        about = {"units": channel.units, "references": channel.source, "ancillary_variables": "status"}
        found[name] = xr.Variable(("material", *DIMS), values[name], {"long_name": channel.long_name, **about})
        long_name = f"contrast of the {channel.long_name}, {labels[1]} less {labels[0]}"
        contrast = values[name][1] - values[name][0]
        found[f"{name}_contrast"] = xr.Variable(DIMS, contrast, {"long_name": long_name, **about})
    return found


def _used(names: tuple[str, ...]) -> set[str]:
    """Integrals over the orbit that these channels are made of."""
    return {one for name in names for one in (*CHANNELS[name].needs, CHANNELS[name].of_orbit) if one}
