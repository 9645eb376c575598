"""What a real microscope adds, each by its definition, and nothing unless it is asked for."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.ndimage
import xarray as xr

import phasemap as pm
from phasemap._shared.random_numbers import generator
from phasemap.cli import main
from phasemap.experiment.realism import check_realism
from phasemap.imaging import raster
from phasemap.imaging.canvas import Canvas
from phasemap.imaging.feedback import simulator as feedback
from phasemap.imaging.imperfections import drifted, finish, scopes_by_row
from phasemap.imaging.job import Job, Simulator
from phasemap.imaging.materials import Survey
from phasemap.io import netcdf
from phasemap.scenes.scene import Scene

LEVER, TIP = pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9)
SCOPE = pm.Microscope(LEVER, TIP, pm.Drive(20e-9))
BLUNT = pm.Microscope(LEVER, pm.Tip(25e-9), pm.Drive(20e-9))
SHAPE = (6, 8)
MODULUS = np.where(np.add.outer(np.arange(6), np.arange(8)) % 3 == 0, 1e9, 4e9)
RELIEF = 2e-9 * np.random.default_rng(0).random(SHAPE)


def surface_of(rows: slice = slice(None), topography: np.ndarray | None = RELIEF) -> pm.Surface:
    relief = None if topography is None else topography[rows]
    return pm.Surface(MODULUS[rows], 0.06, viscosity=30.0, topography=relief, pixel_size=(3e-9, 2e-9))


def image_of(realism: pm.Realism | None = None, topography: np.ndarray | None = RELIEF) -> xr.Dataset:
    return pm.simulate(surface_of(topography=topography), SCOPE, 0.7, realism=realism)


def same_bytes(a: xr.Dataset, b: xr.Dataset) -> bool:
    return list(a.variables) == list(b.variables) and all(
        a[name].values.tobytes() == b[name].values.tobytes() for name in a.variables
    )


def blank(lines: int, pixels: int = 4) -> xr.Dataset:
    """A quiet scan, there and back."""
    dims, zeros = ("direction", "y", "x"), np.zeros((2, lines, pixels))
    return xr.Dataset(dict.fromkeys(("height", "phase", "amplitude", "amplitude_error"), (dims, zeros)))


# Nothing unless it is asked for


def test_without_realism_the_image_is_the_quiet_one() -> None:
    quiet, off = image_of(), image_of(pm.Realism(seed=5))
    assert same_bytes(quiet, off)
    assert all("comment" not in variable.attrs for variable in quiet.variables.values())
    # Height is what was there before: topography and tip offset less the amplitude at the setpoint, of 0.7 x 20 nm.
    assert np.allclose(quiet.height, RELIEF + quiet.tip_offset - 14e-9, rtol=0, atol=1e-20)


def test_the_seed_decides_and_one_kind_of_noise_does_not_change_another() -> None:
    both = pm.Realism(line_offset=1e-10, phase_offset=0.5, seed=3)
    first, again = image_of(both), image_of(both)
    assert same_bytes(first, again)
    other = image_of(pm.Realism(line_offset=1e-10, phase_offset=0.5, seed=4))
    assert np.all(other.height.values != first.height.values) and np.all(other.phase.values != first.phase.values)
    height_only = image_of(pm.Realism(line_offset=1e-10, seed=3))
    assert np.array_equal(height_only.height, first.height) and np.array_equal(height_only.phase, image_of().phase)


def test_the_image_says_what_was_done_to_it(tmp_path: Path) -> None:
    change = pm.TipChange(2, 25e-9)
    realism = pm.Realism(line_offset=1e-10, drift=(1e-9, 0, 2e-9), tip_change=change, bits=12, seed=7)
    image = image_of(realism)
    said = json.loads(image.attrs["configuration"])["realism"]
    assert said["drift"] == [1e-9, 0.0, 2e-9] and said["seed"] == 7
    assert said["tip_change"] == {"kind": "tipchange", "line": 2, "radius": 25e-9}
    quantised = {"comment": "quantised to 12 bits"}
    offset = {"comment": "random offsets of lines, standard deviation 1e-10, seed 7; quantised to 12 bits"}
    assert offset.items() <= image.height.attrs.items() and quantised.items() <= image.phase.attrs.items()
    assert image.height.attrs["units"] == "m" and "comment" not in image.tip_offset.attrs
    xr.testing.assert_identical(netcdf.load(netcdf.save(image, tmp_path / "image.nc")), image)


# Offsets of lines, quantisation


def test_each_line_of_each_direction_has_an_offset_of_its_own() -> None:
    lines, deviations = 4000, {"height": 3e-10, "phase": 0.8}
    image = finish(blank(lines), pm.Realism(line_offset=3e-10, phase_offset=0.8, seed=1))
    for name, deviation in deviations.items():
        values = image[name].values
        assert np.all(values == values[:, :, :1])
        # Of N normal numbers the mean is within 5 deviations / sqrt(N), their deviation within 5 / sqrt(2 N) of itself.
        assert abs(values[:, :, 0].mean()) < 5 * deviation / math.sqrt(2 * lines)
        assert values[:, :, 0].std() == pytest.approx(deviation, abs=0, rel=5 / math.sqrt(4 * lines))
    drawn = [image[name].values[direction, :, 0] for name in deviations for direction in (0, 1)]
    correlation = np.corrcoef(drawn) - np.eye(4)
    assert np.abs(correlation).max() < 5 / math.sqrt(lines)
    assert not image.amplitude.values.any() and not image.amplitude_error.values.any()


@pytest.mark.parametrize("bits", [1, 3, 16])
def test_a_channel_takes_as_many_values_as_its_bits_allow(bits: int) -> None:
    image = blank(200, 100)
    values = generator(0, "ramp").uniform(-3.0, 5.0, (2, 200, 100))
    values[0, 3, 4] = np.nan
    image["phase"][:] = values
    coarse = finish(image, pm.Realism(bits=bits)).phase
    found = values[~np.isnan(values)]
    step = np.ptp(found) / (2**bits - 1)
    assert coarse.attrs["quantisation_step"] == pytest.approx(step, rel=1e-15)
    error = (coarse.values - values)[~np.isnan(values)]
    assert np.abs(error).max() <= step / 2 * (1 + 1e-9)
    # Uniform values are off by step / sqrt(12), the square of it measured within 5 sqrt(0.8 / N) (kurtosis 1.8); with
    # few bits the two outer steps, of half the width, do not change that.
    assert np.mean(error**2) == pytest.approx(step**2 / 12, rel=5 * math.sqrt(0.8 / error.size))
    levels = np.unique(coarse.values[~np.isnan(values)])
    assert len(levels) <= 2**bits and (bits == 16 or len(levels) == 2**bits)
    assert coarse.min() == found.min() and coarse.max() == pytest.approx(found.max(), rel=1e-15)
    assert np.array_equal(np.isnan(coarse), np.isnan(values))


def test_what_differs_between_setpoints_is_told_of_each() -> None:
    scope, control = pm.Microscope(LEVER, TIP, pm.Drive(30e-9)), pm.Feedback(line_rate=20.0)
    asked = {"control": control, "realism": pm.Realism(bits=8), "variables": ["height", "phase"]}
    surface = pm.Surface([[1e9] * 8 + [3e9] * 8] * 2, 0.05, 0.01, pixel_size=4e-9)
    both = pm.simulate(surface, scope, [0.5, 0.7], **asked)
    for i, setpoint in enumerate((0.5, 0.7)):
        alone = pm.simulate(surface, scope, setpoint, **{**asked, "realism": pm.Realism(bits=8, seed=i)})
        one = both.isel(setpoint=i)
        assert one["proportional_gain"] == alone.attrs["proportional_gain"]
        assert one["phase_quantisation_step"] == alone.phase.attrs["quantisation_step"]
        assert both.get("gain_margin", both.attrs.get("gain_margin")) is not None
    assert both["height_quantisation_step"].attrs["units"] == "m"


def test_images_at_several_setpoints_have_noise_of_their_own() -> None:
    surface, scope = (
        pm.Surface(1e9, 0.05, 0.01, pixel_size=4e-9, shape=(64, 2)),
        pm.Microscope(LEVER, TIP, pm.Drive(30e-9)),
    )
    noisy, still = (pm.simulate(surface, scope, [0.5, 0.7], realism=pm.Realism(line_offset=x)) for x in (1e-10, 0.0))
    first, second = (noisy.height - still.height).isel(x=0).values
    # By chance 0.125, the inverse root of 64 lines.
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.5 and first.std() == pytest.approx(1e-10, rel=0.4)


def test_a_channel_of_one_value_stays_as_it_is() -> None:
    image = finish(blank(3), pm.Realism(bits=8))
    assert not image.amplitude.values.any()
    assert image.amplitude.attrs["quantisation_step"] == 0


# Drift


def test_drift_shows_the_nearest_material_and_the_interpolated_height() -> None:
    surface, (x, y, z) = surface_of(), (7.1e-9, -4.7e-9, 1e-9)
    moved = drifted(surface, (x, y, z))
    rows, columns = np.indices(SHAPE, float)
    places = rows + y / 3e-9 * rows / 6, columns + x / 2e-9 * rows / 6
    linear = scipy.ndimage.map_coordinates(RELIEF, places, order=1, mode="nearest") + z * rows / 6
    assert np.allclose(moved.topography, linear, rtol=0, atol=1e-22)  # rounding of 1e-9 m, many times over
    nearest = tuple(np.clip(np.rint(p).astype(int), 0, n - 1) for p, n in zip(places, SHAPE, strict=True))
    assert np.array_equal(moved.modulus, MODULUS[nearest])
    assert moved.viscosity is not None and moved.viscosity.strides == (0, 0)


def test_drift_slants_an_edge_and_leaves_the_first_line_where_it_is() -> None:
    # An upright edge at pixel 20 of 40; 10 pixels of drift to the right in 50 lines move it to the left.
    labels = np.broadcast_to(np.arange(40) >= 20, (50, 40))
    soft, hard = pm.Material(1e9), pm.Material(4e9)
    surface = pm.Surface.from_labels(labels, {0: soft, 1: hard}, pixel_size=2e-9)
    moved = drifted(surface, (20e-9, 0.0, 0.0))
    edge = np.argmax(moved.modulus == 4e9, axis=1)
    assert edge[0] == 20
    assert np.all(np.abs(edge - (20 - 10 * np.arange(50) / 50)) <= 0.5)


def test_drift_along_z_tilts_the_height_of_a_flat_surface_and_nothing_else() -> None:
    quiet, tilted = image_of(topography=None), image_of(pm.Realism(drift=(0.0, 0.0, 3e-9)), topography=None)
    plane = np.broadcast_to(3e-9 * np.arange(6)[:, np.newaxis] / 6, SHAPE)
    assert np.allclose(tilted.height - quiet.height, plane, rtol=0, atol=1e-22)
    for name in ("phase", "tip_offset", "indentation"):
        assert np.array_equal(tilted[name], quiet[name])


# A change of the tip


def test_after_the_change_the_lines_are_those_of_the_other_tip() -> None:
    image = image_of(pm.Realism(tip_change=pm.TipChange(line=4, radius=25e-9)))
    for rows, scope in ((slice(0, 4), SCOPE), (slice(4, 6), BLUNT)):
        alone = pm.simulate(surface_of(rows), scope, 0.7)
        for name in image.data_vars:
            assert np.array_equal(image[name][rows], alone[name], equal_nan=True)
    assert np.array_equal(image.y, image_of().y)
    assert not np.isin(image.phase[4:], image.phase[:4]).any()


def test_each_simulator_gets_what_it_can_fill(monkeypatch: pytest.MonkeyPatch) -> None:
    # Without time a changed tip is engaged anew, in time it goes on as it is; each tip has a plan of its own.
    jobs: list[Job] = []
    states: list[Any] = []

    def fill(job: Job, plan: float, canvas: Canvas, state: Any) -> str:
        jobs.append(job)
        states.append(state)
        for direction in (0, 1):
            canvas.put(slice(0, job.pixels), {"phase": np.full(job.pixels, plan + direction / 2)}, direction)
            canvas.put(slice(0, job.pixels), {"status": np.zeros(job.pixels, np.int8)}, direction)
        return "on a branch"

    def plan(job: Job, survey: Survey, before: float | None) -> float:
        return 1.0 if before is None else before + 1.0

    simulator = Simulator(lambda job: 10, plan, fill)
    for module in (raster, feedback):
        monkeypatch.setattr(module, "SIMULATOR", simulator)
    realism = pm.Realism(tip_change=pm.TipChange(2, 25e-9))
    image = pm.simulate(surface_of(), SCOPE, 0.7, control=pm.Raster(), realism=realism, variables=["phase"])
    expected = np.repeat([1.0, 2.0], [2, 4])[:, np.newaxis] + np.zeros(SHAPE)
    assert np.array_equal(image.phase, [expected, expected + 0.5])
    assert [(job.scope, job.surface.shape[0], job.place.row) for job in jobs] == [(SCOPE, 2, 0), (BLUNT, 4, 2)]
    assert states == [None, None]
    jobs.clear()
    states.clear()
    noisy = pm.Realism(temperature=300.0, detector_noise=1e-13, tip_change=pm.TipChange(2, 25e-9), seed=2)
    pm.simulate(surface_of(), SCOPE, 0.7, control=pm.Feedback(), realism=noisy, variables=["phase"])
    assert [(job.scope, job.realism) for job in jobs] == [(SCOPE, noisy), (BLUNT, noisy)]
    assert states == [None, "on a branch"]
    assert scopes_by_row(noisy, SCOPE, 6) == [(slice(0, 2), SCOPE), (slice(2, 6), BLUNT)]


# Noise in time


@pytest.mark.parametrize("noise", [{"temperature": 300.0}, {"detector_noise": 1e-13}])
def test_noise_needs_a_control_that_acts_in_time(noise: dict[str, float]) -> None:
    name, value = next(iter(noise.items()))
    sentence = rf"{name} is {value}; allowed: None. Noise acts in time: .* in Python control=pm.Feedback\(\)\."
    for control in (None, pm.Raster()):
        with pytest.raises(pm.InputError, match=sentence):
            check_realism(pm.Realism(**noise), control or pm.Engage(), 6)
    with pytest.raises(pm.InputError, match=sentence):
        image_of(pm.Realism(**noise))
    assert check_realism(pm.Realism(**noise), pm.Feedback(), 6) == pm.Realism(**noise)


# What is refused


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"temperature": 0.0}, "temperature is 0.0; allowed: a finite number above 0 K"),
        ({"detector_noise": -1.0}, r"detector_noise is -1.0; allowed: a finite number above 0 m/sqrt\(Hz\)"),
        ({"line_offset": -1e-9}, "line_offset is -1e-09; allowed: a finite number of at least 0 m"),
        ({"phase_offset": math.nan}, "phase_offset is nan; allowed: a finite number of at least 0 degree"),
        ({"drift": 1e-9}, r"drift is 1e-09; allowed: three lengths in m, \(x, y, z\)"),
        ({"drift": (0, 0)}, r"drift is \(0, 0\); allowed: three lengths in m"),
        ({"drift": (0, math.inf, 0)}, "drift y is inf; allowed: a finite number, in m"),
        ({"tip_change": 30e-9}, "tip_change is 3e-08; allowed: a TipChange or None"),
        ({"bits": 0}, "bits is 0; allowed: a whole number from 1 to 32"),
        ({"bits": 12.0}, "bits is 12.0; allowed: a whole number"),
        ({"seed": -1}, "seed is -1; allowed: a whole number of at least 0"),
    ],
)
def test_a_value_out_of_range_is_refused(arguments: dict[str, object], sentence: str) -> None:
    with pytest.raises(pm.InputError, match=sentence):
        pm.Realism(**arguments)  # type: ignore[arg-type]


def test_a_change_of_the_tip_has_to_be_in_the_image() -> None:
    for line, radius, name in ((0, 1e-8, "line"), (1.5, 1e-8, "line"), (2, 0.0, "radius")):
        with pytest.raises(pm.InputError, match=f"tip_change {name} is"):
            pm.TipChange(line, radius)  # type: ignore[arg-type]
    with pytest.raises(pm.InputError, match="tip_change line is 6; allowed: a row from 1 to 5 of this image"):
        image_of(pm.Realism(tip_change=pm.TipChange(6, 25e-9)))
    with pytest.raises(pm.InputError, match="realism is 16; allowed: a Realism"):
        image_of(16)  # type: ignore[arg-type]


# Scenes

SCENE = """
[scan]
setpoint = 0.7
[surface]
kind = "labels"
labels = [[0, 1, 1, 0, 0, 0, 0], [0, 0, 1, 1, 0, 0, 0], [1, 0, 0, 1, 0, 0, 0]]
materials = ["soft", "hard"]
heights = [0.0, 20e-9]
pixel_size = 4e-9
[materials.soft]
modulus = 0.5e9
adhesion = 0.05
[materials.hard]
modulus = 3e9
[cantilever]
stiffness = 40
resonance_frequency = 300e3
quality_factor = 400
[tip]
radius = 10e-9
[drive]
free_amplitude = 20e-9
"""
REALISM = """
[realism]
line_offset = 2e-10
drift = [4e-9, 0, 1e-9]
bits = 10
seed = 3
tip_change = { line = 2, radius = 25e-9 }
"""


def scene_of(folder: Path, text: str, *overrides: str) -> Scene:
    path = folder / "scene.toml"
    path.write_text(text, encoding="utf-8")
    return pm.load_scene(path, overrides)


def test_a_scene_gives_what_python_gives(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, SCENE + REALISM, "surface.dilate=true", "surface.half_angle=15")
    labels = np.array([[0, 1, 1, 0, 0, 0, 0], [0, 0, 1, 1, 0, 0, 0], [1, 0, 0, 1, 0, 0, 0]])
    materials = {0: pm.Material(0.5e9, 0.05), 1: pm.Material(3e9)}
    flat = pm.Surface.from_labels(labels, materials, topography=20e-9 * labels, pixel_size=4e-9)
    realism = pm.Realism(line_offset=2e-10, drift=(4e-9, 0.0, 1e-9), tip_change=pm.TipChange(2, 25e-9), bits=10, seed=3)
    assert scene.options["realism"] == realism
    assert scene.surface == flat.dilated(TIP, 15.0) != flat.dilated(TIP)
    assert same_bytes(scene.simulate(), pm.simulate(flat.dilated(TIP, 15.0), SCOPE, 0.7, realism=realism))
    assert scene.config["realism"]["tip_change"] == {"line": 2, "radius": 25e-9}
    assert json.loads(scene.to_json())["surface"]["half_angle"] == 15
    quiet = scene_of(tmp_path, SCENE)
    assert quiet.surface == flat and quiet.options["realism"] == pm.Realism()


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ("realism.temperature=300.0", r"\[realism\] temperature is 300.0; allowed: None. Noise acts in time"),
        ("realism.bits=99", r"\[realism\] bits is 99; allowed: a whole number from 1 to 32"),
        ("realism.dirft=[0, 0, 0]", r"\[realism\] dirft is unknown; .* Did you mean 'drift'\?"),
        ("realism.tip_change=5", r"\[realism.tip_change\] is 5; allowed: a table of keys line, radius"),
        ("realism.tip_change.line=2", r"\[realism.tip_change\] radius is missing"),
        ("surface.dilate=1", r"\[surface\] dilate is 1; allowed: true or false"),
        ("surface.half_angle=10", r"\[surface\] half_angle is 10; allowed: none without dilate = true"),
    ],
)
def test_a_scene_is_refused_in_the_words_of_its_file(tmp_path: Path, override: str, sentence: str) -> None:
    with pytest.raises(pm.InputError, match=sentence):
        scene_of(tmp_path, SCENE, override)


def test_a_bad_half_angle_or_line_is_named_with_its_table(tmp_path: Path) -> None:
    with pytest.raises(pm.InputError, match=r"\[surface\] half_angle is 0; allowed: a finite number above 0"):
        scene_of(tmp_path, SCENE, "surface.dilate=true", "surface.half_angle=0")
    with pytest.raises(pm.InputError, match=r"\[realism\] tip_change line is 9; allowed: a row from 1 to 2"):
        scene_of(tmp_path, SCENE, "realism.tip_change={ line = 9, radius = 1e-8 }")


def test_the_command_says_what_was_added(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene_of(tmp_path, SCENE)
    scene, output = str(tmp_path / "scene.toml"), str(tmp_path / "image.nc")
    assert main(["run", scene, "-o", output]) == 0
    assert "realism" not in capsys.readouterr().out
    assert main(["run", scene, "-o", output, "--overwrite", "realism.line_offset=1e-10", "realism.seed=2"]) == 0
    assert "realism     line offset 100 pm, seed 2\n" in capsys.readouterr().out
