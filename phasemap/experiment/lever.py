"""The lever as arrays: its numbers, and the energies that its first harmonic tells of."""

from __future__ import annotations

from typing import Any

import numpy as np

from phasemap._kernels import columns as col
from phasemap.experiment.microscope import Microscope

Array = np.ndarray


def lever_of(scope: Microscope) -> Array:
    """The lever as the kernels know it, shape (5,).

    omega [1], alpha0 [1], stiffness [N/m], amplitude of the drive [m], and that of the base [m]: the drive's, or 0.
    """
    lever, drive = scope.cantilever, scope.base_amplitude
    base = drive if scope.drive.excitation == "base" else 0.0
    return np.array([scope.frequency_ratio, lever.damping_ratio, lever.stiffness, drive, base])


def supplied(lever: Array, amplitude: Array, phase: Array) -> Array:
    """Work of the drive, pi k u0 A cos(phase) [J per cycle].

    `lever` (shape (..., 5)): as of `lever_of`.
    `amplitude`, `phase`: of the first harmonic [m, rad].
    """
    work: Array = np.pi * lever[..., col.STIFFNESS] * lever[..., col.BASE] * amplitude * np.cos(phase)
    return work


def lost_in_air(lever: Array, amplitude: Array) -> Array:
    """What the lever's own damping takes from the first harmonic, 2 pi alpha0 omega k A^2 [J per cycle].

    Higher harmonics lose a little more, n^2 (A_n / A)^2 of it each.

    `lever` (shape (..., 5)): as of `lever_of`.
    `amplitude`: [m].
    """
    lost: Array = 2 * np.pi * lever[..., col.ALPHA0] * lever[..., col.OMEGA] * lever[..., col.STIFFNESS] * amplitude**2
    return lost


def virial_of(lever: Array, amplitude: Any, phase: Any) -> Array:
    """Virial of the surface's force in the first harmonic, A^2 k (1 - omega^2) / 2 - k u0 A sin(phase) / 2 [J].

    Positive for attraction. San Paulo and Garcia, Phys. Rev. B 64, 193411 (2001), at resonance.

    `lever` (shape (..., 5)): as of `lever_of`.
    `amplitude`, `phase`: of the first harmonic of the tip [m, rad].
    """
    stiff = amplitude * (1 - lever[..., col.OMEGA] ** 2)
    virial: Array = 0.5 * lever[..., col.STIFFNESS] * amplitude * (stiff - lever[..., col.BASE] * np.sin(phase))
    return virial
