"""Whether a converged orbit of the lever's response is one that a tip keeps to, as far as a monodromy matrix tells."""

from __future__ import annotations

import math

from phasemap._kernels.columns import ALPHA0, DAMPING, LONGRANGE, OMEGA, STIFFNESS
from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.law import Oscillator, contact_slope, damping, longrange_slope
from phasemap._kernels.lever import low_q, mode_of, modes_of
from phasemap._kernels.orbits.response.apex import apex_between
from phasemap._kernels.orbits.response.motion import respond
from phasemap._kernels.orbits.response.nodes import (
    ENTRY,
    EXIT,
    GAUSS_WEIGHTS,
    IN,
    LATE,
    OUT,
    TOUCH,
    N,
    Nodes,
    contact_node,
    fill_mode,
    grade_outer_nodes,
    lay_nodes,
    parts_of,
)
from phasemap._kernels.orbits.response.stability_of_several_modes import is_held
from phasemap._kernels.orbits.response.state import ENERGY_LEFT, PassState, relative_energy_defect, slope_by_tip_offset

DOUBLING = 0.75  # of the trace of the monodromy matrix at which a period doubles: nearer than this is not sure
ASIDE = 1e-3  # of the depth or the reach, by which nodes may lie beside the contact
LEAST_SLOPE = 0.05  # of the mismatch over the depth: flatter is too near to where the branch ends


@kernel(fastmath=ANY_ORDER)
def kicked(c: float, s: float, kick: float, x: float, y: float) -> tuple[float, float]:
    """What a stiffness at an angle makes of a free lever's motion x cos(nu theta) + y sin(nu theta)."""
    force = kick * (c * x + s * y)
    return x + force * s, y - force * c


@kernel(fastmath=ANY_ORDER)
def turned(squared: float, width: float, v: float, u: float) -> tuple[float, float]:
    """Motion v and its rate u after an angle `width`, under a stiffness that stays: v'' = -squared v."""
    z = squared * width * width
    c = 1.0 - z / 2.0 * (1.0 - z / 12.0 * (1.0 - z / 30.0))
    s = width * (1.0 - z / 6.0 * (1.0 - z / 20.0 * (1.0 - z / 42.0)))
    return c * v + s * u, c * u - squared * s * v


@kernel
def trace_of(a: float, nu: float, x1: float, y1: float, x2: float, y2: float) -> float:
    """Trace of the monodromy matrix: after all kicks (1, 0) is (x1, y1), and (0, 1) is (x2, y2)."""
    c, s = math.cos(2 * math.pi * nu), math.sin(2 * math.pi * nu)
    return math.exp(2 * math.pi * a) * ((x1 + y2) * c + (y1 - x2) * s)


@kernel(fastmath=ANY_ORDER, shared=True)
def orbit_is_kept(
    oscillator: Oscillator, reach: float, nodes: Nodes, state: PassState, dent: float, recovery: float
) -> bool:
    """Whether the converged orbit touches where it was taken to, and period doubling is far.

    A `dent` [m] that the contact leaves comes back with the rate `recovery` over the angle.

    The trace of the monodromy matrix is that of the free lever kicked at every node outside contact by the stiffness
    there, and turned faster by it in contact: theory, Eq. (stability-6). A period doubles where it is -1 less the
    determinant, which all damping makes smaller; the trace leaves out that of the contact, which would bring it nearer
    to zero.
    """
    law, p, lever = oscillator
    if modes_of(lever) > 1:
        return _several_modes_are_kept(oscillator, reach, nodes, state)
    amplitude, e = state.amplitude, state.centre
    omega, alpha0, inverse_k = lever[OMEGA], lever[ALPHA0], 1.0 / lever[STIFFNESS]
    touching, longrange = nodes.theta[EXIT] > nodes.theta[ENTRY], p[LONGRANGE] != 0.0
    a, nu = -alpha0 / omega, math.sqrt(1.0 - alpha0 * alpha0) / omega
    x1, y1, x2, y2 = 1.0, 0.0, 0.0, 1.0
    fill_mode(nodes, mode_of(lever, 0))
    depth = max(reach + max(e - amplitude, 0.0), amplitude - e)
    little, decay = 1e-3 * depth, -4.0 * math.pi * a
    late = (parts_of(nodes) - 1) * N  # nodes of a later half of the contact
    for k in range(3 * N + late):
        # In the order of time: the element before contact runs backwards.
        j = N - 1 - k if k < N else contact_node(k - N) if k < 2 * N + late else k - late
        in_contact, width = (
            N <= k < 2 * N + late,
            GAUSS_WEIGHTS[j % N if j < LATE else (j - LATE) % N] * nodes.weight[j],
        )
        if not (touching if in_contact else longrange):
            continue
        d = amplitude * nodes.cos[j] + nodes.w[j] - e
        if dent > 0.0 and OUT <= j < OUT + N:
            d -= dent * math.exp((nodes.theta[EXIT] - nodes.theta[j]) * recovery)
        if d < -little if in_contact else d > little:
            return False
        slope = contact_slope(law, max(d, 0.0), p) if in_contact else longrange_slope(law, min(d, 0.0), p)
        if in_contact and p[DAMPING] != 0.0:
            decay += 2.0 / omega * width * damping(law, max(d, 0.0), p)
        squared = inverse_k * slope / (omega * omega)
        if not in_contact:
            x1, y1 = kicked(nodes.turn_cos[j], nodes.turn_sin[j], width * squared / nu, x1, y1)
            x2, y2 = kicked(nodes.turn_cos[j], nodes.turn_sin[j], width * squared / nu, x2, y2)
            continue
        if j == TOUCH:
            c, s = nodes.turn_cos[ENTRY], nodes.turn_sin[ENTRY]
            x1, y1, x2, y2 = c * x1 + s * y1, nu * (c * y1 - s * x1), c * x2 + s * y2, nu * (c * y2 - s * x2)
        x1, y1 = turned(nu * nu + squared, width, x1, y1)
        x2, y2 = turned(nu * nu + squared, width, x2, y2)
        if k == 2 * N + late - 1:
            c, s = nodes.turn_cos[EXIT], nodes.turn_sin[EXIT]
            x1, y1, x2, y2 = c * x1 - s * y1 / nu, s * x1 + c * y1 / nu, c * x2 - s * y2 / nu, s * x2 + c * y2 / nu
    trace = trace_of(a, nu, x1, y1, x2, y2)
    far = trace > -DOUBLING * (1.0 + math.exp(-decay))
    return (
        far
        and slope_by_tip_offset(lever, state) * depth < -LEAST_SLOPE
        and abs(relative_energy_defect(lever, state)) < ENERGY_LEFT
    )


@kernel
def _several_modes_are_kept(oscillator: Oscillator, reach: float, nodes: Nodes, state: PassState) -> bool:
    """Whether an orbit of a lever of several modes is kept: it touches once, is stable, and its energy closes."""
    lever = oscillator.lever
    if nodes.theta[EXIT] > nodes.theta[ENTRY]:
        if not touches_once(oscillator, reach, nodes, state):
            return False
    elif (
        max(state.amplitude * nodes.cos[IN] + nodes.w[IN], state.amplitude * nodes.cos[OUT] + nodes.w[OUT])
        > state.centre
    ):
        return False
    depth = max(reach + max(state.centre - state.amplitude, 0.0), state.amplitude - state.centre)
    if low_q(lever):  # a stiff sample throws several modes back from far less than what the drive is balanced over
        depth = state.amplitude
    good = (
        slope_by_tip_offset(lever, state) * depth < -LEAST_SLOPE
        and abs(relative_energy_defect(lever, state)) < ENERGY_LEFT
    )
    return good and is_held(oscillator, nodes, state)


@kernel
def touches_once(oscillator: Oscillator, reach: float, nodes: Nodes, state: PassState) -> bool:
    """Whether the tip touches at the nodes in contact and nowhere else."""
    p, lever = oscillator.p, oscillator.lever
    amplitude, e, deepest = state.amplitude, state.centre, 0.0
    if p[LONGRANGE] == 0.0:  # no force, so no nodes yet
        grade_outer_nodes(nodes, amplitude, e, (1e-3 if modes_of(lever) == 1 else 1.0) * amplitude, nodes.theta[EXIT])
        lay_nodes(nodes, nodes.theta[ENTRY], nodes.theta[EXIT], True)
        for j in range(N):
            nodes.g[IN + j], nodes.g[OUT + j] = 0.0, 0.0
        respond(nodes, lever, state.mean_force, state.push, state.drag, True, True)
    for k in range(N * parts_of(nodes)):
        deepest = max(deepest, amplitude * nodes.cos[contact_node(k)] + nodes.w[contact_node(k)] - e)
    aside = ASIDE * max(deepest, reach)
    for k in range(N * parts_of(nodes)):
        if amplitude * nodes.cos[contact_node(k)] + nodes.w[contact_node(k)] - e < -aside:
            return False
    theta, w, u = nodes.theta, nodes.w, nodes.u
    for side in range(2):
        for j in range(IN if side == 0 else OUT, (IN if side == 0 else OUT) + N):
            highest = amplitude * nodes.cos[j] + w[j]
            if modes_of(lever) > 1 and j % N > 0:
                i, k = (j, j - 1) if side == 0 else (j - 1, j)
                between, _ = apex_between(amplitude, theta[i], w[i], u[i], theta[k], w[k], u[k])
                highest = max(highest, between)
            if highest - e > aside:
                return False
    return True
