"""Regions fitted from contrast: zeros are unknown, and errors have to cover what they leave open."""

import numpy as np
import pytest
import xarray as xr
from documented import check

import phasemap as pm
from phasemap.inference.images import regions as region_fit
from phasemap.inference.images.stack import Zeros
from phasemap.plot import plot

LEVER, TIP = pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9)
SOFT, FIRM = pm.Material(0.15e9, 0.05, 0.02), pm.Material(0.6e9, 0.07, 0.01)
STIFF = pm.Material(30e9, 0.05, 0.002)
TWO_AMPLITUDES = ((40e-9, 0.5), (40e-9, 0.8), (80e-9, 0.65))  # free amplitude [m], setpoint
ONE_AMPLITUDE = ((40e-9, 0.5), (40e-9, 0.6), (40e-9, 0.7), (40e-9, 0.8))
PIXELS = 400  # of a region
PHASE_NOISE, HEIGHT_NOISE = 0.4, 0.05e-9  # of a pixel [degree, m]
PHASE_FLOOR, HEIGHT_FLOOR = 0.05, 0.03e-9  # of a region, what the model leaves out
PHASE_ZERO = 37.0
NAMES = ("modulus", "adhesion", "damping")


def scopes_of(settings):
    return [pm.Microscope(LEVER, TIP, pm.Drive(amplitude)) for amplitude, _ in settings]


def exact(materials, settings):
    """Phase [degree] and height [m] of each region in each image, by the solver for single pixels."""
    pixels = [
        [
            pm.solve_pixel(one, scope, setpoint)
            for scope, (_, setpoint) in zip(scopes_of(settings), settings, strict=True)
        ]
        for one in materials
    ]
    return np.array([[(one.phase, one.height) for one in row] for row in pixels])


def measure(values, settings, seed=0, zero=PHASE_ZERO, noise=1.0, flat=False):
    """Images of regions side by side, with noise, a floor, and zeros that nobody knows."""
    rng = np.random.default_rng(seed)
    regions = len(values)
    topography = np.zeros(regions) if flat else rng.normal(0, 5e-9, regions)
    zeros = np.broadcast_to(zero, (len(settings),))
    images = []
    for j, (_, setpoint) in enumerate(settings):
        phase = values[:, j, 0] + zeros[j] + noise * rng.normal(0, PHASE_FLOOR, regions)
        height = values[:, j, 1] + topography + rng.normal(0, 3e-9) + noise * rng.normal(0, HEIGHT_FLOOR, regions)
        shape = (regions, PIXELS)
        phase = phase[:, None] + noise * rng.normal(0, PHASE_NOISE, shape)
        height = height[:, None] + noise * rng.normal(0, HEIGHT_NOISE, shape)
        recorded = {"phase": (("y", "x"), (phase + 180) % 360 - 180), "height": (("y", "x"), height)}
        images.append(xr.Dataset(recorded, attrs={"setpoint": setpoint}))
    return images


def labels_of(count):
    return np.repeat(np.arange(count)[:, None], PIXELS, axis=1)


def fit(images, settings, **changed):
    regions = images[0].sizes["y"]
    floors = {"phase_error": PHASE_FLOOR, "height_error": HEIGHT_FLOOR}
    return pm.fit_regions(images, labels_of(regions), scopes_of(settings), **(floors | changed))


def deviations(found, materials):
    """Differences from the truth over stated errors, shape (regions, 3)."""
    true = np.array([[getattr(one, name) for name in NAMES] for one in materials])
    values = np.array([found[name].values for name in NAMES]).T
    errors = np.array([found[f"{name}_error"].values for name in NAMES]).T
    return np.log(values / true) / errors


def words(found):
    meanings = found.determination.attrs["flag_meanings"].split()
    return [[meanings[code] for code in row] for row in found.determination.values]


@pytest.fixture(scope="module", autouse=True)
def grids():
    """The materials among which the search starts are the same for all fits of the same settings."""
    known, make = {}, region_fit.make_grid

    def make_once(model):
        key = (model.scope, model.amplitudes.tobytes(), model.levers.tobytes())
        if key not in known:
            known[key] = make(model)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(region_fit, "make_grid", make_once)
        yield


@pytest.fixture(scope="module")
def doubtful():
    """What contrast at one free amplitude tells."""
    return fit(measure(exact([SOFT, FIRM], ONE_AMPLITUDE), ONE_AMPLITUDE, 2), ONE_AMPLITUDE)


def test_the_page_on_files_lists_the_variables_of_a_fit_by_regions(doubtful):
    check("Variables of a fit by regions", doubtful, absent=("y", "x"))


@pytest.mark.slow
def test_errors_cover_the_truth_whatever_the_zeros():
    values = exact([SOFT, FIRM], TWO_AMPLITUDES)
    apart, zeros = [], []
    for seed in range(20):
        found = fit(measure(values, TWO_AMPLITUDES, seed), TWO_AMPLITUDES)
        assert words(found) == [["determined"] * 3] * 2
        apart.append(deviations(found, [SOFT, FIRM]).ravel())
        zeros.append(float(found.phase_zero[0] - PHASE_ZERO) / float(found.phase_zero_error[0]))
    apart = np.array(apart)
    # Of 20 intervals of 95 %, 16 or more hold the truth with a chance of 0.997; errors twice as large as need be would
    # make the root mean square 0.5, and that of 20 independent numbers varies by 0.16.
    assert ((abs(apart) < 1.96).sum(axis=0) >= 16).all()
    assert (abs(apart) < 1.96).mean() > 0.88
    size = np.sqrt((apart**2).mean(axis=0))
    assert (size > 0.6).all() and (size < 1.5).all()
    assert np.mean(np.abs(zeros) < 1.96) >= 0.8


def test_errors_are_those_of_least_squares_with_zeros_as_parameters():
    # By differences of exact orbits, with every zero and every level as a column of its own; where data are as good as
    # these the problem is linear, and 100 draws know an error within 7 %.
    regions = [SOFT, FIRM]
    found = fit(measure(exact(regions, TWO_AMPLITUDES), TWO_AMPLITUDES, noise=0.0), TWO_AMPLITUDES,
                phase_error=0.005, height_error=3e-12)  # fmt: skip
    scale, step = np.array([1 / 0.005, 1 / 3e-12]), 1e-3
    count = len(TWO_AMPLITUDES)
    columns = []
    for region, material in enumerate(regions):
        for name in NAMES:
            ends = []
            for sign in (1, -1):
                changed = {one: getattr(material, one) for one in NAMES}
                changed[name] *= np.exp(sign * step)
                ends.append(exact([pm.Material(**changed)], TWO_AMPLITUDES)[0])
            column = np.zeros((2, count, 2))
            column[region] = (ends[0] - ends[1]) / (2 * step)
            columns.append(column * scale)
    for part in ((slice(None), slice(None), 0), *((slice(None), j, 1) for j in range(count)), (0, slice(None), 1)):
        column = np.zeros((2, count, 2))
        column[part] = 1.0
        columns.append(column * scale)
    design = np.array([column.ravel() for column in columns]).T
    size = np.linalg.norm(design, axis=0)
    errors = np.sqrt(np.diag(np.linalg.inv((design / size).T @ (design / size)))) / size
    stated = np.array([[float(found[f"{name}_error"][r]) for name in NAMES] for r in (0, 1)]).ravel()
    np.testing.assert_allclose(stated, errors[:6], rtol=0.25)


def test_projection_is_least_squares_over_the_zeros():
    rng = np.random.default_rng(3)
    zeros = Zeros(rng.normal(size=(2, 3, 2, 4)), np.array([np.inf, 0.5, 2.0, np.inf]))
    weights, data = rng.uniform(1, 3, (2, 3, 2)), rng.normal(size=12)
    projection = zeros.weighted(weights)
    rows = np.concatenate([(zeros.columns * weights[..., None]).reshape(12, 4), np.diag([0, 2.0, 0.5, 0])])
    best, *_ = np.linalg.lstsq(rows, np.pad(data, (0, 4)), rcond=None)
    left = projection.without(np.pad(data, (0, 4))[:, None])[:, 0]
    np.testing.assert_allclose(left, np.pad(data, (0, 4)) - rows @ best, atol=1e-12)
    np.testing.assert_allclose(projection.inverse @ np.pad(data, (0, 4)), best, atol=1e-12)


def test_a_known_region_makes_up_for_a_zero_in_each_image():
    images = measure(exact([FIRM, SOFT], ONE_AMPLITUDE), ONE_AMPLITUDE, 1, zero=(37.0, 20.0, -5.0, 60.0))
    found = fit(images, ONE_AMPLITUDE, phase_zero="free", known={0: FIRM})
    assert words(found) == [["given"] * 3, ["determined"] * 3]
    assert (abs(deviations(found.isel(region=[1]), [SOFT])) < 3).all()
    assert found.modulus[0] == FIRM.modulus and found.modulus_error[0] == 0
    apart = (found.phase_zero - [37.0, 20.0, -5.0, 60.0]) / found.phase_zero_error
    assert (abs(apart) < 3).all() and (found.phase_zero_error < 0.2).all()


def test_what_contrast_cannot_tell_is_said_with_what_would_help(doubtful):
    found = doubtful
    assert words(found)[0] == ["determined"] * 3
    assert words(found)[1][0] == words(found)[1][2] == "combination_only"
    assert (abs(deviations(found, [SOFT, FIRM])) < 3).all()
    assert "modulus only together with damping" in found.attrs["verdict"]
    assert "another free amplitude" in found.attrs["advice"]


def test_a_stiff_region_is_not_identifiable():
    found = fit(measure(exact([SOFT, STIFF], TWO_AMPLITUDES), TWO_AMPLITUDES, 3), TWO_AMPLITUDES)
    assert "not_identifiable" in words(found)[1]
    assert found.flag.values[1] & 7 and not found.flag.values[0] & 7


def test_a_flat_surface_tells_more_than_one_of_unknown_relief():
    images = measure(exact([SOFT, FIRM], ONE_AMPLITUDE), ONE_AMPLITUDE, 4, flat=True)
    rough, flat = fit(images, ONE_AMPLITUDE), fit(images, ONE_AMPLITUDE, topography_error=0.0)
    assert (flat.damping_error < 0.9 * rough.damping_error).all()
    assert (abs(deviations(flat, [SOFT, FIRM])) < 3).all()


def test_a_zero_may_be_anywhere_on_the_circle():
    values = exact([SOFT, FIRM], TWO_AMPLITUDES)
    one, two = (fit(measure(values, TWO_AMPLITUDES, 5, zero), TWO_AMPLITUDES) for zero in (0.0, 135.0))
    np.testing.assert_allclose(one.modulus, two.modulus, rtol=1e-3)  # the search stops within 1e-4 of chi2
    assert float(two.phase_zero[0] - one.phase_zero[0]) == pytest.approx(135.0, abs=1e-2)


def test_branches_are_found_without_a_zero():
    scope = pm.Microscope(pm.Cantilever(26.0, 300e3, 450.0), pm.Tip(15e-9), pm.Drive(20e-9))
    labels = labels_of(2)
    glass, rubber = pm.Material(3e9, 0.04, 0.004), pm.Material(0.1e9, 0.10, 0.01)
    surface = pm.Surface.from_labels(labels, {0: glass, 1: rubber}, pixel_size=4e-9)
    images = [pm.simulate(surface, scope, setpoint) for setpoint in (0.6, 0.8)]
    assert [np.sign(one.phase[:, 0]).values.tolist() for one in images] == [[1, -1]] * 2
    moved = [one.assign(phase=one.phase + 60.0) for one in images]
    found = pm.fit_regions(moved, labels, scope, phase_zero="shared", known={0: glass})
    assert found.branch.values.tolist() == [[1, 1], [-1, -1]]
    assert float(found.phase_zero[0]) == pytest.approx(60.0, abs=3 * float(found.phase_zero_error[0]))


def test_the_wrong_sign_is_no_fit():
    images = measure(exact([SOFT, FIRM], TWO_AMPLITUDES), TWO_AMPLITUDES, 6)
    turned = [one.assign(phase=-one.phase) for one in images]
    found = fit(turned, TWO_AMPLITUDES)
    assert found.attrs["verdict"].startswith("The model does not describe the data")
    assert words(found) == [["not_identifiable"] * 3] * 2
    assert "sign of the phase" in found.attrs["advice"]


def test_zeros_of_regions_serve_the_pixels():
    values = exact([SOFT, FIRM], TWO_AMPLITUDES)
    images = [one.isel(x=slice(0, 40)) for one in measure(values, TWO_AMPLITUDES, 7)]
    scopes = scopes_of(TWO_AMPLITUDES)
    regions = pm.fit_regions(images, labels_of(2)[:, :40], scopes, phase_error=PHASE_FLOOR, height_error=HEIGHT_FLOOR)
    zeros = {name: regions[name] for name in ("phase_zero", "phase_zero_error", "height_zero", "height_zero_error")}
    found = pm.invert(images, scopes, phase_error=PHASE_NOISE, height_error=HEIGHT_NOISE, **zeros)
    apart = np.log(found.modulus / np.array([[SOFT.modulus], [FIRM.modulus]])) / found.modulus_error
    # Zeros are wrong for all pixels alike, by about a standard error: more pixels may miss than one in twenty.
    assert float((abs(apart) < 1.96).mean()) > 0.8


def test_wrong_input_is_named():
    images = measure(exact([SOFT, FIRM], TWO_AMPLITUDES), TWO_AMPLITUDES)
    for arguments, message in (
        ({"phase_zero": "unknown"}, "one unknown of all images"),
        ({"height_zero": "shared"}, "height_zero is 'shared'"),
        ({"known": {7: SOFT}}, "one of 0, 1"),
        ({"known": {0: "soft"}}, "a Material"),
        ({"known": {0: SOFT, 1: FIRM}}, "every region"),
        ({"phase_zero": PHASE_ZERO + 90.0, "known": {0: pm.Material(1e9, 0.0, 0.01)}}, "orbits in every image"),
        ({"topography_error": -1e-9}, "topography_error"),
        ({"phase_zero_error": -1.0}, "phase_zero_error"),
    ):
        with pytest.raises(pm.InputError, match=message):
            fit(images, TWO_AMPLITUDES, **arguments)


def test_picture_shows_data_fit_and_open_symbols_where_not_determined(doubtful, tmp_path):
    doubtful.to_netcdf(tmp_path / "found.nc")
    with xr.open_dataset(tmp_path / "found.nc") as again:
        figure = plot(again, tmp_path / "found.png")
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert titles[0] == "regions" and titles[1].startswith("phase") and titles[3:] == [
        "modulus (GPa)", "adhesion (J/m²)", "damping α₁",
    ]  # fmt: skip
    faces = [line.get_markerfacecolor() for line in figure.axes[3].lines if line.get_marker() == "o"]
    assert [face == "white" for face in faces] == [False, True]
    assert any("only together" in text.get_text() for text in figure.texts)
