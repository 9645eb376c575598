"""The same scene gives the same bytes, whatever computes it: any number of threads, and any process."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import phasemap as pm

SCOPE = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(20e-9))
RNG = np.random.default_rng(8)
MANY = pm.Surface(
    RNG.uniform(1e9, 4e9, (110, 90)),
    RNG.uniform(0.02, 0.07, (110, 90)),
    RNG.uniform(0, 0.01, (110, 90)),
    pixel_size=4e-9,
)
SOME = pm.Surface(RNG.choice([1e9, 2e9, 5e9], (9, 12)), RNG.choice([0.02, 0.08], (9, 12)), 0.01, pixel_size=4e-9)
NOISY = pm.Realism(temperature=300.0, detector_noise=5e-14, line_offset=1e-10, seed=5)
CASES: dict[str, tuple[pm.Surface, dict[str, Any]]] = {
    "interpolated": (MANY, {}),
    "averaged": (MANY, {"solver": "averaging"}),
    "exact": (SOME, {"solver": "orbit"}),
    "marched": (SOME.rows(slice(0, 1)), {"solver": "march"}),
    "raster": (SOME, {"control": pm.Raster("image")}),
    "interpolated raster": (MANY, {"control": pm.Raster("image")}),
    "feedback": (SOME, {"control": pm.Feedback(line_rate=8.0), "realism": NOISY}),
}


def digest(image: xr.Dataset) -> str:
    """Of the bytes of all variables."""
    return hashlib.sha256(b"".join(image[name].values.tobytes() for name in sorted(image.variables))).hexdigest()


def said(image: xr.Dataset) -> dict[str, str]:
    """Attributes, but when and how long."""
    return {name: str(value) for name, value in image.attrs.items() if name not in ("history", "seconds")}


@cache
def by_one_thread(name: str) -> xr.Dataset:
    surface, options = CASES[name]
    return pm.simulate(surface, SCOPE, 0.7, **options, threads=1)


@pytest.mark.parametrize("name", CASES)
def test_the_number_of_threads_changes_no_bit(name: str) -> None:
    surface, options = CASES[name]
    alone = by_one_thread(name)
    for threads in (2, 5):
        image = pm.simulate(surface, SCOPE, 0.7, **options, threads=threads)
        assert digest(image) == digest(alone) and said(image) == said(alone)


@pytest.mark.slow
def test_another_process_with_another_seed_of_hashes_gives_the_same_bytes() -> None:
    code = (
        "import phasemap as pm, test_determinism as t\n"
        "print(*(t.digest(pm.simulate(s, t.SCOPE, 0.7, **o)) for n, (s, o) in t.CASES.items() if n != 'marched'))"
    )
    command = [sys.executable, "-c", code]
    path = os.pathsep.join([str(Path(__file__).parent), *sys.path])
    environment = {**os.environ, "PYTHONHASHSEED": "1", "PYTHONPATH": path}
    there = subprocess.run(command, capture_output=True, text=True, check=True, env=environment).stdout
    here = [digest(by_one_thread(name)) for name in CASES if name != "marched"]
    assert there.split() == here
