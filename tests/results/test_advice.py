"""Every advice that a status or a warning gives, followed: a good image comes of it."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import xarray as xr

import phasemap as pm
from phasemap.results.descriptions import describe_failures, describe_validity

Case = dict[str, Any]


def solved(
    lever: tuple[float, float, float], radius: float, amplitude: float, material: tuple[float, float, float],
    setpoint: float, solver: str = "auto", periods: int = 20000, contact: str = "dmt",
    decay_length: float | None = 3e-10,
) -> pm.Status:  # fmt: skip
    """What becomes of one pixel of this lever, tip, free amplitude and material."""
    scope = pm.Microscope(
        pm.Cantilever(*lever), pm.Tip(radius), pm.Drive(amplitude), pm.Interaction(contact, decay_length)
    )
    surface = pm.Surface(*material, pixel_size=4e-9, shape=(1, 1))
    image = pm.simulate(surface, scope, setpoint, solver, accuracy=pm.Accuracy(periods=periods))
    return pm.Status.of(int(image.status[0, 0]))


STUCK: Case = {
    "lever": (0.447, 70e3, 4.06), "radius": 20.5e-9, "amplitude": 11.3e-9, "material": (151e6, 0.0539, 0.187),
    "setpoint": 0.468,
}  # fmt: skip
BESIDE: Case = {
    "lever": (0.525, 70e3, 14.6), "radius": 8.74e-9, "amplitude": 30.3e-9, "material": (3.08e6, 0.0266, 0.000391),
    "setpoint": 0.481,
}  # fmt: skip
NO_AVERAGED: Case = {
    "lever": (1.07, 70e3, 144.0), "radius": 25.3e-9, "amplitude": 25.3e-9, "material": (15.4e9, 0.00726, 0.0377),
    "setpoint": 0.851, "solver": "averaging",
}  # fmt: skip
HURRIED: Case = {
    "lever": (3.0, 300e3, 100.0), "radius": 10e-9, "amplitude": 40e-9, "material": (30e6, 0.05, 0.01), "setpoint": 0.6,
    "contact": "jkr", "periods": 1000,
}  # fmt: skip
NECK: Case = {
    "lever": (5.0, 70e3, 100.0), "radius": 10e-9, "amplitude": 20e-9, "material": (100e9, 0.05, 0.0), "setpoint": 0.7,
    "contact": "jkr",
}  # fmt: skip


@pytest.mark.parametrize(
    ("case", "advised", "words", "change"),
    [
        (STUCK, pm.Status.no_stable_orbit, "Raise the free amplitude", {"amplitude": 5 * 11.3e-9}),
        (BESIDE, pm.Status.no_stable_orbit, "Raise the free amplitude", {"amplitude": 5 * 30.3e-9}),
        (BESIDE, pm.Status.no_stable_orbit, "another setpoint", {"setpoint": 0.65}),
        (NO_AVERAGED, pm.Status.no_averaged_orbit, "Use solver='orbit'", {"solver": "orbit"}),
        (HURRIED, pm.Status.not_settled, "Allow more with Accuracy(periods=...)", {"periods": 20_000}),
        (NECK, pm.Status.creates_energy, "'dmt'", {"contact": "dmt"}),
        (NECK, pm.Status.creates_energy, "a shorter decay_length", {"decay_length": 0.02e-9}),
        (NECK, pm.Status.creates_energy, "decay_length=None", {"decay_length": None}),
        ({**NECK, "material": (0.0, 0.05, 0.0)}, pm.Status.invalid, "adhesion without stiffness", {"contact": "dmt"}),
    ],
)
def test_the_advice_of_a_status_gives_a_good_pixel(case: Case, advised: pm.Status, words: str, change: Case) -> None:
    assert solved(**case) is advised
    assert words in advised.value
    assert solved(**{**case, **change}) is pm.Status.good


FAST = pm.Feedback(line_rate=40.0, proportional_gain=0.02, integral_gain=3000.0, bandwidth=20e3)
SCOPE = pm.Microscope(pm.Cantilever(40.0, 300e3, 100.0), pm.Tip(10e-9), pm.Drive(20e-9))


@pytest.mark.parametrize(
    ("relief", "scanner_range", "advised", "words", "change"),
    [
        (10e-9, 4e-9, pm.Status.out_of_range, "a larger scanner_range", {"scanner_range": 40e-9}),
        (2e-6, None, pm.Status.diverged, "or the line rate", {"line_rate": 0.3}),
        (100e-9, None, pm.Status.not_converged, "solver='march'", {"solver": "march"}),
    ],
)
def test_the_advice_of_a_scan_in_time_gives_a_good_line(
    relief: float, scanner_range: float | None, advised: pm.Status, words: str, change: Case
) -> None:
    def scanned(solver: str = "averaging", **changes: Any) -> np.ndarray:
        surface = pm.Surface(2e9, 0.05, 0.02, topography=np.repeat([0.0, relief, 0.0], 5)[None], pixel_size=4e-9)
        control = replace(FAST, **{"scanner_range": scanner_range, **changes})
        return np.asarray(pm.simulate(surface, SCOPE, 0.7, solver, control).status)

    assert advised.code in scanned() and words in advised.value
    assert not scanned(**change).any()


SOFT = pm.Surface(1e6, 0.01, 0.02, pixel_size=4e-9, shape=(1, 1))


def soft(setpoint: float = 0.4, amplitude: float = 60e-9, radius: float = 10e-9, stiffness: float = 40.0) -> list[str]:
    """What is said beside an image of gel."""
    scope = pm.Microscope(pm.Cantilever(stiffness, 300e3, 100.0), pm.Tip(radius), pm.Drive(amplitude))
    image = pm.simulate(SOFT, scope, setpoint)
    assert not image.status.any()
    return describe_validity(image)


@pytest.mark.parametrize(
    ("words", "change"),
    [
        ("Raise the setpoint", {"setpoint": 0.97}),
        ("lower the free amplitude", {"amplitude": 5e-9}),
        ("a larger radius", {"radius": 200e-9}),
    ],
)
def test_the_advice_against_a_tip_that_sinks_in_takes_it_out(words: str, change: Case) -> None:
    (deep,) = [line for line in soft() if "sinks in deeper than its radius" in line]
    assert words in deep
    assert not [line for line in soft(**change) if "sinks in deeper than its radius" in line]


def test_averaging_in_a_liquid_is_questioned_and_another_solver_is_not() -> None:
    scope = pm.Microscope(pm.Cantilever(1.0, 30e3, 5.0), pm.Tip(10e-9), pm.Drive(20e-9))
    surface = pm.Surface(1e9, 0.005, pixel_size=4e-9, shape=(1, 1))
    (line,) = describe_validity(pm.simulate(surface, scope, 0.8, "averaging"))
    assert "Take the solver 'auto' or 'orbit'" in line
    for solver in ("auto", "orbit"):
        assert describe_validity(pm.simulate(surface, scope, 0.8, solver)) == []


def test_an_image_that_is_not_what_it_seems_warns_at_the_line_that_asked_for_it() -> None:
    surface = pm.Surface([[1e9, np.nan]], pixel_size=4e-9, allow_nan=True)
    with pytest.warns(
        pm.ResultWarning,
        match=r"^1 of 2 pixels \(50 %\): The material has a property that is not a number \(NaN\)\.$",
    ) as caught:
        pm.simulate(surface, SCOPE, 0.7)
    assert caught[0].filename == __file__


@pytest.mark.parametrize(
    ("held", "status", "words"),
    [
        ({"tip_offset": 2e-8}, pm.Status.no_stable_orbit, "at this tip offset. Take another one"),
        ({"setpoint": 0.7}, pm.Status.no_stable_orbit, "take another setpoint"),
        ({"setpoint": 0.7}, pm.Status.not_converged, "Sweep values beside these"),
        ({"tip_offset": 2e-8}, pm.Status.not_settled, "Sweep values beside these"),
    ],
)
def test_the_advice_of_a_sweep_speaks_of_what_it_has(held: Case, status: pm.Status, words: str) -> None:
    about = {"configuration": json.dumps({"sweep": "frequency", **held})}
    (said,) = describe_failures(xr.Dataset({"status": ("frequency", [0, status.code])}, attrs=about), "points")
    assert said.startswith("1 of 2 points") and words in said
    others = "setpoint", "solver=", "Accuracy", "accuracy."
    assert not [word for word in others if word in said and word not in held]


class Stiffening(pm.ContactLaw):
    """A spring that is the stiffer the less it sticks: none without adhesion."""

    @staticmethod
    def force(d: float, p: np.ndarray) -> float:
        return p[0] * d

    def columns(self, contact_stiffness: np.ndarray, adhesion: np.ndarray, radius: float) -> tuple[np.ndarray]:
        return (1e-9 * contact_stiffness * 0.05 / adhesion,)


def test_what_a_law_of_the_users_own_or_ting_cannot_have_is_said_of_images_and_pixels_alike() -> None:
    own = pm.Interaction(Stiffening(), None), "numbers of this contact law are infinite or NaN", {"adhesion": 0.0}
    ting = pm.Interaction(withdrawal="ting"), "damping without stiffness", {"adhesion": 0.05, "damping": 0.1}
    for interaction, words, given in (own, ting):
        scope = pm.Microscope(SCOPE.cantilever, SCOPE.tip, SCOPE.drive, interaction)
        surface = pm.Surface([[1e9 if given["adhesion"] == 0 else 0.0]], **given, pixel_size=4e-9)
        with pytest.warns(pm.ResultWarning, match=words):
            pm.simulate(surface, scope, 0.7)
        with pytest.raises(pm.SolveError, match=words):
            pm.simulate(surface, scope, 0.7, strict=True)
    with pytest.raises(pm.SolveError, match="damping without stiffness"):
        pm.solve_pixel(pm.Material(0.0, 0.05, 0.1), scope, 0.7, strict=True)


@pytest.mark.parametrize(
    ("contact", "words"),
    [
        ("dmt", r"\(NaN\)\.$"),
        (pm.interaction.Neck(0.8e-9), r"\(NaN\)\.$"),
        ("jkr", "or adhesion without stiffness, which this law cannot have"),
        (pm.interaction.MaugisDugdale(0.4e-9), "or adhesion without stiffness, which this law cannot have"),
        (pm.interaction.Capillary(humidity=0.8), "or films of liquid so thick that they meet where their neck breaks"),
        (Stiffening(), r"\(NaN\), or one for which numbers of this contact law are infinite or NaN\.$"),
    ],
)
def test_an_invalid_pixel_is_said_to_be_so_by_what_its_law_cannot_have(contact: object, words: str) -> None:
    scope = pm.Microscope(SCOPE.cantilever, SCOPE.tip, SCOPE.drive, pm.Interaction(contact, None))
    surface = pm.Surface([[1e9, np.nan]], 0.05, pixel_size=4e-9, allow_nan=True)
    with pytest.warns(pm.ResultWarning, match=words):
        pm.simulate(surface, scope, 0.7)
