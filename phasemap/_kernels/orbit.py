"""Exact periodic orbits by Newton's method, the elements laid anew after every step."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from phasemap._kernels import columns as col
from phasemap._kernels.collocation import (
    A,
    CONTACTS,
    ELEMENTS,
    HOLD_AMPLITUDE,
    Orbit,
    P,
    S,
    Z0,
    accept,
    close,
    linearise,
    surface_force,
)
from phasemap._kernels.law import OPTIONS, Law
from phasemap._kernels.mesh import PERMANENT, carry_over, find_contacts, lay, reach_of
from phasemap._kernels.tables import NODES, Tables

MOST_STEPS = 30


@njit(**OPTIONS)
def begin(
    law: Law, p: np.ndarray, lever: np.ndarray, tables: Tables, orbit: Orbit, guess: np.ndarray, level: int
) -> bool:
    """Set a harmonic orbit, guess = (z0, mean deflection, A, P, S)."""
    z0, mean, amplitude = guess[0], guess[1], guess[2]
    orbit.value[Z0], orbit.value[A], orbit.value[P], orbit.value[S] = z0, amplitude, guess[3], guess[4]
    c = (z0 - mean) / amplitude
    if c >= 1.0:
        orbit.count[CONTACTS] = 0
        orbit.contact[0, 0] = 0.0
        orbit.contact[0, 1] = (1.0 - c) * amplitude
    elif c <= -1.0:
        orbit.count[CONTACTS] = PERMANENT
        orbit.contact[0, 0] = math.pi
        orbit.contact[0, 1] = (-1.0 - c) * amplitude
    else:
        orbit.count[CONTACTS] = 1
        orbit.contact[0, 0] = -math.acos(c)
        orbit.contact[0, 1] = math.acos(c)
    ok = lay(law, p, lever, tables, orbit, orbit, level)
    count = orbit.count[ELEMENTS]
    orbit.w[:count] = mean
    orbit.u[:count] = 0.0
    orbit.edge_w[: count + 1] = mean
    orbit.edge_u[: count + 1] = 0.0
    return ok


@njit(**OPTIONS)
def newton(
    law: Law,
    p: np.ndarray,
    lever: np.ndarray,
    tables: Tables,
    orbit: Orbit,
    spare: Orbit,
    hold: int,
    target: np.ndarray,
    level: int,
    tolerance: float,
    most: int,
) -> tuple[int, int, Orbit, Orbit]:
    """Iterate to a periodic orbit; return status, steps, the orbit and the spare room.

    `tolerance` [m] is for the last change: the error left is its square over the size of the contact.
    """
    for step in range(most):
        if not linearise(law, p, lever, tables, orbit) or not close(lever, orbit, hold, target):
            return col.NOT_CONVERGED, step, orbit, spare
        change = abs(orbit.system[4, 6] - orbit.value[Z0]) + abs(orbit.system[5, 6])
        limit = 0.5 * orbit.value[A]
        share = 1.0 if change <= limit else limit / change
        change = max(accept(tables, lever, orbit, share), abs(orbit.system[5, 6]))
        if not change < 1e3 * orbit.value[A]:
            return col.NOT_CONVERGED, step, orbit, spare
        if change < tolerance:
            return col.GOOD, step + 1, orbit, spare
        if not find_contacts(tables, orbit) or not lay(law, p, lever, tables, spare, orbit, level):
            return col.TOO_MANY_CONTACTS, step, orbit, spare
        carry_over(tables, orbit, spare)
        orbit, spare = spare, orbit
    return col.NOT_CONVERGED, most, orbit, spare


@njit(**OPTIONS)
def floquet(transfer: np.ndarray) -> float:
    """Return the largest modulus of the multipliers."""
    half = 0.5 * (transfer[0, 0] + transfer[1, 1])
    product = transfer[0, 0] * transfer[1, 1] - transfer[0, 1] * transfer[1, 0]
    root = half * half - product
    if root <= 0.0:
        return math.sqrt(max(product, 0.0))
    return abs(half) + math.sqrt(root)


@njit(**OPTIONS)
def observe(law: Law, p: np.ndarray, lever: np.ndarray, tables: Tables, orbit: Orbit, row: np.ndarray) -> None:
    """Fill a result row from a converged orbit."""
    omega, alpha0, stiffness, base = lever[0], lever[1], lever[2], lever[3]
    amplitude, z0 = orbit.value[A], orbit.value[Z0]
    mean, deepest, air, surface, virial, push, drive = 0.0, -1e300, 0.0, 0.0, 0.0, 0.0, 0.0
    x = orbit.value[P] + amplitude * (1 - omega**2)
    y = 2 * alpha0 * omega * amplitude - orbit.value[S]
    for e in range(orbit.count[ELEMENTS]):
        n, h = orbit.table[e], orbit.scale[e]
        for j in range(NODES):
            weight = h * tables.e1[n, j]
            c, s = orbit.cos[e, j], orbit.sin[e, j]
            z = amplitude * c + orbit.w[e, j]
            v = omega * (orbit.u[e, j] - amplitude * s)
            d = z - z0
            g, _, gv = surface_force(law, p, 1.0 / stiffness, orbit.side[e], d, v)
            deepest = max(deepest, d)
            mean += weight * orbit.w[e, j]
            air += weight * 2.0 * alpha0 * v * v / omega
            surface += weight * gv * v * v / omega
            drive += weight * (x * c - y * s) * v / omega
            virial -= weight * g * z
            push += weight * g * c
    row[:] = math.nan
    row[col.TIP_OFFSET] = z0
    row[col.MEAN] = mean / (2 * math.pi)
    row[col.PHASE] = math.atan2(x, y)
    row[col.AMPLITUDE] = amplitude
    row[col.INDENTATION] = deepest
    row[col.DISSIPATION] = stiffness * surface
    row[col.VIRIAL] = stiffness * virial / (2 * math.pi)
    row[col.FLOQUET] = floquet(orbit.transfer)
    row[col.STIFFENING] = orbit.value[P] / amplitude
    row[col.CLOSURE] = (drive - air - surface) / drive if drive != 0.0 else math.nan
