"""Where an orbit of passes, or the part of it between two nodes, is deepest."""

from __future__ import annotations

import math

from phasemap._kernels.compilation import kernel
from phasemap._kernels.orbits.response.nodes import (
    ENTRY,
    EXIT,
    GAUSS_X,
    IN,
    OUT,
    TOUCH,
    N,
    Nodes,
    contact_node,
    first_of,
    parts_of,
    rate_at_node,
)
from phasemap._kernels.quadrature import barycentric

BARYCENTRIC = barycentric(GAUSS_X)


@kernel
def apex_between(
    amplitude: float, theta0: float, w0: float, u0: float, theta1: float, w1: float, u1: float
) -> tuple[float, float]:
    """Largest A cos(theta) + w between two nodes and its angle, or -infinity where it has none there.

    w is the cubic with the values and slopes (w, u) at both nodes, the cosine is exact.
    """
    rise, fall = u0 - amplitude * math.sin(theta0), u1 - amplitude * math.sin(theta1)
    if not rise > 0.0 >= fall:
        return -math.inf, theta0
    h = theta1 - theta0
    x, y, w, theta = rise / (rise - fall), 0.0, 0.0, 0.0
    for _ in range(3):
        y, theta = 1.0 - x, theta0 + x * h
        w = y * y * (1.0 + 2.0 * x) * w0 + x * x * (1.0 + 2.0 * y) * w1 + h * x * y * (y * u0 - x * u1)
        turn = 6.0 * x * y * (w1 - w0) / h + y * (y - 2.0 * x) * u0 + x * (x - 2.0 * y) * u1
        x += (turn - amplitude * math.sin(theta)) / (rise - fall)
    return amplitude * math.cos(theta) + w, theta


@kernel
def apex_of(nodes: Nodes, amplitude: float) -> float:
    """Largest A cos(theta) + w, in contact or, without one, where the elements before and after it meet."""
    touching = nodes.touches == 1
    theta, w, u = nodes.theta, nodes.w, nodes.u
    first = TOUCH if touching else OUT
    before = first if touching else IN
    most = -math.inf
    for k in range(N * parts_of(nodes) if touching else N):
        j = first + k if k < N else contact_node(k)
        i, before = before, j
        most = max(most, amplitude * nodes.cos[j] + w[j])
        if not rate_at_node(nodes, amplitude, i) > 0.0 >= rate_at_node(nodes, amplitude, j):
            continue  # no largest one between, for which two sines more would be taken
        between, angle = apex_between(amplitude, theta[i], w[i], u[i], theta[j], w[j], u[j])
        if touching and between > most:
            between = amplitude * math.cos(angle) + _in_contact(nodes, angle)
        most = max(most, between)
    return most


@kernel
def _in_contact(nodes: Nodes, angle: float) -> float:
    """Return w at an angle in contact, by the polynomial through the nodes of its element."""
    centre, half = 0.5 * (nodes.theta[ENTRY] + nodes.theta[EXIT]), 0.5 * (nodes.theta[EXIT] - nodes.theta[ENTRY])
    x, first = math.asin((angle - centre) / half) / math.pi + 0.5, TOUCH
    if parts_of(nodes) > 1:
        part = min(int(parts_of(nodes) * x), parts_of(nodes) - 1)
        first, x = first_of(part), parts_of(nodes) * x - part
    above, below = 0.0, 0.0
    for j in range(N):
        if x == GAUSS_X[j]:
            return float(nodes.w[first + j])
        share = BARYCENTRIC[j] / (x - GAUSS_X[j])
        above += share * nodes.w[first + j]
        below += share
    return above / below
