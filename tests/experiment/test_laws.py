"""Every contact law: one contract, the formulas of its paper, and the solvers that follow a neck."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import hold_in_time
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

import phasemap as pm
from phasemap._kernels import columns as col
from phasemap._kernels.law import (
    Oscillator,
    contact_force,
    contact_slope,
    damping,
    damping_slope,
    longrange_force,
    longrange_slope,
)
from phasemap._kernels.neck_energy import loop_energies
from phasemap._kernels.orbits.averaged import harmonics
from phasemap._kernels.orbits.time import march
from phasemap._kernels.orbits.time.tip import PeriodResult
from phasemap.experiment import interaction as laws
from phasemap.experiment.described import describe
from phasemap.experiment.interaction import JKR, Capillary, ContactLaw, Interaction, MaugisDugdale, Neck
from phasemap.experiment.lever_numbers import one_mode
from phasemap.solvers.problem import make_work

MODULUS, ADHESION, RADIUS = 1e9, 0.05, 20e-9
PI_W_R = math.pi * ADHESION * RADIUS


def root_of(x: float) -> float:
    return math.sqrt(x)


class Own(ContactLaw):
    """A law of which only the force is said, with a helper of its own."""

    @staticmethod
    def force(d: float, p: np.ndarray) -> float:
        return p[0] * root_of(p[2]) * d * root_of(d) - 3.0 * p[1] * p[2]


# Laws as functions of the scale of lengths, so that the same physics can be had in other units.
LAWS: dict[str, Callable[[float], Any]] = {
    "hertz": lambda scale: "hertz",
    "dmt": lambda scale: "dmt",
    "jkr": lambda scale: "jkr",
    "maugis": lambda scale: "maugis",
    "punch": lambda scale: "punch",
    "maugis, own range": lambda scale: MaugisDugdale(1e-9 * scale),
    "neck": lambda scale: Neck(0.8e-9 * scale),
    "own": lambda scale: Own(),
    "lossy dmt": lambda scale: laws.LossyDMT(2.0, 1e-7, 1e-9 * scale),
    "table": lambda scale: laws.Table(
        tuple(scale * d for d in (-2e-8, -5e-9, -2e-9, 0.0, 2e-9, 5e-9, 2e-8)),
        (-1e-11, -2e-10, -1e-9, -5e-9, 1e-8, 4e-8, 4e-7),
    ),
    "punch, own radius": lambda scale: laws.FlatPunch(5e-9 * scale),
    "cone": lambda scale: laws.Cone(30.0),
    "film": lambda scale: laws.Film(),
    "slipping film": lambda scale: "slipping film",
    "capillary": lambda scale: Capillary(1e-9 * scale, contact_angle=30.0, wet_attraction=0.7),
    "capillary, constant force": lambda scale: Capillary(
        volume=40e-27 * scale**3, film_thickness=0.5e-9 * scale, reach=1.5, model="constant force"
    ),
    "capillary, linear": lambda scale: Capillary(2e-9 * scale, tip_film=0.1e-9 * scale, model="linear"),
}
WET = {"capillary", "capillary, constant force", "capillary, linear"}
NECKS = {"jkr", "maugis", "maugis, own range", "neck"} | WET
# Forces outside contact, as functions of the scales of lengths and of forces.
OUTSIDE: dict[str, Callable[[float, float], dict[str, Any]]] = {
    "van der waals": lambda length, force: {},
    "bias": lambda length, force: {"bias": 0.5 * math.sqrt(force)},
    "lennard-jones": lambda length, force: {"longrange": "lennard-jones"},
    "dlvo": lambda length, force: {
        "longrange": laws.DLVO(-0.02 * math.sqrt(force) / length, -0.01 * math.sqrt(force) / length, 3e-9 * length)
    },
    "opposite charges": lambda length, force: {
        "longrange": laws.DLVO(0.01 * math.sqrt(force) / length, -0.01 * math.sqrt(force) / length, 3e-9 * length)
    },
    "hydration": lambda length, force: {"longrange": laws.Hydration(5e-3 * force / length, 1e-9 * length)},
    "solvation": lambda length, force: {
        "longrange": laws.Solvation(-5e-3 * force / length, 1e-9 * length, 1e-9 * length)
    },
}
WITHOUT_PART_IN_CONTACT = {"van der waals", "lennard-jones", "opposite charges"}
CONTRACT = [
    (name, decay, outside)
    for name, decay, outside in itertools.product(LAWS, (None, 0.3e-9), OUTSIDE)
    if not (name in ("maugis", "cone") and decay is None)
    and (outside == "van der waals" or name not in WET | {"cone", "table", "lossy dmt"})
    and (outside in ("van der waals", "bias") or name in ("hertz", "dmt", "jkr", "maugis", "film", "own"))
]


def row_of(
    interaction: Interaction, modulus: float = MODULUS, adhesion: float = ADHESION, radius: float = RADIUS,
    damping: float = 0.0,
) -> np.ndarray:  # fmt: skip
    """Parameters of one material on a rigid tip, with Poisson's ratio 0; films of half its radius."""
    values = [np.array([x]) for x in (4 / 3 * modulus, adhesion, damping)]
    film = np.array([[0.4, 0.5 * radius]]) if interaction.law.takes_film else None
    return interaction.columns(*values, radius, film)[0]


LEVER = one_mode(1.0, 0.5 / 100, 5.0, 20e-9 / 100)  # omega, alpha0, k, u0


def over(law: Any, row: np.ndarray, lever: np.ndarray = LEVER) -> Oscillator:
    """A lever over a material, as kernels are given it."""
    return Oscillator(law, tuple(row.tolist()), lever)


@pytest.mark.parametrize(("name", "decay", "outside"), CONTRACT)
def test_every_law_keeps_the_contract(name: str, decay: float | None, outside: str) -> None:
    interaction = Interaction(LAWS[name](1.0), decay, **OUTSIDE[outside](1.0, 1.0))
    law, p, token = interaction.law, row_of(interaction), interaction.token()
    release, constant, forming = p[10], p[11], p[12]
    assert np.isfinite(p).all()
    assert (release < 0) == (name in NECKS)
    assert release < forming < 0 if name in WET else forming == 0
    assert (constant == 0) == (outside in WITHOUT_PART_IN_CONTACT)
    pull = law.pull(np.array([4 / 3 * MODULUS]), np.array([ADHESION]), RADIUS)[0]
    pull *= decay is not None or outside == "solvation" or name == "table"
    assert p[4] == pytest.approx(pull + constant, rel=1e-13, abs=1e-14 * PI_W_R)
    assert (p[4] != 0) == (pull != 0 or outside not in ("van der waals", "lennard-jones"))
    depths = [*np.geomspace(1e-12, 1e-8, 9), *(release * np.array([0.95, 0.6, 0.2, 0.01]) if release else [])]

    def force(d: float, p: np.ndarray) -> float:
        return contact_force(token, d, p) + constant

    slope = partial(contact_slope, token)
    for d in depths:
        assert force(d, p) == pytest.approx(law.force(d, p), rel=1e-12, abs=1e-14 * PI_W_R)
        assert slope(d, p) == pytest.approx(law.slope(d, p), rel=1e-10)
        h = 1e-3 * min(abs(d), d - release)
        near, far = (law.force(d + n * h, p) - law.force(d - n * h, p) for n in (1, 2))
        rounding = 4e-16 * abs(law.force(d, p)) / h
        assert slope(d, p) == pytest.approx((8 * near - far) / (12 * h), rel=1e-8, abs=10 * rounding)

    if release == 0:
        lossy, alpha = row_of(interaction, damping=0.01), partial(damping, token)
        for d in depths:
            assert alpha(d, lossy) == pytest.approx(law.damping(d, lossy), rel=1e-12)
            near, far = (alpha(d * (1 + 1e-3 * n), lossy) - alpha(d * (1 - 1e-3 * n), lossy) for n in (1, 2))
            assert damping_slope(token, d, lossy) == pytest.approx((8 * near - far) / (12e-3 * d), rel=1e-8)

    # The force is continuous in contact and through the neck, and joins the long-range force where the law says so.
    assert force(0.0, p) == pytest.approx(force(1e-20, p), rel=1e-9, abs=1e-9 * PI_W_R)
    if release:
        if decay is not None or name not in WET:  # else adhesion begins at d = 0, as that of DMT does
            assert force(-1e-20, p) == pytest.approx(force(1e-20, p), rel=1e-9)
        assert math.isfinite(force(release, p)) and math.isfinite(slope(release, p))
        assert force(release, p) == pytest.approx(force(release * (1 - 1e-14), p), rel=1e-6)
    if p[4]:
        before, fall = partial(longrange_force, token), partial(longrange_slope, token)
        assert before(0.0, p) == pytest.approx(-p[4], rel=1e-13, abs=1e-14 * PI_W_R)
        if pull and name not in WET | {"jkr", "maugis", "maugis, own range"}:
            assert before(0.0, p) == pytest.approx(force(0.0, p) - constant, rel=1e-12, abs=1e-14 * PI_W_R)
        for d in (-1e-8, -1e-9, -1e-11):
            h = min(-1e-3 * d, 4e-13)
            near, far = (before(d + n * h, p) - before(d - n * h, p) for n in (1, 2))
            rounding = 1e-15 * (abs(before(d, p)) + abs(p[4]) * 1e-3) / h
            assert fall(d, p) == pytest.approx((8 * near - far) / (12 * h), rel=1e-9, abs=rounding)
            assert before(d, p) == pytest.approx(interaction.outside.force(d, p), rel=1e-13, abs=1e-14 * PI_W_R)

    # One loop of contact and release loses what lies between the two forces from where the neck forms, and nothing
    # without a neck.
    energy = loop_energies(token, p[None])[0]
    assert energy >= 0 and (energy > 0) == (name in NECKS)
    if release:
        far_force = (lambda d: longrange_force(token, d, p)) if p[4] else (lambda d: 0.0)

        def lost(x: float) -> float:
            d = release + (forming - release) * x * x
            return (forming - release) * 2 * x * (far_force(d) - force(d, p) + constant)

        assert energy == pytest.approx(quad(lost, 0, 1)[0], rel=1e-8)


@pytest.mark.parametrize(("name", "decay", "outside"), CONTRACT)
def test_the_same_physics_in_other_units_is_the_same(name: str, decay: float | None, outside: str) -> None:
    length, force = 3.7, 0.21  # scales
    if name == "table":
        force = 1.0  # that of a table does not come from a material
    if decay is None and outside == "bias":
        outside = "van der waals"  # the gap of a voltage without decay length, 0.3 nm, does not scale
    one, scaled = Interaction(LAWS[name](1.0), decay, **OUTSIDE[outside](1.0, 1.0)), LAWS[name](length)
    if name in WET:
        scaled = replace(scaled, surface_tension=scaled.surface_tension * force / length)
    other = Interaction(scaled, decay and length * decay, **OUTSIDE[outside](length, force))
    p = row_of(one)
    q = row_of(other, MODULUS * force / length**2, ADHESION * force / length, RADIUS * length)
    assert q[[10, 12]] == pytest.approx(length * p[[10, 12]], rel=1e-9)
    for d in (1e-12, 1e-10, 5e-9, 0.9 * p[10]):
        assert one.law.force(d, p) * force == pytest.approx(other.law.force(length * d, q), rel=1e-9, abs=1e-18)
        if p[4]:
            before, after = one.outside.force(-abs(d), p), other.outside.force(-abs(d) * length, q)
            assert before * force == pytest.approx(after, rel=1e-11, abs=1e-14 * PI_W_R)


RELAXES = {"modulus": 2e9, "relaxed_modulus": 1e9, "relaxation_time": 100e-9}
# Materials, and laws as functions of the scales of lengths and of forces.
REMEMBERING: dict[str, tuple[dict[str, float], Callable[[float, float], Any]]] = {
    "solid": (RELAXES, lambda length, force: "dmt"),
    "Kelvin-Voigt after Ting": ({"modulus": 1e9, "viscosity": 20.0}, lambda length, force: "dmt"),
    "film": ({**RELAXES, "thickness": 5e-9}, lambda length, force: "film"),
    "solid under liquid": (
        RELAXES, lambda length, force: Capillary(0.3e-9 * length, surface_tension=0.072 * force / length)
    ),
}  # fmt: skip


@pytest.mark.parametrize("solver", ["auto", "march"])
@pytest.mark.parametrize("name", REMEMBERING)
def test_a_contact_that_remembers_keeps_the_contract_of_laws(name: str, solver: str) -> None:
    material, law_of = REMEMBERING[name]

    def pixel(length: float, force: float, law: str | None = None) -> pm.Pixel:
        scales = {"relaxation_time": 1.0, "thickness": length}
        given = {key: value * scales.get(key, force / length**2) for key, value in material.items()}
        scope = pm.Microscope(
            pm.Cantilever(40.0 * force / length, 300e3, 400.0), pm.Tip(10e-9 * length), pm.Drive(40e-9 * length),
            Interaction(law or law_of(length, force), None, withdrawal="ting" if "viscosity" in material else "linear"),
        )  # fmt: skip
        found = pm.solve_pixel(pm.Material(**given), scope, 0.6, solver)
        assert found.status is pm.Status.good and (solver == "auto" or found.solver == "march")
        return found

    one, other = pixel(1.0, 1.0), pixel(1.3, 0.7)
    # The same physics in other units is the same, to what an orbit in time is known to.
    assert other.phase == pytest.approx(one.phase, abs=1e-5)
    assert other.indentation == pytest.approx(1.3 * one.indentation, rel=1e-5)
    assert other.dissipation == pytest.approx(1.3 * 0.7 * one.dissipation, rel=1e-5)
    # It loses energy, which the lever supplies; without adhesion the law without adhesion is the same.
    assert one.dissipation > 0.0 and abs(one.energy_closure) < 1e-5
    if law_of(1.0, 1.0) == "dmt":
        assert pixel(1.0, 1.0, "hertz").phase == one.phase


# JKR against its own equations, solved by a general root finder.


def jkr_force(d: float, modulus: float, adhesion: float, radius: float) -> float:
    """F at d by bisection in the contact radius, on the stable branch."""
    k = 4 / 3 * modulus

    def depth(a: float) -> float:
        return a * a / radius - 2 / 3 * math.sqrt(6 * math.pi * adhesion * a / k)

    least = (math.pi * adhesion * radius**2 / (6 * k)) ** (1 / 3)
    if d <= depth(least):
        return k * least**3 / radius - math.sqrt(6 * math.pi * adhesion * k * least**3)
    most = 2 * (least + math.sqrt(radius * max(d, 0.0)))
    a = brentq(lambda a: depth(a) - d, least, 4 * most, xtol=1e-300, rtol=1e-15)
    return k * a**3 / radius - math.sqrt(6 * math.pi * adhesion * k * a**3)


@pytest.mark.parametrize("adhesion", [1e-9, 1e-3, 0.05, 2.0])
def test_jkr_solves_its_equations(adhesion: float) -> None:
    p = row_of(Interaction("jkr", None), adhesion=adhesion)
    scale = math.pi * adhesion * RADIUS
    for d in [*np.geomspace(1e-13, 1e-7, 13), *(p[10] * np.array([0.0, 0.01, 0.3, 0.8, 0.99]))]:
        expected = jkr_force(d, MODULUS, adhesion, RADIUS)
        assert JKR.force(d, p) == pytest.approx(expected, rel=2e-14, abs=2e-13 * scale)


def test_jkr_has_the_numbers_of_the_book() -> None:
    modulus, adhesion, radius = 1e9, 0.02, 20e-9
    interaction = Interaction("jkr", None)
    p = row_of(interaction, modulus, adhesion, radius)
    f = interaction.law.force
    pi_w_r = math.pi * adhesion * radius
    assert f(0.0, p) == pytest.approx(-4 / 3 * pi_w_r, rel=1e-14)
    assert f(p[10], p) == pytest.approx(-5 / 6 * pi_w_r, rel=1e-9)
    lowest = min(f(d, p) for d in np.linspace(p[10], 0, 20001))
    assert lowest == pytest.approx(-3 / 2 * pi_w_r, rel=1e-8)
    assert p[10] == pytest.approx(-1.6088 * (adhesion**2 * radius / modulus**2) ** (1 / 3), rel=3e-5)
    lost = loop_energies(interaction.token(), p[None])[0]
    assert lost == pytest.approx(7.0922 * (adhesion**5 * radius**4 / modulus**2) ** (1 / 3), rel=1e-4)
    assert lost / 1.602176634e-19 == pytest.approx(3.541, abs=5e-4)


def test_jkr_without_adhesion_is_hertz() -> None:
    p, hertz = (row_of(Interaction(name, None), adhesion=0.0) for name in ("jkr", "hertz"))
    assert p[10] == 0.0
    tiny = row_of(Interaction("jkr", None), adhesion=1e-200)
    for d in (0.0, 1e-30, 1e-15, 1e-9, 1e-6):
        expected = Interaction("hertz").law.force(d, hertz)
        assert JKR.force(d, p) == pytest.approx(expected, rel=3e-15, abs=1e-100)
        assert JKR.force(d, tiny) == pytest.approx(expected, rel=3e-15, abs=1e-100)
        assert JKR.slope(d, p) == pytest.approx(Interaction("hertz").law.slope(d, hertz), rel=3e-15, abs=1e-15)


# Maugis and Dugdale against the equations of the paper, solved by a general root finder.


def maugis_state(m: float, lam: float) -> tuple[float, float, float]:
    """A, D and F/(pi w R) at m = c/a; the first equation is a quadratic in A."""
    root = math.sqrt(m * m - 1)
    angle = math.atan(root)
    square = lam / 2 * (root + (m * m - 2) * angle)
    half = 2 * lam * lam / 3 * (root * angle - m + 1)
    a = 1 / (half + math.sqrt(half * half + square))
    return a, a * a - 4 / 3 * lam * a * root, a**3 - lam * a * a * (root + m * m * angle)


def maugis_release(lam: float) -> tuple[float, float]:
    """ln(m - 1) and D where the branch of the largest a ends."""
    grid = np.linspace(-18, 18, 3001)
    depths = [maugis_state(1 + math.exp(x), lam)[1] for x in grid]
    lowest = int(np.argmin(depths))
    return float(grid[lowest]), depths[lowest]


def maugis_force(d: float, lam: float) -> float:
    end, _ = maugis_release(lam)
    x = brentq(lambda x: maugis_state(1 + math.exp(x), lam)[1] - d, -18, end, xtol=1e-14, rtol=1e-15)
    return maugis_state(1 + math.exp(x), lam)[2]


@pytest.mark.filterwarnings("ignore::phasemap.PlausibilityWarning")  # of ranges beyond all practice
@pytest.mark.parametrize("lam", [0.01, 0.3, 0.8, 1.0, 3.0, 30.0])
def test_maugis_dugdale_solves_its_equations(lam: float) -> None:
    k = 4 / 3 * MODULUS
    reach = 2 * ADHESION / lam * (RADIUS / (math.pi * ADHESION * k**2)) ** (1 / 3)
    scale = (math.pi**2 * ADHESION**2 * RADIUS / k**2) ** (1 / 3)
    law = MaugisDugdale(reach)
    p = row_of(Interaction(law, None))
    assert p[2] == pytest.approx(lam, rel=1e-13)
    assert p[10] / scale == pytest.approx(maugis_release(lam)[1], rel=2e-5)  # of the grid
    # Rounding of m - 1, for the equations as they are printed lose digits where c is close to a.
    tolerance = 1e-11 * max(1, lam**2)
    for d in (0.9 * p[10] / scale, 0.5 * p[10] / scale, 0.0, 0.1, 1.0, 10.0):
        assert law.force(d * scale, p) / PI_W_R == pytest.approx(maugis_force(d, lam), rel=tolerance, abs=tolerance)


@pytest.mark.filterwarnings("ignore::phasemap.PlausibilityWarning")  # the same
def test_maugis_dugdale_lies_between_dmt_and_jkr() -> None:
    k = 4 / 3 * MODULUS
    scale = (math.pi**2 * ADHESION**2 * RADIUS / k**2) ** (1 / 3)

    def at(lam: float, d: float) -> tuple[float, float]:
        reach = 2 * ADHESION / lam * (RADIUS / (math.pi * ADHESION * k**2)) ** (1 / 3)
        p = row_of(Interaction(MaugisDugdale(reach), None))
        return MaugisDugdale.force(d * scale, p) / PI_W_R, p[10] / scale

    def rate(values: list[float], step: float) -> float:
        return math.log(values[1] / values[0]) / math.log(step)

    dmt, jkr = (row_of(Interaction(name, None)) for name in ("dmt", "jkr"))
    for d in (0.5, 2.0):
        limit = Interaction("dmt").law.force(d * scale, dmt) / PI_W_R
        assert rate([at(lam, d)[0] - limit for lam in (1e-4, 1e-5)], 0.1) == pytest.approx(0.5, abs=0.01)
        limit = JKR.force(d * scale, jkr) / PI_W_R
        assert rate([at(lam, d)[0] - limit for lam in (20.0, 40.0)], 2) == pytest.approx(-2, abs=0.1)
    # The neck of DMT has no length: D -> -(8/3) sqrt(lambda/pi).
    assert at(1e-6, 0.0)[1] == pytest.approx(-8 / 3 * math.sqrt(1e-6 / math.pi), rel=1e-3)
    assert at(100.0, 0.0)[1] * scale == pytest.approx(jkr[10], rel=1e-4)


def test_a_stiff_maugis_contact_does_without_a_neck_that_would_create_energy() -> None:
    stiff, soft = (row_of(Interaction("maugis"), modulus) for modulus in (1e12, 1e9))
    assert stiff[10] == 0 and soft[10] < 0
    assert row_of(Interaction("maugis"), 1e12, adhesion=0.0)[10] == 0
    alone = row_of(Interaction(MaugisDugdale(0.3e-9), None), 1e12)
    assert alone[10] < 0 and alone[:4] == pytest.approx(stiff[:4])


# What laws of one's own hold.


@pytest.mark.parametrize("numbers", [np.arange(1, 4), np.array([1.0, 2.0, 3.0], np.float32)])
def test_a_law_that_holds_a_number_of_numpy_has_its_own_results(numbers: np.ndarray) -> None:
    def indentation(contact: Any, modulus: float) -> float:
        interaction = Interaction(contact, None)
        scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(16e-9), interaction)
        return pm.solve_pixel(pm.Material(modulus), scope, 0.8, "averaging").indentation

    def times(k: Any) -> ContactLaw:
        class Times(ContactLaw):
            @staticmethod
            def force(d: float, p: np.ndarray) -> float:
                return k * p[0] * math.sqrt(p[2] * d) * d

        return Times()

    for k in numbers:
        assert indentation(times(k), 1e9) == pytest.approx(indentation("hertz", float(k) * 1e9), rel=1e-8)


def test_a_slope_is_that_of_the_force_beside_it() -> None:
    class Stiff:
        @staticmethod
        def force(d: float, p: np.ndarray) -> float:
            return 3.0 * p[0] * d

    class Mixed(Stiff, laws.Hertz):
        pass

    class Own(ContactLaw):
        force = staticmethod(Stiff.force)

        @staticmethod
        def damping(d: float, p: np.ndarray) -> float:
            return 5.0 * p[8] * d * d

    p = [2.0, *[0.0] * 7, 0.1, *[0.0] * 3]
    for law in (Mixed, Mixed(), Own, Own()):
        assert law.slope(1e-9, p) == pytest.approx(6.0)
    assert Own.damping_slope(1e-9, p) == pytest.approx(1e-9) and Own.damping_slope(0.0, p) == pytest.approx(
        0.0, abs=1e-14
    )
    Own.force = staticmethod(lambda d, p: 4.0 * p[0] * d)  # type: ignore[method-assign]
    assert Own.slope(1e-9, p) == pytest.approx(8.0)
    assert damping_slope(Interaction(Own(), None).token(), 1e-9, np.array(p)) == pytest.approx(1e-9)


# What is refused, and what is said.


class Unspoken(ContactLaw):
    @staticmethod
    def force(d: float, p: np.ndarray) -> float:
        return {"a": p[0]}.get("b", 1.0) * math.fsum([d])


class Undefined(ContactLaw):
    @staticmethod
    def force(d: float, p: np.ndarray) -> float:
        return p[0] / d if d else math.inf


class Raising(ContactLaw):
    @staticmethod
    def force(d: float, p: np.ndarray) -> float:
        return p[0] * math.sqrt(d - 1e-9)


class Undamped(pm.ContactLaw):
    """A contact under a layer of 0.3 nm that yields, with a damping that is defined below it only."""

    @staticmethod
    def force(d: float, p: np.ndarray) -> float:
        return p[0] * math.sqrt(p[2]) * max(d - 0.3e-9, 0.0) ** 1.5

    @staticmethod
    def damping(d: float, p: np.ndarray) -> float:
        return p[8] * (d - 0.3e-9) ** p[9]


def test_a_damping_that_is_no_number_is_refused_where_there_is_damping() -> None:
    # The root of what is below 0: a sweep over it held NaN, and said nothing of the law.
    scope = pm.Microscope(
        pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(20e-9), Interaction(Undamped(), None)
    )
    with pytest.raises(pm.InputError, match=r"contact is 'Undamped'; .* slope and damping .* the damping"):
        pm.sweep_distance(pm.Material(1e9, damping=0.01), scope, [22e-9, 16e-9])
    assert np.isfinite(row_of(Interaction(Undamped(), None))).all()


class Saturating(ContactLaw):
    """A law that is not defined above 2 GPa."""

    def columns(self, contact_stiffness: Any, adhesion: Any, radius: float) -> tuple[Any, ...]:
        return np.sqrt(2e9 - contact_stiffness), adhesion, radius

    @staticmethod
    def force(d: float, p: np.ndarray) -> float:
        return p[0] * max(d, 0.0)


@pytest.mark.parametrize(("law", "modulus"), [(Saturating(), 5e9), ("maugis", 1e-300)])
def test_numbers_of_a_law_that_are_not_finite_are_not_blamed_on_a_modulus_of_0(law: Any, modulus: float) -> None:
    said = r"^contact is '\w+'; allowed: a law with finite numbers for the material\. With .* p = \[.*(nan|inf)"
    with pytest.raises(pm.InputError, match=said) as error:
        Interaction(law).check(modulus, ADHESION, RADIUS)
    assert "neck" not in str(error.value)


def test_a_law_that_cannot_work_is_refused_before_work_starts() -> None:
    soft = (np.array([1e9]), np.array([0.05]), np.array([0.0]), RADIUS)
    with pytest.raises(
        pm.InputError, match=r"contact is 'Unspoken'; allowed: a law whose formulas numba compiles\. Of "
    ):
        Interaction(Unspoken(), None).token()
    with pytest.raises(pm.InputError, match=r"contact is 'Undefined'; .* At d = 0 m with p = .* it gives inf"):
        Interaction(Undefined(), None).columns(*soft)
    with pytest.raises(pm.InputError, match=r"contact is 'Raising'; .* It raised ValueError: "):
        Interaction(Raising(), None).columns(*soft)
    with pytest.raises(pm.InputError, match=r"contact is .*; allowed: one of hertz, .* Give an object, Own\(\)"):
        Interaction(Own)  # type: ignore[arg-type]
    with pytest.raises(pm.InputError, match=r"contact is 'jrk'; allowed: one of hertz, dmt, jkr, maugis, punch, cone,"):
        Interaction("jrk")
    with pytest.raises(
        pm.InputError, match=r"decay_length is None; allowed: a length in m where the contact is 'maugis'"
    ):
        Interaction("maugis", decay_length=None)
    for wrong in (lambda: Neck(0.0), lambda: laws.FlatPunch(-1.0), lambda: MaugisDugdale(math.nan)):
        with pytest.raises(pm.InputError, match=r"is -?\S+; allowed: a finite number above 0 m"):
            wrong()


def test_a_material_whose_neck_creates_energy_is_refused() -> None:
    lever, drive = pm.Cantilever(5.0, 70e3, 100.0), pm.Drive(20e-9)
    scope = pm.Microscope(lever, pm.Tip(RADIUS), drive, Interaction("jkr"))
    with pytest.raises(pm.InputError, match=r"contact is 'jkr'; .* break at -0\.0\d+ nm and give back .* J more"):
        pm.solve_pixel(pm.Material(100e9, adhesion=0.05), scope, 0.7)
    with pytest.raises(pm.InputError, match=r"modulus is 0\.0; allowed: a number above 0 Pa where jkr contact has adh"):
        pm.solve_pixel(pm.Material(0.0, adhesion=0.05), scope, 0.7)
    materials = np.array(
        [[1e9, 0.05, 0.0, 0.3], [100e9, 0.05, 0.0, 0.3], [0.0, 0.05, 0.0, 0.3], [100e9, 0.0, 0.0, 0.3]]
    )
    expected = [pm.Status.good, pm.Status.creates_energy, pm.Status.invalid, pm.Status.good]
    assert make_work(materials, False, scope, 1e-8).refused().tolist() == [status.code for status in expected]
    assert pm.Status.creates_energy.code == col.CREATES_ENERGY


def test_the_loop_of_jkr_needs_a_tabor_number() -> None:
    # At the border the number (w^2 R/E*^2)^(1/3)/d0 is 0.264.
    def number_at(modulus: float) -> float:
        return (ADHESION**2 * RADIUS / modulus**2) ** (1 / 3) / 0.3e-9

    border = brentq(lambda x: np.isneginf(row_of(Interaction("jkr"), 10**x)[10]) - 0.5, 8, 11, xtol=1e-4)
    assert number_at(10**border) == pytest.approx(0.264, abs=0.001)


def test_a_scene_names_laws_and_bias() -> None:
    scene = Path(__file__).parents[2] / "samples" / "step.toml"
    for name in ("jkr", "maugis", "punch"):
        made = pm.load_scene(scene, [f"interaction.contact={name}", "interaction.bias=0.5"]).microscope.interaction
        assert made.law.name == name and made.bias == 0.5


def test_provenance_describes_laws_with_their_parameters() -> None:
    described = [describe(Interaction(law(1.0)))["contact"] for law in LAWS.values()]
    assert described[:5] == list(LAWS)[:5]
    assert described[5:] == [
        {"kind": "maugisdugdale", "range": 1e-9},
        {"kind": "neck", "length": 0.8e-9},
        f"{__name__}.Own",
        *(describe(LAWS[name](1.0)) for name in ("lossy dmt", "table")),
        {"kind": "flatpunch", "contact_radius": 5e-9},
        {"kind": "cone", "half_angle": 30.0},
        {"kind": "film", "base": "bonded"},
        "slipping film",
        *(describe(LAWS[name](1.0)) for name in LAWS if name in WET),
    ]


# Averaging with a neck, against brute force.


def brute(token: Any, p: np.ndarray, amplitude: float, c: float) -> tuple[float, float, float]:
    """Half of what the neck adds to the integrals of F, F cos and F sin over a cycle, by adaptive quadrature."""
    end = c + p[10] / amplitude
    hangs = end < -1
    theta = math.pi if hangs else math.acos(end)

    def between(angle: float) -> float:
        d = max(amplitude * (math.cos(angle) - c), p[10])
        outside = longrange_force(token, min(d, 0.0), p) if p[4] and not hangs else 0.0
        return contact_force(token, d, p) - outside

    share, width = (1.0 if hangs else 0.5), theta - math.acos(c)

    def integral(weight: Callable[[float], float]) -> float:
        def integrand(x: float) -> float:
            angle = theta - width * x * x
            return 2 * width * x * between(angle) * weight(angle)

        return share * quad(integrand, 0, 1, epsabs=0, epsrel=1e-12, limit=500)[0]

    return integral(lambda x: 1.0), integral(math.cos), 0.0 if hangs else integral(math.sin)


@pytest.mark.parametrize("name", ["jkr", "neck"])
@pytest.mark.parametrize("decay", [None, 0.3e-9])
def test_averaging_takes_the_neck_on_the_way_out(name: str, decay: float | None) -> None:
    interaction = Interaction(LAWS[name](1.0), decay)
    token, p, k = interaction.token(), row_of(interaction), 5.0
    lever = one_mode(1.0, 0.005, k, 2e-10)
    without = p.copy()
    without[10] = 0.0
    for amplitude, c in [(1e-8, 0.999), (1e-8, 1 - 1e-7), (1e-8, 0.9), (1e-8, 0.0), (1e-8, -0.5), (3e-9, 0.3)]:
        push, drag, mean = harmonics.harmonics(over(token, p, lever), amplitude, c)
        push0, drag0, mean0 = harmonics.harmonics(over(token, without, lever), amplitude, c)
        more, more_push, loss = brute(token, p, amplitude, c)
        scale = 2 / (math.pi * k)
        total = abs(push) + abs(scale * more)
        assert drag - drag0 == pytest.approx(scale * loss, rel=1e-8)
        assert push - push0 == pytest.approx(scale * more_push, rel=1e-8, abs=1e-13 * total)
        assert mean - mean0 == pytest.approx(-0.5 * scale * more, rel=1e-8, abs=1e-13 * total)
        energy = loop_energies(token, p[None])[0]
        assert -math.pi * k * amplitude * (drag - drag0) == pytest.approx(energy, rel=1e-8)


def test_a_neck_longer_than_the_swing_is_never_released() -> None:
    interaction = Interaction(Neck(2e-9), 0.3e-9)
    token, p, k = interaction.token(), row_of(interaction), 5.0
    lever = one_mode(1.0, 0.005, k, 2e-10)
    push, drag, mean = harmonics.harmonics(over(token, p, lever), 0.8e-9, 0.5)

    def part(n: int) -> float:
        return quad(
            lambda t: contact_force(token, 0.8e-9 * (math.cos(t) - 0.5), p) * math.cos(n * t),
            0, math.pi, points=[math.pi / 3],
        )[0]  # fmt: skip

    assert drag == 0
    assert push == pytest.approx(2 / (math.pi * k) * part(1), rel=1e-6)  # of the nodes in contact
    assert mean == pytest.approx(-1 / (math.pi * k) * part(0), rel=1e-6)


def test_no_touch_no_neck() -> None:
    interaction = Interaction("jkr")
    token, p, lever = interaction.token(), row_of(interaction), one_mode(1.0, 0.005, 5.0, 2e-10)
    without = p.copy()
    without[10] = 0.0
    with_neck, none = over(token, p, lever), over(token, without, lever)
    # To rounding, for the compiler may sum in another order where there is a neck.
    assert harmonics.harmonics(with_neck, 1e-8, 1.001) == pytest.approx(
        harmonics.harmonics(none, 1e-8, 1.001), rel=1e-14
    )


def test_a_viscous_tap_loses_what_kelvin_and_voigt_say() -> None:
    # E = (pi sqrt(2)/4) eta omega sqrt(R A) delta^2 for a prescribed swing with delta << A.
    k, resonance, eta, amplitude, delta = 5.0, 2 * math.pi * 70e3, 10.0, 2e-8, 2e-11
    interaction = Interaction("hertz", None)
    p = row_of(interaction, damping=eta * RADIUS * resonance / (2 * k))
    lever = one_mode(1.0, 0.005, k, 2e-10)
    _, drag, _ = harmonics.harmonics(over(interaction.token(), p, lever), amplitude, 1 - delta / amplitude)
    expected = math.pi * math.sqrt(2) / 4 * eta * resonance * math.sqrt(RADIUS * amplitude) * delta**2
    assert -math.pi * k * amplitude * drag == pytest.approx(expected, rel=0.01)


# The march through necks.

MARCHED: dict[str, tuple[Interaction, float]] = {  # with the damping
    "jkr": (Interaction("jkr", 0.3e-9), 0.0),
    "jkr, no force before contact, damped": (Interaction("jkr", None), 0.02),
    "maugis, damped": (Interaction("maugis", 0.3e-9), 0.02),
    "neck, damped": (Interaction(Neck(0.8e-9), 0.3e-9), 0.02),
    "punch": (Interaction("punch", 0.3e-9), 0.02),
    "jkr, bias": (Interaction("jkr", 0.3e-9, bias=0.5), 0.01),
}


LONG_TO_COMPILE = ("neck, damped", "punch", "jkr, bias")


def marched(problem: Any, z0: float, y: np.ndarray, eta: float, periods: int) -> tuple[np.ndarray, np.ndarray]:
    y, acc = y.copy(), PeriodResult()
    for _ in range(periods):
        assert march.march_oscillator(problem, z0, eta, y, acc) > 0
    return y, acc


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] if name in LONG_TO_COMPILE else []) for name in MARCHED]
)
def test_energy_closes_with_a_neck(name: str) -> None:
    interaction, damping = MARCHED[name]
    token, p = interaction.token(), row_of(interaction, damping=damping)
    row, amplitude = np.empty(col.COLUMNS), 12e-9
    row[col.TIP_OFFSET], row[col.MEAN], row[col.PHASE] = amplitude, 0.0, math.radians(35)
    assert hold_in_time(over(token, p, LEVER), amplitude, 0.2, 200_000, row) == col.GOOD
    assert row[col.INDENTATION] > 0
    assert abs(row[col.CLOSURE]) < 1e-8
    lost = loop_energies(token, p[None])[0]
    assert row[col.DISSIPATION] >= lost * (1 - 1e-12)
    assert (row[col.DISSIPATION] == pytest.approx(lost, rel=1e-12, abs=0)) == (damping == 0)


@pytest.mark.parametrize("name", ["jkr", "jkr, no force before contact, damped", "neck, damped", "maugis, damped"])
def test_the_neck_keeps_order_eight(name: str) -> None:
    interaction, damping = MARCHED[name]
    problem = over(interaction.token(), row_of(interaction, damping=damping))
    y, z0 = np.array([0.5e-9, 14.7e-9, 0.0]), 14e-9
    etas = 0.3 * 2.0 ** (-np.arange(6) / 4)
    exact_y, exact_acc = marched(problem, z0, y, 0.04, 3)
    assert exact_acc.loss > 0 and exact_acc.deepest > 0
    errors = []
    for eta in etas:
        end, acc = marched(problem, z0, y, eta, 3)
        errors.append(
            [np.abs(end - exact_y)[:2].max(), np.abs(np.subtract(acc.tolist(), exact_acc.tolist())[:3]).max()]
        )
    slopes = np.polyfit(np.log(etas), np.log(errors), 1)[0]
    assert slopes.min() > 7.7 and slopes.max() < 8.6  # terms of order 9 fade above, rounding takes over below


def test_contact_is_carried_over_from_period_to_period() -> None:
    # A weak swing in a long neck, which is never released; and the same depth reached out of contact.
    interaction = Interaction(Neck(4e-9), None)
    lever = one_mode(1.0, 0.5 / 100, 5.0, 20e-9 / 100 * 0.01)
    problem = over(interaction.token(), row_of(interaction, adhesion=1e-3), lever)
    hanging, acc = marched(problem, 1e-9, np.array([0.0, 0.0, 1.0]), 0.3, 3)
    assert hanging[2] == 1 and acc.deepest < 0 and acc.loss == 0
    free, acc = marched(problem, 1e-9, np.array([0.0, 0.0, 0.0]), 0.3, 1)
    assert free[2] == 0 and acc.loss == 0
    assert hanging[0] - free[0] > 1e-12
    deep = np.array([-5e-9, 0.0, 1.0])  # beyond release: contact is not believed
    assert marched(problem, 1e-9, deep, 0.3, 1)[0][2] == 0


def test_the_phase_with_a_neck_is_that_of_another_integrator() -> None:
    quality, k, damping, z0 = 10.0, 5.0, 0.02, 9.5e-9
    interaction = Interaction("jkr", 0.3e-9)
    p = row_of(interaction, damping=damping)
    lever = one_mode(1.0, 0.5 / quality, k, 12e-9 / quality)
    f0, release = 2 * PI_W_R, -3 / RADIUS * (math.pi * ADHESION * RADIUS**2 / (8 * MODULUS)) ** (2 / 3)

    def rate(touching: bool) -> Callable[[float, np.ndarray], list[float]]:
        def slopes(tau: float, y: np.ndarray) -> list[float]:
            z, v = float(y[0]), float(y[1])
            d = z - z0
            force = jkr_force(d, MODULUS, ADHESION, RADIUS) if touching else -f0 / (1 - min(d, 0.0) / 0.3e-9) ** 2
            alpha = lever[1] + damping * math.sqrt(max(d, 0.0) / RADIUS) * touching
            acceleration = lever[3] * math.cos(tau) - z - 2 * alpha * v - force / k
            return [v, acceleration, z * math.cos(tau), z * math.sin(tau)]

        return slopes

    def surface(tau: float, y: np.ndarray) -> float:
        return float(y[0] - z0)

    def breaks(tau: float, y: np.ndarray) -> float:
        return float(y[0] - z0 - release)

    surface.terminal = breaks.terminal = True  # type: ignore[attr-defined]
    surface.direction, breaks.direction = 1, -1  # type: ignore[attr-defined]
    y, touching = np.array([0.0, 11e-9, 0.0, 0.0]), False
    for _ in range(60):  # the lever forgets in Q/pi = 3 periods
        y[2:] = 0.0
        tau = 0.0
        while tau < 2 * math.pi:
            part = solve_ivp(
                rate(touching), (tau, 2 * math.pi), y, method="DOP853", rtol=1e-9, atol=1e-19, max_step=0.2,
                events=breaks if touching else surface,
            )  # fmt: skip
            y, tau = part.y[:, -1], part.t[-1]
            touching ^= part.status == 1
    other_lag, other_amplitude = math.atan2(y[3], y[2]), math.hypot(y[2], y[3]) / math.pi

    row = np.empty(col.COLUMNS)
    row[col.TIP_OFFSET], row[col.MEAN], row[col.PHASE] = z0, 0.0, math.pi / 2 - other_lag
    assert hold_in_time(over(interaction.token(), p, lever), other_amplitude, 0.2, 100_000, row) == col.GOOD
    assert row[col.TIP_OFFSET] == pytest.approx(z0, abs=2e-14)
    assert math.degrees(row[col.PHASE]) == pytest.approx(90 - math.degrees(other_lag), abs=1e-4)
    assert row[col.DISSIPATION] > loop_energies(interaction.token(), p[None])[0]
