"""Images of a quasi-static scan: from pixel to pixel the tip stays on its branch, as long as there is one.

Where almost every pixel is another material, what engagement finds is interpolated as in `engaged`. On most pixels that
is where the tip is; the other branch is solved only of pixels to which the tip comes on it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels import columns as col
from phasemap._kernels.columns import ENGAGED, NOWHERE, SLOTS, UNKNOWN_ORBIT, StableOrbits
from phasemap._kernels.scanning.quasi_static import walk_line
from phasemap._shared.arrays import Array
from phasemap._shared.errors import InputError
from phasemap._shared.threads import Progress, bounds_of, chunk_of, spread
from phasemap.experiment.control import LINES, Raster
from phasemap.imaging.canvas import Canvas, Values, values_of
from phasemap.imaging.engaged import (
    FEW,
    Block,
    Interpolants,
    blocks,
    interpolates,
    known_numbers,
    make_atlas,
    material_numbers,
)
from phasemap.imaging.job import Job, Simulator
from phasemap.imaging.materials import BLOCK, Distinct, Survey
from phasemap.results.variables import OF_ORBITS
from phasemap.solvers.both_branches import Branches, stable_branches

MOST = 1 << 17  # distinct materials that are kept at a time
WALKED = (".stable", ".engaged", ".offsets", ".reach")  # what `walk_line` reads of a material


class OrbitTable(NamedTuple):
    """Distinct materials and what holds the setpoint on each."""

    materials: Array  # shape (n, 4)
    # Variables on the attractive branch, the repulsive one, and the one that engagement finds; and what `walk_line`
    # reads
    values: Values


class TipState(NamedTuple):
    """State in which a tip comes to a line: its branch, and its tip offset [m]."""

    branch: int = NOWHERE
    z0: float = 0.0


def _check(job: Job) -> None:
    """Refuse a march under two drives: it knows motion that engagement finds, and no orbit on the other branch."""
    if job.solver.name == "march" and job.scope.drive.second is not None:
        allowed = "'auto', 'orbit' or 'averaging' with control=Raster() where the drive has a second mode"
        raise InputError("solver", "march", allowed, "Engage marches both drives.")


def _interpolates(job: Job) -> bool:
    """Integrals over orbits are not interpolated beside what is solved."""
    return interpolates(job) and not set(OF_ORBITS) & set(job.needs)


def _plan(job: Job, survey: Survey, _before: OrbitTable | Interpolants | None) -> OrbitTable | Interpolants | None:
    """The branches of all materials if these are few, or an atlas of more, or neither."""
    if survey.materials is not None:
        return _table(job, survey.materials, job.progress)
    return make_atlas(job, survey.sample, survey.count) if _interpolates(job) else None


def _table(job: Job, materials: Array, progress: Progress | None) -> OrbitTable:
    """Solve the branches of materials."""

    def solve(chunk: Array, later: Progress | None) -> Values:
        work = job.work(chunk)
        branches = stable_branches(work, job.solver, job.accuracy, job.workers, later)
        rows = job.widened(branches.rows, branches.solver, work, chunk)
        orbits = dict(zip(WALKED, branches.orbits, strict=True))
        return {**values_of(job.names, rows, branches.status, branches.solver, job.scope), **orbits}

    return OrbitTable(materials, job.in_chunks(materials, solve, progress))


def _fill(job: Job, plan: OrbitTable | Interpolants | None, canvas: Canvas, state: TipState | None) -> TipState:
    """Fill the canvas, trace and retrace, from the state in which the tip comes; returns that in which it leaves."""
    tip = TipState() if state is None else state
    if isinstance(plan, Interpolants):
        return _fill_interpolated(job, plan, canvas, tip)
    if plan is not None:
        whole = Block(0, job.surface.shape[0], plan.materials, material_numbers(job, plan.materials))
        return _walk(job, canvas, whole, plan, tip)
    for block in blocks(job, MOST):
        tip = _walk(job, canvas, block, _table(job, block.materials, _progress_of(job, block)), tip)
    return tip


def _progress_of(job: Job, block: Block) -> Progress:
    """Progress in pixels of the image, from that in materials of a block."""
    pixels = job.surface.shape[1]
    start, size = block.first * pixels, (block.last - block.first) * pixels
    return lambda done, total: job.report(start + done * size // total)


def _walk(job: Job, canvas: Canvas, block: Block, table: OrbitTable, tip: TipState) -> TipState:
    """Fill in lines to which the tip comes in a state, and return the state in which it leaves them."""
    assert isinstance(job.control, Raster)
    anew, pixels, count = job.control.engage == "line", job.surface.shape[1], len(table.materials)
    orbits = StableOrbits(*(np.ascontiguousarray(table.values[name]) for name in WALKED))
    values = {name: table.values[name].reshape(-1) for name in job.names}
    step = max(1, BLOCK // pixels)
    for first in range(block.first, block.last, step):
        part = slice(first * pixels, min(first + step, block.last) * pixels)
        materials = np.array(block.numbers(part), np.int32).reshape(-1, pixels)
        slots = np.empty((len(LINES), *materials.shape), np.int8)
        tip = TipState(*walk_line(materials, orbits, anew, tip.branch, tip.z0, slots))
        for direction in range(len(LINES)):
            at = (slots[direction] * np.int64(count) + materials).reshape(-1)
            canvas.put_solved(part, values, at, direction)
    return tip


def _fill_interpolated(job: Job, plan: Interpolants, canvas: Canvas, tip: TipState) -> TipState:
    """`_fill` from an atlas, some lines at a time."""
    lines, pixels = job.surface.shape
    step = max(1, BLOCK // pixels)
    for first in range(0, lines, step):
        last = min(first + step, lines)
        materials = job.surface.materials(slice(first * pixels, last * pixels))
        known = Distinct(len(materials))
        known.add(materials)
        numbers = known.numbers(materials).reshape(-1, pixels)
        table = _table_on_way(job, plan, known.materials, numbers, tip)
        tip = _walk(job, canvas, Block(first, last, known.materials, known_numbers(job, known)), table, tip)
        job.report(last * pixels)
    return tip


def _table_on_way(
    job: Job, plan: Interpolants, materials: Array, numbers: NDArray[np.int32], tip: TipState
) -> OrbitTable:
    """Table of materials with all that a tip meets on its way over lines of them, shape (lines, pixels).

    How far it stays on a branch of which is not known whether it is there shows step by step: it is asked of twice as
    many pixels ahead each time.
    """
    assert isinstance(job.control, Raster)
    branches, orbits = _interpolated(job, plan, materials)
    slots, ahead = np.empty((len(LINES), *numbers.shape), np.int8), 1
    farthest = numbers.shape[1] if job.control.engage == "line" else numbers.size
    while True:
        walk_line(numbers, orbits, job.control.engage == "line", tip.branch, tip.z0, slots)
        asked = _asked(slots, numbers, orbits, ahead)
        if not len(asked):
            break
        known = branches.rows[ENGAGED, asked], branches.status[ENGAGED, asked], branches.solver[ENGAGED, asked]
        solved = stable_branches(job.work(materials[asked]), job.solver, job.accuracy, job.workers, engaged=known)
        branches.put(asked, solved)
        orbits.stable[:, asked], orbits.offsets[:, asked] = solved.stable, solved.orbits.offsets
        ahead = min(2 * ahead, farthest)
    values = values_of(job.names, branches.rows, branches.status, branches.solver, job.scope)
    return OrbitTable(materials, {**values, **dict(zip(WALKED, orbits, strict=True))})


def _interpolated(job: Job, plan: Interpolants, materials: Array) -> tuple[Branches, StableOrbits]:
    """Orbits that hold the setpoint on each material, of the interpolated ones as far as engagement finds them."""
    count = len(materials)
    names = (*job.needs, "tip_offset", "phase")
    engaged = np.empty((count, col.COLUMNS))

    def interpolate(first: int, last: int) -> None:
        engaged[first:last] = plan.rows(job, materials[first:last], names)

    spread(interpolate, bounds_of(count, chunk_of(count, job.workers, BLOCK)), job.workers, None)
    held = ~np.isnan(engaged[:, col.AMPLITUDE])
    rows = np.full((SLOTS, count, col.COLUMNS), np.nan)
    side = col.is_repulsive(engaged).astype(np.intp)
    rows[side, np.arange(count)], rows[ENGAGED] = engaged, engaged
    status, solver = np.full((SLOTS, count), col.GOOD, np.int8), np.full((SLOTS, count), col.INTERPOLATED, np.int8)
    branches = Branches(rows, status, solver, np.full((ENGAGED, count), np.inf))
    rest = np.flatnonzero(~held)
    if len(rest):
        branches.put(rest, stable_branches(job.work(materials[rest]), job.solver, job.accuracy, job.workers))
    orbits = branches.orbits
    orbits.stable[1 - side[held], np.flatnonzero(held)] = UNKNOWN_ORBIT
    return branches, orbits


def _asked(slots: NDArray[np.int8], numbers: NDArray[np.int32], orbits: StableOrbits, ahead: int) -> NDArray[np.intp]:
    """Materials whose other branch has to be known: of pixels that were guessed, and `ahead` pixels on.

    `slots`: as `walk_line` fills them, below 0 where the branch was guessed.
    Beyond the end of the line that is so much of the lines below, where the tip comes if it is not engaged anew.
    """
    asked = np.zeros(orbits.stable.shape[1], np.bool_)
    lines, pixels = numbers.shape
    for way, onwards in ((0, 1), (1, -1)):
        line, place = np.nonzero(slots[way] < 0)
        side = orbits.engaged[numbers[line, place]]
        for step in range(min(ahead, pixels)):
            met = numbers[line, np.clip(place + onwards * step, 0, pixels - 1)]
            asked[met[orbits.engaged[met] == side]] = True
        for below in range(1, 1 + ahead // pixels):
            met = numbers[np.minimum(line + below, lines - 1)]
            asked[met[orbits.engaged[met] == side[:, np.newaxis]]] = True
    return np.flatnonzero(asked & (orbits.stable == UNKNOWN_ORBIT).any(axis=0))


SIMULATOR = Simulator(
    lambda job: FEW if _interpolates(job) else MOST,
    _plan,
    _fill,
    _check,
    freeze=lambda tip: {"branch": np.array(tip.branch), "tip_offset": np.array(tip.z0)},
    thaw=lambda arrays: TipState(int(arrays["branch"]), float(arrays["tip_offset"])),
)
