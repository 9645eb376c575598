"""Orbits that the detector sees with a given amplitude, where it does not see the motion of the tip itself.

What A is follows from the phase. Passes and collocation hold what is seen itself, from the A of an orbit without losses
on. Which branch the tip is on is asked there, and again at the A that is found. Elsewhere the curve of exact orbits is
followed down to the amplitude that is seen.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.columns import ErrorLimits
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.by_averaging import BY_AVERAGING, BY_CURVE, IN_TIME, engage_by_averaging
from phasemap._kernels.engagement.by_curve import (
    CurveWorkspace,
    detected_amplitude_wanted,
    engaged_collocation_orbit,
)
from phasemap._kernels.engagement.by_fold import orbit_by_response
from phasemap._kernels.excitation import (
    LEAST_SLOPE,
    likely_amplitude,
    sees_tip,
)
from phasemap._kernels.law import Oscillator
from phasemap._kernels.orbits.averaged.sides import ATTRACTIVE, REPULSIVE, Maximum
from phasemap._kernels.orbits.collocation.errors import slopes_along_curve
from phasemap._kernels.orbits.collocation.near import refine_orbit, tolerance_of
from phasemap._kernels.orbits.collocation.newton import solve_at_detected_amplitude
from phasemap._kernels.orbits.collocation.system import (
    Orbit,
    head_of,
)
from phasemap._kernels.orbits.harmonic_orbit import HarmonicOrbit
from phasemap._kernels.orbits.response.orbit_at_setpoint import ResponseWorkspace
from phasemap._kernels.orbits.response.state import Along
from phasemap._kernels.orbits.result_row import feedback_status


@kernel
def engaged_orbit_by_response(
    oscillator: Oscillator, amplitude: float, limits: ErrorLimits, harmonic: HarmonicOrbit, workspace: ResponseWorkspace
) -> bool:
    """Orbit by `orbit_by_response` on which a tip from far stops where the detector sees an amplitude [m].

    Where that is not the tip's amplitude A, averaging has to be sure of the branch again at the A that is found.
    """
    lever, top, state = oscillator.lever, workspace.top, workspace.state
    workspace.seen = 0.0 if sees_tip(lever) else amplitude
    for side in (ATTRACTIVE, REPULSIVE):
        likely = likely_amplitude(lever, amplitude, side)
        decider = engage_by_averaging(oscillator, likely, harmonic, top)
        done = orbit_by_response(oscillator, likely, decider, limits, harmonic, workspace)
        if sees_tip(lever):
            return done
        if done and engage_by_averaging(oscillator, state.amplitude, harmonic, top) == BY_AVERAGING:
            if (harmonic.push > 0.0) == (state.push > 0.0):
                return True
    return False


@kernel
def move_to_detected_amplitude(
    oscillator: Oscillator, seen: float, tolerance: float, orbit: Orbit, row: np.ndarray
) -> tuple[int, Along]:
    """Move an exact orbit to where the detector sees an amplitude [m]; fill in its row, return a status and its slopes.

    `tolerance`: its last change [m].
    """
    done, along = solve_at_detected_amplitude(oscillator, orbit, seen, tolerance), Along(math.nan, math.nan, math.nan)
    if done == col.GOOD:
        done = refine_orbit(oscillator, orbit, row)
    if done == col.GOOD:
        done, along = feedback_status(row), slopes_along_curve(oscillator.lever, orbit)
        if done == col.GOOD and not along.seen > LEAST_SLOPE:
            done = col.NOT_CONVERGED  # the amplitude that is seen turns here
    return done, along


@kernel
def collocation_orbit_at_detected_amplitude(
    oscillator: Oscillator, seen: float, decider: int, harmonic: HarmonicOrbit, top: Maximum, curve: CurveWorkspace,
    row: np.ndarray,
) -> tuple[int, Along]:  # fmt: skip
    """Orbit on which a tip from far stops where the detector sees an amplitude [m], by the curve: a status, and slopes.

    From the averaged orbit if averaging is as sure of the branch at the amplitude that the tip then has.
    """
    wanted, orbit, along = detected_amplitude_wanted(oscillator, seen), curve.found, Along(math.nan, math.nan, math.nan)
    if sees_tip(oscillator.lever):
        return engaged_collocation_orbit(oscillator, wanted, decider, harmonic, curve, row), along
    done = col.NOT_CONVERGED
    for decides in (decider, BY_CURVE):
        done = engaged_collocation_orbit(oscillator, wanted, decides, harmonic, curve, row)
        if done == col.GOOD:
            done, along = move_to_detected_amplitude(oscillator, seen, tolerance_of(oscillator), orbit, row)
        if done == col.GOOD:
            decider_there = engage_by_averaging(oscillator, head_of(orbit).amplitude, harmonic, top)
            if decider_there == BY_AVERAGING and (row[col.STIFFENING] > 0.0) == (harmonic.push > 0.0):
                break
            if decider_there == IN_TIME:
                done = col.NOT_CONVERGED
        if decides != BY_AVERAGING:
            break
    return done, along
