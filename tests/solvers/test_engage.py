"""Which orbit the controller finds, against brute-force engagement in time (tests/reference/make_engaged.py)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import Case, label, load, material_of, scope_of

import phasemap as pm
from phasemap._kernels import columns as col
from phasemap._kernels.continuation.piece import PIECE_AT_JUMP, PIECE_FULL, PIECE_STUCK
from phasemap._kernels.orbits.collocation.path import fixed_path
from phasemap.solvers.continuation.curves import Curves
from phasemap.solvers.continuation.whole_curves import curves_to_amplitude
from phasemap.solvers.problem import make_work, work_of_material
from phasemap.solvers.run import run
from phasemap.solvers.solver import Orbit

CASES = load("engaged")
HELD = [case for case in CASES if case["engaged"]["branch"] != "none"]
IN_AIR = [case for case in HELD if case["quality_factor"] >= 10]


@pytest.mark.parametrize("case", HELD, ids=label)
def test_the_tip_ends_on_the_orbit_that_engaging_in_time_ends_on(case: Case) -> None:
    # The reference is a fixed-step integration that settled to about 1 pm and 1e-3 degree; orbits that could be mixed
    # up are tens of picometres and degrees apart.
    pixel = pm.solve_pixel(material_of(case), scope_of(case), case["setpoint"], solver="orbit")
    assert pixel.branch == case["engaged"]["branch"]
    assert abs(pixel.tip_offset - case["engaged"]["tip_offset"]) < 2e-12
    assert abs(pixel.phase - case["engaged"]["phase"]) < 0.01


@pytest.mark.parametrize("case", [case for case in CASES if case not in HELD], ids=label)
def test_where_the_orbit_is_period_doubled_its_mean_is_held(case: Case) -> None:
    pixel = pm.solve_pixel(material_of(case), scope_of(case), case["setpoint"], solver="orbit")
    assert (pixel.status, pixel.motion, pixel.solver) == (pm.Status.good, "irregular", "march")
    assert pixel.amplitude == pytest.approx(case["setpoint"] * scope_of(case).driven_amplitude)
    assert pixel.amplitude_spread > 0


@pytest.mark.parametrize("case", IN_AIR, ids=label)
@pytest.mark.parametrize("solver", ["auto", "averaging", "orbit"])
def test_the_branch_does_not_depend_on_the_solver(case: Case, solver: str) -> None:
    pixel = pm.solve_pixel(material_of(case), scope_of(case), case["setpoint"], solver=solver)
    assert pixel.branch == case["engaged"]["branch"]


def test_the_branch_does_not_depend_on_the_neighbours() -> None:
    # Bistable at this setpoint: one alone, and in a map between pixels of other branches.
    scope = pm.Microscope(pm.Cantilever(40.0, 300e3, 250.0), pm.Tip(30e-9), pm.Drive(40e-9))
    surface = pm.Surface([[1e8, 1e9, 5e9, 1e9, 1e11]], [[0.3, 0.1, 0.0, 0.1, 0.5]], pixel_size=1e-9)
    image = pm.simulate(surface, scope, 0.93, solver="orbit")
    alone = pm.solve_pixel(pm.Material(1e9, adhesion=0.1), scope, 0.93, solver="orbit")
    assert image.phase.values[0, 1] == image.phase.values[0, 3]
    # Alone, the whole curve of orbits is followed, in an image it is not: the same orbit within the error of both.
    assert image.phase.values[0, 1] == pytest.approx(alone.phase, rel=0, abs=1e-8)


def test_a_stiff_contact_does_not_hide_the_end_of_the_attractive_branch() -> None:
    # Attraction is strongest where the tip just touches, and there the harmonics lift it by more than it is deep.
    # The whole curve of orbits has the fold at the setpoint for an adhesion of 0.3639 J/m2.
    lever, force = pm.Cantilever(4.963, 300e3, 124.9), pm.Interaction(decay_length=0.41108193306171294e-9)
    scope = pm.Microscope(lever, pm.Tip(4.017316079757532e-9), pm.Drive(38.791419473090755e-9), force)
    adhesion, setpoint = [0.3625, 0.3635, 0.3645, 0.366], 0.8402537862532591
    surface = pm.Surface([[25.440059183834373e9] * 4], [adhesion], 3.4156813678141925e-4, pixel_size=1e-9)
    image = pm.simulate(surface, scope, setpoint, solver="orbit")
    materials = [pm.Material(25.440059183834373e9, w, 3.4156813678141925e-4) for w in adhesion]
    alone = [pm.solve_pixel(one, scope, setpoint) for one in materials]
    assert image.branch.values[0].tolist() == [1, 1, 0, 0] == [pixel.branch == "repulsive" for pixel in alone]


@pytest.mark.parametrize(("stiffness", "quality_factor", "free_amplitude"), [(0.1, 2.0, 14e-9), (0.06, 4.0, 25e-9)])
def test_a_very_soft_lever_in_liquid_is_on_the_orbit_to_which_the_curve_from_far_leads(
    stiffness: float, quality_factor: float, free_amplitude: float
) -> None:
    # Adhesion bends these levers by up to their amplitude. In an image the averaged attraction decides, alone the whole
    # curve of exact orbits: the same orbit within the errors of both.
    scope = pm.Microscope(pm.Cantilever(stiffness, 10e3, quality_factor), pm.Tip(10e-9), pm.Drive(free_amplitude))
    modulus, adhesion, damping = np.meshgrid([3e7, 3e8, 3e9], [0.0, 0.004, 0.016], [0.0, 0.003, 0.1])
    materials = np.column_stack([one.ravel() for one in (modulus, adhesion, damping)])
    surface = pm.Surface(*(one.reshape(3, 9) for one in (modulus, adhesion, damping)), pixel_size=1e-9)
    image = pm.simulate(surface, scope, 0.7, solver="orbit")
    alone = [pm.solve_pixel(pm.Material(e, adhesion=w, damping=a), scope, 0.7) for e, w, a in materials]
    assert [pixel.branch for pixel in alone] == ["repulsive"] * 27 and (image.branch == 1).all()
    for name in ("tip_offset", "phase"):
        off = abs(image[name].values.ravel() - [getattr(pixel, name) for pixel in alone])
        error = "error_height" if name == "tip_offset" else "error_phase"
        assert np.all(off < image[error].values.ravel() + [getattr(pixel, error) for pixel in alone])


PINCHED = pm.Material(2e9, adhesion=0.1, damping=0.005)


def pinched(free_amplitude: float) -> pm.Microscope:
    return pm.Microscope(pm.Cantilever(40.0, 300e3, 400.0), pm.Tip(10e-9), pm.Drive(free_amplitude))


@pytest.mark.parametrize("setpoint", [0.6, 0.57, 0.56, 0.555, 0.5, 0.4])
def test_the_tip_passes_where_the_attractive_branch_is_almost_cut_off(setpoint: float) -> None:
    # At a free amplitude of 15 nm the stable and the unstable attractive orbits come within 0.08 nm of each other near
    # setpoint 0.577. Engaged in time in steps of 10 pm the tip stays attractive down to 0.385; at 15.1 nm the branch is
    # cut, and the tip jumps.
    pixel = pm.solve_pixel(PINCHED, pinched(15.0e-9), setpoint, solver="orbit")
    assert pixel.branch == "attractive"
    assert pm.solve_pixel(PINCHED, pinched(15.0e-9), setpoint, solver="averaging").branch in ("attractive", "none")
    assert pm.solve_pixel(PINCHED, pinched(15.1e-9), setpoint, solver="orbit").branch == "repulsive"


@pytest.mark.parametrize("free_amplitude", [14.0e-9, 14.5e-9, 15.0e-9, 15.1e-9, 15.5e-9])
@pytest.mark.parametrize("setpoint", [0.85, 0.7, 0.6, 0.57, 0.555, 0.5, 0.45])
def test_orbits_come_and_go_in_pairs(free_amplitude: float, setpoint: float) -> None:
    found = pm.orbits(PINCHED, pinched(free_amplitude), setpoint=setpoint)
    assert found.attrs["complete"] == 1
    assert found.sizes["orbit"] % 2 == 1


@pytest.mark.parametrize("damping", [0.0, 0.5])
def test_a_curve_goes_on_where_the_tip_stays_in_its_neck(damping: float) -> None:
    # From contact all the time over a neck that lasts while the tip is above the surface, up to where it breaks.
    lever = pm.Cantilever(40.0, 300e3, 2.0)
    scope = pm.Microscope(lever, pm.Tip(10e-9), pm.Drive(3e-9), pm.Interaction("jkr"))
    work = work_of_material(pm.Material(4.97e8, 0.179, damping=damping), scope, 2.7e-9)
    for piece in curves_to_amplitude(fixed_path(work.oscillator(0)), 2.7e-9).pieces:
        held = piece.rows[piece.rows[:, col.CONTACT_TIME] > 1 - 1e-9]
        outermost = held[:, col.INDENTATION] - 2 * held[:, col.AMPLITUDE]
        if (outermost > 0.5e-9).any() and (outermost < -0.5e-9).any():
            return
    pytest.fail("no piece has both")


def test_curves_that_get_stuck_or_lead_nowhere_are_not_complete(monkeypatch: pytest.MonkeyPatch) -> None:
    scope = pinched(15.0e-9)
    assert pm.orbits(PINCHED, scope, setpoint=0.6).attrs["complete"] == 1
    for ended, complete in ((PIECE_AT_JUMP, 1), (PIECE_STUCK, 0), (PIECE_FULL, 0)):
        with monkeypatch.context() as patched:
            patched.setattr(Curves, "follow_past_ends", lambda self, ended=ended: _end_last(self, ended))
            assert pm.orbits(PINCHED, scope, setpoint=0.6).attrs["complete"] == complete
    with monkeypatch.context() as patched:
        patched.setattr(Curves, "_follow", lambda *_: None)
        assert pm.orbits(PINCHED, scope, setpoint=0.6).attrs["complete"] == 0


def test_an_orbit_that_is_lost_on_the_way_is_not_one_that_is_not_there() -> None:
    curves = curves_to_amplitude(fixed_path(work_of_material(PINCHED, pinched(15e-9), 9e-9).oscillator(0)), 9e-9)
    assert curves.all_followed
    (most,) = [i for i, piece in enumerate(curves.pieces) if (piece.rows[:, col.KIND] == col.WANTED).sum() > 1]
    piece = curves.pieces[most]
    lost = np.flatnonzero(piece.rows[:, col.KIND] == col.WANTED)[1]
    curves.pieces[most] = replace(piece, rows=np.delete(piece.rows, lost, axis=0))
    assert not curves.all_followed


def _end_last(curves: Curves, ended: int) -> None:
    curves.pieces[-1] = replace(curves.pieces[-1], ended=ended)


@pytest.mark.parametrize(("modulus", "adhesion", "damping"), [(2e8, 0.041, 0.148), (2.5e7, 0.019, 0.02)])
def test_where_loss_takes_the_drive_before_the_sample_repels_there_is_no_other_orbit(
    modulus: float, adhesion: float, damping: float
) -> None:
    # Attraction and repulsion nearly cancel at the setpoint, and yet no curve has to be followed.
    lever, tip = pm.Cantilever(13.0, 300e3, 553.0), pm.Tip(12e-9)
    scope = pm.Microscope(lever, tip, pm.Drive(40.9e-9), pm.Interaction(decay_length=0.25e-9))
    surface = pm.Surface([[modulus]], [[adhesion]], [[damping]], pixel_size=1e-9)
    image = pm.simulate(surface, scope, 0.64, solver="orbit")
    held = pm.solve_pixel(pm.Material(modulus, adhesion, damping), scope, 0.64, solver="march")
    solvers = dict(zip(image.solver.flag_values, image.solver.flag_meanings.split(), strict=True))
    assert solvers[image.solver.values[0, 0]] == "corrected"
    assert pm.orbits(pm.Material(modulus, adhesion, damping), scope, 0.64).sizes["orbit"] == 1
    # A hundredth of a degree is what the march settles to; the largest error of either is 1e-3.
    assert image.phase.values[0, 0] == pytest.approx(held.phase, rel=0, abs=0.01)


def test_where_adhesion_alone_sets_in_a_slow_tip_stays_on_the_attractive_side() -> None:
    # Held by tests/reference/make_taps.py after approaches at 4e-3, 1e-3 and 2.5e-4; large steps of the tip offset jump
    # over the onset of adhesion to the repulsive orbit, 32 pm lower.
    lever, drive = pm.Cantilever(1.0983165616734807, 300e3, 113.787919199667), pm.Drive(1.7210497941389413e-08)
    scope = pm.Microscope(lever, pm.Tip(8.004470417838485e-09), drive, pm.Interaction("dmt", decay_length=None))
    stiff = pm.Material(62795603253.14876, 0.05991347444169698, 0.004237572949101453, poisson_ratio=0.35)
    pixel = pm.solve_pixel(stiff, scope, 0.8173451452501452)
    assert pixel.branch == "attractive" and pixel.motion == "periodic"
    assert pixel.phase == pytest.approx(-35.177452, abs=1e-4)
    assert pixel.tip_offset == pytest.approx(1.40280148e-08, abs=1e-13)


def test_past_a_fold_between_two_points_of_the_curve_the_tip_has_jumped_and_time_is_not_asked() -> None:
    # The attractive branch ends a thousandth above the setpoint, and no other orbit holds it.
    lever, tip = pm.Cantilever(40.27793379141272, 300e3, 365.16355468929675), pm.Tip(1.1870678259115717e-08)
    scope = pm.Microscope(lever, tip, pm.Drive(2.1826917843864463e-08), pm.Interaction("dmt", 2.628504898986145e-10))
    soft = np.array([[13995515.930769779, 0.04154575990742025, 0.0, 0.35]])
    work = make_work(soft, False, scope, np.array([0.455278351963709 * scope.driven_amplitude]))
    _, status, _ = run(Orbit(in_time=False), work, pm.Accuracy())
    assert status[0] == col.NO_STABLE_ORBIT
