"""Where a curve of exact orbits begins: far from the surface."""

from __future__ import annotations

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.continuation.path import Path
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever import free_amplitude, reach_of
from phasemap._kernels.orbits.averaged.orbits import far_start
from phasemap._kernels.orbits.collocation.newton import NewtonLimits, begin_harmonic, solve_orbit
from phasemap._kernels.orbits.collocation.system import Equation, Orbit


@kernel(shared=True)
def start_far(path: Path, orbit: Orbit, spare: Orbit, amplitude: float, level: int) -> tuple[int, Orbit, Orbit]:
    """Find the orbit far from the surface, where the lever swings almost freely."""
    law, p, lever, tables = path.law, path.p, path.lever, path.tables
    free = free_amplitude(lever)
    guess = np.array(
        [free * far_start(Oscillator(law, p, lever), reach_of(law, p), free, amplitude), 0.0, free, 0.0, 0.0]
    )
    held = Equation(1.0, -1.0, 0.0, guess[col.G_Z0] - free, 0.0, 0.0)
    if not begin_harmonic(Oscillator(law, p, lever), tables, orbit, guess, level):
        return col.NOT_CONVERGED, orbit, spare
    tolerance = 1e-3 * path.reach
    status, _, orbit, spare = solve_orbit(
        Oscillator(law, p, lever), tables, orbit, spare, held, NewtonLimits(level, tolerance, 30, True)
    )
    return status, orbit, spare
