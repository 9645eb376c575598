"""The orbit on the branch that engagement did not choose, where the cheap path to it is safe.

Whether there is one is asked at the setpoint's amplitude, as engagement asks it at every amplitude on its way: far from
the end of the branch averaging tells, and the lever's response gives the orbit; what is near is left PENDING for exact
orbits (`rows.by_collocation`).
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.columns import ErrorLimits
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.by_response import highest_response_mismatch, response_mismatch, side_of
from phasemap._kernels.engagement.side_from_far import decide, forces_are_plain, low_q_margin_factor
from phasemap._kernels.law import Oscillator, contact_force, has_longrange
from phasemap._kernels.lever import reach_of
from phasemap._kernels.orbits.averaged.branch import fill_averaged_orbit_near
from phasemap._kernels.orbits.averaged.harmonics import harmonics
from phasemap._kernels.orbits.averaged.sides import (
    ATTRACTIVE,
    REPULSIVE,
    UNCLEAR,
    Maximum,
    fill_averaged_orbit_on_side,
    find_mismatch_maximum,
    gap_of_push,
    mismatch_at_gap,
)
from phasemap._kernels.orbits.harmonic_orbit import HarmonicOrbit, fill_harmonic_orbit
from phasemap._kernels.orbits.response.orbit import ResponseWorkspace, refine, slope_is_clear
from phasemap._kernels.records import assign, clear

DAMPED = 0.05  # mismatch without a net force that leaves no doubt
EXACTLY_DAMPED = 2e-3  # the same of exact orbits
NO_FORCE = 0.02  # net force over the drive that counts as none
FIRST_GAP_SHIFT = 0.02  # of the gap or the reach: between the first two gaps of secants to where there is none
MOST_FORCE_SECANTS = 6
DEEPEST = -6.0  # gap over amplitude: there the lever presses the tip down
STEP_OUTSIDE = 0.5  # of depth and reach of the strongest pull, out of it


@kernel
def averaged_orbit_on_branch(
    oscillator: Oscillator, amplitude: float, side: int, harmonic: HarmonicOrbit, workspace: ResponseWorkspace
) -> int:
    """Fill `harmonic` with the averaged orbit on this side; NO_STABLE_ORBIT if there is surely none, PENDING in doubt.

    In doubt about the attractive side it lies outside of where the branch ends, from where Newton's method comes
    to the outer orbit if there is one.
    """
    law, p, lever = oscillator
    clear(harmonic)
    if not forces_are_plain(oscillator):
        return col.PENDING
    if not has_longrange(p):
        repelled = contact_force(law, 0.0, p) >= 0.0
        return col.NO_STABLE_ORBIT if repelled and side == ATTRACTIVE else col.PENDING
    top = workspace.top
    if side == ATTRACTIVE:
        decided = decide(oscillator, amplitude, low_q_margin_factor(lever), top)
        if decided == UNCLEAR:
            decided = side_of(highest_response_mismatch(oscillator, amplitude, workspace)[0])
        if decided == REPULSIVE:
            return col.NO_STABLE_ORBIT
        if decided == UNCLEAR or not top.mismatch > 0.0:
            start_outside_maximum(oscillator, amplitude, top, harmonic)
            return col.PENDING
    else:
        find_mismatch_maximum(oscillator, amplitude, math.inf, top)
    if fill_averaged_orbit_on_side(oscillator, amplitude, side, top, harmonic):
        return col.GOOD
    if side == ATTRACTIVE:
        start_outside_maximum(oscillator, amplitude, top, harmonic)
        return col.PENDING
    drag, gap = drag_at_balance(oscillator, amplitude, top)
    if abs(drag) < DAMPED * low_q_margin_factor(lever):
        drag = response_drag(oscillator, amplitude, gap, workspace)
        return col.NO_STABLE_ORBIT if drag > EXACTLY_DAMPED else col.PENDING
    return col.NO_STABLE_ORBIT if drag > 0.0 else col.PENDING


@kernel
def start_outside_maximum(oscillator: Oscillator, amplitude: float, top: Maximum, harmonic: HarmonicOrbit) -> None:
    """Fill `harmonic` with a harmonic orbit outside of the strongest pull."""
    c = 1.0 + (top.gap + STEP_OUTSIDE * (reach_of(oscillator.p) + abs(top.gap))) / amplitude
    push, drag, mean = harmonics(oscillator, amplitude, c)
    fill_harmonic_orbit(harmonic, amplitude, c, push, drag, mean)


@kernel
def drag_at_balance(oscillator: Oscillator, amplitude: float, top: Maximum) -> tuple[float, float]:
    """Mismatch where repulsion just makes up for attraction, and the gap there; deeper the surface takes up more.

    Above zero, damping alone asks for more than the drive, and there is no orbit behind. Infinite if nothing makes up
    for attraction, even in permanent contact.
    """
    before, gap = (top.gap, top.push), top.behind
    _, push = mismatch_at_gap(oscillator, amplitude, gap)
    while push <= 0.0 and gap >= DEEPEST * amplitude:
        before, gap = (gap, push), 2.0 * gap
        _, push = mismatch_at_gap(oscillator, amplitude, gap)
    if not push > 0.0:
        return math.inf if push <= 0.0 else math.nan, gap
    gap = gap_of_push(oscillator, amplitude, 0.0, before, (gap, push))
    return mismatch_without_net_force(oscillator.lever, amplitude, mismatch_at_gap(oscillator, amplitude, gap)[0]), gap


@kernel
def mismatch_without_net_force(lever: np.ndarray, amplitude: float, h: float) -> float:
    """Mismatch at P = 0; above resonance less the square of the detuning, which repulsion makes up for first."""
    detuning = amplitude * lever[col.DYNAMIC_STIFFNESS] / lever[col.DRIVE]
    return h if detuning >= 0.0 else h - detuning * detuning


@kernel
def response_drag(oscillator: Oscillator, amplitude: float, gap: float, workspace: ResponseWorkspace) -> float:
    """The mismatch of `drag_at_balance` by exact orbits, from its gap; NaN if they are not found."""
    lever = oscillator.lever
    before = gap + FIRST_GAP_SHIFT * min(gap, -reach_of(oscillator.p))
    response_mismatch(oscillator, amplitude, before, workspace)
    push_before = workspace.state.push
    for _ in range(MOST_FORCE_SECANTS):
        h = response_mismatch(oscillator, amplitude, gap, workspace)
        push = workspace.state.push
        if not math.isfinite(h):
            return math.nan
        if abs(push) < NO_FORCE * lever[col.DRIVE]:
            return mismatch_without_net_force(lever, amplitude, h)
        before, push_before, gap = gap, push, gap - push * (gap - before) / (push - push_before)
    return math.nan


@kernel
def refined_orbit_on_branch(
    oscillator: Oscillator, amplitude: float, side: int, limits: ErrorLimits, harmonic: HarmonicOrbit,
    workspace: ResponseWorkspace,
) -> int:  # fmt: skip
    """Find the averaged orbit on a side of the resonance, and GOOD with the exact one near it in `workspace.state`.

    Where averaging leaves open whether there is one, an exact orbit near any averaged one of this side is an answer.
    """
    done, near = averaged_orbit_on_branch(oscillator, amplitude, side, harmonic, workspace), HarmonicOrbit()
    if done == col.NO_STABLE_ORBIT or not forces_are_plain(oscillator):
        return done
    assign(near, harmonic)
    if done == col.PENDING and not fill_averaged_orbit_near(oscillator, amplitude, side, near):
        return done
    if not (refine(oscillator, near, limits, workspace) and slope_is_clear(oscillator, limits, workspace)):
        return col.PENDING
    assign(harmonic, near)
    return col.GOOD
