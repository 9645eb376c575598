"""Images for sidpy."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
import xarray as xr

import phasemap as pm
from phasemap._shared.errors import InputError, PhasemapError


def image(directions: bool = False) -> xr.Dataset:
    rng = np.random.default_rng(1)
    dims, shape = (("direction", "y", "x"), (2, 4, 6)) if directions else (("y", "x"), (4, 6))
    data = {
        "height": (dims, 1e-9 * rng.normal(size=shape), {"units": "m"}),
        "phase": (dims, rng.normal(size=shape), {"units": "degree"}),
        "branch": (dims, np.zeros(shape, np.int8)),
    }
    coords: dict[str, Any] = {"y": 4e-9 * (np.arange(4)[::-1] + 0.5), "x": 3e-9 * (np.arange(6) + 0.5)}
    if directions:
        coords["direction"] = ["trace", "retrace"]
    return xr.Dataset(data, coords, {"setpoint": 0.7})


@pytest.mark.parametrize("directions", [False, True])
def test_sidpy_has_an_image_as_it_was(directions: bool) -> None:
    sidpy = pytest.importorskip("sidpy", reason='needs pip install "afm-phasemap[sidpy]"')
    given = image(directions)
    made = pm.to_sidpy(given)
    assert [one.quantity for one in made.values()][: 1 + directions] == ["Height", "HeightRetrace"][: 1 + directions]
    phase = next(one for one in made.values() if one.quantity == "Phase")
    assert phase.data_type == sidpy.DataType.IMAGE and phase.units == "deg" and phase.shape == (6, 4)
    np.testing.assert_allclose(phase.x.values, given.x.values)
    assert (phase.x.units, phase.y.units) == ("m", "m") and phase.original_metadata["setpoint"] == 0.7
    first = given.isel(direction=0) if directions else given
    np.testing.assert_array_equal(phase.compute(), first.phase.values.T)
    np.testing.assert_array_equal(made["Channel_000"].compute(), first.height.values.T)
    alone = pm.to_sidpy(first.assign_attrs(direction="retrace"))
    assert [one.quantity for one in alone.values()] == ["HeightRetrace", "PhaseRetrace"]


def test_what_does_not_fit_is_named() -> None:
    with pytest.raises(InputError, match="one with maps"):
        pm.to_sidpy(image()[["branch"]])
    with pytest.raises(InputError, match="coordinate y of the image"):
        pm.to_sidpy(image().drop_vars("y"))


def test_without_sidpy_it_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "sidpy", None)
    with pytest.raises(
        PhasemapError, match=r'giving images to sidpy needs .sidpy.: run pip install "afm-phasemap\[sidpy\]"'
    ):
        pm.to_sidpy(image())
