"""Nodes along an orbit that is solved, with all its harmonics, for integrals over it.

From its deepest point the tip is followed by the equation of motion for half a period, and back in time for another.
In contact and neck the variables are x = sqrt(d - end) and v, with dtau = 2 x ds, as in `time.march`: in these all is
smooth up to the end, and what is summed vanishes there, so that it need not be located exactly. Outside steps grow with
the distance to the pole of the long-range force, and faster than it. Each step gives the nodes of Simpson's rule.

What a result row does not tell is when the tip is deepest: at theta = 0 if it moves as a sine, and else where the first
harmonic of its motion says so.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator, contact_force, damping, longrange_force
from phasemap._kernels.lever import reach_of
from phasemap._kernels.orbits.around import MOST_TAP_STEPS, OrbitNodes

if TYPE_CHECKING:
    from phasemap._kernels.orbits.time.runge_kutta import Numbers

STEPS = 5  # of a way in contact up to a quarter of its oscillation, of order 4; more with damping
PRESSED_STEPS = 32  # of half a period pressed in
FIRST_FLIGHT_STEP = 0.5  # the first step outside, over that in which the distance to the pole grows e-fold
MOST_FLIGHT, MOST_DRIVEN = 0.8, 0.6  # any step there; where the drive is not faint, as in liquid
FLIGHT_GROWTH = 1.2  # from step to step there, for the force has its slope near the pole
NECK_STEP = 0.2  # a step in the neck, over that in which it is left behind
MOST_TAP_TURNS = 8
DRIVE_ALIKE = 2e-4  # of the amplitude: what drives may differ by between two turns
HARMONIC_ALIKE = 0.02  # of the first harmonic: what an orbit that was followed may differ by from the row
FAINT_DRIVE = 0.01  # of the amplitude: a drive so small does not care when the tap is
MOST_MOVE = 0.5  # [rad] that the tap moves from turn to turn


@kernel(inline=True)
def _circle(angle: float) -> Numbers:
    """Cosine and sine of an angle of at most half a turn, to 1e-10, by the series of half of it."""
    half = 0.5 * angle
    x = half * half
    c, s = 1.0 / 87178291200.0 - x * (1.0 / 20922789888000.0), 1.0 / 6227020800.0 - x * (1.0 / 1307674368000.0)
    c, s = 1.0 / 479001600.0 - x * c, 1.0 / 39916800.0 - x * s
    c, s = 1.0 / 3628800.0 - x * c, 1.0 / 362880.0 - x * s
    c, s = 1.0 / 40320.0 - x * c, 1.0 / 5040.0 - x * s
    c, s = 1.0 / 720.0 - x * c, 1.0 / 120.0 - x * s
    c, s = 1.0 / 24.0 - x * c, 1.0 / 6.0 - x * s
    c, s = 1.0 - x * (0.5 - x * c), half * (1.0 - x * s)
    return c * c - s * s, 2.0 * c * s


@kernel(inline=True)
def _depth(end: float, x: float) -> float:
    """Depth [m]: in contact; in flight, `end` being above 0; pressed in, `end` being infinite."""
    return x if end == math.inf else min(x, 0.0) if end > 0.0 else end + max(x, 0.0) ** 2


@kernel(inline=True)
def _time_per_variable(z0: float, end: float, y: Numbers) -> float:
    """Derivative of the time tau by the integration variable s."""
    if end == math.inf:
        return 1.0
    if end <= 0.0:
        return 2.0 * y[0]
    gap = end - min(y[0], 0.0)
    return gap / math.sqrt(y[1] * y[1] + 2.0 * max(z0, gap) * gap)


@kernel
def _rates(oscillator: Oscillator, held: Numbers, end: float, y: Numbers) -> Numbers:
    """Changes of x, v, tau with s, `held` at a tip offset z0 and under a drive of so much cosine and less of sine.

    In flight `end` is the distance from the edge of the contact to the pole.
    """
    law, p, lever = oscillator
    (x, v, time), (z0, even, odd) = y, held
    d, free = _depth(end, x), 0.0 < end < math.inf
    f = longrange_force(law, d, p) if free else contact_force(law, d, p)
    f /= lever[col.STIFFNESS]
    if d > 0.0:
        f += 2.0 * damping(law, d, p) * v
    c, s = _circle(lever[col.OMEGA] * time)
    a = even * c - odd * s - (z0 + d) - f - 2.0 * lever[col.ALPHA0] * v
    turn = _time_per_variable(z0, end, y)
    return turn * v if free else v, turn * a, turn


@kernel(inline=True)
def _moved(y: Numbers, h: float, r: Numbers) -> Numbers:
    return y[0] + h * r[0], y[1] + h * r[1], y[2] + h * r[2]


@kernel
def _put(lever: np.ndarray, end: float, y: Numbers, weight: float, at: OrbitNodes, j: int) -> None:
    """A node: the angle stands for its cosine."""
    at.cos[j], at.depth[j] = lever[col.OMEGA] * y[2], _depth(end, y[0])
    at.rate[j], at.weight[j] = y[1] / lever[col.OMEGA], abs(weight)
    at.touches[j] = 0.0 if 0.0 < end < math.inf else 1.0


@kernel
def _march_tip(
    oscillator: Oscillator, held: Numbers, end: float, y: Numbers, h: float, at: OrbitNodes, first: int
) -> tuple[Numbers, int]:
    """March the tip in steps `h` of s to the end of contact or half a period; returns the state, and nodes filled.

    Returns where it is then, and up to where nodes are filled; 0 where it does not leave the contact, or does and comes
    back within the period.
    """
    p, lever = oscillator.p, oscillator.lever
    timed, j, half = end > 0.0, first, math.copysign(math.pi / lever[col.OMEGA], h)
    free, longest = 0.0 < end < math.inf, MOST_FLIGHT if lever[col.DRIVE] < FAINT_DRIVE * held[0] else MOST_DRIVEN
    least, most = p[col.RELEASE] if end == math.inf else -math.inf, 0.0 if free else math.inf
    share, r = lever[col.OMEGA] / 6.0, _rates(oscillator, held, end, y)
    _put(lever, end, y, 0.0, at, j)
    for _ in range(MOST_TAP_STEPS):
        last = abs(half - y[2]) <= abs(h) * r[2] if timed else y[0] <= -h * r[0]
        size = h if not last else (half - y[2]) / r[2] if timed else -y[0] / r[0]
        second = _rates(oscillator, held, end, _moved(y, 0.5 * size, r))
        third = _rates(oscillator, held, end, _moved(y, 0.5 * size, second))
        fourth = _rates(oscillator, held, end, _moved(y, size, third))
        new = _moved(_moved(y, size / 6.0, r), size / 3.0, second)
        new = _moved(_moved(new, size / 3.0, third), size / 6.0, fourth)
        after = _rates(oscillator, held, end, new)
        between = (
            0.5 * (y[0] + new[0]) + 0.125 * size * (r[0] - after[0]),
            0.5 * (y[1] + new[1]) + 0.125 * size * (r[1] - after[1]),
            0.5 * (y[2] + new[2]) + 0.125 * size * (r[2] - after[2]),
        )
        at.weight[j] += abs(share * size * r[2])
        _put(lever, end, between, 4.0 * share * size * _time_per_variable(held[0], end, between), at, j + 1)
        _put(lever, end, new, share * size * after[2], at, j + 2)
        y, r, j = new, after, j + 2
        if free:
            h = math.copysign(min(FLIGHT_GROWTH * abs(h), longest), h)
        if last:
            return y, j + 1
        if not (least < y[0] < most and (timed or y[1] * h < 0.0)):
            break
    return y, 0


@kernel
def _put_half_period(
    oscillator: Oscillator, row: np.ndarray, lag: float, side: float, whole: bool, at: OrbitNodes, first: int
) -> int:
    """Fill the nodes of the half period before (side -1) or after (1) the deepest point; returns their end."""
    law, p, lever = oscillator
    base, deepest, release = lever[col.DRIVE], row[col.INDENTATION], p[col.RELEASE]
    held = (row[col.TIP_OFFSET], base * math.cos(lag), base * math.sin(lag))
    y, count, edge = (deepest, 0.0, 0.0), first, 0.0
    if deepest > 0.0:
        y = (math.sqrt(deepest), 0.0, 0.0)
        slows = 4.0 * y[0] * damping(law, deepest, p)
        falls = -_rates(oscillator, held, 0.0, y)[1] / (2.0 * y[0])
        h = side / (STEPS * (4.0 / math.pi) * math.sqrt(0.5 * max(falls, 0.0)) + slows)
        y, count = _march_tip(oscillator, held, 0.0, y, h, at, first)
        if side > 0.0 and release < 0.0 and count > 0:
            y, edge = (math.sqrt(-release), y[1], y[2]), release
            y, count = _march_tip(oscillator, held, release, y, NECK_STEP * y[0] / abs(y[1]), at, count)
        y = (edge, y[1], y[2])
    if count == 0 and deepest > 0.0:
        h = side * math.pi / (PRESSED_STEPS * lever[col.OMEGA])
        return _march_tip(oscillator, held, math.inf, (deepest, 0.0, 0.0), h, at, first)[1]
    if not whole:
        return count
    reach = reach_of(law, p)
    length = reach if reach > 0.0 else row[col.AMPLITUDE]
    return _march_tip(oscillator, held, length, y, side * FIRST_FLIGHT_STEP, at, count)[1]


@kernel
def _followed(
    oscillator: Oscillator, row: np.ndarray, late: float, whole: bool, at: OrbitNodes
) -> tuple[int, float, float]:
    """Nodes of a period, or of its contact if not `whole`, with angles from where the tip is deepest.

    Returns how many, 0 for none, how late that is against the first harmonic, and that over the row's.
    """
    lag = 0.5 * math.pi - row[col.PHASE] + late
    half = _put_half_period(oscillator, row, lag, -1.0, whole, at, 0)
    count = _put_half_period(oscillator, row, lag, 1.0, whole, at, half) if half > 0 else 0
    amplitude = row[col.AMPLITUDE]
    if not whole:
        return count, 0.0, 0.0
    even, odd = 0.0, 0.0
    for j in range(count):
        x = at.weight[j] * (at.depth[j] + amplitude)
        at.cos[j], at.sin[j] = _circle(at.cos[j])
        even += x * at.cos[j]
        odd -= x * at.sin[j]
    return count, math.atan2(odd, even), math.hypot(odd, even) / (math.pi * amplitude)


@kernel
def tap(oscillator: Oscillator, row: np.ndarray, whole: bool, at: OrbitNodes) -> int:
    """Fill the nodes of a result row of the tip; 0 where it cannot be followed.

    If not `whole`, those in contact will do, and where the drive is small their angles against the drive are not told.
    """
    lever = oscillator.lever
    if not whole and row[col.INDENTATION] > 0.0 and lever[col.DRIVE] < FAINT_DRIVE * row[col.AMPLITUDE]:
        count, _, _ = _followed(oscillator, row, 0.0, False, at)
        if count > 0:
            return count
    for start in (0.0, 0.5, -0.5, 1.0, -1.0):
        late, last, last_off = start, 0.0, 0.0
        for turn in range(MOST_TAP_TURNS):
            count, found, size = _followed(oscillator, row, late, True, at)
            if count == 0:
                break
            # Where motion in a liquid is far from a sine, the secant converges and repetition does not.
            off = found - late
            move = -off * (late - last) / (off - last_off) if turn > 0 and off != last_off else off
            if lever[col.DRIVE] * abs(off) < DRIVE_ALIKE * row[col.AMPLITUDE]:
                if abs(size - 1.0) > HARMONIC_ALIKE:
                    break
                c, s = math.cos(late + move), math.sin(late + move)
                for j in range(count):
                    at.cos[j], at.sin[j] = c * at.cos[j] - s * at.sin[j], s * at.cos[j] + c * at.sin[j]
                return count
            last, last_off = late, off
            late += min(max(move, -MOST_MOVE), MOST_MOVE)
    return 0
