"""The command line: one command gives an image, and what is wrong is said in one sentence."""

from __future__ import annotations

import io
import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import phasemap.scenes.scene
import phasemap.sweeps.sweep
from phasemap.cli import main
from phasemap.cli.sweeps import said_of_contrast, said_of_sweep
from phasemap.io.netcdf import load
from phasemap.io.read import read_image
from phasemap.plot.colours import colour_scale

SAMPLES = Path(__file__).parents[2] / "samples"
STEP = str(SAMPLES / "step.toml")
SMALL = "surface.shape=[6, 8]"
STIFF = ("--material", "stiff")
GENTLE = "drive.free_amplitude=16e-9"  # low enough for two regimes


def fails(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The sentence on stderr of a command that must fail with exit code 2."""
    try:
        code = main(arguments)
    except SystemExit as stopped:
        code = int(stopped.code or 0)
    said = capsys.readouterr()
    assert code == 2 and said.out == ""
    assert said.err.startswith("phasemap: ") and said.err.count("\n") == 1 and "Traceback" not in said.err
    return said.err


def test_run_writes_the_image_that_python_gives(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "step.nc"
    assert main(["run", STEP, SMALL, "-o", str(output), "scan.setpoint=0.6"]) == 0
    said = capsys.readouterr()
    for line in (
        "image       8 x 6 pixels, 16 x 12 nm",
        "materials   2 distinct",
        "setpoint    0.6 of 40 nm",
        "modelled    dmt contact; inverse-square attraction; damping with depth^0.5; topography",
        "failed      none",
        f"written to  {output}",
    ):
        assert line in said.out.splitlines()
    assert re.search(r"^phase +\S+ to \S+ degrees$", said.out, re.MULTILINE)
    image = load(output)
    python = phasemap.scenes.scene.load_scene(STEP, [SMALL, "scan.setpoint=0.6"]).simulate()
    for name, variable in python.variables.items():
        assert image[name].values.tobytes() == variable.values.tobytes(), name
    assert json.loads(image.attrs["scene"])["scan"]["setpoint"] == 0.6


def test_irregular_motion_is_counted_in_words_and_dotted_in_the_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Rubber that sticks to the tip in some periods only, beside glass."""
    rubber = ["materials.compliant.modulus=30e6", "materials.compliant.adhesion=0.05", "cantilever.stiffness=3.0"]
    scene = [STEP, SMALL, *rubber, "interaction.contact=jkr", "cantilever.quality_factor=200.0", "scan.setpoint=0.6"]
    output = tmp_path / "rubber.nc"
    assert main(["run", *scene, "-o", str(output)]) == 0
    said = capsys.readouterr().out
    spread = r"spread up to \S+ pm and 0\.0\d+ degrees"
    counted = rf"^motion      24 of 48 pixels \(50 %\) irregular: mean amplitude and phase, {spread}$"
    assert re.search(counted, said, re.MULTILINE)
    assert "failed      none" in said.splitlines()
    assert main(["plot", str(output), "--mark-irregular", "-o", str(tmp_path / "dots.png")]) == 0
    assert main(["plot", str(output), "-o", str(tmp_path / "plain.png")]) == 0
    assert (tmp_path / "dots.png").read_bytes() != (tmp_path / "plain.png").read_bytes()


def test_the_number_of_threads_does_not_change_a_bit(tmp_path: Path) -> None:
    for threads in ("1", "2"):
        assert main(["run", STEP, SMALL, "-o", str(tmp_path / f"{threads}.nc"), "--threads", threads, "--quiet"]) == 0
    one, two = (load(tmp_path / f"{threads}.nc") for threads in ("1", "2"))
    for name in one.data_vars:
        assert one[name].values.tobytes() == two[name].values.tobytes(), name


def test_run_says_the_regimes_and_that_materials_look_alike(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    gentle = [STEP, SMALL, "scan.solver=averaging", "drive.free_amplitude=5 nm"]
    assert main(["run", *gentle, "-o", str(tmp_path / "gentle.nc")]) == 0
    said = capsys.readouterr().out
    assert "regime      attractive\n" in said
    assert (
        "alike       the phases of the 2 materials are within " in said
        and "`phasemap contrast` finds a setpoint" in said
    )
    assert main(["run", *gentle[:3], "-o", str(tmp_path / "hard.nc")]) == 0
    said = capsys.readouterr().out
    assert "regime      repulsive\n" in said and "alike" not in said
    height = load(tmp_path / "hard.nc")["height"].values
    assert f"height      0 to {1e9 * np.ptp(height):.4g} nm above the lowest pixel\n" in said
    assert colour_scale(load(tmp_path / "hard.nc")["height"]).offset == height.min()  # the zero of the picture


def test_a_letter_that_a_terminal_lacks_stops_no_command(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.setattr(sys, "stdout", stream)
    assert main(["presets", "PS"]) == 0
    stream.seek(0)
    assert "J/m?" in stream.read()


def test_quiet_says_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", STEP, SMALL, "--quiet", "-o", str(tmp_path / "step.nc")]) == 0
    assert capsys.readouterr() == ("", "")


def test_the_output_may_be_named_in_the_scene(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(Path(STEP).read_text() + '[output]\nfile = "from_scene.nc"\n')
    assert main(["run", str(scene), SMALL, "--quiet"]) == 0
    assert (tmp_path / "from_scene.nc").exists()
    assert "give -o OUT.nc, or file under [output]" in fails(capsys, "run", STEP)


def test_an_existing_output_is_refused_before_anything_is_simulated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    output = tmp_path / "step.nc"
    output.write_text("precious")
    with monkeypatch.context() as patch:
        patch.setattr(phasemap.scenes.scene.Scene, "simulate", None)
        assert "exists already; --overwrite replaces it." in fails(capsys, "run", STEP, SMALL, "-o", str(output))
        missing = str(tmp_path / "no" / "step.nc")
        assert "the folder" in fails(capsys, "run", STEP, SMALL, "-o", missing)
    assert output.read_text() == "precious"
    assert main(["run", STEP, SMALL, "-o", str(output), "--overwrite", "--quiet"]) == 0
    assert load(output).sizes == {"y": 6, "x": 8}


@pytest.mark.parametrize(("answer", "code"), [("y\n", 0), ("\n", 2)])
def test_on_a_terminal_a_command_that_is_repeated_asks_whether_its_output_may_be_replaced(
    answer: str, code: int, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    output = tmp_path / "step.nc"
    output.write_text("of the last run")
    monkeypatch.setattr(sys, "stdin", io.StringIO(answer))
    for stream in (sys.stdin, sys.stderr):
        monkeypatch.setattr(stream, "isatty", lambda: True)
    assert main(["run", STEP, SMALL, "-o", str(output), "--quiet"]) == code
    assert "step.nc: it exists already;" in (said := capsys.readouterr().err) and "Replace it now? [y/N]" in said
    assert (output.read_bytes() == b"of the last run") == (code == 2)


def image_with_failures(*_: Any, **__: Any) -> xr.Dataset:
    status = np.zeros((6, 8), np.int8)
    status[0, :3], status[1, 0] = 1, 2
    values = np.where(status == 0, 1.0, np.nan)
    axes = {"y": 2e-9 * np.arange(6), "x": 2e-9 * np.arange(8)}
    return xr.Dataset(
        {"height": (("y", "x"), values), "phase": (("y", "x"), values), "status": (("y", "x"), status)},
        axes,
        {"modelled": "dmt contact"},
    )


def test_failed_pixels_are_counted_with_advice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(phasemap.scenes.scene.Scene, "simulate", image_with_failures)
    assert main(["run", STEP, SMALL, "-o", str(tmp_path / "step.nc")]) == 0
    out = capsys.readouterr().out
    assert "failed      3 of 48 pixels (6.25 %): No stable orbit has the setpoint amplitude" in out
    assert "failed      1 of 48 pixels (2.08 %): The solver did not converge" in out


def test_an_interrupt_leaves_nothing_and_ends_with_130(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(phasemap.scenes.scene.Scene, "simulate", interrupted)
    assert main(["run", STEP, "-o", str(tmp_path / "step.nc")]) == 130
    assert capsys.readouterr().err == "phasemap: interrupted; nothing was written.\n"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (MemoryError(), "not enough memory"),
        (OSError(28, "No space left on device", "step.nc"), "the disk is full: step.nc."),
        (OSError("odd"), "odd."),
    ],
)
def test_what_goes_wrong_outside_is_said_in_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, error: Exception, sentence: str
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(phasemap.scenes.scene.Scene, "simulate", broken)
    assert sentence in fails(capsys, "run", STEP, "-o", str(tmp_path / "step.nc"))


def test_a_free_amplitude_that_is_not_that_of_the_scene_is_explained(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["validate", STEP, "drive.excitation=base", "drive.frequency=304e3"]) == 0
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("setpoint")]
    assert re.fullmatch(
        r"setpoint    0.7 of 3\.\d+ nm, which the free lever shows at the drive frequency "
        r"\(free_amplitude, 40 nm, is its first mode's at resonance\)",
        line,
    )


def test_validate_says_what_would_be_simulated(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["validate", STEP, "drive.free_amplitude=20e-9"]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "image       256 x 128 pixels, 512 x 256 nm",
        "materials   2 distinct",
        "compliant   modulus 200 MPa, adhesion 0.06 J/m², damping 0.03, poisson ratio 0.45",
        "stiff       modulus 3 GPa, adhesion 0.08 J/m², damping 0.005",
        "lever       stiffness 40 N/m, resonance frequency 300 kHz, quality factor 400",
        "modelled    dmt contact; inverse-square attraction; damping with depth^0.5; topography",
        "setpoint    0.7 of 20 nm",
        "solver      auto",
        "control     tip lowered onto each pixel (no memory of its neighbours)",
        "output      to be named with -o",
        "The scene is valid.",
    ]


def test_a_material_that_no_pixel_is_of_is_said_to_be_in_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(Path(STEP).read_text() + "[materials.third]\nmodulus = 1e9\n")
    assert main(["validate", str(path)]) == 0
    said = capsys.readouterr().out.splitlines()
    assert "third       modulus 1 GPa; in no pixel" in said
    assert sum("in no pixel" in line for line in said) == 1


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["validate", "nowhere.toml"], "cannot read the scene nowhere.toml: No such file or directory."),
        (
            ["validate", STEP, "drive.frequncy=1"],
            "[drive] frequncy is unknown; allowed: free_amplitude, frequency, excitation, second.",
        ),
        (
            ["validate", STEP, "interaction.contact=capillary", "control.kind=raster"],
            "control is 'Raster'; allowed: Engage or Feedback where contacts remember or are wet. Raster goes from ",
        ),
        (["validate", STEP, "scan.setpoint=1.2"], "[scan] setpoint is 1.2; allowed: a number above 0 and below 1 (the"),
        (["validate", STEP, "setpoint"], "override is 'setpoint'; allowed: table.key=value"),
        (["validate", STEP, "--fast"], "unknown argument '--fast'"),
        (["run", STEP, "-o", "x.nc", "--threads", "0"], "'0' is not a whole number of at least 1"),
        (["run", STEP, "-o", "x.nc", "--threads", "-2"], "--threads"),
        (["plot", "nowhere.nc", "-o", "x.png"], "cannot read nowhere.nc: there is no such file."),
        (["plot", STEP, "-o", "x.png"], "step.toml is a scene: phasemap run "),
        (["plot", __file__, "-o", "x.png"], "it is text, with no image in it"),
        (["run", STEP, "-o", "x.png"], "the output's suffix is '.png'; allowed: .nc, for it becomes a netCDF file."),
        (["run", STEP, "-o", "x.toml", "--overwrite"], "'.toml'; allowed: .nc, for it becomes a netCDF file. A scene"),
        (["run", STEP, "-o", "x" * 243 + ".nc"], "its name is longer than 230 bytes; choose a shorter one."),
        (["plot", "a=b"], "cannot read a=b: there is no such file."),
        (["draw", "image.nc"], "the command is 'draw'; allowed: one of run, plot, "),
        (["rnu", "image.nc"], "Did you mean 'run'?"),
        (["run"], "required: SCENE.toml; see phasemap run --help"),
        (["sweep"], "required: SCENE.toml, AXIS; see phasemap sweep --help"),
        (["fit"], "required: FILE; see phasemap fit --help"),
        (["sweep", STEP, "distance", "--material", "STIFF"], "Did you mean 'stiff'?"),
        (["contrast", STEP, "--materials", "Compliant,stiff"], "Did you mean 'compliant'?"),
        (["sweep", STEP, "distance"], "several materials: choose one with --material: compliant, stiff."),
        (["sweep", STEP, "distance", *STIFF[:-1], "stif"], "'stif'; allowed: one of compliant, stiff. Did you mean"),
        (["sweep", STEP, "modulos"], "AXIS is 'modulos'; allowed: one of distance, setpoint, frequency, modulus"),
        (["sweep", STEP, "distance", *STIFF, "20e-9"], "START STOP is '20e-9'; allowed: both of them or none, or"),
        (
            ["sweep", STEP, "distance", *STIFF, "20kHz", "0"],
            "START or STOP is '20kHz'; allowed: a number in SI units, or",
        ),
        (
            ["sweep", STEP, "distance", *STIFF, "2nm:1nm:1"],
            "START:STOP:N is '2nm:1nm:1'; allowed: a number in SI units",
        ),
        (["sweep", STEP, "frequency", *STIFF, "--tip-offset", "5V"], "argument --tip-offset: '5V' is no number in m"),
        (["sweep", STEP, "distance", *STIFF, "1e-9", "1e-9"], "allowed: two different finite numbers"),
        (["sweep", STEP, "distance", *STIFF, "--log", "20e-9", "-1e-9"], "two numbers above 0, for --log"),
        (["sweep", STEP, "distance", *STIFF, "--setpoint", "0.5"], "--setpoint does not go with distance"),
        (["sweep", STEP, "frequency", *STIFF, "--setpoint", "0.5", "--tip-offset", "1e-9"], "not allowed with"),
        (["sweep", STEP, "frequency", *STIFF, "--setpoint", "1.5"], "setpoint is 1.5; allowed: a number above 0"),
        (["sweep", STEP, "setpoint", *STIFF, "1.2", "0.5"], "setpoint is 1.2; allowed: a number above 0"),
        (["contrast", STEP, "--setpoints", "0.7"], "--setpoints is '0.7'; allowed: START:STOP:N with N of at least 2"),
        (["sweep", STEP, "bias", *STIFF], "START and STOP are missing: the scene's bias suggests no range."),
        (["sweep", STEP, "distance", *STIFF, "-n", "1"], "--points is 1; allowed: a whole number of at least 2"),
        (["sweep", STEP, "distance", *STIFF, "--samples", "-1"], "samples is -1; allowed: a whole number from 0"),
        (["sweep", STEP, "distance", *STIFF, "tip.radus=1e-9"], "[tip] radus is unknown"),
        (["sweep", STEP, "distance", *STIFF, "--fast"], "unknown argument '--fast'"),
        (["sweep", STEP, "distance", *STIFF, "--plot", "x.bild"], "the picture's suffix is '.bild'"),
        (["plot", "nowhere.nc", "--trace", "1", "--quantities", "phase"], "not allowed with"),
        ([], "required: COMMAND; see phasemap --help"),
    ],
)
def test_what_cannot_be_used_is_said_in_one_sentence(
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    arguments: list[str],
    sentence: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert sentence in fails(capsys, *arguments)
    assert list(tmp_path.iterdir()) == []


def test_a_file_of_a_microscope_is_drawn_and_exported_with_its_lag(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("gwyddionpy")
    pytest.importorskip("gwyfile")
    image, measured, turned = (tmp_path / name for name in ("image.nc", "measured.gwy", "turned.gwy"))
    assert main(["run", STEP, SMALL, "-o", str(image), "--quiet"]) == 0
    assert main(["export", str(image), str(measured)]) == main(["export", str(image), str(turned), "--lag"]) == 0
    plain, lag = (read_image(path)["phase"].values for path in (measured, turned))
    np.testing.assert_allclose(lag, 90 - plain, atol=1e-5)
    assert main(["plot", str(measured)]) == 0
    assert (tmp_path / "measured.png").read_bytes().startswith(b"\x89PNG")


def test_plot_draws_beside_the_image_and_does_not_overwrite_unasked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    image_with_failures().to_netcdf(tmp_path / "image.nc")
    assert main(["plot", str(tmp_path / "image.nc")]) == 0
    assert (tmp_path / "image.png").read_bytes().startswith(b"\x89PNG")
    assert capsys.readouterr().out == f"written to  {tmp_path / 'image.png'}\n"
    assert "exists already" in fails(capsys, "plot", str(tmp_path / "image.nc"))
    assert main(["plot", str(tmp_path / "image.nc"), "--overwrite", "-o", str(tmp_path / "image.png")]) == 0


def swept(tmp_path: Path, *arguments: str) -> xr.Dataset:
    """What `phasemap sweep` writes about the stiff half of the step."""
    output = tmp_path / "sweep.nc"
    command = ["sweep", STEP, arguments[0], *STIFF, "-o", str(output), "--overwrite", "-n", "12", *arguments[1:]]
    assert main(command) == 0
    return load(output)


def test_a_sweep_is_what_python_gives(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "sweep.png"
    ds = swept(tmp_path, "distance", "20 nm:8 nm:12", GENTLE, "--samples", "16", "--plot", str(picture))
    setup = phasemap.scenes.scene.load_setup(STEP, [GENTLE])
    python = phasemap.sweep_distance(
        setup.materials["stiff"], setup.microscope, np.linspace(20e-9, 8e-9, 12), samples=16
    )
    for name, variable in python.variables.items():
        assert ds[name].values.tobytes() == variable.values.tobytes(), name
    assert picture.read_bytes().startswith(b"\x89PNG")
    said = capsys.readouterr().out.splitlines()
    for line in (
        "title       stiff of step.toml",
        "material    modulus 3 GPa, adhesion 0.08 J/m², damping 0.005",
        "microscope  lever 40 N/m, 300 kHz, Q 400, tip radius 10 nm, free amplitude 16 nm",
        "swept       tip offset 20 nm to 8 nm, 12 values, approach and retract",
        "failed      none",
        f"written to  {tmp_path / 'sweep.nc'}",
        f"written to  {picture}",
    ):
        assert line in said
    assert sum(line.startswith("fold        at ") for line in said) == ds.sizes["fold"] == 2
    jumps = [line for line in said if line.startswith("jump        ")]
    assert re.fullmatch(
        r"jump        approach at 1\d\.\d+ nm: amplitude \S+ to \S+ nm, phase -\S+ to \S+ degrees", jumps[0]
    )
    assert len(jumps) == 2
    nowhere = said_of_sweep(ds.assign({name: np.nan * ds[name] for name in ds if str(name).startswith("jump_to_")}))
    (first, _) = [line for line in nowhere if line.startswith("jump        ")]
    assert re.search(r": amplitude \S+ nm, phase -\S+ degrees, to no steady motion$", first)


def test_a_sweep_of_the_setpoint_names_what_jumps_and_not_the_amplitude_that_is_held() -> None:
    setup = phasemap.scenes.scene.load_setup(STEP, [GENTLE])
    found = phasemap.sweep_setpoint(setup.materials["stiff"], setup.microscope, np.linspace(0.98, 0.5, 10))
    (jump, *_) = [line for line in said_of_sweep(found) if line.startswith("jump        ")]
    assert re.fullmatch(r"jump        down at 0\.\d+: tip offset \S+ to \S+ nm, phase -\S+ to \S+ degrees", jump)


def test_a_contrast_whose_sign_changes_by_less_than_is_seen_is_said_to_invert_nowhere_by_more() -> None:
    setup = phasemap.scenes.scene.load_setup(STEP)
    found = phasemap.contrast(*setup.materials.values(), setup.microscope, [0.7, 0.8], names=("a", "b"))
    for contrast, said in (([-144.0, 0.31], "nowhere by more than 0.5 degrees"), ([-144.0, -0.31], "nowhere")):
        shown = said_of_contrast(found.assign(contrast=("setpoint", contrast)))
        assert f"inverts     {said}" in shown


@pytest.mark.parametrize(
    ("axis", "first", "last"),
    [
        ("distance", 45e-9, 0.0),
        ("setpoint", 0.98, 0.1),
        ("frequency", 300e3 * (1 - 5 / 400), 300e3 * (1 + 5 / 400)),
        ("modulus", 3e9 / 10**0.5, 3e9 * 10**0.5),
        ("radius", 10e-9 / 10**0.5, 10e-9 * 10**0.5),
    ],
)
def test_a_sweep_knows_where_to_begin_and_end(tmp_path: Path, axis: str, first: float, last: float) -> None:
    ds = swept(tmp_path, axis, "--quiet")
    values = ds["tip_offset" if axis == "distance" else axis].values
    assert values[[0, -1]] == pytest.approx([first, last])


def test_a_frequency_sweep_stays_where_the_tip_is_engaged(tmp_path: Path) -> None:
    configuration = json.loads(swept(tmp_path, "frequency", "299e3", "301e3").attrs["configuration"])
    setup = phasemap.scenes.scene.load_setup(STEP)
    pixel = phasemap.solve_pixel(setup.materials["stiff"], setup.microscope, 0.7)
    assert configuration["tip_offset"] == pytest.approx(pixel.tip_offset, abs=1e-12)
    configuration = json.loads(swept(tmp_path, "frequency", "--tip-offset", "35 nm").attrs["configuration"])
    assert configuration["tip_offset"] == 35e-9


def test_a_parameter_sweep_holds_the_setpoint_or_the_tip_offset(tmp_path: Path) -> None:
    ds = swept(tmp_path, "adhesion", "0.02", "0.1", "--log", "--setpoint", "0.6")
    assert ds["amplitude"].values == pytest.approx(24e-9) and ds["adhesion"].values[1] == pytest.approx(
        0.02 * 5 ** (1 / 11)
    )
    assert swept(tmp_path, "adhesion", "0.02", "0.1", "--tip-offset", "20e-9")["tip_offset"].values == pytest.approx(
        20e-9
    )


def test_numbers_below_zero_and_words_in_any_order_are_understood(tmp_path: Path) -> None:
    ds = swept(tmp_path, "distance", "-1nm", "tip.radius=20nm", "--quiet", "5e-9")
    assert ds["tip_offset"].values[[0, -1]] == pytest.approx([-1e-9, 5e-9])
    assert json.loads(ds.attrs["configuration"])["microscope"]["tip"]["radius"] == 20e-9


def test_a_sweep_needs_neither_surface_nor_scan(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = Path(STEP).read_text().partition("[materials.stiff]")[2].partition("\n")[2]
    scene = tmp_path / "scene.toml"
    scene.write_text("[materials.only]\n" + text)
    assert main(["sweep", str(scene), "distance", "20e-9", "10e-9", "-n", "3"]) == 0
    assert capsys.readouterr().out.startswith("title       only of scene.toml")
    assert "the scene has no setpoint" in fails(capsys, "sweep", str(scene), "modulus")
    scene.write_text(text.partition("\n\n")[2])
    assert "the scene has no [materials]" in fails(capsys, "sweep", str(scene), "distance")


def test_files_of_a_sweep_are_not_overwritten_unasked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(phasemap.sweeps.sweep, "sweep_distance", None)
    for option, name in (("-o", "sweep.nc"), ("--plot", "sweep.png")):
        (tmp_path / name).write_text("precious")
        said = fails(capsys, "sweep", STEP, "distance", *STIFF, option, str(tmp_path / name))
        assert "exists already; --overwrite replaces it." in said


def test_plot_draws_a_sweep_its_quantities_and_its_traces(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    swept(tmp_path, "distance", GENTLE, "--samples", "16")
    for name, more in {"all": [], "some": ["--quantities", "phase, virial"], "one": ["--trace", "10e-9"]}.items():
        output = tmp_path / f"{name}.png"
        assert main(["plot", str(tmp_path / "sweep.nc"), "-o", str(output), *more]) == 0
        assert output.read_bytes().startswith(b"\x89PNG")
    capsys.readouterr()
    said = fails(capsys, "plot", str(tmp_path / "sweep.nc"), "-o", str(tmp_path / "x.png"), "--quantities", "phse")
    assert "quantities is 'phse'; allowed: some of amplitude" in said


def test_the_help_names_every_axis_and_parameter() -> None:
    from phasemap.cli.sweeps import SWEEP_EXAMPLES
    from phasemap.solvers.continuation.path import MATERIAL, PARTS

    assert all(re.search(rf"\b{name}\b", SWEEP_EXAMPLES) for name in (*MATERIAL, *PARTS))


def test_help_and_version_import_nothing_heavy() -> None:
    code = """
import sys
from phasemap.cli import main
try:
    main([{!r}])
except SystemExit as stopped:
    heavy = {{"numpy", "xarray", "numba", "matplotlib", "scipy", "tqdm"}} & set(sys.modules)
    sys.exit(f"{{heavy}}" if heavy else stopped.code)
"""
    for option, said in {"--help": "phasemap run samples/blend.toml -o blend.nc", "--version": "phasemap"}.items():
        done = subprocess.run([sys.executable, "-c", code.format(option)], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        assert said in done.stdout


@pytest.mark.slow
def test_python_m_phasemap_is_the_command() -> None:
    command = [sys.executable, "-m", "phasemap", "validate", STEP]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.endswith("The scene is valid.\n")
