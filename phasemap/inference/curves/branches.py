"""The stable orbits at every point of an axis, and how far each branch is from it where it has ended."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phasemap._kernels import columns as col
from phasemap.inference.curves.parameters import Setup
from phasemap.solvers.continuation.complete import FAINT
from phasemap.solvers.continuation.path import BEYOND, Question, Scale, fixed_path, swept_path
from phasemap.solvers.continuation.pieces import Curves
from phasemap.solvers.continuation.visit import segments
from phasemap.sweeps.follow import STARTS, begin

MARGIN = 1e-3  # of the range of tip offsets, by which a curve goes beyond


@dataclass(frozen=True, eq=False)
class Branches:
    """Stable branches, each continued at its ends as a constant."""

    amplitude: np.ndarray  # shape (branches, n) [m]
    phase: np.ndarray  # shape (branches, n) [degree]
    # shape (branches, n); how far the point is beyond the branch's end [units of the axis]; 0 on the branch
    gap: np.ndarray


def branches(setup: Setup, axis: str, values: np.ndarray) -> Branches:
    """The branches of a sweep.

    `values`: [Hz or m].
    """
    if axis == "frequency":
        return _of_frequency(setup, values)
    return _of_distance(setup, values)


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

    path = fixed_path(Question(setup.material, setup.scope))
    x = np.sort(tip_offsets + setup.height)
    beyond = MARGIN * (x[-1] - x[0])
    curves = Curves(path, ENTRY_Z0, x, (x[0] - beyond, np.inf, FAINT * setup.scope.driven_amplitude), 0)
    curves.from_far(x[-1] + beyond)
    return _collect(curves, col.TIP_OFFSET, tip_offsets + setup.height, 1.0)


def _collect(curves: Curves, column: int, x: np.ndarray, unit: float) -> Branches:
    """Values at x, which are rows of the curves, so that the interpolation between rows changes nothing."""
    parts = segments(curves.pieces, column)
    if not parts:  # nothing oscillates
        return Branches(np.zeros((1, len(x))), np.zeros((1, len(x))), np.full((1, len(x)), np.ptp(x) * unit))
    seen = [curves.seen(part.rows) for part in parts]
    amplitude, phase = (
        np.stack([np.interp(x, part.x, rows[:, column]) for part, rows in zip(parts, seen, strict=True)])
        for column in (col.AMPLITUDE, col.PHASE)
    )
    gap = np.stack([np.maximum(0, np.maximum(part.x[0] - x, x - part.x[-1])) for part in parts])
    return Branches(amplitude, np.degrees(phase), gap * unit)
