"""Generators: the numbers asked for are the numbers found in the image."""

from __future__ import annotations

import copy
import inspect
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy import ndimage

from phasemap import generate
from phasemap._shared.errors import InputError
from phasemap.experiment.generate import discs
from phasemap.experiment.labels import Variation
from phasemap.experiment.material import Material
from phasemap.experiment.surface import Surface

SHAPE, PIXEL = (48, 64), 2e-9
SEEDS = st.integers(0, 2**32)

# One call of each generator; a new generator is tested once it is here.
CALLS: dict[str, Callable[..., np.ndarray]] = {
    "stripes": lambda **k: generate.stripes(SHAPE, PIXEL, period=16e-9, angle=30.0, **k),
    "checkerboard": lambda **k: generate.checkerboard(SHAPE, PIXEL, side=16e-9, **k),
    "step": lambda **k: generate.step(SHAPE, PIXEL, **k),
    "gradient": lambda **k: generate.gradient(SHAPE, start=1.0, stop=2.0, **k),
    "particles": lambda **k: generate.particles(SHAPE, PIXEL, radius=8e-9, area_fraction=0.3, spread=0.2, **k),
    "lamellae": lambda **k: generate.lamellae(SHAPE, PIXEL, period=16e-9, **k),
    "blend": lambda **k: generate.blend(SHAPE, PIXEL, spacing=24e-9, **k),
    "roughness": lambda **k: generate.roughness(SHAPE, PIXEL, rms=1e-9, correlation_length=10e-9, **k),
}
SEEDED = [name for name in generate.__all__ if "seed" in inspect.signature(getattr(generate, name)).parameters]


def wavelength(image: np.ndarray, sides: tuple[float, float]) -> float:
    """Find the wavelength with the most power around it [m], averaged over directions."""
    power = np.abs(np.fft.fft2(image - image.mean())) ** 2
    qy, qx = (np.fft.fftfreq(n, side) for n, side in zip(image.shape, sides, strict=True))
    q = np.hypot(qy[:, None], qx)
    width = q[0, 1]
    bins = np.bincount(np.round(q / width).astype(int).ravel(), (power * q).ravel()) / width
    return 1 / (bins.argmax() * width)


# All of them


def test_every_generator_is_tested_here() -> None:
    assert sorted(CALLS) == sorted(generate.__all__)


@pytest.mark.filterwarnings("ignore:topography:phasemap.PlausibilityWarning")  # a gradient is one of any quantity
@pytest.mark.parametrize("name", generate.__all__)
def test_a_generator_gives_labels_or_a_field_that_a_surface_takes(name: str) -> None:
    image = CALLS[name]()
    assert image.shape == SHAPE
    assert image.flags.writeable
    assert image.flags.c_contiguous
    if getattr(generate, name).__annotations__["return"] == "Labels":
        assert image.dtype == np.uint8
        assert set(np.unique(image)) == {0, 1}
        surface = Surface.from_labels(image, {0: Material(1e9), 1: Material(2e9)}, pixel_size=PIXEL)
    else:
        assert image.dtype == np.float64
        surface = Surface(modulus=1e9, topography=image, pixel_size=PIXEL)
    assert surface.shape == SHAPE


@pytest.mark.parametrize("name", SEEDED)
def test_the_same_seed_gives_the_same_bytes_and_another_seed_another_image(name: str) -> None:
    call = CALLS[name]
    assert call(seed=3).tobytes() == call(seed=3).tobytes()
    assert call(seed=3).tobytes() != call(seed=4).tobytes()
    assert call().tobytes() == call(seed=0).tobytes()


@pytest.mark.parametrize("name", sorted({*generate.__all__} - {"gradient"}))
def test_scaling_all_lengths_changes_nothing(name: str) -> None:
    lengths = {
        "stripes": {"period": 16.0},
        "checkerboard": {"side": 8.0},
        "step": {"position": 40.0},
        "lamellae": {"period": 16.0},
        "blend": {"spacing": 16.0},
        "particles": {"radius": 6.0},
        "roughness": {"rms": 1.0, "correlation_length": 8.0},
    }[name]
    rest = {"area_fraction": 0.3} if name == "particles" else {}
    small, large = (
        getattr(generate, name)(SHAPE, 2.0 * scale, **{key: value * scale for key, value in lengths.items()}, **rest)
        for scale in (1.0, 2.0**-20)
    )
    np.testing.assert_allclose(large * (2.0**20 if name == "roughness" else 1), small, rtol=1e-9, atol=1e-12)


# Regular patterns


@given(st.integers(2, 12), st.sampled_from([0.0, 90.0]))
def test_stripes_repeat_after_a_period(pixels: int, angle: float) -> None:
    image = generate.stripes((36, 60), PIXEL, period=pixels * PIXEL, angle=angle)
    along = image if angle == 0 else image.T
    assert (along == along[0]).all()
    assert np.array_equal(along[0, pixels:], along[0, :-pixels])
    assert along[0, 0] == 1
    assert along[0, pixels - 1] == 0


@pytest.mark.parametrize("angle", [0.0, 20.0, -35.0, 90.0])
@pytest.mark.parametrize("sides", [(1e-9, 1e-9), (2e-9, 1e-9)])
def test_the_period_and_angle_of_stripes_are_found_in_the_spectrum(angle: float, sides: tuple[float, float]) -> None:
    image = generate.stripes((256, 256), sides, period=16e-9, angle=angle)
    power = np.abs(np.fft.fft2(image - image.mean()))
    row, col = np.unravel_index(power.argmax(), power.shape)
    qy, qx = (np.fft.fftfreq(256, side)[j] for side, j in zip(sides, (row, col), strict=True))
    assert 1 / np.hypot(qy, qx) == pytest.approx(16e-9, rel=0.05)
    assert np.tan(np.arctan2(qy, qx) - np.radians(angle)) == pytest.approx(0.0, abs=0.08)


@given(st.floats(0.1, 0.9), st.floats(-180, 180))
def test_the_duty_of_stripes_is_the_fraction_of_the_image(duty: float, angle: float) -> None:
    image = generate.stripes((200, 200), 1e-9, period=9.7e-9, duty=duty, angle=angle)
    assert image.mean() == pytest.approx(duty, abs=0.06)


def test_the_squares_of_a_checkerboard_have_the_side_asked_for_also_where_pixels_are_not_square() -> None:
    image = generate.checkerboard((8, 16), (2e-9, 1e-9), side=4e-9)
    assert np.array_equal(image, np.kron(np.indices((4, 4)).sum(0) % 2, np.ones((2, 4))))


@pytest.mark.parametrize("axis", ["x", "y"])
def test_a_step_lies_where_it_was_asked_for(axis: str) -> None:
    image = generate.step((6, 6), (2e-9, 2e-9), position=8e-9, axis=axis)
    assert (image if axis == "x" else image.T)[0].tolist() == [0, 0, 0, 0, 1, 1]
    assert generate.step((6, 6), 2e-9, axis=axis).mean() == 0.5


@given(st.floats(-1e9, 1e9), st.floats(-1e9, 1e9), st.sampled_from(["x", "y"]))
def test_a_gradient_goes_evenly_from_start_to_stop(start: float, stop: float, axis: str) -> None:
    image = generate.gradient((5, 7), start=start, stop=stop, axis=axis)
    line = (image if axis == "x" else image.T)[0]
    assert (line[0], line[-1]) == (start, stop)
    np.testing.assert_allclose(np.diff(line), (stop - start) / (line.size - 1), rtol=1e-9, atol=1e-6)


# Random patterns


@settings(max_examples=30, deadline=None)
@given(st.floats(0.02, 0.7), st.floats(0.0, 0.5), st.booleans(), SEEDS)
@example(0.5, 0.5, False, 1323)
def test_particles_cover_the_fraction_asked_for(fraction: float, spread: float, periodic: bool, seed: int) -> None:
    if not periodic:
        fraction *= 0.8  # whole discs have less room near the border
    largest, draw = [], discs._radii

    def remember(rng: np.random.Generator, radius: float, spread: float, area: float) -> np.ndarray:
        more = draw(copy.deepcopy(rng), radius, spread, 2 * area)  # with those that would have come next
        largest.append(more.max())
        return draw(rng, radius, spread, area)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(discs, "_radii", remember)
        image = generate.particles(
            (128, 160), 1.0, radius=6.0, area_fraction=fraction, spread=spread, periodic=periodic, seed=seed
        )
    one_disc = np.pi * largest[0] ** 2 / image.size  # log-normal radii have a tail: 3.6 times the mean has been met
    assert image.mean() == pytest.approx(fraction, abs=one_disc + 0.01)


@pytest.mark.parametrize("fraction", [0.1, 0.4, 0.7])
@pytest.mark.parametrize("periodic", [True, False])
def test_particles_do_not_overlap(monkeypatch: pytest.MonkeyPatch, fraction: float, periodic: bool) -> None:
    placed = []
    place = discs._without_overlap

    def remember(rng: np.random.Generator, radii: np.ndarray, sides: np.ndarray, periodic: bool) -> np.ndarray:
        placed.append((radii, sides, place(rng, radii, sides, periodic)))
        return placed[0][2]

    monkeypatch.setattr(discs, "_without_overlap", remember)
    generate.particles(
        (200, 260), 1.0, radius=6.0, area_fraction=fraction * (1.0 if periodic else 0.9), spread=0.3, periodic=periodic
    )
    radii, sides, centres = placed[0]
    between = centres[:, None] - centres
    if periodic:
        between -= sides * np.round(between / sides)
    else:
        assert (centres >= radii[:, None]).all()
        assert (centres <= sides - radii[:, None]).all()
    distance = np.hypot(between[..., 0], between[..., 1]) + 1e9 * np.eye(radii.size)
    assert (distance >= radii[:, None] + radii).all()


def test_equal_particles_have_the_radius_asked_for() -> None:
    image = generate.particles((300, 300), 1.0, radius=9.0, area_fraction=0.1, periodic=False)
    blobs, count = ndimage.label(image)
    areas = ndimage.sum_labels(image, blobs, np.arange(1, count + 1))
    assert np.sqrt(np.median(areas) / np.pi) == pytest.approx(9.0, rel=0.02)


def test_particles_of_a_wide_spread_have_that_spread() -> None:
    radii = discs._radii(np.random.default_rng(0), 2.0, 0.4, 1e5)
    assert radii.mean() == pytest.approx(2.0, rel=0.02)
    assert radii.std() == pytest.approx(0.8, rel=0.05)
    assert np.pi * (radii**2).sum() == pytest.approx(1e5, rel=1e-3)


@settings(max_examples=20, deadline=None)
@given(st.sampled_from(["lamellae", "blend"]), st.floats(0.05, 0.95), SEEDS)
def test_the_fraction_of_a_pattern_is_met_to_one_pixel(name: str, fraction: float, seed: int) -> None:
    length = {"lamellae": {"period": 12.0}, "blend": {"spacing": 12.0}}[name]
    image = getattr(generate, name)((40, 56), 1.0, fraction=fraction, seed=seed, **length)
    assert image.sum() == round(fraction * image.size)


@settings(max_examples=10, deadline=None)
@given(st.floats(8.0, 24.0), SEEDS)
def test_the_period_of_lamellae_is_found_in_the_spectrum(period: float, seed: int) -> None:
    image = generate.lamellae((192, 192), 1.0, period=period, seed=seed)
    assert wavelength(image, (1.0, 1.0)) == pytest.approx(period, rel=0.1)


def test_lamellae_are_as_wide_along_y_as_along_x_where_pixels_are_not_square() -> None:
    image = generate.lamellae((128, 256), (2e-9, 1e-9), period=20e-9)
    assert wavelength(image, (2e-9, 1e-9)) == pytest.approx(20e-9, rel=0.1)
    edges = [np.abs(np.diff(image.astype(int), axis=axis)).sum() * size for axis, size in ((0, 1e-9), (1, 2e-9))]
    assert edges[0] == pytest.approx(edges[1], rel=0.3)


def test_annealing_straightens_lamellae() -> None:
    pieces = [ndimage.label(generate.lamellae((256, 256), 1.0, period=14.0, annealing=n))[1] for n in (10, 200)]
    assert pieces[1] < pieces[0]


@settings(max_examples=10, deadline=None)
@given(st.sampled_from([12.0, 20.0, 32.0]), st.sampled_from([0.3, 0.5]), SEEDS)
def test_the_spacing_of_a_blend_is_found_in_the_spectrum(spacing: float, fraction: float, seed: int) -> None:
    image = generate.blend((256, 256), 1.0, spacing=spacing, fraction=fraction, seed=seed)
    assert 0.8 * spacing < wavelength(image, (1.0, 1.0)) < 1.6 * spacing


def test_a_minority_phase_forms_round_droplets() -> None:
    blobs, count = ndimage.label(generate.blend((256, 256), 1.0, spacing=40.0, fraction=0.1))
    whole = [part for part in ndimage.find_objects(blobs) if all(s.start > 0 and s.stop < 256 for s in part)]
    assert count >= 15
    sides = np.array([[s.stop - s.start for s in part] for part in whole])
    assert np.median(sides.max(1) / sides.min(1)) < 1.25


@given(st.floats(1e-12, 1e-6), st.floats(0.1, 1.0), st.floats(4e-9, 60e-9), SEEDS)
def test_the_rms_of_a_rough_surface_is_exact(rms: float, hurst: float, length: float, seed: int) -> None:
    z = generate.roughness(SHAPE, PIXEL, rms=rms, correlation_length=length, hurst=hurst, seed=seed)
    assert z.std() == pytest.approx(rms, rel=1e-12)
    assert abs(z.mean()) < 1e-12 * rms


@pytest.mark.parametrize("hurst", [0.3, 0.8])
def test_the_spectrum_of_a_rough_surface_is_flat_and_then_falls_with_the_hurst_exponent(hurst: float) -> None:
    n, length = 512, 10.0
    arguments = {"rms": 1.0, "correlation_length": length, "hurst": hurst}
    images = [generate.roughness((n, n), 1.0, **arguments, seed=seed) for seed in range(4)]
    power = np.mean([np.abs(np.fft.fft2(image)) ** 2 for image in images], axis=0)
    q = 2 * np.pi * np.hypot(np.fft.fftfreq(n)[:, None], np.fft.fftfreq(n)) * length
    expected = (1 + q**2) ** (-1 - hurst)
    expected *= n**4 / expected[q > 0].sum()
    for low, high in ((0, 0.5), (0.5, 2), (2, 10), (10, 40)):
        band = (q > low) & (q < high)
        assert (power[band] / expected[band]).mean() == pytest.approx(1.0, abs=0.3)


def test_a_flat_surface_can_be_asked_for() -> None:
    assert not generate.roughness((4, 4), 1e-9, rms=0.0, correlation_length=2e-9).any()
    assert not generate.roughness((1, 1), 1e-9, rms=1e-9, correlation_length=1e-9).any()


# What they refuse

REFUSED = {
    "period is 3e-09; allowed: 4e-09 m or more, two pixels of this image.": lambda: generate.stripes(
        SHAPE, PIXEL, period=3e-9
    ),
    "duty is 1.0; allowed: a finite number above 0 and below 1.": lambda: generate.stripes(
        SHAPE, PIXEL, period=8e-9, duty=1.0
    ),
    "side is 1e-09; allowed: 2e-09 m or more, one pixel of this image.": lambda: generate.checkerboard(
        SHAPE, PIXEL, side=1e-9
    ),
    "position is 2e-07; allowed: a finite number above 0 and below 1.28e-07 m.": lambda: generate.step(
        SHAPE, PIXEL, position=200e-9
    ),
    "axis is 'z'; allowed: 'x' or 'y'.": lambda: generate.gradient(SHAPE, start=0.0, stop=1.0, axis="z"),
    "area_fraction is 0.99; allowed: a finite number above 0 and at most 0.7.": lambda: generate.particles(
        SHAPE, PIXEL, radius=8e-9, area_fraction=0.99
    ),
    "radius is 1e-09; allowed: 2e-09 m or more, one pixel of this image.": lambda: generate.particles(
        SHAPE, PIXEL, radius=1e-9, area_fraction=0.3
    ),
    "radius is 4e-08; allowed: a smaller one. One disc is more than area_fraction of the image.": lambda: (
        generate.particles(SHAPE, PIXEL, radius=40e-9, area_fraction=0.1)
    ),
    "largest radius is 5.5e-08; allowed: 4.7e-08 m or less, to fit into the image.": lambda: generate.particles(
        SHAPE, PIXEL, radius=55e-9, area_fraction=0.7
    ),
    "number of discs is 2; allowed: fewer. They jam in this image; lower area_fraction.": lambda: generate.particles(
        (16, 16), 1.0, radius=5.0, area_fraction=0.62, periodic=False
    ),
    "spread is 2.0; allowed: a finite number of at least 0 and at most 0.5.": lambda: generate.particles(
        SHAPE, PIXEL, radius=8e-9, area_fraction=0.3, spread=2.0
    ),
    "period is 7e-09; allowed: 8e-09 m or more, four pixels of this image.": lambda: generate.lamellae(
        SHAPE, PIXEL, period=7e-9
    ),
    "period is 5e-08; allowed: 4.8e-08 m or less, half of this image.": lambda: generate.lamellae(
        SHAPE, PIXEL, period=50e-9
    ),
    "annealing is 0; allowed: a whole number of at least 1.": lambda: generate.lamellae(
        SHAPE, PIXEL, period=16e-9, annealing=0
    ),
    "fraction is 0.01; allowed: a finite number of at least 0.05 and at most 0.95.": lambda: generate.blend(
        SHAPE, PIXEL, spacing=16e-9, fraction=0.01
    ),
    "hurst is 1.5; allowed: a finite number above 0 and at most 1.": lambda: generate.roughness(
        SHAPE, PIXEL, rms=1e-9, correlation_length=8e-9, hurst=1.5
    ),
    "correlation_length is 1e-06; allowed: a finite number of at most 9.6e-08 m.": lambda: generate.roughness(
        SHAPE, PIXEL, rms=1e-9, correlation_length=1e-6
    ),
    "seed is -1; allowed: a whole number of at least 0.": lambda: generate.blend(SHAPE, PIXEL, spacing=16e-9, seed=-1),
    "seed is None; allowed: a whole number of at least 0.": lambda: generate.blend(
        SHAPE, PIXEL, spacing=16e-9, seed=None
    ),
    "shape is (3,); allowed: two whole numbers, (rows, columns).": lambda: generate.step((3,), PIXEL),
    "pixel_size is -1.0; allowed: a finite number above 0 m.": lambda: generate.step(SHAPE, -1.0),
}


@pytest.mark.parametrize(("sentence", "call"), REFUSED.items(), ids=[sentence[:40] for sentence in REFUSED])
def test_an_impossible_argument_is_refused_in_one_sentence(sentence: str, call: Callable[[], np.ndarray]) -> None:
    with pytest.raises(InputError) as caught:
        call()
    assert str(caught.value) == sentence


def test_an_argument_that_is_not_there_or_missing_is_named_with_the_one_that_is_meant() -> None:
    ask: Any = generate.particles
    with pytest.raises(TypeError, match=r"^particles has no argument 'fraction'; .* Did you mean 'area_fraction'\?$"):
        ask(SHAPE, PIXEL, radius=5e-9, fraction=0.2)
    with pytest.raises(TypeError, match=r"^particles needs area_fraction; it is called as particles\(shape, pixel_"):
        ask(SHAPE, PIXEL, radius=5e-9)
    with pytest.raises(TypeError, match=r"^particles takes 2 arguments by their order and 4 are given"):
        ask(SHAPE, PIXEL, 5e-9, 0.2)
    with pytest.raises(TypeError, match=r"^particles: multiple values for argument 'shape'\.$"):
        ask(SHAPE, PIXEL, radius=5e-9, area_fraction=0.2, shape=SHAPE)


def test_a_gradient_is_of_one_quantity() -> None:
    line = generate.gradient((1, 3), start="1 GPa", stop="3000 MPa")
    assert line.tolist() == generate.gradient((1, 3), start="1 GPa", stop=3e9).tolist() == [[1e9, 2e9, 3e9]]
    with pytest.raises(InputError, match="stop is '10 nm'; allowed: a value in GPa as start is, or in another unit of"):
        generate.gradient((1, 3), start="1 GPa", stop="10 nm")


@pytest.mark.parametrize("seed", range(4))
def test_images_of_the_same_seed_have_nothing_in_common(seed: int) -> None:
    """Neither domains with each other, nor a relief with them, nor what varies within materials with any of these."""
    shape, side = (256, 256), 4e-9
    patterns = {
        "blend": generate.blend(shape, side, spacing=100e-9, seed=seed),
        "lamellae": generate.lamellae(shape, side, period=100e-9, seed=seed),
        "particles": generate.particles(shape, side, radius=30e-9, area_fraction=0.3, seed=seed),
        "roughness": generate.roughness(shape, side, rms=1e-9, correlation_length=25e-9, seed=seed),
    }
    assert set(patterns) == set(SEEDED)
    materials, labels = [Material(3e9, 0.05, damping=0.02), Material(0.3e9, 0.05, damping=0.02)], patterns["blend"]
    surface = Surface.from_labels(labels, materials, pixel_size=side, variation=Variation(seed=seed))
    for name in ("modulus", "adhesion", "damping"):
        own = np.array([getattr(one, name) for one in materials])[labels]
        patterns[name] = np.log(getattr(surface, name) / own)
    together = np.corrcoef([pattern.ravel() for pattern in patterns.values()])
    # By chance 0.1, of some 100 areas that vary together; with one noise for all of a seed 0.4 to 0.9.
    assert np.abs(together - np.eye(len(patterns))).max() < 0.3
