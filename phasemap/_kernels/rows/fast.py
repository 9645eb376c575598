"""Loops over pixels for what is cheap: averaged orbits, and orbits corrected by the lever's response.

Each loop works on a slice and can run in a thread of its own (nogil). Pixels that these methods cannot decide or not
solve well enough are left PENDING: for collocation, which is compiled only where there are some.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.columns import ErrorLimits
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.branch_by_averaging import SURE, engage_by_averaging
from phasemap._kernels.engagement.detected_setpoint import DetectedWorkspace, branch_orbit_at_detected_amplitude
from phasemap._kernels.engagement.other_branch import refined_orbit_on_branch
from phasemap._kernels.engagement.without_collocation import choose, orbit_without_collocation
from phasemap._kernels.orbits.averaged.branch import held_root
from phasemap._kernels.orbits.averaged.harmonics import harmonics
from phasemap._kernels.orbits.averaged.sides import ATTRACTIVE, REPULSIVE, Maximum
from phasemap._kernels.orbits.harmonic_orbit import (
    HarmonicOrbit,
    fill_harmonic_orbit,
    fill_row_from_harmonic,
    store_harmonic_orbit,
)
from phasemap._kernels.orbits.orbit_nodes import FAINT_DRIVE, OrbitNodes, keep_nodes, nodes_from_response
from phasemap._kernels.orbits.response.orbit import ResponseWorkspace, nodes_of_solution
from phasemap._kernels.rows.answers import Answers, Pixels, oscillator_of


@kernel
def cheap_rows(pixels: Pixels, limits: ErrorLimits, average: bool, answers: Answers) -> int:
    """Orbit of every row after engagement, where the cheap path is good enough; returns how many wait.

    With `average` an averaged orbit may stand. Rows that wait hold their averaged orbit where it is known. Rows with
    room keep the nodes of the orbit (`orbit_nodes`).
    """
    (out, status, solver), lever = answers, pixels.lever
    workspace, at, harmonic, waiting = ResponseWorkspace(), OrbitNodes(), HarmonicOrbit(), 0
    for i in range(len(out)):
        oscillator, amplitude, row = oscillator_of(pixels, i), pixels.amplitudes[i], out[i][: col.COLUMNS]
        row[:] = math.nan
        surety = engage_by_averaging(oscillator, amplitude, harmonic, workspace.top)
        status[i] = orbit_without_collocation(oscillator, amplitude, surety, limits, harmonic, workspace)
        if status[i] != col.GOOD:
            waiting += 1
            if status[i] == col.KNOWN:
                store_harmonic_orbit(harmonic, row)
                status[i] = col.PENDING
        else:
            solver[i] = choose(lever, harmonic, nodes_of_solution(workspace), workspace.state, average, limits, row)
            if out.shape[1] > col.COLUMNS:
                if solver[i] == col.CORRECTED and lever[col.DRIVE] < FAINT_DRIVE * amplitude:
                    f = nodes_of_solution(workspace)
                    nodes_from_response(f, amplitude, workspace.state.centre, at)
                    keep_nodes(at, out[i])
    return waiting


@kernel
def averaging_rows(pixels: Pixels, answers: Answers) -> int:
    """First-order averaged orbit of every row where averaging decides; returns how many wait."""
    out, status, solver = answers
    harmonic, top, waiting = HarmonicOrbit(), Maximum(), 0
    for i in range(len(out)):
        out[i] = math.nan
        solver[i] = col.AVERAGING
        if engage_by_averaging(oscillator_of(pixels, i), pixels.amplitudes[i], harmonic, top) == SURE:
            status[i] = col.GOOD
            fill_row_from_harmonic(pixels.lever, harmonic, out[i])
        else:
            status[i] = col.PENDING
            waiting += 1
    return waiting


@kernel
def averaged_near_rows(pixels: Pixels, answers: Answers) -> None:
    """Replace exact orbits, which told the branch, by the averaged ones next to them."""
    out, status, solver = answers
    harmonic = HarmonicOrbit()
    for i in range(len(out)):
        if status[i] == col.GOOD and solver[i] != col.AVERAGING:
            oscillator, row = oscillator_of(pixels, i), out[i]
            side, amplitude = REPULSIVE if row[col.STIFFENING] > 0.0 else ATTRACTIVE, row[col.AMPLITUDE]
            near = amplitude, (row[col.TIP_OFFSET] - row[col.MEAN]) / amplitude
            amplitude, c, slope = held_root(oscillator, pixels.amplitudes[i], side, True, near)
            row[:] = math.nan
            if slope < 0.0:
                push, drag, mean = harmonics(oscillator, amplitude, c)
                fill_harmonic_orbit(harmonic, amplitude, c, push, drag, mean)
                fill_row_from_harmonic(pixels.lever, harmonic, row)
            else:
                status[i] = col.NO_AVERAGED_ORBIT
        solver[i] = col.AVERAGING


@kernel
def side_rows(pixels: Pixels, side: int, limits: ErrorLimits, allowed: ErrorLimits, answers: Answers) -> int:
    """Stable orbit on a side of the resonance for every row that is PENDING; returns how many still are.

    `limits`: of an exact orbit; `allowed`: those within which an averaged one may stand. What is PENDING then has a
    harmonic orbit to start from, or NaN.
    """
    out, status, solver = answers
    workspace, harmonic, waiting = ResponseWorkspace(), HarmonicOrbit(), 0
    for i in range(len(out)):
        if status[i] == col.PENDING:
            status[i] = refined_orbit_on_branch(
                oscillator_of(pixels, i), pixels.amplitudes[i], side, limits, harmonic, workspace
            )
            if status[i] == col.GOOD:
                f = nodes_of_solution(workspace)
                solver[i] = choose(pixels.lever, harmonic, f, workspace.state, True, allowed, out[i])
            else:
                waiting += leave(harmonic, status[i], out[i])
    return waiting


@kernel
def leave(harmonic: HarmonicOrbit, status: int, row: np.ndarray) -> bool:
    """Leave in a row the harmonic orbit to start from, if any, where its status is PENDING; returns whether that is."""
    row[:] = math.nan
    if status == col.PENDING and harmonic.amplitude > 0.0:
        store_harmonic_orbit(harmonic, row)
    return status == col.PENDING


@kernel
def seen_side_rows(pixels: Pixels, side: int, limits: ErrorLimits, answers: Answers, slopes: np.ndarray) -> int:
    """`side_rows` where the detector does not see the tip; `slopes` (shape (n, SLOPES)): as for `exact.seen_rows`."""
    out, status, solver = answers
    workspace, waiting = DetectedWorkspace(HarmonicOrbit(), ResponseWorkspace(), limits), 0
    for i in range(len(out)):
        if status[i] == col.PENDING:
            oscillator, solver[i] = oscillator_of(pixels, i), col.CORRECTED
            status[i] = branch_orbit_at_detected_amplitude(
                oscillator, pixels.amplitudes[i], side, workspace, out[i], slopes[i]
            )
            if status[i] != col.GOOD:
                waiting += leave(workspace.harmonic, status[i], out[i])
    return waiting
