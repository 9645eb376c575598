"""The package as a whole: what importing it costs, its public names, its version and its lists of dependencies."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from importlib.metadata import version
from pathlib import Path
from typing import Any

import grimp
import pytest
from packaging.specifiers import SpecifierSet

import phasemap
import phasemap.cli.warm
from phasemap._kernels.compilation.numba_versions import BEYOND, FIRST
from phasemap.cli import main

HEAVY = ("llvmlite", "matplotlib", "netCDF4", "numba", "numpy", "pandas", "scipy", "tqdm", "xarray")
ROOT = Path(__file__).parent.parent


def imported_by(code: str) -> set[str]:
    """Return the heavy packages that a fresh interpreter has imported after running `code`."""
    report = f"import atexit, sys; atexit.register(lambda: print('|', *set({HEAVY}) & set(sys.modules)))\n"
    done = subprocess.run([sys.executable, "-c", report + code], capture_output=True, text=True, check=True)
    return set(done.stdout.rpartition("|")[2].split())


# phasemap.imaging.simulation needs numpy at least: were nothing found there, the other tests would prove nothing.
def test_heavy_imports_are_seen() -> None:
    assert "numpy" in imported_by("import phasemap.imaging.simulation")


def test_importing_phasemap_imports_nothing_heavy() -> None:
    assert imported_by("import phasemap") == set()


@pytest.mark.parametrize(
    "arguments",
    [
        ["--help"],
        ["--version"],
        *([name, "--help"] for name in ("run", "sweep", "contrast", "compare", "scene", "export", "explore")),
    ],
    ids=" ".join,
)
def test_asking_the_command_for_help_imports_nothing_heavy(arguments: list[str]) -> None:
    assert imported_by(f"from phasemap.cli import main; main({arguments})") == set()


def test_without_the_repository_bench_says_where_to_get_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(phasemap.cli.warm, "REPOSITORY", tmp_path)
    for words in ([], ["--quick"], ["--help"]):
        assert main(["bench", *words]) == 2
        said = capsys.readouterr()
        assert said.err.count("\n") == 1 and "clone the repository" in said.err and not said.out


def test_the_source_archive_has_the_measurements_and_the_wheel_does_not() -> None:
    targets = project()["tool"]["hatch"]["build"]["targets"]
    assert targets["wheel"]["packages"] == ["phasemap"] and "/benchmarks" in targets["sdist"]["include"]


def test_describing_a_microscope_imports_nothing_heavier_than_numpy() -> None:
    code = "import phasemap as pm; pm.Microscope(pm.Cantilever(40, 3e5, 400), pm.Tip(1e-8), pm.Drive(2e-8))"
    assert imported_by(code) <= {"numpy"}


@pytest.mark.parametrize("name", phasemap.__all__)
def test_every_public_name_is_there_with_a_docstring(name: str) -> None:
    assert getattr(phasemap, name).__doc__
    assert name in dir(phasemap)


def test_a_name_that_is_not_there_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'Cantilevr'"):
        _ = phasemap.Cantilevr


def project() -> dict[str, Any]:
    return tomllib.loads((ROOT / "pyproject.toml").read_text())


def test_the_version_is_that_of_the_metadata_and_the_changelog_has_it() -> None:
    assert phasemap.__version__ == version("afm-phasemap") == project()["project"]["version"]
    assert f"## [{phasemap.__version__}]" in (ROOT / "CHANGELOG.md").read_text()


def test_only_numba_whose_compiler_is_changed_has_an_upper_bound_and_the_installed_one_is_below_it() -> None:
    (bounded,) = [line for line in project()["project"]["dependencies"] if "<" in line]
    assert bounded.startswith("numba>") and version("numba") in SpecifierSet(bounded.removeprefix("numba"))
    first, beyond = (".".join(map(str, one)) for one in (FIRST, BEYOND))
    assert bounded == f"numba>={first},<{beyond}"


# .ci/fresh.py installs exactly these versions, on exactly these interpreters.
def test_every_dependency_has_one_lower_bound() -> None:
    lines = project()["project"]["dependencies"]
    assert not [line for line in lines if not re.fullmatch(r"[A-Za-z][\w-]*>=\d+(\.\d+)*(,<\d+\.\d+)?", line)]


def test_every_package_that_phasemap_imports_is_declared() -> None:
    table = project()["project"]
    lines = [*table["dependencies"], *(line for extra in table["optional-dependencies"].values() for line in extra)]
    declared = {re.split(r"[\[<>=]", line)[0].lower().replace("-", "_") for line in lines} | {"skimage"}
    modules = grimp.build_graph("phasemap", include_external_packages=True, cache_dir=None).modules
    imported = {module.partition(".")[0].lower() for module in modules}
    assert imported - declared - {"phasemap", *sys.stdlib_module_names} == set()


def test_the_oldest_interpreter_of_the_classifiers_is_the_one_required() -> None:
    table = project()["project"]
    minors = [int(line.rpartition("3.")[2]) for line in table["classifiers"] if " :: Python :: 3." in line]
    assert table["requires-python"] == f">=3.{minors[0]}"
    assert minors == list(range(minors[0], minors[-1] + 1))


def test_groups_are_the_extras_and_the_test_extra_holds_the_read_extra() -> None:
    table = project()
    extras, groups = table["project"]["optional-dependencies"], table["dependency-groups"]

    def flat(group: str) -> set[str]:
        parts = [{part} if isinstance(part, str) else flat(part["include-group"]) for part in groups[group]]
        return set().union(*parts)

    assert {name: flat(name) for name in groups} == {name: set(extra) for name, extra in extras.items()}
    assert set(extras["read"]) <= set(extras["test"])


def test_the_recipe_for_conda_asks_for_what_the_package_asks_for() -> None:
    names = {"matplotlib": "matplotlib-base", "netCDF4": "netcdf4"}  # of conda-forge
    asked = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    wanted = {
        re.sub(r"[\w-]+", lambda name: names.get(name[0], name[0]), one, count=1) for one in asked["dependencies"]
    }
    recipe = (ROOT / "packaging" / "conda" / "meta.yaml").read_text()
    found = {
        line.replace(" ", "")
        for line in re.findall(r"^    - (.*)$", recipe.partition("  run:")[2].partition("test:")[0], re.M)
    }
    assert found == wanted | {f"python{asked['requires-python']}"}
    assert f'version = "{asked["version"]}"' in recipe
