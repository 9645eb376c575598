"""A curve of periodic orbits in its plane: its points, scales of its coordinates, orbits across it, its start."""

from __future__ import annotations

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.lever import free_amplitude, scale_of
from phasemap._kernels.orbits.averaged.orbits import ratio_far_from_surface
from phasemap._kernels.orbits.collocation.closing import curve_derivative
from phasemap._kernels.orbits.collocation.held_equation import Equation
from phasemap._kernels.orbits.collocation.linearised import linearise_orbit
from phasemap._kernels.orbits.collocation.newton import MOST_NEWTON_STEPS, NewtonLimits, begin_harmonic, solve_orbit
from phasemap._kernels.orbits.collocation.path import (
    FIXED_PATH,
    HELD_AMPLITUDE,
    Path,
    drift_at,
    held_equation,
    oscillator_at,
)
from phasemap._kernels.orbits.collocation.system import EQUATIONS_OTHER, Orbit, head_of
from phasemap._kernels.orbits.harmonic_orbit import HarmonicOrbit
from phasemap._kernels.records import column, record

# Entries of the values and rates of a point: what is swept, wanted or held is told by its entry.
ENTRY_Z0 = 0
ENTRY_A = 1
ENTRY_M = 2
ENTRY_P = 3
ENTRY_S = 4
ENTRY_SEEN = 5  # the amplitude that the detector sees
OF_AMPLITUDE = 0.2  # natural length of an amplitude, over it


@record
class Point:
    """A point of the curve: the values of its orbit, and the direction of the curve there."""

    value: np.ndarray = column(6)  # z0, A [m], m, P, S, the amplitude that the detector sees [m]
    rate: np.ndarray = column(6)  # their derivatives along the curve; of the last one with the lever as it is
    tangent_u: float  # unit tangent in the scaled coordinates: of the control
    tangent_v: float  # and of the answer
    floquet: float  # largest modulus of a Floquet multiplier
    determinant: float  # det(1 - monodromy)
    length: float  # of the step that led there


@kernel
def gap_scale(reach: float, z0: float, amplitude: float) -> float:
    """Natural length [m] of the gap z0 - A at a point of the curve."""
    return 0.5 * reach + 0.25 * abs(z0 - amplitude)


@kernel
def control_entry(path: Path) -> int:
    """Entry of a point that is swept: the tip offset or m."""
    return ENTRY_Z0 if path.kind == FIXED_PATH else ENTRY_M


@kernel
def answer_entry(path: Path) -> int:
    """Entry that answers the control: the amplitude, or the tip offset where the amplitude is held."""
    return ENTRY_Z0 if path.kind == HELD_AMPLITUDE else ENTRY_A


@kernel
def axis_scales(path: Path, reach: float, z0: float, amplitude: float) -> tuple[float, float]:
    """Natural lengths of the two coordinates that move: theory, Eqs. (continuation-1) and (continuation-6).

    These are z0 and A [m] on a path that is fixed, else the parameter m and the one of z0 and A [m] that is not held.
    """
    gap = gap_scale(reach, z0, amplitude)
    if path.kind == FIXED_PATH:
        return gap, OF_AMPLITUDE * amplitude
    return path.width, gap if path.kind == HELD_AMPLITUDE else min(gap, OF_AMPLITUDE * amplitude)


@kernel
def tangent_row(path: Path, reach: float, point: Point) -> tuple[float, float, float]:
    """The tangent as a row for (dz0, dA, dm), made from the scaled coordinates."""
    u, v = axis_scales(path, reach, point.value[ENTRY_Z0], point.value[ENTRY_A])
    other = point.tangent_v * u / v
    if path.kind == FIXED_PATH:
        return point.tangent_u, other - point.tangent_u, 0.0
    return (other, 0.0, point.tangent_u) if path.kind == HELD_AMPLITUDE else (0.0, other, point.tangent_u)


@kernel
def scaled_direction(path: Path, reach: float, point: Point, dz: float, da: float, dm: float) -> tuple[float, float]:
    """Components of a direction in the scaled coordinates."""
    u, v = axis_scales(path, reach, point.value[ENTRY_Z0], point.value[ENTRY_A])
    if path.kind == FIXED_PATH:
        return (dz - da) / u, da / v
    return dm / u, (dz if path.kind == HELD_AMPLITUDE else da) / v


@kernel
def natural_length(path: Path, orbit: Orbit) -> float:
    """Length [m] on which orbits change along the path, at an orbit."""
    if path.kind == FIXED_PATH:
        return path.reach
    oscillator = oscillator_at(path, head_of(orbit).parameter)
    return scale_of(oscillator)


@kernel
def solve_in_plane(
    path: Path, orbit: Orbit, row: tuple[float, float, float], tolerance: float, most: int, coarse: bool
) -> tuple[int, int]:
    """Solve for the orbit in the plane row (z0, A, m) = const through this one; `coarse` if it is on the way only."""
    (r_z, r_a, r_m), head = row, head_of(orbit)
    equals = r_z * head.tip_offset + r_a * head.amplitude + r_m * head.parameter
    across = Equation(r_z, r_a, r_m, equals, 0.0, 0.0)
    return solve_orbit(
        path, orbit, across, NewtonLimits(head.level, tolerance, most, coarse=coarse, along=True, seen=0.0)
    )


@kernel
def solve_tangent(path: Path, orbit: Orbit, row: tuple[float, float, float]) -> bool:
    """Solve for the derivative along the curve with row (dz0, dA, dm) = 1, left in the last column of the system."""
    m = head_of(orbit).parameter
    oscillator, drift = oscillator_at(path, m), drift_at(path, m)
    if head_of(orbit).equations == EQUATIONS_OTHER and not linearise_orbit(oscillator, orbit, drift):
        return False
    across = Equation(row[0], row[1], row[2], 0.0, 0.0, 0.0)
    return curve_derivative(
        oscillator.lever, orbit, drift, (held_equation(path, oscillator.lever, orbit, drift), across)
    )


@kernel(shared=True)
def solve_far_from_surface(path: Path, orbit: Orbit, amplitude: float) -> int:
    """Find an orbit so far from the surface that its force hardly matters to one of this amplitude [m]; a status.

    The lowest point of the harmonic motion, z0 - A, is held there, as the lever swings almost freely.
    """
    oscillator = oscillator_at(path, 0.0)
    free = free_amplitude(path.lever)
    harmonic = HarmonicOrbit()
    harmonic.tip_offset, harmonic.amplitude = free * ratio_far_from_surface(oscillator, amplitude), free
    held = Equation(1.0, -1.0, 0.0, harmonic.tip_offset - free, 0.0, 0.0)
    if not begin_harmonic(oscillator, orbit, harmonic, 0):
        return col.NOT_CONVERGED
    limits = NewtonLimits(0, 1e-3 * path.reach, MOST_NEWTON_STEPS, coarse=True, along=False, seen=0.0)
    return solve_orbit(path, orbit, held, limits)[0]
