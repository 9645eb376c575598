"""The orbit on the branch that engagement did not choose, where the cheap path to it is safe.

Whether there is one is asked at the setpoint's amplitude, as engagement asks it at every amplitude on its way: far from
the end of the branch averaging tells, and the lever's response gives the orbit; what is near is left PENDING for exact
orbits (`other_branch_exact`).
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.columns import ATTRACTING, ENGAGED, LONGRANGE, REPELLING
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.end import (
    CLOSEST,
    attractive_mismatch_of_exact_orbit,
    decide_exactly,
    maximum_of_exact_mismatch,
)
from phasemap._kernels.engagement.resonance import CLEAR_MISMATCH, DETUNED, forces_are_plain, low_q_margin_factor
from phasemap._kernels.law import Law, Oscillator, contact_force, parameters
from phasemap._kernels.lever import free_amplitude, reach_of
from phasemap._kernels.orbits.averaged.harmonics import harmonics, put_harmonic_orbit
from phasemap._kernels.orbits.averaged.sides import (
    ATTRACTIVE,
    REPULSIVE,
    UNCLEAR,
    Maximum,
    fill_averaged_orbit_on_side,
    find_mismatch_maximum,
    mismatch_at_gap,
)
from phasemap._kernels.orbits.response.orbit import Room, nodes_of_solution, refine, slope_is_clear
from phasemap._kernels.rows.answers import Answers
from phasemap._kernels.rows.fast import choose

DAMPED = 0.05  # mismatch without a net force that leaves no doubt
EXACTLY_DAMPED = 2e-3  # the same of exact orbits
NO_FORCE, APART, MOST_SECANTS = 0.02, 0.02, 6  # net force over the base amplitude that is none, and how it is come to
HALF_PULL = 0.75  # mismatch where attraction is half of what the setpoint wants, over that of the free lever
DEEPEST = -6.0  # gap over amplitude: there the lever presses the tip down
BESIDE = 0.5  # a step outside of the strongest pull, over its depth and the reach
MOST_STEPS = 60


@kernel
def side_of(slot: int) -> int:
    """Sign of the mean interaction."""
    return REPULSIVE if slot == REPELLING else ATTRACTIVE


@kernel
def averaged_on(oscillator: Oscillator, amplitude: float, side: int, guess: np.ndarray, room: Room) -> int:
    """Fill `guess` with the averaged orbit on this side; NO_STABLE_ORBIT if there is surely none, PENDING in doubt.

    In doubt about the attractive side the guess lies outside of where the branch ends, from where Newton's method comes
    to the outer orbit if there is one.
    """
    law, p, lever = oscillator
    guess[:] = 0.0
    if not forces_are_plain(oscillator):
        return col.PENDING
    if p[LONGRANGE] == 0.0:
        repelled = contact_force(law, 0.0, p) >= 0.0
        return col.NO_STABLE_ORBIT if repelled and side == ATTRACTIVE else col.PENDING
    reach, free, top = reach_of(law, p), free_amplitude(lever), room.top
    find_mismatch_maximum(oscillator, reach, amplitude, math.inf, top)
    if side == ATTRACTIVE:
        wanted = 1.0 - (amplitude / free) ** 2
        detuned = 1.0 + DETUNED * abs(lever[col.DYNAMIC_STIFFNESS])
        plain = min((CLEAR_MISMATCH * wanted + 0.03) * low_q_margin_factor(lever) * detuned, HALF_PULL * wanted)
        if top.mismatch <= -plain:
            return col.NO_STABLE_ORBIT
        if top.mismatch < plain:
            room.fit.gap = room.fit.mismatch = room.fit.curvature = math.nan
            exact = decide_exactly(oscillator, reach, amplitude, top, room.nodes, room.state, room.fit)
            if exact == UNCLEAR:
                highest = maximum_of_exact_mismatch(oscillator, reach, amplitude, room)
                if abs(highest) >= CLOSEST:
                    exact = ATTRACTIVE if highest > 0.0 else REPULSIVE
            if exact == REPULSIVE:
                return col.NO_STABLE_ORBIT
            if exact == UNCLEAR or not top.mismatch > 0.0:
                beside(oscillator, reach, amplitude, top, guess)
                return col.PENDING
    if fill_averaged_orbit_on_side(oscillator, reach, amplitude, side, top, guess):
        return col.GOOD
    if side == ATTRACTIVE:
        beside(oscillator, reach, amplitude, top, guess)
        return col.PENDING
    drag, gap = drag_at_balance(oscillator, reach, amplitude, top)
    if abs(drag) < DAMPED * low_q_margin_factor(lever):
        drag = exact_drag(oscillator, reach, amplitude, gap, room)
        return col.NO_STABLE_ORBIT if drag > EXACTLY_DAMPED else col.PENDING
    return col.NO_STABLE_ORBIT if drag > 0.0 else col.PENDING


@kernel
def beside(oscillator: Oscillator, reach: float, amplitude: float, top: Maximum, guess: np.ndarray) -> None:
    """Fill `guess` with a harmonic orbit outside of the strongest pull."""
    c = 1.0 + (top.gap + BESIDE * (reach + abs(top.gap))) / amplitude
    push, drag, mean = harmonics(oscillator, reach, amplitude, c)
    put_harmonic_orbit(guess, amplitude, c, push, drag, mean)


@kernel
def drag_at_balance(oscillator: Oscillator, reach: float, amplitude: float, top: Maximum) -> tuple[float, float]:
    """Mismatch where repulsion just makes up for attraction, and the gap there; deeper the surface takes up more.

    Above zero, damping alone asks for more than the drive, and there is no orbit behind. Infinite if nothing makes up
    for attraction, even in permanent contact.
    """
    lever = oscillator.lever
    near, far = top.gap, top.behind
    h, push = mismatch_at_gap(oscillator, reach, amplitude, far)
    while push <= 0.0 and far >= DEEPEST * amplitude:
        near, far = far, 2.0 * far
        h, push = mismatch_at_gap(oscillator, reach, amplitude, far)
    if not push > 0.0:
        return math.inf if push <= 0.0 else math.nan, far
    middle = far
    for _ in range(MOST_STEPS):
        if abs(push) < 0.05 * lever[col.DRIVE]:
            break
        middle = 0.5 * (near + far)
        h, push = mismatch_at_gap(oscillator, reach, amplitude, middle)
        if push > 0.0:
            far = middle
        else:
            near = middle
    return mismatch_without_net_force(lever, amplitude, h), middle


@kernel
def mismatch_without_net_force(lever: np.ndarray, amplitude: float, h: float) -> float:
    """Mismatch at P = 0; above resonance less the square of the detuning, which repulsion makes up for first."""
    detuning = amplitude * lever[col.DYNAMIC_STIFFNESS] / lever[col.DRIVE]
    return h if detuning >= 0.0 else h - detuning * detuning


@kernel
def exact_drag(oscillator: Oscillator, reach: float, amplitude: float, gap: float, room: Room) -> float:
    """The mismatch of `drag_at_balance` by exact orbits, from its gap; NaN if they are not found."""
    lever = oscillator.lever
    before = gap + APART * min(gap, -reach)
    attractive_mismatch_of_exact_orbit(oscillator, reach, amplitude, before, room.nodes, room.state)
    push_before = room.state.push
    for _ in range(MOST_SECANTS):
        h, push = (
            attractive_mismatch_of_exact_orbit(oscillator, reach, amplitude, gap, room.nodes, room.state),
            room.state.push,
        )
        if not math.isfinite(h):
            return math.nan
        if abs(push) < NO_FORCE * lever[col.DRIVE]:
            return mismatch_without_net_force(lever, amplitude, h)
        before, push_before, gap = gap, push, gap - push * (gap - before) / (push - push_before)
    return math.nan


@kernel
def other_rows(
    law: Law, rows: np.ndarray, lever: np.ndarray, amplitudes: np.ndarray, limits: np.ndarray, allowed: np.ndarray,
    first: int, last: int, answers: Answers,
) -> int:  # fmt: skip
    """Stable orbits on both branches for every row in [first, last), from what engagement found; returns how many wait.

    Parameters
    ----------
    limits : ndarray, shape (2,)
        Largest estimated errors of an exact orbit: phase [rad], height [m].
    allowed : ndarray, shape (2,)
        The same within which an averaged orbit may stand.
    answers : Answers
        By slot. Of these ENGAGED is given, the other two are filled; what is PENDING has a harmonic orbit (z0, mean
        deflection, A, P, S) to start from, or NaN.
    """
    out, status, solver = answers
    room, guess, waiting = Room(), np.zeros(col.GUESS), 0
    for i in range(first, last):
        here = REPELLING if out[ENGAGED, i, col.STIFFENING] > 0.0 else ATTRACTING
        p, reach, left = parameters(rows[i]), reach_of(law, parameters(rows[i])), False
        for slot in range(ENGAGED):
            row = out[slot, i]
            if status[ENGAGED, i] == col.GOOD and slot == here:
                for j in range(col.COLUMNS):
                    row[j] = out[ENGAGED, i, j]
                status[slot, i], solver[slot, i] = col.GOOD, solver[ENGAGED, i]
                continue
            row[:] = math.nan
            done = averaged_on(Oscillator(law, p, lever), amplitudes[i], side_of(slot), guess, room)
            if done == col.GOOD:
                exact = refine(Oscillator(law, p, lever), reach, guess, limits, room)
                if not exact or not slope_is_clear(Oscillator(law, p, lever), limits, room):
                    done = col.PENDING
            if done == col.GOOD:
                solver[slot, i] = choose(lever, guess, nodes_of_solution(room), room.state, True, allowed, row)
            elif done == col.PENDING:
                left = True
                for j in range(5):
                    row[j] = guess[j] if guess[col.G_A] > 0.0 else math.nan
            status[slot, i] = done
        waiting += left
    return waiting
