"""Exact orbits by passes of the lever's response (`nodes`)."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels.columns import DRIVE
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator, has_longrange
from phasemap._kernels.lever import beside_resonance, low_q, mismatch, phase_of, reach_of
from phasemap._kernels.lever_modes import higher_modes_forget, modes_of, static_compliance
from phasemap._kernels.numerics import copy
from phasemap._kernels.orbits.response.errors import (
    PASS_SAFETY,
    estimate_pass_errors,
    quadrature_error,
    remaining_change_ratio,
    tip_offset_error_factor,
)
from phasemap._kernels.orbits.response.motion import fill_response
from phasemap._kernels.orbits.response.newton_pass import cut_short, new_newton_workspace, newton_pass
from phasemap._kernels.orbits.response.nodes import (
    ENTRY,
    EXIT,
    MOST_PARTS,
    OUT,
    Nodes,
    clear_motion,
    grade_outer_nodes,
    lay_nodes,
    middle_of,
    move_nodes,
    parts_needed,
)
from phasemap._kernels.orbits.response.state import (
    LARGEST_CLOSURE,
    PassState,
    energy_closure_of_passes,
    evaluate_nodes,
)

NO_ORBIT = 0  # how passes end
FOUND = 1
UNRESOLVED = 2  # an orbit, but the nodes do not resolve it well enough
GO_ON = 3
MOST_PASSES = 24
MOST_MOVES = 4  # of e within a pass
SLOPE_CHANGES = 3.0  # times, by which a slope along a move may be another than the one known: else it says nothing
NO_PHASE, NO_LENGTH = 1e-12, 1e-18  # [rad, m], changes that are rounding
SAME_CLOSURE = 0.1  # of it: a change as small is none
SLOW_RATIO = 0.7  # of the change by a pass over that before, above which passes contract slowly
MOST_SLOW = 4  # such passes
LIFT_LEFT = 0.05  # of the mismatch that the lift by a pass would make may be left: it is taken off to first order
LEAST_EDGE_COSINE = -0.98  # cosine of the contact's edge below which the nodes do not do


@kernel
def passes_contract_slowly(lever: np.ndarray) -> bool:
    """True if passes leave much of the error, or do not converge at all, by the response to the contact force.

    Where a higher mode remembers the tap before, there may be several orbits: only passes that converge tell which.
    """
    return beside_resonance(lever) or (low_q(lever) and higher_modes_forget(lever))


@kernel
def by_newton(lever: np.ndarray, state: PassState) -> bool:
    """True if Newton's method takes the place of passes in contact."""
    return passes_contract_slowly(lever) or state.seen > 0.0


@kernel
def start_passes(oscillator: Oscillator, nodes: Nodes, state: PassState) -> bool:
    """Lay the nodes of the harmonic orbit with the state's amplitude and centre e; False if it is out of range."""
    p, lever, amplitude, e = oscillator.p, oscillator.lever, state.amplitude, state.centre
    c = e / amplitude
    if c < LEAST_EDGE_COSINE or (c >= 1.0 and not has_longrange(p)):
        return False
    edge = math.acos(c) if c < 1.0 else 0.0
    nodes.touches, nodes.outside = 1 if c < 1.0 else 0, 1 if has_longrange(p) else 0
    if modes_of(lever) > 1:
        nodes.parts = parts_needed(oscillator, edge, amplitude - e)
        if nodes.parts > MOST_PARTS:
            return False
    if nodes.outside == 1:
        grade_outer_nodes(nodes, amplitude, e, reach_of(p), edge)
    lay_nodes(nodes, -edge, edge)
    clear_motion(nodes)
    evaluate_nodes(oscillator, nodes, state)
    return True


@kernel
def balance_drive(oscillator: Oscillator, nodes: Nodes, state: PassState, lift: float) -> float:
    """Move the centre e until the drive needed is that given, at fixed w; returns the mismatch left.

    The tip that w lifts by so much [m] is first lowered by as much, which leaves its depth and nearly its force.
    """
    amplitude, hold = state.amplitude, math.isnan(lift)
    if not hold:
        state.centre += lift
    move_nodes(nodes, amplitude, state.centre)
    h = evaluate_nodes(oscillator, nodes, state)
    if hold:
        return h
    for _ in range(MOST_MOVES):
        if abs(h) < LIFT_LEFT * abs(lift * state.slope) and state.push_slope != 0.0:
            break
        before = (h, state.mean_force, state.push, state.drag)
        move = -h / state.slope
        state.centre += move
        move_nodes(nodes, amplitude, state.centre)
        h = evaluate_nodes(oscillator, nodes, state)
        update_slopes(state, move, h, before)
    return h


@kernel
def update_slopes(state: PassState, move: float, h: float, before: tuple[float, float, float, float]) -> None:
    """Update the derivatives of mismatch, mean force, P and S by the centre e, from one move of e."""
    h_before, mean, push, drag = before
    if 1.0 / SLOPE_CHANGES < (h - h_before) / move / state.slope < SLOPE_CHANGES:
        state.slope, state.mean_slope = (h - h_before) / move, (state.mean_force - mean) / move
        state.push_slope, state.drag_slope = (state.push - push) / move, (state.drag - drag) / move


@kernel
def first_pass(lever: np.ndarray, state: PassState) -> None:
    """Forget the changes of earlier passes; before any, note phase and tip offset of the harmonic orbit."""
    state.phase = state.tip_offset = state.last_w = math.nan
    state.phase_change = state.tip_offset_change = math.nan
    state.lacks, state.last_ratio, state.closure, state.slow = 0.0, 1.0, math.inf, 0
    if state.passes == 0:
        state.phase, state.last_w = phase_of(lever, state.amplitude, state.push, state.drag), 0.0
        state.tip_offset = state.centre - static_compliance(lever) * state.mean_force


@kernel
def after_pass(lever: np.ndarray, state: PassState, h: float, w: float, nodes: float) -> float:
    """Fill in phase and tip offset after a pass, and the errors that are left.

    `h`: mismatch left; `w`: deflection beyond the first harmonic where the tip is nearest [m]; `nodes`: error by the
    nodes [m]. The errors are taken from the last two changes as if they went on like a geometric series, many times
    over: theory, Eq. (errors-1). Returns the ratio of the changes, NaN before there are two.
    """
    move = state.move = -h / state.slope
    push, drag = state.push + move * state.push_slope, state.drag + move * state.drag_slope
    phase, height = (
        phase_of(lever, state.amplitude, push, drag),
        state.centre + move - static_compliance(lever) * (state.mean_force + move * state.mean_slope),
    )
    # What is taken off to first order may be wrong by as much, and the next w is that of a force that lacks it.
    lacks, taken_off = state.lacks, abs(phase - phase_of(lever, state.amplitude, state.push, state.drag))
    state.lacks = abs(move) + abs(move * state.push_slope) if state.push_slope != 0.0 else 0.0
    phase_last, height_last = state.phase_change, state.tip_offset_change
    phase_change = abs(phase - state.phase)
    height_change = max(abs(height - state.tip_offset), abs(w - state.last_w))
    state.phase, state.tip_offset, state.last_w = phase, height, w
    state.phase_change, state.tip_offset_change = phase_change, height_change
    ratio = max(phase_change / max(phase_last, NO_PHASE), height_change / max(height_last, NO_LENGTH))
    if ratio >= 0.0:
        rest = remaining_change_ratio(ratio, state.last_ratio)
        phase_left, height_left = max(phase_change, rest * phase_last), max(height_change, rest * height_last)
        phase_left *= max(1.0, lacks / max(height_left, NO_LENGTH))
        estimate_pass_errors(lever, state, rest, phase_left, height_left, nodes)
        state.phase_error += taken_off
        state.tip_offset_error += lacks + state.lacks
        state.last_ratio = ratio
    return ratio


@kernel
def outcome_of_pass(
    lever: np.ndarray, state: PassState, nodes: float, newton: bool, hold: bool, early: bool, limit_phase: float,
    limit_height: float,
) -> int:  # fmt: skip
    """FOUND, UNRESOLVED or NO_ORBIT after a pass with estimated errors, or GO_ON; an `early` pass is not given up.

    `nodes`: error of P, S and mean deflection from the finite number of nodes [m].
    """
    closure = 0.0 if hold else energy_closure_of_passes(lever, state)
    small = state.phase_error < limit_phase and state.tip_offset_error < limit_height
    if small and abs(closure) < LARGEST_CLOSURE:
        return FOUND
    if early:
        return GO_ON
    closure_before, state.closure = state.closure, closure
    state.slow += 1 if state.last_ratio > SLOW_RATIO else 0
    change = abs(closure - closure_before)
    stays = change < 0.5 * abs(closure) if newton else abs(closure) > 0.5 * abs(closure_before)
    rough = nodes > limit_phase * lever[DRIVE]
    rough = rough or (newton and nodes * tip_offset_error_factor(lever, state) > limit_height)
    phase_left, height_left = PASS_SAFETY * state.phase_change, PASS_SAFETY * state.tip_offset_change
    done = phase_left < limit_phase and height_left < limit_height
    if rough or (small and stays) or (newton and done and change < SAME_CLOSURE * abs(closure)):
        return UNRESOLVED
    return NO_ORBIT if state.slow > MOST_SLOW else GO_ON


@kernel(shared=True)
def converge_passes(
    oscillator: Oscillator, f: Nodes, state: PassState, hold: bool, limit_phase: float, limit_height: float
) -> int:
    """Repeat passes until errors are below the limits: FOUND, NO_ORBIT or UNRESOLVED; with `hold`, e and A stay.

    Beside resonance forces are |1 - omega^2|/(2 alpha0 omega) times what losses take: there energy is balanced last,
    and passes in contact contract slowly, as they do at low Q. Newton's method takes their place.
    """
    lever, nearest = oscillator.lever, middle_of(f) if f.touches == 1 else OUT
    newton = f.touches == 1 and by_newton(lever, state)
    harmonic, h = state.passes == 0, mismatch(lever, state.amplitude, state.push, state.drag)
    workspace = new_newton_workspace(f, newton)
    first_pass(lever, state)
    for passes in range(MOST_PASSES):
        before = f.w[nearest]
        if newton:
            copy(f.w, workspace.w)
            copy(f.u, workspace.u)
        if newton and not (harmonic and passes == 0):
            good, h = newton_pass(oscillator, f, state, h, hold, workspace)
            if not good:
                return NO_ORBIT
        else:
            fill_response(f, lever, state.mean_force, state.push, state.drag)
            lift = f.w[nearest] - before
            if newton:
                lift *= cut_short(f, state, lift, 0.0, workspace)
            h = balance_drive(oscillator, f, state, math.nan if hold else lift)
        state.passes += 1
        nodes = quadrature_error(lever, f, state)
        ratio = after_pass(lever, state, h, f.w[nearest], nodes)
        if not (math.isfinite(state.phase + state.tip_offset) and f.theta[EXIT] >= f.theta[ENTRY]):
            return NO_ORBIT
        if ratio >= 0.0:
            early = harmonic and passes == 1
            outcome = outcome_of_pass(lever, state, nodes, newton, hold, early, limit_phase, limit_height)
            if outcome != GO_ON:
                return outcome
    return NO_ORBIT
