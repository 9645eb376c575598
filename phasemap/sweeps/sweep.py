"""Sweeps: what a slow change of tip offset, setpoint, frequency or any parameter shows, and every branch behind it."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from phasemap._shared.arrays import real_numbers
from phasemap._shared.asked import asked_as
from phasemap._shared.checks import check_choice, number
from phasemap._shared.errors import InputError
from phasemap._shared.notices import question
from phasemap._shared.quantities import Scalar
from phasemap.experiment.cantilever import FREQUENCY
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Microscope
from phasemap.solvers.continuation.path import NUMBERS, UNITS
from phasemap.solvers.problem import check_setpoint
from phasemap.sweeps.follow import distance, parameter, setpoint

OFFSETS = (0.0, 1e-4)  # m, where a tip is held in practice


@asked_as()
def sweep_distance(material: Material, scope: Microscope, tip_offsets: Any, *, samples: int = 0) -> xr.Dataset:
    """Approach the surface and retract again: amplitude, phase and all else against the tip offset.

    Parameters
    ----------
    material : Material
    scope : Microscope
    tip_offsets : array_like or str
        Rest positions of the tip above the undeformed surface [m], rising or falling; negative where the lever presses.
        They may have units, and be START:STOP:N: "60 nm:10 nm:100". So may the values of the other sweeps.
    samples : int
        Points of the time trace of deflection and force that each orbit gets; 0 for none.

    Returns
    -------
    xarray.Dataset
        What a slow sweep sees has dims ("direction", "tip_offset"), with the directions "approach" and "retract".
        The complete curve with its unstable parts has the dim "point" and variables that begin with `curve_`; folds
        have the dim "fold", jumps of the sweep the dim "jump". Where contacts remember, the sweep is marched in time:
        there is no curve, and so neither folds nor jumps.

    Examples
    --------
    >>> import numpy as np, phasemap as pm
    >>> scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(16e-9))
    >>> curve = pm.sweep_distance(pm.Material(modulus=2e9, adhesion=0.1), scope, np.linspace(18e-9, 10e-9, 41))
    >>> curve.sizes["fold"], curve.jump_direction.values.tolist()
    (2, [0, 1])
    """
    axis = check_axis("tip_offsets", tip_offsets, "m", usual=OFFSETS)
    return distance(material, scope, axis, check_samples(samples))


@asked_as()
def sweep_setpoint(material: Material, scope: Microscope, setpoints: Any, *, samples: int = 0) -> xr.Dataset:
    """Lower the setpoint from the highest to the lowest and raise it again, with the feedback on.

    Parameters
    ----------
    material : Material
    scope : Microscope
    setpoints : array_like
        Amplitudes over the free amplitude at the drive frequency, between 0 and 1, rising or falling.
    samples : int
        As in `sweep_distance`.

    Returns
    -------
    xarray.Dataset
        As of `sweep_distance`, with dims ("direction", "setpoint") and the directions "down" and "up".

    Examples
    --------
    >>> import numpy as np, phasemap as pm
    >>> scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(16e-9))
    >>> curve = pm.sweep_setpoint(pm.Material(modulus=2e9, adhesion=0.1), scope, np.linspace(0.95, 0.3, 14))
    >>> curve.phase.sel(direction="down").values[[0, -1]].round(2).tolist()
    [-18.19, 72.54]
    """
    axis = check_axis("setpoints", setpoints, "1")
    for value in axis:
        check_setpoint(value)
    return setpoint(material, scope, axis, check_samples(samples))


@asked_as()
def sweep_frequency(
    material: Material, scope: Microscope, frequencies: Any, *, tip_offset: Scalar, samples: int = 0
) -> xr.Dataset:
    """Sweep the drive's frequency up and down at a fixed tip offset and a fixed base amplitude.

    Parameters
    ----------
    material : Material
    scope : Microscope
        Its drive says the free amplitude at resonance; its own frequency is not used.
    frequencies : array_like
        [Hz], rising or falling.
    tip_offset : float
        Rest position of the tip above the undeformed surface [m].
    samples : int
        As in `sweep_distance`.

    Returns
    -------
    xarray.Dataset
        As of `sweep_distance`, with dims ("direction", "frequency") and the directions "up" and "down".

    Examples
    --------
    >>> import numpy as np, phasemap as pm
    >>> scope = pm.Microscope(pm.Cantilever(40.0, 148.24e3, 250.0), pm.Tip(30e-9), pm.Drive(155e-9))
    >>> film = pm.Material(modulus=0.89e9, adhesion=0.37, damping=0.014)
    >>> curve = pm.sweep_frequency(film, scope, np.linspace(146.5e3, 150e3, 71), tip_offset=140e-9)
    >>> curve.sizes["direction"], bool((curve.status == 0).all())
    (2, True)
    """
    axis = check_axis("frequencies", frequencies, "Hz", above=0, usual=FREQUENCY)
    height = _offset(tip_offset)
    return parameter(material, scope, "frequency", axis, None, height, check_samples(samples))


@asked_as()
def sweep_parameter(
    material: Material,
    scope: Microscope,
    name: str,
    values: Any,
    *,
    setpoint: Scalar | None = None,
    tip_offset: Scalar | None = None,
    samples: int = 0,
) -> xr.Dataset:
    """Change one parameter of the material or the microscope slowly, up and down, at a fixed setpoint or tip offset.

    Parameters
    ----------
    material : Material
    scope : Microscope
    name : str
        "modulus", "adhesion", "damping", "viscosity", "poisson_ratio", "thickness", "relaxed_modulus",
        "relaxation_time", "liquid_film", "contact_angle", "stiffness", "quality_factor", "radius", "free_amplitude",
        "frequency", "decay_length" or "bias".
    values : array_like
        In the parameter's SI unit, rising or falling.
    setpoint : float
        Amplitude over the free amplitude that a feedback holds. Either this or `tip_offset`.
    tip_offset : float
        Rest position of the tip that is held [m].
    samples : int
        As in `sweep_distance`.

    Returns
    -------
    xarray.Dataset
        As of `sweep_distance`, with dims ("direction", name) and the directions "up" and "down".

    Examples
    --------
    >>> import numpy as np, phasemap as pm
    >>> scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(20e-9))
    >>> soft = pm.Material(modulus=1e9, adhesion=0.05, damping=0.01)
    >>> curve = pm.sweep_parameter(soft, scope, "modulus", np.geomspace(0.5e9, 5e9, 11), setpoint=0.7)
    >>> curve.phase.sel(direction="up").values[[0, -1]].round(1).tolist()
    [38.1, 44.9]
    """
    if (setpoint is None) == (tip_offset is None):
        raise InputError("setpoint, tip_offset", (setpoint, tip_offset), "exactly one of the two")
    ratio = None if setpoint is None else check_setpoint(setpoint)
    height = None if tip_offset is None else _offset(tip_offset)
    check_choice("parameter", name, NUMBERS)
    axis = check_axis(name, values, UNITS[name], usual=NUMBERS[name].usual)
    return parameter(material, scope, name, axis, ratio, height, check_samples(samples))


def _offset(value: object) -> float:
    """A tip offset [m]."""
    offset = number("tip_offset", value, "m")
    question("tip_offset", offset, "m", OFFSETS)
    return offset


def check_axis(
    name: str, values: Any, unit: str, above: float = -np.inf, usual: tuple[float, float] | None = None
) -> np.ndarray:
    """Return the values of a sweep as an array, in `unit` where they have one, and warn of what is not `usual`."""
    axis = real_numbers(name, values, unit)
    if axis.ndim != 1 or len(axis) < 2:
        raise InputError(name, f"an array of shape {axis.shape}", "at least two values in one dimension")
    for value in axis[~(np.isfinite(axis) & (axis > above))][:1]:
        number(name, float(value), unit, above=above)
    steps = np.diff(axis)
    if not ((steps > 0).all() or (steps < 0).all()):
        wrong = int(np.flatnonzero(np.sign(steps) != (np.sign(steps[0]) or 1))[0])
        pair = f"{axis[wrong]:g}, {axis[wrong + 1]:g} (values {wrong + 1} and {wrong + 2})"
        raise InputError(name, pair, "values that only rise or only fall")
    if usual is not None:  # a sweep may go beyond on purpose, but not begin and end there
        question(name, float(min(axis[axis != 0][[0, -1]], key=abs)), unit, usual)
    return axis


def check_samples(samples: object) -> int:
    """Return the length of the time traces."""
    if isinstance(samples, bool) or not isinstance(samples, (int, np.integer)) or not 0 <= samples <= 65536:
        raise InputError("samples", samples, "an integer from 0 to 65536")
    return int(samples)
