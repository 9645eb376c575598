"""Kernels are compiled once, for all laws, to the same bits in every process, and never outlive their sources."""

from __future__ import annotations

import functools
import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numba
import numpy as np
import pytest
from bits import bits

import phasemap as pm
from phasemap._kernels import loaded_sources
from phasemap._kernels.compilation import disk_cache, kernel
from phasemap._kernels.compilation.first_use import FirstUse
from phasemap._kernels.lever import free_amplitude, phase_of
from phasemap.cli import kinds_of_work
from phasemap.experiment.lever_numbers import one_mode

PACKAGE = Path(pm.__file__).parent
SMALL = """
{before}
import json
import numpy as np
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import contact_force
from phasemap.experiment.interaction import Interaction
law, p = Interaction().token(), np.arange(1.0, 21.0)
def asked(entry):
    return [float(entry(law, 2.0, p)).hex(), sum(entry._cache_hits.values())]
said = [asked(contact_force)]
{after}
print(json.dumps(said))
"""
"""A force in contact: an entry that calls a kernel of another file, whose number is said bit by bit.

Beside it stands how often compiled code was found on disk.
"""


def python(code: str, package: Path = PACKAGE, **environment: str) -> subprocess.Popen[str]:
    """Run code in a process of its own."""
    path = os.pathsep.join([str(package.parent), *filter(None, [os.environ.get("PYTHONPATH")])])
    variables = {**os.environ, "PYTHONPATH": path, "PHASEMAP_QUIET": "1", **environment}
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen([sys.executable, "-c", code], cwd=package.parent, env=variables, **pipes)


def small(process: subprocess.Popen[str]) -> Any:
    """What the small kernel's process said."""
    out, err = process.communicate()
    assert process.returncode == 0 and not err, err
    return json.loads(out)


@pytest.fixture
def empty(tmp_path: Path) -> dict[str, str]:
    """A folder for compiled code."""
    return {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}


UPDATE = """
import os, pathlib
import phasemap._kernels.forces as leaf
said.append(asked(kernel(contact_force.py_func)))  # which finds on disk what was compiled
leaf = pathlib.Path(leaf.__file__)
times, before = os.stat(leaf), leaf.read_text()
leaf.write_text(before.replace("* math.sqrt(d) - p[PULL]", "* math.sqrt(d) - 2.0 * p[PULL]"))
assert leaf.read_text() != before
os.utime(leaf, ns=(times.st_atime_ns, times.st_mtime_ns))
said.append(asked(kernel(contact_force.py_func)))
"""


def test_code_outlives_no_source(tmp_path: Path, empty: dict[str, str]) -> None:
    copy = Path(shutil.copytree(PACKAGE, tmp_path / "phasemap", ignore=shutil.ignore_patterns("__pycache__")))
    (first, *hits), found, updated = small(python(SMALL.format(before="", after=UPDATE), copy, **empty))
    assert hits == [0] and found == [first, 1]
    # A process that lives across an update has loaded the old source, and keeps nothing under the digest of the new.
    assert updated == [first, 0]
    ((changed, *hits),) = small(python(SMALL.format(before="", after=""), copy, **empty))
    assert hits == [0] and changed != first


def amplitude_anew() -> tuple[float, int]:
    """A small kernel's answer when it is asked for the first time, and how often its code was found on disk."""
    entry = kernel(free_amplitude.py_func)
    return float(entry(one_mode(0.999, 1.25e-3, 40.0, 4e-11))), sum(entry._cache_hits.values())


def test_a_damaged_file_is_compiled_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(disk_cache, "folder", lambda: tmp_path)
    whole, hits = amplitude_anew()
    (file,) = tmp_path.glob("*" + disk_cache.SUFFIX)
    assert hits == 0
    for damage in (lambda _: b"", lambda _: b"nonsense", lambda content: content[:-100]):
        file.write_bytes(damage(file.read_bytes()))
        assert amplitude_anew() == (whole, 0)
    assert amplitude_anew() == (whole, 1)


def test_without_a_place_for_it_code_is_compiled_every_time(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(disk_cache, "places", list)
    for name in ("folder", "_say_once"):
        monkeypatch.setattr(disk_cache, name, functools.cache(getattr(disk_cache, name).__wrapped__))
    for _ in range(2):
        assert amplitude_anew()[1] == 0
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "compiled code cannot be kept" in said


NAME = """
from numba import float64, njit
from phasemap._kernels.compilation import ANY_ORDER
from phasemap._kernels.compilation.frozen import frozen

@kernel(shared=True, fastmath=ANY_ORDER)
def double(x):
    return x + x

double.linked.compile((float64,))
said.append(double.linked.overloads[(float64,)].fndesc.llvm_func_name)
jitted = njit(lambda x: x in {"contract", "nsz", "reassoc"}, fastmath={"contract", "nsz", "reassoc"})
said.append(frozen(lambda d, p: jitted(d)).digest)
"""


def test_two_processes_that_compile_at_once_have_the_same_numbers_and_names(empty: dict[str, str]) -> None:
    # Else code of one that calls code of the other ends in a crash. Sets of strings read {"contract", "nsz",
    # "reassoc"} and {"reassoc", "nsz", "contract"} with these two seeds.
    code = SMALL.format(before="", after=NAME)
    both = [python(code, **empty, PYTHONHASHSEED=seed) for seed in "14"]
    ((force, _), *names), ((other, _), *others) = map(small, both)
    assert force == other and names == others and all(names)


NEWER = """
import numba
from numba.misc.init_utils import generate_version_info
numba.__version__ = "0.69.0"
numba.version_info = generate_version_info(numba.__version__)
"""


def test_a_numba_of_another_version_is_refused_in_one_sentence(tmp_path: Path) -> None:
    refused = "numba 0.69.0 is installed: pip install 'numba>=0.61,<0.69'."
    _, err = python(SMALL.format(before=NEWER, after="")).communicate()
    assert err.splitlines()[-1].startswith("ImportError: phasemap works with numba from 0.61 on")
    assert err.splitlines()[-1].endswith(refused)
    scene = PACKAGE.parent / "samples" / "step.toml"
    run = ["run", str(scene), "-o", str(tmp_path / "step.nc"), "surface.shape=[2, 2]"]
    command = python(f"{NEWER}\nfrom phasemap.cli import main\nraise SystemExit(main({run}))")
    _, err = command.communicate()
    assert command.returncode == 2 and err.startswith("phasemap: ") and err.endswith(f"{refused}\n"), err
    assert err.count("\n") == 1


class Own(pm.ContactLaw):
    """A law of one's own, for which a wheel needs numba too."""

    @staticmethod
    def force(d: float, p: np.ndarray) -> float:
        return float(0.32 * p[0] * d * d)


def test_so_it_is_where_only_a_law_of_ones_own_needs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numba, "version_info", SimpleNamespace(short=(0, 60)))
    with pytest.raises(pm.InputError, match=r"numba compiles\. phasemap works .* 0\.61 on and before 0\.69"):
        pm.Interaction(Own()).token()


IMAGE = """
import hashlib
import numpy as np
import phasemap as pm
scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(16e-9))
modulus, adhesion = np.meshgrid(np.linspace(1e9, 4e9, 16), np.linspace(0.0, 0.1, 16))
image = pm.simulate(pm.Surface(modulus, adhesion=adhesion, pixel_size=2e-9), scope, 0.8, "averaging")
digest = hashlib.sha256(b"".join(image[name].values.tobytes() for name in sorted(image.data_vars))).hexdigest()
"""
SAYING = f"""
import sys
sys.path.append({str(Path(__file__).parents[1])!r})
from warm_up import compiled_more_than_once
assert not compiled_more_than_once(), compiled_more_than_once()
print(digest)
"""


@pytest.mark.slow
def test_code_that_others_call_is_compiled_again_where_it_is_gone(tmp_path: Path) -> None:
    exec(IMAGE, here := {})  # so that all that it needs is on disk
    kept = disk_cache.folder()
    assert kept is not None
    (tmp_path / "phasemap").mkdir()
    sources = loaded_sources.digest()
    assert sources is not None
    of_these = f"{hashlib.sha256(sources).hexdigest()[:16]}{disk_cache.SUFFIX}"  # not of an older version
    for file in kept.glob(f"*.{of_these}"):
        shutil.copy(file, tmp_path / "phasemap")
    shared = list(tmp_path.rglob(f"*.shared-*.{of_these}"))
    assert len(shared) > 1
    gone = [file for file in shared if file.name.startswith("orbits.averaged.")]  # what is compiled soonest
    assert len(gone) > 1
    for file in gone:
        file.unlink()
    out, err = python(IMAGE + SAYING, NUMBA_CACHE_DIR=str(tmp_path)).communicate()
    assert out == here["digest"] + "\n", err
    found = tmp_path.rglob(f"*.shared-*.{of_these}")
    assert {file.name.split(".shared-")[0] for file in found} == {file.name.split(".shared-")[0] for file in shared}


def test_what_python_does_faster_than_it_is_compiled_is_the_same_in_kernels() -> None:
    lever = one_mode(0.999, 1.25e-3, 40.0, 4e-11)
    for light, arguments in ((free_amplitude, (lever,)), (phase_of, (lever, 8e-9, 1e-12, 2e-12))):
        light(*arguments)
        assert not light.overloads
        compiled = light.compile(tuple(map(numba.typeof, arguments)))
        assert light(*arguments) == pytest.approx(compiled(*arguments), rel=1e-15)


def _walk(cube: np.ndarray, row: np.ndarray, marks: np.ndarray, pair: tuple[np.ndarray, float]) -> float:
    table, total = cube[1], pair[1]
    for i in range(-1, 2):
        table[i, 0] += row[i] * pair[0][0]
        marks[i] = table[i][1] > 0.5
    marks[-1] = True
    cube[-1, -1, -1] = -7.0
    for entry in range(len(row)):
        total += row[-entry - 1] * (entry + 1.0) if marks[entry] else 0.25 * cube[0][-1, 0]
    return total + table.shape[1]


def test_elements_and_rows_of_arrays_are_those_of_python() -> None:
    def arguments() -> tuple[Any, ...]:
        cube = np.random.default_rng(5).random((2, 3, 4))
        return cube, np.array([0.5, -2.0, 3.0]), np.zeros(3, np.bool_), (np.array([1.5, 2.0]), 10.0)

    ours, theirs = arguments(), arguments()
    assert kernel(_walk)(*ours) == pytest.approx(_walk(*theirs), rel=1e-15)
    assert bits(ours) == bits(theirs)


def test_the_word_while_it_lasts(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    import phasemap._kernels.compilation.first_use as first_use

    monkeypatch.setattr(first_use, "FIRST_WORD", 0.0)
    monkeypatch.delenv("PHASEMAP_QUIET", raising=False)
    monkeypatch.setattr(FirstUse, "said", False)
    use = FirstUse(80)
    use.done = 40
    use._started -= 3.0  # for 0.375 of it
    expected = "phasemap: compiling kernels for their first use, which may take a minute or more; later runs load them."
    assert use.line() == expected
    for _ in range(2):
        with use:
            use._ended.wait(0.2)
    assert capsys.readouterr().err == expected + "\n"  # once a process
    use._bar = True
    assert "[#########...............], about 5 s left of this part; later" in use.line()


def test_a_kind_of_work_that_fails_is_said_to_fail() -> None:
    with pytest.raises(KeyError, match="no such kind"):
        kinds_of_work.in_processes([["no such kind"]])
