"""What a fresh environment has to do: `python smoke.py SCENE`, with numba's compiler off; part of .ci/fresh.py.

Images of the scene by every solver and by the other control at rest go to files and come back identical. The numbers,
and those of compiled.nc, which compiled kernels made before, go to numbers.json. A warning in phasemap is an error.
"""

from __future__ import annotations

import json
import platform
import re
import sys
import warnings
from importlib.metadata import requires, version
from pathlib import Path

import xarray as xr

import phasemap as pm

SMALL = "surface.shape=[8,16]"
WAYS = {
    "averaging": "scan.solver=averaging",
    "orbit": "scan.solver=orbit",
    "march": "scan.solver=march",
    "raster": "control.kind=raster",
}
RECORDED = (
    "height", "phase", "amplitude", "tip_offset", "mean_deflection", "indentation", "dissipation", "virial", "branch",
    "status",
)  # fmt: skip

warnings.filterwarnings("error", module="phasemap")  # those of old libraries about newer ones are theirs

images = {"compiled": xr.load_dataset("compiled.nc")}
for name, way in WAYS.items():
    images[name] = pm.load_scene(sys.argv[1], [SMALL, way]).simulate()
    images[name].to_netcdf(f"{name}.nc")
    xr.testing.assert_identical(xr.load_dataset(f"{name}.nc"), images[name])

dependencies = [re.split("[<>]", line)[0] for line in requires("afm-phasemap") or [] if ";" not in line]
report = {
    "versions": ", ".join(
        [f"Python {platform.python_version()}", *(f"{name} {version(name)}" for name in dependencies)]
    ),
    "numbers": {
        f"{name} {key}": image[key].values.ravel().tolist() for name, image in images.items() for key in RECORDED
    },
}
Path("numbers.json").write_text(json.dumps(report))
