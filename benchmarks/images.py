"""Whole images in which every pixel is another material: time, and error against collocation on random pixels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.tables import dataset
from benchmarks.timing import best_of
from phasemap._kernels import columns as col
from phasemap._shared.threads import workers_of
from phasemap.experiment.accuracy import Accuracy
from phasemap.experiment.generate import roughness
from phasemap.experiment.microscope import Cantilever, Drive, Microscope, Tip
from phasemap.experiment.surface import Surface
from phasemap.imaging.simulation import simulate
from phasemap.solvers.problem import make_work
from phasemap.solvers.run import run
from phasemap.solvers.solver import Orbit

if TYPE_CHECKING:
    import xarray as xr

Array = np.ndarray
Range = tuple[float, float]

SIZE, QUICK_SIZE = 1024, 256
BORDERS = 256  # pixels along a side of images that are mostly borders
CHECKED, QUICK_CHECKED = 4000, 400
"""Random pixels that are solved by collocation."""
_AIR = Microscope(Cantilever(40.0, 300e3, 400.0), Tip(10e-9), Drive(20e-9))
_SOFT = Microscope(Cantilever(2.0, 70e3, 150.0), Tip(10e-9), Drive(30e-9))
_SMALL = Microscope(Cantilever(40.0, 300e3, 400.0), Tip(10e-9), Drive(14e-9))
_SOFT_AND_SMALL = Microscope(Cantilever(3.0, 75e3, 200.0), Tip(10e-9), Drive(14e-9))
_ABOVE_RESONANCE = Microscope(Cantilever(3.0, 75e3, 200.0), Tip(10e-9), Drive(60e-9, frequency=75.75e3))
_LIQUID = Microscope(Cantilever(0.1, 10e3, 2.0), Tip(10e-9), Drive(14e-9))


@dataclass(frozen=True)
class Map:
    """An image with three independent rough maps, each between two values, at most so many pixels along a side."""

    name: str
    scope: Microscope
    setpoint: float
    # modulus, adhesion, damping: least and largest [Pa, J/m2, 1]; modulus and damping are spread over the decades
    # between
    modulus: Range
    adhesion: Range
    damping: Range
    most: int = SIZE


MAPS = (
    Map("repulsive everywhere", _AIR, 0.7, (1e9, 1e10), (0.01, 0.05), (1e-3, 0.05)),
    Map("attractive and repulsive", _AIR, 0.7, (1e9, 1e10), (0.02, 0.3), (1e-3, 0.05)),
    Map("the same at a low setpoint", _AIR, 0.5, (1e9, 1e10), (0.02, 0.3), (1e-3, 0.05)),
    Map("soft lever, soft and lossy sample", _SOFT, 0.7, (1e8, 5e9), (0.005, 0.1), (1e-3, 0.2)),
    Map("borders, small amplitude", _SMALL, 0.9, (1e8, 1e10), (0.01, 0.15), (1e-3, 0.1), BORDERS),
    Map("the same at a lower setpoint", _SMALL, 0.7, (1e8, 1e10), (0.01, 0.15), (1e-3, 0.1), BORDERS),
    Map("borders, soft lever", _SOFT_AND_SMALL, 0.9, (5e8, 5e9), (0.005, 0.08), (1e-3, 0.02), BORDERS),
    Map("the same at 1.01 of the resonance", _ABOVE_RESONANCE, 0.9, (5e8, 5e9), (0.005, 0.08), (1e-3, 0.02), BORDERS),
    Map("in liquid, Q = 2", _LIQUID, 0.7, (1e7, 1e9), (1e-4, 0.02), (1e-3, 0.1), BORDERS),
)
ABOUT = {
    "size": ("pixels along a side", "1"),
    "time": ("time of the whole image on all cores, after compilation", "s"),
    "time_alone": ("the same on one core", "s"),
    "interpolated": ("part of the pixels that were interpolated", "1"),
    "phase_error": ("largest error of the phase on the pixels checked", "degree"),
    "height_error": ("largest error of the height on the pixels checked", "m"),
    "bounded": ("part of the pixels checked on which the estimated errors bound the true ones", "1"),
    "failed": ("part without an orbit", "1"),
}
"""What is measured of an image, and its units."""


def rough(size: int, limits: Range, seed: int, decades: bool) -> Array:
    """Return a rough map between two values, spread over the decades between them or evenly."""
    heights = roughness((size, size), 1e-9, rms=1e-9, correlation_length=size * 1e-9 / 6, seed=seed)
    share = (heights - heights.min()) / np.ptp(heights)
    low, high = limits
    return np.asarray(low * (high / low) ** share if decades else low + share * (high - low))


def surface_of(one: Map, size: int, seed: int) -> Surface:
    """The surface of a map."""
    return Surface(
        rough(size, one.modulus, 3 * seed, True),
        adhesion=rough(size, one.adhesion, 3 * seed + 1, False),
        damping=rough(size, one.damping, 3 * seed + 2, True),
        pixel_size=1e-9,
    )


def measure_images(quick: bool, seed: int, progress: Callable[[str], None]) -> xr.Dataset:
    """Simulate every map, and solve random pixels of it by collocation.

    Returns, over "image": image_size [1], image_time and image_time_alone [s], image_interpolated [1],
        image_phase_error [degree] and image_height_error [m] (largest), image_bounded [1] and image_failed [1].
    """
    checked = QUICK_CHECKED if quick else CHECKED
    rows = {}
    for one in MAPS:
        progress(f"image, {one.name}")
        size = min(QUICK_SIZE if quick else SIZE, one.most)
        surface = surface_of(one, size, seed)
        simulate(surface, one.scope, one.setpoint)  # compiles
        alone, _ = best_of(partial(simulate, surface, one.scope, one.setpoint, threads=1), 0.0)
        seconds, image = best_of(partial(simulate, surface, one.scope, one.setpoint), 0.0)
        rows[one.name] = (size, seconds, alone, *_compare(one, surface, image, checked, seed))
    return dataset("image", rows, ABOUT, image_checked=checked, image_threads=workers_of(None))


def _compare(one: Map, surface: Surface, image: xr.Dataset, checked: int, seed: int) -> tuple[float, ...]:
    """Interpolated part, largest errors, part that is bounded, part that failed."""
    pixels = np.random.default_rng(seed).choice(image.phase.size, checked, replace=False)
    materials = surface.materials(pixels)
    work = make_work(materials, False, one.scope, np.full(checked, one.setpoint * one.scope.driven_amplitude))
    exact, status, _ = run(Orbit(complete=True), work, Accuracy())
    held = status == col.GOOD
    seen = {
        name: image[name].values.reshape(-1)[pixels] for name in ("phase", "tip_offset", "error_phase", "error_height")
    }
    phase = abs(seen["phase"] - np.degrees(exact[:, col.PHASE]))[held]
    height = abs(seen["tip_offset"] - exact[:, col.TIP_OFFSET])[held]
    bounded = (phase <= seen["error_phase"][held]) & (height <= seen["error_height"][held])
    interpolated = float((image["solver"].values == col.INTERPOLATED).mean())
    failed = float((image["status"].values != col.GOOD).mean())
    return interpolated, float(phase.max()), float(height.max()), float(bounded.mean()), failed
