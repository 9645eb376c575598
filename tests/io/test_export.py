"""Images for Gwyddion: what is written is what Gwyddion's own format says, and what is read back."""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from phasemap._shared.errors import FileError, InputError, PhasemapError
from phasemap.cli import main
from phasemap.io.export import export
from phasemap.io.netcdf import save
from phasemap.io.read import read_image

pytestmark = pytest.mark.skipif(
    any(find_spec(name) is None for name in ("gwyfile", "gsffile", "gwyddionpy", "gwyddionpy_converter")),
    reason='needs pip install "afm-phasemap[read,gwy]"',
)
HOLE = (1, 2, 3)  # direction, row, column of the pixel without a solution
KNOWN = {"drive_frequency": 299.5e3, "free_amplitude": 20e-9, "setpoint": 0.7, "stiffness": 40.0, "phase_zero": -1 / 3}


def two_scans() -> xr.Dataset:
    """Trace and retrace of 4 x 6 pixels that are not square, one of them without a solution."""
    rng = np.random.default_rng(7)
    height, phase = 1e-8 * rng.normal(size=(2, 4, 6)), 30 * rng.normal(size=(2, 4, 6))
    status = np.zeros(phase.shape, np.int8)
    height[HOLE] = phase[HOLE] = np.nan
    status[HOLE] = 1
    dims = ("direction", "y", "x")
    return xr.Dataset(
        {
            "height": (dims, height, {"units": "m"}),
            "phase": (dims, phase, {"units": "degree"}),
            "dissipation": (dims, 1e-19 * rng.random((2, 4, 6)), {"units": "J"}),
            "status": (dims, status),
        },
        {"direction": ["trace", "retrace"], "y": (np.arange(4)[::-1] + 0.5) * 3e-9, "x": (np.arange(6) + 0.5) * 5e-9},
        {"operating_mode": "Tapping", "warnings": "One.\nTwo.", **KNOWN},
    )


def gwy(path: Path) -> Any:
    return import_module("gwyfile").load(str(path))


def test_a_gwy_file_gives_back_every_bit(tmp_path: Path) -> None:
    image = two_scans()
    read = read_image(export(image, tmp_path / "image.gwy"))
    for name in ("height", "phase"):
        assert read[name].values.tobytes() == image[name].values.tobytes()  # NaN under the mask among them
        assert read[name].dims == image[name].dims and read[name].attrs["units"] == image[name].attrs["units"]
    for dim in ("y", "x"):
        assert read[dim].values == pytest.approx(image[dim].values, rel=1e-15)
    assert {name: read.attrs[name] for name in KNOWN} == KNOWN
    assert (read.attrs["operating_mode"], read.attrs["warnings"]) == ("Tapping", "One.\nTwo.")


def test_gwyddion_finds_titles_units_palettes_sizes_and_masks(tmp_path: Path) -> None:
    image = two_scans()
    # Through Gwyddion's own module for its files, which refuses what is not well formed.
    import_module("gwyddionpy").run_converter(export(image, tmp_path / "ours.gwy"), tmp_path / "theirs.gwy")
    held = gwy(tmp_path / "theirs.gwy")
    titles = [held[f"/{n}/data/title"] for n in range(6)]
    quantities = ("Height", "Phase", "Dissipation")
    assert titles == [f"{name} {direction}" for name in quantities for direction in ("trace", "retrace")]
    assert [held[f"/{n}/base/palette"] for n in (0, 2, 4)] == ["Gwyddion.net", "Gray", "Warm"]
    assert [held[f"/{n}/data"]["si_unit_z"]["unitstr"] for n in (0, 2, 4)] == ["m", "deg", "J"]
    field = held["/1/data"]
    assert (field["xres"], field["yres"], field["si_unit_xy"]["unitstr"]) == (6, 4, "m")
    assert (field["xreal"], field["yreal"]) == pytest.approx((30e-9, 12e-9))
    assert np.argwhere(held["/1/mask"].data).tolist() == [list(HOLE[1:])] and "/0/mask" not in held
    # Gwyddion has no NaN: the mean of the others leaves the colour scale alone.
    assert field.data[HOLE[1:]] == pytest.approx(np.nanmean(image["height"].values[1]))
    assert held["/0/meta"]["drive_frequency"] == "299500.0 Hz"


def test_a_mask_that_a_user_drew_hides_nothing(tmp_path: Path) -> None:
    objects = import_module("gwyfile").objects
    height = np.array([[1e-9, 2e-9], [3e-9, 4e-9]])
    field = objects.GwyDataField(height, 1e-7, 1e-7, si_unit_xy="m ", si_unit_z="m ")
    container = objects.GwyContainer({"/0/data": field, "/0/data/title": "Height", "/0/mask": field})
    for unit in ("si_unit_xy", "si_unit_z"):
        field[unit] = objects.GwySIUnit(unitstr="m")
    container.tofile(str(tmp_path / "grains.gwy"))
    assert np.array_equal(read_image(tmp_path / "grains.gwy")["height"].values, height)


@pytest.mark.parametrize("direction", ["trace", "retrace"])
def test_a_gsf_file_gives_back_single_precision(direction: str, tmp_path: Path) -> None:
    image = two_scans()
    read = read_image(export(image, tmp_path / "phase.gsf", "phase", direction))
    expected = image["phase"].sel(direction=direction).values.astype(np.float32)
    assert np.array_equal(read["phase"].values, expected, equal_nan=True)
    assert read.attrs["direction"] == direction and read["phase"].attrs["units"] == "degree"
    assert [float(read[dim].min()) for dim in ("y", "x")] == pytest.approx([1.5e-9, 2.5e-9])
    assert {name: read.attrs[name] for name in KNOWN} == KNOWN


def test_the_suffix_chooses_the_format(tmp_path: Path) -> None:
    image = two_scans()
    one = read_image(export(image, tmp_path / "image.gwy", "phase", "retrace"))
    assert list(one.data_vars) == ["phase"] and one.attrs["direction"] == "retrace"
    assert read_image(export(image[["height"]], tmp_path / "image.gsf"))["height"].shape == (4, 6)
    with pytest.raises(InputError, match=r"suffix is '.tiff'; allowed: .gwy or .gsf"):
        export(image, tmp_path / "image.tiff")
    with pytest.raises(InputError, match="variable is None; allowed: one of height, phase, dissipation"):
        export(image, tmp_path / "other.gsf")
    with pytest.raises(FileError, match="it exists already"):
        export(image, tmp_path / "image.gwy")
    with pytest.raises(InputError, match="spacing of x is '5e-09 to 1e-08'; allowed: the same between all pixels"):
        export(image.isel(x=[0, 1, 3]), tmp_path / "uneven.gwy")
    with pytest.raises(InputError, match=r"the image is one of status; allowed: one with a real map"):
        export(image[["status"]], tmp_path / "flags.gwy")


def test_gwyddion_gets_metres_and_degrees_whatever_units_and_order_an_image_has(tmp_path: Path) -> None:
    image = two_scans().isel(direction=0)[["height", "phase"]]
    other = image.assign(height=1e9 * image["height"], phase=image["phase"].drop_attrs()).transpose("x", "y")
    other["height"].attrs["units"] = "nm"
    held = gwy(export(other, tmp_path / "image.gwy"))
    assert held["/0/data"].data == pytest.approx(image["height"].values, rel=1e-12)
    assert [held[f"/{n}/data"]["si_unit_z"]["unitstr"] for n in (0, 1)] == ["m", "deg"]
    read = read_image(export(other, tmp_path / "height.gsf", "height"))
    assert read["height"].values == pytest.approx(image["height"].values, rel=1e-6)
    with pytest.raises(InputError, match=r"ds is of type DataArray; allowed: an xarray\.Dataset"):
        export(image["phase"], tmp_path / "phase.gwy")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="variable is 'phase'; allowed: a real one over"):
        export(image.astype(int), tmp_path / "phase.gsf", "phase")
    with pytest.raises(InputError, match="attribute setpoint is 'x'; allowed: a finite number"):
        export(image.assign_attrs(setpoint="x"), tmp_path / "phase.gwy")


def test_without_the_extra_it_says_how_to_install_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gwyfile", None)
    monkeypatch.setitem(sys.modules, "gsffile", None)
    for name in ("image.gwy", "image.gsf"):
        with pytest.raises(PhasemapError, match=r'run pip install "afm-phasemap\[gwy\]"\.$'):
            export(two_scans()[["phase"]], tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_the_command_writes_what_python_writes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    image = two_scans()
    save(image, tmp_path / "image.nc")
    assert main(["export", str(tmp_path / "image.nc"), str(tmp_path / "command.gwy")]) == 0
    assert capsys.readouterr().out == f"note        One.\nnote        Two.\nwritten to  {tmp_path / 'command.gwy'}\n"
    export(image, tmp_path / "python.gwy")
    assert (tmp_path / "command.gwy").read_bytes() == (tmp_path / "python.gwy").read_bytes()
    assert main(["export", str(tmp_path / "image.nc"), str(tmp_path / "image.gsf")]) == 2
    assert "variable is None; allowed: one of height, phase" in capsys.readouterr().err
