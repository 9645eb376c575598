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

from phasemap._kernels.columns import BASE
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, Oscillator, parameters
from phasemap._kernels.lever import drive_needed, mismatch, reach_of
from phasemap._kernels.orbits.averaged.harmonics import harmonics
from phasemap._kernels.rows.derivatives import CLOSE, LONGEST, MOST_STEPS, OFFSET, PHASE, Found, depth_of

FIRST, LAST, SHARES = -20, 3, 8  # |1 - c| from 2^FIRST to 2^LAST; intervals in an octave
COUNT = 1 + SHARES * (LAST - FIRST)  # intervals on either side, the first of which begins at 0
TERMS = 8  # coefficients of a polynomial
AXES = 3  # along which materials differ
PUSH, DRAG, MEAN, SUMS = 0, 1, 2, 3  # P, S and A0
PARTS = SUMS * (1 + AXES)  # those of a reference, and how much each axis adds
LOST, DONE, BEYOND = 0, 1, 2  # BEYOND: where the table does not say


class Table(NamedTuple):
    """Integrals of the force in m images."""

    coefficients: np.ndarray  # shape (m, 2, COUNT, TERMS, PARTS) [m]; in contact and before it
    sound: np.ndarray  # bool, shape (m, 2, COUNT); where the table gives what the integrals are
    spans: np.ndarray  # shape (COUNT, 2); middle of |1 - c|, and 1 over half the width
    reaches: np.ndarray  # shape (m,); of the long-range force [m]


@kernel
def harmonics_rows(
    law: Law, rows: np.ndarray, lever: np.ndarray, amplitude: float, c: np.ndarray, out: np.ndarray
) -> float:
    """P, S and A0 [m] of each material at each c, shape (n, len(c), SUMS); returns the reach [m] of the last."""
    reach = 0.0
    for i in range(len(rows)):
        p = parameters(rows[i])
        reach = reach_of(law, p)
        for j in range(len(c)):
            out[i, j, PUSH], out[i, j, DRAG], out[i, j, MEAN] = harmonics(
                Oscillator(law, p, lever), reach, amplitude, c[j]
            )
    return reach


@kernel
def _look_up(table: Table, image: int, c: float, parts: np.ndarray) -> bool:
    """Fill in all parts at c and their derivatives by c, shape (2, PARTS); False where the table does not say."""
    x, side = abs(1.0 - c), 0 if c < 1.0 else 1
    share, octave = math.frexp(x)
    if not octave <= LAST:
        return False
    k = 1 + SHARES * (octave - 1 - FIRST) + int((share - 0.5) * (2 * SHARES)) if octave > FIRST else 0
    if not table.sound[image, side, k]:
        return False
    a, per = table.coefficients[image, side, k], table.spans[k, 1]
    u = (x - table.spans[k, 0]) * per
    per = -per if side == 0 else per
    u2 = u * u
    u3, u4 = u2 * u, u2 * u2
    u5, u6, u7 = u2 * u3, u3 * u3, u3 * u4
    for i in range(PARTS):
        parts[0, i] = (
            a[0, i] + u * a[1, i] + u2 * a[2, i] + u3 * a[3, i] + u4 * a[4, i] + u5 * a[5, i] + u6 * a[6, i]
            + u7 * a[7, i]
        )  # fmt: skip
        parts[1, i] = per * (
            a[1, i] + 2.0 * u * a[2, i] + 3.0 * u2 * a[3, i] + 4.0 * u3 * a[4, i] + 5.0 * u4 * a[5, i]
            + 6.0 * u5 * a[6, i] + 7.0 * u6 * a[7, i]
        )  # fmt: skip
    return True


@kernel
def _sum(parts: np.ndarray, order: int, which: int, x: tuple[float, float, float]) -> float:
    """P, S or A0 of a material, or its derivative by c."""
    a = parts[order]
    return a[which] + x[0] * a[SUMS + which] + x[1] * a[2 * SUMS + which] + x[2] * a[3 * SUMS + which]


@kernel
def _find(
    table: Table, image: int, x: tuple[float, float, float], lever: np.ndarray, amplitude: float, side: int, c: float,
    parts: np.ndarray,
) -> tuple[int, float]:  # fmt: skip
    """The root c near a guess, as `root_near` finds it, with all parts there."""
    for _ in range(MOST_STEPS if math.isfinite(c) else 0):
        depth = depth_of(table.reaches[image], amplitude, c)
        if not _look_up(table, image, c, parts):
            return BEYOND, c
        push, drag = _sum(parts, 0, PUSH, x), _sum(parts, 0, DRAG, x)
        ahead, behind = drive_needed(lever, amplitude, push, drag)
        slope = 2.0 * (ahead * _sum(parts, 1, PUSH, x) - behind * _sum(parts, 1, DRAG, x)) / lever[BASE] ** 2
        if not slope < 0.0:
            return LOST, c
        step = min(max(-mismatch(lever, amplitude, push, drag) / slope, -LONGEST * depth), LONGEST * depth)
        c += step
        if abs(step) < CLOSE * depth:
            for i in range(PARTS):
                parts[0, i] += step * parts[1, i]
            return (DONE if (push > 0.0) == (side > 0) else LOST), c
    return LOST, c


@kernel
def tabulated_block(
    table: Table, x: np.ndarray, rates: np.ndarray, levers: np.ndarray, amplitudes: np.ndarray, sides: np.ndarray,
    places: np.ndarray, found: Found, beyond: np.ndarray,
) -> None:  # fmt: skip
    """Averaged phase and tip offset of n materials in m images near `places`, and their derivatives.

    Parameters
    ----------
    table : Table
    x, rates : ndarray, shape (n, AXES)
        Materials along the axes of the table, and how that changes with the logarithm of each property.
    levers, amplitudes, sides, places, found
        As for `averaged_block`; the detector sees the tip.
    beyond : ndarray of bool, shape (n,)
        Receives where the table does not say.
    """
    values, slopes, good = found
    parts = np.empty((2, PARTS))
    for i in range(len(x)):
        here = x[i, 0], x[i, 1], x[i, 2]
        good[i], beyond[i] = True, False
        for j in range(len(amplitudes)):
            if sides[i, j] == 0:
                values[i, j, PHASE], values[i, j, OFFSET] = 0.0, 0.0
                for k in range(AXES):
                    slopes[i, j, PHASE, k], slopes[i, j, OFFSET, k] = 0.0, 0.0
                continue
            lever, amplitude = levers[j], amplitudes[j]
            state, c = _find(table, j, here, lever, amplitude, sides[i, j], places[i, j], parts)
            if state != DONE:
                good[i], beyond[i] = False, state == BEYOND
                break
            places[i, j] = c
            ahead, behind = drive_needed(lever, amplitude, _sum(parts, 0, PUSH, here), _sum(parts, 0, DRAG, here))
            values[i, j, PHASE] = math.atan2(ahead, behind)
            values[i, j, OFFSET] = amplitude * c + _sum(parts, 0, MEAN, here)
            push_c, drag_c = _sum(parts, 1, PUSH, here), _sum(parts, 1, DRAG, here)
            per = 1.0 / (ahead * ahead + behind * behind)
            h_c, phase_c = ahead * push_c - behind * drag_c, (behind * push_c + ahead * drag_c) * per
            offset_c = amplitude + _sum(parts, 1, MEAN, here)
            for k in range(AXES):
                axis, rate = SUMS * (1 + k), rates[i, k]
                push_k, drag_k = rate * parts[0, axis + PUSH], rate * parts[0, axis + DRAG]
                c_k = (behind * drag_k - ahead * push_k) / h_c
                slopes[i, j, PHASE, k] = (behind * push_k + ahead * drag_k) * per + phase_c * c_k
                slopes[i, j, OFFSET, k] = rate * parts[0, axis + MEAN] + offset_c * c_k
