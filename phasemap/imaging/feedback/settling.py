"""Tuned gains, tried: the linear loop does not know what a tip does that is thrown out of contact."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.scanning.line import engage_in_time
from phasemap._kernels.scanning.loop import Setup
from phasemap.experiment.control import Feedback
from phasemap.imaging.feedback.harmonics import lifts_of
from phasemap.imaging.feedback.lines import ENGAGED, TipState
from phasemap.imaging.feedback.loop import loop_of
from phasemap.imaging.imperfections import generator
from phasemap.imaging.job import Job
from phasemap.solvers.problem import Work
from phasemap.solvers.run import run
from phasemap.solvers.solver import by_name

NUDGE = 0.02  # of the setpoint amplitude, by which the tip is too near when it is let go
HALVINGS = 6


def quietened(control: Feedback, job: Job, work: Work, engine: int) -> Feedback:
    """Halve the gains until the feedback comes to rest on the softest and the stiffest material, as an operator does.

    Gains that never are quiet are those halved six times.
    """
    valid = np.flatnonzero(work.refused() == col.GOOD)
    if not len(valid):
        return control
    stiffness = work.rows[valid, col.CONTACT]
    some = np.unique(valid[[stiffness.argmin(), stiffness.argmax()]])
    work = work.part(some)
    orbits, status, _ = run(by_name("auto"), work, ENGAGED, threads=job.workers)
    rows = lifts_of(job, work).beside(work.rows) if engine == col.AVERAGING else work.rows
    held = np.flatnonzero(status == col.GOOD)
    for _ in range(HALVINGS):
        if all(_is_quiet(control, job, work, engine, rows[i], orbits[i]) for i in held):
            break
        gains = {name: 0.5 * getattr(control, name) for name in ("proportional_gain", "integral_gain")}
        control = replace(control, **gains)
    return control


def _is_quiet(control: Feedback, job: Job, work: Work, engine: int, row: np.ndarray, orbit: np.ndarray) -> bool:
    """Whether the feedback comes to rest after a nudge."""
    loop, nudged = loop_of(control, job.scope, job.amplitude), orbit.copy()
    loop.lowest, loop.highest = -np.inf, np.inf
    nudged[col.TIP_OFFSET] -= NUDGE * job.amplitude
    setup = Setup(work.law, work.lever, loop, generator(0, "unused: without noise"))
    done = engage_in_time(setup, row, 0.0, nudged, TipState(engine).state)
    return bool(done == col.GOOD and loop.settled)
