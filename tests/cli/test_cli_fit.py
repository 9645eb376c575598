"""The command ``phasemap fit``, and the picture of a measured curve."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import phasemap as pm
from phasemap.cli import main

SCOPE = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(20e-9))
LEVER = ["cantilever.stiffness=40", "cantilever.resonance_frequency=300e3", "cantilever.quality_factor=400"]
FILM = pm.Material(2e9, 0.05, 0.01)


@pytest.fixture
def curve(tmp_path: Path) -> Path:
    """Text with a line of names, as a user exports it."""
    z = np.linspace(26e-9, 14e-9, 121)
    sweep = pm.sweep_distance(FILM, SCOPE, z)
    rng = np.random.default_rng(5)
    columns = [-1e9 * z, *(sweep.amplitude.values / 50e-9), *(90 - sweep.phase.values + rng.normal(0, 0.1, (2, 121)))]
    columns.insert(1, columns[0])
    names = "z approach [nm]\tz retract [nm]\tamp approach [V]\tamp retract [V]\tlag approach [deg]\tlag retract [deg]"
    np.savetxt(tmp_path / "curve.txt", np.stack(columns, axis=1), delimiter="\t", header=names, comments="")
    return tmp_path / "curve.txt"


def test_a_curve_is_fitted_drawn_and_told_in_one_command(curve: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page, out = curve.with_name("fit.png"), curve.with_name("fit.nc")
    assert main(["fit", str(curve), "--starts", "1", "--plot", str(page), "-o", str(out), *LEVER]) == 0
    said = capsys.readouterr().out
    assert "nm/V at most" in said and "tip radius is not in the files" in said and "sensitivity" in said
    assert "stiffness is not" not in said
    assert page.stat().st_size > 10_000
    assert main(["plot", str(out), "-o", str(curve.with_name("again.png"))]) == 0


def test_a_measured_curve_is_drawn_as_it_is(curve: Path) -> None:
    assert main(["plot", str(curve)]) == 0
    assert curve.with_suffix(".png").stat().st_size > 10_000


def test_a_key_that_no_microscope_has_is_refused(curve: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fit", str(curve), "tip.colour=3"]) == 2
    assert "tip.radius" in capsys.readouterr().err
