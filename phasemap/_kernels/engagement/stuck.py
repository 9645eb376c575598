"""Whether a tip that fell onto the sample and sticks comes back to an amplitude before it comes free.

It is raised until adhesion lets go, at the latest where the lever no longer rests in contact. If that is so far up that
a free tip touches nothing, the lever swings freely from then on, is lowered again as it was before, and falls where it
fell: a feedback hunts for ever. Unless, on the way, it swings by the setpoint while it touches. In contact all the time
the depth is d_r or more, and the in-phase force P of a swing A = d cos least where d_r is just reached, for a contact
gets stiffer with depth; and by X = P + A (1 - omega^2) <= u0 an orbit has no more than u0 - A (1 - omega^2) of it.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, contact_force
from phasemap._kernels.orbits.time.period_map import Tip, amplitude_of

FALLEN = 0.5  # of the setpoint: less comes of no step along an orbit, but of a fall
SWING = 1.5  # least depth that a tip comes to: so many amplitudes of the first harmonic above its mean
TOO_STIFF, BEYOND = 2.0, 2.0  # over what the drive has for P, and over the largest amplitude of the free lever
LOOKS = 32  # at depths along the neck, and at angles of a swing


@kernel
def fallen(lever: np.ndarray, amplitude: float, tip: Tip) -> bool:
    """Whether a tip that was lowered to this amplitude has jumped across it."""
    return amplitude_of(lever, tip.acc) < FALLEN * amplitude


@kernel
def pull_off(law: Law, p: np.ndarray, lever: np.ndarray) -> float:
    """Highest tip offset [m] at which the lever rests in contact or neck."""
    highest = -math.inf
    for i in range(LOOKS + 1):
        d = p[col.RELEASE] * i / LOOKS
        highest = max(highest, -contact_force(law, d, p) / lever[col.STIFFNESS] - d)
    return highest


@kernel
def least_push(law: Law, p: np.ndarray, lever: np.ndarray, amplitude: float) -> float:
    """In-phase force P [m] of a swing in contact that just reaches release."""
    total = 0.0
    for i in range(LOOKS):
        cosine = math.cos(math.pi * (i + 0.5) / LOOKS)
        total += contact_force(law, p[col.RELEASE] + amplitude * (1.0 + cosine), p) * cosine
    return 2.0 * total / LOOKS / lever[col.STIFFNESS]


@kernel
def stuck(law: Law, p: np.ndarray, lever: np.ndarray, amplitude: float, tip: Tip) -> bool:
    """Whether a tip that fell across this amplitude [m] comes back to it only by a jump, and falls again.

    Without a neck a tip may leave the contact for a part of each period, high above the surface: time says so then.
    """
    if p[col.RELEASE] == 0.0:
        return False
    acc = tip.acc
    swings = math.hypot(acc[0], acc[1])
    if not fallen(lever, amplitude, tip) or acc[2] - tip.u[3] - SWING * swings < p[col.RELEASE]:
        return False
    of_tip, drive = amplitude - lever[col.SHAKER], lever[col.BASE]
    if not of_tip > 0.0 or pull_off(law, p, lever) < BEYOND * drive / (2.0 * lever[col.ALPHA0] * lever[col.OMEGA]):
        return False
    needed = drive + of_tip * abs(1.0 - lever[col.OMEGA] ** 2)
    return least_push(law, p, lever, of_tip) > TOO_STIFF * needed
