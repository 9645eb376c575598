"""What small functions give that the rest of the package builds on: numbers and their units, words, pieces of work."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import phasemap as pm
from phasemap._shared import asked, checks, fields, quantities, threads, units
from phasemap._shared.arrays import is_varied, real_numbers
from phasemap._shared.asked import asked_as
from phasemap._shared.errors import InputError, InputErrors, on_one_line
from phasemap._shared.memory import size_in_words
from phasemap._shared.notices import likely
from phasemap._shared.pixels import downwards
from phasemap._shared.processes import in_processes
from phasemap._shared.units import Unit
from phasemap.cli.arguments import number_or_range, one_each
from phasemap.cli.run import _in_words
from phasemap.comparison.scores import share_explained
from phasemap.experiment.arms import merged
from phasemap.experiment.beam import hydrodynamic_function
from phasemap.experiment.material_rows import contact_stiffness, distinct_materials, materials_of, of_one_loss, rows_of
from phasemap.experiment.presets import combined
from phasemap.experiment.seen_by_tip import tip_profile
from phasemap.imaging.feedback.lines import mean_ground, program_of
from phasemap.imaging.interpolation import chebyshev
from phasemap.imaging.materials import Distinct
from phasemap.inference.curves.result import with_error
from phasemap.io import measured
from phasemap.io.curves import is_curve
from phasemap.io.netcdf import check_dataset
from phasemap.plot import colours, contrast_map
from phasemap.plot.page import side_lengths
from phasemap.results.descriptions import describe_flags, describe_solvers
from phasemap.results.quantities import needs_of
from phasemap.scenes import samples, tables
from phasemap.scenes.ensemble import name_of
from phasemap.scenes.ensemble_file import as_column
from phasemap.scenes.samples import make_samples
from phasemap.scenes.tables import written

LOOP = {"proportional_gain": 0.1, "integral_gain_per_second": 9.0, "ringing_lines": 0, "gains_lowered": 1.0}


def rings(margin: float) -> str:
    """What is said of a loop with this margin of its gains."""
    return _in_words({**LOOP, "gain_margin": margin, "periods_per_pixel": 50.0}, False).split("; ")[1]


def ball(**changes: Any) -> Any:
    """A value object of one number, called by whatever name is given."""

    @fields.known_as(R="radius")
    @dataclass(frozen=True, repr=False)
    class Ball(fields.Shown):
        radius: fields.Number[float] = fields.Number("m", 40e-9, above=0)

    return Ball(**changes)


def discs(**given: Any) -> Any:
    """A function that others call by another name of its argument."""

    @asked_as(share="part")
    def discs(shape: Any, *, part: float, seed: int = 0) -> Any:
        return shape

    return discs((8, 8), **given)


GIVES: list[tuple[Any, Any]] = [
    # numbers and units
    (checks.number("radius", "20 nm", "m", above=0), 2e-8),
    (checks.numbers("tip_offsets", "60 nm:20 nm:3", "m").tolist(), [6e-8, 4e-8, 2e-8]),
    (checks.numbers("tip_offsets", ["1 nm", 2e-9], "m"), [1e-9, 2e-9]),
    (real_numbers("depths", ["1 nm", 2e-9], "m").tolist(), [1e-9, 2e-9]),
    (checks.range_in_words("m", above=0), "a finite number above 0 m"),
    (checks.range_in_words("1", above=-1, maximum=0.5), "a finite number above -1 and at most 0.5"),
    (checks.range_in_words("Pa", minimum=0), "a finite number of at least 0 Pa"),
    (checks.range_in_words("Hz"), "a finite number, in Hz"),
    (quantities.in_si("50 mJ/m2", "J/m2"), 0.05),
    (quantities.in_si("70 %", "1"), 0.7),
    (quantities.array_in_si([["1 GPa", 3e9]], "Pa"), [[1e9, 3e9]]),
    (quantities.range_in_si("0.3:0.95:40", "1"), (0.3, 0.95, 40)),
    (quantities.split("50 mJ / m^2"), ("50", "mJ/m^2")),
    ([quantities.is_number(text) for text in ("-5e-9", "60 nm", "tip.radius=20e-9")], [True, True, False]),
    ([quantities.unit_of(one) for one in ("3 GPa", "3", 3e9)], ["GPa", "", ""]),
    ([quantities.is_in(text, "GPa") for text in ("3 MPa", "10 nm")], [True, False]),
    (quantities.with_unit("1"), "a plain number such as '0.7'"),
    (units.readable(16e-9, "m"), Unit(1e-9, "nm")),
    (units.say(0.06, "J m-2"), "0.06 J/m²"),
    (Unit(1e3, "kHz").say(148240.0, 2), "148 kHz"),
    (Unit(1.0, "").label("damping"), "damping"),
    ([likely(value, "m", (0.5e-9, 10e-6)) for value in (10.0, 1e-30)], ["10 nm", ""]),
    (number_or_range("--setpoints", "0.3:0.9:7", "1"), (0.3, 0.9, 7)),
    (one_each("phase_zero", "62.5", "degree", 2, "a file"), [62.5, 62.5]),
    ([samples.unit_of(key) for key in ("materials.ps.adhesion", "surface.spacing")], ["J/m2", ""]),
    (samples.plain("drive.free_amplitude", "drive.free_amplitude", "40 nm"), 40e-9),
    # words
    (on_one_line("abcdefgh", 4), "ab ... gh"),
    (size_in_words(2.88e12), "2.88 TB"),
    (units.counted(3, 400, "pixels"), "3 of 400 pixels (0.75 %)"),
    (units.image_size((128, 256), (4e-9, 4e-9)), "256 x 128 pixels, 1.024 x 0.512 µm"),
    (units.listed(["modulus", "adhesion", "damping"]), "modulus, adhesion and damping"),
    (repr(ball()) + repr(ball(radius=7e-8)), "Ball()Ball(radius=7e-08)"),
    (
        fields.values_in_words(pm.Cantilever(0.1, 20e3, 2.0, modes=(pm.Eigenmode(7.0, 6.0),))),
        "stiffness 0.1 N/m, resonance frequency 20 kHz, quality factor 2, modes (frequency ratio 7, quality factor 6)",
    ),
    (
        str(InputErrors([InputError("setpoint", 1.2, "a number below 1"), InputError("radius", 0, "more than 0")])),
        "setpoint is 1.2; allowed: a number below 1.\nradius is 0; allowed: more than 0.",
    ),
    (asked.of_kind("names", iter(["a", "b"]), "Iterable[str] | None"), ["a", "b"]),
    (written([True, "a"]) + written({"file": "maps.nc"}), '[true, "a"]{ file = "maps.nc" }'),
    (
        describe_solvers(
            xr.DataArray([0, 1, 4, 4], attrs={"flag_values": [0, 1, 4], "flag_meanings": "averaging orbit corrected"})
        ),
        "orbit (exact) 75 %, averaging (first order) 25 %",
    ),
    (
        describe_flags(xr.DataArray([0, 0, 0, 1], attrs={"flag_values": [0, 1], "flag_meanings": "averaging orbit"})),
        "averaging 75 %, orbit 25 %",
    ),
    (needs_of(["phase", "dissipation_ev"]), ("phase", "amplitude", "dissipation")),
    (with_error(0.8912e9, 0.0123e9, "Pa"), "0.891 ± 0.012 GPa"),
    (with_error(0.0137, float("inf"), "1"), "0.0137, not determined"),
    # pieces of work
    ([threads.chunk_of(count, 2, 1000) for count in (10, 100, 100_000)], [3, 13, 1000]),
    ([threads.chunk_of(count, 1, 1000) for count in (100, 100_000)], [100, 1000]),
    (threads.bounds_of(10, 4), [0, 4, 8, 10]),
    (threads.bounds_of(0, 4), []),
    (threads.found_in(lambda first, last: last - first, [0, 4, 8, 10], 2), [4, 4, 2]),
    (list(in_processes(abs, [-1, 2], workers=1)), [1, 2]),
    # materials
    ([round(1e12 * t, 3) for t in merged(pm.Prony([1e9] * 3, [1e-12, 1e-11, 1e-6], 1e9), 3e5).times], [9.182, 1e6]),
    (distinct_materials([np.array([[1.0, 3.0, 1.0]]), np.full((1, 3), 0.5)])[0].tolist(), [[1.0, 0.5], [3.0, 0.5]]),
    (combined({"modulus": 3e9, "viscosity": 20.0}, {"damping": 0.01}), {"modulus": 3e9, "damping": 0.01}),
    (contact_stiffness(np.array([0.0, 0.75e9]), np.zeros(2), pm.Tip(1e-8)).tolist(), [0.0, 1e9]),
    (complex(np.round(hydrodynamic_function(10.0), 3)), 1.918 + 0.982j),
    (tip_profile(np.array([0.0, 6.0, 30.0]), 10.0, np.pi / 4).round(6).tolist(), [0.0, 2.0, 25.857864]),
    (Distinct(10).add(np.array([[1.0, 0, 0, 0], [2.0, 0, 0, 0], [1.0, 0, 0, 0]])), 3),
    # images and files
    (share_explained(np.array([1.0, 3.0, 5.0]), [np.array([0.0, 1.0, 2.0])]), 1.0),
    (is_varied(np.full(1001, 0.3)), False),
    (measured.level_plane(3e-7 + 1e-9 * np.indices((9, 8))[1], np.ones((9, 8), bool)).any(), False),
    ([downwards(np.array([3.0, 1.0]), dim).tolist() for dim in "yx"], [[1.0, 3.0], [3.0, 1.0]]),
    (mean_ground(np.array([0.0, 8.0, 8.0])).tolist(), [1.0, 7.0, 8.0]),
    (program_of(np.array([0, 1]), np.array([0.0, 4.0]), 2.0, 0.0).slope[:4].tolist(), [0.0, 2.0, 2.0, 0.0]),
    (chebyshev.nodes(5).round(2).tolist() + chebyshev.nodes(1).tolist(), [-1.0, -0.71, 0.0, 0.71, 1.0, 0.0]),
    (abs(chebyshev.coefficients(2 * chebyshev.nodes(5) ** 2, [0])).round(12).tolist(), [1.0, 0.0, 1.0, 0.0, 0.0]),
    ([rings(2.5), rings(0.5)], ["stable up to 2.5 times these gains", "unstable: lower the gains"]),
    (rings(1e6), "never rings, not even at a million times these gains"),
    ([is_curve(Path(name)) for name in ("scan.nid", "curve.csv")], [False, True]),
    (
        measured.level_rows(np.array([[1.0, 2, 3], [7, 8, 99]]), np.array([[1, 1, 1], [1, 1, 0]], bool))[1].tolist(),
        [0.0, 0.0, 90.0],
    ),
    (
        measured.row_medians(np.array([[1.0, 3], [9, 9], [5, 7]]), np.array([[1, 1], [0, 0], [1, 1]], bool)).tolist(),
        [[2.0], [4.0], [6.0]],
    ),
    (measured.on_one_turn(np.array([178.0, 179.0, -179.0])).tolist(), [178.0, 179.0, 181.0]),
    (measured.segment_height(1e-9 * np.array([[0.0, 1, 2, 13, 14, 15, 16]] * 4), 2)[0].tolist(), [0, 0, 0, 1, 1, 1, 1]),
    (colours.given_colours({"height": "2 nm"}, 60, None, {"height": "m", "phase": "degree"})["phase"].vmax, 60.0),
    (contrast_map.colours_of(np.array([-3.0, 2.0])).vmax, 3.0),
    (contrast_map.colours_of(np.array([-3.0, 2.0]), colours.Colours(vmin=5.0)).vmin, -5.0),
    (
        contrast_map.ticks_of(contrast_map.colours_of(np.array([1.0, 1.0, -90.0]))),
        [-30.0, -10.0, -3.0, -1.0, 0.0, 1.0, 3.0, 10.0, 30.0],
    ),
    (side_lengths(xr.Dataset(coords={"y": [1.0], "x": [0.0, 2.0, 4.0]})), (6.0, 2.0)),
    # scenes
    (name_of("materials.PS/PMMA.modulus"), "materials.PS_PMMA.modulus"),
    (as_column([1, 2.5]).dtype, np.dtype(float)),
    (as_column([True, [0.0, 1e-9]]).tolist(), ["true", "[0.0, 1e-09]"]),
    (make_samples({"count": 2, "vary": {"scan": {"setpoint": [0.7]}}}, Path()), ({"scan.setpoint": 0.7},) * 2),
    (tables.with_value({"tip": {"radius": 1e-8}}, "tip.modulus", 1e11), {"tip": {"radius": 1e-8, "modulus": 1e11}}),
    (
        tables.with_value({"materials": {"a": {"modulus": 1e9, "thickness": 1e-7}}}, "materials.a.preset", "PS"),
        {"materials": {"a": {"thickness": 1e-7, "preset": "PS"}}},
    ),
    (sorted(tables.stated_in("cantilever.preset", "PPP-NCHR"))[0], "cantilever.length"),
]  # fmt: skip


@pytest.mark.parametrize(("given", "wanted"), GIVES)
def test_a_helper_gives_what_its_callers_build_on(given: Any, wanted: Any) -> None:
    assert given == wanted


REFUSED: dict[str, Callable[[], Any]] = {
    "Ball has no argument 'r'; its arguments are radius.": lambda: ball(r=40e-9),
    "Ball has no argument 'R'; its arguments are radius. Did you mean 'radius'?": lambda: ball(R=40e-9),
    "discs has no argument 'share'; its arguments are shape, part, seed. Did you mean 'part'?": lambda: discs(share=1),
    "discs needs part; it is called as discs(shape, part=...).": discs,
    "scope is 3; allowed: a Microscope or None. The order is f(scope).":
        lambda: asked.of_kind("scope", 3, "Microscope | None", "The order is f(scope)."),
    "the output's suffix is '.png'; allowed: .nc, for it becomes a netCDF file. Use phasemap plot.":
        lambda: check_dataset("blend.png"),
    "[tip] radus is unknown; allowed: radius, modulus. Did you mean 'radius'?":
        lambda: tables.check_keys("[tip]", {"radus": 10e-9}, ["radius", "modulus"]),
}  # fmt: skip


@pytest.mark.parametrize("sentence", REFUSED)
def test_a_helper_refuses_in_a_sentence(sentence: str) -> None:
    with pytest.raises((TypeError, pm.InputError)) as refused:
        REFUSED[sentence]()
    assert str(refused.value) == sentence


def test_materials_come_back_from_their_rows() -> None:
    film, solid = pm.Material(1e9, thickness=5e-9), pm.Material(2e9, relaxed_modulus=1e9, relaxation_time=1e-7)
    rubber = pm.Material(relaxation=pm.Prony([5e8, 4e8], [2e-8, 1e-6], 1e8))
    assert materials_of(*rows_of([film, solid, rubber])) == [film, solid, rubber]


def test_materials_of_both_kinds_of_loss_get_one() -> None:
    scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(40e-9))
    both = of_one_loss({"a": pm.Material(1e9, damping=0.01), "b": pm.Material(1e9, viscosity=42.44)}, scope)
    assert both["b"].damping == pytest.approx(0.01, rel=1e-4) and both["b"].viscosity is None


def test_populations_are_apart_where_their_distance_is_above_their_noise() -> None:
    noise = np.random.default_rng(1).normal(size=(64, 64))
    halves = (np.arange(64) > 31) * np.ones((64, 1), int)
    ratios = [measured.separation_of(noise + contrast * halves, halves)[1] for contrast in (5.0, 0.5)]
    assert ratios[0] > measured.APART > ratios[1]
