"""Pieces of engagement against closed forms and plain sums: what holds the setpoint is decided by these numbers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from cases import plain

from phasemap._kernels import columns as col
from phasemap._kernels.engagement import (
    averages,
    beside_resonance,
    by_averaging,
    by_fold,
    other_branch,
    second_drive,
    stuck,
)
from phasemap._kernels.engagement.by_averaging import BY_AVERAGING, BY_CURVE, BY_FOLD, IN_TIME
from phasemap._kernels.law import Law, Oscillator
from phasemap._kernels.orbits.averaged.sides import ATTRACTIVE, REPULSIVE, UNCLEAR, Maximum
from phasemap._kernels.orbits.harmonic_orbit import HarmonicOrbit
from phasemap._kernels.orbits.response.orbit_at_setpoint import ResponseWorkspace
from phasemap.experiment.lever_numbers import one_mode

STIFFNESS, FREE, Q = 40.0, 16e-9, 400.0  # [N/m], [m] at resonance, quality factor
HERTZ, REACH, PULL = 3e5, 0.3e-9, 2e-9  # K sqrt(R) [N/m^1.5], d0 [m], f0 [N]: a polymer under a tip of 10 nm
ANGLES = 2 * np.pi * (np.arange(4000) + 0.5) / 4000


def lever_at(omega: float = 1.0) -> np.ndarray:
    """The lever, driven at this ratio of frequencies."""
    lever: np.ndarray = one_mode(omega, 0.5 / Q, STIFFNESS, FREE / Q)
    return lever


def over(lever: np.ndarray, hertz: float = HERTZ, pull: float = 0.0, longrange: float = 0.0) -> Oscillator:
    """The lever over an elastic contact [N/m^1.5] with adhesion [N], and an attraction before it [N at contact]."""
    p = np.zeros(col.ROW)
    p[[col.CONTACT, col.PULL, col.LONGRANGE, col.INVERSE_REACH]] = hertz, pull, longrange, 1 / REACH
    return Oscillator(Law(0, 0, 0, 0, 0, 0), tuple(map(float, p)), lever)


def push_at(oscillator: Oscillator, amplitude: float, gap: float) -> float:
    """P [m] of a harmonic orbit as a sum over its angles."""
    p, depth = oscillator.p, amplitude * (np.cos(ANGLES) - 1) - gap
    outside = -p[col.LONGRANGE] / (1 - np.minimum(depth, 0) / REACH) ** 2
    inside = p[col.CONTACT] * np.maximum(depth, 0) ** 1.5 - p[col.PULL]
    return float(2 * np.mean(np.where(depth > 0, inside, outside) * np.cos(ANGLES))) / STIFFNESS


@pytest.mark.parametrize("omega", [0.95, 1.05])
def test_a_tip_rebounds_where_its_impact_is_shorter_than_what_the_period_differs(omega: float) -> None:
    push, rebounds = 1e-9, plain(beside_resonance.rebounds)
    speed = 0.5 * math.pi * push / omega
    deepest = (1.25 * speed**2 * STIFFNESS / HERTZ) ** 0.4  # v^2/2 = (2/5) (c/k) d^(5/2)
    turn = 0.5 * np.pi * (np.arange(4000) + 0.5) / 4000
    x = np.sin(turn)  # of the deepest depth: dt = dd / v(d), summed over both ways
    lasts = 2 * deepest / speed * np.sum(np.cos(turn) / np.sqrt(1 - x**2.5)) * 0.5 * np.pi / 4000
    as_long = HERTZ * (lasts / (2 * math.pi * abs(1 / omega - 1))) ** 2.5  # an impact lasts as c^(-2/5)
    assert rebounds(over(lever_at(omega), 1.02 * as_long), push)
    assert not rebounds(over(lever_at(omega), 0.98 * as_long), push)


def test_neither_an_attracted_tip_rebounds_nor_one_at_resonance() -> None:
    assert not plain(beside_resonance.rebounds)(over(lever_at(0.95), 1e12), -1e-9)
    assert not plain(beside_resonance.rebounds)(over(lever_at(), 1e12), 1e-9)


@pytest.mark.parametrize("omega", [0.99, 0.9990, 0.99985, 1.0, 1.01])
def test_a_lever_leaps_if_at_its_resonance_it_swings_wider_by_more_than_the_reach(omega: float) -> None:
    rise = FREE / Q / (omega / Q) - FREE / Q / abs(1 - omega**2 + 1j * omega / Q)  # attraction takes 1 - omega^2 away
    assert plain(by_averaging.leaps_to_resonance)(over(lever_at(omega), longrange=PULL)) == (omega < 1 and rise > REACH)


@pytest.mark.parametrize("omega", [0.999, 1.0, 1.002])
def test_all_the_attraction_needed_makes_an_orbit_and_none_leaves_the_free_lever(omega: float) -> None:
    lever, r = lever_at(omega), 0.7
    amplitude = r * FREE / Q / abs(1 - omega**2 + 1j * omega / Q)
    at_share = plain(by_averaging.mismatch_at_attraction_share)
    assert at_share(lever, amplitude, 1.0) == pytest.approx(0.0, abs=1e-12)
    assert at_share(lever, amplitude, 0.0) == pytest.approx(r * r - 1.0)


@pytest.mark.parametrize(("share", "side"), [(0.4, REPULSIVE), (1.0, UNCLEAR), (1.6, ATTRACTIVE)])
def test_a_tip_is_attracted_down_to_an_amplitude_that_attraction_can_hold(share: float, side: int) -> None:
    amplitude, lever = FREE / math.sqrt(3), lever_at()
    needed = FREE / Q * math.sqrt(2 / 3)  # -P of an orbit without losses at resonance, u0 (1 - r^2)^(1/2)
    gaps = -np.linspace(0, 1e-9, 201)
    strongest = -min(push_at(over(lever, longrange=PULL, pull=PULL), amplitude, gap) for gap in gaps)
    pull = PULL * share * needed / strongest
    # Contact as much stiffer with the attraction leaves the depth where it is strongest.
    oscillator = over(lever, HERTZ * pull / PULL, pull, pull)
    assert plain(by_averaging.side_by_averaging)(oscillator, amplitude, Maximum()) == side


@pytest.mark.parametrize("wanted", [-0.1, 0.002, 0.1])
def test_without_harmonics_the_exact_mismatch_is_largest_where_attraction_is_strongest(wanted: float) -> None:
    q, r, workspace = 100 * Q, 0.6, ResponseWorkspace()
    lever = one_mode(1.0, 0.5 / q, STIFFNESS, FREE / q)
    gaps = -np.linspace(0.05e-9, 0.4e-9, 201)
    pulls = [-push_at(over(lever, pull=PULL, longrange=PULL), r * FREE, gap) for gap in gaps]
    # (P/u0)^2 + r^2 - 1 at resonance. Contact as much stiffer with the attraction leaves its strongest depth.
    share, deepest = FREE / q * math.sqrt(wanted + 1.0 - r**2) / max(pulls), gaps[int(np.argmax(pulls))]
    workspace.top.mismatch = wanted
    found = plain(by_fold.response_maximum)(
        over(lever, share * HERTZ, share * PULL, share * PULL), r * FREE, 0.8 * deepest, 0.3 * abs(deepest), workspace
    )
    assert found.mismatch == pytest.approx(
        wanted, abs=3e-4
    )  # what harmonics change is 0.01 at Q 400, and goes with 1/Q
    assert found.gap == pytest.approx(deepest, rel=0.05)  # flat there


def test_without_attraction_a_tip_is_repelled_and_adhesion_alone_leaves_that_open() -> None:
    decide = plain(by_averaging.side_by_averaging)
    assert decide(over(lever_at()), 0.5 * FREE, Maximum()) == REPULSIVE
    assert decide(over(lever_at(), pull=PULL), 0.5 * FREE, Maximum()) == UNCLEAR


def test_where_repulsion_balances_attraction_a_lever_without_further_losses_lacks_what_its_damping_leaves() -> None:
    oscillator, top = over(lever_at(), pull=PULL, longrange=PULL), Maximum()
    amplitude = 0.8 * FREE
    top.gap, top.deeper_gap, top.push = -0.1e-9, -0.2e-9, push_at(oscillator, amplitude, -0.1e-9)
    lacks = plain(other_branch.mismatch_at_balance)(oscillator, amplitude, top)
    assert lacks == pytest.approx(0.8**2 - 1.0, abs=1e-12)  # (2 alpha0 A / u0)^2 - 1


def test_adhesion_holds_a_lever_up_to_its_force_over_the_stiffness() -> None:
    oscillator = over(lever_at(), pull=PULL)
    assert plain(stuck.pull_off_tip_offset)(oscillator) == pytest.approx(PULL / STIFFNESS)


def test_an_oscillation_that_just_stays_in_contact_is_pushed_by_eight_fifths_over_pi_of_its_peak_force() -> None:
    # The integral of (1 + cos)^(3/2) cos over a period is 2^(3/2) 8/5; constant adhesion adds nothing to P.
    push = plain(stuck.least_in_phase_force)(over(lever_at(), pull=PULL), 1e-9)
    assert push == pytest.approx(8 / (5 * math.pi) * HERTZ * 2e-9**1.5 / STIFFNESS, rel=1e-4)


def test_a_tip_falls_at_the_fold_where_its_orbits_from_far_are_lowest() -> None:
    lever = lever_at(0.997)
    oscillator: Any = over(lever, pull=PULL, longrange=PULL)
    s, loss, u0 = lever[col.DYNAMIC_STIFFNESS], lever[col.DYNAMIC_LOSS], lever[col.DRIVE]
    offsets, amplitude = [], FREE
    for gap in np.geomspace(20 * REACH, 0.2 * REACH, 150):
        for _ in range(4):  # (A s + P)^2 + (2 alpha0 omega A)^2 = u0^2, X > 0
            push = push_at(oscillator, amplitude, gap)
            amplitude = (math.sqrt(u0**2 * (s**2 + loss**2) - (push * loss) ** 2) - push * s) / (s**2 + loss**2)
        depth = amplitude * (np.cos(ANGLES) - 1) - gap
        mean = float(np.mean(PULL / (1 - depth / REACH) ** 2)) / STIFFNESS
        offsets.append(amplitude + gap + mean)
    assert plain(beside_resonance.tip_offset_of_fold)(oscillator) == pytest.approx(min(offsets), abs=0.02 * REACH)


def test_a_second_drive_is_seen_without_the_harmonics_of_the_first() -> None:
    n = 48
    weights = np.array([plain(second_drive.averaging_weight)(i, n) for i in range(n)])
    assert weights.mean() == pytest.approx(1.0)
    for turns in (2, 3, 10):  # in the average
        assert abs(np.sum(weights * np.exp(2j * np.pi * turns * np.arange(n) / n))) < 1e-12 * n


def test_angles_are_counted_from_one_phasor_to_another() -> None:
    one, other = 2.0 * np.exp(0.4j), 0.3 * np.exp(-2.1j)
    assert plain(averages.angle_between)(one.real, one.imag, other.real, other.imag) == pytest.approx(-2.5)


def decider(oscillator: Oscillator, amplitude: float) -> int:
    """Way in which the branch is decided: a row of the table of theory/engagement."""
    return int(plain(by_averaging.engage_by_averaging)(oscillator, amplitude, HarmonicOrbit(), Maximum()))


def attracted(share: float, lever: np.ndarray, amplitude: float) -> Oscillator:
    """A lever whose strongest attraction is this share of what its amplitude needs at resonance."""
    needed = FREE / Q * math.sqrt(1 - (amplitude / FREE) ** 2)
    gaps = -np.linspace(0, 1e-9, 201)
    strongest = -min(push_at(over(lever, longrange=PULL, pull=PULL), amplitude, gap) for gap in gaps)
    pull = PULL * share * needed / strongest
    oscillator = over(lever, HERTZ * pull / PULL, pull, pull)
    return oscillator._replace(law=oscillator.law._replace(attracts=1))


@pytest.mark.parametrize(("share", "way"), [(0.3, BY_AVERAGING), (1.0, BY_FOLD), (2.0, BY_AVERAGING)])
def test_averaging_decides_unless_attraction_is_nearly_what_the_setpoint_needs(share: float, way: int) -> None:
    amplitude = FREE / math.sqrt(3)
    assert decider(attracted(share, lever_at(), amplitude), amplitude) == way


@pytest.mark.parametrize(("share", "way"), [(0.5, BY_AVERAGING), (3.0, IN_TIME)])
def test_a_lever_that_attraction_carries_over_its_resonance_is_engaged_in_time(share: float, way: int) -> None:
    omega = 0.9985  # where the lever swings 10 nm, and 16 nm at its resonance
    amplitude = 0.8 * FREE / Q / abs(1 - omega**2 + 1j * omega / Q)
    assert decider(attracted(share, lever_at(omega), amplitude), amplitude) == way


@pytest.mark.parametrize("forces", [{"pull": PULL}, {"longrange": PULL, "pull": PULL}])
def test_adhesion_alone_and_forces_that_may_repel_before_contact_ask_for_the_curve(forces: dict[str, float]) -> None:
    oscillator = over(lever_at(), **forces)
    repels = oscillator.law._replace(attracts=0 if "longrange" in forces else 1)
    assert decider(oscillator._replace(law=repels), 0.6 * FREE) == BY_CURVE


def test_without_attraction_and_adhesion_averaging_decides() -> None:
    oscillator = over(lever_at())
    assert decider(oscillator._replace(law=oscillator.law._replace(attracts=1)), 0.6 * FREE) == BY_AVERAGING
