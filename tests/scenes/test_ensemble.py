"""Ensembles: the same bytes from one seed, whatever happens on the way."""

from __future__ import annotations

import itertools
import math
import multiprocessing
import os
import pickle
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import phasemap as pm
from phasemap._shared.errors import FileError, InputError, PhasemapError
from phasemap._shared.processes import in_processes
from phasemap.cli import main
from phasemap.io.netcdf import load, save
from phasemap.scenes.ensemble import Ensemble, load_ensemble
from phasemap.scenes.ensemble_file import PartsFolder, assemble
from phasemap.scenes.samples import Range
from phasemap.scenes.scene import load_scene

NUMBERS = ("failed", "irregular", "distinct_materials", "adhesion_force", "lever_force")  # of whole images
TRUTH = ("label", "modulus", "adhesion", "damping", "poisson_ratio")
SAMPLE = Path(__file__).parents[2] / "samples" / "ensemble.toml"
SCENE = """
[scan]
setpoint = 0.7
solver = "averaging"
[surface]
kind = "labels"
labels = [[0, 1, 1, 1, 1, 0], [0, 0, 1, 1, 0, 0]]
materials = ["soft", "hard"]
pixel_size = 4e-9
[materials.soft]
modulus = 0.5e9
adhesion = 0.05
damping = 0.02
[materials.hard]
modulus = 3e9
[cantilever]
stiffness = 40
resonance_frequency = 300e3
quality_factor = 400
[tip]
radius = 10e-9
[drive]
free_amplitude = 40e-9
"""
DRAWN = """
[ensemble]
count = 5
seed = 3
[ensemble.vary]
"materials.soft.modulus" = { low = 1e8, high = 5e9, scale = "log" }
scan.setpoint = [0.5, 0.7, 0.9]
"""
CONSTANT = '[ensemble]\ncount = 2\n[ensemble.vary]\nscan.solver = ["averaging"]\n'


def written(folder: Path, ensemble: str = DRAWN, scene: str = SCENE) -> Path:
    """The file of an ensemble."""
    folder.mkdir(exist_ok=True)
    path = folder / "ensemble.toml"
    path.write_text(scene + ensemble)
    return path


def stop_after(count: int) -> Callable[[int, int], None]:
    """A progress that is interrupted when so many samples are done."""

    def progress(done: int, total: int) -> None:
        if done == count:
            raise KeyboardInterrupt

    return progress


@pytest.fixture
def ensemble(tmp_path: Path) -> Ensemble:
    return load_ensemble(written(tmp_path))


@pytest.fixture
def whole(ensemble: Ensemble, tmp_path: Path) -> bytes:
    """What one process writes without interruption."""
    return ensemble.simulate(tmp_path / "whole.nc").read_bytes()


def test_a_sample_depends_neither_on_the_count_nor_on_what_else_is_varied(tmp_path: Path) -> None:
    path = written(tmp_path)
    few, many = load_ensemble(path), load_ensemble(path, ["ensemble.count=40"])
    assert few.samples == many.samples[:5]
    more = load_ensemble(path, ["ensemble.vary.materials.hard.modulus={low=1e9, high=9e9}"])
    assert [{key: sample[key] for key in few.keys} for sample in more.samples] == list(few.samples)
    other = load_ensemble(path, ["ensemble.seed=4"])
    assert not {s["materials.soft.modulus"] for s in few.samples} & {s["materials.soft.modulus"] for s in other.samples}


def test_draws_fill_their_ranges_evenly(tmp_path: Path) -> None:
    count = 1000
    path = written(
        tmp_path,
        f"""
[ensemble]
count = {count}
[ensemble.vary]
materials.soft.modulus = {{ low = 1e8, high = 1e10, scale = "log" }}
materials.hard.modulus = {{ low = 1e9, high = 3e9 }}
materials.soft.damping = {{ low = 0, high = 2, whole = true }}
scan.setpoint = [0.6, 0.8]
""",
    )
    drawn = {key: np.array(values) for key, values in samples_of(load_ensemble(path)).items()}
    shares = {
        "materials.soft.modulus": np.log10(drawn["materials.soft.modulus"] / 1e8) / 2,
        "materials.hard.modulus": drawn["materials.hard.modulus"] / 2e9 - 0.5,
    }
    for share in shares.values():
        # Kolmogorov-Smirnov: the largest distance from a straight line; 1.95 / sqrt(n) is passed by one seed in 1000.
        steps = np.arange(count + 1) / count
        ordered = np.sort(share)
        assert max(np.max(steps[1:] - ordered), np.max(ordered - steps[:-1])) < 1.95 / math.sqrt(count)
    # Independent keys: the correlation has the standard error 1 / sqrt(n).
    assert abs(np.corrcoef(*shares.values())[0, 1]) < 3.3 / math.sqrt(count)
    for key, options in {"materials.soft.damping": [0, 1, 2], "scan.setpoint": [0.6, 0.8]}.items():
        values, counts = np.unique(drawn[key], return_counts=True)
        assert values.tolist() == options
        share_of_each = 1 / len(options)
        assert np.all(
            abs(counts / count - share_of_each) < 3.3 * math.sqrt(share_of_each * (1 - share_of_each) / count)
        )


def samples_of(ensemble: Ensemble) -> dict[str, list[float]]:
    return {key: [sample[key] for sample in ensemble.samples] for key in ensemble.keys}


def test_a_sample_is_the_image_of_its_scene_to_the_bit(ensemble: Ensemble, whole: bytes, tmp_path: Path) -> None:
    ds = load(tmp_path / "whole.nc")
    assert dict(ds.sizes) == {"sample": 5, "y": 2, "x": 6}
    single = written(tmp_path / "single", "")
    for sample, values in enumerate(ensemble.samples):
        image = load_scene(single, [f"{key}={value!r}" for key, value in values.items()]).simulate()
        assert set(image.data_vars) == set(ds.data_vars) - {*NUMBERS, *TRUTH}
        assert ds["distinct_materials"][sample] == image.attrs["distinct_materials"] == 2
        for name, variable in image.data_vars.items():
            assert ds[name][sample].values.tobytes() == variable.values.tobytes(), name
            assert ds[name].dims == ("sample", *variable.dims)
            assert {k: str(v) for k, v in ds[name].attrs.items()} == {k: str(v) for k, v in variable.attrs.items()}
        for axis in ("y", "x"):
            assert ds[axis].identical(image[axis])


def test_the_file_says_what_is_varied_and_where_it_comes_from(ensemble: Ensemble, whole: bytes, tmp_path: Path) -> None:
    ds = load(tmp_path / "whole.nc")
    modulus = ds.coords["materials.soft.modulus"]
    assert modulus.values.tolist() == samples_of(ensemble)["materials.soft.modulus"]
    assert modulus.attrs == {
        "long_name": "materials soft modulus",
        "key": "materials.soft.modulus",
        "units": "Pa",
    }
    assert ds["phase"].coords["scan.setpoint"].dims == ("sample",)
    assert ds["adhesion_force"].attrs == {"long_name": "largest adhesion between tip and sample", "units": "N"}
    assert ds["failed"].values.tolist() == ds["irregular"].values.tolist() == [0] * 5
    assert ds.attrs["phasemap_version"] == pm.__version__ and ds.attrs["Conventions"] == "CF-1.11"
    assert '"seed": 3' in ds.attrs["scene"] and '"quality_factor": 400' in ds.attrs["scene"]
    assert ds.identical(xr.load_dataset(tmp_path / "whole.nc"))


def test_the_truth_lies_beside_each_image(ensemble: Ensemble, whole: bytes, tmp_path: Path) -> None:
    ds = load(tmp_path / "whole.nc")
    assert ds["label"].dims == ("sample", "y", "x") and ds["label"].dtype == np.int64
    assert ds["label"].values.tolist() == [[[0, 1, 1, 1, 1, 0], [0, 0, 1, 1, 0, 0]]] * 5
    assert ds["label"].attrs["flag_meanings"] == "soft hard" and ds["label"].attrs["flag_values"].tolist() == [0, 1]
    for sample, setpoint in enumerate(ds["scan.setpoint"].values):
        scene = ensemble.scene(sample)
        assert scene.options["setpoint"] == setpoint
        assert pm.Surface.from_dataset(ds.isel(sample=sample)) == scene.surface
    assert ds["modulus"].values[:, 0, 0].tolist() == ds["materials.soft.modulus"].values.tolist()


def test_the_truth_is_what_is_there_and_not_what_a_blunt_tip_sees(tmp_path: Path) -> None:
    blunt = SCENE.replace('materials = ["soft", "hard"]', 'materials = ["soft", "hard"]\nheights = [0.0, 3e-9]')
    blunt = blunt.replace("pixel_size = 4e-9", "pixel_size = 4e-9\ndilate = true\nseen_by_tip = true")
    scene = load_scene(written(tmp_path, "", blunt))
    assert scene.surface.topography is not None and len(np.unique(scene.surface.topography)) > 2
    truth = scene.truth()
    assert np.array_equal(truth.topography, np.where(truth.label == 1, 3e-9, 0.0))
    assert np.array_equal(truth.modulus, np.where(truth.label == 1, 3e9, 0.5e9))


def test_the_truth_is_that_under_the_tip_where_the_sample_drifts(tmp_path: Path) -> None:
    """Without noise each pixel shows the phase of its own material, whose pixel of the sample drifts by up to 2."""
    drifting = SCENE + "[realism]\ndrift = [8e-9, 0.0, 1e-9]\n"
    rows = "[" + ", ".join(["[0, 1, 1, 1, 1, 0]", "[0, 0, 1, 1, 0, 0]"] * 4) + "]"
    drifting = drifting.replace("[[0, 1, 1, 1, 1, 0], [0, 0, 1, 1, 0, 0]]", rows)
    scene = load_scene(written(tmp_path, "", drifting))
    truth, phase = scene.truth(), scene.simulate().phase.values
    assert len(np.unique(phase.round(9))) == 2
    assert np.array_equal(truth.label == 1, phase > phase.mean())
    assert np.array_equal(truth.modulus, np.where(truth.label == 1, 3e9, 0.5e9)) and "topography" not in truth
    resting = load_scene(written(tmp_path, "", drifting), ["realism.drift=[0.0, 0.0, 0.0]"]).truth()
    assert not np.array_equal(truth.label, resting.label)


def test_a_label_is_not_named_where_its_material_is_varied(tmp_path: Path) -> None:
    turned = '[ensemble]\ncount = 2\n[ensemble.vary]\nsurface.materials = [["soft", "hard"], ["hard", "soft"]]\n'
    ds = load(load_ensemble(written(tmp_path, turned)).simulate(tmp_path / "out.nc"))
    assert set(ds["label"].attrs) == {"long_name"} and "surface.materials" in ds.coords


def test_the_file_states_a_licence(ensemble: Ensemble, tmp_path: Path) -> None:
    licensed = load_ensemble(tmp_path / "ensemble.toml", ["ensemble.licence=CC-BY-4.0"])
    assert licensed.samples == ensemble.samples
    assert load(licensed.simulate(tmp_path / "blends.nc")).attrs["license"] == "CC-BY-4.0"
    with pytest.raises(InputError, match=r"\[ensemble\] licence is 3; allowed: text, such as 'CC-BY-4.0'"):
        load_ensemble(tmp_path / "ensemble.toml", ["ensemble.licence=3"])


@pytest.mark.slow
def test_two_processes_write_the_same_bytes(ensemble: Ensemble, whole: bytes, tmp_path: Path) -> None:
    assert ensemble.simulate(tmp_path / "two.nc", workers=2).read_bytes() == whole


def test_an_interrupted_run_goes_on_and_writes_the_same_bytes(ensemble: Ensemble, whole: bytes, tmp_path: Path) -> None:
    path, parts = tmp_path / "twice.nc", tmp_path / "twice.nc.parts"
    with pytest.raises(KeyboardInterrupt):
        ensemble.simulate(path, progress=stop_after(2))
    assert not path.exists() and len(list(parts.iterdir())) == 2
    reported: list[int] = []
    ensemble.simulate(path, progress=lambda done, total: reported.append(done))
    assert reported == [2, 3, 4, 5]
    assert path.read_bytes() == whole
    assert not parts.exists()


WAITING = """
import sys, threading
from phasemap.cli import main
from phasemap.scenes.ensemble_file import Parts
add, made = Parts.add, []
def add_and_wait(self, file):
    made.append(add(self, file))
    if len(made) == 3:
        print("waiting", flush=True)
        threading.Event().wait()  # in the middle of the work, whatever else the machine does
    return made[-1]
Parts.add = add_and_wait
sys.exit(main())
"""


@pytest.mark.slow
def test_a_run_that_is_killed_goes_on_and_writes_the_same_bytes(tmp_path: Path) -> None:
    count = 12
    scene, path, parts = written(tmp_path), tmp_path / "out.nc", tmp_path / "out.nc.parts"
    command = [sys.executable, "-c", WAITING, "run", str(scene), "-o", str(path), f"ensemble.count={count}"]
    for send, stop, workers in ((os.kill, signal.SIGKILL, 1), (os.killpg, signal.SIGINT, 2)):  # Ctrl-C is for the group
        how = {"start_new_session": True, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        with subprocess.Popen([*command, f"--workers={workers}"], **how, preexec_fn=heeding) as run:
            assert run.stdout is not None and "waiting\n" in run.stdout
            send(run.pid, stop)
            said = run.communicate()[1]
        assert run.returncode == {signal.SIGKILL: -9, signal.SIGINT: 130}[stop] and "Traceback" not in said
    kept = re.search(r"interrupted; (\d+) of 12 samples are kept in .*out\.nc\.parts; run the same command", said)
    assert kept is not None and 3 + 2 <= int(kept[1]) <= made(parts) < count
    ensemble = load_ensemble(scene, [f"ensemble.count={count}"])
    reported: list[int] = []
    ensemble.simulate(path, progress=lambda done, total: reported.append(done))
    assert reported[0] >= int(kept[1])
    assert path.read_bytes() == ensemble.simulate(tmp_path / "again.nc").read_bytes()
    assert not parts.exists()


def heeding() -> None:
    """Heed Ctrl-C, which processes that a shell started in the background are told to ignore."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def made(parts: Path) -> int:
    """How many samples are in the folder."""
    return len([file for file in parts.glob("*.nc") if not file.name.startswith(".")])


def test_samples_of_another_scene_are_neither_used_nor_removed(
    ensemble: Ensemble, whole: bytes, tmp_path: Path
) -> None:
    path, parts = tmp_path / "out.nc", tmp_path / "out.nc.parts"
    other = load_ensemble(tmp_path / "ensemble.toml", ["tip.radius=12e-9"])
    with pytest.raises(KeyboardInterrupt):
        other.simulate(path, progress=stop_after(2))
    theirs = {file.name for file in parts.iterdir()}
    reported: list[int] = []
    ensemble.simulate(path, progress=lambda done, total: reported.append(done))
    assert reported[0] == 0 and path.read_bytes() == whole
    assert {file.name for file in parts.iterdir()} == theirs


def test_a_sample_is_made_anew_where_a_file_that_it_reads_has_changed(tmp_path: Path) -> None:
    labels = tmp_path / "labels.csv"
    scene = re.sub(r"labels = \[\[.*", 'labels = "labels.csv"', SCENE)
    path, out = written(tmp_path, CONSTANT, scene), tmp_path / "out.nc"
    for text in ("0,1\n", "1,0\n"):
        labels.write_text(text)
        with pytest.raises(KeyboardInterrupt):
            load_ensemble(path).simulate(out, progress=stop_after(2))
    ds = load(load_ensemble(path).simulate(out))
    soft, hard = load_scene(written(tmp_path / "single", "")).simulate()["phase"].values[0, :2]
    assert ds["phase"].values.tolist() == [[[hard, soft]], [[hard, soft]]]


def test_samples_may_come_from_a_table(tmp_path: Path) -> None:
    (tmp_path / "runs.csv").write_text(
        "\ufeffscan.setpoint, materials.soft.modulus,surface.materials\n"
        '0.6,1e9,"[""soft"", ""hard""]"\n\n0.8,2e9,"[""hard"", ""soft""]"\n'
    )
    ensemble = load_ensemble(written(tmp_path, '[ensemble]\ntable = "runs.csv"\n'))
    assert ensemble.samples == (
        {"scan.setpoint": 0.6, "materials.soft.modulus": 1e9, "surface.materials": ["soft", "hard"]},
        {"scan.setpoint": 0.8, "materials.soft.modulus": 2e9, "surface.materials": ["hard", "soft"]},
    )
    ds = load(ensemble.simulate(tmp_path / "out.nc"))
    assert ds["surface.materials"].values.tolist() == ['["soft", "hard"]', '["hard", "soft"]']
    assert ds["scan.setpoint"].values.tolist() == [0.6, 0.8]
    phase = ensemble.scene(1).simulate()["phase"]
    assert ds["phase"][1].values.tobytes() == phase.values.tobytes()


def test_pixels_without_a_solution_are_counted_in_each_sample(tmp_path: Path) -> None:
    scene = re.sub(
        r"kind = .*?pixel_size",
        'kind = "maps"\nmodulus = [[1e9, nan, 2e9]]\nallow_nan = true\npixel_size',
        SCENE,
        flags=re.DOTALL,
    )
    ds = load(load_ensemble(written(tmp_path, CONSTANT, scene)).simulate(tmp_path / "out.nc"))
    assert ds["failed"].values.tolist() == [1, 1]
    assert np.isnan(ds["phase"].values[:, 0]).tolist() == [[False, True, False]] * 2


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ("count=0", r"\[ensemble\] count is 0; allowed: a whole number of at least 1"),
        ("seed=-1", r"\[ensemble\] seed is -1; allowed: a whole number of at least 0"),
        ("cuont=3", r"\[ensemble\] cuont is unknown.* Did you mean 'count'\?"),
        ("vary=3", r"\[ensemble\] vary is 3; allowed: a table of keys"),
        ('table="runs.csv"', "is 'count, seed, vary, table'; allowed: either table, or count, seed and vary"),
        ("vary.scan.setpoint=0.5", r"\[ensemble.vary\] scan.setpoint is 0.5; allowed: a list of values, or"),
        ("vary.scan.setpoint=[]", r"scan.setpoint is \[\]; allowed: a list of at least one value"),
        ("vary.scan.setpoint={low=0.5}", r"\[ensemble.vary\] scan.setpoint high is missing"),
        ("vary.scan.setpoint={low=0.5, hihg=1}", r"scan.setpoint hihg is unknown.* Did you mean 'high'\?"),
        ("vary.scan.setpoint={low=0.9, high=0.5}", "setpoint high is 0.5; allowed: a finite number of at least 0.9"),
        ("vary.scan.setpoint={low=0.5, high=inf}", r"scan.setpoint high is inf; allowed: a finite number"),
        ('vary.tip.radius={low=0, high=1e-8, scale="log"}', r"tip.radius low is 0; allowed: a finite number above 0"),
        ('vary.tip.radius={low=0, high=1e-8, scale="lgo"}', r"tip.radius scale is 'lgo'.* Did you mean 'log'\?"),
        ("vary.tip.radius={low=0.5, high=2, whole=true}", r"tip.radius low is 0.5; allowed: a whole number"),
        ("vary.tip.radius={low=1, high=2, whole=1}", r"tip.radius whole is 1; allowed: true or false"),
        ('vary.tip.radius={low=1, high=2, whole=true, scale="log"}', "'log'; allowed: 'linear' for whole"),
        ("vary.setpoint=[0.5]", "key of .* is 'setpoint'; allowed: table.key, such as scan.setpoint"),
        ("vary.scna.setpoint=[0.5]", "the table of scna.setpoint is 'scna'.* Did you mean 'scan'"),
        ('vary.output.file=["a.nc"]', "the table of output.file is 'output'; allowed: one of scan"),
        ("vary.materials.sofft.modulus=[1e9]", "the material of .* is 'sofft'.* soft, hard. Did you mean 'soft'"),
        ("vary.materials.hard.moduls=[1e9]", "moduls of sample 0 is unknown.* Did you mean 'modulus'"),
        ("vary.materials.hard.modulus={low=-9e9, high=1e9}", r"modulus of sample \d is -\d+.* at least 0 Pa"),
        ("vary.surface.materials=[3]", r"\[surface\] materials of sample 0 is 3; allowed: a list of names"),
        ("vary.tip.radius.x=[3]", "key of sample 0 is 'tip.radius.x'; allowed: a key of a table; radius is none"),
        ("vary.tip.radius={lo=1, hi=2}", r"\[ensemble.vary\] tip.radius.lo is 1; allowed: a list of values, or { low"),
    ],
)  # fmt: skip
def test_what_is_not_allowed_is_said_in_one_sentence(tmp_path: Path, override: str, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        load_ensemble(written(tmp_path), [f"ensemble.{override}"])


@pytest.mark.parametrize(
    ("table", "sentence"),
    [
        (None, "cannot read .*runs.csv, named in .ensemble. table: No such file"),
        ("", "needs a header with a key for each column, and a row for each sample"),
        ("scan.setpoint\n", "needs a header with a key for each column, and a row for each sample"),
        ("scan.setpoint,scan.setpoint\n0.5,0.6\n", "needs a header with a key for each column"),
        ("scan.setpoint,tip.radius\n0.5,1e-8\n0.5\n", "sample 1 has not one value for each key"),
        ("scan.setpoint,tip.radius\n0.5,\n", "sample 0 has not one value for each key"),
        ("scan.setpoint\n0.5\n1.5\n", r"\[scan\] setpoint of sample 1 is 1.5; allowed"),
    ],
)
def test_a_table_that_cannot_be_used_is_named(tmp_path: Path, table: str | None, sentence: str) -> None:
    if table is not None:
        (tmp_path / "runs.csv").write_text(table)
    with pytest.raises((FileError, InputError), match=sentence):
        load_ensemble(written(tmp_path, '[ensemble]\ntable = "runs.csv"\n'))


def test_a_key_that_is_varied_cannot_be_set_too(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"override is 'scan\.setpoint=0\.6'; allowed: a key that the ensemble does not"
    ):
        load_ensemble(written(tmp_path), ["scan.setpoint=0.6"])
    presets = '[ensemble]\ncount = 2\n[ensemble.vary]\n"materials.soft.preset" = ["PS", "LDPE"]\n'
    with pytest.raises(InputError, match=r"does not vary, not materials\.soft\.modulus"):
        load_ensemble(written(tmp_path, presets), ["materials.soft.modulus=2e9"])


def test_what_varies_within_materials_is_varied_as_a_share(tmp_path: Path) -> None:
    share = '[ensemble]\ncount = 2\n[ensemble.vary]\n"surface.variation.modulus" = [0.1, 0.2]\n'
    scene = SCENE.replace("pixel_size = 4e-9", 'pixel_size = 4e-9\nvariation = { correlation_length = "8 nm" }')
    load_ensemble(written(tmp_path, share, scene)).simulate(tmp_path / "out.nc")
    assert load(tmp_path / "out.nc")["surface.variation.modulus"].attrs["units"] == "1"


def test_a_file_is_either_a_scene_or_an_ensemble(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="Use load_ensemble"):
        load_scene(written(tmp_path))
    with pytest.raises(InputError, match=r"\[ensemble\] count is missing"):
        load_ensemble(written(tmp_path / "single", ""))


def test_images_that_do_not_fit_together_are_refused_with_the_sample(tmp_path: Path) -> None:
    table = {"sizes": ("[[0, 1]]", "[[0], [1]]"), "variables": ('["phase"]', '["height"]')}
    for name, key in {"sizes": "surface.labels", "variables": "output.variables"}.items():
        rows = "\n".join('"{}"'.format(cell.replace('"', '""')) for cell in table[name])
        folder = tmp_path / name
        folder.mkdir()
        (folder / "runs.csv").write_text(f"{key}\n{rows}\n")
    ensemble = load_ensemble(written(tmp_path / "sizes", '[ensemble]\ntable = "runs.csv"\n'))
    sentence = r"number of pixels of sample 1 is \(2, 1\); allowed: \(1, 2\), as in sample 0"
    with pytest.raises(InputError, match=sentence):
        ensemble.check()
    with pytest.raises(InputError, match=sentence):
        ensemble.simulate(tmp_path / "out.nc")
    assert made(tmp_path / "out.nc.parts") == 1
    tables = dict(ensemble.tables) | {"surface": {**ensemble.tables["surface"], "labels": [[0, 1]]}}
    samples = ({"output.variables": ["phase"]}, {"output.variables": ["height"]})
    mixed = Ensemble(tables, samples, tmp_path)
    with pytest.raises(InputError, match=r"shape of phase in sample 1 is None; allowed: \(1, 2\), as in sample 0"):
        mixed.simulate(tmp_path / "mixed.nc")
    assert not (tmp_path / "mixed.nc").exists()


def test_samples_of_another_force_table_are_not_taken_for_those_of_this(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    law = '[interaction]\ncontact = { law = "table", file = "forces.csv" }\n'
    written(tmp_path / "inside", scene=SCENE + law)
    kept = []
    for stiffer in (1.0, 2.0):
        rows = "".join(f"{d},{stiffer * (d + 0.1)}\n" for d in (0.0, 0.5, 1.0, 2.0, 5.0))
        (tmp_path / "inside" / "forces.csv").write_text("# depth [nm], force [nN]\n" + rows)
        ensemble = load_ensemble("inside/ensemble.toml")
        tables = (ensemble._tables(sample) for sample in range(len(ensemble)))
        kept.append({file.name for file in PartsFolder(tmp_path / "out.nc", tables, ensemble.folder).files})
    assert not kept[0] & kept[1]
    assert ensemble.scene(0).microscope.interaction.contact.forces[0] == pytest.approx(0.2e-9)


def test_a_damaged_sample_is_named(ensemble: Ensemble, tmp_path: Path) -> None:
    path = tmp_path / "out.nc"
    with pytest.raises(KeyboardInterrupt):
        ensemble.simulate(path, progress=stop_after(2))
    next((tmp_path / "out.nc.parts").iterdir()).write_bytes(b"half")
    with pytest.raises(PhasemapError, match=r"the sample in .*\.nc is damaged; remove this file and run again"):
        ensemble.simulate(path)


def test_errors_come_whole_out_of_another_process() -> None:
    error = InputError("setpoint", 1.2, "a number below 1", "Lower it.")
    copy = pickle.loads(pickle.dumps(error))
    assert str(copy) == str(error) and (copy.name, copy.value, copy.hint) == ("setpoint", 1.2, "Lower it.")
    with pytest.raises(ValueError, match=r"math domain error|expected a nonnegative input"):
        list(in_processes(math.sqrt, [4.0, -1.0], 2))


def test_a_worker_that_dies_is_missed() -> None:
    with pytest.raises(PhasemapError, match=r"a worker process ended early \(exit code 3\)"):
        list(in_processes(os._exit, [3, 3], 2))


def test_processes_do_every_item_once_and_end_when_they_are_told() -> None:
    assert sorted(in_processes(abs, range(-7, 0), 2)) == [1, 2, 3, 4, 5, 6, 7]
    endless = in_processes(abs, itertools.count(1), 2)
    assert next(endless) in (1, 2)
    assert len(multiprocessing.active_children()) == 2
    endless.close()
    assert multiprocessing.active_children() == []


def test_a_scan_keeps_trace_and_retrace_apart(tmp_path: Path) -> None:
    lines = np.arange(24.0).reshape(2, 2, 2, 3)  # sample, direction, y, x
    dims, coords = ("direction", "y", "x"), {"direction": ["trace", "retrace"], "y": [0.0, 1.0], "x": [0.0, 1.0, 2.0]}
    scans = [
        xr.Dataset({"phase": (dims, scan), "status": (dims, (scan > 20).astype(np.int8))}, coords) for scan in lines
    ]
    files = [save(scan, tmp_path / f"{i}.nc") for i, scan in enumerate(scans)]
    for name in ("once.nc", "twice.nc"):
        assemble(tmp_path / name, files, [("scan.solver", {}, ["orbit", "march"])], {}, overwrite=False)
    ds = load(tmp_path / "once.nc")
    assert ds["phase"].dims == ("sample", "direction", "y", "x")
    assert ds["direction"].values.tolist() == ["trace", "retrace"]
    assert np.array_equal(ds["phase"].values, lines)
    assert ds["failed"].values.tolist() == [0, 3]
    assert (tmp_path / "once.nc").read_bytes() == (tmp_path / "twice.nc").read_bytes()


def test_the_command_runs_checks_and_draws_an_ensemble(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene, out = str(SAMPLE), str(tmp_path / "out.nc")
    small = ["surface.shape=[8, 8]", "surface.spacing=32e-9", "ensemble.count=3"]
    assert main(["validate", scene, *small]) == 0
    said = capsys.readouterr().out
    assert "samples     3\n" in said and re.search(r"^varied      surface.seed: \d+ to \d+$", said, re.MULTILINE)
    assert said.endswith("The scene is valid.\n")
    assert main(["run", scene, *small, "-o", out, "--workers", "1"]) == 0
    said = capsys.readouterr().out
    assert "samples     3\n" in said and "failed      none\n" in said and f"written to  {out}\n" in said
    assert not (tmp_path / "out.nc.parts").exists()
    assert main(["plot", out]) == 2
    assert "an ensemble of 3 images; allowed: one of them (--sample N)" in capsys.readouterr().err
    assert main(["plot", out, "--sample", "3"]) == 2
    assert "sample is 3; allowed: a whole number from 0 to 2" in capsys.readouterr().err
    assert main(["plot", out, "--sample", "2"]) == 0
    assert (tmp_path / "out.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (
            ["run", str(SAMPLE), "--threads", "2", "-o", "x.nc"],
            "--threads is for one image; an ensemble takes --workers",
        ),
        (["run", str(SAMPLE), "--strict", "-o", "x.nc"], "--strict is for one image"),
        (["run", str(SAMPLE.with_name("step.toml")), "--workers", "2", "-o", "x.nc"], "--workers is for an ensemble"),
        (["run", str(SAMPLE)], "give -o OUT.nc, or file under [output]"),
    ],
)
def test_options_that_would_do_nothing_are_refused(
    arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    assert sentence in capsys.readouterr().err


def test_a_range_of_one_number_gives_that_number() -> None:
    rng = np.random.default_rng(1)
    assert {Range(2e9, 2e9, scale).draw(rng) for scale in ("linear", "log")} == {2e9}


def test_an_ensemble_is_drawn_from_ranges_and_choices_with_units(tmp_path: Path) -> None:
    ranges = "tip.radius = {{ low = {0}, high = {1} }}\ndrive.free_amplitude = [{2}, {3}]\n"
    scene = (SAMPLE.parent / "step.toml").read_text() + "\n[ensemble]\ncount = 5\n[ensemble.vary]\n"
    texts = ranges.format('"8 nm"', '"12 nm"', '"20 nm"', '"40 nm"'), ranges.format("8e-9", "12e-9", "20e-9", "40e-9")
    drawn = []
    for text in texts:
        (tmp_path / "many.toml").write_text(scene + text)
        drawn.append(pm.load_ensemble(tmp_path / "many.toml").samples)
    assert drawn[0] == drawn[1]
    (tmp_path / "many.toml").write_text(scene + 'tip.radius = { low = "8 kHz", high = "12 nm" }\n')
    with pytest.raises(pm.InputError, match=r"tip.radius low is '8 kHz'; allowed: a length such as '40 nm'\."):
        pm.load_ensemble(tmp_path / "many.toml")
