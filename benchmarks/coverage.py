"""How often the truth is within the 95 % of a series of two tunes: ``python -m benchmarks.coverage [series]``.

Truths are drawn from all that a series expects beforehand: materials, branches, by how much errors are larger than
stated, and of each tune a free amplitude and a zero of its own. All of them are unknown to the series, which gives the
ends of six properties and two free amplitudes.
"""

from __future__ import annotations

import math
import sys
import warnings

import numpy as np
import xarray as xr

import phasemap as pm
from phasemap.inference.determined import PARAMETERS, PRIOR
from phasemap.inference.images.model import make_model
from phasemap.inference.sampling import REACH
from phasemap.inference.series.likelihood import OTHER, WORSE
from phasemap.inference.series.series import FACTORS
from phasemap.inference.series.settings import GUESS, GUESS_FACTOR

LEVER, TIP = pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9)
SETPOINTS = (0.85, 0.6)
DRIVES = (300e3, 300.3e3)  # as files record them, by which tunes are told apart; all is simulated at resonance
LABELS = np.tile([0, 0, 1], (16, 5))
ERROR = 1.0  # of a median phase [degree]


def drawn(rng: np.random.Generator, count: int) -> np.ndarray:
    """Standard normal numbers within the reach of the prior."""
    x = rng.normal(size=4 * count)
    return x[np.abs(x) < REACH][:count]


def measured(rng: np.random.Generator) -> tuple[list[xr.Dataset], list[pm.Material], np.ndarray] | None:
    """Files of two tunes, their materials and free amplitudes [m]; None where an oscillation does not hold.

    Branches are drawn as `phasemap.series` expects them, and how much larger than stated the errors are.
    """
    q = drawn(rng, 9)
    logs = q[:6].reshape(2, 3) * np.log(FACTORS)
    materials = [pm.Material(*(getattr(PRIOR, name) * np.exp(x) for name, x in zip(PARAMETERS, one, strict=True)))
                 for one in logs]  # fmt: skip
    amplitudes, error = GUESS * GUESS_FACTOR ** q[6:8], ERROR * WORSE ** max(q[8], 0.0)
    model, files = make_model((pm.Microscope(LEVER, TIP, pm.Drive(GUESS)),), (0.5,), PRIOR, math.e), []
    for tune, (drive, amplitude) in enumerate(zip(DRIVES, amplitudes, strict=True)):
        zero, held = rng.uniform(-180, 180), model.at_settings(np.full(2, amplitude), np.array(SETPOINTS))
        both = np.degrees([held.phases(np.tile(one, (2, 1)), np.full((2, 2), np.nan), search=True) for one in logs])
        there = ~np.isnan(both)  # of region, branch and setpoint
        if not there.any(axis=1).all():
            return None
        first = np.logical_or.accumulate(~there[:, 0], axis=1) & there[:, 1]  # from there on the tip is repulsive
        other = there.all(axis=1) & (rng.random((2, 2)) < OTHER)
        levels = np.where(first ^ other, both[:, 1], both[:, 0])
        for k, setpoint in enumerate(SETPOINTS):
            phase = (levels[:, k] + zero + rng.normal(0, error, 2))[LABELS] + rng.normal(0, 0.01, LABELS.shape)
            attrs = {"setpoint": setpoint, "drive_frequency": drive, "title": f"{tune} at {setpoint}"}
            files.append(xr.Dataset({"phase": (("y", "x"), phase)}, attrs=attrs))
    return files, materials, amplitudes


def covered(seed: int) -> list[bool]:
    """Whether each truth of one series is within its ends; nothing where an oscillation does not hold."""
    made = measured(np.random.default_rng(seed))
    if made is None:
        return []
    files, materials, amplitudes = made
    scope = pm.Microscope(LEVER, TIP, pm.Drive(GUESS))
    found = pm.series(files, scope, labels=LABELS, sign=1, phase_zero="shared", phase_error=ERROR, seed=seed)
    said = [
        float(found[f"{name}_low"][region]) < getattr(one, name) < float(found[f"{name}_high"][region])
        for region, one in enumerate(materials)
        for name in PARAMETERS
    ]
    for tune, amplitude in enumerate(amplitudes):
        one = found.sel(file=f"{tune} at {SETPOINTS[0]}")
        said.append(bool(one.free_amplitude_low < amplitude < one.free_amplitude_high))
    return said


def main(count: int) -> None:
    """Print the share of truths within their 95 %, and its standard error."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        each = [one for one in map(covered, range(count)) if one]
    share = np.mean(each)
    by_series = np.std(np.mean(each, axis=1)) / np.sqrt(len(each))
    print(f"{100 * share:.1f} +- {100 * by_series:.1f} % of {len(each) * len(each[0])} truths in {len(each)} series")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100)
