"""What a tip of finite size sees of a relief."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.ndimage
from hypothesis import given, settings
from hypothesis import strategies as st

import phasemap as pm
from phasemap.experiment.seen_by_tip import TILE, dilated, tip_profile

# Round numbers tell pixels apart.
pytestmark = pytest.mark.filterwarnings("ignore::phasemap.PlausibilityWarning")

RADIUS = 10e-9
TIP = pm.Tip(RADIUS)
HALF_ANGLE = math.radians(20.0)
FLOAT = 1e-22  # rounding of lengths of 1e-7 m in double precision, ten times over [m]


def surface_of(relief: np.ndarray, pixel_size: float | tuple[float, float] = 1e-9) -> pm.Surface:
    """Each pixel of a material of its own, whose modulus is its number plus one."""
    modulus = 1.0 + np.arange(relief.size).reshape(relief.shape)
    return pm.Surface(modulus, topography=relief, pixel_size=pixel_size)


def touched_by(surface: pm.Surface) -> np.ndarray:
    """The pixel that the tip touches, of a surface from `surface_of`."""
    return surface.modulus.astype(int) - 1


def rough(shape: tuple[int, int], height: float = 30e-9, seed: int = 0) -> np.ndarray:
    return -height * np.random.default_rng(seed).random(shape)


def rise(distance: float) -> float:
    """The blunted cone as drawn with compasses and ruler: a circle, and the tangent where it has the cone's slope."""
    tangent = RADIUS * math.cos(HALF_ANGLE)
    if distance <= tangent:
        return RADIUS - math.sqrt(RADIUS**2 - distance**2)
    slope = 1 / math.tan(HALF_ANGLE)
    return rise(tangent) + slope * (distance - tangent)


def test_the_flank_of_the_tip_continues_the_sphere_without_a_corner() -> None:
    # One-sided difference quotients at the tangent point; their error is h/2 times the curvature, 1/(R sin(a)^3).
    tangent, h = RADIUS * math.cos(HALF_ANGLE), 1e-5 * RADIUS
    heights = tip_profile(np.array([tangent - h, tangent, tangent + h]), RADIUS, HALF_ANGLE)
    slopes = np.diff(heights) / h
    assert slopes[1] == pytest.approx(1 / math.tan(HALF_ANGLE), rel=1e-9)
    assert slopes[0] == pytest.approx(slopes[1], abs=0.51e-5 / math.sin(HALF_ANGLE) ** 3)


def test_a_flat_surface_comes_back_as_it_is() -> None:
    flat = pm.Surface([[1e9, 2e9]], adhesion=0.1, pixel_size=1e-9)
    assert flat.dilated(TIP) is flat
    level = replace(flat, topography=[[3e-9, 3e-9]])
    assert level.dilated(TIP) is level


def test_beside_a_step_the_apex_follows_the_shape_of_the_tip() -> None:
    # The edge of the step is the last high pixel; the sphere through it is the circle, then comes the straight flank.
    height, step, edge = 40e-9, 1e-9, 19
    relief = np.broadcast_to(np.where(np.arange(60) <= edge, height, 0.0), (5, 60))
    apex = surface_of(relief, step).dilated(TIP)
    expected = [max(0.0, height - rise(max(0, column - edge) * step)) for column in range(60)]
    assert np.allclose(apex.topography, expected, rtol=0, atol=FLOAT)
    columns = touched_by(apex)[2] - 2 * 60
    beside = np.flatnonzero((np.arange(60) > edge) & (apex.topography[2] > 0))
    assert len(beside) > 15
    assert np.all(columns[beside] == edge)  # it feels the material of the edge
    others = np.setdiff1d(np.arange(60), beside)
    assert np.array_equal(columns[others], others)


def test_a_spike_gives_the_tip_upside_down() -> None:
    height, (dy, dx) = 25e-9, (1.5e-9, 1e-9)
    relief = np.zeros((41, 61))
    relief[20, 30] = height
    apex = surface_of(relief, (dy, dx)).dilated(TIP)
    for row, column in np.ndindex(relief.shape):
        distance = math.hypot((row - 20) * dy, (column - 30) * dx)
        assert abs(apex.topography[row, column] - max(0.0, height - rise(distance))) < FLOAT


@pytest.mark.parametrize("curvature", [30e-9, -30e-9])
def test_the_centre_of_the_tip_moves_parallel_to_a_dome_and_to_a_wide_bowl(curvature: float) -> None:
    # The centre of the sphere is at distance rho + R from that of a dome of radius rho, at rho - R from that of a bowl.
    # The tip touches at centres of pixels, up to half a diagonal from the true point: there the relief has moved away
    # from it by half the square of that times the relative curvature, which on a slope grows by (1 + m^2)^(3/2).
    step, rho = 0.25e-9, abs(curvature)
    x = step * (np.arange(61) - 30)
    distance = np.hypot(x[:, np.newaxis], x)
    sign = math.copysign(1.0, curvature)
    relief = sign * (np.sqrt(rho**2 - distance**2) - rho)
    apex = surface_of(relief, step).dilated(TIP).topography
    parallel = rho + sign * RADIUS
    centre = sign * (np.sqrt(parallel**2 - distance**2) - rho)
    expected = centre - RADIUS
    inside = distance * rho / parallel < 30 * step  # where the true point of contact is in the image
    assert inside.sum() > 1000
    slope = 30 * step / math.sqrt(rho**2 - (30 * step) ** 2)
    missed = 0.5 * (step / math.sqrt(2)) ** 2 * (1 / RADIUS + sign / rho) * (1 + slope**2) ** 1.5
    assert np.all(apex[inside] <= expected[inside] + FLOAT)
    assert np.all(apex[inside] >= expected[inside] - missed)


def test_on_a_slope_the_tip_touches_at_its_side() -> None:
    # A plane of slope m lifts the apex by R (sqrt(1 + m^2) - 1); the point of contact is R m / sqrt(1 + m^2) uphill,
    # and missing it by half a pixel costs (step^2 / 8) (1 + m^2)^(3/2) / R.
    m, step = 0.7, 0.5e-9
    relief = np.broadcast_to(m * step * np.arange(80.0), (3, 80))
    lifted = (surface_of(relief, step).dilated(TIP).topography - relief)[1, :60]
    expected = RADIUS * (math.sqrt(1 + m**2) - 1)
    assert np.all(lifted <= expected + FLOAT)
    assert np.all(lifted >= expected - step**2 / 8 * (1 + m**2) ** 1.5 / RADIUS - FLOAT)


def test_it_is_what_two_nested_loops_find() -> None:
    # Independent of order, tiles and bounds: for every pixel all others, nearest first.
    dy, dx = 3e-9, 2e-9
    relief = rough((9, 13))
    apex = surface_of(relief, (dy, dx)).dilated(TIP)
    pixels = list(np.ndindex(relief.shape))
    for row, column in pixels:
        found = [relief[p] - rise(math.hypot((p[0] - row) * dy, (p[1] - column) * dx)) for p in pixels]
        assert abs(apex.topography[row, column] - max(found)) < FLOAT
        assert touched_by(apex)[row, column] == int(np.argmax(found))


@pytest.mark.parametrize("half_angle", [5.0, 20.0, 45.0])
def test_it_is_the_grey_dilation_of_scipy(half_angle: float) -> None:
    # Larger than a tile in both directions, and a structuring element that is larger than it need be.
    relief, step = rough((TILE + 20, 2 * TILE + 5), seed=1), 2e-9
    reach = np.arange(-20, 21) * step
    rises = tip_profile(np.hypot(reach[:, np.newaxis], reach), RADIUS, math.radians(half_angle))
    assert rises[20, 0] > np.ptp(relief)
    expected = scipy.ndimage.grey_dilation(relief, structure=-rises, mode="nearest")
    apex = surface_of(relief, step).dilated(TIP, half_angle)
    assert np.allclose(apex.topography, expected, rtol=0, atol=FLOAT)


def test_every_property_is_that_of_the_point_touched() -> None:
    shape = (20, 30)
    random = np.random.default_rng(2)
    maps = {name: random.random(shape) * 0.5 for name in ("modulus", "adhesion", "viscosity", "poisson_ratio")}
    maps["modulus"][3, 4] = np.nan  # no material there
    maps["modulus"] *= 1e9
    surface = pm.Surface(**maps, topography=rough(shape), pixel_size=2e-9, allow_nan=True)
    touched = touched_by(surface_of(rough(shape), 2e-9).dilated(TIP)).reshape(-1)
    seen = surface.dilated(TIP)
    for name, values in maps.items():
        assert np.array_equal(getattr(seen, name).reshape(-1), values.reshape(-1)[touched], equal_nan=True)
    assert seen.damping is None and seen.pixel_size == surface.pixel_size
    assert np.mean(touched != np.arange(touched.size)) > 0.5  # the tip does touch elsewhere


def test_of_several_points_touched_at_once_the_nearest_counts() -> None:
    # A pit one pixel wide, as deep as the tip reaches down between its rims: it touches both rims and the bottom. The
    # first of the rims where it is deeper. (The last pixel is far below, so that the reach does not end at the rims.)
    step = 6e-9
    depth = float(tip_profile(np.array([step]), RADIUS, HALF_ANGLE)[0])
    for bottom, touched in ((0.0, 1), (-1e-12, 0)):
        relief = np.array([[depth, bottom, depth, -20e-9]])
        assert touched_by(surface_of(relief, step).dilated(TIP))[0, 1] == touched


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 2**32 - 1), st.integers(-8, 8), st.integers(-8, 8))
def test_a_particle_elsewhere_looks_the_same_there(seed: int, down: int, right: int) -> None:
    # Farther from the edge than the tip reaches: below 20 nm of relief 14.3 nm, fewer than 8 pixels of 2 nm.
    relief = np.zeros((40, 40))
    relief[16:24, 16:24] = -rough((8, 8), 20e-9, seed)
    here = surface_of(relief, 2e-9).dilated(TIP)
    there = surface_of(np.roll(relief, (down, right), (0, 1)), 2e-9).dilated(TIP)
    assert np.array_equal(np.roll(here.topography, (down, right), (0, 1)), there.topography)
    moved = np.roll(touched_by(here), (down, right), (0, 1)) + 40 * down + right
    assert np.array_equal(moved[8:32, 8:32], touched_by(there)[8:32, 8:32])


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 2**32 - 1), st.floats(2e-9, 50e-9), st.floats(1.1, 3.0))
def test_a_blunter_tip_sees_everything_higher(seed: int, radius: float, factor: float) -> None:
    surface = surface_of(rough((12, 17), 20e-9, seed), 3e-9)
    sharp, blunt = (dilated(surface, pm.Tip(r)).topography for r in (radius, factor * radius))
    assert np.all(sharp >= surface.topography)
    assert np.all(blunt >= sharp - FLOAT)
    assert blunt.max() == surface.topography.max()


def test_a_half_angle_that_is_none_is_refused() -> None:
    surface = surface_of(rough((3, 3)))
    for wrong in (0.0, 90.0, float("nan"), "wide"):
        with pytest.raises(pm.InputError, match=r"half_angle is .*; allowed: a finite number above 0 and below 90"):
            surface.dilated(TIP, wrong)  # type: ignore[arg-type]
