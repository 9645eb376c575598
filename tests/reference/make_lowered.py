"""Writes tests/data/lowered.json: amplitudes of a tip that is lowered far off resonance, by the classical Runge-Kutta method.

    python tests/reference/make_lowered.py

One mode over a DMT contact with attraction -2 pi w R / (1 - d/d0)^2 before it, in fixed steps with no contact located.
The tip is lowered in steps and swings PERIODS at each; what counts is the mean phasor of the second half. Half as many
steps change it by less than 0.5 pm at 1.15 of the resonance.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
from numba import njit

RADIUS, DECAY, MODULUS, ADHESION, POISSON = 10e-9, 0.3e-9, 1e9, 0.05, 0.3
QUALITY, STIFFNESS, FREE = 100.0, 2.0, 20e-9
PERIODS, STEPS = 1500, 1500


@njit
def acceleration(z, v, t, z0, ratio, drive):  # type: ignore[no-untyped-def]
    """z'' with z towards the sample, lengths in m, times in 1/omega_0."""
    d = z - z0
    pull = 2 * math.pi * RADIUS * ADHESION
    if d >= 0:
        force = 4 / 3 * MODULUS / (1 - POISSON**2) * math.sqrt(RADIUS) * d**1.5 - pull
    else:
        force = -pull / (1 - d / DECAY) ** 2
    return drive * math.cos(ratio * t) - v / QUALITY - z - force / STIFFNESS


@njit
def lower(offsets, ratio, drive, z, v):  # type: ignore[no-untyped-def]
    """Mean amplitude [m] at each tip offset, from a state at drive phase 0 on."""
    found = np.empty(len(offsets))
    h, t = 2 * math.pi / ratio / STEPS, 0.0
    for i in range(len(offsets)):
        cosine = sine = 0.0
        for period in range(PERIODS):
            for _ in range(STEPS):
                k1, l1 = v, acceleration(z, v, t, offsets[i], ratio, drive)
                k2, l2 = (
                    v + h / 2 * l1,
                    acceleration(z + h / 2 * k1, v + h / 2 * l1, t + h / 2, offsets[i], ratio, drive),
                )
                k3, l3 = (
                    v + h / 2 * l2,
                    acceleration(z + h / 2 * k2, v + h / 2 * l2, t + h / 2, offsets[i], ratio, drive),
                )
                k4, l4 = v + h * l3, acceleration(z + h * k3, v + h * l3, t + h, offsets[i], ratio, drive)
                z += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
                v += h / 6 * (l1 + 2 * l2 + 2 * l3 + l4)
                t += h
                if period >= PERIODS // 2:
                    cosine += z * math.cos(ratio * t)
                    sine += z * math.sin(ratio * t)
            t -= 2 * math.pi / ratio
        found[i] = 2 * math.hypot(cosine, sine) / STEPS / (PERIODS - PERIODS // 2)
    return found


def main() -> None:
    """Write the cases."""
    cases = []
    for ratio in (1.15, 0.6):
        drive = FREE * math.hypot(1 - ratio**2, ratio / QUALITY)
        lag = math.atan2(ratio / QUALITY, 1 - ratio**2)
        offsets = np.linspace(32e-9, 5e-9, 28)
        amplitudes = lower(offsets, ratio, drive, FREE * math.cos(lag), ratio * FREE * math.sin(lag))
        chosen = slice(None, None, 3)
        cases.append(
            {
                "name": f"at {ratio} of the resonance", "ratio": ratio, "quality_factor": QUALITY, "stiffness": STIFFNESS,
                "free_amplitude": FREE, "radius": RADIUS, "decay_length": DECAY, "modulus": MODULUS,
                "adhesion": ADHESION, "poisson_ratio": POISSON, "tip_offsets": offsets[chosen].round(13).tolist(),
                "amplitudes": amplitudes[chosen].round(15).tolist(),
            }
        )  # fmt: skip
    (Path(__file__).parents[1] / "data" / "lowered.json").write_text(json.dumps(cases, indent=1))


if __name__ == "__main__":
    main()
