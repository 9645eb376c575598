"""What a second mode shows, against two modes that were integrated in time (tests/data/bimodal.json)."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cases import Case, load

import phasemap as pm
from phasemap.results.descriptions import describe_validity

CASES = load("bimodal")
SMALL, LARGE = CASES[:4], CASES[4:7]  # A2 of 0.1 nm; the first case over with 0.5, 1 and 2 nm


def scope_of(case: Case, detection: str = "fm") -> pm.Microscope:
    lever = [case[name] for name in ("stiffness", "resonance_frequency", "quality_factor")]
    stiffer, faster = case["second_stiffness"] / lever[0], case["second_frequency"] / lever[1]
    second = pm.Eigenmode(faster, case["second_quality_factor"], stiffer)
    return pm.Microscope(
        pm.Cantilever(*lever, modes=(second,)),
        pm.Tip(case["tip_radius"]),
        pm.Drive(
            case["free_amplitude"], second=pm.Mode(free_amplitude=case["second_free_amplitude"], detection=detection)
        ),
        pm.Interaction("dmt", 0.3e-9),
    )


def surface_of(case: Case) -> pm.Surface:
    return pm.Surface(
        modulus=[[case["modulus"]]], adhesion=case["adhesion"], viscosity=case["viscosity"],
        poisson_ratio=case["poisson_ratio"], pixel_size=1e-9,
    )  # fmt: skip


def found(case: Case, detection: str = "fm") -> dict[str, float]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        image = pm.simulate(surface_of(case), scope_of(case, detection), case["setpoint"])
    assert image.status.item() == 0
    rough = image.bimodal_modulus_bound.item() > 0.05
    assert [str(one.message)[:39] for one in caught] == ["1 of 1 pixels (100 %): the second mode "] * rough
    return {str(name): float(values.item()) for name, values in image.data_vars.items()}


def reported(case: Case) -> tuple[float, float]:
    """E* [Pa] and indentation [m] that an instrument reports of the motion in time (Labuda 2016)."""
    first = case["stiffness"] / case["quality_factor"] * case["free_amplitude"] / case["amplitude"]
    first *= np.sin(np.radians(case["phase"]))
    second = 2 * case["second_stiffness"] * case["frequency_shift"] / case["second_frequency"]
    modulus = np.sqrt(2) * second**2 / (first * np.sqrt(case["tip_radius"] * case["amplitude"]))
    return float(modulus), float(case["amplitude"] * first / second)


def off(case: Case) -> float:
    """By which share the modulus is larger than that in time."""
    return found(case)["bimodal_modulus"] / reported(case)[0] - 1


@pytest.mark.parametrize("case", SMALL, ids=range(len(SMALL)))
def test_a_second_mode_shows_what_it_does_in_time(case: Case) -> None:
    image = found(case)
    # What is left: sidebands beyond second order, and an A2 of 2 to 7 hundredths of the depth, squared.
    assert image["mode2_frequency_shift"] == pytest.approx(case["frequency_shift"], rel=4e-3)
    modulus, depth = reported(case)
    assert image["bimodal_modulus"] == pytest.approx(modulus, rel=0.01)
    assert image["bimodal_indentation"] == pytest.approx(depth, rel=0.01)
    assert image["mode2_over_depth"] < 0.1


@pytest.mark.parametrize("case", CASES, ids=range(len(CASES)))
def test_the_modulus_is_that_of_two_modes_in_time_within_its_bound(case: Case) -> None:
    image = found(case)
    away = abs(off(case))
    # To first order: more than it says where the second mode moves by nearly half the depth and more.
    assert away < image["bimodal_modulus_bound"] * (1 if image["mode2_over_depth"] < 0.3 else 1.5)


IN_TIME = (CASES[1], LARGE[0], LARGE[2], CASES[14], CASES[16])  # two cantilevers, elastic and viscous, up to 2 nm


@pytest.mark.slow
@pytest.mark.parametrize("case", IN_TIME, ids=range(len(IN_TIME)))
def test_both_drives_in_time_are_those_of_another_code(case: Case) -> None:
    scope = scope_of({**case, "second_free_amplitude": case["second_amplitude"]})  # which a loop holds here
    image = pm.simulate(surface_of(case), scope, case["setpoint"], "march")
    assert image.status.item() == 0
    # That code drives each mode alone and shows the first alone: the other's answer at the first drive, k/k2 of the
    # force, turns the phase by up to 0.01 degree. It holds the setpoint to 0.1 pm in the amplitude of the first mode,
    # of which the second's part is some pm, and resonance to 2e-6 of the answer: 2 Hz.
    assert image.phase.item() == pytest.approx(case["phase"], abs=0.012)
    assert image.tip_offset.item() == pytest.approx(case["tip_offset"], abs=7e-12)
    assert image.indentation.item() == pytest.approx(case["indentation"], abs=2e-13)
    assert image.mode2_frequency_shift.item() == pytest.approx(case["frequency_shift"], abs=2)
    assert not describe_validity(image)


@pytest.mark.slow
def test_with_a_fixed_second_drive_a_small_mode_answers_in_time_as_the_quadrature_says() -> None:
    case = SMALL[1]
    told = found(case, "am")
    marched = pm.simulate(surface_of(case), scope_of(case, "am"), case["setpoint"], "march")
    # As for the frequency shift above.
    assert marched.mode2_amplitude.item() == pytest.approx(told["mode2_amplitude"], rel=4e-3)
    assert marched.mode2_phase.item() == pytest.approx(told["mode2_phase"], abs=0.3)
    assert pm.check(marched, surface_of(case)).holds


def test_no_bound_is_stated_where_the_second_mode_is_pumped() -> None:
    pumped = CASES[-1]  # twice its second resonance is 12.995 times the drive, and above 13 times with the surface
    assert 0.02 < off(pumped) < 0.04  # a quarter, if the mirrored sideband were that of a mode without the surface
    assert [found(case)["bimodal_modulus_bound"] == np.inf for case in CASES[-2:]] == [False, True]


def test_the_modulus_is_too_low_where_the_second_mode_moves_much() -> None:
    image = found(LARGE[0])
    shifts = [case["frequency_shift"] for case in LARGE]
    assert image["mode2_frequency_shift"] > shifts[0] > shifts[1] > shifts[2]
    # 0.5 nm is a fifth of the depth: 2 % in the modulus, as the documentation says.
    assert off(LARGE[0]) - off(SMALL[0]) == pytest.approx(0.02, abs=0.001)
    assert found(LARGE[1])["mode2_over_depth"] > 0.3


def test_both_ways_of_detection_report_the_same_modulus() -> None:
    case = SMALL[1]
    shift, answer = found(case), found(case, "am")
    assert answer["bimodal_modulus"] == pytest.approx(
        shift["bimodal_modulus"], rel=2e-3
    )  # 2 df/f2 is k/k2 to first order
    assert shift["mode2_amplitude"] == case["second_free_amplitude"] and shift["mode2_phase"] == 0.0
    assert answer["mode2_amplitude"] < case["second_free_amplitude"] and answer["mode2_phase"] > 0.0
    # <k>2 = (k2/Q2) (A02/A2) cos(lag) is how an instrument has it of amplitude and phase.
    stiffness = case["second_stiffness"] / case["second_quality_factor"]
    stiffness *= case["second_free_amplitude"] / answer["mode2_amplitude"] * np.sin(np.radians(answer["mode2_phase"]))
    assert stiffness == pytest.approx(answer["effective_stiffness_2"], rel=1e-12)


def test_a_scene_has_a_second_mode_and_its_file_knows_it(tmp_path: Path) -> None:
    sample = Path(__file__).parents[2] / "samples" / "step.toml"
    second = ["cantilever.modes=2", "drive.second={free_amplitude = '0.1 nm'}"]
    scene = pm.load_scene(sample, ["surface.shape=[2, 4]", *second])
    assert scene.microscope.drive.second == pm.Mode(free_amplitude=1e-10)
    names = ["phase", "amplitude", "indentation", "mean_gradient", "mean_damping"]
    names += ["sideband_stiffness", "sideband_loss"]
    image = pm.simulate(scene.surface, scene.microscope, 0.7, variables=names)
    again = pm.channels(image)
    assert again.bimodal_modulus.equals(scene.simulate()["bimodal_modulus"])
    with pytest.raises(pm.InputError, match=r"modes is \(\); allowed: .*\[\[cantilever.modes\]\]"):
        pm.load_scene(sample, second[1:])
    without = replace(scene.microscope, drive=pm.Drive(40e-9))
    with pytest.raises(pm.InputError, match=r"variables is 'bimodal_modulus'.*\[drive.second\]"):
        pm.simulate(scene.surface, without, 0.7, variables=["bimodal_modulus"])
    with pytest.raises(pm.InputError, match="detection is 'pm'"):
        pm.Mode(detection="pm")


def test_in_liquid_the_quadrature_bounds_nothing_and_says_so() -> None:
    # Two modes in time have a modulus that is 7 times larger here: sidebands of all taps swing in a second mode of Q 6.
    lever = pm.Cantilever(0.1, 30e3, 2.5, modes=(pm.Eigenmode(7.3, 6.0),))
    drive = pm.Drive(10e-9, excitation="base", second=pm.Mode(free_amplitude=0.1e-9))
    scope = pm.Microscope(lever, pm.Tip(10e-9), drive, pm.Interaction("hertz"))
    surface = pm.Surface(1e9, pixel_size=4e-9, shape=(1, 1))
    with pytest.warns(pm.ResultWarning, match="the second mode has a Q of 6"):
        image = pm.simulate(surface, scope, 0.8, variables=["bimodal_modulus", "bimodal_modulus_bound"])
    assert np.isinf(image.bimodal_modulus_bound).all()


def test_a_scan_in_time_says_that_it_has_nothing_of_the_second_mode() -> None:
    scope = scope_of(CASES[0])
    with pytest.warns(pm.ResultWarning, match="moves the lever by its first drive alone: the image has nothing of the"):
        image = pm.simulate(pm.Surface([[3e9, 3e9]], pixel_size=4e-9), scope, 0.8, control=pm.Feedback())
    assert not [name for name in image if name.startswith("mode2_")]
