"""How exact interpolated functions of the materials must be, for the variables of an image to be as exact as asked."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.wide import DRAG, GRADIENT, SIDEBANDS
from phasemap._shared.arrays import Array
from phasemap.imaging.interpolation import ExactOrbits
from phasemap.imaging.interpolation.exact_orbits import FUNCTIONS, PHASE
from phasemap.imaging.job import Job
from phasemap.results.quantities import OF_SECOND, answer_of, motion_of
from phasemap.results.variables import OF_ORBITS

DEEPEST = 30.0  # error of the indentation, over that of the height
SHARE, SOME, TINY = 1e-3, 64, 1e-300  # error of an integral over its size, points that tell that, and the least of it
COLUMNS = (GRADIENT, DRAG, SIDEBANDS, SIDEBANDS + 1)  # those of OF_SECOND
OF_ANSWER = 3e-3
"""Error of the second mode's answer over its usual size: a third of what its quadrature is good to."""


def tolerances_of(job: Job, exact: ExactOrbits, sample: Array) -> Array:
    """Largest errors of functions: lengths as the height, energies as what the phase's error does to them.

    Those of integrals over orbits are a share of what they are on average at some points of the sample, or, where only
    a second mode needs them, of what its answer is.

    The indentation is allowed more: the solvers give the deepest of the points at which they evaluate the force, and
    which one that is changes from material to material.
    """
    phase, height = math.radians(job.accuracy.phase), job.accuracy.height
    # The drive's work per cycle is pi k u0 A cos(phase), the virial of the harmonic orbit k u0 A sin(phase) / 2.
    energy = job.scope.cantilever.stiffness * job.scope.base_amplitude * job.amplitude * phase
    limits = {
        col.TIP_OFFSET: height, col.MEAN: height, col.INDENTATION: DEEPEST * height, col.PHASE: phase,
        col.DISSIPATION: math.pi * energy, col.VIRIAL: 0.5 * energy,
    }  # fmt: skip
    if exact.functions != FUNCTIONS and len(sample):
        known = exact(sample[:SOME], in_time=False)
        known = known[np.isfinite(known).all(axis=1)]
        limits |= _of_integrals(exact.functions, known)
        asked = {column for name in job.names for column in OF_ORBITS.get(name, ())}
        limits |= {column: limit for column, limit in _of_answer(job, exact, known).items() if column not in asked}
    return np.array([limits.get(column, TINY) for column in exact.functions])


def _of_integrals(functions: tuple[int, ...], known: Array) -> dict[int, float]:
    """A share of the usual size, of both parts of a complex number alike."""
    usual = abs(known).mean(axis=0) if len(known) else np.ones(len(functions))
    size = dict(zip(functions, usual.tolist(), strict=True))
    pairs = {pair for pair in OF_ORBITS.values() if pair[0] in size}
    return {part: SHARE * max(*(size[one] for one in pair), TINY) for pair in pairs for part in pair if part in size}


def _of_answer(job: Job, exact: ExactOrbits, known: Array) -> dict[int, float]:
    """Largest errors of the integrals that a second mode needs: what changes its answer by so much.

    What the surface adds to its stiffness and damping counts over k2, and together with its own 1/Q2 unless a loop
    holds its phase.
    """
    mode, scope = job.scope.second_mode, job.scope
    if mode is None or not set(OF_SECOND) <= set(job.needs) or not len(known):
        return {}
    values = dict(zip(exact.functions, known.T, strict=True))
    orbit = dict(zip(OF_SECOND, (values[column] for column in COLUMNS), strict=True))
    answer = answer_of(motion_of(scope, np.full(len(known), job.amplitude), np.degrees(known[:, PHASE]), orbit))
    usual = float(np.mean(abs(answer.real if mode.detection == "fm" else answer)))
    stiffness = OF_ANSWER * mode.stiffness * max(usual, TINY)
    drag = stiffness * scope.cantilever.resonance_frequency / (scope.cantilever.stiffness * mode.frequency)
    return dict(zip(COLUMNS, (stiffness, drag, stiffness, stiffness), strict=True))
