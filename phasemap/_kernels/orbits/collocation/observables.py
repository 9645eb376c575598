"""Observables of an exact orbit: its result row, with forces and harmonics where they are asked, and its time trace."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator, has_hysteresis
from phasemap._kernels.lever import drive_needed
from phasemap._kernels.lever_modes import detected_compliance, mode_of, modes_of
from phasemap._kernels.orbits.collocation.closing import curve_derivative
from phasemap._kernels.orbits.collocation.contacts_and_necks import depth_at, motion_in_element
from phasemap._kernels.orbits.collocation.held_equation import hold_amplitude, hold_parameter
from phasemap._kernels.orbits.collocation.stability import floquet
from phasemap._kernels.orbits.collocation.system import (
    IN_CONTACT,
    OUT_OF_CONTACT,
    RIGHT,
    RZ,
    Orbit,
    element_of,
    head_of,
    motion_of_mode,
    no_drift,
    surface_force,
)
from phasemap._kernels.orbits.energy_balance import energy_closure
from phasemap._kernels.orbits.response.apex import apex_between
from phasemap._kernels.quadrature import NODES, T_END1

PARTS = 4  # of the angle between two nodes, at whose ends the force is taken for its largest


@kernel(shared=True, vectors=True)
def fill_observables(oscillator: Oscillator, orbit: Orbit, row: np.ndarray) -> None:
    """Fill a result row from a converged orbit; energies as in theory, Eqs. (energy-2) and (energy-4)."""
    law, p, lever = oscillator
    omega, stiffness = lever[col.OMEGA], lever[col.STIFFNESS]
    head = head_of(orbit)
    amplitude, z0 = head.amplitude, head.tip_offset
    mean, deepest, surface, virial, drive = 0.0, -1e300, 0.0, 0.0, 0.0
    loop = 0.0  # what a law with hysteresis keeps
    # Of the node before: the tip may be deepest between the last and the first.
    last = element_of(orbit, head.count - 1)
    theta0, w0, u0 = last.theta[-1] - 2.0 * math.pi, last.w[-1], last.u[-1]
    x, y = drive_needed(lever, amplitude, head.push, head.drag)
    for e in range(head.count):
        element = element_of(orbit, e)
        h, table = element.scale, orbit.tables[element.table]
        for j in range(NODES):
            weight = h * table[T_END1, j]
            c, s = element.cos[j], element.sin[j]
            z = amplitude * c + element.w[j]
            v = omega * (element.u[j] - amplitude * s)
            d = z - z0
            g, _, gv = surface_force(law, p, 1.0 / stiffness, element.side, d, v)
            between = apex_between(amplitude, theta0, w0, u0, element.theta[j], element.w[j], element.u[j])
            deepest = max(deepest, d, between - z0)
            theta0, w0, u0 = element.theta[j], element.w[j], element.u[j]
            mean += weight * element.w[j]
            surface += weight * gv * v * v / omega
            loop += weight * (g - gv * v) * v / omega
            drive += weight * (x * c - y * s) * v / omega
            virial -= weight * g * z
    air = math.pi * lever[col.DYNAMIC_LOSS] * amplitude * amplitude + lost_by_harmonics(lever, orbit)
    if has_hysteresis(p):
        surface += loop
    row[:] = math.nan
    row[col.TIP_OFFSET] = z0
    row[col.MEAN] = mean / (2 * math.pi)
    row[col.PHASE] = math.atan2(x, y)
    row[col.AMPLITUDE] = amplitude
    row[col.INDENTATION] = deepest
    row[col.DISSIPATION] = stiffness * surface
    row[col.VIRIAL] = stiffness * virial / (2 * math.pi)
    row[col.FLOQUET] = floquet(head.transfer, 2 * modes_of(lever))
    row[col.STIFFENING] = head.push / amplitude
    row[col.CLOSURE] = energy_closure(drive, air, surface) if drive != 0.0 else math.nan


@kernel
def lost_by_harmonics(lever: np.ndarray, orbit: Orbit) -> float:
    """Energy [m^2] over k that the modes lose in a period by their motion beyond the first harmonic."""
    lost = 0.0
    for i in range(modes_of(lever)):
        by = 2.0 * mode_of(lever, i).rate * lever[col.OMEGA] / mode_of(lever, i).share
        for e in range(head_of(orbit).count):
            element, motion = element_of(orbit, e), motion_of_mode(orbit, e, i)
            for j in range(NODES):
                lost += by * element.scale * orbit.tables[element.table, T_END1, j] * motion.u[j] ** 2
    return lost


@kernel
def fill_row_of_orbit(oscillator: Oscillator, orbit: Orbit, row: np.ndarray) -> int:
    """Fill the row of an orbit that was linearised where it is, or a last small step before; returns a status."""
    lever = oscillator.lever
    fill_observables(oscillator, orbit, row)
    if curve_derivative(lever, orbit, no_drift(), (hold_parameter(orbit), hold_amplitude(orbit))):
        row[col.SLOPE] = 1.0 / orbit.system[RZ, RIGHT]
    return col.GOOD if math.isfinite(row[col.PHASE]) else col.NOT_CONVERGED


@kernel
def complete_row(oscillator: Oscillator, orbit: Orbit, row: np.ndarray) -> None:
    """Fill forces, contact time, harmonics, multipliers and start of a full row, at a linearised orbit."""
    law, p, lever = oscillator
    omega, stiffness = lever[col.OMEGA], lever[col.STIFFNESS]
    head = head_of(orbit)
    amplitude, z0 = head.amplitude, head.tip_offset
    mean, peak, least, contact = 0.0, -math.inf, math.inf, 0.0
    in_phase, across = np.zeros(col.HARMONICS), np.zeros(col.HARMONICS)
    for e in range(head.count):
        element = element_of(orbit, e)
        side, table = element.side, orbit.tables[element.table]
        for j in range(NODES):
            weight = element.scale * table[T_END1, j]
            c, s, w = element.cos[j], element.sin[j], element.w[j]
            d, v = amplitude * c + w - z0, omega * (element.u[j] - amplitude * s)
            force = stiffness * surface_force(law, p, 1.0 / stiffness, side, d, v)[0]
            mean += weight * force
            peak, least = max(peak, force), min(least, force)
            if side == IN_CONTACT:  # with losses the largest force comes before the deepest point, between two nodes
                after = element.theta[j + 1] if j + 1 < NODES else element_of(orbit, e + 1).edge
                for part in range(1, PARTS):
                    d, turn = depth_at(orbit, e, element.theta[j] + (after - element.theta[j]) * part / PARTS)
                    peak = max(peak, stiffness * surface_force(law, p, 1.0 / stiffness, side, d, omega * turn)[0])
            contact += weight if side != OUT_OF_CONTACT else 0.0
            cos_n, sin_n = c, s
            for n in range(col.HARMONICS):
                cos_n, sin_n = cos_n * c - sin_n * s, sin_n * c + cos_n * s
                in_phase[n] += weight * force * cos_n
                across[n] += weight * force * sin_n
        # Where the tip touches or a neck breaks the force may jump to its extreme.
        d = amplitude * math.cos(element.edge) + element.edge_w - z0
        v = omega * (element.edge_u - amplitude * math.sin(element.edge))
        for beside in (side, element_of(orbit, e - 1 if e > 0 else head.count - 1).side):
            force = stiffness * surface_force(law, p, 1.0 / stiffness, beside, d, v)[0]
            peak, least = max(peak, force), min(least, force)
    deepest = row[col.INDENTATION]
    if math.isfinite(deepest):
        side = IN_CONTACT if deepest > 0.0 else OUT_OF_CONTACT
        peak = max(peak, stiffness * surface_force(law, p, 1.0 / stiffness, side, deepest, 0.0)[0])
        if deepest <= 0.0:
            least = min(least, stiffness * surface_force(law, p, 1.0 / stiffness, side, deepest, 0.0)[0])
    row[col.MEAN_FORCE] = mean / (2.0 * math.pi)
    row[col.PEAK_FORCE], row[col.LEAST_FORCE] = peak, least
    row[col.CONTACT_TIME] = contact / (2.0 * math.pi)
    for n in range(col.HARMONICS):  # the lever's answer to the harmonics of the force, which is short and well resolved
        answer = abs(detected_compliance(lever, (n + 2) * omega)) / stiffness
        row[col.HARMONIC + n] = math.hypot(in_phase[n], across[n]) / math.pi * answer
    m = head.transfer
    if lever[col.MODES] == 1.0:
        row[col.TRACE] = m[0] + m[3]
        row[col.PRODUCT] = m[0] * m[3] - m[1] * m[2]
    z, v, _, side = state_at(oscillator, orbit, row[col.PHASE] - 0.5 * math.pi)
    row[col.START_Z], row[col.START_V], row[col.START_HELD] = z, v, 0.0 if side == OUT_OF_CONTACT else 1.0


@kernel
def state_at(oscillator: Oscillator, orbit: Orbit, theta: float) -> tuple[float, float, float, int]:
    """z [m], dz/dtau [m], the surface's force [N] and the side at an angle of the first harmonic."""
    law, p, lever = oscillator
    omega, stiffness = lever[col.OMEGA], lever[col.STIFFNESS]
    count = head_of(orbit).count
    begin = element_of(orbit, 0).edge
    theta -= 2.0 * math.pi * math.floor((theta - begin) / (2.0 * math.pi))
    e = 0
    while e < count - 1 and element_of(orbit, e + 1).edge <= theta:
        e += 1
    w, u = motion_in_element(orbit, e, theta)
    amplitude = head_of(orbit).amplitude
    z = amplitude * math.cos(theta) + w
    v = omega * (u - amplitude * math.sin(theta))
    d, side = z - head_of(orbit).tip_offset, element_of(orbit, e).side
    return z, v, stiffness * surface_force(law, p, 1.0 / stiffness, side, d, v)[0], side


@kernel
def time_trace(oscillator: Oscillator, orbit: Orbit, phase: float, trace: np.ndarray) -> None:
    """Fill trace, shape (2, n), with z [m] and force [N] at n equal steps of one period from drive phase 0 on.

    `phase` [rad] is that of the orbit: the first harmonic lags by pi/2 less the phase.
    """
    count = trace.shape[1]
    for i in range(count):
        angle = 2.0 * math.pi * i / count + phase - 0.5 * math.pi
        trace[0, i], _, trace[1, i], _ = state_at(oscillator, orbit, angle)
