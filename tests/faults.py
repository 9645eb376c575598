"""Break runs of the command on purpose, many times, and count what was survived.

    python tests/faults.py                # as many as in docs/reliability.md, some ten minutes
    python tests/faults.py --times 3      # a quick look

Survived means: no traceback, one sentence where a command ends early, nothing half-written under the output's name, and
where the same command is called again in the end the same data as without the fault, to the last bit.
"""

from __future__ import annotations

import argparse
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

import xarray as xr

ROOT = Path(__file__).parent.parent
IMPATIENT = """
import sys
from phasemap import cli
from phasemap.cli import run as cli_run
def run(arguments, run=cli_run.run):
    with cli_run.ending_at_once():
        from phasemap.imaging import checkpoint
    checkpoint.EVERY = 0.1  # seconds
    run(arguments)
cli_run.run = run
print("up", flush=True)
sys.exit(cli.main())
"""
IMAGE = ["samples/bistable.toml", "surface.shape=[96, 32]", "surface.spacing=60e-9", "control.line_rate=8"]
ENSEMBLE = ["samples/ensemble.toml", "ensemble.count=40"]


def command(*words: object, limit: int | None = None) -> subprocess.Popen[str]:
    """Start phasemap; `limit` is the largest file [bytes] that it can write."""

    def prepare() -> None:
        signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore Ctrl-C
        if limit is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    return subprocess.Popen(
        [sys.executable, "-c", IMPATIENT, *map(str, words)],
        cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=prepare, start_new_session=True,
    )  # fmt: skip


def run(*words: object, limit: int | None = None) -> tuple[int, str]:
    """Exit code and what was said on stderr."""
    with command(*words, limit=limit) as process:
        said = process.communicate()[1]
    return process.returncode, said


def same(output: Path, expected: xr.Dataset) -> bool:
    """Whether a file holds the data of another run, to the last bit."""
    with xr.open_dataset(output) as found:
        return set(found.variables) == set(expected.variables) and all(
            found[name].values.tobytes() == expected[name].values.tobytes() for name in expected.variables
        )


def complaint(code: int, expected: int, said: str) -> str:
    """What is wrong with the end of a command that should have said one sentence."""
    if code != expected:
        return f"exit code {code}, not {expected}, {said!r}. "
    last = said.strip().splitlines()[-1:]
    if "Traceback" in said or not last or not last[0].startswith("phasemap: "):
        return f"no sentence: {said!r}. "
    return ""


def finished(scene: list[str], output: Path, expected: xr.Dataset) -> str:
    """What is wrong with the output after the command was called once more, if it is not there yet."""
    if not output.exists():
        code, said = run("run", *scene, "-o", output, "--quiet")
        if code != 0:
            return f"it did not go on: {said!r}. "
    if not same(output, expected):
        return "other data. "
    left = sorted(file.name for file in output.parent.iterdir() if file != output)
    return f"{left} left behind. " if left else ""


def interrupted(scene: list[str], stop: signal.Signals, folder: Path, draw: random.Random, expected: xr.Dataset) -> str:
    """Stop a run at a random moment, twice, and let it go on."""
    output, wrong = folder / "out.nc", ""
    for _ in range(2):
        with command("run", *scene, "-o", output, "--quiet") as process:
            assert process.stdout is not None and process.stdout.readline() == "up\n"  # before that it is Python's own
            time.sleep(draw.uniform(0.0, 6.0))
            os.killpg(process.pid, stop)
            said = process.communicate()[1]
        if stop == signal.SIGINT and not output.exists():
            wrong += complaint(process.returncode, 130, said)
        if output.exists():
            break
    return wrong + finished(scene, output, expected)


def full_disk(folder: Path, draw: random.Random, expected: xr.Dataset) -> str:
    """A file cannot grow beyond some size: the run ends in one sentence or, where only its parts fail, goes on."""
    output, scene = folder / "out.nc", draw.choice([IMAGE, ENSEMBLE])
    code, said = run("run", *scene, "-o", output, "--quiet", limit=draw.choice([0, 100, 5_000, 20_000]))
    return complaint(code, 2, said) + ("there is an output" if output.exists() else "")


def unwritable(folder: Path, draw: random.Random, expected: xr.Dataset) -> str:
    """A place where nothing can be written is refused before anything is simulated."""
    (folder / "file").touch()
    (folder / "taken.nc").mkdir()
    places = [
        folder / "no" / "out.nc",
        folder / "file" / "out.nc",
        folder / "taken.nc",
        folder / "file",
        "/proc/out.nc",
    ]
    code, said = run("run", *IMAGE, "-o", draw.choice(places), "--quiet")
    return complaint(code, 2, said)


def truncated(folder: Path, draw: random.Random, expected: xr.Dataset) -> str:
    """A file that is cut short, or has a byte that is wrong, is refused in one sentence, or read if it can be."""
    whole = folder / "whole.nc"
    expected.to_netcdf(whole)
    content = bytearray(whole.read_bytes())
    if draw.random() < 0.5:
        content = content[: draw.randrange(len(content))]
    else:
        content[draw.randrange(len(content))] ^= 1 << draw.randrange(8)
    (folder / "damaged.nc").write_bytes(content)
    code, said = run("plot", folder / "damaged.nc", "-o", folder / "out.png")
    return "" if code == 0 else complaint(code, 2, said)


def lost_worker(folder: Path, draw: random.Random, expected: xr.Dataset) -> str:
    """A worker process of an ensemble is killed: one sentence, what is done is kept, and the next call goes on."""
    output, parts = folder / "out.nc", folder / "out.nc.parts"
    with command("run", *ENSEMBLE, "-o", output, "--quiet", "--workers=2") as process:
        while process.poll() is None and not (parts.exists() and len(os.listdir(parts)) > draw.randrange(3)):
            time.sleep(0.01)
        children = subprocess.run(["pgrep", "-P", str(process.pid)], capture_output=True, text=True).stdout.split()
        if process.poll() is None and children:
            with suppress(ProcessLookupError):  # it was just done
                os.kill(int(draw.choice(children)), signal.SIGKILL)
        said = process.communicate()[1]
    wrong = "" if output.exists() else complaint(process.returncode, 2, said)
    return wrong + finished(ENSEMBLE, output, expected)


def main() -> int:
    """Try every fault and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--times", type=int, default=30, metavar="N", help="how often each; default: 30")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", metavar="WORD", help="faults whose names have this in them")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        expected = {}
        for name, scene in (("image", IMAGE), ("ensemble", ENSEMBLE)):
            output = Path(place, f"{name}.nc")
            code, said = run("run", *scene, "-o", output, "--quiet")
            assert code == 0, said
            expected[name] = xr.load_dataset(output)
    faults: dict[str, tuple[Callable[[Path, random.Random, xr.Dataset], str], str]] = {
        "kill -9 of an image's run": (partial(interrupted, IMAGE, signal.SIGKILL), "image"),
        "kill -9 of an ensemble's run": (partial(interrupted, ENSEMBLE, signal.SIGKILL), "ensemble"),
        "Ctrl-C of an image's run": (partial(interrupted, IMAGE, signal.SIGINT), "image"),
        "Ctrl-C of an ensemble's run": (partial(interrupted, ENSEMBLE, signal.SIGINT), "ensemble"),
        "full disk": (full_disk, "image"),
        "output that cannot be written": (unwritable, "image"),
        "netCDF cut short or with a wrong bit": (truncated, "image"),
        "worker of an ensemble killed": (lost_worker, "ensemble"),
    }
    print("| fault | tried | survived |\n| --- | ---: | ---: |")
    all_survived = True
    for name, (fault, which) in faults.items():
        if arguments.only not in name:
            continue
        survived = 0
        for time_of in range(arguments.times):
            draw = random.Random(f"{arguments.seed} {name} {time_of}")
            with tempfile.TemporaryDirectory() as folder:
                wrong = fault(Path(folder), draw, expected[which])
            if wrong:
                print(f"{name}, number {time_of} of seed {arguments.seed}: {wrong}", file=sys.stderr)
            survived += not wrong
        all_survived &= survived == arguments.times
        print(f"| {name} | {arguments.times} | {survived} |", flush=True)
    return 0 if all_survived else 1


if __name__ == "__main__":
    sys.exit(main())
