"""Where between two nodes of an orbit the tip is deepest."""

from __future__ import annotations

import math

from phasemap._kernels.compilation import kernel


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
