"""Images in which every pixel is a different material: interpolated, and as exact as asked for."""

from __future__ import annotations

import tracemalloc
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
import xarray as xr

import phasemap as pm
from phasemap import generate
from phasemap._kernels import columns as col
from phasemap._kernels.materials import interpolate as kernel
from phasemap.imaging import engaged
from phasemap.imaging.engaged import OF_ANSWER
from phasemap.imaging.interpolation.atlas import Atlas
from phasemap.imaging.interpolation.borders import Undecided, find_borders
from phasemap.imaging.interpolation.cells import Cell, FilledCell, evaluate
from phasemap.imaging.interpolation.exact_orbits import DEPTH, Axes, ExactOrbits
from phasemap.results.variables import SOLVER_NAMES

AIR = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(20e-9))
TWO_MODES = replace(AIR, cantilever=replace(AIR.cantilever, modes=2))
SHAKEN = pm.Microscope(
    pm.Cantilever(0.3, 30e3, 3.0, modes=(pm.Eigenmode(7.5, 6.0),)), AIR.tip, pm.Drive(10e-9, excitation="base")
)
SHARP = pm.Microscope(pm.Cantilever(40.0, 300e3, 5000.0), pm.Tip(10e-9), pm.Drive(20e-9))
SOFT = pm.Microscope(pm.Cantilever(2.0, 70e3, 150.0), pm.Tip(10e-9), pm.Drive(40e-9))
DAMPED = pm.Microscope(pm.Cantilever(5.0, 60e3, 30.0), pm.Tip(10e-9), pm.Drive(20e-9))
BESIDE = pm.Microscope(AIR.cantilever, AIR.tip, pm.Drive(20e-9, frequency=299.5e3))
ABOVE = pm.Microscope(pm.Cantilever(3.0, 75e3, 200.0), pm.Tip(10e-9), pm.Drive(60e-9, frequency=75.75e3))
SIDE = 200  # about twice as many pixels as are solved one by one
Range = tuple[float, float]


def between(low: float, high: float, seed: int, shape: tuple[int, int], decades: bool) -> np.ndarray:
    """A rough map from low to high, evenly distributed."""
    rough = generate.roughness(shape, 1e-9, rms=1e-9, correlation_length=20e-9, seed=seed)
    share = rough.reshape(-1).argsort().argsort().reshape(shape) / (rough.size - 1)
    return low * (high / low) ** share if decades else low + (high - low) * share


def surface_of(
    modulus: Range, adhesion: Range, damping: Range, seed: int = 0, shape: tuple[int, int] = (SIDE, SIDE)
) -> pm.Surface:
    return pm.Surface(
        between(*modulus, 3 * seed, shape, True),
        between(*adhesion, 3 * seed + 1, shape, False),
        between(*damping, 3 * seed + 2, shape, False),
        pixel_size=1e-9,
    )


@dataclass(frozen=True)
class Case:
    name: str
    scope: pm.Microscope
    setpoint: float
    modulus: Range
    adhesion: Range
    damping: Range
    interpolated: float  # least share of the pixels
    every: int = 4  # of the rows, which are compared

    def surface(self, seed: int = 0) -> pm.Surface:
        return surface_of(self.modulus, self.adhesion, self.damping, seed)


CROSSING = Case("from repulsive to attractive", AIR, 0.7, (1e9, 1e10), (0.05, 0.3), (0, 0.05), 0.9)
CASES = (
    Case("repulsive", AIR, 0.7, (1e9, 1e10), (0.01, 0.05), (0, 0.05), 0.999),
    CROSSING,
    Case("some without adhesion, high Q", SHARP, 0.7, (1e9, 1e10), (0, 0.05), (0, 0.02), 0.9),
    Case("soft lever, two decades of modulus", SOFT, 0.8, (1e8, 1e10), (0.0, 0.02), (0.001, 0.1), 0.5),
    Case("low setpoint", AIR, 0.5, (2e9, 2e10), (0.05, 0.25), (0, 0.02), 0.0),
    Case("low Q", DAMPED, 0.7, (3e8, 3e9), (1e-3, 0.02), (0.001, 0.05), 0.9),
    Case("two modes", TWO_MODES, 0.7, (1e9, 1e10), (0.01, 0.05), (0, 0.05), 0.999),
    Case("two modes in liquid on a shaker", SHAKEN, 0.7, (1e7, 1e9), (0, 0.003), (0, 0.1), 0.999, every=8),
    Case(
        "from repulsive to attractive on a shaker",
        replace(AIR, drive=pm.Drive(20e-9, excitation="base")),
        0.7,
        (1e9, 1e10),
        (0.01, 0.3),
        (0, 0.05),
        0.9,
        every=16,
    ),
    Case("beside resonance", BESIDE, 0.7, (1e9, 1e10), (0.01, 0.1), (0, 0.05), 0.9),
    Case(
        "from repulsive to attractive, 1.01 of the resonance",
        ABOVE,
        0.9,
        (5e8, 5e9),
        (0.005, 0.08),
        (1e-3, 0.02),
        0.4,
        every=16,
    ),  # 0.9 before folds between two points of the curve were told from leaving it: the rest is exact, and slower
)


def assert_within(image: xr.Dataset, exact: xr.Dataset, phase: float, height: float) -> None:
    """Every pixel on the right branch, within the accuracy, and almost every one within its own estimate."""
    assert np.array_equal(image.status, exact.status)
    assert np.array_equal(image.branch, exact.branch)
    errors = {name: abs(image[name].values - exact[name].values) for name in ("phase", "height")}
    assert np.nanmax(errors["phase"]) <= phase
    assert np.nanmax(errors["height"]) <= height
    interpolated = image.solver.values == col.INTERPOLATED
    for name, error in errors.items():
        bounded = error <= image[f"error_{name}"].values
        # 99.9 %, and one pixel more where they are few.
        assert np.count_nonzero(interpolated & ~bounded) <= 1 + 1e-3 * interpolated.sum()


LONG = ("from repulsive to attractive on a shaker", "from repulsive to attractive, 1.01 of the resonance")


@pytest.mark.parametrize(
    "case",
    [pytest.param(case, id=case.name, marks=[pytest.mark.slow] if case.name in LONG else []) for case in CASES],
)
def test_an_interpolated_image_is_within_the_accuracy_and_its_own_estimates(case: Case) -> None:
    surface, some = case.surface(), slice(None, None, case.every)
    image = pm.simulate(surface, case.scope, case.setpoint)
    part = pm.Surface(surface.modulus[some], surface.adhesion[some], surface.damping[some], pixel_size=1e-9)
    exact = pm.simulate(part, case.scope, case.setpoint, solver="orbit")
    assert_within(image.isel(y=some), exact, 0.01, 1e-12)
    assert (image.solver.values == col.INTERPOLATED).mean() >= case.interpolated


@pytest.mark.slow
def test_a_tighter_accuracy_is_met_too() -> None:
    surface = CASES[0].surface(seed=1)
    accuracy = pm.Accuracy(phase=1e-4, height=1e-14)
    image = pm.simulate(surface, AIR, 0.7, accuracy=accuracy)
    assert_within(image, pm.simulate(surface, AIR, 0.7, solver="orbit"), 1e-4, 1e-14)


def test_the_other_variables_are_as_exact() -> None:
    # Lengths as the height, but thirty times that for the indentation, as the solvers find it; energies as what the
    # phase's error does to them, k u0 A times that for the dissipation.
    surface = CROSSING.surface(seed=2)
    image, exact = pm.simulate(surface, AIR, 0.7), pm.simulate(surface, AIR, 0.7, solver="orbit")
    energy = 40.0 * (20e-9 / 400) * 14e-9 * np.radians(0.01)
    for name, limit in {
        "mean_deflection": 1e-12, "indentation": 3e-11, "tip_offset": 1e-12, "dissipation": np.pi * energy,
        "virial": energy / 2, "amplitude": 1e-18,
    }.items():  # fmt: skip
        assert float(abs(image[name] - exact[name]).max()) <= limit


def test_a_map_of_one_quantity_is_interpolated_along_that_alone() -> None:
    surface = pm.Surface(
        2e9, between(0.05, 0.3, 0, (SIDE, SIDE), False), viscosity=3.0, pixel_size=1e-9, shape=(SIDE, SIDE)
    )
    image = pm.simulate(surface, AIR, 0.7)
    assert_within(image, pm.simulate(surface, AIR, 0.7, solver="orbit"), 0.01, 1e-12)
    assert (image.solver.values == col.INTERPOLATED).mean() > 0.9


def test_a_map_of_the_poisson_ratio_needs_no_coordinate_of_its_own() -> None:
    # Modulus and Poisson's ratio act through the contact stiffness.
    surface = pm.Surface(
        between(1e9, 1e10, 0, (SIDE, SIDE), True), 0.02, poisson_ratio=between(0.2, 0.5, 1, (SIDE, SIDE), False),
        pixel_size=1e-9,
    )  # fmt: skip
    image = pm.simulate(surface, AIR, 0.7)
    assert_within(image, pm.simulate(surface, AIR, 0.7, solver="orbit"), 0.01, 1e-12)
    assert (image.solver.values == col.INTERPOLATED).mean() > 0.99


WET = replace(
    AIR, cantilever=pm.Cantilever(40.0, 300e3, 100.0), drive=pm.Drive(30e-9), interaction=pm.Interaction("capillary")
)


def test_films_of_liquid_are_interpolated_material_by_material_on_what_relaxes_and_what_does_not() -> None:
    film = np.concatenate([between(0.2e-9, 1.5e-9, 3, (30, 36), False), np.zeros((1, 36))])  # and dry places
    soft = np.arange(36) % 2 == 0
    surface = pm.Surface(
        3e9, adhesion=0.05, liquid_film=film, relaxed_modulus=np.where(soft, 2e9, 3e9)[np.newaxis].repeat(31, axis=0),
        relaxation_time=100e-9, contact_angle=np.where(soft, 60.0, 0.0)[np.newaxis].repeat(31, axis=0), pixel_size=1e-9,
    )  # fmt: skip
    image = pm.simulate(surface, WET, setpoint=0.7)
    interpolated = image.solver.values == SOLVER_NAMES.index("interpolated")
    assert interpolated[:-1].all() and not interpolated[-1].any()
    for y, x in ((0, 0), (7, 3), (14, 20), (22, 35), (29, 12), (30, 4)):
        one = pm.Material(
            3e9, 0.05, relaxed_modulus=2e9 if soft[x] else 3e9, relaxation_time=100e-9, liquid_film=film[y, x],
            contact_angle=60.0 if soft[x] else 0.0,
        )  # fmt: skip
        wanted, found = pm.solve_pixel(one, WET, setpoint=0.7), image.isel(y=y, x=x)
        assert abs(found.phase - wanted.phase) < found.error_phase + 1e-6 < 2e-3
        assert abs(found.height - wanted.height) < found.error_height + 1e-15


@pytest.mark.slow
def test_no_film_is_on_a_wrong_branch_where_orbits_jump(monkeypatch: pytest.MonkeyPatch) -> None:
    scope = replace(WET, drive=pm.Drive(12e-9))
    film = between(0.1e-9, 2.5e-9, 1, (40, 40), False)
    surface = pm.Surface(3e9, adhesion=0.05, damping=0.01, liquid_film=film, pixel_size=1e-9)
    image = pm.simulate(surface, scope, setpoint=0.7)
    monkeypatch.setattr(engaged, "MANY", film.size + 1)
    single = pm.simulate(surface, scope, setpoint=0.7)
    assert np.ptp(single.phase.values) > 80.0 and (image.branch == single.branch).all()
    assert (image.solver == SOLVER_NAMES.index("interpolated")).mean() > 0.9
    assert (abs(image.phase - single.phase) <= image.error_phase).all()


@pytest.mark.slow
def test_the_numbers_do_not_depend_on_threads_nor_on_what_is_asked_for() -> None:
    surface = CROSSING.surface(seed=3)
    one, many = pm.simulate(surface, AIR, 0.7, threads=1), pm.simulate(surface, AIR, 0.7, threads=3)
    some = pm.simulate(surface, AIR, 0.7, variables=("height", "virial"))
    assert set(some.data_vars) == {"height", "virial", "status"}
    for name in one.data_vars:
        assert np.array_equal(one[name], many[name], equal_nan=True)
        assert name not in some or np.array_equal(one[name], some[name])


def test_pixels_without_a_material_stay_invalid() -> None:
    modulus = between(1e9, 1e10, 0, (SIDE, SIDE), True)
    modulus[3, 4:9] = np.nan
    surface = pm.Surface(modulus, 0.02, pixel_size=1e-9, allow_nan=True)
    image = pm.simulate(surface, AIR, 0.7)
    assert np.array_equal(image.status == pm.Status.invalid.code, np.isnan(modulus))
    assert np.array_equal(np.isnan(image.phase), np.isnan(modulus))
    assert np.all(image.solver.values[np.isnan(modulus)] == -1)
    with pytest.raises(pm.SolveError, match="5 pixels have no solution; the first is at row 3, column 4"):
        pm.simulate(surface, AIR, 0.7, strict=True)


def test_an_image_without_any_material_is_invalid_throughout() -> None:
    nothing = np.full((SIDE, SIDE), np.nan)
    surface = pm.Surface(nothing, between(0.05, 0.3, 0, nothing.shape, False), pixel_size=1e-9, allow_nan=True)
    assert np.all(pm.simulate(surface, AIR, 0.7).status == pm.Status.invalid.code)


def test_topography_is_added_to_the_height() -> None:
    topography = between(0, 1e-7, 5, (SIDE, SIDE), False)
    plain = CASES[0].surface()
    surface = pm.Surface(plain.modulus, plain.adhesion, plain.damping, topography=topography, pixel_size=1e-9)
    rough, flat = (pm.simulate(s, AIR, 0.7, variables=("height",)) for s in (surface, plain))
    assert np.allclose(rough.height - flat.height, topography, rtol=0, atol=1e-21)


def test_few_materials_are_solved_once_each_and_not_interpolated() -> None:
    few = np.random.default_rng(0).integers(0, 50, (400, 400))
    surface = pm.Surface(1e9 * (1 + few), 0.02, pixel_size=1e-9)
    image = pm.simulate(surface, AIR, 0.7)
    assert image.attrs["distinct_materials"] == 50
    assert not np.any(image.solver == SOLVER_NAMES.index("interpolated"))
    alone = pm.simulate(pm.Surface(1e9 * (1 + np.arange(50.0))[None], 0.02, pixel_size=1e-9), AIR, 0.7)
    assert np.array_equal(image.phase.values, alone.phase.values[0][few])


def test_progress_counts_pixels_to_the_end() -> None:
    seen: list[tuple[int, int]] = []
    image = pm.simulate(CROSSING.surface(), AIR, 0.7, progress=lambda done, total: seen.append((done, total)))
    assert image.attrs["distinct_materials"] == SIDE**2
    assert seen[-1] == (SIDE**2, SIDE**2)
    assert seen == sorted(seen)


@pytest.mark.slow
def test_a_large_image_takes_little_memory_beside_what_is_returned() -> None:
    shape = (1024, 1024)
    surface = surface_of((1e9, 1e10), (0.01, 0.05), (0, 0.05), shape=shape)
    pm.simulate(CASES[0].surface(), AIR, 0.7)  # compiles
    tracemalloc.start()
    image = pm.simulate(surface, AIR, 0.7, variables=("height", "phase"))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # Two float maps and the status are returned. The rest is blocks of 2^15 pixels, the same for an image of any size.
    assert peak - image.nbytes < 64 * 2**20


def with_second_mode(scope: pm.Microscope) -> pm.Microscope:
    lever = scope.cantilever
    mode = pm.Eigenmode(6.267, 1.5 * lever.quality_factor)
    driven = replace(scope.drive, second=pm.Mode(detection="am"))
    return replace(scope, cantilever=replace(lever, modes=(mode,)), drive=driven)


class TestSecondMode:
    """Integrals over orbits that a second mode asks for, interpolated as the orbits are."""

    @pytest.mark.parametrize("case", [CASES[0], CROSSING, CASES[3], CASES[5]], ids=lambda case: case.name)
    def test_its_answer_is_that_of_solved_pixels(self, case: Case) -> None:
        scope, surface = with_second_mode(case.scope), case.surface()
        variables = ("solver", "mode2_amplitude", "mode2_phase")
        image = pm.simulate(surface, scope, case.setpoint, variables=variables)
        rows, columns = np.divmod(np.random.default_rng(3).choice(SIDE**2, 400, replace=False), SIDE)
        values = {
            name: np.asarray(getattr(surface, name))[rows, columns] for name in ("modulus", "adhesion", "damping")
        }
        some = pm.Surface(**{name: value[None] for name, value in values.items()}, pixel_size=1e-9)
        solved = pm.simulate(some, scope, case.setpoint, solver="orbit", variables=variables)
        there = image.solver.values[rows, columns] == SOLVER_NAMES.index("interpolated")
        assert there.mean() > 0.9 * case.interpolated

        def answer(amplitude: np.ndarray, phase: np.ndarray) -> np.ndarray:
            return 1e-10 / amplitude * np.exp(1j * np.radians(90 - phase))

        found = answer(*(image[name].values[rows, columns][there] for name in variables[1:]))
        true = answer(*(solved[name].values.ravel()[there] for name in variables[1:]))
        # Four integrals make the answer, each within OF_ANSWER of its usual size.
        assert abs(found - true).max() < 4 * OF_ANSWER * abs(true).mean()

    @pytest.mark.slow
    def test_it_takes_about_as_many_orbits_as_the_image_without_it(self, monkeypatch: pytest.MonkeyPatch) -> None:
        asked: list[int] = []
        inner = engaged.build

        def build(exact: ExactOrbits, *rest: Any) -> Atlas:
            atlas = inner(exact, *rest)
            asked.append(exact.asked + (exact.bare.asked if exact.bare is not exact else 0))
            return atlas

        monkeypatch.setattr(engaged, "build", build)
        bimodal_scope = with_second_mode(AIR)
        for scope in (replace(bimodal_scope, drive=AIR.drive), bimodal_scope):
            pm.simulate(CROSSING.surface(), scope, 0.7)
        plain, bimodal = asked
        # A row of nodes may be added along one coordinate of a cell, which is no more than half of all orbits; where
        # integrals were rough next to a graze or not continuous, cells were halved again and again.
        assert bimodal < 1.5 * plain


class TestParts:
    def test_an_orbit_without_contact_is_as_deep_whichever_way_it_is_found(self) -> None:
        exact = ExactOrbits(SOFT, 0.7 * SOFT.driven_amplitude, Axes(True, 0.0), 1)
        adhesion = np.linspace(0.1, 0.14, 5)
        points = np.column_stack([np.full(5, np.log(5e8)), np.full(5, 0.01), adhesion])
        engaged_there = exact(points)
        near = exact.near(points, engaged_there, np.full(5, 1e-10), exact.amplitude, 1)
        assert (engaged_there[:, DEPTH] < 0).all()
        # The solvers agree on the height to 1e-14 m; the depth is that of the orbit between two nodes.
        assert np.allclose(near[:, DEPTH], engaged_there[:, DEPTH], rtol=0, atol=3e-14)

    def test_a_jump_lies_where_engagement_jumps(self) -> None:
        exact = ExactOrbits(AIR, 0.7 * AIR.driven_amplitude, Axes(True, 0.0), 1)
        stiffness = np.log(np.array([2e9, 6e9]))
        jump, graze = find_borders(exact, (*stiffness, 0.0, 0.0), 0.05, 0.3)
        assert (jump.sudden, graze.sudden) == (True, False)
        x0, x1 = np.log(np.array([2.3e9, 3.7e9, 5.1e9])), np.zeros(3)
        height = jump.height(x0, x1)
        assert jump.error < 1e-5 * height.min()
        for share, sign in ((-1, 1), (1, -1)):
            phase = exact(np.column_stack([x0, x1, height * (1 + 5e-5 * share)]))[:, 1]
            assert np.all(np.sign(phase) == sign)
        depth = exact(np.column_stack([x0, x1, graze.height(x0, x1)]))[:, 3]
        assert np.all(abs(depth) < 1e-14)

    def test_no_border_is_looked_for_where_few_materials_lie(self) -> None:
        exact = ExactOrbits(AIR, 0.7 * AIR.driven_amplitude, Axes(True, 0.0), 1)
        box, low, high = (*np.log(np.array([2e9, 6e9])), 0.0, 0.0), 0.05, 0.3
        lowest = find_borders(exact, box, low, high)[0].height(np.array(box[:2]), np.zeros(2)).min()
        with pytest.raises(Undecided) as raised:
            find_borders(exact, box, low, high, few=0.7 * lowest)
        assert raised.value.below is not None and 0.7 * lowest < raised.value.below < lowest

    def test_coordinates_go_there_and_back(self) -> None:
        stiffness, adhesion, damping = np.array([0.0, 1e8, 1e11]), np.array([0.0, 0.1, 0.2]), np.array([0.0, 1e-3, 2])
        for first in (0, 1):
            axes = Axes.covering(stiffness[first:], damping[first:])
            back = axes.materials(axes.points(stiffness[first:], adhesion[first:], damping[first:]))
            for given, got in zip((stiffness, adhesion, damping), back, strict=True):
                assert np.allclose(given[first:], got, rtol=1e-12, atol=1e-15)

    @pytest.mark.parametrize("form", [kernel.EVEN_PLACE, kernel.ROOT_LOW, kernel.ROOT_HIGH, kernel.ROOT_BOTH])
    def test_the_kernel_sums_what_numpy_sums_and_compiled_what_plain_python_does(self, form: int) -> None:
        rng = np.random.default_rng(form)
        cell = Cell((-1.0, 2.0, 0.0, 1.0, 0.1, 1.0), 0.5, 2.0, form)
        coefficients = rng.standard_normal((3, 4, 5, 6))
        atlas = Atlas.of([[kernel.LEAF, 0, -1, -1]], [0.0], [], [FilledCell(cell, coefficients, np.zeros(2))])
        points = np.column_stack([rng.uniform(-1, 2, 50), rng.uniform(0, 1, 50), rng.uniform(0.4, 2.1, 50)])
        piece, values = atlas(np.ascontiguousarray(points.T), np.arange(6))
        inside = (abs(cell.inside(points)) <= 1).all(axis=1) & (points[:, 2] >= 0.5) & (points[:, 2] <= 2.0)
        assert np.array_equal(piece[inside], np.zeros(inside.sum()))
        expected = evaluate(coefficients, cell.inside(points))
        assert np.allclose(values.T[inside], expected[inside], rtol=0, atol=1e-12)
        assert np.isnan(values[:, piece < 0]).all()
        again, where = np.empty(50, np.int32), np.empty((3, 50))
        kernel.locate_pieces.py_func(np.ascontiguousarray(points.T), atlas.tree, again, where)
        assert np.array_equal(again, piece)
