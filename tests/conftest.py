"""The order in which files of tests are begun.

More than half of the time is numba's. Two workers that begin with the same kernels both compile them; where one
compiles the exact orbits while the other compiles scans and the march, each later finds the other's work on disk.
"""

from __future__ import annotations

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


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with these files; the others keep their order."""
    order = {name: place for place, name in enumerate(FIRST)}
    items.sort(key=lambda item: order.get(item.path.stem, len(FIRST)))
