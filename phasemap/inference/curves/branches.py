"""Stable branches of a sweep at the points of a measured axis, each continued beyond its ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phasemap._kernels import columns as col
from phasemap._shared.errors import InputError
from phasemap.experiment.lever import seen
from phasemap.inference.curves.data import Setup
from phasemap.solvers.continuation.complete import FAINT, complete
from phasemap.solvers.continuation.path import BEYOND, Question, Scale, fixed_path, swept_path
from phasemap.solvers.continuation.pieces import Curves
from phasemap.solvers.continuation.visit import segments
from phasemap.sweeps.follow import STARTS, begin
from phasemap.sweeps.in_time import there_and_back

NEARER = 4  # tip offsets between the nearest datum and half of the free amplitude
MARGIN = 1e-3  # of the range of tip offsets, by which a curve goes beyond


@dataclass(frozen=True, eq=False)
class Branches:
    """Stable branches, each continued at its ends as a constant."""

    amplitude: np.ndarray  # shape (branches, n) [m]
    phase: np.ndarray  # shape (branches, n) [degree]
    # shape (branches, n); how far the point is beyond the branch's end [units of the axis]; 0 on the branch
    gap: np.ndarray


def branches(setup: Setup, axis: str, values: np.ndarray) -> Branches:
    """The branches of a sweep over these values [Hz or m]."""
    try:
        return _of_frequency(setup, values) if axis == "frequency" else _of_distance(setup, values)
    except InputError:  # a law that cannot have this material
        return _nothing(values)


def _of_frequency(setup: Setup, frequencies: np.ndarray) -> Branches:
    from phasemap._kernels.continuation.path import ENTRY_M

    scale = Scale.over(frequencies)
    question = Question(setup.material, setup.scope)
    path = swept_path(question, "frequency", scale, lambda _: setup.height, False)
    x = scale.m(frequencies)
    curves = Curves(path, ENTRY_M, np.sort(np.concatenate([x, STARTS])), (-BEYOND, BEYOND, 0.0), 0)
    for m in STARTS:
        begin(curves, m, False)
    return _collect(curves, col.PARAMETER, x, np.ptp(frequencies) / 2)


def _of_distance(setup: Setup, tip_offsets: np.ndarray) -> Branches:
    from phasemap._kernels.continuation.path import ENTRY_Z0

    question = Question(setup.material, setup.scope)
    if question.only_in_time:
        return _of_passage(question, tip_offsets + setup.height)
    path = fixed_path(question)
    x = np.sort(tip_offsets + setup.height)
    beyond = MARGIN * (x[-1] - x[0])
    curves = Curves(path, ENTRY_Z0, x, (x[0] - beyond, np.inf, FAINT * setup.scope.driven_amplitude), 0)
    curves.from_far(x[-1] + beyond)
    complete(curves, x[0])
    return _collect(curves, col.TIP_OFFSET, tip_offsets + setup.height, 1.0)


def _of_passage(question: Question, tip_offsets: np.ndarray) -> Branches:
    """Branches on which a tip is that comes and goes in time: parts of its way on one side of the resonance.

    It comes nearer than the data, where it turns repulsive if it had not before, so that its way back is that branch.
    """
    nearest, half = float(tip_offsets.min()), 0.5 * question.scope.driven_amplitude
    nearer = np.linspace(half, nearest, NEARER if half < nearest else 0, endpoint=False)
    x, work, found = np.concatenate([nearer, np.sort(tip_offsets)]), question.work(marched=True), []
    for visit in there_and_back(work, x):
        rows = seen(visit.rows, np.broadcast_to(work.lever, (len(x), len(work.lever))))
        repelled = rows[:, col.STIFFENING] > 0
        for side in (repelled, ~repelled):
            there = np.flatnonzero(side & np.isfinite(rows[:, col.AMPLITUDE]))
            for part in np.split(there, 1 + np.flatnonzero(np.diff(there) > 1)) if len(there) else ():
                gap = np.maximum(0, np.maximum(x[part[0]] - tip_offsets, tip_offsets - x[part[-1]]))
                values = [np.interp(tip_offsets, x[part], rows[part, one]) for one in (col.AMPLITUDE, col.PHASE)]
                found.append((*values, gap))
    if not found:
        return _nothing(tip_offsets)
    amplitude, phase, gap = (np.stack(each) for each in zip(*found, strict=True))
    return Branches(amplitude, np.degrees(phase), gap)


def _nothing(values: np.ndarray) -> Branches:
    """No branch at all, as far away as the axis is long."""
    count = len(values)
    return Branches(np.zeros((1, count)), np.zeros((1, count)), np.full((1, count), float(np.ptp(values))))


def _collect(curves: Curves, column: int, x: np.ndarray, unit: float) -> Branches:
    """Values at x, which are rows of the curves, so that the interpolation between rows changes nothing."""
    parts = segments(curves.pieces, column)
    if not parts:  # nothing oscillates
        return _nothing(x * unit)
    read = [curves.seen(part.rows) for part in parts]
    amplitude, phase = (
        np.stack([np.interp(x, part.x, rows[:, column]) for part, rows in zip(parts, read, strict=True)])
        for column in (col.AMPLITUDE, col.PHASE)
    )
    gap = np.stack([np.maximum(0, np.maximum(part.x[0] - x, x - part.x[-1])) for part in parts])
    return Branches(amplitude, np.degrees(phase), gap * unit)
