"""Loop over rows that are solved: averages of the force's slope and damping along their orbits, and its harmonics."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import (
    Law,
    contact_force,
    contact_slope,
    damping,
    longrange_force,
    longrange_slope,
    parameters,
)
from phasemap._kernels.orbits.along import along
from phasemap._kernels.orbits.around import COS, DEPTH, MOST, RATE, ROWS, SIN, TOUCHES, WEIGHT, harmonic, moves
from phasemap._kernels.orbits.response import nodes as free
from phasemap._kernels.orbits.response.passes import STATE
from phasemap._kernels.wide import DRAG, GRADIENT, SIDEBANDS, WAVES, WIDE

TURNS = 20  # harmonics of the force's slope that are looked at


@kernel
def _jumps(law: Law, p: np.ndarray, amplitude: float, depth: float) -> float:
    """What jumps of the force at contact and release add to the integral of dF/dd over theta [N/m]: each over d'."""
    c, last = 1.0 - depth / amplitude, 1.0 - (depth - p[col.RELEASE]) / amplitude
    if c >= 1.0 or last <= -1.0:
        return 0.0
    made = contact_force(law, 0.0, p) - longrange_force(law, 0.0, p)
    broken = contact_force(law, p[col.RELEASE], p) - longrange_force(law, p[col.RELEASE], p)
    return (made / math.sqrt(1.0 - c * c) + broken / math.sqrt(1.0 - last * last)) / amplitude


@kernel
def _turn(slopes: np.ndarray, j: int, share: float, c: float, s: float) -> None:
    """Add the share of a node to the harmonics of the slope, shape (2, TURNS), from the first on."""
    if j == 0:
        slopes[:] = 0.0
    cos_n, sin_n = c, s
    for n in range(TURNS):
        slopes[0, n] += share * cos_n
        slopes[1, n] -= share * sin_n
        cos_n, sin_n = cos_n * c - sin_n * s, sin_n * c + cos_n * s


@kernel
def _sidebands(lever: np.ndarray, second: np.ndarray, slopes: np.ndarray, row: np.ndarray) -> None:
    """Fill in the sum of |K_n|^2 chi(omega2 + n omega) over harmonics K_n of the slope, n of both signs.

    Where the second mode moves, the slope that comes and goes makes forces at the sidebands of its frequency. To these
    both modes yield, with the compliance chi, and what they do acts back: to second order in the slope.
    """
    drive, own = lever[col.OMEGA], lever[col.OMEGA] / second[col.OMEGA]  # over the first mode's resonance
    re, im = 0.0, 0.0
    for n in range(-TURNS, TURNS + 1):
        power = row[GRADIENT] ** 2 if n == 0 else slopes[0, abs(n) - 1] ** 2 + slopes[1, abs(n) - 1] ** 2
        for mode in range(2):
            if mode == 1 and n == 0:
                continue  # the second mode itself
            resonance, alpha0, stiffness = 1.0, lever[col.ALPHA0], lever[col.STIFFNESS]
            if mode == 1:
                resonance, alpha0, stiffness = own, second[col.ALPHA0], second[col.STIFFNESS]
            w = (own + n * drive) / resonance
            x, y = 1.0 - w * w, 2.0 * alpha0 * w
            below = power / (stiffness * (x * x + y * y))
            re += below * x
            im -= below * y
    row[SIDEBANDS], row[SIDEBANDS + 1] = re, im


@kernel
def force_rows(
    law: Law, rows: np.ndarray, lever: np.ndarray, second: np.ndarray, averaged: np.ndarray, out: np.ndarray
) -> None:
    """Fill in GRADIENT, DRAG and WAVES of wide rows of the tip, shape (n, WIDE), that have a periodic orbit.

    Rows that are `averaged` have the harmonic orbit only. `second` is the lever of a second mode, shape (5,),
    of stiffness 0 where there is none: SIDEBANDS are filled in with one.
    """
    at, f, state = np.zeros((ROWS, MOST)), np.zeros((free.FIELDS, free.ALL)), np.zeros(STATE)
    slopes = np.zeros((2, TURNS))
    inverse_k = 1.0 / lever[col.STIFFNESS]
    for i in range(len(rows)):
        row, p = out[i], parameters(rows[i])
        if not moves(row):
            continue
        amplitude, count = row[col.AMPLITUDE], 0
        if not averaged[i]:
            count = along(law, p, lever, amplitude, row[col.TIP_OFFSET] - row[col.MEAN], f, state, at)
        if count == 0:
            count = harmonic(law, p, amplitude, row[col.INDENTATION], at)
        gradient, drag = _jumps(law, p, amplitude, row[col.INDENTATION]), 0.0
        row[WAVES:WIDE] = 0.0
        for j in range(count):
            d, c, s, weight = at[DEPTH, j], at[COS, j], at[SIN, j], at[WEIGHT, j]
            if at[TOUCHES, j] == 0.0:
                g = inverse_k * longrange_force(law, min(d, 0.0), p)
                slope = longrange_slope(law, min(d, 0.0), p)
            else:
                d = d if p[col.RELEASE] < 0.0 else max(d, 0.0)
                g = inverse_k * contact_force(law, d, p)
                slope = contact_slope(law, d, p)
                if d > 0.0:
                    alpha = 2.0 * damping(law, d, p)
                    drag += weight * alpha
                    g += alpha * lever[col.OMEGA] * at[RATE, j]
            gradient += weight * slope
            if second[col.STIFFNESS] > 0.0:
                _turn(slopes, j, weight * slope / (2.0 * math.pi), c, s)
            share, cos_n, sin_n = weight * g / math.pi, c, s
            for n in range(col.HARMONICS):
                cos_n, sin_n = cos_n * c - sin_n * s, sin_n * c + cos_n * s
                row[WAVES + 2 * n] -= share * cos_n
                row[WAVES + 2 * n + 1] += share * sin_n
        row[GRADIENT], row[DRAG] = gradient / (2.0 * math.pi), drag / (2.0 * math.pi)
        for n in range(col.HARMONICS):  # the lever's answer to the force
            multiple = (n + 2) * lever[col.OMEGA]
            x, y = 1.0 - multiple * multiple, 2.0 * lever[col.ALPHA0] * multiple
            below = 1.0 / (x * x + y * y)
            re, im = row[WAVES + 2 * n], row[WAVES + 2 * n + 1]
            row[WAVES + 2 * n], row[WAVES + 2 * n + 1] = (re * x + im * y) * below, (im * x - re * y) * below
        if second[col.STIFFNESS] > 0.0:
            _sidebands(lever, second, slopes, row)
