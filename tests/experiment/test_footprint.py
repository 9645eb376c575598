"""Edges as the tip sees them: how wide they are, and what stays as it is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cases import load

import phasemap as pm
from phasemap.experiment.interaction import Capillary
from phasemap.experiment.seen_by_tip import typical_depth

SCOPE = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(40e-9))
SOFT, HARD = pm.Material(1e9, 0.05, 0.01, poisson_ratio=0.3), pm.Material(3e9, 0.08, 0.005, poisson_ratio=0.3)
PIXEL = 0.25e-9
LABELS = np.repeat([[0, 1]], 120, axis=1) * np.ones((3, 1), int)
EDGE = pm.Surface.from_labels(LABELS, {0: SOFT, 1: HARD}, pixel_size=PIXEL)


def width(values: np.ndarray) -> float:
    """From a tenth to nine tenths of a step along x [m]."""
    line = (values[1] - values[1].min()) / np.ptp(values[1])
    x = PIXEL * np.arange(len(line))
    places: np.ndarray = np.interp([0.1, 0.9], line, x)
    return float(np.ptp(places))


@pytest.mark.parametrize("depth", [0.5e-9, 2e-9, 5e-9])
def test_an_edge_is_as_wide_as_the_contact(depth: float) -> None:
    seen = EDGE.seen_by(SCOPE, 0.7, depth=depth)
    radius = np.sqrt(SCOPE.tip.radius * depth)
    # The Hertz pressure, summed along the edge, is a parabola: 3 u - u^3 = 1.6 at nine tenths, u = 0.6080 radii.
    assert width(seen.modulus) == pytest.approx(2 * 0.6080 * radius, abs=0.2 * PIXEL)
    # A disc, summed along the edge, is a half circle: asin u + u sqrt(1 - u^2) = 0.4 pi, u = 0.6870 radii.
    assert seen.damping is not None
    assert width(seen.damping[:, ::-1]) == pytest.approx(2 * 0.6870 * radius, abs=0.2 * PIXEL)


@pytest.mark.parametrize(
    ("depth", "why"),
    [
        (np.nan, "depth is nan; allowed: one finite number or a map of them, in m"),
        (np.where(LABELS == 1, np.inf, 1e-9), "depth is inf; allowed: .* It is at row 0, column 120; 360 such pixels"),
        ("2 nN", "depth is '2 nN'; allowed: numbers in m"),
        ([[1e-9]], r"shape of depth is \(1, 1\); allowed: \(3, 240\), or one number"),
        (1j, "depth is 1j; allowed: one finite number"),
    ],
)
def test_a_depth_that_is_none_is_refused(depth: object, why: str) -> None:
    with pytest.raises(pm.InputError, match=why):
        EDGE.seen_by(SCOPE, 0.7, depth=depth)  # type: ignore[arg-type]
    assert EDGE.seen_by(SCOPE, 0.7, depth="2 nm") == EDGE.seen_by(SCOPE, 0.7, depth=2e-9)


def test_the_attraction_reaches_beyond_the_contact() -> None:
    near = replace(SCOPE, interaction=pm.Interaction(decay_length=None))
    bare, whole = (EDGE.seen_by(scope, 0.7, depth=2e-9).adhesion[1] for scope in (near, SCOPE))
    radius = np.sqrt(20e-18)
    assert np.ptp(np.flatnonzero((bare > 0.05) & (bare < 0.08))) * PIXEL == pytest.approx(2 * radius, abs=2 * PIXEL)
    beside = 120 - round(1.2 * radius / PIXEL)
    assert bare[beside] == 0.05 < whole[beside] < 0.055


def test_away_from_edges_nothing_changes_to_the_last_bit() -> None:
    seen = EDGE.seen_by(SCOPE, 0.7)
    for name in ("modulus", "adhesion", "damping", "poisson_ratio"):
        here, there = getattr(EDGE, name), getattr(seen, name)
        np.testing.assert_array_equal(there[:, [0, 60, 180, -1]], here[:, [0, 60, 180, -1]])
    assert (np.diff(seen.modulus[1]) >= 0).all() and len(np.unique(seen.modulus)) > 20
    even = pm.Surface(modulus=1e9, shape=(4, 5), pixel_size=1e-9)
    assert even.seen_by(SCOPE, 0.7) == even


def test_pixels_without_a_material_count_nowhere() -> None:
    modulus = np.array(EDGE.modulus)
    modulus[:, 100:110] = np.nan
    holed = pm.Surface(modulus=modulus, pixel_size=PIXEL, poisson_ratio=0.3, allow_nan=True)
    seen = holed.seen_by(SCOPE, 0.7, depth=2e-9).modulus
    np.testing.assert_array_equal(np.isnan(seen), np.isnan(modulus))
    assert np.nanmin(seen) >= 1e9 and np.nanmax(seen) <= 3e9


def test_the_depth_by_default_is_that_of_the_orbit() -> None:
    for case in load("channels")[:8]:
        scope = replace(
            SCOPE, interaction=pm.Interaction(case["law"], case["decay_length"]), tip=pm.Tip(case["tip_radius"])
        )
        row = np.array([[case["modulus"], case["adhesion"], case["viscosity"], case["poisson_ratio"]]])
        depth = typical_depth(row, True, scope, case["setpoint"])
        # To first order in depth over amplitude; JKR taps less deep than DMT by a part of its larger adhesion.
        assert depth == pytest.approx(case["indentation"], rel=0.01 if case["law"] == "dmt" else 0.06)


def test_every_control_sees_the_same_surface_in_a_scene(tmp_path: Path) -> None:
    scene = tmp_path / "edge.toml"
    scene.write_text((Path(__file__).parents[2] / "samples" / "step.toml").read_text())
    small = ["surface.shape=[4, 32]"]
    sharp, blurred = (pm.load_scene(scene, [*small, f"surface.seen_by_tip={word}"]) for word in ("false", "true"))
    assert blurred.surface == sharp.surface.seen_by(sharp.microscope, 0.7)
    assert len(blurred.surface.unique()[0]) > len(sharp.surface.unique()[0]) == 2
    image = pm.simulate(blurred.surface, blurred.microscope, 0.7, "averaging")
    assert len(np.unique(image.phase)) == len(blurred.surface.unique()[0])
    with pytest.raises(pm.InputError, match=r"\[surface\] seen_by_tip is 'yes'; allowed: true or false"):
        pm.load_scene(scene, [*small, "surface.seen_by_tip='yes'"])


def test_what_cannot_be_seen_is_said() -> None:
    with pytest.raises(pm.InputError, match=r"setpoint is 1\.2"):
        EDGE.seen_by(SCOPE, 1.2)
    with pytest.raises(pm.InputError, match="shape of depth"):
        EDGE.seen_by(SCOPE, 0.7, depth=np.zeros(3))
    wet = pm.Surface(1e9, adhesion=0.05, liquid_film=np.array([[0.5e-9, 0.5e-9, 1e-9]]), pixel_size=2e-9)
    scope = pm.Microscope(SCOPE.cantilever, SCOPE.tip, SCOPE.drive, pm.Interaction(Capillary()))
    with pytest.raises(pm.InputError, match="liquid_film is varied; allowed: the same everywhere where edges are seen"):
        wet.seen_by(scope, 0.7)
