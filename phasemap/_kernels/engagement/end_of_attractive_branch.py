"""The fold at which the attractive branch ends, by exact orbits, where averaging leaves open on which side a tip is.

At one amplitude the mismatch of the exact orbit, whatever drive it needs, has a maximum over the gap. Above zero there
is an attractive orbit of this amplitude, farther out than the maximum; below zero there is none. The maximum is sought
roughly, and where it is near zero once more through a lens.
"""

from __future__ import annotations

import math

from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.side_from_far import narrowest_amplitude_ratio
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever import beside_resonance, free_amplitude, reach_of
from phasemap._kernels.orbits.averaged.sides import ATTRACTIVE, REPULSIVE, UNCLEAR, Maximum, attractive_mismatch
from phasemap._kernels.orbits.harmonic_orbit import HarmonicOrbit
from phasemap._kernels.orbits.response.nodes import OUT, Nodes, middle_of
from phasemap._kernels.orbits.response.orbit import Fit, ResponseWorkspace
from phasemap._kernels.orbits.response.passes import FOUND, converge, start_passes
from phasemap._kernels.orbits.response.state import PassState
from phasemap._kernels.records import clear

TIGHT = 0.015  # mismatch at the exact maximum that decides
MOST_SHIFTS = 3  # of three points, to where orbits are found
FAR_BELOW = -0.15  # the same where one point and the averaged maximum are enough
CLOSEST = 1e-4  # the same through the lens, nearer than which only the curve of exact orbits tells
END_PHASE = 0.1 * CLOSEST  # phase [rad] to which orbits are known of which this is the maximum
LENS = 0.05  # steps from the strongest pull, over its depth and the reach
MOST_LENS_STEP = 0.4  # such a step over its depth
SURE_OF_IT = 0.3  # of the mismatch at the maximum, by which the parabola through three points may miss it
SPREAD = 0.04  # between the amplitudes around the narrowest one, over it
MOST_STEPS_TO_END = 6  # to the orbit beside the end
END_MISMATCH = 0.02  # left there, over the mismatch at the maximum


@kernel
def attractive_mismatch_of_exact_orbit(
    oscillator: Oscillator, amplitude: float, gap: float, nodes: Nodes, state: PassState
) -> float:
    """Attractive mismatch of the exact orbit with this amplitude and gap, at any drive; NaN if it is not found."""
    lever = oscillator.lever
    clear(state)
    state.amplitude, state.centre, state.slope = amplitude, amplitude + gap, -1.0 / reach_of(oscillator.p)
    if not start_passes(oscillator, nodes, state):
        return math.nan
    if converge(oscillator, nodes, state, True, END_PHASE, math.inf) != FOUND:
        return math.nan
    return attractive_mismatch(lever, amplitude, state.push, state.drag)


@kernel
def decide_exactly(
    oscillator: Oscillator, amplitude: float, top: Maximum, nodes: Nodes, state: PassState, fit: Fit
) -> int:
    """Side on which the tip passes the amplitude at which the attractive branch is nearest to its end.

    Fills `fit`.
    """
    # Outside of contact the harmonics lift the tip, by which the maximum lies nearer to the surface than averaged.
    lever = oscillator.lever
    lifted = attractive_mismatch_of_exact_orbit(oscillator, amplitude, 0.0, nodes, state)
    middle = top.gap + (min(nodes.w[OUT], 0.0) if math.isfinite(lifted) else 0.0)
    step = min(0.3 * (reach_of(oscillator.p) + abs(middle)), MOST_LENS_STEP * abs(top.gap))
    h0 = attractive_mismatch_of_exact_orbit(oscillator, amplitude, middle, nodes, state)
    if top.mismatch < FAR_BELOW and h0 < FAR_BELOW:
        return REPULSIVE
    h1 = attractive_mismatch_of_exact_orbit(oscillator, amplitude, middle + step, nodes, state)
    h2 = attractive_mismatch_of_exact_orbit(oscillator, amplitude, middle - step, nodes, state)
    for _ in range(MOST_SHIFTS):
        if math.isfinite(h0 + h1 + h2) or not beside_resonance(lever):
            break
        middle, h1, h0 = middle - step, h0, h2  # passes may not converge where a tip just touches
        h2 = attractive_mismatch_of_exact_orbit(oscillator, amplitude, middle - step, nodes, state)
    bend = (h1 - 2.0 * h0 + h2) / (step * step)
    if not bend < 0.0:
        return UNCLEAR
    at = min(max(middle - 0.5 * (h1 - h2) / (step * bend), middle - 2.0 * step), middle + 2.0 * step)
    h = attractive_mismatch_of_exact_orbit(oscillator, amplitude, at, nodes, state)
    fit.gap, fit.mismatch, fit.curvature = at, h, bend
    highest = max(max(h0, h1), max(h2, h))
    if not math.isfinite(h):
        return UNCLEAR
    if highest > TIGHT:
        return ATTRACTIVE
    # The parabola's own maximum must agree, for the points may have missed it.
    fitted = h0 - (h1 - h2) ** 2 / (8.0 * step * step * bend)
    return REPULSIVE if max(highest, fitted) < -TIGHT and abs(h - fitted) < SURE_OF_IT * abs(h) else UNCLEAR


@kernel
def maximum_of_exact_mismatch(oscillator: Oscillator, amplitude: float, workspace: ResponseWorkspace) -> float:
    """Maximum over the gap of the exact orbits' mismatch, near that of `workspace.fit`, updated; NaN if not near."""
    middle, f, state = workspace.fit.gap, workspace.nodes, workspace.state
    h0 = attractive_mismatch_of_exact_orbit(oscillator, amplitude, middle, f, state)
    depth = f.w[middle_of(f)] - middle
    # Within the contact: where it begins there is a kink.
    step = min(LENS * (reach_of(oscillator.p) + abs(middle)), MOST_LENS_STEP * depth)
    h1 = attractive_mismatch_of_exact_orbit(oscillator, amplitude, middle + step, f, state)
    h2 = attractive_mismatch_of_exact_orbit(oscillator, amplitude, middle - step, f, state)
    bend, rise = (h1 - 2.0 * h0 + h2) / (step * step), (h1 - h2) / (2.0 * step)
    if not (step > 0.0 and bend < 0.0 and abs(rise) < -2.0 * step * bend):
        return math.nan
    at = middle - rise / bend
    h = attractive_mismatch_of_exact_orbit(oscillator, amplitude, at, f, state)
    workspace.fit.gap, workspace.fit.mismatch, workspace.fit.curvature = at, h, bend
    return h if abs(h - h0 + 0.5 * rise * rise / bend) < SURE_OF_IT * abs(h) + END_PHASE else math.nan


@kernel
def decide_by_refined_maximum(
    oscillator: Oscillator, setpoint: float, amplitude: float, workspace: ResponseWorkspace
) -> int:
    """Side on which the tip passes the amplitude, by a refined maximum of the exact mismatch; or UNCLEAR.

    Where the branch is narrowest is known for harmonic orbits. Of the maxima around that amplitude, not below the
    setpoint, the least counts.
    """
    lever = oscillator.lever
    highest = maximum_of_exact_mismatch(oscillator, amplitude, workspace)
    if amplitude < (1.0 + SPREAD) * narrowest_amplitude_ratio(lever) * free_amplitude(lever):
        at, h, bend = workspace.fit.gap, workspace.fit.mismatch, workspace.fit.curvature
        above = maximum_of_exact_mismatch(oscillator, (1.0 + SPREAD) * amplitude, workspace)
        workspace.fit.gap = at
        below = maximum_of_exact_mismatch(oscillator, (1.0 - SPREAD) * amplitude, workspace)
        workspace.fit.gap, workspace.fit.mismatch, workspace.fit.curvature = at, h, bend
        slope, curved = 0.5 * (above - below), 0.5 * (above + below) - highest
        if not (curved > 0.0 and abs(slope) < 4.0 * curved):
            return UNCLEAR
        t = max(-0.5 * slope / curved, (setpoint / amplitude - 1.0) / SPREAD)
        highest += t * (slope + t * curved)
    if not abs(highest) >= CLOSEST:
        return UNCLEAR
    return ATTRACTIVE if highest > 0.0 else REPULSIVE


@kernel
def fill_orbit_outside_maximum(
    oscillator: Oscillator, amplitude: float, harmonic: HarmonicOrbit, workspace: ResponseWorkspace
) -> bool:
    """Fill `harmonic` with the exact orbit, roughly, at a gap above that of the maximum; False if it is not found.

    The mismatch goes with the square of the distance from its maximum.
    """
    at, highest, fall = workspace.fit.gap, workspace.fit.mismatch, 0.5 * workspace.fit.curvature
    state = workspace.state
    for _ in range(MOST_STEPS_TO_END):
        if not (highest > 0.0 and fall < 0.0):
            return False
        x = math.sqrt(-highest / fall)
        h = attractive_mismatch_of_exact_orbit(oscillator, amplitude, at + x, workspace.nodes, state)
        fall = (h - highest) / (x * x)
        if abs(h) < END_MISMATCH * highest and state.push < 0.0:
            harmonic.tip_offset, harmonic.mean_deflection, harmonic.amplitude = (
                state.centre - state.mean_force,
                -state.mean_force,
                amplitude,
            )
            harmonic.push, harmonic.drag, harmonic.mismatch_slope = state.push, state.drag, 2.0 * fall * x
            return True
    return False
