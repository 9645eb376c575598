"""Shift of the tip by the lever's higher harmonics while the surface pushes, for the slow flow.

First-order averaging has the phase at a given amplitude within hundredths of a degree, but the tip offset off by some
percent of the indentation: a short push excites harmonics n >= 2 as well, whose deflections P/(n^2 - 1) add up to 3/4 P
at the time of contact and to less if that is longer. So an orbit with first harmonic P lies higher than its average by
kappa P. For an elastic sphere 3/4 - kappa is a function of how long the contact is. The attraction, which lasts longer,
has a kappa of its own. What both have to be multiplied by is taken from the exact orbits at the setpoint: theory, Eqs.
(averaging-11), (slow-flow-4) and (slow-flow-5).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.columns import ErrorLimits
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, Oscillator, contact_force, parameters
from phasemap._kernels.lever import reach_of
from phasemap._kernels.orbits.averaged.harmonics import longrange_integrals
from phasemap._kernels.orbits.averaged.orbits import averaged_orbits
from phasemap._kernels.orbits.averaged.sides import fill_averaged_orbit_at_gap
from phasemap._kernels.orbits.harmonic_orbit import HarmonicOrbit, centre_height, load_harmonic_orbit
from phasemap._kernels.orbits.response.orbit_at_setpoint import ResponseWorkspace, exact_orbit_at_amplitude
from phasemap._kernels.records import clear, record

KAPPA_OF_SHORT_PUSH = 0.75  # kappa of the shortest push
# kappa_0 of theory, Eq. (slow-flow-4), as a polynomial of 2 sqrt((1 - c)/2) - 1 with its values at eight Chebyshev
# nodes, within 3e-4 elsewhere; kappa at the setpoint is right whatever it gives.
KAPPA = -0.000443869, -0.003018172, -0.008598364, -0.029201696, -0.03069339, 0.251299414, -0.321789676, 0.169394248


class Shares(NamedTuple):
    """Factors on the shift of the tip by higher harmonics that make it that of the exact orbits: Eq. (slow-flow-5)."""

    attraction: float
    push: float


TYPICAL_SHARES = Shares(1.0, 0.95)  # where nothing is known: those of most materials lie within a tenth


@record
class Shift:
    """Shift of the tip by higher harmonics on an orbit: the exact one, and that by a unit of each share [m]."""

    attraction: float  # by a unit of the share of the attraction [m]; 0 where there is no such orbit
    push: float  # by a unit of the share of the push [m]; 0 where there is no such orbit
    exact: float  # of the exact orbit [m]


@kernel
def kappa_of_push(c: float) -> float:
    """Factor kappa_0 of the tip shift by the contact force, for a contact where cos(theta) > c."""
    u, kappa = 2.0 * math.sqrt(min(max(0.5 * (1.0 - c), 0.0), 1.0)) - 1.0, 0.0
    for coefficient in KAPPA:
        kappa = u * kappa + coefficient
    return kappa


@kernel
def pull_of(oscillator: Oscillator, amplitude: float, c: float) -> float:
    """First harmonic [m], below zero, of the attraction on an orbit: in contact it is as large as at the edge."""
    law, p, lever = oscillator
    within = contact_force(law, 0.0, p) * math.sqrt(1.0 - c * c) if abs(c) < 1.0 else 0.0
    return 2.0 / (math.pi * lever[col.STIFFNESS]) * (within + longrange_integrals(law, p, amplitude, c)[1])


@kernel
def kappa_of_pull(share: float, reach: float, amplitude: float, c: float) -> float:
    """Kappa of an attraction of this reach [m], which lasts as long as a contact that is twice as much deeper."""
    return KAPPA_OF_SHORT_PUSH - share * (
        KAPPA_OF_SHORT_PUSH - kappa_of_push(min(c, 1.0) - 2.0 * (max(c - 1.0, 0.0) + reach / amplitude))
    )


@kernel
def tip_shift(oscillator: Oscillator, amplitude: float, c: float, push: float, shares: Shares) -> float:
    """Tip displacement [m] towards the surface by higher harmonics, on a harmonic orbit of this P: (slow-flow-5)."""
    pull = pull_of(oscillator, amplitude, c)
    kappa = KAPPA_OF_SHORT_PUSH - shares.push * (KAPPA_OF_SHORT_PUSH - kappa_of_push(c))
    return kappa * (push - pull) + kappa_of_pull(shares.attraction, reach_of(oscillator.p), amplitude, c) * pull


@kernel
def share_rows(
    law: Law, rows: np.ndarray, lever: np.ndarray, amplitudes: np.ndarray, limits: ErrorLimits, out: np.ndarray
) -> None:
    """Fill `out`, shape (n, 2), with the `Shares` of each row, from its exact orbits at the setpoint amplitude."""
    workspace, harmonic = ResponseWorkspace(), HarmonicOrbit()
    attractive, repulsive = Shift(), Shift()
    for i in range(len(rows)):
        oscillator, amplitude = Oscillator(law, parameters(rows[i]), lever), amplitudes[i]
        reach = reach_of(oscillator.p)
        clear(attractive)
        clear(repulsive)
        orbits = averaged_orbits(oscillator, amplitude)
        for j in range(len(orbits)):
            load_harmonic_orbit(orbits[j], harmonic)
            fill_averaged_orbit_at_gap(oscillator, amplitude, centre_height(harmonic) - amplitude, harmonic)
            if exact_orbit_at_amplitude(oscillator, harmonic, limits, workspace):
                c, push = centre_height(harmonic) / amplitude, harmonic.push
                pull = pull_of(oscillator, amplitude, c)
                if push < 0.0 and attractive.attraction != 0.0:
                    continue  # from far: the first attractive orbit and the last repulsive one are stable
                side = repulsive if push > 0.0 else attractive
                side.attraction = (KAPPA_OF_SHORT_PUSH - kappa_of_pull(1.0, reach, amplitude, c)) * pull
                side.push = (KAPPA_OF_SHORT_PUSH - kappa_of_push(c)) * (push - pull)
                side.exact = KAPPA_OF_SHORT_PUSH * push - (workspace.state.tip_offset - harmonic.tip_offset)
        shares = _solve_shares(attractive, repulsive)
        out[i, 0], out[i, 1] = shares.attraction, shares.push


@kernel
def _solve_shares(attractive: Shift, repulsive: Shift) -> Shares:
    """Shares that shift both orbits, or the only one, to their exact tip offsets: theory, Eq. (slow-flow-5)."""
    attraction, push = TYPICAL_SHARES
    if attractive.attraction != 0.0 and repulsive.push != 0.0:
        whole = attractive.attraction * repulsive.push - attractive.push * repulsive.attraction
        attraction = (attractive.exact * repulsive.push - attractive.push * repulsive.exact) / whole
        push = (attractive.attraction * repulsive.exact - attractive.exact * repulsive.attraction) / whole
    elif attractive.attraction != 0.0:
        attraction = (attractive.exact - push * attractive.push) / attractive.attraction
    elif repulsive.push != 0.0:
        push = (repulsive.exact - attraction * repulsive.attraction) / repulsive.push
    return Shares(attraction, push)
