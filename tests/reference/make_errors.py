"""Makes tests/data/errors.json: cases drawn at random with all their orbits, for the errors that solvers state.

    python tests/reference/make_errors.py

Newton shooting (shooting.py) along the curve of orbits of the wanted amplitude, as in make_orbits.py; nothing of
phasemap is used.  Moduli, adhesions and whatever spans decades are drawn from ranges with uniform logarithms, radius,
decay length and setpoint uniformly; one material in five has no adhesion, one in five no damping.

Units SI.  Per orbit, far to near: tip_offset, phase [degree], and uncertainty = [m, degree], what one more step of
Newton's method would change.
"""

import json
import pathlib
import time

import numpy as np
from shooting import Oscillator

OUT = pathlib.Path(__file__).parent.parent / "data" / "errors.json"
SEED, PER_REGIME = 14, 12
DECADES = ("stiffness", "quality_factor", "free_amplitude", "modulus", "adhesion", "damping")
AIR = dict(
    stiffness=(20.0, 50.0), quality_factor=(200.0, 850.0), free_amplitude=(1e-8, 6e-8), tip_radius=(8e-9, 30e-9),
    modulus=(1e9, 2e10), adhesion=(1e-3, 0.2), damping=(1e-3, 0.1), decay_length=(0.15e-9, 0.5e-9), setpoint=(0.3, 0.97),
)  # fmt: skip
LIQUID = AIR | dict(
    stiffness=(0.3, 2.0), quality_factor=(2.0, 8.0), free_amplitude=(5e-9, 15e-9), modulus=(1e7, 3e8),
    adhesion=(1e-4, 5e-3), damping=(1e-3, 0.2),
)  # fmt: skip
WILD = dict(
    stiffness=(0.05, 5.0), quality_factor=(1.5, 8.0), modulus=(1e6, 5e9), adhesion=(1e-4, 0.03), setpoint=(0.1, 0.97)
)
HERTZ = dict(contact="hertz", adhesion=None, decay_length=None)
REGIMES = {
    "air": AIR,
    "air, soft sample": AIR | dict(stiffness=(5.0, 50.0), modulus=(1e7, 1e9), damping=(3e-3, 0.2)),
    "soft lever": AIR | dict(stiffness=(1.0, 4.0), quality_factor=(60.0, 200.0), modulus=(5e7, 3e9)),
    "stiff sample": AIR | dict(modulus=(5e10, 3e11)),
    "vacuum": AIR | dict(quality_factor=(5e3, 5e4), modulus=(3e8, 2e10)),
    "sticky": AIR | dict(stiffness=(2.0, 50.0), modulus=(1e8, 5e9), adhesion=(0.05, 0.5)),
    "small amplitude": AIR | dict(stiffness=(20.0, 200.0), free_amplitude=(1e-9, 4e-9)),
    "force that jumps": AIR | dict(decay_length=None, adhesion=(1e-3, 0.05)),
    "Hertz": AIR | HERTZ | dict(stiffness=(2.0, 50.0), modulus=(1e7, 2e10)),
    "off resonance": AIR | dict(quality_factor=(100.0, 600.0), frequency_ratio=(0.9, 0.999, 1.001, 1.1)),
    "low Q": AIR | dict(stiffness=(0.3, 40.0), quality_factor=(8.0, 40.0), modulus=(1e7, 1e10), adhesion=(1e-3, 0.05)),
    "liquid": LIQUID,
    "liquid, wild": LIQUID | WILD,
    "liquid, Hertz": LIQUID | HERTZ | dict(modulus=(1e6, 3e8)),
    "liquid, off resonance": LIQUID | dict(frequency_ratio=(0.7, 0.9, 1.1, 1.3)),
}


def drawn(ranges, rng):
    """One case."""
    case = {"contact": "dmt", "frequency_ratio": 1.0, "poisson_ratio": 0.35}
    for name, given in ranges.items():
        if name == "frequency_ratio":
            case[name] = float(rng.choice(given))
        elif not isinstance(given, tuple):
            case[name] = given
        elif name in DECADES:
            case[name] = float(np.exp(rng.uniform(*np.log(given))))
        else:
            case[name] = float(rng.uniform(*given))
        if name in ("adhesion", "damping") and rng.random() < 0.2:
            case[name] = 0.0
    case["adhesion"] = case["adhesion"] or 0.0
    return case


def main():
    data = []
    for regime, ranges in REGIMES.items():
        rng, started, count = np.random.default_rng([SEED, len(data)]), time.time(), 0
        for _ in range(PER_REGIME):
            case = drawn(ranges, rng)
            try:
                found, _ = Oscillator(case).orbits()
            except (ArithmeticError, np.linalg.LinAlgError):
                continue
            sharp = [
                f for f in found if f["z0_error_pm"] < 1e-7 and f["phase_error"] < 1e-9 and abs(f["closure"]) < 1e-9
            ]
            orbits = [
                {
                    "tip_offset": float(f["tip_offset"]),
                    "phase": float(f["phase"]),
                    "uncertainty": [float(1e-12 * f["z0_error_pm"]), float(f["phase_error"])],
                }
                for f in sharp
            ]
            if orbits:
                data.append({"regime": regime} | case | {"orbits": orbits})
                count += 1
        print(f"{regime}: {count} of {PER_REGIME} cases, {time.time() - started:.0f} s", flush=True)
    OUT.write_text(json.dumps(data, indent=1) + "\n")


if __name__ == "__main__":
    main()
