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
    pixels: int = PIXELS,
    seed: int = 1,
    peers: bool = True,
    quick: bool = False,
    progress: Callable[[str], None] | None = None,
) -> xr.Dataset:
    """Measure error and time of every method.

    `pixels`: cases of each regime that are compared with the reference; more pixels are timed.
    `peers`: whether numbalsoda, heyoka and scipy are measured too, as far as they are installed.
    `quick`: repeat timings less often, and do not time compilation from scratch.
    Returns dims ("regime", "solver", "case"): phase_error [degree], height_error [m], result (flags), time,
        period_time, compile_time [s], the parameters of the cases and the references; ("image",): whole images in
        which every pixel differs; ("curve",): whole curves; and ("extra",): images with more than usual.
        `phasemap.validation.bench.report.table` and `phasemap.validation.bench.picture.draw` show it.
    """
    whole("pixels", pixels, 1)
    whole("seed", seed, 0)
    from phasemap.validation.bench.curves import measure_curves
    from phasemap.validation.bench.extras import measure_extras
    from phasemap.validation.bench.images import measure_images
    from phasemap.validation.bench.measure import Plan, measure
    from phasemap.validation.bench.peers import installed
    from phasemap.validation.bench.record import to_dataset

    present, absent = installed() if peers else ([], [])
    say = progress or (lambda text: None)
    measured = to_dataset(measure(Plan.of(pixels, seed, quick), present, absent, say))
    images, curves, extras = measure_images(quick, seed, say), measure_curves(say), measure_extras(quick, seed, say)
    attributes = measured.attrs | images.attrs | curves.attrs
    return measured.merge(images).merge(curves).merge(extras).assign_attrs(attributes)
