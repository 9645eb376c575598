"""Losses outside contact and by adhesion: an independent integrator, what a tap loses, and what is refused."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import phasemap as pm
from phasemap.experiment.interaction import Interaction, LossyDMT

CASES = json.loads((Path(__file__).parents[1] / "data" / "losses.json").read_text())
SCOPE = pm.Microscope(pm.Cantilever(20.0, 300e3, 100.0), pm.Tip(10e-9), pm.Drive(20e-9))
MATERIAL = pm.Material(1e9, 0.02)


def under(law: LossyDMT, decay_length: float | None = 0.3e-9) -> pm.Microscope:
    return replace(SCOPE, interaction=Interaction(law, decay_length))


def test_orbits_are_those_of_an_independent_integrator() -> None:
    assert len(CASES) == 18
    for case in CASES:
        law = LossyDMT(case["adhesion_ratio"], case["outer_loss"], case["outer_length"])
        scope = pm.Microscope(
            pm.Cantilever(case["stiffness"], 300e3, case["quality_factor"]), pm.Tip(case["radius"]),
            pm.Drive(case["free_amplitude"]), Interaction(law, case["decay_length"]),
        )  # fmt: skip
        material = pm.Material(case["modulus"], case["adhesion"], case["damping"])
        pixel = pm.solve_pixel(material, scope, case["setpoint"])
        assert pixel.status is pm.Status.good and pixel.solver == "march"
        assert pixel.phase == pytest.approx(case["phase"], abs=1e-3)
        assert pixel.tip_offset == pytest.approx(case["tip_offset"], abs=1e-14)
        assert pixel.dissipation == pytest.approx(case["dissipation"], rel=1e-5)
        assert abs(pixel.energy_closure) < 1e-6


@pytest.mark.parametrize("decay_length", [0.3e-9, None])
def test_adhesion_that_grows_takes_energy_in_proportion_to_the_depth(decay_length: float | None) -> None:
    pixel = pm.solve_pixel(MATERIAL, under(LossyDMT(2.5), decay_length), 0.7)
    assert pixel.dissipation == pytest.approx(2 * math.pi * 10e-9 * 1.5 * 0.02 * pixel.indentation, rel=1e-9)


@pytest.mark.parametrize("decay_length", [0.3e-9, None])
def test_a_loss_outside_contact_is_there_without_a_tap(decay_length: float | None) -> None:
    # Attractive: a stiff lever of high Q and a small amplitude does not touch where anything attracts.
    scope = replace(under(LossyDMT(outer_loss=2e-7), decay_length), cantilever=pm.Cantilever(30.0, 300e3, 400.0))
    scope = replace(scope, drive=pm.Drive(6e-9))
    pixel = pm.solve_pixel(pm.Material(10e9, 0.05), scope, 0.9)
    assert pixel.dissipation > 1e-19 and abs(pixel.energy_closure) < 1e-6
    if decay_length is not None:
        assert pixel.indentation < 0.0


def test_higher_modes_do_not_fly_past_a_loss() -> None:
    # Without a force outside contact a lever with two modes flies in one exact step; a loss there is not passed over.
    several = pm.Cantilever(20.0, 300e3, 100.0, modes=2)
    one, two = (
        pm.solve_pixel(MATERIAL, replace(under(LossyDMT(outer_loss=1e-7), None), cantilever=lever), 0.7)
        for lever in (SCOPE.cantilever, several)
    )
    assert two.dissipation == pytest.approx(one.dissipation, rel=0.2) and two.dissipation > 5e-19


def test_without_losses_the_law_is_dmt() -> None:
    wanted, found = (pm.solve_pixel(MATERIAL, scope, 0.7) for scope in (SCOPE, under(LossyDMT())))
    assert found.phase == pytest.approx(wanted.phase, abs=1e-5) and found.solver == wanted.solver


@pytest.mark.slow
def test_images_and_scans_have_the_losses() -> None:
    surface = pm.Surface(np.array([[1e9, 2e9]]), adhesion=0.02, pixel_size=2e-9)
    scope = under(LossyDMT(2.0, 1e-7, 1e-9))
    image = pm.simulate(surface, scope, 0.7)
    alone = [pm.solve_pixel(pm.Material(modulus, 0.02), scope, 0.7).phase for modulus in (1e9, 2e9)]
    assert image.phase.values.ravel() == pytest.approx(alone, abs=1e-6)
    assert pm.check(image, surface).holds
    flat = pm.Surface(np.full((1, 8), 1e9), adhesion=0.02, pixel_size=2e-9)
    scan = pm.simulate(flat, scope, 0.7, control=pm.Feedback())
    assert scan.phase.values.ravel() == pytest.approx(alone[0], abs=0.01)


def test_a_scene_has_the_law() -> None:
    scene = Path(__file__).parents[2] / "samples" / "step.toml"
    given = 'interaction.contact={ law = "lossy dmt", adhesion_ratio = 2, outer_loss = "0.1 uN s/m" }'
    assert pm.load_scene(scene, [given]).microscope.interaction.contact == LossyDMT(2.0, 1e-7)


def test_the_loop_of_a_force_curve_is_the_energy_that_a_tap_loses_by_adhesion() -> None:
    depths = np.linspace(-1e-9, 2e-9, 61)
    there, back = pm.force_curve(MATERIAL, under(LossyDMT(2.0, 1e-7)), depths).force.values
    assert (there == pm.force_curve(MATERIAL, SCOPE, depths).force.values[0]).all()
    assert (back[depths < 0] == there[depths < 0]).all()
    inside = depths >= 0.0
    lost = np.trapezoid((there - back)[inside], depths[inside])
    assert lost == pytest.approx(2 * np.pi * 10e-9 * (0.04 - 0.02) * 2e-9)  # theory, Eq. (losses-2)


def test_what_does_not_know_the_losses_refuses_them_in_a_sentence() -> None:
    with pytest.raises(pm.InputError, match="contact is 'lossy dmt'; allowed: a dry law without losses"):
        pm.orbits(MATERIAL, under(LossyDMT(2.0)), setpoint=0.7)
    with pytest.raises(pm.InputError, match=r"adhesion_ratio is 0\.5; allowed: a finite number of at least"):
        LossyDMT(0.5)
    with pytest.raises(pm.InputError, match="longrange is 'dlvo'; allowed: 'van der waals' where the contact is"):
        Interaction(LossyDMT(), longrange="dlvo")
    with pytest.raises(pm.InputError, match="contact is 'lossy dmt'; allowed: 'hertz', 'dmt' or 'capillary' where"):
        Interaction(LossyDMT(), withdrawal="ting")
