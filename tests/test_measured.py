"""Real files from the nsfopen wheel, and the materials that their phase tells apart."""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from phasemap.errors import FileError, InputError, PhasemapError
from phasemap.io import measured

needs_reader = pytest.mark.skipif(
    any(find_spec(name) is None for name in ("gwyddionpy", "gwyddionpy_converter", "skimage", "NSFopen")),
    reason='needs pip install "afm-phasemap[read]" and nsfopen',
)


def example(name: str) -> Path:
    spec = find_spec("NSFopen")
    assert spec is not None and spec.submodule_search_locations is not None
    return Path(spec.submodule_search_locations[0], "example", name)


@needs_reader
def test_a_tapping_file_gives_height_and_phase_in_si_with_its_own_pixels() -> None:
    ds = measured.read_height_phase(example("Plotting_Data/MoS2.nid"))
    assert ds["phase"].dims == ("y", "x") and ds["phase"].shape == (256, 512)
    assert (ds["height"].attrs["units"], ds["phase"].attrs["units"]) == ("m", "degree")
    dy, dx = (float(ds[dim][1] - ds[dim][0]) for dim in ("y", "x"))
    assert dx * 512 == pytest.approx(3.97339e-6) and dy == pytest.approx(2 * dx)  # its pixels are not square
    assert float(ds["x"][0]) == pytest.approx(dx / 2)
    assert 10e-9 < float(np.ptp(ds["height"].values)) < 200e-9
    assert ds.attrs["height_channel"] == "Z-Axis forward" and ds.attrs["phase_channel"] == "Phase forward"
    assert ds.attrs["operating_mode"] == "Phase Contrast"


@needs_reader
def test_row_0_is_the_top_of_the_image() -> None:
    ds = measured.read_height_phase(example("Plotting_Data/MoS2.nid"))
    # The tip changed 78 of 256 rows below the top: the phase above is 10 degrees lower.
    step = np.diff(np.median(ds["phase"].values[:, :110], axis=1))
    assert np.argmax(step) in (77, 78)


@needs_reader
def test_the_height_of_the_direction_of_the_phase_is_taken_and_channels_can_be_named() -> None:
    path = example("Plotting_Data/MoS2.nid")
    assert measured.read_height_phase(path, phase="Phase backward").attrs["height_channel"] == "Z-Axis backward"
    chosen = measured.read_height_phase(path, height="Z-Axis Sensor forward")
    assert chosen.attrs["height_channel"] == "Z-Axis Sensor forward"
    with pytest.raises(FileError, match="there is no channel 'Fase'; it holds 'Z-Axis forward', "):
        measured.read_height_phase(path, phase="Fase")
    with pytest.raises(FileError, match="'Amplitude forward' is in 'V', not an angle"):
        measured.read_height_phase(path, phase="Amplitude forward")
    with pytest.raises(FileError, match="'Phase forward' is in 'deg' over 'm', not calibrated in metres"):
        measured.read_height_phase(path, height="Phase forward")


@needs_reader
def test_a_file_without_a_phase_or_of_another_mode_is_refused() -> None:
    with pytest.raises(FileError, match="there is no phase channel; it holds 'Topography forward'"):
        measured.read_height_phase(example("Plane_Removal/circles.nid"))
    with pytest.raises(FileError, match="recorded in the mode 'Static Force', whose phase is not a tapping phase"):
        measured.read_height_phase(example("Force_Spectroscopy/spectroscopy.nid"))


@needs_reader
def test_a_file_that_is_cut_short_or_foreign_is_refused_in_one_sentence(tmp_path: Path) -> None:
    whole = example("Plotting_Data/MoS2.nid").read_bytes()
    for name, content in {"cut.nid": whole[: len(whole) // 2], "text.nid": b"hello\n", "empty.ibw": b""}.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(FileError, match=f"^cannot read [^\n]*{name}: [^\n]+\\.$"):
            measured.read_height_phase(tmp_path / name)
    with pytest.raises(FileError, match="there is no such file"):
        measured.read_height_phase(tmp_path / "nowhere.nid")


def test_without_the_extra_it_says_how_to_install_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gwyddionpy", None)
    monkeypatch.setitem(sys.modules, "skimage.filters", None)
    (tmp_path / "scan.nid").touch()
    with pytest.raises(PhasemapError, match=r'run pip install "afm-phasemap\[read\]"\.$'):
        measured.read_height_phase(tmp_path / "scan.nid")
    with pytest.raises(PhasemapError, match=r'run pip install "afm-phasemap\[read\]"\.$'):
        measured.segment_phase(np.eye(4), 2)


@needs_reader
def test_flake_and_substrate_are_told_apart_across_the_tip_change() -> None:
    phase = measured.read_height_phase(example("Plotting_Data/MoS2.nid"))["phase"].values
    labels = measured.segment_phase(phase, 2)
    assert set(np.unique(labels)) == {0, 1}
    assert np.mean(labels[:200, :50] == 1) > 0.99  # bare substrate at the left, above and below row 78
    # Between the corner of the flake and its growth centres, above and below the tip change and in the lower half.
    for flake in (labels[10:40, 150:165], labels[85:140, 230:240], labels[160:240, 200:212]):
        assert np.mean(flake == 0) > 0.9


@needs_reader
@pytest.mark.parametrize("n", [2, 3])
def test_known_populations_are_found_under_row_offsets_and_noise(n: int) -> None:
    rng = np.random.default_rng(5)
    y, x = np.mgrid[:96, :128]
    truth = np.minimum((x + 20 * np.sin(y / 15) + y / 3) // (170 / n), n - 1).astype(int)
    drift = np.cumsum(rng.normal(0, 1.0, 96)) + 25.0 * (y[:, 0] > 40)
    phase = 15.0 * truth + drift[:, None] + rng.normal(0, 2.0, truth.shape)
    assert np.mean(measured.segment_phase(phase, n) == truth) > 0.99
    residual = measured.align_rows(phase, n) - 15.0 * truth
    assert np.ptp(np.median(residual, axis=1)) < 2.0  # 30 and more before


@needs_reader
@pytest.mark.parametrize(
    ("phase", "n", "sentence"),
    [
        (np.ones((8, 8)), 2, "number of different phases is 1; allowed: enough to tell 2 materials apart"),
        (np.eye(8), 5, "number of materials is 5; allowed: 2 to 4"),
        (np.eye(8), True, "number of materials is True; allowed: 2 to 4"),
        (np.arange(8.0), 2, r"shape of phase is \(8,\); allowed: \(rows, columns\) of a 2-D map"),
        (np.where(np.eye(8) > 0, np.nan, 1.0), 2, "phase is nan; allowed: finite values. It is at row 0, column 0."),
    ],
)
def test_a_phase_that_holds_no_such_populations_is_refused(phase: np.ndarray, n: int, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        measured.segment_phase(phase, n)


def test_tilt_and_row_offsets_are_taken_out_and_particles_left_in() -> None:
    rng = np.random.default_rng(2)
    y, x = np.mgrid[:64, :64]
    particles = (x - 40) ** 2 + (y - 30) ** 2 < 200
    truth = 8e-9 * particles
    offsets = rng.normal(0, 3e-9, (64, 1))
    levelled = measured.level_height(truth + 1e-9 * x - 2e-9 * y + offsets, reference=~particles)
    assert np.abs(levelled - truth).max() < 0.5e-9


def test_a_row_without_reference_takes_its_offset_from_its_neighbours() -> None:
    reference = np.ones((5, 6), bool)
    reference[2] = False
    height = 1e-9 * np.array([0.0, 1.0, 9.0, 1.0, 0.0])[:, None] * np.ones(6)
    assert measured.level_height(height, reference)[2] == pytest.approx(8e-9 * np.ones(6), rel=1e-6)
    with pytest.raises(InputError, match=r"pixels in reference is \(\(5, 6\), 0\); allowed: \(5, 6\), at least 3"):
        measured.level_height(height, np.zeros((5, 6), bool))
