"""Largest error allowed of an answer, and most periods in which it is sought in time."""

from __future__ import annotations

import math
from dataclasses import dataclass

from phasemap._shared.checks import whole
from phasemap._shared.fields import Number, Shown, known_as

MOST_PERIODS = 100_000
# Of periodic motion integrated in time, with steps of the default size; found against independent orbits [rad, m].
ERROR_PHASE, ERROR_HEIGHT = math.radians(5e-5), 1e-14


@known_as()
@dataclass(frozen=True, repr=False)
class Accuracy(Shown):
    """Largest error allowed, against the exact periodic orbit, and most work.

    Parameters
    ----------
    phase : float
        [degree], > 0. Smaller is slower.
    height : float
        [m], > 0. Smaller is slower.
    periods : int
        Periods of the drive [1], >= 1, that may be integrated for one material where time decides. What is not decided
        by then has the status not_settled. Periods are counted, not seconds, so that results are the same everywhere.
    """

    phase: Number[float] = Number("degree", 0.01, said="accuracy phase", above=0)
    height: Number[float] = Number("m", 1e-12, said="accuracy height", above=0, usual=(1e-18, 1e-6))
    periods: int = MOST_PERIODS

    def __post_init__(self) -> None:
        whole("accuracy periods", self.periods, 1, 10**12)
