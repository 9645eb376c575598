"""Try very many bad inputs: ``python tests/fuzz/run.py --inputs 100000 --seed 1``.

Every input is a function of the seed, the target and its number, and is tried in a process with a limit of memory and a
limit of time, which may crash. What comes out must be a result or a `PhasemapError`; anything else, a warning among
them, is printed, counted, and saved with its traceback. ``--only "netCDF" --first 17 --inputs 1`` tries one again.
``--coverage 60`` lets atheris, where it is installed, look for bad scenes for 60 s more.
"""

from __future__ import annotations

import argparse
import os
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from random import Random
from typing import Any

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parents[2])]

from fuzz import targets as every_target  # noqa: E402
from fuzz import world  # noqa: E402

SECONDS = 20.0  # an input; the slowest allowed ones take under a second on an idle core
MEMORY = 1 << 30  # byte of address space beyond what a process has when it starts
BUDGET = "64e6"  # byte, PHASEMAP_MEMORY: what a scene may take before it is refused
BATCH = 2000  # inputs of one process


class Slow(BaseException):
    """Raised where an input takes too long."""


def main() -> int:
    """Run, and print what came out."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=100_000, help="how many in all, or of the only target")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", help="one target: " + ", ".join(target.name for target in every_target.TARGETS))
    parser.add_argument("--first", type=int, default=0, help="number of the first input")
    parser.add_argument("--save", type=Path, default=Path("fuzz_failures"), help="folder for inputs that failed")
    parser.add_argument("--coverage", type=float, default=0.0, help="seconds of coverage-guided fuzzing by atheris")
    arguments = parser.parse_args()
    chosen = [one for one in every_target.TARGETS if arguments.only in (None, one.name)]
    if not chosen:
        parser.error(f"there is no target {arguments.only!r}")
    whole: Counter[str] = Counter()
    print(f"{'target':<16}{'inputs':>9}{'results':>9}{'refused':>9}{'FAILED':>8}{'s':>8}  slowest [s]  memory [MB]")
    for target in chosen:
        count = arguments.inputs if arguments.only else round(target.share * arguments.inputs)
        started = time.perf_counter()
        found, slowest, most = _try(target.name, arguments.seed, arguments.first, count, arguments.save)
        whole += found
        failed = sum(found.values()) - found["result"] - found["refused"]
        print(
            f"{target.name:<16}{sum(found.values()):>9}{found['result']:>9}{found['refused']:>9}{failed:>8}"
            f"{time.perf_counter() - started:>8.0f}{slowest:>13.2f}{most / 1e6:>13.0f}",
            flush=True,
        )
    failed = sum(whole.values()) - whole["result"] - whole["refused"]
    print(f"{'in all':<16}{sum(whole.values()):>9}{whole['result']:>9}{whole['refused']:>9}{failed:>8}")
    for kind, count in whole.most_common():
        if kind not in ("result", "refused"):
            print(f"  {count:>6} {kind}")
    if arguments.coverage:
        from fuzz.guided import fuzz

        failed += fuzz(arguments.coverage, arguments.seed, arguments.save)
    return 1 if failed else 0


def _try(name: str, seed: int, first: int, count: int, save: Path) -> tuple[Counter[str], float, float]:
    """What came out of a target's inputs, the longest time [s] and the most memory [byte] that one took."""
    found: Counter[str] = Counter()
    slowest, most, at = 0.0, 0.0, first
    context = get_context("spawn")
    while at < first + count:
        ours, theirs = context.Pipe()
        stop = min(at + BATCH, first + count)
        process = context.Process(target=_serve, args=(theirs, name, seed, at, stop), daemon=True)
        process.start()
        theirs.close()
        trying = -1
        try:
            while ours.poll(4 * SECONDS + 40):
                number, kind, told, seconds, memory = ours.recv()
                if kind == "trying":
                    trying = number
                    continue
                at = number + 1
                found[kind] += 1
                slowest, most = max(slowest, seconds), max(most, memory)
                if told:
                    _save(save, name, seed, number, kind, told)
                if at == stop:
                    break
            else:
                process.kill()
        except EOFError:
            pass
        process.join(60)
        if trying < 0:
            raise SystemExit(f"the process for {name} did not begin: exit code {process.exitcode}")
        if at < stop:  # killed, or crashed
            kind = f"{name}: process ended with exit code {process.exitcode}"
            found[kind] += 1
            _save(save, name, seed, max(trying, at), kind, f"{kind}\n")
            at = max(trying, at) + 1
    return found, slowest, most


def _save(folder: Path, name: str, seed: int, number: int, kind: str, told: str) -> None:
    folder.mkdir(exist_ok=True)
    file = folder / f"{name.replace(' ', '_')}_{seed}_{number}.txt"
    file.write_text(f"{kind}\n{told}", encoding="utf-8", errors="backslashreplace")


def _serve(line: Any, name: str, seed: int, first: int, stop: int) -> None:
    """Try the inputs from `first` on, in a folder and under limits of their own."""
    target = next(one for one in every_target.TARGETS if one.name == name)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.environ["PHASEMAP_MEMORY"] = BUDGET
    warnings.simplefilter("error")
    warnings.simplefilter("ignore", UserWarning)  # advice on wild numbers, which are the point here
    signal.signal(signal.SIGALRM, _too_slow)
    with tempfile.TemporaryDirectory() as folder:
        world.build(Path(folder))
        _import_all()
        size = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
        resource.setrlimit(resource.RLIMIT_AS, (size + MEMORY, size + MEMORY))
        for number in range(first, stop):
            line.send((number, "trying", "", 0.0, 0.0))
            line.send((number, *_one(target, Random(f"{seed} {name} {number}"))))
            if world.sprung():
                raise SystemExit("an input was executed")
        os.chdir("/")
    line.close()


def _one(target: Any, rng: Random) -> tuple[str, str, float, float]:
    """What came of one input: its kind, and where it failed all about it; seconds and bytes that it took."""
    from phasemap._shared.errors import PhasemapError

    made = target.make(rng)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    started = time.perf_counter()
    kind, told = "result", ""
    signal.setitimer(signal.ITIMER_REAL, SECONDS)
    try:
        target.take(*made)
    except PhasemapError:
        kind = "refused"
    except (Exception, Slow) as error:
        trace = traceback.extract_tb(error.__traceback__)
        place = next((frame for frame in reversed(trace) if "/phasemap/" in frame.filename), trace[-1])
        kind = f"{target.name}: {type(error).__name__} at {Path(place.filename).name}:{place.lineno}"
        told = f"{''.join(traceback.format_exception(error))[-6000:]}\n{_shown(made)}\n"
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
    memory = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
    return kind, told, time.perf_counter() - started, float(memory)


def _shown(made: tuple[Any, ...]) -> str:
    try:
        return "\n".join(repr(part)[:20_000] for part in made)
    except Exception as error:  # an input that cannot be printed
        return repr(error)


def _too_slow(*_: object) -> None:
    raise Slow


def _import_all() -> None:
    """Import before limits what inputs would import."""
    for module in ("netCDF4", "scipy.ndimage", "scipy.spatial", "skimage.filters", "xarray", "phasemap.cli"):
        import_module(module)
    for module in ("scenes.ensemble_file", "io.read", "imaging.simulation", "scenes.surface"):
        import_module(f"phasemap.{module}")
    every_target.take_scene((world.SAMPLES / "step.toml").read_bytes(), [])


if __name__ == "__main__":
    sys.exit(main())
