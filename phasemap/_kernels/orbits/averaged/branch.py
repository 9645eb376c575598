"""Averaged orbits on a branch that is known, near a guess: roots c of the mismatch of the drive."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels.compilation import kernel
from phasemap._kernels.excitation import detected_signal, likely_amplitude, next_amplitude, sees_tip
from phasemap._kernels.law import Oscillator, parameters
from phasemap._kernels.lever import mismatch, phase_of, reach_of
from phasemap._kernels.orbits.averaged.harmonics import harmonics
from phasemap._kernels.orbits.averaged.orbits import averaged_orbits
from phasemap._kernels.orbits.harmonic_orbit import (
    HarmonicOrbit,
    centre_height,
    fill_harmonic_orbit,
    load_harmonic_orbit,
)

# What is measured in an image.
MEASURED_PHASE = 0  # [rad]
MEASURED_OFFSET = 1  # tip offset [m]

MOST_ROOT_STEPS = 14  # of Newton's method for c, and of the search for the amplitude of the tip
EXACT_HOLD = 1e-12  # of the amplitude that is held: as near is exact,
ENOUGH_HOLD = 1e-8  # and as near is enough in the end
AMPLITUDE_DIFFERENCE = 1e-5  # of A, for derivatives with respect to it
C_DIFFERENCE = 1e-4  # of the scale of the mismatch, for derivatives with respect to c
LAST_ROOT_STEP = 1e-5  # of the scale of the mismatch: Newton's last step, whose square is what is left
LONGEST_ROOT_STEP = 0.6  # of the scale of the mismatch


class DetectorSignal(NamedTuple):
    """Amplitude, phase and tip offset of a harmonic orbit as the detector sees it, and the mismatch of its drive."""

    mismatch: float  # of the drive, 0 on an orbit
    amplitude: float  # [m]
    phase: float  # [rad]
    offset: float  # of the tip [m]


@kernel
def mismatch_scale(reach: float, amplitude: float, c: float) -> float:
    """Scale [1] on which the mismatch changes with c: reach of the attraction and lowest height of the tip, over A."""
    return reach / amplitude + abs(c - 1.0) + 1e-9


@kernel
def phase_and_offset(
    lever: np.ndarray, amplitude: float, c: float, push: float, drag: float, mean: float
) -> tuple[float, float]:
    """Phase [rad] and tip offset [m] of a harmonic orbit."""
    return phase_of(lever, amplitude, push, drag), amplitude * c + mean


@kernel
def root_near(oscillator: Oscillator, amplitude: float, side: int, c: float) -> tuple[float, float]:
    """Ratio c of an averaged orbit near a guess, by Newton's method, and the slope of the mismatch there.

    c is the height of the middle of the oscillation over the amplitude. NaN where the steps, which are shares of
    the scale on which the mismatch changes with c, leave the stable branch.
    """
    lever, reach, slope = oscillator.lever, reach_of(oscillator.p), math.nan
    for _ in range(MOST_ROOT_STEPS):
        scale = mismatch_scale(reach, amplitude, c)
        push, drag, _mean = harmonics(oscillator, amplitude, c)
        h = mismatch(lever, amplitude, push, drag)
        near, far, _mean = harmonics(oscillator, amplitude, c + C_DIFFERENCE * scale)
        slope = (mismatch(lever, amplitude, near, far) - h) / (C_DIFFERENCE * scale)
        if not slope < 0.0:
            return math.nan, math.nan
        step = min(max(-h / slope, -LONGEST_ROOT_STEP * scale), LONGEST_ROOT_STEP * scale)
        c += step
        if abs(step) < LAST_ROOT_STEP * scale:
            return (c, slope) if (push > 0.0) == (side > 0) else (math.nan, math.nan)
    return math.nan, math.nan


@kernel
def root_anywhere(oscillator: Oscillator, amplitude: float, side: int) -> tuple[float, float]:
    """Farthest stable root c of the mismatch on this branch, and the slope there; NaN if there is none."""
    candidates, harmonic = averaged_orbits(oscillator, amplitude), HarmonicOrbit()
    for i in range(len(candidates)):
        load_harmonic_orbit(candidates[i], harmonic)
        if (harmonic.push > 0.0) == (side > 0):
            c, slope = root_near(oscillator, amplitude, side, centre_height(harmonic) / amplitude)
            if slope < 0.0:
                return c, slope
    return math.nan, math.nan


@kernel
def stable_root(oscillator: Oscillator, amplitude: float, side: int, search: bool, c: float) -> tuple[float, float]:
    """Stable root c of the mismatch near a guess, or with `search` anywhere, and the slope there; NaN without one."""
    root, slope = root_near(oscillator, amplitude, side, c)
    if search and not slope < 0.0:
        root, slope = root_anywhere(oscillator, amplitude, side)
    return root, slope


@kernel
def fill_orbit_at_root(
    oscillator: Oscillator, amplitude: float, c: float, slope: float, harmonic: HarmonicOrbit
) -> bool:
    """Fill `harmonic` with the averaged orbit at a root c of the mismatch with this slope; returns if it is stable."""
    push, drag, mean = harmonics(oscillator, amplitude, c)
    fill_harmonic_orbit(harmonic, amplitude, c, push, drag, mean)
    harmonic.mismatch_slope = slope / amplitude
    return slope < 0.0


@kernel
def fill_averaged_orbit_near(oscillator: Oscillator, amplitude: float, side: int, harmonic: HarmonicOrbit) -> bool:
    """Fill `harmonic` with the averaged orbit of amplitude A [m] on a side, near its own c; False if none is stable."""
    near = centre_height(harmonic) / harmonic.amplitude
    c, slope = stable_root(oscillator, amplitude, side, True, near)
    return fill_orbit_at_root(oscillator, amplitude, c, slope, harmonic)


@kernel
def detector_signal_of_harmonic_orbit(oscillator: Oscillator, amplitude: float, c: float) -> DetectorSignal:
    """Signal of the detector on a harmonic orbit, and the mismatch of its drive."""
    lever = oscillator.lever
    push, drag, mean = harmonics(oscillator, amplitude, c)
    phase, offset = phase_and_offset(lever, amplitude, c, push, drag, mean)
    seen, turned = detected_signal(lever, amplitude, phase)
    return DetectorSignal(mismatch(lever, amplitude, push, drag), seen, turned, offset)


@kernel
def held_root(
    oscillator: Oscillator, held: float, side: int, search: bool, near: tuple[float, float]
) -> tuple[float, float, float]:
    """Amplitude A [m], root c and slope of the averaged orbit near (A, c) that the detector sees with amplitude `held`.

    A is that of an orbit without losses where it is not known to begin with (NaN).
    """
    lever, (amplitude, c), before = oscillator.lever, near, (math.nan, math.nan)
    if math.isnan(amplitude):
        amplitude = likely_amplitude(lever, held, side)
    for step in range(MOST_ROOT_STEPS):
        c, slope = stable_root(oscillator, amplitude, side, search, c)
        if not slope < 0.0 or sees_tip(lever):
            return amplitude, c, slope
        push, drag, mean = harmonics(oscillator, amplitude, c)
        phase, _ = phase_and_offset(lever, amplitude, c, push, drag, mean)
        miss = detected_signal(lever, amplitude, phase)[0] - held
        if abs(miss) < (EXACT_HOLD if step < MOST_ROOT_STEPS - 1 else ENOUGH_HOLD) * held:
            return amplitude, c, slope
        following = next_amplitude(lever, held, amplitude, phase, miss, before)
        before, amplitude = (amplitude, miss), following
        if not amplitude > 0.0:
            break
    return amplitude, math.nan, math.nan


@kernel
def fill_held_averaged_orbit(
    oscillator: Oscillator, held: float, side: int, near: tuple[float, float], harmonic: HarmonicOrbit
) -> bool:
    """Fill `harmonic` with the averaged orbit of `held_root`, sought anywhere on its side; False if none is stable."""
    amplitude, c, slope = held_root(oscillator, held, side, True, near)
    return slope < 0.0 and fill_orbit_at_root(oscillator, amplitude, c, slope, harmonic)


@kernel
def fill_signal_and_slopes(
    oscillator: Oscillator, at: tuple[float, float], rows: np.ndarray, i: int, step: float, values: np.ndarray,
    slopes: np.ndarray,
) -> None:  # fmt: skip
    """Fill in phase and tip offset of the averaged orbit `at` (A, c), and their derivatives: theory, Eq. (inversion-1).

    `rows` (shape (1 + k, n, ROW)): parameters of n materials, of which this is i, and with each of k logarithms larger
    by `step`.
    `values` (shape (2,)), `slopes` (shape (2, k)): filled.
    """
    law, p, lever = oscillator
    amplitude, c = at
    reach = reach_of(p)
    here = detector_signal_of_harmonic_orbit(oscillator, amplitude, c)
    values[MEASURED_PHASE], values[MEASURED_OFFSET] = here.phase, here.offset
    small, wide = C_DIFFERENCE * mismatch_scale(reach, amplitude, c), AMPLITUDE_DIFFERENCE * amplitude
    moved = detector_signal_of_harmonic_orbit(oscillator, amplitude, c + small)
    h_c, v_c, phase_c, offset_c = (
        (moved.mismatch - here.mismatch) / small, (moved.amplitude - here.amplitude) / small,
        (moved.phase - here.phase) / small, (moved.offset - here.offset) / small,
    )  # fmt: skip
    h_a, v_a, phase_a, offset_a = 0.0, 1.0, 0.0, 0.0
    if not sees_tip(lever):
        moved = detector_signal_of_harmonic_orbit(oscillator, amplitude + wide, c)
        h_a, v_a = (moved.mismatch - here.mismatch) / wide, (moved.amplitude - here.amplitude) / wide
        phase_a, offset_a = (moved.phase - here.phase) / wide, (moved.offset - here.offset) / wide
    for k in range(len(rows) - 1):
        other = parameters(rows[1 + k, i])
        moved = detector_signal_of_harmonic_orbit(Oscillator(law, other, lever), amplitude, c)
        # By how much c and A change for this step of the logarithm: drive and amplitude seen stay.
        h, v = here.mismatch - moved.mismatch, here.amplitude - moved.amplitude
        both = h_c * v_a - h_a * v_c
        along, wider = (h * v_a - v * h_a) / both, (v * h_c - h * v_c) / both
        phase, offset = moved.phase - here.phase, moved.offset - here.offset
        slopes[MEASURED_PHASE, k] = (phase + phase_c * along + phase_a * wider) / step
        slopes[MEASURED_OFFSET, k] = (offset + offset_c * along + offset_a * wider) / step
