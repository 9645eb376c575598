"""The Dataset of a sweep: its variables in both directions, the curves behind them, folds and jumps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from phasemap._kernels import columns as col
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Microscope
from phasemap.results.variables import (
    FLOATS,
    STABILITY,
    branch_of,
    coded,
    describe,
    flag_attributes,
    float_attributes,
    motion_of,
    provenance,
)
from phasemap.solvers.continuation.pieces import Curves
from phasemap.solvers.continuation.visit import Jump, Visit, stable

NAMES = (
    "amplitude", "phase", "height", "tip_offset", "mean_deflection", "indentation", "dissipation", "virial",
    "mean_force", "peak_force", "least_force", "contact_time", "floquet", "multiplier_real", "multiplier_imag",
    "feedback_slope", "energy_closure", "amplitude_spread", "phase_spread",
)  # fmt: skip
Variables = dict[str, tuple[Any, Any, dict[str, Any]]]
HARMONICS = np.arange(2, 2 + col.HARMONICS)


@dataclass(frozen=True, eq=False)
class Axis:
    """What is swept: name, values in the order asked for, unit, long name, directions, column of the full rows.

    With `held` a feedback holds the amplitude, and must be stable too. `fold` is the kind of row at which the axis
    turns.
    """

    name: str
    values: np.ndarray
    units: str
    long_name: str
    directions: tuple[str, str]
    column: int = col.TIP_OFFSET
    held: bool = False
    fold: int = col.FOLD


def dataset(
    curves: Curves,
    axis: Axis,
    value: Callable[[np.ndarray], np.ndarray],
    visits: list[Visit],
    material: Material,
    scope: Microscope,
    held: dict[str, Any],
) -> xr.Dataset:
    """Make the Dataset of a sweep; `value` makes values of the axis from its column, `held` is for the provenance."""
    order = np.argsort(np.argsort(axis.values))  # the kernels had the values in rising order
    rows = curves.seen(np.stack([visit.rows[order] for visit in visits]))
    dims = ("direction", axis.name)
    data = _variables("", rows, dims, axis.name)
    status = np.stack([visit.status[order] for visit in visits]).astype(np.int8)
    data["status"] = (dims, status, flag_attributes("status"))
    data |= _curve(curves, axis, value)
    data |= _jumps(curves, [jump for visit in visits for jump in visit.jumps], axis, value)
    coordinates: Variables = {
        "direction": ("direction", list(axis.directions), {"long_name": "direction of the sweep"}),
        axis.name: (axis.name, axis.values, {"long_name": axis.long_name, "units": axis.units}),
        "harmonic": ("harmonic", HARMONICS, {"long_name": "number of the harmonic", "units": "1"}),
    }
    if curves.samples:
        data |= _traces(np.stack([visit.traces[order] for visit in visits]), dims)
        steps = np.arange(curves.samples) / curves.samples * 360
        coordinates["drive_phase"] = ("drive_phase", steps, {"long_name": "phase of the drive", "units": "degree"})
    configuration = {"material": describe(material), "microscope": describe(scope), "sweep": axis.name, **held}
    return xr.Dataset(data, coordinates, provenance(configuration, f"{axis.long_name} swept"))


def _variables(prefix: str, rows: np.ndarray, dims: tuple[str, ...], axis: str) -> Variables:
    """Every float variable of full rows, and their branch."""
    data: Variables = {
        prefix + name: (dims, FLOATS[name].value(rows), float_attributes(name))
        for name in NAMES
        if prefix or name != axis
    }
    amplitudes = rows[..., col.HARMONIC : col.HARMONIC + col.HARMONICS]
    attributes = {"long_name": "amplitude of a harmonic of the deflection", "units": "m"}
    data[prefix + "harmonics"] = ((*dims, "harmonic"), amplitudes, attributes)
    data[prefix + "branch"] = (dims, branch_of(rows), flag_attributes("branch"))
    data[prefix + "motion"] = (dims, motion_of(rows), flag_attributes("motion"))
    return data


def _traces(traces: np.ndarray, dims: tuple[str, ...]) -> Variables:
    """Deflection and force over a period of the drive."""
    words = (("trace_deflection", "deflection over a period", "m"), ("trace_force", "surface force over a period", "N"))
    return {
        name: ((*dims, "drive_phase"), traces[..., i, :], {"long_name": long_name, "units": units})
        for i, (name, long_name, units) in enumerate(words)
    }


def _curve(curves: Curves, axis: Axis, value: Callable[[np.ndarray], np.ndarray]) -> Variables:
    """The complete curve and its folds."""
    pieces, data = curves.pieces, Variables()
    rows = curves.seen(np.concatenate([piece.rows for piece in pieces]) if pieces else np.zeros((0, col.FULL)))
    number = np.repeat(np.arange(len(pieces), dtype=np.int32), [len(piece.rows) for piece in pieces])
    for prefix, dim, part in (("curve_", "point", slice(None)), ("fold_", "fold", rows[:, col.KIND] == axis.fold)):
        some = rows[part]
        data |= _variables(prefix, some, (dim,), axis.name)
        if axis.name not in NAMES:
            attributes = {"long_name": axis.long_name, "units": axis.units}
            data[prefix + axis.name] = (dim, value(some[:, axis.column]), attributes)
        data[prefix + "piece"] = (dim, number[part], {"long_name": "number of the connected piece"})
    flags = stable(rows, axis.held) | (rows[:, col.KIND] == axis.fold)
    data["curve_stable"] = ("point", flags.astype(np.int8), coded("stability of the orbit", *STABILITY))
    return data


def _jumps(curves: Curves, jumps: list[Jump], axis: Axis, value: Callable[[np.ndarray], np.ndarray]) -> Variables:
    """Where sweeps jumped, from which orbit to which."""
    nothing = np.full(col.FULL, np.nan)
    ends = [jump.before for jump in jumps], [nothing if jump.after is None else jump.after for jump in jumps]
    before, after = (curves.seen(np.array(some).reshape(len(jumps), col.FULL)) for some in ends)
    attributes = {"long_name": axis.long_name + " at the jump", "units": axis.units}
    codes = np.array([jump.direction for jump in jumps], np.int8)
    data: Variables = {
        "jump_" + axis.name: ("jump", value(before[:, axis.column]), attributes),
        "jump_direction": ("jump", codes, coded("direction of the sweep that jumps", *axis.directions)),
    }
    for word, some in (("from", before), ("to", after)):
        for name in ("amplitude", "phase", "tip_offset"):
            data[f"jump_{word}_{name}"] = ("jump", FLOATS[name].value(some), float_attributes(name))
    return data
