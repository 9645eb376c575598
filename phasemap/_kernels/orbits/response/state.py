"""State of an orbit between passes, and the result row that it makes."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.columns import DYNAMIC_LOSS, STIFFNESS
from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever import mismatch
from phasemap._kernels.lever_modes import static_compliance
from phasemap._kernels.orbits.response.apex import apex_of
from phasemap._kernels.orbits.response.nodes import Nodes, fill_force
from phasemap._kernels.records import record

LARGEST_CLOSURE = 5e-7  # energy closure, over the energy in, of an orbit by passes


class Along(NamedTuple):
    """Derivatives by the amplitude A along the curve of orbits."""

    seen: float  # amplitude that the detector sees [1]
    phase: float  # [rad/m]
    offset: float  # tip offset [1]


@record
class PassState:
    """An orbit from pass to pass: what holds it, what its nodes give, the result and its errors, the last changes."""

    amplitude: float  # of the first harmonic [m]
    centre: float  # e: height of the middle of the oscillation over the surface, z0 less the mean deflection [m]
    slope: float  # change of the mismatch with e [1/m]
    mean_force: float  # over stiffness [m]
    push: float  # P [m]
    drag: float  # S [m]
    work: float  # of the conservative force over a period, over stiffness [m2]
    loss: float  # of damping over a period, over stiffness [m2]
    virial: float  # integral of g z over a period [m2]
    phase: float  # [rad]
    tip_offset: float  # [m]
    phase_error: float  # [rad]
    tip_offset_error: float  # [m]
    passes: int
    parts: int  # elements in contact, 0 where the orbit is not at the nodes
    last_w: float  # w in the middle of the contact, after the last pass [m]
    phase_change: float  # by the last pass [rad]
    tip_offset_change: float  # [m]
    last_ratio: float  # of the changes of the pass before
    closure: float  # relative energy closure after the pass before
    slow: int  # passes that contracted slowly
    mean_slope: float  # change of `mean_force`, `push` and `drag` with e [1]
    push_slope: float
    drag_slope: float
    move: float  # of e, to where no mismatch is left [m]
    lacks: float  # what P and e lack to there [m]
    seen: float  # amplitude [m] that the detector is to see and that holds the orbit, or 0 where A does
    # Along the curve of orbits, where `seen` holds them: change with A of the amplitude seen [1], phase [rad/m] and tip
    # offset [1].
    seen_by_a: float
    phase_by_a: float
    offset_by_a: float


@kernel(fastmath=ANY_ORDER)
def evaluate_nodes(oscillator: Oscillator, nodes: Nodes, state: PassState) -> float:
    """Fill the state from the force at the nodes; returns the mismatch of the drive."""
    lever = oscillator.lever
    amplitude = state.amplitude
    mean, push, drag, work, loss, virial = fill_force(oscillator, nodes, amplitude, state.centre)
    state.mean_force, state.push, state.drag = mean, push, drag
    state.work, state.loss, state.virial = work, loss, virial
    return mismatch(lever, amplitude, push, drag)


@kernel
def slope_by_tip_offset(lever: np.ndarray, state: PassState) -> float:
    """Change of the mismatch with the tip offset [1/m]."""
    return state.slope / (1.0 - static_compliance(lever) * state.mean_slope)


@kernel
def energy_closure_of_passes(lever: np.ndarray, state: PassState) -> float:
    """Work of the conservative part of the force over the energy supplied: zero on an exact orbit."""
    amplitude = state.amplitude
    return state.work / (math.pi * amplitude * (lever[DYNAMIC_LOSS] * amplitude - state.drag))


@kernel
def slopes_of(state: PassState) -> Along:
    """Derivatives by A along the curve, where `seen` holds the orbit."""
    return Along(state.seen_by_a, state.phase_by_a, state.offset_by_a)


@kernel
def fill_row_from_passes(lever: np.ndarray, nodes: Nodes, state: PassState, row: np.ndarray) -> None:
    """Fill a result row from a converged orbit."""
    amplitude, stiffness = state.amplitude, lever[STIFFNESS]
    move = state.move
    mean = -static_compliance(lever) * (state.mean_force + move * state.mean_slope)
    push = state.push + move * state.push_slope
    row[:] = math.nan
    row[col.TIP_OFFSET], row[col.MEAN] = state.tip_offset, mean
    row[col.PHASE], row[col.AMPLITUDE] = state.phase, amplitude
    row[col.INDENTATION] = apex_of(nodes, amplitude) - state.centre
    row[col.DISSIPATION] = stiffness * state.loss
    row[col.VIRIAL] = -stiffness * (state.virial / (2 * math.pi) + state.mean_force * mean)
    row[col.STIFFENING] = push / amplitude
    row[col.CLOSURE] = energy_closure_of_passes(lever, state)
    row[col.ERROR_PHASE], row[col.ERROR_HEIGHT] = state.phase_error, state.tip_offset_error
