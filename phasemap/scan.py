"""From a surface to an image."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from phasemap._kernels import columns as col
from phasemap.accuracy import Accuracy
from phasemap.canvas import Canvas
from phasemap.control import Control, Engage, Feedback, Raster
from phasemap.dataset import check_variables, describe, provenance, variables_of
from phasemap.errors import InputError, SolveError
from phasemap.microscope import Microscope
from phasemap.paint import Job, paint
from phasemap.realism import Realism, check_realism, drifted, finish, rows_of, scopes_by_row
from phasemap.solvers import by_name
from phasemap.status import Status
from phasemap.surface import Surface
from phasemap.work import Work, check_setpoint, make_work
from phasemap.workers import Progress, run, workers_of

if TYPE_CHECKING:
    import xarray as xr

Array = np.ndarray

__all__ = ["modelled", "run", "simulate"]


def simulate(
    surface: Surface,
    scope: Microscope,
    setpoint: float,
    solver: str = "auto",
    control: Control | None = None,
    accuracy: Accuracy | None = None,
    *,
    realism: Realism | None = None,
    variables: Iterable[str] | None = None,
    strict: bool = False,
    progress: Progress | None = None,
    threads: int | None = None,
) -> xr.Dataset:
    """Simulate the image that the microscope takes of a surface.

    Parameters
    ----------
    surface : Surface
        Material maps and topography, shape (ny, nx).
    scope : Microscope
    setpoint : float
        Amplitude of the first harmonic over the free amplitude at the drive frequency, between 0 and 1.
    solver : {"auto", "averaging", "orbit", "march"}
        "averaging" is first order and fastest, "orbit" exact, "march" integrates the equation of motion in time (slow),
        "auto" takes the cheapest that meets `accuracy` and says per pixel which one that was.
    control : Engage, Raster or Feedback, optional
        How the controller comes to the setpoint: every pixel engaged anew from far (the default), the state carried
        along lines quasi-statically, or a feedback in time. In time "averaging" is the slow flow of the amplitude,
        "march" the equation of motion, and "auto" the former unless the quality factor is below 20 or contact so stiff
        that the amplitude changes within a period.
    accuracy : Accuracy, optional
        Largest error against the exact orbit, for "auto".
    realism : Realism, optional
        What a real microscope adds: noise, drift, offsets of lines, a change of the tip, quantisation; none by default.
    variables : iterable of str, optional
        Which variables to return, all by default; `status` always comes along.
    strict : bool
        Raise where a pixel has no solution, instead of leaving NaN and a status.
    progress : callable, optional
        Called as ``progress(done, total)`` from the calling thread, in distinct materials, in pixels where materials
        are interpolated or too many to be kept, or in lines of a feedback.
    threads : int, optional
        All cores by default. The numbers do not depend on it.

    Returns
    -------
    xarray.Dataset
        Dims ("y", "x"), row 0 at the top, coordinates in m: height, phase, amplitude, tip_offset, mean_deflection,
        indentation [m and degree], dissipation, virial [J], branch, status, solver (CF flags), error_phase [degree] and
        error_height [m] where estimated, energy_closure [1] where the solver has it. `Raster` and `Feedback` have a
        leading dim "direction", trace and retrace; `Feedback` has height (of the scanner), amplitude_error, phase,
        amplitude, tip_offset, branch, status and solver, averaged over the time in each pixel, and the gains in its
        attributes.

    Raises
    ------
    InputError
        If an argument is out of range.
    SolveError
        With `strict`, if a pixel has no solution.

    Notes
    -----
    A material that occurs in many pixels is solved once. A term that no pixel has is not evaluated.

    Where an image has more than some thousand different materials, "auto" solves a few thousand that span them and
    interpolates (`phasemap.atlas`): never across a jump of the orbit, with an error estimated at materials of the image
    itself, and the rest is solved one by one. `solver` says "interpolated" there. `Raster` asks for the orbits of both
    branches, which are solved for every material.

    Beside the maps and what is returned, this takes less than 256 MiB for images of up to 4096 x 4096 pixels.

    Examples
    --------
    >>> import phasemap as pm
    >>> surface = pm.Surface(modulus=[[1e9, 3e9]], adhesion=0.05, damping=0.01, pixel_size=4e-9)
    >>> scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(20e-9))
    >>> image = pm.simulate(surface, scope, setpoint=0.7)
    >>> [round(float(p), 2) for p in image.phase.values[0]]
    [42.05, 44.5]
    """
    started = time.perf_counter()
    setpoint = check_setpoint(setpoint)
    control = Engage() if control is None else control
    accuracy = Accuracy() if accuracy is None else accuracy
    if type(control) not in _PAINTERS:
        raise InputError("control", control, "one of " + ", ".join(f"{kind.__name__}()" for kind in _PAINTERS))
    if not isinstance(accuracy, Accuracy):
        raise InputError("accuracy", accuracy, "an Accuracy")
    realism = check_realism(Realism() if realism is None else realism, control, surface.shape[0])
    names = check_variables(variables, variables_of(control))
    surface = drifted(surface, realism.drift)
    method = by_name(solver)
    canvas = Canvas(surface, names, control.directions)
    amplitude, workers = setpoint * scope.free_amplitude, workers_of(threads)
    distinct = _paint(Job(surface, scope, amplitude, control, method, accuracy, workers, progress, realism), canvas)
    if strict:
        _refuse_failures(canvas.status.reshape(-1, *surface.shape))
    solved = time.perf_counter() - started
    configuration = {
        "microscope": describe(scope), "setpoint": setpoint, "solver": method.name, "control": describe(control),
        "accuracy": describe(accuracy), "realism": describe(realism), "shape": list(surface.shape),
        "pixel_size": list(surface.pixel_size),
    }  # fmt: skip
    image = canvas.image()
    image.attrs.update(provenance(configuration, "simulated"))
    image.attrs["modelled"] = "; ".join(modelled(_largest(surface, scope), scope, surface.topography is not None))
    image.attrs["distinct_materials"] = distinct
    image.attrs["seconds"] = round(solved, 6)
    return finish(image, realism)


def _paint(job: Job, canvas: Canvas) -> int:
    """Fill the canvas; without time, the lines before and after a change of the tip are images of their own."""
    painter = _PAINTERS[type(job.control)]
    blocks = scopes_by_row(job.realism, job.scope, job.surface.shape[0])
    if len(blocks) == 1 or job.control.in_time:
        return painter(job, canvas)
    distinct = 0
    for rows, scope in blocks:
        part = rows_of(job.surface, rows)
        distinct += painter(replace(job, surface=part, scope=scope), canvas.part(part, rows))
    return distinct


def modelled(work: Work, scope: Microscope, topography: bool) -> list[str]:
    """What acts in this work, in words."""
    rows = work.rows
    names = [f"{scope.interaction.law.name} contact"]
    if np.any(rows[:, col.LONGRANGE] > rows[:, col.BIAS]):
        names.append("inverse-square attraction")
    if np.any(rows[:, col.BIAS] != 0):
        names.append("electrostatic bias")
    if np.any(rows[:, col.DAMPING] != 0):
        names.append(f"damping with depth^{scope.interaction.damping_exponent:g}")
    if scope.tip.modulus is not None:
        names.append("elastic tip")
    if topography:
        names.append("topography")
    return names


def _largest(surface: Surface, scope: Microscope) -> Work:
    """Work of one pixel, with the largest of every property; a term is zero there if no pixel has it."""
    maps = (surface.modulus, surface.adhesion, surface.damping, surface.viscosity, surface.poisson_ratio)
    largest = np.array([[np.fmax.reduce(values, None) for values in maps if values is not None]])
    return make_work(np.nan_to_num(largest), surface.viscosity is not None, scope, scope.free_amplitude)


def _paint_feedback(job: Job, canvas: Canvas) -> int:
    """`phasemap.feedback.paint`, whose kernels are imported only where they are needed."""
    from phasemap.feedback import paint

    return paint(job, canvas)


def _paint_raster(job: Job, canvas: Canvas) -> int:
    """`phasemap.raster.paint_raster`, imported only where it is needed."""
    from phasemap.raster import paint_raster

    return paint_raster(job, canvas)


_PAINTERS: dict[type[Control], Callable[[Job, Canvas], int]] = {
    Engage: paint,
    Raster: _paint_raster,
    Feedback: _paint_feedback,
}
"""Who fills the canvas; returns how many distinct materials the surface has."""


def _refuse_failures(status: Array) -> None:
    """Raise where a status, shape (directions, ny, nx), is not good."""
    bad = status != 0
    if bad.any():
        place = np.unravel_index(np.argmax(bad), bad.shape)
        row, column = (int(i) for i in place[1:])
        advice = Status.of(int(status[place])).value
        count = int(bad.sum())
        failed = "1 pixel has no solution; it is" if count == 1 else f"{count} pixels have no solution; the first is"
        raise SolveError(f"{failed} at row {row}, column {column}. {advice}")
