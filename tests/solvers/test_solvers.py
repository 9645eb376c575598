"""What every solver promises, and how they stand to one another."""

from __future__ import annotations

import math

import numpy as np
import pytest
from cases import label, load, material_of, scope_of

import phasemap as pm
from benchmarks.accuracy.regimes import REGIMES, draw
from phasemap._kernels import columns as col
from phasemap.solvers.problem import Work
from phasemap.solvers.run import run
from phasemap.solvers.solver import SOLVERS, March, Solver, by_name

SCOPE = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(20e-9))
SOLVED = [(name, case) for name in ("orbits", "orbits_unseen", "engaged") for case in load(name)]


def works() -> list[Work]:
    return [batch.work() for regime in REGIMES[:5] for batch in draw(regime, 6, 4, np.random.default_rng(3))]


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: s.name)
class TestEverySolver:
    def test_holds_the_setpoint(self, solver: Solver) -> None:
        for work in works():
            rows, status, _ = run(solver, work, pm.Accuracy())
            held = status == col.GOOD
            assert held.any()
            assert np.allclose(rows[held, col.AMPLITUDE], work.amplitudes[held], rtol=1e-8)

    def test_a_failed_row_is_nan_and_a_held_row_is_not(self, solver: Solver) -> None:
        for work in works():
            rows, status, _ = run(solver, work, pm.Accuracy())
            assert np.array_equal(np.isfinite(rows[:, col.PHASE]), status == col.GOOD)
            assert np.array_equal(np.isfinite(rows[:, col.TIP_OFFSET]), status == col.GOOD)

    def test_gives_the_same_bits_for_any_number_of_threads(self, solver: Solver) -> None:
        work = works()[0]
        alone, together = run(solver, work, pm.Accuracy(), threads=1), run(solver, work, pm.Accuracy(), threads=3)
        assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(alone, together, strict=True))

    def test_dissipation_is_never_negative_and_zero_without_damping(self, solver: Solver) -> None:
        pixel = pm.solve_pixel(pm.Material(2e9, adhesion=0.05), SCOPE, 0.7, solver=solver.name)
        assert pixel.dissipation == pytest.approx(0, abs=1e-30)
        assert pm.solve_pixel(pm.Material(2e9, damping=0.05), SCOPE, 0.7, solver=solver.name).dissipation > 1e-20

    def test_viscosity_is_damping_in_other_units(self, solver: Solver) -> None:
        # alpha1 = eta R omega_c / (2 k)
        damping = 0.02
        viscosity = damping * 2 * 40.0 / (10e-9 * 2 * math.pi * 300e3)
        one = pm.solve_pixel(pm.Material(2e9, damping=damping), SCOPE, 0.7, solver=solver.name)
        other = pm.solve_pixel(pm.Material(2e9, viscosity=viscosity), SCOPE, 0.7, solver=solver.name)
        assert one.phase == pytest.approx(other.phase, abs=1e-7)

    def test_hertz_knows_no_adhesion(self, solver: Solver) -> None:
        hertz = pm.Microscope(SCOPE.cantilever, SCOPE.tip, SCOPE.drive, pm.Interaction("hertz"))
        sticky = pm.solve_pixel(pm.Material(2e9, adhesion=0.3), hertz, 0.7, solver=solver.name)
        clean = pm.solve_pixel(pm.Material(2e9), SCOPE, 0.7, solver=solver.name)
        assert (sticky.phase, sticky.tip_offset) == (clean.phase, clean.tip_offset)

    def test_a_nan_material_is_flagged_and_the_others_are_solved(self, solver: Solver) -> None:
        surface = pm.Surface([[1e9, np.nan, 2e9]], 0.05, pixel_size=1e-9, allow_nan=True)
        image = pm.simulate(surface, SCOPE, 0.7, solver=solver.name)
        assert image.status.values.tolist() == [[0, pm.Status.invalid.code, 0]]
        assert np.isnan(image.phase.values[0, 1])
        assert image.solver.values[0, 1] == -1


@pytest.mark.parametrize(("name", "case"), SOLVED, ids=[label(case) for _, case in SOLVED])
def test_march_and_orbit_agree_where_the_march_settles(name: str, case: dict[str, object]) -> None:
    orbit = pm.solve_pixel(material_of(case), scope_of(case), case["setpoint"], solver="orbit")
    march = pm.solve_pixel(material_of(case), scope_of(case), case["setpoint"], solver="march")
    assert march.status is orbit.status
    if march.stable:
        assert abs(march.phase - orbit.phase) < 1e-4
        assert abs(march.tip_offset - orbit.tip_offset) < 1e-13


def difference(name: str, other: str, regime: str, seed: int) -> np.ndarray:
    """Rows of one solver less those of another, over 60 pixels drawn from a regime."""
    (drawn,) = [draw(one, 6, 10, np.random.default_rng(seed)) for one in REGIMES if one.name == regime]
    both = [run(by_name(solver), batch.work(), pm.Accuracy())[0] for batch in drawn for solver in (name, other)]
    return np.concatenate(both[::2]) - np.concatenate(both[1::2])


@pytest.mark.parametrize("regime", [regime.name for regime in REGIMES])
def test_cases_nobody_chose_are_exact_too(regime: str) -> None:
    # Largest over all pixels; the march's own error at its default step is below 5e-5 degree.
    apart = difference("orbit", "march", regime, 11)
    assert np.isfinite(apart[:, col.PHASE]).mean() >= 0.95
    assert np.nanmax(abs(np.degrees(apart[:, col.PHASE]))) < 1e-4
    assert np.nanmax(abs(apart[:, col.TIP_OFFSET])) < 1e-13


def test_averaging_is_good_in_air_and_not_usable_in_liquid() -> None:
    # physics.md and the README: a few hundredths of a degree in air.
    air, liquid = (difference("averaging", "orbit", name, 5) for name in ("air, hard sample", "low-Q liquid"))
    assert np.nanmedian(abs(np.degrees(air[:, col.PHASE]))) < 0.02
    assert np.nanmedian(abs(np.degrees(liquid[:, col.PHASE]))) > 0.2


def test_march_converges_with_the_order_it_claims() -> None:
    # Order 8 in eta. The answer at eta = 0.2 stands for the exact one: (0.2 / 0.45)^8 = 0.0015 of the smallest error
    # used.
    many = works()[:18]  # in air and under a soft lever
    rows = {eta: np.concatenate([run(March(eta), w, pm.Accuracy())[0] for w in many]) for eta in (0.2, 0.45, 0.6)}
    error = {eta: np.nanmedian(abs(rows[eta] - rows[0.2])[:, col.PHASE]) for eta in (0.45, 0.6)}
    order = math.log(error[0.6] / error[0.45]) / math.log(0.6 / 0.45)
    assert 7 < order < 10


def test_auto_takes_averaging_where_it_is_good_enough_and_says_how_good() -> None:
    material = pm.Material(2e9, adhesion=0.02, damping=0.01)
    exact = pm.solve_pixel(material, SCOPE, 0.7, solver="orbit")
    loose = pm.solve_pixel(material, SCOPE, 0.7, accuracy=pm.Accuracy(phase=1.0, height=1e-9))
    tight = pm.solve_pixel(material, SCOPE, 0.7, accuracy=pm.Accuracy(phase=1e-3, height=1e-13))
    assert (loose.solver, tight.solver) == ("averaging", "corrected")
    assert abs(loose.phase - exact.phase) < loose.error_phase < 1
    assert abs(loose.tip_offset - exact.tip_offset) < loose.error_height < 1e-9
    assert abs(tight.phase - exact.phase) < tight.error_phase < 1e-3


def test_an_unknown_solver_is_refused_by_name() -> None:
    with pytest.raises(pm.InputError, match=r"solver is 'fast'; allowed: one of auto, averaging, orbit, march"):
        by_name("fast")
