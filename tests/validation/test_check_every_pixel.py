"""`phasemap check` solves every pixel again: what is wrong in one pixel out of thousands is found, and named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import xarray as xr

import phasemap as pm
from phasemap.validation.picture import FAILS, OPEN, Check

SCOPE = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(16e-9))
SETPOINT = 0.8
REPEATED = "solved again by the same solver: the same"
BY_ANOTHER = {"solved again: phase within estimated error", "solved again: height within estimated error"}
ROW, COLUMN = 5, 7


def random_map(size: int, modulus: tuple[float, float], adhesion: Any, damping: tuple[float, float]) -> pm.Surface:
    """A surface whose pixels are all different."""
    random = np.random.default_rng(3)
    moduli = np.exp(random.uniform(*np.log(modulus), (size, size)))
    attraction = random.uniform(*adhesion, (size, size)) if isinstance(adhesion, tuple) else adhesion
    return pm.Surface(moduli, attraction, random.uniform(*damping, (size, size)), pixel_size=1e-9)


def with_modulus(surface: pm.Surface, factor: float, row: int = ROW, column: int = COLUMN) -> pm.Surface:
    """The surface with the modulus of one pixel multiplied."""
    modulus = surface.modulus.copy()
    modulus[row, column] *= factor
    return pm.Surface(modulus, surface.adhesion, surface.damping, pixel_size=surface.pixel_size)


BISTABLE = random_map(96, (0.5e9, 5e9), (0.02, 0.1), (0.005, 0.02))


@pytest.fixture(scope="module")
def good() -> xr.Dataset:
    image = pm.simulate(BISTABLE, SCOPE, SETPOINT)
    assert 0.5 < (image.solver.values == 3).mean() < 1  # most pixels are interpolated, some are solved
    return image


def failed(found: Check) -> dict[str, tuple[tuple[int, int, int], ...]]:
    """Claims that fail, and the worst pixels of each."""
    return {claim.about: claim.worst for claim in found.claims if claim.result == FAILS}


def moved(image: xr.Dataset, other: xr.Dataset, y: int, x: int) -> None:
    """Give a pixel what another image has there."""
    for name in image.data_vars:
        image[name][y, x] = other[name].values[y, x]


def test_a_pixel_on_its_other_stable_orbit_is_found_and_judged_in_time(good: xr.Dataset) -> None:
    image = good.copy(deep=True)
    other = pm.simulate(BISTABLE, SCOPE, SETPOINT, control=pm.Raster()).sel(direction="trace")
    y, x = np.argwhere(other.branch.values != good.branch.values)[4]
    moved(image, other, y, x)
    found = pm.check(image, BISTABLE)
    at = ((0, y, x),)
    assert failed(found) == {REPEATED: at, "solved again: the same branch": at}
    assert found.judged.startswith(
        "Every pixel was solved again as it was made (9216 different materials): 1 differs. "
    )
    assert bool(((found.sample.row == y) & (found.sample.column == x)).any()) and found.sample.sizes["pixel"] == 65


@pytest.mark.slow
def test_a_pixel_computed_with_another_modulus_is_found_and_judged_in_time(good: xr.Dataset) -> None:
    """All that the pixel says fits together: it passes every invariant."""
    image = good.copy(deep=True)
    moved(image, pm.simulate(with_modulus(BISTABLE, 1.5), SCOPE, SETPOINT), ROW, COLUMN)
    found = failed(pm.check(image, BISTABLE))
    assert {REPEATED, *BY_ANOTHER} <= set(found) and set(found.values()) == {((0, ROW, COLUMN),)}


@pytest.mark.slow
def test_a_pixel_whose_modulus_is_changed_in_the_map_is_found_and_judged_in_time(good: xr.Dataset) -> None:
    found = failed(pm.check(good, with_modulus(BISTABLE, 1.5)))
    assert {REPEATED, *BY_ANOTHER} <= set(found) and set(found.values()) == {((0, ROW, COLUMN),)}


def test_an_indentation_that_is_off_by_a_thousandth_is_found(good: xr.Dataset) -> None:
    one = good.copy(deep=True)
    one["indentation"][ROW, COLUMN] *= 0.999
    assert failed(pm.check(one, BISTABLE)) == {REPEATED: ((0, ROW, COLUMN),)}


@pytest.mark.slow
def test_an_indentation_that_is_off_everywhere_is_found_and_counted(good: xr.Dataset) -> None:
    image = good.copy(deep=True)
    image["indentation"] *= 1.001
    (claim,) = [claim for claim in pm.check(image, BISTABLE).claims if claim.result == FAILS]
    assert claim.about == REPEATED and claim.found.startswith("indentation in 9216 pixels, at worst at row ")


def test_so_is_one_of_exact_orbits_of_few_materials() -> None:
    surface = random_map(8, (1e9, 3e9), 0.05, (0.005, 0.02))
    image = pm.simulate(surface, SCOPE, SETPOINT)
    image["indentation"][ROW, COLUMN] *= 1.001
    assert failed(pm.check(image, surface, pixels=4)) == {REPEATED: ((0, ROW, COLUMN),)}


@pytest.mark.slow
def test_what_was_asked_for_beside_the_usual_is_solved_again_too() -> None:
    surface = random_map(8, (1e9, 3e9), 0.05, (0.005, 0.02))
    names = ("phase", "contact_storage", "amplitude_3", "loss_tangent_corrected")
    good = pm.simulate(surface, SCOPE, SETPOINT, variables=names)
    assert pm.check(good, surface).holds
    for name in names:
        image = good.copy(deep=True)
        image[name][ROW, COLUMN] *= 1.001
        assert REPEATED in failed(pm.check(image, surface, pixels=4))


def test_every_pixel_of_an_image_by_time_is_marched_again_and_some_are_solved_by_orbits() -> None:
    surface = random_map(4, (1e9, 3e9), 0.05, (0.005, 0.02))
    image = pm.simulate(surface, SCOPE, SETPOINT, "march")
    found = pm.check(image, surface, pixels=2)
    assert found.holds and found.sample.sizes["pixel"] == 2
    assert found.judged == (
        "Every pixel was solved again as it was made (16 different materials): none differs. "
        "2 pixels, some of every kind and those that differ most, also by periodic orbits. "
        "An error of the solver itself would show only there."
    )
    wrong = failed(pm.check(image, with_modulus(surface, 1.5, 1, 2), pixels=2))
    assert {REPEATED, *BY_ANOTHER} <= set(wrong) and set(wrong.values()) == {((0, 1, 2),)}


def test_a_pixel_of_a_raster_is_found_on_its_other_orbit() -> None:
    surface = random_map(12, (0.5e9, 5e9), (0.02, 0.1), (0.005, 0.02))
    image = pm.simulate(surface, SCOPE, SETPOINT, control=pm.Raster())
    assert pm.check(image, surface, pixels=8).holds
    y, x = np.argwhere(np.diff(image.branch.values, axis=0)[0] != 0)[0]
    for name in image.data_vars:
        image[name][0, y, x] = image[name].values[1, y, x]
    assert failed(pm.check(image, surface, pixels=8))[REPEATED] == ((0, y, x),)


LEVER = pm.Cantilever(40.0, 300e3, 400.0)
TIP = pm.Tip(10e-9)
STIFF = ((1e9, 3e9), 0.05, (0.005, 0.02))

SCENES: dict[str, Callable[[], tuple[pm.Surface, pm.Microscope]]] = {
    "continuous": lambda: (random_map(128, *STIFF), pm.Microscope(LEVER, TIP, pm.Drive(20e-9))),
    "soft": lambda: (
        random_map(96, (1e6, 2e7), 0.03, (0.01, 0.2)),
        pm.Microscope(pm.Cantilever(2.0, 70e3, 150.0), TIP, pm.Drive(60e-9)),
    ),
    "liquid": lambda: (
        random_map(96, (1e7, 1e9), 0.001, (0.05, 0.3)),
        pm.Microscope(pm.Cantilever(0.3, 20e3, 3.0), TIP, pm.Drive(10e-9)),
    ),
    "off resonance": lambda: (random_map(96, *STIFF), pm.Microscope(LEVER, TIP, pm.Drive(20e-9, 299.6e3))),
    "base drive": lambda: (
        random_map(8, *STIFF),
        pm.Microscope(replace(LEVER, participation=1), TIP, pm.Drive(20e-9, excitation="base")),
    ),
    "second mode": lambda: (
        random_map(8, *STIFF),
        pm.Microscope(replace(LEVER, modes=2), TIP, pm.Drive(20e-9, second=pm.Mode(free_amplitude=0.2e-9))),
    ),
    "jkr": lambda: (
        random_map(4, (5e7, 1e9), 0.05, (0.005, 0.02)),
        pm.Microscope(LEVER, TIP, pm.Drive(40e-9), pm.Interaction("jkr")),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", SCENES)
def test_a_good_image_raises_no_alarm(name: str) -> None:
    surface, scope = SCENES[name]()
    found = pm.check(pm.simulate(surface, scope, 0.7), surface, pixels=8)
    assert found.holds and not [claim for claim in found.claims if claim.result == OPEN], str(found)


def test_nor_does_a_bistable_one(good: xr.Dataset) -> None:
    found = pm.check(good, BISTABLE)
    assert found.holds and all(claim.result != OPEN for claim in found.claims), str(found)
    assert "none differs" in found.judged and found.unseen.endswith("Their maps are those of the surface given.")
