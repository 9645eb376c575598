"""Pixels of an image, solved again: all as the image was made, or any by a solver of one's own choice.

Those that are drawn for it are some of every kind, not only of the commonest.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels.columns import NOWHERE, StableOrbits
from phasemap._kernels.scanning.quasi_static import next_branch
from phasemap._shared.arrays import Array
from phasemap._shared.notices import untold
from phasemap._shared.threads import Progress, workers_of
from phasemap.experiment.control import Raster
from phasemap.experiment.microscope import Microscope
from phasemap.experiment.surface import Surface
from phasemap.imaging.canvas import values_of
from phasemap.imaging.imperfections import scopes_by_row
from phasemap.imaging.simulation import simulate
from phasemap.results.variables import FLOATS, IMAGE_VARIABLES, variables_of
from phasemap.solvers.both_branches import stable_branches
from phasemap.solvers.problem import Work, make_work
from phasemap.solvers.run import run
from phasemap.solvers.solver import Solver
from phasemap.validation.picture import Claim, Picture, judged

Indices = NDArray[np.intp]
Values = dict[str, NDArray[Any]]


@dataclass(frozen=True, eq=False)
class Again:
    """Variables that a solver found again in n pixels of a picture."""

    picture: Picture
    pixels: Indices  # shape (n,); flat, in the order of the picture
    values: Values  # variables of these pixels, as an image has them, shape (n,) each
    materials: int  # how many distinct ones were solved

    @property
    def status(self) -> NDArray[np.int8]:
        """Codes, shape (n,)."""
        return self.values["status"]

    def at(self, whole: NDArray[Any]) -> NDArray[Any]:
        """Values in these pixels of an array of the picture's shape."""
        return whole.reshape(-1)[self.pixels]

    def raw(self, name: str) -> NDArray[Any]:
        """Values of these pixels in the file, as they stand."""
        return self.at(self.picture.raw(name))

    def claimed(self, name: str) -> Array:
        """Values of these pixels in the file, less the offsets of lines."""
        return self.at(self.picture[name])

    def spread(self, name: str) -> Array:
        """The larger of the spreads that the image states and that were found again."""
        return np.asarray(np.fmax(self.at(self.picture.spread(name)), self.values[f"{name}_spread"]))

    def judged(
        self, about: str, bad: NDArray[np.bool_], by: NDArray[Any], looked_at: NDArray[np.bool_], text: str
    ) -> Claim:
        """`phasemap.validation.picture.judged`, of arrays of shape (n,)."""
        values = np.zeros((3, int(np.prod(self.picture.shape))))
        values[:, self.pixels] = bad, by, looked_at
        wrong, worst, those = values.reshape(3, *self.picture.shape)
        return judged(about, self.picture, wrong > 0, worst, those > 0, text)


@dataclass(frozen=True)
class _Part:
    """Pixels under one tip: their distinct materials, and which each has."""

    pixels: Indices
    work: Work
    numbers: NDArray[np.intp]


def image_again(picture: Picture, surface: Surface, threads: int | None, progress: Progress | None) -> Again:
    """Simulate the whole image of the surface that passed again, with the variables that the comparison needs."""
    claims = picture.claims
    still = replace(claims.realism, drift=(0.0, 0.0, 0.0), line_offset=0.0, phase_offset=0.0, bits=None)
    names = *variables_of(claims.control), *map(str, picture.image.data_vars)
    with untold():
        image = simulate(
            surface, claims.microscope, claims.setpoint, claims.solver, claims.control, claims.accuracy,
            realism=still, variables=names, progress=progress, threads=threads,
        )  # fmt: skip
    values = {str(name): variable.values.reshape(-1) for name, variable in image.data_vars.items()}
    return Again(picture, np.arange(int(np.prod(picture.shape))), values, len(surface.unique()[0]))


def solve_again(
    picture: Picture, surface: Surface, pixels: Indices, solver: Solver, threads: int | None, progress: Progress | None
) -> Again:
    """Solve some pixels again, given flat, of the surface as it passed under the tip."""
    claims, carries = picture.claims, isinstance(picture.claims.control, Raster)
    values = {name: np.zeros(len(pixels), np.float64 if name in FLOATS else np.int8) for name in IMAGE_VARIABLES}
    materials = done = 0
    for part in _parts(picture, surface, pixels):
        report = after(progress, done, len(pixels))
        at: tuple[NDArray[np.intp], ...]
        if carries:
            branches = stable_branches(part.work, solver, claims.accuracy, workers_of(threads), report)
            at = _slots(picture, pixels[part.pixels], part.numbers, branches.orbits), part.numbers
            solved, codes, by = branches.rows, branches.status, branches.solver
        else:
            solved, codes, by = run(solver, part.work, claims.accuracy, threads=threads, progress=report)
            at = (part.numbers,)
        variables = values_of(IMAGE_VARIABLES, solved, codes, by, claims.microscope)
        for name in IMAGE_VARIABLES:
            values[name][part.pixels] = variables[name][at]
        materials, done = materials + len(part.work), done + len(part.pixels)
    if surface.topography is not None:
        relief = surface.topography.reshape(-1)[pixels % surface.topography.size]
        values["height"] = np.add(values["height"], relief)
    return Again(picture, pixels, values, materials)


def after(progress: Progress | None, done: int, total: int) -> Progress | None:
    """Progress in pixels, from that in materials after so many: as if these were the pixels."""
    return None if progress is None else lambda count, _: progress(min(done + count, total), total)


def _parts(picture: Picture, surface: Surface, pixels: Indices) -> list[_Part]:
    """Pixels by the tip that scans them."""
    claims, size = picture.claims, surface.shape[0] * surface.shape[1]
    microscope = claims.microscope
    if claims.solver != "march":  # which alone has both drives at once: elsewhere the orbit is that of the first
        microscope = replace(microscope, drive=replace(microscope.drive, second=None))
    line = pixels % size // surface.shape[1]
    parts = []
    for rows, scope in scopes_by_row(claims.realism, microscope, surface.shape[0]):
        chosen = np.flatnonzero((line >= rows.start) & (line < rows.stop))
        if len(chosen):
            parts.append(_Part(chosen, *_work(surface, pixels[chosen] % size, scope, claims.amplitude)))
    return parts


def _work(surface: Surface, pixels: Indices, scope: Microscope, amplitude: float) -> tuple[Work, NDArray[np.intp]]:
    """Work of the distinct materials of pixels, and which each pixel has."""
    materials, numbers = np.unique(surface.materials(pixels), axis=0, return_inverse=True)
    viscous = surface.viscosity is not None
    return make_work(materials, viscous, scope, amplitude, marched=True), numbers.reshape(-1)


def _slots(picture: Picture, pixels: Indices, numbers: NDArray[np.intp], orbits: StableOrbits) -> NDArray[np.intp]:
    """Slot of the orbit, of a material, on which the tip is that comes to a pixel as it leaves the last."""
    branches, offsets = (values.reshape(-1)[pixels] for values in carried(picture))
    comes = zip(numbers, branches, offsets, strict=True)
    return np.array([next_branch(orbits, int(i), int(branch), float(z0))[1] for i, branch, z0 in comes], np.intp)


def carried(picture: Picture) -> tuple[NDArray[np.int8], Array]:
    """Branch on which the tip of a `Raster` comes to each pixel, and its tip offset [m], shape (2, ny, nx).

    They are those of the last pixel before that has an orbit: NOWHERE where the tip is engaged, NaN where the image
    does not say it.
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


def sample(picture: Picture, pixels: int, seed: int) -> NDArray[np.intp]:
    """Draw so many pixels, as many of each kind as there is room for, and then any; flat, in order, each once."""
    kind, random = kinds(picture), np.random.default_rng(seed)
    if kind.size <= pixels:
        return np.arange(kind.size)
    shuffled = random.permutation(kind.size)
    order = np.argsort(kind[shuffled], kind="stable")
    sizes = np.unique(kind, return_counts=True)[1]
    rank = np.empty(kind.size, np.intp)  # of a pixel among those of its kind
    rank[order] = np.concatenate([np.arange(size) for size in sizes])
    turns = np.argsort(np.minimum(rank, pixels), kind="stable")  # the first of each kind, the second of each ...
    return np.sort(shuffled[turns[:pixels]])


def kinds(picture: Picture) -> NDArray[np.int64]:
    """Number of the kind of each pixel, flat: by status, solver, branch, motion, and whether a neighbour differs."""
    code = np.zeros(picture.shape, np.int64)
    for name in ("status", "solver", "branch", "motion"):
        if name in picture:
            code = 64 * code + picture.raw(name).astype(np.int64) + 1
    beside = np.zeros(picture.shape, bool)
    for axis in (1, 2):
        ahead = np.diff(code, axis=axis) != 0
        pad = [(0, 0)] * 3
        for pad[axis] in ((1, 0), (0, 1)):
            beside |= np.pad(ahead, pad)
    return np.asarray(2 * code + beside).reshape(-1)
