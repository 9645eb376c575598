"""Job of an image or a part of one, who does it, and the plan: a survey, then part by part."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, partial
from importlib import import_module
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.arrays import Array
from phasemap._shared.errors import InputError
from phasemap._shared.interrupts import check_stopped
from phasemap._shared.threads import Progress
from phasemap.experiment.accuracy import Accuracy
from phasemap.experiment.control import Control, Engage, Feedback, Raster
from phasemap.experiment.material_rows import film_of, properties
from phasemap.experiment.microscope import Microscope
from phasemap.experiment.realism import Realism
from phasemap.experiment.surface import Surface
from phasemap.imaging.canvas import Canvas, Values, joined_notes, values_of
from phasemap.imaging.checkpoint import Checkpoint, FilledLines
from phasemap.imaging.imperfections import scopes_by_row
from phasemap.imaging.materials import Survey, Window
from phasemap.results.quantities import needs_of
from phasemap.results.variables import OF_ORBITS
from phasemap.solvers.integrals import bare_rows, widened
from phasemap.solvers.problem import Work, make_work
from phasemap.solvers.run import run
from phasemap.solvers.solver import Solver

CHUNK = 1 << 15  # distinct materials that are solved together
FEWEST = 1 << 4  # for each thread, where what is solved is kept on disk


@dataclass(frozen=True)
class Job:
    """Work of an image or a part of one."""

    surface: Surface  # of the image, or of the part that is to be filled
    place: Window  # where it lies in the image
    scope: Microscope
    amplitude: float  # at the setpoint [m]
    control: Control
    solver: Solver
    accuracy: Accuracy
    realism: Realism  # its drift is in the surface already; what comes after the scan is not a concern of a simulator
    names: tuple[str, ...]  # image variables, `status` among them, and channels
    workers: int  # threads
    progress: Progress | None = None
    memo: Checkpoint | None = None  # of what is solved

    @property
    def only_in_time(self) -> bool:
        """True if some contact remembers or is wet."""
        return self.remembers or self.scope.interaction.law.in_time

    @property
    def remembers(self) -> bool:
        """True if some contact remembers."""
        loss = self.surface.viscosity if self.surface.damping is None else self.surface.damping
        viscous = self.scope.interaction.withdrawal == "ting" and loss is not None and bool((loss > 0).any())
        return self.surface.relaxes or viscous

    @property
    def pixels(self) -> int:
        """Number of pixels."""
        return self.surface.shape[0] * self.surface.shape[1]

    def report(self, done: int) -> None:
        """Say how many pixels of the part are done, in those of the image."""
        check_stopped()
        if self.progress is not None:
            ny, nx = self.place.image
            self.progress(self.place.row * nx + done, ny * nx)

    def properties(self, materials: Array) -> tuple[Array, Array, Array]:
        """See `phasemap.experiment.material_rows.properties`."""
        return properties(materials, self.surface.viscosity is not None, self.scope)

    def work(self, materials: Array) -> Work:
        """Work of these materials."""
        return make_work(materials, self.surface.viscosity is not None, self.scope, self.amplitude, marched=True)

    def solve(self, materials: Array, progress: Progress | None = None) -> Values:
        """Variables of distinct materials, one entry a material."""

        def solve(chunk: Array, later: Progress | None) -> Values:
            bare, needs = cache(partial(self._bare, chunk)), self.needs

            def widen(part: Work, rows: Array, used: NDArray[np.int8], at: NDArray[np.intp]) -> Array:
                return widened(rows, part, used, self.scope, lambda: bare()[at], needs)

            more = None if set(OF_ORBITS).isdisjoint(needs) else widen
            rows, status, used = run(
                self.solver, self.work(chunk), self.accuracy, threads=self.workers, progress=later, widen=more
            )
            return values_of(self.names, rows, status, used, self.scope)

        return self.in_chunks(materials, solve, progress)

    @property
    def needs(self) -> tuple[str, ...]:
        """Variables that must be known of an orbit."""
        return needs_of(self.names)

    def widened(self, rows: Array, used: NDArray[np.int8], work: Work, materials: Array) -> Array:
        """Result rows of materials, shape (..., n, COLUMNS), with what the variables asked for need besides."""
        return widened(rows, work, used, self.scope, partial(self._bare, materials), self.needs)

    def _bare(self, materials: Array) -> Array:
        """Parameter rows of these materials without adhesion, damping and bias."""
        return bare_rows(self.properties(materials)[0], self.scope, film_of(materials))

    def in_chunks(
        self, materials: Array, solve: Callable[[Array, Progress | None], Values], progress: Progress | None
    ) -> Values:
        """Variables of materials, which are the last axis, from those of so many at a time."""
        count = len(materials)

        def solved(part: slice) -> Values:
            values = solve(materials[part], _shifted(progress, part.start, count))
            if progress is not None and count:
                progress(min(part.stop, count), count)  # with materials that are refused, which no solver counts
            return values

        total = max(count, 1)
        if self.memo is None:
            return _joined([solved(slice(first, first + CHUNK)) for first in range(0, total, CHUNK)])
        name = f"materials-{self.place.row}"
        kept = self.memo.recall(name)
        parts, done = [kept] if kept else [], next(iter(kept.values())).shape[-1] if kept else 0
        for part in self.memo.portions(done, total, FEWEST * self.workers, CHUNK):
            parts.append(solved(part))
            if self.memo.due:
                parts = [_joined(parts)]
                self.memo.remember(name, parts[0])
        return _joined(parts)


def _shifted(progress: Progress | None, start: int, total: int) -> Progress | None:
    """Progress of a part that begins at `start`, as progress of the whole."""
    return None if progress is None else lambda done, _: progress(start + done, total)


def _joined(parts: list[Values]) -> Values:
    """Variables of parts, one after the other along the last axis."""
    if len(parts) == 1:
        return parts[0]
    return {name: np.concatenate([part[name] for part in parts], axis=-1) for name in parts[0]}


class Simulator(NamedTuple):
    """Functions that make the images of one control: a plan for all of it, then part by part."""

    most: Callable[[Job], int]  # ``most(job)``: distinct materials up to which the plan wants to know them all
    # ``plan(job, survey, before)``: what all parts share, of a job for the whole image or for the lines of one
    # tip; `before` is the plan of the tip before, or None. It can be pickled.
    plan: Callable[[Job, Survey, Any], Any]
    # ``fill(job, plan, canvas, state)``: fills the canvas of a part, to which the tip comes in a state, and
    # returns that in which it leaves; none is a tip that is far away. A control that carries no state takes and
    # returns None.
    fill: Callable[[Job, Any, Canvas, Any], Any]
    check: Callable[[Job], object] = lambda job: None  # raises `InputError` where the control cannot work with the rest
    # Names of what it finds out for the attributes of an image, with long names
    notes: Mapping[str, str] = MappingProxyType({})
    # freeze, thaw: from a state to arrays that can be kept in a file, and back
    freeze: Callable[[Any], Values] = lambda state: {}
    thaw: Callable[[Values], Any] = lambda arrays: None


SIMULATORS: dict[type[Control], str] = {Engage: "engaged", Raster: "raster", Feedback: "feedback.simulator"}
"""Modules that make the images of each control, imported with their kernels where they are needed."""


class LineRun(NamedTuple):
    """Lines that one tip scans."""

    # first, last: from this line of the image to before that one
    first: int
    last: int
    scope: Microscope
    plan: Any  # what the simulator planned for them


def simulator_of(control: Control) -> Simulator:
    """Simulator that makes the images of a control."""
    if type(control) not in SIMULATORS:
        raise InputError("control", control, "one of " + ", ".join(f"{kind.__name__}()" for kind in SIMULATORS))
    return import_module(f"phasemap.imaging.{SIMULATORS[type(control)]}").SIMULATOR


def plan_image(job: Job, survey: Survey) -> list[LineRun]:
    """Plan an image for each tip that scans it. `job`: its surface may be any part of the image's."""
    simulator, before = simulator_of(job.control), None
    stretches = []
    for rows, scope in scopes_by_row(job.realism, job.scope, job.place.image[0]):
        mine = replace(job, scope=scope, place=job.place._replace(row=rows.start))
        before = simulator.plan(mine, survey, before)
        stretches.append(LineRun(rows.start, rows.stop, scope, before))
    return stretches


def fill_part(job: Job, stretches: list[LineRun], canvas: Canvas, state: Any = None) -> Any:
    """Fill the canvas of a part of the image, to which the tip comes in a state, and return that in which it leaves.

    Without time a changed tip is engaged anew.
    """
    simulator, top = simulator_of(job.control), job.place.row
    for stretch in stretches:
        first, last = max(stretch.first, top), min(stretch.last, top + job.surface.shape[0])
        if first >= last:
            continue
        if first == stretch.first and not job.control.in_time:
            state = None
        rows = slice(first - top, last - top)
        surface = job.surface if last - first == job.surface.shape[0] else job.surface.rows(rows)
        part = replace(job, surface=surface, scope=stretch.scope, place=job.place._replace(row=first), memo=None)
        mine = canvas.part(surface, rows)
        state = simulator.fill(part, stretch.plan, mine, state)
        canvas.note(mine.notes)
    return state


def fill_kept(job: Job, stretches: list[LineRun], canvas: Canvas, checkpoint: Checkpoint) -> None:
    """Fill the canvas some lines at a time, keep them every few seconds, and go on after those that were kept.

    How many lines are filled at a time depends on how long they take; the numbers do not depend on it.
    """
    simulator, surface, lines = simulator_of(job.control), job.surface, job.surface.shape[0]
    first, state = _restored(job, canvas, checkpoint)
    waiting = FilledLines(first, first, {}, {}, {})
    at_once = 1 if job.control.carried else job.workers  # lines that threads may share
    for rows in checkpoint.portions(first, lines, at_once, lines):
        mine = replace(job, surface=surface.rows(rows), place=job.place._replace(row=rows.start))
        part = canvas.part(mine.surface, rows)
        state = fill_part(mine, stretches, part, state)
        canvas.note(part.notes)
        waiting = waiting._replace(last=rows.stop, notes=joined_notes(waiting.notes, part.notes))
        if checkpoint.due:
            done = slice(waiting.first, waiting.last)
            arrays = canvas.part(surface.rows(done), done).arrays()
            checkpoint.keep(waiting._replace(arrays=arrays, state=simulator.freeze(state)))
            waiting = FilledLines(rows.stop, rows.stop, {}, {}, {})


def _restored(job: Job, canvas: Canvas, checkpoint: Checkpoint) -> tuple[int, Any]:
    """Fill in the lines that were kept; returns the first that is not, and the state in which the tip comes to it."""
    first, state, thaw = 0, None, simulator_of(job.control).thaw
    with suppress(KeyError, TypeError, ValueError):  # of what does not fit, which is made again
        for kept in checkpoint.lines():
            left, rows = thaw(kept.state), slice(kept.first, kept.last)
            canvas.part(job.surface.rows(rows), rows).restore(kept.arrays)
            canvas.note(kept.notes)
            first, state = kept.last, left
    return first, state
