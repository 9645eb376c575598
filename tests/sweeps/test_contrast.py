"""Contrast between two materials: what the physics says of it, where it inverts, and where to work."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from documented import check

import phasemap as pm
from phasemap._kernels import columns as col
from phasemap._kernels.rows.answers import Answers
from phasemap.cli import main
from phasemap.io.netcdf import load
from phasemap.plot import plot
from phasemap.results.variables import motion_of
from phasemap.scenes.scene import load_setup
from phasemap.sweeps.contrasts.result import choose

SAMPLES = Path(__file__).parents[2] / "samples"
LEVER, TIP = pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9)
SCOPE = pm.Microscope(LEVER, TIP, pm.Drive(30e-9))
STICKY = pm.Material(modulus=0.1e9, adhesion=0.05, damping=0.01, poisson_ratio=0.45)
LOSSY = pm.Material(modulus=0.1e9, adhesion=0.005, damping=0.03, poisson_ratio=0.45)
PARTICLE = pm.Material(modulus=3e9, adhesion=0.15, damping=0.005)  # those of examples/contrast_inversion.py
MATRIX = pm.Material(modulus=0.5e9, adhesion=0.02, damping=0.02, poisson_ratio=0.48)
SETPOINTS = np.linspace(0.4, 0.95, 12)
AMPLITUDES = np.array([20e-9, 24e-9, 28e-9])
ATTRACTIVE, REPULSIVE, BISTABLE = 1, 2, 3


@pytest.fixture(scope="module")
def jumping() -> xr.Dataset:
    """A map in which the particle jumps from the attractive to the repulsive regime, and is bistable."""
    return pm.contrast(MATRIX, PARTICLE, SCOPE, SETPOINTS, AMPLITUDES, names=("matrix", "particle"))


@pytest.fixture(scope="module")
def crossing() -> xr.Dataset:
    """A line on which both phases are continuous and cross each other."""
    return pm.contrast(STICKY, LOSSY, SCOPE, SETPOINTS)


def test_the_page_on_files_lists_the_variables_of_a_contrast_map(jumping: xr.Dataset) -> None:
    check("Variables of a contrast map", jumping)


def test_undamped_materials_in_one_regime_have_no_phase_contrast_but_one_of_height() -> None:
    soft, hard = pm.Material(modulus=0.5e9), pm.Material(modulus=5e9)
    found = pm.contrast(soft, hard, SCOPE, SETPOINTS, solver="orbit")
    assert (found.regime == REPULSIVE).all()
    # The lever alone dissipates: cos(phase) = A/A_free (1 + sum n^2 A_n^2/A^2), whatever the material. Harmonics of
    # 0.5 % of A, the most a lever with Q = 400 lets through here, are worth n^2 1e-4 / tan(18 deg) rad = 0.02 degree.
    expected = np.degrees(np.arccos(SETPOINTS))
    assert np.abs(found.phase - expected).max() < 0.02
    assert np.abs(found.contrast).max() < 0.02
    assert (found.height_contrast > 0.1e-9).all()  # the tip sinks deeper into the soft one
    assert "the phase does not tell the materials apart" in found.attrs["recommendation"]
    assert found.attrs["reason"].startswith("second and first look alike")
    assert found.sizes["jump"] == 0


def test_exchanging_the_materials_changes_the_sign_and_nothing_else(crossing: xr.Dataset) -> None:
    other = pm.contrast(LOSSY, STICKY, SCOPE, SETPOINTS)
    assert (other.contrast.values == -crossing.contrast.values).all()
    assert (other.height_contrast.values == -crossing.height_contrast.values).all()
    assert other.inversion_setpoint.values == pytest.approx(crossing.inversion_setpoint.values, abs=1e-7)
    assert other.attrs["best_setpoint"] == crossing.attrs["best_setpoint"]


def test_a_material_has_no_contrast_with_itself() -> None:
    found = pm.contrast(PARTICLE, PARTICLE, SCOPE, [0.6, 0.8], [20e-9, 28e-9])
    assert (found.contrast == 0).all() and found.sizes["inversion"] == 0
    assert (found.jump_from_contrast == 0).all() and (found.jump_inverts == 0).all()


def test_each_point_of_the_map_is_what_a_pixel_shows(jumping: xr.Dataset) -> None:
    assert jumping.contrast.dims == ("free_amplitude", "setpoint")
    for amplitude in AMPLITUDES[[0, -1]]:
        scope = pm.Microscope(LEVER, TIP, pm.Drive(amplitude))
        for setpoint in SETPOINTS[[0, 7, -1]]:
            here = jumping.sel(free_amplitude=amplitude, setpoint=setpoint)
            pixels = [pm.solve_pixel(material, scope, setpoint) for material in (MATRIX, PARTICLE)]
            assert here.phase.values.tolist() == [pixel.phase for pixel in pixels]
            assert here.height.values.tolist() == [pixel.height for pixel in pixels]
            assert float(here.contrast) == pixels[1].phase - pixels[0].phase


@pytest.mark.parametrize("solver", ["auto", "march"])
def test_a_viscous_material_beside_one_that_relaxes_lets_go_as_it_does_alone(solver: str) -> None:
    scope = pm.Microscope(pm.Cantilever(20.0, 300e3, 30.0), TIP, pm.Drive(20e-9))
    relaxing = pm.Material(1e9, 0.02, relaxed_modulus=0.5e9, relaxation_time=1e-7)
    viscous = pm.Material(2e9, 0.02, viscosity=100.0)
    found = pm.contrast(relaxing, viscous, scope, [0.6, 0.7], solver=solver)
    alone = [pm.solve_pixel(viscous, scope, setpoint, solver).phase for setpoint in (0.6, 0.7)]
    assert found.phase.sel(material="second").values.tolist() == alone
    one, both = pm.Microscope(pm.Cantilever(26.0, 300e3, 300.0), TIP, pm.Drive(10e-9)), pm.Material(0.5e9, 0.05, 0.01)
    assert pm.contrast(relaxing, both, one, [0.6, 0.9]).regime[1].values.tolist() == [BISTABLE, BISTABLE]


def test_regimes_are_those_of_all_stable_orbits(jumping: xr.Dataset) -> None:
    assert set(np.unique(jumping.regime.sel(material="particle"))) == {REPULSIVE, BISTABLE}
    for amplitude in AMPLITUDES[[0, -1]]:
        scope = pm.Microscope(LEVER, TIP, pm.Drive(amplitude))
        for name, material in (("matrix", MATRIX), ("particle", PARTICLE)):
            for setpoint in SETPOINTS[[0, 7, -1]]:
                found = pm.orbits(material, scope, setpoint=setpoint)
                held = found.branch.values[(found.stable.values == 1) & (found.feedback_slope.values > 0)]
                expected = sum({ATTRACTIVE if branch == 0 else REPULSIVE for branch in held.tolist()})
                assert int(jumping.regime.sel(material=name, free_amplitude=amplitude, setpoint=setpoint)) == expected


def test_the_contrast_is_zero_at_an_inversion_and_of_opposite_signs_beside_it(crossing: xr.Dataset) -> None:
    assert crossing.sizes["jump"] == 0
    (setpoint,) = crossing.inversion_setpoint.values

    def at(setpoint: float) -> float:
        first, second = (pm.solve_pixel(material, SCOPE, setpoint, solver="orbit") for material in (STICKY, LOSSY))
        return second.phase - first.phase

    assert abs(at(setpoint)) < 1e-5  # the setpoint is good to 1e-8, and the slope is 50 degrees
    assert at(setpoint - 1e-3) < 0 < at(setpoint + 1e-3)
    assert np.sign(crossing.contrast.values).tolist() == np.where(SETPOINTS < setpoint, -1, 1).tolist()


def test_both_materials_have_the_phase_of_the_inversion() -> None:
    found = pm.contrast(STICKY, LOSSY, SCOPE, [0.7, 0.9], [28e-9, 30e-9])
    assert found.sizes["inversion"] == 2
    for k in range(2):
        drive = pm.Drive(float(found.inversion_free_amplitude[k]))
        scope, setpoint = pm.Microscope(LEVER, TIP, drive), float(found.inversion_setpoint[k])
        phases = [pm.solve_pixel(material, scope, setpoint, solver="orbit").phase for material in (STICKY, LOSSY)]
        assert phases == pytest.approx([float(found.inversion_phase[k])] * 2, abs=1e-5)


def test_the_inversion_is_found_along_every_axis() -> None:
    amplitudes, frequencies = [26e-9, 34e-9], [299.5e3, 300e3]
    found = pm.contrast(STICKY, LOSSY, SCOPE, [0.7, 0.8], amplitudes, frequencies)
    on = {
        name: ~np.isin(found[f"inversion_{name}"], found[name]) for name in ("setpoint", "free_amplitude", "frequency")
    }
    assert all(inside.any() for inside in on.values())
    assert (sum(inside.astype(int) for inside in on.values()) == 1).all()


def test_a_contrast_that_changes_sign_by_a_jump_is_no_zero(jumping: xr.Dataset) -> None:
    assert (jumping.contrast > 5).any() and (jumping.contrast < -30).any()
    assert jumping.sizes["inversion"] == 0
    assert (jumping.jump_inverts == 1).all() and (jumping.jump_material == 1).all()
    assert (np.abs(jumping.jump_from_contrast - jumping.jump_to_contrast) > 30).all()


def test_a_contrast_that_nobody_can_see_does_not_invert() -> None:
    glassy = pm.Material(2.8e9, adhesion=0.074, damping=0.0035)
    lossy = pm.Material(2.7e9, adhesion=0.079, damping=0.027)
    found = pm.contrast(glassy, lossy, SCOPE, [0.5, 0.65, 0.8, 0.9], [10e-9, 12e-9], solver="averaging")
    assert found.contrast.min() < -30.0 and 0.0 < found.contrast.max() < 0.5  # hardly any where both are attractive
    assert (found.jump_from_contrast * found.jump_to_contrast < 0).any() and not found.jump_inverts.any()
    assert found.sizes["inversion"] == 0


def test_the_tip_jumps_where_a_sweep_of_the_setpoint_jumps(jumping: xr.Dataset) -> None:
    amplitude = AMPLITUDES[1]
    here = jumping.isel(jump=jumping.jump_free_amplitude.values == amplitude)
    sweep = pm.sweep_setpoint(PARTICLE, pm.Microscope(LEVER, TIP, pm.Drive(amplitude)), SETPOINTS)
    down = sweep.isel(jump=sweep.jump_direction.values == 0)
    # Followed by continuation there, bisected here; the phases end at a fold, as the root of what is left: 1e-3 degree.
    assert here.jump_setpoint.values == pytest.approx(down.jump_setpoint.values, abs=1e-6)
    assert here.jump_to_phase.values == pytest.approx(down.jump_from_phase.values, abs=0.05)


def test_the_point_recommended_is_safe(jumping: xr.Dataset) -> None:
    best = {name: jumping.attrs[f"best_{name}"] for name in ("setpoint", "free_amplitude")}
    here = jumping.sel(best)
    assert (here.regime != BISTABLE).all()
    assert float(here.contrast) == jumping.attrs["best_contrast"]
    same = jumping.jump_free_amplitude.values == best["free_amplitude"]
    assert np.abs(jumping.jump_setpoint.values[same] - best["setpoint"]).min(initial=1.0) >= 0.03
    words = rf"setpoint {best['setpoint']:.3g}, free amplitude {best['free_amplitude'] * 1e9:.3g} nm: particle minus "
    assert re.match(words + r"matrix is \d\.\d degrees, both repulsive, ", jumping.attrs["recommendation"])
    reason = rf"particle is {abs(float(here.contrast)):.3g}° brighter than matrix, because it loses less energy: "
    assert jumping.attrs["reason"].startswith(reason)


def test_of_points_with_nearly_the_largest_contrast_the_gentlest_is_recommended(jumping: xr.Dataset) -> None:
    single = (jumping.regime != BISTABLE).all("material")
    enough = single & (jumping.contrast >= 0.9 * jumping.contrast.where(single).max())
    deepest = jumping.indentation.max("material")
    best = deepest.sel({name: jumping.attrs[f"best_{name}"] for name in ("setpoint", "free_amplitude")})
    assert float(best) < float(deepest.where(enough).median())


def test_bistable_points_are_recommended_only_with_a_warning() -> None:
    found = pm.contrast(MATRIX, PARTICLE, SCOPE, [0.8, 0.9], 18e-9)
    assert (found.regime[1] == BISTABLE).all()
    assert "not safe" in found.attrs["recommendation"]
    assert "second is bistable: the controller can hold this setpoint" in found.attrs["reason"]


@pytest.mark.parametrize("spread", [1e-12, 0.0])
def test_an_irregular_point_is_recommended_only_with_a_warning(spread: float) -> None:
    rows = np.zeros((2, 1, 1, 2, col.COLUMNS))
    rows[..., col.AMPLITUDE], rows[..., col.STIFFENING], rows[1, ..., col.PHASE] = 2e-8, 1e-3, [0.5, 0.4]
    rows[1, ..., 0, col.SPREAD_AMPLITUDE] = spread  # where the contrast is larger, and contact no deeper
    engaged = Answers(rows, np.zeros(rows.shape[:-1], np.int8), np.zeros(rows.shape[:-1], np.int8))
    axes = np.array([3e5]), np.array([2e-8]), np.array([0.6, 0.8])
    for places, best, safe in ((slice(None), 1 if spread else 0, True), (slice(1), 0, not spread)):
        here = engaged._replace(rows=rows[..., places, :])
        regime = np.full(here.rows.shape[:-1], REPULSIVE, np.int8)
        found = choose((*axes[:2], axes[2][places]), ("a", "b"), here, regime, motion_of(here.rows), [])
        assert found.place == (0, 0, best) and ("not safe" not in found.sentence) == safe


def test_points_without_an_orbit_are_marked_and_do_not_count() -> None:
    # Below resonance the amplitude of the sticky material jumps across some setpoints.
    found = pm.contrast(STICKY, LOSSY, SCOPE, [0.4, 0.5, 0.9], 15e-9, 298.5e3)
    lost = found.status != 0
    assert lost.any() and (np.isnan(found.phase) == lost).all()
    assert (np.isnan(found.contrast) == lost.any("material")).all()
    best = found.sel(setpoint=found.attrs["best_setpoint"])
    assert np.isfinite(best.contrast) and (best.status == 0).all()


def test_a_map_without_orbits_recommends_nothing() -> None:
    found = pm.contrast(STICKY, LOSSY, SCOPE, [0.4, 0.5], 15e-9, 298.5e3)
    assert np.isnan(found.attrs["best_setpoint"])
    assert found.attrs["recommendation"].startswith("no point of the map holds both materials")
    assert found.attrs["reason"] == ""
    plot(found)


def test_a_number_is_a_coordinate_and_an_array_a_dimension() -> None:
    line = pm.contrast(STICKY, LOSSY, SCOPE, [0.8, 0.7], 25e-9, 299.9e3)
    assert line.contrast.dims == ("setpoint",) and line.setpoint.values.tolist() == [0.8, 0.7]
    assert float(line.free_amplitude) == 25e-9 and float(line.frequency) == 299.9e3
    drive = json.loads(line.attrs["configuration"])["microscope"]["drive"]
    assert (drive["free_amplitude"], drive["frequency"]) == (25e-9, 299.9e3)
    cube = pm.contrast(STICKY, LOSSY, SCOPE, [0.7, 0.8], [30e-9, 25e-9], [299.9e3, 300.1e3])
    assert cube.phase.dims == ("material", "frequency", "free_amplitude", "setpoint")
    assert float(cube.contrast[0, 1, 1]) == float(line.contrast[0])


def test_a_map_can_be_stopped_while_jumps_are_sought() -> None:
    def stop(done: int, total: int) -> None:
        calls.append(done)
        if calls.count(total) == 2:
            raise InterruptedError

    calls: list[int] = []
    with pytest.raises(InterruptedError):
        pm.contrast(MATRIX, PARTICLE, SCOPE, SETPOINTS, AMPLITUDES, progress=stop, threads=1)
    assert calls == [12, 24, 36, 36]


def test_the_numbers_do_not_depend_on_the_threads_and_a_file_holds_them(tmp_path: Path, jumping: xr.Dataset) -> None:
    calls: list[tuple[int, int]] = []
    one = pm.contrast(
        MATRIX, PARTICLE, SCOPE, SETPOINTS, AMPLITUDES, names=("matrix", "particle"), threads=1,
        progress=lambda done, total: calls.append((done, total)),
    )  # fmt: skip
    assert one.equals(jumping)
    assert list(dict.fromkeys(calls)) == [(12, 36), (24, 36), (36, 36)]
    assert len(calls) > 3  # while jumps are sought between the points
    jumping.to_netcdf(tmp_path / "map.nc")
    with xr.open_dataset(tmp_path / "map.nc") as read:
        assert read.load().identical(jumping)
    for name, variable in jumping.variables.items():
        assert "long_name" in variable.attrs, name
        assert "units" in variable.attrs or "flag_meanings" in variable.attrs or name == "material", name


def test_materials_in_a_dict_are_told_how_to_come():
    ask: Any = pm.contrast
    for given in ({"particle": PARTICLE, "matrix": MATRIX}, [PARTICLE, MATRIX]):
        with pytest.raises(TypeError, match=r"^contrast needs scope; .* not in a dict or list\.$"):
            ask(given, SCOPE)


BAD: list[tuple[dict[str, Any], str]] = [
    ({"first": "rubber"}, "first is 'rubber'; allowed: a Material"),
    ({"setpoints": [0.5, 1.2]}, "setpoint is 1.2; allowed: a number above 0 and below 1"),
    ({"setpoints": 0.5}, "at least two values"),
    ({"free_amplitudes": [20e-9, -1e-9]}, "free_amplitudes is -1e-09"),
    ({"frequencies": 0.0}, "frequencies is 0.0; allowed: a finite number above 0 Hz"),
    ({"names": ("a", "a")}, "two different names"),
    ({"names": "ab"}, "a list of strings"),
    ({"accuracy": 0.1}, "an Accuracy"),
    ({"solver": "best"}, "one of auto"),
]


@pytest.mark.parametrize(("change", "words"), BAD, ids=[next(iter(change)) for change, _ in BAD])
def test_bad_input_is_one_sentence(change: dict[str, Any], words: str) -> None:
    given = {"first": STICKY, "second": LOSSY, "scope": SCOPE, "setpoints": [0.5, 0.6], **change}
    with pytest.raises(pm.InputError, match=re.escape(words)):
        pm.contrast(**given)


def parts(figure: Any, name: str) -> list[Any]:
    """The artists of a figure with this mark."""
    return [artist for axes in figure.axes for artist in axes.get_children() if artist.get_gid() == name]


def test_the_map_is_drawn_with_its_jumps_regimes_and_star(tmp_path: Path, jumping: xr.Dataset) -> None:
    figure = plot(jumping, tmp_path / "map.png")
    assert (tmp_path / "map.png").stat().st_size > 10_000
    assert len(parts(figure, "bistable")) == 1 and len(parts(figure, "best")) == 1
    drawn = np.concatenate([line for lines in parts(figure, "jump") for line in lines.get_segments()])
    assert np.isin(jumping.jump_setpoint, drawn[:, 0]).all()
    said = [text.get_text() for text in parts(figure, "regime")]
    assert said == ["matrix repulsive\nparticle attractive", "both repulsive"]
    said = " ".join(text.get_text().strip() for text in figure.texts)
    assert jumping.attrs["recommendation"] in said and jumping.attrs["recommendation_rule"] in said


def test_the_inversion_is_drawn_as_one_line() -> None:
    found = pm.contrast(STICKY, LOSSY, SCOPE, np.linspace(0.7, 0.85, 4), np.linspace(26e-9, 34e-9, 3))
    lines = [line for lines in parts(plot(found), "inversion") for line in lines.get_segments()]
    assert [len(line) for line in lines] == [found.sizes["inversion"]]
    assert (np.diff(lines[0], axis=0) > 0).all() or (np.diff(lines[0], axis=0) < 0).all()


def test_a_line_is_drawn_with_phases_regimes_and_contrast(crossing: xr.Dataset, jumping: xr.Dataset) -> None:
    figure = plot(crossing)
    assert [axes.get_ylabel() for axes in figure.axes] == ["phase (degrees)", "", "contrast (degrees)"]
    assert all(mark.get_xdata() == crossing.inversion_setpoint for mark in parts(figure, "inversion"))
    broken = pm.contrast(MATRIX, PARTICLE, SCOPE, SETPOINTS, 24e-9)
    (line,) = parts(plot(broken), "contrast")
    assert np.isnan(line.get_ydata()).sum() == broken.sizes["jump"] == 1


def test_points_without_an_orbit_are_drawn_and_explained() -> None:
    found = pm.contrast(STICKY, LOSSY, SCOPE, [0.4, 0.5, 0.9], 15e-9, 298.5e3)
    figure = plot(found)
    assert parts(figure, "failed")[0].get_xdata().tolist() == [0.4, 0.5]
    assert any("No stable orbit has the setpoint amplitude" in text.get_text() for text in figure.texts)


def test_the_recommended_frequency_has_a_panel_and_what_a_map_does_not_take_is_refused() -> None:
    cube = pm.contrast(STICKY, LOSSY, SCOPE, [0.7, 0.8], [25e-9, 30e-9], np.linspace(299.6e3, 300.4e3, 9))
    for best in cube.frequency.values:
        figure = plot(cube.assign_attrs(best_frequency=best))
        assert sum(line.get_gid() == "best" for axes in figure.axes for line in axes.lines) == 1
    with pytest.raises(pm.InputError, match="ax is given; allowed: nothing where a contrast is drawn"):
        plot(cube, ax=figure.axes[0])


def test_a_panel_is_drawn_for_each_of_a_few_frequencies() -> None:
    found = pm.contrast(STICKY, LOSSY, SCOPE, [0.7, 0.8], [26e-9, 34e-9], np.linspace(299e3, 301e3, 6))
    assert len(plot(found).axes) == 4 + 1  # and the colour bar
    assert plot(found.isel(free_amplitude=0)).axes[0].get_ylabel() == "drive frequency (kHz)"


def test_something_else_is_refused() -> None:
    with pytest.raises(pm.InputError, match=r"what phasemap\.contrast returned"):
        pm.plot.contrast(xr.Dataset())


def test_the_command_maps_what_python_maps(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output, picture = tmp_path / "map.nc", tmp_path / "map.png"
    line = ["contrast", str(SAMPLES / "blend.toml"), "--materials", "ps,ldpe", "--setpoints", "0.6:0.8:3"]
    line += ["--free-amplitudes", "20e-9:40e-9:2", "-o", str(output), "--plot", str(picture), "tip.radius=8e-9"]
    assert main(line) == 0
    said = capsys.readouterr().out
    setup = load_setup(SAMPLES / "blend.toml", ["tip.radius=8e-9"])
    python = pm.contrast(
        setup.materials["ps"], setup.materials["ldpe"], setup.microscope, [0.6, 0.7, 0.8], [20e-9, 40e-9],
        names=("ps", "ldpe"),
    )  # fmt: skip
    assert load(output).equals(python)
    assert picture.exists()
    assert "mapped      2 free amplitudes x 3 setpoints" in said.splitlines()
    assert f"reason      {python.attrs['reason']}" in said.splitlines()
    assert f"recommended {python.attrs['recommendation']}" in said.splitlines()
    assert main(["plot", str(output), "-o", str(tmp_path / "again.svg")]) == 0


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--materials", "ps"], "--materials is 'ps'; allowed: two different names"),
        (["--materials", "ps,pvc"], "--materials is 'pvc'; allowed: one of ps, ldpe"),
        (["--setpoints", "0.3:0.9"], "--setpoints is '0.3:0.9'; allowed: START:STOP:N"),
        (["--free-amplitudes", "1e-8:2e-8:1"], "allowed: START:STOP:N with N of at least 2"),
        (["--frequencies", "nan"], "--frequencies is 'nan'"),
        (["--plot", "map.xyz"], "the picture's suffix"),
    ],
)
def test_the_command_complains_in_one_sentence(
    words: list[str], complaint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["contrast", str(SAMPLES / "blend.toml"), *words]) == 2
    said = capsys.readouterr()
    assert complaint in said.err and said.err.count("\n") == 1 and said.out == ""


def test_two_drives_that_beat_are_not_irregular_for_it() -> None:
    lever = pm.Cantilever(40.0, 300e3, 50.0, modes=(pm.Eigenmode(6.267, quality_factor=80.0),))
    scope = pm.Microscope(lever, pm.Tip(10e-9), pm.Drive(40e-9, second=pm.Mode(1e-9)))
    found = pm.contrast(pm.Material(0.5e9, 0.05), pm.Material(3e9, 0.05), scope, [0.7, 0.8], 40e-9, solver="march")
    assert (found.phase_spread > 0).all() and (found.motion == 0).all()
    assert "not safe" not in found.attrs["recommendation"]
