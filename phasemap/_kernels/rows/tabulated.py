"""Averaged orbits and their derivatives, where the integrals of the force are tabulated over c.

P, S and A0 of a harmonic orbit are affine in what materials change of most laws: contact stiffness, adhesion, damping.
At a given amplitude their parts are then functions of c alone, which polynomials on short intervals give: theory,
Eq. (inversion-2). Either side of touching, c = 1, the intervals are eighths of octaves of |1 - c|, so that functions of
its root are as smooth in each of them; contact without an end, c = -1, is the end of one.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels.columns import DRIVE
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, Oscillator, parameters
from phasemap._kernels.lever import drive_needed, mismatch, reach_of
from phasemap._kernels.orbits.averaged.harmonics import harmonics
from phasemap._kernels.records import column, record
from phasemap._kernels.rows.derivatives import (
    LAST_ROOT_STEP,
    LONGEST_ROOT_STEP,
    MEASURED_OFFSET,
    MEASURED_PHASE,
    MOST_ROOT_STEPS,
    Found,
    Setpoints,
    mismatch_scale,
)

FIRST_OCTAVE = -20  # |1 - c| from 2^-20
LAST_OCTAVE = 3  # to 2^3
OCTAVE_SHARES = 8  # intervals in an octave
TABLE_INTERVALS = 1 + OCTAVE_SHARES * (LAST_OCTAVE - FIRST_OCTAVE)  # on either side, the first of which begins at 0
TABLE_TERMS = 8  # coefficients of a polynomial
AXES = 3  # along which materials differ

# Columns of the integrals of the force.
TABLE_PUSH = 0  # P [m]
TABLE_DRAG = 1  # S [m]
TABLE_MEAN = 2  # A0 [m]
TABLE_SUMS = 3
PARTS = TABLE_SUMS * (1 + AXES)  # those of a reference, and how much each axis adds

# How the search for a root ends.
ROOT_LOST = 0
ROOT_FOUND = 1
ROOT_BEYOND = 2  # where the table does not say


@record
class Parts:
    """Parts of the integrals of the force at one c."""

    values: np.ndarray = column(PARTS)  # [m]
    slopes: np.ndarray = column(PARTS)  # derivatives by c [m]


class HeldOrbit(NamedTuple):
    """Averaged orbit that is sought: material, lever, amplitude and branch."""

    x: tuple[float, float, float]  # material along the axes of the table
    lever: np.ndarray
    amplitude: float  # [m]
    side: int  # of its branch: -1 attractive, 1 repulsive


class Table(NamedTuple):
    """Integrals of the force in m images."""

    coefficients: np.ndarray  # shape (m, 2, TABLE_INTERVALS, TABLE_TERMS, PARTS) [m]; in contact and before it
    sound: np.ndarray  # bool, shape (m, 2, TABLE_INTERVALS); where the table gives what the integrals are
    spans: np.ndarray  # shape (TABLE_INTERVALS, 2); middle of |1 - c|, and 1 over half the width
    reaches: np.ndarray  # shape (m,); of the long-range force [m]


@kernel
def harmonics_rows(
    law: Law, rows: np.ndarray, lever: np.ndarray, amplitude: float, c: np.ndarray, out: np.ndarray
) -> float:
    """Fill in P, S and A0 [m] of each material at each c, shape (n, len(c), TABLE_SUMS); returns the last reach [m]."""
    reach = 0.0
    for i in range(len(rows)):
        p = parameters(rows[i])
        reach = reach_of(law, p)
        for j in range(len(c)):
            out[i, j, TABLE_PUSH], out[i, j, TABLE_DRAG], out[i, j, TABLE_MEAN] = harmonics(
                Oscillator(law, p, lever), reach, amplitude, c[j]
            )
    return reach


@kernel
def _look_up(table: Table, image: int, c: float, parts: Parts) -> bool:
    """Fill in all parts at c and their derivatives by c; False where the table does not say."""
    x, side = abs(1.0 - c), 0 if c < 1.0 else 1
    share, octave = math.frexp(x)
    if not octave <= LAST_OCTAVE:
        return False
    k = 0
    if octave > FIRST_OCTAVE:
        k = 1 + OCTAVE_SHARES * (octave - 1 - FIRST_OCTAVE) + int((share - 0.5) * (2 * OCTAVE_SHARES))
    if not table.sound[image, side, k]:
        return False
    a, per = table.coefficients[image, side, k], table.spans[k, 1]
    u = (x - table.spans[k, 0]) * per
    per = -per if side == 0 else per
    u2 = u * u
    u3, u4 = u2 * u, u2 * u2
    u5, u6, u7 = u2 * u3, u3 * u3, u3 * u4
    for i in range(PARTS):
        parts.values[i] = (
            a[0, i] + u * a[1, i] + u2 * a[2, i] + u3 * a[3, i] + u4 * a[4, i] + u5 * a[5, i] + u6 * a[6, i]
            + u7 * a[7, i]
        )  # fmt: skip
        parts.slopes[i] = per * (
            a[1, i] + 2.0 * u * a[2, i] + 3.0 * u2 * a[3, i] + 4.0 * u3 * a[4, i] + 5.0 * u4 * a[5, i]
            + 6.0 * u5 * a[6, i] + 7.0 * u6 * a[7, i]
        )  # fmt: skip
    return True


@kernel
def _sum(a: np.ndarray, which: int, x: tuple[float, float, float]) -> float:
    """P, S or A0 of a material [m], or its derivative by c."""
    return a[which] + x[0] * a[TABLE_SUMS + which] + x[1] * a[2 * TABLE_SUMS + which] + x[2] * a[3 * TABLE_SUMS + which]


@kernel
def _find_root(table: Table, image: int, held: HeldOrbit, c: float, parts: Parts) -> tuple[int, float]:
    """Root c near a guess, as `root_near` finds it, with all parts there, and how the search ended."""
    x, lever, amplitude, side = held
    for _ in range(MOST_ROOT_STEPS if math.isfinite(c) else 0):
        depth = mismatch_scale(table.reaches[image], amplitude, c)
        if not _look_up(table, image, c, parts):
            return ROOT_BEYOND, c
        push, drag = _sum(parts.values, TABLE_PUSH, x), _sum(parts.values, TABLE_DRAG, x)
        ahead, behind = drive_needed(lever, amplitude, push, drag)
        rise = ahead * _sum(parts.slopes, TABLE_PUSH, x) - behind * _sum(parts.slopes, TABLE_DRAG, x)
        slope = 2.0 * rise / lever[DRIVE] ** 2
        if not slope < 0.0:
            return ROOT_LOST, c
        longest = LONGEST_ROOT_STEP * depth
        step = min(max(-mismatch(lever, amplitude, push, drag) / slope, -longest), longest)
        c += step
        if abs(step) < LAST_ROOT_STEP * depth:
            for i in range(PARTS):
                parts.values[i] += step * parts.slopes[i]
            return (ROOT_FOUND if (push > 0.0) == (side > 0) else ROOT_LOST), c
    return ROOT_LOST, c


@kernel
def tabulated_block(
    table: Table, x: np.ndarray, rates: np.ndarray, setpoints: Setpoints, found: Found, beyond: np.ndarray
) -> None:
    """Fill in averaged phase and tip offset of n materials in m images near known places, and their derivatives.

    Parameters
    ----------
    table : Table
    x, rates : ndarray, shape (n, AXES)
        Materials along the axes of the table, and how that changes with the logarithm of each property.
    setpoints, found
        As for `averaged_block`; the detector sees the tip.
    beyond : ndarray of bool, shape (n,)
        Receives where the table does not say.
    """
    (values, slopes, good), (levers, amplitudes, sides, places) = found, setpoints
    parts = Parts()
    for i in range(len(x)):
        here = x[i, 0], x[i, 1], x[i, 2]
        good[i], beyond[i] = True, False
        for j in range(len(amplitudes)):
            if sides[i, j] == 0:
                values[i, j, MEASURED_PHASE], values[i, j, MEASURED_OFFSET] = 0.0, 0.0
                for k in range(AXES):
                    slopes[i, j, MEASURED_PHASE, k], slopes[i, j, MEASURED_OFFSET, k] = 0.0, 0.0
                continue
            held = HeldOrbit(here, levers[j], amplitudes[j], sides[i, j])
            state, c = _find_root(table, j, held, places[i, j], parts)
            if state != ROOT_FOUND:
                good[i], beyond[i] = False, state == ROOT_BEYOND
                break
            places[i, j] = c
            _fill_orbit(held, c, parts, rates[i], values[i, j], slopes[i, j])


@kernel
def _fill_orbit(
    held: HeldOrbit, c: float, parts: Parts, rates: np.ndarray, values: np.ndarray, slopes: np.ndarray
) -> None:
    """Fill in phase and tip offset of an orbit, and their derivatives by the logarithms of the material."""
    here, lever, amplitude, _ = held
    part = parts.values
    ahead, behind = drive_needed(lever, amplitude, _sum(part, TABLE_PUSH, here), _sum(part, TABLE_DRAG, here))
    values[MEASURED_PHASE] = math.atan2(ahead, behind)
    values[MEASURED_OFFSET] = amplitude * c + _sum(part, TABLE_MEAN, here)
    push_c, drag_c = _sum(parts.slopes, TABLE_PUSH, here), _sum(parts.slopes, TABLE_DRAG, here)
    per = 1.0 / (ahead * ahead + behind * behind)
    h_c, phase_c = ahead * push_c - behind * drag_c, (behind * push_c + ahead * drag_c) * per
    offset_c = amplitude + _sum(parts.slopes, TABLE_MEAN, here)
    for k in range(AXES):
        axis, rate = TABLE_SUMS * (1 + k), rates[k]
        push_k, drag_k = rate * part[axis + TABLE_PUSH], rate * part[axis + TABLE_DRAG]
        c_k = (behind * drag_k - ahead * push_k) / h_c
        slopes[MEASURED_PHASE, k] = (behind * push_k + ahead * drag_k) * per + phase_c * c_k
        slopes[MEASURED_OFFSET, k] = rate * part[axis + TABLE_MEAN] + offset_c * c_k
