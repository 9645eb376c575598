"""Images of a quasi-static scan: from pixel to pixel the tip stays on its branch, as long as there is one."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels.columns import NOWHERE
from phasemap._kernels.scanning.slots import Orbits
from phasemap._shared.threads import Progress
from phasemap.experiment.control import LINES, Raster
from phasemap.imaging.canvas import Canvas, values_of
from phasemap.imaging.engaged import Numbers, numbers_in, numbers_of
from phasemap.imaging.job import Job, Simulator, Values
from phasemap.imaging.materials.distinct import BLOCK, Distinct
from phasemap.imaging.materials.survey import Survey
from phasemap.solvers.both_branches import stable_branches

Array = NDArray[np.float64]

MOST = 1 << 17  # distinct materials that are kept at a time
STABLE, BEGINS, OFFSETS, REACH = ".stable", ".engaged", ".offsets", ".reach"  # what `walk` reads of a material


class Table(NamedTuple):
    """Distinct materials and what holds the setpoint on each."""

    materials: Array  # shape (n, 4)
    # Variables on the attractive branch, the repulsive one, and the one that engagement finds; and what `walk`
    # reads
    values: Values


class TipState(NamedTuple):
    """How a tip comes to a line: on which branch, and at which tip offset [m]."""

    branch: int = NOWHERE
    z0: float = 0.0


class Block(NamedTuple):
    """Lines of an image that are worked on together."""

    # first, last: from this line to before that one
    first: int
    last: int
    materials: Array  # shape (n, 4); what they are made of, each once
    numbers: Numbers  # which of these each pixel of a range is made of


def _check(_job: Job) -> None:
    """Every solver has branches."""


def _most(_job: Job) -> int:
    return MOST


def _plan(job: Job, survey: Survey, _before: Table | None) -> Table | None:
    """The branches of all materials, if these are few enough to be kept."""
    return None if survey.materials is None else _table(job, survey.materials, job.progress)


def _table(job: Job, materials: Array, progress: Progress | None) -> Table:
    """Solve the branches of materials."""

    def solve(some: Array, later: Progress | None) -> Values:
        work = job.work(some)
        found = stable_branches(work, job.solver, job.accuracy, job.workers, later)
        rows = job.widened(found.rows, found.solver, work, some)
        orbits = dict(zip((STABLE, BEGINS, OFFSETS, REACH), found.orbits, strict=True))
        return {
            **values_of(job.names, rows, found.status, found.solver, job.scope),
            **orbits,
        }

    return Table(materials, job.in_chunks(materials, solve, progress))


def _fill(job: Job, plan: Table | None, canvas: Canvas, state: TipState | None) -> TipState:
    """Fill the canvas, trace and retrace, from how the tip comes to how it leaves."""
    tip = TipState() if state is None else state
    if plan is not None:
        whole = Block(0, job.surface.shape[0], plan.materials, numbers_of(job, plan.materials))
        return _walk(job, canvas, whole, plan, tip)
    for block in _blocks(job):
        tip = _walk(job, canvas, block, _table(job, block.materials, _progress_of(job, block)), tip)
    return tip


def _progress_of(job: Job, block: Block) -> Progress:
    """Progress in pixels of the image, from that in materials of a block."""
    pixels = job.surface.shape[1]
    start, size = block.first * pixels, (block.last - block.first) * pixels
    return lambda done, total: job.report(start + done * size // total)


def _blocks(job: Job) -> Iterator[Block]:
    """As many lines at a time as have no more distinct materials than are kept."""
    lines, pixels = job.surface.shape
    first = 0
    while first < lines:
        known = Distinct(max(MOST, pixels))
        last, count = first, 0
        while last < lines and known.add(_line(job, last)) == pixels:
            last, count = last + 1, len(known)
        yield Block(first, last, known.materials[:count], numbers_in(job, known))
        first = last


def _line(job: Job, y: int) -> Array:
    pixels = job.surface.shape[1]
    return job.surface.materials(slice(y * pixels, (y + 1) * pixels))


def _walk(job: Job, canvas: Canvas, block: Block, table: Table, tip: TipState) -> TipState:
    """Fill in lines to which the tip comes, and return how it leaves them."""
    from phasemap._kernels.scanning.quasi_static import walk

    assert isinstance(job.control, Raster)
    anew, pixels, count = job.control.engage == "line", job.surface.shape[1], len(table.materials)
    orbits = Orbits(*(np.ascontiguousarray(table.values[name]) for name in (STABLE, BEGINS, OFFSETS, REACH)))
    values = {name: table.values[name].reshape(-1) for name in job.names}
    step = max(1, BLOCK // pixels)
    for first in range(block.first, block.last, step):
        part = slice(first * pixels, min(first + step, block.last) * pixels)
        materials = np.array(block.numbers(part), np.int32).reshape(-1, pixels)
        slots = np.empty((len(LINES), *materials.shape), np.int8)
        tip = TipState(*walk(materials, orbits, anew, tip.branch, tip.z0, slots))
        for direction in range(len(LINES)):
            at = (slots[direction] * np.int64(count) + materials).reshape(-1)
            canvas.put(part, {name: value[at] for name, value in values.items()}, direction)
    return tip


def _freeze(tip: TipState) -> Values:
    return {"branch": np.array(tip.branch), "tip_offset": np.array(tip.z0)}


def _thaw(arrays: Values) -> TipState:
    return TipState(int(arrays["branch"]), float(arrays["tip_offset"]))


SIMULATOR = Simulator(_check, _most, _plan, _fill, freeze=_freeze, thaw=_thaw)
