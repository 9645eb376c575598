"""`phasemap check` finds whatever is altered in a file and matters: one alteration of a good image a test.

What leaves no trace, by definition, and is not among them:

* history, seconds, Conventions, long names and comments: notes, of which nothing is claimed;
* a variable less: `simulate` leaves out what is not asked for;
* the resonance frequency, where drive and damping are relative to it; Poisson's ratio of a rigid tip; a seed where
  nothing is random: no number depends on them.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import xarray as xr

import phasemap as pm
from phasemap.validation.picture import FAILS, OPEN

MATERIALS = {
    0: pm.Material(0.3e9, adhesion=0.05, damping=0.02),
    1: pm.Material(1e9, adhesion=0.1, damping=0.05),
    2: pm.Material(2e9, adhesion=0.03, damping=0.005),
    3: pm.Material(5e9, adhesion=0.06),
}
LABELS = np.random.default_rng(5).integers(0, 4, (6, 8))
RELIEF = 1e-10 * np.arange(48.0).reshape(6, 8)
SURFACE = pm.Surface.from_labels(LABELS, MATERIALS, pixel_size=2e-9, topography=RELIEF)
SCOPE = pm.Microscope(pm.Cantilever(10.0, 150e3, 200.0), pm.Tip(10e-9), pm.Drive(20e-9))

Change = Callable[[xr.Dataset], Any]


@pytest.fixture(scope="module")
def good() -> xr.Dataset:
    return pm.simulate(SURFACE, SCOPE, setpoint=0.7)


def shift(by: float, *names: str) -> Change:
    def do(image: xr.Dataset) -> None:
        for name in names:
            image[name] += by

    return do


def scale(by: float, *names: str) -> Change:
    def do(image: xr.Dataset) -> None:
        for name in names:
            image[name] *= by

    return do


def fill(name: str, value: float) -> Change:
    def do(image: xr.Dataset) -> None:
        image[name][...] = value

    return do


def one(name: str, change: Callable[[Any], Any]) -> Change:
    def do(image: xr.Dataset) -> None:
        image[name][..., 3, 4] = change(image[name].values[..., 3, 4])

    return do


def every(name: str, change: Callable[[np.ndarray], np.ndarray]) -> Change:
    """Of all variables where the name is empty."""

    def do(image: xr.Dataset) -> None:
        for each in [name] if name else list(image.data_vars):
            image[each][...] = change(image[each].values.copy())

    return do


def said(*path: str, value: Any) -> Change:
    def do(image: xr.Dataset) -> None:
        stored = inside = json.loads(image.attrs["configuration"])
        for name in path[:-1]:
            inside = inside[name]
        assert inside[path[-1]] != value
        inside[path[-1]] = value
        image.attrs["configuration"] = json.dumps(stored)

    return do


def attribute(name: str, key: str, value: Any) -> Change:
    return lambda image: image[name].attrs.update({key: value})


def both(*changes: Change) -> Change:
    def do(image: xr.Dataset) -> None:
        for change in changes:
            change(image)

    return do


def swapped(values: np.ndarray) -> np.ndarray:
    """Two neighbours that are of different materials, exchanged."""
    y, x = np.argwhere(LABELS[:, 1:] != LABELS[:, :-1])[0]
    values[..., y, [x, x + 1]] = values[..., y, [x + 1, x]]
    return values


ALTERATIONS: dict[str, Change] = {
    # Numbers of all pixels.
    "phase 0.001 degree up": shift(1e-3, "phase"),
    "phase 0.001 degree down": shift(-1e-3, "phase"),
    "phase turned": scale(-1.0, "phase"),
    "phase the lag": every("phase", lambda values: 90 - values),
    "phase in rad": every("phase", np.radians),
    "height 1 pm up": shift(1e-12, "height"),
    "height and tip offset 1 pm up": shift(1e-12, "height", "tip_offset"),
    "height without relief": every("height", lambda values: values - RELIEF),
    "height upside down": scale(-1.0, "height"),
    "height in nm": scale(1e9, "height"),
    "tip offset 1 pm up": shift(1e-12, "tip_offset"),
    "amplitude a millionth larger": scale(1 + 1e-6, "amplitude"),
    "mean deflection 1 % larger": scale(1.01, "mean_deflection"),
    "mean deflection turned": scale(-1.0, "mean_deflection"),
    "mean deflection 0": fill("mean_deflection", 0.0),
    "indentation a tenth larger": scale(1.1, "indentation"),
    "indentation turned": scale(-1.0, "indentation"),
    "indentation 0": fill("indentation", 0.0),
    "dissipation 0.01 % larger": scale(1.0001, "dissipation"),
    "dissipation turned": scale(-1.0, "dissipation"),
    "dissipation 0": fill("dissipation", 0.0),
    "dissipation in eV": scale(6.241509e18, "dissipation"),
    "virial 0.1 % larger": scale(1.001, "virial"),
    "virial turned": scale(-1.0, "virial"),
    "virial 0": fill("virial", 0.0),
    "dissipation and virial 0.1 % larger": scale(1.001, "dissipation", "virial"),
    "stated errors of the phase 0": fill("error_phase", 0.0),
    "stated errors of the phase a thousandth": scale(1e-3, "error_phase"),
    "stated errors of the phase negative": scale(-1.0, "error_phase"),
    "stated errors of the phase infinite": fill("error_phase", np.inf),
    "stated errors of the phase missing": fill("error_phase", np.nan),
    "stated errors of the height 0": fill("error_height", 0.0),
    "stated errors of the height a thousandth": scale(1e-3, "error_height"),
    "stated errors of both a thousandth": scale(1e-3, "error_phase", "error_height"),
    "energy closure 1e-4": shift(1e-4, "energy_closure"),
    "energy closure missing": fill("energy_closure", np.nan),
    "a spread of the amplitude": fill("amplitude_spread", 1e-12),
    "a spread of the phase": fill("phase_spread", 0.01),
    # Flags of all pixels.
    "branches exchanged": every("branch", lambda values: 1 - values),
    "branches unknown": fill("branch", -1),
    "all irregular": fill("motion", 1),
    "all irregular, with spreads": both(
        fill("motion", 1), fill("amplitude_spread", 1e-10), fill("phase_spread", 0.2)
    ),
    "all by the march": fill("solver", 2),
    "all averaged": fill("solver", 0),
    "all interpolated": fill("solver", 3),
    "nothing solved": fill("status", 1),
    "numbers lost": fill("phase", np.nan),
    # Single pixels, and their order.
    "phase of a pixel 1e-6 degree up": one("phase", lambda value: value + 1e-6),
    "dissipation of a pixel a millionth larger": one("dissipation", lambda value: value * (1 + 1e-6)),
    "indentation of a pixel turned": one("indentation", lambda value: -value),
    "height of a pixel 1 pm up": one("height", lambda value: value + 1e-12),
    "status of a pixel": one("status", lambda _: 1),
    "branch of a pixel": one("branch", lambda value: 1 - value),
    "motion of a pixel": one("motion", lambda _: 1),
    "an unknown status": one("status", lambda _: 77),
    "left and right exchanged": every("", lambda values: values[..., ::-1]),
    "top and bottom exchanged": every("", lambda values: values[..., ::-1, :]),
    "moved by a pixel": every("", lambda values: np.roll(values, 1, axis=-1)),
    "two pixels exchanged": every("", swapped),
    "a line repeated": every("", lambda values: values[..., [0, *range(5)], :]),
    # What the file says it is.
    "another setpoint": said("setpoint", value=0.70001),
    "another solver": said("solver", value="orbit"),
    "a slow solver": said("solver", value="march"),
    "a solver without errors": said("solver", value="averaging"),
    "a sharper accuracy": said("accuracy", "phase", value=1e-6),
    "a looser accuracy": said("accuracy", value={"kind": "accuracy", "phase": 10.0, "height": 1e-9}),
    "a scan of both directions": said("control", value={"kind": "raster", "engage": "line"}),
    "offsets of the lines": said("realism", "line_offset", value=1e-10),
    "drift": said("realism", "drift", value=[4e-9, 0.0, 0.0]),
    "a tip that changed": said("realism", "tip_change", value={"kind": "tipchange", "line": 3, "radius": 11e-9}),
    "quantised": said("realism", "bits", value=12),
    "quantised in part": both(said("realism", "bits", value=12), every("phase", lambda values: values.round(3))),
    "another stiffness": said("microscope", "cantilever", "stiffness", value=10.01),
    "another quality factor": said("microscope", "cantilever", "quality_factor", value=200.1),
    "another radius": said("microscope", "tip", "radius", value=10.01e-9),
    "an elastic tip": said("microscope", "tip", "modulus", value=130e9),
    "another free amplitude": said("microscope", "drive", "free_amplitude", value=20.01e-9),
    "another frequency": said("microscope", "drive", "frequency", value=149.99e3),
    "another law of contact": said("microscope", "interaction", "contact", value="hertz"),
    "another decay length": said("microscope", "interaction", "decay_length", value=0.31e-9),
    "another exponent of damping": said("microscope", "interaction", "damping_exponent", value=0.6),
    "a bias": said("microscope", "interaction", "bias", value=1.0),
    # How it is laid out.
    "another shape": said("shape", value=[8, 6]),
    "another pixel size": said("pixel_size", value=[2e-9, 2.1e-9]),
    "coordinates moved": lambda image: image.coords.update({"x": image["x"] + 1e-9}),
    "coordinates turned": lambda image: image.coords.update({"y": image["y"][::-1].values}),
    "phase said to be in rad": attribute("phase", "units", "rad"),
    "units that are no text": attribute("height", "units", np.arange(3)),
    "other meanings of flags": attribute("status", "flag_meanings", "good " * 12),
    "other values of flags": attribute("branch", "flag_values", np.array([0, 1, 2])),
    "another variable": lambda image: image.update({"voltage": image["height"]}),
}  # fmt: skip


def test_the_image_is_good(good: xr.Dataset) -> None:
    found = pm.check(good, SURFACE)
    assert found.holds and all(claim.result != OPEN for claim in found.claims), str(found)
    assert len(ALTERATIONS) >= 53


@pytest.mark.parametrize("name", ALTERATIONS)
def test_an_alteration_is_found(name: str, good: xr.Dataset) -> None:
    image = good.copy(deep=True)
    ALTERATIONS[name](image)
    found = pm.check(image, SURFACE, pixels=24)
    assert [claim for claim in found.claims if claim.result == FAILS], str(found)


IN_TIME = (
    "phase 0.001 degree up", "height 1 pm up", "height and tip offset 1 pm up", "amplitude a millionth larger",
    "branches exchanged", "all by the march", "nothing solved", "numbers lost", "height of a pixel 1 pm up",
    "branch of a pixel", "two pixels exchanged", "a line repeated", "another setpoint", "offsets of the lines", "drift",
    "quantised", "another stiffness", "another quality factor", "another radius", "another variable",
)  # fmt: skip


@pytest.fixture(scope="module")
def scan() -> xr.Dataset:
    return pm.simulate(SURFACE, SCOPE, setpoint=0.7, control=pm.Feedback(line_rate=200.0))


@pytest.mark.parametrize("name", IN_TIME)
def test_an_alteration_of_a_scan_in_time_is_found(name: str, scan: xr.Dataset) -> None:
    image = scan.copy(deep=True)
    ALTERATIONS[name](image)
    assert not pm.check(image, SURFACE).holds
