"""Deepest point of an orbit by passes, or of the part of it between two nodes."""

from __future__ import annotations

import math

from phasemap._kernels.compilation import kernel
from phasemap._kernels.orbits.response.nodes import (
    IN,
    OUT,
    TOUCH,
    N,
    Nodes,
    contact_node,
    parts_of,
    rate_at_node,
)


@kernel
def apex_between(amplitude: float, theta0: float, w0: float, u0: float, theta1: float, w1: float, u1: float) -> float:
    """Largest A cos(theta) + w between two nodes, or -infinity where it has none there.

    w is the cubic with the values and slopes (w, u) at both nodes, the cosine is exact.
    """
    rise, fall = u0 - amplitude * math.sin(theta0), u1 - amplitude * math.sin(theta1)
    if not rise > 0.0 >= fall:
        return -math.inf
    h = theta1 - theta0
    x, y, w, theta = rise / (rise - fall), 0.0, 0.0, 0.0
    for _ in range(3):
        y, theta = 1.0 - x, theta0 + x * h
        w = y * y * (1.0 + 2.0 * x) * w0 + x * x * (1.0 + 2.0 * y) * w1 + h * x * y * (y * u0 - x * u1)
        turn = 6.0 * x * y * (w1 - w0) / h + y * (y - 2.0 * x) * u0 + x * (x - 2.0 * y) * u1
        x += (turn - amplitude * math.sin(theta)) / (rise - fall)
    return amplitude * math.cos(theta) + w


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
        between = apex_between(amplitude, theta[i], w[i], u[i], theta[j], w[j], u[j])
        most = max(most, between)
    return most
