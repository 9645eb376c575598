import json
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from documented import check

import phasemap as pm
from phasemap.inference.determined import PRIOR
from phasemap.inference.images import regions, starts
from phasemap.inference.images.invert import FLAGS
from phasemap.inference.images.model import make_model

LEVER, TIP = pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9)
SCOPE = pm.Microscope(LEVER, TIP, pm.Drive(40e-9))
SETPOINTS = (0.5, 0.6, 0.7, 0.8)
NAMES = ("modulus", "adhesion", "damping")
PHASE_NOISE, HEIGHT_NOISE = 0.4, 0.05e-9  # of a real instrument [degree, m]
BITS = {name: 1 << i for i, name in enumerate(FLAGS)}


# In liquid, where a lever of one mode and of two is far from harmonic: on a shaker, and by a force on the tip.
WET = pm.Cantilever(0.5, 30e3, 3.0, participation=1), "base"
BEAM = pm.Cantilever(0.3, 30e3, 2.0, modes=2), "direct"


def in_liquid(lever, excitation):
    """Microscopes of four images, at two free amplitudes, and their setpoints."""
    drives = [pm.Drive(amplitude, excitation=excitation) for amplitude in (10e-9, 20e-9)]
    return [pm.Microscope(lever, TIP, drives[i]) for i in (0, 0, 1, 1)], (0.6, 0.8, 0.6, 0.8)


@pytest.fixture
def few_starts(monkeypatch):
    """Few materials to start from, which is harder, and cheaper."""
    monkeypatch.setattr(starts, "GRID", (3, 2, 3))


def blend(seed, shape=(16, 16)):
    """A soft blend whose properties vary by some tens of percent, on a rough ground."""
    rng = np.random.default_rng(seed)
    modulus, adhesion, damping = (
        middle * np.exp(width * rng.normal(size=shape)) for middle, width in ((0.2e9, 0.4), (0.05, 0.3), (0.02, 0.3))
    )
    topography = 5e-9 * rng.normal(size=shape)
    return pm.Surface(modulus, adhesion, damping, topography=topography, pixel_size=4e-9)


def measure(surface, seed=0, setpoints=SETPOINTS, scope=SCOPE, noise=1.0):
    """What an instrument would have measured."""
    rng = np.random.default_rng(seed)
    stack = []
    for setpoint in setpoints:
        image = pm.simulate(surface, scope, setpoint, solver="orbit", variables=["height", "phase"])
        phase = image.phase + noise * rng.normal(0, PHASE_NOISE, surface.shape)
        height = image.height + noise * rng.normal(0, HEIGHT_NOISE, surface.shape)
        stack.append(xr.Dataset({"phase": phase, "height": height}, attrs={"setpoint": setpoint}))
    return stack


def measure_nothing():
    """Four images of one pixel."""
    pixel = np.zeros((1, 1))
    return [xr.Dataset({"phase": (("y", "x"), pixel), "height": (("y", "x"), pixel)}) for _ in SETPOINTS]


def invert(stack, scope=SCOPE, **changed):
    """What the instrument's noise and zeros make of it."""
    known = {"phase_zero": 0.0, "phase_error": PHASE_NOISE, "height_error": HEIGHT_NOISE}
    return pm.invert(stack, scope, **(known | changed))


def is_set(found, name):
    assert not (found.flag.values & ~np.bitwise_or.reduce(found.flag.attrs["flag_masks"])).any()
    return found.flag.values & BITS[name] != 0


def deviations(found, surface, name):
    """Difference from the truth over the stated standard error, where the property is determined."""
    apart = np.log(found[name].values / getattr(surface, name)) / found[f"{name}_error"].values
    return apart[found.flag.values & (BITS[f"{name}_not_determined"] | BITS["poor_fit"] | BITS["no_orbit"]) == 0]


def test_maps_are_found_within_their_errors():
    inside, lost = {name: [] for name in NAMES}, []
    for seed in range(3):
        surface = blend(seed)
        stack = measure(surface, seed)
        found = invert(stack)
        lost.append(is_set(found, "no_orbit").mean())
        for name in NAMES:
            inside[name].append(abs(deviations(found, surface, name)) < 1.96)
    for name in NAMES:
        hits = np.concatenate(inside[name])
        assert len(hits) > 400, name
        # Nominal 0.95; the standard error of a share of 400 or more pixels is 0.011.
        assert 0.90 < hits.mean() < 0.985, (name, hits.mean(), len(hits))
    assert np.mean(lost) < 0.005, lost


def test_without_noise_the_exact_material_comes_back():
    # The search uses averaged orbits and their derivatives; what is found must be that of exact orbits.
    surface = blend(5, (2, 3))
    stack = measure(surface, noise=0.0)
    found = invert(stack, phase_error=1e-3, height_error=1e-13)
    check("Variables of an inversion", found)
    for name, apart in zip(NAMES, (0.003, 0.01, 0.003), strict=True):
        np.testing.assert_allclose(found[name], getattr(surface, name), rtol=apart)
    eta = 2 * SCOPE.cantilever.stiffness * found.damping / (2 * np.pi * SCOPE.cantilever.resonance_frequency)
    np.testing.assert_allclose(found.viscosity, eta / SCOPE.tip.radius)  # theory, Eq. (model-16)


def test_beside_the_resonance_the_branch_is_the_sign_of_the_push_and_not_of_the_phase():
    """At a setpoint of 0.6 phases from 0.6 of the sine of the free phase, 18 degrees, up are repulsive."""
    drive, settings = 300e3 * (1 - 0.325 / 800), ((40e-9, 0.6), (40e-9, 0.75), (80e-9, 0.6))
    scopes = [replace(SCOPE, drive=pm.Drive(amplitude, drive)) for amplitude, _ in settings]
    assert scopes[0].free_phase == pytest.approx(18.0, abs=0.1)
    materials = pm.Surface([[0.15e9, 0.3e9, 1e9]], [[0.04, 0.05, 0.02]], [[0.06, 0.08, 0.2]], pixel_size=4e-9)
    stack = [pm.simulate(materials, scope, setpoint) for scope, (_, setpoint) in zip(scopes, settings, strict=True)]
    assert 10.7 < float(stack[0].phase[0, 0]) < 18 and float(stack[0].branch[0, 0]) == 1
    found = pm.invert(stack, scopes, phase_error=0.05, height_error=0.02e-9)
    assert (found.flag == 0).all()
    for name in NAMES:
        np.testing.assert_allclose(found[name], getattr(materials, name), rtol=3e-3)


@pytest.mark.parametrize("lever", [pytest.param(WET, marks=pytest.mark.slow), BEAM], ids=["shaken", "two modes"])
def test_materials_come_back_from_images_in_liquid(lever, few_starts):
    scopes, setpoints = in_liquid(*lever)
    surface = pm.Surface([[1e7, 2e8, 1e9]], [[0.005, 0.01, 0.02]], [[0.03, 0.01, 0.02]], pixel_size=4e-9)
    stack = [pm.simulate(surface, *at, solver="orbit") for at in zip(scopes, setpoints, strict=True)]
    found = pm.invert(stack, scopes, phase_zero=0.0, phase_error=0.01, height_error=1e-12)
    assert (found.flag == 0).all()
    np.testing.assert_allclose(found.modulus, surface.modulus, rtol=1e-3)
    for name in NAMES:  # without noise; where the prior says more than data, by less than an error
        assert (abs(deviations(found, surface, name)) < 0.6).all(), name


def test_errors_cover_the_truth_in_liquid(few_starts):
    scopes, setpoints = in_liquid(*WET)
    rng, inside = np.random.default_rng(1), []
    surface = pm.Surface(
        *(np.exp(rng.uniform(*np.log(ends), (1, 16))) for ends in ((3e7, 1e9), (0.005, 0.02), (0.005, 0.05))),
        pixel_size=4e-9,
    )
    stack = []
    for at in zip(scopes, setpoints, strict=True):
        image = pm.simulate(surface, *at, solver="orbit")
        noisy = {name: image[name] + rng.normal(0, error, (1, 16))
                 for name, error in (("phase", PHASE_NOISE), ("height", HEIGHT_NOISE))}  # fmt: skip
        stack.append(xr.Dataset(noisy, attrs={"setpoint": at[1]}))
    found = invert(stack, scopes)
    assert not (is_set(found, "poor_fit") | is_set(found, "no_orbit") | is_set(found, "modulus_not_determined")).any()
    for name in NAMES:
        inside.append(abs(deviations(found, surface, name)) < 1.96)
    inside = np.concatenate(inside)
    # Of 20 numbers that are within 1.96 errors with a chance of 0.95, 17 or more are so with a chance of 0.98.
    assert len(inside) >= 20 and inside.mean() >= 0.85


def test_regions_in_liquid_are_found_without_a_zero(few_starts, monkeypatch):
    monkeypatch.setattr(regions, "DRAWS", 10)
    scopes, setpoints = in_liquid(*WET)
    labels, gel, glass = [[0, 1]], pm.Material(5e7, 0.01, 0.02), pm.Material(5e8, 0.02, 0.01)
    surface = pm.Surface.from_labels(labels, {0: gel, 1: glass}, pixel_size=4e-9)
    stack = [pm.simulate(surface, *at, solver="orbit") for at in zip(scopes, setpoints, strict=True)]
    found = pm.fit_regions([one.assign(phase=one.phase + 40.0) for one in stack], labels, scopes, phase_zero="shared")
    assert not (found.flag & (BITS["poor_fit"] | BITS["modulus_not_determined"])).any()
    assert (abs(np.log(found.modulus / [5e7, 5e8])) < found.modulus_error).all()
    assert abs(found.phase_zero - 40.0).max() < 3 * found.phase_zero_error.max() and (found.branch == 1).all()


class Softening(pm.ContactLaw):
    """A law that is not affine in the stiffness."""

    @staticmethod
    def force(d, p):
        return p[0] * d * np.sqrt(p[2] * d) / (1.0 + p[0] / 1e9)


def test_derivatives_of_averaged_orbits_are_those_of_differences():
    q = np.random.default_rng(1).normal(0.0, (1.5, 0.5, 1.0), (40, 3))  # logarithms
    for contact, decay_length in (("dmt", 0.3e-9), ("hertz", None), (Softening(), None)):
        scope = pm.Microscope(LEVER, TIP, pm.Drive(40e-9), pm.Interaction(contact, decay_length))
        model = make_model((scope,) * len(SETPOINTS), SETPOINTS, PRIOR, 10.0)
        sides, places = np.ones((len(q), 4), np.int8), np.full((len(q), 4), np.nan)
        found = model.orbits(q, sides, places, search=True)
        assert found.good.sum() > 20
        for k, step in enumerate(1e-4 * np.eye(3)):
            ahead, behind = (model.orbits(q + sign * step, sides, places.copy()) for sign in (1, -1))
            good = found.good & ahead.good & behind.good
            slopes, central = found.slopes[good][..., k], (ahead.values - behind.values)[good] / 2e-4
            # One-sided differences by the place of contact, over 1e-4 of their scale, leave 5e-4.
            assert (np.abs(slopes - central) < 1e-3 * np.abs(central).max(axis=0) + 1e-15).all(), (contact, k)


@pytest.mark.parametrize("lever", [WET, BEAM], ids=["shaken", "two modes"])
def test_derivatives_of_exact_orbits_are_those_of_differences(lever):
    model = make_model(*in_liquid(*lever), PRIOR, 10.0)
    q = np.random.default_rng(1).normal((-2.0, -1.5, 0.0), 0.5, (4, 3))
    sides, places = np.ones((len(q), 4), np.int8), model.nowhere(len(q), 4)
    found = model.orbits(q, sides, places, search=True)
    assert not model.averages and found.good.all()
    for k, step in enumerate(1e-4 * np.eye(3)):
        ahead, behind = (model.orbits(q + sign * step, sides, places.copy()) for sign in (1, -1))
        central = (ahead.values - behind.values) / 2e-4
        # Elements are laid for the orbit and not for its derivative: that leaves 2e-4 of the phase's.
        assert (abs(found.slopes[..., k] - central) < 5e-4 * abs(central).max(axis=(0, 1))).all()


def test_uncertain_zeros_make_errors_larger():
    stack = measure(blend(7, (4, 4)), 7)
    sure, unsure = invert(stack), invert(stack, phase_zero_error=2.0, height_zero_error=0.3e-9)
    for name in NAMES:
        assert float(unsure[f"{name}_error"].median()) > 1.5 * float(sure[f"{name}_error"].median())


def test_a_zero_of_all_heights_does_not_count():
    surface = blend(8, (2, 2))
    one, two = (invert(measure(surface, 8), height_zero=zero) for zero in (0.0, 50e-9))
    np.testing.assert_allclose(one.modulus, two.modulus, rtol=1e-6)


def test_a_recorded_phase_zero_is_taken_off():
    surface = blend(8, (2, 2))
    plain = measure(surface, 8)
    moved = [one.assign(phase=one.phase + 30.0).assign_attrs(phase_zero=30.0) for one in plain]
    one = invert(plain)
    two = invert(moved, phase_zero=None)
    np.testing.assert_allclose(one.modulus, two.modulus, rtol=1e-6)


def test_undamped_phase_carries_no_modulus():
    # The phase is arccos(setpoint), whatever the material; without heights nothing tells the modulus.
    surface = pm.Surface(modulus=[[0.3e9, 3e9, 1e10]], adhesion=0.05, damping=0.0, pixel_size=4e-9)
    stack = [one.drop_vars("height") for one in measure(surface)]
    found = invert(stack)
    assert is_set(found, "modulus_not_determined").all() and is_set(found, "damping_not_determined").all()


def test_attractive_images_carry_no_modulus():
    scope = pm.Microscope(LEVER, TIP, pm.Drive(8e-9))
    surface = pm.Surface(modulus=[[0.5e9, 2e9, 5e9]], adhesion=0.1, damping=0.01, pixel_size=4e-9)
    stack = measure(surface, setpoints=(0.8, 0.85, 0.9, 0.93), scope=scope)
    assert all((one.phase < 0).all() for one in stack)
    found = invert(stack, scope)
    assert is_set(found, "modulus_not_determined").all()


def test_a_tip_that_touches_little_is_not_taken_for_one_that_never_does():
    # Of low Q and attracted in all images. Ten times the adhesion without a touch is a minimum of chi2 too.
    lever, setpoints = pm.Cantilever(10.0, 100e3, 40.0), (0.7, 0.85, 0.7, 0.85)
    scopes = [pm.Microscope(lever, TIP, pm.Drive(amplitude)) for amplitude in (4e-9, 4e-9, 8e-9, 8e-9)]
    surface = pm.Surface([[0.1e9, 0.08e9, 0.17e9]], [[0.068, 0.065, 0.06]], [[0.02, 0.01, 0.04]], pixel_size=4e-9)
    stack = [pm.simulate(surface, *at, solver="orbit") for at in zip(scopes, setpoints, strict=True)]
    assert all((one.phase < 0).all() for one in stack)
    found = invert(stack, scopes, phase_error=0.1, height_error=20e-12)
    assert not (is_set(found, "poor_fit") | is_set(found, "adhesion_not_determined")).any()
    assert (abs(deviations(found, surface, "adhesion")) < 1).all()
    assert (is_set(found, "ambiguous") == is_set(found, "modulus_not_determined")).all()


def test_one_image_determines_nothing():
    surface = blend(2, (3, 3))
    found = invert(measure(surface, setpoints=(0.6,)))
    for name in NAMES:
        assert is_set(found, f"{name}_not_determined").all()
    assert "add images of the same place at other setpoints" in found.attrs["advice"]


def test_data_that_no_material_explains_are_flagged():
    stack = measure(blend(3, (2, 3)), 3)
    before = is_set(invert(stack), "poor_fit") | is_set(invert(stack), "no_orbit")
    stack[1]["phase"][0, 1] += 25.0
    found = invert(stack)
    after = is_set(found, "poor_fit") | is_set(found, "no_orbit")
    assert np.argwhere(after != before).tolist() == [[0, 1]]


def test_missing_data_are_said_to_be_missing():
    stack = measure(blend(4, (2, 3)), 4)
    for one in stack:
        one["phase"][0, 1] = one["height"][0, 1] = np.nan
    stack[0]["phase"][1, 1] = np.nan
    found = invert(stack)
    assert np.argwhere(is_set(found, "no_data")).tolist() == [[0, 1]]
    assert np.isnan(found.modulus[0, 1]) and np.isfinite(found.modulus[1, 1])


def test_regions_are_fitted_as_a_whole():
    labels = np.repeat([[0, 1]], 400, axis=0)
    soft, hard = pm.Material(0.15e9, 0.05, 0.02), pm.Material(0.6e9, 0.07, 0.01)
    surface = pm.Surface.from_labels(labels, {0: soft, 1: hard}, pixel_size=4e-9)
    labels[0] = -1
    found = pm.fit_regions(measure(surface, 1), labels, SCOPE, phase_zero=0.0, phase_error=0.05, height_error=0.02e-9)
    assert found.region.values.tolist() == [0, 1] and found.pixels.values.tolist() == [399, 399]
    for i, material in enumerate((soft, hard)):
        for name in NAMES:
            apart = np.log(float(found[name][i]) / getattr(material, name))
            assert abs(apart) < 3 * float(found[f"{name}_error"][i]), (i, name)
    np.testing.assert_allclose(found.measured_phase, found.fitted_phase, atol=0.3)


def test_numbers_do_not_depend_on_threads_and_survive_a_file(tmp_path):
    stack = measure(blend(6, (4, 160)), 6)
    one, two = (invert(stack, threads=threads) for threads in (1, 2))
    np.testing.assert_array_equal(one.modulus, two.modulus)
    one.to_netcdf(tmp_path / "found.nc")
    with xr.open_dataset(tmp_path / "found.nc") as again:
        xr.testing.assert_identical(again.load(), one)
    assert json.loads(one.attrs["configuration"])["setpoints"] == list(SETPOINTS)


def test_wrong_input_is_named():
    stack = measure(blend(0, (1, 2)))
    jkr = pm.Microscope(LEVER, TIP, pm.Drive(40e-9), pm.Interaction(contact="jkr", decay_length=None))
    lossy = pm.Microscope(LEVER, TIP, pm.Drive(40e-9), pm.Interaction(pm.interaction.LossyDMT(3.0, 3e-7, 1e-9)))
    for arguments, message in (
        ({"images": [one.drop_vars("phase") for one in stack]}, "image 0"),
        ({"images": [xr.Dataset({"phase": one.phase}) for one in stack]}, "setpoints is None"),
        ({"setpoints": (0.5, 0.6)}, "4 numbers"),
        ({"phase_error": 0.0}, "phase_error"),
        ({"phase_zero": "free"}, "phase_zero"),
        ({"height_zero": "free"}, "height_zero"),
        ({"phase_zero": None}, "phase_zero"),
        ({"scope": jkr}, "without a neck"),
        ({"scope": lossy}, "losses of its own"),
        ({"scope": [SCOPE]}, "4 of them"),
        ({"prior": pm.Material(1e9)}, "adhesion of the prior"),
        ({"prior_factor": 1.0}, "prior_factor"),
    ):
        with pytest.raises(pm.InputError, match=message):
            pm.invert(**({"images": stack, "scope": SCOPE, "phase_zero": 0.0} | arguments))


def test_picture_hatches_what_is_not_determined(tmp_path):
    found = invert(measure(blend(9, (8, 8)), 9))
    found.flag[:4] |= BITS["modulus_not_determined"]
    figure = pm.plot.inversion(found, tmp_path / "found.png")
    hatched = [bool(axes.collections) for axes in figure.axes if axes.images and axes.get_title(loc="left")]
    assert hatched[0] and (tmp_path / "found.png").stat().st_size > 1e4
    with pytest.raises(pm.InputError, match=r"phasemap\.invert"):
        pm.plot.inversion(found.drop_vars("flag"))


def test_passes_find_exact_orbits_under_a_double_layer_too():
    scope = pm.Microscope(LEVER, TIP, pm.Drive(20e-9), pm.Interaction("dmt", longrange=pm.interaction.DLVO()))
    model, sides = make_model([scope], [0.7], PRIOR, 10.0), np.ones((3, 1), np.int8)
    q, places = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.0, 0.0, 0.5]]), np.full((3, 1), np.nan)
    assert model.orbits(q, sides, places, search=True).good.all()
    values, good = model.exact(q, sides, places, engage=False)
    assert good.all()
    materials = [pm.Material(*one, poisson_ratio=PRIOR.poisson_ratio) for one in model.materials(q)]
    phases = [pm.solve_pixel(one, scope, 0.7, "orbit").phase for one in materials]
    assert np.degrees(values[:, 0, 0]) == pytest.approx(phases, abs=1e-3)
