"""Films that relax, and solids that relax under liquid: against elements by the hereditary integral, and limits."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from cases import Case, load

import phasemap as pm
from phasemap.experiment.interaction import Capillary, Film

CASES = load("relaxing_contacts")
SOLID = {"modulus": 2e9, "relaxed_modulus": 1e9, "relaxation_time": 100e-9, "adhesion": 0.03}
COAT = {**SOLID, "thickness": 5e-9}
LIQUID = Capillary(0.3e-9)


def scope_of(contact: Any, quality_factor: float = 400.0, **interaction: Any) -> pm.Microscope:
    lever = pm.Cantilever(40.0, 300e3, quality_factor)
    return pm.Microscope(lever, pm.Tip(10e-9), pm.Drive(40e-9), pm.Interaction(contact, **interaction))


def pixel_of(contact: Any, solver: str = "auto", **material: Any) -> pm.Pixel:
    pixel = pm.solve_pixel(pm.Material(**material), scope_of(contact), 0.6, solver)
    assert pixel.status is pm.Status.good and abs(pixel.energy_closure) < 1e-5
    return pixel


@pytest.mark.parametrize("case", CASES, ids=lambda case: "film" if "thickness" in case else "wet")
def test_it_is_the_orbit_of_elements_by_the_hereditary_integral(case: Case) -> None:
    """tests/reference/relaxing_contacts.py, whose own extrapolations differ by up to 5e-4 degree."""
    law = (
        Film(case["base"]) if "thickness" in case else Capillary(case["film"], surface_tension=case["surface_tension"])
    )
    lever = pm.Cantilever(case["stiffness"], case["frequency"], case["quality_factor"])
    interaction = pm.Interaction(law, case["decay_length"])
    scope = pm.Microscope(lever, pm.Tip(case["radius"]), pm.Drive(case["free_amplitude"]), interaction)
    prony = pm.Prony(case["moduli"], case["times"], case["equilibrium"])
    sample = pm.Material(relaxation=prony, adhesion=case["adhesion"], thickness=case.get("thickness"))
    found = pm.solve_pixel(sample, scope, case["setpoint"])
    assert found.solver == "march" and abs(found.energy_closure) < 1e-6 and case["error"] < 5e-4
    assert found.phase == pytest.approx(case["phase"], abs=5e-4)
    assert found.dissipation == pytest.approx(case["dissipation"], rel=5e-5)
    assert found.tip_offset == pytest.approx(case["tip_offset"], abs=1e-13)
    assert found.indentation == pytest.approx(case["indentation"], rel=1e-5)


@pytest.mark.parametrize(("contact", "more"), [("film", COAT), (LIQUID, SOLID)], ids=["film", "wet"])
def test_without_time_to_relax_it_is_elastic_and_with_much_it_has_its_relaxed_modulus(
    contact: Any, more: dict[str, Any]
) -> None:
    """What is lost begins as the first power of the time, or of its inverse; the next ones are taken out."""
    still = {key: value for key, value in more.items() if not key.startswith("relax")}
    stiff, soft = (pixel_of(contact, "march", **{**still, "modulus": modulus}).phase for modulus in (2e9, 1e9))
    slow = [pixel_of(contact, **{**more, "relaxation_time": time}).phase for time in (10e-6, 20e-6)]
    assert 2 * slow[1] - slow[0] == pytest.approx(stiff, abs=1e-4) and slow[0] < stiff - 0.04
    fast = [pixel_of(contact, **{**more, "relaxation_time": time}).phase for time in (1e-9, 2e-9, 4e-9)]
    assert (8 * fast[0] - 6 * fast[1] + fast[2]) / 3 == pytest.approx(soft, abs=4e-3) and fast[0] < soft - 0.1


def test_a_film_of_no_end_is_a_half_space_and_a_thin_one_loses_less() -> None:
    # What the base adds is of first order in sqrt(R d)/h, 4 nm over 100 um.
    endless, half = pixel_of("film", **{**COAT, "thickness": 1e-4}), pixel_of("dmt", "march", **SOLID)
    assert endless.phase == pytest.approx(half.phase, abs=1e-4)
    thin = pixel_of("film", **COAT)
    assert thin.indentation < half.indentation and thin.dissipation < half.dissipation


def test_where_no_neck_forms_a_wet_solid_is_the_dry_one_to_the_last_bit() -> None:
    dry = pixel_of("dmt", "march", **SOLID)
    for law in (Capillary(0.0), Capillary(1e-9, contact_angle=180.0)):
        assert pixel_of(law, **SOLID).phase == pixel_of("dmt", **SOLID).phase
        assert pixel_of(law, "march", **SOLID).phase == dry.phase
    wet = pixel_of(LIQUID, **SOLID)
    assert wet.phase < dry.phase - 1.0 and wet.dissipation > dry.dissipation


def test_a_wet_solid_that_hardly_relaxes_has_the_orbits_of_the_elastic_one() -> None:
    """Attracted ones too, whose neck is kept or breaks in some cycles only; a share of 1e-6 relaxes."""
    for case in [one for one in load("wet") if one["period"] == 1][3::20]:
        law = Capillary(case["film"], surface_tension=case["surface_tension"], reach=case["films_apart"] / 2)
        lever = pm.Cantilever(case["stiffness"], case["resonance_frequency"], case["quality_factor"])
        scope = pm.Microscope(lever, pm.Tip(case["tip_radius"]), pm.Drive(case["free_amplitude"]), pm.Interaction(law))
        elastic, relaxing = (
            pm.solve_pixel(pm.Material(case["modulus"], case["adhesion"], **more), scope, case["setpoint"])
            for more in ({}, {"relaxed_modulus": (1 - 1e-6) * case["modulus"], "relaxation_time": 100e-9})
        )
        # Of what is no motion of one period, the mean.
        within = 1e-3 if elastic.motion == "periodic" else 0.02
        assert relaxing.phase == pytest.approx(elastic.phase, abs=within) and relaxing.motion == elastic.motion
        assert relaxing.dissipation == pytest.approx(elastic.dissipation, rel=0.02, abs=1e-22)


def test_a_viscous_wet_contact_that_cannot_pull_is_the_elastic_one_without_viscosity() -> None:
    law, wet = scope_of(LIQUID, withdrawal="ting"), {"modulus": 2e9, "adhesion": 0.03}
    none, faint, double = (
        pm.solve_pixel(pm.Material(viscosity=eta, **wet), law, 0.6, "march") for eta in (0.0, 0.5, 1.0)
    )
    assert abs(double.energy_closure) < 1e-6 and faint.phase < none.phase - 0.01
    # The loss begins as the first power of the viscosity.
    assert 2 * faint.phase - double.phase == pytest.approx(none.phase, abs=0.01)


def test_an_image_has_relaxing_films_beside_bare_substrate_and_wet_beside_dry() -> None:
    thickness = np.array([[5e-9, math.inf]])
    coated = pm.Surface(**SOLID, thickness=thickness, pixel_size=1e-9)
    image = pm.simulate(coated, scope_of("film"), 0.6)
    alone = [pixel_of("film", **COAT).phase, pixel_of("dmt", "march", **SOLID).phase]
    np.testing.assert_allclose(image.phase.values[0], alone, atol=1e-4)
    assert "film contact" in image.attrs["modelled"] and "relaxation after Ting" in image.attrs["modelled"]
    wet = pm.Surface(**SOLID, liquid_film=[[0.3e-9, 0.0]], pixel_size=1e-9)
    alone = [pixel_of(Capillary(liquid, tip_film=0.3e-9 if liquid else 0.0), **SOLID).phase for liquid in (0.3e-9, 0.0)]
    image = pm.simulate(wet, scope_of(Capillary(0.3e-9, tip_film=0.0)), 0.6)
    assert "necks of liquid" in image.attrs["modelled"] and image.phase.values[0, 1] > image.phase.values[0, 0] + 0.5
    assert image.phase.values[0, 1] == pytest.approx(alone[1], abs=1e-4)


def test_what_is_not_known_of_films_and_necks_that_remember_is_refused_in_one_sentence() -> None:
    with pytest.raises(pm.InputError, match=r"contact is 'film'; allowed: 'hertz', 'dmt' or 'capillary' where withd"):
        scope_of("film", withdrawal="ting")
    with pytest.raises(pm.InputError, match=r"contact is 'jkr'; allowed: .* 'capillary' or 'film' where materials re"):
        pm.solve_pixel(pm.Material(**SOLID), scope_of("jkr"), 0.6)
    with pytest.raises(pm.InputError, match=r"thickness is given; allowed: nothing where the contact is 'dmt'"):
        pm.solve_pixel(pm.Material(**COAT), scope_of("dmt"), 0.6)
    for contact, material in (("film", COAT), (LIQUID, SOLID)):
        with pytest.raises(pm.InputError, match=r"surface is one that remembers; allowed: materials without a relaxat"):
            pm.force_curve(pm.Material(**material), scope_of(contact), [0.0, 1e-9])
