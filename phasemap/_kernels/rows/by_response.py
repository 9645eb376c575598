"""Loops over pixels for what is cheap: averaged orbits, and orbits corrected by the lever's response.

Each loop works on a slice and can run in a thread of its own (nogil). Pixels that these methods cannot decide or not
solve well enough are left PENDING: for collocation, which is compiled only where there are some.
"""

from __future__ import annotations

import math

from phasemap._kernels import columns as col
from phasemap._kernels.columns import ErrorLimits
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.at_detected_amplitude import engaged_orbit_by_response
from phasemap._kernels.engagement.by_averaging import BY_AVERAGING, engage_by_averaging
from phasemap._kernels.engagement.by_fold import fill_sufficient_row
from phasemap._kernels.engagement.other_branch import refined_orbit_on_branch
from phasemap._kernels.excitation import likely_amplitude, sees_tip
from phasemap._kernels.orbits.averaged.branch import fill_held_averaged_orbit
from phasemap._kernels.orbits.averaged.sides import ATTRACTIVE, REPULSIVE, Maximum
from phasemap._kernels.orbits.collocation.errors import fill_errors_as_seen
from phasemap._kernels.orbits.harmonic_orbit import (
    HarmonicOrbit,
    fill_row_from_harmonic,
    store_harmonic_orbit,
)
from phasemap._kernels.orbits.orbit_nodes import FAINT_DRIVE, OrbitNodes, keep_nodes, nodes_from_response
from phasemap._kernels.orbits.response.orbit_at_setpoint import ResponseWorkspace, nodes_of_solution
from phasemap._kernels.orbits.response.state import slopes_of
from phasemap._kernels.rows.answers import Answers, Pixels, oscillator_of


@kernel
def response_rows(pixels: Pixels, limits: ErrorLimits, average: bool, answers: Answers) -> int:
    """Orbit of every row after engagement, where the cheap path is good enough; returns how many wait.

    With `average` an averaged orbit may stand where the detector sees the tip. Rows with room keep the nodes of the
    orbit (`orbit_nodes`).
    """
    (out, status, solver), lever = answers, pixels.lever
    workspace, nodes, harmonic, waiting = ResponseWorkspace(), OrbitNodes(), HarmonicOrbit(), 0
    average = average and sees_tip(lever)
    for i in range(len(out)):
        oscillator, amplitude, row = oscillator_of(pixels, i), pixels.amplitudes[i], out[i][: col.COLUMNS]
        row[:] = math.nan
        solved = engaged_orbit_by_response(oscillator, amplitude, limits, harmonic, workspace)
        status[i], waiting = (col.GOOD, waiting) if solved else (col.PENDING, waiting + 1)
        if solved:
            solver[i] = fill_sufficient_row(
                lever, harmonic, nodes_of_solution(workspace), workspace.state, average, limits, row
            )
            fill_errors_as_seen(lever, amplitude, slopes_of(workspace.state), row)
            if out.shape[1] > col.COLUMNS:
                if solver[i] == col.CORRECTED and lever[col.DRIVE] < FAINT_DRIVE * amplitude:
                    f = nodes_of_solution(workspace)
                    nodes_from_response(f, workspace.state.amplitude, workspace.state.centre, nodes)
                    keep_nodes(nodes, out[i])
    return waiting


@kernel
def averaging_rows(pixels: Pixels, answers: Answers) -> int:
    """First-order averaged orbit of every row where averaging decides; returns how many wait."""
    out, status, solver = answers
    harmonic, top, waiting = HarmonicOrbit(), Maximum(), 0
    for i in range(len(out)):
        out[i] = math.nan
        solver[i] = col.AVERAGING
        if engage_by_averaging(oscillator_of(pixels, i), pixels.amplitudes[i], harmonic, top) == BY_AVERAGING:
            status[i] = col.GOOD
            fill_row_from_harmonic(pixels.lever, harmonic, out[i])
        else:
            status[i] = col.PENDING
            waiting += 1
    return waiting


@kernel
def averaged_near_rows(pixels: Pixels, answers: Answers) -> None:
    """Replace exact orbits by the averaged ones next to them: the exact ones only told the branch."""
    out, status, solver = answers
    harmonic = HarmonicOrbit()
    for i in range(len(out)):
        if status[i] == col.GOOD and solver[i] != col.AVERAGING:
            oscillator, row = oscillator_of(pixels, i), out[i]
            side, amplitude = REPULSIVE if row[col.STIFFENING] > 0.0 else ATTRACTIVE, row[col.AMPLITUDE]
            near = amplitude, (row[col.TIP_OFFSET] - row[col.MEAN]) / amplitude
            row[:] = math.nan
            if fill_held_averaged_orbit(oscillator, pixels.amplitudes[i], side, near, harmonic):
                fill_row_from_harmonic(pixels.lever, harmonic, row)
            else:
                status[i] = col.NO_AVERAGED_ORBIT
        solver[i] = col.AVERAGING


@kernel
def side_rows(pixels: Pixels, side: int, limits: ErrorLimits, allowed: ErrorLimits, answers: Answers) -> int:
    """Stable orbit on a side of the resonance for every row that is PENDING; returns how many still are.

    `limits`: of an exact orbit; `allowed`: those within which an averaged one may stand. Rows that stay PENDING
    have a harmonic orbit to start from, or NaN.
    """
    (out, status, solver), lever = answers, pixels.lever
    workspace, harmonic, waiting = ResponseWorkspace(), HarmonicOrbit(), 0
    for i in range(len(out)):
        if status[i] == col.PENDING:
            oscillator, held = oscillator_of(pixels, i), pixels.amplitudes[i]
            workspace.seen, near = 0.0 if sees_tip(lever) else held, likely_amplitude(lever, held, side)
            # There is none where none has the amplitude of a lever without losses, nor one nearer to that seen.
            for amplitude in (near, 0.5 * (near + held)):
                status[i] = refined_orbit_on_branch(oscillator, amplitude, side, limits, harmonic, workspace)
                if status[i] != col.NO_STABLE_ORBIT or near == held:
                    break
            if status[i] == col.GOOD:
                f = nodes_of_solution(workspace)
                solver[i] = fill_sufficient_row(lever, harmonic, f, workspace.state, sees_tip(lever), allowed, out[i])
                fill_errors_as_seen(lever, held, slopes_of(workspace.state), out[i])
                continue
            out[i] = math.nan
            if status[i] == col.PENDING:
                waiting += 1
                if harmonic.amplitude > 0.0:
                    store_harmonic_orbit(harmonic, out[i])
    return waiting
