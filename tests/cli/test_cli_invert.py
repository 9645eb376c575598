"""The command that goes from images back to materials."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import phasemap as pm
from phasemap.cli import main
from phasemap.cli.invert import _labels
from phasemap.scenes.scene import load_setup

SCENE = """
[cantilever]
stiffness = 40.0
resonance_frequency = 300e3
quality_factor = 400.0
[tip]
radius = 10e-9
[drive]
free_amplitude = 40e-9
[interaction]
contact = "dmt"
decay_length = 0.3e-9
[materials.soft]
modulus = 0.15e9
adhesion = 0.05
damping = 0.02
[materials.firm]
modulus = 0.6e9
adhesion = 0.07
damping = 0.01
"""
SETTINGS = ((40e-9, 0.5), (40e-9, 0.8), (80e-9, 0.65))  # free amplitude [m], setpoint
LABELS = np.repeat([[0] * 4 + [1] * 4], 8, axis=0)
ZERO = 30.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene, simulated images, and the same as an instrument with its own zeros and sign would have them."""
    folder = tmp_path_factory.mktemp("stack")
    (folder / "scene.toml").write_text(SCENE)
    setup = load_setup(folder / "scene.toml")
    materials = dict(enumerate(setup.materials.values()))
    surface = pm.Surface.from_labels(LABELS, materials, pixel_size=4e-9)
    for i, (amplitude, setpoint) in enumerate(SETTINGS):
        scope = pm.Microscope(setup.microscope.cantilever, setup.microscope.tip, pm.Drive(amplitude))
        image = pm.simulate(surface, scope, setpoint, variables=["height", "phase"])
        image.to_netcdf(folder / f"simulated{i}.nc")
        recorded = {"phase": -(image.phase + ZERO), "height": image.height + 2e-9 * i}
        xr.Dataset(recorded, attrs={"setpoint": setpoint}).to_netcdf(folder / f"measured{i}.nc")
    names = {"labels": (("y", "x"), LABELS.astype(np.int32))}
    xr.Dataset(names).to_netcdf(folder / "maps.nc")
    return folder


def command(folder: Path, kind: str, *options: str) -> list[str]:
    images = [str(folder / f"{kind}{i}.nc") for i in range(len(SETTINGS))]
    more = ["--free-amplitudes", "40e-9,40e-9,80e-9", "--sign", "-1"] if kind == "measured" else []
    return ["invert", str(folder / "scene.toml"), *images, *more, *options]


def fails(capsys: pytest.CaptureFixture[str], arguments: list[str]) -> str:
    assert main(arguments) == 2
    said = capsys.readouterr()
    assert said.out == "" and said.err.count("\n") == 1
    return said.err


def test_maps_are_what_python_gives_and_are_drawn(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output, picture = tmp_path / "maps.nc", tmp_path / "maps.png"
    assert main(command(folder, "simulated", "-o", str(output), "--plot", str(picture))) == 0
    said = capsys.readouterr().out
    assert "phase and height at setpoint 0.65, free amplitude 80 nm" in said
    assert "verdict     Of 64: " in said and f"written to  {output}" in said
    found = xr.load_dataset(output)
    images = [pm.read_image(folder / f"simulated{i}.nc") for i in range(3)]
    scope = load_setup(folder / "scene.toml").microscope
    scopes = [pm.Microscope(scope.cantilever, scope.tip, pm.Drive(amplitude)) for amplitude, _ in SETTINGS]
    again = pm.invert(images, scopes)
    np.testing.assert_array_equal(found.modulus, again.modulus)
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert main(["plot", str(output), "-o", str(tmp_path / "again.png")]) == 0
    assert (tmp_path / "again.png").read_bytes().startswith(b"\x89PNG")


def test_regions_that_are_found_are_numbered_by_area_as_those_of_a_series() -> None:
    phase = np.full((8, 8), 40.0)
    phase[:, :2] = 10.0
    image = xr.Dataset({"phase": (("y", "x"), phase)})
    np.testing.assert_array_equal(_labels("2", image), phase < 20)


@pytest.mark.parametrize("where", ["2", "maps.nc"])
def test_regions_need_no_zero(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], where: str) -> None:
    regions = str(folder / where) if where == "maps.nc" else where
    output = tmp_path / "regions.nc"
    assert main(command(folder, "measured", "--regions", regions, "--known", "0=soft", "-o", str(output))) == 0
    said = capsys.readouterr().out
    assert "region 0    modulus 0.15 GPa (given), adhesion 0.05 J/m² (given), damping 0.02 (given)" in said
    assert "phase zero  -30.0" in said and "Region 1: modulus, adhesion and damping determined." in said
    found = xr.load_dataset(output)
    for name, true in (("modulus", 0.6e9), ("adhesion", 0.07), ("damping", 0.01)):
        # without noise the fit is off by what the prior pulls, less than a standard error
        assert abs(np.log(float(found[name][1]) / true)) < float(found[f"{name}_error"][1])


def test_pixels_take_the_zeros_that_regions_find(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "maps.nc"
    options = ["--zeros-from", str(folder / "maps.nc"), "--height-error", "0.05e-9", "-o", str(output)]
    assert main(command(folder, "measured", *options)) == 0
    assert "The zero of the phase, by regions, is " in capsys.readouterr().out
    found = xr.load_dataset(output)
    true = np.where(LABELS == 0, 0.15e9, 0.6e9)
    assert (abs(np.log(found.modulus / true)) < found.modulus_error).all()
    configuration = found.attrs["configuration"]
    assert '"setpoints": [0.5, 0.8, 0.65]' in configuration


def test_measured_heights_without_zeros_are_left_out_and_that_is_said(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(command(folder, "measured", f"--phase-zero={-ZERO}")) == 0
    assert "Heights are not used" in capsys.readouterr().out


def test_the_sign_that_a_file_records_is_taken_unless_another_is_given(folder: Path, tmp_path: Path) -> None:
    """The zero is what the instrument says of the free lever, whichever way its phase counts."""
    images = []
    for i in range(len(SETTINGS)):
        images.append(pm.read_image(folder / f"measured{i}.nc").assign_attrs(phase_sign=-1, phase_zero=-ZERO))
        images[-1].to_netcdf(tmp_path / f"measured{i}.nc")
    (tmp_path / "scene.toml").write_text(SCENE)
    options = command(tmp_path, "measured", "-o", str(tmp_path / "found.nc"), "--quiet")
    at = options.index("--sign")
    assert main(options[:at] + options[at + 2 :]) == 0
    found = xr.load_dataset(tmp_path / "found.nc")
    true = np.where(LABELS == 0, 0.15e9, 0.6e9)
    assert (abs(np.log(found.modulus / true)) < found.modulus_error).all()
    scope = load_setup(folder / "scene.toml").microscope
    scopes = [pm.Microscope(scope.cantilever, scope.tip, pm.Drive(amplitude)) for amplitude, _ in SETTINGS]
    once = pm.fit_regions(images, LABELS, scopes)
    shared = pm.fit_regions(images, LABELS, scopes, phase_zero="shared")
    turned = pm.fit_regions([one.assign(phase=one.phase + 360) for one in images], LABELS, scopes)
    np.testing.assert_allclose(once.modulus, turned.modulus, rtol=1e-9)
    np.testing.assert_allclose(once.phase_zero, -ZERO)
    assert abs(shared.phase_zero.values + ZERO).max() < 3 * shared.phase_zero_error.values.max()


def test_what_is_missing_is_asked_for_by_name(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "give --phase-zero in degrees" in fails(capsys, command(folder, "measured"))
    image = pm.read_image(folder / "measured0.nc")
    del image.attrs["setpoint"]
    image.to_netcdf(tmp_path / "bare.nc")
    scene = str(folder / "scene.toml")
    assert "does not say its setpoint: give --setpoints" in fails(capsys, ["invert", scene, str(tmp_path / "bare.nc")])
    (tmp_path / "blunt.toml").write_text(SCENE.replace("radius = 10e-9", ""))
    blunt = ["invert", str(tmp_path / "blunt.toml"), str(folder / "measured0.nc")]
    assert "[tip] radius is missing" in fails(capsys, blunt)
    assert "there is no image" in fails(capsys, ["invert", scene, "tip.radius=20e-9"])
    alone = fails(capsys, ["invert", str(folder / "simulated0.nc")])
    assert "a scene file (.toml)" in alone and "images of one place at two settings or more" in alone


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--setpoints", "0.5,0.6"], "--setpoints is '0.5,0.6'; allowed: a number, or 3 with commas"),
        (["--regions", "0"], "--regions is '0'"),
        (["--regions", "nowhere.nc"], "cannot read nowhere.nc"),
        (["--regions", "2", "--known", "0"], "LABEL=NAME"),
        (["--regions", "2", "--known", "0=sofd"], "Did you mean 'soft'?"),
        (["--regions", "2", "--known", "5=soft"], "a region of known material is 5; allowed: one of 0, 1."),
        (["--regions", "2", "--phase-zero", "unknown"], "--phase-zero is 'unknown'"),
        (["--flat"], "--flat is for --regions and --zeros-from."),
        (["--prior", "hard"], "--prior is 'hard'; allowed: one of soft, firm."),
        (["interaction.contact=jkr"], "contact is 'jkr'; allowed: a law without a neck"),
        (["--regions", "2", "interaction.contact=maugis"], "contact is 'maugis'; allowed: a law without a neck"),
        (["--plot", "x.bild"], "the picture's suffix is '.bild'"),
        (["--fast"], "unknown argument '--fast'"),
    ],
)
def test_what_cannot_be_used_is_said_in_one_sentence(
    folder: Path, capsys: pytest.CaptureFixture[str], options: list[str], sentence: str
) -> None:
    try:
        said = fails(capsys, command(folder, "simulated", *options))
    except SystemExit:
        said = capsys.readouterr().err
    assert sentence in said


def test_a_file_without_labels_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    image = str(folder / "simulated0.nc")
    assert "a map labels or label" in fails(capsys, command(folder, "simulated", "--regions", image))
