"""The full equation of motion marched in time: the slow, independent truth.

    z'' + 2 (alpha0 + alpha_s(d)) z' + z + F(d)/k = u0 cos(omega tau),    d = z - z0          (Wang 1999, Eq. 1)

by an explicit Runge-Kutta method of order 8 (`runge_kutta`) on steps laid out by a smooth density; no control repeats
them, so the error is C eta^8 (theory, Eqs. (time-1) and (time-2)). Order 8 needs an analytic right-hand side, and F ~
d^(3/2), alpha_s ~ d^(1/2) are not:

* out of contact the state is (d, v) and the independent variable s is the time tau;
* in contact it is (q, v), q = sqrt(d), with dtau = 2 q ds:    q' = v,    v' = 2 q z'',    tau' = 2 q,
  in which every multiple of 1/2 is an analytic power of d, through q = 0 and beyond;
* in the neck, which a law with a depth of release d_r < 0 draws out on the way back, it is (q, v), q = sqrt(d - d_r),
  in which the force of JKR, a power series in q, is analytic up to release;
* each change from one to the other is the end of a step, found by Newton's method on the step's length.

All are x' = v, v' = w z'', tau' = w with (x, w) = (d, 1) or (q, 2 q); `touching` says which, and `bottom`, 0 or d_r, is
the depth where q = 0.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator, contact_force
from phasemap._kernels.neck import loop_energy
from phasemap._kernels.orbits.time.by_memory import by_memory, remembers
from phasemap._kernels.orbits.time.elements import CONTACT_MODE, INNER_COUNT, OUTER_COUNT, PERIOD_BEGIN
from phasemap._kernels.orbits.time.free_flight import fly
from phasemap._kernels.orbits.time.modes import Modes, fill_modes
from phasemap._kernels.orbits.time.runge_kutta import (
    Beam,
    End,
    Medium,
    Start,
    stage,
    step_in_contact,
    step_of_modes,
    step_off_surface,
    turn,
)
from phasemap._kernels.orbits.time.step_density import (
    CONTACT_WEIGHT,
    Motion,
    Surroundings,
    depth_reached,
    medium_aloft,
    medium_of,
    pull_of_lever,
    step_length,
)
from phasemap._kernels.orbits.time.tip import PLAIN_STATE, TOUCHES, PeriodResult, V, Z

if TYPE_CHECKING:
    from phasemap._kernels.orbits.time.runge_kutta import Row

MOST_MARCH_STEPS = 100_000
"""Steps in one period after which it is given up."""

LAST_NEWTON_STEP = 1e-7
"""Of a step's length: how near Newton's method comes to an edge before the tangent does the rest, and leaves 1e-14."""


@kernel
def _cubic(x0: float, v0: float, x1: float, v1: float, h: float) -> tuple[float, float, float]:
    """Coefficients of t, t^2, t^3 of the cubic through both ends of a step, t = 0 ... 1 along it."""
    rise = x1 - x0
    return h * v0, 3 * rise - h * (2 * v0 + v1), h * (v0 + v1) - 2 * rise


@kernel
def time_of_turn(x0: float, v0: float, x1: float, v1: float, h: float) -> float:
    """Where in a step with v0 > 0 > v1 the cubic is highest."""
    a, b, c = _cubic(x0, v0, x1, v1, h)
    return h * a / (math.sqrt(b * b - 3 * a * c) - b)


@kernel
def time_of_crossing(x0: float, v0: float, x1: float, v1: float, h: float) -> float:
    """Where in a step the cubic last changes sign before its end."""
    a, b, c = _cubic(x0, v0, x1, v1, h)
    low, high, t = 0.0, 1.0, 1.0
    for _ in range(8):
        x = x0 + t * (a + t * (b + t * c))
        if (x > 0) == (x1 > 0):
            high = t
        else:
            low = t
        t -= x / (a + t * (2 * b + t * 3 * c))
        if not low <= t <= high:
            t = 0.5 * (low + high)
    return t * h


@kernel(inline=True)
def _advance(here: Surroundings, fixed: Medium, touching: bool, start: Start, h: float) -> End:
    """Take one step of length h."""
    if here.modes.count > 1:
        return step_of_modes(Beam(here.law, here.p, fixed, here.modes, touching), start, h)
    if touching:
        return step_in_contact(here.law, here.p, fixed, start, h)
    return step_off_surface(here.law, here.p, fixed, start, h)


@kernel
def _to_edge(
    here: Surroundings, fixed: Medium, touching: bool, start: Start, h: float, end: End, edge: float
) -> tuple[float, End]:
    """Shorten a step across an edge to end on it: Newton on x(h) = edge, x' = v, kept between a side and the other.

    The last of Newton's steps is so small that the tangent of all that a step gives takes the place of another one.
    """
    low, high, whole = 0.0, h, h
    h = time_of_crossing(start.x - edge, start.v, end.x - edge, end.v, h)
    above = end.x <= edge
    for _ in range(50):
        end = _advance(here, fixed, touching, start, h)
        more = (edge - end.x) / end.v
        if abs(more) <= LAST_NEWTON_STEP * whole:
            return h + more, _along_tangent(here, fixed, touching, start, h, more, end, edge)
        if (end.x > edge) == above:
            low = h
        else:
            high = h
        h += more
        if not low <= h <= high:
            h = 0.5 * (low + high)
    return h, end


@kernel(inline=True)
def _along_tangent(
    here: Surroundings, fixed: Medium, touching: bool, start: Start, h: float, more: float, end: End, edge: float
) -> End:
    """End of a step that is longer by very little, at the edge; of several modes it is taken again."""
    if here.modes.count > 1:
        end = _advance(here, fixed, touching, start, h + more)
        return End(edge, end.v, end.passed, end.cos, end.sin, end.mean_z, end.loss, end.virial, end.air)
    w, a, c, s, m, e, f, o = stage(here.law, here.p, fixed, touching, start, end.x, end.v, end.passed)
    return End(
        edge, end.v + more * a, end.passed + more * w, end.cos + more * c, end.sin + more * s,
        end.mean_z + more * m, end.loss + more * e, end.virial + more * f, end.air + more * o,
    )  # fmt: skip


@kernel
def _to_instant(here: Surroundings, fixed: Medium, start: Start, h: float, end: End, time: float) -> tuple[float, End]:
    """Shorten a step in contact or neck to last `time`: Newton on tau(h) = time, tau' = 2 q."""
    low, high = 0.0, h
    for _ in range(50):
        h -= (end.passed - time) / (2 * end.x)
        if not low <= h <= high:
            h = 0.5 * (low + high)
        end = _advance(here, fixed, True, start, h)
        if abs(end.passed - time) <= 4e-16:
            break
        if end.passed < time:
            low = h
        else:
            high = h
    return h, end


@kernel
def enter_contact(here: Surroundings, motion: Motion, q: float) -> None:
    """Let the tip be in contact, at q."""
    z = here.aloft.z0 + q * q
    motion.x, motion.touching, motion.in_neck = q, 1, 0
    pull = here.snap + pull_of_lever(here.modes, motion, z)
    motion.deep = depth_reached(here.law, here.p, here.aloft, q, motion.v, pull)


@kernel
def set_out(here: Surroundings, y: np.ndarray, motion: Motion) -> None:
    """Put the tip where a state has it."""
    p, neck = here.p, here.neck
    motion.x, motion.v = y[Z] - here.aloft.z0, y[V]
    for j in range(2 * here.modes.count - 2):
        here.modes.now[j] = y[PLAIN_STATE + j]
    x = motion.highest = motion.x
    if x > 0 or (x == 0 and motion.v > 0):
        enter_contact(here, motion, math.sqrt(x))
    elif neck > 0 and y[TOUCHES] != 0.0 and x > p[col.RELEASE]:
        motion.touching = motion.in_neck = 1
        motion.x, motion.deep = math.sqrt(x - p[col.RELEASE]), neck
    motion.cos, motion.sin = 1.0, 0.0
    if here.law.memory != 0:
        motion.cos, motion.sin = math.cos(y[PERIOD_BEGIN]), math.sin(y[PERIOD_BEGIN])
    motion.left = 2 * math.pi / here.aloft.omega


@kernel
def _turn_inside(
    here: Surroundings, fixed: Medium, motion: Motion, start: Start, h: float, end: End
) -> tuple[float, End]:
    """Shorten a step in which the tip turns to end there, if both ends may hide a contact or a release.

    Keeps the largest depth.
    """
    touching, in_neck, x, v = motion.touching == 1, motion.in_neck == 1, start.x, start.v
    if v > 0 and end.v < 0:
        # The highest point lies inside: a step to where it should be, and half v^2 over the deceleration.
        part = time_of_turn(x, v, end.x, end.v, h)
        top = _advance(here, fixed, touching, start, part)
        height = top.x + 0.5 * h * top.v**2 / (v - end.v)
        if (in_neck or not touching) and top.x > (here.neck if in_neck else 0.0):  # grazing: both ends may be below
            return part, top
        motion.highest = max(motion.highest, fixed.bottom + height * height if touching else height)
    elif in_neck and v < 0 and end.v > 0:
        part = time_of_turn(-x, -v, -end.x, -end.v, h)
        low = _advance(here, fixed, touching, start, part)
        if low.x <= 0:  # both ends may be in the neck, with a release between
            return part, low
    else:
        return h, end
    # The modes above the first are at the end of the step tried last.
    return h, end if here.modes.count < 2 else _advance(here, fixed, touching, start, h)


@kernel
def _add_integrals(end: End, sums: PeriodResult) -> None:
    """Add what a step gives to the integrals over the period."""
    sums.cos += end.cos
    sums.sin += end.sin
    sums.mean_z += end.mean_z
    sums.loss += end.loss
    sums.virial += end.virial
    sums.air += end.air


@kernel
def _move(here: Surroundings, end: End, c: float, s: float, motion: Motion) -> None:
    """Put the tip at the end of a step, over which the drive's phase grew by an angle with this cosine and sine."""
    motion.x, motion.v = end.x, end.v
    motion.cos, motion.sin = motion.cos * c - motion.sin * s, motion.sin * c + motion.cos * s
    for j in range(2 * here.modes.count - 2):
        here.modes.now[j] = here.modes.end[j]


@kernel
def _pass_edge(here: Surroundings, motion: Motion, edge: float) -> int:
    """Let a tip at an edge be in contact, in the neck, or off the surface; returns 1 if it leaves a neck, else 0."""
    if motion.in_neck == 1 and edge == 0.0:
        motion.x, motion.touching, motion.in_neck = here.p[col.RELEASE], 0, 0
        return 1
    if motion.v <= 0 and motion.touching == 1 and here.neck > 0:
        motion.x = motion.deep = here.neck
        motion.in_neck = 1
    elif motion.v > 0:
        enter_contact(here, motion, 0.0)
    else:
        motion.x, motion.touching, motion.in_neck = 0.0, 0, 0
    return 0


@kernel
def fly_on(here: Surroundings, motion: Motion, start: Start, sums: PeriodResult) -> int:
    """March on to the next contact or the end of the period, where no force reaches beyond contact; returns 0."""
    end, height = fly(here.aloft, here.modes, start, motion.left)
    motion.highest = max(motion.highest, height)
    motion.left -= end.passed
    _add_integrals(end, sums)
    angle = here.aloft.omega * end.passed
    _move(here, end, math.cos(angle), math.sin(angle), motion)
    return _pass_edge(here, motion, 0.0) if end.x >= 0.0 else 0


@kernel
def march_step(here: Surroundings, eta: float, motion: Motion, sums: PeriodResult) -> int:
    """March on by a step, shorter where it crosses an edge or the end of the period; returns 1 if it leaves a neck."""
    fixed, touching, in_neck = medium_of(here, motion), motion.touching == 1, motion.in_neck == 1
    start = Start(motion.x, motion.v, motion.cos, motion.sin)
    if here.modes.count > 1 and not touching and here.p[col.LONGRANGE] == 0.0:
        return fly_on(here, motion, start, sums)
    h = step_length(here, fixed, eta, motion)
    end = _advance(here, fixed, touching, start, h)
    h, end = _turn_inside(here, fixed, motion, start, h, end)
    edge = here.neck if in_neck else 0.0  # the x of d = 0
    crosses = end.x <= edge if touching and not in_neck else end.x > edge
    if in_neck and end.x <= 0:
        crosses, edge = True, 0.0
    if crosses:
        h, end = _to_edge(here, fixed, touching, start, h, end, edge)
    if not touching:
        motion.left -= h
    elif end.passed < motion.left:
        motion.left -= end.passed
    else:
        h, end = _to_instant(here, fixed, start, h, end, motion.left)
        motion.left = 0.0
        crosses = False
    _add_integrals(end, sums)
    c, s = turn(fixed.omega * end.passed)
    _move(here, end, c, s, motion)
    return _pass_edge(here, motion, edge) if crosses else 0


@kernel
def put_state(here: Surroundings, motion: Motion, z: float, y: np.ndarray) -> None:
    """Put the tip, at z [m], into a state."""
    y[Z], y[V] = z, motion.v
    if here.neck > 0:
        y[TOUCHES] = motion.touching
    for j in range(2 * here.modes.count - 2):
        y[PLAIN_STATE + j] = here.modes.now[j]


@kernel
def fill_result(oscillator: Oscillator, sums: PeriodResult, deepest: float, releases: int, acc: PeriodResult) -> None:
    """Turn integrals over a period into what it gives."""
    law, p, lever = oscillator
    omega, stiffness = lever[col.OMEGA], lever[col.STIFFNESS]
    acc.cos = sums.cos * omega / math.pi
    acc.sin = sums.sin * omega / math.pi
    acc.mean_z = sums.mean_z * omega / (2 * math.pi)
    acc.loss = sums.loss * stiffness
    if releases > 0:
        acc.loss += releases * loop_energy(law, p)
    acc.virial = sums.virial * stiffness * omega / (2 * math.pi)
    acc.deepest = deepest
    acc.air = sums.air * 2 * lever[col.ALPHA0] * stiffness


@kernel
def march_period(oscillator: Oscillator, z0: float, eta: float, y: np.ndarray, acc: PeriodResult) -> int:
    """March for a period of the drive, as the surface is: see `march_elastic`.

    Where the law may remember, `y` goes on with what `elements` names, the drive phase at which the period begins too.
    """
    law, p, lever = oscillator
    if law.memory != 0:
        if remembers(p):
            return by_memory(law, p, lever, z0, eta, y, acc)
        y[CONTACT_MODE] = y[INNER_COUNT] = y[OUTER_COUNT] = 0.0  # over another material
    return march_elastic(oscillator, z0, eta, y, acc)


@kernel(shared=True)
def march_elastic(oscillator: Oscillator, z0: float, eta: float, y: np.ndarray, acc: PeriodResult) -> int:
    """March for a period of the drive over a surface without memory, from drive phase 0 on or as y says.

    Parameters
    ----------
    eta : float
        Size of the steps. The settled phase is off by less than 1e-4, 2e-6, 2e-9 degree at 0.5, 0.3, 0.15 in nine of
        ten orbits with Q <= 1000. The error is of order 8 in eta and proportional to Q.
    y : ndarray
        State as `tip` names it, advanced in place. Whether the tip is in contact or neck is left out
        and not asked for where the law has no neck: depth says it.
    acc : PeriodResult
        Filled. The energy into the surface is by damping, and that of the loop at each release;
        the virial is of the whole surface force.

    Returns
    -------
    int
        Steps taken, or minus a status.
    """
    # Not `parameters`: p is a row of numbers or numbers already, and this takes both.
    law, p, lever = oscillator
    row: Row = (p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8], p[9], p[10], p[11])
    motion, modes, sums = Motion(), Modes(), PeriodResult()
    fill_modes(lever, modes)
    aloft = medium_aloft(Oscillator(law, row, lever), z0, modes)
    snap = 2 * CONTACT_WEIGHT * CONTACT_WEIGHT * abs(contact_force(law, 0.0, row)) * aloft.compliance * modes.share
    here = Surroundings(law, row, aloft, snap, math.sqrt(-row[col.RELEASE]), modes)
    set_out(here, y, motion)
    steps = releases = 0
    while motion.left > 0:
        steps += 1
        if steps > MOST_MARCH_STEPS:
            return -col.NOT_SETTLED
        releases += march_step(here, eta, motion, sums)
    x, touching = motion.x, motion.touching == 1
    if not math.isfinite(x + motion.v):
        return -col.NOT_SETTLED
    d = medium_of(here, motion).bottom + x * x if touching else x
    put_state(here, motion, z0 + d, y)
    fill_result(Oscillator(law, row, lever), sums, max(motion.highest, d), releases, acc)
    return steps
