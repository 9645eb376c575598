"""Wheel and sdist on fresh machines: `python3 .ci/fresh.py FOLDER`, a new folder to work in.

Both are built, and installed and run in environments of their own, side by side: the sdist on the oldest CPython of
pyproject.toml's classifiers that is here, with the oldest dependencies that pyproject.toml allows, the wheel on the
newest with the newest ones, where kernels are compiled into it and numba is not there. Both must give the same numbers,
compiled and as plain Python. Needs Python 3.11, pip and, for compiled kernels, a C compiler that links them.
"""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

SOURCE = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((SOURCE / "pyproject.toml").read_text())["project"]
SHIPPED = (
    "LICENSE",
    "README.md",
    "CHANGELOG.md",
    "pyproject.toml",
    "phasemap",
    "benchmarks",
    "tests",
    "samples",
    "examples",
    "docs",
)
NAME = PROJECT["name"]
ROUNDING = 1e-9  # of a quantity's largest value; compilers and libraries may round a last digit otherwise


@dataclass(frozen=True)
class Leg:
    """One environment: an interpreter, what is installed there, and the dependencies' versions."""

    python: str
    distribution: Path
    limits: tuple[str, ...]  # the oldest dependencies; none for the newest
    folder: Path
    ahead: bool = False  # whether kernels are compiled into the wheel, and numba is not installed

    def compiled_ahead(self) -> Path:
        """The wheel with compiled kernels: those of one kind of work, for all take minutes."""
        python, uv = self.folder / "compiling/bin/python", self.folder.parent / "build/bin/uv"
        call(self.python, "-m", "venv", "--without-pip", "compiling", cwd=self.folder)
        call(uv, "pip", "install", "--quiet", "--python", python, self.distribution, "wheel", cwd=self.folder)
        some = ("--kinds", "averaging")
        call(python, SOURCE / "tools/wheel/ahead.py", self.distribution, ".", *some, cwd=self.folder)
        (wheel,) = self.folder.glob("*.whl")
        return wheel

    def run(self) -> str:
        """Install and run; return the numbers that were computed there."""
        self.folder.mkdir()
        here, scene = self.folder / "env/bin", SOURCE / "samples/step.toml"
        call(self.python, "-m", "venv", "--without-pip", "env", cwd=self.folder)
        uv, into = self.folder.parent / "build/bin/uv", ("--quiet", "--python", here / "python")
        binary = ("--only-binary", ":all:") if self.distribution.suffix == ".whl" else ()
        brought = self.compiled_ahead() if self.ahead else self.distribution
        call(uv, "pip", "install", *into, *binary, brought, *self.limits, cwd=self.folder)
        installed = json.loads(call(uv, "pip", "list", *into, "--format", "json", cwd=self.folder))
        assert self.ahead != ("numba" in {one["name"] for one in installed}), f"{self.ahead}, and there are {installed}"
        call(uv, "pip", "check", *into, cwd=self.folder)
        small = ("surface.shape=[8,16]", "scan.solver=averaging", "--quiet")
        call(here / "phasemap", "run", scene, "-o", "compiled.nc", *small, cwd=self.folder)
        written = list(self.folder.glob("env/lib/*/site-packages/phasemap/_kernels/__pycache__/*.compiled"))
        assert bool(written) != self.ahead, f"with kernels in the wheel: {self.ahead}, and compiled are {written}"
        if self.limits:  # how old a matplotlib may be
            call(here / "phasemap", "plot", "compiled.nc", "-o", "compiled.png", cwd=self.folder)
        call(here / "python", SOURCE / ".ci/smoke.py", scene, cwd=self.folder, NUMBA_DISABLE_JIT="1")
        return (self.folder / "numbers.json").read_text()


def call(*command: str | Path, cwd: Path, **variables: str) -> str:
    """Run a command in a folder where nothing of the source can be imported; say what it printed if it fails."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "NUMBA"))}
    # Of what pip would compile to bytecode, little is imported.
    done = subprocess.run(
        list(map(str, command)), cwd=cwd, env=kept | {"PIP_COMPILE": "0"} | variables, text=True,
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    if done.returncode:
        raise SystemExit(f"{' '.join(map(str, command))}\nfailed in {cwd}:\n{done.stdout}")
    return done.stdout


def interpreter(version: str) -> str | None:
    """Path of python3.N, also one that pyenv has but does not show; None where none starts or can make environments."""
    command = [f"python{version}", "-c", "import ensurepip, sys; print(sys.executable)"]
    try:
        done = subprocess.run(command, env=os.environ | {"PYENV_VERSION": version}, capture_output=True, text=True)
    except FileNotFoundError:
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def build(folder: Path) -> tuple[Path, Path]:
    """Build sdist and wheel; the wheel that the sdist makes is that of the tree, and both hold what they should."""
    call(sys.executable, "-m", "venv", "build", cwd=folder)
    requirements = tomllib.loads((SOURCE / "pyproject.toml").read_text())["build-system"]["requires"]
    call(folder / "build/bin/pip", "install", "--quiet", "build", "uv", *requirements, cwd=folder)
    call(folder / "build/bin/python", "-m", "build", "--no-isolation", SOURCE, "--outdir", folder / "dist", cwd=folder)
    wheel_of_tree = ("wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", folder / "tree", SOURCE)
    call(folder / "build/bin/pip", *wheel_of_tree, cwd=folder)
    (sdist,), (wheel,), (tree,) = (list(folder.glob(name)) for name in ("dist/*.tar.gz", "dist/*.whl", "tree/*.whl"))
    assert wheel.read_bytes() == tree.read_bytes(), "the sdist makes another wheel than the tree"
    tops = {name.split("/")[0] for name in zipfile.ZipFile(wheel).namelist()}
    assert tops == {"phasemap", f"{wheel.name.split('-py')[0]}.dist-info"}, f"the wheel holds {tops}"
    with tarfile.open(sdist) as archive:
        inside = {name.split("/")[1] for name in archive.getnames()}
    assert inside >= {*SHIPPED}, f"the sdist lacks {set(SHIPPED) - inside}"
    print(f"{sdist.name}: {' '.join(sorted(inside))}; it makes the wheel of the tree, {wheel.name}")
    return sdist, wheel


def oldest(folder: Path) -> tuple[str, ...]:
    """The option of pip that installs the lower bound of every dependency."""
    limits = folder / "oldest.txt"
    limits.write_text("\n".join(line.replace(">=", "==") for line in PROJECT["dependencies"]))
    return "--constraint", str(limits)


def difference(ours: list[float], theirs: list[float]) -> float:
    """Largest difference, relative to the largest value; infinite where NaN are elsewhere."""
    if [math.isnan(x) for x in ours] != [math.isnan(x) for x in theirs]:
        return math.inf
    pairs = [(x, y) for x, y in zip(ours, theirs, strict=True) if not math.isnan(x)]
    largest = max((abs(x) for x, _ in pairs), default=0.0) or 1.0
    return max((abs(x - y) for x, y in pairs), default=0.0) / largest


def main() -> None:
    """Build, install, run and compare."""
    folder = Path(sys.argv[1]).resolve()
    folder.mkdir()
    sdist, wheel = build(folder)
    claimed = re.findall(r"Python :: (3\.\d+)", "\n".join(PROJECT["classifiers"]))
    found = {version: path for version in claimed if (path := interpreter(version))}
    if missing := [version for version in claimed if version not in found]:
        print("skipped, for there is no", *(f"python{version}" for version in missing))
    if not found:
        raise SystemExit("no interpreter to try")
    first, *_, last = *found.values(), *found.values()
    legs = [
        Leg(first, sdist, oldest(folder), folder / "oldest"),
        Leg(last, wheel, (), folder / "newest", ahead=shutil.which("cc") is not None),
    ]
    with ThreadPoolExecutor(2) as pool:
        reports = [json.loads(numbers) for numbers in pool.map(Leg.run, legs)]
    reference, failed = reports[0]["numbers"], False
    for leg, report in zip(legs, reports, strict=True):
        # What was compiled is also what plain Python makes.
        worst = max(
            difference(values, reference[name.replace("compiled", "averaging")])
            for name, values in report["numbers"].items()
        )
        failed |= not worst <= ROUNDING
        print(f"{leg.distribution.name} on {report['versions']}: differs by {worst:.1e} at most")
    if failed:
        raise SystemExit(f"more than {ROUNDING} of a quantity's largest value")


if __name__ == "__main__":
    main()
