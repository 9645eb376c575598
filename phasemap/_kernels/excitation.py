"""Amplitude and phase that the detector sees: the first harmonic of the tip less the motion of the lever's base.

With z = Re(Z exp(i omega tau)), Z = -i A exp(i phase), and a base that moves by b cos(omega tau), b = lever[SHAKER], it
sees Z - b; b is 0 where the drive's force acts on the tip itself. Orbits obey u0 sin(phase) = P + A (1 - omega^2) and
u0 cos(phase) = 2 alpha0 omega A - S (theory, Eqs. (model-5) and (averaging-3)). The same for arrays is in
`phasemap.experiment.excitation`.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels.columns import ALPHA0, BASE, OMEGA, SHAKER
from phasemap._kernels.compilation import kernel

CIRCLE_POINTS = 64  # along the orbits without losses
CIRCLE_HALVINGS = 50  # between two of these points
LEAST_SLOPE = 0.05  # of the amplitude seen with A: a flatter secant is not believed


@kernel
def seen_amplitude(lever: np.ndarray, amplitude: float, push: float) -> float:
    """Amplitude [m] that the detector sees of an orbit with this A and P."""
    base = lever[SHAKER]
    if base == 0.0:
        return amplitude
    sine = (push + amplitude * (1.0 - lever[OMEGA] ** 2)) / lever[BASE]
    return math.sqrt(max(amplitude * amplitude + base * base - 2.0 * base * amplitude * sine, 0.0))


@kernel
def seen_rate(lever: np.ndarray, amplitude: float, push: float, by_amplitude: float, by_push: float) -> float:
    """Rate of the amplitude that the detector sees, from the rates of A and P."""
    base = lever[SHAKER]
    if base == 0.0:
        return by_amplitude
    stiff = 1.0 - lever[OMEGA] ** 2
    sine, by_sine = (push + amplitude * stiff) / lever[BASE], (by_push + by_amplitude * stiff) / lever[BASE]
    rate = amplitude * by_amplitude - base * (by_amplitude * sine + amplitude * by_sine)
    return rate / seen_amplitude(lever, amplitude, push)


@kernel
def likely_amplitude(lever: np.ndarray, seen: float, side: int) -> float:
    """A [m] of the orbit without losses that the detector sees with this amplitude, repulsive (1) or attractive (-1).

    Without losses cos(phase) = 2 alpha0 omega A / u0, so that such orbits are on a circle, here walked from resonance.
    """
    base, most = lever[SHAKER], lever[BASE] / (2.0 * lever[ALPHA0] * lever[OMEGA])
    if base == 0.0:
        return seen
    low, high = 0.0, 0.5 * math.pi
    for i in range(1, CIRCLE_POINTS):
        at = 0.5 * math.pi * i / CIRCLE_POINTS
        if _on_circle(most, base, side, at) < seen:
            high = at
            break
        low = at
    for _ in range(CIRCLE_HALVINGS):
        at = 0.5 * (low + high)
        if _on_circle(most, base, side, at) < seen:
            high = at
        else:
            low = at
    return most * math.cos(0.5 * (low + high))


@kernel
def _on_circle(most: float, base: float, side: int, at: float) -> float:
    """Amplitude [m] that the detector sees of the orbit without losses whose phase is `at` times its side."""
    amplitude = most * math.cos(at)
    return math.sqrt(amplitude * amplitude + base * base - 2.0 * side * base * amplitude * math.sin(at))


@kernel
def show(lever: np.ndarray, amplitude: float, phase: float) -> tuple[float, float]:
    """Amplitude [m] and phase [rad] that the detector sees, 0 at free resonance, from those of z."""
    base = lever[SHAKER]
    if base == 0.0:
        return amplitude, phase
    x, y = amplitude * math.sin(phase) - base, amplitude * math.cos(phase)
    return math.hypot(x, y), math.atan2(x, y) + math.atan(2.0 * lever[ALPHA0])


@kernel
def next_amplitude(
    lever: np.ndarray, seen: float, amplitude: float, phase: float, miss: float, before: tuple[float, float]
) -> float:
    """Next amplitude A [m] to try after an orbit of this phase was seen with an amplitude off by `miss`, or NaN.

    By the secant from `before`, the A before this one and its miss, or else as if the phase stayed.
    """
    slope = (miss - before[1]) / (amplitude - before[0])
    if slope > LEAST_SLOPE:
        return amplitude - miss / slope
    rest = seen * seen - (lever[SHAKER] * math.cos(phase)) ** 2
    return lever[SHAKER] * math.sin(phase) + math.sqrt(rest) if rest >= 0.0 else math.nan
