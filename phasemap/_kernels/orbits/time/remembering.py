"""The equation of motion over a surface that remembers: Ting's contact for all histories, marched in time.

As `march`, by the steps of `edge`. The contact turns where q' changes its sign and ends where q falls through 0, both
at the end of a step (`edge_events`); out of it the tip is attracted by a surface that comes back with the time tau_c.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, Oscillator, contact_force, longrange_force, longrange_slope
from phasemap._kernels.orbits.time import elements as on
from phasemap._kernels.orbits.time.by_memory import recovery_of
from phasemap._kernels.orbits.time.edge import (
    DENT,
    INSIDE,
    OF_AIR,
    OF_COS,
    OF_LOSS,
    OF_MEAN,
    OF_SIN,
    OF_VIRIAL,
    PLACES,
    POINT,
    RATE,
    RECOVERY,
    SEEN,
    SLOPES,
    SUMS,
    TAU,
    V,
    X,
    at_edge,
    dent_at,
    depth_of,
    over_dent,
    potential,
    speed_of,
    step,
)
from phasemap._kernels.orbits.time.edge_events import find_edge, record, record_between, to_edge, to_instant, to_turn
from phasemap._kernels.orbits.time.march import HARD, MAX_STEPS, contact_rate, flight_rate, reach, root_of, turning
from phasemap._kernels.orbits.time.runge_kutta import turn
from phasemap._kernels.orbits.time.tip import AIR, COS, DEEPEST, LOST, MEAN, SIN, TOUCHES, VIRIAL, Z

if TYPE_CHECKING:
    from phasemap._kernels.orbits.time.runge_kutta import Numbers

FINER = 0.7  # steps of a Kelvin-Voigt contact, over others: its dents have kinks
COARSER, FAINT, DEEP = 1.4, 1e-5, 1e-2  # steps of the others where the dent met is less than that of the free amplitude
GROWTH, OVER_DENT = 1.3, 0.7  # steps of a contact that grows, over others; over dents that are not so faint
AT_MOST = 4.0  # relaxation times that a step takes: explicit ones are stable up to 6
BEFORE, BEHIND, LITTLE = 8.0, 2.0, 0.5  # of relaxation in the density of steps: about a turn; where little stays stiff
FADES = 0.3  # of 1/tau, least rate at which that ends after a turn: with 1/tau_c a stiff solid takes twice the steps
WITH_DENT = 3.0  # times the former, where the next tap meets what this one leaves
AFTER_TURN = 0.1
FLIGHT, ATTRACTED = 2.0, 1.0  # steps out of contact, over those of `march`: where nothing attracts; where a force does
RECOVERS = 0.25  # of the rate at which a dent under an attracted tip recovers, in the density of steps
FARTHEST = 0.5  # no longer than this, in 1/omega_c
BEYOND, KINK, NUDGE = 3e-3, 1e-6, 1e-9  # of q: how far past an old turn an edge has to come to stop there; just past
ASTRAY, SHORTEST = 0.3, 1e-4  # of a step: how far it may be off a line's; and the least of its length that is taken
PASSED = 5  # nodes of a dent that a step may pass
ROUNDING = 1e-14  # in 1/omega_c: what a last step leaves of a period by rounding, which would take twenty more to go
FORGOTTEN = 1e-9  # of the free amplitude: a dent that is gone


@kernel
def relaxation_rate(mode: float, u: np.ndarray, rate: float, kappa: float, since: float, layers: float) -> float:
    """Square of the density of steps in s that relaxation asks for, the contact having turned `since` ago.

    Next to a turn, on both sides, they are short against the relaxation time, `layers` times as much over dents, for
    most of what a contact remembers as it shrinks is what happened there.
    """
    q, v, slows = u[X], u[V], u[SLOPES + V]
    fast = layers * q * q * rate * rate
    if mode == on.SHRINKING:
        return q * q * rate * LITTLE / (1 - kappa) + BEHIND * fast * math.exp(-max(1 - kappa, FADES) * rate * since)
    return BEFORE * fast * math.exp(2 * q * max(v, 0.0) * rate / slows) if slows < 0 else 0.0


@kernel
def strays(m: np.ndarray, mode: float, u: np.ndarray, end: np.ndarray, h: float) -> bool:
    """Whether a step is too long for dents that nearly fit the tip, over which its edge runs far faster than it falls.

    Then the edge or the speed moves otherwise than slopes at both ends say, or the edge passes many nodes of a dent.
    """
    for i in range(V + 1):
        first, last = u[SLOPES + i], end[SLOPES + i]
        if not abs(end[i] - u[i] - 0.5 * h * (first + last)) <= ASTRAY * h * max(abs(first), abs(last)):
            return True
    j = int(m[on.OUTER]) - PASSED
    if mode != on.GROWING or j < 0:
        return False
    return u[X] < math.sqrt(m[on.node(m, True, j) + on.XI]) < end[X]


@kernel
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
        return FINER, 1.0, WITH_DENT
    share = min(max(math.log(dent / FAINT), 0.0) / math.log(DEEP / FAINT), 1.0) if dent > 0 else 0.0
    return COARSER ** (1 - share), GROWTH * (OVER_DENT / GROWTH) ** share, WITH_DENT**share


@kernel
def contact_step(
    law: Law, p: Any, plain: Numbers, mode: float, u: np.ndarray, sinks: float, rest: float, since: float,
    sizes: Numbers,
) -> float:  # fmt: skip
    """Length of a step in contact [s], over eta: by stiffness, `rest`, the rate of sinking in, and relaxation."""
    finer, growth, layers = sizes
    density = contact_rate(law, p, plain, u[X]) + rest + (HARD * sinks) ** 2
    if p[col.RELAXATION] > 0:
        density += relaxation_rate(mode, u, 1 / p[col.RELAXATION], p[col.RELAXING], since, layers)
    return finer * (growth if mode == on.GROWING else 1.0) / math.sqrt(density)


@kernel
def give(lever: np.ndarray, sums: np.ndarray, highest: float, acc: np.ndarray) -> None:
    """Fill what a period gives, as `tip` names it."""
    omega, stiffness = lever[col.OMEGA], lever[col.STIFFNESS]
    acc[COS], acc[SIN] = sums[OF_COS] * omega / math.pi, sums[OF_SIN] * omega / math.pi
    acc[MEAN] = sums[OF_MEAN] * omega / (2 * math.pi)
    acc[LOST] = sums[OF_LOSS] * stiffness
    acc[VIRIAL] = sums[OF_VIRIAL] * stiffness * omega / (2 * math.pi)
    acc[DEEPEST] = highest
    if len(acc) > AIR:
        acc[AIR] = sums[OF_AIR] * 2 * lever[col.ALPHA0] * stiffness


@kernel
def remember_period(oscillator: Oscillator, z0: float, eta: float, y: np.ndarray, acc: np.ndarray) -> int:
    """As `march.march_period`, over a surface that remembers; y has what `elements` names from entry 4 on."""
    law, p, lever = oscillator
    omega, compliance, alpha0, base = lever[col.OMEGA], 1 / lever[col.STIFFNESS], lever[col.ALPHA0], lever[col.BASE]
    edge_force = edge_slope = 0.0
    if p[col.LONGRANGE] != 0.0:
        edge_force = longrange_force(law, 0.0, p) * compliance
        edge_slope = longrange_slope(law, 0.0, p) * compliance
    pull = contact_force(law, 0.0, p) * compliance
    time, kappa = p[col.RELAXATION], p[col.RELAXING]
    kelvin = not time > 0
    recovery = recovery_of(p, lever)
    t0 = 1 / recovery if kelvin else 0.0
    kappa = 1.0 if kelvin else kappa
    rate = 0.0 if kelvin else 1 / time
    stiff = 1.5 * p[col.CONTACT] * compliance
    most = 0.0 if kelvin else AT_MOST / rate
    flight = min((FLIGHT if p[col.LONGRANGE] == 0.0 else ATTRACTED) * eta, max(eta, FARTHEST))
    beyond = KINK if kelvin else BEYOND
    plain = (omega, alpha0, compliance, base, z0, edge_force, edge_slope, 0.0)
    snap, free = 2 * HARD * HARD * abs(pull), base / (2 * alpha0)

    m, u, end, trial = y, np.zeros(POINT), np.zeros(POINT), np.zeros(POINT)
    mode, d, v = m[on.MODE], y[Z] - z0, y[V]
    dent = 0.0
    if mode == on.FREE and m[on.OUTER] > 0:
        dent = kappa * on.outside(m, 0.0, 0.0, recovery)[0]
        if dent < FORGOTTEN * free:
            m[on.OUTER], dent = 0.0, 0.0
    sizes = sizes_over(dent / free if mode == on.FREE else 1.0, kelvin)
    fixed = (omega, alpha0, compliance, base, z0, edge_force, edge_slope, stiff, kappa, rate, recovery, t0, pull)
    c = over_dent(fixed, dent, 0.0)
    u[V], u[X] = v, d
    if mode != on.FREE:
        u[X], u[SEEN], u[INSIDE] = m[on.EDGE], m[on.SEEN], m[on.INSIDE]
        q = find_edge(m, c, mode, d, u)
        u[INSIDE] += at_edge(m, c[RATE], c[RECOVERY], mode, q, u[SEEN], 0.0)[0] * (q - u[X]) if t0 == 0 else 0.0
        u[X] = q
    elif d > dent:  # pushed in at once, and so all elements touched at the same time
        mode, u[X], u[SEEN] = on.GROWING, 0.0, d
        u[X] = find_edge(m, c, mode, d, u)
        m[on.INNER] = 0.0
        if t0 == 0:
            on.lay(m, False, 0.0, 0.0, (d - on.outside(m, 0.0, 0.0, recovery)[0], -1.0, 0.0), on.OPEN, rate)
        u[TAU] = 0.0
        record(m, c, mode, u, 0.0, speed_of(law, p, c, m, mode, (0.0, 1.0, 0.0), u))
    deep = reach(law, p, plain, max(u[X], 0.0), v, snap + 2 * HARD * HARD * math.hypot(y[Z], v)) if mode > 0 else 0.0
    highest, grade, gone, turned = d, 1.0, 0.0, 0.0
    cosine, sine, left = math.cos(m[on.BEGIN]), math.sin(m[on.BEGIN]), 2 * math.pi / omega
    sums = np.zeros(SUMS)
    sums[OF_LOSS] = -potential(law, p, c, mode, u[X], d, 0.0)
    steps, speed = 0, 0.0
    what = 1  # at the end of a step, 1: first touch, 2: last touch, 3: turn, 4: past one of before
    while left > ROUNDING:
        steps += 1
        if steps > MAX_STEPS:
            return -col.NOT_SETTLED
        x, v = u[X], u[V]
        touching = mode != on.FREE
        start = (gone, cosine, sine)
        u[TAU] = 0.0
        if touching:
            if what != 0:
                speed = speed_of(law, p, c, m, mode, start, u)
            fast, rest = max(abs(v), abs(speed)), snap + 2 * HARD * HARD * math.hypot(z0 + x * x, v)
            h = grade * eta * contact_step(law, p, plain, mode, u, fast / deep, rest, gone - turned, sizes)
            if not kelvin:
                h = min(h, most / (x + math.sqrt(x * x + most * fast)))  # 2 q h + q' h^2
            grade = min(2 * grade, 1.0)
        else:
            dent = dent_at(c, gone)
            if c[DENT] > 0 and dent < FORGOTTEN * free:  # what is left of it comes back at once
                sums[OF_LOSS] -= dent * longrange_force(law, x, p) * compliance
                m[on.OUTER] = dent = 0.0
                c = over_dent(fixed, 0.0, 0.0)
            density = flight_rate(law, p, plain, x - dent, v)
            if dent > 0:
                density = math.hypot(density, RECOVERS * recovery * dented_share(law, p, x - dent, dent) ** 0.125)
            h = min(left, flight / density)
        step(law, p, c, m, mode, start, u, h, end)
        if touching:
            speed = speed_of(law, p, c, m, mode, start, end)
            while strays(m, mode, u, end, h) and grade > SHORTEST:
                h *= 0.5
                grade *= 0.5
                step(law, p, c, m, mode, start, u, h, end)
                speed = speed_of(law, p, c, m, mode, start, end)
        if not touching and v > 0 and end[V] < 0:
            # The highest point lies inside; the tip may touch there and be off again at the end.
            part = turning(x, v, end[X], end[V], h)
            step(law, p, c, m, mode, start, u, part, trial)
            if trial[X] > dent_at(c, gone + trial[TAU]):
                h = part
                for i in range(SUMS):
                    end[i] = trial[i]
            else:
                highest = max(highest, trial[X] + 0.5 * h * trial[V] ** 2 / (v - end[V]))
        what, whole = 0, True
        if not touching:
            if end[X] > dent_at(c, gone + end[TAU]):
                what = 1
                h = to_edge(law, p, c, m, mode, start, u, h, end)
        else:
            if mode == on.SHRINKING and end[X] <= 0:
                what = 2
                h = to_edge(law, p, c, m, mode, start, u, h, end)
                speed = speed_of(law, p, c, m, mode, start, end)
            if what == 0 and (speed < 0) == (mode == on.GROWING):
                what = 3
                h = to_turn(law, p, c, m, mode, start, u, h, end)
            if mode == on.GROWING and u[X] < on.passing(m) < (1 - beyond) * end[X]:
                what = 4
                h = to_edge(law, p, c, m, mode, start, u, h, end)
                end[X] = (1 + NUDGE) * on.passing(m)
            if end[TAU] >= left:
                h = to_instant(law, p, c, m, mode, start, u, h, end, left)
                what, end[TAU], whole = 0, left, False
            if v > 0 > end[V] and m[on.OUTER] > 0:  # over a dent the contact still grows where the tip is deepest
                speed = speed_of(law, p, c, m, mode, start, end)
                part = root_of(v, u[SLOPES + V], end[V], end[SLOPES + V], h)
                step(law, p, c, m, mode, start, u, part, trial)
                more = h * trial[V] ** 2 * trial[X] / (v - end[V])
                highest = max(highest, depth_of(m, c, mode, trial, gone + trial[TAU]) + more)
        if mode == on.GROWING and not kelvin and m[on.OUTER] == 0 and (what == 3 or (what == 0 and whole)):
            record_between(m, c, u, end, h, gone)
        left -= end[TAU]
        gone += end[TAU]
        for i in range(PLACES):
            u[i] = end[i]
            u[SLOPES + i] = end[SLOPES + i]
        for i in range(PLACES, SUMS):
            sums[i] += end[i]
            u[SLOPES + i] = end[SLOPES + i]
        b, s = turn(omega * end[TAU])
        cosine, sine = cosine * b - sine * s, sine * b + cosine * s
        start, u[TAU] = (gone, cosine, sine), 0.0
        if what == 1:
            sums[OF_LOSS] += potential(law, p, c, mode, 0.0, u[X], gone)
            mode, u[SEEN], u[INSIDE] = on.GROWING, u[X], 0.0
            sums[OF_LOSS] -= potential(law, p, c, mode, 0.0, u[SEEN], gone)
            u[X] = m[on.INNER] = 0.0
            deep = reach(law, p, plain, 0.0, u[V], snap + 2 * HARD * HARD * math.hypot(z0, u[V]))
        elif what == 2:
            u[X] = 0.0
        if mode != on.FREE:
            if what == 3:
                speed = 0.0
            elif what != 0 or not whole:
                speed = speed_of(law, p, c, m, mode, start, u)
            record(m, c, mode, u, gone, speed)
        if what == 2:
            d = depth_of(m, c, mode, u, gone)
            sums[OF_LOSS] += potential(law, p, c, mode, 0.0, d, gone)
            mode, u[X], m[on.INNER] = on.FREE, d, 0.0
            c = over_dent(fixed, d, gone)
            sums[OF_LOSS] -= potential(law, p, c, mode, 0.0, d, gone)
        elif what == 3 and mode == on.GROWING:
            bend = u[SLOPES + V]
            if m[on.OUTER] == 0 or u[V] >= 0:  # next to where the tip is deepest, on either side
                highest = max(highest, depth_of(m, c, mode, u, gone) - u[V] ** 2 * u[X] / bend)
            on.turn_back(m, u[X] * u[X], gone, recovery, rate)
            mode, grade, turned = on.SHRINKING, AFTER_TURN, gone
        elif what == 3:
            if kelvin:
                return -col.NOT_SETTLED
            on.turn_forth(m, u[X] * u[X], gone, rate)
            mode, grade = on.GROWING, AFTER_TURN
    d = depth_of(m, c, mode, u, gone)
    sums[OF_LOSS] += potential(law, p, c, mode, u[X], d, gone)
    m[on.MODE], m[on.EDGE], m[on.SEEN], m[on.INSIDE] = mode, u[X], u[SEEN], u[INSIDE]
    on.shift(m, gone)
    y[Z], y[V], y[TOUCHES] = z0 + d, u[V], 1.0 if mode != on.FREE else 0.0
    give(lever, sums, max(highest, d), acc)
    return steps
