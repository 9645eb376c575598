"""Exact periodic orbits by Newton's method, the elements laid anew after every step."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator, contact_force, longrange_force
from phasemap._kernels.lever import drive_needed, reach_of
from phasemap._kernels.orbits.collocation.closing import accept, along, close
from phasemap._kernels.orbits.collocation.contacts import PERMANENT, find_contacts
from phasemap._kernels.orbits.collocation.elements import carry_over, lay
from phasemap._kernels.orbits.collocation.system import (
    AT,
    BROKEN,
    CHANGE,
    CONTACT,
    CONTACTS,
    COS,
    COUNT,
    EDGE_U,
    EDGE_W,
    ELEMENTS,
    FIRST,
    GAP,
    HOLD_ARC,
    LAST,
    LINEAR,
    PLACE,
    RA,
    RIGHT,
    RP,
    RS,
    RZ,
    SCALE,
    SIDE,
    SIN,
    SYSTEM,
    TABLE,
    THETA,
    TRANSFER,
    TURN,
    VALUE,
    Z0,
    A,
    Orbit,
    P,
    S,
    U,
    W,
    linearise,
    no_drift,
    surface_force,
)
from phasemap._kernels.orbits.response.apex import apex_between
from phasemap._kernels.quadrature import NODES, T_END1

MOST_STEPS = 30
COARSE_DRIVE = 1e-2  # the same for points on the way along the curve
DRIVE_TOLERANCE = 1e-5  # last change of P and S, over the base amplitude; the phase left is off by its square


@kernel
def begin(oscillator: Oscillator, tables: np.ndarray, orbit: Orbit, guess: np.ndarray, level: int) -> bool:
    """Set a harmonic orbit, guess = (z0, mean deflection, A, P, S)."""
    p = oscillator.p
    z0, mean, amplitude = guess[col.G_Z0], guess[col.G_MEAN], guess[col.G_A]
    head = orbit.head
    head[VALUE, Z0], head[VALUE, A], head[VALUE, P], head[VALUE, S] = z0, amplitude, guess[col.G_P], guess[col.G_S]
    c = (z0 - mean) / amplitude
    if c >= 1.0:
        head[COUNT, CONTACTS] = 0
        head[CONTACT, AT] = 0.0
        head[CONTACT, GAP] = (1.0 - c) * amplitude
    elif c <= -1.0:
        head[COUNT, CONTACTS] = PERMANENT
        head[CONTACT, AT] = math.pi
        head[CONTACT, GAP] = (-1.0 - c) * amplitude
    else:
        head[COUNT, CONTACTS] = 1
        head[CONTACT, FIRST] = -math.acos(c)
        head[CONTACT, LAST] = math.acos(c)
        breaks = c + p[col.RELEASE] / amplitude
        head[CONTACT, BROKEN] = math.acos(breaks) if breaks > -1.0 else 2.0 * math.pi - math.acos(c)
    ok = lay(oscillator, tables, orbit, orbit, level)
    for e in range(int(head[COUNT, ELEMENTS]) + 1):
        one = orbit.elements[e]
        one[W] = mean
        one[U] = 0.0
        one[PLACE, EDGE_W], one[PLACE, EDGE_U] = mean, 0.0
    return ok


@kernel
def contact_size(head: np.ndarray, reach: float) -> float:
    """Depth [m] that matters to where elements lie: of the shallowest contact, or of the gap and the force's reach."""
    contacts = int(head[COUNT, CONTACTS])
    if contacts <= 0:
        return abs(head[CONTACT, GAP]) + reach
    half = math.inf
    for i in range(contacts):
        half = min(half, 0.5 * (head[CONTACT + i, LAST] - head[CONTACT + i, FIRST]))
    return head[VALUE, A] * half * half


@kernel
def stillness(oscillator: Oscillator, level: int) -> float:
    """How much of a contact the elements may lie beside it: a millionth, unless the force itself jumps there."""
    law, p, lever = oscillator
    pull = contact_force(law, 0.0, p) - (longrange_force(law, 0.0, p) if p[col.LONGRANGE] != 0.0 else 0.0)
    if p[col.RELEASE] != 0.0 or not abs(pull) < 1e-9 * lever[col.STIFFNESS] * lever[col.BASE]:
        return 0.0
    return 2e-6 if level == 0 else 0.0


@kernel
def settled(lever: np.ndarray, orbit: Orbit, tolerance: float) -> bool:
    """Whether the last step was one within the tolerance of an exact orbit."""
    count = orbit.head[COUNT]
    return count[CHANGE] < tolerance and count[TURN] < DRIVE_TOLERANCE * lever[col.BASE]


@kernel(shared=True, vectors=True)
def take(tables: np.ndarray, lever: np.ndarray, orbit: Orbit, tolerance: float, coarse: bool) -> tuple[int, float]:
    """Take the step just solved. GOOD where it was within tolerance, PENDING, or NOT_CONVERGED; and its size [m]."""
    head = orbit.head
    change = abs(head[SYSTEM + RZ, RIGHT] - head[VALUE, Z0]) + abs(head[SYSTEM + RA, RIGHT])
    limit = 0.5 * head[VALUE, A]
    share = 1.0 if change <= limit else limit / change
    turned = abs(head[SYSTEM + RP, RIGHT] - head[VALUE, P]) + abs(head[SYSTEM + RS, RIGHT] - head[VALUE, S])
    change = max(accept(tables, lever, orbit, share), abs(head[SYSTEM + RA, RIGHT]))
    head[COUNT, CHANGE], head[COUNT, TURN] = change, turned
    if not change < 1e3 * head[VALUE, A]:
        return col.NOT_CONVERGED, change
    if change < tolerance and turned < (COARSE_DRIVE if coarse else DRIVE_TOLERANCE) * lever[col.BASE]:
        return col.GOOD, change
    return col.PENDING, change


@kernel(shared=True)
def newton(
    oscillator: Oscillator,
    tables: np.ndarray,
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
    law, p, lever = oscillator
    reach, still = reach_of(law, p), stillness(oscillator, level)
    for step in range(most):
        linear = orbit.head[COUNT, LINEAR] == 1.0 or linearise(oscillator, tables, orbit, no_drift())
        if not linear or not close(lever, orbit, hold, target):
            return col.NOT_CONVERGED, step, orbit, spare
        status, change = take(tables, lever, orbit, tolerance, hold == HOLD_ARC)
        if status != col.PENDING:
            return status, step + (status == col.GOOD), orbit, spare
        if change < still * contact_size(orbit.head, reach):
            continue  # the elements fit as they lie
        if not find_contacts(p, tables, orbit) or not lay(oscillator, tables, spare, orbit, level):
            return col.TOO_MANY_CONTACTS, step, orbit, spare
        carry_over(tables, orbit, spare)
        orbit, spare = spare, orbit
    return col.NOT_CONVERGED, most, orbit, spare


@kernel
def floquet(transfer: np.ndarray) -> float:
    """Return the largest modulus of the multipliers: theory, Eq. (stability-3)."""
    half = 0.5 * (transfer[0] + transfer[3])
    product = transfer[0] * transfer[3] - transfer[1] * transfer[2]
    root = half * half - product
    if root <= 0.0:
        return math.sqrt(max(product, 0.0))
    return abs(half) + math.sqrt(root)


@kernel(shared=True, vectors=True)
def observe(oscillator: Oscillator, tables: np.ndarray, orbit: Orbit, row: np.ndarray) -> None:
    """Fill a result row from a converged orbit; energies as in theory, Eqs. (energy-2) and (energy-4)."""
    law, p, lever = oscillator
    omega, alpha0, stiffness = lever[col.OMEGA], lever[col.ALPHA0], lever[col.STIFFNESS]
    head = orbit.head
    amplitude, z0 = head[VALUE, A], head[VALUE, Z0]
    mean, deepest, air, surface, virial, push, drive = 0.0, -1e300, 0.0, 0.0, 0.0, 0.0, 0.0
    loop = 0.0  # what a law with hysteresis keeps
    # Of the node before: the tip may be deepest between the last and the first.
    last = orbit.elements[int(head[COUNT, ELEMENTS]) - 1]
    theta0, w0, u0 = last[THETA, NODES - 1] - 2.0 * math.pi, last[W, NODES - 1], last[U, NODES - 1]
    x, y = drive_needed(lever, amplitude, head[VALUE, P], head[VALUE, S])
    for e in range(int(head[COUNT, ELEMENTS])):
        one = orbit.elements[e]
        h, table = one[PLACE, SCALE], tables[int(one[PLACE, TABLE])]
        for j in range(NODES):
            weight = h * table[T_END1, j]
            c, s = one[COS, j], one[SIN, j]
            z = amplitude * c + one[W, j]
            v = omega * (one[U, j] - amplitude * s)
            d = z - z0
            g, _, gv = surface_force(law, p, 1.0 / stiffness, one[PLACE, SIDE], d, v)
            between, _ = apex_between(amplitude, theta0, w0, u0, one[THETA, j], one[W, j], one[U, j])
            deepest = max(deepest, d, between - z0)
            theta0, w0, u0 = one[THETA, j], one[W, j], one[U, j]
            mean += weight * one[W, j]
            air += weight * 2.0 * alpha0 * v * v / omega
            surface += weight * gv * v * v / omega
            loop += weight * (g - gv * v) * v / omega
            drive += weight * (x * c - y * s) * v / omega
            virial -= weight * g * z
            push += weight * g * c
    if p[col.RELEASE] != 0.0:
        surface += loop
    row[:] = math.nan
    row[col.TIP_OFFSET] = z0
    row[col.MEAN] = mean / (2 * math.pi)
    row[col.PHASE] = math.atan2(x, y)
    row[col.AMPLITUDE] = amplitude
    row[col.INDENTATION] = deepest
    row[col.DISSIPATION] = stiffness * surface
    row[col.VIRIAL] = stiffness * virial / (2 * math.pi)
    row[col.FLOQUET] = floquet(head[TRANSFER])
    row[col.STIFFENING] = head[VALUE, P] / amplitude
    row[col.CLOSURE] = (drive - air - surface) / drive if drive != 0.0 else math.nan


@kernel
def report(oscillator: Oscillator, tables: np.ndarray, orbit: Orbit, row: np.ndarray) -> int:
    """Fill the row of an orbit that was linearised where it is, or a last small step before; returns a status."""
    lever = oscillator.lever
    observe(oscillator, tables, orbit, row)
    if along(lever, orbit, 0.0, 1.0):
        row[col.SLOPE] = 1.0 / orbit.head[SYSTEM + RZ, RIGHT]
    return col.GOOD if math.isfinite(row[col.PHASE]) else col.NOT_CONVERGED


@kernel
def finish(oscillator: Oscillator, tables: np.ndarray, orbit: Orbit, row: np.ndarray) -> int:
    """Linearise about a converged orbit and fill its row; returns a status."""
    if not linearise(oscillator, tables, orbit, no_drift()):
        return col.NOT_CONVERGED
    return report(oscillator, tables, orbit, row)
