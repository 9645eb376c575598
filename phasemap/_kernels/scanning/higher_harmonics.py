"""How far the lever's higher harmonics carry the tip while the surface pushes, for the slow flow.

First-order averaging has the phase at a given amplitude within hundredths of a degree, but the tip offset off by some
percent of the indentation: a short push excites harmonics n >= 2 as well, whose deflections P/(n^2 - 1) add up to 3/4 P
at the time of contact and to less if that is longer. So an orbit with first harmonic P lies higher than its average by
kappa P. For an elastic sphere 3/4 - kappa is a function of how long the contact is. The attraction, which lasts longer,
has a kappa of its own. What both have to be multiplied by is taken from the exact orbits at the setpoint: theory, Eqs.
(averaging-11), (slow-flow-3) and (slow-flow-4).
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.arrays import copy
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, Oscillator, contact_force, parameters
from phasemap._kernels.lever import reach_of
from phasemap._kernels.orbits.averaged.harmonics import attraction
from phasemap._kernels.orbits.averaged.orbits import averaged_orbits, mismatch_slope
from phasemap._kernels.orbits.response.orbit import Room, refine
from phasemap._kernels.quadrature import gauss

ATTRACTED, REPELLED, LACKING = 0, 1, 2
SHORT = 0.75  # kappa of the shortest push
TYPICAL = (1.0, 0.95)  # shares where nothing is known: those of most materials lie within a tenth
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
def pull_of(oscillator: Oscillator, reach: float, amplitude: float, c: float) -> float:
    """First harmonic [m], below zero, of the attraction outside contact; within it that is as large as at its edge."""
    law, p, lever = oscillator
    within = contact_force(law, 0.0, p) * math.sqrt(1.0 - c * c) if abs(c) < 1.0 else 0.0
    return 2.0 / (math.pi * lever[col.STIFFNESS]) * (within + attraction(law, p, reach, amplitude, c)[1])


@kernel
def kappa_of_pull(share: float, reach: float, amplitude: float, c: float) -> float:
    """Kappa of an attraction of this reach [m], which lasts as long as a contact that is twice as much deeper."""
    return SHORT - share * (SHORT - pushed(min(c, 1.0) - 2.0 * (max(c - 1.0, 0.0) + reach / amplitude)))


@kernel
def lifted(
    oscillator: Oscillator, reach: float, amplitude: float, c: float, push: float, shares: tuple[float, float]
) -> float:
    """By how much [m] harmonics carry the tip towards the surface, of a harmonic orbit of this P: (slow-flow-4)."""
    pull = pull_of(oscillator, reach, amplitude, c)
    kappa = SHORT - shares[REPELLED] * (SHORT - pushed(c))
    return kappa * (push - pull) + kappa_of_pull(shares[ATTRACTED], reach, amplitude, c) * pull


@kernel
def lifts(
    law: Law, rows: np.ndarray, lever: np.ndarray, amplitudes: np.ndarray, limits: np.ndarray, first: int, last: int,
    out: np.ndarray,
) -> None:  # fmt: skip
    """Fill out, shape (n, 2), with the shares of the attraction and of the rest in `lifted`.

    limits = (phase [rad], height [m]) are errors of the exact orbits that may be left.
    """
    room, guess = Room(), np.zeros(col.GUESS)
    known = np.zeros((2, 3))
    for i in range(first, last):
        p, amplitude = parameters(rows[i]), amplitudes[i]
        reach = reach_of(law, p)
        known[:] = 0.0
        orbits = averaged_orbits(Oscillator(law, p, lever), amplitude)
        for j in range(len(orbits)):
            copy(orbits[j], guess)
            guess[col.G_SLOPE] = mismatch_slope(Oscillator(law, p, lever), guess)
            if refine(Oscillator(law, p, lever), reach, guess, limits, room):
                c, push = (guess[col.G_Z0] - guess[col.G_MEAN]) / amplitude, guess[col.G_P]
                pull = pull_of(Oscillator(law, p, lever), reach, amplitude, c)
                if push < 0.0 and known[ATTRACTED, ATTRACTED] != 0.0:
                    continue  # from far: the first attractive orbit and the last repulsive one are stable
                side = known[REPELLED if push > 0.0 else ATTRACTED]
                side[ATTRACTED] = (SHORT - kappa_of_pull(1.0, reach, amplitude, c)) * pull
                side[REPELLED] = (SHORT - pushed(c)) * (push - pull)
                side[LACKING] = SHORT * push - (room.state.tip_offset - guess[col.G_Z0])
        _balance(known, out[i])


@kernel
def _balance(known: np.ndarray, shares: np.ndarray) -> None:
    """Find the shares with which both orbits, or the one that there is, lack what they do: Eq. (slow-flow-4)."""
    pulled, pushed_ = known[ATTRACTED], known[REPELLED]
    shares[ATTRACTED], shares[REPELLED] = TYPICAL
    if pulled[ATTRACTED] != 0.0 and pushed_[REPELLED] != 0.0:
        whole = pulled[ATTRACTED] * pushed_[REPELLED] - pulled[REPELLED] * pushed_[ATTRACTED]
        shares[ATTRACTED] = (pulled[LACKING] * pushed_[REPELLED] - pulled[REPELLED] * pushed_[LACKING]) / whole
        shares[REPELLED] = (pulled[ATTRACTED] * pushed_[LACKING] - pulled[LACKING] * pushed_[ATTRACTED]) / whole
    elif pulled[ATTRACTED] != 0.0:
        shares[ATTRACTED] = (pulled[LACKING] - shares[REPELLED] * pulled[REPELLED]) / pulled[ATTRACTED]
    elif pushed_[REPELLED] != 0.0:
        shares[REPELLED] = (pushed_[LACKING] - shares[ATTRACTED] * pushed_[ATTRACTED]) / pushed_[REPELLED]
