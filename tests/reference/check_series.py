"""Coverage of `phasemap.series`: materials, free amplitude, zeros and sign drawn from the prior, fitted as unknowns.

    python tests/reference/check_series.py [DRAWS [SEED]]

Phases are those of single pixels by the averaging solver, on the branch that the tip meets first; each median is wrong
by ERROR. Prints the share of 95 % intervals that hold the truth, for every unknown and in all, and in how many files
the sign of the contrast was right. Some 10 s of processor time a draw.
"""

import sys

import numpy as np
import xarray as xr

import phasemap as pm
from phasemap.inference.images.images import PRIOR
from phasemap.inference.series.problem import REACH
from phasemap.inference.series.series import FACTORS
from phasemap.inference.series.settings import GUESS, GUESS_FACTOR

LEVER, TIP = pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9)
SETPOINTS = (0.85, 0.7, 0.55, 0.4)
ERROR = 1.0  # of a median [degree]
ROWS = 20
LABELS = np.repeat([[0] * 12 + [1] * 8], ROWS, axis=0)
NAMES = ("modulus", "adhesion", "damping")


def normal(rng, *shape):
    """Standard normal numbers, cut off where the prior is."""
    while True:
        found = rng.normal(size=shape)
        if (abs(found) < REACH).all():
            return found


def drawn(rng):
    """Two materials, a free amplitude [m] and phases [degree], shape (2, files), that all exist."""
    while True:
        logs = normal(rng, 2, 3) * np.log(FACTORS)
        values = np.array([PRIOR.modulus, PRIOR.adhesion, PRIOR.damping]) * np.exp(logs)
        amplitude = float(GUESS * GUESS_FACTOR ** normal(rng, 1)[0])
        scope = pm.Microscope(LEVER, TIP, pm.Drive(amplitude))
        pixels = [[pm.solve_pixel(pm.Material(*one[:2], damping=one[2]), scope, at, solver="averaging")
                   for at in SETPOINTS] for one in values.tolist()]  # fmt: skip
        phases = np.array([[one.phase for one in row] for row in pixels])
        if np.isfinite(phases).all():
            return values, amplitude, phases


def main(count=40, seed=0):
    rng = np.random.default_rng(seed)
    inside, right = [], []
    for k in range(count):
        values, amplitude, phases = drawn(rng)
        sign = rng.choice([-1, 1])
        seen = sign * phases + rng.uniform(-180, 180, len(SETPOINTS)) + rng.normal(0, ERROR, phases.shape)
        images = [
            xr.Dataset({"phase": (("y", "x"), seen[LABELS, i])}, attrs={"setpoint": at, "drive_frequency": 300e3})
            for i, at in enumerate(SETPOINTS)
        ]
        found = pm.series(images, pm.Microscope(LEVER, TIP, pm.Drive(GUESS)), labels=LABELS, phase_error=ERROR, seed=k)
        own = [(float(found[f"{name}_low"][r]) < values[r, i] < float(found[f"{name}_high"][r]))
               for r in range(2) for i, name in enumerate(NAMES)]  # fmt: skip
        inside.append([*own, float(found.free_amplitude_low[0]) < amplitude < float(found.free_amplitude_high[0])])
        contrast = (found.measured_contrast * found.fitted_contrast)[1].values
        clear = abs(found.measured_contrast[1].values) > 2 * found.contrast_error[1].values
        right.append((contrast[clear] > 0).mean() if clear.any() else 1.0)
        print(
            k, np.array(inside).mean(axis=0).round(2), f"{np.mean(inside):.3f}, sign {np.mean(right):.3f}", flush=True
        )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
