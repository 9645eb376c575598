"""Exact orbits against orbits computed by other means, and against laws that every orbit obeys."""

from __future__ import annotations

import math

import numpy as np
import pytest
import xarray as xr
from cases import Case, label, load, material_of, scope_of

import phasemap as pm

CASES = [(name, case) for name in ("orbits", "orbits_unseen") for case in load(name)]
BISTABLE = load("engaged")

# The references are good to 1e-6 degree and 1e-4 pm; the issue asks for 1e-4 degree, 0.1 pm and 1e-5 in the multiplier.
# The solver is held to ten times the references' own error.
PHASE, LENGTH, FLOQUET = 1e-5, 1e-15, 1e-5
# Multipliers of tests/data/orbits.json come from finite differences and are up to 7e-5 off where this is proved by
# det(monodromy) = exp(-2 pi / Q) of a conservative surface: its modulus cannot be below exp(-pi / Q).
LOOSE_FLOQUET = {"soft lever k=2.6 Q=206.9": 1e-4, "stiff k=49 Q=231.7": 2e-5}


def found_of(case: Case) -> xr.Dataset:
    return pm.orbits(material_of(case), scope_of(case), setpoint=case["setpoint"])


@pytest.mark.parametrize(("name", "case"), CASES, ids=[label(case) for _, case in CASES])
def test_every_reference_orbit_is_found(name: str, case: Case) -> None:
    found = found_of(case)
    for orbit in case["orbits"]:
        apart = abs(found.tip_offset.values - orbit["tip_offset"]) / 1e-12 + abs(found.phase.values - orbit["phase"])
        one = found.isel(orbit=int(np.argmin(apart)))
        assert abs(float(one.tip_offset) - orbit["tip_offset"]) < LENGTH
        assert abs(float(one.phase) - orbit["phase"]) < PHASE
        assert abs(float(one.mean_deflection) - orbit["mean_deflection"]) < LENGTH
        assert abs(float(one.floquet) - orbit["floquet"]) < LOOSE_FLOQUET.get(label(case), FLOQUET)
        if "dissipation" in orbit:
            assert float(one.dissipation) == pytest.approx(orbit["dissipation"], rel=1e-6, abs=1e-24)
            # The apex is that of a cubic between two nodes: of long contacts at low Q it is off by 2e-6.
            assert float(one.indentation) == pytest.approx(orbit["peak_indentation"], rel=5e-6, abs=LENGTH)
    assert len(found.orbit) >= len(case["orbits"])
    assert np.all(np.diff(found.tip_offset) <= 0)


@pytest.mark.parametrize(("name", "case"), CASES, ids=[label(case) for _, case in CASES])
def test_energy_that_goes_in_comes_out(name: str, case: Case) -> None:
    assert np.all(abs(found_of(case).energy_closure) < 1e-6)


@pytest.mark.parametrize("case", [c for _, c in CASES if c["damping"] == 0], ids=label)
def test_a_conservative_surface_contracts_phase_space_as_the_free_lever_does(case: Case) -> None:
    # Product of the multipliers = exp(-2 pi alpha0 2 / omega): no multiplier can be below its square root in modulus
    # unless the other is above it.
    least = math.exp(-math.pi / (case["quality_factor"] * case.get("frequency_ratio", 1.0)))
    assert np.all(found_of(case).floquet >= least * (1 - 1e-9))


@pytest.mark.parametrize("case", [c for c in BISTABLE if c["engaged"]["branch"] != "none"], ids=label)
def test_orbits_at_a_tip_offset_contain_the_orbit_at_the_setpoint(case: Case) -> None:
    if case["quality_factor"] < 10:
        pytest.skip("several orbits share a tip offset to within rounding")
    pixel = pm.solve_pixel(material_of(case), scope_of(case), case["setpoint"], solver="orbit")
    found = pm.orbits(material_of(case), scope_of(case), tip_offset=pixel.tip_offset)
    apart = abs(found.amplitude.values - pixel.amplitude) / 1e-14 + abs(found.phase.values - pixel.phase) / 1e-4
    assert np.min(apart) < 1


@pytest.mark.parametrize("setpoint", [0.2, 0.5, 0.7071, 0.9, 0.99])
@pytest.mark.parametrize("quality_factor", [400.0, 5e4])
def test_undamped_phase_is_arccos_of_setpoint(setpoint: float, quality_factor: float) -> None:
    # Wang (1999), Fig. 7: without damping only F+ and F- exist, whatever the forces. Harmonics above the first lose
    # energy to the air; their amplitude goes with 1/Q, so the shift with 1/Q^2 (0.035 degree at Q = 50).
    scope = pm.Microscope(pm.Cantilever(40.0, 300e3, quality_factor), pm.Tip(10e-9), pm.Drive(60e-9))
    for material in (pm.Material(2e9), pm.Material(5e9, adhesion=0.05), pm.Material(0.5e9, adhesion=0.2)):
        phase = pm.solve_pixel(material, scope, setpoint, solver="orbit").phase
        assert abs(abs(phase) - math.degrees(math.acos(setpoint))) < 2e-3


def test_a_setpoint_and_a_tip_offset_together_are_refused() -> None:
    scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(20e-9))
    with pytest.raises(pm.InputError, match="exactly one of the two"):
        pm.orbits(pm.Material(1e9), scope, setpoint=0.7, tip_offset=1e-8)
