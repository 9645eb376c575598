"""The equation of motion over a surface that remembers: Ting's contact for all histories, marched in time.

As `march`, by the steps of `edge`. The contact turns where q' changes its sign and ends where q falls through 0, both
at the end of a step (`edge_events`), whose length is by `remembering_steps`; out of it the tip is attracted by a
surface that comes back with the time tau_c.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator, contact_force, longrange_force, longrange_slope
from phasemap._kernels.orbits.time import elements as on
from phasemap._kernels.orbits.time.by_memory import recovery_of
from phasemap._kernels.orbits.time.edge import (
    Instant,
    Point,
    Surface,
    at_edge,
    dent_at,
    potential,
    speed_of,
    step_over_memory,
    tip_depth,
)
from phasemap._kernels.orbits.time.edge_events import find_edge, lay_between, lay_edge, to_edge, to_instant, to_turn
from phasemap._kernels.orbits.time.march import (
    MOST_MARCH_STEPS,
    time_of_crossing,
    time_of_turn,
)
from phasemap._kernels.orbits.time.remembering_steps import (
    STEP_AFTER_TURN,
    March,
    Pace,
    contact_step,
    depth_ahead,
    flight_step,
    pace_over,
)
from phasemap._kernels.orbits.time.runge_kutta import Medium, turn
from phasemap._kernels.orbits.time.tip import TOUCHES, PeriodResult, V, Z
from phasemap._kernels.records import assign

JUST_PAST = 1e-9  # of q
STRAY_SHARE = 0.3  # of a step: how far it may be off a line's
SHORTEST_SHARE = 1e-4  # of a step's length: the least that is taken
MOST_NODES_PASSED = 5  # of a dent, in a step
LEFT_BY_ROUNDING = 1e-14  # [1/omega_c]: what a last step leaves of a period, which would take twenty more to go
DENT_FORGOTTEN = 1e-9  # of the free amplitude: a dent that is gone

# What happens at the end of a step.
NO_EVENT = 0
FIRST_TOUCH = 1
LAST_TOUCH = 2
CONTACT_TURN = 3
OLD_TURN = 4  # the edge passes where an earlier contact turned


@kernel
def off_line(first: float, last: float, way: float, h: float) -> bool:
    """Whether what moves by `way` in a step strays from a line between the slopes at both ends."""
    return not abs(way - 0.5 * h * (first + last)) <= STRAY_SHARE * h * max(abs(first), abs(last))


@kernel
def strays(surface: Surface, u: Point, end: Point, h: float) -> bool:
    """Whether a step is too long for dents that nearly fit the tip, over which its edge runs far faster than it falls.

    Then the edge or the speed moves otherwise than slopes at both ends say, or the edge passes many nodes of a dent.
    """
    if off_line(u.slope.x, end.slope.x, end.x - u.x, h) or off_line(u.slope.v, end.slope.v, end.v - u.v, h):
        return True
    j = int(surface.m[on.OUTER_COUNT]) - MOST_NODES_PASSED
    if surface.mode != on.GROWING or j < 0:
        return False
    return u.x < math.sqrt(surface.m[on.node_at(surface.m, True, j) + on.NODE_XI]) < end.x


@kernel
def surface_under(oscillator: Oscillator, z0: float, y: np.ndarray) -> Surface:
    """Return the surface as it is where a period begins."""
    law, p, lever = oscillator
    compliance, edge_force, edge_slope = 1 / lever[col.STIFFNESS], 0.0, 0.0
    if p[col.LONGRANGE] != 0.0:
        edge_force = longrange_force(law, 0.0, p) * compliance
        edge_slope = longrange_slope(law, 0.0, p) * compliance
    medium = Medium(
        lever[col.OMEGA], lever[col.ALPHA0], compliance, lever[col.DRIVE], z0, edge_force, edge_slope, 0.0, 1.0, 1.0
    )  # fmt: skip
    relaxes, recovery = p[col.RELAXATION] > 0, recovery_of(p, lever)
    kappa, rate, t0 = (p[col.RELAXING], 1 / p[col.RELAXATION], 0.0) if relaxes else (1.0, 0.0, 1 / recovery)
    stiff, pull = 1.5 * p[col.CONTACT] * compliance, contact_force(law, 0.0, p) * compliance
    return Surface(law, p, medium, y, y[on.CONTACT_MODE], stiff, kappa, rate, recovery, t0, pull, 0.0, 0.0)


@kernel(inline=True)
def surface_now(fixed: Surface, run: March) -> Surface:
    """Return the surface as the march has it now."""
    law, p, medium, m, _, stiff, kappa, rate, recovery, t0, pull, _, _ = fixed
    return Surface(law, p, medium, m, run.mode, stiff, kappa, rate, recovery, t0, pull, run.dent, run.since)


@kernel
def begin_period(fixed: Surface, z0: float, y: np.ndarray, run: March) -> None:
    """Fill in where the march begins: in contact as `y` says, pushed in at once, or off the surface."""
    m, u, d = fixed.m, run.here, y[Z] - z0
    u.v, u.x, run.mode = y[V], d, fixed.mode
    if run.mode != on.OFF_SURFACE:
        u.x, u.seen, u.inside = m[on.CONTACT_EDGE], m[on.DASHPOT_DEPTH], m[on.INNER_SUM]
        q = find_edge(fixed, d, u)
        u.inside += at_edge(fixed, q, u.seen, 0.0)[0] * (q - u.x) if fixed.t0 == 0 else 0.0
        u.x = q
    elif d > run.dent:  # all elements touched at the same time
        run.mode, u.x, u.seen = on.GROWING, 0.0, d
        surface = surface_now(fixed, run)
        u.x = find_edge(surface, d, u)
        m[on.INNER_COUNT] = 0.0
        if fixed.t0 == 0:
            touched = d - on.outside(m, 0.0, 0.0, fixed.recovery)[0]
            on.lay_node(m, False, 0.0, 0.0, (touched, -1.0, 0.0), on.OPEN_PEAK, fixed.rate)
        lay_edge(surface, u, 0.0, speed_of(surface, Instant(0.0, 1.0, 0.0), u))
    run.share, run.event, run.left = 1.0, FIRST_TOUCH, 2 * math.pi / fixed.medium.omega
    run.cos, run.sin, run.sums.deepest = math.cos(m[on.PERIOD_BEGIN]), math.sin(m[on.PERIOD_BEGIN]), d
    run.sums.loss = -potential(surface_now(fixed, run), u.x, d, 0.0)


@kernel(inline=True)
def forget_dent(fixed: Surface, pace: Pace, run: March) -> None:
    """Let what is left of a dent come back at once where that is next to nothing."""
    surface = surface_now(fixed, run)
    dent = dent_at(surface, run.time)
    if dent < DENT_FORGOTTEN * pace.free:
        run.sums.loss -= dent * longrange_force(fixed.law, run.here.x, fixed.p) * fixed.medium.compliance
        fixed.m[on.OUTER_COUNT] = run.dent = 0.0


@kernel(inline=True)
def take_contact_step(surface: Surface, pace: Pace, start: Instant, run: March) -> float:
    """Take a step in contact, as short as dents ask for, to what happens next; returns its length [s]."""
    u, end = run.here, run.end
    if run.event != NO_EVENT:
        run.speed = speed_of(surface, start, u)
    h = contact_step(surface, pace, run)
    run.share = min(2 * run.share, 1.0)
    step_over_memory(surface, start, u, h, end)
    run.speed = speed_of(surface, start, end)
    while strays(surface, u, end, h) and run.share > SHORTEST_SHARE:
        h *= 0.5
        run.share *= 0.5
        step_over_memory(surface, start, u, h, end)
        run.speed = speed_of(surface, start, end)
    h = contact_event(surface, pace, start, run, h)
    if u.v > 0 > end.v and surface.m[on.OUTER_COUNT] > 0:  # over a dent it still grows where the tip is deepest
        run.speed = speed_of(surface, start, end)
        part = time_of_crossing(u.v, u.slope.v, end.v, end.slope.v, h)
        step_over_memory(surface, start, u, part, run.trial)
        more = h * run.trial.v**2 * run.trial.x / (u.v - end.v)
        run.sums.deepest = max(run.sums.deepest, tip_depth(surface, run.trial, run.time + run.trial.passed) + more)
    return h


@kernel(inline=True)
def contact_event(surface: Surface, pace: Pace, start: Instant, run: March, h: float) -> float:
    """Shorten a step in contact to what happens in it, if anything does; returns its length [s]."""
    u, end, m = run.here, run.end, surface.m
    run.event = NO_EVENT
    if run.mode == on.SHRINKING and end.x <= 0:
        run.event = LAST_TOUCH
        h = to_edge(surface, start, u, h, end)
        run.speed = speed_of(surface, start, end)
    if run.event == NO_EVENT and (run.speed < 0) == (run.mode == on.GROWING):
        run.event = CONTACT_TURN
        h = to_turn(surface, start, u, h, end)
    if run.mode == on.GROWING and u.x < on.passing(m) < (1 - pace.past_turn) * end.x:
        run.event = OLD_TURN
        h = to_edge(surface, start, u, h, end)
        end.x = (1 + JUST_PAST) * on.passing(m)
    if end.passed >= run.left:
        h = to_instant(surface, start, u, h, end, run.left)
        run.event, end.passed, run.cut = NO_EVENT, run.left, 1
    return h


@kernel(inline=True)
def take_flight_step(surface: Surface, pace: Pace, start: Instant, run: March) -> float:
    """Take a step out of contact, to the first touch if there is one; returns its length [1/omega_c]."""
    u, end, trial = run.here, run.end, run.trial
    h = flight_step(surface, pace, run)
    step_over_memory(surface, start, u, h, end)
    if u.v > 0 and end.v < 0:
        # The highest point lies inside; the tip may touch there and be off again at the end.
        part = time_of_turn(u.x, u.v, end.x, end.v, h)
        step_over_memory(surface, start, u, part, trial)
        if trial.x > dent_at(surface, run.time + trial.passed):
            h = part
            assign(end, trial)
        else:
            run.sums.deepest = max(run.sums.deepest, trial.x + 0.5 * h * trial.v**2 / (u.v - end.v))
    run.event = NO_EVENT
    if end.x > dent_at(surface, run.time + end.passed):
        run.event = FIRST_TOUCH
        h = to_edge(surface, start, u, h, end)
    return h


@kernel(inline=True)
def move_on(omega: float, run: March) -> None:
    """Take up the end of a step as where the next one starts, and add up its integrals."""
    end, sums = run.end, run.sums
    run.left -= end.passed
    run.time += end.passed
    sums.cos += end.cos
    sums.sin += end.sin
    sums.mean_z += end.mean_z
    sums.loss += end.loss
    sums.virial += end.virial
    sums.air += end.air
    cosine, sine = turn(omega * end.passed)
    run.cos, run.sin = run.cos * cosine - run.sin * sine, run.sin * cosine + run.cos * sine
    assign(run.here, end)
    run.here.passed = 0.0


@kernel
def begin_contact(surface: Surface, fixed: Surface, pace: Pace, run: March) -> None:
    """Let a contact begin at the depth to which the tip has come."""
    u, depth = run.here, run.here.x
    run.sums.loss += potential(surface, 0.0, depth, run.time)
    run.mode, u.seen, u.inside = on.GROWING, depth, 0.0
    surface = surface_now(fixed, run)
    run.sums.loss -= potential(surface, 0.0, depth, run.time)
    u.x = surface.m[on.INNER_COUNT] = 0.0
    run.deep = depth_ahead(surface, pace, 0.0, surface.medium.z0, u.v)


@kernel
def end_contact(surface: Surface, fixed: Surface, run: March) -> None:
    """Let a contact end, over the dent that it leaves."""
    depth = tip_depth(surface, run.here, run.time)
    run.sums.loss += potential(surface, 0.0, depth, run.time)
    run.mode, run.here.x, fixed.m[on.INNER_COUNT] = on.OFF_SURFACE, depth, 0.0
    run.dent, run.since = depth, run.time
    run.sums.loss -= potential(surface_now(fixed, run), 0.0, depth, run.time)


@kernel
def turn_contact(surface: Surface, run: March) -> bool:
    """Let a contact that grew shrink, or the other way round; False where a Kelvin-Voigt surface cannot."""
    u, m, run.share = run.here, surface.m, STEP_AFTER_TURN
    if run.mode == on.GROWING:
        if m[on.OUTER_COUNT] == 0 or u.v >= 0:  # next to where the tip is deepest, on either side
            top = tip_depth(surface, u, run.time) - u.v**2 * u.x / u.slope.v
            run.sums.deepest = max(run.sums.deepest, top)
        on.turn_back(m, u.x * u.x, run.time, surface.recovery, surface.rate)
        run.mode, run.turned = on.SHRINKING, run.time
        return True
    if surface.t0 > 0:
        return False
    on.turn_forth(m, u.x * u.x, run.time, surface.rate)
    run.mode = on.GROWING
    return True


@kernel(inline=True)
def change_contact(fixed: Surface, pace: Pace, run: March) -> bool:
    """Lay down what the surface is to remember, and let happen what does at the end of a step; False if it cannot."""
    surface, event = surface_now(fixed, run), run.event
    if event == FIRST_TOUCH:
        begin_contact(surface, fixed, pace, run)
        surface = surface_now(fixed, run)
    elif event == LAST_TOUCH:
        run.here.x = 0.0
    if run.mode != on.OFF_SURFACE:
        if event == CONTACT_TURN:
            run.speed = 0.0
        elif event != NO_EVENT or run.cut == 1:
            run.speed = speed_of(surface, Instant(run.time, run.cos, run.sin), run.here)
        lay_edge(surface, run.here, run.time, run.speed)
    if event == LAST_TOUCH:
        end_contact(surface, fixed, run)
    return event != CONTACT_TURN or turn_contact(surface, run)


@kernel
def end_period(fixed: Surface, lever: np.ndarray, y: np.ndarray, run: March, acc: PeriodResult) -> None:
    """Fill state and result from where the march ends."""
    surface, u, m, sums = surface_now(fixed, run), run.here, fixed.m, run.sums
    d = tip_depth(surface, u, run.time)
    sums.loss += potential(surface, u.x, d, run.time)
    m[on.CONTACT_MODE], m[on.CONTACT_EDGE], m[on.DASHPOT_DEPTH], m[on.INNER_SUM] = run.mode, u.x, u.seen, u.inside
    on.shift(m, run.time)
    y[Z], y[V], y[TOUCHES] = fixed.medium.z0 + d, u.v, 1.0 if run.mode != on.OFF_SURFACE else 0.0
    omega, stiffness = lever[col.OMEGA], lever[col.STIFFNESS]
    acc.cos, acc.sin = sums.cos * omega / math.pi, sums.sin * omega / math.pi
    acc.mean_z = sums.mean_z * omega / (2 * math.pi)
    acc.loss = sums.loss * stiffness
    acc.virial = sums.virial * stiffness * omega / (2 * math.pi)
    acc.deepest = max(sums.deepest, d)
    acc.air = sums.air * 2 * lever[col.ALPHA0] * stiffness


@kernel
def remember_period(oscillator: Oscillator, z0: float, eta: float, y: np.ndarray, acc: PeriodResult) -> int:
    """As `march.march_period`, over a surface that remembers; y has what `elements` names from entry 4 on."""
    fixed, run, lever = surface_under(oscillator, z0, y), March(), oscillator.lever
    if fixed.mode == on.OFF_SURFACE and y[on.OUTER_COUNT] > 0:
        run.dent = fixed.kappa * on.outside(y, 0.0, 0.0, fixed.recovery)[0]
        if run.dent < DENT_FORGOTTEN * lever[col.DRIVE] / (2 * lever[col.ALPHA0]):
            y[on.OUTER_COUNT] = run.dent = 0.0
    pace = pace_over(fixed, eta, run.dent)
    begin_period(fixed, z0, y, run)
    if run.mode != on.OFF_SURFACE:
        run.deep = depth_ahead(fixed, pace, max(run.here.x, 0.0), y[Z], y[V])
    steps = 0
    while run.left > LEFT_BY_ROUNDING:
        steps += 1
        if steps > MOST_MARCH_STEPS:
            return -col.NOT_SETTLED
        if run.mode == on.OFF_SURFACE and run.dent > 0:
            forget_dent(fixed, pace, run)
        surface, start = surface_now(fixed, run), Instant(run.time, run.cos, run.sin)
        run.cut = 0
        if run.mode == on.OFF_SURFACE:
            h = take_flight_step(surface, pace, start, run)
        else:
            h = take_contact_step(surface, pace, start, run)
        whole = run.event == CONTACT_TURN or (run.event == NO_EVENT and run.cut == 0)
        if run.mode == on.GROWING and not pace.kelvin and y[on.OUTER_COUNT] == 0 and whole:
            lay_between(surface, run.here, run.end, h, run.time)
        move_on(fixed.medium.omega, run)
        if not change_contact(fixed, pace, run):
            return -col.NOT_SETTLED
    end_period(fixed, lever, y, run, acc)
    return steps
