"""The Dataset that is measured into: its variables with units, the cases with their references, and provenance."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.accuracy import cases
from benchmarks.tables import machine, versions
from phasemap.results.variables import coded, provenance

if TYPE_CHECKING:
    import xarray as xr

    from benchmarks.accuracy.cases import Field, Known
    from benchmarks.accuracy.methods import Method

Array = np.ndarray

GOOD, NO_ORBIT, OTHER_ORBIT, NOT_RUN, NO_REFERENCE = range(5)
"""What became of a method on a case."""
RESULTS = ("good", "no_orbit", "other_orbit", "not_run", "no_reference")

ALL = ("regime", "solver", "case")  # not "method", which Dataset.sel takes for its own argument
MEASURED = {
    "phase_error": (ALL, "phase less that of the reference", "degree"),
    "height_error": (ALL, "height less that of the reference", "m"),
    "phase_bound": (ALL, "error of the phase as the solver estimates it", "degree"),
    "height_bound": (ALL, "error of the height as the solver estimates it", "m"),
    "time": (ALL[:2], "time per distinct pixel on one core, after compilation", "s"),
    "period_time": (ALL[:2], "time per period of the oscillation on one core", "s"),
    "compile_time": (ALL[1:2], "processor time of compilation", "s"),
}
PARAMETERS = {
    "stiffness": ("stiffness of the lever", "N m-1"),
    "quality_factor": ("quality factor of the lever", "1"),
    "free_amplitude": ("free amplitude at resonance", "m"),
    "radius": ("radius of the tip", "m"),
    "decay_length": ("decay length of the attraction", "m"),
    "frequency_ratio": ("drive frequency over resonance frequency", "1"),
    "modulus": ("modulus of the sample", "Pa"),
    "adhesion": ("work of adhesion", "J m-2"),
    "damping": ("damping alpha1", "1"),
    "poisson_ratio": ("Poisson's ratio of the sample", "1"),
    "setpoint": ("amplitude over free amplitude", "1"),
}
REFERENCE = {
    "phase": ("phase of the reference", "degree"),
    "tip_offset": ("tip offset of the reference", "m"),
    "mean_deflection": ("mean deflection of the reference", "m"),
    "floquet": ("largest modulus of the Floquet multipliers of the reference", "1"),
    "phase_uncertainty": ("bound of the reference's own error in phase", "degree"),
    "height_uncertainty": ("bound of the reference's own error in height", "m"),
}


def unmeasured(methods: tuple[Method, ...], fields: tuple[Field, ...], configuration: dict[str, Any]) -> xr.Dataset:
    """The Dataset before anything is measured: NaN, and the cases with what is right on them.

    `configuration`: what is to be measured, for its attribute of that name.
    Returns dims ("regime", "solver", "case"); a solver is one of phasemap's or a peer, at one tolerance.
    """
    import xarray as xr

    sizes = dict(zip(ALL, (len(fields), len(methods), max(len(field.known) for field in fields)), strict=True))
    data: dict[str, Any] = {
        name: (dims, np.full([sizes[dim] for dim in dims], np.nan), {"long_name": long_name, "units": units})
        for name, (dims, long_name, units) in MEASURED.items()
    }
    result = np.full(tuple(sizes.values()), NO_REFERENCE, np.int8)
    data["result"] = (ALL, result, coded("what became of the method on the case", *RESULTS))
    coords = {
        "regime": ("regime", [field.name for field in fields], {"long_name": "regime"}),
        "solver": ("solver", [method.label for method in methods], {"long_name": "solver and its tolerance"}),
        "family": ("solver", [method.family for method in methods], {"long_name": "solver"}),
    }
    about = provenance(configuration, "measured") | {
        "machine": machine(),
        "versions": versions(*(method.family for method in methods if method.peer is not None)),
    }
    return xr.Dataset(data | _of_cases(fields, sizes["case"]), coords, about)


def _of_cases(fields: tuple[Field, ...], width: int) -> dict[str, Any]:
    """Parameters and references."""

    def gathered(value: Callable[[Known], Any], missing: float, dtype: type = float) -> tuple[tuple[str, str], Array]:
        values: Array = np.full((len(fields), width), missing, dtype)
        for r, field in enumerate(fields):
            values[r, : len(field.known)] = [value(known) for known in field.known]
        return ("regime", "case"), values

    def parameter(name: str) -> Callable[[Known], Any]:
        return lambda known: np.nan if (x := getattr(known.case, name)) is None else x

    data: dict[str, Any] = {}
    for name, (long_name, units) in PARAMETERS.items():
        data[name] = (*gathered(parameter(name), np.nan), {"long_name": long_name, "units": units})
    for name, (long_name, units) in REFERENCE.items():
        found = gathered(lambda known, name=name: getattr(known.reference, name, np.nan), np.nan)  # type: ignore[misc]
        data[f"reference_{name}"] = (*found, {"long_name": long_name, "units": units})
    outcomes = gathered(lambda known: known.outcome, cases.NOT_HELD, np.int8)
    data["reference"] = (*outcomes, coded("what became of the reference", *cases.OUTCOMES))
    return data
