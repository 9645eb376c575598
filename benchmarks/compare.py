"""Compare the working tree with the package of a commit: ``python -m benchmarks.compare COMMIT``.

Both versions solve the fixed corpus of `benchmarks.corpus` in turns, in processes of their own. A line a block says how
many pixels changed their status or branch, how many phases and tip offsets moved beyond the errors that both state, how
many numbers are the same to the last bit, and the processor time of each. The exit code is 1 where a status or a branch
changed, or a number moved beyond its stated error.

``--constant`` compares with the working tree in which one tuned number of the kernels has another value, as
``--constant engagement.by_fold.TIGHT=0.03``: how many answers hang on it, and what it costs or saves.

``--short`` compares with answers recorded in benchmarks/recorded.npz instead (``--record`` writes them), which takes
seconds and needs no other version.
"""

from __future__ import annotations

import argparse
import os
import pathlib
import pickle
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benchmarks.answers import Answer, solve
from benchmarks.corpus import Block, Task, corpus

Array = np.ndarray

ROOT = pathlib.Path(__file__).resolve().parents[1]
RECORDED = ROOT / "benchmarks" / "recorded.npz"
SHORT = 0.015  # share of the corpus that is recorded
WARM_UP = 10  # one task in so many is solved first, untimed, so that what it needs is compiled
BRIEF = 40.0  # [s] blocks that take less are solved twice and the shorter time counts: the first may still compile


# Two versions


class Version:
    """A process that solves tasks with the package of one folder."""

    def __init__(self, name: str, folder: pathlib.Path) -> None:
        self.name = name
        self._process = subprocess.Popen(
            [sys.executable, "-P", str(ROOT / "benchmarks" / "answers.py")],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=os.environ | {"PYTHONPATH": str(folder)},
        )  # fmt: skip

    def solve(self, tasks: list[Task]) -> tuple[list[Answer], float]:
        """Answers and processor time [s]."""
        into, out = self._process.stdin, self._process.stdout
        assert into is not None and out is not None
        pickle.dump(tasks, into)
        into.flush()
        answers, seconds = pickle.load(out)
        return answers, seconds

    def timed(self, tasks: list[Task]) -> tuple[list[Answer], float]:
        """Answers, and the processor time without compilation [s]."""
        answers, seconds = self.solve(tasks)
        return answers, min(seconds, self.solve(tasks)[1]) if seconds < BRIEF else seconds

    def close(self) -> None:
        """End the process."""
        if self._process.stdin is not None:
            self._process.stdin.close()
        self._process.wait()


def package_of(commit: str) -> pathlib.Path:
    """Folder with the package of a commit, kept from one comparison to the next together with what it compiled."""
    digest = _git("rev-parse", "--verify", f"{commit}^{{commit}}").decode().strip()
    cache = pathlib.Path(os.environ.get("XDG_CACHE_HOME") or pathlib.Path.home() / ".cache")
    folder = cache / "phasemap-compare" / digest
    if not folder.exists():
        part = folder.with_suffix(".part")
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir(parents=True)
        subprocess.run(["tar", "-x", "-C", str(part)], input=_git("archive", digest, "phasemap"), check=True)
        part.rename(folder)
    return folder


def write_package_with(constant: str, folder: pathlib.Path) -> None:
    """Write the package of the working tree with MODULE.NAME=VALUE, a module of kernels, into a folder.

    Raises ValueError where the module has no such constant, OSError where there is no such module.
    """
    name, _, value = constant.partition("=")
    module, _, name = name.strip().rpartition(".")
    file = pathlib.Path("phasemap", "_kernels", f"{module.replace('.', '/')}.py")
    pattern = re.compile(rf"^{re.escape(name)} = .*", re.MULTILINE)
    text, count = pattern.subn(f"{name} = {value}", (ROOT / file).read_text())
    if count != 1 or not value:
        raise ValueError(f"{constant}: not MODULE.NAME=VALUE of a constant in {file}")
    shutil.copytree(ROOT / "phasemap", folder / "phasemap", ignore=shutil.ignore_patterns("__pycache__"))
    (folder / file).write_text(text)


def _git(*arguments: str) -> bytes:
    return subprocess.run(["git", "-C", str(ROOT), *arguments], check=True, stdout=subprocess.PIPE).stdout


# Differences


@dataclass
class Difference:
    """What is not the same in two lists of answers to the same tasks."""

    compared: int = 0  # numbers
    identical: int = 0  # numbers that are the same to the last bit
    # Number of the task, and what changed there: a status, branch or number of folds; a number beyond what both state.
    codes: list[tuple[int, str]] = field(default_factory=list)
    moved: list[tuple[int, str]] = field(default_factory=list)
    largest: dict[str, float] = field(default_factory=dict)  # difference of each variable
    relative: dict[str, float] = field(default_factory=dict)  # of variables without a limit, over the largest value

    @property
    def wrong(self) -> int:
        """How many pixels changed more than they may."""
        return len(self.codes) + len(self.moved)


def differences(before: list[Answer], after: list[Answer]) -> Difference:
    """Compare answers to the same tasks."""
    found = Difference()
    for number, (old, new) in enumerate(zip(before, after, strict=True)):
        _compare(number, old, new, found)
    return found


def _compare(number: int, old: Answer, new: Answer, found: Difference) -> None:
    differing = np.zeros((), np.bool_)  # pixels of other orbits, whose numbers say nothing further
    for name, codes in old.codes.items():
        other = new.codes.get(name, np.empty(0))
        if codes.shape != other.shape:
            found.codes.append((number, f"{name} has shape {other.shape}, had {codes.shape}"))
            return
        for index in np.argwhere(codes != other):
            at = tuple(index)
            found.codes.append((number, f"{name} {list(map(int, at))}: {codes[at]} -> {other[at]}"))
        if name in ("status", "branch", "motion"):
            differing = differing | (codes != other)
    for name, values in old.values.items():
        other = new.values.get(name, np.empty(0))
        if values.shape != other.shape:
            found.codes.append((number, f"{name} has shape {other.shape}, had {values.shape}"))
            continue
        _compare_numbers(number, name, (values, other), old.within[name] + new.within[name], differing, found)
    for name, values in old.seen.items():
        if values.shape == new.seen[name].shape and differing.shape in ((), values.shape):
            change = np.abs(np.where(differing, 0.0, values - new.seen[name]))
            scale = np.nanmax(np.abs(values), initial=0.0) or 1.0
            found.relative[name] = max(found.relative.get(name, 0.0), float(np.nanmax(change, initial=0.0) / scale))


def _compare_numbers(
    number: int, name: str, pair: tuple[Array, Array], within: Array, differing: Array, found: Difference
) -> None:
    old, new = pair
    same = (old == new) | (np.isnan(old) & np.isnan(new))
    found.compared += old.size
    found.identical += int(same.sum())
    change = np.abs(old - new)
    judged = ~same & (~differing if differing.shape == old.shape else True)
    if judged.any():
        found.largest[name] = max(found.largest.get(name, 0.0), float(np.nanmax(change[judged], initial=0.0)))
    for index in np.argwhere(judged & ~(change <= within)):
        at = tuple(index)
        text = f"{name} {list(map(int, at))}: {old[at]:.12g} -> {new[at]:.12g}, {within[at]:.2g} stated"
        found.moved.append((number, text))


# The table


HEAD = (
    "| block | pixels | status, branch or folds changed | beyond stated errors | identical numbers [%] "
    "| largest change of phase [degree] / tip offset [pm] | before [s] | after [s] | after / before |"
)


def line(block: Block, found: Difference, before: float, after: float) -> str:
    """A line of the table."""
    largest = found.largest.get("phase", 0.0), 1e12 * found.largest.get("tip_offset", 0.0)
    identical = 100 * found.identical / max(found.compared, 1)
    cells = (
        block.name, str(len(block)), str(len(found.codes)), str(len(found.moved)), f"{identical:.4g}",
        f"{largest[0]:.2g} / {largest[1]:.2g}", f"{before:.3g}", f"{after:.3g}",
        f"{after / before:.2f}" if before > 0 else "",
    )  # fmt: skip
    return f"| {' | '.join(cells)} |"


def details(block: Block, found: Difference, most: int) -> Iterator[str]:
    """What changed in a block, the first of each kind, with the task that shows it."""
    for heading, lines in (("changed", found.codes), ("moved beyond stated errors", found.moved)):
        for number, text in lines[:most]:
            task = {name: value for name, value in block.tasks[number].items() if name not in ("maps", "axis")}
            yield f"  {block.name}, task {number}, {heading}: {text}\n    {task}"
        if len(lines) > most:
            yield f"  {block.name}, {heading}: {len(lines) - most} more"


def compare(folders: tuple[pathlib.Path, pathlib.Path], names: list[str], most: int, identical: bool) -> int:
    """Solve the corpus with the packages of both folders, print the table, and return the exit code."""
    before, after = map(Version, ("before", "after"), folders)
    failed, total = False, np.zeros(2)
    print(HEAD, "| --- |" + " ---: |" * (HEAD.count("|") - 2), sep="\n", flush=True)
    said: list[str] = []
    with ThreadPoolExecutor(2) as both:
        for number, block in enumerate(corpus()):
            if names and not any(name in block.name for name in names):
                continue
            list(both.map(lambda one, tasks=block.tasks[::WARM_UP]: one.solve(tasks), (before, after)))
            order = (before, after) if number % 2 == 0 else (after, before)
            solved = {one.name: one.timed(block.tasks) for one in order}
            (old, old_seconds), (new, new_seconds) = solved["before"], solved["after"]
            found = differences(old, new)
            failed |= bool(found.wrong) or (identical and found.identical < found.compared)
            total += old_seconds, new_seconds
            print(line(block, found, old_seconds, new_seconds), flush=True)
            said += [f"  {block.name}: {_relative(found)}", *details(block, found, most)]
    print(f"\nProcessor time of all: {total[0]:.1f} s before, {total[1]:.1f} s after.", *said, sep="\n")
    before.close()
    after.close()
    return int(failed)


def _relative(found: Difference) -> str:
    """Largest changes of what has no stated error."""
    return "largest relative change: " + ", ".join(f"{name} {by:.1g}" for name, by in found.relative.items())


# The short form


def record() -> None:
    """Write the answers to the short corpus."""
    numbers: dict[str, Any] = {}
    for block, answers in _short():
        for i, answer in enumerate(answers):
            for group in ("codes", "values", "within"):
                numbers |= {f"{block.name}/{i}/{group}/{name}": v for name, v in getattr(answer, group).items()}
    np.savez_compressed(RECORDED, **numbers)


def short() -> list[tuple[Block, Difference]]:
    """Compare the short corpus with the recorded answers."""
    kept: dict[tuple[str, int], Answer] = {}
    with np.load(RECORDED) as file:
        for key in file.files:
            block_name, number, group, name = key.split("/")
            getattr(kept.setdefault((block_name, int(number)), Answer()), group)[name] = file[key]
    return [
        (block, differences([kept[block.name, i] for i in range(len(answers))], answers)) for block, answers in _short()
    ]


def _short() -> Iterator[tuple[Block, list[Answer]]]:
    for block in corpus(SHORT):
        yield block, solve(block.tasks)[0]


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.compare", description=__doc__.split("\n\n")[0])
    parser.add_argument("commit", nargs="?", help="to compare the working tree with: HEAD, main, 6e2dc5c")
    parser.add_argument("--constant", help="to compare the working tree with: MODULE.NAME=VALUE of the kernels")
    parser.add_argument("--block", action="append", default=[], help="only blocks whose name has this in it; repeat")
    parser.add_argument("--show", type=int, default=5, help="how many differences of each block and kind to print")
    parser.add_argument("--identical", action="store_true", help="every bit must be the same")
    parser.add_argument("--short", action="store_true", help="compare a small corpus with benchmarks/recorded.npz")
    parser.add_argument("--record", action="store_true", help="write benchmarks/recorded.npz")
    given: Any = parser.parse_args(arguments)
    if given.record:
        record()
    elif given.short:
        found = short()
        for block, one in found:
            print(line(block, one, 0.0, 0.0), *details(block, one, given.show), sep="\n")
        return int(any(one.wrong for _, one in found))
    elif given.constant:
        with tempfile.TemporaryDirectory() as folder:
            other = pathlib.Path(folder)
            try:
                write_package_with(given.constant, other)
            except (OSError, ValueError) as error:
                parser.error(str(error))
            return compare((ROOT, other), given.block, given.show, given.identical)
    elif given.commit:
        return compare((package_of(given.commit), ROOT), given.block, given.show, given.identical)
    else:
        parser.error("a commit, --constant, --short or --record")
    return 0


if __name__ == "__main__":
    sys.exit(main())
