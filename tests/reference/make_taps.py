"""Makes tests/data/taps.json: what hard taps off the resonance come to, engaged in time at several speeds; and compares.

    python tests/reference/make_taps.py make
    python tests/reference/make_taps.py compare [SOLVER]

Integration, lowering, feedback and what is stated are those of make_polymers.py, where they are explained; nothing is
shared with phasemap. Contact is DMT without a neck, which ends at d = 0.

Of the materials in the file, parameters alone are read: samples of 50 to 300 GPa driven at 1.1 of the resonance (levers
of 20 to 50 N/m, Q 200 to 850, 10 to 100 nm of free amplitude at the drive), and one far below it. Lowered at each of
SPEEDS [free amplitudes a ring-down time], the tip may come to other motions, of 1, 5, 6 or 7 periods, each of which
holds the setpoint for good: `held` has one a speed, with the fields of make_polymers.py.
"""

import json
import math
import sys

from make_polymers import DMT, OUT, POISSON, Run, compiled, judged, write

TAPS = OUT.with_name("taps.json")
SPEEDS = (2e-2, 4e-3, 1e-3)


def contact(case):
    """What `Tip` has of the contact, in nm."""
    stiff, radius, k = 4 / 3 * case["modulus"] / (1 - POISSON**2), case["tip_radius"], case["stiffness"]
    pull = 2 * math.pi * case["adhesion"] * radius / k * 1e9
    force = stiff * math.sqrt(radius) / k * 1e-4 * math.sqrt(0.1)
    return {"law": DMT, "force": force, "depth": pull, "first": 0.0, "release": 0.0}


def engaged(library, case, speed):
    run = Run(library, case | {"tip": contact(case)})
    run.speed = speed * run.amplitude
    run.descend(case["setpoint"] * run.amplitude)
    return {"speed": speed, "held": True} | run.hold(case["setpoint"] * run.amplitude)


def make():
    library, cases = compiled(), json.loads(TAPS.read_text())
    for case in cases:
        case["held"] = [engaged(library, case, speed) for speed in SPEEDS]
        print(*((one["period"], one["phase"], one["tip_offset"]) for one in case["held"]))
        write(cases, TAPS)


def compare(solver="orbit"):
    """Print which of the motions phasemap comes to."""
    import phasemap as pm

    for case in json.loads(TAPS.read_text()):
        lever = pm.Cantilever(case["stiffness"], 300e3, case["quality_factor"])
        drive = pm.Drive(case["free_amplitude"], case["frequency_ratio"] * 300e3)
        scope = pm.Microscope(lever, pm.Tip(case["tip_radius"]), drive, pm.Interaction("dmt", case["decay_length"]))
        material = pm.Material(case["modulus"], case["adhesion"], case["damping"], poisson_ratio=POISSON)
        pixel = pm.solve_pixel(material, scope, case["setpoint"], solver)
        print(pixel.phase, pixel.tip_offset, *((one["period"], judged(one, pixel)) for one in case["held"]))


if __name__ == "__main__":
    {"make": make, "compare": compare}[sys.argv[1]](*sys.argv[2:])
