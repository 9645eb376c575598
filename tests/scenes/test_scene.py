"""Scene files: what they mean, and one clear sentence for what they cannot mean."""

from __future__ import annotations

import json
import pickle
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import phasemap as pm
import phasemap.experiment.generate as generate
from phasemap._shared.errors import FileError, InputError
from phasemap.cli import main
from phasemap.experiment.accuracy import Accuracy
from phasemap.experiment.control import Engage
from phasemap.experiment.interaction import Interaction
from phasemap.experiment.material import Material
from phasemap.experiment.microscope import Cantilever, Drive, Microscope, Tip
from phasemap.experiment.realism import TYPICAL_SCAN, Realism
from phasemap.experiment.surface import Surface
from phasemap.scenes.scene import Scene, load_scene, scene_from_json

SAMPLES = Path(__file__).parents[2] / "samples"
HEAD = """
[scan]
setpoint = 0.7
[cantilever]
stiffness = 40
resonance_frequency = 300e3
quality_factor = 400
[tip]
radius = 10e-9
[drive]
free_amplitude = 40e-9
[materials.soft]
modulus = 0.5e9
adhesion = 0.05
damping = 0.02
[materials.hard]
modulus = 3e9
adhesion = 0.06
"""
LABELS = """
[surface]
kind = "labels"
labels = [[0, 1, 1], [0, 0, 1]]
materials = ["soft", "hard"]
pixel_size = 4e-9
"""
SOFT, HARD = Material(0.5e9, 0.05, 0.02), Material(3e9, 0.06)


def scene(folder: Path, text: str, *overrides: str) -> Scene:
    path = folder / "scene.toml"
    path.write_text(text, encoding="utf-8")
    return load_scene(path, overrides)


def test_a_scene_says_what_python_says(tmp_path: Path) -> None:
    made = scene(tmp_path, HEAD + LABELS)
    assert made.microscope == Microscope(Cantilever(40, 300e3, 400), Tip(10e-9), Drive(40e-9), Interaction())
    assert made.surface == Surface.from_labels([[0, 1, 1], [0, 0, 1]], {0: SOFT, 1: HARD}, pixel_size=4e-9)
    assert made.options == {
        "setpoint": 0.7,
        "solver": "auto",
        "control": Engage(),
        "accuracy": Accuracy(),
        "realism": Realism(),
        "variables": None,
    }
    assert made.output is None


def test_every_table_is_read(tmp_path: Path) -> None:
    more = """
    [interaction]
    contact = "hertz"
    damping_exponent = 1
    [control]
    kind = "engage"
    [accuracy]
    phase = 0.1
    [output]
    file = "image.nc"
    variables = ["height", "phase"]
    """
    made = scene(tmp_path, HEAD + LABELS + more, "scan.solver=orbit", "tip.modulus=1.3e11", "drive.frequency=299e3")
    assert made.microscope.interaction == Interaction("hertz", damping_exponent=1)
    assert made.microscope.tip.modulus == 1.3e11 and made.microscope.drive.frequency == 299e3
    assert made.options["accuracy"] == Accuracy(phase=0.1)
    assert (made.options["solver"], made.options["variables"]) == ("orbit", ["height", "phase"])
    assert made.output == tmp_path / "image.nc"


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ("drive.frequncy=3", r"\[drive\] frequncy is unknown; allowed: .*\. Did you mean 'frequency'\?"),
        ("surface.colour=3", r"\[surface\] colour is unknown; allowed: labels, materials, pixel_size, topography"),
        ("acuracy.phase=1", "table acuracy is unknown; allowed: .*Did you mean 'accuracy'"),
        ("materials.soft.modulos=1", r"\[materials.soft\] modulos is unknown; .*Did you mean 'modulus'"),
        ("materials.soft.modulus=-1", r"\[materials.soft\] modulus is -1; allowed: a finite number of at least 0 Pa"),
        ("materials.soft.modulus=nan", r"\[materials.soft\] modulus is nan; allowed: a finite number"),
        ("materials.soft=3", r"\[materials.soft\] is 3; allowed: a table of keys modulus, "),
        ("materials.soft=PDMS", r"\[materials.soft\] is 'PDMS'; .*A preset is materials.soft.preset=PDMS\."),
        ("scan.setpoint=1.2", r"\[scan\] setpoint is 1.2; allowed: a number above 0 and below 1 "),
        ("scan.solver=orbits", r"\[scan\] solver is 'orbits'; allowed: one of auto, .*Did you mean 'orbit'"),
        ("tip.radius=10 kHz", r"\[tip\] radius is '10 kHz'; allowed: .* at most 1 m, or a length such as '40 nm'\."),
        ("tip.radius=true", r"\[tip\] radius is True; allowed: a finite number above 0 and at most 1 m\."),
        ("drive.frequency=-3", r"\[drive\] frequency is -3; allowed: a finite number above 0 Hz"),
        ("interaction.contact=hertzz", r"\[interaction\] contact is 'hertzz'; allowed: one of hertz, dmt"),
        ("accuracy.phase=0", r"\[accuracy\] phase is 0; allowed: a finite number above 0"),
        ("control.gain=1", r"\[control\] gain is unknown"),
        (
            "control.line_rate=1",
            r"line_rate is 1; allowed: nothing where kind is 'engage'\. It belongs to kind = 'feedback'",
        ),
        ("output.file=3", r"\[output\] file is 3; allowed: a file name"),
        ('output.variables=["phases"]', r"\[output\] variables is 'phases'; allowed: names out of height, phase"),
        ("output.variables=height", r"\[output\] variables is 'height'; allowed: a list of names"),
        ("surface.kind=lables", r"\[surface\] kind is 'lables'; allowed: one of labels, .*Did you mean 'labels'"),
        ("surface.kind=[1]", r"\[surface\] kind is \[1\]; allowed: one of labels"),
        ("surface.pixel_size=0", r"\[surface\] pixel_size is 0; allowed: a finite number above 0 m"),
        ("surface.labels=[[0, 2]]", r"\[surface\] label without a material is '2'; .*row 0, column 1"),
        ("surface.labels=[[0, 0.5]]", r"\[surface\] type of labels is 'float64'; allowed: whole numbers"),
        ("surface.labels=[[0], [0, 1]]", r"\[surface\] labels is 'a list of rows of unequal length'"),
        ('surface.materials=["soft", "herd"]', r"\[surface\] materials is 'herd'; .*Did you mean 'hard'"),
        ("surface.materials=soft", r"\[surface\] materials is 'soft'; allowed: a list of names"),
        ('surface.materials={1="soft", 01="hard"}', r"\[surface\] materials is 1, 01; allowed: each label once"),
        ('interaction.contact={law="table", file=5}', r"\[interaction.contact\] file is 5; allowed: a file name"),
        ('surface.materials={a="soft"}', r"\[surface\] materials is 'a'; allowed: labels that are whole numbers"),
        ("surface.topography=[[1e-9]]", r"\[surface\] shape of topography is \(1, 1\); allowed: \(2, 3\)"),
        ("surface.topography={fiel=1}", r"\[surface.topography\] fiel is unknown; .*Did you mean 'file'"),
        ("surface.heights=[1e-9]", r"\[surface\] heights is \[1e-09\]; allowed: a list of 2 heights in m"),
        ("drive=3", r"override is 'drive=3'; allowed: table.key=value"),
        ("drive.free_amplitude", "override is 'drive.free_amplitude'; allowed: table.key=value"),
        ("drive.free_amplitude.x=1", "override is .*; allowed: a key of a table; free_amplitude is none"),
    ],
)
def test_what_is_not_allowed_is_said_in_one_sentence(tmp_path: Path, override: str, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence) as caught:
        scene(tmp_path, HEAD + LABELS, override)
    assert "\n" not in str(caught.value)


def test_all_that_is_wrong_is_said_at_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wrong = {
        "scan.setpoint=1.2": "[scan] setpoint is 1.2; allowed: a number above 0 and below 1",
        "scan.solver=orbits": "[scan] solver is 'orbits'; allowed: one of auto",
        "cantilever.stifness=3": "[cantilever] stifness is unknown",
        "cantilever.quality_factor=0": "[cantilever] quality_factor is 0; allowed: a finite number",
        "tip.radius=0": "[tip] radius is 0; allowed: a finite number above 0",
        "drive.free_amplitude=40 kHz": "[drive] free_amplitude is '40 kHz'; allowed: a finite number",
        "control.line_rate=1": "[control] line_rate is 1; allowed: nothing where kind is 'engage'.",
        "materials.soft.adhesion=-1": "[materials.soft] adhesion is -1; allowed: a finite number of at least 0",
        "materials.hard.modulos=1": "[materials.hard] modulos is unknown",
        'surface.materials=["soft", "herd"]': "[surface] materials is 'herd'; allowed: one of soft, hard.",
    }
    with pytest.raises(InputError) as caught:
        scene(tmp_path, HEAD + LABELS, *wrong)
    lines = str(caught.value).splitlines()
    assert len(lines) == len(wrong)
    assert all(sum(line.startswith(sentence) for line in lines) == 1 for sentence in wrong.values())
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)  # as it comes out of a worker
    assert main(["validate", "samples/step.toml", "tip.radius=0", "scan.setpoint=1.2"]) == 2
    said = capsys.readouterr().err.splitlines()
    assert [line.partition(" is ")[0] for line in said] == ["phasemap: [scan] setpoint", "phasemap: [tip] radius"]


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("setpoint = 0.7", r"\[scan\] setpoint is missing; allowed: a value, for it has no default"),
        ("stiffness = 40", r"\[cantilever\] stiffness is missing"),
        ("modulus = 3e9", r"\[materials.hard\] modulus is missing"),
        ('kind = "labels"', r"\[surface\] kind is missing"),
        ("pixel_size = 4e-9", r"\[surface\] pixel_size is missing"),
        ("[drive]\nfree_amplitude = 40e-9", "the scene's table drive is missing"),
    ],
)
def test_what_is_missing_is_named(tmp_path: Path, line: str, sentence: str) -> None:
    text = HEAD + LABELS
    assert line in text
    with pytest.raises(InputError, match=sentence):
        scene(tmp_path, text.replace(line, ""))


def test_a_scene_that_is_no_toml_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"cannot read the scene .*scene.toml: it is not valid TOML: .*line 1"):
        scene(tmp_path, "[scan\n")
    (tmp_path / "latin.toml").write_bytes(b"# \xb5m\n")
    with pytest.raises(FileError, match=r"it is not in UTF-8, from byte 2 on: save it as that\."):
        load_scene(tmp_path / "latin.toml")
    (tmp_path / "image.nc").write_bytes(b"\x89HDF\r\n\x1a\n\0\0\0\0")
    with pytest.raises(FileError, match=r"image\.nc: it is no scene, which is text\. `phasemap plot` draws an"):
        load_scene(tmp_path / "image.nc")
    with pytest.raises(FileError, match=r"cannot read the scene .*nowhere\.toml: No such file"):
        load_scene(tmp_path / "nowhere.toml")
    with pytest.raises(FileError, match="cannot read the scene"):
        load_scene(tmp_path)
    (tmp_path / "flat.toml").write_text("scan = 3\nsurface = 3\ncantilever = 3\ntip = 3\ndrive = 3\n")
    with pytest.raises(InputError, match=r"\[scan\] is 3; allowed: a table"):
        load_scene(tmp_path / "flat.toml")


def test_an_override_is_a_toml_value_or_else_text(tmp_path: Path) -> None:
    made = scene(
        tmp_path,
        HEAD + LABELS,
        "surface.labels=[[1]]",
        "scan.solver=march",
        'interaction.contact="hertz"',
        "drive.free_amplitude = 20e-9",
    )
    assert made.surface.shape == (1, 1) and made.options["solver"] == "march"
    assert made.microscope.interaction.contact == "hertz" and made.microscope.drive.free_amplitude == 20e-9
    with pytest.raises(InputError, match=r"solver is 'orbit\\nx = 1'"):
        scene(tmp_path, HEAD + LABELS, "scan.solver=orbit\nx = 1")


def test_labels_may_be_any_whole_numbers(tmp_path: Path) -> None:
    made = scene(tmp_path, HEAD + LABELS, "surface.labels=[[7, 255]]", 'surface.materials={7 = "soft", 255 = "hard"}')
    assert made.surface.modulus.tolist() == [[0.5e9, 3e9]]


@pytest.mark.parametrize("name", ["labels.npy", "labels.csv", "labels.txt", "labels.nc"])
def test_maps_are_read_from_files_beside_the_scene(tmp_path: Path, name: str) -> None:
    labels = np.array([[0, 1, 1], [0, 0, 1]])
    np.save(tmp_path / "labels.npy", labels)
    np.savetxt(tmp_path / "labels.csv", labels, delimiter=",")
    np.savetxt(tmp_path / "labels.txt", labels)
    xr.Dataset({"labels": (("y", "x"), labels), "E": (("y", "x"), labels)}).to_netcdf(tmp_path / "labels.nc")
    made = scene(tmp_path, HEAD + LABELS, f"surface.labels={name}")
    assert made.surface == scene(tmp_path, HEAD + LABELS).surface
    assert list(made.config["files"]) == [name] and len(made.config["files"][name]) == 64


def test_a_variable_of_a_netcdf_file_is_chosen_by_name(tmp_path: Path) -> None:
    xr.Dataset({"z": (("y", "x"), 1e-9 * np.arange(6.0).reshape(2, 3))}).to_netcdf(tmp_path / "maps.nc")
    made = scene(tmp_path, HEAD + LABELS, 'surface.topography={file="maps.nc", variable="z"}')
    assert made.surface.topography is not None and made.surface.topography[1, 2] == 5e-9
    with pytest.raises(FileError, match="there is no variable 'topography'; it holds 'z'"):
        scene(tmp_path, HEAD + LABELS, "surface.topography=maps.nc")


def test_a_file_that_cannot_be_used_is_named_with_its_key(tmp_path: Path) -> None:
    np.save(tmp_path / "objects.npy", np.array([{}, {}], dtype=object), allow_pickle=True)
    (tmp_path / "words.csv").write_text("a,b\n")
    (tmp_path / "empty.npy").touch()
    for name, reason in {
        "objects.npy": "Object arrays cannot be loaded",
        "words.csv": "could not convert string",
        "empty.npy": "No data left",
    }.items():
        with pytest.raises(FileError, match=rf"cannot read .*{name}, named in \[surface\] labels: {reason}"):
            scene(tmp_path, HEAD + LABELS, f"surface.labels={name}")
    with pytest.raises(FileError, match=r"cannot read .*nowhere.npy, named in \[surface\] labels: No such file"):
        scene(tmp_path, HEAD + LABELS, "surface.labels=nowhere.npy")
    (tmp_path / "labels.png").touch()
    with pytest.raises(InputError, match=r"labels is 'labels.png'; allowed: a file that ends in .npy, .csv, .txt, .nc"):
        scene(tmp_path, HEAD + LABELS, "surface.labels=labels.png")
    (tmp_path / "nothing.csv").touch()
    with pytest.raises(FileError, match=r"nothing.csv, named in \[surface\] labels: .*no data"):
        scene(tmp_path, HEAD + LABELS, "surface.labels=nothing.csv")
    for package in ("nowhere", "os", ".."):
        with pytest.raises(FileError, match=f"the package '{package}' is not installed"):
            scene(tmp_path, HEAD + LABELS, f"surface.labels=package:{package}/labels.npy")


def test_maps_are_numbers_files_or_generated_fields(tmp_path: Path) -> None:
    adhesion = np.array([[0.05, 0.06, 0.07], [0.05, 0.06, 0.07]])
    np.save(tmp_path / "w.npy", adhesion)
    made = scene(
        tmp_path,
        HEAD
        + """
    [surface]
    kind = "maps"
    shape = [2, 3]
    pixel_size = [2e-9, 4e-9]
    modulus = { generator = "gradient", start = 1e9, stop = 3e9 }
    adhesion = "w.npy"
    viscosity = 50
    topography = [[0, 0, 1e-9], [0, 0, 0]]
    """,
    )
    relief = np.array([[0, 0, 1e-9], [0, 0, 0]])
    expected = Surface(
        modulus=generate.gradient((2, 3), start=1e9, stop=3e9),
        adhesion=adhesion,
        viscosity=50,
        topography=relief,
        pixel_size=(2e-9, 4e-9),
    )
    assert made.surface == expected


def test_a_whole_surface_is_read_from_a_netcdf_file(tmp_path: Path) -> None:
    surface = Surface(modulus=[[1e9, 3e9], [1e9, 1e9]], adhesion=0.05, damping=0.01, pixel_size=4e-9)
    surface.to_dataset().to_netcdf(tmp_path / "surface.nc")
    assert scene(tmp_path, HEAD + '[surface]\nkind = "maps"\nfile = "surface.nc"\n').surface == surface
    with pytest.raises(InputError, match=r"\[surface\] modulus is unknown; allowed: file, allow_nan"):
        scene(tmp_path, HEAD + '[surface]\nkind = "maps"\nfile = "surface.nc"\nmodulus = 1e9\n')


@pytest.mark.parametrize(
    ("surface", "sentence"),
    [
        ('modulus = { generator = "gradient", start = 1, stop = 2 }', r"\[surface\] shape is None; allowed: \(rows, "),
        ('shape = [2, 2]\nmodulus = { generator = "gradeint" }', r"generator is 'gradeint'; .*Did you mean 'gradient'"),
        ('shape = [2, 2]\nmodulus = { generator = "gradient", start = 1 }', r"\[surface.modulus\] stop is missing"),
        ('shape = [2, 2]\nmodulus = { generator = "gradient", start = 1, stop = "x" }', r"\.modulus\] stop is 'x'"),
        ("shape = [2, 2]\nmodulus = -1", r"\[surface\] modulus is -1; allowed: a finite number of at least 0 Pa"),
        ("modulus = [[1.0, nan]]", r"\[surface\] modulus is nan; allowed: .*It is at row 0, column 1"),
        ("modulus = [[1.0]]\nallow_nan = 1", r"\[surface\] allow_nan is 1; allowed: true or false"),
    ],
)
def test_maps_that_are_not_allowed_are_refused(tmp_path: Path, surface: str, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        scene(tmp_path, HEAD + f'[surface]\nkind = "maps"\npixel_size = 1e-9\n{surface}\n')


def test_a_generator_takes_its_own_arguments_and_the_relief_of_labels(tmp_path: Path) -> None:
    text = (
        HEAD
        + """
    [surface]
    kind = "blend"
    shape = [32, 48]
    pixel_size = 4e-9
    spacing = 40e-9
    seed = 3
    materials = ["hard", "soft"]
    heights = [0.0, 2e-9]
    topography = { generator = "roughness", rms = 0.2e-9, correlation_length = 20e-9 }
    """
    )
    made = scene(tmp_path, text)
    labels = generate.blend((32, 48), 4e-9, spacing=40e-9, seed=3)
    relief = 2e-9 * labels + generate.roughness((32, 48), 4e-9, rms=0.2e-9, correlation_length=20e-9)
    assert made.surface == Surface.from_labels(labels, {0: HARD, 1: SOFT}, pixel_size=4e-9, topography=relief)
    assert scene(tmp_path, text, "surface.seed=4").surface != made.surface
    with pytest.raises(InputError, match=r"\[surface\] spacing is 1; allowed: "):
        scene(tmp_path, text, "surface.spacing=1")
    with pytest.raises(InputError, match=r"\[surface\] sed is unknown; .*Did you mean 'seed'"):
        scene(tmp_path, text, "surface.sed=1")
    three = r"\[surface\] materials is \['hard', 'soft', 'hard'\]; allowed: .* for label 0 and one for 1, for blend"
    with pytest.raises(InputError, match=three):
        scene(tmp_path, text, 'surface.materials=["hard", "soft", "hard"]', "surface.heights=[0, 0, 0]")


def test_the_resolved_configuration_is_one_line_of_json_with_every_default(tmp_path: Path) -> None:
    text = scene(tmp_path, HEAD + LABELS, "drive.free_amplitude=20e-9").to_json()
    assert "\n" not in text
    config = json.loads(text)
    assert config["scan"] == {"setpoint": 0.7, "solver": "auto"}
    assert config["drive"] == {"free_amplitude": 20e-9, "frequency": None, "excitation": "direct", "second": None}
    laws = {"contact": "dmt", "decay_length": 0.3e-9, "damping_exponent": 0.5, "bias": 0.0, "withdrawal": "linear"}
    assert config["interaction"] == {**laws, "longrange": "van der waals"}
    assert config["materials"]["hard"]["poisson_ratio"] == 0.35
    assert config["surface"]["labels"] == [[0, 1, 1], [0, 0, 1]]
    assert config["control"] == {"kind": "engage"}


@pytest.mark.parametrize("name", sorted(path.stem for path in SAMPLES.glob("*.toml") if path.stem != "ensemble"))
def test_every_sample_is_valid(name: str) -> None:
    if name == "mos2" and any(find_spec(needed) is None for needed in ("gwyddionpy_converter", "skimage", "NSFopen")):
        pytest.skip('needs pip install "afm-phasemap[read]" and nsfopen')
    made = load_scene(SAMPLES / f"{name}.toml")
    materials = made.surface.unique()[0].shape[0]
    assert materials > 2 if made.config["surface"].get("seen_by_tip") else materials == 2
    assert json.loads(made.to_json())["scan"]["setpoint"] == made.options["setpoint"]


def test_a_measured_image_becomes_topography_and_materials() -> None:
    if any(find_spec(needed) is None for needed in ("gwyddionpy_converter", "skimage", "NSFopen")):
        pytest.skip('needs pip install "afm-phasemap[read]" and nsfopen')
    surface = load_scene(SAMPLES / "mos2.toml").surface
    assert surface.shape == (256, 512)
    assert surface.pixel_size == pytest.approx((3.97339e-6 / 256, 3.97339e-6 / 512))
    assert surface.topography is not None and 3e-9 < np.ptp(np.percentile(surface.topography, [0.5, 99.5])) < 20e-9
    assert 0.3 < np.mean(surface.modulus == 3e9) < 0.5


def test_a_scene_with_typical_realism_is_scanned_in_time_with_noise_and_edges_as_wide_as_the_tip(
    tmp_path: Path,
) -> None:
    text = f'realism = "typical"\n{(SAMPLES / "step.toml").read_text()}'
    (tmp_path / "typical.toml").write_text(text)
    scene = load_scene(tmp_path / "typical.toml", ["surface.shape=[8, 48]", "realism.seed=3"])
    assert scene.options["realism"] == pm.Realism.typical(seed=3)
    assert scene.options["control"] == pm.Feedback(**TYPICAL_SCAN)
    bare = load_scene(SAMPLES / "step.toml", ["surface.shape=[8, 48]"])
    assert scene.surface == bare.surface.seen_by(scene.microscope, 0.7) != bare.surface
    again = scene_from_json(scene.to_json(), tmp_path)
    assert again.config == scene.config and again.options == scene.options
    image = scene.simulate()
    assert image.phase.dims == ("direction", "y", "x") and np.isfinite(image.phase).all()


def test_what_a_scene_says_itself_holds_beside_typical_realism() -> None:
    overrides = [
        "realism.preset=typical",
        "surface.seen_by_tip=false",
        "control.kind=raster",
        "realism.line_offset=1e-9",
    ]
    scene = load_scene(SAMPLES / "step.toml", overrides)
    assert scene.options["control"] == pm.Raster()
    expected = pm.Realism.typical(temperature=None, detector_noise=None, line_offset=1e-9)
    assert scene.options["realism"] == expected  # for noise acts in time only
    faster = load_scene(SAMPLES / "step.toml", ["realism.preset=typical", "control.line_rate=6"])
    assert faster.options["control"] == pm.Feedback(line_rate=6.0, bandwidth=TYPICAL_SCAN["bandwidth"])
    with pytest.raises(InputError, match=r"\[realism\] .*is 'usual'; allowed: .*typical"):
        load_scene(SAMPLES / "step.toml", ["realism.preset=usual"])


def test_a_scene_says_how_much_its_materials_vary() -> None:
    overrides = ["surface.shape=[48, 64]", "surface.variation={modulus=0.3, correlation_length='20 nm'}"]
    scene = load_scene(SAMPLES / "step.toml", overrides)
    assert scene.built is not None and scene.built.labels is not None
    materials = [pm.Material(**values) for values in scene.config["materials"].values()]
    spread = pm.Variation(modulus=0.3, correlation_length=20e-9)
    labels, relief = scene.built.labels.values, scene.surface.topography
    assert scene.surface == pm.Surface.from_labels(
        labels, materials, pixel_size=2e-9, topography=relief, variation=spread
    )
    with pytest.raises(InputError, match=r"\[surface.variation\] modulos is unknown.*Did you mean 'modulus'"):
        load_scene(SAMPLES / "step.toml", ["surface.variation.modulos=0.3"])


def test_each_key_of_a_generated_surface_is_listed_once(tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    text = (Path(__file__).parents[2] / "samples" / "blend.toml").read_text()
    path.write_text(text.replace("[surface]", "[surface]\nsquares = 3", 1))
    with pytest.raises(pm.InputError, match="squares") as caught:
        load_scene(path)
    listed = str(caught.value).partition("allowed: ")[2].partition(".")[0].split(", ")
    assert len(listed) == len(set(listed)) > 5
