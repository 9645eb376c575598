"""The picture of an image."""

from __future__ import annotations

import json
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

import phasemap as pm
from phasemap._shared.errors import FileError, InputError
from phasemap.cli import main
from phasemap.experiment.described import describe
from phasemap.plot import plot
from phasemap.plot.colours import FAILED
from phasemap.plot.images import colours_for_all
from phasemap.plot.page import Page
from phasemap.results.descriptions import describe_failures, describe_flags, describe_irregular
from phasemap.scenes.scene import load_scene


def image(
    phase_low: float = 20.0, phase_high: float = 35.0, failed: int = 0, shape: tuple[int, int] = (48, 64)
) -> xr.Dataset:
    """An image of two materials with the columns that `simulate` gives."""
    hard = np.add.outer(np.arange(shape[0]), np.arange(shape[1])) // 12 % 2 == 1
    status = np.zeros(shape, np.int8)
    status.flat[:failed] = 1
    phase = np.where(status == 0, np.where(hard, phase_high, phase_low), np.nan)
    height = np.where(status == 0, 2e-9 * hard, np.nan)
    solver = {"flag_values": np.array([0, 1], np.int8), "flag_meanings": "averaging orbit"}
    return xr.Dataset(
        {
            "height": (("y", "x"), height, {"units": "m"}),
            "phase": (("y", "x"), phase, {"units": "degree"}),
            "status": (("y", "x"), status),
            "solver": (("y", "x"), hard.astype(np.int8), solver),
        },
        {"y": 4e-9 * (np.arange(shape[0]) + 0.5), "x": 4e-9 * (np.arange(shape[1]) + 0.5)},
        {"configuration": '{"setpoint": 0.7}'},
    )


def words(figure: Figure) -> str:
    owners: list[Any] = [figure, *figure.axes]
    return " | ".join(text.get_text() for owner in owners for text in owner.texts)


def test_height_and_phase_have_units_scale_bars_and_a_title() -> None:
    figure = plot(image())
    labels = {axes.get_ylabel() or axes.get_xlabel() for axes in figure.axes}
    assert {"height (nm)", "phase (degrees)"} <= labels
    said = words(figure)
    assert said.count("50 nm") == 2  # of 256 nm
    assert (
        "setpoint 0.7" in said
        and "solved by averaging (first order) 50 %, orbit (exact) 50 %" in said
        and "64 × 48 pixels" in said
    )


def test_row_0_is_drawn_at_the_top() -> None:
    picture = plot(image()).axes[0]
    assert picture.images[0].get_extent() == pytest.approx([0, 256e-9, 192e-9, 0])
    assert picture.get_ylim() == pytest.approx((192e-9, 0))


def test_pixels_that_are_not_square_keep_their_proportions() -> None:
    wide = image(shape=(32, 64)).assign_coords(y=8e-9 * (np.arange(32) + 0.5))
    box = plot(wide).axes[0].get_window_extent()
    assert box.width == pytest.approx(box.height, rel=1e-6)


@pytest.mark.parametrize(("low", "high"), [(20, 35), (-35, -20), (-30, 38), (-0.5, 38)])
def test_the_phase_has_the_same_colours_whatever_its_sign_and_0_is_marked(low: float, high: float) -> None:
    figure = plot(image(low, high))
    assert figure.axes[3].images[0].get_cmap().name == "cividis"
    assert any(list(line.get_ydata()) == [0, 0] for line in figure.axes[4].lines) == (low < 0 < high)


def test_limits_and_colours_may_be_given_by_name_and_with_units(tmp_path: Path) -> None:
    figure = plot(image(), vmin={"phase": -30, "height": "0 nm"}, vmax={"phase": 60, "height": "5 nm"}, cmap="gray")
    shown = [figure.axes[i].images[0] for i in (0, 3)]
    assert [one.get_clim() for one in shown] == [pytest.approx((0, 5)), (-30, 60)]
    assert [one.get_cmap().name for one in shown] == ["afmhot", "gray"]
    image().to_netcdf(tmp_path / "image.nc")
    command = ["plot", str(tmp_path / "image.nc"), "--vmin", "phase=-30", "--vmax", "60 degrees"]
    assert main([*command, "--cmap", "height=gray"]) == 0


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"vmin": 50.0, "vmax": 20.0}, "vmin of phase is 50.0; allowed: a number below vmax, which is 20"),
        ({"cmap": "jett"}, "a colour map of matplotlib"),
        ({"vmax": {"phas": 3}}, "Did you mean 'phase'"),
        ({"vmin": "3 nm"}, "an angle such as"),
    ],
)
def test_limits_that_cannot_be_are_refused(given: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        plot(image(), **given)


def test_one_variable_may_be_drawn_and_what_is_no_image_is_named() -> None:
    assert [axes.get_title(loc="left") for axes in plot(image().phase).axes if axes.images] == ["Phase"]
    with pytest.raises(InputError, match=r"ds is of type ndarray; allowed: an xarray.Dataset or an xarray.DataArray"):
        plot(image().phase.values)  # type: ignore[arg-type]


def test_a_notebook_shows_the_picture() -> None:
    assert plot(image())._repr_png_()[1:4] == b"PNG"


def test_images_at_several_setpoints_take_a_row_each() -> None:
    ds = xr.concat([image(20, 35), image(25, 30)], xr.Variable("setpoint", [0.8, 0.6]))
    titles = [axes.get_title(loc="left") for axes in plot(ds).axes]
    assert [title for title in titles if title] == [
        f"{name}, setpoint {value}" for value in (0.8, 0.6) for name in ("Height", "Phase")
    ]


@pytest.mark.parametrize("tilt", [0.0, 1e-9])
def test_a_map_that_varies_by_rounding_only_is_drawn_as_flat(tilt: float) -> None:
    ds = image()
    noise = 1 + 1e-15 * np.random.default_rng(1).normal(size=ds["phase"].shape)
    flat = ds.assign(height=ds["height"].copy(data=(3e-7 + tilt * np.arange(64)) * noise))
    flat["dissipation"] = ds["phase"].copy(data=2.0 * noise).assign_attrs(units="eV")
    figure = plot(flat.assign_attrs(channels="{}"), variables=["height", "dissipation"])
    limits = [axes.images[0].get_clim() for axes in figure.axes if axes.images]
    np.testing.assert_allclose(limits, [(-500.0, 500.0), (1.0, 3.0)], rtol=1e-12)  # pm, eV


def test_a_measured_image_is_drawn_without_its_tilt() -> None:
    ds = image()
    tilted = ds.assign(height=ds["height"] + 1e-9 * np.arange(64))
    figure = plot(tilted.assign_attrs(channels="{}"))
    flat = figure.axes[0].images[0].get_array()
    assert figure.axes[1].get_ylabel() == "height, levelled (nm)" and np.ptp(np.asarray(flat).mean(axis=0)) < 2.5
    raw = plot(tilted).axes[0].images[0].get_array()
    assert np.ptp(np.asarray(raw).mean(axis=0)) > 60


def test_a_few_outliers_do_not_cost_the_contrast() -> None:
    ds = image()
    ds["phase"][3, 3] = 4000.0
    assert plot(ds).axes[3].images[0].norm.vmax == pytest.approx(35.6)  # 4 % of the range above the highest


def test_failed_pixels_are_marked_counted_and_given_advice() -> None:
    figure = plot(image(failed=6))
    for picture in (figure.axes[0], figure.axes[3]):
        overlay = picture.images[1]
        shown = overlay.get_array()
        assert shown is not None
        assert np.ma.count(shown) == 6
        assert overlay.get_cmap()(0.0)[:3] == pytest.approx([int(FAILED[i : i + 2], 16) / 255 for i in (1, 3, 5)])
    assert "6 of 3072 pixels (0.195 %): No stable orbit has the setpoint amplitude" in words(figure)
    assert len(plot(image()).axes[0].images) == 1


def shaken(where: tuple[Any, ...], shape: tuple[int, int] = (48, 64)) -> xr.Dataset:
    """An image whose motion is irregular there."""
    ds = image(shape=shape)
    motion = np.zeros(shape, np.int8)
    motion[where] = 1
    return ds.assign(motion=(("y", "x"), motion), phase_spread=(("y", "x"), 0.0214 * motion))


def dots(picture: Any) -> np.ndarray:
    """Row and column of each pixel with a dot, in the pixels of an image of 48 x 64."""
    (drawn,) = (line for line in picture.lines if line.get_gid() == "irregular")
    x, y = drawn.get_data()
    return np.stack([48 * (1 - np.asarray(y)), 64 * np.asarray(x)], axis=1).astype(int)


def test_irregular_pixels_are_counted_always_and_dotted_on_request() -> None:
    ds = shaken(np.s_[12:36, 8:40])
    said = "768 of 3072 pixels (25 %) irregular: mean amplitude and phase, spread up to 0.021 degrees"
    plain, marked = plot(ds), plot(ds, mark_irregular=True)
    assert said in words(plain) and f"○ {said}" in words(marked)
    assert not [line for axes in plain.axes for line in axes.lines if line.get_gid() == "irregular"]
    for picture in (marked.axes[0], marked.axes[3]):
        places = dots(picture)
        assert (ds["motion"].values[tuple(places.T)] == 1).all()
        corners = np.stack([places.min(axis=0), places.max(axis=0)])
        assert np.abs(corners - [(12, 8), (35, 39)]).max() <= 1  # from edge to edge: there is a dot every 1.5 pixels
        assert max(np.diff(np.unique(column)).max() for column in places.T) == 2
    assert "irregular" not in words(plot(shaken(np.s_[:0]), mark_irregular=True))


@pytest.mark.parametrize("place", [(0, 0), (47, 63), (20, 33), (21, 34)])
def test_a_single_irregular_pixel_has_its_dot(place: tuple[int, int]) -> None:
    assert np.unique(dots(plot(shaken(place), mark_irregular=True).axes[0]), axis=0).tolist() == [list(place)]


def test_marking_needs_to_know_the_motion() -> None:
    with pytest.raises(InputError, match="the dataset is without motion; allowed: an image with it"):
        plot(image(), mark_irregular=True)
    assert describe_irregular(image()) == []


def test_an_image_without_any_solution_is_still_drawn(tmp_path: Path) -> None:
    plot(image(failed=48 * 64), tmp_path / "nothing.png")
    assert "3072 of 3072 pixels (100 %)" in words(plot(image(failed=48 * 64)))


@pytest.mark.parametrize("shape", [(1, 1), (1, 64), (300, 2)])
def test_odd_shapes_are_drawn(shape: tuple[int, int], tmp_path: Path) -> None:
    assert plot(image(shape=shape), tmp_path / "odd.png").axes


def test_codes_are_refused_with_the_maps_that_can_be_drawn() -> None:
    with pytest.raises(InputError, match=r"status, a map of codes.*maps of numbers: .*phase"):
        plot(image(), variables=["status"])


def test_small_numbers_have_their_power_of_ten_in_the_label_and_many_pictures_go_below_one_another() -> None:
    ds = image()
    names = [f"bound_{i}" for i in range(9)]
    small = ds["phase"].assign_attrs(units="1") * 2e-4  # up to 0.007
    figure = plot(ds.assign({name: small.assign_attrs(units="1") for name in names}), variables=names)
    assert figure.axes[1].get_ylabel() == "bound 0 (10⁻³)"
    assert 6 < figure.axes[1].get_ylim()[1] < 10
    places = [axes.get_position() for axes in figure.axes if axes.images]
    assert len({round(place.y0, 6) for place in places}) == 3  # three rows of three
    assert figure.get_size_inches()[0] < 18


def test_trace_and_retrace_take_a_row_each_with_common_colours() -> None:
    both = xr.concat([image(20, 35), image(25, 30)], "direction").assign_coords(direction=["trace", "retrace"])
    figure = plot(both)
    assert len(figure.axes) == 12
    assert [figure.axes[i].get_title(loc="left") for i in (3, 9)] == ["Phase, trace", "Phase, retrace"]
    assert figure.axes[3].images[0].norm.vmax == figure.axes[9].images[0].norm.vmax


def test_a_picture_is_written_and_not_overwritten_unasked(tmp_path: Path) -> None:
    for name in ("image.png", "image.pdf", "image.svg"):
        plot(image(), tmp_path / name)
        assert (tmp_path / name).stat().st_size > 1000
    with pytest.raises(FileError, match="exists already"):
        plot(image(), tmp_path / "image.png")
    plot(image(), tmp_path / "image.png", overwrite=True)
    with pytest.raises(InputError, match=r"suffix is '\.bild'; allowed: one of .*\.pdf, .*\.png"):
        plot(image(), tmp_path / "image.bild")


def test_what_is_no_image_is_refused() -> None:
    with pytest.raises(InputError, match="number of pixels along x is 0; allowed: at least 1"):
        plot(image().isel(x=slice(0, 0)))
    with pytest.raises(InputError, match="variables is none; allowed: some of height, phase"):
        plot(image(), variables=[])
    with pytest.raises(InputError, match=r"the dataset is \['height'.*\]; allowed: an image with height and phase"):
        plot(image().drop_vars("phase"))
    with pytest.raises(InputError, match=r"dims of height is \('x',\); allowed: \('y', 'x'\)"):
        plot(image().isel(y=0))
    with pytest.raises(InputError, match=r"an image with a coordinate x \[m\]"):
        plot(image().drop_vars("x"))


def test_flags_and_failures_are_said_in_words() -> None:
    assert describe_flags(image()["solver"]) == "averaging 50 %, orbit 50 %"
    assert describe_failures(image()) == []
    assert describe_failures(image().drop_vars("status")) == []


@pytest.mark.slow
def test_drawing_does_not_import_pyplot() -> None:
    code = "import sys, phasemap.plot, matplotlib.figure; sys.exit('matplotlib.pyplot' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_scan_in_time_shows_its_amplitude_error_beside_height_and_phase() -> None:
    x, y = (("x", 4e-9 * np.arange(6), {"units": "m"}), ("y", 4e-9 * np.arange(4), {"units": "m"}))
    values = np.sin(np.arange(48.0)).reshape(2, 4, 6)
    dims = ("direction", "y", "x")
    data = {"height": (dims, 1e-9 * values), "phase": (dims, 20 * values), "amplitude_error": (dims, 3e-10 * values)}
    figure = plot(xr.Dataset(data, {"x": x, "y": y, "direction": ["trace", "retrace"]}))
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert "Amplitude error, retrace" in titles and len(figure.axes) == 18
    assert "amplitude error (pm)" in [axes.get_ylabel() for axes in figure.axes]


def _means(picture: np.ndarray) -> np.ndarray:
    """Mean colours of 32 x 32 parts: letters, which the version of a font changes, hardly count."""
    rows, columns = (np.linspace(0, size, 33).astype(int) for size in picture.shape[:2])
    cells = [picture[a:b, c:d, :3].mean(axis=(0, 1)) for a, b in pairwise(rows) for c, d in pairwise(columns)]
    return np.array(cells)


def test_the_pictures_that_the_pages_show_are_those_of_the_code_beside_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from matplotlib.pyplot import imread

    root = Path(__file__).parents[2]
    page = (root / "docs" / "tutorials" / "first-image.md").read_text(encoding="utf-8")
    code = [line[4:] for line in page.splitlines() if line.startswith((">>> ", "... "))]
    assert "](../../samples/first.png)" in page
    scene = load_scene(root / "samples" / "blend.toml")
    monkeypatch.chdir(tmp_path)
    exec("\n".join(code), {})
    plot(scene.simulate(), "blend.png")
    for name in ("first.png", "blend.png"):
        drawn, shown = imread(name), imread(root / "samples" / name)
        assert drawn.shape == shown.shape
        assert np.abs(_means(drawn) - _means(shown)).max() < 0.1, name  # a label that moves by a line: 0.05


def test_the_title_says_under_which_microscope() -> None:
    scope = '"cantilever": {"stiffness": 40.0, "resonance_frequency": 3e5, "quality_factor": 400.0}, '
    scope += '"tip": {"radius": 1e-8}, "drive": {"free_amplitude": 4e-8}'
    said = words(plot(image().assign_attrs(configuration=f'{{"setpoint": 0.7, "microscope": {{{scope}}}}}')))
    parts = ("lever 40 N/m", "300 kHz", "Q 400", "tip radius 10 nm", "free amplitude 40 nm")
    assert "   ·   ".join(parts) in said and "setpoint 0.7" in said


def test_the_title_of_a_measured_image_says_file_setpoint_and_what_was_recorded_of_the_lever() -> None:
    recorded = {
        "setpoint": 0.8,
        "stiffness": 40.0,
        "drive_frequency": 299.5e3,
        "free_amplitude": 4e-8,
        "line_rate": 1.5,
    }
    ds = image().drop_vars("solver").assign_attrs(source="at80.ibw", vendor_metadata="{}", **recorded)
    del ds.attrs["configuration"]
    said = words(plot(ds))
    assert "at80.ibw   ·   setpoint 0.8   ·   line rate 1.5 Hz   ·   64 × 48 pixels" in said
    assert "lever 40 N/m   ·   free amplitude 40 nm   ·   driven at 299.5 kHz" in said
    del ds.attrs["setpoint"]
    assert "at80.ibw   ·   setpoint 350 mV" in words(plot(ds.assign_attrs(setpoint_voltage=0.35)))


@pytest.mark.parametrize(("detection", "shown"), [("fm", ["Frequency shift"]), ("am", ["Amplitude", "Phase"])])
def test_an_image_of_two_modes_shows_the_second_as_it_is_detected(detection: str, shown: list[str]) -> None:
    scope = pm.Microscope(
        pm.Cantilever(40.0, 300e3, 400.0, modes=2), pm.Tip(1e-8), pm.Drive(4e-8, second=pm.Mode(detection=detection))
    )
    ds = image().assign_attrs(configuration=json.dumps({"microscope": describe(scope)}))
    more = {f"mode2_{name}": ds.phase for name in ("frequency_shift", "amplitude", "phase")}
    titles = [axes.get_title(loc="left") for axes in plot(ds.assign(more)).axes if axes.images]
    assert titles == ["Height", "Phase", *(f"{word} of mode 2" for word in shown)]


@pytest.mark.parametrize(
    ("limits", "extend"),
    [({}, "neither"), ({"vmin": 25}, "min"), ({"vmax": 30}, "max"), ({"vmin": 25, "vmax": 30}, "both")],
)
def test_a_colour_bar_is_pointed_where_values_are_beyond_it(limits: dict[str, float], extend: str) -> None:
    bars = [axes.images[0].colorbar for axes in plot(image(), **limits).axes if axes.images]
    assert [bar.extend for bar in bars] == ["neither", extend]


def test_images_in_one_command_share_their_colours(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    several = [image(20.0, 35.0), image(-10.0, 28.0).drop_vars("solver")]
    for ds, colours in zip(several, colours_for_all(several, None, False, {}), strict=True):
        norms = [axes.images[0].norm for axes in plot(ds, **colours).axes if axes.images]
        assert (norms[1].vmin, norms[1].vmax) == pytest.approx((-10 - 0.04 * 38, 35 + 0.04 * 15))
    for i, ds in enumerate(several):
        ds.to_netcdf(tmp_path / f"at{i}.nc")
    files = [str(tmp_path / f"at{i}.nc") for i in range(2)]
    assert main(["plot", *files]) == 0
    assert all((tmp_path / f"at{i}.png").is_file() for i in range(2))
    capsys.readouterr()
    assert main(["plot", *files, "-o", str(tmp_path / "one.png")]) == 2
    assert "-o is for one FILE: of several, each is drawn into FILE.png." in capsys.readouterr().err


@pytest.mark.parametrize(
    ("given", "low", "high"),
    [({}, 18.9, 36.1), ({"vmin": -30.0}, -30.0, 36.1), ({"vmax": {"height": "5 nm"}, "cmap": "gray"}, 18.9, 36.1)],
)
def test_limits_of_one_variable_leave_those_of_the_others_shared(
    given: dict[str, Any], low: float, high: float
) -> None:
    several = [image(20.0, 35.0), image(22.0, 28.0)]
    several[1] = several[1].assign(height=2 * several[1].height)
    own = colours_for_all(several, None, False, given)
    norms: list[list[Any]] = []
    for ds, colours in zip(several, own, strict=True):
        norms.append([axes.images[0].norm for axes in plot(ds, **colours).axes if axes.images])
    assert [(norm.vmin, norm.vmax) for norm in norms[0]] == [(norm.vmin, norm.vmax) for norm in norms[1]]
    assert (norms[0][1].vmin, norms[0][1].vmax) == pytest.approx((low, high), abs=0.6)
    assert norms[0][0].vmax == pytest.approx(5.0 if "vmax" in given else 4.08 + 0.08)


def test_measured_images_share_the_colours_of_all_that_is_drawn_of_them(tmp_path: Path) -> None:
    measured = image().assign_attrs(vendor_metadata="{}", configuration="{}", source="flake.nid")
    measured["amplitude_error"] = measured.phase.assign_attrs(units="V")
    several = [measured, measured.assign(phase=-measured.phase), measured.drop_vars("phase")]
    files = [str(tmp_path / f"at{i}.nc") for i in range(3)]
    for ds, file in zip(several, files, strict=True):
        ds.to_netcdf(file)
    assert main(["plot", *files, "--vmin", "amplitude_error=-90"]) == 0
    drawn = [axes.get_title(loc="left") for axes in plot(several[2]).axes if axes.images]
    assert drawn == ["Height", "Amplitude error"]


def test_an_image_without_any_value_is_not_green() -> None:
    figure = plot(image(failed=48 * 64))
    assert "no value in any pixel" in words(figure)
    assert to_hex(FAILED) not in {to_hex(axes.get_facecolor()) for axes in figure.axes}


def test_a_legend_goes_on_in_another_row_where_the_page_ends() -> None:
    keys = [Line2D([], [], label=f"a material with a long name {i}") for i in range(9)]
    page = Page(6.6, 2.0, keys=[keys], left=0.75)
    boxes = [one.get_window_extent(page.canvas.get_renderer()) for one in page.legends]
    assert len(boxes) > 1 and sum(len(one.get_texts()) for one in page.legends) == 9
    assert all(box.x1 < page.bbox.x1 for box in boxes)
    assert all(low.y1 <= high.y0 + 1 for high, low in pairwise(boxes))


def test_the_phase_can_be_drawn_as_the_lag_that_is_90_degrees_for_the_free_lever(tmp_path: Path) -> None:
    shown = [axes for axes in plot(image(-20.0, 35.0), lag=True).axes if axes.images][1].images[0].get_array()
    assert {round(float(value)) for value in np.unique(shown)} == {55, 110}
    figure = plot(image(-20.0, 35.0), lag=True)
    assert "phase lag (degrees)" in {axes.get_xlabel() for axes in figure.axes}
    bars = [line for axes in figure.axes for line in axes.lines if line.get_color() == "white"]
    assert [90.0, 90.0] in [list(line.get_ydata()) for line in bars]
    image().to_netcdf(tmp_path / "image.nc")
    assert main(["plot", str(tmp_path / "image.nc"), "--lag"]) == 0


def test_an_image_is_drawn_on_axes_of_ones_own() -> None:
    figure = Figure()
    left, right = figure.subplots(1, 2)
    assert plot(image(), ax=right) is figure and not left.images and right.images
    assert plot(image(), ax=[left, right]) is figure and left.images
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels.count("phase (degrees)") == 2 and labels.count("height (nm)") == 1
    with pytest.raises(InputError, match="ax is 1; allowed: 2 Axes, one for each of height, phase"):
        plot(image(), variables=["height", "phase"], ax=right)
    with pytest.raises(InputError, match=r"None where ax is given\..*Save the figure"):
        plot(image(), "picture.png", ax=right)
    both = xr.concat([image(), image()], xr.Variable("direction", ["trace", "retrace"]))
    with pytest.raises(InputError, match=r"several images, along direction.*Take one: image\.isel\(direction=0\)"):
        plot(both, ax=right)
