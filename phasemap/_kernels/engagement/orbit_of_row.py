"""Nodes along an orbit of which the result row is known, for integrals over it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.columns import ErrorLimits
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.by_averaging import forces_are_plain
from phasemap._kernels.engagement.by_curve import (
    CurveWorkspace,
    new_curve_workspace,
    orbit_along_curve,
    tip_amplitude_wanted,
)
from phasemap._kernels.law import Oscillator
from phasemap._kernels.orbits.averaged.branch import fill_averaged_orbit_near
from phasemap._kernels.orbits.averaged.sides import ATTRACTIVE, REPULSIVE
from phasemap._kernels.orbits.collocation.near import collocation_orbit_from_harmonic
from phasemap._kernels.orbits.collocation.newton import begin_harmonic
from phasemap._kernels.orbits.harmonic_orbit import HarmonicOrbit, fill_harmonic_from_row
from phasemap._kernels.orbits.orbit_nodes import (
    FAINT_DRIVE,
    KEPT_COUNT,
    OrbitNodes,
    nodes_from_collocation,
    nodes_from_response,
    read_nodes,
)
from phasemap._kernels.orbits.response.orbit_at_setpoint import (
    ResponseWorkspace,
    exact_orbit_at_amplitude,
    nodes_of_solution,
)
from phasemap._kernels.orbits.result_row import same_orbit

AGAIN_PHASE, AGAIN_HEIGHT = 1e-5, 1e-12  # [rad, m], errors of an orbit that is solved again by passes
ALIKE = 1e-3  # of the amplitude, by which the tip offset of the same orbit may differ


class RowWorkspace(NamedTuple):
    """Workspace for orbits of result rows, which are solved again."""

    nodes: OrbitNodes
    response: ResponseWorkspace
    limits: ErrorLimits
    harmonic: HarmonicOrbit
    row: np.ndarray
    curve: CurveWorkspace


@kernel
def new_row_workspace(
    lever: np.ndarray, tables: np.ndarray, nodes: OrbitNodes, response: ResponseWorkspace
) -> RowWorkspace:
    """A workspace with these nodes, and that of the passes."""
    limits = ErrorLimits(AGAIN_PHASE, AGAIN_HEIGHT)
    return RowWorkspace(
        nodes, response, limits, HarmonicOrbit(), np.zeros(col.COLUMNS), new_curve_workspace(lever, tables)
    )


@kernel(shared=True)
def nodes_of(
    oscillator: Oscillator, row: np.ndarray, averaged: bool, kept: np.ndarray, workspace: RowWorkspace
) -> bool:
    """Fill the nodes of a result row of the tip; False where its orbit is not found again.

    An orbit that is `averaged` is harmonic about its deepest point: what the higher harmonics do to the depth within a
    contact is left out; that they lift or lower all of it is not, for the depth is the orbit's own. Nodes of others are
    `kept` behind the row (shape (any,)), or they are solved again.
    """
    if len(kept) > 0 and kept[KEPT_COUNT] > 0.0:
        read_nodes(kept, workspace.nodes)
        return True
    harmonic, orbit = workspace.harmonic, workspace.curve.orbit
    fill_harmonic_from_row(oscillator.lever, row, harmonic)
    if averaged:
        harmonic.mean_deflection = row[col.INDENTATION] - row[col.AMPLITUDE] + row[col.TIP_OFFSET]
        laid = begin_harmonic(oscillator, orbit, harmonic, 0)
        nodes_from_collocation(oscillator, orbit, workspace.nodes)
        return laid
    side = REPULSIVE if harmonic.push > 0.0 else ATTRACTIVE
    faint = oscillator.lever[col.DRIVE] < FAINT_DRIVE * row[col.AMPLITUDE]
    if faint:
        if _fill_nodes_by_passes(oscillator, row, side, workspace):
            return True
        fill_harmonic_from_row(oscillator.lever, row, harmonic)  # which passes began elsewhere
    done, _ = collocation_orbit_from_harmonic(oscillator, harmonic, orbit, workspace.row)
    if done != col.GOOD or not same_orbit(workspace.row, row):
        wanted = tip_amplitude_wanted(oscillator, row[col.AMPLITUDE])
        done = orbit_along_curve(oscillator, wanted, workspace.curve, workspace.row)
        orbit = workspace.curve.found
    if done != col.GOOD or not same_orbit(workspace.row, row):
        return not faint and _fill_nodes_by_passes(oscillator, row, side, workspace)  # what holds the harmonics roughly
    nodes_from_collocation(oscillator, orbit, workspace.nodes)
    return True


@kernel
def _fill_nodes_by_passes(oscillator: Oscillator, row: np.ndarray, side: int, workspace: RowWorkspace) -> bool:
    """Fill the nodes of a row on this branch, if passes of the lever's response find its orbit; else False."""
    amplitude, response, harmonic = row[col.AMPLITUDE], workspace.response, workspace.harmonic
    if not (forces_are_plain(oscillator) and fill_averaged_orbit_near(oscillator, amplitude, side, harmonic)):
        return False
    found = exact_orbit_at_amplitude(oscillator, harmonic, workspace.limits, response)
    if not found or not abs(response.state.tip_offset - row[col.TIP_OFFSET]) < ALIKE * amplitude:
        return False
    nodes_from_response(nodes_of_solution(response), amplitude, response.state.centre, workspace.nodes)
    return True
