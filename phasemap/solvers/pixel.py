"""Orbit at one pixel: where the tip is, and what it records."""

from __future__ import annotations

import math
from dataclasses import dataclass

from phasemap._shared.asked import asked_as
from phasemap._shared.errors import SolveError
from phasemap._shared.units import say
from phasemap.experiment.accuracy import Accuracy
from phasemap.experiment.described import describe
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Microscope
from phasemap.results.descriptions import SOLVED_BY
from phasemap.results.status import Status
from phasemap.results.variables import FLAGS, FLOATS, branch_of, motion_of
from phasemap.solvers.problem import check_setpoint, work_of_material
from phasemap.solvers.run import run
from phasemap.solvers.solver import Orbit, by_name

TOLD = ("phase", "height", "tip_offset", "indentation", "dissipation")


@dataclass(frozen=True, repr=False)
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
        Energy in minus energy out, over energy in [1]; NaN if the solver does not know it.
    error_phase, error_height : float
        Estimated errors [degree, m]; NaN if there is no estimate.
    amplitude_spread, phase_spread : float
        Of motion that is not periodic, as a lock-in shows it [m, degree]; 0 for a periodic orbit.
    stable : bool
        Whether the controller can stay on the orbit.
    branch : str
        "attractive", "repulsive" or "none".
    motion : str
        "periodic", "irregular" (spread by more than time integration errs, and a second drive spreads) or "none".
    solver : str
        "averaging", "corrected" (exact, by the lever's response), "orbit" (exact, by collocation), "march", or "none"
        where there was nothing to solve.
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

    def __repr__(self) -> str:
        """Status, branch, solver and the numbers that a microscopist asks for first."""
        known = {name: value for name in TOLD if not math.isnan(value := getattr(self, name))}
        numbers = ", ".join(f"{name.replace('_', ' ')} {say(x, FLOATS[name].units)}" for name, x in known.items())
        details = f", {self.branch}, solved by {SOLVED_BY.get(self.solver, self.solver)}: {numbers}" if numbers else ""
        return f"Pixel({self.status.name.replace('_', ' ')}{details})"


@asked_as()
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

    Raises
    ------
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
    amplitude = check_setpoint(setpoint) * scope.driven_amplitude
    work = work_of_material(material, scope, amplitude, marched=True)
    method = by_name(solver)
    if isinstance(method, Orbit):
        method = Orbit(complete=True)  # stability too, which costs little for one pixel
    rows, status, used = run(method, work, accuracy or Accuracy(), threads=1)
    state = Status.of(int(status[0]))
    if strict and state is not Status.good:
        raise SolveError(state.advice(interaction=describe(scope.interaction)))
    numbers = {name: float(FLOATS[name].value(rows)[0]) for name in Pixel.__annotations__ if name in FLOATS}
    branch = FLAGS["branch"][2][int(branch_of(rows)[0]) + 1]
    motion = FLAGS["motion"][2][int(motion_of(rows, work.lever)[0]) + 1]
    by = FLAGS["solver"][2][int(used[0]) + 1]
    return Pixel(**numbers, stable=state is Status.good, branch=branch, motion=motion, solver=by, status=state)
