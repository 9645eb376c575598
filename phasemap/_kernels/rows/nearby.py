"""Exact orbits near orbits that are known: no engagement, the branch is that of the guess."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.continuation.path import fixed
from phasemap._kernels.continuation.step import relay
from phasemap._kernels.law import Law, Oscillator, parameters
from phasemap._kernels.lever import is_thrown_back
from phasemap._kernels.orbits.collocation.impact import begin_impact
from phasemap._kernels.orbits.collocation.newton import begin, newton
from phasemap._kernels.orbits.collocation.polish import judge, polish, tolerance_of
from phasemap._kernels.orbits.collocation.system import HOLD_AMPLITUDE, VALUE, Z0, P, S, new_orbit

MOST_STEPS = 12
FROM_Z0, FROM_MEAN, FROM_PHASE, AWAY = 0, 1, 2, 3  # columns of guesses


@kernel
def nearby_rows(
    law: Law,
    rows: np.ndarray,
    lever: np.ndarray,
    tables: np.ndarray,
    amplitudes: np.ndarray,
    guesses: np.ndarray,
    group: int,
    out: np.ndarray,
    status: np.ndarray,
) -> None:
    """Orbit of every row next to its guess.

    Parameters
    ----------
    guesses : ndarray, shape (n, 4)
        Tip offset [m], mean deflection [m], phase [rad], and how far off the tip offset may be [m]. An orbit farther
        away, or one that is not stable, gets the status NOT_CONVERGED.
    group : int
        So many rows, one after another, are close to each other: each may start from the one before.
    """
    orbit, spare = new_orbit(), new_orbit()
    guess, target = np.zeros(col.HARMONIC_ORBIT), np.zeros(4)
    omega = lever[col.OMEGA]
    for i in range(len(rows)):
        p, amplitude, row = parameters(rows[i]), amplitudes[i], out[i]
        z0, mean, phase, away = guesses[i, FROM_Z0], guesses[i, FROM_MEAN], guesses[i, FROM_PHASE], guesses[i, AWAY]
        guess[col.G_Z0], guess[col.G_MEAN], guess[col.G_A] = z0, mean, amplitude
        guess[col.G_P] = lever[col.BASE] * math.sin(phase) - amplitude * (1.0 - omega * omega)
        guess[col.G_S] = 2.0 * lever[col.ALPHA0] * omega * amplitude - lever[col.BASE] * math.cos(phase)
        tolerance = tolerance_of(Oscillator(law, p, lever))
        done, throws = col.NOT_CONVERGED, is_thrown_back(Oscillator(law, p, lever), amplitude, guess[col.G_P])
        for warm in (True, False):
            if warm and (i % group == 0 or status[i - 1] != col.GOOD):
                continue
            if warm:
                head = orbit.head
                head[VALUE, Z0], head[VALUE, P], head[VALUE, S] = z0, guess[col.G_P], guess[col.G_S]
                if not relay(fixed(Oscillator(law, p, lever), tables), orbit, spare):
                    continue
                orbit, spare = spare, orbit
            elif not (throws and begin_impact(Oscillator(law, p, lever), tables, orbit, amplitude, 0)):
                if not begin(Oscillator(law, p, lever), tables, orbit, guess, 0):
                    continue
            done, _, orbit, spare = newton(
                Oscillator(law, p, lever), tables, orbit, spare, HOLD_AMPLITUDE, target, 0, tolerance, MOST_STEPS
            )
            if done == col.GOOD:
                done, orbit, spare = polish(Oscillator(law, p, lever), tables, orbit, spare, row)
            if done == col.GOOD and judge(row) == col.GOOD and abs(row[col.TIP_OFFSET] - z0) < away:
                break
            done = col.NOT_CONVERGED
        if done != col.GOOD:
            row[:] = math.nan
        status[i] = done
