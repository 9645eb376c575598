"""Any two options of a sweep or of a contrast together: each point is what the plain way knows, or a sentence refuses.

The plain way is `solve_pixel` of the material and microscope of that point, or at a tip offset `orbits`, and where only
time knows the motion there, a tip that is lowered to it from nearby.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import xarray as xr
from pairs import Case, Options, Pairs

import phasemap as pm
from phasemap.sweeps import follow
from phasemap.sweeps.contrasts import contrast_map, pair

OPTIONS: Options = {  # the first of each is the plain one
    "swept": (
        "modulus", "adhesion", "viscosity", "free_amplitude", "frequency", "stiffness", "quality_factor", "radius",
        "setpoint", "tip_offset",
    ),
    "held": ("setpoint", "tip offset"),
    "contact": ("dmt", "jkr", "hertz", "maugis", "wet", "film", "bias"),
    "loss": ("none", "damping", "viscosity", "relaxation", "spectrum", "ting"),
    "lever": ("one mode", "in liquid", "two modes", "far off resonance"),
    "excitation": ("direct", "base"),
    "order": ("rising", "falling"),
    "samples": ("none", "some"),
}  # fmt: skip
RELAXES = ("relaxation", "spectrum")
REFUSED: list[tuple[str, Options]] = [  # what the sentence is about, and options that it refuses
    ("samples", {"samples": ("some",), "loss": (*RELAXES, "ting")}),
    ("samples", {"samples": ("some",), "contact": ("wet",)}),
    ("contact", {"contact": ("jkr", "maugis"), "loss": (*RELAXES, "ting")}),
    ("contact", {"contact": ("film",), "loss": ("ting",)}),
    ("relaxation_time", {"swept": ("viscosity",), "loss": ("relaxation",)}),
    ("viscosity", {"swept": ("viscosity",), "loss": ("spectrum",)}),
]
IDLE: list[Options] = [  # options that cannot be asked for, or take long
    {"swept": ("setpoint",), "held": ("tip offset",)},
    {"swept": ("tip_offset",), "held": ("setpoint",)},
    {"contact": ("maugis",), "lever": ("far off resonance",), "held": ("tip offset",)},  # irregular
]
PAIRS = Pairs(OPTIONS, REFUSED, IDLE)
RATIO, FREE = 0.7, 20e-9
VALUES: dict[str, tuple[float, float]] = {
    "modulus": (1e9, 2e9), "adhesion": (0.01, 0.02), "viscosity": (5.0, 10.0), "radius": (10e-9, 12e-9),
    "setpoint": (0.6, 0.8),
}  # fmt: skip
SHARES: dict[str, tuple[float, float]] = {  # of what the plain microscope has
    "free_amplitude": (1.0, 1.2), "frequency": (0.99, 1.005), "stiffness": (1.0, 1.2), "quality_factor": (0.9, 1.1),
    "tip_offset": (0.9, 1.1),
}  # fmt: skip
PARTS = {
    "radius": "tip", "free_amplitude": "drive", "frequency": "drive", "stiffness": "cantilever",
    "quality_factor": "cantilever",
}  # fmt: skip
IRREGULAR = 0.1, 1e-10  # between means of motion that does not repeat itself [degree, m]
solve_pixel, orbits, sweep_distance = map(cache, (pm.solve_pixel, pm.orbits, pm.sweep_distance))  # for both directions


def material_of(case: Case, modulus: float = 1e9) -> pm.Material:
    given: dict[str, Any] = {"modulus": modulus, "adhesion": 0.02}
    if case["contact"] == "film":
        given["thickness"] = 2e-8
    if case["loss"] == "damping":
        given["damping"] = 0.01
    if case["loss"] in ("viscosity", "ting"):
        given["viscosity"] = 10.0
    if case["loss"] == "relaxation":
        given |= {"relaxed_modulus": 0.5 * modulus, "relaxation_time": 1e-7}
    if case["loss"] == "spectrum":
        given |= {"relaxation": pm.Prony([modulus / 3, modulus / 3], [20e-9, 200e-9], modulus / 3)}
    return pm.Material(**given)


def scope_of(case: Case) -> pm.Microscope:
    kind, contact = case["lever"], case["contact"]
    lever = pm.Cantilever(5.0, 30e3, 3.0) if kind == "in liquid" else pm.Cantilever(20.0, 300e3, 30.0)
    if kind == "two modes":
        lever = replace(lever, modes=2)
    drive = pm.Drive(FREE, excitation=case["excitation"])
    if kind == "far off resonance":
        drive = replace(drive, free_amplitude=FREE * 30.0 * (1 - 0.7**2), frequency=0.7 * 300e3)
    law: Any = {"wet": "capillary", "bias": "dmt"}.get(contact, contact)
    withdrawal = "ting" if case["loss"] == "ting" else "linear"
    reach = None if contact == "jkr" else 0.3e-9  # beside a longer one a neck would create energy
    interaction = pm.Interaction(law, reach, bias=2.0 if contact == "bias" else 0.0, withdrawal=withdrawal)
    return pm.Microscope(lever, pm.Tip(10e-9), drive, interaction)


def values_of(case: Case) -> list[float]:
    name, scope = case["swept"], scope_of(case)
    plain = {
        "free_amplitude": scope.drive.free_amplitude,
        "frequency": scope.drive.frequency or scope.cantilever.resonance_frequency,
        "stiffness": scope.cantilever.stiffness,
        "quality_factor": scope.cantilever.quality_factor,
        "tip_offset": RATIO * FREE,
    }
    values = VALUES[name] if name in VALUES else tuple(share * plain[name] for share in SHARES[name])
    return sorted(values, reverse=case["order"] == "falling")


def in_time(case: Case) -> bool:
    return case["contact"] == "wet" or case["loss"] in (*RELAXES, "ting")


def engages_at(case: Case) -> tuple[float, float]:
    """Value at which each direction begins on what engaging leads to; NaN where it goes on from the other one."""
    values = values_of(case)
    goes_on = case["swept"] in ("setpoint", "tip_offset")
    return (max(values), math.nan) if goes_on else (min(values), max(values))


def swept(case: Case) -> xr.Dataset:
    """The sweep with all options together."""
    name, values = case["swept"], values_of(case)
    given, samples = (material_of(case), scope_of(case)), 64 if case["samples"] == "some" else 0
    if name == "setpoint":
        return pm.sweep_setpoint(*given, values, samples=samples)
    if name == "tip_offset":
        return pm.sweep_distance(*given, values, samples=samples)
    if case["held"] == "setpoint":
        return pm.sweep_parameter(*given, name, values, setpoint=RATIO, samples=samples)
    if name == "frequency":
        return pm.sweep_frequency(*given, values, tip_offset=RATIO * FREE, samples=samples)
    return pm.sweep_parameter(*given, name, values, tip_offset=RATIO * FREE, samples=samples)


def material_and_scope_at(case: Case, value: float) -> tuple[pm.Material, pm.Microscope]:
    """Material and microscope of one point."""
    name, material, scope = case["swept"], material_of(case), scope_of(case)
    if name == "modulus":
        return material_of(case, value), scope
    if name == "viscosity":
        return replace(material, damping=0.0, viscosity=value), scope
    if name == "adhesion":
        return replace(material, adhesion=value), scope
    if name in PARTS:
        part = PARTS[name]
        return material, replace(scope, **{part: replace(getattr(scope, part), **{name: value})})
    return material, scope


def differs(
    case: Case, here: xr.Dataset, phase: float, place: float, errors: tuple[float, float], amplitude: float = math.nan
) -> str:
    """By how much a point has another phase [degree], tip offset or amplitude [m] than what is known; "" if not."""
    apart = [float(here.phase) - phase, float(here.tip_offset) - place, float(here.amplitude) - amplitude]
    loose = case["lever"] == "in liquid" and in_time(case)  # as time states of itself at low Q
    least = (2e-3, 5e-13) if loose else (1e-4, 1e-13)
    phases, lengths = IRREGULAR if float(here.motion) else np.nansum([errors, least], axis=0)
    if (np.nan_to_num(np.abs(apart)) <= [phases, lengths, lengths]).all() and math.isfinite(apart[0]):
        return ""
    return f"apart by {apart[0]:.2g} degree, {apart[1]:.2g} m, {apart[2]:.2g} m"


def assert_known(case: Case, here: xr.Dataset, value: float, first: bool) -> None:
    """A point of a sweep is an orbit that the plain way knows; the first of a direction that on which a tip engages."""
    name = case["swept"]
    material, scope = material_and_scope_at(case, value)
    found, free = list[str](), scope.driven_amplitude
    held = "tip_offset" if name == "tip_offset" or case["held"] == "tip offset" else "setpoint"
    if held == "setpoint":
        ratio = value if name == "setpoint" else RATIO
        assert math.isclose(float(here.amplitude), ratio * free, rel_tol=1e-2 if float(here.motion) else 1e-6)
    else:
        place = value if name == "tip_offset" else RATIO * FREE
        assert math.isclose(float(here.tip_offset), place, rel_tol=1e-9)
        ratio = float(here.amplitude) / free
    at: dict[str, float] = {"setpoint": ratio} if held == "setpoint" else {"tip_offset": place}
    only_time_knows = in_time(case) or bool(here.motion)
    if held == "setpoint":
        pixel = solve_pixel(material, scope, ratio, "auto" if in_time(case) else "orbit")
        found.append(differs(case, here, pixel.phase, pixel.tip_offset, (pixel.error_phase, pixel.error_height)))
    elif only_time_knows:
        near = sweep_distance(material, scope, (1.2 * place, place)).isel(tip_offset=1)
        ways = [near.isel(direction=way) for way in range(1 if first else 2)]
        found.extend(differs(case, here, float(way.phase), place, (0.0, 0.0), float(way.amplitude)) for way in ways)
    if not only_time_knows and not (first and held == "setpoint"):
        known = orbits(material, scope, **at)
        for one in (known.isel(orbit=i) for i in range(known.sizes["orbit"]) if known.stable[i]):
            where = float(one.phase), float(one.tip_offset), (0.0, 0.0), float(one.amplitude)
            found.append(differs(case, here, *where))
    assert "" in found, f"at {value:g}, branch {int(here.branch)}, {float(here.phase):.5f} degree: {found}"


@pytest.mark.parametrize("case", PAIRS.cases([]), ids=PAIRS.label)
def test_each_point_is_an_orbit_that_the_plain_way_knows(case: Case) -> None:
    name, values = case["swept"], values_of(case)
    sweep = swept(case)
    np.testing.assert_array_equal(sweep[name], values)
    assert (sweep.status == 0).all(), sweep.status.values
    for direction, begins in zip(sweep.direction.values.tolist(), engages_at(case), strict=True):
        for i, value in enumerate(values):
            here = sweep.sel(direction=direction).isel({name: i})
            assert_known(case, here, value, first=value == begins)
            if case["samples"] == "some" and not float(here.motion):
                assert 0.9 < float(here.trace_force.max() / here.peak_force) < 1 + 2e-4  # as `peak_force` says


@pytest.mark.parametrize("case", PAIRS.never(), ids=PAIRS.label)
def test_what_does_not_go_together_is_refused_in_a_sentence_before_work_starts(
    case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    work = [(follow, name) for name in ("distance_curves", "held_curves", "swept_curves", "far_state")]
    PAIRS.assert_refused(case, lambda: swept(case), monkeypatch, work)


MAPS: Options = {
    "axis": ("setpoints", "free_amplitudes", "frequencies"),
    "contact": ("dmt", "wet", "film"),
    "loss": OPTIONS["loss"],  # of the first material
    "second": ("none", "viscosity", "relaxation"),
    "lever": OPTIONS["lever"],
    "excitation": OPTIONS["excitation"],
    "order": OPTIONS["order"],
    "solver": ("auto", "orbit", "averaging", "march"),
    "threads": ("one", "two"),
}
UNTIMED = ("orbit", "averaging")
MAP_PAIRS = Pairs(
    MAPS,
    [
        ("solver", {"solver": UNTIMED, "loss": (*RELAXES, "ting")}),
        ("solver", {"solver": UNTIMED, "second": ("relaxation",)}),
        ("solver", {"solver": UNTIMED, "contact": ("wet",)}),
        ("contact", {"contact": ("film",), "loss": ("ting",)}),
    ],
    [],
)
AVERAGED = {"orbit": (1e-3, 1e-12)}  # errors that the cheap path may leave, of which `solve_pixel` has none


def mapped(case: Case) -> tuple[xr.Dataset, tuple[pm.Material, pm.Material], list[tuple[pm.Microscope, float]]]:
    """The map of a contrast with all options together, its materials, and microscope and setpoint of each point."""
    scope, axis = scope_of(case), case["axis"]
    of_drive = axis.removesuffix("s") if axis == "free_amplitudes" else "frequency"
    values = values_of({**case, "swept": "setpoint" if axis == "setpoints" else of_drive})
    materials = material_of(case), material_of({**case, "loss": case["second"]}, 2e9)
    given: dict[str, Any] = {"setpoints": [0.7, 0.6]} | {axis: values}
    threads = 1 if case["threads"] == "one" else 2
    found = pm.contrast(*materials, scope, **given, solver=case["solver"], threads=threads)
    if axis == "setpoints":
        return found, materials, [(scope, value) for value in values]
    drives = (replace(scope.drive, **{of_drive: value}) for value in values)
    return found.isel(setpoint=0), materials, [(replace(scope, drive=drive), 0.7) for drive in drives]


@pytest.mark.parametrize("case", MAP_PAIRS.cases([]), ids=MAP_PAIRS.label)
def test_each_point_of_a_contrast_is_what_a_pixel_shows(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pair, "HALVINGS", 0)  # jumps and inversions are not asked for
    found, materials, points = mapped(case)
    for i, (scope, setpoint) in enumerate(points):
        for k, material in enumerate(materials):
            here = found.isel(material=k, **dict.fromkeys(found.contrast.dims, i))
            pixel = pm.solve_pixel(material, scope, setpoint, case["solver"])
            assert int(here.status) == pixel.status.code
            errors = np.nansum([(pixel.error_phase, pixel.error_height), AVERAGED.get(case["solver"], (0, 0))], axis=0)
            for name, error, least in zip(("phase", "height"), errors, (1e-6, 1e-16), strict=True):
                np.testing.assert_allclose(here[name], getattr(pixel, name), rtol=0, atol=error + least)


@pytest.mark.parametrize("case", MAP_PAIRS.never(), ids=MAP_PAIRS.label)
def test_what_does_not_go_together_in_a_contrast_is_refused_before_work_starts(
    case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    MAP_PAIRS.assert_refused(case, lambda: mapped(case), monkeypatch, [(contrast_map, "_mapped")])
