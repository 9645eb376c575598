"""Makes tests/data/means.json: means of irregular motion, for the errors that phasemap states of them; and compares.

    python tests/reference/make_means.py make
    python tests/reference/make_means.py compare [SOLVER]

Integration and feedback are those of make_polymers.py, where they are explained; nothing is shared with phasemap.

Which pattern of taps a tip comes to goes with its way; how well the mean of a pattern is known is asked here. So of the
materials in the file parameters and `state` are read: [z, dz/dtau, whether in contact, tip offset] at drive phase 0, in
which the averages of phasemap ended. From there this code goes on, in the same pattern as long as that lasts.

Materials.  All with irregular motion in polymers.json, polymers_detuned.json, polymers_wild.json, necks.json and
irregular.json; 119 more under JKR contact at one setpoint each from 0.3 to 0.97 (seeds 11 and 12), the first 52 drawn
like make_polymers.py's, the others from 5 MPa to 3 GPa, up to 0.3 J/m2, Q from 30 to 1000; and 30 hard taps of 50 to 300
GPa at 1.03 to 1.117 of the resonance, as in make_taps.py, which repeat themselves after 2, 5 or 7 periods.

Held.  GROUPS groups of eight ring-down times, of which the first SKIP do not count. A feedback acts on what a low-pass
shows, which is a little more than the modulus of the mean phasor where the motion swings about it. That is taken off
one to one of the tip offset, and by the slope over the groups of the phase. Hard taps swing by nanometres, and their
amplitude changes 1.1 to 1.4 times as much as the tip offset: a feedback holds them picometres off the setpoint. They stay at
two tip offsets, 10 pm apart, and a straight line tells the one at the setpoint.

Fields: tip_offset [m], phase [degree], and their standard errors (the largest over groups of 1, 2, 4, ... values).
`near` of two hard taps: [tip_offset, phase] of the motion of one period that `make_taps.engaged` comes to at one of the
speeds 2e-2, 4e-3, 1e-3 and 2.5e-4, and at the others to motions of six or seven periods: 249 at 4e-3, 272 at 1e-3.
"""

import json
import math
import sys

import make_necks
import make_taps
import numpy as np
from make_polymers import GAIN, OUT, Run, compiled

MEANS = OUT.with_name("means.json")
GROUPS, SKIP = 26, 6
APART = 0.01  # nm, of two tip offsets
OUTSIDE, IN, NECK = range(3)
FIELDS = ("tip_offset", "tip_offset_error", "phase", "phase_error")


def resumed(library, case):
    """The tip in the state in which phasemap's averages ended."""
    if case["contact"] == "dmt":
        case = case | {"tip": make_taps.contact(case)}
    elif case["contact"] != "jkr":
        case = case | {"tip": make_necks.tip(library, case)}
    run = Run(library, case)
    z, v, touches, z0 = case["state"]
    run.tip.z, run.tip.v, run.tip.z0, run.tip.theta = 1e9 * z, 1e9 * v, 1e9 * z0, 0.0
    run.tip.state = OUTSIDE if not touches else IN if z >= z0 else NECK
    lag = math.radians(90 - case["seen"])
    run.slow[:] = [case["setpoint"] * run.amplitude * x for x in (math.cos(lag), -math.sin(lag))] * 2
    return run


def standard_error(values):
    largest = 0.0
    while len(values) >= 6:
        largest = max(largest, np.std(values, ddof=1) / math.sqrt(len(values)))
        values = values[: len(values) // 2 * 2].reshape(-1, 2).mean(1)
    return largest


def phasors(rows, size):
    return (rows[:, 0] + 1j * rows[:, 1]).reshape(-1, size).mean(1)


def held(library, case):
    """Tip offset [nm] and phase [degree] at the setpoint, and their errors."""
    run = resumed(library, case)
    target, size = case["setpoint"] * run.amplitude, max(int(8 * run.ring), 300) // 12 * 12 + 12
    rows = run.pass_periods(size * GROUPS, target, 0.5 * GAIN)[size * SKIP :]
    zeta = phasors(rows, size)
    missed, phases = np.abs(zeta) - target, 90 + np.degrees(np.angle(zeta))
    offsets = rows[:, 2].reshape(-1, size).mean(1) - missed
    if np.std(missed) > 1e-12:
        phases = phases - np.polyfit(missed, phases, 1)[0] * missed
    return offsets.mean(), standard_error(offsets), phases.mean(), standard_error(phases)


def stays(library, case, offset):
    """Amplitude [nm] and phase [degree] at a constant tip offset, and their errors."""
    run = resumed(library, case)
    run.tip.z0 = offset
    size = int(4 * run.ring) // 420 * 420 + 420
    run.pass_periods(int(30 * run.ring), 0.0, 0.0, record=False)
    zeta = phasors(run.pass_periods(12 * size, 0.0, 0.0), size)
    phases = 90 + np.degrees(np.angle(zeta))
    return np.abs(zeta).mean(), standard_error(np.abs(zeta)), phases.mean(), standard_error(phases)


def between(library, case):
    """As `held`, at two tip offsets."""
    first = 1e9 * case["state"][3]
    (low, error, low_phase, phase_error), (high, _, high_phase, _) = (
        stays(library, case, z0) for z0 in (first, first + APART)
    )
    share = (case["setpoint"] * Run(library, case | {"tip": make_taps.contact(case)}).amplitude - low) / (high - low)
    return first + share * APART, error, low_phase + share * (high_phase - low_phase), phase_error


def make():
    library, cases = compiled(), json.loads(MEANS.read_text())
    for i, case in enumerate(cases):
        found = (between if case["contact"] == "dmt" else held)(library, case)
        for name, value, unit in zip(FIELDS, found, (1e-9, 1e-9, 1, 1), strict=True):
            case[name] = float(f"{unit * value:.11g}")
        print(i, case["setpoint"], *found, flush=True)
    MEANS.write_text("[\n" + ",\n".join(map(json.dumps, cases)) + "\n]\n")  # all digits of the states


def compare(solver="orbit"):
    """Print how many errors are within what phasemap states, and their median shares of it."""
    import phasemap as pm

    shares = []
    for i, case in enumerate(json.loads(MEANS.read_text())):
        pixel = pm.solve_pixel(make_necks.material_of(case), make_necks.scope_of(case), case["setpoint"], solver)
        share = [
            abs(pixel.phase - case["phase"]) / math.hypot(pixel.error_phase, 2 * case["phase_error"]),
            abs(pixel.tip_offset - case["tip_offset"]) / math.hypot(pixel.error_height, 2 * case["tip_offset_error"]),
        ]
        shares.append(share)
        if max(share) > 1:
            print(i, case["contact"], case["setpoint"], share, pixel.motion)
    within = np.mean(np.array(shares) <= 1, axis=0)
    print(f"{len(shares)} means, phase and height: within {within}, median shares {np.median(shares, axis=0)}")


if __name__ == "__main__":
    {"make": make, "compare": compare}[sys.argv[1]](*sys.argv[2:])
