"""The nodes of an orbit whose result row is known: passes of the lever's response from its amplitude, e and depth.

A harmonic orbit as deep as the exact one meets nearly its force, so that in air one or two passes give the motion to
some 10^-4 of the depth. What says so is the depth, and the mean of the force and its P, which the row knows by
deflection and phase. Where the drive is not faint passes contract slowly, and these do not say enough.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.columns import DRIVE, DYNAMIC_STIFFNESS, LONGRANGE
from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever import reach_of
from phasemap._kernels.orbits.kept import FAINT_DRIVE
from phasemap._kernels.orbits.response.apex import apex_between
from phasemap._kernels.orbits.response.motion import respond
from phasemap._kernels.orbits.response.nodes import (
    ALL,
    ENTRY,
    EXIT,
    GAUSS_WEIGHTS,
    IN,
    OUT,
    TOUCH,
    N,
    Nodes,
    move_nodes,
)
from phasemap._kernels.orbits.response.passes import PassState, evaluate_nodes, start_passes

RETRACING_PASSES = 2  # where more were needed they contract slowly
FORCE_ALIKE = 3e-4  # of the mean size of the force: what its mean and P may differ from the row's by
MOST_FORCE_CHANGE = 0.2  # change of the first force
AS_DEEP = 5e-4  # of the depth, or without contact of the distance to the pole of the long-range force


@kernel(fastmath=ANY_ORDER)
def _strength(f: Nodes) -> float:
    """Mean of |g| over a period [m]."""
    total = 0.0
    for first in range(0, 3 * N, N):
        for j in range(N):
            total += GAUSS_WEIGHTS[j] * f.weight[first + j] * abs(f.g[first + j])
    return total / (2.0 * math.pi)


@kernel(fastmath=ANY_ORDER)
def _press(f: Nodes, state: PassState, push: float) -> None:
    """Make the force in contact so much larger or smaller that P is the one given."""
    mean, pressed, drag = 0.0, 0.0, 0.0
    for j in range(N):
        share = GAUSS_WEIGHTS[j] * f.weight[TOUCH + j] * f.g[TOUCH + j] / math.pi
        mean += 0.5 * share
        pressed += share * f.cos[TOUCH + j]
        drag += share * f.sin[TOUCH + j]
    more = (push - state.push) / pressed
    if not abs(more) < MOST_FORCE_CHANGE:
        return
    for j in range(N):
        f.g[TOUCH + j] *= 1.0 + more
    state.mean_force, state.push, state.drag = state.mean_force + more * mean, push, state.drag + more * drag


@kernel
def _apex(f: Nodes, amplitude: float, touching: bool) -> float:
    """Where the tip turns [m]: in contact or, without one, where the elements before and after it meet."""
    theta, w, u = f.theta, f.w, f.u
    i, j = IN, OUT
    if touching:
        j = TOUCH + 1
        while j < TOUCH + N - 1 and u[j] > amplitude * f.sin[j]:
            j += 1
        i = j - 1
    return apex_between(amplitude, theta[i], w[i], u[i], theta[j], w[j], u[j])[0]


@kernel
def retrace(oscillator: Oscillator, row: np.ndarray, f: Nodes, state: PassState) -> bool:
    """Fill the nodes with the orbit of a result row of the tip, without necks; False if it is beyond a few passes."""
    law, p, lever = oscillator
    amplitude, e, longrange = row[col.AMPLITUDE], row[col.TIP_OFFSET] - row[col.MEAN], p[LONGRANGE] != 0.0
    state.amplitude, state.centre = amplitude, amplitude - row[col.INDENTATION]
    for j in range(ALL):
        f.g[j] = 0.0
    reach, depth = reach_of(law, p), row[col.INDENTATION]
    if not (lever[DRIVE] < FAINT_DRIVE * amplitude and math.isfinite(e) and start_passes(oscillator, reach, f, state)):
        return False
    near = AS_DEEP * (depth if depth > 0.0 else reach - depth)
    state.centre, touching = e, f.theta[EXIT] > f.theta[ENTRY]
    mean, push = -row[col.MEAN], lever[DRIVE] * math.sin(row[col.PHASE]) - amplitude * lever[DYNAMIC_STIFFNESS]
    if touching:
        _press(f, state, push)
    for _ in range(RETRACING_PASSES):
        respond(f, lever, state.mean_force, state.push, state.drag, touching, longrange)
        move_nodes(f, amplitude, e, touching, longrange)
        if touching and not f.theta[EXIT] > f.theta[ENTRY]:
            return False
        evaluate_nodes(oscillator, f, state, touching)
        if not abs(_apex(f, amplitude, touching) - e - depth) < near:
            continue
        if max(abs(state.mean_force - mean), abs(state.push - push)) < FORCE_ALIKE * _strength(f):
            return True
    return False
