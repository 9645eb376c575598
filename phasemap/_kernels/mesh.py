"""Where the elements of an orbit lie: contact points found on the orbit, elements laid between them, values carried over."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from phasemap._kernels.collocation import A, CONTACTS, ELEMENTS, LEVEL, MOST_CONTACTS, MOST_ELEMENTS, Z0, Orbit
from phasemap._kernels.law import OPTIONS, Law, contact_slope, damping, longrange_force, longrange_slope
from phasemap._kernels.tables import CONTACT_COUNTS, GRADED_REACH, GRADED_WIDTHS, NODES, Tables

TWO_PI = 2 * math.pi
PERMANENT = -1  # orbit.count[CONTACTS] of an orbit that never leaves contact
_COUNTS = np.array(CONTACT_COUNTS)
_WIDTHS = np.array(GRADED_WIDTHS)


@njit(**OPTIONS)
def reach_of(law: Law, p: np.ndarray) -> float:
    """Distance [m] over which the long-range force falls: d0 of an inverse square; 0 without such a force."""
    if p[4] == 0.0:
        return 0.0
    return abs(2.0 * longrange_force(law, 0.0, p) / longrange_slope(law, 0.0, p))


@njit(**OPTIONS)
def interpolate(tables: Tables, orbit: Orbit, e: int, theta: float) -> tuple[float, float]:
    """Return w and w' at an angle inside element e (barycentric interpolation)."""
    n = orbit.table[e]
    x = (theta - orbit.origin[e]) / orbit.scale[e]
    nodes, weights = tables.bary_x[n], tables.bary_w[n]
    below, w, u = 0.0, 0.0, 0.0
    for k in range(NODES + 2):
        if k == 0:
            value_w, value_u = orbit.edge_w[e], orbit.edge_u[e]
        elif k == NODES + 1:
            value_w, value_u = orbit.edge_w[e + 1], orbit.edge_u[e + 1]
        else:
            value_w, value_u = orbit.w[e, k - 1], orbit.u[e, k - 1]
        difference = x - nodes[k]
        if difference == 0.0:
            return value_w, value_u
        share = weights[k] / difference
        below += share
        w += share * value_w
        u += share * value_u
    return w / below, u / below


@njit(**OPTIONS)
def depth(tables: Tables, orbit: Orbit, e: int, theta: float) -> tuple[float, float]:
    """Return d and d' (by the angle) at an angle inside element e."""
    w, u = interpolate(tables, orbit, e, theta)
    amplitude = orbit.value[A]
    return amplitude * math.cos(theta) + w - orbit.value[Z0], u - amplitude * math.sin(theta)


@njit(**OPTIONS)
def _root(tables: Tables, orbit: Orbit, e: int, low: float, d_low: float, high: float, d_high: float) -> float:
    """Angle between low and high where d = 0, by Newton's method kept inside the bracket."""
    theta = low + (high - low) * d_low / (d_low - d_high)
    for _ in range(60):
        d, slope = depth(tables, orbit, e, theta)
        if (d > 0.0) == (d_low > 0.0):
            low = theta
        else:
            high = theta
        step = -d / slope if slope != 0.0 else 0.0
        following = theta + step
        if not (low < following < high):
            following = 0.5 * (low + high)
        if abs(following - theta) < 1e-15 * TWO_PI:
            return following
        theta = following
    return theta


@njit(**OPTIONS)
def _extreme(tables: Tables, orbit: Orbit, e: int, low: float, high: float) -> float:
    """Angle between low and high where d' = 0, by bisection; d' has opposite signs at the ends."""
    sign = depth(tables, orbit, e, low)[1] > 0.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        if (depth(tables, orbit, e, middle)[1] > 0.0) == sign:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@njit(**OPTIONS)
def find_contacts(tables: Tables, orbit: Orbit) -> bool:
    """Find where the tip enters and leaves contact; fills orbit.contact and count. False if there are too many."""
    amplitude, z0 = orbit.value[A], orbit.value[Z0]
    up = np.empty(MOST_CONTACTS + 1)
    down = np.empty(MOST_CONTACTS + 1)
    ups, downs = 0, 0
    theta_before, d_before, slope_before = 0.0, 0.0, 0.0
    d_first, first_inside = 0.0, False
    extreme_theta, extreme_d = 0.0, -1e300
    lowest_theta, lowest_d = 0.0, 1e300
    for e in range(orbit.count[ELEMENTS]):
        for k in range(NODES + 2):
            if k == 0 and e > 0:
                continue
            if k == 0 or k == NODES + 1:
                edge = e if k == 0 else e + 1
                theta = orbit.edge[edge]
                d = amplitude * math.cos(theta) + orbit.edge_w[edge] - z0
                slope = orbit.edge_u[edge] - amplitude * math.sin(theta)
            else:
                theta = orbit.theta[e, k - 1]
                d = amplitude * orbit.cos[e, k - 1] + orbit.w[e, k - 1] - z0
                slope = orbit.u[e, k - 1] - amplitude * orbit.sin[e, k - 1]
            if d > extreme_d:
                extreme_theta, extreme_d = theta, d
            if d < lowest_d:
                lowest_theta, lowest_d = theta, d
            if e == orbit.count[ELEMENTS] - 1 and k == NODES + 1:
                d = d_first  # the same point a period later
            inside = d > 0.0
            if e == 0 and k == 0:
                d_first, first_inside = d, inside
            else:
                was_inside = d_before > 0.0
                middle, d_middle = theta_before, d_before
                split = False
                if inside == was_inside:
                    towards = slope_before < 0.0 if inside else slope_before > 0.0
                    away = slope > 0.0 if inside else slope < 0.0
                    if towards and away:
                        middle = _extreme(tables, orbit, e, theta_before, theta)
                        d_middle = depth(tables, orbit, e, middle)[0]
                        split = (d_middle > 0.0) != inside
                        if not inside and d_middle > extreme_d:
                            extreme_theta, extreme_d = middle, d_middle
                        if inside and d_middle < lowest_d:
                            lowest_theta, lowest_d = middle, d_middle
                if inside != was_inside or split:
                    if max(ups, downs) >= MOST_CONTACTS:
                        return False
                    if split:
                        one = _root(tables, orbit, e, theta_before, d_before, middle, d_middle)
                        two = _root(tables, orbit, e, middle, d_middle, theta, d)
                        if inside:
                            down[downs], up[ups] = one, two
                        else:
                            up[ups], down[downs] = one, two
                        ups += 1
                        downs += 1
                    else:
                        root = _root(tables, orbit, e, theta_before, d_before, theta, d)
                        if inside:
                            up[ups] = root
                            ups += 1
                        else:
                            down[downs] = root
                            downs += 1
            theta_before, d_before, slope_before = theta, d, slope
    if ups == 0:
        orbit.count[CONTACTS] = PERMANENT if first_inside else 0
        orbit.contact[0, 0] = lowest_theta if first_inside else extreme_theta
        orbit.contact[0, 1] = lowest_d if first_inside else extreme_d
        return True
    orbit.count[CONTACTS] = ups
    for i in range(ups):
        if first_inside:  # the contact that contains the start ends first
            orbit.contact[i, 0] = up[i]
            orbit.contact[i, 1] = down[i + 1] if i + 1 < ups else down[0] + TWO_PI
        else:
            orbit.contact[i, 0] = up[i]
            orbit.contact[i, 1] = down[i]
    shift = TWO_PI * math.floor((orbit.contact[0, 0] + math.pi) / TWO_PI)
    for i in range(ups):
        orbit.contact[i, 0] -= shift
        orbit.contact[i, 1] -= shift
    return True


@njit(**OPTIONS)
def _put(tables: Tables, orbit: Orbit, n: int, side: int, origin: float, scale: float) -> bool:
    """Append one element."""
    e = orbit.count[ELEMENTS]
    if e >= MOST_ELEMENTS:
        return False
    orbit.table[e] = n
    orbit.side[e] = side
    orbit.origin[e] = origin
    orbit.scale[e] = scale
    for j in range(NODES):
        theta = origin + scale * tables.s[n, j]
        orbit.theta[e, j] = theta
        orbit.cos[e, j] = math.cos(theta)
        orbit.sin[e, j] = math.sin(theta)
    orbit.edge[e] = origin + scale * tables.first[n]
    orbit.edge[e + 1] = origin + scale * tables.last[n]
    orbit.count[ELEMENTS] = e + 1
    return True


@njit(**OPTIONS)
def _half(tables: Tables, orbit: Orbit, side: int, start: float, length: float, scale: float, incoming: int) -> bool:
    """Graded elements over `length` away from `start` (or towards it), the smallest about as long as `scale`."""
    level = orbit.count[LEVEL]
    width = _WIDTHS[level]
    most = int(GRADED_REACH / width)
    count = 2
    if scale > 0.0:
        count = min(max(2, math.ceil(math.asinh(length / scale) / width)), most)
    delta = length / math.sinh(count * width)
    begin = tables.graded_start[level, incoming]
    ok = True
    for i in range(count):
        e = count - 1 - i if incoming == 1 else i
        ok = _put(tables, orbit, begin + e, side, start, delta) and ok
    return ok


@njit(**OPTIONS)
def lay(
    law: Law, p: np.ndarray, lever: np.ndarray, tables: Tables, orbit: Orbit, source: Orbit, level: int
) -> bool:
    """Lay the elements of `orbit` for the contacts, A and z0 of `source`; False if there are too many."""
    amplitude = source.value[A]
    orbit.value[:] = source.value
    orbit.contact[:] = source.contact
    contacts = source.count[CONTACTS]
    orbit.count[CONTACTS] = contacts
    orbit.count[LEVEL] = level
    orbit.count[ELEMENTS] = 0
    reach = reach_of(law, p)
    if contacts <= 0:
        theta, distance = source.contact[0, 0], abs(source.contact[0, 1])
        side = 1 if contacts == PERMANENT else 0
        scale = math.sqrt(2.0 * (distance + (reach if side == 0 else 0.0)) / amplitude)
        if side == 0 and p[4] == 0.0:
            scale = 0.0
        return _half(tables, orbit, side, theta, math.pi, scale, 0) and _half(
            tables, orbit, side, theta + TWO_PI, math.pi, scale, 1
        )
    ok = True
    for i in range(contacts):
        start, end = source.contact[i, 0], source.contact[i, 1]
        following = source.contact[i + 1, 0] if i + 1 < contacts else source.contact[0, 0] + TWO_PI
        middle, half = 0.5 * (start + end), 0.5 * (end - start)
        deepest = 0.5 * amplitude * half * half if half < 2.0 else 2.0 * amplitude
        rate = math.sqrt(1.0 + contact_slope(law, deepest, p) / lever[2])
        if p[8] != 0.0:
            rate += damping(law, deepest, p)
        wanted = (2.0 + math.floor(2.0 * half * rate / 5.0) + math.floor(half / 0.8)) * (1.0 + 0.5 * level)
        pick = 0
        while pick < len(_COUNTS) - 1 and _COUNTS[pick] < wanted:
            pick += 1
        for e in range(_COUNTS[pick]):
            ok = _put(tables, orbit, tables.contact_start[pick] + e, 1, middle, half) and ok
        gap = 0.5 * (following - end)
        for incoming in range(2):
            at = end if incoming == 0 else following
            slope = amplitude * abs(math.sin(at))
            scale = 0.0 if p[4] == 0.0 else 2.0 * reach / (slope + math.sqrt(slope * slope + 2.0 * amplitude * reach))
            ok = _half(tables, orbit, 0, at, gap, scale, incoming) and ok
    return ok


@njit(**OPTIONS)
def carry_over(tables: Tables, source: Orbit, orbit: Orbit) -> None:
    """Interpolate w and w' of `source` to the nodes and edges of `orbit`."""
    last = source.count[ELEMENTS]
    begin = source.edge[0]
    at = 0
    for e in range(orbit.count[ELEMENTS]):
        for k in range(NODES + 1):
            theta = orbit.edge[e] if k == 0 else orbit.theta[e, k - 1]
            turns = math.floor((theta - begin) / TWO_PI)
            theta -= turns * TWO_PI
            while at > 0 and theta < source.edge[at]:
                at = at - 1 if theta > source.edge[at - 1] or at < 3 else 0
            while at < last - 1 and theta > source.edge[at + 1]:
                at += 1
            w, u = interpolate(tables, source, at, theta)
            if k == 0:
                orbit.edge_w[e], orbit.edge_u[e] = w, u
            else:
                orbit.w[e, k - 1], orbit.u[e, k - 1] = w, u
    orbit.edge_w[orbit.count[ELEMENTS]] = orbit.edge_w[0]
    orbit.edge_u[orbit.count[ELEMENTS]] = orbit.edge_u[0]
