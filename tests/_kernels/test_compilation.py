"""Kernels are compiled once, for all laws, to the same bits in every process, and never outlive their sources."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from bits import bits

import phasemap as pm
from phasemap._kernels.compilation import disk_cache, kernel
from phasemap._kernels.compilation.first_use import FirstUse
from phasemap._kernels.lever import free_amplitude, phase_of
from phasemap._kernels.neck import loop_energies
from phasemap.cli import kinds_of_work
from phasemap.experiment.lever import one_mode

PACKAGE = Path(pm.__file__).parent
SMALL = """
import json, sys
import numpy as np
from phasemap._kernels.compilation import entries
{before}
from phasemap._kernels.neck import loop_energies
from phasemap.experiment.interaction import Interaction
from phasemap.experiment.lever import one_mode
interaction = Interaction("jkr")
rows = interaction.columns(np.array([1e9]), np.array([0.05]), np.array([0.0]), 10e-9)
entry = loop_energies
print(json.dumps([float(loop_energies(interaction.token(), rows)[0]).hex(), sum(entry._cache_hits.values())]))
"""
"""The energy that a neck loses: an entry, a chain of kernels, and formulas that are called by their address."""


def python(code: str, package: Path = PACKAGE, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run code in a process of its own."""
    path = os.pathsep.join([str(package.parent), *filter(None, [os.environ.get("PYTHONPATH")])])
    variables = {**os.environ, "PYTHONPATH": path, "PHASEMAP_QUIET": "1", **environment}
    return subprocess.run(
        [sys.executable, "-c", code], cwd=package.parent, env=variables, capture_output=True, text=True, check=False
    )


def small(package: Path = PACKAGE, before: str = "", **environment: str) -> tuple[str, int]:
    """The energy, bit by bit, and how often compiled code was found on disk."""
    done = python(SMALL.format(before=before), package, **environment)
    assert done.returncode == 0 and not done.stderr, done.stderr
    energy, hits = json.loads(done.stdout)
    return energy, hits


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """The package in another place."""
    return Path(shutil.copytree(PACKAGE, tmp_path / "phasemap", ignore=shutil.ignore_patterns("__pycache__")))


UPDATE = """
import os, pathlib
import phasemap._kernels.neck
leaf = pathlib.Path(phasemap._kernels.__file__).with_name("law.py")
times, before = os.stat(leaf), leaf.read_text()
leaf.write_text(before.replace("return force - p[BIAS]", "return 2.0 * force - p[BIAS]"))
assert leaf.read_text() != before
os.utime(leaf, ns=(times.st_atime_ns, times.st_mtime_ns))
"""


def test_code_outlives_no_source(copy: Path, tmp_path: Path) -> None:
    place = {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    first, hits = small(copy, **place)
    assert hits == 0
    assert small(copy, **place) == (first, 1)
    # A process that lives across an update has loaded the old source, and keeps nothing under the digest of the new.
    assert small(copy, UPDATE, **place) == (first, 0)
    changed, hits = small(copy, **place)
    assert hits == 0 and changed != first


def test_a_damaged_file_is_compiled_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    interaction = pm.Interaction("jkr")
    rows = interaction.columns(np.array([1e9]), np.array([0.05]), np.array([0.0]), 10e-9)
    monkeypatch.setattr(disk_cache, "folder", lambda: tmp_path)

    def anew() -> tuple[float, int]:
        entry = kernel(loop_energies.py_func)
        return float(entry(interaction.token(), rows)[0]), sum(entry._cache_hits.values())

    whole, hits = anew()
    (file,) = tmp_path.glob("*" + disk_cache.SUFFIX)
    assert hits == 0
    for damage in (lambda _: b"", lambda _: b"nonsense", lambda content: content[:-100]):
        file.write_bytes(damage(file.read_bytes()))
        assert anew() == (whole, 0)
    assert anew() == (whole, 1)


def test_without_a_place_for_it_code_is_compiled_in_every_process(tmp_path: Path) -> None:
    nowhere = "from phasemap._kernels.compilation import disk_cache\ndisk_cache.places = lambda: []"
    done = python(SMALL.format(before=nowhere))
    assert done.returncode == 0 and json.loads(done.stdout)[1] == 0
    assert done.stderr.count("\n") == 1 and "compiled code cannot be kept" in done.stderr


def test_two_processes_may_compile_at_once(tmp_path: Path) -> None:
    code, variables = SMALL.format(before=""), {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path), "PHASEMAP_QUIET": "1"}
    both = [
        subprocess.Popen([sys.executable, "-c", code], env=variables, stdout=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    said = {json.loads(one.communicate()[0])[0] for one in both}
    assert all(one.returncode == 0 for one in both) and len(said) == 1


OTHER_MEANING = """
from phasemap._kernels.compilation import array_elements
true = array_elements.element_pointer
def first_of_all(builder, array, dimensions, kinds, index):
    return builder.extract_value(array, array_elements._DATA), true(builder, array, dimensions, kinds, index)[1]
array_elements.element_pointer = first_of_all
"""
"""As if numba had changed how arrays are laid out."""


def test_where_parts_of_numba_mean_something_else_kernels_are_compiled_as_numba_does(tmp_path: Path) -> None:
    done = python(SMALL.format(before=OTHER_MEANING), NUMBA_CACHE_DIR=str(tmp_path))
    assert done.returncode == 0 and done.stderr.count("\n") == 1
    assert "is not one that phasemap was made for: kernels are compiled by it alone" in done.stderr
    interaction = pm.Interaction("jkr")
    rows = interaction.columns(np.array([1e9]), np.array([0.05]), np.array([0.0]), 10e-9)
    plain = float.fromhex(json.loads(done.stdout)[0])
    assert plain == pytest.approx(loop_energies(interaction.token(), rows)[0], rel=1e-13)


IMAGE = """
import hashlib
import numpy as np
import phasemap as pm
scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(16e-9))
modulus, adhesion = np.meshgrid(np.linspace(1e9, 4e9, 16), np.linspace(0.0, 0.1, 16))
image = pm.simulate(pm.Surface(modulus, adhesion=adhesion, pixel_size=2e-9), scope, 0.8, "averaging")
digest = hashlib.sha256(b"".join(image[name].values.tobytes() for name in sorted(image.data_vars))).hexdigest()
"""
SAYING = """
from phasemap._kernels.compilation import compiled_more_than_once
assert not compiled_more_than_once(), compiled_more_than_once()
print(digest)
"""


@pytest.mark.slow
def test_code_that_others_call_is_compiled_again_where_it_is_gone(tmp_path: Path) -> None:
    exec(IMAGE, here := {})  # so that all that it needs is on disk
    kept = disk_cache.folder()
    assert kept is not None
    (tmp_path / "phasemap").mkdir()
    for file in kept.glob("*" + disk_cache.SUFFIX):
        shutil.copy(file, tmp_path / "phasemap")
    shared = list(tmp_path.rglob("*.shared-*" + disk_cache.SUFFIX))
    assert len(shared) > 1
    gone = [file for file in shared if file.name.startswith("orbits.averaged.")]  # what is compiled soonest
    assert len(gone) > 1
    for file in gone:
        file.unlink()
    again = python(IMAGE + SAYING, NUMBA_CACHE_DIR=str(tmp_path))
    assert again.returncode == 0, again.stderr
    assert again.stdout == here["digest"] + "\n"
    found = tmp_path.rglob("*.shared-*" + disk_cache.SUFFIX)  # older versions' need not come back
    assert {file.name.split(".shared-")[0] for file in found} == {file.name.split(".shared-")[0] for file in shared}


NAME = """
from numba import float64
from phasemap._kernels.compilation import ANY_ORDER, kernel

@kernel(shared=True, fastmath=ANY_ORDER)
def double(x):
    return x + x

double.linked.compile((float64,))
print(double.linked.overloads[(float64,)].fndesc.llvm_func_name)
"""


def test_what_is_linked_by_its_name_has_the_same_name_in_every_process(tmp_path: Path) -> None:
    # Else code of one process that calls code of another, where two compile at once, ends in a crash. Sets of strings
    # read {"contract", "nsz", "reassoc"} and {"reassoc", "nsz", "contract"} with these two seeds.
    names = [python(NAME, NUMBA_CACHE_DIR=str(tmp_path / seed), PYTHONHASHSEED=seed).stdout for seed in "14"]
    assert names[0] and names[0] == names[1]


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


def test_a_formula_is_compiled_alone() -> None:
    code = """
import numpy as np, phasemap as pm
from phasemap._kernels.compilation.disk_cache import DiskCache
class Cone(pm.ContactLaw):
    @staticmethod
    def force(d, p):
        return 0.3 * p[0] * d * d
found = []
keep = DiskCache.save_overload
DiskCache.save_overload = lambda self, sig, data: (found.append(self._name.rpartition('.')[2]), keep(self, sig, data))
scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(16e-9), pm.Interaction(Cone()))
assert pm.solve_pixel(pm.Material(2e9, 0.1), scope, 0.8, "averaging").status is pm.Status.good
print(*sorted(found))
"""
    pm.solve_pixel(
        pm.Material(2e9, 0.1), pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(16e-9)), 0.8,
        "averaging",
    )  # fmt: skip
    done = python(code)
    assert done.returncode == 0, done.stderr
    assert set(done.stdout.split()) <= {"force", "slope"}  # and nothing of the kernels


def test_the_word_while_it_lasts(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    import phasemap._kernels.compilation.first_use as first_use

    monkeypatch.setattr(first_use, "FIRST_WORD", 0.0)
    monkeypatch.delenv("PHASEMAP_QUIET", raising=False)
    monkeypatch.setattr(FirstUse, "said", False)
    use = FirstUse(80)
    use.done = 40
    use._started -= 3.0  # for 0.375 of it
    expected = "phasemap: compiling kernels for their first use, about 5 s left; later runs load them."
    assert use.line() == expected
    for _ in range(2):
        with use:
            use._ended.wait(0.2)
    assert capsys.readouterr().err == expected + "\n"  # once a process
    use._bar = True
    assert "[#########...............]" in use.line()


def test_a_kind_of_work_that_fails_is_said_to_fail() -> None:
    with pytest.raises(subprocess.CalledProcessError):
        kinds_of_work.in_processes([["no such kind"]], lambda cost: None)
