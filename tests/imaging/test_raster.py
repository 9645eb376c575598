"""Quasi-static scans: which branch the tip is on, pixel by pixel, against a walk in plain Python over every orbit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from cases import Case, label, load, material_of, scope_of
from hypothesis import given, settings
from hypothesis import strategies as st

import phasemap as pm
from phasemap._kernels.columns import ERROR_PHASE, INTERPOLATED
from phasemap.imaging import raster
from phasemap.solvers.both_branches import stable_branches
from phasemap.solvers.problem import work_of_material
from phasemap.solvers.solver import by_name

SCOPE = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(16e-9))
SETPOINT = 0.8
PULLED = pm.Material(1e9, adhesion=0.1, damping=0.05)  # has an attractive orbit only
PUSHED = pm.Material(2e9, adhesion=0.02)  # has a repulsive orbit only
PLAIN = pm.Material(5e9)  # the same, without any attraction
BOTH = pm.Material(2e9, adhesion=0.1)  # has both, and engagement finds the attractive one
MATERIALS = {0: PULLED, 1: PUSHED, 2: BOTH, 3: PLAIN}
NONE, ATTRACTIVE, REPULSIVE = -1, 0, 1

# "orbit" leaves what it estimates as 1e-3 degree and 1 pm; averaging is off by up to 0.15 degree in air at this Q.
PHASE = {"auto": 0.02, "averaging": 0.15, "orbit": 1e-3, "march": 1e-3}


def surface_of(labels: Sequence[Sequence[int]]) -> pm.Surface:
    return pm.Surface.from_labels(np.array(labels), MATERIALS, pixel_size=2e-9)


def scan(surface: pm.Surface, engage: str = "line", solver: str = "orbit", threads: int | None = 1) -> xr.Dataset:
    return pm.simulate(surface, SCOPE, SETPOINT, solver, pm.Raster(engage), threads=threads)


def branches_of(image: xr.Dataset) -> list[list[list[int]]]:
    return list(image.branch.values.tolist())


def held(material: pm.Material, scope: pm.Microscope = SCOPE, setpoint: float = SETPOINT) -> dict[int, float]:
    """Phase of the orbit that a tip can stay on, by branch, out of all orbits there are."""
    found = pm.orbits(material, scope, setpoint=setpoint)
    good = (found.stable.values == 1) & (found.feedback_slope.values > 0)
    nearest_first = found.isel(orbit=np.flatnonzero(good)[::-1])
    return dict(zip(nearest_first.branch.values.tolist(), nearest_first.phase.values.tolist(), strict=True))


def walk(line: Sequence[int], known: Sequence[dict[int, float]], engaged: Sequence[int], branch: int) -> list[int]:
    """The rule: stay where that is possible, else go to the other branch; a pixel without either changes nothing."""
    seen = []
    for material in line:
        if branch == NONE:
            branch = engaged[material]
            seen.append(branch)
            continue
        if branch not in known[material] and 1 - branch in known[material]:
            branch = 1 - branch
        seen.append(branch if branch in known[material] else NONE)
    return [branch, *seen]


def walked(
    labels: np.ndarray, known: Sequence[dict[int, float]], engaged: Sequence[int], engage: str
) -> tuple[list[list[int]], list[list[int]]]:
    trace, retrace, branch = [], [], NONE
    for line in labels.tolist():
        branch, *there = walk(line, known, engaged, NONE if engage == "line" else branch)
        branch, *back = walk(line[::-1], known, engaged, branch)
        trace.append(there)
        retrace.append(back[::-1])
    return trace, retrace


@pytest.mark.parametrize("solver", ["auto", "averaging", "orbit", "march"])
def test_where_one_orbit_holds_the_setpoint_both_directions_are_the_engaged_image(solver: str) -> None:
    labels = [[0, 1, 3, 0], [3, 3, 1, 0]]
    surface = pm.Surface.from_labels(np.array(labels), MATERIALS, pixel_size=2e-9, topography=np.eye(2, 4) * 1e-9)
    expected, image = pm.simulate(surface, SCOPE, SETPOINT, solver), scan(surface, solver=solver)
    assert image.phase.dims == ("direction", "y", "x")
    assert image.direction.values.tolist() == ["trace", "retrace"]
    for direction in ("trace", "retrace"):
        for name in expected.data_vars:
            seen = image[name].sel(direction=direction)
            assert np.array_equal(seen, expected[name], equal_nan=expected[name].dtype.kind == "f")


@pytest.mark.parametrize("solver", ["auto", "averaging", "orbit", "march"])
def test_a_bistable_material_keeps_the_branch_on_which_the_tip_comes(solver: str) -> None:
    line = [1, 2, 2, 0, 2, 2, 1]
    image = scan(surface_of([line]), solver=solver)
    there, back = [1, 1, 1, 0, 0, 0, 1], [1, 0, 0, 0, 1, 1, 1]
    assert branches_of(image) == [[there], [back]]
    phases = {number: held(material) for number, material in MATERIALS.items()}
    expected = [[[phases[m][b] for m, b in zip(line, branch, strict=True)]] for branch in (there, back)]
    assert np.abs(image.phase.values - expected).max() < PHASE[solver]
    assert np.all(image.status == 0)


def test_trace_and_retrace_differ_nowhere_but_in_bistable_pixels() -> None:
    labels = np.random.default_rng(3).integers(0, 4, (20, 20))
    image = scan(surface_of(labels.tolist()))
    apart = image.phase.values[0] != image.phase.values[1]
    assert apart.any() and np.all(labels[apart] == 2)
    assert np.array_equal(apart, image.height.values[0] != image.height.values[1])


@pytest.mark.parametrize("engage", ["line", "image"])
def test_the_branch_is_that_of_a_walk_over_every_orbit(engage: str) -> None:
    rng = np.random.default_rng(7)
    materials = [
        pm.Material(10 ** rng.uniform(8.5, 10), adhesion=rng.uniform(0.05, 0.15), damping=rng.uniform(0, 0.03))
        for _ in range(10)
    ]
    labels = rng.integers(0, len(materials), (6, 16))
    surface = pm.Surface.from_labels(labels, dict(enumerate(materials)), pixel_size=2e-9)
    image = scan(surface, engage)
    known = [held(material) for material in materials]
    assert {len(phases) for phases in known} == {1, 2}
    engaged = [int(pm.solve_pixel(m, SCOPE, SETPOINT, "orbit").branch == "repulsive") for m in materials]
    expected = walked(labels, known, engaged, engage)
    assert branches_of(image) == [expected[0], expected[1]]
    for direction in range(2):
        phases = [
            [known[m][b] for m, b in zip(*line, strict=True)] for line in zip(labels, expected[direction], strict=True)
        ]
        assert np.abs(image.phase.values[direction] - phases).max() < PHASE["orbit"]


def test_a_tip_that_is_engaged_once_carries_its_branch_over_the_lines() -> None:
    surface = surface_of([[1, 1], [2, 2], [2, 0], [2, 2]])
    anew, once = scan(surface, "line"), scan(surface, "image")
    assert branches_of(anew) == [[[1, 1], [0, 0], [0, 0], [0, 0]]] * 2
    # The third line is left on the attractive branch, which the fourth keeps.
    assert branches_of(once) == [[[1, 1], [1, 1], [1, 0], [0, 0]], [[1, 1], [1, 1], [0, 0], [0, 0]]]


def test_retrace_goes_on_from_where_trace_ended() -> None:
    image = scan(surface_of([[2, 2, 1]]))
    assert branches_of(image) == [[[0, 0, 1]], [[1, 1, 1]]]


def test_a_pixel_without_material_is_flagged_and_changes_nothing() -> None:
    modulus = np.array([[PUSHED.modulus, np.nan, BOTH.modulus]])
    surface = pm.Surface(modulus, adhesion=[[0.02, 0.1, 0.1]], pixel_size=2e-9, allow_nan=True)
    image = scan(surface)
    assert branches_of(image) == [[[1, -1, 1]]] * 2
    assert image.status.values.tolist() == [[[0, pm.Status.invalid.code, 0]]] * 2
    assert np.isnan(image.phase.values[:, 0, 1]).all() and np.isfinite(image.phase.values[:, 0, ::2]).all()


def test_a_march_under_two_drives_is_refused_for_it_is_engaged_from_far() -> None:
    lever, drive = pm.Cantilever(40.0, 300e3, 400.0, modes=2), pm.Drive(16e-9, second=pm.Mode())
    with pytest.raises(pm.InputError, match=r"solver is 'march'; allowed: .* the drive has a second mode"):
        pm.simulate(surface_of([[0]]), replace(SCOPE, cantilever=lever, drive=drive), SETPOINT, "march", pm.Raster())


def test_a_tip_is_engaged_at_the_first_pixel_where_it_can_be() -> None:
    modulus = np.array([[np.nan, BOTH.modulus, PUSHED.modulus]])
    surface = pm.Surface(modulus, adhesion=[[0.1, 0.1, 0.02]], pixel_size=2e-9, allow_nan=True)
    assert branches_of(scan(surface)) == [[[-1, 0, 1]], [[-1, 1, 1]]]


def stable_of(case: Case) -> list[Case]:
    """Stable reference orbits, from far to near."""
    return sorted((orbit for orbit in case["orbits"] if orbit["floquet"] < 1), key=lambda orbit: -orbit["tip_offset"])


BISTABLE = [
    case
    for name in ("orbits", "orbits_unseen", "engaged")
    for case in load(name)
    if case.get("contact", "dmt") == "dmt" and [orbit["phase"] > 0 for orbit in stable_of(case)] == [False, True]
]


@pytest.mark.parametrize("case", BISTABLE, ids=label)
def test_both_branches_are_the_stable_reference_orbits(case: Case) -> None:
    scope = scope_of(case)
    work = work_of_material(material_of(case), scope, case["setpoint"] * scope.driven_amplitude)
    found = stable_branches(work, by_name("orbit"), pm.Accuracy())
    seen = np.degrees(found.rows[:2, 0, 2])
    far, near = stable_of(case)
    assert found.stable.all()
    assert np.abs(seen - [far["phase"], near["phase"]]).max() < 1e-4
    assert np.abs(found.rows[:2, 0, 0] - [far["tip_offset"], near["tip_offset"]]).max() < 1e-13


def test_an_orbit_that_a_strong_pull_throws_out_is_found_as_time_finds_it() -> None:
    # The contact of the averaged orbit is too deep: from there neither Newton's method nor the curve leads to it.
    material = pm.Material(47e9, adhesion=0.3, damping=0.024)
    scope = pm.Microscope(pm.Cantilever(5.3, 300e3, 90.0), pm.Tip(39e-9), pm.Drive(6.4e-9))
    work = work_of_material(material, scope, 0.43 * scope.driven_amplitude)
    exact, marched = (stable_branches(work, by_name(name), pm.Accuracy()) for name in ("orbit", "march"))
    assert exact.stable.all() and marched.stable.all()
    assert np.abs(np.degrees(exact.rows[:2, 0, 2] - marched.rows[:2, 0, 2])).max() < 1e-4
    assert np.abs(exact.rows[:2, 0, 0] - marched.rows[:2, 0, 0]).max() < 1e-13
    every = pm.orbits(material, scope, setpoint=0.43)
    stable = every.where((every.stable == 1) & (every.feedback_slope > 0), drop=True)
    # Two searches of orbits, each as exact as it is stated to be.
    stated = np.degrees(exact.rows[:2, 0, ERROR_PHASE].max())
    assert np.abs(np.sort(stable.phase) - np.sort(np.degrees(exact.rows[:2, 0, 2]))).max() < 1e-6 + stated


def test_a_tip_comes_to_the_motion_that_time_finds_where_no_curve_of_orbits_leads() -> None:
    scope = pm.Microscope(pm.Cantilever(2.2, 300e3, 3.4), pm.Tip(28e-9), pm.Drive(6.5e-9))
    restless, smooth = pm.Material(18e9, adhesion=0.23, damping=0.03), pm.Material(5e9)
    alone = pm.solve_pixel(restless, scope, 0.7, "orbit")
    surface = pm.Surface.from_labels(np.array([[0, 1, 0]]), {0: restless, 1: smooth}, pixel_size=2e-9)
    image = pm.simulate(surface, scope, 0.7, "orbit", pm.Raster(), threads=1)
    assert (alone.status, alone.solver, alone.branch) == (pm.Status.good, "march", "repulsive")
    assert branches_of(image) == [[[1, 1, 1]]] * 2
    assert (image.status == 0).all()
    assert (image.phase[:, 0, 0] == alone.phase).all()


def test_the_number_of_threads_does_not_change_a_byte() -> None:
    rng = np.random.default_rng(1)
    surface = pm.Surface(
        rng.uniform(1e9, 4e9, (20, 20)), adhesion=rng.uniform(0.05, 0.15, (20, 20)), damping=0.01, pixel_size=2e-9
    )
    one, three = (scan(surface, threads=threads) for threads in (1, 3))
    assert (one.branch.values[0] != one.branch.values[1]).any()
    assert all(one[name].values.tobytes() == three[name].values.tobytes() for name in one.data_vars)


@pytest.mark.slow
def test_on_a_shaker_a_scan_that_is_interpolated_has_the_branches_and_phases_of_exact_orbits() -> None:
    scope = replace(SCOPE, drive=pm.Drive(16e-9, excitation="base"))
    rng, shape = np.random.default_rng(3), (69, 120)
    surface = pm.Surface(rng.uniform(1e9, 4e9, shape), rng.uniform(0.02, 0.2, shape), 0.05, pixel_size=2e-9)
    image = pm.simulate(surface, scope, SETPOINT, control=pm.Raster("image"), variables=["phase", "branch", "solver"])
    some = slice(0, 2)
    exact = pm.simulate(surface.rows(some), scope, SETPOINT, "orbit", pm.Raster("image"))
    image = image.isel(y=some)
    assert (image.solver == INTERPOLATED).mean() > 0.2
    assert {0, 1} == set(np.unique(exact.branch))
    assert np.array_equal(image.branch, exact.branch)
    assert np.nanmax(abs(image.phase.values - exact.phase.values)) < 0.01


@pytest.mark.parametrize("engage", ["line", "image"])
def test_an_image_of_too_many_materials_is_worked_in_blocks_of_lines(
    engage: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(2)
    surface = pm.Surface(
        rng.choice([1e9, 2e9, 4e9, 8e9], (9, 6)),
        adhesion=rng.choice([0.02, 0.1], (9, 6)),
        damping=0.01,
        pixel_size=2e-9,
    )
    seen: list[tuple[int, int]] = []
    expected = scan(surface, engage)
    monkeypatch.setattr(raster, "MOST", 6)
    image = pm.simulate(
        surface, SCOPE, SETPOINT, "orbit", pm.Raster(engage), progress=lambda *done: seen.append(done), threads=1
    )
    assert all(np.array_equal(image[name], expected[name]) for name in ("phase", "height", "branch", "status"))
    assert image.attrs["distinct_materials"] == 54  # too many to count: as many as pixels
    assert len(seen) > 1 and seen[-1] == (54, 54) and seen == sorted(seen)


@pytest.mark.parametrize("engage", ["line", "image"])
def test_where_every_pixel_differs_what_engagement_finds_is_interpolated_and_no_branch_changes(
    engage: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    y, x = np.mgrid[:96, :96] / 96
    adhesion = 0.07 + 0.05 * np.sin(7 * x) * np.cos(5 * y)
    surface = pm.Surface(1e9 * 3**y, adhesion, damping=0.06, pixel_size=2e-9)
    image = scan(surface, engage, "auto")
    monkeypatch.setattr(raster, "interpolates", lambda job: False)
    solved = scan(surface, engage, "auto")
    assert image.branch.equals(solved.branch) and (image.status == solved.status).all()
    assert 0.05 < float((image.branch == ATTRACTIVE).mean()) < 0.95 and (image.branch[0] != image.branch[1]).any()
    assert float((image.solver == INTERPOLATED).mean()) > 0.5
    for name in ("phase", "height"):  # two stated errors between them
        apart = abs(image[name] - solved[name])
        assert (apart <= image[f"error_{name}"] + solved[f"error_{name}"]).all()


def test_progress_counts_distinct_materials_to_the_end() -> None:
    surface = pm.Surface(np.geomspace(1e9, 4e9, 60).reshape(6, 10), adhesion=0.1, pixel_size=2e-9)
    seen: list[tuple[int, int]] = []
    pm.simulate(surface, SCOPE, SETPOINT, "orbit", pm.Raster(), progress=lambda *done: seen.append(done), threads=1)
    assert seen[-1] == (60, 60) and seen == sorted(seen)


LINES = st.lists(st.lists(st.integers(0, 4), min_size=5, max_size=5), min_size=1, max_size=6)
TABLE = st.lists(st.sampled_from([(), (0,), (1,), (0, 1)]), min_size=5, max_size=5)


@settings(max_examples=200, deadline=None)
@given(lines=LINES, table=TABLE, engage=st.sampled_from(["line", "image"]), data=st.data())
def test_any_scan_over_any_materials_obeys_the_rule(
    lines: list[list[int]], table: list[tuple[int, ...]], engage: str, data: st.DataObject
) -> None:
    from phasemap._kernels.columns import StableOrbits
    from phasemap._kernels.scanning.quasi_static import walk_line as compiled

    engaged = [data.draw(st.sampled_from([*branches, NONE])) for branches in table]
    known = [dict.fromkeys(branches, 0.0) for branches in table]
    labels, slots = np.array(lines, np.int32), np.empty((2, len(lines), 5), np.int8)
    stable = np.array([[branch in phases for phases in known] for branch in (0, 1)], np.int8)
    everywhere = np.zeros((3, len(table))), np.full((2, len(table)), np.inf)
    compiled(labels, StableOrbits(stable, np.array(engaged, np.int8), *everywhere), engage == "line", NONE, 0.0, slots)
    seen = np.where(slots == 2, NONE, slots)
    expected = walked(labels, known, engaged, engage)
    assert [seen[0].tolist(), seen[1].tolist()] == [expected[0], expected[1]]


def test_a_scene_can_ask_for_it(tmp_path: Path) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(
        """
        [scan]
        setpoint = 0.8
        [surface]
        kind = "labels"
        labels = [[0, 1]]
        materials = ["stiff", "sticky"]
        pixel_size = 2e-9
        [materials.stiff]
        modulus = 2e9
        adhesion = 0.02
        [materials.sticky]
        modulus = 2e9
        adhesion = 0.1
        [cantilever]
        stiffness = 40.0
        resonance_frequency = 300e3
        quality_factor = 400.0
        [tip]
        radius = 10e-9
        [drive]
        free_amplitude = 16e-9
        [control]
        kind = "raster"
        engage = "image"
        """
    )
    asked = pm.load_scene(scene)
    assert asked.options["control"] == pm.Raster(engage="image")
    image = pm.simulate(asked.surface, asked.microscope, **asked.options)
    assert branches_of(image) == [[[1, 1]]] * 2
