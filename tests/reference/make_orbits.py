"""Makes tests/data/orbits_unseen.json: exact periodic orbits of cases that orbits.json does not cover.

    python tests/reference/make_orbits.py

Newton shooting (shooting.py) along the curve of orbits of the wanted amplitude, from far to deep contact, with tip
offset and drive free; an orbit is where the drive equals the one given.  "complete" means: the curve was followed to
its end without a gap, every crossing was refined, and a second run with shorter steps found the same orbits.  Orbits on
a separate closed curve, and orbits of more than one drive period, would not be seen.

Units SI.  frequency_ratio is drive over resonance frequency; free_amplitude is at resonance (u0 = free_amplitude / Q);
setpoint is relative to the free amplitude at the drive frequency.  decay_length null: no force before contact (with
contact "dmt" the force then jumps by 2 pi w R there).  Per orbit, beside what orbits.json has: dissipation (J per
cycle), peak_indentation (m; negative: minus the smallest gap), contacts (entries into contact per period; 0 with a
positive peak_indentation is permanent contact), multipliers (two, real and imaginary part), slope (dA/dz0 at constant
drive; the feedback needs it positive).
"""

import json
import pathlib
import sys
import time

import numpy as np
from scipy.integrate import solve_ivp
from shooting import AL0, AL1, D0, EX, FA, KC, RT, Oscillator

OUT = pathlib.Path(__file__).parent.parent / "data" / "orbits_unseen.json"
DEFAULTS = dict(
    stiffness=40.0,
    tip_radius=10e-9,
    free_amplitude=20e-9,
    quality_factor=400.0,
    frequency_ratio=1.0,
    modulus=2e9,
    poisson_ratio=0.35,
    tip_modulus=None,
    tip_poisson_ratio=0.0,
    adhesion=0.03,
    decay_length=0.2e-9,
    damping=0.005,
    damping_exponent=0.5,
    contact="dmt",
    setpoint=0.7,
)
LIQUID = dict(
    stiffness=0.6,
    tip_radius=20e-9,
    free_amplitude=10e-9,
    quality_factor=3.0,
    modulus=50e6,
    adhesion=5e-4,
    decay_length=0.4e-9,
    damping=0.02,
)
FIG7 = dict(tip_radius=30e-9, free_amplitude=40e-9, quality_factor=250.0, modulus=1e9, adhesion=0.2, damping=0.005)

CASES = [
    # low quality factor
    ("liquid Q 1.5", "low Q", LIQUID | dict(quality_factor=1.5)),
    (
        "liquid Q 1.5, soft sample, permanent contact",
        "low Q",
        LIQUID | dict(quality_factor=1.5, modulus=3e6, stiffness=0.3, damping=0.0, setpoint=0.9),
    ),
    (
        "liquid Q 2, damped soft sample",
        "low Q",
        LIQUID | dict(quality_factor=2.0, modulus=5e6, damping=0.3, setpoint=0.4),
    ),
    ("liquid Q 2, stiff sample", "low Q", LIQUID | dict(quality_factor=2.0, modulus=5e9, setpoint=0.85)),
    (
        "liquid Q 2.5, permanent contact",
        "low Q",
        LIQUID | dict(quality_factor=2.5, modulus=8e6, stiffness=1.0, setpoint=0.5),
    ),
    (
        "liquid Q 3, nearly touching all period",
        "low Q",
        LIQUID | dict(modulus=12e6, stiffness=0.5, setpoint=0.55, damping=0.0),
    ),
    (
        "liquid Q 4, small amplitude",
        "low Q",
        LIQUID | dict(quality_factor=4.0, free_amplitude=1e-9, stiffness=5.0, modulus=1e9, setpoint=0.9),
    ),
    ("liquid Q 5, sticky", "low Q", LIQUID | dict(quality_factor=5.0, adhesion=0.02, stiffness=2.0, setpoint=0.6)),
    (
        "liquid Q 6, Hertz",
        "low Q",
        LIQUID | dict(quality_factor=6.0, contact="hertz", adhesion=0.0, decay_length=None, setpoint=0.7),
    ),
    ("liquid Q 8, low setpoint", "low Q", LIQUID | dict(quality_factor=8.0, setpoint=0.1)),
    (
        "liquid Q 8, strongly sticky",
        "low Q",
        LIQUID | dict(quality_factor=8.0, adhesion=0.05, stiffness=1.0, modulus=1e9, setpoint=0.75),
    ),
    (
        "liquid Q 8, strongly sticky, high setpoint",
        "low Q",
        LIQUID | dict(quality_factor=8.0, adhesion=0.05, stiffness=1.0, modulus=1e9, setpoint=0.9),
    ),
    ("liquid Q 2, two contacts per period", "low Q", LIQUID | dict(quality_factor=2.0, modulus=5e9, setpoint=0.2)),
    ("liquid, drive 0.7", "low Q", LIQUID | dict(frequency_ratio=0.7)),
    ("liquid, drive 0.85, Q 5", "low Q", LIQUID | dict(frequency_ratio=0.85, quality_factor=5.0, setpoint=0.8)),
    ("liquid, drive 1.2, Q 5", "low Q", LIQUID | dict(frequency_ratio=1.2, quality_factor=5.0, setpoint=0.6)),
    ("liquid, drive 1.4, Q 2", "low Q", LIQUID | dict(frequency_ratio=1.4, quality_factor=2.0, setpoint=0.9)),
    (
        "liquid, drive 1.4, Q 8, Hertz",
        "low Q",
        LIQUID | dict(frequency_ratio=1.4, quality_factor=8.0, contact="hertz", adhesion=0.0, decay_length=None),
    ),
    # high quality factor
    ("Q 5e4", "high Q", dict(quality_factor=5e4)),
    (
        "Q 5e4, undamped, no adhesion before contact",
        "high Q",
        dict(quality_factor=5e4, damping=0.0, decay_length=None, setpoint=0.5),
    ),
    (
        "Q 5e4, Hertz, damped",
        "high Q",
        dict(quality_factor=5e4, contact="hertz", adhesion=0.0, decay_length=None, damping=0.02, setpoint=0.8),
    ),
    ("Q 1e6", "high Q", dict(quality_factor=1e6, setpoint=0.8)),
    ("Q 1e6, undamped", "high Q", dict(quality_factor=1e6, damping=0.0, setpoint=0.3)),
    ("Q 1e6, small amplitude", "high Q", dict(quality_factor=1e6, free_amplitude=1e-9, adhesion=0.005, setpoint=0.6)),
    # contact laws
    ("Hertz", "contact law", dict(contact="hertz", adhesion=0.0, decay_length=None)),
    (
        "Hertz, undamped, low setpoint",
        "contact law",
        dict(contact="hertz", adhesion=0.0, decay_length=None, damping=0.0, setpoint=0.2),
    ),
    ("DMT, no long range", "contact law", dict(decay_length=None)),
    ("DMT, no long range, strong adhesion", "contact law", dict(decay_length=None, adhesion=0.2, setpoint=0.85)),
    (
        "DMT, no long range, undamped soft lever",
        "contact law",
        dict(decay_length=None, stiffness=3.0, adhesion=0.05, modulus=3e8, damping=0.0, setpoint=0.6),
    ),
    ("decay length 0.05 nm", "contact law", dict(decay_length=0.05e-9, adhesion=0.1)),
    (
        "decay length 0.05 nm, stiff",
        "contact law",
        dict(decay_length=0.05e-9, adhesion=0.3, modulus=7e10, setpoint=0.8),
    ),
    ("decay length 1 nm", "contact law", dict(decay_length=1e-9, adhesion=0.02)),
    ("adhesion only", "contact law", dict(modulus=0.0, damping=0.0, adhesion=0.05)),
    ("adhesion only, damped", "contact law", dict(modulus=0.0, damping=0.01, adhesion=0.02, setpoint=0.9)),
    ("damping only", "contact law", dict(modulus=0.0, damping=0.02, adhesion=0.0, decay_length=None, setpoint=0.6)),
    ("elastic tip", "contact law", dict(modulus=1e11, tip_modulus=1.3e11, tip_poisson_ratio=0.27)),
    (
        "elastic tip softer than the sample",
        "contact law",
        dict(modulus=2e11, poisson_ratio=0.2, tip_modulus=3e9, tip_poisson_ratio=0.4, setpoint=0.5),
    ),
    # modulus
    ("modulus 1 MPa", "modulus", dict(modulus=1e6, stiffness=2.0, quality_factor=100.0, adhesion=0.002, damping=0.0)),
    ("modulus 1 MPa, damped, stiff lever", "modulus", dict(modulus=1e6, damping=0.01, adhesion=0.001)),
    ("modulus 30 MPa", "modulus", dict(modulus=3e7, stiffness=2.0, quality_factor=150.0, adhesion=0.01)),
    ("modulus 1e12 Pa", "modulus", dict(modulus=1e12, damping=0.0005)),
    ("modulus 1e12 Pa, undamped, soft lever", "modulus", dict(modulus=1e12, stiffness=2.0, damping=0.0, setpoint=0.5)),
    # damping
    ("damping exponent 0", "damping", dict(damping_exponent=0.0, damping=0.003)),
    ("damping exponent 0, no long range", "damping", dict(damping_exponent=0.0, damping=0.002, decay_length=None)),
    ("damping exponent 1", "damping", dict(damping_exponent=1.0, damping=0.05)),
    ("damping exponent 1, low Q", "damping", LIQUID | dict(damping_exponent=1.0, damping=0.5, quality_factor=4.0)),
    ("damping exponent 1.5", "damping", dict(damping_exponent=1.5, damping=0.5, setpoint=0.5)),
    ("damping 0.2", "damping", dict(damping=0.2)),
    ("damping 1", "damping", dict(damping=1.0, setpoint=0.5)),
    ("damping 5", "damping", dict(damping=5.0, setpoint=0.8)),
    ("damping 5, low Q", "damping", LIQUID | dict(damping=5.0)),
    ("undamped", "damping", dict(damping=0.0)),
    # setpoint and amplitude
    ("setpoint 0.05", "range", dict(setpoint=0.05)),
    ("setpoint 0.05, Hertz", "range", dict(setpoint=0.05, contact="hertz", adhesion=0.0, decay_length=None)),
    ("setpoint 0.99", "range", dict(setpoint=0.99)),
    ("setpoint 0.99, free amplitude 300 nm", "range", dict(setpoint=0.99, free_amplitude=300e-9)),
    ("free amplitude 300 nm", "range", dict(free_amplitude=300e-9, setpoint=0.6, modulus=5e9)),
    ("free amplitude 1 nm", "range", dict(free_amplitude=1e-9, stiffness=200.0, adhesion=0.02)),
    (
        "free amplitude 2 nm, Q 100",
        "range",
        dict(free_amplitude=2e-9, quality_factor=100.0, adhesion=0.01, setpoint=0.9),
    ),
    # off resonance in air
    ("drive 0.97", "off resonance", dict(frequency_ratio=0.97, quality_factor=100.0)),
    ("drive 0.99", "off resonance", dict(frequency_ratio=0.99, quality_factor=200.0, setpoint=0.9)),
    ("drive 0.998", "off resonance", dict(frequency_ratio=0.998, adhesion=0.1, setpoint=0.8)),
    ("drive 1.002", "off resonance", dict(frequency_ratio=1.002, adhesion=0.1, setpoint=0.8)),
    (
        "drive 1.01, Hertz",
        "off resonance",
        dict(frequency_ratio=1.01, contact="hertz", adhesion=0.0, decay_length=None, quality_factor=100.0),
    ),
    ("drive 1.03", "off resonance", dict(frequency_ratio=1.03, quality_factor=60.0, setpoint=0.95)),
    # several orbits
    ("bistable", "bistable", FIG7),
    ("bistable, undamped", "bistable", FIG7 | dict(damping=0.0, setpoint=0.6)),
    (
        "bistable, stiff sample",
        "bistable",
        dict(modulus=5e10, adhesion=0.3, damping=0.001, free_amplitude=10e-9, setpoint=0.85),
    ),
    (
        "bistable, soft lever",
        "bistable",
        dict(stiffness=3.0, quality_factor=150.0, modulus=5e8, adhesion=0.1, setpoint=0.8),
    ),
    ("bistable, high setpoint", "bistable", FIG7 | dict(setpoint=0.95)),
    ("bistable, damping exponent 1", "bistable", FIG7 | dict(damping=0.1, damping_exponent=1.0, setpoint=0.75)),
    # setpoint 1e-5 inside the range with three orbits, of which two are about to merge (near_fold finds it between
    # these bounds)
    ("near fold, attractive, high setpoint", "near fold", FIG7 | dict(adhesion=0.1, setpoint=(0.9, 0.95))),
    ("near fold, attractive", "near fold", dict(free_amplitude=6e-9, setpoint=(0.7, 0.8))),
    ("near fold, attractive, low setpoint", "near fold", dict(free_amplitude=6e-9, setpoint=(0.2, 0.3))),
    ("near fold, repulsive", "near fold", FIG7 | dict(adhesion=0.3, damping=0.05, setpoint=(0.8, 0.9))),
    (
        "near fold, repulsive, small amplitude",
        "near fold",
        dict(free_amplitude=10e-9, adhesion=0.1, damping=0.02, setpoint=(0.9, 0.95)),
    ),
]


def near_fold(case, low, high):
    """The setpoint 1e-5 inside the range with several orbits, by bisection; both ends must differ in the number of orbits."""
    count = lambda s: len(Oscillator(case | {"setpoint": s}).orbits()[0])
    n_low, n_high = count(low), count(high)
    if n_low == n_high:
        raise ValueError(f"no fold: {n_low} and {n_high} orbits")
    while high - low > 1e-6:
        middle = (low + high) / 2
        low, high = (middle, high) if count(middle) == n_low else (low, middle)
    return round(high + 1e-5 if n_high > n_low else low - 1e-5, 6)


def second_opinion(o, x):
    """The residuals of an orbit by scipy's DOP853 on (z, z') in plain time, stopped at each contact; as errors (pm, degrees)."""
    p, w = o.p, o.w

    def rhs(t, y, contact):
        d = y[0] - x[4]
        if contact:
            d = max(d, 0.0)
            force, a = p[KC] * d**1.5 - p[FA], p[AL0] + (p[AL1] * (d / p[RT]) ** p[EX] if p[AL1] else 0.0)
        else:
            force, a = (-p[FA] / (1 - min(d, 0) / p[D0]) ** 2 if p[D0] > 0 else 0.0), p[AL0]
        c, s = np.cos(w * t), np.sin(w * t)
        return [y[1], x[2] * c + x[3] * s - 2 * a * y[1] - y[0] - force, y[0] * c * w / np.pi, y[0] * s * w / np.pi]

    t, end, y = -np.pi / w, np.pi / w, np.array([-x[0], -x[1] * w, 0, 0])
    contact = y[0] > x[4]
    while t < end:
        event = lambda t, y, contact: y[0] - x[4]
        event.terminal, event.direction = True, -1 if contact else 1
        sol = solve_ivp(
            rhs, (t, end), y, "DOP853", events=event, args=(contact,), rtol=3e-14, atol=1e-15 * o.amp, max_step=0.005
        )
        t, y, contact = sol.t[-1], sol.y[:, -1], contact != (sol.status == 1)
    # end state back to a and b: z = -a, z' = -b w at theta = pi
    r = np.array([-y[0] - x[0], -y[1] / w - x[1], y[2] - o.amp, y[3], o.drive_equation(x)[0]])
    dx = np.linalg.solve(np.vstack([o.jacobian(x, None, 1e-13), o.drive_equation(x)[1]]), r)
    return abs(dx[4]) * 1e3, np.degrees(np.hypot(dx[2], dx[3]) / o.u0)


def main():
    data, second = [], (0.0, 0.0)
    worst = dict(closure=0.0, det_error=0.0, z0_error_pm=0.0, phase_error=0.0, residual=0.0)
    only = sys.argv[1] if len(sys.argv) > 1 else ""
    for name, regime, change in CASES:
        if only not in name:
            continue
        started = time.time()
        case = DEFAULTS | change
        if isinstance(case["setpoint"], tuple):  # near fold
            try:
                case["setpoint"] = near_fold(case, *case["setpoint"])
            except ValueError as error:
                print(f"{name}: {error}; dropped")
                continue
        o = Oscillator(case)
        found, complete = o.orbits()
        for wiggle in (0.3, 0.15):  # shorter steps must find the same
            (before, whole), (found, complete) = (found, complete), o.orbits(wiggle)
            complete = bool(
                complete
                and whole
                and len(found) == len(before)
                and all(abs(a["tip_offset"] - f["tip_offset"]) < 1e-16 for a, f in zip(before, found))
            )
            if complete:
                break
        print(
            f"{name}: setpoint {case['setpoint']}, {len(found)} orbits{'' if complete else ', NOT COMPLETE'}, {time.time() - started:.1f} s",
            flush=True,
        )
        for f in list(found):
            note = ""
            if not (
                f["z0_error_pm"] < 1e-5
                and f["phase_error"] < 1e-7
                and abs(f["closure"]) < 1e-9
                and f["det_error"] < 1e-6
            ):
                note, complete = " POOR, dropped", False
                found.remove(f)
            pm, deg = second_opinion(o, f["x"])
            second = max(second[0], pm), max(second[1], deg)
            note += f" second integrator {pm:.0e} pm {deg:.0e} deg"
            print(
                f"   z0 {f['tip_offset'] * 1e9:.5f} nm phase {f['phase']:.5f} floquet {f['floquet']:.6f} {np.round(f['multipliers'], 4)} slope {f['slope']:.4f}"
                f" peak {f['peak_indentation'] * 1e9:.4f} nm contacts {f['contacts']} closure {f['closure']:.0e} det {f['det_error']:.0e}"
                f" errors {f['z0_error_pm']:.0e} pm {f['phase_error']:.0e} deg{note}",
                flush=True,
            )
            worst = {key: max(value, float(abs(f[key]))) for key, value in worst.items()}
            for key in ("x", "closure", "det_error", "z0_error_pm", "phase_error"):
                del f[key]
            f["multipliers"] = [[float(m.real), float(m.imag)] for m in f["multipliers"]]
            f.update({key: float(v) for key, v in f.items() if isinstance(v, np.floating)})
        if found:
            data.append({"name": name, "regime": regime} | case | {"orbits": found, "complete": complete})
    print(
        f"{len(data)} cases, {sum(len(c['orbits']) for c in data)} orbits, largest errors {worst}, by the second integrator {second} pm, degrees"
    )
    if not only:
        OUT.write_text(json.dumps(data, indent=1) + "\n")


if __name__ == "__main__":
    main()
