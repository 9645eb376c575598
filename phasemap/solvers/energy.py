"""Energy of one period: what the drive gives, and what the air takes from the first harmonic."""

from __future__ import annotations

import numpy as np

from phasemap._kernels import columns as col

Array = np.ndarray


def supplied(lever: Array, amplitude: Array, phase: Array) -> Array:
    """Work of the drive, pi k u0 A cos(phase) [J per cycle].

    Parameters
    ----------
    lever : ndarray, shape (5,)
        As in `phasemap.solvers.problem.Work`.
    amplitude, phase : ndarray
        Of the first harmonic [m, rad].
    """
    work: Array = np.pi * lever[col.STIFFNESS] * lever[col.BASE] * amplitude * np.cos(phase)
    return work


def lost_in_air(lever: Array, amplitude: Array) -> Array:
    """What the lever's own damping takes from the first harmonic, 2 pi alpha0 omega k A^2 [J per cycle].

    Higher harmonics lose a little more, n^2 (A_n / A)^2 of it each.

    Parameters
    ----------
    lever : ndarray, shape (5,)
        As in `phasemap.solvers.problem.Work`.
    amplitude : ndarray
        [m].
    """
    lost: Array = 2 * np.pi * lever[col.ALPHA0] * lever[col.OMEGA] * lever[col.STIFFNESS] * amplitude**2
    return lost


def close(rows: Array, lever: Array) -> None:
    """Fill in the energy closure of orbits whose solver knows the first harmonic only: averaged and interpolated ones.

    Parameters
    ----------
    rows : ndarray, shape (..., COLUMNS)
        Result rows; those that have a closure keep it.
    lever : ndarray, shape (5,)
        As in `phasemap.solvers.problem.Work`.

    Examples
    --------
    >>> lever, rows = np.array([1.0, 1e-3, 40.0, 4e-11, 0.0]), np.full((2, col.COLUMNS), np.nan)
    >>> rows[0, [col.AMPLITUDE, col.PHASE, col.DISSIPATION]] = 2e-8, 0.0, 0.0  # the free lever: u0 / (2 alpha0)
    >>> close(rows, lever)
    >>> np.abs(rows[:, col.CLOSURE]).round(12).tolist()
    [0.0, nan]
    """
    amplitude, phase = rows[..., col.AMPLITUDE], rows[..., col.PHASE]
    given = supplied(lever, amplitude, phase)
    left = (given - rows[..., col.DISSIPATION] - lost_in_air(lever, amplitude)) / given
    rows[..., col.CLOSURE] = np.where(np.isnan(rows[..., col.CLOSURE]), left, rows[..., col.CLOSURE])
