"""Forces given by numbers: cubics between them, files, and the orbits of the law that they were taken from."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import phasemap as pm
from phasemap.experiment.interaction import LAWS, Interaction, Table

LEVER, TIP, DRIVE = pm.Cantilever(30.0, 300e3, 300.0), pm.Tip(10e-9), pm.Drive(20e-9)
POLYMER = pm.Material(1e9, 0.03, viscosity=30.0)
DEPTHS, FORCES = (-2e-9, -1e-9, 0.0, 1e-9, 2e-9), (0.0, -1e-9, -4e-9, 10e-9, 30e-9)


def scope_of(interaction: Interaction) -> pm.Microscope:
    return pm.Microscope(LEVER, TIP, DRIVE, interaction)


@pytest.mark.parametrize("solver", ["auto", "orbit", "march"])
@pytest.mark.parametrize(
    "interaction",
    [Interaction("dmt"), Interaction("dmt", None), Interaction("hertz", longrange=pm.interaction.DLVO())],
    ids=["dmt", "dmt without a force outside", "hertz in salt water"],
)
def test_a_table_of_a_law_has_the_orbits_of_the_law(interaction: Interaction, solver: str) -> None:
    scope = scope_of(interaction)
    other = scope_of(Interaction(Table.from_law(POLYMER, scope)))
    wanted, found = (pm.solve_pixel(POLYMER, one, 0.7, solver) for one in (scope, other))
    assert found.status is pm.Status.good
    # 600 points, of which those at the maximum depth are 4 % of it apart
    assert found.phase == pytest.approx(wanted.phase, abs=1e-4)
    assert found.tip_offset == pytest.approx(wanted.tip_offset, abs=1e-13)


def test_a_table_is_made_of_laws_that_it_can_hold_and_of_no_others() -> None:
    for name, law in LAWS.items():
        material = replace(POLYMER, thickness=20e-9) if law.takes_film else POLYMER
        scope = scope_of(Interaction(name, damping_exponent=law.spread))
        if law.hysteretic or law.takes_film:
            with pytest.raises(pm.InputError, match="a law without a neck, films or losses of its own"):
                Table.from_law(material, scope)
            continue
        made = scope_of(Interaction(Table.from_law(material, scope)))
        found, wanted = pm.solve_pixel(POLYMER, made, 0.7), pm.solve_pixel(material, scope, 0.7)
        assert found.phase == pytest.approx(wanted.phase, abs=1e-4), name  # 4e-7 at most
        assert found.dissipation == pytest.approx(wanted.dissipation, rel=1e-5), name
    with pytest.raises(pm.InputError, match="one that does not relax"):
        Table.from_law(pm.Material(1e9, relaxed_modulus=0.5e9, relaxation_time=1e-6), scope_of(Interaction("hertz")))


def test_cubics_are_monotone_between_points_and_keep_a_kink_and_a_jump_at_contact() -> None:
    law = Table(DEPTHS, FORCES)
    outside = law.attraction
    inner = [law.force(d, None) for d in np.linspace(0, 2e-9, 101)]
    outer = [outside.force(d, None) for d in np.linspace(-2e-9, 0, 101)]
    assert (np.diff(inner) > 0).all() and (np.diff(outer) < 0).all()
    assert outside.slope(0.0, None) < 0.0 < law.slope(0.0, None)
    assert law.force(3e-9, None) == pytest.approx(30e-9 + 1e-9 * law.slope(2e-9, None), rel=1e-12)
    assert outside.force(-1e-8, None) == 0.0
    jump = Table((-1e-9, 0.0, 0.0, 1e-9, 2e-9), (0.0, -1e-9, -5e-9, 2e-9, 9e-9))
    assert (jump.attraction.force(0.0, None), jump.force(0.0, None)) == (-1e-9, -5e-9)


@pytest.mark.slow
def test_damping_of_a_table_is_that_of_a_sphere_where_it_says_so() -> None:
    depths = np.concatenate([[-1e-9, 0.0], np.geomspace(1e-12, 20e-9, 400)])
    sphere = 4 / 3 * 1e9 / (1 - 0.35**2) * np.sqrt(TIP.radius) * np.maximum(depths, 0.0) ** 1.5
    profile = np.sqrt(TIP.radius * np.maximum(depths, 0.0))
    law = Table(tuple(depths), tuple(sphere), tuple(profile))
    wanted = pm.solve_pixel(pm.Material(1e9, viscosity=30.0), scope_of(Interaction("hertz", None)), 0.7, "orbit")
    found = pm.solve_pixel(pm.Material(1e9, viscosity=30.0), scope_of(Interaction(law)), 0.7, "orbit")
    assert found.phase == pytest.approx(wanted.phase, abs=1e-3)
    assert found.dissipation == pytest.approx(wanted.dissipation, rel=1e-4)


def test_columns_are_read_with_their_units(tmp_path: Path) -> None:
    text, arrays = tmp_path / "md.csv", tmp_path / "md.npz"
    rows = zip(DEPTHS[::-1], FORCES[::-1], strict=True)
    text.write_text("# gap [nm], force [pN]\n" + "".join(f"{-1e9 * d},{1e12 * f}\n" for d, f in rows))
    np.savez(arrays, depth=DEPTHS, force=FORCES)
    assert np.allclose(Table.read(text).depths, DEPTHS) and np.allclose(Table.read(text).forces, FORCES)
    assert Table.read(arrays) == Table(DEPTHS, FORCES)


def test_a_scene_names_the_file_of_a_table(tmp_path: Path) -> None:
    np.savez(tmp_path / "md.npz", depth=DEPTHS, force=FORCES)
    sample = (Path(__file__).parents[2] / "samples" / "step.toml").read_text()
    head, _, rest = sample.partition("[interaction]")
    (tmp_path / "scene.toml").write_text(sample if not rest else head + "[interaction]" + rest)
    made = pm.load_scene(tmp_path / "scene.toml", ['interaction.contact={ law = "table", file = "md.npz" }'])
    assert made.microscope.interaction.contact == Table(DEPTHS, FORCES)
    assert pm.scenes.scene.scene_from_json(made.to_json(), tmp_path).microscope == made.microscope


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (((0.0, 1e-9, 0.5e-9, 2e-9), (0.0,) * 4), "depths is .* allowed: 4 or more that rise"),
        (((0.0, 1e-9, 2e-9, 3e-9), (0.0,) * 3), "forces is .* allowed: 4 finite ones"),
        (
            ((0.0, 1e-9, 2e-9, 3e-9), (0.0,) * 4, (0.0, -1.0, 0.0, 0.0)),
            "dampings is -1.0; allowed: numbers of at least 0",
        ),
    ],
)
def test_what_is_no_table_is_refused_in_a_sentence(arguments: tuple[tuple[float, ...], ...], sentence: str) -> None:
    with pytest.raises(pm.InputError, match=sentence):
        Table(*arguments)


def test_files_without_columns_are_refused_in_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "bad.csv").write_text("x [nm], y [nN]\n1,2\n3,4\n")
    with pytest.raises(pm.FileError, match=r"it lacks columns depth \(or gap\) and force"):
        Table.read(tmp_path / "bad.csv")
    (tmp_path / "worse.csv").write_text("depth [s], force [nN]\n1,2\n3,4\n")
    with pytest.raises(pm.FileError, match=r"the column 'depth \[s\]' is not in a unit of m"):
        Table.read(tmp_path / "worse.csv")


def test_a_table_whose_force_is_smaller_on_the_way_out_has_the_orbits_of_adhesion_that_grows() -> None:
    """LossyDMT takes more adhesion from the deepest point on: the same numbers, over cubics between 600 points."""
    law = pm.interaction.LossyDMT(1.5)
    wanted = pm.solve_pixel(POLYMER, scope_of(Interaction(law)), 0.7)
    table = Table.from_law(POLYMER, scope_of(Interaction("dmt")))
    less = 0.5 * 2 * np.pi * TIP.radius * POLYMER.adhesion
    out = Table(table.depths, table.forces, None, tuple(f - less for f in table.forces))
    found = pm.solve_pixel(POLYMER, scope_of(Interaction(out)), 0.7)
    assert found.status is pm.Status.good and found.solver == "march"
    assert found.phase == pytest.approx(wanted.phase, abs=1e-4)
    assert found.dissipation == pytest.approx(wanted.dissipation, rel=1e-5)
    depths = np.array(table.depths[302:350])  # a force curve goes through its points, both ways
    there, back = pm.force_curve(POLYMER, scope_of(Interaction(out)), depths).force.values
    assert there == pytest.approx(table.forces[302:350], rel=1e-9, abs=1e-15)
    assert there - back == pytest.approx(less)


def test_a_loop_that_gives_energy_is_refused() -> None:
    with pytest.raises(pm.InputError, match=r"withdrawal_forces is above forces at 1e-09 m.*create energy"):
        Table(DEPTHS, FORCES, None, (0.0, -1e-9, -4e-9, 11e-9, 30e-9))
