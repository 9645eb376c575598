"""Speed against error: every solver at every tolerance, and general integrators, over regimes of scope and material.

Cases are drawn at random within a regime (`regimes`), errors are against periodic orbits found by code that shares
nothing with the solvers (`reference`), and what is slow, wrong or fails is in the result like everything else.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from phasemap._shared.checks import whole

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["bench"]

PIXELS, QUICK_PIXELS = 40, 6
"""Cases of a regime that are compared with the reference."""


def bench(
    pixels: int | None = None,
    seed: int = 1,
    peers: bool = True,
    quick: bool = False,
    progress: Callable[[str], None] = lambda text: None,
) -> xr.Dataset:
    """Measure error and time of every method.

    `pixels`: cases of each regime that are compared with the reference; more pixels are timed.
    `peers`: whether numbalsoda, heyoka and scipy are measured too, as far as they are installed.
    `quick`: repeat timings less often, and do not time compilation from scratch.
    Returns dims ("regime", "solver", "case"): phase_error [degree], height_error [m], result (flags), time,
        period_time, compile_time [s], the parameters of the cases and the references; ("image",): whole images in
        which every pixel differs; ("curve",): whole curves; and ("extra",): images with more than usual.
        `report.table` and `picture.draw` show it.
    """
    pixels = whole("pixels", (QUICK_PIXELS if quick else PIXELS) if pixels is None else pixels, 1)
    whole("seed", seed, 0)
    from benchmarks.accuracy.measure import Plan, measure
    from benchmarks.accuracy.peers import installed
    from benchmarks.curves import measure_curves
    from benchmarks.extras import measure_extras
    from benchmarks.images import measure_images

    parts = [
        measure(Plan.of(pixels, seed, quick), *(installed() if peers else ([], [])), progress),
        measure_images(quick, seed, progress),
        measure_curves(progress),
        measure_extras(quick, seed, progress),
    ]
    merged = parts[0].merge(parts[1]).merge(parts[2]).merge(parts[3])
    return merged.assign_attrs({name: value for part in parts for name, value in part.attrs.items()})
