"""Results in words: what failed, what is irregular or outside the model, which flags occur, and what a result is of.

The model is a rigid tip on a half-space, or on a film on a rigid base, and the modes of the lever. It solves what lies
outside too, and such an image looks like any other: so it is counted, with what cures it.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr

from phasemap._shared.units import counted, say
from phasemap.experiment.cantilever import Cantilever
from phasemap.experiment.described import made
from phasemap.results.status import Status

SOLVED_BY = {
    "averaging": "averaging (first order)",
    "orbit": "orbit (exact)",
    "corrected": "orbit (exact)",
    "march": "integration in time",
    "interpolated": "interpolation between materials",
}
"""Names in summaries and titles of the solvers of `phasemap.results.variables.SOLVER_NAMES`."""
NOTABLE = 0.5  # contrast [degree] that barely stands out of the noise of a phase image

FORCES = ("adhesion_force", "lever_force")
"""Attributes of an image: the largest adhesion between tip and sample, and stiffness times free amplitude [N]."""
LOW_Q = 20.0  # below this, first-order averaging is off by degrees
DETUNED = 0.15  # 1 - omega^2 from which it is: with Q 60 to 600, 0.6 to 3 degree and 2 to 20 nm in one case of ten
FREE = 1.2  # times the adhesion: force at which a lever comes free; 1.1 did wherever it was tried
WIDE, DEEP = 2.0, 0.3  # contact radius, and depth, over a film's thickness that its law is good for
SMALL_SECOND = 0.05  # bimodal_modulus_bound up to which the second mode counts as small
AVERAGING = 0  # among the flags of `solver`


def describe_failures(ds: xr.Dataset, what: str = "pixels") -> list[str]:
    """Say how many pixels have no solution, why, and what helps: a line for each way a pixel failed."""
    if "status" not in ds:
        return []
    status = ds["status"].values
    codes, counts = np.unique(status[status != 0], return_counts=True)  # to sort them all takes as long as an image
    about = json.loads(ds.attrs.get("configuration", "{}"))
    at_offset = "tip_offset" in (about.get("sweep"), *about)
    held = "" if "sweep" not in about else "tip offset" if at_offset else "setpoint"
    acts = about.get("microscope", {}).get("interaction")
    return [
        f"{counted(int(count), status.size, what)}: {Status.of(int(code)).advice(held, acts)}"
        for code, count in zip(codes, counts, strict=True)
    ]


def describe_irregular(ds: xr.Dataset, what: str = "pixels") -> list[str]:
    """Say in a line how many pixels show the mean of motion that is not periodic, if any, and how far it is spread."""
    count = int(np.count_nonzero(ds["motion"].values == 1)) if "motion" in ds else 0
    if not count:
        return []
    spreads = [
        say(float(np.nanmax(ds[name].values)), units, 2)
        for name, units in (("amplitude_spread", "m"), ("phase_spread", "degree"))
        if name in ds
    ]
    most = f", spread up to {' and '.join(spreads)}" if spreads else ""
    return [f"{counted(count, ds['motion'].size, what)} irregular: mean amplitude and phase{most}"]


def describe_alike(ds: xr.Dataset, materials: int) -> list[str]:
    """Say in a line if several materials can hardly be told apart by their phase, where every pixel has one."""
    if materials < 2 or "phase" not in ds or not np.isfinite(ds["phase"].values).all():
        return []
    apart = float(np.ptp(ds["phase"].values))
    if apart > NOTABLE:
        return []
    return [
        f"the phases of the {materials} materials are within {apart:.2g} degrees: they take nearly the same energy "
        "from the tip at this amplitude. `phasemap contrast` finds a setpoint and free amplitude that distinguish them."
    ]


def describe_solvers(solver: xr.DataArray) -> str:
    """Say which methods solved the pixels and how many each, most frequent first."""
    meanings = [SOLVED_BY.get(name, name) for name in solver.attrs["flag_meanings"].split()]
    return _shares(solver, meanings)


def describe_flags(flags: xr.DataArray) -> str:
    """Say which flags of a CF variable occur and how often, most frequent first."""
    return _shares(flags, flags.attrs["flag_meanings"].split())


def _shares(flags: xr.DataArray, meanings: list[str]) -> str:
    """The meanings that occur, with the share of each where there are several."""
    names: dict[int, str] = dict(zip(np.atleast_1d(flags.attrs["flag_values"]).tolist(), meanings, strict=True))
    shares: Counter[str] = Counter()
    for value, count in zip(*np.unique(flags.values, return_counts=True), strict=True):
        shares[names.get(int(value), "none")] += int(count)
    if len(shares) == 1:
        return next(iter(shares))
    return ", ".join(f"{name} {100 * count / flags.size:.3g} %" for name, count in shares.most_common())


def titles(ds: xr.Dataset) -> list[str]:
    """Title, material and microscope of a sweep, a line each, from its ``configuration``; what is swept is left out."""
    about = json.loads(ds.attrs.get("configuration", "{}"))
    swept = about.get("sweep", "")
    material = about.get("material", {})
    scope = about.get("microscope", {})
    lines = [
        [ds.attrs["title"]] if "title" in ds.attrs else [],
        [
            *_in_words(material, swept, modulus=("modulus {}", "Pa"), adhesion=("adhesion {}", "J m-2")),
            *_in_words(material, swept, **_loss(material)),
            *_in_words(about, swept, setpoint=("setpoint held at {}", "1"), tip_offset=("tip offset held at {}", "m")),
        ],
        microscope_in_words(scope, swept),
    ]
    return [", ".join(line) for line in lines if line]


def microscope_in_words(scope: dict[str, Any], swept: str = "") -> list[str]:
    """Lever, tip and drive of a ``configuration`` in words, as far as they are known, without what is swept."""
    lever, tip, drive = (scope.get(part, {}) for part in ("cantilever", "tip", "drive"))
    return [
        *_in_words(lever, swept, stiffness=("lever {}", "N m-1"), resonance_frequency=("{}", "Hz")),
        *_in_words(lever, swept, quality_factor=("Q {}", "1")),
        *_in_words(tip, swept, radius=("tip radius {}", "m")),
        *_in_words(drive, swept, free_amplitude=("free amplitude {}", "m"), frequency=("driven at {}", "Hz")),
    ]


def _loss(material: dict[str, Any]) -> dict[str, tuple[str, str]]:
    """Columns that describe the loss of a material, with a text and a unit each."""
    if material.get("relaxation_time") is not None:
        return {"relaxed_modulus": ("relaxed {}", "Pa"), "relaxation_time": ("in {}", "s")}
    if material.get("viscosity") is not None:
        return {"viscosity": ("viscosity {}", "Pa s")}
    return {"damping": ("damping {}", "1")}


def _in_words(table: dict[str, Any], swept: str, **words: tuple[str, str]) -> list[str]:
    """Values of a table that are given and not swept, in words."""
    return [
        phrase.format(say(table[name], units, 5))
        for name, (phrase, units) in words.items()
        if table.get(name) is not None and name != swept
    ]


def of_file(ds: xr.Dataset, name: str, i: int, scale: float = 1.0) -> str:
    """The setpoint or free amplitude of a file as recorded, else from where to where it may be."""
    recorded = scale * float(ds[f"recorded_{name}"][i])
    if math.isfinite(recorded):
        return f"{recorded:.3g}"
    ends = [scale * float(ds[f"{name}_{end}"][i]) for end in ("low", "high")]
    return " to ".join(f"{end:.0f}" if end >= 100 else f"{end:.2g}" for end in ends)


def describe_validity(ds: xr.Dataset, what: str = "pixels") -> list[str]:
    """Say how many results are outside the validity of the model, and what cures them, in a line for each cause."""
    configuration = json.loads(ds.attrs.get("configuration", "{}"))
    if "microscope" not in configuration:
        return []
    return list(_validity_lines(ds, configuration, what))


def _validity_lines(ds: xr.Dataset, configuration: dict[str, Any], what: str) -> Iterator[str]:
    """Lines on depth, films, a second drive, long contacts, failures and averaging, where they exceed the model."""
    lever, tip = configuration["microscope"]["cantilever"], configuration["microscope"]["tip"]
    if "indentation" in ds:
        depths = ds["indentation"].values
        deep = depths > tip["radius"]
        if deep.any():
            most = f"{say(float(np.nanmax(depths)), 'm', 3)} into it, {say(tip['radius'], 'm', 3)}"
            yield (
                f"{_of(deep, what)}: the tip sinks in deeper than its radius ({most}), where it is no longer a sphere. "
                "Raise the setpoint, lower the free amplitude, or give a larger radius."
            )
    yield from _of_films(ds, configuration, what)
    yield from _of_second_drive(ds, configuration, what)
    if {"tip_offset", "mean_deflection"} <= set(ds.data_vars):
        inside = ds["tip_offset"].values < ds["mean_deflection"].values
        if inside.any():
            yield (
                f"{_of(inside, what)}: the tip is in contact for more than half of each period, where a lever bends "
                "otherwise than when it is free. Raise the setpoint or the free amplitude, or take a stiffer lever."
            )
    failed = ds["status"].values != 0 if "status" in ds else np.zeros(1, bool)
    holds, pulls = (ds.attrs.get(name, 0.0) for name in FORCES)
    if failed.any() and holds > pulls:
        yield (
            f"{_of(failed, what)} failed, and the tip may stick: adhesion holds it with up to "
            f"{say(holds, 'N', 3)}, the lever pulls with {say(pulls, 'N', 3)} at its free amplitude. Take a free "
            f"amplitude above {say(FREE * holds / lever['stiffness'], 'm', 2)}, a stiffer lever, or the smaller "
            "adhesion that there is in liquid."
        )
    if configuration.get("solver") == "averaging" and "solver" in ds:
        averaged = ds["solver"].values == AVERAGING
        if averaged.any() and (where := _off_by_averaging(configuration["microscope"])):
            yield f"{_of(averaged, what)}: first-order averaging is off by {where}. Take the solver 'auto' or 'orbit'."


def _off_by_averaging(microscope: dict[str, Any]) -> str:
    """Error of averaging in words, where it is large; else empty."""
    lever, driven = microscope["cantilever"], microscope.get("drive", {}).get("frequency")
    if lever["quality_factor"] < LOW_Q:
        return f"degrees at Q = {lever['quality_factor']:g}"
    ratio = driven / lever["resonance_frequency"] if driven else 1.0
    return f"up to some degrees and nanometres at {ratio:.3g} of the resonance" if abs(1 - ratio**2) > DETUNED else ""


def _of_films(ds: xr.Dataset, configuration: dict[str, Any], what: str) -> Iterator[str]:
    """Lines for films that are too thin for their law."""
    material = configuration.get("material", {})
    thickness = ds["thickness"] if "thickness" in ds.variables else material.get("thickness")
    if thickness is None or "indentation" not in ds:
        return
    depth = ds["indentation"].clip(min=0)
    width = (np.sqrt(configuration["microscope"]["tip"]["radius"] * depth) / thickness).values
    share = (depth / thickness).values
    cure = "Raise the setpoint or lower the free amplitude"
    if (wide := width > WIDE).any():
        yield (
            f"{_of(wide, what)}: the contact's radius is up to {np.nanmax(width):.3g} times the film's thickness; the "
            f"law of the film is good to 1 % up to {WIDE:g} times. {cure}, or take a smaller tip radius."
        )
    if (deep := share > DEEP).any():
        yield (
            f"{_of(deep, what)}: the tip sinks in by up to {np.nanmax(share):.2g} of the film's thickness; above "
            f"{DEEP:g} of it strains are too large for linear elasticity. {cure}."
        )


def _of_second_drive(ds: xr.Dataset, configuration: dict[str, Any], what: str) -> Iterator[str]:
    """Yield a sentence where no quadrature along the orbit shows the response to the second drive, or nothing does."""
    microscope = configuration["microscope"]
    if not microscope["drive"].get("second"):
        return
    if "estimated_error" in ds.attrs:  # in time
        yield (
            "a scan in time moves the lever by its first drive alone: the image has nothing of the second mode. "
            "Take the control Engage or Raster, whose images do."
        )
        return
    if configuration.get("solver") == "march":
        return
    shown = [name for name in ds.data_vars if str(name).startswith(("mode2_", "bimodal_"))]
    _, second, *_ = made(microscope["cantilever"], Cantilever).eigenmodes
    if shown and second.quality_factor < 2 * second.frequency_ratio:
        yield (
            f"the second mode has a Q of {second.quality_factor:.3g}, so that all sidebands of the two drives swing in "
            "it: what its drive shows may be off by any factor. Take the solver 'march' and the control Engage, which "
            "integrate both drives."
        )
    elif "bimodal_modulus_bound" in ds and (ds["bimodal_modulus_bound"] > SMALL_SECOND).any():
        bound = ds["bimodal_modulus_bound"].values
        yield (
            f"{_of(bound > SMALL_SECOND, what)}: the second mode moves too much, or the tap is too hard, to know the "
            f"bimodal modulus to 5 % (bimodal_modulus_bound is up to {np.nanmax(bound):.2g}). Lower the second mode's "
            "free_amplitude to a twentieth of the indentation, raise the setpoint, or take the solver 'march' "
            "and the control Engage, which integrate both drives."
        )


def _of(which: np.ndarray, what: str) -> str:
    """Text "k of n ...", with the number of pixels that are True."""
    return counted(int(np.count_nonzero(which)), which.size, what)
