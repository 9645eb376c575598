"""Exact orbits near known ones, with their derivatives by the material: what a search goes along in liquid.

A known orbit is kept by its head and elements. Newton's method leads from it to the orbit of another material, and the
equations linearised there, with a property as the parameter that moves, to the derivatives.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.at_detected_amplitude import (
    collocation_orbit_at_detected_amplitude,
    move_to_detected_amplitude,
)
from phasemap._kernels.engagement.by_averaging import engage_by_averaging
from phasemap._kernels.engagement.by_curve import (
    CurveWorkspace,
    new_curve_workspace,
)
from phasemap._kernels.excitation import detected_rates, detected_signal, likely_amplitude
from phasemap._kernels.law import Law, Oscillator, parameters
from phasemap._kernels.numerics import copy
from phasemap._kernels.orbits.averaged.branch import MEASURED_OFFSET, MEASURED_PHASE
from phasemap._kernels.orbits.averaged.sides import ATTRACTIVE, Maximum
from phasemap._kernels.orbits.collocation.closing import curve_derivative
from phasemap._kernels.orbits.collocation.elements import lay_again
from phasemap._kernels.orbits.collocation.held_equation import hold_detected_setpoint, hold_parameter
from phasemap._kernels.orbits.collocation.linearised import linearise_orbit
from phasemap._kernels.orbits.collocation.near import tolerance_of
from phasemap._kernels.orbits.collocation.newton import share_motion
from phasemap._kernels.orbits.collocation.system import (
    DRIFT_STEP,
    ELEMENT_WORDS,
    HEAD_WORDS,
    RA,
    RIGHT,
    RP,
    RS,
    RZ,
    Orbit,
    head_of,
)
from phasemap._kernels.orbits.harmonic_orbit import HarmonicOrbit
from phasemap._kernels.rows.derivatives import Derivatives, Setpoints

MOST_KEPT_ELEMENTS = 40  # of most orbits: few have more
PLACE = HEAD_WORDS + (MOST_KEPT_ELEMENTS + 1) * ELEMENT_WORDS
LAST_CHANGE_BESIDE = 2e-12  # [m], of an orbit; what is left is the square of it over the depth of the contact


@kernel
def store_collocation_orbit(orbit: Orbit, place: np.ndarray) -> None:
    """Store head and elements of an orbit in a place, or NaN if there are more elements than it holds."""
    place[0], last = math.nan, head_of(orbit).count + 1
    if last > len(place[HEAD_WORDS:]) // ELEMENT_WORDS:
        return
    copy(orbit.head[0], place)
    copy(orbit.elements[:last].reshape(-1), place[HEAD_WORDS:])


@kernel
def collocation_orbit_from_stored(
    oscillator: Oscillator, held: float, place: np.ndarray, orbit: Orbit, row: np.ndarray
) -> bool:
    """Exact orbit that the detector sees with amplitude `held` [m], from a stored one; False if none is held."""
    if math.isnan(place[0]):
        return False
    copy(place[:HEAD_WORDS], orbit.head[0])
    last = head_of(orbit).count + 1
    copy(place[HEAD_WORDS : HEAD_WORDS + last * ELEMENT_WORDS], orbit.elements[:last].reshape(-1))
    share_motion(oscillator.lever, orbit)
    return lay_again(oscillator, orbit, 0) and solve_at_held_amplitude(oscillator, held, orbit, row)


@kernel
def solve_at_held_amplitude(oscillator: Oscillator, held: float, orbit: Orbit, row: np.ndarray) -> bool:
    """Solve for the exact orbit seen with the amplitude held [m], from one near it; False where none can be held."""
    tolerance = max(LAST_CHANGE_BESIDE, tolerance_of(oscillator))
    return move_to_detected_amplitude(oscillator, held, tolerance, orbit, row)[0] == col.GOOD


@kernel
def collocation_orbit_from_far(oscillator: Oscillator, held: float, curve: CurveWorkspace, row: np.ndarray) -> bool:
    """Fill `row` with the exact orbit that a tip from far comes to; False where it leaps, or none is found.

    `held`: amplitude [m] that the detector sees.
    """
    top, harmonic = Maximum(), HarmonicOrbit()
    decider = engage_by_averaging(oscillator, likely_amplitude(oscillator.lever, held, ATTRACTIVE), harmonic, top)
    done, _ = collocation_orbit_at_detected_amplitude(oscillator, held, decider, harmonic, top, curve, row)
    return done == col.GOOD


@kernel
def fill_derivatives_by_property(
    oscillator: Oscillator, orbit: Orbit, held: float, moved_parameters: np.ndarray, log_step: float,
    derivatives: np.ndarray,
) -> bool:  # fmt: skip
    """Derivatives of detected phase and tip offset by a property's logarithm, about the orbit at the amplitude held.

    `moved_parameters`: those of the law with the logarithm larger by `log_step`. Moved as far the other way, they are
    the other end of a drift, as of a path's parameter by DRIFT_STEP to either side.
    """
    lever, drift = oscillator.lever, np.empty((2, col.ROW + len(oscillator.lever)))
    for i in range(col.ROW):
        drift[0, i], drift[1, i] = moved_parameters[i], 2.0 * oscillator.p[i] - moved_parameters[i]
    for i in range(len(lever)):
        drift[0, col.ROW + i] = drift[1, col.ROW + i] = lever[i]
    if not linearise_orbit(oscillator, orbit, drift):
        return False
    if not curve_derivative(lever, orbit, drift, (hold_detected_setpoint(lever, orbit, held), hold_parameter(orbit))):
        return False
    head, rate = head_of(orbit), orbit.system[:, RIGHT]
    _, turn = detected_rates(lever, (head.amplitude, head.push, head.drag), (rate[RA], rate[RP], rate[RS]))
    derivatives[MEASURED_PHASE] = turn * DRIFT_STEP / log_step
    derivatives[MEASURED_OFFSET] = rate[RZ] * DRIFT_STEP / log_step
    return True


@kernel
def collocation_block(
    law: Law, rows: np.ndarray, step: float, setpoints: Setpoints, search: bool, tables: np.ndarray, found: Derivatives
) -> None:
    """Fill in phase and tip offset of exact orbits near known ones, as `averaged_block` does of averaged ones.

    `rows` (shape (1 + k, n, ROW)): of the materials, then with each of k logarithms larger by `step`.
    They may be on either branch. Of each material and setpoint `places` keep the orbit to start from, which the orbit
    found replaces; with `search` those that curves lead to are tried where that leads nowhere.
    """
    levers, amplitudes, sides, places = setpoints
    values, slopes, good = found
    curve, row = new_curve_workspace(levers[0], tables), np.zeros(col.COLUMNS)
    orbit = curve.found
    for i in range(rows.shape[1]):
        good[i] = True
        p = parameters(rows[0, i])
        for j in range(len(amplitudes)):
            values[i, j] = 0.0
            slopes[i, j] = 0.0
            if sides[i, j] == 0:
                continue
            oscillator, held = Oscillator(law, p, levers[j]), amplitudes[j]
            good[i] = collocation_orbit_from_stored(oscillator, held, places[i, j], orbit, row) or (
                search and collocation_orbit_from_far(oscillator, held, curve, row)
            )
            if not good[i]:
                break
            store_collocation_orbit(orbit, places[i, j])
            for k in range(len(rows) - 1):
                good[i] = good[i] and fill_derivatives_by_property(
                    oscillator, orbit, held, rows[1 + k, i], step, slopes[i, j, :, k]
                )
            _, values[i, j, MEASURED_PHASE] = detected_signal(levers[j], row[col.AMPLITUDE], row[col.PHASE])
            values[i, j, MEASURED_OFFSET] = row[col.TIP_OFFSET]
