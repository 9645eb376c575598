"""A lever in a liquid: the hydrodynamic function against the fluid's equations of motion, and levers of practice."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.special import kv

import phasemap as pm
from phasemap.experiment.beam import hydrodynamic_function
from phasemap.experiment.presets import levers

NITRIDE = {"modulus": 250e9, "density": 3100.0}
SILICON = {"modulus": 169e9, "density": 2330.0}
WATER = 998.0, 1.0e-3  # kg/m3, Pa s


def gamma_of_stokes_flow(reynolds: float, count: int) -> complex:
    """Gamma of a thin ribbon by the unsteady Stokes equations, with point forces along it as unknowns.

    The width is 2, density and viscosity are such that the squared inverse length of the viscous layer is i Re.
    Forces go as a cosine series over sqrt(1 - x^2); the logarithm of their fields is integrated exactly, the rest by
    the midpoint rule in the angle.
    """
    layer, order = np.sqrt(1j * reynolds), np.arange(count)
    angle = (order + 0.5) * np.pi / count
    distance = np.abs(np.cos(angle)[:, None] - np.cos(angle))
    with np.errstate(divide="ignore", invalid="ignore"):
        r = layer * distance
        smooth = kv(0, r) + kv(1, r) / r - 1 / r**2 + 0.5 * np.log(distance)
    np.fill_diagonal(smooth, -0.5 * np.log(layer / 2) - 0.5 * np.euler_gamma - 0.25)
    cosines = np.cos(np.outer(angle, order))
    series = cosines.T * np.where(order == 0, 1, 2)[:, None] / count
    logarithm = cosines * np.where(order == 0, np.log(2), 1 / np.maximum(order, 1)) * np.pi / 2
    velocity = smooth * np.pi / count + logarithm @ series
    force = np.linalg.solve(velocity, np.full(count, 2 * np.pi + 0j)).sum() * np.pi / count
    return complex(np.conj(force / (1j * np.pi * reynolds)))


@pytest.mark.parametrize("reynolds", [1e-3, 1e-2, 0.1, 1.0, 3.0, 10.0, 30.0, 100.0])
def test_the_hydrodynamic_function_is_that_of_a_ribbon_in_stokes_flow(reynolds: float) -> None:
    coarse, fine = (gamma_of_stokes_flow(reynolds, count) for count in (150, 300))
    assert coarse == pytest.approx(fine, rel=5e-4)
    found = hydrodynamic_function(reynolds)
    # Sader states 0.1 % for his fit; here it is 0.01 %, and the ribbon of 300 points is good to that.
    assert found.real == pytest.approx(fine.real, rel=5e-4) and found.imag == pytest.approx(fine.imag, rel=5e-4)


def test_far_above_it_is_the_potential_flow_around_a_ribbon() -> None:
    # The added mass of a ribbon is that of a cylinder as wide; a thin layer adds 1/sqrt(Re) of it.
    for reynolds in (1e4, 1e5, 1e6):
        assert abs(hydrodynamic_function(reynolds) - 1) < 10 / math.sqrt(reynolds)


def test_the_stiffness_of_a_lever_is_that_of_its_thermal_tune_in_air() -> None:
    # Sader, Chon and Mulvaney, Rev. Sci. Instrum. 70, 3967 (1999): k = 0.1906 rho b^2 L Q Im(Gamma) omega^2, the static
    # one, to the four digits of their factor.
    lever = pm.Cantilever.rectangular(200e-6, 30e-6, 2e-6, **SILICON)
    omega = 2 * math.pi * lever.resonance_frequency
    drag = hydrodynamic_function(1.2 * omega * 30e-6**2 / (4 * 1.8e-5)).imag
    static = 0.1906 * 1.2 * 30e-6**2 * 200e-6 * lever.quality_factor * drag * omega**2
    assert static == pytest.approx(169e9 * 30e-6 * 2e-6**3 / (4 * 200e-6**3), rel=3e-4)


@pytest.mark.parametrize(("length", "width", "thickness"), [(120e-6, 30e-6, 0.5e-6), (38e-6, 16e-6, 0.2e-6)])
def test_soft_levers_in_water_have_the_modes_that_were_computed_before(
    length: float, width: float, thickness: float
) -> None:
    lever = pm.Cantilever.rectangular(length, width, thickness, **NITRIDE).in_liquid()
    first, second = lever.eigenmodes
    # Given with two digits, of a cylinder as wide; the ribbon of the same width has 2 to 8 % more drag.
    assert second.frequency_ratio == pytest.approx(7.3, abs=0.06)
    assert first.quality_factor == pytest.approx(2.1, rel=0.08) and second.quality_factor == pytest.approx(4.6, abs=0.1)
    assert second.stiffness_ratio == pytest.approx(39.2739, abs=1e-4)
    assert first.participation == 1.565984


def test_the_biolever_mini_in_water_is_that_of_its_maker() -> None:
    # Olympus states 25 kHz in water, of levers whose frequency in air is 75 to 150 kHz.
    lever = pm.Cantilever.preset("BL-AC40TS").in_liquid()
    assert lever.resonance_frequency == pytest.approx(25e3, rel=0.05)
    assert 1.5 < lever.quality_factor < 2.5


def test_a_lever_by_its_dimensions_and_by_its_resonance_in_air_is_the_same_one_in_a_liquid() -> None:
    made = pm.Cantilever.rectangular("120 um", "30 um", "500 nm", "250 GPa", "3100 kg/m^3", modes=3)
    given = pm.Cantilever(made.stiffness, made.resonance_frequency, 77, length="120 um", width="30 um")
    by_mass = made.in_liquid("1.1 g/cm^3", "2 mPa s", modes=3)
    for one, other in zip(by_mass.eigenmodes, given.in_liquid(1100, 2e-3, modes=3).eigenmodes, strict=True):
        assert one.frequency_ratio == pytest.approx(other.frequency_ratio, rel=1e-12)
        assert one.quality_factor == pytest.approx(other.quality_factor, rel=1e-12)
    assert len(made.modes) == 2  # type: ignore[arg-type]
    assert by_mass.resonance_frequency < given.in_liquid().resonance_frequency < made.resonance_frequency / 4


def test_quality_factors_of_a_number_of_modes_are_nearly_those_in_air() -> None:
    # In proportion to the root of the frequency, 2.50 and 4.19 times: the limit of a thin boundary layer. Where it is a
    # tenth of the width, as here, drag falls a little faster.
    for length, width, thickness in ((225e-6, 28e-6, 3e-6), (125e-6, 30e-6, 4e-6), (450e-6, 50e-6, 2e-6)):
        lever = pm.Cantilever.rectangular(length, width, thickness, **SILICON, modes=3)
        by_number = pm.Cantilever(lever.stiffness, lever.resonance_frequency, lever.quality_factor, modes=3)
        for mode, found in zip(by_number.eigenmodes, lever.eigenmodes, strict=True):
            assert mode.quality_factor == pytest.approx(found.quality_factor, rel=0.15)
            assert mode.frequency_ratio == pytest.approx(found.frequency_ratio, rel=0.01)


def test_a_mode_in_a_liquid_solves_its_own_equation() -> None:
    lever = pm.Cantilever.rectangular(225e-6, 28e-6, 3e-6, **SILICON)
    wet, (density, viscosity) = lever.in_liquid(modes=4), WATER
    mass = 2330 * 28e-6 * 3e-6
    for mode in wet.eigenmodes:
        omega = 2 * math.pi * wet.resonance_frequency * mode.frequency_ratio
        added = math.pi / 4 * density * 28e-6**2
        gamma = hydrodynamic_function(density * omega * 28e-6**2 / (4 * viscosity))
        moving = mass + added * gamma.real
        assert mode.stiffness_ratio is not None
        stiffness = lever.stiffness * mode.stiffness_ratio
        assert moving * 225e-6 / 4 * omega**2 == pytest.approx(stiffness, rel=1e-10)
        assert mode.quality_factor == pytest.approx(moving / (added * gamma.imag), rel=1e-10)


def test_a_liquid_that_moves_with_the_base_leaves_the_lever_its_own_mass_to_drive_it() -> None:
    lever = pm.Cantilever.rectangular(225e-6, 28e-6, 3e-6, **SILICON)
    still, moving = lever.in_liquid(), lever.in_liquid(liquid_pulls=False)
    assert moving.resonance_frequency == still.resonance_frequency
    for one, other in zip(moving.eigenmodes, still.eigenmodes, strict=True):
        stiffness, omega = lever.stiffness * (other.stiffness_ratio or 0), still.resonance_frequency * 2 * math.pi
        moved = 4 * stiffness / (225e-6 * (omega * other.frequency_ratio) ** 2)  # mass per length
        share = 2330 * 28e-6 * 3e-6 / moved
        assert one.participation == pytest.approx((other.participation or 0) * share, rel=1e-9)
    drive = pm.Drive(10e-9, excitation="base")
    bases = [pm.Microscope(one, pm.Tip(10e-9), drive).base_amplitude for one in (moving, still)]
    assert bases[0] > 4 * bases[1]


def test_every_rectangular_preset_oscillates_in_water() -> None:
    known = [pm.Cantilever.preset(name) for name in levers()]
    wet = [lever.in_liquid() for lever in known if lever.length is not None]
    assert len(wet) >= 20
    for lever in wet:
        assert 6.4 < lever.eigenmodes[1].frequency_ratio < 7.5 and 1.5 < lever.quality_factor < 10


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"density": "1 m"}, "density is '1 m'; allowed: a finite number above 0 kg/m3, or a density such as"),
        ({"viscosity": 0}, "viscosity is 0; allowed: a finite number above 0 Pa s."),
        ({"modes": 5}, "modes is 5; allowed: a whole number from 1 to 4."),
        ({"viscosity": "1 Pa s"}, "quality_factor is"),
        ({"viscosity": 1e9}, "Reynolds number of the lever is"),
    ],
)
def test_what_cannot_be_in_a_liquid_is_told(change: dict[str, object], sentence: str) -> None:
    with pytest.raises(pm.InputError) as error:
        pm.Cantilever.preset("BL-AC40TS").in_liquid(**change)  # type: ignore[arg-type]
    assert sentence in str(error.value)


def test_a_lever_of_unknown_size_is_asked_for_it() -> None:
    with pytest.raises(pm.InputError, match=r"length of the lever is None.*Cantilever\(..., length=...\) has it"):
        pm.Cantilever(0.1, 38e3, 50).in_liquid()
    light = pm.Cantilever(1e-3, 300e3, 50, length=100e-6, width=30e-6)
    with pytest.raises(pm.InputError, match="mass per length of the lever is -"):
        light.in_liquid()


def test_a_scene_puts_its_lever_into_a_liquid(tmp_path: Path) -> None:
    sample = Path("samples/step.toml")
    said = ["cantilever.preset=BL-AC40TS", "drive.excitation=base"]
    scene = pm.load_scene(sample, [*said, "cantilever.liquid={}"])
    assert scene.microscope.cantilever == pm.Cantilever.preset("BL-AC40TS").in_liquid()
    thick = pm.load_scene(sample, [*said, "cantilever.liquid.viscosity=1.5 mPa s", "cantilever.liquid.modes=3"])
    assert thick.microscope.cantilever == pm.Cantilever.preset("BL-AC40TS").in_liquid(viscosity=1.5e-3, modes=3)
    with pytest.raises(pm.InputError, match=r"\[cantilever.liquid\] viscosty is unknown; .*'viscosity'"):
        pm.load_scene(sample, [*said, "cantilever.liquid.viscosty=1"])
    with pytest.raises(pm.InputError, match=r"\[cantilever.liquid\] density is -1"):
        pm.load_scene(sample, [*said, "cantilever.liquid.density=-1"])
