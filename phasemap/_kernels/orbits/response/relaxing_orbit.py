"""Exact orbits over a solid that relaxes, by passes of the lever's response, where one tap leaves the next no dent."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.columns import ALPHA0, OMEGA, ErrorLimits
from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.law import Oscillator, has_longrange
from phasemap._kernels.lever import mismatch, modes_of, reach_of
from phasemap._kernels.orbits.harmonic_orbit import HarmonicOrbit, centre_height
from phasemap._kernels.orbits.response.apex import apex_between
from phasemap._kernels.orbits.response.motion import respond
from phasemap._kernels.orbits.response.nodes import (
    ENTRY,
    EXIT,
    GAUSS_WEIGHTS,
    GAUSS_X,
    HIGHEST,
    LATE,
    TOUCH,
    N,
    Nodes,
    clear_motion,
    counts,
    first_of_element,
    grade_outer_nodes,
)
from phasemap._kernels.orbits.response.orbit import on_same_branch
from phasemap._kernels.orbits.response.passes import (
    FOUND,
    GO_ON,
    LEAST_EDGE_COSINE,
    LIFT_LEFT,
    MOST_MOVES,
    MOST_PASSES,
    NO_ORBIT,
    after_pass,
    converge,
    first_pass,
    outcome_of_pass,
    quadrature_error,
    start_passes,
    update_slopes,
)
from phasemap._kernels.orbits.response.relaxing_contact import (
    END_NODE,
    ContactMemory,
    TapWorkspace,
    dent_of,
    follow_contact,
    lay_relaxing,
    look_back,
    relaxing_force,
    relay_relaxing,
)
from phasemap._kernels.orbits.response.stability import orbit_is_kept
from phasemap._kernels.orbits.response.state import PassState
from phasemap._kernels.records import clear

DENT_LEFT = 1e-15  # [m] of dents that a tap may meet
THINNEST = 40.0  # relaxation times before the turn that the nodes may have to resolve
AIR_HARMONICS = 32  # fewer than these are summed
UNFOLLOWED = 0.3  # of what the nodes may miss of D, that is taken for missed
MOST_ENDS = 6  # steps to the end of the harmonic orbit's contact
MOST_LOOK_BACKS = 5  # steps to the early angles
END_TOLERANCE = 1e-6  # of the contact, error of its end
AMPLITUDE_STEP = 1e-3  # of the depth, a step of the amplitude
UNDAMPED = 0.5  # of what air takes more at a larger amplitude, that a tap may take less there
LEAST_LATE_SHARE = 0.3  # least share of the contact's later half that a step leaves of it


@kernel
def evaluate_relaxing(oscillator: Oscillator, workspace: TapWorkspace) -> float:
    """Fill the state from the force at the nodes; returns the mismatch of the drive."""
    p, lever = oscillator.p, oscillator.lever
    state = workspace.state
    follow_contact(p, lever, workspace)
    look_back(p, lever, workspace)
    mean, push, drag, work, virial = relaxing_force(oscillator, workspace)
    state.mean_force, state.push, state.drag, state.loss, state.virial = mean, push, drag, work, virial
    return mismatch(lever, state.amplitude, push, drag)


@kernel
def start_relaxing(oscillator: Oscillator, workspace: TapWorkspace) -> bool:
    """Lay the harmonic orbit with the amplitude and e of the state; False if it is out of this method's range."""
    p, lever = oscillator.p, oscillator.lever
    f, m, state = workspace
    amplitude, e, time, kappa = state.amplitude, state.centre, lever[OMEGA] * p[col.RELAXATION], p[col.RELAXING]
    if not LEAST_EDGE_COSINE < e / amplitude < 1.0:
        return False
    edge = math.acos(e / amplitude)
    f.touches, f.outside = 1, 1 if has_longrange(p) else 0
    if edge > THINNEST * time:
        return False
    if f.outside == 1:
        grade_outer_nodes(f, amplitude, e, reach_of(p), edge)
    clear_motion(f)
    exit_ = edge
    for _ in range(MOST_ENDS):
        lay_relaxing(f, -edge, 0.0, exit_)
        follow_contact(p, lever, workspace)
        d, crept = m.depth[END_NODE], m.dashpot_depth[END_NODE]
        move = (d - kappa * crept) / (amplitude * f.sin[EXIT] + kappa * (d - crept) / time)
        exit_ = min(max(exit_ + move, LEAST_LATE_SHARE * exit_), edge)
        if abs(move) < END_TOLERANCE * edge:
            break
    for j in range(N):
        m.place[N + j] = 1.0 - GAUSS_X[j]
    for _ in range(MOST_LOOK_BACKS):
        look_back(p, lever, workspace)
    evaluate_relaxing(oscillator, workspace)
    return True


@kernel
def balance_relaxing(oscillator: Oscillator, workspace: TapWorkspace, lift: float) -> float:
    """Move the centre e until the drive needed is that given, at fixed w, as passes without memory do."""
    p, lever = oscillator.p, oscillator.lever
    state = workspace.state
    state.centre += lift
    relay_relaxing(p, lever, workspace)
    h = evaluate_relaxing(oscillator, workspace)
    for _ in range(MOST_MOVES):
        if abs(h) < LIFT_LEFT * abs(lift * state.slope) and state.push_slope != 0.0:
            break
        before = (h, state.mean_force, state.push, state.drag)
        move = -h / state.slope
        state.centre += move
        relay_relaxing(p, lever, workspace)
        h = evaluate_relaxing(oscillator, workspace)
        update_slopes(state, move, h, before)
    return h


@kernel
def relaxation_quadrature_error(p: np.ndarray, nodes: Nodes, memory: ContactMemory) -> float:
    """Estimated error of P and S [m] from the finite number of nodes for the delayed depth D.

    That of D is some sixtieth of what their highest polynomials find, where the contact lasts for 1 to 50 relaxation
    times, and that of P and S a tenth of this share of the force in contact.
    """
    even, odd, size = 0.0, 0.0, 0.0
    for j in range(N):
        behind = memory.depth[j] - memory.dashpot_depth[j]
        even += HIGHEST[0, j] * behind
        odd += HIGHEST[1, j] * behind
        size += GAUSS_WEIGHTS[j] * nodes.weight[TOUCH + j] * abs(nodes.g[TOUCH + j])
    return UNFOLLOWED * p[col.RELAXING] * (abs(even) + abs(odd)) / memory.depth[N - 1] * size


@kernel
def converge_relaxing(oscillator: Oscillator, limits: ErrorLimits, workspace: TapWorkspace) -> int:
    """Repeat passes from a harmonic orbit that touches until errors are below the limits, as `converge` does."""
    p, lever = oscillator.p, oscillator.lever
    f, m, state = workspace
    first_pass(lever, state)
    for passes in range(MOST_PASSES):
        before = f.w[LATE]
        respond(f, lever, state.mean_force, state.push, state.drag)
        h = balance_relaxing(oscillator, workspace, f.w[LATE] - before)
        state.passes += 1
        nodes = quadrature_error(lever, f, state) + relaxation_quadrature_error(p, f, m)
        ratio = after_pass(lever, state, h, f.w[LATE], nodes)
        if not (math.isfinite(state.phase + state.tip_offset) and f.theta[EXIT] > f.theta[ENTRY]):
            return NO_ORBIT
        if ratio >= 0.0:
            outcome = outcome_of_pass(lever, state, nodes, False, True, passes == 1, limits.phase, limits.tip_offset)
            if outcome != GO_ON:
                return outcome
    return NO_ORBIT


@kernel
def taps_once(workspace: TapWorkspace, dent: float, recovery: float) -> bool:
    """Whether depth and edge grow up to the turn, and nothing that the next taps meet is left of the dents of all."""
    f, m, _ = workspace
    for j in range(N):
        if not (m.rate[j] > 0.0 and 0.0 <= m.place[N + j] <= 1.0):
            return False
        if j > 0 and not m.place[N + j] < m.place[N + j - 1]:
            return False
    apart = 2.0 * math.pi - (f.theta[EXIT] - f.theta[ENTRY])
    return dent * math.exp(-apart * recovery) < DENT_LEFT * -math.expm1(-2.0 * math.pi * recovery)


@kernel(fastmath=ANY_ORDER)
def energy_defect(lever: np.ndarray, nodes: Nodes, state: PassState) -> float:
    """Energy supplied less energy lost per period, over stiffness, with air damping of the higher harmonics."""
    amplitude, omega, alpha0 = state.amplitude, lever[OMEGA], lever[ALPHA0]
    left, at = -math.pi * amplitude * state.drag - state.loss, np.zeros((3, 4 * N))
    share, cosine, sine = at[0], at[1], at[2]  # of exp(i n theta)
    for part in range(4):
        first = first_of_element(part)
        for j in range(N if counts(nodes, part) else 0):
            i, k = first + j, N * part + j
            share[k] = GAUSS_WEIGHTS[j] * nodes.weight[i] * nodes.g[i] / math.pi
            cosine[k], sine[k] = nodes.cos[i], nodes.sin[i]
    for n in range(2, AIR_HARMONICS):
        re, im = 0.0, 0.0
        for k in range(4 * N):
            i = k if k < 3 * N else LATE + k - 3 * N
            c = cosine[k] * nodes.cos[i] - sine[k] * nodes.sin[i]
            sine[k] = sine[k] * nodes.cos[i] + cosine[k] * nodes.sin[i]
            cosine[k] = c
            re += share[k] * c
            im += share[k] * sine[k]
        stiff, air = 1.0 - (n * omega) ** 2, 2.0 * alpha0 * n * omega
        left -= air * n * math.pi * (re * re + im * im) / (stiff * stiff + air * air)
    return left


@kernel
def slow_flow_is_stable(oscillator: Oscillator, workspace: TapWorkspace) -> bool:
    """True if disturbances of amplitude and phase decay in the slow flow: theory, Eq. (memory-11).

    What a tap takes may fall with the amplitude, by more than what air takes rises. Leaves the state as it was, and the
    nodes at a larger amplitude.
    """
    p, lever = oscillator.p, oscillator.lever
    f, m, state = workspace
    loss, mean, push, drag, virial = state.loss, state.mean_force, state.push, state.drag, state.virial
    amplitude, e, step = state.amplitude, state.centre, AMPLITUDE_STEP * m.depth[N - 1]
    state.amplitude += step
    relay_relaxing(p, lever, workspace)
    evaluate_relaxing(oscillator, workspace)
    respond(f, lever, state.mean_force, state.push, state.drag)
    state.centre = e - mean + state.mean_force
    relay_relaxing(p, lever, workspace)
    evaluate_relaxing(oscillator, workspace)
    more = (state.loss - loss) / step
    state.amplitude, state.centre = amplitude, e
    state.loss, state.mean_force, state.push, state.drag, state.virial = loss, mean, push, drag, virial
    return more > -UNDAMPED * 4.0 * math.pi * lever[col.ALPHA0] * lever[OMEGA] * amplitude


@kernel
def refine_relaxing(
    oscillator: Oscillator, harmonic: HarmonicOrbit, limits: ErrorLimits, workspace: TapWorkspace
) -> bool:
    """Exact orbit near the averaged one of `harmonic`, if passes find it within `limits` and it is sound.

    One that does not touch has nothing to remember. A lever of several modes is left to others.
    """
    p, lever = oscillator.p, oscillator.lever
    f, m, state = workspace
    e = centre_height(harmonic)
    if modes_of(lever) > 1:
        return False
    clear(state)
    f.parts, state.parts = 2, 2
    state.amplitude, state.centre, state.slope = harmonic.amplitude, e, harmonic.mismatch_slope
    if e >= state.amplitude:
        if not start_passes(oscillator, f, state):
            return False
        found = converge(oscillator, f, state, False, limits.phase, limits.tip_offset)
        if found != FOUND or not on_same_branch(lever, harmonic, state):
            return False
        return orbit_is_kept(oscillator, f, state, 0.0, 0.0)
    if not start_relaxing(oscillator, workspace) or converge_relaxing(oscillator, limits, workspace) != FOUND:
        return False
    dent, recovery = dent_of(p, lever, m)
    if not (taps_once(workspace, dent, recovery) and on_same_branch(lever, harmonic, state)):
        return False
    state.work = energy_defect(lever, f, state)
    i, j, amplitude = TOUCH + N - 1, LATE, state.amplitude
    state.apex = apex_between(amplitude, f.theta[i], f.w[i], f.u[i], f.theta[j], f.w[j], f.u[j])[0]
    state.apex = max(state.apex, amplitude * f.cos[i] + f.w[i], amplitude * f.cos[j] + f.w[j])
    return orbit_is_kept(oscillator, f, state, dent, recovery) and slow_flow_is_stable(oscillator, workspace)
