"""Materials with several relaxation times: orbits against the hereditary integral, limits, and what is refused."""

from __future__ import annotations

import json
import pathlib
from typing import Any

import numpy as np
import pytest

import phasemap as pm
from phasemap.experiment.arms import REDUCED, merged

CASES = json.loads((pathlib.Path(__file__).parents[1] / "data" / "prony.json").read_text())
SCOPE = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(40e-9))
RUBBER = pm.Prony([1e9, 0.5e9], [20e-9, 200e-9], 0.5e9)


def _solved(case: dict[str, Any], prony: pm.Prony) -> Any:
    scope = pm.Microscope(
        pm.Cantilever(case["stiffness"], case["frequency"], case["quality_factor"]),
        pm.Tip(case["radius"]),
        pm.Drive(case["free_amplitude"]),
        pm.Interaction("dmt", decay_length=case["decay_length"]),
    )
    return pm.solve_pixel(pm.Material(relaxation=prony, adhesion=case["adhesion"]), scope, setpoint=case["setpoint"])


def test_orbits_over_2_to_8_arms_are_those_of_the_hereditary_integral() -> None:
    """tests/reference/prony.py: elements whose forces are that integral; it has the orbits with repulsion only.

    The tolerance is what was asked, 1e-3 degree, the reference's own extrapolations differ by up to 2e-3.
    """
    solved = [(case, _solved(case, pm.Prony(case["moduli"], case["times"], case["equilibrium"]))) for case in CASES]
    repulsive = [(case, found) for case, found in solved if found.phase > 0 and case["error"] < 3e-3]
    assert len(CASES) == 20 and len(repulsive) >= 14
    for case, found in repulsive:
        assert found.phase == pytest.approx(case["phase"], abs=1e-3)
        assert found.dissipation == pytest.approx(case["dissipation"], rel=3e-4)


def test_one_arm_is_the_standard_linear_solid() -> None:
    plain = pm.Material(2e9, adhesion=0.05, relaxed_modulus=1e9, relaxation_time=100e-9)
    arm = pm.Material(relaxation=pm.Prony([1e9], [100e-9], 1e9), adhesion=0.05)
    one, other = (pm.solve_pixel(each, SCOPE, setpoint=0.6) for each in (plain, arm))
    assert other.phase == pytest.approx(one.phase, abs=1e-9)


def test_two_arms_of_nearly_one_time_are_one_arm() -> None:
    both = pm.Prony([4e9, 6e9], [1e-6, 1.0001e-6], 1e9)
    one, two = (
        pm.solve_pixel(pm.Material(relaxation=prony), SCOPE, setpoint=0.6)
        for prony in (pm.Prony([10e9], [1.00006e-6], 1e9), both)
    )
    assert two.phase == pytest.approx(one.phase, abs=2e-4)


def test_an_elastic_tip_takes_its_part_of_every_arm() -> None:
    """Of a sudden touch and of a slow one, the stiffness is that of two springs in series."""
    from phasemap.experiment.arms import contact_of

    compliance = 0.5e-9
    one = contact_of(RUBBER.key, compliance, 300e3, 2e6)
    first, last = (E / (1 + E * compliance) for E in (RUBBER.instantaneous, RUBBER.equilibrium))
    assert 1 - one.share == pytest.approx(last / first, rel=1e-12)
    assert one.stiffness == 1.0


def test_fast_arms_are_merged_within_the_stated_error_and_slow_ones_are_springs() -> None:
    wide = pm.Prony([1e9] * 9, np.logspace(-12, -4, 9), 1e7, dwell=3e-5)
    less, f = merged(wide, 100e3), np.geomspace(100e3, 3e6, 50)
    assert len(less.times) == 5 and less.equilibrium == pytest.approx(1.01e9)
    held = pm.Prony(wide.moduli[:-1], wide.times[:-1], 1.01e9)
    off = less.complex_modulus(f) / held.complex_modulus(f) - 1
    assert np.abs(off).max() < REDUCED


def test_images_of_spectra_beside_one_time_are_those_of_their_pixels() -> None:
    materials = [
        pm.Material(relaxation=RUBBER, adhesion=0.03),
        pm.Material(2e9, adhesion=0.03, relaxed_modulus=1e9, relaxation_time=100e-9),
    ]
    image = pm.simulate(pm.Surface.from_labels([[0, 1]], materials, pixel_size=1e-9), SCOPE, setpoint=0.6)
    single = [pm.solve_pixel(one, SCOPE, setpoint=0.6).phase for one in materials]
    np.testing.assert_allclose(image.phase.values[0], single, atol=2e-4)


def test_a_sweep_carries_the_memory_of_every_arm() -> None:
    swept = pm.sweep_setpoint(pm.Material(relaxation=RUBBER, adhesion=0.03), SCOPE, [0.8, 0.6])
    here = pm.solve_pixel(pm.Material(relaxation=RUBBER, adhesion=0.03), SCOPE, setpoint=0.6)
    assert float(swept.phase[0, -1]) == pytest.approx(float(here.phase), abs=1e-3)


def test_what_cannot_carry_a_spectrum_says_so() -> None:
    surface = pm.Surface(RUBBER.instantaneous, relaxation=RUBBER, pixel_size=1e-9, shape=(1, 2))
    with pytest.raises(pm.InputError, match="Engage where materials have a spectrum"):
        pm.simulate(surface, SCOPE, setpoint=0.6, control=pm.Feedback())
    with pytest.raises(pm.InputError, match="contacts remember"):
        pm.simulate(surface, SCOPE, setpoint=0.6, control=pm.Raster())
    with pytest.raises(pm.InputError, match="one that remembers"):
        pm.orbits(pm.Material(relaxation=RUBBER), SCOPE, setpoint=0.6)


def test_polyisobutylene_comes_nearer_to_a_published_table_the_deeper_the_dents_that_it_may_form() -> None:
    """The table (examples/relaxation_spectrum.py) has the same arms, but a sample that flows and sinks by 90 nm.

    Its phases are those of Lee and Radok's theory after 750 periods. With a dwell of 1 ms four of the five are met
    within 0.1 degree, in minutes each, and the fifth does not settle; longer ones do not settle at all.
    """
    scope = pm.Microscope(
        pm.Cantilever(6.5, 46e3, 150.0), pm.Tip(10e-9), pm.Drive(230e-9), pm.Interaction("dmt", decay_length=0.2e-9)
    )
    for setpoint, published in ((0.7828, 34.30), (0.5115, 53.29)):
        off = []
        for dwell in (2e-6, 20e-6, 50e-6, 200e-6):
            rubber = pm.Material(relaxation=pm.Prony.preset("PIB", dwell), adhesion=0.1326, poisson_ratio=0.5)
            off.append(published - float(pm.solve_pixel(rubber, scope, setpoint=setpoint).phase))
        assert off == sorted(off, reverse=True)
        assert 0 < off[-1] < 1.2 and off[0] < 3.5
