"""Materials that nobody had chosen, under the laws with hysteresis, as an independent code engages them in time."""

from __future__ import annotations

import pytest
from cases import Case, load, material_of, scope_of

import phasemap as pm

# tests/reference/make_polymers.py, which compares all. Here are two that tap periodically, and those that once ended on
# another pattern of taps (15, 69), or on a periodic orbit beside the irregular motion (24); two driven below and above
# resonance, there irregularly too; and one that a hasty controller led to another pattern than all ways.
CHOSEN = [load("polymers")[i] for i in (2, 3, 15, 24, 69)]
CHOSEN += [load("polymers_detuned")[i] for i in (2, 8)] + load("polymers_wild")
# tests/reference/make_necks.py: of Maugis a contact that taps in every period (21), one that does not (64) and one
# without neck (80); of necks irregular ones (14, 65), and one in which the pattern of taps goes with the way (61).
CHOSEN += [case for case in load("necks") if case["number"] in (14, 21, 61, 64, 65, 80)]
# Steps of the reference are good to 1e-4 degree and 0.1 pm here. Means of irregular motion have standard errors of
# 0.01 degree and 2 pm in phasemap, of 0.003 degree and 0.5 pm in the reference: five of both together.
PERIODIC, MEAN = (1e-4, 1e-13), (0.05, 1.1e-11)


@pytest.mark.parametrize("case", CHOSEN, ids=lambda case: f"{case['modulus'] / 1e6:.0f} MPa")
def test_the_tip_is_held_as_by_engagement_in_time(case: Case) -> None:
    for held in case["setpoints"]:
        pixel = pm.solve_pixel(material_of(case), scope_of(case), held["setpoint"], "orbit")
        assert pixel.status is pm.Status.good
        assert pixel.motion == ("periodic" if held["period"] == 1 else "irregular")
        degree, length = PERIODIC if held["period"] == 1 else MEAN
        # Which pattern of taps is held goes with the way there; `near` has those that the reference finds on others.
        ways = [(held["tip_offset"], held["phase"]), *held.get("near", [])]
        assert any(abs(pixel.tip_offset - z) < length and abs(pixel.phase - a) < degree for z, a in ways)
