"""Exact periodic orbits by Newton's method, the elements laid anew after every step."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.excitation import detected_amplitude_of_orbit
from phasemap._kernels.law import Oscillator, contact_force, has_hysteresis, has_longrange, longrange_force
from phasemap._kernels.lever import reach_of
from phasemap._kernels.lever_modes import modes_of, static_share
from phasemap._kernels.orbits.collocation.closing import apply_step, solve_step
from phasemap._kernels.orbits.collocation.contacts_and_necks import PERMANENT
from phasemap._kernels.orbits.collocation.elements import lay_again, lay_elements
from phasemap._kernels.orbits.collocation.held_equation import (
    Equation,
    hold_amplitude,
    hold_detected_setpoint,
    hold_parameter,
)
from phasemap._kernels.orbits.collocation.linearised import linearise_orbit
from phasemap._kernels.orbits.collocation.path import Path, drift_at, fixed_path, held_equation, oscillator_at
from phasemap._kernels.orbits.collocation.system import (
    EQUATIONS_CURRENT,
    EQUATIONS_KEPT,
    PLACES,
    RA,
    RIGHT,
    RP,
    RS,
    RZ,
    Head,
    Orbit,
    element_of,
    head_of,
    motion_of_mode,
    no_drift,
)
from phasemap._kernels.orbits.harmonic_orbit import HarmonicOrbit
from phasemap._kernels.quadrature import NODES

MOST_NEWTON_STEPS = 30
MOST_HELD_STEPS = 15  # of Newton's method, where the amplitude that the detector sees is held
HELD_EXACTLY = 1e-12  # of that amplitude
STILL_ON_THE_WAY = 1e-2  # of the last change allowed on the way: the tangent is off by as little of it
TANGENT_ERROR = 1e-6  # of the contact; so much tangent and multipliers of an exact orbit may be off
LARGEST_STEP = 0.5  # of the amplitude, or of the depth of contact all the time: a longer step is cut
DIVERGES = 1e3  # of the amplitude: a change as large leads to no orbit
NO_JUMP = 1e-9  # of the drive's force: a smaller step of the force at contact is none
HARMLESS_DISPLACEMENT = 2e-6  # of the contact's depth, by which a root of the depth at its edge costs no digit
DRIVE_TOLERANCE = 1e-5  # last change of P and S, over the base amplitude; the phase left is off by its square
COARSE_DRIVE = 1e-2  # the same for points on the way along the curve


class NewtonLimits(NamedTuple):
    """Refinement of the elements, and tolerance to which an orbit is solved for."""

    level: int  # of refinement of its elements
    tolerance: float  # last change [m]: the error left is its square over the size of the contact
    most_steps: int
    coarse: bool  # whether it is one on the way along a curve, less exact
    along: bool  # whether it is one of a curve: what its path holds is held, and the elements go with the contact
    seen: float  # amplitude that the detector is to see [m]: if above 0, it is held in place of the equation given


@kernel
def begin_harmonic(oscillator: Oscillator, orbit: Orbit, harmonic: HarmonicOrbit, level: int) -> bool:
    """Set an orbit to a harmonic one, with elements laid for it; False if it takes too many elements."""
    p = oscillator.p
    z0, mean, amplitude = harmonic.tip_offset, harmonic.mean_deflection, harmonic.amplitude
    head = head_of(orbit)
    head.tip_offset, head.amplitude, head.push, head.drag = z0, amplitude, harmonic.push, harmonic.drag
    c = (z0 - mean) / amplitude
    if c >= 1.0:
        head.contacts = 0
        head.nearest_angle = 0.0
        head.nearest_depth = (1.0 - c) * amplitude
    elif c <= -1.0:
        head.contacts = PERMANENT
        head.nearest_angle = math.pi
        head.nearest_depth = (-1.0 - c) * amplitude
    else:
        head.contacts = 1
        head.contact_start[0] = -math.acos(c)
        head.contact_end[0] = math.acos(c)
        breaks = c + p[col.RELEASE] / amplitude
        head.neck_end[0] = math.acos(breaks) if breaks > -1.0 else 2.0 * math.pi - math.acos(c)
    ok = lay_elements(oscillator, orbit, orbit, level)
    for e in range(head.count + 1):
        element = element_of(orbit, e)
        for j in range(NODES):
            element.w[j], element.u[j] = mean, 0.0
        element.edge_w, element.edge_u = mean, 0.0
    share_motion(oscillator.lever, orbit)
    return ok


@kernel
def share_motion(lever: np.ndarray, orbit: Orbit) -> None:
    """Give the motion at nodes and edges to the modes, by how much each yields to a steady force."""
    for i in range(modes_of(lever)):
        part = static_share(lever, i)
        for e in range(head_of(orbit).count + 1):
            element, motion = element_of(orbit, e), motion_of_mode(orbit, e, i)
            for k in range(PLACES):
                w, u = (element.edge_w, element.edge_u) if k == NODES else (element.w[k], element.u[k])
                motion.w[k], motion.u[k] = part * w, part * u


@kernel
def contact_size(head: Head, reach: float) -> float:
    """Depth [m] on which elements are placed: twice that of the shallowest contact, or gap and reach of force."""
    contacts = head.contacts
    if contacts <= 0:
        return abs(head.nearest_depth) + reach
    half = math.inf
    for i in range(contacts):
        half = min(half, 0.5 * (head.contact_end[i] - head.contact_start[i]))
    return head.amplitude * half * half


@kernel
def force_jumps(oscillator: Oscillator) -> bool:
    """True if the force jumps where the tip comes into contact, or by what it leaves."""
    law, p, lever = oscillator
    pull = contact_force(law, 0.0, p) - (longrange_force(law, 0.0, p) if has_longrange(p) else 0.0)
    return has_hysteresis(p) or not abs(pull) < NO_JUMP * lever[col.STIFFNESS] * lever[col.DRIVE]


@kernel
def allowed_displacement(oscillator: Oscillator, level: int) -> float:
    """Share of the contact's depth by which elements may lie beside it without being moved.

    It is 0 with hysteresis, where the force jumps at contact, and on refined elements (`level` above 0).
    """
    return HARMLESS_DISPLACEMENT if level == 0 and not force_jumps(oscillator) else 0.0


@kernel
def last_step_within_tolerance(lever: np.ndarray, orbit: Orbit, tolerance: float) -> bool:
    """True if the last step was within the tolerance of an exact orbit."""
    head = head_of(orbit)
    return head.change < tolerance and head.turn < DRIVE_TOLERANCE * lever[col.DRIVE]


@kernel(shared=True, vectors=True)
def take_newton_step(lever: np.ndarray, orbit: Orbit, tolerance: float, coarse: bool) -> tuple[int, float]:
    """Take the step just solved. GOOD where it was within tolerance, PENDING, or NOT_CONVERGED; and its size [m]."""
    head = head_of(orbit)
    gain = abs(orbit.system[RA, RIGHT] - head.amplitude)
    change = abs(orbit.system[RZ, RIGHT] - head.tip_offset) + gain
    # Within a contact that lasts all the time a force changes with the depth, which may be many amplitudes.
    limit = LARGEST_STEP * (max(head.amplitude, head.nearest_depth) if head.contacts == PERMANENT else head.amplitude)
    share = 1.0 if change <= limit else limit / change
    turned = abs(orbit.system[RP, RIGHT] - head.push) + abs(orbit.system[RS, RIGHT] - head.drag)
    change = max(apply_step(lever, orbit, share), gain)
    head.change, head.turn = change, turned
    if not change < DIVERGES * head.amplitude:
        return col.NOT_CONVERGED, change
    if change < tolerance and turned < (COARSE_DRIVE if coarse else DRIVE_TOLERANCE) * lever[col.DRIVE]:
        return col.GOOD, change
    return col.PENDING, change


@kernel(shared=True)
def solve_orbit(path: Path, orbit: Orbit, held: Equation, limits: NewtonLimits) -> tuple[int, int]:
    """Solve for a periodic orbit at which an equation holds, by Newton's method; returns status and number of steps.

    Along a curve the equations of the last step are kept for the orbit if the step was small: at most TANGENT_ERROR of
    the contact and the tolerance of an exact orbit, or, on the way, STILL_ON_THE_WAY of the tolerance there.
    """
    level, tolerance, most, coarse, along, seen = limits
    head, oscillator = head_of(orbit), oscillator_at(path, head_of(orbit).parameter)
    still = allowed_displacement(oscillator, level)
    for step in range(most):
        m = head.parameter
        oscillator, drift = oscillator_at(path, m), drift_at(path, m) if along else no_drift()
        p, lever = oscillator.p, oscillator.lever
        if seen > 0.0:
            held = hold_detected_setpoint(lever, orbit, seen)
        if head.equations != EQUATIONS_CURRENT and not linearise_orbit(oscillator, orbit, drift):
            return col.NOT_CONVERGED, step
        first, other = (held_equation(path, lever, orbit, drift), held) if along else (held, hold_parameter(orbit))
        if not solve_step(lever, orbit, drift, (first, other)):
            return col.NOT_CONVERGED, step
        status, change = take_newton_step(lever, orbit, tolerance, coarse)
        size = contact_size(head, reach_of(p))
        if status == col.GOOD and not is_seen(lever, head, seen):
            continue
        if status != col.PENDING:
            if (
                along
                and status == col.GOOD
                and change <= (STILL_ON_THE_WAY * tolerance if coarse else min(tolerance, TANGENT_ERROR * size))
            ):
                head.equations = EQUATIONS_KEPT
            return status, step + 1
        if change < still * size:
            continue  # the elements fit as they lie
        if not lay_again(oscillator, orbit, level):
            return col.TOO_MANY_CONTACTS, step + 1
    return col.NOT_CONVERGED, most


@kernel
def is_seen(lever: np.ndarray, head: Head, seen: float) -> bool:
    """True if the detector sees the amplitude `seen` [m], or need not."""
    if seen <= 0.0:
        return True
    return abs(seen - detected_amplitude_of_orbit(lever, head.amplitude, head.push, head.drag)) < HELD_EXACTLY * seen


@kernel
def solve_at_amplitude(oscillator: Oscillator, orbit: Orbit, level: int, tolerance: float, most: int) -> int:
    """Solve as `solve_orbit` for a periodic orbit with the amplitude that this one has; return the status."""
    limits = NewtonLimits(level, tolerance, most, coarse=False, along=False, seen=0.0)
    return solve_orbit(fixed_path(oscillator), orbit, hold_amplitude(orbit), limits)[0]


@kernel
def solve_at_detected_amplitude(oscillator: Oscillator, orbit: Orbit, seen: float, tolerance: float) -> int:
    """Solve for a periodic orbit that the detector sees with an amplitude [m], from one near it; return the status."""
    limits = NewtonLimits(head_of(orbit).level, tolerance, MOST_HELD_STEPS, coarse=False, along=False, seen=seen)
    return solve_orbit(fixed_path(oscillator), orbit, hold_amplitude(orbit), limits)[0]
