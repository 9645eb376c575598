import numpy as np
import pytest

import phasemap as pm

LEVER, TIP = pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9)
SCOPE = pm.Microscope(LEVER, TIP, pm.Drive(40e-9))
NAMES = ("modulus", "adhesion", "damping")


def surface(**changed):
    maps = {"modulus": [[0.3e9, 2e9]], "adhesion": [[0.05, 0.08]], "damping": [[0.02, 0.01]]} | changed
    return pm.Surface(**{name: np.array(values) for name, values in maps.items()}, pixel_size=4e-9)


def by_difference(given, scope, setpoint, name, step=2e-3):
    """Central difference of whole images by the exact solver."""
    ends = []
    for sign in (1, -1):
        maps = {one: getattr(given, one) for one in NAMES}
        maps[name] = maps[name] * np.exp(sign * step)
        ends.append(pm.simulate(pm.Surface(**maps, pixel_size=4e-9), scope, setpoint, solver="orbit"))
    return {quantity: (ends[0][quantity] - ends[1][quantity]).values / (2 * step) for quantity in ("phase", "height")}


@pytest.mark.parametrize("name", NAMES)
def test_sensitivities_are_differences_of_exact_images(name):
    given = surface()
    found = pm.sensitivity(given, SCOPE, 0.7)
    expected = by_difference(given, SCOPE, 0.7, name)
    # Both are central differences; the larger step, 3e-3, leaves about its square over 6, times third derivatives of
    # the order of the first: 1e-5 of them. The solver's own errors add 1e-6 degree over the step.
    np.testing.assert_allclose(found[f"phase_by_{name}"], expected["phase"], rtol=1e-4, atol=2e-3)
    np.testing.assert_allclose(found[f"height_by_{name}"], expected["height"], rtol=1e-4, atol=2e-13)


def test_attractive_orbits_hardly_know_the_modulus():
    scope = pm.Microscope(LEVER, TIP, pm.Drive(8e-9))
    found = pm.sensitivity(surface(adhesion=[[0.1, 0.1]]), scope, 0.8)
    assert (found.branch == 0).all()
    assert (abs(found.phase_by_modulus) < 0.1 * abs(found.phase_by_adhesion)).all()


def test_undamped_phase_does_not_depend_on_the_material():
    found = pm.sensitivity(surface(damping=[[0.0, 0.0]]), SCOPE, 0.7)
    for name in NAMES:
        # errors of the orbits, 1e-7 rad, over two steps of 3e-3, in degrees
        assert (abs(found[f"phase_by_{name}"]) < 1e-3).all()
    assert (found.phase_by_damping == 0).all() and (abs(found.height_by_modulus) > 1e-11).all()


def test_topography_is_in_the_height_only():
    flat = pm.sensitivity(surface(), SCOPE, 0.7)
    hill = pm.Surface(
        modulus=[[0.3e9, 2e9]], adhesion=[[0.05, 0.08]], damping=[[0.02, 0.01]], topography=[[0.0, 3e-9]],
        pixel_size=4e-9,
    )  # fmt: skip
    found = pm.sensitivity(hill, SCOPE, 0.7)
    np.testing.assert_allclose(found.height - flat.height, [[0.0, 3e-9]], atol=1e-20)
    np.testing.assert_array_equal(found.height_by_modulus, flat.height_by_modulus)


def test_a_pixel_without_material_is_said_to_be_so():
    given = pm.Surface(modulus=[[np.nan, 1e9]], adhesion=0.05, damping=0.01, pixel_size=4e-9, allow_nan=True)
    found = pm.sensitivity(given, SCOPE, 0.7)
    assert found.status.values.tolist() == [[pm.Status.invalid.code, 0]]
    assert np.isnan(found.phase_by_modulus.values).tolist() == [[True, False]]


def test_numbers_do_not_depend_on_threads():
    rng = np.random.default_rng(0)
    given = surface(modulus=np.exp(rng.normal(21, 0.3, (6, 60))), adhesion=0.05, damping=0.01)
    one, two = (pm.sensitivity(given, SCOPE, 0.7, threads=threads) for threads in (1, 2))
    np.testing.assert_array_equal(one.phase_by_modulus, two.phase_by_modulus)


def test_wrong_input_is_named():
    with pytest.raises(pm.InputError, match="surface is of type ndarray"):
        pm.sensitivity(np.ones((2, 2)), SCOPE, 0.7)
