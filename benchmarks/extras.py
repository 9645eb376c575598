"""What an image costs with more than height and phase: derived channels, harmonics, a second mode, relaxation."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from timeit import Timer
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.images import MAPS, Map, surface_of
from benchmarks.tables import dataset
from phasemap._shared.notices import ResultWarning
from phasemap.experiment.microscope import Microscope, Mode
from phasemap.experiment.surface import Surface
from phasemap.imaging.simulation import simulate

if TYPE_CHECKING:
    import xarray as xr

SIZE, QUICK_SIZE = 256, 128  # pixels along a side of the map that is interpolated
SOLVED, MARCHED = 64, 8  # pixels along a side of those whose pixels are solved one by one, and in time
TURNS, QUICK_TURNS = 5, 2
PLAIN = ("height", "phase", "amplitude", "tip_offset", "indentation", "dissipation", "virial")
DERIVED = ("loss_tangent", "loss_tangent_corrected", "dissipation_ev", "dissipated_power")
HARMONICS = tuple(f"{kind}_{n}" for kind in ("amplitude", "phase") for n in range(2, 7))
SECOND = Mode(free_amplitude=0.1e-9)
RELAXATION_TIME = 30e-9  # [s]
"""A tap of a few hundred nanoseconds sees most of it."""
AT_ONCE = 2.0  # modulus of a sudden dent over that of one that lasts


@dataclass(frozen=True)
class Extra:
    """An image without something, and with it."""

    name: str
    plain: Callable[[], object]
    extended: Callable[[], object]


def _extras(quick: bool, seed: int) -> list[Extra]:
    one = MAPS[1]
    found = []
    for size, solver, how in ((QUICK_SIZE if quick else SIZE, "auto", "interpolated"), (SOLVED, "orbit", "solved")):
        found += _of_map(one, surface_of(one, size, seed), solver, how)
    return [*found, _relaxing(one, surface_of(one, MARCHED, seed))]


def _of_map(one: Map, surface: Surface, solver: str, how: str) -> list[Extra]:
    """What the orbits of one image are asked for besides."""
    two = replace(one.scope, cantilever=replace(one.scope.cantilever, modes=2))
    bimodal = replace(two, drive=replace(two.drive, second=SECOND))

    def image(variables: tuple[str, ...] | None, scope: Microscope) -> object:
        return simulate(surface, scope, one.setpoint, solver=solver, variables=variables, threads=1)

    usual = partial(image, PLAIN, one.scope)
    return [
        Extra(f"four derived channels, {how}", usual, partial(image, (*PLAIN, *DERIVED), one.scope)),
        Extra(f"harmonics 2 to 6, {how}", usual, partial(image, (*PLAIN, *HARMONICS), one.scope)),
        Extra(f"a second mode, {how}", partial(image, None, two), partial(image, None, bimodal)),
    ]


def _relaxing(one: Map, surface: Surface) -> Extra:
    """The same materials, elastic and relaxing."""
    modulus, adhesion = np.asarray(surface.modulus), surface.adhesion
    elastic = Surface(AT_ONCE * modulus, adhesion, pixel_size=1e-9)
    relaxing = Surface(
        AT_ONCE * modulus, adhesion, relaxed_modulus=modulus, relaxation_time=RELAXATION_TIME, pixel_size=1e-9
    )
    plain, extended = (
        partial(simulate, each, one.scope, one.setpoint, solver="march", threads=1) for each in (elastic, relaxing)
    )
    return Extra("one relaxation time, marched", plain, extended)


def measure_extras(quick: bool, seed: int, progress: Callable[[str], None]) -> xr.Dataset:
    """Time images without and with each extra on one core.

    Returns, over "extra": extra_plain and extra_time [s].
    """
    turns, rows = QUICK_TURNS if quick else TURNS, {}
    for one in _extras(quick, seed):
        progress(f"image with {one.name}")
        with warnings.catch_warnings():  # that the second mode is not small on some materials
            warnings.simplefilter("ignore", ResultWarning)
            one.plain(), one.extended()  # compiles
            clocks = [Timer(call, timer=time.process_time) for call in (one.plain, one.extended)]
            rows[one.name] = np.min([[clock.timeit(1) for clock in clocks] for _ in range(turns)], axis=0)  # in turns
    about = {
        "plain": ("time of an image without it, after compilation", "s"),
        "time": ("time of an image with it, after compilation", "s"),
    }
    return dataset("extra", rows, about)
