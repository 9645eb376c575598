"""Sampled pixels of an image at rest, solved by another solver than the one that made it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels import columns as col
from phasemap._kernels.scanning.slots import NOWHERE
from phasemap.branches import stable_branches
from phasemap.checking.picture import Picture
from phasemap.control import Raster
from phasemap.errors import InputError
from phasemap.microscope import Microscope
from phasemap.realism import scopes_by_row
from phasemap.solvers import Solver
from phasemap.solvers.march import FromFar, March
from phasemap.solvers.orbit import Orbit
from phasemap.surface import Surface
from phasemap.work import Work, make_work
from phasemap.workers import Progress, run, workers_of

__all__ = ["Again", "other_solver", "solve_again"]

Array = NDArray[np.float64]
Pixels = NDArray[np.intp]

UNDECIDED = (col.NOT_CONVERGED, col.NOT_SETTLED, col.TOO_MANY_CONTACTS, col.NO_AVERAGED_ORBIT, col.UNSTABLE)
"""Status codes by which a solver gives up, or says that the tip comes to no rest: it may then end on any orbit."""
DEEPEST = -15.0  # tip offset, over u0 / alpha0, below which engaging in time does not lower the tip (`march.approach`)


class Again(NamedTuple):
    """What another solver found, for n pixels.

    Attributes
    ----------
    pixels : ndarray of int, shape (n,)
        Flat, in the order of the picture.
    rows : ndarray, shape (n, COLUMNS)
    status : ndarray of int8, shape (n,)
    materials : int
        How many distinct ones these pixels have.
    started : int
        In how many the march began at the image's orbit, for it did not come to rest on the way from far.
    """

    pixels: Pixels
    rows: Array
    status: NDArray[np.int8]
    materials: int
    started: int


@dataclass(frozen=True)
class _Part:
    """Pixels under one tip: their distinct materials, and which each has."""

    pixels: Pixels
    work: Work
    numbers: NDArray[np.intp]


def other_solver(made_by: str, wanted: str | None) -> Solver:
    """The solver that shares nothing with the one that made the image: the march from far, or the orbit for a march.

    Raises
    ------
    InputError
        If another is wanted that is not independent.
    """
    independent: dict[str, Solver] = {"march": FromFar(), "orbit": Orbit(complete=True)}
    if made_by == "march":
        del independent["march"]
    elif made_by != "averaging":  # auto solves by orbit
        del independent["orbit"]
    if wanted is None:
        wanted = next(iter(independent))
    if wanted not in independent:
        allowed = " or ".join(map(repr, independent))
        raise InputError("solver", wanted, f"{allowed}, independent of {made_by!r}, which made the image")
    return independent[wanted]


def solve_again(
    picture: Picture, surface: Surface, pixels: Pixels, solver: Solver, threads: int | None, progress: Progress | None
) -> Again:
    """Solve pixels again.

    Parameters
    ----------
    picture : Picture
    surface : Surface
        As it passed under the tip.
    pixels : ndarray of int, shape (n,)
        Flat.
    solver : Solver
    threads, progress
        As in `phasemap.simulate`.
    """
    claims, carried = picture.claims, isinstance(picture.claims.control, Raster)
    rows, status = np.full((len(pixels), col.COLUMNS), np.nan), np.zeros(len(pixels), np.int8)
    materials = started = done = 0
    for part in _parts(picture, surface, pixels):
        report = None if progress is None else _after(progress, done, len(pixels))
        if carried:
            found = stable_branches(part.work, solver, claims.accuracy, workers_of(threads), report)
            at = _slots(picture, pixels[part.pixels], part.numbers, found.stable, found.engaged)
            rows[part.pixels], status[part.pixels] = found.rows[at, part.numbers], found.status[at, part.numbers]
        else:
            some, codes, _ = run(solver, part.work, claims.accuracy, threads=threads, progress=report)
            started += _finish(picture, pixels[part.pixels], part, some, codes)
            rows[part.pixels], status[part.pixels] = some[part.numbers], codes[part.numbers]
        materials, done = materials + len(part.work), done + len(part.pixels)
    return Again(pixels, rows, status, materials, started)


def _after(progress: Progress, done: int, total: int) -> Progress:
    """Progress in pixels, from that in materials: as if these were the pixels."""
    return lambda count, _: progress(min(done + count, total), total)


def _parts(picture: Picture, surface: Surface, pixels: Pixels) -> list[_Part]:
    """Pixels by the tip that scans them."""
    claims, size = picture.claims, surface.shape[0] * surface.shape[1]
    line = pixels % size // surface.shape[1]
    parts = []
    for rows, scope in scopes_by_row(claims.realism, claims.microscope, surface.shape[0]):
        some = np.flatnonzero((line >= rows.start) & (line < rows.stop))
        if len(some):
            parts.append(_Part(some, *_work(surface, pixels[some] % size, scope, claims.amplitude)))
    return parts


def _work(surface: Surface, pixels: Pixels, scope: Microscope, amplitude: float) -> tuple[Work, NDArray[np.intp]]:
    """Work of the distinct materials of pixels, and which each pixel has."""
    materials, numbers = np.unique(surface.materials(pixels), axis=0, return_inverse=True)
    return make_work(materials, surface.viscosity is not None, scope, amplitude), numbers.reshape(-1)


def _finish(picture: Picture, pixels: Pixels, part: _Part, rows: Array, status: NDArray[np.int8]) -> int:
    """March from the image's orbits where time did not come to rest on the way from far; returns in how many pixels.

    Where a tip just touches it may tap irregularly, and the amplitude passes the setpoint at random.
    """
    names = {col.TIP_OFFSET: "tip_offset", col.MEAN: "mean_deflection", col.PHASE: "phase"}
    if not picture.has(*names.values()) or part.work.lever[col.SHAKER]:  # time is begun at an orbit of the tip
        return 0
    work, first = part.work, np.empty(len(part.work), np.intp)
    first[part.numbers[::-1]] = pixels[::-1]
    restless = np.isin(status, (col.NOT_SETTLED, col.UNSTABLE))
    deep = picture["tip_offset"].reshape(-1)[first] < DEEPEST * work.lever[col.BASE] / work.lever[col.ALPHA0]
    deep &= status == col.NO_STABLE_ORBIT
    waiting = np.flatnonzero((restless | deep) & picture.good.reshape(-1)[first])
    some, codes, used = rows[waiting], np.zeros(len(waiting), np.int8), np.zeros(len(waiting), np.int8)
    for column, name in names.items():
        values = picture[name].reshape(-1)[first[waiting]]
        some[:, column] = np.radians(values) if column == col.PHASE else values
    less = Work(work.law, work.rows[waiting], work.lever, work.amplitudes[waiting])
    March().settle(less, 0, len(waiting), some, codes, used)
    rows[waiting], status[waiting] = some, codes
    return int(np.isin(part.numbers, waiting).sum())


def _slots(
    picture: Picture, pixels: Pixels, numbers: NDArray[np.intp], stable: NDArray[np.bool_], engaged: NDArray[np.int8]
) -> NDArray[np.intp]:
    """On which of a material's orbits the tip is, coming to a pixel on the branch on which it leaves the last."""
    from phasemap._kernels.scanning.walk import step

    comes = carried(picture).reshape(-1)[pixels]
    slots = [step(stable, engaged, int(i), int(branch))[1] for i, branch in zip(numbers, comes, strict=True)]
    return np.array(slots, np.intp)


def carried(picture: Picture) -> NDArray[np.int8]:
    """Branch on which the tip comes to each pixel: that of the last pixel before it that has one.

    Parameters
    ----------
    picture : Picture
        Of `Raster`.

    Returns
    -------
    ndarray of int8, shape (2, ny, nx)
        NOWHERE where the tip is engaged.
    """
    control, change = picture.claims.control, picture.claims.realism.tip_change
    assert isinstance(control, Raster)
    branch = np.where(picture.good, picture.raw("branch"), NOWHERE)
    way = np.concatenate([branch[0], branch[1, :, ::-1]], axis=1)  # of each line, there and back
    anew = np.zeros(way.shape, bool)
    anew[slice(None) if control.engage == "line" else [0, 0 if change is None else change.line], 0] = True
    before = np.concatenate([[NOWHERE], way.reshape(-1)[:-1]])
    before[anew.reshape(-1)] = NOWHERE
    known = np.where((before != NOWHERE) | anew.reshape(-1), np.arange(before.size), 0)
    comes = before[np.maximum.accumulate(known)].reshape(way.shape)
    nx = branch.shape[2]
    return np.stack([comes[:, :nx], comes[:, nx:][:, ::-1]]).astype(np.int8)
