"""Engagement of a pixel whose curve of orbits is in pieces, as where a law has a neck: along every stable piece."""

from __future__ import annotations

import numpy as np

from phasemap._kernels import columns as col
from phasemap.curves.control import fixed_path_of
from phasemap.curves.feedback import Feedback
from phasemap.curves.whole import held_curves
from phasemap.work import Work


def engage(work: Work, i: int, row: np.ndarray) -> int:
    """Fill the result row of pixel `i` with the orbit that holds its amplitude; returns a status code.

    Where a tip that first touches taps irregularly, it is lowered on until a stable orbit appears.
    """
    law, path = fixed_path_of(work, i)
    feedback = Feedback(held_curves(law, path, np.array([work.amplitudes[i]]), 0))
    place = feedback.far()
    row[:] = np.nan
    found, at, _ = feedback.seek(place, 0, 0) if place is not None else (None, -1, None)
    if found is None:
        return col.NO_STABLE_ORBIT
    row[:] = found.segment.rows[at][: col.COLUMNS]
    return col.GOOD
