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
    assert np.abs(off).max() < 2 * REDUCED  # by the fast arms, and by the slow ones


def test_slow_arms_are_one_that_lasts_less_long_with_the_same_modulus_at_the_drive_and_above() -> None:
    """What is left of the modulus stays, and a motion that repeats itself knows that and harmonics only."""
    slow = pm.Prony([8e8, 5e7, 3e7], [100e-9, 20e-6, 30e-6], 1e9)
    less = merged(slow, 300e3)
    assert len(less.times) == 2 and less.times[-1] < 23e-6 and less.lasting == slow.lasting
    f = np.geomspace(300e3, 9e6, 50)
    assert np.abs(less.complex_modulus(f) / slow.complex_modulus(f) - 1).max() < 1.1 * REDUCED


def test_images_of_spectra_beside_one_time_are_those_of_their_pixels() -> None:
    materials = [
        pm.Material(relaxation=RUBBER, adhesion=0.03),
        pm.Material(2e9, adhesion=0.03, relaxed_modulus=1e9, relaxation_time=100e-9),
    ]
    image = pm.simulate(pm.Surface.from_labels([[0, 1]], materials, pixel_size=1e-9), SCOPE, setpoint=0.6)
    single = [pm.solve_pixel(one, SCOPE, setpoint=0.6).phase for one in materials]
    np.testing.assert_allclose(image.phase.values[0], single, atol=2e-4)


@pytest.mark.slow
def test_a_sweep_carries_the_memory_of_every_arm() -> None:
    swept = pm.sweep_setpoint(pm.Material(relaxation=RUBBER, adhesion=0.03), SCOPE, [0.8, 0.6])
    here = pm.solve_pixel(pm.Material(relaxation=RUBBER, adhesion=0.03), SCOPE, setpoint=0.6)
    assert float(swept.phase[0, -1]) == pytest.approx(float(here.phase), abs=1e-3)


def test_a_modulus_that_is_swept_takes_the_spectrum_along() -> None:
    rubber, half = (
        pm.Material(relaxation=pm.Prony([c * 1e9, c * 0.5e9], [20e-9, 200e-9], c * 0.5e9), adhesion=0.03)
        for c in (1.0, 0.5)
    )
    swept = pm.sweep_parameter(rubber, SCOPE, "modulus", [1e9, 2e9], setpoint=0.6)
    single = [float(pm.solve_pixel(one, SCOPE, setpoint=0.6).phase) for one in (half, rubber)]
    np.testing.assert_allclose(swept.phase, [single, single], atol=1e-3)


@pytest.mark.slow
def test_a_scan_in_time_records_the_phase_of_every_arm() -> None:
    """On ground of one material the feedback comes to rest: to 0.02 degree, of steps of 0.7 and of a settling loop."""
    surface = pm.Surface(RUBBER.instantaneous, relaxation=RUBBER, pixel_size=1e-9, shape=(1, 3))
    scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 60.0), pm.Tip(10e-9), pm.Drive(40e-9))
    image = pm.simulate(surface, scope, setpoint=0.6, control=pm.Feedback(line_rate=8.0, engage="line"))
    here = pm.solve_pixel(pm.Material(relaxation=RUBBER), scope, setpoint=0.6)
    np.testing.assert_allclose(image.phase.values, here.phase, atol=0.02)


def test_what_cannot_carry_a_spectrum_says_so() -> None:
    surface = pm.Surface(RUBBER.instantaneous, relaxation=RUBBER, pixel_size=1e-9, shape=(1, 2))
    with pytest.raises(pm.InputError, match="contacts remember"):
        pm.simulate(surface, SCOPE, setpoint=0.6, control=pm.Raster())
    with pytest.raises(pm.InputError, match="one that remembers"):
        pm.orbits(pm.Material(relaxation=RUBBER), SCOPE, setpoint=0.6)


# Amplitude over free and phase [degree] of a published table, and of the motion behind it: its record is read 11 of
# 10,000 steps of a period late, and divided by 999 for 1000 samples (tests/reference/polyisobutylene.py).
PUBLISHED = ((0.7828, 34.298), (0.7076, 40.311), (0.5910, 48.387), (0.5115, 53.287), (0.3904, 59.983))
SIMULATED = tuple((amplitude * 0.999, phase - 0.396) for amplitude, phase in PUBLISHED)


def _polyisobutylene(dwell: float, setpoint: float) -> float:
    scope = pm.Microscope(
        pm.Cantilever(6.5, 46e3, 150.0), pm.Tip(10e-9), pm.Drive(230e-9), pm.Interaction("dmt", decay_length=0.2e-9)
    )
    rubber = pm.Material(relaxation=pm.Prony.preset("PIB", dwell), adhesion=0.1326, poisson_ratio=0.5)
    return float(pm.solve_pixel(rubber, scope, setpoint=setpoint).phase)


def test_polyisobutylene_comes_to_the_phase_of_a_simulation_of_its_source_the_longer_the_tip_dwells() -> None:
    """That is of 760 periods, 16.5 ms, by Lee and Radok's theory, which differs."""
    setpoint, simulated = SIMULATED[1]
    soon, later = (_polyisobutylene(dwell, setpoint) - simulated for dwell in (50e-6, 200e-6))
    assert -1.4 < soon < -1.0 < later < -0.5


@pytest.mark.slow
@pytest.mark.parametrize(("setpoint", "simulated"), SIMULATED)
def test_polyisobutylene_that_is_dwelt_on_as_long_is_within_a_quarter_degree_of_the_simulation(
    setpoint: float, simulated: float
) -> None:
    """A sixteenth of its 16.5 ms leaves up to 0.6 degree: what relaxes more slowly has not come to rest."""
    soon, later = (_polyisobutylene(dwell, setpoint) - simulated for dwell in (1e-3, 16.5e-3))
    assert -0.7 < soon < later - 0.2 < 0.05
    assert abs(later) < 0.25
