"""Lengths of the steps of the march over a surface that remembers.

As over others, and shorter where a solid relaxes fast, next to a turn of the contact, and over dents.
"""

from __future__ import annotations

import math

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import (
    has_longrange,
    longrange_force,
)
from phasemap._kernels.orbits.time import surface_memory as memory
from phasemap._kernels.orbits.time.contact import OFF_SURFACE, DrivenLever, Here, Motion, MotionPoint, step_length
from phasemap._kernels.orbits.time.relaxing import Pace, Relaxing, dent_at
from phasemap._kernels.orbits.time.runge_kutta import find_slopes
from phasemap._kernels.orbits.time.step_density import (
    CONTACT_WEIGHT,
    LEAST_GAP_IN_NECK,
    approach_square,
    contact_rate,
    pull_in_contact,
)

KELVIN_STEPS = 0.7  # steps of a Kelvin-Voigt contact, over others: its dents have kinks
FAINT_STEPS = 1.4  # steps of the others where the dent met is FAINT_DENT of the free amplitude or less
FAINT_DENT = 1e-5
DEEP_DENT = 1e-2  # of the free amplitude, from which on they are as long as others
GROWING_STEPS = 1.3  # steps of a contact that grows, over others
GROWING_OVER_DENT = 0.7  # the same over dents that are not so faint
MOST_RELAXATION = 4.0  # relaxation times that a step takes: explicit ones are stable up to 6
RATE_BEFORE_TURN = 8.0  # of relaxation in the density of steps
RATE_BEHIND_TURN = 2.0
RATE_OF_STIFFNESS = 0.5  # where little stays stiff
LEAST_FADING = 0.3  # of 1/tau, at which that ends after a turn: with 1/tau_c a stiff solid takes twice the steps
RATE_OVER_DENT = 3.0  # times the former, where the next tap meets what this one leaves
STEP_AFTER_TURN = 0.1  # over others
FLIGHT_STEPS = 2.0  # steps out of contact where nothing attracts, over others
LONGEST_FLIGHT = 0.5  # step there [1/omega_c]
RECOVERY_WEIGHT = 0.25  # of the rate at which a dent under an attracted tip recovers, in the density of steps
STRAY_SHARE = 0.3  # of a step: how far it may be off a line's
MOST_NODES_PASSED = 5  # of a dent, in a step
PAST_TURN = 3e-3  # of q: how far past an old turn an edge has to come to stop there
PAST_KINK = 1e-6  # the same of a Kelvin-Voigt contact
DENT_FORGOTTEN = 1e-9  # of the free amplitude: a dent that is gone


@kernel(inline=True)
def relaxation_rate(contact: Relaxing, u: MotionPoint, t: float) -> float:
    """Square of the number of steps per unit of s (dtau = 2 q ds, q the edge of the contact) that relaxing arms need.

    Steps are short beside the relaxation time just before and behind the turn from growing to shrinking, for most of
    what a contact remembers as it shrinks happened there; over dents there are `Pace.layers` times as many, squared.
    """
    q, v, slows, arms, now = u.at.x, u.at.v, u.slope.v, contact.arms, contact.now
    kappa, density = contact.p[col.RELAXING], 0.0
    for a in range(arms.count):
        rate, share = arms.rate[a], arms.share[a] / kappa
        fast = share * contact.pace.layers * q * q * rate * rate
        if now.mode == memory.SHRINKING:  # by the stiffness that is left, and just behind the turn
            density += share * q * q * rate * RATE_OF_STIFFNESS / (1 - kappa)
            density += RATE_BEHIND_TURN * fast * math.exp(-max(1 - kappa, LEAST_FADING) * rate * (t - now.turned))
        elif slows < 0:  # the edge is slowing down towards its turn, v/slows from now
            density += RATE_BEFORE_TURN * fast * math.exp(2 * q * max(v, 0.0) * rate / slows)
    return density


@kernel
def pace_over(dent: float, free: float, kelvin: bool) -> Pace:
    """Numbers that set the lengths of steps over a dent [m], of a lever with this free amplitude [m].

    They go with the dent met, over the free amplitude: the error that a dent adds is of order 6 in them.
    """
    if kelvin:
        return Pace(free, KELVIN_STEPS, 1.0, RATE_OVER_DENT)
    least, most = FAINT_DENT * free, DEEP_DENT * free
    share = min(max(math.log(dent / least), 0.0) / math.log(most / least), 1.0) if dent > 0 else 0.0
    growth = GROWING_STEPS * (GROWING_OVER_DENT / GROWING_STEPS) ** share
    return Pace(free, FAINT_STEPS ** (1 - share), growth, RATE_OVER_DENT**share)


@kernel
def off_line(first: float, last: float, way: float, h: float) -> bool:
    """True if a quantity that changes by `way` in a step strays from a line between the slopes at both ends."""
    return not abs(way - 0.5 * h * (first + last)) <= STRAY_SHARE * h * max(abs(first), abs(last))


@kernel
def strays_from_line(contact: Relaxing, motion: Motion) -> bool:
    """True if a step is too long for a dent that nearly fits the tip, over which the contact's edge runs fast.

    Then the edge or the tip's speed does not follow the slopes at both ends, or the edge passes many nodes of a dent.
    """
    u, slope, end, slope_end, h = motion.here.at, motion.here.slope, motion.end.at, motion.end.slope, motion.h
    if off_line(slope.x, slope_end.x, end.x - u.x, h) or off_line(slope.v, slope_end.v, end.v - u.v, h):
        return True
    j = int(contact.m[memory.OUTER_COUNT]) - MOST_NODES_PASSED
    if contact.now.mode != memory.GROWING or j < 0:
        return False
    return u.x < math.sqrt(contact.m[memory.node_at(contact.m, True, j) + memory.NODE_XI]) < end.x


@kernel(inline=True)
def _contact_step(contact: Relaxing, beam: DrivenLever, step_size: float, motion: Motion) -> float:
    """Length of a step in contact, in s (dtau = 2 q ds): by stiffness, the rate of sinking in, and relaxation."""
    u, now, pace = motion.here.at, contact.now, contact.pace
    if motion.here.known == 0:
        find_slopes(Here(contact, beam), motion, motion.here)
    fast = max(abs(u.v), abs(motion.here.slope.x))
    density = contact_rate(contact, beam, 0.0, u.x) + pull_in_contact(contact, beam, beam.z0 + u.x * u.x, u)
    density += (CONTACT_WEIGHT * (fast / now.deep)) ** 2
    if contact.t0 == 0:
        density += relaxation_rate(contact, motion.here, motion.time)
    h = now.share * step_size * pace.finer * (pace.growth if now.mode == memory.GROWING else 1.0) / math.sqrt(density)
    now.share = min(2 * now.share, 1.0)
    if contact.t0 == 0:
        longest = MOST_RELAXATION / contact.arms.rate[0]
        h = min(h, longest / (u.x + math.sqrt(u.x * u.x + longest * fast)))  # 2 q h + q' h^2
    return h


@kernel(inline=True)
def _flight_step(contact: Relaxing, beam: DrivenLever, step_size: float, motion: Motion) -> float:
    """Length of a step out of contact [1/omega_c]; the last faint remains of a dent are taken away at once."""
    law, p, u, held = contact.law, contact.p, motion.here.at, contact.now.held == 1
    dent, rise = dent_at(contact, motion.time)
    if 0.0 < dent < DENT_FORGOTTEN * contact.pace.free:
        if not held:
            motion.sums.loss -= dent * longrange_force(law, u.x, p) * contact.compliance
        contact.m[memory.OUTER_COUNT] = dent = 0.0
        contact.now.dented = 0
    gap = min(u.x - dent, -LEAST_GAP_IN_NECK * contact.pace.free) if held else u.x - dent
    density = math.sqrt(beam.rate + approach_square(contact, beam, gap, u.v, held))
    if not held and not has_longrange(p):
        return min(FLIGHT_STEPS * step_size, max(step_size, LONGEST_FLIGHT)) / density
    if dent > 0:
        density = math.hypot(density, RECOVERY_WEIGHT * rise / dent)
    return step_size / density


@step_length.of(Relaxing)
@kernel(inline=True)
def _step_length(contact: Relaxing, beam: DrivenLever, step_size: float, motion: Motion) -> float:
    """Length of the next step over a relaxing surface [tau]."""
    if contact.now.mode == OFF_SURFACE:
        return _flight_step(contact, beam, step_size, motion)
    return _contact_step(contact, beam, step_size, motion)
