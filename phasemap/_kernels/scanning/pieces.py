"""Pieces of the lever's motion between two instants, each at a fixed number of nodes that suit the force on the tip.

Over a piece the lever moves as it would freely, which is known in closed form, and answers to the force f [m] of the
surface, over k, with

    w(t) = -integral of exp(-alpha0 (t - s)) sin(Omega (t - s))/Omega f(s) ds,    Omega^2 = 1 + kappa - alpha0^2

(theory, Eq. (time-8)); kappa is the stiffness, over k, of a spring that takes a part of f. The factor of f is a sum of
products of functions of t and s, so w costs two running integrals over the nodes, and f is all that has to be resolved:
not the lever.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.law import Law, contact_force, damping, longrange_force
from phasemap._kernels.orbits.time.runge_kutta import turn
from phasemap._kernels.quadrature import gauss, integration_matrix

NODES = 12
_X, _WEIGHTS = gauss(NODES)
_RUNNING = np.ascontiguousarray(integration_matrix(_X).T).ravel()  # what each node adds to the integrals up to all
_ROUND, _ROUND_STEP = np.sin(0.5 * np.pi * _X) ** 2, 0.5 * np.pi * np.sin(np.pi * _X)
_ORDER = np.polynomial.legendre.legvander(2 * _X - 1, NODES - 1)
_LAST = (2 * NODES - 1) * _WEIGHTS * _ORDER[:, -1]  # the highest coefficients of the series of Legendre
_BUT_ONE = (2 * NODES - 3) * _WEIGHTS * _ORDER[:, -2]

# Rows of a piece, NODES numbers each: time t from the contact, dt/dx, exp(-alpha0 t) times cosine and sine of Omega t,
# exp(2 alpha0 t), cosine and sine of omega t, free depth and speed, force f, w and w', and two running integrals.
TIME, STEP, COSINE, SINE, GAIN, DRIVE_C, DRIVE_S, DEPTH, SPEED, FORCE, W, W_SPEED, BY_C, BY_S, ROWS = range(
    0, 15 * NODES, NODES
)


class Lever(NamedTuple):
    """A free lever, maybe on a spring that is at rest at z0.

    omega, alpha0, u0 [m], stiffness 1 + kappa over its own, own frequency Omega, its place [m] without a drive, and
    swing [m], Re(swing exp(i psi)) about that, with it.
    """

    omega: float
    alpha0: float
    base: float
    stiffness: float
    own: float
    place: float
    swing: complex


class Instant(NamedTuple):
    """Where the lever is: z, z' [m], and exp(i psi) of the drive's phase psi."""

    z: float
    v: float
    drive: complex


class Kick(NamedTuple):
    """What the force over a piece does to z and z' at t = 0 [m]."""

    z: float
    v: float


@kernel
def lever_on(omega: float, alpha0: float, base: float, kappa: float, z0: float) -> Lever:
    """A lever that rings, on a spring."""
    stiffness = 1.0 + kappa
    swing = base / complex(stiffness - omega * omega, 2.0 * alpha0 * omega)
    own = math.sqrt(stiffness - alpha0 * alpha0)
    return Lever(omega, alpha0, base, stiffness, own, kappa / stiffness * z0, swing)


@kernel
def free(lever: Lever, at: Instant, time: float) -> Instant:
    """The free lever a time later."""
    omega, alpha0, _, stiffness, own, place, swing = lever
    now = swing * at.drive
    y, q = at.z - place - now.real, at.v + omega * now.imag
    fall = math.exp(-alpha0 * time)
    along, across = fall * math.cos(own * time), fall * math.sin(own * time) / own
    drive = at.drive * complex(math.cos(omega * time), math.sin(omega * time))
    now = swing * drive
    return Instant(
        place + now.real + y * along + (q + alpha0 * y) * across,
        -omega * now.imag + q * along - (alpha0 * q + stiffness * y) * across,
        drive,
    )


@kernel
def soon(lever: Lever, at: Instant, time: float) -> Instant:
    """The same a short time later or sooner, to the fourth order."""
    omega, alpha0, base, stiffness, _, place, _ = lever
    z, v, drive = at
    a = base * drive.real - stiffness * (z - place) - 2.0 * alpha0 * v
    b = -omega * base * drive.imag - stiffness * v - 2.0 * alpha0 * a
    c = -omega * omega * base * drive.real - stiffness * a - 2.0 * alpha0 * b
    cosine, sine = turn(omega * time)
    return Instant(
        z + time * (v + time / 2.0 * (a + time / 3.0 * (b + time / 4.0 * c))),
        v + time * (a + time / 2.0 * (b + time / 3.0 * c)),
        drive * complex(cosine, sine),
    )


@kernel(inline=True, fastmath=ANY_ORDER)
def _swing(angle: float) -> tuple[float, float]:
    """Cosine and sine of an angle of at most a turn and a quarter, by Taylor's series of an eighth of it."""
    c, s = turn(0.125 * angle)
    c, s = c * c - s * s, 2.0 * c * s
    c, s = c * c - s * s, 2.0 * c * s
    return c * c - s * s, 2.0 * c * s


@kernel(inline=True, fastmath=ANY_ORDER)
def _exponential(x: float) -> float:
    """exp(x) for |x| < 1, by Taylor's series to 2e-9."""
    rest = 1 / 5040 + x * (1 / 40320 + x * (1 / 362880 + x * (1 / 3628800 + x * (1 / 39916800))))
    return 1.0 + x * (1.0 + x * (1 / 2 + x * (1 / 6 + x * (1 / 24 + x * (1 / 120 + x * (1 / 720 + x * rest))))))


@kernel(inline=True, fastmath=ANY_ORDER)
def _eighth_power(x: float) -> float:
    x *= x
    x *= x
    return x * x


@kernel(light=True)
def round_off(h: float, m: np.ndarray) -> None:
    """Nodes of a contact that lasts h: theory, Eq. (time-9). Half-integer powers of the depth are smooth in them."""
    for j in range(NODES):
        m[TIME + j] = h * _ROUND[j]
        m[STEP + j] = h * _ROUND_STEP[j]


@kernel(fastmath=ANY_ORDER)
def graded(near: float, start: float, end: float, sign: float, m: np.ndarray) -> None:
    """Nodes of a flight between two times before (-1) or after (1) contact: steps grow from `near` at contact."""
    first = 1.0 + start / near
    high = math.log((near + end) / (near + start))
    for j in range(NODES):
        x = 0.125 * high * _X[j]
        e = first * _eighth_power(_exponential(x))
        m[TIME + j] = sign * near * (e - 1.0)
        m[STEP + j] = near * high * e


@kernel(fastmath=ANY_ORDER)
def lay(lever: Lever, at: Instant, z0: float, m: np.ndarray) -> None:
    """Fill in what the free lever does at the nodes that comes to `at` at t = 0."""
    omega, alpha0, _, stiffness, own, place, swing = lever
    now = swing * at.drive
    re, im = now.real, now.imag
    y, q = at.z - place - re, at.v + omega * im
    u, p, low = (q + alpha0 * y) / own, (alpha0 * q + stiffness * y) / own, place - z0
    for j in range(NODES):
        t = m[TIME + j]
        x = 0.125 * alpha0 * t
        fall = _eighth_power(_exponential(-x))
        cosine, sine = _swing(own * t)
        m[GAIN + j] = 1.0 / (fall * fall)
        m[COSINE + j], m[SINE + j] = fall * cosine, fall * sine
        cosine, sine = _swing(omega * t)
        m[DRIVE_C + j], m[DRIVE_S + j] = cosine, sine
        m[DEPTH + j] = re * cosine - im * sine + y * m[COSINE + j] + u * m[SINE + j] + low
        m[SPEED + j] = -omega * (re * sine + im * cosine) + q * m[COSINE + j] - p * m[SINE + j]


@kernel(fastmath=ANY_ORDER)
def attract(law: Law, p: tuple[float, ...], compliance: float, m: np.ndarray) -> float:
    """Fill in the force in flight; returns the largest depth at the nodes."""
    top = -math.inf
    for j in range(NODES):
        d = m[DEPTH + j] + m[W + j]
        top = max(top, d)
        m[FORCE + j] = longrange_force(law, min(d, 0.0), p) * compliance
    return top


@kernel(fastmath=ANY_ORDER)
def repel(law: Law, p: tuple[float, ...], compliance: float, kappa: float, m: np.ndarray) -> float:
    """Fill in the force in contact less that of the spring; returns the largest depth at the nodes."""
    top = -math.inf
    for j in range(NODES):
        d = m[DEPTH + j] + m[W + j]
        top = max(top, d)
        m[FORCE + j] = contact_force(law, max(d, 0.0), p) * compliance - kappa * d
    if p[col.DAMPING] != 0.0:
        for j in range(NODES):
            d = max(m[DEPTH + j] + m[W + j], 0.0)
            m[FORCE + j] += 2.0 * damping(law, d, p) * (m[SPEED + j] + m[W_SPEED + j])
    return top


@kernel(fastmath=ANY_ORDER)
def answer(lever: Lever, sign: float, m: np.ndarray) -> tuple[Kick, float]:
    """Fill in w and w', which are 0 where the piece begins; returns what the force does, and by how much w changed.

    Before contact (sign -1) nodes run back in time, and the piece begins with the last of them.
    """
    alpha0, own = lever.alpha0, lever.own
    for j in range(NODES):
        m[BY_C + j] = m[BY_S + j] = 0.0
    for i in range(NODES):
        f = m[STEP + i] * m[FORCE + i] * m[GAIN + i]
        c, s = f * m[COSINE + i], f * m[SINE + i]
        for j in range(NODES):
            m[BY_C + j] += _RUNNING[NODES * i + j] * c
            m[BY_S + j] += _RUNNING[NODES * i + j] * s
    by_c = by_s = 0.0
    for j in range(NODES):
        f = _WEIGHTS[j] * m[STEP + j] * m[FORCE + j] * m[GAIN + j]
        by_c += f * m[COSINE + j]
        by_s += f * m[SINE + j]
    first_c, first_s = (by_c, by_s) if sign < 0.0 else (0.0, 0.0)
    change = 0.0
    for j in range(NODES):
        c, s = first_c + sign * m[BY_C + j], first_s + sign * m[BY_S + j]
        w = (m[COSINE + j] * s - m[SINE + j] * c) / own
        change = max(change, abs(w - m[W + j]))
        m[W + j] = w
        m[W_SPEED + j] = -m[COSINE + j] * c - m[SINE + j] * s - alpha0 * w
    return Kick(by_s / own, -by_c - alpha0 * by_s / own), change


@kernel(fastmath=ANY_ORDER)
def harmonic_of(kappa: float, m: np.ndarray) -> complex:
    """The integral of the whole force times exp(-i omega t) over a piece."""
    even = odd = 0.0
    for j in range(NODES):
        f = _WEIGHTS[j] * m[STEP + j] * (m[FORCE + j] + kappa * (m[DEPTH + j] + m[W + j]))
        even += f * m[DRIVE_C + j]
        odd -= f * m[DRIVE_S + j]
    return complex(even, odd)


@kernel(fastmath=ANY_ORDER)
def left_out(m: np.ndarray) -> float:
    """How large the last two of the Legendre coefficients of a piece's force are [m]."""
    last = but_one = 0.0
    for j in range(NODES):
        f = m[STEP + j] * m[FORCE + j]
        last += _LAST[j] * f
        but_one += _BUT_ONE[j] * f
    return abs(last) + abs(but_one)
