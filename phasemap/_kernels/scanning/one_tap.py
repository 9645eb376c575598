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
from phasemap._kernels.law import Law, Oscillator, contact_slope, has_hysteresis, has_longrange
from phasemap._kernels.lever import reach_of
from phasemap._kernels.orbits.time.march import march_period
from phasemap._kernels.orbits.time.tip import PeriodResult, V, Z
from phasemap._kernels.records import clear, record
from phasemap._kernels.scanning.pieces import (
    PIECE_NODES,
    Instant,
    PieceNodes,
    SprungLever,
    fill_attraction,
    fill_contact_force,
    fill_free_flight_at_nodes,
    fill_response,
    force_harmonic,
    last_coefficients,
    lever_with_spring,
    move_by_series,
    move_freely,
    place_contact_nodes,
    place_flight_nodes,
)

MOST_PIECE_PASSES = 8  # of a piece
SLOWEST_PASSES = 0.5  # how much of a change in the last pass may be left in the next
NEAR_CONTACT = 0.03  # [tau]: so near to contact the lever follows its Taylor series
SPRING_SHARE = 0.7  # of the slope of the force at the deepest point, which the spring has that stands for it
SETTLED_PATH = 3e-6  # of reach or indentation: a change of the way of the tip that needs no further pass
# The most that the last two Legendre coefficients of a force may have [u0]: settled, that leaves 4e-6 rad at most.
ROUGH_FLIGHT = 1e-2
ROUGH_TAP = 0.15
SHORTEST_FLIGHT = 0.05  # [tau]: a flight that a period does not cut where it begins
LONGEST_TAP = 2.5  # [tau]: a contact that a period does not cut where it begins
OFF_RESONANCE = 0.25  # distance from resonance where the lever meets the surface twice
HARDLY_RINGS = 0.1  # alpha0, from which on what the march leaves is forgotten as soon
WAIT = 50  # periods that are marched after one that pieces did not follow, even without another before it

BEFORE_CONTACT = -1.0
AFTER_CONTACT = 1.0


@record
class Taps:
    """Nodes and numbers of the last tap, with which the next period begins."""

    landing: PieceNodes  # flight to the surface
    contact: PieceNodes
    leaving: PieceNodes  # flight from the surface
    back: PieceNodes  # the part of that flight in which the tip comes back
    duration: float  # of the last contact [tau]; 0 without one
    kappa: float  # stiffness of the spring that stood for it, over that of the lever
    marches: int  # periods that are still to be marched


class Surface(NamedTuple):
    """Surface under the tip."""

    law: Law
    p: tuple[float, ...]  # parameters of its material
    compliance: float  # 1/k of the lever [m/N]
    reach: float  # of its attraction [m]
    z0: float  # tip offset [m]


class Piece(NamedTuple):
    """Motion of the tip over a piece of a period."""

    good: bool  # whether it was found
    time: float  # that it takes [tau]
    end: Instant
    push: complex  # integral of f exp(-i psi) [m tau]


@kernel
def tap_or_march(
    oscillator: Oscillator, z0: float, step_size: float, y: np.ndarray, acc: PeriodResult, taps: Taps
) -> int:
    """Solve a period as one tap or by `march_period`; returns steps: 1, or what that returns.

    Of `acc`, the first harmonic is filled.
    """
    law, p, lever = oscillator
    apt = abs(lever[col.OMEGA] - 1.0) < OFF_RESONANCE and lever[col.ALPHA0] < HARDLY_RINGS
    if apt and lever[col.MODES] < 2 and law.memory == 0 and law.lossy == 0 and not has_hysteresis(p):
        if taps.marches > 0:
            taps.marches -= 1
        elif tap_once(oscillator, z0, y, acc, taps):
            return 1
    return int(march_period(oscillator, z0, step_size, y, acc))


@kernel(shared=True)
def tap_once(oscillator: Oscillator, z0: float, y: np.ndarray, acc: PeriodResult, taps: Taps) -> bool:
    """Solve a period with one tap; returns True if it was one that the pieces can follow.

    If so the state `y` at drive phase 0 is advanced, and the first harmonic in `acc` filled. `taps` was left by the
    period before; zeros at first.
    """
    law, p, lever = oscillator
    alone = lever_with_spring(lever[col.OMEGA], lever[col.ALPHA0], lever[col.DRIVE], 0.0, z0)
    period = 2.0 * math.pi / alone.omega
    start = Instant(y[Z], y[V], complex(1.0, 0.0))
    surface = Surface(law, p, 1.0 / lever[col.STIFFNESS], reach_of(p), z0)
    time, at = _free_landing(alone, start, z0)
    if not SHORTEST_FLIGHT < time < period - SHORTEST_FLIGHT:
        return False
    down = _solve_landing(surface, alone, at, time, taps.landing)
    if down.good:
        tap = _solve_contact(surface, alone, down.end, taps)
        if tap.good and down.time + tap.time < period - SHORTEST_FLIGHT:
            up = _solve_return(surface, alone, tap.end, period - tap.time, down.time, taps)
            if up.good:
                _fill_first_harmonic(alone, start, up.end, down.push + tap.push + up.push, acc)
                y[Z], y[V] = up.end.z, up.end.v
                return True
    knew = taps.duration > 0.0
    clear(taps)
    taps.marches = 0 if knew else WAIT
    return False


@kernel
def _free_landing(lever: SprungLever, start: Instant, z0: float) -> tuple[float, Instant]:
    """Time at which the free lever comes to the surface at z0, and its motion then; NaN if it does not."""
    size = math.hypot(start.z, start.v / lever.omega)
    if not (start.z < z0 and z0 < size):
        return math.nan, start
    time = (math.atan2(start.v / lever.omega, start.z) - math.acos(z0 / size)) / lever.omega
    if time < 0.0:
        time += 2.0 * math.pi / lever.omega
    at = move_freely(lever, start, time)
    for _ in range(8):
        if not at.v > 0.0:
            break
        more = (z0 - at.z) / at.v
        time += more
        if abs(more) < NEAR_CONTACT:
            at = move_by_series(lever, at, more)
            more = (z0 - at.z) / at.v
            return time + more, move_by_series(lever, at, more)
        at = move_freely(lever, start, time)
    return math.nan, start


@kernel
def _place_nodes(surface: Surface, at: Instant, start: float, end: float, side: float, nodes: PieceNodes) -> None:
    """Place the nodes of a flight between two times from a contact at the instant `at`: theory, Eq. (time-9).

    The first steps are as long as the free lever takes to move by the reach of the force.
    """
    near = 2.0 * surface.reach / (abs(at.v) + math.sqrt(at.v * at.v + 2.0 * max(surface.z0, 0.0) * surface.reach))
    place_flight_nodes(near, start, end, side, nodes)


@kernel
def _solve_landing(surface: Surface, lever: SprungLever, at: Instant, time: float, nodes: PieceNodes) -> Piece:
    """Flight to contact, which the free lever makes after a time at the instant `at`: attraction makes it sooner."""
    last = math.inf
    if not has_longrange(surface.p):
        return Piece(True, time, at, complex(0.0, 0.0))
    more = (
        nodes.w_speed[0] * nodes.time[0] - nodes.w[0]
    ) / at.v  # as it was at the last contact, which the first node saw
    for _ in range(MOST_PIECE_PASSES):
        if not (abs(more) < NEAR_CONTACT and time + more > 0.0):
            break
        time += more
        at = move_by_series(lever, at, more)
        _place_nodes(surface, at, 0.0, time, BEFORE_CONTACT, nodes)
        fill_free_flight_at_nodes(lever, at, surface.z0, nodes)
        deepest = fill_attraction(surface.law, surface.p, surface.compliance, nodes)
        kick, change = fill_response(lever, BEFORE_CONTACT, nodes)
        more = (surface.z0 - at.z - kick.z) / (at.v + kick.v)
        change = max(change, abs(at.v * more))
        if change < SETTLED_PATH * surface.reach:
            end = move_by_series(lever, Instant(at.z + kick.z, at.v + kick.v, at.drive), more)
            good = deepest < SETTLED_PATH * surface.reach and last_coefficients(nodes) < ROUGH_FLIGHT * lever.base
            return Piece(good, time + more, end, force_harmonic(0.0, nodes) * at.drive.conjugate())
        if not change < SLOWEST_PASSES * last:
            break
        last = change
    return Piece(False, time, at, complex(0.0, 0.0))


@kernel
def _solve_return(surface: Surface, lever: SprungLever, at: Instant, span: float, rest: float, taps: Taps) -> Piece:
    """Flight from contact until `rest` before the next one, which would end it after `span`.

    From where the tip is farthest, the attraction is that of the next contact.
    """
    half = 0.5 * span
    if not rest < half:
        return _solve_flight(surface, lever, at, 0.0, span - rest, AFTER_CONTACT, taps.leaving)
    out = _solve_flight(surface, lever, at, 0.0, half, AFTER_CONTACT, taps.leaving)
    if not out.good:
        return out
    back = _solve_flight(surface, lever, move_freely(lever, out.end, half), rest, half, BEFORE_CONTACT, taps.back)
    return Piece(back.good, span - rest, back.end, out.push + back.push)


@kernel
def _solve_flight(
    surface: Surface, lever: SprungLever, at: Instant, near: float, far: float, side: float, nodes: PieceNodes
) -> Piece:
    """Flight between two times from a contact where the free lever is `at`: after it, or before it to the near one."""
    last, to = math.inf, far if side == AFTER_CONTACT else -near
    if not has_longrange(surface.p):
        end = move_freely(lever, at, to)
        return Piece(end.z < surface.z0, far - near, end, complex(0.0, 0.0))
    _place_nodes(surface, at, near, far, side, nodes)
    fill_free_flight_at_nodes(lever, at, surface.z0, nodes)
    for _ in range(MOST_PIECE_PASSES):
        deepest = fill_attraction(surface.law, surface.p, surface.compliance, nodes)
        kick, change = fill_response(lever, side, nodes)
        if change < SETTLED_PATH * surface.reach:
            end = move_freely(lever, Instant(at.z + kick.z, at.v + kick.v, at.drive), to)
            good = deepest < 0.0 and end.z < surface.z0 and last_coefficients(nodes) < ROUGH_FLIGHT * lever.base
            return Piece(good, far - near, end, force_harmonic(0.0, nodes) * at.drive.conjugate())
        if not change < SLOWEST_PASSES * last:
            break
        last = change
    return Piece(False, far - near, at, complex(0.0, 0.0))


@kernel
def _solve_contact(surface: Surface, alone: SprungLever, at: Instant, taps: Taps) -> Piece:
    """Motion from the instant of first touch `at` to that of release; times are tau, in 1/omega_c.

    The lever stands on a spring as stiff as most of the contact: what is left of the force changes little with depth.
    """
    law, p, compliance, _, z0 = surface
    m, h, kappa, last = taps.contact, taps.duration, taps.kappa, math.inf
    if not h > 0.0:
        # As the lever would go on, and twice with what that depth makes of it.
        h, kappa = 2.0 * math.atan2(at.v, max(z0, 0.0)), 0.0
        for _ in range(3):
            kappa = SPRING_SHARE * contact_slope(law, at.v * h / math.pi, p) * compliance
            h = 2.0 * math.atan2(at.v * math.sqrt(1.0 + kappa), max(z0, 0.0)) / math.sqrt(1.0 + kappa)
        for j in range(PIECE_NODES):
            m.w[j] = m.w_speed[j] = 0.0
    lever = lever_with_spring(alone.omega, alone.alpha0, alone.base, kappa, z0)
    for i in range(MOST_PIECE_PASSES):
        if not 0.0 < h < LONGEST_TAP:
            break
        place_contact_nodes(h, m)
        fill_free_flight_at_nodes(lever, at, z0, m)
        deepest = fill_contact_force(law, p, compliance, kappa, m)
        kick, change = fill_response(lever, AFTER_CONTACT, m)
        end = move_freely(lever, Instant(at.z + kick.z, at.v + kick.v, at.drive), h)
        more = (z0 - end.z) / end.v
        if not (end.v < 0.0 and abs(more) < 0.5 * h):
            break
        h += more
        change = max(change, abs(end.v * more))
        if change < SETTLED_PATH * deepest:
            end = move_by_series(lever, end, more)
            taps.duration, taps.kappa = h, SPRING_SHARE * contact_slope(law, deepest, p) * compliance
            push = force_harmonic(kappa, m) * at.drive.conjugate()
            return Piece(last_coefficients(m) < ROUGH_TAP * lever.base, h, Instant(z0, end.v, end.drive), push)
        if i > 1 and not change < SLOWEST_PASSES * last:
            break
        last = change
    return Piece(False, h, at, complex(0.0, 0.0))


@kernel
def _fill_first_harmonic(lever: SprungLever, start: Instant, end: Instant, push: complex, acc: PeriodResult) -> None:
    """Fill in the first harmonic of the motion in a period that begins at drive phase 0: theory, Eq. (time-10)."""
    omega, alpha0 = lever.omega, lever.alpha0
    dz, dv = end.z - start.z, end.v - start.v
    left = complex(dv + 2.0 * alpha0 * dz, omega * dz)
    x = (lever.base * math.pi / omega - push - left) / complex(1.0 - omega * omega, 2.0 * alpha0 * omega)
    acc.cos, acc.sin = x.real * omega / math.pi, -x.imag * omega / math.pi
