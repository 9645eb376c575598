"""The motion behind a published table of phases over polyisobutylene, evaluated anew.

    python tests/reference/polyisobutylene.py

The table is 1stMode.txt of https://github.com/ealopez/TappingMode_Simulations. What its simulation does was read there and
is written anew here: a lever of three modes by Verlet's method in 10,000 steps a period, for 760 periods from rest; the
theory of Lee and Radok, one element, with all arms of the series that are slower than ten steps (the slowest of up to
10^5 s hold 0.9 MPa in shear, and the sample sinks by 30 nm; without them by 80). Depth, dent and peak force of its file
119.txt come out (-33.51 nm, -30.335 nm, 105.64 nN), and amplitudes and phases of its table to the fifth digit, if they are
read as there: from a hundred samples a period, the first of them 11 steps after a whole period but taken for its begin
(0.396 degree), and with the sum of 1000 samples divided by the 999 intervals between them.
"""

from __future__ import annotations

import math
import pathlib
import tomllib

import numpy as np
from numba import njit

SPECTRA = pathlib.Path(__file__).parents[2] / "phasemap" / "experiment" / "spectra.toml"
FREQUENCY, QUALITY, FREE, STIFFNESS, RADIUS = 46e3, 150.0, 230e-9, 6.5, 10e-9
HAMAKER, ATOM = 2e-19, 0.2e-9
STEP = 1 / FREQUENCY / 1e4
PERIODS, AVERAGED, MODES = 760, 10, (1.0, 6.27, 17.6)
LATE, APART = 11, 100  # steps: the first sample of the record after a whole period, and the samples


@njit(cache=True)
def motion(moduli, times, rest, ratios):
    """Depth of the tip [m], its dent [m] and force [N] over the last periods, of a lever that rests at this height."""
    omega = 2 * math.pi * FREQUENCY
    mass, drive, rate = STIFFNESS / omega**2, STIFFNESS * FREE / QUALITY, STEP / times
    z, before, v = np.zeros(len(ratios)), np.zeros(len(ratios)), np.zeros(len(ratios))
    crept, sunk = np.zeros(len(times)), np.zeros(len(times))  # of each dashpot: depth^1.5, and height
    force = surface = 0.0
    count, kept = PERIODS * 10_000, AVERAGED * 10_000
    out = np.empty((3, kept))
    for i in range(count):
        tip = rest
        for j in range(len(ratios)):
            w = omega * ratios[j]
            push = drive * math.cos(omega * (i + 1) * STEP) + force
            new = 2 * z[j] - before[j] + (push / mass - w * w * z[j] - w * v[j] / (QUALITY * (j + 1))) * STEP**2
            v[j], before[j], z[j] = (new - before[j]) / (2 * STEP), z[j], new
            tip += new
        free = np.sum(moduli * sunk) / np.sum(moduli)
        if tip > surface and free <= tip:
            surface = free
            sunk += (surface - sunk) * rate
            crept = np.maximum(-sunk, 0.0) ** 1.5
            force = -HAMAKER * RADIUS / (6 * (tip - surface + ATOM) ** 2)
        else:
            surface, pressed = tip, (-tip) ** 1.5
            force = 16 / 3 * math.sqrt(RADIUS) * np.sum(moduli * (pressed - crept)) - HAMAKER * RADIUS / (6 * ATOM**2)
            crept += (pressed - crept) * rate
            sunk = -(crept ** (2 / 3))
        if i >= count - kept:
            out[0, i - count + kept], out[1, i - count + kept], out[2, i - count + kept] = tip, surface, force
    return out


def main() -> None:
    """Print amplitude over free and phase [degree] of the motion and as the table has them, and what its files have."""
    arms = tomllib.loads(SPECTRA.read_text(encoding="utf-8"))["PIB"]
    moduli, times = np.array(arms["shear_moduli"]), np.array(arms["times"])
    seen = times > 10 * STEP
    turned = np.exp(2j * math.pi * np.arange(1, AVERAGED * 10_000 + 1) / 10_000)
    for rest in (150e-9, 130e-9, 120e-9, 100e-9, 80e-9, 50e-9):
        tip, surface, force = motion(moduli[seen], times[seen], rest, np.array(MODES))
        record = tip[LATE - 1 :: APART]
        supposed = np.exp(2j * math.pi * APART / 10_000 * np.arange(len(record)))
        as_read = 2 * np.sum(record * supposed) / (len(record) - 1)
        for first in (2 * np.mean(tip * turned), as_read):
            print(f"{rest * 1e9:.0f} nm: {abs(first) / FREE:.5f}, {90 - math.degrees(np.angle(first)):.4f} degrees")
        print(f"tip {tip.min() * 1e9:.4f} nm, surface {surface[0] * 1e9:.4f} nm, force {force.max() * 1e9:.2f} nN")


if __name__ == "__main__":
    main()
