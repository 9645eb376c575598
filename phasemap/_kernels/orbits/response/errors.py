"""Errors that are stated of an orbit by passes: of what later passes would still change, and of the nodes."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels.columns import DRIVE
from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.lever import beside_resonance
from phasemap._kernels.orbits.response.nodes import (
    GAUSS_WEIGHTS,
    HIGHEST,
    N,
    Nodes,
    first_of_element,
    force_acts_on,
    parts_of,
)
from phasemap._kernels.orbits.response.state import PassState, slope_by_tip_offset

PASS_SAFETY = 8.0  # over the error that two changes tell
LEAST_RATIO, MOST_RATIO = 0.04, 0.9  # of successive changes, that is counted on
RATIO_FALLS = 0.4  # the same, over the ratio before
PASS_FLOOR_PHASE = 1e-8  # [rad], least error to be expected
PASS_FLOOR_HEIGHT = 2e-15  # [m], the same
SHARE_WITHIN = 0.1  # of the nodes' estimate that is taken within a linewidth of the resonance
SHARE_BESIDE = 0.01  # the same beside it


@kernel(fastmath=ANY_ORDER)
def quadrature_error(lever: np.ndarray, nodes: Nodes, state: PassState) -> float:
    """Estimated error of P, S and mean deflection [m] from the finite number of nodes: theory, Eq. (errors-2).

    The error of Gauss nodes is about the square of what their highest polynomials still find in the integrand, over the
    integral. A tenth of that is a hundred times the error and more; beside resonance, where contacts are long, no more
    than a hundredth is taken. What the nodes miss of the motion by higher modes counts as if e were off by it.
    """
    rest = 0.0
    for element in range(2 + parts_of(nodes)):
        if not force_acts_on(nodes, element):
            continue
        even, odd, size, first = 0.0, 0.0, 0.0, first_of_element(element)
        for j in range(N):
            share = nodes.g[first + j] * nodes.weight[first + j]
            even += HIGHEST[0, j] * share
            odd += HIGHEST[1, j] * share
            size += GAUSS_WEIGHTS[j] * abs(share)
        rest += (abs(even) + abs(odd)) ** 2 / max(size, 1e-300)
    rest *= SHARE_BESIDE if beside_resonance(lever) else SHARE_WITHIN
    return rest + 0.5 * nodes.missed * abs(state.slope) * lever[DRIVE]


@kernel
def remaining_change_ratio(ratio: float, ratio_before: float) -> float:
    """Cautious ratio of successive changes to come, from the last two ratios: theory, Eq. (errors-1)."""
    return min(max(ratio, RATIO_FALLS * ratio_before, LEAST_RATIO), MOST_RATIO)


@kernel
def tip_offset_error_factor(lever: np.ndarray, state: PassState) -> float:
    """Error of the tip offset per error of P, S and the mean deflection."""
    return 1.0 + 4.0 / abs(slope_by_tip_offset(lever, state) * lever[DRIVE])


@kernel
def estimate_pass_errors(
    lever: np.ndarray, state: PassState, rest: float, phase_left: float, height_left: float, nodes: float
) -> None:
    """Fill in the errors of phase and tip offset after last changes of this size, if they go on by the ratio `rest`."""
    share = PASS_SAFETY * rest / (1.0 - rest)
    # The conservative force does no work round an orbit.
    wrong = nodes + 3.0 * abs(state.work) / (math.pi * state.amplitude)
    state.phase_error = share * phase_left + wrong / lever[DRIVE] + PASS_FLOOR_PHASE
    state.tip_offset_error = share * height_left + PASS_FLOOR_HEIGHT
    state.tip_offset_error += wrong * tip_offset_error_factor(lever, state)
