"""Where a curve of exact orbits begins: far from the surface."""

from __future__ import annotations

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.lever import free_amplitude, reach_of
from phasemap._kernels.orbits.averaged.orbits import far_start
from phasemap._kernels.orbits.collocation.newton import NewtonLimits, begin_harmonic, solve_orbit
from phasemap._kernels.orbits.collocation.path import Path, standing_at
from phasemap._kernels.orbits.collocation.system import Equation, Orbit


@kernel(shared=True)
def start_far(path: Path, orbit: Orbit, amplitude: float, level: int) -> int:
    """Find the orbit far from the surface, where the lever swings almost freely."""
    oscillator = standing_at(path, 0.0)
    reach, free = reach_of(path.law, path.p), free_amplitude(path.lever)
    guess = np.array([free * far_start(oscillator, reach, free, amplitude), 0.0, free, 0.0, 0.0])
    held = Equation(1.0, -1.0, 0.0, guess[col.G_Z0] - free, 0.0, 0.0)
    if not begin_harmonic(oscillator, orbit, guess, level):
        return col.NOT_CONVERGED
    return solve_orbit(path, orbit, held, NewtonLimits(level, 1e-3 * path.reach, 30, True, False, 0.0))[0]
