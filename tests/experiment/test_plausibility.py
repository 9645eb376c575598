"""Numbers outside all practice: a word to who gave them, or an error if that is asked for."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import phasemap as pm
from phasemap.cli import main
from phasemap.experiment.described import describe
from phasemap.results.descriptions import describe_validity
from phasemap.scenes.ensemble import load_ensemble
from phasemap.sweeps.sweep import OFFSET, check_axis

SAMPLES = Path(__file__).parents[2] / "samples"
STEP = str(SAMPLES / "step.toml")
LEVER, TIP = pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9)

MISTAKES: dict[str, Callable[[], Any]] = {
    "free_amplitude = 0.4 m; usual 50 pm … 1 µm; did you mean 0.4 nm?": lambda: pm.Drive(0.4),
    "modulus = 3 Pa; usual 100 Pa … 2 TPa; did you mean 3 GPa?": lambda: pm.Material(3.0),
    "adhesion = 70 J/m²; usual up to 2 J/m²; did you mean 70 mJ/m²?": lambda: pm.Material(3e9, adhesion=70),
    "viscosity = 1e+09 Pa s; usual 10 µPa s … 10 MPa s.": lambda: pm.Material(3e9, viscosity=1e9),
    "decay_length = 0.3 m; usual 20 pm … 5 nm; did you mean 0.3 nm?": lambda: pm.Interaction(decay_length=0.3),
    "drive frequency = 300 Hz; usual 1 kHz … 10 MHz; did you mean 300 kHz?": lambda: pm.Drive(40e-9, frequency=300),
    "tip radius = 0.5 m; usual 500 pm … 10 µm; did you mean 0.5 nm?": lambda: pm.Tip(0.5),
    "stiffness = 300000 N/m; usual 0.001 N/m … 1000 N/m.": lambda: pm.Cantilever(300e3, 40e3, 400),
    "pixel_size = 4 m; usual 10 pm … 10 µm; did you mean 4 nm?": lambda: pm.Surface(1e9, pixel_size=4, shape=(2, 2)),
    "topography = 5 m; usual up to 100 µm; did you mean 5 nm?": lambda: pm.Surface(
        1e9, topography=5.0 * np.eye(2), pixel_size=4e-9
    ),
    "modulus = 3 Pa; usual 100 Pa … 2 TPa; did you mean 3 GPa? ": lambda: pm.Surface([[1.0, 3.0]], pixel_size=4e-9),
    "tip_offsets = 0.6 m; usual up to 100 µm; did you mean 0.6 nm?": lambda: check_axis(
        "tip_offsets", [0.6, 0], OFFSET
    ),
    "second mode's free_amplitude = 0.1 m; usual 1 pm … 100 nm; did you mean 0.1 nm?": lambda: pm.Mode(
        free_amplitude=0.1
    ),
    "free amplitude at the drive frequency = 0.000238075 m; usual up to 1 µm.": lambda: pm.Microscope(
        LEVER, TIP, pm.Drive(20e-3, frequency=330e3)
    ),
}  # fmt: skip


@pytest.mark.parametrize("sentence", MISTAKES)
def test_a_number_outside_all_practice_warns_by_name_at_the_line_that_gave_it(sentence: str) -> None:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        MISTAKES[sentence]()
    assert [str(one.message) for one in caught] == [sentence.strip()]
    assert caught[0].category is pm.PlausibilityWarning and caught[0].filename == __file__


@pytest.mark.parametrize("sentence", MISTAKES)
def test_with_strict_units_it_is_an_error(sentence: str) -> None:
    name = sentence.partition(" = ")[0]
    with pm.strict_units(), pytest.raises(pm.InputError, match=rf"^{name} is .*; allowed: the usual "):
        MISTAKES[sentence]()


def test_a_number_that_is_refused_is_asked_for_its_unit_too() -> None:
    with pytest.raises(pm.InputError, match=r"tip radius is 10; allowed: .* at most 1 m\. Did you mean 10 nm\?$"):
        pm.Tip(10)
    with pytest.raises(pm.InputError, match=r"tip radius is -10; allowed: .* at most 1 m\.$"):
        pm.Tip(-10)
    with pytest.raises(pm.InputError, match=r"free_amplitude is 10; allowed: .* at most 1 m\. Did you mean 10 nm\?$"):
        pm.Drive(10)
    scope, material = pm.Microscope(LEVER, TIP, pm.Drive(20e-9)), pm.Material(1e9)
    refused = r"tip_offsets is 10.0; allowed: .* of at least -1 and at most 1 m\. Did you mean 10 nm\?$"
    with pytest.raises(pm.InputError, match=refused):
        pm.sweep_distance(material, scope, [10, 30])
    with pytest.raises(pm.InputError, match=r"tip_offset is 35; .* Did you mean 35 nm\?$"):
        pm.orbits(material, scope, tip_offset=35)
    for amplitudes in (10, [10, 20]):
        with pytest.raises(pm.InputError, match=r"free_amplitudes is 10.0; .* at most 1 m\. Did you mean 10 nm\?$"):
            pm.contrast(material, pm.Material(2e9), scope, [0.5, 0.7], free_amplitudes=amplitudes)


def test_what_people_do_is_never_questioned() -> None:
    pm.Microscope(pm.Cantilever("6 mN/m", "8 kHz", 1.5), pm.Tip("1 nm"), pm.Drive("0.1 nm"), pm.Interaction(bias="5 V"))
    pm.Microscope(pm.Cantilever(300.0, "5 MHz", 3e4), pm.Tip("5 um"), pm.Drive("900 nm"))
    pm.Material(0.0), pm.Material("1 kPa"), pm.Material("1.1 TPa", adhesion="1 J/m^2")
    # Far from resonance the free amplitude at resonance, which is not there, may be anything.
    pm.Microscope(LEVER, TIP, pm.Drive("50 um", frequency="330 kHz"))


def test_a_name_is_said_once_in_a_command_and_in_an_ensemble(tmp_path: Path) -> None:
    with pytest.warns(pm.PlausibilityWarning, match="^free_amplitude = 0.4 m; usual") as caught:
        main(["validate", STEP, "drive.free_amplitude=0.4"])
    assert len(caught) == 1
    many = tmp_path / "many.toml"
    scene = Path(STEP).read_text()
    many.write_text(scene + "[ensemble]\ncount = 9\nvary = { drive.free_amplitude = { low = 0.2, high = 0.6 } }\n")
    with pytest.warns(pm.PlausibilityWarning) as caught:
        load_ensemble(many)
    assert len(caught) == 1


def test_commands_and_scenes_can_be_strict(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["validate", STEP, "--strict-units", "drive.free_amplitude=0.4"]) == 2
    assert (
        "[drive] free_amplitude is 0.4 m; allowed: the usual 50 pm … 1 µm. Did you mean 0.4 nm?"
        in capsys.readouterr().err
    )
    assert main(["validate", STEP, "--strict-units"]) == 0
    with pytest.raises(pm.InputError, match=r"\[drive\] free_amplitude is 0.4 m; allowed: the usual"):
        pm.load_scene(STEP, ["scan.strict_units=true", "drive.free_amplitude=0.4"])
    with pytest.raises(pm.InputError, match=r"\[scan\] strict_units is 1; allowed: true or false"):
        pm.load_scene(STEP, ["scan.strict_units=1"])


# Results outside the validity of the model


def image(stiffness: float = 40.0, quality: float = 400.0, solver: str = "orbit", **variables: Any) -> xr.Dataset:
    import json

    scope = pm.Microscope(pm.Cantilever(stiffness, 300e3, quality), TIP, pm.Drive(20e-9))
    given = {"status": [0, 0, 0, 0], **variables}
    configuration = json.dumps({"microscope": describe(scope), "solver": solver})
    return xr.Dataset({name: ("x", values) for name, values in given.items()}, attrs={"configuration": configuration})


def test_a_result_within_the_model_is_not_talked_about() -> None:
    ds = image(indentation=[1e-9, 9e-9, -1e-9, np.nan], tip_offset=[1e-8] * 4, mean_deflection=[1e-10] * 4)
    assert describe_validity(ds.assign_attrs(adhesion_force=1e-9, lever_force=1e-6)) == []
    assert describe_validity(xr.Dataset()) == []


def test_indentation_beyond_the_radius_is_counted() -> None:
    (line,) = describe_validity(image(indentation=[1e-9, 11e-9, 397e-9, np.nan]))
    assert line.startswith("2 of 4 pixels (50 %): the tip sinks in deeper than its radius (397 nm into it, 10 nm)")


def test_contact_over_more_than_half_of_the_period_is_counted() -> None:
    (line,) = describe_validity(image(tip_offset=[5e-9, -1e-9, 1e-9, np.nan], mean_deflection=[0.0, 0.0, 2e-9, np.nan]))
    assert line.startswith("2 of 4 pixels (50 %): the tip is in contact for more than half of each period")


def test_a_setpoint_that_is_an_amplitude_is_questioned() -> None:
    scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(20e-9))
    with pytest.warns(
        pm.PlausibilityWarning, match=r"^setpoint, a share of the free amplitude, = 1\.4e-08; usual 0\.001"
    ):
        pm.solve_pixel(pm.Material(1e9), scope, 14e-9)


# A soft lever in liquid over a sticky polymer. The advice is followed: nothing fails then.
def test_a_lever_too_soft_for_the_adhesion_is_told_of_sticking_and_the_advice_cures_it() -> None:
    def taken(amplitude: float) -> xr.Dataset:
        drive = pm.Drive(amplitude, excitation="direct")
        scope = pm.Microscope(pm.Cantilever("0.1 N/m", "30 kHz", 2.0), TIP, drive)
        surface = pm.Surface("3 GPa", adhesion="70 mJ/m^2", damping=0.004, pixel_size="4 nm", shape=(1, 1))
        return pm.simulate(surface, scope, setpoint=0.7)

    stuck = taken(6e-9)
    (line,) = describe_validity(stuck)
    assert line.startswith("1 of 1 pixels (100 %) failed, and the tip may stick: adhesion holds it with up to 4.4 nN")
    advice = re.search(r"Take a free amplitude above (\d+) nm", line)
    assert advice is not None and 40 < int(advice[1]) < 70
    cured = taken(1e-9 * int(advice[1]))
    assert cured["status"].values.tolist() == [[0]] and describe_validity(cured) == []


def test_averaging_where_it_is_off_by_degrees_is_counted() -> None:
    (line,) = describe_validity(
        image(quality=3.0, solver="averaging", solver_flag=[0] * 4).rename(solver_flag="solver")
    )
    assert line == (
        "4 of 4 pixels (100 %): first-order averaging is off by degrees at Q = 3. Take the solver 'auto' or 'orbit'."
    )


def test_averaging_far_from_the_resonance_is_counted_and_asks_time_what_is_held() -> None:
    surface = pm.Surface.from_labels([[0]], {0: pm.Material(2e9, 0.03, 0.01)}, pixel_size=1e-9)
    lever = pm.Cantilever(40.0, 300e3, 100.0)

    def taken(ratio: float, solver: str) -> xr.Dataset:
        drive = pm.Drive(20e-9 * 100 * abs(1 - ratio**2), ratio * 300e3)  # 20 nm, far from the resonance
        return pm.simulate(surface, pm.Microscope(lever, TIP, drive), setpoint=0.7, solver=solver)

    with pytest.warns(pm.ResultWarning, match="first-order averaging"):
        averaged = taken(0.75, "averaging")
    assert describe_validity(averaged)[-1] == (
        "1 of 1 pixels (100 %): first-order averaging is off by up to some degrees and nanometres at 0.75 of the "
        "resonance. Take the solver 'auto' or 'orbit'."
    )
    exact = taken(0.75, "orbit")
    assert averaged.branch.values == exact.branch.values
    assert abs(averaged.tip_offset.values - exact.tip_offset.values) > 0.5e-9  # it is not said for nothing
    assert not any("averaging" in line for line in describe_validity(exact))
