"""What more there is to know of an exact orbit than an image needs: forces, harmonics, multipliers, its time trace."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator
from phasemap._kernels.orbits.collocation.contacts import interpolate
from phasemap._kernels.orbits.collocation.system import (
    COS,
    COUNT,
    EDGE,
    EDGE_U,
    EDGE_W,
    ELEMENTS,
    INSIDE,
    OUTSIDE,
    PLACE,
    SCALE,
    SIDE,
    SIN,
    TABLE,
    TRANSFER,
    VALUE,
    Z0,
    A,
    Orbit,
    U,
    W,
    surface_force,
)
from phasemap._kernels.quadrature import NODES, T_END1


@kernel
def complete(oscillator: Oscillator, tables: np.ndarray, orbit: Orbit, row: np.ndarray) -> None:
    """Fill what `observe` leaves of a full row, shape (FULL,), at a linearised orbit."""
    law, p, lever = oscillator
    omega, stiffness = lever[col.OMEGA], lever[col.STIFFNESS]
    head = orbit.head
    amplitude, z0 = head[VALUE, A], head[VALUE, Z0]
    mean, peak, least, contact = 0.0, -math.inf, math.inf, 0.0
    in_phase, across = np.zeros(col.HARMONICS), np.zeros(col.HARMONICS)
    for e in range(int(head[COUNT, ELEMENTS])):
        one = orbit.elements[e]
        side, table = one[PLACE, SIDE], tables[int(one[PLACE, TABLE])]
        for j in range(NODES):
            weight = one[PLACE, SCALE] * table[T_END1, j]
            c, s, w = one[COS, j], one[SIN, j], one[W, j]
            d, v = amplitude * c + w - z0, omega * (one[U, j] - amplitude * s)
            force = stiffness * surface_force(law, p, 1.0 / stiffness, side, d, v)[0]
            mean += weight * force
            peak, least = max(peak, force), min(least, force)
            contact += weight if side != OUTSIDE else 0.0
            cos_n, sin_n = c, s
            for n in range(col.HARMONICS):
                cos_n, sin_n = cos_n * c - sin_n * s, sin_n * c + cos_n * s
                in_phase[n] += weight * force * cos_n
                across[n] += weight * force * sin_n
        # Where the tip touches or a neck breaks the force may jump to its extreme.
        d = amplitude * math.cos(one[PLACE, EDGE]) + one[PLACE, EDGE_W] - z0
        v = omega * (one[PLACE, EDGE_U] - amplitude * math.sin(one[PLACE, EDGE]))
        for beside in (side, orbit.elements[e - 1 if e > 0 else int(head[COUNT, ELEMENTS]) - 1, PLACE, SIDE]):
            force = stiffness * surface_force(law, p, 1.0 / stiffness, beside, d, v)[0]
            peak, least = max(peak, force), min(least, force)
    deepest = row[col.INDENTATION]
    if math.isfinite(deepest):
        side = INSIDE if deepest > 0.0 else OUTSIDE
        peak = max(peak, stiffness * surface_force(law, p, 1.0 / stiffness, side, deepest, 0.0)[0])
        if deepest <= 0.0:
            least = min(least, stiffness * surface_force(law, p, 1.0 / stiffness, side, deepest, 0.0)[0])
    row[col.MEAN_FORCE] = mean / (2.0 * math.pi)
    row[col.PEAK_FORCE], row[col.LEAST_FORCE] = peak, least
    row[col.CONTACT_TIME] = contact / (2.0 * math.pi)
    for n in range(col.HARMONICS):  # the lever's answer to the harmonics of the force, which is short and well resolved
        multiple = (n + 2) * omega
        answer = stiffness * math.hypot(1.0 - multiple**2, 2.0 * lever[col.ALPHA0] * multiple)
        row[col.HARMONIC + n] = math.hypot(in_phase[n], across[n]) / (math.pi * answer)
    m = head[TRANSFER]
    row[col.TRACE] = m[0] + m[3]
    row[col.PRODUCT] = m[0] * m[3] - m[1] * m[2]
    z, v, _, side = state_at(oscillator, tables, orbit, row[col.PHASE] - 0.5 * math.pi)
    row[col.START_Z], row[col.START_V], row[col.START_HELD] = z, v, 0.0 if side == OUTSIDE else 1.0


@kernel
def state_at(
    oscillator: Oscillator, tables: np.ndarray, orbit: Orbit, theta: float
) -> tuple[float, float, float, float]:
    """z [m], dz/dtau [m], the surface's force [N] and the side at an angle of the first harmonic."""
    law, p, lever = oscillator
    omega, stiffness = lever[col.OMEGA], lever[col.STIFFNESS]
    elements, count = orbit.elements, int(orbit.head[COUNT, ELEMENTS])
    begin = elements[0, PLACE, EDGE]
    theta -= 2.0 * math.pi * math.floor((theta - begin) / (2.0 * math.pi))
    e = 0
    while e < count - 1 and elements[e + 1, PLACE, EDGE] <= theta:
        e += 1
    w, u = interpolate(tables, elements, e, theta)
    amplitude = orbit.head[VALUE, A]
    z = amplitude * math.cos(theta) + w
    v = omega * (u - amplitude * math.sin(theta))
    d, side = z - orbit.head[VALUE, Z0], elements[e, PLACE, SIDE]
    return z, v, stiffness * surface_force(law, p, 1.0 / stiffness, side, d, v)[0], side


@kernel
def time_trace(oscillator: Oscillator, tables: np.ndarray, orbit: Orbit, phase: float, trace: np.ndarray) -> None:
    """Fill trace, shape (2, n), with z [m] and force [N] at n equal steps of one period from drive phase 0 on.

    `phase` [rad] is that of the orbit: the first harmonic lags by pi/2 less the phase.
    """
    count = trace.shape[1]
    for i in range(count):
        angle = 2.0 * math.pi * i / count + phase - 0.5 * math.pi
        trace[0, i], _, trace[1, i], _ = state_at(oscillator, tables, orbit, angle)
