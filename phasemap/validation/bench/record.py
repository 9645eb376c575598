"""What was measured as an xarray Dataset, from which table and diagram are made; and questions asked of it."""

from __future__ import annotations

import os
import platform
import sys
from typing import TYPE_CHECKING, Any

import numpy as np

from phasemap.results.variables import coded, provenance
from phasemap.validation.bench import cases, measure

if TYPE_CHECKING:
    import xarray as xr

    from phasemap.validation.bench.cases import Field
    from phasemap.validation.bench.measure import Measured, Plan

Array = np.ndarray

ALL = ("regime", "solver", "case")  # not "method", which Dataset.sel takes for its own argument
MOST_OF = 0.95
"""Part of the cases on which a method must meet an error to be said to meet it."""
SAME = 1.05
"""Times within this ratio are one."""

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


def to_dataset(measured: Measured) -> xr.Dataset:
    """Everything that was measured, with units and provenance.

    Returns a Dataset over ("regime", "solver", "case"); a solver is one of phasemap's or a peer, at one tolerance.
    """
    import xarray as xr

    def floats(dims: tuple[str, ...], values: Array, long_name: str, units: str) -> Any:
        return dims, values, {"long_name": long_name, "units": units}

    pair = ALL[:2]
    data: dict[str, Any] = {
        "phase_error": floats(ALL, measured.phase_error, "phase less that of the reference", "degree"),
        "height_error": floats(ALL, measured.height_error, "height less that of the reference", "m"),
        "phase_bound": floats(ALL, measured.phase_bound, "error of the phase as the solver estimates it", "degree"),
        "height_bound": floats(ALL, measured.height_bound, "error of the height as the solver estimates it", "m"),
        "result": (ALL, measured.result, coded("what became of the method on the case", *measure.RESULTS)),
        "time": floats(pair, measured.time, "time per distinct pixel on one core, after compilation", "s"),
        "period_time": floats(pair, measured.period_time, "time per period of the oscillation on one core", "s"),
        "compile_time": floats(("solver",), measured.compile_time, "processor time of compilation", "s"),
    }
    data.update(_of_cases(measured.fields, measured.result.shape[2]))
    coords = {
        "regime": ("regime", [field.name for field in measured.fields], {"long_name": "regime"}),
        "solver": ("solver", [method.label for method in measured.methods], {"long_name": "solver and its tolerance"}),
        "family": ("solver", [method.family for method in measured.methods], {"long_name": "solver"}),
    }
    ds = xr.Dataset(data, coords)
    ds.attrs.update(provenance(_configuration(measured.plan), "measured"))
    ds.attrs.update(
        machine=machine(),
        versions=versions([method.family for method in measured.methods if method.peer is not None]),
        not_installed=", ".join(measured.absent),
        compilation="with an empty cache" if measured.plan.cold else "what was compiled before is reused",
        seed=measured.plan.seed,
        timed_pixels=measured.plan.batches * measured.plan.timed,
        seconds=round(measured.seconds, 1),
    )
    return ds


def _of_cases(fields: tuple[Field, ...], width: int) -> dict[str, Any]:
    """Parameters and references, over (regime, case)."""
    dims = ("regime", "case")

    def gathered(value: Any) -> Array:
        values = np.full((len(fields), width), np.nan)
        for r, field in enumerate(fields):
            for c, known in enumerate(field.known):
                values[r, c] = value(known)
        return values

    data: dict[str, Any] = {}
    for name, (long_name, units) in PARAMETERS.items():
        values = gathered(lambda known, name=name: np.nan if (x := getattr(known.case, name)) is None else x)
        data[name] = (dims, values, {"long_name": long_name, "units": units})
    for name, (long_name, units) in REFERENCE.items():
        values = gathered(lambda known, name=name: getattr(known.reference, name) if known.reference else np.nan)
        data[f"reference_{name}"] = (dims, values, {"long_name": long_name, "units": units})
    outcome = np.full((len(fields), width), cases.NOT_HELD, np.int8)
    for r, field in enumerate(fields):
        outcome[r, : len(field.known)] = [known.outcome for known in field.known]
    data["reference"] = (dims, outcome, coded("what became of the reference", *cases.OUTCOMES))
    return data


def _configuration(plan: Plan) -> dict[str, Any]:
    return {
        "batches": plan.batches, "timed": plan.timed, "references": plan.references, "seed": plan.seed,
        "budget": plan.budget, "rounds": plan.rounds, "regimes": [regime.name for regime in plan.regimes],
    }  # fmt: skip


def machine() -> str:
    """Processor, number of cores and system, as far as the system tells."""
    name = platform.processor() or platform.machine()
    if os.path.exists("/proc/cpuinfo"):
        with open("/proc/cpuinfo") as lines:
            name = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), name)
    return f"{name}, {os.cpu_count()} cores, {platform.system()} {platform.machine()}"


def versions(peers: list[str]) -> str:
    """Python, numpy, numba and the peers."""
    from importlib.metadata import version

    names = dict.fromkeys(["numpy", "numba", *peers])
    return ", ".join([f"Python {sys.version.split()[0]}", *(f"{name} {version(name)}" for name in names)])


def compared(ds: xr.Dataset) -> xr.DataArray:
    """Whether a method was run on a case that has a reference."""
    return ds["result"] < measure.NOT_RUN


def failures(ds: xr.Dataset) -> xr.DataArray:
    """How many cases of a regime a method failed on: no orbit, or one more than 1 degree off."""
    failed = (ds["result"] == measure.NO_ORBIT) | (ds["result"] == measure.OTHER_ORBIT)
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
