"""What it costs to simulate block by block: what is measured, and what is concluded from that."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.blocks import (
    CORES,
    ENGAGED,
    KINDS,
    MAPS,
    Cost,
    Run,
    _threaded,
    alone,
    forward,
    table,
    twice,
)


def cells(text: str) -> list[list[str]]:
    """The cells of each line of a table, without its head."""
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line[:1] == "|"][2:]


def cost(plan: float = 0.0, describe: float = 0.0, empty: float = 0.0) -> Cost:
    """Of four blocks that take 2 s each, and have two tasks each beside the plan."""
    one = Run(8.0 + plan, {"phasemap-fill": [0.8] * 7, "phasemap-plan": [plan]})
    return Cost((8.0, 5.0), (one, Run(5.0, {})), one, describe, empty, 4)


def test_time_falls_with_the_number_of_cores_as_long_as_there_are_blocks() -> None:
    ideal = cost()
    assert ideal.block == 2.0 and ideal.tasks == 2.0
    assert [ideal.wall(100, cores) for cores in (1, 10, 100, 1000)] == [200.0, 20.0, 2.0, 2.0]


def test_what_is_done_one_after_another_limits_the_gain() -> None:
    assert cost(empty=0.5).wall(100, 100) == 100 * 2 * 0.5  # the scheduler is slower than the blocks
    assert cost(empty=0.5).wall(100, 1) == 200.0
    assert cost(describe=0.25).wall(100, 100) == 100 * 0.25 + 2.0
    assert cost(plan=3.0).wall(100, 100) == pytest.approx(3.0 + 2.0)


def test_tables_are_worked_out_of_what_was_measured() -> None:
    (line,) = cells(twice({"a": cost()}))
    # 8 / (2 x 5) twice, and 8 s of wall time for 5.6 s in tasks
    assert line == ["a", "80.0", "80.0", "42.9", "42.9"]
    lines = cells(forward({"a": cost()}))
    assert [line[1] for line in lines] == [f"{side} x {side}" for side in MAPS]
    assert lines[0][-len(CORES) :] == ["52 / 98", "6 / 85", "2 / 26"]  # 256 blocks: 26, 3 and 1 after another
    assert lines[1][-1] == "34 / 96"  # 16384 blocks: 17 after another instead of 16.4


def test_maps_are_those_of_their_names() -> None:
    few, continuous = (kind.surface(96, 32).compute() for kind in ENGAGED)
    assert len(few.unique()[0]) == 2 and np.ptp(few.topography) > 1e-9
    assert len(continuous.unique()[0]) == 96**2


def test_tasks_are_told_apart_and_timed() -> None:
    run = _threaded(ENGAGED[0], ENGAGED[0].surface(64, 32))
    assert {name: len(run.tasks[name]) for name in ("phasemap-survey", "phasemap-plan", "phasemap-fill")} == {
        "phasemap-survey": 4, "phasemap-plan": 1, "phasemap-fill": 4,
    }  # fmt: skip
    assert 0 < run.busy < run.wall  # one thread


@pytest.mark.slow
def test_everything_is_measured_in_one_run() -> None:
    told: list[str] = []
    said = table(told.append, side=32, grid=2)
    tables = [cells(part) for part in said.split("\n\n") if part.startswith("|")]
    assert [[line[0] for line in lines] for lines in tables] == [
        [kind.name for kind in KINDS],
        [kind.name for kind in ENGAGED],
        [kind.name for kind in ENGAGED for _ in MAPS],
    ]
    assert all(float(cell) > 0 for line in tables[0] for cell in line[1:])
    assert "dask" in said and len(told) > len(KINDS)


def test_a_block_alone_counts_its_own_pixels() -> None:
    for line in cells(alone(32, lambda text: None)):
        pixels = 32 if "line" in line[0] else 32**2
        assert float(line[3]) == pytest.approx(1e6 * float(line[1]) / pixels, rel=0.02)  # three digits
