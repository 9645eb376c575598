"""The lever as arrays: its numbers, energies of its first harmonic, and the signal of the detector."""

from __future__ import annotations

from typing import Any

import numpy as np

from phasemap._kernels import columns as col
from phasemap._shared.arrays import Array
from phasemap.experiment.microscope import Microscope


def lever_of(scope: Microscope) -> Array:
    """The lever of n modes as the kernels know it, shape (MODE + MODE_NUMBERS n,): theory, Eqs. (lever-1) to (lever-5).

    With x_i the displacement of the tip by mode i and Y the base, z_i = x_i + B_i Y obeys z_i'' + 2 alpha_i z_i' +
    w_i^2 z_i = pulled_i cos(omega tau) - share_i F/k, and z = sum z_i + rigid cos(omega tau), rigid = (1 - sum B_i) Y.
    """
    modes, weights, omega = scope.cantilever.eigenmodes, np.array(scope.detector_weights), scope.frequency_ratio
    based, first = scope.drive.excitation == "base", scope.cantilever.damping_ratio
    w = np.array([one.frequency_ratio for one in modes])
    rate = np.array([first, *(0.5 * one.frequency_ratio / one.quality_factor for one in modes[1:])])
    share = w**2 / np.array([one.stiffness_ratio for one in modes], np.float64)
    part = np.array([one.participation for one in modes], np.float64)
    moved = scope.base_amplitude * part if based else np.zeros(len(modes))  # B_i Y
    pulled, rigid = (w**2 * moved, scope.base_amplitude - moved.sum()) if based else (scope.base_amplitude * share, 0.0)
    if not based and len(modes) == 1 and weights[0] == 1:
        return one_mode(omega, first, scope.cantilever.stiffness, scope.base_amplitude)  # to the last bit
    lever = np.zeros(col.MODE + col.MODE_NUMBERS * len(modes))
    lever[[col.OMEGA, col.ALPHA0, col.STIFFNESS, col.RIGID]] = omega, first, scope.cantilever.stiffness, rigid
    lever[col.MODES] = len(modes)
    if (second := scope.drive.second) is not None:
        lever[[col.SECOND_FREE, col.SECOND_HELD]] = second.free_amplitude, second.detection == "fm"
    lever[col.MODE :] = np.stack([w, rate, share, pulled, weights], axis=1).reshape(-1)
    # Written so that with one mode all is a polynomial of omega, or constant, to the last bit.
    stiff = w**2 - omega**2 + 2j * rate * omega
    others = share[1:] * stiff[0] / (share[0] * stiff[1:])  # compliance over that of the first mode
    kappa = stiff[0] / share[0] / (1 + others.sum())
    drive = pulled[0] / share[0] + (pulled[1:] - pulled[0] / share[0] * share[1:]) @ (kappa / stiff[1:]) + kappa * rigid
    factor = (weights[0] + weights[1:] @ others) / (1 + others.sum())
    turn = drive / abs(drive)
    lever[[col.DYNAMIC_STIFFNESS, col.DYNAMIC_LOSS]] = kappa.real, kappa.imag
    lever[[col.DRIVE, col.TURN_COS, col.TURN_SIN]] = abs(drive), turn.real, turn.imag
    resonant = scope.free_signal(1.0) / 1j  # there the drive is ahead of the one here by a quarter of a turn
    ahead = abs(resonant) / resonant
    offset = ahead * (((weights - factor) * pulled) @ (1 / stiff) - weights @ moved - factor * rigid) if based else 0j
    factor *= -1j * ahead * turn
    seen = offset.real, offset.imag, factor.real, factor.imag
    lever[[col.OFFSET_RE, col.OFFSET_IM, col.FACTOR_RE, col.FACTOR_IM]] = seen
    return lever


def one_mode(omega: float, alpha0: float, stiffness: float, drive: float) -> Array:
    """The lever of one mode that a force on the tip of amplitude k `drive` [N] drives, as `lever_of` returns it."""
    lever = np.zeros(col.MODE + col.MODE_NUMBERS)
    lever[[col.OMEGA, col.ALPHA0, col.STIFFNESS, col.DRIVE]] = omega, alpha0, stiffness, drive
    lever[[col.DYNAMIC_STIFFNESS, col.DYNAMIC_LOSS]] = 1 - omega * omega, 2 * alpha0 * omega
    lever[[col.FACTOR_RE, col.TURN_COS, col.MODES]] = 1.0
    lever[col.MODE :] = 1.0, alpha0, 1.0, drive, 1.0
    return lever


def supplied(lever: Array, amplitude: Array, phase: Array) -> Array:
    """Work of the drive, pi k u0 A cos(phase) [J per cycle], for levers of `lever_of`, shape (..., n)."""
    return np.pi * lever[..., col.STIFFNESS] * lever[..., col.DRIVE] * amplitude * np.cos(phase)


def modal_motion(lever: Array, amplitude: Array, phase: Array) -> tuple[Array, Array]:
    """First harmonics of the modes, and of the force at the tip over k, of phase 0 where the drive's is: complex, [m].

    Of mode i that of z_i, which is its deflection and B_i times the base: theory, Eq. (lever-2). Shapes (modes, ...)
    and (...), for amplitudes and phases of the tip [m, rad] of shape (...).
    """
    w, rate, share, pulled, _ = lever[col.MODE :].reshape(-1, col.MODE_NUMBERS).T
    omega, kappa = lever[col.OMEGA], lever[col.DYNAMIC_STIFFNESS] + 1j * lever[col.DYNAMIC_LOSS]
    turn = lever[col.TURN_COS] + 1j * lever[col.TURN_SIN]
    force = turn * (lever[col.DRIVE] + 1j * kappa * amplitude * np.exp(1j * np.asarray(phase)))
    stiff = w**2 - omega**2 + 2j * rate * omega
    # Of the drive, and of the force.
    motion = np.multiply.outer(pulled / stiff, np.ones_like(force)) - np.multiply.outer(share / stiff, force)
    return motion, force


def beat_of_second(lever: Array) -> float:
    """Largest spread [m] that a second drive leaves of itself behind the lock-in: theory, Eq. (irregular-8).

    0 where there is none.
    """
    if not lever[col.SECOND_FREE] > 0:
        return 0.0
    from phasemap._kernels.engagement.averages import BANDWIDTH  # with the march; who has no second drive needs neither

    ratio = lever[col.MODE + col.MODE_NUMBERS + col.FREQUENCY] / lever[col.OMEGA]
    return float(np.sqrt(2) * BANDWIDTH * ratio / (ratio**2 - 1) * lever[col.SECOND_FREE])


def drive_energy(lever: Array, amplitude: Array, phase: Array) -> Array:
    """Work of the drive, by a force on the tip or by the base [J per cycle]: theory, Eq. (lever-9)."""
    motion, force = modal_motion(lever, amplitude, phase)
    _, _, share, pulled, _ = lever[col.MODE :].reshape(-1, col.MODE_NUMBERS).T
    work = lever[col.RIGID] * force.imag - np.tensordot(pulled / share, motion.imag, 1)
    return np.pi * lever[col.STIFFNESS] * work


def lost_in_air(lever: Array, amplitude: Array) -> Array:
    """Loss of the first harmonic by the lever's own damping, pi k kappa'' A^2 [J per cycle].

    kappa is the dynamic stiffness at the tip over k, whose imaginary part is 2 alpha0 omega of one mode. Higher
    harmonics lose a little more, n^2 (A_n / A)^2 of it each.
    """
    return np.pi * lever[..., col.DYNAMIC_LOSS] * lever[..., col.STIFFNESS] * amplitude**2


def virial_of(lever: Array, amplitude: Any, phase: Any) -> Array:
    """Virial of the surface's force in the first harmonic, A^2 k kappa' / 2 - k u0 A sin(phase) / 2 [J].

    Positive for attraction. San Paulo and Garcia, Phys. Rev. B 64, 193411 (2001), at resonance.
    """
    stiff = amplitude * lever[..., col.DYNAMIC_STIFFNESS]
    return 0.5 * lever[..., col.STIFFNESS] * amplitude * (stiff - lever[..., col.DRIVE] * np.sin(phase))


DETECTED = {
    "direct": "position of the tip: the drive's force acts on it",
    "base": "deflection of the lever: position of the tip minus that of the base, which the drive moves",
}
"""Motion whose amplitude and phase are detected, by excitation."""


def sees_tip(lever: Array) -> bool:
    """True if the detector sees the motion of the tip itself."""
    offset, factor = offset_and_factor(lever)
    return not np.any(offset) and bool(np.all(factor == 1))


def in_proportion(lever: Array) -> bool:
    """True if the detector sees the motion of the tip times a number other than 1."""
    return not np.any(offset_and_factor(lever)[0]) and not sees_tip(lever)


def offset_and_factor(lever: Array) -> tuple[Any, Any]:
    """Complex offset [m] and factor [1] of the detector's signal, shape (...)."""
    return (
        lever[..., col.OFFSET_RE] + 1j * lever[..., col.OFFSET_IM],
        lever[..., col.FACTOR_RE] + 1j * lever[..., col.FACTOR_IM],
    )


def detected_signal(lever: Array, amplitude: Any, phase: Any) -> tuple[Array, Array]:
    """Amplitude [m] and phase [rad], 0 at free resonance, that the detector shows of a first harmonic of z."""
    if sees_tip(lever):
        return np.asarray(amplitude), np.asarray(phase)
    offset, factor = offset_and_factor(lever)
    seen = offset + factor * np.asarray(amplitude) * np.exp(1j * np.asarray(phase))
    return np.abs(seen), np.angle(seen)


def tip_seen(lever: Array) -> Array:
    """The lever beside a detector that sees the motion of the tip."""
    other = lever.copy()
    other[..., [col.OFFSET_RE, col.OFFSET_IM, col.FACTOR_IM]] = 0.0
    other[..., col.FACTOR_RE] = 1.0
    return other


def tip_amplitudes(lever: Array, amplitude: Any) -> tuple[Array, Array]:
    """Smallest and largest amplitude A [m] of z that the detector can see with an amplitude [m], at any phase."""
    if sees_tip(lever):
        return np.asarray(amplitude), np.asarray(amplitude)
    offset, factor = offset_and_factor(lever)
    size = np.asarray(amplitude) / np.abs(factor)
    beside = np.abs(offset / factor)
    return np.abs(size - beside), size + beside


def of_tip(lever: Array, amplitude: Any, phase: Any) -> tuple[Array, Array]:
    """First harmonic of z from the detector's signal: the inverse of `detected_signal`."""
    if sees_tip(lever):
        return np.asarray(amplitude), np.asarray(phase)
    offset, factor = offset_and_factor(lever)
    tip = (np.asarray(amplitude) * np.exp(1j * np.asarray(phase)) - offset) / factor
    return np.abs(tip), np.angle(tip)


def seen(rows: Array, lever: Array) -> Array:
    """Result rows, shape (..., COLUMNS), as the detector sees them: amplitude and phase.

    They are exact for the means of motion that is not periodic too, for the base's motion is constant. Its spreads
    depend on how amplitude and phase vary together: they are left as they are, of what was averaged in time.
    """
    if sees_tip(lever):
        return rows
    found, amplitude, phase = rows.copy(), rows[..., col.AMPLITUDE], rows[..., col.PHASE]
    found[..., col.AMPLITUDE], found[..., col.PHASE] = detected_signal(lever, amplitude, phase)
    return found
