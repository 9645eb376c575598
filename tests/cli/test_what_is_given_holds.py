"""What a user gives holds over what a file says, or is refused: nothing that is given is passed over."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import phasemap as pm
from phasemap.cli import main
from phasemap.io.netcdf import save

BLEND = str(Path(__file__).parents[2] / "samples" / "blend.toml")
SCOPE = pm.Microscope(pm.Cantilever(26.0, 300e3, 300.0, participation=1.1), pm.Tip(8e-9), pm.Drive(20e-9))
LABELS = (np.mgrid[:16, :16][1] >= 8).astype(int)
PAIR = [pm.Material(0.3e9, 0.05, 0.02), pm.Material(3e9, 0.05)]


@pytest.fixture
def images(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Folder of two simulated images, in which the command runs."""
    for setpoint in (0.5, 0.7):
        image = pm.simulate(pm.Surface.from_labels(LABELS, PAIR, pixel_size=4e-9), SCOPE, setpoint, "averaging")
        save(image, tmp_path / f"at{100 * setpoint:.0f}.nc")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_preset_holds_over_the_lever_of_a_simulated_image(images: Path) -> None:
    made = pm.scene_from("at50.nc", "lever.toml", 1, ["cantilever.preset=AC240TS"]).microscope
    assert made.cantilever == pm.Cantilever.preset("AC240TS") and made.frequency_ratio == 1.0
    assert made.drive.free_amplitude == SCOPE.drive.free_amplitude
    one = pm.scene_from("at50.nc", "one.toml", 1, ["cantilever.preset=AC240TS", "cantilever.stiffness=3"]).microscope
    assert one.cantilever == pm.Cantilever.preset("AC240TS", stiffness=3.0)
    other = pm.scene_from("at50.nc", "other.toml", 1, ["cantilever.resonance_frequency=310e3"]).microscope
    assert other.frequency_ratio == 1.0  # the image says no more of its drive than that it is at resonance


def test_a_measured_number_that_holds_over_a_preset_is_said(images: Path) -> None:
    image = pm.read_image("at50.nc").drop_attrs().assign_attrs(resonance_frequency=312e3, free_amplitude=2e-8)
    image["phase"].attrs["units"], image["height"].attrs["units"] = "degree", "m"
    given = ["cantilever.preset=AC240TS", "tip.radius=8e-9", "scan.setpoint=0.6"]
    with pytest.warns(
        pm.ResultWarning, match="The resonance frequency is as recorded, 312000, and not of the preset A"
    ):
        made = pm.scene_from(image, "measured.toml", 1, given).microscope
    assert made.cantilever == pm.Cantilever.preset("AC240TS", resonance_frequency=312e3)


REFUSED = [
    ("scene at50.nc surface.pixel_size=9nm", "[surface] pixel_size is '9nm'; allowed: nothing, for it is the image's"),
    ("scene at50.nc materials.material_7.modulus=1e9", "material is 'material_7'; allowed: one of material_0, materi"),
    (
        "scene at50.nc --height Z",
        "height is 'Z'; allowed: None for an image in netCDF, whose variable is called height",
    ),
    ("scene at50.nc --direction trace", "direction is 'trace'; allowed: None, for the image has no directions"),
    ("series at50.nc at70.nc --labels a.nc --regions 3", "--regions is 3; allowed: nothing beside --labels"),
    ("series at50.nc at70.nc cantilever.preset=AC240TS", "a key of the microscope is 'cantilever.preset'; allowed: "),
    (f"invert {BLEND} at50.nc at70.nc setpoint=0.6", "override is 'setpoint=0.6'; allowed: a key that is used here; "),
    (f"invert {BLEND} at50.nc at70.nc --regions 2 --zeros-from 2", "--zeros-from is '2'; allowed: nothing beside --re"),
    (f"invert {BLEND} at50.nc at70.nc --free-amplitudes 3nm drive.free_amplitude=2nm", "drive.free_amplitude is given"),
    (f"contrast {BLEND} --materials ps,ldpe scan.setpoint=0.5", "the setpoint is that of --setpoints"),
    (f"contrast {BLEND} --materials ps,ldpe --vmin -30", "--vmin is '-30'; allowed: nothing without --plot"),
    (f"sweep {BLEND} modulus --material ps surface.shape=[3,4]", "a key of microscope or materials"),
    (f"sweep {BLEND} distance --material ps setpoint=0.5", "the setpoint is that of AXIS, which is distance"),
    (f"sweep {BLEND} modulus --material ps setpoint=0.5 --setpoint 0.6", "the setpoint is that of --setpoint"),
    ("compare at50.nc at70.nc --cmap gray", "--cmap is 'gray'; allowed: nothing without --plot"),
    ("fit at50.nc --number 2", "number is 2; allowed: 0, for at50.nc holds one curve"),
    ("fit at50.nc --columns a,b", "columns is ['a', 'b']; allowed: None, for at50.nc is no text"),
]


@pytest.mark.parametrize(("command", "said"), REFUSED, ids=[command for command, _ in REFUSED])
def test_what_would_be_passed_over_is_refused(
    images: Path, capsys: pytest.CaptureFixture[str], command: str, said: str
) -> None:
    assert main(command.split()) == 2
    assert said in capsys.readouterr().err


def test_regions_that_are_given_are_not_sought(images: Path) -> None:
    with pytest.raises(pm.InputError, match="by is 'height'; allowed: None beside labels, which are the regions"):
        pm.series(["at50.nc", "at70.nc"], labels=LABELS, by="height")


def test_what_a_film_needs_is_asked_for_by_its_key(images: Path, capsys: pytest.CaptureFixture[str]) -> None:
    film = ["interaction.contact=film"]
    with pytest.raises(pm.InputError, match=r"Give it, such as (materials\.material_0\.thickness=20nm)\.") as caught:
        pm.scene_from("at50.nc", "film.toml", 1, film)
    key = str(caught.value).rpartition("such as ")[2].rstrip(".")
    made = pm.scene_from("at50.nc", "film.toml", 1, [*film, key])
    assert made.surface.thickness is not None and np.all(made.surface.thickness == 20e-9)
    for level in (0.5, 0.7):
        image = pm.simulate(made.surface, made.microscope, level)
        save(image, images / f"film{100 * level:.0f}.nc")
    assert main(["series", "film50.nc", "film70.nc"]) == 2
    assert "prior=Material(..., thickness=20e-9) has it, or with --prior NAME a m" in capsys.readouterr().err
