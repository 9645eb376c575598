"""Density of the steps of the march, and what it depends on: surface, lever, and where the tip is.

A step is eta over the root of a sum of squared rates, so that steps follow a smooth density: theory, Eq. (time-2).
"""

from __future__ import annotations

import math
from typing import Any

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import contact_force, contact_slope, damping, has_longrange, longrange_force, longrange_slope
from phasemap._kernels.lever import reach_of
from phasemap._kernels.orbits.time.contact import DrivenLever, Moved

# Weights in the density of steps of approach and of contact, chosen for the least work at 1e-6 to 1e-2 degree; and of
# the fastest mode of several, which moves by far less than the first.
APPROACH_WEIGHT = 0.4
CONTACT_WEIGHT = 0.75
HIGHER_WEIGHT = 0.4
# Of the gap at which a neck of liquid breaks, or the free amplitude: at a gap of 0 its law has the slope in contact.
BESIDE_ZERO = 0.01  # of the distance, times the slope: a force that passes 0 counts as no smaller
FIRST_ROOT, ROOT_STEPS = 0.1, 5  # of the depth that is reached: first one over that of the pull alone
LEAST_GAP_IN_NECK = 1e-9


@kernel
def flight_rate(contact: Any, beam: DrivenLever, d: float, v: float) -> float:
    """Density of steps out of contact: rates of the lever, of the force's gradient, of the force as the tip moves."""
    return math.sqrt(beam.rate + approach_square(contact, beam, d, v, False))


@kernel
def approach_square(contact: Any, beam: DrivenLever, d: float, v: float, in_neck: bool) -> float:
    """Square of the density of steps out of contact, or in a neck, by the force's gradient and rate of change."""
    law, p, inverse_k, least = contact.law, contact.p, contact.compliance, 0.0
    if law.lossy == 1 and p[col.LOSS] != 0.0:
        least = (2.0 * APPROACH_WEIGHT * v * p[col.LOSS_FALL]) ** 2 * math.exp(0.25 * d * p[col.LOSS_FALL])
    if in_neck:
        force, slope = contact_force(law, d, p) * inverse_k, contact_slope(law, d, p) * inverse_k
    elif has_longrange(p):
        force, slope = longrange_force(law, d, p) * inverse_k, longrange_slope(law, d, p) * inverse_k
        if law.longrange_force != 0:  # which may change fast where its slope is 0
            reach = reach_of(p)
            length = reach - d
            if law.attracts == 0:  # over a length that does not grow, in steps of order 8
                size = math.hypot(force, slope * reach) / math.hypot(contact.edge_force, contact.edge_slope * reach)
                length = reach * size**-0.125
            least = (2.0 * APPROACH_WEIGHT * v / length) ** 2
    else:
        return least
    # A force that passes zero would change infinitely fast relative to its size: its slope times a hundredth of the
    # distance bounds the rate, and times a hundredth of u0 where the distance is zero too.
    beside = BESIDE_ZERO * slope * (abs(d) + beam.drive)
    changes = (APPROACH_WEIGHT * v * slope) ** 2 / (force**2 + beside**2)
    return abs(slope) * beam.share + max(changes, least)


@kernel
def contact_rate(contact: Any, beam: DrivenLever, bottom: float, q: float) -> float:
    """Square of the density of steps in contact (over s, dtau = 2 q ds) by stiffness and damping of the surface.

    q'' = 2 q z'' gives 4 d F'/k.
    """
    law, p, d = contact.law, contact.p, bottom + q * q
    stiff = CONTACT_WEIGHT * CONTACT_WEIGHT * abs(contact_slope(law, d, p)) * contact.compliance * beam.share
    rate = 4 * q * q * (beam.rate + stiff)
    if p[col.DAMPING] != 0.0 and bottom == 0.0:
        rate += (4 * q * damping(law, d, p) * beam.share) ** 2
    return rate


@kernel
def depth_reached(contact: Any, beam: DrivenLever, q: float, v: float, pull: float) -> float:
    """The largest q, root of the depth, that a tip at (q, v) in contact comes to, roughly.

    There stiffness works as fast as speed and pull do: q^2 rate = v^2 + q^2 pull, with what q^2 rate is already.
    """
    goal = q * q * contact_rate(contact, beam, 0.0, q) + v * v
    deep = FIRST_ROOT * math.sqrt(pull)
    for _ in range(ROOT_STEPS):  # of a fixed point: q^2 rate goes about with q^5
        deep *= ((goal / (deep * deep) + pull) / contact_rate(contact, beam, 0.0, deep)) ** 0.2
    return deep


@kernel
def pull_in_contact(contact: Any, beam: DrivenLever, z: float, u: Moved) -> float:
    """Square of the density of steps in contact by adhesion and by the lever's own acceleration about z [m]."""
    modes, pull = beam.modes, abs(contact.pull) * beam.share + math.hypot(z, u.v)
    for i in range(1, modes.count):
        y, speed, square = u.modes[2 * i - 2], u.modes[2 * i - 1], modes.square[i]
        pull += HIGHER_WEIGHT * HIGHER_WEIGHT * math.hypot(square * y, math.sqrt(square) * speed)
    return 2 * CONTACT_WEIGHT * CONTACT_WEIGHT * pull
