"""How long the steps of the march are over a surface that remembers.

As in `march`, and shorter where a solid relaxes fast, next to a turn of the contact, and over dents.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, longrange_force, longrange_slope
from phasemap._kernels.orbits.time import elements as on
from phasemap._kernels.orbits.time.edge import (
    Point,
    Surface,
    dent_at,
)
from phasemap._kernels.orbits.time.step_density import CONTACT_WEIGHT, contact_rate, depth_reached, flight_rate
from phasemap._kernels.orbits.time.tip import PeriodResult
from phasemap._kernels.records import record

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
FLIGHT_STEPS = 2.0  # steps out of contact, over those of `march`, where nothing attracts
ATTRACTED_STEPS = 1.0  # the same where a force does
RECOVERY_WEIGHT = 0.25  # of the rate at which a dent under an attracted tip recovers, in the density of steps
LONGEST_FLIGHT = 0.5  # step [1/omega_c]
PAST_TURN = 3e-3  # of q: how far past an old turn an edge has to come to stop there
PAST_KINK = 1e-6  # the same of a Kelvin-Voigt contact


class Pace(NamedTuple):
    """What the lengths of steps in a period depend on."""

    kelvin: bool  # whether the surface is a Kelvin-Voigt one
    free: float  # free amplitude [m]
    snap: float  # pull in contact, as the density of steps counts it [m]
    flight: float  # step out of contact, over its density [1/omega_c]
    contact: float  # eta
    relaxation: float  # longest step of a solid that relaxes [1/omega_c]
    past_turn: float  # of q
    finer: float  # see `sizes_over`
    growth: float
    layers: float


@record
class March:
    """The march through a period: where it is, and what it has added up."""

    here: Point
    end: Point  # of the step
    trial: Point
    sums: PeriodResult  # over the period, before they are made means
    mode: float  # what the contact does
    dent: float  # under a tip that is off the surface [m]
    since: float  # when the tip left it
    time: float  # since the period began [1/omega_c]
    left: float  # of the period
    cos: float  # of the drive's phase
    sin: float
    turned: float  # when the contact last turned
    share: float  # of the length that a step should have
    deep: float  # q that the contact may come to [m^(1/2)]
    speed: float  # q'
    event: int  # at the end of the step
    cut: int  # 1 where the period ends before the step would


@kernel(inline=True)
def relaxation_rate(mode: float, u: Point, rate: float, kappa: float, since: float, layers: float) -> float:
    """Square of the density of steps in s that relaxation asks for, the contact having turned `since` ago.

    Next to a turn, on both sides, they are short against the relaxation time, `layers` times as much over dents, for
    most of what a contact remembers as it shrinks is what happened there.
    """
    q, v, slows = u.x, u.v, u.slope.v
    fast = layers * q * q * rate * rate
    if mode == on.SHRINKING:
        return q * q * rate * RATE_OF_STIFFNESS / (1 - kappa) + RATE_BEHIND_TURN * fast * math.exp(
            -max(1 - kappa, LEAST_FADING) * rate * since
        )
    return RATE_BEFORE_TURN * fast * math.exp(2 * q * max(v, 0.0) * rate / slows) if slows < 0 else 0.0


@kernel(inline=True)
def dented_share(law: Law, p: Any, gap: float, dent: float) -> float:
    """Share of the long-range force that a dent under the tip takes away, at most 1."""
    force = abs(longrange_force(law, gap, p))
    less = dent * abs(longrange_slope(law, gap, p))
    return less / (force + less) if less > 0 else 0.0


@kernel
def sizes_over(dent: float, kelvin: bool) -> tuple[float, float, float]:
    """Steps of a contact, those while it grows, both over others, and weight of its layers about a turn.

    They go with the dent met, over the free amplitude: the error that a dent adds is of order 6 in them.
    """
    if kelvin:
        return KELVIN_STEPS, 1.0, RATE_OVER_DENT
    share = min(max(math.log(dent / FAINT_DENT), 0.0) / math.log(DEEP_DENT / FAINT_DENT), 1.0) if dent > 0 else 0.0
    return (
        FAINT_STEPS ** (1 - share),
        GROWING_STEPS * (GROWING_OVER_DENT / GROWING_STEPS) ** share,
        RATE_OVER_DENT**share,
    )


@kernel
def pace_over(fixed: Surface, eta: float, dent: float) -> Pace:
    """Return what steps depend on over a dent [m]; a period that begins in contact counts as one over a deep dent."""
    kelvin, attracted = fixed.t0 > 0, fixed.p[col.LONGRANGE] != 0.0
    free = fixed.medium.drive / (2 * fixed.medium.alpha0)
    snap = 2 * CONTACT_WEIGHT * CONTACT_WEIGHT * abs(fixed.pull)
    flight = min((ATTRACTED_STEPS if attracted else FLIGHT_STEPS) * eta, max(eta, LONGEST_FLIGHT))
    relaxation, past = (0.0, PAST_KINK) if kelvin else (MOST_RELAXATION / fixed.rate, PAST_TURN)
    finer, growth, layers = sizes_over(dent / free if fixed.mode == on.OFF_SURFACE else 1.0, kelvin)
    return Pace(kelvin, free, snap, flight, eta, relaxation, past, finer, growth, layers)


@kernel(inline=True)
def depth_ahead(surface: Surface, pace: Pace, q: float, z: float, v: float) -> float:
    """q of the depth that a contact may come to."""
    pull = pace.snap + 2 * CONTACT_WEIGHT * CONTACT_WEIGHT * math.hypot(z, v)
    return depth_reached(surface.law, surface.p, surface.medium, q, v, pull)


@kernel(inline=True)
def contact_step(surface: Surface, pace: Pace, run: March) -> float:
    """Length of a step in contact [s]: by stiffness, the rate of sinking in, and relaxation."""
    u, p, medium = run.here, surface.p, surface.medium
    fast = max(abs(u.v), abs(run.speed))
    pull = 2 * CONTACT_WEIGHT * CONTACT_WEIGHT * math.hypot(medium.z0 + u.x * u.x, u.v)
    density = contact_rate(surface.law, p, medium, u.x) + (pace.snap + pull) + (CONTACT_WEIGHT * (fast / run.deep)) ** 2
    if not pace.kelvin:
        density += relaxation_rate(run.mode, u, surface.rate, surface.kappa, run.time - run.turned, pace.layers)
    size = pace.finer * (pace.growth if run.mode == on.GROWING else 1.0) / math.sqrt(density)
    h = run.share * pace.contact * size
    if not pace.kelvin:
        h = min(h, pace.relaxation / (u.x + math.sqrt(u.x * u.x + pace.relaxation * fast)))  # 2 q h + q' h^2
    return h


@kernel(inline=True)
def flight_step(surface: Surface, pace: Pace, run: March) -> float:
    """Length of a step out of contact [1/omega_c]."""
    law, p, u, dent = surface.law, surface.p, run.here, dent_at(surface, run.time)
    density = flight_rate(law, p, surface.medium, u.x - dent, u.v)
    if dent > 0:
        share = dented_share(law, p, u.x - dent, dent)
        density = math.hypot(density, RECOVERY_WEIGHT * surface.recovery * share**0.125)
    return min(run.left, pace.flight / density)
