"""Long simulations that are killed go on where they were, and nothing about the image shows it."""

from __future__ import annotations

import errno
import itertools
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

import phasemap as pm
from phasemap import checkpoint
from phasemap.checkpoint import Checkpoint, discard
from phasemap.interaction import Interaction

SCOPE = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(20e-9))
RNG = np.random.default_rng(4)
RELIEF = RNG.normal(0.0, 0.2e-9, (24, 12))
FEW = pm.Surface(
    RNG.choice([1e9, 2e9, 5e9], (24, 12)), RNG.choice([0.02, 0.08], (24, 12)), 0.01, topography=RELIEF, pixel_size=4e-9
)
MANY = pm.Surface(RNG.uniform(1e9, 4e9, (100, 90)), RNG.uniform(0.02, 0.07, (100, 90)), 0.01, pixel_size=4e-9)
LABELS = pm.Surface.from_labels(
    np.arange(24 * 12).reshape(24, 12) // 5 % 3,
    {0: pm.Material(1e9, 0.05, 0.01), 1: pm.Material(3e9, 0.02), 2: pm.Material(8e9, 0.08)},
    pixel_size=4e-9,
)
CHANGED = pm.Realism(temperature=300.0, tip_change=pm.TipChange(9, 20e-9), line_offset=1e-10, seed=3)
CASES: dict[str, tuple[pm.Surface, dict[str, Any]]] = {
    "engaged": (FEW, {}),
    "interpolated": (MANY, {}),
    "averaged, two tips": (FEW, {"solver": "averaging", "realism": pm.Realism(tip_change=pm.TipChange(9, 20e-9))}),
    "raster, engaged once": (FEW, {"control": pm.Raster("image")}),
    "feedback": (LABELS, {"control": pm.Feedback(line_rate=8.0)}),
    "noisy feedback, engaged once, two tips": (
        LABELS, {"control": pm.Feedback(line_rate=8.0, engage="image"), "realism": CHANGED},
    ),
}  # fmt: skip


class Killed(Exception):
    """In place of the end of a process."""


def same_data(a: xr.Dataset, b: xr.Dataset) -> bool:
    """Bits of all variables, and attributes but those that say when and how long."""
    times = {"seconds", "history"}
    said = [{name: str(value) for name, value in ds.attrs.items() if name not in times} for ds in (a, b)]
    return said[0] == said[1] and all(a[name].values.tobytes() == b[name].values.tobytes() for name in a.variables)


@pytest.fixture
def eager(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every line is kept at once."""
    monkeypatch.setattr(checkpoint, "EVERY", 0.0)


def written(folder: Path) -> Iterator[tuple[int, int]]:
    """First and last line of each part."""
    for file in sorted(folder.glob("[0-9a-f]*-lines-*.npz")):
        first, last = file.stem.split("-")[2:]
        yield int(first), int(last)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.usefixtures("eager")
def test_an_image_that_was_killed_twice_is_the_same_to_the_last_bit(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    surface, options = CASES[name]
    expected = pm.simulate(surface, SCOPE, 0.7, **options)
    folder, keep = tmp_path / "parts", Checkpoint.keep
    for parts in (2, 3):

        def keep_and_die(self: Checkpoint, lines: checkpoint.Lines, parts: int = parts) -> None:
            keep(self, lines)
            if len(list(written(folder))) == parts:
                raise Killed

        monkeypatch.setattr(Checkpoint, "keep", keep_and_die)
        with pytest.raises(Killed):
            pm.simulate(surface, SCOPE, 0.7, **options, checkpoint=folder)
    monkeypatch.setattr(Checkpoint, "keep", keep)
    assert max(last for _, last in written(folder)) < surface.shape[0]
    assert same_data(pm.simulate(surface, SCOPE, 0.7, **options, checkpoint=folder), expected)
    discard(folder)
    assert not folder.exists()


@settings(max_examples=25, deadline=None)
@given(cuts=st.sets(st.integers(1, 23)), name=st.sampled_from([name for name in CASES if CASES[name][0] is FEW]))
def test_an_image_does_not_depend_on_where_it_is_cut(cuts: set[int], name: str) -> None:
    from phasemap.accuracy import Accuracy
    from phasemap.canvas import Canvas
    from phasemap.dataset import check_variables, variables_of
    from phasemap.job import Job
    from phasemap.painting import paint_part, painter_of, plan_image
    from phasemap.solvers import by_name
    from phasemap.survey import Place, survey

    surface, options = CASES[name]
    control, realism = options.get("control", pm.Engage()), options.get("realism", pm.Realism())
    names = check_variables(None, variables_of(control))
    job = Job(
        surface, Place(0, 0, surface.shape), SCOPE, 0.7 * SCOPE.free_amplitude, control,
        by_name(options.get("solver", "auto")), Accuracy(), realism, names, 1,
    )  # fmt: skip
    stretches = plan_image(job, survey(surface, painter_of(control).most(job)))
    canvas, state = Canvas(surface, names, control.directions), None
    bounds = [0, *sorted(cuts), 24]
    for first, last in itertools.pairwise(bounds):
        part = surface.rows(rows := slice(first, last))
        mine = canvas.part(part, rows)
        state = paint_part(replace(job, surface=part, place=Place(first, 0, surface.shape)), stretches, mine, state)
    expected = pm.simulate(surface, SCOPE, 0.7, **options)
    assert all(array.tobytes() == expected[variable].values.tobytes() for variable, array in canvas.arrays().items())


@pytest.mark.usefixtures("eager")
def test_lines_that_were_kept_are_not_painted_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    surface, options = CASES["raster, engaged once"]
    pm.simulate(surface, SCOPE, 0.7, **options, checkpoint=tmp_path / "parts")
    painted: list[int] = []
    real = checkpoint.paint_part
    monkeypatch.setattr(checkpoint, "paint_part", lambda job, *rest: painted.append(job.place.row) or real(job, *rest))
    removed = sorted((tmp_path / "parts").glob("*-lines-*"))[-3:]
    for file in removed:
        file.unlink()
    pm.simulate(surface, SCOPE, 0.7, **options, checkpoint=tmp_path / "parts")
    assert painted[0] == min(int(file.stem.split("-")[2]) for file in removed) > 0


@pytest.mark.usefixtures("eager")
def test_what_another_simulation_left_is_never_taken(tmp_path: Path) -> None:
    other = pm.Surface(FEW.modulus * 1.5, FEW.adhesion, 0.01, topography=RELIEF, pixel_size=4e-9)
    pm.simulate(other, SCOPE, 0.7, checkpoint=tmp_path)
    pm.simulate(FEW, SCOPE, 0.6, checkpoint=tmp_path)
    pm.simulate(FEW, SCOPE, 0.7, "averaging", checkpoint=tmp_path)
    image = pm.simulate(FEW, SCOPE, 0.7, checkpoint=tmp_path)
    assert same_data(image, pm.simulate(FEW, SCOPE, 0.7))


@pytest.mark.parametrize("damage", ["cut short", "empty", "no archive"])
@pytest.mark.usefixtures("eager")
def test_a_damaged_part_is_painted_again(damage: str, tmp_path: Path) -> None:
    expected = pm.simulate(FEW, SCOPE, 0.7, checkpoint=tmp_path)
    file = sorted(tmp_path.glob("*-lines-*"))[1]
    whole = file.read_bytes()
    file.write_bytes({"cut short": whole[: len(whole) // 2], "empty": b"", "no archive": b"x" * 100}[damage])
    assert same_data(pm.simulate(FEW, SCOPE, 0.7, checkpoint=tmp_path), expected)


@pytest.mark.usefixtures("eager")
def test_a_full_disk_costs_a_warning_and_not_the_image(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(file: Path, **arrays: np.ndarray) -> None:
        Path(file).write_bytes(b"some of it")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(np, "savez", full)
    with pytest.warns(UserWarning, match=r"nothing is kept for another try: .*No space left on device"):
        image = pm.simulate(FEW, SCOPE, 0.7, checkpoint=tmp_path)
    assert same_data(image, pm.simulate(FEW, SCOPE, 0.7))
    assert list(tmp_path.iterdir()) == []


def test_an_image_that_takes_no_time_writes_nothing(tmp_path: Path) -> None:
    pm.simulate(FEW, SCOPE, 0.7, checkpoint=tmp_path / "parts")
    assert list(tmp_path.iterdir()) == []


def test_a_file_in_the_place_of_the_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "parts").touch()
    with pytest.raises(pm.FileError, match="it is no folder"):
        pm.simulate(FEW, SCOPE, 0.7, checkpoint=tmp_path / "parts")


def test_a_law_with_another_formula_is_another_simulation(tmp_path: Path) -> None:
    law = Interaction().law

    def name_with(source: str) -> str:
        namespace: dict[str, Any] = {"base": type(law)}
        file = tmp_path / "mylaw.py"
        file.write_text(source)
        exec(compile(source, file, "exec"), namespace)
        return Checkpoint(tmp_path, FEW, namespace["Law"](), {})._name

    assert Checkpoint(tmp_path, FEW, law, {})._name == Checkpoint(tmp_path, FEW, Interaction().law, {})._name
    assert name_with("class Law(base): pass") != name_with("class Law(base): x = 1")


# The command

SLOW = [
    "run", "samples/bistable.toml", "--quiet", "surface.shape=[120, 32]", "surface.spacing=60e-9",
    "control.line_rate=8", "-o",
]  # fmt: skip
IMPATIENT = "import sys, phasemap.checkpoint as c; c.EVERY = 0.1; from phasemap.cli import main; sys.exit(main())"


@pytest.fixture(scope="module")
def undisturbed() -> xr.Dataset:
    return pm.load_scene(SLOW[1], [word for word in SLOW if "=" in word]).simulate()


def heeding() -> None:
    """A shell lets what it starts in the background ignore Ctrl-C."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.mark.parametrize("stop", [signal.SIGKILL, signal.SIGINT])
def test_a_command_that_was_stopped_goes_on(stop: signal.Signals, undisturbed: xr.Dataset, tmp_path: Path) -> None:
    output = tmp_path / "image.nc"
    command = [sys.executable, "-c", IMPATIENT, *SLOW, str(output)]
    parts = tmp_path / "image.nc.parts"
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, preexec_fn=heeding) as run:
        while not list(written(parts)) and run.poll() is None:
            time.sleep(0.02)
        run.send_signal(stop)
        said = run.communicate()[1]
    assert run.returncode == {signal.SIGKILL: -9, signal.SIGINT: 130}[stop] and "Traceback" not in said
    assert not output.exists() and 0 < max(last for _, last in written(parts)) < 120
    if stop == signal.SIGINT:
        assert f"what is done is kept in {parts}; run the same command again to go on" in said
    subprocess.run(command, check=True)
    assert list(tmp_path.iterdir()) == [output]
    with xr.open_dataset(output) as image:
        assert same_data(image, undisturbed)
