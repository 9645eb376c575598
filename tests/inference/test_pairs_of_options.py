"""Any two options of a fit of a curve together: it gives back the material that made the curve, or a sentence refuses.

The curve is a sweep without noise, and the fit begins beside the truth.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import xarray as xr
from pairs import Case, Options, Pairs

import phasemap as pm
from phasemap.inference.curves import fit as fits

OPTIONS: Options = {  # the first of each is the plain one
    "axis": ("distance", "frequency"),
    "given": ("arrays", "read", "read in volts"),
    "data": ("both", "amplitude", "phase"),
    "direction": ("first", "second", "both"),
    "order": ("falling", "rising"),
    "errors": ("numbers", "arrays", "with units"),
    "parameters": ("default", "modulus", "known", "height", "reading"),
    "laws": ("none", "by name", "interaction", "two"),
    "contact": ("dmt", "hertz", "film"),
    "loss": ("damping", "viscosity", "none", "relaxation"),
    "lever": ("one mode", "base beside resonance", "two modes"),
}
READ = ("read", "read in volts")
LAWS = ("by name", "interaction", "two")
REFUSED: list[tuple[str, Options]] = [  # what the sentence is about, and options that it refuses
    ("damping_exponent", {"contact": ("punch",), "loss": ("viscosity",)}),
    ("damping to start from", {"loss": ("none",), "parameters": ("default",), "given": ("arrays",)}),
    ("a frequency response", {"axis": ("frequency",), "loss": ("relaxation",), "parameters": ("modulus",)}),
    ("contact", {"contact": ("punch",), "loss": ("relaxation",), "parameters": ("modulus",)}),
]
IDLE: list[Options] = [  # options that cannot be asked for, or take long
    {"axis": ("frequency",), "given": READ},
    {"axis": ("frequency",), "laws": LAWS},
    {"axis": ("frequency",), "contact": ("film",)},
    {"given": READ, "data": ("amplitude", "phase")},
    {"given": READ, "errors": ("arrays", "with units")},
    {"given": READ, "parameters": ("default", "known")},  # these add seven parameters, of which most are not determined
    {"given": READ, "laws": LAWS},
    {"loss": ("relaxation",)},
]
PAIRS = Pairs(OPTIONS, REFUSED, IDLE)
FREE, OFFSET = 20e-9, 14e-9
ERRORS, UNITS = {"amplitude": 0.05e-9, "phase": 0.1}, {"amplitude": "0.05 nm", "phase": "0.1 deg"}
WAYS = {"distance": ("approach", "retract"), "frequency": ("up", "down")}
BESIDE = 1.05  # where fits begin, over the truth
CLOSE, EXACT = 0.03, 0.5  # of a modulus; chi2, which is 0 of a curve without noise


def material_of(case: Case, share: float = 1.0) -> pm.Material:
    given: dict[str, Any] = {"modulus": share * 1e9, "adhesion": 0.03, "poisson_ratio": 0.3}
    given |= {"damping": {"damping": share * 0.02}, "viscosity": {"viscosity": share * 30.0}, "none": {},
              "relaxation": {"relaxed_modulus": share * 0.5e9, "relaxation_time": 1e-7}}[case["loss"]]  # fmt: skip
    return pm.Material(**given, thickness=20e-9 if case["contact"] == "film" else None)


def scope_of(case: Case) -> pm.Microscope:
    kind = case["lever"]
    lever = pm.Cantilever(20.0, 300e3, 100.0, modes=2 if kind == "two modes" else ())
    drive = pm.Drive(FREE, 300.6e3, "base") if kind == "base beside resonance" else pm.Drive(FREE)
    return pm.Microscope(lever, pm.Tip(10e-9), drive, pm.Interaction(case["contact"]))


@cache
def sweep_of(material: pm.Material, scope: pm.Microscope, axis: str, points: int) -> xr.Dataset:
    if axis == "frequency":
        return pm.sweep_frequency(material, scope, np.linspace(297e3, 303e3, points), tip_offset=OFFSET)
    free = scope.driven_amplitude
    return pm.sweep_distance(material, scope, np.linspace(1.2 * free, 0.5 * free, points))


def curve_of(case: Case) -> xr.Dataset:
    """The curve as `read_curve` gives it."""
    sweep = sweep_of(material_of(case), scope_of(case), "distance", 100)
    dims, volts = ("direction", "point"), case["given"] == "read in volts"
    distance = np.tile(sweep.tip_offset.values, (2, 1))
    scale, lag = (50e-9, 40.0 - sweep.phase.values) if volts else (1.0, sweep.phase.values)
    found = xr.Dataset(
        {"distance": (dims, distance - distance.min()), "phase": (dims, lag, {"units": "degree"}),
         "amplitude": (dims, sweep.amplitude.values / scale, {"units": "V" if volts else "m"})},
        {"direction": list(WAYS["distance"])},
    )  # fmt: skip
    scope = scope_of(case)
    free, said = scope.driven_amplitude, {"phase_zero": scope.free_phase, "phase_sign": 1}
    if volts:
        said = {"phase_zero": 40.0 - scope.free_phase, "phase_sign": -1, "amplitude_sensitivity": scale}
    found = found.assign_attrs(**said, **{"free_amplitude_voltage" if volts else "free_amplitude": free / scale})
    found = found if case["order"] == "falling" else found.isel(point=slice(None, None, -1))
    return found if case["direction"] == "both" else found.isel(direction=int(case["direction"] == "second"))


def data_of(case: Case) -> tuple[np.ndarray, dict[str, Any]]:
    """Values along the axis, and what is measured there."""
    axis, ways = case["axis"], WAYS[case["axis"]]
    way = {"first": ways[0], "second": ways[1], "both": ways}[case["direction"]]
    sweep = sweep_of(material_of(case), scope_of(case), axis, 9).sel(
        direction=way if isinstance(way, str) else list(way)
    )
    name = "frequency" if axis == "frequency" else "tip_offset"
    sweep = sweep.sortby(name, ascending=case["order"] == "rising")
    given: dict[str, Any] = {"direction": way}
    for one in ("amplitude", "phase") if case["data"] == "both" else (case["data"],):
        values = sweep[one].values
        errors = {"numbers": ERRORS[one], "arrays": np.full(values.shape, ERRORS[one]), "with units": UNITS[one]}
        given |= {one: values, f"{one}_error": errors[case["errors"]]}
    return sweep[name].values, given


def parameters_of(case: Case) -> Any:
    """What is fitted; of a curve that was read always the offset too, which no curve says."""
    if case["parameters"] in ("default", "known"):
        return {"default": None, "known": {"modulus": 3.0, "adhesion": 1.2}}[case["parameters"]]
    height = "tip_offset" if case["axis"] == "frequency" else "offset"
    more = {"modulus": (), "height": (height,), "reading": ("sensitivity", "phase_offset")}
    return tuple(dict.fromkeys(("modulus", *more[case["parameters"]], *((height,) if case["given"] in READ else ()))))


def fitted(case: Case) -> pm.Fit:
    """The fit with all options together."""
    start = (
        material_of(case, BESIDE) if parameters_of(case) is None else replace(material_of(case), modulus=BESIDE * 1e9)
    )
    given: dict[str, Any] = {"scope": scope_of(case), "start": start, "parameters": parameters_of(case), "starts": 1}
    if case["given"] in READ:
        return pm.fit_distance(curve_of(case), **given)
    values, data = data_of(case)
    if case["axis"] == "frequency":
        return pm.fit_frequency(values, **given, **data, tip_offset=OFFSET)
    scope = given["scope"]
    other = "hertz" if case["contact"] != "hertz" else "dmt"
    laws = {
        "none": None,
        "by name": case["contact"],
        "interaction": [scope.interaction],
        "two": [case["contact"], other],
    }
    return pm.fit_distance(values, **given, **data, laws=laws[case["laws"]])


@pytest.mark.parametrize("case", PAIRS.cases([]), ids=PAIRS.label)
def test_a_fit_gives_back_what_made_the_curve(case: Case) -> None:
    fit = fitted(case)
    alike = [one for one in (fit, *fit.rivals) if one.law == case["contact"]]
    assert len(alike) == 1 and len(fit.rivals) == (case["laws"] == "two")
    (one,) = alike
    (other,) = fit.rivals if one is fit and fit.rivals else (fit,) if fit.rivals else (None,)
    assert other is None or ("without thickness" in other.status) == (case["contact"] == "film")
    assert one.chi2 < (EXACT * one.degrees if case["given"] in READ else EXACT), str(one)
    assert abs(one.values["modulus"] / 1e9 - 1) < max(CLOSE, 3 * one.errors["modulus"] / 1e9), str(one)


@pytest.mark.parametrize("case", PAIRS.never(), ids=PAIRS.label)
def test_what_does_not_go_together_is_refused_in_a_sentence_before_work_starts(
    case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = {name: first for name, (first, *_) in OPTIONS.items()}
    curve = sweep_of(material_of(plain), scope_of(plain), case["axis"], 9)  # of what there is none of
    monkeypatch.setitem(globals(), "sweep_of", lambda *_: curve)
    PAIRS.assert_refused(case, lambda: fitted(case), monkeypatch, [(fits, "search")])
