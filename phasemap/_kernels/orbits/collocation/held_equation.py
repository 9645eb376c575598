"""The equation that is solved with an orbit by collocation, for what is held: amplitude, offset or parameter.

An amplitude is that of the tip, or as the detector sees it. `solve_orbit` (`newton.py`) solves one with the orbit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phasemap._kernels.compilation import kernel
from phasemap._kernels.excitation import detected_amplitude_of_orbit, detected_amplitude_rate
from phasemap._kernels.orbits.collocation.system import Orbit, head_of

# What is held while solving.
HOLD_AMPLITUDE = 0
HOLD_OFFSET = 1


class Equation(NamedTuple):
    """A linear equation that is held: normal (z0, A, m, P, S) = equals."""

    normal_z: float
    normal_a: float
    normal_m: float
    equals: float
    normal_p: float
    normal_s: float


@kernel
def hold_amplitude(orbit: Orbit) -> Equation:
    """The equation that holds the amplitude of the tip that an orbit has."""
    return Equation(0.0, 1.0, 0.0, head_of(orbit).amplitude, 0.0, 0.0)


@kernel
def hold_detected_setpoint(lever: np.ndarray, orbit: Orbit, seen: float) -> Equation:
    """The equation by which the detector sees the setpoint, an amplitude [m], linearised about an orbit."""
    head = head_of(orbit)
    harmonic = (head.amplitude, head.push, head.drag)
    by_a, by_p = (
        detected_amplitude_rate(lever, harmonic, (1.0, 0.0, 0.0)),
        detected_amplitude_rate(lever, harmonic, (0.0, 1.0, 0.0)),
    )
    by_s = detected_amplitude_rate(lever, harmonic, (0.0, 0.0, 1.0))
    lacks = seen - detected_amplitude_of_orbit(lever, head.amplitude, head.push, head.drag)
    return Equation(0.0, by_a, 0.0, lacks + by_a * harmonic[0] + by_p * harmonic[1] + by_s * harmonic[2], by_p, by_s)


@kernel
def hold_offset(z0: float) -> Equation:
    """The equation that holds a tip offset [m]."""
    return Equation(1.0, 0.0, 0.0, z0, 0.0, 0.0)


@kernel
def hold_parameter(orbit: Orbit) -> Equation:
    """The equation that holds the parameter m where an orbit has it."""
    return Equation(0.0, 0.0, 1.0, head_of(orbit).parameter, 0.0, 0.0)
