"""The full equation of motion, marched over one period: slow, and what all other orbits are checked against.

    z'' + 2 (alpha0 + alpha_s(d)) z' + z + F(d)/k = u0 cos(omega tau),    d = z - z0          (Wang 1999, Eq. 1)

by an explicit Runge-Kutta method of order 8 (`runge_kutta`) on steps laid out by a smooth density; no control repeats
them, so the error is C eta^8 (theory, Eqs. (time-1) and (time-2)). Order 8 needs an analytic right-hand side, and F ~
d^(3/2), alpha_s ~ d^(1/2) are not:

* out of contact the state is (d, v) and the independent variable s is the time tau;
* in contact it is (q, v), q = sqrt(d), with dtau = 2 q ds:    q' = v,    v' = 2 q z'',    tau' = 2 q,
  in which every multiple of 1/2 is an analytic power of d, through q = 0 and beyond;
* each change from one to the other is the end of a step.

All are x' = v, v' = w z'', tau' = w with (x, w) = (d, 1) or (q, 2 q). What the surface does is a plug-in (`contact`).
A step goes to the first event in it: the cubic through both ends says where about, Newton's method on the step's length
where exactly.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.numerics import newton_in_bracket
from phasemap._kernels.orbits.time.contact import (
    FIRST_TOUCH,
    NO_EVENT,
    OFF_SURFACE,
    PERIOD_ENDS,
    PLACE_OF_X,
    TURNED,
    DrivenLever,
    Here,
    Motion,
    MotionPoint,
    edge_of,
    first_moved,
    pass_event,
    step_length,
    stop_at_event,
)
from phasemap._kernels.orbits.time.modes import Modes
from phasemap._kernels.orbits.time.runge_kutta import cosine_and_sine, find_slopes, take_step
from phasemap._kernels.orbits.time.step_density import HIGHER_WEIGHT
from phasemap._kernels.orbits.time.surface_memory import PERIOD_BEGIN
from phasemap._kernels.orbits.time.tip import PLAIN_STATE, PeriodResult, V, Z
from phasemap._kernels.records import assign, numbers_of

MOST_MARCH_STEPS = 100_000  # in one period, after which it is given up
MOST_EVENT_STEPS = 50  # of Newton's method to an event, bisections among them
LAST_NEWTON_STEP = 1e-7  # of a step's length, from which on the tangent does the rest, and leaves 1e-14
LEFT_BY_ROUNDING = 1e-14  # [1/omega_c], of a period: it would take twenty steps more to go
CROSSING_STEPS = 8  # of Newton's method on the cubic, from where that on the step begins
SMALL_TURN = 1.0  # [rad] of the drive's phase, up to which its series serves


@kernel
def _cubic(x0: float, v0: float, x1: float, v1: float, h: float) -> tuple[float, float, float]:
    """Coefficients of t, t^2, t^3 of the cubic through both ends of a step, t = 0 ... 1 along it."""
    rise = x1 - x0
    return h * v0, 3 * rise - h * (2 * v0 + v1), h * (v0 + v1) - 2 * rise


@kernel
def time_of_turn(x0: float, v0: float, x1: float, v1: float, h: float) -> float:
    """Time in a step with v0 > 0 > v1 at which the cubic is highest."""
    a, b, c = _cubic(x0, v0, x1, v1, h)
    return h * a / (math.sqrt(b * b - 3 * a * c) - b)


@kernel
def time_of_crossing(x0: float, v0: float, x1: float, v1: float, h: float) -> float:
    """Time [1/omega_c] in a step at which its cubic changes sign, by Newton's method from its end."""
    a, b, c = _cubic(x0, v0, x1, v1, h)
    low, high, t = 0.0, 1.0, 1.0
    for _ in range(CROSSING_STEPS):
        x, slope = x0 + t * (a + t * (b + t * c)), a + t * (2 * b + t * 3 * c)
        t, low, high = newton_in_bracket(t, x, slope, low, high, x1 > 0)
    return t * h


@kernel(inline=True)
def advance(here: Here, motion: Motion, h: float) -> None:
    """Take a step of length h, in which nothing happens yet."""
    motion.h, motion.event = h, NO_EVENT
    take_step(here, motion, h, motion.end)


@kernel
def try_turn(here: Here, motion: Motion) -> tuple[float, float]:
    """Take a trial step to where x turns inside the step, by the cubic; returns its length, and x at the turn."""
    u, end, top = motion.here.at, motion.end.at, motion.trial.at
    sign = 1.0 if u.v > 0 else -1.0
    h = time_of_turn(sign * u.x, sign * u.v, sign * end.x, sign * end.v, motion.h)
    take_step(here, motion, h, motion.trial)
    return h, top.x + 0.5 * motion.h * top.v**2 / (u.v - end.v)


@kernel
def stop_at_turn(motion: Motion, h: float) -> None:
    """Let the step end where the trial step of this length did: both its ends may hide an event."""
    motion.h = h
    assign(motion.end, motion.trial)


@kernel(inline=True)
def overshoot_of_event(here: Here, motion: Motion, event: int, point: MotionPoint) -> tuple[float, float]:
    """Distance of x past the edge of an event at a point of the step, or time past the period's end; and its slope.

    In contact dt = 2 x ds, so time past the end has slope 2 x. All slopes are found where a contact makes that of x
    other than v.
    """
    if event == PERIOD_ENDS:
        return point.at.passed - motion.time_left, 2 * point.at.x
    if event == TURNED:
        if point.known == 0:
            find_slopes(here, motion, point)
        return point.at.v, point.slope.v
    edge, moves = edge_of(here.contact, event, motion.time + point.at.passed)
    speed = point.at.v
    if here.contact.now.mode != OFF_SURFACE and first_moved(here.contact) < PLACE_OF_X:
        if point.known == 0:
            find_slopes(here, motion, point)
        speed = point.slope.x
    return point.at.x - edge, speed - moves


@kernel
def end_step_at_event(here: Here, motion: Motion, event: int) -> None:
    """Shorten a step across an event to end at the event, by Newton's method within a bracket.

    The last correction of the time is so small that the state is moved along its slope instead of stepped again.
    """
    end, low, high, whole = motion.end, 0.0, motion.h, motion.h
    past, slope = overshoot_of_event(here, motion, event, end)
    before, first = overshoot_of_event(here, motion, event, motion.here)
    beyond, h = past > 0, time_of_crossing(before, first, past, slope, whole)
    for _ in range(MOST_EVENT_STEPS):
        take_step(here, motion, h, end)
        past, slope = overshoot_of_event(here, motion, event, end)
        move = -past / slope
        if abs(move) <= LAST_NEWTON_STEP * whole:
            find_slopes(here, motion, end)
            numbers, rates = numbers_of(end.at), numbers_of(end.slope)
            for j in range(len(numbers)):
                numbers[j] += move * rates[j]
            h += move
            break
        h, low, high = newton_in_bracket(h, past, slope, low, high, beyond)
    motion.h, motion.event, end.known = h, event, 0


@kernel(inline=True)
def stop_at_touch(here: Here, motion: Motion) -> None:
    """Shorten a step off the surface to the first touch, if there is one."""
    u, end = motion.here.at, motion.end.at
    if u.v > 0 > end.v:  # grazing: the tip may touch there, and be off again at the end
        h, top = try_turn(here, motion)
        if overshoot_of_event(here, motion, FIRST_TOUCH, motion.trial)[0] > 0:
            stop_at_turn(motion, h)
        else:
            motion.sums.deepest = max(motion.sums.deepest, top)
    if overshoot_of_event(here, motion, FIRST_TOUCH, motion.end)[0] > 0:
        end_step_at_event(here, motion, FIRST_TOUCH)


@kernel(inline=True)
def _step_to_event(here: Here, step_size: float, motion: Motion) -> None:
    """Take a step to what happens first, or to the end of the period."""
    off, h = here.contact.now.mode == OFF_SURFACE, step_length(here.contact, here.beam, step_size, motion)
    advance(here, motion, min(h, motion.time_left) if off else h)
    stop_at_event(here.contact, here, motion)
    if not off and motion.end.at.passed >= motion.time_left:
        end_step_at_event(here, motion, PERIOD_ENDS)
        motion.event = NO_EVENT


@kernel(inline=True)
def _move_on(here: Here, motion: Motion) -> None:
    """Take the end of a step as the start of the next one, and add up its integrals."""
    u, end, sums, beam = motion.here.at, motion.end.at, motion.sums, here.beam
    angle = beam.omega * end.passed
    sums.cos += end.cos
    sums.sin += end.sin
    sums.mean_z += end.mean_z
    sums.loss += end.loss
    sums.virial += end.virial
    sums.air += end.air
    sums.second_cos += end.second_cos
    sums.second_sin += end.second_sin
    c, s = cosine_and_sine(angle) if angle < SMALL_TURN else (math.cos(angle), math.sin(angle))
    motion.cos, motion.sin = motion.cos * c - motion.sin * s, motion.sin * c + motion.cos * s
    motion.time += end.passed
    motion.time_left -= end.passed
    u.x, u.v = end.x, end.v
    for j in range(first_moved(here.contact), PLACE_OF_X):
        u.arms[j] = end.arms[j]
    for j in range(2 * beam.modes.count - 2):
        u.modes[j] = end.modes[j]
    u.passed, motion.here.known = 0.0, motion.end.known
    if motion.end.known == 1:
        assign(motion.here.slope, motion.end.slope)


@kernel
def march_period(here: Here, step_size: float, motion: Motion) -> int:
    """March from the beginning of a period to its end; returns the steps taken, or minus a status."""
    steps = 0
    while motion.time_left > LEFT_BY_ROUNDING:
        steps += 1
        if steps > MOST_MARCH_STEPS:
            return -col.NOT_SETTLED
        _step_to_event(here, step_size, motion)
        _move_on(here, motion)
        if not pass_event(here.contact, here, motion):
            return -col.NOT_SETTLED
    return steps if math.isfinite(motion.here.at.x + motion.here.at.v) else -col.NOT_SETTLED


@kernel(light=True)
def beam_over(lever: np.ndarray, z0: float, modes: Modes) -> DrivenLever:
    """The lever over a tip offset [m]."""
    rate = 1.0 + HIGHER_WEIGHT * HIGHER_WEIGHT * (modes.fastest - 1.0)
    return DrivenLever(lever[col.OMEGA], lever[col.ALPHA0], lever[col.DRIVE], z0, rate, modes.share, modes)


@kernel
def begin_period(beam: DrivenLever, y: np.ndarray, motion: Motion) -> None:
    """Set the lever's motion to that of a state."""
    u, begin = motion.here.at, y[PERIOD_BEGIN] if len(y) > PERIOD_BEGIN else 0.0
    u.x, u.v = y[Z] - beam.z0, y[V]
    for j in range(2 * beam.modes.count - 2):
        u.modes[j] = y[PLAIN_STATE + j]
    motion.cos, motion.sin, motion.sums.deepest = math.cos(begin), math.sin(begin), u.x
    motion.time_left = 2 * math.pi / beam.omega


@kernel
def end_period(lever: np.ndarray, here: Here, motion: Motion, depth: float, y: np.ndarray, acc: PeriodResult) -> None:
    """Store the motion of a tip at this depth [m] in a state, and turn integrals over the period into observables."""
    sums, omega, stiffness = motion.sums, lever[col.OMEGA], lever[col.STIFFNESS]
    y[Z], y[V] = here.beam.z0 + depth, motion.here.at.v
    for j in range(2 * here.beam.modes.count - 2):
        y[PLAIN_STATE + j] = motion.here.at.modes[j]
    acc.cos, acc.sin = sums.cos * omega / math.pi, sums.sin * omega / math.pi
    acc.second_cos, acc.second_sin = sums.second_cos * omega / math.pi, sums.second_sin * omega / math.pi
    acc.mean_z = sums.mean_z * omega / (2 * math.pi)
    acc.loss = sums.loss * stiffness
    acc.virial = sums.virial * stiffness * omega / (2 * math.pi)
    acc.deepest = max(sums.deepest, depth)
    acc.air = sums.air * 2 * lever[col.ALPHA0] * stiffness
