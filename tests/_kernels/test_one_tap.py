"""A period in which the tip taps once, in pieces, against the same period in fine steps."""

from __future__ import annotations

import math

import numpy as np
import pytest

import phasemap as pm
from phasemap._kernels import columns as col
from phasemap._kernels.law import Oscillator, parameters
from phasemap._kernels.orbits.time.march import march_period
from phasemap._kernels.orbits.time.tip import PeriodResult
from phasemap._kernels.scanning.one_tap import WAIT, Taps, tap_or_march
from phasemap._kernels.scanning.pieces import (
    PIECE_NODES,
    Instant,
    PieceNodes,
    fill_free_flight_at_nodes,
    fill_response,
    lever_with_spring,
    move_freely,
    place_contact_nodes,
    place_flight_nodes,
)
from phasemap.solvers.problem import Work, make_work

SETPOINT, FINE, USUAL = 0.7, 0.12, 0.7  # USUAL: steps of a scan's march
# Of the phase of a settled motion in steps of 0.7: 2e-4 degree. A period adds 2 pi alpha0 of it.
MARCHED = math.radians(2e-4)


def scope_of(
    quality: float, free_amplitude: float = 40e-9, contact: str = "dmt", stiffness: float = 40.0
) -> pm.Microscope:
    interaction = pm.Interaction(contact) if contact == "dmt" else pm.Interaction(contact, decay_length=None)
    lever = pm.Cantilever(stiffness, 300e3, quality)
    return pm.Microscope(lever, pm.Tip(10e-9), pm.Drive(free_amplitude), interaction)


class Tap:
    """A tip on its way, about where it taps at the setpoint: by `tap_or_march`, or in steps."""

    def __init__(self, scope: pm.Microscope, *materials: pm.Material, setpoint: float = SETPOINT) -> None:
        values = np.array([[m.modulus, m.adhesion, m.damping, m.poisson_ratio] for m in materials])
        self.work: Work = make_work(values, False, scope, setpoint * scope.driven_amplitude)
        self.lever, self.taps, self.followed = self.work.lever, Taps(), False
        pixel = pm.solve_pixel(materials[0], scope, setpoint)
        self.z0, self.amplitude = float(pixel.tip_offset), float(pixel.amplitude)
        a = self.amplitude * np.exp(1j * (math.radians(float(pixel.phase)) - 0.5 * math.pi))
        self.start = np.array([float(pixel.mean_deflection) + a.real, -self.lever[col.OMEGA] * a.imag, 0.0])

    def period(self, y: np.ndarray, z0: float, eta: float = FINE, material: int = 0, pieces: bool = False) -> complex:
        """Let one pass, and return its first harmonic."""
        acc, p = PeriodResult(), parameters(self.work.rows[material])
        if pieces:
            steps = tap_or_march(Oscillator(self.work.law, p, self.lever), z0, eta, y, acc, self.taps)
            self.followed = steps == 1  # the march takes many
        else:
            steps = march_period(Oscillator(self.work.law, p, self.lever), z0, eta, y, acc)
        assert steps > 0
        return complex(acc.cos, -acc.sin)


PLASTIC = pm.Material(1e9, 0.05, damping=0.01)
TAPS = {
    "usual": (scope_of(400), PLASTIC),
    "stiff, elastic": (scope_of(400), pm.Material(70e9, 0.05)),
    "sticky and lossy, attractive": (scope_of(400, 20e-9), pm.Material(0.5e9, 0.1, damping=0.1)),
    "lossy": (scope_of(400), pm.Material(1e9, 0.05, damping=0.2)),
    "Hertz": (scope_of(100, 20e-9, "hertz"), pm.Material(2e9, 0.0, damping=0.01)),
    "soft lever": (scope_of(200, 60e-9, stiffness=3.0), pm.Material(1e9, 0.03, damping=0.01)),
}


@pytest.mark.parametrize("name", TAPS)
def test_a_period_with_one_tap_is_that_of_fine_steps(name: str) -> None:
    tap = Tap(*TAPS[name])
    near = MARCHED * 2 * math.pi * tap.lever[col.ALPHA0] * tap.amplitude
    exact = tap.start
    for kick in (1.0, 1.003, 0.998):  # at first without a period before it, and then disturbed
        exact = kick * exact
        y = exact.copy()
        a, expected = tap.period(y, tap.z0, pieces=True), tap.period(exact, tap.z0)
        assert tap.followed
        assert y == pytest.approx(exact, rel=0, abs=near)
        # The lever resists a push for a period with 1/2, and not with 2 alpha0 as in the long run.
        assert abs(a - expected) < math.pi * near


def test_a_line_of_steps_is_that_of_fine_steps_within_the_error_of_the_usual_ones() -> None:
    # Two materials in turn, a step of 1 nm up and down, and a slope: phase and amplitude of every period.
    tap = Tap(TAPS["usual"][0], PLASTIC, pm.Material(3e9, 0.08, damping=0.005))
    states = [tap.start.copy() for _ in range(3)]
    off, followed = np.zeros((2, 600)), 0
    for i in range(600):
        material, up = i // 200 % 2, 1e-9 if 300 <= i < 450 else 0.0
        z0 = tap.z0 - up + 1e-12 * i
        fine, usual, pieces = (
            tap.period(y, z0, eta, material, by)
            for y, eta, by in zip(states, (FINE, USUAL, FINE), (False, False, True), strict=True)
        )
        off[:, i] = abs(usual - fine), abs(pieces - fine)
        followed += tap.followed
    assert followed > 500
    assert off[1].max() < off[0].max()


def test_a_lever_that_hardly_rings_is_marched() -> None:
    tap = Tap(scope_of(4.0, 20e-9, stiffness=1.0), pm.Material(50e6, 0.0, damping=0.01), setpoint=0.8)
    y, other = tap.start.copy(), tap.start.copy()
    assert tap.period(y, tap.z0, USUAL, pieces=True) == tap.period(other, tap.z0, USUAL)
    assert (y == other).all() and tap.taps.tobytes() == Taps().tobytes()  # it was not even tried


@pytest.mark.parametrize("lower", [-30e-9, 7e-9])  # out of reach of the tip; in contact with it as the period begins
def test_a_period_without_a_whole_tap_is_marched(lower: float) -> None:
    tap = Tap(*TAPS["usual"])
    y, other = tap.start.copy(), tap.start.copy()
    assert tap.period(y, tap.z0 - lower, USUAL, pieces=True) == tap.period(other, tap.z0 - lower, USUAL)
    assert (y == other).all() and not tap.followed


def test_a_tap_that_attraction_makes_or_not_is_marched_and_so_are_those_after_it() -> None:
    tap = Tap(*TAPS["sticky and lossy, attractive"])
    z0 = (1 - 1e-4) * math.hypot(tap.start[0], tap.start[1])  # the free lever would touch by 1 pm
    y, other = tap.start.copy(), tap.start.copy()
    for left in (WAIT, WAIT - 1, WAIT - 2):
        assert tap.period(y, z0, USUAL, pieces=True) == tap.period(other, z0, USUAL)
        assert (y == other).all() and tap.taps.marches == left


# The lever between two instants


@pytest.mark.parametrize("kappa", [0.0, 3.0])
def test_the_lever_at_the_nodes_is_the_free_lever(kappa: float) -> None:
    lever, m = lever_with_spring(1.1, 0.02, 1e-9, kappa, 5e-9), PieceNodes()
    at = Instant(5e-9, 2e-9, complex(0.6, 0.8))
    place_contact_nodes(2.5, m)
    fill_free_flight_at_nodes(lever, at, 5e-9, m)
    for j in range(PIECE_NODES):
        there = move_freely(lever, at, m.time[j])
        # Taylor's series of an eighth of an angle of 5 rad: 1e-12, and eight times that.
        assert m.depth[j] == pytest.approx(there.z - 5e-9, rel=0, abs=1e-19)
        assert m.speed[j] == pytest.approx(there.v, rel=0, abs=1e-19)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_constant_force_moves_the_lever_by_the_formula_on_either_side_of_contact(sign: float) -> None:
    # From rest, w = -f/k' (1 - exp(-alpha0 t) (cos + alpha0/Omega sin) Omega t), k' = 1; before contact, the piece
    # begins at its far end, 2 before.
    lever, m, alpha0 = lever_with_spring(1.0, 0.05, 1e-9, 0.0, 0.0), PieceNodes(), 0.05
    place_flight_nodes(0.3, 0.0, 2.0, sign, m)
    fill_free_flight_at_nodes(lever, Instant(0.0, 0.0, complex(1.0, 0.0)), 0.0, m)
    m.force[:] = 1e-10
    fill_response(lever, sign, m)
    t = m.time + (2.0 if sign < 0 else 0.0)
    own = math.sqrt(1 - alpha0**2)
    ringing = np.exp(-alpha0 * t) * (np.cos(own * t) + alpha0 / own * np.sin(own * t))
    # 12 nodes take an integral over 2, steps of which grow sevenfold, to 1e-6.
    assert m.w == pytest.approx(-1e-10 * (1 - ringing), rel=0, abs=1e-16)
