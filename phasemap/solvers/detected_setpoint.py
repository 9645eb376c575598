"""Orbits at which the detector shows the setpoint, where what it sees is not the position of the tip.

Which amplitude A of z the detector shows as the setpoint depends on the phase. Engagement from far holds what is seen
itself (`phasemap._kernels.engagement.detected_setpoint`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels import columns as col
from phasemap._kernels.columns import ErrorLimits
from phasemap._kernels.rows.answers import Answers
from phasemap._shared.arrays import Array
from phasemap.experiment.lever import (
    detected_signal,
    in_proportion,
    lost_in_air,
    offset_and_factor,
    seen,
    supplied,
    tip_seen,
)
from phasemap.solvers.problem import Work

Found = tuple[Array, NDArray[np.int8], NDArray[np.int8]]
"""Result rows, status and solver codes."""


def engage(work: Work, limits: ErrorLimits, answers: Answers) -> None:
    """Orbits of the tip that curves of orbits give after engagement."""
    from phasemap._kernels.quadrature import TABLES
    from phasemap._kernels.rows.exact import seen_rows

    rows, slopes = answers.rows, np.full((len(work), 3), np.nan)
    seen_rows(work.pixels, TABLES, limits, answers, slopes)
    good = answers.status == col.GOOD
    orbits = rows[good, : col.COLUMNS]
    rows[good, : col.COLUMNS] = at_seen(orbits, slopes[good], work.lever, work.amplitudes[good])


def at_tip(work: Work) -> Work:
    """The work that solvers know: where the amplitude that is seen is that of z times a number, work of the tip."""
    if not in_proportion(work.lever):
        return work
    return replace(work, lever=tip_seen(work.lever), amplitudes=work.amplitudes / abs(offset_and_factor(work.lever)[1]))


def close(rows: Array, lever: Array) -> None:
    """Fill in the energy closure of orbits whose solver knows the first harmonic only: averaged and interpolated ones.

    `rows` (shape (..., COLUMNS)): result rows; those that have a closure keep it.
    `lever` (shape (n,)): as in `phasemap.solvers.problem.Work`.
    """
    lacking = np.isnan(rows[..., col.CLOSURE])
    if not lacking.any():
        return
    amplitude, phase = rows[..., col.AMPLITUDE], rows[..., col.PHASE]
    given = supplied(lever, amplitude, phase)
    left = (given - rows[..., col.DISSIPATION] - lost_in_air(lever, amplitude)) / given
    rows[..., col.CLOSURE] = np.where(lacking, left, rows[..., col.CLOSURE])


def shown(rows: Array, work: Work) -> Array:
    """Result rows as the detector sees them, from those of `at_tip(work)`; with the energies that they lack."""
    close(rows, work.lever)
    if in_proportion(work.lever):
        rows[:, [col.SLOPE, col.SPREAD_AMPLITUDE]] *= abs(offset_and_factor(work.lever)[1])
    return seen(rows, work.lever)


def at_seen(rows: Array, slopes: Array, lever: Array, size: Array) -> Array:
    """Rows of the tip with errors and the slope of the feedback at a given amplitude seen, from those at a given A.

    `slopes` (shape (n, 3)): of amplitude seen, phase and tip offset with A.
    `size` (shape (n,)): the amplitude that is to be seen [m].
    """
    rows, (offset, factor) = rows.copy(), offset_and_factor(lever)
    a, phase, error = rows[:, col.AMPLITUDE], rows[:, col.PHASE], rows[:, col.ERROR_PHASE].copy()
    # A phase that is off by one is seen off by `turn`, in an amplitude that is off by `grow`.
    part = factor * a * np.exp(1j * phase)
    share = part / (offset + part)
    turn, grow = share.real, -size * share.imag
    by_size, by_phase, by_offset = slopes.T
    # As the amplitude seen changes by one: phase seen, and tip offset.
    phase_rate, offset_rate = (share.imag / a + turn * by_phase) / by_size, by_offset / by_size
    missed = np.abs(detected_signal(lever, a, phase)[0] - size)
    rows[:, col.ERROR_HEIGHT] += np.abs(offset_rate) * (np.abs(grow) * error + missed)
    rows[:, col.ERROR_PHASE] = np.abs(turn - grow * phase_rate) * error + np.abs(phase_rate) * missed
    rows[:, col.SLOPE] *= by_size
    return rows
