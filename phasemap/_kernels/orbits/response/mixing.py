"""Passes of the lever's response made fewer: the next motion from the last few passes, by Anderson's mixing.

Beside the resonance a pass leaves up to a third and more of what the one before left, mostly in the same few shapes of
w. Let x be (w, w', e) before a pass and r what the pass changes. The last few changes of x from pass to pass, Dx, and
those of r, Dr, tell where the next pass would change least, as far as all is linear: at

    x + r - sum_i c_i (Dx_i + Dr_i),    c the least squares of r - sum_i c_i Dr_i

at the nodes in contact, of d = A cos(theta) + w - e: theory, Eq. (response-8). D. G. Anderson, J. ACM 12 (1965) 547.
"""

from __future__ import annotations

import numpy as np

from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.dense import eliminate
from phasemap._kernels.orbits.response.nodes import N, Nodes, contact_node, count_of, parts_of

KEPT_CHANGES = 4  # changes that are kept
REGULARISATION = 1e-12  # of its square, that is added to each, so that changes of the same shape do no harm
# Rows of the scratch array, whose last column is for e.
PAST_MOTION = 0  # w and w' before the pass
PAST_ADDED = 2  # what mixing last added to w and w'
PAST_MISSED = 4  # what the last pass changed of the depth
PAST_CHANGES = 5  # the first of the rows of changes
ROWS_A_CHANGE = 3  # Dx + Dr in w and in w', and Dr in the depth


@kernel
def new_past(f: Nodes, wanted: bool) -> np.ndarray:
    """Return an empty scratch array, or none at all."""
    return np.empty((PAST_CHANGES + ROWS_A_CHANGE * KEPT_CHANGES if wanted else 0, count_of(f) + 1))


@kernel
def keep_motion(f: Nodes, past: np.ndarray) -> None:
    """Keep the motion before a pass."""
    for j in range(count_of(f)):
        past[PAST_MOTION, j], past[PAST_MOTION + 1, j] = f.w[j], f.u[j]


@kernel(fastmath=ANY_ORDER)
def mix(f: Nodes, rise: float, passes: int, past: np.ndarray) -> float:
    """Replace the motion after a pass, which changes e by `rise` [m], by the mixed one; returns the change of e.

    `passes` says how many were mixed before.
    """
    width, last, n = count_of(f), count_of(f), N * parts_of(f)
    newest, used = PAST_CHANGES + ROWS_A_CHANGE * ((passes - 1) % KEPT_CHANGES), min(passes, KEPT_CHANGES)
    if passes > 0:
        for j in range(width):
            past[newest, j] = f.w[j] - past[PAST_MOTION, j] + past[PAST_ADDED, j]
            past[newest + 1, j] = f.u[j] - past[PAST_MOTION + 1, j] + past[PAST_ADDED + 1, j]
        past[newest, last] = rise + past[PAST_ADDED, last]
    for k in range(n):
        j = contact_node(k)
        missed = f.w[j] - past[PAST_MOTION, j] - rise
        if passes > 0:
            past[newest + 2, k] = missed - past[PAST_MISSED, k]
        past[PAST_MISSED, k] = missed
    system = np.empty((KEPT_CHANGES, KEPT_CHANGES + 1))
    for a in range(used):
        one = past[PAST_CHANGES + ROWS_A_CHANGE * a + 2]
        for b in range(a + 1):
            system[a, b] = system[b, a] = dot(one, past[PAST_CHANGES + ROWS_A_CHANGE * b + 2], n)
        system[a, a] *= 1.0 + REGULARISATION
        system[a, KEPT_CHANGES] = dot(one, past[PAST_MISSED], n)
    for j in range(width + 1):
        past[PAST_ADDED, j], past[PAST_ADDED + 1, j] = 0.0, 0.0
    if eliminate(system, used):
        for a in range(used):
            share, row = system[a, KEPT_CHANGES], PAST_CHANGES + ROWS_A_CHANGE * a
            for j in range(width + 1):
                past[PAST_ADDED, j] -= share * past[row, j]
                past[PAST_ADDED + 1, j] -= share * past[row + 1, j]
    for j in range(width):
        f.w[j] += past[PAST_ADDED, j]
        f.u[j] += past[PAST_ADDED + 1, j]
    return rise + past[PAST_ADDED, last]


@kernel(fastmath=ANY_ORDER)
def dot(one: np.ndarray, other: np.ndarray, n: int) -> float:
    """Sum of products of the first n entries."""
    total = 0.0
    for k in range(n):
        total += one[k] * other[k]
    return total
