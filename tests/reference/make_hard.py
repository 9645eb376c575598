"""Makes tests/data/hard.json: what is right on the cases of benchmarks/hard_cases.py, by means independent of phasemap.

    PYTHONPATH=. python tests/reference/make_hard.py    # everything (an hour or so); with a word, the cases with it in their
    name PYTHONPATH=. python tests/reference/make_hard.py --turns    # the setpoints of the family "folds"

Parameters alone are read from benchmarks/hard_cases.py.  For each case the tip is engaged in time
(hard_engage.py). Written are

outcome: see hard_engage.py; "depends": engaging in other steps ends otherwise.
orbit: null unless held; the periodic orbit by Newton's method on state and tip offset (hard_map.py): tip_offset,
peak_indentation [m],
    phase [degree], floquet (largest modulus), slope (dA/dz0 at constant drive), contacts (entries into contact per
    period, -1: never out of it), uncertainty [m] (change of state and tip offset in the last step of Newton's method,
    and what an integrator a hundred times less exact would change).
jumps: [tip offset [m], amplitude before and after [m], whether the oscillation after it repeats every period].
periods: integrated.
depth_limit: tip offset [m] below which no instrument would press the lever in, nor the law of force hold: there a
solver may
    as well say that there is no orbit.
"""

import json
import pathlib
import sys
import time

import numpy as np
from hard_engage import Tip, depth_limit, engage, start_of
from hard_map import change, differentiate, parameters

OUT = pathlib.Path(__file__).parent.parent / "data" / "hard.json"
BUDGET = 250_000  # periods a case
NM = 1e-9


def as_case(case):
    """A HardCase as the dict that the reference codes read."""
    scope, material = case.scope, case.material
    return {
        "stiffness": scope.cantilever.stiffness,
        "quality_factor": scope.cantilever.quality_factor,
        "frequency_ratio": scope.frequency_ratio,
        "free_amplitude": scope.drive.free_amplitude,
        "tip_radius": scope.tip.radius,
        "decay_length": scope.interaction.decay_length,
        "contact": scope.interaction.law.name,
        "modulus": material.modulus,
        "adhesion": material.adhesion,
        "damping": material.damping,
        "poisson_ratio": material.poisson_ratio,
        "setpoint": case.setpoint,
    }


def at_offset(p, u):
    """The periodic orbit at u's tip offset near u = (z, z', z0); returns it and its amplitude."""
    r, jac, out = np.zeros(3), np.zeros((3, 3)), np.empty(5)
    for _ in range(12):
        if not differentiate(p, u, 3e-7 * np.hypot(u[0], u[1]), 1e-12, jac) or not change(p, u, 1e-12, out, r):
            raise ArithmeticError("integration failed")
        move = np.linalg.solve(jac[:2, :2], -r[:2])
        u = u + np.array([*move, 0.0])
        if np.max(np.abs(move)) < 1e-11 * p[8]:
            break
    change(p, u, 1e-12, out, r)
    return u, r[2]


def turn(case, least=0.005):
    """The setpoint at which the amplitude first has a minimum, as the tip comes down, below 1 - least."""
    tip = Tip(case | {"setpoint": 0.5})
    free, z0 = tip.free, start_of(tip)
    tip.settle(z0, near=0.1 * free)
    step, last, before = 2e-3 * free, 0.0, tip.amplitude
    while True:
        saved, signal = tip.state(), tip.signal()
        steady = tip.settle(z0 - step, near=2 * step + 0.02 * free)
        jump = abs(tip.signal() - signal) > 4 * step + 0.01 * free
        turned = tip.amplitude > before and before < (1 - least) * free
        if (jump or not steady or turned) and step > 1e-4 * free:
            tip.restore(saved)
            step /= 4
            continue
        if turned:
            tip.restore(saved)
            break
        z0, last = z0 - step, step
        step = min(1.6 * step, 2e-3 * free)
        before = tip.amplitude
    # the minimum of a polynomial through amplitudes round it, nearer and nearer
    p, u, center, width = tip.p, np.array([*tip.s, z0]), z0, 1.2 * max(step, last)
    for _ in range(8):
        at, amplitudes = center + width * np.cos(np.pi * (np.arange(9) + 0.5) / 9), []
        for z in at:
            u[2] = z
            u, a = at_offset(p, u)
            amplitudes.append(a)
        curve = np.polynomial.Polynomial.fit(at, amplitudes, 6)
        roots = curve.deriv().roots()
        roots = roots[abs(roots.imag) < 1e-9].real
        roots = roots[abs(roots - center) < 1.2 * width]
        if len(roots) == 0:  # farther on
            center = at[np.argmin(amplitudes)]
            u[2] = center
            continue
        center = roots[np.argmin(curve(roots))]
        width *= 0.7
        print(f"   z0 {center:.9f} setpoint {curve(center) / free:.12f}", flush=True)
    return float(curve(center) / free)


def same(one, two):
    if one is None or two is None:
        return one is two
    return abs(one["tip_offset"] - two["tip_offset"]) < 1e-5 * (abs(one["tip_offset"]) + one["amplitude"])


def known(c):
    p, free = parameters(c)
    found = engage(c, budget=BUDGET)
    orbit = found.get("orbit")
    if found["outcome"] != "budget" and (found["jumps"] or found["unsteady"]):
        # Where a jump or a chaotic transient ends may hang on where exactly it began.
        for largest, smallest in ((0.013, 2.3e-5), (0.017, 0.7e-5))[: 2 if found["unsteady"] else 1]:
            other = engage(c, step_max=largest, step_min=smallest, budget=BUDGET)
            if other["outcome"] != found["outcome"] or not same(orbit, other.get("orbit")):
                found["outcome"], orbit = "depends", None
                break
    if orbit is not None:
        u, r, loose, out = np.array([*orbit["state"], orbit["tip_offset"]]), np.zeros(3), np.zeros(3), np.empty(5)
        jac = np.zeros((3, 3))
        differentiate(p, u, 3e-8 * np.hypot(u[0], u[1]), 1e-12, jac)
        change(p, u, 1e-12, out, r)
        change(p, u, 1e-10, out, loose)
        doubt = np.max(np.abs(np.linalg.solve(jac, loose - r))) + orbit["last_step"]
        orbit = {
            "tip_offset": orbit["tip_offset"] * NM, "phase": orbit["phase"], "peak_indentation": orbit["peak_indentation"] * NM,
            "contacts": orbit["contacts"], "floquet": orbit["floquet"], "slope": orbit["slope"], "uncertainty": float(doubt) * NM,
        }  # fmt: skip
    return {
        "outcome": found["outcome"],
        "orbit": orbit,
        "jumps": [[z * NM, a * NM, b * NM, steady] for z, a, b, steady in found["jumps"]],
        "periods": found["periods"],
        "depth_limit": depth_limit(p, free) * NM,
    }


def main():
    from benchmarks.hard_cases import CASES, FOLDS, case_of

    if "--turns" in sys.argv:
        for name, (row, at, _) in FOLDS.items():
            # in the liquid the amplitude has a small dip at first contact already
            print(name, turn(as_case(case_of(name, "", None, row[2])), least=0.1 if at < 0.5 else 0.005), at)
        return
    only = sys.argv[1] if len(sys.argv) > 1 else ""
    data = json.loads(OUT.read_text()) if OUT.exists() else {}
    for case in CASES:
        if only not in case.name or (not only and data.get(case.name, {}).get("case") == as_case(case)):
            continue
        started = time.time()
        data[case.name] = {"case": as_case(case)} | known(as_case(case))
        one = data[case.name]
        orbit = one["orbit"] and (
            round(one["orbit"]["tip_offset"] * 1e9, 4),
            round(one["orbit"]["phase"], 3),
            one["orbit"]["uncertainty"],
        )
        print(
            f"{case.name}: {one['outcome']} {orbit}, {one['periods']} periods, {time.time() - started:.0f} s",
            flush=True,
        )
        names = [c.name for c in CASES]
        data = {name: data[name] for name in names if name in data}
        lines = [f"{json.dumps(name)}: {json.dumps(one)}" for name, one in data.items()]  # a line a case
        OUT.write_text("{\n" + ",\n".join(lines) + "\n}\n")


if __name__ == "__main__":
    main()
