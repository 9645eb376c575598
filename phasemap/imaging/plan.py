"""How images come about under every control: a survey of the surface, a plan for the whole, then part by part."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

from phasemap._shared.errors import InputError
from phasemap.experiment.control import Control, Engage, Feedback, Raster
from phasemap.experiment.microscope import Microscope
from phasemap.imaging.canvas import Canvas
from phasemap.imaging.engaged import PAINTER
from phasemap.imaging.imperfections import scopes_by_row
from phasemap.imaging.job import Job, Painter
from phasemap.imaging.materials.survey import Survey


def _feedback() -> Painter:
    """Its kernels are imported only where they are needed."""
    from phasemap.imaging.feedback import PAINTER

    return PAINTER


def _raster() -> Painter:
    from phasemap.imaging.raster import PAINTER

    return PAINTER


PAINTERS: dict[type[Control], Callable[[], Painter]] = {Engage: lambda: PAINTER, Raster: _raster, Feedback: _feedback}
"""Who makes the images of each control."""


class Stretch(NamedTuple):
    """Lines that one tip scans.

    Attributes
    ----------
    first, last : int
        From this line of the image to before that one.
    scope : Microscope
    plan : object
        What the painter planned for them.
    """

    first: int
    last: int
    scope: Microscope
    plan: Any


def painter_of(control: Control) -> Painter:
    """Who makes the images of a control.

    Raises
    ------
    InputError
        If it is none.
    """
    if type(control) not in PAINTERS:
        raise InputError("control", control, "one of " + ", ".join(f"{kind.__name__}()" for kind in PAINTERS))
    return PAINTERS[type(control)]()


def plan_image(job: Job, survey: Survey) -> list[Stretch]:
    """Plan an image for each tip that scans it.

    Parameters
    ----------
    job : Job
        Its surface may be any part of the image's.
    survey : Survey
        Of the whole surface.
    """
    painter, before = painter_of(job.control), None
    stretches = []
    for rows, scope in scopes_by_row(job.realism, job.scope, job.place.image[0]):
        mine = replace(job, scope=scope, place=job.place._replace(row=rows.start))
        before = painter.plan(mine, survey, before)
        stretches.append(Stretch(rows.start, rows.stop, scope, before))
    return stretches


def paint_part(job: Job, stretches: list[Stretch], canvas: Canvas, state: Any = None) -> Any:
    """Fill the canvas of a part of the image, to which the tip comes in a state, and return that in which it leaves.

    Without time a changed tip is engaged anew.
    """
    painter, top = painter_of(job.control), job.place.row
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
        state = painter.paint(part, stretch.plan, mine, state)
        canvas.note(mine.notes)
    return state
