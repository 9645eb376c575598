"""Long simulations that are killed go on where they were, and nothing about the image shows it."""

from __future__ import annotations

import errno
import importlib.util
import itertools
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

import phasemap as pm
from phasemap.cli import main
from phasemap.experiment.interaction import ContactLaw, Interaction
from phasemap.imaging import checkpoint, job
from phasemap.imaging.checkpoint import Checkpoint, discard

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

        def keep_and_die(self: Checkpoint, lines: checkpoint.FilledLines, parts: int = parts) -> None:
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


@pytest.mark.usefixtures("eager")
def test_images_at_several_setpoints_are_kept_in_the_folder_and_deleted_with_it(tmp_path: Path) -> None:
    expected, folder = pm.simulate(FEW, SCOPE, [0.7, 0.6]), tmp_path / "parts"
    for _ in range(2):
        assert same_data(pm.simulate(FEW, SCOPE, [0.7, 0.6], checkpoint=folder), expected)
    assert len({file.name.split("-")[0] for file in folder.glob("*-lines-*")}) == 2
    discard(folder)
    assert not folder.exists()


def test_surfaces_that_are_equal_give_equal_images_whatever_was_known_of_one() -> None:
    soft_above_stiff = {0: pm.Material(0.3e9, 0.05, 0.01), 1: pm.Material(9e9, 0.05)}
    labelled = pm.Surface.from_labels(np.repeat([[0], [1]], 4, axis=1), soft_above_stiff, pixel_size=4e-9)
    soft = labelled.rows(slice(0, 1))
    afresh = pm.Surface(soft.modulus, soft.adhesion, soft.damping, pixel_size=4e-9)
    a, b = (pm.simulate(one, SCOPE, 0.7, control=pm.Feedback(line_rate=8.0)) for one in (soft, afresh))
    assert soft == afresh and same_data(a, b)


@settings(max_examples=25, deadline=None)
@given(cuts=st.sets(st.integers(1, 23)), name=st.sampled_from([name for name in CASES if CASES[name][0] is FEW]))
def test_an_image_does_not_depend_on_where_it_is_cut(cuts: set[int], name: str) -> None:
    from phasemap.experiment.accuracy import Accuracy
    from phasemap.imaging.canvas import Canvas
    from phasemap.imaging.job import Job, fill_part, plan_image, simulator_of
    from phasemap.imaging.materials import Window, survey
    from phasemap.results.variables import check_variables, variables_of
    from phasemap.solvers.solver import by_name

    surface, options = CASES[name]
    control, realism = options.get("control", pm.Engage()), options.get("realism", pm.Realism())
    names = check_variables(None, variables_of(control))
    job = Job(
        surface, Window(0, 0, surface.shape), SCOPE, 0.7 * SCOPE.driven_amplitude, control,
        by_name(options.get("solver", "auto")), Accuracy(), realism, names, 1,
    )  # fmt: skip
    stretches = plan_image(job, survey(surface, simulator_of(control).most(job)))
    canvas, state = Canvas(surface, names, control.directions), None
    bounds = [0, *sorted(cuts), 24]
    for first, last in itertools.pairwise(bounds):
        part = surface.rows(rows := slice(first, last))
        mine = canvas.part(part, rows)
        state = fill_part(replace(job, surface=part, place=Window(first, 0, surface.shape)), stretches, mine, state)
    expected = pm.simulate(surface, SCOPE, 0.7, **options)
    assert all(array.tobytes() == expected[variable].values.tobytes() for variable, array in canvas.arrays().items())


@pytest.mark.usefixtures("eager")
def test_lines_that_were_kept_are_not_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    surface, options = CASES["raster, engaged once"]
    pm.simulate(surface, SCOPE, 0.7, **options, checkpoint=tmp_path / "parts")
    filled: list[int] = []
    real = job.fill_part
    monkeypatch.setattr(job, "fill_part", lambda part, *rest: filled.append(part.place.row) or real(part, *rest))
    removed = sorted((tmp_path / "parts").glob("*-lines-*"))[-3:]
    for file in removed:
        file.unlink()
    pm.simulate(surface, SCOPE, 0.7, **options, checkpoint=tmp_path / "parts")
    assert filled[0] == min(int(file.stem.split("-")[2]) for file in removed) > 0


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
def test_a_damaged_part_is_made_again(damage: str, tmp_path: Path) -> None:
    expected = pm.simulate(FEW, SCOPE, 0.7, checkpoint=tmp_path)
    file = sorted(tmp_path.glob("*-lines-*"))[1]
    whole = file.read_bytes()
    file.write_bytes({"cut short": whole[: len(whole) // 2], "empty": b"", "no archive": b"x" * 100}[damage])
    assert same_data(pm.simulate(FEW, SCOPE, 0.7, checkpoint=tmp_path), expected)


Arrays = dict[str, np.ndarray]
MISFITS: dict[str, Callable[[Arrays], Arrays]] = {
    "of fewer lines": lambda part: {**part, "variable.phase": part["variable.phase"][:, :1]},
    "with other numbers": lambda part: {**part, "variable.phase": part["variable.phase"].astype(np.float32)},
    "with one variable less": lambda part: {name: one for name, one in part.items() if name != "variable.phase"},
    "with one variable more": lambda part: {**part, "variable.colour": part["variable.phase"]},
    "without a state": lambda part: {name: one for name, one in part.items() if not name.startswith("state")},
}


@pytest.mark.parametrize("misfit", MISFITS)
@pytest.mark.usefixtures("eager")
def test_a_part_that_does_not_fit_is_made_again(misfit: str, tmp_path: Path) -> None:
    surface, options = CASES["raster, engaged once"]
    expected = pm.simulate(surface, SCOPE, 0.7, **options, checkpoint=tmp_path)
    file = sorted(tmp_path.glob("*-lines-*"))[1]
    with np.load(file) as found:
        part = MISFITS[misfit](dict(found))
    np.savez(file, **{**part, checkpoint.LIST: np.array([name for name in part if name != checkpoint.LIST])})
    assert same_data(pm.simulate(surface, SCOPE, 0.7, **options, checkpoint=tmp_path), expected)


@pytest.mark.usefixtures("eager")
def test_the_state_of_another_lever_is_never_handed_to_compiled_code() -> None:
    from phasemap._kernels import columns as col
    from phasemap.imaging.feedback.lines import LoopState

    state = LoopState(col.AVERAGING).freeze()
    for wrong in ({**state, "y": state["y"][:1]}, {**state, "loop": np.zeros(1)}, {**state, "engine": np.array(9)}):
        with pytest.raises((KeyError, ValueError)):
            LoopState.thaw(wrong)


@pytest.mark.usefixtures("eager")
def test_a_part_without_lines_is_passed_over(tmp_path: Path) -> None:
    expected = pm.simulate(FEW, SCOPE, 0.7, checkpoint=tmp_path)
    first = min(tmp_path.glob("*-lines-*"))
    first.rename(first.with_name(f"{first.stem.split('-')[0]}-lines-{0:08}-{0:08}.npz"))
    assert same_data(pm.simulate(FEW, SCOPE, 0.7, checkpoint=tmp_path), expected)


@pytest.mark.usefixtures("eager")
def test_a_part_with_a_wrong_bit_is_read_whole_or_not_at_all(tmp_path: Path) -> None:
    pm.simulate(FEW, SCOPE, 0.7, checkpoint=tmp_path)
    file = min(tmp_path.glob("*-lines-*"))
    whole, content, draw = checkpoint._read(file), file.read_bytes(), random.Random(7)
    directory = content.index(b"PK\x01\x02")  # the end of the file, which no checksum guards
    bits = [draw.randrange(8 * directory) for _ in range(50)] + [*range(8 * directory, 8 * len(content), 17)]
    for bit in bits:
        damaged = bytearray(content)
        damaged[bit // 8] ^= 1 << bit % 8
        file.write_bytes(damaged)
        found = checkpoint._read(file)
        assert not found or {name: one.tobytes() for name, one in found.items()} == {
            name: one.tobytes() for name, one in whole.items()
        }


def test_materials_that_were_kept_are_not_solved_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from phasemap.imaging import job

    surface = pm.Surface(np.linspace(1e9, 4e9, 400).reshape(20, 20), 0.05, 0.01, pixel_size=4e-9)
    options: dict[str, Any] = {
        "solver": "averaging", "control": pm.Raster(), "realism": pm.Realism(tip_change=pm.TipChange(9, 20e-9)),
        "threads": 1,
    }  # fmt: skip
    expected = pm.simulate(surface, SCOPE, 0.7, **options)
    monkeypatch.setattr(checkpoint, "EVERY", 0.0)
    solved: list[tuple[float, float]] = []
    real, remember = job.Job.work, Checkpoint.remember

    def work(self: job.Job, materials: np.ndarray) -> Any:
        solved.extend((modulus, self.scope.tip.radius) for modulus in materials[:, 0])
        return real(self, materials)

    def remember_and_die(self: Checkpoint, name: str, values: Any) -> None:
        remember(self, name, values)
        if len(solved) > 500:  # with the second tip
            raise Killed

    monkeypatch.setattr(job.Job, "work", work)
    monkeypatch.setattr(Checkpoint, "remember", remember_and_die)
    with pytest.raises(Killed):
        pm.simulate(surface, SCOPE, 0.7, **options, checkpoint=tmp_path)
    monkeypatch.setattr(Checkpoint, "remember", remember)
    assert same_data(pm.simulate(surface, SCOPE, 0.7, **options, checkpoint=tmp_path), expected)
    assert len(solved) == len(set(solved)) == 2 * 400


@pytest.mark.parametrize("seconds", [0.01, 0.3, 5.0])
def test_portions_take_the_time_between_two_files_and_leave_no_thread_without_work(
    seconds: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = 0.0
    monkeypatch.setattr(checkpoint.time, "monotonic", lambda: now)
    sizes = []
    for part in Checkpoint(tmp_path, FEW, Interaction().law, {}).portions(3, 10_000, 4, 1000):
        now += seconds * (part.stop - part.start) / 4  # four lines at the same time
        sizes.append(part.stop - part.start)
    assert sum(sizes) == 10_000 - 3 and all(size % 4 == 0 for size in sizes[:-1])
    # Between one and two files' time, or the least that there is.
    assert all(size == max(4, min(1000, int(4 * checkpoint.EVERY / seconds + 0.01) // 4 * 4)) for size in sizes[4:-1])


@pytest.mark.usefixtures("eager")
def test_progress_of_a_scan_that_goes_on_counts_lines(tmp_path: Path) -> None:
    surface, options = CASES["feedback"]
    pm.simulate(surface, SCOPE, 0.7, **options, checkpoint=tmp_path)
    max(tmp_path.glob("*-lines-*")).unlink()
    said: list[tuple[int, int]] = []
    pm.simulate(surface, SCOPE, 0.7, **options, checkpoint=tmp_path, progress=lambda *numbers: said.append(numbers))
    assert said and {total for _, total in said} == {24} and said[0][0] > 1 and said[-1][0] == 24


@pytest.mark.parametrize("place", ["no such folder/parts", "null\0byte"])
@pytest.mark.usefixtures("eager")
def test_a_folder_that_cannot_be_made_costs_a_warning_and_not_the_image(place: str, tmp_path: Path) -> None:
    with pytest.warns(UserWarning, match="nothing is kept for another try"):
        image = pm.simulate(FEW, SCOPE, 0.7, checkpoint=tmp_path / place)
    assert same_data(image, pm.simulate(FEW, SCOPE, 0.7))


@pytest.mark.usefixtures("eager")
def test_a_folder_that_vanishes_is_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    keep, folder = Checkpoint.keep, tmp_path / "parts"

    def keep_and_lose(self: Checkpoint, lines: checkpoint.FilledLines) -> None:
        keep(self, lines)
        if lines.first < 6:
            discard(folder)  # as another run with the same output does in the end

    monkeypatch.setattr(Checkpoint, "keep", keep_and_lose)
    expected = pm.simulate(FEW, SCOPE, 0.7)
    for _ in range(2):
        assert same_data(pm.simulate(FEW, SCOPE, 0.7, checkpoint=folder, threads=1), expected)
    assert folder.exists()


@pytest.mark.usefixtures("eager")
def test_a_full_disk_costs_a_warning_and_not_the_image(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(file: Path, **arrays: np.ndarray) -> None:
        Path(file).write_bytes(b"some of it")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(np, "savez", full)
    with pytest.warns(UserWarning, match=r"nothing is kept for another try: .*the disk is full"):
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


CONE = """
import math
from phasemap.experiment.interaction import ContactLaw
HALF_ANGLE = {angle}
class Cone(ContactLaw):
    @staticmethod
    def force(d, p):
        return p[0] * math.tan(HALF_ANGLE) * d * d
"""


def test_a_law_with_another_formula_is_another_simulation(tmp_path: Path) -> None:
    def name_of(law: Any) -> str:
        return Checkpoint(tmp_path, FEW, law, {})._name

    def in_file(source: str) -> Any:
        (tmp_path / "mylaw.py").write_text(source)
        spec = importlib.util.spec_from_file_location("mylaw", tmp_path / "mylaw.py")
        assert spec is not None and spec.loader is not None
        sys.modules["mylaw"] = module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module.Cone()

    def sloped(slope: float) -> Any:
        class Sloped(ContactLaw):
            @staticmethod
            def force(d: float, p: np.ndarray) -> float:
                return slope * p[0] * d * d

        return Sloped()

    assert name_of(Interaction().law) == name_of(Interaction().law)
    assert name_of(in_file(CONE.format(angle=0.5))) == name_of(in_file(CONE.format(angle=0.5)))
    assert name_of(in_file(CONE.format(angle=0.5))) != name_of(in_file(CONE.format(angle=0.6)))
    assert name_of(sloped(0.5)) == name_of(sloped(0.5)) != name_of(sloped(0.6))


# The command

SLOW = [
    "run", "samples/bistable.toml", "--quiet", "surface.shape=[60, 32]", "surface.spacing=60e-9",
    "control.line_rate=8", "-o",
]  # fmt: skip
EAGER = "import sys, phasemap.imaging.checkpoint as c; c.EVERY = 0.0; from phasemap.cli import main; sys.exit(main())"
WAITING = """
import sys, threading, phasemap.imaging.checkpoint as c
from phasemap.cli import main
from phasemap.cli import run as cli_run
c.EVERY, keep = 0.0, c.Checkpoint.keep
def keep_and_wait(self, lines):
    keep(self, lines)
    threading.Event().wait()  # in the middle of the work, whatever else the machine does
c.Checkpoint.keep = keep_and_wait
sys.exit(main())
"""


@pytest.fixture(scope="module")
def undisturbed() -> xr.Dataset:
    return pm.load_scene(SLOW[1], [word for word in SLOW if "=" in word]).simulate()


def heeding() -> None:
    """A shell lets what it starts in the background ignore Ctrl-C."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.mark.parametrize(
    "stop", [pytest.param(one, marks=pytest.mark.slow) for one in (signal.SIGKILL, signal.SIGTERM)] + [signal.SIGINT]
)
def test_a_command_that_was_stopped_goes_on(
    stop: signal.Signals, undisturbed: xr.Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    output = tmp_path / "image.nc"
    command = [*SLOW, str(output)]
    parts = tmp_path / "image.nc.parts"
    waiting = [sys.executable, "-c", WAITING, *command]
    with subprocess.Popen(waiting, stderr=subprocess.PIPE, text=True, preexec_fn=heeding) as run:
        while not list(written(parts)) and run.poll() is None:
            time.sleep(0.02)
        run.send_signal(stop)
        said = run.communicate()[1]
    assert run.returncode == {signal.SIGKILL: -9, signal.SIGINT: 130, signal.SIGTERM: 143}[stop]
    assert "Traceback" not in said
    assert not output.exists() and 0 < max(last for _, last in written(parts)) < 60
    if stop != signal.SIGKILL:
        word = "interrupted" if stop == signal.SIGINT else "terminated"
        assert f"{word}; what is done is kept in {parts}; run the same command again to go on" in said
    monkeypatch.setattr(checkpoint, "EVERY", 0.1)
    assert main(command) == 0
    assert list(tmp_path.iterdir()) == [output]
    with xr.open_dataset(output) as image:
        assert same_data(image, undisturbed)


@pytest.mark.slow
def test_a_warning_of_the_command_is_one_sentence(tmp_path: Path) -> None:
    output, parts = tmp_path / "image.nc", tmp_path / "image.nc.parts"
    parts.symlink_to(tmp_path / "nowhere")
    command = [sys.executable, "-c", EAGER, *SMALL, str(output), "--quiet"]  # or a slow machine shows its progress too
    run = subprocess.run(command, capture_output=True, text=True)
    assert run.returncode == 0 and output.exists()
    assert run.stderr.startswith("phasemap: nothing is kept for another try: ") and run.stderr.count("\n") == 1


SMALL = ["run", "samples/step.toml", "surface.shape=[8, 8]", "-o"]
SAVING = """
import math, os, sys
from phasemap import cli
from phasemap._shared import interrupts
from phasemap.imaging import checkpoint
from phasemap.io import netcdf
# However slow the machine: nothing is kept on the way, and what is sent at once is taken as such.
checkpoint.EVERY = interrupts.GRACE = math.inf
def save(*arguments):
    print("saving", flush=True)
    os.read(os.pipe()[0], 1)  # for ever, in compiled code
netcdf.save = save
sys.exit(cli.main())
"""
SUMMING_UP = """
import os, signal, sys
from phasemap import cli
from phasemap.cli import run as cli_run
cli_run._print_summary = lambda *arguments: os.kill(os.getpid(), signal.SIGTERM)
sys.exit(cli.main())
"""
GOING_ON = """
import os, signal, threading
from phasemap._shared.interrupts import interruptible, still_busy
signal.signal(signal.SIGINT, signal.default_int_handler)
go = threading.Event()
def work():
    os.kill(os.getpid(), signal.SIGINT)
    go.wait()
try:
    interruptible(work)
except KeyboardInterrupt:
    print(still_busy(), flush=True)
    go.set()
"""


@pytest.mark.slow
def test_an_interrupt_does_not_wait_for_the_file(tmp_path: Path) -> None:
    command = [sys.executable, "-c", SAVING, *SMALL, str(tmp_path / "image.nc")]
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **pipes, preexec_fn=heeding) as run:
        assert run.stdout is not None and run.stdout.readline() == "saving\n"
        for _ in range(3):  # as the impatient do
            run.send_signal(signal.SIGINT)
            time.sleep(0.01)
        said = run.communicate(timeout=300)[1]
    assert run.returncode == 130 and said.endswith("phasemap: interrupted; nothing was written.\n")


def test_what_goes_on_after_an_interrupt_is_known() -> None:
    run = subprocess.run([sys.executable, "-c", GOING_ON], capture_output=True, text=True)
    assert run.stdout == "True\n" and run.stderr == ""


@pytest.mark.slow
def test_a_signal_after_the_file_was_written_says_so(tmp_path: Path) -> None:
    output = tmp_path / "image.nc"
    command = [sys.executable, "-c", SUMMING_UP, *SMALL, str(output)]
    run = subprocess.run(command, capture_output=True, text=True)
    assert run.returncode == 143 and f"phasemap: terminated; the image is in {output}.\n" in run.stderr
    assert list(tmp_path.iterdir()) == [output]
