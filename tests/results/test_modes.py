"""Amplitude, phase and losses of each mode, against taps of the independent code in tests/reference."""

from __future__ import annotations

import numpy as np
import pytest
from beams import CASES, material_of, scope_of
from cases import Case

import phasemap as pm
from phasemap.results.variables import SOLVER_NAMES

PERIODIC = [case for case in CASES if case["from_far"] and case["periods"] == 1]
NAMES = ("drive_energy", "dissipation", "amplitude", "phase")


def shown(case: Case) -> tuple[dict[str, float], np.ndarray, np.ndarray]:
    """What an image has of a case: energies [J], complex deflections [m] and losses [J] of its modes."""
    count = len(case["quality_factor"])
    names = [[f"modal_{name}_{i + 1}" for i in range(count)] for name in ("amplitude", "phase", "dissipation")]
    surface = pm.Surface.from_labels([[0]], [material_of(case)], pixel_size=1e-9)
    variables = [*NAMES, *(name for group in names for name in group)]
    image = pm.simulate(surface, scope_of(case), case["setpoint"], "orbit", variables=variables)
    found = {str(name): float(values.item()) for name, values in image.data_vars.items()}
    amplitude, phase, lost = (np.array([found[name] for name in group]) for group in names)
    return found, amplitude * np.exp(1j * np.radians(phase)), lost


def in_time(case: Case) -> tuple[np.ndarray, np.ndarray]:
    """Deflections of the modes, of the phase that the detector shows, and what the fluid takes of them, in time."""
    scope, motion = scope_of(case), np.array(case["mode_amplitude"]) * np.exp(1j * np.radians(case["mode_phase"]))
    turn = np.exp(1j * np.radians(case["phase"])) / np.exp(1j * np.angle(np.dot(scope.detector_weights, motion)))
    k, w, q, b = (
        np.array(case[name]) for name in ("stiffness_ratio", "frequency_ratio", "quality_factor", "participation")
    )
    # The code's losses are by velocities relative to the base, which moves through the fluid as well.
    moved = b * scope.base_amplitude * 1j if case["excitation"] == "base" else 0.0
    beside = np.pi * scope.frequency_ratio * case["stiffness"] * k / (w * q)
    return motion * turn, case["lost"] + beside * (abs(motion + moved) ** 2 - abs(motion) ** 2)


@pytest.mark.parametrize("case", PERIODIC, ids=lambda case: f"{case['group']} {case['excitation']}")
def test_modes_move_and_lose_what_they_do_in_time_and_all_energy_comes_from_the_drive(case: Case) -> None:
    (found, motion, lost), (moved, gone) = shown(case), in_time(case)
    # Phases of orbits are good to 1e-4 degree and better.
    assert abs(motion - moved).max() < 2e-6 * abs(moved).max()
    assert abs(lost - gone).max() < 3e-5 * gone.sum()
    assert found["drive_energy"] == pytest.approx(lost.sum() + found["dissipation"], rel=3e-5)
    seen = np.dot(scope_of(case).detector_weights, motion)
    assert seen == pytest.approx(found["amplitude"] * np.exp(1j * np.radians(found["phase"])), rel=1e-12)


def test_a_single_mode_has_what_the_detector_sees_and_loses_what_the_sample_does_not_take() -> None:
    surface = pm.Surface(1e9, adhesion=0.05, damping=0.02, pixel_size=1e-9, shape=(1, 1))
    scope = pm.Microscope(pm.Cantilever(2.0, 70e3, 150.0), pm.Tip(10e-9), pm.Drive(40e-9))
    names = [*NAMES, "modal_amplitude_1", "modal_phase_1", "modal_dissipation_1"]
    image = pm.simulate(surface, scope, 0.7, "orbit", variables=names)
    found = {name: image[name].item() for name in names}
    assert found["modal_amplitude_1"] == pytest.approx(found["amplitude"], rel=1e-13)
    assert found["modal_phase_1"] == pytest.approx(found["phase"], rel=1e-13)
    by_hand = np.pi * 2.0 * 40e-9 / 150 * found["amplitude"] * np.cos(np.radians(found["phase"]))
    assert found["drive_energy"] == pytest.approx(by_hand, rel=1e-13)
    assert found["modal_dissipation_1"] == pytest.approx(by_hand - found["dissipation"], rel=1e-6)
    again = pm.channels(image)
    assert "modal_amplitude_1" not in again and again.drive_energy.item() == found["drive_energy"]


@pytest.mark.parametrize("name", ["modal_amplitude_3", "modal_dissipation_3"])
def test_a_mode_that_the_lever_does_not_have_is_refused(name: str) -> None:
    scope = scope_of(CASES[0])
    surface = pm.Surface(1e9, pixel_size=1e-9, shape=(1, 1))
    with pytest.raises(pm.InputError, match=rf"variables is '{name}'; allowed: names of modes up to 2"):
        pm.simulate(surface, scope, 0.7, variables=[name])


def test_an_interpolated_image_has_the_losses_of_solved_pixels() -> None:
    modulus = np.linspace(1e9, 3e9, 10_000).reshape(100, 100)
    scope = pm.Microscope(pm.Cantilever(5.0, 150e3, 300.0, modes=2), pm.Tip(10e-9), pm.Drive(30e-9))
    names = ("modal_dissipation_2", "drive_energy", "solver")
    image = pm.simulate(pm.Surface(modulus, pixel_size=1e-9), scope, 0.8, variables=names)
    assert (image.solver == SOLVER_NAMES.index("interpolated")).mean() > 0.9
    some = pm.simulate(pm.Surface(modulus[::20], pixel_size=1e-9), scope, 0.8, "orbit", variables=names)
    for name in names[:2]:
        # Integrals are interpolated to a thousandth of their usual size.
        np.testing.assert_allclose(image[name][::20], some[name], rtol=0, atol=1e-3 * float(some[name].mean()))
