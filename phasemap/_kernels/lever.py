"""The lever: how far it swings freely, the drive that an orbit needs and from it the phase, lengths that it sets."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.columns import ALPHA0, DRIVE, DYNAMIC_LOSS, DYNAMIC_STIFFNESS
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator, contact_force, has_longrange

LOWEST_Q = 25.0  # below this a lever is no longer nearly harmonic, and averaging no safe guide
FARTHEST_AT_ALL = 1e-2  # [m] that a lever is pressed in, the same whatever the amplitude
NEAREST = 0.25  # of 1 - omega^2: drives from 0.87 to 1.12 of the resonance
LEAST_OF_FREE = 1e-3  # of the free amplitude: orbits change on no shorter length
PART_OF_DRIVE, SHORTEST_HALF = (
    0.15,
    0.05,
)  # of the drive, times pi, that a pull may take up in a contact; its half [rad]
PRESSED_IN, PRESSED_BY_PULL, PRESSED_AT_LEAST = 30.0, 20.0, 1e-7  # free amplitudes, bends by adhesion, [m]


@kernel(light=True)
def free_amplitude(lever: np.ndarray) -> float:
    """Amplitude [m] of the free lever at the drive frequency: theory, Eq. (model-2)."""
    return lever[col.DRIVE] / math.hypot(lever[col.DYNAMIC_STIFFNESS], lever[col.DYNAMIC_LOSS])


@kernel(light=True)
def free_phasor(lever: np.ndarray) -> complex:
    """Complex amplitude a [m] of the free lever, z = Re(a exp(i omega tau)): theory, Eq. (model-2)."""
    return lever[col.DRIVE] / complex(lever[col.DYNAMIC_STIFFNESS], lever[col.DYNAMIC_LOSS])


@kernel
def scale_of(oscillator: Oscillator) -> float:
    """Length [m] on which orbits change as the tip comes near: the reach of the long-range force.

    Without one, the indentation at which a force that sets in with contact takes up a third of the drive.
    """
    law, p, lever = oscillator
    free = free_amplitude(lever)
    if has_longrange(p):
        return max(reach_of(p), LEAST_OF_FREE * free)
    pull = -contact_force(law, 0.0, p) / lever[col.STIFFNESS]
    if not pull > 0.0:
        return LEAST_OF_FREE * free
    half = min(PART_OF_DRIVE * math.pi * lever[col.DRIVE] / pull, SHORTEST_HALF)
    return 0.5 * free * half * half


@kernel(light=True)
def drive_needed(lever: np.ndarray, amplitude: float, push: float, drag: float) -> tuple[float, float]:
    """Drive [m] that a motion of this amplitude needs against P and S: its part in phase, and that ahead of it.

    It is linear in the three: with their rates it is the rate of the drive needed.
    """
    return push + amplitude * lever[DYNAMIC_STIFFNESS], lever[DYNAMIC_LOSS] * amplitude - drag


@kernel
def mismatch(lever: np.ndarray, amplitude: float, push: float, drag: float) -> float:
    """Drive needed over drive given, squared, less one: zero on an orbit. See theory, Eq. (averaging-4)."""
    x, y = drive_needed(lever, amplitude, push, drag)
    return (x * x + y * y) / (lever[DRIVE] * lever[DRIVE]) - 1.0


@kernel(light=True)
def phase_of(lever: np.ndarray, amplitude: float, push: float, drag: float) -> float:
    """Phase [rad] of an orbit with this amplitude, P and S: theory, Eq. (averaging-5)."""
    x, y = drive_needed(lever, amplitude, push, drag)
    return math.atan2(x, y)


@kernel(light=True)
def phase_rate(x: float, y: float, by_x: float, by_y: float) -> float:
    """Rate of the phase atan2(x, y) [rad] with those of x and y."""
    return (by_x * y - x * by_y) / (x * x + y * y)


@kernel
def forces_at_phase(lever: np.ndarray, amplitude: float, phase: float) -> tuple[float, float]:
    """P and S [m] of an orbit with this amplitude [m] and phase [rad]: theory, Eq. (averaging-3)."""
    push = lever[DRIVE] * math.sin(phase) - amplitude * lever[DYNAMIC_STIFFNESS]
    return push, amplitude * lever[DYNAMIC_LOSS] - lever[DRIVE] * math.cos(phase)


@kernel
def reach_of(p: np.ndarray) -> float:
    """Distance [m] on which the long-range force changes at contact, theory, Eq. (model-13): 0 without such a force."""
    return float(1.0 / p[col.INVERSE_REACH]) if has_longrange(p) else 0.0


@kernel
def distance_to_pole(start: float, near: float) -> float:
    """Distance in u = tan(theta/2) from the edge of a contact, u = `start`, to the pole of the long-range force.

    `near`: distance of the tip from the pole at that edge, over the amplitude.
    """
    ratio = 0.5 * near * (1.0 + start * start) ** 2
    delta = math.sqrt(start * start + ratio) - start
    return delta if delta >= 1e-4 * start else 0.5 * ratio / start


@kernel
def bend_by_adhesion(oscillator: Oscillator) -> float:
    """Deflection [m] of the lever by adhesion at first contact."""
    law, p, lever = oscillator
    return max(-contact_force(law, 0.0, p) / lever[col.STIFFNESS], 0.0)


@kernel(light=True)
def low_q(lever: np.ndarray) -> bool:
    """True if the lever forgets a kick within a few periods, as in liquid."""
    return bool(lever[ALPHA0] > 0.5 / LOWEST_Q)


@kernel
def lowest_tip_offset(oscillator: Oscillator) -> float:
    """Tip offset [m] below which the lever is pressed in farther than any instrument would, and no orbit is looked for.

    Above resonance a soft contact makes up for the lever's detuning only where the tip is pressed in far.
    """
    lever = oscillator.lever
    if lever[col.OMEGA] > 1.0 and beside_resonance(lever):
        return -FARTHEST_AT_ALL
    pressed = PRESSED_IN * free_amplitude(lever) + PRESSED_BY_PULL * bend_by_adhesion(oscillator)
    return -(pressed + PRESSED_AT_LEAST)


@kernel(light=True)
def beside_resonance(lever: np.ndarray) -> bool:
    """True if the drive is more than a linewidth off."""
    return abs(lever[DYNAMIC_STIFFNESS]) > lever[DYNAMIC_LOSS]


@kernel(light=True)
def near_resonance(lever: np.ndarray) -> bool:
    """True if the drive is so near the resonance that averaging can decide, which leaves out terms of 1 - omega^2."""
    return abs(lever[DYNAMIC_STIFFNESS]) < NEAREST
