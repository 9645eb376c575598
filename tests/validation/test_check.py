"""`phasemap check`: true images hold, and whatever is changed in one is found."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import phasemap as pm
from phasemap._kernels import columns as col
from phasemap.cli import main
from phasemap.experiment.described import describe
from phasemap.experiment.interaction import ContactLaw, FlatPunch, MaugisDugdale, Neck
from phasemap.experiment.realism import Realism, TipChange
from phasemap.io.netcdf import save
from phasemap.scenes.scene import load_scene, scene_from_json
from phasemap.solvers.solver import FromFar, Orbit
from phasemap.validation.again import carried, kinds, sample
from phasemap.validation.claims import claims_of, microscope_from
from phasemap.validation.picture import FAILS, OPEN, Picture

SAMPLES = Path(__file__).parents[2] / "samples"
STEP = str(SAMPLES / "step.toml")
SMALL = "surface.shape=[6, 8]"

# The materials of test_raster: the first has an attractive orbit only, the second a repulsive one, the third both.
SCOPE = pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(16e-9))
SETPOINT = 0.8
MATERIALS = {
    0: pm.Material(1e9, adhesion=0.1, damping=0.05),
    1: pm.Material(2e9, adhesion=0.02),
    2: pm.Material(2e9, adhesion=0.1),
}
LABELS = np.array([[0, 1, 2, 2, 0, 2, 1, 2], [2, 2, 0, 1, 1, 2, 0, 0], [1, 2, 1, 0, 2, 2, 2, 1]])
RELIEF = 1e-9 * np.arange(24.0).reshape(3, 8)
SURFACE = pm.Surface.from_labels(LABELS, MATERIALS, pixel_size=2e-9, topography=RELIEF)

Change = Callable[[xr.Dataset], Any]


def image_of(solver: str = "auto", control: Any = None, realism: Any = None) -> xr.Dataset:
    return pm.simulate(SURFACE, SCOPE, SETPOINT, solver, control, realism=realism)


def failures(image: xr.Dataset, surface: pm.Surface = SURFACE, **options: Any) -> list[str]:
    return [claim.about for claim in pm.check(image, surface, **options).claims if claim.result == FAILS]


@pytest.mark.parametrize("control", [pm.Engage(), pm.Raster(), pm.Raster("image")], ids=str)
@pytest.mark.parametrize("solver", ["auto", "averaging", "orbit", "march"])
def test_a_true_image_holds(solver: str, control: Any) -> None:
    found = pm.check(image_of(solver, control), SURFACE)
    assert found.holds, str(found)
    left = [claim.about for claim in found.claims if claim.result == OPEN]
    assert len(left) == (6 if solver == "averaging" else 0)  # it states no errors of phase, height and what follows


def test_y_may_rise_in_an_earlier_image_only() -> None:
    image = image_of()
    rising = image.assign_coords(y=image["y"].values[::-1])
    assert failures(rising) == [LAYOUT]
    rising["y"].attrs["long_name"] = "position from the top of the image"
    assert pm.check(rising, SURFACE).holds


def test_what_a_real_microscope_adds_is_allowed_for() -> None:
    realism = Realism(
        line_offset=1e-9, phase_offset=2.0, bits=12, drift=(5e-9, 0.0, 1e-9), tip_change=TipChange(1, 2e-8), seed=3
    )
    for control in (pm.Engage(), pm.Raster("image")):
        image = image_of(control=control, realism=realism)
        found = pm.check(image, SURFACE)
        assert found.holds, str(found)
        image["phase"][..., 2, 1] += 2 * float(image["phase"].attrs["quantisation_step"])
        assert any("phase" in about for about in failures(image))


@pytest.mark.parametrize("control", [pm.Engage(), pm.Feedback(line_rate=200.0)], ids=str)
def test_channels_are_those_of_what_was_recorded(control: Any) -> None:
    realism, names = Realism(phase_offset=2.0, bits=10, seed=4), ("phase", "amplitude", "loss_tangent", "dissipation")
    image = pm.simulate(SURFACE, SCOPE, SETPOINT, control=control, realism=realism, variables=names)
    assert pm.check(image, SURFACE, pixels=2).holds
    assert pm.check(image.drop_vars("amplitude"), SURFACE, pixels=2).holds  # of the amplitude, that is not there
    for name in ("loss_tangent", "dissipation"):
        altered = image.copy(deep=True)
        altered[name][..., 1, 2] *= 1.001
        assert REPEATED in failures(altered, pixels=2)


def test_every_image_has_its_channels_of_trust_or_says_why_not() -> None:
    for solver in ("auto", "averaging", "orbit", "march"):
        for control in (pm.Engage(), pm.Raster()):
            image = image_of(solver, control)
            good = image.status.values == 0
            # Averaging closes the energy of its first harmonic, as far as its iteration goes.
            assert good.all() and np.abs(image.energy_closure.values).max() < 1e-6
            for name in ("error_phase", "error_height"):
                assert np.isfinite(image[name].values).all() == (solver != "averaging")
                assert "averaging" in image[name].attrs["description"]
    scan = image_of(control=pm.Feedback(line_rate=20.0))
    assert scan.attrs["estimated_error"].startswith("none: ") and scan.attrs["energy_balance"].startswith("none: ")


def test_interpolated_pixels_close_their_energy() -> None:
    random = np.random.default_rng(1)
    surface = pm.Surface(
        random.uniform(1e9, 3e9, (96, 96)), 0.05, random.uniform(0.005, 0.02, (96, 96)), pixel_size=1e-9
    )
    image = pm.simulate(surface, SCOPE, 0.7)
    interpolated = image.solver.values == 3
    assert interpolated.mean() > 0.9
    # The energies are asked for what the phase's accuracy of 0.01 degree does to them; harmonics take less in air.
    assert np.abs(image.energy_closure.values).max() < 2 * np.radians(0.01)
    found = pm.check(image, surface, pixels=6)
    assert found.holds, str(found)
    # What is altered by less than an interpolant's errors is found by interpolating again.
    for name, factor in (("dissipation", 1.0001), ("virial", 1.001), ("error_phase", 1e-3)):
        altered = image.assign({name: image[name].copy(data=factor * image[name].values)})
        assert REPEATED in failures(altered, surface, pixels=6)


def flip_status(image: xr.Dataset) -> None:
    image["status"][1, 3] = 1


def lose(image: xr.Dataset) -> None:
    """A pixel without a solution, as it would look."""
    for name in image.data_vars:
        image[name][1, 3] = {"status": 1, "branch": -1, "motion": -1}.get(str(name), 2 if name == "solver" else np.nan)


def other_branch(image: xr.Dataset) -> None:
    """On a pixel that has two orbits, the one to which engaging does not lead: consistent in itself."""
    other = pm.simulate(SURFACE, SCOPE, SETPOINT, control=pm.Raster()).sel(direction="trace")
    for y, x in np.argwhere(LABELS == 2):
        for name in image.data_vars:
            if name != "height":
                image[name][y, x] = other[name].values[0, 2]
        image["height"][y, x] = image["tip_offset"][y, x] - image["amplitude"][y, x] + RELIEF[y, x]


def tamper(name: str, change: float, factor: float = 1.0) -> Change:
    def do(image: xr.Dataset) -> None:
        image[name][1, 3] = factor * image[name][1, 3] + change

    return do


def attribute(*path: str, value: Any) -> Change:
    def do(image: xr.Dataset) -> None:
        stored = json.loads(image.attrs["configuration"])
        inside = stored
        for name in path[:-1]:
            inside = inside[name]
        inside[path[-1]] = value
        image.attrs["configuration"] = json.dumps(stored)

    return do


LAYOUT = "dims, coordinates, units, flags are as agreed"
ONE = "pixels of one material show the same"
REPEATED = "solved again by the same solver: the same"
PHASE = "solved again: phase within estimated error"
HEIGHT = "solved again: height within estimated error"
MOTION = "solved again: the same motion"
UNDECIDED = "solved again: what no other solver decides"


@pytest.mark.parametrize(
    ("change", "about"),
    [
        (tamper("phase", 1.0), REPEATED),
        (tamper("phase", -0.02), REPEATED),
        (tamper("phase", 1e-6), ONE),
        (tamper("height", 1e-12), "height is topography + tip offset - amplitude"),
        (tamper("tip_offset", 1e-12), "height is topography + tip offset - amplitude"),
        (tamper("amplitude", 1e-12), REPEATED),
        (tamper("dissipation", 1e-21), REPEATED),
        (tamper("virial", 0.0, 1.01), REPEATED),
        (tamper("branch", 1, -1), REPEATED),
        (tamper("error_phase", 1.0), REPEATED),
        (tamper("energy_closure", 1e-3), REPEATED),
        (flip_status, "numbers where solved, none elsewhere"),
        (lose, "solved again: solutions where the status says"),
        (other_branch, "solved again: the same branch"),
        (attribute("setpoint", value=0.79), REPEATED),
        (attribute("accuracy", "phase", value=1e-7), REPEATED),
        (attribute("microscope", "cantilever", "quality_factor", value=390.0), REPEATED),
        (attribute("microscope", "tip", "radius", value=11e-9), PHASE),
        (attribute("pixel_size", value=[1e-9, 2e-9]), LAYOUT),
        (lambda image: image["phase"].attrs.update(units="rad"), LAYOUT),
        (lambda image: image["status"].attrs.update(flag_meanings="bad"), LAYOUT),
    ],
)  # fmt: skip
def test_what_was_changed_is_found(change: Change, about: str) -> None:
    image = image_of()
    change(image)
    assert about in failures(image, seed=1)


def test_an_estimated_error_that_promises_too_much_is_found() -> None:
    image = pm.simulate(SURFACE, SCOPE, SETPOINT, accuracy=pm.Accuracy(1.0, 1e-9))
    averaged = image.solver.values == 0
    assert averaged.any() and pm.check(image, SURFACE).holds
    image["error_phase"] = image["error_phase"].where(~averaged, 1e-7)
    assert failures(image) == [REPEATED, PHASE]


def test_the_pixel_that_was_changed_is_named() -> None:
    image = image_of()
    image["phase"][1, 3] += 1.0
    (claim,) = [claim for claim in pm.check(image, SURFACE).claims if claim.about == PHASE]
    assert claim.worst == ((0, 1, 3),) and claim.found == "in 1 pixel, at worst at row 1, column 3"
    assert "row 1, column 3" in str(pm.check(image, SURFACE))


def test_a_material_that_is_not_the_images_is_found_by_the_second_solver() -> None:
    """All that a file holds fits together, whatever the surface: only solving it again can tell."""
    stiffer = {**MATERIALS, 1: pm.Material(3e9, adhesion=0.02)}
    surface = pm.Surface.from_labels(LABELS, stiffer, pixel_size=2e-9, topography=RELIEF)
    found = failures(image_of(), surface)
    assert HEIGHT in found and all(about.startswith("solved again") for about in found)


def test_the_branch_on_which_a_raster_comes_is_that_of_the_pixel_before() -> None:
    image = image_of(control=pm.Raster("image"))
    picture = Picture(image, claims_of(image))
    branch, comes = image.branch.values, carried(picture)[0]
    assert (comes[0, :, 1:] == branch[0, :, :-1]).all() and (comes[1, :, :-1] == branch[1, :, 1:]).all()
    assert (comes[1, :, -1] == branch[0, :, -1]).all() and (comes[0, 1:, 0] == branch[1, :-1, 0]).all()
    assert comes[0, 0, 0] == -1
    # Where the tip comes repulsive and can stay, an attractive orbit is wrong although the material has it.
    y, x = np.argwhere((LABELS == 2) & (branch[0] == 1))[0]
    engaged = image_of().isel(y=y, x=x)
    for name in image.data_vars:
        image[name][0, y, x] = engaged[name]
    assert failures(image) == [REPEATED, "solved again: the same branch"]


@pytest.mark.parametrize("engage", ["line", "image"])
def test_a_scan_in_time_is_scanned_again_line_by_line(engage: str) -> None:
    control = pm.Feedback(line_rate=200.0, engage=engage)
    image = image_of(control=control)
    found = pm.check(image, SURFACE)
    assert found.holds and found.judged == "Every line was scanned again as it was made.", str(found)
    for line in range(3):
        altered = image.copy(deep=True)
        altered["phase"][0, line, 3] += 0.002
        assert failures(altered, SURFACE) == [REPEATED]
    noisy = image_of(control=control, realism=Realism(temperature=300.0, line_offset=1e-10, bits=12, seed=2))
    assert pm.check(noisy, SURFACE).holds


def test_an_image_by_another_version_may_differ_by_its_errors_and_is_decided_in_time_beyond() -> None:
    image = image_of().assign_attrs(phasemap_version="0.0.1")
    image["phase"] += image["error_phase"]
    found = {claim.about: claim for claim in pm.check(image, SURFACE).claims}
    assert {claim.result for claim in found.values()} == {"holds"}
    image["phase"][1, 3] += 1e-3
    found = {claim.about: claim for claim in pm.check(image, SURFACE, pixels=1, seed=1).claims}
    assert found[REPEATED].result == OPEN and found[PHASE].worst == ((0, 1, 3),)
    assert re.fullmatch(
        r"made by phasemap 0\.0\.1, and this is .*: .*phase.* in 1 pixel, at worst at row 1, column 3",
        found[REPEATED].found,
    )


def test_pixels_without_a_material_or_a_solution_are_no_failure() -> None:
    modulus = np.array([[1e9, np.nan, 2e9]])
    surface = pm.Surface(modulus, adhesion=0.1, damping=0.05, pixel_size=2e-9, allow_nan=True)
    image = pm.simulate(surface, SCOPE, SETPOINT)
    assert image.status.values.tolist() == [[0, 5, 0]]
    assert pm.check(image, surface).holds
    image["status"][0, 1] = 0
    assert "numbers where solved, none elsewhere" in failures(image, surface)


def test_the_sample_has_some_of_every_kind_and_depends_on_the_seed_only() -> None:
    image = image_of()
    image["status"][2, 7] = 1
    picture = Picture(image, claims_of(image))
    chosen = sample(picture, 12, seed=4)
    assert len(set(chosen.tolist())) == 12 and set(kinds(picture)[chosen]) == set(kinds(picture))
    assert sample(picture, 12, seed=4).tolist() == chosen.tolist() != sample(picture, 12, seed=5).tolist()
    assert sample(picture, 1000, seed=0).tolist() == list(range(24))


def test_what_comes_to_no_rest_on_the_way_from_far_is_not_judged(monkeypatch: pytest.MonkeyPatch) -> None:
    """The image's orbit is no place to begin at: that a tip stays there says nothing of how it came there."""
    image = image_of()

    def solve(_: FromFar, _work: Any, _accuracy: Any, answers: Any) -> None:
        answers.rows[:], answers.status[:] = np.nan, col.NOT_SETTLED

    monkeypatch.setattr(FromFar, "solve", solve)
    found = pm.check(image, SURFACE)
    by_another = [claim for claim in found.claims if claim.about.startswith("solved again:")]
    assert len(by_another) == 10 and {claim.result for claim in by_another} == {OPEN}
    (left,) = [claim for claim in by_another if claim.about == UNDECIDED]
    assert left.pixels == 24 and found.verdict.endswith("10 could not be judged.")


@pytest.mark.parametrize(
    ("phase", "height", "spread", "failed"),
    [
        (0.05, 10e-12, 0.2, []),
        (0.11, 0.0, 0.02, [PHASE]),
        (0.15, 0.0, 0.2, []),  # of a spread of 0.2 degree the mean is known to 0.06, and 0.1 is allowed anyway
        (0.0, 25e-12, 0.2, [HEIGHT]),
        (0.0, 0.0, 0.0, [MOTION]),
    ],
)
def test_of_irregular_motion_the_means_are_compared(
    phase: float, height: float, spread: float, failed: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """By a solver that finds means that are off by so much, and this spread of the phase [degree]."""

    def solve(_: FromFar, work: Any, accuracy: Any, answers: Any) -> None:
        Orbit().solve(work, accuracy, answers)
        out = answers.rows
        out[:, col.PHASE] += np.radians(phase)
        out[:, col.TIP_OFFSET] += height
        out[:, col.SPREAD_PHASE] = np.radians(spread)
        out[:, col.SPREAD_AMPLITUDE] = 1e-12 if spread else 0.0

    monkeypatch.setattr(FromFar, "solve", solve)
    image = image_of()
    image["motion"][...], image["amplitude_spread"][...] = 1, 1e-12
    image["phase_spread"][...] = spread or 0.3
    assert [about for about in failures(image) if about.startswith("solved again:")] == failed


@pytest.mark.parametrize("contact", ["dmt", "jkr", "punch", FlatPunch(5e-9), MaugisDugdale(2e-10), Neck(1e-9)], ids=str)
def test_a_microscope_comes_back_from_its_description(contact: Any) -> None:
    scope = pm.Microscope(
        pm.Cantilever(2.0, 7e4, 120.0), pm.Tip(2e-8, modulus=1.3e11), pm.Drive(3e-8, 7.1e4),
        pm.Interaction(contact, decay_length=None, damping_exponent=1.5, bias=0.3),
    )  # fmt: skip
    assert microscope_from(json.loads(json.dumps(describe(scope)))) == scope


class Own(ContactLaw):
    @staticmethod
    def force(d: float, p: Any) -> float:
        return float(p[0]) * d


class Hertz(Own):
    """A law that is called as one of phasemap's."""


@dataclass(frozen=True)
class Cone(Own):
    """One with parameters that is."""

    half_angle: float = 35.0


@pytest.mark.parametrize("law", [Own(), Hertz(), Cone()], ids=lambda law: type(law).__name__)
def test_a_law_of_ones_own_is_asked_for(law: ContactLaw) -> None:
    image = image_of()
    scope = pm.Microscope(SCOPE.cantilever, SCOPE.tip, SCOPE.drive, pm.Interaction(law))
    attribute("microscope", value=describe(scope))(image)
    name = rf"{__name__}.{type(law).__name__}"
    with pytest.raises(pm.InputError, match=rf"contact law of the image is '{name}'.*give the microscope too"):
        pm.check(image, SURFACE)
    with pytest.raises(pm.InputError, match="the microscope of the image's configuration"):
        pm.check(image, SURFACE, SCOPE)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("setpoint",), "0.7 nm"), (("setpoint",), 2.0), (("solver",), "magic"), (("solver",), ["orbit"]),
        (("shape",), "big"), (("shape",), [0, 3]), (("pixel_size",), None), (("control",), None),
        (("control",), {"kind": "accuracy", "phase": 1.0}), (("control", "kind"), "os.system"),
        (("control", "kind"), ["engage"]), (("accuracy", "phase"), "x"), (("accuracy", "more"), 1),
        (("realism", "tip_change"), {"kind": "tipchange"}), (("microscope", "tip"), 3.0),
        (("microscope", "cantilever", "stiffness"), None),
    ],
)  # fmt: skip
def test_a_configuration_that_cannot_be_is_refused(path: tuple[str, ...], value: Any) -> None:
    image = image_of()
    attribute(*path, value=value)(image)
    with pytest.raises(pm.InputError):
        pm.check(image, SURFACE)


def test_a_scene_comes_back_from_the_image() -> None:
    changes = [SMALL, "realism.tip_change={line=2,radius=2e-8}", "control.kind=raster", "tip.modulus=1e11"]
    scene = load_scene(STEP, changes)
    again = scene_from_json(scene.to_json(), SAMPLES)
    assert again.config == scene.config and again.surface == scene.surface and again.options == scene.options


def written(folder: Path, *changes: str) -> Path:
    path = folder / "image.nc"
    assert main(["run", STEP, SMALL, *changes, "-o", str(path), "--quiet"]) == 0
    return path


def rewrite(path: Path, change: Change) -> None:
    with xr.open_dataset(path) as ds:
        image = ds.load()
    change(image)
    save(image, path, overwrite=True)


def test_the_command_says_what_holds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path)
    assert main(["check", str(path), "--pixels", "8", "--seed", "2"]) == 0
    said = capsys.readouterr().out
    assert "8 x 6 pixels, 16 x 12 nm" in said and "tip lowered onto each pixel" in said
    assert said.splitlines()[-1] == "verdict  15 claims hold, none fails."
    assert main(["check", str(path), "--scene", STEP]) == 2  # that has other pixels
    assert "allowed: (6, 8) pixels of (2e-09, 2e-09) m, as in the image" in capsys.readouterr().err
    load_scene(STEP, [SMALL]).surface.to_dataset().to_netcdf(tmp_path / "surface.nc")
    assert main(["check", str(path), "--surface", str(tmp_path / "surface.nc"), "--quiet"]) == 0
    assert capsys.readouterr().out == "14 claims hold, none fails.\n"


@pytest.mark.parametrize(
    "change",
    [
        tamper("phase", 1.0),
        flip_status,
        attribute("setpoint", value=0.71),
        lambda image: image.attrs.update(scene=image.attrs["scene"].replace('"setpoint": 0.7', '"setpoint": 0.71')),
        lambda image: image.attrs.update(scene=image.attrs["scene"].replace('"radius": 1e-08', '"radius": 2e-08')),
    ],
    ids=["phase", "status", "setpoint", "setpoint of the scene", "radius of the scene"],
)
def test_the_command_fails_a_file_that_was_changed(
    change: Change, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path)
    rewrite(path, change)
    assert main(["check", str(path)]) == 1
    assert "Do not trust this file." in capsys.readouterr().out.splitlines()[-1]


@pytest.mark.parametrize("left", [0.5, 0.98])
def test_a_truncated_file_is_said_to_be_damaged(
    left: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(left * len(whole))])
    assert main(["check", str(path)]) == 2
    assert "damaged or cut short" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda image: image.attrs.pop("scene"), "does not carry the scene that it was made of"),
        (lambda image: image.attrs.pop("configuration"), "Is it an image that phasemap simulated?"),
        (lambda image: image.attrs.update(scene="no JSON"), "scene is 'no JSON'"),
    ],
)
def test_what_cannot_be_checked_is_said_in_one_sentence(
    change: Change, sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path)
    rewrite(path, change)
    assert main(["check", str(path)]) == 2
    said = capsys.readouterr()
    assert sentence in said.err and said.err.count("\n") == 1 and "Traceback" not in said.err


def test_files_of_the_scene_are_found_beside_the_image_and_have_to_be_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "scene.toml"
    text = Path(STEP).read_text()
    start, end = text.index("[surface]"), text.index("[materials.")
    surface = (
        '[surface]\nkind = "labels"\nlabels = "labels.npy"\nmaterials = ["compliant", "stiff"]\npixel_size = 2e-9\n'
    )
    scene.write_text(text[:start] + surface + text[end:])
    np.save(tmp_path / "labels.npy", LABELS % 2)
    path = tmp_path / "image.nc"
    assert main(["run", str(scene), "-o", str(path), "--quiet"]) == 0
    assert main(["check", str(path), "--quiet"]) == 0
    np.save(tmp_path / "labels.npy", 1 - LABELS % 2)
    assert main(["check", str(path)]) == 2
    assert "cannot use labels.npy: it is not the file that was read then" in capsys.readouterr().err
    (tmp_path / "labels.npy").unlink()
    assert main(["check", str(path)]) == 2
    assert "give --scene SCENE.toml or --surface SURFACE.nc" in capsys.readouterr().err
