"""Makes tests/data/laws.json: periodic orbits at a setpoint for every contact law, by Newton shooting; nothing of phasemap is used.

    python tests/reference/make_laws.py [word]

Equation and modes: truth_map.py; what is recorded of an orbit: truth_orbits.facts.  Starts come from first-order
averaging with the loop of the law in it and from sweeps of the tip offset in time (truth_seeds.py).  An orbit is listed
if Newton's method converged and the closures hold; stable and unstable alike, from far to near.  Others may exist.

Parameters of a case (SI): law "hertz", "dmt", "jkr", "maugis", "spring", "neck" (then neck_length); decay_length null:
no force before contact; bias [V] or null; free_amplitude at resonance; frequency_ratio drive over resonance; setpoint
relative to the free amplitude at the drive.  Maugis: sigma0 = adhesion / decay_length.  Rigid tip.

Per orbit (SI): tip_offset; amplitude of the first harmonic; phase [degree], 90 less the lag; mean_deflection;
indentation = max d (negative: minus the smallest gap); farthest = min d; dissipation [J per cycle], of which _viscous
(a_s) and _hysteresis (integral of F dz); virial -<F z> [J] (F > 0 repulsive; the damping force adds nothing to it);
peak_force, attractive_force = max and min of F over the cycle [N], the damping force not counted, bias counted;
mean_force <F> [N]; contact_fraction of the period in contact, necks included; contacts = entries into contact per
period; harmonics = amplitudes 2..6; floquet = largest modulus of the multipliers; slope = dA/dz0; start = a state on
the orbit: drive_angle [rad] (drive is cos), deformation d, velocity dz/dtau, mode 0 apart, 1 contact, 2 neck. Checks:
energy_closure relative to pi u0 A k; virial_closure relative to u0 A k; mean_closure relative to A;
determinant_closure: product of the multipliers over exp(-integral 2 (a0 + a_s)); residual [m] of periodicity and
amplitude; uncertainty = [tip offset (m), phase (degree)]: change when the integrator is 30 times less exact, and the
last step.
"""

import json
import math
import pathlib
import sys
import time

from truth_map import SZ
from truth_orbits import Lost, complete, parameters, shoot
from truth_seeds import averaged, swept

HERE = pathlib.Path(__file__).parent
OUT = (HERE.parent / "data" if (HERE.parent / "data").is_dir() else HERE) / "laws.json"
BASE = dict(
    law="dmt", stiffness=20.0, quality_factor=200.0, free_amplitude=30e-9, frequency_ratio=1.0, tip_radius=10e-9, modulus=2e9,
    poisson_ratio=0.35, adhesion=0.03, decay_length=0.2e-9, damping=0.005, setpoint=0.7, bias=None, neck_length=None,
)  # fmt: skip
AIR = BASE
FIG3 = BASE | dict(stiffness=40.0, tip_radius=30e-9, quality_factor=250.0, free_amplitude=155e-9, modulus=1.35e9 * 0.75 * (1 - 0.35**2),
                   adhesion=0.37, damping=0.014, decay_length=0.3e-9)  # fmt: skip
SOFT = BASE | dict(
    stiffness=2.0, quality_factor=120.0, free_amplitude=40e-9, tip_radius=20e-9, modulus=5e7, adhesion=0.02
)
LIQUID = BASE | dict(stiffness=0.6, quality_factor=3.0, free_amplitude=10e-9, tip_radius=20e-9, modulus=5e7, adhesion=5e-4,
                     decay_length=0.4e-9, damping=0.02)  # fmt: skip
HARD = BASE | dict(
    stiffness=40.0, quality_factor=450.0, free_amplitude=25e-9, modulus=7e10, adhesion=0.1, damping=0.001
)
W7 = BASE | dict(stiffness=40.0, tip_radius=30e-9, free_amplitude=40e-9, quality_factor=250.0, modulus=1e9, adhesion=0.2, damping=0.005,
                 decay_length=0.3e-9)  # fmt: skip
SMALL = AIR | dict(stiffness=40.0, free_amplitude=8e-9, quality_factor=300.0, adhesion=0.04)
CASES = [
    ("hertz air", AIR | dict(law="hertz", adhesion=0.0, decay_length=None)),
    ("hertz liquid", LIQUID | dict(law="hertz", adhesion=0.0, decay_length=None, setpoint=0.8)),
    ("hertz soft, undamped", SOFT | dict(law="hertz", adhesion=0.0, decay_length=None, damping=0.0, setpoint=0.5)),
    ("hertz with bias", AIR | dict(law="hertz", adhesion=0.0, bias=3.0)),
    ("dmt air", AIR),
    ("dmt air, no long range", AIR | dict(decay_length=None, adhesion=0.1)),
    ("dmt fig 3 lever", FIG3),
    ("dmt fig 3 lever, drive 0.998", FIG3 | dict(frequency_ratio=0.998, setpoint=0.8)),
    ("dmt hard", HARD | dict(setpoint=0.6)),
    ("dmt soft", SOFT | dict(adhesion=0.05, setpoint=0.85)),
    ("dmt liquid", LIQUID),
    ("dmt liquid Q 8, drive 0.9", LIQUID | dict(quality_factor=8.0, frequency_ratio=0.9, setpoint=0.6)),
    ("dmt Q 1000, undamped", AIR | dict(quality_factor=1000.0, damping=0.0)),
    ("dmt with bias", AIR | dict(bias=2.0)),
    ("dmt with strong bias, k 0.3", AIR | dict(stiffness=0.3, bias=1.0, quality_factor=30.0, adhesion=0.01, modulus=2e8)),
    ("jkr air", AIR | dict(law="jkr", adhesion=0.05)),
    ("jkr air, no long range", AIR | dict(law="jkr", adhesion=0.05, decay_length=None)),
    ("jkr air, undamped", AIR | dict(law="jkr", adhesion=0.05, damping=0.0, setpoint=0.85)),
    ("jkr soft", SOFT | dict(law="jkr", free_amplitude=60e-9, adhesion=0.03)),
    ("jkr soft, no long range", SOFT | dict(law="jkr", free_amplitude=60e-9, adhesion=0.03, decay_length=None, setpoint=0.6)),
    ("jkr fig 3 lever", FIG3 | dict(law="jkr")),
    ("jkr fig 3 lever, no long range, drive 1.002", FIG3 | dict(law="jkr", decay_length=None, frequency_ratio=1.002, setpoint=0.9)),
    ("jkr hard, Q 450", HARD | dict(law="jkr", setpoint=0.5)),
    ("jkr Q 1000", AIR | dict(law="jkr", quality_factor=1000.0, adhesion=0.02, setpoint=0.6)),
    ("jkr liquid", LIQUID | dict(law="jkr", adhesion=2e-3, setpoint=0.8)),
    ("jkr liquid, no long range, Q 5", LIQUID | dict(law="jkr", quality_factor=5.0, decay_length=None, setpoint=0.6)),
    ("jkr with bias", AIR | dict(law="jkr", adhesion=0.05, bias=2.0)),
    ("maugis air", AIR | dict(law="maugis", adhesion=0.05)),
    ("maugis soft", SOFT | dict(law="maugis", free_amplitude=60e-9, adhesion=0.03, setpoint=0.75)),
    ("maugis fig 3 lever", FIG3 | dict(law="maugis")),
    ("maugis hard", HARD | dict(law="maugis", setpoint=0.5)),
    ("maugis liquid", LIQUID | dict(law="maugis", adhesion=2e-3, setpoint=0.8)),
    ("maugis Q 1000", AIR | dict(law="maugis", quality_factor=1000.0, adhesion=0.02, decay_length=0.3e-9, setpoint=0.6)),
    ("spring air", AIR | dict(law="spring")),
    ("spring air, no long range", AIR | dict(law="spring", adhesion=0.08, decay_length=None)),
    ("spring soft", SOFT | dict(law="spring", setpoint=0.6)),
    ("spring liquid", LIQUID | dict(law="spring", setpoint=0.8)),
    ("neck air", AIR | dict(law="neck", neck_length=0.5e-9)),
    ("neck air, no long range", AIR | dict(law="neck", neck_length=1e-9, decay_length=None)),
    ("neck soft", SOFT | dict(law="neck", neck_length=3e-9, free_amplitude=60e-9)),
    ("neck fig 3 lever, with bias", FIG3 | dict(law="neck", neck_length=1e-9, adhesion=0.1, bias=5.0)),
    ("neck liquid", LIQUID | dict(law="neck", neck_length=1e-9, setpoint=0.8)),
    ("dmt bistable", W7 | dict(setpoint=0.8)),
    ("dmt bistable, no long range", W7 | dict(decay_length=None)),
    ("dmt small amplitude", SMALL | dict(setpoint=0.95)),
    ("dmt soft, no long range", SOFT | dict(decay_length=None, setpoint=0.8)),
    ("dmt Q 1000, bistable", AIR | dict(quality_factor=1000.0, free_amplitude=12e-9, adhesion=0.05, setpoint=0.8)),
    ("jkr bistable", W7 | dict(law="jkr")),
    ("jkr bistable, setpoint 0.9", W7 | dict(law="jkr", setpoint=0.9)),
    ("jkr bistable, no long range", W7 | dict(law="jkr", decay_length=None, setpoint=0.8)),
    ("jkr bistable, no long range, setpoint 0.5", W7 | dict(law="jkr", decay_length=None, setpoint=0.5)),
    ("jkr small amplitude", SMALL | dict(law="jkr", setpoint=0.99)),
    ("jkr soft, bistable", SOFT | dict(law="jkr", free_amplitude=60e-9, setpoint=0.95)),
    ("jkr soft, bistable, no long range", SOFT | dict(law="jkr", decay_length=None, setpoint=0.9)),
    ("maugis bistable", W7 | dict(law="maugis")),
    ("maugis soft, bistable", SOFT | dict(law="maugis", free_amplitude=60e-9, setpoint=0.95)),
    ("spring bistable", W7 | dict(law="spring", setpoint=0.99)),
    ("spring soft, bistable, no long range", SOFT | dict(law="spring", free_amplitude=60e-9, decay_length=None, setpoint=0.99)),
    ("neck bistable, no long range", W7 | dict(law="neck", neck_length=0.9e-9, decay_length=None, setpoint=0.8)),
    ("neck small amplitude", SMALL | dict(law="neck", neck_length=0.6e-9, setpoint=0.8)),
    ("neck soft, bistable", SOFT | dict(law="neck", neck_length=0.6e-9, setpoint=0.6)),
]  # fmt: skip


def starts(p, om, a, case):
    """(section angle, mode, d, v, z0)."""
    begun = averaged(p, om, a)
    for z0, lag, mean in begun:
        yield lag - math.pi, 0, mean - a - z0, 0.0, z0
    q = case["quality_factor"]
    steps = 160 if q < 20 else 50
    far, near = p[SZ] * 1.05 + 3.0, -0.3 * p[SZ]
    if q >= 20:
        far, near = p[SZ] * 1.02 + 2.0, 0.0
    if q < 60 or len(begun) % 2 == 0 and q <= 300:
        for mode, d, v, z0 in swept(p, om, a, far, near, steps):
            yield -0.5 * math.pi, mode, d, v, z0


def orbits_of(case):
    p, om, free = parameters(case)
    a, found, lost = case["setpoint"] * free, [], []
    for begin, mode, d, v, z0 in starts(p, om, a, case):
        try:
            x, out = complete(p, case, om, mode, begin, [d, v, z0], target=a)
        except (Lost, ArithmeticError, ValueError) as e:
            lost.append((round(z0, 4), str(e)))
            continue
        if any(
            abs(o["tip_offset"] - out["tip_offset"]) < 1e-6 * a * 1e-9 and abs(o["phase"] - out["phase"]) < 1e-4
            for o in found
        ):
            continue
        out["found_by"] = "averaging" if begin != -0.5 * math.pi else "time"
        coarse, *_ = shoot(p, om, mode, begin, x[:2], x[2], target=a, tol=3e-13)
        lag_change = abs(coarse[1] - x[1]) / (a * om) + abs(coarse[0] + coarse[2] - x[0] - x[2]) / a
        out["uncertainty"] = [
            abs(coarse[2] - x[2]) * 1e-9 + out["last_step"],
            math.degrees(lag_change + out["last_step"] * 1e9 / a),
        ]
        found.append(out)
    return sorted(found, key=lambda o: -o["tip_offset"]), lost


def main(word=""):
    done = {c["name"]: c for c in json.loads(OUT.read_text())} if OUT.exists() else {}
    for name, case in CASES:
        if word not in name:
            continue
        t = time.time()
        found, lost = orbits_of(case)
        done[name] = {"name": name, **case, "orbits": found}
        worst = max(
            [
                abs(o[c])
                for o in found
                for c in ("energy_closure", "virial_closure", "mean_closure", "determinant_closure")
            ]
            + [0]
        )
        print(f"{name}: {len(found)} orbits, closures {worst:.0e}, {time.time() - t:.1f} s", *lost, flush=True)
        for o in found:
            print("   ", *(f"{o[k]:.6g}" for k in ("tip_offset", "phase", "indentation", "floquet", "slope", "dissipation", "contact_fraction")),
                  o["contacts"], o["found_by"], *(f"{u:.0e}" for u in o["uncertainty"]), flush=True)  # fmt: skip
        OUT.write_text(json.dumps([done[n] for n, _ in CASES if n in done], indent=1))


if __name__ == "__main__":
    main(*sys.argv[1:])
