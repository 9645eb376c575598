"""The order in which files of tests are begun: the longest first, so that both workers end together.

Files of the exact orbits and of scans in time alternate. What one worker compiles, the other later finds on disk.
"""

from __future__ import annotations

import gc
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

FIRST_RESULTS = "PHASEMAP_FIRST_RESULTS"  # folder of what tests/warm_up.py computed while it compiled
FIRST = (
    "test_examples",
    "test_compilation",
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
    "test_ensemble",
    "test_plot",
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
    """Compile what most tests need, in processes of its own, so that all test processes load it."""
    config = session.config
    if hasattr(config, "workerinput") or config.option.collectonly or not config.option.numprocesses:
        return
    script, folder = Path(__file__).with_name("warm_up.py"), Path(tempfile.mkdtemp(prefix="phasemap-first-"))
    config.add_cleanup(lambda: shutil.rmtree(folder))
    parts = [subprocess.Popen([sys.executable, script, part, folder / f"{part}.json"]) for part in ("0", "1")]
    codes = [part.wait() for part in parts]
    if any(codes):
        pytest.exit("tests/warm_up.py failed", returncode=1)
    os.environ[FIRST_RESULTS] = str(folder)  # the test processes inherit it


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with these files; the others keep their order."""
    order = {name: place for place, name in enumerate(FIRST)}
    items.sort(key=lambda item: order.get(item.path.stem, len(FIRST)))
