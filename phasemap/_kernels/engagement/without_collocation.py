"""Exact orbits without collocation: by averaging, then by the lever's response, each handed on where it is in doubt.

Where averaging leaves the side open, the maximum of the mismatch is sought again with the lever's response in it
(`end_of_attractive_branch`), and what that leaves open is for the curve of exact orbits.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.columns import GOOD, KNOWN, NOT_CONVERGED, PENDING, ErrorLimits
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.branch_by_averaging import (
    SURE,
    UNDECIDED,
    fill_setpoint_orbit_on_side,
    worst_amplitude,
)
from phasemap._kernels.engagement.end_of_attractive_branch import decide_exactly, fill_orbit_outside_maximum
from phasemap._kernels.engagement.rebound import rebounds
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever import phase_of
from phasemap._kernels.orbits.averaged.sides import REPULSIVE, UNCLEAR
from phasemap._kernels.orbits.harmonic_orbit import HarmonicOrbit, fill_row_from_harmonic
from phasemap._kernels.orbits.response.nodes import Nodes
from phasemap._kernels.orbits.response.orbit import ResponseWorkspace, grazes, refine, slope_is_clear
from phasemap._kernels.orbits.response.state import PassState, fill_row_from_passes


@kernel(shared=True)
def orbit_without_collocation(
    oscillator: Oscillator, amplitude: float, surety: int, limits: ErrorLimits, harmonic: HarmonicOrbit,
    workspace: ResponseWorkspace,
) -> int:  # fmt: skip
    """Solve by averaging and the lever's response; returns how far that led.

    * GOOD: the exact orbit is in `workspace.state`
    * KNOWN: only the averaged one in `harmonic` is sure
    * PENDING: the side of the resonance is in doubt
    * NOT_CONVERGED: only time tells
    """
    if surety == SURE:
        if refine(oscillator, harmonic, limits, workspace):
            return GOOD
        return PENDING if grazes(oscillator.p, harmonic) else KNOWN
    if surety != UNDECIDED:
        return PENDING
    worst = worst_amplitude(oscillator.lever, amplitude)
    side = decide_exactly(oscillator, amplitude, worst, workspace)
    if side == UNCLEAR:
        return PENDING
    known = fill_setpoint_orbit_on_side(oscillator, amplitude, side, workspace.top, harmonic)
    if side == REPULSIVE:
        if not known:
            return PENDING
        if rebounds(oscillator, harmonic.push):
            return NOT_CONVERGED
        return GOOD if refine(oscillator, harmonic, limits, workspace) else KNOWN
    if known and refine(oscillator, harmonic, limits, workspace) and slope_is_clear(oscillator, limits, workspace):
        return GOOD
    if not fill_orbit_outside_maximum(oscillator, amplitude, harmonic, workspace):
        return PENDING
    if not (refine(oscillator, harmonic, limits, workspace) and slope_is_clear(oscillator, limits, workspace)):
        return KNOWN
    harmonic.tip_offset = math.nan  # no averaged orbit, which could stand for this one
    return GOOD


@kernel
def averaging_suffices(
    lever: np.ndarray, harmonic: HarmonicOrbit, state: PassState, limits: ErrorLimits, row: np.ndarray
) -> bool:
    """Whether the averaged orbit is within `limits` of the exact one; then fills its row."""
    phase_error = (
        abs(phase_of(lever, harmonic.amplitude, harmonic.push, harmonic.drag) - state.phase) + state.phase_error
    )
    height_error = abs(harmonic.tip_offset - state.tip_offset) + state.tip_offset_error
    if not (phase_error < limits.phase and height_error < limits.tip_offset):
        return False
    fill_row_from_harmonic(lever, harmonic, row)
    row[col.ERROR_PHASE], row[col.ERROR_HEIGHT] = phase_error, height_error
    return True


@kernel
def choose(
    lever: np.ndarray, harmonic: HarmonicOrbit, nodes: Nodes, state: PassState, average: bool, limits: ErrorLimits,
    row: np.ndarray,
) -> int:  # fmt: skip
    """Fill a row with the averaged orbit if it may stand and suffices, else with the exact one; returns the solver."""
    if average and averaging_suffices(lever, harmonic, state, limits, row):
        return col.AVERAGING
    fill_row_from_passes(lever, nodes, state, row)
    return col.CORRECTED
