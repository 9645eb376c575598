"""Images of a quasi-static scan: from pixel to pixel the tip stays on its branch, as long as there is one."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels.scanning.slots import NOWHERE
from phasemap.branches import stable_branches
from phasemap.canvas import Canvas
from phasemap.control import LINES, Raster
from phasemap.distinct import BLOCK, Distinct, count_distinct
from phasemap.paint import Job, Numbers
from phasemap.work import work_of
from phasemap.workers import Progress

Array = NDArray[np.float64]

MOST = 1 << 17  # distinct materials that are kept at a time


class Block(NamedTuple):
    """Lines of an image that are worked on together.

    Attributes
    ----------
    first, last : int
        From this line to before that one.
    materials : ndarray, shape (n, 4)
        What they are made of, each once.
    numbers : callable
        Which of these each pixel of a range is made of.
    """

    first: int
    last: int
    materials: Array
    numbers: Numbers


def paint_raster(job: Job, canvas: Canvas) -> int:
    """Fill the canvas, trace and retrace, and return how many distinct materials the surface has."""
    branch = NOWHERE
    for block in _blocks(job):
        whole = block.last - block.first == job.surface.shape[0]
        branch = _paint_block(job, canvas, block, branch, job.progress if whole else _progress_of(job, block))
        if whole:
            return len(block.materials)
    return count_distinct(job.surface.materials, job.pixels)


def _progress_of(job: Job, block: Block) -> Progress | None:
    """Progress in pixels of the image, from that in materials of a block."""
    report, pixels = job.progress, job.surface.shape[1]
    if report is None:
        return None
    start, size = block.first * pixels, (block.last - block.first) * pixels
    return lambda done, total: report(start + done * size // total, job.pixels)


def _blocks(job: Job) -> Iterator[Block]:
    """As many lines at a time as have no more distinct materials than are kept."""
    found, (lines, pixels) = job.surface.found, job.surface.shape
    if found is not None and len(found[0]) <= MOST:
        yield Block(0, lines, found[0], lambda part: found[1].reshape(-1)[part])
        return
    first = 0
    while first < lines:
        known = Distinct(max(MOST, pixels))
        last, count = first, 0
        while last < lines and known.add(_line(job, last)) == pixels:
            last, count = last + 1, len(known)
        yield Block(first, last, known.materials[:count], _numbers(job, known))
        first = last


def _line(job: Job, y: int) -> Array:
    pixels = job.surface.shape[1]
    return job.surface.materials(slice(y * pixels, (y + 1) * pixels))


def _numbers(job: Job, known: Distinct) -> Numbers:
    return lambda part: known.numbers(job.surface.materials(part))


def _paint_block(job: Job, canvas: Canvas, block: Block, branch: int, progress: Progress | None) -> int:
    """Fill in lines to which the tip comes on `branch`, and return the one on which it leaves them."""
    from phasemap._kernels.scanning.walk import walk

    assert isinstance(job.control, Raster)
    anew = job.control.engage == "line"
    work = work_of(*job.properties(block.materials), job.scope, job.amplitude)
    found = stable_branches(work, job.solver, job.accuracy, job.workers, progress)
    stable, engaged = found.stable, found.engaged
    values = {name: value.reshape(-1) for name, value in canvas.values(*found).items()}
    pixels = job.surface.shape[1]
    step = max(1, BLOCK // pixels)
    for first in range(block.first, block.last, step):
        part = slice(first * pixels, min(first + step, block.last) * pixels)
        materials = np.array(block.numbers(part), np.int32).reshape(-1, pixels)
        slots = np.empty((len(LINES), *materials.shape), np.int8)
        branch = walk(materials, stable, engaged, anew, branch, slots)
        for direction in range(len(LINES)):
            at = (slots[direction] * np.int64(len(work)) + materials).reshape(-1)
            canvas.put(part, {name: value[at] for name, value in values.items()}, direction)
    return int(branch)
