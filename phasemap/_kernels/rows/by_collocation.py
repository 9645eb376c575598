"""Loops over pixels for orbits by collocation: those that the cheap path leaves, those beside known ones, those seen.

Which orbit the controller finds is decided alike for all solvers: by averaging where that is safe, by the fold at the
end of the attractive branch, and along the curve of exact orbits where that is not enough. An orbit that is solved
already is integrated along its nodes.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.columns import SolvedRows
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.at_detected_amplitude import (
    collocation_orbit_at_detected_amplitude,
    move_to_detected_amplitude,
)
from phasemap._kernels.engagement.by_averaging import engage_by_averaging
from phasemap._kernels.engagement.by_curve import new_curve_workspace
from phasemap._kernels.engagement.orbit_of_row import RowWorkspace, new_row_workspace, nodes_of
from phasemap._kernels.excitation import likely_amplitude, sees_tip
from phasemap._kernels.law import Oscillator, parameters
from phasemap._kernels.orbits.averaged.sides import ATTRACTIVE, Maximum
from phasemap._kernels.orbits.collocation.errors import estimate_errors, fill_errors_as_seen
from phasemap._kernels.orbits.collocation.near import (
    collocation_orbit_from_harmonic,
    collocation_orbit_from_near,
    tolerance_of,
)
from phasemap._kernels.orbits.collocation.system import new_orbit
from phasemap._kernels.orbits.harmonic_orbit import HarmonicOrbit, fill_harmonic_from_row, load_harmonic_orbit
from phasemap._kernels.orbits.integrals import fill_adhesion_integrals, fill_force_integrals, new_load_workspace
from phasemap._kernels.orbits.orbit_nodes import (
    FELT_IM,
    FELT_RE,
    KEPT_COUNT,
    SECOND_IN_TIME,
    OrbitNodes,
    keep_nodes,
    nodes_from_collocation,
)
from phasemap._kernels.orbits.response.orbit_at_setpoint import ResponseWorkspace
from phasemap._kernels.orbits.response.state import Along
from phasemap._kernels.orbits.result_row import has_periodic_orbit
from phasemap._kernels.rows.answers import Answers, Pixels, oscillator_of

MOST_STARTS, FARTHER_START = 6, 0.04  # harmonic orbits to start from, and how far from each other, over the amplitude


@kernel
def collocation_rows(pixels: Pixels, tables: np.ndarray, answers: Answers) -> None:
    """Orbit by collocation of every row whose status is PENDING."""
    (out, status, solver), lever = answers, pixels.lever
    curve, harmonic, top, nodes = new_curve_workspace(lever, tables), HarmonicOrbit(), Maximum(), OrbitNodes()
    for i in range(len(out)):
        if status[i] != col.PENDING:
            continue
        oscillator, amplitude, row = oscillator_of(pixels, i), pixels.amplitudes[i], out[i, : col.COLUMNS]
        decider = engage_by_averaging(oscillator, likely_amplitude(lever, amplitude, ATTRACTIVE), harmonic, top)
        row[:], solver[i] = math.nan, col.ORBIT
        status[i], along = collocation_orbit_at_detected_amplitude(
            oscillator, amplitude, decider, harmonic, top, curve, row
        )
        if status[i] != col.GOOD:
            row[:] = math.nan
            continue
        estimate_errors(oscillator, curve.found, row)
        fill_errors_as_seen(lever, amplitude, along, row)
        if out.shape[1] > col.COLUMNS:
            nodes_from_collocation(oscillator, curve.found, nodes)
            keep_nodes(nodes, out[i])


@kernel
def nearby_rows(
    pixels: Pixels, tables: np.ndarray, away: np.ndarray, group: int, out: np.ndarray, status: np.ndarray
) -> None:
    """Fill in the orbit of every row next to the harmonic one there: amplitude, phase, tip offset, mean deflection.

    An orbit farther than `away` [m] from the harmonic one, or not stable, gets the status NOT_CONVERGED. `group`
    successive rows are close to each other: each may start from the row before.
    """
    orbit, harmonic = new_orbit(pixels.lever, tables), HarmonicOrbit()
    for i in range(len(out)):
        oscillator, row, z0 = oscillator_of(pixels, i), out[i], out[i, col.TIP_OFFSET]
        fill_harmonic_from_row(pixels.lever, row, harmonic)
        done = col.NOT_CONVERGED
        for warm in (True, False):
            if warm and (i % group == 0 or status[i - 1] != col.GOOD):
                continue
            if warm:
                done = collocation_orbit_from_near(oscillator, harmonic, orbit, row)
            else:
                done, _ = collocation_orbit_from_harmonic(oscillator, harmonic, orbit, row)
            if done == col.GOOD and abs(row[col.TIP_OFFSET] - z0) < away[i]:
                break
            done = col.NOT_CONVERGED
        if done != col.GOOD:
            row[:] = math.nan
        status[i] = done


@kernel
def collocation_side_rows(pixels: Pixels, tables: np.ndarray, side: int, answers: Answers) -> int:
    """Exact orbits on a side of the resonance for rows left PENDING, where they are found; returns how many still are.

    A strong pull throws the tip out of its harmonic orbit, whose contact then is too deep to start from: farther ones
    are tried too.
    """
    (out, status, solver), lever = answers, pixels.lever
    orbit, harmonic, waiting, along = new_orbit(lever, tables), HarmonicOrbit(), 0, Along(1.0, 0.0, 0.0)
    for i in range(len(out)):
        if status[i] != col.PENDING:
            continue
        oscillator, row = oscillator_of(pixels, i), out[i]
        load_harmonic_orbit(row, harmonic)
        for _ in range(MOST_STARTS):
            if math.isnan(harmonic.tip_offset):
                break
            done, _ = collocation_orbit_from_harmonic(oscillator, harmonic, orbit, row)
            if done == col.GOOD and not sees_tip(lever):
                tolerance = tolerance_of(oscillator)
                done, along = move_to_detected_amplitude(oscillator, pixels.amplitudes[i], tolerance, orbit, row)
            if done == col.GOOD and (row[col.STIFFENING] > 0.0) == (side > 0):
                status[i], solver[i] = col.GOOD, col.ORBIT
                estimate_errors(oscillator, orbit, row)
                fill_errors_as_seen(lever, pixels.amplitudes[i], along, row)
                break
            harmonic.tip_offset += FARTHER_START * harmonic.amplitude
        if status[i] == col.PENDING:
            row[:] = math.nan
            waiting += 1
    return waiting


@kernel
def _finds_nodes(oscillator: Oscillator, solved: SolvedRows, i: int, workspace: RowWorkspace) -> bool:
    """Fill the nodes of row i; False where it has no periodic orbit, or that is not found again."""
    row, kept = solved.rows[i], solved.kept
    own = i if kept.shape[1] > 0 else 0  # without columns there is one row, and nothing in it is read
    return has_periodic_orbit(row) and nodes_of(oscillator, row, solved.averaged[i], kept[own], workspace)


@kernel
def force_rows(pixels: Pixels, tables: np.ndarray, second: int, solved: SolvedRows, harmonics: int) -> None:
    """Fill in what `fill_force_integrals` does for so many harmonics of the force, in rows that have an orbit."""
    nodes, loads = OrbitNodes(), new_load_workspace(harmonics)
    workspace = new_row_workspace(pixels.lever, tables, nodes, ResponseWorkspace())
    for i in range(len(solved.rows)):
        oscillator = oscillator_of(pixels, i)
        if solved.kept.shape[1] > 0 and solved.kept[i, KEPT_COUNT] == SECOND_IN_TIME:
            row, kept = solved.rows[i], solved.kept[i]
            row[col.GRADIENT], row[col.DRAG] = kept[FELT_RE], 0.0
            row[col.SIDEBANDS], row[col.SIDEBANDS + 1] = 0.0, -kept[FELT_IM]
        elif _finds_nodes(oscillator, solved, i, workspace):
            fill_force_integrals(oscillator, nodes, second, loads, solved.rows[i])


@kernel
def adhesion_rows(pixels: Pixels, tables: np.ndarray, bare: np.ndarray, solved: SolvedRows) -> None:
    """Fill in what `fill_adhesion_integrals` does, in rows that have an orbit.

    `bare` are the rows of the same contacts without adhesion and bias.
    """
    nodes = OrbitNodes()
    workspace = new_row_workspace(pixels.lever, tables, nodes, ResponseWorkspace())
    for i in range(len(solved.rows)):
        oscillator = oscillator_of(pixels, i)
        if _finds_nodes(oscillator, solved, i, workspace):
            fill_adhesion_integrals(oscillator, parameters(bare[i]), nodes, solved.rows[i])
