"""Kinds of work: compiled ahead, they give what a process computes that compiles them first."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bits import bits

import phasemap as pm
from phasemap._kernels.compilation import disk_cache
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
    kinds_of_work.KINDS["bias"]()  # so that all that it needs is on disk
    found = {cost.kind: cost for cost in kinds_of_work.in_processes([["bias"], ["averaging"]])}
    assert set(found) == {"bias", "averaging"}
    assert found["bias"].functions == found["bias"].size == 0 and found["bias"].seconds > 0


class Own(pm.ContactLaw):
    """A law that nobody compiled before."""

    @staticmethod
    def force(d: float, p: np.ndarray) -> float:
        return float(0.31 * p[0] * d * d)


def test_a_formula_is_compiled_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(16e-9))
    own = replace(scope, interaction=pm.Interaction(Own()))
    pm.solve_pixel(pm.Material(2e9, 0.1), scope, 0.8, "averaging")
    monkeypatch.setattr(disk_cache, "folder", lambda: tmp_path)
    assert pm.solve_pixel(pm.Material(2e9, 0.1), own, 0.8, "averaging").status is pm.Status.good
    kept = [file.name.partition("-py")[0].rpartition(".")[2] for file in tmp_path.iterdir()]
    assert sorted(kept) == ["force", "slope"]  # and nothing of the kernels
