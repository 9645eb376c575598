"""Which pixels have an attractive and a repulsive orbit at the setpoint, by first-order theory on a grid.

Also from which adhesion on there are both. This chooses the cases of a regime, so it must not ask a solver: a pixel
that a solver finds hard would never be drawn.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from benchmarks.accuracy.equation import Case, Equation

Array = np.ndarray

NODES = 96  # of the angle, crowded where the tip is near the surface
HEIGHTS = 240  # of the tip offset
LEAST, MOST, GROWTH = 5e-3, 0.6, 1.5  # adhesions [J/m2] among which the end of the attractive branch is looked for
HALVINGS = 6  # then, to a percent, by which first-order theory is off anyway


def is_bistable(equation: Equation) -> bool:
    """Whether the drive passes its value three times on the way down: attractive, unstable and repulsive orbit.

    `equation`: driven near resonance, at a quality factor of 50 or more: first-order averaging has to hold.

    Examples
    --------
    >>> from benchmarks.accuracy.equation import Case
    >>> sticky = Case(40.0, 400.0, 16e-9, 10e-9, 2e9, 0.1, 0.0, 0.35, 0.8, decay_length=0.3e-9)
    >>> clean = Case(40.0, 400.0, 16e-9, 10e-9, 2e9, 0.0, 0.0, 0.35, 0.8)
    >>> is_bistable(Equation.of(sticky)), is_bistable(Equation.of(clean))
    (True, False)
    """
    depth = _depths(equation)
    push, damping = _averages(equation, depth)
    needed = np.hypot(1 - equation.omega**2 + push, 2 * equation.omega * damping)
    crossings = np.flatnonzero(np.diff(np.sign(needed - equation.base)))
    return len(crossings) >= 3 and bool(push[crossings[0]] < 0 < push[crossings[-1]])


def end_of_attraction(case: Case) -> float | None:
    """Least adhesion [J/m2] with an attractive orbit beside the repulsive one, by first-order theory; None without one.

    Parameters
    ----------
    case : Case
        Whatever its adhesion.

    Examples
    --------
    >>> from benchmarks.accuracy.equation import Case
    >>> end = end_of_attraction(Case(40.0, 400.0, 16e-9, 10e-9, 2e9, 0.0, 0.0, 0.35, 0.8, decay_length=0.3e-9))
    >>> 0.075 < end < 0.1
    True
    """

    def begun(adhesion: float) -> bool:
        return is_bistable(Equation.of(replace(case, adhesion=adhesion)))

    high = LEAST
    while not begun(high):
        high *= GROWTH
        if high > MOST:
            return None
    low = high / GROWTH
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if begun(middle) else (middle, high)
    return 0.5 * (low + high)


def _depths(equation: Equation) -> Array:
    """How far below the undeformed surface the tip would come, from far to pressed in [A]."""
    finest = 0.01 * (equation.decay or 0.01)
    return np.asarray(finest * np.sinh(np.linspace(-np.arcsinh(0.5 / finest), np.arcsinh(0.5 / finest), HEIGHTS)))


@cache
def _angles() -> tuple[Array, Array]:
    """Nodes and weights of the angle."""
    x, weight = np.polynomial.legendre.leggauss(NODES)
    x, weight = 0.5 * (x + 1), 0.5 * weight
    return np.pi * x * x, 2 * np.pi * x * weight


def _averages(equation: Equation, depth: Array) -> tuple[Array, Array]:
    """omega_e^2 - 1 and alpha_e of Wang (1999), Eqs. 6 and 7, at every depth."""
    angle, weight = _angles()
    d = depth[:, np.newaxis] - 1 + np.cos(angle)
    pressed = np.maximum(d, 0)
    pull = equation.pull
    attraction = pull / (1 - np.minimum(d, 0) / equation.decay) ** 2 if equation.decay else pull * (d >= 0)
    force = equation.stiff * pressed * np.sqrt(pressed) - attraction
    loss = np.where(d > 0, equation.loss * pressed**equation.exponent, 0.0)
    push = 2 / np.pi * (force * np.cos(angle)) @ weight
    return push, equation.alpha0 + 2 / np.pi * (loss * np.sin(angle) ** 2) @ weight
