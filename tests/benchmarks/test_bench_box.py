"""The box of materials drawn at random: what it draws, what it counts, what the command prints."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import pytest

import benchmarks.box as drawn
import phasemap as pm
from phasemap.cli import main


def test_the_same_seed_draws_the_same_materials_under_the_same_microscopes() -> None:
    first, second, other = (list(drawn.draw(20, 7, seed)) for seed in (3, 3, 4))
    assert sum(len(batch) for batch in first) == 20
    for one, two in zip(first, second, strict=True):
        assert one.scope == two.scope and one.setpoint == two.setpoint
        assert (one.materials == two.materials).all()
    assert all(one.scope != two.scope for one, two in zip(first, other, strict=True))


def test_what_is_drawn_lies_in_the_ranges_and_has_the_shares_that_are_stated() -> None:
    batches = list(drawn.draw(2000, 1000, 1))
    scopes = [batch.scope for batch in batches]
    for ranges, some in ((drawn.ORDINARY, batches[::2]), (drawn.WILD, batches[1::2])):
        for name, values in (
            ("stiffness", [batch.scope.cantilever.stiffness for batch in some]),
            ("quality_factor", [batch.scope.cantilever.quality_factor for batch in some]),
            ("free_amplitude", [batch.scope.drive.free_amplitude for batch in some]),
            ("radius", [batch.scope.tip.radius for batch in some]),
            ("frequency_ratio", [batch.scope.frequency_ratio for batch in some]),
            ("setpoint", [batch.setpoint for batch in some]),
        ):
            low, high = ranges[name]
            assert low <= min(values) <= max(values) <= high
    # Four standard deviations of 1000 draws are 4 sqrt(0.25 / 1000) at most.
    for law, share in drawn.LAWS.items():
        assert np.mean([scope.interaction.law.name == law for scope in scopes]) == pytest.approx(share, abs=0.064)
    assert np.mean([scope.frequency_ratio != 1 for scope in scopes]) == pytest.approx(1 / 6, abs=0.064)
    materials = np.concatenate([batch.materials for batch in batches])
    assert (materials[:, 0] >= drawn.MODULUS[0]).all() and (materials[:, 0] <= drawn.MODULUS[1]).all()
    assert np.mean(materials[:, 1] == 0) == pytest.approx(0.1, abs=0.064)


def test_every_material_is_counted_and_the_slowest_can_be_solved_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drawn, "LAWS", {"dmt": 1.0})
    said: list[str] = []
    text = drawn.table(said.append, 30, 6, 2)
    header, _, law, whole, _, slowest = text.splitlines()
    assert header.startswith("| contact | microscopes | materials |")
    assert law.startswith("| dmt | 6 | 30 |") and whole.startswith("| all | 6 | 30 |")
    shares = [float(number) for number in re.findall(r"([\d.]+) %", whole.rpartition("|")[0].rpartition("|")[2])]
    assert sum(shares) == pytest.approx(100, abs=0.005 * len(shares))
    assert said[-1] == "box: 6 of 6 microscopes"
    status, material, scope, setpoint = re.fullmatch(
        r"Slowest, \S+ ms, (\w+): (Material.*) under (Microscope.*) at setpoint (\S+)", slowest
    ).groups()  # type: ignore[union-attr]
    names = {name: getattr(pm, name) for name in pm.__all__}
    pixel = pm.solve_pixel(eval(material, names), eval(scope, names), float(setpoint))
    assert pixel.status.name == status


def test_the_command_prints_what_was_found(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[int | None, ...]] = []

    def table(say: Callable[[str], None], *drawn: int | None) -> str:
        asked.append(drawn)
        say("box: 1 of 2 microscopes")
        return "| contact | status |"

    monkeypatch.setattr(drawn, "table", table)
    assert main(["bench", "--box"]) == 0
    assert capsys.readouterr() == ("| contact | status |\n", "box ...\n")
    assert main(["bench", "--box", "--materials", "5", "--seed", "3"]) == 0
    assert asked == [(None, None, 1), (5, None, 3)]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--box", "--output", "box.nc"], "--output does not go with --box"),
        (["--compile", "--materials", "5"], "--materials does not go with --compile"),
        (["--microscopes", "5"], "--microscopes goes with --box only"),
        (["--box", "--materials", "0"], "'0' is not a whole number of at least 1"),
    ],
)
def test_what_does_not_go_with_it_is_said(
    arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        code = main(["bench", *arguments])
    except SystemExit as stopped:
        code = int(stopped.code or 0)
    said = capsys.readouterr()
    assert code == 2 and said.out == "" and sentence in said.err
