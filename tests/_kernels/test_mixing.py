"""Anderson's mixing, on passes whose fixed point is known."""

import numpy as np

from phasemap._kernels.orbits.response.mixing import KEPT_CHANGES, keep_motion, mix, new_past
from phasemap._kernels.orbits.response.nodes import ALL, TOUCH, N, Nodes


def test_mixed_passes_end_where_errors_have_no_more_shapes_than_are_kept_though_plain_ones_diverge() -> None:
    # A linear pass multiplies DEPTH shapes of the error in w and e by factors of up to 1.7 in size. As many changes
    # tell all of them, so that the pass after them leaves only what ALIKE = 1e-12 does, times the condition of the
    # shapes: 1e-6 of the error at first is allowed. Without mixing it would be some 20 times as large after six passes.
    rng = np.random.default_rng(3)
    shapes, factors = np.linalg.qr(rng.normal(size=(ALL + 1, KEPT_CHANGES)))[0], np.array([-1.7, -0.9, 0.5, 1.4])
    end, f = rng.normal(size=ALL + 1), Nodes()
    at = end + shapes @ rng.normal(size=KEPT_CHANGES)
    off = np.linalg.norm((at - end)[:-1][TOUCH : TOUCH + N] - (at - end)[-1])
    past = new_past(f, True)
    for passes in range(KEPT_CHANGES + 2):
        f.w[:ALL] = at[:-1]
        keep_motion(f, past)
        after = end + shapes @ (factors * (shapes.T @ (at - end)))
        f.w[:ALL] = after[:-1]
        at = np.append(f.w[:ALL], at[-1] + mix(f, after[-1] - at[-1], passes, past))
        at[:-1] = f.w[:ALL]
    assert np.linalg.norm((at - end)[:-1][TOUCH : TOUCH + N] - (at - end)[-1]) < 1e-6 * off
