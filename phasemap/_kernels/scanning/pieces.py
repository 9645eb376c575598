"""Pieces of the lever's motion between two instants, each at a fixed number of nodes that suit the force on the tip.

Over a piece the lever moves as it would freely, which is known in closed form, and responds to the force f [m] of the
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
from phasemap._kernels.orbits.time.runge_kutta import cosine_and_sine
from phasemap._kernels.quadrature import gauss, integration_matrix
from phasemap._kernels.records import column, record

PIECE_NODES = 12
_PIECE_X, _PIECE_WEIGHTS = gauss(PIECE_NODES)
_RUNNING = np.ascontiguousarray(
    integration_matrix(_PIECE_X).T
).ravel()  # what each node adds to the integrals up to all
_CONTACT_TIME, _CONTACT_STEP = np.sin(0.5 * np.pi * _PIECE_X) ** 2, 0.5 * np.pi * np.sin(np.pi * _PIECE_X)
_ORDER = np.polynomial.legendre.legvander(2 * _PIECE_X - 1, PIECE_NODES - 1)
_LAST = (2 * PIECE_NODES - 1) * _PIECE_WEIGHTS * _ORDER[:, -1]  # the highest coefficients of the series of Legendre
_BUT_ONE = (2 * PIECE_NODES - 3) * _PIECE_WEIGHTS * _ORDER[:, -2]


@record
class PieceNodes:
    """Nodes of a piece: time, free motion, force and the response to it at each."""

    time: np.ndarray = column(PIECE_NODES)  # t from the contact [tau]
    step: np.ndarray = column(PIECE_NODES)  # dt/dx [tau]
    cosine: np.ndarray = column(PIECE_NODES)  # exp(-alpha0 t) times cosine and sine of Omega t
    sine: np.ndarray = column(PIECE_NODES)
    gain: np.ndarray = column(PIECE_NODES)  # exp(2 alpha0 t)
    drive_cos: np.ndarray = column(PIECE_NODES)  # cosine and sine of omega t
    drive_sin: np.ndarray = column(PIECE_NODES)
    depth: np.ndarray = column(PIECE_NODES)  # of the free lever [m]
    speed: np.ndarray = column(PIECE_NODES)  # of the free lever [m per tau]
    force: np.ndarray = column(PIECE_NODES)  # f [m]
    w: np.ndarray = column(PIECE_NODES)  # response of the lever to the force [m]
    w_speed: np.ndarray = column(PIECE_NODES)  # w' [m per tau]
    sum_cos: np.ndarray = column(PIECE_NODES)  # two running integrals of the force
    sum_sin: np.ndarray = column(PIECE_NODES)


class SprungLever(NamedTuple):
    """A lever away from the surface, that a second spring without force at z0 may stiffen.

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
    """Position z and speed z' of the lever [m], and exp(i psi) of the drive's phase psi."""

    z: float
    v: float
    drive: complex


class Kick(NamedTuple):
    """Changes of z and z' at t = 0 by the force over a piece [m]."""

    z: float
    v: float


@kernel
def lever_with_spring(omega: float, alpha0: float, base: float, kappa: float, z0: float) -> SprungLever:
    """The lever with a second spring, of stiffness kappa over the lever's, that exerts no force at z0 [m]."""
    stiffness = 1.0 + kappa
    swing = base / complex(stiffness - omega * omega, 2.0 * alpha0 * omega)
    own = math.sqrt(stiffness - alpha0 * alpha0)
    return SprungLever(omega, alpha0, base, stiffness, own, kappa / stiffness * z0, swing)


@kernel
def move_freely(lever: SprungLever, at: Instant, time: float) -> Instant:
    """Position, speed and drive phase of the free lever a time later."""
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
def move_by_series(lever: SprungLever, at: Instant, time: float) -> Instant:
    """Position, speed and drive phase of the free lever a short time later or earlier, by a series of fourth order."""
    omega, alpha0, base, stiffness, _, place, _ = lever
    z, v, drive = at
    a = base * drive.real - stiffness * (z - place) - 2.0 * alpha0 * v
    b = -omega * base * drive.imag - stiffness * v - 2.0 * alpha0 * a
    c = -omega * omega * base * drive.real - stiffness * a - 2.0 * alpha0 * b
    cosine, sine = cosine_and_sine(omega * time)
    return Instant(
        z + time * (v + time / 2.0 * (a + time / 3.0 * (b + time / 4.0 * c))),
        v + time * (a + time / 2.0 * (b + time / 3.0 * c)),
        drive * complex(cosine, sine),
    )


@kernel(inline=True, fastmath=ANY_ORDER)
def _cosine_and_sine_by_series(angle: float) -> tuple[float, float]:
    """Cosine and sine of an angle of at most a turn and a quarter, by Taylor's series of an eighth of it."""
    c, s = cosine_and_sine(0.125 * angle)
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
    """x^8 by three squares."""
    x *= x
    x *= x
    return x * x


@kernel(light=True)
def place_contact_nodes(h: float, nodes: PieceNodes) -> None:
    """Place the nodes of a contact of duration h, where roots of the depth are smooth: theory, Eq. (time-9)."""
    for j in range(PIECE_NODES):
        nodes.time[j] = h * _CONTACT_TIME[j]
        nodes.step[j] = h * _CONTACT_STEP[j]


@kernel(fastmath=ANY_ORDER)
def place_flight_nodes(near: float, start: float, end: float, sign: float, nodes: PieceNodes) -> None:
    """Place the nodes of a flight before (-1) or after (1) contact: steps grow from `near` at contact."""
    first = 1.0 + start / near
    high = math.log((near + end) / (near + start))
    for j in range(PIECE_NODES):
        x = 0.125 * high * _PIECE_X[j]
        e = first * _eighth_power(_exponential(x))
        nodes.time[j] = sign * near * (e - 1.0)
        nodes.step[j] = near * high * e


@kernel(fastmath=ANY_ORDER)
def fill_free_flight_at_nodes(lever: SprungLever, at: Instant, z0: float, nodes: PieceNodes) -> None:
    """Fill in depth and speed at the nodes of the free lever that passes the instant `at` at t = 0."""
    omega, alpha0, _, stiffness, own, place, swing = lever
    now = swing * at.drive
    re, im = now.real, now.imag
    y, q = at.z - place - re, at.v + omega * im
    u, p, low = (q + alpha0 * y) / own, (alpha0 * q + stiffness * y) / own, place - z0
    for j in range(PIECE_NODES):
        t = nodes.time[j]
        x = 0.125 * alpha0 * t
        fall = _eighth_power(_exponential(-x))
        cosine, sine = _cosine_and_sine_by_series(own * t)
        nodes.gain[j] = 1.0 / (fall * fall)
        nodes.cosine[j], nodes.sine[j] = fall * cosine, fall * sine
        cosine, sine = _cosine_and_sine_by_series(omega * t)
        nodes.drive_cos[j], nodes.drive_sin[j] = cosine, sine
        nodes.depth[j] = re * cosine - im * sine + y * nodes.cosine[j] + u * nodes.sine[j] + low
        nodes.speed[j] = -omega * (re * sine + im * cosine) + q * nodes.cosine[j] - p * nodes.sine[j]


@kernel(fastmath=ANY_ORDER)
def fill_attraction(law: Law, p: tuple[float, ...], compliance: float, nodes: PieceNodes) -> float:
    """Fill in the force in flight at the nodes; returns the largest depth at the nodes."""
    top = -math.inf
    for j in range(PIECE_NODES):
        d = nodes.depth[j] + nodes.w[j]
        top = max(top, d)
        nodes.force[j] = longrange_force(law, min(d, 0.0), p) * compliance
    return top


@kernel(fastmath=ANY_ORDER)
def fill_contact_force(law: Law, p: tuple[float, ...], compliance: float, kappa: float, nodes: PieceNodes) -> float:
    """Fill in the force in contact, less that of the spring, at the nodes; returns the largest depth at the nodes."""
    top = -math.inf
    for j in range(PIECE_NODES):
        d = nodes.depth[j] + nodes.w[j]
        top = max(top, d)
        nodes.force[j] = contact_force(law, max(d, 0.0), p) * compliance - kappa * d
    if p[col.DAMPING] != 0.0:
        for j in range(PIECE_NODES):
            d = max(nodes.depth[j] + nodes.w[j], 0.0)
            nodes.force[j] += 2.0 * damping(law, d, p) * (nodes.speed[j] + nodes.w_speed[j])
    return top


@kernel(fastmath=ANY_ORDER)
def fill_response(lever: SprungLever, sign: float, nodes: PieceNodes) -> tuple[Kick, float]:
    """Fill in the lever's response w to the force; returns the kick at t = 0 and the change of w.

    It is 0 where the piece begins: before contact (sign -1) at the last node, for nodes there run back in time.
    """
    alpha0, own = lever.alpha0, lever.own
    for j in range(PIECE_NODES):
        nodes.sum_cos[j] = nodes.sum_sin[j] = 0.0
    for i in range(PIECE_NODES):
        f = nodes.step[i] * nodes.force[i] * nodes.gain[i]
        c, s = f * nodes.cosine[i], f * nodes.sine[i]
        for j in range(PIECE_NODES):
            nodes.sum_cos[j] += _RUNNING[PIECE_NODES * i + j] * c
            nodes.sum_sin[j] += _RUNNING[PIECE_NODES * i + j] * s
    by_c = by_s = 0.0
    for j in range(PIECE_NODES):
        f = _PIECE_WEIGHTS[j] * nodes.step[j] * nodes.force[j] * nodes.gain[j]
        by_c += f * nodes.cosine[j]
        by_s += f * nodes.sine[j]
    first_c, first_s = (by_c, by_s) if sign < 0.0 else (0.0, 0.0)
    change = 0.0
    for j in range(PIECE_NODES):
        c, s = first_c + sign * nodes.sum_cos[j], first_s + sign * nodes.sum_sin[j]
        w = (nodes.cosine[j] * s - nodes.sine[j] * c) / own
        change = max(change, abs(w - nodes.w[j]))
        nodes.w[j] = w
        nodes.w_speed[j] = -nodes.cosine[j] * c - nodes.sine[j] * s - alpha0 * w
    return Kick(by_s / own, -by_c - alpha0 * by_s / own), change


@kernel(fastmath=ANY_ORDER)
def force_harmonic(kappa: float, nodes: PieceNodes) -> complex:
    """Integral of the whole force times exp(-i omega t) over a piece [m tau]."""
    even = odd = 0.0
    for j in range(PIECE_NODES):
        f = _PIECE_WEIGHTS[j] * nodes.step[j] * (nodes.force[j] + kappa * (nodes.depth[j] + nodes.w[j]))
        even += f * nodes.drive_cos[j]
        odd -= f * nodes.drive_sin[j]
    return complex(even, odd)


@kernel(fastmath=ANY_ORDER)
def last_coefficients(nodes: PieceNodes) -> float:
    """Size of the last two Legendre coefficients of a piece's force [m]: what its nodes leave out."""
    last = but_one = 0.0
    for j in range(PIECE_NODES):
        f = nodes.step[j] * nodes.force[j]
        last += _LAST[j] * f
        but_one += _BUT_ONE[j] * f
    return abs(last) + abs(but_one)
