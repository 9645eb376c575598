"""The command ``phasemap series``."""

import numpy as np
import pytest
import xarray as xr

from phasemap.cli import main
from phasemap.inference import sampling
from phasemap.inference.series import likelihood as of_series

MICROSCOPE = (
    "[cantilever]\nstiffness = 26.0\nresonance_frequency = 300e3\nquality_factor = 400.0\n"
    "[tip]\nradius = 10e-9\n[drive]\nfree_amplitude = 20e-9\n"
)


@pytest.fixture
def files(tmp_path, monkeypatch):
    """Two files that say their setpoint, few draws and a coarse table: what is asked here is not how good they are."""
    monkeypatch.setattr(sampling, "STEPS", 20)
    monkeypatch.setattr(sampling, "FIRST", 2000)
    monkeypatch.setattr(of_series, "COUNTS", (5, 3, 4))
    labels = np.tile(np.repeat([0, 1], [12, 8]), (20, 1))
    paths = []
    for setpoint, contrast in ((0.5, 30.0), (0.8, 20.0)):
        noise = np.random.default_rng(3).normal(0, 1.0, labels.shape)
        phase = (("y", "x"), contrast * labels + noise, {"units": "degree"})
        height = (("y", "x"), 4e-9 * labels + 1e-10 * noise, {"units": "m"})
        coords = {"y": 4e-9 * (np.arange(20) + 0.5), "x": 4e-9 * (np.arange(20) + 0.5)}
        image = xr.Dataset({"phase": phase, "height": height}, coords, {"setpoint": setpoint, "drive_frequency": 3e5})
        paths.append(tmp_path / f"at{setpoint}.nc")
        image.to_netcdf(paths[-1])
    return [str(path) for path in paths]


def test_files_become_a_summary_a_dataset_and_a_page(files, tmp_path, capsys):
    page, written = tmp_path / "page.png", tmp_path / "series.nc"
    more = ["--sign", "1", "--plot", str(page), "-o", str(written), "tip.radius=20nm"]
    assert main(["series", *files, *more]) == 0
    said = capsys.readouterr().out
    assert said.splitlines()[0].startswith("file        at0.8.nc: setpoint 0.8, free amplitude")
    assert "contrast +19.9" in said and "note        The stiffness is not in the files" in said
    assert "tip radius is not" not in said
    assert page.stat().st_size > 10_000
    assert main(["plot", str(written)]) == 0  # the same page
    assert written.with_suffix(".png").read_bytes() == page.read_bytes()
    with xr.open_dataset(written) as found:
        assert found.file.values.tolist() == ["at0.8.nc", "at0.5.nc"]


@pytest.mark.slow
def test_a_known_region_as_the_advice_says_is_a_preset_or_a_material_of_the_scene(files, tmp_path, capsys):
    scene = tmp_path / "scene.toml"
    scene.write_text(MICROSCOPE + "[materials.matrix]\nmodulus = 2e9\nadhesion = 0.05\ndamping = 0.01\n")
    for more in (["--known", "0=PS"], ["--known", "0=matrix", "--scene", str(scene)]):
        assert main(["series", *files, "--sign", "1", *more]) == 0
        assert "Region 0: given." in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["tip.size=3"], "tip.radius"),
        (["drive.free_amplitude=40nm"], "It is for --free-amplitudes."),
        (["--setpoints", "0.5,0.6,0.7"], "2 with commas between them"),
        (["--labels", "nowhere.nc"], "nowhere.nc"),
        (["--known", "mica"], "--known is 'mica'; allowed: LABEL=NAME"),
        (["--known", "0=mika"], "Did you mean 'mica'"),
    ],
)
def test_what_cannot_be_is_said_in_a_sentence(files, words, message, capsys):
    assert main(["series", *files, *words]) == 2
    assert message in " ".join(capsys.readouterr().err.split())


@pytest.mark.slow
def test_a_microscope_of_a_scene_serves_a_series(files, tmp_path, capsys):
    scene = tmp_path / "lever.toml"
    scene.write_text(MICROSCOPE)
    assert main(["series", *files, "--sign", "1", "--scene", str(scene), "--quiet"]) == 0
    assert capsys.readouterr().out == ""
