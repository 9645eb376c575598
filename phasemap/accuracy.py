"""How exact an answer has to be."""

from __future__ import annotations

from dataclasses import dataclass

from phasemap._check import number


@dataclass(frozen=True)
class Accuracy:
    """Largest error allowed, against the exact periodic orbit.

    Parameters
    ----------
    phase : float
        [degree], > 0. Smaller is slower.
    height : float
        [m], > 0. Smaller is slower.

    Examples
    --------
    >>> Accuracy(phase=0.1).height
    1e-12
    """

    phase: float = 0.01
    height: float = 1e-12

    def __post_init__(self) -> None:
        number("accuracy phase", self.phase, "degree", above=0)
        number("accuracy height", self.height, "m", above=0)
