"""Orbits of the averaged equations at a given amplitude, from far to near."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator, has_longrange
from phasemap._kernels.lever import free_amplitude, scale_of
from phasemap._kernels.orbits.averaged.harmonics import harmonics
from phasemap._kernels.orbits.averaged.sides import UNCLEAR, gap_of_crossing, gap_of_push, mismatch_at_gap
from phasemap._kernels.orbits.harmonic_orbit import (
    HARMONIC_WORDS,
    HarmonicOrbit,
    fill_harmonic_orbit,
    store_harmonic_orbit,
)

SAMPLES = 400  # of the mismatch, denser where the tip just touches
HARDLY_MATTERS = 0.02  # of the way from the setpoint to the free amplitude, in the drive: a pull that is as small
MOST_STEPS_OUT, STEP_OUT = 60, 1.5  # to where it is
MOST_ORBITS = 32  # of one amplitude that are kept, from far to near; a material has a handful


@kernel
def ratio_far_from_surface(oscillator: Oscillator, amplitude: float) -> float:
    """Ratio c = (z0 - A0)/A of a harmonic orbit so far out that the surface hardly matters at this setpoint."""
    p, lever = oscillator.p, oscillator.lever
    free = free_amplitude(lever)
    allowed = HARDLY_MATTERS * abs(1.0 - amplitude / free) * lever[col.DRIVE]
    away = scale_of(oscillator) / free
    for _ in range(MOST_STEPS_OUT):
        if not has_longrange(p) or abs(harmonics(oscillator, free, 1.0 + away)[0]) < allowed:
            break
        away *= STEP_OUT
    return 1.0 + away - p[col.FORMING] / free


@kernel(shared=True)
def averaged_orbits(oscillator: Oscillator, amplitude: float) -> np.ndarray:
    """Averaged orbits with this amplitude, far to near, MOST_ORBITS at most, as rows of HARMONIC_WORDS entries.

    Two branches may be picometres apart, but between them the in-phase force passes zero: those points are sampled too.
    """
    detuned, scale = amplitude * oscillator.lever[col.DYNAMIC_STIFFNESS], scale_of(oscillator)
    start = max(ratio_far_from_surface(oscillator, amplitude), 1.5)
    begin, end = math.asinh(2.0 * start * amplitude / scale), -math.asinh(6.0 * amplitude / scale)
    # Gaps from far off to deep in contact, evenly in asinh(gap / scale): close together where the tip touches.
    gaps, f, count = np.empty(2 * SAMPLES + 2), np.empty(2 * SAMPLES + 2), 0
    before = (0.0, 0.0)
    for i in range(SAMPLES + 1):
        gap = scale * math.sinh(begin + (end - begin) * i / SAMPLES)
        h, push = mismatch_at_gap(oscillator, amplitude, gap)
        if i > 0 and (push > -detuned) != (before[1] > -detuned):
            gaps[count] = gap_of_push(oscillator, amplitude, -detuned, before, (gap, push))
            f[count] = math.log1p(mismatch_at_gap(oscillator, amplitude, gaps[count])[0])
            count += 1
        gaps[count], f[count] = gap, math.log1p(h)
        count += 1
        before = (gap, push)
    rows, harmonic, filled = np.zeros((MOST_ORBITS, HARMONIC_WORDS)), HarmonicOrbit(), 0
    for i in range(1, count):
        if filled == len(rows) or (f[i] > 0.0) == (f[i - 1] > 0.0):
            continue
        gap = gap_of_crossing(oscillator, amplitude, UNCLEAR, 0.0, (gaps[i], f[i]), (gaps[i - 1], f[i - 1]))
        if not math.isnan(gap):
            push, drag, mean = harmonics(oscillator, amplitude, 1.0 + gap / amplitude)
            fill_harmonic_orbit(harmonic, amplitude, 1.0 + gap / amplitude, push, drag, mean)
            store_harmonic_orbit(harmonic, rows[filled])
            filled += 1
    return rows[:filled]
