"""Free flight of a lever with several modes where no force reaches beyond contact: exact, up to the next contact.

Each mode moves as Re(P_i exp(i omega t)) + Re(A_i exp(lambda_i t)), t from the start of the flight. Where the tip comes
to the surface is sought on samples closer than the fastest mode can turn, and then by Newton's method; integrals over
the flight are sums of exponentials: theory, Eq. (time-6).
"""

from __future__ import annotations

import cmath
import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.numerics import newton_in_bracket
from phasemap._kernels.orbits.time.contact import Beam, Motion
from phasemap._kernels.records import column, record

SAMPLE_STEP = 0.4  # radian of the fastest mode, between two samples of a flight
MOST_FLIGHT_NEWTON = 60  # steps to a contact or a turn, bisections among them
FLIGHT_TIME_ERROR = 1e-15  # [tau], of a contact
SMALL_GROWTH = 0.5  # an exponent up to which (exp(x) - 1) / x is summed as a series
SERIES_TERMS = 14  # of it: the next is below 1e-16 there


@record
class FreeFlight:
    """Motion in free flight: of the modes in turn, and last the part of the tip's that the drive makes."""

    omega: float
    z0: float  # tip offset above where the flight ends [m]
    count: int  # of modes
    forced_re: np.ndarray = column(col.MOST_MODES)  # P_i [m]
    forced_im: np.ndarray = column(col.MOST_MODES)
    own_re: np.ndarray = column(col.MOST_MODES + 1)  # A_i [m]; the sum of all P_i
    own_im: np.ndarray = column(col.MOST_MODES + 1)
    decay: np.ndarray = column(col.MOST_MODES + 1)  # alpha_i [1]; 0
    turning: np.ndarray = column(col.MOST_MODES + 1)  # imaginary part of lambda_i [1]; omega


@kernel
def begin_flight(beam: Beam, edge: float, motion: Motion, flight: FreeFlight) -> None:
    """Split the motion of each mode at the start of a flight into driven and own motion."""
    omega, modes, n, start = beam.omega, beam.modes, beam.modes.count, motion.here.at
    phase, higher = complex(motion.cos, motion.sin), motion.here.at.modes
    flight.omega, flight.z0, flight.count = omega, beam.z0 + edge, n
    flight.own_re[n] = flight.own_im[n] = flight.decay[n] = 0.0
    flight.turning[n] = omega
    first, first_speed = beam.z0 + start.x, start.v
    for i in range(1, n):
        first -= higher[2 * i - 2]
        first_speed -= higher[2 * i - 1]
    for i in range(n):
        y, u = (higher[2 * i - 2], higher[2 * i - 1]) if i > 0 else (first, first_speed)
        square, decay = modes.square[i], 0.5 * modes.damping[i]
        forced = complex(modes.drive_re[i], modes.drive_im[i]) * phase
        forced /= complex(square - omega * omega, 2.0 * decay * omega)
        flight.own_re[n] += forced.real
        flight.own_im[n] += forced.imag
        flight.decay[i], flight.turning[i] = decay, math.sqrt(square - decay * decay)
        flight.forced_re[i], flight.forced_im[i] = forced.real, forced.imag
        flight.own_re[i] = y - forced.real
        flight.own_im[i] = -(u + omega * forced.imag + decay * flight.own_re[i]) / flight.turning[i]


@kernel
def tip_in_flight(flight: FreeFlight, t: float) -> tuple[float, float, float]:
    """Depth [m] of the tip, its velocity and acceleration."""
    d, v, a = -flight.z0, 0.0, 0.0
    for i in range(flight.count + 1):
        pole = complex(-flight.decay[i], flight.turning[i])
        term = complex(flight.own_re[i], flight.own_im[i]) * cmath.exp(pole * t)
        d += term.real
        term *= pole
        v += term.real
        a += (term * pole).real
    return d, v, a


@record
class Samples:
    """Terms of the motion at a sample of a flight, and what takes them to the next."""

    term_re: np.ndarray = column(col.MOST_MODES + 1)  # [m]
    term_im: np.ndarray = column(col.MOST_MODES + 1)
    factor_re: np.ndarray = column(col.MOST_MODES + 1)
    factor_im: np.ndarray = column(col.MOST_MODES + 1)


@kernel
def _begin_samples(flight: FreeFlight, step: float, samples: Samples) -> None:
    """Begin to sample a free flight at instants a step [tau] apart: its modes, and the factors from one to the next."""
    for i in range(flight.count + 1):
        factor = cmath.exp(complex(-flight.decay[i], flight.turning[i]) * step)
        samples.term_re[i], samples.term_im[i] = flight.own_re[i], flight.own_im[i]
        samples.factor_re[i], samples.factor_im[i] = factor.real, factor.imag


@kernel
def _next_sample(flight: FreeFlight, samples: Samples) -> tuple[float, float]:
    """Depth [m] and velocity of the tip a step later."""
    d, v = -flight.z0, 0.0
    for i in range(flight.count + 1):
        x, y = samples.term_re[i], samples.term_im[i]
        c, s = samples.factor_re[i], samples.factor_im[i]
        samples.term_re[i], samples.term_im[i] = x * c - y * s, x * s + y * c
        d += samples.term_re[i]
        v -= flight.decay[i] * samples.term_re[i] + flight.turning[i] * samples.term_im[i]
    return d, v


@kernel
def _zero(flight: FreeFlight, low: float, high: float, of_speed: bool) -> float:
    """Time between two at which the depth, negative at `low`, or the speed, positive there, is zero; by Newton."""
    t = 0.5 * (low + high)
    for _ in range(MOST_FLIGHT_NEWTON):
        d, v, a = tip_in_flight(flight, t)
        value, slope = (-v, -a) if of_speed else (d, v)
        if abs(value) <= FLIGHT_TIME_ERROR * abs(slope):
            break
        t, low, high = newton_in_bracket(t, value, slope, low, high, True)
    return t


@kernel
def _grown(mu: complex, t: float) -> complex:
    """Integral of exp(mu s) for s = 0 ... t."""
    x = mu * t
    if abs(x) > SMALL_GROWTH:
        return (cmath.exp(x) - 1.0) / mu
    total = complex(1.0, 0.0)
    for n in range(SERIES_TERMS, 1, -1):
        total = 1.0 + total * x / n
    return total * t


@kernel
def _end_flight(beam: Beam, motion: Motion, flight: FreeFlight, t: float, x: float) -> None:
    """Fill in the end of a flight after a time t, at depth x [m], and the integrals over it."""
    modes, end = beam.modes, motion.end.at
    sine_pole = complex(0.0, flight.omega)
    speed = air = mean = 0.0
    turned = cmath.exp(sine_pole * t)
    driven = complex(flight.own_re[flight.count], flight.own_im[flight.count])
    double = _grown(2.0 * sine_pole, t)
    mean = (driven * _grown(sine_pole, t)).real
    harmonic = 0.5 * driven * double + 0.5 * driven.conjugate() * t
    for i in range(flight.count):
        pole = complex(-flight.decay[i], flight.turning[i])
        own, forced = complex(flight.own_re[i], flight.own_im[i]), complex(flight.forced_re[i], flight.forced_im[i])
        with_drive, against = _grown(pole + sine_pole, t), _grown(pole - sine_pole, t)
        mean += (own * _grown(pole, t)).real
        harmonic += 0.5 * own * with_drive + 0.5 * (own * against).conjugate()
        of_own, of_forced = pole * own, sine_pole * forced  # of the speed
        square = 0.5 * abs(of_forced) ** 2 * t + 0.5 * (of_forced * of_forced * double).real
        square += 0.5 * abs(of_own) ** 2 * _grown(complex(2.0 * pole.real, 0.0), t).real
        square += 0.5 * (of_own * of_own * _grown(2.0 * pole, t)).real
        square += (of_own * of_forced * with_drive).real + (of_own * of_forced.conjugate() * against).real
        air += modes.loss[i] * square
        decayed = cmath.exp(pole * t)
        y, u = (own * decayed + forced * turned).real, (of_own * decayed + of_forced * turned).real
        speed += u
        if i > 0:
            end.modes[2 * i - 2], end.modes[2 * i - 1] = y, u
    harmonic *= complex(motion.cos, motion.sin)
    end.x, end.v, end.passed, end.mean_z, end.air = x, speed, t, mean, air
    end.cos, end.sin, end.loss, end.virial, motion.end.known = harmonic.real, harmonic.imag, 0.0, 0.0, 0


@kernel
def fly(beam: Beam, edge: float, motion: Motion) -> float:
    """Fly from a start off the surface to where the tip is next touched, x = `edge`, or for the time that is left.

    Returns the largest depth [m] on the way.
    """
    flight, samples, step, left = FreeFlight(), Samples(), SAMPLE_STEP / math.sqrt(beam.modes.fastest), motion.left
    begin_flight(beam, edge, motion, flight)
    _begin_samples(flight, step, samples)
    t, d, v, highest = 0.0, motion.here.at.x - edge, motion.here.at.v, motion.here.at.x - edge
    while t < left:
        at = t + step
        if at < left:
            d, v_at = _next_sample(flight, samples)
        else:
            at = left
            d, v_at, _ = tip_in_flight(flight, left)
        high = at
        if d <= 0.0 and v > 0.0 and v_at < 0.0:
            top = _zero(flight, t, at, True)
            height = tip_in_flight(flight, top)[0]
            highest = max(highest, height)
            if height > 0.0:
                d, high = height, top
        if d > 0.0:
            _end_flight(beam, motion, flight, _zero(flight, t, high, False), edge)
            return edge
        t, v = at, v_at
        highest = max(highest, d)
    _end_flight(beam, motion, flight, left, edge + d)
    return edge + highest
