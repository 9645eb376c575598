"""From a surface to an image."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import phasemap as pm
from phasemap.results.variables import IMAGE_VARIABLES

SCOPE = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(20e-9))
SOFT, HARD = pm.Material(1e9, adhesion=0.1, damping=0.05), pm.Material(5e9, adhesion=0.05)
LABELS = np.array([[0, 1, 1, 0], [1, 0, 0, 0], [0, 0, 1, 1]])


def image_of(**options: object) -> xr.Dataset:
    topography = np.arange(12.0).reshape(3, 4) * 1e-9
    surface = pm.Surface.from_labels(LABELS, {0: SOFT, 1: HARD}, pixel_size=(2e-9, 4e-9), topography=topography)
    return pm.simulate(surface, SCOPE, 0.7, **options)  # type: ignore[arg-type]


def test_every_pixel_is_what_its_material_is_alone() -> None:
    image = image_of(solver="orbit")
    for value, material in ((0, SOFT), (1, HARD)):
        pixel = pm.solve_pixel(material, SCOPE, 0.7, solver="orbit")
        at = LABELS == value
        # One pixel is solved by collocation throughout, an image by what is good to 1e-3 degree and 1 pm.
        assert np.ptp(image.phase.values[at]) == 0 and np.ptp(image.tip_offset.values[at]) == 0
        assert np.all(abs(image.phase.values[at] - pixel.phase) < 1e-3)
        assert np.all(abs(image.tip_offset.values[at] - pixel.tip_offset) < 1e-12)


def test_height_is_topography_and_tip_offset_less_the_setpoint_amplitude() -> None:
    image = image_of()
    expected = np.arange(12.0).reshape(3, 4) * 1e-9 + image.tip_offset - 0.7 * 20e-9
    assert np.allclose(image.height, expected, rtol=0, atol=1e-20)


def test_purely_elastic_contrast_shows_in_height_and_not_in_phase() -> None:
    # Wang (1999), section 4: without damping the phase is set by the setpoint alone.
    surface = pm.Surface([[1e9, 10e9]], pixel_size=1e-9)
    image = pm.simulate(surface, SCOPE, 0.7, solver="orbit")
    assert abs(float(np.ptp(image.phase.values))) < 1e-3
    assert float(np.ptp(image.height.values)) > 0.2e-9


def test_a_picture_by_xarray_has_row_0_at_the_top() -> None:
    import matplotlib.pyplot as plt

    image = image_of()
    drawn = image.phase.plot()
    corners, axes = drawn.get_coordinates(), drawn.axes
    heights = axes.transData.transform(corners[:, 0])[:, 1]
    plt.close(drawn.figure)
    assert (np.diff(heights) < 0).all()
    assert np.array_equal(drawn.get_array(), image.phase.values)


def test_variables_coordinates_and_flags_are_as_agreed() -> None:
    image = image_of()
    assert tuple(image.data_vars) == IMAGE_VARIABLES
    assert image.phase.dims == ("y", "x")
    assert np.allclose(image.y, [5e-9, 3e-9, 1e-9])
    assert np.allclose(image.x, [2e-9, 6e-9, 10e-9, 14e-9])
    assert all("long_name" in v.attrs for v in image.data_vars.values())
    for name, units in {"height": "m", "phase": "degree", "dissipation": "J", "virial": "J"}.items():
        assert image[name].attrs["units"] == units
        assert image[name].attrs["ancillary_variables"] == "status"
    for name in ("branch", "status", "solver"):
        assert image[name].dtype == np.int8
        values, meanings = image[name].attrs["flag_values"], image[name].attrs["flag_meanings"].split()
        assert len(values) == len(meanings)
        assert np.isin(image[name].values, values).all()


def test_the_lag_of_an_image_says_that_it_is_one() -> None:
    phase = image_of(solver="averaging").phase
    lag = pm.phase_lag(phase)
    assert np.array_equal(lag, 90 - phase) and lag.attrs["units"] == "degree"
    assert lag.attrs["long_name"] == "lag behind the drive, 90 at free resonance, below 90 repulsive"
    assert "positive repulsive" in phase.attrs["long_name"]


def test_the_image_says_where_it_comes_from() -> None:
    image = image_of(solver="orbit")
    assert image.attrs["Conventions"] == "CF-1.11"
    configuration = json.loads(image.attrs["configuration"])
    assert configuration["setpoint"] == 0.7
    assert configuration["microscope"]["cantilever"]["stiffness"] == 40.0
    assert image.attrs["distinct_materials"] == 2
    assert "damping" in image.attrs["modelled"]
    assert "topography" in image.attrs["modelled"]


def test_a_term_that_no_pixel_has_is_not_modelled() -> None:
    image = pm.simulate(pm.Surface([[1e9, 2e9]], pixel_size=1e-9), SCOPE, 0.7)
    assert image.attrs["modelled"] == "dmt contact"


def test_netcdf_gives_back_the_same_image(tmp_path: Path) -> None:
    image = image_of()
    image.to_netcdf(tmp_path / "image.nc")
    with xr.open_dataset(tmp_path / "image.nc") as read:
        xr.testing.assert_identical(read.load(), image)


def test_only_what_is_asked_for_is_returned_with_the_status() -> None:
    assert set(image_of(variables=["phase"]).data_vars) == {"phase", "status"}


def test_strict_raises_for_the_first_pixel_that_fails() -> None:
    surface = pm.Surface([[1e9, np.nan]], pixel_size=1e-9, allow_nan=True)
    with pytest.raises(pm.SolveError, match=r"1 pixel has no solution; it is at row 0, column 1\."):
        pm.simulate(surface, SCOPE, 0.7, strict=True)


@pytest.mark.parametrize("setpoint", [0.0, 1.0, -0.5, 1.5, float("nan"), "0.7 nm", True])
def test_a_setpoint_outside_0_and_1_is_refused(setpoint: object) -> None:
    with pytest.raises(pm.InputError, match=r"setpoint is .*; allowed: a number above 0 and below 1"):
        image_of_setpoint(setpoint)


def image_of_setpoint(setpoint: object) -> xr.Dataset:
    return pm.simulate(pm.Surface([[1e9]], pixel_size=1e-9), SCOPE, setpoint)  # type: ignore[arg-type]


def test_unknown_names_are_refused_with_what_is_allowed() -> None:
    with pytest.raises(pm.InputError, match="variables is 'hight'; allowed: names out of height, phase"):
        image_of(variables=["hight"])
    with pytest.raises(pm.InputError, match="variables is 5; allowed: a string, a list of strings or None"):
        image_of(variables=5)
    with pytest.raises(pm.InputError, match="threads is 0; allowed: a whole number of at least 1"):
        image_of(threads=0)


def test_a_viscosity_needs_the_exponent_of_kelvin_voigt() -> None:
    scope = pm.Microscope(SCOPE.cantilever, SCOPE.tip, SCOPE.drive, pm.Interaction(damping_exponent=1.0))
    with pytest.raises(pm.InputError, match=r"damping_exponent is 1\.0; allowed: 0\.5 where materials have a visc"):
        pm.solve_pixel(pm.Material(1e9, viscosity=10.0), scope, 0.7)


def test_an_elastic_tip_is_softer_than_a_rigid_one() -> None:
    silicon = pm.Microscope(SCOPE.cantilever, pm.Tip(10e-9, modulus=130e9, poisson_ratio=0.28), SCOPE.drive)
    rigid = pm.solve_pixel(pm.Material(100e9), SCOPE, 0.7)
    soft = pm.solve_pixel(pm.Material(100e9), silicon, 0.7)
    assert soft.height < rigid.height


@pytest.mark.parametrize("control", [pm.Engage(), pm.Raster()], ids=["engage", "raster"])
def test_progress_counts_materials_that_are_refused(control: Any) -> None:
    surface = pm.Surface([[1e9, np.nan, 2e9]], 0.02, pixel_size=1e-9, allow_nan=True)
    seen: list[tuple[int, int]] = []
    pm.simulate(surface, SCOPE, 0.7, control=control, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1] == (3, 3)


def test_progress_counts_to_the_end_and_an_interrupt_stops_the_work() -> None:
    surface = pm.Surface(np.geomspace(1e8, 1e10, 3000).reshape(30, 100), pixel_size=1e-9)
    seen: list[tuple[int, int]] = []
    pm.simulate(surface, SCOPE, 0.7, progress=lambda done, total: seen.append((done, total)), threads=2)
    assert seen[-1] == (3000, 3000)
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)

    def interrupt(done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        pm.simulate(surface, SCOPE, 0.7, progress=interrupt, threads=2)
