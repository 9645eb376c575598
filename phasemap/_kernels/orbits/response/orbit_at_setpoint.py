"""The exact orbit that holds the setpoint, by the lever's response, from an averaged one.

The setpoint is the amplitude A of that one, or an amplitude that the detector is to see.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels.columns import DYNAMIC_STIFFNESS, ErrorLimits
from phasemap._kernels.compilation import kernel
from phasemap._kernels.excitation import LEAST_SLOPE, detected_signal, next_amplitude
from phasemap._kernels.law import Oscillator, has_longrange
from phasemap._kernels.lever import beside_resonance, low_q, near_resonance, reach_of
from phasemap._kernels.lever_modes import higher_modes_forget, modes_of
from phasemap._kernels.orbits.averaged.sides import Maximum, fill_averaged_orbit_at_gap
from phasemap._kernels.orbits.harmonic_orbit import HarmonicOrbit, centre_height
from phasemap._kernels.orbits.response.nodes import MOST_PARTS, Nodes, cut_contact, parts_of
from phasemap._kernels.orbits.response.passes import FOUND, UNRESOLVED, by_newton, converge_passes, start_passes
from phasemap._kernels.orbits.response.stability import orbit_is_kept
from phasemap._kernels.orbits.response.state import PassState, evaluate_nodes
from phasemap._kernels.records import assign, clear, record

LEAST_SLOPE_ALONG = 0.05  # least dz0/dA of an exact attractive orbit near the jump
CLEAR_OF_FOLD = 0.4  # the same of an averaged one in a long contact, whose exact one has some 0.2 less
FAR_OFF = 0.1  # of the amplitude: an exact orbit farther from the averaged one may lie on another branch
SLOPE_STEP = 1e-3  # of the amplitude, for dz0/dA
SLOPE_ERROR = 1e-2  # of that: error of the tip offset
EXACTLY_SEEN = 1e-12  # of the amplitude seen
MOST_AMPLITUDE_SECANTS = 20
LEAST_SECANT = 1e-7  # of A: secants over less say nothing
FIRST_SECANT = 1e-5  # of A, where the first orbit is seen with the amplitude wanted: for slopes alone
FEW_PARTS = 2  # into which a contact is cut at most where Newton's method takes their cube: collocation is cheaper then
JUST_OFF, JUST_IN = 1e-6, 0.05  # in reaches: starts beside touching
GRAZING = 0.5  # in reaches: nearer than this to touching, both are tried


@record
class ResponseWorkspace:
    """Workspace of passes: nodes and states of an orbit, and the maximum of the mismatch."""

    nodes: Nodes
    finer: Nodes  # which cut the contact in two
    state: PassState
    other: PassState
    seen: float  # amplitude [m] that the detector is to see of an exact orbit, or 0 where A is that of the averaged one
    top: Maximum  # of the mismatch


@kernel
def largest_branch_distance(lever: np.ndarray, amplitude: float) -> float:
    """Largest distance [m] between exact and averaged orbit for both to count as on the same branch.

    With s = 1 - omega^2, P is up to 2 A |s| beside resonance, and the harmonics of a short contact, P/(n^2 - 1), lift
    the tip by 3/4 of it. Farther from the resonance that would be as far as to another branch.
    """
    if not near_resonance(lever):
        return FAR_OFF * amplitude
    return (FAR_OFF + 1.5 * abs(lever[DYNAMIC_STIFFNESS])) * amplitude


@kernel
def nodes_of_solution(workspace: ResponseWorkspace) -> Nodes:
    """Nodes that hold the orbit of `workspace.state`: those that cut its contact into as many parts."""
    return workspace.nodes if workspace.state.parts == parts_of(workspace.nodes) else workspace.finer


@kernel
def exact_orbit_at_amplitude(
    oscillator: Oscillator, harmonic: HarmonicOrbit, limits: ErrorLimits, workspace: ResponseWorkspace
) -> bool:
    """Exact orbit near the averaged one of `harmonic`, if the cheap path finds it within `limits` and it is sound."""
    e, reach = centre_height(harmonic), reach_of(oscillator.p)
    if _orbit_by_passes(oscillator, harmonic, e, limits, workspace):
        return True
    gap = e - harmonic.amplitude
    if not (has_longrange(oscillator.p) and abs(gap) <= GRAZING * reach):
        return False
    # The averaged orbit just touches and the exact one just does not, or the other way round.
    e = harmonic.amplitude + (JUST_OFF if gap < 0.0 else -JUST_IN) * reach
    return _orbit_by_passes(oscillator, harmonic, e, limits, workspace)


@kernel(shared=True)
def _orbit_by_passes(
    oscillator: Oscillator, harmonic: HarmonicOrbit, centre: float, limits: ErrorLimits, workspace: ResponseWorkspace
) -> bool:
    """Solve by passes from a harmonic orbit with this centre e, by which the tip touches or not; False if not found.

    Beside resonance, where contacts are long, passes go on at nodes that cut each contact in two.
    """
    lever, f, state = oscillator.lever, workspace.nodes, workspace.state
    clear(state)
    state.amplitude, state.centre, state.slope = harmonic.amplitude, centre, harmonic.mismatch_slope
    # Newton's method holds what is seen where contact repels; attraction outside follows from pass to pass.
    state.seen = workspace.seen if harmonic.push > 0.0 else 0.0
    if not start_passes(oscillator, f, state):
        return False
    state.parts = parts_of(f)
    outcome = converge_passes(oscillator, f, state, False, limits.phase, limits.tip_offset)
    other, cut = workspace.finer, beside_resonance(lever) or modes_of(lever) > 1
    most_parts = FEW_PARTS if modes_of(lever) == 1 or by_newton(lever, state) else MOST_PARTS
    while (
        outcome == UNRESOLVED
        and f.touches == 1
        and cut
        and not (parts_of(f) > 1 and state.last_ratio > 1.0)  # which lead away, as where the tip touches twice
        and 2 * parts_of(f) <= most_parts
    ):
        gap = centre_height(harmonic) - harmonic.amplitude
        if not fill_averaged_orbit_at_gap(oscillator, harmonic.amplitude, gap, HarmonicOrbit()) > CLEAR_OF_FOLD:
            return False  # a long contact that adhesion holds may be past a fold, which is for Newton's method to tell
        cut_contact(f, other)
        f, other = other, f
        state.parts = parts_of(f)
        evaluate_nodes(oscillator, f, state)
        outcome = converge_passes(oscillator, f, state, False, limits.phase, limits.tip_offset)
    if outcome != FOUND or not on_same_branch(lever, harmonic, state):
        return False
    if workspace.seen > 0.0:
        held = state.seen > 0.0 and f.touches == 1
        if not (held or _move_to_detected_setpoint(oscillator, f, workspace.seen, limits, state)):
            return False
        if not state.seen_by_a > LEAST_SLOPE:
            return False
    return orbit_is_kept(oscillator, f, state)


@kernel
def _move_to_detected_setpoint(
    oscillator: Oscillator, f: Nodes, seen: float, limits: ErrorLimits, state: PassState
) -> bool:
    """Move an orbit to where the detector sees its setpoint, an amplitude [m], by secants in A; fill in its slopes."""
    lever, before = oscillator.lever, (math.nan, math.nan)
    for _ in range(MOST_AMPLITUDE_SECANTS):
        amplitude, phase, offset = state.amplitude, state.phase, state.tip_offset
        miss = detected_signal(lever, amplitude, phase)[0] - seen
        if abs(miss) < EXACTLY_SEEN * seen and state.seen_by_a != 0.0:
            return True
        move = next_amplitude(lever, seen, amplitude, phase, miss, before) - amplitude
        if state.seen_by_a == 0.0 and abs(move) < FIRST_SECANT * amplitude:
            move = FIRST_SECANT * amplitude
        before = (amplitude, miss)
        state.amplitude += move
        state.centre += move
        if converge_passes(oscillator, f, state, False, limits.phase, limits.tip_offset) != FOUND:
            return False
        if abs(move) > LEAST_SECANT * amplitude:
            state.seen_by_a = (detected_signal(lever, state.amplitude, state.phase)[0] - seen - miss) / move
            state.phase_by_a, state.offset_by_a = (state.phase - phase) / move, (state.tip_offset - offset) / move
    return False


@kernel
def on_same_branch(lever: np.ndarray, harmonic: HarmonicOrbit, state: PassState) -> bool:
    """True if an exact orbit is on the branch of the averaged one."""
    same = (state.push > 0.0) == (harmonic.push > 0.0)
    if low_q(lever) and higher_modes_forget(lever):
        return same
    away = state.tip_offset - state.amplitude - harmonic.tip_offset + harmonic.amplitude
    return same and abs(away) < largest_branch_distance(lever, harmonic.amplitude)


@kernel
def slope_is_clear(oscillator: Oscillator, limits: ErrorLimits, workspace: ResponseWorkspace) -> bool:
    """True if the tip offset clearly rises with the amplitude along the exact orbits, at that of workspace.state."""
    f, here, beside = nodes_of_solution(workspace), workspace.state, workspace.other
    if workspace.seen > 0.0:
        return here.offset_by_a > LEAST_SLOPE_ALONG
    assign(beside, here)
    move = SLOPE_STEP * here.amplitude
    beside.amplitude += move
    beside.centre += move
    if converge_passes(oscillator, f, beside, False, limits.phase, min(limits.tip_offset, SLOPE_ERROR * move)) != FOUND:
        return False
    if not beside.tip_offset - here.tip_offset > LEAST_SLOPE_ALONG * move:
        return False
    found = converge_passes(oscillator, f, here, False, limits.phase, limits.tip_offset)  # back to where the nodes were
    return found == FOUND and orbit_is_kept(oscillator, f, here)
