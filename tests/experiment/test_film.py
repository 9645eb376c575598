"""Tips of other shapes, and films on a rigid base: against the elastic problem solved anew, and through the package."""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad

import phasemap as pm
from phasemap.experiment.interaction import Cone, ContactLaw, Film, FlatPunch, Hertz
from phasemap.experiment.interaction.film import first_coefficient
from phasemap.results.descriptions import describe_validity
from phasemap.scenes.scene import scene_from_json

sys.path.insert(0, str(Path(__file__).parents[1] / "reference"))

from film import compliance, deficit, dimitriadis, force_ratio

SAMPLES = Path(__file__).parents[2] / "samples"
LEVER, TIP, DRIVE = pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(20e-9)
SCOPE = pm.Microscope(LEVER, TIP, DRIVE, pm.Interaction("film"))
POLYMER = pm.Material(0.3e9, 0.05, 0.02, poisson_ratio=0.45)
BASES = {"bonded": True, "slipping": False}


def share(x: float, nu: float, base: str) -> float:
    """Force of the law over that of Hertz, on a film of thickness 1 under a tip of radius 1."""
    one = np.ones(1)
    return (
        Film.force(x * x, pm.Interaction(Film(base)).columns(one, 0 * one, 0 * one, 1.0, np.array([[nu, 1.0]]))[0])
        / x**3
    )


@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize("nu", [0.0, 0.3, 0.45, 0.4999])
def test_the_first_coefficient_is_that_of_the_layer(nu: float, base: str) -> None:
    _, w, missing = deficit(nu, BASES[base])
    assert first_coefficient(np.array([nu]), base)[0] == pytest.approx(2 / math.pi * w @ missing, rel=1e-6)


def test_a_layer_that_slips_does_not_know_its_poisson_ratio_and_one_that_sticks_does() -> None:
    assert compliance(0.7, 0.1, bonded=False) == pytest.approx(compliance(0.7, 0.45, bonded=False), rel=1e-12)
    assert compliance(0.1, 0.4999999, bonded=True) < 0.02 * compliance(0.1, 0.3, bonded=True)
    assert np.ptp(first_coefficient(np.array([-0.9, 0.0, 0.4]), "slipping")) < 1e-12
    assert compliance(12.0, 0.3, bonded=True) == pytest.approx(1.0, abs=1e-7)


@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize(
    "nu",
    [0.3, 0.5]
    + [pytest.param(nu, marks=pytest.mark.slow) for nu in (0.0, 0.1, 0.2, 0.35, 0.4, 0.43, 0.46, 0.48, 0.49)],
)
def test_the_film_is_the_elastic_layer_within_1_percent(nu: float, base: str) -> None:
    # The contact at x = 2 has 2.7 times the thickness as its radius on a film that slips, 3.2 times at nu = 1/2.
    spectrum = deficit(nu, BASES[base])
    found = np.array([force_ratio(a, 1.0, spectrum) for a in (1e-3, 0.1, 0.3, 0.6, 1.0, *np.linspace(1.4, 3.2, 19))])
    assert found[-1, 0] > 1.99
    for x, exact in found[found[:, 0] <= 2.0]:
        assert share(x, nu, base) == pytest.approx(exact, rel=0.01)


def test_the_series_of_dimitriadis_lacks_a_sixth_of_its_second_order() -> None:
    # The exact series is 1 + c x + (7/6) c^2 x^2 + ...; theirs has c^2, and its c is a fit.
    spectrum = deficit(0.5, bonded=True)
    c = float(first_coefficient(np.array([0.5]), "bonded")[0])
    x, exact = force_ratio(3e-3, 1.0, spectrum)
    assert (exact - 1 - c * x) / x**2 == pytest.approx(7 / 6 * c**2, rel=0.01)
    x, exact = force_ratio(1.0, 1.0, spectrum)
    assert dimitriadis(x, 0.5, bonded=True) / exact == pytest.approx(0.85, abs=0.01)
    slips = float(first_coefficient(np.array([0.5]), "slipping")[0])
    assert 2 / math.pi * 0.347 * 4 / slips == pytest.approx(1.19, abs=0.005)


def test_a_film_goes_over_into_a_half_space_and_goes_on_beyond_its_range_without_a_step() -> None:
    for base in BASES:
        assert share(1e-6, 0.3, base) == pytest.approx(1.0, rel=1e-5)
        assert share(2 + 1e-9, 0.3, base) == pytest.approx(share(2 - 1e-9, 0.3, base), rel=1e-8)
        assert share(20.0, 0.3, base) > share(10.0, 0.3, base) > share(2.0, 0.3, base)


@pytest.mark.parametrize("law", [Hertz(), FlatPunch(4e-9), Cone(35.0)], ids=lambda law: law.name)
def test_the_slope_is_twice_the_modulus_times_the_radius_of_the_contact(law: ContactLaw) -> None:
    # Pharr, Oliver and Brotzen (1992): dF/dd = 2 E* a for a punch of any shape on a half-space.
    k = 1e9
    p = [float(np.ravel(column)[0]) for column in law.columns(np.array([k]), np.array([0.0]), 10e-9)]
    for d in (1e-11, 1e-9, 5e-9):
        assert law.slope(d, p) == pytest.approx(2 * 0.75 * k * float(law.radius_at(np.array(d), 10e-9)), rel=1e-14)


def test_the_attraction_of_a_cone_is_the_sum_over_its_face() -> None:
    # A column of the tip over each point of its face, at the height s, is pulled by H/(6 pi s^3) of its area.
    half_angle, w, d0 = 30.0, 0.05, 0.3e-9
    hamaker, tan = 12 * math.pi * w * d0**2, math.tan(math.radians(half_angle))
    interaction = pm.Interaction(Cone(half_angle), d0)
    p = interaction.columns(np.array([1e9]), np.array([w]), np.array([0.0]), 10e-9)[0]
    for gap in (0.3e-9, 1e-9, 4e-9):
        over = quad(lambda u: u / (1 + u) ** 3, 0, math.inf)[0] * hamaker / (3 * gap) * tan**2
        assert interaction.law.attraction.force(d0 - gap, p) == pytest.approx(-over, rel=1e-8)


def test_thinner_films_are_stiffer_in_images_sweeps_and_single_pixels() -> None:
    thickness = np.array([[2e-9, 5e-9, 20e-9, math.inf]])
    film = pm.Surface(0.3e9, 0.05, 0.02, poisson_ratio=0.45, thickness=thickness, pixel_size=1e-9)
    with pytest.warns(pm.ResultWarning, match=r"of the film's thickness; above 0\.3 of it strains are too large"):
        image = pm.simulate(film, SCOPE, 0.7, solver="averaging")
    phases = image.phase.values[0]
    assert (np.diff(phases) < 0).all() and (np.diff(image.indentation.values[0]) > 0).all()
    half_space = pm.simulate(
        pm.Surface(0.3e9, 0.05, 0.02, poisson_ratio=0.45, pixel_size=1e-9, shape=(1, 1)),
        pm.Microscope(LEVER, TIP, DRIVE), 0.7, solver="averaging",
    )  # fmt: skip
    assert phases[3] == pytest.approx(half_space.phase.item(), abs=1e-6)
    for h, phase in zip(thickness[0, :3], phases[:3], strict=True):
        one = pm.Material(0.3e9, 0.05, 0.02, poisson_ratio=0.45, thickness=h)
        assert pm.solve_pixel(one, SCOPE, 0.7, solver="averaging").phase == phase
    assert image.thickness.values.tolist() == thickness.tolist()
    blunt = image.assign_attrs(configuration=image.configuration.replace('"radius": 1e-08', '"radius": 1e-06'))
    assert any("times the film's thickness; the law of the film is good to 1 %" in s for s in describe_validity(blunt))


@pytest.mark.parametrize("contact", ["film", "slipping film", "cone", "punch"])
def test_periodic_orbits_are_those_of_the_equation_of_motion(contact: str) -> None:
    law = pm.Interaction(contact).law
    scope = pm.Microscope(LEVER, TIP, DRIVE, pm.Interaction(contact, damping_exponent=law.spread))
    one = pm.Material(0.5e9, 0.04, viscosity=20.0, poisson_ratio=0.45, thickness=10e-9 if law.takes_film else None)
    orbit, march = (pm.solve_pixel(one, scope, 0.8, solver) for solver in ("orbit", "march"))
    assert orbit.stable and abs(orbit.energy_closure) < 1e-7 and abs(march.energy_closure) < 1e-7
    assert orbit.phase == pytest.approx(march.phase, abs=1e-4)  # degree
    assert orbit.height == pytest.approx(march.height, abs=1e-13)
    averaged = pm.solve_pixel(one, scope, 0.8, "averaging")
    assert averaged.phase == pytest.approx(orbit.phase, abs=0.05)


def test_without_adhesion_a_kelvin_voigt_film_shows_in_height_and_not_in_phase() -> None:
    # Its loss tangent is the material's, however thin it is, and at a setpoint that alone makes the phase.
    thickness = np.array([[8e-9, 20e-9, math.inf]])
    film = pm.Surface(0.3e9, damping=0.02, thickness=thickness, pixel_size=1e-9)
    image = pm.simulate(film, SCOPE, 0.8, "averaging")
    np.testing.assert_allclose(image.phase, image.phase[0, 2], atol=1e-5)
    assert (np.diff(image.height.values[0]) < -0.1e-9).all()


def test_a_surface_keeps_its_thickness() -> None:
    bare, coated = pm.Material(100e9, 0.05), pm.Material(1e9, 0.05, thickness="5 nm")
    surface = pm.Surface.from_labels([[0, 1, 1]], {0: bare, 1: coated}, pixel_size=1e-9)
    assert surface.thickness.tolist() == [[math.inf, 5e-9, 5e-9]]
    assert pm.Surface.from_dataset(surface.to_dataset()) == surface
    rows, inverse = surface.unique()
    assert rows[inverse][0, 1].tolist() == [1e9, 0.05, 0.0, 0.35, 5e-9, 1e9, *[math.inf] * 4]
    assert surface.dilated(TIP).thickness.tolist() == surface.thickness.tolist()
    edge = pm.Surface(1e9, thickness=[[2e-9] * 8 + [math.inf] * 8], pixel_size=1e-9)
    with pytest.raises(pm.InputError, match="depth is None; allowed: a map of depths in m where the contact is 'film'"):
        edge.seen_by(SCOPE, 0.7)
    blurred = edge.seen_by(SCOPE, 0.7, depth=1e-9).thickness[0]
    assert blurred[0] == 2e-9 and blurred[-1] == math.inf and (np.diff(blurred[:9]) >= 0).all() and blurred[8] < 1e-7
    with pytest.raises(pm.InputError, match="thickness is -1e-09; allowed: a finite number above 0 m"):
        pm.Surface(1e9, thickness=[[-1e-9, 1e-9]], pixel_size=1e-9)


def test_a_scene_gives_the_thickness_as_a_map_and_a_law_with_its_parameters(tmp_path: Path) -> None:
    np.save(tmp_path / "wedge.npy", np.linspace(10e-9, 40e-9, 4)[None])
    (tmp_path / "film.toml").write_text(
        """scan = { setpoint = 0.7, solver = "averaging" }
        cantilever = { stiffness = 40, resonance_frequency = "300 kHz", quality_factor = 400 }
        tip = { radius = "10 nm" }
        drive = { free_amplitude = "20 nm" }
        interaction = { contact = { law = "film", base = "slipping" } }
        [surface]
        kind = "maps"
        modulus = "0.3 GPa"
        adhesion = 0.05
        damping = 0.02
        thickness = "wedge.npy"
        pixel_size = "1 nm"
        """
    )
    scene = pm.load_scene(tmp_path / "film.toml")
    assert scene.microscope.interaction == pm.Interaction(Film("slipping"))
    image = scene.simulate()
    assert (np.diff(image.phase.values[0]) < 0).all()
    again = scene_from_json(scene.to_json(), tmp_path)
    assert again.config == scene.config and again.surface == scene.surface
    assert pm.check(image, scene.surface).holds
    cone = pm.load_scene(SAMPLES / "step.toml", ['interaction.contact={ law = "cone", half_angle = "30 degrees" }'])
    assert cone.microscope.interaction.law.half_angle == pytest.approx(30.0)
    with pytest.raises(pm.InputError, match=r"\[interaction.contact\] law is 'jkr'; allowed: .*cone"):
        pm.load_scene(SAMPLES / "step.toml", ['interaction.contact={ law = "jkr" }'])


def test_what_does_not_go_together_is_refused() -> None:
    def under(contact: str, **more: float) -> pm.Microscope:
        return pm.Microscope(LEVER, TIP, DRIVE, pm.Interaction(contact, **more))

    coated = pm.Material(1e9, 0.05, thickness=5e-9)
    for contact in ("jkr", "dmt", "maugis", "punch", "cone"):
        with pytest.raises(pm.InputError, match=f"thickness is given; .* the contact is '{contact}'"):
            pm.solve_pixel(coated, under(contact), 0.7)
    with pytest.raises(pm.InputError, match="thickness is None; allowed: a thickness of the film"):
        pm.simulate(pm.Surface(1e9, pixel_size=1e-9, shape=(1, 1)), SCOPE, 0.7)
    with pytest.raises(pm.InputError, match=r"poisson_ratio is -0\.1; allowed: a number between 0 and 0\.5 where"):
        pm.solve_pixel(pm.Material(1e9, thickness=5e-9, poisson_ratio=-0.1), SCOPE, 0.7)
    with pytest.raises(pm.InputError, match=r"bias is 1\.0; allowed: 0 where the contact is 'cone'"):
        under("cone", bias=1.0)
    with pytest.raises(
        pm.InputError, match=r"damping_exponent is 0\.5; allowed: 1 where materials have a viscosity and"
    ):
        pm.solve_pixel(pm.Material(1e9, viscosity=1.0), under("cone"), 0.7)
    with pytest.raises(pm.InputError, match="decay_length is None; allowed: a length in m where the contact is 'cone'"):
        pm.solve_pixel(POLYMER, pm.Microscope(LEVER, TIP, DRIVE, pm.Interaction("cone", None)), 0.7)
    with pytest.raises(pm.InputError, match="depth is None; allowed: a map of depths"):
        pm.Surface([[1e9, 2e9]], pixel_size=1e-9).seen_by(under("cone"), 0.7)
    with pytest.raises(pm.InputError, match="base of the film is 'glued'; allowed: one of bonded, slipping"):
        Film("glued")


ON_FILM = pm.Microscope(pm.Cantilever(18.0, 75e3, 150.0), pm.Tip(5e-9), pm.Drive(15e-9), pm.Interaction("film"))


@pytest.mark.filterwarnings("ignore::phasemap.ResultWarning")  # thin films are pressed in far
def test_images_of_films_of_one_thickness_are_interpolated_within_their_stated_errors() -> None:
    x, noise = np.linspace(0.0, 1.0, 96), np.random.default_rng(3).uniform(0.0, 0.2, (96, 96))
    surface = pm.Surface(50e6 * 10 ** (x + noise), 0.04, damping=0.005, thickness=2e-9, pixel_size=2e-9)
    image, exact = (pm.simulate(surface, ON_FILM, 0.7, solver) for solver in ("auto", "orbit"))
    assert (image.solver == 3).mean() > 0.99
    assert (abs(image.phase - exact.phase) < image.error_phase + exact.error_phase).all()
    other = pm.simulate(replace(surface, thickness=np.where(noise > 0.1, 2e-9, 3e-9)), ON_FILM, 0.7)
    assert not (other.solver == 3).any()


@pytest.mark.filterwarnings("ignore::phasemap.ResultWarning")
def test_materials_of_films_come_back_from_their_images() -> None:
    surface = pm.Surface([[200e6, 800e6]], [[0.03, 0.05]], [[0.003, 0.006]], thickness=2e-9, pixel_size=2e-9)
    images = [pm.simulate(surface, ON_FILM, setpoint) for setpoint in (0.85, 0.7, 0.55)]
    prior = pm.Material(400e6, 0.04, damping=0.004, thickness=2e-9)
    # Errors of a thousandth of a degree and a tenth of a picometre, which leave 1e-3 of each property.
    errors = {"phase_error": 1e-3, "height_error": 1e-13, "phase_zero": 0.0}
    found = pm.invert(images, ON_FILM, prior=prior, **errors)
    for name in ("modulus", "adhesion", "damping"):
        assert found[name].values == pytest.approx(getattr(surface, name), rel=2e-3)
    with pytest.raises(pm.InputError, match="thickness of the prior is None; allowed: a number in m"):
        pm.invert(images, ON_FILM, prior=replace(prior, thickness=None), **errors)
