"""The bench: its reference against independent orbits, what it reports, and the ranking that the README claims."""

from __future__ import annotations

import itertools
import json
import math
import re
import time
from collections.abc import Iterable
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from importlib.util import find_spec
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from cases import Case as StoredCase
from cases import label, load

import phasemap as pm
from benchmarks import accuracy, extras
from benchmarks import compile as compilation
from benchmarks.accuracy import cases, picture
from benchmarks.accuracy import measure as measuring
from benchmarks.accuracy.equation import Case, Equation
from benchmarks.accuracy.measure import Plan, measure
from benchmarks.accuracy.methods import methods_of
from benchmarks.accuracy.peers import PEERS, Peer, installed
from benchmarks.accuracy.peers.shooting import constants
from benchmarks.accuracy.picture import draw as draw_picture
from benchmarks.accuracy.ranking import cheapest, failures, meets, period_time_at
from benchmarks.accuracy.record import NO_REFERENCE, PARAMETERS
from benchmarks.accuracy.reference import NoOrbit, Start, find_orbit
from benchmarks.accuracy.regimes import REGIMES, draw
from benchmarks.accuracy.report import LEVELS, listing, table
from benchmarks.curves import measure_curves
from phasemap.cli import main
from phasemap.cli.kinds_of_work import KINDS, Cost
from phasemap.io.netcdf import load as read
from phasemap.io.netcdf import save

# What docs/accuracy.md claims of "orbit", as ratios of time per pixel at equal error in one run. The margins are wide:
# a test machine is shared, and few pixels are timed.
FASTER_THAN = {"march": 2.0, "numbalsoda": 5.0, "heyoka": 5.0, "scipy": 100.0}
IN_AIR = ("air, hard sample", "air, soft sample")


@pytest.fixture(scope="module")
def measured() -> xr.Dataset:
    """A small run over all regimes, with the peers that are installed."""
    said: list[str] = []
    plan = Plan(batches=2, timed=8, references=1, seed=3, budget=0.02, rounds=1, cold=False)
    ds = measure(plan, *installed(), said.append)
    assert any("reference orbits of bistable: 2 of 2" in line for line in said)
    return ds


def case_of(stored: StoredCase, **changes: Any) -> Case:
    """A case of tests/data as the bench's own."""
    numbers = {name: stored[name] for name in Case.__dataclass_fields__ if stored.get(name) is not None}
    return replace(Case(**{**numbers, "radius": stored["tip_radius"]}), **changes)


# The reference.

SEVERAL = [c for c in load("orbits") if c["damping"] > 0][:8] + [
    c
    for c in load("orbits_unseen")
    if c["name"]
    in ("Hertz", "DMT, no long range", "damping exponent 1", "drive 0.99", "elastic tip", "modulus 1e12 Pa")
]


@pytest.mark.parametrize("stored", SEVERAL, ids=label)
def test_the_reference_reproduces_orbits_that_another_code_found(stored: StoredCase) -> None:
    # tests/data was computed by tests/reference, in other variables, and is good to 1e-6 degree and 1e-4 pm.
    for orbit in stored["orbits"]:
        found = find_orbit(case_of(stored), Start(orbit["tip_offset"], orbit["mean_deflection"], orbit["phase"]))
        assert abs(found.phase - orbit["phase"]) < 1e-5
        assert abs(found.tip_offset - orbit["tip_offset"]) < 1e-15
        assert abs(found.mean_deflection - orbit["mean_deflection"]) < 1e-15
        assert (found.floquet < 1) == (orbit["floquet"] < 1)
        assert found.phase_uncertainty < 1e-6
        assert found.height_uncertainty < 1e-16


def test_a_poor_start_leads_to_the_same_reference() -> None:
    stored = load("orbits")[0]
    (orbit,) = stored["orbits"]
    good = find_orbit(case_of(stored), Start(orbit["tip_offset"], orbit["mean_deflection"], orbit["phase"]))
    poor = find_orbit(case_of(stored), Start(orbit["tip_offset"] + 3e-11, 0.0, orbit["phase"] - 0.5))
    assert abs(good.phase - poor.phase) < 1e-7
    assert abs(good.tip_offset - poor.tip_offset) < 1e-18


def test_a_reference_that_does_not_converge_says_so() -> None:
    with pytest.raises(NoOrbit):
        find_orbit(case_of(load("orbits")[0]), Start(1e-6, 0.0, 10.0))  # far above the surface no orbit is that small


def test_the_reference_writes_the_same_physics_that_the_solvers_are_given() -> None:
    # Two sets of formulas, from material to force: this is what makes them one problem.
    for regime in REGIMES:
        (batch,) = draw(regime, 1, 3, np.random.default_rng(2))
        work = batch.work()
        for i in range(len(batch)):
            case = batch.case(i)
            a, k, row = case.amplitude, case.stiffness, work.rows[i]
            equation = Equation.of(case)
            assert a == pytest.approx(work.amplitudes[i], rel=1e-14)
            assert equation.stiff == pytest.approx(row[0] * math.sqrt(a) / k, rel=1e-12)
            assert equation.pull == pytest.approx(row[1] / (k * a), rel=1e-12)
            assert equation.loss == pytest.approx(row[8] * math.sqrt(a), rel=1e-12)
            assert equation.decay * row[5] == pytest.approx(1 / a if equation.decay else 0)
            assert [equation.omega, equation.alpha0, equation.base * a] == pytest.approx(
                work.lever[[0, 1, 3]], rel=1e-14
            )


# Regimes.


def test_the_same_seed_draws_the_same_cases() -> None:
    for regime in REGIMES:
        one, two, other = (draw(regime, 1, 4, np.random.default_rng(seed))[0] for seed in (5, 5, 6))
        assert np.array_equal(one.materials, two.materials) and one.scope == two.scope
        assert not np.array_equal(one.materials, other.materials)


def test_bistable_cases_have_a_stable_orbit_on_both_branches() -> None:
    (batch,) = draw(next(r for r in REGIMES if r.name == "bistable"), 1, 3, np.random.default_rng(1))
    for modulus, adhesion, damping, poisson_ratio in batch.materials:
        material = pm.Material(modulus, adhesion=adhesion, damping=damping, poisson_ratio=poisson_ratio)
        found = pm.orbits(material, batch.scope, setpoint=batch.setpoint)
        held = (found.floquet.values < 1) & (found.feedback_slope.values > 0)
        assert set(found.branch.values[held].tolist()) == {0, 1}


def test_every_pixel_of_the_mixed_image_is_a_material_of_its_own() -> None:
    (batch,) = draw(next(r for r in REGIMES if r.name == "mixed image"), 1, 300, np.random.default_rng(1))
    assert len(np.unique(batch.materials, axis=0)) == 300


# Peers.


@pytest.mark.parametrize("peer", PEERS, ids=lambda peer: peer.name)
@pytest.mark.parametrize("regime", ["air", "low Q"])
def test_a_peer_solves_the_same_equation(peer: Peer, regime: str) -> None:
    if find_spec(peer.name) is None:
        pytest.skip(f"{peer.name} is not installed")
    stored = next(c for c in load("orbits") if c["regime"] == regime)
    (orbit,), case = stored["orbits"], case_of(stored)
    shoot, _ = peer.prepare(peer.tolerances[-1])
    a = case.amplitude
    start = np.array([orbit["mean_deflection"] / a - 1, 0.0, orbit["tip_offset"] / a])
    tip_offset, phase, converged = shoot(constants(Equation.of(case), math.radians(orbit["phase"])), start)
    assert converged
    assert abs(math.degrees(phase) - orbit["phase"]) < 1e-4  # scipy's at 1e-9; the others are far better
    assert abs(tip_offset * a - orbit["tip_offset"]) < 1e-14


def test_peers_refuse_an_equation_that_they_do_not_know() -> None:
    case = case_of(load("orbits")[0], damping_exponent=1.0)
    with pytest.raises(ValueError, match="exponent 1/2"):
        constants(Equation.of(case), 0.0)


# What is measured.


@pytest.mark.slow
def test_the_dataset_has_everything_with_units(measured: xr.Dataset, tmp_path: Path) -> None:
    assert measured.sizes == {"regime": len(REGIMES), "solver": len(methods_of(installed()[0])), "case": 2}
    for name, variable in measured.data_vars.items():
        assert variable.attrs["long_name"], name
        assert "units" in variable.attrs or "flag_meanings" in variable.attrs, name
    assert {"averaging", "auto", "orbit", "march", "scipy"} <= set(measured["family"].values)
    assert json.loads(measured.attrs["configuration"])["seed"] == measured.attrs["seed"] == 3
    assert "numpy" in measured.attrs["versions"] and "core" in measured.attrs["machine"]
    assert read(save(measured, tmp_path / "bench.nc")).identical(measured)


@pytest.mark.slow
def test_every_case_has_a_reference_or_says_why_not(measured: xr.Dataset) -> None:
    found = measured["reference"] == cases.FOUND
    assert np.array_equal(found, np.isfinite(measured["reference_phase"]))
    assert found.mean() > 0.9
    compared = measured["result"].transpose("regime", "case", "solver") != NO_REFERENCE
    assert np.array_equal(compared.all("solver"), found)
    assert np.all(measured["reference_floquet"].values[found] < 1)


@pytest.mark.slow
def test_times_are_measured_for_every_method(measured: xr.Dataset) -> None:
    assert np.all(measured["time"] > 0)
    assert np.all(measured["compile_time"] >= 0)
    integrators = np.isin(measured["family"], ["march", *(peer.name for peer in PEERS)])
    assert np.all(measured["period_time"].values[:, integrators] > 0)
    assert np.isnan(measured["period_time"].values[:, ~integrators]).all()


@pytest.mark.slow
def test_exact_orbits_are_exact(measured: xr.Dataset) -> None:
    orbit = measured.sel(solver="orbit")
    assert failures(measured).sel(solver="orbit").sum() == 0
    assert abs(orbit["phase_error"]).max() < 1e-3
    assert abs(orbit["height_error"]).max() < 1e-12


@pytest.mark.slow
def test_the_march_converges_towards_the_reference(measured: xr.Dataset) -> None:
    errors = abs(measured["phase_error"]).median("case").isel(solver=measured["family"].values == "march")
    assert np.all(errors.values[:, 0] > 10 * errors.values[:, -1])


@pytest.mark.slow
def test_the_ranking_is_that_of_the_readme(measured: xr.Dataset) -> None:
    for phase, height in LEVELS:
        found = cheapest(measured, phase, height)
        for r, regime in enumerate(measured["regime"].values):
            if regime not in IN_AIR:
                continue
            orbit, _ = found["orbit"][r]
            for family in FASTER_THAN.keys() & found.keys():  # peers that are not installed are not there
                factor, (other, _) = FASTER_THAN[family], found[family][r]
                # NaN: not reached at any tolerance, which is no faster.
                assert not other < factor * orbit, (
                    f"{regime}: {family} {1e6 * other:.3g} µs, orbit {1e6 * orbit:.3g} µs"
                )


# Reports; most on made-up numbers, which say what the answer must be.


def made_up() -> xr.Dataset:
    """One regime and three cases: a fast method that misses by far on one of them, and a slow one at two tolerances."""
    error = [[[1e-5, 1e-5, 45.0], [1e-3, 1e-3, 1e-3], [1e-6, 1e-6, np.nan]]]
    result = [[[0, 0, 2], [0, 0, 0], [0, 0, 1]]]
    dims = ("regime", "solver", "case")
    parameters = {name: (("regime", "case"), np.full((1, 3), 0.5)) for name in PARAMETERS}
    own = {
        f"reference_{n}_uncertainty": (("regime", "case"), np.full((1, 3), x))
        for n, x in (("phase", 1e-8), ("height", 1e-18))
    }
    return xr.Dataset(
        {
            "phase_error": (dims, error),
            "height_error": (dims, 1e-10 * np.array(error)),
            "phase_bound": (dims, [[[2e-5, 1e-6, np.nan], [np.nan] * 3, [np.nan] * 3]]),
            "height_bound": (dims, [[[1.0, 1.0, np.nan], [np.nan] * 3, [np.nan] * 3]]),
            "result": (dims, np.array(result, np.int8)),
            "time": (dims[:2], [[1e-6, 2e-5, 4e-5]]),
            "period_time": (dims[:2], [[np.nan, 1e-6, 4e-6]]),
            "compile_time": ("solver", [1.0, 2.0, 3.0]),
            "reference": (("regime", "case"), np.array([[0, 0, 0]], np.int8)),
            **parameters,
            **own,
        },
        {"regime": ["here"], "solver": ["fast", "slow 1", "slow 2"], "family": ("solver", ["fast", "slow", "slow"])},
        {"seed": 1, "machine": "M", "versions": "V", "seconds": 1.0, "timed_pixels": 9, "not_installed": "heyoka",
         "compilation": "C"},
    )  # fmt: skip


def test_a_method_that_fails_on_a_third_of_the_cases_does_not_meet_an_accuracy() -> None:
    ds = made_up()
    assert meets(ds, 0.01, 1e-12).values.tolist() == [[False, True, False]]
    assert cheapest(ds, 0.01, 1e-12) == {
        "fast": [(pytest.approx(float("nan"), nan_ok=True), "")],
        "slow": [(2e-5, "slow 1")],
    }


def test_the_time_of_a_period_lies_between_those_of_two_tolerances() -> None:
    ds = made_up()
    assert period_time_at(ds, 10**-4.5) == {"slow": [pytest.approx(2e-6)]}
    assert math.isnan(period_time_at(ds, 1.0)["slow"][0])


def test_the_table_says_times_errors_failures_and_what_was_left_out() -> None:
    said = table(made_up())
    assert "| fast | — |" in said and "| slow | **20 (1)** |" in said
    assert "| slow 2 | 40 | 3 | 1 of 3 |" in said
    assert "| fast | 1.0e-5 / 44 / 45 |" in said
    assert "not installed: heyoka." in said
    assert "it bounds the true one on 1 of 2 pixels" in said


@pytest.mark.slow
def test_the_table_has_what_more_than_an_image_costs(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, size in (("QUICK_SIZE", 32), ("SOLVED", 8), ("QUICK_TURNS", 1)):
        monkeypatch.setattr(extras, name, size)
    measured = extras.measure_extras(True, 1, lambda text: None)
    assert (measured.extra_time > 0).all() and (measured.extra_plain > 0).all()
    said = table(made_up().merge(measured).assign_attrs(made_up().attrs))
    for name in ("four derived channels, interpolated", "a second mode, solved", "one relaxation time, marched"):
        assert f"| {name} | " in said


def test_the_table_has_images_on_one_core_and_on_all_and_curves() -> None:
    image = {
        "size": 64,
        "time": 0.5,
        "time_alone": 0.9,
        "interpolated": 0.25,
        "phase_error": 2e-4,
        "height_error": 1e-14,
        "bounded": 1,
    }
    images = xr.Dataset(
        {f"image_{name}": ("image", [value]) for name, value in image.items()},
        {"image": ["one"]}, {"image_checked": 9, "image_threads": 2},
    )  # fmt: skip
    curves = measure_curves(lambda text: None)
    said = table(made_up().merge(images).merge(curves).assign_attrs(made_up().attrs | images.attrs | curves.attrs))
    assert "| one | 64 x 64 | 0.5 | 0.9 | 90 % | 25 % | 0.0002 | 0.01 | 100 % |" in said
    assert re.search(r"^\| distance \| \S+ \| \d+ \| 2 \|$", said, re.MULTILINE)
    assert (curves.curve_orbits >= curves.attrs["curve_points"]).all() and (curves.curve_time > 0).all()


def test_failures_are_listed_with_all_that_reproduces_them() -> None:
    fast, slow = listing(made_up()).splitlines()
    assert fast.startswith("fast, here, case 2: phase off by 45°; k 0.5 N/m, Q 0.5")
    assert slow.startswith("slow 2, here, case 2: no orbit; k 0.5 N/m")


@pytest.mark.slow
def test_the_measured_table_has_a_row_for_each_method_and_a_column_for_each_regime(measured: xr.Dataset) -> None:
    said = table(measured)
    for regime in REGIMES:
        assert said.count(f"| {regime.name} |") + said.count(f"{regime.name} |") >= 6
    for method in measured["solver"].values:
        assert len(re.findall(rf"^\| {re.escape(str(method))} \|", said, re.MULTILINE)) >= 3
    assert "Seed 3" in said


def test_compilation_is_timed_for_every_solver(monkeypatch: pytest.MonkeyPatch) -> None:
    def here(groups: Iterable[Iterable[str]]) -> list[Cost]:
        costs = []
        for kind in itertools.chain.from_iterable(groups):
            started = time.process_time()
            KINDS[kind]()
            costs.append(Cost(kind, time.process_time() - started, 0, 0))
        return costs

    monkeypatch.setattr(compilation, "in_processes", here)  # which tests/_kernels/test_first_results.py asks
    seconds = compilation.of_solvers(False)
    assert set(seconds) == {method.family for method in methods_of([])}
    assert min(seconds.values()) > 0.0


# The command.


@dataclass(frozen=True)
class Commanded:
    """What the command was asked, said, wrote and drew."""

    asked: list[tuple[Any, ...]]  # of measuring
    out: str
    err: str
    output: Path
    plot: Path
    figure: Any


@pytest.fixture(scope="module")
def commanded(measured: xr.Dataset, tmp_path_factory: pytest.TempPathFactory) -> Commanded:
    """The command run once, given what was measured above."""
    asked: list[tuple[Any, ...]] = []
    figures: list[Any] = []

    def bench(*wanted: Any) -> xr.Dataset:
        *numbers, progress = wanted
        asked.append(tuple(numbers))
        progress("measuring")
        return measured

    folder = tmp_path_factory.mktemp("bench")
    output, plot = folder / "bench.nc", folder / "bench.png"
    words = ["bench", "--quick", "--seed", "3", "--output", str(output), "--plot", str(plot), "--no-peers"]
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(StringIO()) as out, redirect_stderr(StringIO()) as err:
        patch.setattr(accuracy, "bench", bench)
        patch.setattr(picture, "draw", lambda *given: figures.append(draw_picture(*given)) or figures[-1])
        assert main(words) == 0
    (figure,) = figures
    return Commanded(asked, out.getvalue(), err.getvalue(), output, plot, figure)


@pytest.mark.slow
def test_the_command_prints_the_table_and_writes_both_files(measured: xr.Dataset, commanded: Commanded) -> None:
    assert commanded.out.startswith(table(measured)) and f"written to  {commanded.plot}" in commanded.out
    assert commanded.err == "measuring ...\n"
    assert read(commanded.output).identical(measured) and commanded.plot.exists()
    assert commanded.asked == [(None, 3, False, True)]


@pytest.mark.slow
def test_the_picture_has_a_panel_for_each_regime_and_error_and_one_legend(
    measured: xr.Dataset, commanded: Commanded
) -> None:
    figure = commanded.figure
    assert commanded.plot.stat().st_size > 10_000
    legends = [axes.get_legend() for axes in figure.axes if axes.get_legend() is not None]
    assert len(figure.axes) == 2 * len(REGIMES) + 1 and len(legends) == 1
    names = [text.get_text() for text in legends[0].get_texts()]
    assert names[: len(set(measured["family"].values))] == list(dict.fromkeys(measured["family"].values.tolist()))
    assert {axes.get_xscale() for axes in figure.axes[:7]} == {"log"}


@pytest.mark.slow
def test_the_site_shows_a_table_that_the_command_made(measured: xr.Dataset) -> None:
    text = (Path(__file__).parents[2] / "docs" / "accuracy.md").read_text()
    shown = text.partition("<!-- accuracy:begin -->")[2].partition("<!-- accuracy:end -->")[0]
    ours = table(measured).splitlines()
    assert next(line for line in ours if line.startswith("| solver")) in shown
    for name in ("averaging", "auto 1°", "orbit", "march eta 0.3", "numbalsoda 1e-12", "heyoka 1e-12", "scipy 1e-09"):
        assert f"| {name} |" in shown
    assert "](../samples/bench.png)" in text


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--pixels", "0"], "'0' is not a whole number of at least 1"),
        (["--seed", "-1"], "seed is -1; allowed: a whole number of at least 0"),
        (["--output", "no/such/folder.nc"], "the folder 'no/such' does not exist"),
        (["--plot", "bench.docx"], "the picture's suffix is '.docx'; allowed: one of"),
        (["--box", "--plot", "bench.png"], "--plot does not go with --box"),
        (["--box", "--compile"], "not allowed with argument"),
        (["--hard", "--quick", "--pixels", "3"], "--pixels does not go with --hard"),
        (["--guess"], "unrecognized arguments: --guess; see phasemap bench --help."),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence_before_anything_is_measured(
    arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(measuring, "measure", None)
    try:
        code = main(["bench", *arguments])
    except SystemExit as stopped:
        code = int(stopped.code or 0)
    said = capsys.readouterr()
    assert code == 2 and said.out == ""
    assert said.err.startswith("phasemap: ") and said.err.count("\n") == 1 and sentence in said.err
