"""From a surface to an image."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from typing import TYPE_CHECKING, Any

import numpy as np

from phasemap._check import whole
from phasemap._kernels import columns as col
from phasemap.accuracy import Accuracy
from phasemap.control import Engage
from phasemap.dataset import (
    FLAGS,
    FLOATS,
    branch_of,
    check_variables,
    describe,
    flag_attributes,
    float_attributes,
    provenance,
)
from phasemap.errors import InputError, SolveError
from phasemap.microscope import Microscope
from phasemap.solvers import Solver, by_name
from phasemap.status import Status
from phasemap.surface import Surface
from phasemap.work import Work, check_setpoint, make_work

if TYPE_CHECKING:
    import xarray as xr

Array = np.ndarray
Progress = Callable[[int, int], None]


def simulate(
    surface: Surface,
    scope: Microscope,
    setpoint: float,
    solver: str = "auto",
    control: Engage | None = None,
    accuracy: Accuracy | None = None,
    *,
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
    control : Engage, optional
        How the controller comes to the setpoint; every pixel is engaged anew from far by default.
    accuracy : Accuracy, optional
        Largest error against the exact orbit, for "auto".
    variables : iterable of str, optional
        Which variables to return, all by default; `status` always comes along.
    strict : bool
        Raise where a pixel has no solution, instead of leaving NaN and a status.
    progress : callable, optional
        Called as ``progress(done, total)``, in distinct materials, from the calling thread.
    threads : int, optional
        All cores by default. The numbers do not depend on it.

    Returns
    -------
    xarray.Dataset
        Dims ("y", "x"), row 0 at the top, coordinates in m: height, phase, amplitude, tip_offset, mean_deflection,
        indentation [m and degree], dissipation, virial [J], branch, status, solver (CF flags), error_phase [degree] and
        error_height [m] where estimated, energy_closure [1] where the solver has it.

    Raises
    ------
    InputError
        If an argument is out of range.
    SolveError
        With `strict`, if a pixel has no solution.

    Notes
    -----
    A material that occurs in many pixels is solved once. A term that no pixel has is not evaluated.

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
    if not isinstance(control, Engage):
        raise InputError("control", control, "Engage()")
    if not isinstance(accuracy, Accuracy):
        raise InputError("accuracy", accuracy, "an Accuracy")
    names = check_variables(variables)
    method = by_name(solver)
    materials, inverse = surface.unique()
    work = make_work(
        materials, surface.viscosity is not None, scope, np.full(len(materials), setpoint * scope.free_amplitude)
    )
    rows, status, used = run(method, work, accuracy, threads=threads, progress=progress)
    if strict:
        _refuse_failures(status, inverse)
    solved = time.perf_counter() - started
    configuration = {
        "microscope": describe(scope), "setpoint": setpoint, "solver": method.name, "control": describe(control),
        "accuracy": describe(accuracy), "shape": list(surface.shape), "pixel_size": list(surface.pixel_size),
    }  # fmt: skip
    image = _image(surface, names, rows, status, used, inverse)
    image.attrs.update(provenance(configuration, "simulated"))
    image.attrs["modelled"] = "; ".join(modelled(work, scope, surface.topography is not None))
    image.attrs["distinct_materials"] = len(materials)
    image.attrs["seconds"] = round(solved, 6)
    return image


def run(
    solver: Solver, work: Work, accuracy: Accuracy, *, threads: int | None = None, progress: Progress | None = None
) -> tuple[Array, Array, Array]:
    """Solve work in chunks on several threads.

    Returns
    -------
    rows : ndarray, shape (n, COLUMNS)
    status, solver : ndarray of int8, shape (n,)
    """
    count = len(work)
    rows = np.full((count, col.COLUMNS), np.nan)
    status, used = np.full(count, col.INVALID, np.int8), np.full(count, -1, np.int8)
    valid = np.flatnonzero(np.isfinite(work.rows).all(axis=1))
    if len(valid) < count:
        part = Work(work.law, np.ascontiguousarray(work.rows[valid]), work.lever, work.amplitudes[valid])
        rows[valid], status[valid], used[valid] = run(solver, part, accuracy, threads=threads, progress=progress)
        return rows, status, used
    workers = min(whole("threads", threads, 1), 64) if threads is not None else _cores()
    size = max(1, min(solver.rows_per_chunk, -(-count // (4 * workers))))
    starts = range(0, count, size)

    def solve(first: int) -> int:
        last = min(first + size, count)
        solver.solve(work, accuracy, first, last, rows, status, used)
        return last - first

    if count and (workers == 1 or len(starts) == 1):
        done = 0
        for first in starts:
            done += solve(first)
            if progress is not None:
                progress(done, count)
        return rows, status, used
    with ThreadPoolExecutor(workers) as pool:
        waiting = {pool.submit(solve, first) for first in starts}
        done = 0
        try:
            while waiting:
                finished, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                done += sum(future.result() for future in finished)
                if progress is not None:
                    progress(done, count)
        except BaseException:
            for future in waiting:
                future.cancel()
            raise
    return rows, status, used


def modelled(work: Work, scope: Microscope, topography: bool) -> list[str]:
    """What acts in this work, in words."""
    rows = work.rows
    names = [f"{scope.interaction.law.name} contact"]
    if np.any(rows[:, col.LONGRANGE] != 0):
        names.append("inverse-square attraction")
    if np.any(rows[:, col.DAMPING] != 0):
        names.append(f"damping with depth^{scope.interaction.damping_exponent:g}")
    if scope.tip.modulus is not None:
        names.append("elastic tip")
    if topography:
        names.append("topography")
    return names


def _image(
    surface: Surface, names: tuple[str, ...], rows: Array, status: Array, used: Array, inverse: Array
) -> xr.Dataset:
    import xarray as xr

    y, x = surface.coords()
    coords: dict[str, Any] = {
        "y": ("y", y, {"long_name": "distance from the top of the image", "units": "m", "axis": "Y"}),
        "x": ("x", x, {"long_name": "distance from the left of the image", "units": "m", "axis": "X"}),
    }
    flags = {"branch": branch_of(rows), "status": status, "solver": used}
    image = xr.Dataset(coords=coords)
    for name in names:
        if name in FLAGS:
            image[name] = (("y", "x"), flags[name][inverse], flag_attributes(name))
            continue
        values = FLOATS[name].value(rows)[inverse]
        if name == "height" and surface.topography is not None:
            values = values + surface.topography
        image[name] = (("y", "x"), values, {**float_attributes(name), "ancillary_variables": "status"})
    return image


def _refuse_failures(status: Array, inverse: Array) -> None:
    bad = status[inverse] != 0
    if bad.any():
        row, column = (int(i) for i in np.unravel_index(np.argmax(bad), bad.shape))
        advice = Status.of(int(status[inverse[row, column]])).value
        count = int(bad.sum())
        failed = "1 pixel has no solution; it is" if count == 1 else f"{count} pixels have no solution; the first is"
        raise SolveError(f"{failed} at row {row}, column {column}. {advice}")


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
