"""The order in which files of tests are begun.

More than half of the time is numba's. Two workers that begin with the same kernels both compile them; where one
compiles the exact orbits while the other compiles scans and the march, each later finds the other's work on disk.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

FIRST = (
    "test_orbits",
    "test_march",
    "test_laws",
    "test_ensemble",
    "test_sweeps",
    "test_feedback",
    "test_hard",
    "test_raster",
)


def pytest_configure(config: pytest.Config) -> None:
    """Tests look at pixels that fail, on purpose; that these are told of is a test of its own."""
    config.addinivalue_line("filterwarnings", "ignore::phasemap.ResultWarning")


def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile what most tests need, in processes of its own, so that all test processes load it."""
    config = session.config
    if hasattr(config, "workerinput") or config.option.collectonly or not config.option.numprocesses:
        return
    script = Path(__file__).with_name("warm_up.py")
    parts = [subprocess.Popen([sys.executable, script, part]) for part in ("0", "1")]
    codes = [part.wait() for part in parts]
    if any(codes):
        pytest.exit("tests/warm_up.py failed", returncode=1)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with these files; the others keep their order."""
    order = {name: place for place, name in enumerate(FIRST)}
    items.sort(key=lambda item: order.get(item.path.stem, len(FIRST)))
