"""What attributes of a file say of an image: the same image, said in another way, has the same answer everywhere.

The lever is driven beside its resonance, where the free lever's phase, which is recorded, is not 0.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import phasemap as pm
from phasemap.cli import main
from phasemap.inference import sampling
from phasemap.inference.series.settings import scope_of
from phasemap.io.metadata import CANONICAL, settings_of_image
from phasemap.io.netcdf import load

pytestmark = pytest.mark.skipif(find_spec("skimage") is None, reason='needs pip install "afm-phasemap[read]"')

SCOPE = pm.Microscope(pm.Cantilever(40.0, 300e3, 100.0), pm.Tip(10e-9), pm.Drive(20e-9, 299.2e3))
FREE = SCOPE.free_phase  # 28 degrees
LABELS = (np.indices((24, 32))[1] >= 20).astype(int)
PAIR = {0: pm.Material(1e9, 0.05, 0.02), 1: pm.Material(3e9, 0.05, 0.005)}
SURFACE = pm.Surface.from_labels(LABELS, PAIR, pixel_size=4e-9, topography=2e-9 * LABELS)
SETPOINTS = (0.5, 0.7)
SHIFT = 37.0  # degrees
Images = list[xr.Dataset]


@pytest.fixture(autouse=True)
def _few_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, fewer in {"FIRST": 2000, "WALKERS": 100, "STEPS": 20}.items():
        monkeypatch.setattr(sampling, name, fewer)


@cache
def simulated() -> tuple[xr.Dataset, ...]:
    images = [pm.simulate(SURFACE, SCOPE, one) for one in SETPOINTS]
    noise = np.random.default_rng(1).normal(size=(2, *LABELS.shape))
    return tuple(one.assign(phase=one.phase + 0.05 * more) for one, more in zip(images, noise, strict=True))


@cache
def several_setpoints() -> xr.Dataset:
    return pm.simulate(SURFACE, SCOPE, list(SETPOINTS))


def with_phase(image: xr.Dataset, phase: Any, zero: float, sign: int) -> xr.Dataset:
    """The image with another phase, and what attributes say of it."""
    return image.assign(phase=image.phase.copy(data=phase)).assign_attrs(phase_zero=zero, phase_sign=sign)


def from_file(image: xr.Dataset, folder: Path) -> xr.Dataset:
    path = folder / f"{image.attrs['configuration'].count('0.7')}.nc"
    image.to_netcdf(path)
    return pm.read_image(path)


def as_lag(image: xr.Dataset, _: Path) -> xr.Dataset:
    return with_phase(image, 90.0 - image.phase.values, 90.0 - FREE, -1)


def recorded(image: xr.Dataset, folder: Path) -> xr.Dataset:
    """Nothing but what an instrument can know."""
    found = with_radius(image, folder)
    del found.attrs["tip_radius"]
    return found


def with_radius(image: xr.Dataset, _: Path) -> xr.Dataset:
    """The same, and of which tip."""
    found = image[["height", "phase", "amplitude"]]
    found.attrs = {name: value for name, value in settings_of_image(image).items() if name in CANONICAL}
    return found


def selected(image: xr.Dataset, _: Path) -> xr.Dataset:
    """One of a Dataset of several setpoints."""
    several = several_setpoints()
    i = SETPOINTS.index(json.loads(image.attrs["configuration"])["setpoint"])
    return several.isel(setpoint=i).assign(phase=image.phase)


def in_gwyddion(image: xr.Dataset, folder: Path) -> xr.Dataset:
    path = folder / "image.gwy"
    pm.export(image, path, overwrite=True)
    return pm.read_image(path)


def as_lag_in_gwyddion(image: xr.Dataset, folder: Path) -> xr.Dataset:
    source, path = folder / "image.nc", folder / "lag.gwy"
    image.to_netcdf(source)
    assert main(["export", str(source), str(path), "--lag", "--overwrite"]) == 0
    return pm.read_image(path)


def shifted(image: xr.Dataset, folder: Path) -> xr.Dataset:
    return with_phase(recorded(image, folder), image.phase.values + SHIFT, FREE + SHIFT, 1)


def shifted_lag(image: xr.Dataset, folder: Path) -> xr.Dataset:
    return with_phase(recorded(image, folder), SHIFT - image.phase.values, SHIFT - FREE, -1)


def held_in_metres(image: xr.Dataset, folder: Path) -> xr.Dataset:
    found = recorded(image, folder)
    found.attrs["setpoint_amplitude"] = found.attrs.pop("setpoint") * found.attrs["free_amplitude"]
    return found


def compare(images: Images, _: Path) -> dict[str, Any]:
    turns = pm.compare(images[0], simulated()[1], limit=0), pm.compare(simulated()[1], images[0], limit=0)
    assert all(one.attrs["sign_from"] == "recorded" for one in turns)
    shown = {"measured": turns[0]["measured"], "contrast": turns[0]["region_contrast"][:2, 1]}
    return shown | {f"{name} {i}": one[name] for i, one in enumerate(turns) for name in ("rmse", "label")}


def channels(images: Images, _: Path) -> dict[str, Any]:
    return dict(pm.channels(images[0]).data_vars)


def invert(images: Images, _: Path) -> dict[str, Any]:
    found = pm.invert([one.isel(y=slice(0, 2)) for one in images], SCOPE, height_error=0.02e-9)
    return {name: found[name] for name in ("modulus", "adhesion", "damping", "flag")}


def fit_regions(images: Images, _: Path) -> dict[str, Any]:
    found = pm.fit_regions(images, LABELS, SCOPE)
    return {name: found[name] for name in ("modulus", "adhesion", "damping", "measured_phase")}


def series(images: Images, _: Path) -> dict[str, Any]:
    scope = pm.Microscope(SCOPE.cantilever, SCOPE.tip, SCOPE.drive)
    found = pm.series([one.assign_attrs(title=str(i)) for i, one in enumerate(images)], scope)
    sign = int(found.attrs["sign"])
    assert abs(np.log10(found.modulus / 1e9) - [0.0, 0.477]).max() < 0.3
    return {"modulus": found.modulus.round(-8), "contrast": sign * found.measured_contrast, "share": found.share}


def scene_from(images: Images, folder: Path) -> dict[str, Any]:
    made = pm.scene_from(images[0], folder / "scene.toml", 2, ["tip.radius=10e-9"], overwrite=True)
    maps, drive = load(folder / "scene_maps.nc"), made.microscope.drive
    numbers = {"setpoint": made.options["setpoint"], "amplitude": drive.free_amplitude, "frequency": drive.frequency}
    return numbers | {"labels": maps["labels"], "modulus": made.surface.modulus, "damping": made.surface.damping}


def measured_surface(images: Images, folder: Path) -> dict[str, Any]:
    images[0].to_netcdf(folder / "measured.nc")
    materials = {"soft": {"modulus": 1e9}, "hard": {"modulus": 3e9}}
    tables = {"kind": "measured", "file": str(folder / "measured.nc"), "materials": list(materials)}
    lines = ["[surface]", *(f"{key} = {json.dumps(value)}" for key, value in tables.items())]
    lines += [f"[materials.{name}]\nmodulus = {one['modulus']}" for name, one in materials.items()]
    lines += ["[cantilever]\nstiffness = 40\nresonance_frequency = 300e3\nquality_factor = 100", "[tip]\nradius = 1e-8"]
    (folder / "made.toml").write_text("\n".join([*lines, "[drive]\nfree_amplitude = 2e-8", "[scan]\nsetpoint = 0.5"]))
    return {"modulus": pm.load_scene(folder / "made.toml").surface.modulus}


def drawn_as_lag(images: Images, _: Path) -> dict[str, Any]:
    shown = [axes.images[0] for axes in pm.plot.plot(images[0], lag=True).axes if axes.images]
    return {"lag": np.asarray(shown[1].get_array()), "limits": shown[1].get_clim()}


CONSUMERS: tuple[Callable[[Images, Path], dict[str, Any]], ...] = (
    compare, channels, invert, fit_regions, series, scene_from, measured_surface, drawn_as_lag,
)  # fmt: skip
WAYS: dict[Any, Any] = {  # each, and the plain way to say the same
    from_file: None, selected: None, as_lag: None, in_gwyddion: with_radius, as_lag_in_gwyddion: with_radius,
    shifted: recorded, shifted_lag: recorded, held_in_metres: recorded,
}  # fmt: skip


@pytest.mark.parametrize("way", WAYS, ids=lambda one: one.__name__)
@pytest.mark.parametrize("consumer", CONSUMERS, ids=lambda one: one.__name__)
def test_an_image_that_is_said_in_another_way_has_the_same_answer(
    consumer: Callable[..., Any], way: Callable[..., Any], tmp_path: Path
) -> None:
    plain = WAYS[way]
    before = [one if plain is None else plain(one, tmp_path) for one in simulated()]
    expected = consumer(before, tmp_path)
    found = consumer([way(one, tmp_path) for one in simulated()], tmp_path)
    assert list(found) == list(expected)
    for name, one in found.items():
        np.testing.assert_allclose(one, expected[name], rtol=1e-5, atol=1e-30, err_msg=name)


@pytest.mark.parametrize("consumer", CONSUMERS[:-1], ids=lambda one: one.__name__)  # the page draws both
def test_of_trace_and_retrace_the_trace_is_used_or_one_is_asked_for(
    consumer: Callable[..., Any], tmp_path: Path
) -> None:
    traces = [recorded(one, tmp_path) for one in simulated()]
    both = [
        xr.concat([one, one.assign(phase=one.phase + 20.0)], xr.Variable("direction", ["trace", "retrace"]))
        for one in traces
    ]
    if consumer in (invert, fit_regions):
        with pytest.raises(pm.InputError, match="choose one direction"):
            consumer(both, tmp_path)
        return
    expected, found = consumer(traces, tmp_path), consumer(both, tmp_path)
    for name, one in found.items():
        one = one.isel(direction=0) if "direction" in getattr(one, "dims", ()) else one
        np.testing.assert_allclose(one, expected[name], rtol=1e-9, err_msg=name)


def test_of_images_that_were_joined_each_has_its_own_setpoint(tmp_path: Path) -> None:
    """What joins Datasets keeps attributes of the first."""
    images = [recorded(one, tmp_path) for one in simulated()]
    joined = xr.concat(images, xr.Variable("setpoint", list(SETPOINTS)), combine_attrs="override")
    assert [settings_of_image(joined.isel(setpoint=i))["setpoint"] for i in (0, 1)] == list(SETPOINTS)
    expected, found = (pm.fit_regions(one, LABELS, SCOPE) for one in (images, joined))
    np.testing.assert_array_equal(found.setpoint, SETPOINTS)
    np.testing.assert_allclose(found.modulus, expected.modulus, rtol=1e-9)


def levelled() -> Images:
    return [pm.level(one) for one in simulated()]


def test_where_a_levelled_phase_has_its_zero_is_known_to_nobody(tmp_path: Path) -> None:
    images = levelled()
    for needs_zero in (channels, invert):
        with pytest.raises(pm.InputError, match="phase_zero is None"):
            needs_zero(images, tmp_path)
    assert pm.compare(images[0], simulated()[0], limit=0).rmse < 0.1
    regions = pm.fit_regions(images, LABELS, SCOPE)
    assert json.loads(regions.attrs["configuration"])["phase_zero"] == "shared"
    bars = [one for one in pm.plot.plot(images[0]).axes if one.get_ylabel().startswith("phase")]
    assert [len(one.lines) for one in bars] == [0]


def test_the_line_between_attraction_and_repulsion_is_where_it_was_recorded(tmp_path: Path) -> None:
    image = simulated()[0]
    across = image.assign(phase=image.phase - image.phase.mean())  # so that 0 is among the colours
    for way, at in ((shifted, SHIFT), (as_lag, 90.0), (recorded, 0.0)):
        (bar,) = (one for one in pm.plot.plot(way(across, tmp_path)).axes if one.get_ylabel().startswith("phase"))
        assert [line.get_ydata()[0] for line in bar.lines] == pytest.approx([at])


@pytest.mark.parametrize("law", ["hertz", "maugis"])
def test_the_law_of_a_simulated_image_or_curve_is_that_of_all_that_explain_it(law: str, tmp_path: Path) -> None:
    scope = pm.Microscope(SCOPE.cantilever, SCOPE.tip, SCOPE.drive, pm.Interaction(law))
    surface = pm.Surface(1e9, 0.05, 0.01, pixel_size=4e-9, shape=(2, 3))
    image = pm.simulate(surface, scope, 0.7)
    assert pm.scene_from(image, tmp_path / "scene.toml", 1).microscope.interaction == scope.interaction
    assert scope_of([image], None)[0].interaction == scope.interaction
    pm.sweep_distance(PAIR[0], scope, np.linspace(30e-9, 12e-9, 31)).to_netcdf(tmp_path / "sweep.nc")
    curve = pm.read_curve(tmp_path / "sweep.nc")
    assert scope_of([curve], None)[0].interaction == scope.interaction


def test_a_curve_that_is_said_in_another_way_has_the_same_fit(tmp_path: Path) -> None:
    far = np.linspace(24e-9, 10e-9, 60)
    pm.sweep_distance(PAIR[0], SCOPE, far).to_netcdf(tmp_path / "sweep.nc")
    curve = pm.read_curve(tmp_path / "sweep.nc")
    zero = curve.attrs["phase_zero"]
    volts = curve.assign(amplitude=(curve.amplitude / 50e-9).assign_attrs(units="V"))
    free = curve.attrs["free_amplitude"]
    ways = {
        "plain": curve,
        "lag": with_phase(curve, SHIFT - curve.phase.values, SHIFT - zero, -1),
        "volts": volts.assign_attrs(amplitude_sensitivity=50e-9, free_amplitude_voltage=free / 50e-9),
    }
    fits = {
        name: pm.fit_distance(one, scope=SCOPE, start=PAIR[0], parameters=("modulus", "offset"), starts=1)
        for name, one in ways.items()
    }
    for fit in fits.values():
        assert fit.values["modulus"] == pytest.approx(fits["plain"].values["modulus"], rel=1e-6)
    assert fits["plain"].values["modulus"] == pytest.approx(1e9, rel=0.05)
