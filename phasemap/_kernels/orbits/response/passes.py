"""Exact orbits by passes of the lever's response (`response`), with an estimate of the error that is left."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.columns import ALPHA0, BASE, LONGRANGE, OMEGA, STIFFNESS
from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.law import Law
from phasemap._kernels.lever import mismatch, phase_of
from phasemap._kernels.orbits.response.apex import apex_between
from phasemap._kernels.orbits.response.mixing import keep, mix, new_past
from phasemap._kernels.orbits.response.nodes import (
    COS,
    ENTRY,
    EXIT,
    IN,
    LATE,
    OUT,
    SIN,
    THETA,
    TOUCH,
    WEIGHT,
    WEIGHTS,
    G,
    N,
    U,
    W,
    X,
    force,
    grade,
    lay,
    middle_of,
    parts_of,
    relay,
    respond,
)
from phasemap._kernels.quadrature import barycentric

LOST, FOUND, COARSE = 0, 1, 2  # COARSE: an orbit, but the nodes do not resolve it well enough
MOST_PASSES, MOST_MOVES, MOST_SLOW = 24, 4, 4
ENOUGH = 0.05  # of the mismatch that the lift by a pass would make may be left: it is taken off to first order
SAFETY = 8.0  # over the error that two changes tell
FLOOR_PHASE, FLOOR_HEIGHT = 1e-8, 2e-15  # [rad, m], least error to be expected
CLOSED = 5e-7  # largest energy imbalance
WITHIN, BESIDE = 0.1, 0.01  # share of the nodes' estimate within a linewidth of the resonance, and beside it
DEEPEST = -0.98  # cosine of the contact's edge below which the nodes do not do
# Entries of a state: amplitude, e, change of the mismatch with e; what the nodes give; the result and its errors; the
# largest A cos(theta) + w where the nodes are others, else 0; what the last pass changed, and the ratio before; in how
# many parts the contact is at the nodes; how what they give changes with e, and e to where no mismatch is left; and
# what P and e lack to there.
AMP, E, SLOPE, MEAN, PUSH, DRAG, WORK, LOSS, VIRIAL = range(9)
PHASE, HEIGHT, ERR_PHASE, ERR_HEIGHT, PASSES, APEX = range(9, 15)
LAST_W, PHASE_CHANGE, HEIGHT_CHANGE, LAST_RATIO, PARTS = range(15, 20)
PER_MEAN, PER_PUSH, PER_DRAG, MOVE, LACKS, STATE = range(20, 26)
BARYCENTRIC = barycentric(X)
_LEGENDRE = np.polynomial.legendre.legvander(2 * X - 1, N - 1).T * WEIGHTS
HIGHEST = _LEGENDRE[N - 2 :] * np.array([[2 * N - 3], [2 * N - 1]])  # coefficients of the highest polynomials


@kernel(fastmath=ANY_ORDER)
def evaluate(law: Law, p: np.ndarray, lever: np.ndarray, f: np.ndarray, state: np.ndarray, touching: bool) -> float:
    """Fill the state from the force at the nodes; returns the mismatch of the drive."""
    amplitude = state[AMP]
    mean, push, drag, work, loss, virial = force(law, p, lever, f, amplitude, state[E], touching)
    state[MEAN], state[PUSH], state[DRAG] = mean, push, drag
    state[WORK], state[LOSS], state[VIRIAL] = work, loss, virial
    return mismatch(lever, amplitude, push, drag)


@kernel(light=True)
def beside_resonance(lever: np.ndarray) -> bool:
    """Whether the drive is more than a linewidth off."""
    return abs(1.0 - lever[OMEGA] ** 2) > 2.0 * lever[ALPHA0] * lever[OMEGA]


@kernel(fastmath=ANY_ORDER)
def unresolved(lever: np.ndarray, f: np.ndarray, touching: bool, longrange: bool) -> float:
    """Estimated error of P, S and the mean deflection [m] from the number of nodes: theory, Eq. (errors-2).

    The error of Gauss nodes is about the square of what their highest polynomials still find in the integrand, over the
    integral. A tenth of that is a hundred times the error and more; beside resonance, where contacts are long, no more
    than a hundredth is taken.
    """
    rest = 0.0
    for element in range(2 + parts_of(f)):
        if not (longrange if element == 0 or element == 2 else touching):
            continue
        even, odd, size, first = 0.0, 0.0, 0.0, N * element if element < 3 else LATE
        for j in range(N):
            share = f[G, first + j] * f[WEIGHT, first + j]
            even += HIGHEST[0, j] * share
            odd += HIGHEST[1, j] * share
            size += WEIGHTS[j] * abs(share)
        rest += (abs(even) + abs(odd)) ** 2 / max(size, 1e-300)
    return (BESIDE if beside_resonance(lever) else WITHIN) * rest


@kernel
def remaining(ratio: float, ratio_before: float) -> float:
    """Ratio of the changes to come, on the safe side of the last two: theory, Eq. (errors-1)."""
    return min(max(ratio, 0.4 * ratio_before, 0.04), 0.9)


@kernel
def per_height(lever: np.ndarray, state: np.ndarray) -> float:
    """Error of the tip offset with one of P, S and the mean deflection."""
    return 1.0 + 4.0 / abs(state[SLOPE] * lever[BASE])


@kernel
def state_errors(
    lever: np.ndarray, state: np.ndarray, rest: float, phase_left: float, height_left: float, nodes: float
) -> None:
    """Fill in the errors left behind a last change of so much, if changes go on with the ratio `rest`."""
    share = SAFETY * rest / (1.0 - rest)
    # The conservative force does no work round an orbit.
    wrong = nodes + 3.0 * abs(state[WORK]) / (math.pi * state[AMP])
    state[ERR_PHASE] = share * phase_left + wrong / lever[BASE] + FLOOR_PHASE
    state[ERR_HEIGHT] = share * height_left + FLOOR_HEIGHT
    state[ERR_HEIGHT] += wrong * per_height(lever, state)


@kernel
def start(law: Law, p: np.ndarray, lever: np.ndarray, reach: float, f: np.ndarray, state: np.ndarray) -> bool:
    """Lay the harmonic orbit with the amplitude and e of `state`; False if it is out of this method's range."""
    amplitude, e = state[AMP], state[E]
    c = e / amplitude
    if c < DEEPEST or (c >= 1.0 and p[LONGRANGE] == 0.0):
        return False
    edge = math.acos(c) if c < 1.0 else 0.0
    if p[LONGRANGE] != 0.0:
        grade(f, amplitude, e, reach, edge)
    lay(f, lever, -edge, edge, p[LONGRANGE] != 0.0)
    f[W], f[U] = 0.0, 0.0
    evaluate(law, p, lever, f, state, c < 1.0)
    return True


@kernel
def balance(
    law: Law, p: np.ndarray, lever: np.ndarray, f: np.ndarray, state: np.ndarray, touching: bool, lift: float
) -> float:  # fmt: skip
    """Move e to where the drive is the one given, w as it is; returns the mismatch left. Without a `lift`, e stays.

    The tip that w lifts by so much [m] is first lowered by as much, which leaves its depth and nearly its force.
    """
    amplitude, longrange, hold = state[AMP], p[LONGRANGE] != 0.0, math.isnan(lift)
    if not hold:
        state[E] += lift
    relay(f, lever, amplitude, state[E], touching, longrange)
    h = evaluate(law, p, lever, f, state, touching)
    if hold:
        return h
    for _ in range(MOST_MOVES):
        if abs(h) < ENOUGH * abs(lift * state[SLOPE]) and state[PER_PUSH] != 0.0:
            break
        before = (h, state[MEAN], state[PUSH], state[DRAG])
        move = -h / state[SLOPE]
        state[E] += move
        relay(f, lever, amplitude, state[E], touching, longrange)
        h = evaluate(law, p, lever, f, state, touching)
        learn(state, move, h, before)
    return h


@kernel
def learn(state: np.ndarray, move: float, h: float, before: tuple[float, float, float, float]) -> None:
    """Take the changes with e from a move of it: of the mismatch, `h` now, and of what the nodes give."""
    h_before, mean, push, drag = before
    if 0.3 < (h - h_before) / move / state[SLOPE] < 3.0:
        state[SLOPE], state[PER_MEAN] = (h - h_before) / move, (state[MEAN] - mean) / move
        state[PER_PUSH], state[PER_DRAG] = (state[PUSH] - push) / move, (state[DRAG] - drag) / move


@kernel
def first_pass(state: np.ndarray) -> None:
    """Forget the changes of passes made before."""
    for i in (PHASE, HEIGHT, LAST_W, PHASE_CHANGE, HEIGHT_CHANGE):
        state[i] = math.nan
    state[LACKS] = 0.0
    state[LAST_RATIO] = 1.0


@kernel
def after_pass(lever: np.ndarray, state: np.ndarray, h: float, w: float, nodes: float) -> float:
    """Phase and tip offset after a pass, from the mismatch left and a deflection `w`, and the errors that are left.

    The errors are taken from the last two changes as if they went on like a geometric series, many times over: theory,
    Eq. (errors-1). Returns the ratio of the changes, NaN before there are two.
    """
    move = state[MOVE] = -h / state[SLOPE]
    push, drag = state[PUSH] + move * state[PER_PUSH], state[DRAG] + move * state[PER_DRAG]
    phase, height = phase_of(lever, state[AMP], push, drag), state[E] + move - (state[MEAN] + move * state[PER_MEAN])
    # What is taken off to first order may be wrong by as much, and the next w is that of a force that lacks it.
    lacks, taken_off = state[LACKS], abs(phase - phase_of(lever, state[AMP], state[PUSH], state[DRAG]))
    state[LACKS] = abs(move) + abs(move * state[PER_PUSH]) if state[PER_PUSH] != 0.0 else 0.0
    phase_last, height_last = state[PHASE_CHANGE], state[HEIGHT_CHANGE]
    phase_change = abs(phase - state[PHASE])
    height_change = max(abs(height - state[HEIGHT]), abs(w - state[LAST_W]))
    state[PHASE], state[HEIGHT], state[LAST_W] = phase, height, w
    state[PHASE_CHANGE], state[HEIGHT_CHANGE] = phase_change, height_change
    ratio = max(phase_change / max(phase_last, 1e-12), height_change / max(height_last, 1e-18))
    if ratio >= 0.0:
        rest = remaining(ratio, state[LAST_RATIO])
        phase_left, height_left = max(phase_change, rest * phase_last), max(height_change, rest * height_last)
        phase_left *= max(1.0, lacks / max(height_left, 1e-18))
        state_errors(lever, state, rest, phase_left, height_left, nodes)
        state[ERR_PHASE] += taken_off
        state[ERR_HEIGHT] += lacks + state[LACKS]
        state[LAST_RATIO] = ratio
    return ratio


@kernel(shared=True)
def converge(
    law: Law, p: np.ndarray, lever: np.ndarray, f: np.ndarray, state: np.ndarray, hold: bool,
    limit_phase: float, limit_height: float,
) -> int:  # fmt: skip
    """Repeat passes until estimated errors are below the limits: FOUND, LOST or COARSE; with `hold`, drive is found.

    Beside resonance forces are |1 - omega^2|/(2 alpha0 omega) times what losses take: there energy is balanced last,
    and passes in contact contract slowly, so that all but the first are mixed.
    """
    longrange = p[LONGRANGE] != 0.0
    touching = f[THETA, EXIT] > f[THETA, ENTRY]  # harmonics may lift the tip so that it touches with e > A
    nearest, beside = middle_of(f) if touching else OUT, touching and beside_resonance(lever)
    left_before, slow, past = math.inf, 0, new_past(f, beside)
    harmonic, h = state[PASSES] == 0.0, 0.0
    first_pass(state)
    if harmonic:  # which the first pass changes
        state[PHASE], state[LAST_W] = phase_of(lever, state[AMP], state[PUSH], state[DRAG]), 0.0
        state[HEIGHT] = state[E] - state[MEAN]
    for passes in range(MOST_PASSES):
        before = f[W, nearest]
        if beside:
            keep(f, past)
        respond(f, lever, state[MEAN], state[PUSH], state[DRAG], touching, longrange)
        lift = f[W, nearest] - before
        if beside and passes > 0:
            state[E] += mix(f, 0.0 if hold else lift - h / state[SLOPE], passes - 1, past)
            relay(f, lever, state[AMP], state[E], touching, longrange)
            h = evaluate(law, p, lever, f, state, touching)
        else:
            h = balance(law, p, lever, f, state, touching, math.nan if hold else lift)
        state[PASSES] += 1.0
        nodes = unresolved(lever, f, touching, longrange)
        ratio = after_pass(lever, state, h, f[W, nearest], nodes)
        if not (math.isfinite(state[PHASE] + state[HEIGHT]) and f[THETA, EXIT] >= f[THETA, ENTRY]):
            return LOST
        if ratio >= 0.0:
            left = 0.0 if hold else closure(lever, state)
            small = state[ERR_PHASE] < limit_phase and state[ERR_HEIGHT] < limit_height
            if small and abs(left) < CLOSED:
                return FOUND
            if harmonic and passes == 1:
                continue  # too early to give up
            slow += ratio > 0.7
            change = abs(left - left_before)
            stays = change < 0.5 * abs(left) if beside else abs(left) > 0.5 * abs(left_before)
            rough = nodes > limit_phase * lever[BASE] or (beside and nodes * per_height(lever, state) > limit_height)
            done = SAFETY * state[PHASE_CHANGE] < limit_phase and SAFETY * state[HEIGHT_CHANGE] < limit_height
            if rough or (small and stays) or (beside and done and change < 0.1 * abs(left)):
                return COARSE
            if slow > MOST_SLOW:
                return LOST
            left_before = left
    return LOST


@kernel
def closure(lever: np.ndarray, state: np.ndarray) -> float:
    """Energy in less energy out over energy in, which is what the conservative force leaves behind."""
    amplitude = state[AMP]
    return state[WORK] / (math.pi * amplitude * (2.0 * lever[ALPHA0] * lever[OMEGA] * amplitude - state[DRAG]))


@kernel
def report(lever: np.ndarray, f: np.ndarray, state: np.ndarray, row: np.ndarray) -> None:
    """Fill a result row from a converged orbit."""
    amplitude, stiffness = state[AMP], lever[STIFFNESS]
    move = state[MOVE]
    mean, push = -(state[MEAN] + move * state[PER_MEAN]), state[PUSH] + move * state[PER_PUSH]
    row[:] = math.nan
    row[col.TIP_OFFSET], row[col.MEAN] = state[HEIGHT], mean
    row[col.PHASE], row[col.AMPLITUDE] = state[PHASE], amplitude
    row[col.INDENTATION] = (state[APEX] if state[APEX] > 0.0 else deepest(f, amplitude)) - state[E]
    row[col.DISSIPATION] = stiffness * state[LOSS]
    row[col.VIRIAL] = -stiffness * (state[VIRIAL] / (2 * math.pi) + state[MEAN] * mean)
    row[col.STIFFENING] = push / amplitude
    row[col.CLOSURE] = closure(lever, state)
    row[col.ERROR_PHASE], row[col.ERROR_HEIGHT] = state[ERR_PHASE], state[ERR_HEIGHT]


@kernel
def deepest(f: np.ndarray, amplitude: float) -> float:
    """Largest A cos(theta) + w, in contact or, without one, where the elements before and after it meet."""
    touching = f[THETA, EXIT] > f[THETA, ENTRY]
    theta, w, u = f[THETA], f[W], f[U]
    first = TOUCH if touching else OUT
    before = first if touching else IN
    most = -math.inf
    for k in range(N * parts_of(f) if touching else N):
        j = first + k if k < N else LATE + k - N
        i, before = before, j
        most = max(most, amplitude * f[COS, j] + w[j])
        if not u[i] - amplitude * f[SIN, i] > 0.0 >= u[j] - amplitude * f[SIN, j]:
            continue  # no largest one between, for which two sines more would be taken
        between, angle = apex_between(amplitude, theta[i], w[i], u[i], theta[j], w[j], u[j])
        if touching and between > most:
            between = amplitude * math.cos(angle) + _in_contact(f, angle)
        most = max(most, between)
    return most


@kernel
def _in_contact(f: np.ndarray, angle: float) -> float:
    """Return w at an angle in contact, by the polynomial through the nodes of its element."""
    centre, half = 0.5 * (f[THETA, ENTRY] + f[THETA, EXIT]), 0.5 * (f[THETA, EXIT] - f[THETA, ENTRY])
    x, first = math.asin((angle - centre) / half) / math.pi + 0.5, TOUCH
    if parts_of(f) > 1:
        first = TOUCH if x < 0.5 else LATE
        x = 2.0 * x if x < 0.5 else 2.0 * x - 1.0
    above, below = 0.0, 0.0
    for j in range(N):
        if x == X[j]:
            return float(f[W, first + j])
        share = BARYCENTRIC[j] / (x - X[j])
        above += share * f[W, first + j]
        below += share
    return above / below
