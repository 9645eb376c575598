"""Loop over pixels for orbits that the detector sees with a given amplitude."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.exact_orbit import new_rooms
from phasemap._kernels.engagement.seen import SeenRoom, by_collocation_at_seen, by_passes_at_seen
from phasemap._kernels.orbits.response.orbit import Room
from phasemap._kernels.rows.answers import Answers, Pixels, oscillator_of


@kernel
def seen_rows(pixels: Pixels, tables: np.ndarray, limits: np.ndarray, answers: Answers, slopes: np.ndarray) -> None:
    """Orbit of the tip of every row that is seen with an amplitude, after engagement.

    limits = (phase [rad], tip offset [m]) are the largest errors of passes. Errors in the rows are those at the tip's
    own amplitude; `slopes` (shape (n, SLOPES)) of what the detector sees by that give the rest.
    """
    (out, status, solver), seen = answers, pixels.amplitudes
    room, rooms = SeenRoom(np.zeros(col.GUESS), Room(), limits), new_rooms(pixels.lever, tables)
    for i in range(len(out)):
        oscillator, row = oscillator_of(pixels, i), out[i, : col.COLUMNS]
        row[:], slopes[i, :] = math.nan, math.nan
        if oscillator.p[col.RELEASE] != 0.0:
            status[i] = col.NOT_CONVERGED  # between far and the setpoint there may be no periodic orbit
            continue
        status[i] = by_passes_at_seen(oscillator, seen[i], room, row, slopes[i])
        solver[i] = col.CORRECTED
        if status[i] != col.GOOD:
            known = status[i] == col.KNOWN
            status[i] = by_collocation_at_seen(oscillator, seen[i], known, room, rooms, row, slopes[i])
            solver[i] = col.ORBIT
