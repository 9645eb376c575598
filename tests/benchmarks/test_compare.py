"""The comparison of two versions on a fixed corpus: it passes where nothing changed, and sees what does."""

from __future__ import annotations

import copy
import warnings
from pathlib import Path

import numpy as np
import pytest

from benchmarks import compare
from benchmarks.accuracy.regimes import REGIMES
from benchmarks.answers import Answer, solve
from benchmarks.corpus import Block, regime_tasks


def test_the_package_gives_the_recorded_answers() -> None:
    # Recorded by `python -m benchmarks.compare --record`; a change that is wanted is recorded anew, beside its reason.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # extremes are not plausible
        found = compare.short()
    changed = [line for block, one in found for line in compare.details(block, one, 20) if one.wrong]
    assert not changed, "\n".join(changed)
    assert sum(one.compared for _, one in found) > 5000


@pytest.fixture(scope="module")
def answers() -> tuple[Block, list[Answer]]:
    tasks = regime_tasks(REGIMES[0], 0.01)
    return Block("air", tasks), solve(tasks)[0]


def test_a_constant_gets_another_value_in_a_copy_of_the_package(tmp_path: Path) -> None:
    compare.write_package_with("engagement.by_fold.TIGHT=0.03", tmp_path)
    for file in (compare.ROOT / "phasemap").rglob("*.py"):
        here, there = file.read_text(), (tmp_path / file.relative_to(compare.ROOT)).read_text()
        assert (here != there) == (file.name == "by_fold.py")
    assert "\nTIGHT = 0.03\n" in (tmp_path / "phasemap/_kernels/engagement/by_fold.py").read_text()


@pytest.mark.parametrize("constant", ["engagement.by_fold.TIGHTER=1", "engagement.by_fold.TIGHT", "forces.NO=1"])
def test_a_constant_that_is_not_there_is_refused(tmp_path: Path, constant: str) -> None:
    with pytest.raises(ValueError, match=r"not MODULE\.NAME=VALUE"):
        compare.write_package_with(constant, tmp_path)


def test_answers_do_not_differ_from_themselves(answers: tuple[Block, list[Answer]]) -> None:
    block, before = answers
    found = compare.differences(before, copy.deepcopy(before))
    assert (found.wrong, found.identical) == (0, found.compared)
    assert found.compared >= 2 * len(block)


@pytest.mark.parametrize(("name", "by"), [("phase", 3.0), ("tip_offset", 3.0), ("phase", np.nan)])
def test_a_number_that_moves_beyond_both_stated_errors_is_found(
    answers: tuple[Block, list[Answer]], name: str, by: float
) -> None:
    _block, before = answers
    after = copy.deepcopy(before)
    after[0].values[name][0, 1] += by * after[0].within[name][0, 1]
    found = compare.differences(before, after)
    assert (len(found.moved), len(found.codes)) == (1, 0)
    assert found.moved[0][0] == 0 and found.moved[0][1].startswith(f"{name} [0, 1]:")


def test_a_number_that_moves_within_both_stated_errors_is_counted_and_passes(
    answers: tuple[Block, list[Answer]],
) -> None:
    _block, before = answers
    after = copy.deepcopy(before)
    after[0].values["phase"][0, 1] += 1.5 * after[0].within["phase"][0, 1]
    found = compare.differences(before, after)
    assert (found.wrong, found.compared - found.identical) == (0, 1)


def test_a_status_and_a_branch_that_change_are_found(answers: tuple[Block, list[Answer]]) -> None:
    _block, before = answers
    after = copy.deepcopy(before)
    after[1].codes["status"][0, 0], after[0].codes["branch"][0, 2] = 4, 1 - after[0].codes["branch"][0, 2]
    found = compare.differences(before, after)
    assert len(found.codes) == 2
    assert (1, "status [0, 0]: 0 -> 4") in found.codes


def test_a_fold_more_is_found() -> None:
    one, two = (Answer(values={"fold_phase": np.zeros(n)}, within={"fold_phase": np.ones(n)}) for n in (1, 2))
    assert compare.differences([one], [two]).wrong == 1
