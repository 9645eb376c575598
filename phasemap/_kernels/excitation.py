"""Amplitude and phase that the detector sees, from the first harmonic of the tip.

With z = Re(Z exp(i omega tau)), Z = -i A exp(i phase), a linear lever shows A_s exp(i phase_s) = offset + factor A
exp(i phase), with two complex numbers of the lever (`columns.OFFSET_RE` and following; theory, Eq. (lever-5)): 0 and 1
where a force on the tip drives one mode. Orbits obey u0 sin(phase) = P + A kappa' and u0 cos(phase) = A kappa'' - S,
kappa the dynamic stiffness at the tip (theory, Eqs. (model-5) and (averaging-3)). The same for arrays is in
`phasemap.experiment.lever`.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels.columns import DRIVE, DYNAMIC_LOSS, FACTOR_IM, FACTOR_RE, OFFSET_IM, OFFSET_RE
from phasemap._kernels.compilation import kernel
from phasemap._kernels.lever import drive_needed, phase_rate

LEAST_SLOPE = 0.05  # of the amplitude seen with A: that of a branch that can be held, and of a secant that is believed


@kernel(light=True)
def sees_tip(lever: np.ndarray) -> bool:
    """True if the detector sees the motion of the tip itself."""
    return bool(
        lever[OFFSET_RE] == 0.0 and lever[OFFSET_IM] == 0.0 and lever[FACTOR_RE] == 1.0 and lever[FACTOR_IM] == 0.0
    )


@kernel(light=True)
def offset_and_factor(lever: np.ndarray) -> tuple[complex, complex]:
    """The complex numbers offset [m] and factor [1] by which the detector sees the tip."""
    return complex(lever[OFFSET_RE], lever[OFFSET_IM]), complex(lever[FACTOR_RE], lever[FACTOR_IM])


@kernel(light=True)
def detected_components(lever: np.ndarray, along: float, across: float) -> tuple[float, float]:
    """Components (A_s cos(phase_s), A_s sin(phase_s)) [m] that the detector sees, from (A cos(phase), A sin(phase))."""
    return (
        lever[OFFSET_RE] + lever[FACTOR_RE] * along - lever[FACTOR_IM] * across,
        lever[OFFSET_IM] + lever[FACTOR_RE] * across + lever[FACTOR_IM] * along,
    )


@kernel(light=True)
def detected_phasor(lever: np.ndarray, cosine: float, sine: float) -> tuple[float, float]:
    """Cosine and sine part [m] of what the detector sees, from those of the first harmonic of z."""
    along, across = detected_components(lever, sine, cosine)
    return across, along


@kernel(light=True)
def detected_amplitude(lever: np.ndarray, along: float, across: float) -> float:
    """Amplitude A_s [m] that the detector sees, from (A cos(phase), A sin(phase)) of the tip."""
    x, y = detected_components(lever, along, across)
    return math.hypot(x, y)


@kernel
def detected_amplitude_of_orbit(lever: np.ndarray, amplitude: float, push: float, drag: float) -> float:
    """Amplitude [m] that the detector sees of an orbit with this A, P and S."""
    if sees_tip(lever):
        return amplitude
    x, y = drive_needed(lever, amplitude, push, drag)
    return detected_amplitude(lever, amplitude * y / lever[DRIVE], amplitude * x / lever[DRIVE])


@kernel
def detected_rates(
    lever: np.ndarray, orbit: tuple[float, float, float], by: tuple[float, float, float]
) -> tuple[float, float]:
    """Rates of amplitude and phase [rad] that the detector sees, from (A, P, S) of an orbit and their rates."""
    amplitude, by_amplitude = orbit[0], by[0]
    (x, y), (by_x, by_y) = drive_needed(lever, *orbit), drive_needed(lever, *by)
    inverse = 1.0 / lever[DRIVE]
    along, across = detected_components(lever, amplitude * y * inverse, amplitude * x * inverse)
    rate_along = (by_amplitude * y + amplitude * by_y) * inverse
    rate_across = (by_amplitude * x + amplitude * by_x) * inverse
    to_along = lever[FACTOR_RE] * rate_along - lever[FACTOR_IM] * rate_across
    to_across = lever[FACTOR_RE] * rate_across + lever[FACTOR_IM] * rate_along
    by_size = (along * to_along + across * to_across) / math.hypot(along, across)
    return by_size, phase_rate(across, along, to_across, to_along)


@kernel
def detected_amplitude_rate(
    lever: np.ndarray, orbit: tuple[float, float, float], by: tuple[float, float, float]
) -> float:
    """Rate of the amplitude that the detector sees, from (A, P, S) of an orbit and their rates."""
    return by[0] if sees_tip(lever) else detected_rates(lever, orbit, by)[0]


@kernel
def likely_amplitude(lever: np.ndarray, seen: float, side: int) -> float:
    """Amplitude [m] of the lossless orbit that the detector sees as amplitude `seen`, on side 1 (repulsive) or -1.

    Without losses u0 cos(phase) = A kappa''. With r = factor u0/(2 kappa'') such orbits are seen on the circle
    offset + r + r exp(2 i phase): here at the first point from resonance, phase 0, on that is as near to the origin.
    """
    if sees_tip(lever):
        return seen
    offset, factor = offset_and_factor(lever)
    if offset == 0.0:
        return seen / abs(factor)
    most = lever[DRIVE] / lever[DYNAMIC_LOSS]
    radius = 0.5 * most * factor
    middle = offset + radius
    turned = radius * middle.conjugate()
    # |middle + radius exp(2 i phase)|^2 has the cosine of 2 side phase + begin, which is `wanted`.
    begin = side * math.atan2(turned.imag, turned.real)
    wanted = (seen * seen - abs(middle) ** 2 - abs(radius) ** 2) / (2.0 * abs(turned))
    if wanted >= math.cos(begin):
        return most
    twice = math.acos(wanted) - begin if wanted > -1.0 else math.pi
    return most * math.cos(0.5 * min(twice, math.pi))


@kernel
def detected_signal(lever: np.ndarray, amplitude: float, phase: float) -> tuple[float, float]:
    """Amplitude [m] and phase [rad], 0 at free resonance, that the detector sees, from those of the tip."""
    if sees_tip(lever):
        return amplitude, phase
    along, across = detected_components(lever, amplitude * math.cos(phase), amplitude * math.sin(phase))
    return math.hypot(along, across), math.atan2(across, along)


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
    return amplitude_at_phase(lever, seen, phase)


@kernel
def amplitude_at_phase(lever: np.ndarray, seen: float, phase: float) -> float:
    """Larger amplitude A [m] of an orbit of this phase that the detector sees with an amplitude; NaN without one."""
    c, s = math.cos(phase), math.sin(phase)
    along = lever[FACTOR_RE] * c - lever[FACTOR_IM] * s
    across = lever[FACTOR_RE] * s + lever[FACTOR_IM] * c
    square = along * along + across * across
    half = (lever[OFFSET_RE] * along + lever[OFFSET_IM] * across) / square
    rest = half * half + (seen * seen - lever[OFFSET_RE] ** 2 - lever[OFFSET_IM] ** 2) / square
    return math.sqrt(rest) - half if rest >= 0.0 else math.nan
