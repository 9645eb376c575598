"""Forces outside contact: formulas of their sources, orbits of an independent integrator, and what is refused."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

import phasemap as pm
from phasemap.experiment.interaction import DLVO, Hydration, Interaction, Solvation
from phasemap.experiment.interaction.longrange import FORCES
from phasemap.scenes.objects import microscope_of, microscope_tables

CASES = json.loads((Path(__file__).parents[1] / "data" / "long_range.json").read_text())
RADIUS, EPSILON = 10e-9, 78.5 * 8.8541878188e-12


def force_at(gap: float, interaction: Interaction, adhesion: float = 0.0) -> float:
    one = np.ones(1)
    return interaction.outside.force(-gap, interaction.columns(1e9 * one, adhesion * one, 0.0 * one, RADIUS)[0])


def test_the_double_layer_is_that_of_linear_poisson_and_boltzmann() -> None:
    tip, sample, debye = -0.01, 0.004, 2e-9

    def pressure(gap: float) -> float:  # of planes of constant charge, exactly
        x = gap / debye
        return (2 * tip * sample * math.cosh(x) + tip**2 + sample**2) / (2 * EPSILON * math.sinh(x) ** 2)

    law = Interaction("hertz", None, longrange=DLVO(tip, sample, debye))
    for gap in (4 * debye, 8 * debye):
        exact = 2 * math.pi * RADIUS * quad(pressure, gap, 30 * debye)[0]
        # The next term left out is of the order of exp(-2 gap/lambda) of the first.
        assert force_at(gap, law) == pytest.approx(exact, rel=3 * math.exp(-2 * gap / debye))


def test_the_debye_length_of_the_page_is_that_of_water_with_a_mole_of_salt() -> None:
    ions, thermal = 2 * 6.02214076e26, 1.380649e-23 * 298.15
    length = math.sqrt(DLVO.permittivity * 8.8541878188e-12 * thermal / (ions * 1.602176634e-19**2))
    assert round(length * 1e9, 3) == 0.304 and "0.304 nm" in str(DLVO.__doc__)  # Israelachvili (2011), chapter 14


def test_lennard_jones_planes_pull_most_with_what_greenwood_prints() -> None:
    # Greenwood, Proc. R. Soc. A 453, 1277 (1997): 16/(9 sqrt(3)) = 1.026 w/z0, here as the slope of the sphere's force.
    law = Interaction("dmt", 0.3e-9, longrange="lennard-jones")
    gaps = np.linspace(0, 0.3e-9, 601)
    pull = np.diff([force_at(gap, law, 0.05) for gap in gaps]) / np.diff(gaps) / (2 * math.pi * RADIUS)
    assert pull.max() * 0.3e-9 / 0.05 == pytest.approx(1.026, abs=5e-4)
    assert gaps[pull.argmax()] == pytest.approx((3 ** (1 / 6) - 1) * 0.3e-9, abs=1e-12)


def test_lennard_jones_separates_planes_with_the_work_of_adhesion() -> None:
    adhesion, law = 0.05, Interaction("dmt", 0.3e-9, longrange="lennard-jones")
    # The force on the sphere at contact is 2 pi R times the energy of the planes there, of which d/dD is the pressure.
    energy = quad(lambda z: 1 / z**3 - 1 / z**9, 1, np.inf)[0]  # in units of H/(6 pi z0^2)
    hamaker = 16 * math.pi * 0.3e-9**2 * adhesion
    assert energy * hamaker / (6 * math.pi * 0.3e-9**2) == pytest.approx(adhesion, rel=1e-9)
    assert force_at(0.0, law, adhesion) == pytest.approx(-2 * math.pi * RADIUS * adhesion, rel=1e-12)
    far = force_at(300e-9, law, adhesion)
    assert far == pytest.approx(-hamaker * RADIUS / (6 * 300.3e-9**2), rel=1e-9)


@pytest.mark.filterwarnings("ignore::phasemap.PlausibilityWarning")
@pytest.mark.parametrize("solver", ["auto", "march"])
def test_orbits_are_those_of_an_independent_integrator(solver: str) -> None:
    assert len(CASES) == 60
    for case in CASES:
        interaction = Interaction("dmt", case["decay_length"], longrange=FORCES[case["law"]](**case["parameters"]))
        scope = pm.Microscope(
            pm.Cantilever(case["stiffness"], 300e3, case["quality_factor"]), pm.Tip(case["radius"]),
            pm.Drive(case["free_amplitude"]), interaction,
        )  # fmt: skip
        material = pm.Material(case["modulus"], case["adhesion"], case["damping"])
        pixel = pm.solve_pixel(material, scope, case["setpoint"], solver)
        assert pixel.status is pm.Status.good
        assert pixel.phase == pytest.approx(case["phase"], abs=1e-3)
        # Collocation states up to 0.08 pm where the force oscillates; all else is known to 0.01 pm.
        assert pixel.tip_offset == pytest.approx(case["tip_offset"], abs=max(1e-14, pixel.error_height))


@pytest.mark.parametrize("law", ["dlvo", "hydration", "solvation", "lennard-jones"])
def test_a_scene_has_the_keys_of_a_force_beside_its_name(law: str) -> None:
    scene = pm.load_scene(Path(__file__).parents[2] / "samples" / "step.toml", [f"interaction.longrange={law}"])
    assert scene.microscope.interaction.outside == FORCES[law]()
    assert microscope_of(microscope_tables(scene.microscope)) == scene.microscope


def test_parameters_in_a_scene_are_those_of_python() -> None:
    sample = Path(__file__).parents[2] / "samples" / "step.toml"
    given = ["interaction.longrange=dlvo", "interaction.debye_length=3 nm", "interaction.surface_charge_tip=0.02"]
    made = pm.load_scene(sample, given).microscope.interaction
    assert made.longrange == DLVO(surface_charge_tip=0.02, debye_length=3e-9)


def test_an_image_says_what_acts_and_can_be_checked() -> None:
    scope = pm.Microscope(
        pm.Cantilever(1.0, 50e3, 20.0), pm.Tip(10e-9), pm.Drive(5e-9), Interaction(longrange=DLVO(debye_length=2e-9))
    )
    surface = pm.Surface(np.array([[1e8, 1e9]]), adhesion=1e-3, pixel_size=2e-9)
    image = pm.simulate(surface, scope, 0.8)
    assert "dlvo force" in image.attrs["modelled"]
    assert pm.check(image, surface).holds


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"longrange": "casimir"}, "longrange is 'casimir'; allowed: one of van der waals, dlvo, hydration"),
        ({"longrange": 3}, "longrange is 3; allowed: one of van der waals"),
        ({"longrange": "dlvo", "bias": 1.0}, "bias is 1.0; allowed: 0 V where longrange is 'dlvo'"),
        (
            {"longrange": "dlvo", "contact": "cone"},
            "longrange is 'dlvo'; allowed: 'van der waals' where the contact is",
        ),
        ({"longrange": "dlvo", "contact": "capillary"}, "allowed: 'van der waals' where the contact is 'capillary'"),
    ],
)
def test_what_does_not_go_together_is_refused_in_a_sentence(arguments: dict[str, Any], sentence: str) -> None:
    with pytest.raises(pm.InputError, match=sentence):
        Interaction(**arguments)


@pytest.mark.filterwarnings("ignore::phasemap.PlausibilityWarning")
def test_a_force_that_is_zero_at_contact_acts_before_it() -> None:
    law = Interaction("hertz", None, longrange=DLVO(0.05, -0.05, 1e-9))
    assert force_at(1e-9, law) < -1e-11
    pixel = pm.solve_pixel(
        pm.Material(1e9), pm.Microscope(pm.Cantilever(1.0, 50e3, 20.0), pm.Tip(10e-9), pm.Drive(5e-9), law), 0.9
    )
    plain = Interaction("hertz", None)
    other = pm.solve_pixel(
        pm.Material(1e9), pm.Microscope(pm.Cantilever(1.0, 50e3, 20.0), pm.Tip(10e-9), pm.Drive(5e-9), plain), 0.9
    )
    assert pixel.tip_offset < other.tip_offset - 10e-12


def test_laws_with_other_parameters_are_other_laws() -> None:
    assert Hydration(1e-3) != Hydration(2e-3) and Solvation() != Hydration()
    assert "longrange=Hydration(strength=0.002" in repr(Interaction(longrange=Hydration(2e-3)))
