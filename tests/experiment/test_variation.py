"""Materials that vary within their domains: by how much, over which length, and reproducibly."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import phasemap as pm

SOFT = pm.Material(0.2e9, adhesion=0.06, damping=0.03, poisson_ratio=0.45)
HARD = pm.Material(3e9, adhesion=0.07, damping=0.004)
LABELS = np.repeat([[0, 1]], 256, axis=0).repeat(128, axis=1)  # two halves of 256 x 128 pixels


def surface(variation: pm.Variation | None, labels: Any = LABELS) -> pm.Surface:
    return pm.Surface.from_labels(labels, [SOFT, HARD], pixel_size=4e-9, variation=variation)


def test_each_material_has_the_spread_that_is_asked_for_around_its_own_values() -> None:
    variation = pm.Variation(modulus=0.2, adhesion=0.1, loss=0.3, correlation_length=12e-9, seed=4)
    found = surface(variation)
    for name, size in (("modulus", 0.2), ("adhesion", 0.1), ("damping", 0.3)):
        for label, material in enumerate((SOFT, HARD)):
            logs = np.log(getattr(found, name)[LABELS == label] / getattr(material, name))
            # A half has some 85 x 43 independent patches, so that a standard deviation is good to 1.2 %, and 4 sigma
            # of it 5 %; a mean to 4 / sqrt(3600) of the spread. What the whole image has is met exactly.
            assert logs.std() == pytest.approx(size, rel=0.05) and abs(logs.mean()) < 0.07 * size
    assert len(np.unique(found.poisson_ratio)) == 2


def test_properties_vary_over_the_correlation_length_and_independently_of_each_other() -> None:
    found = surface(pm.Variation(0.2, 0.1, 0.3, correlation_length=40e-9, seed=4), np.zeros((256, 256), int))
    modulus, adhesion, damping = (np.log(getattr(found, name)) for name in ("modulus", "adhesion", "damping"))
    along = [np.corrcoef(modulus[:, :-n].ravel(), modulus[:, n:].ravel())[0, 1] for n in (2, 60)]
    assert along[0] > 0.8 and abs(along[1]) < 0.2
    # 256 / 10 pixels of the correlation length squared are 650 independent patches: 4 / sqrt(650).
    assert abs(np.corrcoef(modulus.ravel(), adhesion.ravel())[0, 1]) < 0.16
    assert abs(np.corrcoef(modulus.ravel(), damping.ravel())[0, 1]) < 0.16


def test_the_same_seed_gives_the_same_surface_and_another_one_another() -> None:
    assert surface(pm.Variation(seed=1)) == surface(pm.Variation(seed=1)) != surface(pm.Variation(seed=2))
    assert surface(pm.Variation(0, 0, 0)) == surface(None)


def test_a_relaxed_modulus_varies_with_the_instantaneous_one() -> None:
    relaxing = pm.Material(1e9, relaxed_modulus=0.9e9, relaxation_time=1e-6)
    found = pm.Surface.from_labels(np.zeros((32, 32), int), [relaxing], pixel_size=4e-9, variation=pm.Variation(0.5))
    assert found.relaxed_modulus is not None
    np.testing.assert_allclose(found.relaxed_modulus / found.modulus, 0.9)


def test_an_image_of_materials_that_vary_is_solved_and_varies_within_its_domains() -> None:
    scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(40e-9))
    labels = LABELS[:24, 116:140]
    image = pm.simulate(surface(pm.Variation(0.2, 0.1, 0.2, correlation_length=10e-9), labels), scope, 0.7)
    flat = pm.simulate(surface(None, labels), scope, 0.7)
    assert (image.status == 0).all()
    for label in (0, 1):
        there = labels == label
        assert image.phase.values[there].std() > 0.05 > flat.phase.values[there].std()
        assert image.phase.values[there].mean() == pytest.approx(float(flat.phase.values[there][0]), abs=3)


def test_a_spectrum_has_a_modulus_that_does_not_vary() -> None:
    slow = pm.Material(adhesion=0.02, relaxation=pm.Prony([0.5e9], [1e-6], 0.3e9))
    with pytest.raises(
        pm.InputError, match=r"variation of the modulus is 0\.15; allowed: 0 where materials have spectra"
    ):
        pm.Surface.from_labels(np.zeros((64, 64), int), {0: slow}, pixel_size=2e-9, variation=pm.Variation())
    still = pm.Variation(modulus=0, loss=0)
    varied = pm.Surface.from_labels(np.zeros((64, 64), int), {0: slow}, pixel_size=2e-9, variation=still)
    assert np.ptp(varied.adhesion) > 0


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"modulus": -0.1}, "variation of the modulus is -0.1; allowed: a finite number of at least 0 and at most 2"),
        ({"loss": 3}, "variation of the loss is 3"),
        ({"correlation_length": 0}, "correlation_length is 0"),
        ({"seed": -1}, "seed is -1"),
    ],
)
def test_what_is_no_spread_is_refused(arguments: dict[str, Any], said: str) -> None:
    with pytest.raises(pm.InputError) as refused:
        pm.Variation(**arguments)
    assert said in str(refused.value)


def test_a_spread_that_the_surface_cannot_have_is_refused() -> None:
    with pytest.raises(
        pm.InputError, match=r"correlation_length is 1e-05; allowed: a finite number of at most 1\.024e-06 m"
    ):
        surface(pm.Variation(correlation_length=10e-6))
    with pytest.raises(pm.InputError, match=r"variation is 0\.1; allowed: a Variation or None"):
        surface(0.1)  # type: ignore[arg-type]
    array = pytest.importorskip("dask.array")
    with pytest.raises(pm.InputError, match="None for labels in Dask arrays"):
        surface(pm.Variation(), array.from_array(LABELS, chunks=64))
