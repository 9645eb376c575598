"""Names, meanings and units of variables, and the words of flags: one table for every Dataset."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from datetime import UTC, datetime
from functools import cache
from numbers import Real
from typing import Any, NamedTuple, TypeVar

import numpy as np
import xarray as xr

from phasemap._kernels import columns as col
from phasemap._kernels.columns import ADHESION_LOSS, ADHESION_VIRIAL, DRAG, GRADIENT, LOSSES, SIDEBANDS, STORAGE, WAVES
from phasemap._shared.asked import asked_as
from phasemap._shared.errors import InputError
from phasemap.experiment.accuracy import ERROR_HEIGHT, ERROR_PHASE
from phasemap.experiment.control import Control
from phasemap.experiment.lever import DETECTED
from phasemap.experiment.lever_numbers import beat_of_second
from phasemap.results.status import Status

Array = np.ndarray
T = TypeVar("T", float, Array, "xr.DataArray")

CONVENTIONS = "CF-1.11"
SOLVER_NAMES = ("averaging", "orbit", "march", "interpolated", "corrected")  # in the order of their codes
STABILITY = ("unstable", "stable")  # likewise
ERRORS = 3.0  # of motion in time: what is spread by less may be periodic
BEATS = 2.0  # what two drives spread, over the beat of the second alone: mostly 0.5 to 2, far more where they resonate


class Variable(NamedTuple):
    """A float variable of a result."""

    long_name: str
    units: str
    value: Callable[[Array], Array]  # of result rows, shape (..., COLUMNS)
    description: str = ""
    wide: tuple[int, ...] = ()  # columns of wide rows that it takes: a number, or real and imaginary part of one


def _column(long_name: str, units: str, index: int, description: str = "") -> Variable:
    """Variable that is a column of result rows; angles are in radians there."""
    if units == "degree":
        return Variable(long_name, units, lambda rows: rows[..., index] * (180 / np.pi), description)
    return Variable(long_name, units, lambda rows: rows[..., index], description)


def _wide(long_name: str, units: str, index: int, description: str = "") -> Variable:
    """Variable that is a column of wide rows."""
    return _column(long_name, units, index, description)._replace(wide=(index,))


def _spread(long_name: str, units: str, index: int) -> Variable:
    """Variable of a spread, which no solver of periodic orbits fills in: 0 there, NaN where there is no motion."""
    column = _column(long_name, units, index, LOCK_IN)
    value = column.value
    return column._replace(
        value=lambda rows: np.where(np.isnan(rows[..., col.AMPLITUDE]), np.nan, np.nan_to_num(value(rows)))
    )


def _multiplier(rows: Array) -> Array:
    """The Floquet multiplier of larger modulus, from trace and determinant of the monodromy matrix."""
    half = rows[..., col.TRACE] / 2 + 0j
    root = np.sqrt(half * half - rows[..., col.PRODUCT])
    return np.where(half.real >= 0, half + root, half - root)


def _harmonic(n: int) -> dict[str, Variable]:
    """Variables of a harmonic: amplitude and phase."""
    real, imaginary = both = (WAVES + 2 * (n - 2), WAVES + 2 * (n - 2) + 1)

    def wave(rows: Array) -> Array:
        return rows[..., real] + 1j * rows[..., imaginary]

    size = Variable(f"amplitude of harmonic {n}", "m", lambda rows: np.abs(wave(rows)), wide=both)
    phase = Variable(
        f"phase of harmonic {n} against that of the first", "degree", lambda rows: np.degrees(np.angle(wave(rows))),
        f"phi of z = A cos(theta) + A_{n} cos({n} theta + phi), A and theta of the first harmonic", both,
    )  # fmt: skip
    return {f"amplitude_{n}": size, f"phase_{n}": phase}


LOCK_IN = (
    "0 for a periodic orbit; else of a lock-in with a first-order low-pass at a hundredth of the drive frequency, "
    "of which amplitude and phase are the mean"
)
AGAINST = "against the exact periodic orbit; NaN where first-order averaging was asked for, which knows none"
FLOATS: dict[str, Variable] = {
    "height": Variable(
        "height (topography + tip offset - setpoint amplitude)", "m",
        lambda rows: rows[..., col.TIP_OFFSET] - rows[..., col.AMPLITUDE],
    ),
    "phase": _column("phase, 0 at free resonance, positive repulsive", "degree", col.PHASE),
    "amplitude": _column("amplitude of the first harmonic", "m", col.AMPLITUDE),
    "amplitude_error": _column("amplitude minus setpoint amplitude", "m", col.AMPLITUDE_ERROR),
    "tip_offset": _column("tip offset (rest position of the tip above the surface)", "m", col.TIP_OFFSET),
    "amplitude_spread": _spread("standard deviation of the amplitude behind the lock-in", "m", col.SPREAD_AMPLITUDE),
    "phase_spread": _spread("standard deviation of the phase behind the lock-in", "degree", col.SPREAD_PHASE),
    "mean_deflection": _column("mean deflection, positive towards the surface", "m", col.MEAN),
    "indentation": _column("largest indentation, negative without contact", "m", col.INDENTATION),
    "dissipation": _column("energy dissipated in the surface per cycle", "J", col.DISSIPATION),
    "virial": _column("virial of the tip-surface force, positive attractive", "J", col.VIRIAL),
    "adhesion_virial": _wide(
        "virial of the attraction alone, in the first harmonic, positive attractive", "J", ADHESION_VIRIAL,
        "of the force less that of the same contact without adhesion and bias; of periodic orbits",
    ),
    "adhesion_loss": _wide("energy that necks of the contact take per cycle", "J", ADHESION_LOSS),
    "contact_storage": _wide(
        "energy that the contact stores, without its adhesion", "J", STORAGE,
        "mean of F' (dd/dtheta)^2 over the cycle, F' the slope of the force with depth without adhesion and bias; "
        "where the tip moves as a sine, the virial of repulsion",
    ),
    "error_phase": _column("estimated error of the phase", "degree", col.ERROR_PHASE, AGAINST),
    "error_height": _column("estimated error of the height", "m", col.ERROR_HEIGHT, AGAINST),
    "energy_closure": _column(
        "energy in minus energy out, over energy in", "1", col.CLOSURE,
        "of the first harmonic alone where the solver is averaging or interpolated",
    ),
    "floquet": _column("largest modulus of the Floquet multipliers", "1", col.FLOQUET),
    "feedback_slope": _column("change of amplitude with tip offset", "1", col.SLOPE),
    "mean_force": _column("mean force of the surface on the tip, positive repulsive", "N", col.MEAN_FORCE),
    "peak_force": _column(
        "largest force of the surface on the tip", "N", col.PEAK_FORCE,
        "at points along the orbit: up to 1e-4 of itself below the true one",
    ),
    "least_force": _column("smallest force of the surface on the tip", "N", col.LEAST_FORCE),
    "contact_time": _column("share of the period in contact, necks included", "1", col.CONTACT_TIME),
    "multiplier_real": Variable("real part of the larger Floquet multiplier", "1", lambda rows: _multiplier(rows).real),
    "multiplier_imag": Variable("its imaginary part", "1", lambda rows: _multiplier(rows).imag),
    "mean_gradient": _wide("mean slope of the surface's force with depth over a period", "N m-1", GRADIENT),
    "mean_damping": _wide("mean damping coefficient 2 alpha of the surface over a period", "1", DRAG),
    "sideband_stiffness": _wide(
        "what the second mode finds softer because modes yield at its sidebands", "N m-1", SIDEBANDS
    )._replace(wide=(SIDEBANDS, SIDEBANDS + 1)),
    "sideband_loss": _wide(
        "what the second mode loses for that reason, over its amplitude", "N m-1", SIDEBANDS + 1
    )._replace(wide=(SIDEBANDS, SIDEBANDS + 1)),
    **{name: one for n in range(2, 2 + col.HARMONICS) for name, one in _harmonic(n).items()},
    **{
        f"modal_dissipation_{i + 1}": _wide(
            f"energy dissipated by the damping of mode {i + 1} per cycle", "J", LOSSES + i
        )
        for i in range(col.MOST_MODES)
    },
}  # fmt: skip
IN_TIME = {
    "estimated_error": "none: in time there is no exact orbit to differ from, and what differs from the image at rest "
    "is the scan's doing; phasemap check scans it again",
    "energy_balance": "none: the energy of the oscillation changes with what passes under the tip",
}
"""Attributes of an image in time, instead of error_phase, error_height and energy_closure."""
FLAGS: dict[str, tuple[str, tuple[int, ...], tuple[str, ...]]] = {
    "branch": ("sign of the mean interaction", (-1, 0, 1), ("none", "attractive", "repulsive")),
    "motion": ("motion of the tip", (-1, 0, 1), ("none", "periodic", "irregular")),
    "status": ("status of the solution", tuple(s.code for s in Status), tuple(s.name for s in Status)),
    "solver": ("solver used", tuple(range(-1, len(SOLVER_NAMES))), ("none", *SOLVER_NAMES)),
}
IMAGE_VARIABLES = (
    "height", "phase", "amplitude", "tip_offset", "mean_deflection", "indentation", "dissipation", "virial",
    "branch", "status", "solver", "error_phase", "error_height", "energy_closure", "amplitude_spread", "phase_spread",
    "motion",
)  # fmt: skip
OF_ADHESION = ("adhesion_virial", "adhesion_loss", "contact_storage")
"""Variables of `phasemap.solvers.integrals.with_adhesion`."""
HARMONICS = tuple(name for n in range(2, 2 + col.HARMONICS) for name in (f"amplitude_{n}", f"phase_{n}"))
"""Harmonics of the tip's motion."""
MODAL = tuple(f"modal_dissipation_{i + 1}" for i in range(col.MOST_MODES))
OF_FORCES = ("mean_gradient", "mean_damping", "sideband_stiffness", "sideband_loss", *HARMONICS, *MODAL)
"""Variables of `phasemap.solvers.integrals.with_forces`."""
OF_ORBITS = {name: one.wide for name, one in FLOATS.items() if one.wide}
"""Columns of wide rows that each of these takes."""
WHERE_ASKED = (*OF_ADHESION, *OF_FORCES)
"""Variables of an image at rest that it has only where they are asked for: each costs an integral over every orbit."""
SCAN_VARIABLES = ("height", "amplitude_error", "phase", "amplitude", "tip_offset", "branch", "status", "solver")
"""Variables of a scan in time."""


@asked_as()
def phase_lag(phase: T) -> T:
    """Turn phase into the lag of the tip behind the drive, the other common convention.

    Parameters
    ----------
    phase : float, ndarray or DataArray
        [degree], 0 at free resonance, positive repulsive.

    Returns
    -------
    same type
        [degree], 90 at free resonance, below 90 repulsive; a DataArray says so in its ``long_name``.

    Examples
    --------
    >>> phase_lag(20.0)
    70.0
    """
    if not isinstance(phase, Real) and getattr(getattr(phase, "dtype", None), "kind", "") not in tuple("fiu"):
        raise InputError("phase", phase, "a number, an array or a DataArray of numbers [degree]")
    lag = 90.0 - phase
    if hasattr(lag, "assign_attrs"):
        lag = lag.assign_attrs(long_name="lag behind the drive, 90 at free resonance, below 90 repulsive")
    return lag


def word_of(name: str, code: int) -> str:
    """Word that a code of a flag variable stands for."""
    _, codes, meanings = FLAGS[name]
    return dict(zip(codes, meanings, strict=True)).get(code, "none")


def flag_attributes(name: str) -> dict[str, Any]:
    """CF attributes of a flag variable."""
    long_name, values, meanings = FLAGS[name]
    return {"long_name": long_name, "flag_values": np.array(values, np.int8), "flag_meanings": " ".join(meanings)}


def coded(long_name: str, *meanings: str, first: int = 0) -> dict[str, Any]:
    """CF attributes of a flag variable whose codes count up from the first."""
    words = " ".join(word.replace(" ", "_") for word in meanings)
    codes = np.arange(first, first + len(meanings), dtype=np.int8)
    return {"long_name": long_name, "flag_values": codes, "flag_meanings": words}


def float_attributes(name: str) -> dict[str, str]:
    """Long name and units of a float variable, and what else there is to say."""
    about = FLOATS[name]
    more = {"description": about.description} if about.description else {}
    return {"long_name": about.long_name, "units": about.units, **more}


def branch_of(rows: Array) -> Array:
    """Branch codes: 0 attractive, 1 repulsive, -1 where there is no orbit."""
    return np.where(np.isnan(rows[..., col.STIFFENING]), -1, col.is_repulsive(rows)).astype(np.int8)


def motion_of(rows: Array, lever: Array | None = None) -> Array:
    """Motion codes: 0 periodic, 1 irregular, -1 where there is none.

    What is spread by no more than integration in time is wrong by may be periodic. Two drives have no common period:
    their motion on a `lever` (of `lever_of`) is irregular where it beats more than they do by themselves.
    """
    amplitude, beat = rows[..., col.AMPLITUDE], 0.0 if lever is None else BEATS * beat_of_second(lever)
    irregular = rows[..., col.SPREAD_AMPLITUDE] > np.maximum(ERRORS * ERROR_HEIGHT, beat)
    irregular |= rows[..., col.SPREAD_PHASE] > np.maximum(ERRORS * ERROR_PHASE, beat / amplitude)
    return np.where(np.isnan(amplitude), -1, irregular).astype(np.int8)


def of_rows(
    rows: Array, names: Iterable[str], dims: str | tuple[str, ...], prefix: str = ""
) -> dict[str, tuple[Any, Any, dict[str, Any]]]:
    """Variables of result rows for a Dataset, ``branch`` and ``motion`` among them, with their attributes."""
    codes = {"branch": branch_of, "motion": motion_of}
    return {
        prefix + name: (dims, codes[name](rows), flag_attributes(name))
        if name in codes
        else (dims, FLOATS[name].value(rows), float_attributes(name))
        for name in names
    }


def variables_of(control: Control) -> tuple[str, ...]:
    """Names of the variables that an image taken under this control has."""
    return SCAN_VARIABLES if control.in_time else IMAGE_VARIABLES


def all_variables_of(control: Control) -> tuple[str, ...]:
    """Names of all variables under this control, with those that an image has only where they are asked for."""
    return SCAN_VARIABLES if control.in_time else (*IMAGE_VARIABLES, *WHERE_ASKED)


def check_variables(variables: object, known: tuple[str, ...] = IMAGE_VARIABLES) -> tuple[str, ...]:
    """Return the names of `known` variables asked for, all of them for None."""
    if variables is None:
        return known
    if not isinstance(variables, Iterable):
        raise InputError("variables", variables, "names out of " + ", ".join(known))
    names: tuple[Any, ...] = (variables,) if isinstance(variables, str) else tuple(variables)
    for name in names:
        if name not in known:
            raise InputError("variables", name, "names out of " + ", ".join(known))
    return tuple(name for name in known if name in names or name == "status")


def provenance(configuration: dict[str, Any], action: str) -> dict[str, Any]:
    """Global attributes that say where a Dataset comes from."""
    release = _release()
    scope = configuration.get("microscope")
    detected = {} if scope is None else {"detected": DETECTED[scope["drive"]["excitation"]]}
    now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    return {
        "Conventions": CONVENTIONS,
        "source": f"phasemap {release}",
        "phasemap_version": release,
        "configuration": json.dumps(configuration, sort_keys=True),
        **detected,
        "history": f"{now} {action} by phasemap {release}",
    }


@cache
def _release() -> str:
    """The version of this package; to look it up takes longer than to solve a pixel."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("afm-phasemap")
    except PackageNotFoundError:
        return "not installed"
