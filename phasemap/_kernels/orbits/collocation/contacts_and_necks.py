"""Motion between the nodes of an orbit, and the angles at which its contacts begin and end."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels.columns import RELEASE
from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.law import has_hysteresis
from phasemap._kernels.numerics import newton_in_bracket
from phasemap._kernels.orbits.collocation.system import MOST_CONTACTS, Head, Orbit, element_of, head_of, motion_of_mode
from phasemap._kernels.quadrature import NODES, T_BARY, T_BARY_FIRST, T_BARY_LAST, T_FIRST, T_LAST, T_NUMBERS, T_S
from phasemap._kernels.records import column, record

TWO_PI = 2 * math.pi
PERMANENT = -1  # contacts of an orbit that never leaves contact
MOST_BORDER_STEPS = 60  # of Newton's method to where the depth passes a border, bisections among them
SAME_ANGLE = 1e-15 * TWO_PI  # [rad], last of these steps: rounding
EXTREME_HALVINGS = 40  # of the bracket of an extreme, to 1e-12 of it


@kernel(fastmath=ANY_ORDER, inline=True)
def _between_nodes(
    table: np.ndarray, x: float, w: np.ndarray, u: np.ndarray, first: tuple[float, float], last: tuple[float, float]
) -> tuple[float, float]:
    """Return w and w' at a place in an element, from those at its nodes and ends (barycentric interpolation)."""
    before, after = x - table[T_NUMBERS, T_FIRST], x - table[T_NUMBERS, T_LAST]
    if before == 0.0:
        return first
    if after == 0.0:
        return last
    share, other = table[T_NUMBERS, T_BARY_FIRST] / before, table[T_NUMBERS, T_BARY_LAST] / after
    below = share + other
    w_sum = share * first[0] + other * last[0]
    u_sum = share * first[1] + other * last[1]
    for k in range(NODES):
        share = table[T_BARY, k] / (x - table[T_S, k])
        below += share
        w_sum += share * w[k]
        u_sum += share * u[k]
    if not abs(below) < math.inf:  # at a node
        for k in range(NODES):
            if x == table[T_S, k]:
                return w[k], u[k]
    return w_sum / below, u_sum / below


@kernel(fastmath=ANY_ORDER)
def motion_in_element(orbit: Orbit, e: int, theta: float) -> tuple[float, float]:
    """Return w and w' at an angle inside element e."""
    element, following = element_of(orbit, e), element_of(orbit, e + 1)
    first, last = (element.edge_w, element.edge_u), (following.edge_w, following.edge_u)
    return _between_nodes(
        orbit.tables[element.table], (theta - element.origin) / element.scale, element.w, element.u, first, last
    )


@kernel(fastmath=ANY_ORDER)
def interpolate_mode(orbit: Orbit, e: int, theta: float, i: int) -> tuple[float, float]:
    """Return w and w' of mode i at an angle inside element e."""
    element, motion, following = element_of(orbit, e), motion_of_mode(orbit, e, i), motion_of_mode(orbit, e + 1, i)
    first, last = (motion.w[NODES], motion.u[NODES]), (following.w[NODES], following.u[NODES])
    return _between_nodes(
        orbit.tables[element.table], (theta - element.origin) / element.scale, motion.w, motion.u, first, last
    )


@kernel
def depth_at(orbit: Orbit, e: int, theta: float) -> tuple[float, float]:
    """Return d and d' (by the angle) at an angle inside element e."""
    w, u = motion_in_element(orbit, e, theta)
    amplitude = head_of(orbit).amplitude
    return amplitude * math.cos(theta) + w - head_of(orbit).tip_offset, u - amplitude * math.sin(theta)


@kernel
def _angle_at_depth(orbit: Orbit, e: int, border: float, low: float, d_low: float, high: float, d_high: float) -> float:
    """Angle between low and high where d passes `border`, by Newton's method kept inside the bracket."""
    theta = low + (high - low) * d_low / (d_low - d_high)
    for _ in range(MOST_BORDER_STEPS):
        d, slope = depth_at(orbit, e, theta)
        before = theta
        theta, low, high = newton_in_bracket(theta, d - border, slope, low, high, d_high > 0.0)
        if abs(theta - before) < SAME_ANGLE:
            break
    return theta


@kernel
def _angle_of_extreme(orbit: Orbit, e: int, low: float, high: float) -> float:
    """Angle between low and high where d' = 0, by bisection; d' has opposite signs at the ends."""
    sign = depth_at(orbit, e, low)[1] > 0.0
    for _ in range(EXTREME_HALVINGS):
        middle = 0.5 * (low + high)
        if (depth_at(orbit, e, middle)[1] > 0.0) == sign:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@kernel(shared=True, vectors=True)
def find_contacts(p: np.ndarray, orbit: Orbit) -> bool:
    """Find where the tip enters and leaves contact; fills their angles in the head. False if there are too many.

    Without contact, or in permanent contact: the angle where the tip is nearest to the other side.
    """
    held = times_left(head_of(orbit)) == PERMANENT  # in a neck, it depends on where the tip came from
    if not _find_crossings(orbit):
        return False
    contacts = head_of(orbit).contacts
    if not has_hysteresis(p):
        for i in range(contacts):
            head_of(orbit).neck_end[i] = head_of(orbit).contact_end[i]
    elif contacts > 0:
        _find_neck_breaks(p, orbit)
    elif held and contacts == 0 and _least_depth(orbit) > p[RELEASE]:
        head_of(orbit).contacts = PERMANENT
    return True


@kernel
def times_left(head: Head) -> int:
    """How often the tip leaves contact in a period, necks included; 0 where it never touches, PERMANENT if it stays."""
    if head.contacts <= 0:
        return head.contacts
    left = 0
    for i in range(head.contacts):
        following = head.contact_start[i + 1] if i + 1 < head.contacts else head.contact_start[0] + TWO_PI
        left += 1 if head.neck_end[i] < following else 0
    return left if left > 0 else PERMANENT


@kernel
def is_grazing(p: np.ndarray, orbit: Orbit, within: float) -> bool:
    """True if the tip turns back as near to where contact is made or lost as `within` [m]."""
    theta_before, _, slope_first = _point_of(orbit, 0, 0)
    slope_before, count = slope_first, head_of(orbit).count
    for i in range(1, count * (NODES + 1) + 1):
        e = (i - 1) // (NODES + 1)
        theta, _, slope = _point_of(orbit, e, i - e * (NODES + 1))
        if i == count * (NODES + 1):
            slope = slope_first  # the same point a period later
        if slope_before * slope <= 0.0 and theta > theta_before:
            d = depth_at(orbit, e, _angle_of_extreme(orbit, e, theta_before, theta))[0]
            if min(abs(d), abs(d - p[RELEASE])) < within:
                return True
        theta_before, slope_before = theta, slope
    return False


@kernel
def _least_depth(orbit: Orbit) -> float:
    """Smallest depth at the nodes [m]."""
    lowest = math.inf
    amplitude, z0 = head_of(orbit).amplitude, head_of(orbit).tip_offset
    for e in range(head_of(orbit).count):
        element = element_of(orbit, e)
        for j in range(NODES):
            lowest = min(lowest, amplitude * element.cos[j] + element.w[j] - z0)
    return lowest


@kernel
def _find_neck_breaks(p: np.ndarray, orbit: Orbit) -> None:
    """Fill in the angle where the neck of each contact breaks; the start of the next contact where it does not."""
    head = head_of(orbit)
    contacts, count = head.contacts, head.count
    begin = element_of(orbit, 0).edge
    for i in range(contacts):
        end = head.contact_end[i]
        following = head.contact_start[i + 1] if i + 1 < contacts else head.contact_start[0] + TWO_PI
        head.neck_end[i] = following
        # Elements from the one that holds `end` on, round the period.
        at = end - TWO_PI * math.floor((end - begin) / TWO_PI)
        e = 0
        while e < count - 1 and element_of(orbit, e + 1).edge <= at:
            e += 1
        turn, before, d_before = end - at, at, -p[RELEASE]
        for _ in range(count + 1):
            broken = False
            for k in range(NODES + 1):
                theta = element_of(orbit, e + 1).edge if k == NODES else element_of(orbit, e).theta[k]
                if theta <= before:
                    continue
                if theta + turn >= following:
                    break
                d, slope = depth_at(orbit, e, theta)
                d -= p[RELEASE]
                if d > 0.0 and slope > 0.0 and depth_at(orbit, e, before)[1] < 0.0:
                    lowest = _angle_of_extreme(orbit, e, before, theta)  # it may break between two nodes
                    d_lowest = depth_at(orbit, e, lowest)[0] - p[RELEASE]
                    if d_lowest <= 0.0:
                        theta, d = lowest, d_lowest
                if d <= 0.0:
                    head.neck_end[i] = turn + _angle_at_depth(orbit, e, p[RELEASE], before, d_before, theta, d)
                    broken = True
                    break
                before, d_before = theta, d
            e += 1
            if broken or before + turn >= following:
                break
            if e == count:
                e, turn, before = 0, turn + TWO_PI, begin


@record
class Crossings:
    """Angles [rad] at which d rises and falls through 0 in a period."""

    ups: int
    downs: int
    up: np.ndarray = column(MOST_CONTACTS + 1)
    down: np.ndarray = column(MOST_CONTACTS + 1)


@kernel
def _add_crossing(crossings: Crossings, rising: bool, angle: float) -> None:
    """Add an angle at which d passes 0."""
    if rising:
        crossings.up[crossings.ups] = angle
        crossings.ups += 1
    else:
        crossings.down[crossings.downs] = angle
        crossings.downs += 1


@kernel
def _point_of(orbit: Orbit, e: int, k: int) -> tuple[float, float, float]:
    """Return the angle, d and d' at point k of an element: its start, its nodes, its end."""
    head = head_of(orbit)
    if k == 0 or k == NODES + 1:
        begins = element_of(orbit, e if k == 0 else e + 1)
        c, s = math.cos(begins.edge), math.sin(begins.edge)
        return begins.edge, head.amplitude * c + begins.edge_w - head.tip_offset, begins.edge_u - head.amplitude * s
    element, j = element_of(orbit, e), k - 1
    return (
        element.theta[j],
        head.amplitude * element.cos[j] + element.w[j] - head.tip_offset,
        element.u[j] - head.amplitude * element.sin[j],
    )


@kernel
def _find_crossings(orbit: Orbit) -> bool:
    """Find where d rises and falls through 0; fills their angles in the head. False if there are too many."""
    head, crossings = head_of(orbit), Crossings()
    theta_before, d_before, slope_before = _point_of(orbit, 0, 0)
    d_first, first_inside = d_before, d_before > 0.0
    extreme_theta, extreme_d, lowest_theta, lowest_d = theta_before, d_before, theta_before, d_before
    for i in range(head.count * (NODES + 1)):
        e, k = i // (NODES + 1), 1 + i % (NODES + 1)
        theta, d, slope = _point_of(orbit, e, k)
        if d > extreme_d:
            extreme_theta, extreme_d = theta, d
        if d < lowest_d:
            lowest_theta, lowest_d = theta, d
        if e == head.count - 1 and k == NODES + 1:
            d = d_first  # the same point a period later
        inside, was_inside = d > 0.0, d_before > 0.0
        middle, d_middle = theta_before, d_before
        towards = -1.0 if inside else 1.0
        if inside == was_inside and towards * slope_before > 0.0 and towards * slope < 0.0:
            middle = _angle_of_extreme(orbit, e, theta_before, theta)
            d_middle = depth_at(orbit, e, middle)[0]
            if not inside and d_middle > extreme_d:
                extreme_theta, extreme_d = middle, d_middle
            if inside and d_middle < lowest_d:
                lowest_theta, lowest_d = middle, d_middle
        twice = inside == was_inside and (d_middle > 0.0) != inside
        if twice or inside != was_inside:
            if max(crossings.ups, crossings.downs) >= MOST_CONTACTS:
                return False
            if twice:
                angle = _angle_at_depth(orbit, e, 0.0, theta_before, d_before, middle, d_middle)
                _add_crossing(crossings, not inside, angle)
            _add_crossing(crossings, inside, _angle_at_depth(orbit, e, 0.0, middle, d_middle, theta, d))
        theta_before, d_before, slope_before = theta, d, slope
    if crossings.ups == 0:
        head.contacts = PERMANENT if first_inside else 0
        head.nearest_angle = lowest_theta if first_inside else extreme_theta
        head.nearest_depth = lowest_d if first_inside else extreme_d
    else:
        _set_contacts(head, crossings, first_inside)
    return True


@kernel
def _set_contacts(head: Head, crossings: Crossings, first_inside: bool) -> None:
    """Fill in where contacts begin and end, the first in [-pi, pi); the one that contains the start ends first."""
    head.contacts = crossings.ups
    shift = TWO_PI * math.floor((crossings.up[0] + math.pi) / TWO_PI)
    for i in range(crossings.ups):
        end = crossings.down[i]
        if first_inside:
            end = crossings.down[i + 1] if i + 1 < crossings.ups else crossings.down[0] + TWO_PI
        head.contact_start[i], head.contact_end[i] = crossings.up[i] - shift, end - shift
