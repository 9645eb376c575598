"""Errors of phase and tip offset of a converged orbit: one step of Newton's method with every element cut in two.

On elements of half the length the error of Gauss collocation is 2^16 times smaller where it counts, in P, S and z0:
what the step changes there is the error of the orbit: that of the elements, of the last step, and of elements that lie
beside the contacts, for the halves are laid where the contacts are: theory, Eq. (errors-4).

The step itself leaves the square of what its start is wrong by. Between its nodes the orbit is a polynomial of xi, not
of the angle (see `quadrature`): carried over by that polynomial it is about as exact as at the nodes.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.excitation import detected_amplitude_rate, detected_signal, offset_and_factor, sees_tip
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever import drive_needed, phase_of, phase_rate
from phasemap._kernels.numerics import copy
from phasemap._kernels.orbits.collocation.closing import curve_derivative, solve_step
from phasemap._kernels.orbits.collocation.contacts_and_necks import find_contacts
from phasemap._kernels.orbits.collocation.elements import append_element, lay_elements
from phasemap._kernels.orbits.collocation.held_equation import hold_amplitude, hold_parameter
from phasemap._kernels.orbits.collocation.linearised import linearise_orbit
from phasemap._kernels.orbits.collocation.system import (
    RA,
    RIGHT,
    RP,
    RS,
    RZ,
    Head,
    Orbit,
    element_of,
    head_of,
    mode_count,
    new_orbit_of_size,
    no_drift,
    spare_orbit,
)
from phasemap._kernels.orbits.response.state import Along
from phasemap._kernels.quadrature import HALVES, INTO_HALVES, NODES, T_S
from phasemap._kernels.records import assign

# Over the change in the step; of 7,000 orbits drawn at random none was farther off than 1.4 times that.
HALVING_SAFETY = 2.0
LEAST_PHASE_ERROR, LEAST_OFFSET_ERROR = 4e-11, 1e-19  # [rad, m], least error to be expected
# Of the tip offset, in the amplitude: what is rounded where a lever is pressed deep into the surface.
OFFSET_ROUNDING = 2e-13
BESIDE_CONTACTS = 1e-3  # [rad] by which elements may lie beside the contacts and still be the same ones


@kernel(shared=True)
def estimate_errors(oscillator: Oscillator, orbit: Orbit, row: np.ndarray) -> None:
    """Fill in the errors of phase and tip offset in the row of a converged orbit, at its amplitude.

    The slope of its feedback is known already. Errors are NaN where the equations cannot be solved. The orbit stays as
    it is.
    """
    p, lever = oscillator.p, oscillator.lever
    row[col.ERROR_PHASE], row[col.ERROR_HEIGHT] = math.nan, math.nan
    head, kept, other = Head(), head_of(orbit), spare_orbit(orbit)
    assign(head, kept)
    laid = find_contacts(p, orbit) and lay_elements(oscillator, other, orbit, head.level)
    assign(kept, head)
    halves = _cut_elements_in_two(orbit, other if laid and _have_same_elements(orbit, other) else orbit)
    chained = linearise_orbit(oscillator, halves, no_drift())
    if not chained or not solve_step(lever, halves, no_drift(), (hold_amplitude(halves), hold_parameter(halves))):
        return
    solved = halves.system[:, RIGHT]
    phase = phase_of(lever, head.amplitude, solved[RP], solved[RS])
    row[col.ERROR_PHASE] = HALVING_SAFETY * abs(phase - row[col.PHASE]) + LEAST_PHASE_ERROR
    rounded = OFFSET_ROUNDING * abs(head.tip_offset / row[col.SLOPE])
    row[col.ERROR_HEIGHT] = HALVING_SAFETY * abs(solved[RZ] - head.tip_offset) + LEAST_OFFSET_ERROR + rounded


@kernel
def fill_errors_as_seen(lever: np.ndarray, seen: float, along: Along, row: np.ndarray) -> None:
    """Convert errors and feedback slope of an orbit from those at its A to those at the amplitude seen [m]."""
    if sees_tip(lever):
        return
    a, phase, error = row[col.AMPLITUDE], row[col.PHASE], row[col.ERROR_PHASE]
    offset, factor = offset_and_factor(lever)
    # A phase that is off by one is seen off by `turn`, in an amplitude that is off by `grow`.
    part = factor * complex(a * math.cos(phase), a * math.sin(phase))
    share = part / (offset + part)
    turn, grow = share.real, -seen * share.imag
    # As the amplitude seen changes by one: phase seen, and tip offset.
    by_phase, by_offset = (share.imag / a + turn * along.phase) / along.seen, along.offset / along.seen
    missed = abs(detected_signal(lever, a, phase)[0] - seen)
    row[col.ERROR_HEIGHT] += abs(by_offset) * (abs(grow) * error + missed)
    row[col.ERROR_PHASE] = abs(turn - grow * by_phase) * error + abs(by_phase) * missed
    row[col.SLOPE] *= along.seen


@kernel
def slopes_along_curve(lever: np.ndarray, orbit: Orbit) -> Along:
    """Derivatives by A along the curve, at a linearised orbit; NaN where its equations are singular."""
    if not curve_derivative(lever, orbit, no_drift(), (hold_parameter(orbit), hold_amplitude(orbit))):
        return Along(math.nan, math.nan, math.nan)
    head, rate = head_of(orbit), orbit.system[:, RIGHT]
    harmonic, rates = (head.amplitude, head.push, head.drag), (rate[RA], rate[RP], rate[RS])
    (x, y), (by_x, by_y) = drive_needed(lever, *harmonic), drive_needed(lever, *rates)
    return Along(detected_amplitude_rate(lever, harmonic, rates), phase_rate(x, y, by_x, by_y), rate[RZ])


@kernel
def _have_same_elements(orbit: Orbit, places: Orbit) -> bool:
    """True if two orbits have as many elements, at almost the same angles."""
    count = head_of(orbit).count
    if head_of(places).count != count:
        return False
    for e in range(count):
        element, place = element_of(orbit, e), element_of(places, e)
        if element.table != place.table or not abs(element.edge - place.edge) < BESIDE_CONTACTS:
            return False
    return True


@kernel
def _cut_elements_in_two(orbit: Orbit, places: Orbit) -> Orbit:
    """The orbit on elements cut in two, which lie where those of `places` do."""
    count = head_of(orbit).count
    halves = new_orbit_of_size(2 * count, mode_count(orbit), orbit.tables)
    assign(head_of(halves), head_of(orbit))
    head_of(halves).count = 0
    w, u = np.empty(NODES + 2), np.empty(NODES + 2)
    for e in range(count):
        element, following, place = element_of(orbit, e), element_of(orbit, e + 1), element_of(places, e)
        w[0], u[0] = element.edge_w, element.edge_u
        copy(element.w, w[1:])
        copy(element.u, u[1:])
        w[-1], u[-1] = following.edge_w, following.edge_u
        for part in range(2):
            n = HALVES + 2 * place.table + part
            append_element(halves, n, place.side, place.origin, place.scale)
            half = element_of(halves, 2 * e + part)
            half.edge_u = element.edge_u  # asked for where a side begins
            for j in range(NODES):
                at_w, at_u = 0.0, 0.0
                for k in range(NODES + 2):
                    at_w += INTO_HALVES[part * NODES + j, k] * w[k]
                    at_u += INTO_HALVES[part * NODES + j, k] * u[k]
                moved = place.origin - element.origin + (place.scale - element.scale) * orbit.tables[n, T_S, j]
                half.w[j], half.u[j] = at_w + at_u * moved, at_u
    return halves
