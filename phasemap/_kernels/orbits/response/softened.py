"""Newton's method on the response from a softer surface, step by step to the one that is asked for.

Where a stiff contact throws a lever of several modes back, a tap sets off motion in higher modes that brings the tip
back within the tap, and no harmonic orbit is near. A lever that is stiffer by a factor meets a surface that is softer
by the same: from there the orbit is followed as the factor falls to one.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels.columns import LONGRANGE, STIFFNESS
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever import modes_of
from phasemap._kernels.orbits.response.newton import Bench, cut_contact, newton_on_response
from phasemap._kernels.orbits.response.nodes import MOST_PARTS, Nodes, parts_of
from phasemap._kernels.orbits.response.passes import FOUND, NO_ORBIT, UNRESOLVED, PassState, start_passes
from phasemap._kernels.records import assign, record

SOFTEST = 10.0  # factor to begin with
LARGEST_RATIO, LEAST_RATIO = 2.0, 1.15  # of a factor to the next
MOST_SOFTENED = 16  # surfaces
ON_THE_WAY = 3000.0  # times the limits of what is asked for, that are enough before


@record
class Before:
    """The last orbit that was found on the way."""

    nodes: Nodes
    state: PassState


@kernel
def most_parts(lever: np.ndarray) -> int:
    """Into how many elements a contact may be cut."""
    return 2 if modes_of(lever) == 1 else MOST_PARTS


@kernel
def resolve(oscillator: Oscillator, reach: float, limits: np.ndarray, bench: Bench, other: Bench) -> tuple[int, bool]:
    """Newton's method with the contact cut as far as needed; how it ended, and whether its orbit is in `other`."""
    found, swapped = newton_on_response(oscillator, reach, limits, bench), False
    while found == UNRESOLVED and 2 * parts_of(bench.nodes) <= most_parts(oscillator.lever):
        cut_contact(bench.nodes, other.nodes, oscillator.p[LONGRANGE] != 0.0)
        assign(other.state, bench.state)
        bench, other, swapped = other, bench, not swapped
        found = newton_on_response(oscillator, reach, limits, bench)
    return found, swapped


@kernel
def newton_from_softer(
    oscillator: Oscillator, reach: float, limits: np.ndarray, bench: Bench, other: Bench, before: Before
) -> tuple[int, bool]:
    """Find the orbit of the amplitude in the state of `bench`, whose centre e and slope are those of a harmonic orbit.

    Returns what `resolve` does.
    """
    law, p, lever = oscillator
    softened, rough = lever.copy(), ON_THE_WAY * limits
    factor, ratio, state, found, swapped = SOFTEST, LARGEST_RATIO, bench.state, NO_ORBIT, False
    held = factor
    state.centre = state.amplitude - (state.amplitude - state.centre) * math.sqrt(factor)
    softened[STIFFNESS] = factor * lever[STIFFNESS]
    if not start_passes(Oscillator(law, p, softened), reach, bench.nodes, state):
        return NO_ORBIT, False
    for step in range(MOST_SOFTENED):
        softened[STIFFNESS] = factor * lever[STIFFNESS]
        found, turned = resolve(Oscillator(law, p, softened), reach, rough if factor > 1.0 else limits, bench, other)
        if turned:
            bench, other, swapped = other, bench, not swapped
        if found == FOUND and factor == 1.0:
            break
        if found == FOUND:
            assign(before.nodes, bench.nodes)
            assign(before.state, bench.state)
            held = factor
        elif step == 0 or ratio * ratio < LEAST_RATIO:
            return NO_ORBIT, swapped
        else:
            ratio = math.sqrt(ratio)
            assign(bench.nodes, before.nodes)
            assign(bench.state, before.state)
        factor = max(held / ratio, 1.0)
    return found, swapped
