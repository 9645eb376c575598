"""Coverage of `phasemap.series`: materials, free amplitude, zeros and sign drawn from the prior, fitted as unknowns.

    python tests/reference/check_series.py [DRAWS [SEED [DESIGN [ERROR]]]]

Phases are those of single pixels by the averaging solver, on the branch that the tip meets first; each median is wrong
by ERROR (1) degrees. DESIGN is a key of `DESIGNS`. Prints the share of 95 % intervals that hold the truth, for every
unknown and in all, and in how many files the sign of the contrast was right. Some 10 s of processor time a draw.
"""

import sys

import numpy as np
import xarray as xr

import phasemap as pm
from phasemap.inference.determined import PRIOR
from phasemap.inference.sampling import REACH
from phasemap.inference.series.series import FACTORS
from phasemap.inference.series.settings import GUESS, GUESS_FACTOR

LEVER, TIP = pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9)
ROWS, COLUMNS = 20, 24
NAMES = ("modulus", "adhesion", "damping")
DESIGNS = {  # setpoints, free amplitudes as a multiple of what is unknown, number of materials
    "setpoints": ((0.85, 0.7, 0.55, 0.4), (1, 1, 1, 1), 2),
    "five": ((0.9, 0.8, 0.7, 0.6, 0.5), (1, 1, 1, 1, 1), 2),
    "amplitudes": ((0.6, 0.6, 0.6), (0.5, 1, 2), 2),
    "both": ((0.8, 0.5, 0.8, 0.5), (1, 1, 2, 2), 2),
    "three": ((0.85, 0.7, 0.55, 0.4), (1, 1, 1, 1), 3),
    "places": ((0.85, 0.7, 0.55, 0.4), (1, 1, 1, 1), 2),
    "tunes": ((0.85, 0.6, 0.4, 0.8, 0.5), (1, 1, 1, 1, 1), 2),
}


def normal(rng, *shape):
    """Standard normal numbers, cut off where the prior is."""
    while True:
        found = rng.normal(size=shape)
        if (abs(found) < REACH).all():
            return found


def tunes_of(design):
    """Tune of each file; an unknown sensitivity, and in several tunes an unknown zero, is the same within one."""
    return [0, 0, 0, 1, 1] if design == "tunes" else [0] * len(DESIGNS[design][0])


def drawn(rng, design):
    """Materials, free amplitudes [m] and phases [degree], shape (materials, files), that all exist."""
    setpoints, sizes, count = DESIGNS[design]
    tunes = tunes_of(design)
    while True:
        logs = normal(rng, count, 3) * np.log(FACTORS)
        values = np.array([PRIOR.modulus, PRIOR.adhesion, PRIOR.damping]) * np.exp(logs)
        scale = GUESS * GUESS_FACTOR ** normal(rng, 1 + max(tunes)) / np.exp(np.log(sizes).mean())
        amplitudes = scale[tunes] * np.array(sizes)
        scopes = [pm.Microscope(LEVER, TIP, pm.Drive(amplitude)) for amplitude in amplitudes]
        pixels = [[pm.solve_pixel(pm.Material(*one[:2], damping=one[2]), scope, at, solver="averaging")
                   for scope, at in zip(scopes, setpoints, strict=True)] for one in values.tolist()]  # fmt: skip
        phases = np.array([[one.phase for one in row] for row in pixels])
        if np.isfinite(phases).all():
            return values, amplitudes, phases


def maps(rng, design):
    """Labels of every file: stripes of 12, 7 and 5 columns, or halves; elsewhere in each file of different places."""
    widths = (12, 7, 5) if DESIGNS[design][2] == 3 else (14, 10)
    labels = np.repeat([np.repeat(np.arange(len(widths)), widths)], ROWS, axis=0)
    shifts = rng.integers(0, COLUMNS, len(DESIGNS[design][0])) * (design == "places")
    return [np.roll(labels, shift, axis=1) for shift in shifts]


def main(count=40, seed=0, design="setpoints", error=1.0):
    rng = np.random.default_rng(seed)
    inside, right = [], []
    for k in range(count):
        values, amplitudes, phases = drawn(rng, design)
        labels, sign = maps(rng, design), rng.choice([-1, 1])
        zeros, tunes = rng.uniform(-180, 180, len(amplitudes)), tunes_of(design)
        zeros = zeros[tunes] if max(tunes) else zeros
        seen = sign * phases + zeros + rng.normal(0, error, phases.shape)
        images = [
            xr.Dataset(
                {"phase": (("y", "x"), seen[labels[i], i])},
                attrs={
                    "title": str(i), "setpoint": at, "drive_frequency": 300e3 + 200 * tunes[i],
                    "free_amplitude_voltage": float(DESIGNS[design][1][i]),
                },
            )
            for i, at in enumerate(DESIGNS[design][0])
        ]  # fmt: skip
        found = pm.series(images, pm.Microscope(LEVER, TIP, pm.Drive(GUESS)), labels=labels, phase_error=error, seed=k,
                          phase_zero="shared" if max(tunes) else None)  # fmt: skip
        own = [(float(found[f"{name}_low"][r]) < values[r, i] < float(found[f"{name}_high"][r]))
               for r in range(len(values)) for i, name in enumerate(NAMES)]  # fmt: skip
        for tune in sorted(set(tunes)):
            size = found.sel(file=str(tunes.index(tune)))
            own.append(float(size.free_amplitude_low) < amplitudes[tunes.index(tune)] < float(size.free_amplitude_high))
        inside.append(own)
        contrast = (found.measured_contrast * found.fitted_contrast)[1:].values
        clear = abs(found.measured_contrast[1:].values) > 2 * found.contrast_error[1:].values
        right.append((contrast[clear] > 0).mean() if clear.any() else 1.0)
        print(
            k, np.array(inside).mean(axis=0).round(2), f"{np.mean(inside):.3f}, sign {np.mean(right):.3f}", flush=True
        )


if __name__ == "__main__":
    given = sys.argv[1:]
    main(*(make(one) for make, one in zip((int, int, str, float), given, strict=False)))
