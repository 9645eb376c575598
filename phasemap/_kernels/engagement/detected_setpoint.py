"""Orbits that the detector sees with a given amplitude, where it does not see the motion of the tip itself.

What A is follows from the phase. Where averaging is sure of the branch, orbits by passes of the lever's response, or
averaged ones where these do not converge, are come to by secants in A; from an averaged one collocation holds what is
seen itself. Elsewhere the curve of exact orbits is followed down to the amplitude that is seen.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.columns import ErrorLimits
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.branch_by_averaging import DOUBTFUL, LEAP, SURE, engage_by_averaging
from phasemap._kernels.engagement.exact_orbit import CurveWorkspace, detected_amplitude_wanted, exact_orbit
from phasemap._kernels.engagement.other_branch import averaged_orbit_on_branch
from phasemap._kernels.engagement.side_from_far import forces_are_plain
from phasemap._kernels.engagement.without_collocation import orbit_without_collocation
from phasemap._kernels.excitation import (
    LEAST_SLOPE,
    detected_amplitude_rate,
    detected_signal,
    likely_amplitude,
    next_amplitude,
    sees_tip,
)
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever import drive_needed, phase_of, phase_rate
from phasemap._kernels.orbits.averaged.branch import fill_averaged_orbit_near
from phasemap._kernels.orbits.collocation.closing import curve_derivative
from phasemap._kernels.orbits.collocation.estimate import estimate_errors
from phasemap._kernels.orbits.collocation.near import refine_orbit, tolerance_of
from phasemap._kernels.orbits.collocation.newton import solve_at_detected_amplitude
from phasemap._kernels.orbits.collocation.system import (
    RA,
    RIGHT,
    RP,
    RS,
    RZ,
    Orbit,
    head_of,
    hold_amplitude,
    hold_parameter,
    no_drift,
)
from phasemap._kernels.orbits.harmonic_orbit import HarmonicOrbit
from phasemap._kernels.orbits.response.orbit import LEAST_SLOPE_ALONG, ResponseWorkspace, nodes_of_solution, refine
from phasemap._kernels.orbits.response.state import fill_row_from_passes
from phasemap._kernels.orbits.result_row import feedback_status

ROUGHLY_SEEN, EXACTLY_SEEN = 1e-3, 1e-12  # of the amplitude seen: of averaged orbits, and of those of passes
MOST_AMPLITUDE_SECANTS = 20
LEAST_SECANT = 1e-7  # of A: secants over less say nothing
SLOPE_STEP_OF_SEEN = 1e-5  # of A: to an orbit that is asked for slopes alone
# What changes with A along the curve of orbits: amplitude seen [1], phase [rad/m], tip offset [1].
SEEN_BY_A, PHASE_BY_A, OFFSET_BY_A, SLOPES = 0, 1, 2, 3


class DetectedWorkspace(NamedTuple):
    """Workspace for the orbit of a material that is detected with a given amplitude."""

    harmonic: HarmonicOrbit
    response: ResponseWorkspace
    limits: ErrorLimits  # of passes


@kernel
def orbit_at_tip_amplitude(
    oscillator: Oscillator, amplitude: float, side: int, averaged: bool, workspace: DetectedWorkspace
) -> tuple[int, float]:
    """Orbit of amplitude A [m] on a side of the resonance: GOOD by passes, KNOWN if averaged, or PENDING; its phase.

    On the side that engagement reaches where `side` is 0. With `averaged` passes are not tried where averaging is sure.
    """
    harmonic = workspace.harmonic
    if side != 0:
        done = col.PENDING
        if fill_averaged_orbit_near(oscillator, amplitude, side, harmonic):
            exact = not averaged and refine(oscillator, harmonic, workspace.limits, workspace.response)
            done = col.GOOD if exact else col.KNOWN
    else:
        surety = engage_by_averaging(oscillator, amplitude, harmonic, workspace.response.top)
        if averaged and surety == SURE:
            done = col.KNOWN
        else:
            limits, passes = workspace.limits, workspace.response
            done = orbit_without_collocation(oscillator, amplitude, surety, limits, harmonic, passes)
    if done == col.GOOD:
        return col.GOOD, workspace.response.state.phase
    if done == col.KNOWN:
        return col.KNOWN, phase_of(oscillator.lever, amplitude, harmonic.push, harmonic.drag)
    return col.PENDING, math.nan


@kernel
def repulsive_orbit_at_detected_amplitude(
    oscillator: Oscillator, seen: float, workspace: DetectedWorkspace, row: np.ndarray, slopes: np.ndarray
) -> bool:
    """Find the repulsive orbit by passes that is seen with an amplitude [m]; False if averaging is not sure of it.

    It is sure at both ends of what A may be without losses, and at the A found.
    """
    (harmonic, passes, limits), lever = workspace, oscillator.lever
    for side in (-1, 1):
        if not _engages_repulsively(oscillator, likely_amplitude(lever, seen, side), workspace):
            return False
    passes.seen = seen
    found = refine(oscillator, harmonic, limits, passes)
    passes.seen, state = 0.0, passes.state
    if not (found and state.seen_by_a > LEAST_SLOPE and _engages_repulsively(oscillator, state.amplitude, workspace)):
        return False
    slopes[SEEN_BY_A], slopes[PHASE_BY_A], slopes[OFFSET_BY_A] = state.seen_by_a, state.phase_by_a, state.offset_by_a
    fill_row_from_passes(lever, nodes_of_solution(passes), state, row)
    return True


@kernel
def _engages_repulsively(oscillator: Oscillator, amplitude: float, workspace: DetectedWorkspace) -> bool:
    """Whether averaging is sure that engagement reaches a repulsive orbit of amplitude A [m], which it fills in."""
    harmonic, top = workspace.harmonic, workspace.response.top
    return engage_by_averaging(oscillator, amplitude, harmonic, top) == SURE and harmonic.push > 0.0


@kernel(shared=True)
def response_orbit_at_detected_amplitude(
    oscillator: Oscillator, seen: float, side: int, workspace: DetectedWorkspace, row: np.ndarray, slopes: np.ndarray
) -> int:
    """Orbit by passes that is seen with an amplitude [m], in its row, with its slopes: GOOD, KNOWN or PENDING.

    On a side of the resonance, from near the averaged orbit in `workspace.harmonic`, or, where `side` is 0, on that
    which engagement reaches. KNOWN where passes do not lead from the averaged orbit, which is then the one seen with
    about this amplitude.
    """
    lever, state = oscillator.lever, workspace.response.state
    slopes[SEEN_BY_A] = 1.0 if sees_tip(lever) else math.nan
    if side == 0 and repulsive_orbit_at_detected_amplitude(oscillator, seen, workspace, row, slopes):
        return col.GOOD
    amplitude = likely_amplitude(lever, seen, side if side != 0 else -1)
    done, phase = orbit_at_tip_amplitude(oscillator, amplitude, side, False, workspace)
    if side == 0 and (
        done == col.PENDING or lever[col.DRIVE] * math.sin(phase) > amplitude * lever[col.DYNAMIC_STIFFNESS]
    ):
        amplitude = likely_amplitude(lever, seen, 1)  # the attractive branch is not what is reached there
        done, phase = orbit_at_tip_amplitude(oscillator, amplitude, side, done == col.KNOWN, workspace)
    before, old_phase, old_offset = (math.nan, math.nan), math.nan, math.nan
    for _ in range(MOST_AMPLITUDE_SECANTS):
        if done == col.PENDING:
            following = 0.5 * (amplitude + before[0])
        else:
            miss, moved = detected_signal(lever, amplitude, phase)[0] - seen, amplitude - before[0]
            if done == col.KNOWN and abs(miss) < ROUGHLY_SEEN * seen:
                return col.KNOWN
            if abs(moved) > LEAST_SECANT * amplitude:
                slopes[SEEN_BY_A], slopes[PHASE_BY_A] = (miss - before[1]) / moved, (phase - old_phase) / moved
                slopes[OFFSET_BY_A] = (state.tip_offset - old_offset) / moved
            there = done == col.GOOD and abs(miss) < EXACTLY_SEEN * seen
            if there and math.isfinite(slopes[SEEN_BY_A]):
                fill_row_from_passes(lever, nodes_of_solution(workspace.response), state, row)
                return col.GOOD if slopes[SEEN_BY_A] > LEAST_SLOPE else col.PENDING
            following = next_amplitude(lever, seen, amplitude, phase, miss, before)
            if there:
                following = amplitude * (1.0 + SLOPE_STEP_OF_SEEN)  # for the slopes alone
            before, old_phase, old_offset = (amplitude, miss), phase, state.tip_offset
        amplitude = following
        if not amplitude > 0.0:
            break
        done, phase = orbit_at_tip_amplitude(oscillator, amplitude, side, done == col.KNOWN, workspace)
    return col.PENDING


@kernel
def branch_orbit_at_detected_amplitude(
    oscillator: Oscillator, seen: float, side: int, workspace: DetectedWorkspace, row: np.ndarray, slopes: np.ndarray
) -> int:
    """Orbit by passes on a side of the resonance that is seen with an amplitude [m]: GOOD, or NO_STABLE_ORBIT.

    PENDING where that is left open, `workspace.harmonic` near an averaged one if there is any. There is none where none
    has the amplitude of a lever without losses, nor one nearer to that seen.
    """
    lossless, harmonic = likely_amplitude(oscillator.lever, seen, side), workspace.harmonic
    for amplitude in (lossless, 0.5 * (lossless + seen)):
        done = averaged_orbit_on_branch(oscillator, amplitude, side, harmonic, workspace.response)
        if done != col.NO_STABLE_ORBIT:
            break
    else:
        return col.NO_STABLE_ORBIT
    if not forces_are_plain(oscillator):  # passes know nothing of a neck, and a side may have several orbits
        return col.PENDING
    done = response_orbit_at_detected_amplitude(oscillator, seen, side, workspace, row, slopes)
    return col.GOOD if done == col.GOOD and slopes[OFFSET_BY_A] > LEAST_SLOPE_ALONG else col.PENDING


@kernel
def fill_slopes_along_curve(lever: np.ndarray, orbit: Orbit, slopes: np.ndarray) -> bool:
    """Fill in what changes with A along the curve, at an orbit that is linearised."""
    if not curve_derivative(lever, orbit, no_drift(), (hold_parameter(orbit), hold_amplitude(orbit))):
        return False
    head, rate = head_of(orbit), orbit.system[:, RIGHT]
    of, by = (head.amplitude, head.push, head.drag), (rate[RA], rate[RP], rate[RS])
    slopes[SEEN_BY_A] = detected_amplitude_rate(lever, of, by)
    (x, y), (by_x, by_y) = drive_needed(lever, *of), drive_needed(lever, *by)
    slopes[PHASE_BY_A] = phase_rate(x, y, by_x, by_y)
    slopes[OFFSET_BY_A] = rate[RZ]
    return True


@kernel
def move_to_detected_amplitude(
    oscillator: Oscillator, seen: float, tolerance: float, orbit: Orbit, row: np.ndarray, slopes: np.ndarray
) -> int:
    """Move an exact orbit to where it is seen with an amplitude [m]; fill in its row and slopes, return its status.

    `tolerance`: its last change [m].
    """
    done = solve_at_detected_amplitude(oscillator, orbit, seen, tolerance)
    if done == col.GOOD:
        done = refine_orbit(oscillator, orbit, row)
    if done == col.GOOD:
        done = feedback_status(row)
    if done == col.GOOD and not (
        fill_slopes_along_curve(oscillator.lever, orbit, slopes) and slopes[SEEN_BY_A] > LEAST_SLOPE
    ):
        done = col.NOT_CONVERGED  # the amplitude that is seen turns here
    return done


@kernel
def _from_averaged_or_along_curve(
    oscillator: Oscillator, seen: float, surety: int, harmonic: HarmonicOrbit, curve: CurveWorkspace,
    row: np.ndarray, slopes: np.ndarray,
) -> int:  # fmt: skip
    """Fill in the exact orbit, as `exact_orbit` finds it, that is seen with an amplitude [m]; returns a status."""
    done = exact_orbit(oscillator, detected_amplitude_wanted(oscillator, seen), surety, harmonic, curve, row)
    if done != col.GOOD:
        return done
    return move_to_detected_amplitude(oscillator, seen, tolerance_of(oscillator), curve.found, row, slopes)


@kernel
def exact_orbit_at_detected_amplitude(
    oscillator: Oscillator, seen: float, known: bool, workspace: DetectedWorkspace, curve: CurveWorkspace,
    row: np.ndarray, slopes: np.ndarray,
) -> int:  # fmt: skip
    """Find by collocation the orbit on which a tip from far stops where the detector sees an amplitude [m].

    From the averaged orbit in `workspace.harmonic` if that is `known`, and averaging is as sure of the branch at the
    amplitude that the tip then has; else along the curve. Fills `curve.found`, the result row, and `slopes` by the
    tip's amplitude; returns a status.
    """
    harmonic, found, top, done = workspace.harmonic, curve.found, workspace.response.top, col.NOT_CONVERGED
    if known:
        done = _from_averaged_or_along_curve(oscillator, seen, SURE, harmonic, curve, row, slopes)
        sure = done == col.GOOD and engage_by_averaging(oscillator, head_of(found).amplitude, harmonic, top) == SURE
        known = sure and (row[col.STIFFENING] > 0.0) == (harmonic.push > 0.0)
    if not known:
        done = _from_averaged_or_along_curve(oscillator, seen, DOUBTFUL, harmonic, curve, row, slopes)
        if done == col.GOOD and engage_by_averaging(oscillator, head_of(found).amplitude, harmonic, top) == LEAP:
            done = col.NOT_CONVERGED
    if done == col.GOOD:
        estimate_errors(oscillator, found, row)
    return done
