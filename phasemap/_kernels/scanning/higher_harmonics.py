"""How far the lever's higher harmonics carry the tip while the surface pushes, for the slow flow.

First-order averaging has the phase at a given amplitude within hundredths of a degree, but the tip offset off by some
percent of the indentation: a short push excites harmonics n >= 2 as well, whose deflections P/(n^2 - 1) add up to 3/4 P
at the time of contact and to less if that is longer. So an orbit with first harmonic P lies higher than its average by
kappa P. For an elastic sphere kappa is a function of how long the contact is; what it has to be multiplied by is taken
from the exact orbits at the setpoint: theory, Eqs. (averaging-11), (slow-flow-3) and (slow-flow-4).
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.arrays import copy
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, parameters
from phasemap._kernels.lever import reach_of
from phasemap._kernels.orbits.averaged.orbits import averaged_orbits, slope_of
from phasemap._kernels.orbits.response.orbit import new_room, refine
from phasemap._kernels.orbits.response.passes import HEIGHT
from phasemap._kernels.quadrature import gauss

ATTRACTED, REPELLED = 0, 1
TERMS = 8  # of a polynomial that is wrong by 7e-5 at most; kappa at the setpoint is right whatever it gives


def _pushed(m: np.ndarray) -> np.ndarray:
    """kappa_0 of theory, Eq. (slow-flow-3), as a function of m = (1 - c)/2."""
    x, w = gauss(64)
    sine = np.sin(0.5 * np.pi * x)
    found = np.empty(len(m))
    for i in range(len(m)):  # theta/2 = asin(sqrt(m) sine), and y = cos(theta) - c = 2 m (1 - sine^2)
        half = np.arcsin(np.sqrt(m[i]) * sine)
        y, share = 1 - sine**2, w * np.sqrt((1 - sine**2) / (1 - m[i] * sine**2))
        before, after = abs(half[:, None] - half), half[:, None] + half  # half of what is between two times
        answers = _answer(before) + _answer(after)
        cosine = np.cos(2 * half)
        stiffness, force = share * y**0.5 * cosine, share * y**1.5
        found[i] = 0.5 * (stiffness @ answers @ force) / (stiffness.sum() * (force * cosine).sum())
    return found


def _answer(half: np.ndarray) -> np.ndarray:
    """The sum of cos(n theta)/(n^2 - 1) over n >= 2, of theta/2 from 0 to pi."""
    return np.asarray(0.5 + 0.25 * np.cos(2 * half) - (0.5 * np.pi - half) * np.sin(2 * half))


_NODES = np.cos((np.arange(TERMS) + 0.5) * np.pi / TERMS)
_POLYNOMIAL = np.linalg.solve(np.vander(_NODES), _pushed((0.5 + 0.5 * _NODES) ** 2))  # of 2 sqrt(m) - 1


@kernel
def pushed(c: float) -> float:
    """kappa_0 of a tip that touches where cos(theta) > c."""
    u, kappa = 2.0 * math.sqrt(min(max(0.5 * (1.0 - c), 0.0), 1.0)) - 1.0, 0.0
    for n in range(TERMS):
        kappa = u * kappa + _POLYNOMIAL[n]
    return kappa


@kernel
def lifts(
    law: Law, rows: np.ndarray, lever: np.ndarray, amplitudes: np.ndarray, limits: np.ndarray, first: int, last: int,
    out: np.ndarray,
) -> None:  # fmt: skip
    """Fill out, shape (n, 2), with kappa where P < 0, and kappa/kappa_0 where P > 0; NaN where nothing is known.

    A material without an attractive orbit that the cheap path finds has the kappa of its repulsive one there, too.

    limits = (phase [rad], height [m]) are errors of the exact orbits that may be left.
    """
    room, guess = new_room(), np.zeros(col.GUESS)
    for i in range(first, last):
        p, amplitude = parameters(rows[i]), amplitudes[i]
        out[i] = math.nan
        orbits = averaged_orbits(law, p, lever, amplitude)
        for j in range(len(orbits)):
            copy(orbits[j], guess)
            guess[col.G_SLOPE] = slope_of(law, p, lever, guess)
            if refine(law, p, lever, reach_of(law, p), guess, limits, room):
                kappa = (room.state[HEIGHT] - guess[col.G_Z0]) / guess[col.G_P]
                if guess[col.G_P] < 0.0:
                    out[i, ATTRACTED] = kappa
                    continue
                out[i, REPELLED] = kappa / pushed((guess[col.G_Z0] - guess[col.G_MEAN]) / guess[col.G_A])
                if math.isnan(out[i, ATTRACTED]):
                    out[i, ATTRACTED] = kappa
