"""Names that a newcomer guesses, and what is said where the guess is wrong."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import phasemap as pm

LEVER, TIP, DRIVE = pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(20e-9)
SCOPE, SOFT, HARD = pm.Microscope(LEVER, TIP, DRIVE), pm.Material(1e9), pm.Material(3e9)
SURFACE = pm.Surface(1e9, pixel_size=4e-9, shape=(2, 2))

GUESSES: dict[str, Callable[[], Any]] = {
    "Material has no argument 'E'; its arguments are modulus, adhesion, damping, viscosity, poisson_ratio, "
    "thickness, relaxed_modulus, relaxation_time, liquid_film, contact_angle, relaxation. "
    "Did you mean 'modulus'?": lambda: pm.Material(E=1e9),
    "Did you mean 'poisson_ratio'?": lambda: pm.Material(1e9, nu=0.3),
    "Surface needs pixel_size; it is called as Surface(modulus, pixel_size=...).": lambda: pm.Surface(1e9),
    "Surface has no argument 'E';": lambda: pm.Surface(E=1e9, pixel_size=1e-9),
    "Tip needs radius; it is called as Tip(radius).": lambda: pm.Tip(),
    "Tip takes 3 arguments by their order and 4 are given;": lambda: pm.Tip(1e-8, None, 0.3, 4),
    "Did you mean 'drift'?": lambda: pm.Realism(drft=3),
    "Did you mean 'stiffness'?": lambda: pm.Cantilever(k=40, Q=400),
    "Did you mean 'quality_factor'?": lambda: pm.Cantilever(40, 3e5, Q=400),
    "Did you mean 'radius'?": lambda: pm.Tip(R=1e-8),
    "Did you mean 'free_amplitude'?": lambda: pm.Drive(amplitude=1e-8),
    "Did you mean 'adhesion'?": lambda: pm.Material(1e9, adhesio=0.1),
    "allowed: a Cantilever. The order is Microscope(Cantilever(...), Tip(...), Drive(...), Interaction(...)).":
        lambda: pm.Microscope(TIP, LEVER, DRIVE),
    "surface is of type Microscope; allowed: a Surface. The order is simulate(surface, scope, setpoint).":
        lambda: pm.simulate(SCOPE, SURFACE, 0.7),
    "surface is of type list; allowed: a Surface.": lambda: pm.simulate([[0, 1]], SCOPE, 0.7),
}  # fmt: skip


@pytest.mark.parametrize("sentence", GUESSES)
def test_a_wrong_guess_is_told_what_was_meant(sentence: str) -> None:
    with pytest.raises((TypeError, pm.InputError), match=re.escape(sentence)):
        GUESSES[sentence]()


def test_what_is_guessed_is_taken() -> None:
    assert pm.Interaction("DMT") == pm.Interaction("dmt")
    by_dict = pm.Surface.from_labels([[0, 1]], {0: SOFT, 1: HARD}, pixel_size=4e-9)
    assert pm.Surface.from_labels([[0.0, 1.0]], [SOFT, HARD], pixel_size="4 nm") == by_dict
    assert pm.plot.image is pm.plot.plot


def test_the_force_curve_is_that_of_the_paper() -> None:
    scope = pm.Microscope(LEVER, TIP, DRIVE, pm.Interaction("dmt", decay_length=0.3e-9))
    curve = pm.force_curve(pm.Material("3 GPa", adhesion="50 mJ/m^2"), scope, "-3 nm:2 nm:51")
    depth, pull = curve.depth.values, 2 * np.pi * 10e-9 * 0.05  # of DMT, Wang (1999) Eqs. 2 and 3
    stiffness = 4 / 3 * 3e9 / (1 - 0.35**2) * np.sqrt(10e-9)
    away = -pull / (1 - np.minimum(depth, 0) / 0.3e-9) ** 2
    wanted = np.where(depth < 0, away, stiffness * np.maximum(depth, 0) ** 1.5 - pull)
    for direction in ("approach", "retract"):  # DMT has no neck
        assert curve.force.sel(direction=direction).values == pytest.approx(wanted, rel=1e-12)
    neck = pm.force_curve(HARD, pm.Microscope(LEVER, TIP, DRIVE, pm.Interaction(pm.interaction.Neck("2 nm"))), depth)
    assert (neck.force.sel(direction="retract") == neck.force.sel(direction="approach")).all()  # nothing sticks
    sticky = pm.Material("3 GPa", adhesion=0.05)
    neck = pm.force_curve(sticky, pm.Microscope(LEVER, TIP, DRIVE, pm.Interaction(pm.interaction.Neck("2 nm"))), depth)
    held = neck.force.sel(direction="retract", depth=slice(-1.95e-9, -0.05e-9))
    assert held.values == pytest.approx(-pull)


def test_several_setpoints_are_a_dim() -> None:
    images = pm.simulate(SURFACE, SCOPE, [0.5, "70 %"], solver="averaging")
    assert images.sizes["setpoint"] == 2 and images.setpoint.values.tolist() == [0.5, 0.7]
    for setpoint in (0.5, 0.7):
        one = pm.simulate(SURFACE, SCOPE, setpoint, solver="averaging")
        assert images.sel(setpoint=setpoint).drop_vars("setpoint").equals(one)
    assert images.attrs["Conventions"] == "CF-1.11" and "flag_meanings" in images.status.attrs
    with pytest.raises(pm.InputError, match=r"setpoint is .*; allowed: one number, or several different ones"):
        pm.simulate(SURFACE, SCOPE, [0.5, 0.5])


def test_scenes_and_ensembles_show_themselves_in_a_few_lines() -> None:
    scene = pm.load_scene("samples/scan.toml", ["setpoint=0.65"])
    said = repr(scene)
    assert (
        len(said) < 900 and "setpoint 0.65" in said and "cantilever stiffness 2.8 N/m" in said and "drift 4 nm" in said
    )
    assert repr(pm.load_ensemble("samples/ensemble.toml")).startswith("Ensemble(100 samples, varied: materials.ldpe")
