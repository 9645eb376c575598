"""Density of the steps of the march, and what it depends on: surface, lever, and where the tip is.

A step is eta over the root of a sum of squared rates, so that steps follow a smooth density: theory, Eq. (time-2).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator, contact_slope, damping, longrange_force, longrange_slope
from phasemap._kernels.orbits.time.runge_kutta import Medium
from phasemap._kernels.records import record

if TYPE_CHECKING:
    from phasemap._kernels.law import Law
    from phasemap._kernels.orbits.time.modes import Modes
    from phasemap._kernels.orbits.time.runge_kutta import Row

APPROACH_WEIGHT = 0.4
CONTACT_WEIGHT = 0.75
"""Weights of approach and of contact in the density of steps; chosen for the least work at 1e-6 to 1e-2 degree."""

HIGHER_WEIGHT = 0.4
"""The same of the fastest mode of several, which moves by far less than the first."""


class Surroundings(NamedTuple):
    """What stays as it is in a period."""

    law: Law
    p: Row  # parameters of the material
    aloft: Medium  # off the surface, and in contact
    snap: float  # density of steps by adhesion, squared
    neck: float  # q of the surface in the neck; 0 without one
    modes: Modes


@record
class Motion:
    """Where the march is."""

    x: float  # depth [m], in contact and neck the root of that above where x = 0
    v: float  # [m]
    cos: float  # of the drive's phase
    sin: float
    left: float  # time until the period ends
    deep: float  # q of the depth to which this contact goes, roughly
    highest: float  # largest depth so far [m]
    touching: int  # 1 in contact or neck
    in_neck: int


@kernel
def flight_rate(law: Law, p: Row, fixed: Medium, d: float, v: float) -> float:
    """Density of steps out of contact: rates of the lever, of the force's gradient, of the force as the tip moves."""
    rate = fixed.lever_rate
    if p[col.LONGRANGE] != 0.0:
        force = longrange_force(law, d, p) * fixed.compliance
        slope = longrange_slope(law, d, p) * fixed.compliance
        # Where a force changes sign, a hundredth of the distance keeps the rate finite, and u0 does so at contact.
        rate += abs(slope) * fixed.share + (APPROACH_WEIGHT * v * slope) ** 2 / (
            force**2 + (0.01 * slope * (abs(d) + fixed.drive)) ** 2
        )
    return math.sqrt(rate)


@kernel
def contact_rate(law: Law, p: Row, fixed: Medium, q: float) -> float:
    """Square of the density of steps in s, less the pull's: q'' = 2 q z'' gives 4 d F'/k; and damping."""
    d, share = fixed.bottom + q * q, fixed.share
    stiff = CONTACT_WEIGHT * CONTACT_WEIGHT * abs(contact_slope(law, d, p)) * fixed.compliance * share
    rate = 4 * q * q * (fixed.lever_rate + stiff)
    if p[col.DAMPING] != 0.0 and fixed.bottom == 0.0:
        rate += (4 * q * damping(law, d, p) * share) ** 2
    return rate


@kernel
def depth_reached(law: Law, p: Row, fixed: Medium, q: float, v: float, pull: float) -> float:
    """q of the depth that a tip at (q, v) comes to, roughly.

    There stiffness works as fast as speed and pull do: q^2 rate = v^2 + q^2 pull, with what q^2 rate is already.
    """
    goal = q * q * contact_rate(law, p, fixed, q) + v * v
    deep = 0.1 * math.sqrt(pull)
    for _ in range(5):
        deep *= ((goal / (deep * deep) + pull) / contact_rate(law, p, fixed, deep)) ** 0.2
    return deep


@kernel
def medium_aloft(oscillator: Oscillator, z0: float, modes: Modes) -> Medium:
    """The medium off the surface and in contact, at the tip offset z0 [m]."""
    law, p, lever = oscillator
    compliance, force, slope = 1 / lever[col.STIFFNESS], 0.0, 0.0
    if p[col.LONGRANGE] != 0.0:
        force = longrange_force(law, 0.0, p) * compliance
        slope = longrange_slope(law, 0.0, p) * compliance
    rate = 1.0 + HIGHER_WEIGHT * HIGHER_WEIGHT * (modes.fastest - 1.0)
    omega, alpha0, drive = lever[col.OMEGA], lever[col.ALPHA0], lever[col.DRIVE]
    return Medium(omega, alpha0, compliance, drive, z0, force, slope, 0.0, rate, modes.share)


@kernel(inline=True)
def medium_of(here: Surroundings, motion: Motion) -> Medium:
    """The medium, whose bottom is deeper while the tip is in the neck."""
    omega, alpha0, compliance, drive, z0, force, slope, _, rate, share = here.aloft
    bottom = here.p[col.RELEASE] if motion.in_neck == 1 else 0.0
    return Medium(omega, alpha0, compliance, drive, z0, force, slope, bottom, rate, share)


@kernel
def pull_of_lever(modes: Modes, motion: Motion, z: float) -> float:
    """Density of steps in contact by the lever's own acceleration about z [m], squared."""
    pull = math.hypot(z, motion.v)
    for i in range(1, modes.count):
        y, u, square = modes.now[2 * i - 2], modes.now[2 * i - 1], modes.square[i]
        pull += HIGHER_WEIGHT * HIGHER_WEIGHT * math.hypot(square * y, math.sqrt(square) * u)
    return 2 * CONTACT_WEIGHT * CONTACT_WEIGHT * pull


@kernel
def step_length(here: Surroundings, fixed: Medium, eta: float, motion: Motion) -> float:
    """Length of the next step."""
    law, p, x, v = here.law, here.p, motion.x, motion.v
    if motion.touching == 0:
        return min(motion.left, eta / flight_rate(law, p, fixed, x, v))
    # v / deep is the rate at which stiffness builds up; from q = 0 the local rate does not see it coming.
    z = fixed.z0 + fixed.bottom + x * x
    rate = contact_rate(law, p, fixed, x) + here.snap + pull_of_lever(here.modes, motion, z)
    rate += (CONTACT_WEIGHT * v / motion.deep) ** 2
    if here.neck > 0 and motion.in_neck == 0:
        rate += (CONTACT_WEIGHT * v) ** 2 / (x * x - p[col.RELEASE])  # the root at release, seen from contact
    return eta / math.sqrt(rate)
