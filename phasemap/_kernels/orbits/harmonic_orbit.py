"""A harmonic orbit: what averaging finds and exact solvers start from, with its result row."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.lever import forces_at_phase, phase_of
from phasemap._kernels.numerics import copy
from phasemap._kernels.records import numbers_of, record, words_of


@record
class HarmonicOrbit:
    """The motion z = A0 + A cos(theta) of the tip, and the harmonics of the force on it."""

    tip_offset: float  # z0 [m]
    mean_deflection: float  # A0 [m]
    amplitude: float  # A [m]
    push: float  # P: in-phase part of the force over stiffness [m]
    drag: float  # S: the part out of phase [m]
    mismatch_slope: float  # change of the mismatch with the tip offset at this amplitude [1/m], where it is asked for


HARMONIC_WORDS = words_of(HarmonicOrbit)


@kernel
def fill_harmonic_orbit(
    harmonic: HarmonicOrbit, amplitude: float, c: float, push: float, drag: float, mean: float
) -> None:
    """Fill in all but the slope of a harmonic orbit whose tip first touches at cos(theta) = c."""
    harmonic.tip_offset, harmonic.mean_deflection, harmonic.amplitude = amplitude * c + mean, mean, amplitude
    harmonic.push, harmonic.drag = push, drag


@kernel
def centre_height(harmonic: HarmonicOrbit) -> float:
    """Height e [m] of the middle of the oscillation over the surface."""
    return harmonic.tip_offset - harmonic.mean_deflection


@kernel
def store_harmonic_orbit(harmonic: HarmonicOrbit, row: np.ndarray) -> None:
    """Store a harmonic orbit in the first HARMONIC_WORDS entries of a row."""
    copy(numbers_of(harmonic), row)


@kernel
def load_harmonic_orbit(row: np.ndarray, harmonic: HarmonicOrbit) -> None:
    """Fill in the harmonic orbit that `store_harmonic_orbit` left in a row."""
    copy(row[:HARMONIC_WORDS], numbers_of(harmonic))


@kernel
def fill_row_from_harmonic(lever: np.ndarray, harmonic: HarmonicOrbit, row: np.ndarray) -> None:
    """Fill the result row of a harmonic orbit."""
    z0, mean, amplitude, push = harmonic.tip_offset, harmonic.mean_deflection, harmonic.amplitude, harmonic.push
    stiffness = lever[col.STIFFNESS]
    row[:] = math.nan
    row[col.TIP_OFFSET], row[col.MEAN], row[col.AMPLITUDE] = z0, mean, amplitude
    row[col.PHASE] = phase_of(lever, amplitude, push, harmonic.drag)
    row[col.INDENTATION] = amplitude + mean - z0
    row[col.DISSIPATION] = -math.pi * stiffness * amplitude * harmonic.drag
    row[col.VIRIAL] = stiffness * (mean * mean - 0.5 * amplitude * push)
    row[col.STIFFENING] = push / amplitude


@kernel
def fill_harmonic_from_row(lever: np.ndarray, row: np.ndarray, harmonic: HarmonicOrbit) -> None:
    """Fill in all but the slope of the harmonic orbit of a result row of the tip."""
    amplitude = row[col.AMPLITUDE]
    harmonic.tip_offset, harmonic.mean_deflection, harmonic.amplitude = row[col.TIP_OFFSET], row[col.MEAN], amplitude
    harmonic.push, harmonic.drag = forces_at_phase(lever, amplitude, row[col.PHASE])
