"""The free lever: its amplitude and phase, and the lengths and forces that it sets."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.columns import ALPHA0, BASE, LONGRANGE, OMEGA
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, contact_force, longrange_force, longrange_slope


@kernel(light=True)
def free_amplitude(lever: np.ndarray) -> float:
    """Amplitude [m] of the free lever at the drive frequency: theory, Eq. (model-2)."""
    omega = lever[col.OMEGA]
    return lever[col.BASE] / math.hypot(1.0 - omega * omega, 2.0 * lever[col.ALPHA0] * omega)


@kernel
def scale_of(law: Law, p: np.ndarray, lever: np.ndarray, free: float) -> float:
    """Length [m] on which orbits change as the tip comes near: the reach of the long-range force.

    Without one, the indentation at which a force that sets in with contact takes up a third of the drive.
    """
    if p[LONGRANGE] != 0.0:
        return max(reach_of(law, p), 1e-3 * free)
    pull = -contact_force(law, 0.0, p) / lever[col.STIFFNESS]
    if not pull > 0.0:
        return 1e-3 * free
    half = min(0.15 * math.pi * lever[col.BASE] / pull, 0.05)
    return 0.5 * free * half * half


@kernel
def mismatch(lever: np.ndarray, amplitude: float, push: float, drag: float) -> float:
    """Drive needed over drive given, squared, less one: zero on an orbit. See theory, Eq. (averaging-4)."""
    omega = lever[OMEGA]
    x = push + amplitude * (1.0 - omega * omega)
    y = 2.0 * lever[ALPHA0] * omega * amplitude - drag
    return (x * x + y * y) / (lever[BASE] * lever[BASE]) - 1.0


@kernel(light=True)
def phase_of(lever: np.ndarray, guess: np.ndarray) -> float:
    """Phase [rad] from (z0, mean deflection, A, P, S): theory, Eq. (averaging-5)."""
    omega, amplitude = lever[col.OMEGA], guess[col.G_A]
    x = guess[col.G_P] + amplitude * (1.0 - omega * omega)
    return math.atan2(x, 2.0 * lever[col.ALPHA0] * omega * amplitude - guess[col.G_S])


@kernel
def reach_of(law: Law, p: np.ndarray) -> float:
    """Distance [m] over which the long-range force falls, theory, Eq. (model-13): 0 without such a force."""
    if p[LONGRANGE] == 0.0:
        return 0.0
    return abs(2.0 * longrange_force(law, 0.0, p) / longrange_slope(law, 0.0, p))
