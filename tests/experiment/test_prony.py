"""Spectra of relaxation: what they are made from, how they are kept, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

import phasemap as pm

RUBBER = pm.Prony([1e9, 0.5e9], [20e-9, 200e-9], 0.5e9)


def test_a_power_law_has_its_complex_modulus_over_the_band_within_the_stated_error() -> None:
    f, n = np.geomspace(1e3, 1e6, 77), 0.3
    exact = 1e6 * math.gamma(1 - n) * (2j * np.pi * f * 1e-3) ** n
    for error in (0.05, 0.01, 0.001):
        found = pm.Prony.power_law(1e6, 1e-3, n, (1e3, 1e6), error)
        off = np.abs(found.complex_modulus(f) / exact - 1).max()
        assert off <= 1.01 * error and found.residual == pytest.approx(off, rel=0.2)


def test_a_table_of_storage_and_loss_is_fitted_without_negative_moduli_and_its_residual_is_said() -> None:
    f = np.geomspace(1e2, 1e7, 60)
    wanted = 1e8 * (1 + (1j * f * 1e-5) ** 0.4)
    found = pm.Prony.from_table(f, wanted.real, wanted.imag)
    off = np.abs(found.complex_modulus(f) / wanted - 1).max()
    assert min(found.moduli) > 0
    assert found.residual == pytest.approx(off, rel=1e-9)
    assert off < 0.05


def test_shear_moduli_are_a_third_of_youngs() -> None:
    assert pm.Prony.from_shear([1e6], [1e-6], 1e5) == pm.Prony([3e6], [1e-6], 3e5)
    shear = {"shear_moduli": [1e6], "times": ["1 us"], "equilibrium": 1e5}
    assert pm.Material(relaxation=shear).relaxation == pm.Prony([3e6], [1e-6], 3e5)


def test_a_surface_of_spectra_survives_a_dataset() -> None:
    materials = [pm.Material(relaxation=RUBBER), pm.Material(1e9, relaxed_modulus=5e8, relaxation_time=1e-7)]
    surface = pm.Surface.from_labels([[0, 1, 0]], materials, pixel_size=1e-9)
    assert pm.Surface.from_dataset(surface.to_dataset()) == surface


def test_a_surface_of_spectra_may_have_pixels_without_a_material() -> None:
    first = RUBBER.instantaneous
    holed = pm.Surface([[np.nan, first]], relaxation=RUBBER, pixel_size=1e-9, allow_nan=True)
    assert np.isnan(holed.modulus[0, 0])
    with pytest.raises(pm.InputError, match=r"modulus is 3000000000.0; allowed: .* 2e\+09 Pa"):
        pm.Surface([[np.nan, first, 3e9]], relaxation=RUBBER, pixel_size=1e-9, allow_nan=True)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: pm.Prony([1e9], [1e-6]), "equilibrium is 0.0; allowed: a modulus above 0 Pa"),
        (lambda: pm.Prony([1e9], [1e-6, 1e-5], 1.0), "times is 2 numbers"),
        (lambda: pm.Prony([-1.0], [1e-6], 1.0), "moduli is -1.0"),
        (lambda: pm.Material(relaxation=RUBBER, damping=0.1), "damping is 0.1; allowed: none beside a relaxation"),
        (lambda: pm.Material(3e9, relaxation=RUBBER), "modulus is 3000000000.0"),
        (lambda: pm.Material(relaxation={"moduli": [1.0]}), "moduli or shear_moduli, and times"),
        (lambda: pm.Surface(1e9, relaxation=RUBBER, pixel_size=1e-9, shape=(1, 1)), "that of the spectrum"),
        (lambda: pm.Prony.power_law(1e6, 1e-3, 0.3, (1e6, 1e3)), "the lower one first"),
        (lambda: pm.Prony.from_table([1.0, 2.0], [1.0], [1.0]), "columns of one length"),
    ],
)
def test_what_makes_no_spectrum_is_refused_in_a_sentence(make: object, said: str) -> None:
    with pytest.raises(pm.InputError, match=said):
        make()  # type: ignore[operator]
