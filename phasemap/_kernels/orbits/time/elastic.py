"""Contact with a surface that remembers nothing: elastic or damped, with a neck if the law has one.

In contact x = q = sqrt(d); in the neck, which a law with a depth of release d_r < 0 draws out on the way back,
q = sqrt(d - d_r), in which the force of JKR, a power series in q, is analytic up to release. `Touch.bottom`, 0 or d_r,
is the depth where q = 0. A neck of liquid forms on the way in, where its films meet at p[FORMING] < 0.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.law import Law, Oscillator, contact_force, damping, withdrawn_force
from phasemap._kernels.orbits.time.contact import (
    FIRST_TOUCH,
    LAST_TOUCH,
    NECK_BREAKS,
    NECK_CLOSES,
    NO_EVENT,
    OFF_SURFACE,
    PLACE_OF_X,
    TURNED,
    DrivenLever,
    Here,
    Motion,
    Moved,
    Push,
    Row,
    attraction_at,
    attraction_at_contact,
    edge_of,
    fill_own_slopes,
    first_moved,
    pass_event,
    push_of,
    step_length,
    stop_at_event,
)
from phasemap._kernels.orbits.time.equation_of_motion import (
    beam_over,
    begin_period,
    end_period,
    end_step_at_event,
    march_period,
    stop_at_touch,
    stop_at_turn,
    try_turn,
)
from phasemap._kernels.orbits.time.modes import Modes, fill_modes
from phasemap._kernels.orbits.time.neck import NECK_DRAWN, break_neck, draw_neck
from phasemap._kernels.orbits.time.step_density import (
    CONTACT_WEIGHT,
    LEAST_GAP_IN_NECK,
    approach_square,
    contact_rate,
    depth_reached,
    flight_rate,
    pull_in_contact,
)
from phasemap._kernels.orbits.time.tip import TOUCHES, WITHDRAWING, PeriodResult
from phasemap._kernels.records import record

CONTACT_MADE = 1  # what the contact does, beside OFF_SURFACE and NECK_DRAWN


@record
class Touch:
    """State of the contact now."""

    mode: int
    bottom: float  # depth where x = 0 [m]
    deep: float  # q of the depth to which it goes, roughly [m^(1/2)]
    withdrawing: int  # 1 from the deepest point on, where the law has another force on the way out


class Elastic(NamedTuple):
    """A surface that remembers nothing."""

    law: Law
    p: Row  # parameters of the material
    compliance: float  # 1/k [m/N]
    pull: float  # force at d = 0 in contact, over k [m]
    edge_force: float  # the long-range force at contact, over k [m]
    edge_slope: float  # its derivative there, over k
    neck: float  # q of the surface in the neck; 0 without one
    now: Touch


@kernel(inline=True)
def outer_loss(d: float, p: Row) -> float:
    """2 alpha_s [1] outside contact, of a law with losses: theory, Eq. (losses-1)."""
    return 2.0 * p[col.LOSS] * math.exp(d * p[col.LOSS_FALL])


@kernel(inline=True)
def has_withdrawal_force(contact: Any) -> bool:
    """True if the force is another one on the way out of contact."""
    return contact.law.lossy != 0 and contact.p[col.WITHDRAWN] > 0.0


@push_of.of(Elastic)
@kernel(inline=True, fastmath=ANY_ORDER)
def _push(contact: Elastic, off: bool, time: float, y: Moved) -> Push:
    """Force of an elastic surface: x is d off the surface, else the root q of the depth above `bottom`."""
    if off:
        lost = outer_loss(y.x, contact.p) if contact.law.lossy == 1 else 0.0
        return Push(1.0, y.x, attraction_at(contact, y.x), lost)
    law, p, bottom, drag = contact.law, contact.p, contact.now.bottom, 0.0
    d = bottom + y.x * y.x
    if p[col.DAMPING] != 0.0 and bottom == 0.0:
        drag = 2 * damping(law, d, p)
    force = contact_force(law, d, p)
    if contact.now.withdrawing == 1:
        force -= withdrawn_force(law, d, p)
    return Push(2 * y.x, d, force * contact.compliance, drag)


@first_moved.of(Elastic)
@kernel(inline=True)
def _first_moved(contact: Elastic) -> int:
    """Place of x: an elastic surface has no motion of its own."""
    return PLACE_OF_X


@fill_own_slopes.of(Elastic)
@kernel(inline=True)
def _fill_own_slopes(contact: Elastic, off: bool, push: Push, y: Moved, a: float, k: Moved) -> float:
    """Fill in dx/ds, which is the tip's speed; returns the power that the surface takes, but for its drag."""
    k.x = y.v
    if off or contact.now.withdrawing == 0:
        return 0.0
    return -push.w * y.v * withdrawn_force(contact.law, push.depth, contact.p) * contact.compliance


@step_length.of(Elastic)
@kernel(inline=True)
def _step_length(contact: Elastic, beam: DrivenLever, step_size: float, motion: Motion) -> float:
    """Length of the next step: less where the motion is fast, off the surface, in contact or in the neck."""
    u, now, neck = motion.here.at, contact.now, contact.neck
    if now.mode == OFF_SURFACE:
        return step_size / flight_rate(contact, beam, u.x, u.v)
    # v / deep is the rate at which stiffness builds up; from q = 0 the local rate does not see it coming.
    rate = contact_rate(contact, beam, now.bottom, u.x)
    rate += pull_in_contact(contact, beam, beam.z0 + now.bottom + u.x * u.x, u) + (CONTACT_WEIGHT * u.v / now.deep) ** 2
    if now.mode == NECK_DRAWN and contact.p[col.FORMING] < 0.0:
        d = min(now.bottom + u.x * u.x, LEAST_GAP_IN_NECK * now.bottom)
        rate += 4 * u.x * u.x * approach_square(contact, beam, d, u.v, True)
    if neck > 0 and now.mode == CONTACT_MADE:
        rate += (CONTACT_WEIGHT * u.v) ** 2 / (u.x * u.x + neck * neck)  # the root at release, seen from contact
    return step_size / math.sqrt(rate)


@edge_of.of(Elastic)
@kernel(inline=True)
def _edge(contact: Elastic, event: int, time: float) -> tuple[float, float]:
    """Return x at which an event is, and its rate: contact begins at 0, or where a neck forms or closes."""
    if event == FIRST_TOUCH:
        return contact.p[col.FORMING], 0.0
    return contact.neck if event == NECK_CLOSES else 0.0, 0.0


@stop_at_event.of(Elastic)
@kernel(inline=True)
def _stop_at_event(contact: Elastic, here: Here, motion: Motion) -> None:
    """End the step where the tip touches, turns on a law with a pull on withdrawal, leaves the contact or its neck."""
    now, u, end, inside = contact.now, motion.here.at, motion.end.at, motion.trial.at
    if now.mode == OFF_SURFACE:
        stop_at_touch(here, motion)
        return
    in_neck = now.mode == NECK_DRAWN
    if u.v > 0 > end.v and now.withdrawing == 0 and has_withdrawal_force(contact):
        end_step_at_event(here, motion, TURNED)
        return
    if u.v > 0 > end.v:
        h, top = try_turn(here, motion)
        if in_neck and inside.x > contact.neck:
            stop_at_turn(motion, h)
        else:
            motion.sums.deepest = max(motion.sums.deepest, now.bottom + top * top)
    elif in_neck and u.v < 0 < end.v:
        h, _ = try_turn(here, motion)
        if inside.x <= 0:
            stop_at_turn(motion, h)
    if in_neck and end.x > contact.neck:
        end_step_at_event(here, motion, NECK_CLOSES)
    elif end.x <= 0:
        end_step_at_event(here, motion, NECK_BREAKS if in_neck else LAST_TOUCH)


@kernel
def _enter_contact(contact: Elastic, beam: DrivenLever, q: float, motion: Motion) -> None:
    """Let the tip be in contact, at q."""
    now, u = contact.now, motion.here.at
    now.mode, now.bottom, now.withdrawing, u.x = CONTACT_MADE, 0.0, 0, q
    now.deep = depth_reached(contact, beam, q, u.v, pull_in_contact(contact, beam, beam.z0 + q * q, u))


@pass_event.of(Elastic)
@kernel(inline=True)
def _pass_event(contact: Elastic, here: Here, motion: Motion) -> bool:
    """Change the contact as the event at the end of the step demands, and count the energy lost there.

    Where the tip turns it withdraws; where films meet, or contact ends over a neck, it is in the neck; where it comes
    to the surface it is in contact; where the neck breaks, or contact ends without one, it is off the surface.
    """
    event, u = motion.event, motion.here.at
    if event == NO_EVENT:
        return True
    if event == TURNED:
        contact.now.withdrawing = 1
        motion.sums.deepest = max(motion.sums.deepest, u.x * u.x)
        return True
    if event == FIRST_TOUCH and contact.p[col.FORMING] < 0.0:
        draw_neck(contact, math.sqrt(contact.p[col.FORMING] - contact.p[col.RELEASE]), motion)
    elif event == LAST_TOUCH and contact.neck > 0 and u.v <= 0:
        draw_neck(contact, contact.neck, motion)
    elif event == NECK_BREAKS:
        break_neck(contact, motion)
    elif u.v > 0:
        _enter_contact(contact, here.beam, 0.0, motion)
    else:
        contact.now.mode, u.x = OFF_SURFACE, 0.0
    return True


@kernel(shared=True)
def march_elastic(oscillator: Oscillator, z0: float, step_size: float, y: np.ndarray, acc: PeriodResult) -> int:
    """March for a period of the drive over a surface without memory: see `march.march_oscillator`."""
    # Not `parameters`: p is a row of numbers or numbers already, and this takes both.
    law, p, lever = oscillator
    row: Row = (p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8], p[9], p[10], p[11], p[12], p[13], p[14], p[15])
    motion, modes, compliance = Motion(), Modes(), 1 / lever[col.STIFFNESS]
    fill_modes(lever, modes)
    beam, u = beam_over(lever, z0, modes), motion.here.at
    begin_period(beam, y, motion)
    edge_force, edge_slope = attraction_at_contact(law, row, compliance)
    pull, neck = contact_force(law, 0.0, row) * compliance, math.sqrt(-row[col.RELEASE])
    contact = Elastic(law, row, compliance, pull, edge_force, edge_slope, neck, Touch())
    if u.x > 0 or (u.x == 0 and u.v > 0):
        _enter_contact(contact, beam, math.sqrt(u.x), motion)
        if has_withdrawal_force(contact) and (y[TOUCHES] == WITHDRAWING or u.v < 0.0):
            contact.now.withdrawing = 1
    elif contact.neck > 0 and (u.x > row[col.RELEASE] if y[TOUCHES] != 0.0 else u.x > row[col.FORMING]):
        draw_neck(contact, math.sqrt(u.x - row[col.RELEASE]), motion)
    here = Here(contact, beam)
    steps = march_period(here, step_size, motion)
    touches = contact.now.mode != OFF_SURFACE
    if contact.neck > 0 or law.lossy != 0:
        y[TOUCHES] = (WITHDRAWING if contact.now.withdrawing == 1 else 1.0) if touches else 0.0
    end_period(lever, here, motion, contact.now.bottom + u.x * u.x if touches else u.x, y, acc)
    return steps
