"""Two images beside each other: levelled, registered, brought to one grid, scored, drawn and said."""

from __future__ import annotations

import math
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from documented import check

import phasemap as pm
from phasemap._shared.errors import InputError, PhasemapError
from phasemap.cli import main
from phasemap.comparison.findings import lines_of, verdict_of
from phasemap.comparison.pair import common_grid
from phasemap.comparison.scores import correlation_of
from phasemap.io.netcdf import load, save
from phasemap.io.read import read_image

needs_skimage = pytest.mark.skipif(find_spec("skimage") is None, reason='needs pip install "afm-phasemap[compare]"')
needs_reader = pytest.mark.skipif(
    any(find_spec(name) is None for name in ("gwyddionpy", "gwyddionpy_converter", "skimage", "NSFopen")),
    reason='needs pip install "afm-phasemap[read]" and nsfopen',
)
PITCH = 4e-9


def image(height: np.ndarray, phase: np.ndarray, **others: np.ndarray) -> xr.Dataset:
    channels = {"height": height, "phase": phase, **others}
    y, x = (PITCH * (np.arange(n) + 0.5) for n in height.shape)
    return xr.Dataset({name: (("y", "x"), values.astype(float)) for name, values in channels.items()}, {"y": y, "x": x})


def blobs(rows: int, columns: int, seed: int = 1) -> np.ndarray:
    """A random rough surface [nm], correlated over some pixels and about 1 nm rms."""
    from scipy.ndimage import gaussian_filter

    rough = gaussian_filter(np.random.default_rng(seed).normal(size=(rows, columns)), 3, mode="wrap")
    return rough / rough.std()


def grains(rows: int = 96, columns: int = 100, seed: int = 1) -> xr.Dataset:
    """Two materials that differ by 20 degrees and 2 nm, on a rough ground."""
    soft = blobs(rows, columns, seed) > 0.3
    height = 0.2e-9 * blobs(rows, columns, seed + 1) + 2e-9 * soft
    return image(height, np.where(soft, -7.0, -27.0) + blobs(rows, columns, seed + 2))


def value(found: xr.Dataset, name: str) -> float:
    return float(found[name])


def moved(one: xr.Dataset, down: int, right: int) -> tuple[xr.Dataset, xr.Dataset]:
    """Two windows on an image; what the first shows, the second shows so many pixels further up and left."""
    rows, columns = one.sizes["y"] - abs(down), one.sizes["x"] - abs(right)
    first = one.isel(y=slice(max(-down, 0), max(-down, 0) + rows), x=slice(max(-right, 0), max(-right, 0) + columns))
    second = one.isel(y=slice(max(down, 0), max(down, 0) + rows), x=slice(max(right, 0), max(right, 0) + columns))
    return first, second


# Levelling


def test_levelling_takes_out_plane_and_row_offsets_exactly_and_leaves_a_masked_particle_alone() -> None:
    rng = np.random.default_rng(2)
    y, x = np.mgrid[:40, :50]
    particle = (y - 12) ** 2 + (x - 33) ** 2 < 60
    tilt = 0.3e-9 * x - 0.2e-9 * y + 5e-9 * rng.normal(size=(40, 1))
    tilted = image(tilt + 8e-9 * particle, -20.0 + 30.0 * particle)
    done = pm.level(tilted, mask=particle)
    # rounding of heights of 30 nm: 30e-9 * 2e-16 * sqrt(50)
    assert np.abs(done["height"].values - 8e-9 * particle).max() < 1e-22
    assert (done["phase"].values == 30.0 * particle).all()
    unmasked = pm.level(tilted)["height"].values
    assert np.abs(unmasked - 8e-9 * particle).max() > 0.1e-9  # what the mask is for


def test_a_plane_alone_leaves_row_offsets_and_a_phase_is_never_tilted() -> None:
    y, x = np.mgrid[:20, :30]
    rows = np.where(np.arange(20) % 2, 1.0, -1.0)[:, None]
    rows -= np.polyval(np.polyfit(np.arange(20), rows[:, 0], 1), np.arange(20))[:, None]  # that is no tilt
    one = image(1e-9 * (0.3 * x - 0.1 * y + rows), 0.5 * x + rows)
    flat = pm.level(one, height="plane")
    expected = np.broadcast_to(rows - np.median(rows), (20, 30))
    assert flat["height"].values == pytest.approx(1e-9 * expected, abs=1e-21)
    assert np.ptp(flat["phase"].values) == pytest.approx(np.ptp(one["phase"].values))
    by_row = pm.level(one, phase="rows")["phase"].values
    assert by_row == pytest.approx(np.broadcast_to(0.5 * (np.arange(30) - 14.5), (20, 30)))


def test_levelling_keeps_missing_pixels_missing_and_every_direction_by_itself() -> None:
    one = grains(24, 30)
    one["height"][3, 4] = np.nan
    both = xr.concat([one, one.assign(height=one["height"] + 1e-6)], xr.Variable("direction", ["trace", "retrace"]))
    both["x"].attrs["units"], both.attrs["phase_zero"] = "m", 3.0
    done = pm.level(both)
    assert done["height"].dims == ("direction", "y", "x") and done["outlier_line"].dims == ("direction", "y")
    assert np.argwhere(np.isnan(done["height"].values)).tolist() == [[0, 3, 4], [1, 3, 4]]
    # 1 um more in the retrace costs digits: 1e-6 * 2e-16
    assert np.nanmax(np.abs(np.diff(done["height"].values, axis=0))) < 1e-21
    assert "phase_zero" not in done.attrs and done["x"].attrs == {"units": "m"}
    assert float(both["phase"].median()) != 0  # the image given is as it was


def test_a_line_unlike_both_neighbours_is_flagged_and_replaced_but_a_step_of_the_tip_is_not() -> None:
    one = grains()
    one["height"] = one["height"] - 2e-9 * (one["phase"] > -17)  # else medians of rows jump from material to material
    one["phase"][60:] += 10.0  # the tip changed
    good = one["phase"].values.copy()
    one["phase"][31] += 15.0
    done = pm.level(one, lines="replace")
    assert np.flatnonzero(done["outlier_line"]).tolist() == [31]
    expected = (good[30] + good[32]) / 2 - np.median(one["phase"].values)
    assert done["phase"].values[31] == pytest.approx(expected)
    kept = pm.level(one)
    assert kept["outlier_line"].equals(done["outlier_line"])
    assert kept["phase"].values[31] == pytest.approx(one["phase"].values[31] - np.median(one["phase"].values))


# Registration


@needs_skimage
@pytest.mark.parametrize(("down", "right"), [(0, 7), (-3, 4)])
def test_a_known_shift_is_found_though_the_images_are_noisy_and_tilted(down: int, right: int) -> None:
    rng = np.random.default_rng(3)
    fixed, moving = moved(grains(), down, right)
    moving = moving.assign(
        height=moving["height"] + 0.3 * moving["x"] + 0.1e-9 * rng.normal(size=moving["height"].shape)
    )
    found = pm.register(fixed, moving)
    # to a tenth of a pixel, and the edges, which only one image shows, pull it by as much again
    assert found.accepted and np.array(found.shift) / PITCH == pytest.approx([down, right], abs=0.25)
    # a phase of 20 degrees' contrast, of which the shift is known
    assert found.after > 0.9 > found.before + 0.2 and found.phase_after > 0.95 > found.phase_before
    assert pm.register(fixed, moving, limit=2 * PITCH).accepted is False
    assert "longer than the limit of 8 nm" in pm.register(fixed, moving, limit=2 * PITCH).reason


@needs_skimage
def test_a_periodic_sample_is_left_alone_unless_the_limit_rules_the_other_periods_out() -> None:
    y, x = np.mgrid[:96, :104]
    pillars = np.cos(2 * np.pi * x / 13) * np.cos(2 * np.pi * y / 12)
    one = image(1e-9 * pillars, 10.0 * pillars)
    fixed, moving = moved(one, 0, 4)
    found = pm.register(fixed, moving)
    assert not found.accepted and found.reason.startswith("the height repeats itself after")
    assert found.apply(moving).identical(moving)
    # The pillars repeat after 8.8 pixels along the diagonal, of which twice the limit must be less.
    close = pm.register(fixed, moving, limit=4.2 * PITCH)
    assert close.accepted and np.array(close.shift) / PITCH == pytest.approx([0, 4], abs=0.25)


@needs_skimage
def test_an_image_whose_y_falls_lies_on_one_whose_y_rises_and_is_shifted_in_its_own_coordinates() -> None:
    def falling(one: xr.Dataset) -> xr.Dataset:
        return one.assign_coords(y=one["y"].values[::-1])

    fixed, moving = moved(grains(), down=3, right=2)
    wanted = pm.register(fixed, moving)
    for first, second in ((falling(fixed), moving), (fixed, falling(moving)), (falling(fixed), falling(moving))):
        assert pm.register(first, second).shift == pytest.approx(wanted.shift, abs=1e-15)
    placed = wanted.apply(falling(moving))
    assert float(placed["y"][0] - falling(moving)["y"][0]) == pytest.approx(-3 * PITCH)
    found = pm.compare(falling(fixed), fixed)
    assert value(found, "correlation") == pytest.approx(1.0) and float(np.diff(found["y"]).max()) < 0
    assert np.array_equal(found["measured"].values, pm.compare(fixed, fixed)["measured"].values)


@needs_skimage
def test_a_shift_that_the_phase_contradicts_or_that_hardly_helps_is_not_believed() -> None:
    one = grains()
    fixed, moving = moved(one, 0, 5)
    stays = moving.assign(phase=(("y", "x"), fixed["phase"].values))  # only the height lags, as behind a slow feedback
    assert pm.register(fixed, stays).reason.startswith("the phase contradicts: its correlation falls from 1.00 to")
    noise = [image(1e-9 * np.random.default_rng(s).normal(size=(64, 64)), blobs(64, 64)) for s in (1, 2)]
    assert pm.register(*noise, limit=31 * PITCH).accepted is False
    flat = one.assign(height=0 * one["height"])
    assert pm.register(one, flat).reason == "one height is flat, and tells no shift"
    assert pm.register(one, one).reason == "in place already"


def of_file(name: str, direction: str) -> xr.Dataset:
    spec = find_spec("NSFopen")
    assert spec is not None and spec.submodule_search_locations is not None
    path = Path(spec.submodule_search_locations[0], "example", name)
    return read_image(path, phase=f"Phase {direction}", height="Z-Axis")  # what the scanner was told


@pytest.mark.slow
@needs_reader
def test_trace_and_retrace_of_a_real_flake_are_brought_together() -> None:
    forward, backward = (of_file("Plotting_Data/MoS2.nid", direction) for direction in ("forward", "backward"))
    found = pm.compare(forward, backward)
    assert found["registered"] == 1
    # The scanner lags by 7 of 512 pixels along x, a row and a half of noise along y.
    pitch = float(forward["x"][1] - forward["x"][0])
    assert value(found, "shift_x") / pitch == pytest.approx(7, abs=0.3) and abs(value(found, "shift_y")) < pitch
    before, after = found["phase_correlation"].values
    assert before == pytest.approx(0.647, abs=0.002) and after > 0.9
    assert value(found, "explained") > 0.8 and value(found, "sign") == 1


@pytest.mark.slow
@needs_reader
def test_trace_and_retrace_of_a_real_grating_are_left_where_they_are() -> None:
    forward, backward = (of_file("Plane_Removal/grid.nid", direction) for direction in ("forward", "backward"))
    found = pm.compare(forward, backward)
    assert found["registered"] == 0 and value(found, "shift_x") == value(found, "shift_y") == 0
    assert found.attrs["registration"].startswith("the height repeats itself after")
    assert value(found, "correlation") == pytest.approx(0.872, abs=0.002)
    # Were the limit too short for another period, the phase would still not follow the height.
    near = pm.register(forward, backward, limit=100e-9)
    assert not near.accepted and "phase contradicts" in near.reason and near.phase_after < 0.5 < 0.99 < near.after


@needs_skimage
@pytest.mark.parametrize("shift", [(0.0, 3.4), (-2.7, 1.6)])
def test_a_shift_of_parts_of_a_pixel_is_found(shift: tuple[float, float]) -> None:
    from scipy.ndimage import fourier_shift

    rough = blobs(96, 100)  # periodic, so that moving it by its Fourier transform is exact
    spread = np.fft.ifft2(fourier_shift(np.fft.fft2(rough), shift)).real
    fixed, moving = (image(1e-9 * one, one)[{"y": slice(10, 80), "x": slice(10, 80)}] for one in (rough, spread))
    found = pm.register(fixed, moving)
    assert found.accepted
    # found to a tenth of a pixel; medians of rows, which each window has its own, pull it by as much again
    assert np.array(found.shift) / PITCH == pytest.approx(-np.array(shift), abs=0.25)


@needs_skimage
def test_a_shift_that_would_leave_hardly_anything_is_refused_in_words() -> None:
    rough = blobs(40, 40)
    one = image(1e-9 * rough, rough)
    found = pm.register(one.isel(y=slice(5, 13)), one.isel(y=slice(6, 14)))  # 8 rows, of which 7 are common
    assert not found.accepted and found.reason.endswith("leaves hardly any overlap of the images")


# One grid


def test_a_finer_image_is_averaged_and_a_coarser_one_interpolated() -> None:
    y, x = np.mgrid[:30, :36]
    fine = image(1e-9 * (x + 2 * y), 3.0 * x - y)
    coarse = fine.coarsen(y=3, x=3).mean()
    onto_coarse = common_grid(coarse, fine)[1]
    assert onto_coarse["phase"].values == pytest.approx(coarse["phase"].values)
    cropped, onto_fine = common_grid(fine, coarse)
    assert onto_fine["height"].values == pytest.approx(cropped["height"].values)  # a plane is interpolated exactly
    assert dict(cropped.sizes) == {"y": 28, "x": 34}  # between the centres of the outermost coarse pixels


@needs_skimage
def test_images_of_different_pixels_are_compared_on_those_of_the_measured_one() -> None:
    fine = grains(96, 96)
    found = pm.compare(fine.coarsen(y=2, x=2).mean(), fine)
    assert dict(found[["measured"]].sizes) == {"y": 48, "x": 48}
    assert value(found, "rmse") < 1e-10 and value(found, "correlation") > 1 - 1e-12  # the mean of 2 x 2 pixels


# Scores


@needs_skimage
def test_identical_images_correlate_fully_and_leave_no_residual() -> None:
    one = grains()
    found = pm.compare(one, one)
    check("Variables of a comparison", found)
    for name in ("correlation", "ssim", "explained"):
        assert value(found, name) == pytest.approx(1, abs=1e-12)
    assert value(found, "rmse") == value(found, "wasserstein") == value(found, "offset") == 0
    assert (found["residual"] == 0).all() and found["registered"] == 0
    assert found["region_contrast"].values[0] == pytest.approx([0, 20], abs=0.5)


@needs_skimage
@pytest.mark.parametrize("sign", [1, -1])
def test_regions_that_are_found_are_numbered_by_area_as_those_of_a_series(sign: int) -> None:
    height, phase = 1e-9 * blobs(32, 40), np.full((32, 40), 40.0)
    phase[:, :10] = 10.0
    one = image(height, sign * phase).assign_attrs(phase_sign=sign)
    found = pm.compare(one, image(height, phase), limit=0)
    np.testing.assert_array_equal(found["label"], phase < 20)
    assert found["region_share"].values.tolist() == [0.75, 0.25]


@needs_skimage
@pytest.mark.parametrize(("sign", "offset"), [(1, -35.0), (-1, 62.0)])
def test_offset_and_sign_of_the_instrument_are_recovered(sign: int, offset: float) -> None:
    one = grains()
    recorded = one.assign(phase=offset + sign * one["phase"]).assign_attrs(phase_zero=offset)
    free = pm.compare(recorded, one)
    assert value(free, "sign") == sign and value(free, "offset") == pytest.approx(offset)
    assert value(free, "rmse") < 1e-12
    assert np.abs(free["measured"] - one["phase"]).max() < 1e-12
    warmer = one.assign(phase=one["phase"] + 4.0)  # a simulation that is 4 degrees off
    assert value(pm.compare(recorded, warmer, offset="free"), "rmse") < 1e-12
    for fixed in (pm.compare(recorded, warmer, offset="fixed"), pm.compare(recorded, warmer, offset=offset, sign=sign)):
        assert value(fixed, "offset") == offset and value(fixed, "rmse") == pytest.approx(4)
        assert value(fixed, "sign") == sign and value(fixed, "correlation") == pytest.approx(1)


@needs_skimage
def test_the_residual_is_consistent_with_every_number() -> None:
    rng = np.random.default_rng(4)
    one = grains()
    other = one.assign(phase=0.8 * one["phase"] + 0.4 * rng.normal(size=one["phase"].shape))
    other["phase"][5, 6:9] = np.nan
    found = pm.compare(one, other)
    residual = found["residual"].values
    assert np.array_equal(residual, found["measured"].values - found["simulated"].values, equal_nan=True)
    assert (np.isnan(residual) == (found["label"].values < 0)).all() and np.isnan(residual).sum() == 3
    assert value(found, "rmse") == pytest.approx(math.sqrt(np.nanmean(residual**2)))
    known = np.isfinite(residual)
    measured = one["phase"].values[known]
    assert value(found, "explained") == pytest.approx(1 - residual[known].var() / measured.var())
    expected = np.corrcoef(measured, other["phase"].values[known])[0, 1]
    assert value(found, "correlation") == pytest.approx(expected)
    assert np.nanmean(residual) == pytest.approx(0, abs=1e-12)  # what a free offset means
    means = found["region_mean"].values
    assert means[2] == pytest.approx(means[0] - means[1])
    assert means[0] @ found["region_share"].values == pytest.approx(measured.mean() - value(found, "offset"))
    assert found["region_share"].values.sum() == pytest.approx(1)


@needs_skimage
def test_crosstalk_is_all_of_a_phase_that_is_linear_in_slope_or_amplitude_error() -> None:
    rng = np.random.default_rng(5)
    height, noise = 5e-9 * blobs(64, 70), rng.normal(size=(64, 70))
    levelled = pm.level(image(height, noise))["height"].values
    slope = np.gradient(levelled, PITCH, axis=1)
    error = 1e-10 * rng.normal(size=height.shape)
    material = image(height, noise, amplitude_error=error)
    found = pm.compare(material.assign(phase=(("y", "x"), 7.0 * slope)), material, limit=0)
    # noise of 4480 pixels shares some 1/4480 with anything, ten times that once in 600
    assert found["crosstalk"].sel(map="measured").values == pytest.approx([1, 0, 1], abs=5e-3)
    assert found["crosstalk"].sel(map="simulated").values == pytest.approx([0, 0, 0], abs=5e-3)
    mixed = material.assign(phase=(("y", "x"), slope / slope.std() + error / error.std()))
    shares = pm.compare(mixed, material, limit=0)["crosstalk"].sel(map="measured").values
    assert shares == pytest.approx([0.5, 0.5, 1], abs=0.02)  # uncorrelated causes of equal size
    without = pm.compare(mixed.drop_vars("amplitude_error"), material.drop_vars("amplitude_error"), limit=0)
    assert np.isnan(without["crosstalk"].sel(cause=["amplitude error", "both"])).all()


@needs_skimage
def test_contrast_is_that_of_the_materials_though_an_edge_is_misplaced() -> None:
    ground, x = blobs(80, 100), np.arange(100)[None, :]
    phase, late = np.where(x < 50, -27.0, -7.0), np.where(x < 56, -26.0, -10.0)
    found = pm.compare(*(image(1e-9 * ground, one + 0 * ground) for one in (phase, late)))
    assert found["region_contrast"].values[:2, 1] == pytest.approx([20, 16])
    assert float(found["region_mean"].sel(map="simulated", region=1)) < -11  # 12 % of it are the other material


@needs_skimage
def test_given_labels_are_the_regions_and_none_is_one_region() -> None:
    one = grains()
    labels = np.full(one["phase"].shape, -1)
    labels[:, :40], labels[:, 60:] = 3, 8
    found = pm.compare(one, one.assign(phase=0.5 * one["phase"]), regions=labels)
    means = [one["phase"].values[:, part].mean() for part in (slice(40), slice(60, None))]
    simulated = found["region_mean"].sel(map="simulated").values
    assert simulated == pytest.approx(0.5 * np.array(means))
    assert (found["label"].values[:, 45] == -1).all() and (found["label"].values[:, 70] == 1).all()
    assert pm.compare(one, one, regions=None).sizes["region"] == 1


@needs_skimage
def test_directions_are_compared_each_with_its_own_or_with_one_another() -> None:
    one, other = grains(seed=1), grains(seed=9)
    both = xr.concat([one, other], xr.Variable("direction", ["trace", "retrace"]))
    assert value(pm.compare(both, one), "rmse") == 0
    assert value(pm.compare(both, other, direction="retrace"), "rmse") == 0
    assert value(pm.compare(both, both, direction=("trace", "retrace")), "correlation") < 0.5


@needs_skimage
def test_scores_are_those_of_the_libraries_by_their_own_formulas() -> None:
    from scipy.stats import linregress, wasserstein_distance
    from skimage.metrics import structural_similarity

    one, other = grains(), grains(seed=4)
    found = pm.compare(one, other, limit=0, sign=1, regions=None)
    a, b = one["phase"].values, other["phase"].values
    b = b + (a.mean() - b.mean())
    low, high = np.percentile([a, b], [0.5, 99.5])
    each = structural_similarity(a - low, b - low, win_size=7, data_range=high - low, full=True)[1]
    assert value(found, "ssim") == pytest.approx(each[3:-3, 3:-3].mean())
    elsewhere = other.assign(phase=other["phase"] + 80)  # another zero is no other image
    assert value(pm.compare(one, elsewhere, limit=0, sign=1), "ssim") == pytest.approx(value(found, "ssim"))
    assert value(found, "wasserstein") == pytest.approx(wasserstein_distance(a.ravel(), b.ravel()))
    assert value(found, "rmse") == pytest.approx(math.sqrt(np.mean((a - b) ** 2)))
    slope = np.gradient(pm.level(one)["height"].values, PITCH, axis=1)
    r = linregress(slope.ravel(), a.ravel()).rvalue
    assert float(found["crosstalk"].sel(map="measured", cause="slope")) == pytest.approx(r**2)
    for nearby in (-0.5, 0.5):
        moved_offset = value(found, "offset") + nearby
        assert value(pm.compare(one, other, limit=0, sign=1, offset=moved_offset), "rmse") > value(found, "rmse")


@needs_skimage
def test_a_sign_is_never_turned_in_silence() -> None:
    one = grains()
    other = one.assign(phase=20.0 - one["phase"])
    fitted = pm.compare(other, one, limit=0)
    assert value(fitted, "sign") == -1 and fitted.attrs["sign_from"] == "fitted"
    assert verdict_of(fitted).startswith("The sign of the measured phase was TURNED")
    assert "is -1.00." in verdict_of(fitted)
    kept = pm.compare(other.assign_attrs(phase_sign=1), one.assign_attrs(phase_sign=1), limit=0)
    assert value(kept, "sign") == 1 and value(kept, "correlation") == pytest.approx(-1)
    assert verdict_of(kept).startswith("The simulated image explains nothing")
    known = pm.compare(other.assign_attrs(phase_sign=-1), one.assign_attrs(phase_sign=1), limit=0)
    assert "the other way round, as its file records" in verdict_of(known)
    assert "TURNED" not in verdict_of(pm.compare(one, one, limit=0))


def test_a_recorded_zero_is_used_unless_another_is_asked_for() -> None:
    one = grains()
    recorded = one.assign(phase=one["phase"] + 62.0).assign_attrs(phase_zero=60.0)
    one = one.assign_attrs(phase_zero=0.0)
    used, free = pm.compare(recorded, one, limit=0), pm.compare(recorded, one, limit=0, offset="free")
    assert value(used, "offset") == 60.0 and value(used, "rmse") == pytest.approx(2.0)
    assert value(free, "offset") == pytest.approx(62.0) and used.attrs["offset_from"] == "recorded"
    assert "With the zero that is recorded, the measured phase is +2° from the simulated one" in verdict_of(used)
    assert "With the zero" not in verdict_of(free)


def test_what_only_one_of_two_images_records_is_fitted_not_assumed_of_the_other() -> None:
    one = grains()
    recorded = one.assign(phase=62.0 - one["phase"]).assign_attrs(phase_zero=60.0, phase_sign=-1)
    for known, unknown, sign in ((recorded, one, -1), (one, recorded, -1)):
        found = pm.compare(known, unknown, limit=0)
        assert (found.attrs["offset_from"], found.attrs["sign_from"]) == ("fitted", "fitted")
        assert value(found, "sign") == sign and value(found, "rmse") < 1e-10
        assert "as its file records" not in verdict_of(found) and "With the zero" not in verdict_of(found)
    with pytest.raises(InputError, match="phase_zero of simulated is not recorded"):
        pm.compare(recorded, pm.level(one), limit=0, offset="fixed")


@pytest.mark.parametrize(("low", "offset"), [(-180.0, 180.0), (0.0, 360.0)])
def test_a_phase_that_runs_over_the_end_of_its_range_is_compared_as_if_it_did_not(low: float, offset: float) -> None:
    one = grains()
    recorded = one.assign(phase=(one["phase"] + offset + 20 - low) % 360 + low)
    assert np.ptp(recorded["phase"].values) > 300
    found = pm.compare(recorded, one)
    assert value(found, "rmse") < 1e-10 and value(found, "sign") == 1
    assert np.ptp(pm.level(recorded)["phase"].values) == pytest.approx(np.ptp(one["phase"].values))


@needs_skimage
def test_a_recorded_zero_means_the_same_a_turn_away() -> None:
    one = grains()
    recorded = one.assign(phase=one["phase"] + 350).assign_attrs(phase_zero=-10.0)
    found = pm.compare(recorded, one, offset="fixed")
    assert (value(found, "offset"), value(found, "sign")) == (350.0, 1) and value(found, "rmse") < 1e-10


@needs_skimage
def test_the_zero_of_a_simulation_off_resonance_is_known_from_memory_as_from_a_file(tmp_path: Path) -> None:
    scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(20e-9, 299.7e3))
    rough = 0.2e-9 * blobs(16, 16)
    soft = {n: pm.Material(1e9 * n, adhesion=0.05) for n in (1, 2)}
    surface = pm.Surface.from_labels(1 + (rough > 0), soft, pixel_size=PITCH, topography=rough)
    simulated = pm.simulate(surface, scope, setpoint=0.7, solver="averaging")
    assert "phase_zero" not in simulated.attrs
    # 90 degrees less the lag of the free lever at 299.7 kHz
    zero = 90 - math.degrees(math.atan2(0.999 / 400, 1 - 0.999**2))
    recorded = (
        simulated.drop_attrs(deep=False).assign(phase=simulated["phase"] + 25 - zero).assign_attrs(phase_zero=25.0)
    )
    save(simulated, tmp_path / "simulated.nc")
    for known in (simulated, read_image(tmp_path / "simulated.nc")):
        found = pm.compare(recorded, known, offset="fixed", limit=0, regions=None)
        assert value(found, "offset") == pytest.approx(25 - zero) and value(found, "rmse") < 1e-9
    save(pm.level(simulated), tmp_path / "levelled.nc")
    assert "phase_zero" not in read_image(tmp_path / "levelled.nc").attrs  # of the phase before it was levelled


@needs_skimage
def test_a_phase_that_does_not_vary_has_no_correlation_and_the_words_say_so() -> None:
    for number in (0.1, 0.3, -17.3, 61.7):  # of which means are off by rounding
        for size in (100, 1001, 9600):
            assert math.isnan(correlation_of(np.full(size, number), np.full(size, 1.1 * number)))
    flat = grains().assign(phase=0.3 + 0 * grains()["phase"])
    found = pm.compare(flat, flat, regions=None)
    assert all(math.isnan(value(found, name)) for name in ("correlation", "ssim", "explained"))
    said = dict(lines_of(found))
    assert said["phases"] == "no correlation, for one does not vary, no SSIM"
    assert "nan" not in " ".join(said.values()) + verdict_of(found)


@needs_skimage
def test_infinite_pixels_are_missing_ones() -> None:
    one, other = grains(), grains()
    other["phase"][20, 30:34] = np.inf
    other["phase"][21, 30] = -np.inf
    found = pm.compare(other, one)
    assert (found["label"] < 0).sum() == 5 and value(found, "failed_lines") == 0 and value(found, "rmse") < 1e-12


# Bad inputs


@needs_skimage
def test_bad_inputs_are_refused_in_one_sentence() -> None:
    one = grains(40, 48)
    both = one.expand_dims(direction=["trace"])
    nothing = one.assign(phase=np.nan * one["phase"])
    elsewhere = one.assign(phase=one["phase"].where(one["x"] < 20 * PITCH))
    for word, call in {
        "size of simulated is 80 x 160 nm; allowed: that of measured, 192 x 160 nm, within 5 %": lambda: pm.compare(
            one, one.isel(x=slice(20))
        ),
        "what measured holds is 'height'; allowed: an image with height and phase": lambda: pm.compare(
            one[["height"]], one
        ),
        "phase of simulated is NaN everywhere": lambda: pm.compare(one, nothing),
        "pixels with a phase in both images is 0": lambda: pm.compare(
            elsewhere, one.assign(phase=one["phase"].where(one["x"] > 21 * PITCH)), limit=0
        ),
        "direction of measured is 'retrace'; allowed: trace": lambda: pm.compare(both, one, direction="retrace"),
        "direction is 'trace'; allowed: None, for neither": lambda: pm.compare(one, one, direction="trace"),
        "direction of simulated is 'trace'; allowed: None": lambda: pm.compare(both, one, direction=("trace", "trace")),
        "phase_zero of measured is not recorded": lambda: pm.compare(one, one, offset="fixed"),
        "offset is 'none'; allowed: 'recorded', 'free', 'fixed' or a number": lambda: pm.compare(
            one, one, offset="none"
        ),
        "sign is 2; allowed: 'recorded', 'free', 1 or -1": lambda: pm.compare(one, one, sign=2),
        "number of materials is 7; allowed: 2 to 4": lambda: pm.compare(one, one, regions=7),
        "limit is -1.0": lambda: pm.register(one, one, limit=-1.0),
        "height is 'rowwise'; allowed: one of rows, plane": lambda: pm.level(one, height="rowwise"),
        "shape of mask is ": lambda: pm.level(one, mask=np.zeros((3, 3), bool)),
        "number of pixels to level by is 0": lambda: pm.level(one, mask=np.ones((40, 48), bool)),
        "coordinate x of measured is uneven or falling": lambda: pm.compare(one.assign_coords(x=one["x"] ** 1.5), one),
        "coordinate y of measured is None; allowed: places of": lambda: pm.compare(one.drop_vars("y"), one),
        "number of pixels along x of simulated is 7; allowed: 8": lambda: pm.compare(one, one.isel(x=slice(7))),
        "units of phase of simulated is 'rad'; allowed: degree": lambda: pm.compare(
            one, one.assign(phase=one["phase"].assign_attrs(units="rad"))
        ),
        "direction is 3; allowed: one name, or one for each": lambda: pm.compare(one, one, direction=3),
        "names is ('a',); allowed: two names": lambda: pm.compare(one, one, names=("a",)),
        "names is 'ab'; allowed: two names": lambda: pm.compare(one, one, names="ab"),
        "sign is True; allowed: 'recorded', 'free', 1 or -1": lambda: pm.compare(one, one, sign=True),
        "number of different phases is 1; allowed: enough to tell 2 materials apart": lambda: pm.compare(
            one.assign(phase=0 * one["phase"]), one
        ),
        "allowed: what phasemap.compare returned": lambda: pm.plot.comparison(one),
    }.items():
        with pytest.raises(InputError) as raised:
            call()
        assert word in str(raised.value)
        assert "\n" not in str(raised.value)


def test_what_to_install_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    for name in ("skimage", "skimage.registration"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(PhasemapError, match=r"registering images needs 'skimage': run pip install .*\[compare\]"):
        pm.register(grains(), grains())


# The page and the command


@needs_skimage
def test_the_first_line_names_what_differs() -> None:
    from scipy.ndimage import gaussian_filter

    one = grains()
    phase = one["phase"] - float(one["phase"].median())

    def differs(other: xr.DataArray, **options: Any) -> str:
        images = one.assign(phase=phase + 20.0), one.assign(phase=other)
        return dict(lines_of(pm.compare(*images, limit=0, **options)))["differ in"]

    held: dict[str, Any] = {"offset": 0.0, "sign": 1}
    assert differs(phase + 20.0, **held) == "neither regime, sign, zero, contrast nor resolution"
    assert differs(phase + 60.0, **held) == "zero, by -40°"
    assert differs(phase - 80.0, **held) == "regime; zero, by +100°"
    assert differs(0.4 * phase).startswith("contrast of region 1, measured")
    assert differs(-phase, sign="free").startswith("sign of the phase")
    coarse = phase.copy(data=gaussian_filter(phase.values, 6.0))
    assert "resolution, details of" in differs(coarse)


@needs_skimage
def test_images_of_two_regimes_are_said_to_be_and_the_residual_shows_what_varies() -> None:
    measured = grains()
    simulated = measured.assign(phase=measured["phase"] * 0.5 + 60.0)
    found = pm.compare(measured, simulated, offset=0.0, sign=1, limit=0)
    said = verdict_of(found)
    assert (
        "The measured phase is attractive in 100 % of the pixels, the simulated one repulsive in 100 % of the" in said
    )
    page = pm.plot.comparison(found)
    assert any(one.get_text().startswith("The images differ in regime; zero, by") for one in page.texts)
    residual = page.axes[2].images[0]
    shown = residual.norm(residual.get_array())
    assert 0.0 < np.min(shown) < 0.45 and 0.55 < np.max(shown) < 1.0  # nothing at the ends of the scale, nor one colour
    assert residual.norm.vmin + residual.norm.vmax == pytest.approx(2 * float(found["residual"].mean()))
    free = pm.compare(measured, simulated, sign=1, limit=0)
    assert "attractive" not in verdict_of(free)  # where the zero is fitted nobody knows


@needs_skimage
def test_a_residual_larger_than_both_phases_is_within_its_scale() -> None:
    one = grains()
    phase = one["phase"] - float(one["phase"].mean())
    found = pm.compare(one.assign(phase=phase), one.assign(phase=-phase), offset=0.0, sign=1, limit=0)
    residual = pm.plot.comparison(found).axes[2].images[0]
    outside = (np.abs(residual.get_array()) > residual.norm.vmax).mean()
    assert residual.norm.vmin == -residual.norm.vmax and outside <= 0.01  # the percentiles that are shown


@needs_skimage
def test_the_page_shows_both_phases_on_one_scale_and_a_degree_as_wide_in_the_residual() -> None:
    one = grains()
    found = pm.compare(one, one.assign(phase=one["phase"] * 0.7), names=("day 1", "day 2"))
    figure = pm.plot.plot(found)
    maps = figure.axes[:3]
    assert [axes.get_title(loc="left") for axes in maps] == [
        "day 1 phase", "day 2 phase", "residual: day 1 minus day 2",
    ]  # fmt: skip
    limits = [axes.images[0].get_clim() for axes in maps]
    assert limits[0] == limits[1] and limits[2][0] == -limits[2][1]
    assert np.diff(limits[2]) == pytest.approx(np.diff(limits[0]))
    assert np.array_equal(maps[2].images[0].get_array(), found["residual"])
    lines = next(axes for axes in figure.axes if axes.get_ylabel() == "phase (degrees)" and axes.lines).lines
    assert np.array_equal(lines[0].get_ydata(), found["measured"].isel(y=48))
    words = " ".join(text.get_text() for text in figure.texts).replace("\n", " ")
    assert "It has 70 % of the contrast between the regions." in words and "correlation 1.000" in words
    canvas = figure.canvas
    canvas.draw()
    inside = figure.bbox.padded(1)
    for text in figure.texts:  # nothing runs off the page
        assert inside.fully_containsx(text.get_window_extent().x1)


@needs_skimage
@pytest.mark.parametrize("shape", [(16, 200), (200, 16)])
def test_a_page_of_a_narrow_image_with_long_names_and_missing_rows_has_room_for_all(shape: tuple[int, int]) -> None:
    one = grains(*shape)
    rows = slice(shape[0] // 2, shape[0] // 2 + 2)  # the middle, of which the page shows lines
    one["phase"][rows] = one["height"][rows] = np.nan
    long = "a name that somebody gave with much love for detail"
    one.attrs["title"] = f"{long}, also of the file from which it was read.nid"
    figure = pm.plot.plot(pm.compare(one, one, names=(long, long)))
    figure.canvas.draw()
    boxes = [text.get_window_extent() for axes in figure.axes[:3] for text in (axes.title, axes._left_title)]
    boxes = sorted((box for box in boxes if box.width), key=lambda box: box.x0)
    assert len(boxes) == 3 and all(a.x1 < b.x0 for a, b in pairwise(boxes))
    assert all(figure.bbox.padded(1).fully_containsx(box.x1) for box in boxes)
    (source,) = (text for text in figure.texts if "not drawn to scale" in text.get_text())
    assert figure.bbox.padded(1).fully_containsx(source.get_window_extent().x1)
    lines = next(axes for axes in figure.axes if axes.get_ylabel() == "phase (degrees)" and axes.lines).lines
    assert np.isfinite(lines[0].get_ydata()).any()


@needs_reader
def test_the_command_compares_both_directions_of_a_vendors_file(capsys: pytest.CaptureFixture[str]) -> None:
    spec = find_spec("NSFopen")
    assert spec is not None and spec.submodule_search_locations is not None
    path = str(Path(spec.submodule_search_locations[0], "example", "Plane_Removal/grid.nid"))
    assert main(["compare", path, path, "--direction", "trace,retrace"]) == 0
    assert "correlation 0.872" in capsys.readouterr().out
    without = path.replace("grid", "circles")
    assert main(["compare", without, path]) == 2
    assert "there is no phase channel; it holds 'Topography forward'" in capsys.readouterr().err


@needs_skimage
def test_the_command_compares_writes_draws_and_says(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    one = grains()
    recorded = one.assign(phase=62.0 - one["phase"]).assign_attrs(phase_zero=62.0)
    measured, simulated, page, result = (tmp_path / name for name in ("m.nc", "s.nc", "page.png", "result.nc"))
    save(recorded, measured)
    save(one, simulated)
    files = [str(measured), str(simulated)]
    assert main(["compare", *files, "-o", str(result), "--plot", str(page), "--offset", "fixed"]) == 0
    said = capsys.readouterr().out
    assert "zero of the measured phase: 62.00°; the other sign" in said
    assert "explains 100 % of the variance" in said and page.stat().st_size > 10_000
    found = load(result)
    direct = pm.compare(pm.read_image(measured), pm.read_image(simulated), offset="fixed")
    xr.testing.assert_identical(found.drop_attrs(), direct.drop_attrs())
    assert found.attrs["measured_source"] == "m.nc"
    assert main(["compare", *files, "--plot", str(page)]) == 2 and "exists already" in capsys.readouterr().err
    both = ["-o", str(tmp_path / "one.png"), "--plot", str(tmp_path / "one.png")]
    assert main(["compare", *files, *both]) == 2 and "another file than that of -o" in capsys.readouterr().err
    for bad, why in {
        "--offset=none": "fixed, or a number",
        "--names=a": "two names",
        "--row=3": "none without --plot",
    }.items():
        assert main(["compare", *files, bad]) == 2
        assert why in capsys.readouterr().err
