"""Nodes along an orbit of which the result row is known, for integrals over it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.exact_orbit import Rooms, at_amplitude, new_rooms, orbit_along_curve
from phasemap._kernels.engagement.side_from_far import forces_are_plain
from phasemap._kernels.law import Oscillator
from phasemap._kernels.orbits.averaged.branch import fill_averaged_orbit_near
from phasemap._kernels.orbits.averaged.sides import ATTRACTIVE, REPULSIVE
from phasemap._kernels.orbits.collocation.near import orbit_near
from phasemap._kernels.orbits.harmonic_orbit import HarmonicOrbit, fill_harmonic_of_row
from phasemap._kernels.orbits.orbit_nodes import (
    FAINT_DRIVE,
    KEPT_COUNT,
    OrbitNodes,
    fill_harmonic_nodes,
    nodes_from_collocation,
    nodes_from_response,
    read_nodes,
)
from phasemap._kernels.orbits.response.orbit import Room, nodes_of_solution, refine
from phasemap._kernels.orbits.result_row import same_orbit

AGAIN_PHASE, AGAIN_HEIGHT = 1e-5, 1e-12  # [rad, m], errors of an orbit that is solved again by passes
ALIKE = 1e-3  # of the amplitude, by which the tip offset of the same orbit may differ


class Again(NamedTuple):
    """Room for orbits that are solved again."""

    at: OrbitNodes
    room: Room
    limits: np.ndarray
    harmonic: HarmonicOrbit
    row: np.ndarray
    rooms: Rooms


@kernel
def room_again(lever: np.ndarray, tables: np.ndarray, at: OrbitNodes, room: Room) -> Again:
    """Room for orbits that are solved again, with these nodes and the room of the passes."""
    limits = np.array([AGAIN_PHASE, AGAIN_HEIGHT])
    return Again(at, room, limits, HarmonicOrbit(), np.zeros(col.COLUMNS), new_rooms(lever, tables))


@kernel(shared=True)
def nodes_of(oscillator: Oscillator, row: np.ndarray, averaged: bool, kept: np.ndarray, again: Again) -> bool:
    """Fill the nodes of a result row of the tip; False where its orbit is not found again.

    An orbit that is `averaged` is harmonic; the nodes of another one are `kept` behind the row (shape (any,)), or it is
    solved again.
    """
    if len(kept) > 0 and kept[KEPT_COUNT] > 0.0:
        read_nodes(kept, again.at)
        return True
    if averaged:
        fill_harmonic_nodes(oscillator.p, row[col.AMPLITUDE], row[col.INDENTATION], again.at)
        return True
    fill_harmonic_of_row(oscillator.lever, row, again.harmonic)
    side = REPULSIVE if again.harmonic.push > 0.0 else ATTRACTIVE
    faint = oscillator.lever[col.DRIVE] < FAINT_DRIVE * row[col.AMPLITUDE]
    if faint:
        if _by_passes(oscillator, row, side, again):
            return True
        fill_harmonic_of_row(oscillator.lever, row, again.harmonic)  # which passes began elsewhere
    orbit = again.rooms.orbit
    done, _ = orbit_near(oscillator, again.harmonic, orbit, again.row)
    if done != col.GOOD or not same_orbit(again.row, row):
        done = orbit_along_curve(
            oscillator, at_amplitude(oscillator, row[col.AMPLITUDE]), side == REPULSIVE, again.rooms, again.row
        )
        orbit = again.rooms.found
    if done != col.GOOD or not same_orbit(again.row, row):
        return not faint and _by_passes(oscillator, row, side, again)  # what holds the harmonics roughly
    nodes_from_collocation(oscillator, orbit, again.at)
    return True


@kernel
def _by_passes(oscillator: Oscillator, row: np.ndarray, side: int, again: Again) -> bool:
    """Fill the nodes of a row on this branch, whose orbit passes of the lever's response find."""
    amplitude, room, harmonic = row[col.AMPLITUDE], again.room, again.harmonic
    if not (forces_are_plain(oscillator) and fill_averaged_orbit_near(oscillator, amplitude, side, harmonic)):
        return False
    found = refine(oscillator, harmonic, again.limits, room)
    if not found or not abs(room.state.tip_offset - row[col.TIP_OFFSET]) < ALIKE * amplitude:
        return False
    nodes_from_response(nodes_of_solution(room), amplitude, room.state.centre, again.at)
    return True
