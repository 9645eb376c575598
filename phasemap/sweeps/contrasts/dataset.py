"""A map of the contrast as a Dataset: what its variables are called, what they mean, and in which units."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from phasemap.results.variables import FLOATS, branch_of, coded, flag_attributes, float_attributes, motion_of
from phasemap.sweeps.contrasts.edges import Inversion, Jump
from phasemap.sweeps.contrasts.pair import REGIMES, Axes, Engaged

Array = np.ndarray

DIMS = ("frequency", "free_amplitude", "setpoint")
ABOUT = {
    "frequency": {"long_name": "drive frequency", "units": "Hz"},
    "free_amplitude": {"long_name": "free amplitude at resonance", "units": "m"},
    "setpoint": {"long_name": "setpoint (amplitude over free amplitude at the drive frequency)", "units": "1"},
}


def record(
    axes: Axes,
    names: Sequence[str],
    engaged: Engaged,
    regime: Array,
    jumps: Sequence[Jump],
    inversions: Sequence[Inversion],
) -> xr.Dataset:
    """Make the Dataset of a map as `phasemap.contrast` describes it, with all its dimensions, without attributes.

    `engaged`, `regime`: arrays of shape (2, frequencies, free amplitudes, setpoints, ...).
    """
    coords: dict[str, Any] = {dim: (dim, values, ABOUT[dim]) for dim, values in zip(DIMS, axes, strict=True)}
    coords["material"] = ("material", list(names), {"long_name": "material"})
    dims = ("material", *DIMS)
    both = f"{names[1]} minus {names[0]}"
    status = {"ancillary_variables": "status"}
    value = {name: FLOATS[name].value(engaged.rows) for name in ("phase", "height", "indentation", "phase_spread")}
    phase, height = (value[name][1] - value[name][0] for name in ("phase", "height"))
    data = {
        "contrast": (DIMS, phase, {"long_name": f"phase contrast, {both}", "units": "degree", **status}),
        "height_contrast": (
            DIMS, height, {"long_name": f"height contrast, {both}", "units": "m", **status},
        ),
        **{name: (dims, value[name], {**float_attributes(name), **status}) for name in value},
        "regime": (
            dims, regime, coded("regimes in which a stable orbit holds the setpoint", *REGIMES),
        ),
        "branch": (dims, branch_of(engaged.rows), flag_attributes("branch")),
        "motion": (dims, motion_of(engaged.rows), flag_attributes("motion")),
        "status": (dims, engaged.status, flag_attributes("status")),
        "solver": (dims, engaged.solver, flag_attributes("solver")),
        **_points("inversion", "inversion of the contrast", inversions),
        **_points("jump", "jump", jumps),
    }  # fmt: skip
    degree = {"units": "degree"}
    data["inversion_phase"] = (
        "inversion", np.array([zero.phase for zero in inversions], float),
        {"long_name": "phase of both materials at the inversion", **degree},
    )  # fmt: skip
    material = np.array([jump.material for jump in jumps], np.int8)
    data["jump_material"] = ("jump", material, coded("material whose phase jumps", *names))
    for word, side in (("from", "before"), ("to", "after")):
        phases = np.array([getattr(jump, side) for jump in jumps]).reshape(-1, 2)
        own, contrast = phases[np.arange(len(jumps)), material], phases[:, 1] - phases[:, 0]
        data[f"jump_{word}_contrast"] = ("jump", contrast, {"long_name": f"contrast {side} the jump", **degree})
        data[f"jump_{word}_phase"] = ("jump", own, {"long_name": f"phase {side} the jump", **degree})
    inverts = np.array([jump.inverts for jump in jumps], np.int8)
    data["jump_inverts"] = ("jump", inverts, coded("whether the contrast changes its sign in the jump", "no", "yes"))
    return xr.Dataset(data, coords)


def _points(dim: str, what: str, found: Sequence[Jump] | Sequence[Inversion]) -> dict[str, Any]:
    """Variables with the positions of jumps or inversions."""
    points = np.array([one.point for one in found]).reshape(-1, 3)
    return {
        f"{dim}_{name}": (dim, points[:, i], {**ABOUT[name], "long_name": f"{ABOUT[name]['long_name']} of the {what}"})
        for i, name in enumerate(DIMS)
    }
