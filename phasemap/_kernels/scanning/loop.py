"""The feedback loop: lock-in, controller and scanner, and the noise that enters there.

See theory, Eq. (slow-flow-5). Time is tau = omega_c t as everywhere in the kernels. With the complex amplitude a of z =
Re(a exp(i omega tau)):

* lock-in: a cascade of `ORDER` filters x_j' = r (x_(j-1) - x_j), x_0 = a; of the last one it shows R = abs(x - b) and
  phase = 90 degrees + arg(x - b) + `TURN`: what the base moves, b, is constant, and passes the filters as it is;
* controller: e = R - setpoint, I' = Ki e, command = -(Kp e + I + Kd e') within the scanner's range, where I waits;
* scanner: at the command, or Z'' + (w_s/Q_s) Z' + w_s^2 (Z - command) = 0.

White noise of the deflection, of one-sided density n^2 [m^2/Hz], has n^2/T of variance in each quadrature of an average
over a time T: a is followed by a white complex noise with that. The lever's own noise moves a itself (fluctuation and
dissipation): in equilibrium <z^2> = k_B T/k.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels.compilation import kernel

# Entries of the loop. Lengths in m, times in tau.
SETPOINT, KP, KI, KD = 0, 1, 2, 3
RATE, ORDER = 4, 5  # r of the filters, and how many
SPRING, LOSS = 6, 7  # w_s^2 and w_s/Q_s of the scanner; 0 where it follows at once
LOW, HIGH = 8, 9  # of the scanner
RAMP = 10  # speed at which the tip is lowered whatever the amplitude
THERMAL = 11  # <z^2> of the free lever [m^2]
DETECTOR = 12  # n^2 [m^2 per tau]
CALM = 13  # whether the feedback settled when it engaged (1 or 0)
SHAKER, TURN = 14, 15  # b [m], and what brings the phase to 0 at free resonance [rad]; 0 where z itself is seen
PATIENCE = 16  # after which an approach is given up
HARDEST = 17  # of |a|, first harmonic of the force beyond the drive's that the averaged lever is to follow
LOOP = 18

# Entries of the state: a; I, Z, Z'; the filters.
AMP, INTEGRAL, PLACE, SPEED, FILTERS, STATE = 0, 2, 3, 4, 5, 13

# What is collected while a pixel passes: integrals over time of 1, Z, R and phase; whether the scanner was at its end.
TIME, SUM_PLACE, SUM_AMPLITUDE, SUM_PHASE, STOPPED, TALLY = 0, 1, 2, 3, 4, 5


class Stretch(NamedTuple):
    """What passes under the tip: height [m] of the ground where it begins, its rise [m per tau], and how long [tau]."""

    ground: float
    slope: float
    span: float


class Path(NamedTuple):
    """A complex amplitude [m] that moves along a cubic, and its derivatives over r, r^2 and r^3, as a time begins."""

    a: complex
    first: complex
    second: complex
    third: complex


@kernel(light=True)
def used(loop: np.ndarray) -> int:
    """How many entries of the state move."""
    return FILTERS + 2 * int(loop[ORDER])


@kernel
def amplitude_shown(loop: np.ndarray, y: np.ndarray) -> float:
    """Amplitude [m] at the lock-in's output."""
    last = used(loop) - 2
    x, u = y[last] - loop[SHAKER], y[last + 1]
    return math.sqrt(x * x + u * u)


@kernel
def shown(loop: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Amplitude [m] and phase [rad] at the lock-in's output."""
    last = used(loop) - 2
    return amplitude_shown(loop, y), math.atan2(y[last] - loop[SHAKER], -y[last + 1]) + loop[TURN]


@kernel
def drift_of(loop: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Rates of what `shown` gives."""
    last = used(loop) - 2
    before = last - 2 if last > FILTERS else AMP
    x, u = y[last], y[last + 1]
    dx, du = loop[RATE] * (y[before] - x), loop[RATE] * (y[before + 1] - u)
    x -= loop[SHAKER]
    square = x * x + u * u
    return (x * dx + u * du) / math.sqrt(square), (x * du - u * dx) / square


@kernel
def command(loop: np.ndarray, y: np.ndarray) -> tuple[float, float, bool]:
    """Where the scanner is sent [m], the rate of I, and whether the scanner is at an end of its range."""
    error = amplitude_shown(loop, y) - loop[SETPOINT]
    wanted = -(loop[KP] * error + y[INTEGRAL])
    if loop[KD] != 0.0:
        wanted -= loop[KD] * drift_of(loop, y)[0]
    rate = loop[KI] * error + loop[RAMP]
    below, above = wanted < loop[LOW], wanted > loop[HIGH]
    if (below and rate > 0.0) or (above and rate < 0.0):
        rate = 0.0
    return min(max(wanted, loop[LOW]), loop[HIGH]), rate, below or above


@kernel
def filter_for(loop: np.ndarray, y: np.ndarray, time: float) -> None:
    """Let the lock-in's filters run for a time during which a stays: a cascade of equal filters has a closed form."""
    s = loop[RATE] * time
    decay = math.exp(-s)
    for part in range(2):
        a = y[AMP + part]
        for j in range(int(loop[ORDER]) - 1, -1, -1):
            away, weight = 0.0, 1.0
            for i in range(j, -1, -1):
                away += weight * (y[FILTERS + 2 * i + part] - a)
                weight *= s / (j - i + 1)
            y[FILTERS + 2 * j + part] = a + decay * away


@kernel
def filter_along(loop: np.ndarray, y: np.ndarray, path: Path, time: float, out: np.ndarray) -> None:
    """Fill in the filters after a time during which a moves along a cubic: theory, Eq. (slow-flow-6).

    One filter answers a polynomial with a polynomial. What it differs from that as the time begins decays as in
    `filter_for`.
    """
    s, order = loop[RATE] * time, int(loop[ORDER])
    a, a1, a2, a3 = path
    for j in range(order):
        a2 -= a3
        a1 -= a2
        a -= a1
        at = FILTERS + 2 * j
        out[at], out[at + 1] = y[at] - a.real, y[at + 1] - a.imag
    decay = math.exp(-s)
    for j in range(FILTERS + 2 * order - 1, FILTERS - 1, -1):
        away, weight, n = 0.0, decay, 1.0
        for i in range(j, FILTERS - 1, -2):
            away += weight * out[i]
            weight *= s / n
            n += 1.0
        out[j] = away
    a, a1, a2, a3 = path
    a += s * (a1 + 0.5 * s * (a2 + s / 3.0 * a3))
    a1 += s * (a2 + 0.5 * s * a3)
    a2 += s * a3
    for j in range(order):
        a2 -= a3
        a1 -= a2
        a -= a1
        at = FILTERS + 2 * j
        out[at] += a.real
        out[at + 1] += a.imag


@kernel
def move_scanner(loop: np.ndarray, y: np.ndarray, to: float, time: float) -> None:
    """Let the scanner run for a time towards a command that stays."""
    if loop[SPRING] == 0.0:
        y[PLACE] = to
        return
    half = 0.5 * loop[LOSS]
    x, v = y[PLACE] - to, y[SPEED]
    square = loop[SPRING] - half * half
    decay = math.exp(-half * time)
    if square > 0.0:
        w = math.sqrt(square)
        c, s = math.cos(w * time), math.sin(w * time) / w
    else:
        w = math.sqrt(-square)
        c, s = math.cosh(w * time), math.sinh(w * time) / w if w > 0.0 else time
    y[PLACE] = to + decay * (x * c + (v + half * x) * s)
    y[SPEED] = decay * (v * c - (half * v + loop[SPRING] * x) * s)
