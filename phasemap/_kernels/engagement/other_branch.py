"""The orbit on the branch that engagement did not choose, where the cheap path to it is safe.

Whether there is one is asked at the setpoint's amplitude, as engagement asks it at every amplitude on its way: far from
the end of the branch averaging tells, and the lever's response gives the orbit; what is near is left PENDING for exact
orbits (`rows.by_collocation`).
"""

from __future__ import annotations

import math

from phasemap._kernels import columns as col
from phasemap._kernels.columns import ErrorLimits
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.by_averaging import forces_are_plain, low_q_margin_factor, side_by_averaging
from phasemap._kernels.engagement.by_fold import highest_response_mismatch, side_of
from phasemap._kernels.law import Oscillator, contact_force, has_longrange
from phasemap._kernels.lever import lowest_tip_offset, reach_of
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
from phasemap._kernels.orbits.response.orbit_at_setpoint import (
    ResponseWorkspace,
    exact_orbit_at_amplitude,
    slope_is_clear,
)
from phasemap._kernels.records import assign, clear

DAMPED = 0.05  # mismatch without a net force that leaves no doubt
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
        decided = side_by_averaging(oscillator, amplitude, top)
        if decided == UNCLEAR:
            decided = side_of(highest_response_mismatch(oscillator, amplitude, workspace).mismatch)
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
    drag = mismatch_at_balance(oscillator, amplitude, top)
    return col.NO_STABLE_ORBIT if drag >= DAMPED * low_q_margin_factor(lever) else col.PENDING


@kernel
def start_outside_maximum(oscillator: Oscillator, amplitude: float, top: Maximum, harmonic: HarmonicOrbit) -> None:
    """Fill `harmonic` with a harmonic orbit outside of the strongest pull."""
    c = 1.0 + (top.gap + STEP_OUTSIDE * (reach_of(oscillator.p) + abs(top.gap))) / amplitude
    push, drag, mean = harmonics(oscillator, amplitude, c)
    fill_harmonic_orbit(harmonic, amplitude, c, push, drag, mean)


@kernel
def mismatch_at_balance(oscillator: Oscillator, amplitude: float, top: Maximum) -> float:
    """Mismatch at P = 0, where repulsion balances attraction; deeper the surface dissipates more.

    Above zero, damping alone needs more than the drive gives, and no orbit lies deeper. Infinite if nothing balances
    the attraction, even in permanent contact.
    """
    before, gap = (top.gap, top.push), top.deeper_gap
    _, push = mismatch_at_gap(oscillator, amplitude, gap)
    while push <= 0.0 and gap >= lowest_tip_offset(oscillator):
        before, gap = (gap, push), 2.0 * gap
        _, push = mismatch_at_gap(oscillator, amplitude, gap)
    if not push > 0.0:
        return math.inf if push <= 0.0 else math.nan
    h, _ = mismatch_at_gap(oscillator, amplitude, gap_of_push(oscillator, amplitude, 0.0, before, (gap, push)))
    detuning = min(amplitude * oscillator.lever[col.DYNAMIC_STIFFNESS] / oscillator.lever[col.DRIVE], 0.0)
    return h - detuning * detuning  # which repulsion makes up for first above resonance


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
    if not (
        exact_orbit_at_amplitude(oscillator, near, limits, workspace) and slope_is_clear(oscillator, limits, workspace)
    ):
        return col.PENDING
    assign(harmonic, near)
    return col.GOOD
