"""Events of a contact that relaxes, at the end of a step: it begins, ends, turns or passes an old turn.

The contact turns where q' changes its sign and ends where q falls through 0. At each end of a step `lay_edge` lays down
what the surface is to remember.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator, contact_force
from phasemap._kernels.orbits.time import surface_memory as memory
from phasemap._kernels.orbits.time.arms import Arms, fill_arms, fill_kelvin, recovery_of, transform_arms
from phasemap._kernels.orbits.time.contact import (
    CONTACT_TURN,
    FIRST_TOUCH,
    LAST_TOUCH,
    NECK_BREAKS,
    NO_EVENT,
    OFF_SURFACE,
    OLD_TURN,
    PLACE_OF_X,
    DrivenLever,
    Here,
    Motion,
    MotionPoint,
    Moved,
    attraction_at_contact,
    edge_of,
    first_moved,
    pass_event,
    stop_at_event,
)
from phasemap._kernels.orbits.time.equation_of_motion import (
    advance,
    beam_over,
    begin_period,
    end_period,
    end_step_at_event,
    march_period,
    stop_at_touch,
    stop_at_turn,
    time_of_crossing,
    try_turn,
)
from phasemap._kernels.orbits.time.modes import Modes, fill_modes
from phasemap._kernels.orbits.time.neck import form_or_break_neck
from phasemap._kernels.orbits.time.relaxing import (
    Memory,
    Relaxing,
    dent_at,
    dent_at_edge,
    lay_edge,
    place_of_arm,
    stored_energy,
    tip_depth,
)
from phasemap._kernels.orbits.time.relaxing_steps import (
    DENT_FORGOTTEN,
    PAST_KINK,
    PAST_TURN,
    STEP_AFTER_TURN,
    pace_over,
    strays_from_line,
)
from phasemap._kernels.orbits.time.runge_kutta import find_slopes, take_step
from phasemap._kernels.orbits.time.step_density import depth_reached, pull_in_contact
from phasemap._kernels.orbits.time.tip import TOUCHES, PeriodResult

MOST_TURN_STEPS = 50  # of a search for a turn, or for an edge
NEAR_TURN = 1e-5  # of a step: how far from the turn of the contact
NEAR_KINK = 1e-12  # the same where the speed of the edge has a step
JUST_PAST = 1e-9  # of q
SHORTEST_SHARE = 1e-4  # of a step's length: the least that is taken


@kernel
def shorten_to_turn(here: Here, motion: Motion) -> None:
    """Shorten a step to the turn of the contact, q' = 0.

    At first q' is the quadratic with its values at both ends and its mean; then by secants between two sides.
    """
    end, h = motion.end, motion.h
    first, last, mean = motion.here.slope.x, end.slope.x, (end.at.x - motion.here.at.x) / h
    b, a = 6 * mean - 4 * first - 2 * last, 3 * (first + last) - 6 * mean
    root = math.sqrt(max(b * b - 4 * a * first, 0.0))
    share = -2 * first / (b - root) if first > 0 else -2 * first / (b + root)
    low, high, bend = 0.0, h, (b + 2 * a * share) / h
    old, old_speed = 0.0, 0.0
    near = NEAR_KINK if here.contact.t0 > 0 else NEAR_TURN
    h = h * share if 0 < share < 1 else 0.5 * h
    for i in range(MOST_TURN_STEPS):
        take_step(here, motion, h, end)
        find_slopes(here, motion, end)
        speed = end.slope.x
        if (speed > 0) == (first > 0):
            low = h
        else:
            high = h
        if i > 0 and old_speed != speed:
            bend = (speed - old_speed) / (h - old)
        move = -speed / bend
        if abs(move) < near * high or high - low < near * high:
            break
        old, old_speed = h, speed
        h += move
        if not low < h < high:
            h = 0.5 * (low + high)
    motion.h, motion.event = h, CONTACT_TURN


@kernel
def find_edge(contact: Relaxing, d: float, u: Moved) -> float:
    """Edge q of a contact whose tip is at depth d at time 0: Newton from the one that it had, 0 if there is none."""
    if contact.now.mode == memory.SHRINKING and contact.t0 > 0:
        return math.sqrt(max(d + contact.t0 * u.v, 0.0))
    q = u.x if u.x > 0 else math.sqrt(max(d, 0.0))
    for _ in range(MOST_TURN_STEPS):
        w, slope, _ = dent_at_edge(contact, u, q, 0.0)
        missed = q * q + w - d
        if abs(missed) <= 1e-15 * (abs(d) + q * q) or not q > 0:
            break
        q = max(q - missed / (2 * q * (1 + slope)), 0.1 * q)
    return q


@edge_of.of(Relaxing)
@kernel(inline=True)
def _edge(contact: Relaxing, event: int, time: float) -> tuple[float, float]:
    """Return x at which an event is, and its rate: a touch is at the dent that comes back, a pass at an old edge.

    A neck of liquid forms and breaks at gaps over the dent.
    """
    if event in (FIRST_TOUCH, NECK_BREAKS):
        dent, rise = dent_at(contact, time)
        if event == NECK_BREAKS:
            return dent + contact.p[col.RELEASE], -rise
        return (dent if contact.now.held == 1 else dent + contact.p[col.FORMING]), -rise
    return memory.edge_of_old_turn(contact.m) if event == OLD_TURN else 0.0, 0.0


@kernel(inline=True)
def neck_would_break(contact: Relaxing, motion: Motion, point: MotionPoint) -> bool:
    """True if a neck of liquid would have broken at a point of the step."""
    return point.at.x < edge_of(contact, NECK_BREAKS, motion.time + point.at.passed)[0]


@stop_at_event.of(Relaxing)
@kernel(inline=True)
def _stop_at_event(contact: Relaxing, here: Here, motion: Motion) -> None:
    """End the step where the tip touches or leaves, or the contact turns, grows past an old edge or comes to a node.

    A step whose motion strays from what the surface was laid out for is halved first.
    """
    u, end, m, now = motion.here.at, motion.end, contact.m, contact.now
    if now.mode == OFF_SURFACE:
        if now.held == 1 and u.v < 0 < end.at.v:
            h, _ = try_turn(here, motion)
            if neck_would_break(contact, motion, motion.trial):
                stop_at_turn(motion, h)
        stop_at_touch(here, motion)
        if now.held == 1 and neck_would_break(contact, motion, end):
            end_step_at_event(here, motion, NECK_BREAKS)
        return
    find_slopes(here, motion, end)
    while strays_from_line(contact, motion) and now.share > SHORTEST_SHARE:
        now.share *= 0.5
        advance(here, motion, 0.5 * motion.h)
        find_slopes(here, motion, end)
    if now.mode == memory.SHRINKING and end.at.x <= 0:
        end_step_at_event(here, motion, LAST_TOUCH)
        find_slopes(here, motion, end)
    elif (end.slope.x < 0) == (now.mode == memory.GROWING):
        shorten_to_turn(here, motion)
    if now.mode == memory.GROWING:
        if u.x < memory.edge_of_old_turn(m) < (1 - (PAST_KINK if contact.t0 > 0 else PAST_TURN)) * end.at.x:
            end_step_at_event(here, motion, OLD_TURN)
            find_slopes(here, motion, end)
            end.at.x = (1 + JUST_PAST) * memory.edge_of_old_turn(m)
    if u.v > 0 > end.at.v and m[memory.OUTER_COUNT] > 0:
        _note_depth(contact, here, motion)


@kernel
def _note_depth(contact: Relaxing, here: Here, motion: Motion) -> None:
    """Note the largest depth of the tip in a step over a dent, where the contact's edge may turn later than the tip.

    The trial step ends where the tip is nearly at rest. With x = q and dtau = 2 q ds its v falls by (u.v - end.v)/(2 q
    h) in a time, and v^2/2 over that is what is left to the deepest point.
    """
    u, end, trial, h = motion.here, motion.end, motion.trial, motion.h
    take_step(here, motion, time_of_crossing(u.at.v, u.slope.v, end.at.v, end.slope.v, h), trial)
    more = h * trial.at.v**2 * trial.at.x / (u.at.v - end.at.v)
    depth = tip_depth(contact, trial.at, motion.time + trial.at.passed) + more
    motion.sums.deepest = max(motion.sums.deepest, depth)


@kernel
def note_expected_depth(contact: Relaxing, beam: DrivenLever, q: float, z: float, u: Moved) -> None:
    """Note the depth that the contact of a tip at z [m] may come to: the lengths of steps depend on it."""
    contact.now.deep = depth_reached(contact, beam, q, u.v, pull_in_contact(contact, beam, z, u))


@kernel
def rest_dashpots(contact: Relaxing, u: Moved, depth: float) -> None:
    """Put the dashpots of all arms at rest at the depth [m] at which a contact begins: creep counts from there."""
    for j in range(first_moved(contact), PLACE_OF_X, 2):
        u.arms[j], u.arms[j + 1] = depth, 0.0


@kernel
def begin_contact(contact: Relaxing, here: Here, motion: Motion) -> None:
    """Let a contact begin at the depth to which the tip has come; x is the contact's edge from here on.

    What was stored in the dent and is not stored in the contact counts as lost.
    """
    u, depth = motion.here.at, motion.here.at.x
    motion.sums.loss += stored_energy(contact, 0.0, depth, motion.time)
    contact.now.mode, contact.now.held, u.x = memory.GROWING, 0, 0.0
    rest_dashpots(contact, u, depth)
    motion.sums.loss -= stored_energy(contact, 0.0, depth, motion.time)
    contact.m[memory.INNER_COUNT] = 0.0
    note_expected_depth(contact, here.beam, 0.0, here.beam.z0, u)


@kernel
def end_contact(contact: Relaxing, motion: Motion) -> None:
    """Let a contact end, over the dent that it leaves."""
    now, arms, m, depth = contact.now, contact.arms, contact.m, tip_depth(contact, motion.here.at, motion.time)
    motion.sums.loss += stored_energy(contact, 0.0, depth, motion.time)
    memory.fill_dents_outside(m, 0.0, motion.time, arms)
    for j in range(arms.count):
        now.dents[j] = arms.value[j]
    now.mode, now.dented, now.since, motion.here.at.x, m[memory.INNER_COUNT] = OFF_SURFACE, 1, motion.time, depth, 0.0
    now.held = 1 if contact.p[col.RELEASE] < 0.0 else 0
    motion.sums.loss -= stored_energy(contact, 0.0, depth, motion.time)


@kernel
def turn_contact(contact: Relaxing, motion: Motion) -> bool:
    """Let a contact that grew shrink, or the other way round; False where a Kelvin-Voigt surface cannot."""
    u, m, now, t = motion.here.at, contact.m, contact.now, motion.time
    now.share = STEP_AFTER_TURN
    if now.mode == memory.GROWING:
        if m[memory.OUTER_COUNT] == 0 or u.v >= 0:  # next to where the tip is deepest, on either side
            top = tip_depth(contact, u, t) - u.v**2 * u.x / motion.here.slope.v
            motion.sums.deepest = max(motion.sums.deepest, top)
        memory.end_growth(m, u.x * u.x, t, contact.t0 > 0, contact.arms)
        now.mode, now.turned = memory.SHRINKING, t
        return True
    if contact.t0 > 0:
        return False
    memory.resume_growth(m, u.x * u.x, t, contact.arms)
    now.mode = memory.GROWING
    return True


@pass_event.of(Relaxing)
@kernel(inline=True)
def _pass_event(contact: Relaxing, here: Here, motion: Motion) -> bool:
    """Begin, turn or end the contact at the event that ended the step, and keep its edge there; False if it cannot."""
    event, u, speed, forming = motion.event, motion.here, 0.0, contact.p[col.FORMING] < 0.0 and contact.now.held == 0
    if event == NECK_BREAKS or (event == FIRST_TOUCH and forming):
        form_or_break_neck(contact, motion)
    elif event == FIRST_TOUCH:
        begin_contact(contact, here, motion)
    elif event == LAST_TOUCH:
        u.at.x = 0.0
    if contact.now.mode != OFF_SURFACE:
        if event not in (NO_EVENT, CONTACT_TURN) or u.known == 0:
            find_slopes(here, motion, u)
        if event != CONTACT_TURN:
            speed = u.slope.x
        lay_edge(contact, u.at, motion.time, speed)
    if event != NO_EVENT:
        u.known = 0
    if event == LAST_TOUCH:
        end_contact(contact, motion)
    return event != CONTACT_TURN or turn_contact(contact, motion)


@kernel
def begin_on_surface(contact: Relaxing, here: Here, touched: bool, motion: Motion) -> None:
    """Begin a march on the surface that m remembers, in `contact.m`; a tip that `touched` is still in a neck of liquid.

    The tip is in the contact of m; in one that begins at once, where it is below the dent; or off the surface.
    """
    m, u, now, arms, d = contact.m, motion.here.at, contact.now, contact.arms, motion.here.at.x
    if now.mode != OFF_SURFACE:
        u.x = m[memory.CONTACT_EDGE]
        for j in range(first_moved(contact), PLACE_OF_X):
            u.arms[j] = m[memory.ARM_NUMBERS + j]
        q = find_edge(contact, d, u)
        if contact.t0 == 0:
            dent_at_edge(contact, u, q, 0.0)
            more = memory.pressed_to(contact.layer, q, d)[1] * (q - u.x)
            for a in range(arms.count):
                u.arms[place_of_arm(a) + 1] += arms.y[a] * more
        u.x = q
    elif d > dent_at(contact, 0.0)[0]:  # all elements touched at the same time
        now.mode, u.x = memory.GROWING, 0.0
        rest_dashpots(contact, u, d)
        u.x = find_edge(contact, d, u)
        m[memory.INNER_COUNT] = 0.0
        if contact.t0 == 0:
            memory.fill_dents_outside(m, 0.0, 0.0, arms)
            transform_arms(arms.to_arms, arms)
            for a in range(arms.count):
                arms.value[a], arms.slope[a], arms.curve[a] = d - arms.value[a], -1.0, 0.0
            memory.lay_node(m, False, 0.0, 0.0, memory.OPEN_PEAK, arms)
        find_slopes(here, motion, motion.here)
        lay_edge(contact, u, 0.0, motion.here.slope.x)
        motion.here.known = 0
    elif d - dent_at(contact, 0.0)[0] > contact.p[col.RELEASE if touched else col.FORMING]:
        now.held = 1
    if now.mode != OFF_SURFACE:
        note_expected_depth(contact, here.beam, max(u.x, 0.0), here.beam.z0 + d, u)
    motion.sums.loss = -stored_energy(contact, u.x, d, 0.0)


@kernel
def find_dent(m: np.ndarray, now: Memory, arms: Arms, free: float) -> float:
    """Fill in the dent under a tip that begins a period off the surface; returns its depth [m], 0 where it is gone."""
    if m[memory.OUTER_COUNT] == 0:
        return 0.0
    memory.fill_dents_outside(m, 0.0, 0.0, arms)
    depth = float(arms.value[: arms.count].sum())
    if depth < DENT_FORGOTTEN * free:
        m[memory.OUTER_COUNT] = 0.0
        return 0.0
    for j in range(arms.count):
        now.dents[j] = arms.value[j]
    now.dented = 1
    return depth


@kernel
def march_relaxing(oscillator: Oscillator, z0: float, step_size: float, y: np.ndarray, acc: PeriodResult) -> int:
    """March a period over a surface that remembers, as `march_oscillator` does; `surface_memory` names entries of y."""
    law, p, lever = oscillator
    motion, modes, now, arms, compliance = Motion(), Modes(), Memory(), Arms(), 1 / lever[col.STIFFNESS]
    fill_modes(lever, modes)
    beam, u = beam_over(lever, z0, modes), motion.here.at
    begin_period(beam, y, motion)
    free, t0 = beam.drive / (2 * beam.alpha0), 0.0
    if p[col.RELAXATION] > 0:
        fill_arms(p, arms)
    else:
        fill_kelvin(recovery_of(p, lever), arms)
        t0 = 1 / arms.recovery[0]
    if len(y) < memory.memory_size(arms.count):
        return -col.NOT_SETTLED
    if y[memory.ARMS_KNOWN] != arms.count and y[memory.CONTACT_MODE] != OFF_SURFACE:  # another material
        y[memory.CONTACT_MODE], y[memory.INNER_COUNT], y[memory.OUTER_COUNT] = OFF_SURFACE, 0.0, 0.0
    y[memory.ARMS_KNOWN], now.mode, now.share, met = arms.count, int(y[memory.CONTACT_MODE]), 1.0, free
    if now.mode == OFF_SURFACE:
        met = find_dent(y, now, arms, free)
    stiff, pull = 1.5 * p[col.CONTACT] * compliance, contact_force(law, 0.0, p) * compliance
    edge_force, edge_slope = attraction_at_contact(law, p, compliance)
    pace = pace_over(met, free, t0 > 0)
    layer = memory.layer_of(p)
    contact = Relaxing(law, p, compliance, pull, edge_force, edge_slope, y, stiff, layer, arms, t0, pace, now)
    here = Here(contact, beam)
    begin_on_surface(contact, here, y[TOUCHES] != 0.0, motion)
    steps, t = march_period(here, step_size, motion), motion.time
    depth = tip_depth(contact, u, t)
    motion.sums.loss += stored_energy(contact, u.x, depth, t)
    y[memory.CONTACT_MODE], y[memory.CONTACT_EDGE] = now.mode, u.x
    for j in range(first_moved(contact), PLACE_OF_X):
        y[memory.ARM_NUMBERS + j] = u.arms[j]
    memory.shift_times(y, t)
    y[TOUCHES] = 1.0 if now.mode != OFF_SURFACE or now.held == 1 else 0.0
    end_period(lever, here, motion, depth, y, acc)
    return steps
