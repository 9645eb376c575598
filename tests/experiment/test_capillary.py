"""Films of liquid on tip and sample: the necks that they draw, their limits, and what does not know them."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import dask.array as da
import numpy as np
import pytest

import phasemap as pm
from phasemap._kernels.neck_energy import loop_energies
from phasemap.experiment.interaction import Capillary
from phasemap.experiment.interaction.capillary import NUMBER_DENSITY, THERMAL, adsorbed_film
from phasemap.experiment.material_rows import MORE, MORE_NUMBERS, PLAIN, column_of, rows_of
from phasemap.solvers.problem import make_work, work_of_material

RADIUS = 10e-9
SAMPLE = pm.Material(3e9, adhesion=0.05)
NONE = np.array([[np.inf, np.inf]])


def scope_of(contact: Any, **drive: Any) -> pm.Microscope:
    given = {"free_amplitude": 20e-9, **drive}
    return pm.Microscope(
        pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(RADIUS), pm.Drive(**given), pm.Interaction(contact)
    )  # fmt: skip


# The necks of the law.


@pytest.mark.parametrize("h", [0.2e-9, 1e-9, 3e-9])
def test_films_of_one_thickness_hold_the_volume_of_zitzler(h: float) -> None:
    necks = Capillary(film_thickness=h).necks(RADIUS, NONE)
    volume = 4 * math.pi * RADIUS * h**2 + 4 / 3 * math.pi * h**3  # Zitzler, Herminghaus and Mugele (2002), dry rim
    assert necks.forming[0] == pytest.approx(-2 * h)
    assert necks.release[0] == pytest.approx(-(volume ** (1 / 3) - volume ** (2 / 3) / (5 * RADIUS)))
    assert necks.curve[0] == pytest.approx(1 / math.sqrt(volume / (math.pi * RADIUS)))
    assert necks.force[0] == pytest.approx(4 * math.pi * RADIUS * 0.072)


def test_a_film_of_the_sample_alone_draws_the_neck_of_its_own_volume() -> None:
    h = 1e-9
    only = Capillary(tip_film=0.0).necks(RADIUS, np.array([[h, np.inf]]))
    assert only.curve[0] == pytest.approx(1 / math.sqrt(h**2 * (1 - h / (3 * RADIUS))))  # a cap of height h
    assert Capillary(volume=50e-27).necks(RADIUS, NONE).curve[0] == pytest.approx(
        1 / math.sqrt(50e-27 / (math.pi * RADIUS))
    )


def test_humidity_sets_the_films_that_are_not_given() -> None:
    for humidity in (0.1, 0.5, 0.9):
        h = adsorbed_film(humidity)
        # The pressure of the film against its vapour: H / (6 pi h^3) = n kT ln(p0/p).
        assert 1e-20 / (6 * math.pi * h**3) == pytest.approx(3.33e28 * 4.116e-21 * math.log(1 / humidity))
        assert Capillary(humidity=humidity).necks(RADIUS, NONE) == Capillary(h).necks(RADIUS, NONE)
    # Of the same water Kelvin's radius is 0.52 nm / ln(p0/p), as textbooks print it.
    assert 0.072 / (NUMBER_DENSITY * THERMAL) == pytest.approx(0.52e-9, abs=0.006e-9)
    assert Capillary().necks(RADIUS, NONE) == Capillary(humidity=0.5).necks(RADIUS, NONE)  # of a room
    one = Capillary(humidity=0.8).necks(RADIUS, np.array([[0.0, np.inf]]))
    assert one.forming[0] == pytest.approx(-adsorbed_film(0.8))  # the tip keeps its own


def test_the_mean_cosine_of_both_angles_counts_and_no_neck_forms_where_it_is_not_positive() -> None:
    film = 1e-9
    necks = Capillary(film, tip_angle=30.0).necks(RADIUS, np.array([[film, 30.0], [film, 90.0], [film, 150.0]]))
    full = 4 * math.pi * RADIUS * 0.072 * math.cos(math.radians(30))
    assert necks.force == pytest.approx([full, full / 2, 0.0])
    assert (necks.release < 0).tolist() == (necks.forming < 0).tolist() == [True, True, False]
    assert Capillary(film, contact_angle=150.0, tip_angle=40.0).necks(RADIUS, NONE).release[0] == 0.0


def test_without_films_the_contact_is_dmt() -> None:
    dry, dmt = (work_of_material(SAMPLE, scope_of(law), 14e-9, marched=True) for law in (Capillary(0.0), "dmt"))
    assert dry.rows.tolist() == dmt.rows.tolist()
    for d in (-1e-9, 0.0, 1e-9):
        assert Capillary.force(d, dry.rows[0]) == pytest.approx(
            scope_of("dmt").interaction.law.force(d, dmt.rows[0])
            if d >= 0
            else -dmt.rows[0, 4] / (1 - d / 0.3e-9) ** 2,
            rel=1e-14,
        )
    found, expected = (pm.solve_pixel(SAMPLE, scope_of(law), 0.7) for law in (Capillary(0.0), "dmt"))
    assert found.phase == pytest.approx(expected.phase, abs=1e-12) and found.solver == expected.solver


@pytest.mark.filterwarnings("ignore::phasemap.PlausibilityWarning")  # of films thinner than a molecule
def test_the_thinnest_film_pulls_in_contact_as_a_thick_one_does() -> None:
    # 4 pi R gamma stays, over no gap: the adhesion of DMT is then w + 2 gamma, and the loop loses nothing.
    def pixel(contact: Any, adhesion: float) -> pm.Pixel:
        scope = replace(scope_of(contact, free_amplitude=60e-9), interaction=pm.Interaction(contact, None))
        return pm.solve_pixel(pm.Material(3e9, adhesion), scope, 0.7)

    expected, dry = pixel("dmt", 0.05 + 2 * 0.072), pixel("dmt", 0.05)
    off = [abs(pixel(Capillary(h), 0.05).tip_offset - expected.tip_offset) for h in (1e-10, 1e-11, 1e-12)]
    assert abs(dry.tip_offset - expected.tip_offset) > 1e-10
    assert (np.diff(off) < 0).all() and off[-1] < 5e-13


# Rows of materials.


MANY = {
    0: pm.Material(3e9, 0.05),
    1: pm.Material(2e9, 0.05, liquid_film=0.5e-9),
    2: pm.Material(2e9, 0.05, liquid_film=0.5e-9, contact_angle=70.0),
    3: pm.Material(1e9, 0.03, thickness=20e-9),
    4: pm.Material(1e9, 0.03, relaxed_modulus=0.4e9, relaxation_time=1e-6),
}


def test_rows_of_films_relaxing_and_wet_materials_name_what_each_has() -> None:
    rows, viscous = rows_of(MANY.values())
    assert rows.shape == (5, PLAIN + len(MORE)) and not viscous
    for name in MORE_NUMBERS:
        own = [getattr(one, name) for one in MANY.values()]
        nothing = [one.modulus if name == "relaxed_modulus" else math.inf for one in MANY.values()]
        column = column_of(rows, name)
        assert column is not None
        assert column.tolist() == [n if o is None else o for o, n in zip(own, nothing, strict=True)]
    assert rows_of([MANY[0]])[0].shape == (1, PLAIN)


@pytest.mark.parametrize("labels", [(0, 1, 2), (0, 3), (0, 4), (0, 1, 2, 4)])
def test_a_surface_of_such_materials_comes_back_from_labels_and_datasets(labels: tuple[int, ...]) -> None:
    chosen = [MANY[label] for label in labels]
    surface = pm.Surface.from_labels([[*range(len(labels)), 0]], chosen, pixel_size=2e-9)
    rows, inverse = surface.unique()
    assert rows[inverse[0, : len(labels)]].tolist() == rows_of(chosen)[0].tolist()
    again = pm.Surface.from_dataset(surface.to_dataset())
    assert again == surface
    assert again.unique()[0][again.unique()[1]].tolist() == rows[inverse].tolist()
    assert surface.rows(slice(0, 1)).contact_angle is surface.contact_angle or 2 in labels


# Orbits over necks, which are marched in time.


def test_a_marched_tip_loses_the_energy_of_its_necks() -> None:
    scope = scope_of(Capillary(0.3e-9))
    one_loop = loop_energies(scope.interaction.token(), work_of_material(SAMPLE, scope, 0.0, marched=True).rows)[0]
    light = pm.solve_pixel(SAMPLE, scope, 0.7)
    hard = pm.solve_pixel(SAMPLE, scope_of(Capillary(0.3e-9), free_amplitude=80e-9), 0.7)
    assert light.branch == "attractive" and hard.branch == "repulsive"
    for pixel in (light, hard):
        assert pixel.solver == "march" and abs(pixel.energy_closure) < 1e-5
    # A hard tap forms and breaks the neck in each period; a light one in a share of them only.
    assert hard.dissipation == pytest.approx(one_loop, rel=1e-9)
    assert 0.0 < light.dissipation / one_loop <= 1.0 + 1e-9
    lossy = pm.solve_pixel(replace(SAMPLE, damping=0.01), scope_of(Capillary(0.3e-9), free_amplitude=80e-9), 0.7)
    assert lossy.dissipation > 1.1 * one_loop and abs(lossy.energy_closure) < 1e-5


@pytest.mark.parametrize("model", ["constant volume", "constant force", "linear"])
@pytest.mark.parametrize("share", [1.0, 0.3])
def test_a_loop_loses_the_energy_of_its_closed_form(model: str, share: float) -> None:
    """The integral of theory, Eq. (model-24), less the van der Waals force, over the gaps of the neck."""
    h = 0.4e-9
    law = Capillary(h, wet_attraction=share, model=model)
    work, necks = work_of_material(SAMPLE, scope_of(law), 0.0, marched=True), law.necks(RADIUS, NONE)
    near, far = -float(necks.forming[0]), -float(necks.release[0])
    width = math.sqrt(4 * h**2 + 4 / 3 * h**3 / RADIUS)  # of Zitzler's volume, the root of V / (pi R)
    way = {
        "constant volume": far - near - math.hypot(far, width) + math.hypot(near, width),
        "constant force": far - near,
        "linear": (far - near) ** 2 / (2 * far),
    }[model]
    dry = 2 * math.pi * RADIUS * 0.05 * 0.3e-9 * (1 / (1 + near / 0.3e-9) - 1 / (1 + far / 0.3e-9))
    wanted = 4 * math.pi * RADIUS * 0.072 * way - (1 - share) * dry
    assert loop_energies(work.law, work.rows)[0] == pytest.approx(wanted, rel=1e-9)


def test_a_dry_pixel_beside_wet_ones_is_that_of_dmt() -> None:
    wet = pm.Surface(3e9, 0.05, liquid_film=[[0.0, 0.3e-9, 1e-9], [1e-9, 0.0, 0.3e-9]], pixel_size=5e-9)
    image = pm.simulate(wet, scope_of(Capillary(0.0)), 0.7)
    dry = pm.simulate(pm.Surface(3e9, 0.05, shape=(1, 1), pixel_size=5e-9), scope_of("dmt"), 0.7)
    assert image.phase.values[[0, 1], [0, 1]] == pytest.approx(float(dry.phase[0, 0]), abs=1e-9)
    assert image.phase.values[0, 1] < 0 < image.phase.values[0, 0]
    assert image.attrs["modelled"] == "capillary contact; inverse-square attraction; necks of liquid"


def test_hydrophilic_beside_hydrophobic_is_a_picture_of_the_phase() -> None:
    wetting = pm.Surface(3e9, 0.05, contact_angle=[[0.0, 180.0]], pixel_size=5e-9)
    image = pm.simulate(wetting, scope_of(Capillary(1e-9)), 0.7)
    assert image.phase.values[0, 0] < -30 and image.phase.values[0, 1] == pytest.approx(45.573, abs=1e-3)
    assert "necks of liquid" in image.attrs["modelled"]


@pytest.mark.slow
def test_wet_images_are_the_same_in_blocks_and_nearly_under_a_slow_feedback_and_can_be_checked() -> None:
    films = np.repeat([[0.0, 1e-9], [0.3e-9, 0.5e-9]], 16, axis=1)
    surface = pm.Surface(3e9, 0.05, liquid_film=films, pixel_size=5e-9)
    image = pm.simulate(surface, scope_of(Capillary(1e-9)), 0.7)
    in_blocks = pm.Surface(3e9, 0.05, liquid_film=da.from_array(films, chunks=(1, 32)), pixel_size=5e-9)
    assert pm.simulate(in_blocks, scope_of(Capillary(1e-9)), 0.7).phase.values.tolist() == image.phase.values.tolist()
    scanned = pm.simulate(surface, scope_of(Capillary(1e-9)), 0.7, control=pm.Feedback(line_rate=0.05))
    ends = np.abs(scanned.phase.values[0, :, [12, 28]] - image.phase.values[:, [12, 28]].T)
    assert ends.max() < 1e-3  # twelve pixels behind an edge
    assert pm.check(image, surface).holds
    with pytest.raises(pm.InputError, match=r"control is .Raster.; allowed: Engage or Feedback where contacts"):
        pm.simulate(in_blocks, scope_of(Capillary(1e-9)), 0.7, control=pm.Raster())


# What is refused, and what is said.


def test_what_is_not_marched_in_time_refuses_liquid() -> None:
    scope, surface = scope_of(Capillary(1e-9)), pm.Surface(3e9, 0.05, shape=(2, 2), pixel_size=5e-9)
    with pytest.raises(pm.InputError, match=r"control is 'Raster'; allowed: Engage or Feedback where .* are wet\."):
        pm.simulate(surface, scope, 0.7, control=pm.Raster())
    for call in (
        lambda: pm.orbits(SAMPLE, scope, 0.7),
        lambda: pm.sensitivity(surface, scope, 0.7),
    ):
        with pytest.raises(pm.InputError, match=r"contact is 'capillary'; allowed: a dry law without losses, for what"):
            call()
    for solver in ("orbit", "averaging"):
        with pytest.raises(pm.InputError, match=rf"solver is '{solver}'; allowed: 'march' or 'auto' where .* are wet"):
            pm.solve_pixel(SAMPLE, scope, 0.7, solver)
    second = scope_of(Capillary(1e-9))
    two = replace(second.cantilever, modes=2)
    second = replace(second, cantilever=two, drive=replace(second.drive, second=pm.Mode()))
    with pytest.raises(pm.InputError, match=r"second is given; allowed: None where a surface remembers or is wet"):
        pm.solve_pixel(SAMPLE, second, 0.7)


def test_what_no_neck_can_have_is_refused() -> None:
    with pytest.raises(pm.InputError, match=r"humidity is 0\.5; allowed: None where film_thickness is given"):
        Capillary(film_thickness=1e-9, humidity=0.5)
    for humidity in (0.0, 1.0):
        with pytest.raises(pm.InputError, match=r"humidity is .*; allowed: a finite number above 0 and below 1"):
            Capillary(humidity=humidity)
    with pytest.raises(pm.InputError, match=r"model of the neck is 'constant'; allowed: one of constant volume, "):
        Capillary(model="constant")
    with pytest.raises(pm.InputError, match=r"bias is 1\.0; allowed: 0 where the contact is 'capillary': liquid"):
        pm.Interaction("capillary", bias=1.0)
    for material, name in ((MANY[1], "liquid_film"), (pm.Material(1e9, contact_angle=30.0), "contact_angle")):
        with pytest.raises(pm.InputError, match=rf"{name} is given; allowed: nothing .* 'dmt', which is dry\. The co"):
            pm.solve_pixel(material, scope_of("dmt"), 0.7)


@pytest.mark.filterwarnings("ignore::phasemap.PlausibilityWarning")  # of films thicker than are found
def test_films_that_meet_where_their_neck_breaks_are_refused() -> None:
    thick = r"gap at which the films of liquid meet is 2\.4e-08; allowed: less than 1\.21e-08 m, where their neck break"
    with pytest.raises(pm.InputError, match=thick):
        pm.solve_pixel(SAMPLE, scope_of(Capillary(12e-9)), 0.7)
    for limit, on_tip in ((0.5545, None), (0.9284, 0.0)):  # of the radius, on both solids and on the sample alone
        for part in (0.999, 1.001):
            necks = Capillary(part * limit * RADIUS, tip_film=on_tip).necks(RADIUS, NONE)
            assert (necks.forming[0] > necks.release[0]) == (part < 1)
    for h in np.geomspace(0.94, 300, 20) * RADIUS:  # also where the tip is under water, and its overlap no cap any more
        for on_tip in (None, 0.0, 2e-9):
            with pytest.raises(pm.InputError, match="gap at which the films of liquid meet"):
                pm.solve_pixel(replace(SAMPLE, liquid_film=h), scope_of(Capillary(tip_film=on_tip)), 0.7)
    one_third = pm.Surface(3e9, 0.05, liquid_film=[[0.0, 1e-9, 20e-9]], pixel_size=5e-9)
    with pytest.warns(pm.ResultWarning, match=r"1 of 3 pixels .* films of liquid so thick that they meet where"):
        image = pm.simulate(one_third, scope_of(Capillary(0.0)), 0.7)
    assert image.status.values.tolist() == [[0, 0, pm.Status.invalid.code]]
    assert image.attrs["modelled"] == "capillary contact"  # nothing is said of what the thickest film makes of a row
    loosely_held = scope_of(Capillary(0.0, wet_attraction=0.2))  # the loop over the gap would gain energy, if it were
    work = make_work(
        np.array([[3e9, 0.5, 0.0, 0.3, np.inf, 3e9, np.inf, 20e-9, np.inf, np.inf]]),
        False,
        loosely_held,
        1e-8,
        marched=True,
    )
    assert work.refused().tolist() == [pm.Status.invalid.code]


def test_a_scene_says_films_and_angles(tmp_path: Path) -> None:
    scene = Path(__file__).parents[2] / "samples" / "step.toml"
    given = [
        "interaction.contact=capillary",
        "materials.stiff.liquid_film=0.4 nm",
        "materials.compliant.contact_angle=95",
    ]
    wet = pm.load_scene(scene, given)
    assert wet.microscope.interaction.law == Capillary()
    film, angle = wet.surface.liquid_film, wet.surface.contact_angle
    assert film is not None and angle is not None
    assert {*film.ravel()} == {0.4e-9, math.inf} and {*angle.ravel()} == {95.0, math.inf}
    law = pm.load_scene(scene, ['interaction.contact={law="capillary", humidity=0.8, tip_angle=30}'])
    assert law.microscope.interaction.law == Capillary(humidity=0.8, tip_angle=30.0)
    assert pm.load_scene(scene, ['interaction.contact={law="capillary"}', "interaction.contact.humidity=0.3"])


def test_a_tip_that_reaches_the_liquid_only_is_not_said_to_touch_the_solid() -> None:
    scope = pm.Microscope(
        pm.Cantilever(2.0, 70e3, 150.0), pm.Tip(RADIUS), pm.Drive(30e-9), pm.Interaction(Capillary(0.5e-9))
    )
    found = pm.solve_pixel(pm.Material(2e9, 0.05, damping=0.01), scope, 0.7)
    # Its taps are not all alike: what is said is the deepest of many.
    assert found.amplitude_spread > 0.0 and -1e-9 < found.indentation < -0.5e-9


def test_a_force_curve_forms_the_neck_where_films_meet_and_breaks_it_farther_out() -> None:
    scope, depths = scope_of(Capillary(0.5e-9)), np.array([-3e-9, -2.5e-9, -1.05e-9, -0.95e-9, 0.0, 1e-9])
    there, back = pm.force_curve(SAMPLE, scope, depths).force.values
    dry = pm.force_curve(SAMPLE, scope_of("dmt"), depths).force.values[0]
    assert (there == back).tolist() == [True, False, False, True, True, True]
    assert there[:3] == pytest.approx(dry[:3], rel=1e-12) and (back[1:] < dry[1:] - 1e-10).all()
    assert back[4:] == pytest.approx(dry[4:] - 4 * np.pi * RADIUS * 0.072, rel=1e-12)
