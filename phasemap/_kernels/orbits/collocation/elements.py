"""Where the elements of an orbit lie: laid for its contacts, values carried over."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels.arrays import copy, copy_rows
from phasemap._kernels.columns import DAMPING, LONGRANGE, OMEGA, RELEASE, STIFFNESS
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator, contact_slope, damping
from phasemap._kernels.lever import reach_of
from phasemap._kernels.orbits.collocation.contacts import PERMANENT, TWO_PI, interpolate
from phasemap._kernels.orbits.collocation.system import (
    AT,
    BEND,
    BROKEN,
    CONTACT,
    CONTACTS,
    COS,
    COUNT,
    EDGE,
    EDGE_U,
    EDGE_W,
    ELEMENTS,
    FIRST,
    GAP,
    INSIDE,
    LAST,
    LEVEL,
    LINEAR,
    MOST_CONTACTS,
    NECK,
    ORIGIN,
    OUTSIDE,
    PLACE,
    SCALE,
    SIDE,
    SIN,
    TABLE,
    THETA,
    VALUE,
    Z0,
    A,
    Orbit,
    U,
    W,
)
from phasemap._kernels.quadrature import (
    CONTACT_COUNTS,
    CONTACT_START,
    GRADED_REACH,
    GRADED_START,
    GRADED_WIDTHS,
    NODES,
    T_FIRST,
    T_LAST,
    T_NUMBERS,
    T_S,
)

SLIP = 1e-3  # of half a contact: series to the second order leave less than a billionth of it
LONGEST = 5.0  # [rad] of the contact's own oscillation that an element may span


@kernel
def put(tables: np.ndarray, orbit: Orbit, n: int, side: float, origin: float, scale: float) -> bool:
    """Append one element."""
    e = int(orbit.head[COUNT, ELEMENTS])
    if e + 1 >= len(orbit.elements):
        return False
    one, table = orbit.elements[e], tables[n]
    place = one[PLACE]
    place[TABLE], place[SIDE], place[ORIGIN], place[SCALE] = n, side, origin, scale
    for j in range(NODES):
        theta = origin + scale * table[T_S, j]
        one[THETA, j] = theta
        one[COS, j] = math.cos(theta)
        one[SIN, j] = math.sin(theta)
    place[EDGE] = origin + scale * table[T_NUMBERS, T_FIRST]
    orbit.elements[e + 1, PLACE, EDGE] = origin + scale * table[T_NUMBERS, T_LAST]
    orbit.head[COUNT, ELEMENTS] = e + 1
    return True


@kernel
def _half(
    tables: np.ndarray, orbit: Orbit, side: float, start: float, length: float, scale: float, incoming: int
) -> bool:
    """Graded elements over `length` away from `start` (or towards it), the smallest about as long as `scale`."""
    level = int(orbit.head[COUNT, LEVEL])
    width = GRADED_WIDTHS[level]
    most = int(GRADED_REACH / width)
    count = 2
    if scale > 0.0:
        count = min(max(2, math.ceil(math.asinh(length / scale) / width)), most)
    delta = length / math.sinh(count * width)
    begin = GRADED_START[level, incoming]
    ok = True
    for i in range(count):
        e = count - 1 - i if incoming == 1 else i
        ok = put(tables, orbit, begin + e, side, start, delta) and ok
    return ok


@kernel
def _contact_count(oscillator: Oscillator, amplitude: float, half: float, level: int) -> int:
    """Which of CONTACT_COUNTS resolves a contact of this half length: its angle, its own frequency, its damping."""
    law, p, lever = oscillator
    deepest = 0.5 * amplitude * half * half if half < 2.0 else 2.0 * amplitude
    rate = math.sqrt(1.0 + abs(contact_slope(law, deepest, p)) / lever[STIFFNESS])
    if p[DAMPING] != 0.0:
        rate += damping(law, deepest, p)
    return _pick((2.0 + math.floor(2.0 * half * rate / 5.0) + math.floor(half / 0.8)) * (1.0 + 0.5 * level))


@kernel
def _permanent_count(oscillator: Oscillator, amplitude: float, nearest: float, level: int) -> int:
    """Which of CONTACT_COUNTS resolves a whole period in contact; -1 where graded elements are short enough.

    The longest of these spans most of half a period, too much where the contact's own frequency is high.
    """
    law, p, lever = oscillator
    deepest = nearest + 2.0 * amplitude
    rate = math.sqrt(1.0 + abs(contact_slope(law, deepest, p)) / lever[STIFFNESS])
    if p[DAMPING] != 0.0:
        rate += damping(law, deepest, p)
    turn = TWO_PI * rate / lever[OMEGA]
    if 0.5 * turn * (1.0 - math.exp(-GRADED_WIDTHS[level])) < LONGEST:
        return -1
    return _pick((4.0 + math.floor(turn / LONGEST)) * (1.0 + 0.5 * level))


@kernel
def _neck_count(oscillator: Oscillator, half: float, level: int) -> int:
    """Which of CONTACT_COUNTS resolves a neck of this half length, with the root at its end."""
    law, p, lever = oscillator
    rate = math.sqrt(1.0 + abs(contact_slope(law, 0.5 * p[RELEASE], p)) / lever[STIFFNESS])
    return _pick((3.0 + math.floor(2.0 * half * rate / 5.0) + math.floor(half / 0.8)) * (1.0 + 0.5 * level))


@kernel
def _pick(wanted: float) -> int:
    """The first of CONTACT_COUNTS that is as large."""
    pick = 0
    while pick < len(CONTACT_COUNTS) - 1 and CONTACT_COUNTS[pick] < wanted:
        pick += 1
    return pick


@kernel
def _span(tables: np.ndarray, orbit: Orbit, side: float, start: float, end: float, pick: int) -> bool:
    """Elements between two borders at which the force may start like a root."""
    ok = True
    for e in range(CONTACT_COUNTS[pick]):
        ok = put(tables, orbit, CONTACT_START[pick] + e, side, 0.5 * (start + end), 0.5 * (end - start)) and ok
    return ok


@kernel(shared=True)
def lay(oscillator: Oscillator, tables: np.ndarray, orbit: Orbit, source: Orbit, level: int) -> bool:
    """Lay the elements of `orbit` for the contacts, A and z0 of `source`; False if there are too many."""
    law, p = oscillator.law, oscillator.p
    head = orbit.head
    amplitude = source.head[VALUE, A]
    copy(source.head[VALUE], head[VALUE])
    copy(source.head[COUNT], head[COUNT])
    copy_rows(source.head[CONTACT : CONTACT + MOST_CONTACTS + 1], head[CONTACT:])
    contacts = int(head[COUNT, CONTACTS])
    head[COUNT, LEVEL] = level
    head[COUNT, ELEMENTS], head[COUNT, LINEAR] = 0, 0.0
    reach = reach_of(law, p)
    if contacts <= 0:
        theta, nearest = head[CONTACT, AT], head[CONTACT, GAP]
        side = OUTSIDE if contacts != PERMANENT else INSIDE if nearest > 0.0 else NECK
        pick = _permanent_count(oscillator, amplitude, nearest, level) if side == INSIDE else -1
        if pick >= 0:
            return _span(tables, orbit, INSIDE, theta, theta + TWO_PI, pick)
        scale = math.sqrt(2.0 * (abs(nearest) + (reach if side == OUTSIDE else 0.0)) / amplitude)
        if side == OUTSIDE and p[LONGRANGE] == 0.0:
            scale = 0.0
        return _half(tables, orbit, side, theta, math.pi, scale, 0) and _half(
            tables, orbit, side, theta + TWO_PI, math.pi, scale, 1
        )
    ok = True
    for i in range(contacts):
        start, end, broken = head[CONTACT + i, FIRST], head[CONTACT + i, LAST], head[CONTACT + i, BROKEN]
        following = head[CONTACT + i + 1, FIRST] if i + 1 < contacts else head[CONTACT, FIRST] + TWO_PI
        half = 0.5 * (end - start)
        ok = _span(tables, orbit, INSIDE, start, end, _contact_count(oscillator, amplitude, half, level)) and ok
        if broken > end:
            half = 0.5 * (broken - end)
            ok = _span(tables, orbit, NECK, end, broken, _neck_count(oscillator, half, level)) and ok
        if broken >= following:
            continue
        gap = 0.5 * (following - broken)
        for incoming in range(2):
            at = broken if incoming == 0 else following
            slope = amplitude * abs(math.sin(at))
            root = math.sqrt(slope * slope + 2.0 * amplitude * reach)
            scale = 0.0 if p[LONGRANGE] == 0.0 else 2.0 * reach / (slope + root)
            ok = _half(tables, orbit, OUTSIDE, at, gap, scale, incoming) and ok
    return ok


@kernel(shared=True, vectors=True)
def carry_over(tables: np.ndarray, source: Orbit, orbit: Orbit) -> None:
    """Interpolate w and w' of `source` to the nodes and edges of `orbit`."""
    old, new = source.elements, orbit.elements
    last, count = int(source.head[COUNT, ELEMENTS]), int(orbit.head[COUNT, ELEMENTS])
    begin, at = old[0, PLACE, EDGE], 0
    for e in range(count):
        for k in range(NODES + 1):
            theta = new[e, PLACE, EDGE] if k == 0 else new[e, THETA, k - 1]
            theta -= math.floor((theta - begin) / TWO_PI) * TWO_PI
            if theta < old[at, PLACE, EDGE]:
                at = 0
            while at < last - 1 and theta > old[at + 1, PLACE, EDGE]:
                at += 1
            w, u = interpolate(tables, old, at, theta)
            if k == 0:
                new[e, PLACE, EDGE_W], new[e, PLACE, EDGE_U] = w, u
            else:
                new[e, W, k - 1], new[e, U, k - 1] = w, u
    new[count, PLACE, EDGE_W], new[count, PLACE, EDGE_U] = new[0, PLACE, EDGE_W], new[0, PLACE, EDGE_U]


@kernel(light=True)
def _slip(one: np.ndarray, bend: float, amplitude: float, z0: float) -> float:
    """By what angle the tip touches or leaves after the start of an element; `bend` is w'' there."""
    c, s = math.cos(one[PLACE, EDGE]), math.sin(one[PLACE, EDGE])
    depth, slope = amplitude * c + one[PLACE, EDGE_W] - z0, one[PLACE, EDGE_U] - amplitude * s
    slip = -depth / slope
    return slip - 0.5 * (bend - amplitude * c) * slip * slip / slope


@kernel(shared=True, vectors=True)
def nudge(p: np.ndarray, tables: np.ndarray, orbit: Orbit) -> bool:
    """After a step that hardly moved the contact, move its elements along with it, by series about where they were.

    As `lay` and `carry_over` do, without looking for contacts again. False, and nothing done, where there is no single
    contact, or where it moved by more than SLIP of its half length: then the series would not be exact enough.
    """
    head, elements, count = orbit.head, orbit.elements, int(orbit.head[COUNT, ELEMENTS])
    if head[COUNT, CONTACTS] != 1.0 or p[RELEASE] != 0.0:
        return False
    inner = 0
    while inner < count and elements[inner, PLACE, SIDE] == INSIDE:
        inner += 1
    if inner == 0 or inner == count:
        return False
    amplitude, z0, begin, end = head[VALUE, A], head[VALUE, Z0], elements[0, PLACE, EDGE], elements[inner, PLACE, EDGE]
    entry = _slip(elements[0], elements[0, BEND, 0], amplitude, z0)
    exit_ = _slip(elements[inner], elements[inner - 1, BEND, NODES - 1], amplitude, z0)
    if not max(abs(entry), abs(exit_)) < 0.5 * SLIP * (end - begin):
        return False
    longer = 1.0 + (entry - exit_) / (begin + TWO_PI - end)
    for e in range(count):
        one = elements[e]
        place, table = one[PLACE], tables[int(one[PLACE, TABLE])]
        origin, scale = place[ORIGIN], place[SCALE]
        if e < inner:
            place[ORIGIN] += 0.5 * (entry + exit_)
            place[SCALE] += 0.5 * (exit_ - entry)
        else:
            place[ORIGIN] += exit_ if origin < end + 0.5 * (begin + TWO_PI - end) else entry
            place[SCALE] *= longer
        origin, scale = place[ORIGIN] - origin, place[SCALE] - scale
        for j in range(NODES):
            t = origin + scale * table[T_S, j]
            c, s, bend = one[COS, j], one[SIN, j], one[BEND, j]
            less, sine = 0.5 * t * t * (1.0 - t * t / 12.0), t * (1.0 - t * t / 6.0 * (1.0 - t * t / 20.0))
            one[THETA, j] += t
            one[COS, j], one[SIN, j] = c - c * less - s * sine, s - s * less + c * sine
            one[W, j] += t * (one[U, j] + 0.5 * t * bend)
            one[U, j] += t * bend
        t = origin + scale * table[T_NUMBERS, T_FIRST]
        place[EDGE] += t
        place[EDGE_W] += t * (place[EDGE_U] + 0.5 * t * one[BEND, 0])
        place[EDGE_U] += t * one[BEND, 0]
    last, first = elements[count, PLACE], elements[0, PLACE]
    last[EDGE], last[EDGE_W], last[EDGE_U] = first[EDGE] + TWO_PI, first[EDGE_W], first[EDGE_U]
    head[CONTACT, FIRST], head[CONTACT, LAST] = begin + entry, end + exit_
    head[CONTACT, BROKEN], head[COUNT, LINEAR] = end + exit_, 0.0
    return True
