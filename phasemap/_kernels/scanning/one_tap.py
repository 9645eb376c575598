"""A period of the drive in which the tip taps once: the flight to the surface, contact, and the flight from it.

Each is a piece, or two where the tip comes back before the period ends. What is not known of a piece, the force at its
nodes and when it ends, is found by passes that begin with what the last period left, for periods are alike. Where they
do not settle at once, or the nodes are too few, the period is marched: theory, "A period with one tap".
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, Oscillator, contact_slope
from phasemap._kernels.lever import reach_of
from phasemap._kernels.orbits.time.march import march_period
from phasemap._kernels.orbits.time.tip import COS, SIN, V, Z
from phasemap._kernels.scanning.pieces import (
    NODES,
    ROWS,
    TIME,
    W_SPEED,
    Instant,
    Lever,
    W,
    answer,
    attract,
    free,
    graded,
    harmonic_of,
    lay,
    left_out,
    lever_on,
    repel,
    round_off,
    soon,
)

PASSES, SLOWEST = 8, 0.5  # of a piece, and how much of a change in the last one may be left in the next
CLOSE = 0.03  # [tau]: so near to contact the lever follows its Taylor series
MOST_OF = 0.7  # of the slope of the force at the deepest point, which the spring has that stands for it
STILL = 3e-6  # of reach or indentation: a change of the way of the tip that needs no further pass
# The most that the last two Legendre coefficients of a force may have [u0]: settled, that leaves 4e-6 rad at most.
ROUGH_FLIGHT, ROUGH_TAP = 1e-2, 0.15
SHORTEST, LONGEST = 0.05, 2.5  # of a flight, and of a contact [tau]: neither is cut where a period begins
OFF = 0.25  # from resonance, where the lever meets the surface twice
DAMPED = 0.1  # alpha0, from which on a lever hardly rings, and what the march leaves is forgotten as soon
WAIT = 50.0  # periods that are marched after one that pieces did not follow, even without another before it

BEFORE, AFTER = -1.0, 1.0  # contact
IN, TAP, OUT, BACK = 0, ROWS, 2 * ROWS, 3 * ROWS  # where the pieces begin
# After them, of the last contact: how long it lasted [tau], and kappa; then how many periods are to be marched.
LASTED, KAPPA, LATER, ROOM = 4 * ROWS, 4 * ROWS + 1, 4 * ROWS + 2, 4 * ROWS + 3


class Below(NamedTuple):
    """What the tip meets: a material's parameters, 1/k [m/N], the reach of its attraction [m], and z0 [m]."""

    p: tuple[float, ...]
    compliance: float
    reach: float
    z0: float


class Piece(NamedTuple):
    """Whether a piece was found; how long it takes [tau]; the lever at its end; the integral of f exp(-i psi) [m]."""

    good: bool
    time: float
    end: Instant
    push: complex


@kernel
def pass_period(oscillator: Oscillator, z0: float, eta: float, y: np.ndarray, acc: np.ndarray, room: np.ndarray) -> int:
    """Let a period pass, as one tap or as `march_period` does; returns steps: 1, or what that returns.

    Of `acc`, COS and SIN are filled.
    """
    law, p, lever = oscillator
    apt = abs(lever[col.OMEGA] - 1.0) < OFF and lever[col.ALPHA0] < DAMPED
    if apt and law.memory == 0 and p[col.RELEASE] == 0.0:
        if room[LATER] > 0.0:
            room[LATER] -= 1.0
        elif tap_once(oscillator, z0, y, acc, room):
            return 1
    return int(march_period(oscillator, z0, eta, y, acc))


@kernel(shared=True)
def tap_once(oscillator: Oscillator, z0: float, y: np.ndarray, acc: np.ndarray, room: np.ndarray) -> bool:
    """Let a period with one tap pass; returns whether it was one that the pieces can follow.

    Parameters
    ----------
    y : ndarray
        State as `tip` names it, at drive phase 0. Advanced if the period was followed.
    acc : ndarray
        COS and SIN are filled if it was.
    room : ndarray, shape (ROOM,)
        What one period leaves for the next; zeros at first.
    """
    law, p, lever = oscillator
    alone = lever_on(lever[col.OMEGA], lever[col.ALPHA0], lever[col.BASE], 0.0, z0)
    period = 2.0 * math.pi / alone.omega
    start = Instant(y[Z], y[V], complex(1.0, 0.0))
    below = Below(p, 1.0 / lever[col.STIFFNESS], reach_of(law, p), z0)
    time, at = _landing(alone, start, z0)
    if not SHORTEST < time < period - SHORTEST:
        return False
    down = _land(law, below, alone, at, time, room[IN:TAP])
    if down.good:
        tap = _touch(law, below, alone, down.end, room)
        if tap.good and down.time + tap.time < period - SHORTEST:
            up = _leave(law, below, alone, tap.end, period - tap.time, down.time, room)
            if up.good:
                _first_harmonic(alone, start, up.end, down.push + tap.push + up.push, acc)
                y[Z], y[V] = up.end.z, up.end.v
                return True
    knew = room[LASTED] > 0.0
    for j in range(ROOM):
        room[j] = 0.0
    room[LATER] = 0.0 if knew else WAIT
    return False


@kernel
def _landing(lever: Lever, start: Instant, z0: float) -> tuple[float, Instant]:
    """When the free lever comes up to z0, and as what; NaN if it does not."""
    size = math.hypot(start.z, start.v / lever.omega)
    if not (start.z < z0 and z0 < size):
        return math.nan, start
    time = (math.atan2(start.v / lever.omega, start.z) - math.acos(z0 / size)) / lever.omega
    if time < 0.0:
        time += 2.0 * math.pi / lever.omega
    at = free(lever, start, time)
    for _ in range(8):
        if not at.v > 0.0:
            break
        more = (z0 - at.z) / at.v
        time += more
        if abs(more) < CLOSE:
            at = soon(lever, at, more)
            more = (z0 - at.z) / at.v
            return time + more, soon(lever, at, more)
        at = free(lever, start, time)
    return math.nan, start


@kernel
def _spread(below: Below, at: Instant, start: float, end: float, side: float, m: np.ndarray) -> None:
    """Nodes of a flight between two times from a contact where the lever is `at`: theory, Eq. (time-9).

    The first steps are as long as the free lever takes to move by the reach of the force.
    """
    near = 2.0 * below.reach / (abs(at.v) + math.sqrt(at.v * at.v + 2.0 * max(below.z0, 0.0) * below.reach))
    graded(near, start, end, side, m)


@kernel
def _land(law: Law, below: Below, lever: Lever, at: Instant, time: float, m: np.ndarray) -> Piece:
    """Flight to contact, to which the free lever takes this time and where it is `at`: attraction makes it sooner."""
    last = math.inf
    if below.p[col.LONGRANGE] == 0.0:
        return Piece(True, time, at, complex(0.0, 0.0))
    more = (m[W_SPEED] * m[TIME] - m[W]) / at.v  # as it was at the last contact, which the first node saw
    for _ in range(PASSES):
        if not (abs(more) < CLOSE and time + more > 0.0):
            break
        time += more
        at = soon(lever, at, more)
        _spread(below, at, 0.0, time, BEFORE, m)
        lay(lever, at, below.z0, m)
        deepest = attract(law, below.p, below.compliance, m)
        kick, change = answer(lever, BEFORE, m)
        more = (below.z0 - at.z - kick.z) / (at.v + kick.v)
        change = max(change, abs(at.v * more))
        if change < STILL * below.reach:
            end = soon(lever, Instant(at.z + kick.z, at.v + kick.v, at.drive), more)
            good = deepest < STILL * below.reach and left_out(m) < ROUGH_FLIGHT * lever.base
            return Piece(good, time + more, end, harmonic_of(0.0, m) * at.drive.conjugate())
        if not change < SLOWEST * last:
            break
        last = change
    return Piece(False, time, at, complex(0.0, 0.0))


@kernel
def _leave(law: Law, below: Below, lever: Lever, at: Instant, span: float, rest: float, room: np.ndarray) -> Piece:
    """Flight from contact until `rest` before the next one, which would end it after `span`.

    From where the tip is farthest, the attraction is that of the next contact.
    """
    half = 0.5 * span
    if not rest < half:
        return _fly(law, below, lever, at, 0.0, span - rest, AFTER, room[OUT:BACK])
    out = _fly(law, below, lever, at, 0.0, half, AFTER, room[OUT:BACK])
    if not out.good:
        return out
    back = _fly(law, below, lever, free(lever, out.end, half), rest, half, BEFORE, room[BACK:LASTED])
    return Piece(back.good, span - rest, back.end, out.push + back.push)


@kernel
def _fly(
    law: Law, below: Below, lever: Lever, at: Instant, near: float, far: float, side: float, m: np.ndarray
) -> Piece:
    """Flight between two times from a contact where the free lever is `at`: after it, or before it to the near one."""
    last, to = math.inf, far if side == AFTER else -near
    if below.p[col.LONGRANGE] == 0.0:
        end = free(lever, at, to)
        return Piece(end.z < below.z0, far - near, end, complex(0.0, 0.0))
    _spread(below, at, near, far, side, m)
    lay(lever, at, below.z0, m)
    for _ in range(PASSES):
        deepest = attract(law, below.p, below.compliance, m)
        kick, change = answer(lever, side, m)
        if change < STILL * below.reach:
            end = free(lever, Instant(at.z + kick.z, at.v + kick.v, at.drive), to)
            good = deepest < 0.0 and end.z < below.z0 and left_out(m) < ROUGH_FLIGHT * lever.base
            return Piece(good, far - near, end, harmonic_of(0.0, m) * at.drive.conjugate())
        if not change < SLOWEST * last:
            break
        last = change
    return Piece(False, far - near, at, complex(0.0, 0.0))


@kernel
def _touch(law: Law, below: Below, alone: Lever, at: Instant, room: np.ndarray) -> Piece:
    """Contact that begins `at`.

    The lever stands on a spring as stiff as most of the contact: what is left of the force changes little with depth.
    """
    p, compliance, _, z0 = below
    m, h, kappa, last = room[TAP:OUT], room[LASTED], room[KAPPA], math.inf
    if not h > 0.0:
        # As the lever would go on, and twice with what that depth makes of it.
        h, kappa = 2.0 * math.atan2(at.v, max(z0, 0.0)), 0.0
        for _ in range(3):
            kappa = MOST_OF * contact_slope(law, at.v * h / math.pi, p) * compliance
            h = 2.0 * math.atan2(at.v * math.sqrt(1.0 + kappa), max(z0, 0.0)) / math.sqrt(1.0 + kappa)
        for j in range(NODES):
            m[W + j] = m[W_SPEED + j] = 0.0
    lever = lever_on(alone.omega, alone.alpha0, alone.base, kappa, z0)
    for i in range(PASSES):
        if not 0.0 < h < LONGEST:
            break
        round_off(h, m)
        lay(lever, at, z0, m)
        deepest = repel(law, p, compliance, kappa, m)
        kick, change = answer(lever, AFTER, m)
        end = free(lever, Instant(at.z + kick.z, at.v + kick.v, at.drive), h)
        more = (z0 - end.z) / end.v
        if not (end.v < 0.0 and abs(more) < 0.5 * h):
            break
        h += more
        change = max(change, abs(end.v * more))
        if change < STILL * deepest:
            end = soon(lever, end, more)
            room[LASTED], room[KAPPA] = h, MOST_OF * contact_slope(law, deepest, p) * compliance
            push = harmonic_of(kappa, m) * at.drive.conjugate()
            return Piece(left_out(m) < ROUGH_TAP * lever.base, h, Instant(z0, end.v, end.drive), push)
        if i > 1 and not change < SLOWEST * last:
            break
        last = change
    return Piece(False, h, at, complex(0.0, 0.0))


@kernel
def _first_harmonic(lever: Lever, start: Instant, end: Instant, push: complex, acc: np.ndarray) -> None:
    """Fill in the first harmonic of a period that begins at drive phase 0: theory, Eq. (time-10)."""
    omega, alpha0 = lever.omega, lever.alpha0
    dz, dv = end.z - start.z, end.v - start.v
    left = complex(dv + 2.0 * alpha0 * dz, omega * dz)
    x = (lever.base * math.pi / omega - push - left) / complex(1.0 - omega * omega, 2.0 * alpha0 * omega)
    acc[COS], acc[SIN] = x.real * omega / math.pi, -x.imag * omega / math.pi
