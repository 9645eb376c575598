"""Images in netCDF files: whole or not at all, identical on the way back."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

import phasemap as pm
from phasemap._shared.errors import FileError
from phasemap._shared.files import _host, check_target, reason_of
from phasemap.io import netcdf

DATA = Path(__file__).parents[1] / "data"


@pytest.fixture
def image() -> xr.Dataset:
    rng = np.random.default_rng(1)
    phase = rng.normal(size=(31, 17))
    phase[3, 4] = np.nan
    status = np.zeros((31, 17), np.int8)
    status[3, 4] = 1
    flags = {"flag_values": np.array([0, 1], np.int8), "flag_meanings": "good no_stable_orbit"}
    return xr.Dataset(
        {"phase": (("y", "x"), phase, {"units": "degree"}), "status": (("y", "x"), status, flags)},
        {"y": ("y", 4e-9 * np.arange(31), {"units": "m"}), "x": ("x", 4e-9 * np.arange(17), {"units": "m"})},
        {"Conventions": "CF-1.11", "setpoint": 0.7},
    )


def test_what_is_read_is_identical_to_what_was_written(image: xr.Dataset, tmp_path: Path) -> None:
    read = netcdf.load(netcdf.save(image, tmp_path / "image.nc"))
    xr.testing.assert_identical(read, image)
    assert {name: variable.dtype for name, variable in read.variables.items()} == {
        name: variable.dtype for name, variable in image.variables.items()
    }


def test_a_simulated_image_survives_with_every_attribute(tmp_path: Path) -> None:
    surface = pm.Surface(modulus=[[1e9, 3e9]], adhesion=0.05, damping=0.01, pixel_size=4e-9)
    scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(20e-9))
    simulated = pm.simulate(surface, scope, setpoint=0.7)
    path = netcdf.save(simulated, tmp_path / "image.nc")
    xr.testing.assert_identical(netcdf.load(path), simulated)
    with xr.open_dataset(path) as opened:
        xr.testing.assert_identical(opened.load(), simulated)


def test_a_file_that_was_read_can_be_written_again(image: xr.Dataset, tmp_path: Path) -> None:
    once = netcdf.load(netcdf.save(image, tmp_path / "once.nc"))
    twice = netcdf.load(netcdf.save(once.isel(x=slice(5)), tmp_path / "twice.nc"))
    xr.testing.assert_identical(twice, image.isel(x=slice(5)))


def test_maps_are_compressed(tmp_path: Path) -> None:
    flat = xr.Dataset({"phase": (("y", "x"), np.ones((300, 300)))})
    assert netcdf.save(flat, tmp_path / "flat.nc").stat().st_size < flat.nbytes / 10


def test_an_existing_file_is_refused_and_left_as_it_was(image: xr.Dataset, tmp_path: Path) -> None:
    path = tmp_path / "image.nc"
    path.write_bytes(b"precious")
    with pytest.raises(FileError, match=r"exists already; overwrite=True replaces it"):
        netcdf.save(image, path)
    assert path.read_bytes() == b"precious"
    netcdf.save(image, path, overwrite=True)
    xr.testing.assert_identical(netcdf.load(path), image)


@pytest.mark.parametrize(
    ("failure", "free", "reason"),
    [
        (OSError(28, "No space left on device"), 1 << 40, "the disk is full"),
        (RuntimeError("NetCDF: HDF error"), 0, "the disk is full"),
        (PermissionError(13, "Permission denied"), 0, "the disk is full"),
        (RuntimeError("NetCDF: HDF error"), 1 << 40, "NetCDF: HDF error"),
    ],
)
def test_a_write_that_fails_leaves_nothing_and_keeps_the_old_file(
    image: xr.Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, failure: Exception, free: int, reason: str
) -> None:
    path = netcdf.save(image, tmp_path / "image.nc")
    before = path.read_bytes()

    def half(self: xr.Dataset, target: Path, **_: object) -> None:
        target.write_bytes(b"half a file")
        raise failure

    monkeypatch.setattr(xr.Dataset, "to_netcdf", half)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=free, total=1 << 50))
    with pytest.raises(FileError, match=rf"cannot write .*image\.nc: {reason}"):
        netcdf.save(image, path, overwrite=True)
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["image.nc"]


@pytest.mark.skipif(not Path("/proc/version").exists(), reason="there is no /proc on this machine")
def test_a_folder_that_takes_no_files_is_said_to_take_none_before_anything_is_made() -> None:
    with pytest.raises(FileError, match=r"cannot write /proc/a\.nc: no file can be made in the folder '/proc' \("):
        check_target("/proc/a.nc")
    assert "full" not in reason_of(RuntimeError("NetCDF: HDF error"), "/proc")  # though it has no room, nor ever had


def test_an_interrupt_while_writing_leaves_nothing(
    image: xr.Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(self: xr.Dataset, target: Path, **_: object) -> None:
        target.write_bytes(b"half a file")
        raise KeyboardInterrupt

    monkeypatch.setattr(xr.Dataset, "to_netcdf", interrupted)
    with pytest.raises(KeyboardInterrupt):
        netcdf.save(image, tmp_path / "image.nc")
    assert os.listdir(tmp_path) == []


def test_a_target_that_cannot_be_written_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(FileError, match=r"the folder '.*missing' does not exist"):
        check_target(tmp_path / "missing" / "image.nc")
    with pytest.raises(FileError, match="is a folder or a device, not a file"):
        check_target(tmp_path, overwrite=True)
    with pytest.raises(FileError, match="is a folder or a device, not a file"):
        check_target("/dev/null", overwrite=True)
    monkeypatch.setattr(os, "access", lambda *_: False)  # root may write anywhere
    with pytest.raises(FileError, match="no permission to write in the folder"):
        check_target(tmp_path / "image.nc")


def test_a_damaged_or_foreign_file_is_refused_in_one_sentence(image: xr.Dataset, tmp_path: Path) -> None:
    whole = netcdf.save(image, tmp_path / "image.nc").read_bytes()
    for name, content in {"cut": whole[: len(whole) // 2], "text": b"height,phase\n", "empty": b""}.items():
        path = tmp_path / f"{name}.nc"
        path.write_bytes(content)
        with pytest.raises(FileError, match=f"cannot read .*{name}.nc: it is not a netCDF file, or it is damaged"):
            netcdf.load(path)
    with pytest.raises(FileError, match="there is no such file"):
        netcdf.load(tmp_path / "nowhere.nc")
    with pytest.raises(FileError, match="it is not a file"):
        netcdf.load(tmp_path)


def test_what_a_killed_process_left_is_cleared_and_what_a_living_one_writes_is_not(tmp_path: Path) -> None:
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    host = _host()
    dead = tmp_path / f".image.{host}-{gone.pid}.tmp.nc"
    alive = tmp_path / f".image.{host}-{os.getppid()}.tmp.nc"
    elsewhere = tmp_path / f".image.else-{gone.pid}.tmp.nc"
    other = tmp_path / f".other.{host}-{gone.pid}.tmp.nc"
    for file in (dead, alive, elsewhere, other):
        file.touch()
    netcdf.save(xr.Dataset({"phase": 1.0}), tmp_path / "image.nc")
    assert {*tmp_path.iterdir()} == {alive, elsewhere, other, tmp_path / "image.nc"}


@pytest.mark.slow
def test_a_damaged_file_that_the_library_never_finishes_is_given_up(tmp_path: Path) -> None:
    # Found by tests/fuzz: HDF5 1.14 searches this file for ever; another version may refuse it at once.
    code = (
        "import sys; from phasemap import cli; from phasemap.io import netcdf; netcdf.LIMIT = 1; sys.exit(cli.main())"
    )
    command = [sys.executable, "-c", code, "plot", str(DATA / "endless.nc"), "-o", str(tmp_path / "picture.png")]
    run = subprocess.run(command, capture_output=True, text=True)
    assert run.returncode == 2 and re.fullmatch(r"phasemap: cannot read .*endless\.nc: .*damaged.*\n", run.stderr)
