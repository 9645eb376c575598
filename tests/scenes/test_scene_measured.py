"""A scene from a measured image: nothing is made up, what is missing is asked for, and what is written runs."""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import phasemap as pm
from phasemap._shared.errors import FileError, InputError, PhasemapError
from phasemap.cli import main
from phasemap.io.netcdf import load, save
from phasemap.scenes.measured import scene_from

needs_skimage = pytest.mark.skipif(find_spec("skimage") is None, reason='needs pip install "afm-phasemap[read]"')
needs_reader = pytest.mark.skipif(
    any(find_spec(name) is None for name in ("gwyddionpy", "gwyddionpy_converter", "skimage", "NSFopen")),
    reason='needs pip install "afm-phasemap[read]" and nsfopen',
)
RECORDED: dict[str, Any] = {
    "source": "blend.nid", "drive_frequency": 300e3, "resonance_frequency": 300e3, "quality_factor": 400.0,
    "stiffness": 40.0, "free_amplitude": 20e-9, "setpoint": 0.6,
}  # fmt: skip
TIP = "tip.radius=10e-9"


def truth() -> tuple[np.ndarray, np.ndarray]:
    """Labels of two materials, the second 4 nm higher, and its topography."""
    labels = (np.mgrid[:24, :32][1] >= 20).astype(int)
    return labels, 4e-9 * labels


def measured(**attrs: Any) -> xr.Dataset:
    """That surface as a microscope records it: tilted, with offsets of lines, noise, and two phases."""
    labels, topography = truth()
    rng = np.random.default_rng(3)
    y, x = np.mgrid[:24, :32]
    height = topography + 2e-9 * x - 1e-9 * y + rng.normal(0, 1e-9, (24, 1))
    phase = np.where(labels, -8.0, -27.0) + rng.normal(0, 0.4, labels.shape)
    return xr.Dataset(
        {"height": (("y", "x"), height, {"units": "m"}), "phase": (("y", "x"), phase, {"units": "degree"})},
        {"y": (np.arange(24) + 0.5) * 4e-9, "x": (np.arange(32) + 0.5) * 3e-9},
        RECORDED | attrs,
    )


def without(*names: str) -> xr.Dataset:
    image = measured()
    return image.assign_attrs({}).drop_attrs().assign_attrs({k: v for k, v in image.attrs.items() if k not in names})


@needs_skimage
def test_surface_and_microscope_are_found_again(tmp_path: Path) -> None:
    scene = scene_from(measured(), tmp_path / "blend.toml", 2, [TIP])
    labels, topography = truth()
    assert scene.surface.shape == (24, 32) and scene.surface.pixel_size == pytest.approx((4e-9, 3e-9))
    assert np.array_equal(load(tmp_path / "blend_maps.nc")["labels"].values, labels)
    # Offsets of lines are exact medians; what is left is the plane that they lean by, less than 0.1 nm.
    found = scene.surface.topography
    assert found is not None and np.abs(found - topography).max() < 0.2e-9
    lever = pm.Cantilever(40.0, 300e3, 400.0)
    assert scene.microscope == pm.Microscope(lever, pm.Tip(10e-9), pm.Drive(20e-9, 300e3), pm.Interaction("dmt"))
    assert scene.options["setpoint"] == 0.6


@needs_skimage
def test_a_simulated_image_says_all_of_its_microscope_and_is_called_by_its_file(tmp_path: Path) -> None:
    scope = pm.Microscope(pm.Cantilever(26.0, 300e3, 300.0), pm.Tip(8e-9), pm.Drive(20e-9))
    pair = [pm.Material(0.3e9, 0.05, 0.02), pm.Material(3e9, 0.05)]
    image = pm.simulate(pm.Surface.from_labels(truth()[0], pair, pixel_size=4e-9), scope, 0.6)
    save(image, tmp_path / "mine.nc")
    scene = scene_from(tmp_path / "mine.nc", tmp_path / "mine.toml")
    assert scene.microscope.tip == scope.tip and scene.microscope.cantilever == scope.cantilever
    assert "# The surface and the microscope of mine.nc, by phasemap scene." in (tmp_path / "mine.toml").read_text()


@needs_skimage
def test_what_is_written_runs_and_can_be_edited(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    image = measured().isel(y=slice(4, 12), x=slice(12, 24))
    image = image.assign_coords(y=image["y"][:8] - 16e-9, x=image["x"] - 36e-9)
    scene_from(image, tmp_path / "blend.toml", 2, [TIP, "materials.material_1.modulus=3e9"])
    text = (tmp_path / "blend.toml").read_text()
    (tmp_path / "blend.toml").write_text(text.replace("modulus = 2.0e9", "modulus = 1.0e9"))
    assert main(["run", str(tmp_path / "blend.toml"), "-o", str(tmp_path / "out.nc"), "--quiet"]) == 0
    phase = load(tmp_path / "out.nc")["phase"].values
    labels = load(tmp_path / "blend_maps.nc")["labels"].values
    assert phase.shape == (8, 12) and phase[labels == 1].min() > phase[labels == 0].max()  # stiffer is brighter


@needs_skimage
@pytest.mark.parametrize("by", ["phase", "height"])
def test_a_homogeneous_sample_is_one_material_which_is_said(tmp_path: Path, by: str) -> None:
    image, rng = measured(), np.random.default_rng(5)
    noise = {name: size * rng.normal(size=image[name].shape) for name, size in {"height": 1e-10, "phase": 0.4}.items()}
    image = image.assign({name: image[name].copy(data=one) for name, one in noise.items()})
    with pytest.warns(pm.ResultWarning, match=rf"The {by} shows one population \(parts of it are .*: there is one mat"):
        scene = scene_from(image, tmp_path / "scene.toml", overrides=[TIP], by=by)
    assert scene.built is not None and scene.built.labels is not None and not np.any(scene.built.labels[0])
    assert list(scene.config["materials"]) == ["material_0"]
    assert f"# The {by} shows one population" in (tmp_path / "scene.toml").read_text()
    with pytest.raises(InputError, match=f"phases is 2; allowed: fewer for this image. The {by} shows one population"):
        scene_from(image, tmp_path / "two.toml", 2, [TIP], by=by)
    constant = image.assign({by: 0.0 * image[by]})
    with pytest.warns(pm.ResultWarning, match=f"The {by} is the same everywhere: there is one material"):
        scene_from(constant, tmp_path / "same.toml", overrides=[TIP], by=by)


@needs_skimage
def test_two_materials_are_seen_without_being_asked_for(tmp_path: Path) -> None:
    scene_from(measured(), tmp_path / "scene.toml", overrides=[TIP])
    assert np.array_equal(load(tmp_path / "scene_maps.nc")["labels"].values, truth()[0])


@pytest.mark.slow
@needs_reader
@pytest.mark.filterwarnings("ignore::phasemap.ResultWarning")
def test_sapphire_is_one_material_and_a_flake_on_its_substrate_two(tmp_path: Path) -> None:
    from importlib.resources import files

    given = [TIP, "drive.free_amplitude=40e-9"]
    for name, count in {"Calculate_Roughness/sapphire.nid": 1, "Plotting_Data/MoS2.nid": 2}.items():
        path = str(files("NSFopen") / "example" / name)
        scene = scene_from(path, tmp_path / "scene.toml", overrides=given, overwrite=True)
        assert len(scene.config["materials"]) == count


@needs_skimage
def test_a_scene_starts_from_materials_with_the_measured_contrast(tmp_path: Path) -> None:
    scene = scene_from(measured(), tmp_path / "scene.toml", 2, [TIP])
    kinds, text = scene.config["materials"], (tmp_path / "scene.toml").read_text()
    low, high = (
        pm.solve_pixel(
            pm.Material(**{key: kinds[name][key] for key in ("modulus", "adhesion", "damping", "poisson_ratio")}),
            scene.microscope, 0.6, "averaging",
        ).phase
        for name in ("material_0", "material_1")
    )  # fmt: skip
    assert high - low == pytest.approx(19.0, abs=1.5)  # -8 and -27 degrees; a damping has two digits
    assert text.count("start that gives the measured contrast, not a measurement: edit") == 2
    again = scene_from(measured(), tmp_path / "own.toml", 2, [TIP, "materials.material_0.modulus=1e9"])
    assert again.config["materials"]["material_0"]["modulus"] == 1e9


def test_everything_that_is_missing_is_named_at_once_with_an_example(tmp_path: Path) -> None:
    image = without("stiffness", "free_amplitude", "setpoint")
    with pytest.raises(PhasemapError) as caught:
        scene_from(image, tmp_path / "scene.toml", 1)
    assert str(caught.value) == (
        "blend.nid does not say scan.setpoint, cantilever.stiffness, tip.radius, drive.free_amplitude: give what is "
        "missing, such as scan.setpoint=0.7 cantilever.stiffness=40 tip.radius=10e-9 drive.free_amplitude=20e-9."
    )
    assert not list(tmp_path.iterdir())
    given = str(caught.value).partition("such as ")[2].rstrip(".").split()
    assert scene_from(image, tmp_path / "scene.toml", 1, given).options["setpoint"] == 0.7


@needs_skimage
def test_without_a_phase_the_height_is_offered_and_does(tmp_path: Path) -> None:
    image = measured().drop_vars("phase")
    with pytest.raises(FileError, match=r"there is no phase channel; it holds 'height'\. .* \(--by height"):
        scene_from(image, tmp_path / "scene.toml", 2, [TIP])
    assert scene_from(image, tmp_path / "scene.toml", 2, [TIP], by="height").surface.shape == truth()[0].shape


def test_a_preset_says_what_the_file_does_not(tmp_path: Path) -> None:
    image = without("stiffness", "quality_factor")
    given = [TIP, "cantilever.preset=AC240TS", "materials.material_0.preset=PMMA"]
    scene = scene_from(image, tmp_path / "scene.toml", 1, given)
    assert scene.microscope.cantilever == pm.Cantilever.preset("AC240TS", resonance_frequency=300e3)  # as recorded
    assert "stiffness = 2.0  # N/m, of the preset AC240TS" in (tmp_path / "scene.toml").read_text()
    assert scene.surface.unique()[0][0, 0] == pm.Material.preset("PMMA").modulus
    with pytest.raises(InputError, match=r"\[cantilever\] preset is 'AC24'; .* Did you mean 'OMCL-AC240TS'"):
        scene_from(image, tmp_path / "scene.toml", 1, [TIP, "cantilever.preset=AC24"], overwrite=True)


def test_placeholders_and_the_origin_of_each_value_are_said(tmp_path: Path) -> None:
    image = measured(nominal="stiffness", warnings="The free amplitude is a guess.")
    scene_from(image, tmp_path / "scene.toml", 1, [TIP, "materials.material_0.damping=0.03"])
    lines = (tmp_path / "scene.toml").read_text().splitlines()
    assert "# The free amplitude is a guess." in lines
    assert "stiffness = 40.0  # N/m, nominal, of levers of this type" in lines
    assert "setpoint = 0.6  # as recorded" in lines and "radius = 1e-08  # m, given" in lines
    assert "modulus = 2.8e9  # Pa, placeholder, PS: edit" in lines and "damping = 0.03  # given" in lines
    assert any("PLACEHOLDERS" in line for line in lines) and "#   phasemap run scene.toml -o scene.nc" in lines
    scene_from(image, tmp_path / "my scene.toml", 1, [TIP])
    assert "#   phasemap run 'my scene.toml' -o 'my scene.nc'" in (tmp_path / "my scene.toml").read_text().splitlines()


@needs_skimage
def test_an_unedited_scene_has_a_contrast_of_the_sign_that_the_file_says(tmp_path: Path) -> None:
    def moduli(**attrs: Any) -> list[float]:
        scene = scene_from(measured(**attrs), tmp_path / "scene.toml", 2, [TIP], overwrite=True)
        return scene.surface.modulus[0, [0, -1]].tolist()

    low, high = moduli()
    assert low < high and moduli(phase_sign=-1) == [high, low]


@pytest.mark.parametrize("law", ["hertz", "maugis", pm.interaction.MaugisDugdale(0.4e-9)])
def test_a_simulated_image_says_its_law_and_how_its_lever_is_driven(tmp_path: Path, law: Any) -> None:
    drive = pm.Drive(20e-9, 299.9e3, excitation="base", second=pm.Mode(1e-9))
    reach = None if law == "hertz" else 0.2e-9
    scope = pm.Microscope(
        pm.Cantilever(26.0, 300e3, 300.0, modes=2), pm.Tip(8e-9, 70e9), drive, pm.Interaction(law, reach), "tip"
    )
    image = pm.simulate(pm.Surface(1e9, pixel_size=4e-9, shape=(3, 4)), scope, 0.6)
    assert scene_from(image, tmp_path / "mine.toml", 1).microscope == scope
    given = scene_from(image, tmp_path / "given.toml", 1, ["interaction.contact=dmt", "tip.radius=9e-9"]).microscope
    assert given == replace(scope, tip=pm.Tip(9e-9, 70e9), interaction=pm.Interaction("dmt", reach))


@needs_skimage
@pytest.mark.parametrize("changed", [{"contact": "capillary"}, {"withdrawal": "ting"}])
def test_under_a_law_that_is_marched_in_time_no_starts_are_tried(tmp_path: Path, changed: Any) -> None:
    words = [TIP, *(f"interaction.{name}={value}" for name, value in changed.items())]
    scene = scene_from(measured(), tmp_path / "scene.toml", 2, words)
    assert scene.microscope.interaction == pm.Interaction(**changed)
    assert "start that gives the measured contrast" not in (tmp_path / "scene.toml").read_text()


def test_a_law_of_a_simulated_image_that_phasemap_does_not_have_is_said(tmp_path: Path) -> None:
    scope = pm.Microscope(pm.Cantilever(26.0, 300e3, 300.0), pm.Tip(8e-9), pm.Drive(20e-9, 300e3))
    image = pm.simulate(pm.Surface(1e9, pixel_size=4e-9, shape=(3, 4)), scope, 0.6)
    image.attrs["configuration"] = image.attrs["configuration"].replace('"dmt"', '"soft"')
    assert scene_from(image, tmp_path / "mine.toml", 1).microscope == scope
    assert 'contact = "dmt"  # assumed, for soft is not one of phasemap\'s laws' in (tmp_path / "mine.toml").read_text()


@needs_skimage
def test_height_tells_materials_apart_where_the_phase_does_not(tmp_path: Path) -> None:
    image = measured()
    image["phase"] = 0 * image["phase"] + np.random.default_rng(1).normal(size=image["phase"].shape)
    scene_from(image, tmp_path / "scene.toml", 2, [TIP], by="height")
    assert np.array_equal(load(tmp_path / "scene_maps.nc")["labels"].values, truth()[0])
    assert "from the lowest height" in (tmp_path / "scene.toml").read_text()
    with pytest.raises(InputError, match="by is 'colour'"):
        scene_from(image, tmp_path / "scene.toml", 2, [TIP], by="colour", overwrite=True)


def test_a_free_amplitude_recorded_off_resonance_is_brought_to_resonance(tmp_path: Path) -> None:
    scene = scene_from(measured(drive_frequency=299e3), tmp_path / "scene.toml", 1, [TIP])
    assert scene.microscope.driven_amplitude == pytest.approx(20e-9, rel=1e-12)  # at the drive frequency
    # |1 - w^2 + i w / Q| Q = 2.8427 at w = 299 / 300, Q = 400
    assert scene.microscope.drive.free_amplitude == pytest.approx(20e-9 * 2.8427, rel=1e-3)


def test_a_lever_without_a_resonance_is_taken_as_driven_at_it(tmp_path: Path) -> None:
    scene = scene_from(without("resonance_frequency"), tmp_path / "scene.toml", 1, [TIP])
    assert scene.microscope.frequency_ratio == 1.0
    assert "# assumed to be the drive frequency" in (tmp_path / "scene.toml").read_text()


def test_a_setpoint_in_metres_follows_from_the_free_amplitude(tmp_path: Path) -> None:
    image = without("setpoint", "free_amplitude").assign_attrs(setpoint_amplitude=15e-9)
    with pytest.raises(PhasemapError, match=r"does not say tip\.radius, drive\.free_amplitude: give"):
        scene_from(image, tmp_path / "scene.toml", 1)
    for i, free in enumerate(("25e-9", "25nm", "'25 nm'")):
        scene = scene_from(image, tmp_path / f"scene{i}.toml", 1, [TIP, f"drive.free_amplitude={free}"])
        assert scene.options["setpoint"] == pytest.approx(0.6)


def test_bad_values_are_refused_and_nothing_is_written(tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    with pytest.raises(InputError, match=r"\[tip\] radius is -1"):
        scene_from(measured(), path, 1, ["tip.radius=-1"])
    with pytest.raises(InputError, match=r"\[materials.material_0\] modulis is unknown"):
        scene_from(measured(), path, 1, [TIP, "materials.material_0.modulis=1e9"])
    for image, why in (
        (measured().drop_vars("x"), "a list that has 'x' in it, the position of the pixel centres in m"),
        (measured().isel(x=[0, 1, 3]), "spacing of x is "),
        (
            measured().assign(height=measured()["height"].assign_attrs(units="nm")),
            "units of height of the image is 'nm'",
        ),
        (measured()["height"], "image is of type DataArray; allowed: an xarray.Dataset, a string or a path"),
    ):
        with pytest.raises(InputError, match=why):
            scene_from(image, path, 1, [TIP])
    with pytest.raises(InputError, match=r"the suffix of the scene is '\.txt'; allowed: \.toml"):
        scene_from(measured(), tmp_path / "scene.txt", 1, [TIP])
    with pytest.raises(InputError, match="phases is 5; allowed: a whole number from 1 to 4"):
        scene_from(measured(), path, 5, [TIP])
    with pytest.raises(FileError, match=r"cannot use blend\.nid: there is no phase channel; it holds 'height'"):
        scene_from(measured().drop_vars("phase"), path, 2, [TIP])
    assert not list(tmp_path.iterdir())
    path.write_text("mine")
    with pytest.raises(FileError, match="exists already"):
        scene_from(measured(), path, 1, [TIP])
    assert path.read_text() == "mine"


@needs_skimage
def test_the_command_writes_what_python_writes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save(measured(), tmp_path / "image.nc")
    command = ["scene", str(tmp_path / "image.nc"), "-o", str(tmp_path / "blend.toml"), "--phases", "2"]
    assert main(command) == 2
    assert (
        "blend.nid does not say tip.radius: give what is missing, such as tip.radius=10e-9." in capsys.readouterr().err
    )
    assert main([*command, TIP]) == 0
    said = capsys.readouterr().out.splitlines()
    assert "image       32 x 24 pixels, 96 x 96 nm" in said and said[-1] == f"written to  {tmp_path / 'blend.toml'}"
    assert any(line.startswith("material_1  ") and re.search(r"phase -(8|7\.9)", line) for line in said)
    command = (tmp_path / "blend.toml").read_text()
    scene_from(measured(), tmp_path / "blend.toml", 2, [TIP], overwrite=True)
    assert command == (tmp_path / "blend.toml").read_text()
    assert tomllib.loads(command)["surface"]["materials"] == ["material_0", "material_1"]


def test_a_part_of_an_image_keeps_the_size_of_its_pixels(tmp_path: Path) -> None:
    dims, coords = ("y", "x"), {"y": 2e-9 * (np.arange(12) + 0.5), "x": 3e-9 * (np.arange(16) + 0.5)}
    rng = np.random.default_rng(1)
    image = xr.Dataset({"height": (dims, rng.normal(0, 1e-9, (12, 16)))}, coords)
    given = ["scan.setpoint=0.7", "cantilever.stiffness=40", "cantilever.resonance_frequency=300e3"]
    given += ["cantilever.quality_factor=400", "tip.radius=10e-9", "drive.free_amplitude=20e-9"]
    scene = scene_from(image.isel(y=slice(4, 10)), tmp_path / "part.toml", 1, given)
    assert scene.surface.pixel_size == pytest.approx((2e-9, 3e-9)) and scene.surface.shape == (6, 16)
