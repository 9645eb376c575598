"""The lever's response where it has several modes, against an independent code and against what physics asks for."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from cases import Case, load, plain
from scipy.integrate import solve_ivp

import phasemap as pm
from phasemap._kernels import columns as col
from phasemap._kernels.columns import LOSSES, WAVES, ErrorLimits
from phasemap._kernels.compilation import kernel
from phasemap._kernels.excitation import detected_signal
from phasemap._kernels.law import Oscillator
from phasemap._kernels.orbits.response import passes, stability
from phasemap._kernels.orbits.response.nodes import TOUCH, Nodes, cut_contact
from phasemap._kernels.orbits.response.passes import UNRESOLVED
from phasemap._kernels.orbits.response.state import PassState, evaluate_nodes
from phasemap._kernels.quadrature import TABLES
from phasemap._kernels.rows.answers import Answers
from phasemap._kernels.rows.by_collocation import collocation_rows
from phasemap._kernels.rows.by_response import response_rows
from phasemap.solvers.integrals import with_forces
from phasemap.solvers.problem import Work, make_work

PHASE, HEIGHT = math.radians(1e-3), 1e-12
LIMITS = ErrorLimits(PHASE, HEIGHT)
LIQUID = pm.Microscope(
    pm.Cantilever(0.1, 20e3, 2.5, modes=(pm.Eigenmode(7.5, 6.0, stiffness_ratio=39.2739),)),
    pm.Tip(10e-9, 130e9, 0.27),
    pm.Drive(10e-9),
    pm.Interaction(contact="hertz", decay_length=None),
)
TABLE = [one for one in load("beam") if len(one["frequency_ratio"]) == 2 and one["excitation"] == "direct"][:6]


def asked(scope: pm.Microscope, modulus: float, setpoint: float) -> Work:
    """A sample under a lever that a force on the tip drives."""
    return make_work(np.array([[modulus, 0.0, 0.0, 0.3]]), False, scope, setpoint * scope.driven_amplitude)


def solved(work: Work, used: tuple[int, ...] = (col.CORRECTED, col.ORBIT)) -> np.ndarray:
    answers = Answers(np.empty((1, col.COLUMNS)), np.zeros(1, np.int8), np.zeros(1, np.int8))
    response_rows(work.pixels, LIMITS, False, answers)
    collocation_rows(work.pixels, TABLES, answers)
    assert answers.status[0] == col.GOOD and answers.solver[0] in used
    return answers.rows[0]


# Shared kernels as others call them, which Python would compile anew, and small ones in Python.


@kernel
def converge(oscillator: Oscillator, f: Nodes, state: PassState) -> int:
    return passes.converge_passes(oscillator, f, state, True, PHASE, HEIGHT)


@kernel
def orbit_is_kept(oscillator: Oscillator, f: Nodes, state: PassState) -> bool:
    return stability.orbit_is_kept(oscillator, f, state)


start_passes, fill_monodromy = plain(passes.start_passes), plain(stability.fill_monodromy)
trace_of_one_mode = plain(stability.trace_of_one_mode)


def by_passes(work: Work) -> tuple[Oscillator, Any, Any]:
    """Oscillator, nodes and state of an orbit, found once more by passes that hold its tip."""
    row, f, state = solved(work), Nodes(), PassState()
    state.amplitude, state.centre, state.slope = row[col.AMPLITUDE], row[col.TIP_OFFSET] - row[col.MEAN], -1e9
    oscillator = work.oscillator(0)
    assert start_passes(oscillator, f, state)
    while converge(oscillator, f, state) == UNRESOLVED:
        coarse, f = f, Nodes()
        cut_contact(coarse, f)
        evaluate_nodes(oscillator, f, state)
    return oscillator, f, state


@pytest.mark.parametrize("case", TABLE, ids=lambda case: f"{case['setpoint']} of {case['modulus']:g}")
def test_orbits_of_two_modes_are_those_of_an_integration_in_time(case: Case) -> None:
    work = asked(LIQUID, case["modulus"], case["setpoint"])
    row = solved(work)
    phase = math.degrees(detected_signal(work.lever, row[col.AMPLITUDE], row[col.PHASE])[1])
    assert abs(phase - case["phase"]) < math.degrees(row[col.ERROR_PHASE]) < 1e-3
    assert abs(row[col.TIP_OFFSET] - case["tip_offset"]) < row[col.ERROR_HEIGHT] < 1e-12
    assert row[col.INDENTATION] == pytest.approx(case["indentation"], abs=1e-13)


@pytest.mark.parametrize("setpoint", [0.8, 0.5])
@pytest.mark.parametrize("modulus", [1e7, 1e8, 1e9])
def test_the_response_alone_gives_orbits_from_gel_to_glass(modulus: float, setpoint: float) -> None:
    # Plain passes are thrown back by samples stiffer than 0.1 GPa, and collocation takes ten times as long.
    assert solved(asked(LIQUID, modulus, setpoint), (col.CORRECTED,))[col.ERROR_PHASE] < LIMITS.phase


@pytest.mark.parametrize("modulus", [1e7, 1e8])
def test_a_second_mode_that_does_not_yield_changes_nothing(modulus: float) -> None:
    with pytest.warns(pm.PlausibilityWarning):
        rigid = pm.Eigenmode(7.5, 6.0, stiffness_ratio=1e9)
    scope = replace(LIQUID, cantilever=replace(LIQUID.cantilever, modes=(rigid,)))
    one = replace(LIQUID, cantilever=replace(LIQUID.cantilever, modes=()))
    row, alone = solved(asked(scope, modulus, 0.8)), solved(asked(one, modulus, 0.8))
    for channel, error in ((col.PHASE, col.ERROR_PHASE), (col.TIP_OFFSET, col.ERROR_HEIGHT)):
        # A mode that yields a thousand-millionth part as much changes the motion by as little.
        yields = 2e-9 if channel == col.PHASE else 2e-18
        assert abs(row[channel] - alone[channel]) < row[error] + alone[error] + yields


@pytest.mark.parametrize("case", [TABLE[0], TABLE[1], TABLE[3]], ids=lambda case: f"{case['setpoint']}")
def test_the_largest_multiplier_is_that_of_the_linearised_motion(case: Case) -> None:
    monodromy = np.zeros((4, 4))
    fill_monodromy(*by_passes(asked(LIQUID, case["modulus"], case["setpoint"])), monodromy)
    radius = abs(np.linalg.eigvals(monodromy)).max()
    # Kicks at nodes in place of a stiffness that stays between them: a few per cent.
    assert radius == pytest.approx(case["spectral_radius"], rel=0.05)


def test_an_orbit_is_kept_that_touches_once_far_from_where_it_doubles_or_its_branch_ends() -> None:
    work = asked(replace(LIQUID, cantilever=replace(LIQUID.cantilever, modes=())), 1e8, 0.8)
    oscillator, f, state = by_passes(work)
    kicks = np.zeros((2, 2))
    fill_monodromy(oscillator, f, state, kicks)
    # Kicks at nodes in place of a spring that lasts from one to the next: a few per cent. Damping is left out.
    trace, decay = trace_of_one_mode(oscillator, f, state)
    assert trace == pytest.approx(np.trace(kicks), abs=0.1 * math.exp(-0.5 * decay))  # at most 2 exp(-decay/2)
    assert math.exp(-decay) == pytest.approx(np.linalg.det(kicks), rel=0.05)
    assert orbit_is_kept(oscillator, f, state)
    for field, value in (("slope", 1e9), ("work", 1e-3 * state.amplitude**2)):  # past a fold; energy that is not there
        before = state[field]
        state[field] = value
        assert not orbit_is_kept(oscillator, f, state)
        state[field] = before
    f.w[TOUCH + 8] -= 4 * (state.amplitude - state.centre)  # the tip leaves the sample within what is taken for contact
    assert not orbit_is_kept(oscillator, f, state)


@pytest.mark.parametrize("case", [TABLE[0], TABLE[2]], ids=lambda case: f"{case['modulus']:g}")
def test_harmonics_are_those_that_the_detector_sees_of_both_modes(case: Case) -> None:
    work = asked(LIQUID, case["modulus"], case["setpoint"])
    row = solved(work)[None]
    row[:, [col.AMPLITUDE, col.PHASE]] = detected_signal(work.lever, row[0, col.AMPLITUDE], row[0, col.PHASE])
    wide = with_forces(row, work, np.array([col.CORRECTED], np.int8))[0]
    found = abs(wide[WAVES:LOSSES].view(complex))
    # The same modes, in nm and in units of the first one's time, from the state that the independent code recorded.
    k, c = work.lever[col.STIFFNESS], work.rows[0, col.CONTACT] * 1e-9**0.5
    modes = work.lever[col.MODE :].reshape(-1, col.MODE_NUMBERS)
    w, rate, share, pulled, weight = modes.T

    def motion(t: float, y: np.ndarray) -> np.ndarray:
        force = c / k * max(y[:2].sum() - 1e9 * case["tip_offset"], 0.0) ** 1.5
        return np.concatenate([y[2:], 1e9 * pulled * math.cos(t) - 2 * rate * y[2:] - w**2 * y[:2] - share * force])

    t = np.arange(4096) / 4096 * 2 * math.pi
    y = solve_ivp(motion, (0, 2 * math.pi), 1e9 * np.array(case["state"]), "DOP853", t, rtol=1e-9, atol=1e-9).y
    truth = 1e-9 * 2 * abs(np.fft.rfft(weight @ y[:2])[2:7]) / len(t)
    assert found == pytest.approx(truth, abs=1e-3 * truth.max())
