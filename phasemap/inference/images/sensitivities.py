"""Derivatives of phase and height by the material, pixel by pixel."""

from __future__ import annotations

import time

import numpy as np
import xarray as xr

from phasemap._kernels import columns as col
from phasemap._shared.asked import asked_as
from phasemap._shared.errors import InputError
from phasemap._shared.threads import Progress, bounds_of, spread, workers_of
from phasemap.experiment.accuracy import Accuracy
from phasemap.experiment.described import describe
from phasemap.experiment.microscope import Microscope
from phasemap.experiment.surface import Surface
from phasemap.imaging.simulation import simulate
from phasemap.results.variables import provenance
from phasemap.solvers.both_branches import stable_branches
from phasemap.solvers.problem import Work, check_setpoint, make_work
from phasemap.solvers.run import run
from phasemap.solvers.solver import by_name

STEP = 3e-3  # of a logarithm; the central difference is then wrong by some 1e-6 of it, more near the end of a branch
FINE = Accuracy(phase=float(np.degrees(1e-7)), height=1e-14)  # of the orbits that are compared
CHUNK = 256  # materials that a thread solves at a time


@asked_as()
def sensitivity(
    surface: Surface,
    scope: Microscope,
    setpoint: float,
    *,
    threads: int | None = None,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Compute how phase and height of every pixel change with modulus, adhesion and damping.

    Derivatives are central differences of exact orbits on the branch that engagement finds; a jump to the other branch
    is not a part of them. Where the material has none of a property, its derivative is 0.

    Parameters
    ----------
    surface : Surface
        Shape (ny, nx).
    scope : Microscope
    setpoint : float
        Amplitude over the free amplitude at the drive frequency, between 0 and 1.
    threads : int, optional
        All cores by default. The numbers do not depend on it.
    progress : callable, optional
        Called as ``progress(done, total)`` in distinct materials.

    Returns
    -------
    xarray.Dataset
        Over ("y", "x"): `phase_by_modulus`, `phase_by_adhesion`, `phase_by_damping` [degree], derivatives with respect
        to the natural logarithm of the property, and `height_by_modulus` and so on [m]; "viscosity" in place of
        "damping" if the surface has that. Further phase, height, branch and status. A pixel whose branch ends within
        0.3 % of its material is NaN, and its status is "no_stable_orbit".

    Examples
    --------
    >>> import phasemap as pm
    >>> surface = pm.Surface(modulus=[[1e9, 3e9]], adhesion=0.05, damping=[[0.0, 0.01]], pixel_size=4e-9)
    >>> scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(40e-9))
    >>> found = pm.sensitivity(surface, scope, setpoint=0.7)
    >>> [abs(round(float(slope), 2)) for slope in found.phase_by_modulus.values[0]]
    [0.0, 0.87]
    """
    started = time.perf_counter()
    if not isinstance(surface, Surface):
        raise InputError("surface", type(surface).__name__, "a Surface")
    setpoint, workers = check_setpoint(setpoint), workers_of(threads)
    amplitude, viscous = setpoint * scope.driven_amplitude, surface.viscosity is not None
    materials, inverse = surface.unique()
    make_work(materials, viscous, scope, amplitude)  # refuses what is marched in time
    asked = "height", "phase", "branch", "status"
    image = simulate(surface, scope, setpoint, "orbit", variables=asked, threads=threads)
    first = np.unique(inverse, return_index=True)[1]
    status, repelled = image.status.values.ravel()[first], image.branch.values.ravel()[first] > 0
    good = np.flatnonzero(status == col.GOOD)
    slopes = np.full((len(materials), 3, 2), np.nan)

    def solve(first: int, last: int) -> None:
        chosen = good[first:last]
        for i in range(3):
            ends = []
            for sign in (1, -1):
                moved = materials[chosen].copy()
                moved[:, i] *= np.exp(sign * STEP)
                ends.append(_on_branch(make_work(moved, viscous, scope, amplitude), repelled[chosen]))
            slopes[chosen, i] = (ends[0] - ends[1]) / (2 * STEP)
            slopes[chosen[materials[chosen, i] == 0], i] = 0.0

    spread(solve, bounds_of(len(good), CHUNK), workers, progress)
    lost = (status == col.GOOD) & ~np.isfinite(slopes).all(axis=(1, 2))
    slopes[lost] = np.nan
    for name in ("height", "phase"):
        image[name] = image[name].where(~lost[inverse])
    image["status"] = image.status.copy(data=np.where(lost, col.NO_STABLE_ORBIT, status).astype(np.int8)[inverse])
    names = ("modulus", "adhesion", "viscosity" if viscous else "damping")
    for k, (quantity, unit, scale) in enumerate((("phase", "degree", 180 / np.pi), ("height", "m", 1.0))):
        for i, name in enumerate(names):
            about = {"long_name": f"change of the {quantity} with the natural logarithm of the {name}", "units": unit}
            image[f"{quantity}_by_{name}"] = (image.phase.dims, scale * slopes[:, i, k][inverse], about)
    described = {"microscope": describe(scope), "setpoint": setpoint, "shape": list(surface.shape)}
    image.attrs = {**provenance(described, "differentiated"), "seconds": round(time.perf_counter() - started, 6)}
    return image


def _on_branch(work: Work, repelled: np.ndarray) -> np.ndarray:
    """Exact phase [rad] and tip offset [m] on the repulsive branch or the other, shape (n, 2); NaN without an orbit."""
    rows, status, _ = run(by_name("orbit"), work, FINE, threads=1)
    values = rows[:, [col.PHASE, col.TIP_OFFSET]]
    other = np.flatnonzero((status != col.GOOD) | (col.is_repulsive(rows) != repelled))
    if len(other):  # the tip engages on the other branch
        both = stable_branches(work.part(other), by_name("orbit"), FINE)
        here = repelled[other].astype(int), np.arange(len(other))
        lost = (both.status[here] != col.GOOD)[:, None]
        values[other] = np.where(lost, np.nan, both.rows[here][:, [col.PHASE, col.TIP_OFFSET]])
    return values
