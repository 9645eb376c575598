"""Curves of text, of Igor and of sweeps are read into one form, which says what is recorded and what is not."""

from __future__ import annotations

import ast
import gzip
import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from vendor_files import ibw_curve, jpk_curves, nanoscope_curve

import phasemap as pm
from phasemap.cli import main

Z = np.concatenate([np.linspace(0.0, 60e-9, 121), np.linspace(60e-9, 0.0, 121)])  # of the piezo, towards the surface
GAP = 40e-9 - Z  # from where the amplitude falls, by a nanometre a nanometre
AMPLITUDE = 0.5 + np.minimum(GAP, 0.0) / 80e-9  # [V]
LAG = 90.0 + np.where(GAP < 0, np.maximum(-5.0, 3e9 * GAP) + 0.0, 0.0)
TOLD = "ignore::phasemap.ResultWarning"


def text(path: Path, heading: str | None, *columns: np.ndarray) -> Path:
    np.savetxt(path, np.stack(columns, axis=1), delimiter="\t", header=heading or "", comments="")
    return path


def told(curve: xr.Dataset) -> str:
    return str(curve.attrs["warnings"])


@pytest.mark.filterwarnings(TOLD)
@pytest.mark.parametrize("heading", ["z [nm]\tAmplitude [mV]\tPhase lag [deg]", "# z (nm)\tamp (mV)\tlag (deg)"])
def test_columns_with_names_and_units_are_a_curve_of_both_directions(tmp_path: Path, heading: str) -> None:
    curve = pm.read_curve(text(tmp_path / "curve.txt", heading, 1e9 * Z, 1e3 * AMPLITUDE, LAG))
    assert curve.direction.values.tolist() == ["approach", "retract"]
    assert curve.amplitude.attrs["units"] == "V" and curve.phase.attrs["units"] == "degree"
    np.testing.assert_allclose(curve.distance.sel(direction="approach"), 60e-9 - Z[:121], atol=1e-18)
    assert float(curve.distance.sel(direction="retract")[0]) == 0.0
    assert curve.attrs["free_amplitude_voltage"] == pytest.approx(0.5)
    assert curve.attrs["phase_zero"] == pytest.approx(90.0) and curve.attrs["phase_sign"] == -1
    assert curve.attrs["amplitude_sensitivity"] == pytest.approx(80e-9, rel=1e-6)
    assert "80 nm/V at most" in told(curve) and "Not recorded: stiffness, resonance frequency" in told(curve)


@pytest.mark.filterwarnings(TOLD)
@pytest.mark.parametrize("free", [0.0, 178.0, -178.0])
def test_the_sign_of_a_phase_is_not_turned_by_the_end_of_its_range(tmp_path: Path, free: float) -> None:
    phase = (free + 90.0 - LAG + 180) % 360 - 180  # up to 5 degrees more where the tip is nearest
    curve = pm.read_curve(
        text(tmp_path / "curve.txt", "z [nm]\tamp [mV]\tphase [deg]", 1e9 * Z, 1e3 * AMPLITUDE, phase)
    )
    assert curve.attrs["phase_sign"] == 1 and curve.attrs["phase_zero"] == pytest.approx(free)


@pytest.mark.filterwarnings(TOLD)
@pytest.mark.parametrize("mark", [";", "\t", "; "])
def test_a_decimal_comma_is_no_mark_between_columns(tmp_path: Path, mark: str) -> None:
    point = text(tmp_path / "point.txt", "z [nm]\tAmplitude [mV]\tPhase lag [deg]", 1e9 * Z, 1e3 * AMPLITUDE, LAG)
    comma = tmp_path / "comma.txt"
    comma.write_text(point.read_text().replace("\t", mark).replace(".", ","))
    xr.testing.assert_equal(pm.read_curve(comma), pm.read_curve(point))


@pytest.mark.filterwarnings(TOLD)
@pytest.mark.parametrize(
    ("heading", "encoding"),
    [
        ("z [nm]\tAmplitude [mV]\tPhase lag [deg]", "utf-8-sig"),
        ("z [nm]\tAmplitude [mV]\tPhase lag [deg]", "utf-16"),
        ("z [nm]\tAmplitude [mV]\tPhase lag [°]", "latin-1"),
        ("z [nm] Amplitude [mV] lag [deg]", "utf-8"),
        ("Curve 3, in air\nz\tAmplitude\tPhase lag\nnm\tmV\tdeg", "utf-8"),
        ("z; Amplitude; Phase lag\n[nm]; [mV]; [deg]", "utf-8"),
        ("# index: 0\n# columns: height lockInAmplitude lockInPhaselag\n# units: nm mV deg\n#", "utf-8"),
    ],
)
def test_text_is_read_as_instruments_and_spreadsheets_write_it(tmp_path: Path, heading: str, encoding: str) -> None:
    plain = text(tmp_path / "plain.txt", "z [nm]\tAmplitude [mV]\tPhase lag [deg]", 1e9 * Z, 1e3 * AMPLITUDE, LAG)
    other = tmp_path / "other.txt"
    rows = plain.read_text().splitlines()[1:]
    rows.insert(40, "nan\tnan\tnan")  # a point that the instrument lost
    other.write_text("\n".join([heading, *rows]), encoding)
    xr.testing.assert_equal(pm.read_curve(other), pm.read_curve(plain))


@pytest.mark.filterwarnings(TOLD)
def test_a_file_of_several_curves_without_names_is_read_by_the_names_given(tmp_path: Path) -> None:
    half = [Z[:121], AMPLITUDE[:121], AMPLITUDE[:121] + 0.01, LAG[:121]]
    table = np.stack([*half, *(2 * one for one in half)], axis=1)
    table[-5:, 4:] = 0.0  # padded
    with gzip.open(tmp_path / "curves.txt.gz", "wt") as file:
        np.savetxt(file, table)
    names = ("distance approach [m]", "amplitude approach [V]", None, "phase approach [degree]")
    first, second = (pm.read_curve(tmp_path / "curves.txt.gz", columns=names, number=i) for i in range(2))
    assert first.sizes == {"direction": 1, "point": 121} and second.sizes["point"] == 116
    np.testing.assert_allclose(second.amplitude[0], 2 * AMPLITUDE[:116])
    assert "Only the approach is recorded" in told(first) and "sign of the phase is not recorded" in told(first)


@pytest.mark.filterwarnings(TOLD)
def test_a_wave_of_igor_says_lever_and_sensitivity(tmp_path: Path) -> None:
    pytest.importorskip("igor2")
    ibw_curve(tmp_path / "curve.ibw", Z, 50e-9 * AMPLITUDE, LAG)
    curve = pm.read_curve(tmp_path / "curve.ibw")
    assert curve.attrs["stiffness"] == 2.5 and curve.attrs["amplitude_sensitivity"] == 5e-8
    assert curve.attrs["free_amplitude"] == pytest.approx(25e-9, rel=1e-6)
    assert "stiffness" not in told(curve) and "tip radius" in told(curve)
    assert curve.attrs["phase_sign"] == -1  # as the vendor documents


def check_instrument_curve(curve: xr.Dataset) -> None:
    """Both ways of the curve are AMPLITUDE at 50 nm/V and LAG, in the resolution of the instruments' integers."""
    assert curve.sizes == {"direction": 2, "point": 121}
    for _, way in curve.groupby("direction", squeeze=False):
        gap = np.squeeze(way.distance.values)
        expected = (np.interp(gap, (60e-9 - Z[:121])[::-1], one[:121][::-1]) for one in (50e-9 * AMPLITUDE, LAG))
        np.testing.assert_allclose(np.squeeze(way.amplitude), next(expected), atol=2e-11)
        np.testing.assert_allclose(np.squeeze(way.phase), next(expected), atol=0.02)
    assert float(curve.distance.max()) == pytest.approx(60e-9, abs=1e-10)
    assert curve.amplitude.attrs["units"] == "m" and curve.attrs["amplitude_sensitivity"] == pytest.approx(50e-9)
    assert curve.attrs["drive_frequency"] == 300e3
    assert "sign of the phase is not recorded" in told(curve) and "quality factor, tip radius" in told(curve)


@pytest.mark.filterwarnings(TOLD)
def test_archives_of_jpk_hold_one_curve_or_many(tmp_path: Path) -> None:
    jpk_curves(tmp_path / "one.jpk-force", [[60e-9 - Z, AMPLITUDE, LAG]])
    check_instrument_curve(pm.read_curve(tmp_path / "one.jpk-force"))
    jpk_curves(tmp_path / "map.jpk-force-map", [[60e-9 - Z, k * AMPLITUDE, LAG] for k in (0.5, 1.0)], "index/{}/")
    check_instrument_curve(pm.read_curve(tmp_path / "map.jpk-force-map", number=1))
    with pytest.raises(pm.InputError, match="number is 2; allowed: 0 to 1"):
        pm.read_curve(tmp_path / "map.jpk-force-map", number=2)
    (tmp_path / "cut.jpk-force").write_bytes((tmp_path / "one.jpk-force").read_bytes()[:900])
    with pytest.raises(pm.FileError, match="damaged, or no archive of JPK"):
        pm.read_curve(tmp_path / "cut.jpk-force")


@pytest.mark.filterwarnings(TOLD)
@pytest.mark.parametrize("version", ["0x05120130", "0x09400000"])
def test_a_curve_of_nanoscope_has_the_same_distances_both_ways(tmp_path: Path, version: str) -> None:
    back = np.r_[np.arange(121), np.arange(241, 120, -1)]  # both ways are stored over one axis
    nanoscope_curve(tmp_path / "curve.001", 60.5e-9, AMPLITUDE[back], LAG[back], version)
    curve = pm.read_curve(tmp_path / "curve.001")
    check_instrument_curve(curve)
    assert curve.attrs["stiffness"] == 42 and "typed into NanoScope" in told(curve)
    assert "setpoint" not in told(curve)
    (tmp_path / "cut.001").write_bytes((tmp_path / "curve.001").read_bytes()[:4500])
    with pytest.raises(pm.FileError, match="it is cut short"):
        pm.read_curve(tmp_path / "cut.001")


def test_a_simulated_curve_says_its_lever_and_tip_and_warns_of_nothing(tmp_path: Path) -> None:
    scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(8e-9), pm.Drive(20e-9))
    sweep = pm.sweep_distance(pm.Material(1e9, 0.03, 0.01), scope, np.linspace(30e-9, 12e-9, 61))
    sweep.to_netcdf(tmp_path / "sweep.nc")
    curve = pm.read_curve(tmp_path / "sweep.nc")
    assert not told(curve)
    said = {"stiffness": 40.0, "resonance_frequency": 300e3, "quality_factor": 400.0, "tip_radius": 8e-9}
    assert {name: curve.attrs[name] for name in said} == said
    np.testing.assert_array_equal(curve.amplitude, sweep.amplitude)
    assert curve.attrs["phase_zero"] == pytest.approx(0.0, abs=0.2)


@pytest.mark.filterwarnings(TOLD)
def test_a_curve_that_does_not_reach_the_free_lever_has_no_zero(tmp_path: Path) -> None:
    near = Z > 42e-9
    curve = pm.read_curve(
        text(tmp_path / "near.csv", "z [m]\tamplitude [m]\tphase [deg]", Z[near], AMPLITUDE[near], LAG[near])
    )
    assert "phase_zero" not in curve.attrs and "still changes at the far end" in told(curve)


@pytest.mark.filterwarnings(TOLD)
def test_what_a_curve_without_names_is_told_can_be_done_in_python_and_in_the_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = text(tmp_path / "bare.txt", None, Z, 0.0 * Z, AMPLITUDE, LAG)
    assert main(["plot", str(path)]) == 2
    said = " ".join(capsys.readouterr().err.split())
    (names,), (columns,) = re.findall(r"columns=(\(.*?\)),", said), re.findall(r"--columns '(.*?)'", said)
    assert pm.read_curve(path, columns=ast.literal_eval(names)).sizes["direction"] == 2
    assert main(["plot", str(path), "--columns", columns]) == 0


@pytest.mark.parametrize(
    ("heading", "options", "message"),
    [
        (None, {}, "it has 3 columns and names of 0; say what they are"),
        (None, {"columns": ("distance [m]", "amplitude [V]")}, "3 columns and names of 2"),
        (None, {"columns": ("distance [m]", "brightness [V]", None)}, "columns is 'brightness"),
        (None, {"columns": ("distance [m]", "amplitude", None)}, "unit of the column 'amplitude' is None"),
        (None, {"columns": ("distance [m]", None, None)}, "a curve has distance and amplitude; it holds distance"),
        ("z [m]\tamp [V]\tphase [deg]", {"number": 1}, "number is 1; allowed: 0 to 0"),
    ],
)
def test_what_is_no_curve_is_refused_in_a_sentence(
    tmp_path: Path, heading: str | None, options: dict[str, object], message: str
) -> None:
    with pytest.raises(pm.PhasemapError, match=message):
        pm.read_curve(text(tmp_path / "curve.txt", heading, Z, AMPLITUDE, LAG), **options)


def test_a_file_that_is_no_text_says_how_to_get_one(tmp_path: Path) -> None:
    (tmp_path / "curve.spm").write_bytes(bytes(range(256)) * 4)
    with pytest.raises(
        pm.FileError, match=r"export the curve from the instrument's program as text.*`phasemap scene`.*`series`"
    ):
        pm.read_curve(tmp_path / "curve.spm")
