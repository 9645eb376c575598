"""A scan in time, line by line, into a canvas."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phasemap._kernels import columns as col
from phasemap._shared.errors import InputError
from phasemap._shared.notices import tell
from phasemap._shared.threads import Progress, spread
from phasemap.experiment.control import Feedback
from phasemap.experiment.microscope import Microscope
from phasemap.imaging.canvas import Canvas
from phasemap.imaging.feedback.lines import (
    Lifts,
    LoopState,
    ScanLines,
    check_loop,
    drive_frequency,
    first_orbits,
    lifts_by_stiffness,
)
from phasemap.imaging.feedback.tuning import LinearLoop, quietened
from phasemap.imaging.job import Job, Simulator
from phasemap.imaging.materials import Survey
from phasemap.solvers.problem import Work

LOWEST_Q = 20.0  # below this the lever changes too much within a period to be averaged
TRIED = 48  # materials that are engaged to find out whether the averaged lever can follow them
MOST = 1 << 17  # distinct materials up to which gains are those for all of them, else for a sample


@dataclass(frozen=True, eq=False)
class LinePlan:
    """Plan for all lines of an image under one tip."""

    control: Feedback  # with gains
    engine: int  # code of the solver that moves the tip
    lifts: Lifts | None  # none for the equation of motion, which has all harmonics
    notes: dict[str, float]  # gains and what they are worth, for the image's attributes


def _check(job: Job) -> None:
    """Refuse a solver that does not act in time, and a loop that cannot work with this lever."""
    assert isinstance(job.control, Feedback)
    check_loop(job.control, job.scope, job.place.image[1])
    if (name := job.solver.name) not in ("auto", "averaging", "march"):
        raise InputError("solver", name, "'averaging', 'march' or 'auto' with control=Feedback(), which acts in time")


def _plan(job: Job, survey: Survey, before: LinePlan | None) -> LinePlan:
    """Plan with gains found by the first tip, and the tip's shift by higher harmonics on each material."""
    control = job.control
    assert isinstance(control, Feedback)
    materials = survey.sample if survey.materials is None else survey.materials
    work = job.work(materials[np.lexsort(materials.T[::-1])])  # whatever the order of the pixels
    if (valid := work.refused() == col.GOOD).any():  # a material that is refused has no say
        work = work.part(valid)
    if before is not None:
        control, engine, notes = before.control, before.engine, before.notes
    else:
        linear = LinearLoop(control, job.scope, work)
        engine = _engine_of(job, work)
        tuned, restless = linear.tuned(), 0
        if control.integral_gain is None:
            control, restless = quietened(tuned, job, work, engine)
        lowered = (tuned.integral_gain or 1.0) / (control.integral_gain or 1.0)
        notes = _notes(control, job.scope, linear.margin(control), job.place.image[1])
        notes |= {"gains_lowered": lowered, "restless_materials": restless}
        if restless:
            tell([f"{RESTLESS} The gains are lowered by a factor of {lowered:g}; set others in Feedback."])
    return LinePlan(control, engine, lifts_by_stiffness(job, work) if engine == col.AVERAGING else None, notes)


def _engine_of(job: Job, work: Work) -> int:
    """Code of the solver that moves the tip: the averaged lever, or the equation of motion.

    The averaged lever taps in every period or in none. A contact with hysteresis that is just touched does not. Its
    higher modes follow the first at once, so that none may ring longer.
    """
    name, hysteretic = job.solver.name, bool((work.rows[work.refused() == col.GOOD, col.RELEASE] != 0).any())
    first, *higher = (mode.quality_factor / mode.frequency_ratio for mode in job.scope.cantilever.eigenmodes)
    ringing = any(one > first for one in higher)
    if name == "auto":
        slow = job.scope.cantilever.quality_factor >= LOWEST_Q and not hysteretic and not ringing
        return col.AVERAGING if slow and not job.only_in_time else col.MARCH
    if name == "averaging" and ringing:
        allowed = "'march' or 'auto': a higher mode rings longer than the first, which alone is averaged"
        raise InputError("solver", name, allowed)
    if name == "averaging" and hysteretic:
        tried = work.part(np.unique(np.linspace(0, len(work) - 1, TRIED).astype(np.intp)))
        rows, _, _ = first_orbits(job, tried)
        if irregular := int(col.is_mean(rows).sum()):
            allowed = (
                f"'march' or 'auto': on {irregular} of {len(tried)} materials tried the tip does not touch in every "
            )
            raise InputError("solver", name, allowed + "period, which the averaged lever cannot follow")
    return col.AVERAGING if name == "averaging" else col.MARCH


def _fill(job: Job, plan: LinePlan, canvas: Canvas, state: LoopState | None) -> LoopState | None:
    """Fill the canvas of some lines, to which the tip comes in a state, and return that in which it leaves."""
    materials, numbers = job.surface.unique()
    lines = ScanLines(job, plan.control, job.work(materials), numbers, plan.engine, plan.lifts, canvas)
    bounds = range(len(numbers) + 1)
    tip = None
    if plan.control.engage == "line":
        spread(lambda row, _: lines.scan(row, LoopState(plan.engine)), bounds, job.workers, _counted(job))
    else:
        tip = LoopState(plan.engine) if state is None else state.copy()
        spread(lambda row, _: lines.scan(row, tip), bounds, 1, _counted(job))
    canvas.note({**plan.notes, "ringing_lines": int((~lines.calm).sum())})
    return tip


def _counted(job: Job) -> Progress | None:
    """Progress in lines of the whole image, of a part that begins at a line."""
    if job.progress is None:
        return None
    report, start, total = job.progress, job.place.row, job.place.image[0]
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


RESTLESS = "The feedback does not come to rest on a material with any gains tried: the tip may move irregularly there."
NOTES = {
    "proportional_gain": "proportional gain [1]",
    "integral_gain_per_second": "integral gain [1/s]",
    "gain_margin": "factor on both gains at which the loop rings [1]",
    "gains_lowered": "factor by which gains that were tuned are smaller, for the feedback to come to rest [1]",
    "restless_materials": "of the softest and the stiffest, those on which it does so with none of the gains tried [1]",
    "dwell_seconds": "time over a pixel [s]",
    "periods_per_pixel": "periods of the drive over a pixel [1]",
    "ringing_lines": "lines before which the feedback did not come to rest [1]",
}


SIMULATOR = Simulator(
    lambda job: MOST, _plan, _fill, _check, NOTES, freeze=lambda tip: {} if tip is None else tip.freeze(),
    thaw=lambda arrays: LoopState.thaw(arrays) if arrays else None,
)  # fmt: skip
