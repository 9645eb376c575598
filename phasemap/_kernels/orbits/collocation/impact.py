"""Where Newton's method begins if the contact throws the lever back: with the motion after a kick.

A lever in liquid takes in-phase forces P of the order of its amplitude, and bends by as much: the tip comes to a soft
sample or with a soft lever far faster than in a harmonic orbit that goes equally deep, and from such an orbit Newton's
method does not converge. But a contact is short, and what the lever does after a kick of first harmonic J at an angle
phi has a closed form: theory, Eq. (collocation-6). Energy tells phi, the drive J, and the equation of motion in contact
how fast the tip comes, how deep it goes and for how long: theory, Eq. (collocation-7).
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import (
    Oscillator,
    contact_force,
    contact_slope,
    damping,
    has_hysteresis,
    has_longrange,
    longrange_force,
)
from phasemap._kernels.lever import all_shares, mode_of, modes_of, reach_of
from phasemap._kernels.numerics import narrowed
from phasemap._kernels.orbits.collocation.elements import lay_elements
from phasemap._kernels.orbits.collocation.newton import share_motion
from phasemap._kernels.orbits.collocation.system import Orbit, element_of, head_of
from phasemap._kernels.orbits.response.nodes import periods_before
from phasemap._kernels.quadrature import NODES
from phasemap._kernels.records import record

KICK_LIFT = 0.75  # of P: w of a short contact, sum over P/(n^2 - 1)
LONGEST_KICK = 1.5  # [rad] from where the tip touches to where it is deepest: a longer contact is no kick
# A step [rad]: at most, of the contact's own oscillation, of a stop.
STRIDE, STRIDE_OF_OSCILLATION, STRIDE_OF_STOP = 0.1, 0.3, 0.25
MOST_STRIDES = 400  # of a contact
MOST_ROUNDS = 8  # between drive, energy and speed
MOST_SPEEDS = 40  # tried for one kick
KICK_KNOWN, KICK_ROUGHLY = 3e-3, 1e-2  # share of the drive to which J is known, and of J to which the speed gives it


@record
class Hit:
    """A contact that throws the lever back."""

    kick: float  # first harmonic J of its force [m]
    angle: float  # phi, where it is [rad]
    speed: float  # d' [m] where it begins
    depth: float  # [m]
    half: float  # of its length [rad]
    loss: float  # of d'^2/2 in it [m^2]


@kernel
def after_kick(lever: np.ndarray, angle: float) -> tuple[float, float]:
    """Return w and w' at an angle after a kick of first harmonic one, less mean and first harmonic."""
    omega, cosine, sine = lever[col.OMEGA], math.cos(angle), math.sin(angle)
    w, u = 0.0, 0.0
    for i in range(modes_of(lever)):
        a, nu, squared, rate, yields = mode_of(lever, i)
        e_re, e_im = periods_before(a, nu)
        grow = math.exp(a * angle)
        c, s = grow * math.cos(nu * angle), grow * math.sin(nu * angle)
        re, im = c * (e_re + 1.0) - s * e_im, c * e_im + s * (e_re + 1.0)
        share = -yields * math.pi / (omega * omega * nu)
        first = yields / complex(squared - omega * omega, 2.0 * rate * omega)
        w += share * im + 0.5 * yields / squared + first.real * cosine - first.imag * sine
        u += share * (a * im + nu * re) - first.real * sine - first.imag * cosine
    return w, u


@kernel
def bounce(oscillator: Oscillator, turn: float, hit: Hit) -> bool:
    """Fill depth, half length and loss of a contact that begins with its speed, d'' = -g/omega^2 - turn.

    False if it lasts too long.
    """
    law, p, lever = oscillator
    omega = lever[col.OMEGA]
    share = all_shares(lever) / (lever[col.STIFFNESS] * omega * omega)
    speed = hit.speed
    d, v, t, loss = 0.0, speed, 0.0, 0.0
    a = -share * contact_force(law, 0.0, p) - turn
    for _ in range(MOST_STRIDES):
        stiff = max(share * contact_slope(law, max(d, 1e-3 * speed), p), 1.0)
        step = min(min(STRIDE, STRIDE_OF_OSCILLATION / math.sqrt(stiff)), STRIDE_OF_STOP * speed / max(abs(a), 1e-300))
        half_way = v + 0.5 * step * a
        deeper = d + step * half_way
        a = -share * contact_force(law, deeper, p) - turn
        if p[col.DAMPING] != 0.0:
            gamma = 2.0 / omega * damping(law, max(deeper, 0.0), p)
            a -= gamma * half_way
            loss += gamma * half_way * half_way * step
        v_after = half_way + 0.5 * step * a
        if v_after <= 0.0:
            rest = step * v / (v - v_after)
            hit.depth, hit.half, hit.loss = d + 0.5 * v * rest, t + rest, 2.0 * loss
            return True
        d, v, t = deeper, v_after, t + step
        if t > LONGEST_KICK:
            return False
    return False


@kernel
def kick_at(oscillator: Oscillator, speed: float, turn: float, hit: Hit) -> float:
    """First harmonic J of the force of a contact that begins with a speed; NaN if it lasts too long."""
    law, p, lever = oscillator
    hit.speed = speed
    if not bounce(oscillator, turn, hit):
        return math.nan
    squared, outside = lever[col.OMEGA] ** 2 / all_shares(lever), 0.0
    if has_longrange(p):
        outside = reach_of(p) * longrange_force(law, 0.0, p) / (lever[col.STIFFNESS] * squared * speed)
    return 2.0 * squared / math.pi * (speed - turn * hit.half + outside)


@kernel
def speed_for(oscillator: Oscillator, kick: float, turn: float, hit: Hit) -> bool:
    """Fill the hit with the contact whose force has a first harmonic `kick`; False if it lasts too long."""
    lever = oscillator.lever
    low, f_low, high, f_high = 0.0, -kick, 0.25 * math.pi * kick * all_shares(lever) / lever[col.OMEGA] ** 2, 0.0
    for _ in range(MOST_SPEEDS):
        f_high = kick_at(oscillator, high, turn, hit) - kick
        if not f_high < 0.0:
            break
        low, f_low = high, f_high
        high *= 1.5
    if not f_high >= 0.0:
        return False
    for _ in range(MOST_SPEEDS):
        speed = (low * f_high - high * f_low) / (f_high - f_low)
        f = kick_at(oscillator, speed, turn, hit) - kick
        if not abs(f) > KICK_ROUGHLY * kick:
            return not math.isnan(f)
        low, f_low, high, f_high = narrowed(low, f_low, high, f_high, speed, f)
    return False


@kernel
def mismatch_of_kick(lever: np.ndarray, amplitude: float, kick: float, sine: float) -> float:
    """Drive needed, squared, less that given, squared [m^2], where a kick J at an angle phi holds the amplitude.

    It is (J cos(phi) + A s)^2 + (y A - J sin(phi))^2 - u0^2, with the dynamic stiffness s + i y.
    """
    cosine = math.sqrt(max(1.0 - sine * sine, 0.0))
    x, y = kick * cosine + amplitude * lever[col.DYNAMIC_STIFFNESS], amplitude * lever[col.DYNAMIC_LOSS] - kick * sine
    return x * x + y * y - lever[col.DRIVE] ** 2


@kernel
def sine_of_kick(lever: np.ndarray, amplitude: float, kick: float, mean_slope: float, loss: float) -> float:
    """Sine of the angle at which a kick J makes up for what the contact loses: theory, Eq. (collocation-7)."""
    sine = (mean_slope * kick - lever[col.OMEGA] ** 2 * loss / (math.pi * kick)) / amplitude
    return max(-1.0, min(sine, 1.0))


@kernel
def kick_for_drive(lever: np.ndarray, amplitude: float, mean_slope: float, loss: float) -> float:
    """The least kick J [m] that takes the drive at this amplitude; NaN where none is found."""
    low, high = 0.0, 0.1 * lever[col.DRIVE]
    f_low, f_high = (lever[col.DYNAMIC_STIFFNESS] ** 2 + lever[col.DYNAMIC_LOSS] ** 2) * amplitude**2, 0.0
    f_low -= lever[col.DRIVE] ** 2
    for _ in range(MOST_SPEEDS):
        f_high = mismatch_of_kick(lever, amplitude, high, sine_of_kick(lever, amplitude, high, mean_slope, loss))
        if f_high > 0.0:
            break
        low, f_low = high, f_high
        high *= 1.5
    if not f_high > 0.0 > f_low:
        return math.nan
    for _ in range(MOST_SPEEDS):
        kick = (low * f_high - high * f_low) / (f_high - f_low)
        f = mismatch_of_kick(lever, amplitude, kick, sine_of_kick(lever, amplitude, kick, mean_slope, loss))
        if abs(f) < KICK_KNOWN * lever[col.DRIVE] ** 2:
            return kick
        low, f_low, high, f_high = narrowed(low, f_low, high, f_high, kick, f)
    return math.nan


@kernel
def find_hit(oscillator: Oscillator, amplitude: float, hit: Hit) -> bool:
    """Fill the hit that takes the drive at this amplitude; False where no short contact does."""
    lever = oscillator.lever
    mean_slope = 0.5 * (after_kick(lever, 0.0)[1] + after_kick(lever, 2.0 * math.pi)[1])
    before, loss = 0.0, 0.0
    for _ in range(MOST_ROUNDS):
        kick = kick_for_drive(lever, amplitude, mean_slope, loss)
        if not kick > 0.0:
            return False
        sine = sine_of_kick(lever, amplitude, kick, mean_slope, loss)
        turn = amplitude * math.sqrt(1.0 - sine * sine) - KICK_LIFT * kick
        if not abs(sine) < 1.0 or not speed_for(oscillator, kick, turn, hit):
            return False
        hit.kick, hit.angle, loss = kick, math.asin(sine), hit.loss
        if abs(kick - before) < KICK_KNOWN * lever[col.DRIVE]:
            break
        before = kick
    return hit.half < LONGEST_KICK


@kernel
def motion_of(lever: np.ndarray, amplitude: float, centre: float, hit: Hit, theta: float) -> tuple[float, float]:
    """Return w, less its mean, and w' at an angle: in contact of a quartic that has its depth and speed."""
    angle, kick, half, depth = theta - hit.angle, hit.kick, hit.half, hit.depth
    if abs(angle) < half:
        x = angle / half
        flat = 0.5 * hit.speed * half / depth - 1.0
        d = depth * (1.0 - x * x) * (1.0 + flat * x * x)
        rate = depth * 2.0 * x * (flat * (1.0 - 2.0 * x * x) - 1.0) / half
        return d + centre - amplitude * math.cos(theta), rate + amplitude * math.sin(theta)
    w, u = after_kick(lever, angle % (2.0 * math.pi))
    return kick * w, kick * u


@kernel
def begin_impact(oscillator: Oscillator, orbit: Orbit, amplitude: float, level: int) -> bool:
    """Set the motion after a kick that takes the drive at this amplitude; False where no short contact does."""
    p, lever = oscillator.p, oscillator.lever
    hit, head = Hit(), head_of(orbit)
    if has_hysteresis(p) or not find_hit(oscillator, amplitude, hit):
        return False
    kick, angle, half = hit.kick, hit.angle, hit.half
    lifted = after_kick(lever, half)[0] + after_kick(lever, 2.0 * math.pi - half)[0]
    e, mean = amplitude * math.cos(angle) * math.cos(half) + 0.5 * kick * lifted, -0.5 * kick
    head.amplitude, head.tip_offset = amplitude, e + mean
    head.push, head.drag = kick * math.cos(angle), kick * math.sin(angle)
    head.contacts = 1
    head.contact_start[0], head.contact_end[0], head.neck_end[0] = angle - half, angle + half, angle + half
    laid = lay_elements(oscillator, orbit, orbit, level)
    for i in range(head.count + 1):
        one = element_of(orbit, i)
        for j in range(NODES):
            w, u = motion_of(lever, amplitude, e, hit, one.theta[j])
            one.w[j], one.u[j] = mean + w, u
        w, u = motion_of(lever, amplitude, e, hit, one.edge)
        one.edge_w, one.edge_u = mean + w, u
    share_motion(lever, orbit)
    return laid
