"""How long things take, on one core and after compilation."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")

MOST = 12  # repeats


def best_of(call: Callable[[], T], budget: float) -> tuple[float, T]:
    """Call again and again for about `budget` seconds; the shortest time [s] is the one that nothing disturbed.

    `budget`: [s].
    Returns the shortest time [s], and what the last call gave.

    Examples
    --------
    >>> seconds, result = best_of(lambda: 42, 0.0)
    >>> seconds < 1, result
    (True, 42)
    """
    best, spent, repeats = float("inf"), 0.0, 0
    while repeats == 0 or (spent < budget and repeats < MOST):
        started = time.perf_counter()
        result = call()
        taken = time.perf_counter() - started
        best, spent, repeats = min(best, taken), spent + taken, repeats + 1
    return best, result
