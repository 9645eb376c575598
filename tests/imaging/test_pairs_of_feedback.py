"""Any two options of a scan in time together: at rest the pixels of `solve_pixel`, in motion those of the other engine.

Or one sentence refuses the two before work starts.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
import xarray as xr
from pairs import Case, Options, Pairs

import phasemap as pm
from phasemap._shared.notices import untold
from phasemap.imaging import simulation

LOOP: Options = {  # the first of each is the plain one
    "gains": ("given", "tuned", "integral alone"),
    "derivative": ("none", "some"),
    "bandwidth": ("wide", "usual"),
    "order": ("2", "1", "4"),
    "scanner": ("at once", "resonates", "creeps"),
    "range": ("unlimited", "wide"),
    "overscan": ("some", "none", "a whole line"),
    "engage": ("line", "image"),
}
OPTIONS: Options = LOOP | {
    "solver": ("auto", "averaging", "march", "orbit"),
    "contact": ("dmt", "jkr", "wet", "film"),
    "loss": ("damping", "relaxation", "ting"),
    "lever": ("one mode", "two modes", "base", "beside resonance", "sees the tip"),
    "pixels": ("all", "holes", "a line without any"),
    "ground": ("level", "far up"),
}
IN_TIME = ("relaxation", "ting")
PAIRS = Pairs(
    OPTIONS,
    [
        ("solver", {"solver": ("orbit",)}),
        ("solver", {"solver": ("averaging",), "loss": IN_TIME}),
        ("solver", {"solver": ("averaging",), "contact": ("wet",)}),
        ("contact", {"contact": ("jkr",), "loss": IN_TIME}),
        ("contact", {"contact": ("film",), "loss": ("ting",)}),
    ],
    [{"contact": ("wet",), "loss": IN_TIME}],
)
MOVING = Pairs(LOOP, [], [])
SETPOINT, FREE = 0.7, 10e-9
AVERAGED = 0  # among the flags of `solver`


def material_of(case: Case) -> pm.Material:
    relaxes = {"relaxed_modulus": 0.5e9, "relaxation_time": 1e-7}
    losses: dict[str, Any] = {"damping": {"damping": 0.02}, "ting": {"viscosity": 20.0}, "relaxation": relaxes}
    return pm.Material(1e9, 0.02, **losses[case["loss"]], thickness=20e-9 if case["contact"] == "film" else None)


def scope_of(case: Case) -> pm.Microscope:
    kind, contact = case["lever"], {"wet": "capillary"}.get(case["contact"], case["contact"])
    lever = pm.Cantilever(10.0, 300e3, 60.0, modes=2 if kind == "two modes" else ())
    drive = pm.Drive(FREE, 301e3 if kind == "beside resonance" else None, "base" if kind == "base" else "direct")
    interaction = pm.Interaction(contact, withdrawal="ting" if case["loss"] == "ting" else "linear")
    return pm.Microscope(lever, pm.Tip(10e-9), drive, interaction, "tip" if kind == "sees the tip" else "slope")


def control_of(case: Case, line_rate: float) -> pm.Feedback:
    gains = {"given": (0.1, 3e3), "tuned": (None, None), "integral alone": (0.0, 3e3)}[case["gains"]]
    resonance, quality = {"at once": (None, 10.0), "resonates": (20e3, 3.0), "creeps": (30e3, 0.4)}[case["scanner"]]
    return pm.Feedback(
        line_rate, *gains, 1e-7 if case["derivative"] == "some" else 0.0, 40e3 if case["bandwidth"] == "wide" else None,
        int(case["order"]), resonance, quality, 40e-9 if case["range"] == "wide" else None,
        {"some": 0.05, "none": 0.0, "a whole line": 1.0}[case["overscan"]], case["engage"],
    )  # fmt: skip


@cache
def solved(material: pm.Material, scope: pm.Microscope) -> pm.Pixel:
    return pm.solve_pixel(material, scope, SETPOINT)


def scan(case: Case, modulus: np.ndarray, ground: np.ndarray, line_rate: float, solver: str) -> xr.Dataset:
    """The scan of a surface that is one material but for its modulus."""
    material = material_of(case)
    loss = "viscosity" if case["loss"] == "ting" else "damping"
    names = ("adhesion", "poisson_ratio", loss, "relaxed_modulus", "relaxation_time", "thickness")
    maps = {name: value for name in names if (value := getattr(material, name)) is not None}
    surface = pm.Surface(modulus, **maps, topography=ground, pixel_size=4e-9, allow_nan=bool(np.isnan(modulus).any()))
    with untold():
        return pm.simulate(surface, scope_of(case), SETPOINT, solver, control_of(case, line_rate))


def at_rest(case: Case) -> tuple[xr.Dataset, np.ndarray, float]:
    """The scan of level ground of one material, where there is some, and the height of the ground."""
    modulus, ground = np.full((2, 3), material_of(case).modulus), 200e-9 if case["ground"] == "far up" else 0.0
    if case["pixels"] != "all":
        modulus[(0, 1) if case["pixels"] == "holes" else 0] = np.nan
    return scan(case, modulus, np.full((2, 3), ground), 500.0, case["solver"]), np.isfinite(modulus), ground


@pytest.mark.parametrize("case", PAIRS.cases([]), ids=PAIRS.label)
def test_at_rest_pixels_are_those_of_the_exact_orbit(case: Case) -> None:
    (image, there, ground), pixel = at_rest(case), solved(material_of(case), scope_of(case))
    expected = np.where(there, pm.Status.good.code, pm.Status.invalid.code)
    assert (image.status.values == expected).all() and (np.isfinite(image.phase.values) == there).all()
    averaged = (image.solver.values[:, there] == AVERAGED).any()
    assert averaged or case["solver"] != "averaging"
    off = {"phase": image.phase - pixel.phase, "height": image.height - ground - pixel.height}
    assert float(abs(off["phase"]).max()) < (0.15 if averaged else 0.005)  # degrees, of averaged orbits at Q = 60
    assert float(abs(off["height"]).max()) < 1e-12


@pytest.mark.parametrize("case", MOVING.cases([]), ids=MOVING.label)
def test_over_a_step_both_engines_record_the_same(case: Case) -> None:
    case = {name: first for name, (first, *_) in OPTIONS.items()} | case
    modulus, ground = np.full((2, 8), 1e9), np.tile(np.where(np.arange(8) < 4, 0.0, 1e-9), (2, 1))
    flow, motion = (scan(case, modulus, ground, 100.0, solver) for solver in ("averaging", "march"))
    assert not (flow.status | motion.status).any()
    error = motion.amplitude_error
    assert float(abs(error).max()) > 0.002 * FREE  # there is something to agree on
    assert float(abs(flow.amplitude_error - error).max()) < 0.04 * float(abs(error).max())
    assert float(abs(flow.phase - motion.phase).max()) < 0.4
    assert float(abs(flow.height - motion.height).max()) < 0.04e-9


@pytest.mark.parametrize("case", PAIRS.never(), ids=PAIRS.label)
def test_what_does_not_go_together_is_refused_in_a_sentence_before_work_starts(
    case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    PAIRS.assert_refused(case, lambda: at_rest(case), monkeypatch, [(simulation, "plan_image")])


BESIDE = {
    "relaxing": (pm.Material(2e9, 0.02), pm.Material(1e9, 0.02, relaxed_modulus=5e8, relaxation_time=1e-7), {}),
    "ting": (pm.Material(2e9, 0.02), pm.Material(2e9, 0.02, 0.03), {"withdrawal": "ting"}),
    "wet": (
        pm.Material(2e9, 0.02, 0.03, liquid_film=0.0), pm.Material(2e9, 0.02, liquid_film=2e-9),
        {"contact": pm.interaction.Capillary(tip_film=0.0)},
    ),
    "neck": (pm.Material(1e9), pm.Material(0.5e9, 0.05), {"contact": "jkr", "decay_length": None}),
    "loss": (pm.Material(1e9, 0.0, 0.02), pm.Material(0.5e9, 0.05), {"contact": pm.interaction.LossyDMT(2.0, 0.0)}),
}  # fmt: skip


@pytest.mark.parametrize("beside", BESIDE)
def test_a_line_is_the_same_beside_lines_of_a_material_that_remembers_or_is_wet(beside: str) -> None:
    *pair, changes = BESIDE[beside]
    scope = pm.Microscope(pm.Cantilever(20.0, 300e3, 30.0), pm.Tip(10e-9), pm.Drive(20e-9), pm.Interaction(**changes))
    gains = pm.Feedback(line_rate=200.0, proportional_gain=0.05, integral_gain=3e3, engage="line")
    alone, both = (
        pm.simulate(pm.Surface.from_labels(labels, pair, pixel_size=2e-9), scope, SETPOINT, "march", gains)
        for labels in (np.zeros((2, 6), int), np.repeat([[0], [1]], 6, axis=1))
    )
    for name in ("height", "phase", "amplitude_error"):
        np.testing.assert_array_equal(both[name].values[..., :1, :], alone[name].values[..., :1, :])
