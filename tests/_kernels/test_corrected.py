"""The cheap path to exact orbits, against collocation, which shares only the force law with it."""

import math
from functools import cache

import numpy as np
import pytest

import phasemap as pm
from phasemap._kernels import columns as col
from phasemap.solvers.problem import Work, make_work
from phasemap.solvers.run import run
from phasemap.solvers.solver import Orbit

AIR = {"stiffness": (20.0, 50.0), "quality_factor": (200.0, 850.0), "modulus": (1e9, 2e10)}
SOFT_LEVER = {"stiffness": (1.0, 4.0), "quality_factor": (60.0, 200.0), "modulus": (5e7, 3e9)}
STIFF_SAMPLE = {"stiffness": (20.0, 50.0), "quality_factor": (200.0, 850.0), "modulus": (5e10, 3e11)}
LIQUID = {"stiffness": (0.3, 2.0), "quality_factor": (2.0, 8.0), "modulus": (1e7, 3e8)}
ABOVE, BELOW = {"ratio": (1.1, 1.1)}, {"ratio": (0.9, 0.9)}  # drive over resonance frequency
REGIMES = {
    "air": AIR, "soft lever": SOFT_LEVER, "stiff sample": STIFF_SAMPLE, "liquid": LIQUID,
    "soft lever below resonance": SOFT_LEVER | BELOW, "soft lever above resonance": SOFT_LEVER | ABOVE,
    # At 1.1 most of these rebound so fast that they are engaged in time: theory, Eq. (engagement-6).
    "stiff sample above resonance": STIFF_SAMPLE | {"ratio": (1.05, 1.05)},
}  # fmt: skip
# Share that is left to collocation or time: where averaging leaves the branch open (below resonance, for one, where a
# lever leaps over it), or a contact lasts for the whole period, or throws the lever back, as in liquid: passes do
# not converge there.
LEFT = {
    "air": 0.05, "soft lever": 0.1, "stiff sample": 0.05, "liquid": 0.48, "soft lever below resonance": 0.17,
    "soft lever above resonance": 0.12, "stiff sample above resonance": 0.03,
}  # fmt: skip

IN_TIME = ("liquid",)  # where half of them are left to time, which takes long


def drawn(regime: dict[str, tuple[float, float]], scopes: int, pixels: int, seed: int, every: int = 1) -> list[Work]:
    """Materials drawn under microscopes drawn, all over decades; all of them, or one of `every`."""
    rng = np.random.default_rng(seed)
    works = []
    for _ in range(scopes):
        stiffness, quality = (np.exp(rng.uniform(*np.log(regime[name]))) for name in ("stiffness", "quality_factor"))
        ratio = regime.get("ratio", (1.0, 1.0))[0]
        radius, amplitude = rng.uniform(8e-9, 30e-9), rng.uniform(10e-9, 60e-9)
        larger = quality * math.hypot(1 - ratio**2, ratio / quality)  # so that the lever moves as much
        scope = pm.Microscope(
            pm.Cantilever(stiffness, 300e3, quality),
            pm.Tip(radius),
            pm.Drive(amplitude * larger, ratio * 300e3) if ratio != 1.0 else pm.Drive(amplitude),
            pm.Interaction(decay_length=rng.uniform(0.15e-9, 0.5e-9)),
        )
        materials = np.column_stack(
            [
                np.exp(rng.uniform(*np.log(regime["modulus"]), pixels)),
                np.exp(rng.uniform(np.log(1e-3), np.log(0.2), pixels)) * (rng.random(pixels) > 0.2),
                np.exp(rng.uniform(np.log(1e-3), np.log(0.1), pixels)) * (rng.random(pixels) > 0.2),
                np.full(pixels, 0.35),
            ]
        )
        amplitude = rng.uniform(0.4, 0.95) * scope.driven_amplitude
        taken = materials[::every]
        works.append(make_work(taken, False, scope, np.full(len(taken), amplitude)))
    return works


@cache
def both(name: str, thorough: bool) -> list[tuple[np.ndarray, ...]]:
    """Of each microscope: rows, statuses, solvers used; rows and statuses of collocation. Two tests ask for them."""
    return [
        (*run(Orbit(), work, pm.Accuracy()), *run(Orbit(complete=True), work, pm.Accuracy())[:2])
        for work in drawn(REGIMES[name], 10, 50, seed=7, every=1 if thorough else 12 if name in IN_TIME else 4)
    ]


@pytest.mark.parametrize("name", REGIMES)
def test_the_estimated_error_bounds_the_error(name: str, thorough: bool) -> None:
    # Against collocation, whose own stated error is the allowance.
    inside, seen, left, count = 0, 0, 0, 0
    for rows, status, used, exact, exactly in both(name, thorough):
        assert np.array_equal(status, exactly)
        cheap = (used == col.CORRECTED) & (status == col.GOOD)
        off = abs(rows - exact)[cheap][:, [col.PHASE, col.TIP_OFFSET]]
        bounded = np.all(off <= (rows + exact)[cheap][:, [col.ERROR_PHASE, col.ERROR_HEIGHT]], axis=1)
        inside, seen = inside + int(bounded.sum()), seen + int(cheap.sum())
        left, count = left + int((used == col.ORBIT).sum()), count + len(rows)
        assert np.all(rows[cheap, col.ERROR_PHASE] < np.radians(1e-3))
        assert np.all(rows[cheap, col.ERROR_HEIGHT] < 1e-12)
    assert seen > 0.4 * count
    assert inside >= 0.999 * seen
    assert left <= LEFT[name] * count


@pytest.mark.parametrize("name", REGIMES)
def test_every_observable_is_that_of_the_exact_orbit(name: str, thorough: bool) -> None:
    # Lengths to the 1 pm that was asked for, the indentation also to what cubics between nodes leave of it; energies
    # and the stiffening to what that means at the depth of a contact.
    for rows, _, used, exact, _ in both(name, thorough):
        cheap = used == col.CORRECTED
        for column, share in ((col.TIP_OFFSET, 0.0), (col.MEAN, 0.0), (col.AMPLITUDE, 0.0), (col.INDENTATION, 2e-4)):
            assert np.allclose(rows[cheap, column], exact[cheap, column], rtol=share, atol=1e-12)
        for column in (col.DISSIPATION, col.VIRIAL, col.STIFFENING):
            size = abs(exact[cheap, column]).max(initial=0.0)
            assert np.allclose(rows[cheap, column], exact[cheap, column], rtol=1e-3, atol=1e-5 * size)
        assert np.all(abs(rows[cheap, col.CLOSURE]) < 1e-6)


def test_next_to_the_end_of_the_attractive_branch_both_paths_take_the_same_side() -> None:
    # Adhesion passes in fine steps through the value at which the attractive branch no longer reaches the setpoint.
    scope = pm.Microscope(pm.Cantilever(2.0, 300e3, 150.0), pm.Tip(12e-9), pm.Drive(30e-9))
    materials = np.column_stack(
        [np.full(400, 1e9), np.geomspace(5e-3, 2e-1, 400), np.full(400, 0.01), np.full(400, 0.35)]
    )
    work = make_work(materials, False, scope, np.full(400, 0.7 * scope.driven_amplitude))
    rows, status, _ = run(Orbit(), work, pm.Accuracy())
    exact, _, _ = run(Orbit(complete=True), work, pm.Accuracy())
    sides = rows[:, col.STIFFENING] > 0
    assert np.all(status == col.GOOD)
    assert np.array_equal(sides, exact[:, col.STIFFENING] > 0)
    assert 0 < sides.sum() < 400
    assert (np.diff(sides.astype(int)) != 0).sum() == 1


def test_a_tighter_accuracy_is_met_by_more_passes_or_by_collocation() -> None:
    material, scope = (
        pm.Material(3e9, adhesion=0.03, damping=0.02),
        pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(20e-9)),
    )
    exact = pm.solve_pixel(material, scope, 0.7, solver="orbit")
    for phase, height in ((1.0, 1e-10), (1e-3, 1e-12), (1e-5, 1e-14), (1e-9, 1e-18)):
        pixel = pm.solve_pixel(material, scope, 0.7, accuracy=pm.Accuracy(phase, height))
        assert abs(pixel.phase - exact.phase) <= pixel.error_phase + exact.error_phase
        assert pixel.error_phase <= max(phase, 1e-6)
