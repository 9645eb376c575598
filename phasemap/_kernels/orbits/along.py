"""Nodes along an orbit that is solved, with all its harmonics, for integrals over it.

They are those of `response`: passes of the lever's response to the force, at the tip offset and mean deflection that
the orbit has, until they settle. Where they do not, or there is a neck, `around.harmonic` is what is left.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels.columns import ALPHA0, LONGRANGE, RELEASE
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law
from phasemap._kernels.lever import reach_of
from phasemap._kernels.orbits.around import COS, DEPTH, RATE, SIN, TOUCHES, WEIGHT
from phasemap._kernels.orbits.response import nodes as free
from phasemap._kernels.orbits.response.passes import AMP, DRAG, MEAN, PUSH, E, balance, start

MOST_PASSES = 8
SETTLED = 2e-3  # of the depth, or of the reach, may be left to move, as if passes went on like a geometric series
SLOWEST = 0.025  # alpha0 above which they do not: a hundredth of that may be left there


@kernel
def along(
    law: Law, p: np.ndarray, lever: np.ndarray, amplitude: float, e: float, f: np.ndarray, state: np.ndarray,
    at: np.ndarray,
) -> int:  # fmt: skip
    """Fill the nodes of the orbit with all harmonics, e = z0 - mean deflection; 0 where the passes do not settle.

    `f` and `state` are the scratch arrays of `response`.
    """
    touching, longrange, reach = e < amplitude, p[LONGRANGE] != 0.0, reach_of(law, p)
    state[:] = 0.0
    state[AMP], state[E] = amplitude, e
    if p[RELEASE] < 0.0 or not start(law, p, lever, reach, f, state):
        return 0
    middle, allowed = free.TOUCH + free.N // 2 if touching else free.OUT, SETTLED * max(amplitude - e, reach)
    if lever[ALPHA0] > SLOWEST:
        allowed *= 0.01
    before, last, settled = 0.0, 0.0, False
    for _ in range(MOST_PASSES):
        free.respond(f, lever, state[MEAN], state[PUSH], state[DRAG], touching, longrange)
        balance(law, p, lever, f, state, touching, True)
        if not (math.isfinite(f[free.W, middle]) and f[free.THETA, free.EXIT] >= f[free.THETA, free.ENTRY]):
            return 0
        change = abs(f[free.W, middle] - before)
        ratio = min(max(change / last, 0.1), 0.9) if last > 0.0 else 0.9
        settled = change * ratio / (1.0 - ratio) < allowed
        if settled:
            break
        before, last = f[free.W, middle], change
    if not settled:
        return 0
    count = 0
    for element in range(3):
        if not (touching if element == 1 else longrange):
            continue
        for i in range(free.N):
            j = free.N * element + i
            c, s = f[free.COS, j], f[free.SIN, j]
            at[COS, count], at[SIN, count] = c, s
            at[DEPTH, count] = amplitude * c + f[free.W, j] - e
            at[RATE, count] = f[free.U, j] - amplitude * s
            at[WEIGHT, count] = free.WEIGHTS[i] * f[free.WEIGHT, j]
            at[TOUCHES, count] = 1.0 if element == 1 else 0.0
            count += 1
    return count
