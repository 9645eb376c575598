"""Real files from the nsfopen wheel, and small ones that are written here: read into the one form of an image."""

from __future__ import annotations

import importlib
import json
import re
import sys
import tomllib
import warnings
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from vendor_files import ibw_file, jpk_file, nanoscope_file, park_file

import phasemap as pm
from phasemap._shared.errors import FileError, PhasemapError
from phasemap.io.gwyddion import Channel
from phasemap.io.metadata import KINDS
from phasemap.io.read import read_image
from phasemap.io.vendors import operating_mode, scan_data

needs_reader = pytest.mark.skipif(
    any(find_spec(name) is None for name in ("gwyddionpy", "gwyddionpy_converter", "gwyfile", "NSFopen")),
    reason='needs pip install "afm-phasemap[read]" and nsfopen',
)
NOWHERE = Path("nowhere")


def example(name: str) -> Path:
    spec = find_spec("NSFopen")
    assert spec is not None and spec.submodule_search_locations is not None
    return Path(spec.submodule_search_locations[0], "example", name)


@pytest.fixture(scope="module")
def flake() -> xr.Dataset:
    return read_image(example("Plotting_Data/MoS2.nid"))


# Images.


@needs_reader
def test_every_pixel_is_that_of_the_vendors_own_reader(flake: xr.Dataset) -> None:
    with warnings.catch_warnings(action="ignore"):  # of pandas, which their reader asks for what it will not have
        theirs = importlib.import_module("NSFopen.read").read(str(example("Plotting_Data/MoS2.nid"))).data["Image"]
    for direction, word in (("trace", "Forward"), ("retrace", "Backward")):
        for name, channel in (("height", "Z-Axis Sensor"), ("phase", "Phase"), ("amplitude", "Amplitude")):
            ours = flake[name].sel(direction=direction).values
            assert np.array_equal(ours, np.array(theirs[word][channel])[::-1])  # theirs has the bottom row first


@needs_reader
def test_an_image_has_metres_and_degrees_and_its_own_pixels(flake: xr.Dataset) -> None:
    assert flake["phase"].dims == ("direction", "y", "x") and flake["phase"].shape == (2, 256, 512)
    assert flake["direction"].values.tolist() == ["trace", "retrace"]
    assert [flake[name].attrs["units"] for name in ("height", "phase", "amplitude")] == ["m", "degree", "V"]
    dy, dx = (abs(float(flake[dim][1] - flake[dim][0])) for dim in ("y", "x"))
    assert dx * 512 == pytest.approx(3.97339e-6) and dy == pytest.approx(2 * dx)  # its pixels are not square
    assert float(flake["x"][0]) == pytest.approx(dx / 2)


@needs_reader
def test_row_0_is_the_top_of_the_image(flake: xr.Dataset) -> None:
    # The tip changed 78 of 256 rows below the top: the phase above is 10 degrees lower.
    step = np.diff(np.median(flake["phase"].values[0, :110], axis=1))
    assert np.argmax(step) in (77, 78)


@needs_reader
def test_trace_and_retrace_run_the_same_way(flake: xr.Dataset) -> None:
    trace, retrace = flake["phase"].values
    # 0.64 although the lines lag by 7 pixels; against the mirror image they have little in common.
    assert np.corrcoef(trace.ravel(), retrace.ravel())[0, 1] > 0.6
    assert np.corrcoef(trace.ravel(), retrace[:, ::-1].ravel())[0, 1] < 0.3


@needs_reader
def test_channels_can_be_named_with_their_direction_or_without() -> None:
    path = example("Plotting_Data/MoS2.nid")
    backward = read_image(path, phase="Phase backward")
    assert backward.attrs["direction"] == "retrace" and backward["phase"].dims == ("y", "x")
    assert json.loads(backward.attrs["channels"])["height"] == ["Z-Axis Sensor backward"], "what was measured"
    told = read_image(path, height="Z-Axis")
    assert json.loads(told.attrs["channels"])["height"] == ["Z-Axis forward", "Z-Axis backward"]
    assert json.loads(told.attrs["other_channels"]) == ["Z-Axis Sensor forward", "Z-Axis Sensor backward"]
    with pytest.raises(FileError, match="there is no channel 'Fase'; it holds 'Z-Axis forward', "):
        read_image(path, phase="Fase")
    with pytest.raises(FileError, match="'Amplitude forward' is in 'V' over 'm', not an angle"):
        read_image(path, phase="Amplitude forward")
    with pytest.raises(FileError, match="'Phase forward' is in 'deg' over 'm', not a length"):
        read_image(path, height="Phase forward")


@pytest.mark.parametrize(
    ("name", "metadata", "base", "direction"),
    [
        ("Phase", {"Line Direction": "Retrace"}, "Phase", "retrace"),  # NanoScope
        ("Height (2)", {"Line Direction": "Trace"}, "Height", "trace"),
        ("HeightTrace", {}, "Height", "trace"),  # Asylum
        ("PhaseRetrace", {}, "Phase", "retrace"),
        ("Lock-In Phase [Retrace]", {}, "Lock-In Phase", "retrace"),  # JPK
        ("Phase backward", {}, "Phase", "retrace"),  # Nanosurf
        ("NCM Phase", {"Line direction": "Left to right"}, "NCM Phase", "trace"),  # Park
        ("Z Height", {"Line direction": "Right to left"}, "Z Height", "retrace"),
        ("Topography", {"General Info::X scanning direction": "Backward"}, "Topography", "retrace"),  # WSxM
        ("Topography", {}, "Topography", ""),
        ("Phase1Trace", {}, "Phase1", "trace"),
    ],
)
def test_the_vendors_names_of_channels_and_directions(
    name: str, metadata: dict[str, str], base: str, direction: str
) -> None:
    channel = Channel(name, np.zeros((1, 1)), "deg", "m", (1.0, 1.0), metadata)
    assert (channel.base, channel.direction) == (base, direction)


@pytest.mark.parametrize(
    ("kind", "names", "others"),
    [
        ("phase", ("Phase", "Phase1", "NCM Phase", "Lock-In Phase"), ("Phase2", "Phase 2", "Phase Error", "Potential")),
        ("height", ("Height Sensor", "ZSensor", "Z-Axis", "Z Height", "Z Detector", "Topography"), ("Error", "Zoom")),
    ],
)
def test_channels_are_known_by_what_vendors_call_them(
    kind: str, names: tuple[str, ...], others: tuple[str, ...]
) -> None:
    assert all(KINDS[kind].pattern.match(name) for name in names)
    assert not any(KINDS[kind].pattern.match(name) for name in others)


@needs_reader
def test_a_wsxm_file_is_read_the_right_way_up(tmp_path: Path) -> None:
    height = np.random.default_rng(1).normal(0.0, 3.0, (4, 6))  # nm, as WSxM has it
    lines = [
        "WSxM file copyright WSxM solutions", "SxM Image file", "Image header size: 00000", "", "[Control]", "",
        "    X Amplitude: 600 nm", "    Y Amplitude: 200 nm", "", "[General Info]", "", "    Head type: Topography",
        "    Image Data Type: double", "    Number of columns: 6", "    Number of rows: 4",
        f"    Z Amplitude: {np.ptp(height)} nm", "", "[Header end]", "",
    ]  # fmt: skip
    header = "\r\n".join(lines)
    header = header.replace("00000", f"{len(header):05d}")
    path = tmp_path / "scan.stp"
    path.write_bytes(header.encode("latin-1") + height[::-1, ::-1].tobytes())  # from the last pixel to the first
    image = read_image(path)
    assert image["height"].values == pytest.approx(1e-9 * height, rel=1e-9)
    assert [float(image[dim].min()) for dim in ("y", "x")] == pytest.approx([25e-9, 50e-9])
    assert image.attrs["warnings"] == "There is no phase channel."


@needs_reader
@pytest.mark.parametrize(
    ("sensitivity", "unit", "of_a_millivolt"), [("1.000000 ", "V", 1e-3), ("62.00000 nm/V", "m", 62e-12)]
)
def test_the_amplitude_error_of_nanoscope_is_in_volts_or_metres(
    sensitivity: str, unit: str, of_a_millivolt: float, tmp_path: Path
) -> None:
    counts = nanoscope_file(tmp_path / "scan.001", sensitivity)
    image = read_image(tmp_path / "scan.001")
    assert image["amplitude_error"].attrs["units"] == unit
    assert image["amplitude_error"].values == pytest.approx(0.06103516 * counts * of_a_millivolt, rel=1e-4)
    assert image["height"].values == pytest.approx(20e-9 * 1e-3 * counts, rel=1e-4)


@needs_reader
def test_a_jpk_file_is_read_the_right_way_up_in_both_directions(tmp_path: Path) -> None:
    pytest.importorskip("tifffile")
    held = jpk_file(tmp_path / "scan.jpk")
    image = read_image(tmp_path / "scan.jpk")
    assert image["direction"].values.tolist() == ["trace", "retrace"]  # only the latter is marked in the file
    for (name, direction), values in held.items():
        assert image[name].sel(direction=direction).values == pytest.approx(values, rel=1e-9, abs=0)
    assert [float(image[dim].min()) for dim in ("y", "x")] == pytest.approx([1e-7, 5e-8])
    known = {"drive_frequency": 88400.0, "setpoint": 0.8, "free_amplitude_voltage": 2.0, "setpoint_voltage": 1.6}
    assert {name: image.attrs[name] for name in known} == known
    # 15 nm/V is how its amplitude becomes metres. A real file has 14.88 nm/V, which makes of its setpoint of 1.739 V
    # the 25.9 nm that are the median of its amplitude.
    metres = {"amplitude_sensitivity": 15e-9, "free_amplitude": 30e-9, "setpoint_amplitude": 24e-9}
    assert {name: image.attrs[name] for name in metres} == pytest.approx(metres, rel=1e-12)
    assert "warnings" not in image.attrs


@needs_reader
@pytest.mark.parametrize("slot", [b"setpoint-slot : voltsamplitudX", b"setpoint-slot : rawamplitude  "])
def test_a_jpk_setpoint_in_other_volts_has_no_sensitivity(tmp_path: Path, slot: bytes) -> None:
    pytest.importorskip("tifffile")
    jpk_file(tmp_path / "scan.jpk")
    data, told = (tmp_path / "scan.jpk").read_bytes(), b"setpoint-slot : voltsamplitude"
    assert told in data and len(told) == len(slot)
    (tmp_path / "scan.jpk").write_bytes(data.replace(told, slot))
    image = read_image(tmp_path / "scan.jpk")
    assert "amplitude_sensitivity" not in image.attrs and "free_amplitude" not in image.attrs
    assert "The free amplitude is 2 V, and the file has no sensitivity" in image.attrs["warnings"]


@needs_reader
def test_an_image_of_force_curves_is_not_taken_for_tapping(tmp_path: Path) -> None:
    pytest.importorskip("tifffile")
    jpk_file(tmp_path / "map.jpk-qi-image")
    data = (tmp_path / "map.jpk-qi-image").read_bytes()
    assert data.count(b"ac-direct-drive") == 1
    settings = data.replace(b"ac-direct-drive", bytes(15)).replace(
        b"adjust-reference-amplitude-feedback-settings", b"type : simple-quantitative-imaging-settings\n"
    )  # of the same length, as a file of version 8 has it, which names no feedback mode
    (tmp_path / "map.jpk-qi-image").write_bytes(settings)
    with pytest.raises(FileError, match="recorded in the mode 'quantitative imaging', whose phase is not a tapping"):
        read_image(tmp_path / "map.jpk-qi-image")


@needs_reader
def test_an_asylum_file_is_read_the_right_way_up(tmp_path: Path) -> None:
    height, phase = ibw_file(tmp_path / "scan.ibw")
    image = read_image(tmp_path / "scan.ibw")
    assert np.array_equal(image["height"], height) and np.array_equal(image["phase"], phase)
    assert [float(image[dim].min()) for dim in ("y", "x")] == pytest.approx([5e-8, 5e-8])
    known = {"free_amplitude": 40e-9, "setpoint_amplitude": 30e-9, "setpoint": 0.75, "stiffness": 2.5, "phase_sign": -1}
    assert {name: image.attrs[name] for name in known} == pytest.approx(known)


@needs_reader
def test_a_park_file_is_read_the_right_way_up(tmp_path: Path) -> None:
    pytest.importorskip("tifffile")
    held = park_file(tmp_path / "phase.tiff", "NCM Phase", "NCM", forward=False)
    image = read_image(tmp_path / "phase.tiff")
    assert image["phase"].values == pytest.approx(held, rel=1e-9)
    assert [float(image[dim].min()) for dim in ("y", "x")] == pytest.approx([1e-7, 5e-8])
    assert (image.attrs["direction"], image.attrs["operating_mode"]) == ("retrace", "NCM")
    assert (image.attrs["line_rate"], image.attrs["setpoint_amplitude"]) == pytest.approx((0.5, 12.5e-9))
    park_file(tmp_path / "lateral.tiff", "LFM", "LFM")
    with pytest.raises(FileError, match="recorded in the mode 'LFM', whose phase is not a tapping phase"):
        read_image(tmp_path / "lateral.tiff")


# What is wrong with a file.


@needs_reader
def test_a_file_without_a_phase_is_read_and_says_so() -> None:
    image = read_image(example("Plane_Removal/circles.nid"))
    assert set(image.data_vars) == {"height", "amplitude"}
    assert "There is no phase channel." in image.attrs["warnings"].splitlines()


@needs_reader
@pytest.mark.parametrize(
    ("name", "mode"),
    [("Force_Spectroscopy/spectroscopy.nid", "Static Force"), ("Lateral_Force/SBS-PMMA.nid", "Lateral Force")],
)
def test_a_file_of_another_mode_is_refused(name: str, mode: str) -> None:
    with pytest.raises(FileError, match=f"recorded in the mode '{mode}', whose phase is not a tapping phase"):
        read_image(example(name))


@pytest.mark.parametrize(
    "metadata",
    [
        {"ImagingMode": "PFM Mode"},
        {"ImagingMode": "FM Mode"},
        {"MicroscopeList": "Contact"},
        {"Feedback Mode": "contact"},
    ],
)
def test_contact_force_modulation_and_frequency_modulation_are_refused(metadata: dict[str, str]) -> None:
    with pytest.raises(FileError, match="whose phase is not a tapping phase"):
        operating_mode(NOWHERE, metadata)


def test_tapping_is_known_by_many_names() -> None:
    for key, mode in (("Op. mode", "Dynamic Force"), ("ImagingMode", "AC Mode"), ("Feedback Mode", "intermittent")):
        assert operating_mode(NOWHERE, {key: mode}) == mode
    assert operating_mode(NOWHERE, {}) == "not recorded"


@needs_reader
def test_a_file_that_is_cut_short_or_foreign_is_refused_in_one_sentence(tmp_path: Path) -> None:
    whole = example("Plotting_Data/MoS2.nid").read_bytes()
    files = {
        "cut.nid": whole[: len(whole) // 2],
        "text.nid": b"hello\n",
        "empty.ibw": b"",
        "broken.gwy": b"GWYPnonsense",
    }
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
        why = "it is damaged, cut short, or of no format that Gwyddion reads"
        why = {"empty.ibw": "it is empty", "text.nid": "it is text, with no image in it"}.get(name, why)
        with pytest.raises(FileError, match=f"^cannot read [^\n]*{name}: {why}\\.$"):
            read_image(tmp_path / name)
    with pytest.raises(FileError, match="it is a folder"):
        read_image(tmp_path)
    with pytest.raises(FileError, match="there is no such file"):
        read_image(tmp_path / "nowhere.nid")


def gwy_file(path: Path, *channels: tuple[str, np.ndarray, str, tuple[float, float], dict[str, str]]) -> Path:
    """A file of Gwyddion's: title, values, unit, height and width [m] and metadata of each channel."""
    objects = importlib.import_module("gwyfile").objects
    container = objects.GwyContainer()
    for n, (title, values, unit, (yreal, xreal), meta) in enumerate(channels):
        units = {"si_unit_xy": objects.GwySIUnit(unitstr="m"), "si_unit_z": objects.GwySIUnit(unitstr=unit)}
        container[f"/{n}/data"] = objects.GwyDataField(values, xreal=xreal, yreal=yreal, **units)
        container[f"/{n}/data/title"] = title
        container[f"/{n}/meta"] = objects.GwyContainer(meta, dict.fromkeys(meta, "s"))
    container.tofile(str(path))
    return path


@needs_reader
def test_channels_of_another_size_are_not_laid_on_each_other(tmp_path: Path) -> None:
    values = np.arange(20.0).reshape(4, 5)
    height = ("Height", 1e-9 * values, "m", (4e-7, 5e-7), {})
    cut = gwy_file(tmp_path / "cut.gwy", height, ("Phase", values, "deg", (2e-7, 2.5e-7), {}))
    with pytest.raises(FileError, match=r"'Height' has 4e-07 x 5e-07 m but 'Phase' has 2e-07 x 2\.5e-07; name two"):
        read_image(cut)
    fewer = gwy_file(tmp_path / "fewer.gwy", height, ("Phase", values[:2], "deg", (4e-7, 5e-7), {}))
    with pytest.raises(FileError, match="'Height' has 4 x 5 pixels but 'Phase' has 2 x 5; name two"):
        read_image(fewer)


@needs_reader
def test_an_asylum_image_has_the_size_of_its_scan_unless_it_was_cut_in_gwyddion(tmp_path: Path) -> None:
    values, meta = np.zeros((4, 5)), {"ImagingMode": "AC Mode", "SlowScanSize": "8e-07", "FastScanSize": "1e-06"}
    whole = gwy_file(tmp_path / "whole.gwy", ("PhaseTrace", values, "deg", (8e-7 * 4 / 3, 1e-6 * 5 / 4), meta))
    assert [float(read_image(whole)[dim].min()) for dim in ("y", "x")] == pytest.approx([1e-7, 1e-7])
    cut = gwy_file(tmp_path / "cut.gwy", ("PhaseTrace", values, "deg", (2e-7, 3e-7), meta))
    assert [float(read_image(cut)[dim].min()) for dim in ("y", "x")] == pytest.approx([2.5e-8, 3e-8])


@needs_reader
def test_the_scan_is_that_of_the_channels_which_were_chosen(tmp_path: Path) -> None:
    values, size = np.zeros((4, 5)), (4e-7, 5e-7)
    first = {"Op. mode": "Phase Contrast", "Setpoint": "50 %"}
    path = gwy_file(
        tmp_path / "two.gwy", ("Phase", values, "deg", size, first),
        ("Phase", values + 1, "deg", size, first | {"Setpoint": "80 %"}),
    )  # fmt: skip
    assert read_image(path).attrs["setpoint"] == 0.5
    second = read_image(path, phase="Phase (2)")
    assert (second.attrs["setpoint"], float(second["phase"][0, 0])) == (0.8, 1.0)


@needs_reader
def test_a_phase_that_ran_over_the_end_of_its_range_is_brought_together(tmp_path: Path) -> None:
    truth = 170 + np.linspace(0.0, 40.0, 20).reshape(4, 5)
    wrapped = (truth + 180) % 360 - 180
    image = read_image(gwy_file(tmp_path / "scan.gwy", ("Phase", wrapped, "deg", (4e-7, 5e-7), {})))
    assert np.ptp(image["phase"].values) == pytest.approx(40)  # and not 358
    assert image["phase"].values == pytest.approx(truth - 360)  # where most of it was


def test_without_the_extra_it_says_how_to_install_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gwyddionpy", None)
    (tmp_path / "scan.nid").write_text("something")
    with pytest.raises(
        PhasemapError, match=r"measured files needs 'gwyddionpy': run pip install \"afm-phasemap\[read\]"
    ):
        read_image(tmp_path / "scan.nid")


# How it was scanned.


@needs_reader
def test_a_nanosurf_file_tells_its_scan_in_si(flake: xr.Dataset) -> None:
    known = {"drive_frequency": 172823.0, "setpoint": 0.5, "free_amplitude_voltage": 0.25, "stiffness": 48.0}
    for name, value in known.items():
        assert flake.attrs[name] == pytest.approx(value), name
    assert flake.attrs["line_rate"] == pytest.approx(1 / (2 * 0.680))
    assert "free_amplitude" not in flake.attrs and "The free amplitude is 0.25 V" in flake.attrs["warnings"]
    assert json.loads(flake.attrs["vendor_metadata"])["Image size"] == "3.97µm"
    assert (flake.attrs["operating_mode"], flake.attrs["source"]) == ("Phase Contrast", "MoS2.nid")


@needs_reader
def test_the_resonance_of_a_catalogue_is_not_that_of_the_lever(flake: xr.Dataset) -> None:
    assert "resonance_frequency" not in flake.attrs and flake.attrs["nominal"].split() == [
        "stiffness",
        "quality_factor",
    ]
    assert "nominal values of levers of type ACL-A, whose 190 kHz" in flake.attrs["warnings"]
    calibrated = read_image(example("Plane_Removal/grid.nid")).attrs
    assert "nominal" not in calibrated
    found = [calibrated[name] for name in ("stiffness", "resonance_frequency", "quality_factor")]
    assert found == pytest.approx([24.075, 170037.0, 546.786])


ASYLUM = {
    "ImagingMode": "AC Mode", "DriveFrequency": "74243", "FreeAirAmplitude": "0.8", "FreeAirPhase": "90.417",
    "AmpInvOLS": "5e-08", "SpringConstant": "2.1", "ThermalFrequency": "74100", "ThermalQ": "180", "ScanRate": "1.0016",
    "IntegralGain": "114.5", "SlowScanSize": "2e-05", "FastScanSize": "1e-05",
}  # fmt: skip


def test_an_asylum_file_tells_its_scan_in_si(tmp_path: Path) -> None:
    note = tmp_path / "scan.ibw"
    note.write_bytes(
        b"\x05\x00 wave \rAmplitudeSetpointMeters: 1e-08\rAmplitudeSetpointVolts: 0.6\rPhaseOffset:153.77\r"
    )
    scan = scan_data(note, ASYLUM | {"Date": "2019-10-24"})
    assert (scan.values["lock_in_phase"], scan.values["day"]) == (153.77, 18193.0)
    assert scan.values["setpoint"] == pytest.approx(0.75)
    assert scan.values["free_amplitude"] == pytest.approx(40e-9)
    assert scan.values["setpoint_amplitude"] == pytest.approx(30e-9)
    assert [scan.values[name] for name in ("stiffness", "resonance_frequency", "quality_factor")] == [
        2.1,
        74100.0,
        180.0,
    ]
    assert scan.values["phase_zero"] == 90.417 and scan.values["line_rate"] == 1.0016
    assert scan.size == (2e-5, 1e-5) and scan.warnings == []


def test_what_a_vendor_fills_in_by_default_is_no_calibration() -> None:
    defaults = {"AmpInvOLS": "1.09e-07", "SpringConstant": "1", "ThermalFrequency": "75000", "ThermalQ": "20"}
    scan = scan_data(NOWHERE, ASYLUM | defaults)
    for name in ("free_amplitude", "stiffness", "resonance_frequency", "quality_factor", "amplitude_sensitivity"):
        assert name not in scan.values, name
    for key in defaults:
        assert any(said.startswith(f"{key} = ") and "default, not a calibration" in said for said in scan.warnings)
    tuned = scan_data(NOWHERE, ASYLUM | defaults | {"TuneFreqResult": "74215", "TuneQResult": "144.93"})
    assert (tuned.values["resonance_frequency"], tuned.values["quality_factor"]) == (74215.0, 144.93)


def test_a_nanoscope_file_tells_its_scan_in_si() -> None:
    metadata = {
        "MicroscopeList": "Tapping", "2:CantFrequency": "157.6600 kHz", "3:CantFrequency": "0.5000000 kHz",
        "2:TMSetAmplitude": "246.8933 mV", "Sens. AmplSens": "62.00000 nm/V", "2:TMFbIgain": "0.9363428 ",
        "2:TMFbPgain": "9.351343 ", "Scan Rate": "0.746607",
    }  # fmt: skip
    scan = scan_data(NOWHERE, metadata)
    assert scan.values["drive_frequency"] == pytest.approx(157.66e3)
    assert scan.values["setpoint_amplitude"] == pytest.approx(0.2468933 * 62e-9)
    assert "setpoint" not in scan.values and "free amplitude that NanoScope files do not record" in scan.warnings[0]
    uncalibrated = scan_data(NOWHERE, metadata | {"Sens. AmplSens": "1.000000 "})
    assert "setpoint_amplitude" not in uncalibrated.values and uncalibrated.values["setpoint_voltage"] == 0.2468933


def test_jpk_and_park_tell_what_gwyddion_says_of_them() -> None:
    jpk = {"Feedback Mode": "intermittent", "Feedback Frequency": "312.500 kHz", "Feedback Setpoint": "750.000 mV"}
    values = scan_data(NOWHERE, jpk).values
    assert (values["drive_frequency"], values["setpoint_voltage"]) == pytest.approx((312.5e3, 0.75))
    assert scan_data(NOWHERE, {"Image mode": "NC-AFM", "Scan rate": "0.5 s<sup>-1</sup>"}).values == {"line_rate": 0.5}


def test_a_number_outside_all_practice_is_doubted_and_left_out() -> None:
    scan = scan_data(NOWHERE, {"Image mode": "Tapping", "Set point": "13.5 um"})
    assert "setpoint_amplitude" not in scan.values
    assert any(
        "setpoint amplitude 13.5 µm, which is outside the usual range (50 pm to 1 µm)" in one for one in scan.warnings
    )
    assert scan_data(NOWHERE, {"Image mode": "Tapping", "Set point": "13.5 nm"}).values["setpoint_amplitude"] == 13.5e-9
    assert "setpoint" not in scan_data(NOWHERE, {"Op. mode": "Dynamic Force", "Setpoint": "250 %"}).values


def test_gains_and_drive_of_older_nanoscope_files_are_read() -> None:
    old = {"MicroscopeList": "Tapping", "Integral gain": "0.4", "Proportional gain": "0.6", "2:CantDrive": "112.6 mV"}
    values = scan_data(NOWHERE, old | {"Date": "09:57:48 AM Tue Jan 12 2016", "2:CantPhase": "-121.8 °"}).values
    assert (values["lock_in_phase"], values["day"]) == (-121.8, 16812.0)
    assert (values["integral_gain"], values["proportional_gain"], values["drive_voltage"]) == pytest.approx(
        (0.4, 0.6, 0.1126)
    )


def test_asylum_counts_lag_positive_and_says_so() -> None:
    assert scan_data(NOWHERE, {"ImagingMode": "AC Mode"}).values["phase_sign"] == -1


@needs_reader
@pytest.mark.parametrize(
    ("name", "content", "what"),
    [
        (
            "curve.ibw",
            b"\x05\0" + bytes(130) + (512).to_bytes(4, "little") + bytes(400),
            "a curve of 512 points, not an image.",
        ),
        ("notes.gwy", b"Measured on Monday, at 40 N/m.\n", "text, with no image in it."),
        ("scan.jpk", b"<!DOCTYPE html><html>404</html>", "a web page, as a download leaves it that failed."),
        ("force.001", b"\\*Force file list\r\n" + bytes(300), "a force curve of NanoScope, not an image (read_curve)."),
        ("tune.nid", b"[DataSet]\nDim0Name=Frequency\n", "a resonance curve, not an image."),
        ("map.jpk-force-map", b"PK\x03\x04" + bytes(64), "an archive, as JPK keeps curves (read_curve), not an image."),
        ("scan.h5-jpk", b"\x89HDF\r\n\x1a\n" + bytes(64), "an HDF5 file of a kind that Gwyddion does not read."),
        ("scan.spm", b"\x1f\x8b" + bytes(64), "compressed: unpack it first."),
    ],
)
def test_a_file_of_another_kind_is_called_what_it_is(tmp_path: Path, name: str, content: bytes, what: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(FileError, match=re.escape(f"it is {what}")):
        read_image(tmp_path / name)


def test_a_setpoint_that_is_no_percentage_is_no_ratio() -> None:
    nanosurf = {"Op. mode": "Dynamic Force", "Vibration freq.": "170 kHz"}
    assert "setpoint" not in scan_data(NOWHERE, nanosurf | {"Setpoint": "0.25 V"}).values
    assert scan_data(NOWHERE, nanosurf | {"Set point": "61 %"}).values["setpoint"] == 0.61


def test_a_wsxm_file_tells_its_scan_in_si() -> None:
    metadata = {  # of a file of the AFMReader project
        "General Info::Head type": "AFM", "General Info::Force constant": "21 N/m", "Control::X-Frequency": "1.085 Hz",
        "Dynamic settings::Resonance frequency": "291799 Hz", "Dynamic settings::Quality factor (Q)": "508.711",
        "Feedback settings::Input channel": "Amplitude", "Feedback settings::Integral": "9.4976",
    }  # fmt: skip
    scan = scan_data(NOWHERE, metadata)
    expected = {"stiffness": 21.0, "resonance_frequency": 291799.0, "quality_factor": 508.711, "line_rate": 1.085}
    assert {name: scan.values[name] for name in expected} == expected and scan.nominal == ["stiffness"]
    assert operating_mode(NOWHERE, metadata) == "Amplitude"
    with pytest.raises(FileError, match="in the mode 'Normal force'"):
        operating_mode(NOWHERE, metadata | {"Feedback settings::Input channel": "Normal force"})


def test_older_asylum_files_number_their_modes() -> None:
    assert operating_mode(NOWHERE, {"ImagingMode": "1"}) == "AC Mode"
    with pytest.raises(FileError, match="in the mode 'Contact'"):
        operating_mode(NOWHERE, {"ImagingMode": "0"})


# Simulated images.


def test_a_simulated_image_tells_its_scan_too(tmp_path: Path) -> None:
    lever, drive = pm.Cantilever(40.0, 300e3, 400.0), pm.Drive(20e-9, 299.5e3)
    scope = pm.Microscope(lever, pm.Tip(10e-9), drive)
    surface = pm.Surface(1e9, adhesion=0.05, pixel_size=(2e-9, 4e-9), shape=(2, 3))
    image = pm.simulate(surface, scope, setpoint=0.7, solver="averaging")
    image.to_netcdf(tmp_path / "image.nc")
    read = read_image(tmp_path / "image.nc")
    assert read.equals(image)
    assert read.attrs["free_amplitude"] == pytest.approx(scope.driven_amplitude, rel=1e-12)
    assert read.attrs["drive_frequency"] == 299.5e3 and read.attrs["setpoint"] == 0.7
    # Below resonance the free lever lags less than 90 degrees behind; the phase is 90 less the lag.
    ratio = 299.5 / 300
    assert read.attrs["phase_zero"] == pytest.approx(90 - np.degrees(np.arctan2(ratio / 400, 1 - ratio**2)))


def test_a_netcdf_file_that_is_no_image_is_refused(tmp_path: Path) -> None:
    xr.Dataset({"phase": ("time", [1.0])}).to_netcdf(tmp_path / "curve.nc")
    with pytest.raises(FileError, match=r"no height or phase over \('y', 'x'\); it holds phase over \('time',\)"):
        read_image(tmp_path / "curve.nc")


def foreign(**attrs: str) -> xr.Dataset:
    """An image as other programs keep it: in nm and radian, y counted upwards, x before y."""
    values = np.arange(12.0).reshape(3, 4)
    image = xr.Dataset(
        {"height": (("y", "x"), values, {"units": "nm"}), "phase": (("y", "x"), 0.1 * values, {"units": "rad"})},
        {"y": ("y", [50.0, 30.0, 10.0], {"units": "nm"}), "x": ("x", [5.0, 15.0, 25.0, 35.0], {"units": "nm"})},
        attrs,
    )
    return image.transpose("x", "y")


def test_an_image_of_another_program_is_brought_to_metres_and_degrees(tmp_path: Path) -> None:
    foreign(configuration="theirs").to_netcdf(tmp_path / "image.nc")
    image = read_image(tmp_path / "image.nc")
    values = np.arange(12.0).reshape(3, 4)
    assert image["height"].values == pytest.approx(1e-9 * values) and image["height"].dims == ("y", "x")
    assert image["phase"].values == pytest.approx(np.degrees(0.1 * values))
    assert [image[name].attrs["units"] for name in ("height", "phase", "y", "x")] == ["m", "degree", "m", "m"]
    assert image["y"].values == pytest.approx([5e-8, 3e-8, 1e-8])
    assert image["x"].values == pytest.approx([5e-9, 15e-9, 25e-9, 35e-9])
    rising = foreign().assign_coords(y=foreign()["y"].values[::-1] * 1e-9)  # as earlier versions of phasemap had it
    rising.to_netcdf(tmp_path / "rising.nc")
    xr.testing.assert_allclose(read_image(tmp_path / "rising.nc"), image)
    mirrored = foreign().assign_coords(x=foreign()["x"].copy(data=foreign()["x"].values[::-1]))
    mirrored.to_netcdf(tmp_path / "mirrored.nc")
    assert read_image(tmp_path / "mirrored.nc")["height"].values == pytest.approx(1e-9 * values[:, ::-1])


def test_an_image_without_units_or_places_is_not_taken_in_silence(tmp_path: Path) -> None:
    image = foreign()
    image["phase"].attrs["units"] = "V"
    image.to_netcdf(tmp_path / "volts.nc")
    with pytest.raises(FileError, match=r"volts.nc: phase is in 'V', not an angle\.$"):
        read_image(tmp_path / "volts.nc")
    foreign().drop_vars("y").to_netcdf(tmp_path / "nowhere.nc")
    with pytest.raises(FileError, match="there is no coordinate y, the places of pixels in m"):
        read_image(tmp_path / "nowhere.nc")
    foreign()[["height"]].drop_attrs().to_netcdf(tmp_path / "numbers.nc")
    with pytest.warns(pm.ResultWarning, match=r"numbers.nc a pixel along y is 20 m; plausible: at most 1 mm\."):
        image = read_image(tmp_path / "numbers.nc")
    assert "no units of height: taken as m" in image.attrs["warnings"] and "is 20 m" in image.attrs["warnings"]


@pytest.mark.parametrize(
    ("places", "reason"),
    [
        ([0.0, np.nan, 2e-9, 3e-9], "coordinate x is not increasing"),
        ([1e-9] * 4, "coordinate x is not increasing"),
        ([0.0, 1e-9, 5e-9, 6e-9], "spacing of x is '1e-09 to 4e-09'; allowed: the same between all pixels"),
    ],
)
def test_places_that_are_no_even_steps_are_refused(tmp_path: Path, places: list[float], reason: str) -> None:
    foreign().assign_coords(x=("x", places, {"units": "m"})).to_netcdf(tmp_path / "image.nc")
    with pytest.raises(FileError, match=f"cannot use .*image.nc: {reason}"):
        read_image(tmp_path / "image.nc")


@needs_reader
@pytest.mark.parametrize(("name", "factor", "what"), [("height", 1e7, "the relief"), ("x", 1e8, "a pixel along x")])
def test_lengths_that_no_microscope_reaches_are_refused(tmp_path: Path, name: str, factor: float, what: str) -> None:
    image = xr.Dataset({"height": (("y", "x"), 1e-9 * np.eye(2))}, {"y": [3e-9, 1e-9], "x": [1e-9, 3e-9]})
    damaged = image.assign({name: image[name] * factor})
    with pytest.raises(FileError, match=rf"cannot use .*: {what} is .* m; plausible: at most 1 mm\."):
        read_image(pm.export(damaged, tmp_path / "damaged.gwy"))


@needs_reader
def test_a_refusal_has_an_end_however_much_a_file_holds(tmp_path: Path) -> None:
    names = {f"{'much' * 200}{n}": (("y", "x"), np.eye(2), {"units": "V"}) for n in range(90)}
    pm.export(xr.Dataset(names, {"y": [3e-9, 1e-9], "x": [1e-9, 3e-9]}), tmp_path / "many.gwy")
    with pytest.raises(FileError, match="there is neither height nor phase") as caught:
        read_image(tmp_path / "many.gwy")
    assert len(str(caught.value)) < 2100


@needs_reader
def test_a_jpk_tag_of_several_numbers_is_passed_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tifffile = pytest.importorskip("tifffile")
    jpk_file(tmp_path / "scan.jpk")
    whole = tifffile.TiffTag.value.fget
    monkeypatch.setattr(tifffile.TiffTag, "value", property(lambda tag: (3, 3) if tag.code == 0x8080 else whole(tag)))
    assert "amplitude_sensitivity" not in read_image(tmp_path / "scan.jpk").attrs


# Through xarray.


def test_xarray_finds_the_backend_by_its_entry_point() -> None:
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
    module, _, name = project["entry-points"]["xarray.backends"]["phasemap"].partition(":")
    backend = getattr(importlib.import_module(module), name)()
    assert isinstance(backend, xr.backends.BackendEntrypoint)
    for file in ("scan.nid", "SCAN.IBW", Path("grains.001"), "image.gwy"):
        assert backend.guess_can_open(file), file
    for file in ("image.nc", "photo.tiff", b"bytes", "scan.v1"):
        assert not backend.guess_can_open(file), file


@needs_reader
def test_xarray_opens_a_microscopes_file(flake: xr.Dataset) -> None:
    from phasemap.io.backend import PhasemapBackend

    opened = xr.open_dataset(example("Plotting_Data/MoS2.nid"), engine=PhasemapBackend, drop_variables="amplitude")
    assert opened.identical(flake.drop_vars("amplitude"))


@needs_reader
def test_a_measured_image_keeps_everything_in_netcdf(flake: xr.Dataset, tmp_path: Path) -> None:
    flake.to_netcdf(tmp_path / "flake.nc")
    assert read_image(tmp_path / "flake.nc").identical(flake)
