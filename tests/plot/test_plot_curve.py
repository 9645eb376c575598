"""The pictures of a sweep, and the files it is kept in."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import same_color
from matplotlib.figure import Figure

import phasemap as pm
from phasemap._shared.errors import FileError, InputError
from phasemap.io.netcdf import load, save
from phasemap.plot import curve, plot, trace
from phasemap.plot.sweep import COLOURS

SCOPE = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(16e-9))
STICKY = pm.Material(modulus=2e9, adhesion=0.1, damping=0.002)
PAPER = pm.Microscope(pm.Cantilever(40.0, 148.24e3, 250.0), pm.Tip(30e-9), pm.Drive(155e-9))
FILM = pm.Material(modulus=0.89e9, adhesion=0.37, damping=0.014)
SOFT = pm.Material(modulus=1e9, adhesion=0.05, damping=0.01)


def distance() -> xr.Dataset:
    return pm.sweep_distance(STICKY, SCOPE, np.linspace(30e-9, 9e-9, 18), samples=32)


def setpoint() -> xr.Dataset:
    return pm.sweep_setpoint(STICKY, SCOPE, np.linspace(0.95, 0.5, 12))


def frequency() -> xr.Dataset:
    return pm.sweep_frequency(FILM, PAPER, np.linspace(147.5e3, 149e3, 20), tip_offset=140e-9)


def modulus() -> xr.Dataset:
    strong = pm.Microscope(SCOPE.cantilever, SCOPE.tip, pm.Drive(20e-9))
    return pm.sweep_parameter(SOFT, strong, "modulus", np.geomspace(0.5e9, 5e9, 12), setpoint=0.7)


MAKE = {"distance": distance, "setpoint": setpoint, "frequency": frequency, "modulus": modulus}


@pytest.fixture(scope="module")
def sweeps() -> dict[str, xr.Dataset]:
    return {name: make() for name, make in MAKE.items()}


@pytest.fixture(params=list(MAKE))
def ds(request: pytest.FixtureRequest, sweeps: dict[str, xr.Dataset]) -> xr.Dataset:
    return sweeps[request.param].copy(deep=True)


def lines(axes: Axes, gid: str) -> list[Any]:
    return [line for line in axes.lines if line.get_gid() == gid]


def arrows(axes: Axes) -> list[Any]:
    return [text for text in axes.texts if text.get_gid() == "jump"]


def words(figure: Figure) -> str:
    return " | ".join(text.get_text() for text in figure.texts)


def test_a_sweep_is_read_back_identical(ds: xr.Dataset, tmp_path: Path) -> None:
    assert load(save(ds, tmp_path / "sweep.nc")).identical(ds)
    ds.to_netcdf(tmp_path / "plain.nc")
    assert load(tmp_path / "plain.nc").identical(ds)


def test_a_sweep_read_from_a_file_is_drawn_as_a_sweep(ds: xr.Dataset, tmp_path: Path) -> None:
    for suffix in (".png", ".pdf"):
        figure = plot(load(save(ds, tmp_path / f"{suffix}.nc")), tmp_path / f"curve{suffix}")
        assert len(figure.axes) == 2
        assert (tmp_path / f"curve{suffix}").stat().st_size > 5000


def test_every_jump_is_an_arrow_in_the_colour_of_its_direction(ds: xr.Dataset) -> None:
    for axes in curve(ds).axes:
        drawn = arrows(axes)
        assert len(drawn) == ds.sizes["jump"]
        for arrow, direction in zip(drawn, ds["jump_direction"].values, strict=True):
            assert same_color(arrow.arrow_patch.get_edgecolor(), COLOURS[direction])


def test_the_paper_shows_four_jumps_and_unstable_orbits(sweeps: dict[str, xr.Dataset]) -> None:
    axes = curve(sweeps["frequency"]).axes[0]
    assert len(arrows(axes)) == 4
    assert len(lines(axes, "unstable")) == 2
    assert len(lines(axes, "folds")[0].get_xdata()) == 4


def test_solid_is_stable_dashed_is_unstable_and_pieces_are_not_joined(ds: xr.Dataset) -> None:
    half = ds.sizes["point"] // 2
    ds["curve_piece"][half:] += 7  # cut a piece in two
    piece, stable = ds["curve_piece"].values, ds["curve_stable"].values
    axes = curve(ds, quantities="phase").axes[0]
    wanted: dict[str, list[tuple[float, float]]] = {"stable": [], "unstable": []}
    phase = ds["curve_phase"].values
    for i in range(len(piece) - 1):
        if piece[i] == piece[i + 1]:
            wanted["stable" if stable[i] and stable[i + 1] else "unstable"].append((phase[i], phase[i + 1]))
    for gid, style in (("stable", "-"), ("unstable", "--")):
        drawn = lines(axes, gid)
        assert all(line.get_linestyle() == style for line in drawn)
        steps = [pair for line in drawn for pair in zip(line.get_ydata()[:-1], line.get_ydata()[1:], strict=True)]
        assert steps == wanted[gid]


def test_what_the_sweep_saw_breaks_at_its_jumps(sweeps: dict[str, xr.Dataset]) -> None:
    ds = sweeps["distance"]
    axes = curve(ds, quantities=["phase"]).axes[0]
    for direction, word in enumerate(("approach", "retract")):
        (seen,) = lines(axes, f"seen {word}")
        x, y = seen.get_xdata(), seen.get_ydata()
        (gap,) = np.flatnonzero(np.isnan(x))
        jump = ds["jump_tip_offset"].values[ds["jump_direction"].values == direction].item() * 1e9
        assert x[gap - 1] < jump < x[gap + 1]
        np.testing.assert_allclose(y[~np.isnan(x)][::-1], ds["phase"].values[direction])
        assert seen.get_linestyle() == "None" and seen.get_marker() == "o"  # so few points are not joined


def test_many_points_are_a_line() -> None:
    ds = pm.sweep_distance(SOFT, SCOPE, np.linspace(20e-9, 5e-9, 80))
    assert lines(curve(ds).axes[0], "seen approach")[0].get_linestyle() == "-"


def test_quantities_have_units_and_the_tip_offset_stands_for_a_held_amplitude(sweeps: dict[str, xr.Dataset]) -> None:
    labels = {name: [axes.get_ylabel() for axes in curve(ds).axes] for name, ds in sweeps.items()}
    assert labels["distance"] == labels["frequency"] == ["amplitude (nm)", "phase (degrees)"]
    assert labels["setpoint"] == labels["modulus"] == ["tip offset (nm)", "phase (degrees)"]
    below = {name: curve(ds).axes[-1].get_xlabel() for name, ds in sweeps.items()}
    assert list(below.values()) == ["tip offset (nm)", "setpoint", "frequency (kHz)", "modulus (GPa)"]


def test_arrows_of_other_quantities_end_on_the_curve(sweeps: dict[str, xr.Dataset]) -> None:
    ds = sweeps["distance"]
    kept, found = curve(ds, quantities=["amplitude", "height"]).axes
    for ours, other in zip(arrows(kept), arrows(found), strict=True):
        assert other.xy[1] == pytest.approx(ours.xy[0] - ours.xy[1], abs=0.02)  # height is tip offset less amplitude
        assert other.xyann[1] == pytest.approx(ours.xyann[0] - ours.xyann[1], abs=0.02)


def test_the_jump_at_a_setpoint_ends_where_the_feedback_holds_again(sweeps: dict[str, xr.Dataset]) -> None:
    ds = sweeps["setpoint"]
    assert ds.sizes["jump"] == 1
    (arrow,) = arrows(curve(ds, quantities=["tip_offset"]).axes[0])
    assert arrow.xy[0] == pytest.approx(ds["jump_to_amplitude"].item() / 16e-9)
    assert arrow.xy[1] == pytest.approx(ds["jump_to_tip_offset"].item() * 1e9)


def test_the_far_part_is_cut_short(sweeps: dict[str, xr.Dataset]) -> None:
    low, high = curve(sweeps["distance"]).axes[0].get_xlim()
    assert low == pytest.approx(9, abs=1) and 17 < high < 22


def test_the_axis_is_logarithmic_where_the_values_are(sweeps: dict[str, xr.Dataset]) -> None:
    assert [curve(ds).axes[0].get_xscale() for ds in sweeps.values()] == ["linear"] * 3 + ["log"]


def test_titles_say_material_and_microscope_but_not_what_is_swept(sweeps: dict[str, xr.Dataset]) -> None:
    said = words(curve(sweeps["frequency"].assign_attrs(title="film of the paper")))
    assert said.startswith(
        "film of the paper | modulus 890 MPa, adhesion 0.37 J/m², damping 0.014, tip offset held at 140 nm"
    )
    assert "lever 40 N/m, 148.24 kHz, Q 250, tip radius 30 nm, free amplitude 155 nm" in said
    said = words(curve(sweeps["modulus"]))
    assert "modulus" not in said and "setpoint held at 0.7" in said


def test_gaps_are_marked_counted_and_given_advice(sweeps: dict[str, xr.Dataset]) -> None:
    ds = sweeps["distance"].copy(deep=True)
    ds["status"][0, 3:6] = 1
    ds["phase"] = ds["phase"].where(ds["status"] == 0)
    figure = curve(ds, quantities=["phase"])
    crosses = lines(figure.axes[0], "gap")
    np.testing.assert_allclose(crosses[0].get_xdata(), ds["tip_offset"].values[3:6] * 1e9)
    assert len(crosses[1].get_xdata()) == 0
    assert "× 3 of 36 points (8.33 %): No stable orbit was found at this tip offset" in words(figure)


def test_a_jump_that_leads_nowhere_is_a_cross(sweeps: dict[str, xr.Dataset]) -> None:
    ds = sweeps["distance"].copy(deep=True)
    for name in ("amplitude", "phase", "tip_offset"):
        ds[f"jump_to_{name}"][1] = np.nan
    figure = curve(ds, quantities=["phase", "peak_force"])
    for axes in figure.axes:
        assert len(arrows(axes)) == 1 and len(lines(axes, "jump")) == 1
    assert "× 1 of 2 jumps reach no stable orbit." in words(figure)


def test_irregular_motion_has_rings_and_a_band_and_is_counted(sweeps: dict[str, xr.Dataset]) -> None:
    ds = sweeps["distance"].copy(deep=True)
    ds["motion"][0, 3:6], ds["amplitude_spread"][0, 3:6], ds["phase_spread"][0, 3:6] = 1, 5e-12, 2.0
    figure = curve(ds)
    amplitude, phase = figure.axes
    for axes, values, spread in ((amplitude, ds["amplitude"][0] * 1e9, 5e-3), (phase, ds["phase"][0], 2.0)):
        (filled,), (ringed,) = (lines(axes, f"{kind} approach") for kind in ("seen", "irregular"))
        rings, disks = (np.asarray(line.get_ydata())[::-1] for line in (ringed, filled))
        seen = np.flatnonzero(np.isfinite(rings))
        np.testing.assert_allclose(rings[seen], values[3:6])
        assert not np.isfinite(disks[seen]).any() and np.isfinite(disks).sum() == ds.sizes["tip_offset"] - 3
        assert ringed.get_markerfacecolor() == "none"
        (band,) = (some for some in axes.collections if some.get_gid() == "spread approach")
        ends = sorted(np.ptp(path.vertices[:, 1]) for path in band.get_paths())
        assert ends == pytest.approx([2 * spread] * 3)
    assert phase.get_ylim()[0] < ds["phase"].values[0, 3:6].min() - 2.0
    assert "○ 3 of 36 points (8.33 %) irregular: mean amplitude and phase, spread up to 5 pm and 2 degrees" in words(
        figure
    )


def test_a_jump_to_irregular_motion_ends_where_that_was_seen(sweeps: dict[str, xr.Dataset]) -> None:
    ds = sweeps["distance"].copy(deep=True)
    i = int(np.flatnonzero(ds["tip_offset"].values < ds["jump_tip_offset"].values[0])[0])
    for name, seen in (("amplitude", 11e-9), ("phase", 7.0), ("peak_force", 3e-9)):  # off the curve of all orbits
        ds[name][0, i] = ds[f"jump_to_{name}"][0] = seen
    ds["jump_to_tip_offset"][0] = ds["tip_offset"][i]
    phase, force = curve(ds, quantities=["phase", "peak_force"]).axes
    at = 1e9 * float(ds["tip_offset"][i])
    assert arrows(phase)[0].xy == pytest.approx((at, float(ds["phase"][0, i])))
    assert arrows(force)[0].xy == pytest.approx((at, 3.0))
    older = ds.drop_vars(["jump_from_peak_force", "jump_to_peak_force"])
    assert not arrows(curve(older, quantities=["peak_force"]).axes[0])


def legend(ds: xr.Dataset) -> list[str]:
    return [text.get_text() for text in curve(ds).legends[0].get_texts()]


def test_the_legend_names_what_the_picture_has(sweeps: dict[str, xr.Dataset]) -> None:
    ds = sweeps["distance"]
    assert legend(ds) == ["approach, jumps →", "retract, jumps →", "stable orbits", "unstable", "fold"]
    plain = pm.sweep_setpoint(SOFT, SCOPE, np.linspace(0.6, 0.5, 4))
    assert legend(plain) == ["down", "up", "stable orbits"]
    shaken = plain.copy(deep=True)
    shaken["motion"][0, 2] = 1
    assert legend(shaken) == ["down", "up", "irregular: mean", "stable orbits"]
    assert legend(shaken.isel(point=slice(0))) == ["down", "up", "irregular: mean"]


def test_a_jump_outside_the_range_is_not_drawn_and_none_leaves_the_panel(sweeps: dict[str, xr.Dataset]) -> None:
    ds = sweeps["distance"]
    far = ds.sel(tip_offset=ds["tip_offset"] > ds["jump_tip_offset"].max().item() + 1e-9)
    assert far.sizes["jump"] == 2 and legend(far)[:2] == ["approach", "retract"]
    for axes in curve(far).axes:
        assert arrows(axes) == []
    for axes in curve(ds).axes:
        assert all(arrow.arrow_patch.get_clip_box() is axes.bbox for arrow in arrows(axes))


def test_a_sweep_without_any_orbit_is_still_drawn(sweeps: dict[str, xr.Dataset], tmp_path: Path) -> None:
    ds = sweeps["distance"].isel(point=slice(0), fold=slice(0), jump=slice(0)).copy(deep=True)
    ds["status"][:] = 1
    for name in ("amplitude", "phase"):
        ds[name][:] = np.nan
    assert "36 of 36 points (100 %)" in words(curve(ds, tmp_path / "nothing.png"))


def test_what_cannot_be_drawn_is_said(sweeps: dict[str, xr.Dataset], tmp_path: Path) -> None:
    ds = sweeps["distance"]
    with pytest.raises(InputError, match=r"quantities is 'phse'; allowed: some of amplitude, phase, height"):
        curve(ds, quantities=["phse"])
    with pytest.raises(InputError, match=r"quantities is \[\]; allowed: a list of amplitude"):
        curve(ds, quantities=[])
    with pytest.raises(InputError, match="what a sweep such as sweep_distance returned"):
        curve(xr.Dataset({"height": ("x", [1.0])}))
    with pytest.raises(InputError, match=r"suffix is '\.bild'"):
        curve(ds, tmp_path / "curve.bild")
    curve(ds, tmp_path / "curve.png")
    with pytest.raises(FileError, match="exists already"):
        curve(ds, tmp_path / "curve.png")
    curve(ds, tmp_path / "curve.png", overwrite=True)


def test_a_sweep_is_drawn_on_axes_of_ones_own(sweeps: dict[str, xr.Dataset], tmp_path: Path) -> None:
    figure = Figure()
    left, right = figure.subplots(1, 2)
    assert plot(sweeps["distance"], ax=[left, right]) is figure
    assert [one.get_ylabel() for one in (left, right)] == ["amplitude (nm)", "phase (degrees)"]
    assert left.get_legend() is not None and right.get_xlabel() == "tip offset (nm)"
    assert curve(sweeps["distance"], quantities="phase", ax=right) is figure
    with pytest.raises(InputError, match="ax is 1; allowed: 2 Axes, one for each of amplitude, phase"):
        plot(sweeps["distance"], ax=left)
    with pytest.raises(InputError, match="allowed: None where ax is given"):
        plot(sweeps["distance"], tmp_path / "curve.png", ax=[left, right])


def test_the_lag_of_a_sweep_is_ninety_degrees_less_its_phase(sweeps: dict[str, xr.Dataset]) -> None:
    plain, lag = (plot(sweeps["distance"], lag=on).axes[1] for on in (False, True))
    assert (plain.get_ylabel(), lag.get_ylabel()) == ("phase (degrees)", "phase lag (degrees)")
    for one, other in zip(lines(plain, "stable"), lines(lag, "stable"), strict=True):
        np.testing.assert_allclose(other.get_ydata(), 90 - one.get_ydata())


def test_a_force_curve_is_drawn_and_its_two_directions_differ_where_a_neck_is_drawn_out(tmp_path: Path) -> None:
    sticky = pm.Microscope(SCOPE.cantilever, SCOPE.tip, SCOPE.drive, pm.Interaction("jkr", decay_length=None))
    made = pm.force_curve(STICKY, sticky, np.linspace(-5e-9, 2e-9, 141))
    figure = plot(made, tmp_path / "force.png")
    assert (tmp_path / "force.png").exists() and "lever 40 N/m" in words(figure)
    approach, retract = figure.axes[0].lines[:2]
    assert (approach.get_label(), retract.get_label()) == ("approach", "retract")
    assert np.min(retract.get_ydata()) < np.min(approach.get_ydata()[made.depth < 0]) == 0
    own = Figure().subplots()
    assert plot(made, ax=own) is own.figure and len(own.lines) >= 2
    with pytest.raises(InputError, match="vmin is '1'; allowed: nothing where a force curve is drawn"):
        plot(made, vmin=1)
    with pytest.raises(InputError, match="lag is 'True'; allowed: nothing where a force curve is drawn"):
        plot(made, lag=True)
    with pytest.raises(InputError, match=r"what phasemap\.force_curve returned"):
        pm.plot.force(made.rename(force="pull"))


def test_only_functions_that_draw_are_listed() -> None:
    assert dir(pm.plot) == sorted(pm.plot.__all__) and all(callable(getattr(pm.plot, one)) for one in dir(pm.plot))


def test_a_trace_shows_both_directions_over_a_period(sweeps: dict[str, xr.Dataset], tmp_path: Path) -> None:
    ds = sweeps["distance"]
    figure = trace(ds, 13e-9, tmp_path / "trace.png")
    assert [axes.get_ylabel() for axes in figure.axes] == ["deflection to surface (nm)", "force (nN)"]
    near = ds.sel(tip_offset=13e-9, method="nearest")
    assert f"tip offset {near['tip_offset'].item() * 1e9:.5g} nm" in words(figure)
    drawn = [line for line in figure.axes[1].lines if len(line.get_xdata()) == 33]
    for line, force in zip(drawn, near["trace_force"].values, strict=True):
        np.testing.assert_allclose(np.asarray(line.get_ydata())[:-1], force * 1e9)
        assert line.get_ydata()[-1] == line.get_ydata()[0]


def test_a_trace_that_is_not_there_is_refused(sweeps: dict[str, xr.Dataset]) -> None:
    with pytest.raises(InputError, match="a sweep with samples=256"):
        trace(sweeps["setpoint"], 0.7)
    with pytest.raises(InputError, match="at is '40 nm'; allowed: from 9 nm to 30 nm"):
        trace(sweeps["distance"], 40e-9)
