"""Kinds of work: compiled ahead, they give what a process computes that compiles them first."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from bits import bits

from phasemap.cli import kinds_of_work


@pytest.mark.parametrize("kind", kinds_of_work.KINDS)
def test_the_process_that_compiles_gives_the_bits_of_those_that_load(kind: str) -> None:
    # In an empty cache, as of a fresh clone, tests/warm_up.py has compiled what this process loads.
    if "PHASEMAP_FIRST_RESULTS" not in os.environ:
        pytest.skip("tests/warm_up.py runs before test processes, with -n")
    first = json.loads((Path(os.environ["PHASEMAP_FIRST_RESULTS"]) / "results.json").read_text())
    assert bits(kinds_of_work.KINDS[kind]()) == first[kind]


def test_every_kind_of_work_is_compiled_ahead() -> None:
    assert {kind for group in kinds_of_work.ALL for kind in group} == set(kinds_of_work.KINDS)
    assert {kind for group in kinds_of_work.USUAL for kind in group} <= set(kinds_of_work.KINDS)
    costs: list[kinds_of_work.Cost] = []
    kinds_of_work.in_processes([["bias"], ["punch"]], costs.append)
    assert {cost.kind for cost in costs} == {"bias", "punch"}
    kinds_of_work.in_processes([["bias"]], costs.append)
    assert costs[-1].functions == 0 and costs[-1].size == 0 and costs[-1].seconds > 0  # found on disk by now
