"""The order in which files of tests are begun: those that need few kernels, while the others are compiled.

Then come the longest, so that both workers end together. Files of the exact orbits and of scans in time alternate. What
one worker compiles, the other later finds on disk.
"""

from __future__ import annotations

import gc
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import pytest

FIRST_RESULTS = "PHASEMAP_FIRST_RESULTS"  # folder of what tests/warm_up.py computes while it compiles
RESULTS, ENDED = "results.json", "ended"  # files there
BEFORE_KERNELS = (  # files that need none of the kernels which a process of its own compiles meanwhile, or few
    "test_compilation",
    "test_frozen",
    "test_disk_cache",
    "test_helpers",
    "test_read",
    "test_generate",
    "test_package",
    "test_quantities",
    "test_netcdf",
    "test_measured",
    "test_house",
    "test_sampling",
    "test_surface",
    "test_saved_scripts",
    "test_liquid",
    "test_dilation",
    "test_export",
    "test_numpy_of_the_page",
    "test_beam",
    "test_docs",
    "test_plot",
    "test_fuzz",
)
# What names of tests in these files end with that need many, and stand last.
AFTER_THEM = ("[calls]", "_are_those_of_the_code_beside_them")
FIRST = (
    "test_examples",
    "test_bench",
    "test_detuned",
    "test_fit",
    "test_hard",
    "test_orbits",
    "test_regions",
    "test_excitation",
    "test_bounded",
    "test_invert",
    "test_irregular",
    "test_dask",
    "test_checkpoint",
)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Let all be asked of which tests take a share else."""
    parser.addoption("--thorough", action="store_true", help="all of the large draws and of the examples")


@pytest.fixture(scope="session")
def thorough(request: pytest.FixtureRequest) -> bool:
    """Whether to ask all of which tests take a share else."""
    return bool(request.config.getoption("--thorough"))


def pytest_configure(config: pytest.Config) -> None:
    """Tests look at pixels that fail, on purpose; that these are told of is a test of its own."""
    config.addinivalue_line("filterwarnings", "ignore::phasemap.ResultWarning")
    # Half a million objects live as long as the process: looking through all of them again takes an eighth of the time.
    gc.set_threshold(10_000, 10, 100)


def pytest_sessionstart(session: pytest.Session) -> None:
    """Begin to compile what most tests need, in a process of its own, so that all test processes load it."""
    config = session.config
    if hasattr(config, "workerinput") or config.option.collectonly or not config.option.numprocesses:
        return
    folder = Path(tempfile.mkdtemp(prefix="phasemap-first-"))
    script = Path(__file__).with_name("warm_up.py")
    process = subprocess.Popen([sys.executable, script, folder / RESULTS])

    def ended() -> None:
        process.wait()
        (folder / ENDED).touch()

    waiting = threading.Thread(target=ended)
    waiting.start()
    config.add_cleanup(lambda: (process.kill(), waiting.join(), shutil.rmtree(folder)))
    os.environ[FIRST_RESULTS] = str(folder)  # the test processes inherit it


def needs_kernels(item: pytest.Item) -> bool:
    """Whether it is one of the tests that load what is compiled meanwhile."""
    return item.path.stem not in BEFORE_KERNELS or item.name.endswith(AFTER_THEM)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Wait for the kernels, but before tests that need few."""
    if needs_kernels(item) and FIRST_RESULTS in os.environ:
        folder = Path(os.environ[FIRST_RESULTS])
        while not (folder / ENDED).exists():
            time.sleep(0.1)
        assert (folder / RESULTS).exists(), "tests/warm_up.py failed"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with these files; the others keep their order."""
    order = {name: place for place, name in enumerate(BEFORE_KERNELS + FIRST)}
    items.sort(key=lambda item: (order.get(item.path.stem, len(order)), item.name.endswith(AFTER_THEM)))
