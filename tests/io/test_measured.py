"""What is made of a measured image: aligned rows, level height, and the materials that its phase tells apart."""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy.ndimage import median_filter

from phasemap._shared.errors import FileError, InputError, PhasemapError
from phasemap.io import measured
from phasemap.io.read import read_image

needs_reader = pytest.mark.skipif(
    any(find_spec(name) is None for name in ("gwyddionpy", "gwyddionpy_converter", "skimage", "NSFopen")),
    reason='needs pip install "afm-phasemap[read]" and nsfopen',
)


def example(name: str) -> Path:
    spec = find_spec("NSFopen")
    assert spec is not None and spec.submodule_search_locations is not None
    return Path(spec.submodule_search_locations[0], "example", name)


@needs_reader
def test_flake_and_substrate_are_told_apart_across_the_tip_change() -> None:
    phase = measured.one_scan(read_image(example("Plotting_Data/MoS2.nid")))["phase"].values
    labels = measured.segment_phase(phase, 2)
    assert set(np.unique(labels)) == {0, 1}
    assert np.mean(labels[:200, :50] == 1) > 0.99  # bare substrate at the left, above and below row 78
    # Between the corner of the flake and its growth centres, above and below the tip change and in the lower half.
    for flake in (labels[10:40, 150:165], labels[85:140, 230:240], labels[160:240, 200:212]):
        assert np.mean(flake == 0) > 0.9


def two_scans() -> xr.Dataset:
    height = np.stack([np.zeros((3, 4)), np.ones((3, 4))])
    attrs = {
        "source": "scan.nid",
        "channels": '{"height": ["Z forward", "Z backward"]}',
        "other_channels": '["Adhesion"]',
    }
    return xr.Dataset({"height": (("direction", "y", "x"), height)}, {"direction": ["trace", "retrace"]}, attrs)


def test_one_scan_is_the_first_or_the_one_asked_for_and_has_what_is_needed() -> None:
    scans = two_scans()
    assert measured.one_scan(scans, ["height"]).attrs["direction"] == "trace"
    retrace = measured.one_scan(scans, ["height"], "retrace")
    assert retrace["height"].dims == ("y", "x") and float(retrace["height"].min()) == 1.0
    assert measured.one_scan(retrace, ["height"], "retrace") is retrace
    with pytest.raises(InputError, match="direction is 'trace'; allowed: one that was read: retrace"):
        measured.one_scan(retrace, ["height"], "trace")
    sentence = "cannot use scan.nid: there is no phase channel; it holds 'Z forward', 'Z backward', 'Adhesion'."
    with pytest.raises(FileError, match=sentence):
        measured.one_scan(scans)


def test_without_the_extra_segmenting_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "skimage.filters", None)
    with pytest.raises(PhasemapError, match=r'run pip install "afm-phasemap\[read\]"\.$'):
        measured.segment_phase(np.eye(4), 2)


@needs_reader
def test_two_clean_populations_are_told_apart_to_the_last_pixel() -> None:
    truth = (np.mgrid[:24, :32][1] >= 20).astype(int)
    phase = np.where(truth, -8.0, -27.0) + np.random.default_rng(3).normal(0, 0.4, truth.shape)
    assert np.array_equal(measured.segment_phase(phase, 2), truth)


@needs_reader
@pytest.mark.parametrize("n", [2, 3])
def test_known_populations_are_found_under_row_offsets_and_noise(n: int) -> None:
    rng = np.random.default_rng(5)
    y, x = np.mgrid[:96, :128]
    truth = np.minimum((x + 20 * np.sin(y / 15) + y / 3) // (170 / n), n - 1).astype(int)
    drift = np.cumsum(rng.normal(0, 1.0, 96)) + 25.0 * (y[:, 0] > 40)
    phase = 15.0 * truth + drift[:, None] + rng.normal(0, 2.0, truth.shape)
    assert np.mean(measured.segment_phase(phase, n) == truth) > 0.99
    residual = measured.align_and_segment(phase, n)[0] - 15.0 * truth
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


@pytest.mark.parametrize("shape", [(9, 14), (1, 5), (2, 2), (1, 1)])
def test_the_median_of_neighbours_is_that_of_a_rank_filter(shape: tuple[int, int]) -> None:
    values = np.random.default_rng(0).integers(0, 9, shape).astype(float)
    assert np.array_equal(measured.smoothed(values), median_filter(values, 3))
