"""The tap of an orbit that is solved: how fast the tip moves at each depth in the contact.

From its deepest point the tip is followed out of the contact, and back in time into it, by the equation of motion. The
variables are q = sqrt(d) and v, with dtau = 2 q ds, as in `time.march`: in these all is smooth up to q = 0, and what is
summed vanishes there, so that the end need not be located exactly.

What the orbit does not tell is when the tip is deepest: that is at theta = 0 if it moves as a sine, and else where the
force of the tap has the sine that the orbit's has.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, contact_force, contact_slope, damping

if TYPE_CHECKING:
    from phasemap._kernels.orbits.time.runge_kutta import Numbers

STEPS, FEWER, MOST = 10, 5, 80  # of a way, of order 4: so many and more with damping; at first; where all is slow


@kernel
def _slopes(law: Law, p: Any, bare: Any, lever: np.ndarray, z0: float, lag: float, y: Numbers) -> Numbers:
    """Changes with s of q, v, tau, and integrals of F' v^2, f cos and f sin over tau."""
    q, v, time = y[:3]
    d = max(q, 0.0) ** 2
    f = contact_force(law, d, p) / lever[col.STIFFNESS] + 2.0 * damping(law, d, p) * v
    turn = lever[col.OMEGA] * time
    a = lever[col.BASE] * math.cos(turn + lag) - (z0 + d) - f - 2.0 * lever[col.ALPHA0] * v
    w = 2.0 * q
    return v, w * a, w, w * contact_slope(law, d, bare) * v * v, w * f * math.cos(turn), w * f * math.sin(turn)


@kernel(inline=True)
def _moved(y: Numbers, h: float, s: Numbers) -> Numbers:
    return (
        y[0] + h * s[0], y[1] + h * s[1], y[2] + h * s[2], y[3] + h * s[3], y[4] + h * s[4], y[5] + h * s[5],
    )  # fmt: skip


@kernel
def _way(law: Law, p: Any, bare: Any, lever: np.ndarray, z0: float, lag: float, deepest: float, steps: int) -> Numbers:
    """Integrals along one way, in where `steps` is negative, up to where the tip leaves or as good as rests."""
    y = (math.sqrt(deepest), 0.0, 0.0, 0.0, 0.0, 0.0)
    slows = 4.0 * y[0] * damping(law, deepest, p)
    falls = -_slopes(law, p, bare, lever, z0, lag, y)[1] / (2.0 * y[0])
    h = 1.0 / (steps * (4.0 / math.pi) * math.sqrt(0.5 * max(falls, 0.0)) + math.copysign(slows, steps))
    for _ in range(MOST):
        first = _slopes(law, p, bare, lever, z0, lag, y)
        last = y[0] <= -first[0] * h
        size = -y[0] / first[0] if last else h
        second = _slopes(law, p, bare, lever, z0, lag, _moved(y, 0.5 * size, first))
        third = _slopes(law, p, bare, lever, z0, lag, _moved(y, 0.5 * size, second))
        fourth = _slopes(law, p, bare, lever, z0, lag, _moved(y, size, third))
        y = _moved(
            _moved(_moved(_moved(y, size / 6.0, first), size / 3.0, second), size / 3.0, third), size / 6.0, fourth
        )
        if last or not y[1] * h < 0.0:
            break
    return y


@kernel
def stored(law: Law, p: Any, bare: Any, lever: np.ndarray, row: np.ndarray, neck: float) -> float:
    """Integral of F' (dd/dtheta)^2 over theta [J], F the force of `bare`, of a tip that leaves the contact.

    Parameters
    ----------
    row : ndarray
        Result row of the tip.
    neck : float
        Energy that a neck takes per cycle [J].
    """
    amplitude, lag = row[col.AMPLITUDE], 0.5 * math.pi - row[col.PHASE]
    sine = math.pi * (2.0 * lever[col.ALPHA0] * lever[col.OMEGA] * amplitude - lever[col.BASE] * math.sin(lag))
    sine += neck / (lever[col.STIFFNESS] * amplitude)
    late, found = 0.0, math.nan
    for steps in (FEWER, STEPS):
        deepest, z0 = row[col.INDENTATION], row[col.TIP_OFFSET]
        inward = _way(law, p, bare, lever, z0, lag + late, deepest, -steps)
        outward = _way(law, p, bare, lever, z0, lag + late, deepest, steps)
        # Inward the integrals are negative. The sine of the force about its middle, turned by `late`, is the orbit's.
        found = (outward[3] - inward[3]) / lever[col.OMEGA]
        late = (sine / lever[col.OMEGA] - outward[5] + inward[5]) / (outward[4] - inward[4])
    return found
