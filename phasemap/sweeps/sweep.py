"""Sweeps of tip offset, setpoint, frequency or any parameter, with every orbit behind them.

Also every orbit at one working point, and the force of the surface against depth.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from phasemap._kernels import columns as col
from phasemap._kernels.columns import FORMING, RELEASE
from phasemap._shared.arrays import real_numbers
from phasemap._shared.asked import asked_as
from phasemap._shared.checks import check_choice, whole
from phasemap._shared.errors import InputError, Word
from phasemap._shared.fields import Number
from phasemap._shared.quantities import Scalar
from phasemap.experiment.described import describe
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Microscope
from phasemap.results.variables import STABILITY, coded, of_rows, provenance
from phasemap.solvers.continuation.path import MOST_SAMPLES, NUMBERS, Question, path_of
from phasemap.solvers.continuation.whole_curves import curves_to_amplitude, curves_to_offset
from phasemap.solvers.problem import check_marched, check_setpoint, work_of_material
from phasemap.sweeps.follow import distance, parameter, setpoint

OFFSET = Number[float]("m", said="tip_offset", minimum=-1.0, maximum=1.0, usual=(0.0, 1e-4))
SETPOINT = Number[float]("1", said="setpoint")
DEPTH = Number[float]("m", said="depth", usual=(0.0, 1e-5))
DEPTHS = "-5 nm:2 nm:281"


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
    axis = check_axis("tip_offsets", tip_offsets, OFFSET)
    return distance(Question(material, scope), axis, whole("samples", samples, 0, MOST_SAMPLES))


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
    axis = check_axis("setpoints", setpoints, SETPOINT)
    for value in axis:
        check_setpoint(value)
    return setpoint(Question(material, scope), axis, whole("samples", samples, 0, MOST_SAMPLES))


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
    axis = check_axis("frequencies", frequencies, NUMBERS["frequency"])
    asked = Question(material, scope)
    return parameter(asked, "frequency", axis, None, _offset(tip_offset), whole("samples", samples, 0, MOST_SAMPLES))


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
        "frequency", "decay_length" or "bias". With the modulus of a material that relaxes goes what it relaxes to.
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
    height = 0.0 if tip_offset is None else _offset(tip_offset)
    check_choice("parameter", name, NUMBERS)
    axis = check_axis(name, values, NUMBERS[name])
    return parameter(Question(material, scope), name, axis, ratio, height, whole("samples", samples, 0, MOST_SAMPLES))


def _offset(value: object) -> float:
    """A tip offset [m]."""
    offset = OFFSET.check(value)
    assert offset is not None
    OFFSET.look_at(offset)
    return offset


def check_axis(name: str, values: Any, number: Number[Any]) -> np.ndarray:
    """Return the values of a sweep of a number as an array, in its unit, and warn of what is not usual."""
    axis, field = real_numbers(name, values, number.unit), number.called(name)
    if axis.ndim != 1 or len(axis) < 2:
        raise InputError(name, Word(f"an array of shape {axis.shape}"), "at least two values in one dimension")
    for value in axis.tolist():
        field.check(value)
    steps = np.diff(axis)
    if not ((steps > 0).all() or (steps < 0).all()):
        wrong = int(np.flatnonzero(np.sign(steps) != (np.sign(steps[0]) or 1))[0])
        pair = f"{axis[wrong]:g}, {axis[wrong + 1]:g} (values {wrong + 1} and {wrong + 2})"
        raise InputError(name, pair, "values that only rise or only fall")
    field.look_at(float(min(axis[axis != 0][[0, -1]], key=abs)))  # a sweep may go beyond, but not begin and end there
    return axis


@asked_as()
def orbits(
    material: Material, scope: Microscope, setpoint: Scalar | None = None, *, tip_offset: Scalar | None = None
) -> xr.Dataset:
    """Find every periodic orbit at a setpoint or at a tip offset, stable or not.

    Parameters
    ----------
    material : Material
    scope : Microscope
    setpoint : float
        Amplitude over the free amplitude at the drive frequency, between 0 and 1. Either this or `tip_offset`.
    tip_offset : float
        Rest position of the tip above the undeformed surface [m]; negative where the lever presses.

    Returns
    -------
    xarray.Dataset
        Dim "orbit", from far to near, or at one tip offset from the largest amplitude to the least: variables as of an
        image, with floquet, feedback_slope and stable. The attribute `complete` is 1 if every piece of the curve that
        was found was followed until it closes, leaves the range of the instrument, or ends where a contact with a force
        that jumps is made or lost; 0 if one was given up before.

    Examples
    --------
    >>> import phasemap as pm
    >>> scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(16e-9))
    >>> found = pm.orbits(pm.Material(modulus=2e9, adhesion=0.1), scope, setpoint=0.8)
    >>> found.sizes["orbit"], found.stable.values.tolist()
    (3, [1, 0, 1])
    """
    if (setpoint is None) == (tip_offset is None):
        raise InputError("setpoint, tip_offset", (setpoint, tip_offset), "exactly one of the two")
    path = path_of(Question(material, scope))
    if setpoint is not None:
        setpoint = check_setpoint(setpoint)
        curves = curves_to_amplitude(path, setpoint * scope.driven_amplitude)
    else:
        tip_offset = _offset(tip_offset)
        curves = curves_to_offset(path, tip_offset)
    rows = curves.seen(curves.wanted_rows)
    rows = rows[np.argsort(-rows[:, col.AMPLITUDE if setpoint is None else col.TIP_OFFSET], kind="stable")]
    configuration = {
        "microscope": describe(scope), "material": describe(material), "setpoint": setpoint, "tip_offset": tip_offset
    }  # fmt: skip
    ds = _orbit_dataset(rows)
    ds.attrs.update(provenance(configuration, "orbits found"))
    ds.attrs["complete"] = int(curves.all_followed)
    return ds


def _orbit_dataset(rows: np.ndarray) -> xr.Dataset:
    """Dataset along `orbit` of result rows, with their stability."""
    names = (
        "tip_offset", "amplitude", "height", "phase", "mean_deflection", "indentation", "dissipation", "virial",
        "floquet", "feedback_slope", "energy_closure", "branch",
    )  # fmt: skip
    ds = xr.Dataset(of_rows(rows, names, "orbit"))
    ds["orbit"] = ("orbit", np.arange(len(rows)), {"long_name": "orbit"})
    stable = (rows[:, col.FLOQUET] < 1).astype(np.int8)
    ds["stable"] = ("orbit", stable, coded("stability of the orbit at fixed tip offset", *STABILITY))
    return ds


@asked_as()
def force_curve(material: Material, scope: Microscope, depths: Any = DEPTHS) -> xr.Dataset:
    """The conservative force of a material on the tip, approaching and retracting.

    Parameters
    ----------
    material : Material
    scope : Microscope
        Its tip and its interaction.
    depths : array_like or str, optional
        How deep the tip is in the surface [m], negative outside, rising or falling.

    Returns
    -------
    xarray.Dataset
        Dims ("direction", "depth"), approach and retract: force [N], positive repulsive. The two differ where a law of
        contact draws out a neck, where one of liquid forms, and where a law or a table has another force on the way
        out of contact. Damping and losses that need a velocity are not in it.

    Examples
    --------
    >>> import phasemap as pm
    >>> scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip("10 nm"), pm.Drive("20 nm"))
    >>> curve = pm.force_curve(pm.Material("3 GPa", adhesion="50 mJ/m^2"), scope, ["-0.3 nm", "0 nm", "1 nm"])
    >>> (1e9 * curve.force.sel(direction="approach")).round(2).values.tolist()
    [-0.79, -3.14, 11.27]
    """
    # What the page without a server has not.
    from phasemap._kernels.law import contact_force, longrange_force, withdrawn_force

    axis = check_axis("depths", depths, DEPTH)
    work = work_of_material(material, scope, scope.driven_amplitude, marched=scope.interaction.law.in_time)
    row, law = work.rows[0], work.law
    if law.memory:
        check_marched(False, scope, remembers=True)
    forces = [
        [(contact_force if depth >= ends else longrange_force)(law, depth, row) for depth in axis.tolist()]
        for ends in (row[FORMING], row[RELEASE])
    ]
    if law.lossy:
        forces[1] = [
            force - (withdrawn_force(law, depth, row) if depth >= 0.0 else 0.0)
            for depth, force in zip(axis.tolist(), forces[1], strict=True)
        ]
    about = {"long_name": "force of the surface on the tip, positive repulsive", "units": "N"}
    return xr.Dataset(
        {"force": (("direction", "depth"), np.array(forces), about)},
        {
            "direction": ["approach", "retract"],
            "depth": ("depth", axis, {"long_name": "depth of the tip in the surface", "units": "m"}),
        },
        provenance({"microscope": describe(scope), "material": describe(material)}, "force calculated"),
    )
