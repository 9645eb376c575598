"""How the pixels of an image are worked through: block by block, each distinct material once, or from an atlas."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels import columns as col
from phasemap.accuracy import Accuracy
from phasemap.atlas import Atlas, Oracle, build
from phasemap.atlas.axes import Axes
from phasemap.atlas.oracle import FUNCTIONS
from phasemap.canvas import PENDING, Canvas
from phasemap.control import Control
from phasemap.distinct import BLOCK, Distinct, count_distinct
from phasemap.microscope import Microscope
from phasemap.realism import Realism
from phasemap.solvers import Solver
from phasemap.surface import Surface
from phasemap.work import Work, properties, work_of
from phasemap.workers import Progress, run, spread

Array = NDArray[np.float64]

Numbers = Callable[[slice], NDArray[np.int32]]
"""Which distinct material each pixel of a range is made of."""

FEW = 1 << 13  # distinct materials up to which an atlas does not pay
MOST = 1 << 19  # distinct materials that are kept at a time
CHUNK = 1 << 15  # of them that are solved together
SAMPLE = 1 << 16  # pixels from which the extent of an atlas is taken
FINER = 0.1  # accuracy of what an atlas is made of, over that of the image
DEEPEST = 30.0  # error of the indentation, over that of the height
REST = 1 << 16  # pixels without an interpolant that are solved together


@dataclass(frozen=True)
class Job:
    """What is to be done.

    Parameters
    ----------
    surface : Surface
    scope : Microscope
    amplitude : float
        At the setpoint [m].
    control : Control
    solver : Solver
    accuracy : Accuracy
    workers : int
        Threads.
    progress : callable, optional
    realism : Realism
        Its drift is in the surface already; what comes after the scan is no concern of a painter.
    """

    surface: Surface
    scope: Microscope
    amplitude: float
    control: Control
    solver: Solver
    accuracy: Accuracy
    workers: int
    progress: Progress | None
    realism: Realism = field(default_factory=Realism)

    @property
    def pixels(self) -> int:
        """How many there are."""
        return self.surface.shape[0] * self.surface.shape[1]

    def properties(self, materials: Array) -> tuple[Array, Array, Array]:
        """See `phasemap.work.properties`."""
        return properties(materials, self.surface.viscosity is not None, self.scope)

    def work(self, materials: Array) -> Work:
        """Work of these materials."""
        return work_of(*self.properties(materials), self.scope, self.amplitude)

    def solve(self, materials: Array, canvas: Canvas, progress: Progress | None = None) -> dict[str, Array]:
        """Variables of distinct materials, one entry a material."""
        parts = []
        for first in range(0, len(materials), CHUNK):
            some = materials[first : first + CHUNK]
            work = self.work(some)
            later = None if progress is None else _shifted(progress, first, len(materials))
            rows, status, used = run(self.solver, work, self.accuracy, threads=self.workers, progress=later)
            parts.append(canvas.values(rows, status, used))
        return (
            {name: np.concatenate([part[name] for part in parts]) for name in parts[0]} if len(parts) > 1 else parts[0]
        )


def _shifted(progress: Progress, start: int, total: int) -> Progress:
    return lambda done, _: progress(start + done, total)


def paint(job: Job, canvas: Canvas) -> int:
    """Fill the canvas, and return how many distinct materials the surface has."""
    # An atlas knows folds and grazing as borders, not the ends of the curves of a law with a neck.
    interpolating = job.solver.name == "auto" and not job.scope.interaction.law.hysteretic
    found = job.surface.found
    if found is not None and len(found[0]) <= (FEW if interpolating else MOST):
        values = job.solve(found[0], canvas, job.progress)
        _put(job, canvas, values, lambda part: found[1].reshape(-1)[part], 0, job.pixels)
        return len(found[0])
    known = Distinct(FEW if interpolating else MOST)
    taken = _collect(job, known, 0)
    if taken == job.pixels:
        values = job.solve(known.materials, canvas, job.progress)
        _put(job, canvas, values, _numbers(job, known), 0, taken)
        return len(known)
    count = count_distinct(job.surface.materials, job.pixels) if found is None else len(found[0])
    if interpolating:
        del known
        _paint_from_atlas(job, canvas, count)
        _paint_rest(job, canvas)
    else:
        _paint_segments(job, canvas, known, taken)
    return count


def _collect(job: Job, known: Distinct, first: int) -> int:
    """Take in the materials of the pixels from `first` on, and return where there was no more room."""
    for start in range(first, job.pixels, BLOCK):
        part = slice(start, min(start + BLOCK, job.pixels))
        taken = known.add(job.surface.materials(part))
        if start + taken < part.stop:
            return start + taken
    return job.pixels


def _numbers(job: Job, known: Distinct) -> Numbers:
    return lambda part: known.numbers(job.surface.materials(part))


def _put(job: Job, canvas: Canvas, values: dict[str, Array], numbers: Numbers, first: int, last: int) -> None:
    """Give each pixel of a range the values of its material."""

    def put(start: int, stop: int) -> None:
        part = slice(first + start, first + stop)
        at = numbers(part)
        canvas.put(part, {name: value[at] for name, value in values.items()})

    spread(put, [*range(0, last - first, BLOCK), last - first], job.workers, None)


def _paint_segments(job: Job, canvas: Canvas, known: Distinct, taken: int) -> None:
    """Solve an image range by range, each with as many distinct materials as are kept."""
    first = 0
    while first < job.pixels:
        values = job.solve(known.materials, canvas)
        _put(job, canvas, values, _numbers(job, known), first, taken)
        if job.progress is not None:
            job.progress(taken, job.pixels)
        first, known = taken, Distinct(MOST)
        taken = _collect(job, known, first)


def _paint_from_atlas(job: Job, canvas: Canvas, count: int) -> None:
    """Interpolate what can be; the other pixels stay pending."""
    axes, atlas = _make_atlas(job, count)
    wanted = np.array([FUNCTIONS.index(column) for column in _columns_of(canvas.names)], np.int64)
    to = np.array(FUNCTIONS)[wanted]
    painted: list[int] = []

    def paint(first: int, last: int) -> None:
        part = slice(first, last)
        points = axes.points(*job.properties(job.surface.materials(part)))
        piece, values = atlas(points, wanted)
        rows = np.full((col.COLUMNS, last - first), np.nan)
        rows[to] = values
        rows[col.AMPLITUDE] = np.where(piece >= 0, job.amplitude, np.nan)
        rows[col.ERROR_HEIGHT], rows[col.ERROR_PHASE] = np.where(piece >= 0, atlas.errors.T[:, piece], np.nan)
        rows[col.STIFFENING] = stiffening(job.scope, job.amplitude, rows[col.PHASE])
        status = np.where(piece >= 0, col.GOOD, PENDING).astype(np.int8)
        canvas.put(part, canvas.values(rows.T, status, np.full(last - first, col.INTERPOLATED, np.int8)))
        painted.append(int(np.count_nonzero(piece >= 0)))

    def report(_done: int, _total: int) -> None:
        if job.progress is not None:
            job.progress(sum(painted), job.pixels)

    if atlas.pieces:
        spread(paint, [*range(0, job.pixels, BLOCK), job.pixels], job.workers, report)


def _make_atlas(job: Job, count: int) -> tuple[Axes, Atlas]:
    """An atlas for the materials of a surface."""
    drawn = np.random.default_rng(0).integers(0, job.pixels, SAMPLE)
    stiffness, adhesion, damping = job.properties(np.unique(job.surface.materials(drawn), axis=0))
    valid = np.isfinite(stiffness + adhesion + damping)
    axes = Axes.around(stiffness[valid], damping[valid]) if valid.any() else Axes(False, 0.0)
    sample = axes.points(stiffness[valid], adhesion[valid], damping[valid]).T
    finer = Accuracy(FINER * job.accuracy.phase, FINER * job.accuracy.height)
    oracle = Oracle(job.scope, job.amplitude, axes, job.workers, finer)
    shuffled = np.random.default_rng(1).permutation(len(sample))
    return axes, build(oracle, np.ascontiguousarray(sample[shuffled]), count, tolerances_of(job))


def _columns_of(names: tuple[str, ...]) -> list[int]:
    """Result columns to interpolate for these variables."""
    needed = {
        "height": col.TIP_OFFSET, "phase": col.PHASE, "tip_offset": col.TIP_OFFSET, "mean_deflection": col.MEAN,
        "indentation": col.INDENTATION, "dissipation": col.DISSIPATION, "virial": col.VIRIAL, "branch": col.PHASE,
    }  # fmt: skip
    return sorted({needed[name] for name in names if name in needed})


def tolerances_of(job: Job) -> Array:
    """Largest errors of FUNCTIONS: lengths as the height, energies as what the phase's error does to them.

    The indentation is allowed more: the solvers give the deepest of the points at which they evaluate the force, and
    which one that is changes from material to material.
    """
    phase, height = math.radians(job.accuracy.phase), job.accuracy.height
    # The drive's work per cycle is pi k u0 A cos(phase), the virial of the harmonic orbit k u0 A sin(phase) / 2.
    energy = job.scope.cantilever.stiffness * job.scope.base_amplitude * job.amplitude * phase
    limits = {
        col.TIP_OFFSET: height, col.MEAN: height, col.INDENTATION: DEEPEST * height, col.PHASE: phase,
        col.DISSIPATION: math.pi * energy, col.VIRIAL: 0.5 * energy,
    }  # fmt: skip
    return np.array([limits[column] for column in FUNCTIONS])


def stiffening(scope: Microscope, amplitude: float | Array, phase: Array) -> Array:
    """omega_e^2 - 1 [1] that goes with a phase [rad], since u0 sin(phase) = P + A (1 - omega^2)."""
    return scope.base_amplitude / amplitude * np.sin(phase) - (1 - scope.frequency_ratio**2)


def _paint_rest(job: Job, canvas: Canvas) -> None:
    """Solve the pixels that are pending, each distinct material once in so many of them."""
    done = job.pixels - int(np.count_nonzero(canvas.status == PENDING))
    held: list[NDArray[np.intp]] = []
    for start in range(0, job.pixels, BLOCK):
        held.append(np.flatnonzero(canvas.status[start : start + BLOCK] == PENDING) + start)
        waiting = sum(map(len, held))
        if waiting == 0 or (waiting < REST and start + BLOCK < job.pixels):
            continue
        pixels, held = np.concatenate(held), []
        materials = job.surface.materials(pixels)
        known = Distinct(len(pixels))
        known.add(materials)
        numbers = known.numbers(materials)
        values = job.solve(known.materials, canvas)
        canvas.put(pixels, {name: value[numbers] for name, value in values.items()})
        done += len(pixels)
        if job.progress is not None:
            job.progress(done, job.pixels)
