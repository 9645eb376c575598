"""Makes tests/data/feedback.json: one scan line in time under PI feedback, from the full equation of motion; nothing of phasemap is used.

    python tests/reference/make_feedback.py [word]

The machine (truth_scan.py integrates it).  Time runs in drive periods T, each from drive phase 0.  During period n
  - the tip offset is constant, z0 = Z_n - h(x_n): Z_n position of the scanner, x_n position along the line at the
    MIDDLE of the period, h linear between pixel centres and constant beyond the outermost; the material is that of the
    pixel in which x_n lies, the outermost pixels continued into the overscan;
  - the lock-in measures a_n = (2/T) integral z exp(-i omega t) dt, which enters `order` equal one-pole filters in a row
    and is held there for the period; time constant sqrt(2^(1/order) - 1) / (2 pi bandwidth), so that `bandwidth` is the
    -3 dB bandwidth of all of them;
  - at its end R = |x|, phase = 90 degrees + arg x with x the last filter, e = R - setpoint * (free amplitude at the
    drive frequency), I += Ki e T and Z_(n+1) = Z_engage - (Kp e + I).  The scanner follows at once.
Path: standing at the left turning point, -overscan * length; constant acceleration to the left edge; trace at constant
speed; a turn at constant acceleration over the right overscan; retrace; back to rest.  All of it takes 1 / line_rate.
The line begins (t = 0, I = 0) when tip, filters and controller have come to rest at the turning point.  They got there
from the free lever by a slow way down (0.4 % of the free amplitude in Q periods) to where the amplitude is first at the
setpoint; then the controller held it until Z and e stood still to 1e-8 nm.  Four times as fast or slow ends in the same
orbit in every case.

Parameters of a case (SI): those of laws.json for lever, tip, drive and DMT contact with the long-range force;
materials; labels and topography [m] by pixel.  pixel_size is not used by the motion: only pixels pass under the tip.
Start of any period and border of a pixel are at least 1 % of a period apart on trace and retrace, so that rounding
decides nothing.

Results: engaged = at rest, before the line begins; trace and retrace, both from left to right, averaged over the time
in each pixel, with R and phase of a period half way between its beginning and its end (see truth_scan.weights for
periods that begin in one pixel and end in the next): height = mean Z - setpoint amplitude; amplitude_error = mean R -
setpoint amplitude; mean phase [degree]; mean amplitude; `periods` whose middle is in the pixel, and over them
lowest_amplitude = min R and phase_wraps = steps of more than 180 degrees from period to period, the phase being in
(-180, 180]: where there are any, the mean is that of a wrapped phase and says little.

Accuracy: uncertainty = largest change when the tolerance is 256 times larger, that is with steps about twice as long:
at most 1e-6 nm and 1e-4 degree, mostly 1e-7 nm and 1e-6 degree.  check_feedback.py (fixed steps that know nothing of
contact, other lock-in, filter and path) agrees to 1e-5 nm and 3e-4 degree at 8000 steps a period (worst where branches
are switched; else 3e-6 nm and 1e-4 degree), which is its own error: it falls with the step.
The engaged orbits agree with Newton shooting (truth_orbits.py) to 1e-7 nm and 1e-6 degree.

Engaged at pixel 0: the only orbit of the setpoint there, but for "attractive pair" (a repulsive one exists too; the way
from far ends on the attractive one) and "lever of the paper, more adhesion" (attractive; an unstable and a repulsive
one below).
"""

import json
import math
import pathlib
import sys
import time

import numpy as np
from truth_scan import Machine, lines

HERE = pathlib.Path(__file__).parent
OUT = (HERE.parent / "data" if (HERE.parent / "data").is_dir() else HERE) / "feedback.json"
TIGHT = 1e-13
LINES = ("trace", "retrace")
QUANTITIES = ("height", "amplitude_error", "phase", "amplitude")


def material(modulus, adhesion, damping=0.0):
    return dict(modulus=modulus, adhesion=adhesion, damping=damping, poisson_ratio=0.35)


def stripes(nx, *edges):
    """Labels that begin with 0 and change at the edges."""
    return [int(sum(i >= e for e in edges)) % 2 for i in range(nx)]


def step(nx, height, up, down):
    return [height if up <= i < down else 0.0 for i in range(nx)]


BASE = dict(
    stiffness=40.0, resonance_frequency=300e3, frequency_ratio=1.0, quality_factor=400.0, free_amplitude=40e-9, tip_radius=10e-9,
    decay_length=0.3e-9, setpoint=0.7, pixel_size=10e-9, line_rate=15.195, proportional_gain=0.1, integral_gain=1000.0,
    bandwidth=5e3, order=2, overscan=0.1,
)  # fmt: skip
PAPER = dict(
    labels=stripes(18, 6, 12), resonance_frequency=148.5e3, quality_factor=833.0, free_amplitude=60e-9, tip_radius=30e-9, line_rate=6.164,
    integral_gain=250.0,
)  # fmt: skip
LOCKIN = dict(
    materials=[material(3e9, 0.03), material(1e9, 0.04, 0.02)],
    labels=stripes(16, 5, 11),
    topography=step(16, 5e-9, 3, 8),
    line_rate=26.008,
)
A, B = material(3e9, 0.03), material(1e9, 0.04, 0.02)
CASES = [
    ("flat, elastic pair", "height and error only; the phase returns to arccos(setpoint)",
     dict(materials=[A, material(0.3e9, 0.03)], labels=stripes(24, 8, 16), line_rate=20.572)),
    ("flat, elastic and damped pair", "repulsive everywhere", dict(materials=[A, B], labels=stripes(24, 6, 12, 18), line_rate=18.177)),
    ("step of 10 nm, damped", "topography alone shows in the phase",
     dict(materials=[material(1.5e9, 0.04, 0.01)], labels=[0] * 24, topography=step(24, 10e-9, 8, 16))),
    ("sine and stripes, fast", "the feedback never arrives", dict(
        materials=[A, material(0.8e9, 0.04, 0.01)], labels=stripes(32, 8, 16, 24), line_rate=31.887,
        topography=[3e-9 * math.sin(2 * math.pi * (i + 0.5) / 16) for i in range(32)])),
    ("attractive pair", "orbits without contact; the phase returns to -arccos(setpoint)", dict(
        materials=[material(3e9, 0.05), material(1e9, 0.1, 0.005)], labels=stripes(24, 8, 16), free_amplitude=6e-9, setpoint=0.85,
        line_rate=12.484)),
    ("bistable strip", "repulsive | bistable | attractive: each pass keeps the branch on which it comes", dict(
        materials=[A, material(1e9, 0.08, 0.01), material(0.5e9, 0.15, 0.05)], labels=[0] * 6 + [1] * 6 + [2] * 6,
        free_amplitude=14e-9, setpoint=0.8, line_rate=14.309)),
    ("switching strip", "repulsive | repulsive | attractive, one orbit in each: the retrace enters the strip attractive and switches late", dict(
        materials=[A, material(2e9, 0.08, 0.01), material(0.5e9, 0.1, 0.05)], labels=[0] * 6 + [1] * 6 + [2] * 6,
        free_amplitude=14e-9, setpoint=0.8, line_rate=14.309)),
    ("lever of the paper", "", PAPER | dict(materials=[material(1.35e9, 0.05, 0.005), material(5e9, 0.05, 0.001)])),
    ("lever of the paper, more adhesion", "engages attractive, leaves it over the stiffer stripe and does not come back",
     PAPER | dict(materials=[material(1.35e9, 0.1, 0.005), material(5e9, 0.1, 0.001)])),
    ("soft lever, driven below resonance", "", dict(
        materials=[material(0.5e9, 0.02, 0.05), material(2e9, 0.02)], labels=stripes(24, 8, 16), stiffness=3.0,
        resonance_frequency=75e3, frequency_ratio=0.999, quality_factor=200.0, free_amplitude=50e-9, line_rate=6.101,
        integral_gain=500.0)),
    ("liquid-like, Q 5", "first-order averaging is expected to fail", dict(
        materials=[material(0.1e9, 0.002, 0.01), material(1e9, 0.002)], labels=stripes(24, 8, 16), topography=step(24, 5e-9, 4, 12),
        stiffness=1.0, resonance_frequency=30e3, quality_factor=5.0, free_amplitude=10e-9, line_rate=8.0, bandwidth=3e3)),
    ("lock-in of order 1", "", LOCKIN | dict(order=1, bandwidth=1e3)),
    ("lock-in of order 4", "", LOCKIN | dict(order=4, bandwidth=2e3)),
    ("parachuting", "40 nm down in the trace, up in the retrace: the tip leaves the surface, the error stays at A_free - A_set", dict(
        materials=[material(2e9, 0.03, 0.005)], labels=[0] * 32, topography=step(32, 40e-9, 0, 10), line_rate=40.832)),
]  # fmt: skip


def complete(name, about, given):
    """A case with everything filled in."""
    case = {"name": name, "about": about} | BASE | given
    case.setdefault("topography", [0.0] * len(case["labels"]))
    return case


def scanned(case, tol):
    """Lines of a case; where it engaged; the records the lines are made of."""
    machine = Machine(case, tol)
    settled = machine.engage()
    record, x, direction = machine.scan()
    engaged = {"tip_offset": (settled[-1, 0] - 1e9 * case["topography"][0]) * 1e-9, "phase": settled[-1, 2]}
    return lines(case, record, x, direction, machine.goal), engaged, record


def plain(value, digits):
    """The same for JSON, with so many digits."""
    if isinstance(value, dict):
        return {k: plain(v, digits) for k, v in value.items()}
    if isinstance(value, np.ndarray):
        return [plain(v, digits) for v in value.tolist()]
    return float(f"{value:.{digits}g}") if isinstance(value, float) else value


def made(case):
    """A case with its results, for the file."""
    t = time.time()
    result, engaged, record = scanned(case, TIGHT)
    wall = time.time() - t
    rough, engaged_rough, _ = scanned(case, 256 * TIGHT)
    error = {q: max(float(np.max(np.abs(result[i][q] - rough[i][q]))) for i in LINES) for q in QUANTITIES}
    error["tip_offset"] = abs(engaged["tip_offset"] - engaged_rough["tip_offset"])
    percent = (
        1e2
        * record[:, 1]
        * 1e-9
        * case["setpoint"]
        / (result["trace"]["amplitude"] - result["trace"]["amplitude_error"])[0]
    )
    print(
        f"{case['name']:36s} {len(record):5d} periods of {record[:, 4].mean():3.0f} steps, {wall:4.1f} s; engaged {engaged['phase']:8.4f}; "
        f"error {percent.min():5.1f} .. {percent.max():4.1f} %; phase {record[:, 2].min():4.0f} .. {record[:, 2].max():4.0f}; "
        f"uncertainty {error['height']:.0e} m, {error['phase']:.0e} degree",
        flush=True,
    )
    lists = {i: plain(result[i], 10) for i in LINES}
    return case | {"engaged": plain(engaged, 10)} | lists | {"uncertainty": plain(error, 2)}


def main(word=""):
    cases = [made(complete(*c)) for c in CASES if word in c[0]]
    if not word:
        text = ",\n".join(json.dumps(c) for c in cases)
        OUT.write_text(f'{{"cases": [\n{text}\n]}}\n')


if __name__ == "__main__":
    main(*sys.argv[1:])
