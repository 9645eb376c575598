"""What Wang (1999), Surf. Sci. 429, 178, states of each figure, with the choices of examples/paper.py."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import paper
import paper_fig2_forces as fig2
import paper_fig4_interactions as fig4
import paper_fig5_jumps as fig5
import paper_fig6_laws as fig6
import paper_fig7_setpoint as fig7
import paper_fig8_mapping as fig8
import pytest
import xarray as xr

import phasemap as pm

C = "C'"
WIDTH3 = 1 / paper.FIG3.cantilever.quality_factor  # of the free resonance of Fig. 3, over its frequency
ARCCOS = np.degrees(np.arccos(0.7))

setpoint_sweep = cache(fig7.approach)
over_modulus = cache(fig8.over_modulus)
over_adhesion = cache(fig8.over_adhesion)
jump_frequencies = cache(fig5.frequencies)


@pytest.fixture(scope="module")
def responses() -> dict[str, xr.Dataset]:
    return dict(zip(("damped", "no w", "no K", "undamped"), fig4.responses().values(), strict=True))


def lost_in_harmonics(sweep: xr.Dataset) -> np.ndarray:
    """Sum of n^2 A_n^2 / A^2, what the lever loses in harmonics n >= 2 over what it loses in the first."""
    return ((sweep.harmonic * sweep.harmonics / sweep.amplitude) ** 2).sum("harmonic").values


def ends_of_overlap(sweep: xr.Dataset, name: str) -> float:
    """The ratio of the highest to the lowest value at which both branches are stable; 1 without hysteresis."""
    return float(sweep[f"fold_{name}"].max() / sweep[f"fold_{name}"].min()) if sweep.sizes["fold"] else 1.0


# Fig. 2


def test_the_adhesion_force_of_the_film_is_69_7_nn_and_its_stiffness_constant_1_35_gpa() -> None:
    assert pytest.approx(69.7e-9, abs=0.05e-9) == fig2.ADHESION  # as many digits as the paper gives
    assert 4 / 3 * paper.FILM.modulus / (1 - paper.FILM.poisson_ratio**2) == pytest.approx(1.35e9, abs=0.005e9)
    assert paper.FIG3.driven_amplitude == pytest.approx(155e-9, rel=1e-12)


def test_attraction_joins_the_force_of_dmt_contact_at_the_surface() -> None:
    inside, outside = fig2.forces("DMT", np.array([-1e-18, 0.0]))
    assert outside[0] == pytest.approx(inside[1], rel=1e-8)  # the attraction changes by 2e-18 m / d0 = 7e-9
    assert inside[1] == pytest.approx(-fig2.ADHESION, rel=1e-12)


@pytest.mark.parametrize("law", ["DMT", "Maugis", "JKR"])
def test_the_force_is_attractive_at_first_and_approaches_hertz_at_large_deformation(law: str) -> None:
    depths = np.array([0.1e-9, 1e-7, 1e-6])
    force, hertz = fig2.forces(law, depths)[0], fig2.forces("Hertz", depths)[0]
    assert force[0] < 0
    # What is missing from Hertz is at most f0, which is K sqrt(R) d^1.5 at 4.5 nm: 1 % at 100 nm, 0.03 % at 1000 nm.
    assert (1 - force / hertz)[1:] == pytest.approx(0, abs=0.011)
    assert 0 < (1 - force / hertz)[2] < 4e-4


# Fig. 3


def test_the_response_has_jumps_a_b_c_and_d_and_hysteresis_on_both_sides() -> None:
    found = jump_frequencies(paper.FILM.damping)
    assert set(found) == {"A", "B", C, "D"}
    # Both overlaps are a tenth of the resonance's width or more: no accident of a grid of 0.05 widths.
    assert found["A"] - found["D"] > 0.1 * WIDTH3
    assert found["B"] - found[C] > 0.1 * WIDTH3


def test_the_branches_are_free_attractive_and_repulsive_joined_by_unstable_ones() -> None:
    sweep = paper.response(paper.FILM, paper.FIG3, paper.OFFSET3)
    assert sweep.sizes["fold"] == 4
    assert len(np.unique(sweep.curve_piece)) == 1
    stable = np.flatnonzero(np.diff(sweep.curve_stable.values.astype(int))).size + 1
    assert stable == 5  # from high to low frequency: stable, unstable, stable, unstable, stable
    kept = sweep.where(sweep.curve_stable == 1)
    reach = paper.OFFSET3 - 20e-9  # an orbit that stays this far away is free
    assert (kept.curve_amplitude < reach).any()
    touching = kept.curve_indentation > 0
    assert (kept.curve_branch.where(touching) == 0).any() and (kept.curve_branch.where(touching) == 1).any()


# Fig. 4


def test_attraction_bends_the_resonance_down_and_repulsion_up(responses: dict[str, xr.Dataset]) -> None:
    width = 1 / paper.FIG4.cantilever.quality_factor
    assert fig4.peak(responses["no K"]) < 1 - 0.5 * width  # half of the free resonance's width, as its half maximum is
    assert 1 < fig4.peak(responses["no w"])
    assert fig4.peak(responses["undamped"]) > 1 + 5 * width


def test_without_damping_the_hysteresis_is_very_large(responses: dict[str, xr.Dataset]) -> None:
    width = 1 / paper.FIG4.cantilever.quality_factor
    assert fig4.hysteresis(responses["undamped"]) > 5 * width
    assert fig4.hysteresis(responses["damped"]) < width


def test_high_damping_keeps_the_tip_attractive_and_lowers_the_phase(responses: dict[str, xr.Dataset]) -> None:
    damped, free_of_loss = responses["damped"], responses["undamped"]
    assert float(damped.indentation.max()) < 0.5 * float(free_of_loss.indentation.max())
    assert "B" not in paper.jumps(damped, fig4.FC) and "B" in paper.jumps(free_of_loss, fig4.FC)
    # Where the tip would be repulsive, and touches with damping too. (Where it only grazes, damping raises the phase by
    # 1 degree.)
    hard = (damped.indentation > 0).values & (free_of_loss.phase > 0).values & (free_of_loss.indentation > 0).values
    assert hard.sum() >= 5
    assert (damped.phase.values < free_of_loss.phase.values - 1)[hard].all()


# Fig. 5


def test_jumps_a_and_d_are_below_resonance_and_b_is_well_above() -> None:
    found = jump_frequencies(0.0)
    assert found["D"] < found["A"] < 1
    assert found["B"] - 1 > 0.9 * WIDTH3


def test_jump_b_falls_fast_with_damping_and_meets_resonance() -> None:
    dampings = (0.0, 0.02, 0.04, 0.06, 0.08)
    b, c = (np.array([jump_frequencies(damping)[letter] for damping in dampings]) for letter in ("B", C))
    assert (np.diff(b) < 0).all()
    assert b[0] - b[1] > 0.5 * (b[0] - 1)  # fast: more than half of the way at a quarter of the damping
    # B meets C' and both are lost. C' is where attraction holds the amplitude, 0.06 widths above the resonance: B is
    # at 1 as nearly as a figure shows.
    assert b[-1] - c[-1] < 0.01 * WIDTH3 and abs(b[-1] - 1) < 0.06 * WIDTH3
    assert set(jump_frequencies(0.1)) == {"A", "D"}


def test_jumps_a_and_c_hardly_move_with_damping() -> None:
    loss_free, damped = jump_frequencies(0.0), jump_frequencies(0.08)
    fall = loss_free["B"] - damped["B"]
    # A is where the free tip reaches the attraction, without contact: the damping of the contact does not act.
    assert damped["A"] == pytest.approx(loss_free["A"], abs=1e-9)
    assert abs(damped[C] - loss_free[C]) < 0.03 * fall


def test_jump_d_rises_with_damping() -> None:
    d = np.array([jump_frequencies(damping)["D"] for damping in (0.0, 0.014, 0.05, 0.1, 0.2)])
    assert (np.diff(d) > 1e-6).all()  # a fold is found to 1e-9
    assert d[-1] < 1


# Fig. 6


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [0.999, 1.0, 1.0005, 1.001])
def test_in_the_repulsive_regime_the_phase_rises_from_dmt_over_maugis_to_jkr(ratio: float) -> None:
    dmt, maugis, jkr, hertz = (fig6.phases(law, ratio)[-1] for law in ("DMT", "Maugis", "JKR", "Hertz"))
    # 0.1 degree: orbits are good to 1e-4
    assert dmt + 0.1 < maugis < jkr - 0.1 < hertz


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [0.9985, 1.001, 1.0015])
def test_in_the_slight_tapping_regime_every_law_with_adhesion_gives_the_same_phase(ratio: float) -> None:
    dmt, *others = (fig6.phases(law, ratio) for law in ("DMT", "Maugis", "JKR"))
    for other in others:
        at = -1 if ratio < 1 else 0  # the free or attractive branch
        assert other[at] == pytest.approx(dmt[at], abs=2e-4)  # rounded to 1e-4


# Fig. 7


def test_undamped_phase_is_plus_or_minus_arccos_of_setpoint() -> None:
    for sweep in (setpoint_sweep(0.0), over_modulus(0.0), over_adhesion(0.0)):
        setpoint = sweep.amplitude.values / paper.FIG7.driven_amplitude
        good = sweep.status.values == 0
        away = np.abs(np.abs(sweep.phase.values) - np.degrees(np.arccos(setpoint)))[good]
        assert away.max() < 0.1
        # The rest is what the lever loses in higher harmonics: sin(lag) = setpoint (1 + sum n^2 A_n^2 / A^2), exactly.
        # Harmonics above the sixth are not in the sweep: 0.008 degree at the highest adhesion, 0.0002 elsewhere.
        exact = np.degrees(np.arccos(np.minimum(setpoint * (1 + lost_in_harmonics(sweep)), 1)))
        away = np.abs(np.abs(sweep.phase.values) - exact)[good]
        assert away.max() < 0.01


@pytest.mark.parametrize(("modulus", "force"), [(0.89e9, 20e-9), (0.89e9, 60e-9), (5e9, 40e-9)])
def test_undamped_curves_do_not_depend_on_the_size_of_the_forces_but_the_jump_does(
    modulus: float, force: float
) -> None:
    sweep = setpoint_sweep(0.0, modulus=modulus, adhesion=paper.adhesion(force))
    some = (sweep.status == 0) & (sweep.setpoint > 0.1)  # below, harmonics are 2e-3 of the first and more
    away = np.abs(np.abs(sweep.phase) - np.degrees(np.arccos(sweep.setpoint))).where(some)
    assert away.max() < 0.1
    moved = float(sweep.jump_setpoint[0]) - float(setpoint_sweep(0.0).jump_setpoint[0])
    assert abs(moved) > 0.01
    assert (moved < 0) == (force > 40e-9)  # more attraction holds longer


def test_the_start_is_attractive_and_jumps_to_repulsive_at_a() -> None:
    down = setpoint_sweep(0.0).sel(direction="down")
    at = float(setpoint_sweep(0.0).jump_setpoint[0])
    assert (down.phase[down.setpoint > at] < 0).all()
    after = down.phase[(down.setpoint < at) & (down.status == 0)]
    assert (after > 0).all()
    assert 0.9 < at < 0.97


def test_the_phase_tends_to_90_degrees_at_the_smallest_setpoints() -> None:
    sweep = setpoint_sweep(0.0)
    last = float(sweep.phase.sel(direction="down")[-1])
    assert last == pytest.approx(np.degrees(np.arccos(fig7.SETPOINTS[-1])), abs=0.01)
    assert 89.7 < last < 90
    # Between 0.015 and 0.03 no orbit is met: the tip jumps across, once in each direction.
    across = sweep.jump_to_phase[(sweep.jump_setpoint < 0.04)]
    assert len(across) == 2 and float(across.min()) > 88


def test_the_phase_passes_a_maximum_and_may_return_to_the_attractive_curve() -> None:
    sweep = setpoint_sweep(0.4)
    phase = sweep.phase.where(sweep.tip_offset > 0).sel(direction="down")  # below, the tip no longer leaves the sample
    highest = int(phase.argmax("setpoint"))
    assert 0.2 < fig7.SETPOINTS[highest] < 0.4 and 0 < float(phase[highest]) < 10
    back = setpoint_sweep(0.5)
    setpoint, phase = float(back.jump_setpoint[0]), float(back.jump_to_phase[0])
    assert 0.05 < setpoint < 0.15
    # F- within a tenth of the way to F+
    assert phase == pytest.approx(-np.degrees(np.arccos(setpoint)), abs=0.1 * 2 * np.degrees(np.arccos(setpoint)))


def test_damping_lowers_the_phase_at_every_setpoint_of_the_repulsive_branch() -> None:
    dampings = (0.0, 0.02, 0.1, 0.3, 0.4, 0.5, 1.0)
    phases = np.array([setpoint_sweep(damping).phase.sel(direction="down").values for damping in dampings])
    repulsive = (fig7.SETPOINTS < 0.8) & (fig7.SETPOINTS > 0.1)  # after A at every damping, before any end
    assert (np.diff(phases[:, repulsive], axis=0) < 0).all()


def test_at_high_damping_the_phase_is_negative_at_every_setpoint() -> None:
    sweep = setpoint_sweep(1.0)
    taps = sweep.tip_offset > 0
    assert float(sweep.phase.where(taps).max()) < 0 and float(taps.mean()) > 0.9
    # At the smallest setpoints it sticks, and swings by 4 to 9 thousandths of the free amplitude in contact.
    assert (sweep.setpoint.where(~taps).max() < 0.01) and float(sweep.phase.where(~taps).min()) > 0
    assert (sweep.status.values == 0).all()


@pytest.mark.parametrize("damping", [0.02, 0.1, 0.3])
def test_averaging_agrees_above_a_setpoint_of_0_4_and_not_far_below(damping: float) -> None:
    errors = np.abs([fig7.averaging_error(damping, setpoint) for setpoint in (0.85, 0.7, 0.55, 0.4, 0.2, 0.05)])
    assert (errors[:4] < 1).all()  # degree: no line of the paper's figure is finer
    assert errors[-1] > 4 * errors[:4].max()


# Figs. 8 and 9


@pytest.mark.parametrize("sweep", ["modulus", "adhesion"])
def test_undamped_the_phase_only_jumps_between_plus_and_minus_45_57_degrees(sweep: str) -> None:
    phase = (over_modulus if sweep == "modulus" else over_adhesion)(0.0).phase.values
    assert np.abs(phase) == pytest.approx(ARCCOS, abs=0.1)  # the rest is in the harmonics, see above
    assert {-1.0, 1.0} == set(np.sign(phase).ravel())


def test_damping_shrinks_the_overlap_over_modulus() -> None:
    # Undamped the repulsive branch goes on to the softest sample, for the tip may sink as deep as it must.
    loss_free = fig8.overlap(over_modulus(0.0))
    assert loss_free > fig8.overlap(over_modulus(0.005)) > 0
    assert ends_of_overlap(over_modulus(0.005), "modulus") == pytest.approx(3.8, abs=0.2)
    assert over_modulus(0.1).sizes["fold"] == 0


def test_damping_shrinks_the_overlap_over_adhesion() -> None:
    wide = np.geomspace(10e-9, 20e-6, 61)  # undamped, the repulsive branch goes on to 9 uN
    ends = [ends_of_overlap(fig8.over_adhesion(damping, wide), "adhesion") for damping in fig8.DAMPINGS]
    assert ends[0] > 2 * ends[1] > 8 * ends[2] > 8


def test_with_damping_the_phase_rises_with_modulus_and_falls_with_adhesion() -> None:
    for damping in (0.005, 0.1):
        for way in range(2):
            assert (np.diff(over_modulus(damping).phase.values[way]) > 0).all()
            assert (np.diff(over_adhesion(damping).phase.values[way]) < 0).all()


def test_sensitivity_is_best_where_the_phase_is_near_0_and_gone_in_the_attractive_regime() -> None:
    phase = over_modulus(0.1).phase.values[0]
    slope = np.gradient(phase, np.log10(fig8.MODULI))  # degrees a decade
    near = np.abs(phase) < 25
    assert near[slope.argmax()]
    assert slope[near].min() > 2 * slope[phase > 35].max()
    assert slope[near].min() > 2 * slope[phase < -40].max()


def test_elastic_contrast_shows_in_height_and_not_in_phase() -> None:
    soft, hard = (
        pm.solve_pixel(replace(paper.FILM7, modulus=modulus), paper.FIG7, 0.7, solver="orbit") for modulus in (1e9, 5e9)
    )
    assert soft.branch == hard.branch == "repulsive"
    assert abs(hard.phase - soft.phase) < 0.01
    assert hard.height - soft.height > 1e-9
