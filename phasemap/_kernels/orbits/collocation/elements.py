"""Elements of an orbit: where they lie round its contacts, and the motion interpolated from others."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels.columns import DAMPING, OMEGA, RELEASE
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator, contact_slope, damping, has_longrange
from phasemap._kernels.lever import reach_of
from phasemap._kernels.lever_modes import fastest_turn, modes_of
from phasemap._kernels.numerics import copy
from phasemap._kernels.orbits.collocation.contacts_and_necks import (
    PERMANENT,
    TWO_PI,
    find_contacts,
    interpolate_mode,
    motion_in_element,
)
from phasemap._kernels.orbits.collocation.system import (
    EQUATIONS_OTHER,
    IN_CONTACT,
    IN_NECK,
    OUT_OF_CONTACT,
    PLACES,
    Orbit,
    close_ring,
    element_of,
    head_of,
    mode_count,
    motion_of_mode,
    spare_orbit,
)
from phasemap._kernels.quadrature import (
    CONTACT_COUNTS,
    CONTACT_START,
    GRADED_REACH,
    GRADED_START,
    GRADED_WIDTHS,
    NODES,
    STRAIGHT,
    T_FIRST,
    T_LAST,
    T_NUMBERS,
    T_S,
)
from phasemap._kernels.records import assign

FEWEST_IN_CONTACT = 3.0  # elements of a contact
FEWEST_PERMANENT = 16.0  # the same of a period in contact
LONGEST_HALF = 0.8  # [rad] of half a contact, for which there is one more
LONGEST_RINGING = 3.0  # [rad] of a higher mode's oscillation that an element of the widest kind may span
LONGEST_OSCILLATION = 5.0  # [rad] of the contact's own oscillation that an element may span


@kernel
def append_element(orbit: Orbit, n: int, side: int, origin: float, scale: float) -> bool:
    """Append element `n` of the tables to the orbit's mesh; False if there is no room."""
    e = head_of(orbit).count
    if e + 1 >= len(orbit.elements):
        return False
    element, table = element_of(orbit, e), orbit.tables[n]
    element.table, element.side, element.origin, element.scale = n, side, origin, scale
    for j in range(NODES):
        theta = origin + scale * table[T_S, j]
        element.theta[j] = theta
        element.cos[j] = math.cos(theta)
        element.sin[j] = math.sin(theta)
    element.edge = origin + scale * table[T_NUMBERS, T_FIRST]
    element_of(orbit, e + 1).edge = origin + scale * table[T_NUMBERS, T_LAST]
    head_of(orbit).count = e + 1
    return True


@kernel
def _append_equal(orbit: Orbit, side: int, start: float, length: float, longest: float) -> bool:
    """Append elements of equal length, none longer than `longest` [rad]; False if there is no room."""
    count, ok = math.ceil(length / longest), True
    for i in range(count):
        ok = append_element(orbit, STRAIGHT, side, start + length * i / count, length / count) and ok
    return ok


@kernel
def _append_from_contact(
    orbit: Orbit, side: int, start: float, length: float, scale: float, incoming: int, longest: float
) -> bool:
    """Append the elements over `length` [rad] after a contact that ends at `start`, or before one (`incoming`).

    Graded: the smallest, at the contact, is about as long as `scale`; equal where graded ones would be too long.
    """
    graded = length
    if longest < length:
        graded = min(length, longest / (1.0 - math.exp(-GRADED_WIDTHS[head_of(orbit).level]))) if scale > 0.0 else 0.0
    rest, ok = length - graded, True
    if incoming == 1 and rest > 0.0:
        ok = _append_equal(orbit, side, start - length, rest, longest) and ok
    if graded > 0.0:
        ok = _append_graded(orbit, side, start, graded, scale, incoming) and ok
    if incoming == 0 and rest > 0.0:
        ok = _append_equal(orbit, side, start + graded, rest, longest) and ok
    return ok


@kernel
def _append_graded(orbit: Orbit, side: int, start: float, length: float, scale: float, incoming: int) -> bool:
    """Append elements over `length` [rad] whose size grows away from `start`; False if there is no room.

    `scale`: size [rad] of the smallest, which is at `start`; 0 where no force acts.
    `incoming`: 1 before a contact that begins at `start`, 0 after one that ends there.
    """
    level = head_of(orbit).level
    width = GRADED_WIDTHS[level]
    most = int(GRADED_REACH / width)
    count = 1  # where nothing pulls, the motion is known
    if scale > 0.0:
        count = min(max(2, math.ceil(math.asinh(length / scale) / width)), most)
    delta = length / math.sinh(count * width)
    begin = GRADED_START[level, incoming]
    ok = True
    for i in range(count):
        e = count - 1 - i if incoming == 1 else i
        ok = append_element(orbit, begin + e, side, start, delta) and ok
    return ok


@kernel
def longest_flight(lever: np.ndarray, level: int) -> float:
    """Longest element [rad] out of contact: higher modes ring on in it."""
    if modes_of(lever) == 1:
        return math.inf
    return LONGEST_RINGING * GRADED_WIDTHS[level] * lever[OMEGA] / fastest_turn(lever, 0.0)


@kernel
def _rate_at_depth(oscillator: Oscillator, d: float) -> float:
    """Rate [1] of the fastest oscillation of a tip at a depth d, and of its damping there."""
    law, p, lever = oscillator
    rate = fastest_turn(lever, contact_slope(law, d, p))
    return rate + damping(law, d, p) if p[DAMPING] != 0.0 and d > 0.0 else rate


@kernel
def _contact_count(rate: float, half: float, level: int) -> int:
    """Index in CONTACT_COUNTS of the elements that resolve a contact or neck of this half length, and a rate in it."""
    wanted = FEWEST_IN_CONTACT + math.floor(2.0 * half * rate / LONGEST_OSCILLATION) + math.floor(half / LONGEST_HALF)
    return _index_of_count(wanted * (1.0 + 0.5 * level))


@kernel
def _permanent_count(rate: float, level: int) -> int:
    """Index in CONTACT_COUNTS of the elements that resolve a period in contact, and a rate over that of the drive.

    Short elements also keep digits: all else is a small difference against a large constant force.
    """
    wanted = FEWEST_IN_CONTACT + 1.0 + math.floor(TWO_PI * rate / LONGEST_OSCILLATION)
    return _index_of_count(max(FEWEST_PERMANENT, wanted * (1.0 + 0.5 * level)))


@kernel
def _index_of_count(wanted: float) -> int:
    """Index of the first of CONTACT_COUNTS that is at least `wanted`, or of the last."""
    count_index = 0
    while count_index < len(CONTACT_COUNTS) - 1 and CONTACT_COUNTS[count_index] < wanted:
        count_index += 1
    return count_index


@kernel
def _append_contact(orbit: Orbit, side: int, start: float, end: float, count_index: int) -> bool:
    """Append CONTACT_COUNTS[count_index] elements of a contact, at whose two ends the force may start like a root."""
    ok, first = True, CONTACT_START[count_index]
    for e in range(CONTACT_COUNTS[count_index]):
        ok = append_element(orbit, first + e, side, 0.5 * (start + end), 0.5 * (end - start)) and ok
    return ok


@kernel(shared=True)
def lay_elements(oscillator: Oscillator, orbit: Orbit, source: Orbit, level: int) -> bool:
    """Lay the elements of `orbit` for the contacts, A and z0 of `source`; False if there are too many."""
    p, head, longest = oscillator.p, head_of(orbit), longest_flight(oscillator.lever, level)
    amplitude = head_of(source).amplitude
    assign(head, head_of(source))
    contacts = head.contacts
    head.level = level
    head.count, head.equations = 0, EQUATIONS_OTHER
    reach = reach_of(p)
    if contacts <= 0:
        theta, nearest = head.nearest_angle, head.nearest_depth
        side = OUT_OF_CONTACT if contacts != PERMANENT else IN_CONTACT if nearest > 0.0 else IN_NECK
        if side == IN_CONTACT:
            rate = _rate_at_depth(oscillator, nearest + 2.0 * amplitude) / oscillator.lever[OMEGA]
            count_index = _permanent_count(rate, level)
            return _append_contact(orbit, IN_CONTACT, theta, theta + TWO_PI, count_index)
        scale = math.sqrt(2.0 * (abs(nearest) + (reach if side == OUT_OF_CONTACT else 0.0)) / amplitude)
        if side == OUT_OF_CONTACT and not has_longrange(p):
            scale = 0.0
        return _append_from_contact(orbit, side, theta, math.pi, scale, 0, longest) and _append_from_contact(
            orbit, side, theta + TWO_PI, math.pi, scale, 1, longest
        )
    ok = True
    for i in range(contacts):
        start, end, broken = head.contact_start[i], head.contact_end[i], head.neck_end[i]
        following = head.contact_start[i + 1] if i + 1 < contacts else head.contact_start[0] + TWO_PI
        half = 0.5 * (end - start)
        rate = _rate_at_depth(oscillator, 0.5 * amplitude * half * half if half < 2.0 else 2.0 * amplitude)
        ok = _append_contact(orbit, IN_CONTACT, start, end, _contact_count(rate, half, level)) and ok
        if broken > end:
            half = 0.5 * (broken - end)
            rate = _rate_at_depth(oscillator, 0.5 * p[RELEASE])
            ok = _append_contact(orbit, IN_NECK, end, broken, _contact_count(rate, half, level)) and ok
        if broken >= following:
            continue
        gap = 0.5 * (following - broken)
        for incoming in range(2):
            at = broken if incoming == 0 else following
            slope = amplitude * abs(math.sin(at))
            root = math.sqrt(slope * slope + 2.0 * amplitude * reach)
            scale = 0.0 if not has_longrange(p) else 2.0 * reach / (slope + root)
            ok = _append_from_contact(orbit, OUT_OF_CONTACT, at, gap, scale, incoming, longest) and ok
    return ok


@kernel(shared=True, vectors=True)
def interpolate_motion(source: Orbit, orbit: Orbit) -> None:
    """Interpolate the motion of `source` to the nodes and edges of `orbit`."""
    last, count = head_of(source).count, head_of(orbit).count
    several = mode_count(orbit) > 1 and head_of(source).swept == 1  # each mode's own motion is asked for then only
    begin, e_source = element_of(source, 0).edge, 0
    for e in range(count):
        element, motion = element_of(orbit, e), motion_of_mode(orbit, e, 0)
        for k in range(PLACES):
            theta = element.edge if k == NODES else element.theta[k]
            theta -= math.floor((theta - begin) / TWO_PI) * TWO_PI
            if theta < element_of(source, e_source).edge:
                e_source = 0
            while e_source < last - 1 and theta > element_of(source, e_source + 1).edge:
                e_source += 1
            w, u = motion_in_element(source, e_source, theta)
            if k == NODES:
                element.edge_w, element.edge_u = w, u
            else:
                element.w[k], element.u[k] = w, u
            if several:
                for i in range(mode_count(orbit)):
                    to = motion_of_mode(orbit, e, i)
                    to.w[k], to.u[k] = interpolate_mode(source, e_source, theta, i)
            else:
                motion.w[k], motion.u[k] = w, u
    close_ring(orbit)


@kernel(shared=True)
def lay_again(oscillator: Oscillator, orbit: Orbit, level: int) -> bool:
    """Lay the elements anew where the contacts now are, and carry the motion over; False if there are too many."""
    other = spare_orbit(orbit)
    if not find_contacts(oscillator.p, orbit) or not lay_elements(oscillator, other, orbit, level):
        return False
    interpolate_motion(orbit, other)
    assign(head_of(orbit), head_of(other))
    for e in range(head_of(orbit).count + 1):
        assign(element_of(orbit, e), element_of(other, e))
        for i in range(mode_count(orbit)):
            source, target = motion_of_mode(other, e, i), motion_of_mode(orbit, e, i)
            copy(source.w, target.w)
            copy(source.u, target.u)
    return True
