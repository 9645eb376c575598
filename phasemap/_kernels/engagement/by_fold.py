"""Exact orbits without collocation: by averaging, then by the lever's response, each handed on where it is in doubt.

Where averaging leaves the side open, the fold at which the attractive branch ends is sought among exact orbits. At one
amplitude the mismatch of the exact orbit, whatever drive it needs, has a maximum over the gap. Above zero there is an
attractive orbit of this amplitude, farther out than the maximum; below zero there is none. What that leaves open is for
the curve of exact orbits.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.columns import ErrorLimits
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.beside_resonance import rebounds
from phasemap._kernels.engagement.by_averaging import (
    BY_AVERAGING,
    BY_FOLD,
    fill_setpoint_orbit_on_side,
    narrowest_amplitude_ratio,
    worst_amplitude,
)
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever import beside_resonance, free_amplitude, phase_of, reach_of
from phasemap._kernels.numerics import parabola
from phasemap._kernels.orbits.averaged.sides import ATTRACTIVE, REPULSIVE, UNCLEAR, attractive_mismatch
from phasemap._kernels.orbits.harmonic_orbit import HarmonicOrbit, fill_harmonic_orbit, fill_row_from_harmonic
from phasemap._kernels.orbits.response.nodes import OUT, Nodes, middle_of
from phasemap._kernels.orbits.response.orbit_at_setpoint import (
    ResponseWorkspace,
    exact_orbit_at_amplitude,
    slope_is_clear,
)
from phasemap._kernels.orbits.response.passes import FOUND, converge_passes, start_passes
from phasemap._kernels.orbits.response.state import PassState, fill_row_from_passes
from phasemap._kernels.records import clear

WIDE, NARROW = 0.3, 0.05  # steps from the strongest pull, over its depth and the reach: the first ones, and later ones
MOST_OF_DEPTH = 0.4  # such a step over its depth: where the contact begins there is a kink
MOST_PARABOLAS = 3  # each about the vertex of the one before
MOST_SHIFTS = 3  # of three points, to where orbits are found
FAR_BELOW = -0.15  # mismatch of one point that decides, if that of the averaged maximum is as far below
TIGHT = 0.015  # mismatch at one amplitude that decides
CLOSEST = 1e-4  # nearer to zero only the curve of exact orbits tells
END_PHASE = 0.1 * CLOSEST  # phase [rad] to which orbits are known of which this is the maximum
SURE_OF_IT = 0.3  # of the mismatch at the maximum, by which a parabola may miss it
SPREAD = 0.04  # between the amplitudes around the narrowest one, over it
BESIDE = 2.0  # of that, by which the least of the maxima may lie beside the amplitudes that were asked
MOST_STEPS_TO_END = 6  # to the orbit beside the end
END_MISMATCH = 0.02  # left there, over the mismatch at the maximum


class Peak(NamedTuple):
    """The maximum over the gap of the exact mismatch at one amplitude."""

    mismatch: float  # NaN where it is not found
    gap: float  # [m]
    step: float  # between points of a parabola about it [m]
    curvature: float  # [1/m2]


@kernel
def response_mismatch(oscillator: Oscillator, amplitude: float, gap: float, workspace: ResponseWorkspace) -> float:
    """Attractive mismatch of the exact orbit with this amplitude and gap, at any drive; NaN if it is not found."""
    nodes, state = workspace.nodes, workspace.state
    clear(state)
    state.amplitude, state.centre, state.slope = amplitude, amplitude + gap, -1.0 / reach_of(oscillator.p)
    if not start_passes(oscillator, nodes, state):
        return math.nan
    if converge_passes(oscillator, nodes, state, True, END_PHASE, math.inf) != FOUND:
        return math.nan
    return attractive_mismatch(oscillator.lever, amplitude, state.push, state.drag)


@kernel
def response_maximum(
    oscillator: Oscillator, amplitude: float, near: float, step: float, workspace: ResponseWorkspace
) -> Peak:
    """Maximum over the gap of the exact mismatch near a gap [m].

    By parabolas through three points, the first of which are a `step` [m] apart, until one meets the mismatch at its
    vertex, or a point lies far enough above zero, or below.
    """
    nodes, bend = workspace.nodes, math.nan
    for _ in range(MOST_PARABOLAS):
        h0 = response_mismatch(oscillator, amplitude, near, workspace)
        if h0 < FAR_BELOW and workspace.top.mismatch < FAR_BELOW:
            return Peak(h0, near, step, bend)
        h1 = response_mismatch(oscillator, amplitude, near + step, workspace)
        h2 = response_mismatch(oscillator, amplitude, near - step, workspace)
        for _ in range(MOST_SHIFTS):
            if math.isfinite(h0 + h1 + h2) or not beside_resonance(oscillator.lever):
                break
            near, h1, h0 = near - step, h0, h2  # passes may not converge where a tip just touches
            h2 = response_mismatch(oscillator, amplitude, near - step, workspace)
        at, vertex, bend = parabola((near + step, h1), (near, h0), (near - step, h2))
        if not bend < 0.0:
            break
        near = min(max(at, near - 2.0 * step), near + 2.0 * step)
        h = response_mismatch(oscillator, amplitude, near, workspace)
        depth = nodes.w[middle_of(nodes)] - near
        step = min(NARROW * (reach_of(oscillator.p) + abs(near)), MOST_OF_DEPTH * depth)
        highest = max(max(h0, h1), max(h2, h))
        if not (step > 0.0 and math.isfinite(h)):
            break
        if highest > TIGHT or abs(h - vertex) < SURE_OF_IT * abs(h) + END_PHASE:
            return Peak(highest, near, step, bend)
    return Peak(math.nan, near, step, bend)


@kernel
def highest_response_mismatch(oscillator: Oscillator, amplitude: float, workspace: ResponseWorkspace) -> Peak:
    """Maximum over the gap of the exact mismatch, sought from the averaged one in `workspace.top`."""
    top, nodes = workspace.top, workspace.nodes
    # Outside of contact the harmonics lift the tip, by which the maximum lies nearer to the surface than averaged.
    lifted = response_mismatch(oscillator, amplitude, 0.0, workspace)
    near = top.gap + (min(nodes.w[OUT], 0.0) if math.isfinite(lifted) else 0.0)
    step = min(WIDE * (reach_of(oscillator.p) + abs(near)), MOST_OF_DEPTH * abs(top.gap))
    return response_maximum(oscillator, amplitude, near, step, workspace)


@kernel
def side_of(highest: float) -> int:
    """Side on which the tip passes an amplitude, from the maximum of its exact mismatch; UNCLEAR too near to zero."""
    if not abs(highest) >= CLOSEST:
        return UNCLEAR
    return ATTRACTIVE if highest > 0.0 else REPULSIVE


@kernel
def decide_by_response(
    oscillator: Oscillator, setpoint: float, amplitude: float, workspace: ResponseWorkspace
) -> tuple[int, Peak]:
    """Side on which the tip passes this amplitude, where the attractive branch is nearest its end; the maximum there.

    The amplitude is that of harmonic orbits: of the maxima around it, not below the setpoint, the least counts.
    """
    lever = oscillator.lever
    peak = highest_response_mismatch(oscillator, amplitude, workspace)
    highest = peak.mismatch
    if abs(highest) < TIGHT and amplitude < (1.0 + SPREAD) * narrowest_amplitude_ratio(lever) * free_amplitude(lever):
        above = response_maximum(oscillator, (1.0 + SPREAD) * amplitude, peak.gap, peak.step, workspace).mismatch
        below = response_maximum(oscillator, (1.0 - SPREAD) * amplitude, peak.gap, peak.step, workspace).mismatch
        at, least, bend = parabola((-1.0, below), (0.0, highest), (1.0, above))
        if not (bend > 0.0 and abs(at) < BESIDE):
            return UNCLEAR, peak
        highest = least + 0.5 * bend * max((setpoint / amplitude - 1.0) / SPREAD - at, 0.0) ** 2
    return side_of(highest), peak


@kernel
def fill_orbit_outside_maximum(
    oscillator: Oscillator, amplitude: float, peak: Peak, harmonic: HarmonicOrbit, workspace: ResponseWorkspace
) -> bool:
    """Fill `harmonic` with the attractive orbit at the zero of the exact mismatch outside its maximum; False without.

    The mismatch goes with the square of the distance from its maximum.
    """
    state, fall = workspace.state, 0.5 * peak.curvature
    for _ in range(MOST_STEPS_TO_END):
        if not (peak.mismatch > 0.0 and fall < 0.0):
            return False
        x = math.sqrt(-peak.mismatch / fall)
        h = response_mismatch(oscillator, amplitude, peak.gap + x, workspace)
        fall = (h - peak.mismatch) / (x * x)
        if abs(h) < END_MISMATCH * peak.mismatch and state.push < 0.0:
            c, mean = state.centre / amplitude, -state.mean_force
            fill_harmonic_orbit(harmonic, amplitude, c, state.push, state.drag, mean)
            harmonic.mismatch_slope = 2.0 * fall * x
            return True
    return False


@kernel(shared=True)
def orbit_by_response(
    oscillator: Oscillator, amplitude: float, decider: int, limits: ErrorLimits, harmonic: HarmonicOrbit,
    workspace: ResponseWorkspace,
) -> bool:  # fmt: skip
    """Find the exact orbit, in `workspace.state`, on the side that averaging or the end of the attractive branch tells.

    False where these do not decide, or passes do not come to an orbit that is clear of a fold: curves tell then.
    """
    if decider == BY_AVERAGING:
        return exact_orbit_at_amplitude(oscillator, harmonic, limits, workspace)
    if decider != BY_FOLD:
        return False
    worst = worst_amplitude(oscillator.lever, amplitude)
    side, peak = decide_by_response(oscillator, amplitude, worst, workspace)
    if side == UNCLEAR:
        return False
    known = fill_setpoint_orbit_on_side(oscillator, amplitude, side, workspace.top, harmonic)
    if side == REPULSIVE:
        holds = known and not rebounds(oscillator, harmonic.push)
        return holds and exact_orbit_at_amplitude(oscillator, harmonic, limits, workspace)
    holds = known and exact_orbit_at_amplitude(oscillator, harmonic, limits, workspace)
    if holds and slope_is_clear(oscillator, limits, workspace):
        return True
    if worst != amplitude:
        peak = response_maximum(oscillator, amplitude, peak.gap, peak.step, workspace)
    holds = fill_orbit_outside_maximum(oscillator, amplitude, peak, harmonic, workspace)
    holds = holds and exact_orbit_at_amplitude(oscillator, harmonic, limits, workspace)
    harmonic.tip_offset = math.nan  # no averaged orbit, which could stand for this one
    return holds and slope_is_clear(oscillator, limits, workspace)


@kernel
def averaging_suffices(
    lever: np.ndarray, harmonic: HarmonicOrbit, state: PassState, limits: ErrorLimits, row: np.ndarray
) -> bool:
    """True if the averaged orbit is within `limits` of the exact one; then fills its row."""
    phase_error = (
        abs(phase_of(lever, harmonic.amplitude, harmonic.push, harmonic.drag) - state.phase) + state.phase_error
    )
    height_error = abs(harmonic.tip_offset - state.tip_offset) + state.tip_offset_error
    if not (phase_error < limits.phase and height_error < limits.tip_offset):
        return False
    fill_row_from_harmonic(lever, harmonic, row)
    row[col.ERROR_PHASE], row[col.ERROR_HEIGHT] = phase_error, height_error
    return True


@kernel
def fill_sufficient_row(
    lever: np.ndarray, harmonic: HarmonicOrbit, nodes: Nodes, state: PassState, average: bool, limits: ErrorLimits,
    row: np.ndarray,
) -> int:  # fmt: skip
    """Fill a row with the averaged orbit if it may stand and suffices, else with the exact one; returns the solver."""
    if average and averaging_suffices(lever, harmonic, state, limits, row):
        return col.AVERAGING
    fill_row_from_passes(lever, nodes, state, row)
    return col.CORRECTED
