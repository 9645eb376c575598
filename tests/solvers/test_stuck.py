"""A tip that falls onto the sample and sticks: what a feedback finds when it raises the tip again."""

from __future__ import annotations

import math

import phasemap as pm


def test_a_mean_that_misses_the_setpoint_is_no_answer() -> None:
    # Attraction carries this soft lever over its resonance. Then it falls, and sticks at a sixth of the setpoint.
    # Engaged in time with a feedback by another code (`held` in tests/reference/make_leaps.py), it is not held.
    scope = pm.Microscope(
        pm.Cantilever(0.6512, 300e3, 255.1), pm.Tip(2.071e-9), pm.Drive(4.898e-9, 282.3e3),
        pm.Interaction("dmt", 2.375e-10),
    )  # fmt: skip
    pixel = pm.solve_pixel(pm.Material(1.489e9, 0.1863, 0.2588), scope, 0.1293)
    assert pixel.status is pm.Status.no_stable_orbit
    assert repr(pixel) == "Pixel(no stable orbit)"


def test_a_tip_that_is_raised_may_come_to_the_setpoint_before_it_comes_free() -> None:
    scope = pm.Microscope(
        pm.Cantilever(0.08148, 300e3, 7.421), pm.Tip(5.846e-9), pm.Drive(1.181e-9), pm.Interaction("dmt", 3.794e-10)
    )
    pixel = pm.solve_pixel(pm.Material(12.69e6, 0.2176, 0.0004755), scope, 0.1325)
    assert pixel.status is pm.Status.good
    assert pixel.branch == "repulsive"
    # In contact all the time, with the lever bent towards the sample by almost as much as the adhesion can.
    pull_off = 2 * math.pi * scope.tip.radius * 0.2176 / scope.cantilever.stiffness
    assert pixel.tip_offset + 2 * pixel.amplitude < pixel.mean_deflection
    assert 0.95 * pull_off < pixel.tip_offset < pull_off


def test_what_sticks_for_good_is_known_after_one_raise() -> None:
    # It rings down in 361 periods, and is bent by 28 nm before it comes free; four falls took 35,000 periods.
    scope = pm.Microscope(
        pm.Cantilever(0.09483, 300e3, 1133.0), pm.Tip(2.827e-9), pm.Drive(2.476e-9), pm.Interaction("jkr", None)
    )
    few = pm.Accuracy(periods=6000)
    pixel = pm.solve_pixel(pm.Material(420.8e6, 0.2113), scope, 0.2167, accuracy=few)
    assert pixel.status is pm.Status.no_stable_orbit


def test_a_tip_that_falls_out_of_irregular_motion_is_held_where_a_feedback_ends() -> None:
    # Its period doubles before it falls. A classical Runge-Kutta method that does not locate contacts, with the tip
    # lowered at four constant speeds, sticks in 39 of 64 runs and taps on in the others, by chance. With an integral
    # feedback, which raises the tip and lowers it again, all of 15 runs at gains from 0.003 to 0.3 a period end here.
    scope = pm.Microscope(
        pm.Cantilever(0.0409895672161038, 30e3, 7.681549354045569, participation=1), pm.Tip(19.87027686656883e-9),
        pm.Drive(11.604198676683446e-9, excitation="base"), pm.Interaction("dmt", 5.178872724788154e-10),
    )  # fmt: skip
    pixel = pm.solve_pixel(pm.Material(72415717.01559418, 0.00462914110867666, 0.11761596440786407), scope, 0.6)
    assert pixel.status is pm.Status.good
    # Of 1600 steps a period; with 800 they are 6.731704 nm and 39.699 degrees.
    assert abs(pixel.tip_offset - 6.731768e-9) < 1e-13
    assert abs(pixel.phase - 39.703) < 0.005


def test_irregular_motion_that_is_held_in_the_mean_is_not_said_to_be_held_by_nothing() -> None:
    # `engaged` of tests/reference/make_taps.py holds it after approaches at three speeds, with a phase of -35.8 degree
    # and amplitudes of four ring-down times that scatter by 6 %; those of single ones scatter by a fifth.
    scope = pm.Microscope(
        pm.Cantilever(0.10331755897927944, 300e3, 77.10566545805885), pm.Tip(1.5188390869856488e-09),
        pm.Drive(3.394703928492289e-08), pm.Interaction("dmt", None),
    )  # fmt: skip
    sticky = pm.Material(10294789.379424043, 0.2978928222281013, 0.044903842240424006, poisson_ratio=0.35)
    pixel = pm.solve_pixel(sticky, scope, 0.5069802929846258)
    assert pixel.status in (pm.Status.not_settled, pm.Status.good)


def test_a_tip_that_falls_twice_and_is_pressed_in_far_holds_the_setpoint_there() -> None:
    # 4,000 times the free amplitude deep. `engage` of tests/reference/hard_engage.py holds it at -504.592149 nm and
    # 86.34173620 degrees, after two falls; the amplitude changes by 3e-5 of what the tip is raised.
    scope = pm.Microscope(
        pm.Cantilever(4.7462647240099995, 300e3, 93.36493458494469), pm.Tip(7.732211365853303e-9),
        pm.Drive(1.0225494670108946e-9, 285032.08498921397), pm.Interaction("dmt", 3.180254986553901e-10),
    )  # fmt: skip
    soft = pm.Material(3741414.252037878, 0.012125286303767623, 0.00020062671045725235, poisson_ratio=0.35)
    pixel = pm.solve_pixel(soft, scope, 0.47464318161055896)
    assert pixel.status is pm.Status.good
    assert abs(pixel.tip_offset + 504.592149e-9) < 2e-14
    assert abs(pixel.phase - 86.34173620) < 1e-6
