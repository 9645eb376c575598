"""Break runs of the command on purpose, many times, and count what was survived.

    python tests/faults.py                # as many as in the README, some ten minutes
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
from phasemap import cli, cli_run
def run(arguments, run=cli_run.run):
    with cli_run.starting():
        from phasemap import checkpoint
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


def is_a_sentence(said: str) -> bool:
    """Whether the last line is phasemap's and there is no traceback."""
    return "Traceback" not in said and said.strip().splitlines()[-1].startswith("phasemap: ")


def interrupted(
    scene: list[str], stop: signal.Signals, folder: Path, draw: random.Random, expected: xr.Dataset
) -> bool:
    """Stop a run at a random moment, twice, and let it go on."""
    output, fine = folder / "out.nc", True
    for _ in range(2):
        with command("run", *scene, "-o", output, "--quiet") as process:
            assert process.stdout is not None and process.stdout.readline() == "up\n"  # before that it is Python's own
            time.sleep(draw.uniform(0.0, 6.0))
            os.killpg(process.pid, stop)
            said = process.communicate()[1]
        if stop == signal.SIGINT and process.returncode != 0:
            fine &= process.returncode == 130 and is_a_sentence(said)
        if output.exists():
            break
    if not output.exists():
        fine &= run("run", *scene, "-o", output, "--quiet")[0] == 0
    return fine and same(output, expected) and os.listdir(folder) == ["out.nc"]


def full_disk(folder: Path, draw: random.Random, expected: xr.Dataset) -> bool:
    """A file cannot grow beyond some size: the run ends in one sentence or, where only its parts fail, goes on."""
    output, scene = folder / "out.nc", draw.choice([IMAGE, ENSEMBLE])
    code, said = run("run", *scene, "-o", output, "--quiet", limit=draw.choice([0, 100, 5_000, 20_000]))
    return code == 2 and is_a_sentence(said) and not output.exists()


def unwritable(folder: Path, draw: random.Random, expected: xr.Dataset) -> bool:
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
    return code == 2 and is_a_sentence(said)


def truncated(folder: Path, draw: random.Random, expected: xr.Dataset) -> bool:
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
    return code == 0 or (code == 2 and is_a_sentence(said))


def lost_worker(folder: Path, draw: random.Random, expected: xr.Dataset) -> bool:
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
    fine = output.exists() or (process.returncode == 2 and is_a_sentence(said))
    if not output.exists():
        fine &= run("run", *ENSEMBLE, "-o", output, "--quiet")[0] == 0
    return fine and same(output, expected)


def main() -> int:
    """Try every fault and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--times", type=int, default=30, metavar="N", help="how often each; default: 30")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        expected = {}
        for name, scene in (("image", IMAGE), ("ensemble", ENSEMBLE)):
            output = Path(place, f"{name}.nc")
            code, said = run("run", *scene, "-o", output, "--quiet")
            assert code == 0, said
            expected[name] = xr.load_dataset(output)
    faults: dict[str, tuple[Callable[[Path, random.Random, xr.Dataset], bool], str]] = {
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
        survived = 0
        for time_of in range(arguments.times):
            draw = random.Random(f"{arguments.seed} {name} {time_of}")
            with tempfile.TemporaryDirectory() as folder:
                fine = fault(Path(folder), draw, expected[which])
            if not fine:
                print(f"not survived: {name}, number {time_of} of seed {arguments.seed}", file=sys.stderr)
            survived += fine
        all_survived &= survived == arguments.times
        print(f"| {name} | {arguments.times} | {survived} |", flush=True)
    return 0 if all_survived else 1


if __name__ == "__main__":
    sys.exit(main())
