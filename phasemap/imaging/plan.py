"""How images come about under every control: a survey of the surface, a plan for the whole, then part by part."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from typing import Any, NamedTuple

from phasemap._shared.errors import InputError
from phasemap.experiment.control import Control, Engage, Feedback, Raster
from phasemap.experiment.microscope import Microscope
from phasemap.imaging.canvas import Canvas
from phasemap.imaging.imperfections import scopes_by_row
from phasemap.imaging.job import Job, Simulator
from phasemap.imaging.materials import Survey

SIMULATORS: dict[type[Control], str] = {Engage: "engaged", Raster: "raster", Feedback: "feedback.simulator"}
"""Modules that make the images of each control, imported with their kernels where they are needed."""


class Stretch(NamedTuple):
    """Lines that one tip scans."""

    # first, last: from this line of the image to before that one
    first: int
    last: int
    scope: Microscope
    plan: Any  # what the simulator planned for them


def simulator_of(control: Control) -> Simulator:
    """Who makes the images of a control."""
    if type(control) not in SIMULATORS:
        raise InputError("control", control, "one of " + ", ".join(f"{kind.__name__}()" for kind in SIMULATORS))
    found: Simulator = import_module(f"phasemap.imaging.{SIMULATORS[type(control)]}").SIMULATOR
    return found


def plan_image(job: Job, survey: Survey) -> list[Stretch]:
    """Plan an image for each tip that scans it.

    `job`: its surface may be any part of the image's.
    """
    simulator, before = simulator_of(job.control), None
    stretches = []
    for rows, scope in scopes_by_row(job.realism, job.scope, job.place.image[0]):
        mine = replace(job, scope=scope, place=job.place._replace(row=rows.start))
        before = simulator.plan(mine, survey, before)
        stretches.append(Stretch(rows.start, rows.stop, scope, before))
    return stretches


def fill_part(job: Job, stretches: list[Stretch], canvas: Canvas, state: Any = None) -> Any:
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
