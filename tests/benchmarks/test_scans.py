"""The two engines of a scan in time beside each other: what is compared, and what is marked."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from benchmarks.scan_cases import CASES, PIXELS
from benchmarks.scans import MOST_AMPLITUDE, MOST_PHASE, compare, errors, regimes, whole_image

USUAL = next(case for case in CASES if case.name.startswith("usual"))
BISTABLE = next(case for case in CASES if case.name.startswith("bistable"))


def silent(text: str) -> None:
    pass


def cells(table: str) -> list[list[str]]:
    """The cells of each line of a table, without its head."""
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines() if line[:1] == "|"][2:]


def numbers(line: list[str]) -> list[float]:
    return [float(word) for cell in line[1:] for word in re.findall(r"[\d.e+-]+", cell)]


def test_cases_have_names_of_their_own_and_the_periods_that_they_say() -> None:
    assert len({case.name for case in CASES}) == len(CASES) >= 8
    for case in CASES:
        frequency = case.scope.cantilever.resonance_frequency
        assert case.feedback().dwell(PIXELS) * frequency == pytest.approx(case.periods)


def test_engines_agree_on_a_lever_of_high_q() -> None:
    found = compare(replace(USUAL, periods=150.0))
    assert found.agree and found.phase.max() > found.at_rest > 0
    assert min(found.seconds) > 0


def test_a_difference_beyond_the_limits_is_bold_and_explained() -> None:
    said = regimes((replace(BISTABLE, periods=100.0),), silent)
    (line,) = cells(said)
    assert re.fullmatch(r"\*\*[\d.]+\*\* / \*\*[\d.]+\*\*", line[2])
    assert f"{MOST_PHASE:g}°" in said and f"{MOST_AMPLITUDE:g} %" in said
    assert f"* {BISTABLE.name}: {BISTABLE.stated}." in said


def test_error_falls_with_the_line_rate_alike_for_both_engines() -> None:
    fast, slow = (numbers(line) for line in cells(errors((16.0, 8.0), silent)))
    # Half the rate leaves half the error, and less than that is gained where the loop is too slow for the pixels.
    assert all(0.4 < a / b < 0.8 for a, b in zip(slow, fast, strict=True))
    assert slow[:2] == pytest.approx(slow[2:], rel=0.05)  # phase and height by the slow flow and by the equation


def test_image_is_estimated_from_lines_and_says_so() -> None:
    said = whole_image(96, 20.0, silent)
    assert "96 x 96 pixels at a line rate of 20 Hz" in said and "estimated from 2 of its lines" in said
    for line in cells(said):
        alone, image = float(line[1]), float(line[2])
        assert image == pytest.approx(96 * alone, rel=0.01)
