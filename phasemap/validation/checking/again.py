"""Sampled pixels of an image at rest, solved by another solver than the one that made it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels.columns import NOWHERE
from phasemap._kernels.scanning.slots import Orbits
from phasemap._kernels.wide import WIDE
from phasemap._shared.errors import InputError
from phasemap._shared.threads import Progress, workers_of
from phasemap.experiment.control import Raster
from phasemap.experiment.microscope import Microscope
from phasemap.experiment.properties import film_of, properties
from phasemap.experiment.surface import Surface
from phasemap.imaging.imperfections import scopes_by_row
from phasemap.solvers.both_branches import stable_branches
from phasemap.solvers.integrals import bare_rows, with_adhesion
from phasemap.solvers.march import FromFar
from phasemap.solvers.orbit import Orbit
from phasemap.solvers.problem import Work, make_work
from phasemap.solvers.run import run
from phasemap.solvers.solver import Solver
from phasemap.validation.checking.picture import Picture

Array = NDArray[np.float64]
Pixels = NDArray[np.intp]
Codes = NDArray[np.int8]


class Again(NamedTuple):
    """What a solver found, for n pixels."""

    pixels: Pixels  # int, shape (n,); Flat, in the order of the picture
    rows: Array  # shape (n, WIDE)
    # status, solver: int8, shape (n,)
    status: Codes
    solver: Codes
    materials: int  # how many distinct ones these pixels have


@dataclass(frozen=True)
class _Part:
    """Pixels under one tip: their distinct materials, and which each has."""

    pixels: Pixels
    work: Work
    bare: Array  # rows of the same contacts without adhesion
    numbers: NDArray[np.intp]


def other_solver(made_by: str, wanted: str | None) -> Solver:
    """The solver that shares nothing with the one that made the image: the march from far, or the orbit for a march."""
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

    `surface`: as it passed under the tip.
    `pixels` (shape (n,)): flat.
    `threads`, `progress`: as in `phasemap.simulate`.
    """
    claims, carries = picture.claims, isinstance(picture.claims.control, Raster)
    rows = np.full((len(pixels), WIDE), np.nan)
    status, used = np.zeros(len(pixels), np.int8), np.zeros(len(pixels), np.int8)
    materials = done = 0
    for part in _parts(picture, surface, pixels):
        report = None if progress is None else _after(progress, done, len(pixels))
        at: tuple[NDArray[np.intp], ...]
        if carries:
            found = stable_branches(part.work, solver, claims.accuracy, workers_of(threads), report)
            at = _slots(picture, pixels[part.pixels], part.numbers, found.orbits), part.numbers
            several = with_adhesion(found.rows, part.work, found.solver, part.bare), found.status, found.solver
        else:
            # Only the march knows a memory: instead of an orbit it is engaged from far, which images may do without.
            by_time = FromFar() if part.work.law.memory and isinstance(solver, Orbit) else solver
            solved, codes, by = run(by_time, part.work, claims.accuracy, threads=threads, progress=report)
            at, several = (part.numbers,), (with_adhesion(solved, part.work, by, part.bare), codes, by)
        rows[part.pixels], status[part.pixels], used[part.pixels] = (values[at] for values in several)
        materials, done = materials + len(part.work), done + len(part.pixels)
    return Again(pixels, rows, status, used, materials)


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


def _work(
    surface: Surface, pixels: Pixels, scope: Microscope, amplitude: float
) -> tuple[Work, Array, NDArray[np.intp]]:
    """Work of the distinct materials of pixels, the same contacts without adhesion, and which each pixel has."""
    materials, numbers = np.unique(surface.materials(pixels), axis=0, return_inverse=True)
    viscous = surface.viscosity is not None
    bare = bare_rows(properties(materials, viscous, scope)[0], scope, film_of(materials))
    return make_work(materials, viscous, scope, amplitude, marched=True), bare, numbers.reshape(-1)


def _slots(picture: Picture, pixels: Pixels, numbers: NDArray[np.intp], orbits: Orbits) -> NDArray[np.intp]:
    """On which of a material's orbits the tip is, coming to a pixel as it leaves the last."""
    from phasemap._kernels.scanning.quasi_static import step

    branches, offsets = (values.reshape(-1)[pixels] for values in carried(picture))
    comes = zip(numbers, branches, offsets, strict=True)
    return np.array([step(orbits, int(i), int(branch), float(z0))[1] for i, branch, z0 in comes], np.intp)


def carried(picture: Picture) -> tuple[NDArray[np.int8], Array]:
    """Branch on which the tip comes to each pixel, and its tip offset [m]: of the last pixel before that has an orbit.

    `picture`: of `Raster`.
    Returns `branch` (shape (2, ny, nx)): NOWHERE where the tip is engaged.
    Returns `offset` (shape (2, ny, nx)): NaN where the image does not say it.
    """
    control, change = picture.claims.control, picture.claims.realism.tip_change
    assert isinstance(control, Raster)
    branch = np.where(picture.good, picture.raw("branch"), NOWHERE)
    offset = picture["tip_offset"] if picture.has("tip_offset") else np.full(branch.shape, np.nan)
    way, place = (np.concatenate([values[0], values[1, :, ::-1]], axis=1) for values in (branch, offset))
    anew = np.zeros(way.shape, bool)  # of each line, there and back
    anew[slice(None) if control.engage == "line" else [0, 0 if change is None else change.line], 0] = True
    before = np.concatenate([[NOWHERE], way.reshape(-1)[:-1]])
    before[anew.reshape(-1)] = NOWHERE
    known = np.where((before != NOWHERE) | anew.reshape(-1), np.arange(before.size), 0)
    last = np.maximum.accumulate(known)
    comes, from_offset = before[last].reshape(way.shape), place.reshape(-1)[last - 1].reshape(way.shape)
    nx = branch.shape[2]
    back = [np.stack([values[:, :nx], values[:, nx:][:, ::-1]]) for values in (comes, from_offset)]
    return back[0].astype(np.int8), back[1]
