"""Whole curves, from the material to the Dataset: time on one core."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.tables import dataset
from benchmarks.timing import best_of
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Cantilever, Drive, Microscope, Tip
from phasemap.sweeps.sweep import sweep_distance, sweep_frequency

if TYPE_CHECKING:
    import xarray as xr

POINTS = 200
BUDGET = 0.5  # [s] for which each is repeated
_SCOPE = Microscope(Cantilever(40.0, 300e3, 400.0), Tip(10e-9), Drive(16e-9))
_MATERIAL = Material(2e9, adhesion=0.1, damping=0.01)


def _distance() -> xr.Dataset:
    return sweep_distance(_MATERIAL, _SCOPE, np.linspace(20e-9, 6e-9, POINTS))


def _frequency() -> xr.Dataset:
    return sweep_frequency(_MATERIAL, _SCOPE, np.linspace(297e3, 303e3, POINTS), tip_offset=12e-9)


CURVES: dict[str, Callable[[], xr.Dataset]] = {"distance": _distance, "frequency": _frequency}


def measure_curves(progress: Callable[[str], None]) -> xr.Dataset:
    """Sweep over a bistable material, there and back, with every branch and fold behind.

    Returns, over "curve": curve_time [s], and curve_orbits and curve_folds, how many exact ones a curve has.
    """
    rows = {}
    for name, sweep in CURVES.items():
        progress(f"curve, {name}")
        sweep()  # compiles
        seconds, curve = best_of(sweep, BUDGET)
        rows[name] = (seconds, curve.sizes["point"], curve.sizes["fold"])
    about = {
        "time": ("time of a curve, after compilation", "s"),
        "orbits": ("exact orbits on it", "1"),
        "folds": ("its folds", "1"),
    }
    return dataset("curve", rows, about, curve_points=POINTS)
