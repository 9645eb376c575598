"""How large may a map be?

As large as the disk: a surface made of Dask arrays is simulated block by block, and the image is written as it is
computed. Here a blend is generated block by block from a formula, so that neither the surface nor the image is ever in
memory as a whole. The memory that the process used is compared with a limit of 2 GiB:

    python examples/large_map.py 16384
"""

import resource
import sys
import time
from pathlib import Path
from typing import Any

import dask
import dask.array as da
import matplotlib.pyplot as plt
import numpy as np
import xarray as xr

import phasemap as pm

SIDE, BLOCK = 2048, 1024  # pixels
PIXEL = 2e-9  # m
LIMIT = 2.0  # GiB
DOMAINS = {0: pm.Material(3e9, adhesion=0.05, damping=0.004), 1: pm.Material(0.5e9, adhesion=0.08, damping=0.03)}
SCOPE = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(20e-9))


def wave(block_info: Any = None) -> np.ndarray:
    """A block of a pattern of domains, between -1 and 1."""
    (top, bottom), (left, right) = block_info[None]["array-location"]
    y, x = np.ogrid[top:bottom, left:right]
    return np.cos(y / 23.0 + 3 * np.sin(x / 151.0)) * np.sin(x / 31.0 + 2 * np.cos(y / 97.0))


def surface_of(side: int) -> pm.Surface:
    """A blend with topography, of which nothing is computed yet."""
    chunks = da.core.normalize_chunks((BLOCK, BLOCK), (side, side))
    pattern = da.map_blocks(wave, chunks=chunks, dtype=float, meta=np.empty((0, 0)))
    return pm.Surface.from_labels((pattern > 0).astype(int), DOMAINS, pixel_size=PIXEL, topography=2e-9 * pattern)


def memory_peak() -> float:
    """The most memory [GiB] that this process took; on Linux `getrusage` counts the one that started it too."""
    status = Path("/proc/self/status")
    if not status.exists():
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**30
    most = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
    return float(most.split()[1]) / 2**20


def main(side: int = SIDE, folder: Path = Path()) -> None:
    """Write large_map.zarr and large_map.png."""
    image = pm.simulate(surface_of(side), SCOPE, setpoint=0.7, variables=["height", "phase"])
    started = time.perf_counter()
    with dask.config.set(scheduler="threads", num_workers=2):
        image.to_zarr(folder / "large_map.zarr", mode="w", consolidated=False)
    seconds = time.perf_counter() - started
    peak = memory_peak()
    size = image.nbytes / 2**30
    print(f"{side} x {side} pixels in {seconds:.0f} s; image {size:.2f} GiB, memory at most {peak:.2f} GiB")
    assert peak <= LIMIT

    with xr.open_zarr(folder / "large_map.zarr", consolidated=False) as written:
        thin = max(side // 512, 1)
        phase = written.phase[::thin, ::thin].compute()
    figure, axes = plt.subplots(figsize=(5, 4.2), layout="constrained")
    extent = np.array([0, side, side, 0]) * PIXEL * 1e6
    shown = axes.imshow(phase, cmap="inferno", extent=extent)
    axes.set(xlabel="x [µm]", ylabel="y [µm]", title=f"Phase of {side} x {side} pixels")
    figure.colorbar(shown, label="phase [degree]")
    figure.savefig(folder / "large_map.png", dpi=120)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]))
