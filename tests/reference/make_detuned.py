"""Makes tests/data/detuned.json: which orbit engaging in time ends on beside resonance, for cases drawn at random.

    python tests/reference/make_detuned.py [how many]

The drive is up to 20 linewidths below or above resonance, the free amplitude given at the frequency of the drive;
parameters are such that attraction and repulsion both hold the setpoint in many of them.  Engaged by hard_engage.py, in
other steps again where the tip jumped (make_hard.known, which says what is written; cases whose end depends on the
steps are kept, and say so).  Every prefix of the cases is the same whatever their number, and what is in the file
already is not done again.
"""

import json
import pathlib
import sys
import time

import numpy as np
from make_hard import known

OUT = pathlib.Path(__file__).parent.parent / "data" / "detuned.json"


def draw(number):
    """One case in SI."""
    rng = np.random.default_rng([14, number])

    def over_decades(low, high):
        return float(f"{low * (high / low) ** rng.random():.4g}")

    q, linewidths = over_decades(60, 500), over_decades(0.05, 20) * rng.choice([-1, 1])
    ratio = round(1 + linewidths / q, 6)  # the resonance is 1/Q wide
    free = over_decades(4e-9, 4e-8) * q * np.hypot(1 - ratio**2, ratio / q)
    return {
        "name": f"detuned {number}: {linewidths:+.3g} linewidths",
        "stiffness": over_decades(2, 50),
        "quality_factor": q,
        "frequency_ratio": ratio,
        "free_amplitude": float(free),
        "tip_radius": over_decades(5e-9, 3e-8),
        "decay_length": over_decades(1.5e-10, 5e-10),
        "contact": "dmt",
        "modulus": over_decades(1e8, 3e10),
        "adhesion": over_decades(0.02, 0.3) * float(rng.random() > 0.15),
        "damping": over_decades(5e-4, 0.03) * float(rng.random() > 0.2),
        "poisson_ratio": 0.35,
        "setpoint": round(0.35 + 0.6 * rng.random(), 3),
    }


def main():
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 120
    data = {one["name"]: one for one in (json.loads(OUT.read_text()) if OUT.exists() else [])}
    for number in range(count):
        case, started = draw(number), time.time()
        if case["name"] in data:
            continue
        found = data[case["name"]] = case | known(case)
        said = found["orbit"] and (round(found["orbit"]["tip_offset"] * 1e9, 4), round(found["orbit"]["phase"], 3))
        print(
            f"{case['name']}: {found['outcome']} {said}, {found['periods']} periods, {time.time() - started:.0f} s",
            flush=True,
        )
        OUT.write_text("[\n" + ",\n".join(json.dumps(one) for one in data.values()) + "\n]\n")


if __name__ == "__main__":
    main()
