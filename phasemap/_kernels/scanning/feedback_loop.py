"""The feedback loop: lock-in, controller and scanner, and the noise that enters there.

See theory, Eq. (slow-flow-6). Time is tau = omega_c t as everywhere in the kernels. With the complex amplitude a of z =
Re(a exp(i omega tau)):

* lock-in: a cascade of equal filters x_j' = r (x_(j-1) - x_j), x_0 = a; of the last one it shows R = abs(s) and phase =
  90 degrees + arg(s), s = f x + b what the detector sees of it: a linear lever, so that f and b are constant;
* controller: e = R - setpoint, I' = Ki e, command = -(Kp e + I + Kd e') within the scanner's range, where I waits;
* scanner: at the scanner_command, or Z'' + (w_s/Q_s) Z' + w_s^2 (Z - command) = 0.

White noise of the deflection, of one-sided density n^2 [m^2/Hz], has n^2/T of variance in each quadrature of an average
over a time T: a is followed by a white complex noise with that. The lever's own noise moves a itself (fluctuation and
dissipation): in equilibrium <z^2> = k_B T/k.
"""

from __future__ import annotations

import cmath
import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law
from phasemap._kernels.records import record

# Entries of the state of lever and loop, a vector whose rates are integrated.
A_REAL = 0  # complex amplitude a of the lever [m]
A_IMAG = 1
INTEGRAL = 2  # I of the controller [m]
SCANNER = 3  # height of the scanner Z [m]
SCANNER_SPEED = 4  # Z' [m per tau]
FILTERS = 5  # from here on the complex amplitudes of up to 4 filters of the lock-in [m]
LOOP_STATE = 13


@record
class Loop:
    """Lock-in, controller and scanner, and the noise that enters there. Times in tau."""

    setpoint: float  # amplitude [m]
    proportional: float  # gain Kp [1]
    integral: float  # gain Ki [per tau]
    derivative: float  # gain Kd [tau]
    rate: float  # r of the filters of the lock-in [per tau]
    order: int  # number of these filters
    spring: float  # w_s^2 of the scanner [per tau^2]; 0 where it follows at once
    loss: float  # w_s/Q_s of the scanner [per tau]
    lowest: float  # lower end of the scanner's range [m]
    highest: float  # its upper end [m]
    ramp: float  # speed at which the tip is lowered whatever the amplitude [m per tau]
    thermal_noise: float  # <z^2> of the free lever [m^2]
    detector_noise: float  # n^2 [m^2 per tau]
    settled: int  # whether the feedback settled when it engaged (1 or 0)
    factor_re: float  # f [1]; 1 where z itself is seen
    factor_im: float
    offset_re: float  # b [m]; 0 where z itself is seen
    offset_im: float
    patience: float  # time after which an approach is given up
    most_push: float  # first harmonic of the force beyond the drive's, over |a|, that the averaged lever may follow


@record
class Tally:
    """Integrals over the time that a pixel passes."""

    time: float  # [tau]
    scanner: float  # of Z [m tau]
    amplitude: float  # that the lock-in shows [m tau]
    phase: float  # that the lock-in shows [rad tau]
    stopped: int  # whether the scanner came to an end of its range (1 or 0)


class Setup(NamedTuple):
    """Setup that stays the same along a scan: formulas of the force, lever, feedback loop, and the source of noise."""

    law: Law
    lever: np.ndarray
    loop: Loop
    noise: np.random.Generator


class Stretch(NamedTuple):
    """Ground that passes under the tip: its height [m] at the start, its slope [m per tau], and how long [tau]."""

    ground: float
    slope: float
    span: float


class CubicPath(NamedTuple):
    """A complex amplitude [m] that moves along a cubic: at the start, and its derivatives over r, r^2 and r^3."""

    a: complex
    first: complex
    second: complex
    third: complex


@kernel(light=True)
def state_length(loop: Loop) -> int:
    """Number of entries of the state that move: those of unused filters do not."""
    return FILTERS + 2 * loop.order


@kernel
def seen_in_loop(loop: Loop, a: complex) -> complex:
    """Signal of the detector [m] for a complex amplitude of z."""
    return complex(loop.factor_re, loop.factor_im) * a + complex(loop.offset_re, loop.offset_im)


@kernel
def last_filter(loop: Loop, y: np.ndarray) -> complex:
    """Signal of the detector [m] behind the filters."""
    last = state_length(loop) - 2
    return seen_in_loop(loop, complex(y[last], y[last + 1]))


@kernel
def amplitude_shown(loop: Loop, y: np.ndarray) -> float:
    """Amplitude [m] that the lock-in shows."""
    s = last_filter(loop, y)
    return math.sqrt(s.real * s.real + s.imag * s.imag)


@kernel
def lock_in_output(loop: Loop, y: np.ndarray) -> tuple[float, float]:
    """Amplitude [m] and phase [rad] that the lock-in shows."""
    s = last_filter(loop, y)
    return amplitude_shown(loop, y), math.atan2(s.real, -s.imag)


@kernel
def lock_in_rates(loop: Loop, y: np.ndarray) -> tuple[float, float]:
    """Rates of the amplitude [m per tau] and the phase [rad per tau] that the lock-in shows."""
    last = state_length(loop) - 2
    before = last - 2 if last > FILTERS else A_REAL
    dx, du = loop.rate * (y[before] - y[last]), loop.rate * (y[before + 1] - y[last + 1])
    s, rate = last_filter(loop, y), complex(loop.factor_re, loop.factor_im) * complex(dx, du)
    square = s.real * s.real + s.imag * s.imag
    along = s.real * rate.real + s.imag * rate.imag
    return along / math.sqrt(square), (s.real * rate.imag - s.imag * rate.real) / square


@kernel
def scanner_command(loop: Loop, y: np.ndarray) -> tuple[float, float, bool]:
    """Height that the controller commands [m], rate of its integral term, and whether the scanner's range ends."""
    error = amplitude_shown(loop, y) - loop.setpoint
    wanted = -(loop.proportional * error + y[INTEGRAL])
    if loop.derivative != 0.0:
        wanted -= loop.derivative * lock_in_rates(loop, y)[0]
    rate = loop.integral * error + loop.ramp
    below, above = wanted < loop.lowest, wanted > loop.highest
    if (below and rate > 0.0) or (above and rate < 0.0):
        rate = 0.0
    return min(max(wanted, loop.lowest), loop.highest), rate, below or above


@kernel
def filter_cubic(loop: Loop, y: np.ndarray, path: CubicPath, time: float, out: np.ndarray) -> None:
    """Filters of the lock-in after a time during which a moves along a cubic: theory, Eq. (slow-flow-7).

    A filter responds to a polynomial with a polynomial. Its initial difference from that decays as a cascade of equal
    filters does, in closed form. `out` may be y.
    """
    s, order = loop.rate * time, loop.order
    a, a1, a2, a3 = path
    for j in range(order):  # the polynomial x of each: x + dx/ds is that of the one before
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
def move_scanner(loop: Loop, y: np.ndarray, to: float, time: float) -> None:
    """Move the scanner for a time during which its command stays at `to`: the solution of Z'' of the head, exactly."""
    if loop.spring == 0.0:
        y[SCANNER] = to
        return
    half = 0.5 * loop.loss
    x, v = y[SCANNER] - to, y[SCANNER_SPEED]
    w, decay = cmath.sqrt(complex(loop.spring - half * half, 0.0)), math.exp(-half * time)
    c, s = cmath.cos(w * time).real, (cmath.sin(w * time) / w).real if w != 0.0 else time
    y[SCANNER] = to + decay * (x * c + (v + half * x) * s)
    y[SCANNER_SPEED] = decay * (v * c - (half * v + loop.spring * x) * s)
