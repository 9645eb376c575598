"""The equation of motion over a surface that remembers: Ting's contact for all histories, marched in time.

As `march`, by the steps of `edge`. The contact turns where q' changes its sign and ends where q falls through 0, both
at the end of a step (`edge_events`); out of it the tip is attracted by a surface that comes back with the time tau_c.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, contact_force, longrange_force, longrange_slope
from phasemap._kernels.orbits.time import elements as on
from phasemap._kernels.orbits.time.by_memory import recovery_of
from phasemap._kernels.orbits.time.edge import (
    INSIDE,
    SEEN,
    SUMS,
    TAU,
    V,
    X,
    at_edge,
    dent_at,
    depth_of,
    speed_of,
    step,
)
from phasemap._kernels.orbits.time.edge_events import find_edge, record, to_edge, to_instant, to_turn
from phasemap._kernels.orbits.time.march import HARD, MAX_STEPS, contact_rate, flight_rate, reach, turning
from phasemap._kernels.orbits.time.runge_kutta import turn

PLACES = 5
FINER = 0.7  # steps of a Kelvin-Voigt contact, over others: its dents have kinks
COARSER, FAINT = 1.4, 1e-5  # steps of the others where the dent met is less than that of the free amplitude
RELAXES, AT_ONCE = 5.0, 0.06  # of relaxation in the density of steps: where little stays stiff, where it is fast
AFTER_TURN = 0.25
BEYOND, KINK, NUDGE = 3e-3, 1e-6, 1e-9  # of q: how far past an old turn an edge has to come to stop there; just past
FORGOTTEN = 3e-8  # of the free amplitude: a dent that is gone


@kernel
def remember_period(law: Law, p: Any, lever: np.ndarray, z0: float, eta: float, y: np.ndarray, acc: np.ndarray) -> int:
    """As `march.march_period`, over a surface that remembers; y has what `elements` names from entry 4 on."""
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
    relaxes = 0.0 if kelvin else rate * (AT_ONCE * rate + RELAXES / (1 - kappa))
    finer, beyond = (FINER, KINK) if kelvin else (1.0, BEYOND)
    plain = (omega, alpha0, compliance, base, z0, edge_force, edge_slope, 0.0)
    snap, free = 2 * HARD * HARD * abs(pull), base / (2 * alpha0)

    m, u, end, trial = y, np.zeros(PLACES), np.zeros(SUMS), np.zeros(SUMS)
    mode, d, v = m[on.MODE], y[0] - z0, y[1]
    dent = 0.0
    if mode == on.FREE and m[on.OUTER] > 0:
        dent = kappa * on.outside(m, 0.0, 0.0, recovery)[0]
        if dent < FORGOTTEN * free:
            m[on.OUTER], dent = 0.0, 0.0
    if not kelvin and mode == on.FREE and dent < FAINT * free:
        finer = COARSER
    c = (
        omega, alpha0, compliance, base, z0, edge_force, edge_slope, stiff, kappa, rate, recovery, t0, pull, dent,
        0.0,
    )  # fmt: skip
    u[V], u[X] = v, d
    if mode != on.FREE:
        u[X], u[SEEN], u[INSIDE] = m[on.EDGE], m[on.SEEN], m[on.INSIDE]
        q = find_edge(m, c, mode, d, u)
        u[INSIDE] += at_edge(m, c[9], c[10], mode, q, u[SEEN], 0.0)[0] * (q - u[X]) if t0 == 0 else 0.0
        u[X] = q
    elif d > dent:  # pushed in at once, and so all elements touched at the same time
        mode, u[X], u[SEEN] = on.GROWING, 0.0, d
        u[X] = find_edge(m, c, mode, d, u)
        m[on.INNER] = 0.0
        if t0 == 0:
            on.lay(m, False, 0.0, 0.0, (d - on.outside(m, 0.0, 0.0, recovery)[0], -1.0, 0.0), on.OPEN, rate)
        u[TAU] = 0.0
        record(m, c, mode, u, 0.0, speed_of(law, p, c, m, mode, (0.0, 1.0, 0.0), u)[0])
    deep = reach(law, p, plain, max(u[X], 0.0), v, snap + 2 * HARD * HARD * math.hypot(y[0], v)) if mode > 0 else 0.0
    highest, grade, gone = d, 1.0, 0.0
    cosine, sine, left = 1.0, 0.0, 2 * math.pi / omega
    sums = np.zeros(SUMS)
    steps, speed = 0, 0.0
    what = 1  # at the end of a step, 1: first touch, 2: last touch, 3: turn, 4: past one of before
    while left > 0:
        steps += 1
        if steps > MAX_STEPS:
            return -col.NOT_SETTLED
        x, v = u[X], u[V]
        touching = mode != on.FREE
        start = (gone, cosine, sine)
        u[TAU] = 0.0
        if touching:
            if what != 0:
                speed = speed_of(law, p, c, m, mode, start, u)[0]
            density = contact_rate(law, p, plain, x) + snap + 2 * HARD * HARD * math.hypot(z0 + x * x, v)
            density += (HARD * max(abs(v), abs(speed)) / deep) ** 2 + x * x * relaxes
            h = grade * finer * eta / math.sqrt(density)
            grade = min(2 * grade, 1.0)
        else:
            h = min(left, eta / flight_rate(law, p, plain, x - dent_at(c, gone), v))
        step(law, p, c, m, mode, start, u, h, end)
        if not touching and v > 0 and end[V] < 0:
            # The highest point lies inside; the tip may touch there and be off again at the end.
            part = turning(x, v, end[X], end[V], h)
            step(law, p, c, m, mode, start, u, part, trial)
            highest = max(highest, trial[X] + 0.5 * h * trial[V] ** 2 / (v - end[V]))
            if trial[X] > dent_at(c, gone + trial[TAU]):
                h = part
                for i in range(SUMS):
                    end[i] = trial[i]
        what, whole = 0, True
        if not touching:
            if end[X] > dent_at(c, gone + end[TAU]):
                what = 1
                to_edge(law, p, c, m, mode, start, u, h, end)
        else:
            if mode == on.SHRINKING and end[X] <= 0:
                what = 2
                to_edge(law, p, c, m, mode, start, u, h, end)
            speed = speed_of(law, p, c, m, mode, start, end)[0]
            if what == 0 and (speed < 0) == (mode == on.GROWING):
                what = 3
                h = to_turn(law, p, c, m, mode, start, u, h, end)
            if mode == on.GROWING and u[X] < on.passing(m) < (1 - beyond) * end[X]:
                what = 4
                to_edge(law, p, c, m, mode, start, u, h, end)
                end[X] = (1 + NUDGE) * on.passing(m)
            if end[TAU] >= left:
                to_instant(law, p, c, m, mode, start, u, h, end, left)
                what, end[TAU], whole = 0, left, False
        left -= end[TAU]
        gone += end[TAU]
        for i in range(PLACES):
            u[i] = end[i]
        for i in range(PLACES, SUMS):
            sums[i] += end[i]
        b, s = turn(omega * end[TAU])
        cosine, sine = cosine * b - sine * s, sine * b + cosine * s
        start, u[TAU] = (gone, cosine, sine), 0.0
        if what == 1:
            mode, u[SEEN], u[INSIDE] = on.GROWING, u[X], 0.0
            u[X] = m[on.INNER] = 0.0
            deep = reach(law, p, plain, 0.0, u[V], snap + 2 * HARD * HARD * math.hypot(z0, u[V]))
        elif what == 2:
            u[X] = 0.0
        if mode != on.FREE:
            if what == 3:
                speed = 0.0
            elif what != 0 or not whole:
                speed = speed_of(law, p, c, m, mode, start, u)[0]
            record(m, c, mode, u, gone, speed)
        if what == 2:
            d = depth_of(m, c, mode, u, gone)
            mode, u[X], m[on.INNER] = on.FREE, d, 0.0
            c = (
                omega, alpha0, compliance, base, z0, edge_force, edge_slope, stiff, kappa, rate, recovery, t0, pull,
                d, gone,
            )  # fmt: skip
        elif what == 3 and mode == on.GROWING:
            bend = speed_of(law, p, c, m, mode, start, u)[1]
            highest = max(highest, depth_of(m, c, mode, u, gone) - u[V] ** 2 * u[X] / bend)
            on.turn_back(m, u[X] * u[X], gone, recovery, rate)
            mode, grade = on.SHRINKING, AFTER_TURN
        elif what == 3:
            if kelvin:
                return -col.NOT_SETTLED
            on.turn_forth(m, u[X] * u[X], gone, rate)
            mode, grade = on.GROWING, AFTER_TURN
    d = depth_of(m, c, mode, u, gone)
    m[on.MODE], m[on.EDGE], m[on.SEEN], m[on.INSIDE] = mode, u[X], u[SEEN], u[INSIDE]
    on.shift(m, gone)
    y[0], y[1], y[2] = z0 + d, u[V], 1.0 if mode != on.FREE else 0.0
    acc[0], acc[1] = sums[5] * omega / math.pi, sums[6] * omega / math.pi
    acc[2] = sums[7] * omega / (2 * math.pi)
    acc[3] = sums[8] * lever[col.STIFFNESS]
    acc[4] = sums[9] * lever[col.STIFFNESS] * omega / (2 * math.pi)
    acc[5] = max(highest, d)
    if len(acc) > 6:
        acc[6] = sums[10] * 2 * alpha0 * lever[col.STIFFNESS]
    return steps
