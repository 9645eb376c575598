"""Orbits of the averaged equations at a given amplitude, from far to near."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator, has_longrange
from phasemap._kernels.lever import free_amplitude, mismatch, reach_of, scale_of
from phasemap._kernels.numerics import narrowed
from phasemap._kernels.orbits.averaged.harmonics import harmonics
from phasemap._kernels.orbits.harmonic_orbit import (
    HARMONIC_WORDS,
    HarmonicOrbit,
    centre_height,
    fill_harmonic_orbit,
    store_harmonic_orbit,
)

MOST_ORBITS = 32  # of one amplitude that are kept, from far to near; a material has a handful


@kernel
def root_between(oscillator: Oscillator, amplitude: float, near: float, far: float) -> float:
    """Root c of the mismatch between two values of c at which its signs differ (regula falsi); NaN if they do not."""
    lever = oscillator.lever
    push, drag, _ = harmonics(oscillator, amplitude, near)
    h_near = math.log(1.0 + mismatch(lever, amplitude, push, drag))
    push, drag, _ = harmonics(oscillator, amplitude, far)
    h_far = math.log(1.0 + mismatch(lever, amplitude, push, drag))
    if (h_near > 0.0) == (h_far > 0.0):
        return math.nan
    c = near
    for _ in range(60):
        before = c
        c = (near * h_far - far * h_near) / (h_far - h_near)
        push, drag, _ = harmonics(oscillator, amplitude, c)
        h = math.log(1.0 + mismatch(lever, amplitude, push, drag))
        if abs(h) < 1e-10 or abs(c - before) < 1e-14 * max(1.0, abs(c)):
            break
        near, h_near, far, h_far = narrowed(near, h_near, far, h_far, c, h)
    return c


@kernel
def far_start(oscillator: Oscillator, amplitude: float) -> float:
    """Ratio c = (z0 - A0)/A of a harmonic orbit so far out that the surface hardly matters at this setpoint."""
    p, lever = oscillator.p, oscillator.lever
    free = free_amplitude(lever)
    allowed = 0.02 * abs(1.0 - amplitude / free) * lever[col.DRIVE]
    away = scale_of(oscillator) / free
    for _ in range(60):
        if not has_longrange(p) or abs(harmonics(oscillator, free, 1.0 + away)[0]) < allowed:
            break
        away *= 1.5
    return 1.0 + away - p[col.FORMING] / free


@kernel
def mismatch_slope(oscillator: Oscillator, harmonic: HarmonicOrbit) -> float:
    """Change of the mismatch with the tip offset at fixed amplitude [1/m]."""
    lever = oscillator.lever
    reach, amplitude, e = reach_of(oscillator.p), harmonic.amplitude, centre_height(harmonic)
    small = 1e-5 * (reach if reach > 0.0 else abs(e - amplitude))
    push, drag, _ = harmonics(oscillator, amplitude, (e + small) / amplitude)
    return (mismatch(lever, amplitude, push, drag) - mismatch(lever, amplitude, harmonic.push, harmonic.drag)) / small


@kernel
def in_phase_drive(oscillator: Oscillator, amplitude: float, c: float) -> float:
    """Part of the drive [m] against stiffness, P + A (1 - omega^2): it passes zero between two branches."""
    lever = oscillator.lever
    return harmonics(oscillator, amplitude, c)[0] + amplitude * lever[col.DYNAMIC_STIFFNESS]


@kernel(shared=True)
def averaged_orbits(oscillator: Oscillator, amplitude: float) -> np.ndarray:
    """Averaged orbits with this amplitude, far to near, MOST_ORBITS at most, as rows of HARMONIC_WORDS entries.

    Two branches may be picometres apart, but between them the in-phase force passes zero: those points are sampled too.
    """
    lever = oscillator.lever
    epsilon = scale_of(oscillator) / amplitude
    start = max(far_start(oscillator, amplitude), 1.5)
    zeta, end, samples = math.asinh(2.0 * start / epsilon), -math.asinh(6.0 / epsilon), 400
    at = np.empty(2 * samples + 2)
    above = np.empty(len(at), np.bool_)  # whether an orbit there needs more drive than there is
    count = 0
    x_before = 0.0
    for i in range(samples + 1):
        c = 1.0 + epsilon * math.sinh(zeta + (end - zeta) * i / samples)
        push, drag, _ = harmonics(oscillator, amplitude, c)
        x = push + amplitude * lever[col.DYNAMIC_STIFFNESS]
        if i > 0 and (x > 0.0) != (x_before > 0.0):
            near, far = c, at[count - 1]
            for _ in range(60):
                middle = 0.5 * (near + far)
                if (in_phase_drive(oscillator, amplitude, middle) > 0.0) == (x > 0.0):
                    near = middle
                else:
                    far = middle
            at[count] = 0.5 * (near + far)
            between, lag, _ = harmonics(oscillator, amplitude, at[count])
            above[count] = math.log(1.0 + mismatch(lever, amplitude, between, lag)) > 0.0
            count += 1
        at[count], above[count] = c, math.log(1.0 + mismatch(lever, amplitude, push, drag)) > 0.0
        count += 1
        x_before = x
    rows, harmonic = np.zeros((MOST_ORBITS, HARMONIC_WORDS)), HarmonicOrbit()
    found = 0
    for i in range(1, count):
        if above[i] == above[i - 1]:
            continue
        root = root_between(oscillator, amplitude, at[i], at[i - 1])
        if not math.isnan(root) and found < len(rows):
            push, drag, mean = harmonics(oscillator, amplitude, root)
            fill_harmonic_orbit(harmonic, amplitude, root, push, drag, mean)
            store_harmonic_orbit(harmonic, rows[found])
            found += 1
    return rows[:found]
