"""A scan in time, line by line, into a canvas."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from phasemap._kernels import columns as col
from phasemap.canvas import Canvas
from phasemap.control import Feedback
from phasemap.errors import InputError
from phasemap.feedback.lines import Lines, Tip
from phasemap.feedback.loop import check, drive_frequency
from phasemap.feedback.settling import quietened
from phasemap.feedback.tuning import LinearLoop
from phasemap.microscope import Microscope
from phasemap.paint import Job
from phasemap.realism import scopes_by_row
from phasemap.workers import Progress, spread

LOWEST_Q = 20.0  # below this the lever changes too much within a period to be averaged
FASTEST = 0.1  # per tau, of amplitude and phase; beyond, stiff contact makes them change as much


def engine_of(job: Job, linear: LinearLoop) -> int:
    """Code of the solver that moves the tip: the averaged lever, or the equation of motion.

    Raises
    ------
    InputError
        If the solver does not act in time.
    """
    name = job.solver.name
    if name == "auto":
        slow = job.scope.cantilever.quality_factor >= LOWEST_Q and linear.fastest <= FASTEST
        return col.AVERAGING if slow else col.MARCH
    if name in ("averaging", "march"):
        return col.AVERAGING if name == "averaging" else col.MARCH
    raise InputError("solver", name, "'averaging', 'march' or 'auto' with control=Feedback(), which acts in time")


def paint(job: Job, canvas: Canvas) -> int:
    """Fill the canvas, and return how many distinct materials the surface has."""
    control = job.control
    assert isinstance(control, Feedback)
    ny, nx = job.surface.shape
    check(control, job.scope, nx)
    materials, numbers = job.surface.unique()
    work = job.work(materials)
    linear = LinearLoop(control, job.scope, work)
    engine = engine_of(job, linear)
    if control.integral_gain is None:
        control = quietened(linear.tuned(), job, work, engine)
    canvas.notes.update(_notes(control, job.scope, linear.margin(control), nx))
    tip = Tip(engine)
    for rows, scope in scopes_by_row(job.realism, job.scope, ny):  # a tip that changes
        part = replace(job, scope=scope)
        lines = Lines(part, control, part.work(materials), numbers, engine, canvas)
        anew = control.engage == "line"
        scan = partial(_engaged_anew, lines, engine) if anew else partial(_carried, lines, tip)
        bounds = range(rows.start, rows.stop + 1)
        spread(scan, bounds, job.workers if anew else 1, _counted(job, rows.start))
        canvas.notes["ringing_lines"] = canvas.notes.get("ringing_lines", 0) + int((~lines.calm).sum())
    return len(materials)


def _engaged_anew(lines: Lines, engine: int, first: int, last: int) -> None:
    for row in range(first, last):
        lines.scan(row, Tip(engine))


def _carried(lines: Lines, tip: Tip, first: int, last: int) -> None:
    for row in range(first, last):
        lines.scan(row, tip)


def _counted(job: Job, start: int) -> Progress | None:
    """Progress in lines of the whole image, of a part that begins at a line."""
    if job.progress is None:
        return None
    report, total = job.progress, job.surface.shape[0]
    return lambda done, _: report(start + done, total)


def _notes(control: Feedback, scope: Microscope, margin: float, pixels: int) -> dict[str, float]:
    """Gains, how far they are from ringing, and the time over a pixel."""
    dwell = control.dwell(pixels)
    notes = {
        "proportional_gain": control.proportional_gain or 0.0, "integral_gain_per_second": control.integral_gain or 0.0,
        "gain_margin": margin, "dwell_seconds": dwell,
        "periods_per_pixel": dwell * drive_frequency(scope),
    }  # fmt: skip
    return {name: float(f"{value:.6g}") for name, value in notes.items()}
