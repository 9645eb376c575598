"""One pixel at a time: the orbit that the controller finds, and every orbit there is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from phasemap._kernels import columns as col
from phasemap._shared.checks import number
from phasemap._shared.errors import InputError, SolveError
from phasemap.experiment.accuracy import Accuracy
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Microscope
from phasemap.results.status import Status
from phasemap.results.variables import (
    FLAGS,
    FLOATS,
    branch_of,
    describe,
    flag_attributes,
    float_attributes,
    motion_of,
    provenance,
)
from phasemap.scan import run
from phasemap.solvers import by_name
from phasemap.solvers.orbit import Orbit
from phasemap.work import check_setpoint, work_of_material

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class Pixel:
    """The orbit at one pixel; NaN where `status` is not good.

    Attributes
    ----------
    tip_offset, height, amplitude, mean_deflection, indentation : float
        [m]. The height is that of a flat surface at 0.
    phase : float
        [degree], 0 at free resonance, positive repulsive.
    dissipation, virial : float
        [J].
    floquet : float
        Largest modulus of the Floquet multipliers [1]; NaN if the solver does not know it.
    feedback_slope : float
        Change of amplitude with tip offset [1]; NaN if the solver does not know it.
    energy_closure : float
        Energy in less energy out, over energy in [1]; NaN if the solver does not know it.
    error_phase, error_height : float
        Estimated errors [degree, m]; NaN if there is no estimate.
    amplitude_spread, phase_spread : float
        Of motion that is not periodic, as a lock-in shows it [m, degree]; 0 for a periodic orbit.
    stable : bool
        Whether the controller can stay on the orbit.
    branch : str
        "attractive", "repulsive" or "none".
    motion : str
        "periodic", "irregular" or "none".
    solver : str
        "averaging", "orbit", "march", or "none" where there was nothing to solve.
    status : Status
        Its value is a sentence of advice.
    """

    tip_offset: float
    height: float
    phase: float
    amplitude: float
    mean_deflection: float
    indentation: float
    dissipation: float
    virial: float
    floquet: float
    feedback_slope: float
    energy_closure: float
    error_phase: float
    error_height: float
    amplitude_spread: float
    phase_spread: float
    stable: bool
    branch: str
    motion: str
    solver: str
    status: Status


def solve_pixel(
    material: Material,
    scope: Microscope,
    setpoint: float,
    solver: str = "auto",
    accuracy: Accuracy | None = None,
    *,
    strict: bool = False,
) -> Pixel:
    """Find the orbit on which the controller holds the setpoint, after engaging from far.

    Parameters
    ----------
    material : Material
    scope : Microscope
    setpoint : float
        Amplitude over the free amplitude at the drive frequency, between 0 and 1.
    solver : {"auto", "averaging", "orbit", "march"}
        As in `phasemap.simulate`.
    accuracy : Accuracy, optional
        As in `phasemap.simulate`.
    strict : bool
        Raise if there is no solution.

    Returns
    -------
    Pixel

    Raises
    ------
    InputError
        If an argument is out of range.
    SolveError
        With `strict`, if there is no solution.

    Examples
    --------
    >>> import phasemap as pm
    >>> scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(20e-9))
    >>> pixel = pm.solve_pixel(pm.Material(modulus=3e9), scope, setpoint=0.7, solver="orbit")
    >>> round(pixel.phase, 2), pixel.branch
    (45.57, 'repulsive')
    """
    amplitude = check_setpoint(setpoint) * scope.free_amplitude
    work = work_of_material(material, scope, amplitude)
    method = by_name(solver)
    if isinstance(method, Orbit):
        method = Orbit(complete=True)  # stability too, which costs little for one pixel
    rows, status, used = run(method, work, accuracy or Accuracy(), threads=1)
    state = Status.of(int(status[0]))
    if strict and state is not Status.good:
        raise SolveError(state.value)
    numbers = {name: float(FLOATS[name].value(rows)[0]) for name in Pixel.__annotations__ if name in FLOATS}
    branch = FLAGS["branch"][2][int(branch_of(rows)[0]) + 1]
    motion = FLAGS["motion"][2][int(motion_of(rows)[0]) + 1]
    by = FLAGS["solver"][2][int(used[0]) + 1]
    return Pixel(**numbers, stable=state is Status.good, branch=branch, motion=motion, solver=by, status=state)


def orbits(
    material: Material, scope: Microscope, *, setpoint: float | None = None, tip_offset: float | None = None
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
        Dim "orbit", from far to near: tip_offset, amplitude, height, mean_deflection, indentation [m], phase [degree],
        dissipation, virial [J], floquet, feedback_slope, energy_closure [1], branch and stable (flags). The attribute
        `complete` is 1 if the curve of orbits was followed to its end.

    Raises
    ------
    InputError
        If both or none of `setpoint` and `tip_offset` are given, or a value is out of range.

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
    if setpoint is not None and scope.drive.excitation != "direct":
        from phasemap.curves.run import at_seen

        rows, complete = at_seen(material, scope, check_setpoint(setpoint) * scope.free_amplitude)
        rows = rows[np.argsort(-rows[:, col.TIP_OFFSET], kind="stable")]
    elif setpoint is not None:
        from phasemap._kernels.batch import every_orbit
        from phasemap._kernels.collocation import HOLD_AMPLITUDE
        from phasemap._kernels.tables import TABLES

        amplitude = check_setpoint(setpoint) * scope.free_amplitude
        work = work_of_material(material, scope, amplitude)
        status, rows = every_orbit(work.law, work.rows[0], work.lever, TABLES, HOLD_AMPLITUDE, amplitude)
        rows, complete = rows[np.argsort(-rows[:, col.TIP_OFFSET], kind="stable")], status == col.GOOD
    else:
        from phasemap.curves.run import at_offset

        assert tip_offset is not None
        rows, complete = at_offset(material, scope, number("tip_offset", tip_offset, "m"))
    configuration = {
        "microscope": describe(scope), "material": describe(material), "setpoint": setpoint, "tip_offset": tip_offset
    }  # fmt: skip
    found = _orbit_dataset(rows)
    found.attrs.update(provenance(configuration, "orbits found"))
    found.attrs["complete"] = int(complete)
    return found


def _orbit_dataset(rows: np.ndarray) -> xr.Dataset:
    import xarray as xr

    names = (
        "tip_offset", "amplitude", "height", "phase", "mean_deflection", "indentation", "dissipation", "virial",
        "floquet", "feedback_slope", "energy_closure",
    )  # fmt: skip
    data = {name: ("orbit", FLOATS[name].value(rows), float_attributes(name)) for name in names}
    found = xr.Dataset(data, {"orbit": ("orbit", np.arange(len(rows)), {"long_name": "orbit, far to near"})})
    found["branch"] = ("orbit", branch_of(rows), flag_attributes("branch"))
    meaning = {"flag_values": np.array([0, 1], np.int8), "flag_meanings": "unstable stable"}
    stable = (rows[:, col.FLOQUET] < 1).astype(np.int8)
    found["stable"] = ("orbit", stable, {"long_name": "stability of the orbit at fixed tip offset", **meaning})
    return found
