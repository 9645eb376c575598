"""The lever with all its modes as an array of numbers for the kernels; the motion of each mode in an orbit."""

from __future__ import annotations

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
