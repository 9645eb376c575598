"""How the controller comes to the setpoint."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Engage:
    """Each pixel engaged anew from far away, quasi-statically.

    The tip follows the stable orbit while its offset decreases, jumps where the orbit folds, and stops where the
    amplitude first reaches the setpoint. The branch (attractive or repulsive) is therefore the physical one and does
    not depend on the solver.

    Examples
    --------
    >>> Engage()
    Engage()
    """
