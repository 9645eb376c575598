"""Images for sidpy, and back."""

from __future__ import annotations

import sys
from types import SimpleNamespace
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
def test_an_image_comes_back_as_it_was(directions: bool) -> None:
    sidpy = pytest.importorskip("sidpy", reason='needs pip install "afm-phasemap[sidpy]"')
    given = image(directions)
    made = pm.to_sidpy(given)
    assert [one.quantity for one in made.values()][: 1 + directions] == ["Height", "HeightRetrace"][: 1 + directions]
    phase = next(one for one in made.values() if one.quantity == "Phase")
    assert phase.data_type == sidpy.DataType.IMAGE and phase.units == "deg" and phase.shape == (6, 4)
    np.testing.assert_allclose(phase.x.values, given.x.values)
    assert (phase.x.units, phase.y.units) == ("m", "m") and phase.original_metadata["setpoint"] == 0.7
    back = pm.from_sidpy(made)
    for name in ("height", "phase"):
        np.testing.assert_array_equal(back[name].values, given[name].values)
        assert back[name].dims == given[name].dims
    for dim in ("y", "x"):  # to the bit, or xarray would not lay one on the other
        np.testing.assert_array_equal(back[dim].values, given[dim].values)
    assert back.attrs["setpoint"] == 0.7


def channel(quantity: str, units: str, values: np.ndarray, kind: str = "IMAGE", step: float = 4.0) -> SimpleNamespace:
    """What `from_sidpy` asks of a channel; places in nm."""
    axes = {
        f"dim_{axis}": SimpleNamespace(name="xy"[axis], units="nm", values=step * np.arange(size))
        for axis, size in enumerate(values.shape)
    }
    return SimpleNamespace(
        quantity=quantity, title="", units=units, data_type=SimpleNamespace(name=kind), compute=lambda: values,
        original_metadata={"setpoint": 0.6, "nested": {}}, **axes,
    )  # fmt: skip


def test_channels_of_other_readers_are_brought_to_metres_and_degrees() -> None:
    values = np.arange(24.0).reshape(6, 4)
    found = pm.from_sidpy({
        "a": channel("HeightRetrace", "nm", values), "b": channel("PhaseRetrace", "rad", values),
        "c": channel("Spectrum", "V", values, "SPECTRUM"),
    })  # fmt: skip
    np.testing.assert_allclose(found.height.values, 1e-9 * values.T)
    np.testing.assert_allclose(found.phase.values, np.degrees(values.T))
    assert found.phase.dims == ("y", "x") and found.attrs == {"setpoint": 0.6}
    np.testing.assert_allclose(np.diff(found.x.values), 4e-9)


def test_what_does_not_fit_is_named() -> None:
    values = np.zeros((6, 4))
    with pytest.raises(InputError, match="units of phase is 'counts'"):
        pm.from_sidpy(channel("Phase", "counts", values))
    with pytest.raises(InputError, match="pixels of Phase"):
        pm.from_sidpy({"a": channel("Height", "m", values), "b": channel("Phase", "deg", values[:3])})
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
