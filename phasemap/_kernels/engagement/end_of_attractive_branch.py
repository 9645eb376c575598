"""The fold at which the attractive branch ends, by exact orbits, where averaging leaves open on which side a tip is.

At one amplitude the mismatch of the exact orbit, whatever drive it needs, has a maximum over the gap. Above zero there
is an attractive orbit of this amplitude, farther out than the maximum; below zero there is none.
"""

from __future__ import annotations

import math

from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.side_from_far import narrowest_amplitude_ratio
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever import beside_resonance, free_amplitude, reach_of
from phasemap._kernels.numerics import parabola
from phasemap._kernels.orbits.averaged.sides import ATTRACTIVE, REPULSIVE, UNCLEAR, attractive_mismatch
from phasemap._kernels.orbits.harmonic_orbit import HarmonicOrbit
from phasemap._kernels.orbits.response.nodes import OUT, middle_of
from phasemap._kernels.orbits.response.orbit import ResponseWorkspace
from phasemap._kernels.orbits.response.passes import FOUND, converge, start_passes
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
MOST_STEPS_TO_END = 6  # to the orbit beside the end
END_MISMATCH = 0.02  # left there, over the mismatch at the maximum


@kernel
def exact_mismatch(oscillator: Oscillator, amplitude: float, gap: float, workspace: ResponseWorkspace) -> float:
    """Attractive mismatch of the exact orbit with this amplitude and gap, at any drive; NaN if it is not found."""
    nodes, state = workspace.nodes, workspace.state
    clear(state)
    state.amplitude, state.centre, state.slope = amplitude, amplitude + gap, -1.0 / reach_of(oscillator.p)
    if not start_passes(oscillator, nodes, state):
        return math.nan
    if converge(oscillator, nodes, state, True, END_PHASE, math.inf) != FOUND:
        return math.nan
    return attractive_mismatch(oscillator.lever, amplitude, state.push, state.drag)


@kernel
def exact_maximum(
    oscillator: Oscillator, amplitude: float, near: float, step: float, workspace: ResponseWorkspace
) -> float:
    """Maximum over the gap of the exact mismatch, its vertex in `workspace.fit`; NaN if there is none near a gap [m].

    By parabolas through three points, the first of which are a `step` [m] apart, until one meets the mismatch at its
    vertex, or a point lies far enough above zero, or below.
    """
    fit, nodes = workspace.fit, workspace.nodes
    clear(fit)
    for _ in range(MOST_PARABOLAS):
        h0 = exact_mismatch(oscillator, amplitude, near, workspace)
        if h0 < FAR_BELOW and workspace.top.mismatch < FAR_BELOW:
            return h0
        h1 = exact_mismatch(oscillator, amplitude, near + step, workspace)
        h2 = exact_mismatch(oscillator, amplitude, near - step, workspace)
        for _ in range(MOST_SHIFTS):
            if math.isfinite(h0 + h1 + h2) or not beside_resonance(oscillator.lever):
                break
            near, h1, h0 = near - step, h0, h2  # passes may not converge where a tip just touches
            h2 = exact_mismatch(oscillator, amplitude, near - step, workspace)
        at, vertex, bend = parabola((near + step, h1), (near, h0), (near - step, h2))
        if not bend < 0.0:
            return math.nan
        near = min(max(at, near - 2.0 * step), near + 2.0 * step)
        h = exact_mismatch(oscillator, amplitude, near, workspace)
        fit.amplitude, fit.gap, fit.mismatch, fit.curvature = amplitude, near, h, bend
        depth = nodes.w[middle_of(nodes)] - near
        step = fit.step = min(NARROW * (reach_of(oscillator.p) + abs(near)), MOST_OF_DEPTH * depth)
        highest = max(max(h0, h1), max(h2, h))
        if not (step > 0.0 and math.isfinite(h)):
            return math.nan
        if highest > TIGHT or abs(h - vertex) < SURE_OF_IT * abs(h) + END_PHASE:
            return highest
    return math.nan


@kernel
def highest_exact_mismatch(oscillator: Oscillator, amplitude: float, workspace: ResponseWorkspace) -> float:
    """`exact_maximum` from the averaged one in `workspace.top`."""
    top, nodes = workspace.top, workspace.nodes
    # Outside of contact the harmonics lift the tip, by which the maximum lies nearer to the surface than averaged.
    lifted = exact_mismatch(oscillator, amplitude, 0.0, workspace)
    near = top.gap + (min(nodes.w[OUT], 0.0) if math.isfinite(lifted) else 0.0)
    step = min(WIDE * (reach_of(oscillator.p) + abs(near)), MOST_OF_DEPTH * abs(top.gap))
    return exact_maximum(oscillator, amplitude, near, step, workspace)


@kernel
def side_of(highest: float) -> int:
    """Side on which the tip passes an amplitude, from the maximum of its exact mismatch; UNCLEAR too near to zero."""
    if not abs(highest) >= CLOSEST:
        return UNCLEAR
    return ATTRACTIVE if highest > 0.0 else REPULSIVE


@kernel
def decide_exactly(oscillator: Oscillator, setpoint: float, amplitude: float, workspace: ResponseWorkspace) -> int:
    """Side on which the tip passes the amplitude at which the attractive branch is nearest to its end; or UNCLEAR.

    Where that is is known for harmonic orbits. Of the maxima around it, not below the setpoint, the least counts.
    """
    lever, fit = oscillator.lever, workspace.fit
    highest = highest_exact_mismatch(oscillator, amplitude, workspace)
    if abs(highest) < TIGHT and amplitude < (1.0 + SPREAD) * narrowest_amplitude_ratio(lever) * free_amplitude(lever):
        gap, step = fit.gap, fit.step
        above = exact_maximum(oscillator, (1.0 + SPREAD) * amplitude, gap, step, workspace)
        below = exact_maximum(oscillator, (1.0 - SPREAD) * amplitude, gap, step, workspace)
        at, least, bend = parabola((-1.0, below), (0.0, highest), (1.0, above))
        if not (bend > 0.0 and abs(at) < 2.0):
            return UNCLEAR
        highest = least + 0.5 * bend * max((setpoint / amplitude - 1.0) / SPREAD - at, 0.0) ** 2
    return side_of(highest)


@kernel
def fill_orbit_outside_maximum(
    oscillator: Oscillator, amplitude: float, harmonic: HarmonicOrbit, workspace: ResponseWorkspace
) -> bool:
    """Fill `harmonic` with the exact orbit, roughly, at a gap above that of the maximum; False if it is not found.

    The mismatch goes with the square of the distance from its maximum, which is sought near that in `workspace.fit`.
    """
    fit, state = workspace.fit, workspace.state
    if fit.amplitude != amplitude:
        exact_maximum(oscillator, amplitude, fit.gap, fit.step, workspace)
    highest, fall = fit.mismatch, 0.5 * fit.curvature
    for _ in range(MOST_STEPS_TO_END):
        if not (highest > 0.0 and fall < 0.0):
            return False
        x = math.sqrt(-highest / fall)
        h = exact_mismatch(oscillator, amplitude, fit.gap + x, workspace)
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
