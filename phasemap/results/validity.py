"""Results outside what the model describes: counted, with what cures them.

The model is a rigid tip on a half-space, or on a film on a rigid base, and the first eigenmode of the lever. It solves
what lies outside too, and such an image looks like any other.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr

from phasemap._shared.units import counted, say

FORCES = ("adhesion_force", "lever_force")
"""Attributes of an image: the largest adhesion between tip and sample, and stiffness times free amplitude [N]."""
LOW_Q = 20.0  # below this, first-order averaging is off by degrees
DETUNED = 0.15  # 1 - omega^2 from which it is: with Q 60 to 600, 0.6 to 3 degree and 2 to 20 nm in one case of ten
FREE = 1.2  # times the adhesion: force at which a lever comes free; 1.1 did wherever it was tried
WIDE, DEEP = 2.0, 0.3  # contact radius, and depth, over a film's thickness that its law is good for
SMALL_SECOND = 0.05  # bimodal_modulus_bound up to which the second mode counts as small
AVERAGING = 0  # among the flags of `solver`


def describe_validity(ds: xr.Dataset, what: str = "pixels") -> list[str]:
    """Say how many results are outside the validity of the model, and what cures them, in a line for each cause."""
    configuration = json.loads(ds.attrs.get("configuration", "{}"))
    if "microscope" not in configuration:
        return []
    return list(_lines(ds, configuration, what))


def _lines(ds: xr.Dataset, configuration: dict[str, Any], what: str) -> Iterator[str]:
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
    if "bimodal_modulus_bound" in ds and configuration.get("solver") != "march":
        bound = ds["bimodal_modulus_bound"].values
        if (rough := bound > SMALL_SECOND).any():
            yield (
                f"{_of(rough, what)}: the second mode moves too much, or the tap is too hard, to know the bimodal "
                f"modulus to 5 % (bimodal_modulus_bound is up to {np.nanmax(bound):.2g}). Lower the second mode's "
                "free_amplitude to a twentieth of the indentation, raise the setpoint, or take the solver 'march', "
                "which integrates both drives."
            )
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
    """By how much averaging is off, and where that is so; empty if it is not by much."""
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


def _of(which: np.ndarray, what: str) -> str:
    """How many of how many."""
    return counted(int(np.count_nonzero(which)), which.size, what)
