"""Fits recover what made the data, within their own errors, and say so where they cannot."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
import xarray as xr

import phasemap as pm
from phasemap._kernels import columns as col
from phasemap.experiment.material import with_modulus
from phasemap.inference.curves import evidence, residuals
from phasemap.inference.curves.data import CurveSetting, check_data, check_parameters
from phasemap.inference.curves.recorded import EVERY, compared, of_curve, refused, under, with_law
from phasemap.solvers.continuation.path import Question
from phasemap.solvers.continuation.visit import Visit

SCOPE = pm.Microscope(pm.Cantilever(40.0, 148.24e3, 250.0), pm.Tip(30e-9), pm.Drive(155e-9))  # Wang (1999), Fig. 3
FILM = pm.Material(0.89e9, 0.37, 0.014)
HEIGHT = 140e-9
FREQUENCIES = np.linspace(146.5e3, 150e3, 51)
OFFSETS = np.linspace(158e-9, 100e-9, 41)
LOSSY = replace(SCOPE, interaction=pm.Interaction(pm.interaction.LossyDMT()))
RUBBER = pm.Material(adhesion=0.05, relaxation=pm.Prony([1e9, 5e8], [1e-6, 1e-5], 1e9))
NOISE = {"amplitude_error": 0.5e-9, "phase_error": 0.5}


def noisy(sweep: xr.Dataset, direction: str | tuple[str, ...], seed: int, scale: float = 1.0) -> dict[str, Any]:
    """What an instrument would have recorded of a sweep, as arguments of a fit."""
    generator = np.random.default_rng(seed)
    seen = sweep.sel(direction=direction if isinstance(direction, str) else list(direction))
    read = {
        name: seen[name].values + scale * NOISE[f"{name}_error"] * generator.normal(size=seen[name].shape)
        for name in ("amplitude", "phase")
    }
    return {**read, **NOISE, "direction": direction, "scope": SCOPE}


def response(material: pm.Material, direction: str | tuple[str, ...], seed: int, height: float = HEIGHT) -> Any:
    sweep = pm.sweep_frequency(material, SCOPE, FREQUENCIES, tip_offset=height)
    return {**noisy(sweep, direction, seed), "tip_offset": height}


def distance(material: pm.Material, direction: str | tuple[str, ...], seed: int, scale: float = 1.0) -> Any:
    return noisy(pm.sweep_distance(material, SCOPE, OFFSETS), direction, seed, scale)


def pulls(fit: pm.Fit, material: pm.Material = FILM) -> np.ndarray:
    return np.array([(fit.values[n] - getattr(material, n)) / fit.errors[n] for n in fit.values if n != "offset"])


@pytest.fixture(scope="module")
def both() -> pm.Fit:
    start = pm.Material(1.5e9, 0.25, 0.025)
    return pm.fit_distance(OFFSETS, **distance(FILM, ("approach", "retract"), 5), start=start)


@pytest.fixture
def few_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few places of the prior to choose other starts from, and short descents: where these lead is not asked."""
    monkeypatch.setattr(evidence, "LOOKS", 20)
    monkeypatch.setattr(evidence, "EVALUATIONS", 10)


# chi2 / degrees of ~100 values has a standard deviation of 0.14.
def is_right(fit: pm.Fit, material: pm.Material = FILM) -> bool:
    return fit.good and bool((abs(pulls(fit, material)) < 3).all()) and 0.6 < fit.chi2 / fit.degrees < 1.4


@pytest.mark.parametrize(
    ("direction", "factors"),
    [("up", (1.4, 0.6, 0.4)), pytest.param("down", (0.6, 1.6, 0.4), marks=pytest.mark.slow)],
)
def test_a_frequency_response_gives_back_what_made_it(direction: str, factors: tuple[float, ...]) -> None:
    start = pm.Material(*(f * v for f, v in zip(factors, (0.89e9, 0.37, 0.014), strict=True)))
    assert is_right(pm.fit_frequency(FREQUENCIES, **response(FILM, direction, 1), start=start))


@pytest.mark.parametrize(("direction", "factors"), [("approach", (3.0, 3.0, 3.0)), ("retract", (0.4, 1.6, 0.33))])
def test_a_distance_curve_gives_back_what_made_it(direction: str, factors: tuple[float, ...]) -> None:
    start = pm.Material(*(f * v for f, v in zip(factors, (0.89e9, 0.37, 0.014), strict=True)))
    assert is_right(pm.fit_distance(OFFSETS, **distance(FILM, direction, 2), start=start))


@pytest.mark.slow
def test_errors_are_those_of_many_measurements() -> None:
    offsets = np.linspace(146e-9, 128e-9, 9)
    sweep, found = pm.sweep_distance(FILM, SCOPE, offsets), []
    for seed in range(20):
        data = noisy(sweep, "approach", seed)
        fit = pm.fit_distance(offsets, **data, start=FILM, parameters=("modulus", "damping"), starts=1)
        found.append(pulls(fit))
    spread = np.std(found, axis=0)
    assert (spread > 0.7).all() and (spread < 1.4).all()  # 20 pulls: 1 +- 0.16


@numba.njit
def run_in(lever, sample, base, height):
    """Cosine and sine part of a tip's motion after it rang down, at a frequency of 1 by time."""
    omega, k, alpha = lever
    stiffness, pull, decay, damping, radius = sample

    def acceleration(turn, z, v):
        deep, gap = max(z - height, 0.0), max(height - z, 0.0)
        force = stiffness * math.sqrt(radius) * deep**1.5 - pull / (1 + gap / decay) ** 2
        return base * math.cos(turn) - 2 * (alpha + damping * math.sqrt(deep / radius)) * v - z - force / k

    steps, periods = 300, 130  # of the lever's 50 / pi periods of ringing down: e^-8
    h, turn, z, v, cosine, sine = 2 * math.pi / omega / steps, 2 * math.pi / steps, 0.0, 0.0, 0.0, 0.0
    for i in range(steps * periods):
        if i >= steps * (periods - 1):
            cosine += 2 / steps * z * math.cos(i * turn)
            sine += 2 / steps * z * math.sin(i * turn)
        a1 = acceleration(i * turn, z, v)
        v2 = v + h / 2 * a1
        a2 = acceleration((i + 0.5) * turn, z + h / 2 * v, v2)
        v3 = v + h / 2 * a2
        a3 = acceleration((i + 0.5) * turn, z + h / 2 * v2, v3)
        v4 = v + h * a3
        a4 = acceleration((i + 1) * turn, z + h * v3, v4)
        z = z + h / 6 * (v + 2 * v2 + 2 * v3 + v4)
        v = v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    return cosine, sine


def integrated(frequencies: np.ndarray, scope: pm.Microscope, height: float) -> tuple[np.ndarray, np.ndarray]:
    """Amplitude and phase of a tip that started at rest, by classical Runge-Kutta, from Eqs. 1-4 of Wang (1999)."""
    k, radius, alpha = 40.0, scope.tip.radius, 0.5 / scope.cantilever.quality_factor
    base = scope.drive.free_amplitude * 2 * alpha
    stiffness, pull = 4 / 3 * FILM.modulus / (1 - 0.35**2), 2 * np.pi * FILM.adhesion * radius
    sample = stiffness, pull, scope.interaction.decay_length, FILM.damping, radius
    parts = [run_in((omega, k, alpha), sample, base, height) for omega in frequencies / 148.24e3]
    first = np.array([cosine - 1j * sine for cosine, sine in parts])
    return np.abs(first), 90 + np.degrees(np.angle(first))


@pytest.mark.slow
def test_a_response_that_was_integrated_in_time_is_fitted_as_well() -> None:
    scope = pm.Microscope(pm.Cantilever(40.0, 148.24e3, 50.0), pm.Tip(30e-9), pm.Drive(50e-9))
    frequencies = np.array([146, 146.5, 147, 147.3, 147.6, 148, 148.4, 149.5, 150, 150.5, 151]) * 1e3
    amplitude, phase = integrated(frequencies, scope, 35e-9)
    fit = pm.fit_frequency(
        frequencies, scope=scope, start=pm.Material(1.5e9, 0.25, 0.02), tip_offset=35e-9,
        amplitude=amplitude, phase=phase, amplitude_error=0.1e-9, phase_error=0.2, direction="down",
    )  # fmt: skip
    assert fit.good, str(fit)
    assert fit.chi2 < 3  # no noise: what is left is the integration's error
    assert (abs(pulls(fit)) < 1).all()


def test_errors_grow_as_the_noise_does() -> None:
    data = distance(FILM, "retract", 0, scale=0)
    one = pm.fit_distance(OFFSETS, **data, start=FILM)
    data.update(amplitude_error=1e-9, phase_error=1.0)
    two = pm.fit_distance(OFFSETS, **data, start=FILM)
    for name in one.errors:  # the model is not linear over an error: a few percent
        assert two.errors[name] / one.errors[name] == pytest.approx(2, rel=0.05)


def test_correlations_are_a_correlation_matrix(both: pm.Fit) -> None:
    matrix = both.correlation
    assert list(matrix.parameter.values) == list(matrix.other.values) == ["modulus", "adhesion", "damping"]
    np.testing.assert_allclose(matrix.values, matrix.values.T, rtol=1e-12)
    assert (np.diag(matrix) == 1).all() and (np.linalg.eigvalsh(matrix.values) > 0).all()


def test_data_of_both_directions_are_fitted_at_once(both: pm.Fit) -> None:
    assert is_right(both)
    assert both.degrees == 4 * len(OFFSETS) - 3
    assert both.material == pm.Material(**{**both.values, "poisson_ratio": 0.35})


def test_a_fit_prints_its_units_and_goes_into_a_file(both: pm.Fit, tmp_path: Path) -> None:
    text = str(both)
    assert text.startswith("good fit") and " GPa" in text and " J/m²" in text and f"chi2 {both.chi2:.1f}" in text
    both.to_dataset().to_netcdf(tmp_path / "fit.nc")
    with xr.open_dataset(tmp_path / "fit.nc") as found:
        assert found.parameter_value.sel(parameter="modulus").item() == both.values["modulus"]
        assert found.attrs["good"] == 1
        apart = (found.fitted_amplitude - found.measured_amplitude) / found.measured_amplitude_error
        turned = (found.fitted_phase - found.measured_phase) / found.measured_phase_error
        assert float((apart**2 + turned**2).sum()) == pytest.approx(both.chi2)


@pytest.mark.slow
def test_an_unknown_offset_and_viscosity_are_found() -> None:
    viscous = pm.Material(0.89e9, 0.37, viscosity=50.0)
    data = distance(viscous, "retract", 3)
    start = pm.Material(1.4e9, 0.5, viscosity=90.0)
    names = ("modulus", "adhesion", "viscosity", "offset")
    fit = pm.fit_distance(OFFSETS - 5e-9, **data, start=start, offset=3e-9, parameters=names)
    assert is_right(fit, viscous)
    assert abs(fit.values["offset"] - 5e-9) < 3 * fit.errors["offset"] < 1e-9
    assert fit.material.viscosity == fit.values["viscosity"]


def test_data_that_never_touch_determine_nothing() -> None:
    data = response(FILM, "up", 4, height=160e-9)
    fit = pm.fit_frequency(FREQUENCIES, **data, start=FILM, parameters=("modulus", "damping"))
    assert not fit.good
    assert np.isinf(list(fit.errors.values())).all()
    assert "modulus and damping not identifiable" in fit.status


@pytest.mark.slow
def test_what_is_not_known_of_the_radius_is_in_the_errors_and_said() -> None:
    data, names = distance(FILM, "retract", 6), ("modulus", "adhesion", "damping", "radius")
    fit = pm.fit_distance(OFFSETS, **data, start=FILM, parameters=names)
    held = pm.fit_distance(OFFSETS, **data, start=FILM)
    assert "radius only together with" in fit.status or "radius not identifiable" in fit.status
    assert fit.errors["radius"] / fit.values["radius"] == pytest.approx(np.log(1.44), rel=0.1)  # no better than before
    assert all(fit.errors[name] > 3 * held.errors[name] for name in ("modulus", "adhesion"))
    assert (abs(pulls(held)) < 3).all()
    known = pm.fit_distance(OFFSETS, **data, start=FILM, parameters=dict.fromkeys(names[:3]) | {"radius": 1.02})
    assert known.errors["modulus"] < 0.3 * fit.errors["modulus"]


@pytest.mark.slow
def test_a_damping_that_is_not_there_has_no_error_bar() -> None:
    data = distance(pm.Material(0.89e9, 0.37), "retract", 8)
    fit = pm.fit_distance(OFFSETS, **data, start=FILM)
    assert not fit.good
    assert np.isinf(fit.errors["damping"]) and np.isfinite(fit.errors["modulus"])
    assert "modulus and adhesion determined; damping not identifiable" in fit.status


def test_data_of_the_other_direction_are_found_out() -> None:
    data = {**response(FILM, "up", 7), "direction": "down"}
    fit = pm.fit_frequency(FREQUENCIES, **data, start=FILM)
    assert not fit.good
    assert "its sweep does not visit (down)" in fit.status
    off = fit.curve.off_branch.sel(direction="down").values.astype(bool)
    jumps = fit.curve.jump_frequency.values  # between the outermost ones up and down sweeps may differ, nowhere else
    inside = (jumps.min() < FREQUENCIES) & (FREQUENCIES < jumps.max())
    assert off.any() and not (off & ~inside).any()


def test_a_single_datum_that_jumped_early_is_named_and_does_no_harm() -> None:
    data, down = response(FILM, "up", 11), response(FILM, "down", 11)
    last = int(np.flatnonzero(FREQUENCIES < 148.482e3)[-1])  # the upward jump is at 148.4823 kHz
    for name in ("amplitude", "phase"):
        data[name][last] = down[name][last]
    fit = pm.fit_frequency(FREQUENCIES, **data, start=FILM)
    assert is_right(fit), str(fit)
    assert f"next to a jump (up) on another branch: {FREQUENCIES[last] / 1e3:.6g} kHz" in fit.status


@pytest.mark.slow
def test_a_model_that_does_not_fit_is_tried_from_other_starts(few_looks: None) -> None:
    data = distance(FILM, "retract", 9)
    data["amplitude"] = 1.3 * data["amplitude"]
    fit = pm.fit_distance(
        OFFSETS[::4], **{k: v[::4] if np.ndim(v) else v for k, v in data.items()}, start=FILM, starts=2
    )
    assert not fit.good and fit.starts == 2
    assert "after 2 starting points" in fit.status


@pytest.mark.slow
def test_other_starts_lie_within_what_is_searched(few_looks: None) -> None:
    # A decay length, which is known better than a material, is sought nearer to its start.
    scope = replace(SCOPE, interaction=pm.Interaction("dmt", 0.3e-9))
    fit = pm.fit_distance(
        OFFSETS[::8], scope=scope, start=FILM, parameters=("adhesion", "decay_length", "offset"),
        amplitude=np.linspace(100e-9, 10e-9, 6), amplitude_error=1e-11, starts=2,
    )  # fmt: skip
    assert not fit.good and fit.starts == 2


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"phase": None, "amplitude": None}, "at least one of the two"),
        ({"phase": np.zeros(4)}, r"phase is an array of shape \(4,\); allowed: one of shape \(41,\)"),
        ({"phase": np.full(41, np.nan)}, "phase is 'nan .41 of 41 values.'"),
        ({"amplitude_error": 0.0}, "amplitude_error is 0.0; allowed: numbers above 0 m"),
        ({"phase_error": np.full(41, -1.0)}, "phase_error is -1.0"),
        ({"phase_error": None}, "phase_error is None; allowed: numbers in degree"),
        ({"phase_error": np.ones(3)}, "phase_error is an array of shape"),
        ({"phase": "much"}, "phase is 'much'; allowed: numbers"),
        ({"direction": "up"}, 'direction is \'up\'; allowed: "approach", "retract"'),
        ({"direction": 3}, "direction is 3"),
        ({"parameters": ("modulus", "hardness")}, "parameters is 'hardness'; allowed: names out of modulus, adhesion"),
        ({"parameters": ("modulus", "tip_offset")}, "parameters is 'tip_offset'"),
        ({"parameters": ("modulus", "modulus")}, "every name once"),
        ({"parameters": ("viscosity",)}, "allowed: damping, because"),
        ({"parameters": "modulus"}, "a sequence of names"),
        ({"start": pm.Material(1e9, 0.0, 0.01)}, "adhesion to start from is 0.0; allowed: a number above 0 J m-2"),
        ({"tip_offsets": OFFSETS[[0, 2, 1, 3]]}, "tip_offsets is"),
        ({"offset": np.inf}, "offset is inf"),
        ({"starts": 0}, "starts is 0"),
        (
            {"scope": LOSSY, "parameters": ("outer_loss",)},
            "outer_loss to start from is 0.0; allowed: a number above 0 N s",
        ),
        ({"scope": LOSSY, "parameters": ("adhesion_ratio",)}, "adhesion_ratio to start .*; allowed: a number above 1"),
        ({"start": RUBBER, "parameters": ("damping",)}, "allowed: modulus, adhesion or relaxation_time, because"),
    ],
)
def test_what_cannot_be_fitted_is_refused_in_a_sentence(changes: dict[str, Any], message: str) -> None:
    arguments = {
        "tip_offsets": OFFSETS, "scope": SCOPE, "start": FILM, "amplitude": np.ones(41), "phase": np.ones(41), **NOISE
    }  # fmt: skip
    with pytest.raises(pm.InputError, match=message):
        pm.fit_distance(**{**arguments, **changes})


def test_as_many_parameters_as_data_are_refused() -> None:
    with pytest.raises(pm.InputError, match="number of data is 3; allowed: more than the number of fitted parameters"):
        pm.fit_distance(OFFSETS[:3], scope=SCOPE, start=FILM, phase=np.zeros(3), phase_error=1.0)


@pytest.mark.slow
@pytest.mark.parametrize("law", ["jkr", pytest.param(pm.interaction.Neck(2e-9), id="neck")])
def test_a_curve_of_a_law_with_a_neck_gives_back_what_made_it(law: Any) -> None:
    # Without an attraction from afar the orbits that touch lie on a piece apart from the curve from far.
    scope = replace(SCOPE, interaction=pm.Interaction(law, decay_length=None))
    offsets = np.linspace(148e-9, 138e-9, 5)
    data = {**noisy(pm.sweep_distance(FILM, scope, offsets), "approach", 12), "scope": scope}
    fit = pm.fit_distance(offsets, **data, start=pm.Material(1.2e9, 0.3, 0.02), starts=1)
    assert (abs(pulls(fit)) < 3).all() and fit.chi2 / fit.degrees < 2.6, str(fit)  # 7 degrees: 1 +- 0.53


def test_laws_are_ranked_by_how_likely_they_make_the_data() -> None:
    offsets = np.linspace(158e-9, 120e-9, 15)
    data = noisy(pm.sweep_distance(FILM, SCOPE, offsets), "approach", 13)
    fit = pm.fit_distance(offsets, **data, start=FILM, laws=("hertz", "dmt"), starts=2)
    assert fit.scope.interaction.law.name == "dmt" and fit.good
    assert fit.rivals[0].scope.interaction.law.name == "hertz" and fit.evidence > fit.rivals[0].evidence + 5
    assert fit.discrepancy < 1.3 < 3 < fit.rivals[0].discrepancy
    assert set(fit.values) == {"modulus", "adhesion", "damping", "decay_length"}, "the law's own numbers too"
    assert set(fit.rivals[0].values) == {"modulus", "damping"}, "what does not act under the law is not fitted"
    assert "law hertz" in str(fit)
    slipping = pm.Interaction(pm.interaction.Film("slipping"))
    assert replace(fit, scope=replace(fit.scope, interaction=slipping)).law == "slipping film"


@pytest.mark.slow
def test_a_soft_film_on_a_stiff_substrate_is_said_not_to_be_the_substrate() -> None:
    offsets = np.linspace(158e-9, 120e-9, 15)
    data = noisy(pm.sweep_distance(FILM, SCOPE, offsets), "approach", 14)
    fit = pm.fit_distance(offsets, **data, start=pm.Material(60e9, 0.37, 0.014), starts=3)
    assert "not that material, but a film on it" in fit.status and abs(pulls(fit)[0]) < 4


def recorded(scope: pm.Microscope, seed: int, sensitivity: float = 60e-9) -> xr.Dataset:
    """A curve as `read_curve` gives it, in volts and as lag, of a film under a microscope."""
    generator, z = np.random.default_rng(seed), np.linspace(185e-9, 135e-9, 401)
    sweep = pm.sweep_distance(FILM, scope, z)
    amplitude = (sweep.amplitude.values + generator.normal(scale=0.3e-9, size=(2, len(z)))) / sensitivity
    lag = 92.0 - sweep.phase.values + generator.normal(scale=0.3, size=(2, len(z)))
    dims = ("direction", "point")
    ds = xr.Dataset(
        {"distance": (dims, np.array([z, z]) - z.min(), {"units": "m"}), "amplitude": (dims, amplitude, {"units": "V"}),
         "phase": (dims, lag, {"units": "degree"})}, {"direction": ["approach", "retract"]},
    )  # fmt: skip
    return ds.assign_attrs(
        free_amplitude_voltage=scope.driven_amplitude / sensitivity, phase_zero=92.0 - scope.free_phase,
        phase_sign=-1.0, amplitude_sensitivity=1.08 * sensitivity,
    )  # fmt: skip


def test_a_recorded_curve_says_its_sensitivity_and_its_material_within_their_errors() -> None:
    tuned = replace(SCOPE.drive, frequency=148.24e3 * (1 + 0.12 * SCOPE.cantilever.damping_ratio))
    beside = replace(SCOPE, drive=tuned)  # above the resonance by 0.12 half widths, which makes 7 degrees
    fit = pm.fit_distance(recorded(beside, 21), scope=SCOPE, start=pm.Material(2e9, 0.3, 0.02), starts=2)
    assert abs(fit.values["free_phase"] - beside.free_phase) < 3 * fit.errors["free_phase"] < 4 < -beside.free_phase
    found = fit.values["sensitivity"]
    assert abs(found - 1 / 1.08) < 3 * fit.errors["sensitivity"] < 0.3, str(fit)
    assert abs(fit.values["modulus"] - FILM.modulus) < 3 * fit.errors["modulus"] < 3e9
    assert fit.scope.driven_amplitude == pytest.approx(beside.driven_amplitude * 1.08 * found)
    assert set(fit.values) == {
        "modulus", "adhesion", "damping", "offset", "radius", "sensitivity", "phase_offset", "free_phase",
        "decay_length",
    }  # fmt: skip
    assert len(pm.plot.fit(fit.to_dataset()).axes) == 4
    assert len(pm.plot.plot(recorded(SCOPE, 21)).axes) == 2


def test_a_curve_of_a_lever_that_is_known_to_be_driven_beside_its_resonance_counts_from_there() -> None:
    beside = replace(SCOPE, drive=replace(SCOPE.drive, frequency=148.24e3 * (1 + SCOPE.cantilever.damping_ratio)))
    found = of_curve(recorded(beside, 23), beside, FILM)
    assert np.median(found.given["phase"][0][:, -3:]) == pytest.approx(beside.free_phase, abs=0.2)  # -45 degrees


def test_what_the_free_lever_shows_is_data_as_well() -> None:
    found = of_curve(recorded(SCOPE, 23), SCOPE, FILM)
    phase, errors = found.given["phase"]
    free = abs(phase).max(axis=0) < 0.3
    assert found.distances[-1] > 45e-9 and 3 <= free.sum() <= 8, "to the end of the curve, in few parts"
    assert (errors[:, free].max() < 0.2) and (abs(phase / errors)[:, free] < 4).all()


@pytest.mark.parametrize(("quality", "excitation"), [(1.5, "base"), (3.0, "direct"), (250.0, "base")])
def test_a_drive_beside_the_resonance_has_the_phase_asked_and_leaves_what_the_free_lever_shows(
    quality: float, excitation: str
) -> None:
    scope = pm.Microscope(pm.Cantilever(1.0, 50e3, quality), pm.Tip(7e-9), pm.Drive(20e-9, 51e3, excitation))
    first = CurveSetting(FILM, scope, 0.0)
    for asked in (-20.0, 10.0, 89.9):
        setup = first.with_parameter("free_phase", asked)
        assert setup.scope.free_phase == pytest.approx(asked, abs=1e-9) or asked == 89.9
        assert setup.scope.driven_amplitude == pytest.approx(scope.driven_amplitude)
        assert setup.scope.free_phase + setup.phase_offset == pytest.approx(scope.free_phase)


def test_a_law_starts_from_the_numbers_of_another_whatever_its_own_are_called() -> None:
    scope, start, more = under("neck", SCOPE, FILM)
    for one in check_parameters([*more, "modulus", "free_phase"], CurveSetting(start, scope, 0.0), "tip_offset"):
        assert one.value(one.q(0.7 * one.start + 0.1)) == pytest.approx(0.7 * one.start + 0.1), one.name
    lengthened = CurveSetting(start, scope, 0.0).with_parameter("neck_length", 2e-9)
    assert lengthened.scope.interaction.contact == pm.interaction.Neck(2e-9) and lengthened.value("neck_length") == 2e-9


@pytest.mark.parametrize(
    ("given", "law", "lost"),
    [
        ({"bias": 1.0, "decay_length": 0.5e-9, "damping_exponent": 1.0}, "hertz", ""),
        ({"longrange": "dlvo", "decay_length": None}, "punch", ""),
        ({"longrange": pm.interaction.DLVO(debye_length=3e-9)}, "DMT", ""),
        ({"withdrawal": "ting"}, "hertz", ""),
        ({"bias": 1.0}, "jkr", "decay_length"),
        ({"bias": 1.0, "decay_length": None}, "neck", ""),
        ({"decay_length": None}, "cone", "decay_length"),
        ({"decay_length": None}, "maugis", "decay_length"),
        ({"bias": 1.0}, "cone", "bias"),
        ({"longrange": "dlvo", "withdrawal": "ting"}, "lossy dmt", "longrange, withdrawal"),
    ],
)
def test_a_law_by_name_keeps_the_interaction_of_the_microscope_but_for_what_it_refuses(
    given: dict[str, Any], law: str, lost: str
) -> None:
    asked = replace(SCOPE, interaction=pm.Interaction(**given))
    own = under(law, asked, FILM)[0].interaction
    kept = {name: value for name, value in given.items() if name not in lost}
    assert {name: getattr(own, name) for name in kept} == kept
    said = refused(asked.interaction, own)
    assert said == (f"Not as in the microscope's interaction, for {law} contact refuses it: {lost}." if lost else "")


def test_what_a_law_by_name_refuses_is_said_of_its_fit() -> None:
    scope = replace(SCOPE, interaction=pm.Interaction("hertz", bias=1.0))
    data = {**distance(FILM, "approach", 5), "scope": scope}
    fit = pm.fit_distance(OFFSETS, **data, start=FILM, laws=["cone"], parameters=("modulus",), starts=1)
    assert fit.status.endswith("for cone contact refuses it: bias.")


def test_of_all_laws_those_are_compared_that_may_have_the_material() -> None:
    assert compared("all", SCOPE, FILM) == (list(EVERY), "")
    laws, said = compared("all", SCOPE, RUBBER)
    assert set(laws) == {"dmt", "hertz", "film", "slipping film", "capillary"}
    begun = [under(law, SCOPE, RUBBER) for law in laws]
    assert all(Question(start, scope).work(marched=True).in_time for scope, start, _ in begun)
    assert said == "Not compared, because they know no relaxation: jkr, maugis, punch, cone, neck, lossy dmt."


@pytest.mark.parametrize(
    ("asked", "fitted"),
    [
        (None, {"modulus": None, "adhesion": None, "damping": None, "thickness": None, "decay_length": 2.0}),
        (("modulus", "decay_length"), {"modulus": None, "decay_length": 2.0, "thickness": None}),
        ({"modulus": 3.0, "thickness": 1.1, "decay_length": None},
         {"modulus": 3.0, "thickness": 1.1, "decay_length": 2.0}),
    ],
)  # fmt: skip
def test_the_numbers_of_a_law_are_fitted_whatever_is_asked_and_known_as_well_as_is_said(
    asked: Any, fitted: dict[str, float | None]
) -> None:
    scope, start, more = under("film", SCOPE, FILM)
    assert with_law(asked, CurveSetting(start, scope, 0.0), more) == fitted


@pytest.mark.parametrize(
    ("acts", "fitted"),
    [
        ({"contact": "hertz"}, {"modulus", "damping"}),
        ({"contact": "hertz", "bias": 1.0}, {"modulus", "damping", "decay_length"}),
        ({"contact": "dmt", "decay_length": None}, {"modulus", "adhesion", "damping"}),
        ({"contact": "dmt"}, {"modulus", "adhesion", "damping", "decay_length"}),
        ({"contact": "maugis"}, {"modulus", "adhesion", "damping", "decay_length"}),
        ({"contact": "dmt", "decay_length": None, "longrange": "dlvo"}, {"modulus", "adhesion", "damping"}),
    ],
)
def test_what_does_not_act_on_the_tip_is_not_fitted_unasked(acts: dict[str, Any], fitted: set[str]) -> None:
    scope, start, more = under(pm.Interaction(**acts), SCOPE, FILM)
    setup = CurveSetting(start, scope, 0.0)
    assert set(with_law(None, setup, more)) == fitted
    assert {one.name for one in check_parameters(None, setup, "tip_offset")} == fitted - {"decay_length"}
    assert "adhesion" in {one.name for one in check_parameters(["adhesion"], setup, "tip_offset")}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"amplitude": np.ones(3)}, "amplitude is given; allowed: nothing beside a curve that was read"),
        ({"amplitude_error": 1e-9}, "amplitude_error is given"),
        ({"phase": np.ones(3)}, "phase is given"),
        ({"phase_error": 1.0}, "phase_error is given"),
        ({"offset": 3e-9}, "offset is given"),
        ({"direction": "approach"}, r"direction is given; .* One direction is curve.sel\(direction="),
        ({"parameters": "modulus"}, "parameters is 'modulus'; allowed: a sequence of names"),
        ({"parameters": [["modulus"]]}, "a sequence of names"),
        ({"parameters": ("modulus", "hardness")}, "parameters is 'hardness'; allowed: names out of modulus"),
        ({"parameters": ("modulus", "modulus")}, "every name once"),
    ],
)
def test_what_contradicts_a_curve_that_was_read_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(pm.InputError, match=message):
        pm.fit_distance(recorded(SCOPE, 22), scope=SCOPE, **changes)


def test_of_a_curve_that_was_read_one_direction_or_some_parameters_are_fitted() -> None:
    scope = replace(SCOPE, interaction=pm.Interaction("hertz"))
    one = recorded(SCOPE, 24).sel(direction="approach")
    fit = pm.fit_distance(one, scope=scope, start=FILM, parameters=("modulus", "sensitivity"), starts=1)
    assert set(fit.values) == {"modulus", "sensitivity"}
    assert np.isnan(fit.curve.measured_phase.sel(direction="retract")).all()
    asked = of_curve(one, scope, FILM, ("modulus", "sensitivity", "liquid_film"))
    assert asked.directions == ("approach",)
    assert asked.parameters == {"modulus": None, "sensitivity": 1.15, "liquid_film": None}
    assert of_curve(one, scope, FILM, {"radius": 1.1}).parameters["radius"] == 1.1


@pytest.mark.parametrize("fitted", ["modulus", "adhesion", "damping"])
def test_what_is_not_fitted_to_a_curve_that_was_read_stays_as_given(fitted: str) -> None:
    start, more = pm.Material(2e9), () if fitted == "modulus" else ("modulus",)
    fit = pm.fit_distance(recorded(SCOPE, 25), scope=SCOPE, start=start, parameters=(fitted, *more), starts=1)
    for name in {"adhesion", "damping"} - {fitted}:
        assert getattr(fit.material, name) == 0.0
    assert getattr(fit.material, fitted) > 0


def test_a_law_that_is_not_there_is_refused() -> None:
    with pytest.raises(pm.InputError, match="law is 'wet'; allowed: one of dmt, hertz"):
        pm.fit_distance(recorded(SCOPE, 22), scope=SCOPE, laws="wet")
    with pytest.raises(pm.InputError, match=r"laws is .*; allowed: one at least of dmt"):
        pm.fit_distance(recorded(SCOPE, 22), scope=SCOPE, laws=[])
    with pytest.raises(pm.InputError, match=r"the curve is 'height'; allowed: one of phasemap.read_curve"):
        pm.fit_distance(xr.Dataset({"height": ("x", [1.0])}), scope=SCOPE)
    with pytest.raises(pm.InputError, match=r"the curve is .*; allowed: one of phasemap.read_curve"):
        pm.fit_distance(recorded(SCOPE, 22).drop_vars("direction"), scope=SCOPE)


@pytest.mark.parametrize("axis", ["frequency", "tip_offset"])
def test_derivatives_from_orbits_beside_are_those_of_whole_curves(axis: str, monkeypatch: pytest.MonkeyPatch) -> None:
    values, height = (FREQUENCIES[::8], HEIGHT) if axis == "frequency" else (OFFSETS[::8], 0.0)
    one, way = (response, "up") if axis == "frequency" else (distance, "approach")
    seen, setup = one(FILM, way, 15), CurveSetting(FILM, SCOPE, height)
    given = {name: (seen[name][::8], NOISE[f"{name}_error"]) for name in ("amplitude", "phase")}
    data = check_data(axis, values, way, given)
    model = residuals.CurveProblem(data, setup, check_parameters(("modulus", "adhesion", "phase_offset"), setup, axis))
    q, ruler = np.array([0.01, -0.02, 0.01]), residuals.Ruler.strict(data)
    beside, solved = model.jacobian(q, ruler), model.evaluations
    monkeypatch.setattr(residuals, "moved", lambda *_: None)
    along = model.jacobian(q, ruler)
    assert solved == 1 and model.evaluations == 5  # the phase's zero moves no orbit
    # Orbits are exact to 1e-13 m, over a step of 2e-4 and an error of 5e-10 m.
    np.testing.assert_allclose(beside, along, atol=1e-5 * np.abs(along).max())


def test_a_law_that_loses_energy_is_named_and_its_own_numbers_are_fitted_above_their_least() -> None:
    scope, _, more = under("lossy dmt", SCOPE, FILM)
    setup = CurveSetting(FILM, scope, 0.0)
    ratio, loss = check_parameters(list(more)[:2], setup, "tip_offset")
    assert (ratio.name, loss.name, loss.units) == ("adhesion_ratio", "outer_loss", "N s m-1")
    assert [round(ratio.value(q), 3) for q in (-3, 0, 1, 9)] == [1.001, 2.0, 11.0, 1000.0]
    changed = setup.with_parameter("outer_loss", 3e-7).with_parameter("adhesion_ratio", 11.0)
    assert changed.scope.interaction.contact == pm.interaction.LossyDMT(11.0, 3e-7)
    assert changed.value("outer_loss") == 3e-7


def test_the_modulus_of_a_material_that_relaxes_takes_its_relaxation_along() -> None:
    spectrum = CurveSetting(RUBBER, SCOPE, 0.0).with_parameter("modulus", 5e9).material
    assert spectrum.relaxation == pm.Prony([2e9, 1e9], [1e-6, 1e-5], 2e9)
    solid = pm.Material(2e9, relaxed_modulus=1e9, relaxation_time=1e-6)
    assert CurveSetting(solid, SCOPE, 0.0).with_parameter("modulus", 0.5e9).material == replace(
        solid, modulus=0.5e9, relaxed_modulus=0.25e9
    )
    assert [one.name for one in check_parameters(None, CurveSetting(RUBBER, SCOPE, 0.0), "tip_offset")] == [
        "modulus",
        "adhesion",
    ]
    with pytest.raises(pm.InputError, match=r"a frequency response is given; .* fit_distance fits these too"):
        pm.fit_frequency(FREQUENCIES, **response(FILM, "up", 1), start=RUBBER)


@pytest.mark.slow
@pytest.mark.parametrize("lossy", [True, False], ids=["a lossy law", "a spectrum"])
def test_what_is_marched_in_time_comes_back_from_a_curve(lossy: bool) -> None:
    scope = pm.Microscope(pm.Cantilever(20.0, 300e3, 100.0), pm.Tip(10e-9), pm.Drive(20e-9))
    far, wanted = np.linspace(21e-9, 13e-9, 5), {"modulus": 2.5e9, "adhesion": 0.05}
    true, start, begun = RUBBER, replace(with_modulus(RUBBER, 3.2e9), adhesion=0.04), scope
    if lossy:
        true = start = pm.Material(2e9, 0.05)
        wanted = {"adhesion_ratio": 1.5, "outer_loss": 2e-7}
        begun, scope = (
            replace(scope, interaction=pm.Interaction(pm.interaction.LossyDMT(*one, 1.5e-9)))
            for one in ((2.0, 1e-7), wanted.values())
        )
    seen = pm.sweep_distance(true, scope, far).sel(direction="approach")
    fit = pm.fit_distance(
        far, scope=begun, start=start, starts=1, parameters=tuple(wanted),
        phase=seen.phase, phase_error=0.1, amplitude=seen.amplitude, amplitude_error=20e-12,
    )  # fmt: skip
    assert fit.good and fit.chi2 < 1e-3
    for name, value in wanted.items():
        assert abs(fit.values[name] - value) < fit.errors[name] < 0.05 * value


def test_a_branch_that_is_left_and_reached_again_is_two(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = np.zeros((7, col.FULL))
    rows[:, col.STIFFENING] = [-1, -1, 1, 1, 1, -1, -1]
    rows[:, col.AMPLITUDE] = np.arange(7.0)
    visit = Visit(rows, rows, np.zeros(7, np.int8), [])
    monkeypatch.setattr(residuals, "there_and_back", lambda *_: (visit, visit))
    monkeypatch.setattr(residuals, "rows_as_seen", lambda rows, _: rows)
    wet = CurveSetting(
        pm.Material(1e9, 0.05, 0.01, liquid_film=1e-9), replace(SCOPE, interaction=pm.Interaction("capillary")), 0.0
    )
    found = residuals.branches(wet, "tip_offset", np.arange(7.0))
    assert found.gap.tolist()[:3] == [[2, 1, 0, 0, 0, 1, 2], [0, 0, 1, 2, 3, 4, 5], [5, 4, 3, 2, 1, 0, 0]]


def test_the_repulsive_branch_is_known_where_the_way_over_the_data_does_not_lead_there() -> None:
    law = pm.Interaction(pm.interaction.Capillary(tip_film=0.0))
    scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 200.0), pm.Tip(8e-9), pm.Drive(20e-9), law)
    wet, far = pm.Material(3e9, 0.03, damping=0.01, liquid_film=1.5e-9), np.array([17.6e-9, 18.0e-9, 22e-9])
    assert (pm.sweep_distance(wet, scope, far).phase < 0).all()
    found = residuals.branches(CurveSetting(wet, scope, 0.0), "tip_offset", far)
    there = (found.phase > 0) & (found.gap == 0)
    assert there[:, 0].any() and not there[:, 2].any()


@pytest.mark.slow
def test_the_film_of_water_comes_back_from_a_curve_both_ways() -> None:
    law = pm.Interaction(pm.interaction.Capillary(tip_film=0.0))
    scope = pm.Microscope(pm.Cantilever(20.0, 300e3, 100.0), pm.Tip(10e-9), pm.Drive(20e-9), law)
    wet, far = pm.Material(2e9, 0.05, damping=0.01, liquid_film=0.8e-9), np.linspace(21.5e-9, 13e-9, 7)
    both = pm.sweep_distance(wet, scope, far)
    # The tip turns repulsive at another distance than it lets go of the neck: both ways show different branches.
    other = np.flatnonzero(np.sign(both.phase[0]) != np.sign(both.phase[1]))
    assert len(other)
    early = both[["phase", "amplitude"]].copy(deep=True)  # a tip that is pushed jumps a datum before it has to
    for name in early.data_vars:
        early[name].values[0, other[-1]] = both[name].values[1, other[-1]]
    fit = pm.fit_distance(
        far, scope=scope, start=replace(wet, modulus=1.5e9, liquid_film=0.6e-9), starts=1,
        direction=("approach", "retract"), parameters=("modulus", "liquid_film"),
        phase=early.phase, phase_error=0.1, amplitude=early.amplitude, amplitude_error=20e-12,
    )  # fmt: skip
    assert fit.good and fit.chi2 < 1e-3 and "next to a jump (approach)" in fit.status
    assert fit.values["liquid_film"] == pytest.approx(0.8e-9, abs=fit.errors["liquid_film"])
    assert fit.values["modulus"] == pytest.approx(2e9, abs=fit.errors["modulus"])
